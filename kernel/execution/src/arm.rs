use nalgebra::{Isometry3, UnitQuaternion};
use sagci_control::{ArmModel, ControlError};
use sagci_model::ObjectModel;
use sagci_planning::{ArmKinematics, PlanError};
use sagci_signal::SceneBelief;
use sagci_skill::{Failure, FailureCode};

/// The arm as it is controlled: its dynamics, and its kinematics at configurations other than the present one.
pub struct Arm {
    /// Dynamics at the measured state.
    pub model: ArmModel,
    /// Kinematics anywhere.
    pub kinematics: ArmKinematics,
    R_TS: UnitQuaternion<f64>,
}

impl Arm {
    /// The robot of a belief, with its model read.
    ///
    /// # Errors
    /// [`FailureCode::ModelLacks`] if the model is not a robot arm.
    pub fn new(robot: &ObjectModel, belief: &SceneBelief) -> Result<Self, Failure> {
        let lacks = |message: String| Failure { code: FailureCode::ModelLacks, stage: "robot".into(), message };
        let mut model = ArmModel::new(robot, belief.X_WR).map_err(|e: ControlError| lacks(e.to_string()))?;
        model.set_gravity(belief.gravity);
        let kinematics = ArmKinematics::new(robot, &belief.X_WR).map_err(|e: PlanError| lacks(e.to_string()))?;
        let section = robot.document.robot.as_ref().ok_or_else(|| lacks("has no robot section".into()))?;
        let X_OL = robot.X_OL(&[]);
        let pose = |link: &str| -> Result<Isometry3<f64>, Failure> {
            robot.link(link).map(|i| X_OL[i]).ok_or_else(|| lacks(format!("has no link '{link}'")))
        };
        // The sensor and the tool sit on the same rigid hand, so that their relation does not depend on the joints.
        let X_OT = pose(&section.gripper.link)? * section.gripper.X_LT.isometry();
        let R_TS = X_OT.rotation.inverse() * pose(&section.wrist_link)?.rotation;
        Ok(Self { model, kinematics, R_TS })
    }

    /// Orientation of the wrist's force sensor in the world.
    pub fn R_WS(&self) -> UnitQuaternion<f64> {
        self.model.X_WT().rotation * self.R_TS
    }
}

/// A failure whose stage is filled in by the sequence.
pub(crate) fn failure(code: FailureCode, message: String) -> Failure {
    Failure { code, stage: String::new(), message }
}
