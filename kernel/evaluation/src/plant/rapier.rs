//! Rapier's multibody with small fixed steps. Damping, dry friction and armature are the engine's own; everything else is a force
//! given anew in every step, as equal and opposite forces on what the joint joins. Inner states follow the step's motion.

use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use rapier3d_f64::dynamics::{GenericJointBuilder, JointAxesMask, MassProperties, MultibodyJointHandle, RigidBodyBuilder, RigidBodyHandle};
use rapier3d_f64::math::{Matrix, Pose, Vector};
use rapier3d_f64::pipeline::PhysicsWorld;
use sagci_model::JointKind;

use super::{Mechanism, Plant, Rigid};
use crate::EvaluationError;
use crate::effect::{At, Hold};

/// Steps of the inner states within one of the engine's.
const INNER: usize = 4;

/// See the module's page.
pub(crate) struct Rapier {
    mechanism: Mechanism,
    /// For the load that some effects ask for.
    rigid: Option<Rigid>,
    physics: PhysicsWorld,
    joints: Vec<Hinge>,
    q: Vec<f64>,
    v: Vec<f64>,
    z: Vec<Vec<f64>>,
    t: f64,
    longest: f64,
}

struct Hinge {
    handle: MultibodyJointHandle,
    parent: RigidBodyHandle,
    child: RigidBodyHandle,
    axis: Vector3<f64>,
    slides: bool,
}

fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn matrix(m: &Matrix3<f64>) -> Matrix {
    let column = |i: usize| Vector::new(m[(0, i)], m[(1, i)], m[(2, i)]);
    Matrix::from_cols(column(0), column(1), column(2))
}

impl Rapier {
    /// # Errors
    /// A mechanism that is no tree of hinges and slides, or whose links have no mass.
    pub(crate) fn new(mechanism: Mechanism, longest: f64) -> Result<Self, EvaluationError> {
        let n = mechanism.joints.len();
        let rigid = Rigid::new(&mechanism.model)?;
        let needs_load = mechanism.joints.iter().any(super::JointPhysics::needs_load);
        let z = mechanism.joints.iter().map(|j| vec![0.0; j.states()]).collect();
        let mut plant = Self {
            rigid: needs_load.then_some(rigid),
            physics: PhysicsWorld::new(),
            joints: Vec::new(),
            q: vec![0.0; n],
            v: vec![0.0; n],
            z,
            t: 0.0,
            longest,
            mechanism,
        };
        plant.build(&vec![0.0; n], &vec![0.0; n])?;
        Ok(plant)
    }

    /// The whole physics anew: the engine keeps what its solver learned from step to step, and a start must not know of it.
    fn build(&mut self, q: &[f64], v: &[f64]) -> Result<(), EvaluationError> {
        let lost = |what: &str| EvaluationError::Model { message: format!("rapier cannot hold it: {what}") };
        let model = &self.mechanism.model;
        let mut physics = PhysicsWorld::new();
        physics.gravity = Vector::new(0.0, 0.0, -9.81);
        let p = &mut physics.integration_parameters;
        p.num_solver_iterations = 4;
        p.num_internal_pgs_iterations = 4;
        p.num_internal_stabilization_iterations = 4;

        // Weld what is fixed.
        let mut link_body = vec![(0, Isometry3::<f64>::identity()); model.links.len()];
        let mut root_link = vec![0];
        for joint in &model.joints {
            let (parent, X_BP) = link_body[joint.parent];
            link_body[joint.child] = if joint.kind == JointKind::Fixed || joint.mimic.is_some() {
                (parent, X_BP * joint.X_PJ)
            } else {
                root_link.push(joint.child);
                (root_link.len() - 1, Isometry3::identity())
            };
        }
        let X_OL = model.X_OL(q);
        let mut bodies = Vec::new();
        for (body, &link) in root_link.iter().enumerate() {
            let mut builder = if body == 0 { RigidBodyBuilder::fixed() } else { RigidBodyBuilder::dynamic() };
            builder = builder.pose(Pose::from(X_OL[link])).can_sleep(false);
            if body > 0 {
                let (mut mass, mut first, mut about) = (0.0, Vector3::zeros(), Matrix3::zeros());
                for (l, part) in model.links.iter().enumerate().filter(|(l, _)| link_body[*l].0 == body) {
                    let X_BL = link_body[l].1;
                    let R = X_BL.rotation.to_rotation_matrix();
                    let c = (X_BL * part.inertial.p_LoLcm).coords;
                    let m = part.inertial.mass;
                    mass += m;
                    first += m * c;
                    about += R * part.inertial.I_LLcm_L * R.transpose() + m * (c.norm_squared() * Matrix3::identity() - c * c.transpose());
                }
                if mass <= 0.0 {
                    return Err(lost("a link that moves has no mass"));
                }
                let c = first / mass;
                let central = about - mass * (c.norm_squared() * Matrix3::identity() - c * c.transpose());
                builder = builder.additional_mass_properties(MassProperties::with_inertia_matrix(vector(&c), mass, matrix(&central)));
            }
            bodies.push(physics.insert_body(builder));
        }
        for handle in &bodies {
            if let Some(body) = physics.bodies.get_mut(*handle) {
                body.recompute_mass_properties_from_colliders(&physics.colliders);
            }
        }
        let mut joints = Vec::new();
        for joint in model.joints.iter().filter(|j| j.kind != JointKind::Fixed && j.mimic.is_none()) {
            let slides = joint.kind == JointKind::Prismatic;
            let along = UnitQuaternion::rotation_between(&Vector3::x(), &joint.axis)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
            let X_JA = Isometry3::from_parts(nalgebra::Translation3::identity(), along);
            let (parent, X_BP) = link_body[joint.parent];
            let locked = if slides { JointAxesMask::LOCKED_PRISMATIC_AXES } else { JointAxesMask::LOCKED_REVOLUTE_AXES };
            let builder = GenericJointBuilder::new(locked)
                .local_frame1(Pose::from(X_BP * joint.X_PJ * X_JA))
                .local_frame2(Pose::from(X_JA))
                .contacts_enabled(false);
            let (parent, child) = (bodies[parent], bodies[link_body[joint.child].0]);
            let handle = physics.multibody_joints.insert(parent, child, builder.build(), true).ok_or_else(|| lost("no tree"))?;
            joints.push(Hinge { handle, parent, child, axis: joint.axis.into_inner(), slides });
        }
        let PhysicsWorld { multibody_joints, bodies, .. } = &mut physics;
        if let Some(first) = joints.first() {
            let ids: Vec<usize> = joints.iter().filter_map(|j| multibody_joints.get(j.handle)).map(|(_, id)| id).collect();
            let (multibody, _) = multibody_joints.get_mut(first.handle).ok_or_else(|| lost("a joint is gone"))?;
            multibody.set_self_contacts_enabled(false);
            multibody.forward_kinematics(bodies, true);
            let mut displacement = vec![0.0; multibody.ndofs()];
            for (i, id) in ids.iter().enumerate() {
                let dof = multibody.link(*id).ok_or_else(|| lost("a link is gone"))?.assembly_id();
                displacement[dof] = q[i];
                multibody.armature_mut()[dof] = self.mechanism.joints[i].armature;
                multibody.damping_mut()[dof] = 0.0;
                multibody.generalized_velocity_mut()[dof] = v[i];
            }
            multibody.apply_displacements(&displacement);
            multibody.forward_kinematics(bodies, false);
            multibody.update_rigid_bodies(bodies, true);
        }
        self.physics = physics;
        self.joints = joints;
        Ok(())
    }

    fn read(&self, hinge: &Hinge) -> Option<(f64, f64)> {
        let (multibody, id) = self.physics.multibody_joints.get(hinge.handle)?;
        let link = multibody.link(id)?;
        let v = multibody.joint_velocity(link).iter().next().copied()?;
        Some((link.joint().coords()[if hinge.slides { 0 } else { 3 }], v))
    }

    fn push(&mut self, joint: usize, effort: f64) {
        let hinge = &self.joints[joint];
        let Some(child) = self.physics.bodies.get_mut(hinge.child) else { return };
        let X_WC = Isometry3::from(*child.position());
        let along = vector(&(X_WC * hinge.axis * effort));
        let at = vector(&X_WC.translation.vector);
        if hinge.slides {
            child.add_force_at_point(along, at, true);
        } else {
            child.add_torque(along, true);
        }
        let Some(parent) = self.physics.bodies.get_mut(hinge.parent) else { return };
        if hinge.slides {
            parent.add_force_at_point(-along, at, true);
        } else {
            parent.add_torque(-along, true);
        }
    }

    fn step(&mut self, h: f64, hold: &[Hold]) -> Result<(), EvaluationError> {
        for hinge in &self.joints {
            for handle in [hinge.parent, hinge.child] {
                if let Some(body) = self.physics.bodies.get_mut(handle) {
                    body.reset_forces(false);
                    body.reset_torques(false);
                }
            }
        }
        let bias = self.rigid.as_ref().map(|r| r.at(&self.q, &self.v).1);
        let load = |i: usize| bias.as_ref().map_or(0.0, |b| -b[i]);
        let mut ahead: Vec<Vec<f64>> = vec![Vec::new(); self.joints.len()];
        for i in 0..self.joints.len() {
            let at = At { q: self.q[i], v: self.v[i], effort: 0.0, load: load(i), t: self.t };
            let acting = self.mechanism.joints[i].acting(at, hold[i], &self.z[i]);
            let effort = match self.mechanism.joints[i].states() {
                0 => acting.effort,
                // What inner states do within the step: its mean along the present motion.
                _ => {
                    let (effort, z) = self.foresee(i, at, hold[i], h);
                    ahead[i] = z;
                    effort
                }
            };
            self.push(i, effort);
            if let Some((multibody, id)) = self.physics.multibody_joints.get_mut(self.joints[i].handle)
                && let Some(dof) = multibody.link(id).map(|l| l.assembly_id())
            {
                // Which of two unequal bounds holds is the motion's direction, at rest that of the push.
                let forwards = if self.v[i].abs() > 1e-9 { self.v[i] > 0.0 } else { effort + load(i) > 0.0 };
                multibody.damping_mut()[dof] = acting.damping;
                multibody.frictions_mut()[dof] = acting.dry[usize::from(!forwards)];
            }
        }
        self.physics.integration_parameters.dt = h;
        self.physics.step();
        for i in 0..self.joints.len() {
            let (q, v) = self.read(&self.joints[i]).ok_or(EvaluationError::Diverged { time: self.t })?;
            let before = (self.q[i], self.v[i]);
            (self.q[i], self.v[i]) = (q, v);
            if self.z[i].is_empty() {
                continue;
            }
            let fine = h / INNER as f64;
            let mut z = std::mem::take(&mut self.z[i]);
            for k in 0..INNER {
                // Along the motion that the engine found: at its new velocity, as the engine moves.
                let s = k as f64 * fine;
                let along = |s: f64| At { q: before.0 + v * s, v, effort: 0.0, load: load(i), t: self.t + s };
                self.inner(i, &mut z, &along, hold[i], s, fine);
            }
            // A rotor has lost what the link was given: both along the same motion.
            let rotor = self.mechanism.joints[i].rotor();
            z[rotor.clone()].copy_from_slice(&ahead[i][rotor]);
            self.mechanism.joints[i].settle(q, &mut z);
            self.z[i] = z;
        }
        self.t += h;
        let sane = |x: &f64| x.is_finite() && x.abs() < 1e6;
        if self.q.iter().chain(&self.v).chain(self.z.iter().flatten()).all(sane) {
            Ok(())
        } else {
            Err(EvaluationError::Diverged { time: self.t })
        }
    }

    /// One Runge-Kutta step of inner states along a motion.
    fn inner(&self, i: usize, z: &mut [f64], along: &dyn Fn(f64) -> At, hold: Hold, s: f64, h: f64) {
        let joint = &self.mechanism.joints[i];
        let rate = |s: f64, z: &[f64]| {
            let mut dz = vec![0.0; z.len()];
            joint.rates(along(s), hold, z, &mut dz);
            dz
        };
        let add = |dz: &[f64], by: f64| -> Vec<f64> { z.iter().zip(dz).map(|(z, d)| z + by * d).collect() };
        let k1 = rate(s, z);
        let k2 = rate(s + h / 2.0, &add(&k1, h / 2.0));
        let k3 = rate(s + h / 2.0, &add(&k2, h / 2.0));
        let k4 = rate(s + h, &add(&k3, h));
        for (i, z) in z.iter_mut().enumerate() {
            *z += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
    }

    /// Mean effort over the coming step, if the joint kept its velocity, and the inner states at its end.
    fn foresee(&self, i: usize, at: At, hold: Hold, h: f64) -> (f64, Vec<f64>) {
        let joint = &self.mechanism.joints[i];
        let fine = h / INNER as f64;
        let along = |s: f64| At { q: at.q + at.v * s, t: at.t + s, ..at };
        let mut z = self.z[i].clone();
        let mut sum = 0.5 * joint.acting(at, hold, &z).effort;
        for k in 0..INNER {
            let s = k as f64 * fine;
            self.inner(i, &mut z, &along, hold, s, fine);
            sum += joint.acting(along(s + fine), hold, &z).effort * if k + 1 == INNER { 0.5 } else { 1.0 };
        }
        (sum / INNER as f64, z)
    }
}

impl Plant for Rapier {
    fn reset(&mut self, t: f64, q: &[f64], v: &[f64]) {
        self.t = t;
        self.q.copy_from_slice(q);
        self.v.copy_from_slice(v);
        for (i, joint) in self.mechanism.joints.iter().enumerate() {
            joint.start(q[i], v[i], &mut self.z[i]);
        }
        // It was built once, so it can be built again.
        if self.build(q, v).is_err() {
            self.q.fill(f64::NAN);
        }
    }

    fn advance(&mut self, until: f64, hold: &[Hold]) -> Result<(), EvaluationError> {
        let span = until - self.t;
        if span <= 0.0 {
            return Ok(());
        }
        let steps = (span / self.longest).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(span / steps, hold)?;
        }
        self.t = until;
        Ok(())
    }

    fn q(&self) -> &[f64] {
        &self.q
    }

    fn v(&self) -> &[f64] {
        &self.v
    }

    fn reading(&self, joint: usize) -> (f64, f64) {
        self.mechanism.joints[joint].reading(self.q[joint], self.v[joint], &self.z[joint], self.t)
    }

    fn delivered(&self, joint: usize, hold: Hold) -> f64 {
        let at = At { q: self.q[joint], v: self.v[joint], effort: 0.0, load: 0.0, t: self.t };
        self.mechanism.joints[joint].acting(at, hold, &self.z[joint]).delivered
    }

    fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }
}
