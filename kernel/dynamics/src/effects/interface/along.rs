//! An effect along a motion that is known, row by row.

use super::Instant;

/// What comes before a row of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Before {
    /// The row that the motion goes on from.
    Row,
    /// A pause after the row before, in which the joint stood there.
    Pause,
    /// Nothing: inner states are zero.
    Nothing,
}

/// A row of a motion. What an effect has inside is its own, so that the row's instant comes without.
#[derive(Debug, Clone, Copy)]
pub struct Along {
    /// The step that the row begins. Its length is zero where the next row does not follow it.
    pub at: Instant<'static>,
    /// What comes before.
    pub before: Before,
}
