//! The language of task scripts.

pub mod bind;
pub mod check;
pub mod engine;
mod gap;
pub mod execute;
pub mod modules;
pub mod stage;
pub mod suggest;
pub mod value;
