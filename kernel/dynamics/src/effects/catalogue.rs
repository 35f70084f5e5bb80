//! The list of effects, and effects from what a `model.yaml` says.

use std::collections::BTreeMap;

use sagci_model::EffectEntry;

use super::coulomb_friction::CoulombFriction;
use super::hard_stop::HardStop;
use super::joint_spring::JointSpring;
use super::viscous_friction::ViscousFriction;
use super::{Description, Effect, Prior};
use crate::DynamicsError;
use crate::error::hint;

static CATALOGUE: &[&dyn Effect] = &[&ViscousFriction, &CoulombFriction, &JointSpring, &HardStop];

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
/// An unknown effect or parameter, a parameter that is missing, not finite or out of its bounds.
pub fn parameters_of(entry: &EffectEntry) -> Result<(&'static dyn Effect, Vec<f64>), DynamicsError> {
    let effect = find(&entry.effect)?;
    Ok((effect, order(effect.description(), &entry.parameters)?))
}

fn order(description: &'static Description, given: &BTreeMap<String, f64>) -> Result<Vec<f64>, DynamicsError> {
    let names = description.parameters.iter().map(|p| p.name);
    if let Some(name) = given.keys().find(|k| !names.clone().any(|n| n == *k)) {
        let kind = format!("parameter of {}", description.name);
        return Err(DynamicsError::Unknown { kind, name: name.clone(), hint: hint(name, names) });
    }
    description
        .parameters
        .iter()
        .map(|p| {
            let what = format!("{}: {}", description.name, p.name);
            let Some(&value) = given.get(p.name) else {
                return Err(DynamicsError::OutOfBounds {
                    what,
                    value: f64::NAN,
                    must: format!("given, in {} or {}", p.unit[0], p.unit[1]),
                });
            };
            let [least, most] = p.bounds;
            if !(value.is_finite() && value >= least && value <= most) {
                return Err(DynamicsError::OutOfBounds { what, value, must: format!("a number from {least} to {most}") });
            }
            match p.prior[0] {
                Prior::OneOf(choices) if !choices.contains(&value) => {
                    Err(DynamicsError::OutOfBounds { what, value, must: format!("one of {choices:?}") })
                }
                _ => Ok(value),
            }
        })
        .collect()
}
