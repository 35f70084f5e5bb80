//! One algorithm a file. All of them answer for the state that [`crate::Multibody::set_state`] put into the workspace.

mod forward_dynamics;
mod inverse_dynamics;
mod jacobian;
mod kinematics;
mod mass_matrix;
pub(crate) mod momentum;
