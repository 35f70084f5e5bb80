//! A step's derivatives against central differences of the step itself.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{WIDE, joint, link, menagerie, model, panda, random, random_state, random_vector, welded};
use sagci_dynamics::{Coriolis, ExternalWrench, Held, Input, Linearisation, Part, SpatialVector, State, System};
use sagci_model::EffectEntry;

const DT: f64 = 2e-3;

fn effect(name: &str, joint: &str, parameters: &[(&str, f64)]) -> EffectEntry {
    EffectEntry { effect: name.into(), joint: Some(joint.into()), parameters: parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect() }
}

/// Holds A and B of a step against differences, and returns what held each velocity.
fn check(system: &System, state: &State, tau: &[f64], external: &[ExternalWrench], bound: f64) -> Vec<Held> {
    let multibody = system.multibody();
    let n = multibody.nv();
    let (mut ws, mut next, mut x) = (system.workspace(), system.state(), Linearisation::new(system));
    system.linearise(&mut ws, state, &Input { tau, external }, DT, &mut next, &mut x).unwrap();
    let held = ws.held().to_vec();
    let mut stepped = state.clone();
    system.step(&mut ws, &mut stepped, &Input { tau, external }, DT).unwrap();
    assert_eq!(stepped, next, "the step beside its derivatives must be the step");
    // The change of the state after the step, as a tangent at where it leads.
    let mut after = |dq: &[f64], dv: &[f64], du: &[f64]| {
        let mut moved = state.clone();
        multibody.integrate(&mut moved.q, dq, 1.0).unwrap();
        moved.v.iter_mut().zip(dv).for_each(|(v, d)| *v += d);
        let tau: Vec<f64> = tau.iter().zip(du).map(|(t, d)| t + d).collect();
        system.step(&mut ws, &mut moved, &Input { tau: &tau, external }, DT).unwrap();
        assert_eq!(ws.held(), held, "the differences must not cross an edge");
        let mut change = vec![0.0; n];
        multibody.difference(&next.q, &moved.q, &mut change).unwrap();
        change.extend(moved.v.iter().zip(&next.v).map(|(a, b)| a - b));
        change
    };
    let zeros = vec![0.0; n];
    for column in 0..3 * n {
        let h = 1e-5;
        let mut both = [1.0, -1.0, 2.0, -2.0].map(|s: f64| {
            let mut e = vec![0.0; n];
            e[column % n] = s * h;
            match column / n {
                0 => after(&e, &zeros, &zeros),
                1 => after(&zeros, &e, &zeros),
                _ => after(&zeros, &zeros, &e),
            }
        });
        let [a, b, c, d] = &mut both;
        let differences: Vec<f64> = (0..2 * n).map(|i| (8.0 * (a[i] - b[i]) - (c[i] - d[i])) / (12.0 * h)).collect();
        for (i, expected) in differences.iter().enumerate() {
            let ours = if column < 2 * n { x.A[(i, column)] } else { x.B[(i, column - 2 * n)] };
            let scale = differences.iter().fold(1e-3, |m: f64, x| m.max(x.abs()));
            assert!((ours - expected).abs() < bound * scale, "row {i}, column {column} of {n}: {ours} against {expected}");
        }
    }
    held
}

#[test]
fn every_kind_of_joint_and_both_schemes_agree_with_differences() {
    let mut rng = random(81);
    for followers in [false, true] {
        for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
            let zoo = menagerie(followers);
            let mut system = System::new(&[welded(&zoo), Part { name: "free".into(), ..Part::floating(&zoo) }]).unwrap();
            system.set_coriolis(coriolis);
            let mut state = system.state();
            (state.q, state.v) = random_state(system.multibody(), &mut rng);
            let tau = random_vector(system.multibody().nv(), 3.0, &mut rng);
            let F_W = SpatialVector::from_column_slice(&random_vector(6, 3.0, &mut rng));
            let external = [ExternalWrench { link: system.multibody().link("free/e").unwrap(), F_W }];
            check(&system, &state, &tau, &external, 1e-6);
        }
    }
}

#[test]
fn damped_arm_with_dry_friction_and_springs_agrees_with_differences() {
    let mut rng = random(82);
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        let mut arm = panda();
        arm.document.effects.push(effect("joint_spring", "panda_joint2", &[("stiffness", 40.0), ("rest_position", 0.2)]));
        let mut system = System::new(&[welded(&arm)]).unwrap();
        system.set_coriolis(coriolis);
        let mut state = system.state();
        state.q.copy_from_slice(&[0.1, -0.7, 0.2, -2.2, 0.1, 1.5, 0.7, 0.02, 0.015]);
        state.v = random_vector(9, 0.8, &mut rng);
        (state.v[7], state.v[8]) = (0.3, -0.2);
        check(&system, &state, &random_vector(9, 5.0, &mut rng), &[], 1e-6);
    }
}

#[test]
fn what_sticks_stays_and_what_stands_at_a_limit_follows_it() {
    let urdf = ["a", "b", "c"].iter().enumerate().fold(link("base", 1.0, [0.0; 3], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1]), |urdf, (k, name)| {
        let parent = ["base", "a", "b"][k];
        let more = match k {
            0 => format!("{WIDE}<dynamics damping='0.3' friction='5000'/>"),
            1 => "<limit lower='-0.5' upper='0.5' velocity='10' effort='100'/><dynamics damping='0.1' friction='0'/>".into(),
            _ => WIDE.into(),
        };
        urdf + &link(name, 1.0 + 0.2 * k as f64, [0.1, 0.05, -0.2], [0.03, 0.001, 0.002, 0.04, 0.001, 0.02])
            + &joint(&format!("j{name}"), "revolute", parent, name, [0.2, 1.0, 0.1 * k as f64], [0.1, 0.0, -0.3, 0.1, 0.2, 0.0], &more)
    });
    let chain = model("chain", &urdf);
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        for (q1, v1) in [(0.4999, 1.0), (0.52, 0.3)] {
            let mut system = System::new(&[welded(&chain)]).unwrap();
            system.set_coriolis(coriolis);
            let mut state = system.state();
            state.q.copy_from_slice(&[0.3, q1, -0.4]);
            state.v.copy_from_slice(&[0.0, v1, 0.9]);
            let held = check(&system, &state, &[1.0, 2.0, -0.5], &[], 1e-6);
            assert_eq!(held, [Held::Stuck, Held::AtLimit, Held::Free]);
        }
    }
}

#[test]
fn a_stop_that_pushes_agrees_with_differences() {
    let mut arm = panda();
    for joint in &mut arm.joints {
        joint.friction = 0.0;
    }
    let parameters = [("stiffness", 1e4), ("dissipation", 5e3), ("position", -0.72), ("side", 1.0)];
    arm.document.effects.push(effect("hard_stop", "panda_joint2", &parameters));
    let mut system = System::new(&[welded(&arm)]).unwrap();
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        system.set_coriolis(coriolis);
        let mut state = system.state();
        state.q.copy_from_slice(&[0.1, -0.7, 0.2, -2.2, 0.1, 1.5, 0.7, 0.02, 0.015]);
        state.v.copy_from_slice(&[0.2, 0.5, -0.3, 0.4, 0.1, -0.2, 0.3, 0.01, 0.02]);
        check(&system, &state, &[0.0; 9], &[], 1e-6);
    }
}
