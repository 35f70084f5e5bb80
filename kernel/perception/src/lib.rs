//! Where the stored objects are: wrist-camera images registered to stored geometry, from a rough prior.
//!
//! A depth pixel says two things: a surface lies where its ray ended, and nothing lies before that. Both are used.
//! For an object `O` with root pose `X_WO` and joint positions `q`, a hypothesis is scored by the pixels whose points
//! lie on its surfaces, less the pixels whose rays went through a surface that it claims. What other things hide counts
//! neither way. The best hypotheses of a grid over the prior are refined by robust point-to-plane registration (Chen and
//! Medioni 1992; Tukey's biweight), and the covariance is the inverse Hessian with as many independent samples as the
//! correlation of neighbouring residuals leaves (see [`Located::covariance`]).
//!
//! Frames: `W` world, `O` root link of the object, `L` a link, `C` camera (x right, y down, z forward), `R` robot root.
#![forbid(unsafe_code)]

mod align;
mod error;
mod evidence;
mod frame;
mod hypothesis;
mod locate;
mod mount;
mod polish;
mod problem;
mod request;
mod scene;
mod surface;
mod view;

pub use error::PerceptionError;
pub use locate::locate;
pub use request::{Freedom, JointSearch, Located, Place, Prior, Request, SceneRequest};
pub use scene::{locate_scene, unexplained};
pub use view::{KnownBody, View, X_WC, robot_positions};
