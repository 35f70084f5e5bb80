//! Moves the fingers while the hand stays, or yields.

use nalgebra::Isometry3;
use sagci_control::{CartesianImpedance, CartesianReference, ControlError, Damping};
use sagci_signal::{Command, Observation};
use sagci_skill::FailureCode;

use crate::Fingers;
use crate::arm::{Arm, failure};
use crate::follow::{LIMIT_MARGIN, Outcome};

/// The fingers rest when they have moved less than this, m, over this time, s.
const REST_WIDTH: f64 = 3e-4;
const REST_SECONDS: f64 = 0.15;

/// A movement of the fingers under way.
pub(crate) struct Fingering {
    fingers: Fingers,
    law: Box<CartesianImpedance>,
    X_WD: Isometry3<f64>,
    since: f64,
    still: f64,
    width: f64,
}

impl Fingering {
    pub(crate) fn new(arm: &Arm, fingers: Fingers, observation: &Observation) -> Result<Self, ControlError> {
        let along_opening = if fingers.yielding { 60.0 } else { 1500.0 };
        let [turn, shift] = CartesianImpedance::stiffest(&arm.model, &[arm.model.q().to_vec()])?;
        let across = shift.min(1500.0);
        let stiffness = CartesianImpedance::diagonal(turn.min(60.0), [across, shift.min(along_opening), across]);
        let mut law = Box::new(CartesianImpedance::new(&arm.model, stiffness, Damping::Ratio(1.0))?);
        law.limit_margin = LIMIT_MARGIN;
        Ok(Self { fingers, law, X_WD: *arm.model.X_WT(), since: observation.time, still: 0.0, width: observation.gripper_width })
    }

    pub(crate) fn step(
        &mut self,
        arm: &mut Arm,
        observation: &Observation,
        period: f64,
        command: &mut Command,
    ) -> Result<Outcome, ControlError> {
        self.law.step(&mut arm.model, observation, &CartesianReference::at(self.X_WD), period, command)?;
        command.gripper = self.fingers.gripper;

        let width = observation.gripper_width;
        if (width - self.width).abs() > REST_WIDTH {
            self.width = width;
            self.still = 0.0;
        } else {
            self.still += period;
        }
        let there = (width - self.fingers.gripper.width).abs() < 0.002;
        let pressing = observation.gripper_force > 0.5 * self.fingers.gripper.force;
        let resting = self.still > REST_SECONDS && (there || pressing);
        let late = observation.time - self.since > self.fingers.timeout;
        if !resting && !late {
            return Ok(Outcome::Going);
        }
        let [least, greatest] = self.fingers.expected;
        if (least..=greatest).contains(&width) {
            return Ok(Outcome::Done);
        }
        let message = format!(
            "the fingers came to rest {:.1} mm apart instead of between {:.1} and {:.1} mm",
            width * 1e3,
            least * 1e3,
            greatest * 1e3
        );
        Ok(Outcome::Failed(failure(FailureCode::GraspLost, message)))
    }
}
