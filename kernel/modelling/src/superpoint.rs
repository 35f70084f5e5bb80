//! Superpoints: flat pieces grown from their flattest points, flat pieces cut where a thin gap runs through, and lumps of what is
//! left.
//!
//! Region growing over point normals (Rabbani, van den Heuvel and Vosselman 2006). Two doors shut beside one another are one plane with a
//! line in it where fewer points lie; a leaf set back a little in its frame is one within the noise of single points. Such lines are
//! found as in page layouts: the recursive cut along the clearest valley of the projected density (XY cut; Nagy and Seth 1984), or the
//! clearest step of the projected depth.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::crossing;
use crate::grid::Grid;
use crate::normal::{Local, least, mean_and_covariance};
use crate::seam::BEHIND;

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
    /// How much deeper along the normal's axis what goes on there is, m.
    pub(crate) steps: [f64; 4],
}

/// How fine to look.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    /// Typical distance to the sixth neighbour, m.
    pub(crate) spacing: f64,
    /// RMS noise of flat surfaces, m.
    pub(crate) noise: f64,
}

impl Scale {
    /// How far from a surface its points may lie, m.
    pub(crate) fn thin(&self) -> f64 {
        (3.0 * self.noise.max(0.001)).max(0.006)
    }
}

/// Greatest number of superpoints.
pub(crate) const MOST: usize = 96;

impl Superpoint {
    pub(crate) fn of(points: Vec<u32>, cloud: &[Point3<f64>], flat: bool) -> Self {
        let at = |i: &u32| cloud[*i as usize];
        let (mean, covariance) = mean_and_covariance(points.iter().map(|i| at(i).coords));
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
        Self {
            points,
            center: Point3::from(mean),
            normal,
            residual: value.sqrt(),
            flat,
            axial,
            low,
            high,
            sides: [1.0; 4],
            steps: [0.0; 4],
        }
    }
}

impl Superpoint {
    /// A piece of this one that holds some of its points. Few points say nothing of a plane.
    pub(crate) fn part(&self, points: Vec<u32>, cloud: &[Point3<f64>]) -> Self {
        let flat = self.flat && points.len() >= 10;
        let own = Self::of(points, cloud, flat);
        match flat {
            true => Self { normal: self.normal, axial: self.axial, sides: self.sides, steps: self.steps, ..own },
            false => own,
        }
    }
}

/// The flat regions of a cloud and what is left, whatever the yaw.
pub(crate) struct Regions {
    flat: Vec<Vec<u32>>,
    lumps: Vec<Vec<u32>>,
}

impl Regions {
    /// Grown in W.
    pub(crate) fn grown(cloud: &[Point3<f64>], local: &[Local], scale: Scale) -> Self {
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
        crossing::part(cloud, &mut found, scale);
        let lumps = lumps(cloud, &taken, reach, fewest / 2 + 3);
        Self { flat: found.into_iter().map(|s| s.points).collect(), lumps }
    }

    /// What may be handles: small things.
    fn grips(&self, cloud: &[Point3<f64>], scale: Scale) -> Vec<Grip> {
        let mut free = vec![true; cloud.len()];
        let many = (cloud.len() / 40).max(60);
        self.flat.iter().filter(|r| r.len() > many).flatten().for_each(|i| free[*i as usize] = false);
        let left: Vec<Point3<f64>> = (0..cloud.len()).filter(|i| free[*i]).map(|i| cloud[i]).collect();
        let (of, sizes) = crate::ground::components(&left, (2.5 * scale.spacing).max(0.02));
        let mut grips: Vec<Grip> = sizes
            .iter()
            .map(|n| Grip { points: *n, low: Vector3::repeat(f64::INFINITY), high: Vector3::repeat(f64::NEG_INFINITY) })
            .collect();
        for (p, c) in left.iter().zip(of) {
            let grip = &mut grips[c as usize];
            grip.low = grip.low.inf(&p.coords);
            grip.high = grip.high.sup(&p.coords);
        }
        grips.retain(|g| g.points >= 5);
        grips
    }

    /// All superpoints, largest first, and of each point the one that holds it. `cloud` in A; `dense` are all points, each with the one of
    /// `cloud` that stands for it.
    pub(crate) fn superpoints(
        &self,
        cloud: &[Point3<f64>],
        dense: &[(Point3<f64>, u32)],
        scale: Scale,
    ) -> (Vec<Superpoint>, Vec<Option<u32>>) {
        let mut pieces = Vec::new();
        let ground = Ground { cloud, grips: self.grips(cloud, scale), scale };
        let middle = cloud.iter().map(|p| p.coords).sum::<Vector3<f64>>() / cloud.len().max(1) as f64;
        let mut own = vec![false; cloud.len()];
        for region in &self.flat {
            let s = Superpoint::of(region.clone(), cloud, true);
            match s.axial {
                Some(axis) => {
                    region.iter().for_each(|i| own[*i as usize] = true);
                    let rays = Rays::of(&s, axis, &own, dense, middle[axis], scale);
                    region.iter().for_each(|i| own[*i as usize] = false);
                    cut(s, axis, rays, &ground, 0, &mut pieces);
                }
                None => pieces.push(s),
            }
        }
        pieces.extend(self.lumps.iter().map(|l| Superpoint::of(l.clone(), cloud, false)));
        pieces.sort_by_key(|s| std::cmp::Reverse(s.points.len()));
        pieces.truncate(MOST);
        let mut of = vec![None; cloud.len()];
        for (k, s) in pieces.iter().enumerate() {
            s.points.iter().for_each(|i| of[*i as usize] = Some(k as u32));
        }
        (pieces, of)
    }
}

/// All free points that are reached from a seed within its plane.
///
/// `mark` remembers for which seed a point was last reached.
fn grow(
    seed: usize,
    cloud: &[Point3<f64>],
    local: &[Local],
    grid: &Grid,
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
fn adopt(cloud: &[Point3<f64>], taken: &mut [bool], found: &mut [Superpoint], grid: &Grid, reach: f64, scale: Scale) {
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

/// A line across a piece along which it may be two: where it is amid the piece, how it leans, and what speaks for it.
#[derive(Debug, Clone, Copy)]
struct Line {
    at: f64,
    lean: f64,
    middle: f64,
    /// In standard deviations.
    sure: f64,
    /// Share of points that are missing there.
    gap: f64,
    /// How much deeper what lies above is, along the axis, m.
    step: f64,
}

/// Most cuts within one another, and fewest points of a piece that is cut.
const DEEPEST: usize = 10;
const FEWEST: usize = 40;

/// All points that are told of a piece: those that it holds, and those that are seen behind it.
struct Rays {
    flat: Vec<Point3<f64>>,
    back: Vec<Point3<f64>>,
}

impl Rays {
    /// `own` says which thinned points the piece holds; `middle` is where the object's is along the axis.
    fn of(piece: &Superpoint, axis: usize, own: &[bool], dense: &[(Point3<f64>, u32)], middle: f64, scale: Scale) -> Self {
        let out = if piece.center[axis] > middle { 1.0 } else { -1.0 };
        let least = (3.0 * scale.noise).max(0.006);
        let within = |p: &Point3<f64>| (0..3).all(|k| k == axis || (p[k] > piece.low[k] && p[k] < piece.high[k]));
        let mut rays = Self { flat: Vec::new(), back: Vec::new() };
        for (p, of) in dense {
            if own[*of as usize] {
                rays.flat.push(*p);
            } else if within(p) && (least..BEHIND).contains(&((piece.center[axis] - p[axis]) * out)) {
                rays.back.push(*p);
            }
        }
        rays
    }

    fn parted(self, below: &impl Fn(&Point3<f64>) -> bool) -> [Self; 2] {
        let (flat, above) = self.flat.into_iter().partition(below);
        let (back, back_above) = self.back.into_iter().partition(below);
        [Self { flat, back }, Self { flat: above, back: back_above }]
    }
}

/// What all pieces of a cloud share.
struct Ground<'a> {
    cloud: &'a [Point3<f64>],
    grips: Vec<Grip>,
    scale: Scale,
}

/// Cuts a flat piece along the line for which most speaks, again and again. Cuts in vain cost little: which pieces are one part is asked
/// of the network, and it is told what spoke for each cut. A cut that is not made is a part that nobody can find any more.
fn cut(piece: Superpoint, axis: usize, rays: Rays, ground: &Ground<'_>, depth: usize, out: &mut Vec<Superpoint>) {
    let Ground { cloud, scale, .. } = ground;
    let along = [(axis + 1) % 3, (axis + 2) % 3];
    let mut best: Option<(usize, Line)> = None;
    if depth < DEEPEST && piece.points.len() >= FEWEST {
        for (side, k) in along.into_iter().enumerate() {
            if let Some(line) = line(&piece, k, along[1 - side], axis, &rays, *scale, None)
                && best.is_none_or(|b| line.sure > b.1.sure)
            {
                best = Some((side, line));
            }
        }
        if best.is_none() {
            best = between_grips(&piece, axis, &rays, &ground.grips, *scale);
        }
    }
    let Some((side, line)) = best else {
        out.push(piece);
        return;
    };
    let k = along[side];
    let is_below = |p: &Point3<f64>| p[k] < line.at + line.lean * (p[along[1 - side]] - line.middle);
    let (below, above): (Vec<u32>, Vec<u32>) = piece.points.iter().partition(|i| is_below(&cloud[**i as usize]));
    for ((points, end), rays) in [(below, 1), (above, 0)].into_iter().zip(rays.parted(&is_below)) {
        let mut part = Superpoint::of(points, cloud, true);
        part.normal = piece.normal;
        part.axial = Some(axis);
        part.sides = piece.sides;
        part.steps = piece.steps;
        part.sides[2 * side + end] = line.gap;
        // Seen from this side of the line.
        part.steps[2 * side + end] = if end == 1 { line.step } else { -line.step };
        cut(part, axis, rays, ground, depth + 1, out);
    }
}

/// Fewest standard deviations by which points must be missing along a gap, and depth must differ across a step. Little above what chance
/// brings: on shut fronts that are trained on, cuts at 3.6 left one panel in four without pieces of its own, these leave one in six.
const GAP: f64 = 2.2;
const STEP: f64 = 5.0;
/// The same for what becomes wider or narrower, and how much narrower it must be.
const WIDTH: f64 = 6.0;
const NARROWER: f64 = 0.65;
/// Least share of points that are missing along a gap.
const MISSING: f64 = 0.1;

/// A small thing: its corners.
struct Grip {
    points: usize,
    low: Vector3<f64>,
    high: Vector3<f64>,
}

/// Where a piece has two handles one beside the other there are two panels, though no gap be seen: the line between them for which most
/// speaks, however little that is.
fn between_grips(piece: &Superpoint, axis: usize, rays: &Rays, grips: &[Grip], scale: Scale) -> Option<(usize, Line)> {
    if axis == 2 {
        return None;
    }
    let along = [(axis + 1) % 3, (axis + 2) % 3];
    let own: Vec<&Grip> = grips
        .iter()
        .filter(|g| {
            let within = |k: usize| g.low[k] > piece.low[k] - 0.01 && g.high[k] < piece.high[k] + 0.01;
            // It touches the panel, or nearly, and stands out of it.
            let (near, far) = ((g.low[axis] - piece.center[axis]), (g.high[axis] - piece.center[axis]));
            let out = near.abs().max(far.abs());
            let gap = if near * far < 0.0 { 0.0 } else { near.abs().min(far.abs()) };
            along.into_iter().all(within) && gap < 0.06 && out < 0.12 && out > (3.0 * scale.noise).max(0.01)
        })
        .collect();
    let mut best: Option<(usize, Line)> = None;
    for (side, k) in along.into_iter().enumerate() {
        let other = along[1 - side];
        for a in &own {
            for b in &own {
                let apart = b.low[k] - a.high[k];
                // Beside one another across the line, in line along it.
                let overlap = a.high[other].min(b.high[other]) - a.low[other].max(b.low[other]);
                let shorter = (a.high[other] - a.low[other]).min(b.high[other] - b.low[other]);
                let between = own.iter().any(|c| c.low[k] > a.high[k] && c.high[k] < b.low[k]);
                if apart < 0.06 || overlap < -0.03 + 0.3 * shorter || between {
                    continue;
                }
                let found = line(piece, k, other, axis, rays, scale, Some((a.high[k], b.low[k])));
                if let Some(found) = found
                    && best.is_none_or(|x| found.sure > x.1.sure)
                {
                    best = Some((side, found));
                }
            }
        }
    }
    best
}

/// The line across an axis for which most speaks: that points are missing along it, against the ground on both sides; or that depth
/// differs from one side of it to the other.
///
/// Within a range, if one is given: there is one then, and little has to speak for it.
fn line(piece: &Superpoint, k: usize, other: usize, axis: usize, rays: &Rays, scale: Scale, range: Option<(f64, f64)>) -> Option<Line> {
    let (least_gap, least) = if range.is_some() { (0.08, 1.2) } else { (MISSING, GAP) };
    // Bins a third as wide as what is looked at together, so that no gap falls between two.
    const FINE: usize = 3;
    let bin = (0.9 * scale.spacing).max(0.003) / FINE as f64;
    let (low, high) = (piece.low[k], piece.high[k]);
    let bins = ((high - low) / bin) as usize;
    let border = ((0.035 / bin).ceil() as usize).max(4 * FINE);
    if bins < 2 * border + FINE {
        return None;
    }
    let middle = (piece.low[other] + piece.high[other]) / 2.0;
    let window = border.max(5 * FINE);
    let mut best: Option<Line> = None;
    // The arm knows its camera's pose to some tenths of a degree: a gap a metre long may lean by millimetres.
    for lean in [0.0, -0.004, 0.004] {
        // Running sums of points and of depths.
        let mut counts = vec![0.0_f64; bins + 1];
        let mut depths = vec![0.0_f64; bins + 1];
        let mut backs = vec![0.0_f64; bins + 1];
        let bin_of = |p: &Point3<f64>| Some((p[k] - low - lean * (p[other] - middle)) / bin).filter(|c| *c >= 0.0 && *c < bins as f64);
        for p in &rays.flat {
            if let Some(c) = bin_of(p) {
                counts[c as usize + 1] += 1.0;
                depths[c as usize + 1] += p[axis] - piece.center[axis];
            }
        }
        rays.back.iter().filter_map(bin_of).for_each(|c| backs[c as usize + 1] += 1.0);
        for b in 0..bins {
            counts[b + 1] += counts[b];
            depths[b + 1] += depths[b];
            backs[b + 1] += backs[b];
        }
        let within = |sums: &[f64], from: usize, to: usize| sums[to.min(bins)] - sums[from.min(bins)];
        let mut sample: Vec<f64> = Vec::new();
        for b in border..bins - border - FINE {
            let here = within(&counts, b, b + FINE);
            // Against the ground on each side, so that the edge of a window is no gap; and against how uneven it is.
            let mut side = |from: usize, to: usize| {
                sample.clear();
                let mut f = from;
                while f + FINE <= to {
                    sample.push(within(&counts, f, f + FINE));
                    f += FINE;
                }
                sample.sort_by(f64::total_cmp);
                let n = sample.len();
                if n < 3 {
                    return (0.0, 0.0);
                }
                let middle = sample[n / 2];
                (middle, 0.5 * (sample[3 * n / 4] - sample[n / 4]))
            };
            let (below, above) = (side(b.saturating_sub(window), b - 1), side(b + FINE + 1, (b + FINE + 1 + window).min(bins)));
            let ground = below.0.min(above.0);
            let gap = (ground - here) / ground.max(1.0);
            let uneven = 1.5 * if below.0 < above.0 { below.1 } else { above.1 };
            let missing = (ground - here) / ground.max(1.0).sqrt().max(uneven);
            // What is seen behind it, against the same beside it.
            let back = within(&backs, b, b + FINE);
            let beside = |from: usize, to: usize| within(&backs, from, to) * FINE as f64 / (to.min(bins).max(from + 1) - from) as f64;
            let usual = beside(b.saturating_sub(window), b.saturating_sub(1)).max(beside(b + FINE + 1, b + FINE + 1 + window));
            let through = if ground < 1.0 { 0.0 } else { ((back - usual) / (usual + 1.0).sqrt()).max(0.0) };
            let gap = gap.max(if through > 1.0 { ((back - usual) / ground.max(1.0)).min(1.0) } else { 0.0 });
            let sure = if missing > 0.0 { missing.hypot(through) } else { through };
            let at = low + (b as f64 + 0.5 * FINE as f64) * bin;
            if range.is_some_and(|r| at < r.0 || at > r.1) {
                continue;
            }
            // Depth on both sides, a little away from the line.
            let (m, n) = (within(&counts, b.saturating_sub(window), b), within(&counts, b + FINE, b + FINE + window));
            let mut step = 0.0;
            let mut steep = 0.0;
            if m >= 12.0 && n >= 12.0 {
                step = within(&depths, b + FINE, b + FINE + window) / n - within(&depths, b.saturating_sub(window), b) / m;
                let deviation = piece.residual.max(scale.noise).max(0.001) * (1.0 / m + 1.0 / n).sqrt();
                steep = step.abs() / deviation;
            }
            let told = if step.abs() > 0.0015 && steep > 4.0 { step } else { 0.0 };
            if gap > least_gap && sure > least && best.is_none_or(|x| sure > x.sure + 0.1) {
                best = Some(Line { at, lean, middle, sure, gap, step: told });
            }
            // Where the piece grows wider or narrower.
            let (more, less) = (m.max(n), m.min(n));
            let sure = (more - less) / (more + less).max(1.0).sqrt() / WIDTH * GAP;
            if less < NARROWER * more && sure > GAP && best.is_none_or(|x| sure > x.sure + 0.1) {
                best = Some(Line { at, lean, middle, sure, gap: gap.clamp(0.0, 1.0), step: told });
            }
            let sure = steep / STEP * GAP;
            if step.abs() > 0.0025_f64.max(0.2 * scale.noise) && sure > least && best.is_none_or(|x| sure > x.sure + 0.1) {
                best = Some(Line { at, lean, middle, sure, gap: gap.clamp(0.0, 1.0), step });
            }
        }
    }
    best
}

/// What is left, in lumps.
fn lumps(cloud: &[Point3<f64>], taken: &[bool], reach: f64, fewest: usize) -> Vec<Vec<u32>> {
    let left: Vec<usize> = (0..cloud.len()).filter(|i| !taken[*i]).collect();
    let points: Vec<Point3<f64>> = left.iter().map(|i| cloud[*i]).collect();
    let (of, sizes) = crate::ground::components(&points, reach);
    let mut lumps: Vec<Vec<u32>> = sizes.iter().map(|_| Vec::new()).collect();
    for (i, c) in left.iter().zip(of) {
        lumps[c as usize].push(*i as u32);
    }
    lumps.retain(|l| l.len() >= fewest);
    lumps
}
