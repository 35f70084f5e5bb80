//! Whole plans on the shipped models.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;

use common::{apart, at, microwave, panda, ready, scene};
use nalgebra::{Isometry3, Vector3};
use sagci_planning::{
    ArticulationRequest, CollisionWorld, Destination, GraspOptions, PathOptions, PlanError, ToolPath, TransferOptions, Waypoint, arm_path,
    extents, grasps, plan_articulation, plan_pick, plan_place, straight_line,
};

#[test]
fn opening_a_door_keeps_the_tool_on_the_handle_and_the_arm_free() {
    let scene = microwave();
    let world = CollisionWorld::new(&scene).unwrap();
    let request = ArticulationRequest::new(0, 0, 0.0, 1.5, &ready());
    let plan = plan_articulation(&scene, &world, &request, &|| false).unwrap().remove(0);
    let (arm, o) = (panda(), &scene.objects[0]);
    assert_eq!(plan.path.len(), plan.joint.len());
    assert_eq!(plan.approach.last(), plan.path.first());
    assert_eq!(plan.path.last(), plan.retreat.first());
    for (k, q) in plan.path.iter().enumerate() {
        let X_WT = plan.grasp.X_WT(&o.model, &o.X_WO, &[plan.joint[k]], plan.freedom[k]);
        let (turn, shift) = apart(&X_WT, &arm.X_WT(q));
        assert!(turn < 1e-5 && shift < 1e-5, "{turn} {shift}");
        assert!(arm.within_limits(q, 0.0));
    }
    // Halfway between the points the tool is still within 2 mm of the handle's arc.
    for k in 1..plan.path.len() {
        let mid = 0.5 * (plan.joint[k] + plan.joint[k - 1]);
        let X_WF = plan.grasp.X_WF(&o.model, &o.X_WO, &[mid]);
        let p = (arm.X_WT(&plan.q_at(mid)) * plan.grasp.X_FT.inverse()).translation.vector;
        assert!((p - X_WF.translation.vector).norm() < 2e-3);
    }
    let mut moved = world.clone();
    for (q, joint) in plan.path.iter().zip(&plan.joint) {
        moved.set_joint(0, 0, *joint);
        moved.allow_touch(moved.hand(), 0, plan.grasp.link, None);
        assert_eq!(moved.check(q, plan.grasp.hold_width), None);
    }
    // The hand must overcome friction and damping all the way, and the drives can.
    assert!(plan.object.u.iter().skip(1).take(plan.object.u.len() - 2).all(|u| *u > 1.9));
    assert!(plan.load > 0.05 && plan.load < 1.0, "{}", plan.load);
    let again = plan_articulation(&scene, &world, &request, &|| false).unwrap().remove(0);
    assert_eq!(plan.path, again.path, "the same seed gave another plan");
}

#[test]
fn an_object_out_of_reach_fails_by_name_and_stage() {
    let scene = scene(&[("microwave", at(1.8, 0.0, 0.0, -std::f64::consts::FRAC_PI_2), &[0.0])]);
    let world = CollisionWorld::new(&scene).unwrap();
    let error = plan_articulation(&scene, &world, &ArticulationRequest::new(0, 0, 0.0, 1.5, &ready()), &|| false).unwrap_err();
    assert!(matches!(error, PlanError::Unreachable { .. }), "{error}");
    assert!(error.to_string().contains("joint limits"), "{error}");
}

#[test]
fn a_joint_without_a_grasp_hint_is_refused() {
    let mut scene = microwave();
    std::sync::Arc::make_mut(&mut scene.objects[0].model).document.grasps.clear();
    let world = CollisionWorld::new(&scene).unwrap();
    let error = plan_articulation(&scene, &world, &ArticulationRequest::new(0, 0, 0.0, 1.5, &ready()), &|| false).unwrap_err();
    assert!(matches!(&error, PlanError::ModelLacks { message, .. } if message.contains("grasp")), "{error}");
}

#[test]
fn a_plan_can_be_cancelled() {
    let scene = microwave();
    let world = CollisionWorld::new(&scene).unwrap();
    let request = ArticulationRequest::new(0, 0, 0.0, 1.5, &ready());
    assert!(matches!(plan_articulation(&scene, &world, &request, &|| true), Err(PlanError::Cancelled { .. })));
    let place = Destination::Region { object: 0, region: 0 };
    let stopped = plan_pick(&scene, &world, 1, &ready(), Some(&place), &TransferOptions::default(), &|| true);
    assert!(matches!(stopped, Err(PlanError::Cancelled { .. })));
}

#[test]
fn a_mug_is_taken_so_that_it_fits_into_the_cavity() {
    let mut scene = microwave();
    scene.objects[0].q[0] = 1.6;
    let world = CollisionWorld::new(&scene).unwrap();
    let destination = Destination::Region { object: 0, region: 0 };
    let options = TransferOptions::default();
    let plan = plan_pick(&scene, &world, 1, &ready(), Some(&destination), &options, &|| false).unwrap().remove(0);
    let place = plan.place.as_ref().unwrap();
    let (micro, mug) = (&scene.objects[0], &scene.objects[1]);
    // Upright, on the floor, inside the region.
    assert!((place.X_WO.rotation * Vector3::z()).z > 0.9999);
    let region = &micro.model.document.regions[0];
    let X_RO = (micro.X_WO * Isometry3::translation(region.center[0], region.center[1], region.center[2])).inverse() * place.X_WO;
    let mut turned = mug.model.as_ref().clone();
    for s in turned.links.iter_mut().flat_map(|l| &mut l.collisions) {
        s.X_LG = X_RO * s.X_LG;
    }
    let (low, high) = extents(&turned, &[]);
    for i in 0..3 {
        assert!(low[i] >= -0.5 * region.size[i] - 1e-6 && high[i] <= 0.5 * region.size[i] + 1e-6, "axis {i}: {low} {high}");
    }
    assert!(low.z + 0.5 * region.size[2] < 0.005, "not on the floor");
    // The hand holds it the same way from the pick to the place.
    let arm = panda();
    let (turn, shift) = apart(&(arm.X_WT(&plan.lift[0]) * plan.X_TO), &mug.X_WO);
    assert!(turn < 1e-5 && shift < 1e-5);
    let (turn, shift) = apart(&(arm.X_WT(place.insert.last().unwrap()) * plan.X_TO), &place.X_WO);
    assert!(turn < 1e-5 && shift < 1e-5);
    // Holding it, the place can be planned alone.
    scene.objects[1].X_TO = Some(plan.X_TO);
    let holding = CollisionWorld::new(&scene).unwrap();
    let alone =
        plan_place(&scene, &holding, 1, plan.grasp.hold_width, plan.lift.last().unwrap(), &destination, &options, &|| false).unwrap();
    assert!(!alone[0].insert.is_empty());
}

#[test]
fn a_place_too_small_is_refused() {
    let mut scene = microwave();
    scene.objects[0].q[0] = 1.6;
    std::sync::Arc::make_mut(&mut scene.objects[0].model).document.regions[0].size = [0.05, 0.05, 0.05];
    let world = CollisionWorld::new(&scene).unwrap();
    let destination = Destination::Region { object: 0, region: 0 };
    let error = plan_pick(&scene, &world, 1, &ready(), Some(&destination), &TransferOptions::default(), &|| false).unwrap_err();
    assert!(matches!(&error, PlanError::Unreachable { stage, .. } if stage == "place"), "{error}");
}

#[test]
fn grasps_follow_the_hints() {
    let model = common::model("mug");
    let gripper = common::model("panda").document.robot.as_ref().unwrap().gripper.clone();
    let all = grasps(&model, None, &gripper, &GraspOptions::default()).unwrap();
    for g in &all {
        assert!(g.width <= gripper.max_width && g.hold_width < g.width);
        if g.name == "rim" {
            let X = g.X_LT(0.0);
            // Down into the opening, closing along the radius, and not on the handle at -x.
            assert!((X.rotation * Vector3::z() + Vector3::z()).norm() < 1e-9);
            let p = X.translation.vector;
            assert!((p.xy().norm() - 0.0428).abs() < 1e-9);
            assert!((X.rotation * Vector3::y()).xy().normalize().dot(&p.xy().normalize()).abs() > 1.0 - 1e-9);
            assert!(p.y.atan2(-p.x).abs() > 0.5, "on the handle");
        } else {
            // The pads close across the bar, whatever the lean.
            assert!((g.X_LT(0.0).rotation * Vector3::y()).z.abs() < 1e-9);
        }
    }
    assert!(all.iter().any(|g| g.name == "rim") && all.iter().any(|g| g.name == "handle"));
    let mut wide = model.as_ref().clone();
    for hint in &mut wide.document.grasps {
        match hint {
            sagci_model::GraspHint::Bar(b) => b.radius = 0.05,
            sagci_model::GraspHint::Rim(r) => r.thickness = 0.09,
        }
    }
    assert!(matches!(grasps(&wide, None, &gripper, &GraspOptions::default()), Err(PlanError::ModelLacks { .. })));
}

#[test]
fn a_straight_line_of_the_tool_is_followed_without_jumps() {
    let arm = panda();
    let from = arm.X_WT(&ready());
    let to = nalgebra::Translation3::new(0.1, 0.25, -0.1) * from;
    let goals = straight_line(&from, &to, 0.02, 0.1);
    let path = ToolPath {
        chains: vec![arm.clone()],
        waypoints: goals.iter().map(|g| Waypoint { goal: *g, chain: 0, stage: 0 }).collect(),
        stages: vec!["line".into()],
    };
    let found = arm_path(&path, &[ready()], &mut |_, _| None, &PathOptions::default(), &|| false).unwrap();
    for (q, goal) in found.q.iter().zip(&goals) {
        let (turn, shift) = apart(&arm.X_WT(q), goal);
        assert!(turn < 1e-6 && shift < 1e-6);
    }
    for pair in found.q.windows(2) {
        assert!(pair[0].iter().zip(&pair[1]).all(|(a, b)| (a - b).abs() < 0.1));
    }
    // A wall across the way is named with its stage.
    let mut wall = |i: usize, _: &[f64]| (i > 5).then(|| sagci_planning::Contact { first: "hand".into(), second: "wall".into() });
    let error = arm_path(&path, &[ready()], &mut wall, &PathOptions::default(), &|| false).unwrap_err();
    assert!(matches!(&error, PlanError::Collision { stage, second, .. } if stage == "line" && second == "wall"), "{error}");
}
