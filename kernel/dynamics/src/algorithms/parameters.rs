//! Derivatives of inverse dynamics by parameters, one column each: the forward side of [`super::adjoint`], for Jacobians.
//!
//! A body's inertia acts on the degrees of freedom before it only. An origin that moves by a twist `T` carries all behind it,
//! as a displacement of the joint along `T` would, so its column is that of [`super::derivatives`] with `T` for `S_k`. A turned
//! axis is two such twists (the joint's frame forth, the child's back), and motion subspaces `S_k` that turn in the child.

use nalgebra::{DMatrix, Vector3};
use sagci_model::JointKind;

use super::adjoint::by_axis;
use crate::error::check;
use crate::joint::{matrix, plane_axes};
use crate::multibody::length;
use crate::spatial::{angular, join};
use crate::{
    DynamicsError, ExternalWrench, JointId, LinkId, Multibody, SpatialInertia, SpatialVector, Workspace, cross_force, cross_motion,
};

/// One parameter of the rigid bodies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RigidParameter {
    /// An entry of a link's own inertia, in the order of [`SpatialInertia::entries`].
    Inertia(LinkId, usize),
    /// An entry of the twist that moves a joint's origin, in the joint's frame, angular part first: `X_PJ exp(twist)`.
    Origin(JointId, usize),
    /// A joint's axis moves toward one of [`crate::plane_axes`].
    Axis(JointId, usize),
    /// Armature of one degree of freedom.
    Armature(usize),
    /// An entry of gravity.
    Gravity(usize),
}

impl Multibody {
    /// Derivatives of [`Self::inverse_dynamics`] by parameters, one column each (nv rows), at the workspace's state.
    ///
    /// # Errors
    /// A vector or matrix of the wrong size, or with a number that is not finite; an entry that a parameter does not have; a
    /// workspace of another multibody.
    pub fn inverse_dynamics_by_parameters(
        &self,
        ws: &mut Workspace,
        a: &[f64],
        external: &[ExternalWrench],
        parameters: &[RigidParameter],
        columns: &mut DMatrix<f64>,
    ) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("a", a, self.nv)?;
        length("rows of the derivative by parameters", columns.nrows(), self.nv)?;
        length("columns of the derivative by parameters", columns.ncols(), parameters.len())?;
        self.gather_external(ws, external)?;
        self.forces(ws, Some(a), true);
        self.composite(ws);
        self.differentiate(ws);
        let n = self.nv.max(1);
        for (parameter, column) in parameters.iter().zip(columns.as_mut_slice().chunks_exact_mut(n)) {
            self.parameter_column(ws, a, *parameter, column)?;
        }
        Ok(())
    }

    /// One column, after [`Multibody::differentiate`].
    pub(crate) fn parameter_column(
        &self,
        ws: &mut Workspace,
        a: &[f64],
        parameter: RigidParameter,
        column: &mut [f64],
    ) -> Result<(), DynamicsError> {
        column.fill(0.0);
        let bound = |what: &str, given: usize, limit: usize| {
            let fault = || DynamicsError::OutOfBounds { what: what.into(), value: given as f64, must: format!("below {limit}") };
            if given < limit { Ok(()) } else { Err(fault()) }
        };
        match parameter {
            RigidParameter::Inertia(link, entry) => {
                bound("an entry of an inertia", entry, 10)?;
                bound("a link", link.0, self.frames.len())?;
                let mut unit = [0.0; 10];
                unit[entry] = 1.0;
                let frame = &self.frames[link.0];
                let (R, p) = (ws.R_WB[frame.body], ws.p_WB[frame.body]);
                let on_body = SpatialInertia::from_entries(&unit).moved(&matrix(&frame.X_BL.rotation), &frame.X_BL.translation.vector);
                let force = inertial_force(&on_body.moved(&R, &p), &ws.A[frame.body], &ws.V[frame.body]);
                self.on_the_way(ws, frame.body, &force, column);
            }
            RigidParameter::Origin(joint, entry) => {
                bound("an entry of an origin", entry, 6)?;
                bound("a joint", joint.0, self.mounts.len())?;
                let mut twist = [0.0; 6];
                twist[entry] = 1.0;
                self.origin_column(ws, joint.0, &SpatialVector::from(twist), column);
            }
            RigidParameter::Axis(joint, across) => {
                bound("a direction across an axis", across, 2)?;
                bound("a joint", joint.0, self.mounts.len())?;
                let mount = &self.mounts[joint.0];
                if mount.kind != JointKind::Fixed {
                    let n = mount.axis;
                    let toward = plane_axes(&n)[across];
                    // The turn that moves the axis that way: the transpose of the gradient's map.
                    let turn = Vector3::from_fn(|k, _| by_axis(mount.kind, &n, &Vector3::ith(k, 1.0)).dot(&toward));
                    self.axis_column(ws, a, mount.body, &turn, column);
                }
            }
            RigidParameter::Armature(v) => {
                bound("a degree of freedom", v, self.nv)?;
                column[v] = a[v];
            }
            RigidParameter::Gravity(k) => {
                bound("an entry of gravity", k, 3)?;
                let A = join(&Vector3::zeros(), &Vector3::ith(k, -1.0));
                for (i, body) in self.bodies.iter().enumerate().skip(1) {
                    let force = ws.composite[i].times(&A);
                    for (t, v) in body.tree_range().zip(body.v..) {
                        column[v] += ws.S[t].dot(&force);
                    }
                }
            }
        }
        Ok(())
    }

    /// Adds what a force on a body asks of the degrees of freedom that move it.
    fn on_the_way(&self, ws: &Workspace, body: usize, force: &SpatialVector, column: &mut [f64]) {
        let mut at = body;
        while at != 0 {
            let body = &self.bodies[at];
            for (t, v) in body.tree_range().zip(body.v..) {
                column[v] += ws.S[t].dot(force);
            }
            at = body.parent;
        }
    }

    /// Adds what `dV_j = X`, `dA_j = Y + X x V_j` for all bodies `j` of the subtree of `i` asks of the efforts.
    fn pushed(&self, ws: &mut Workspace, i: usize, X: &SpatialVector, Y: &SpatialVector, column: &mut [f64]) {
        let w = angular(X);
        let force = ws.composite[i].times(Y) + ws.variation.rate[i].times(&w);
        self.on_the_way(ws, self.bodies[i].parent, &force, column);
        self.mark_subtree(ws, i);
        for (j, body) in self.bodies.iter().enumerate().skip(i) {
            if ws.variation.inside[j] {
                for (t, v) in body.tree_range().zip(body.v..) {
                    column[v] += ws.IS[t].dot(Y) + ws.variation.y[t].dot(&w);
                }
            }
        }
    }

    /// Adds what a displacement of the subtree of `i` along the world twist `T` asks.
    fn displaced(&self, ws: &mut Workspace, i: usize, T: &SpatialVector, column: &mut [f64]) {
        let parent = self.bodies[i].parent;
        let (V_P, A_P) = (ws.V[parent], ws.A[parent]);
        let D = cross_motion(&V_P, T);
        let E = cross_motion(&A_P, T) + cross_motion(&V_P, &D);
        self.pushed(ws, i, &D, &E, column);
        self.on_the_way(ws, parent, &cross_force(T, &ws.variation.inertial[i]), column);
        for (j, body) in self.bodies.iter().enumerate().skip(i) {
            if ws.variation.inside[j] {
                let turned = cross_force(T, &ws.variation.external[j]);
                for (t, v) in body.tree_range().zip(body.v..) {
                    column[v] += ws.S[t].dot(&turned);
                }
            }
        }
    }

    fn mark_subtree(&self, ws: &mut Workspace, i: usize) {
        let inside = &mut ws.variation.inside;
        inside.fill(false);
        inside[i] = true;
        for (j, body) in self.bodies.iter().enumerate().skip(i + 1) {
            inside[j] = inside[body.parent];
        }
    }

    fn origin_column(&self, ws: &mut Workspace, joint: usize, twist: &SpatialVector, column: &mut [f64]) {
        let mount = &self.mounts[joint];
        if mount.kind != JointKind::Fixed {
            if mount.parent.is_some() {
                let body = &self.bodies[mount.body];
                let (R, p) = (ws.R_WB[body.parent], ws.p_WB[body.parent]);
                let T = to_world(twist, &(R * body.R_PJ), &(p + R * body.p_PJ));
                self.displaced(ws, mount.body, &T, column);
            }
            return;
        }
        let X = &self.frames[mount.child].X_BL;
        let (R, p) = (ws.R_WB[mount.body], ws.p_WB[mount.body]);
        let T = to_world(twist, &(R * matrix(&X.rotation)), &(p + R * X.translation.vector));
        // Links, and moving joints, that the fixed joint carries. Each link stands at the place of the joint that carries it.
        for (m, other) in self.mounts.iter().enumerate().skip(joint) {
            let mut at = m;
            while at > joint {
                match (at == m || self.mounts[at].kind == JointKind::Fixed, self.mounts[at].parent) {
                    (true, Some(parent)) => at = parent,
                    _ => break,
                }
            }
            if at != joint {
                continue;
            }
            if other.kind == JointKind::Fixed {
                let frame = &self.frames[m];
                let on_body = frame.inertia.moved(&matrix(&frame.X_BL.rotation), &frame.X_BL.translation.vector);
                let I = on_body.moved(&R, &p);
                let (A, V) = (ws.A[frame.body], ws.V[frame.body]);
                // A body that turns by T under a motion that does not: its motion turns the other way, its force along.
                let (dA, dV) = (-cross_motion(&T, &A), -cross_motion(&T, &V));
                let force = I.times(&dA)
                    + cross_force(&dV, &I.times(&V))
                    + cross_force(&V, &I.times(&dV))
                    + cross_force(&T, &inertial_force(&I, &A, &V));
                self.on_the_way(ws, frame.body, &force, column);
            } else {
                self.displaced(ws, other.body, &T, column);
            }
        }
    }

    fn axis_column(&self, ws: &mut Workspace, a: &[f64], i: usize, turn: &Vector3<f64>, column: &mut [f64]) {
        let body = &self.bodies[i];
        let (R, p) = (ws.R_WB[body.parent], ws.p_WB[body.parent]);
        let twist = join(turn, &Vector3::zeros());
        let forth = to_world(&twist, &(R * body.R_PJ), &(p + R * body.p_PJ));
        let back = to_world(&twist, &ws.R_WB[i], &ws.p_WB[i]);
        self.displaced(ws, i, &(forth - back), column);
        let (mut X, mut Y) = (SpatialVector::zeros(), SpatialVector::zeros());
        let force = ws.variation.inertial[i] - ws.variation.external[i];
        for (t, v) in body.tree_range().zip(body.v..) {
            let dS = cross_motion(&back, &ws.S[t]);
            X += dS * ws.v[v];
            Y += dS * a[v];
            column[v] += dS.dot(&force);
        }
        Y += cross_motion(&ws.V[body.parent], &X) - cross_motion(&X, &ws.V[i]);
        self.pushed(ws, i, &X, &Y, column);
    }
}

/// `I A + V x* I V`.
fn inertial_force(I: &SpatialInertia, A: &SpatialVector, V: &SpatialVector) -> SpatialVector {
    I.times(A) + cross_force(V, &I.times(V))
}

/// A twist in a frame at `R`, `p`, as a world twist at the world's origin.
fn to_world(twist: &SpatialVector, R: &nalgebra::Matrix3<f64>, p: &Vector3<f64>) -> SpatialVector {
    let w = R * angular(twist);
    join(&w, &(R * crate::spatial::linear(twist) + p.cross(&w)))
}
