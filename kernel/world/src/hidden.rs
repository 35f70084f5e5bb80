//! Effects that a measured joint has and its stored model lacks, drawn from the seed where a script asks for one.
//!
//! A draw is an entry as a model's document would have it, so that it can be held against an answer, but only this crate ever reads it: the
//! world applies it as a force along the joint, and the judge compares names when the run is over.
//!
//! Sizes are those of household doors and drawers (engineering estimates from EN 1154 closers, refrigerator gaskets by 16 CFR 1750, and
//! handles 0.4 m from their hinge). A force that stores energy stays below the joint's dry friction wherever a joint may be left: a door that
//! shuts itself when the hand lets go could not be opened by any of the skills that would have to find out why.

use sagci_model::{EffectEntry, JointKind, ObjectModel};

use crate::random::{Purpose, Random};

/// Distance of a handle from its hinge, m: turns sizes of hinges, N m, into those of slides, N.
const HANDLE: f64 = 0.4;
/// Speed at which doors are moved, rad/s, and its like for drawers, m/s.
const SPEED: [f64; 2] = [0.35, 0.12];
/// Part of the dry friction that a force that stores energy may use where the joint is left.
const HELD: [f64; 2] = [0.5, 0.75];
/// How far a joint is taken to be opened, as a part of its range.
const OPENED: f64 = 0.75;

/// Effects that can be hidden in a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Family {
    Viscous,
    Coulomb,
    Spring,
    Bias,
    Tilt,
    Gasket,
    Detent,
    Drag,
    Ripple,
    RoughPlace,
    SoftClose,
}

const ALL: [Family; 11] = [
    Family::Viscous,
    Family::Coulomb,
    Family::Spring,
    Family::Bias,
    Family::Tilt,
    Family::Gasket,
    Family::Detent,
    Family::Drag,
    Family::Ripple,
    Family::RoughPlace,
    Family::SoftClose,
];

/// What is known of a joint before an effect is drawn for it.
#[derive(Debug, Clone, Copy)]
struct Joint {
    turns: bool,
    damping: f64,
    /// As modelled, and as drawn for the world.
    friction: [f64; 2],
    lower: f64,
    range: f64,
}

impl Family {
    fn name(self) -> &'static str {
        match self {
            Self::Viscous => "viscous_friction",
            Self::Coulomb => "coulomb_friction",
            Self::Spring => "joint_spring",
            Self::Bias => "torque_bias",
            Self::Tilt => "hinge_tilt",
            Self::Gasket => "magnetic_gasket",
            Self::Detent => "detent",
            Self::Drag => "quadratic_drag",
            Self::Ripple => "torque_ripple",
            Self::RoughPlace => "position_dependent_friction",
            Self::SoftClose => "soft_close_damper",
        }
    }

    /// Can the joint lack it? What the model states above zero it does not lack, and what would move a joint that was let go needs dry
    /// friction to hold it.
    fn fits(self, joint: &Joint) -> bool {
        match self {
            Self::Viscous => joint.damping == 0.0,
            Self::Coulomb => joint.friction[0] == 0.0,
            Self::Spring | Self::Bias => joint.friction[1] > 0.0,
            Self::Tilt | Self::Ripple => joint.friction[1] > 0.0 && joint.turns,
            _ => true,
        }
    }

    fn draw(self, joint: &Joint, random: &mut Random) -> Vec<(&'static str, f64)> {
        let size = if joint.turns { 1.0 } else { 1.0 / HANDLE };
        let speed = SPEED[usize::from(!joint.turns)];
        let place = |part: f64| joint.lower + part * joint.range;
        let mut between = |low: f64, high: f64| random.between(low, high);
        let held = between(HELD[0], HELD[1]) * joint.friction[1];
        match self {
            Self::Viscous => vec![("damping", between(1.0, 3.0) * size / speed)],
            Self::Coulomb => vec![("friction", between(1.0, 3.0) * size)],
            // Strongest at both ends of the way.
            Self::Spring => vec![("stiffness", held / (0.5 * OPENED * joint.range)), ("rest_position", place(0.5 * OPENED))],
            Self::Bias => vec![("bias", if between(-1.0, 1.0) < 0.0 { -held } else { held })],
            // Pulls shut, and not at all where the door is left open.
            Self::Tilt => {
                let phase = std::f64::consts::PI - place(OPENED) + between(-0.2, 0.2);
                vec![("amplitude", between(1.5, 3.0) * size), ("phase", phase)]
            }
            Self::Gasket => vec![("force", between(4.0, 10.0) * size), ("width", between(0.008, 0.02) * joint.range)],
            Self::Detent => {
                let (position, width) = (place(between(0.2, 0.5)), between(0.02, 0.04) * joint.range);
                vec![("force", between(2.0, 5.0) * size), ("position", position), ("width", width)]
            }
            Self::Drag => vec![("drag", between(0.8, 2.0) * size / (speed * speed))],
            Self::Ripple => vec![("amplitude", held), ("cycles_per_turn", between(12.0, 40.0).round()), ("phase", between(-3.0, 3.0))],
            Self::RoughPlace => {
                let (position, width) = (place(between(0.2, 0.5)), between(0.05, 0.1) * joint.range);
                vec![("friction", 0.0), ("amplitude", between(2.0, 5.0) * size), ("position", position), ("width", width)]
            }
            Self::SoftClose => {
                let position = place(between(0.2, 0.4));
                vec![("damping", between(1.5, 4.0) * size / speed), ("position", position), ("stiffness", 0.0)]
            }
        }
    }
}

/// Draws an effect for a joint of the object at `index` in the scene, whose dry friction in the world is `friction`. Nothing if the model
/// lacks none of those that can be hidden.
pub(crate) fn draw(model: &ObjectModel, joint: usize, friction: f64, index: usize, seed: u64) -> Option<EffectEntry> {
    let j = &model.joints[joint];
    let bounded = j.limits.range().is_finite() && j.limits.lower.is_finite();
    let facts = Joint {
        turns: j.kind != JointKind::Prismatic,
        damping: j.damping,
        friction: [j.friction, friction],
        lower: if bounded { j.limits.lower } else { 0.0 },
        range: if bounded { j.limits.range() } else { std::f64::consts::TAU },
    };
    let has = |family: &Family| model.document.effects.iter().any(|e| e.effect == family.name() && e.joint.as_deref() == Some(&j.name));
    let open: Vec<Family> = ALL.into_iter().filter(|f| f.fits(&facts) && !has(f)).collect();
    let random = &mut Random::new(seed, Purpose::Hidden(index));
    let chosen = (random.unit() * open.len() as f64) as usize;
    let family = open.get(chosen).or(open.last())?;
    let parameters = family.draw(&facts, random).into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    Some(EffectEntry { effect: family.name().into(), joint: Some(j.name.clone()), parameters, ..EffectEntry::default() })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::collections::BTreeSet;

    use super::*;
    use crate::testing::model;

    fn drawn(seed: u64) -> EffectEntry {
        draw(&model("door"), 0, 2.0, 0, seed).unwrap()
    }

    #[test]
    fn every_effect_that_the_model_does_not_have_comes_up_and_no_other() {
        let names: BTreeSet<String> = (0..300).map(|seed| drawn(seed).effect).collect();
        // The door states damping and dry friction: they are not missing.
        assert_eq!(names.len(), ALL.len() - 2, "{names:?}");
        assert!(!names.contains("viscous_friction") && !names.contains("coulomb_friction"));
        let mut bare = model("door");
        (bare.joints[0].damping, bare.joints[0].friction) = (0.0, 0.0);
        let names: BTreeSet<String> = (0..300).map(|seed| draw(&bare, 0, 0.0, 0, seed).unwrap().effect).collect();
        assert!(names.contains("viscous_friction") && names.contains("coulomb_friction"));
        assert!(!names.contains("torque_bias"), "nothing would hold the door: {names:?}");
    }

    #[test]
    fn one_seed_draws_one_effect_and_another_object_another_one() {
        assert_eq!(drawn(5), drawn(5));
        assert!((0..20).any(|seed| draw(&model("door"), 0, 2.0, 1, seed).unwrap().effect != drawn(seed).effect));
    }

    #[test]
    fn what_the_stored_model_has_is_not_hidden_in_it_again() {
        for seed in 0..50 {
            let mut known = model("door");
            known.document.effects.push(drawn(seed));
            assert_ne!(draw(&known, 0, 2.0, 0, seed).unwrap().effect, drawn(seed).effect);
        }
    }
}
