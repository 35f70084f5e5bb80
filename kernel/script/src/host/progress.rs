use super::report::{RunReport, StepReport};

/// Something that happens in a run, for whoever watches it.
#[derive(Debug)]
pub enum Event<'a> {
    /// The host looks around; names the objects it looks for.
    Looking {
        /// Objects.
        objects: &'a [String],
    },
    /// An object was found, or not.
    Located {
        /// Object.
        object: &'a str,
        /// Why it was not found.
        error: Option<&'a str>,
    },
    /// A skill begins to plan.
    Planning {
        /// Number of the call, counted from 0.
        step: usize,
        /// Skill with its arguments, as a person would write it.
        call: &'a str,
    },
    /// How far a skill is. Comes at each change of phase and twenty times a second of world time.
    Phase {
        /// Number of the call.
        step: usize,
        /// Skill with its arguments.
        call: &'a str,
        /// The phase.
        phase: &'a str,
        /// How much of the whole is done, 0..1.
        progress: f64,
        /// World time, s.
        time: f64,
    },
    /// A skill has ended.
    Ended {
        /// Number of the call.
        step: usize,
        /// How.
        report: &'a StepReport,
    },
    /// The gap workflow says what it does.
    Searching {
        /// What.
        text: &'a str,
    },
    /// The script prints.
    Say {
        /// What.
        text: &'a str,
    },
    /// A run is over.
    Finished {
        /// Its report.
        report: &'a RunReport,
    },
}

/// Someone who watches runs; more than one may be under way.
pub trait Progress: Send + Sync {
    /// Something happened in the run with this seed.
    fn event(&self, seed: u64, event: &Event<'_>);
}

/// Nobody watches.
pub struct Silent;

impl Progress for Silent {
    fn event(&self, _: u64, _: &Event<'_>) {}
}
