//! Rigid-body dynamics of trees of URDF joints.
//!
//! [`System`] is what one simulates: a multibody with the named effects on its joints, stepped in time.
//!
//! [`Multibody`] is the constant part, built once from one or several object models. [`Workspace`] is everything that
//! changes: it is made once from a multibody, and nothing allocates after that. [`Multibody::set_state`] puts a state in;
//! all other algorithms answer for that state.
//!
//! # Conventions
//! * SI units and radians. Frames in Drake's monogram notation.
//! * A spatial vector ([`SpatialVector`]) has its angular part first: `V = [omega; v]`, `F = [torque; force]`.
//!   Inside the workspace all of them are written in the world's axes and taken at the world's origin, so that parents and
//!   children add without transforms (Featherstone 2008, chapter 2; Singh, Russo and Wensing 2022 for the derivatives that
//!   this form makes short).
//! * Positions `q` and velocities `v` follow the model's joints: part by part, each in the order of
//!   [`sagci_model::ObjectModel::moving_joints`]; a floating base stands before the joints of its part.
//! * A joint's velocities are the coordinates of its child's motion in the **child's** frame. The motion subspace is then
//!   constant in the child for every kind of joint. For one degree of freedom it is the plain rate of `q`.
//!
//! | joint | q | v |
//! |---|---|---|
//! | revolute, continuous | angle | its rate |
//! | prismatic | length | its rate |
//! | planar (normal `n`) | x, y along `e1`, `e2` of the joint's frame, then the angle about `n` | slides along the child's `e1`, `e2`, then the turn |
//! | floating | quaternion w, x, y, z, then position x, y, z in the joint's frame | angular velocity, then velocity of its origin, both in the child's axes |
//!
//! The planar joint's `e1` is the joint frame's x axis projected across `n` (its y axis where x is nearly parallel to
//! `n`), and `e2 = n x e1`.
#![forbid(unsafe_code)]

mod algorithms;
mod complementarity;
mod contact;
pub mod effects;
mod error;
mod joint;
mod linear;
mod linearise;
mod measurement;
mod multibody;
mod parameter;
mod placed;
pub mod residual;
mod reverse;
pub mod rollout;
mod sensitivity;
mod spatial;
mod step;
mod system;
mod workspace;

pub use algorithms::adjoint::{Adjoint, RigidGradient};
pub use algorithms::derivatives::{ForwardDynamicsDerivatives, InverseDynamicsDerivatives};
pub use algorithms::momentum::Momentum;
pub use algorithms::parameters::RigidParameter;
pub use complementarity::Held;
pub use contact::{ContactMaterial, ContactOptions, ContactPoint, Grasp};
pub use error::DynamicsError;
pub use joint::plane_axes;
pub use linear::{cholesky, cholesky_solve, cholesky_solve_lower};
pub use linearise::Linearisation;
pub use measurement::MeasurementDerivatives;
pub use multibody::{Base, GRAVITY, JointId, JointInfo, LinkId, Multibody, Part};
pub use parameter::{ParameterId, ParameterKind, ParameterVector};
pub use placed::{Cotangents, MultibodyMut, ParametersMut, Taken};
pub use reverse::{NaturalGradient, StateCotangent, Wanted};
pub use spatial::{SpatialInertia, SpatialVector, cross_force, cross_motion, wrench_at_origin};
pub use step::{Coriolis, StepWorkspace};
pub use system::{Input, Placement, State, System};
pub use workspace::{ExternalWrench, Workspace};
