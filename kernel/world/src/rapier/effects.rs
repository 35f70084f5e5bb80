//! What acts at a joint beside the drives: damping, dry friction, and the named effects of a model.
//!
//! Signs as in the catalogue of effects: `dtau` is the force that resists; it is subtracted. Viscous damping and armature
//! go into the mass matrix (implicit), dry friction is a bounded constraint (it sticks), the rest is a force given anew
//! in every step.

use std::collections::BTreeMap;

use nalgebra::ComplexField;
use sagci_model::{EffectEntry, ObjectModel};

use crate::perturbation::DrawnJoint;

/// The effects of one joint.
#[derive(Debug, Clone)]
pub(super) struct JointEffects {
    terms: Vec<Term>,
}

/// One effect with its parameters. `q` in rad or m, `v` in rad/s or m/s.
#[derive(Debug, Clone, PartialEq)]
enum Term {
    Viscous {
        damping: f64,
    },
    Coulomb {
        friction: f64,
    },
    /// (Fc + (Fs - Fc) exp(-|v/vs|^a)) sgn v. Armstrong-Helouvry, Dupont, Canudas de Wit 1994.
    Stribeck {
        friction: f64,
        static_friction: f64,
        stribeck_velocity: f64,
        exponent: f64,
    },
    Asymmetric {
        friction: [f64; 2],
        damping: [f64; 2],
    },
    Drag {
        drag: f64,
    },
    /// (F + A exp(-x^2/2)) sgn v, x = (q - position) / width.
    Position {
        friction: f64,
        amplitude: f64,
        position: f64,
        width: f64,
    },
    Armature {
        inertia: f64,
    },
    Bias {
        bias: f64,
    },
    Spring {
        stiffness: f64,
        rest_position: f64,
    },
    Tilt {
        amplitude: f64,
        phase: f64,
    },
    /// A sin(n q + phase).
    Ripple {
        amplitude: f64,
        cycles_per_turn: f64,
        phase: f64,
    },
    /// F exp(-q / w).
    Gasket {
        force: f64,
        width: f64,
    },
    /// F x exp(1/2 - x^2/2), x = (q - position) / width.
    Detent {
        force: f64,
        position: f64,
        width: f64,
    },
    /// Below `position`: damping v while closing, and stiffness q.
    SoftClose {
        damping: f64,
        position: f64,
        stiffness: f64,
    },
    /// (k d + l d dd)+ beyond `position`. Hunt, Crossley 1975.
    HardStop {
        stiffness: f64,
        dissipation: f64,
        position: f64,
        side: f64,
    },
}

/// Names that [`JointEffects`] knows, for messages.
const KNOWN: [&str; 15] = [
    "viscous_friction",
    "coulomb_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "quadratic_drag",
    "position_dependent_friction",
    "armature_inertia",
    "torque_bias",
    "joint_spring",
    "hinge_tilt",
    "torque_ripple",
    "magnetic_gasket",
    "detent",
    "soft_close_damper",
    "hard_stop",
];

/// Was the effect estimated from measurements, not written by hand? What this world cannot simulate of those, it does not have: an estimate
/// may name anything in the catalogue, and the object has to be usable all the same.
fn was_estimated(entry: &EffectEntry) -> bool {
    entry.evidence.is_some()
}

impl JointEffects {
    /// The effects of `model`'s joint, with the factors that were drawn on damping and friction.
    pub(super) fn new(model: &ObjectModel, joint: usize, drawn: &DrawnJoint) -> Result<Self, String> {
        let j = &model.joints[joint];
        let mut terms = vec![
            Term::Viscous { damping: j.damping * drawn.damping_factor + drawn.extra_damping },
            Term::Coulomb { friction: j.friction * drawn.friction_factor + drawn.extra_friction },
        ];
        for entry in model.document.effects.iter().filter(|e| e.joint.as_deref() == Some(&j.name)) {
            match Term::read(entry) {
                Ok(term) => terms.push(term.scaled(drawn)),
                Err(_) if was_estimated(entry) => {}
                Err(message) => return Err(message),
            }
        }
        Ok(Self { terms })
    }

    /// Adds an effect that the model does not have, as it is: what was drawn on the model's numbers does not scale it.
    pub(super) fn hide(&mut self, entry: &EffectEntry) -> Result<(), String> {
        self.terms.push(Term::read(entry)?);
        Ok(())
    }

    /// Checks that every effect of a model names a joint and is known here.
    pub(super) fn check(model: &ObjectModel) -> Result<(), String> {
        for entry in model.document.effects.iter().filter(|e| !was_estimated(e)) {
            match &entry.joint {
                Some(name) if model.joint(name).is_some() => {
                    Term::read(entry)?;
                }
                Some(name) => return Err(format!("the effect {} acts on the joint '{name}', which does not exist", entry.effect)),
                None => return Err(format!("the effect {} names no joint; add `joint:` to it", entry.effect)),
            }
        }
        Ok(())
    }

    /// Viscous damping, for the mass matrix.
    pub(super) fn damping(&self) -> f64 {
        self.terms.iter().map(|t| if let Term::Viscous { damping } = t { *damping } else { 0.0 }).sum()
    }

    /// Armature, for the mass matrix.
    pub(super) fn armature(&self) -> f64 {
        self.terms.iter().map(|t| if let Term::Armature { inertia } = t { *inertia } else { 0.0 }).sum()
    }

    /// Greatest dry friction in this state.
    pub(super) fn friction(&self, q: f64, v: f64) -> f64 {
        let total: f64 = self
            .terms
            .iter()
            .map(|term| match term {
                Term::Coulomb { friction } => *friction,
                Term::Stribeck { friction, static_friction, stribeck_velocity, exponent } => {
                    let ratio = ComplexField::powf((v / stribeck_velocity).abs(), *exponent);
                    friction + (static_friction - friction) * ComplexField::exp(-ratio)
                }
                Term::Asymmetric { friction, .. } => friction[usize::from(v < 0.0)],
                Term::Position { friction, amplitude, position, width } => {
                    let x = (q - position) / width;
                    friction + amplitude * ComplexField::exp(-x * x / 2.0)
                }
                _ => 0.0,
            })
            .sum();
        total.max(0.0)
    }

    /// Does [`Self::friction`] change with the state?
    pub(super) fn friction_varies(&self) -> bool {
        self.terms.iter().any(|t| matches!(t, Term::Stribeck { .. } | Term::Asymmetric { .. } | Term::Position { .. }))
    }

    /// Force that acts along the joint in this state.
    pub(super) fn force(&self, q: f64, v: f64) -> f64 {
        -self
            .terms
            .iter()
            .map(|term| match term {
                Term::Drag { drag } => drag * v * v.abs(),
                Term::Asymmetric { damping, .. } => damping[usize::from(v < 0.0)] * v,
                Term::Bias { bias } => *bias,
                Term::Spring { stiffness, rest_position } => stiffness * (q - rest_position),
                Term::Tilt { amplitude, phase } => amplitude * ComplexField::sin(q + phase),
                Term::Ripple { amplitude, cycles_per_turn, phase } => amplitude * ComplexField::sin(cycles_per_turn * q + phase),
                Term::Gasket { force, width } => force * ComplexField::exp(-q.max(0.0) / width),
                Term::Detent { force, position, width } => {
                    let x = (q - position) / width;
                    force * x * ComplexField::exp(0.5 - x * x / 2.0)
                }
                Term::SoftClose { damping, position, stiffness } => {
                    if q < *position {
                        damping * v.min(0.0) + stiffness * q
                    } else {
                        0.0
                    }
                }
                Term::HardStop { stiffness, dissipation, position, side } => {
                    let depth = side * (q - position);
                    if depth > 0.0 { side * (stiffness * depth + dissipation * depth * side * v).max(0.0) } else { 0.0 }
                }
                Term::Viscous { .. } | Term::Coulomb { .. } | Term::Stribeck { .. } | Term::Position { .. } | Term::Armature { .. } => 0.0,
            })
            .sum::<f64>()
    }
}

impl Term {
    fn read(entry: &EffectEntry) -> Result<Self, String> {
        // Only the defaults are simulated here; taking another choice for them would be a wrong truth.
        if let Some((name, word)) = entry.choices.iter().find(|(name, word)| (name.as_str(), word.as_str()) != ("shape", "exponential")) {
            return Err(format!("the effect {} has {name}: {word}, which is not simulated by this world", entry.effect));
        }
        let p = Parameters { entry, map: &entry.parameters };
        let term = match entry.effect.as_str() {
            "viscous_friction" => Self::Viscous { damping: p.positive("damping")? },
            "coulomb_friction" => Self::Coulomb { friction: p.positive("friction")? },
            "stribeck_friction" => Self::Stribeck {
                friction: p.positive("friction")?,
                static_friction: p.positive("static_friction")?,
                stribeck_velocity: p.above_zero("stribeck_velocity")?,
                exponent: p.above_zero("exponent")?,
            },
            "asymmetric_friction" => Self::Asymmetric {
                friction: [p.positive("friction_positive")?, p.positive("friction_negative")?],
                damping: [p.positive("damping_positive")?, p.positive("damping_negative")?],
            },
            "quadratic_drag" => Self::Drag { drag: p.positive("drag")? },
            "position_dependent_friction" => Self::Position {
                friction: p.positive("friction")?,
                amplitude: p.number("amplitude")?,
                position: p.number("position")?,
                width: p.above_zero("width")?,
            },
            "armature_inertia" => Self::Armature { inertia: p.positive("inertia")? },
            "torque_bias" => Self::Bias { bias: p.number("bias")? },
            "joint_spring" => Self::Spring { stiffness: p.positive("stiffness")?, rest_position: p.number("rest_position")? },
            "hinge_tilt" => Self::Tilt { amplitude: p.number("amplitude")?, phase: p.number("phase")? },
            "torque_ripple" => Self::Ripple {
                amplitude: p.number("amplitude")?,
                cycles_per_turn: p.positive("cycles_per_turn")?,
                phase: p.number("phase")?,
            },
            "magnetic_gasket" => Self::Gasket { force: p.positive("force")?, width: p.above_zero("width")? },
            "detent" => Self::Detent { force: p.number("force")?, position: p.number("position")?, width: p.above_zero("width")? },
            "soft_close_damper" => {
                Self::SoftClose { damping: p.positive("damping")?, position: p.number("position")?, stiffness: p.positive("stiffness")? }
            }
            "hard_stop" => Self::HardStop {
                stiffness: p.positive("stiffness")?,
                dissipation: p.positive("dissipation")?,
                position: p.number("position")?,
                side: p.number("side")?.signum(),
            },
            other => {
                return Err(format!("the effect '{other}' is not simulated by this world; it knows {}", KNOWN.join(", ")));
            }
        };
        Ok(term)
    }

    fn scaled(self, drawn: &DrawnJoint) -> Self {
        match self {
            Self::Viscous { damping } => Self::Viscous { damping: damping * drawn.damping_factor },
            Self::Coulomb { friction } => Self::Coulomb { friction: friction * drawn.friction_factor },
            other => other,
        }
    }
}

struct Parameters<'a> {
    entry: &'a EffectEntry,
    map: &'a BTreeMap<String, f64>,
}

impl Parameters<'_> {
    fn number(&self, name: &str) -> Result<f64, String> {
        match self.map.get(name) {
            Some(value) if value.is_finite() => Ok(*value),
            Some(value) => Err(format!("the effect {} has {name} = {value}, which is not a finite number", self.entry.effect)),
            None => Err(format!("the effect {} lacks its parameter '{name}'", self.entry.effect)),
        }
    }

    fn positive(&self, name: &str) -> Result<f64, String> {
        let value = self.number(name)?;
        if value < 0.0 {
            return Err(format!("the effect {} has {name} = {value}; it cannot be negative", self.entry.effect));
        }
        Ok(value)
    }

    fn above_zero(&self, name: &str) -> Result<f64, String> {
        let value = self.positive(name)?;
        if value == 0.0 {
            return Err(format!("the effect {} has {name} = 0; it must be greater", self.entry.effect));
        }
        Ok(value)
    }
}
