//! Teaches the last head how far parts are to be trusted, on parts as all networks before make them of fresh furniture. Those stay as they are.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sagci_furniture::Random;
use sagci_modelling::network::{Matrix, Network, Weights};
use sagci_modelling::{Ends, ModellingError, TRUST};

use crate::adam::Adam;
use crate::initial::Initial;
use crate::lesson::drawn;
use crate::tape::Tape;
use crate::{Settings, TrainingError};

/// Parts and bodies a step, for each object of a batch.
const PARTS: usize = 4;

/// Rows of features of parts and bodies, and their overlap with the true ones.
#[derive(Default)]
struct Rows {
    rows: Vec<f32>,
    overlap: Vec<f64>,
}

impl Rows {
    fn gather(&self, at: &[usize]) -> (Matrix, Vec<f64>) {
        let rows = Matrix::from_fn(at.len(), TRUST, |i, k| self.rows[at[i] * TRUST + k]);
        (rows, at.iter().map(|i| self.overlap[*i]).collect())
    }
}

/// What an object teaches.
fn ends(seed: u64, index: u64, weights: &Weights) -> Rows {
    let mut out = Rows::default();
    let (object, cloud, _) = drawn(seed, index, false);
    let Ok(asked) = Ends::of(&cloud.points, weights) else { return out };
    let (parts, found) = (object.parts.len(), asked.trust.nrows());
    let mut both = vec![vec![0.0_f64; parts]; found];
    let (mut of_true, mut of_found) = (vec![0.0; parts], vec![0.0; found]);
    for (part, label) in cloud.part.iter().zip(&asked.label_of_input) {
        let part = usize::try_from(*part).ok();
        part.iter().for_each(|t| of_true[*t] += 1.0);
        label.iter().for_each(|l| of_found[*l as usize] += 1.0);
        if let (Some(t), Some(l)) = (part, label) {
            both[*l as usize][t] += 1.0;
        }
    }
    let overlap = |l: usize, t: usize| both[l][t] / f64::max(of_true[t] + of_found[l] - both[l][t], 1.0);
    for l in 0..found {
        out.rows.extend(asked.trust.row(l).iter());
        out.overlap.push((0..parts).map(|t| overlap(l, t)).fold(0.0, f64::max));
    }
    out
}

/// Mean loss and share of right answers, is the overlap three quarters; gradients are added.
fn learn(
    weights: &BTreeMap<String, Matrix>,
    (rows, overlap): (Matrix, Vec<f64>),
    gradients: Option<&mut BTreeMap<String, Matrix>>,
) -> Result<[f64; 2], ModellingError> {
    let mut tape = Tape::new(weights);
    let at = Network::new(&mut tape).trust(rows)?;
    let n = overlap.len().max(1) as f32;
    let mut score = [0.0; 2];
    let d = Matrix::from_fn(overlap.len(), 1, |i, _| {
        let t = ((overlap[i] - 0.75) / 0.1 + 0.5).clamp(0.0, 1.0) as f32;
        let p = 1.0 / (1.0 + (-tape.value(at)[i]).exp());
        score[0] -= f64::from((t * p.max(1e-9).ln() + (1.0 - t) * (1.0 - p).max(1e-9).ln()) / n);
        score[1] += f64::from(u8::from((p > 0.5) == (t > 0.5))) / f64::from(n);
        (p - t) / n
    });
    if let Some(gradients) = gradients {
        tape.back(&[(at, d)], gradients);
    }
    Ok(score)
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of all is only looked at.
///
/// Errors: nothing to learn from; weights that do not fit.
pub fn train_trust(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught: Vec<Rows> = (0..settings.objects).into_par_iter().map(|i| ends(settings.seed, i, from)).collect();
    let mut all = Rows::default();
    for t in taught {
        all.rows.extend(t.rows);
        all.overlap.extend(t.overlap);
    }
    let learned = all.overlap.len() - all.overlap.len() / 10;
    if learned == all.overlap.len() {
        return Err(TrainingError::NoLessons { objects: settings.objects });
    }
    let fresh: Vec<usize> = (learned..all.overlap.len()).collect();
    let mut initial = Initial::new(settings.seed);
    Network::new(&mut initial).trust(Matrix::zeros(0, 0))?;
    let mut weights = initial.weights;
    let batch = (settings.batch * PARTS).max(1);
    let mut adam = Adam::new(settings.epochs * learned.div_ceil(batch), settings.rate);
    let mut random = Random::new(settings.seed, "trust");
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
        let [loss, score] = [total[0] / total[2], total[1] / total[2]];
        let line = format!("trust epoch {:3}  loss {loss:.4}  {score:.4}  fresh  loss {:.4}  {:.4}", epoch + 1, seen[0], seen[1]);
        log(&line);
        lines.push(line);
    }
    let mut made = Weights { matrices: from.matrices.clone(), made_by: String::new() };
    made.matrices.extend(weights);
    let before: serde_json::Value = serde_json::from_str(&from.made_by)?;
    made.made_by = serde_json::to_string(&serde_json::json!({ "settings": settings, "head": "trust", "log": lines, "from": before }))?;
    Ok(made)
}
