//! What a skill and its host say to one another. Plain data; it crosses the plugin border as MessagePack with field
//! names, so that a field can be added without breaking older plugins.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use sagci_signal::{Command, Observation, SceneBelief};
use serde::{Deserialize, Serialize};

/// What a skill says of itself: the sidecar `skill.yaml`, and the answer of a loaded plugin, which must agree with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Name of the skill and of the script function.
    pub name: String,
    /// Its own version.
    pub version: String,
    /// The version of the plugin border that it was built against.
    pub abi: u32,
    /// One sentence for a person.
    pub summary: String,
    /// What a script passes, in this order.
    pub parameters: Vec<Parameter>,
    /// Library name without prefix and ending, for example `sagci_skill_open`; beside the manifest or the program.
    pub library: String,
    /// Entry symbol in the library; each skill has its own, so that two of them can also be linked into one program.
    pub entry: String,
}

/// One parameter of a skill.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// What is passed.
    pub kind: ParameterKind,
    /// Must it be passed?
    #[serde(default)]
    pub required: bool,
    /// One sentence for a person.
    pub summary: String,
}

/// What can be passed to a skill.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ParameterKind {
    /// An object of the scene.
    Object,
    /// A place in or on an object, or on the table.
    Place,
    /// An angle or a length: an amount of joint motion.
    Amount,
    /// An angle.
    Angle,
    /// A length.
    Length,
    /// A plain number.
    Number,
    /// True or false.
    Truth,
    /// A text.
    Text,
}

/// A value that a script passes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Argument {
    /// An object of the scene, and one of its joints if the script names it.
    Object {
        /// Name in the scene.
        name: String,
        /// Name of the joint.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        joint: Option<String>,
    },
    /// A place.
    Place(Place),
    /// rad.
    Angle(f64),
    /// m.
    Length(f64),
    /// A plain number.
    Number(f64),
    /// True or false.
    Truth(bool),
    /// A text.
    Text(String),
}

/// Where something is to be put.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// In a region of an object; the first one if it is not named.
    Inside {
        /// Name of the object in the scene.
        object: String,
        /// Name of the region in its model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        region: Option<String>,
    },
    /// On the table, in world coordinates x, y, m.
    Table {
        /// Position.
        at: [f64; 2],
    },
}

/// Asks a skill for a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanRequest {
    /// What the script passed, by parameter name.
    pub arguments: BTreeMap<String, Argument>,
    /// What is believed about the scene now.
    pub belief: SceneBelief,
    /// Positions of the arm joints now.
    pub q: Vec<f64>,
    /// Opening of the gripper now, m.
    pub gripper_width: f64,
    /// Control period, s.
    pub period: f64,
    /// Seed of every random choice; the same request and seed give the same plan.
    pub seed: u64,
}

/// A figure with its unit, for example a joint's position.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// What it is, for example `door`.
    pub name: String,
    /// Its value, SI.
    pub value: f64,
    /// Its unit: `rad`, `m`, `N`, `s`.
    pub unit: String,
}

/// What a plan will do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanSummary {
    /// Its phases in order.
    pub phases: Vec<Phase>,
    /// What will be true of the figures that matter when it has been carried out.
    pub predicted: Vec<Measure>,
    /// What will then be believed.
    pub after: Vec<BeliefChange>,
    /// Where the arm will then be.
    pub q_after: Vec<f64>,
    /// What the host must find true afterwards, by its own sensors.
    pub postconditions: Vec<Postcondition>,
}

/// One phase of a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Phase {
    /// Its name, for example `reach the handle`.
    pub name: String,
    /// How long it takes as planned, s.
    pub seconds: f64,
}

/// A change in what is believed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BeliefChange {
    /// A joint of an object is now at a position.
    Joint {
        /// Object.
        object: String,
        /// Joint.
        joint: String,
        /// Position, rad or m.
        position: f64,
    },
    /// The gripper holds an object.
    Held {
        /// Object.
        object: String,
        /// Its pose in the tool frame.
        X_TO: Isometry3<f64>,
    },
    /// The gripper let go of an object, which is now here.
    Released {
        /// Object.
        object: String,
        /// Its pose in the world.
        X_WO: Isometry3<f64>,
    },
}

/// Something that must be true after a skill, checked by the host with the camera and the gripper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Postcondition {
    /// A joint lies between two positions.
    JointBetween {
        /// Object.
        object: String,
        /// Joint.
        joint: String,
        /// Least position, rad or m.
        least: f64,
        /// Greatest position, rad or m.
        most: f64,
    },
    /// The gripper holds the object.
    Holding {
        /// Object.
        object: String,
    },
    /// The object is where it was to be put, upright.
    At {
        /// Object.
        object: String,
        /// The place.
        place: Place,
    },
}

/// Sensor data for one control period of a running plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepInput {
    /// What the sensors say now.
    pub observation: Observation,
    /// The answer to [`Status::Look`]: what is believed after looking. Given once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub belief: Option<SceneBelief>,
    /// The host asks to stop: come to rest safely and answer [`Status::Failed`] with [`FailureCode::Cancelled`].
    pub cancel: bool,
}

/// What a running plan answers to one [`StepInput`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepReply {
    /// What the robot is to do in the next period. Given also with the last status.
    pub command: Command,
    /// Index of the phase in [`PlanSummary::phases`].
    pub phase: usize,
    /// How much of the whole is done, 0..1.
    pub progress: f64,
    /// How it stands.
    pub status: Status,
}

/// How a running plan stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Go on.
    Running,
    /// Take an image and locate these objects anew; the answer comes in [`StepInput::belief`]. The plan keeps giving
    /// commands meanwhile.
    Look {
        /// Objects.
        objects: Vec<String>,
    },
    /// Done as far as the skill can tell.
    Done {
        /// What it measured, same names as [`PlanSummary::predicted`].
        measured: Vec<Measure>,
        /// What is to be believed now.
        changes: Vec<BeliefChange>,
    },
    /// Failed; the arm is at rest and safe.
    Failed {
        /// Why.
        failure: Failure,
        /// What it measured.
        measured: Vec<Measure>,
        /// What is to be believed now.
        changes: Vec<BeliefChange>,
    },
}

/// Why a skill failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[error("{stage}: {message}")]
pub struct Failure {
    /// What kind of failure, for programs.
    pub code: FailureCode,
    /// Where, for example `grasp`, `path`, `reach`.
    pub stage: String,
    /// What happened and what could be done, for people.
    pub message: String,
}

/// Kinds of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureCode {
    /// An argument is missing, of the wrong kind, or names something that is not there.
    BadArgument,
    /// The model lacks what the skill needs (no grasp hint, no joint, no region).
    ModelLacks,
    /// The camera did not find an object.
    NotSeen,
    /// No grasp or path within the arm's reach and limits.
    Unreachable,
    /// Every path found would collide.
    Collision,
    /// The conic program or search did not converge.
    NoConvergence,
    /// The gripper closed on nothing, or lost what it held.
    GraspLost,
    /// A force or torque was greater than allowed.
    Overload,
    /// The motion did not happen: something is stuck.
    Stuck,
    /// It took too long.
    TimedOut,
    /// The postcondition does not hold.
    PostconditionFailed,
    /// Stopped by the host.
    Cancelled,
    /// The plugin broke its contract or panicked.
    PluginFault,
}
