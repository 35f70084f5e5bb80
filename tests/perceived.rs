//! What is modelled from a cloud is written as files, read back, and simulated by both engines: the measured world's and our own.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, non_snake_case)]

use std::sync::Arc;

use nalgebra::{Isometry3, Translation3};
use sagci_dynamics::{Input, Part, System};
use sagci_furniture::{Category, Look, Noise, Random, families, look};
use sagci_model::ObjectModel;
use sagci_modelling::{Weights, perceive};
use sagci_signal::{Command, GripperCommand};
use sagci_world::{Placement, Scene, SceneObject, WorldOptions, open};

fn robot() -> ObjectModel {
    ObjectModel::read(std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../kernel/world/tests/models/arm"))).unwrap()
}

/// A model as it is read back from its files.
fn modelled(category: Category, seed: u64, folder: &std::path::Path) -> (ObjectModel, Vec<f64>) {
    let mut random = Random::new(seed, "loads");
    let of = families(category, true);
    let object = of[seed as usize % of.len()].draw(&mut random);
    let how = Look { views: 2, width: 280, points: 15_000, near: 1.0, around: false, surroundings: false, noise: Noise::draw(&mut random) };
    let cloud = look(&object, &how, &mut random);
    let found = perceive(&cloud.points, "found", &Weights::shipped().unwrap()).unwrap();
    found.write(folder, &cloud.points, "{}").unwrap();
    (ObjectModel::read(folder).unwrap(), found.report.joints.iter().map(|j| j.state).collect())
}

#[test]
fn a_perceived_model_steps_in_our_dynamics_without_a_number_that_is_none() {
    for category in Category::ALL {
        let folder = tempfile::tempdir().unwrap();
        let (model, q) = modelled(category, 3, folder.path());
        let system = System::new(&[Part::welded(&model, Isometry3::identity())]).unwrap();
        let mut state = system.state();
        assert_eq!(state.q.len(), q.len(), "{category:?}");
        state.q.copy_from_slice(&q);
        let mut ws = system.workspace();
        let tau = vec![1.0; q.len()];
        for _ in 0..200 {
            system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, 1e-3).unwrap();
        }
        assert!(state.q.iter().chain(&state.v).all(|x| x.is_finite()), "{category:?}: {state:?}");
    }
}

#[test]
fn a_perceived_model_stands_in_the_measured_world_and_does_not_fly_apart() {
    for category in Category::ALL {
        let folder = tempfile::tempdir().unwrap();
        let (model, q) = modelled(category, 3, folder.path());
        // Its root's frame is the cloud's: carried to where the arm does not stand.
        let center = model.links[0].inertial.p_LoLcm;
        let away = Translation3::new(3.0 - center.x, -center.y, 0.0).into();
        let object =
            SceneObject { name: "found".into(), model: Arc::new(model), placement: Placement::World(away), q, hidden_effect: None };
        let robot = Arc::new(robot());
        let arm = robot.document.robot.as_ref().unwrap();
        let (start, n) = (arm.configurations[0].name.clone(), arm.arm_joints.len());
        let scene = Scene { robot, start, table_height: -5.0, objects: vec![object] };
        let mut world = open("rapier", WorldOptions::default()).unwrap();
        world.reset(&scene, 1).unwrap_or_else(|e| panic!("{category:?}: {e}"));
        for _ in 0..50 {
            let command = Command { tau: vec![0.0; n], gripper: GripperCommand::default() };
            world.advance(&command).unwrap_or_else(|e| panic!("{category:?}: {e}"));
        }
    }
}
