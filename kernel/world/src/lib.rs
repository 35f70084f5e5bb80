//! The measured world: it answers commands with sensor data, and nothing else.
//!
//! [`World`] is what a controller sees of it. Behind it stand rapier (a physics engine that is not our own simulator),
//! recordings that are replayed, and one day a real robot. What is true in it stays in this crate; only the [`judge`]
//! of a finished run reads it.
#![forbid(unsafe_code)]

mod camera;
mod convert;
mod geometry;
mod hidden;
pub mod judge;
mod perturbation;
mod random;
mod rapier;
pub mod recording;
mod scene;
mod sensors;
#[cfg(test)]
mod testing;
#[allow(dead_code)] // Written down by the recorder only.
mod truth;

pub use perturbation::Perturbation;
pub use rapier::RapierWorld;
pub use scene::{Placement, Scene, SceneObject};
pub use sensors::SensorNoise;

use judge::{Goal, NamedEffect, Verdict};

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

    /// Takes note of what a run says that a stored model lacks, for the judge to score. Nothing comes back, so that nobody can try names until
    /// one is right; a later answer for the same joint takes the place of an earlier one.
    fn answer(&mut self, object: &str, named: &[NamedEffect]) {
        let _ = (object, named);
    }

    /// Ends the run and holds the goals against what is true. It consumes the world, so that nobody can act on the
    /// answer. `None` where the truth is not known: a real robot, a recording without it, a world never reset.
    fn judge(self: Box<Self>, goals: &[Goal]) -> Option<Verdict> {
        let _ = goals;
        None
    }
}

/// How a measured world is made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WorldOptions {
    /// How far it may differ from the stored models.
    pub perturbation: Perturbation,
    /// How well its sensors measure.
    pub sensors: SensorNoise,
}

/// The kinds of worlds that [`open`] knows.
pub const KINDS: [&str; 1] = ["rapier"];

/// Makes a measured world of a kind, one of [`KINDS`].
pub fn open(kind: &str, options: WorldOptions) -> Result<Box<dyn World>, WorldError> {
    match kind {
        "rapier" => Ok(Box::new(RapierWorld::new(options))),
        other => Err(WorldError::Kind { kind: other.to_owned(), known: KINDS.join(", ") }),
    }
}

/// Why the world could not answer.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// There is no such kind of world.
    #[error("there is no world of the kind '{kind}'; choose one of: {known}")]
    Kind {
        /// What was asked for.
        kind: String,
        /// What there is.
        known: String,
    },
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
