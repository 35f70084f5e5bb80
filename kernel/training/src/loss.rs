//! What is made small: cross-entropies of class, front, same part and joint, and the Huber loss of a hinge's residual.

use std::collections::BTreeMap;

use sagci_modelling::network::{CLASSES, Matrix, Network, Trunk, softmax_rows};
use sagci_modelling::{CANDIDATES, ModellingError};

use crate::lesson::{Inputs, Lesson};
use crate::tape::{Tape, Value};

/// In one lesson of so many the wrong side is looked at.
pub const WRONG_EVERY: usize = 3;

/// Losses and right answers, summed over lessons.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Score {
    /// Lessons.
    pub lessons: f64,
    /// Mean loss, all terms.
    pub loss: f64,
    /// Classes that are right, by weight.
    pub class: [f64; 2],
    /// Pairs that are right, by weight.
    pub same: [f64; 2],
    /// Fronts that are right.
    pub front: [f64; 2],
    /// Joints that are right.
    pub joint: [f64; 2],
    /// Sum and number of the hinge's distance, m.
    pub place: [f64; 2],
}

impl Score {
    /// Adds another.
    pub fn add(&mut self, o: &Self) {
        self.lessons += o.lessons;
        self.loss += o.loss;
        for (a, b) in [
            (&mut self.class, o.class),
            (&mut self.same, o.same),
            (&mut self.front, o.front),
            (&mut self.joint, o.joint),
            (&mut self.place, o.place),
        ] {
            a[0] += b[0];
            a[1] += b[1];
        }
    }

    /// As a line.
    pub fn line(&self) -> String {
        let share = |x: [f64; 2]| x[0] / x[1].max(1e-9);
        format!(
            "loss {:.4}  class {:.4}  same {:.4}  front {:.4}  joint {:.4}  place {:.4} m",
            self.loss / self.lessons.max(1.0),
            share(self.class),
            share(self.same),
            share(self.front),
            share(self.joint),
            share(self.place)
        )
    }
}

fn trunk(network: &mut Network<'_, Tape<'_>>, inputs: &Inputs) -> Result<Trunk<Value>, ModellingError> {
    network.trunk(inputs.pieces.clone(), inputs.points.clone(), inputs.pairs.as_ref().clone())
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// Loss of one lesson; its gradients are added. The wrong side is looked at only if asked for: it is half the work, and one answer.
///
/// Errors: weights that do not fit the network.
pub fn learn(
    weights: &BTreeMap<String, Matrix>,
    lesson: &Lesson,
    wrong_side: bool,
    gradients: Option<&mut BTreeMap<String, Matrix>>,
) -> Result<Score, ModellingError> {
    let n = lesson.class.len();
    let mut tape = Tape::new(weights);
    let mut network = Network::new(&mut tape);
    let front = trunk(&mut network, &lesson.front)?;
    let classes = network.classes(&front)?;
    let yes = network.front(&front, n)?;
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    let same = if pairs.is_empty() { None } else { Some(network.same_part(&front, n, &pairs)?) };
    let joints = match lesson.parts.is_empty() {
        true => None,
        false => Some(network.joints(&front, n, &lesson.parts, lesson.candidates.clone())?),
    };
    let mut fronts = vec![(yes, 1.0)];
    if wrong_side {
        let other = trunk(&mut network, &lesson.other)?;
        fronts.push((network.front(&other, lesson.other.pieces.nrows())?, 0.0));
    }
    let mut score = Score { lessons: 1.0, ..Score::default() };
    let mut seeds: Vec<(Value, Matrix)> = Vec::new();

    let total: f32 = lesson.weight.iter().sum::<f32>().max(1e-6);
    let mut p = tape.value(classes).clone();
    softmax_rows(&mut p);
    let mut d = Matrix::zeros(n, CLASSES);
    for i in 0..n {
        let (w, t) = (lesson.weight[i] / total, lesson.class[i]);
        score.loss -= f64::from(w * p[(i, t)].max(1e-9).ln());
        score.class[0] += if p.row(i).transpose().argmax().0 == t { f64::from(w) } else { 0.0 };
        score.class[1] += f64::from(w);
        for k in 0..CLASSES {
            d[(i, k)] = w * (p[(i, k)] - f32::from(u8::from(k == t)));
        }
    }
    seeds.push((classes, d));

    for (at, t) in fronts {
        // Right and wrong sides weigh alike, however seldom these are looked at.
        let weight = if t > 0.5 { 0.5 } else { 0.5 * WRONG_EVERY as f32 };
        let x = tape.value(at)[0];
        let p = sigmoid(x);
        score.loss -= f64::from(weight * (if t > 0.5 { p } else { 1.0 - p }).max(1e-9).ln());
        score.front[0] += f64::from(u8::from((p > 0.5) == (t > 0.5)));
        score.front[1] += 1.0;
        seeds.push((at, Matrix::from_element(1, 1, weight * (p - t))));
    }

    if let Some(same) = same {
        let x = tape.value(same);
        // Pairs of the body with itself are many and easy.
        let weight: Vec<f32> = pairs
            .iter()
            .map(|(i, j)| {
                let both_body = lesson.part[*i] == 0 && lesson.part[*j] == 0;
                let together = lesson.part[*i] == lesson.part[*j];
                lesson.weight[*i].min(lesson.weight[*j])
                    * if both_body {
                        0.3
                    } else if together {
                        2.0
                    } else {
                        1.0
                    }
            })
            .collect();
        let total: f32 = weight.iter().sum::<f32>().max(1e-6);
        let mut d = Matrix::zeros(pairs.len(), 1);
        for (r, (i, j)) in pairs.iter().enumerate() {
            let t = f32::from(u8::from(lesson.part[*i] == lesson.part[*j]));
            let (p, w) = (sigmoid(x[r]), weight[r] / total);
            score.loss -= 1.5 * f64::from(w * (if t > 0.5 { p } else { 1.0 - p }).max(1e-9).ln());
            score.same[0] += if (p > 0.5) == (t > 0.5) { f64::from(w) } else { 0.0 };
            score.same[1] += f64::from(w);
            d[r] = 1.5 * w * (p - t);
        }
        seeds.push((same, d));
    }

    if let Some(joints) = joints {
        let out = tape.value(joints);
        let mut d = Matrix::zeros(out.nrows(), 3);
        let count = lesson.joints.len() as f32;
        for (k, truth) in lesson.joints.iter().enumerate() {
            let rows = k * CANDIDATES..(k + 1) * CANDIDATES;
            let mut p = Matrix::from_fn(1, CANDIDATES, |_, c| out[(rows.start + c, 0)]);
            softmax_rows(&mut p);
            score.loss -= f64::from(p[truth.candidate].max(1e-9).ln() / count);
            let right = p.transpose().column(0).argmax().0 == truth.candidate;
            score.joint[0] += f64::from(u8::from(right));
            score.joint[1] += 1.0;
            for c in 0..CANDIDATES {
                d[(rows.start + c, 0)] = (p[c] - f32::from(u8::from(c == truth.candidate))) / count;
            }
            if let Some(residual) = truth.residual {
                let row = rows.start + truth.candidate;
                let mut squared = 0.0;
                for (m, r) in residual.iter().enumerate() {
                    let e = out[(row, 1 + m)] - r;
                    squared += e * e;
                    score.loss += f64::from(if e.abs() < 0.3 { e * e / 0.6 } else { e.abs() - 0.15 } * 0.5 / count);
                    d[(row, 1 + m)] = 0.5 * (e / 0.3).clamp(-1.0, 1.0) / count;
                }
                score.place[0] += f64::from(squared.sqrt()) * 0.05;
                score.place[1] += 1.0;
            }
        }
        seeds.push((joints, d));
    }
    if let Some(gradients) = gradients {
        tape.back(&seeds, gradients);
    }
    Ok(score)
}

/// First weights of the network.
///
/// Errors: none that a network without weights could have.
pub fn first_weights(seed: u64) -> Result<BTreeMap<String, Matrix>, ModellingError> {
    let mut initial = crate::initial::Initial::new(seed);
    let mut network = Network::new(&mut initial);
    let trunk = network.trunk(Matrix::zeros(0, 0), Matrix::zeros(0, 0), Matrix::zeros(0, 0))?;
    network.classes(&trunk)?;
    network.front(&trunk, 0)?;
    network.same_part(&trunk, 0, &[])?;
    network.joints(&trunk, 0, &[], Matrix::zeros(0, 0))?;
    network.border(Matrix::zeros(0, 0))?;
    Ok(initial.weights)
}
