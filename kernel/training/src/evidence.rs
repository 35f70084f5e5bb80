//! Teaches what says that a part moves, on parts as all networks before make them of blocks and of furniture. Those stay as they are.
//!
//! More than half of the things do not move, and most of the furniture is shut: what stands wide open needs no proof. Others sample meshes, so some
//! things are spread evenly over what is seen, blocks and furniture alike: else an even cloud would itself be the proof.

use rayon::prelude::*;
use sagci_furniture::{Category, Even, Family, Labelled, Look, Noise, Object, Random, STILL, evenly, families, look};
use sagci_modelling::network::Weights;
use sagci_modelling::{EVIDENCE, Ends};

use crate::head::{Head, Lessons, Rows, entropy, more_than, overlaps, train_head};
use crate::{Settings, TrainingError};

/// Parts a step, for each object of a batch.
const PARTS: usize = 2;
/// The overlap with a true part that is asked about.
const ENOUGH: f64 = 0.5;
/// Shares of things that do not move, of furniture that is shut, of things that are sampled evenly, and gone around.
const STANDS: f64 = 0.6;
const SHUT: f64 = 0.7;
const EVENLY: f64 = 0.4;
const AROUND: f64 = 0.15;
/// Share of perfect cameras.
const PERFECT: f64 = 0.1;

/// The thing of an index, and what is seen of it.
fn drawn(seed: u64, index: u64) -> (Object, Labelled) {
    let random = &mut Random::new(seed.wrapping_mul(1_000_003).wrapping_add(index), "evidence");
    let of: Vec<&Family> = match random.chance(STANDS) {
        true => STILL.iter().filter(|f| !f.held_out).collect(),
        false => families(random.pick(Category::ALL), false),
    };
    // Blocks are taken for furniture most.
    let often = of.iter().flat_map(|f| std::iter::repeat_n(*f, if f.name == "crate_or_block" { 4 } else { f.weight }));
    let often: Vec<&Family> = often.collect();
    let mut object = often[random.index(often.len())].draw(random);
    if random.chance(SHUT) {
        object.joints.iter_mut().for_each(|j| j.state = 0.0);
    }
    if random.chance(0.12) {
        object = object.scaled(random.scale(0.25, 0.9));
    }
    let cloud = if random.chance(EVENLY) {
        evenly(&object, &Even::draw(random), random)
    } else {
        let mut how = if random.chance(AROUND) { Look::around(random) } else { Look::draw(random) };
        if random.chance(PERFECT) {
            how.noise = Noise::NONE;
        }
        look(&object, &how, random)
    };
    (object, cloud)
}

/// What a thing teaches.
fn parts(seed: u64, index: u64, weights: &Weights) -> Rows<EVIDENCE, [f32; 1]> {
    let mut out = Rows::default();
    let (object, cloud) = drawn(seed, index);
    let Ok(asked) = Ends::of(&cloud.points, weights) else { return out };
    let (parts, found) = (object.parts.len(), asked.evidence.nrows());
    let overlaps = overlaps(&cloud.part, parts, &asked.label_of_input, found + 1);
    for (row, overlaps) in asked.evidence.row_iter().zip(overlaps.iter().skip(1)) {
        out.features.extend(row.iter());
        out.answers.push([more_than(ENOUGH, overlaps.iter().skip(1).copied().fold(0.0, f64::max))]);
    }
    out
}

/// Trains the head anew, beside weights that stay; `log` is told of every epoch. The last tenth of the parts is only looked at.
///
/// Errors: nothing to learn from; weights that do not fit.
pub fn train_evidence(settings: &Settings, from: &Weights, log: &mut dyn FnMut(&str)) -> Result<Weights, TrainingError> {
    let taught = (0..settings.objects).into_par_iter().map(|i| parts(settings.seed, i, from)).collect();
    train_head(&Lessons::plain(Head::Evidence, entropy, PARTS), settings, taught, from, log)
}
