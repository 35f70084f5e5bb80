use serde::{Deserialize, Serialize};

/// What was run: enough to run it again.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RunRecord {
    /// Name and version of the program.
    pub program: String,
    /// File name of the script.
    pub script: String,
    /// Its text.
    pub text: String,
    /// Seed of the world and of every random choice.
    pub seed: u64,
    /// Kind of world.
    pub world: String,
    /// Control period, s.
    pub period: f64,
    /// The object models, the robot first.
    pub models: Vec<Versioned>,
    /// The skills.
    pub skills: Vec<Versioned>,
}

/// One thing that a run depends on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Versioned {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: String,
    /// SHA-256 of its files, in hexadecimal.
    pub sha256: String,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Outcome {
    /// Did it do what the script says?
    pub success: bool,
    /// One sentence for a person.
    pub message: String,
    /// The whole report of the run.
    #[serde(default)]
    pub report: serde_json::Value,
}
