//! Follows one trajectory; see the crate's comment for its clock.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3, Vector6};
use sagci_control::{CartesianImpedance, CartesianReference, ControlError, Damping, JointImpedance, JointReference, Posture, WrenchFilter};
use sagci_planning::{ArmKinematics, JointTrajectory};
use sagci_signal::{Command, GripperCommand, Observation};
use sagci_skill::{Failure, FailureCode};

use crate::arm::{Arm, failure};
use crate::{Follow, Guard, Law};

/// How far the tool may stay behind before the clock stands still, m.
const LAG: f64 = 0.05;
/// The hand counts as held up when the clock has run slower than this for [`HELD_SECONDS`].
const HELD_RATE: f64 = 0.3;
const HELD_SECONDS: f64 = 0.6;
/// Time to come to rest after the trajectory's end, s, and what counts as rest, m/s.
const SETTLE_SECONDS: f64 = 0.4;
const REST_SPEED: f64 = 0.005;
/// Farthest that an anchored path is moved, m: more than this is not an error of the model but a wrong grasp.
const ANCHOR: f64 = 0.04;
/// Corner frequency of the force signal, Hz: a guard must not fire on a spike of one period.
const WRENCH_CUTOFF: f64 = 20.0;
/// Time over which an offset at the start of a joint trajectory is taken back, s.
const BLEND_SECONDS: f64 = 1.0;
/// Configurations of a trajectory for which the joints' law is tuned.
const PROBES: usize = 12;
/// Joint limits push back inside this distance, rad or m: less than what plans keep from them.
pub(crate) const LIMIT_MARGIN: f64 = 0.03;
/// Damping ratio of the tool's law.
const RATIO: f64 = 0.9;

/// How a segment stands after a period.
pub(crate) enum Outcome {
    Going,
    Done,
    Failed(Failure),
}

/// One trajectory being followed.
pub(crate) struct Following {
    follow: Follow,
    law: Controller,
    filter: WrenchFilter,
    clock: f64,
    held: f64,
    settling: f64,
    anchor: Vector3<f64>,
    direction: Vector3<f64>,
    /// Where the arm stood off the trajectory's start: this is taken back over [`BLEND_SECONDS`], not at once.
    offset: Vec<f64>,
    jacobian: Vec<Vector6<f64>>,
}

enum Controller {
    Joints(JointImpedance),
    Tool(Box<CartesianImpedance>),
}

impl Following {
    pub(crate) fn new(arm: &Arm, follow: Follow, period: f64) -> Result<Self, ControlError> {
        let start = follow.trajectory.sample(0.0).q;
        let mut anchor = Vector3::zeros();
        let way: Vec<Vec<f64>> = (0..PROBES).map(|i| follow.trajectory.at_progress(i as f64 / (PROBES - 1) as f64)).collect();
        let law = match &follow.law {
            Law::Joints => Controller::Joints(JointImpedance::tuned(&arm.model, &way)?),
            Law::Tool { along, across, turning, anchored, .. } => {
                if *anchored {
                    let miss = arm.model.X_WT().translation.vector - arm.kinematics.X_WT(&start).translation.vector;
                    anchor = miss * (ANCHOR / miss.norm().max(ANCHOR));
                }
                let [turn, shift] = CartesianImpedance::stiffest(&arm.model, &way)?;
                let (across, along) = (across.min(shift), along.min(shift));
                let stiffness = CartesianImpedance::diagonal(turning.min(turn), [across, across, along]);
                let mut law = CartesianImpedance::new(&arm.model, stiffness, Damping::Ratio(RATIO))?;
                law.limit_margin = LIMIT_MARGIN;
                law.set_posture(&Posture { q: start.clone(), stiffness: 20.0, damping: 4.0 })?;
                Controller::Tool(Box::new(law))
            }
        };
        let direction = first_direction(&follow.trajectory, &arm.kinematics);
        Ok(Self {
            law,
            filter: WrenchFilter::new(WRENCH_CUTOFF, period)?,
            clock: 0.0,
            held: 0.0,
            settling: 0.0,
            anchor,
            direction,
            offset: arm.model.q().iter().zip(&start).map(|(q, s)| q - s).collect(),
            jacobian: Vec::new(),
            follow,
        })
    }

    /// Stays where the arm is, with its joints stiff.
    pub(crate) fn hold(arm: &Arm, gripper: GripperCommand, period: f64) -> Result<Self, ControlError> {
        let trajectory = JointTrajectory::hold(arm.model.q());
        let guard = Guard::Overload { limit: f64::INFINITY };
        Self::new(arm, Follow { trajectory, law: Law::Joints, gripper, guard, least_width: 0.0 }, period)
    }

    /// Time on the trajectory's own clock, s.
    pub(crate) fn clock(&self) -> f64 {
        self.clock
    }

    pub(crate) fn step(
        &mut self,
        arm: &mut Arm,
        observation: &Observation,
        period: f64,
        command: &mut Command,
    ) -> Result<Outcome, ControlError> {
        let trajectory = &self.follow.trajectory;
        let mut reference = trajectory.sample(self.clock);
        if matches!(self.follow.law, Law::Joints) {
            let (x, dx) = fade(self.clock / BLEND_SECONDS);
            for (i, offset) in self.offset.iter().enumerate() {
                reference.q[i] += offset * x;
                reference.v[i] += offset * dx / BLEND_SECONDS;
            }
        }
        let X_WD = Translation3::from(self.anchor) * arm.kinematics.jacobian(&reference.q, &mut self.jacobian);
        let behind = (X_WD.translation.vector - arm.model.X_WT().translation.vector).norm();
        // A soft law stays behind across the path without being late.
        let late = match &self.follow.law {
            Law::Joints => behind,
            Law::Tool { .. } => (X_WD.translation.vector - arm.model.X_WT().translation.vector).dot(&self.direction).max(0.0),
        };
        let rate = (1.0 - late / LAG).clamp(0.0, 1.0);

        let mut V_WD = Vector6::zeros();
        let mut A_WD = Vector6::zeros();
        for (column, (v, a)) in self.jacobian.iter().zip(reference.v.iter().zip(&reference.a)) {
            V_WD += column * (*v * rate);
            A_WD += column * (*a * rate * rate);
        }
        let velocity = V_WD.fixed_rows::<3>(3).into_owned();
        if velocity.norm() > 1e-4 {
            self.direction = velocity.normalize();
        }
        command.gripper = self.follow.gripper;
        match &mut self.law {
            Controller::Joints(law) => {
                let v: Vec<f64> = reference.v.iter().map(|v| v * rate).collect();
                let a: Vec<f64> = reference.a.iter().map(|a| a * rate * rate).collect();
                law.step(&mut arm.model, observation, &JointReference { q: &reference.q, v: &v, a: &a }, period, command)?;
            }
            Controller::Tool(law) => {
                law.set_posture(&Posture { q: reference.q, stiffness: 20.0, damping: 4.0 })?;
                let mut F_ff = Vector6::zeros();
                if let Law::Tool { push, .. } = &self.follow.law {
                    let force = self.direction * at_share(push, trajectory.progress(self.clock));
                    F_ff.fixed_rows_mut::<3>(3).copy_from(&force);
                }
                let R_WK = UnitQuaternion::rotation_between(&Vector3::z(), &self.direction)
                    .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
                let reference = CartesianReference { X_WD, V_WD, A_WD, F_ff, R_WK };
                law.step(&mut arm.model, observation, &reference, period, command)?;
            }
        }
        self.clock += rate * period;
        Ok(self.judge(arm, observation, period, rate))
    }

    fn judge(&mut self, arm: &Arm, observation: &Observation, period: f64, rate: f64) -> Outcome {
        let trajectory = &self.follow.trajectory;
        let F_S = self.filter.step(&observation.F_S);
        let share = trajectory.progress(self.clock);
        let guard = self.follow.guard;
        if F_S.force.norm() > guard.limit() {
            let message = format!("the wrist felt {:.0} N, more than the {:.0} N allowed", F_S.force.norm(), guard.limit());
            return Outcome::Failed(failure(FailureCode::Overload, message));
        }
        if slipped(self.follow.least_width, observation.gripper_width) {
            let message = format!("the fingers closed to {:.1} mm: what they held has slipped out", observation.gripper_width * 1e3);
            return Outcome::Failed(failure(FailureCode::GraspLost, message));
        }
        if let Guard::Touch { force, direction, .. } = guard
            && -(arm.R_WS() * F_S.force).dot(&direction) > force
        {
            return Outcome::Done;
        }
        self.held = if rate < HELD_RATE { self.held + period } else { 0.0 };
        if self.held > HELD_SECONDS {
            return match guard {
                Guard::Stop { share: enough, .. } if share >= enough => Outcome::Done,
                _ => {
                    let message = format!("the hand is held up after {:.0} % of the way, at {:.0} N", share * 100.0, F_S.force.norm());
                    Outcome::Failed(failure(FailureCode::Stuck, message))
                }
            };
        }
        if self.clock < trajectory.duration() {
            return Outcome::Going;
        }
        self.settling += period;
        let speed = arm.model.V_WT().fixed_rows::<3>(3).norm();
        if self.settling > SETTLE_SECONDS || (self.settling > 0.1 && speed < REST_SPEED) { Outcome::Done } else { Outcome::Going }
    }
}

/// Direction in which the tool sets off.
fn first_direction(trajectory: &JointTrajectory, kinematics: &ArmKinematics) -> Vector3<f64> {
    let at = |s: f64| -> Isometry3<f64> { kinematics.X_WT(&trajectory.at_progress(s)) };
    let from = at(0.0).translation.vector;
    [0.01, 0.1, 1.0].iter().map(|s| at(*s).translation.vector - from).find(|d| d.norm() > 1e-5).map_or(Vector3::z(), |d| d.normalize())
}

/// From one to zero over 0..1 with no slope at either end, and its slope.
fn fade(x: f64) -> (f64, f64) {
    let x = x.clamp(0.0, 1.0);
    (1.0 - x * x * (3.0 - 2.0 * x), 6.0 * x * (x - 1.0))
}

/// Linear interpolation in evenly spaced values.
fn at_share(values: &[f64], share: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let x = share.clamp(0.0, 1.0) * last as f64;
    let (i, w) = (x.floor() as usize, x.fract());
    values[i] * (1.0 - w) + values[(i + 1).min(last)] * w
}

/// Has what the fingers hold slipped out? Where they hold nothing they may shut: then a sensor reads a little less than zero.
fn slipped(least_width: f64, width: f64) -> bool {
    least_width > 0.0 && width < least_width
}

#[cfg(test)]
mod tests {
    use super::slipped;

    #[test]
    fn shut_fingers_that_hold_nothing_have_lost_nothing() {
        assert!(!slipped(0.0, -1e-4), "a hand that lost its hold goes back with its fingers shut");
        assert!(slipped(0.01, 0.004) && slipped(0.01, -1e-4) && !slipped(0.01, 0.02));
    }
}
