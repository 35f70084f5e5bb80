//! Against Pinocchio's figures for the arm and two objects that ship, and for a tree with every kind of joint (made by
//! `tests/peers/pinocchio_reference.py`, which says what stands in them).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Isometry3, Matrix6xX, Point3, Vector3};
use sagci_dynamics::{ForwardDynamicsDerivatives, InverseDynamicsDerivatives, Multibody};
use sagci_model::ObjectModel;
use serde::Deserialize;

#[derive(Deserialize)]
struct Reference {
    frame: String,
    gravity: [f64; 3],
    joints: Vec<String>,
    bodies: Vec<String>,
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
    products: BTreeMap<String, Vec<f64>>,
    #[serde(default)]
    matrices: BTreeMap<String, Vec<f64>>,
}

/// Greatest difference, entry by entry, each over that entry's greatest magnitude at any state: a small entry, like the
/// effort of a finger, is held as tightly as a large one. Entries that cancel to nothing are held to 1e-5 of the greatest.
fn relative(pairs: &[(Vec<f64>, Vec<f64>)]) -> f64 {
    let mut worst = 0.0_f64;
    let floor = pairs.iter().flat_map(|(_, theirs)| theirs).fold(1e-4, |m: f64, x| m.max(1e-5 * x.abs()));
    for i in 0..pairs[0].1.len() {
        let scale = pairs.iter().fold(floor, |m: f64, (_, theirs)| m.max(theirs[i].abs()));
        for (ours, theirs) in pairs {
            assert_eq!(ours.len(), theirs.len());
            worst = worst.max((ours[i] - theirs[i]).abs() / scale);
        }
    }
    worst
}

/// `x_j = cos j`: the vector that the reference's matrices are multiplied with.
fn direction(n: usize) -> DVector<f64> {
    DVector::from_fn(n, |j, _| (j as f64).cos())
}

fn compare(name: &str, model: &ObjectModel) {
    let path = common::root().join(format!("tests/peers/{name}_pinocchio.json"));
    let reference: Reference = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let mut multibody = Multibody::welded(model, Isometry3::identity()).unwrap();
    multibody.set_gravity(Vector3::from(reference.gravity));
    let n = multibody.nv();
    // Their order of joints to ours.
    let (mut q_at, mut v_at): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    for name in &reference.joints {
        let joint = multibody.joint(name).unwrap();
        q_at.extend(joint.q.clone());
        v_at.extend(joint.v.clone());
    }
    assert_eq!(v_at.len(), n);
    assert!(reference.states.len() >= 500);
    let ours = |theirs: &[f64], at: &[usize]| {
        let mut x = vec![0.0; theirs.len()];
        for (&i, &value) in at.iter().zip(theirs) {
            x[i] = value;
        }
        x
    };
    let theirs = |ours: &[f64]| v_at.iter().map(|&i| ours[i]).collect::<Vec<f64>>();
    let link = multibody.link(&reference.frame).unwrap();
    let columns: Vec<usize> =
        reference.bodies.iter().flat_map(|b| multibody.regressor_columns(multibody.link(b).unwrap()).unwrap()).collect();
    let mut ws = multibody.workspace();
    let mut pairs: BTreeMap<String, Vec<(Vec<f64>, Vec<f64>)>> = BTreeMap::new();
    for state in &reference.states {
        let (q, v) = (ours(&state.q, &q_at), ours(&state.v, &v_at));
        let (a, tau) = (ours(&state.a, &v_at), ours(&state.tau, &v_at));
        multibody.set_state(&mut ws, &q, &v).unwrap();
        let mut add = |what: &str, ours: Vec<f64>, theirs: &[f64]| {
            pairs.entry(what.into()).or_default().push((ours, theirs.to_vec()));
        };
        let mut x = vec![0.0; n];
        multibody.inverse_dynamics(&mut ws, &a, &[], &mut x).unwrap();
        add("inverse dynamics", theirs(&x), &state.inverse);
        multibody.forward_dynamics(&mut ws, &tau, &[], &mut x).unwrap();
        add("forward dynamics", theirs(&x), &state.forward);
        multibody.gravity_efforts(&mut ws, &mut x).unwrap();
        add("gravity", theirs(&x), &state.gravity);
        // The mass matrix's way to the same accelerations.
        multibody.bias_efforts(&mut ws, &mut x).unwrap();
        let mut by_mass: Vec<f64> = tau.iter().zip(&x).map(|(t, b)| t - b).collect();
        multibody.factor_mass_matrix(&mut ws).unwrap();
        multibody.solve_mass_matrix(&ws, &mut by_mass).unwrap();
        add("forward dynamics by the mass matrix", theirs(&by_mass), &state.forward);

        let mut matrices: BTreeMap<&str, DMatrix<f64>> = BTreeMap::new();
        let mut forward = ForwardDynamicsDerivatives::new(&multibody);
        multibody.forward_dynamics_derivatives(&mut ws, &tau, &[], &mut x, &mut forward).unwrap();
        add("forward dynamics beside its derivatives", theirs(&x), &state.forward);
        let mut inverse = InverseDynamicsDerivatives::new(&multibody);
        multibody.inverse_dynamics_derivatives(&mut ws, &a, &[], &mut inverse).unwrap();
        matrices.insert("mass", multibody.mass_matrix(&mut ws).unwrap().clone());
        matrices.insert("inverse_by_q", inverse.d_q);
        matrices.insert("inverse_by_v", inverse.d_v);
        matrices.insert("forward_by_q", forward.d_q);
        matrices.insert("forward_by_v", forward.d_v);
        matrices.insert("forward_by_tau", forward.d_tau);
        for matrix in matrices.values_mut() {
            *matrix = DMatrix::from_fn(n, n, |i, j| matrix[(v_at[i], v_at[j])]);
        }
        let mut Y = DMatrix::zeros(n, columns.len());
        multibody.torque_regressor(&mut ws, &a, &mut Y).unwrap();
        matrices.insert("regressor", DMatrix::from_fn(n, columns.len(), |i, j| Y[(v_at[i], columns[j])]));
        for (what, matrix) in &matrices {
            add(&format!("{what} times a vector"), (matrix * direction(matrix.ncols())).as_slice().to_vec(), &state.products[*what]);
        }
        if !state.matrices.is_empty() {
            let mut J = Matrix6xX::zeros(n);
            multibody.jacobian(&ws, link, &Point3::origin(), &mut J).unwrap();
            matrices.insert("jacobian", DMatrix::from_fn(6, n, |i, j| J[(i, v_at[j])]));
            for (what, matrix) in &matrices {
                add(what, matrix.transpose().as_slice().to_vec(), &state.matrices[*what]);
            }
        }
    }
    assert_eq!(pairs.len(), 5 + 2 * 7 + 1);
    for (what, pairs) in &pairs {
        let worst = relative(pairs);
        println!("{name}, {what}, {} states: {worst:.1e}", pairs.len());
        assert!(worst < 1e-9, "{name}, {what}: {worst:.1e}. If the model has changed, make the reference anew");
    }
}

fn shipped(name: &str) -> ObjectModel {
    let folder = common::root().join("world-models").join(name);
    let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    ObjectModel::read(folder.join(head.trim())).unwrap()
}

#[test]
fn arm_with_hand_agrees_with_pinocchio() {
    compare("panda", &shipped("panda"));
}

#[test]
fn microwave_agrees_with_pinocchio() {
    compare("microwave", &shipped("microwave"));
}

#[test]
fn drawer_cabinet_agrees_with_pinocchio() {
    compare("drawer", &shipped("drawer"));
}

#[test]
fn every_kind_of_joint_agrees_with_pinocchio() {
    compare("mixed", &ObjectModel::read_urdf(common::root().join("tests/peers/mixed.urdf")).unwrap());
}
