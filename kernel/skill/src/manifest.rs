//! `skill.yaml`: the manifest as a file, and what makes it valid.

use std::path::Path;

use crate::Manifest;

/// Why a manifest cannot be used. The caller knows the file and puts it in front.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The file could not be read.
    #[error("{0}")]
    File(#[from] std::io::Error),
    /// The text is not a manifest.
    #[error("{}{message}", line.map(|l| format!("line {l}: ")).unwrap_or_default())]
    Malformed {
        /// Line, counted from 1, where it is known.
        line: Option<usize>,
        /// What is wrong.
        message: String,
    },
    /// It can be read, but what it says cannot be.
    #[error("{field}: {message}")]
    Impossible {
        /// The field that is wrong.
        field: String,
        /// What is wrong, and what to do about it.
        message: String,
    },
}

impl Manifest {
    /// Reads a manifest from its text: a skill's own is `Manifest::from_yaml(include_str!("../skill.yaml"))`.
    pub fn from_yaml(text: &str) -> Result<Self, ManifestError> {
        let manifest: Self = serde_yaml::from_str(text)
            .map_err(|e| ManifestError::Malformed { line: e.location().map(|l| l.line()), message: e.to_string() })?;
        manifest.validate()?;
        Ok(manifest)
    }

    /// Reads a manifest from its file.
    pub fn read(path: &Path) -> Result<Self, ManifestError> {
        Self::from_yaml(&std::fs::read_to_string(path)?)
    }

    fn validate(&self) -> Result<(), ManifestError> {
        let impossible =
            |field: &str, message: &str| Err(ManifestError::Impossible { field: field.to_owned(), message: message.to_owned() });
        if !is_identifier(&self.name) {
            return impossible("name", "must be a word of a-z, 0-9 and _ that begins with a letter: it becomes a script function");
        }
        if !is_identifier(&self.entry) {
            return impossible("entry", "must be the name of the function that export_skill! defines");
        }
        if self.library.is_empty() || self.library.contains(['/', '\\']) {
            return impossible("library", "must be the library's name without folder, prefix and ending, such as sagci_skill_wave");
        }
        for (i, parameter) in self.parameters.iter().enumerate() {
            let field = format!("parameters[{i}]");
            if !is_identifier(&parameter.name) {
                return impossible(&field, "needs a name of a-z, 0-9 and _ that begins with a letter");
            }
            if self.parameters[..i].iter().any(|p| p.name == parameter.name) {
                return impossible(&field, "has the name of an earlier one");
            }
            if parameter.required && self.parameters[..i].iter().any(|p| !p.required) {
                return impossible(&field, "is required but stands behind one that is not; scripts pass them in this order");
            }
        }
        Ok(())
    }
}

fn is_identifier(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_lowercase()) && word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}
