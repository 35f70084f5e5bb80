//! Teaches which groups of pieces are parts: the head that is asked about groups as a whole, on those that the networks before it make of fresh
//! furniture. Those stay as they are.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sagci_furniture::Random;
use sagci_modelling::network::{Matrix, Network, Weights};
use sagci_modelling::{Groups, MASK, ModellingError};

use crate::adam::Adam;
use crate::initial::Initial;
use crate::lesson::drawn;
use crate::tape::Tape;
use crate::{Settings, TrainingError};

/// Groups a step, for each object of a batch.
const GROUPS: usize = 8;
/// Overlaps that are asked about.
const OVERLAPS: [f64; 2] = [0.5, 0.75];

/// Rows of features, and of each the overlap with the part that fits best.
#[derive(Default)]
struct Rows {
    rows: Vec<f32>,
    overlap: Vec<f64>,
}

impl Rows {
    fn gather(&self, at: &[usize]) -> (Matrix, Vec<f64>) {
        let rows = Matrix::from_fn(at.len(), MASK, |i, k| self.rows[at[i] * MASK + k]);
        (rows, at.iter().map(|i| self.overlap[*i]).collect())
    }
}

/// What an object teaches.
fn groups(seed: u64, index: u64, weights: &Weights) -> Rows {
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
        out.rows.extend(asked.rows.row(k).iter());
        out.overlap.push((1..parts).map(overlap).fold(0.0, f64::max));
    }
    out
}

/// What is to be answered: rises about the overlap that is asked about, since a hair's breadth does not make a group another.
fn target(overlap: f64, asked: f64) -> f32 {
    ((overlap - asked) / 0.1 + 0.5).clamp(0.0, 1.0) as f32
}

/// Mean loss and share of right answers; gradients are added.
fn learn(
    weights: &BTreeMap<String, Matrix>,
    (rows, overlap): (Matrix, Vec<f64>),
    gradients: Option<&mut BTreeMap<String, Matrix>>,
) -> Result<[f64; 2], ModellingError> {
    let mut tape = Tape::new(weights);
    let at = Network::new(&mut tape).masks(rows)?;
    let n = (2 * overlap.len()).max(1) as f32;
    let mut score = [0.0; 2];
    let d = Matrix::from_fn(overlap.len(), 2, |i, k| {
        let t = target(overlap[i], OVERLAPS[k]);
        let p = 1.0 / (1.0 + (-tape.value(at)[(i, k)]).exp());
        score[0] -= f64::from((t * p.max(1e-9).ln() + (1.0 - t) * (1.0 - p).max(1e-9).ln()) / n);
        score[1] += f64::from(u8::from((p > 0.5) == (t > 0.5))) / f64::from(n);
        (p - t) / n
    });
    if let Some(gradients) = gradients {
        tape.back(&[(at, d)], gradients);
    }
    Ok(score)
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of the groups is only looked at.
///
/// Errors: no group to learn from; weights that do not fit.
pub fn train_masks(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught: Vec<Rows> = (0..settings.objects).into_par_iter().map(|i| groups(settings.seed, i, from)).collect();
    let mut all = Rows::default();
    for t in taught {
        all.rows.extend(t.rows);
        all.overlap.extend(t.overlap);
    }
    let learned = all.overlap.len() - all.overlap.len() / 10;
    if learned == all.overlap.len() {
        return Err(TrainingError::NoLessons { objects: settings.objects });
    }
    log(&format!("{} groups", all.overlap.len()));
    let fresh: Vec<usize> = (learned..all.overlap.len()).collect();
    let mut initial = Initial::new(settings.seed);
    Network::new(&mut initial).masks(Matrix::zeros(0, 0))?;
    let mut weights = initial.weights;
    let batch = (settings.batch * GROUPS).max(1);
    let mut adam = Adam::new(settings.epochs * learned.div_ceil(batch), settings.rate);
    let mut random = Random::new(settings.seed, "mask order");
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
    made.made_by = serde_json::to_string(&serde_json::json!({ "settings": settings, "head": "mask", "log": lines, "from": before }))?;
    Ok(made)
}
