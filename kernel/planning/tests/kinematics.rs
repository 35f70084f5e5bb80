//! Forward and inverse kinematics of the shipped arm.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;

use common::{apart, model, panda, random_configurations};
use nalgebra::{Isometry3, Vector3, Vector6};
use sagci_planning::{ArmKinematics, Freedom, InverseOptions, PlanError};

#[test]
fn the_chain_agrees_with_the_model_link_by_link() {
    let robot = model("panda");
    let arm = panda();
    let section = robot.document.robot.as_ref().unwrap();
    let hand = robot.link(&section.gripper.link).unwrap();
    for q in random_configurations(&arm, 50, 1) {
        // The model's q has the fingers too; they stand behind the arm.
        let X = robot.X_OL(&q)[hand] * section.gripper.X_LT.isometry();
        let (turn, shift) = apart(&X, &arm.X_WT(&q));
        assert!(turn < 1e-7 && shift < 1e-12, "{turn:e} {shift:e}");
    }
}

#[test]
fn the_jacobian_is_the_rate_of_the_tools_pose() {
    let arm = panda();
    let h = 1e-6;
    let mut J = Vec::new();
    for q in random_configurations(&arm, 20, 2) {
        arm.jacobian(&q, &mut J);
        for i in 0..7 {
            let (mut a, mut b) = (q.clone(), q.clone());
            a[i] -= h;
            b[i] += h;
            let (A, B) = (arm.X_WT(&a), arm.X_WT(&b));
            let w = (B.rotation * A.rotation.inverse()).scaled_axis() / (2.0 * h);
            let v = (B.translation.vector - A.translation.vector) / (2.0 * h);
            let difference = Vector6::new(w.x, w.y, w.z, v.x, v.y, v.z) - J[i];
            assert!(difference.amax() < 1e-7, "joint {i}: {difference}");
        }
    }
}

#[test]
fn inverse_kinematics_finds_reachable_poses_and_keeps_limits() {
    let arm = panda();
    let options = InverseOptions { starts: 40, solutions: 1, ..InverseOptions::default() };
    let mut found = 0;
    for q in random_configurations(&arm, 200, 3) {
        let goal = arm.X_WT(&q);
        for solution in arm.inverse(&goal, &[], &options) {
            let (turn, shift) = apart(&arm.X_WT(&solution), &goal);
            assert!(turn < 1e-6 && shift < 1e-6, "{turn:e} {shift:e}");
            assert!(arm.within_limits(&solution, 0.0));
            found += 1;
        }
    }
    assert!(found >= 195, "{found} of 200 reachable poses found");
}

#[test]
fn inverse_kinematics_gives_many_distinct_solutions_and_the_same_ones_each_time() {
    let arm = panda();
    let goal = arm.X_WT(&common::ready());
    let options = InverseOptions { starts: 60, solutions: 12, seed: 5, ..InverseOptions::default() };
    let a = arm.inverse(&goal, &[], &options);
    let b = arm.inverse(&goal, &[], &options);
    assert_eq!(a, b);
    assert!(a.len() >= 8, "{} solutions", a.len());
    for (i, x) in a.iter().enumerate() {
        for y in &a[..i] {
            assert!(x.iter().zip(y).any(|(x, y)| (x - y).abs() >= options.distinct));
        }
    }
}

#[test]
fn a_pose_out_of_reach_has_no_solution() {
    let arm = panda();
    assert!(arm.inverse(&Isometry3::translation(1.5, 0.0, 0.5), &[], &InverseOptions::default()).is_empty());
    let nan = Isometry3::translation(f64::NAN, 0.0, 0.5);
    assert!(arm.inverse(&nan, &[], &InverseOptions::default()).is_empty());
}

#[test]
fn a_freedom_turns_the_tool_about_the_goal_frame() {
    let arm = panda();
    let X_TF = Isometry3::new(Vector3::new(0.0, 0.0, 0.02), Vector3::new(0.1, 0.0, 0.0));
    let freedom = Freedom { X_TF, axis: Vector3::x_axis(), slides: false, range: [-0.5, 0.5] };
    let chain = arm.with_freedom(&freedom);
    for mut q in random_configurations(&arm, 10, 4) {
        let s = 0.3;
        q.push(s);
        // X_WT = X_WF exp([axis] s) X_FT
        let X = chain.X_WT(&q) * Isometry3::rotation(Vector3::x() * s) * X_TF.inverse();
        let (turn, shift) = apart(&X, &arm.X_WT(&q));
        assert!(turn < 1e-7 && shift < 1e-12);
    }
}

#[test]
fn an_object_is_not_taken_for_an_arm() {
    let error = ArmKinematics::new(&model("mug"), &Isometry3::identity()).unwrap_err();
    assert!(matches!(&error, PlanError::ModelLacks { model, .. } if model == "mug"), "{error}");
}
