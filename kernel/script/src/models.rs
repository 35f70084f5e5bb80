use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use sagci_library::{Evidence, Library};
use sagci_model::ObjectModel;

/// Where object models come from.
pub trait Models: Send + Sync {
    /// The names of all models, sorted.
    fn names(&self) -> Vec<String>;

    /// The current version of a model. `Err` says what is wrong with it, with file and place.
    fn model(&self, name: &str) -> Result<Arc<ObjectModel>, String>;

    /// Name of the current version of a model, and the hash of its bytes.
    fn version(&self, name: &str) -> Result<(String, String), String>;

    /// Publishes a new version of a model, with the files that say why it is believed: its name, and the model as it was stored. `model` and
    /// `version` answer what they did before: runs that are under way keep what they began with. `Err` says why it could not be published.
    fn publish(&self, name: &str, model: &ObjectModel, evidence: &[Evidence]) -> Result<(String, Arc<ObjectModel>), String> {
        let _ = (model, evidence);
        Err(format!("a new version of '{name}' cannot be published: these models are not in a library"))
    }
}

/// The library on disk; each model is read once, and stays what it was then.
pub struct LibraryModels {
    library: Library,
    read: Mutex<BTreeMap<String, Result<(String, Arc<ObjectModel>), String>>>,
}

impl LibraryModels {
    /// The models of a library.
    pub fn new(library: Library) -> Self {
        Self { library, read: Mutex::default() }
    }

    fn stored(&self, name: &str) -> Result<(String, Arc<ObjectModel>), String> {
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let stored = read.entry(name.to_owned()).or_insert_with(|| {
            let stored = self.library.get(name).map_err(|e| e.to_string())?;
            Ok((stored.version.to_string(), stored.model))
        });
        stored.clone()
    }
}

impl Models for LibraryModels {
    fn names(&self) -> Vec<String> {
        self.library.names().unwrap_or_default()
    }

    fn model(&self, name: &str) -> Result<Arc<ObjectModel>, String> {
        self.stored(name).map(|(_, model)| model)
    }

    fn version(&self, name: &str) -> Result<(String, String), String> {
        // A version is named by the hash of its bytes.
        self.stored(name).map(|(version, _)| (version.clone(), version))
    }

    fn publish(&self, name: &str, model: &ObjectModel, evidence: &[Evidence]) -> Result<(String, Arc<ObjectModel>), String> {
        // What is current must be remembered before it is another; what is new has nothing to remember.
        if self.names().iter().any(|n| n == name) {
            self.stored(name)?;
        }
        let version = self.library.publish_model(name, model, evidence).map_err(|e| e.to_string())?;
        let stored = self.library.get_version(name, version.as_str()).map_err(|e| e.to_string())?;
        Ok((version.to_string(), stored.model))
    }
}
