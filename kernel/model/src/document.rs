//! `model.yaml`: what an object model says beyond its URDF.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use crate::ModelError;
use crate::text::{DOCUMENT_BYTES, hint_in_serde_message, read_text};

/// The version of `model.yaml` that this crate reads and writes.
pub const SCHEMA: u32 = 1;

/// Everything in `model.yaml`. Unknown keys are errors, so that a misspelt one is not silently ignored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Document {
    /// Must equal [`SCHEMA`].
    pub schema: u32,
    /// The object's name.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// One sentence for a person.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// What kind of thing it is, for example `microwave`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub category: String,
    /// Does it stand on its own and can be carried (a mug), or is it fixed to the world while it is used (a cabinet)?
    #[serde(default)]
    pub movable: bool,
    /// Named physical effects that the URDF cannot express.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectEntry>,
    /// How the joints' drives turn a command into an effort; a joint that is not named here is driven by efforts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actuators: Vec<Actuator>,
    /// Where and how a parallel gripper can hold it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grasps: Vec<GraspHint>,
    /// Places in or on it where other things can be put.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<Region>,
    /// Joints whose kind and place were read off a cloud: how sure they are, and what else they may be.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_hypotheses: Vec<JointHypotheses>,
    /// Present if the model is a robot arm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<Robot>,
    /// How far the known parameters may be refitted before a difference counts as a missing effect.
    #[serde(default)]
    pub refit_tolerance: RefitTolerance,
    /// Coefficient of sliding friction of its surface against a rubber finger pad.
    #[serde(default = "default_friction")]
    pub surface_friction: f64,
    /// Where it comes from.
    #[serde(default)]
    pub provenance: Provenance,
}

fn default_friction() -> f64 {
    0.8
}

impl Default for Document {
    fn default() -> Self {
        Self {
            schema: SCHEMA,
            name: String::new(),
            description: String::new(),
            category: String::new(),
            movable: false,
            effects: Vec::new(),
            actuators: Vec::new(),
            grasps: Vec::new(),
            regions: Vec::new(),
            joint_hypotheses: Vec::new(),
            robot: None,
            refit_tolerance: RefitTolerance::default(),
            surface_friction: default_friction(),
            provenance: Provenance::default(),
        }
    }
}

impl Document {
    /// Reads a `model.yaml`. Whether it fits a URDF is checked when the model is read ([`crate::ObjectModel::read`]).
    ///
    /// Errors: a file that is missing or too large, YAML that is broken (with its line), an unknown key, another schema.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        Self::parse(&read_text(path, DOCUMENT_BYTES)?, path)
    }

    pub(crate) fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        let malformed = |line, message| ModelError::Malformed { path: path.to_owned(), line, message };
        // The schema first: a file of another one has other keys, and complaining about those would mislead.
        let schema: SchemaOnly = serde_yaml::from_str(text).map_err(|e| {
            let message = format!("{e}; a model.yaml begins with 'schema: {SCHEMA}'");
            malformed(e.location().map(|l| l.line()), message)
        })?;
        if schema.schema != SCHEMA {
            let line = line_of(text, "schema");
            let hint = if schema.schema > SCHEMA { "; it was written by a newer version of this software" } else { "" };
            return Err(malformed(line, format!("schema {} is not the schema {SCHEMA} that is read here{hint}", schema.schema)));
        }
        serde_yaml::from_str(text).map_err(|e| {
            let message = e.to_string();
            let hint = hint_in_serde_message(&message);
            malformed(e.location().map(|l| l.line()), message + &hint)
        })
    }

    /// The document as YAML; [`Document::read`] of it gives the same document.
    pub fn to_yaml(&self) -> Result<String, ModelError> {
        serde_yaml::to_string(self).map_err(|e| ModelError::Malformed {
            path: "model.yaml".into(),
            line: None,
            message: format!("cannot be written: {e}"),
        })
    }
}

/// The one key that every schema has.
#[derive(Deserialize)]
struct SchemaOnly {
    schema: u32,
}

/// The first line that has a word; near enough to show where a checked value stands.
pub(crate) fn line_of(text: &str, word: &str) -> Option<usize> {
    let bounded = |c: Option<char>| c.is_none_or(|c| !(c.is_alphanumeric() || c == '_' || c == '-'));
    let has = |line: &str| {
        let code = line.split(" #").next().unwrap_or(line);
        code.match_indices(word).any(|(i, _)| bounded(code[..i].chars().next_back()) && bounded(code[i + word.len()..].chars().next()))
    };
    text.lines().position(has).map(|i| i + 1).filter(|_| !word.is_empty())
}

/// A pose as people write it: position in m, and roll, pitch, yaw in rad (URDF's convention: fixed axes x, y, z in turn).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct XyzRpy {
    /// Position, m.
    pub xyz: [f64; 3],
    /// Roll, pitch, yaw, rad.
    #[serde(default)]
    pub rpy: [f64; 3],
}

impl XyzRpy {
    /// The pose as a rigid transform.
    pub fn isometry(&self) -> Isometry3<f64> {
        let [x, y, z] = self.xyz;
        let [roll, pitch, yaw] = self.rpy;
        Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }
}

/// One named effect with its parameters.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectEntry {
    /// The effect's name in the catalogue, for example `joint_spring`.
    pub effect: String,
    /// The joint it acts on; none for what acts on the base, and for a clock by which all joints are read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<String>,
    /// Parameters by name, SI units.
    pub parameters: BTreeMap<String, f64>,
    /// What is chosen by a word and not by a number, for example `shape: inverse_square`; the effect's default where it is not given.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub choices: BTreeMap<String, String>,
    /// The URDF's `<dynamics>` states the same number for other programs; the one that counts is this one.
    #[serde(default, skip_serializing_if = "is_false")]
    pub in_urdf: bool,
    /// Why it is believed, where it was found in data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Evidence>,
}

/// What measured data say of an effect.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evidence {
    /// Interval of each parameter that holds it in 95 of 100 cases.
    pub intervals: BTreeMap<String, [f64; 2]>,
    /// Probability of the effect among all that were tried.
    pub probability: f64,
    /// Names that the data cannot tell from it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub alternatives: Vec<String>,
    /// SHA-256 of the recordings that it was fitted to.
    pub data: Vec<String>,
    /// SHA-256 of the recordings on which it was held against prediction.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held_out: Vec<String>,
    /// RMS of the predicted position's error without and with it, in shares of the joints' ranges.
    pub gap: [f64; 2],
}

/// The drive of one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Actuator {
    /// The joint that it drives.
    pub joint: String,
    /// How a command becomes an effort at the joint.
    pub law: ActuatorLaw,
    /// Numbers of the law that are not known well, each with the fraction by which it may be off. They are refitted with the
    /// model's other known parameters.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub refit: BTreeMap<String, f64>,
}

/// How a command becomes an effort `tau` at a joint at `q` that moves with `v`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum ActuatorLaw {
    /// `tau = u`, clipped at `max_effort`.
    Torque {
        /// Most effort, N m or N.
        #[serde(default = "unlimited", skip_serializing_if = "is_unlimited")]
        max_effort: f64,
    },
    /// `tau = stiffness (u - q) - damping v`, clipped at `max_effort`: a servo that follows a position.
    PositionServo {
        /// N m/rad or N/m.
        stiffness: f64,
        /// N m s/rad or N s/m.
        #[serde(default)]
        damping: f64,
        /// Most effort, N m or N.
        #[serde(default = "unlimited", skip_serializing_if = "is_unlimited")]
        max_effort: f64,
    },
    /// `tau = torque_constant (U - torque_constant v) / resistance`: a motor with brushes, seen through its gear. `U` is the
    /// commanded voltage; for a commanded position `U = gain (u - q)`, clipped at `max_voltage`. Where the command is empty the
    /// circuit is open: no effort.
    DcMotor {
        /// N m/A at the joint, the same as V s/rad.
        torque_constant: f64,
        /// Ohm.
        resistance: f64,
        /// V/rad; for commanded positions only.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        gain: Option<f64>,
        /// Most voltage, V.
        #[serde(default = "unlimited", skip_serializing_if = "is_unlimited")]
        max_voltage: f64,
    },
}

#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_false(flag: &bool) -> bool {
    !flag
}

fn unlimited() -> f64 {
    f64::INFINITY
}

fn is_unlimited(limit: &f64) -> bool {
    *limit == f64::INFINITY
}

/// A way of holding the object with a parallel gripper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum GraspHint {
    /// A bar that two fingers close on from both sides; the grip may turn about it.
    Bar(BarGrasp),
    /// The thin wall of a cup or ring: one finger inside, one outside.
    Rim(RimGrasp),
}

impl GraspHint {
    /// Name of the grasp.
    pub fn name(&self) -> &str {
        match self {
            Self::Bar(g) => &g.name,
            Self::Rim(g) => &g.name,
        }
    }

    /// Name of the link that is held.
    pub fn link(&self) -> &str {
        match self {
            Self::Bar(g) => &g.link,
            Self::Rim(g) => &g.link,
        }
    }
}

/// A straight bar. Points and directions are in the link's frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BarGrasp {
    /// Name of the grasp.
    pub name: String,
    /// The link that is held.
    pub link: String,
    /// One end of the straight part that can be held, m.
    pub from: [f64; 3],
    /// The other end, m.
    pub to: [f64; 3],
    /// Half of the width that the fingers close on, m.
    pub radius: f64,
    /// Unit vector from the bar away from the object: the hand comes from there.
    pub outward: [f64; 3],
    /// How far the hand may turn about the bar away from `outward`, rad.
    pub swing: f64,
    /// Free depth behind the bar, m: how far finger tips can reach past its centre line.
    pub depth: f64,
}

/// A ring-shaped wall. Points and directions are in the link's frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RimGrasp {
    /// Name of the grasp.
    pub name: String,
    /// The link that is held.
    pub link: String,
    /// Centre of the rim's circle, at the height of its edge, m.
    pub center: [f64; 3],
    /// Unit vector along the ring's axis, out of the opening.
    pub axis: [f64; 3],
    /// Radius to the middle of the wall, m.
    pub radius: f64,
    /// Thickness of the wall, m.
    pub thickness: f64,
    /// Greatest depth of the finger tips below the edge, m.
    pub depth: f64,
    /// Directions around the axis that are not free (a mug's handle), each as angle and half width, rad, measured from
    /// the link's x axis projected across `axis` (y axis if x is parallel to it), counter-clockwise about `axis`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocked: Vec<[f64; 2]>,
    /// How far the hand may lean away from the axis, rad.
    pub tilt: f64,
}

/// A box-shaped place for other things, upright in the link's frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Name of the place, for example `cavity`.
    pub name: String,
    /// The link that it is fixed to.
    pub link: String,
    /// Centre of the box in the link's frame, m.
    pub center: [f64; 3],
    /// Full extents of the box, m. Things stand on its lower face.
    pub size: [f64; 3],
    /// Unit vector out of the opening that things pass through, in the link's frame.
    pub opening: [f64; 3],
}

/// How sure a joint's kind and place are, before anybody has moved it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointHypotheses {
    /// The joint.
    pub joint: String,
    /// Standard deviation of its axis, rad.
    pub axis_deviation: f64,
    /// Standard deviation of the axis' place, m.
    pub origin_deviation: f64,
    /// Ways in which the part may move, the one of the URDF first.
    pub ways: Vec<JointHypothesis>,
}

/// One way in which a part may move. In the root link's frame, at the position in which the object was seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointHypothesis {
    /// `revolute` or `prismatic`.
    pub kind: String,
    /// Unit vector; positive motion opens.
    pub axis: [f64; 3],
    /// A point on the axis, m.
    pub origin: [f64; 3],
    /// Probability, 0 to 1.
    pub probability: f64,
}

/// What only a robot arm has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Joints that torques drive, in the order of commands and observations.
    pub arm_joints: Vec<String>,
    /// The gripper.
    pub gripper: Gripper,
    /// The camera on the wrist.
    pub camera: Camera,
    /// The link whose motion the wrist's force-torque sensor measures, and at whose frame its wrench is given.
    pub wrist_link: String,
    /// Named configurations of the arm joints.
    pub configurations: Vec<Configuration>,
}

/// A parallel gripper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gripper {
    /// The link that carries it.
    pub link: String,
    /// Pose of the tool frame `T` in that link: z points out between the fingers, y along the opening, origin midway
    /// between the pads' centres.
    pub X_LT: XyzRpy,
    /// The two fingers.
    pub fingers: [Finger; 2],
    /// Greatest opening, m.
    pub max_width: f64,
    /// Greatest force on each finger, N.
    pub max_force: f64,
    /// Half extents of a pad: along the tool's x (width) and z (length), m.
    pub pad_half_extents: [f64; 2],
}

/// One finger: a prismatic joint that is zero when the gripper is shut.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Finger {
    /// The finger's joint.
    pub joint: String,
    /// The finger's link.
    pub link: String,
}

/// A depth camera on a link. Optical axes: x right, y down, z forward.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// The link that carries it.
    pub link: String,
    /// Pose of the optical frame in that link.
    pub X_LC: XyzRpy,
    /// Image size in pixels: width, height.
    pub size: [usize; 2],
    /// Focal lengths in pixels: x, y.
    pub focal: [f64; 2],
    /// Principal point in pixels: x, y.
    pub center: [f64; 2],
    /// Nearest and farthest depth that is measured, m.
    pub range: [f64; 2],
}

/// A named configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Configuration {
    /// Its name: `ready` is where a run starts; names that start with `look` are where the arm goes to see.
    pub name: String,
    /// Positions of the arm joints, rad or m.
    pub q: Vec<f64>,
}

/// How far known parameters may move when they are refitted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RefitTolerance {
    /// Of mass and inertia, as a fraction.
    pub mass: f64,
    /// Of the centre of mass, m.
    pub center_of_mass: f64,
}

impl Default for RefitTolerance {
    fn default() -> Self {
        Self { mass: 0.02, center_of_mass: 0.005 }
    }
}

/// Where a model comes from and under which terms.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Provenance {
    /// Licence identifier (SPDX).
    pub licence: String,
    /// Credit that has to be given.
    pub attribution: String,
    /// Sources it was made from.
    pub origins: Vec<Origin>,
    /// What was changed on the way.
    pub changes: Vec<String>,
}

/// One source of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Where it was published.
    pub source: String,
    /// Version, commit or release.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub version: String,
}
