//! Models and scenes of the tests.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;

use sagci_model::ObjectModel;

/// A test model by its folder's name.
pub(crate) fn model(name: &str) -> ObjectModel {
    ObjectModel::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models").join(name)).unwrap()
}
