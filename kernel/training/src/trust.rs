//! Teaches the last head how far parts are to be trusted, on parts as all networks before make them of fresh furniture. Those stay as they are.

use rayon::prelude::*;
use sagci_modelling::network::Weights;
use sagci_modelling::{Ends, TRUST};

use crate::head::{Head, Lessons, Rows, entropy, more_than, overlaps, train_head};
use crate::lesson::drawn;
use crate::{Settings, TrainingError};

/// Parts and bodies a step, for each object of a batch.
const PARTS: usize = 4;
/// The overlap that is asked about.
const ENOUGH: f64 = 0.75;

/// What an object teaches.
fn ends(seed: u64, index: u64, weights: &Weights) -> Rows<TRUST, [f32; 1]> {
    let mut out = Rows::default();
    let (object, cloud, _) = drawn(seed, index, false);
    let Ok(asked) = Ends::of(&cloud.points, weights) else { return out };
    let (parts, found) = (object.parts.len(), asked.trust.nrows());
    let overlaps = overlaps(&cloud.part, parts, &asked.label_of_input, found);
    for (row, overlaps) in asked.trust.row_iter().zip(&overlaps) {
        out.features.extend(row.iter());
        out.answers.push([more_than(ENOUGH, overlaps.iter().copied().fold(0.0, f64::max))]);
    }
    out
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of all is only looked at.
///
/// Errors: nothing to learn from; weights that do not fit.
pub fn train_trust(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught = (0..settings.objects).into_par_iter().map(|i| ends(settings.seed, i, from)).collect();
    train_head(&Lessons::plain(Head::Trust, entropy, PARTS), settings, taught, from, log)
}
