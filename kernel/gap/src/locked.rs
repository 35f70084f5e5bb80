//! Joints that no recording tells of, or that stand still in all of them: for these data they are none.
//!
//! A joint whose position was not measured may be anywhere, and one that stands tells nothing but that something holds it. Neither may be asked
//! what it lacks, and neither falls while others move. So each is fixed where it stands, or at zero, and is free again in what is found.

use sagci_model::{JointKind, ObjectModel};
use sagci_recording::{Log, Series};

use crate::GapError;

/// A model as the data can be compared with.
#[derive(Debug)]
pub(crate) struct Locked<'a> {
    given: &'a ObjectModel,
    /// The same with some joints fixed.
    pub model: ObjectModel,
    /// Names of these joints.
    names: Vec<String>,
    /// What to say about them.
    pub notes: Vec<String>,
}

impl<'a> Locked<'a> {
    /// Fixes what does not move in any of the recordings.
    ///
    /// # Errors
    /// As [`Self::unmeasured`]; nothing moves; a joint that moves is not measured in one of the recordings.
    pub fn new(given: &'a ObjectModel, logs: &[&Log]) -> Result<Self, GapError> {
        Self::without(given, logs, true)
    }

    /// Fixes what none of the recordings measures. A joint that stands is free: a model that moves it is off.
    ///
    /// # Errors
    /// No joint is measured; one of the recordings does not measure a joint that others do.
    pub fn unmeasured(given: &'a ObjectModel, logs: &[&Log]) -> Result<Self, GapError> {
        Self::without(given, logs, false)
    }

    fn without(given: &'a ObjectModel, logs: &[&Log], holds_still: bool) -> Result<Self, GapError> {
        let mut this = Self { given, model: given.clone(), names: Vec::new(), notes: Vec::new() };
        let mut is_any_measured = false;
        let moving: Vec<usize> = given.moving_joints().collect();
        for &i in moving.iter().filter(|i| given.joints[**i].kind.velocities() == 1) {
            let joint = &given.joints[i];
            let unit = if joint.kind == JointKind::Prismatic { "m" } else { "rad" };
            let mut seen: Vec<f64> = logs.iter().filter_map(|l| measured(l, &joint.name)).flat_map(|p| p.value.iter().copied()).collect();
            is_any_measured |= !seen.is_empty();
            let all = Series { time: Vec::new(), value: seen.clone() };
            let moves = || all.moves() || logs.iter().filter_map(|l| measured(l, &joint.name)).any(Series::moves);
            if !seen.is_empty() && (!holds_still || moves()) {
                if let Some(log) = logs.iter().find(|l| measured(l, &joint.name).is_none()) {
                    let message = format!(
                        "does not measure the joint '{}', which other recordings do: where it was nobody knows; leave this recording \
                         out, or look at it alone",
                        joint.name
                    );
                    return Err(GapError::data(&log.source, message));
                }
                continue;
            }
            seen.sort_by(f64::total_cmp);
            let zero = 0f64.max(joint.limits.lower).min(joint.limits.upper);
            let at = seen.get(seen.len() / 2).copied().unwrap_or(zero);
            let why = if seen.is_empty() { "is not measured" } else { "does not move in these data" };
            this.notes.push(format!("{}: {why}; it is held at {at:.4} {unit}, and nothing is looked for on it", joint.name));
            this.names.push(joint.name.clone());
            this.fix(i, at);
        }
        if !is_any_measured {
            let names: Vec<&str> = moving.iter().map(|i| given.joints[*i].name.as_str()).collect();
            let place = logs.first().map_or("the data", |l| l.source.as_str());
            return Err(GapError::data(place, format!("has no positions of the model's joints ({})", names.join(", "))));
        }
        if !moving.is_empty() && this.names.len() == moving.len() {
            let place = logs.first().map_or("the data", |l| l.source.as_str());
            return Err(GapError::data(place, "no joint moves, so nothing can be found; record it moving to and fro over its range"));
        }
        let locked = |name: &Option<String>| name.as_ref().is_some_and(|n| this.names.contains(n));
        this.model.document.effects.retain(|e| !locked(&e.joint));
        this.model.document.actuators.retain(|a| !this.names.contains(&a.joint));
        Ok(this)
    }

    /// Fixes a joint at a position, and those that follow it where they are then.
    fn fix(&mut self, joint: usize, at: f64) {
        let X_PC = self.given.X_PC(joint, at);
        let fixed = &mut self.model.joints[joint];
        (fixed.kind, fixed.X_PJ, fixed.mimic) = (JointKind::Fixed, X_PC, None);
        for (i, follower) in self.given.joints.iter().enumerate() {
            if let Some(mimic) = follower.mimic.filter(|m| m.joint == joint && i != joint)
                && self.model.joints[i].mimic.is_some()
            {
                self.fix(i, mimic.multiplier * at + mimic.offset);
            }
        }
    }

    /// What was found, with all joints of the model as given. Effects of the model come first, as in the model; then those that were found.
    pub fn freed(&self, mut found: ObjectModel) -> ObjectModel {
        for (joint, given) in found.joints.iter_mut().zip(&self.given.joints) {
            (joint.kind, joint.X_PJ, joint.mimic) = (given.kind, given.X_PJ, given.mimic);
        }
        let is_locked = |name: Option<&String>| name.is_some_and(|n| self.names.contains(n));
        let mut effects = std::mem::take(&mut found.document.effects).into_iter();
        for given in &self.given.document.effects {
            let kept = if is_locked(given.joint.as_ref()) { Some(given.clone()) } else { effects.next() };
            found.document.effects.extend(kept);
        }
        found.document.effects.extend(effects);
        let mut actuators = std::mem::take(&mut found.document.actuators).into_iter();
        for given in &self.given.document.actuators {
            let kept = if is_locked(Some(&given.joint)) { Some(given.clone()) } else { actuators.next() };
            found.document.actuators.extend(kept);
        }
        found
    }
}

/// Positions of a joint, if there are any.
fn measured<'a>(log: &'a Log, joint: &str) -> Option<&'a Series> {
    log.joint(joint).map(|j| &j.position).filter(|p| !p.time.is_empty())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use sagci_recording::JointLog;

    use super::*;

    fn two(folder: &std::path::Path) -> ObjectModel {
        let link = |name: &str| {
            format!(
                r#"<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>"#
            )
        };
        let joints = r#"<joint name="turn" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
               <limit lower="0.2" upper="1.5" velocity="20" effort="100"/></joint>
             <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="1 0 0"/><axis xyz="1 0 0"/>
               <limit lower="-0.3" upper="0.5" velocity="20" effort="100"/></joint>
             <joint name="finger" type="prismatic"><parent link="a"/><child link="c"/><axis xyz="1 0 0"/>
               <limit lower="-2" upper="2" velocity="20" effort="100"/><mimic joint="slide" multiplier="2" offset="0.1"/></joint>"#;
        let text = format!(r#"<robot name="two"><link name="base"/>{}{}{}{joints}</robot>"#, link("a"), link("b"), link("c"));
        std::fs::write(folder.join("object.urdf"), text).unwrap();
        ObjectModel::read_urdf(folder.join("object.urdf")).unwrap()
    }

    fn log(joints: &[(&str, &dyn Fn(f64) -> f64)]) -> Log {
        let times: Vec<f64> = (0..400).map(|k| 0.01 * f64::from(k)).collect();
        let series = |of: &dyn Fn(f64) -> f64| Series { value: times.iter().map(|t| of(*t)).collect(), time: times.clone() };
        let joint =
            |(name, of): &(&str, &dyn Fn(f64) -> f64)| JointLog { name: (*name).into(), position: series(*of), ..JointLog::default() };
        Log { source: "two.csv".into(), joints: joints.iter().map(joint).collect(), ..Log::default() }
    }

    #[test]
    fn a_joint_that_stands_is_held_there_and_what_follows_it_too() {
        let folder = tempfile::tempdir().unwrap();
        let model = two(folder.path());
        // Noise of an encoder is no motion.
        let noisy = |t: f64| 0.2 + 1e-5 * (7919.0 * t).sin();
        let log = log(&[("turn", &|t| 0.5 + 0.3 * t.sin()), ("slide", &noisy)]);
        let locked = Locked::new(&model, &[&log]).unwrap();
        assert_eq!(locked.model.moving_joints().count(), 1);
        let (ours, theirs) = (locked.model.X_OL(&[0.7]), model.X_OL(&[0.7, 0.2]));
        for (ours, theirs) in ours.iter().zip(theirs) {
            assert!((ours.to_homogeneous() - theirs.to_homogeneous()).norm() < 1e-4, "{ours} {theirs}");
        }
        assert!(locked.notes.iter().any(|n| n.contains("slide") && n.contains("0.2000 m")), "{:?}", locked.notes);
        let kinds = |m: &ObjectModel| m.joints.iter().map(|j| (j.kind, j.X_PJ, j.mimic.is_some())).collect::<Vec<_>>();
        assert_eq!(kinds(&locked.freed(locked.model.clone())), kinds(&model));
    }

    /// Whether a model moves what stands is what its error asks.
    #[test]
    fn a_joint_that_stands_is_free_where_nothing_is_fitted() {
        let folder = tempfile::tempdir().unwrap();
        let model = two(folder.path());
        let log = log(&[("turn", &|t| 0.5 + 0.3 * t.sin()), ("slide", &|_| 0.2)]);
        assert_eq!(Locked::unmeasured(&model, &[&log]).unwrap().model.moving_joints().count(), 2);
    }

    #[test]
    fn a_joint_that_is_not_measured_is_held_within_its_limits() {
        let folder = tempfile::tempdir().unwrap();
        let model = two(folder.path());
        let log = log(&[("slide", &|t| 0.1 * t.sin())]);
        let locked = Locked::new(&model, &[&log]).unwrap();
        assert!(locked.notes.iter().any(|n| n.contains("turn: is not measured; it is held at 0.2000 rad")), "{:?}", locked.notes);
    }

    /// Where it was in one of them nobody knows.
    #[test]
    fn a_moving_joint_that_one_recording_lacks_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let model = two(folder.path());
        let both = log(&[("turn", &|t| 0.5 + 0.3 * t.sin()), ("slide", &|t| 0.1 * t.sin())]);
        let one = log(&[("turn", &|t| 0.5 + 0.3 * t.sin())]);
        let error = Locked::new(&model, &[&both, &one]).unwrap_err().to_string();
        assert!(error.contains("slide"), "{error}");
    }

    #[test]
    fn effects_and_drives_of_a_held_joint_are_kept_in_their_places() {
        let folder = tempfile::tempdir().unwrap();
        let mut model = two(folder.path());
        for joint in ["turn", "slide", "turn"] {
            let entry = sagci_model::EffectEntry { effect: "torque_bias".into(), joint: Some(joint.into()), ..Default::default() };
            model.document.effects.push(entry);
        }
        let log = log(&[("turn", &|t| 0.5 + 0.3 * t.sin())]);
        let locked = Locked::new(&model, &[&log]).unwrap();
        let mut found = locked.model.clone();
        assert_eq!(found.document.effects.len(), 2);
        found.document.effects.push(sagci_model::EffectEntry { effect: "coulomb_friction".into(), ..Default::default() });
        let freed = locked.freed(found);
        let names: Vec<&str> = freed.document.effects.iter().map(|e| e.joint.as_deref().unwrap_or("new")).collect();
        assert_eq!(names, ["turn", "slide", "turn", "new"]);
    }
}
