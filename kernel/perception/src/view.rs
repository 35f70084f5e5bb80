use nalgebra::Isometry3;
use sagci_model::{JointKind, ObjectModel};
use sagci_signal::{DepthImage, Observation};

use crate::PerceptionError;

/// One image, where it was taken from, and what is known to be in it.
#[derive(Debug, Clone)]
pub struct View {
    /// The image.
    pub image: DepthImage,
    /// Pose of the camera's optical frame in the world.
    pub X_WC: Isometry3<f64>,
    /// Bodies whose place is known (the robot's links, a held object): their points are taken out of the cloud.
    pub known: Vec<KnownBody>,
}

/// A body whose place is known.
#[derive(Debug, Clone)]
pub struct KnownBody {
    /// Its model.
    pub model: std::sync::Arc<ObjectModel>,
    /// Poses of its links in the world, in the model's order.
    pub X_WL: Vec<Isometry3<f64>>,
}

impl View {
    /// An image that is free of known bodies.
    pub fn new(image: DepthImage, X_WC: Isometry3<f64>) -> Self {
        Self { image, X_WC, known: Vec::new() }
    }

    /// An image of the robot's own camera, taken when the sensors said what `observation` says.
    pub fn of_wrist(
        robot: &std::sync::Arc<ObjectModel>,
        X_WR: &Isometry3<f64>,
        observation: &Observation,
        image: DepthImage,
    ) -> Result<Self, PerceptionError> {
        let q = robot_positions(robot, observation)?;
        let X_WL: Vec<_> = robot.X_OL(&q).iter().map(|X_RL| X_WR * X_RL).collect();
        let X_WC = X_WC(robot, &X_WL)?;
        Ok(Self { image, X_WC, known: vec![KnownBody { model: robot.clone(), X_WL }] })
    }

    /// Adds a body whose place is known, for example an object in the gripper.
    pub fn with_known(mut self, model: &std::sync::Arc<ObjectModel>, X_WO: &Isometry3<f64>, q: &[f64]) -> Self {
        let X_WL = model.X_OL(q).iter().map(|X_OL| X_WO * X_OL).collect();
        self.known.push(KnownBody { model: model.clone(), X_WL });
        self
    }
}

/// Positions of all moving joints of a robot, in the model's order, from what its sensors say: the arm's encoders, and
/// half of the gripper's opening for each finger.
pub fn robot_positions(robot: &ObjectModel, observation: &Observation) -> Result<Vec<f64>, PerceptionError> {
    let refuse = |message: String| PerceptionError::Request { object: robot.name.clone(), message };
    let facts = robot.document.robot.as_ref().ok_or_else(|| refuse("is not a robot: its model.yaml has no 'robot' section".into()))?;
    if observation.q.len() != facts.arm_joints.len() {
        return Err(refuse(format!("has {} arm joints, but the sensors give {} positions", facts.arm_joints.len(), observation.q.len())));
    }
    Ok(robot
        .moving_joints()
        .map(|i| {
            let joint = &robot.joints[i];
            if let Some(slot) = facts.arm_joints.iter().position(|n| *n == joint.name) {
                observation.q[slot]
            } else if joint.kind == JointKind::Prismatic && facts.gripper.fingers.iter().any(|f| f.joint == joint.name) {
                observation.gripper_width / 2.0
            } else {
                0.0
            }
        })
        .collect())
}

/// Pose of the robot's camera in the world, from the poses of its links in the world.
#[allow(non_snake_case)]
pub fn X_WC(robot: &ObjectModel, X_WL: &[Isometry3<f64>]) -> Result<Isometry3<f64>, PerceptionError> {
    let refuse = |message: String| PerceptionError::Request { object: robot.name.clone(), message };
    let camera = robot.document.robot.as_ref().map(|r| &r.camera).ok_or_else(|| refuse("has no camera".into()))?;
    let link = robot.link(&camera.link).ok_or_else(|| refuse(format!("has no link '{}' to carry the camera", camera.link)))?;
    let X_WL = X_WL.get(link).ok_or_else(|| refuse("poses of its links are missing".into()))?;
    Ok(X_WL * camera.X_LC.isometry())
}
