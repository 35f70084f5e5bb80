//! Recursive Newton-Euler (Featherstone 2008, section 5.3, in world coordinates).
//!
//! Outward: `A_B = A_P + S a + c`, with `A_world = -g` in place of gravity. Inward:
//! `F_B = I_B A_B + V_B x* I_B V_B - F_ext + sum of the children's F`, and `tau = S^T F_B`.

use nalgebra::Vector3;

use crate::error::check;
use crate::multibody::length;
use crate::spatial::{dot, join};
use crate::{DynamicsError, ExternalWrench, Multibody, SpatialVector, Workspace, cross_force};

impl Multibody {
    /// Efforts that give the accelerations `a` at the workspace's state under gravity and external forces:
    /// `tau = M a + c(q, v) + g(q) - J^T F_ext`. Joint damping and friction are not part of it.
    ///
    /// # Errors
    /// A vector of the wrong length or with a number that is not finite; a workspace of another multibody.
    pub fn inverse_dynamics(
        &self,
        ws: &mut Workspace,
        a: &[f64],
        external: &[ExternalWrench],
        tau: &mut [f64],
    ) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("a", a, self.nv)?;
        length("tau", tau.len(), self.nv)?;
        self.gather_external(ws, external)?;
        self.newton_euler(ws, Some(a), true, tau);
        for (tau, (armature, a)) in tau.iter_mut().zip(self.armature.iter().zip(a)) {
            *tau += armature * a;
        }
        Ok(())
    }

    /// Efforts that hold the workspace's positions at rest against gravity: `g(q)`.
    ///
    /// # Errors
    /// `tau` of the wrong length; a workspace of another multibody.
    pub fn gravity_efforts(&self, ws: &mut Workspace, tau: &mut [f64]) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        length("tau", tau.len(), self.nv)?;
        ws.external.fill(SpatialVector::zeros());
        self.newton_euler(ws, None, false, tau);
        Ok(())
    }

    /// Coriolis, centrifugal and gravity efforts: `c(q, v) + g(q)`.
    ///
    /// # Errors
    /// `tau` of the wrong length; a workspace of another multibody.
    pub fn bias_efforts(&self, ws: &mut Workspace, tau: &mut [f64]) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        length("tau", tau.len(), self.nv)?;
        ws.external.fill(SpatialVector::zeros());
        self.newton_euler(ws, None, true, tau);
        Ok(())
    }

    /// Adds up the forces on each body.
    pub(crate) fn gather_external(&self, ws: &mut Workspace, external: &[ExternalWrench]) -> Result<(), DynamicsError> {
        ws.external.fill(SpatialVector::zeros());
        for wrench in external {
            check("an external wrench", wrench.F_W.as_slice(), 6)?;
            ws.external[self.frames[wrench.link.0].body] += wrench.F_W;
        }
        Ok(())
    }

    /// `a: None` counts as zero. `moving: false` leaves the velocities out.
    pub(crate) fn newton_euler(&self, ws: &mut Workspace, a: Option<&[f64]>, moving: bool, tau: &mut [f64]) {
        self.forces(ws, a, moving);
        for (F, (inertial, external)) in ws.F.iter_mut().zip(ws.inertial.iter().zip(&ws.external)) {
            *F = inertial - external;
        }
        tau.fill(0.0);
        for (i, body) in self.bodies.iter().enumerate().skip(1).rev() {
            let F = ws.F[i];
            if body.nv == 1 {
                tau[body.v] += dot(&ws.S[body.tree], &F);
            } else {
                for k in 0..body.nv {
                    tau[body.v + k] += dot(&ws.S[body.tree + k], &F);
                }
            }
            if body.parent != 0 {
                ws.F[body.parent] += F;
            }
        }
    }

    /// The outward pass: acceleration of each body, gravity in place of the world's, and the force that its inertia needs.
    /// Where it moves, its momentum too.
    pub(crate) fn forces(&self, ws: &mut Workspace, a: Option<&[f64]>, moving: bool) {
        ws.A[0] = join(&Vector3::zeros(), &-self.gravity);
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let mut A = ws.A[body.parent];
            if let Some(a) = a {
                for k in 0..body.nv {
                    A += ws.S[body.tree + k] * a[body.v + k];
                }
            }
            let I = &ws.inertia[i];
            let mut F = SpatialVector::zeros();
            if moving {
                A += ws.c[i];
                let V = &ws.V[i];
                let P = I.times(V);
                F = cross_force(V, &P);
                ws.P[i] = P;
            }
            ws.inertial[i] = F + I.times(&A);
            ws.A[i] = A;
        }
    }

    /// Adds the accelerations of bases that give way to those that [`Self::forces`] had.
    pub(crate) fn accelerate_bases(&self, ws: &mut Workspace) {
        ws.F[0] = SpatialVector::zeros();
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let dA = ws.F[body.parent] + ws.bases[i][0];
            ws.A[i] += dA;
            ws.inertial[i] += ws.inertia[i].times(&dA);
            ws.F[i] = dA;
        }
    }

    /// Adds the accelerations `a` to those that [`Self::forces`] had.
    pub(crate) fn accelerate(&self, ws: &mut Workspace, a: &[f64]) {
        // `F` is free: the change of each body's acceleration.
        ws.F[0] = SpatialVector::zeros();
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let mut dA = ws.F[body.parent];
            for k in 0..body.nv {
                dA += ws.S[body.tree + k] * a[body.v + k];
            }
            ws.A[i] += dA;
            ws.inertial[i] += ws.inertia[i].times(&dA);
            ws.F[i] = dA;
        }
    }
}
