use std::io::Write;
use std::path::Path;

use sagci_world::recording::replay_states;

use crate::error::CliError;

/// `sagci replay --states`.
pub fn replay(recording: &Path) -> Result<bool, CliError> {
    let replayed = replay_states(recording, &mut std::io::stdout().lock()).map_err(|e| CliError::Other(e.to_string()))?;
    // What is left in its buffer would be lost without a word.
    if let Err(e) = std::io::stdout().flush()
        && e.kind() != std::io::ErrorKind::BrokenPipe
    {
        return Err(CliError::Other(format!("the states could not be written to stdout: {e}")));
    }
    match replayed.intact {
        Some(false) => Err(CliError::Other(format!("{}: its contents are not what was recorded", recording.display()))),
        _ => Ok(true),
    }
}
