//! What a script acts on. The language knows nothing else of the world, so it can be tried without one.

use std::collections::BTreeMap;

use sagci_skill::{Argument, Failure, Measure};

use super::value::{Angle, At, Inside, Length, RunHandle};
use crate::plugins::LoadedSkill;

/// One `scene.expect(...)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Declaration {
    /// Name in the scene.
    pub name: String,
    /// Name of the model in the library.
    pub model: String,
    /// Where it is said to be.
    pub place: DeclaredPlace,
    /// Positions at the start of those joints that are not shut.
    pub joints: Vec<(String, Quantity)>,
}

/// Where a thing is said to be.
#[derive(Debug, Clone, PartialEq)]
pub enum DeclaredPlace {
    /// On the table.
    Table {
        /// Where.
        at: At,
        /// Which way it faces.
        facing: Angle,
    },
    /// In a region of another object.
    Inside(Inside),
}

/// An angle or a length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    /// An angle.
    Angle(Angle),
    /// A length.
    Length(Length),
}

/// A request of the script that cannot be met because the script is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub hint: Option<String>,
}

/// A skill that was carried out.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// World time it took, s.
    pub seconds: f64,
    /// What was measured.
    pub measured: Vec<Measure>,
}

/// Asks what an object's model lacks.
#[derive(Debug, Clone, PartialEq)]
pub struct GapRequest {
    /// Name of the object in the scene.
    pub object: String,
    /// What is fitted.
    pub runs: Vec<RunHandle>,
    /// What is not, and has to agree; if there is none, a part of `runs` where they are three or more.
    pub held_out: Vec<RunHandle>,
    /// Publish the better model, and plan with it from then on.
    pub apply: bool,
    /// Publish also what held-out data do not confirm.
    pub accept_unconfirmed: bool,
    /// Length of the windows over which positions are predicted, s.
    pub window: f64,
}

/// What an object's model lacks.
#[derive(Debug, Clone, PartialEq)]
pub struct GapAnswer {
    /// `no_gap`, `named`, `ambiguous` or `unknown`.
    pub verdict: String,
    /// The effects.
    pub effects: Vec<FoundEffect>,
    /// RMSE of the predicted positions, on data that were not fitted where there are any: of the model as it was, with its known numbers
    /// refitted, with the effects, and what the noise alone gives.
    pub before: Quantity,
    /// See `before`.
    pub refitted: Quantity,
    /// See `before`.
    pub after: Quantity,
    /// See `before`.
    pub noise_floor: Quantity,
    /// The version that was published.
    pub version: Option<String>,
    /// What was doubted or left out, in sentences.
    pub notes: Vec<String>,
}

/// An effect that a model lacked.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundEffect {
    /// Its name in the catalogue.
    pub name: String,
    /// Names that the data cannot tell from it.
    pub alternatives: Vec<String>,
    /// Its joint.
    pub joint: String,
    /// Its numbers, SI units.
    pub parameters: BTreeMap<String, f64>,
    /// Data that were not fitted agree.
    pub confirmed: bool,
}

/// An experiment that tells apart what the data so far do not, as far as a hand that opens and shuts can do it.
#[derive(Debug, Clone, PartialEq)]
pub struct AskedExperiment {
    /// Name of the object in the library.
    pub object: String,
    /// Its joint.
    pub joint: String,
    /// The experiment, such as `quasi_static_sweep`.
    pub kind: String,
    /// Positions between which it goes.
    pub positions: BTreeMap<String, Quantity>,
    /// Its other numbers, SI units.
    pub numbers: BTreeMap<String, f64>,
    /// The joint slides.
    pub slides: bool,
    /// What to do and why, for a person.
    pub reason: String,
}

/// Why a skill call did not end well.
#[derive(Debug)]
pub enum Stop {
    /// The skill failed; the script may catch it.
    Failed(Failure),
    /// The script asks for what cannot be.
    Refused(Refusal),
    /// Someone asked the run to stop.
    Interrupted,
    /// The world or the program broke down; nothing can be caught. The message says what.
    Broken(String),
}

/// The other side of a script.
pub trait Stage {
    /// A thing is said to be there.
    fn expect(&mut self, declaration: Declaration) -> Result<(), Refusal>;

    /// A thing stands in the measured world of which the robot is told nothing.
    fn unknown(&mut self, declaration: Declaration) -> Result<(), Refusal>;

    /// `scene.learn(name)`: what the wrist's camera sees and nobody has told of becomes a model of the library and an object of the scene.
    fn learn(&mut self, name: &str) -> Result<(), Stop>;

    /// The robot is said to be this one.
    fn robot(&mut self, model: &str) -> Result<(), Refusal>;

    /// A skill is called.
    fn call(&mut self, skill: &LoadedSkill, arguments: BTreeMap<String, Argument>) -> Result<Outcome, Stop>;

    /// Where a joint is believed to be; the object's first moving joint if none is named.
    fn position(&mut self, object: &str, joint: Option<&str>) -> Result<Quantity, Refusal>;

    /// `scene.hidden_effect(object)`: the measured joint has an effect that the stored model lacks; the first moving joint if none is named.
    fn hide(&mut self, object: &str, joint: Option<&str>) -> Result<(), Refusal>;

    /// `last_run()`: the last call of a skill that moved an object's joint.
    fn last_run(&mut self) -> Result<RunHandle, Refusal>;

    /// `gap(object, runs, ...)`.
    fn gap(&mut self, request: &GapRequest) -> Result<GapAnswer, Stop>;

    /// `asked_experiment()`: what the gap workflow asks to be done next, if it runs the script.
    fn asked(&self) -> Option<AskedExperiment>;

    /// `prediction_error(object, run)`: RMSE of the positions that the object's model predicts for a run.
    fn prediction_error(&mut self, object: &str, run: RunHandle) -> Result<Quantity, Stop>;

    /// `object.version`: the version of the object's model that is planned with now.
    fn version(&mut self, object: &str) -> Result<String, Refusal>;

    /// `print(...)`.
    fn say(&mut self, text: &str);
}
