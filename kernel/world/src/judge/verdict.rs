use serde::{Deserialize, Serialize};

/// What the judge says of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Are all goals met?
    pub met: bool,
    /// Each goal, in the file's order.
    pub goals: Vec<GoalVerdict>,
}

/// What the judge says of one goal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GoalVerdict {
    /// The goal, in words.
    pub text: String,
    /// Is it met?
    pub met: bool,
    /// The figure that decides, in `unit`.
    pub value: f64,
    /// `deg`, `cm`, `cm/s`, `contacts`, or `names`.
    pub unit: String,
}
