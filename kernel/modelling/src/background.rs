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

/// Of a door whose leaves swing out of a wall at least this share lies on two planes.
const LEAVES: f64 = 0.93;
/// Planes that are tried for the fullest.
const TRIED: usize = 60;

/// The share of some points that the two fullest planes hold, each as thick as twice `reach`.
fn sheets(points: &[Point3<f64>], local: &[Local], of: &[usize], reach: f64) -> f64 {
    let mut left: Vec<usize> = of.to_vec();
    for _ in 0..2 {
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

/// Which thinned points are before all walls that were found; none if there is no wall.
pub(crate) fn before_walls(thinned: &Thinned, local: &[Local]) -> Option<Vec<bool>> {
    let points = &thinned.points;
    let mut kept = vec![true; points.len()];
    let mut found = false;
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
    for _ in 0..WALLS {
        let Some(wall) = wall(points, local, &kept, (thinned.cell, floor)) else { break };
        found = true;
        for (k, p) in kept.iter_mut().zip(points) {
            *k &= p.coords.dot(&wall.normal) - wall.offset > wall.thick && wall.floor.is_none_or(|z| p.z > z);
        }
    }
    found.then_some(kept)
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
fn outermost(points: &[Point3<f64>], own: &[usize], normal: &Vector3<f64>, total: usize) -> Option<(Vector3<f64>, f64)> {
    let mut offsets: Vec<f64> = own.iter().map(|i| points[*i].coords.dot(normal)).collect();
    offsets.sort_by(f64::total_cmp);
    let enough = (SHARE * total as f64) as usize;
    let at = (0..offsets.len()).find(|k| offsets.get(k + enough).is_some_and(|o| o - offsets[*k] < 0.12))?;
    let middle = offsets[at + enough / 2];
    let (mut normal, mut offset) = (*normal, middle);
    for reach in [0.12, 0.06, 0.04] {
        let on: Vec<Vector2<f64>> = own
            .iter()
            .map(|i| &points[*i])
            .filter(|p| (p.coords.dot(&normal) - offset).abs() < reach)
            .map(|p| Vector2::new(p.x, p.y))
            .collect();
        if on.len() < enough / 2 {
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

/// Is a plane a wall with an object before it? Answers the number of its points as well.
fn check(
    points: &[Point3<f64>],
    local: &[Local],
    kept: &[bool],
    (cell, floor): (f64, Option<f64>),
    (normal, offset): (Vector3<f64>, f64),
) -> Option<(usize, Wall)> {
    let level = normal.cross(&Vector3::z());
    let depth = |i: usize| points[i].coords.dot(&normal) - offset;
    let all: Vec<usize> = (0..points.len()).filter(|i| kept[*i]).collect();
    let mut wall: Vec<usize> = all.iter().copied().filter(|i| depth(*i).abs() < 0.1 && local[*i].normal.dot(&normal).abs() > 0.8).collect();
    if (wall.len() as f64) < SHARE * all.len() as f64 {
        return None;
    }
    wall.sort_by(|a, b| depth(*a).abs().total_cmp(&depth(*b).abs()));
    let thick = (1.3 * depth(wall[wall.len() * 97 / 100]).abs()).max(3.0 * cell).clamp(0.015, 0.1);
    wall.retain(|i| depth(*i).abs() < thick);
    // What is lowest may be the floor.
    let lowest = floor.unwrap_or_else(|| all.iter().map(|i| points[*i].z).fold(f64::INFINITY, f64::min));
    let is_floor = |i: usize| floor.is_some_and(|z| points[i].z < z);
    let others: Vec<usize> = all.iter().copied().filter(|i| depth(*i).abs() >= thick && !is_floor(*i)).collect();
    let behind = others.iter().filter(|i| depth(**i) < 0.0).count();
    if others.len() < 100 || behind * 30 > all.len() {
        return None;
    }
    let range = |of: &[usize], along: &Vector3<f64>| {
        let mut t: Vec<f64> = of.iter().map(|i| points[*i].coords.dot(along)).collect();
        t.sort_by(f64::total_cmp);
        let cut = t.len() / 100;
        (t[cut], t[t.len() - 1 - cut])
    };
    let before: Vec<usize> = others.iter().copied().filter(|i| depth(*i) > IN_WALL).collect();
    if before.len() as f64 <= BEFORE * others.len() as f64 {
        return None;
    }
    // A front stands at one distance from the wall, a leaf that is ajar at many.
    let mut fronts: Vec<f64> = before.iter().copied().filter(|i| local[*i].normal.dot(&normal).abs() > 0.97).map(depth).collect();
    fronts.sort_by(f64::total_cmp);
    let front = (0..fronts.len()).map(|k| fronts.partition_point(|d| *d < fronts[k] + 0.05) - k).max().unwrap_or_default();
    let level_ones = before.iter().filter(|i| local[**i].normal.z.abs() > 0.97).count();
    let boxy = front as f64 > FRONT * before.len() as f64 || level_ones as f64 > LEVEL * before.len() as f64;
    let many_sided = sheets(points, local, &before, f64::max(0.03, 0.7 * thick)) < LEAVES;
    let (own, top) = (range(&wall, &level), range(&wall, &Vector3::z()).1);
    // How far an object reaches beside and above, and the margin by which a wall behind it reaches farther.
    let inside = |object: &[usize]| {
        let (other, other_top) = (range(object, &level), range(object, &Vector3::z()).1);
        let margin = (0.15 * (other.1 - other.0).max(other_top - lowest)).max(0.1);
        let beyond = [other.0 - own.0, own.1 - other.1, top - other_top];
        let reaches = beyond.iter().filter(|b| **b > margin).count() >= 2 && beyond.iter().all(|b| *b >= -margin);
        reaches.then_some((other, other_top, margin))
    };
    // Nearer to the wall its own points stray; but what is no leaf for certain is measured by what lies well before it.
    let of_all = if boxy { inside(&others) } else { None };
    let (other, other_top, margin) = of_all.or_else(|| if many_sided && before.len() >= 100 { inside(&before) } else { None })?;
    // Beside the object all is the wall's: that says how far its points stray.
    let apart = |i: &usize| {
        let (t, z) = (points[*i].coords.dot(&level), points[*i].z);
        !is_floor(*i) && depth(*i).abs() < 0.2 && (t < other.0 - margin || t > other.1 + margin || z > other_top + margin)
    };
    let mut stray: Vec<f64> = all.iter().copied().filter(apart).map(|i| depth(i).abs()).collect();
    stray.sort_by(f64::total_cmp);
    let far = 1.2 * stray.get(stray.len() * 97 / 100).copied().unwrap_or_default();
    let thick = if stray.len() < 50 { thick } else { far.clamp((3.0 * cell).max(0.012), 0.15) };
    let beside = all.iter().filter(|i| is_floor(**i) && local[**i].normal.z.abs() > 0.9).map(|i| points[*i].coords.dot(&level));
    let beside = beside.filter(|t| *t < other.0 - margin || *t > other.1 + margin).count();
    let floor = floor.filter(|_| beside * 100 > all.len());
    Some((wall.len(), Wall { normal, offset, thick, floor }))
}
