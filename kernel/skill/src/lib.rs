//! What a skill is: a plugin that plans and carries out one kind of action on any object of the scene.
//!
//! A skill is two Rust traits ([`Skill`], [`Execution`]) and a manifest. [`export_skill!`] puts them behind the C table that
//! the host opens at run time; no Rust type crosses the border ([`abi`]). The host wraps the table in [`Plugin`], which is a
//! [`Skill`] again: a skill can be tried as a Rust type, through its table in process, and through its shared library.
#![deny(clippy::undocumented_unsafe_blocks)]

pub mod abi;
mod host;
mod manifest;
mod message;
mod plugin;

pub use abi::{LogLevel, SkillTable};
pub use host::{AbiError, LogSink, Plugin};
pub use manifest::ManifestError;
pub use message::{
    Argument, BeliefChange, Failure, FailureCode, Manifest, Measure, Parameter, ParameterKind, Phase, Place, PlanRequest, PlanSummary,
    Postcondition, Status, StepInput, StepReply,
};
pub use plugin::log;

/// A skill as its author writes it.
pub trait Skill: Send + Sync + 'static {
    /// What the skill says of itself: mostly `Manifest::from_yaml(include_str!("../skill.yaml"))`.
    fn manifest(&self) -> Result<Manifest, ManifestError>;

    /// Plans, without moving anything. The same request gives the same plan. `cancelled` is true once the host wants no
    /// plan any more: look at it in every long loop.
    fn plan(&self, request: &PlanRequest, cancelled: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure>;
}

/// A plan, ready to be carried out.
pub struct Plan {
    /// What it will do.
    pub summary: PlanSummary,
    /// Carries it out.
    pub execution: Box<dyn Execution>,
}

/// A plan being carried out: called once each control period, it must answer well within the period.
pub trait Execution: Send {
    /// The command for the next period.
    fn step(&mut self, input: &StepInput) -> StepReply;

    /// From now on every input counts as one with `cancel` set. A plugin's border does this by itself; a skill need not.
    fn cancel(&mut self) {}
}
