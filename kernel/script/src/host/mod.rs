//! Runs a task script: against a world, or as a plan only.

mod aim;
mod arm;
mod belief;
mod gap;
mod geometry;
mod learn;
mod live;
/// What happens in a run, as it happens.
pub mod progress;
pub mod report;
mod run;
mod scene;
mod step;

pub use live::{Perceive, Registration};
pub use run::{BROKEN, Kit, RunError, RunOptions, WorldSource, run, run_many};
