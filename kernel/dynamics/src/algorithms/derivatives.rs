//! Analytic derivatives of inverse and forward dynamics by position and velocity (Carpentier and Mansard 2018), in the world
//! form that Singh, Russo and Wensing 2022 show to be short: parents and children add without transforms.
//!
//! A displacement of the degree of freedom `k` of body `i` carries the whole subtree of `i` along the twist `S_k`. Seen from
//! the subtree, everything stays where it is and the parent `P` turns the other way, so that every body `j` behind `i` has
//!
//! `dV_j = D_k`,  `dA_j = E_k + D_k x V_j`  with  `D_k = V_P x S_k`,  `E_k = A_P x S_k + V_P x D_k`,
//!
//! and a velocity of `k` gives `dV_j = S_k`, `dA_j = H_k + S_k x V_j` with `H_k = V_P x S_k + V_i x S_k`. What a motion
//! `dV = X`, `dA = X x V` does to the force of one body is linear in `X`:
//!
//! `I (X x V) + X x* (I V) + V x* (I X) = [R w; -2 p x w]`,  `w` the angular part of `X`,
//!
//! with the linear momentum `p` and `R = dJ/dt - [L x]`: rate of the rotational inertia `J`, angular momentum `L`, all about
//! the world's origin. All three add over a subtree, as the composite inertia `I` does. With those sums taken over the subtree
//! of the outer one of two degrees of freedom (`l` on or behind the body of `k`), `f` the force through its joint that inertia
//! needs, and `e` the external force on its subtree, which stays fixed in the world:
//!
//! | | outer row `l`, inner column `k` | inner row `k`, outer column `l` |
//! |---|---|---|
//! | `d tau / d q` | `S_l . (I E_k + B D_k + S_k x* e)` | `S_k . (I E_l + B D_l + S_l x* f)` |
//! | `d tau / d v` | `S_l . (I H_k + B S_k)` | `S_k . (I H_l + B S_l)` |
//!
//! where `B X = [R w; -2 p x w]`. The left column is taken from the other side, by `U_l = I S_l` and `y_l = R^T s_l + 2 p x s'_l`
//! (`s`, `s'` the angular and linear part of `S_l`), and costs nine products an entry.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::error::check;
use crate::multibody::length;
use crate::spatial::{angular, join, linear};
use crate::{DynamicsError, ExternalWrench, Multibody, SpatialInertia, SpatialVector, Workspace, cross_force, cross_motion};

/// Derivatives of the efforts `tau = ID(q, v, a)`; those by `a` are the mass matrix. Rows by effort, columns by the entry of
/// `v` that moves along (for `q`: its tangent, see [`Multibody::integrate`]).
#[derive(Debug, Clone, PartialEq)]
pub struct InverseDynamicsDerivatives {
    /// By position.
    pub d_q: DMatrix<f64>,
    /// By velocity.
    pub d_v: DMatrix<f64>,
}

/// Derivatives of the accelerations `a = FD(q, v, tau)`. Rows by acceleration, columns as in [`InverseDynamicsDerivatives`].
#[derive(Debug, Clone, PartialEq)]
pub struct ForwardDynamicsDerivatives {
    /// By position.
    pub d_q: DMatrix<f64>,
    /// By velocity.
    pub d_v: DMatrix<f64>,
    /// By effort: the inverse of the mass matrix.
    pub d_tau: DMatrix<f64>,
}

impl InverseDynamicsDerivatives {
    /// Zeros for a multibody.
    pub fn new(multibody: &Multibody) -> Self {
        let zeros = DMatrix::zeros(multibody.nv, multibody.nv);
        Self { d_q: zeros.clone(), d_v: zeros }
    }
}

impl ForwardDynamicsDerivatives {
    /// Zeros for a multibody.
    pub fn new(multibody: &Multibody) -> Self {
        let zeros = DMatrix::zeros(multibody.nv, multibody.nv);
        Self { d_q: zeros.clone(), d_v: zeros.clone(), d_tau: zeros }
    }
}

/// How the force of a body, or of a subtree, answers to `dV = X`, `dA = X x V`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rate {
    pub R: Matrix3<f64>,
    pub p: Vector3<f64>,
}

impl Rate {
    pub const ZERO: Self = Self { R: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), p: Vector3::new(0.0, 0.0, 0.0) };

    /// For a body with inertia `I` and momentum `P`, moving with `V`.
    #[inline]
    pub fn new(I: &SpatialInertia, V: &SpatialVector, P: &SpatialVector) -> Self {
        let (w, v, L) = (angular(V), linear(V), angular(P));
        let turned = cross_columns(&w, &I.I);
        let vh = v * I.h.transpose();
        // -[v x][h x] - [h x][v x] = 2 (v.h) 1 - v h^T - h v^T
        let rate = turned + turned.transpose() + Matrix3::from_diagonal_element(2.0 * v.dot(&I.h)) - vh - vh.transpose();
        Self { R: rate - L.cross_matrix(), p: linear(P) }
    }

    #[inline]
    pub fn times(&self, w: &Vector3<f64>) -> SpatialVector {
        join(&(self.R * w), &(w.cross(&self.p) * 2.0))
    }

    /// The angular part of the transposed product; its linear part is zero.
    #[inline]
    pub fn transposed_times(&self, S: &SpatialVector) -> Vector3<f64> {
        self.R.tr_mul(&angular(S)) + self.p.cross(&linear(S)) * 2.0
    }
}

/// `w x` each column.
#[inline]
fn cross_columns(w: &Vector3<f64>, A: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[w.cross(&A.column(0)), w.cross(&A.column(1)), w.cross(&A.column(2))])
}

/// What derivatives need beside the state. By body unless said otherwise; sums over subtrees after
/// [`Multibody::differentiate`].
#[derive(Debug, Clone)]
pub(crate) struct Variation {
    pub rate: Vec<Rate>,
    /// Forces that inertia needs, and external forces.
    pub inertial: Vec<SpatialVector>,
    pub external: Vec<SpatialVector>,
    /// By degree of freedom of the tree.
    pub D: Vec<SpatialVector>,
    pub E: Vec<SpatialVector>,
    pub H: Vec<SpatialVector>,
    pub U: Vec<SpatialVector>,
    pub y: Vec<Vector3<f64>>,
    /// Row-major, by velocity.
    pub d_q: Vec<f64>,
    pub d_v: Vec<f64>,
    /// Scratch: which bodies belong to a subtree.
    pub inside: Vec<bool>,
}

impl Variation {
    pub fn new(multibody: &Multibody) -> Self {
        let (b, t, n) = (multibody.bodies.len(), multibody.tree, multibody.nv);
        let by_body = || vec![SpatialVector::zeros(); b];
        let by_tree = || vec![SpatialVector::zeros(); t];
        Self {
            rate: vec![Rate::ZERO; b],
            inertial: by_body(),
            external: by_body(),
            D: by_tree(),
            E: by_tree(),
            H: by_tree(),
            U: by_tree(),
            y: vec![Vector3::zeros(); t],
            d_q: vec![0.0; n * n],
            d_v: vec![0.0; n * n],
            inside: vec![false; b],
        }
    }
}

impl Multibody {
    /// Derivatives of [`Self::inverse_dynamics`] by position and velocity, at the workspace's state. External forces stay as
    /// they are in the world. The derivative by `a` is [`Self::mass_matrix`].
    ///
    /// # Errors
    /// A vector or matrix of the wrong size, or with a number that is not finite; a workspace of another multibody.
    pub fn inverse_dynamics_derivatives(
        &self,
        ws: &mut Workspace,
        a: &[f64],
        external: &[ExternalWrench],
        derivatives: &mut InverseDynamicsDerivatives,
    ) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("a", a, self.nv)?;
        self.square(&derivatives.d_q)?;
        self.square(&derivatives.d_v)?;
        self.gather_external(ws, external)?;
        self.accelerations(ws, a);
        self.differentiate(ws);
        transpose_into(&ws.variation.d_q, &mut derivatives.d_q);
        transpose_into(&ws.variation.d_v, &mut derivatives.d_v);
        Ok(())
    }

    /// Accelerations `a` as [`Self::forward_dynamics`] gives them, and their derivatives by position, velocity and effort, at
    /// the workspace's state. External forces stay as they are in the world.
    ///
    /// # Errors
    /// A vector or matrix of the wrong size, or with a number that is not finite; a joint that moves no inertia; a workspace of
    /// another multibody.
    pub fn forward_dynamics_derivatives(
        &self,
        ws: &mut Workspace,
        tau: &[f64],
        external: &[ExternalWrench],
        a: &mut [f64],
        derivatives: &mut ForwardDynamicsDerivatives,
    ) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("tau", tau, self.nv)?;
        length("a", a.len(), self.nv)?;
        for matrix in [&derivatives.d_q, &derivatives.d_v, &derivatives.d_tau] {
            self.square(matrix)?;
        }
        self.gather_external(ws, external)?;
        self.through_mass_matrix(ws, tau, a)?;
        self.accelerations(ws, a);
        self.differentiate(ws);
        let n = self.nv;
        for k in 0..n {
            let column = &mut derivatives.d_tau.as_mut_slice()[k * n..(k + 1) * n];
            column.fill(0.0);
            column[k] = 1.0;
            crate::linear::cholesky_solve(&ws.factor, n, column);
        }
        for (of, to) in [(&ws.variation.d_q, &mut derivatives.d_q), (&ws.variation.d_v, &mut derivatives.d_v)] {
            to.fill(0.0);
            let inverse = derivatives.d_tau.as_slice();
            for (row, inverse) in of.chunks_exact(n).zip(inverse.chunks_exact(n)) {
                for (x, column) in row.iter().zip(to.as_mut_slice().chunks_exact_mut(n)) {
                    for (y, m) in column.iter_mut().zip(inverse) {
                        *y -= m * x;
                    }
                }
            }
        }
        Ok(())
    }

    fn square(&self, matrix: &DMatrix<f64>) -> Result<(), DynamicsError> {
        length("rows of a derivative", matrix.nrows(), self.nv)?;
        length("columns of a derivative", matrix.ncols(), self.nv)
    }

    /// Accelerations of all bodies, gravity in place of the world's, and the forces that their inertia needs.
    pub(crate) fn accelerations(&self, ws: &mut Workspace, a: &[f64]) {
        ws.A[0] = join(&Vector3::zeros(), &-self.gravity);
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let mut A = ws.A[body.parent] + ws.c[i];
            for k in 0..body.nv {
                A += ws.S[body.tree + k] * a[body.v + k];
            }
            let (V, I) = (&ws.V[i], &ws.inertia[i]);
            let P = I.times(V);
            ws.A[i] = A;
            ws.variation.inertial[i] = I.times(&A) + cross_force(V, &P);
            ws.variation.rate[i] = Rate::new(I, V, &P);
        }
    }

    /// Derivatives of inverse dynamics into the workspace's `variation`, after [`Self::accelerations`] and with external
    /// forces gathered.
    pub(crate) fn differentiate(&self, ws: &mut Workspace) {
        let n = self.nv;
        let Workspace { variation: x, S, V, A, external, inertia, composite, .. } = ws;
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let (V_P, A_P) = (&V[body.parent], &A[body.parent]);
            for t in body.tree_range() {
                let D = cross_motion(V_P, &S[t]);
                x.E[t] = cross_motion(A_P, &S[t]) + cross_motion(V_P, &D);
                x.H[t] = D + cross_motion(&V[i], &S[t]);
                x.D[t] = D;
            }
        }
        x.external.copy_from_slice(external);
        composite.copy_from_slice(inertia);
        x.d_q.fill(0.0);
        x.d_v.fill(0.0);
        for i in (1..self.bodies.len()).rev() {
            let body = &self.bodies[i];
            let (I, rate, f, e) = (composite[i], x.rate[i], x.inertial[i], x.external[i]);
            let parent = body.parent;
            if parent != 0 {
                composite[parent] += I;
                x.rate[parent].R += rate.R;
                x.rate[parent].p += rate.p;
                x.inertial[parent] += f;
                x.external[parent] += e;
            }
            for (k, l) in body.tree_range().enumerate() {
                let row = body.v + k;
                let U = I.times(&S[l]);
                let y = rate.transposed_times(&S[l]);
                // S_l . (S_k x* e) = - S_k . (S_l x* e)
                let turned = -cross_force(&S[l], &e);
                let G = I.times(&x.E[l]) + rate.times(&angular(&x.D[l])) + cross_force(&S[l], &f);
                let H = I.times(&x.H[l]) + rate.times(&angular(&S[l]));
                x.U[l] = U;
                x.y[l] = y;
                // The joint's own degrees of freedom all count as outer rows.
                let mut at = i;
                while at != 0 {
                    let inner = &self.bodies[at];
                    for (c, k) in inner.tree_range().enumerate() {
                        let column = inner.v + c;
                        x.d_q[row * n + column] += U.dot(&x.E[k]) + y.dot(&angular(&x.D[k])) + S[k].dot(&turned);
                        x.d_v[row * n + column] += U.dot(&x.H[k]) + y.dot(&angular(&S[k]));
                        if at != i {
                            x.d_q[column * n + row] += S[k].dot(&G);
                            x.d_v[column * n + row] += S[k].dot(&H);
                        }
                    }
                    at = inner.parent;
                }
            }
        }
    }
}

/// A row-major square matrix into a column-major one.
fn transpose_into(from: &[f64], to: &mut DMatrix<f64>) {
    for (i, row) in from.chunks_exact(to.ncols().max(1)).enumerate() {
        for (j, x) in row.iter().enumerate() {
            to[(i, j)] = *x;
        }
    }
}
