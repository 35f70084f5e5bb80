//! Joint impedance with inverse-dynamics feed-forward (Paden and Panja 1988, "PD+"; Siciliano et al. 2009, section 8.5):
//! `tau = M(q) a_d + c(q, v) + g(q) + K (q_d - q) + D (v_d - v)`.
//!
//! Where the model is right, the error obeys `M e'' + D e' + K e = 0`: the tracking of a smooth reference needs no stiffness.

use sagci_signal::{Command, Observation};

use crate::error::{check, check_not_negative};
use crate::{ArmModel, ControlError, EffortLimit};

/// Stiffness of a joint for each unit of its greatest effort, 1/rad (1/m), at most: a drive at its limit is then off by 0.14 rad.
const STIFFNESS: f64 = 7.0;
/// Greatest natural frequency under a law, rad/s: velocities come filtered at about 100 Hz, and a law that is faster than its
/// sensors shakes the arm.
pub(crate) const FREQUENCY: f64 = 80.0;
/// Damping ratio.
const RATIO: f64 = 0.9;
/// Effort of a joint whose model names no limit, N m or N.
const UNLIMITED: f64 = 50.0;

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

    /// As stiff as an arm can be held on its way through these configurations.
    ///
    /// What a joint's spring and damper feel is its inertia with the other joints free, `m_i = 1 / (M^-1)_ii`: where two axes
    /// come to lie in line it is far less than `M_ii`. The least `m_i` on the way bounds the stiffness by the frequency that
    /// the sensors' delay leaves stable; the damping follows from both.
    ///
    /// # Errors
    /// A configuration of the wrong length, or with a number that is not finite.
    pub fn tuned(arm: &ArmModel, way: &[Vec<f64>]) -> Result<Self, ControlError> {
        let (mut probe, zero) = (arm.clone(), vec![0.0; arm.n()]);
        let mut inertia = vec![f64::INFINITY; arm.n()];
        for q in way {
            probe.update(q, &zero, 0.0)?;
            let Some(inverse) = probe.mass_matrix().clone().try_inverse() else { continue };
            inertia.iter_mut().enumerate().for_each(|(j, m)| *m = m.min(1.0 / inverse[(j, j)]));
        }
        let effort = |e: f64| if e.is_finite() && e > 0.0 { e } else { UNLIMITED };
        let most = arm.limits().iter().map(|l| STIFFNESS * effort(l.effort));
        let stiffness: Vec<f64> = inertia.iter().zip(most).map(|(m, most)| (m * FREQUENCY * FREQUENCY).min(most)).collect();
        let damping: Vec<f64> =
            stiffness.iter().zip(&inertia).map(|(k, m)| if m.is_finite() { 2.0 * RATIO * (k * m).sqrt() } else { k / FREQUENCY }).collect();
        Self::new(arm, &stiffness, &damping)
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
