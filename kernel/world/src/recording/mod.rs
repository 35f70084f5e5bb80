//! What happened, on disk: MCAP files that Foxglove and Rerun show as they are.
//!
//! | channel | schema | encoding | when |
//! |---|---|---|---|
//! | `/joint_states` | sensor_msgs/msg/JointState | ros2msg, CDR | 250 Hz |
//! | `/joint_commands` | sensor_msgs/msg/JointState | ros2msg, CDR | every control period |
//! | `/wrench` | geometry_msgs/msg/WrenchStamped | ros2msg, CDR | 250 Hz |
//! | `/robot_description` | std_msgs/msg/String | ros2msg, CDR | once |
//! | `/tf` | foxglove.FrameTransforms | JSON | 25 Hz, and when a belief changes |
//! | `/camera/points` | foxglove.PointCloud | JSON | each image |
//! | `/camera/depth` | foxglove.RawImage | JSON | each image |
//! | `/log` | foxglove.Log | JSON | as it happens |
//! | `/phase` | sagci.Phase | JSON | when a phase begins, and as it goes on |
//! | `/truth` | sagci/msg/TrueFrame | ros2msg, CDR | 50 Hz |
//!
//! The run record (script, seed, versions) is an attachment, written first so that even a file that is cut off has it;
//! the outcome is another, written last. The metadata `sagci.end` closes a file: the number of messages and the SHA-256
//! of all of them in order, and of the true frames alone.
//!
//! A chunk is closed every half second of the run, so a file that is cut off is read up to there.
//!
//! `/truth` is written in this crate from what only this crate knows. [`Recording`] does not give it out; only
//! [`replay_states`] shows it, to a person, after the run.

mod error;
mod journal;
mod message;
mod reader;
mod record;
mod replay;
mod schema;
#[cfg(test)]
mod tests;
mod world;

pub use error::RecordingError;
pub use journal::{Journal, Level};
pub use reader::{Entry, PhaseEntry, Recording};
pub use record::{Outcome, RunRecord, Versioned};
pub use replay::{Replayed, replay_states};
pub use sagci_recording::Cut;
pub use world::RecordedWorld;

/// Nanoseconds since the start of the run.
fn nanoseconds(seconds: f64) -> u64 {
    // Casts saturate: a negative or undefined time is the start.
    (seconds * 1e9).round() as u64
}
