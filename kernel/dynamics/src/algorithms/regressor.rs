//! The torque regressor: inverse dynamics is linear in the inertia of each body, `ID = Y(q, v, a) pi` (Atkeson, An and
//! Hollerbach 1986). Row `k` of a body's block is the gradient of the virtual power of `S_k`:
//! `S_k . (I A + V x* I V) = S_k . I A + (S_k x V) . I V`, all written in the body's frame.

use nalgebra::DMatrix;

use super::adjoint::{add_inertial, to_body};
use crate::error::check;
use crate::multibody::length;
use crate::{DynamicsError, LinkId, Multibody, Workspace, cross_motion};

impl Multibody {
    /// The torque regressor at the workspace's state: `tau = Y pi` plus the efforts of armatures. Ten columns a moving body, in
    /// the order of [`crate::SpatialInertia::entries`], for the body's lumped inertia in the frame of the link that its joint
    /// moves; [`Self::regressor_columns`] says where they stand.
    ///
    /// # Errors
    /// A vector or matrix of the wrong size, or with a number that is not finite; a workspace of another multibody.
    pub fn torque_regressor(&self, ws: &mut Workspace, a: &[f64], Y: &mut DMatrix<f64>) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("a", a, self.nv)?;
        length("rows of the regressor", Y.nrows(), self.nv)?;
        length("columns of the regressor", Y.ncols(), 10 * (self.bodies.len() - 1))?;
        Y.fill(0.0);
        self.forces(ws, Some(a), true);
        for (i, block) in (1..self.bodies.len()).zip(Y.as_mut_slice().chunks_exact_mut(10 * self.nv.max(1))) {
            let (R, p) = (&ws.R_WB[i], &ws.p_WB[i]);
            let (A, V) = (to_body(&ws.A[i], R, p), to_body(&ws.V[i], R, p));
            let mut at = i;
            while at != 0 {
                let body = &self.bodies[at];
                for (t, v) in body.tree_range().zip(body.v..) {
                    let S = to_body(&ws.S[t], R, p);
                    let mut row = [0.0; 10];
                    add_inertial(&mut row, &S, &A);
                    add_inertial(&mut row, &cross_motion(&S, &V), &V);
                    for (entry, column) in row.iter().zip(block.chunks_exact_mut(self.nv)) {
                        column[v] += entry;
                    }
                }
                at = body.parent;
            }
        }
        Ok(())
    }

    /// Columns of the body that carries a link, in [`Self::torque_regressor`]; none for what is fixed to the world.
    pub fn regressor_columns(&self, link: LinkId) -> Option<std::ops::Range<usize>> {
        let body = self.frames[link.0].body.checked_sub(1)?;
        Some(10 * body..10 * body + 10)
    }
}
