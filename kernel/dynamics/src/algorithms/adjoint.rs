//! The reverse sweep of inverse dynamics: the gradient of the scalar `L = lambda . ID(q, v, a)` by everything it depends on, at
//! the cost of a few recursive Newton-Eulers.
//!
//! With the virtual velocity `W = W_P + S lambda` of each body, `L` is a sum over bodies (virtual power):
//! `L = sum W . (I A + V x* I V - F_ext) = sum W . I A + U . I V - W . F_ext` with `U = W x V`. So it is linear in every
//! inertia, and the cotangents of a body's `V`, `A`, `W` (bars) follow from its own term,
//!
//! `V~ = I U - W x* I V`,  `A~ = I W`,  `W~ = F`,
//!
//! and inward, with the joint's velocity `J = S v`, from `V = V_P + J`, `A = A_P + V_P x J + S a`:
//!
//! `V~_P += V~ + J x* A~`,  `A~_P += A~`,  `W~_P += W~`,  `J~ = V~ - V_P x* A~`,  `S~_k = v_k J~ + a_k A~ + lambda_k W~`.
//!
//! `L` does not change when a subtree, what reaches it from its parent, and the external forces on it turn together. This gives
//! the cotangent `X~` of the subtree's pose without looking into it (sums over the subtree):
//!
//! `X~ = -(V_P x* (V~ + J x* A~) + A_P x* A~ + W_P x* W~ + N)`,  `N = sum W x* F_ext`.
//!
//! A seed `dL = P . dX + Q . dV` on a body's pose and velocity (of contacts, say) adds `Q` to `V~` and `-V x* Q - P` to `N`.
//! `X~` is the gradient by the joint's origin; its share along `S_k` is the gradient by position. An axis that turns by `w`
//! turns the joint's frame by `w` and the child's back, with `S` turned by `w` in the child: the gradient is
//! `X~` taken at the joint's frame less `X~ - sum S_k x* S~_k` taken at the child's frame, angular parts.

use nalgebra::{Matrix3, Vector3};
use sagci_model::JointKind;

use crate::error::check;
use crate::joint::{matrix, plane_axes};
use crate::multibody::length;
use crate::spatial::{angular, join, linear};
use crate::{DynamicsError, ExternalWrench, LinkId, Multibody, SpatialVector, Workspace, cross_force, cross_motion};

/// Gradient of a scalar by the parameters of the rigid bodies. Sums over many sweeps until [`Adjoint::clear`].
#[derive(Debug, Clone, PartialEq)]
pub struct RigidGradient {
    /// By each link's own inertia in its own frame, in the order of [`crate::SpatialInertia::entries`]; by [`LinkId`].
    pub inertia: Vec<[f64; 10]>,
    /// By each joint's origin, as a twist in the joint's own frame: `X_PJ exp(twist)`, angular part first; by [`crate::JointId`].
    /// It counts for everything behind the joint. Zero for floating bases.
    pub origin: Vec<SpatialVector>,
    /// By each joint's axis, across it, in the joint's own frame; by [`crate::JointId`].
    pub axis: Vec<Vector3<f64>>,
    /// By the armature of each degree of freedom.
    pub armature: Vec<f64>,
    /// By gravity.
    pub gravity: Vector3<f64>,
}

impl RigidGradient {
    /// Zeros for a multibody.
    pub fn new(multibody: &Multibody) -> Self {
        Self {
            inertia: vec![[0.0; 10]; multibody.frames.len()],
            origin: vec![SpatialVector::zeros(); multibody.mounts.len()],
            axis: vec![Vector3::zeros(); multibody.mounts.len()],
            armature: vec![0.0; multibody.nv],
            gravity: Vector3::zeros(),
        }
    }
}

/// What one body takes up over the sweeps, in frames in which it stays the same: [`Multibody::rigid_gradient`] maps it to links
/// and joints once, at the end.
#[derive(Debug, Clone, Copy)]
struct BodyGradient {
    /// By the lumped inertia in the body's frame.
    inertia: [f64; 10],
    /// By the joint's origin, in the joint's frame.
    origin: SpatialVector,
    /// By a turn of the joint's axis, in the joint's frame.
    turn: Vector3<f64>,
}

const NOTHING: BodyGradient =
    BodyGradient { inertia: [0.0; 10], origin: SpatialVector::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), turn: Vector3::new(0.0, 0.0, 0.0) };

/// Seeds, results and scratch of the reverse sweep. Made once from a multibody; nothing allocates afterwards.
#[derive(Debug, Clone)]
pub struct Adjoint {
    /// Gradient by position (tangent), velocity and acceleration, of the last sweep alone.
    pub q: Vec<f64>,
    /// As [`Self::q`].
    pub v: Vec<f64>,
    /// As [`Self::q`].
    pub a: Vec<f64>,
    /// The efforts `ID(q, v, a)` of the last sweep, which come with it. Seeds do not enter.
    pub tau: Vec<f64>,
    /// Extra cotangents that the next sweep takes along, and then clears: `dL = pose[b] . dX_b + velocity[b] . dV_b`, by body,
    /// with world twists at the world's origin. Filled by contacts.
    pub(crate) pose: Vec<SpatialVector>,
    pub(crate) velocity: Vec<SpatialVector>,
    /// Cotangents of the pose of single links on their bodies, in the link's frame, summed like parameters. They change
    /// nothing but the gradients by the origins of fixed joints: a contact on a link that a fixed joint carries adds here
    /// what it adds to its body's pose.
    pub(crate) link_pose: Vec<SpatialVector>,
    seeded: bool,
    /// Cotangents of the velocities that bodies have under other rates than `v`, for the next sweep; contacts depend on several.
    pub(crate) channels: [Channel; 3],
    bodies: Vec<BodyGradient>,
    armature: Vec<f64>,
    pub(crate) gravity: Vector3<f64>,
    /// Virtual velocity of each body in the last sweep.
    pub(crate) W: Vec<SpatialVector>,
    V_bar: Vec<SpatialVector>,
    A_bar: Vec<SpatialVector>,
    W_bar: Vec<SpatialVector>,
    N: Vec<SpatialVector>,
}

impl Adjoint {
    /// Zeros for a multibody.
    pub fn new(multibody: &Multibody) -> Self {
        let (b, n) = (multibody.bodies.len(), multibody.nv);
        let by_body = || vec![SpatialVector::zeros(); b];
        let by_velocity = || vec![0.0; n];
        Self {
            q: by_velocity(),
            v: by_velocity(),
            a: by_velocity(),
            tau: by_velocity(),
            pose: by_body(),
            velocity: by_body(),
            link_pose: vec![SpatialVector::zeros(); multibody.frames.len()],
            seeded: false,
            channels: std::array::from_fn(|_| Channel { rates: by_velocity(), seed: by_body(), by_rates: by_velocity(), twist: by_body() }),
            bodies: vec![NOTHING; b],
            armature: by_velocity(),
            gravity: Vector3::zeros(),
            W: by_body(),
            V_bar: by_body(),
            A_bar: by_body(),
            W_bar: by_body(),
            N: by_body(),
        }
    }

    /// Forgets the gradients by parameters.
    pub fn clear(&mut self) {
        self.bodies.fill(NOTHING);
        self.armature.fill(0.0);
        self.gravity = Vector3::zeros();
        self.link_pose.fill(SpatialVector::zeros());
    }

    /// Adds cotangents of the pose and of the velocity of the body that carries a link, for the next sweep:
    /// `dL = pose . dX + velocity . dV`, with world twists at the world's origin.
    pub fn seed(&mut self, multibody: &Multibody, link: LinkId, pose: &SpatialVector, velocity: &SpatialVector) {
        self.seed_body(multibody.frames[link.0].body, pose, velocity);
    }

    /// The gradient by the lumped inertia of a body in its frame, so far.
    pub(crate) fn by_body_inertia(&self, body: usize) -> &[f64; 10] {
        &self.bodies[body].inertia
    }

    /// The gradient by a turn of a body's joint's axis, in the joint's frame, so far.
    pub(crate) fn by_turn(&self, body: usize) -> &Vector3<f64> {
        &self.bodies[body].turn
    }

    pub(crate) fn seed_body(&mut self, body: usize, pose: &SpatialVector, velocity: &SpatialVector) {
        self.pose[body] += pose;
        self.velocity[body] += velocity;
        self.seeded = true;
    }
}

/// Rates, the velocities `B` of the bodies under them, and cotangents `seed` of those: `dL = seed[b] . dB_b`. As a seed on `V`
/// does, they add `B x* seed` to the cotangent of the pose, and `seed` to that of the rates.
#[derive(Debug, Clone)]
pub(crate) struct Channel {
    pub rates: Vec<f64>,
    pub seed: Vec<SpatialVector>,
    /// By the rates, of the last sweep.
    pub by_rates: Vec<f64>,
    twist: Vec<SpatialVector>,
}

impl Multibody {
    /// The reverse sweep at the workspace's state: gradients of `lambda . ID(q, v, a)` by `q`, `v` and `a` into `adjoint`, and
    /// those by parameters added to what is there, unless `parameters` is false. External forces stay as they are in the world.
    /// Seeds given before ([`Adjoint::seed`]) are taken in and cleared.
    ///
    /// # Errors
    /// A vector of the wrong length or with a number that is not finite; a workspace or `adjoint` of another multibody.
    pub fn inverse_dynamics_adjoint(
        &self,
        ws: &mut Workspace,
        lambda: &[f64],
        a: &[f64],
        external: &[ExternalWrench],
        parameters: bool,
        adjoint: &mut Adjoint,
    ) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        check("lambda", lambda, self.nv)?;
        check("a", a, self.nv)?;
        if adjoint.W.len() != self.bodies.len() || adjoint.q.len() != self.nv {
            return Err(DynamicsError::ForeignWorkspace);
        }
        self.gather_external(ws, external)?;
        self.sweep_back(ws, lambda, a, parameters, adjoint);
        Ok(())
    }

    /// [`Self::inverse_dynamics_adjoint`] with external forces gathered and everything checked.
    pub(crate) fn sweep_back(&self, ws: &mut Workspace, lambda: &[f64], a: &[f64], parameters: bool, x: &mut Adjoint) {
        self.sweep_back_on::<false>(ws, lambda, a, parameters, x);
    }

    /// The same where bases give way, if `SWAYS`: what stands on them has their accelerations and virtual velocities too.
    pub(crate) fn sweep_back_on<const SWAYS: bool>(
        &self,
        ws: &mut Workspace,
        lambda: &[f64],
        a: &[f64],
        parameters: bool,
        x: &mut Adjoint,
    ) {
        ws.A[0] = join(&Vector3::zeros(), &-self.gravity);
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let (mut A, mut W) = (ws.A[body.parent] + ws.c[i], x.W[body.parent]);
            if SWAYS {
                A += ws.bases[i][0];
                W += ws.bases[i][1];
            }
            for (k, S) in ws.S[body.tree_range()].iter().enumerate() {
                A += S * a[body.v + k];
                W += S * lambda[body.v + k];
            }
            let (V, I, F_ext) = (&ws.V[i], &ws.inertia[i], &ws.external[i]);
            let (P, U) = (I.times(V), cross_motion(&W, V));
            x.V_bar[i] = I.times(&U) - cross_force(&W, &P);
            x.A_bar[i] = I.times(&W);
            x.W_bar[i] = I.times(&A) + cross_force(V, &P) - F_ext;
            x.N[i] = cross_force(&W, F_ext);
            if x.seeded {
                x.V_bar[i] += x.velocity[i];
                x.N[i] -= cross_force(V, &x.velocity[i]) + x.pose[i];
                for c in &mut x.channels {
                    let mut B = c.twist[body.parent];
                    for (k, S) in ws.S[body.tree_range()].iter().enumerate() {
                        B += S * c.rates[body.v + k];
                    }
                    x.N[i] -= cross_force(&B, &c.seed[i]);
                    c.twist[i] = B;
                }
            }
            if parameters {
                let (R, p) = (&ws.R_WB[i], &ws.p_WB[i]);
                let g = &mut x.bodies[i].inertia;
                let (W, V) = (to_body(&W, R, p), to_body(V, R, p));
                add_inertial(g, &W, &to_body(&A, R, p));
                add_inertial(g, &cross_motion(&W, &V), &V);
            }
            (ws.A[i], x.W[i]) = (A, W);
        }
        for values in [&mut x.q, &mut x.v, &mut x.tau] {
            values.fill(0.0);
        }
        if x.seeded {
            for c in &mut x.channels {
                c.by_rates.fill(0.0);
            }
        }
        for (k, armature) in self.armature.iter().enumerate() {
            x.a[k] = armature * lambda[k];
            x.tau[k] = armature * a[k];
            x.armature[k] += if parameters { lambda[k] * a[k] } else { 0.0 };
        }
        for values in [&mut x.V_bar, &mut x.A_bar, &mut x.W_bar, &mut x.N] {
            values[0] = SpatialVector::zeros();
        }
        for i in (1..self.bodies.len()).rev() {
            let body = &self.bodies[i];
            let P = body.parent;
            let (V_P, V_bar, A_bar, W_bar, N) = (&ws.V[P], x.V_bar[i], x.A_bar[i], x.W_bar[i], x.N[i]);
            let inward = V_bar + cross_force(&(ws.V[i] - V_P), &A_bar);
            let mut X_bar = -(cross_force(V_P, &inward) + cross_force(&ws.A[P], &A_bar) + cross_force(&x.W[P], &W_bar) + N);
            if SWAYS {
                X_bar -= cross_force(&ws.bases[i][0], &A_bar) + cross_force(&ws.bases[i][1], &W_bar);
            }
            if x.seeded {
                for c in &mut x.channels {
                    let seed = c.seed[i];
                    X_bar -= cross_force(&c.twist[P], &seed);
                    c.seed[P] += seed;
                }
            }
            let J_bar = V_bar - cross_force(V_P, &A_bar);
            x.V_bar[P] += inward;
            x.A_bar[P] += A_bar;
            x.W_bar[P] += W_bar;
            x.N[P] += N;
            let mut turned = SpatialVector::zeros();
            for (k, S) in ws.S[body.tree_range()].iter().enumerate() {
                let v = body.v + k;
                x.q[v] += S.dot(&X_bar);
                x.v[v] += S.dot(&J_bar);
                x.a[v] += S.dot(&A_bar);
                x.tau[v] += S.dot(&W_bar);
                if parameters {
                    turned += cross_force(S, &(J_bar * ws.v[v] + A_bar * a[v] + W_bar * lambda[v]));
                }
                if x.seeded {
                    for c in &mut x.channels {
                        c.by_rates[v] += S.dot(&c.seed[i]);
                        if parameters {
                            turned += cross_force(S, &(c.seed[i] * c.rates[v]));
                        }
                    }
                }
            }
            if parameters {
                let (R_WJ, p_WJ) = (ws.R_WB[P] * body.R_PJ, ws.p_WB[P] + ws.R_WB[P] * body.p_PJ);
                let torque = R_WJ.tr_mul(&(angular(&X_bar) - p_WJ.cross(&linear(&X_bar))));
                x.bodies[i].origin += join(&torque, &R_WJ.tr_mul(&linear(&X_bar)));
                let child = turned - X_bar;
                x.bodies[i].turn += torque + ws.R_WB[i].tr_mul(&(angular(&child) - ws.p_WB[i].cross(&linear(&child))));
            }
        }
        if parameters {
            x.gravity -= linear(&x.A_bar[0]);
        }
        if x.seeded {
            x.pose.fill(SpatialVector::zeros());
            x.velocity.fill(SpatialVector::zeros());
            for c in &mut x.channels {
                c.seed.fill(SpatialVector::zeros());
            }
            x.seeded = false;
        }
    }

    /// Gradients by the parameters of links and joints, from all sweeps since [`Adjoint::clear`].
    ///
    /// # Errors
    /// `adjoint` or `gradient` of another multibody.
    pub fn rigid_gradient(&self, adjoint: &Adjoint, gradient: &mut RigidGradient) -> Result<(), DynamicsError> {
        if adjoint.bodies.len() != self.bodies.len() || adjoint.armature.len() != self.nv {
            return Err(DynamicsError::ForeignWorkspace);
        }
        length("a gradient by inertias", gradient.inertia.len(), self.frames.len())?;
        length("a gradient by origins", gradient.origin.len(), self.mounts.len())?;
        length("a gradient by axes", gradient.axis.len(), self.mounts.len())?;
        length("a gradient by armatures", gradient.armature.len(), self.nv)?;
        gradient.armature.copy_from_slice(&adjoint.armature);
        gradient.gravity = adjoint.gravity;
        for (frame, to) in self.frames.iter().zip(&mut gradient.inertia) {
            let R = matrix(&frame.X_BL.rotation);
            *to = pull_inertial(&adjoint.bodies[frame.body].inertia, &R, &frame.X_BL.translation.vector);
        }
        // By the pose on its body of each link with all that is fixed to it or moves on it, in the body's frame. A joint stands
        // before those of its child, so the way back meets a link after everything behind it; `origin` holds the sums by the
        // joint that carries the link, for each link has one.
        for (m, mount) in self.mounts.iter().enumerate() {
            let frame = &self.frames[mount.child];
            let R = matrix(&frame.X_BL.rotation);
            let p = frame.X_BL.translation.vector;
            let seed = &adjoint.link_pose[mount.child];
            let force = R * linear(seed);
            let seed = join(&(R * angular(seed) + p.cross(&force)), &force);
            gradient.origin[m] = seed + displaced(&adjoint.bodies[frame.body].inertia, &frame.inertia.moved(&R, &p));
        }
        for (m, mount) in self.mounts.iter().enumerate().rev() {
            let on_parent = if mount.kind == JointKind::Fixed {
                let behind = gradient.origin[m];
                let X = &self.frames[mount.child].X_BL;
                let R = matrix(&X.rotation);
                let torque = angular(&behind) - X.translation.vector.cross(&linear(&behind));
                gradient.origin[m] = join(&R.tr_mul(&torque), &R.tr_mul(&linear(&behind)));
                gradient.axis[m] = Vector3::zeros();
                behind
            } else {
                let (body, own) = (&self.bodies[mount.body], &adjoint.bodies[mount.body]);
                gradient.axis[m] = by_axis(mount.kind, &body.motion.axis, &own.turn);
                gradient.origin[m] = if mount.parent.is_some() { own.origin } else { SpatialVector::zeros() };
                let force = body.R_PJ * linear(&own.origin);
                join(&(body.R_PJ * angular(&own.origin) + body.p_PJ.cross(&force)), &force)
            };
            // Each link stands at the place of the joint that carries it.
            if let Some(parent) = mount.parent {
                gradient.origin[parent] += on_parent;
            }
        }
        Ok(())
    }
}

/// Gradient by the axis, across it, from that by a turn of the joint's frame that takes the axis along.
pub(crate) fn by_axis(kind: JointKind, n: &Vector3<f64>, turn: &Vector3<f64>) -> Vector3<f64> {
    match kind {
        JointKind::Fixed | JointKind::Floating => Vector3::zeros(),
        JointKind::Revolute | JointKind::Continuous | JointKind::Prismatic => turn.cross(n),
        JointKind::Planar => {
            // The slides' directions turn about the normal when it moves: `e1` is a fixed direction `x` projected.
            let [_, e2] = plane_axes(&nalgebra::Unit::new_unchecked(*n));
            let x = if n.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
            let along = n.dot(&x);
            turn.cross(n) - e2 * (turn.dot(n) * along / (x - n * along).norm())
        }
    }
}

/// A motion at the world's origin, written in the frame at `R`, `p`.
#[inline]
pub(crate) fn to_body(V: &SpatialVector, R: &Matrix3<f64>, p: &Vector3<f64>) -> SpatialVector {
    let omega = angular(V);
    join(&R.tr_mul(&omega), &R.tr_mul(&(linear(V) + omega.cross(p))))
}

/// Adds the gradient of `X . I Y` by the ten entries of `I`, all in one frame.
#[inline]
pub(crate) fn add_inertial(g: &mut [f64; 10], X: &SpatialVector, Y: &SpatialVector) {
    let ((w, u), (x, y)) = ((angular(X), linear(X)), (angular(Y), linear(Y)));
    let h = y.cross(&w) + u.cross(&x);
    g[0] += u.dot(&y);
    g[1] += h.x;
    g[2] += h.y;
    g[3] += h.z;
    g[4] += w.x * x.x;
    g[5] += w.x * x.y + w.y * x.x;
    g[6] += w.x * x.z + w.z * x.x;
    g[7] += w.y * x.y;
    g[8] += w.y * x.z + w.z * x.y;
    g[9] += w.z * x.z;
}

/// The symmetric matrix whose product with `I` is the gradient's share of the rotational inertia.
fn symmetric(g: &[f64; 10]) -> Matrix3<f64> {
    let (xy, xz, yz) = (0.5 * g[5], 0.5 * g[6], 0.5 * g[8]);
    Matrix3::new(g[4], xy, xz, xy, g[7], yz, xz, yz, g[9])
}

/// Gradient by the entries of an inertia at the pose `R`, `p`, from that by the entries of the sum: the transpose of
/// [`crate::SpatialInertia::moved`].
pub(crate) fn pull_inertial(g: &[f64; 10], R: &Matrix3<f64>, p: &Vector3<f64>) -> [f64; 10] {
    let (G, by_h) = (symmetric(g), Vector3::new(g[1], g[2], g[3]));
    let (trace, Gp) = (G.trace(), G * p);
    let mass = g[0] + by_h.dot(p) + p.dot(p) * trace - p.dot(&Gp);
    let h = R.tr_mul(&(by_h + p * (2.0 * trace) - Gp * 2.0));
    let I = R.tr_mul(&G) * R;
    [mass, h.x, h.y, h.z, I[(0, 0)], 2.0 * I[(0, 1)], 2.0 * I[(0, 2)], I[(1, 1)], 2.0 * I[(1, 2)], I[(2, 2)]]
}

/// Gradient by a twist that displaces the inertia `I`, both in one frame.
fn displaced(g: &[f64; 10], I: &crate::SpatialInertia) -> SpatialVector {
    let (G, by_h) = (symmetric(g), Vector3::new(g[1], g[2], g[3]));
    let force = by_h * I.mass + I.h * (2.0 * G.trace()) - G * I.h * 2.0;
    let K = I.I * G;
    let about = Vector3::new(K[(1, 2)] - K[(2, 1)], K[(2, 0)] - K[(0, 2)], K[(0, 1)] - K[(1, 0)]);
    join(&(I.h.cross(&by_h) + about * 2.0), &force)
}
