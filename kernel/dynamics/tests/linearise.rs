//! A step's derivatives against central differences of the step itself.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{WIDE, joint, link, menagerie, model, panda, random, random_state, random_vector, welded};
use sagci_dynamics::effects::{Acts, HISTORY, Prior, catalogue};
use sagci_dynamics::residual::{Activation, Residual};
use sagci_dynamics::{Coriolis, ExternalWrench, Held, Input, Linearisation, Part, SpatialVector, State, System};
use sagci_model::EffectEntry;

const DT: f64 = 2e-3;

fn effect(name: &str, joint: &str, parameters: &[(&str, f64)]) -> EffectEntry {
    EffectEntry {
        effect: name.into(),
        joint: Some(joint.into()),
        parameters: parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect(),
        ..EffectEntry::default()
    }
}

/// Holds A and B of a step against differences, and returns what held each velocity.
fn check(system: &System, state: &State, tau: &[f64], external: &[ExternalWrench], bound: f64) -> Vec<Held> {
    let multibody = system.multibody();
    let (n, nz) = (multibody.nv(), state.z.len());
    let (mut ws, mut next, mut x) = (system.workspace(), system.state(), Linearisation::new(system));
    system.linearise(&mut ws, state, &Input { tau, external }, DT, &mut next, &mut x).unwrap();
    let held = ws.held().to_vec();
    let mut stepped = state.clone();
    system.step(&mut ws, &mut stepped, &Input { tau, external }, DT).unwrap();
    assert_eq!(stepped, next, "the step beside its derivatives must be the step");
    // The change of the state after the step, as a tangent at where it leads, for a change of one number before it.
    let mut after = |column: usize, by: f64| {
        let (mut moved, mut tau) = (state.clone(), tau.to_vec());
        match column {
            k if k < n => {
                let mut dq = vec![0.0; n];
                dq[k] = by;
                multibody.integrate(&mut moved.q, &dq, 1.0).unwrap();
            }
            k if k < 2 * n => moved.v[k - n] += by,
            k if k < 2 * n + nz => moved.z[k - 2 * n] += by,
            k => tau[k - 2 * n - nz] += by,
        }
        system.step(&mut ws, &mut moved, &Input { tau: &tau, external }, DT).unwrap();
        assert_eq!(ws.held(), held, "the differences must not cross an edge");
        let mut change = vec![0.0; n];
        multibody.difference(&next.q, &moved.q, &mut change).unwrap();
        change.extend(moved.v.iter().chain(&moved.z).zip(next.v.iter().chain(&next.z)).map(|(a, b)| a - b));
        change
    };
    // The place in a history and how long its entries lasted are no variables, nor is whether a latch has let go.
    let mut fixed = Vec::new();
    for placed in system.placements() {
        if placed.effect.keeps_history() {
            fixed.push(placed.z.start);
            fixed.extend(placed.z.end - HISTORY..placed.z.end);
        }
        if placed.effect.description().name == "latch" {
            fixed.push(placed.z.start + 1);
        }
    }
    fixed.iter_mut().for_each(|z| *z += 2 * n);
    for column in (0..3 * n + nz).filter(|c| !fixed.contains(c)) {
        // Inner states can be as small as a bristle.
        let h = match column {
            k if k < 2 * n => 1e-5,
            k if k < 2 * n + nz => 1e-8,
            _ => 1e-3,
        };
        let [a, b, c, d] = [1.0, -1.0, 2.0, -2.0].map(|s: f64| after(column, s * h));
        let differences: Vec<f64> = (0..2 * n + nz).map(|i| (8.0 * (a[i] - b[i]) - (c[i] - d[i])) / (12.0 * h)).collect();
        for (i, expected) in differences.iter().enumerate().filter(|(i, _)| !fixed.contains(i)) {
            let ours = if column < 2 * n + nz { x.A[(i, column)] } else { x.B[(i, column - 2 * n - nz)] };
            let scale = differences.iter().fold(1e-3, |m: f64, x| m.max(x.abs()));
            // Rounding of the state, over the step of the difference.
            let noise = 1e-15 * (1.0 + state.z.iter().fold(0.0, |m: f64, z| m.max(z.abs()))) / h;
            assert!((ours - expected).abs() < bound * scale + noise, "row {i}, column {column} of {n}: {ours} against {expected}");
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

/// An arm that moves, with every joint's dry friction well away from its edge.
fn moving(system: &System) -> State {
    let mut state = system.state();
    state.q[..9].copy_from_slice(&[0.1, -0.7, 0.2, -2.2, 0.1, 1.5, 0.7, 0.02, 0.015]);
    state.v[..9].copy_from_slice(&[0.2, 0.5, -0.3, 0.4, 0.6, -0.7, 0.5, 0.3, 0.2]);
    state
}

#[test]
fn every_effect_agrees_with_differences_by_its_inner_states_too() {
    for effect in catalogue() {
        let d = effect.description();
        if matches!(d.acts, Acts::Measurement(_)) {
            continue;
        }
        let middling = |prior: &Prior| match *prior {
            Prior::LogNormal { median, .. } => median,
            Prior::Normal { mean, deviation } => mean + 0.3 * deviation,
            Prior::OneOf(choices) => choices[0],
        };
        let mut arm = panda();
        arm.document.effects.push(EffectEntry {
            effect: d.name.into(),
            joint: (d.acts != Acts::Base).then(|| "panda_joint4".into()),
            parameters: d
                .parameters
                .iter()
                .filter(|p| p.words.is_empty())
                .map(|p| (p.name.into(), middling(&p.prior[0]).clamp(p.bounds[0], p.bounds[1])))
                .collect(),
            ..EffectEntry::default()
        });
        for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
            let mut system = System::new(&[welded(&arm)]).unwrap();
            system.set_coriolis(coriolis);
            let mut state = moving(&system);
            let tau = [2.0, -20.0, 1.0, 15.0, 1.0, 2.0, 0.5, 1.0, 1.0];
            // A few steps fill the inner states.
            let mut ws = system.workspace();
            for _ in 0..3 {
                system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, DT).unwrap();
            }
            println!("{}", d.name);
            check(&system, &state, &tau, &[], 2e-6);
        }
    }
}

#[test]
fn a_base_that_gives_way_agrees_with_differences_in_motion_of_its_own() {
    let mut rng = random(83);
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        for direction in ["x", "y", "z"] {
            let mut arm = panda();
            arm.document.effects.push(EffectEntry {
                effect: "unmodelled_mode".into(),
                parameters: [("frequency", 6.0), ("damping_ratio", 0.1), ("mass", 12.0)].map(|(n, v)| (n.into(), v)).into(),
                choices: [("direction".into(), direction.into())].into(),
                ..EffectEntry::default()
            });
            // Something beside it that it does not carry.
            let zoo = menagerie(false);
            let mut system = System::new(&[welded(&arm), Part { name: "free".into(), ..Part::floating(&zoo) }]).unwrap();
            system.set_coriolis(coriolis);
            let mut state = system.state();
            (state.q, state.v) = random_state(system.multibody(), &mut rng);
            let still = moving(&System::new(&[welded(&arm)]).unwrap());
            state.q[..9].copy_from_slice(&still.q);
            state.v[..9].copy_from_slice(&still.v);
            state.z.copy_from_slice(&[3e-3, -0.08]);
            let F_W = SpatialVector::from_column_slice(&random_vector(6, 3.0, &mut rng));
            let external = [ExternalWrench { link: system.multibody().link("panda_link5").unwrap(), F_W }];
            let tau = random_vector(system.multibody().nv(), 3.0, &mut rng);
            check(&system, &state, &tau, &external, 1e-6);
        }
    }
}

#[test]
fn a_learned_residual_agrees_with_differences() {
    let mut rng = random(84);
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        let zoo = menagerie(true);
        let mut system = System::new(&[welded(&zoo)]).unwrap();
        system.set_coriolis(coriolis);
        let mut residual = Residual::new(system.multibody(), &["ja", "jc", "jd", "je"], &["jb", "jd"], &[6], Activation::Tanh, 2).unwrap();
        residual.set_weights(&random_vector(residual.network().weights().len(), 0.5, &mut rng)).unwrap();
        system.set_residual(Some(&residual)).unwrap();
        let mut state = system.state();
        (state.q, state.v) = random_state(system.multibody(), &mut rng);
        check(&system, &state, &random_vector(system.multibody().nv(), 3.0, &mut rng), &[], 1e-6);
    }
}

#[test]
fn a_body_on_one_joint_moves_and_answers_as_it_does_among_others() {
    let mut rng = random(31);
    let hinge = |kind: &str| {
        let urdf = link("base", 1.0, [0.0; 3], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
            + &link("leaf", 1.3, [0.1, 0.05, -0.2], [0.03, 0.001, 0.002, 0.04, 0.001, 0.02])
            + &joint("j", kind, "base", "leaf", [0.2, 1.0, 0.3], [0.1, 0.0, -0.3, 0.1, 0.2, 0.0], WIDE);
        model("leaf", &urdf)
    };
    for kind in ["revolute", "prismatic"] {
        for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
            let (leaf, other) = (hinge(kind), hinge("revolute"));
            let mut alone = System::new(&[welded(&leaf)]).unwrap();
            let mut beside = System::new(&[welded(&leaf), Part { name: "other".into(), ..welded(&other) }]).unwrap();
            for system in [&mut alone, &mut beside] {
                for (name, parameters) in [
                    ("viscous_friction", vec![("damping", 0.2)]),
                    ("coulomb_friction", vec![("friction", 0.1)]),
                    ("joint_spring", vec![("stiffness", 3.0), ("rest_position", 0.1)]),
                    ("load_dependent_friction", vec![]),
                ] {
                    let entry = effect(name, "j", &parameters);
                    let mut entry = EffectEntry { ..entry };
                    if name == "load_dependent_friction" {
                        let d = sagci_dynamics::effects::find(name).unwrap().description();
                        entry.parameters = d.parameters.iter().map(|p| (p.name.into(), 0.1)).collect();
                    }
                    system.add_effect("leaf", &entry).unwrap();
                }
                system.set_coriolis(coriolis);
            }
            for _ in 0..20 {
                let (mut one, mut two) = (alone.state(), beside.state());
                (one.q[0], one.v[0]) = (random_vector(1, 3.0, &mut rng)[0], random_vector(1, 1.0, &mut rng)[0]);
                (two.q[0], two.v[0]) = (one.q[0], one.v[0]);
                check(&alone, &one, &[0.7], &[], 1e-6);
                let which = [&alone, &beside].map(|s| s.select_parameters(&["leaf/*"]).unwrap());
                let mut x = [
                    Linearisation::with_parameters(&alone, &which[0]).unwrap(),
                    Linearisation::with_parameters(&beside, &which[1]).unwrap(),
                ];
                let (mut first, mut second) = (alone.state(), beside.state());
                let mut ws = alone.workspace();
                alone.linearise(&mut ws, &one, &Input { tau: &[0.7], external: &[] }, DT, &mut first, &mut x[0]).unwrap();
                let beside_input = Input { tau: &[0.7, 0.0], external: &[] };
                beside.linearise(&mut beside.workspace(), &two, &beside_input, DT, &mut second, &mut x[1]).unwrap();
                let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-13 * (1.0 + a.abs()), "{kind}: {a} {b}");
                near(first.q[0], second.q[0]);
                near(first.v[0], second.v[0]);
                for row in 0..2 {
                    for column in 0..2 {
                        near(x[0].A[(row, column)], x[1].A[(2 * row, 2 * column)]);
                    }
                    for column in 0..which[0].len() {
                        near(x[0].P[(row, column)], x[1].P[(2 * row, column)]);
                    }
                }
                // With inertias changed, what was kept of them does not count.
                let mass = alone.select_parameters(&["leaf/leaf.mass"]).unwrap();
                alone.set_parameters(&mass, &[0.3]).unwrap();
                beside.set_parameters(&beside.select_parameters(&["leaf/leaf.mass"]).unwrap(), &[0.3]).unwrap();
                alone.step(&mut ws, &mut one, &Input { tau: &[0.7], external: &[] }, DT).unwrap();
                beside.step(&mut beside.workspace(), &mut two, &beside_input, DT).unwrap();
                near(one.v[0], two.v[0]);
            }
        }
    }
}
