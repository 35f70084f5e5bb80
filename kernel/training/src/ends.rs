//! Teaches the last heads, on parts as all networks before make them of fresh furniture: where hinges are, and how far parts are to be trusted.
//! Those networks stay as they are.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sagci_furniture::{Kind, Random};
use sagci_modelling::network::{Matrix, Network, Weights};
use sagci_modelling::{CANDIDATES, Ends, HINGE, ModellingError, TRUST};

use crate::adam::Adam;
use crate::initial::Initial;
use crate::lesson::drawn;
use crate::tape::Tape;
use crate::{Settings, TrainingError};

/// Hinges, and parts with bodies, a step, for each object of a batch.
const HINGES: usize = 2;
const PARTS: usize = 4;
/// Least overlap of a part with the true one, that it may be learned from.
const LEAST: f64 = 0.5;
/// Errors below this count by their square, in the measure of residuals: half a centimetre.
const SMALL: f32 = 0.1;
/// Most that is asked of the head: what is farther is no matter of where a part ends.
const MOST: f64 = 6.0;

/// Rows of features of hinges and what their places are to be moved by; rows of parts and bodies, and their overlap with the true ones.
#[derive(Default)]
struct Rows {
    hinges: Vec<f32>,
    off: Vec<[f32; 2]>,
    trust: Vec<f32>,
    overlap: Vec<f64>,
}

fn gather<T: Copy>(rows: &[f32], width: usize, answers: &[T], at: &[usize]) -> (Matrix, Vec<T>) {
    (Matrix::from_fn(at.len(), width, |i, k| rows[at[i] * width + k]), at.iter().map(|i| answers[*i]).collect())
}

/// What an object teaches.
fn ends(seed: u64, index: u64, weights: &Weights) -> Rows {
    let mut out = Rows::default();
    let (object, cloud, _) = drawn(seed, index, false);
    let turning: Vec<&sagci_furniture::Joint> = object.joints.iter().filter(|j| j.kind == Kind::Revolute).collect();
    let truth: Vec<_> = turning.iter().map(|j| cloud.joint(j)).collect();
    let Ok(asked) = Ends::of(&cloud.points, &truth, weights) else { return out };
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
        out.trust.extend(asked.trust.row(l).iter());
        out.overlap.push((0..parts).map(|t| overlap(l, t)).fold(0.0, f64::max));
    }
    for (g, right) in asked.right.iter().enumerate() {
        let of = (0..turning.len()).find(|k| overlap(g + 1, turning[*k].part) > LEAST);
        let Some((row, off)) = of.and_then(|k| right[k]).filter(|r| r.1[0].hypot(r.1[1]) < MOST) else { continue };
        out.hinges.extend(asked.hinges.row(g * CANDIDATES + row).iter());
        out.off.push(off.map(|x| x as f32));
    }
    out
}

/// Loss and mean distance in metres of hinges; gradients are added.
fn learn_hinges(
    weights: &BTreeMap<String, Matrix>,
    (rows, off): (Matrix, Vec<[f32; 2]>),
    gradients: Option<&mut BTreeMap<String, Matrix>>,
) -> Result<[f64; 2], ModellingError> {
    let mut tape = Tape::new(weights);
    let at = Network::new(&mut tape).hinges(rows)?;
    let n = off.len().max(1) as f32;
    let mut score = [0.0; 2];
    let mut d = Matrix::zeros(off.len(), 2);
    for (i, right) in off.iter().enumerate() {
        // The distance itself, as it is judged (Huber 1964).
        let e = [0, 1].map(|k| tape.value(at)[(i, k)] - right[k]);
        let far = e[0].hypot(e[1]);
        score[0] += f64::from(if far < SMALL { far * far / (2.0 * SMALL) } else { far - SMALL / 2.0 } / n);
        score[1] += 0.05 * f64::from(far / n);
        for k in 0..2 {
            d[(i, k)] = e[k] / far.max(SMALL) / n;
        }
    }
    if let Some(gradients) = gradients {
        tape.back(&[(at, d)], gradients);
    }
    Ok(score)
}

/// Loss and share of right answers, is the overlap three quarters; gradients are added.
fn learn_trust(
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

/// Trains both heads anew, beside weights that stay; `log` is told of every epoch. The last tenth of all is only looked at.
///
/// Errors: nothing to learn from; weights that do not fit.
pub fn train_ends(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught: Vec<Rows> = (0..settings.objects).into_par_iter().map(|i| ends(settings.seed, i, from)).collect();
    let mut all = Rows::default();
    for t in taught {
        all.hinges.extend(t.hinges);
        all.off.extend(t.off);
        all.trust.extend(t.trust);
        all.overlap.extend(t.overlap);
    }
    let mut initial = Initial::new(settings.seed);
    let mut network = Network::new(&mut initial);
    network.hinges(Matrix::zeros(0, 0))?;
    network.trust(Matrix::zeros(0, 0))?;
    let mut weights = initial.weights;
    let mut lines = Vec::new();
    let mut tell = |line: String| {
        log(&line);
        lines.push(line);
    };
    let mut hinges = |w: &BTreeMap<String, Matrix>, at: &[usize], g: Option<&mut BTreeMap<String, Matrix>>| {
        learn_hinges(w, gather(&all.hinges, HINGE, &all.off, at), g)
    };
    epochs(settings, ("hinges", HINGES), all.off.len(), &mut weights, &mut hinges, &mut tell)?;
    let mut trust = |w: &BTreeMap<String, Matrix>, at: &[usize], g: Option<&mut BTreeMap<String, Matrix>>| {
        learn_trust(w, gather(&all.trust, TRUST, &all.overlap, at), g)
    };
    epochs(settings, ("trust", PARTS), all.overlap.len(), &mut weights, &mut trust, &mut tell)?;
    let mut made = Weights { matrices: from.matrices.clone(), made_by: String::new() };
    made.matrices.extend(weights);
    let before: serde_json::Value = serde_json::from_str(&from.made_by)?;
    made.made_by = serde_json::to_string(&serde_json::json!({ "settings": settings, "head": "ends", "log": lines, "from": before }))?;
    Ok(made)
}

/// Loss and score of some of what there is to learn; gradients are added.
type Learn<'a> = dyn FnMut(&BTreeMap<String, Matrix>, &[usize], Option<&mut BTreeMap<String, Matrix>>) -> Result<[f64; 2], ModellingError> + 'a;

/// All epochs of one head, of `count` things, so many a step for each object of a batch.
fn epochs(
    settings: &Settings,
    (name, many): (&str, usize),
    count: usize,
    weights: &mut BTreeMap<String, Matrix>,
    learn: &mut Learn<'_>,
    tell: &mut dyn FnMut(String),
) -> Result<(), TrainingError> {
    let learned = count - count / 10;
    if learned == count {
        return Err(TrainingError::NoLessons { objects: settings.objects });
    }
    let fresh: Vec<usize> = (learned..count).collect();
    let batch = (settings.batch * many).max(1);
    let mut adam = Adam::new(settings.epochs * learned.div_ceil(batch), settings.rate);
    let mut random = Random::new(settings.seed, name);
    let mut order: Vec<usize> = (0..learned).collect();
    for epoch in 0..settings.epochs {
        random.shuffle(&mut order);
        let mut total = [0.0; 3];
        for chunk in order.chunks(batch) {
            let mut gradients = BTreeMap::new();
            let score = learn(weights, chunk, Some(&mut gradients))?;
            let n = chunk.len() as f64;
            total = [total[0] + n * score[0], total[1] + n * score[1], total[2] + n];
            adam.step(weights, &gradients, 1.0);
        }
        let seen = learn(weights, &fresh, None)?;
        let [loss, score] = [total[0] / total[2], total[1] / total[2]];
        tell(format!("{name} epoch {:3}  loss {loss:.4}  {score:.4}  fresh  loss {:.4}  {:.4}", epoch + 1, seen[0], seen[1]));
    }
    Ok(())
}
