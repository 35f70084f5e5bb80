//! From the point cloud of an unseen object to its model: parts, joints, shapes.
//!
//! A cloud is thinned, what it stands on is taken away, and its surface is cut into *superpoints*: flat pieces and lumps
//! ([`analyse`]). Furniture is box-like, so a frame with z up and sides along its walls is found from the normals; which of
//! the four upright sides is the front is asked of the network. The network ([`network`]) sees superpoints, their points and how
//! two of them lie to one another, and answers: body, door, drawer, lid or flap; one part or two; and which of a part's few
//! candidate joints it moves by. Candidates come from geometry: hinges at the two ends of the part's section, slides along its
//! normal. So an axis is chosen among a few that can be, and only a small residual of its place is regressed. Which pieces are one part is
//! asked of whole groups ([`MASK`]), and each point near a part by itself: superpoints know only such ends of parts as show as gaps. Last
//! it is asked how far parts are to be trusted, and whether anything says that they move ([`EVIDENCE`], [`perceive()`]).
//!
//! After the paper's first stage (Lv et al., "Environment Initial Modeling"): segmentation into K parts, pairwise joint
//! relation J and its spatial description C, a greedy directed tree. Furniture's parts hang in the body, so the tree's edges lead
//! from there.
//!
//! Frames: `W` the world (z up), `A` the object's box (its axes along the walls), `K` the same with x out of the front.
#![forbid(unsafe_code)]

mod analysis;
mod around;
mod background;
mod border;
mod candidate;
mod crossing;
mod decide;
mod ended;
mod error;
mod evidence;
mod feature;
mod first;
mod frame;
mod grid;
mod ground;
mod grouping;
mod handle;
mod lens;
mod mask;
mod motion;
mod moves;
pub mod network;
mod normal;
mod perceive;
mod place;
mod posed;
mod prepare;
mod report;
mod seam;
mod side;
mod solid;
mod superpoint;
mod taught;
mod trust;
mod wall;

pub use analysis::{Analysis, analyse};
pub use border::BORDER;
pub use candidate::{FARTHEST, RESIDUAL};
pub use error::ModellingError;
pub use evidence::EVIDENCE;
pub use feature::{CANDIDATES, Features, SAMPLES, touching};
pub use lens::Lens;
pub use mask::{MASK, RELATION};
pub use moves::PartClass;
pub use network::Weights;
pub use perceive::{Perceived, perceive};
pub use place::{ANSWERS as PLACE_ANSWERS, MEMBERS as PLACE_MEMBERS, PLACE};
pub use report::{Alternative, JointReport, PartReport, Probabilities, Report, Seconds, Uncertainty};
pub use side::{Options, Side};
pub use taught::{Borders, Ends, Groups, Hinges};
pub use trust::TRUST;
