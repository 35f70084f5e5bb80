//! What the workflow answers, as it stands in gap.json. The format is documented in `FORMAT.md` beside this crate.

use std::collections::BTreeMap;

use sagci_dynamics::effects;
use serde::Serialize;

use crate::flexible::Region;
use crate::trajectory::Trajectory;

/// Version of the format.
pub const SCHEMA: u32 = 1;

/// The least certain of what is said of the effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing is missing that the data could show.
    NoGap,
    /// Every missing effect has one name.
    Named,
    /// The data cannot tell some names apart.
    Ambiguous,
    /// Something is missing that no name fits.
    Unknown,
}

/// A value with the interval that holds it in 95 of 100 cases.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Value {
    /// Best estimate, SI units.
    pub value: f64,
    /// Lower end.
    pub lower: f64,
    /// Upper end.
    pub upper: f64,
    /// Unit.
    pub unit: String,
}

/// One missing effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NamedEffect {
    /// Its name in the catalogue.
    pub name: String,
    /// Names that the data cannot tell from it.
    pub alternatives: Vec<String>,
    /// Its joint; none for the base, or for all joints.
    pub joint: Option<String>,
    /// What it acts on: joint, actuator, sensor, kinematic or body.
    pub channel: String,
    /// Its numbers.
    pub parameters: BTreeMap<String, Value>,
    /// What is chosen by a word.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub choices: BTreeMap<String, String>,
    /// Probability of the name among all that were tried, "none of these" included.
    pub probability: f64,
    /// Data that the fit has not seen agree.
    pub confirmed: bool,
    /// Why it is believed.
    pub evidence: EffectEvidence,
    /// Names that came next, and why each lost.
    pub runners_up: Vec<Reason>,
}

impl NamedEffect {
    /// Where it is: its joint, or what it acts on where it has none.
    pub fn place(&self) -> &str {
        self.joint.as_deref().unwrap_or_else(|| effects::find(&self.name).map_or("", |e| e.description().without_joint()))
    }
}

/// Why an effect is believed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EffectEvidence {
    /// Logarithm of the Bayes factor of the effect against the model without it.
    pub log_bayes_factor: f64,
    /// The same against a force without a name.
    pub log_bayes_factor_nameless: f64,
    /// Share of the prediction errors' squares, beyond noise, that it explains.
    pub explained: f64,
    /// Fall of the squared prediction errors on held-out data, in units of their noise; none where there are no such data.
    pub held_out: Option<f64>,
}

/// A name and why it was not chosen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reason {
    /// The name.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// Where model and data disagree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Where {
    /// The joint.
    pub joint: String,
    /// What kind of disagreement shows there.
    pub channel: String,
    /// Where most of it lies.
    pub region: Region,
    /// Share of all lacking force that lies on this joint.
    pub share: f64,
    /// Probability of as much by chance.
    pub p_value: f64,
}

/// The gap of one joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointGap {
    /// RMSE of the model as given, rad or m.
    pub before: f64,
    /// After its known numbers were refitted.
    pub refitted: f64,
    /// With the effects.
    pub after: f64,
    /// What the fitted model has on data of its own.
    pub noise_floor: f64,
    /// Medians over windows, in the same order.
    pub median: [f64; 4],
    /// RMSE in windows of 0.25 s, in the same order.
    pub short: [f64; 4],
    /// Range by which the pooled figures are divided, rad or m.
    pub range: f64,
    /// Unit of the figures.
    pub unit: String,
}

/// The gap over all joints, in shares of their ranges.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Gap {
    /// The model as given.
    pub before: f64,
    /// After its known numbers were refitted.
    pub refitted: f64,
    /// With the effects.
    pub after: f64,
    /// What the fitted model has on data of its own.
    pub noise_floor: f64,
    /// By joint.
    pub per_joint: BTreeMap<String, JointGap>,
}

/// The gap on the data that were fitted and on those that were not.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Gaps {
    /// On the data of the fit.
    pub train: Gap,
    /// On the others.
    pub held_out: Option<Gap>,
}

/// What is left without a name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unexplained {
    /// Share of the lacking force.
    pub share: f64,
    /// The joint.
    pub joint: String,
    /// What it depends on most.
    pub over: String,
    /// Where it acts.
    pub region: Region,
}

/// The motion of an experiment: what the joint is led along, or what is changed about it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reference {
    /// Its kind, the experiment's name.
    pub kind: String,
    /// Its numbers, SI units.
    #[serde(flatten)]
    pub numbers: BTreeMap<String, f64>,
}

/// The experiment that would tell names apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Experiment {
    /// Its name, such as `quasi_static_sweep`.
    pub name: String,
    /// The joint.
    pub joint: String,
    /// The names that it tells apart; one alone where it is to be confirmed.
    pub separates: Vec<String>,
    /// Logarithm of the Bayes factor that it is expected to give; none where it could not be simulated.
    pub expected_log_bayes_factor: Option<f64>,
    /// What to do, in numbers.
    pub reference: Reference,
    /// What to do and why, for a person.
    pub reason: String,
    /// How to go on once it is recorded.
    pub command: String,
}

impl Experiment {
    /// Names of the numbers that are positions of the joint, or lengths along its way.
    pub const POSITIONS: [&str; 12] = [
        "low",
        "high",
        "slow_low",
        "slow_high",
        "middle",
        "amplitude",
        "first_amplitude",
        "last_amplitude",
        "position",
        "open",
        "first",
        "second",
    ];

    /// Writes the command that goes on once it is recorded beside the data that there are, with the other options of the command that found
    /// it, for a shell.
    pub fn goes_on(mut self, model: &str, data: &[String], held_out: &[String], options: &[String]) -> Self {
        let words = |words: &[String]| words.iter().map(|word| format!(" {}", quoted(word))).collect::<String>();
        let held_out = if held_out.is_empty() { String::new() } else { format!(" --held-out{}", words(held_out)) };
        let (model, data, options) = (quoted(model), words(data), words(options));
        self.command = format!("sagci gap {model} --data{data} {}.csv{held_out}{options}", self.name);
        self
    }

    pub(crate) fn told_to(self, model: &str, train: &[Trajectory], held_out: &[Trajectory]) -> Self {
        let sources = |data: &[Trajectory]| data.iter().map(|t| t.source.clone()).collect::<Vec<_>>();
        self.goes_on(model, &sources(train), &sources(held_out), &[])
    }
}

/// A word as a shell takes it for one.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "_-+=:,./@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn a_path_with_spaces_and_quotes_stays_one_word() {
        assert_eq!(quoted("runs/a_1.csv"), "runs/a_1.csv");
        assert_eq!(quoted("my log.csv"), "'my log.csv'");
        assert_eq!(quoted("it's $HOME"), "'it'\\''s $HOME'");
        assert_eq!(quoted(""), "''");
    }
}

/// What became of the force that names leave over.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Remainder {
    /// A learned force is kept beside the model.
    pub kept: bool,
    /// The pooled gap of the model with its effects on held-out data, without the learned force and with it.
    pub gap: [f64; 2],
}

/// What the workflow answers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Version of the format.
    pub schema: u32,
    /// The answer in a word.
    pub verdict: Verdict,
    /// The missing effects.
    pub effects: Vec<NamedEffect>,
    /// Where model and data disagree.
    #[serde(rename = "where")]
    pub places: Vec<Where>,
    /// How far predictions are off.
    pub gap: Gaps,
    /// What is left without a name.
    pub unexplained: Option<Unexplained>,
    /// Names that were looked at and refused.
    pub rejected: Vec<Reason>,
    /// Whether a learned force for what is left was kept; none where it was not tried.
    pub residual: Option<Remainder>,
    /// What to do next where names are left.
    pub next_experiment: Option<Experiment>,
    /// The held-out gap by other ways, pooled.
    pub baselines: BTreeMap<String, f64>,
    /// The model with what was found, a path or a version.
    pub model: String,
    /// Things about the data that were set right or doubted.
    pub notes: Vec<String>,
    /// How long it took.
    pub seconds: f64,
}
