//! Where a part ends, point by point.
//!
//! Superpoints are as pure as the gaps between parts are clear. Where a shut door lies flush in its frame, or the side of a door goes on
//! into the side of the case, one superpoint holds points of both. So once parts are known, each point near one is asked about again: is
//! it the part's? What speaks for it is how it lies to the rectangle of the part's panel, whether a seam (a line where points are missing)
//! or a step lies between it and the panel's middle, what its neighbours are taken for, and what was thought of its superpoint. A small
//! network weighs these. It is the unary term of a conditional random field (Lafferty, McCallum and Pereira 2001) whose labels are the parts;
//! neighbours enter by their first labels.

use nalgebra::{Point3, Vector3};

use crate::analysis::Analysis;
use crate::candidate::{Shape, quantile, shape};
use crate::grid::Grid;
use crate::network::{CLASSES, Matrix};
use crate::posed::Posed;
use crate::seam::BEHIND;
use crate::superpoint::Superpoint;

/// Features of a point and a part that it may belong to.
pub const BORDER: usize = 65;

/// How far from the rectangle of a part's panel points are asked about, along it and across it, m.
const BESIDE: f64 = 0.08;
const BEFORE: f64 = 0.12;
/// Bins of the narrowest strip beyond a seam.
const NARROW: usize = 4;
/// How far within the panel's edge a seam may be its true edge, m.
const WITHIN: f64 = 0.15;

/// What is thought of a part before its points are asked about.
pub(crate) struct Thought {
    /// Its superpoints.
    pub(crate) pieces: Vec<usize>,
    /// Probabilities of its classes.
    pub(crate) classes: [f64; CLASSES],
    /// Of each superpoint, the log-odds that it is of this part.
    pub(crate) together: Vec<f64>,
}

/// Points and parts that are asked about, and the network's input for each pair.
pub(crate) struct Asked {
    /// The point and the number of the part, from 0.
    pub(crate) of: Vec<(u32, u32)>,
    /// One row of [`BORDER`] features each.
    pub(crate) rows: Matrix,
    /// Is the point near the panel, or near points of another mind?
    pub(crate) doubtful: Vec<bool>,
}

/// The first label of each point: that of its superpoint, 0 the body, parts from 1. What no superpoint holds goes with its neighbours;
/// none where there are none.
pub(crate) fn first_labels(analysis: &Analysis, parts: &[Vec<usize>]) -> Vec<Option<u32>> {
    let mut of_piece = vec![0_u32; analysis.superpoints.len()];
    for (k, pieces) in parts.iter().enumerate() {
        pieces.iter().for_each(|i| of_piece[*i] = k as u32 + 1);
    }
    let mut of_point: Vec<Option<u32>> = analysis.piece.iter().map(|p| p.map(|p| of_piece[p as usize])).collect();
    let held: Vec<usize> = (0..of_point.len()).filter(|i| of_point[*i].is_some()).collect();
    let points: Vec<Point3<f64>> = held.iter().map(|i| analysis.points[*i]).collect();
    let reach = 6.0 * analysis.scale.spacing;
    let grid = Grid::new(&points, reach / 2.0);
    for i in 0..of_point.len() {
        if of_point[i].is_none() {
            of_point[i] = grid.nearest(&analysis.points[i], reach).and_then(|k| of_point[held[k]]);
        }
    }
    of_point
}

/// The density and the depth of a panel along one of its directions, and of each place the clearest seam between it and the middle.
struct Profile {
    from: f64,
    bin: f64,
    /// Mean depth over the panel, and points as a share of the panel's usual, in each bin.
    depth: Vec<f64>,
    dense: Vec<f64>,
    /// Share of points that are missing at the clearest seam between here and the middle, how sure that is, and where it is.
    seam: Vec<[f64; 3]>,
}

impl Profile {
    /// Of places `t` with depths, endless ones where the panel was seen through; it reaches from `low` to `high`.
    fn of(points: &[(f64, f64)], low: f64, high: f64, spacing: f64) -> Self {
        // Two bins are looked at together, so that no seam falls between.
        let bin = 0.5 * (0.9 * spacing).max(0.003);
        let (from, to) = (low - 0.1, high + 0.1);
        let bins = (((to - from) / bin).ceil() as usize).clamp(4, 4000);
        let (mut counts, mut depths, mut backs) = (vec![0.0_f64; bins + 1], vec![0.0_f64; bins + 1], vec![0.0_f64; bins + 1]);
        for (t, d) in points {
            let b = (t - from) / bin;
            if b >= 0.0 && b < bins as f64 {
                match d.is_finite() {
                    true => {
                        counts[b as usize] += 1.0;
                        depths[b as usize] += d;
                    }
                    false => backs[b as usize] += 1.0,
                }
            }
        }
        let both = |v: &[f64], b: usize| v[b] + v[b + 1];
        let wide: Vec<f64> = (0..bins).map(|b| both(&counts, b)).collect();
        let behind: Vec<f64> = (0..bins).map(|b| both(&backs, b)).collect();
        let depth: Vec<f64> = (0..bins).map(|b| both(&depths, b) / wide[b].max(1.0)).collect();
        let inside: Vec<f64> = (0..bins).filter(|b| (low..=high).contains(&(from + *b as f64 * bin))).map(|b| wide[b]).collect();
        let usual = middle(&inside).max(1.0);
        let dense = wide.iter().map(|c| c / usual).collect();
        let window = ((0.035 / bin) as usize).max(8);
        let sure: Vec<[f64; 2]> = (0..bins)
            .map(|b| {
                // A frame's strip beyond the seam may be no wider than a few bins.
                let ground = |near: usize| {
                    let below = middle(&wide[b.saturating_sub(near)..b.saturating_sub(1)]);
                    let above = middle(&wide[(b + 2).min(bins)..(b + 2 + near).min(bins)]);
                    [below, above]
                };
                let (far, strip) = (ground(window), ground(NARROW));
                let (below, above) = (far[0].max(strip[0]), far[1].max(strip[1]));
                let ground = below.min(above);
                let missing = [((ground - wide[b]) / ground.max(1.0)).max(0.0), ((ground - wide[b]) / ground.max(1.0).sqrt()).max(0.0)];
                let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len().max(1) as f64;
                let usual = mean(&behind[b.saturating_sub(window)..b.saturating_sub(1)]);
                let usual = usual.max(mean(&behind[(b + 2).min(bins)..(b + 2 + window).min(bins)]));
                let through = if ground < 1.0 { 0.0 } else { ((behind[b] - usual) / (usual + 1.0).sqrt()).max(0.0) };
                let share = if through > 1.0 { ((behind[b] - usual) / ground.max(1.0)).min(1.0) } else { 0.0 };
                [missing[0].max(share), missing[1].hypot(through)]
            })
            .collect();
        let mut seam = vec![[0.0; 3]; bins];
        let at = |b: usize| from + (b as f64 + 1.0) * bin;
        // Seams count from some way within the edge outwards.
        let reach = WITHIN.min(0.4 * (high - low));
        let first = |t: f64| (((t - from) / bin).max(0.0) as usize).min(bins - 1);
        let (up, down) = (first(high - reach), first(low + reach));
        let mut best = [0.0; 3];
        for b in up..bins {
            if sure[b][1] > best[1] {
                best = [sure[b][0], sure[b][1], at(b)];
            }
            seam[b] = best;
        }
        best = [0.0; 3];
        for b in (0..=down).rev() {
            if sure[b][1] > best[1] {
                best = [sure[b][0], sure[b][1], at(b)];
            }
            if b < up {
                seam[b] = best;
            }
        }
        Self { from, bin, depth, dense, seam }
    }

    fn bin_of(&self, t: f64) -> usize {
        (((t - self.from) / self.bin - 0.5).max(0.0) as usize).min(self.depth.len() - 1)
    }

    /// Mean depth of the strip at a place.
    fn depth_at(&self, t: f64) -> f64 {
        self.depth[self.bin_of(t)]
    }

    /// Depth and density at a place, then the seam: missing share, how sure, how far beyond it the place lies.
    fn features(&self, t: f64) -> [f64; 5] {
        let b = self.bin_of(t);
        let [missing, sure, at] = self.seam[b];
        let beyond = if sure > 0.0 { (t - at).abs() * 20.0 } else { 0.0 };
        [self.depth[b] * 100.0, self.dense[b], missing, sure / 4.0, beyond]
    }
}

fn middle(of: &[f64]) -> f64 {
    let mut v = of.to_vec();
    quantile(&mut v, 0.5)
}

/// A part's panel: its directions (out of it, level, rising) and its rectangle.
pub(crate) struct Panel {
    pub(crate) shape: Shape,
    pub(crate) axes: [Vector3<f64>; 3],
    at: f64,
    pub(crate) level: (f64, f64),
    pub(crate) rise: (f64, f64),
    /// From and to of all its points across the panel.
    pub(crate) deep: (f64, f64),
}

impl Panel {
    pub(crate) fn of(posed: &Posed<'_>, pieces: &[usize]) -> Self {
        let shape = shape(posed, pieces);
        let n = shape.outward(posed);
        let level = if n.z.abs() > 0.9 { Vector3::y() } else { n.cross(&Vector3::z()).normalize() };
        let rise = n.cross(&level);
        let range = |of: &[Point3<f64>], e: &Vector3<f64>, cut: f64| {
            let mut t: Vec<f64> = of.iter().map(|p| p.coords.dot(e)).collect();
            (quantile(&mut t, cut), quantile(&mut t, 1.0 - cut))
        };
        let at = shape.panel.iter().map(|p| p.coords.dot(&n)).sum::<f64>() / shape.panel.len().max(1) as f64;
        let (across, up, deep) = (range(&shape.panel, &level, 0.01), range(&shape.panel, &rise, 0.01), range(&shape.all, &n, 0.02));
        Self { axes: [n, level, rise], at, level: across, rise: up, deep: (deep.0 - at, deep.1 - at), shape }
    }

    /// Off the panel, along it, up it.
    pub(crate) fn coordinates(&self, p: &Point3<f64>) -> [f64; 3] {
        let [n, level, rise] = &self.axes;
        [p.coords.dot(n) - self.at, p.coords.dot(level), p.coords.dot(rise)]
    }
}

/// How far within a range a place is; less than nothing outside.
fn inside(t: f64, range: (f64, f64)) -> f64 {
    (t - range.0).min(range.1 - t)
}

/// Asks about all points near any of the parts.
pub(crate) fn ask(posed: &Posed<'_>, label: &[Option<u32>], still: &[f64], parts: &[Thought]) -> Asked {
    let a = posed.analysis;
    let normals: Vec<Vector3<f64>> = a.normals.iter().map(|n| posed.R_KA * n).collect();
    let near = neighbours(a, label, parts.len());
    let dense: Vec<Point3<f64>> = a.dense.iter().map(|(p, _)| Point3::from(posed.of_world(&p.coords))).collect();
    let noise = a.scale.noise.max(0.001);
    let (mut asked, mut doubtful) = (Vec::new(), Vec::new());
    let mut rows: Vec<f32> = Vec::new();
    for (g, part) in parts.iter().enumerate() {
        let panel = Panel::of(posed, &part.pieces);
        let own = g as u32 + 1;
        let places: Vec<[f64; 3]> = posed.points.iter().map(|p| panel.coordinates(p)).collect();
        let thin = a.scale.thin();
        // Seams show best among all points, and by what is seen through them.
        let all: Vec<[f64; 3]> = dense.iter().map(|p| panel.coordinates(p)).collect();
        let on = |k: usize, other: usize, range: (f64, f64)| -> Vec<(f64, f64)> {
            let near = |c: &&[f64; 3]| c[0] < thin && c[0] > -BEHIND && inside(c[other], range) > 0.0;
            all.iter().filter(near).map(|c| (c[k], if c[0] > -thin { c[0] } else { f64::NEG_INFINITY })).collect()
        };
        let across = Profile::of(&on(1, 2, panel.rise), panel.level.0, panel.level.1, a.scale.spacing);
        let up = Profile::of(&on(2, 1, panel.level), panel.rise.0, panel.rise.1, a.scale.spacing);
        // What stands across the panel along its border: its own sides, or those of what is behind it.
        let [n, ..] = panel.axes;
        let edge = |c: &[f64; 3]| inside(c[1], panel.level).min(inside(c[2], panel.rise));
        let wall = |i: usize| normals[i].dot(&n).abs() < 0.4 && edge(&places[i]).abs() < 0.04;
        let walls: Vec<(f64, f64)> =
            (0..places.len()).filter(|i| wall(*i) && (-0.25..0.1).contains(&places[*i][0])).map(|i| (-places[i][0], 0.0)).collect();
        let behind = Profile::of(&walls, -0.1, 0.15, a.scale.spacing);
        let center = panel.shape.center;
        let shared = [
            (panel.level.1 - panel.level.0) * 2.0,
            (panel.rise.1 - panel.rise.0) * 2.0,
            (panel.deep.1 - panel.deep.0) * 5.0,
            panel.shape.flat_share,
            n.x.abs(),
            n.z.abs(),
            (center.x - posed.face) * 10.0,
            posed.diagonal().ln(),
            a.scale.noise * 100.0,
            a.scale.spacing * 50.0,
        ];
        for (i, c) in places.iter().enumerate() {
            let is_own = label[i] == Some(own);
            let [d, u, v] = *c;
            let (in_level, in_rise) = (inside(u, panel.level), inside(v, panel.rise));
            if !is_own && (d.abs() > BEFORE || in_level < -BESIDE || in_rise < -BESIDE) {
                continue;
            }
            let share = |k: usize| near[i * (parts.len() + 1) + k];
            let others: f64 = (1..=parts.len()).filter(|k| *k != g + 1).map(share).sum();
            let (body, together) = match a.piece[i] {
                Some(p) => (still[p as usize], part.together[p as usize]),
                None => (0.5, 0.0),
            };
            let alike = |k: usize| normals[i].dot(&panel.axes[k]).abs();
            let mut row: Vec<f64> = Vec::with_capacity(BORDER);
            let flag = |is: bool| f64::from(u8::from(is));
            row.extend([
                flag(is_own),
                flag(label[i] == Some(0)),
                flag(label[i].is_some_and(|l| l != 0 && l != own)),
                flag(a.piece[i].is_none()),
            ]);
            row.extend([d * 50.0, d.abs() * 50.0, d / noise / 3.0, d * 10.0]);
            row.extend([(u - panel.level.0) * 20.0, (panel.level.1 - u) * 20.0, (v - panel.rise.0) * 20.0, (panel.rise.1 - v) * 20.0]);
            row.extend([in_level.min(in_rise) * 100.0, in_level.min(in_rise) * 30.0]);
            row.extend([alike(0), alike(1), alike(2)]);
            row.extend([(d - panel.deep.0) * 20.0, (panel.deep.1 - d) * 20.0]);
            row.extend([share(g + 1), share(0), others]);
            row.extend([body, together / 4.0]);
            row.extend(part.classes);
            row.extend(across.features(u));
            row.extend(up.features(v));
            row.extend(behind.features(-d));
            row.extend(shared);
            // Rails stand out and panes lie back: what the strip about the point does, and the point in it.
            row.extend([(d - across.depth_at(u)) * 100.0, (d - up.depth_at(v)) * 100.0]);
            row.extend([flag(in_level < in_rise), in_level * 20.0, in_rise * 20.0]);
            // A frame lies between the panel and the object's outermost edges.
            let p = &posed.points[i];
            row.extend([(p.y - posed.low.y) * 20.0, (posed.high.y - p.y) * 20.0, (p.z - posed.low.z) * 20.0, (posed.high.z - p.z) * 20.0]);
            row.extend([(p.x - posed.face) * 30.0, (p.x - posed.face) * 8.0]);
            debug_assert_eq!(row.len(), BORDER);
            rows.extend(row.into_iter().map(|x| x.clamp(-3.0, 3.0) as f32));
            asked.push((i as u32, g as u32));
            doubtful.push(if is_own { share(g + 1) < 0.97 } else { share(g + 1) > 0.03 || d.abs() < 0.02 });
        }
    }
    Asked { rows: Matrix::from_row_slice(asked.len(), BORDER, &rows), of: asked, doubtful }
}

/// Of each point, the shares of its neighbours by label: the body, then the parts.
fn neighbours(a: &Analysis, label: &[Option<u32>], parts: usize) -> Vec<f64> {
    let reach = 3.0 * a.scale.spacing;
    let grid = Grid::new(&a.points, reach);
    let mut out = vec![0.0; a.points.len() * (parts + 1)];
    for (i, p) in a.points.iter().enumerate() {
        let row = &mut out[i * (parts + 1)..(i + 1) * (parts + 1)];
        let mut all = 0.0;
        grid.near(p, reach, |j, _| {
            if let Some(l) = label[j] {
                all += 1.0;
                row[l as usize] += 1.0;
            }
        });
        row.iter_mut().for_each(|x| *x /= f64::max(all, 1.0));
    }
    out
}

/// New labels from the log-odds of each pair that was asked about: the likeliest part, where that is likelier than not. Otherwise what was
/// a part's goes to the body.
pub(crate) fn relabelled(label: &[Option<u32>], asked: &Asked, odds: &[f32]) -> Vec<Option<u32>> {
    let mut best: Vec<Option<(f32, u32)>> = vec![None; label.len()];
    for ((i, g), x) in asked.of.iter().zip(odds) {
        let slot = &mut best[*i as usize];
        if slot.is_none_or(|b| *x > b.0) {
            *slot = Some((*x, g + 1));
        }
    }
    let told = |(best, before): (&Option<(f32, u32)>, &Option<u32>)| match best {
        Some((x, g)) if *x > 0.0 => Some(*g),
        Some(_) => before.map(|_| 0),
        None => *before,
    };
    best.iter().zip(label).map(told).collect()
}

/// The analysis with superpoints split where their points have different labels, and the pieces of each part.
pub(crate) fn split(analysis: &Analysis, label: &[Option<u32>], parts: usize) -> (Analysis, Vec<Vec<usize>>) {
    let mut pieces: Vec<(Superpoint, u32)> = Vec::new();
    for s in &analysis.superpoints {
        let mut by: Vec<(u32, Vec<u32>)> = Vec::new();
        for i in &s.points {
            let l = label[*i as usize].unwrap_or(0);
            match by.iter_mut().find(|b| b.0 == l) {
                Some((_, own)) => own.push(*i),
                None => by.push((l, vec![*i])),
            }
        }
        let whole = by.len() == 1;
        for (l, own) in by {
            let piece = if whole { s.clone() } else { s.part(own, &analysis.points) };
            pieces.push((piece, l));
        }
    }
    pieces.sort_by_key(|p| std::cmp::Reverse(p.0.points.len()));
    let mut of = vec![None; analysis.points.len()];
    let mut groups = vec![Vec::new(); parts];
    for (k, (s, l)) in pieces.iter().enumerate() {
        s.points.iter().for_each(|i| of[*i as usize] = Some(k as u32));
        if let Some(g) = (*l as usize).checked_sub(1) {
            groups[g].push(k);
        }
    }
    let superpoints = pieces.into_iter().map(|p| p.0).collect();
    (Analysis { superpoints, piece: of, ..analysis.clone() }, groups)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A panel half a metre wide, 4 mm between points, but for a seam at 46 cm.
    fn panel() -> Profile {
        let along = (0..125).map(|i| 0.004 * f64::from(i)).filter(|t| !(0.458..0.464).contains(t));
        let points: Vec<(f64, f64)> = along.flat_map(|t| (0..60).map(move |k| (t + 1e-4 * f64::from(k % 20), 0.0))).collect();
        Profile::of(&points, 0.0, 0.5, 0.004)
    }

    #[test]
    fn a_seam_near_the_edge_is_told_beyond_it_and_not_before_it() {
        let panel = panel();
        let (before, beyond) = (panel.features(0.43), panel.features(0.485));
        assert!(beyond[2] > 0.6 && beyond[3] > 1.0, "{beyond:?}");
        assert!(before[3] < 0.5 * beyond[3], "{before:?} {beyond:?}");
        // Half a metre away there is no seam.
        assert!(panel.features(0.02)[3] < 0.5 * beyond[3]);
    }

    #[test]
    fn a_point_goes_to_the_likeliest_part_and_to_the_body_if_none_is_likely() {
        let of = vec![(0, 0), (0, 1), (1, 0), (2, 1)];
        let asked = Asked { rows: Matrix::zeros(4, BORDER), doubtful: vec![true; 4], of };
        let before = [Some(1), Some(1), None, Some(2), None];
        let after = relabelled(&before, &asked, &[0.5, 2.0, -1.0, -0.1]);
        // The last two were not asked about; the third was nobody's, and stays so.
        assert_eq!(after, [Some(2), Some(0), None, Some(2), None]);
    }
}
