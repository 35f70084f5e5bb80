//! Where the project, its models and its skills are.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sagci_library::Library;
use sagci_script::language::engine::reserved_names;
use sagci_script::plugins::{SearchPath, SkillSet};
use sagci_skill::LogSink;

use crate::arguments::Places;
use crate::error::CliError;

/// The folder that holds `world-models/`, upward from the script or from here.
pub fn project(script: Option<&Path>) -> Option<PathBuf> {
    let here = std::env::current_dir().ok();
    let beside = script.and_then(|s| s.canonicalize().ok()).and_then(|s| s.parent().map(Path::to_owned));
    beside.into_iter().chain(here).find_map(|start| project_above(&start))
}

/// The nearest folder that holds `world-models/`, from one upward.
fn project_above(start: &Path) -> Option<PathBuf> {
    start.ancestors().find(|a| a.join("world-models").is_dir()).map(Path::to_owned)
}

/// The project that the program was built in: its skills are there wherever a script is.
fn project_of_program() -> Option<PathBuf> {
    project_above(&std::env::current_exe().ok()?.canonicalize().ok()?)
}

/// The library of object models.
pub fn library(places: &Places, script: Option<&Path>) -> Result<Library, CliError> {
    let folder = match (&places.models, project(script)) {
        (Some(folder), _) => folder.clone(),
        (None, Some(project)) => project.join("world-models"),
        (None, None) => {
            let message = "the library of object models was not found: there is no folder world-models/ here or above; \
                           go to the project's folder or give --models DIR";
            return Err(CliError::Other(message.to_owned()));
        }
    };
    if !folder.is_dir() {
        return Err(CliError::Other(format!("{}: is no folder; --models takes the folder of the library", folder.display())));
    }
    Library::open(folder).map_err(|e| CliError::Other(e.to_string()))
}

/// All skills that can be found.
pub fn skills(places: &Places, script: Option<&Path>, log: LogSink) -> Result<SkillSet, CliError> {
    if let Some(missing) = places.skills.iter().find(|f| !f.is_dir()) {
        return Err(CliError::Other(format!("{}: is no folder; --skills takes a folder with skills", missing.display())));
    }
    let reserved = reserved_names();
    let reserved: Vec<&str> = reserved.iter().map(String::as_str).collect();
    let project = project(script).or_else(project_of_program);
    Ok(SkillSet::discover(&SearchPath::usual(&places.skills, project.as_deref()), &reserved, &log))
}

/// A log that nobody reads.
pub fn silent() -> LogSink {
    Arc::new(|_, _| {})
}
