use std::path::PathBuf;

use crate::arguments::Simulate;
use crate::commands::gap::{Units, logs, model};
use crate::commands::output;
use crate::error::CliError;

/// `sagci simulate`.
pub fn simulate(arguments: &Simulate) -> Result<bool, CliError> {
    let given = model(&arguments.model, &arguments.places)?;
    let out = &arguments.out;
    let read = [output::recordings(&arguments.data), given.files()].concat();
    output::spare(std::slice::from_ref(out), read.iter().map(PathBuf::as_path))?;
    given.keeps_out(out)?;
    let units = Units { angles: arguments.angles, lengths: arguments.lengths };
    let logs = logs(&arguments.data, &given.model, units).map_err(|e| CliError::Other(e.to_string()))?;
    output::file(out)?;
    let predicted = sagci_gap::predict(&given.model, &logs, arguments.window).map_err(|e| CliError::Other(e.to_string()))?;
    for note in given.notes.iter().chain(&predicted.notes) {
        eprintln!("note: {note}");
    }
    std::fs::write(out, predicted.table).map_err(|source| CliError::File { path: out.clone(), source })?;
    Ok(true)
}
