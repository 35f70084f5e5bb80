//! Against Pinocchio's figures on the arm that ships (made by `tests/peers/pinocchio_reference.py`).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use nalgebra::{Isometry3, Matrix6xX, Point3, Vector3};
use sagci_dynamics::Multibody;
use serde::Deserialize;

#[derive(Deserialize)]
struct Reference {
    frame: String,
    gravity: [f64; 3],
    joints: Vec<String>,
    states: Vec<State>,
}

#[derive(Deserialize)]
struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    tau: Vec<f64>,
    inverse: Vec<f64>,
    forward: Vec<f64>,
    gravity: Vec<f64>,
    mass: Vec<f64>,
    jacobian: Vec<f64>,
}

/// Greatest difference, entry by entry, each over that entry's greatest magnitude at any state: a small entry, like the
/// effort of a finger, is held as tightly as a large one.
fn relative(pairs: &[(Vec<f64>, Vec<f64>)]) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..pairs[0].1.len() {
        let scale = pairs.iter().fold(1e-4, |m: f64, (_, theirs)| m.max(theirs[i].abs()));
        for (ours, theirs) in pairs {
            worst = worst.max((ours[i] - theirs[i]).abs() / scale);
        }
    }
    worst
}

#[test]
fn panda_agrees_with_pinocchio_at_200_states() {
    let path = common::root().join("tests/peers/panda_pinocchio.json");
    let reference: Reference = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let model = common::panda();
    let mut multibody = Multibody::welded(&model, Isometry3::identity()).unwrap();
    multibody.set_gravity(Vector3::from(reference.gravity));
    let n = multibody.nv();
    let at: Vec<usize> = reference.joints.iter().map(|j| multibody.velocity_index(j).unwrap()).collect();
    assert_eq!(at.len(), n);
    assert!(reference.states.len() >= 200);
    // Their order to ours.
    let ours = |theirs: &[f64]| {
        let mut x = vec![0.0; n];
        for (&i, &value) in at.iter().zip(theirs) {
            x[i] = value;
        }
        x
    };
    let link = multibody.link(&reference.frame).unwrap();
    let mut ws = multibody.workspace();
    let mut pairs: [Vec<(Vec<f64>, Vec<f64>)>; 6] = Default::default();
    for state in &reference.states {
        multibody.set_state(&mut ws, &ours(&state.q), &ours(&state.v)).unwrap();
        let mut x = vec![0.0; n];
        multibody.inverse_dynamics(&mut ws, &ours(&state.a), &[], &mut x).unwrap();
        pairs[0].push((x.clone(), ours(&state.inverse)));
        multibody.forward_dynamics(&mut ws, &ours(&state.tau), &[], &mut x).unwrap();
        pairs[1].push((x.clone(), ours(&state.forward)));
        multibody.gravity_efforts(&mut ws, &mut x).unwrap();
        pairs[2].push((x.clone(), ours(&state.gravity)));
        let M = multibody.mass_matrix(&mut ws).unwrap();
        let mut upper = Vec::new();
        for i in 0..n {
            for j in i..n {
                upper.push(M[(at[i], at[j])]);
            }
        }
        pairs[3].push((upper.clone(), state.mass.clone()));
        let mut J = Matrix6xX::zeros(n);
        multibody.jacobian(&ws, link, &Point3::origin(), &mut J).unwrap();
        let rows: Vec<f64> = (0..6).flat_map(|r| at.iter().map(move |&c| (r, c))).map(|(r, c)| J[(r, c)]).collect();
        pairs[4].push((rows.clone(), state.jacobian.clone()));
        // The mass matrix's way to the same accelerations.
        multibody.bias_efforts(&mut ws, &mut x).unwrap();
        let mut a: Vec<f64> = ours(&state.tau).iter().zip(&x).map(|(t, b)| t - b).collect();
        multibody.factor_mass_matrix(&mut ws).unwrap();
        multibody.solve_mass_matrix(&ws, &mut a).unwrap();
        pairs[5].push((a.clone(), ours(&state.forward)));
    }
    let what = ["inverse dynamics", "forward dynamics", "gravity", "mass matrix", "Jacobian", "forward dynamics by the mass matrix"];
    for (what, pairs) in what.iter().zip(&pairs) {
        let worst = relative(pairs);
        println!("{what}: {worst:.1e}");
        assert!(worst < 1e-9, "{what}: {worst:.1e}. If the arm's model has changed, make the reference anew");
    }
}
