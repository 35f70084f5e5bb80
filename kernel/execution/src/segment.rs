//! The pieces that a plan is made of.

use nalgebra::Vector3;
use sagci_control::Payload;
use sagci_planning::JointTrajectory;
use sagci_signal::GripperCommand;

/// One piece of a plan, carried out until its own end is reached.
#[derive(Debug, Clone)]
pub enum Segment {
    /// Follow a joint trajectory.
    Follow(Follow),
    /// Move the fingers and wait until they rest.
    Fingers(Fingers),
    /// From here on the hand carries this, or nothing.
    Carry(Option<Payload>),
}

impl Segment {
    /// How long it takes as planned, s.
    pub fn seconds(&self) -> f64 {
        match self {
            Self::Follow(follow) => follow.trajectory.duration(),
            Self::Fingers(_) => 0.5,
            Self::Carry(_) => 0.0,
        }
    }
}

/// Follows a joint trajectory under a control law.
#[derive(Debug, Clone)]
pub struct Follow {
    /// Where the joints should be over time.
    pub trajectory: JointTrajectory,
    /// How stiffly.
    pub law: Law,
    /// What the gripper does meanwhile.
    pub gripper: GripperCommand,
    /// What ends it before its time.
    pub guard: Guard,
    /// The gripper must stay at least this far open, m: less means that what it held has slipped out. Zero where it holds nothing.
    pub least_width: f64,
}

/// How a trajectory is followed.
#[derive(Debug, Clone, PartialEq)]
pub enum Law {
    /// Joint by joint, stiff: for free space.
    Joints,
    /// The tool's pose, as a spring: stiff along the path and soft across it, so that an error of the model costs little
    /// force.
    Tool {
        /// Stiffness along the path, N/m.
        along: f64,
        /// Stiffness across the path, N/m.
        across: f64,
        /// Stiffness against turning, N m/rad.
        turning: f64,
        /// Moves the whole path to where the hand stands when it begins: what it holds is where the hand is, and not where
        /// the model says.
        anchored: bool,
        /// Force along the path that the plan expects to need, N, evenly spaced over the path; none if empty.
        push: Vec<f64>,
    },
}

/// When a trajectory ends before its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Guard {
    /// Only a force beyond `limit` ends it, as a failure.
    Overload {
        /// N.
        limit: f64,
    },
    /// A push of at least `force` against the motion ends it well: something was touched.
    Touch {
        /// N.
        force: f64,
        /// Unit vector of the motion, in the world.
        direction: Vector3<f64>,
        /// A force beyond this is a failure all the same, N.
        limit: f64,
    },
    /// The hand is held up while it pushes: the motion has met a stop. That ends it well if at least `share` of the path is
    /// behind, else it is stuck.
    Stop {
        /// Share of the path, 0..1.
        share: f64,
        /// A force beyond this is a failure, N.
        limit: f64,
    },
}

impl Guard {
    pub(crate) fn limit(&self) -> f64 {
        match self {
            Self::Overload { limit } | Self::Touch { limit, .. } | Self::Stop { limit, .. } => *limit,
        }
    }
}

/// Moves the fingers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fingers {
    /// Opening aimed at, and force.
    pub gripper: GripperCommand,
    /// The opening at which they must come to rest, m: least and greatest. Outside it the grasp has failed.
    pub expected: [f64; 2],
    /// Does the hand give way along the opening, so that an object that is fixed draws the hand to its middle?
    pub yielding: bool,
    /// Longest time, s.
    pub timeout: f64,
}
