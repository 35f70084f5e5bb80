//! What it takes to move an object's joint.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

use nalgebra::{Isometry3, Vector3};
use sagci_model::{EffectEntry, ObjectModel};
use sagci_planning::joint_dynamics;

#[test]
fn effort_of_a_joint_counts_the_named_effects_of_its_model() {
    let folder = std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../world-models/microwave");
    let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    let mut model = ObjectModel::read(folder.join(head.trim())).unwrap();
    let door = model.moving_joints().next().unwrap();
    let effort = |model: &ObjectModel, q: f64, v: f64| {
        joint_dynamics(model, &Isometry3::identity(), Vector3::new(0.0, 0.0, -9.81), &[0.0], 0).unwrap()(q, v, 0.0)
    };
    let (damping, friction) = (model.joints[door].damping, model.joints[door].friction);
    let rigid = effort(&model, 0.5, 0.0);
    assert!((effort(&model, 0.5, 0.2) - rigid - damping * 0.2 - friction).abs() < 1e-9, "damping and dry friction resist the motion");
    assert!((effort(&model, 0.5, -0.2) - rigid + damping * 0.2 + friction).abs() < 1e-9);
    let spring = [("stiffness".to_owned(), 3.0), ("rest_position".to_owned(), -0.1)].into();
    let joint = Some(model.joints[door].name.clone());
    model.document.effects.push(EffectEntry { effect: "joint_spring".into(), joint, parameters: spring, ..EffectEntry::default() });
    assert!((effort(&model, 0.5, 0.0) - rigid - 3.0 * 0.6).abs() < 1e-9, "a closer's spring must be felt");
    model.document.effects[0].effect = "joint_sprong".into();
    let refused = joint_dynamics(&model, &Isometry3::identity(), Vector3::zeros(), &[0.0], 0).err().unwrap().to_string();
    assert!(refused.contains("did you mean 'joint_spring'"), "{refused}");
}
