//! What an effect is made of: numbers with their partial derivatives, what effects read and write, how they describe
//! themselves.

mod along;
mod description;
mod doors;
mod number;
mod partial;

pub use along::{Along, Before};
pub(super) use description::{ABOVE_ZERO, ANY, PLACE, SIZE, around, near, unit};
pub use description::{Acts, Description, Multiple, OfSecond, Parameter, Prior};
pub use doors::{Advance, Force, HISTORY, Instant, Reading, Reshape, Resistance, Row, Sample, Stop, Sway, Transfer, Variables};
pub(super) use number::sign;
pub use number::{Number, Slope, Variable};
pub(super) use partial::parameters;
pub use partial::{MAX_PARAMETERS, MAX_STATES, Partial};
