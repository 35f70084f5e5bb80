//! The constant part: a tree of moving bodies in flat arrays, parents before children. Fixed joints are merged into their
//! parents and inertias lumped; every link of the models keeps its name and its pose on its body.

use std::ops::Range;

use nalgebra::{Isometry3, Matrix3, Unit, Vector3};
use sagci_model::{JointKind, JointLimits, ObjectModel};

use crate::error::hint;
use crate::joint::{Motion, matrix};
use crate::workspace::Lane;
use crate::{DynamicsError, SpatialInertia, Workspace};

/// Standard gravity downwards, m/s^2.
pub const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// One object model with its place in the world.
#[derive(Debug, Clone)]
pub struct Part<'a> {
    /// Its name; links and joints are also found as `name/link`.
    pub name: String,
    /// The model.
    pub model: &'a ObjectModel,
    /// How its root link is placed.
    pub base: Base,
}

/// How a part's root link `O` is placed.
#[derive(Debug, Clone)]
pub enum Base {
    /// Fixed to the world at the pose `X_WO`.
    Welded(Isometry3<f64>),
    /// Free to move: a floating joint with the part's name stands before the part's joints.
    Floating,
    /// Fixed to a link of an earlier part, for example a held object.
    Held {
        /// Index of the earlier part.
        part: usize,
        /// Its link.
        link: String,
        /// Pose of the root link in that link.
        X_LO: Isometry3<f64>,
    },
}

impl<'a> Part<'a> {
    /// A model fixed to the world, under its own name.
    pub fn welded(model: &'a ObjectModel, X_WO: Isometry3<f64>) -> Self {
        Self { name: model.name.clone(), model, base: Base::Welded(X_WO) }
    }

    /// A model that moves freely, under its own name.
    pub fn floating(model: &'a ObjectModel) -> Self {
        Self { name: model.name.clone(), model, base: Base::Floating }
    }
}

/// Names one link of a multibody.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LinkId(pub(crate) usize);

/// Names one joint of the models: a moving one, a follower, a fixed one, or the base of a part (under the part's name).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JointId(pub(crate) usize);

/// A joint of the models that moves on its own, and where it stands in `q` and `v`.
#[derive(Debug, Clone)]
pub struct JointInfo {
    /// Name of its part.
    pub part: String,
    /// Name; a floating base has its part's name.
    pub name: String,
    /// Kind, never `Fixed`.
    pub kind: JointKind,
    /// Its entries in `q`.
    pub q: Range<usize>,
    /// Its entries in `v` and in efforts.
    pub v: Range<usize>,
    /// Limits; those of joints that follow it are taken in.
    pub limits: JointLimits,
    /// Viscous damping from the URDF, N m s/rad or N s/m.
    pub damping: f64,
    /// Dry friction from the URDF, N m or N.
    pub friction: f64,
}

/// One link of the models: where it lies on its body.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    pub part: usize,
    pub name: String,
    pub body: usize,
    pub X_BL: Isometry3<f64>,
    /// Its own inertia in its own frame.
    pub inertia: SpatialInertia,
}

/// One joint of the models, whether it moves or not: what its origin and axis are set by.
#[derive(Debug, Clone)]
pub(crate) struct Mount {
    pub part: usize,
    pub name: String,
    pub kind: JointKind,
    /// The link that carries it; none for what is fixed to the world or free in it.
    pub parent: Option<usize>,
    /// The link that it carries.
    pub child: usize,
    /// Pose of the joint's fixed frame in the parent link (in the world where there is none).
    pub X_PJ: Isometry3<f64>,
    pub axis: Unit<Vector3<f64>>,
    /// The body that it moves; for a fixed joint the body that both its links belong to.
    pub body: usize,
}

/// One moving body with the joint that moves it. Body 0 is the world and has no joint.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub parent: usize,
    pub motion: Motion,
    /// Pose of the joint's fixed frame on the parent body.
    pub R_PJ: Matrix3<f64>,
    pub p_PJ: Vector3<f64>,
    /// The joint's axis on the parent body.
    pub axis_P: Vector3<f64>,
    /// `R_PB = turn[0] + cos q turn[1] + sin q turn[2]` for a joint that turns about its axis alone.
    pub turn: [Matrix3<f64>; 3],
    /// First entries of its joint in `q`, in `v`, and among the tree's own degrees of freedom.
    pub q: usize,
    pub v: usize,
    pub tree: usize,
    /// First degree of freedom of the branch of the world that it belongs to: its ancestors stand between this and its own.
    pub first: usize,
    /// Number of positions and of degrees of freedom.
    pub nq: usize,
    pub nv: usize,
    /// A follower's position is `ratio * q + offset`; 1 and 0 for a joint that moves on its own. The columns of `S` in the
    /// workspace hold the ratio already.
    pub ratio: f64,
    pub offset: f64,
    pub follows: bool,
    /// Which of [`Multibody::joints`] moves it.
    pub joint: usize,
}

impl Body {
    pub fn tree_range(&self) -> Range<usize> {
        self.tree..self.tree + self.nv
    }

    fn place(&mut self, X_PJ: &Isometry3<f64>) {
        self.R_PJ = matrix(&X_PJ.rotation);
        self.p_PJ = X_PJ.translation.vector;
        self.prepare();
    }

    /// Constants of the fast ways through kinematics. Rodrigues: `R_JB = n n^T + cos q (1 - n n^T) + sin q [n x]`.
    pub(crate) fn prepare(&mut self) {
        let n = self.motion.axis;
        let along = n * n.transpose();
        self.axis_P = self.R_PJ * n;
        self.turn = [self.R_PJ * along, self.R_PJ * (Matrix3::identity() - along), self.R_PJ * n.cross_matrix()];
    }
}

/// A tree of rigid bodies: the constant part of all algorithms. See the crate's first page for its conventions.
#[derive(Debug, Clone)]
pub struct Multibody {
    pub(crate) bodies: Vec<Body>,
    /// Lumped inertia of each body in its own frame (that of the link its joint moves); what is fixed to the world is
    /// entry 0.
    pub(crate) inertia: Vec<SpatialInertia>,
    pub(crate) frames: Vec<Frame>,
    pub(crate) mounts: Vec<Mount>,
    pub(crate) joints: Vec<JointInfo>,
    pub(crate) parts: Vec<String>,
    /// Gravity, m/s^2.
    pub(crate) gravity: Vector3<f64>,
    /// Inertia that each drive adds to its own degree of freedom, kg m^2 or kg.
    pub(crate) armature: Vec<f64>,
    pub(crate) nq: usize,
    pub(crate) nv: usize,
    pub(crate) tree: usize,
    pub(crate) has_followers: bool,
    /// By velocity: the velocity before it on its way to the world, plus one; zero for none. Where joints follow others, each
    /// stands on the one before it, for then any two can be coupled.
    pub(crate) before: Vec<usize>,
    /// By degree of freedom of the tree, `tree.div_ceil(4)` lanes a row: one for itself and those before it on its way to the world,
    /// zero for all others.
    pub(crate) along: Vec<Lane>,
}

impl Multibody {
    /// Puts models together. Joints that mimic another one follow it exactly: they add no degree of freedom.
    ///
    /// # Errors
    /// Two parts of one name, a part held by a link that is not there, a joint that mimics one of more or less than one
    /// degree of freedom, a joint behind which there is no inertia; a link whose mass or inertia no body has, a joint whose axis has no
    /// direction.
    pub fn new(parts: &[Part<'_>]) -> Result<Self, DynamicsError> {
        let world = Body {
            parent: 0,
            motion: Motion::new(JointKind::Fixed, &Vector3::z_axis()),
            R_PJ: Matrix3::identity(),
            p_PJ: Vector3::zeros(),
            axis_P: Vector3::zeros(),
            turn: [Matrix3::identity(); 3],
            q: 0,
            v: 0,
            tree: 0,
            first: 0,
            nq: 0,
            nv: 0,
            ratio: 1.0,
            offset: 0.0,
            follows: false,
            joint: 0,
        };
        let mut built = Self {
            bodies: vec![world],
            inertia: vec![SpatialInertia::ZERO],
            frames: Vec::new(),
            mounts: Vec::new(),
            joints: Vec::new(),
            parts: Vec::new(),
            gravity: GRAVITY,
            armature: Vec::new(),
            nq: 0,
            nv: 0,
            tree: 0,
            has_followers: false,
            before: Vec::new(),
            along: Vec::new(),
        };
        for part in parts {
            built.add(part)?;
        }
        built.link_velocities();
        built.armature = vec![0.0; built.nv];
        built.check_inertia()?;
        Ok(built)
    }

    /// One model fixed to the world.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn welded(model: &ObjectModel, X_WO: Isometry3<f64>) -> Result<Self, DynamicsError> {
        Self::new(&[Part::welded(model, X_WO)])
    }

    fn add(&mut self, part: &Part<'_>) -> Result<(), DynamicsError> {
        let fault = |place: &str, message: String| DynamicsError::Build { part: part.name.clone(), place: place.into(), message };
        if self.parts.contains(&part.name) {
            return Err(fault("name", "another part has this name; give each part its own".into()));
        }
        let index = self.parts.len();
        self.parts.push(part.name.clone());
        let model = part.model;
        if model.links.len() != model.joints.len() + 1 {
            return Err(fault("links", format!("{} links do not make a tree with {} joints", model.links.len(), model.joints.len())));
        }

        for link in &model.links {
            check_inertial(&link.inertial).map_err(|m| fault(&link.name, m))?;
        }
        for joint in &model.joints {
            let turns = !matches!(joint.kind, JointKind::Fixed | JointKind::Floating);
            let length = joint.axis.norm();
            if turns && (length.is_nan() || (length - 1.0).abs() > 1e-6) {
                return Err(fault(&joint.name, format!("its axis has the length {length}; it must be a unit vector")));
            }
            if !joint.X_PJ.to_homogeneous().iter().all(|x| x.is_finite()) {
                return Err(fault(&joint.name, "its origin is not finite".into()));
            }
        }

        // Links and joints of this part stand after those of earlier ones.
        let first = self.frames.len();
        let link = |name: &str, inertial, body| Frame {
            part: index,
            name: name.into(),
            body,
            X_BL: Isometry3::identity(),
            inertia: SpatialInertia::from(inertial),
        };
        let z = Vector3::z_axis();
        let mut base = Mount {
            part: index,
            name: part.name.clone(),
            kind: JointKind::Fixed,
            parent: None,
            child: first,
            X_PJ: Isometry3::identity(),
            axis: z,
            body: 0,
        };
        match &part.base {
            Base::Welded(X_WO) => base.X_PJ = *X_WO,
            Base::Held { part: holder, link, X_LO } => {
                let found = self.frames.iter().position(|f| f.part == *holder && f.name == *link && *holder < index);
                let found =
                    found.ok_or_else(|| fault("base", format!("is held by the link '{link}' of part {holder}, which is not there")))?;
                (base.parent, base.X_PJ, base.body) = (Some(found), *X_LO, self.frames[found].body);
            }
            Base::Floating => {
                self.joints.push(JointInfo {
                    part: part.name.clone(),
                    name: part.name.clone(),
                    kind: JointKind::Floating,
                    q: self.nq..self.nq + 7,
                    v: self.nv..self.nv + 6,
                    limits: JointLimits::NONE,
                    damping: 0.0,
                    friction: 0.0,
                });
                base.kind = JointKind::Floating;
                base.body = self.push_body(0, Motion::new(JointKind::Floating, &z), (self.joints.len() - 1, 1.0, 0.0, false));
                self.nq += 7;
                self.nv += 6;
            }
        }
        self.frames.push(link(&model.links[0].name, &model.links[0].inertial, base.body));
        self.mounts.push(base);
        let mut moved_by: Vec<Option<usize>> = vec![None; model.joints.len()];
        // Followers can stand before the joint that they follow, so entries of `q` are given out first.
        for (j, joint) in model.joints.iter().enumerate() {
            if joint.kind == JointKind::Fixed || joint.mimic.is_some() {
                continue;
            }
            moved_by[j] = Some(self.joints.len());
            self.joints.push(JointInfo {
                part: part.name.clone(),
                name: joint.name.clone(),
                kind: joint.kind,
                q: self.nq..self.nq + joint.kind.positions(),
                v: self.nv..self.nv + joint.kind.velocities(),
                limits: joint.limits,
                damping: joint.damping,
                friction: joint.friction,
            });
            self.nq += joint.kind.positions();
            self.nv += joint.kind.velocities();
        }
        for (j, joint) in model.joints.iter().enumerate() {
            let Some(carrier) = self.frames.get(first + joint.parent).map(|f| f.body) else {
                return Err(fault(&joint.name, "its parent link stands after its child".into()));
            };
            if first + joint.child != self.frames.len() {
                return Err(fault(&joint.name, "its child link is out of order".into()));
            }
            let motion = Motion::new(joint.kind, &joint.axis);
            let follows = match joint.mimic {
                Some(_) if joint.kind != JointKind::Fixed => {
                    Some(self.resolve_mimic(model, &moved_by, j).map_err(|m| fault(&joint.name, m))?)
                }
                _ => None,
            };
            let body = match (joint.kind, follows, moved_by[j]) {
                (JointKind::Fixed, _, _) => carrier,
                (_, Some((leader, ratio, offset)), _) => self.push_body(carrier, motion, (leader, ratio, offset, true)),
                (_, None, Some(info)) => self.push_body(carrier, motion, (info, 1.0, 0.0, false)),
                (_, None, None) => return Err(fault(&joint.name, "has no place in q".into())),
            };
            self.mounts.push(Mount {
                part: index,
                name: joint.name.clone(),
                kind: joint.kind,
                parent: Some(first + joint.parent),
                child: self.frames.len(),
                X_PJ: joint.X_PJ,
                axis: joint.axis,
                body,
            });
            let child = &model.links[joint.child];
            self.frames.push(link(&child.name, &child.inertial, body));
        }
        self.arrange();
        Ok(())
    }

    fn link_velocities(&mut self) {
        let width = self.tree.div_ceil(4);
        self.along = vec![[0.0; 4]; self.tree * width];
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            for t in body.tree_range() {
                let mut at = i;
                while at != 0 {
                    let inner = &self.bodies[at];
                    for l in inner.tree_range().filter(|l| *l <= t) {
                        self.along[t * width + l / 4][l % 4] = 1.0;
                    }
                    at = inner.parent;
                }
            }
        }
        self.before = (0..self.nv).collect();
        if self.has_followers {
            return;
        }
        for body in self.bodies.iter().skip(1) {
            let parent = &self.bodies[body.parent];
            self.before[body.v] = if body.parent == 0 { 0 } else { parent.v + parent.nv };
        }
    }

    /// Puts links and joints where the origins of all joints say, and adds up what each body carries.
    fn arrange(&mut self) {
        for mount in &self.mounts {
            let X_BJ = mount.parent.map_or(mount.X_PJ, |parent| self.frames[parent].X_BL * mount.X_PJ);
            if mount.kind == JointKind::Fixed {
                self.frames[mount.child].X_BL = X_BJ;
            } else {
                self.frames[mount.child].X_BL = Isometry3::identity();
                self.bodies[mount.body].place(&X_BJ);
            }
        }
        self.lump();
    }

    fn lump(&mut self) {
        self.inertia.fill(SpatialInertia::ZERO);
        for frame in &self.frames {
            self.inertia[frame.body] += frame.inertia.moved(&matrix(&frame.X_BL.rotation), &frame.X_BL.translation.vector);
        }
    }

    /// The joint that is followed in the end, with multiplier and offset, and the limits and losses of the follower given
    /// to it.
    fn resolve_mimic(&mut self, model: &ObjectModel, moved_by: &[Option<usize>], follower: usize) -> Result<(usize, f64, f64), String> {
        let (mut multiplier, mut offset, mut at) = (1.0, 0.0, follower);
        for _ in 0..model.joints.len() {
            let joint = &model.joints[at];
            if joint.kind.velocities() != 1 {
                return Err(format!("'{}' cannot take part in a mimic: only joints of one degree of freedom can", joint.name));
            }
            let Some(mimic) = joint.mimic else {
                let info = moved_by[at].ok_or_else(|| format!("mimics the fixed joint '{}'", joint.name))?;
                self.follow_limits(info, &model.joints[follower], multiplier, offset);
                return Ok((info, multiplier, offset));
            };
            // q = m (m' q' + o') + o
            offset += multiplier * mimic.offset;
            multiplier *= mimic.multiplier;
            at = mimic.joint;
            if at >= model.joints.len() {
                return Err("mimics a joint that does not exist".into());
            }
        }
        Err("mimics itself in a circle".into())
    }

    fn follow_limits(&mut self, info: usize, follower: &sagci_model::Joint, multiplier: f64, offset: f64) {
        let leader = &mut self.joints[info];
        if multiplier != 0.0 {
            let (a, b) = ((follower.limits.lower - offset) / multiplier, (follower.limits.upper - offset) / multiplier);
            leader.limits.lower = leader.limits.lower.max(a.min(b));
            leader.limits.upper = leader.limits.upper.min(a.max(b));
        }
        // Power is kept: c (m v)^2 = (c m^2) v^2, and f |m v| = (f |m|) |v|.
        leader.damping += follower.damping * multiplier * multiplier;
        leader.friction += follower.friction * multiplier.abs();
    }

    /// A body moved by the joint `joint`, which has its entries in `q` and `v`, or which another one follows.
    fn push_body(&mut self, parent: usize, motion: Motion, (joint, ratio, offset, follows): (usize, f64, f64, bool)) -> usize {
        let (nq, nv) = (motion.kind.positions(), motion.kind.velocities());
        let (q, v) = (self.joints[joint].q.start, self.joints[joint].v.start);
        let (R_PJ, p_PJ) = (Matrix3::identity(), Vector3::zeros());
        self.has_followers |= follows;
        let (axis_P, turn, tree) = (Vector3::zeros(), [Matrix3::identity(); 3], self.tree);
        let first = if parent == 0 { tree } else { self.bodies[parent].first };
        self.bodies.push(Body { parent, motion, R_PJ, p_PJ, axis_P, turn, q, v, tree, first, nq, nv, ratio, offset, follows, joint });
        self.inertia.push(SpatialInertia::ZERO);
        self.tree += nv;
        self.bodies.len() - 1
    }

    /// Each joint must move some inertia, or its acceleration is undefined.
    fn check_inertia(&self) -> Result<(), DynamicsError> {
        let mut ws = self.workspace();
        self.mass_matrix(&mut ws)?;
        for joint in &self.joints {
            if joint.v.clone().any(|i| ws.M[(i, i)] <= 0.0 || ws.M[(i, i)].is_nan()) {
                return Err(DynamicsError::NoInertia { joint: joint.name.clone() });
            }
        }
        Ok(())
    }

    /// A workspace at the neutral state.
    pub fn workspace(&self) -> Workspace {
        Workspace::new(self)
    }

    /// Was the workspace made for a multibody of this shape?
    pub(crate) fn owns(&self, ws: &Workspace) -> Result<(), DynamicsError> {
        let same = ws.q.len() == self.nq && ws.v.len() == self.nv && ws.S.len() == self.tree && ws.V.len() == self.bodies.len();
        if same { Ok(()) } else { Err(DynamicsError::ForeignWorkspace) }
    }

    /// Number of positions: the length of `q`.
    pub fn nq(&self) -> usize {
        self.nq
    }

    /// Number of velocities, efforts and accelerations: the length of `v`.
    pub fn nv(&self) -> usize {
        self.nv
    }

    /// The joints that move on their own, in the order of `q` and `v`.
    pub fn joints(&self) -> &[JointInfo] {
        &self.joints
    }

    /// Names of the parts.
    pub fn parts(&self) -> &[String] {
        &self.parts
    }

    /// All links of all parts: name of the part, name of the link.
    pub fn links(&self) -> impl Iterator<Item = (LinkId, &str, &str)> + '_ {
        self.frames.iter().enumerate().map(|(i, f)| (LinkId(i), self.parts[f.part].as_str(), f.name.as_str()))
    }

    /// A link by its name, or by `part/name`.
    ///
    /// # Errors
    /// There is none, or more than one, of this name.
    pub fn link(&self, name: &str) -> Result<LinkId, DynamicsError> {
        let mut found = self.frames.iter().enumerate().filter(|(_, f)| self.answers(name, &self.parts[f.part], &f.name));
        match (found.next(), found.next()) {
            (Some((i, _)), None) => Ok(LinkId(i)),
            (None, _) => Err(unknown("link", name, self.frames.iter().map(|f| f.name.as_str()))),
            (Some(_), Some(_)) => Err(ambiguous("link", name)),
        }
    }

    /// A moving joint by its name, or by `part/name`.
    ///
    /// # Errors
    /// There is none, or more than one, of this name.
    pub fn joint(&self, name: &str) -> Result<&JointInfo, DynamicsError> {
        let mut found = self.joints.iter().filter(|j| self.answers(name, &j.part, &j.name));
        match (found.next(), found.next()) {
            (Some(j), None) => Ok(j),
            (None, _) => Err(unknown("moving joint", name, self.joints.iter().map(|j| j.name.as_str()))),
            (Some(_), Some(_)) => Err(ambiguous("moving joint", name)),
        }
    }

    /// Entry in `v` of a joint of one degree of freedom. Its entry in `q` is [`JointInfo::q`].
    ///
    /// # Errors
    /// There is no such joint, or it has more than one degree of freedom.
    pub fn velocity_index(&self, name: &str) -> Result<usize, DynamicsError> {
        let joint = self.joint(name)?;
        if joint.v.len() == 1 {
            Ok(joint.v.start)
        } else {
            Err(DynamicsError::Build {
                part: joint.part.clone(),
                place: joint.name.clone(),
                message: format!("has {} degrees of freedom where one is needed", joint.v.len()),
            })
        }
    }

    /// Entries in `v` of several joints of one degree of freedom.
    ///
    /// # Errors
    /// As [`Self::velocity_index`].
    pub fn velocity_indices(&self, names: &[String]) -> Result<Vec<usize>, DynamicsError> {
        names.iter().map(|n| self.velocity_index(n)).collect()
    }

    fn answers(&self, asked: &str, part: &str, name: &str) -> bool {
        asked == name || asked.strip_prefix(part).and_then(|rest| rest.strip_prefix('/')) == Some(name)
    }

    /// Gravity in the world, m/s^2.
    pub fn gravity(&self) -> Vector3<f64> {
        self.gravity
    }

    /// Sets gravity in the world, m/s^2.
    pub fn set_gravity(&mut self, gravity: Vector3<f64>) {
        self.gravity = gravity;
    }

    /// Inertia that a drive's rotor adds to each degree of freedom, by velocity, kg m^2 or kg.
    pub fn armature_mut(&mut self) -> &mut [f64] {
        &mut self.armature
    }

    /// Inertia of the body that carries a link (with all that is fixed to it), in the link's frame.
    pub fn body_inertia(&self, link: LinkId) -> SpatialInertia {
        let frame = &self.frames[link.0];
        let X_LB = frame.X_BL.inverse();
        self.inertia[frame.body].moved(&matrix(&X_LB.rotation), &X_LB.translation.vector)
    }

    /// Replaces the inertia of the body that carries a link, given in the link's frame: the link itself takes the difference,
    /// and what is fixed to it stays as it is. Takes effect with the next state.
    pub fn set_body_inertia(&mut self, link: LinkId, inertia: &SpatialInertia) {
        let others = self.body_inertia(link) - self.frames[link.0].inertia;
        self.set_link_inertia(link, &(*inertia - others));
    }

    /// Inertia of one link, in its own frame, without what is fixed to it.
    pub fn link_inertia(&self, link: LinkId) -> &SpatialInertia {
        &self.frames[link.0].inertia
    }

    /// Replaces the inertia of one link, given in its own frame. Takes effect with the next state.
    pub fn set_link_inertia(&mut self, link: LinkId, inertia: &SpatialInertia) {
        self.frames[link.0].inertia = *inertia;
        self.lump();
    }

    /// All joints of the models, fixed ones, followers and bases of parts too: name of the part, name of the joint, kind.
    pub fn model_joints(&self) -> impl Iterator<Item = (JointId, &str, &str, JointKind)> + '_ {
        self.mounts.iter().enumerate().map(|(i, m)| (JointId(i), self.parts[m.part].as_str(), m.name.as_str(), m.kind))
    }

    /// A joint of the models by its name, or by `part/name`; fixed ones, followers and bases of parts too.
    ///
    /// # Errors
    /// There is none, or more than one, of this name.
    pub fn model_joint(&self, name: &str) -> Result<JointId, DynamicsError> {
        let mut found = self.mounts.iter().enumerate().filter(|(_, m)| self.answers(name, &self.parts[m.part], &m.name));
        match (found.next(), found.next()) {
            (Some((i, _)), None) => Ok(JointId(i)),
            (None, _) => Err(unknown("joint", name, self.mounts.iter().map(|m| m.name.as_str()))),
            (Some(_), Some(_)) => Err(ambiguous("joint", name)),
        }
    }

    /// Pose of a joint's fixed frame in its parent link; of a part's base in the world or in the link that holds it.
    pub fn joint_origin(&self, joint: JointId) -> &Isometry3<f64> {
        &self.mounts[joint.0].X_PJ
    }

    /// Replaces a joint's origin. Takes effect with the next state. The origin of a floating base has no meaning of its own.
    pub fn set_joint_origin(&mut self, joint: JointId, X_PJ: &Isometry3<f64>) {
        self.mounts[joint.0].X_PJ = *X_PJ;
        self.arrange();
    }

    /// Axis of a joint in its own frame.
    pub fn joint_axis(&self, joint: JointId) -> &Unit<Vector3<f64>> {
        &self.mounts[joint.0].axis
    }

    /// Replaces a joint's axis, given in its own frame. Takes effect with the next state. Fixed and floating joints have none.
    pub fn set_joint_axis(&mut self, joint: JointId, axis: &Unit<Vector3<f64>>) {
        let mount = &mut self.mounts[joint.0];
        mount.axis = *axis;
        if mount.kind != JointKind::Fixed {
            self.bodies[mount.body].motion = Motion::new(mount.kind, axis);
            self.bodies[mount.body].prepare();
        }
    }

    /// Writes the positions at which every joint's child lies on the joint's frame.
    pub fn neutral_positions(&self, q: &mut [f64]) {
        for body in self.bodies.iter().skip(1).filter(|b| !b.follows) {
            if let Some(q) = q.get_mut(body.q..body.q + body.nq) {
                body.motion.neutral(q);
            }
        }
    }

    /// Moves positions along a velocity held for the time `dt`.
    ///
    /// # Errors
    /// A vector of the wrong length.
    pub fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) -> Result<(), DynamicsError> {
        length("q", q.len(), self.nq)?;
        length("v", v.len(), self.nv)?;
        for body in self.bodies.iter().skip(1).filter(|b| !b.follows) {
            if body.nq == 1 {
                q[body.q] += v[body.v] * dt;
                continue;
            }
            body.motion.integrate(&mut q[body.q..body.q + body.nq], &v[body.v..body.v + body.nv], dt);
        }
        Ok(())
    }

    /// The velocity that takes positions `from` to `to` in unit time.
    ///
    /// # Errors
    /// A vector of the wrong length.
    pub fn difference(&self, from: &[f64], to: &[f64], v: &mut [f64]) -> Result<(), DynamicsError> {
        length("from", from.len(), self.nq)?;
        length("to", to.len(), self.nq)?;
        length("v", v.len(), self.nv)?;
        for body in self.bodies.iter().skip(1).filter(|b| !b.follows) {
            let range = body.q..body.q + body.nq;
            body.motion.difference(&from[range.clone()], &to[range], &mut v[body.v..body.v + body.nv]);
        }
        Ok(())
    }
}

/// Can a body have these mass properties? The greatest principal moment is at most the sum of the others; as where models are read,
/// figures that were identified on machines may break this by a quarter.
fn check_inertial(inertial: &sagci_model::Inertial) -> Result<(), String> {
    let (mass, I) = (inertial.mass, &inertial.I_LLcm_L);
    let finite = mass.is_finite() && inertial.p_LoLcm.iter().chain(I.iter()).all(|x| x.is_finite());
    if !finite || mass < 0.0 {
        return Err(format!("has the mass {mass} kg, or a centre or inertia that is not finite; masses are finite and not negative"));
    }
    let mut moments: [f64; 3] = I.symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    let [a, b, c] = moments;
    if a < -1e-9 * c.abs() || c > 1.25 * (a + b) + 1e-9 * c.abs() {
        return Err(format!("has the principal moments of inertia {a:.3e}, {b:.3e}, {c:.3e} kg m^2, which no body has"));
    }
    Ok(())
}

pub(crate) fn length(what: &'static str, given: usize, needed: usize) -> Result<(), DynamicsError> {
    if given == needed { Ok(()) } else { Err(DynamicsError::Length { what, given, needed }) }
}

fn unknown<'a>(kind: &str, name: &str, names: impl Iterator<Item = &'a str> + Clone) -> DynamicsError {
    DynamicsError::Unknown { kind: kind.into(), name: name.into(), hint: hint(name, names) }
}

fn ambiguous(kind: &str, name: &str) -> DynamicsError {
    DynamicsError::Unknown { kind: format!("single {kind}"), name: name.into(), hint: "; several parts have one: write part/name".into() }
}
