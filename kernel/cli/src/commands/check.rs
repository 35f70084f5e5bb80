use std::path::Path;

use sagci_script::LibraryModels;

use crate::arguments::Places;
use crate::commands::print;
use crate::error::CliError;
use crate::place;

/// `sagci check`.
pub fn check(script: &Path, places: &Places) -> Result<bool, CliError> {
    let models = LibraryModels::new(place::library(places, Some(script))?);
    let skills = place::skills(places, Some(script), place::silent())?;
    let problems = sagci_script::language::check::check(script, &skills, &models);
    if !problems.is_empty() {
        return Err(CliError::Script(problems));
    }
    print(&format!("{}: nothing wrong is found\n", script.display()));
    Ok(true)
}
