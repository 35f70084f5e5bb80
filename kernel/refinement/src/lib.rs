//! Where prediction and measurement disagree, and what the disagreement says about the stored model.
//!
//! [`gaps`] sets the figures that a skill predicted beside those that were measured. [`joint_from_hand_path`] reads a
//! joint off the path of the hand that held its handle, and [`axis_gap`] says how far the stored axis is off. [`held_joint`] says
//! what a joint of a stored model did while its handle was held, and what moved it.
//!
//! Frames: `W` world, `T` the tool frame between the finger pads, `P` a joint's parent link, `J` the joint's frame.
#![forbid(unsafe_code)]

mod gap;
mod hand_path;
mod held_joint;

pub use gap::{Figure, Gap, gaps};
pub use hand_path::{AxisGap, HandPath, HandPathError, JointEstimate, StoredAxis, axis_gap, joint_from_hand_path, stored_axis};
pub use held_joint::{HeldJoint, HeldJointError, Zero, held_joint};
