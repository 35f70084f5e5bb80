//! Contact points of each pair of shapes: one function a pair, named by it.
//!
//! The first shape is A, the second B; normals point from B to A. Planes are always B; a sphere is A against all but planes' sake,
//! a capsule is A against polytopes.

use nalgebra::{Matrix3, Vector3};

use super::feature::{Feature, Slide};
use super::point::{Found, Manifold};
use super::polytope::Placed;

/// A half space: it fills what lies below the plane through `p` with normal `n`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub n: Vector3<f64>,
    pub p: Vector3<f64>,
}

/// A ball of A on a plane of B.
pub(crate) fn ball_plane(x: &Vector3<f64>, radius: f64, plane: &Plane, margin: f64, id: u32, out: &mut Manifold) {
    let depth = radius - plane.n.dot(&(x - plane.p));
    if depth > -margin {
        let feature = Feature::Face { x: *x, motion: Slide::Vertex, of_a: false };
        out.push(Found { p: x - plane.n * (radius - 0.5 * depth), n: plane.n, depth, feature, id });
    }
}

/// Two balls. Balls with one centre are parted upwards, and that has no derivative.
pub(crate) fn ball_ball((x, a): (&Vector3<f64>, f64), (y, b): (&Vector3<f64>, f64), margin: f64, id: u32, out: &mut Manifold) {
    let between = x - y;
    let r = between.norm();
    let depth = a + b - r;
    if depth > -margin {
        let n = if r > 1e-12 { between / r } else { Vector3::z() };
        let feature = Feature::Point { x: *x, line: None, r, reach: b, of_a: false };
        out.push(Found { p: y + n * (b - 0.5 * depth), n, depth, feature, id });
    }
}

/// A ball of A against a rod of B.
pub(crate) fn ball_rod((x, a): (&Vector3<f64>, f64), (ends, b): ([Vector3<f64>; 2], f64), margin: f64, id: u32, out: &mut Manifold) {
    let d = ends[1] - ends[0];
    let t = d.dot(&(x - ends[0])) / d.norm_squared();
    if t <= 0.0 || t >= 1.0 || t.is_nan() {
        return ball_ball((x, a), (&ends[usize::from(t >= 1.0)], b), margin, id, out);
    }
    let on = ends[0] + d * t;
    let between = x - on;
    let r = between.norm();
    let depth = a + b - r;
    if depth > -margin {
        let e = d.normalize();
        let n = if r > 1e-12 { between / r } else { perpendicular(&e) };
        let feature = Feature::Point { x: *x, line: Some(e), r, reach: b, of_a: false };
        out.push(Found { p: on + n * (b - 0.5 * depth), n, depth, feature, id });
    }
}

/// Two rods: where they cross, or, side by side, at the ends of the stretch that they share.
pub(crate) fn rod_rod((p, a): ([Vector3<f64>; 2], f64), (q, b): ([Vector3<f64>; 2], f64), margin: f64, out: &mut Manifold) {
    let (d, e) = (p[1] - p[0], q[1] - q[0]);
    let cross = d.cross(&e);
    let squared = cross.norm_squared();
    if squared > 1e-8 * d.norm_squared() * e.norm_squared() {
        let w = q[0] - p[0];
        let (s, t) = (w.cross(&e).dot(&cross) / squared, w.cross(&d).dot(&cross) / squared);
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            let (x_a, x_b) = (p[0] + d * s, q[0] + e * t);
            let unit = cross / squared.sqrt();
            let between = unit.dot(&(x_a - x_b));
            let sign = if between < 0.0 { -1.0 } else { 1.0 };
            let (n, gap) = (unit * sign, between.abs());
            let depth = a + b - gap;
            if depth > -margin {
                let feature = Feature::Lines { x_a, e_a: d.normalize(), e_b: e.normalize(), sign, gap, reach: b };
                out.push(Found { p: x_b + n * (b - 0.5 * depth), n, depth, feature, id: 3 << 24 });
            }
            return;
        }
    }
    // An end of one against the other. Nearly parallel rods keep two of these, others the nearest.
    let parallel = squared <= 1e-4 * d.norm_squared() * e.norm_squared();
    let first = out.found.len();
    for (k, x) in p.iter().enumerate() {
        let t = e.dot(&(x - q[0])) / e.norm_squared();
        if !parallel || (0.0..=1.0).contains(&t) {
            ball_rod((x, a), (q, b), margin, k as u32, out);
        }
    }
    for (k, x) in q.iter().enumerate() {
        let t = d.dot(&(x - p[0])) / d.norm_squared();
        if (0.0..=1.0).contains(&t) {
            let on = p[0] + d * t;
            let between = on - x;
            let r = between.norm();
            let depth = a + b - r;
            if depth > -margin {
                let e = d.normalize();
                let n = if r > 1e-12 { between / r } else { perpendicular(&e) };
                let feature = Feature::Point { x: *x, line: Some(e), r, reach: a, of_a: true };
                out.push(Found { p: x + n * (b - 0.5 * depth), n, depth, feature, id: 2 + k as u32 });
            }
        }
    }
    if out.found.len() == first && parallel {
        for (k, x) in p.iter().enumerate() {
            ball_rod((x, a), (q, b), margin, k as u32, out);
        }
        keep_deepest(first, out);
    } else if !parallel {
        keep_deepest(first, out);
    }
}

fn keep_deepest(first: usize, out: &mut Manifold) {
    let deepest = out.found[first..].iter().copied().max_by(|a, b| a.depth.total_cmp(&b.depth));
    out.found.truncate(first);
    out.found.extend(deepest);
}

/// Corners of a polytope of A under a plane of B.
pub(crate) fn polytope_plane(at: &Placed, plane: &Plane, margin: f64, out: &mut Manifold) {
    for (k, v) in at.vertices.iter().enumerate() {
        ball_plane(v, 0.0, plane, margin, k as u32, out);
    }
}

/// A box of A on a plane of B.
pub(crate) fn box_plane((R, p, half): (&Matrix3<f64>, &Vector3<f64>, &Vector3<f64>), plane: &Plane, margin: f64, out: &mut Manifold) {
    let m = R.tr_mul(&plane.n);
    let center = plane.n.dot(&(p - plane.p));
    if center - (m.x.abs() * half.x + m.y.abs() * half.y + m.z.abs() * half.z) > margin {
        return;
    }
    for k in 0..8 {
        let sign = |bit: u32| if k & bit == 0 { -1.0 } else { 1.0 };
        let x = Vector3::new(sign(1) * half.x, sign(2) * half.y, sign(4) * half.z);
        if center + m.dot(&x) < margin {
            ball_plane(&(p + R * x), 0.0, plane, margin, k, out);
        }
    }
}

/// Leaning by less than this (sine of the angle to the normal) a cylinder stands on corners fixed to it.
const STANDS: f64 = 0.02;

/// A cylinder of A on a plane of B: the lowest points of both rims; four or eight fixed ones where it stands upright.
pub(crate) fn cylinder_plane(
    (R, p): (&Matrix3<f64>, &Vector3<f64>),
    (radius, half): (f64, f64),
    plane: &Plane,
    margin: f64,
    out: &mut Manifold,
) {
    let axis = R.column(2).into_owned();
    let across = plane.n - axis * plane.n.dot(&axis);
    let size = across.norm();
    for (k, center) in [p - axis * half, p + axis * half].into_iter().enumerate() {
        if size < STANDS {
            for i in 0..4 {
                let side = R.column(i & 1) * if i < 2 { radius } else { -radius };
                ball_plane(&(center + side), 0.0, plane, margin, (4 * k + i) as u32, out);
            }
            continue;
        }
        let x = center - across * (radius / size);
        let depth = -plane.n.dot(&(x - plane.p));
        if depth > -margin {
            let feature = Feature::Rim { center, axis, radius };
            out.push(Found { p: x + plane.n * (0.5 * depth), n: plane.n, depth, feature, id: k as u32 });
        }
    }
}

/// Any unit vector across `e`.
fn perpendicular(e: &Vector3<f64>) -> Vector3<f64> {
    let k = e.iamin();
    e.cross(&Vector3::ith(k, 1.0)).normalize()
}
