//! Judges whoever finds and names effects that a model lacks: hides effects in mechanisms that move by other engines than the
//! simulator, hands over the model and noisy recordings and nothing else, and scores the answers against the sealed truth.
//!
//! The parts, in the order in which a run passes through them:
//! - a *scenario* is drawn from a seed: a mechanism, its model, what is hidden and how large, how it is moved, which sensors
//!   ([`draw`]; what is given is [`Given`], what is true is [`SealedTruth`]);
//! - a *plant* moves: rapier's multibody, or a Runge-Kutta integrator that stops where dry friction takes hold. Effects act by
//!   formulas of this crate, written from the table of names and parameters;
//! - an *oracle* says whether the effect is visible in these data at all ([`Detectability`]);
//! - the *runner* asks the workflow, blindly, many times ([`run`]), and where it cannot tell names apart does the experiment that it proposes
//!   on the true mechanism ([`Bench`]) and asks again;
//! - the *score* ([`judge`], [`table`]).
//!
//! Beside it, unseen furniture is looked at and to be modelled ([`judge_perception`]).
//!
//! This crate does not know the simulator, nor the workflow: the workflow is a function from [`Given`] to a JSON document.
#![forbid(unsafe_code)]

mod effect;
mod error;
mod oracle;
mod perception;
mod plant;
mod random;
mod runner;
mod scenario;
mod score;
mod simulate;

pub use effect::{CATALOGUE, Circumstances, OUTSIDE, channels, indistinguishable};
pub use error::EvaluationError;
pub use oracle::{Detectability, VISIBLE};
pub use perception::{AnsweredJoint, Case, CloudAnswer, PerceptionOptions, PerceptionRow, PerceptionTable, case, judge_perception};
pub use runner::{Options, Suite, run};
pub use scenario::{Bench, Given, Hidden, RunId, RunKind, Scenario, SealedTruth, draw};
pub use score::{Gap, Judgement, Row, Table, Trial, judge, table};

#[cfg(test)]
mod tests;
