/// Why a control law could not be built or stepped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// The object model is not a robot that can be controlled.
    #[error("{model}: {message}")]
    NotARobot {
        /// Name of the model.
        model: String,
        /// What is missing, and what to do about it.
        message: String,
    },
    /// The robot's dynamics cannot be built, or a measured state is not a state.
    #[error(transparent)]
    Dynamics(#[from] sagci_dynamics::DynamicsError),
    /// A gain, a reference or a period is wrong.
    #[error("{what}: {message}")]
    Input {
        /// Which one.
        what: &'static str,
        /// What is wrong, and what to do about it.
        message: String,
    },
}

/// Checks the length of a vector and that all its entries are finite.
pub(crate) fn check(what: &'static str, values: &[f64], needed: usize) -> Result<(), ControlError> {
    if values.len() != needed {
        return Err(ControlError::Input { what, message: format!("has {} entries instead of {needed}", values.len()) });
    }
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(i) => Err(ControlError::Input { what, message: format!("entry {i} is {}; it must be a finite number", values[i]) }),
    }
}

/// Checks that all entries are finite and none is negative.
pub(crate) fn check_not_negative(what: &'static str, values: &[f64], needed: usize) -> Result<(), ControlError> {
    check(what, values, needed)?;
    match values.iter().position(|x| *x < 0.0) {
        None => Ok(()),
        Some(i) => Err(ControlError::Input { what, message: format!("entry {i} is {}; it must not be negative", values[i]) }),
    }
}
