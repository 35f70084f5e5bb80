use std::path::Path;

use sagci_world::recording::replay_states;

use crate::error::CliError;

/// `sagci replay --states`.
pub fn replay(recording: &Path) -> Result<bool, CliError> {
    let replayed = replay_states(recording, &mut std::io::stdout().lock()).map_err(|e| CliError::Other(e.to_string()))?;
    match replayed.intact {
        Some(false) => Err(CliError::Other(format!("{}: its contents are not what was recorded", recording.display()))),
        _ => Ok(true),
    }
}
