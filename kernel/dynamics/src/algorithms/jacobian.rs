//! Geometric Jacobian of a point that is fixed to a link, and the acceleration it has at constant `v`.

use nalgebra::{Matrix6xX, Point3};

use crate::multibody::length;
use crate::spatial::{angular, join, linear};
use crate::{DynamicsError, LinkId, Multibody, SpatialVector, Workspace};

impl Multibody {
    /// `J` with `[omega; v_Q] = J v` for the point `Q` fixed to the link at `p_LQ`, in the world's axes (6 x nv, angular
    /// rows first).
    ///
    /// # Errors
    /// `J` has not nv columns, or the workspace belongs to another multibody.
    pub fn jacobian(&self, ws: &Workspace, link: LinkId, p_LQ: &Point3<f64>, J: &mut Matrix6xX<f64>) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        length("columns of the Jacobian", J.ncols(), self.nv)?;
        J.fill(0.0);
        let frame = &self.frames[link.0];
        let p_WQ = ws.p_WB[frame.body] + ws.R_WB[frame.body] * (frame.X_BL * p_LQ).coords;
        let mut at = frame.body;
        while at != 0 {
            let body = &self.bodies[at];
            for k in 0..body.nv {
                let S = &ws.S[body.tree + k];
                let column = join(&angular(S), &(linear(S) + angular(S).cross(&p_WQ)));
                let mut J_k = J.column_mut(body.v + k);
                J_k += column;
            }
            at = body.parent;
        }
        Ok(())
    }

    /// `dJ/dt v`: angular acceleration, and acceleration of the point `Q`, that the link has at constant `v`; in the
    /// world's axes, without gravity.
    ///
    /// # Errors
    /// The workspace belongs to another multibody.
    pub fn bias_acceleration(&self, ws: &Workspace, link: LinkId, p_LQ: &Point3<f64>) -> Result<SpatialVector, DynamicsError> {
        self.owns(ws)?;
        let frame = &self.frames[link.0];
        let p_WQ = ws.p_WB[frame.body] + ws.R_WB[frame.body] * (frame.X_BL * p_LQ).coords;
        let (mut A, mut at) = (SpatialVector::zeros(), frame.body);
        while at != 0 {
            A += ws.c[at];
            at = self.bodies[at].parent;
        }
        // The spatial acceleration's linear part lacks omega x v of the point (Featherstone 2008, section 2.11).
        let V = &ws.V[frame.body];
        let v_Q = linear(V) + angular(V).cross(&p_WQ);
        Ok(join(&angular(&A), &(linear(&A) + angular(&A).cross(&p_WQ) + angular(V).cross(&v_Q))))
    }
}
