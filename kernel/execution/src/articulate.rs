//! Moving a joint of an object by its handle: what opening and shutting share.
//!
//! Two levels, after the paper: the object's own motion first (x*, u*), then a grasp and an arm path that carry it out. The
//! hand follows stiff along the path and soft across it, moved to where the handle turned out to be; u* is fed forward.

use nalgebra::{Isometry3, Point3};
use sagci_model::{JointKind, ObjectModel};
use sagci_planning::{ArmKinematics, ArticulationPlan, ArticulationRequest, JointTrajectory, ObjectMotionOptions, plan_articulation};
use sagci_signal::GripperCommand;
use sagci_skill::{Argument, BeliefChange, Failure, FailureCode, Measure, Plan, PlanRequest, Postcondition};

use crate::bench::{bad_argument, failure_of, through_air, with_feeling};
use crate::{Bench, Fingers, Follow, Guard, Law, Pace, Segment};

/// Grip on the handle, N a finger.
const GRIP: f64 = 45.0;
/// Stiffness along and across the path, N/m, and against turning, N m/rad. Across, 1 cm of error of the axis costs 3 N.
const ALONG: f64 = 1200.0;
const ACROSS: f64 = 300.0;
const TURNING: f64 = 30.0;
/// Beyond this the hand lets the motion fail, N.
const FORCE_LIMIT: f64 = 90.0;
/// Pieces in which u* is fed forward.
const PUSH_POINTS: usize = 21;
/// Grasps that are tried when the first has no free way to it.
const PLANS: usize = 3;
/// Times that the handle may be taken.
const MOST_HOLDS: usize = 4;

/// What is to happen to a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Index of the object in the scene.
    pub object: usize,
    /// Which of its moving joints.
    pub joint: usize,
    /// Where the motion is led to, rad or m; beyond a limit means: against the stop.
    pub to: f64,
    /// What counts as there, rad or m.
    pub between: [f64; 2],
    /// Speed as a share of the usual one, see [`pace`].
    pub pace: f64,
}

/// Least and greatest share of the usual speed: below, dry friction makes the hand stick and slip; above, it would hurry near things.
const PACES: [f64; 2] = [0.1, 2.0];

/// The share of the usual speed that a request asks for by its argument `pace`; 1 if it does not say.
///
/// # Errors
/// [`FailureCode::BadArgument`] for a share below 0.1 or above 2.
pub fn pace(request: &PlanRequest) -> Result<f64, Failure> {
    match request.arguments.get("pace") {
        None => Ok(1.0),
        Some(Argument::Number(pace)) if (PACES[0]..=PACES[1]).contains(pace) => Ok(*pace),
        Some(_) => Err(bad_argument(format!("'pace' is a share of the usual speed and must lie between {} and {}", PACES[0], PACES[1]))),
    }
}

/// One hold of the handle: from taking it to letting it go.
struct Hold {
    plan: ArticulationPlan,
    from: f64,
    reach: JointTrajectory,
}

/// Plans to move a joint by its handle, with as few holds as it takes: where the arm cannot go the whole way with one grip,
/// the hand lets go on the way and takes the handle anew from another side.
///
/// # Errors
/// A failure that names its stage; see [`plan_articulation`] and [`sagci_planning::free_motion`].
pub fn articulate(bench: &Bench, motion: &Motion) -> Result<Plan, Failure> {
    if bench.held().is_some() {
        let message = "the gripper holds something; place it first".into();
        return Err(Failure { code: FailureCode::BadArgument, stage: "grasp".into(), message });
    }
    let object = &bench.scene.objects[motion.object];
    let from = object.q.get(motion.joint).copied().unwrap_or(0.0);
    let index = object.model.moving_joints().nth(motion.joint);
    let joint = index.map(|i| &object.model.joints[i]).ok_or_else(|| {
        let message = format!("'{}' has no moving joint number {}", object.model.name, motion.joint);
        Failure { code: FailureCode::ModelLacks, stage: "joint".into(), message }
    })?;
    let mut first_failure = None;
    for holds in 1..=MOST_HOLDS {
        match plan_holds(bench, motion, joint.kind, from, &bench.request.q, holds) {
            Ok((holds, back)) => return carry_out(bench, motion, &joint.name, joint.kind, &holds, back),
            Err(failure) if failure.code == FailureCode::Cancelled => return Err(failure),
            Err(failure) => first_failure = first_failure.or(Some(failure)),
        }
    }
    Err(first_failure.unwrap_or_else(|| Failure {
        code: FailureCode::Unreachable,
        stage: "grasp".into(),
        message: "no grasp was found".into(),
    }))
}

/// Plans the rest of a motion, from `from` with the arm at `q`, in the given number of holds; and the way to rest after it.
fn plan_holds(
    bench: &Bench,
    motion: &Motion,
    kind: JointKind,
    from: f64,
    q: &[f64],
    holds: usize,
) -> Result<(Vec<Hold>, JointTrajectory), Failure> {
    let mut scene = bench.scene.clone();
    let positions = &mut scene.objects[motion.object].q;
    positions.resize(positions.len().max(motion.joint + 1), 0.0);
    positions[motion.joint] = from;
    let mut world = bench.world.clone();
    world.set_joint(motion.object, motion.joint, from);
    let to = from + (motion.to - from) / holds as f64;
    // Slides run at hand speed; doors at a turn that keeps the handle there too.
    let speed = motion.pace * if kind == JointKind::Prismatic { 0.12 } else { 0.35 };
    let request = ArticulationRequest {
        motion: ObjectMotionOptions { speed, ..ObjectMotionOptions::default() },
        plans: PLANS,
        seed: bench.request.seed,
        ..ArticulationRequest::new(motion.object, motion.joint, from, to, q)
    };
    let plans = plan_articulation(&scene, &world, &request, bench.cancelled()).map_err(failure_of)?;
    let end = |path: &[Vec<f64>], last: bool| if last { path.last().cloned() } else { path.first().cloned() }.unwrap_or_default();
    let mut first_failure = None;
    for plan in plans {
        let width = plan.grasp.width;
        let whole = || -> Result<_, Failure> {
            let reach = bench.free(&world, q, &end(&plan.approach, false), width, Pace::Free, "reach the handle")?;
            let leave = end(&plan.retreat, true);
            if holds > 1 {
                let (rest, back) = plan_holds(bench, motion, kind, to, &leave, holds - 1)?;
                return Ok((reach, rest, back));
            }
            let mut after = world.clone();
            after.set_joint(motion.object, motion.joint, to);
            let back = bench.free(&after, &leave, &bench.rest()?, width, Pace::Free, "return from the handle")?;
            Ok((reach, Vec::new(), back))
        };
        match whole() {
            Ok((reach, rest, back)) => {
                let mut all = vec![Hold { plan, from, reach }];
                all.extend(rest);
                return Ok((all, back));
            }
            Err(failure) if failure.code == FailureCode::Cancelled => return Err(failure),
            Err(failure) => first_failure = first_failure.or(Some(failure)),
        }
    }
    Err(first_failure.unwrap_or_else(|| Failure {
        code: FailureCode::Unreachable,
        stage: "grasp".into(),
        message: "no grasp was found".into(),
    }))
}

fn carry_out(bench: &Bench, motion: &Motion, name: &str, kind: JointKind, holds: &[Hold], back: JointTrajectory) -> Result<Plan, Failure> {
    let object = &bench.scene.objects[motion.object];
    let arm = bench.world.arm();
    let rest = bench.rest()?;
    let feel = Guard::Overload { limit: 40.0 };
    let first = GripperCommand { width: holds.first().map_or(0.0, |h| h.plan.grasp.width), force: 20.0 };
    let mut sequence = bench.sequence(first)?;
    let mut grips = Vec::new();
    let mut strongest: f64 = 0.0;
    for (number, hold) in holds.iter().enumerate() {
        let plan = &hold.plan;
        let open = GripperCommand { width: plan.grasp.width, force: 20.0 };
        let shut = GripperCommand { width: 0.0, force: GRIP };
        let path = bench.timed(&plan.path, Pace::Careful)?;
        let path = match plan.object.duration() / path.duration().max(1e-3) {
            slower if slower > 1.0 => path.slowed(slower),
            _ => path,
        };
        let push = push_along(hold, &path, arm);
        strongest = push.iter().fold(strongest, |m, f| m.max(*f));
        let last = number + 1 == holds.len();
        let guard = if last && motion.to < hold.from {
            Guard::Stop { share: 0.8, limit: FORCE_LIMIT }
        } else {
            Guard::Overload { limit: FORCE_LIMIT }
        };
        let law = Law::Tool { along: ALONG, across: ACROSS, turning: TURNING, anchored: true, push };
        let width = plan.grasp.hold_width;
        let expected = [0.6 * width, (1.4 * width).min(0.5 * (width + plan.grasp.width)).max(width + 0.002)];
        let letting_go = Fingers { gripper: open, expected: [open.width - 0.01, open.width + 0.01], yielding: false, timeout: 1.5 };
        let gripping = Fingers { gripper: shut, expected, yielding: true, timeout: 2.0 };
        let moving = Follow { trajectory: path, law, gripper: shut, guard, least_width: 0.5 * width };

        let again = if number == 0 { "" } else { " again" };
        sequence.phase(&format!("reach the handle{again}"), [through_air(hold.reach.clone(), open, 0.0)]);
        let approach = bench.timed(&plan.approach, Pace::Slow)?;
        sequence.phase(&format!("approach the handle{again}"), [with_feeling(approach, open, false, feel, 0.0)]);
        grips.push(sequence.phases().len());
        sequence.phase(&format!("grip the handle{again}"), [Segment::Fingers(gripping)]);
        sequence.phase(&format!("move the handle{again}"), [Segment::Follow(moving)]);
        sequence.phase("let the handle go", [Segment::Fingers(letting_go)]);
        let retreat = bench.timed(&plan.retreat, Pace::Slow)?;
        sequence.phase("leave the handle", [with_feeling(retreat, open, true, feel, 0.0)]);
        if last {
            sequence.phase("return", [through_air(back.clone(), open, 0.0)]);
        }
    }

    let unit = if kind == JointKind::Prismatic { "m" } else { "rad" };
    let mut summary = bench.summary(&sequence, &rest);
    let reached = motion.to.clamp(motion.between[0], motion.between[1]);
    summary.predicted = vec![
        Measure { name: name.into(), value: reached, unit: unit.into() },
        Measure { name: "peak force".into(), value: strongest, unit: "N".into() },
    ];
    summary.after = vec![BeliefChange::Joint { object: object.name.clone(), joint: name.into(), position: reached }];
    summary.postconditions = vec![Postcondition::JointBetween {
        object: object.name.clone(),
        joint: name.into(),
        least: motion.between[0],
        most: motion.between[1],
    }];

    let (object_name, joint_name) = (object.name.clone(), name.to_owned());
    let (model, X_WO, slot) = (object.model.clone(), object.X_WO, motion.joint);
    let mut q = object.q.clone();
    q.resize(model.moving_joints().count(), 0.0);
    sequence.report(Box::new(move |endings| {
        let at = |phase: usize| endings.iter().rfind(|e| e.phase == phase);
        let mut q = q.clone();
        let mut peak_force: f64 = 0.0;
        let mut moved = false;
        for grip in &grips {
            let (Some(start), Some(end)) = (at(*grip), at(grip + 1)) else { break };
            q[slot] = joint_from_hand(&model, &X_WO, &q, slot, &start.X_WT, &end.X_WT);
            peak_force = peak_force.max(end.peak_force);
            moved = true;
        }
        if !moved {
            return (Vec::new(), Vec::new());
        }
        let measured = vec![
            Measure { name: joint_name.clone(), value: q[slot], unit: unit.into() },
            Measure { name: "peak force".into(), value: peak_force, unit: "N".into() },
        ];
        (measured, vec![BeliefChange::Joint { object: object_name.clone(), joint: joint_name.clone(), position: q[slot] }])
    }));
    Ok(Plan { summary, execution: Box::new(sequence) })
}

/// u* as a force along the hand's path, evenly spaced over it: power is the same, F ds = u dq.
fn push_along(hold: &Hold, path: &JointTrajectory, arm: &ArmKinematics) -> Vec<f64> {
    let position = |share: f64| joint_at(&hold.plan, share);
    let place = |share: f64| arm.X_WT(&path.at_progress(share)).translation.vector;
    (0..PUSH_POINTS)
        .map(|i| {
            let share = i as f64 / (PUSH_POINTS - 1) as f64;
            let (a, b) = ((share - 0.02).max(0.0), (share + 0.02).min(1.0));
            let lever = (place(b) - place(a)).norm() / (position(b) - position(a)).abs().max(1e-6);
            (hold.plan.object.effort_at(position(share)).abs() / lever.max(1e-3)).min(0.5 * FORCE_LIMIT)
        })
        .collect()
}

/// Position of the joint at a share of the arm's path.
fn joint_at(plan: &ArticulationPlan, share: f64) -> f64 {
    let Some(last) = plan.joint.len().checked_sub(1) else { return 0.0 };
    let x = share.clamp(0.0, 1.0) * last as f64;
    let i = x.floor() as usize;
    plan.joint[i] + x.fract() * (plan.joint[(i + 1).min(last)] - plan.joint[i])
}

/// Position of a joint from the hand that holds its link: the point that was held when the joint was at `q` now lies at
/// the hand. Revolute: the turn about the axis that brings the one nearest to the other; prismatic: the way along it.
fn joint_from_hand(model: &ObjectModel, X_WO: &Isometry3<f64>, q: &[f64], slot: usize, grip: &Isometry3<f64>, end: &Isometry3<f64>) -> f64 {
    let from = q.get(slot).copied().unwrap_or(0.0);
    let Some(index) = model.moving_joints().nth(slot) else { return from };
    let joint = &model.joints[index];
    let X_WJ = X_WO * model.X_OL(q)[joint.parent] * joint.X_PJ;
    let p = |X: &Isometry3<f64>| X_WJ.inverse_transform_point(&Point3::from(X.translation.vector)).coords;
    let (a, b) = (p(grip), p(end));
    let axis = joint.axis.into_inner();
    match joint.kind {
        JointKind::Prismatic => from + (b - a).dot(&axis),
        _ => {
            let (a, b) = (a - axis * a.dot(&axis), b - axis * b.dot(&axis));
            from + a.cross(&b).dot(&axis).atan2(a.dot(&b))
        }
    }
}
