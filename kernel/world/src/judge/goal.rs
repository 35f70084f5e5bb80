//! What a run should bring about.

use std::path::{Path, PathBuf};

use sagci_model::{JointKind, ObjectModel, Region};
use serde::{Deserialize, Serialize};

use crate::Scene;

/// A file of goals, for example `scripts/warm_mug.check.yaml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Goals {
    /// The goals; a run succeeds if all of them are met.
    #[serde(with = "serde_yaml::with::singleton_map_recursive")]
    pub goals: Vec<Goal>,
}

/// One thing that should be true, for example `inside: { object: mug, of: microwave, region: cavity }`.
///
/// Angles are in degrees and lengths in centimetres, as the names say: this is the edge where people write.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Goal {
    /// At some time during the run, a joint was at or beyond a position: `past_deg` of a hinge or `past_cm` of a slide.
    JointPassed(JointPassed),
    /// At the end, a joint is near a position: `at_deg` of a hinge or `at_cm` of a slide, give or take `within_...`.
    JointAt(JointAt),
    /// At the end, the whole of an object lies in a region of another one.
    Inside(Inside),
    /// At the end, the middle of an object lies outside a region of another one.
    Outside(Inside),
    /// At the end, an object stands upright as its model does, to within an angle.
    Upright(Upright),
    /// At the end, the gripper does not touch an object.
    Untouched(Untouched),
    /// At the end, an object is at rest.
    Still(Untouched),
    /// At the end, an object rests on the table.
    OnTable(Untouched),
    /// The effect that was hidden in a joint was named, alone or in a set of names that the data cannot tell apart, and no other beside it.
    EffectNamed(EffectNamed),
}

/// See [`Goal::EffectNamed`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectNamed {
    /// Name of the object in the scene.
    pub object: String,
    /// Name of the joint.
    pub joint: String,
}

/// See [`Goal::JointPassed`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointPassed {
    /// Name of the object in the scene.
    pub object: String,
    /// Name of the joint.
    pub joint: String,
    /// Angle, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub past_deg: Option<f64>,
    /// Length, cm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub past_cm: Option<f64>,
}

/// See [`Goal::JointAt`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointAt {
    /// Name of the object in the scene.
    pub object: String,
    /// Name of the joint.
    pub joint: String,
    /// Angle, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_deg: Option<f64>,
    /// Length, cm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_cm: Option<f64>,
    /// Tolerance, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_deg: Option<f64>,
    /// Tolerance, cm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_cm: Option<f64>,
}

/// See [`Goal::Inside`] and [`Goal::Outside`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inside {
    /// Name of the object in the scene.
    pub object: String,
    /// Name of the object that has the region.
    pub of: String,
    /// Name of the region; the first one if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<String>,
    /// How far it may reach out of the region, cm.
    #[serde(default = "half_centimetre")]
    pub tolerance_cm: f64,
}

fn half_centimetre() -> f64 {
    0.5
}

/// See [`Goal::Upright`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Upright {
    /// Name of the object in the scene.
    pub object: String,
    /// Greatest lean, degrees.
    pub within_deg: f64,
}

/// See [`Goal::Untouched`], [`Goal::Still`] and [`Goal::OnTable`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Untouched {
    /// Name of the object in the scene.
    pub object: String,
}

/// Why goals cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum GoalError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not a file of goals.
    #[error("{}{}: {message}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, counted from 1, where it is known.
        line: Option<usize>,
        /// What is wrong.
        message: String,
    },
    /// A goal speaks of something that is not in the scene, or mixes units.
    #[error("goal {number} ({kind}): {message}")]
    Impossible {
        /// Which goal, counted from 1.
        number: usize,
        /// Its kind.
        kind: &'static str,
        /// What is wrong, and what to do about it.
        message: String,
    },
}

impl Goals {
    /// Reads a file of goals.
    pub fn read(path: &Path) -> Result<Self, GoalError> {
        let text = std::fs::read_to_string(path).map_err(|source| GoalError::File { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Goals from a text; `path` is what messages call it.
    pub fn parse(text: &str, path: &Path) -> Result<Self, GoalError> {
        let goals: Self = serde_yaml::from_str(text).map_err(|e| GoalError::Malformed {
            path: path.to_owned(),
            line: e.location().map(|l| l.line()),
            message: e.to_string(),
        })?;
        if goals.goals.is_empty() {
            return Err(GoalError::Malformed {
                path: path.to_owned(),
                line: None,
                message: "holds no goal; a run that has nothing to reach cannot be judged".into(),
            });
        }
        Ok(goals)
    }

    /// Checks the goals against what a scene holds, before anything moves.
    pub fn check(&self, scene: &Scene) -> Result<(), GoalError> {
        for (i, goal) in self.goals.iter().enumerate() {
            goal.resolve(scene).map_err(|message| GoalError::Impossible { number: i + 1, kind: goal.kind(), message })?;
        }
        Ok(())
    }
}

/// A goal with names looked up and units made SI.
pub(crate) enum Resolved {
    JointPassed { object: usize, joint: usize, past: f64, hinge: bool },
    JointAt { object: usize, joint: usize, at: f64, within: f64, hinge: bool },
    Inside { object: usize, of: usize, link: usize, region: Region, tolerance: f64 },
    Outside { object: usize, of: usize, link: usize, region: Region },
    Upright { object: usize, within: f64 },
    Untouched { object: usize },
    Still { object: usize },
    OnTable { object: usize },
    EffectNamed { object: usize, joint: usize },
}

impl Goal {
    /// The goal's kind as a file has it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::JointPassed(_) => "joint_passed",
            Self::JointAt(_) => "joint_at",
            Self::Inside(_) => "inside",
            Self::Outside(_) => "outside",
            Self::Upright(_) => "upright",
            Self::Untouched(_) => "untouched",
            Self::Still(_) => "still",
            Self::OnTable(_) => "on_table",
            Self::EffectNamed(_) => "effect_named",
        }
    }

    /// One line for a person.
    pub(crate) fn text(&self) -> String {
        let amount = |deg: Option<f64>, cm: Option<f64>| match (deg, cm) {
            (Some(deg), _) => format!("{deg} deg"),
            (_, Some(cm)) => format!("{cm} cm"),
            _ => "?".into(),
        };
        let region = |g: &Inside| g.region.as_ref().map_or_else(|| g.of.clone(), |r| format!("{} of {}", r, g.of));
        match self {
            Self::JointPassed(g) => format!("{}/{} past {}", g.object, g.joint, amount(g.past_deg, g.past_cm)),
            Self::JointAt(g) => {
                format!("{}/{} finally within {} of {}", g.object, g.joint, amount(g.within_deg, g.within_cm), amount(g.at_deg, g.at_cm))
            }
            Self::Inside(g) => format!("{} inside {}", g.object, region(g)),
            Self::Outside(g) => format!("{} out of {}", g.object, region(g)),
            Self::Upright(g) => format!("{} upright within {} deg", g.object, g.within_deg),
            Self::Untouched(g) => format!("{} not touched by the gripper", g.object),
            Self::Still(g) => format!("{} at rest", g.object),
            Self::OnTable(g) => format!("{} on the table", g.object),
            Self::EffectNamed(g) => format!("what {}/{} hides is named", g.object, g.joint),
        }
    }

    pub(crate) fn resolve(&self, scene: &Scene) -> Result<Resolved, String> {
        Ok(match self {
            Self::JointPassed(g) => {
                let (object, joint, hinge) = find_joint(scene, &g.object, &g.joint)?;
                let past = amount(hinge, g.past_deg, g.past_cm, "past")?;
                Resolved::JointPassed { object, joint, past, hinge }
            }
            Self::JointAt(g) => {
                let (object, joint, hinge) = find_joint(scene, &g.object, &g.joint)?;
                let at = amount(hinge, g.at_deg, g.at_cm, "at")?;
                let within = amount(hinge, g.within_deg, g.within_cm, "within")?;
                Resolved::JointAt { object, joint, at, within, hinge }
            }
            Self::Inside(g) => {
                let (object, of, link, region) = find_region(scene, g)?;
                Resolved::Inside { object, of, link, region, tolerance: finite(g.tolerance_cm, "tolerance_cm")? / 100.0 }
            }
            Self::Outside(g) => {
                let (object, of, link, region) = find_region(scene, g)?;
                Resolved::Outside { object, of, link, region }
            }
            Self::Upright(g) => {
                Resolved::Upright { object: find(scene, &g.object)?, within: finite(g.within_deg, "within_deg")?.to_radians() }
            }
            Self::Untouched(g) => Resolved::Untouched { object: find(scene, &g.object)? },
            Self::Still(g) => Resolved::Still { object: find(scene, &g.object)? },
            Self::OnTable(g) => Resolved::OnTable { object: find(scene, &g.object)? },
            Self::EffectNamed(g) => {
                let (object, joint, _) = find_joint(scene, &g.object, &g.joint)?;
                if scene.objects[object].hidden_effect.as_ref() != Some(&g.joint) {
                    return Err(format!("nothing is hidden in '{}/{}': the script must say scene.hidden_effect(...)", g.object, g.joint));
                }
                Resolved::EffectNamed { object, joint }
            }
        })
    }
}

/// Index of an object in the scene.
fn find(scene: &Scene, name: &str) -> Result<usize, String> {
    scene.objects.iter().position(|o| o.name == name).ok_or_else(|| {
        let known: Vec<&str> = scene.objects.iter().map(|o| o.name.as_str()).collect();
        format!("the scene has no object '{name}'; it has [{}]", known.join(", "))
    })
}

fn find_joint(scene: &Scene, object: &str, joint: &str) -> Result<(usize, usize, bool), String> {
    let i = find(scene, object)?;
    let model: &ObjectModel = &scene.objects[i].model;
    let j = model.joint(joint).ok_or_else(|| {
        let known: Vec<&str> = model.moving_joints().map(|j| model.joints[j].name.as_str()).collect();
        format!("'{object}' has no joint '{joint}'; it has [{}]", known.join(", "))
    })?;
    match model.joints[j].kind {
        JointKind::Revolute | JointKind::Continuous => Ok((i, j, true)),
        JointKind::Prismatic => Ok((i, j, false)),
        _ => Err(format!("the joint '{joint}' of '{object}' neither turns nor slides")),
    }
}

fn find_region(scene: &Scene, goal: &Inside) -> Result<(usize, usize, usize, Region), String> {
    let (object, of) = (find(scene, &goal.object)?, find(scene, &goal.of)?);
    let model = &scene.objects[of].model;
    let regions = &model.document.regions;
    let region = match &goal.region {
        None => regions.first(),
        Some(name) => regions.iter().find(|r| &r.name == name),
    };
    let region = region.ok_or_else(|| {
        let known: Vec<&str> = regions.iter().map(|r| r.name.as_str()).collect();
        format!("the model of '{}' has no such region; it has [{}]", goal.of, known.join(", "))
    })?;
    let link = model
        .link(&region.link)
        .ok_or_else(|| format!("the region '{}' is on the link '{}', which does not exist", region.name, region.link))?;
    Ok((object, of, link, region.clone()))
}

fn finite(value: f64, name: &str) -> Result<f64, String> {
    if value.is_finite() { Ok(value) } else { Err(format!("{name} is not a finite number")) }
}

/// An amount of joint motion in SI units; its unit must fit the joint.
fn amount(hinge: bool, deg: Option<f64>, cm: Option<f64>, name: &str) -> Result<f64, String> {
    match (hinge, deg, cm) {
        (true, Some(deg), None) => Ok(finite(deg, name)?.to_radians()),
        (false, None, Some(cm)) => Ok(finite(cm, name)? / 100.0),
        (true, ..) => Err(format!("this joint turns: give {name}_deg, and not {name}_cm")),
        (false, ..) => Err(format!("this joint slides: give {name}_cm, and not {name}_deg")),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::testing::{put, scene};

    fn parse(text: &str) -> Result<Goals, GoalError> {
        Goals::parse(text, Path::new("run.check.yaml"))
    }

    fn setting() -> Scene {
        let mut scene = scene("gantry", "high");
        put(&mut scene, "door", [0.5, 0.0, 0.0]);
        put(&mut scene, "cup", [0.3, -0.4, 0.0]);
        scene
    }

    #[test]
    fn goals_survive_being_written_and_read_again() {
        let goals = parse(
            "goals:\n  - joint_passed: { object: door, joint: hinge, past_deg: 60 }\n  - inside: { object: cup, of: door, region: behind }\n  - still: { object: cup }\n",
        )
        .unwrap();
        assert_eq!(parse(&serde_yaml::to_string(&goals).unwrap()).unwrap(), goals);
        goals.check(&setting()).unwrap();
    }

    #[test]
    fn a_bad_file_is_refused_with_its_line() {
        for (text, line, says) in [
            ("goals:\n  - inside: { object: cup, of: door }\n  - levitating: { object: cup }\n", 3, "levitating"),
            ("goals:\n  - still: { object: cup }\n  - upright: { object: cup, within: 5 }\n", 3, "within"),
            ("goals:\n  - upright: { object: cup }\n", 2, "within_deg"),
            ("goals:\n  - upright: { object: cup, within_deg: [\n", 2, ""),
            ("gaols: []\n", 1, "gaols"),
        ] {
            let error = parse(text).unwrap_err();
            let GoalError::Malformed { line: found, .. } = &error else { unreachable!() };
            assert!(found.is_some_and(|l| l.abs_diff(line) <= 1), "{text}: line {found:?}: {error}");
            assert!(error.to_string().contains(says) && error.to_string().starts_with("run.check.yaml:"), "{error}");
        }
        assert!(parse("goals: []\n").is_err());
        assert!(Goals::read(Path::new("no/such/file.yaml")).unwrap_err().to_string().contains("no/such/file.yaml"));
    }

    #[test]
    fn a_goal_about_what_is_not_there_is_refused_before_the_run() {
        for (goal, says) in [
            ("still: { object: cat }", "it has [door, cup]"),
            ("joint_passed: { object: door, joint: hinges, past_deg: 3 }", "it has [hinge]"),
            ("joint_passed: { object: door, joint: hinge, past_cm: 3 }", "past_deg"),
            ("inside: { object: cup, of: door, region: within }", "it has [behind]"),
            ("upright: { object: cup, within_deg: .nan }", "finite"),
        ] {
            let goals = parse(&format!("goals:\n  - still: {{ object: cup }}\n  - {goal}\n")).unwrap();
            let error = goals.check(&setting()).unwrap_err().to_string();
            assert!(error.starts_with("goal 2") && error.contains(says), "{error}");
        }
    }
}
