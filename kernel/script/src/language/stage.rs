//! What a script acts on. The language knows nothing else of the world, so it can be tried without one.

use std::collections::BTreeMap;

use sagci_skill::{Argument, Failure, Measure};

use super::value::{Angle, At, Inside, Length};
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

    /// The robot is said to be this one.
    fn robot(&mut self, model: &str) -> Result<(), Refusal>;

    /// A skill is called.
    fn call(&mut self, skill: &LoadedSkill, arguments: BTreeMap<String, Argument>) -> Result<Outcome, Stop>;

    /// Where a joint is believed to be; the object's first moving joint if none is named.
    fn position(&mut self, object: &str, joint: Option<&str>) -> Result<Quantity, Refusal>;

    /// `print(...)`.
    fn say(&mut self, text: &str);
}
