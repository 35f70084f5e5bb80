//! A compliant grasp: a bushing between two bodies, with six stiffnesses and dampings and a limit of force and of torque.
//!
//! With frame G on A and frame H on B, the displacement of H in G is `xi = [log(R_GH); p_GH]` and its rate, in G's axes, `u`. Over a step
//! the displacement is taken ahead: the impulse on A is `g = y / sqrt(1 + sum_k w_k y_k^2 / (h F)^2)` with
//! `y = h (K (xi + h u) + D u)`, for the three torques and the three forces apart. `F` is the limit, and `w_k = max(C) / C_k` with
//! `C = h (h K + D)` makes `g` the derivative of a convex potential in the velocity where the stiffnesses differ; `|g| <= h F` always.
//! The bushing is smooth everywhere but half a turn away from rest, where the logarithm jumps.

use nalgebra::{Isometry3, Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};

use super::feature::skew;
use crate::spatial::{angular, join, linear};
use crate::{LinkId, SpatialVector};

/// A grasp that holds two links together like a bushing: compliant, damped, and not stronger than it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Grasp {
    /// The link that holds; for example a hand. The axes of stiffness are fixed to it.
    pub a: LinkId,
    /// Pose of the grasp's frame G on it.
    pub X_AG: Isometry3<f64>,
    /// The link that is held; for example a handle.
    pub b: LinkId,
    /// Pose on it of the frame H that the grasp draws to G.
    pub X_BH: Isometry3<f64>,
    /// About and along G's axes: three in N m/rad, three in N/m.
    pub stiffness: Vector6<f64>,
    /// Three in N m s/rad, three in N s/m.
    pub damping: Vector6<f64>,
    /// Greatest torque, N m, and force, N; infinite for none.
    pub limit: [f64; 2],
}

/// A grasp at the state that a step starts from.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Held {
    /// Axes and origin of G in the world, and the origin of H.
    E: Matrix3<f64>,
    p: Vector3<f64>,
    /// `h K xi`, and `C`.
    y0: [Vector3<f64>; 2],
    C: [Vector3<f64>; 2],
    /// `h K`, for derivatives.
    hK: [Vector3<f64>; 2],
    /// Rotation vector of H in G.
    turn: Vector3<f64>,
    /// `h F`.
    bound: [f64; 2],
}

impl Held {
    pub fn new(grasp: &Grasp, h: f64, (R_WG, p_WG): (&Matrix3<f64>, &Vector3<f64>), (R_WH, p_WH): (&Matrix3<f64>, &Vector3<f64>)) -> Self {
        let R = R_WG.tr_mul(R_WH);
        let turn = nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(R)).scaled_axis();
        let xi = [turn, R_WG.tr_mul(&(p_WH - p_WG))];
        let three = |v: &Vector6<f64>, i: usize| Vector3::new(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
        let hK = [0, 1].map(|i| three(&grasp.stiffness, i) * h);
        let C = [0, 1].map(|i| (hK[i] + three(&grasp.damping, i)) * h);
        let y0 = [0, 1].map(|i| hK[i].component_mul(&xi[i]));
        Self { E: *R_WG, p: *p_WH, y0, C, hK, turn, bound: [h * grasp.limit[0], h * grasp.limit[1]] }
    }

    /// Impulse on A in the world at its origin, for the velocity `V` of A relative to B.
    pub fn impulse(&self, V: &SpatialVector) -> SpatialVector {
        let x = self.rate(V);
        let g = [0, 1].map(|i| self.limited(i, &(self.y0[i] - self.C[i].component_mul(&x[i]))).0);
        self.out(&g)
    }

    /// Its derivative by `V`, negated: symmetric and positive semidefinite.
    pub fn slope(&self, V: &SpatialVector) -> Matrix6<f64> {
        let x = self.rate(V);
        let mut K = Matrix6::zeros();
        for (i, x) in x.iter().enumerate() {
            let dg = self.limited(i, &(self.y0[i] - self.C[i].component_mul(x))).1;
            let G = self.E * dg * Matrix3::from_diagonal(&self.C[i]) * self.E.transpose();
            if i == 0 {
                let mut corner = K.fixed_view_mut::<3, 3>(0, 0);
                corner += G;
            } else {
                K += about(&self.p, &G);
            }
        }
        K
    }

    /// Derivative of the impulse by a small twist of A (world axes, at the world's origin) at fixed `V`.
    pub fn by_pose(&self, V: &SpatialVector) -> Matrix6<f64> {
        let x = self.rate(V);
        let velocity = [angular(V), linear(V) + angular(V).cross(&self.p)];
        // How the displacement changes: the rotation vector by its inverse left Jacobian (Barfoot 2017, 7.86), the way by the motion at H.
        let mut away = Matrix3x6::zeros();
        away.fixed_view_mut::<3, 3>(0, 0).copy_from(&-skew(&self.p));
        away.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        let mut turned = Matrix3x6::zeros();
        turned.fixed_view_mut::<3, 3>(0, 0).copy_from(&(inverse_left_jacobian(&self.turn) * self.E.transpose()));
        let displaced = [-turned, -(self.E.transpose() * away)];
        let mut out = Matrix6::zeros();
        for i in 0..2 {
            let (g, dg) = self.limited(i, &(self.y0[i] - self.C[i].component_mul(&x[i])));
            // d(E^T V) = -E^T (turn x V) = E^T [V] turn.
            let mut dx = Matrix3x6::zeros();
            dx.fixed_view_mut::<3, 3>(0, 0).copy_from(&(self.E.transpose() * skew(&velocity[i])));
            let dy = Matrix3::from_diagonal(&self.hK[i]) * displaced[i] - Matrix3::from_diagonal(&self.C[i]) * dx;
            let mut world = self.E * dg * dy;
            let mut turning = world.fixed_view_mut::<3, 3>(0, 0);
            turning -= skew(&(self.E * g));
            if i == 0 {
                let mut rows = out.fixed_view_mut::<3, 6>(0, 0);
                rows += world;
            } else {
                let mut rows = out.fixed_view_mut::<3, 6>(0, 0);
                rows += skew(&self.p) * world;
                let mut rows = out.fixed_view_mut::<3, 6>(3, 0);
                rows += world;
            }
        }
        out
    }

    /// Velocity of A relative to B, at H, in G's axes.
    fn rate(&self, V: &SpatialVector) -> [Vector3<f64>; 2] {
        [self.E.tr_mul(&angular(V)), self.E.tr_mul(&(linear(V) + angular(V).cross(&self.p)))]
    }

    fn out(&self, g: &[Vector3<f64>; 2]) -> SpatialVector {
        let (torque, force) = (self.E * g[0], self.E * g[1]);
        join(&(torque + self.p.cross(&force)), &force)
    }

    /// `g` of `y`, and its derivative.
    fn limited(&self, i: usize, y: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let largest = self.C[i].max();
        if !self.bound[i].is_finite() || largest <= 0.0 {
            return (*y, Matrix3::identity());
        }
        let weight = self.C[i].map(|c| if c > 0.0 { largest / c } else { 0.0 }) / (self.bound[i] * self.bound[i]);
        let wy = weight.component_mul(y);
        let f = 1.0 / (1.0 + wy.dot(y)).sqrt();
        (y * f, Matrix3::from_diagonal_element(f) - y * wy.transpose() * f.powi(3))
    }
}

/// `W^T G W`: what a stiffness at the point `p` is at the world's origin.
#[inline]
pub(crate) fn about(p: &Vector3<f64>, G: &Matrix3<f64>) -> Matrix6<f64> {
    let r = skew(p);
    let rG = r * G;
    let mut K = Matrix6::zeros();
    K.fixed_view_mut::<3, 3>(0, 0).copy_from(&-(rG * r));
    K.fixed_view_mut::<3, 3>(0, 3).copy_from(&rG);
    K.fixed_view_mut::<3, 3>(3, 0).copy_from(&rG.transpose());
    K.fixed_view_mut::<3, 3>(3, 3).copy_from(G);
    K
}

fn inverse_left_jacobian(turn: &Vector3<f64>) -> Matrix3<f64> {
    let angle = turn.norm();
    let c = if angle < 1e-4 {
        1.0 / 12.0 + angle * angle / 720.0
    } else {
        (1.0 - 0.5 * angle * angle.sin() / (1.0 - angle.cos())) / (angle * angle)
    };
    let r = skew(turn);
    Matrix3::identity() - r * 0.5 + r * r * c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impulse_has_the_derivatives_that_it_says_and_stays_below_its_limit() {
        let grasp = Grasp {
            a: LinkId(0),
            X_AG: Isometry3::identity(),
            b: LinkId(0),
            X_BH: Isometry3::identity(),
            stiffness: Vector6::new(20.0, 30.0, 10.0, 3e3, 1e3, 2e3),
            damping: Vector6::new(0.3, 0.1, 0.0, 5.0, 0.0, 10.0),
            limit: [2.0, 30.0],
        };
        let turn = |x, y, z| *nalgebra::Rotation3::from_scaled_axis(Vector3::new(x, y, z)).matrix();
        let (R, p) = (turn(0.3, -0.2, 0.5), Vector3::new(0.4, -0.1, 0.7));
        let (S, q) = (turn(0.5, 0.1, 0.4), Vector3::new(0.42, -0.12, 0.705));
        let V = SpatialVector::new(0.3, -0.8, 0.4, 0.2, 0.1, -0.5);
        let h = 1e-2;
        let at = |X: &SpatialVector, V: &SpatialVector| {
            let T = nalgebra::Rotation3::from_scaled_axis(angular(X));
            Held::new(&grasp, h, (&(T * R), &(T * p + linear(X))), (&S, &q)).impulse(V)
        };
        let held = Held::new(&grasp, h, (&R, &p), (&S, &q));
        let zero = SpatialVector::zeros();
        for k in 0..6 {
            let e = SpatialVector::ith(k, 1e-6);
            let by_V = (at(&zero, &(V - e)) - at(&zero, &(V + e))) / 2e-6;
            assert!((by_V - held.slope(&V).column(k)).norm() < 1e-6 * held.slope(&V).norm());
            let by_X = (at(&e, &V) - at(&-e, &V)) / 2e-6;
            assert!((by_X - held.by_pose(&V).column(k)).norm() < 1e-6 * held.by_pose(&V).norm(), "{k}");
        }
        assert!((held.slope(&V) - held.slope(&V).transpose()).norm() < 1e-12);
        let far = held.impulse(&(V * 1e6));
        let force = linear(&far);
        assert!(force.norm() <= h * 30.0 * (1.0 + 1e-12));
        assert!((angular(&far) - q.cross(&force)).norm() <= h * 2.0 * (1.0 + 1e-9));
    }
}
