//! The parameters of a system as one typed vector: which entry is what, in which unit, between which bounds.
//!
//! # Names
//! | entry | name | value |
//! |---|---|---|
//! | mass | `part/link.mass` | `ln(m) / 2` |
//! | centre of mass | `part/link.center.x` | m, in the link's frame |
//! | inertia | `part/link.inertia.d1` ... `d3`, `s12`, `s23`, `s13` | the rest of the log-Cholesky factor, below |
//! | joint axis | `part/joint.axis.0`, `.1` | turn across the axis that it had when the vector was made, rad |
//! | joint origin | `part/joint.origin.turn.x`, `part/joint.origin.place.x` | turn (rotation vector) against the one that it had, rad; place in the parent link's frame, m |
//! | armature | `part/joint.armature`, `.armature.1` and on where it has several degrees of freedom | kg m^2 or kg |
//! | effect | `part/joint.viscous_friction.damping`; the second effect of one name on one joint `...friction#2.damping` | the effect's own |
//! | surface | `part/link.surface.friction`, `.stiffness`, `.dissipation`; the second shape of one link `...surface#2...` | as `ContactMaterial` |
//! | shape | `part/link.shape.turn.x`, `part/link.shape.place.x`, likewise | turn against the one that it had, rad; place on its link, m |
//! | residual | `residual.weight.7` | 1 |
//!
//! A pattern may hold `*` for anything: `microwave/hinge.*`, `*.axis.*`.
//!
//! # Inertia that is always physical
//! The pseudo-inertia `J = [[Sigma, h], [h^T, m]]` of a body, with `Sigma = tr(I)/2 1 - I`, is positive definite exactly where
//! some distribution of positive mass has it (Wensing, Kim and Slotine 2018). Rucker and Wensing (2022) write `J = U U^T` with
//!
//! `U = e^alpha [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3], [0, 0, 0, 1]]`,
//!
//! so every vector of the ten numbers is physical. Then `m = e^(2 alpha)` and `h / m = t`: the mass' entry is `alpha`, those of
//! the centre are `t`. Changing the mass alone keeps the shape: the inertia goes with it.
//!
//! With the gradient `G` by `J` (symmetric), `dL = 2 <G U, dU>`.
//!
//! # What has no entries
//! Links without mass, or whose inertia no body of positive volume has (a point or a thin plate: they have mass and centre, not
//! inertia); links that are fixed to the world; origins of floating bases. Choices of an effect (a side, a shape) are no
//! numbers and have none.

use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use sagci_model::JointKind;

use crate::algorithms::adjoint::by_axis;
use crate::effects::{Acts, Partial, Prior, Reshape};
use crate::error::{check, hint};
use crate::multibody::length;
use crate::spatial::join;
use crate::{DynamicsError, JointId, LinkId, Multibody, NaturalGradient, Placement, SpatialInertia, SpatialVector, System, Wanted};

/// Names one entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ParameterId {
    /// `alpha` of a link.
    LinkMass(LinkId),
    /// `t` of a link, 0 to 2.
    LinkCenter(LinkId, usize),
    /// `d1, d2, d3, s12, s23, s13` of a link, 0 to 5.
    LinkInertia(LinkId, usize),
    /// Turn of a joint's axis, 0 or 1.
    JointAxis(JointId, usize),
    /// Turn (0 to 2) and place (3 to 5) of a joint's origin.
    JointOrigin(JointId, usize),
    /// Armature of a degree of freedom.
    Armature(usize),
    /// A parameter of an effect.
    Effect {
        /// Which of [`System::placements`].
        placement: usize,
        /// Which of its parameters.
        parameter: usize,
    },
    /// Friction, stiffness or dissipation (0 to 2) of a shape's surface; shapes in the order of the system's.
    Surface(usize, usize),
    /// Turn (0 to 2) and place (3 to 5) of a shape on its link; on the world for what belongs to the scene.
    ShapePose(usize, usize),
    /// A weight of the residual.
    Residual(usize),
}

/// Groups of entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ParameterKind {
    /// Masses of links.
    LinkMass,
    /// Centres of mass of links.
    LinkCenter,
    /// Inertias of links.
    LinkInertia,
    /// Axes of joints.
    JointAxis,
    /// Origins of joints.
    JointOrigin,
    /// Armatures.
    Armature,
    /// Damping: `viscous_friction`.
    Damping,
    /// Dry friction: `coulomb_friction`.
    DryFriction,
    /// Parameters of all other effects.
    Effect,
    /// Friction of surfaces.
    ContactFriction,
    /// Stiffness of surfaces.
    ContactStiffness,
    /// Dissipation of surfaces.
    ContactDissipation,
    /// Poses of shapes.
    ShapePose,
    /// Weights of the residual.
    Residual,
}

/// Some parameters of a system, in order. It names them and holds no values: [`Self::values`] reads them,
/// [`System::set_parameters`] writes them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParameterVector {
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq)]
struct Entry {
    id: ParameterId,
    kind: ParameterKind,
    name: String,
    unit: &'static str,
    bounds: [f64; 2],
    /// Axis or turn that values of axes and origins are measured from.
    from: Reference,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Reference {
    Zero,
    Axis(Vector3<f64>),
    Turn(UnitQuaternion<f64>),
}

const XYZ: [&str; 3] = ["x", "y", "z"];
/// Half the logarithm of 1e-9 kg and of 1e9 kg.
const LOG_MASS: [f64; 2] = [-10.4, 10.4];
const LOG_SIZE: [f64; 2] = [-12.0, 7.0];
const LENGTH: [f64; 2] = [-1e3, 1e3];
const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl System {
    /// The rigid bodies as they are given, without the effects that change them.
    fn given(&self) -> &Multibody {
        self.given.as_deref().unwrap_or(&self.multibody)
    }

    /// All parameters.
    pub fn all_parameters(&self) -> ParameterVector {
        let mut entries = Vec::new();
        let multibody = self.given();
        let mut push = |id, kind, name: String, unit, bounds, from| entries.push(Entry { id, kind, name, unit, bounds, from });
        for (link, part, name) in multibody.links() {
            let inertia = multibody.link_inertia(link);
            if inertia.mass.is_nan() || inertia.mass <= 0.0 || multibody.frames[link.0].body == 0 {
                continue;
            }
            let name = |what: &str| format!("{part}/{name}.{what}");
            let log = "1, half the logarithm of kg";
            push(ParameterId::LinkMass(link), ParameterKind::LinkMass, name("mass"), log, LOG_MASS, Reference::Zero);
            for (k, x) in XYZ.iter().enumerate() {
                let id = ParameterId::LinkCenter(link, k);
                push(id, ParameterKind::LinkCenter, name(&format!("center.{x}")), "m", LENGTH, Reference::Zero);
            }
            if LogCholesky::of(inertia).shape.is_some() {
                for (k, x) in ["d1", "d2", "d3", "s12", "s23", "s13"].iter().enumerate() {
                    let (unit, bounds) = if k < 3 { ("1, the logarithm of m", LOG_SIZE) } else { ("m", LENGTH) };
                    let id = ParameterId::LinkInertia(link, k);
                    push(id, ParameterKind::LinkInertia, name(&format!("inertia.{x}")), unit, bounds, Reference::Zero);
                }
            }
        }
        for (joint, part, name, kind) in multibody.model_joints() {
            if kind != JointKind::Fixed && kind != JointKind::Floating {
                for k in 0..2 {
                    let from = Reference::Axis(multibody.joint_axis(joint).into_inner());
                    let id = ParameterId::JointAxis(joint, k);
                    push(id, ParameterKind::JointAxis, format!("{part}/{name}.axis.{k}"), "rad", ANY, from);
                }
            }
            if kind == JointKind::Floating && multibody.mounts[joint.0].parent.is_none() {
                continue;
            }
            for k in 0..6 {
                let (what, unit) = if k < 3 { ("turn", "rad") } else { ("place", "m") };
                let from = Reference::Turn(multibody.joint_origin(joint).rotation);
                let name = format!("{part}/{name}.origin.{what}.{}", XYZ[k % 3]);
                let bounds = if k < 3 { ANY } else { LENGTH };
                push(ParameterId::JointOrigin(joint, k), ParameterKind::JointOrigin, name, unit, bounds, from);
            }
        }
        for joint in multibody.joints() {
            for (k, v) in joint.v.clone().enumerate() {
                let name = format!("{}/{}.armature", joint.part, joint.name);
                let name = if joint.v.len() == 1 { name } else { format!("{name}.{k}") };
                let unit = if joint.kind == JointKind::Prismatic { "kg" } else { "kg m^2" };
                push(ParameterId::Armature(v), ParameterKind::Armature, name, unit, [0.0, f64::INFINITY], Reference::Zero);
            }
        }
        for (placement, placed) in self.placements().iter().enumerate() {
            let description = placed.effect.description();
            let same = |p: &&crate::Placement| {
                p.effect.description().name == description.name && (&p.part, &p.joint, p.v) == (&placed.part, &placed.joint, placed.v)
            };
            let count = 1 + self.placements()[..placement].iter().filter(same).count();
            let mut name = format!("{}/{}.{}", placed.part, placed.joint, description.name);
            if placed.q.is_none() {
                let first = multibody.joints().iter().find(|j| j.v.contains(&placed.v)).map_or(0, |j| j.v.start);
                name += &format!(".{}", placed.v - first);
            }
            if count > 1 {
                name += &format!("#{count}");
            }
            let slides = multibody.joints().iter().any(|j| j.v.contains(&placed.v) && j.kind == JointKind::Prismatic);
            let kind = match description.name {
                "viscous_friction" => ParameterKind::Damping,
                "coulomb_friction" => ParameterKind::DryFriction,
                _ => ParameterKind::Effect,
            };
            for (parameter, p) in description.parameters.iter().enumerate() {
                if matches!(p.prior[0], Prior::OneOf(_)) {
                    continue;
                }
                let id = ParameterId::Effect { placement, parameter };
                push(id, kind, format!("{name}.{}", p.name), p.unit[usize::from(slides)], p.bounds, Reference::Zero);
            }
        }
        for (g, geometry) in self.contacts.iter().flat_map(|c| c.geometries.iter().enumerate()) {
            let earlier = self.contacts.iter().flat_map(|c| &c.geometries[..g]).filter(|o| o.name == geometry.name).count();
            let which = if earlier > 0 { format!("#{}", earlier + 1) } else { String::new() };
            let kinds = [ParameterKind::ContactFriction, ParameterKind::ContactStiffness, ParameterKind::ContactDissipation];
            let units = [("friction", "1"), ("stiffness", "N/m"), ("dissipation", "s/m")];
            for (k, (kind, (what, unit))) in kinds.into_iter().zip(units).enumerate() {
                let least = if k == 1 { f64::MIN_POSITIVE } else { 0.0 };
                let name = format!("{}.surface{which}.{what}", geometry.name);
                push(ParameterId::Surface(g, k), kind, name, unit, [least, f64::MAX], Reference::Zero);
            }
            for k in 0..6 {
                let (what, unit) = if k < 3 { ("turn", "rad") } else { ("place", "m") };
                let name = format!("{}.shape{which}.{what}.{}", geometry.name, XYZ[k % 3]);
                let bounds = if k < 3 { ANY } else { LENGTH };
                push(ParameterId::ShapePose(g, k), ParameterKind::ShapePose, name, unit, bounds, Reference::Turn(turn_of(&geometry.R_LG)));
            }
        }
        for k in 0..self.residual().map_or(0, |r| r.network().weights().len()) {
            push(ParameterId::Residual(k), ParameterKind::Residual, format!("residual.weight.{k}"), "1", ANY, Reference::Zero);
        }
        ParameterVector { entries }
    }

    /// All parameters of one kind.
    pub fn parameters_of_kind(&self, kind: ParameterKind) -> ParameterVector {
        let mut all = self.all_parameters();
        all.entries.retain(|e| e.kind == kind);
        all
    }

    /// Parameters by their names, where `*` stands for anything; in the order of the patterns, each entry once.
    ///
    /// # Errors
    /// A pattern that no parameter answers to.
    pub fn select_parameters(&self, patterns: &[&str]) -> Result<ParameterVector, DynamicsError> {
        let all = self.all_parameters();
        let mut taken = vec![false; all.entries.len()];
        let mut entries = Vec::new();
        for pattern in patterns {
            let mut found = false;
            for (k, entry) in all.entries.iter().enumerate() {
                if answers(pattern.as_bytes(), entry.name.as_bytes()) {
                    found = true;
                    if !std::mem::replace(&mut taken[k], true) {
                        entries.push(entry.clone());
                    }
                }
            }
            if !found {
                let hint = hint(pattern, all.entries.iter().map(|e| e.name.as_str()));
                let hint = hint + " (a link without mass has no inertial parameters, one without volume no inertia)";
                return Err(DynamicsError::Unknown { kind: "parameter".into(), name: (*pattern).into(), hint });
            }
        }
        Ok(ParameterVector { entries })
    }

    /// Writes the values of some parameters. Takes effect with the next state. On an error nothing is changed.
    ///
    /// # Errors
    /// The wrong number of values, one that is not finite or out of its bounds; entries of another system.
    pub fn set_parameters(&mut self, which: &ParameterVector, values: &[f64]) -> Result<(), DynamicsError> {
        check("parameters", values, which.len())?;
        which.check_owner(self)?;
        for (entry, value) in which.entries.iter().zip(values) {
            let [least, most] = entry.bounds;
            if *value < least || *value > most {
                let must = format!("from {least} to {most} {}", entry.unit);
                return Err(DynamicsError::OutOfBounds { what: entry.name.clone(), value: *value, must });
            }
        }
        let mut weights = self.residual().map(|r| r.network().weights().to_vec());
        let mut guard = self.multibody_mut();
        let multibody: &mut Multibody = &mut guard;
        let (mut links, mut axes, mut origins, mut shapes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (entry, value) in which.entries.iter().zip(values) {
            match (entry.id, entry.from) {
                (ParameterId::LinkMass(link), _) => of_link(multibody, &mut links, link).alpha = *value,
                (ParameterId::LinkCenter(link, k), _) => of_link(multibody, &mut links, link).t[k] = *value,
                (ParameterId::LinkInertia(link, k), _) => {
                    if let Some(shape) = &mut of_link(multibody, &mut links, link).shape {
                        shape[k] = *value;
                    }
                }
                (ParameterId::JointAxis(joint, k), Reference::Axis(from)) => {
                    let at = find_or(&mut axes, joint, || (from, turn_of_axis(&from, &multibody.joint_axis(joint).into_inner())));
                    at.1[k] = *value;
                }
                (ParameterId::JointOrigin(joint, k), Reference::Turn(from)) => {
                    let at = find_or(&mut origins, joint, || {
                        let X = multibody.joint_origin(joint);
                        (from, (from.inverse() * X.rotation).scaled_axis(), X.translation.vector)
                    });
                    if k < 3 { at.1[k] = *value } else { at.2[k - 3] = *value }
                }
                _ => {}
            }
        }
        for (link, factor) in &links {
            multibody.set_link_inertia(*link, &factor.inertia());
        }
        for (joint, (from, turn)) in &axes {
            multibody.set_joint_axis(*joint, &Unit::new_normalize(turned_axis(from, turn).0));
        }
        for (joint, (from, turn, place)) in &origins {
            let rotation = *from * UnitQuaternion::from_scaled_axis(*turn);
            multibody.set_joint_origin(*joint, &Isometry3::from_parts(Translation3::from(*place), rotation));
        }
        drop(guard);
        for (entry, value) in which.entries.iter().zip(values) {
            match entry.id {
                ParameterId::Armature(v) => self.multibody_mut().armature_mut()[v] = *value,
                ParameterId::Effect { placement, parameter } => {
                    let at = self.placements()[placement].theta.start + parameter;
                    self.parameters_mut()[at] = *value;
                }
                ParameterId::Surface(g, k) => {
                    if let Some(contacts) = &mut self.contacts {
                        let material = &mut contacts.geometries[g].material;
                        *[&mut material.friction, &mut material.stiffness, &mut material.dissipation][k] = *value;
                    }
                }
                ParameterId::ShapePose(g, k) => {
                    if let (Some(contacts), Reference::Turn(from)) = (&self.contacts, entry.from) {
                        let geometry = &contacts.geometries[g];
                        let make = || (from, (from.inverse() * turn_of(&geometry.R_LG)).scaled_axis(), geometry.p_LG);
                        let at: &mut (UnitQuaternion<f64>, Vector3<f64>, Vector3<f64>) = find_or(&mut shapes, g, make);
                        if k < 3 { at.1[k] = *value } else { at.2[k - 3] = *value }
                    }
                }
                ParameterId::Residual(k) => {
                    if let Some(weights) = &mut weights {
                        weights[k] = *value;
                    }
                }
                _ => {}
            }
        }
        for (g, (from, turn, place)) in shapes {
            if let Some(contacts) = &mut self.contacts {
                let geometry = &mut contacts.geometries[g];
                geometry.R_LG = crate::joint::matrix(&(from * UnitQuaternion::from_scaled_axis(turn)));
                geometry.p_LG = place;
            }
        }
        self.place_shapes();
        self.changed();
        if let (Some(residual), Some(weights)) = (self.residual_mut(), weights) {
            residual.set_weights(&weights)?;
        }
        Ok(())
    }
}

impl ParameterVector {
    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Are there none?
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// What an entry is.
    pub fn id(&self, entry: usize) -> Option<ParameterId> {
        self.entries.get(entry).map(|e| e.id)
    }

    /// Kind of an entry.
    pub fn kind(&self, entry: usize) -> Option<ParameterKind> {
        self.entries.get(entry).map(|e| e.kind)
    }

    /// Names of all entries.
    pub fn names(&self) -> impl Iterator<Item = &str> + Clone {
        self.entries.iter().map(|e| e.name.as_str())
    }

    /// Units of all entries.
    pub fn units(&self) -> impl Iterator<Item = &'static str> {
        self.entries.iter().map(|e| e.unit)
    }

    /// Least and greatest value of all entries.
    pub fn bounds(&self) -> impl Iterator<Item = [f64; 2]> {
        self.entries.iter().map(|e| e.bounds)
    }

    /// These entries, then those of `other` that are not among them.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        for entry in other.entries {
            if !self.entries.iter().any(|e| e.id == entry.id) {
                self.entries.push(entry);
            }
        }
        self
    }

    /// What a reverse pass has to work for.
    pub fn wanted(&self) -> Wanted {
        Wanted {
            rigid: self.entries.iter().any(|e| !matches!(e.id, ParameterId::Effect { .. } | ParameterId::Residual(_))),
            weights: self.entries.iter().any(|e| matches!(e.id, ParameterId::Residual(_))),
        }
    }

    /// The present values.
    ///
    /// # Errors
    /// Entries of another system.
    pub fn values(&self, system: &System) -> Result<Vec<f64>, DynamicsError> {
        self.check_owner(system)?;
        let multibody = system.given();
        let mut last: Option<(LinkId, LogCholesky)> = None;
        let values = self.entries.iter().map(|entry| match (entry.id, entry.from) {
            (ParameterId::LinkMass(link) | ParameterId::LinkCenter(link, _) | ParameterId::LinkInertia(link, _), _) => {
                let factor = match &last {
                    Some((of, factor)) if *of == link => factor.clone(),
                    _ => LogCholesky::of(multibody.link_inertia(link)),
                };
                last = Some((link, factor.clone()));
                match entry.id {
                    ParameterId::LinkCenter(_, k) => factor.t[k],
                    ParameterId::LinkInertia(_, k) => factor.shape.map_or(0.0, |s| s[k]),
                    _ => factor.alpha,
                }
            }
            (ParameterId::JointAxis(joint, k), Reference::Axis(from)) => turn_of_axis(&from, &multibody.joint_axis(joint).into_inner())[k],
            (ParameterId::JointOrigin(joint, k), Reference::Turn(from)) => {
                let X = multibody.joint_origin(joint);
                if k < 3 { (from.inverse() * X.rotation).scaled_axis()[k] } else { X.translation.vector[k - 3] }
            }
            (ParameterId::Armature(v), _) => multibody.armature[v],
            (ParameterId::Effect { placement, parameter }, _) => {
                system.parameters()[system.placements()[placement].theta.start + parameter]
            }
            (ParameterId::Surface(g, k), _) => system.contacts.as_ref().map_or(0.0, |c| {
                let material = &c.geometries[g].material;
                [material.friction, material.stiffness, material.dissipation][k]
            }),
            (ParameterId::ShapePose(g, k), Reference::Turn(from)) => system.contacts.as_ref().map_or(0.0, |c| {
                let geometry = &c.geometries[g];
                if k < 3 { (from.inverse() * turn_of(&geometry.R_LG)).scaled_axis()[k] } else { geometry.p_LG[k - 3] }
            }),
            (ParameterId::Residual(k), _) => system.residual().map_or(0.0, |r| r.network().weights()[k]),
            (ParameterId::JointAxis(..) | ParameterId::JointOrigin(..) | ParameterId::ShapePose(..), _) => 0.0,
        });
        Ok(values.collect())
    }

    /// The gradient by these entries, at the system's present values, from the one in the coordinates of the dynamics.
    ///
    /// # Errors
    /// `into` of another length than this vector; entries or gradient of another system.
    pub fn gradient(&self, system: &System, natural: &NaturalGradient, into: &mut [f64]) -> Result<(), DynamicsError> {
        length("the gradient by parameters", into.len(), self.len())?;
        self.check_owner(system)?;
        let multibody = system.given();
        length("the gradient by inertias", natural.rigid.inertia.len(), multibody.frames.len())?;
        length("the gradient by effects", natural.theta.len(), system.parameters().len())?;
        let mut last: Option<(LinkId, [f64; 10])> = None;
        for (entry, into) in self.entries.iter().zip(into) {
            *into = match (entry.id, entry.from) {
                (ParameterId::LinkMass(link) | ParameterId::LinkCenter(link, _) | ParameterId::LinkInertia(link, _), _) => {
                    let by = match last {
                        Some((of, by)) if of == link => by,
                        _ => LogCholesky::of(multibody.link_inertia(link)).pull(&natural.rigid.inertia[link.0]),
                    };
                    last = Some((link, by));
                    match entry.id {
                        ParameterId::LinkCenter(_, k) => by[1 + k],
                        ParameterId::LinkInertia(_, k) => by[4 + k],
                        _ => by[0],
                    }
                }
                (ParameterId::JointAxis(joint, k), Reference::Axis(from)) => {
                    let turn = turn_of_axis(&from, &multibody.joint_axis(joint).into_inner());
                    turned_axis(&from, &turn).1[k].dot(&(reshape(system, joint).0.inverse() * natural.rigid.axis[joint.0]))
                }
                (ParameterId::JointOrigin(joint, k), Reference::Turn(from)) => {
                    let (twist, X) = (&natural.rigid.origin[joint.0], multibody.joint_origin(joint));
                    let force = Vector3::new(twist[3], twist[4], twist[5]);
                    if k < 3 {
                        let turn = (from.inverse() * X.rotation).scaled_axis();
                        let torque = Vector3::new(twist[0], twist[1], twist[2]) + reshape(system, joint).1.cross(&force);
                        left_jacobian(&turn, &torque)[k]
                    } else {
                        (X.rotation * force)[k - 3]
                    }
                }
                (ParameterId::Armature(v), _) => natural.rigid.armature[v],
                (ParameterId::Effect { placement, parameter }, _) => natural.theta[system.placements()[placement].theta.start + parameter],
                (ParameterId::Surface(g, k), _) => natural.material[g][k],
                (ParameterId::ShapePose(g, k), Reference::Turn(from)) => system.contacts.as_ref().map_or(0.0, |c| {
                    let (twist, R) = (&natural.shape[g], &c.geometries[g].R_LG);
                    if k < 3 {
                        let turn = (from.inverse() * turn_of(R)).scaled_axis();
                        left_jacobian(&turn, &Vector3::new(twist[0], twist[1], twist[2]))[k]
                    } else {
                        (R * Vector3::new(twist[3], twist[4], twist[5]))[k - 3]
                    }
                }),
                (ParameterId::Residual(k), _) => natural.weights[k],
                (ParameterId::JointAxis(..) | ParameterId::JointOrigin(..) | ParameterId::ShapePose(..), _) => 0.0,
            };
        }
        Ok(())
    }

    /// What each entry changes in the coordinates in which the dynamics is written, at the system's present values: the columns whose
    /// transpose is [`Self::gradient`]. Calls `out` with the entry; an entry can change several things. The order of calls depends on
    /// the system's shape alone.
    pub(crate) fn directions(&self, system: &System, mut out: impl FnMut(usize, Direction)) -> Result<(), DynamicsError> {
        self.check_owner(system)?;
        let multibody = system.given();
        let mut last: Option<(LinkId, [[f64; 10]; 10])> = None;
        for (column, entry) in self.entries.iter().enumerate() {
            match (entry.id, entry.from) {
                (ParameterId::LinkMass(link) | ParameterId::LinkCenter(link, _) | ParameterId::LinkInertia(link, _), _) => {
                    let by = match last {
                        Some((of, by)) if of == link => by,
                        _ => LogCholesky::of(multibody.link_inertia(link)).push(),
                    };
                    last = Some((link, by));
                    let k = match entry.id {
                        ParameterId::LinkCenter(_, k) => 1 + k,
                        ParameterId::LinkInertia(_, k) => 4 + k,
                        _ => 0,
                    };
                    out(column, Direction::Inertia(link.0, by[k]));
                }
                (ParameterId::JointAxis(joint, k), Reference::Axis(from)) => {
                    let turn = turn_of_axis(&from, &multibody.joint_axis(joint).into_inner());
                    let moved = reshape(system, joint).0 * turned_axis(&from, &turn).1[k];
                    out(column, Direction::Axis(joint.0, turn_of_frame(system, joint, &moved)));
                }
                (ParameterId::JointOrigin(joint, k), Reference::Turn(from)) => {
                    let X = multibody.joint_origin(joint);
                    let twist = if k < 3 {
                        let turn = (from.inverse() * X.rotation).scaled_axis();
                        // The transpose of the left Jacobian is that of the opposite turn.
                        let w = left_jacobian(&-turn, &Vector3::ith(k, 1.0));
                        join(&w, &w.cross(&reshape(system, joint).1))
                    } else {
                        join(&Vector3::zeros(), &(X.rotation.inverse() * Vector3::ith(k - 3, 1.0)))
                    };
                    out(column, Direction::Origin(joint.0, twist));
                }
                (ParameterId::Armature(v), _) => out(column, Direction::Armature(v, 1.0)),
                (ParameterId::Effect { placement, parameter }, _) => {
                    let placed = &system.placements()[placement];
                    out(column, Direction::Effect(placed.theta.start + parameter));
                    if placed.effect.description().acts == Acts::Bodies {
                        reshape_directions(system, placed, parameter, |direction| out(column, direction));
                    }
                }
                (ParameterId::Surface(g, k), _) => out(column, Direction::Surface(g, k)),
                (ParameterId::ShapePose(g, k), Reference::Turn(from)) => {
                    let R = system.contacts.as_ref().map_or_else(Matrix3::identity, |c| c.geometries[g].R_LG);
                    let twist = if k < 3 {
                        let turn = (from.inverse() * turn_of(&R)).scaled_axis();
                        join(&left_jacobian(&-turn, &Vector3::ith(k, 1.0)), &Vector3::zeros())
                    } else {
                        join(&Vector3::zeros(), &R.tr_mul(&Vector3::ith(k - 3, 1.0)))
                    };
                    out(column, Direction::Shape(g, twist));
                }
                (ParameterId::Residual(k), _) => out(column, Direction::Weight(k)),
                (ParameterId::JointAxis(..) | ParameterId::JointOrigin(..) | ParameterId::ShapePose(..), _) => {}
            }
        }
        Ok(())
    }

    /// All entries must exist in the system.
    fn check_owner(&self, system: &System) -> Result<(), DynamicsError> {
        let multibody = system.multibody();
        let there = |id: &ParameterId| match *id {
            ParameterId::LinkMass(l) | ParameterId::LinkCenter(l, _) | ParameterId::LinkInertia(l, _) => l.0 < multibody.frames.len(),
            ParameterId::JointAxis(j, _) | ParameterId::JointOrigin(j, _) => j.0 < multibody.mounts.len(),
            ParameterId::Armature(v) => v < multibody.nv(),
            ParameterId::Effect { placement, parameter } => system.placements().get(placement).is_some_and(|p| parameter < p.theta.len()),
            ParameterId::Surface(g, _) | ParameterId::ShapePose(g, _) => system.contacts.as_ref().is_some_and(|c| g < c.geometries.len()),
            ParameterId::Residual(k) => system.residual().is_some_and(|r| k < r.network().weights().len()),
        };
        match self.entries.iter().find(|e| !there(&e.id)) {
            None => Ok(()),
            Some(entry) => Err(DynamicsError::Unknown {
                kind: "parameter".into(),
                name: entry.name.clone(),
                hint: " in this system; the vector was made for another one".into(),
            }),
        }
    }
}

/// What one entry of a vector changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Direction {
    /// The ten entries of a link's inertia, in its frame.
    Inertia(usize, [f64; 10]),
    /// A joint's origin, along a twist in the joint's frame.
    Origin(usize, SpatialVector),
    /// A joint's axis: it goes with this turn of the joint's frame, and the child turns back.
    Axis(usize, Vector3<f64>),
    /// The armature of a degree of freedom.
    Armature(usize, f64),
    /// A parameter of an effect.
    Effect(usize),
    /// Friction, stiffness or dissipation of a shape's surface.
    Surface(usize, usize),
    /// A shape on its link, along a twist in its own frame.
    Shape(usize, SpatialVector),
    /// A weight of the residual.
    Weight(usize),
}

/// The turn of a joint's frame, in it, that moves its axis (as it stands, with what effects turn it by) by `moved`: the transpose of
/// [`by_axis`].
fn turn_of_frame(system: &System, joint: JointId, moved: &Vector3<f64>) -> Vector3<f64> {
    let mount = &system.multibody().mounts[joint.0];
    let axis = system.multibody().bodies[mount.body].motion.axis;
    Vector3::from_fn(|k, _| by_axis(mount.kind, &axis, &Vector3::ith(k, 1.0)).dot(moved))
}

/// What a parameter of an effect on the rigid bodies changes of them.
fn reshape_directions(system: &System, placed: &Placement, k: usize, mut out: impl FnMut(Direction)) {
    let multibody = system.multibody();
    let moves = |m: &crate::multibody::Mount| m.kind != JointKind::Fixed && multibody.bodies[m.body].v == placed.v;
    let Some(m) = multibody.mounts.iter().position(|m| moves(m) && !multibody.bodies[m.body].follows) else { return };
    let mut change = Reshape::default();
    placed.effect.reshape(system.theta_of(placed), &mut change);
    let three = |x: &[Partial; 3]| Vector3::new(x[0].d_theta[k], x[1].d_theta[k], x[2].d_theta[k]);
    out(Direction::Armature(placed.v, change.armature.d_theta[k]));
    out(Direction::Inertia(multibody.mounts[m].child, change.inertia.map(|p| p.d_theta[k])));
    let axis = multibody.bodies[multibody.mounts[m].body].motion.axis;
    let moved = left_jacobian(&change.turn(), &three(&change.turn)).cross(&axis);
    out(Direction::Axis(m, turn_of_frame(system, JointId(m), &moved)));
    out(Direction::Origin(m, join(&Vector3::zeros(), &three(&change.shift))));
}

/// What effects turn a joint's axis by, and shift its origin by, in the joint's frame.
fn reshape(system: &System, joint: JointId) -> (Rotation3<f64>, Vector3<f64>) {
    let multibody = system.multibody();
    let mount = &multibody.mounts[joint.0];
    let (mut turn, mut shift) = (Rotation3::identity(), Vector3::zeros());
    if mount.kind != JointKind::Fixed && system.given.is_some() {
        let body = &multibody.bodies[mount.body];
        for (_, change) in system.reshapes().filter(|(p, _)| body.nv == 1 && p.v == body.v && !body.follows) {
            turn = Rotation3::new(change.turn()) * turn;
            shift += change.shift();
        }
    }
    (turn, shift)
}

/// Does a name fit a pattern in which `*` stands for anything?
fn answers(pattern: &[u8], name: &[u8]) -> bool {
    // The last star, and what it has swallowed so far: going back to it alone is enough.
    let (mut p, mut n, mut star) = (0, 0, None);
    while n < name.len() {
        if pattern.get(p) == Some(&b'*') {
            star = Some((p, n));
            p += 1;
        } else if pattern.get(p) == Some(&name[n]) {
            (p, n) = (p + 1, n + 1);
        } else if let Some((at, swallowed)) = star {
            star = Some((at, swallowed + 1));
            (p, n) = (at + 1, swallowed + 1);
        } else {
            return false;
        }
    }
    pattern[p..].iter().all(|c| *c == b'*')
}

fn find_or<K: PartialEq, T>(list: &mut Vec<(K, T)>, key: K, make: impl FnOnce() -> T) -> &mut T {
    let at = list.iter().position(|(k, _)| *k == key).unwrap_or_else(|| {
        list.push((key, make()));
        list.len() - 1
    });
    &mut list[at].1
}

fn of_link<'a>(multibody: &Multibody, list: &'a mut Vec<(LinkId, LogCholesky)>, link: LinkId) -> &'a mut LogCholesky {
    find_or(list, link, || LogCholesky::of(multibody.link_inertia(link)))
}

/// An inertia by its log-Cholesky factor; see the module's first page.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LogCholesky {
    alpha: f64,
    t: Vector3<f64>,
    /// `d1, d2, d3, s12, s23, s13`, where the inertia is one of a body with volume.
    shape: Option<[f64; 6]>,
    /// `Sigma / m - t t^T`: the distribution's variance, for a body without volume.
    variance: Matrix3<f64>,
}

impl LogCholesky {
    pub fn of(inertia: &SpatialInertia) -> Self {
        let t = inertia.h / inertia.mass;
        let Sigma = Matrix3::from_diagonal_element(0.5 * inertia.I.trace()) - inertia.I;
        let variance = Sigma / inertia.mass - t * t.transpose();
        Self { alpha: 0.5 * inertia.mass.ln(), t, shape: upper_factor(&variance), variance }
    }

    /// The upper left block of `U / e^alpha`.
    fn upper(&self) -> Option<Matrix3<f64>> {
        self.shape.map(|[d1, d2, d3, s12, s23, s13]| Matrix3::new(d1.exp(), s12, s13, 0.0, d2.exp(), s23, 0.0, 0.0, d3.exp()))
    }

    pub fn inertia(&self) -> SpatialInertia {
        let mass = (2.0 * self.alpha).exp();
        let variance = self.upper().map_or(self.variance, |U| U * U.transpose());
        let Sigma = (variance + self.t * self.t.transpose()) * mass;
        SpatialInertia { mass, h: self.t * mass, I: Matrix3::from_diagonal_element(Sigma.trace()) - Sigma }
    }

    /// The gradient by `alpha, t, d1, d2, d3, s12, s23, s13` from that by the inertia's ten entries.
    pub fn pull(&self, g: &[f64; 10]) -> [f64; 10] {
        let by_I = Matrix3::new(g[4], 0.5 * g[5], 0.5 * g[6], 0.5 * g[5], g[7], 0.5 * g[8], 0.5 * g[6], 0.5 * g[8], g[9]);
        // I = tr(Sigma) 1 - Sigma
        let by_Sigma = Matrix3::from_diagonal_element(by_I.trace()) - by_I;
        let mut G = Matrix4::zeros();
        G.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_Sigma);
        for k in 0..3 {
            G[(k, 3)] = 0.5 * g[1 + k];
            G[(3, k)] = 0.5 * g[1 + k];
        }
        G[(3, 3)] = g[0];
        let inertia = self.inertia();
        let mut J = Matrix4::zeros();
        let Sigma = Matrix3::from_diagonal_element(0.5 * inertia.I.trace()) - inertia.I;
        J.fixed_view_mut::<3, 3>(0, 0).copy_from(&Sigma);
        for k in 0..3 {
            J[(k, 3)] = inertia.h[k];
            J[(3, k)] = inertia.h[k];
        }
        J[(3, 3)] = inertia.mass;
        let e = self.alpha.exp();
        let last = nalgebra::Vector4::new(self.t.x, self.t.y, self.t.z, 1.0) * e;
        let by_last = G * last * (2.0 * e);
        let mut out = [2.0 * G.dot(&J), by_last[0], by_last[1], by_last[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        if let Some(U) = self.upper() {
            let by_U = by_Sigma * U * (2.0 * e * e);
            for k in 0..3 {
                out[4 + k] = by_U[(k, k)] * U[(k, k)];
            }
            (out[7], out[8], out[9]) = (by_U[(0, 1)], by_U[(1, 2)], by_U[(0, 2)]);
        }
        out
    }
}

impl LogCholesky {
    /// The changes of the inertia's ten entries by each of the ten of the factor: the columns whose transpose is [`Self::pull`].
    fn push(&self) -> [[f64; 10]; 10] {
        let mut out = [[0.0; 10]; 10];
        for entry in 0..10 {
            let mut unit = [0.0; 10];
            unit[entry] = 1.0;
            for (column, by) in out.iter_mut().zip(self.pull(&unit)) {
                column[entry] = by;
            }
        }
        out
    }
}

/// `V = U U^T` with `U` upper triangular, as `ln U11, ln U22, ln U33, U12, U23, U13`.
fn upper_factor(V: &Matrix3<f64>) -> Option<[f64; 6]> {
    let root = |x: f64| (x > 0.0).then(|| x.sqrt());
    let scale = V.trace();
    // Below this share of its size a square is rounding, and the body a plate or a rod.
    let root = |x: f64| root(x - 1e-12 * scale).map(|_| x.sqrt());
    let u33 = root(V[(2, 2)])?;
    let (u13, u23) = (V[(0, 2)] / u33, V[(1, 2)] / u33);
    let u22 = root(V[(1, 1)] - u23 * u23)?;
    let u12 = (V[(0, 1)] - u13 * u23) / u22;
    let u11 = root(V[(0, 0)] - u12 * u12 - u13 * u13)?;
    Some([u11.ln(), u22.ln(), u33.ln(), u12, u23, u13])
}

fn turn_of(R: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*R))
}

/// Two unit vectors across a unit vector.
fn across(a: &Vector3<f64>) -> [Vector3<f64>; 2] {
    crate::plane_axes(&Unit::new_unchecked(*a))
}

/// The axis `from` moved along the sphere by `turn`, and its derivatives.
fn turned_axis(from: &Vector3<f64>, turn: &[f64; 2]) -> (Vector3<f64>, [Vector3<f64>; 2]) {
    let b = across(from);
    let r = turn[0].hypot(turn[1]);
    let (sin, cos) = r.sin_cos();
    let (sinc, slope) = if r < 1e-4 { (1.0 - r * r / 6.0, -1.0 / 3.0 + r * r / 30.0) } else { (sin / r, (cos - sin / r) / (r * r)) };
    let side = b[0] * turn[0] + b[1] * turn[1];
    (from * cos + side * sinc, [0, 1].map(|k| (side * slope - from * sinc) * turn[k] + b[k] * sinc))
}

/// The inverse of [`turned_axis`].
fn turn_of_axis(from: &Vector3<f64>, axis: &Vector3<f64>) -> [f64; 2] {
    let b = across(from);
    let y = [b[0].dot(axis), b[1].dot(axis)];
    let sin = y[0].hypot(y[1]);
    let r = sin.atan2(from.dot(axis));
    let factor = if sin > 0.0 { r / sin } else { 1.0 };
    y.map(|y| y * factor)
}

/// `J_l(r) x`: the transpose of the right Jacobian of SO(3) (Barfoot 2017, 7.77).
pub(crate) fn left_jacobian(r: &Vector3<f64>, x: &Vector3<f64>) -> Vector3<f64> {
    let angle = r.norm();
    let (a, b) = if angle < 1e-4 {
        (0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0)
    } else {
        ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / (angle * angle * angle))
    };
    let rx = r.cross(x);
    x + rx * a + r.cross(&rx) * b
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn any_ten_numbers_are_a_physical_inertia_and_come_back() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        for _ in 0..500 {
            let mut draw = |size: f64| rng.random_range(-size..size);
            let shape = [draw(2.0), draw(2.0), draw(2.0), draw(1.0), draw(1.0), draw(1.0)];
            let factor = LogCholesky {
                alpha: draw(2.0),
                t: Vector3::new(draw(1.0), draw(1.0), draw(1.0)),
                shape: Some(shape),
                variance: Matrix3::zeros(),
            };
            let inertia = factor.inertia();
            let [a, b, c] = inertia.about_center().symmetric_eigenvalues().into();
            assert!(inertia.mass > 0.0 && a > 0.0 && b > 0.0 && c > 0.0);
            assert!(a + b > c && b + c > a && c + a > b, "triangle inequality of {a}, {b}, {c}");
            let back = LogCholesky::of(&inertia);
            assert!((back.alpha - factor.alpha).abs() < 1e-12 && (back.t - factor.t).norm() < 1e-12);
            for (x, y) in back.shape.unwrap().iter().zip(shape) {
                assert!((x - y).abs() < 1e-8, "{x} {y}");
            }
        }
    }

    #[test]
    fn gradients_by_log_cholesky_are_those_of_central_differences() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
        for _ in 0..50 {
            let x: [f64; 10] = std::array::from_fn(|_| rng.random_range(-0.8..0.8));
            let g: [f64; 10] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
            let make = |x: &[f64; 10]| LogCholesky {
                alpha: x[0],
                t: Vector3::new(x[1], x[2], x[3]),
                shape: Some([x[4], x[5], x[6], x[7], x[8], x[9]]),
                variance: Matrix3::zeros(),
            };
            let value = |x: &[f64; 10]| make(x).inertia().entries().iter().zip(g).map(|(a, b)| a * b).sum::<f64>();
            for (k, by) in make(&x).pull(&g).iter().enumerate() {
                let (mut up, mut down) = (x, x);
                up[k] += 1e-5;
                down[k] -= 1e-5;
                let difference = (value(&up) - value(&down)) / 2e-5;
                assert!((by - difference).abs() < 1e-8 * (1.0 + by.abs()), "{k}: {by} {difference}");
            }
        }
    }

    #[test]
    fn axes_turn_along_the_sphere_and_come_back() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(7);
        for trial in 0..200 {
            let from = Rotation3::from_euler_angles(rng.random_range(-3.0..3.0), rng.random_range(-1.5..1.5), 0.3) * Vector3::z();
            let size = if trial < 20 { 1e-6 } else { 2.0 };
            let turn = [rng.random_range(-size..size), rng.random_range(-size..size)];
            let (axis, slopes) = turned_axis(&from, &turn);
            assert!((axis.norm() - 1.0).abs() < 1e-14);
            let back = turn_of_axis(&from, &axis);
            assert!((back[0] - turn[0]).abs() < 1e-9 && (back[1] - turn[1]).abs() < 1e-9, "{back:?} {turn:?}");
            for k in 0..2 {
                let (mut up, mut down) = (turn, turn);
                up[k] += 1e-6;
                down[k] -= 1e-6;
                let difference = (turned_axis(&from, &up).0 - turned_axis(&from, &down).0) / 2e-6;
                assert!((difference - slopes[k]).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn a_star_stands_for_anything() {
        for (pattern, name, fits) in [
            ("a/b.*", "a/b.axis.0", true),
            ("*.axis.*", "a/b.axis.0", true),
            ("*", "", true),
            ("a", "ab", false),
            ("*b", "abab", true),
            ("a*b*c", "aXbYc", true),
            ("a*b*c", "aXcYb", false),
            ("", "a", false),
        ] {
            assert_eq!(answers(pattern.as_bytes(), name.as_bytes()), fits, "{pattern} {name}");
        }
    }
}
