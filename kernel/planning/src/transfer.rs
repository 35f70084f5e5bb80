//! Pick and place, chosen together: a grasp that cannot put the object down is no grasp.
//!
//! Every grasp of the object's hints (with its lean or swing drawn at a few values, for in the hand it is fixed) is tried
//! for the pick: way in, grasp, lift. Those that pass are tried on poses drawn from the destination: the object
//! upright, turned so that the hand points into the opening, spread over the free floor; way in through the opening,
//! lowering, letting go, way out. Cheap tests come first: inverse kinematics and collisions at the key poses.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::{Geometry, ObjectModel, Region};

use crate::inverse::InverseOptions;
use crate::path::{PathOptions, ToolPath, Waypoint, arm_path, straight_line};
use crate::{CollisionWorld, Contact, Grasp, GraspOptions, PlanError, Scene, grasps};

/// Where an object is to be put.
#[derive(Debug, Clone)]
pub enum Destination {
    /// In a region of an object, by its index in the scene and its region's index.
    Region {
        /// Index of the object in the scene.
        object: usize,
        /// Index of the region in its model.
        region: usize,
    },
    /// On the table, at x, y in the world, m.
    Table {
        /// Position.
        at: [f64; 2],
    },
}

/// How transfers are searched.
#[derive(Debug, Clone)]
pub struct TransferOptions {
    /// Seed of every random choice.
    pub seed: u64,
    /// Plans wanted, best first.
    pub plans: usize,
    /// Way in and out along the tool's axis, m.
    pub standoff: f64,
    /// Height of the lift, m; more where it stands in something.
    pub lift: f64,
    /// Height above its place at which the object comes in, m.
    pub drop: f64,
    /// Distance from the walls of a region, m.
    pub wall: f64,
    /// Values of a grasp's lean or swing that are tried.
    pub leans: usize,
    /// Complete searches of a path that may be spent on pick and on place each.
    pub attempts: usize,
    /// How the object must stand: up in its own frame.
    pub up: Vector3<f64>,
}

impl Default for TransferOptions {
    fn default() -> Self {
        Self { seed: 0, plans: 1, standoff: 0.08, lift: 0.12, drop: 0.02, wall: 0.015, leans: 5, attempts: 24, up: Vector3::z() }
    }
}

/// Taking an object.
#[derive(Debug, Clone)]
pub struct PickPlan {
    /// The grasp.
    pub grasp: Grasp,
    /// Its lean or swing, rad.
    pub freedom: f64,
    /// Pose of the object in the hand.
    pub X_TO: Isometry3<f64>,
    /// From the pre-grasp to the grasp, gripper open by `grasp.width`.
    pub approach: Vec<Vec<f64>>,
    /// From the grasp upward, with the object.
    pub lift: Vec<Vec<f64>>,
    /// How it would be put down, if a destination was given.
    pub place: Option<PlacePlan>,
    /// Lower is better.
    pub score: f64,
}

/// Putting an object down.
#[derive(Debug, Clone)]
pub struct PlacePlan {
    /// Where the object will be.
    pub X_WO: Isometry3<f64>,
    /// Through the opening and down, with the object.
    pub insert: Vec<Vec<f64>>,
    /// Back out, gripper open by `width`.
    pub retreat: Vec<Vec<f64>>,
    /// Opening of the gripper when it has let go, m.
    pub width: f64,
    /// Lower is better.
    pub score: f64,
}

/// Box around a model's collision shapes in its root link's frame, joints at `q`: least and greatest corner.
pub fn extents(model: &ObjectModel, q: &[f64]) -> (Vector3<f64>, Vector3<f64>) {
    let X_OL = model.X_OL(q);
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = Vector3::repeat(f64::NEG_INFINITY);
    let mut grow = |p: &Vector3<f64>, reach: &Vector3<f64>| {
        low = low.inf(&(p - reach));
        high = high.sup(&(p + reach));
    };
    for (link, X_OL) in model.links.iter().zip(&X_OL) {
        for shape in &link.collisions {
            let X = X_OL * shape.X_LG;
            let (p, R) = (X.translation.vector, X.rotation.to_rotation_matrix().matrix().abs());
            match &shape.geometry {
                Geometry::Box { half_extents } => grow(&p, &(R * half_extents)),
                Geometry::Sphere { radius } => grow(&p, &Vector3::repeat(*radius)),
                Geometry::Capsule { radius, half_length } => grow(&p, &(R.column(2) * *half_length + Vector3::repeat(*radius))),
                Geometry::Cylinder { radius, half_length } => {
                    // A disc of normal n reaches r sqrt(1 - n_i^2) along axis i.
                    let n = R.column(2).into_owned();
                    grow(&p, &(n * *half_length + n.map(|c| radius * (1.0 - c * c).max(0.0).sqrt())));
                }
                Geometry::Mesh { mesh, .. } => mesh.vertices.iter().for_each(|v| grow(&(X * v).coords, &Vector3::zeros())),
            }
        }
    }
    if low.x > high.x { (Vector3::zeros(), Vector3::zeros()) } else { (low, high) }
}

/// A grasp with its freedom fixed.
#[derive(Clone)]
struct Held {
    grasp: Grasp,
    freedom: f64,
    X_TO: Isometry3<f64>,
    quality: f64,
}

/// Plans to take an object, and to put it down where a destination is given. Best first, at least one.
///
/// # Errors
/// Of the candidate that came furthest, with its stage (`pick approach`, `lift`, `insert`, `place`, `retreat`);
/// [`PlanError::ModelLacks`] without a grasp hint; [`PlanError::Cancelled`].
pub fn plan_pick(
    scene: &Scene,
    world: &CollisionWorld,
    object: usize,
    q_start: &[f64],
    destination: Option<&Destination>,
    options: &TransferOptions,
    cancelled: &dyn Fn() -> bool,
) -> Result<Vec<PickPlan>, PlanError> {
    let o = scene.objects.get(object).ok_or_else(|| PlanError::BadInput { message: "no such object in the scene".into() })?;
    let robot = scene
        .robot
        .document
        .robot
        .as_ref()
        .ok_or_else(|| PlanError::ModelLacks { model: scene.robot.name.clone(), message: "has no `robot` section".into() })?;
    let arm = world.arm();
    let all = grasps(&o.model, None, &robot.gripper, &GraspOptions::default())?;
    let mut held = fixed_grasps(&o.model, &o.q, &all, options);

    let mut near = world.clone();
    near.allow_close_to_all(near.hand());
    let mut failures = Failures::default();

    // Cheap: reach and collisions at the grasp and before it.
    let mut reachable: Vec<(Held, Vec<Vec<f64>>)> = Vec::new();
    let quick = InverseOptions {
        starts: 6,
        solutions: 3,
        margin: 0.05,
        tolerance: 1e-6,
        steps: 50,
        seed: options.seed,
        ..InverseOptions::default()
    };
    // A hand that comes from below or far round the back is not worth a search.
    held.retain(|h| (o.X_WO * h.X_TO.inverse()).rotation.transform_vector(&Vector3::z()).z < 0.3);
    for h in held {
        if cancelled() {
            return Err(PlanError::Cancelled { stage: "pick".into() });
        }
        let X_WT = o.X_WO * h.X_TO.inverse();
        let back = X_WT * Translation3::new(0.0, 0.0, -options.standoff);
        if let Some(c) = near.check_hand(&X_WT, h.grasp.width).or_else(|| near.check_hand(&back, h.grasp.width)) {
            failures.add_contact(0, "pick", Some(c), &at(&X_WT, "the grasp"));
            continue;
        }
        let solutions = arm.inverse(&X_WT, &[q_start.to_vec()], &quick);
        if solutions.is_empty() {
            failures.add(0, PlanError::Unreachable { stage: "pick".into(), message: at(&X_WT, "the grasp") });
            continue;
        }
        let mut contact = None;
        let free: Vec<Vec<f64>> = solutions
            .into_iter()
            .filter(|q| {
                let c = near.check(q, h.grasp.width);
                let free = c.is_none();
                contact = contact.take().or(c);
                free
            })
            .collect();
        if free.is_empty() {
            failures.add_contact(1, "pick", contact, &at(&X_WT, "the grasp"));
            continue;
        }
        reachable.push((h, free));
        if reachable.len() >= 4 * options.attempts {
            break;
        }
    }
    // What stands in the destination's favour is found out before the pick is planned in full.
    let mut plans: Vec<PickPlan> = Vec::new();
    let mut spent = 0;
    for (number, (h, starts)) in reachable.iter().enumerate() {
        if cancelled() {
            return Err(PlanError::Cancelled { stage: "pick".into() });
        }
        if spent >= options.attempts {
            break;
        }
        let place = match destination {
            None => None,
            Some(destination) => {
                let mut holding = world.clone();
                holding.attach(object, &h.X_TO);
                let one = TransferOptions { plans: 1, attempts: 3, seed: options.seed.wrapping_add(number as u64), ..options.clone() };
                match place_held(scene, &holding, object, h, starts.first().map_or(q_start, |q| q), destination, &one, cancelled) {
                    Ok(mut places) => {
                        spent += 1;
                        Some(places.swap_remove(0))
                    }
                    Err((_, e @ PlanError::Cancelled { .. })) => return Err(e),
                    Err((rank, e)) => {
                        spent += usize::from(rank > 2);
                        failures.add(4 + rank, e);
                        continue;
                    }
                }
            }
        };
        spent += 1;
        // Straight up; or out from under what overhangs.
        let slopes = [[0.0, 0.0], [-0.3, 0.0], [0.3, 0.0], [0.0, 0.3], [0.0, -0.3]];
        let mut found = Err(PlanError::Unreachable { stage: "lift".into(), message: String::new() });
        for slope in slopes {
            let rise = Vector3::new(slope[0], slope[1], 1.0) * options.lift;
            found = pick_path(scene, world, &near, object, h, starts, &rise, options, number as u64, cancelled);
            if !found.as_ref().is_err_and(|e| e.stage() == "lift" && matches!(e, PlanError::Collision { .. })) {
                break;
            }
        }
        match found {
            Ok((approach, lift, cost)) => {
                let score = cost + place.as_ref().map_or(0.0, |p| p.score) + 2.0 * (1.0 - h.quality);
                plans.push(PickPlan { grasp: h.grasp.clone(), freedom: h.freedom, X_TO: h.X_TO, approach, lift, place, score });
            }
            Err(e @ PlanError::Cancelled { .. }) => return Err(e),
            Err(e) => failures.add(3, e),
        }
        if plans.len() > options.plans {
            break;
        }
    }
    if plans.is_empty() {
        return Err(failures.into_error("pick"));
    }
    plans.sort_by(|a, b| a.score.total_cmp(&b.score));
    plans.truncate(options.plans.max(1));
    Ok(plans)
}

/// Plans to put down what is held (the scene says how). Best first, at least one. `width` is the gripper's opening
/// while it holds.
///
/// # Errors
/// As [`plan_pick`]; [`PlanError::BadInput`] if the object is not held.
#[allow(clippy::too_many_arguments)]
pub fn plan_place(
    scene: &Scene,
    world: &CollisionWorld,
    object: usize,
    width: f64,
    q_start: &[f64],
    destination: &Destination,
    options: &TransferOptions,
    cancelled: &dyn Fn() -> bool,
) -> Result<Vec<PlacePlan>, PlanError> {
    let o = scene.objects.get(object).ok_or_else(|| PlanError::BadInput { message: "no such object in the scene".into() })?;
    let X_TO = o.X_TO.ok_or_else(|| PlanError::BadInput { message: format!("'{}' is not held", o.name) })?;
    let max_width = scene.robot.document.robot.as_ref().map_or(width, |r| r.gripper.max_width);
    let grasp = Grasp {
        name: String::from("held"),
        link: 0,
        X_LF: X_TO.inverse(),
        X_FT: Isometry3::identity(),
        axis: Vector3::y_axis(),
        range: [0.0, 0.0],
        width: (width + 0.03).min(max_width),
        hold_width: width,
        held_part: None,
        quality: 1.0,
    };
    let held = Held { grasp, freedom: 0.0, X_TO, quality: 1.0 };
    place_held(scene, world, object, &held, q_start, destination, options, cancelled).map_err(|(_, e)| e)
}

fn at(X_WT: &Isometry3<f64>, what: &str) -> String {
    let p = X_WT.translation.vector;
    format!("no way to reach {what} at ({:.2}, {:.2}, {:.2}) m", p.x, p.y, p.z)
}

/// Remembers the failure that came furthest, and how many there were.
#[derive(Default)]
struct Failures {
    worst: Option<(usize, PlanError)>,
    count: usize,
}

impl Failures {
    fn add(&mut self, rank: usize, e: PlanError) {
        self.count += 1;
        if self.worst.as_ref().is_none_or(|(r, _)| rank > *r) {
            self.worst = Some((rank, e));
        }
    }

    fn add_contact(&mut self, rank: usize, stage: &str, contact: Option<Contact>, message: &str) {
        let c = contact.unwrap_or(Contact { first: "arm".into(), second: "something".into() });
        self.add(rank, PlanError::Collision { stage: stage.into(), first: c.first, second: c.second, message: message.into() });
    }

    fn into_error(self, stage: &str) -> PlanError {
        match self.worst {
            None => PlanError::Unreachable { stage: stage.into(), message: "no grasp comes from a side that the arm can come from".into() },
            Some((_, mut e)) => {
                if let PlanError::Unreachable { message, .. } | PlanError::Collision { message, .. } | PlanError::TooWeak { message, .. } =
                    &mut e
                {
                    message.push_str(&format!(" ({} candidates failed; this one came furthest)", self.count));
                }
                e
            }
        }
    }
}

fn fixed_grasps(model: &ObjectModel, q: &[f64], all: &[Grasp], options: &TransferOptions) -> Vec<Held> {
    let mut held = Vec::new();
    let leans = options.leans.max(1);
    for grasp in all {
        for k in 0..leans {
            let f = if leans == 1 { 0.0 } else { 2.0 * k as f64 / (leans - 1) as f64 - 1.0 };
            let freedom = if f < 0.0 { -f * grasp.range[0] } else { f * grasp.range[1] };
            if k > 0 && grasp.range[1] - grasp.range[0] < 1e-6 {
                continue;
            }
            held.push(Held { grasp: grasp.clone(), freedom, X_TO: grasp.X_TO(model, q, freedom), quality: grasp.quality - 0.1 * f.abs() });
        }
    }
    held.sort_by(|a, b| b.quality.total_cmp(&a.quality));
    // Neighbours are alike: go through them in a scattered but fixed order, so that few tries see much.
    let mut random = Pcg64::seed_from_u64(options.seed ^ 0x67a5);
    for i in (1..held.len()).rev() {
        let j = (random.random::<f64>() * (i + 1) as f64) as usize;
        held.swap(i, j.min(i));
    }
    held
}

/// Joint path from the pre-grasp to the grasp and up.
#[allow(clippy::too_many_arguments, clippy::type_complexity)]
fn pick_path(
    scene: &Scene,
    world: &CollisionWorld,
    near: &CollisionWorld,
    object: usize,
    h: &Held,
    starts: &[Vec<f64>],
    rise: &Vector3<f64>,
    options: &TransferOptions,
    number: u64,
    cancelled: &dyn Fn() -> bool,
) -> Result<(Vec<Vec<f64>>, Vec<Vec<f64>>, f64), PlanError> {
    let o = &scene.objects[object];
    let X_WT = o.X_WO * h.X_TO.inverse();
    let back = X_WT * Translation3::new(0.0, 0.0, -options.standoff);
    let up = Translation3::from(*rise) * X_WT;
    let mut waypoints: Vec<Waypoint> =
        straight_line(&back, &X_WT, 0.02, 0.1).into_iter().map(|goal| Waypoint { goal, chain: 0, stage: 0 }).collect();
    let grasp_at = waypoints.len() - 1;
    waypoints.extend(straight_line(&X_WT, &up, 0.02, 0.1).into_iter().skip(1).map(|goal| Waypoint { goal, chain: 0, stage: 1 }));
    let path = ToolPath { chains: vec![world.arm().clone()], waypoints, stages: vec!["pick approach".into(), "lift".into()] };
    let mut lifting = near.clone();
    lifting.attach(object, &h.X_TO);
    lifting.allow_held_support(&X_WT, 0.01);
    let mut check = |i: usize, q: &[f64]| {
        if i <= grasp_at { near.check(q, h.grasp.width) } else { lifting.check(q, h.grasp.hold_width) }
    };
    let options = PathOptions { seed: options.seed.wrapping_add(number), anchors: 2, starts: 8, nodes: 16, ..PathOptions::default() };
    let found = arm_path(&path, starts, &mut check, &options, cancelled)?;
    let mut approach = found.q;
    let mut lift = approach.split_off(grasp_at + 1);
    lift.insert(0, approach[grasp_at].clone());
    Ok((approach, lift, found.cost))
}

/// A free floor with an opening, in the world.
struct Floor {
    X_WB: Isometry3<f64>,
    half: Vector3<f64>,
    opening: Vector3<f64>,
    /// Object of the scene that it belongs to.
    owner: Option<usize>,
}

fn floor_of(scene: &Scene, destination: &Destination) -> Result<Floor, PlanError> {
    match destination {
        Destination::Table { at } => Ok(Floor {
            X_WB: Isometry3::translation(at[0], at[1], scene.table_height + 0.5),
            half: Vector3::new(0.03, 0.03, 0.5),
            opening: Vector3::z(),
            owner: None,
        }),
        Destination::Region { object, region } => {
            let o = scene.objects.get(*object).ok_or_else(|| PlanError::BadInput { message: "no such object in the scene".into() })?;
            let lacks = |message: String| PlanError::ModelLacks { model: o.model.name.clone(), message };
            let r: &Region = o.model.document.regions.get(*region).ok_or_else(|| lacks(format!("has no region number {region}")))?;
            let link =
                o.model.link(&r.link).ok_or_else(|| lacks(format!("region '{}' is on link '{}', which is not there", r.name, r.link)))?;
            let X_WL = o.X_WO * o.model.X_OL(&o.q)[link];
            let opening = X_WL.rotation * Vector3::from(r.opening);
            Ok(Floor {
                X_WB: X_WL * Translation3::from(Point3::from(r.center).coords),
                half: Vector3::from(r.size) * 0.5,
                opening: opening.normalize(),
                owner: Some(*object),
            })
        }
    }
}

/// Poses of an object upright on a floor, best first.
fn place_poses(
    scene: &Scene,
    object: usize,
    floor: &Floor,
    z_OT: &Vector3<f64>,
    options: &TransferOptions,
    random: &mut Pcg64,
) -> Result<Vec<Isometry3<f64>>, PlanError> {
    let o = &scene.objects[object];
    let (low, high) = extents(&o.model, &o.q);
    // Upright: the object's own up along the world's.
    let upright = UnitQuaternion::rotation_between(&options.up, &Vector3::z()).unwrap_or_else(UnitQuaternion::identity);
    let (low_w, height) = {
        let corners: Vec<Vector3<f64>> = (0..8)
            .map(|i| {
                upright
                    * Vector3::new(
                        if i & 1 == 0 { low.x } else { high.x },
                        if i & 2 == 0 { low.y } else { high.y },
                        if i & 4 == 0 { low.z } else { high.z },
                    )
            })
            .collect();
        let least = corners.iter().map(|c| c.z).fold(f64::INFINITY, f64::min);
        let most = corners.iter().map(|c| c.z).fold(f64::NEG_INFINITY, f64::max);
        (least, most - least)
    };
    let floor_z = floor.X_WB.translation.vector.z - floor.half.z;
    let sideways = Vector3::new(floor.opening.x, floor.opening.y, 0.0);
    let side_opening = floor.opening.z.abs() < 0.7;
    if side_opening && height + options.drop > 2.0 * floor.half.z {
        return Err(PlanError::Unreachable {
            stage: "place".into(),
            message: format!("'{}' is {:.0} mm high, the place only {:.0} mm", o.name, 1e3 * height, 2e3 * floor.half.z),
        });
    }
    // Turned so that the hand points into the opening; all ways round where it points down or the opening is above.
    let hand = upright * z_OT;
    let hand_flat = Vector3::new(hand.x, hand.y, 0.0);
    let mut yaws: Vec<(f64, f64)> = Vec::new();
    if side_opening && hand_flat.norm() > 0.15 {
        let toward = (-sideways.y).atan2(-sideways.x) - hand_flat.y.atan2(hand_flat.x);
        for d in [0.0, 0.3, -0.3, 0.6, -0.6] {
            yaws.push((toward + d, f64::abs(d)));
        }
    } else {
        let first = random.random::<f64>() * std::f64::consts::TAU;
        yaws.extend((0..6).map(|k| (first + k as f64 * std::f64::consts::TAU / 6.0, 0.0)));
    }
    let mut poses: Vec<(f64, Isometry3<f64>)> = Vec::new();
    for (yaw, yaw_cost) in yaws {
        let R = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * upright;
        // Extents in the region's axes.
        let in_box = floor.X_WB.rotation.inverse() * R;
        let mut least = Vector3::repeat(f64::INFINITY);
        let mut most = Vector3::repeat(f64::NEG_INFINITY);
        for i in 0..8 {
            let c = in_box
                * Vector3::new(
                    if i & 1 == 0 { low.x } else { high.x },
                    if i & 2 == 0 { low.y } else { high.y },
                    if i & 4 == 0 { low.z } else { high.z },
                );
            least = least.inf(&c);
            most = most.sup(&c);
        }
        // The origin's range in the box, so that all of the object is inside.
        let (from, to) = if floor.owner.is_some() {
            (-floor.half - least + Vector3::repeat(options.wall), floor.half - most - Vector3::repeat(options.wall))
        } else {
            (-floor.half, floor.half)
        };
        if from.x > to.x || from.y > to.y {
            continue;
        }
        for fx in [0.5, 0.25, 0.75, 0.05, 0.95] {
            for fy in [0.5, 0.25, 0.75, 0.05, 0.95] {
                let p = Vector3::new(from.x + fx * (to.x - from.x), from.y + fy * (to.y - from.y), 0.0);
                let mut p_W = floor.X_WB * Point3::from(p);
                p_W.z = floor_z - low_w + 0.001;
                let X = Isometry3::from_parts(p_W.coords.into(), R);
                // Toward a side opening there is more room for the arm; across it, and below one above, in the middle.
                let o = floor.X_WB.rotation.inverse() * sideways;
                let inward =
                    (0.5 - (fx - 0.5) * o.x.signum() * f64::from(o.x.abs() > 0.5) - (fy - 0.5) * o.y.signum() * f64::from(o.y.abs() > 0.5))
                        .max(0.0);
                let across = f64::abs(fx - 0.5) * (1.0 - o.x.abs()) + f64::abs(fy - 0.5) * (1.0 - o.y.abs());
                let cost = if side_opening { 1.5 * inward + across } else { across };
                poses.push((0.5 * yaw_cost + cost + 0.2 * random.random::<f64>(), X));
            }
        }
    }
    if poses.is_empty() {
        return Err(PlanError::Unreachable { stage: "place".into(), message: format!("'{}' does not fit into the place", o.name) });
    }
    poses.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(poses.into_iter().map(|p| p.1).collect())
}

#[allow(clippy::too_many_arguments)]
fn place_held(
    scene: &Scene,
    world: &CollisionWorld,
    object: usize,
    h: &Held,
    q_start: &[f64],
    destination: &Destination,
    options: &TransferOptions,
    cancelled: &dyn Fn() -> bool,
) -> Result<Vec<PlacePlan>, (usize, PlanError)> {
    let arm = world.arm();
    let o = &scene.objects[object];
    let floor = floor_of(scene, destination).map_err(|e| (0, e))?;
    let mut random = Pcg64::seed_from_u64(options.seed);
    let X_OT = h.X_TO.inverse();
    let z_OT = X_OT.rotation * Vector3::z();
    // The hand must not come from inside.
    let poses = place_poses(scene, object, &floor, &z_OT, options, &mut random).map_err(|e| (0, e))?;
    let (low, high) = extents(&o.model, &o.q);
    let size = (high - low).norm();
    let up = Vector3::z() * options.drop;
    // How far out along the opening until the object is clear of it.
    let in_box = (floor.X_WB.rotation.inverse() * floor.opening).abs();
    let depth = floor.half.dot(&in_box);

    let mut near = world.clone();
    near.allow_close_to_all(near.hand());
    let quick = InverseOptions {
        starts: 5,
        solutions: 3,
        margin: 0.05,
        tolerance: 1e-6,
        steps: 50,
        seed: options.seed,
        ..InverseOptions::default()
    };
    let mut failures = Failures::default();
    let mut plans: Vec<PlacePlan> = Vec::new();
    let mut spent = 0;
    let mut looked = 0;
    let mut checked = 0;
    for X_WO in poses {
        if cancelled() {
            return Err((9, PlanError::Cancelled { stage: "place".into() }));
        }
        if spent >= options.attempts || looked >= 20 * options.attempts || checked >= 100 * options.attempts {
            break;
        }
        let X_WT = X_WO * X_OT;
        let z = X_WT.rotation * Vector3::z();
        // From below, or from the far side of a side opening.
        if z.z > 0.3 || z.dot(&floor.opening) > 0.3 {
            failures.add(0, PlanError::Unreachable { stage: "place".into(), message: "the hand would come from the wrong side".into() });
            continue;
        }
        let mut holding = near.clone();
        holding.allow_held_support(&X_WT, 0.006);
        let mut empty = near.clone();
        empty.set_pose(object, &X_WO);

        checked += 1;
        if let Some(c) = holding.check_hand(&X_WT, h.grasp.hold_width).or_else(|| empty.check_hand(&X_WT, h.grasp.width)) {
            failures.add_contact(0, "place", Some(c), &at(&X_WT, "the place"));
            continue;
        }
        looked += 1;
        let solutions = arm.inverse(&X_WT, &[q_start.to_vec()], &quick);
        if solutions.is_empty() {
            failures.add(1, PlanError::Unreachable { stage: "place".into(), message: at(&X_WT, "the place") });
            continue;
        }
        let mut contact = None;
        let free: Vec<Vec<f64>> = solutions
            .into_iter()
            .filter(|q| {
                let c = holding.check(q, h.grasp.hold_width).or_else(|| empty.check(q, h.grasp.width));
                let free = c.is_none();
                contact = contact.take().or(c);
                free
            })
            .collect();
        if free.is_empty() {
            failures.add_contact(2, "place", contact, &at(&X_WT, "the place"));
            continue;
        }
        // Way in: outside, above the place, down; way out: back along the tool, then out of the opening.
        let side = floor.opening.z.abs() < 0.7;
        let inside = (X_WO.translation.vector - floor.X_WB.translation.vector).dot(&floor.opening);
        let out = if floor.owner.is_some() { (depth - inside + 0.6 * size + 0.03).max(0.05) } else { 0.1 };
        let lifted = |X: &Isometry3<f64>| Translation3::from(up) * X;
        let outside = |X: &Isometry3<f64>| Translation3::from(floor.opening * out) * X;
        let above = lifted(&X_WT);
        let before = if side { outside(&above) } else { outside(&X_WT) };
        let mut waypoints: Vec<Waypoint> = Vec::new();
        let mut add = |from: &Isometry3<f64>, to: &Isometry3<f64>, stage: usize| {
            let skip = usize::from(!waypoints.is_empty());
            waypoints.extend(straight_line(from, to, 0.02, 0.1).into_iter().skip(skip).map(|goal| Waypoint { goal, chain: 0, stage }));
            waypoints.len() - 1
        };
        add(&before, &above, 0);
        let down_at = add(&above, &X_WT, 1);
        let back = X_WT * Translation3::new(0.0, 0.0, -options.standoff);
        add(&X_WT, &back, 2);
        if side {
            let way_out = Translation3::from(floor.opening * (out - options.standoff).max(0.05)) * back;
            add(&back, &way_out, 2);
        }
        let path = ToolPath { chains: vec![arm.clone()], waypoints, stages: vec!["insert".into(), "place".into(), "retreat".into()] };
        let stages: Vec<usize> = path.waypoints.iter().map(|w| w.stage).collect();
        // The support may be touched only when lowering; on the way in the object stays clear of it.
        let mut check = |i: usize, q: &[f64]| match stages[i] {
            0 => near.check(q, h.grasp.hold_width),
            1 => holding.check(q, h.grasp.hold_width),
            _ => empty.check(q, h.grasp.width),
        };
        spent += 1;
        let path_options = PathOptions {
            seed: options.seed.wrapping_add(looked as u64),
            anchors: 3,
            starts: 10,
            nodes: 16,
            start_near: Some(q_start.to_vec()),
            ..PathOptions::default()
        };
        match arm_path(&path, &free, &mut check, &path_options, cancelled) {
            Ok(found) => {
                let mut insert = found.q;
                let mut retreat = insert.split_off(down_at + 1);
                retreat.insert(0, insert[down_at].clone());
                plans.push(PlacePlan { X_WO, insert, retreat, width: h.grasp.width, score: found.cost });
            }
            Err(e @ PlanError::Cancelled { .. }) => return Err((9, e)),
            Err(e) => failures.add(3, e),
        }
        if plans.len() >= options.plans.max(1) {
            break;
        }
    }
    if plans.is_empty() {
        let rank = failures.worst.as_ref().map_or(0, |w| w.0);
        return Err((rank, failures.into_error("place")));
    }
    plans.sort_by(|a, b| a.score.total_cmp(&b.score));
    Ok(plans)
}
