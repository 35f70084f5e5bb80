//! Effects as forces, by formulas of our own: from the published table of names and parameters, not from the simulator.

mod joint;
mod names;
mod term;

pub(crate) use joint::Hold;
pub(crate) use joint::JointPhysics;
pub use names::{CATALOGUE, Circumstances, OUTSIDE, channels, indistinguishable};
pub(crate) use term::{At, Term};
