//! Walls behind an object: taken away where the object plainly stands before them, kept where the object is in them, as a door is.
//!
//! A wall is an upright plane that reaches beyond all else on two sides or more, with nothing behind it. A floor that goes on beside the
//! object goes with it. What stands before a wall is box-like: much of it lies well before the wall, in one plane along it, on level
//! surfaces, or on more planes than leaves have. A door's leaf lies in the wall or swings out of it.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};

use crate::ground::lowest_level;
use crate::normal::Local;
use crate::prepare::Thinned;

/// Most walls that are taken away: an object may stand in a corner.
const WALLS: usize = 2;
/// Angles of upright planes that are looked at, a degree each.
const ANGLES: usize = 180;
/// Least share of all points on a wall.
const SHARE: f64 = 0.08;
/// Nearer to a wall than this is in it, m: a frame, a handle, a leaf that is set forward.
const IN_WALL: f64 = 0.12;
/// Least share of what is no wall that lies farther out; of that, least shares in one plane along the wall, or on level surfaces.
const BEFORE: f64 = 0.7;
const FRONT: f64 = 0.15;
const LEVEL: f64 = 0.1;
/// What a front's points may differ in distance from the wall, m, and the cosine of how far it may be turned from it: by 5 degrees.
const DEEP: f64 = 0.05;
const ALONG: f64 = 0.9962;

/// What stands on a floor begins no higher above it, m.
const STANDS: f64 = 0.1;
/// What lies nearer than [`IN_WALL`] is in the wall, unless such a share is on level surfaces, as a low box's top is and no door's.
const TOP: f64 = 0.25;
/// Fewest points of an object.
const FEWEST: usize = 100;
/// A wall may end below an object's top where a picture ends, by such a share of its height.
const CUT: f64 = 0.4;
/// Of a door whose leaves swing out of a wall at least this share lies on two planes.
const LEAVES: f64 = 0.93;
/// Planes that are tried for the fullest.
const TRIED: usize = 60;

/// The share of some points that the fullest planes hold, so many, each as thick as twice `reach`.
fn sheets(points: &[Point3<f64>], local: &[Local], of: &[usize], (count, reach): (usize, f64)) -> f64 {
    let mut left: Vec<usize> = of.to_vec();
    for _ in 0..count {
        let on = |p: &Vector3<f64>, n: &Vector3<f64>| -> Vec<usize> {
            left.iter().copied().filter(|i| (points[*i].coords - p).dot(n).abs() < reach).collect()
        };
        let mut best: Vec<usize> = Vec::new();
        for i in left.iter().copied().step_by(left.len() / TRIED + 1) {
            let mut held = on(&points[i].coords, &local[i].normal);
            // A normal is as noisy as its few points.
            for _ in 0..2 {
                if held.len() < 10 {
                    break;
                }
                let mean = held.iter().map(|i| points[*i].coords).sum::<Vector3<f64>>() / held.len() as f64;
                let spread = held.iter().map(|i| points[*i].coords - mean).map(|d| d * d.transpose()).sum::<Matrix3<f64>>();
                let e = spread.symmetric_eigen();
                held = on(&mean, &e.eigenvectors.column(e.eigenvalues.imin()).into_owned());
            }
            if held.len() > best.len() {
                best = held;
            }
        }
        best.sort_unstable();
        left.retain(|i| best.binary_search(i).is_err());
    }
    1.0 - left.len() as f64 / of.len().max(1) as f64
}

/// An upright plane: `normal . p = offset`, everything else on its positive side.
struct Wall {
    normal: Vector3<f64>,
    offset: f64,
    /// What lies nearer is the wall's, m.
    thick: f64,
    /// A floor goes on beside the object, up to this height, m.
    floor: Option<f64>,
}

/// A plane: its normal, and what the normal's product with its points is.
type Plane = (Vector3<f64>, f64);

/// Walls that were found.
pub(crate) struct Walls {
    /// Which thinned points are before all of them.
    pub(crate) before: Vec<bool>,
    planes: Vec<Plane>,
}

/// The walls of a cloud; none if there is no wall. `known` are those of the cloud that it was cropped from: so much need not be seen of them
/// any more to know them by.
pub(crate) fn walls(thinned: &Thinned, local: &[Local], known: Option<&Walls>) -> Option<Walls> {
    let points = &thinned.points;
    let mut kept = vec![true; points.len()];
    let mut planes = Vec::new();
    let mut known = known.map(|w| w.planes.clone()).unwrap_or_default().into_iter();
    // Far away a floor is as thick as the camera's noise there.
    let level = |i: &usize| local[*i].normal.z.abs() > 0.94 && local[*i].residual.is_finite();
    let mut residuals: Vec<f64> = (0..points.len()).filter(level).map(|i| local[i].residual).collect();
    residuals.sort_by(f64::total_cmp);
    let band = (3.0 * residuals.get(residuals.len() / 2).copied().unwrap_or_default()).max(3.0 * thinned.cell).max(0.012);
    // Little lies below a floor; a table's top is none.
    let lowest = lowest_level(points, local, band).filter(|z| points.iter().filter(|p| p.z < z - band).count() * 50 < points.len());
    let floor = lowest.map(|z| {
        let on = |i: &usize| (points[*i].z - z).abs() < 0.1 && local[*i].normal.z.abs() > 0.8;
        let mut off: Vec<f64> = (0..points.len()).filter(on).map(|i| (points[i].z - z).abs()).collect();
        off.sort_by(f64::total_cmp);
        z + (1.3 * off.get(off.len() * 95 / 100).copied().unwrap_or_default()).clamp(band, f64::max(band, 0.1))
    });
    while planes.len() < WALLS {
        let fine = (thinned.cell, floor);
        let again = known.find_map(|plane| known_wall(points, local, &kept, fine, &plane));
        let Some(wall) = again.or_else(|| wall(points, local, &kept, fine)) else { break };
        planes.push((wall.normal, wall.offset));
        for (k, p) in kept.iter_mut().zip(points) {
            *k &= p.coords.dot(&wall.normal) - wall.offset > wall.thick && wall.floor.is_none_or(|z| p.z > z);
        }
    }
    (!planes.is_empty()).then_some(Walls { before: kept, planes })
}

/// A wall that is known from a coarser look.
fn known_wall(points: &[Point3<f64>], local: &[Local], kept: &[bool], fine: (f64, Option<f64>), plane: &Plane) -> Option<Wall> {
    let own: Vec<usize> = (0..points.len()).filter(|i| kept[*i] && local[*i].normal.dot(&plane.0).abs() > 0.9).collect();
    let plane = fitted(points, &own, plane, 30)?;
    let part = Part::of(points, local, kept, fine, plane)?;
    let (other, other_top) = (part.range(&part.others, &part.level), part.range(&part.others, &Vector3::z()).1);
    Some(part.thick_as(other, other_top))
}

/// The largest wall among points that are kept.
fn wall(points: &[Point3<f64>], local: &[Local], kept: &[bool], fine: (f64, Option<f64>)) -> Option<Wall> {
    let upright: Vec<usize> =
        (0..points.len()).filter(|i| kept[*i] && local[*i].normal.z.abs() < 0.2 && local[*i].residual.is_finite()).collect();
    let total = kept.iter().filter(|k| **k).count();
    let mut votes = vec![0.0; ANGLES];
    let angle = |i: usize| local[i].normal.y.atan2(local[i].normal.x).rem_euclid(PI);
    for i in &upright {
        votes[((angle(*i) / PI * ANGLES as f64) as usize).min(ANGLES - 1)] += 1.0;
    }
    let wide = |k: usize| votes[(k + ANGLES - 1) % ANGLES] + votes[k] + votes[(k + 1) % ANGLES];
    let mut order: Vec<usize> = (0..ANGLES).filter(|k| wide(*k) > SHARE * total as f64).collect();
    order.sort_by(|a, b| wide(*b).total_cmp(&wide(*a)).then(a.cmp(b)));
    let mut tried: Vec<usize> = Vec::new();
    let mut best: Option<(usize, Wall)> = None;
    for k in order {
        let near = |t: &usize| (k + ANGLES - t) % ANGLES < 5 || (t + ANGLES - k) % ANGLES < 5;
        if tried.len() >= 4 || tried.iter().any(near) {
            continue;
        }
        tried.push(k);
        let (sine, cosine) = ((k as f64 + 0.5) / ANGLES as f64 * PI).sin_cos();
        let normal = Vector3::new(cosine, sine, 0.0);
        // The outermost planes on either side: nothing may lie behind a wall.
        let own: Vec<usize> = upright.iter().copied().filter(|i| local[*i].normal.dot(&normal).abs() > 0.97).collect();
        for side in [1.0, -1.0] {
            let found = outermost(points, &own, &(normal * side), total).and_then(|seed| check(points, local, kept, fine, seed));
            if let Some((size, wall)) = found
                && best.as_ref().is_none_or(|b| size > b.0)
            {
                best = Some((size, wall));
            }
        }
    }
    best.map(|b| b.1)
}

/// The hindmost plane across a direction with enough points on it, fitted: its points' mean and its normal.
fn outermost(points: &[Point3<f64>], own: &[usize], normal: &Vector3<f64>, total: usize) -> Option<Plane> {
    let mut offsets: Vec<f64> = own.iter().map(|i| points[*i].coords.dot(normal)).collect();
    offsets.sort_by(f64::total_cmp);
    let enough = (SHARE * total as f64) as usize;
    let at = (0..offsets.len()).find(|k| offsets.get(k + enough).is_some_and(|o| o - offsets[*k] < 0.12))?;
    fitted(points, own, &(*normal, offsets[at + enough / 2]), enough / 2)
}

/// An upright plane fitted to at least so many points near it.
fn fitted(points: &[Point3<f64>], own: &[usize], plane: &Plane, least: usize) -> Option<Plane> {
    let (mut normal, mut offset) = *plane;
    for reach in [0.12, 0.06, 0.04] {
        let on: Vec<Vector2<f64>> = own
            .iter()
            .map(|i| &points[*i])
            .filter(|p| (p.coords.dot(&normal) - offset).abs() < reach)
            .map(|p| Vector2::new(p.x, p.y))
            .collect();
        if on.len() < least {
            return None;
        }
        let mean = on.iter().sum::<Vector2<f64>>() / on.len() as f64;
        let spread = on.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix2<f64>>();
        let e = spread.symmetric_eigen();
        let across = e.eigenvectors.column(e.eigenvalues.imin()).into_owned();
        let turned = Vector3::new(across.x, across.y, 0.0);
        normal = turned * if turned.dot(&normal) < 0.0 { -1.0 } else { 1.0 };
        offset = mean.dot(&Vector2::new(normal.x, normal.y));
    }
    Some((normal, offset))
}

/// A plane that may be a wall, and the rest.
struct Part<'a> {
    points: &'a [Point3<f64>],
    local: &'a [Local],
    cell: f64,
    floor: Option<f64>,
    plane: Plane,
    /// Along the plane.
    level: Vector3<f64>,
    /// What lies nearer to the plane is on it, m.
    thick: f64,
    /// All points, those on the plane, and those on neither the plane nor the floor.
    all: Vec<usize>,
    wall: Vec<usize>,
    others: Vec<usize>,
}

impl<'a> Part<'a> {
    fn of(points: &'a [Point3<f64>], local: &'a [Local], kept: &[bool], (cell, floor): (f64, Option<f64>), plane: Plane) -> Option<Self> {
        let (normal, offset) = plane;
        let depth = |i: usize| points[i].coords.dot(&normal) - offset;
        let all: Vec<usize> = (0..points.len()).filter(|i| kept[*i]).collect();
        let mut wall: Vec<usize> =
            all.iter().copied().filter(|i| depth(*i).abs() < 0.1 && local[*i].normal.dot(&normal).abs() > 0.8).collect();
        wall.sort_by(|a, b| depth(*a).abs().total_cmp(&depth(*b).abs()));
        let thick = (1.3 * depth(*wall.get(wall.len() * 97 / 100)?).abs()).max(3.0 * cell).clamp(0.015, 0.1);
        wall.retain(|i| depth(*i).abs() < thick);
        let is_floor = |i: usize| floor.is_some_and(|z| points[i].z < z);
        let others: Vec<usize> = all.iter().copied().filter(|i| depth(*i).abs() >= thick && !is_floor(*i)).collect();
        let level = normal.cross(&Vector3::z());
        (others.len() >= FEWEST).then_some(Self { points, local, cell, floor, plane, level, thick, all, wall, others })
    }

    fn depth(&self, i: usize) -> f64 {
        self.points[i].coords.dot(&self.plane.0) - self.plane.1
    }

    fn is_floor(&self, i: usize) -> bool {
        self.floor.is_some_and(|z| self.points[i].z < z)
    }

    /// How far points reach, but for the outermost of a hundred.
    fn range(&self, of: &[usize], along: &Vector3<f64>) -> (f64, f64) {
        let mut t: Vec<f64> = of.iter().map(|i| self.points[*i].coords.dot(along)).collect();
        t.sort_by(f64::total_cmp);
        let cut = t.len() / 100;
        (t[cut], t[t.len() - 1 - cut])
    }

    fn sheets(&self, of: &[usize], count: usize) -> f64 {
        sheets(self.points, self.local, of, (count, f64::max(0.03, 0.7 * self.thick)))
    }

    /// The most of some points that are a front: they lie along the wall at one distance from it. A leaf that is ajar lies at many; where it is that
    /// by little, it still slants.
    fn front(&self, of: &[usize]) -> usize {
        let out = &self.plane.0;
        let mut fronts: Vec<(f64, Vector3<f64>)> = of
            .iter()
            .map(|i| (self.depth(*i), self.local[*i].normal * self.local[*i].normal.dot(out).signum()))
            .filter(|(_, normal)| normal.dot(out) > 0.97)
            .collect();
        fronts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let deep = |k: usize| &fronts[k..fronts.partition_point(|x| x.0 < fronts[k].0 + DEEP)];
        let Some(fullest) = (0..fronts.len()).map(deep).max_by_key(|f| f.len()) else { return 0 };
        let mean = fullest.iter().map(|x| x.1).sum::<Vector3<f64>>().normalize();
        if mean.dot(out) > ALONG { fullest.len() } else { 0 }
    }

    /// By how much more a wall reaches than what stands before it: a share of how large that is.
    fn margin(&self, other: (f64, f64), other_top: f64) -> f64 {
        // What is lowest may be the floor.
        let lowest = self.floor.unwrap_or_else(|| self.all.iter().map(|i| self.points[*i].z).fold(f64::INFINITY, f64::min));
        (0.15 * (other.1 - other.0).max(other_top - lowest)).max(0.06)
    }

    /// The wall before which something reaches from one place to another, and so high.
    fn thick_as(&self, other: (f64, f64), other_top: f64) -> Wall {
        let margin = self.margin(other, other_top);
        // Beside the object all is the wall's: that says how far its points stray.
        let apart = |i: &usize| {
            let (t, z) = (self.points[*i].coords.dot(&self.level), self.points[*i].z);
            !self.is_floor(*i) && self.depth(*i).abs() < 0.2 && (t < other.0 - margin || t > other.1 + margin || z > other_top + margin)
        };
        let mut stray: Vec<f64> = self.all.iter().copied().filter(apart).map(|i| self.depth(i).abs()).collect();
        stray.sort_by(f64::total_cmp);
        let far = 1.2 * stray.get(stray.len() * 97 / 100).copied().unwrap_or_default();
        let least = (3.0 * self.cell).max(0.012);
        let thick = if stray.len() < 50 { self.thick } else { far.clamp(least, f64::max(least, 0.15)) };
        let floor = self.all.iter().filter(|i| self.is_floor(**i) && self.local[**i].normal.z.abs() > 0.9);
        let beside = floor.map(|i| self.points[*i].coords.dot(&self.level));
        let beside = beside.filter(|t| *t < other.0 - margin || *t > other.1 + margin).count();
        let floor = self.floor.filter(|_| beside * 100 > self.all.len());
        Wall { normal: self.plane.0, offset: self.plane.1, thick, floor }
    }
}

/// Is a plane a wall with an object before it? Answers the number of its points as well.
fn check(points: &[Point3<f64>], local: &[Local], kept: &[bool], fine: (f64, Option<f64>), plane: Plane) -> Option<(usize, Wall)> {
    let part = Part::of(points, local, kept, fine, plane)?;
    let (all, others) = (part.all.len(), &part.others);
    let behind = others.iter().filter(|i| part.depth(**i) < 0.0).count();
    if (part.wall.len() as f64) < SHARE * all as f64 || behind * 30 > all || behind * 10 > others.len() {
        return None;
    }
    let level = |of: &[usize]| of.iter().filter(|i| local[**i].normal.z.abs() > 0.97).count() as f64;
    let before: Vec<usize> = others.iter().copied().filter(|i| part.depth(*i) > IN_WALL).collect();
    if before.len() as f64 <= BEFORE * others.len() as f64 && level(others) < TOP * others.len() as f64 {
        return None;
    }
    let before = if before.len() < FEWEST { others.clone() } else { before };
    let boxy = part.front(&before) as f64 > FRONT * before.len() as f64 || level(&before) > LEVEL * before.len() as f64;
    let many_sided = part.sheets(&before, 2) < LEAVES;
    let up = Vector3::z();
    let (own, (bottom, top)) = (part.range(&part.wall, &part.level), part.range(&part.wall, &up));
    // A wall comes down to the floor, which an open leaf need not; and what hangs above it, all in one plane, is a leaf.
    let hangs = |z: f64| part.range(others, &up).0 > z + STANDS && part.sheets(&before, 1) > LEAVES;
    if part.floor.is_some_and(|z| bottom > z + STANDS || hangs(z)) {
        return None;
    }
    // How far an object reaches beside and above. A wall behind it reaches farther; but a picture that ends above the object shows even less of
    // what is farther away.
    let inside = |object: &[usize]| {
        let (other, (low, other_top)) = (part.range(object, &part.level), part.range(object, &up));
        let margin = part.margin(other, other_top);
        let [left, right, above] = [other.0 - own.0, own.1 - other.1, top - other_top];
        let beside = left > margin && right > margin && above > -CUT * (other_top - low);
        let reaches = (left > margin || right > margin) && above > margin && left.min(right) >= -margin;
        (beside || reaches).then_some((other, other_top))
    };
    // Nearer to the wall its own points stray; but what is no leaf for certain is measured by what lies well before it.
    let of_all = if boxy { inside(others) } else { None };
    let (other, other_top) = of_all.or_else(|| if many_sided && before.len() >= FEWEST { inside(&before) } else { None })?;
    Some((part.wall.len(), part.thick_as(other, other_top)))
}
