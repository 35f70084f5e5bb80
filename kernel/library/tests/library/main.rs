//! The library of object models, tried from outside.
#![allow(clippy::unwrap_used, clippy::panic)]

mod shipped;
mod store;
