//! What was measured on the joints of one mechanism, as time series.
//!
//! [`read`] takes what robots and loggers write (MCAP as ROS 2 records it, recordings of our own runs, CSV) and gives one [`Log`] a file:
//! for each joint its position, velocity, effort and command, each with times of its own, in order, finite, in SI units. What had to be
//! set right or is doubtful is said in [`Log::notes`]; what cannot be right is an error that says where it is and what to do.
//! `FORMATS.md` beside this crate describes the files.
#![forbid(unsafe_code)]

pub mod cdr;
mod check;
mod container;
mod csv;
mod error;
mod hash;
mod log;
mod message;
mod raw;
mod read;
mod robot;
mod turns;

pub use container::{Cut, records};
pub use error::RecordingError;
pub use log::{CommandKind, JointLog, Log, Note, Series, WrenchLog};
pub use message::{JointState, WrenchStamped};
pub use read::{Angles, LARGEST_FILE, Lengths, Options, read, read_with};
