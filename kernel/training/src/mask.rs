//! Teaches which groups of pieces are parts: the head that is asked about all groups of an object at once, on those that the networks before it
//! make of fresh furniture. Those stay as they are.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sagci_furniture::Random;
use sagci_modelling::network::{Matrix, Network, Weights};
use sagci_modelling::{Groups, ModellingError};

use crate::adam::Adam;
use crate::batch::{Gradients, learned};
use crate::head::{cross_entropy, made, more_than};
use crate::initial::Initial;
use crate::lesson::drawn;
use crate::tape::Tape;
use crate::{Settings, TrainingError};

/// Overlaps that are asked about.
const OVERLAPS: [f64; 2] = [0.5, 0.75];
/// One object more is looked at only, for so many that are learned from.
const LOOKED_AT: u64 = 20;

/// What is asked about an object's groups, and what is to be answered.
struct Lesson {
    rows: Matrix,
    relations: Matrix,
    answers: Vec<[f32; 2]>,
}

/// The lesson of an index; none where nothing is asked.
fn lesson(seed: u64, index: u64, weights: &Weights) -> Option<Lesson> {
    let (_, cloud, _) = drawn(seed, index, false);
    let asked = Groups::of(&cloud.points, weights).ok().filter(|asked| !asked.of.is_empty())?;
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
    let answer = |group: &Vec<usize>| {
        let own: f64 = group.iter().map(|p| of_piece[*p]).sum();
        let overlap = |t: usize| {
            let common: f64 = group.iter().map(|p| both[*p][t]).sum();
            common / (own + of_part[t] - common).max(1.0)
        };
        let most = (1..parts).map(overlap).fold(0.0, f64::max);
        OVERLAPS.map(|asked| more_than(asked, most))
    };
    Some(Lesson { answers: asked.of.iter().map(answer).collect(), rows: asked.rows, relations: asked.relations })
}

fn lessons(seed: u64, objects: std::ops::Range<u64>, weights: &Weights) -> Vec<Lesson> {
    objects.into_par_iter().filter_map(|i| lesson(seed, i, weights)).collect()
}

/// Sums of losses, of right answers, and of answers; gradients are added.
fn learn(weights: &BTreeMap<String, Matrix>, lesson: &Lesson, gradients: Option<&mut Gradients>) -> Result<[f64; 3], ModellingError> {
    let mut tape = Tape::new(weights);
    let at = Network::new(&mut tape).masks(lesson.rows.clone(), lesson.relations.clone())?;
    let mut score = [0.0; 3];
    let d = Matrix::from_fn(lesson.answers.len(), OVERLAPS.len(), |i, k| {
        let (loss, right, d) = cross_entropy(tape.value(at)[(i, k)], lesson.answers[i][k], 1.0);
        score = [score[0] + loss, score[1] + f64::from(u8::from(right)), score[2] + 1.0];
        d
    });
    if let Some(gradients) = gradients {
        tape.back(&[(at, d)], gradients);
    }
    Ok(score)
}

/// Mean loss and share of right answers.
fn means(scores: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    let sum = scores.fold([0.0; 3], |s, x| std::array::from_fn(|k| s[k] + x[k]));
    [sum[0] / sum[2].max(1.0), sum[1] / sum[2].max(1.0), sum[2]]
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. Objects beyond those that are learned from are only looked at.
///
/// Errors: no group to learn from; weights that do not fit.
pub fn train_masks(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let mut initial = Initial::new(settings.seed);
    Network::new(&mut initial).masks(Matrix::zeros(0, 0), Matrix::zeros(0, 0))?;
    trained(settings, from, initial.weights, log)
}

/// Goes on with the head that is there, on other objects.
///
/// Errors: as [`train_masks`].
pub fn train_more_masks(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let known = from.matrices.iter().filter(|(name, _)| name.starts_with("mask."));
    let known = known.map(|(name, matrix)| (name.clone(), matrix.clone())).collect();
    trained(settings, from, known, log)
}

fn trained(
    settings: &Settings,
    from: &Weights,
    mut weights: BTreeMap<String, Matrix>,
    log: &mut dyn FnMut(&str),
) -> Result<Weights, TrainingError> {
    let batch = settings.batch.max(1);
    let at_once = settings.at_once.clamp(1, settings.objects.max(1));
    let fresh = lessons(settings.seed, settings.objects..settings.objects + settings.objects.div_ceil(LOOKED_AT), from);
    let mut adam = Adam::new(settings.epochs * (settings.objects as usize).div_ceil(batch), settings.rate);
    let mut random = Random::new(settings.seed, "mask order");
    let mut lines = Vec::new();
    for part in 0..settings.objects.div_ceil(at_once) {
        let taught = lessons(settings.seed, part * at_once..((part + 1) * at_once).min(settings.objects), from);
        if taught.is_empty() {
            return Err(TrainingError::NoLessons { objects: settings.objects });
        }
        let mut order: Vec<usize> = (0..taught.len()).collect();
        for epoch in 0..settings.epochs {
            random.shuffle(&mut order);
            let mut all = Vec::new();
            for chunk in order.chunks(batch) {
                let (scores, sum) = learned(chunk, |i, g| learn(&weights, &taught[i], Some(g)))?;
                let answers: f64 = scores.iter().map(|s| s[2]).sum();
                all.extend(scores);
                adam.step(&mut weights, &sum, answers as f32);
            }
            let looked: Result<Vec<[f64; 3]>, ModellingError> = fresh.par_iter().map(|l| learn(&weights, l, None)).collect();
            let ([loss, right, _], [anew, well, _]) = (means(all.into_iter()), means(looked?.into_iter()));
            let line = format!(
                "part {:3} epoch {:3}  loss {loss:.4}  right {right:.4}  fresh  loss {anew:.4}  right {well:.4}",
                part + 1,
                epoch + 1
            );
            log(&line);
            lines.push(line);
        }
    }
    made("mask", settings, from, weights, &lines)
}
