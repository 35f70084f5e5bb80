//! The collision check against a plain one that looks at every pair.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;

use common::{at, microwave, panda, random_configurations, ready, scene};
use nalgebra::{Isometry3, Point3};
use parry3d_f64::math::{Pose3, Rot3, Vec3};
use parry3d_f64::query;
use parry3d_f64::shape::SharedShape;
use sagci_model::{Geometry, ObjectModel};
use sagci_planning::{CollisionWorld, Scene};

fn pose(X: &Isometry3<f64>) -> Pose3 {
    let (t, r) = (X.translation.vector, X.rotation.quaternion());
    Pose3::from_parts(Vec3::new(t.x, t.y, t.z), Rot3::from_xyzw(r.i, r.j, r.k, r.w))
}

/// Shapes of a model's links in the world; meshes are left out, the shipped models touch with plain solids.
fn shapes(model: &ObjectModel, X_WO: &Isometry3<f64>, q: &[f64]) -> Vec<(usize, SharedShape, Pose3)> {
    let X_OL = model.X_OL(q);
    let mut out = Vec::new();
    for (i, link) in model.links.iter().enumerate() {
        for s in &link.collisions {
            let X = X_WO * X_OL[i] * s.X_LG;
            let (shape, X) = match &s.geometry {
                Geometry::Box { half_extents: h } => (SharedShape::cuboid(h.x, h.y, h.z), X),
                Geometry::Sphere { radius } => (SharedShape::ball(*radius), X),
                Geometry::Capsule { radius, half_length } => (SharedShape::capsule_z(*half_length, *radius), X),
                Geometry::Cylinder { radius, half_length } => (
                    SharedShape::cylinder(*half_length, *radius),
                    X * Isometry3::rotation(nalgebra::Vector3::x() * std::f64::consts::FRAC_PI_2),
                ),
                Geometry::Mesh { .. } => panic!("a mesh among the collision shapes"),
            };
            out.push((i, shape, pose(&X)));
        }
    }
    out
}

/// Least distance of the robot to objects and table, every pair looked at. `width` moves the fingers.
fn plain_distance(scene: &Scene, q: &[f64], width: f64) -> f64 {
    let robot = &scene.robot;
    let mut all = q.to_vec();
    all.extend([0.5 * width, 0.5 * width]);
    let mut least = f64::INFINITY;
    let links = shapes(robot, &scene.X_WR, &all);
    for (link, a, X) in &links {
        if *link > 0 {
            least = least.min(a.compute_aabb(X).mins.z - scene.table_height);
        }
        for o in &scene.objects {
            for (_, b, Y) in shapes(&o.model, &o.X_WO, &o.q) {
                least = least.min(query::distance(X, &**a, &Y, &*b).unwrap().distance);
            }
        }
    }
    least
}

#[test]
fn the_check_agrees_with_looking_at_every_pair() {
    let scene = microwave();
    let mut world = CollisionWorld::new(&scene).unwrap();
    world.self_padding = -1.0;
    let (mut hits, mut misses) = (0, 0);
    for q in random_configurations(&panda(), 300, 7) {
        let d = plain_distance(&scene, &q, 0.05);
        let found = world.check(&q, 0.05);
        // Where it is close to call, rounding may decide.
        if (d - world.padding).abs() < 1e-6 {
            continue;
        }
        let touches_others = found.as_ref().is_some_and(|c| c.second == "table" || c.second.contains('/'));
        if d < world.padding {
            hits += 1;
            assert!(found.is_some(), "a distance of {d} was missed");
        } else {
            misses += 1;
            assert!(!touches_others, "{found:?} although the distance is {d}");
        }
    }
    assert!(hits > 30 && misses > 30, "{hits} {misses}");
}

#[test]
fn clearance_is_the_least_distance() {
    let scene = microwave();
    let world = CollisionWorld::new(&scene).unwrap();
    let mut compared = 0;
    for q in random_configurations(&panda(), 200, 8) {
        let d = plain_distance(&scene, &q, 0.05);
        let c = world.clearance(&q, 0.05, 0.3);
        assert!((c - d.clamp(0.0, 0.3)).abs() < 1e-6, "{c} {d}");
        compared += usize::from(c > 0.0 && c < 0.3);
    }
    assert!(compared > 60, "{compared}");
}

#[test]
fn a_door_that_moves_is_seen_where_it_is() {
    let scene = microwave();
    let mut world = CollisionWorld::new(&scene).unwrap();
    let arm = panda();
    // Tool where the open door will stand.
    let hinge = scene.objects[0].X_WO * Point3::new(-0.345, -0.176, 0.192);
    let inside_door = Isometry3::new(nalgebra::Vector3::new(hinge.x - 0.3, hinge.y, 0.25), nalgebra::Vector3::y() * 3.0);
    let q = arm.inverse(&inside_door, &[ready()], &sagci_planning::InverseOptions::default()).into_iter().find(|q| world.free(q, 0.0));
    let q = q.expect("free while the door is shut");
    world.set_joint(0, 0, std::f64::consts::FRAC_PI_2);
    assert!(world.check(&q, 0.0).is_some_and(|c| c.second == "microwave/door"));
}

#[test]
fn what_is_held_moves_with_the_tool_and_touches_only_its_support() {
    let scene = scene(&[("mug", at(0.5, 0.0, 0.0, 0.0), &[]), ("drawer", at(0.75, 0.0, 0.0, -std::f64::consts::FRAC_PI_2), &[0.0])]);
    let arm = panda();
    let mut world = CollisionWorld::new(&scene).unwrap();
    // A hand above the mug's rim, pointing down.
    let X_WT = Isometry3::new(nalgebra::Vector3::new(0.5, 0.043, 0.09), nalgebra::Vector3::x() * std::f64::consts::PI);
    let q = arm.inverse(&X_WT, &[ready()], &sagci_planning::InverseOptions::default())[0].clone();
    world.attach(0, &(X_WT.inverse() * scene.objects[0].X_WO));
    assert!(world.check(&q, 0.008).is_some_and(|c| c.first == "mug/mug" && c.second == "table"));
    world.allow_held_support(&X_WT, 0.01);
    assert_eq!(world.check(&q, 0.008), None);
    // Carried into the cabinet it would touch.
    let X_WT = Isometry3::new(nalgebra::Vector3::new(0.7, 0.043, 0.2), nalgebra::Vector3::x() * std::f64::consts::PI);
    let touched =
        arm.inverse(&X_WT, &[ready()], &sagci_planning::InverseOptions::default()).iter().filter_map(|q| world.check(q, 0.008)).next();
    assert!(touched.is_some_and(|c| c.second.starts_with("drawer/")));
}

#[test]
fn fingers_may_touch_the_bar_and_not_the_door_behind_it() {
    let scene = microwave();
    let arm = panda();
    let robot = scene.robot.document.robot.as_ref().unwrap();
    let door = scene.objects[0].model.link("door").unwrap();
    let grasp =
        &sagci_planning::grasps(&scene.objects[0].model, Some(door), &robot.gripper, &sagci_planning::GraspOptions::default()).unwrap()[0];
    let mut world = CollisionWorld::new(&scene).unwrap();
    world.allow_touch(world.fingers(), 0, door, grasp.held_part);
    world.allow_close(world.hand(), 0);
    let on_bar = grasp.X_WT(&scene.objects[0].model, &scene.objects[0].X_WO, &[0.0], 0.0);
    let options = sagci_planning::InverseOptions { starts: 100, ..sagci_planning::InverseOptions::default() };
    assert!(arm.inverse(&on_bar, &[ready()], &options).iter().any(|q| world.free(q, grasp.hold_width)));
    // Five centimetres further the tips are in the door.
    let too_deep = on_bar * nalgebra::Translation3::new(0.0, 0.0, 0.05);
    let deep = arm.inverse(&too_deep, &[ready()], &options);
    assert!(!deep.is_empty() && deep.iter().all(|q| world.check(q, grasp.hold_width).is_some()));
}

#[test]
fn the_named_configurations_of_the_arm_are_free_of_itself() {
    let world = CollisionWorld::new(&scene(&[])).unwrap();
    for c in &world.scene().robot.document.robot.as_ref().unwrap().configurations {
        assert_eq!(world.check(&c.q, 0.08), None, "{}", c.name);
    }
    // Folded onto its own base.
    assert!(!world.free(&[0.0, -1.7, 0.0, -3.0, 0.0, 0.1, 0.0], 0.0) || !world.free(&[0.0, 1.7, 0.0, -3.0, 0.0, 0.1, 0.0], 0.0));
}
