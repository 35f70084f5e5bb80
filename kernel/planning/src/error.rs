//! Why planning failed, in words that a skill can hand on.

/// Why there is no plan. Every case names the stage (`grasp`, `approach`, `path`, `retreat`, `pick`, `place`, `reach`,
/// `timing`, `object motion`) and what stood in the way.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A model lacks something that planning needs: a robot section, a grasp hint, a joint, a region.
    #[error("{model}: {message}")]
    ModelLacks {
        /// Name of the model.
        model: String,
        /// What is missing, and what to do about it.
        message: String,
    },
    /// The arm cannot get there within its joint limits.
    #[error("{stage}: out of reach: {message}")]
    Unreachable {
        /// Where in the plan.
        stage: String,
        /// What cannot be reached.
        message: String,
    },
    /// It can, but something is in the way.
    #[error("{stage}: {first} would touch {second}: {message}")]
    Collision {
        /// Where in the plan.
        stage: String,
        /// A link of the robot, or what it holds.
        first: String,
        /// What it would touch.
        second: String,
        /// How much of the stage is blocked.
        message: String,
    },
    /// The arm would need more torque than its drives have.
    #[error("{stage}: too weak: {message}")]
    TooWeak {
        /// Where in the plan.
        stage: String,
        /// Which joint, how much is needed and how much there is.
        message: String,
    },
    /// A search or a conic program ended without an answer.
    #[error("{stage}: no convergence: {message}")]
    NoConvergence {
        /// Where in the plan.
        stage: String,
        /// What the solver said.
        message: String,
    },
    /// The caller asked to stop.
    #[error("{stage}: cancelled")]
    Cancelled {
        /// Where in the plan.
        stage: String,
    },
    /// The input cannot be: wrong number of joints, a value that is not finite.
    #[error("bad input: {message}")]
    BadInput {
        /// What is wrong.
        message: String,
    },
}

impl PlanError {
    /// The stage at which it failed, if the error has one.
    pub fn stage(&self) -> &str {
        match self {
            Self::ModelLacks { .. } => "model",
            Self::BadInput { .. } => "input",
            Self::Unreachable { stage, .. }
            | Self::Collision { stage, .. }
            | Self::TooWeak { stage, .. }
            | Self::NoConvergence { stage, .. }
            | Self::Cancelled { stage } => stage,
        }
    }
}
