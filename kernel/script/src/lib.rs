//! Task scripts: the Rhai engine, the plugin host and the run record.
#![deny(unsafe_code)]

mod diagnostic;
pub mod host;
pub mod language;
mod models;
pub mod plugins;

pub use diagnostic::Diagnostic;
pub use models::{LibraryModels, Models};
