//! Steps in time: energy, friction, springs, stops and limits.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use std::collections::BTreeMap;

use common::{WIDE, brick, joint, link, model, panda, pendulum, random, random_vector, slide, welded};
use nalgebra::Vector3;
use sagci_dynamics::{ExternalWrench, Held, Input, Part, State, System};
use sagci_model::{EffectEntry, ObjectModel};

fn system(model: &ObjectModel) -> System {
    System::new(&[welded(model)]).unwrap()
}

fn effect(name: &str, joint: &str, parameters: &[(&str, f64)]) -> EffectEntry {
    let parameters: BTreeMap<_, _> = parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect();
    EffectEntry { effect: name.into(), joint: Some(joint.into()), parameters }
}

/// Steps with constant efforts, and looks after each step.
fn run(system: &System, state: &mut State, tau: &[f64], dt: f64, steps: usize, mut look: impl FnMut(&State)) {
    let mut ws = system.workspace();
    for _ in 0..steps {
        system.step(&mut ws, state, &Input { tau, external: &[] }, dt).unwrap();
        look(state);
    }
}

fn energy(system: &System, state: &State) -> f64 {
    let multibody = system.multibody();
    let mut ws = multibody.workspace();
    multibody.set_state(&mut ws, &state.q, &state.v).unwrap();
    multibody.kinetic_energy(&ws) + multibody.potential_energy(&ws)
}

/// A Panda without losses or limits, let go from its ready pose.
fn free_arm() -> (System, State) {
    let mut arm = panda();
    for joint in &mut arm.joints {
        (joint.damping, joint.friction) = (0.0, 0.0);
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
        // The fingers would fall for ever.
        if joint.kind == sagci_model::JointKind::Prismatic {
            joint.kind = sagci_model::JointKind::Fixed;
        }
    }
    let system = system(&arm);
    let mut state = system.state();
    state.q.copy_from_slice(&[0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]);
    (system, state)
}

#[test]
fn free_arm_keeps_its_energy_better_the_shorter_the_step() {
    let mut worst = Vec::new();
    for dt in [1e-3, 5e-4, 2.5e-4] {
        let (system, mut state) = free_arm();
        let start = energy(&system, &state);
        let (mut drift, mut swing, mut late) = (0.0_f64, 0.0_f64, Vec::new());
        let multibody = system.multibody().clone();
        let mut ws = multibody.workspace();
        run(&system, &mut state, &[], dt, (10.0 / dt) as usize, |s| {
            multibody.set_state(&mut ws, &s.q, &s.v).unwrap();
            let kinetic = multibody.kinetic_energy(&ws);
            let error = kinetic + multibody.potential_energy(&ws) - start;
            // Runs of different steps stay together for the first second or two only; after that the greatest error is chance.
            if s.time < 1.0 {
                drift = drift.max(error.abs());
            }
            swing = swing.max(kinetic);
            if s.time > 8.0 {
                late.push(error);
            }
        });
        let trend = late.iter().sum::<f64>() / late.len() as f64;
        println!(
            "step {dt}: energy off by at most {drift:.2e} J in the first second, on average {trend:.1e} J after 8 s, of {swing:.1} J in motion"
        );
        assert!(trend.abs() < 0.02 * swing, "the energy drifts away: {trend} J");
        worst.push(drift / swing);
    }
    assert!(worst[0] < 0.1, "{worst:?}");
    assert!(worst[1] < 0.6 * worst[0] && worst[2] < 0.6 * worst[1], "the drift must shrink with the step: {worst:?}");
}

#[test]
fn pendulum_has_the_period_of_the_elliptic_integral() {
    let (m, l, I) = (1.3, 0.4, 0.02);
    let system = system(&pendulum(m, l, I, ""));
    let amplitude = 1.0_f64;
    let mut state = system.state();
    state.q[0] = amplitude;
    let dt = 1e-4;
    let (mut crossings, mut before) = (Vec::new(), (0.0, amplitude));
    run(&system, &mut state, &[], dt, 40_000, |s| {
        let now = (s.time, s.q[0]);
        if before.1 < 0.0 && now.1 >= 0.0 {
            crossings.push(before.0 + (now.0 - before.0) * before.1 / (before.1 - now.1));
        }
        before = now;
    });
    let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
    // T = 4 K(sin(amplitude / 2)) / omega, with K by the arithmetic-geometric mean.
    let omega = (m * 9.81 * l / (I + m * l * l)).sqrt();
    let (mut a, mut b) = (1.0, (amplitude / 2.0).cos());
    for _ in 0..20 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    let expected = 2.0 * std::f64::consts::PI / (omega * a);
    assert!((period / expected - 1.0).abs() < 1e-5, "{period} {expected}");
}

#[test]
fn damping_decays_as_its_closed_form() {
    let (m, c) = (2.0, 3.0);
    let system = system(&slide(m, &format!("{WIDE}<dynamics damping='{c}' friction='0'/>")));
    for dt in [1e-3, 1e-4] {
        let mut state = system.state();
        state.v[0] = 1.5;
        run(&system, &mut state, &[], dt, (0.8 / dt) as usize, |_| {});
        let expected = 1.5 * (-c / m * 0.8_f64).exp();
        assert!((state.v[0] - expected).abs() < 2.0 * dt, "{} {expected}", state.v[0]);
        // The step is backward Euler in damping: known to the bit but for rounding.
        let discrete = 1.5 * (1.0 + dt * c / m).powf(-(0.8 / dt).round());
        assert!((state.v[0] - discrete).abs() < 1e-9, "{} {discrete}", state.v[0]);
    }
}

#[test]
fn strong_damping_is_stable_at_any_step() {
    let system = system(&slide(0.01, &format!("{WIDE}<dynamics damping='1e5' friction='0'/>")));
    let mut state = system.state();
    state.v[0] = 1.0;
    run(&system, &mut state, &[2.0], 0.1, 100, |s| assert!(s.v[0].abs() <= 1.0));
    assert!((state.v[0] - 2e-5).abs() < 1e-12, "{}", state.v[0]);
}

#[test]
fn dry_friction_holds_below_its_bound_and_lets_go_above() {
    let friction = 2.0;
    let system = system(&slide(1.5, &format!("{WIDE}<dynamics damping='0' friction='{friction}'/>")));
    for (push, moves) in [(1.999_999, false), (-1.999_999, false), (2.000_001, true), (-2.000_001, true)] {
        let mut state = system.state();
        run(&system, &mut state, &[push], 1e-3, 2000, |_| {});
        if moves {
            let expected = (push.abs() - friction) / 1.5 * 2.0 * push.signum();
            assert!((state.v[0] - expected).abs() < 1e-11, "{push}: {}", state.v[0]);
        } else {
            // At rest means at rest: no creep at all.
            assert_eq!((state.q[0], state.v[0]), (0.0, 0.0), "{push}");
        }
    }
}

#[test]
fn a_sliding_block_stops_where_friction_has_eaten_its_energy() {
    let system = system(&slide(2.0, &format!("{WIDE}<dynamics damping='0' friction='3'/>")));
    let mut state = system.state();
    state.v[0] = 1.0;
    run(&system, &mut state, &[], 1e-4, 10_000, |s| assert!(s.v[0] >= 0.0, "friction must not turn the motion round"));
    // m v^2 / 2 = f s
    assert!((state.q[0] - 1.0 / 3.0).abs() < 1e-4, "{}", state.q[0]);
    assert_eq!(state.v[0], 0.0);
}

#[test]
fn a_chain_sticks_joint_by_joint() {
    // A horizontal two-link arm: the outer joint's friction exceeds its load, the inner one's does not.
    let rod = |n: &str| link(n, 1.0, [0.25, 0.0, 0.0], [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]);
    let loss = |f: f64| format!("{WIDE}<dynamics damping='0.1' friction='{f}'/>");
    let urdf = link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &rod("upper")
        + &rod("lower")
        + &joint("shoulder", "revolute", "base", "upper", [0.0, 1.0, 0.0], [0.0; 6], &loss(1.0))
        + &joint("elbow", "revolute", "upper", "lower", [0.0, 1.0, 0.0], [0.5, 0.0, 0.0, 0.0, 0.0, 0.0], &loss(50.0));
    let system = system(&model("chain", &urdf));
    let (mut state, mut ws) = (system.state(), system.workspace());
    for _ in 0..200 {
        system.step(&mut ws, &mut state, &Input::default(), 1e-3).unwrap();
    }
    assert!(state.q[0] > 0.1, "the shoulder falls");
    assert_eq!(state.q[1], 0.0, "the elbow sticks");
    assert_eq!(ws.held(), [Held::Free, Held::Stuck]);
}

#[test]
fn limits_are_kept_to_the_bit_and_let_go() {
    let system = system(&slide(1.0, "<limit lower='-0.2' upper='0.3' velocity='1' effort='1'/>"));
    let mut state = system.state();
    run(&system, &mut state, &[5.0], 1e-3, 2000, |s| assert!(s.q[0] <= 0.3 + 1e-15));
    assert!((state.q[0] - 0.3).abs() < 1e-12 && state.v[0].abs() < 1e-12);
    run(&system, &mut state, &[-5.0], 1e-3, 2000, |s| assert!(s.q[0] >= -0.2 - 1e-15));
    assert!((state.q[0] + 0.2).abs() < 1e-12);
    // From outside it comes back without a blow.
    state.q[0] = 0.5;
    state.v[0] = 0.0;
    run(&system, &mut state, &[0.0], 1e-3, 200, |s| assert!(s.v[0].abs() <= 0.2 / 0.01 + 1e-9));
    assert!(state.q[0] <= 0.3 + 1e-6, "{}", state.q[0]);
}

#[test]
fn a_hard_stop_takes_the_limits_place_and_bounces() {
    let mut system = system(&slide(1.0, "<limit lower='-1' upper='0.3' velocity='1' effort='1'/>"));
    // The coefficient of restitution of Hunt and Crossley is near 1 - (2/3) v dissipation / stiffness for small losses.
    let (k, d) = (1e5, 2e4);
    let stop = effect("hard_stop", "slide", &[("stiffness", k), ("dissipation", d), ("position", 0.3), ("side", 1.0)]);
    system.add_effect("slide", &stop).unwrap();
    let mut state = system.state();
    state.v[0] = 0.5;
    let mut deepest = 0.0_f64;
    run(&system, &mut state, &[], 1e-5, 100_000, |s| deepest = deepest.max(s.q[0] - 0.3));
    // Half an oscillation of the mass on the spring: v sqrt(m / k) without losses.
    assert!(deepest > 0.8 * 0.5 / k.sqrt() && deepest < 0.5 / k.sqrt(), "{deepest}");
    let restitution = -state.v[0] / 0.5;
    assert!((restitution - (1.0 - 2.0 / 3.0 * 0.5 * d / k)).abs() < 0.02, "{restitution}");
    // Pressed against it, the block rests at the depth that carries the push; a coarse step is stable too.
    for dt in [1e-4, 1e-2] {
        let mut state = system.state();
        run(&system, &mut state, &[20.0], dt, (20.0 / dt) as usize, |_| {});
        assert!((state.q[0] - 0.3 - 20.0 / k).abs() < 1e-7, "{dt}: {}", state.q[0]);
    }
}

#[test]
fn a_spring_swings_with_its_frequency_and_stiff_ones_are_stable() {
    let mut soft = system(&slide(2.0, WIDE));
    soft.add_effect("slide", &effect("joint_spring", "slide", &[("stiffness", 50.0), ("rest_position", 0.1)])).unwrap();
    let mut state = soft.state();
    let half = std::f64::consts::PI / (50.0_f64 / 2.0).sqrt();
    run(&soft, &mut state, &[], half / 20_000.0, 20_000, |_| {});
    assert!((state.q[0] - 0.2).abs() < 1e-3 && state.v[0].abs() < 1e-2, "{state:?}");

    let mut stiff = system(&slide(0.1, WIDE));
    stiff.add_effect("slide", &effect("joint_spring", "slide", &[("stiffness", 1e7), ("rest_position", 0.1)])).unwrap();
    let mut state = stiff.state();
    run(&stiff, &mut state, &[], 0.01, 500, |s| assert!(s.q[0].abs() < 0.21));
    assert!((state.q[0] - 0.1).abs() < 1e-6);
}

/// A brick that tumbles about its middle axis without gravity (Dzhanibekov).
fn tumbling() -> (System, State) {
    let mut system = System::new(&[Part::floating(&brick([0.01, 0.0, 0.0, 0.02, 0.0, 0.03]))]).unwrap();
    system.multibody_mut().set_gravity(Vector3::zeros());
    let mut state = system.state();
    state.v.copy_from_slice(&[1e-3, 5.0, 1e-3, 0.3, -0.2, 0.1]);
    (system, state)
}

#[test]
fn a_tumbling_body_keeps_energy_and_momentum_better_the_shorter_the_step() {
    let mut worst = Vec::new();
    for dt in [2e-3, 1e-3, 5e-4] {
        let (system, mut state) = tumbling();
        let multibody = system.multibody().clone();
        let mut ws = multibody.workspace();
        multibody.set_state(&mut ws, &state.q, &state.v).unwrap();
        let (start, energy) = (multibody.momentum(&ws), multibody.kinetic_energy(&ws));
        let (mut e, mut h, mut p, mut flipped) = (0.0_f64, 0.0_f64, 0.0_f64, false);
        run(&system, &mut state, &[], dt, (10.0 / dt) as usize, |s| {
            multibody.set_state(&mut ws, &s.q, &s.v).unwrap();
            let now = multibody.momentum(&ws);
            e = e.max((multibody.kinetic_energy(&ws) / energy - 1.0).abs());
            h = h.max((now.angular - start.angular).norm() / start.angular.norm());
            p = p.max((now.linear - start.linear).norm() / start.linear.norm());
            flipped |= s.v[1] < -4.0;
        });
        println!("step {dt}: energy {e:.2e}, angular momentum {h:.2e}, linear momentum {p:.2e}");
        assert!(flipped, "turning about the middle axis is not stable");
        worst.push(e.max(h).max(p));
    }
    assert!(worst[0] < 0.2, "{worst:?}");
    assert!(worst[1] < 0.65 * worst[0] && worst[2] < 0.65 * worst[1], "{worst:?}");
}

#[test]
fn a_free_tree_keeps_its_momentum_under_inner_efforts() {
    let body = |n: &str| link(n, 1.0, [0.1, 0.05, 0.0], [0.02, 0.001, 0.0, 0.03, 0.0, 0.025]);
    let urdf = body("a")
        + &body("b")
        + &body("c")
        + &joint(
            "j",
            "revolute",
            "a",
            "b",
            [0.0, 0.6, 0.8],
            [0.2, 0.0, 0.1, 0.1, 0.2, 0.3],
            &format!("{WIDE}<dynamics damping='0.1' friction='0.05'/>"),
        )
        + &joint("k", "prismatic", "b", "c", [1.0, 0.0, 0.0], [0.2, 0.0, 0.0, 0.0, 0.2, 0.3], WIDE);
    let model = model("tree", &urdf);
    let mut worst = Vec::new();
    for dt in [1e-3, 5e-4] {
        let mut system = System::new(&[Part::floating(&model)]).unwrap();
        system.multibody_mut().set_gravity(Vector3::zeros());
        let mut state = system.state();
        state.v.copy_from_slice(&random_vector(8, 0.5, &mut random(21)));
        let multibody = system.multibody().clone();
        let mut ws = multibody.workspace();
        multibody.set_state(&mut ws, &state.q, &state.v).unwrap();
        let start = multibody.momentum(&ws);
        let mut tau = [0.0; 8];
        tau[6] = 0.3;
        run(&system, &mut state, &tau, dt, (1.0 / dt) as usize, |_| {});
        multibody.set_state(&mut ws, &state.q, &state.v).unwrap();
        let end = multibody.momentum(&ws);
        worst.push((end.linear - start.linear).norm().max((end.angular - start.angular).norm()));
    }
    println!("drift of momentum {worst:?}");
    assert!(worst[0] < 0.02 && worst[1] < 0.65 * worst[0], "{worst:?}");
}

#[test]
fn an_external_force_on_a_link_moves_it() {
    let system = system(&slide(2.0, WIDE));
    let link = system.multibody().link("block").unwrap();
    // 3 N along the slide, far beside it: the moment is carried by the slide.
    let F_W = sagci_dynamics::wrench_at_origin(&Vector3::new(3.0, 1.0, 0.0), &Vector3::zeros(), &nalgebra::Point3::new(0.0, 5.0, 1.0));
    let (mut state, mut ws) = (system.state(), system.workspace());
    for _ in 0..1000 {
        system.step(&mut ws, &mut state, &Input { tau: &[], external: &[ExternalWrench { link, F_W }] }, 1e-3).unwrap();
    }
    assert!((state.v[0] - 1.5).abs() < 1e-12);
}

#[test]
fn a_puck_on_a_tilted_plane_slides_straight_while_it_spins() {
    let urdf = link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &link("puck", 1.0, [0.0; 3], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
        + &joint("plane", "planar", "base", "puck", [0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0, 0.3, 0.0], "");
    let system = system(&model("puck", &urdf));
    let mut state = system.state();
    state.v.copy_from_slice(&[0.0, 0.4, 2.0]);
    run(&system, &mut state, &[], 1e-4, 10_000, |_| {});
    // Down the plane's x axis with g sin(0.3), across it at constant speed, turning at constant rate.
    let expected = [0.5 * 9.81 * 0.3_f64.sin(), 0.4, 2.0];
    for (have, want) in state.q.iter().zip(expected) {
        assert!((have - want).abs() < 1e-3, "{:?}", state.q);
    }
}

#[test]
fn fingers_that_follow_move_together() {
    let mut arm = panda();
    let (first, second) = (arm.joint("panda_finger_joint1").unwrap(), arm.joint("panda_finger_joint2").unwrap());
    arm.joints[second].mimic = Some(sagci_model::Mimic { joint: first, multiplier: 1.0, offset: 0.0 });
    let system = system(&arm);
    assert_eq!(system.multibody().nv(), 8);
    // Both fingers weigh on the one coordinate: F = (m1 + m2) a, less what the arm gives way.
    let mut state = system.state();
    state.q[..7].copy_from_slice(&[0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]);
    let mut tau = vec![0.0; 8];
    let mut ws = system.multibody().workspace();
    system.multibody().set_positions(&mut ws, &state.q).unwrap();
    system.multibody().gravity_efforts(&mut ws, &mut tau).unwrap();
    tau[7] += 0.3;
    run(&system, &mut state, &tau, 1e-3, 20, |_| {});
    let mass = arm.links[first + 1].inertial.mass + arm.links[second + 1].inertial.mass;
    assert!((state.v[7] * mass / (0.3 * 0.02) - 1.0).abs() < 0.05, "{}", state.v[7] * mass / (0.3 * 0.02));
}

#[test]
fn the_same_start_gives_the_same_bits() {
    let system = system(&panda());
    let end = || {
        let mut state = system.state();
        state.v.copy_from_slice(&random_vector(9, 1.0, &mut random(22)));
        run(&system, &mut state, &random_vector(9, 5.0, &mut random(23)), 1e-3, 500, |_| {});
        state.q.iter().chain(&state.v).map(|x| x.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(end(), end());
}

#[test]
fn a_used_workspace_gives_the_same_bits_as_a_new_one() {
    let system = system(&panda());
    let mut ws = system.workspace();
    let mut used = system.state();
    used.v.copy_from_slice(&random_vector(9, 2.0, &mut random(24)));
    for _ in 0..100 {
        system.step(&mut ws, &mut used, &Input::default(), 1e-3).unwrap();
    }
    let mut fresh = used.clone();
    system.step(&mut ws, &mut used, &Input::default(), 1e-3).unwrap();
    system.step(&mut system.workspace(), &mut fresh, &Input::default(), 1e-3).unwrap();
    assert_eq!(used, fresh);
}
