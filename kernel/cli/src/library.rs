//! The library of object models, as scripts see it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sagci_model::ObjectModel;
use sagci_script::Models;

use crate::error::CliError;

/// The library on disk.
pub struct LibraryModels {
    folder: PathBuf,
}

impl LibraryModels {
    /// Opens a library.
    pub fn open(folder: &Path) -> Result<Self, CliError> {
        if !folder.is_dir() {
            return Err(CliError::Other(format!(
                "{}: there is no library of object models; give its folder with --models DIR",
                folder.display()
            )));
        }
        Ok(Self { folder: folder.to_owned() })
    }

    fn head(&self, name: &str) -> Result<String, String> {
        let file = self.folder.join(name).join("HEAD");
        std::fs::read_to_string(&file).map(|t| t.trim().to_owned()).map_err(|e| format!("{}: {e}", file.display()))
    }
}

impl Models for LibraryModels {
    fn names(&self) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(&self.folder) else { return Vec::new() };
        let mut names: Vec<String> = entries
            .filter_map(Result::ok)
            .filter(|e| e.path().join("HEAD").is_file())
            .filter_map(|e| e.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    fn model(&self, name: &str) -> Result<Arc<ObjectModel>, String> {
        let folder = self.folder.join(name).join(self.head(name)?);
        ObjectModel::read(folder).map(Arc::new).map_err(|e| e.to_string())
    }

    fn version(&self, name: &str) -> Result<(String, String), String> {
        let head = self.head(name)?;
        Ok((head.clone(), head))
    }
}
