use std::path::Path;

use crate::error::CliError;

/// `sagci replay`.
pub fn replay(recording: &Path) -> Result<bool, CliError> {
    Err(CliError::Other(format!("{}: cannot be replayed", recording.display())))
}
