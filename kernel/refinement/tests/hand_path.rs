//! Joints read off noisy paths of a hand, against the truth.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::JointKind;
use sagci_refinement::{HandPath, HandPathError, JointEstimate, StoredAxis, axis_gap, joint_from_hand_path};

struct Random(Pcg64);

impl Random {
    fn new(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }
    fn normal(&mut self) -> f64 {
        let (a, b): (f64, f64) = (self.0.random(), self.0.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
    fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()) * size
    }
}

/// Errors of the hand against the handle: independent ones, and a first-order autoregressive process whose memory is
/// `memory` poses.
struct Errors {
    place: f64,
    turn: f64,
    memory: f64,
}

fn noisy(true_path: &[Isometry3<f64>], e: &Errors, random: &mut Random) -> Vec<Isometry3<f64>> {
    let keep = (-1.0 / e.memory).exp();
    let (mut place, mut turn) = (random.vector(e.place), random.vector(e.turn));
    true_path
        .iter()
        .map(|X| {
            let fresh = (1.0 - keep * keep).sqrt();
            place = place * keep + random.vector(e.place) * fresh;
            turn = turn * keep + random.vector(e.turn) * fresh;
            Isometry3::from_parts(Translation3::from(X.translation.vector + place), UnitQuaternion::from_scaled_axis(turn) * X.rotation)
        })
        .collect()
}

fn hinge(random: &mut Random) -> StoredAxis {
    let axis_W = Unit::new_normalize(Vector3::z() + random.vector(0.3));
    StoredAxis { kind: JointKind::Revolute, axis_W, origin_W: Point3::new(0.7, 0.3, 0.2) }
}

/// A handle 0.45 m from the hinge, turned by `angle`.
fn arc(hinge: &StoredAxis, angle: f64, count: usize, random: &mut Random) -> Vec<Isometry3<f64>> {
    let out = hinge.axis_W.cross(&random.vector(1.0)).normalize() * 0.45;
    let start =
        Isometry3::from_parts(Translation3::from(hinge.origin_W.coords + out), UnitQuaternion::from_scaled_axis(random.vector(1.0)));
    (0..count)
        .map(|i| {
            let q = angle * i as f64 / (count - 1) as f64;
            let R = UnitQuaternion::from_axis_angle(&hinge.axis_W, q);
            Isometry3::from_parts(Translation3::from(hinge.origin_W.coords + R * out), R * start.rotation)
        })
        .collect()
}

fn line(axis: &Unit<Vector3<f64>>, length: f64, count: usize, random: &mut Random) -> Vec<Isometry3<f64>> {
    let rotation = UnitQuaternion::from_scaled_axis(random.vector(1.0));
    (0..count)
        .map(|i| {
            Isometry3::from_parts(
                Translation3::from(Vector3::new(0.5, 0.0, 0.3) + axis.into_inner() * (length * i as f64 / (count - 1) as f64)),
                rotation,
            )
        })
        .collect()
}

const REALISTIC: Errors = Errors { place: 0.002, turn: 0.02, memory: 150.0 };

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn a_perfect_arc_gives_back_its_hinge() {
    let mut random = Random::new(1);
    let truth = hinge(&mut random);
    let path = arc(&truth, 1.2, 400, &mut random);
    let e = joint_from_hand_path(&HandPath::firm(&path)).unwrap();
    let gap = axis_gap(&truth, &e);
    assert!(gap.same_kind && gap.angle < 1e-7 && gap.distance.unwrap() < 1e-7, "{gap:?}");
    assert!((e.motion() - 1.2).abs() < 1e-7 && e.probability > 0.999, "{e:?}");
    assert!(e.axis_W.dot(&truth.axis_W) > 0.0, "motion along the path is positive");
}

#[test]
fn a_perfect_line_gives_back_its_direction() {
    let mut random = Random::new(2);
    let axis = Unit::new_normalize(random.vector(1.0));
    let path = line(&axis, 0.2, 300, &mut random);
    let e = joint_from_hand_path(&HandPath::firm(&path)).unwrap();
    assert_eq!(e.kind, JointKind::Prismatic);
    assert!(e.axis_W.angle(&axis) < 1e-7 && (e.motion() - 0.2).abs() < 1e-9 && e.probability > 0.999, "{e:?}");
}

/// Normalised squared error of the axis and the origin together: 4 degrees of freedom.
fn squared_error(truth: &StoredAxis, e: &JointEstimate) -> f64 {
    let b = e.axis_W.into_inner();
    let d = truth.axis_W.into_inner() - b * truth.axis_W.dot(&b);
    let p = e.origin_W - truth.origin_W;
    let p = p - truth.axis_W.into_inner() * truth.axis_W.dot(&p);
    let inverse = |C: &nalgebra::Matrix3<f64>| C.pseudo_inverse(C.norm() * 1e-6).unwrap();
    ((d.transpose() * inverse(&e.axis_covariance) * d)[0] + (p.transpose() * inverse(&e.origin_covariance) * p)[0]) / 2.0
}

#[test]
fn hinges_are_told_from_slides_and_measured_with_an_honest_deviation_after_twenty_degrees() {
    let (mut angles, mut distances, mut squares, mut wrong) = (vec![], vec![], vec![], 0);
    for seed in 0..60 {
        let mut random = Random::new(seed);
        let truth = hinge(&mut random);
        let path = noisy(&arc(&truth, 20f64.to_radians(), 2000, &mut random), &REALISTIC, &mut random);
        let e = joint_from_hand_path(&HandPath::firm(&path)).unwrap();
        if e.kind != JointKind::Revolute {
            wrong += 1;
            continue;
        }
        let gap = axis_gap(&truth, &e);
        angles.push(gap.angle.to_degrees());
        distances.push(gap.distance.unwrap());
        squares.push(squared_error(&truth, &e));
    }
    let (angle, distance, square) = (median(&mut angles), median(&mut distances), median(&mut squares));
    let figures = format!(
        "median axis {angle:.2} deg, place {:.1} mm, normalised squared error {square:.2} (right: about 1.7), {wrong} of 60 of the wrong kind",
        distance * 1e3
    );
    println!("{figures}");
    // Errors that last for 150 of 2000 poses leave about seven independent looks at 20 degrees of arc.
    assert!(wrong == 0 && angle < 4.5 && distance < 0.035, "{figures}");
    assert!((0.4..5.0).contains(&square), "the covariance does not tell the error: {figures}");
}

#[test]
fn slides_are_told_from_hinges_after_ten_centimetres() {
    let (mut angles, mut wrong) = (vec![], 0);
    for seed in 100..160 {
        let mut random = Random::new(seed);
        let axis = Unit::new_normalize(random.vector(1.0));
        let path = noisy(&line(&axis, 0.1, 2000, &mut random), &REALISTIC, &mut random);
        let e = joint_from_hand_path(&HandPath::firm(&path)).unwrap();
        if e.kind != JointKind::Prismatic {
            wrong += 1;
            continue;
        }
        angles.push(e.axis_W.angle(&axis).to_degrees());
    }
    let angle = median(&mut angles);
    let figures = format!("median axis {angle:.2} deg, {wrong} of 60 of the wrong kind");
    println!("{figures}");
    assert!(wrong <= 2 && angle < 2.5, "{figures}");
}

#[test]
fn a_grip_that_turns_on_the_handle_does_not_hide_the_hinge() {
    // The hand keeps its direction while an upright door handle turns in it: only its places tell the hinge.
    let mut wrong = 0;
    let mut distances = vec![];
    for seed in 0..30 {
        let mut random = Random::new(seed);
        let truth = StoredAxis { kind: JointKind::Revolute, axis_W: Vector3::z_axis(), origin_W: Point3::new(0.7, 0.3, 0.2) };
        let mut path = arc(&truth, 1.0, 1500, &mut random);
        let held = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1.57);
        path.iter_mut().for_each(|X| X.rotation = held);
        let slip_T = Unit::new_normalize(held.inverse() * Vector3::z());
        let path = noisy(&path, &REALISTIC, &mut random);
        let e = joint_from_hand_path(&HandPath { slip: Some((slip_T, 1.0)), ..HandPath::firm(&path) }).unwrap();
        let gap = axis_gap(&truth, &e);
        if !gap.same_kind {
            wrong += 1;
            continue;
        }
        distances.push(gap.distance.unwrap());
    }
    let distance = median(&mut distances);
    assert!(wrong == 0 && distance < 0.03, "{wrong} of 30 of the wrong kind, place {distance:.4} m");
}

#[test]
fn the_gap_of_a_shifted_and_tilted_axis_is_found() {
    let mut random = Random::new(9);
    let truth = StoredAxis { kind: JointKind::Revolute, axis_W: Vector3::z_axis(), origin_W: Point3::new(0.7, 0.3, 0.2) };
    let path = noisy(&arc(&truth, 1.2, 3000, &mut random), &REALISTIC, &mut random);
    let e = joint_from_hand_path(&HandPath::firm(&path)).unwrap();
    let tilt = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.05);
    let stored =
        StoredAxis { kind: JointKind::Revolute, axis_W: tilt * truth.axis_W, origin_W: truth.origin_W + Vector3::new(0.0, 0.02, 0.0) };
    let gap = axis_gap(&stored, &e);
    assert!((gap.angle - 0.05).abs() < 3.0 * gap.angle_deviation.max(0.002), "{gap:?}");
    assert!((gap.distance.unwrap() - 0.02).abs() < 3.0 * gap.distance_deviation.unwrap().max(0.001), "{gap:?}");
    assert!(gap.angle > 3.0 * gap.angle_deviation, "a gap of 3 degrees does not stand out: {gap:?}");
}

#[test]
fn paths_that_say_nothing_are_refused() {
    let mut random = Random::new(4);
    let still = noisy(&vec![Isometry3::identity(); 500], &Errors { place: 0.001, turn: 0.01, memory: 50.0 }, &mut random);
    assert!(matches!(joint_from_hand_path(&HandPath::firm(&still)), Err(HandPathError::TooShort { .. })));
    assert!(matches!(joint_from_hand_path(&HandPath::firm(&still[..3])), Err(HandPathError::Bad(_))));
    let mut broken = still.clone();
    broken[7].translation.x = f64::NAN;
    assert!(matches!(joint_from_hand_path(&HandPath::firm(&broken)), Err(HandPathError::Bad(_))));
    assert!(matches!(joint_from_hand_path(&HandPath { position_deviation: 0.0, ..HandPath::firm(&still) }), Err(HandPathError::Bad(_))));
}
