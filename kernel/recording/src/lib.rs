//! What was measured on the joints of one mechanism, as time series.
#![forbid(unsafe_code)]

mod log;

pub use log::{CommandKind, JointLog, Log, Note, Series, WrenchLog};
