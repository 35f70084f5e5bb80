//! How parts move: what the network says of all joints that each could have, and where it says that hinges are.

use nalgebra::Vector3;

use crate::ModellingError;
use crate::analysis::Analysis;
use crate::candidate::{Candidate, FARTHEST};
use crate::ended::Ended;
use crate::feature::CANDIDATES;
use crate::first::First;
use crate::handle::{Handle, handle};
use crate::motion::{Motion, Still};
use crate::network::{CLASSES, Matrix, Network, Plain, softmax_rows};
use crate::place::{self, Hinge};
use crate::posed::Posed;
use crate::side::Side;

/// How far a motion may be believed that does not go with what the part seems to be.
const DOUBT: f64 = 0.1;

/// A hinge that is less likely than this is not asked about once more.
const SELDOM: f64 = 0.02;

/// Classes in the order of the network's outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PartClass {
    /// What stands still.
    Body,
    /// A panel on an upright hinge, or one that slides sideways.
    Door,
    /// A front with a box behind it.
    Drawer,
    /// A panel on top, hinged at an edge.
    Lid,
    /// A panel on a level hinge that stands upright when shut.
    Flap,
}

impl PartClass {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Body => "body",
            Self::Door => "door",
            Self::Drawer => "drawer",
            Self::Lid => "lid",
            Self::Flap => "flap",
        }
    }
}

/// A part that moves.
#[derive(Debug, Clone)]
pub(crate) struct Moving {
    pub(crate) class: PartClass,
    /// How likely its points overlap a true part's by three quarters.
    pub(crate) confidence: f64,
    /// Its superpoints.
    pub(crate) pieces: Vec<usize>,
    /// Fixed, revolute, prismatic.
    pub(crate) probabilities: [f64; 3],
    /// Ways to move, most likely first.
    pub(crate) motions: Vec<Motion>,
    /// Standard deviation of the axis, rad, and of its place, m.
    pub(crate) uncertainty: [f64; 2],
    /// What a hand can take hold of. In W.
    pub(crate) handle: Option<Handle>,
}

/// How parts move, as far as the network says that of all candidates.
pub(crate) struct Moves {
    pub(crate) parts: Vec<Moving>,
    candidates: Vec<Vec<Candidate>>,
    /// Of each part [`CANDIDATES`] rows: a score and where the hinge is.
    out: Matrix,
}

impl Moves {
    /// `side` shows the superpoints split where parts end.
    pub(crate) fn of(
        first: &First<'_>,
        whole: &Analysis,
        ended: &Ended,
        side: &Side<'_>,
        network: &mut Network<'_, Plain<'_>>,
    ) -> Result<Self, ModellingError> {
        if ended.groups.is_empty() {
            return Ok(Self { parts: Vec::new(), candidates: Vec::new(), out: Matrix::zeros(0, 0) });
        }
        let (candidates, out) = first.seen.ended(network, whole, &ended.groups, side, &ended.pieces)?;
        let still = Still::of(&side.posed, &ended.label);
        let part = |k: usize| {
            let asked = (ended.share[k], 1.0 - ended.promise[k]);
            moving_part(&still, asked, &ended.pieces[k], &candidates[k], &out, k * CANDIDATES)
        };
        Ok(Self { parts: (0..ended.groups.len()).map(part).collect(), candidates, out })
    }

    /// Hinges that parts may have, each with the numbers of its part and of the motion there.
    pub(crate) fn hinges(&self, ended: &Ended, side: &Side<'_>) -> Vec<(usize, usize, Hinge<'_>)> {
        let mut out = Vec::new();
        for (k, part) in self.parts.iter().enumerate() {
            let turns = |(m, motion): &(usize, &Motion)| !motion.slides && (*m == 0 || motion.probability > SELDOM);
            for (m, motion) in part.motions.iter().enumerate().filter(turns) {
                let hinge = Hinge {
                    candidate: &self.candidates[k][motion.candidate],
                    residual: residual(&self.out, k * CANDIDATES + motion.candidate),
                    axis: side.posed.of_world(&motion.axis),
                    state: motion.state,
                    probability: motion.probability,
                    label: k as u32 + 1,
                    classes: ended.share[k],
                };
                out.push((k, m, hinge));
            }
        }
        out
    }

    /// Asks once more where hinges are, now that it is known which points are whose.
    pub(crate) fn place(&mut self, ended: &Ended, side: &Side<'_>, network: &mut Network<'_, Plain<'_>>) -> Result<(), ModellingError> {
        let R_WK = (side.posed.R_KA * side.posed.analysis.R_AW).inverse();
        let hinges = self.hinges(ended, side);
        if hinges.is_empty() {
            return Ok(());
        }
        let of: Vec<(usize, usize)> = hinges.iter().map(|h| (h.0, h.1)).collect();
        let hinges: Vec<Hinge<'_>> = hinges.into_iter().map(|h| h.2).collect();
        let answers = network.place(place::rows(&side.posed, &ended.label, &hinges))?;
        let answered = |(row, hinge): (usize, &Hinge<'_>)| {
            let answers: Vec<f32> = answers.row(row).iter().copied().collect();
            let (moved, deviation) = hinge.placed(&answers);
            (R_WK * moved, deviation)
        };
        let placed: Vec<(Vector3<f64>, f64)> = hinges.iter().enumerate().map(answered).collect();
        for ((k, m), (moved, deviation)) in of.into_iter().zip(placed) {
            let part = &mut self.parts[k];
            part.motions[m].origin += moved;
            if m == 0 {
                part.uncertainty[1] = part.uncertainty[1].max(deviation);
            }
        }
        Ok(())
    }
}

/// Where the network says that a candidate's hinge is.
fn residual(out: &Matrix, row: usize) -> [f64; 2] {
    [1, 2].map(|k| f64::from(out[(row, k)]).clamp(-FARTHEST, FARTHEST))
}

/// `share` is what was said of its pieces one by one, `fixed` how likely it is none, which is asked of it as a whole.
fn moving_part(
    still: &Still<'_>,
    (share, fixed): ([f64; CLASSES], f64),
    pieces: &[usize],
    candidates: &[Candidate],
    out: &Matrix,
    row: usize,
) -> Moving {
    let lid = share[3] > share[4];
    let mut p = Matrix::from_fn(1, CANDIDATES, |_, c| out[(row + c, 0)]);
    softmax_rows(&mut p);
    // What a part is and how it moves are two answers to one question; each has seen what the other has not.
    let moves = (1.0 - share[0]).max(1e-6);
    for (c, candidate) in candidates.iter().enumerate() {
        let level = candidate.axis.z.abs() < 0.5;
        let fits = match (candidate.slides, level) {
            (true, _) if candidate.axis.x.abs() > 0.5 => share[2],
            (true, _) => share[1],
            (false, false) => share[1],
            (false, true) if candidate.axis.y.abs() > 0.5 => share[3] + share[4],
            (false, true) => share[3],
        };
        p[c] *= (DOUBT + fits / moves) as f32;
    }
    let sum = p.sum().max(1e-9);
    p /= sum;
    let slides: f64 = candidates.iter().zip(p.iter()).filter(|(c, _)| c.slides).map(|(_, p)| f64::from(*p)).sum();
    let mut motions: Vec<Motion> = candidates
        .iter()
        .enumerate()
        .map(|(c, candidate)| still.motion(pieces, candidate, residual(out, row + c), f64::from(p[c]) * (1.0 - fixed), lid))
        .collect();
    motions.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    // The type first, then the best of that type.
    let slides_more = slides > 0.5;
    if let Some(first) = motions.iter().position(|m| m.slides == slides_more) {
        let chosen = motions.remove(first);
        motions.insert(0, chosen);
    }
    let sure = motions.first().map_or(0.0, |m| m.probability);
    Moving {
        class: motions.first().map_or(PartClass::Door, |m| class(still.posed, m, lid)),
        confidence: (1.0 - fixed).clamp(0.0, 1.0),
        pieces: pieces.to_vec(),
        probabilities: [fixed, (1.0 - fixed) * (1.0 - slides), (1.0 - fixed) * slides],
        motions,
        uncertainty: [0.02 + 0.3 * (1.0 - sure), 0.01 + 0.1 * (1.0 - sure)],
        handle: handle(still.posed, pieces).map(|h| {
            let R_WK = (still.posed.R_KA * still.posed.analysis.R_AW).inverse();
            Handle { from: R_WK * h.from, to: R_WK * h.to, outward: R_WK * h.outward, ..h }
        }),
    }
}

/// What a part is that moves so: the two never contradict each other.
fn class(posed: &Posed<'_>, motion: &Motion, lid: bool) -> PartClass {
    let axis = posed.of_world(&motion.axis);
    match (motion.slides, axis.iamax()) {
        (true, 0) => PartClass::Drawer,
        (true, _) | (false, 2) => PartClass::Door,
        (false, 0) => PartClass::Lid,
        (false, _) => {
            if lid {
                PartClass::Lid
            } else {
                PartClass::Flap
            }
        }
    }
}
