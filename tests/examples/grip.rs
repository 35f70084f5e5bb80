//! Tries the measured world by hand: pulls the microwave's door open by its handle and lifts the mug by its rim, by
//! friction alone, under an impedance controller that knows the exact poses. Prints what the judge says and the speed.
//!
//! `cargo run --release -p sagci-tests --example grip -- [door|mug|speed] [seed]`; with a seed the physical parameters
//! are drawn (the poses stay), without one the world is exactly as modelled.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};
use sagci_control::{ArmModel, CartesianImpedance, CartesianReference, Damping, Posture};
use sagci_model::{GraspHint, ObjectModel};
use sagci_planning::{ArmKinematics, ArticulationRequest, CollisionWorld, FreeMotionOptions, free_motion, plan_articulation};
use sagci_signal::{Command, GripperCommand};
use sagci_world::judge::{Goals, Verdict};
use sagci_world::{Perturbation, Placement, Scene, SceneObject, WorldOptions, open};

fn model(name: &str) -> Arc<ObjectModel> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../world-models").join(name);
    let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    Arc::new(ObjectModel::read(folder.join(head.trim())).unwrap())
}

struct Driver {
    world: Box<dyn sagci_world::World>,
    arm: ArmModel,
    law: CartesianImpedance,
    command: Command,
    target: Isometry3<f64>,
    verbose: bool,
    posture: Option<Box<dyn Fn(f64) -> Posture>>,
}

impl Driver {
    fn new(scene: &Scene, seed: Option<u64>) -> Self {
        let drawn = Perturbation { position: 0.0, yaw: 0.0, region: 0.0, region_yaw: 0.0, ..Perturbation::default() };
        let perturbation = if seed.is_some() { drawn } else { Perturbation::NONE };
        let mut world = open("rapier", WorldOptions { perturbation, ..WorldOptions::default() }).unwrap();
        world.reset(scene, seed.unwrap_or(1)).unwrap();
        let mut arm = ArmModel::new(&scene.robot, Isometry3::identity()).unwrap();
        arm.observe(&world.observe()).unwrap();
        let law = CartesianImpedance::new(&arm, CartesianImpedance::diagonal(40.0, [800.0; 3]), Damping::Ratio(1.0)).unwrap();
        let target = *arm.X_WT();
        let command = Command { tau: vec![0.0; 7], gripper: GripperCommand { width: 0.08, force: 20.0 } };
        Self { world, arm, law, command, target, verbose: std::env::var("VERBOSE").is_ok(), posture: None }
    }

    /// Follows a path of tool poses over `seconds`; `path` maps 0..1 to a pose.
    fn follow(&mut self, name: &str, seconds: f64, path: impl Fn(f64) -> Isometry3<f64>) {
        let (n, dt) = ((seconds * 1000.0) as usize, 0.001);
        // Minimum jerk.
        let s = |t: f64| {
            let t = t.clamp(0.0, 1.0);
            t * t * t * (10.0 + t * (6.0 * t - 15.0))
        };
        for i in 0..n {
            let pose = |k: usize| path(s(k as f64 / n as f64));
            let (now, next) = (pose(i), pose(i + 1));
            let w = (next.rotation * now.rotation.inverse()).scaled_axis() / dt;
            let v = (next.translation.vector - now.translation.vector) / dt;
            let reference = CartesianReference { V_WD: Vector6::new(w.x, w.y, w.z, v.x, v.y, v.z), ..CartesianReference::at(now) };
            let observation = self.world.observe();
            if let Some(posture) = &self.posture {
                self.law.set_posture(&posture(s(i as f64 / n as f64))).unwrap();
            }
            self.law.step(&mut self.arm, &observation, &reference, dt, &mut self.command).unwrap();
            self.world.advance(&self.command).unwrap();
            if self.verbose && i % 250 == 0 {
                let o = self.world.observe();
                println!(
                    "  {:.2} s error {:.4} m {:.3} rad, width {:.4} m, grip {:.1} N, F {:.1?} q {:.2?}",
                    o.time,
                    self.law.error().fixed_rows::<3>(3).norm(),
                    self.law.error().fixed_rows::<3>(0).norm(),
                    o.gripper_width,
                    o.gripper_force,
                    o.F_S.force.as_slice(),
                    o.q,
                );
            }
        }
        self.target = path(1.0);
        let o = self.world.observe();
        println!(
            "{name}: {:.1} s, error {:.1} mm, width {:.1} mm, grip {:.1} N, wrist {:.1} N",
            o.time,
            1e3 * self.law.error().fixed_rows::<3>(3).norm(),
            1e3 * o.gripper_width,
            o.gripper_force,
            o.F_S.force.norm()
        );
    }

    fn go(&mut self, name: &str, seconds: f64, to: Isometry3<f64>) {
        let from = self.target;
        self.follow(name, seconds, move |s| from.lerp_slerp(&to, s));
    }

    fn grip(&mut self, name: &str, width: f64, force: f64) {
        self.command.gripper = GripperCommand { width, force };
        let here = self.target;
        self.follow(name, 1.2, move |_| here);
    }

    fn judge(self, goals: &str) -> Verdict {
        let goals = Goals::parse(goals, Path::new("grip")).unwrap();
        self.world.judge(&goals.goals).unwrap()
    }
}

fn scene() -> Scene {
    let object = |name: &str, x: f64, y: f64, yaw_deg: f64| {
        let model = model(name);
        SceneObject {
            name: name.into(),
            q: vec![0.0; model.moving_joints().count()],
            hidden_effect: None,
            model,
            placement: Placement::World(Isometry3::new(Vector3::new(x, y, 0.0), Vector3::z() * yaw_deg.to_radians())),
        }
    };
    let objects = vec![object("microwave", 0.95, 0.0, -90.0), object("mug", 0.45, -0.4, 0.0)];
    Scene { robot: model("panda"), start: "ready".into(), table_height: 0.0, objects }
}

fn turn(x: Vector3<f64>, y: Vector3<f64>, z: Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z])))
}

fn between(path: &[Vec<f64>], s: f64) -> Vec<f64> {
    let x = s * (path.len() - 1) as f64;
    let i = (x as usize).min(path.len().saturating_sub(2));
    let j = (i + 1).min(path.len() - 1);
    path[i].iter().zip(&path[j]).map(|(a, b)| a + (x - i as f64) * (b - a)).collect()
}

/// Along joint positions, evenly in their number; the arm's posture follows them too.
fn along(driver: &mut Driver, name: &str, seconds: f64, arm: &ArmKinematics, path: &[Vec<f64>]) {
    let points = path.to_vec();
    driver.posture = Some(Box::new(move |s| Posture { q: between(&points, s), stiffness: 30.0, damping: 3.0 }));
    driver.follow(name, seconds, |s| arm.X_WT(&between(path, s)));
    driver.posture = None;
}

fn door(seed: Option<u64>) -> Verdict {
    let mut scene = scene();
    if let Some(GraspHint::Bar(bar)) = Arc::make_mut(&mut scene.objects[0].model).document.grasps.first_mut() {
        bar.swing = std::env::var("SWING").ok().and_then(|s| s.parse().ok()).unwrap_or(bar.swing);
    }
    let objects = scene.objects.iter().map(|o| {
        let Placement::World(X_WO) = o.placement else { unreachable!() };
        sagci_planning::SceneObject { name: o.name.clone(), model: o.model.clone(), X_WO, q: o.q.clone(), X_TO: None }
    });
    let planned = sagci_planning::Scene {
        robot: scene.robot.clone(),
        X_WR: Isometry3::identity(),
        table_height: 0.0,
        gravity: Vector3::z() * -9.81,
        objects: objects.collect(),
    };
    let collisions = CollisionWorld::new(&planned).unwrap();
    let arm = ArmKinematics::new(&scene.robot, &Isometry3::identity()).unwrap();
    let ready = scene.robot.document.robot.as_ref().unwrap().configurations[0].q.clone();
    let request = ArticulationRequest::new(0, 0, 0.0, 70f64.to_radians(), &ready);
    let plan = plan_articulation(&planned, &collisions, &request, &|| false).unwrap().remove(0);
    println!(
        "the grip turns about the bar by {:.2?} rad",
        plan.freedom.iter().map(|f| f - plan.freedom[0]).fold([0f64; 2], |[a, b], x| [a.min(x), b.max(x)])
    );
    let reach = free_motion(&collisions, &ready, &plan.approach[..1], 0.08, &FreeMotionOptions::default(), &|| false).unwrap();
    let mut driver = Driver::new(&scene, seed);
    along(&mut driver, "approach", 4.0, &arm, &reach.q);
    along(&mut driver, "reach", 2.0, &arm, &plan.approach);
    driver.grip("close", 0.0, 40.0);
    along(&mut driver, "pull", 5.0, &arm, &plan.path);
    driver.judge("goals:\n  - joint_passed: { object: microwave, joint: door_hinge, past_deg: 60 }\n  - joint_at: { object: microwave, joint: door_hinge, at_deg: 70, within_deg: 5 }\n")
}

fn mug(seed: Option<u64>) -> Verdict {
    let scene = scene();
    let Placement::World(X_WO) = scene.objects[1].placement else { unreachable!() };
    let rim = X_WO * nalgebra::Point3::new(0.0, 0.0414, 0.0814 - 0.02);
    let R = turn(Vector3::x(), -Vector3::y(), -Vector3::z());
    let grasp = Isometry3::from_parts(Translation3::from(rim.coords), R);
    let up = |d: f64| Translation3::new(0.0, 0.0, d) * grasp;
    let mut driver = Driver::new(&scene, seed);
    driver.go("approach", 3.0, up(0.12));
    driver.go("reach", 1.5, grasp);
    driver.grip("close", 0.0, 30.0);
    driver.go("lift", 2.0, up(0.2));
    driver.go("hold", 3.0, up(0.2));
    driver.go("lower", 2.0, up(0.001));
    driver.grip("open", 0.06, 20.0);
    driver.go("leave", 1.5, up(0.12));
    driver.judge("goals:\n  - upright: { object: mug, within_deg: 3 }\n  - on_table: { object: mug }\n  - untouched: { object: mug }\n  - still: { object: mug }\n")
}

fn speed() {
    let mut driver = Driver::new(&scene(), None);
    let start = Instant::now();
    for _ in 0..2000 {
        let tau = driver.command.tau.clone();
        driver.world.advance(&Command { tau, ..driver.command }).unwrap();
    }
    println!("{:.0} us a step", start.elapsed().as_secs_f64() / 2000.0 * 1e6);
    let start = Instant::now();
    for _ in 0..20 {
        driver.world.look().unwrap();
    }
    println!("{:.1} ms an image", start.elapsed().as_secs_f64() / 20.0 * 1e3);
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seed = arguments.get(1).and_then(|s| s.parse().ok());
    let what = arguments.first().map_or("speed", String::as_str);
    let start = Instant::now();
    let verdict = match what {
        "door" => door(seed),
        "mug" => mug(seed),
        _ => return speed(),
    };
    println!("{} in {:.1} s of wall time", if verdict.met { "met" } else { "NOT MET" }, start.elapsed().as_secs_f64());
    for goal in verdict.goals {
        println!("  {} {}: {:.2} {}", if goal.met { "yes" } else { "NO " }, goal.text, goal.value, goal.unit);
    }
}
