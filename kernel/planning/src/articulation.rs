//! The second level of a plan: which grasp on a moving part, and which way of the arm, carry the object's motion out.
//!
//! A grasp is judged over the **whole** path of the joint: reach and collisions with the part moving along, the way in
//! before and the way out after, the torque that the object's effort u* asks of the arm, nearness to limits and to
//! singular poses. The grip's turn about a bar is left free all the way (a joint of the path search like any other).

use nalgebra::{Isometry3, Vector6};
use sagci_dynamics::{Multibody, Part, System};
use sagci_model::{JointKind, ObjectModel};

use crate::inverse::InverseOptions;
use crate::object_motion::{JointDynamics, ObjectMotionOptions, ObjectTrajectory, object_motion};
use crate::path::{PathOptions, ToolPath, Waypoint, arm_path};
use crate::{ArmKinematics, CollisionWorld, Contact, Grasp, GraspOptions, PlanError, Scene, grasps};

/// What is asked for: one joint of an object from where it is to somewhere else.
#[derive(Debug, Clone)]
pub struct ArticulationRequest {
    /// Index of the object in the scene.
    pub object: usize,
    /// Which of its moving joints.
    pub joint: usize,
    /// Position to begin at, rad or m.
    pub from: f64,
    /// Position to end at.
    pub to: f64,
    /// Where the arm is: plans that begin near cost less.
    pub q_start: Vec<f64>,
    /// How the object should move.
    pub motion: ObjectMotionOptions,
    /// Way in and out along the tool's axis, m.
    pub standoff: f64,
    /// Grasps that are looked at, at most.
    pub grasps: usize,
    /// Plans wanted, best first.
    pub plans: usize,
    /// How paths are searched; its seed and start are set from here.
    pub search: PathOptions,
    /// Seed of every random choice.
    pub seed: u64,
}

impl ArticulationRequest {
    /// With the usual settings.
    pub fn new(object: usize, joint: usize, from: f64, to: f64, q_start: &[f64]) -> Self {
        Self {
            object,
            joint,
            from,
            to,
            q_start: q_start.to_vec(),
            motion: ObjectMotionOptions::default(),
            standoff: 0.1,
            grasps: 30,
            plans: 1,
            search: PathOptions::default(),
            seed: 0,
        }
    }
}

/// How the arm moves the joint.
#[derive(Debug, Clone)]
pub struct ArticulationPlan {
    /// The grasp.
    pub grasp: Grasp,
    /// From the pre-grasp to the grasp, gripper open by `grasp.width`.
    pub approach: Vec<Vec<f64>>,
    /// Along the joint's motion, gripper shut on the handle.
    pub path: Vec<Vec<f64>>,
    /// Position of the joint at each point of `path`.
    pub joint: Vec<f64>,
    /// The grip's freedom at each point of `path`, rad.
    pub freedom: Vec<f64>,
    /// Pose of the tool at each point of `path`.
    pub X_WT: Vec<Isometry3<f64>>,
    /// From the grasp back to clear space, gripper open by `grasp.width`.
    pub retreat: Vec<Vec<f64>>,
    /// The object's own plan.
    pub object: ObjectTrajectory,
    /// Greatest share of a joint's effort that gravity and u* take.
    pub load: f64,
    /// Lower is better.
    pub score: f64,
}

impl ArticulationPlan {
    /// Arm configuration for a position of the joint, by linear interpolation between the path's points.
    pub fn q_at(&self, joint: f64) -> Vec<f64> {
        let n = self.joint.len();
        if n < 2 {
            return self.path.first().cloned().unwrap_or_default();
        }
        let forward = self.joint[n - 1] >= self.joint[0];
        let k = self.joint.partition_point(|x| if forward { *x <= joint } else { *x >= joint }).clamp(1, n - 1);
        let f = ((joint - self.joint[k - 1]) / (self.joint[k] - self.joint[k - 1])).clamp(0.0, 1.0);
        self.path[k - 1].iter().zip(&self.path[k]).map(|(a, b)| a + f * (b - a)).collect()
    }

    /// Pose of the tool for a position of the joint.
    pub fn X_WT_at(&self, arm: &ArmKinematics, joint: f64) -> Isometry3<f64> {
        arm.X_WT(&self.q_at(joint))
    }
}

/// Effort of one joint of a standing object at (q, v, a), its other joints at `q_other`: inverse dynamics of its
/// multibody, with damping, dry friction and effects.
///
/// # Errors
/// [`PlanError::ModelLacks`] if the object cannot be simulated.
pub fn joint_dynamics<'a>(
    model: &ObjectModel,
    X_WO: &Isometry3<f64>,
    gravity: nalgebra::Vector3<f64>,
    q_other: &[f64],
    joint: usize,
) -> Result<Box<JointDynamics<'a>>, PlanError> {
    let lacks = |message: String| PlanError::ModelLacks { model: model.name.clone(), message };
    let mut system = System::new(&[Part::welded(model, *X_WO)]).map_err(|e| lacks(e.to_string()))?;
    system.multibody_mut().set_gravity(gravity);
    let n = system.multibody().nv();
    if system.multibody().nq() != n || joint >= n {
        return Err(lacks(format!("joint number {joint} is not among its {n} joints of one degree of freedom")));
    }
    let mut state = system.state();
    for (q, other) in state.q.iter_mut().zip(q_other) {
        *q = *other;
    }
    let scratch = std::cell::RefCell::new((system.workspace(), state, vec![0.0; n], vec![0.0; n]));
    Ok(Box::new(move |q: f64, v: f64, a: f64| {
        let mut scratch = scratch.borrow_mut();
        let (ws, state, accelerations, tau) = &mut *scratch;
        (state.q[joint], state.v[joint], accelerations[joint]) = (q, v, a);
        match system.inverse_dynamics(ws, state, accelerations, &[], tau) {
            Ok(()) => tau[joint],
            Err(_) => f64::NAN,
        }
    }))
}

/// Efforts that hold the arm against gravity at a configuration, by its joint order.
type GravityEfforts = dyn Fn(&[f64]) -> Vec<f64>;

/// [`GravityEfforts`] of the scene's arm, if its model is one that can be simulated.
fn gravity_of_arm(scene: &Scene) -> Option<Box<GravityEfforts>> {
    let names = &scene.robot.document.robot.as_ref()?.arm_joints;
    let mut body = Multibody::welded(&scene.robot, scene.X_WR).ok()?;
    body.set_gravity(scene.gravity);
    let slots = body.velocity_indices(names).ok()?;
    let (nq, nv) = (body.nq(), body.nv());
    if nq != nv {
        return None;
    }
    let workspace = std::cell::RefCell::new(body.workspace());
    Some(Box::new(move |q: &[f64]| {
        let mut ws = workspace.borrow_mut();
        let mut all = vec![0.0; nq];
        slots.iter().zip(q).for_each(|(s, q)| all[*s] = *q);
        let mut tau = vec![0.0; nv];
        let done = body.set_state(&mut ws, &all, &vec![0.0; nv]).and_then(|()| body.gravity_efforts(&mut ws, &mut tau));
        slots.iter().map(|s| if done.is_ok() { tau[*s] } else { f64::NAN }).collect()
    }))
}

const APPROACH: usize = 0;
const MOVE: usize = 1;
const RETREAT: usize = 2;

/// Plans how the arm moves one joint of an object. The plans come best first, at least one.
///
/// # Errors
/// From [`object_motion`]; from [`grasps`]; else that of the grasp that came furthest: [`PlanError::Unreachable`],
/// [`PlanError::Collision`] or [`PlanError::TooWeak`] with its stage; [`PlanError::Cancelled`].
pub fn plan_articulation(
    scene: &Scene,
    world: &CollisionWorld,
    request: &ArticulationRequest,
    cancelled: &dyn Fn() -> bool,
) -> Result<Vec<ArticulationPlan>, PlanError> {
    let o = scene.objects.get(request.object).ok_or_else(|| PlanError::BadInput { message: "no such object in the scene".into() })?;
    let model = &o.model;
    let lacks = |message: String| PlanError::ModelLacks { model: model.name.clone(), message };
    let index = model.moving_joints().nth(request.joint).ok_or_else(|| lacks(format!("has no moving joint number {}", request.joint)))?;
    let joint = &model.joints[index];
    let robot = scene.robot.document.robot.as_ref().ok_or_else(|| lacks("the robot's model has no `robot` section".into()))?;
    let effort = request.motion.effort.min(joint.limits.effort);
    let speed = request.motion.speed.min(joint.limits.velocity);
    let motion = ObjectMotionOptions { effort, speed, ..request.motion.clone() };
    let dynamics = joint_dynamics(model, &o.X_WO, scene.gravity, &o.q, request.joint)?;
    let object = object_motion(&*dynamics, request.from, request.to, &motion)?;

    // Grasps on any link that the joint moves rigidly: its child, and what is fixed to that.
    let mut moved = vec![joint.child];
    for j in &model.joints {
        if j.kind == JointKind::Fixed && moved.contains(&j.parent) {
            moved.push(j.child);
        }
    }
    let mut candidates = Vec::new();
    let mut none = None;
    for link in &moved {
        match grasps(model, Some(*link), &robot.gripper, &GraspOptions::default()) {
            Ok(found) => candidates.extend(found),
            Err(e) => none = none.or(Some(e)),
        }
    }
    if let (true, Some(e)) = (candidates.is_empty(), none) {
        return Err(e);
    }
    candidates.sort_by(|a, b| b.quality.total_cmp(&a.quality));
    candidates.truncate(request.grasps);

    // Steps of at most 3 degrees or 1.5 cm.
    let step = if joint.kind == JointKind::Prismatic { 0.015 } else { 0.05 };
    let count = (((request.to - request.from).abs() / step).ceil() as usize).clamp(1, 400);
    let positions: Vec<f64> = (0..=count).map(|k| request.from + (request.to - request.from) * k as f64 / count as f64).collect();
    let gravity = gravity_of_arm(scene);

    let mut plans: Vec<ArticulationPlan> = Vec::new();
    let mut furthest: Option<(usize, PlanError)> = None;
    let mut number = 0;
    // Some grasps at a time: those that the arm can hold best over the way are tried first among them.
    'search: for some in candidates.chunks(6) {
        let mut windows = Vec::new();
        for grasp in some {
            if cancelled() {
                return Err(PlanError::Cancelled { stage: "grasp".into() });
            }
            match promising(scene, world, request, grasp, robot.gripper.pad_half_extents[1], &positions) {
                Ok(found) => windows.extend(found),
                Err(e) => keep_furthest(&mut furthest, e),
            }
        }
        windows.sort_by(|a, b| b.promise.total_cmp(&a.promise));
        for window in &windows {
            number += 1;
            let mut found = try_grasp(scene, world, request, window, &positions, request.standoff, number, cancelled);
            if found.as_ref().is_err_and(|e| e.stage() != "path" && !matches!(e, PlanError::Cancelled { .. })) {
                // Half of the way in and out still clears a handle.
                found = try_grasp(scene, world, request, window, &positions, 0.5 * request.standoff, number, cancelled);
            }
            match found {
                Ok(mut plan) => {
                    plan.object = object.clone();
                    if let Err(e) = judge(world.arm(), gravity.as_deref(), &mut plan) {
                        keep_furthest(&mut furthest, e);
                        continue;
                    }
                    plans.push(plan);
                }
                Err(e @ PlanError::Cancelled { .. }) => return Err(e),
                Err(e) => keep_furthest(&mut furthest, e),
            }
            // Good enough: the rest would only cost time.
            if plans.len() > request.plans.max(1) {
                break 'search;
            }
        }
    }
    if plans.is_empty() {
        return Err(furthest.map_or_else(|| lacks("has no grasp for this joint".into()), |(_, e)| e));
    }
    plans.sort_by(|a, b| a.score.total_cmp(&b.score));
    plans.truncate(request.plans.max(1));
    // Back to the object's level where the arm cannot follow its speed.
    for plan in &mut plans {
        let fastest = arm_speed_limit(world.arm(), plan);
        if fastest < motion.speed {
            let slower = ObjectMotionOptions { duration: None, speed: fastest, ..motion.clone() };
            plan.object = object_motion(&*dynamics, request.from, request.to, &slower)?;
        }
    }
    Ok(plans)
}

/// Share of a pad's half length that may be rolled off on either side of its middle.
const ROLLED: f64 = 0.4;

/// The world with what a hand at work on the handle may do.
fn near_handle(world: &CollisionWorld, request: &ArticulationRequest, grasp: &Grasp) -> CollisionWorld {
    let mut near = world.clone();
    near.allow_touch(near.fingers(), request.object, grasp.link, grasp.held_part);
    near.allow_close(near.hand(), request.object);
    near
}

/// A grasp with the part of its freedom that one hold may use, and how much the arm can do with it.
struct Window {
    grasp: Grasp,
    promise: f64,
    /// Solutions at the first, middle and last position, as starts.
    seeds: Vec<Vec<f64>>,
}

/// A hand that turns about a bar while it holds it rolls its pads off the bar: by the angle times the bar's radius. So the
/// grip's freedom is cut into overlapping windows in which the bar stays on the pads. Only windows in which the arm reaches
/// the first, the middle and the last position are worth a search; one set of inverse kinematics tells for all.
fn promising(
    scene: &Scene,
    world: &CollisionWorld,
    request: &ArticulationRequest,
    grasp: &Grasp,
    pad_half_length: f64,
    positions: &[f64],
) -> Result<Vec<Window>, PlanError> {
    let o = &scene.objects[request.object];
    let chain = world.arm().with_freedom(&grasp.freedom());
    let mut q = o.q.clone();
    q.resize(q.len().max(request.joint + 1), 0.0);
    let options = InverseOptions {
        starts: 40,
        solutions: 40,
        distinct: 0.15,
        margin: request.search.margin,
        tolerance: 1e-7,
        steps: 50,
        seed: request.seed,
    };
    let mut at: Vec<Vec<Vec<f64>>> = Vec::new();
    for k in [0, positions.len() / 2, positions.len() - 1] {
        q[request.joint] = positions[k];
        let goal = grasp.X_WF(&o.model, &o.X_WO, &q);
        let found = chain.inverse(&goal, &[], &options);
        if found.is_empty() {
            let p = goal.translation.vector;
            return Err(PlanError::Unreachable {
                stage: "path".into(),
                message: format!(
                    "with the joint at {:.3} the grasp '{}' at ({:.2}, {:.2}, {:.2}) m has no solution within the joint limits",
                    positions[k], grasp.name, p.x, p.y, p.z
                ),
            });
        }
        at.push(found);
    }
    let freedom = |q: &Vec<f64>| q.last().copied().unwrap_or(0.0);
    let [low, high] = grasp.range;
    let roll = (ROLLED * pad_half_length / (0.5 * grasp.hold_width).max(1e-4)).min(0.5 * (high - low));
    let count = if high - low <= 2.0 * roll + 1e-9 { 0 } else { ((high - low - 2.0 * roll) / roll).ceil().max(1.0) as usize };
    let mut near = near_handle(world, request, grasp);
    let mut hand_blocked = None;
    let mut windows = Vec::new();
    for k in 0..=count {
        let middle = if count == 0 { 0.5 * (low + high) } else { low + roll + (high - low - 2.0 * roll) * k as f64 / count as f64 };
        let range = [middle - roll, middle + roll];
        let inside = |q: &&Vec<f64>| freedom(q) >= range[0] - 0.05 && freedom(q) <= range[1] + 0.05;
        let least = at.iter().map(|found| found.iter().filter(inside).count()).min().unwrap_or(0);
        if least == 0 {
            continue;
        }
        // A hand that cannot be there at all needs no arm.
        let mut blocked = None;
        for position in [positions[0], positions[positions.len() - 1]] {
            q[request.joint] = position;
            near.set_joint(request.object, request.joint, position);
            let contacts: Vec<Option<Contact>> = [0.0, -0.9 * roll, 0.9 * roll]
                .iter()
                .map(|d| near.check_hand(&grasp.X_WT(&o.model, &o.X_WO, &q, middle + d), grasp.hold_width))
                .collect();
            if contacts.iter().all(Option::is_some) {
                blocked = contacts.into_iter().next().flatten();
            }
        }
        if blocked.is_some() {
            hand_blocked = blocked;
            continue;
        }
        let quality = grasp.quality - 0.1 * middle.abs();
        windows.push(Window {
            grasp: Grasp { range, quality, ..grasp.clone() },
            promise: quality + 0.05 * (least as f64).min(8.0),
            seeds: at.iter().flat_map(|found| found.iter().filter(inside).take(4).cloned()).collect(),
        });
    }
    if let (true, Some(c)) = (windows.is_empty(), hand_blocked) {
        let message = format!("the hand has no room at the grasp '{}'", grasp.name);
        return Err(PlanError::Collision { stage: "grasp".into(), first: c.first, second: c.second, message });
    }
    if windows.is_empty() {
        return Err(PlanError::Unreachable {
            stage: "path".into(),
            message: format!(
                "the grasp '{}' reaches from {:.3} to {:.3}, but not with a hand that turns by less than {:.2} about it",
                grasp.name,
                positions[0],
                positions[positions.len() - 1],
                2.0 * roll
            ),
        });
    }
    Ok(windows)
}

fn keep_furthest(furthest: &mut Option<(usize, PlanError)>, e: PlanError) {
    let rank = match &e {
        PlanError::TooWeak { .. } => 5,
        PlanError::Collision { stage, .. } if stage == "grasp" => 2,
        PlanError::Collision { .. } => 4,
        PlanError::Unreachable { .. } => 3,
        _ => 1,
    };
    if furthest.as_ref().is_none_or(|(r, _)| rank > *r) {
        *furthest = Some((rank, e));
    }
}

#[allow(clippy::too_many_arguments)]
fn try_grasp(
    scene: &Scene,
    world: &CollisionWorld,
    request: &ArticulationRequest,
    window: &Window,
    positions: &[f64],
    standoff: f64,
    number: u64,
    cancelled: &dyn Fn() -> bool,
) -> Result<ArticulationPlan, PlanError> {
    let grasp = &window.grasp;
    let o = &scene.objects[request.object];
    let arm = world.arm();
    let steps = (standoff / 0.015).ceil().max(1.0) as usize;
    // Chain 0 at the grasp; chain k stands k steps behind it.
    let chains: Vec<ArmKinematics> =
        (0..=steps).map(|k| arm.with_freedom(&grasp.freedom_behind(standoff * k as f64 / steps as f64))).collect();
    let mut q = o.q.clone();
    q.resize(q.len().max(request.joint + 1), 0.0);
    let mut goal_at = |position: f64| {
        q[request.joint] = position;
        grasp.X_WF(&o.model, &o.X_WO, &q)
    };
    let mut waypoints = Vec::new();
    let mut joint_at = Vec::new();
    let (first, last) = (positions[0], positions[positions.len() - 1]);
    for k in (1..=steps).rev() {
        waypoints.push(Waypoint { goal: goal_at(first), chain: k, stage: APPROACH });
        joint_at.push(first);
    }
    for p in positions {
        waypoints.push(Waypoint { goal: goal_at(*p), chain: 0, stage: MOVE });
        joint_at.push(*p);
    }
    for k in 1..=steps {
        waypoints.push(Waypoint { goal: goal_at(last), chain: k, stage: RETREAT });
        joint_at.push(last);
    }
    let path = ToolPath { chains, waypoints, stages: vec!["approach".into(), "path".into(), "retreat".into()] };

    let mut near = near_handle(world, request, grasp);
    let arm_n = arm.arm_joints();
    let mut current = f64::NAN;
    let mut check = |i: usize, q: &[f64]| -> Option<Contact> {
        if joint_at[i] != current {
            current = joint_at[i];
            near.set_joint(request.object, request.joint, current);
        }
        let moving = path.waypoints[i].stage == MOVE;
        // At both ends of the motion the gripper is also open, before it shuts and after it lets go.
        let open_too = moving && (i == steps || i + steps + 1 == joint_at.len());
        if open_too && let Some(c) = near.check(&q[..arm_n], grasp.width) {
            return Some(c);
        }
        near.check(&q[..arm_n], if moving { grasp.hold_width } else { grasp.width })
    };
    let mut seed = request.q_start.clone();
    seed.push(0.5 * (grasp.range[0] + grasp.range[1]));
    let mut seeds = vec![seed];
    seeds.extend(window.seeds.iter().cloned());
    let options = PathOptions {
        seed: request.seed.wrapping_mul(0x9e37_79b9).wrapping_add(number),
        start_near: Some(request.q_start.clone()),
        ..request.search.clone()
    };
    let found = arm_path(&path, &seeds, &mut check, &options, cancelled)?;
    let mut q = found.q;
    let retreat = q.split_off(steps + positions.len() - 1);
    let path_q = {
        let mut p = q.split_off(steps);
        p.push(retreat[0].clone());
        p
    };
    let mut approach = q;
    approach.push(path_q[0].clone());
    let freedom = found.freedom[steps..steps + positions.len()].iter().map(|f| f.first().copied().unwrap_or(0.0)).collect();
    let X_WT = path_q.iter().map(|q| arm.X_WT(q)).collect();
    Ok(ArticulationPlan {
        grasp: grasp.clone(),
        approach,
        path: path_q,
        joint: positions.to_vec(),
        freedom,
        X_WT,
        retreat,
        object: ObjectTrajectory { t: vec![0.0], q: vec![first], v: vec![0.0], a: vec![0.0], u: vec![0.0] },
        load: 0.0,
        score: found.cost + 2.0 * (1.0 - grasp.quality) + 0.02 / (found.manipulability + 0.005),
    })
}

/// The torque that u* takes, on top of the arm's weight.
fn judge(arm: &ArmKinematics, gravity: Option<&GravityEfforts>, plan: &mut ArticulationPlan) -> Result<(), PlanError> {
    let n = plan.path.len();
    for k in 0..n {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
        let dq = plan.joint[b] - plan.joint[a];
        if dq == 0.0 {
            continue;
        }
        // Way of the tool for each unit of the joint; the force along it that does u*'s work.
        let way = (plan.X_WT[b].translation.vector - plan.X_WT[a].translation.vector) / dq;
        let u = plan.object.effort_at(plan.joint[k]);
        let force = if way.norm() > 1e-6 { way * (u / way.norm_squared()) } else { way };
        let F = Vector6::new(0.0, 0.0, 0.0, force.x, force.y, force.z);
        let pull = arm.efforts(&plan.path[k], &F);
        let weight = gravity.map(|g| g(&plan.path[k])).unwrap_or_else(|| vec![0.0; pull.len()]);
        for (i, limit) in arm.effort().iter().take(arm.arm_joints()).enumerate() {
            if !limit.is_finite() || *limit <= 0.0 {
                continue;
            }
            let need = (pull[i] + weight[i]).abs();
            let share = need / limit;
            if share.is_finite() && share > plan.load {
                plan.load = share;
            }
            if share > 1.0 {
                return Err(PlanError::TooWeak {
                    stage: "path".into(),
                    message: format!(
                        "{} would need {need:.1} of {limit:.1} to move the joint past {:.3} with {u:.2}",
                        arm.names()[i],
                        plan.joint[k]
                    ),
                });
            }
        }
    }
    plan.score += 3.0 * plan.load.powi(2);
    Ok(())
}

/// Greatest speed of the object's joint that the arm can follow with a quarter of its own speed in hand.
fn arm_speed_limit(arm: &ArmKinematics, plan: &ArticulationPlan) -> f64 {
    let mut fastest = f64::INFINITY;
    for k in 1..plan.path.len() {
        let way = (plan.joint[k] - plan.joint[k - 1]).abs();
        for (i, limit) in arm.velocity().iter().take(arm.arm_joints()).enumerate() {
            let d = (plan.path[k][i] - plan.path[k - 1][i]).abs();
            if d > 1e-9 && limit.is_finite() {
                fastest = fastest.min(0.75 * limit * way / d);
            }
        }
    }
    fastest
}
