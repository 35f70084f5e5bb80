//! Task scripts: the Rhai engine, the plugin host and the run record.
#![deny(unsafe_code)]

pub mod plugins;
