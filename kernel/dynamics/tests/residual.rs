//! The learned residual: Jacobians, what it learns, and its files.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use std::collections::{BTreeMap, HashMap};

use common::{menagerie, pendulum, random, random_state, random_vector, slide, welded};
use rand::RngExt;
use safetensors::tensor::{Dtype, TensorView};
use sagci_dynamics::residual::{Activation, Network, Residual, ResidualJacobians, Sequence, Trainer};
use sagci_dynamics::{Input, State, System};
use sagci_model::EffectEntry;

#[test]
fn both_modes_of_the_network_agree_with_central_differences() {
    for activation in [Activation::Tanh, Activation::Silu] {
        let mut rng = random(3);
        let mut network = Network::new(&[5, 8, 7, 3], activation, 1).unwrap();
        let weights = random_vector(network.weights().len(), 0.7, &mut rng);
        network.set_weights(&weights).unwrap();
        let mut normalisation = network.normalisation().clone();
        normalisation.input_mean = random_vector(5, 1.0, &mut rng);
        normalisation.input_scale = vec![0.3, 2.0, 1.0, 0.7, 5.0];
        normalisation.output_scale = vec![3.0, 0.1, 1.0];
        network.set_normalisation(normalisation).unwrap();
        let mut ws = network.workspace();
        let (x, dx, dw) = (random_vector(5, 1.0, &mut rng), random_vector(5, 1.0, &mut rng), random_vector(weights.len(), 1.0, &mut rng));
        let value = |h: f64| {
            let mut moved = network.clone();
            moved.set_weights(&weights.iter().zip(&dw).map(|(w, d)| w + h * d).collect::<Vec<_>>()).unwrap();
            let mut y = vec![0.0; 3];
            moved.forward(&mut moved.workspace(), &x.iter().zip(&dx).map(|(x, d)| x + h * d).collect::<Vec<_>>(), &mut y);
            y
        };
        let (up, down) = (value(1e-5), value(-1e-5));
        let (mut y, mut dy) = (vec![0.0; 3], vec![0.0; 3]);
        network.forward(&mut ws, &x, &mut y);
        network.push(&mut ws, &dx, Some(&dw), &mut dy);
        for k in 0..3 {
            assert!((dy[k] - (up[k] - down[k]) / 2e-5).abs() < 1e-8 * (1.0 + dy[k].abs()), "{activation:?} {k}");
        }
        // <y_bar, push(dx, dw)> = <pull(y_bar), (dx, dw)>
        let (y_bar, mut x_bar, mut w_bar) = (random_vector(3, 1.0, &mut rng), vec![0.0; 5], vec![0.0; weights.len()]);
        network.pull(&mut ws, &y_bar, &mut x_bar, Some(&mut w_bar));
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (forward, reverse) = (dot(&y_bar, &dy), dot(&x_bar, &dx) + dot(&w_bar, &dw));
        assert!((forward - reverse).abs() < 1e-12 * (1.0 + forward.abs()), "{forward} {reverse}");
    }
}

#[test]
fn jacobians_by_state_input_next_state_and_weights_are_those_of_central_differences() {
    let mut system = System::new(&[welded(&menagerie(false))]).unwrap();
    let n = system.multibody().nv();
    let mut residual = Residual::new(system.multibody(), &["ja", "jc", "jd", "je"], &["jb", "jd"], &[6], Activation::Tanh, 2).unwrap();
    let mut rng = random(4);
    let weights = random_vector(residual.network().weights().len(), 0.5, &mut rng);
    residual.set_weights(&weights).unwrap();
    system.set_residual(Some(&residual)).unwrap();
    let mut ws = system.workspace();
    let (q, v) = random_state(system.multibody(), &mut rng);
    let mut state = system.state();
    (state.q, state.v) = (q, v);
    let (u, next, dt) = (random_vector(n, 1.0, &mut rng), random_vector(n, 1.0, &mut rng), 0.5);
    let mut jacobians = ResidualJacobians::default();
    system.residual_force(&mut ws, &state, &u, &next, dt, &mut vec![0.0; n], Some(&mut jacobians)).unwrap();
    let base = system.clone();
    let mut compare = |name: &str, block: &[f64], columns: usize, moved: &dyn Fn(usize, f64) -> (System, State, Vec<f64>, Vec<f64>)| {
        for k in 0..columns {
            let mut value = |h: f64| {
                let (system, state, u, next) = moved(k, h);
                let mut force = vec![0.0; n];
                system.residual_force(&mut ws, &state, &u, &next, dt, &mut force, None).unwrap();
                force
            };
            let (up, down) = (value(1e-5), value(-1e-5));
            for i in 0..n {
                let difference = (up[i] - down[i]) / 2e-5;
                assert!((block[i * columns + k] - difference).abs() < 1e-8, "{name} {i} {k}: {} {difference}", block[i * columns + k]);
            }
        }
    };
    let plus = |x: &[f64], k: usize, h: f64| x.iter().enumerate().map(|(i, x)| if i == k { x + h } else { *x }).collect::<Vec<_>>();
    compare("q", &jacobians.d_q, n, &|k, h| {
        let mut moved = state.clone();
        base.multibody().integrate(&mut moved.q, &plus(&vec![0.0; n], k, h), 1.0).unwrap();
        (base.clone(), moved, u.clone(), next.clone())
    });
    compare("v", &jacobians.d_v, n, &|k, h| (base.clone(), State { v: plus(&state.v, k, h), ..state.clone() }, u.clone(), next.clone()));
    compare("u", &jacobians.d_u, n, &|k, h| (base.clone(), state.clone(), plus(&u, k, h), next.clone()));
    compare("next", &jacobians.d_next, n, &|k, h| (base.clone(), state.clone(), u.clone(), plus(&next, k, h)));
    compare("weights", &jacobians.d_weights, weights.len(), &|k, h| {
        let (mut system, mut moved) = (base.clone(), residual.clone());
        moved.set_weights(&plus(&weights, k, h)).unwrap();
        system.set_residual(Some(&moved)).unwrap();
        (system, state.clone(), u.clone(), next.clone())
    });
}

fn effect(name: &str, joint: &str, parameters: &[(&str, f64)]) -> EffectEntry {
    let parameters: BTreeMap<_, _> = parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect();
    EffectEntry { effect: name.into(), joint: Some(joint.into()), parameters, ..EffectEntry::default() }
}

/// Motion of a system under slow random efforts, at steps of 5 ms.
fn record(system: &System, steps: usize, seed: u64) -> Sequence {
    let mut rng = random(seed);
    let (mut state, mut ws) = (system.state(), system.workspace());
    state.q[0] = rng.random_range(-0.8..0.8);
    let phases: Vec<f64> = random_vector(6, 3.0, &mut rng);
    let mut sequence = Sequence { states: vec![state.clone()], tau: Vec::new() };
    for k in 0..steps {
        let t = 5e-3 * k as f64;
        let tau = 2.5 * (1.7 * t + phases[0]).sin() + 2.0 * (4.1 * t + phases[1]).sin() + phases[2] * 0.3;
        system.step(&mut ws, &mut state, &Input { tau: &[tau], external: &[] }, 5e-3).unwrap();
        sequence.states.push(state.clone());
        sequence.tau.push(tau);
    }
    sequence
}

#[test]
fn it_learns_an_effect_that_the_model_lacks_and_holds_on_motion_it_has_not_seen() {
    // The world has a spring that the model does not know.
    let rod = pendulum(1.0, 0.4, 0.02, "<dynamics damping='0.2' friction='0'/>");
    let mut world = System::new(&[welded(&rod)]).unwrap();
    world.add_effect("pendulum", &effect("joint_spring", "hinge", &[("stiffness", 4.0), ("rest_position", 0.3)])).unwrap();
    // Enough motion to cover where the unseen one goes.
    let train: Vec<Sequence> = (0..8).map(|k| record(&world, 400, k)).collect();
    let unseen: Vec<Sequence> = (10..12).map(|k| record(&world, 400, k)).collect();
    let model = System::new(&[welded(&rod)]).unwrap();
    for horizon in [1, 8] {
        let mut learner = model.clone();
        let residual = Residual::new(learner.multibody(), &["hinge"], &["hinge"], &[12], Activation::Tanh, 5).unwrap();
        learner.set_residual(Some(&residual)).unwrap();
        let trainer = Trainer { dt: 5e-3, horizon, epochs: 30, ..Trainer::default() };
        let report = trainer.train(&mut learner, &train, &unseen).unwrap();
        let (before, after) = (report.held_out[0], report.held_out[report.best]);
        println!("horizon {horizon}: held-out loss {before:.3} before, {after:.2e} after {} epochs", report.best);
        assert!(after < 0.01 * before, "horizon {horizon}: {before} {after}");
        // Long motion that nothing was fitted to: two seconds, not one step.
        let sequence = record(&world, 400, 20);
        let error = |system: &System| {
            let (mut ws, mut state, mut sum) = (system.workspace(), sequence.states[0].clone(), 0.0);
            for (tau, wanted) in sequence.tau.iter().zip(&sequence.states[1..]) {
                system.step(&mut ws, &mut state, &Input { tau: &[*tau], external: &[] }, 5e-3).unwrap();
                sum += (state.q[0] - wanted.q[0]).powi(2);
            }
            (sum / 400.0).sqrt()
        };
        let (without, with) = (error(&model), error(&learner));
        println!("two seconds ahead: off by {without:.3} rad without, {with:.4} with");
        assert!(with < 0.1 * without, "{with} {without}");
        // The same training gives the same bits, and says so.
        let mut again = model.clone();
        again.set_residual(Some(&residual)).unwrap();
        let short = Trainer { epochs: 2, ..trainer };
        let (a, b) = (short.train(&mut again, &train, &unseen).unwrap(), {
            let mut twin = model.clone();
            twin.set_residual(Some(&residual)).unwrap();
            short.train(&mut twin, &train, &unseen).unwrap()
        });
        assert_eq!(a, b);
        assert_eq!(learner.residual().unwrap().training_hash(), report.hash);
    }
}

#[test]
fn friction_holds_a_joint_against_a_small_residual() {
    let mut system =
        System::new(&[welded(&slide(2.0, "<limit lower='-1' upper='1' velocity='9' effort='9'/><dynamics damping='0' friction='3'/>"))])
            .unwrap();
    let mut residual = Residual::new(system.multibody(), &["slide"], &["slide"], &[2], Activation::Tanh, 1).unwrap();
    let mut weights = residual.network().weights().to_vec();
    let last = weights.len() - 1;
    for (force, moves) in [(2.9, false), (3.5, true), (1e6, true)] {
        weights[last] = force;
        residual.set_weights(&weights).unwrap();
        system.set_residual(Some(&residual)).unwrap();
        let (mut ws, mut state) = (system.workspace(), system.state());
        for _ in 0..100 {
            system.step(&mut ws, &mut state, &Input::default(), 1e-3).unwrap();
        }
        assert_eq!(state.q[0] > 0.0, moves, "{force} N: {state:?}");
        assert!(state.q[0] <= 1.0 + 1e-12, "through the limit: {state:?}");
    }
}

#[test]
fn an_untrained_residual_changes_no_bit_of_the_motion() {
    let zoo = menagerie(false);
    let plain = System::new(&[welded(&zoo)]).unwrap();
    let mut with = plain.clone();
    with.set_residual(Some(&Residual::new(with.multibody(), &["ja", "jd"], &["ja"], &[8], Activation::Tanh, 1).unwrap())).unwrap();
    let run = |system: &System| {
        let (mut ws, mut state) = (system.workspace(), system.state());
        for _ in 0..50 {
            system.step(&mut ws, &mut state, &Input::default(), 1e-3).unwrap();
        }
        state
    };
    assert_eq!(run(&plain), run(&with));
}

#[test]
fn files_bring_every_bit_back_and_equal_residuals_are_equal_files() {
    let system = System::new(&[welded(&menagerie(false))]).unwrap();
    let mut residual = Residual::new(system.multibody(), &["ja", "jd"], &["ja"], &[8, 3], Activation::Silu, 9).unwrap();
    let mut normalisation = residual.network().normalisation().clone();
    normalisation.input_mean.iter_mut().enumerate().for_each(|(k, x)| *x = 0.1 + k as f64 / 3.0);
    residual.set_normalisation(normalisation).unwrap();
    let bytes = residual.to_bytes().unwrap();
    assert_eq!(Residual::from_bytes(&bytes).unwrap(), residual);
    for _ in 0..5 {
        assert_eq!(residual.to_bytes().unwrap(), bytes);
    }
}

#[test]
fn broken_files_are_refused_with_a_reason() {
    let system = System::new(&[welded(&slide(1.0, common::WIDE))]).unwrap();
    let residual = Residual::new(system.multibody(), &["slide"], &["slide"], &[4], Activation::Tanh, 9).unwrap();
    let bytes = residual.to_bytes().unwrap();
    let refuse = |bytes: &[u8], word: &str| {
        let error = Residual::from_bytes(bytes).unwrap_err().to_string();
        assert!(error.contains(word), "'{word}' is not in: {error}");
    };
    for length in [0, 4, 8, 40, bytes.len() / 2, bytes.len() - 1] {
        refuse(&bytes[..length], "whole safetensors file");
    }
    // NaN in the last weight.
    let mut broken = bytes.clone();
    let end = broken.len();
    broken[end - 8..].copy_from_slice(&f64::NAN.to_le_bytes());
    refuse(&broken, "finite number");
    let with = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        let mut changed = bytes.clone();
        changed[at..at + to.len()].copy_from_slice(to.as_bytes());
        changed
    };
    refuse(&with("tanh", "sine"), "sine");
    refuse(&with("layers.1.bias", "layers.7.bias"), "layers.7.bias");
    refuse(&with("\\\"schema\\\":1", "\\\"schema\\\":8"), "schema 8");
    refuse(&with("[4,4,1]", "[4,9,1]"), "is needed");
    refuse(&with("[4,4,1]", "[4,0,1]"), "width");
    // Weights of something else.
    let view = TensorView::new(Dtype::F64, vec![1], &[0; 8]).unwrap();
    let other = safetensors::serialize([("w", view)], Some(HashMap::from([("by".to_string(), "hand".to_string())]))).unwrap();
    refuse(&other, "something else");
    // Bits flipped anywhere: an error or a residual, never a panic, and never a number that is not finite.
    let mut rng = random(1);
    for _ in 0..2000 {
        let mut changed = bytes.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..changed.len());
            changed[at] = rng.random_range(0..=255);
        }
        if let Ok(read) = Residual::from_bytes(&changed) {
            assert!(read.network().weights().iter().all(|w| w.is_finite()));
            let _ = system.clone().set_residual(Some(&read));
        }
    }
    // Made for other joints.
    let mut wrong = System::new(&[welded(&menagerie(false))]).unwrap();
    assert!(wrong.set_residual(Some(&residual)).is_err());
}
