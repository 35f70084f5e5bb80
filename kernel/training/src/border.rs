//! Teaches where parts end: the head that is asked about single points, on what the networks before it make of fresh furniture. Those stay
//! as they are.
//!
//! A part that was found is taken for the true part that it overlaps most. One that overlaps none by as much as [`LEAST`] teaches nothing.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sagci_furniture::Random;
use sagci_modelling::network::Weights;
use sagci_modelling::{BORDER, Borders};

use crate::head::{Head, Lessons, Rows, entropy, train_head};
use crate::lesson::drawn;
use crate::{Settings, TrainingError};

/// Points of a part that are learned from: any, and such whose neighbours are not of one mind. Which they are depends on features alone, so
/// no answer becomes likelier.
const ANY: usize = 100;
const DOUBTFUL: usize = 160;
/// Least overlap of a part with the true one, that it teaches anything.
const LEAST: f64 = 0.4;
/// Points a step, for each object of a batch.
const POINTS: usize = 64;

/// What an object teaches.
fn points(seed: u64, index: u64, weights: &Weights) -> Rows<BORDER, [f32; 1]> {
    let mut random = Random::new(seed.wrapping_mul(1_000_003).wrapping_add(index), "border");
    let mut out = Rows::default();
    let (_, cloud, _) = drawn(seed, index, false);
    let Ok(asked) = Borders::of(&cloud.points, weights) else { return out };
    // The true part of each thinned point: that of most of the points that it stands for.
    let mut votes: Vec<BTreeMap<i32, usize>> = vec![BTreeMap::new(); asked.label.len()];
    for (part, at) in cloud.part.iter().zip(&asked.of_input) {
        if let Some(at) = at {
            *votes[*at as usize].entry(*part).or_default() += 1;
        }
    }
    let truth: Vec<i32> = votes.iter().map(|v| v.iter().max_by_key(|x| x.1).map_or(-1, |x| *x.0)).collect();
    for g in 0..asked.parts as u32 {
        let own = |i: usize| asked.label[i] == Some(g + 1);
        let mut both: BTreeMap<i32, f64> = BTreeMap::new();
        (0..truth.len()).filter(|i| own(*i)).for_each(|i| *both.entry(truth[i]).or_default() += 1.0);
        let Some((part, common)) = both.iter().filter(|x| *x.0 > 0).max_by(|a, b| a.1.total_cmp(b.1)) else { continue };
        let either = (0..truth.len()).filter(|i| own(*i) || truth[*i] == *part).count() as f64;
        if *common < LEAST * either {
            continue;
        }
        let mut all: Vec<usize> = (0..asked.of.len()).filter(|r| asked.of[*r].1 == g).collect();
        random.shuffle(&mut all);
        let some = all.iter().copied().take(ANY);
        let hard = all.iter().copied().skip(ANY).filter(|r| asked.doubtful[*r]).take(DOUBTFUL);
        for r in some.chain(hard) {
            out.features.extend(asked.rows.row(r).iter());
            out.answers.push([f32::from(u8::from(truth[asked.of[r].0 as usize] == *part))]);
        }
    }
    out
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of the points is only looked at.
///
/// Errors: no point to learn from; weights that do not fit.
pub fn train_border(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught = (0..settings.objects).into_par_iter().map(|i| points(settings.seed, i, from)).collect();
    train_head(&Lessons::plain(Head::Border, entropy, POINTS), settings, taught, from, log)
}
