//! A residual on disk: safetensors, so that other tools read the weights.
//!
//! Tensors, all `F64`: `layers.0.weight` (outputs x inputs), `layers.0.bias`, `layers.1.weight`, and so on. The metadata has
//! one key, `residual`, with JSON: the schema, the joints, the architecture, the normalisation and the hash of the training.
//! One key, since the format keeps no order among several, and equal residuals must give equal bytes: a model's version is
//! named by them.
//!
//! Nothing of a file is believed: sizes are bounded before anything is allocated, every number must be finite, every name and
//! shape must be the one that the architecture demands, and nothing else may be there.

use std::collections::HashMap;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::network::weights_of;
use super::{Activation, Network, Normalisation, Residual};
use crate::DynamicsError;

const KEY: &str = "residual";
const SCHEMA: u32 = 1;
/// Larger files are refused unread.
const MAX_BYTES: usize = 256 << 20;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    schema: u32,
    reads: Vec<String>,
    acts: Vec<String>,
    /// Sizes of all layers, inputs and outputs included.
    layers: Vec<usize>,
    activation: String,
    input_mean: Vec<f64>,
    input_scale: Vec<f64>,
    output_scale: Vec<f64>,
    training: String,
}

impl Residual {
    /// The residual as the bytes of a safetensors file. Equal residuals give equal bytes.
    ///
    /// # Errors
    /// The format's writer refuses it.
    pub fn to_bytes(&self) -> Result<Vec<u8>, DynamicsError> {
        let network = &self.network;
        let header = Header {
            schema: SCHEMA,
            reads: self.reads.clone(),
            acts: self.acts.clone(),
            layers: network.sizes().to_vec(),
            activation: network.activation().name().into(),
            input_mean: network.normalisation.input_mean.clone(),
            input_scale: network.normalisation.input_scale.clone(),
            output_scale: network.normalisation.output_scale.clone(),
            training: self.training.clone(),
        };
        let text = serde_json::to_string(&header).map_err(|e| fault("metadata", format!("cannot be written: {e}")))?;
        let bytes: Vec<u8> = network.weights().iter().flat_map(|w| w.to_le_bytes()).collect();
        let mut tensors = Vec::new();
        let mut at = 0;
        for (name, shape) in layout(network.sizes()) {
            let size = 8 * shape.iter().product::<usize>();
            let view = TensorView::new(Dtype::F64, shape, &bytes[at..at + size]).map_err(|e| fault(&name, e.to_string()))?;
            tensors.push((name, view));
            at += size;
        }
        safetensors::serialize(tensors, Some(HashMap::from([(KEY.to_string(), text)]))).map_err(|e| fault("file", e.to_string()))
    }

    /// Reads the bytes of a safetensors file.
    ///
    /// # Errors
    /// A file that is too large, cut short or not a residual; a schema or activation that is not known; a tensor that is
    /// missing, too much, or of the wrong type or shape; a number that is not finite; a scale that is not positive.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, DynamicsError> {
        if bytes.len() > MAX_BYTES {
            return Err(fault("file", format!("has {} bytes; more than {MAX_BYTES} are refused", bytes.len())));
        }
        let whole = |e: safetensors::SafeTensorError| fault("file", format!("is no whole safetensors file ({e}); write it again"));
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(whole)?;
        let text = metadata.metadata().as_ref().and_then(|m| m.get(KEY));
        let text = text.ok_or_else(|| fault("metadata", format!("lacks the key '{KEY}': these are weights of something else")))?;
        let header: Header = serde_json::from_str(text).map_err(|e| fault("metadata", format!("cannot be read: {e}")))?;
        if header.schema != SCHEMA {
            return Err(fault("metadata", format!("is of schema {}; this program reads {SCHEMA}", header.schema)));
        }
        let activation = Activation::of_name(&header.activation)
            .ok_or_else(|| fault("activation", format!("'{}' is not known; there are: tanh, silu", header.activation)))?;
        let count = weights_of(&header.layers)?;
        let file = SafeTensors::deserialize(bytes).map_err(whole)?;
        let layout = layout(&header.layers);
        if let Some(name) = file.names().into_iter().find(|n| !layout.iter().any(|(l, _)| l == n)) {
            return Err(fault(name, "is a tensor that the architecture does not have".into()));
        }
        // The file holds as many numbers as the shapes say, so this is no more than its own size.
        let mut weights = Vec::with_capacity(count.min(bytes.len() / 8));
        for (name, shape) in layout {
            let tensor = file.tensor(&name).map_err(|_| fault(&name, "is missing".into()))?;
            if tensor.dtype() != Dtype::F64 || tensor.shape() != shape {
                let message = format!("is {:?} {:?} where {:?} {shape:?} is needed", tensor.dtype(), tensor.shape(), Dtype::F64);
                return Err(fault(&name, message));
            }
            for (k, number) in tensor.data().chunks_exact(8).enumerate() {
                let mut raw = [0; 8];
                raw.copy_from_slice(number);
                let value = f64::from_le_bytes(raw);
                if !value.is_finite() {
                    return Err(fault(&name, format!("has {value} at entry {k}; every weight must be a finite number")));
                }
                weights.push(value);
            }
        }
        let mut network = Network::new(&header.layers, activation, 0)?;
        network.set_weights(&weights)?;
        network.set_normalisation(Normalisation {
            input_mean: header.input_mean,
            input_scale: header.input_scale,
            output_scale: header.output_scale,
        })?;
        Ok(Self { network, reads: header.reads, acts: header.acts, training: header.training })
    }
}

/// Names and shapes of the tensors, in the order of the flat weights.
fn layout(sizes: &[usize]) -> Vec<(String, Vec<usize>)> {
    let layers = sizes.windows(2).enumerate();
    layers.flat_map(|(l, p)| [(format!("layers.{l}.weight"), vec![p[1], p[0]]), (format!("layers.{l}.bias"), vec![p[1]])]).collect()
}

fn fault(place: &str, message: String) -> DynamicsError {
    DynamicsError::Build { part: "residual".into(), place: place.into(), message }
}
