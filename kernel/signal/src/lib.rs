//! What crosses between a robot, its controller and its skills: plain data, SI units, no behaviour.
//!
//! Frames in Drake's monogram notation: `W` world, `O` an object's root link, `T` the tool frame between the finger
//! pads, `C` the camera's optical frame, `S` the wrist sensor's frame.
#![forbid(unsafe_code)]

use nalgebra::{Isometry3, Matrix6, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// What the robot's sensors say at one instant.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Observation {
    /// Time since the world was reset, s.
    pub time: f64,
    /// Positions of the arm joints, rad or m.
    pub q: Vec<f64>,
    /// Velocities of the arm joints, rad/s or m/s.
    pub v: Vec<f64>,
    /// Efforts that the drives gave over the last period, N m or N.
    pub tau: Vec<f64>,
    /// Opening between the finger pads, m.
    pub gripper_width: f64,
    /// Force with which each finger presses inward, N.
    pub gripper_force: f64,
    /// What the world does to the hand, measured at the wrist, in the sensor's frame, at its origin; the hand's own
    /// weight is taken out.
    pub F_S: Wrench,
}

/// A force and a torque.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Wrench {
    /// Force, N.
    pub force: Vector3<f64>,
    /// Torque, N m.
    pub torque: Vector3<f64>,
}

/// What the controller asks of the robot for the next period.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Command {
    /// Efforts of the arm joints, N m or N, gravity compensation included.
    pub tau: Vec<f64>,
    /// What the gripper does.
    pub gripper: GripperCommand,
}

/// Moves the fingers toward an opening with a limited force, like a Franka hand's `grasp` and `move`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperCommand {
    /// Opening that is aimed at, m.
    pub width: f64,
    /// Greatest force of each finger, N.
    pub force: f64,
}

impl Default for GripperCommand {
    fn default() -> Self {
        Self { width: 0.08, force: 20.0 }
    }
}

/// An image of the wrist camera. Row-major, optical axes x right, y down, z forward.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DepthImage {
    /// Time it was taken, s.
    pub time: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub center: [f64; 2],
    /// Depth along z, m; 0 where nothing was measured.
    pub depth: Vec<f32>,
    /// Colours as red, green, blue.
    pub rgb: Vec<[u8; 3]>,
}

impl DepthImage {
    /// The measured points in the camera's frame, with their pixel's index.
    pub fn points(&self) -> impl Iterator<Item = (usize, Point3<f64>)> + '_ {
        self.depth.iter().enumerate().filter(|(_, d)| **d > 0.0).map(|(i, d)| {
            let (column, row, z) = ((i % self.width) as f64, (i / self.width) as f64, f64::from(*d));
            (i, Point3::new((column - self.center[0]) / self.focal[0] * z, (row - self.center[1]) / self.focal[1] * z, z))
        })
    }
}

/// What the robot believes about one object of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectBelief {
    /// Its name in the scene.
    pub name: String,
    /// Folder of the object model's version.
    pub model: std::path::PathBuf,
    /// Pose of its root link in the world.
    pub X_WO: Isometry3<f64>,
    /// Positions of its moving joints, in the model's order.
    pub q: Vec<f64>,
    /// Covariance of the pose (turn, then shift; rad and m), about the world's axes at the object's origin.
    pub covariance: Matrix6<f64>,
    /// The gripper holds it: pose of the object in the tool frame.
    pub X_TO: Option<Isometry3<f64>>,
    /// It was seen by the camera, and not only announced.
    pub seen: bool,
}

/// What the robot believes about the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneBelief {
    /// Folder of the robot's model version.
    pub robot: std::path::PathBuf,
    /// Pose of the robot's root link in the world.
    pub X_WR: Isometry3<f64>,
    /// Height of the surface that things stand on, m.
    pub table_height: f64,
    /// Gravity in the world, m/s^2.
    pub gravity: Vector3<f64>,
    /// The objects.
    pub objects: Vec<ObjectBelief>,
}

impl SceneBelief {
    /// An object by its name in the scene.
    pub fn object(&self, name: &str) -> Option<&ObjectBelief> {
        self.objects.iter().find(|o| o.name == name)
    }
}
