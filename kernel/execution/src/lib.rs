//! Carries out a plan, one control period at a time.
//!
//! A skill lines up [`Segment`]s in phases; a [`Sequence`] follows them, watches forces, progress and the grip, and brings
//! the arm to rest when something is wrong or the host asks it to stop.
//!
//! A trajectory is followed on a clock that waits for the arm: with `e` the distance by which the tool is late and `e_max` the
//! lag allowed, the clock runs at the rate `1 - e / e_max`, never backwards. A hand that is held up therefore never winds up
//! more force than the law's stiffness times `e_max`.
#![forbid(unsafe_code)]

mod arm;
mod articulate;
mod bench;
mod finger;
mod follow;
mod segment;
mod sequence;

pub use arm::Arm;
pub use articulate::{Motion, articulate, pace};
pub use bench::{Bench, Pace, bad_argument, failure_of, through_air, with_feeling};
pub use segment::{Fingers, Follow, Guard, Law, Segment};
pub use sequence::{Ending, Report, Sequence};
