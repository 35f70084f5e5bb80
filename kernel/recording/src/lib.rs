//! What was measured on the joints of one mechanism, as time series.
#![forbid(unsafe_code)]

pub mod cdr;
mod container;
mod log;
mod message;

pub use container::{Cut, records};
pub use log::{CommandKind, JointLog, Log, Note, Series, WrenchLog};
pub use message::{JointState, WrenchStamped};
