use crate::arguments::Simulate;
use crate::commands::gap::{logs, model};
use crate::error::CliError;

/// `sagci simulate`.
pub fn simulate(arguments: &Simulate) -> Result<bool, CliError> {
    let model = model(&arguments.model, &arguments.places)?.model;
    let logs = logs(&arguments.data, &model, arguments.angles).map_err(|e| CliError::Other(e.to_string()))?;
    let table = sagci_gap::predict(&model, &logs, arguments.window).map_err(|e| CliError::Other(e.to_string()))?;
    std::fs::write(&arguments.out, table).map_err(|source| CliError::File { path: arguments.out.clone(), source })?;
    Ok(true)
}
