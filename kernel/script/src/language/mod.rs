//! The language of task scripts.

pub mod bind;
pub mod check;
pub mod engine;
pub mod execute;
mod gap;
pub mod modules;
pub mod stage;
pub mod suggest;
pub mod value;
