//! Control laws that run once each control period on what the sensors say, without allocating.
//!
//! [`ArmModel`] answers for the robot's own rigid-body model: tool pose, Jacobian, mass matrix, and the efforts that
//! gravity and motion need. [`JointImpedance`] and [`CartesianImpedance`] turn a reference into efforts. [`EffortLimit`]
//! keeps them within what the drives can give. [`WrenchFilter`] smooths a force sensor.
//!
//! Spatial vectors have their angular part first: `V = [omega; v]`, `F = [torque; force]`. The tool frame `T` is the one
//! that the robot's `model.yaml` gives between the finger pads.
#![forbid(unsafe_code)]

mod arm;
mod cartesian;
mod error;
mod filter;
mod joint;
mod limit;

pub use arm::{ArmModel, Payload};
pub use cartesian::{CartesianImpedance, CartesianReference, Damping, Posture};
pub use error::ControlError;
pub use filter::WrenchFilter;
pub use joint::{JointImpedance, JointReference};
pub use limit::EffortLimit;
