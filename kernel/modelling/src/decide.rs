//! What the network makes of an analysis: which side is the front, which superpoints are one part, and how each part moves.

use nalgebra::{Point3, Vector3};

use crate::ModellingError;
use crate::analysis::{Analysis, analyse};
use crate::border::{Asked, Thought, ask, first_labels, relabelled, split};
use crate::candidate::{Candidate, FARTHEST};
use crate::evidence;
use crate::feature::{CANDIDATES, touching};
use crate::grouping::Odds;
use crate::handle::{Handle, handle};
use crate::mask::{self, Known, MASK, chosen, rectangles};
use crate::motion::{Motion, Still, agree};
use crate::network::{CLASSES, GROUP, Matrix, Network, Plain, Trunk, WIDTH, Weights, softmax_rows};
use crate::place::{self, Hinge};
use crate::posed::Posed;
use crate::side::Side;
use crate::trust::{self, Expected, Trusted, expected};

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

/// Pieces that are the body with less than this probability may be a part's, or be one: which groups are, is asked of each as a whole.
const STILL: f32 = 0.85;
/// How far a motion may be believed that does not go with what the part seems to be.
const DOUBT: f64 = 0.1;

/// Furniture is made of walls, however its doors stand: where fewer points than this share lie on any, the network is not asked about
/// parts. It has learned from furniture alone, and would see panels in a ball. Of the furniture that is trained on none has less than .82.
pub(crate) const WALLED: f64 = 0.7;

/// What was found is given up where none of it is a part that moves with this probability, still things being as usual as furniture, and no part
/// has a seam around it that is as clear as this, in standard deviations. Far less than one half: a lid or a door that is shut flush shows little.
const PROVEN: f64 = 0.2;
const SEAM: f64 = 0.25;

/// Of a thing no group of which promises to be a part the likeliest is asked about all the same, for its seam, which groups are not asked about.
/// What it promises for both overlaps is more than the first of these, and it moves rather than not.
const HARDLY: f64 = 0.1;
const PROVEN_ALONE: f64 = 0.5;

/// Beside parts that are trusted one is none that overlaps a true part by three quarters with less than this probability and is small: a strip
/// of the front beside its door, mostly. What is as large as they are may be the other leaf, shut.
const FAINT: f64 = 0.2;
/// Share of the points of the largest trusted part below which a part is small.
const SMALL: f64 = 0.5;

/// A hinge that is less likely than this is not asked about once more.
const SELDOM: f64 = 0.02;

/// An object seen from one side and in a mirror: what is told of a thing and of its mirror image ought to agree, so the mean is taken.
struct Seen<'a> {
    quarter: usize,
    side: Side<'a>,
    trunks: [Trunk<Matrix>; 2],
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
    fn ended(
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
struct First<'a> {
    index: usize,
    seen: Seen<'a>,
    classes: Matrix,
    walled: f64,
    doubt: f64,
    odds: Odds,
    /// Groups of superpoints of which each may be a part.
    nodes: Vec<Vec<usize>>,
    /// Parts, each by its superpoints, and how likely it overlaps a true part by half and by three quarters.
    groups: Vec<Vec<usize>>,
    promises: Vec<[f64; 2]>,
    /// Did none promise enough, so that the likeliest is the only one?
    doubtful: bool,
}

/// Points of each superpoint.
fn sizes(analysis: &Analysis) -> Vec<f64> {
    analysis.superpoints.iter().map(|s| s.points.len() as f64).collect()
}

impl<'a> First<'a> {
    /// Asks the network about all sides at all yaws, and about the front in full: all but which groups are parts.
    fn asked(analyses: &'a [Analysis], plain: &mut Plain<'_>) -> Result<Self, ModellingError> {
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
    fn of(analyses: &'a [Analysis], plain: &mut Plain<'_>) -> Result<Self, ModellingError> {
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
    fn rows(&self, analysis: &Analysis) -> (Matrix, Matrix) {
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
    fn ask(&self, analysis: &Analysis) -> (Vec<Option<u32>>, Asked) {
        let points = sizes(analysis);
        let label = first_labels(analysis, &self.groups);
        let asked = ask(&self.seen.side.posed, &label, &self.still(), &self.thought(&points));
        (label, asked)
    }

    /// Of each superpoint the probability to be the body.
    fn still(&self) -> Vec<f64> {
        (0..self.classes.nrows()).map(|i| f64::from(self.classes[(i, 0)])).collect()
    }

    /// The part of each point, after points near parts were asked about.
    fn label(&self, analysis: &Analysis, plain: &mut Plain<'_>) -> Result<(Vec<Option<u32>>, Expected), ModellingError> {
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
fn enough(points: usize, total: usize) -> bool {
    points >= 20 && points * 1000 >= 3 * total
}

/// The classes of some superpoints together.
fn shares(classes: &Matrix, pieces: &[usize], points: &[f64]) -> [f64; CLASSES] {
    let mut share = [0.0; CLASSES];
    let total: f64 = pieces.iter().map(|i| points[*i]).sum();
    for i in pieces {
        share.iter_mut().enumerate().for_each(|(k, s)| *s += points[*i] * f64::from(classes[(*i, k)]));
    }
    share.map(|s| s / total.max(1.0))
}

/// What is asked about the points of a cloud, for training.
pub struct Borders {
    /// One row of features a question.
    pub rows: Matrix,
    /// The thinned point and the part that each row asks about.
    pub of: Vec<(u32, u32)>,
    /// Is there any doubt about it?
    pub doubtful: Vec<bool>,
    /// Of each input point the thinned point that stands for it.
    pub of_input: Vec<Option<u32>>,
    /// The first label of each thinned point: 0 the body, then the parts.
    pub label: Vec<Option<u32>>,
    /// How many parts there are.
    pub parts: usize,
}

impl Borders {
    /// Finds parts, and asks about the points near them.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        let analyses = analyse(cloud)?;
        let first = First::of(&analyses, &mut Plain { weights: &weights.matrices })?;
        let analysis = &analyses[first.index];
        let (label, asked) = first.ask(analysis);
        Ok(Self {
            rows: asked.rows,
            of: asked.of,
            doubtful: asked.doubtful,
            of_input: analysis.of_input.clone(),
            label,
            parts: first.groups.len(),
        })
    }
}

/// Groups of superpoints that may be parts, and what is asked about them, for training.
pub struct Groups {
    /// One row of [`crate::network::GROUP`] features a group.
    pub rows: Matrix,
    /// How each two of them share points: row `i n + j`.
    pub relations: Matrix,
    /// The superpoints of each.
    pub of: Vec<Vec<usize>>,
    /// Of each input point its superpoint.
    pub piece_of_input: Vec<Option<u32>>,
}

impl Groups {
    /// Of a cloud.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        let analyses = analyse(cloud)?;
        let first = First::asked(&analyses, &mut Plain { weights: &weights.matrices })?;
        let analysis = &analyses[first.index];
        let (rows, relations) = first.rows(analysis);
        Ok(Self { rows, relations, of: first.nodes, piece_of_input: analysis.piece_of_input() })
    }
}

/// Parts whose points are known.
struct Ended {
    /// The analysis, its superpoints split where parts end.
    fine: Analysis,
    /// Of each part that is left its superpoints before they were split, and after, and its classes.
    groups: Vec<Vec<usize>>,
    pieces: Vec<Vec<usize>>,
    share: Vec<[f64; CLASSES]>,
    /// How likely each overlaps a true part by half.
    promise: Vec<f64>,
    /// Of each point its part, 0 the body.
    label: Vec<Option<u32>>,
    /// What is asked about the body and the parts, how far they are to be trusted.
    trust: Matrix,
    /// What is asked about the parts, whether anything says that they move.
    evidence: Matrix,
}

impl Ended {
    fn of(first: &First<'_>, analysis: &Analysis, plain: &mut Plain<'_>) -> Result<Self, ModellingError> {
        let (mut label, expected) = first.label(analysis, plain)?;
        let mut counts = vec![0; first.groups.len() + 1];
        label.iter().flatten().for_each(|l| counts[*l as usize] += 1);
        // A part that is left with next to nothing is none. The larger ones first: names count from there.
        let mut kept: Vec<usize> = (0..first.groups.len()).filter(|g| enough(counts[g + 1], analysis.points.len())).collect();
        kept.sort_by_key(|g| std::cmp::Reverse(counts[g + 1]));
        let number = |l: u32| kept.iter().position(|g| *g as u32 + 1 == l).map_or(0, |k| k as u32 + 1);
        label.iter_mut().flatten().for_each(|l| *l = number(*l));
        let groups: Vec<Vec<usize>> = kept.iter().map(|g| first.groups[*g].clone()).collect();
        let (fine, pieces) = split(analysis, &label, groups.len());
        let points = sizes(analysis);
        let share: Vec<[f64; CLASSES]> = groups.iter().map(|own| shares(&first.classes, own, &points)).collect();
        let promise = kept.iter().map(|g| first.promises[*g][0]).collect();
        let trust = trusted(first, analysis, &kept, &label, &expected);
        let promises: Vec<[f64; 2]> = kept.iter().map(|g| first.promises[*g]).collect();
        let known = Known { odds: &first.odds, classes: &first.classes, points: &points };
        let evidence = evidence::rows(&first.seen.side.posed, &groups, &promises, &known);
        Ok(Self { fine, groups, pieces, share, promise, label, trust, evidence })
    }
}

impl Ended {
    /// Keeps some of the parts, by their numbers from 0; the others are the body's.
    fn keep(&mut self, kept: &[usize]) {
        let number = |l: u32| kept.iter().position(|g| *g as u32 + 1 == l).map_or(0, |k| k as u32 + 1);
        self.label.iter_mut().flatten().for_each(|l| *l = number(*l));
        self.groups = kept.iter().map(|g| std::mem::take(&mut self.groups[*g])).collect();
        self.pieces = kept.iter().map(|g| std::mem::take(&mut self.pieces[*g])).collect();
        self.share = kept.iter().map(|g| self.share[*g]).collect();
        self.promise = kept.iter().map(|g| self.promise[*g]).collect();
    }
}

/// What is known of the body and of the parts that are left.
fn trusted(first: &First<'_>, analysis: &Analysis, kept: &[usize], label: &[Option<u32>], expected: &Expected) -> Matrix {
    let points = sizes(analysis);
    let still = first.still();
    let taken = |i: &usize| kept.iter().any(|g| first.groups[*g].contains(i));
    let (own, lacking): (Vec<usize>, Vec<usize>) = (0..points.len()).partition(|i| !taken(i));
    let right: f64 = own.iter().map(|i| points[*i] * still[*i]).sum();
    let all = own.iter().map(|i| points[*i]).sum::<f64>() + lacking.iter().map(|i| points[*i] * still[*i]).sum::<f64>();
    let count = |l: u32| label.iter().filter(|x| **x == Some(l)).count();
    let mut told = vec![Trusted {
        number: 0,
        points: count(0),
        classes: shares(&first.classes, &own, &points),
        overlap: right / all.max(1.0),
        promise: [1.0; 2],
    }];
    for (k, g) in kept.iter().enumerate() {
        let group = &first.groups[*g];
        told.push(Trusted {
            number: g + 1,
            points: count(k as u32 + 1),
            classes: shares(&first.classes, group, &points),
            overlap: first.odds.overlap(group, &still, &points),
            promise: first.promises[*g],
        });
    }
    let moving: f64 = told[1..].iter().map(|t| t.points as f64).sum();
    if moving > 0.0 {
        told[0].promise = [0, 1].map(|c| told[1..].iter().map(|t| t.points as f64 * t.promise[c]).sum::<f64>() / moving);
    }
    trust::rows(analysis, &told, expected)
}

/// What is asked about parts in the end, for training.
pub struct Ends {
    /// Of the body and each part a row of features, how far it is to be trusted.
    pub trust: Matrix,
    /// Of each part a row of features, what says that it moves.
    pub evidence: Matrix,
    /// Of each input point its part from 1; 0 the body.
    pub label_of_input: Vec<Option<u32>>,
}

impl Ends {
    /// Of a cloud.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        let analyses = analyse(cloud)?;
        let mut plain = Plain { weights: &weights.matrices };
        let first = First::of(&analyses, &mut plain)?;
        let analysis = &analyses[first.index];
        let ended = Ended::of(&first, analysis, &mut plain)?;
        let label_of_input = analysis.of_input.iter().map(|i| i.and_then(|i| ended.label[i as usize])).collect();
        Ok(Self { trust: ended.trust, evidence: ended.evidence, label_of_input })
    }
}

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

/// How parts move, as far as the network says that of all candidates.
struct Moves {
    parts: Vec<Moving>,
    candidates: Vec<Vec<Candidate>>,
    /// Of each part [`CANDIDATES`] rows: a score and where the hinge is.
    out: Matrix,
}

impl Moves {
    /// `side` shows the superpoints split where parts end.
    fn of(
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
    fn hinges(&self, ended: &Ended, side: &Side<'_>) -> Vec<(usize, usize, Hinge<'_>)> {
        let mut out = Vec::new();
        for (k, part) in self.parts.iter().enumerate() {
            for (m, motion) in
                part.motions.iter().enumerate().filter(|(m, motion)| !motion.slides && (*m == 0 || motion.probability > SELDOM))
            {
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
    fn place(&mut self, ended: &Ended, side: &Side<'_>, network: &mut Network<'_, Plain<'_>>) -> Result<(), ModellingError> {
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

/// What is asked about the hinges of a cloud, for training.
pub struct Hinges {
    /// A row of [`crate::PLACE`] features each.
    pub rows: Matrix,
    /// Of each its part, by its number from 1.
    pub part: Vec<u32>,
    /// Of each the axis that it opens about, in W.
    pub axis: Vec<Vector3<f64>>,
    /// Where each was thought to be, in W, m.
    pub origin: Vec<Point3<f64>>,
    /// Of each the unit vectors in W that answers are counted along: along the panel and out of it, and the same as they are when it is shut.
    pub frames: Vec<[Vector3<f64>; 4]>,
    /// Of each input point its part from 1; 0 the body.
    pub label_of_input: Vec<Option<u32>>,
}

impl Hinges {
    /// Of a cloud.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        let analyses = analyse(cloud)?;
        let mut plain = Plain { weights: &weights.matrices };
        let first = First::of(&analyses, &mut plain)?;
        let analysis = &analyses[first.index];
        let ended = Ended::of(&first, analysis, &mut plain)?;
        let side = Side::new(&ended.fine, first.seen.quarter);
        let moves = Moves::of(&first, analysis, &ended, &side, &mut Network::new(&mut plain))?;
        let hinges: Vec<Hinge<'_>> = moves.hinges(&ended, &side).into_iter().map(|h| h.2).collect();
        let R_WK = (side.posed.R_KA * side.posed.analysis.R_AW).inverse();
        let label_of_input = analysis.of_input.iter().map(|i| i.and_then(|i| ended.label[i as usize])).collect();
        Ok(Self {
            rows: place::rows(&side.posed, &ended.label, &hinges),
            part: hinges.iter().map(|h| h.label).collect(),
            axis: hinges.iter().map(|h| R_WK * h.axis).collect(),
            origin: hinges.iter().map(|h| R_WK * h.candidate.corrected(h.residual)).collect(),
            frames: hinges.iter().map(|h| h.frames().map(|f| f.map(|v| R_WK * v))).map(|[[a, b], [c, d]]| [a, b, c, d]).collect(),
            label_of_input,
        })
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
        .map(|(c, candidate)| {
            let probability = f64::from(p[c]) * (1.0 - fixed);
            Motion { candidate: c, ..still.motion(pieces, candidate, residual(out, row + c), probability, lid) }
        })
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
