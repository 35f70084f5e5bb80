//! Effects that a URDF can say as well: viscous damping and dry friction, in a joint's `<dynamics>`.
//!
//! The number stands in both files: in `model.yaml` with its interval and its evidence, and in the URDF, where other programs look. An
//! entry says so by `in_urdf: true`. It is **read from `model.yaml`**: while a model is in memory the effect is the entry, and the joint's
//! own number is zero, so that nothing counts twice. On disk the two numbers must be equal; a file in which only one was changed is
//! refused, because nobody could say which one holds.

use crate::{EffectEntry, ObjectModel};

/// What URDF can say: the effect, its parameter, and the attribute of `<dynamics>`.
const STATED: [(&str, &str, &str); 2] = [("viscous_friction", "damping", "damping"), ("coulomb_friction", "friction", "friction")];

/// The number of an entry that a URDF could say, and which one: 0 for damping, 1 for friction.
fn number(entry: &EffectEntry) -> Option<(usize, f64)> {
    let kind = STATED.iter().position(|s| s.0 == entry.effect)?;
    entry.parameters.get(STATED[kind].1).map(|value| (kind, *value))
}

/// Damping and friction of a joint as the URDF states them.
pub(crate) fn of_joint(model: &ObjectModel, joint: usize) -> [f64; 2] {
    let mut both = [model.joints[joint].damping, model.joints[joint].friction];
    let here = |e: &&EffectEntry| e.in_urdf && e.joint.as_deref() == Some(model.joints[joint].name.as_str());
    for (kind, value) in model.document.effects.iter().filter(here).filter_map(number) {
        both[kind] += value;
    }
    both
}

/// Takes out of the joints what entries of the document say as well. The error is the place among the effects, and what is wrong.
pub(crate) fn take_out(model: &mut ObjectModel) -> Result<(), (usize, String)> {
    for i in 0..model.document.effects.len() {
        let entry = &model.document.effects[i];
        if !entry.in_urdf {
            continue;
        }
        let Some((kind, value)) = number(entry) else {
            return Err((i, "has 'in_urdf: true', but a URDF can only say viscous_friction and coulomb_friction; remove that line".into()));
        };
        let Some(joint) = entry.joint.as_ref().and_then(|j| model.joints.iter().position(|joint| joint.name == *j)) else {
            return Err((i, "has 'in_urdf: true', but no joint that the URDF has; name one".into()));
        };
        let attribute = STATED[kind].2;
        let joint = &mut model.joints[joint];
        let stated = if kind == 0 { &mut joint.damping } else { &mut joint.friction };
        if (*stated - value).abs() > 1e-9 * value.abs() {
            let message = format!(
                "is {value} here, but the URDF says {attribute}=\"{stated}\" for the joint '{}'; make them equal, or remove 'in_urdf' and set \
                 the URDF's to 0",
                joint.name
            );
            return Err((i, message));
        }
        *stated = 0.0;
    }
    Ok(())
}

impl ObjectModel {
    /// Marks the effects that a URDF can say as well, so that [`Self::write`] and [`Self::to_urdf`] state their numbers there, too: viscous
    /// and Coulomb friction of joints for which the URDF says none. What is simulated does not change, before or after writing.
    pub fn state_in_urdf(&mut self) {
        let mut stated: Vec<(String, usize)> = Vec::new();
        for entry in &mut self.document.effects {
            let (Some((kind, value)), Some(name)) = (number(entry), entry.joint.clone()) else { continue };
            let own = self.joints.iter().find(|j| j.name == name).map(|j| [j.damping, j.friction][kind]);
            if own == Some(0.0) && value > 0.0 && !stated.contains(&(name.clone(), kind)) {
                entry.in_urdf = true;
                stated.push((name, kind));
            }
        }
    }
}
