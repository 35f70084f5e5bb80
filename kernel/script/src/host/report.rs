//! What is said of a run when it is over.

use std::collections::BTreeMap;
use std::path::PathBuf;

use sagci_skill::Measure;
use serde::{Deserialize, Serialize};

/// One run of a script.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// Did the script run to its end, and are its goals met as far as they can be judged?
    pub success: bool,
    /// Seed of the world and of every random choice.
    pub seed: u64,
    /// The script.
    pub script: PathBuf,
    /// The kind of world; `none` if nothing moved.
    pub world: String,
    /// The skills that were called, in order.
    pub steps: Vec<StepReport>,
    /// What models were found to lack, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gaps: Vec<GapReport>,
    /// What the judge says, where the world knows the truth and the script has goals.
    pub goals: Vec<GoalReport>,
    /// Why it did not succeed.
    pub failure: Option<FailureReport>,
    /// The recording.
    pub recording: Option<PathBuf>,
    /// World time, s.
    pub seconds: f64,
    /// Wall time, s.
    pub wall_seconds: f64,
    /// What it was run with.
    pub versions: Versions,
}

/// One call of a skill.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepReport {
    /// The skill.
    pub skill: String,
    /// The call as a person would write it.
    pub call: String,
    /// Its arguments as a person would write them, by parameter.
    pub args: BTreeMap<String, String>,
    /// How it ended.
    pub status: StepStatus,
    /// Code of the failure.
    pub code: Option<String>,
    /// Stage at which it failed.
    pub stage: Option<String>,
    /// What happened, in words.
    pub message: Option<String>,
    /// World time, the host's looking afterwards included, s.
    pub seconds: f64,
    /// Wall time of planning, s.
    pub plan_wall_seconds: f64,
    /// Wall time of the whole, s.
    pub wall_seconds: f64,
    /// What the plan said would be.
    pub predicted: BTreeMap<String, Figure>,
    /// What was measured: by the host's own sensors where it looked, else as the skill says.
    pub measured: BTreeMap<String, Figure>,
    /// Measured less predicted, where both are known.
    pub gap: BTreeMap<String, Figure>,
    /// What the host found when it checked the skill's word.
    pub checks: Vec<CheckReport>,
}

/// How a skill call ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepStatus {
    /// Done, and found true.
    Done,
    /// Planned only.
    Planned,
    /// It failed.
    Failed,
}

/// A figure with its unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// SI.
    pub value: f64,
    /// `rad`, `m`, `N`, `s`.
    pub unit: String,
}

/// One postcondition, checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckReport {
    /// What had to be true.
    pub text: String,
    /// Was it? `None` if the sensors could not tell.
    pub holds: Option<bool>,
    /// What was seen.
    pub seen: String,
}

/// What a model was found to lack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GapReport {
    /// Name of the object in the scene.
    pub object: String,
    /// The joint that was moved.
    pub joint: String,
    /// `no_gap`, `named`, `ambiguous` or `unknown`.
    pub verdict: String,
    /// The missing effects.
    pub effects: Vec<EffectReport>,
    /// RMSE of predicted positions, on runs that were not fitted where there are any: of the model as it was.
    pub before: f64,
    /// With its known numbers refitted.
    pub refitted: f64,
    /// With the effects.
    pub after: f64,
    /// What noise alone gives.
    pub noise_floor: f64,
    /// `rad` or `m`.
    pub unit: String,
    /// The version that was published.
    pub version: Option<String>,
    /// What was doubted or left out.
    pub notes: Vec<String>,
    /// Wall time, s.
    pub wall_seconds: f64,
}

/// An effect that a model lacked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectReport {
    /// Its name in the catalogue.
    pub name: String,
    /// Names that the data cannot tell from it.
    pub alternatives: Vec<String>,
    /// Its joint.
    pub joint: String,
    /// Its numbers, SI.
    pub parameters: BTreeMap<String, f64>,
    /// Data that were not fitted agree.
    pub confirmed: bool,
}

/// What the judge says of one goal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GoalReport {
    /// The goal.
    pub text: String,
    /// Is it met?
    pub met: bool,
    /// The figure that decides.
    pub value: f64,
    /// Its unit.
    pub unit: String,
}

/// Why a run did not succeed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FailureReport {
    /// Code of the failure; `interrupted`, `thrown` or `goals` where no skill failed.
    pub code: String,
    /// At which stage.
    pub stage: String,
    /// What happened and what could be done.
    pub message: String,
}

/// What a run depends on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Versions {
    /// This program.
    pub program: String,
    /// The object models that were used.
    pub models: Vec<Version>,
    /// The skills that were used.
    pub skills: Vec<Version>,
}

/// One thing that a run depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Version {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Hash of its bytes.
    pub sha256: String,
}

/// Figures by name.
pub fn figures(measures: &[Measure]) -> BTreeMap<String, Figure> {
    measures.iter().map(|m| (m.name.clone(), Figure { value: m.value, unit: m.unit.clone() })).collect()
}

/// Measured less predicted.
pub fn gap(predicted: &BTreeMap<String, Figure>, measured: &BTreeMap<String, Figure>) -> BTreeMap<String, Figure> {
    predicted
        .iter()
        .filter_map(|(name, p)| {
            let m = measured.get(name).filter(|m| m.unit == p.unit)?;
            Some((name.clone(), Figure { value: m.value - p.value, unit: p.unit.clone() }))
        })
        .collect()
}

/// How often runs succeed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// Runs that succeeded.
    pub successes: usize,
    /// All runs.
    pub runs: usize,
    /// Their share.
    pub rate: f64,
    /// 95 % interval of the rate.
    pub interval: [f64; 2],
}

impl Rate {
    /// The share of successes, with Wilson's score interval (Wilson 1927, JASA 22(158)) at 95 %.
    pub fn of(successes: usize, runs: usize) -> Self {
        if runs == 0 {
            return Self { successes, runs, rate: 0.0, interval: [0.0, 1.0] };
        }
        let z = 1.959_963_984_540_054;
        let (n, p) = (runs as f64, successes as f64 / runs as f64);
        let center = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        Self { successes, runs, rate: p, interval: [(center - half).max(0.0), (center + half).min(1.0)] }
    }
}
