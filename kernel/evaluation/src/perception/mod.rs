//! Judges whoever makes models of unseen objects from clouds: draws furniture of families that no training saw, looks at it, asks a
//! function that sees the points alone, and scores what comes back.
//!
//! The protocol: a part is found where a predicted mask overlaps its own by an intersection over union of one half. Average
//! precision pools the masks of a category by their confidence. Errors of axes are over found parts, those of places over found parts that
//! turn. End to end counts every true moving part: found, of the right type, less than 5 degrees and 5 cm off; a miss is a failure. Overall
//! is the mean of the six categories, as in the paper.

mod figures;
mod maker;
mod score;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use sagci_furniture::{Category, Labelled, Look, Object, Random, families, look};
use sagci_model::ObjectModel;

pub use figures::{PerceptionRow, PerceptionTable};
pub use score::{AnsweredJoint, CloudAnswer};

/// What to draw.
#[derive(Debug, Clone)]
pub struct PerceptionOptions {
    /// Everything is drawn from it.
    pub seed: u64,
    /// Objects of each category.
    pub objects: usize,
    /// Only these categories' objects, by a prefix of their name.
    pub only: String,
    /// Of the families that training saw, instead of the held-out ones.
    pub trained: bool,
    /// Models of other makers, to be seen by the same camera.
    pub makers: Vec<ObjectModel>,
}

/// One cloud to be modelled, with its truth.
pub struct Case {
    /// Its name: category, family and number.
    pub name: String,
    /// What is true.
    pub object: Object,
    /// What is seen.
    pub cloud: Labelled,
}

/// Draws a case.
pub fn case(options: &PerceptionOptions, category: Category, number: usize) -> Case {
    let mut random = Random::new(options.seed.wrapping_mul(7919).wrapping_add(number as u64), category.name());
    let of = families(category, !options.trained);
    let family = of[number % of.len().max(1)];
    loop {
        let object = family.draw(&mut random);
        let how = Look::draw(&mut random);
        let cloud = look(&object, &how, &mut random);
        // A view that saw next to nothing of the object is no case.
        if cloud.part.iter().filter(|p| **p >= 0).count() >= 1000 {
            return Case { name: format!("{}/{}/{number}", category.name(), family.name), object, cloud };
        }
    }
}

/// Asks for a model of every object, several at a time, and scores the answers. `told` hears a line about each.
pub fn judge_perception(
    options: &PerceptionOptions,
    model: &(dyn Fn(&[Point3<f64>]) -> Result<CloudAnswer, String> + Sync),
    told: &(dyn Fn(&str) + Sync),
) -> PerceptionTable {
    let asked: Vec<(Category, usize)> = Category::ALL
        .into_iter()
        .filter(|c| c.name().starts_with(&options.only))
        .flat_map(|c| (0..options.objects).map(move |n| (c, n)))
        .collect();
    let answered = |case: Case| {
        let start = std::time::Instant::now();
        let answer = model(&case.cloud.points);
        let seconds = start.elapsed().as_secs_f64();
        let scored = score::score(&case, answer, seconds);
        told(&scored.line);
        scored
    };
    let scored: Vec<score::Scored> = asked.into_par_iter().map(|(category, number)| answered(case(options, category, number))).collect();
    let makers: Vec<(String, Vec<score::Scored>)> = options
        .makers
        .iter()
        .filter_map(|m| maker::Made::new(m).map(|made| (m.name.clone(), made)))
        .map(|(name, made)| (name, (0..options.objects).into_par_iter().map(|n| answered(made.case(options.seed, n))).collect()))
        .collect();
    figures::table(options, &scored, &makers)
}

/// Angle between two lines, rad.
pub(crate) fn angle(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    (a.dot(b).abs() / (a.norm() * b.norm()).max(1e-12)).min(1.0).acos()
}

#[cfg(test)]
mod tests;
