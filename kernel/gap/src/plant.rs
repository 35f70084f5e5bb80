//! The model under test, driven by what was measured.

use nalgebra::DMatrix;
use sagci_dynamics::{Input, Part, State, StepWorkspace, System};
use sagci_model::{ActuatorLaw, JointKind, ObjectModel};
use sagci_recording::CommandKind;

use crate::GapError;
use crate::trajectory::{Drive, Trajectory};

/// A simulator with the laws of its drives.
#[derive(Debug, Clone)]
pub(crate) struct Plant {
    pub system: System,
    laws: Vec<Option<ActuatorLaw>>,
    /// Longest step, s.
    pub step: f64,
}

/// How many times more steps are tried where one fails.
const FINER: f64 = 8.0;

/// What changes while a plant moves.
#[derive(Debug)]
pub(crate) struct Motion {
    pub state: State,
    pub ws: StepWorkspace,
    tau: Vec<f64>,
    before: Vec<f64>,
    /// Accelerations over the last interval.
    pub acceleration: Vec<f64>,
}

impl Motion {
    /// Efforts of the drives in the last step.
    pub fn tau(&self) -> &[f64] {
        &self.tau
    }
}

impl Plant {
    /// `limits` says of which joints the URDF's limits are kept.
    pub fn new(model: &ObjectModel, limits: &[bool], step: f64) -> Result<Self, GapError> {
        let mut open = model.clone();
        let moving: Vec<usize> = model.moving_joints().collect();
        for (slot, i) in moving.iter().enumerate() {
            if !limits.get(slot).copied().unwrap_or(true) {
                let limits = &mut open.joints[*i].limits;
                (limits.lower, limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
                if open.joints[*i].kind == JointKind::Revolute {
                    open.joints[*i].kind = JointKind::Continuous;
                }
            }
        }
        let law = |i: &usize| model.document.actuators.iter().find(|a| a.joint == model.joints[*i].name).map(|a| a.law.clone());
        let laws = moving.iter().map(law).collect();
        Ok(Self { system: System::new(&[Part::welded(&open, nalgebra::Isometry3::identity())])?, laws, step })
    }

    pub fn motion(&self) -> Motion {
        let n = self.system.multibody().nv();
        Motion {
            state: self.system.state(),
            ws: self.system.workspace(),
            tau: vec![0.0; n],
            before: vec![0.0; n],
            acceleration: vec![0.0; n],
        }
    }

    /// Effort of the drive of joint `j` at `q`, `v`.
    fn effort(&self, j: usize, drive: Drive, u: f64, q: f64, v: f64) -> f64 {
        let Drive::Command(kind) = drive else {
            return if drive == Drive::Effort && u.is_finite() { u } else { 0.0 };
        };
        // An empty command is an open circuit.
        if !u.is_finite() {
            return 0.0;
        }
        let clip = |x: f64, most: f64| x.clamp(-most, most);
        match &self.laws[j] {
            None => u,
            Some(ActuatorLaw::Torque { max_effort }) => clip(u, *max_effort),
            Some(ActuatorLaw::PositionServo { stiffness, damping, max_effort }) => clip(stiffness * (u - q) - damping * v, *max_effort),
            Some(ActuatorLaw::DcMotor { torque_constant, resistance, gain, max_voltage }) => {
                let voltage = match (kind, gain) {
                    (CommandKind::Position, Some(gain)) => gain * (u - q),
                    _ => u,
                };
                torque_constant * (clip(voltage, *max_voltage) - torque_constant * v) / resistance
            }
        }
    }

    /// From row `k` to the next.
    ///
    /// Steps take positions from the next velocity; over an interval the mean of old and new velocity is right to second order,
    /// so the sum of the steps is set right by `h / 2 (v_0 - v_n)`.
    pub fn interval(&self, motion: &mut Motion, trajectory: &Trajectory, k: usize) -> Result<(), GapError> {
        let n = trajectory.joints;
        let duration = trajectory.time[k + 1] - trajectory.time[k];
        let steps = (duration / self.step - 1e-6).ceil().max(1.0);
        motion.before.copy_from_slice(&motion.state.v);
        motion.state.time = trajectory.time[k];
        let mut h = duration / steps;
        if self.steps(motion, trajectory, k, h, steps as usize).is_err() {
            // A stiff effect can want shorter steps for once. The state is that at which the step failed; the rest of the interval follows.
            let rest = trajectory.time[k + 1] - motion.state.time;
            h = rest / (FINER * steps);
            self.steps(motion, trajectory, k, h, (FINER * steps) as usize)?;
        }
        for j in 0..n {
            let change = motion.state.v[j] - motion.before[j];
            motion.state.q[j] -= 0.5 * h * change;
            motion.acceleration[j] = change / duration;
        }
        Ok(())
    }

    fn steps(&self, motion: &mut Motion, trajectory: &Trajectory, k: usize, h: f64, count: usize) -> Result<(), GapError> {
        let n = trajectory.joints;
        for _ in 0..count {
            for j in 0..n {
                let (u, drive) = (trajectory.input[k * n + j], trajectory.drive[j]);
                motion.tau[j] = self.effort(j, drive, u, motion.state.q[j], motion.state.v[j]);
            }
            self.system.step(&mut motion.ws, &mut motion.state, &Input { tau: &motion.tau, external: &[] }, h)?;
        }
        Ok(())
    }

    /// Appends the inverse of the mass matrix at the state. One that cannot be had is zero.
    pub fn inverse_mass(&self, motion: &mut Motion, into: &mut Vec<f64>) {
        let multibody = self.system.multibody();
        let n = multibody.nv();
        let rigid = motion.ws.rigid();
        let found = multibody.set_state(rigid, &motion.state.q, &motion.state.v).and_then(|()| multibody.mass_matrix(rigid).cloned());
        match found.ok().and_then(nalgebra::Cholesky::new) {
            Some(factor) => into.extend_from_slice(factor.inverse().as_slice()),
            None => into.extend(std::iter::repeat_n(0.0, n * n)),
        }
    }

    /// Inverse of the mass matrix at positions, by columns.
    pub fn inverse_mass_at(&self, q: &[f64]) -> Vec<f64> {
        let multibody = self.system.multibody();
        let n = multibody.nv();
        let mut ws = multibody.workspace();
        let mass = multibody.set_state(&mut ws, q, &vec![0.0; n]).and_then(|()| multibody.mass_matrix(&mut ws).cloned());
        let inverse = mass.ok().and_then(nalgebra::Cholesky::new).map_or_else(|| DMatrix::identity(n, n), |f| f.inverse());
        inverse.as_slice().to_vec()
    }

    /// The position that is read on joint `j` at the state's time, by its stamp.
    pub fn reading(&self, motion: &Motion, j: usize) -> f64 {
        let reading = self.system.measure(&motion.state, 0.0, j);
        // What is stamped late by s was true s ago.
        let late = reading.stamp.value - motion.state.time;
        let (v, a) = (motion.state.v[j], motion.acceleration[j]);
        reading.position.value - late * reading.position.d_q * (v - 0.5 * late * a)
    }

    /// Keeps positions between the limits that are kept.
    pub fn clamp(&self, motion: &mut Motion) {
        for joint in self.system.multibody().joints() {
            let (lower, upper) = (joint.limits.lower, joint.limits.upper);
            if lower <= upper {
                let q = &mut motion.state.q[joint.q.start];
                *q = q.clamp(lower, upper);
            }
        }
    }
}
