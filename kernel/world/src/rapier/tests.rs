#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use sagci_model::EffectEntry;
use sagci_signal::GripperCommand;
use sha2::{Digest, Sha256};

use super::*;
use crate::testing::{exact, model, put, put_model, scene};
use crate::{Perturbation, SensorNoise};
use crate::{Placement, SceneObject};

fn world(scene: &Scene, seed: u64, options: WorldOptions) -> RapierWorld {
    let mut world = RapierWorld::new(options);
    world.reset(scene, seed).unwrap();
    world
}

/// Efforts that hold the arm against gravity: the weight of each body along the motion of its centre of mass.
fn gravity_compensation(world: &RapierWorld) -> Vec<f64> {
    let state = world.state.as_ref().unwrap();
    let moving = |joint: usize| state.things[0].joints[joint].as_ref().unwrap();
    state
        .arm
        .iter()
        .map(|a| {
            let (multibody, id) = state.physics.multibody_joints.get(moving(a.joint).handle).unwrap();
            let dof = multibody.link(id).unwrap().assembly_id();
            multibody
                .links()
                .map(|l| state.physics.bodies[l.rigid_body_handle()].mass() * GRAVITY * multibody.body_jacobian(l.link_id())[(2, dof)])
                .filter(|t| t.is_finite())
                .sum()
        })
        .collect()
}

fn hold_still(world: &mut RapierWorld, steps: usize, gripper: GripperCommand) {
    for _ in 0..steps {
        let tau = gravity_compensation(world);
        world.advance(&Command { tau, gripper }).unwrap();
    }
}

/// Drives the gantry's slide to a height with a critically damped servo.
fn lift_to(world: &mut RapierWorld, height: f64, steps: usize, gripper: GripperCommand) {
    for _ in 0..steps {
        let (q, v) = world.state.as_ref().unwrap().joint_state(0, 0);
        let tau = gravity_compensation(world)[0] + 400.0 * (height - q).clamp(-0.05, 0.05) - 60.0 * v;
        world.advance(&Command { tau: vec![tau], gripper }).unwrap();
    }
}

fn object_pose(world: &RapierWorld, object: usize) -> Isometry3<f64> {
    world.state.as_ref().unwrap().X_WL(object + 1, 0)
}

#[test]
fn an_arm_with_its_weight_balanced_does_not_drift() {
    let mut world = world(&scene("arm", "ready"), 1, exact());
    let before: Vec<f64> = (0..4).map(|j| world.state.as_ref().unwrap().joint_state(0, j).0).collect();
    assert_eq!(before, [0.3, 0.7, -0.4, 0.9]);
    hold_still(&mut world, 1000, GripperCommand { width: 0.08, force: 20.0 });
    for (j, q) in before.iter().enumerate() {
        let drift = (world.state.as_ref().unwrap().joint_state(0, j).0 - q).abs();
        assert!(drift < 1e-6, "joint {j} drifted by {drift}");
    }
}

#[test]
fn a_swinging_arm_keeps_its_energy() {
    let mut world = world(&scene("arm", "ready"), 1, exact());
    let energy = |world: &RapierWorld| -> f64 {
        let state = world.state.as_ref().unwrap();
        state.things[0].bodies[1..]
            .iter()
            .map(|b| {
                let body = &state.physics.bodies[*b];
                body.kinetic_energy() + body.mass() * GRAVITY * body.center_of_mass().z
            })
            .sum()
    };
    let start = energy(&world);
    let mut greatest_speed: f64 = 0.0;
    for _ in 0..250 {
        world.advance(&Command { tau: vec![0.0; 4], gripper: GripperCommand { width: 0.08, force: 20.0 } }).unwrap();
        greatest_speed = greatest_speed.max(world.observe().v.iter().fold(0.0, |a, v| a.max(v.abs())));
    }

    assert!(greatest_speed > 1.0, "it did not swing");
    let drift = (energy(&world) - start).abs();
    assert!(drift < 0.02 * start.abs(), "energy {start} drifted by {drift} J");
}

fn door_with_bias(torque: f64) -> RapierWorld {
    let mut scene = scene("gantry", "high");
    let mut door = model("door");
    door.document.effects.push(EffectEntry {
        effect: "torque_bias".into(),
        joint: Some("hinge".into()),
        parameters: [("bias".to_owned(), -torque)].into(),
        ..EffectEntry::default()
    });
    put_model(&mut scene, "door", door, [0.5, 0.0, 0.0]);
    world(&scene, 1, exact())
}

#[test]
fn a_door_sticks_below_its_dry_friction_and_moves_above() {
    for (torque, moves) in [(1.99, false), (2.01, true)] {
        let mut world = door_with_bias(torque);
        lift_to(&mut world, 0.8, 1000, GripperCommand::default());
        let (q, v) = world.state.as_ref().unwrap().joint_state(1, 0);
        if moves {
            // I dv/dt = excess - c v, from rest: I about the hinge is 0.03 + 2 * 0.2^2.
            let (inertia, damping, excess): (f64, f64, f64) = (0.11, 0.4, 0.01);
            let expected = excess / damping * (1.0 - (-damping / inertia).exp());
            assert!((v - expected).abs() < 1e-4, "moves at {v} rad/s, expected {expected}");
        } else {
            assert!(q.abs() < 1e-6 && v.abs() < 1e-6, "crept to {q} rad");
        }
    }
}

#[test]
fn a_joint_stops_at_its_limits() {
    let mut world = door_with_bias(12.0);
    lift_to(&mut world, 0.8, 1500, GripperCommand::default());
    let (q, v) = world.state.as_ref().unwrap().joint_state(1, 0);
    assert!((q - 1.6).abs() < 0.005 && v.abs() < 0.01, "at {q} rad with {v} rad/s");
    // The arm's own joint: pushed up with all it has.
    for _ in 0..1500 {
        world.advance(&Command { tau: vec![30.0], gripper: GripperCommand::default() }).unwrap();
    }
    let q = world.observe().q[0];
    assert!((q - 1.2).abs() < 0.005, "the slide went to {q} m");
}

#[test]
fn efforts_are_clipped_at_the_drives_limit() {
    let mut world = world(&scene("gantry", "high"), 1, exact());
    world.advance(&Command { tau: vec![1e6], gripper: GripperCommand::default() }).unwrap();
    assert_eq!(world.observe().tau, [300.0]);
}

#[test]
fn a_cup_on_the_table_does_not_creep() {
    let mut scene = scene("gantry", "high");
    put(&mut scene, "cup", [0.3, 0.1, 0.0]);
    let mut world = world(&scene, 1, exact());
    lift_to(&mut world, 0.8, 300, GripperCommand::default());
    let before = object_pose(&world, 0);
    lift_to(&mut world, 0.8, 5000, GripperCommand::default());
    let after = object_pose(&world, 0);
    let moved = (after.translation.vector - before.translation.vector).norm();
    let turned = after.rotation.angle_to(&before.rotation);
    assert!(moved < 1e-4 && turned < 1e-3, "moved {moved} m and turned {turned} rad");
    assert!(before.translation.z.abs() < 5e-4, "stands at {} m", before.translation.z);
}

/// A box of 500 g with friction 0.5 on rubber, gripped and lifted by 20 cm.
fn lifted_box() -> RapierWorld {
    let mut scene = scene("gantry", "grasp");
    put(&mut scene, "box", [0.0, 0.0, 0.0]);
    let mut world = world(&scene, 1, exact());
    let grip = GripperCommand { width: 0.0, force: 30.0 };
    lift_to(&mut world, -0.07, 600, grip);
    let observed = world.observe();
    assert!((observed.gripper_width - 0.05).abs() < 1e-3, "closed to {} m", observed.gripper_width);
    assert!((observed.gripper_force - 30.0).abs() < 0.1, "presses with {} N", observed.gripper_force);
    lift_to(&mut world, 0.13, 4500, grip);
    // The servo sags by the weight over its stiffness.
    let expected = 0.2 - 0.5 * GRAVITY / 400.0;
    assert!((object_pose(&world, 0).translation.z - expected).abs() < 1e-3, "lifted to {}", object_pose(&world, 0).translation.z);
    world
}

#[test]
fn a_gripped_box_holds_below_the_coulomb_threshold_and_slips_above() {
    // Two pads with friction 0.5 carry 0.5 kg from 4.905 N on.
    for (force, slips) in [(5.2, false), (4.6, true)] {
        let mut world = lifted_box();
        let below_hand = |world: &RapierWorld| world.state.as_ref().unwrap().X_WL(0, 1).translation.z - object_pose(world, 0).translation.z;
        let before = below_hand(&world);
        let grip = GripperCommand { width: 0.0, force };
        lift_to(&mut world, 0.13, 500, grip);
        let slid = below_hand(&world) - before;
        assert_eq!(slid > 0.005, slips, "with {force} N it slid by {slid} m");
        assert!(slips || slid < 5e-4, "with {force} N it crept by {slid} m");
    }
}

#[test]
fn the_wrist_feels_the_weight_that_hangs_on_the_hand() {
    let mut world = lifted_box();
    lift_to(&mut world, 0.13, 500, GripperCommand { width: 0.0, force: 30.0 });
    let F = world.observe().F_S;
    let weight = Vector3::new(0.0, 0.0, -0.5 * GRAVITY);
    assert!((F.force - weight).norm() < 0.03, "felt {}", F.force);
    assert!(F.torque.norm() < 0.02, "felt the torque {}", F.torque);
}

#[test]
fn the_camera_sees_the_table_at_its_distance() {
    let mut world = world(&scene("gantry", "high"), 1, exact());
    let image = world.look().unwrap();
    assert_eq!((image.width, image.height), (160, 120));
    for row in 30..90 {
        for column in 60..130 {
            let z = image.depth[row * 160 + column];
            assert!((z - 1.0).abs() < 1e-4, "depth {z} at {column}, {row}");
        }
    }
}

#[test]
fn depth_noise_is_as_documented() {
    let options = WorldOptions { perturbation: Perturbation::NONE, sensors: SensorNoise { depth: 1.0, ..SensorNoise::NONE } };
    let mut world = world(&scene("gantry", "high"), 3, options);
    let (mut n, mut lost, mut sum, mut squares) = (0.0, 0.0, 0.0, 0.0);
    for _ in 0..10 {
        let image = world.look().unwrap();
        for row in 30..90 {
            for column in 60..130 {
                let z = f64::from(image.depth[row * 160 + column]);
                n += 1.0;
                if z == 0.0 {
                    lost += 1.0;
                } else {
                    sum += z - 1.0;
                    squares += (z - 1.0) * (z - 1.0);
                }
            }
        }
    }
    let mean = sum / (n - lost);
    let deviation = (squares / (n - lost) - mean * mean).sqrt();
    // z^2 * 0.08 px / (424 px * 0.05 m), and quantisation.
    assert!((deviation - 0.0038).abs() < 0.0003, "deviation {deviation}");
    assert!(mean.abs() < 0.0005, "mean {mean}");
    assert!((lost / n - 0.01f64).abs() < 0.004, "lost {}", lost / n);
}

fn hash(world: &mut RapierWorld) -> String {
    let mut hasher = Sha256::new();
    let frame = world.true_frame();
    for (name, X) in &frame.frames {
        hasher.update(name.as_bytes());
        X.translation.vector.iter().chain(X.rotation.coords.iter()).for_each(|c| hasher.update(c.to_le_bytes()));
    }
    frame.joints.iter().for_each(|(_, q, v)| {
        hasher.update(q.to_le_bytes());
        hasher.update(v.to_le_bytes());
    });
    let seen = world.observe();
    [&seen.q, &seen.v, &seen.tau].into_iter().flatten().for_each(|x| hasher.update(x.to_le_bytes()));
    world.look().unwrap().depth.iter().for_each(|z| hasher.update(z.to_le_bytes()));
    hasher.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

fn everything(robot: &str) -> Scene {
    let mut scene = scene(robot, if robot == "arm" { "ready" } else { "high" });
    put(&mut scene, "door", [0.8, 0.3, 0.0]);
    put(&mut scene, "cup", [0.4, -0.4, 0.0]);
    scene.objects.push(SceneObject {
        name: "box".into(),
        model: Arc::new(model("box")),
        placement: Placement::Inside { object: "door".into(), region: Some("behind".into()) },
        q: Vec::new(),
        hidden_effect: None,
    });
    scene
}

#[test]
fn one_seed_gives_the_same_bits_and_another_seed_does_not() {
    let run = |seed: u64| {
        let mut world = world(&everything("gantry"), seed, WorldOptions::default());
        let start = object_pose(&world, 1);
        for i in 0..300 {
            world.advance(&Command { tau: vec![7.0 + f64::from(i % 7)], gripper: GripperCommand::default() }).unwrap();
        }
        (start, hash(&mut world))
    };
    let (a, b, c) = (run(5), run(5), run(6));
    assert_eq!(a, b);
    assert_ne!(a.1, c.1);
    assert_ne!(a.0, c.0);
}

#[test]
fn objects_start_within_their_bounds_and_apart() {
    let scene = everything("gantry");
    let (mut farthest, mut yaws) = (0.0f64, 0.0f64);
    for seed in 0..60 {
        let world = world(&scene, seed, WorldOptions::default());
        let state = world.state.as_ref().unwrap();
        for object in 0..2 {
            let X = object_pose(&world, object);
            let Placement::World(nominal) = &scene.objects[object].placement else { panic!() };
            let shift = (X.translation.vector - nominal.translation.vector).xy().norm();
            let yaw = X.rotation.euler_angles().2.abs();
            assert!(shift <= 0.1 && yaw <= 15f64.to_radians() + 1e-9, "moved by {shift} m and {yaw} rad");
            farthest = farthest.max(shift);
            yaws = yaws.max(yaw);
        }
        let goal = Goal::Inside(crate::judge::Inside { object: "box".into(), of: "door".into(), region: None, tolerance_cm: 0.0 });
        let X_box = object_pose(&world, 2);
        let up = X_box * Vector3::z();
        assert!(up.angle(&Vector3::z()) < 1e-6);
        let seconds = state.seconds();
        assert_eq!(seconds, 0.0);
        let verdict = Box::new(world).judge(&[goal]).unwrap();
        assert!(verdict.met, "seed {seed}: {verdict:?}");
    }
    assert!(farthest > 0.09 && yaws > 13f64.to_radians(), "the draws reach only {farthest} m and {yaws} rad");
}

#[test]
fn a_bad_command_is_refused_and_changes_nothing() {
    let mut world = world(&everything("gantry"), 5, WorldOptions::default());
    let before = world.true_frame();
    let gripper = GripperCommand::default();
    let bad = [
        Command { tau: vec![], gripper },
        Command { tau: vec![1.0, 2.0], gripper },
        Command { tau: vec![f64::NAN], gripper },
        Command { tau: vec![f64::INFINITY], gripper },
        Command { tau: vec![0.0], gripper: GripperCommand { width: f64::NAN, force: 1.0 } },
        Command { tau: vec![0.0], gripper: GripperCommand { width: 0.0, force: f64::NEG_INFINITY } },
    ];
    for command in bad {
        assert!(matches!(world.advance(&command), Err(WorldError::Command { .. })), "{command:?}");
    }
    assert_eq!(world.true_frame(), before);
    // Out of the gripper's range is clipped, not refused.
    world.advance(&Command { tau: vec![7.0], gripper: GripperCommand { width: -3.0, force: 1e9 } }).unwrap();
}

#[test]
fn a_world_that_was_never_reset_says_so() {
    let mut world = RapierWorld::new(exact());
    assert!(matches!(world.advance(&Command::default()), Err(WorldError::Scene { .. })));
    assert!(world.look().is_err());
    assert_eq!(world.observe(), Observation::default());
    assert!(world.true_frame().frames.is_empty());
}

#[test]
fn physics_that_breaks_down_is_an_error_and_stays_one() {
    let mut world = door_with_bias(1e15);
    let command = Command { tau: vec![7.0], gripper: GripperCommand::default() };
    let error = (0..50).find_map(|_| world.advance(&command).err());
    assert!(matches!(error, Some(WorldError::Physics { .. })), "{error:?}");
    assert!(matches!(world.advance(&command), Err(WorldError::Physics { .. })));
}

#[test]
fn an_effect_that_is_not_simulated_is_refused() {
    let mut scene = scene("gantry", "high");
    let mut door = model("door");
    door.document.effects.push(EffectEntry {
        effect: "gremlins".into(),
        joint: Some("hinge".into()),
        parameters: [].into(),
        ..EffectEntry::default()
    });
    put_model(&mut scene, "door", door, [0.5, 0.0, 0.0]);
    let error = RapierWorld::new(exact()).reset(&scene, 1).unwrap_err().to_string();
    assert!(error.contains("door") && error.contains("gremlins") && error.contains("joint_spring"), "{error}");
    // One that was estimated may be wrong; the world is then without it.
    let mut door = scene.objects.remove(0).model.as_ref().clone();
    door.document.effects[0].evidence = Some(sagci_model::Evidence {
        intervals: [].into(),
        probability: 0.9,
        alternatives: Vec::new(),
        data: Vec::new(),
        held_out: Vec::new(),
        gap: [0.1, 0.01],
    });
    put_model(&mut scene, "door", door, [0.5, 0.0, 0.0]);
    RapierWorld::new(exact()).reset(&scene, 1).unwrap();
}

#[test]
fn scenes_that_cannot_be_are_refused() {
    let refused = |scene: &Scene| RapierWorld::new(WorldOptions::default()).reset(scene, 1).unwrap_err().to_string();
    assert!(refused(&scene("gantry", "nowhere")).contains("low, high"));
    let mut crowded = scene("gantry", "high");
    put(&mut crowded, "cup", [0.3, 0.0, 0.0]);
    let mut second = crowded.objects[0].clone();
    crowded.objects.push(second.clone());
    assert!(refused(&crowded).contains("twice"));
    second.name = "robot".into();
    second.model = scene("gantry", "low").robot;
    assert!(!refused(&scene("box", "low")).is_empty());
    let mut inside = scene("gantry", "high");
    put(&mut inside, "cup", [0.3, 0.0, 0.0]);
    inside.objects[0].placement = Placement::Inside { object: "cupboard".into(), region: None };
    assert!(refused(&inside).contains("cupboard"));
    // Buried in the robot's hand.
    let mut buried = scene("gantry", "grasp");
    put(&mut buried, "cup", [0.0, 0.0, 0.1]);
    assert!(RapierWorld::new(exact()).reset(&buried, 1).unwrap_err().to_string().contains("collision"));
}

#[test]
fn the_judge_tells_a_good_run_from_a_bad_one() {
    let goals: crate::judge::Goals = serde_yaml::from_str(
        "goals:
  - joint_passed: { object: door, joint: hinge, past_deg: 60 }
  - joint_at: { object: door, joint: hinge, at_deg: 90, within_deg: 3 }
  - upright: { object: cup, within_deg: 5 }
  - untouched: { object: cup }
  - still: { object: cup }
  - on_table: { object: cup }
",
    )
    .unwrap();
    let mut scene = door_with_bias(12.0).state.unwrap().scene;
    put(&mut scene, "cup", [0.2, -0.5, 0.0]);
    goals.check(&scene).unwrap();
    let mut world = world(&scene, 1, exact());
    lift_to(&mut world, 0.8, 1500, GripperCommand::default());
    let verdict = Box::new(world).judge(&goals.goals).unwrap();
    let met: Vec<bool> = verdict.goals.iter().map(|g| g.met).collect();
    assert_eq!(met, [true, true, true, true, true, true], "{verdict:?}");

    let mut gripped = lifted_box();
    lift_to(&mut gripped, 0.13, 100, GripperCommand { width: 0.0, force: 30.0 });
    let object = || crate::judge::Untouched { object: "box".into() };
    let verdict = Box::new(gripped).judge(&[Goal::Untouched(object()), Goal::OnTable(object())]).unwrap();
    assert!(!verdict.met && !verdict.goals[0].met && !verdict.goals[1].met, "{verdict:?}");
}

#[test]
fn speed_is_printed() {
    let mut world = world(&everything("arm"), 1, WorldOptions::default());
    let start = std::time::Instant::now();
    for _ in 0..1000 {
        world.advance(&Command { tau: vec![0.0; 4], gripper: GripperCommand::default() }).unwrap();
    }
    println!("{:.0} us a step", start.elapsed().as_secs_f64() * 1e3);
    let start = std::time::Instant::now();
    for _ in 0..10 {
        world.look().unwrap();
    }
    println!("{:.2} ms an image", start.elapsed().as_secs_f64() * 100.0);
}

/// Angle of the bar, and height of the hand, after a bar of 20 mm radius was turned in the grip under a load along the pads.
fn roll(load: f64, torque: f64) -> (f64, f64) {
    let mut scene = scene("gantry", "roll");
    let mut roller = model("roller");
    roller.document.effects.push(EffectEntry {
        effect: "torque_bias".into(),
        joint: Some("axle".into()),
        parameters: [("bias".to_owned(), -torque)].into(),
        ..EffectEntry::default()
    });
    put_model(&mut scene, "roller", roller, [0.0, 0.0, 0.0]);
    let mut world = world(&scene, 1, exact());
    let state = |world: &RapierWorld| {
        let state = world.state.as_ref().unwrap();
        [state.joint_state(1, 0).0, state.joint_state(0, 0).0]
    };
    let mut before = [0.0; 2];
    for i in 0..1800 {
        let (q, v) = world.state.as_ref().unwrap().joint_state(0, 0);
        let hold = if i < 600 { -2000.0 * q - 60.0 * v } else { load };
        let tau = gravity_compensation(&world)[0] + hold;
        world.advance(&Command { tau: vec![tau], gripper: GripperCommand { width: 0.0, force: 40.0 } }).unwrap();
        if i == 900 {
            before = state(&world);
        }
    }
    let after = state(&world);
    (after[0] - before[0], after[1] - before[1])
}

#[test]
fn a_bar_that_is_turned_in_the_grip_rolls_under_load() {
    // Both pads drag in opposite directions, so a load along them is carried by neither: the hand gives way until it rolls
    // on one of the pads. Without turning, friction holds 8 N easily.
    let (angle, shift) = roll(8.0, 0.0);
    assert!(angle.abs() < 1e-3 && shift.abs() < 1e-4, "turned by {angle} rad, moved by {shift} m");
    let (angle, shift) = roll(8.0, 3.0);
    assert!(angle > 0.15, "turned by {angle} rad");
    assert!((shift - 0.02 * angle).abs() < 0.15 * 0.02 * angle, "turned by {angle} rad, moved by {shift} m");
}

#[test]
fn the_mounting_error_never_puts_the_shipped_camera_behind_its_own_housing() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
    let version = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    let robot = std::sync::Arc::new(sagci_model::ObjectModel::read(folder.join(version.trim())).unwrap());
    let scene = Scene { robot, start: "look_ahead".into(), table_height: 0.0, objects: Vec::new() };
    for seed in 0..30 {
        let image = world(&scene, seed, WorldOptions::default()).look().unwrap();
        let measured = image.depth.iter().filter(|z| **z > 0.0).count();
        assert!(measured > image.depth.len() / 2, "seed {seed}: {measured} of {} pixels measured", image.depth.len());
    }
}

/// The door, driven open, with an effect that its model lacks.
fn door_that_hides(seed: u64, torque: f64) -> RapierWorld {
    let mut scene = door_with_bias(torque).state.unwrap().scene;
    scene.objects[0].hidden_effect = Some("hinge".into());
    world(&scene, seed, exact())
}

/// Resistance of a hidden effect, written down a second time from the catalogue.
fn resistance(entry: &EffectEntry, q: f64, v: f64) -> f64 {
    let p = |name: &str| entry.parameters[name];
    let x = || (q - p("position")) / p("width");
    match entry.effect.as_str() {
        "joint_spring" => p("stiffness") * (q - p("rest_position")),
        "torque_bias" => p("bias"),
        "hinge_tilt" => p("amplitude") * (q + p("phase")).sin(),
        "magnetic_gasket" => p("force") * (-q / p("width")).exp(),
        "detent" => p("force") * x() * (0.5 - x() * x() / 2.0).exp(),
        "quadratic_drag" => p("drag") * v * v.abs(),
        "torque_ripple" => p("amplitude") * (p("cycles_per_turn") * q + p("phase")).sin(),
        "position_dependent_friction" => (p("friction") + p("amplitude") * (-x() * x() / 2.0).exp()) * v.signum(),
        "soft_close_damper" if q < p("position") => p("damping") * v.min(0.0) + p("stiffness") * q,
        "soft_close_damper" => 0.0,
        other => panic!("{other}"),
    }
}

#[test]
fn a_hidden_effect_moves_the_door_as_the_catalogue_says() {
    let torque = 18.0;
    let mut seen = std::collections::BTreeSet::new();
    for seed in 0..200 {
        let mut world = door_that_hides(seed, torque);
        let entry = world.state.as_ref().unwrap().hidden[0].clone().unwrap();
        if !seen.insert(entry.effect.clone()) {
            continue;
        }
        // I dv/dt = torque - c v - F sgn(v) - resistance, in steps far shorter than the world's.
        let (inertia, damping, friction) = (0.11, 0.4, 2.0);
        let (mut q, mut v) = (0.0f64, 0.0f64);
        for i in 0..250 {
            world.advance(&Command { tau: vec![7.0], gripper: GripperCommand::default() }).unwrap();
            for _ in 0..50 {
                v += 2e-5 * (torque - damping * v - friction * v.signum() - resistance(&entry, q, v)) / inertia;
                q += 2e-5 * v;
            }
            let measured = world.state.as_ref().unwrap().joint_state(1, 0);
            assert!((measured.0 - q).abs() < 0.004 + 0.01 * q.abs(), "{entry:?}: at {} rad after {i} steps, expected {q}", measured.0);
            // Its stop is near.
            if q > 1.2 {
                break;
            }
        }
        assert!(q > 0.2, "{entry:?} holds the door at {q}");
    }
    // All but the bias, by which the model itself drives this door.
    assert_eq!(seen.len(), 8, "{seen:?}");
}

#[test]
fn the_hidden_effect_has_to_be_named_alone_and_the_last_answer_counts() {
    let goal = || Goal::EffectNamed(crate::judge::EffectNamed { object: "door".into(), joint: "hinge".into() });
    let named = |name: &str, alternatives: &[&str]| NamedEffect {
        name: name.into(),
        alternatives: alternatives.iter().map(|a| (*a).to_owned()).collect(),
        joint: "hinge".into(),
    };
    let judged = |answers: &dyn Fn(&str) -> Vec<Vec<NamedEffect>>| {
        let mut world = door_that_hides(3, 1.0);
        let hidden = world.state.as_ref().unwrap().hidden[0].clone().unwrap().effect;
        answers(&hidden).iter().for_each(|a| world.answer("door", a));
        let verdict = Box::new(world).judge(&[goal()]).unwrap();
        assert!(verdict.goals[0].text.contains(&hidden), "{verdict:?}");
        verdict.met
    };
    assert!(judged(&|hidden| vec![vec![named(hidden, &[])]]));
    assert!(judged(&|hidden| vec![vec![named("latch", &[hidden])]]));
    assert!(judged(&|hidden| vec![vec![named("latch", &[])], vec![named(hidden, &[])]]));
    assert!(!judged(&|_| vec![]));
    assert!(!judged(&|_| vec![vec![named("latch", &[])]]));
    assert!(!judged(&|hidden| vec![vec![named(hidden, &[]), named("latch", &[])]]));
    let nothing_hidden = crate::judge::Goals { goals: vec![goal()] }.check(&door_with_bias(1.0).state.unwrap().scene);
    assert!(nothing_hidden.unwrap_err().to_string().contains("hidden_effect"));
}

#[test]
fn an_effect_cannot_be_hidden_in_a_joint_that_is_not_there() {
    let mut scene = door_with_bias(1.0).state.unwrap().scene;
    scene.objects[0].hidden_effect = Some("hinges".into());
    let error = RapierWorld::new(exact()).reset(&scene, 1).unwrap_err().to_string();
    assert!(error.contains("door") && error.contains("'hinges'"), "{error}");
}
