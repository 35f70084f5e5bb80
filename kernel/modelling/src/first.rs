//! What is thought of superpoints: which side is the front, which class each is, and which groups of them are parts.

use crate::ModellingError;
use crate::analysis::Analysis;
use crate::border::{Asked, Thought, ask, first_labels, relabelled};
use crate::candidate::Candidate;
use crate::feature::{CANDIDATES, touching};
use crate::grouping::Odds;
use crate::mask::{self, Known, MASK, chosen, rectangles};
use crate::network::{CLASSES, GROUP, Matrix, Network, Plain, Trunk, WIDTH, softmax_rows};
use crate::side::Side;
use crate::trust::{Expected, expected};

/// Pieces that are the body with less than this probability may be a part's, or be one: which groups are, is asked of each as a whole.
const STILL: f32 = 0.85;

/// Furniture is made of walls, however its doors stand: where fewer points than this share lie on any, the network is not asked about
/// parts. It has learned from furniture alone, and would see panels in a ball. Of the furniture that is trained on none has less than .82.
pub(crate) const WALLED: f64 = 0.7;

/// Of a thing no group of which promises to be a part the likeliest is asked about all the same, for its seam, which groups are not asked about.
/// What it promises for both overlaps is more than the first of these, and it moves rather than not.
const HARDLY: f64 = 0.1;

/// An object seen from one side and in a mirror: what is told of a thing and of its mirror image ought to agree, so the mean is taken.
pub(crate) struct Seen<'a> {
    pub(crate) quarter: usize,
    pub(crate) side: Side<'a>,
    pub(crate) trunks: [Trunk<Matrix>; 2],
}

impl Seen<'_> {
    fn classes(&self, network: &mut Network<'_, Plain<'_>>) -> Result<Matrix, ModellingError> {
        let [mut a, mut b] = [network.classes(&self.trunks[0])?, network.classes(&self.trunks[1])?];
        softmax_rows(&mut a);
        softmax_rows(&mut b);
        Ok((a + b) * 0.5)
    }

    fn same_part(&self, network: &mut Network<'_, Plain<'_>>, n: usize, pairs: &[(usize, usize)]) -> Result<Matrix, ModellingError> {
        Ok((network.same_part(&self.trunks[0], n, pairs)? + network.same_part(&self.trunks[1], n, pairs)?) * 0.5)
    }

    /// The candidates of parts, and what the network says of each. `groups` are the superpoints that the network was shown; `sides` shows
    /// the object and its mirror image, where the parts are `pieces`.
    fn joints(
        &self,
        network: &mut Network<'_, Plain<'_>>,
        n: usize,
        groups: &[Vec<usize>],
        sides: [&Side<'_>; 2],
        pieces: &[Vec<usize>],
    ) -> Result<(Vec<Vec<Candidate>>, Matrix), ModellingError> {
        let [options, mirrored] = sides.map(|s| s.options(pieces));
        let mut out = network.joints(&self.trunks[0], n, groups, options.rows())?;
        let other = network.joints(&self.trunks[1], n, groups, mirrored.rows())?;
        for (g, (own, image)) in options.parts.iter().zip(&mirrored.parts).enumerate() {
            for (c, candidate) in own.iter().enumerate() {
                let Some(k) = candidate.image(image) else { continue };
                for column in 0..out.ncols() {
                    // What lies across the section turns round.
                    let sign = if column == 2 { candidate.across_sign(&image[k]) } else { 1.0 };
                    let at = (g * CANDIDATES + c, column);
                    out[at] = 0.5 * (out[at] + sign * other[(g * CANDIDATES + k, column)]);
                }
            }
        }
        Ok((options.parts, out))
    }

    /// The same where points have been asked about: `side` shows the superpoints split, and `pieces` are the parts there. Where a part's points
    /// end says where its hinge is. At which end it hangs was learned from whole superpoints, and is asked of these.
    pub(crate) fn ended(
        &self,
        network: &mut Network<'_, Plain<'_>>,
        whole: &Analysis,
        groups: &[Vec<usize>],
        side: &Side<'_>,
        pieces: &[Vec<usize>],
    ) -> Result<(Vec<Vec<Candidate>>, Matrix), ModellingError> {
        let n = whole.superpoints.len();
        let mirror = Side::new(side.posed.analysis, self.quarter).mirrored();
        let (candidates, mut out) = self.joints(network, n, groups, [side, &mirror], pieces)?;
        let mirror = Side::new(whole, self.quarter).mirrored();
        let (known, scores) = self.joints(network, n, groups, [&self.side, &mirror], groups)?;
        for (g, own) in candidates.iter().enumerate() {
            for (c, candidate) in own.iter().enumerate() {
                if let Some(k) = candidate.alike(&known[g]) {
                    out[(g * CANDIDATES + c, 0)] = scores[(g * CANDIDATES + k, 0)];
                }
            }
        }
        Ok((candidates, out))
    }
}

/// What is thought of superpoints, before points are asked about one by one.
pub(crate) struct First<'a> {
    pub(crate) index: usize,
    pub(crate) seen: Seen<'a>,
    pub(crate) classes: Matrix,
    pub(crate) walled: f64,
    pub(crate) doubt: f64,
    pub(crate) odds: Odds,
    /// Groups of superpoints of which each may be a part.
    pub(crate) nodes: Vec<Vec<usize>>,
    /// Parts, each by its superpoints, and how likely it overlaps a true part by half and by three quarters.
    pub(crate) groups: Vec<Vec<usize>>,
    pub(crate) promises: Vec<[f64; 2]>,
    /// Did none promise enough, so that the likeliest is the only one?
    pub(crate) doubtful: bool,
}

/// Points of each superpoint.
pub(crate) fn sizes(analysis: &Analysis) -> Vec<f64> {
    analysis.superpoints.iter().map(|s| s.points.len() as f64).collect()
}

impl<'a> First<'a> {
    /// Asks the network about all sides at all yaws, and about the front in full: all but which groups are parts.
    pub(crate) fn asked(analyses: &'a [Analysis], plain: &mut Plain<'_>) -> Result<Self, ModellingError> {
        let mut best: Option<(f32, usize, Seen<'_>)> = None;
        for (index, analysis) in analyses.iter().enumerate() {
            let n = analysis.superpoints.len();
            let touching = touching(analysis);
            for quarter in 0..4 {
                let side = Side::new(analysis, quarter);
                let mirror = Side::new(analysis, quarter).mirrored();
                let mut network = Network::new(plain);
                let mut trunk = |s: &Side<'_>| {
                    let f = s.features(&touching);
                    network.trunk(f.pieces, f.points, f.pairs)
                };
                let trunks = [trunk(&side)?, trunk(&mirror)?];
                let score = network.front(&trunks[0], n)?[0] + network.front(&trunks[1], n)?[0];
                if best.as_ref().is_none_or(|b| score > b.0) {
                    best = Some((score, index, Seen { quarter, side, trunks }));
                }
            }
        }
        let Some((_, index, seen)) = best else {
            return Err(ModellingError::TooFew { finite: 0, total: 0, least: crate::prepare::LEAST });
        };
        let analysis = &analyses[index];
        let n = analysis.superpoints.len();
        let mut network = Network::new(plain);
        let classes = seen.classes(&mut network)?;
        let walled = analysis.walled();
        let moving: Vec<usize> = (0..n).filter(|i| walled >= WALLED && classes[(*i, 0)] < STILL).collect();
        let doubt = (0..n).filter(|i| classes[(*i, 0)] >= STILL).map(|i| 1.0 - f64::from(classes[(i, 0)])).fold(0.0, f64::max);
        let points = sizes(analysis);
        let odds = Odds::asked(n, |pairs| seen.same_part(&mut network, n, pairs))?;
        let mut nodes = odds.tree(&moving, &points);
        if walled >= WALLED {
            let still: Vec<f64> = (0..n).map(|i| f64::from(classes[(i, 0)])).collect();
            nodes.iter_mut().for_each(|g| g.sort_unstable());
            for group in rectangles(&seen.side.posed, &still) {
                if !nodes.contains(&group) {
                    nodes.push(group);
                }
            }
        }
        let size = |g: &Vec<usize>| g.iter().map(|i| analysis.superpoints[*i].points.len()).sum();
        nodes.retain(|g| enough(size(g), analysis.points.len()));
        Ok(Self { index, seen, classes, walled, doubt, odds, nodes, groups: Vec::new(), promises: Vec::new(), doubtful: false })
    }

    /// With the groups that are parts.
    pub(crate) fn of(analyses: &'a [Analysis], plain: &mut Plain<'_>) -> Result<Self, ModellingError> {
        let mut first = Self::asked(analyses, plain)?;
        let analysis = &analyses[first.index];
        if first.nodes.is_empty() {
            return Ok(first);
        }
        let (rows, relations) = first.rows(analysis);
        let odds = Network::new(plain).masks(rows, relations)?;
        let likely = |x: f32| 1.0 / (1.0 + f64::from(-x).exp());
        let promises: Vec<[f64; 2]> = (0..first.nodes.len()).map(|k| [0, 1].map(|c| likely(odds[(k, c)]))).collect();
        let mut taken = chosen(&first.nodes, &promises);
        if taken.is_empty() {
            let sum = |k: &usize| promises[*k][0] + promises[*k][1];
            taken.extend((0..promises.len()).filter(|k| sum(k) > HARDLY).max_by(|a, b| sum(a).total_cmp(&sum(b))));
            first.doubtful = true;
        }
        for k in taken {
            first.groups.push(first.nodes[k].clone());
            first.promises.push(promises[k]);
        }
        Ok(first)
    }

    /// What is asked about groups, and how they share points.
    pub(crate) fn rows(&self, analysis: &Analysis) -> (Matrix, Matrix) {
        let points = sizes(analysis);
        let known = Known { odds: &self.odds, classes: &self.classes, points: &points };
        let told = mask::rows(&self.seen.side.posed, &self.nodes, &known);
        let [own, image] = &self.seen.trunks;
        let states = mask::states(&self.nodes, &points, &((&own.state + &image.state) * 0.5));
        let mut rows = Matrix::zeros(self.nodes.len(), GROUP);
        rows.columns_mut(0, MASK).copy_from(&told);
        rows.columns_mut(MASK, WIDTH).copy_from(&states);
        (rows, mask::relations(&self.nodes, &points))
    }

    /// What is thought of the parts.
    fn thought(&self, points: &[f64]) -> Vec<Thought> {
        let thought = |g: &Vec<usize>| Thought {
            pieces: g.clone(),
            classes: shares(&self.classes, g, points),
            together: (0..points.len()).map(|i| self.odds.together(g, i, points).unwrap_or(0.0)).collect(),
        };
        self.groups.iter().map(thought).collect()
    }

    /// Asks about the points near the parts.
    pub(crate) fn ask(&self, analysis: &Analysis) -> (Vec<Option<u32>>, Asked) {
        let points = sizes(analysis);
        let label = first_labels(analysis, &self.groups);
        let asked = ask(&self.seen.side.posed, &label, &self.still(), &self.thought(&points));
        (label, asked)
    }

    /// Of each superpoint the probability to be the body.
    pub(crate) fn still(&self) -> Vec<f64> {
        (0..self.classes.nrows()).map(|i| f64::from(self.classes[(i, 0)])).collect()
    }

    /// The part of each point, after points near parts were asked about.
    pub(crate) fn label(&self, analysis: &Analysis, plain: &mut Plain<'_>) -> Result<(Vec<Option<u32>>, Expected), ModellingError> {
        let (before, asked) = self.ask(analysis);
        if asked.of.is_empty() {
            let expected = expected(&before, &before, &asked, &[], self.groups.len());
            return Ok((before, expected));
        }
        let odds = Network::new(plain).border(asked.rows.clone())?;
        let after = relabelled(&before, &asked, odds.as_slice());
        let expected = expected(&before, &after, &asked, odds.as_slice(), self.groups.len());
        Ok((after, expected))
    }
}

/// Are these points enough to be a part, of so many?
pub(crate) fn enough(points: usize, total: usize) -> bool {
    points >= 20 && points * 1000 >= 3 * total
}

/// The classes of some superpoints together.
pub(crate) fn shares(classes: &Matrix, pieces: &[usize], points: &[f64]) -> [f64; CLASSES] {
    let mut share = [0.0; CLASSES];
    let total: f64 = pieces.iter().map(|i| points[*i]).sum();
    for i in pieces {
        share.iter_mut().enumerate().for_each(|(k, s)| *s += points[*i] * f64::from(classes[(*i, k)]));
    }
    share.map(|s| s / total.max(1.0))
}
