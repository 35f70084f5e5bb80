//! Object models as rapier bodies: one multibody for each tree of joints, one rigid body for each link that moves on its
//! own. Links joined by fixed joints are welded into one body.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::dynamics::{
    CoefficientCombineRule, GenericJointBuilder, JointAxesMask, JointAxis, MassProperties, MultibodyDofCoupling, MultibodyJointHandle,
    RigidBodyBuilder, RigidBodyHandle,
};
use rapier3d_f64::geometry::{ColliderBuilder, ColliderHandle, Group, InteractionGroups, InteractionTestMode};
use rapier3d_f64::pipeline::PhysicsWorld;
use sagci_model::{EffectEntry, JointKind, ObjectModel};

use super::effects::JointEffects;
use crate::WorldError;
use crate::convert;
use crate::geometry::Solid;
use crate::perturbation::Drawn;

/// Who may touch whom. Parts of one object never touch one another; that is set on its multibody.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// The slab that everything stands on.
    Table,
    /// The robot.
    Robot,
    /// Fixed to the table. It does not touch the table: the true hinge of a door is tilted, and a door that scrapes over
    /// the table would be an artefact of that.
    Fixed,
    /// Carried about.
    Movable,
}

impl Role {
    fn groups(self) -> InteractionGroups {
        let (own, others) = match self {
            Self::Table => (Group::GROUP_1, Group::GROUP_2 | Group::GROUP_4),
            Self::Robot => (Group::GROUP_2, Group::ALL),
            Self::Fixed => (Group::GROUP_3, Group::ALL & !Group::GROUP_1),
            Self::Movable => (Group::GROUP_4, Group::ALL),
        };
        InteractionGroups::new(own, others, InteractionTestMode::And)
    }
}

/// Friction of a hard surface on another, as a part of its friction on a finger pad's rubber. Rubber on glazed ceramics
/// or lacquered metal: 0.8 to 1; those on one another or on wood: 0.3 to 0.5 (engineering handbooks' usual ranges).
const HARD_TO_RUBBER: f64 = 0.5;

/// Friction of the table and of the robot's covers.
const HARD_FRICTION: f64 = 0.4;

/// A movable thing whose fastest point is slower than this for [`ASLEEP_AFTER`] is left out of the physics until something
/// touches it, m/s. Rapier's own threshold, a hundred times as high, freezes a mug while it is still tilting.
const ASLEEP: f64 = 5e-4;
/// See [`ASLEEP`], s.
const ASLEEP_AFTER: f64 = 0.3;

/// What a contact shape belongs to, kept in the collider's user data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Owner {
    /// Index in [`super::Bodies`]: the robot is 0, the objects follow; `u32::MAX` is the table.
    pub thing: u32,
    /// Index of the link in its model.
    pub link: u32,
}

impl Owner {
    pub(super) const TABLE: Self = Self { thing: u32::MAX, link: 0 };

    pub(super) fn pack(self) -> u128 {
        (u128::from(self.thing) << 32) | u128::from(self.link)
    }

    pub(super) fn unpack(data: u128) -> Self {
        Self { thing: (data >> 32) as u32, link: data as u32 }
    }
}

/// One model in the physics.
pub(super) struct Thing {
    /// Its name in the scene.
    pub name: String,
    /// Bodies, the root first.
    pub bodies: Vec<RigidBodyHandle>,
    /// For each link: its body, and its pose in that.
    pub link_body: Vec<(usize, Isometry3<f64>)>,
    /// For each joint of the model that moves: how rapier knows it; `None` for fixed ones.
    pub joints: Vec<Option<MovingJoint>>,
}

/// A joint of one degree of freedom.
pub(super) struct MovingJoint {
    pub handle: MultibodyJointHandle,
    pub parent: RigidBodyHandle,
    pub child: RigidBodyHandle,
    /// True axis in the child body's frame, which is the child link's.
    pub axis: Vector3<f64>,
    /// A point of the true axis, in the child body's frame.
    pub origin: Point3<f64>,
    pub slides: bool,
    pub effects: JointEffects,
}

/// What goes into one body.
#[derive(Clone)]
struct Mass {
    mass: f64,
    first_moment: Vector3<f64>,
    /// About the body's origin.
    inertia: Matrix3<f64>,
}

impl Mass {
    const NONE: Self =
        Self { mass: 0.0, first_moment: Vector3::new(0.0, 0.0, 0.0), inertia: Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.) };

    fn add(&mut self, mass: f64, center: Vector3<f64>, about_center: Matrix3<f64>) {
        self.mass += mass;
        self.first_moment += mass * center;
        self.inertia += about_center + mass * (center.norm_squared() * Matrix3::identity() - center * center.transpose());
    }

    /// Mass, centre and the inertia about it; `None` where that is not a solid's.
    fn properties(&self) -> Option<MassProperties> {
        if !(self.mass > 0.0 && self.mass.is_finite()) {
            return None;
        }
        let c = self.first_moment / self.mass;
        let about_center = self.inertia - self.mass * (c.norm_squared() * Matrix3::identity() - c * c.transpose());
        let eigenvalues = about_center.symmetric_eigenvalues();
        if !eigenvalues.iter().all(|e| e.is_finite() && *e > 0.0) {
            return None;
        }
        Some(MassProperties::with_inertia_matrix(convert::vector(&c), self.mass, convert::matrix(&about_center)))
    }
}

/// What [`add`] needs to know.
pub(super) struct Plan<'a> {
    pub name: &'a str,
    pub model: &'a ObjectModel,
    pub solids: &'a [Solid],
    pub drawn: &'a Drawn,
    /// An effect that the model lacks.
    pub hidden: Option<&'a EffectEntry>,
    pub role: Role,
    pub index: u32,
    pub X_WO: Isometry3<f64>,
    /// Positions of the moving joints, in the model's order.
    pub q: &'a [f64],
    /// Links covered with rubber: the fingers.
    pub rubber: &'a [usize],
    /// Link that carries the drawn payload.
    pub payload_link: usize,
    /// Pairs of joints that are mirrored by their mechanism though the URDF does not say so.
    pub mirrored: &'a [(usize, usize)],
    /// Armature of a joint beyond what the effects say, kg or kg m^2.
    pub armature: &'a dyn Fn(usize) -> f64,
}

/// Puts a model into the physics.
pub(super) fn add(world: &mut PhysicsWorld, plan: &Plan) -> Result<Thing, WorldError> {
    let Plan { model, drawn, .. } = *plan;
    let wrong = |place: &str, message: String| WorldError::Scene { place: format!("{}/{place}", plan.name), message };

    // Weld what is fixed.
    let mut link_body = vec![(0, Isometry3::identity()); model.links.len()];
    let mut root_link = vec![0];
    for joint in &model.joints {
        let (parent_body, X_BP) = link_body[joint.parent];
        link_body[joint.child] = match joint.kind {
            JointKind::Fixed => (parent_body, X_BP * joint.X_PJ),
            JointKind::Revolute | JointKind::Continuous | JointKind::Prismatic => {
                root_link.push(joint.child);
                (root_link.len() - 1, Isometry3::identity())
            }
            JointKind::Floating | JointKind::Planar => {
                return Err(wrong(
                    &joint.name,
                    "floating and planar joints are not simulated; make the parts separate movable objects".into(),
                ));
            }
        };
    }

    let mut mass = vec![Mass::NONE; root_link.len()];
    for (i, link) in model.links.iter().enumerate() {
        let (body, X_BL) = link_body[i];
        let R = X_BL.rotation.to_rotation_matrix();
        if link.inertial.mass > 0.0 {
            let center = X_BL * (link.inertial.p_LoLcm + drawn.center_of_mass[i]);
            let inertia = R * link.inertial.I_LLcm_L * R.transpose() * drawn.mass;
            mass[body].add(link.inertial.mass * drawn.mass, center.coords, inertia);
        }
        if i == plan.payload_link && drawn.payload > 0.0 {
            // A lump of 3 cm: what it is made of hardly matters, its weight does.
            let inertia = Matrix3::identity() * (0.4 * drawn.payload * 0.03 * 0.03);
            mass[body].add(drawn.payload, X_BL.translation.vector, inertia);
        }
    }

    let X_OL = poses(model, plan.q);
    let mut bodies = Vec::with_capacity(root_link.len());
    for (body, &link) in root_link.iter().enumerate() {
        let free = body > 0 || plan.role == Role::Movable;
        let mut builder = if free { RigidBodyBuilder::dynamic() } else { RigidBodyBuilder::fixed() };
        builder = builder.pose(convert::pose(&(plan.X_WO * X_OL[link]))).can_sleep(plan.role == Role::Movable);
        if free {
            let properties = mass[body].properties().ok_or_else(|| {
                wrong(
                    &model.links[link].name,
                    "moves but has no mass, or an inertia that no solid has; give it a positive <inertial> in the URDF".into(),
                )
            })?;
            builder = builder.additional_mass_properties(properties);
        }
        let handle = world.insert_body(builder);
        if let Some(body) = world.bodies.get_mut(handle) {
            body.activation_mut().normalized_linear_threshold = ASLEEP;
            body.activation_mut().time_until_sleep = ASLEEP_AFTER;
        }
        bodies.push(handle);
    }

    for solid in plan.solids {
        let (body, X_BL) = link_body[solid.link];
        let (friction, rule) = if plan.rubber.contains(&solid.link) {
            // Times the object's hard friction, this is its friction on rubber.
            (1.0 / HARD_TO_RUBBER, CoefficientCombineRule::Multiply)
        } else if plan.role == Role::Robot {
            (HARD_FRICTION, CoefficientCombineRule::Min)
        } else {
            (model.document.surface_friction * drawn.surface_friction * HARD_TO_RUBBER, CoefficientCombineRule::Min)
        };
        let collider = ColliderBuilder::new(solid.shape.clone())
            .position(convert::pose(&(X_BL * solid.X_LG)))
            .density(0.0)
            .friction(friction)
            .friction_combine_rule(rule)
            .collision_groups(plan.role.groups())
            .user_data(Owner { thing: plan.index, link: solid.link as u32 }.pack());
        world.insert_collider(collider, Some(bodies[body]));
    }

    // Else the bodies have no mass until the first step.
    for handle in &bodies {
        if let Some(body) = world.bodies.get_mut(*handle) {
            body.recompute_mass_properties_from_colliders(&world.colliders);
        }
    }

    let mut joints = Vec::with_capacity(model.joints.len());
    for (i, joint) in model.joints.iter().enumerate() {
        if joint.kind == JointKind::Fixed {
            joints.push(None);
            continue;
        }
        let slides = joint.kind == JointKind::Prismatic;
        // The true axis: rapier's frames have x along it. The same frame on both sides leaves position zero as modelled.
        let along = UnitQuaternion::rotation_between(&Vector3::x(), &joint.axis)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
        let X_JA = Isometry3::from_parts(Translation3::from(drawn.joints[i].axis_shift), drawn.joints[i].axis_tilt * along);
        let (parent_body, X_BP) = link_body[joint.parent];
        let (free_axis, locked) = if slides {
            (JointAxis::LinX, JointAxesMask::LOCKED_PRISMATIC_AXES)
        } else {
            (JointAxis::AngX, JointAxesMask::LOCKED_REVOLUTE_AXES)
        };
        let mut builder = GenericJointBuilder::new(locked)
            .local_frame1(convert::pose(&(X_BP * joint.X_PJ * X_JA)))
            .local_frame2(convert::pose(&X_JA))
            .contacts_enabled(false);
        if joint.limits.lower.is_finite() || joint.limits.upper.is_finite() {
            builder = builder.limits(free_axis, [joint.limits.lower.max(-1e9), joint.limits.upper.min(1e9)]);
        }
        let (parent, child) = (bodies[parent_body], bodies[link_body[joint.child].0]);
        let handle = world
            .multibody_joints
            .insert(parent, child, builder.build(), true)
            .ok_or_else(|| wrong(&joint.name, "could not be built: the joints do not form a tree".into()))?;
        let mut effects = JointEffects::new(model, i, &drawn.joints[i]).map_err(|message| wrong(&joint.name, message))?;
        if let Some(hidden) = plan.hidden.filter(|e| e.joint.as_ref() == Some(&joint.name)) {
            effects.hide(hidden).map_err(|message| wrong(&joint.name, message))?;
        }
        joints.push(Some(MovingJoint {
            handle,
            parent,
            child,
            axis: X_JA.rotation * Vector3::x(),
            origin: Point3::from(X_JA.translation.vector),
            slides,
            effects,
        }));
    }
    let thing = Thing { name: plan.name.to_owned(), bodies, link_body, joints };
    arrange(world, plan, &thing).ok_or_else(|| wrong(&model.name, "could not be built: a joint was lost".into()))?;
    Ok(thing)
}

/// Joint positions, parameters and couplings, once the multibody is complete.
fn arrange(world: &mut PhysicsWorld, plan: &Plan, thing: &Thing) -> Option<()> {
    let model = plan.model;
    let Some(first) = thing.joints.iter().flatten().next() else { return Some(()) };
    let position = joint_positions(model, plan.q);
    let ids: Vec<Option<usize>> =
        thing.joints.iter().map(|joint| joint.as_ref().and_then(|j| world.multibody_joints.get(j.handle)).map(|(_, id)| id)).collect();
    let PhysicsWorld { multibody_joints, bodies, .. } = world;
    let (multibody, _) = multibody_joints.get_mut(first.handle)?;
    multibody.set_self_contacts_enabled(false);
    multibody.forward_kinematics(bodies, true);
    let mut displacement = vec![0.0; multibody.ndofs()];
    for (i, joint) in thing.joints.iter().enumerate() {
        let (Some(joint), Some(id)) = (joint, ids[i]) else { continue };
        let dof = multibody.link(id)?.assembly_id();
        displacement[dof] = position[i];
        multibody.damping_mut()[dof] = joint.effects.damping();
        multibody.armature_mut()[dof] = joint.effects.armature() + (plan.armature)(i);
        multibody.frictions_mut()[dof] = joint.effects.friction(position[i], 0.0);
    }
    multibody.apply_displacements(&displacement);
    multibody.forward_kinematics(bodies, false);
    multibody.update_rigid_bodies(bodies, true);

    let mimics = model.joints.iter().enumerate().filter_map(|(i, j)| j.mimic.map(|m| (m.joint, i, m.multiplier, m.offset)));
    let mirrored = plan.mirrored.iter().map(|&(a, b)| (a, b, 1.0, 0.0));
    for (leader, follower, coeff, offset) in mimics.chain(mirrored) {
        let axis = |i: usize| if model.joints[i].kind == JointKind::Prismatic { JointAxis::LinX } else { JointAxis::AngX } as usize;
        multibody.add_dof_coupling(MultibodyDofCoupling {
            link1: (*ids.get(leader)?)?,
            dof1: 0,
            axis1: axis(leader),
            link2: (*ids.get(follower)?)?,
            dof2: 0,
            axis2: axis(follower),
            coeff,
            offset,
        });
    }
    Some(())
}

/// Position of every joint of the model (zero for fixed ones) from those of its moving joints.
pub(super) fn joint_positions(model: &ObjectModel, q: &[f64]) -> Vec<f64> {
    let mut position = vec![0.0; model.joints.len()];
    for (slot, joint) in model.moving_joints().enumerate() {
        position[joint] = q.get(slot).copied().unwrap_or(0.0);
    }
    for (i, joint) in model.joints.iter().enumerate() {
        if let Some(m) = joint.mimic {
            position[i] = m.multiplier * position[m.joint] + m.offset;
        }
    }
    position
}

/// Poses of all links in the root's frame.
pub(super) fn poses(model: &ObjectModel, q: &[f64]) -> Vec<Isometry3<f64>> {
    model.X_OL(q)
}

/// The table: a slab of 4 m by 4 m, 10 cm thick.
pub(super) fn add_table(world: &mut PhysicsWorld, height: f64) -> ColliderHandle {
    let body = world.insert_body(RigidBodyBuilder::fixed());
    let half = TABLE_HALF_EXTENTS;
    let collider = ColliderBuilder::cuboid(half[0], half[1], half[2])
        .translation(convert::vector(&Vector3::new(0.0, 0.0, height - half[2])))
        .friction(HARD_FRICTION)
        .friction_combine_rule(CoefficientCombineRule::Min)
        .collision_groups(Role::Table.groups())
        .user_data(Owner::TABLE.pack());
    world.insert_collider(collider, Some(body))
}

/// Half extents of the table's slab, m.
pub(crate) const TABLE_HALF_EXTENTS: [f64; 3] = [2.0, 2.0, 0.05];
