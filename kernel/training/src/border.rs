//! Teaches where parts end: the head that is asked about single points, on what the networks before it make of fresh furniture. Those stay
//! as they are.
//!
//! A part that was found is taken for the true part that it overlaps most. One that overlaps none by as much as [`LEAST`] teaches nothing.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sagci_furniture::Random;
use sagci_modelling::network::{Matrix, Network, Weights};
use sagci_modelling::{BORDER, Borders, ModellingError};

use crate::adam::Adam;
use crate::initial::Initial;
use crate::lesson::drawn;
use crate::tape::Tape;
use crate::{Settings, TrainingError};

/// Points of a part that are learned from: any, and such whose neighbours are not of one mind. Which they are depends on features alone, so
/// no answer becomes likelier.
const ANY: usize = 100;
const DOUBTFUL: usize = 160;
/// Least overlap of a part with the true one, that it teaches anything.
const LEAST: f64 = 0.4;
/// Points a step, for each object of a batch.
const POINTS: usize = 64;

/// Rows of features, and of each whether the point is the part's.
#[derive(Default)]
struct Points {
    rows: Vec<f32>,
    own: Vec<bool>,
}

impl Points {
    fn gather(&self, at: &[usize]) -> (Matrix, Vec<bool>) {
        let rows = Matrix::from_fn(at.len(), BORDER, |i, k| self.rows[at[i] * BORDER + k]);
        (rows, at.iter().map(|i| self.own[*i]).collect())
    }
}

/// What an object teaches.
fn points(seed: u64, index: u64, weights: &Weights) -> Points {
    let mut random = Random::new(seed.wrapping_mul(1_000_003).wrapping_add(index), "border");
    let mut out = Points::default();
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
            out.rows.extend(asked.rows.row(r).iter());
            out.own.push(truth[asked.of[r].0 as usize] == *part);
        }
    }
    out
}

/// Mean loss and share of right answers; gradients are added.
fn learn(
    weights: &BTreeMap<String, Matrix>,
    (rows, own): (Matrix, Vec<bool>),
    gradients: Option<&mut BTreeMap<String, Matrix>>,
) -> Result<[f64; 2], ModellingError> {
    let mut tape = Tape::new(weights);
    let at = Network::new(&mut tape).border(rows)?;
    let n = own.len().max(1) as f32;
    let mut score = [0.0; 2];
    let d = Matrix::from_fn(own.len(), 1, |i, _| {
        let p = 1.0 / (1.0 + (-tape.value(at)[i]).exp());
        score[0] -= f64::from((if own[i] { p } else { 1.0 - p }).max(1e-9).ln() / n);
        score[1] += f64::from(u8::from((p > 0.5) == own[i])) / f64::from(n);
        (p - f32::from(u8::from(own[i]))) / n
    });
    if let Some(gradients) = gradients {
        tape.back(&[(at, d)], gradients);
    }
    Ok(score)
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of the points is only looked at.
///
/// Errors: no point to learn from; weights that do not fit.
pub fn train_border(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught: Vec<Points> = (0..settings.objects).into_par_iter().map(|i| points(settings.seed, i, from)).collect();
    let mut all = Points::default();
    for t in taught {
        all.rows.extend(t.rows);
        all.own.extend(t.own);
    }
    let learned = all.own.len() - all.own.len() / 10;
    if learned == all.own.len() {
        return Err(TrainingError::NoLessons { objects: settings.objects });
    }
    let fresh: Vec<usize> = (learned..all.own.len()).collect();
    let mut initial = Initial::new(settings.seed);
    Network::new(&mut initial).border(Matrix::zeros(0, 0))?;
    let mut weights = initial.weights;
    let batch = (settings.batch * POINTS).max(1);
    let mut adam = Adam::new(settings.epochs * learned.div_ceil(batch), settings.rate);
    let mut random = Random::new(settings.seed, "border order");
    let mut order: Vec<usize> = (0..learned).collect();
    let mut lines = Vec::new();
    for epoch in 0..settings.epochs {
        random.shuffle(&mut order);
        let mut total = [0.0; 3];
        for chunk in order.chunks(batch) {
            let mut gradients = BTreeMap::new();
            let score = learn(&weights, all.gather(chunk), Some(&mut gradients))?;
            let n = chunk.len() as f64;
            total = [total[0] + n * score[0], total[1] + n * score[1], total[2] + n];
            adam.step(&mut weights, &gradients, 1.0);
        }
        let seen = learn(&weights, all.gather(&fresh), None)?;
        let [loss, right] = [total[0] / total[2], total[1] / total[2]];
        let line = format!("epoch {:3}  loss {loss:.4}  right {right:.4}  fresh  loss {:.4}  right {:.4}", epoch + 1, seen[0], seen[1]);
        log(&line);
        lines.push(line);
    }
    let mut made = Weights { matrices: from.matrices.clone(), made_by: String::new() };
    made.matrices.extend(weights);
    let before: serde_json::Value = serde_json::from_str(&from.made_by)?;
    made.made_by = serde_json::to_string(&serde_json::json!({ "settings": settings, "head": "border", "log": lines, "from": before }))?;
    Ok(made)
}
