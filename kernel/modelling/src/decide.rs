//! What the network makes of an analysis: which parts it has, and how each moves.

use nalgebra::Vector3;

use crate::ModellingError;
use crate::analysis::Analysis;
use crate::ended::Ended;
use crate::evidence;
use crate::first::First;
use crate::motion::{Motion, agree};
use crate::moves::{Moves, Moving};
use crate::network::{Network, Plain, Weights};
use crate::side::Side;

/// What was decided.
pub(crate) struct Decision {
    pub(crate) parts: Vec<Moving>,
    /// The same of the body.
    pub(crate) body_confidence: f64,
    /// Probability of the most likely part that was not taken for one.
    pub(crate) doubt: f64,
    /// Of what was taken for parts and given up since nothing says that any of it moves: the greatest probability that it does.
    pub(crate) unproven: Option<f64>,
    /// Share of points on walls along the axes of the object's box.
    pub(crate) walled: f64,
    /// Direction out of the front, in W.
    pub(crate) front: Vector3<f64>,
}

/// What was found is given up where none of it is a part that moves with this probability, still things being as usual as furniture, and no part
/// has a seam around it that is as clear as this, in standard deviations. Far less than one half: a lid or a door that is shut flush shows little.
const PROVEN: f64 = 0.2;
const SEAM: f64 = 0.25;
const PROVEN_ALONE: f64 = 0.5;

/// Beside parts that are trusted one is none that overlaps a true part by three quarters with less than this probability and is small: a strip
/// of the front beside its door, mostly. What is as large as they are may be the other leaf, shut.
const FAINT: f64 = 0.2;
/// Share of the points of the largest trusted part below which a part is small.
const SMALL: f64 = 0.5;

/// What was decided of a cloud.
pub(crate) struct Decided {
    /// The analysis that it went on from, its superpoints split where parts end.
    pub(crate) analysis: Analysis,
    /// Of each thinned point its part, 0 the body.
    pub(crate) label: Vec<Option<u32>>,
    pub(crate) decision: Decision,
}

/// Finds parts, where they end, and how they move.
pub(crate) fn decide(analyses: &[Analysis], weights: &Weights) -> Result<Decided, ModellingError> {
    let mut plain = Plain { weights: &weights.matrices };
    let first = First::of(analyses, &mut plain)?;
    let analysis = &analyses[first.index];
    let mut ended = Ended::of(&first, analysis, &mut plain)?;
    let mut network = Network::new(&mut plain);
    let trust = network.trust(std::mem::take(&mut ended.trust))?;
    let likely = |x: f32| 1.0 / (1.0 + f64::from(-x).exp());
    let confidence = |k: usize| likely(trust[k]);
    // Of each part that is left, its number among those that the heads were asked about.
    let mut kept: Vec<usize> = (0..ended.groups.len()).collect();
    let mut unproven = None;
    if !kept.is_empty() {
        let evidence = std::mem::take(&mut ended.evidence);
        let moves = network.evidence(evidence)?.iter().copied().map(likely).fold(0.0, f64::max);
        let seam = ended.groups.iter().map(|g| evidence::seam(&first.seen.side.posed, g)).fold(0.0, f64::max);
        let needed = if first.doubtful { PROVEN_ALONE } else { PROVEN };
        if moves < needed && seam < SEAM {
            unproven = Some(moves);
            kept.clear();
        } else {
            let size = |g: usize| ended.label.iter().flatten().filter(|l| **l as usize == g + 1).count() as f64;
            let trusted = |g: usize| confidence(g + 1) >= FAINT;
            let largest = kept.iter().filter(|g| trusted(**g)).map(|g| size(*g)).fold(0.0, f64::max);
            kept.retain(|g| trusted(*g) || size(*g) >= SMALL * largest);
        }
    }
    ended.keep(&kept);
    let side = Side::new(&ended.fine, first.seen.quarter);
    let mut moves = Moves::of(&first, analysis, &ended, &side, &mut network)?;
    moves.place(&ended, &side, &mut network)?;
    let mut parts = moves.parts;
    for (part, g) in parts.iter_mut().zip(kept) {
        part.confidence = confidence(g + 1);
    }
    let mut drawers: Vec<&mut Motion> =
        parts.iter_mut().filter_map(|p: &mut Moving| p.motions.first_mut()).filter(|m| m.front.is_some()).collect();
    agree(&mut drawers);
    let body_confidence = unproven.map_or_else(|| confidence(0), |moves| 1.0 - moves);
    let decision = Decision { parts, body_confidence, doubt: first.doubt, unproven, walled: first.walled, front: side.front() };
    drop(side);
    Ok(Decided { analysis: ended.fine, label: ended.label, decision })
}
