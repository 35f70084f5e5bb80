//! Teaches which groups of pieces are parts: the head that is asked about groups as a whole, on those that the networks before it make of fresh
//! furniture. Those stay as they are.

use rayon::prelude::*;
use sagci_modelling::network::Weights;
use sagci_modelling::{Groups, MASK};

use crate::head::{Head, Rows, more_than, train_head};
use crate::lesson::drawn;
use crate::{Settings, TrainingError};

/// Groups a step, for each object of a batch.
const GROUPS: usize = 8;
/// Overlaps that are asked about.
const OVERLAPS: [f64; 2] = [0.5, 0.75];

/// What an object teaches.
fn groups(seed: u64, index: u64, weights: &Weights) -> Rows<MASK, 2> {
    let mut out = Rows::default();
    let (_, cloud, _) = drawn(seed, index, false);
    let Ok(asked) = Groups::of(&cloud.points, weights) else { return out };
    let parts = cloud.part.iter().copied().max().unwrap_or(0).max(0) as usize + 1;
    let pieces = asked.piece_of_input.iter().flatten().map(|p| *p as usize + 1).max().unwrap_or(0);
    let mut both = vec![vec![0.0; parts]; pieces];
    let mut of_part = vec![0.0; parts];
    for (part, piece) in cloud.part.iter().zip(&asked.piece_of_input) {
        let Ok(part) = usize::try_from(*part) else { continue };
        of_part[part] += 1.0;
        if let Some(piece) = piece {
            both[*piece as usize][part] += 1.0;
        }
    }
    // What stands around counts as what a group has too much.
    let mut of_piece = vec![0.0; pieces];
    asked.piece_of_input.iter().flatten().for_each(|p| of_piece[*p as usize] += 1.0);
    for (k, group) in asked.of.iter().enumerate() {
        let own: f64 = group.iter().map(|p| of_piece[*p]).sum();
        let overlap = |t: usize| {
            let common: f64 = group.iter().map(|p| both[*p][t]).sum();
            common / (own + of_part[t] - common).max(1.0)
        };
        out.features.extend(asked.rows.row(k).iter());
        let most = (1..parts).map(overlap).fold(0.0, f64::max);
        out.answers.push(OVERLAPS.map(|asked| more_than(asked, most)));
    }
    out
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of the groups is only looked at.
///
/// Errors: no group to learn from; weights that do not fit.
pub fn train_masks(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught = (0..settings.objects).into_par_iter().map(|i| groups(settings.seed, i, from)).collect();
    train_head(Head::Masks, settings, GROUPS, taught, from, log)
}
