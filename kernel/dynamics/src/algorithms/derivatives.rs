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
use crate::linear::tree_solve_rows;
use crate::multibody::length;
use crate::spatial::{angular, join, linear, mul, tr_mul};
use crate::workspace::{Lane, add_scaled};
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
        let (w, v, L, h, J) = (angular(V), linear(V), angular(P), &I.h, &I.I);
        // T = [w x] J - v h^T; the rate of J is T + T^T + 2 (v.h) 1.
        let along = 2.0 * v.dot(h);
        let xx = 2.0 * (w.y * J.m31 - w.z * J.m21 - v.x * h.x) + along;
        let yy = 2.0 * (w.z * J.m12 - w.x * J.m32 - v.y * h.y) + along;
        let zz = 2.0 * (w.x * J.m23 - w.y * J.m13 - v.z * h.z) + along;
        let xy = (w.y * J.m32 - w.z * J.m22 - v.x * h.y) + (w.z * J.m11 - w.x * J.m31 - v.y * h.x);
        let xz = (w.y * J.m33 - w.z * J.m23 - v.x * h.z) + (w.x * J.m21 - w.y * J.m11 - v.z * h.x);
        let yz = (w.z * J.m13 - w.x * J.m33 - v.y * h.z) + (w.x * J.m22 - w.y * J.m12 - v.z * h.y);
        let R = Matrix3::new(xx, xy + L.z, xz - L.y, xy - L.z, yy, yz + L.x, xz + L.y, yz - L.x, zz);
        Self { R, p: linear(P) }
    }

    #[inline]
    pub fn times(&self, w: &Vector3<f64>) -> SpatialVector {
        join(&mul(&self.R, w), &(w.cross(&self.p) * 2.0))
    }

    /// The angular part of the transposed product; its linear part is zero.
    #[inline]
    pub fn transposed_times(&self, S: &SpatialVector) -> Vector3<f64> {
        tr_mul(&self.R, &angular(S)) + self.p.cross(&linear(S)) * 2.0
    }
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
    pub D: Vec<Vector3<f64>>,
    pub E: Vec<SpatialVector>,
    pub H: Vec<SpatialVector>,
    pub y: Vec<Vector3<f64>>,
    /// `E`, `H` and the angular part of `D` by lanes, as the workspace's `S_lanes`.
    lanes: Vec<[Lane; 15]>,
    /// By lanes: one row of the derivatives by q and by v, and one column of each.
    line: Vec<[Lane; 4]>,
    /// Derivatives by q and by v side by side, row-major, `4 width` numbers a row.
    table: Vec<Lane>,
    pub width: usize,
    /// The inverse of the mass matrix, row-major, `4 n.div_ceil(4)` numbers a row.
    inverse: Vec<Lane>,
    /// Scratch: which bodies belong to a subtree.
    pub inside: Vec<bool>,
}

impl Variation {
    pub fn new(multibody: &Multibody) -> Self {
        let (b, t, n) = (multibody.bodies.len(), multibody.tree, multibody.nv);
        let by_body = || vec![SpatialVector::zeros(); b];
        Self {
            rate: vec![Rate::ZERO; b],
            inertial: by_body(),
            external: by_body(),
            D: vec![Vector3::zeros(); t],
            E: vec![SpatialVector::zeros(); t],
            H: vec![SpatialVector::zeros(); t],
            y: vec![Vector3::zeros(); t],
            lanes: vec![[[0.0; 4]; 15]; t.div_ceil(4)],
            line: vec![[[0.0; 4]; 4]; t.div_ceil(4)],
            table: vec![[0.0; 4]; n * (2 * n).div_ceil(4)],
            width: (2 * n).div_ceil(4),
            inverse: vec![[0.0; 4]; n * n.div_ceil(4)],
            inside: vec![false; b],
        }
    }

    /// The derivative by the position, of one degree of freedom whose velocity asks for nothing.
    pub fn set_only(&mut self, by_q: f64) {
        self.table[0] = [by_q, 0.0, 0.0, 0.0];
    }

    /// All of [`Self::row`].
    pub fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.table.as_flattened().chunks_exact(4 * self.width.max(1))
    }

    /// Row `i` of the derivatives of inverse dynamics: by the `n` positions, then by the `n` velocities.
    pub fn row(&self, i: usize) -> &[f64] {
        self.table[i * self.width..(i + 1) * self.width].as_flattened()
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
        self.forces(ws, Some(a), true);
        self.composite(ws);
        self.differentiate(ws);
        let n = self.nv;
        let (d_q, d_v) = (derivatives.d_q.as_mut_slice(), derivatives.d_v.as_mut_slice());
        for i in 0..n {
            let (by_q, by_v) = ws.variation.row(i).split_at(n);
            let columns = d_q[i..].iter_mut().step_by(n).zip(d_v[i..].iter_mut().step_by(n));
            for ((d_q, d_v), (by_q, by_v)) in columns.zip(by_q.iter().zip(by_v)) {
                (*d_q, *d_v) = (*by_q, *by_v);
            }
        }
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
        self.accelerate(ws, a);
        self.differentiate(ws);
        let n = self.nv;
        let x = &mut ws.variation;
        let across = n.div_ceil(4);
        x.inverse.fill([0.0; 4]);
        for i in 0..n {
            x.inverse[i * across + i / 4][i % 4] = 1.0;
        }
        tree_solve_rows(&ws.tree_factor, n, &mut x.inverse, across);
        tree_solve_rows(&ws.tree_factor, n, &mut x.table, x.width);
        let (d_q, d_v, d_tau) = (derivatives.d_q.as_mut_slice(), derivatives.d_v.as_mut_slice(), derivatives.d_tau.as_mut_slice());
        for i in 0..n {
            d_tau[i * n..(i + 1) * n].copy_from_slice(&x.inverse[i * across..(i + 1) * across].as_flattened()[..n]);
            let (by_q, by_v) = x.row(i).split_at(n);
            let columns = d_q[i..].iter_mut().step_by(n).zip(d_v[i..].iter_mut().step_by(n));
            for ((d_q, d_v), (by_q, by_v)) in columns.zip(by_q.iter().zip(by_v)) {
                (*d_q, *d_v) = (-by_q, -by_v);
            }
        }
        Ok(())
    }

    fn square(&self, matrix: &DMatrix<f64>) -> Result<(), DynamicsError> {
        length("rows of a derivative", matrix.nrows(), self.nv)?;
        length("columns of a derivative", matrix.ncols(), self.nv)
    }

    /// Derivatives of inverse dynamics into the workspace's `variation`, after [`Multibody::forces`] and
    /// [`Multibody::composite`], with external forces gathered.
    pub(crate) fn differentiate(&self, ws: &mut Workspace) {
        self.differentiate_on::<false>(ws);
    }

    /// The same where bases give way, if `SWAYS`: after [`Multibody::accelerate_bases`].
    pub(crate) fn differentiate_on<const SWAYS: bool>(&self, ws: &mut Workspace) {
        let n = self.nv;
        let Workspace { variation: x, S, V, A, P, external, inertial, inertia, composite, S_lanes, IS, bases, .. } = ws;
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let (V_P, A_P) = (&V[body.parent], if SWAYS { &(A[body.parent] + bases[i][0]) } else { &A[body.parent] });
            x.rate[i] = Rate::new(&inertia[i], &V[i], &P[i]);
            for t in body.tree_range() {
                let D = cross_motion(V_P, &S[t]);
                let E = cross_motion(A_P, &S[t]) + cross_motion(V_P, &D);
                // One degree of freedom does not turn itself: V x S = V_P x S.
                let H = D + if body.nv == 1 { D } else { cross_motion(&V[i], &S[t]) };
                let lanes = &mut x.lanes[t / 4];
                for r in 0..6 {
                    lanes[r][t % 4] = E[r];
                    lanes[r + 6][t % 4] = H[r];
                }
                for r in 0..3 {
                    lanes[r + 12][t % 4] = D[r];
                }
                (x.D[t], x.E[t], x.H[t]) = (angular(&D), E, H);
            }
        }
        x.external.copy_from_slice(external);
        x.inertial.copy_from_slice(inertial);
        let pushed = external.iter().any(|e| *e != SpatialVector::zeros());
        x.table.fill([0.0; 4]);
        let (width, table) = (4 * x.width, x.table.as_flattened_mut());
        for (i, body) in self.bodies.iter().enumerate().skip(1).rev() {
            let (I, rate, f, e) = (&composite[i], x.rate[i], x.inertial[i], x.external[i]);
            let parent = body.parent;
            if parent != 0 {
                x.rate[parent].R += rate.R;
                x.rate[parent].p += rate.p;
                x.inertial[parent] += f;
                if pushed {
                    x.external[parent] += e;
                }
            }
            // The joint's own degrees of freedom all count as outer rows.
            let end = body.tree + body.nv;
            for (k, l) in body.tree_range().enumerate() {
                let row = body.v + k;
                let y = rate.transposed_times(&S[l]);
                x.y[l] = y;
                let G = I.times(&x.E[l]) + rate.times(&x.D[l]) + cross_force(&S[l], &f);
                let H = I.times(&x.H[l]) + rate.times(&angular(&S[l]));
                let blocks = body.first / 4..end.div_ceil(4);
                for block in blocks.clone() {
                    x.line[block] = products(&S_lanes[block], &x.lanes[block], [&IS[l], &G, &H], &y);
                }
                if pushed {
                    // S_l . (S_k x* e) = - S_k . (S_l x* e)
                    let turned = -cross_force(&S[l], &e);
                    for block in blocks {
                        for r in 0..6 {
                            add_scaled(&mut x.line[block][0], turned[r], &S_lanes[block][r]);
                        }
                    }
                }
                for (c, k) in body.tree_range().enumerate() {
                    let line = &x.line[k / 4];
                    table[row * width + body.v + c] += line[0][k % 4];
                    table[row * width + n + body.v + c] += line[1][k % 4];
                }
                let mut at = parent;
                while at != 0 {
                    let inner = &self.bodies[at];
                    for (c, k) in inner.tree_range().enumerate() {
                        let (column, line, lane) = (inner.v + c, &x.line[k / 4], k % 4);
                        table[row * width + column] += line[0][lane];
                        table[row * width + n + column] += line[1][lane];
                        table[column * width + row] += line[2][lane];
                        table[column * width + n + row] += line[3][lane];
                    }
                    at = inner.parent;
                }
            }
        }
    }
}

/// For four columns `k`: `U . E_k + y . D_k`, `U . H_k + y . S_k`, `G . S_k`, `H . S_k`.
#[inline(always)]
fn products(S: &[Lane; 6], lanes: &[Lane; 15], [U, G, H]: [&SpatialVector; 3], y: &Vector3<f64>) -> [Lane; 4] {
    let mut out = [[0.0; 4]; 4];
    for r in 0..6 {
        add_scaled(&mut out[0], U[r], &lanes[r]);
        add_scaled(&mut out[1], U[r], &lanes[r + 6]);
        add_scaled(&mut out[2], G[r], &S[r]);
        add_scaled(&mut out[3], H[r], &S[r]);
    }
    for r in 0..3 {
        add_scaled(&mut out[0], y[r], &lanes[r + 12]);
        add_scaled(&mut out[1], y[r], &S[r]);
    }
    out
}
