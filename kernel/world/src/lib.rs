//! The measured world: it answers commands with sensor data, and nothing else.
//!
//! [`World`] is what a controller sees of it. Behind it stand rapier (a physics engine that is not our own simulator),
//! recordings that are replayed, and one day a real robot. What is true in it stays in this crate; only the [`judge`]
//! of a finished run reads it.
#![forbid(unsafe_code)]

mod scene;

pub use scene::{Placement, Scene, SceneObject};

use sagci_signal::{Command, DepthImage, Observation};

/// What a controller sees of the world. One call of [`World::advance`] is one control period.
pub trait World: Send {
    /// Control period, s.
    fn period(&self) -> f64;

    /// Puts the robot and the objects in place and sets the time to zero. Poses and physical parameters are drawn from
    /// the seed around what the scene says; the same scene and seed give the same world, bit for bit.
    fn reset(&mut self, scene: &Scene, seed: u64) -> Result<(), WorldError>;

    /// What the sensors say now.
    fn observe(&self) -> Observation;

    /// An image of the wrist camera, taken now.
    fn look(&mut self) -> Result<DepthImage, WorldError>;

    /// Holds the command for one control period.
    fn advance(&mut self, command: &Command) -> Result<(), WorldError>;
}

/// Why the world could not answer.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// The scene cannot be built.
    #[error("scene: {place}: {message}")]
    Scene {
        /// The object or joint that is wrong.
        place: String,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// A command cannot be carried out: wrong number of joints, or not a finite number.
    #[error("command at {time:.3} s: {message}")]
    Command {
        /// Time, s.
        time: f64,
        /// What is wrong.
        message: String,
    },
    /// The physics broke down.
    #[error("physics at {time:.3} s: {message}")]
    Physics {
        /// Time, s.
        time: f64,
        /// What happened.
        message: String,
    },
}
