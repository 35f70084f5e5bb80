use std::sync::Arc;

use sagci_model::ObjectModel;

/// Where object models come from.
pub trait Models: Sync {
    /// The names of all models, sorted.
    fn names(&self) -> Vec<String>;

    /// The current version of a model. `Err` says what is wrong with it, with file and place.
    fn model(&self, name: &str) -> Result<Arc<ObjectModel>, String>;

    /// Name of the current version of a model, and the hash of its bytes.
    fn version(&self, name: &str) -> Result<(String, String), String>;
}
