//! What a joint did and what moved it, from the hand that held its handle.
//!
//! While the gripper holds, the tool frame's origin `p` moves with the link. Everything here comes from the arm's encoders (`p`, by the arm's
//! own model), the gripper and the wrist's force sensor; nothing else of the object is known than its stored model and where it was seen.
//!
//! **Position.** A hinge takes `p` along a circle about its axis, whose direction `a` the stored model gives; an error of its tilt by `b` makes
//! an ellipse of the circle, an error of `b^2 / 4` of the angle. Where the axis lies is measured: in the plane across `a`, all holds of a run
//! share the centre `c` and have a radius each, `|p|^2 = 2 c . p + k_hold`, which is linear in `c` and `k` (Kasa 1976). The joint's position is
//! the angle about `c`, counted from a [`Zero`]. A slide takes `p` along `a`, and the position is the way along it.
//!
//! The first run says where zero lies: the hand's place as the hold began was where the joint was believed to be then. Later runs on the same
//! joint keep it, while the object stands where it did: fingers that close about a handle push the joint some way from where it was believed to
//! be, each time another way, and forces that are bound to a place would seem to wander.
//!
//! **Effort.** The sensor gives the wrench that the world puts on the hand; its opposite is what the hand puts on the link. Along the joint
//! that is `a . ((p_S - c) x f + t)` for a hinge and `a . f` for a slide. What the sensor says while the hand is free before it grips is its
//! constant error, and is taken off. An effort of a row is the mean from that row to the next, as a held input has it.
//!
//! Nearer to a stop than [`STOP_SHARE`] of the range, the stop pushes as well, and where it begins is known no better than the joint's
//! position: the ends of a hold that lie there are left out.

use nalgebra::{DMatrix, DVector, Isometry3, Point3, Unit, Vector2, Vector3};
use sagci_model::{JointKind, ObjectModel};
use sagci_recording::{JointLog, Log, Series};
use sagci_signal::{Observation, Wrench};

use crate::{StoredAxis, stored_axis};

/// Samples that become one row.
const ROW: usize = 10;
/// A gripper holds while it presses with this share of the greatest force of the run, and at least with this many N.
const PRESSING: f64 = 0.5;
const LEAST_FORCE: f64 = 1.0;
/// Samples over which the gripper's force is averaged.
const SMOOTH: usize = 20;
/// What is cut from both ends of a hold, and the least that must be left, s.
const SETTLE: f64 = 0.15;
const LEAST_TIME: f64 = 0.4;
/// Share of the joint's range that is left out at either stop.
const STOP_SHARE: f64 = 0.006;
/// The hand is free until this long before it grips, s.
const BEFORE: f64 = 0.5;
/// Least turn over which the centre of a hinge is measured, rad; over less, it is where the model says.
const LEAST_TURN: f64 = 0.35;

/// What is known before.
#[derive(Debug, Clone, Copy)]
pub struct HeldJoint<'a> {
    /// The arm.
    pub robot: &'a ObjectModel,
    /// Pose of its root link in the world.
    pub X_WR: Isometry3<f64>,
    /// The object, as it is stored.
    pub object: &'a ObjectModel,
    /// Pose of its root link in the world, as it was seen.
    pub X_WO: Isometry3<f64>,
    /// The joint that was moved.
    pub joint: &'a str,
    /// Positions of the object's moving joints when the run began, rad or m.
    pub q: &'a [f64],
    /// From where an earlier run on the same joint counted, if there was one.
    pub zero: Option<&'a Zero>,
}

/// Where the positions of a joint are counted from, as the hand that held it measures them.
#[derive(Debug, Clone, PartialEq)]
pub struct Zero {
    /// Pose of the object's root link in the world.
    X_WO: Isometry3<f64>,
    /// A hinge's centre.
    center: Point3<f64>,
    /// What is measured there where the joint is at zero, rad or m.
    position: f64,
}

/// Why nothing can be said of a joint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum HeldJointError {
    /// The models do not have what they are asked for.
    #[error("held joint: {0}")]
    Model(String),
    /// The gripper held nothing for long enough.
    #[error(
        "held joint: the gripper did not hold the handle of '{joint}' for {LEAST_TIME} s while the joint moved; run a skill that moves it"
    )]
    NotHeld {
        /// The joint.
        joint: String,
    },
}

/// The hand at one instant.
struct Hand {
    time: f64,
    /// Tool frame's origin in the world.
    p: Point3<f64>,
    X_WS: Isometry3<f64>,
    F_S: Wrench,
}

/// Samples from `start` to before `end` in which the gripper holds.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Hold {
    start: usize,
    end: usize,
}

/// Position and effort of a joint from what the robot sensed in one run, one recording for each time that the handle was held: rows of ten
/// sensor periods, rad or m, N m or N, positive along the joint's axis. And from where positions are counted.
///
/// # Errors
/// Models without such a joint or robot; a run in which the handle was not held.
pub fn held_joint(setting: &HeldJoint<'_>, run: &[Observation]) -> Result<(Vec<Log>, Zero), HeldJointError> {
    let lacks = |what: &str| HeldJointError::Model(format!("'{}' {what}", setting.robot.name));
    let facts = setting.robot.document.robot.as_ref().ok_or_else(|| lacks("is not a robot"))?;
    let tool = setting.robot.link(&facts.gripper.link).ok_or_else(|| lacks("has no gripper link"))?;
    let wrist = setting.robot.link(&facts.wrist_link).ok_or_else(|| lacks("has no wrist link"))?;
    let axis = stored_axis(setting.object, setting.joint, &setting.X_WO, setting.q);
    let slot = setting.object.moving_joints().position(|j| setting.object.joints[j].name == setting.joint);
    let (Some(axis), Some(slot)) = (axis, slot) else {
        return Err(HeldJointError::Model(format!("'{}' has no moving joint '{}'", setting.object.name, setting.joint)));
    };
    let arm: Vec<Option<usize>> =
        (setting.robot.moving_joints()).map(|j| facts.arm_joints.iter().position(|n| *n == setting.robot.joints[j].name)).collect();
    let sense = |o: &Observation| {
        let q: Vec<f64> = arm.iter().map(|slot| slot.and_then(|s| o.q.get(s)).copied().unwrap_or(0.0)).collect();
        let X_RL = setting.robot.X_OL(&q);
        let X_WT = setting.X_WR * X_RL[tool] * facts.gripper.X_LT.isometry();
        Hand { time: o.time, p: Point3::from(X_WT.translation.vector), X_WS: setting.X_WR * X_RL[wrist], F_S: o.F_S }
    };

    let holds = holds(run);
    let not_held = || HeldJointError::NotHeld { joint: setting.joint.to_owned() };
    let first = holds.first().ok_or_else(not_held)?;
    let bias = free_wrench(run, first.start);
    let hands: Vec<Vec<Hand>> = holds.iter().map(|h| run[h.start..h.end].iter().map(sense).collect()).collect();
    let mut along = Along::measured(&axis, &hands);
    let believed = setting.q.get(slot).copied().unwrap_or(0.0);
    let kept = setting.zero.filter(|zero| zero.X_WO == setting.X_WO);
    if let Some(zero) = kept {
        along.center = zero.center;
    }
    let begin = hands.first().map_or(0.0, |hold| along.positions(hold).first().copied().unwrap_or(0.0));
    let zero = kept.cloned().unwrap_or(Zero { X_WO: setting.X_WO, center: along.center, position: begin - believed });
    let limits = setting.object.joint(setting.joint).map(|j| setting.object.joints[j].limits);
    let inside = |q: f64| {
        limits.is_none_or(|l| {
            let margin = if l.range().is_finite() { STOP_SHARE * l.range() } else { 0.0 };
            q > l.lower + margin && q < l.upper - margin
        })
    };

    let mut logs = Vec::new();
    for (number, hold) in hands.iter().enumerate() {
        let s = along.positions(hold);
        // Whole turns are as near to what is believed as can be.
        let turn = std::f64::consts::TAU;
        let turns = if along.turns { ((begin - zero.position - believed) / turn).round() * turn } else { 0.0 };
        let origin = zero.position + turns;
        let mut rows: Vec<(f64, f64, f64)> = Vec::new();
        for k in (0..hold.len().saturating_sub(ROW)).step_by(ROW) {
            // A sample's force is that of the period which it ends.
            let effort = hold[k + 1..=k + ROW].iter().map(|h| along.effort(h, &bias)).sum::<f64>() / ROW as f64;
            rows.push((hold[k].time, s[k] - origin, effort));
        }
        let (Some(from), Some(to)) = (rows.iter().position(|r| inside(r.1)), rows.iter().rposition(|r| inside(r.1))) else { continue };
        let rows = &rows[from..=to];
        if rows.last().zip(rows.first()).is_none_or(|(b, a)| b.0 - a.0 < LEAST_TIME) {
            continue;
        }
        let series =
            |pick: fn(&(f64, f64, f64)) -> f64| Series { time: rows.iter().map(|r| r.0).collect(), value: rows.iter().map(pick).collect() };
        let joint =
            JointLog { name: setting.joint.to_owned(), position: series(|r| r.1), effort: Some(series(|r| r.2)), ..JointLog::default() };
        let log = Log { source: format!("hold {}", number + 1), joints: vec![joint], ..Log::default() };
        logs.push(log.hashed());
    }
    if logs.is_empty() { Err(not_held()) } else { Ok((logs, zero)) }
}

/// When the gripper held something.
fn holds(run: &[Observation]) -> Vec<Hold> {
    let mut force = vec![0.0; run.len()];
    let mut mean = 0.0;
    for (smooth, o) in force.iter_mut().zip(run) {
        mean += (o.gripper_force - mean) / SMOOTH as f64;
        *smooth = mean;
    }
    let threshold = (PRESSING * force.iter().copied().fold(0.0, f64::max)).max(LEAST_FORCE);
    let mut found = Vec::new();
    let mut start = None;
    for i in 0..=run.len() {
        let holds = force.get(i).is_some_and(|f| *f > threshold);
        match (holds, start) {
            (true, None) => start = Some(i),
            (false, Some(begin)) => {
                start = None;
                let (from, to) = (run[begin].time + SETTLE, run[i - 1].time - SETTLE);
                let hold = Hold { start: run.partition_point(|o| o.time < from), end: run.partition_point(|o| o.time <= to) };
                if to - from > LEAST_TIME {
                    found.push(hold);
                }
            }
            _ => {}
        }
    }
    found
}

/// What the wrist's sensor says of a free hand, in its own frame: the median of each component before the first hold.
fn free_wrench(run: &[Observation], first: usize) -> Wrench {
    let end = run.get(first).map_or(0, |o| run.partition_point(|x| x.time < o.time - BEFORE));
    let median = |pick: &dyn Fn(&Wrench) -> f64| {
        let mut all: Vec<f64> = run[..end].iter().map(|o| pick(&o.F_S)).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(0.0)
    };
    let vector = |of: fn(&Wrench) -> Vector3<f64>| Vector3::from_fn(|i, _| median(&|w| of(w)[i]));
    Wrench { force: vector(|w| w.force), torque: vector(|w| w.torque) }
}

/// How a joint moves in the world.
struct Along {
    turns: bool,
    axis: Unit<Vector3<f64>>,
    center: Point3<f64>,
    /// Two unit vectors across the axis, so that a turn from the first to the second is positive.
    across: [Vector3<f64>; 2],
}

impl Along {
    /// The stored axis, moved to where the hand's path says that it is.
    fn measured(stored: &StoredAxis, hands: &[Vec<Hand>]) -> Self {
        let a = stored.axis_W.into_inner();
        let u = a.cross(&Vector3::ith(a.iamin(), 1.0)).normalize();
        let turns = stored.kind != JointKind::Prismatic;
        let mut along = Self { turns, axis: stored.axis_W, center: stored.origin_W, across: [u, a.cross(&u)] };
        if turns && let Some(center) = along.circle(hands) {
            along.center = center;
        }
        along
    }

    fn flat(&self, p: &Point3<f64>) -> Vector2<f64> {
        let d = p - self.center;
        Vector2::new(self.across[0].dot(&d), self.across[1].dot(&d))
    }

    /// The common centre of the circles of all holds, if they turn far enough.
    fn circle(&self, hands: &[Vec<Hand>]) -> Option<Point3<f64>> {
        let turn = |hold: &Vec<Hand>| {
            let s = self.positions(hold);
            s.iter().copied().fold(f64::NEG_INFINITY, f64::max) - s.iter().copied().fold(f64::INFINITY, f64::min)
        };
        if hands.iter().map(turn).fold(0.0, f64::max) < LEAST_TURN {
            return None;
        }
        let n = 2 + hands.len();
        let (mut A, mut b) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (i, hold) in hands.iter().enumerate() {
            for hand in hold.iter().step_by(ROW) {
                let p = self.flat(&hand.p);
                let mut row = DVector::zeros(n);
                (row[0], row[1], row[2 + i]) = (2.0 * p.x, 2.0 * p.y, 1.0);
                b += &row * p.norm_squared();
                A += &row * row.transpose();
            }
        }
        let c = A.lu().solve(&b)?;
        c.iter().all(|x| x.is_finite()).then(|| self.center + self.across[0] * c[0] + self.across[1] * c[1])
    }

    /// Positions along the joint, rad without jumps of a whole turn, or m.
    fn positions(&self, hold: &[Hand]) -> Vec<f64> {
        let mut last: Option<f64> = None;
        hold.iter()
            .map(|hand| {
                if !self.turns {
                    return self.axis.dot(&(hand.p - self.center));
                }
                let p = self.flat(&hand.p);
                let angle = p.y.atan2(p.x);
                let turns = last.map_or(0.0, |l| ((l - angle) / std::f64::consts::TAU).round());
                *last.insert(angle + turns * std::f64::consts::TAU)
            })
            .collect()
    }

    /// What the hand gives along the joint, N m or N.
    fn effort(&self, hand: &Hand, bias: &Wrench) -> f64 {
        let f = -(hand.X_WS.rotation * (hand.F_S.force - bias.force));
        if !self.turns {
            return self.axis.dot(&f);
        }
        let t = -(hand.X_WS.rotation * (hand.F_S.torque - bias.torque));
        self.axis.dot(&((Point3::from(hand.X_WS.translation.vector) - self.center).cross(&f) + t))
    }
}
