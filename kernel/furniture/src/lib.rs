//! Articulated furniture drawn from a seed, with its truth, and a depth camera that looks at it.
//!
//! No data set of articulated objects comes with this project, so it draws its own: boxes, doors, microwaves, ovens,
//! refrigerators and storage furniture. An object is a body and the parts that move in it, each a union of boxes and cylinders
//! with sides along the part's axes, so that one ray is carried into a part's frame once and then costs six multiplications a
//! solid. A *family* is one way of building a category ([`FAMILIES`]). Some families are held out: nothing may be trained on them, so
//! that what is measured on them says something about objects of other makers.
//!
//! What is true stands here ([`Object`], [`Labelled`]). Whoever models an object from a cloud must not depend on this crate.
//!
//! Frames: `F` the object (x out of its front, y to its left, z up, origin under the body's centre), `W` the world (z up), `C` a
//! camera (x right, y down, z forward). Metres and radians. A joint is shut at zero and opens in the positive direction.
#![forbid(unsafe_code)]

mod camera;
mod carcass;
mod cloud;
mod even;
mod family;
mod front;
mod handle;
mod noise;
mod object;
mod random;

pub use camera::{Camera, Hit, cast};
pub use cloud::{Labelled, Look, Seen, look, look_with};
pub use even::{Even, evenly};
pub use family::{FAMILIES, Family, STILL, families};
pub use noise::Noise;
pub use object::{Category, Class, Form, Joint, Kind, Object, Part, Solid};
pub use random::Random;
