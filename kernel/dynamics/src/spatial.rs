//! Spatial vectors and inertias (Featherstone 2008, chapter 2), angular part first.

use nalgebra::{Matrix3, Point3, Vector3, Vector6};

/// `[omega; v]` of a motion, `[torque; force]` of a force.
pub type SpatialVector = Vector6<f64>;

/// Joins an angular and a linear part.
#[inline]
pub(crate) fn join(angular: &Vector3<f64>, linear: &Vector3<f64>) -> SpatialVector {
    SpatialVector::new(angular.x, angular.y, angular.z, linear.x, linear.y, linear.z)
}

/// The angular part.
#[inline]
pub(crate) fn angular(V: &SpatialVector) -> Vector3<f64> {
    Vector3::new(V[0], V[1], V[2])
}

/// The linear part.
#[inline]
pub(crate) fn linear(V: &SpatialVector) -> Vector3<f64> {
    Vector3::new(V[3], V[4], V[5])
}

// nalgebra's general products loop over sizes; these are written out, since everything is made of them.

/// `A b`.
#[inline(always)]
pub(crate) fn mul(A: &Matrix3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(A.m11 * b.x + A.m12 * b.y + A.m13 * b.z, A.m21 * b.x + A.m22 * b.y + A.m23 * b.z, A.m31 * b.x + A.m32 * b.y + A.m33 * b.z)
}

/// `A^T b`.
#[inline(always)]
pub(crate) fn tr_mul(A: &Matrix3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(A.m11 * b.x + A.m21 * b.y + A.m31 * b.z, A.m12 * b.x + A.m22 * b.y + A.m32 * b.z, A.m13 * b.x + A.m23 * b.y + A.m33 * b.z)
}

/// `A B`.
#[inline(always)]
pub(crate) fn mul_mat(A: &Matrix3<f64>, B: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |x: f64, y: f64, z: f64| mul(A, &Vector3::new(x, y, z));
    let (a, b, c) = (column(B.m11, B.m21, B.m31), column(B.m12, B.m22, B.m32), column(B.m13, B.m23, B.m33));
    Matrix3::new(a.x, b.x, c.x, a.y, b.y, c.y, a.z, b.z, c.z)
}

/// `R I R^T` for a symmetric `I`.
#[inline(always)]
fn turned(R: &Matrix3<f64>, I: &Matrix3<f64>) -> Matrix3<f64> {
    let T = mul_mat(R, I);
    let xx = T.m11 * R.m11 + T.m12 * R.m12 + T.m13 * R.m13;
    let xy = T.m11 * R.m21 + T.m12 * R.m22 + T.m13 * R.m23;
    let xz = T.m11 * R.m31 + T.m12 * R.m32 + T.m13 * R.m33;
    let yy = T.m21 * R.m21 + T.m22 * R.m22 + T.m23 * R.m23;
    let yz = T.m21 * R.m31 + T.m22 * R.m32 + T.m23 * R.m33;
    let zz = T.m31 * R.m31 + T.m32 * R.m32 + T.m33 * R.m33;
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// `a . b` of a motion and a force.
#[inline(always)]
pub(crate) fn dot(a: &SpatialVector, b: &SpatialVector) -> f64 {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) + (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])
}

/// `V x W`: the rate of a motion `W` that is carried along by `V`.
#[inline]
pub fn cross_motion(V: &SpatialVector, W: &SpatialVector) -> SpatialVector {
    let omega = angular(V);
    join(&omega.cross(&angular(W)), &(omega.cross(&linear(W)) + linear(V).cross(&angular(W))))
}

/// `V x* F`: the rate of a force `F` that is carried along by `V`.
#[inline]
pub fn cross_force(V: &SpatialVector, F: &SpatialVector) -> SpatialVector {
    let omega = angular(V);
    join(&(omega.cross(&angular(F)) + linear(V).cross(&linear(F))), &omega.cross(&linear(F)))
}

/// A force (N) at a point (m) with a torque (N m), all in one frame, taken to that frame's origin.
#[inline]
pub fn wrench_at_origin(force: &Vector3<f64>, torque: &Vector3<f64>, point: &Point3<f64>) -> SpatialVector {
    join(&(torque + point.coords.cross(force)), force)
}

/// Mass properties about the origin of the frame that they are written in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialInertia {
    /// Mass, kg.
    pub mass: f64,
    /// Mass times the centre of mass, kg m.
    pub h: Vector3<f64>,
    /// Rotational inertia about the frame's origin, kg m^2, symmetric.
    pub I: Matrix3<f64>,
}

impl SpatialInertia {
    /// Nothing.
    pub const ZERO: Self = Self { mass: 0.0, h: Vector3::new(0.0, 0.0, 0.0), I: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) };

    /// From the mass, the centre of mass and the inertia about it.
    #[inline]
    pub fn new(mass: f64, center: &Vector3<f64>, I_cm: &Matrix3<f64>) -> Self {
        Self { mass, h: center * mass, I: I_cm + about(mass, center) }
    }

    /// The ten numbers in which a body's motion is linear: mass, mass times the centre of mass (x, y, z), rotational inertia
    /// about the origin (xx, xy, xz, yy, yz, zz).
    pub fn entries(&self) -> [f64; 10] {
        let (h, I) = (&self.h, &self.I);
        [self.mass, h.x, h.y, h.z, I[(0, 0)], I[(0, 1)], I[(0, 2)], I[(1, 1)], I[(1, 2)], I[(2, 2)]]
    }

    /// The inverse of [`Self::entries`].
    pub fn from_entries(e: &[f64; 10]) -> Self {
        let I = Matrix3::new(e[4], e[5], e[6], e[5], e[7], e[8], e[6], e[8], e[9]);
        Self { mass: e[0], h: Vector3::new(e[1], e[2], e[3]), I }
    }

    /// Centre of mass; the origin for a massless body.
    pub fn center(&self) -> Vector3<f64> {
        if self.mass > 0.0 { self.h / self.mass } else { Vector3::zeros() }
    }

    /// Inertia about the centre of mass.
    pub fn about_center(&self) -> Matrix3<f64> {
        self.I - about(self.mass, &self.center())
    }

    /// The same body written in another frame: `R`, `p` are the pose of this inertia's frame in the new one.
    #[inline(always)]
    pub fn moved(&self, R: &Matrix3<f64>, p: &Vector3<f64>) -> Self {
        // With c = p + R h / m:  I' = R (I - m(...)) R^T + m(...) written without the division by m.
        // -(p x)(h x) - (h x)(p x) = 2 (p.h) 1 - p h^T - h p^T, and m (p.p 1 - p p^T): with b = 2 h + m p both are
        // (p.b) 1 less the symmetric part of p b^T.
        let h = mul(R, &self.h);
        let mut I = turned(R, &self.I);
        let b = h * 2.0 + p * self.mass;
        let along = p.dot(&b);
        I.m11 += along - p.x * b.x;
        I.m22 += along - p.y * b.y;
        I.m33 += along - p.z * b.z;
        let (xy, xz, yz) = (0.5 * (p.x * b.y + p.y * b.x), 0.5 * (p.x * b.z + p.z * b.x), 0.5 * (p.y * b.z + p.z * b.y));
        I.m12 -= xy;
        I.m21 -= xy;
        I.m13 -= xz;
        I.m31 -= xz;
        I.m23 -= yz;
        I.m32 -= yz;
        Self { mass: self.mass, h: h + p * self.mass, I }
    }

    /// Momentum of the body that moves with `V`.
    #[inline]
    pub fn times(&self, V: &SpatialVector) -> SpatialVector {
        let (omega, v) = (angular(V), linear(V));
        join(&(mul(&self.I, &omega) + self.h.cross(&v)), &(v * self.mass - self.h.cross(&omega)))
    }
}

/// The inertia of articulated bodies (Featherstone 2008, section 7.1): `[J, H; H^T, M]`, `J` and `M` symmetric and stored as
/// xx, xy, xz, yy, yz, zz, `H` by rows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ArticulatedInertia {
    J: [f64; 6],
    H: [f64; 9],
    M: [f64; 6],
}

impl ArticulatedInertia {
    pub const ZERO: Self = Self { J: [0.0; 6], H: [0.0; 9], M: [0.0; 6] };

    #[inline(always)]
    pub fn rigid(I: &SpatialInertia) -> Self {
        let (J, h, m) = (&I.I, &I.h, I.mass);
        Self {
            J: [J.m11, J.m12, J.m13, J.m22, J.m23, J.m33],
            H: [0.0, -h.z, h.y, h.z, 0.0, -h.x, -h.y, h.x, 0.0],
            M: [m, 0.0, 0.0, m, 0.0, m],
        }
    }

    #[inline(always)]
    pub fn times(&self, V: &SpatialVector) -> SpatialVector {
        let ([a, b, c, d, e, f], Self { J, H, M }) = ([V[0], V[1], V[2], V[3], V[4], V[5]], self);
        SpatialVector::new(
            J[0] * a + J[1] * b + J[2] * c + H[0] * d + H[1] * e + H[2] * f,
            J[1] * a + J[3] * b + J[4] * c + H[3] * d + H[4] * e + H[5] * f,
            J[2] * a + J[4] * b + J[5] * c + H[6] * d + H[7] * e + H[8] * f,
            H[0] * a + H[3] * b + H[6] * c + M[0] * d + M[1] * e + M[2] * f,
            H[1] * a + H[4] * b + H[7] * c + M[1] * d + M[3] * e + M[4] * f,
            H[2] * a + H[5] * b + H[8] * c + M[2] * d + M[4] * e + M[5] * f,
        )
    }

    /// Takes `scale U U^T` away.
    #[inline(always)]
    pub fn subtract(&mut self, scale: f64, U: &SpatialVector) {
        let ([a, b, c, d, e, f], [x, y, z]) = ([U[0], U[1], U[2], U[3], U[4], U[5]], [scale * U[0], scale * U[1], scale * U[2]]);
        for (to, from) in self.J.iter_mut().zip([x * a, x * b, x * c, y * b, y * c, z * c]) {
            *to -= from;
        }
        for (to, from) in self.H.iter_mut().zip([x * d, x * e, x * f, y * d, y * e, y * f, z * d, z * e, z * f]) {
            *to -= from;
        }
        let [x, y, z] = [scale * d, scale * e, scale * f];
        for (to, from) in self.M.iter_mut().zip([x * d, x * e, x * f, y * e, y * f, z * f]) {
            *to -= from;
        }
    }
}

impl std::ops::AddAssign for ArticulatedInertia {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        for (to, from) in self.J.iter_mut().zip(other.J) {
            *to += from;
        }
        for (to, from) in self.H.iter_mut().zip(other.H) {
            *to += from;
        }
        for (to, from) in self.M.iter_mut().zip(other.M) {
            *to += from;
        }
    }
}

/// `m (c.c 1 - c c^T)`: inertia of a point mass about the origin.
#[inline]
fn about(mass: f64, c: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(mass * c.dot(c)) - c * c.transpose() * mass
}

impl std::ops::Add for SpatialInertia {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { mass: self.mass + other.mass, h: self.h + other.h, I: self.I + other.I }
    }
}

impl std::ops::Sub for SpatialInertia {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { mass: self.mass - other.mass, h: self.h - other.h, I: self.I - other.I }
    }
}

impl std::ops::AddAssign for SpatialInertia {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl From<&sagci_model::Inertial> for SpatialInertia {
    fn from(i: &sagci_model::Inertial) -> Self {
        Self::new(i.mass, &i.p_LoLcm.coords, &i.I_LLcm_L)
    }
}
