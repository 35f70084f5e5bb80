//! A world made up by a test: the arm's rigid-body dynamics, and objects that are where the test says.

use std::path::Path;
use std::sync::{Arc, Mutex};

use nalgebra::{DVector, Isometry3, Matrix6};
use sagci_control::ArmModel;
use sagci_perception::{Located, PerceptionError, SceneRequest, View};
use sagci_script::host::{Perceive, WorldSource};
use sagci_signal::{Command, DepthImage, Observation};
use sagci_world::recording::{Journal, RunRecord};
use sagci_world::{Scene, World, WorldError};

/// What is true of one object: its name, its pose, its joints, and whether the camera sees it.
pub type Truth = Arc<Mutex<Vec<(String, Isometry3<f64>, Vec<f64>, bool)>>>;

/// The arm moves as its model says; nothing touches anything.
pub struct FakeWorld {
    arm: Option<ArmModel>,
    observation: Observation,
}

impl World for FakeWorld {
    fn period(&self) -> f64 {
        1e-3
    }

    fn reset(&mut self, scene: &Scene, _: u64) -> Result<(), WorldError> {
        let robot = scene.robot.document.robot.as_ref().unwrap();
        let q = robot.configurations.iter().find(|c| c.name == scene.start).unwrap().q.clone();
        self.arm = Some(ArmModel::new(&scene.robot, Isometry3::identity()).unwrap());
        self.observation = Observation { v: vec![0.0; q.len()], tau: vec![0.0; q.len()], q, gripper_width: 0.08, ..Observation::default() };
        Ok(())
    }

    fn observe(&self) -> Observation {
        self.observation.clone()
    }

    fn look(&mut self) -> Result<DepthImage, WorldError> {
        Ok(DepthImage {
            time: self.observation.time,
            width: 1,
            height: 1,
            focal: [1.0; 2],
            center: [0.0; 2],
            depth: vec![1.0],
            rgb: vec![[0; 3]],
        })
    }

    fn advance(&mut self, command: &Command) -> Result<(), WorldError> {
        let o = &mut self.observation;
        if command.tau.len() != o.q.len() || command.tau.iter().any(|t| !t.is_finite()) {
            return Err(WorldError::Command { time: o.time, message: "is not a command".to_owned() });
        }
        let arm = self.arm.as_mut().unwrap();
        arm.update(&o.q, &o.v, o.gripper_width).unwrap();
        let force = DVector::from_iterator(o.q.len(), command.tau.iter().zip(arm.bias()).map(|(tau, bias)| tau - bias));
        let a = arm.mass_matrix().clone().cholesky().unwrap().solve(&force);
        for i in 0..o.q.len() {
            o.v[i] += a[i] * 1e-3;
            o.q[i] += o.v[i] * 1e-3;
        }
        o.tau.clone_from(&command.tau);
        let close = command.gripper.width < o.gripper_width;
        o.gripper_width += (command.gripper.width - o.gripper_width).clamp(-1e-4, 1e-4);
        o.gripper_force = if close { command.gripper.force } else { 0.0 };
        o.time += 1e-3;
        Ok(())
    }
}

/// Makes such worlds.
pub struct FakeWorlds;

impl WorldSource for FakeWorlds {
    fn kind(&self) -> &str {
        "made up"
    }

    fn open(&self, _: Option<(&Path, &RunRecord)>) -> Result<(Box<dyn World>, Option<Journal>), String> {
        Ok((Box::new(FakeWorld { arm: None, observation: Observation::default() }), None))
    }
}

/// Eyes that see what the test says.
pub struct FakeEyes(pub Truth);

impl Perceive for FakeEyes {
    fn locate(&self, _: &[View], _: f64, requests: &[SceneRequest<'_>]) -> Result<Vec<Result<Located, PerceptionError>>, PerceptionError> {
        let truth = self.0.lock().unwrap();
        let answer = |r: &SceneRequest<'_>| match truth.iter().find(|(n, _, _, seen)| *n == r.name && *seen) {
            None => Err(PerceptionError::NotVisible { object: r.name.clone(), hidden_share: 1.0, best_visible_share: 0.0 }),
            Some((_, X_WO, q, _)) => Ok(Located {
                X_WO: *X_WO,
                q: q.clone(),
                covariance: Matrix6::identity() * 1e-6,
                q_deviation: vec![0.0; q.len()],
                residual_rms: 0.001,
                inlier_share: 1.0,
                violated_share: 0.0,
                visible_share: 1.0,
                pixels: 1000,
                rivals: 1,
            }),
        };
        Ok(requests.iter().map(answer).collect())
    }
}
