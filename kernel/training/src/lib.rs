//! Trains the networks of the crate `modelling` on furniture of the crate `furniture`.
//!
//! The network is written once, over an algebra; here it runs on a tape that carries gradients back. No framework is used: the one
//! that measures fastest on a processor brings some five hundred packages into the lock file for a network of a hundred thousand weights,
//! and plain matrices are faster still. Everything is drawn from one seed, gradients are summed in one order, and families
//! marked as held out are never drawn, so a run can be repeated to the bit on one machine.
#![forbid(unsafe_code)]

mod adam;
mod batch;
mod border;
mod evidence;
mod head;
mod initial;
mod lesson;
mod loss;
mod mask;
mod place;
mod tape;
mod trust;

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;
use sagci_furniture::Random;
use sagci_modelling::ModellingError;
use sagci_modelling::network::{Matrix, Weights};
use serde::Serialize;

use batch::Gradients;
pub use border::train_border;
pub use evidence::train_evidence;
pub use lesson::{Lesson, lesson};
pub use loss::{Score, learn};
pub use mask::{train_masks, train_more_masks};
pub use place::train_place;
pub use trust::train_trust;

/// What a training run is made by.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Settings {
    /// Everything is drawn from it.
    pub seed: u64,
    /// Objects that are learned from.
    pub objects: u64,
    /// How many of them are drawn at a time: what is seen only as often as it is drawn is not learned by heart.
    pub at_once: u64,
    /// How often each is seen, before the next are drawn.
    pub epochs: usize,
    /// Objects a step.
    pub batch: usize,
    /// Greatest rate of learning.
    pub rate: f64,
    /// Share that stays of the weights that it goes on from: what they knew of other shapes is kept better so. (Wortsman et al., "Robust
    /// fine-tuning of zero-shot models", CVPR 2022.)
    pub kept: f64,
}

/// Why training failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// The network and its weights do not fit.
    #[error(transparent)]
    Network(#[from] ModellingError),
    /// Nothing to learn from.
    #[error("none of {objects} objects could be analysed")]
    NoLessons {
        /// How many were drawn.
        objects: u64,
    },
    /// The mean of none was asked for.
    #[error("the mean of no weights is none: give one file at least")]
    NoWeights,
    /// Weights whose mean was asked for differ in more than their values.
    #[error("weights of other networks have no mean: '{name}' is missing in one, or has another shape")]
    Unlike {
        /// The matrix.
        name: String,
    },
    /// Settings could not be written down.
    #[error("the settings cannot be written: {0}")]
    Settings(#[from] serde_json::Error),
}

/// Draws the lessons of some objects, several at a time, in order. `held_out` draws from the families that are kept out of training.
pub fn lessons(seed: u64, objects: Range<u64>, held_out: bool) -> Vec<Lesson> {
    objects.into_par_iter().flat_map_iter(|i| lesson(seed, i, held_out)).collect()
}

/// Trains on the lessons that `draw` makes of objects, from other weights if some are given; `log` is told of every epoch, with the weights so
/// far. Equal settings and lessons give equal weights.
///
/// Errors: no lesson at all.
pub fn train(
    settings: &Settings,
    from: Option<&Weights>,
    draw: &mut dyn FnMut(Range<u64>) -> Vec<Lesson>,
    checked: &[Lesson],
    log: &mut dyn FnMut(&str, &Weights),
) -> Result<Weights, TrainingError> {
    let mut weights = loss::first_weights(settings.seed)?;
    if let Some(from) = from {
        for (name, to) in &mut weights {
            if let Some(known) = from.matrices.get(name) {
                widen(to, known);
            }
        }
    }
    // What made the weights that it went on from, as they say it themselves.
    let before: Option<serde_json::Value> = from.map(|f| serde_json::from_str(&f.made_by)).transpose()?;
    let batch = settings.batch.max(1);
    let at_once = settings.at_once.clamp(1, settings.objects.max(1));
    let parts = settings.objects.div_ceil(at_once);
    // An object is two lessons. Where it is none for once, the rate ends a little above its least.
    let steps = settings.epochs * (2 * settings.objects as usize).div_ceil(batch);
    let mut adam = adam::Adam::new(steps, settings.rate);
    let mut random = Random::new(settings.seed, "order");
    let mut lines = Vec::new();
    let mut made = Weights { matrices: from.map_or_else(BTreeMap::new, |f| f.matrices.clone()), made_by: String::new() };
    for part in 0..parts {
        let lessons = draw(part * at_once..((part + 1) * at_once).min(settings.objects));
        if lessons.is_empty() {
            return Err(TrainingError::NoLessons { objects: settings.objects });
        }
        let mut order: Vec<usize> = (0..lessons.len()).collect();
        for epoch in 0..settings.epochs {
            random.shuffle(&mut order);
            let mut total = Score::default();
            for chunk in order.chunks(batch) {
                let learned =
                    |i: usize, g: &mut Gradients| learn(&weights, &lessons[i], (i + epoch).is_multiple_of(loss::WRONG_EVERY), Some(g));
                let (scores, sum) = batch::learned(chunk, learned)?;
                scores.iter().for_each(|s| total.add(s));
                adam.step(&mut weights, &sum, chunk.len() as f32);
            }
            let done = part as usize * settings.epochs + epoch + 1;
            let mut line = format!("part {:3} epoch {:3}  {}", part + 1, epoch + 1, total.line());
            if done.is_multiple_of(4) || done == parts as usize * settings.epochs {
                line += &format!("\n        fresh  {}", judge(&weights, checked)?.line());
            }
            lines.push(line.clone());
            made.matrices.extend(weights.clone());
            let mut note = serde_json::json!({ "settings": settings, "log": lines });
            if let (Some(before), Some(note)) = (&before, note.as_object_mut()) {
                note.insert("from".to_owned(), before.clone());
            }
            made.made_by = serde_json::to_string(&note)?;
            log(&line, &made);
        }
    }
    if let Some(from) = from {
        keep(&mut made.matrices, &from.matrices, settings.kept as f32);
    }
    Ok(made)
}

/// The mean of weights that went on from the same ones, each on objects of its own: it knows more of other objects than any of them (Wortsman et
/// al., "Model soups", ICML 2022).
///
/// Errors: none given; weights of other names or shapes than the first.
pub fn mean(all: &[Weights]) -> Result<Weights, TrainingError> {
    let (first, others) = all.split_first().ok_or(TrainingError::NoWeights)?;
    let mut matrices = first.matrices.clone();
    for other in others {
        if let Some(name) = unlike(first, other) {
            return Err(TrainingError::Unlike { name });
        }
        matrices.iter_mut().for_each(|(name, sum)| *sum += &other.matrices[name]);
    }
    matrices.values_mut().for_each(|sum| *sum /= all.len() as f32);
    let notes: Result<Vec<serde_json::Value>, serde_json::Error> = all.iter().map(|w| serde_json::from_str(&w.made_by)).collect();
    let mut notes = notes?;
    // What they all went on from is said once.
    let before = notes[0].get("from").filter(|b| notes.iter().all(|n| n.get("from") == Some(b))).cloned();
    let mut note = serde_json::Map::new();
    if let Some(before) = before {
        notes.iter_mut().filter_map(|n| n.as_object_mut()).for_each(|n| drop(n.remove("from")));
        note.insert("from".to_owned(), before);
    }
    note.insert("mean_of".to_owned(), notes.into());
    Ok(Weights { matrices, made_by: serde_json::to_string(&note)? })
}

/// The name of a matrix that only one of two has, or in another shape.
fn unlike(a: &Weights, b: &Weights) -> Option<String> {
    let lacks = |a: &Weights, b: &Weights| {
        a.matrices.iter().find(|(name, m)| b.matrices.get(*name).is_none_or(|o| o.shape() != m.shape())).map(|(name, _)| name.clone())
    };
    lacks(a, b).or_else(|| lacks(b, a))
}

/// Weights between those that were and those that came of them. What there was not before stays as it was learned.
fn keep(learned: &mut BTreeMap<String, Matrix>, before: &BTreeMap<String, Matrix>, share: f32) {
    for (name, to) in learned {
        if let Some(known) = before.get(name).filter(|k| k.shape() == to.shape()) {
            *to = &*to * (1.0 - share) + known * share;
        }
    }
}

/// Takes over what is known. Inputs that the network did not have then come last, and begin without weight: it answers as it did.
fn widen(to: &mut Matrix, known: &Matrix) {
    if known.ncols() == to.ncols() && known.nrows() <= to.nrows() {
        to.fill(0.0);
        to.rows_mut(0, known.nrows()).copy_from(known);
    }
}

/// The loss on lessons, nothing learned.
///
/// Errors: weights that do not fit the network.
pub fn judge(weights: &BTreeMap<String, Matrix>, lessons: &[Lesson]) -> Result<Score, ModellingError> {
    let scores: Result<Vec<Score>, ModellingError> = lessons.par_iter().map(|l| learn(weights, l, true, None)).collect();
    let mut total = Score::default();
    scores?.iter().for_each(|s| total.add(s));
    Ok(total)
}
