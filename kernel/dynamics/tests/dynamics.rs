//! The algorithms against one another, and against what must be conserved.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{largest, menagerie, panda, random, random_state, random_vector, welded};
use nalgebra::{DVector, Matrix6xX, Point3, Vector3};
use sagci_dynamics::{ExternalWrench, Multibody, Part, cross_force, cross_motion, wrench_at_origin};

#[test]
fn forward_dynamics_undoes_inverse_dynamics() {
    for followers in [false, true] {
        let model = menagerie(followers);
        let parts = [welded(&model), Part { name: "free".into(), model: &model, base: sagci_dynamics::Base::Floating }];
        let mut multibody = Multibody::new(&parts).unwrap();
        multibody.armature_mut().fill(0.02);
        let mut ws = multibody.workspace();
        let mut rng = random(11);
        for _ in 0..20 {
            let (q, v) = random_state(&multibody, &mut rng);
            let a = random_vector(multibody.nv(), 3.0, &mut rng);
            let wrench = wrench_at_origin(&Vector3::new(1.0, -2.0, 3.0), &Vector3::new(0.3, 0.2, 0.1), &Point3::new(0.2, 0.4, -0.3));
            let external = [
                ExternalWrench { link: multibody.link("free/e").unwrap(), F_W: wrench },
                ExternalWrench { link: multibody.link("menagerie/h").unwrap(), F_W: -wrench },
            ];
            multibody.set_state(&mut ws, &q, &v).unwrap();
            let (mut tau, mut back) = (vec![0.0; multibody.nv()], vec![0.0; multibody.nv()]);
            multibody.inverse_dynamics(&mut ws, &a, &external, &mut tau).unwrap();
            multibody.forward_dynamics(&mut ws, &tau, &external, &mut back).unwrap();
            assert!(largest(&a, &back) < 1e-9, "followers {followers}: {:e}", largest(&a, &back));
            // tau = M a + bias - J^T F
            let mut sum = vec![0.0; multibody.nv()];
            multibody.bias_efforts(&mut ws, &mut sum).unwrap();
            let Ma = multibody.mass_matrix(&mut ws).unwrap() * DVector::from_column_slice(&a);
            let mut J = Matrix6xX::zeros(multibody.nv());
            for w in &external {
                let X_LW = multibody.X_WL(&ws, w.link).inverse();
                multibody.jacobian(&ws, w.link, &(X_LW * Point3::origin()), &mut J).unwrap();
                for (s, f) in sum.iter_mut().zip((J.transpose() * w.F_W).iter()) {
                    *s -= f;
                }
            }
            for (s, x) in sum.iter_mut().zip(Ma.iter()) {
                *s += x;
            }
            assert!(largest(&sum, &tau) < 1e-9, "{:e}", largest(&sum, &tau));
        }
    }
}

#[test]
fn articulated_bodies_agree_with_the_mass_matrix() {
    let multibody = Multibody::new(&[Part::floating(&menagerie(false))]).unwrap();
    let mut ws = multibody.workspace();
    let mut rng = random(12);
    for _ in 0..20 {
        let (q, v) = random_state(&multibody, &mut rng);
        let tau = random_vector(multibody.nv(), 5.0, &mut rng);
        multibody.set_state(&mut ws, &q, &v).unwrap();
        let mut a = vec![0.0; multibody.nv()];
        multibody.forward_dynamics(&mut ws, &tau, &[], &mut a).unwrap();
        let mut bias = vec![0.0; multibody.nv()];
        multibody.bias_efforts(&mut ws, &mut bias).unwrap();
        let mut x: Vec<f64> = tau.iter().zip(&bias).map(|(t, b)| t - b).collect();
        multibody.factor_mass_matrix(&mut ws).unwrap();
        multibody.solve_mass_matrix(&ws, &mut x).unwrap();
        assert!(largest(&a, &x) < 1e-9, "{:e}", largest(&a, &x));
    }
}

#[test]
fn mass_matrix_gives_the_kinetic_energy() {
    for followers in [false, true] {
        let mut multibody = Multibody::new(&[welded(&menagerie(followers))]).unwrap();
        multibody.armature_mut().fill(0.03);
        let mut ws = multibody.workspace();
        let (q, v) = random_state(&multibody, &mut random(13));
        multibody.set_state(&mut ws, &q, &v).unwrap();
        let energy = multibody.kinetic_energy(&ws);
        let v = DVector::from_vec(v);
        let M = multibody.mass_matrix(&mut ws).unwrap();
        assert!((0.5 * v.dot(&(M * &v)) - energy).abs() < 1e-12 * energy);
        assert!((M - M.transpose()).amax() == 0.0, "the mass matrix must be symmetric to the bit");
    }
}

#[test]
fn gravity_is_the_gradient_of_the_potential_energy() {
    for followers in [false, true] {
        let mut multibody = Multibody::new(&[welded(&menagerie(followers))]).unwrap();
        multibody.set_gravity(Vector3::new(1.0, -2.0, -9.0));
        let mut ws = multibody.workspace();
        let (q, _) = random_state(&multibody, &mut random(14));
        multibody.set_positions(&mut ws, &q).unwrap();
        let mut g = vec![0.0; multibody.nv()];
        multibody.gravity_efforts(&mut ws, &mut g).unwrap();
        for i in 0..multibody.nv() {
            let mut e = vec![0.0; multibody.nv()];
            e[i] = 1.0;
            let mut energy = |h: f64| {
                let mut q = q.clone();
                multibody.integrate(&mut q, &e, h).unwrap();
                multibody.set_positions(&mut ws, &q).unwrap();
                multibody.potential_energy(&ws)
            };
            let slope = (energy(1e-5) - energy(-1e-5)) / 2e-5;
            assert!((slope - g[i]).abs() < 1e-8, "{i}: {slope} {}", g[i]);
        }
    }
}

#[test]
fn energy_changes_by_the_power_put_in() {
    // d/dt (T + U) = tau . v holds only if Coriolis forces do no work, for every kind of joint and for followers.
    for followers in [false, true] {
        let multibody = Multibody::new(&[Part::floating(&menagerie(followers))]).unwrap();
        let mut ws = multibody.workspace();
        let mut rng = random(15);
        let (q, v) = random_state(&multibody, &mut rng);
        let tau = random_vector(multibody.nv(), 2.0, &mut rng);
        multibody.set_state(&mut ws, &q, &v).unwrap();
        let mut a = vec![0.0; multibody.nv()];
        multibody.forward_dynamics(&mut ws, &tau, &[], &mut a).unwrap();
        let mut energy = |h: f64| {
            let mut q = q.clone();
            // Second order: half of the change of velocity counts on the way.
            let v_mid: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + 0.5 * h * a).collect();
            let v_end: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + h * a).collect();
            multibody.integrate(&mut q, &v_mid, h).unwrap();
            multibody.set_state(&mut ws, &q, &v_end).unwrap();
            multibody.kinetic_energy(&ws) + multibody.potential_energy(&ws)
        };
        let rate = (energy(1e-6) - energy(-1e-6)) / 2e-6;
        let power: f64 = tau.iter().zip(&v).map(|(t, v)| t * v).sum();
        assert!((rate - power).abs() < 1e-6, "{rate} {power}");
    }
}

#[test]
fn a_free_tree_falls_as_its_centre_of_mass() {
    let multibody = Multibody::new(&[Part::floating(&menagerie(false))]).unwrap();
    let mut ws = multibody.workspace();
    let mut rng = random(16);
    let (q, v) = random_state(&multibody, &mut rng);
    multibody.set_state(&mut ws, &q, &v).unwrap();
    // Efforts inside the tree change neither its momentum nor its turning; gravity adds m g.
    let mut tau = random_vector(multibody.nv(), 2.0, &mut rng);
    tau[..6].fill(0.0);
    let mut a = vec![0.0; multibody.nv()];
    multibody.forward_dynamics(&mut ws, &tau, &[], &mut a).unwrap();
    let mut momentum = |h: f64| {
        let mut q = q.clone();
        let v_mid: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + 0.5 * h * a).collect();
        let v_end: Vec<f64> = v.iter().zip(&a).map(|(v, a)| v + h * a).collect();
        multibody.integrate(&mut q, &v_mid, h).unwrap();
        multibody.set_state(&mut ws, &q, &v_end).unwrap();
        multibody.momentum(&ws)
    };
    let (after, before) = (momentum(1e-5), momentum(-1e-5));
    let linear = (after.linear - before.linear) / 2e-5;
    let angular = (after.angular - before.angular) / 2e-5;
    assert!((linear - multibody.gravity() * after.mass).norm() < 1e-6, "{linear}");
    assert!(angular.norm() < 1e-6, "{angular}");
    let speed = (after.center - before.center) / 2e-5;
    assert!((speed * after.mass - 0.5 * (after.linear + before.linear)).norm() < 1e-6);
}

#[test]
fn spatial_cross_products_are_dual() {
    let mut rng = random(17);
    let vector = |rng: &mut _| nalgebra::Vector6::from_column_slice(&random_vector(6, 1.0, rng));
    let (V, W, F) = (vector(&mut rng), vector(&mut rng), vector(&mut rng));
    // (V x W) . F = - W . (V x* F)
    assert!((cross_motion(&V, &W).dot(&F) + W.dot(&cross_force(&V, &F))).abs() < 1e-14);
}

#[test]
fn a_payload_weighs_on_the_joints_as_the_body_itself_would() {
    // A brick welded to the hand, against the same inertia added to the hand.
    let (arm, brick) = (panda(), common::brick([0.02, 0.001, 0.002, 0.03, 0.003, 0.025]));
    let X_LO = nalgebra::Isometry3::new(Vector3::new(0.02, -0.01, 0.15), Vector3::new(0.4, 0.2, -0.1));
    let held = Part { name: "held".into(), model: &brick, base: sagci_dynamics::Base::Held { part: 0, link: "panda_hand".into(), X_LO } };
    let whole = Multibody::new(&[welded(&arm), held]).unwrap();
    let mut loaded = Multibody::new(&[welded(&arm)]).unwrap();
    let hand = loaded.link("panda_hand").unwrap();
    let own = sagci_dynamics::SpatialInertia::from(&brick.links[0].inertial);
    let more = own.moved(&X_LO.rotation.to_rotation_matrix().into_inner(), &X_LO.translation.vector);
    let inertia = loaded.body_inertia(hand) + more;
    loaded.set_body_inertia(hand, &inertia);
    let mut rng = random(18);
    let (q, v) = random_state(&whole, &mut rng);
    let a = random_vector(9, 2.0, &mut rng);
    let efforts = |multibody: &Multibody| {
        let mut ws = multibody.workspace();
        multibody.set_state(&mut ws, &q, &v).unwrap();
        let mut tau = vec![0.0; 9];
        multibody.inverse_dynamics(&mut ws, &a, &[], &mut tau).unwrap();
        tau
    };
    assert!(largest(&efforts(&whole), &efforts(&loaded)) < 1e-11);
}
