//! One algorithm a file. All of them answer for the state that [`crate::Multibody::set_state`] put into the workspace.

pub(crate) mod adjoint;
pub(crate) mod derivatives;
mod forward_dynamics;
mod gravity;
mod inverse_dynamics;
mod jacobian;
mod kinematics;
mod mass_matrix;
pub(crate) mod momentum;
pub(crate) mod parameters;
pub(crate) mod pendulum;
mod regressor;
