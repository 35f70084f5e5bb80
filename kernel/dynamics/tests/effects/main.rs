//! Every effect of the catalogue: its names and bounds, its derivatives, its physics, and steps with it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod catalogue;
#[path = "../common/mod.rs"]
mod common;
mod partials;
mod physics;
mod steps;

use rand::RngExt;
use sagci_dynamics::effects::{Effect, Parameter, Prior};
use sagci_dynamics::{Input, State, System};
use sagci_model::EffectEntry;

/// A value as the prior expects it, within the bounds.
fn draw(parameter: &Parameter, kind: usize, rng: &mut rand_pcg::Pcg64) -> f64 {
    let normal: f64 = (0..12).map(|_| rng.random_range(0.0..1.0)).sum::<f64>() - 6.0;
    let [least, most] = parameter.bounds;
    match parameter.prior[kind] {
        Prior::LogNormal { median, spread } => median * (0.5 * spread * normal).exp(),
        Prior::Normal { mean, deviation } => mean + 0.5 * deviation * normal,
        Prior::OneOf(choices) => choices[rng.random_range(0..choices.len())],
    }
    .clamp(least, most)
}

fn draw_all(effect: &dyn Effect, kind: usize, rng: &mut rand_pcg::Pcg64) -> Vec<f64> {
    effect.description().parameters.iter().map(|p| draw(p, kind, rng)).collect()
}

fn entry(effect: &str, joint: Option<&str>, parameters: &[(&str, f64)]) -> EffectEntry {
    EffectEntry {
        effect: effect.into(),
        joint: joint.map(Into::into),
        parameters: parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect(),
        ..EffectEntry::default()
    }
}

/// A block of a mass on a slide, with effects on it.
fn block(mass: f64, effects: &[(&str, &[(&str, f64)])]) -> System {
    let mut model = common::slide(mass, common::WIDE);
    model.joints[0].limits = sagci_model::JointLimits::NONE;
    let mut system = System::new(&[common::welded(&model)]).unwrap();
    for (name, parameters) in effects {
        system.add_effect("slide", &entry(name, Some("slide"), parameters)).unwrap();
    }
    system
}

/// Steps with an input over time, and looks after each step.
fn run(system: &System, state: &mut State, dt: f64, steps: usize, mut input: impl FnMut(&State) -> f64, mut look: impl FnMut(&State)) {
    let mut ws = system.workspace();
    for _ in 0..steps {
        let tau = [input(state)];
        system.step(&mut ws, state, &Input { tau: &tau, ..Input::default() }, dt).unwrap();
        look(state);
    }
}
