//! The object model's reader and writer, tried from outside.
#![allow(clippy::unwrap_used, clippy::panic)]

mod broken;
mod fuzz;
mod round_trip;
