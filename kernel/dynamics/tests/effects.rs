//! Every effect of the catalogue: its derivatives, its names, its bounds.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;

use common::{WIDE, pendulum, random, slide, welded};
use rand::RngExt;
use sagci_dynamics::effects::{Instant, MAX_PARAMETERS, Parameter, Prior, Resistance, catalogue, find};
use sagci_dynamics::{DynamicsError, System};
use sagci_model::EffectEntry;

/// A value as the prior expects it.
fn draw(parameter: &Parameter, kind: usize, rng: &mut rand_pcg::Pcg64) -> f64 {
    let normal: f64 = (0..12).map(|_| rng.random_range(0.0..1.0)).sum::<f64>() - 6.0;
    match parameter.prior[kind] {
        Prior::LogNormal { median, spread } => median * (0.5 * spread * normal).exp(),
        Prior::Normal { mean, deviation } => mean + 0.5 * deviation * normal,
        Prior::OneOf(choices) => choices[rng.random_range(0..choices.len())],
    }
}

#[test]
fn partial_derivatives_agree_with_central_differences() {
    for effect in catalogue() {
        let description = effect.description();
        let mut rng = random(31);
        let mut pushed = 0;
        for trial in 0..200 {
            let kind = trial % 2;
            let theta: Vec<f64> = description.parameters.iter().map(|p| draw(p, kind, &mut rng)).collect();
            let mut z = vec![0.0; effect.states()];
            z.iter_mut().for_each(|z| *z = rng.random_range(-1.0..1.0));
            let (q, v) = (rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            let total = |q: f64, v: f64, theta: &[f64]| {
                let mut resistance = Resistance::default();
                effect.resist(theta, &Instant { q, v, input: 0.3, load: -0.2, time: 1.0, z: &z }, &mut resistance);
                assert!(resistance.dry.value >= 0.0);
                resistance.total(v)
            };
            let here = total(q, v, &theta);
            pushed += usize::from(here.value != 0.0);
            let close = |name: &str, ours: f64, plus: f64, minus: f64, h: f64| {
                let theirs = (plus - minus) / (2.0 * h);
                let scale = 1.0 + ours.abs().max(here.value.abs());
                assert!((ours - theirs).abs() < 1e-6 * scale, "{}: by {name}: {ours} {theirs}", description.name);
            };
            let h = 1e-6;
            close("q", here.d_q, total(q + h, v, &theta).value, total(q - h, v, &theta).value, h);
            close("v", here.d_v, total(q, v + h, &theta).value, total(q, v - h, &theta).value, h);
            for (i, parameter) in description.parameters.iter().enumerate() {
                if matches!(parameter.prior[kind], Prior::OneOf(_)) {
                    continue;
                }
                let h = 1e-6 * theta[i].abs().max(1.0);
                let moved = |by: f64| {
                    let mut theta = theta.clone();
                    theta[i] += by;
                    total(q, v, &theta).value
                };
                close(parameter.name, here.d_theta[i], moved(h), moved(-h), h);
            }
        }
        assert!(pushed > 20, "{} is hardly ever active in this test", description.name);
    }
}

#[test]
fn every_effect_describes_itself_fully() {
    for (i, effect) in catalogue().iter().enumerate() {
        let d = effect.description();
        assert!(!d.source.is_empty() && !d.summary.is_empty() && d.parameters.len() <= MAX_PARAMETERS);
        assert!(catalogue().iter().skip(i + 1).all(|e| e.description().name != d.name));
        assert_eq!(find(d.name).unwrap().description().name, d.name);
        for p in d.parameters {
            assert!(p.bounds[0] <= p.bounds[1] && p.unit.iter().all(|u| !u.is_empty()));
            for prior in p.prior {
                let typical = match prior {
                    Prior::LogNormal { median, .. } => median,
                    Prior::Normal { mean, .. } => mean,
                    Prior::OneOf(choices) => choices[0],
                };
                assert!(typical >= p.bounds[0] && typical <= p.bounds[1], "{}: {}", d.name, p.name);
            }
        }
    }
    for name in ["viscous_friction", "coulomb_friction", "joint_spring", "hard_stop"] {
        find(name).unwrap();
    }
}

fn entry(effect: &str, joint: Option<&str>, parameters: &[(&str, f64)]) -> EffectEntry {
    EffectEntry {
        effect: effect.into(),
        joint: joint.map(Into::into),
        parameters: parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect(),
    }
}

fn refusal(entry: &EffectEntry) -> String {
    let mut system = System::new(&[welded(&slide(1.0, WIDE))]).unwrap();
    system.add_effect("slide", entry).unwrap_err().to_string()
}

#[test]
fn misspelt_names_are_refused_with_the_nearest_one() {
    let spring = [("stiffness", 1.0), ("rest_position", 0.0)];
    let message = refusal(&entry("joint_sprig", Some("slide"), &spring));
    assert!(message.contains("did you mean 'joint_spring'"), "{message}");
    let message = refusal(&entry("joint_spring", Some("slide"), &[("stifness", 1.0), ("rest_position", 0.0)]));
    assert!(message.contains("did you mean 'stiffness'"), "{message}");
    let message = refusal(&entry("joint_spring", Some("slid"), &spring));
    assert!(message.contains("did you mean 'slide'"), "{message}");
}

#[test]
fn wrong_values_are_refused() {
    for (name, parameters, word) in [
        ("joint_spring", vec![("stiffness", 1.0)], "rest_position"),
        ("joint_spring", vec![("stiffness", -1.0), ("rest_position", 0.0)], "stiffness"),
        ("viscous_friction", vec![("damping", f64::NAN)], "damping"),
        ("hard_stop", vec![("stiffness", 1.0), ("dissipation", 0.0), ("position", 0.0), ("side", 0.5)], "side"),
    ] {
        let message = refusal(&entry(name, Some("slide"), &parameters));
        assert!(message.contains(word), "{message}");
    }
    let message = refusal(&entry("viscous_friction", None, &[("damping", 1.0)]));
    assert!(message.contains("names no joint") || message.contains("joint"), "{message}");
}

#[test]
fn effects_of_the_model_act_and_urdf_losses_are_effects() {
    let mut model = pendulum(1.0, 0.3, 0.01, "<dynamics damping='0.4' friction='0.3'/>");
    model.document.effects.push(entry("joint_spring", Some("hinge"), &[("stiffness", 7.0), ("rest_position", 0.2)]));
    let system = System::new(&[welded(&model)]).unwrap();
    let names: Vec<_> = system.placements().iter().map(|p| p.effect.description().name).collect();
    assert_eq!(names, ["viscous_friction", "coulomb_friction", "joint_spring"]);
    assert_eq!(system.parameters(), [0.4, 0.3, 7.0, 0.2]);
    let mut state = system.state();
    (state.q[0], state.v[0]) = (0.5, 2.0);
    let mut tau = [0.0];
    let mut ws = system.workspace();
    system.inverse_dynamics(&mut ws, &state, &[3.0], &[], &mut tau).unwrap();
    // I a + m g l sin q + c v + f + k (q - q0)
    let expected = (0.01 + 0.09) * 3.0 + 9.81 * 0.3 * 0.5_f64.sin() + 0.4 * 2.0 + 0.3 + 7.0 * 0.3;
    assert!((tau[0] - expected).abs() < 1e-12, "{} {expected}", tau[0]);
}

#[test]
fn an_effect_on_a_missing_joint_of_a_model_names_the_model() {
    let mut model = slide(1.0, WIDE);
    model.document.effects.push(entry("torque_ripple_of_no_name", Some("slide"), &[]));
    assert!(matches!(System::new(&[welded(&model)]), Err(DynamicsError::Build { part, .. }) if part == "slide"));
}
