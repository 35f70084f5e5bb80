//! The host's own motions: it moves the arm to look, holds it between skills, and brings it to rest when a skill cannot.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use sagci_control::{ArmModel, ControlError, JointImpedance, JointReference, Payload};
use sagci_model::ObjectModel;
use sagci_signal::{Command, GripperCommand, Observation};

/// Stiffness of a joint for each unit of its greatest effort, 1/rad (1/m), at most: a drive at its limit is off by 0.14 rad.
const STIFFNESS: f64 = 7.0;
/// Greatest natural frequency of a joint, rad/s. A damper faster than the sensors' filter would shake the joints whose
/// own inertia is small, such as two that lie on one line.
const FREQUENCY: f64 = 80.0;
/// Damping ratio at that inertia.
const RATIO: f64 = 0.9;
/// Effort of a joint whose model names no limit, N m or N.
const UNLIMITED: f64 = 50.0;

/// The arm under the host's own control.
pub struct HostArm {
    model: ArmModel,
    law: JointImpedance,
    period: f64,
    /// What the gripper is to do while the host moves the arm: what the last skill left it doing.
    pub gripper: GripperCommand,
    command: Command,
}

impl HostArm {
    /// For a robot whose root link stands at `X_WR`.
    pub fn new(robot: &ObjectModel, X_WR: Isometry3<f64>, gravity: Vector3<f64>, period: f64) -> Result<Self, ControlError> {
        let mut model = ArmModel::new(robot, X_WR)?;
        model.set_gravity(gravity);
        let zero = vec![0.0; model.n()];
        let law = JointImpedance::new(&model, &zero, &zero)?;
        let open = robot.document.robot.as_ref().map_or(0.0, |r| r.gripper.max_width);
        let gripper = GripperCommand { width: open, force: GripperCommand::default().force };
        Ok(Self { model, law, period, gripper, command: Command::default() })
    }

    /// Sets the gains for a motion through these configurations: as stiff as the least inertia that each joint feels on the
    /// way allows, when the others are free.
    pub fn tune(&mut self, way: &[Vec<f64>]) -> Result<(), ControlError> {
        let n = self.model.n();
        let (mut probe, zero) = (self.model.clone(), vec![0.0; n]);
        let mut inertia = vec![f64::INFINITY; n];
        for q in way {
            probe.update(q, &zero, 0.0)?;
            let Some(inverse) = probe.mass_matrix().clone().try_inverse() else { continue };
            inertia.iter_mut().enumerate().for_each(|(j, m)| *m = m.min(1.0 / inverse[(j, j)]));
        }
        let effort = |e: f64| if e.is_finite() && e > 0.0 { e } else { UNLIMITED };
        let most = self.model.limits().iter().map(|l| STIFFNESS * effort(l.effort));
        let stiffness: Vec<f64> = inertia.iter().zip(most).map(|(m, most)| (m * FREQUENCY * FREQUENCY).min(most)).collect();
        let damping: Vec<f64> = stiffness.iter().zip(&inertia).map(|(k, m)| 2.0 * RATIO * (k * m).sqrt()).collect();
        self.law = JointImpedance::new(&self.model, &stiffness, &damping)?;
        Ok(())
    }

    /// The object that the gripper holds from now on, with its pose in the tool frame.
    pub fn carry(&mut self, held: Option<(&ObjectModel, &Isometry3<f64>, &[f64])>) -> Result<(), ControlError> {
        let payload = held.map(|(model, X_TO, q)| payload(model, X_TO, q));
        self.model.set_payload(payload.as_ref())
    }

    /// The command that takes the arm toward a reference.
    pub fn toward(&mut self, observation: &Observation, q: &[f64], v: &[f64], a: &[f64]) -> Result<&Command, ControlError> {
        self.command.gripper = self.gripper;
        self.law.step(&mut self.model, observation, &JointReference { q, v, a }, self.period, &mut self.command)?;
        Ok(&self.command)
    }
}

/// The mass properties of a whole object in the tool frame.
fn payload(model: &ObjectModel, X_TO: &Isometry3<f64>, q: &[f64]) -> Payload {
    let parts: Vec<(f64, Point3<f64>, Matrix3<f64>)> = model
        .links
        .iter()
        .zip(model.X_OL(q))
        .map(|(link, X_OL)| {
            let X_TL = X_TO * X_OL;
            let R = X_TL.rotation.to_rotation_matrix();
            (link.inertial.mass, X_TL * link.inertial.p_LoLcm, R * link.inertial.I_LLcm_L * R.transpose())
        })
        .collect();
    let mass: f64 = parts.iter().map(|p| p.0).sum();
    if mass <= 0.0 {
        return Payload { mass: 0.0, p_TCm: Point3::origin(), I_Cm_T: Matrix3::zeros() };
    }
    let center = Point3::from(parts.iter().map(|(m, p, _)| p.coords * *m).sum::<Vector3<f64>>() / mass);
    // Steiner's theorem for each part.
    let inertia = parts
        .iter()
        .map(|(m, p, I)| {
            let d = p - center;
            I + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * *m
        })
        .sum();
    Payload { mass, p_TCm: center, I_Cm_T: inertia }
}
