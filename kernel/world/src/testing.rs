//! Models and scenes of the tests.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;
use std::sync::Arc;

use nalgebra::Isometry3;
use sagci_model::ObjectModel;

use crate::{Perturbation, Placement, Scene, SceneObject, SensorNoise, WorldOptions};

/// A test model by its folder's name.
pub(crate) fn model(name: &str) -> ObjectModel {
    ObjectModel::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models").join(name)).unwrap()
}

/// A robot of the tests on a table at height 0.
pub(crate) fn scene(robot: &str, start: &str) -> Scene {
    Scene { robot: Arc::new(model(robot)), start: start.into(), table_height: 0.0, objects: Vec::new() }
}

/// Puts an object into a scene.
pub(crate) fn put(scene: &mut Scene, name: &str, at: [f64; 3]) {
    put_model(scene, name, model(name), at);
}

/// Puts a changed model into a scene.
pub(crate) fn put_model(scene: &mut Scene, name: &str, model: ObjectModel, at: [f64; 3]) {
    let q = vec![0.0; model.moving_joints().count()];
    scene.objects.push(SceneObject {
        name: name.into(),
        model: Arc::new(model),
        placement: Placement::World(Isometry3::translation(at[0], at[1], at[2])),
        q,
        hidden_effect: None,
    });
}

/// A world exactly as modelled, perfectly measured.
pub(crate) fn exact() -> WorldOptions {
    WorldOptions { perturbation: Perturbation::NONE, sensors: SensorNoise::NONE }
}
