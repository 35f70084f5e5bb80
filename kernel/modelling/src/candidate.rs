//! The joints that a part could have: four slides, and hinges at the two ends of its section across each axis.
//!
//! A panel's section across a vertical line is a stroke. Whether the door is shut or stands open, its hinge is at one of the stroke's
//! ends. So the choice is among few candidates whose places geometry gives; what is learned is which, and a small residual.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use crate::handle::{Proud, proud};
use crate::posed::Posed;

/// Number of candidates: slides along x, y, -y, z; hinges along z, y, x at two ends.
pub(crate) const COUNT: usize = 10;
/// Features of one.
pub(crate) const FEATURES: usize = 54;
/// What a residual is measured in, m.
pub const RESIDUAL: f64 = 0.05;
/// Most that a residual may be, in its own measure: a hinge behind what hides it is far from all that is seen of the part.
pub const FARTHEST: f64 = 8.0;
/// How much of a panel's end is looked at for a lip or a notch, m.
const STRIP: f64 = 0.035;

/// One candidate, in K.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Its number among those of its part.
    pub(crate) number: usize,
    /// Does it slide?
    pub(crate) slides: bool,
    /// Direction in K; of hinges, still without the sign that opens.
    pub(crate) axis: Vector3<f64>,
    /// A point on the axis, amid the part, m.
    pub(crate) origin: Point3<f64>,
    /// Unit vectors in which residuals are counted: from the hinge along the section, and across it.
    pub(crate) along: Vector3<f64>,
    pub(crate) across: Vector3<f64>,
    /// Length of the section, m.
    pub(crate) length: f64,
    pub(crate) features: Vec<f64>,
}

/// What all candidates of a part share.
pub(crate) struct Shape {
    /// Corners of its points, without far ones.
    low: Point3<f64>,
    high: Point3<f64>,
    pub(crate) center: Point3<f64>,
    /// Points of its largest flat piece, and its normal.
    pub(crate) panel: Vec<Point3<f64>>,
    normal: Vector3<f64>,
    pub(crate) flat_share: f64,
    /// All its points.
    pub(crate) all: Vec<Point3<f64>>,
}

impl Shape {
    /// The panel's normal, away from the object's middle.
    pub(crate) fn outward(&self, posed: &Posed<'_>) -> Vector3<f64> {
        let middle = nalgebra::center(&posed.low, &posed.high);
        let n = self.normal;
        let sign = if n.x.abs() > 0.3 { n.x.signum() } else { (self.center - middle).dot(&n).signum() };
        n * sign
    }
}

pub(crate) fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

pub(crate) fn shape(posed: &Posed<'_>, part: &[usize]) -> Shape {
    let a = posed.analysis;
    let points: Vec<Point3<f64>> = part.iter().flat_map(|s| a.superpoints[*s].points.iter().map(|i| posed.points[*i as usize])).collect();
    let range = |k: usize, share: f64| quantile(&mut points.iter().map(|p| p[k]).collect::<Vec<_>>(), share);
    let low = Point3::new(range(0, 0.01), range(1, 0.01), range(2, 0.01));
    let high = Point3::new(range(0, 0.99), range(1, 0.99), range(2, 0.99));
    // The panel: the flat piece of the largest extent, with what lies in its plane.
    let area = |s: &usize| {
        let own = &a.superpoints[*s];
        if !own.flat {
            return 0.0;
        }
        // Points are sparse on what is seen at a grazing angle, so extents count.
        let mut extent: Vec<f64> = (posed.pieces[*s].high - posed.pieces[*s].low).iter().copied().collect();
        extent.sort_by(f64::total_cmp);
        extent[1] * extent[2]
    };
    let main = part.iter().copied().max_by(|x, y| area(x).total_cmp(&area(y))).unwrap_or(0);
    let (normal, at) = (posed.pieces[main].normal, posed.pieces[main].center);
    let near = 3.0 * a.superpoints[main].residual.max(a.scale.noise).max(0.003);
    let mut panel: Vec<Point3<f64>> = part
        .iter()
        .filter(|s| a.superpoints[**s].flat && posed.pieces[**s].normal.dot(&normal).abs() > 0.97)
        .flat_map(|s| a.superpoints[*s].points.iter().map(|i| posed.points[*i as usize]))
        .filter(|p| (p - at).dot(&normal).abs() < near)
        .collect();
    if panel.len() < 10 {
        panel.clone_from(&points);
    }
    let flat_share = panel.len() as f64 / points.len().max(1) as f64;
    Shape { low, high, center: nalgebra::center(&low, &high), panel, normal, flat_share, all: points }
}

/// The direction of a section's length, if it is a stroke; otherwise its first axis.
fn longest(section: &[Vector2<f64>], mean: &Vector2<f64>) -> Vector2<f64> {
    let covariance = section.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix2<f64>>();
    let e = covariance.symmetric_eigen();
    let (most, least) = (e.eigenvalues.imax(), e.eigenvalues.imin());
    match e.eigenvalues[most] > 6.0 * e.eigenvalues[least].max(0.0) {
        true => e.eigenvectors.column(most).into_owned(),
        false => Vector2::new(1.0, 0.0),
    }
}

/// Least and greatest corner of the rest of the object, its front at its face.
fn edges(posed: &Posed<'_>, rest: &[Point3<f64>]) -> [Point3<f64>; 2] {
    let end = |k: usize, share: f64, otherwise: f64| match rest.is_empty() {
        true => otherwise,
        false => quantile(&mut rest.iter().map(|p| p[k]).collect::<Vec<_>>(), share),
    };
    let low = Point3::from(Vector3::from_fn(|k, _| end(k, 0.01, posed.low[k])));
    let high = Point3::from(Vector3::from_fn(|k, _| if k == 0 { posed.face } else { end(k, 0.99, posed.high[k]) }));
    [low, high]
}

/// How far the strip along an end of a panel lies behind the panel, and how far before it, in cm: the least and the greatest tenth.
fn profile(
    posed: &Posed<'_>,
    end: &Point3<f64>,
    inward: &Vector3<f64>,
    k: usize,
    reach: (f64, f64),
    (outward, panel): (&Vector3<f64>, f64),
) -> [f64; 2] {
    let mut off: Vec<f64> = posed
        .points
        .iter()
        .filter(|p| p[k] > reach.0 && p[k] < reach.1 && (0.0..STRIP).contains(&(*p - end).dot(inward)))
        .map(|p| p.coords.dot(outward) - panel)
        .filter(|d| d.abs() < 0.06)
        .collect();
    match off.len() {
        0..8 => [0.0; 2],
        _ => [quantile(&mut off, 0.1) * 100.0, quantile(&mut off, 0.9) * 100.0],
    }
}

/// Most points of the rest of the object that distances are taken to.
const REST: usize = 3000;

/// All candidates of a part, given by its superpoints.
pub(crate) fn candidates(posed: &Posed<'_>, part: &[usize]) -> Vec<Candidate> {
    let s = shape(posed, part);
    let own = |i: &usize| posed.analysis.piece[*i].is_some_and(|k| part.contains(&(k as usize)));
    let rest: Vec<usize> = (0..posed.points.len()).filter(|i| !own(i)).collect();
    let rest: Vec<Point3<f64>> = rest.iter().step_by(rest.len() / REST + 1).map(|i| posed.points[*i]).collect();
    let size = posed.high - posed.low;
    let diagonal = posed.diagonal();
    let edges = edges(posed, &rest);
    let from_rest = |p: &Point3<f64>| rest.iter().map(|q| (q - p).norm_squared()).fold(0.09, f64::min).sqrt();
    let Proud { points: proud, outward, panel } = proud(posed, part, &s);
    let grip = (proud.len() >= 5).then(|| {
        let mean = proud.iter().map(|p| p.coords).sum::<Vector3<f64>>() / proud.len() as f64;
        let spread = proud.iter().map(|p| (p.coords - mean).map(|x| x * x)).sum::<Vector3<f64>>() / proud.len() as f64;
        (Point3::from(mean), spread.map(f64::sqrt))
    });
    let shared = |out: &mut Vec<f64>| {
        let extent = s.high - s.low;
        out.extend((extent * 2.0).iter());
        for k in 0..3 {
            out.push((s.center[k] - posed.low[k]) / size[k].max(1e-3));
        }
        out.extend([(s.low.x - posed.face) * 10.0, (s.high.x - posed.face) * 10.0]);
        out.extend(s.normal.map(|x| x * x).iter());
        out.push(s.flat_share);
        out.push(diagonal.ln());
    };
    let mut all = Vec::with_capacity(COUNT);
    let push = |all: &mut Vec<Candidate>, mut c: Candidate, own: &[f64]| {
        let mut features = vec![0.0; COUNT];
        features[all.len()] = 1.0;
        shared(&mut features);
        features.extend(own);
        features.resize(FEATURES, 0.0);
        (c.number, c.features) = (all.len(), features);
        all.push(c);
    };
    for axis in [Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z()] {
        let back = s.low.coords.dot(&axis).min(s.high.coords.dot(&axis));
        let c = Candidate {
            number: 0,
            slides: true,
            axis,
            origin: s.center,
            along: axis,
            across: if axis.z > 0.5 { Vector3::x() } else { Vector3::z() },
            length: (s.high - s.low).dot(&axis).abs(),
            features: Vec::new(),
        };
        let handle = grip.map_or([0.0; 4], |(at, spread)| {
            [
                1.0,
                (at - s.center).dot(&axis) * 5.0,
                spread.y / (spread.y + spread.z + 1e-3),
                (at.z - s.low.z) / (s.high.z - s.low.z).max(0.02),
            ]
        });
        let free = from_rest(&s.center);
        push(&mut all, c, &[back * 2.0, free * 5.0, handle[0], handle[1], handle[2], handle[3]]);
    }
    for k in [2, 1, 0] {
        let mut axis = Vector3::zeros();
        axis[k] = 1.0;
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let flat = |p: &Point3<f64>| Vector2::new(p[i], p[j]);
        let has_stroke = s.normal[k].abs() < 0.5;
        // A panel across the axis has no stroke of its own: the whole part may have one, as a flap of which the edges are seen best.
        let whole = if has_stroke { &s.panel } else { &s.all };
        let section: Vec<Vector2<f64>> = whole.iter().map(flat).collect();
        let n = section.len().max(1) as f64;
        let mean = section.iter().sum::<Vector2<f64>>() / n;
        let direction = match has_stroke {
            true => Vector2::new(-s.normal[j], s.normal[i]).normalize(),
            false => longest(&section, &mean),
        };
        let across = Vector2::new(-direction.y, direction.x);
        let mut t: Vec<f64> = section.iter().map(|p| (p - mean).dot(&direction)).collect();
        let (t0, t1) = (quantile(&mut t, 0.01), quantile(&mut t, 0.99));
        // How thick the part is before and behind its panel, as far as that is seen.
        let mut off: Vec<f64> = s.all.iter().map(|p| (flat(p) - mean).dot(&across)).collect();
        let (behind, before) = (quantile(&mut off, 0.02), quantile(&mut off, 0.98));
        let lift = |v: Vector2<f64>, w: f64| {
            let mut p = Vector3::zeros();
            (p[i], p[j], p[k]) = (v.x, v.y, w);
            p
        };
        let middle = (s.low[k] + s.high[k]) / 2.0;
        for (end, free, sign) in [(t0, t1, 1.0), (t1, t0, -1.0)] {
            let origin = Point3::from(lift(mean + direction * end, middle));
            let other = Point3::from(lift(mean + direction * free, middle));
            let along = lift(direction * sign, 0.0);
            let length = t1 - t0;
            let ends = |p: &Point3<f64>| {
                let mut low = *p;
                let mut high = *p;
                low[k] = 0.75 * s.low[k] + 0.25 * s.high[k];
                high[k] = 0.25 * s.low[k] + 0.75 * s.high[k];
                (from_rest(p) + from_rest(&low) + from_rest(&high)) / 3.0
            };
            // How far from the hinge the object's front is, along the section: a door that stands open hangs there.
            let to_face = if along.x.abs() > 0.2 { (posed.face - origin.x) / along.x } else { 0.0 };
            // How far beyond each end the rest of the object begins: a shut panel ends where its frame begins.
            let beyond = |p: &Point3<f64>, out: &Vector3<f64>| {
                let side = lift(across, 0.0);
                rest.iter()
                    .map(|q| q - p)
                    .filter(|d| d.dot(&side).abs() < 0.04 && (p[k] + d[k] - middle).abs() < 0.35 * (s.high[k] - s.low[k]))
                    .map(|d| d.dot(out))
                    .filter(|t| *t > -0.03)
                    .fold(0.25, f64::min)
            };
            let thick = if sign > 0.0 { [behind, before] } else { [-before, -behind] };
            let mut own = vec![
                along.x,
                along.y,
                along.z,
                thick[0] * 10.0,
                thick[1] * 10.0,
                to_face * 10.0,
                beyond(&origin, &-along) * 10.0,
                beyond(&other, &along) * 10.0,
            ];
            for m in 0..3 {
                own.push((origin[m] - posed.low[m]) / size[m].max(1e-3));
            }
            own.push((origin.x - posed.face) * 10.0);
            own.push(length * 2.0);
            own.extend([ends(&origin) * 5.0, ends(&other) * 5.0]);
            match grip {
                Some((at, spread)) => {
                    let t = (at - origin).dot(&along) / length.max(0.02);
                    let w = (at[k] - s.low[k]) / (s.high[k] - s.low[k]).max(0.02);
                    let level = spread[k] / (spread.norm() + 1e-3);
                    own.extend([1.0, t, w, level]);
                }
                None => own.extend([0.0, 0.5, 0.5, 0.5]),
            }
            // Lips and notches at either end.
            let reach = (s.low[k].max(posed.low[k]), s.high[k].min(posed.high[k]));
            for (p, inward) in [(&origin, along), (&other, -along)] {
                own.extend(if has_stroke { profile(posed, p, &inward, k, reach, (&outward, panel)) } else { [0.0; 2] });
            }
            let c =
                Candidate { number: 0, slides: false, axis, origin, along, across: lift(across * sign, 0.0), length, features: Vec::new() };
            // Where the rest of the object ends, seen from here: a hinge that is hidden is at an edge of it, most likely.
            for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let mut corner = origin;
                (corner[i], corner[j]) = (edges[a][i], edges[b][j]);
                own.extend(c.residual(&corner).map(|x| x * RESIDUAL * 5.0));
            }
            push(&mut all, c, &own);
        }
    }
    all
}

fn flipped(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.y, v.z)
}

impl Candidate {
    /// Which of a mirror's candidates is this one's image.
    pub(crate) fn image(&self, mirror: &[Self]) -> Option<usize> {
        self.nearest(mirror, flipped(&self.axis), Point3::from(flipped(&self.origin.coords)))
    }

    /// Which of the candidates of nearly the same part is this one.
    pub(crate) fn alike(&self, others: &[Self]) -> Option<usize> {
        self.nearest(others, self.axis, self.origin)
    }

    /// The candidate of this one's kind that is nearest to an axis at a place.
    fn nearest(&self, others: &[Self], axis: Vector3<f64>, origin: Point3<f64>) -> Option<usize> {
        let alike = |c: &Self| c.slides == self.slides && if c.slides { c.axis.dot(&axis) > 0.9 } else { c.axis.dot(&axis).abs() > 0.9 };
        let off = |k: &usize| (others[*k].origin - origin).norm_squared();
        (0..others.len()).filter(|k| alike(&others[*k])).min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// Does the direction across the section keep its sign in the mirror?
    pub(crate) fn across_sign(&self, image: &Self) -> f32 {
        if flipped(&self.across).dot(&image.across) < 0.0 { -1.0 } else { 1.0 }
    }

    /// The point of a line that is nearest the part, across the axis, as residuals of this candidate.
    pub(crate) fn residual(&self, point: &Point3<f64>) -> [f64; 2] {
        let d = point - self.origin;
        [d.dot(&self.along) / RESIDUAL, d.dot(&self.across) / RESIDUAL]
    }

    /// The origin with residuals applied.
    pub(crate) fn corrected(&self, residual: [f64; 2]) -> Point3<f64> {
        self.origin + self.along * (residual[0] * RESIDUAL) + self.across * (residual[1] * RESIDUAL)
    }
}
