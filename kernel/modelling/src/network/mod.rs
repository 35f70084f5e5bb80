//! The learned part: its layers, its weights.

mod algebra;
mod architecture;
mod weights;

pub use algebra::{Algebra, Matrix, Plain, TINY, attention, softmax_rows};
pub(crate) use architecture::WIDTH;
pub use architecture::{CLASSES, GROUP, Network, Trunk};
pub use weights::Weights;
