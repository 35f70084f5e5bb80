//! Joint impedance with inverse-dynamics feed-forward (Paden and Panja 1988, "PD+"; Siciliano et al. 2009, section 8.5):
//! `tau = M(q) a_d + c(q, v) + g(q) + K (q_d - q) + D (v_d - v)`.
//!
//! Where the model is right, the error obeys `M e'' + D e' + K e = 0`: the tracking of a smooth reference needs no stiffness.

use sagci_signal::{Command, Observation};

use crate::error::{check, check_not_negative};
use crate::{ArmModel, ControlError, EffortLimit};

/// Where the joints are to be, one entry a joint.
#[derive(Debug, Clone, Copy)]
pub struct JointReference<'a> {
    /// Positions, rad or m.
    pub q: &'a [f64],
    /// Velocities.
    pub v: &'a [f64],
    /// Accelerations.
    pub a: &'a [f64],
}

/// Holds each joint to a reference by a spring and a damper.
#[derive(Debug, Clone)]
pub struct JointImpedance {
    stiffness: Vec<f64>,
    damping: Vec<f64>,
    /// Limits of the efforts.
    pub limit: EffortLimit,
}

impl JointImpedance {
    /// With gains by joint: stiffness in N m/rad (N/m) and damping in N m s/rad (N s/m).
    ///
    /// # Errors
    /// A gain that is negative or not finite, or a wrong number of them.
    pub fn new(arm: &ArmModel, stiffness: &[f64], damping: &[f64]) -> Result<Self, ControlError> {
        check_not_negative("joint stiffness", stiffness, arm.n())?;
        check_not_negative("joint damping", damping, arm.n())?;
        Ok(Self { stiffness: stiffness.to_vec(), damping: damping.to_vec(), limit: EffortLimit::new(arm) })
    }

    /// Takes in what the sensors say and writes the efforts for the next `period` (s) into the command.
    ///
    /// # Errors
    /// A vector of the wrong length or a number that is not finite; the command is then left as it was.
    pub fn step(
        &mut self,
        arm: &mut ArmModel,
        observation: &Observation,
        reference: &JointReference<'_>,
        period: f64,
        command: &mut Command,
    ) -> Result<(), ControlError> {
        check("reference q", reference.q, arm.n())?;
        check("reference v", reference.v, arm.n())?;
        check("reference a", reference.a, arm.n())?;
        check("period", &[period], 1)?;
        arm.observe(observation)?;
        command.tau.resize(arm.n(), 0.0);
        arm.inverse_dynamics(reference.a, &mut command.tau)?;
        for (i, tau) in command.tau.iter_mut().enumerate() {
            *tau += self.stiffness[i] * (reference.q[i] - arm.q()[i]) + self.damping[i] * (reference.v[i] - arm.v()[i]);
        }
        self.limit.apply(&mut command.tau, period);
        Ok(())
    }
}
