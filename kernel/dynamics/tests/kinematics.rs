//! Poses, Jacobians and the tree's shape.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{joint, largest, link, menagerie, model, panda, random, random_state, random_vector, welded};
use nalgebra::{Isometry3, Matrix6xX, Point3, Translation3, UnitQuaternion, Vector3};
use sagci_dynamics::{Base, DynamicsError, Multibody, Part};

/// Spatial velocity of a point by moving the state on and back.
fn moved(multibody: &Multibody, q: &[f64], v: &[f64], link: &str, p: &Point3<f64>, h: f64) -> (Isometry3<f64>, Point3<f64>) {
    let mut ws = multibody.workspace();
    let mut q = q.to_vec();
    multibody.integrate(&mut q, v, h).unwrap();
    multibody.set_positions(&mut ws, &q).unwrap();
    let X = multibody.X_WL(&ws, multibody.link(link).unwrap());
    (X, X * p)
}

#[test]
fn jacobian_and_velocity_are_the_rate_of_the_pose() {
    for (followers, seed) in [(false, 1), (true, 2)] {
        let multibody = Multibody::new(&[welded(&menagerie(followers))]).unwrap();
        let mut ws = multibody.workspace();
        let mut rng = random(seed);
        let p = Point3::new(0.1, -0.3, 0.2);
        for link in ["c", "e", "f", "g", "h"] {
            let (q, v) = random_state(&multibody, &mut rng);
            multibody.set_state(&mut ws, &q, &v).unwrap();
            let id = multibody.link(link).unwrap();
            let mut J = Matrix6xX::zeros(multibody.nv());
            multibody.jacobian(&ws, id, &p, &mut J).unwrap();
            let V = &J * nalgebra::DVector::from_column_slice(&v);
            let h = 1e-5;
            let ((X1, p1), (X0, p0)) = (moved(&multibody, &q, &v, link, &p, h), moved(&multibody, &q, &v, link, &p, -h));
            let omega = (X1.rotation * X0.rotation.inverse()).scaled_axis() / (2.0 * h);
            let rate = (p1 - p0) / (2.0 * h);
            assert!((omega - V.fixed_rows::<3>(0)).norm() < 1e-8, "{link}: {omega} {V}");
            assert!((rate - V.fixed_rows::<3>(3)).norm() < 1e-8, "{link}: {rate} {V}");
            // The link's own velocity is that of its origin.
            multibody.jacobian(&ws, id, &Point3::origin(), &mut J).unwrap();
            let V = &J * nalgebra::DVector::from_column_slice(&v);
            assert!((multibody.V_WL(&ws, id) - V).norm() < 1e-12);
        }
    }
}

#[test]
fn bias_acceleration_is_the_rate_of_the_velocity_at_constant_v() {
    let multibody = Multibody::new(&[welded(&menagerie(true))]).unwrap();
    let mut ws = multibody.workspace();
    let mut rng = random(3);
    let p = Point3::new(-0.2, 0.1, 0.3);
    for link in ["c", "g", "h"] {
        let (q, v) = random_state(&multibody, &mut rng);
        let id = multibody.link(link).unwrap();
        let mut velocity = |h: f64| {
            let mut q = q.clone();
            multibody.integrate(&mut q, &v, h).unwrap();
            multibody.set_state(&mut ws, &q, &v).unwrap();
            let mut J = Matrix6xX::zeros(multibody.nv());
            multibody.jacobian(&ws, id, &p, &mut J).unwrap();
            &J * nalgebra::DVector::from_column_slice(&v)
        };
        let expected = (velocity(1e-5) - velocity(-1e-5)) / 2e-5;
        multibody.set_state(&mut ws, &q, &v).unwrap();
        let A = multibody.bias_acceleration(&ws, id, &p).unwrap();
        assert!((A - expected).norm() < 1e-7, "{link}");
    }
}

#[test]
fn links_lie_where_the_model_puts_them() {
    let model = panda();
    let X_WO = Isometry3::from_parts(Translation3::new(0.3, -0.2, 0.7), UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3));
    let multibody = Multibody::welded(&model, X_WO).unwrap();
    let mut ws = multibody.workspace();
    let q = random_vector(multibody.nq(), 1.0, &mut random(4));
    multibody.set_positions(&mut ws, &q).unwrap();
    for ((id, _, name), X_OL) in multibody.links().zip(model.X_OL(&q)) {
        let difference = multibody.X_WL(&ws, id).inverse() * (X_WO * X_OL);
        assert!(difference.translation.vector.norm() < 1e-12 && difference.rotation.angle() < 1e-7, "{name}");
    }
    // Seven joints and two fingers, in the model's order.
    assert_eq!((multibody.nq(), multibody.nv()), (9, 9));
    assert_eq!(multibody.velocity_index("panda_joint4").unwrap(), 3);
    assert_eq!(multibody.velocity_index("panda_finger_joint2").unwrap(), 8);
    assert_eq!(multibody.velocity_index("panda/panda_finger_joint2").unwrap(), 8);
}

#[test]
fn integrate_and_difference_undo_each_other() {
    let multibody = Multibody::new(&[welded(&menagerie(false))]).unwrap();
    let mut rng = random(5);
    for size in [1e-9, 1e-6, 1e-5, 1e-3, 0.1, 1.0] {
        let (q, _) = random_state(&multibody, &mut rng);
        let step = random_vector(multibody.nv(), size, &mut rng);
        let mut to = q.clone();
        multibody.integrate(&mut to, &step, 1.0).unwrap();
        let mut back = vec![0.0; multibody.nv()];
        multibody.difference(&q, &to, &mut back).unwrap();
        assert!(largest(&step, &back) < 1e-12 + 1e-9 * size, "{size}: {:e}", largest(&step, &back));
    }
}

#[test]
fn integrating_in_two_halves_equals_one_whole() {
    let multibody = Multibody::new(&[welded(&menagerie(false))]).unwrap();
    let mut rng = random(6);
    let (q, v) = random_state(&multibody, &mut rng);
    let (mut whole, mut halves) = (q.clone(), q);
    multibody.integrate(&mut whole, &v, 0.8).unwrap();
    multibody.integrate(&mut halves, &v, 0.3).unwrap();
    multibody.integrate(&mut halves, &v, 0.5).unwrap();
    assert!(largest(&whole, &halves) < 1e-12);
}

#[test]
fn planar_joint_slides_along_its_own_axes() {
    let urdf = link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &link("puck", 1.0, [0.0; 3], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
        + &joint("plane", "planar", "base", "puck", [0.0, 0.0, 1.0], [0.0; 6], "");
    let multibody = Multibody::new(&[welded(&model("puck", &urdf))]).unwrap();
    let mut ws = multibody.workspace();
    multibody.set_state(&mut ws, &[1.0, 2.0, std::f64::consts::FRAC_PI_2], &[3.0, 0.0, 0.5]).unwrap();
    let puck = multibody.link("puck").unwrap();
    assert!((multibody.X_WL(&ws, puck).translation.vector - Vector3::new(1.0, 2.0, 0.0)).norm() < 1e-14);
    let V = multibody.V_WL(&ws, puck);
    // Turned by 90 degrees, its own x axis is the world's y axis.
    assert!((V - nalgebra::Vector6::new(0.0, 0.0, 0.5, 0.0, 3.0, 0.0)).norm() < 1e-14, "{V}");
}

#[test]
fn merging_fixed_joints_changes_nothing() {
    // The same bodies, once with the two behind the fixed joints lumped by hand through a joint that is held still.
    let body = |n: &str, k: f64| link(n, 1.0 + k, [0.1, 0.2 * k, -0.1], [0.05, 0.001, 0.002, 0.04, -0.001, 0.03 + 0.01 * k]);
    let tree = |kind: &str| {
        let limits = if kind == "fixed" { "" } else { common::WIDE };
        let urdf = body("w", 0.0)
            + &body("a", 1.0)
            + &body("b", 0.5)
            + &body("c", 0.2)
            + &body("d", 0.7)
            + &joint("j1", "revolute", "w", "a", [0.0, 0.6, 0.8], [0.1, 0.2, 0.3, 0.1, 0.2, 0.3], common::WIDE)
            + &joint("f1", kind, "a", "b", [1.0, 0.0, 0.0], [0.3, -0.1, 0.2, 0.5, -0.4, 0.3], limits)
            + &joint("f2", kind, "b", "c", [0.0, 1.0, 0.0], [-0.1, 0.2, 0.1, -0.2, 0.3, 0.6], limits)
            + &joint("j2", "revolute", "c", "d", [0.6, 0.8, 0.0], [0.1, 0.1, -0.2, 0.3, 0.1, -0.7], common::WIDE);
        Multibody::new(&[welded(&model("tree", &urdf))]).unwrap()
    };
    let (merged, whole) = (tree("fixed"), tree("revolute"));
    assert_eq!((merged.nv(), whole.nv()), (2, 4));
    let (i, j) = (whole.velocity_index("j1").unwrap(), whole.velocity_index("j2").unwrap());
    let mut rng = random(7);
    for _ in 0..10 {
        let (q, v, a) = (random_vector(2, 2.0, &mut rng), random_vector(2, 2.0, &mut rng), random_vector(2, 2.0, &mut rng));
        let spread = |x: &[f64]| {
            let mut all = vec![0.0; 4];
            all[i] = x[0];
            all[j] = x[1];
            all
        };
        let (mut ws, mut ws_whole) = (merged.workspace(), whole.workspace());
        merged.set_state(&mut ws, &q, &v).unwrap();
        whole.set_state(&mut ws_whole, &spread(&q), &spread(&v)).unwrap();
        let (mut tau, mut tau_whole) = (vec![0.0; 2], vec![0.0; 4]);
        merged.inverse_dynamics(&mut ws, &a, &[], &mut tau).unwrap();
        whole.inverse_dynamics(&mut ws_whole, &spread(&a), &[], &mut tau_whole).unwrap();
        assert!(largest(&tau, &[tau_whole[i], tau_whole[j]]) < 1e-12);
        for name in ["a", "b", "c", "d"] {
            let (X, Y) = (merged.X_WL(&ws, merged.link(name).unwrap()), whole.X_WL(&ws_whole, whole.link(name).unwrap()));
            assert!((X.to_homogeneous() - Y.to_homogeneous()).norm() < 1e-12, "{name}");
        }
    }
}

#[test]
fn parts_keep_their_names_apart_and_can_be_held() {
    let (arm, brick) = (panda(), common::brick([0.01, 0.0, 0.0, 0.01, 0.0, 0.01]));
    let X_LO = Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.12), UnitQuaternion::from_euler_angles(0.3, 0.0, 0.0));
    let held = Part { name: "held".into(), model: &brick, base: Base::Held { part: 0, link: "panda_hand".into(), X_LO } };
    let free = Part { name: "free".into(), model: &brick, base: Base::Floating };
    let multibody = Multibody::new(&[welded(&arm), held, free]).unwrap();
    assert_eq!((multibody.nq(), multibody.nv()), (16, 15));
    assert!(matches!(multibody.link("brick"), Err(DynamicsError::Unknown { .. })), "an ambiguous name must be refused");
    let mut ws = multibody.workspace();
    let (q, _) = random_state(&multibody, &mut random(8));
    multibody.set_positions(&mut ws, &q).unwrap();
    let (hand, brick_held) = (multibody.link("panda_hand").unwrap(), multibody.link("held/brick").unwrap());
    let difference = (multibody.X_WL(&ws, hand) * X_LO).inverse() * multibody.X_WL(&ws, brick_held);
    assert!(difference.translation.vector.norm() < 1e-12);
    let X = multibody.X_WL(&ws, multibody.link("free/brick").unwrap());
    assert!((X.translation.vector - Vector3::new(q[13], q[14], q[15])).norm() < 1e-12);
    assert!((multibody.momentum(&ws).mass - multibody_mass(&arm) - 4.0).abs() < 1e-12);
    // Two parts of one name cannot be told apart.
    let twice = Multibody::new(&[Part::floating(&brick), Part::floating(&brick)]);
    assert!(matches!(twice, Err(DynamicsError::Build { .. })));
}

/// Mass of what can move.
fn multibody_mass(model: &sagci_model::ObjectModel) -> f64 {
    model.links.iter().skip(1).map(|l| l.inertial.mass).sum()
}

#[test]
fn links_held_by_followers_move_by_the_multiple() {
    let multibody = Multibody::new(&[welded(&menagerie(true))]).unwrap();
    let free = Multibody::new(&[welded(&menagerie(false))]).unwrap();
    assert_eq!(free.nv() - multibody.nv(), 2);
    let mut rng = random(9);
    let (q, _) = random_state(&multibody, &mut rng);
    let mut all = vec![0.0; free.nq()];
    for joint in multibody.joints() {
        all[free.joint(&joint.name).unwrap().q.clone()].copy_from_slice(&q[joint.q.clone()]);
    }
    let of = |name: &str| q[multibody.joint(name).unwrap().q.start];
    all[free.joint("jg").unwrap().q.start] = -0.7 * of("ja") + 0.2;
    all[free.joint("jh").unwrap().q.start] = 1.5 * of("jb") - 0.1;
    let (mut ws, mut ws_free) = (multibody.workspace(), free.workspace());
    multibody.set_positions(&mut ws, &q).unwrap();
    free.set_positions(&mut ws_free, &all).unwrap();
    for name in ["g", "h"] {
        let (X, Y) = (multibody.X_WL(&ws, multibody.link(name).unwrap()), free.X_WL(&ws_free, free.link(name).unwrap()));
        assert!((X.to_homogeneous() - Y.to_homogeneous()).norm() < 1e-12, "{name}");
    }
}
