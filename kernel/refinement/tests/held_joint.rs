//! The joint that a hand held, from what the arm sensed. The arm turns about its base only, so that its tool moves on a circle whose centre
//! and angle are known, and the door is put where its hinge is that centre.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use sagci_model::ObjectModel;
use sagci_recording::Log;
use sagci_refinement::{HeldJoint, HeldJointError, held_joint};
use sagci_signal::{Observation, Wrench};

fn stored(name: &str) -> ObjectModel {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models").join(name);
    let version = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    ObjectModel::read(folder.join(version.trim())).unwrap()
}

const BIAS: Wrench = Wrench { force: Vector3::new(0.2, -0.1, 0.15), torque: Vector3::new(0.01, 0.0, -0.01) };
const PUSH: f64 = 6.0;
const DOOR: &str = "door_hinge";

/// Where the door's hinge is the world's vertical axis.
fn X_WO(door: &ObjectModel) -> Isometry3<f64> {
    let p = door.joints[door.joint(DOOR).unwrap()].X_PJ.translation.vector;
    Isometry3::translation(-p.x, -p.y, 0.0)
}

/// Two seconds free, then a hold in which the base turns from 0 by `turn` within two seconds and pushes with [`PUSH`] along the way, then free.
fn run(robot: &ObjectModel, turn: f64) -> Vec<Observation> {
    let facts = robot.document.robot.as_ref().unwrap();
    let ready = &facts.configurations.iter().find(|c| c.name == "ready").unwrap().q;
    let (tool, wrist) = (robot.link(&facts.gripper.link).unwrap(), robot.link(&facts.wrist_link).unwrap());
    (0..5000)
        .map(|i| {
            let time = f64::from(i) * 1e-3;
            let held = (2.0..4.5).contains(&time);
            let mut q = ready.clone();
            q[0] = turn * ((time - 2.25) / 2.0).clamp(0.0, 1.0);
            let full: Vec<f64> = robot
                .moving_joints()
                .map(|j| facts.arm_joints.iter().position(|n| *n == robot.joints[j].name).map_or(0.0, |slot| q[slot]))
                .collect();
            let X = robot.X_OL(&full);
            let p = (X[tool] * facts.gripper.X_LT.isometry()).translation.vector;
            // The door pushes back, across the lever and level; felt at the wrist, about its own origin.
            let along = Vector3::z().cross(&p).normalize() * turn.signum();
            let back = if held { -along * PUSH } else { Vector3::zeros() };
            let S = X[wrist];
            let torque = (Point3::from(p) - Point3::from(S.translation.vector)).cross(&back);
            let F_S = Wrench { force: S.rotation.inverse() * back + BIAS.force, torque: S.rotation.inverse() * torque + BIAS.torque };
            Observation { time, q, gripper_width: 0.04, gripper_force: if held { 45.0 } else { 0.0 }, F_S, ..Observation::default() }
        })
        .collect()
}

fn read(log: &Log) -> (&[f64], &[f64], &[f64]) {
    let joint = log.joint(DOOR).unwrap();
    (&joint.position.time, &joint.position.value, &joint.effort.as_ref().unwrap().value)
}

#[test]
fn position_and_effort_are_those_of_the_door_wherever_it_was_thought_to_stand() {
    let (robot, door) = (stored("panda"), stored("microwave"));
    // The door's axis points down: it opens as the base turns to the right.
    let observations = run(&robot, -1.2);
    let facts = robot.document.robot.as_ref().unwrap();
    for off in [Vector3::zeros(), Vector3::new(0.01, -0.02, 0.005)] {
        let X_WO = Isometry3::from(off) * X_WO(&door);
        let setting = HeldJoint { robot: &robot, X_WR: Isometry3::identity(), object: &door, X_WO, joint: DOOR, q: &[0.1], zero: None };
        let (logs, _) = held_joint(&setting, &observations).unwrap();
        assert_eq!(logs.len(), 1);
        let (time, position, effort) = read(&logs[0]);
        assert!(time.len() > 180 && time.windows(2).all(|w| (w[1] - w[0] - 0.01).abs() < 1e-9));
        let lever = {
            let full: Vec<f64> = robot
                .moving_joints()
                .map(|j| facts.arm_joints.iter().position(|n| *n == robot.joints[j].name).map_or(0.0, |slot| observations[0].q[slot]))
                .collect();
            let X_WT = robot.X_OL(&full)[robot.link(&facts.gripper.link).unwrap()] * facts.gripper.X_LT.isometry();
            X_WT.translation.vector.xy().norm()
        };
        for ((t, q), u) in time.iter().zip(position).zip(effort) {
            let expected = 0.1 + 1.2 * ((t - 2.25) / 2.0).clamp(0.0, 1.0);
            assert!((q - expected).abs() < 1e-6, "at {t} s: {q} rad, expected {expected}");
            assert!((u - PUSH * lever).abs() < 1e-6, "at {t} s: {u} N m, expected {}", PUSH * lever);
        }
    }
}

/// Fingers that close about the handle have pushed the door since it was last seen.
#[test]
fn a_later_run_counts_from_where_the_first_one_did_and_not_from_a_belief() {
    let (robot, door) = (stored("panda"), stored("microwave"));
    let observations = run(&robot, -1.2);
    let first =
        HeldJoint { robot: &robot, X_WR: Isometry3::identity(), object: &door, X_WO: X_WO(&door), joint: DOOR, q: &[0.1], zero: None };
    let (logs, zero) = held_joint(&first, &observations).unwrap();
    let expected = read(&logs[0]).1.to_vec();
    let later = HeldJoint { q: &[0.115], zero: Some(&zero), ..first };
    let (logs, again) = held_joint(&later, &observations).unwrap();
    assert_eq!((read(&logs[0]).1, &again), (expected.as_slice(), &zero));
    // Where the object was moved, nothing is known but what is believed.
    let moved = Isometry3::translation(0.0, 0.002, 0.0) * X_WO(&door);
    let (logs, _) = held_joint(&HeldJoint { X_WO: moved, ..later }, &observations).unwrap();
    assert!((read(&logs[0]).1[0] - expected[0] - 0.015).abs() < 1e-6);
}

#[test]
fn what_lies_at_a_stop_is_left_out() {
    let (robot, door) = (stored("panda"), stored("microwave"));
    let X_WO = X_WO(&door);
    let setting = HeldJoint { robot: &robot, X_WR: Isometry3::identity(), object: &door, X_WO, joint: DOOR, q: &[0.0], zero: None };
    let (logs, _) = held_joint(&setting, &run(&robot, -1.2)).unwrap();
    let (_, position, _) = read(&logs[0]);
    let range = door.joints[door.joint(DOOR).unwrap()].limits.range();
    assert!(position[0] > 0.005 * range && position[0] < 0.01 * range, "begins at {} rad", position[0]);
}

#[test]
fn a_hand_that_held_nothing_says_so() {
    let (robot, door) = (stored("panda"), stored("microwave"));
    let mut observations = run(&robot, -1.2);
    observations.iter_mut().for_each(|o| o.gripper_force = 0.2);
    let setting =
        |joint| HeldJoint { robot: &robot, X_WR: Isometry3::identity(), object: &door, X_WO: X_WO(&door), joint, q: &[0.0], zero: None };
    assert!(matches!(held_joint(&setting(DOOR), &observations), Err(HeldJointError::NotHeld { .. })));
    assert!(matches!(held_joint(&setting(DOOR), &[]), Err(HeldJointError::NotHeld { .. })));
    assert!(matches!(held_joint(&setting("lid"), &observations), Err(HeldJointError::Model(_))));
}

#[test]
fn what_is_written_is_read_again_with_the_same_values_and_the_same_hash() {
    let (robot, door) = (stored("panda"), stored("microwave"));
    let setting =
        HeldJoint { robot: &robot, X_WR: Isometry3::identity(), object: &door, X_WO: X_WO(&door), joint: DOOR, q: &[0.0], zero: None };
    let log = held_joint(&setting, &run(&robot, -1.2)).unwrap().0.remove(0);
    let file = std::env::temp_dir().join(format!("held-joint-{}.csv", std::process::id()));
    std::fs::write(&file, log.to_csv()).unwrap();
    let again = sagci_recording::read(std::slice::from_ref(&file), Some(&door)).unwrap().remove(0);
    std::fs::remove_file(&file).unwrap();
    assert_eq!(again.hash, log.hash);
    let ((time, position, effort), (time_read, position_read, effort_read)) = (read(&log), read(&again));
    assert_eq!((position_read, effort_read), (position, effort));
    assert!(time.len() == time_read.len() && time.iter().zip(time_read).all(|(a, b)| (a - b).abs() < 1e-9));
}
