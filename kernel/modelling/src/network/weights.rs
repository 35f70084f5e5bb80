//! Weights on disk: safetensors, with the settings and the log of the training that made them in the file's own header.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::Matrix;
use crate::ModellingError;

/// Key of the note in the file's header.
const KEY: &str = "made_by";
/// Greatest size of a file, bytes.
const BYTES: u64 = 10 << 20;

/// The networks' learned matrices, and what made them.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// By name.
    pub matrices: BTreeMap<String, Matrix>,
    /// Settings and figures of the training, as JSON.
    pub made_by: String,
}

fn fault(message: impl Into<String>) -> ModellingError {
    ModellingError::Weights { message: message.into() }
}

/// The weights that ship, part of the program.
const SHIPPED: &[u8] = include_bytes!("../../../../world-models/perception/weights.safetensors");

impl Weights {
    /// The weights that ship.
    ///
    /// Errors: none, if the program was built from whole files.
    pub fn shipped() -> Result<Self, ModellingError> {
        Self::from_bytes(SHIPPED)
    }

    /// Reads a file.
    ///
    /// Errors: a file that is missing, larger than 10 MiB, or no whole safetensors of matrices in single precision.
    pub fn read(path: &Path) -> Result<Self, ModellingError> {
        let file = |e: std::io::Error| fault(format!("{}: {e}", path.display()));
        if std::fs::metadata(path).map_err(file)?.len() > BYTES {
            return Err(fault(format!("{}: has more than {BYTES} bytes", path.display())));
        }
        Self::from_bytes(&std::fs::read(path).map_err(file)?)
    }

    /// Reads the bytes of a file.
    ///
    /// Errors: as [`Self::read`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModellingError> {
        let whole = |e: safetensors::SafeTensorError| fault(format!("no whole safetensors file ({e})"));
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(whole)?;
        let made_by = header.metadata().as_ref().and_then(|m| m.get(KEY)).cloned().unwrap_or_default();
        let file = SafeTensors::deserialize(bytes).map_err(whole)?;
        let mut matrices = BTreeMap::new();
        for (name, view) in file.iter() {
            let [rows, columns] = view.shape() else { return Err(fault(format!("'{name}' is no matrix"))) };
            if view.dtype() != Dtype::F32 {
                return Err(fault(format!("'{name}' is not of single precision")));
            }
            let values = view.data().chunks_exact(4).map(|b| b.try_into().map_or(f32::NAN, f32::from_le_bytes));
            let matrix = Matrix::from_row_iterator(*rows, *columns, values);
            if !matrix.iter().all(|x| x.is_finite()) {
                return Err(fault(format!("'{name}' holds what is not a number")));
            }
            matrices.insert(name.to_owned(), matrix);
        }
        Ok(Self { matrices, made_by })
    }

    /// The bytes of a file; equal weights give equal bytes.
    ///
    /// Errors: none that weights made here could have.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModellingError> {
        let rows: Vec<(String, Vec<usize>, Vec<u8>)> = self
            .matrices
            .iter()
            .map(|(name, m)| {
                let bytes = m.transpose().iter().flat_map(|x| x.to_le_bytes()).collect();
                (name.clone(), vec![m.nrows(), m.ncols()], bytes)
            })
            .collect();
        let mut views = Vec::new();
        for (name, shape, bytes) in &rows {
            views.push((name.clone(), TensorView::new(Dtype::F32, shape.clone(), bytes).map_err(|e| fault(e.to_string()))?));
        }
        let note = HashMap::from([(KEY.to_owned(), self.made_by.clone())]);
        safetensors::serialize(views, Some(note)).map_err(|e| fault(e.to_string()))
    }
}
