//! Free motion, timing, and the object's own motion.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;

use std::cell::Cell;

use common::{at, microwave, panda, ready, scene};
use nalgebra::{Isometry3, Vector3};
use sagci_planning::{
    CollisionWorld, FreeMotionOptions, InverseOptions, MotionLimits, ObjectMotionOptions, PlanError, free_motion, object_motion, time_path,
};

/// In front of the cabinet on its left, and on its right, low enough that the straight way is blocked.
fn around_a_cabinet() -> (CollisionWorld, Vec<f64>, Vec<Vec<f64>>) {
    let scene = scene(&[("drawer", at(0.55, 0.0, 0.0, -std::f64::consts::FRAC_PI_2), &[0.0])]);
    let world = CollisionWorld::new(&scene).unwrap();
    let arm = panda();
    let down = |y: f64| Isometry3::new(Vector3::new(0.55, y, 0.15), Vector3::x() * std::f64::consts::PI);
    let solve = |y: f64| -> Vec<Vec<f64>> {
        let all = arm.inverse(&down(y), &[ready()], &InverseOptions { starts: 60, margin: 0.05, ..InverseOptions::default() });
        all.into_iter().filter(|q| world.free(q, 0.08)).collect()
    };
    let start = solve(0.42)[0].clone();
    let goals = solve(-0.42);
    (world, start, goals)
}

#[test]
fn a_free_path_is_free_also_between_its_points() {
    let (world, start, goals) = around_a_cabinet();
    let path = free_motion(&world, &start, &goals, 0.08, &FreeMotionOptions::default(), &|| false).unwrap();
    assert_eq!(path.q[0], start);
    assert_eq!(path.q.last(), Some(&goals[path.goal]));
    // What touches must not, even where the padding was met only at the checked points.
    let mut strict = world.clone();
    (strict.padding, strict.close_padding, strict.self_padding) = (0.0, 0.0, 0.0);
    for pair in path.q.windows(2) {
        for k in 0..=20 {
            let q: Vec<f64> = pair[0].iter().zip(&pair[1]).map(|(a, b)| a + (b - a) * k as f64 / 20.0).collect();
            assert_eq!(strict.check(&q, 0.08), None);
        }
    }
    // And so is the timed path, a spline through these points.
    let trajectory = time_path(&path.q, &MotionLimits::of_arm(&panda(), 0.5, 0.3)).unwrap();
    for k in 0..=500 {
        let q = trajectory.sample(trajectory.duration() * f64::from(k) / 500.0).q;
        assert_eq!(strict.check(&q, 0.08), None);
    }
    let again = free_motion(&world, &start, &goals, 0.08, &FreeMotionOptions::default(), &|| false).unwrap();
    assert_eq!(path.q, again.q, "the same seed gave another path");
}

#[test]
fn a_blocked_start_or_goal_is_named() {
    let (world, start, _) = around_a_cabinet();
    let arm = panda();
    let inside = Isometry3::new(Vector3::new(0.55, 0.0, 0.1), Vector3::x() * std::f64::consts::PI);
    let blocked = arm.inverse(&inside, &[ready()], &InverseOptions::default());
    assert!(!blocked.is_empty());
    let error = free_motion(&world, &start, &blocked, 0.08, &FreeMotionOptions::default(), &|| false).unwrap_err();
    assert!(
        matches!(&error, PlanError::Collision { second, message, .. } if second.starts_with("drawer/") && message.contains("goal")),
        "{error}"
    );
    let error = free_motion(&world, &blocked[0], std::slice::from_ref(&start), 0.08, &FreeMotionOptions::default(), &|| false).unwrap_err();
    assert!(matches!(&error, PlanError::Collision { message, .. } if message.contains("start")), "{error}");
    let error = free_motion(&world, &start, &[vec![0.0; 3]], 0.08, &FreeMotionOptions::default(), &|| false).unwrap_err();
    assert!(matches!(error, PlanError::BadInput { .. }));
}

#[test]
fn a_search_stops_when_asked() {
    let (world, start, goals) = around_a_cabinet();
    let asked = Cell::new(0);
    let stop = || {
        asked.set(asked.get() + 1);
        asked.get() > 1
    };
    match free_motion(&world, &start, &goals, 0.08, &FreeMotionOptions::default(), &stop) {
        Err(PlanError::Cancelled { stage }) => assert_eq!(stage, "reach"),
        // The first samples may have joined the trees already.
        other => assert!(other.is_ok() && asked.get() <= 2),
    }
}

#[test]
fn timing_of_one_joint_comes_close_to_bang_bang() {
    // From 0 to 1 rad, 2 rad/s^2: without a limit of speed 2 sqrt(x / a); with 0.8 rad/s, x / v + v / a.
    for (speed, expected) in [(100.0, 2.0 * (1.0_f64 / 2.0).sqrt()), (0.8, 1.0 / 0.8 + 0.8 / 2.0)] {
        let path: Vec<Vec<f64>> = (0..=20).map(|k| vec![f64::from(k) / 20.0]).collect();
        let limits = MotionLimits { velocity: vec![speed], acceleration: vec![2.0], effort: None, tool: None, smoothness: 0.0 };
        let t = time_path(&path, &limits).unwrap().duration();
        assert!(t >= expected * (1.0 - 1e-6) && t < expected * 1.02, "{t} against {expected}");
    }
}

#[test]
fn timing_keeps_every_limit_between_the_grids_points() {
    let arm = panda();
    let configurations = common::random_configurations(&arm, 6, 11);
    let mut path = Vec::new();
    for pair in configurations.windows(2) {
        path.extend((0..10).map(|k| pair[0].iter().zip(&pair[1]).map(|(a, b)| a + (b - a) * f64::from(k) / 10.0).collect::<Vec<f64>>()));
    }
    let limits = MotionLimits::of_arm(&arm, 0.8, 0.2);
    let trajectory = time_path(&path, &limits).unwrap();
    let n = 20_000;
    let dt = trajectory.duration() / f64::from(n);
    let mut before = trajectory.sample(0.0);
    assert!(before.v.iter().all(|v| v.abs() < 1e-9));
    let mut reached = 0.0_f64;
    for k in 1..=n {
        let x = trajectory.sample(dt * f64::from(k));
        for j in 0..7 {
            assert!(x.v[j].abs() <= limits.velocity[j] * (1.0 + 1e-4));
            assert!(x.a[j].abs() <= limits.acceleration[j] * (1.0 + 1e-3), "{} {}", x.a[j], limits.acceleration[j]);
            // Velocity is the rate of position.
            let difference = (x.q[j] - before.q[j]) / dt - 0.5 * (x.v[j] + before.v[j]);
            assert!(difference.abs() < 1e-2 * limits.velocity[j], "{difference}");
            reached = reached.max(x.v[j].abs() / limits.velocity[j]).max(x.a[j].abs() / limits.acceleration[j]);
        }
        before = x;
    }
    assert!(before.v.iter().all(|v| v.abs() < 1e-6));
    assert!(reached > 0.9, "slower than it must be: {reached}");
}

#[test]
fn timing_keeps_torque_limits() {
    // A point mass of 1 kg at 1 m on a level axis: tau = qdd + 9.81 cos q.
    let dynamics = |q: &[f64], _: &[f64], a: &[f64]| vec![a[0] + 9.81 * q[0].cos()];
    let path: Vec<Vec<f64>> = (0..=40).map(|k| vec![-1.0 + f64::from(k) / 20.0]).collect();
    let limits = MotionLimits {
        velocity: vec![10.0],
        acceleration: vec![100.0],
        effort: Some((vec![11.0], &dynamics)),
        tool: None,
        smoothness: 0.0,
    };
    let trajectory = time_path(&path, &limits).unwrap();
    let mut greatest = 0.0_f64;
    for k in 0..=2000 {
        let x = trajectory.sample(trajectory.duration() * f64::from(k) / 2000.0);
        greatest = greatest.max(dynamics(&x.q, &x.v, &x.a)[0].abs());
    }
    assert!(greatest < 11.0 * 1.001 && greatest > 10.5, "{greatest}");
    let weak = MotionLimits { effort: Some((vec![9.0], &dynamics)), ..limits };
    assert!(matches!(time_path(&path, &weak), Err(PlanError::TooWeak { .. })));
}

#[test]
fn the_tools_speed_is_capped() {
    let arm = panda();
    let (a, mut b) = (ready(), ready());
    b[0] += 1.2;
    let path: Vec<Vec<f64>> = (0..=30).map(|k| a.iter().zip(&b).map(|(a, b)| a + (b - a) * f64::from(k) / 30.0).collect()).collect();
    let limits = MotionLimits { tool: Some((&arm, 0.25, 10.0)), ..MotionLimits::of_arm(&arm, 1.0, 0.1) };
    let trajectory = time_path(&path, &limits).unwrap();
    let dt = 1e-3;
    let mut fastest = 0.0_f64;
    for k in 1..(trajectory.duration() / dt) as usize {
        let p = |t: f64| arm.X_WT(&trajectory.sample(t).q).translation.vector;
        fastest = fastest.max((p(k as f64 * dt) - p((k - 1) as f64 * dt)).norm() / dt);
    }
    assert!(fastest < 0.2501 && fastest > 0.24, "{fastest}");
}

#[test]
fn a_path_of_one_point_takes_no_time_and_bad_limits_are_refused() {
    let arm = panda();
    let limits = MotionLimits::of_arm(&arm, 0.5, 0.5);
    let still = time_path(&[ready(), ready()], &limits).unwrap();
    assert_eq!(still.duration(), 0.0);
    assert_eq!(still.sample(1.0).q, ready());
    assert!(matches!(time_path(&[], &limits), Err(PlanError::BadInput { .. })));
    let bad = MotionLimits { velocity: vec![0.0; 7], ..limits };
    assert!(matches!(time_path(&[ready()], &bad), Err(PlanError::BadInput { .. })));
}

#[test]
fn a_pure_inertia_moves_on_the_cubic_of_least_effort() {
    let options =
        ObjectMotionOptions { jerk_weight: 0.0, effort_weight: 1.0, duration: Some(2.0), speed: 10.0, ..ObjectMotionOptions::default() };
    let (inertia, way) = (0.3, 1.4);
    let plan = object_motion(&|_, _, a| inertia * a, 0.2, 0.2 + way, &options).unwrap();
    for (k, t) in plan.t.iter().enumerate() {
        let s = t / 2.0;
        assert!((plan.q[k] - 0.2 - way * s * s * (3.0 - 2.0 * s)).abs() < 2e-3 * way, "{} at {s}", plan.q[k]);
        assert!((plan.u[k] - inertia * plan.a[k]).abs() < 1e-6);
    }
}

#[test]
fn without_effort_the_motion_is_the_quintic_of_least_jerk() {
    let options = ObjectMotionOptions { effort_weight: 0.0, duration: Some(1.5), speed: 10.0, ..ObjectMotionOptions::default() };
    let plan = object_motion(&|_, _, a| a, 1.0, -0.5, &options).unwrap();
    for (k, t) in plan.t.iter().enumerate() {
        let s = t / 1.5;
        assert!((plan.q[k] - 1.0 + 1.5 * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s)).abs() < 3e-3, "{} at {s}", plan.q[k]);
    }
}

#[test]
fn an_objects_motion_keeps_its_limits_and_pays_for_friction() {
    let (damping, friction) = (2.0, 2.0);
    let dynamics = |_: f64, v: f64, a: f64| 0.1 * a + damping * v + friction * v.signum();
    let options = ObjectMotionOptions { speed: 0.5, effort: 3.2, ..ObjectMotionOptions::default() };
    let plan = object_motion(&dynamics, 0.0, 1.5, &options).unwrap();
    assert!(plan.v.iter().all(|v| *v > -1e-6 && *v <= 0.5 + 1e-6));
    assert!(plan.u.iter().all(|u| u.abs() <= 3.2 + 1e-5));
    // In the middle it moves: friction and damping at least.
    let k = plan.t.len() / 2;
    assert!((plan.u[k] - dynamics(plan.q[k], plan.v[k], plan.a[k])).abs() < 1e-3);
    assert_eq!((plan.q[0], *plan.q.last().unwrap()), (0.0, 1.5));
    let error = object_motion(&dynamics, 0.0, 1.5, &ObjectMotionOptions { effort: 1.0, ..options }).unwrap_err();
    assert!(matches!(error, PlanError::TooWeak { .. }), "{error}");
}

#[test]
fn the_models_joint_gives_its_own_dynamics() {
    let scene = microwave();
    let o = &scene.objects[0];
    let door = &o.model.joints[0];
    let tau = sagci_planning::joint_dynamics(&o.model, &o.X_WO, scene.gravity, &o.q, 0).unwrap();
    // An upright hinge: no weight, only friction and damping; inertia about the hinge by Steiner.
    let link = &o.model.links[door.child].inertial;
    let r2 = link.p_LoLcm.x.powi(2) + link.p_LoLcm.y.powi(2);
    let inertia = link.I_LLcm_L[(2, 2)] + link.mass * r2;
    assert!(tau(0.7, 0.0, 0.0).abs() < 1e-9);
    assert!((tau(0.7, 0.5, 0.0) - door.damping * 0.5 - door.friction).abs() < 1e-9);
    assert!((tau(0.7, 0.5, 2.0) - tau(0.7, 0.5, 0.0) - 2.0 * inertia).abs() < 1e-9);
}
