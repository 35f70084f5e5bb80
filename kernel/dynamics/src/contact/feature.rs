//! What touches what at one contact point, and how the point moves with the two bodies.
//!
//! A contact has a point `p` half way between the two surfaces, a normal `n` from body B to body A, and a depth `d` (positive
//! where the bodies overlap). Let A move by the small twist `X = [turn; shift]` (world axes, at the world's origin) while B
//! stands still. A point `x` of A then moves by `W(x) X`, `W(x) = [-[x], 1]`. Each kind of contact says how `p`, `n` and `d`
//! follow, in closed form:
//!
//! * [`Feature::Face`]: a face of B, and a point of A's surface that moves with `C W(x)`. A vertex has `C = 1`, the crossing of an edge
//!   with direction `e` and the side plane with normal `m` of B's face `C = 1 - e m^T / (m . e)`, a corner of B's face seen on A's
//!   face with normal `a` is `C = n a^T / (a . n)`. A sphere on a face has `x` at its centre.
//! * [`Feature::Point`]: a rounded point of A against a rounded point or line (direction `e`) of B, a distance `r` apart: `n`
//!   turns with `dn = (1 - n n^T - e e^T) W(x) X / r`. These are the curvature terms.
//! * [`Feature::Lines`]: two rounded lines that cross.
//! * [`Feature::Rim`]: the lowest point of a circle of A (a cylinder's rim) over a plane of B.
//!
//! The first two also occur with the roles of A and B exchanged: moving A by `X` is moving both by `X` and B by `-X`.
//!
//! Not valid: where the kind of contact changes (a vertex slides off a face's edge), between parallel edges, for points that
//! lie in one another's centre, and for a rim that lies flat. What would be infinite there is left out, so that all is finite.

use nalgebra::{Matrix3, Matrix3x6, RowVector6, Vector3};

/// What touches what. Everything is in the world at the old state.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Feature {
    /// A face of one body (`of_a` tells which) and a point of the other's surface.
    Face { x: Vector3<f64>, motion: Slide, of_a: bool },
    /// A rounded point at `x` against a rounded point or line, whose radius is `reach`, at the distance `r`. The line is of
    /// B, or of A with `of_a`.
    Point { x: Vector3<f64>, line: Option<Vector3<f64>>, r: f64, reach: f64, of_a: bool },
    /// Rounded lines along `e_a`, `e_b`, nearest at `x_a`, `x_b`; `sign` gives `n = sign e_a x e_b / |e_a x e_b|`; `reach` is B's radius.
    Lines { x_a: Vector3<f64>, e_a: Vector3<f64>, e_b: Vector3<f64>, sign: f64, gap: f64, reach: f64 },
    /// The circle of A around `center` across `axis`; `down` points from its centre to the contact.
    Rim { center: Vector3<f64>, axis: Vector3<f64>, radius: f64 },
}

/// How a point of a surface moves with its body, seen from the other one.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Slide {
    /// It is fixed to the body.
    Vertex,
    /// An edge along `e` through the plane with normal `m`.
    Crossing { e: Vector3<f64>, m: Vector3<f64> },
    /// A line along the contact's normal through the face with normal `a`.
    Corner { a: Vector3<f64> },
}

/// How a contact moves with A while B stands still.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    /// Of the point.
    pub p: Matrix3x6<f64>,
    /// Of the normal.
    pub n: Matrix3x6<f64>,
    /// Of the depth.
    pub depth: RowVector6<f64>,
}

/// `[x]`, so that `[x] y = x x y`.
#[inline]
pub(crate) fn skew(x: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -x.z, x.y, x.z, 0.0, -x.x, -x.y, x.x, 0.0)
}

/// `1 / x`; zero where that means nothing.
#[inline]
fn inverse(x: f64) -> f64 {
    if x.abs() > 1e-12 { 1.0 / x } else { 0.0 }
}

/// `C W(x)`.
#[inline]
fn carried(C: &Matrix3<f64>, x: &Vector3<f64>) -> Matrix3x6<f64> {
    let mut out = Matrix3x6::zeros();
    out.fixed_view_mut::<3, 3>(0, 0).copy_from(&(C * -skew(x)));
    out.fixed_view_mut::<3, 3>(0, 3).copy_from(C);
    out
}

impl Slide {
    fn matrix(&self, n: &Vector3<f64>) -> Matrix3<f64> {
        match self {
            Self::Vertex => Matrix3::identity(),
            Self::Crossing { e, m } => Matrix3::identity() - e * m.transpose() * inverse(m.dot(e)),
            Self::Corner { a } => n * a.transpose() * inverse(a.dot(n)),
        }
    }
}

impl Feature {
    /// How a contact at `p` with normal `n` and the depth `depth` moves.
    pub fn motion(&self, p: &Vector3<f64>, n: &Vector3<f64>, depth: f64) -> Motion {
        match self {
            Self::Face { x, motion, of_a } => {
                let n_here = if *of_a { -n } else { *n };
                let moved = carried(&motion.matrix(n), x);
                let by_depth = -(n_here.transpose() * moved);
                let middle = moved + n_here * by_depth * 0.5;
                exchanged(*of_a, p, n, Motion { p: middle, n: Matrix3x6::zeros(), depth: by_depth })
            }
            Self::Point { x, line, r, reach, of_a } => {
                let n_here = if *of_a { -n } else { *n };
                let moved = carried(&Matrix3::identity(), x);
                let by_depth = -(n_here.transpose() * moved);
                let along = line.map_or_else(Matrix3::zeros, |e| e * e.transpose());
                let across = Matrix3::identity() - n_here * n_here.transpose() - along;
                let dn = across * moved * inverse(*r);
                let middle = along * moved + dn * (reach - 0.5 * depth) - n_here * by_depth * 0.5;
                exchanged(*of_a, p, n, Motion { p: middle, n: dn, depth: by_depth })
            }
            Self::Lines { x_a, e_a, e_b, sign, gap, reach } => {
                let moved = carried(&Matrix3::identity(), x_a);
                let by_depth = -(n.transpose() * moved);
                let length = e_a.cross(e_b).norm();
                let flat = Matrix3::identity() - n * n.transpose();
                // de_a = turn x e_a, so d(e_a x e_b) = (turn x e_a) x e_b = [e_b] [e_a] turn.
                let turning = flat * skew(e_b) * skew(e_a) * (sign * inverse(length));
                let mut dn = Matrix3x6::zeros();
                dn.fixed_view_mut::<3, 3>(0, 0).copy_from(&turning);
                let m = e_a.cross(n);
                let dt = (m.transpose() * moved - m.transpose() * dn * *gap) * inverse(m.dot(e_b));
                Motion { p: e_b * dt + dn * (reach - 0.5 * depth) - n * by_depth * 0.5, n: dn, depth: by_depth }
            }
            Self::Rim { center, axis, radius } => {
                let across = n - axis * n.dot(axis);
                let size = across.norm();
                let m = across * inverse(size);
                // d(across) = -(n . da) a - (n . a) da with da = turn x a = -[a] turn.
                let da = -skew(axis);
                let turned = (Matrix3::identity() - m * m.transpose())
                    * (axis * (n.transpose() * da) + da * n.dot(axis))
                    * (*radius * inverse(size));
                let mut moved = carried(&Matrix3::identity(), center);
                let mut turn = moved.fixed_view_mut::<3, 3>(0, 0);
                turn += turned;
                let by_depth = -(n.transpose() * moved);
                Motion { p: moved + n * by_depth * 0.5, n: Matrix3x6::zeros(), depth: by_depth }
            }
        }
    }
}

/// From the motion for "A stands still, B moves, normal turned about" to the motion with A.
fn exchanged(yes: bool, p: &Vector3<f64>, n: &Vector3<f64>, m: Motion) -> Motion {
    if !yes {
        return m;
    }
    let mut turn = Matrix3x6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&-skew(n));
    Motion { p: carried(&Matrix3::identity(), p) - m.p, n: turn + m.n, depth: -m.depth }
}
