//! How far off located objects are, over random poses and noisy images.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use std::f64::consts::{FRAC_PI_4, TAU};

use common::{Body, Camera, cabinet, distribution, look, model, mug, oven, quantile, tape, within, yawed};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;
use sagci_perception::{Freedom, Located, Prior, Request, View, locate};

const TRIALS: u64 = 12;

/// What is placed, how it is seen, and how well it must be found.
struct Case<'a> {
    object: &'a ObjectModel,
    X_WO: Isometry3<f64>,
    eyes: &'a [[f64; 3]],
    clutter: &'a [(&'a ObjectModel, Isometry3<f64>)],
    /// Turns by this much look the same, rad.
    symmetry: f64,
    /// Greatest shift of nine in ten, m, and turn, rad.
    shift: f64,
    turn: f64,
}

impl Case<'_> {
    fn hold(&self, what: &str) {
        let (mut shifts, mut turns, mut consistency) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 0..TRIALS {
            let mut random = Pcg64::seed_from_u64(seed);
            let d = [within(&mut random, 0.1), within(&mut random, 0.1), within(&mut random, 15f64.to_radians())];
            let t = self.X_WO.translation;
            let truth = Isometry3::from_parts(
                Translation3::new(t.x + d[0], t.y + d[1], t.z),
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), d[2]) * self.X_WO.rotation,
            );
            let q = vec![0.0; self.object.moving_joints().count()];
            let mut bodies = vec![Body::new(self.object, &truth, &q)];
            bodies.extend(self.clutter.iter().map(|(m, X)| Body::new(m, X, &vec![0.0; m.moving_joints().count()])));
            let bodies: Vec<&Body> = bodies.iter().collect();
            let views = images(self.eyes, [t.x, t.y, t.z + 0.1], &bodies, seed);
            let located = locate(&views, 0.0, &Request::near("object", self.object, self.X_WO, q)).unwrap();
            let turn = (located.X_WO.rotation * truth.rotation.inverse()).scaled_axis().z;
            shifts.push((located.X_WO.translation.vector - truth.translation.vector).norm());
            turns.push((turn - (turn / self.symmetry).round() * self.symmetry).abs());
            consistency.push(normalised_error_squared(&located, &truth));
        }
        let text = format!("{what}: shift {} mm, turn {} mrad, {consistency:.1?}", distribution(&shifts), distribution(&turns));
        assert!(quantile(&shifts, 0.9) < self.shift && quantile(&turns, 0.9) < self.turn, "{text}");
        // Nine in ten lie below 6.3 where the covariance over x, y and yaw is right. Too large a covariance is allowed for:
        // it holds what images cannot tell, such as an error of the camera's mounting that happens to be absent here.
        assert!(quantile(&consistency, 0.9) < 12.0, "more certain than right: {text}");
    }
}

fn images(eyes: &[[f64; 3]], target: [f64; 3], bodies: &[&Body], seed: u64) -> Vec<View> {
    let take = |(i, eye): (usize, &[f64; 3])| {
        let X_WC = look(*eye, target);
        View::new(Camera::default().image(&X_WC, bodies, 0.0, seed * 10 + i as u64), X_WC)
    };
    eyes.iter().enumerate().map(take).collect()
}

fn normalised_error_squared(located: &Located, truth: &Isometry3<f64>) -> f64 {
    let turn = (located.X_WO.rotation * truth.rotation.inverse()).scaled_axis();
    let shift = located.X_WO.translation.vector - truth.translation.vector;
    let e = Vector3::new(turn.z, shift.x, shift.y);
    let C = nalgebra::Matrix3::from_fn(|i, j| located.covariance[(2 + i, 2 + j)]);
    (e.transpose() * C.try_inverse().unwrap() * e)[0]
}

#[test]
fn a_plain_box_is_found_to_millimetres() {
    let object = model("<robot name='box'><link name='box'><visual><geometry><box size='0.2 0.3 0.2'/></geometry></visual></link></robot>");
    let eyes = [[0.1, 0.1, 0.6]];
    let X_WO = yawed(0.6, 0.0, 0.1, 0.3);
    Case { object: &object, X_WO, eyes: &eyes, clutter: &[], symmetry: TAU, shift: 0.002, turn: 0.005 }.hold("box");
}

#[test]
fn an_oven_with_a_mug_before_it_is_found_to_millimetres() {
    let (oven, mug) = (oven(), mug());
    let eyes = [[0.15, 0.3, 0.55], [0.1, -0.2, 0.5]];
    let clutter = [(&mug, yawed(0.45, -0.25, 0.0, 1.0))];
    let X_WO = yawed(0.75, 0.1, 0.0, 0.0);
    Case { object: &oven, X_WO, eyes: &eyes, clutter: &clutter, symmetry: TAU, shift: 0.002, turn: 0.004 }.hold("oven");
    Case { object: &oven, X_WO, eyes: &[[0.05, 0.0, 0.55]], clutter: &[], symmetry: TAU, shift: 0.003, turn: 0.005 }.hold("oven, one view");
}

#[test]
fn a_mug_is_found_with_the_direction_of_its_handle() {
    let mug = mug();
    let eyes = [[0.2, 0.0, 0.5], [0.25, -0.35, 0.45]];
    let X_WO = yawed(0.5, -0.2, 0.0, 2.0);
    Case { object: &mug, X_WO, eyes: &eyes, clutter: &[], symmetry: TAU, shift: 0.002, turn: 0.01 }.hold("mug");
}

#[test]
fn a_cabinet_and_a_roll_of_tape_are_found_to_millimetres() {
    let (cabinet, tape) = (cabinet(), tape());
    let eyes = [[0.1, 0.3, 0.5], [0.1, -0.2, 0.5]];
    let X_WO = yawed(0.7, 0.0, 0.0, 0.1);
    Case { object: &cabinet, X_WO, eyes: &eyes, clutter: &[], symmetry: TAU, shift: 0.002, turn: 0.004 }.hold("cabinet");
    let X_WO = yawed(0.5, 0.0, 0.0, 0.1);
    Case { object: &tape, X_WO, eyes: &[[0.2, 0.2, 0.4]], clutter: &[], symmetry: TAU / 12.0, shift: 0.002, turn: FRAC_PI_4 }.hold("tape");
}

/// All yaws of a round object score alike: in a place that only looks good at first they must not crowd out the right one.
#[test]
fn a_round_thing_in_an_open_drawer_is_not_taken_for_the_drawers_corner() {
    let (cabinet, tape) = (cabinet(), tape());
    for seed in 0..TRIALS / 2 {
        let mut random = Pcg64::seed_from_u64(seed);
        let X_WC = yawed(0.75 + within(&mut random, 0.05), within(&mut random, 0.05), 0.0, within(&mut random, 0.2));
        let X_WG = X_WC * yawed(-0.21, 0.0, 0.074, 0.0);
        let truth = X_WG * yawed(within(&mut random, 0.03), within(&mut random, 0.1), -0.04, within(&mut random, 3.0));
        let bodies = [Body::new(&cabinet, &X_WC, &[0.2]), Body::new(&tape, &truth, &[])];
        let views = images(&[[0.3, 0.1, 0.6]], [0.5, 0.0, 0.05], &[&bodies[0], &bodies[1]], seed);
        let prior = Prior::Region { X_WG, size: [0.26, 0.34, 0.08] };
        let request = Request { name: "tape", model: &tape, prior, freedom: Freedom::Standing, q: vec![], joints: vec![] };
        let located = locate(&views, 0.0, &request).unwrap();
        let shift = (located.X_WO.translation.vector - truth.translation.vector).norm();
        assert!(shift < 0.004, "seed {seed}: {shift} m off {truth}");
    }
}
