//! The shipped models, in scenes that the tests share.
#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;
use sagci_planning::{ArmKinematics, Scene, SceneObject};

pub fn model(name: &str) -> Arc<ObjectModel> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models").join(name);
    let version = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    Arc::new(ObjectModel::read(folder.join(version.trim())).unwrap())
}

pub fn panda() -> ArmKinematics {
    ArmKinematics::new(&model("panda"), &Isometry3::identity()).unwrap()
}

pub fn ready() -> Vec<f64> {
    model("panda").document.robot.as_ref().unwrap().configurations.iter().find(|c| c.name == "ready").unwrap().q.clone()
}

pub fn at(x: f64, y: f64, z: f64, yaw: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw))
}

pub fn scene(objects: &[(&str, Isometry3<f64>, &[f64])]) -> Scene {
    Scene {
        robot: model("panda"),
        X_WR: Isometry3::identity(),
        table_height: 0.0,
        gravity: Vector3::new(0.0, 0.0, -9.81),
        objects: objects
            .iter()
            .map(|(name, X_WO, q)| SceneObject { name: (*name).into(), model: model(name), X_WO: *X_WO, q: q.to_vec(), X_TO: None })
            .collect(),
    }
}

pub fn microwave() -> Scene {
    scene(&[("microwave", at(0.95, -0.05, 0.0, -std::f64::consts::FRAC_PI_2), &[0.0]), ("mug", at(0.45, -0.4, 0.0, 0.3), &[])])
}

/// Configurations drawn evenly from the joints' ranges.
pub fn random_configurations(arm: &ArmKinematics, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = Pcg64::seed_from_u64(seed);
    (0..count)
        .map(|_| (0..arm.joints()).map(|i| arm.lower()[i] + (arm.upper()[i] - arm.lower()[i]) * random.random::<f64>()).collect())
        .collect()
}

/// Rotation angle and shift between two poses.
pub fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    (a.rotation.angle_to(&b.rotation), (a.translation.vector - b.translation.vector).norm())
}
