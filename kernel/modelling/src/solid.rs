//! Shapes of parts: each flat superpoint becomes a slab as thick as its noise, each lump a stack of small bars. All are closed, and
//! none touches another, so that every edge of a mesh has two faces.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use sagci_model::TriangleMesh;

use crate::analysis::Analysis;
use crate::grid::steps;

/// A box at a pose in W.
#[derive(Debug, Clone)]
pub(crate) struct Slab {
    pub(crate) X_WG: Isometry3<f64>,
    pub(crate) half: Vector3<f64>,
}

/// Shapes of one part.
pub(crate) struct Shapes {
    /// Closed surface in W.
    pub(crate) mesh: TriangleMesh,
    /// A few boxes for collision, in W.
    pub(crate) boxes: Vec<Slab>,
}

/// Least half thickness of a slab, m.
const THIN: f64 = 0.002;
/// Most of it, m: what is thicker than that is the camera's noise, and a surface amid its points is nearer to them than two far apart.
const THICK: f64 = 0.0048;
/// As far as a point may lie from the surface, m.
const NEAR: f64 = 0.005;
/// Most boxes for collision.
const BOXES: usize = 32;

/// Share of a part's points that its surface has to hold, with a little to spare.
const HELD: f64 = 0.96;

/// The shapes of some superpoints, and of thinned points that belong to none of them. `all` are the part's points as they came: where too many
/// of them lie off the slabs, since views disagree or the camera is noisy, the fullest cells of those get bars as well.
pub(crate) fn shapes(analysis: &Analysis, pieces: &[usize], loose: &[Point3<f64>], all: &[Point3<f64>]) -> Shapes {
    let mut mesh = TriangleMesh::default();
    let mut stacked: Vec<Point3<f64>> = loose.to_vec();
    let mut boxes: Vec<(usize, Slab)> = Vec::new();
    let mut slabs: Vec<Slab> = Vec::new();
    let to_world = UnitQuaternion::from_rotation_matrix(&analysis.R_AW.inverse());
    for (number, i) in pieces.iter().enumerate() {
        let s = &analysis.superpoints[*i];
        let points: Vec<Point3<f64>> = s.points.iter().map(|p| analysis.points[*p as usize]).collect();
        let (slab, tight) = slab(&points, s.flat.then_some(s.normal), s.axial, s.residual, analysis.scale.noise, number);
        let world = Slab { X_WG: Isometry3::from_parts(Translation3::identity(), to_world) * slab.X_WG, half: slab.half };
        if s.flat && tight {
            add_box(&mut mesh, &world.X_WG, &world.half);
            slabs.push(world.clone());
        } else {
            stacked.extend(&points);
        }
        boxes.push((points.len(), world));
    }
    // All in one, so that no two bars are the same.
    let size = (1.2 * analysis.scale.spacing).clamp(0.006, 0.009);
    let mut cells: Vec<[i64; 3]> = stacked.iter().map(|p| steps(p, size)).collect();
    cells.sort_unstable();
    cells.dedup();
    let all: Vec<Point3<f64>> = all.iter().map(|p| analysis.R_AW * p).collect();
    cells.extend(lacking(&all, &slabs, to_world, &cells, size));
    bars(&mut mesh, cells, size, to_world);
    boxes.sort_by_key(|b| std::cmp::Reverse(b.0));
    boxes.truncate(BOXES);
    Shapes { mesh, boxes: boxes.into_iter().map(|b| b.1).collect() }
}

/// How far behind what moves a body stands that nothing shows, m, and half as thick as it is.
const BEHIND: f64 = 0.01;
const BOARD: f64 = 0.005;

/// A board behind what moves, upright, as wide and as high as that: a body of which nothing was seen, all of it being behind its doors.
/// `points` of all that moves and `front`, which way they face, in W.
pub(crate) fn behind(points: &[Point3<f64>], front: &Vector3<f64>) -> Shapes {
    let out = Vector3::new(front.x, front.y, 0.0).try_normalize(1e-6).unwrap_or(-Vector3::y());
    let across = Vector3::z().cross(&out);
    let [out_of, wide, high] = [out, across, Vector3::z()].map(|e| {
        let along = || points.iter().map(|p| p.coords.dot(&e));
        (along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max))
    });
    let middle = |(a, b): (f64, f64)| (a + b) / 2.0;
    let half = |(a, b): (f64, f64)| ((b - a) / 2.0).max(BOARD);
    let center = out * (out_of.0 - BEHIND - BOARD) + across * middle(wide) + Vector3::z() * middle(high);
    let R = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[out, across, Vector3::z()])));
    let board = Slab { X_WG: Isometry3::from_parts(Translation3::from(center), R), half: Vector3::new(BOARD, half(wide), half(high)) };
    let mut mesh = TriangleMesh::default();
    add_box(&mut mesh, &board.X_WG, &board.half);
    Shapes { mesh, boxes: vec![board] }
}

fn range(points: &[Point3<f64>], direction: &Vector3<f64>, cut: f64) -> (f64, f64) {
    let mut t: Vec<f64> = points.iter().map(|p| p.coords.dot(direction)).collect();
    t.sort_by(f64::total_cmp);
    let k = ((t.len() - 1) as f64 * cut) as usize;
    (t[k], t[t.len() - 1 - k])
}

/// The box about some points with a face along a normal; for lumps along the axes of A. And do the points fill it like a sheet?
fn slab(
    points: &[Point3<f64>],
    normal: Option<Vector3<f64>>,
    axial: Option<usize>,
    residual: f64,
    noise: f64,
    number: usize,
) -> (Slab, bool) {
    let n = match (normal, axial) {
        (Some(n), _) => n,
        _ => Vector3::x(),
    };
    let level = Vector3::z().cross(&n);
    let e1 = if level.norm() > 0.1 { level.normalize() } else { (Vector3::x() - n * n.x).normalize() };
    let e2 = n.cross(&e1);
    let R = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[n, e1, e2]));
    let cut = if normal.is_some() { 0.003 } else { 0.0 };
    let mut center = Vector3::zeros();
    let mut half = Vector3::zeros();
    for (k, e) in [n, e1, e2].iter().enumerate() {
        let (a, b) = range(points, e, if k == 0 { 0.02 } else { cut });
        center += e * ((a + b) / 2.0);
        half[k] = ((b - a) / 2.0).max(THIN);
    }
    // Two faces of a thin board may have grown into one piece: then a slab would not hold their points.
    // Nor may more than a few lie far from its faces, as they do where two views disagree.
    let at = center.dot(&n);
    let far = points.iter().filter(|p| (p.coords.dot(&n) - at).abs() > half[0].min(THICK) + NEAR).count();
    let tight = half[0] < 0.0045_f64.max(2.2 * noise) && far * 25 <= points.len();
    if normal.is_some() {
        // Slightly unlike sizes, so that no two slabs share a corner.
        half[0] = half[0].max(2.0 * residual).clamp(THIN, THICK) + 1e-6 * (number as f64 + 1.0);
    }
    (Slab { X_WG: Isometry3::from_parts(Translation3::from(center), UnitQuaternion::from_rotation_matrix(&R)), half }, tight)
}

/// Adds a closed box.
fn add_box(mesh: &mut TriangleMesh, X: &Isometry3<f64>, half: &Vector3<f64>) {
    let base = mesh.vertices.len() as u32;
    for corner in 0..8 {
        let sign = |k: usize| if corner >> k & 1 == 1 { 1.0 } else { -1.0 };
        mesh.vertices.push(X * Point3::from(half.component_mul(&Vector3::new(sign(0), sign(1), sign(2)))));
    }
    for [a, b, c, d] in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
        mesh.triangles.push([base + a, base + b, base + c]);
        mesh.triangles.push([base + a, base + c, base + d]);
    }
}

/// Cells, the fullest first, that hold points off the slabs and off the bars of `cells`: as many as it takes until the surface holds its
/// share. Points in A.
fn lacking(all: &[Point3<f64>], slabs: &[Slab], to_world: UnitQuaternion<f64>, cells: &[[i64; 3]], size: f64) -> Vec<[i64; 3]> {
    let X_GA: Vec<Isometry3<f64>> =
        slabs.iter().map(|s| s.X_WG.inverse() * Isometry3::from_parts(Translation3::identity(), to_world)).collect();
    let held = |p: &Point3<f64>| {
        cells.binary_search(&steps(p, size)).is_ok() || slabs.iter().zip(&X_GA).any(|(s, X)| off_surface(&(X * p), &s.half) < 0.95 * NEAR)
    };
    let mut counts: BTreeMap<[i64; 3], usize> = BTreeMap::new();
    all.iter().filter(|p| !held(p)).for_each(|p| *counts.entry(steps(p, size)).or_default() += 1);
    let mut off: usize = counts.values().sum();
    let mut fullest: Vec<([i64; 3], usize)> = counts.into_iter().collect();
    fullest.sort_by_key(|c| std::cmp::Reverse(c.1));
    let most = ((1.0 - HELD) * all.len() as f64) as usize;
    let mut added = Vec::new();
    for (cell, count) in fullest {
        if off <= most {
            break;
        }
        off -= count;
        added.push(cell);
    }
    added
}

/// Distance of a point from the surface of a box about the origin.
fn off_surface(p: &Point3<f64>, half: &Vector3<f64>) -> f64 {
    let d = p.coords.abs() - half;
    if d.max() < 0.0 { -d.max() } else { d.sup(&Vector3::zeros()).norm() }
}

/// Adds bars of cells: runs along z, each a closed box a little smaller than its cells.
fn bars(mesh: &mut TriangleMesh, mut keys: Vec<[i64; 3]>, size: f64, to_world: UnitQuaternion<f64>) {
    keys.sort_unstable();
    let mut k = 0;
    while k < keys.len() {
        let start = keys[k];
        let mut end = start;
        while k + 1 < keys.len() && keys[k + 1] == [end[0], end[1], end[2] + 1] {
            k += 1;
            end = keys[k];
        }
        k += 1;
        let at = |c: i64| c as f64 * size;
        let low = Vector3::new(at(start[0]), at(start[1]), at(start[2]));
        let high = Vector3::new(at(start[0] + 1), at(start[1] + 1), at(end[2] + 1));
        let X = Isometry3::from_parts(Translation3::identity(), to_world) * Translation3::from((low + high) / 2.0);
        add_box(mesh, &X, &((high - low) / 2.0 - Vector3::repeat(0.02 * size)));
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::behind;

    /// Doors that hide all of a cupboard left its body without any surface, which no engine loads.
    #[test]
    fn a_body_that_nothing_shows_stands_behind_its_doors() {
        let front = Vector3::new(0.6, -0.8, 0.0);
        let across = Vector3::z().cross(&front);
        let door = |i: i32, k: i32| Point3::from(2.0 * front + 0.1 * f64::from(i) * across + Vector3::z() * 0.2 * f64::from(k));
        let points: Vec<Point3<f64>> = (0..5).flat_map(|i| (1..6).map(move |k| door(i, k))).collect();
        let body = behind(&points, &front);
        assert!(body.mesh.is_closed() && body.mesh.volume() > 0.0 && body.boxes.len() == 1);
        let along = |e: Vector3<f64>| {
            let all = body.mesh.vertices.iter().map(move |p| p.coords.dot(&e));
            [all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max)]
        };
        let [near, far] = [along(front)[1], along(front)[0]];
        assert!(near < 1.995 && far > 1.9, "{near} {far}");
        let is = |e: Vector3<f64>, ends: [f64; 2]| along(e).iter().zip(ends).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(is(across, [0.0, 0.4]) && is(Vector3::z(), [0.2, 1.0]));
    }
}
