//! A batch of lessons, several at a time.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sagci_modelling::ModellingError;
use sagci_modelling::network::Matrix;

/// Gradients of the weights, by their names.
pub(crate) type Gradients = BTreeMap<String, Matrix>;

/// What `learn` says of each lesson of a batch, and the sum of their gradients: in the order of the batch, so that the number of threads does
/// not change a bit.
pub(crate) fn learned<S: Send>(
    batch: &[usize],
    learn: impl Fn(usize, &mut Gradients) -> Result<S, ModellingError> + Sync,
) -> Result<(Vec<S>, Gradients), ModellingError> {
    let each = |i: &usize| {
        let mut own = Gradients::new();
        learn(*i, &mut own).map(|s| (s, own))
    };
    let all: Vec<Result<(S, Gradients), ModellingError>> = batch.par_iter().map(each).collect();
    let (mut scores, mut by_name) = (Vec::with_capacity(batch.len()), BTreeMap::<String, Vec<Matrix>>::new());
    for one in all {
        let (score, own) = one?;
        scores.push(score);
        for (name, d) in own {
            by_name.entry(name).or_default().push(d);
        }
    }
    let sum = by_name.into_par_iter().filter_map(|(name, each)| Some((name, each.into_iter().reduce(|sum, d| sum + d)?))).collect();
    Ok((scores, sum))
}
