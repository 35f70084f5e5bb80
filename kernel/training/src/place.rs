//! Teaches where hinges are, on parts as all networks before make them of fresh furniture. Those stay as they are.
//!
//! What is made small is the mean distance from the true line, not its square: what is hidden makes some hinges be far off however they are told,
//! and these shall not pull at the others. Hinges are few beside what is told of each, so what is told is blurred a little, anew each time (Bishop,
//! "Training with noise is equivalent to Tikhonov regularization", 1995), and several networks of the head answer, of which the mean counts
//! (Lakshminarayanan et al., "Simple and scalable predictive uncertainty estimation using deep ensembles", NeurIPS 2017).

use nalgebra::{Matrix2x4, Vector2, Vector4};
use rayon::prelude::*;
use sagci_furniture::Kind;
use sagci_modelling::network::{Matrix, Weights};
use sagci_modelling::{FARTHEST, Hinges, PLACE, PLACE_ANSWERS, PLACE_MEMBERS, RESIDUAL};

use crate::head::{Head, Lessons, Rows, overlaps, train_head};
use crate::lesson::drawn;
use crate::{Settings, TrainingError};

/// Hinges a step, for each object of a batch.
const HINGES: usize = 2;
/// Least overlap of a part with the true one.
const ENOUGH: f64 = 0.5;
/// A distance, in [`RESIDUAL`], that is as good as none.
const NONE: f32 = 0.03;
/// Weight of how far off it expects to be.
const EXPECTED: f32 = 0.1;
/// Standard deviation by which what is told is blurred.
const BLUR: f32 = 0.06;

/// How the head's first answers move a hinge across its axis, and how it is to move.
#[derive(Debug, Clone, Copy)]
struct Target {
    moves: Matrix2x4<f32>,
    true_move: Vector2<f32>,
}

/// What an object teaches.
fn hinges(seed: u64, index: u64, weights: &Weights) -> Rows<PLACE, Target> {
    let mut out = Rows::default();
    let (object, cloud, _) = drawn(seed, index, false);
    let Ok(asked) = Hinges::of(&cloud.points, weights) else { return out };
    let labels = asked.part.iter().map(|l| *l as usize + 1).max().unwrap_or(0);
    let labels = asked.label_of_input.iter().flatten().map(|l| *l as usize + 1).fold(labels, usize::max);
    let overlaps = overlaps(&cloud.part, object.parts.len(), &asked.label_of_input, labels);
    for joint in object.joints.iter().filter(|j| j.kind == Kind::Revolute) {
        let (axis, origin) = cloud.joint(joint);
        let near = (0..asked.part.len()).filter_map(|h| {
            let fits = overlaps[asked.part[h] as usize][joint.part] > ENOUGH && asked.axis[h].dot(&axis) > 0.9;
            let [along, across, ..] = asked.frames[h];
            let off = (origin - asked.origin[h]) / RESIDUAL;
            let true_move = Vector2::new(off.dot(&along), off.dot(&across));
            (fits && true_move.norm() < FARTHEST).then_some((h, true_move))
        });
        let Some((h, true_move)) = near.min_by(|a, b| a.1.norm().total_cmp(&b.1.norm())) else { continue };
        let [along, across, ..] = asked.frames[h];
        let moves = asked.frames[h].map(|v| Vector2::new(v.dot(&along), v.dot(&across)).cast());
        out.features.extend(asked.rows.row(h).iter());
        out.answers.push(Target { moves: Matrix2x4::from_columns(&moves), true_move: true_move.cast() });
    }
    out
}

/// Mean over the networks of the distance with what is expected of it, and the mean distance of their mean, m.
fn loss(out: &Matrix, targets: &[Target]) -> ([f64; 2], Matrix) {
    let n = targets.len().max(1) as f32;
    let mut score = [0.0; 2];
    let mut d = Matrix::zeros(targets.len(), PLACE_MEMBERS * PLACE_ANSWERS);
    for (i, target) in targets.iter().enumerate() {
        let mut mean = Vector2::zeros();
        for first in (0..PLACE_MEMBERS).map(|m| m * PLACE_ANSWERS) {
            let off = target.moves * Vector4::from_fn(|k, _| out[(i, first + k)]) - target.true_move;
            mean += off / PLACE_MEMBERS as f32;
            let distance = (off.norm_squared() + NONE * NONE).sqrt();
            // A Laplace distribution's scale, told apart from the distance: what is hard to tell counts as much as the rest.
            let expected = out[(i, first + 4)].clamp(-5.0, 3.0);
            let ratio = distance / expected.exp();
            score[0] += f64::from((distance + EXPECTED * (ratio + expected)) / (n * PLACE_MEMBERS as f32));
            let slope = target.moves.transpose() * off / (distance * n);
            (0..4).for_each(|k| d[(i, first + k)] = slope[k]);
            d[(i, first + 4)] = EXPECTED * (1.0 - ratio).max(-10.0) / n;
        }
        score[1] += f64::from(mean.norm() / n) * RESIDUAL;
    }
    (score, d)
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of the hinges is only looked at.
///
/// Errors: nothing to learn from; weights that do not fit.
pub fn train_place(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught: Vec<Rows<PLACE, Target>> = (0..settings.objects).into_par_iter().map(|i| hinges(settings.seed, i, from)).collect();
    let before: Vec<f64> = taught.iter().flat_map(|t| &t.answers).map(|t| f64::from(t.true_move.norm()) * RESIDUAL).collect();
    log(&format!("place: off by {:.4} m before", before.iter().sum::<f64>() / before.len().max(1) as f64));
    train_head(&Lessons { head: Head::Place, loss, figure: "off by, m", blur: BLUR, rows: HINGES }, settings, taught, from, log)
}
