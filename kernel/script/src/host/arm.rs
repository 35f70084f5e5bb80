//! The host's own motions: it moves the arm to look, holds it between skills, and brings it to rest when a skill cannot.

use nalgebra::{Isometry3, Vector3};
use sagci_control::{ArmModel, ControlError, JointImpedance, JointReference, Payload};
use sagci_model::ObjectModel;
use sagci_signal::{Command, GripperCommand, Observation};

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

    /// Sets the gains for a motion through these configurations.
    pub fn tune(&mut self, way: &[Vec<f64>]) -> Result<(), ControlError> {
        self.law = JointImpedance::tuned(&self.model, way)?;
        Ok(())
    }

    /// The object that the gripper holds from now on, with its pose in the tool frame.
    pub fn carry(&mut self, held: Option<(&ObjectModel, &Isometry3<f64>, &[f64])>) -> Result<(), ControlError> {
        let payload = held.map(|(model, X_TO, q)| Payload::of(model, X_TO, q));
        self.model.set_payload(payload.as_ref())
    }

    /// The command that takes the arm toward a reference.
    pub fn toward(&mut self, observation: &Observation, q: &[f64], v: &[f64], a: &[f64]) -> Result<&Command, ControlError> {
        self.command.gripper = self.gripper;
        self.law.step(&mut self.model, observation, &JointReference { q, v, a }, self.period, &mut self.command)?;
        Ok(&self.command)
    }
}
