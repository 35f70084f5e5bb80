use sagci_dynamics::DynamicsError;

/// Why the gap between a model and measurements cannot be looked into.
#[derive(Debug, thiserror::Error)]
pub enum GapError {
    /// The data and the model do not fit, or the data do not hold enough.
    #[error("{place}: {message}")]
    Data {
        /// File or joint.
        place: String,
        /// What is wrong, and what to do.
        message: String,
    },
    /// The model cannot be simulated.
    #[error("the model cannot be simulated: {0}")]
    Model(#[from] DynamicsError),
}

impl GapError {
    pub(crate) fn data(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self::Data { place: place.into(), message: message.into() }
    }
}
