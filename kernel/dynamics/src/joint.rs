//! How each kind of joint moves: pose from positions, motion subspace, and stepping positions along a velocity.

use nalgebra::{Matrix3, Quaternion, Rotation3, Unit, UnitQuaternion, Vector3};
use sagci_model::JointKind;

use crate::SpatialVector;
use crate::spatial::join;

/// A joint of the reduced tree. Fixed joints are gone.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    /// Kind, never `Fixed`.
    pub kind: JointKind,
    /// Axis of turning or sliding, or the plane's normal, in the joint's frame.
    pub axis: Vector3<f64>,
    /// The plane's two axes in the joint's frame (planar joints only).
    pub plane: [Vector3<f64>; 2],
}

/// The two slide axes of a planar joint with normal `n`, in the joint's frame; with `n` they are right-handed.
pub fn plane_axes(n: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let x = if n.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let e1 = (x - n.into_inner() * n.dot(&x)).normalize();
    [e1, n.cross(&e1)]
}

impl Motion {
    pub fn new(kind: JointKind, axis: &Unit<Vector3<f64>>) -> Self {
        Self { kind, axis: axis.into_inner(), plane: plane_axes(axis) }
    }

    /// Pose `X_JC` of the child in the joint's frame.
    #[inline]
    pub fn pose(&self, q: &[f64]) -> (Matrix3<f64>, Vector3<f64>) {
        match self.kind {
            JointKind::Fixed => (Matrix3::identity(), Vector3::zeros()),
            JointKind::Revolute | JointKind::Continuous => (rotation(&self.axis, q[0]), Vector3::zeros()),
            JointKind::Prismatic => (Matrix3::identity(), self.axis * q[0]),
            JointKind::Planar => (rotation(&self.axis, q[2]), self.plane[0] * q[0] + self.plane[1] * q[1]),
            JointKind::Floating => (quaternion(q).to_rotation_matrix().into_inner(), Vector3::new(q[4], q[5], q[6])),
        }
    }

    /// Motion subspace in the world, at the world's origin, for a child at `R`, `p`.
    #[inline]
    pub fn subspace(&self, R: &Matrix3<f64>, p: &Vector3<f64>, S: &mut [SpatialVector]) {
        let turn = |a: Vector3<f64>| join(&a, &p.cross(&a));
        let slide = |a: Vector3<f64>| join(&Vector3::zeros(), &a);
        match self.kind {
            JointKind::Fixed => {}
            JointKind::Revolute | JointKind::Continuous => S[0] = turn(R * self.axis),
            JointKind::Prismatic => S[0] = slide(R * self.axis),
            JointKind::Planar => {
                S[0] = slide(R * self.plane[0]);
                S[1] = slide(R * self.plane[1]);
                S[2] = turn(R * self.axis);
            }
            JointKind::Floating => {
                for i in 0..3 {
                    let a = R.column(i).into_owned();
                    S[i] = turn(a);
                    S[i + 3] = slide(a);
                }
            }
        }
    }

    /// Moves along velocity `v` held in the child's frame for the time `dt`: the exponential map of the joint's group.
    pub fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        match self.kind {
            JointKind::Fixed => {}
            JointKind::Revolute | JointKind::Continuous | JointKind::Prismatic => q[0] += v[0] * dt,
            JointKind::Planar => {
                let turn = v[2] * dt;
                // Left Jacobian of SO(2): the average of the turning direction over the step.
                let (a, b) = (sinc(turn), half_cosc(turn));
                let (x, y) = ((a * v[0] - b * v[1]) * dt, (b * v[0] + a * v[1]) * dt);
                let (sin, cos) = q[2].sin_cos();
                q[0] += cos * x - sin * y;
                q[1] += sin * x + cos * y;
                q[2] += turn;
            }
            JointKind::Floating => {
                let w = Vector3::new(v[0], v[1], v[2]) * dt;
                let u = Vector3::new(v[3], v[4], v[5]) * dt;
                let angle = w.norm();
                // Left Jacobian of SO(3) (Barfoot 2017, 7.37), with its series near zero.
                let a = half_cosc_over(angle);
                let b = sinc_over(angle);
                let shift = u + w.cross(&u) * a + w.cross(&w.cross(&u)) * b;
                let R = quaternion(q);
                let p = R * shift;
                let turned = UnitQuaternion::new_normalize((R * UnitQuaternion::from_scaled_axis(w)).into_inner());
                q[0] = turned.w;
                q[1] = turned.i;
                q[2] = turned.j;
                q[3] = turned.k;
                q[4] += p.x;
                q[5] += p.y;
                q[6] += p.z;
            }
        }
    }

    /// Positions at which the child lies on the joint's frame.
    pub fn neutral(&self, q: &mut [f64]) {
        q.fill(0.0);
        if self.kind == JointKind::Floating {
            q[0] = 1.0;
        }
    }

    /// The velocity that takes `from` to `to` in unit time: the inverse of [`Self::integrate`].
    pub fn difference(&self, from: &[f64], to: &[f64], v: &mut [f64]) {
        match self.kind {
            JointKind::Fixed => {}
            JointKind::Revolute | JointKind::Continuous | JointKind::Prismatic => v[0] = to[0] - from[0],
            JointKind::Planar => {
                let turn = to[2] - from[2];
                let (sin, cos) = from[2].sin_cos();
                let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
                let (x, y) = (cos * dx + sin * dy, -sin * dx + cos * dy);
                let (a, b) = (sinc(turn), half_cosc(turn));
                let det = a * a + b * b;
                v[0] = (a * x + b * y) / det;
                v[1] = (-b * x + a * y) / det;
                v[2] = turn;
            }
            JointKind::Floating => {
                let (R, R_to) = (quaternion(from), quaternion(to));
                let w = (R.inverse() * R_to).scaled_axis();
                let shift = R.inverse() * Vector3::new(to[4] - from[4], to[5] - from[5], to[6] - from[6]);
                let angle = w.norm();
                // Inverse of the left Jacobian of SO(3).
                let c = if angle < 1e-4 {
                    1.0 / 12.0 + angle * angle / 720.0
                } else {
                    (1.0 - 0.5 * angle * angle.sin() / (1.0 - angle.cos())) / (angle * angle)
                };
                let u = shift - w.cross(&shift) * 0.5 + w.cross(&w.cross(&shift)) * c;
                v[..3].copy_from_slice(w.as_slice());
                v[3..].copy_from_slice(u.as_slice());
            }
        }
    }
}

/// Rodrigues' formula.
#[inline]
fn rotation(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    let (x, y, z) = (axis.x, axis.y, axis.z);
    let t = 1.0 - c;
    Matrix3::new(
        t * x * x + c,
        t * x * y - s * z,
        t * x * z + s * y,
        t * x * y + s * z,
        t * y * y + c,
        t * y * z - s * x,
        t * x * z - s * y,
        t * y * z + s * x,
        t * z * z + c,
    )
}

/// The unit quaternion of a floating joint; its length has been checked when the state was set.
#[inline]
pub(crate) fn quaternion(q: &[f64]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]))
}

/// sin x / x.
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-4 { 1.0 - x * x / 6.0 } else { x.sin() / x }
}

/// (1 - cos x) / x.
fn half_cosc(x: f64) -> f64 {
    if x.abs() < 1e-4 { x / 2.0 - x * x * x / 24.0 } else { (1.0 - x.cos()) / x }
}

/// (1 - cos x) / x^2.
fn half_cosc_over(x: f64) -> f64 {
    if x.abs() < 1e-4 { 0.5 - x * x / 24.0 } else { (1.0 - x.cos()) / (x * x) }
}

/// (x - sin x) / x^3.
fn sinc_over(x: f64) -> f64 {
    if x.abs() < 1e-3 { 1.0 / 6.0 - x * x / 120.0 } else { (x - x.sin()) / (x * x * x) }
}

/// The rotation matrix of a unit quaternion.
pub(crate) fn matrix(rotation: &UnitQuaternion<f64>) -> Matrix3<f64> {
    rotation.to_rotation_matrix().into_inner()
}

/// A rigid transform from a rotation matrix and a position.
pub(crate) fn isometry(R: &Matrix3<f64>, p: &Vector3<f64>) -> nalgebra::Isometry3<f64> {
    nalgebra::Isometry3::from_parts((*p).into(), UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*R)))
}
