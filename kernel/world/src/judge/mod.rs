//! The judge of a finished run: goals, read from a file beside the script, held against the world's true state.
//!
//! Judging consumes the world, so that nobody can act on what it says.

mod goal;
mod named;
mod verdict;

pub(crate) use goal::Resolved;
pub use goal::{EffectNamed, Goal, GoalError, Goals, Inside, JointAt, JointPassed, Untouched, Upright};
pub use named::NamedEffect;
pub use verdict::{GoalVerdict, Verdict};
