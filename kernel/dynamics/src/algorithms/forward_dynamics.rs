//! Articulated bodies (Featherstone 2008, section 7.3, in world coordinates).
//!
//! Inward, with `U = I^A S`, `D = S^T U`, `u = tau - S^T p^A`:
//! `I^a = I^A - U D^-1 U^T`, `p^a = p^A + I^a c + U D^-1 u`, both added to the parent. Outward: `A' = A_P + c`,
//! `a = D^-1 (u - U^T A')`, `A = A' + S a`. Joints that follow others couple distant branches, which this recursion cannot
//! see; a tree with such joints goes through its mass matrix.

use crate::error::check;
use crate::linear::{cholesky, cholesky_solve, tree_solve};
use crate::multibody::length;
use crate::spatial::{ArticulatedInertia, dot, join};
use crate::{DynamicsError, ExternalWrench, Multibody, SpatialVector, Workspace, cross_force};

impl Multibody {
    /// Accelerations `a` under the efforts `tau`, gravity and external forces at the workspace's state:
    /// `a = M^-1 (tau - c(q, v) - g(q) + J^T F_ext)`. Joint damping and friction are not part of it.
    ///
    /// # Errors
    /// A vector of the wrong length or with a number that is not finite; a joint that moves no inertia; a workspace of
    /// another multibody.
    pub fn forward_dynamics(
        &self,
        ws: &mut Workspace,
        tau: &[f64],
        external: &[ExternalWrench],
        a: &mut [f64],
    ) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("tau", tau, self.nv)?;
        length("a", a.len(), self.nv)?;
        self.gather_external(ws, external)?;
        if self.has_followers { self.through_mass_matrix(ws, tau, a) } else { self.articulated(ws, tau, a) }
    }

    pub(crate) fn through_mass_matrix(&self, ws: &mut Workspace, tau: &[f64], a: &mut [f64]) -> Result<(), DynamicsError> {
        self.newton_euler(ws, None, true, a);
        for (a, tau) in a.iter_mut().zip(tau) {
            *a = tau - *a;
        }
        self.composite(ws);
        self.factor(ws)?;
        tree_solve(&ws.tree_factor, a);
        Ok(())
    }

    fn articulated(&self, ws: &mut Workspace, tau: &[f64], a: &mut [f64]) -> Result<(), DynamicsError> {
        for i in 1..self.bodies.len() {
            let V = &ws.V[i];
            ws.articulated[i] = ArticulatedInertia::rigid(&ws.inertia[i]);
            ws.bias_force[i] = cross_force(V, &ws.inertia[i].times(V)) - ws.external[i];
        }
        for (i, body) in self.bodies.iter().enumerate().skip(1).rev() {
            if body.nv == 1 {
                let S = ws.S[body.tree];
                let (mut I, p) = (ws.articulated[i], ws.bias_force[i]);
                let U = I.times(&S);
                let D = dot(&S, &U) + self.armature[body.v];
                if D.is_nan() || D <= 0.0 {
                    return Err(self.no_inertia(body.v));
                }
                let (u, inverse) = (tau[body.v] - dot(&S, &p), 1.0 / D);
                ws.U[body.tree] = U;
                ws.u[body.tree] = u;
                ws.D[i][0] = inverse;
                if body.parent != 0 {
                    I.subtract(inverse, &U);
                    ws.bias_force[body.parent] += p + I.times(&ws.c[i]) + U * (inverse * u);
                    ws.articulated[body.parent] += I;
                }
            } else {
                self.eliminate(ws, i, tau)?;
            }
        }
        let zero = nalgebra::Vector3::zeros();
        ws.A[0] = join(&zero, &-self.gravity);
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let mut A = ws.A[body.parent] + ws.c[i];
            let mut x = [0.0; 6];
            let tree = body.tree..body.tree + body.nv;
            for (x, (u, U)) in x.iter_mut().zip(ws.u[tree.clone()].iter().zip(&ws.U[tree])) {
                *x = u - dot(U, &A);
            }
            if body.nv == 1 {
                x[0] *= ws.D[i][0];
            } else {
                cholesky_solve(&ws.D[i], body.nv, &mut x[..body.nv]);
            }
            for (k, x) in x.iter().enumerate().take(body.nv) {
                A += ws.S[body.tree + k] * *x;
                a[body.v + k] = *x;
            }
            ws.A[i] = A;
        }
        Ok(())
    }

    /// The inward step over a joint of several degrees of freedom.
    fn eliminate(&self, ws: &mut Workspace, i: usize, tau: &[f64]) -> Result<(), DynamicsError> {
        let body = &self.bodies[i];
        let n = body.nv;
        for k in 0..n {
            let S = ws.S[body.tree + k];
            ws.U[body.tree + k] = ws.articulated[i].times(&S);
            ws.u[body.tree + k] = tau[body.v + k] - S.dot(&ws.bias_force[i]);
        }
        for k in 0..n {
            for l in 0..n {
                ws.D[i][k * n + l] = ws.S[body.tree + k].dot(&ws.U[body.tree + l]);
            }
            ws.D[i][k * n + k] += self.armature[body.v + k];
        }
        cholesky(&mut ws.D[i], n).map_err(|pivot| self.no_inertia(body.v + pivot))?;
        if body.parent == 0 {
            return Ok(());
        }
        // I - U^T D^-1 U = I - sum W_k W_k^T with W = L^-1 U, D = L L^T.
        let mut Ia = ws.articulated[i];
        let mut Du = [0.0; 6];
        Du[..n].copy_from_slice(&ws.u[body.tree..body.tree + n]);
        cholesky_solve(&ws.D[i], n, &mut Du[..n]);
        let mut pa = ws.bias_force[i];
        let mut W = [SpatialVector::zeros(); 6];
        for k in 0..n {
            let U = ws.U[body.tree + k];
            let mut row = U;
            for (l, W) in W.iter().enumerate().take(k) {
                row -= W * ws.D[i][k * n + l];
            }
            W[k] = row / ws.D[i][k * n + k];
            Ia.subtract(1.0, &W[k]);
            pa += U * Du[k];
        }
        pa += Ia.times(&ws.c[i]);
        ws.articulated[body.parent] += Ia;
        ws.bias_force[body.parent] += pa;
        Ok(())
    }
}
