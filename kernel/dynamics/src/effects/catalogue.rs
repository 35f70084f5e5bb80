//! The list of effects, effects from what a `model.yaml` says, and the catalogue's page.

use std::fmt::Write;

use sagci_model::EffectEntry;

use super::{Acts, Description, Effect, Multiple, Parameter, Prior};
use crate::DynamicsError;
use crate::error::hint;

/// In the order in which people look for them: losses, forces by position, drives, bodies, sensors, the rest.
static CATALOGUE: &[&dyn Effect] = &[
    &super::viscous_friction::ViscousFriction,
    &super::coulomb_friction::CoulombFriction,
    &super::asymmetric_friction::AsymmetricFriction,
    &super::stribeck_friction::StribeckFriction,
    &super::quadratic_drag::QuadraticDrag,
    &super::presliding_hysteresis::PreslidingHysteresis,
    &super::load_dependent_friction::LoadDependentFriction,
    &super::position_dependent_friction::PositionDependentFriction,
    &super::joint_spring::JointSpring,
    &super::hinge_tilt::HingeTilt,
    &super::cable_hysteresis::CableHysteresis,
    &super::torque_bias::TorqueBias,
    &super::magnetic_gasket::MagneticGasket,
    &super::air_suction::AirSuction,
    &super::latch::Latch,
    &super::detent::Detent,
    &super::soft_close_damper::SoftCloseDamper,
    &super::hard_stop::HardStop,
    &super::backlash::Backlash,
    &super::joint_elasticity::JointElasticity,
    &super::torque_ripple::TorqueRipple,
    &super::transport_delay::TransportDelay,
    &super::actuator_lag::ActuatorLag,
    &super::armature_inertia::ArmatureInertia,
    &super::torque_gain::TorqueGain,
    &super::actuator_saturation::ActuatorSaturation,
    &super::payload::Payload,
    &super::joint_axis_error::JointAxisError,
    &super::encoder_offset::EncoderOffset,
    &super::sensor_drift::SensorDrift,
    &super::clock_skew::ClockSkew,
    &super::thermal_wear::ThermalWear,
    &super::unmodelled_mode::UnmodelledMode,
];

/// All effects.
pub fn catalogue() -> &'static [&'static dyn Effect] {
    CATALOGUE
}

/// An effect by its name.
///
/// # Errors
/// There is none of this name.
pub fn find(name: &str) -> Result<&'static dyn Effect, DynamicsError> {
    CATALOGUE.iter().copied().find(|e| e.description().name == name).ok_or_else(|| DynamicsError::Unknown {
        kind: "effect".into(),
        name: name.into(),
        hint: hint(name, CATALOGUE.iter().map(|e| e.description().name)),
    })
}

/// The effect that an entry of `model.yaml` names, and its parameters in the effect's order.
///
/// # Errors
/// An unknown effect, parameter or choice; a parameter that is missing, not finite or out of its bounds.
pub fn parameters_of(entry: &EffectEntry) -> Result<(&'static dyn Effect, Vec<f64>), DynamicsError> {
    let effect = find(&entry.effect)?;
    Ok((effect, order(effect.description(), entry)?))
}

/// Checks one parameter's value.
///
/// # Errors
/// It is not finite, out of its bounds, or none of its choices; the message names effect and parameter.
pub(crate) fn check_parameter(description: &Description, parameter: &Parameter, value: f64) -> Result<f64, DynamicsError> {
    let what = || format!("{}: {}", description.name, parameter.name);
    let [least, most] = parameter.bounds;
    if !(value.is_finite() && value >= least && value <= most) {
        return Err(DynamicsError::OutOfBounds { what: what(), value, must: format!("a number from {least} to {most}") });
    }
    match parameter.prior[0] {
        Prior::OneOf(choices) if !choices.contains(&value) => {
            Err(DynamicsError::OutOfBounds { what: what(), value, must: format!("one of {choices:?}") })
        }
        _ => Ok(value),
    }
}

fn order(description: &'static Description, entry: &EffectEntry) -> Result<Vec<f64>, DynamicsError> {
    let unknown = |kind: String, name: &str, names: &mut dyn Iterator<Item = &'static str>| {
        let names: Vec<&str> = names.collect();
        DynamicsError::Unknown { kind, name: name.into(), hint: hint(name, names.iter().copied()) }
    };
    let (numbers, choices): (Vec<&Parameter>, Vec<&Parameter>) = description.parameters.iter().partition(|p| p.words.is_empty());
    for (kind, given, known) in [
        ("parameter", entry.parameters.keys().collect::<Vec<_>>(), &numbers),
        ("choice", entry.choices.keys().collect::<Vec<_>>(), &choices),
    ] {
        if let Some(name) = given.into_iter().find(|k| !known.iter().any(|p| p.name == *k)) {
            return Err(unknown(format!("{kind} of {}", description.name), name, &mut known.iter().map(|p| p.name)));
        }
    }
    let value = |p: &'static Parameter| {
        if p.words.is_empty() {
            let value = entry.parameters.get(p.name).copied().or(p.absent).ok_or_else(|| DynamicsError::OutOfBounds {
                what: format!("{}: {}", description.name, p.name),
                value: f64::NAN,
                must: format!("given, in {} or {}", p.unit[0], p.unit[1]),
            })?;
            return check_parameter(description, p, value);
        }
        let Some(word) = entry.choices.get(p.name) else { return Ok(0.0) };
        let index = p.words.iter().position(|w| w == word);
        // The words stand for 0, 1, ... in their order.
        index.map(|i| i as f64).ok_or_else(|| unknown(format!("{} of {}", p.name, description.name), word, &mut p.words.iter().copied()))
    };
    description.parameters.iter().map(value).collect()
}

/// The catalogue as a page of Markdown: a table of the effects, and one of their parameters.
pub fn page() -> String {
    let mut text = String::from(
        "# Effects\n\n| effect | what it does | signature | taken for | told apart by | source |\n|---|---|---|---|---|---|\n",
    );
    let bar = |s: &str| s.replace('|', "\\|");
    for d in CATALOGUE.iter().map(|e| e.description()) {
        let _ = writeln!(
            text,
            "| `{}` | {} | {} | {} | {} | {} |",
            d.name,
            bar(d.summary),
            d.signature,
            d.confused_with.join(", "),
            d.experiment,
            d.source
        );
    }
    text += "\n| effect | acts on | parameter | unit | bounds | expected (turning) | expected (sliding) |\n|---|---|---|---|---|---|---|\n";
    for d in CATALOGUE.iter().map(|e| e.description()) {
        for p in d.parameters {
            let mut row = |name: &str, unit: [&str; 2], prior: [Prior; 2]| {
                let unit = if unit[0] == unit[1] { unit[0].to_owned() } else { unit.join(", ") };
                let [turning, sliding] = prior.map(|prior| expected(p, &prior));
                let bounds = format!("{} to {}", p.bounds[0], p.bounds[1]);
                let _ = writeln!(text, "| `{}` | {} | {name} | {unit} | {bounds} | {turning} | {sliding} |", d.name, acts(d.acts));
            };
            let name = format!("`{}`", p.name);
            row(&name, p.unit, p.prior);
            let choice = d.parameters.iter().find_map(|c| Some((c.name, c.words.get(1)?)));
            if let (Some(second), Some((of, word))) = (p.of_second, choice) {
                row(&format!("{name}, `{of}: {word}`"), second.unit, second.prior);
            }
        }
    }
    text
}

fn acts(acts: Acts) -> &'static str {
    match acts {
        Acts::Joint => "joint",
        Acts::Command(_) => "command",
        Acts::Measurement(_) => "measurement",
        Acts::Bodies => "bodies",
        Acts::Losses => "losses",
        Acts::Base => "base",
    }
}

fn expected(parameter: &Parameter, prior: &Prior) -> String {
    let cited = if parameter.cited { " (cited)" } else { "" };
    // Nine in ten lie between.
    let reach = |spread: f64| (1.645 * spread).exp();
    if let Some(Multiple { of, median, spread }) = parameter.multiple {
        return format!("{:.2} to {:.2} times `{of}`{cited}", median / reach(spread), median * reach(spread));
    }
    match prior {
        Prior::LogNormal { median, spread } => format!("{:.2e} to {:.2e}{cited}", median / reach(*spread), median * reach(*spread)),
        Prior::Normal { mean, deviation } => format!("{mean} +- {deviation}{cited}"),
        Prior::OneOf(values) if parameter.words.is_empty() => format!("one of {values:?}"),
        Prior::OneOf(_) => parameter.words.join(" or "),
    }
}
