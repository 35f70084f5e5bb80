//! Superpoints: flat pieces grown from their flattest points, flat pieces cut where a thin gap runs through, and lumps of what is
//! left.
//!
//! Region growing over point normals (Rabbani, van den Heuvel and Vosselman 2006). Two doors shut beside one another are one plane with a
//! line in it where fewer points lie. Such lines are found as in page layouts: the recursive cut along the deepest valley of the
//! projected density (XY cut; Nagy and Seth 1984).

use nalgebra::{Matrix3, Point3, Vector3};

use crate::grid::Grid;
use crate::normal::{Local, least};

/// A piece of the cloud. In the frame A of the box: z up, sides along x and y.
#[derive(Debug, Clone)]
pub(crate) struct Superpoint {
    /// Indices of its points.
    pub(crate) points: Vec<u32>,
    /// Mean, m.
    pub(crate) center: Point3<f64>,
    /// Normal of its plane, or least direction of its spread; its sign means nothing.
    pub(crate) normal: Vector3<f64>,
    /// RMS distance from the plane, m.
    pub(crate) residual: f64,
    /// Is it a plane?
    pub(crate) flat: bool,
    /// The axis of A that its normal lies along, if it does.
    pub(crate) axial: Option<usize>,
    /// Least and greatest corner, m.
    pub(crate) low: Point3<f64>,
    /// The greatest.
    pub(crate) high: Point3<f64>,
    /// How clear the gap is at its lower and upper end along the two other axes in turn: 1 where nothing goes on.
    pub(crate) sides: [f64; 4],
}

/// How fine to look.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    /// Typical distance to the sixth neighbour, m.
    pub(crate) spacing: f64,
    /// RMS noise of flat surfaces, m.
    pub(crate) noise: f64,
}

/// Greatest number of superpoints.
pub(crate) const MOST: usize = 96;

impl Superpoint {
    fn of(points: Vec<u32>, cloud: &[Point3<f64>], flat: bool) -> Self {
        let n = points.len().max(1) as f64;
        let at = |i: &u32| cloud[*i as usize];
        let mean = points.iter().map(|i| at(i).coords).sum::<Vector3<f64>>() / n;
        let covariance = points.iter().map(|i| (at(i).coords - mean) * (at(i).coords - mean).transpose()).sum::<Matrix3<f64>>() / n;
        let (normal, value) = least(&covariance);
        // Corners without the outermost hundredth: flying pixels reach far.
        let mut low = Point3::origin();
        let mut high = Point3::origin();
        for k in 0..3 {
            let mut c: Vec<f64> = points.iter().map(|i| at(i)[k]).collect();
            c.sort_by(f64::total_cmp);
            let cut = c.len() / 100;
            low[k] = c.get(cut).copied().unwrap_or_default();
            high[k] = c.get(c.len().saturating_sub(1 + cut)).copied().unwrap_or_default();
        }
        let axial = flat.then(|| (0..3).find(|k| normal[*k].abs() > 0.9945)).flatten();
        Self { points, center: Point3::from(mean), normal, residual: value.sqrt(), flat, axial, low, high, sides: [1.0; 4] }
    }
}

/// All superpoints of a cloud, largest first, and of each point the one that holds it.
pub(crate) fn superpoints(cloud: &[Point3<f64>], local: &[Local], scale: Scale) -> (Vec<Superpoint>, Vec<Option<u32>>) {
    let reach = 2.0 * scale.spacing;
    let grid = Grid::new(cloud, reach);
    let fewest = (cloud.len() / 800).max(10);
    let mut taken = vec![false; cloud.len()];
    let mut found: Vec<Superpoint> = Vec::new();
    let mut order: Vec<usize> = (0..cloud.len()).filter(|i| local[*i].residual.is_finite()).collect();
    order.sort_by(|a, b| local[*a].residual.total_cmp(&local[*b].residual));
    let mut tried = vec![false; cloud.len()];
    let mut mark = vec![u32::MAX; cloud.len()];
    for seed in order {
        if taken[seed] || tried[seed] || local[seed].residual > 4.0 * scale.noise.max(0.002) {
            continue;
        }
        let tolerance = (3.0 * local[seed].residual).clamp(0.0045_f64.max(1.5 * scale.noise), 0.02_f64.max(3.0 * scale.noise));
        let region = grow(seed, cloud, local, &grid, (&taken, &mut mark), reach, tolerance);
        if region.len() < fewest {
            region.iter().for_each(|i| tried[*i as usize] = true);
            continue;
        }
        region.iter().for_each(|i| taken[*i as usize] = true);
        found.push(Superpoint::of(region, cloud, true));
    }
    adopt(cloud, &mut taken, &mut found, &grid, reach, scale);
    let mut pieces = Vec::new();
    for s in found {
        match s.axial {
            Some(axis) => cut(s, axis, cloud, scale, 0, &mut pieces),
            None => pieces.push(s),
        }
    }
    pieces.extend(lumps(cloud, &taken, reach, fewest / 2 + 3));
    pieces.sort_by_key(|s| std::cmp::Reverse(s.points.len()));
    pieces.truncate(MOST);
    let mut of = vec![None; cloud.len()];
    for (k, s) in pieces.iter().enumerate() {
        s.points.iter().for_each(|i| of[*i as usize] = Some(k as u32));
    }
    (pieces, of)
}

/// All free points that are reached from a seed within its plane.
///
/// `mark` remembers for which seed a point was last reached.
fn grow(
    seed: usize,
    cloud: &[Point3<f64>],
    local: &[Local],
    grid: &Grid<'_>,
    (taken, mark): (&[bool], &mut [u32]),
    reach: f64,
    tolerance: f64,
) -> Vec<u32> {
    let mut normal = local[seed].normal;
    let mut center = cloud[seed];
    let mut region = vec![seed as u32];
    mark[seed] = seed as u32;
    let (mut sum, mut squares) = (Vector3::zeros(), Matrix3::zeros());
    let origin = cloud[seed];
    let mut next_fit = 24;
    let mut head = 0;
    while head < region.len() {
        let i = region[head] as usize;
        head += 1;
        grid.near(&cloud[i], reach, |j, _| {
            if taken[j] || mark[j] == seed as u32 {
                return;
            }
            let along = local[j].normal.dot(&normal).abs();
            let off = (cloud[j] - center).dot(&normal).abs();
            if along > 0.9 && off < tolerance {
                mark[j] = seed as u32;
                region.push(j as u32);
                let d = cloud[j] - origin;
                sum += d;
                squares += d * d.transpose();
            }
        });
        if region.len() >= next_fit {
            let n = (region.len() - 1) as f64;
            let mean = sum / n;
            let fitted = least(&(squares / n - mean * mean.transpose())).0;
            // A strip's fit may turn about its length; a fit that turns away is not followed.
            if fitted.dot(&normal).abs() > 0.97 {
                normal = fitted;
                center = origin + mean;
            }
            next_fit = region.len() * 3 / 2;
        }
    }
    region
}

/// Gives free points that lie in a plane at its border, where normals are bent, to it.
fn adopt(cloud: &[Point3<f64>], taken: &mut [bool], found: &mut [Superpoint], grid: &Grid<'_>, reach: f64, scale: Scale) {
    let mut of: Vec<Option<usize>> = vec![None; cloud.len()];
    for (k, s) in found.iter().enumerate() {
        s.points.iter().for_each(|i| of[*i as usize] = Some(k));
    }
    for _ in 0..3 {
        let mut given: Vec<(usize, usize)> = Vec::new();
        for i in 0..cloud.len() {
            if of[i].is_some() {
                continue;
            }
            let mut best: Option<(usize, f64)> = None;
            grid.near(&cloud[i], reach, |j, _| {
                if let Some(k) = of[j] {
                    let off = (cloud[i] - found[k].center).dot(&found[k].normal).abs();
                    if off < 2.0 * scale.noise.max(found[k].residual).max(0.0015) && best.is_none_or(|b| off < b.1) {
                        best = Some((k, off));
                    }
                }
            });
            given.extend(best.map(|(k, _)| (i, k)));
        }
        if given.is_empty() {
            break;
        }
        for (i, k) in given {
            of[i] = Some(k);
            taken[i] = true;
            found[k].points.push(i as u32);
        }
    }
    for s in found.iter_mut() {
        *s = Superpoint::of(std::mem::take(&mut s.points), cloud, true);
    }
}

/// Cuts a flat piece along the deepest valley of its density, again and again.
fn cut(piece: Superpoint, axis: usize, cloud: &[Point3<f64>], scale: Scale, depth: usize, out: &mut Vec<Superpoint>) {
    let along = [(axis + 1) % 3, (axis + 2) % 3];
    let mut best: Option<(f64, usize, Line)> = None;
    if depth < 7 && piece.points.len() >= 80 {
        for (side, k) in along.into_iter().enumerate() {
            if let Some((contrast, at)) = valley(&piece, k, along[1 - side], cloud, scale)
                && best.is_none_or(|b| contrast > b.0)
            {
                best = Some((contrast, side, at));
            }
        }
    }
    let Some((contrast, side, line)) = best else {
        out.push(piece);
        return;
    };
    let k = along[side];
    let (below, above): (Vec<u32>, Vec<u32>) = piece.points.iter().partition(|i| {
        let p = cloud[**i as usize];
        p[k] < line.at + line.lean * (p[along[1 - side]] - line.middle)
    });
    for (points, end) in [(below, 1), (above, 0)] {
        let mut part = Superpoint::of(points, cloud, true);
        part.normal = piece.normal;
        part.axial = Some(axis);
        part.sides = piece.sides;
        part.sides[2 * side + end] = contrast;
        cut(part, axis, cloud, scale, depth + 1, out);
    }
}

/// The deepest valley of a piece's density along an axis: how deep, as a share, and where it runs.
fn valley(piece: &Superpoint, k: usize, other: usize, cloud: &[Point3<f64>], scale: Scale) -> Option<(f64, Line)> {
    let bin = (0.8 * scale.spacing).max(0.003);
    let (low, high) = (piece.low[k], piece.high[k]);
    let bins = ((high - low) / bin) as usize;
    let border = ((0.04 / bin).ceil() as usize).max(3);
    if bins < 2 * border + 3 {
        return None;
    }
    let middle = (piece.low[other] + piece.high[other]) / 2.0;
    let mut best: Option<(f64, Line)> = None;
    // The arm knows its camera's pose to some tenths of a degree: a gap a metre long may lean by millimetres.
    for lean in [0.0, -0.004, 0.004] {
        let mut counts = vec![0.0_f64; bins + 1];
        for i in &piece.points {
            let p = cloud[*i as usize];
            let c = (p[k] - low - lean * (p[other] - middle)) / bin;
            if c >= 0.0 && c < bins as f64 {
                counts[c as usize] += 1.0;
            }
        }
        for b in border..bins - border {
            // Against the ground on both sides, so that the edge of a window is no valley.
            let side = |from: usize, to: usize| {
                let mut window: Vec<f64> = counts[from..to].to_vec();
                window.sort_by(f64::total_cmp);
                window[window.len() / 2]
            };
            let width = border.max(4);
            let ground = side(b.saturating_sub(width), b - 1).min(side(b + 2, (b + 2 + width).min(bins)));
            let depth = (ground - counts[b]) / ground.max(1.0);
            let sure = (ground - counts[b]) / ground.max(1.0).sqrt();
            if sure > 3.0 && depth > 0.38 && best.is_none_or(|x| depth > x.0 + 0.02) {
                best = Some((depth, Line { at: low + (b as f64 + 0.5) * bin, lean, middle }));
            }
        }
    }
    best
}

/// A line across a piece: where it is amid the piece, and how it leans.
#[derive(Debug, Clone, Copy)]
struct Line {
    at: f64,
    lean: f64,
    middle: f64,
}

/// What is left, in lumps.
fn lumps(cloud: &[Point3<f64>], taken: &[bool], reach: f64, fewest: usize) -> Vec<Superpoint> {
    let left: Vec<usize> = (0..cloud.len()).filter(|i| !taken[*i]).collect();
    let points: Vec<Point3<f64>> = left.iter().map(|i| cloud[*i]).collect();
    let (of, sizes) = crate::ground::components(&points, reach);
    let mut lumps: Vec<Vec<u32>> = sizes.iter().map(|_| Vec::new()).collect();
    for (i, c) in left.iter().zip(of) {
        lumps[c as usize].push(*i as u32);
    }
    lumps.into_iter().filter(|l| l.len() >= fewest).map(|l| Superpoint::of(l, cloud, false)).collect()
}
