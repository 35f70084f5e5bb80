//! What a skill is: a plugin that plans and carries out one kind of action on any object of the scene.
//!
//! A skill is two Rust traits ([`Skill`], [`Execution`]) and a manifest. `export_skill!` puts them behind the C table that
//! the host opens at run time; no Rust type crosses the border.

mod message;

pub use message::{
    Argument, BeliefChange, Failure, FailureCode, Manifest, Measure, Parameter, ParameterKind, Phase, Place, PlanRequest, PlanSummary,
    Postcondition, Status, StepInput, StepReply,
};

/// A skill as its author writes it.
pub trait Skill: Send + Sync + 'static {
    /// What the skill says of itself.
    fn manifest(&self) -> Manifest;

    /// Plans, without moving anything. The same request gives the same plan. `cancelled` is true once the host wants no
    /// plan any more: look at it in every long loop.
    fn plan(&self, request: &PlanRequest, cancelled: &dyn Fn() -> bool) -> Result<Plan, Failure>;
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
}
