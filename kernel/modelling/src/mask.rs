//! Which pieces are one part: groups are weighed as a whole, by a head of the network that says how well each would overlap a true part.
//!
//! Whether two pieces belong together is a local answer. Joined one after the other by it, pieces make a tree of groups, each of which may be
//! a part: a leaf and what it is made of, two leaves and what both are. Of each group it is asked how like a part it is: does a seam run through it,
//! do its edges lie where seams are, does it fill its rectangle, how many handles has it? Of the tree then those groups are taken
//! that promise most together, no two within one another. What one group is depends on what else its pieces could be, so all groups are asked about
//! at once, with how they share points. (Hierarchies of segments scored and cut by dynamic programming: Arbelaez et al.,
//! "Multiscale combinatorial grouping", CVPR 2014; the promise of an overlap as confidence: Huang et al., "Mask Scoring R-CNN", CVPR 2019.)

use nalgebra::{Point3, Vector3};

use crate::border::Panel;
use crate::grouping::Odds;
use crate::network::{CLASSES, Matrix};
use crate::posed::Posed;
use crate::seam::{BEHIND, EDGE, Front, INSIDE, told};

/// Features of a group.
pub const MASK: usize = 23 + CLASSES + 9 + 2 * INSIDE + 4 * EDGE;

/// Features of two groups: the shares of the one's points that are the other's and the other way round, the share of either's that are both's, is
/// there any, and are they the same group.
pub const RELATION: usize = 5;

/// How far beyond a panel's rectangle one looks, m.
const BESIDE: f64 = 0.06;
/// Cells of a panel's rectangle, each way.
const CELLS: usize = 8;

/// What is known of the pieces that groups are made of.
pub(crate) struct Known<'a> {
    pub(crate) odds: &'a Odds,
    /// Probabilities of each piece's classes.
    pub(crate) classes: &'a Matrix,
    /// Points of each piece.
    pub(crate) points: &'a [f64],
}

/// The network's input for each group.
pub(crate) fn rows(posed: &Posed<'_>, groups: &[Vec<usize>], known: &Known<'_>) -> Matrix {
    let a = posed.analysis;
    let dense: Vec<(Point3<f64>, Option<u32>)> =
        a.dense.iter().map(|(p, of)| (Point3::from(posed.of_world(&p.coords)), a.piece[*of as usize])).collect();
    let mut all: Vec<f32> = Vec::with_capacity(groups.len() * MASK);
    for group in groups {
        let row = row(posed, group, known, &dense);
        debug_assert_eq!(row.len(), MASK);
        all.extend(row.into_iter().map(|x| x.clamp(-3.0, 3.0) as f32));
    }
    Matrix::from_row_slice(groups.len(), MASK, &all)
}

/// What the network made of each group's pieces: the mean of their states, by points.
pub(crate) fn states(groups: &[Vec<usize>], points: &[f64], state: &Matrix) -> Matrix {
    let mean = |g: &Vec<usize>, k: usize| {
        let (sum, total) = g.iter().fold((0.0, 0.0), |s, p| (s.0 + points[*p] as f32 * state[(*p, k)], s.1 + points[*p] as f32));
        sum / f32::max(total, 1.0)
    };
    Matrix::from_fn(groups.len(), state.ncols(), |i, k| mean(&groups[i], k))
}

/// How groups share points: row `i n + j` tells of the groups `i` and `j`. `points` of each piece.
pub(crate) fn relations(groups: &[Vec<usize>], points: &[f64]) -> Matrix {
    let n = groups.len();
    let sizes: Vec<f64> = groups.iter().map(|g| g.iter().map(|i| points[*i]).sum::<f64>().max(1.0)).collect();
    let mut out = Matrix::zeros(n * n, RELATION);
    for (i, a) in groups.iter().enumerate() {
        let mut own = vec![0.0; points.len()];
        a.iter().for_each(|p| own[*p] = points[*p]);
        for (j, b) in groups.iter().enumerate() {
            let both: f64 = b.iter().map(|p| own[*p]).sum();
            let told = [
                both / sizes[i],
                both / sizes[j],
                both / (sizes[i] + sizes[j] - both),
                f64::from(u8::from(both > 0.0)),
                f64::from(u8::from(i == j)),
            ];
            told.into_iter().enumerate().for_each(|(k, x)| out[(i * n + j, k)] = x as f32);
        }
    }
    out
}

fn row(posed: &Posed<'_>, group: &[usize], known: &Known<'_>, dense: &[(Point3<f64>, Option<u32>)]) -> Vec<f64> {
    let a = posed.analysis;
    let n = a.superpoints.len();
    let own = |i: usize| group.contains(&i);
    let is_own: Vec<bool> = (0..n).map(own).collect();
    let size: f64 = group.iter().map(|i| known.points[*i]).sum();
    let total = a.points.len() as f64;
    let panel = Panel::of(posed, group);
    let mut row: Vec<f64> = Vec::with_capacity(MASK);

    // What was thought of its pieces and of their neighbours.
    let still: Vec<f64> = (0..n).map(|i| f64::from(known.classes[(i, 0)])).collect();
    let together: Vec<Option<f64>> = (0..n).map(|i| known.odds.together(group, i, known.points)).collect();
    let large = |i: &usize| known.points[*i] > 0.04 * size;
    let weakest = group.iter().filter(|i| large(i)).filter_map(|i| together[*i]).fold(3.0 * 4.0, f64::min);
    let strongest = (0..n).filter(|i| !is_own[*i] && large(i)).filter_map(|i| together[i]).fold(-12.0, f64::max);
    let beside = (0..n)
        .filter(|i| !is_own[*i])
        .filter_map(|i| together[i].map(|t| (known.points[i] / size).min(1.0) / (1.0 + (-t).exp())))
        .fold(0.0, f64::max);
    let joined = known.odds.within(group, known.points).unwrap_or(12.0);
    let behind = (0..n).filter(|i| !is_own[*i] && still[*i] < 0.5).filter_map(|i| together[i]).fold(-12.0, f64::max);
    row.extend([joined / 4.0, behind / 4.0, weakest / 4.0, strongest / 4.0, beside * 2.0]);
    row.push(known.odds.overlap(group, &still, known.points) * 2.0 - 1.0);
    let mut share = [0.0; CLASSES];
    for i in group {
        share.iter_mut().enumerate().for_each(|(k, s)| *s += known.points[*i] * f64::from(known.classes[(*i, k)]) / size.max(1.0));
    }
    row.extend(share.map(|s| s * 2.0 - 1.0));
    let most = group.iter().map(|i| still[*i]).fold(0.0, f64::max);
    row.extend([most, (size / total).sqrt() * 2.0, size.log10() - 2.0, group.len() as f64 / 4.0]);
    let doubtful = group.iter().map(|i| known.points[*i] * f64::from(u8::from(still[*i] > 0.5))).sum::<f64>() / size.max(1.0);
    row.push(2.0 * doubtful);

    // Its panel.
    let [out, ..] = panel.axes;
    let (width, height) = (panel.level.1 - panel.level.0, panel.rise.1 - panel.rise.0);
    row.extend([width * 2.0, height * 2.0, (panel.deep.1 - panel.deep.0) * 5.0, panel.shape.flat_share]);
    row.extend([out.x.abs(), out.z.abs(), (panel.shape.center.x - posed.face) * 10.0, posed.diagonal().ln()]);
    row.extend([a.scale.noise * 100.0, a.scale.spacing * 50.0]);
    row.extend([width / (posed.high.y - posed.low.y).max(0.01), height / (posed.high.z - posed.low.z).max(0.01)]);

    // What its rectangle holds.
    let thin = a.scale.thin();
    // Only what is near the panel is looked at.
    let range = |t: f64, of: (f64, f64)| t > of.0 - BESIDE && t < of.1 + BESIDE;
    let (places, of_place): (Vec<[f64; 3]>, Vec<Option<u32>>) = dense
        .iter()
        .map(|(p, piece)| (panel.coordinates(p), *piece))
        .filter(|(c, _)| c[0] > -BEHIND && c[0] < thin && range(c[1], panel.level) && range(c[2], panel.rise))
        .unzip();
    let (mut cells, mut others, mut flat, mut of_own, mut of_moving) = ([false; CELLS * CELLS], [false; CELLS * CELLS], 0.0, 0.0, 0.0);
    for (c, piece) in places.iter().zip(of_place) {
        if c[0].abs() > thin || c[1] < panel.level.0 || c[1] > panel.level.1 || c[2] < panel.rise.0 || c[2] > panel.rise.1 {
            continue;
        }
        let cell = |t: f64, range: (f64, f64)| (((t - range.0) / (range.1 - range.0).max(1e-6) * CELLS as f64) as usize).min(CELLS - 1);
        let at = cell(c[1], panel.level) * CELLS + cell(c[2], panel.rise);
        flat += 1.0;
        let Some(piece) = piece.map(|p| p as usize) else { continue };
        if is_own[piece] {
            of_own += 1.0;
            cells[at] = true;
        } else {
            others[at] = true;
            of_moving += f64::from(u8::from(still[piece] < 0.5));
        }
    }
    let count = |of: &[bool]| of.iter().filter(|x| **x).count() as f64 / (CELLS * CELLS) as f64;
    row.extend([count(&cells), count(&others), of_own / f64::max(flat, 1.0), of_moving / f64::max(flat, 1.0)]);

    // Handles: how many, how far apart, and where the largest is.
    row.extend(grips(posed, &panel, &is_own));

    let front = Front { places: &places, ranges: [panel.level, panel.rise], thin, spacing: a.scale.spacing };
    let (mut inside, mut edges) = (Vec::new(), Vec::new());
    for k in 0..2 {
        let (own, mut ends) = told(&front, k);
        // Left and right are the same to furniture.
        if k == 0 && ends[0][0] > ends[1][0] {
            ends.swap(0, 1);
        }
        inside.extend(own);
        edges.extend(ends.into_iter().flatten());
    }
    row.extend(inside);
    row.extend(edges);
    row
}

/// What stands out of a panel like handles: how many, how far apart along both directions, and where the largest is.
fn grips(posed: &Posed<'_>, panel: &Panel, is_own: &[bool]) -> [f64; 5] {
    let a = posed.analysis;
    let least = (3.0 * a.scale.noise).max(0.01);
    let many = posed.points.len() / 60;
    let places: Vec<Point3<f64>> = (0..posed.points.len())
        .filter(|i| a.piece[*i].is_none_or(|k| is_own[k as usize] || a.superpoints[k as usize].points.len() < many))
        .map(|i| panel.coordinates(&posed.points[i]))
        .filter(|c| {
            c[0] > least && c[0] < 0.1 && c[1] > panel.level.0 && c[1] < panel.level.1 && c[2] > panel.rise.0 && c[2] < panel.rise.1
        })
        .map(|c| Point3::new(c[0], c[1], c[2]))
        .collect();
    let (of, sizes) = crate::ground::components(&places, (2.5 * a.scale.spacing).max(0.02));
    let mut middles: Vec<(usize, Vector3<f64>)> = sizes.iter().map(|n| (*n, Vector3::zeros())).collect();
    for (p, c) in places.iter().zip(of) {
        middles[c as usize].1 += p.coords / sizes[c as usize] as f64;
    }
    middles.retain(|m| m.0 >= 4);
    middles.sort_by_key(|m| std::cmp::Reverse(m.0));
    let Some(largest) = middles.first() else { return [0.0, 0.0, 0.0, 0.0, 0.0] };
    let (width, height) = ((panel.level.1 - panel.level.0).max(1e-3), (panel.rise.1 - panel.rise.0).max(1e-3));
    let apart = |k: usize, of: f64| middles.iter().map(|m| (m.1[k] - largest.1[k]).abs()).fold(0.0, f64::max) / of;
    [
        middles.len() as f64 / 2.0,
        apart(1, width),
        apart(2, height),
        ((largest.1.y - panel.level.0) / width - 0.5).abs() * 2.0,
        (largest.1.z - panel.rise.0) / height,
    ]
}

/// How little both promises of a group may be together that it is still taken. Below one half of each, since a part that is missed is lost, and one
/// in vain is found out at the first touch.
const LEAST: f64 = 0.4;

/// Of groups those that promise most together, no two of which share a piece. `promises`: of each the probability to overlap a true part by
/// half, and by three quarters.
///
/// The most promising first; then, as long as that promises more, one is given up for others that it stood in the way of, or others for one.
pub(crate) fn chosen(groups: &[Vec<usize>], promises: &[[f64; 2]]) -> Vec<usize> {
    let gain: Vec<f64> = promises.iter().map(|p| p[0] + p[1] - LEAST).collect();
    let mut order: Vec<usize> = (0..groups.len()).filter(|k| gain[*k] > 0.0).collect();
    order.sort_by(|a, b| gain[*b].total_cmp(&gain[*a]));
    let clash = |a: usize, b: usize| groups[a].iter().any(|p| groups[b].contains(p));
    let fill = |mut taken: Vec<usize>, of: &[usize]| {
        for k in of {
            if !taken.iter().any(|t| clash(*t, *k)) {
                taken.push(*k);
            }
        }
        taken
    };
    let total = |of: &[usize]| of.iter().map(|k| gain[*k]).sum::<f64>();
    let mut best = fill(Vec::new(), &order);
    for _ in 0..ROUNDS {
        let mut found: Option<Vec<usize>> = None;
        for k in &order {
            // With this one or without it, and then whatever fits best.
            let next = match best.contains(k) {
                true => {
                    let others: Vec<usize> =
                        order.iter().copied().filter(|o| o != k && !(groups[*o].len() >= groups[*k].len() && clash(*o, *k))).collect();
                    fill(best.iter().copied().filter(|t| t != k).collect(), &others)
                }
                false => fill([vec![*k], best.iter().copied().filter(|t| !clash(*t, *k)).collect()].concat(), &order),
            };
            if total(&next) > total(found.as_ref().unwrap_or(&best)) + 1e-9 {
                found = Some(next);
            }
        }
        let Some(next) = found else { break };
        best = next;
    }
    best
}

/// Most changes of mind.
const ROUNDS: usize = 40;

/// How far off a plane what is in it may lie, m: panes are set back, rails stand out.
const PLANE: f64 = 0.03;
/// How far what stands out of a panel may, m.
const OUT: f64 = 0.1;
/// How far beyond a rectangle its pieces may reach, m.
const OVER: f64 = 0.015;
/// Least share of a rectangle that its pieces fill.
const FILLED: f64 = 0.6;
/// Pieces that are the body with more than this probability do not span rectangles.
const STILL: f64 = 0.98;
/// Most rectangles.
const MOST: usize = 120;

/// Panels that shut fronts may have: what lies in a rectangle that two pieces of one plane span.
pub(crate) fn rectangles(posed: &Posed<'_>, still: &[f64]) -> Vec<Vec<usize>> {
    let pieces = &posed.pieces;
    let mut found: Vec<Vec<usize>> = Vec::new();
    for axis in 0..3 {
        let along = [(axis + 1) % 3, (axis + 2) % 3];
        let flat: Vec<usize> = (0..pieces.len()).filter(|i| pieces[*i].axial == Some(axis)).collect();
        let area = |low: &Point3<f64>, high: &Point3<f64>| along.iter().map(|k| (high[*k] - low[*k]).max(1e-3)).product::<f64>();
        let middle = (posed.low[axis] + posed.high[axis]) / 2.0;
        for (n, i) in flat.iter().enumerate() {
            for j in &flat[n..] {
                let (p, q) = (&pieces[*i], &pieces[*j]);
                if (p.center[axis] - q.center[axis]).abs() > PLANE || still[*i] > STILL || still[*j] > STILL {
                    continue;
                }
                let (low, high) = (p.low.inf(&q.low), p.high.sup(&q.high));
                let at = (p.center[axis] + q.center[axis]) / 2.0;
                let outward = if at > middle { 1.0 } else { -1.0 };
                let within = |k: &usize| {
                    let o = &pieces[*k];
                    let inside = along.iter().all(|k| o.low[*k] > low[*k] - OVER && o.high[*k] < high[*k] + OVER);
                    let (x, y) = ((o.low[axis] - at) * outward, (o.high[axis] - at) * outward);
                    inside && x.min(y) > -PLANE && x.max(y) < OUT
                };
                let group: Vec<usize> = (0..pieces.len()).filter(within).collect();
                let filled: f64 =
                    group.iter().filter(|k| pieces[**k].axial == Some(axis)).map(|k| area(&pieces[*k].low, &pieces[*k].high)).sum();
                if group.contains(i) && group.contains(j) && filled > FILLED * area(&low, &high) && !found.contains(&group) {
                    found.push(group);
                }
            }
        }
    }
    let body = |g: &[usize]| g.iter().map(|i| still[*i] * posed.analysis.superpoints[*i].points.len() as f64).sum::<f64>();
    found.sort_by(|a, b| {
        let mean = |g: &[usize]| body(g) / g.iter().map(|i| posed.analysis.superpoints[*i].points.len() as f64).sum::<f64>().max(1.0);
        mean(a).total_cmp(&mean(b))
    });
    found.truncate(MOST);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_leaves_are_taken_where_they_promise_more_than_both_as_one() {
        let groups = vec![vec![0], vec![1], vec![0, 1], vec![2]];
        let mut two = chosen(&groups, &[[0.9, 0.8], [0.8, 0.5], [0.9, 0.9], [0.1, 0.0]]);
        two.sort_unstable();
        assert_eq!(two, [0, 1]);
        assert_eq!(chosen(&groups, &[[0.5, 0.3], [0.4, 0.1], [0.9, 0.9], [0.1, 0.0]]), [2]);
    }

    #[test]
    fn a_group_within_another_is_told_from_one_beside_it() {
        let told = relations(&[vec![0, 1], vec![0], vec![2]], &[30.0, 10.0, 50.0]);
        let row = |i: usize, j: usize| told.row(i * 3 + j).iter().copied().collect::<Vec<f32>>();
        assert_eq!(row(0, 0), [1.0; 5]);
        assert_eq!(row(0, 1), [0.75, 1.0, 0.75, 1.0, 0.0]);
        assert_eq!(row(1, 0), [1.0, 0.75, 0.75, 1.0, 0.0]);
        assert_eq!(row(0, 2), [0.0; 5]);
    }

    #[test]
    fn no_piece_is_of_two_parts() {
        let groups = vec![vec![0, 1], vec![1, 2], vec![2, 3]];
        let mut taken = chosen(&groups, &[[0.8, 0.6], [0.9, 0.8], [0.8, 0.6]]);
        taken.sort_unstable();
        assert_eq!(taken, [0, 2]);
    }
}
