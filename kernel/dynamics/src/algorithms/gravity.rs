//! Gravity's efforts and how they change with position: gradient and Hessian of the potential energy.
//!
//! With the mass `m` and the first moment `h` about the world's origin, both of the subtree that the degree of freedom `k` carries, and
//! `S_k = [s; s']`,
//!
//! `g_k = -(s x h + m s') . gravity`,
//!
//! for `dh/dq_k = s x h + m s'`. A degree of freedom `l` on or behind the body of `k` changes the first moment of what both carry
//! by `dh/dq_l` of its own subtree, and so
//!
//! `dg_k / dq_l = dg_l / dq_k = -s_k . (dh/dq_l x gravity)`.

use nalgebra::{DMatrix, Vector3};

use crate::multibody::length;
use crate::spatial::{angular, join, linear};
use crate::{DynamicsError, Multibody, SpatialVector, Workspace};

impl Multibody {
    /// Efforts `g(q)` that hold the workspace's positions at rest, as [`Self::gravity_efforts`], and their derivative by position
    /// (nv x nv; columns by the entry of `v` that moves along).
    ///
    /// # Errors
    /// A vector or matrix of the wrong size; a workspace of another multibody.
    pub fn gravity_efforts_derivatives(&self, ws: &mut Workspace, tau: &mut [f64], d_q: &mut DMatrix<f64>) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        length("tau", tau.len(), self.nv)?;
        length("rows of a derivative", d_q.nrows(), self.nv)?;
        length("columns of a derivative", d_q.ncols(), self.nv)?;
        tau.fill(0.0);
        d_q.fill(0.0);
        let Workspace { F: carried, S, inertia, .. } = ws;
        // First moment and mass of each subtree.
        for (carried, I) in carried.iter_mut().zip(inertia.iter()) {
            *carried = join(&I.h, &Vector3::new(I.mass, 0.0, 0.0));
        }
        for (i, body) in self.bodies.iter().enumerate().skip(1).rev() {
            let whole = carried[i];
            if body.parent != 0 {
                carried[body.parent] += whole;
            }
            let (h, m) = (angular(&whole), whole[3]);
            for (c, l) in body.tree_range().enumerate() {
                let row = body.v + c;
                let dh = angular(&S[l]).cross(&h) + linear(&S[l]) * m;
                tau[row] -= dh.dot(&self.gravity);
                let turned = -dh.cross(&self.gravity);
                let by = |S: &SpatialVector| angular(S).dot(&turned);
                for (c, k) in body.tree_range().enumerate() {
                    d_q[(row, body.v + c)] += by(&S[k]);
                }
                let mut at = body.parent;
                while at != 0 {
                    let inner = &self.bodies[at];
                    for (c, k) in inner.tree_range().enumerate() {
                        let value = by(&S[k]);
                        d_q[(row, inner.v + c)] += value;
                        d_q[(inner.v + c, row)] += value;
                    }
                    at = inner.parent;
                }
            }
        }
        Ok(())
    }
}
