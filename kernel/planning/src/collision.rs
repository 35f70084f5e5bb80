//! Does the arm touch anything?
//!
//! Every collision shape is a convex solid; a mesh counts as the convex hulls of its connected parts. Robot links follow
//! the joints, fingers the gripper's opening, a held object the tool. Three filters stand before the exact test, so that a
//! check costs some ten microseconds: bounding spheres of links, spheres against the box around each solid, and then
//! Gilbert, Johnson and Keerthi's algorithm (parry) stopped as soon as it has proved the padding to be kept.
//!
//! What may touch is said solid by solid: a finger closes on a handle's bar and must still not dig into the door behind.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};
use parry3d_f64::math::{Pose3, Vec3};
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::{Capsule, Segment, SharedShape, SupportMap};
use parry3d_f64::transformation::try_convex_hull;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use sagci_model::{Geometry, JointKind, ObjectModel, Shape};

use crate::convert::{pose, vector};
use crate::{ArmKinematics, PlanError, Scene};

/// Two things that touch, or come nearer than they should.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Contact {
    /// A link of the robot, or the held object.
    pub first: String,
    /// A link of the robot, a link of an object as `object/link`, or `table`.
    pub second: String,
}

/// A set of the robot's links.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkSet(u128);

impl LinkSet {
    /// Links in either.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    fn has(self, link: usize) -> bool {
        self.0 >> link & 1 == 1
    }
}

#[derive(Debug, Clone)]
struct Solid {
    shape: SharedShape,
    X_LG: Pose3,
    /// Box around it in its own frame.
    center: Vec3,
    half: Vec3,
    radius: f64,
}

#[derive(Debug, Clone)]
struct RobotLink {
    name: String,
    /// Frame of [`ArmKinematics::frames`] that it is fixed to.
    frame: usize,
    X_FL: Pose3,
    /// Way of a finger in the frame for each metre of the gripper's opening.
    finger: Vec3,
    is_finger: bool,
    solids: Arc<Vec<Solid>>,
    center: Vec3,
    radius: f64,
}

impl RobotLink {
    /// Pose in the world, for its frame's pose and the gripper's opening.
    fn pose(&self, X_WJ: Pose3, width: f64) -> Pose3 {
        let mut X = X_WJ;
        X.translation += X.rotation * (self.finger * width);
        X * self.X_FL
    }
}

#[derive(Debug, Clone)]
struct Group {
    object: usize,
    link: usize,
    name: String,
    solids: Arc<Vec<Solid>>,
    /// Pose of the link: in the world, or in the tool frame if it is held.
    X: Pose3,
    center: Vec3,
    radius: f64,
    /// For each solid the robot's links that may touch it, and those that may come close.
    touch: Vec<u128>,
    close: Vec<u128>,
    /// For each solid: the held object may touch it.
    held_touch: Vec<bool>,
    held: bool,
}

/// The robot, the objects at their believed poses and the table, ready to be asked. Cheap to clone: shapes are shared.
#[derive(Debug, Clone)]
pub struct CollisionWorld {
    arm: ArmKinematics,
    robot: Vec<RobotLink>,
    pairs: Vec<(usize, usize)>,
    groups: Vec<Group>,
    scene: Scene,
    table_held_touch: bool,
    table_close: u128,
    /// Distance that the robot and what it holds keep from other things, m.
    pub padding: f64,
    /// Distance that links which may come close still keep (fingers that reach round a handle), m.
    pub close_padding: f64,
    /// Distance that the robot's links keep from one another, m.
    pub self_padding: f64,
}

const TABLE: &str = "table";

fn solids(shapes: &[Shape], model: &str) -> Result<Vec<Solid>, PlanError> {
    let mut out = Vec::new();
    for shape in shapes {
        let X_LG = pose(&shape.X_LG);
        match &shape.geometry {
            Geometry::Box { half_extents } => out.push(solid(SharedShape::cuboid(half_extents.x, half_extents.y, half_extents.z), X_LG)),
            Geometry::Sphere { radius } => out.push(solid(SharedShape::ball(*radius), X_LG)),
            Geometry::Cylinder { radius, half_length } => {
                // parry's cylinder stands along y, URDF's along z.
                let X_GY = Pose3::rotation(Vec3::new(std::f64::consts::FRAC_PI_2, 0.0, 0.0));
                out.push(solid(SharedShape::cylinder(*half_length, *radius), X_LG * X_GY));
            }
            Geometry::Capsule { radius, half_length } => {
                let end = Vec3::new(0.0, 0.0, *half_length);
                out.push(solid(SharedShape::new(Capsule::new(-end, end, *radius)), X_LG));
            }
            Geometry::Mesh { mesh, file, .. } => {
                for part in connected_parts(mesh.vertices.len(), &mesh.triangles) {
                    let points: Vec<Vec3> = part.iter().map(|i| vector(&mesh.vertices[*i].coords)).collect();
                    let hull = try_convex_hull(&points).ok().and_then(|(v, t)| SharedShape::convex_mesh(v, &t));
                    let hull = hull.ok_or_else(|| PlanError::ModelLacks {
                        model: model.to_owned(),
                        message: format!("mesh '{}' has a part without volume, which cannot be checked for collisions", file.display()),
                    })?;
                    out.push(solid(hull, X_LG));
                }
            }
        }
    }
    Ok(out)
}

fn solid(shape: SharedShape, X_LG: Pose3) -> Solid {
    let aabb = shape.compute_local_aabb();
    let (center, half) = (aabb.center(), aabb.half_extents());
    let radius = half.length();
    Solid { shape, X_LG, center, half, radius }
}

/// Corner points of each set of triangles that hang together, in the order of their first corner.
fn connected_parts(vertices: usize, triangles: &[[u32; 3]]) -> Vec<Vec<usize>> {
    let mut parent: Vec<usize> = (0..vertices).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    for t in triangles {
        let [a, b, c] = t.map(|i| i as usize);
        if a.max(b).max(c) >= vertices {
            continue;
        }
        let (ra, rb) = (root(&mut parent, a), root(&mut parent, b));
        parent[ra.max(rb)] = ra.min(rb);
        let (ra, rc) = (root(&mut parent, a), root(&mut parent, c));
        parent[ra.max(rc)] = ra.min(rc);
    }
    let mut parts: std::collections::BTreeMap<usize, Vec<usize>> = std::collections::BTreeMap::new();
    for i in 0..vertices {
        let r = root(&mut parent, i);
        parts.entry(r).or_default().push(i);
    }
    // A corner that no triangle uses is no solid.
    parts.into_values().filter(|p| p.len() >= 4).collect()
}

fn bound(solids: &[Solid]) -> (Vec3, f64) {
    if solids.is_empty() {
        return (Vec3::ZERO, 0.0);
    }
    let mut low = Vec3::splat(f64::INFINITY);
    let mut high = Vec3::splat(f64::NEG_INFINITY);
    for s in solids {
        let aabb = s.shape.compute_aabb(&s.X_LG);
        low = low.min(aabb.mins);
        high = high.max(aabb.maxs);
    }
    let center = (low + high) * 0.5;
    let radius = solids.iter().map(|s| ((s.X_LG * s.center) - center).length() + s.radius).fold(0.0, f64::max);
    (center, radius.min((high - low).length() * 0.5))
}

/// Nearer than `margin`? With no margin only true overlap counts.
fn within(a: &Solid, X_WA: &Pose3, b: &Solid, X_WB: &Pose3, margin: f64) -> bool {
    let (Some(sa), Some(sb)) = (a.shape.as_support_map(), b.shape.as_support_map()) else { return true };
    let X_AB = X_WA.inv_mul(X_WB);
    match closest(sa, sb, &X_AB, a, b, margin, false) {
        GJKResult::Intersection => true,
        GJKResult::Proximity(_) | GJKResult::ClosestPoints(..) => margin > 0.0,
        GJKResult::NoIntersection(_) => false,
    }
}

fn distance(a: &Solid, X_WA: &Pose3, b: &Solid, X_WB: &Pose3, limit: f64) -> f64 {
    let (Some(sa), Some(sb)) = (a.shape.as_support_map(), b.shape.as_support_map()) else { return 0.0 };
    let X_AB = X_WA.inv_mul(X_WB);
    match closest(sa, sb, &X_AB, a, b, limit, true) {
        GJKResult::Intersection | GJKResult::Proximity(_) => 0.0,
        GJKResult::ClosestPoints(p, q, _) => (p - q).length(),
        GJKResult::NoIntersection(_) => limit,
    }
}

fn closest(sa: &dyn SupportMap, sb: &dyn SupportMap, X_AB: &Pose3, a: &Solid, b: &Solid, limit: f64, exact: bool) -> GJKResult {
    let mut simplex = VoronoiSimplex::new();
    let dir = (a.center - X_AB * b.center).try_normalize().unwrap_or(Vec3::X);
    simplex.reset(CsoPoint::from_shapes(X_AB, sa, sb, dir));
    gjk::closest_points(X_AB, sa, sb, limit, exact, &mut simplex)
}

/// Is a ball nearer to the box around a solid than `margin`?
fn ball_near(solid: &Solid, X_WG: &Pose3, center: Vec3, reach: f64) -> bool {
    let p = X_WG.inverse_transform_point(center) - solid.center;
    (p.abs() - solid.half).max(Vec3::ZERO).length_squared() < reach * reach
}

impl CollisionWorld {
    /// Builds the world of a scene. Objects that the scene says are held are attached to the tool.
    ///
    /// # Errors
    /// [`PlanError::ModelLacks`] if a model cannot be planned with.
    pub fn new(scene: &Scene) -> Result<Self, PlanError> {
        let arm = ArmKinematics::new(&scene.robot, &scene.X_WR)?;
        let robot = robot_links(&scene.robot)?;
        let mut world = Self {
            arm,
            robot,
            pairs: Vec::new(),
            groups: Vec::new(),
            scene: scene.clone(),
            table_held_touch: false,
            table_close: 0,
            padding: 0.01,
            close_padding: 0.004,
            self_padding: 0.005,
        };
        for (object, o) in scene.objects.iter().enumerate() {
            for (link, l) in o.model.links.iter().enumerate() {
                let solids = solids(&l.collisions, &o.model.name)?;
                if solids.is_empty() {
                    continue;
                }
                let (center, radius) = bound(&solids);
                let n = solids.len();
                world.groups.push(Group {
                    object,
                    link,
                    name: format!("{}/{}", o.name, l.name),
                    solids: Arc::new(solids),
                    X: Pose3::IDENTITY,
                    center,
                    radius,
                    touch: vec![0; n],
                    close: vec![0; n],
                    held_touch: vec![false; n],
                    held: o.X_TO.is_some(),
                });
            }
        }
        (0..scene.objects.len()).for_each(|o| world.place_groups(o));
        world.find_self_pairs();
        Ok(world)
    }

    /// The arm that is checked.
    pub fn arm(&self) -> &ArmKinematics {
        &self.arm
    }

    /// The scene as it is checked now.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    fn place_groups(&mut self, object: usize) {
        let o = &self.scene.objects[object];
        let X_OL = o.model.X_OL(&o.q);
        let X = o.X_TO.unwrap_or(o.X_WO);
        for g in self.groups.iter_mut().filter(|g| g.object == object) {
            g.X = pose(&(X * X_OL[g.link]));
            g.held = o.X_TO.is_some();
        }
    }

    /// Moves one joint of an object (`slot` counts its moving joints).
    pub fn set_joint(&mut self, object: usize, slot: usize, q: f64) {
        let Some(o) = self.scene.objects.get_mut(object) else { return };
        if o.q.len() <= slot {
            o.q.resize(slot + 1, 0.0);
        }
        o.q[slot] = q;
        self.place_groups(object);
    }

    /// Puts an object somewhere; it is no longer held.
    pub fn set_pose(&mut self, object: usize, X_WO: &Isometry3<f64>) {
        let Some(o) = self.scene.objects.get_mut(object) else { return };
        o.X_WO = *X_WO;
        o.X_TO = None;
        self.place_groups(object);
    }

    /// Lets the tool hold an object.
    pub fn attach(&mut self, object: usize, X_TO: &Isometry3<f64>) {
        let Some(o) = self.scene.objects.get_mut(object) else { return };
        o.X_TO = Some(*X_TO);
        self.place_groups(object);
    }

    /// Takes an object out of the world: nothing is checked against it.
    pub fn remove(&mut self, object: usize) {
        self.groups.retain(|g| g.object != object);
    }

    /// The gripper's fingers.
    pub fn fingers(&self) -> LinkSet {
        LinkSet(self.robot.iter().enumerate().filter(|(_, l)| l.is_finger).map(|(i, _)| 1 << i).sum())
    }

    /// Everything fixed behind the last joint: hand, fingers, camera.
    pub fn hand(&self) -> LinkSet {
        let last = self.arm.arm_joints();
        LinkSet(self.robot.iter().enumerate().filter(|(_, l)| l.frame == last).map(|(i, _)| 1 << i).sum())
    }

    /// Lets links touch those solids of an object's link that come within `radius` of the line between two points of the
    /// link's frame; all solids of the link if no line is given.
    pub fn allow_touch(&mut self, links: LinkSet, object: usize, link: usize, line: Option<(Point3<f64>, Point3<f64>, f64)>) {
        for g in self.groups.iter_mut().filter(|g| g.object == object && g.link == link) {
            for (i, s) in g.solids.iter().enumerate() {
                if line.is_none_or(|line| near_line(s, &line)) {
                    g.touch[i] |= links.0;
                }
            }
        }
    }

    /// Lets links come as close as [`Self::close_padding`] to an object.
    pub fn allow_close(&mut self, links: LinkSet, object: usize) {
        for g in self.groups.iter_mut().filter(|g| g.object == object) {
            g.close.iter_mut().for_each(|c| *c |= links.0);
        }
    }

    /// Lets links come as close as [`Self::close_padding`] to everything, the table included: a hand at work.
    pub fn allow_close_to_all(&mut self, links: LinkSet) {
        for g in &mut self.groups {
            g.close.iter_mut().for_each(|c| *c |= links.0);
        }
        self.table_close |= links.0;
    }

    /// Takes back all that was allowed.
    pub fn forbid_all(&mut self) {
        for g in &mut self.groups {
            g.touch.fill(0);
            g.close.fill(0);
            g.held_touch.fill(false);
        }
        self.table_held_touch = false;
        self.table_close = 0;
    }

    /// Lets what is held touch those solids (and the table) that are within `tolerance` of it when the tool is at `X_WT`:
    /// what it stands on before it is lifted, or once it is put down.
    pub fn allow_held_support(&mut self, X_WT: &Isometry3<f64>, tolerance: f64) {
        let X_WT = pose(X_WT);
        let held: Vec<(Solid, Pose3)> = self.held_solids(&X_WT);
        for (s, X) in &held {
            if self.lowest(s, X) < self.scene.table_height + tolerance {
                self.table_held_touch = true;
            }
            for g in self.groups.iter_mut().filter(|g| !g.held) {
                for (i, e) in g.solids.iter().enumerate() {
                    let X_WG = g.X * e.X_LG;
                    if ball_near(e, &X_WG, *X * s.center, s.radius + tolerance) && within(s, X, e, &X_WG, tolerance) {
                        g.held_touch[i] = true;
                    }
                }
            }
        }
    }

    fn held_solids(&self, X_WT: &Pose3) -> Vec<(Solid, Pose3)> {
        self.groups.iter().filter(|g| g.held).flat_map(|g| g.solids.iter().map(|s| (s.clone(), *X_WT * g.X * s.X_LG))).collect()
    }

    fn lowest(&self, s: &Solid, X_WG: &Pose3) -> f64 {
        let down = X_WG.rotation.inverse() * -Vec3::Z;
        s.shape.as_support_map().map_or(f64::INFINITY, |m| (*X_WG * m.local_support_point(down)).z)
    }

    /// Would anything touch or come too near, and what? The first such pair, in a fixed order. `q` has the arm's
    /// joints (entries behind them are ignored); `width` is the gripper's opening, m.
    pub fn check(&self, q: &[f64], width: f64) -> Option<Contact> {
        let (links, X_WT) = self.link_poses(q, width);
        self.first_contact(&links, &X_WT, true)
    }

    /// As [`Self::check`], for the hand and what it holds alone with the tool at `X_WT`, whatever the arm does: what this
    /// finds no configuration can avoid.
    pub fn check_hand(&self, X_WT: &Isometry3<f64>, width: f64) -> Option<Contact> {
        let last = self.arm.arm_joints();
        let X_WE = pose(&(X_WT * self.arm.X_ET.inverse()));
        let links: Vec<Option<Pose3>> = self.robot.iter().map(|l| (l.frame == last).then(|| l.pose(X_WE, width))).collect();
        self.first_contact(&links, &pose(X_WT), false)
    }

    fn link_poses(&self, q: &[f64], width: f64) -> (Vec<Option<Pose3>>, Pose3) {
        let mut X_WJ = Vec::with_capacity(self.arm.joints() + 1);
        self.arm.frames(q, &mut X_WJ);
        let last = self.arm.arm_joints();
        (self.robot.iter().map(|l| Some(l.pose(pose(&X_WJ[l.frame.min(last)]), width))).collect(), pose(&(X_WJ[last] * self.arm.X_ET)))
    }

    fn first_contact(&self, links: &[Option<Pose3>], X_WT: &Pose3, itself: bool) -> Option<Contact> {
        let mut found = None;
        self.visit(links, X_WT, 0.0, itself, &mut |a, X_WA, b, X_WB, margin, first, second| {
            let hit = match b {
                Some(b) => within(a, X_WA, b, X_WB, margin),
                None => self.lowest(a, X_WA) < self.scene.table_height + margin,
            };
            if hit {
                found = Some(Contact { first: first.to_owned(), second: second.to_owned() });
            }
            (hit, f64::INFINITY)
        });
        found
    }

    /// Is the configuration free?
    pub fn free(&self, q: &[f64], width: f64) -> bool {
        self.check(q, width).is_none()
    }

    /// The least distance of the robot and what it holds from other things, at most `limit` (more than 0), m; the arm's
    /// distance to itself and pairs that may touch do not count. 0 if something overlaps.
    pub fn clearance(&self, q: &[f64], width: f64, limit: f64) -> f64 {
        let mut least = limit;
        let (links, X_WT) = self.link_poses(q, width);
        self.visit(&links, &X_WT, limit, false, &mut |a, X_WA, b, X_WB, _, _, _| {
            let d = match b {
                Some(b) => distance(a, X_WA, b, X_WB, least),
                None => (self.lowest(a, X_WA) - self.scene.table_height).max(0.0),
            };
            least = least.min(d);
            (least <= 0.0, least)
        });
        least
    }

    /// Hands every pair that the filters leave to `test`, which answers whether to stop, and how near a pair must be to
    /// matter from now on. `b` is `None` for the table.
    #[allow(clippy::type_complexity)]
    fn visit(
        &self,
        links: &[Option<Pose3>],
        X_WT: &Pose3,
        reach: f64,
        itself: bool,
        test: &mut dyn FnMut(&Solid, &Pose3, Option<&Solid>, &Pose3, f64, &str, &str) -> (bool, f64),
    ) {
        let mut reach = reach;
        let held_names = self.groups.iter().enumerate().filter(|(_, g)| g.held);
        let last = self.arm.arm_joints();

        // Moving things one by one: the robot's links, then what is held.
        let movers = (self.robot.iter().zip(links))
            .enumerate()
            .filter_map(|(i, (l, X))| X.map(|X| (Some(i), l.name.as_str(), &l.solids, X, l.center, l.radius, l.frame)))
            .chain(held_names.map(|(_, g)| (None, g.name.as_str(), &g.solids, *X_WT * g.X, g.center, g.radius, last)));
        for (link, name, solids, X_WL, center, radius, frame) in movers {
            let c = X_WL * center;
            // The base stands on the table.
            let table = if link.is_some() { frame > 0 } else { !self.table_held_touch };
            let margin = match link {
                Some(i) if LinkSet(self.table_close).has(i) => self.close_padding,
                Some(_) => self.padding,
                None => 0.5 * self.padding,
            };
            if table && c.z - radius < self.scene.table_height + margin.max(reach) {
                for s in solids.iter() {
                    let X = X_WL * s.X_LG;
                    if (X * s.center).z - s.radius < self.scene.table_height + margin.max(reach) {
                        let (stop, r) = test(s, &X, None, &Pose3::IDENTITY, margin, name, TABLE);
                        if stop {
                            return;
                        }
                        reach = reach.min(r);
                    }
                }
            }
            for g in self.groups.iter().filter(|g| !g.held) {
                let near = radius + g.radius + self.padding.max(reach);
                if (g.X * g.center - c).length_squared() > near * near {
                    continue;
                }
                for (k, e) in g.solids.iter().enumerate() {
                    let margin = match link {
                        Some(i) if LinkSet(g.touch[k]).has(i) => continue,
                        Some(i) if LinkSet(g.close[k]).has(i) => self.close_padding,
                        None if g.held_touch[k] => continue,
                        None => self.close_padding.max(0.5 * self.padding),
                        _ => self.padding,
                    };
                    let X_WG = g.X * e.X_LG;
                    if !ball_near(e, &X_WG, c, radius + margin.max(reach)) {
                        continue;
                    }
                    for s in solids.iter() {
                        let X = X_WL * s.X_LG;
                        if ball_near(e, &X_WG, X * s.center, s.radius + margin.max(reach)) {
                            let (stop, r) = test(s, &X, Some(e), &X_WG, margin, name, &g.name);
                            if stop {
                                return;
                            }
                            reach = reach.min(r);
                        }
                    }
                }
            }
            // What is held against the arm; hand and fingers hold it.
            if link.is_none() {
                for (l, X_WB) in self.robot.iter().zip(links).filter_map(|(l, X)| X.filter(|_| l.frame < last).map(|X| (l, X))) {
                    let near = radius + l.radius + self.self_padding.max(reach);
                    if (X_WB * l.center - c).length_squared() > near * near {
                        continue;
                    }
                    for (s, e) in solids.iter().flat_map(|s| l.solids.iter().map(move |e| (s, e))) {
                        let (X, X_WG) = (X_WL * s.X_LG, X_WB * e.X_LG);
                        if ball_near(e, &X_WG, X * s.center, s.radius + self.self_padding.max(reach)) {
                            let (stop, r) = test(s, &X, Some(e), &X_WG, self.self_padding, name, &l.name);
                            if stop {
                                return;
                            }
                            reach = reach.min(r);
                        }
                    }
                }
            }
        }
        // The arm is never far from itself: only the check asks.
        if !itself {
            return;
        }
        for &(a, b) in &self.pairs {
            let (la, lb) = (&self.robot[a], &self.robot[b]);
            let (Some(X_WA), Some(X_WB)) = (links[a], links[b]) else { continue };
            let near = la.radius + lb.radius + self.self_padding.max(reach);
            if (X_WA * la.center - X_WB * lb.center).length_squared() > near * near {
                continue;
            }
            for (s, e) in la.solids.iter().flat_map(|s| lb.solids.iter().map(move |e| (s, e))) {
                let (X, X_WG) = (X_WA * s.X_LG, X_WB * e.X_LG);
                if ball_near(e, &X_WG, X * s.center, s.radius + self.self_padding.max(reach)) {
                    let (stop, r) = test(s, &X, Some(e), &X_WG, self.self_padding, &la.name, &lb.name);
                    if stop {
                        return;
                    }
                    reach = reach.min(r);
                }
            }
        }
    }

    /// Pairs of the robot's links worth checking: not neighbours along the chain, not fixed together, and not
    /// overlapping at most configurations, which only says that their shapes are rough.
    fn find_self_pairs(&mut self) {
        const SAMPLES: usize = 100;
        let mut random = Pcg64::seed_from_u64(0x5e1f);
        let mut q = vec![0.0; self.arm.joints()];
        let mut X_WJ = Vec::new();
        let mut pairs: Vec<(usize, usize, usize)> = Vec::new();
        for a in 0..self.robot.len() {
            for b in a + 1..self.robot.len() {
                let (fa, fb) = (self.robot[a].frame, self.robot[b].frame);
                if fa.abs_diff(fb) > 1 && !self.robot[a].solids.is_empty() && !self.robot[b].solids.is_empty() {
                    pairs.push((a, b, 0));
                }
            }
        }
        for _ in 0..SAMPLES {
            let arm = self.arm.clone();
            arm.random_configuration(&mut random, &arm.lower, &arm.upper, &mut q);
            arm.frames(&q, &mut X_WJ);
            for (a, b, hits) in &mut pairs {
                let (la, lb) = (&self.robot[*a], &self.robot[*b]);
                let (Xa, Xb) = (pose(&X_WJ[la.frame]) * la.X_FL, pose(&X_WJ[lb.frame]) * lb.X_FL);
                let hit = (la.solids.iter())
                    .flat_map(|s| lb.solids.iter().map(move |e| (s, e)))
                    .any(|(s, e)| within(s, &(Xa * s.X_LG), e, &(Xb * e.X_LG), self.self_padding));
                *hits += usize::from(hit);
            }
        }
        // Two joints apart, the joints' own limits keep real links from one another; often overlapping shapes are rough.
        let limit =
            |a: usize, b: usize| if self.robot[a].frame.abs_diff(self.robot[b].frame) == 2 { SAMPLES / 10 } else { SAMPLES * 9 / 10 };
        self.pairs = pairs.into_iter().filter(|(a, b, hits)| *hits < limit(*a, *b)).map(|(a, b, _)| (a, b)).collect();
    }
}

fn near_line(s: &Solid, (from, to, radius): &(Point3<f64>, Point3<f64>, f64)) -> bool {
    let segment = Segment::new(vector(&from.coords), vector(&to.coords));
    let line = solid(SharedShape::new(segment), Pose3::IDENTITY);
    within(s, &s.X_LG, &line, &Pose3::IDENTITY, radius.max(1e-6))
}

fn robot_links(model: &ObjectModel) -> Result<Vec<RobotLink>, PlanError> {
    let lacks = |message: String| PlanError::ModelLacks { model: model.name.clone(), message };
    let section = model.document.robot.as_ref().ok_or_else(|| lacks("has no `robot` section in model.yaml; it is not an arm".into()))?;
    // Frame and pose in it of every link, parents first; how a finger joint moves it.
    let mut frame = vec![0; model.links.len()];
    let mut X_FL = vec![Isometry3::identity(); model.links.len()];
    let mut finger = vec![nalgebra::Vector3::zeros(); model.links.len()];
    let mut is_finger = vec![false; model.links.len()];
    for joint in &model.joints {
        let (p, c) = (joint.parent, joint.child);
        finger[c] = finger[p];
        is_finger[c] = is_finger[p];
        if let Some(i) = section.arm_joints.iter().position(|n| *n == joint.name) {
            frame[c] = i + 1;
            X_FL[c] = Isometry3::identity();
            continue;
        }
        frame[c] = frame[p];
        X_FL[c] = X_FL[p] * joint.X_PJ;
        if let Some(f) = section.gripper.fingers.iter().find(|f| f.joint == joint.name) {
            if joint.kind != JointKind::Prismatic {
                return Err(lacks(format!("finger joint '{}' does not slide; only parallel grippers are planned with", f.joint)));
            }
            finger[c] += X_FL[c].rotation * joint.axis.into_inner() * 0.5;
            is_finger[c] = true;
        }
    }
    let links = model
        .links
        .iter()
        .enumerate()
        .filter(|(_, l)| !l.collisions.is_empty())
        .map(|(i, l)| {
            let solids = solids(&l.collisions, &model.name)?;
            let (center, radius) = bound(&solids);
            Ok(RobotLink {
                name: l.name.clone(),
                frame: frame[i],
                X_FL: pose(&X_FL[i]),
                finger: vector(&finger[i]),
                is_finger: is_finger[i],
                solids: Arc::new(solids),
                center,
                radius,
            })
        })
        .collect::<Result<Vec<_>, PlanError>>()?;
    if links.len() > 128 {
        return Err(lacks(format!("has {} links with collision shapes; at most 128 can be planned with", links.len())));
    }
    Ok(links)
}
