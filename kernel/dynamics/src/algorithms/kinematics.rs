//! Poses and velocities of all bodies.
//!
//! From parent `P` to child `B`: `X_WB = X_WP X_PJ X_JB(q)` and `V_WB = V_WP + S v`, where the columns of `S` are the
//! joint's motion subspace in the world; those of a joint that follows another hold its ratio, so that `v` is always the
//! leader's. `S` is constant in the child, so `dS/dt = V_WB x S`, and the joint adds the
//! acceleration `c = V_WB x S v` at constant `v` (Featherstone 2008, section 4.4, in world coordinates).

use nalgebra::{Isometry3, Vector3};
use sagci_model::JointKind;

use crate::error::check;
use crate::joint::isometry;
use crate::spatial::{angular, join, linear, mul, mul_mat};
use crate::{DynamicsError, LinkId, Multibody, SpatialVector, Workspace, cross_motion};

impl Multibody {
    /// Puts a state into the workspace and computes poses and velocities of all bodies.
    ///
    /// Quaternions of floating joints are brought to unit length.
    ///
    /// # Errors
    /// A vector of the wrong length, a number that is not finite, a quaternion of length far from one, a workspace of
    /// another multibody.
    pub fn set_state(&self, ws: &mut Workspace, q: &[f64], v: &[f64]) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("q", q, self.nq)?;
        check("v", v, self.nv)?;
        for body in self.bodies.iter().skip(1).filter(|b| b.nq == 7) {
            let norm = q[body.q..body.q + 4].iter().map(|x| x * x).sum::<f64>().sqrt();
            if (norm - 1.0).abs() > 1e-3 {
                let what = format!("the length of the quaternion of joint '{}'", self.joints[body.joint].name);
                return Err(DynamicsError::OutOfBounds { what, value: norm, must: "1".into() });
            }
        }
        ws.q.copy_from_slice(q);
        ws.v.copy_from_slice(v);
        self.kinematics(ws);
        Ok(())
    }

    /// [`Self::set_state`] at rest.
    ///
    /// # Errors
    /// As there.
    pub fn set_positions(&self, ws: &mut Workspace, q: &[f64]) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        let mut v = std::mem::take(&mut ws.scratch);
        v.fill(0.0);
        let result = self.set_state(ws, q, &v);
        ws.scratch = v;
        result
    }

    pub(crate) fn kinematics(&self, ws: &mut Workspace) {
        ws.inertia[0] = self.inertia[0];
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let (R_WP, p_WP) = (&ws.R_WB[body.parent], &ws.p_WB[body.parent]);
            let p_WJ = p_WP + mul(R_WP, &body.p_PJ);
            let (R, p);
            match body.motion.kind {
                JointKind::Revolute | JointKind::Continuous => {
                    let (sin, cos) = (body.ratio * ws.q[body.q] + body.offset).sin_cos();
                    let n = mul(R_WP, &body.axis_P);
                    (R, p) = (mul_mat(R_WP, &(body.turn[0] + body.turn[1] * cos + body.turn[2] * sin)), p_WJ);
                    let s = n * body.ratio;
                    ws.S[body.tree] = join(&s, &p.cross(&s));
                }
                JointKind::Prismatic => {
                    let n = mul(R_WP, &body.axis_P);
                    (R, p) = (mul_mat(R_WP, &body.R_PJ), p_WJ + n * (body.ratio * ws.q[body.q] + body.offset));
                    ws.S[body.tree] = join(&Vector3::zeros(), &(n * body.ratio));
                }
                JointKind::Fixed | JointKind::Planar | JointKind::Floating => {
                    let (R_JB, p_JB) = body.motion.pose(&ws.q[body.q..body.q + body.nq]);
                    let R_WJ = mul_mat(R_WP, &body.R_PJ);
                    (R, p) = (mul_mat(&R_WJ, &R_JB), p_WJ + mul(&R_WJ, &p_JB));
                    body.motion.subspace(&R, &p, &mut ws.S[body.tree_range()]);
                }
            }
            ws.inertia[i] = self.inertia[i].moved(&R, &p);
            ws.R_WB[i] = R;
            ws.p_WB[i] = p;
        }
        self.velocities(ws);
    }

    /// Velocities of all bodies, at poses that are there already.
    pub(crate) fn velocities(&self, ws: &mut Workspace) {
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let mut Sv = ws.S[body.tree] * ws.v[body.v];
            for k in 1..body.nv {
                Sv += ws.S[body.tree + k] * ws.v[body.v + k];
            }
            let V = ws.V[body.parent] + Sv;
            ws.c[i] = cross_motion(&V, &Sv);
            ws.V[i] = V;
        }
    }

    /// Pose of a link in the world.
    pub fn X_WL(&self, ws: &Workspace, link: LinkId) -> Isometry3<f64> {
        let frame = &self.frames[link.0];
        isometry(&ws.R_WB[frame.body], &ws.p_WB[frame.body]) * frame.X_BL
    }

    /// Spatial velocity of a link's frame: angular velocity and velocity of the frame's origin, in the world's axes.
    pub fn V_WL(&self, ws: &Workspace, link: LinkId) -> SpatialVector {
        let frame = &self.frames[link.0];
        let V = &ws.V[frame.body];
        let p = ws.p_WB[frame.body] + ws.R_WB[frame.body] * frame.X_BL.translation.vector;
        join(&angular(V), &(linear(V) + angular(V).cross(&p)))
    }
}
