//! Helpers shared by the tests across the house.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod build;
mod house;
mod skill;
mod world;

pub use build::{Built, build_push, program, rustc_library};
pub use house::{PUSH_SOURCE, PUSH_YAML, ToyModels, panda, root, write};
pub use skill::{Scripted, ScriptedSkill, loaded};
pub use world::{FakeEyes, FakeWorld, FakeWorlds, Truth};
