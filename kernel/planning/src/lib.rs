//! Plans: the object alone first, then the robot.
//!
//! Frames in Drake's monogram notation: `W` world, `R` the robot's root link, `T` the tool frame between the finger pads,
//! `O` an object's root link, `L` a link, `F` a goal frame that leaves some motion free. SI units and radians.
//! Everything is deterministic: the same arguments and seed give the same bits.
#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod articulation;
mod collision;
mod convert;
mod ddp;
mod error;
mod free_motion;
mod grasp;
mod inverse;
mod kinematics;
mod object_motion;
mod path;
mod scene;
mod spline;
mod timing;
mod transfer;

pub use articulation::{ArticulationPlan, ArticulationRequest, joint_dynamics, plan_articulation};
pub use collision::{CollisionWorld, Contact, LinkSet};
pub use ddp::{Cost, Ddp, DdpEnd, DdpOptions, DdpSummary, Knot, Quadratic, ReachCost, ReachWeights};
pub use error::PlanError;
pub use free_motion::{FreeMotionOptions, FreePath, free_motion, tool_stray};
pub use grasp::{Grasp, GraspOptions, grasps};
pub use inverse::InverseOptions;
pub use kinematics::{ArmKinematics, Freedom};
pub use object_motion::{JointDynamics, ObjectMotionOptions, ObjectTrajectory, object_motion};
pub use path::{ArmPath, PathCheck, PathOptions, ToolPath, Waypoint, arm_path, straight_line};
pub use scene::{Scene, SceneObject};
pub use timing::{InverseDynamics, JointSample, JointTrajectory, MotionLimits, time_path};
pub use transfer::{Destination, PickPlan, PlacePlan, TransferOptions, extents, plan_pick, plan_place};
