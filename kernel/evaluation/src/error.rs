//! What can go wrong.

/// Why a run could not be made or judged.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    /// An effect cannot be simulated.
    #[error("the effect {effect} {message}")]
    Effect {
        /// Its name.
        effect: String,
        /// What is wrong.
        message: String,
    },
    /// A model cannot be simulated.
    #[error("the model cannot be simulated: {message}")]
    Model {
        /// What is wrong.
        message: String,
    },
    /// The motion ran away.
    #[error("the motion is no longer a number at {time:.4} s; the scenario asks for too much")]
    Diverged {
        /// Time, s.
        time: f64,
    },
    /// No scenario of a kind could be drawn that stays within the joints' limits.
    #[error("no scenario could be drawn for {id}: {message}")]
    NoScenario {
        /// The run.
        id: String,
        /// The last try's failure.
        message: String,
    },
    /// A file cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file of results is broken.
    #[error("{path}: {message}")]
    Malformed {
        /// Which.
        path: std::path::PathBuf,
        /// What is wrong and what to do.
        message: String,
    },
}
