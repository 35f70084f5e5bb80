//! How far off located objects are, over random poses and images.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{Body, Camera, cabinet, distribution, look, model, mug, oven, quantile, tape, within, yawed};
use nalgebra::Isometry3;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;
use sagci_perception::{Located, Request, View, locate};

struct Errors {
    shift: Vec<f64>,
    turn: Vec<f64>,
    #[allow(dead_code)]
    joint: Vec<f64>,
    nees: Vec<f64>,
    failed: usize,
    seconds: f64,
    worst: String,
}

/// Locates an object at random places around `X_WO`, seen from `eyes`, with clutter.
fn trial(
    object: &ObjectModel,
    X_WO: &Isometry3<f64>,
    q: &[f64],
    eyes: &[[f64; 3]],
    clutter: &[(&ObjectModel, Isometry3<f64>)],
    count: u64,
) -> Errors {
    let mut e = Errors { shift: vec![], turn: vec![], joint: vec![], nees: vec![], failed: 0, seconds: 0.0, worst: String::new() };
    let camera = Camera::default();
    for seed in 0..count {
        let mut random = Pcg64::seed_from_u64(seed);
        let d = [within(&mut random, 0.1), within(&mut random, 0.1), within(&mut random, 15f64.to_radians())];
        let t = X_WO.translation;
        let truth = Isometry3::from_parts(
            nalgebra::Translation3::new(t.x + d[0], t.y + d[1], t.z),
            nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), d[2]) * X_WO.rotation,
        );
        let mut bodies = vec![Body::new(object, &truth, q)];
        bodies.extend(clutter.iter().map(|(m, X)| Body::new(m, X, &vec![0.0; m.moving_joints().count()])));
        let bodies: Vec<&Body> = bodies.iter().collect();
        let target = [t.x, t.y, t.z + 0.1];
        let views: Vec<View> = eyes
            .iter()
            .enumerate()
            .map(|(i, eye)| {
                let X_WC = look(*eye, target);
                View::new(camera.image(&X_WC, &bodies, 0.0, seed * 10 + i as u64), X_WC)
            })
            .collect();
        let start = std::time::Instant::now();
        let answer = locate(&views, 0.0, &Request::near("object", object, *X_WO, q.to_vec()));
        e.seconds += start.elapsed().as_secs_f64() / count as f64;
        match answer {
            Ok(located) => {
                let (shift, turn) = difference(&located, &truth);
                e.nees.push(nees(&located, &truth));
                if shift > 0.01 || turn > 0.03 {
                    e.worst += &format!(
                        "\nseed {seed} moved {d:.3?}: off {shift:.4} m {turn:.4} rad: {:?}",
                        (
                            located.pixels,
                            located.inlier_share,
                            located.violated_share,
                            located.visible_share,
                            located.rivals,
                            located.residual_rms,
                            located.covariance.diagonal().map(f64::sqrt)
                        )
                    );
                }
                e.shift.push(shift);
                e.turn.push(turn);
            }
            Err(error) => {
                e.failed += 1;
                e.worst += &format!("\nseed {seed} moved {d:.3?}: {error}");
            }
        }
    }
    e
}

fn difference(located: &Located, truth: &Isometry3<f64>) -> (f64, f64) {
    ((located.X_WO.translation.vector - truth.translation.vector).norm(), located.X_WO.rotation.angle_to(&truth.rotation))
}

/// Normalised error squared over x, y and yaw; its mean is 3 where the covariance is right.
fn nees(located: &Located, truth: &Isometry3<f64>) -> f64 {
    let turn = (located.X_WO.rotation * truth.rotation.inverse()).scaled_axis();
    let shift = located.X_WO.translation.vector - truth.translation.vector;
    let pick = [2, 3, 4];
    let all = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
    let e = nalgebra::Vector3::from_fn(|i, _| all[pick[i]]);
    let C = nalgebra::Matrix3::from_fn(|i, j| located.covariance[(pick[i], pick[j])]);
    (e.transpose() * C.try_inverse().unwrap() * e)[0]
}

fn report(what: &str, e: &Errors) -> String {
    format!(
        "{what}: shift {} mm, turn {} mrad, normalised squared error median {:.2} 90 % {:.2} (right: 2.4, 6.3), {} failed, {:.2} s each{}",
        distribution(&e.shift),
        distribution(&e.turn),
        quantile(&e.nees, 0.5),
        quantile(&e.nees, 0.9),
        e.failed,
        e.seconds,
        e.worst
    )
}

#[test]
fn a_plain_box_is_found() {
    let object = model("<robot name='box'><link name='box'><visual><geometry><box size='0.2 0.3 0.2'/></geometry></visual></link></robot>");
    let e = trial(&object, &yawed(0.6, 0.0, 0.1, 0.3), &[], &[[0.1, 0.1, 0.6]], &[], 20);
    println!("{}", report("box", &e));
}

#[test]
fn an_oven_is_found_to_millimetres() {
    let (oven, mug) = (oven(), mug());
    let e = trial(
        &oven,
        &yawed(0.75, 0.1, 0.0, 0.0),
        &[0.0],
        &[[0.15, 0.3, 0.55], [0.1, -0.2, 0.5]],
        &[(&mug, yawed(0.45, -0.25, 0.0, 1.0))],
        20,
    );
    println!("{}", report("oven, two views", &e));
    let e = trial(&oven, &yawed(0.75, 0.1, 0.0, 0.0), &[0.0], &[[0.05, 0.0, 0.55]], &[], 20);
    println!("{}", report("oven, one view", &e));
}

#[test]
fn a_mug_is_found_to_millimetres() {
    let mug = mug();
    let e = trial(&mug, &yawed(0.5, -0.2, 0.0, 2.0), &[], &[[0.2, 0.0, 0.5], [0.25, -0.35, 0.45]], &[], 20);
    println!("{}", report("mug, two views", &e));
    let e = trial(&mug, &yawed(0.5, -0.2, 0.0, -0.2), &[], &[[0.1, 0.0, 0.5]], &[], 20);
    println!("{}", report("mug, handle hidden", &e));
}

#[test]
fn a_cabinet_and_a_roll_of_tape_are_found() {
    let (cabinet, tape) = (cabinet(), tape());
    let e = trial(&cabinet, &yawed(0.7, 0.0, 0.0, 0.1), &[0.0], &[[0.1, 0.3, 0.5], [0.1, -0.2, 0.5]], &[], 20);
    println!("{}", report("cabinet", &e));
    let e = trial(&tape, &yawed(0.5, 0.0, 0.0, 0.1), &[], &[[0.2, 0.2, 0.4]], &[], 20);
    println!("{}", report("tape", &e));
}
