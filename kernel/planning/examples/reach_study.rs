//! Which layouts can the arm work in? Draws displaced scenes from seeds, plans each stage of a task, and prints the share
//! of scenes in which it is feasible, with the commonest reasons where it is not.
//!
//! ```text
//! cargo run --release -p sagci-planning --example reach_study -- microwave 20 x=0.8 y=0 z=0
//! ```
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;
use sagci_planning::{
    ArticulationRequest, CollisionWorld, Destination, FreeMotionOptions, PathOptions, PlanError, Scene, SceneObject, TransferOptions,
    free_motion, plan_articulation, plan_pick,
};

fn model(name: &str) -> Arc<ObjectModel> {
    let library = std::env::var("SAGCI_MODELS")
        .map(PathBuf::from)
        .unwrap_or_else(|_| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models"));
    let folder = library.join(name);
    let version = std::fs::read_to_string(folder.join("HEAD")).expect("the library has this object");
    Arc::new(ObjectModel::read(folder.join(version.trim())).expect("its model is sound"))
}

struct Layout {
    values: BTreeMap<String, f64>,
}

impl Layout {
    fn get(&self, name: &str, default: f64) -> f64 {
        self.values.get(name).copied().unwrap_or(default)
    }
}

fn displaced(random: &mut Pcg64, nominal: [f64; 4], shift: f64, turn: f64) -> Isometry3<f64> {
    let mut draw = |s: f64| s * (2.0 * random.random::<f64>() - 1.0);
    let (dx, dy, dyaw) = (draw(shift), draw(shift), draw(turn));
    Isometry3::from_parts(
        Translation3::new(nominal[0] + dx, nominal[1] + dy, nominal[2]),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), nominal[3] + dyaw),
    )
}

/// One stage's outcome and time.
type Stages = Vec<(&'static str, Result<String, PlanError>, f64)>;

fn reach(world: &CollisionWorld, from: &[f64], to: &[f64], width: f64, seed: u64) -> Result<String, PlanError> {
    let options = FreeMotionOptions { seed, ..FreeMotionOptions::default() };
    free_motion(world, from, &[to.to_vec()], width, &options, &|| false).map(|p| format!("{} points", p.q.len()))
}

/// Moves the joint in as few holds as it takes, each from and to `ready` with the ways there and back.
fn handle(scene: &Scene, from: f64, to: f64, ready: &[f64], layout: &Layout, seed: u64) -> Result<String, PlanError> {
    let mut first = None;
    for holds in 1..=layout.get("holds", 3.0) as usize {
        match in_holds(scene, from, to, ready, layout, seed, holds) {
            Ok(said) => return Ok(format!("{holds} holds: {said}")),
            Err(e) => first = first.or(Some(e)),
        }
    }
    Err(first.unwrap())
}

fn in_holds(scene: &Scene, from: f64, to: f64, ready: &[f64], layout: &Layout, seed: u64, holds: usize) -> Result<String, PlanError> {
    let search = PathOptions {
        anchors: layout.get("anchors", 4.0) as usize,
        starts: layout.get("starts", 20.0) as usize,
        nodes: layout.get("nodes", 28.0) as usize,
        ..PathOptions::default()
    };
    let mut scene = scene.clone();
    let mut at = ready.to_vec();
    let mut said = String::new();
    for hold in 0..holds {
        let place = |k: usize| from + (to - from) * k as f64 / holds as f64;
        scene.objects[0].q[0] = place(hold);
        let mut world = CollisionWorld::new(&scene)?;
        world.close_padding = layout.get("close", world.close_padding);
        let request = ArticulationRequest {
            seed,
            search: search.clone(),
            standoff: layout.get("standoff", 0.1),
            ..ArticulationRequest::new(0, 0, place(hold), place(hold + 1), &at)
        };
        let plan = plan_articulation(&scene, &world, &request, &|| false)?.remove(0);
        reach(&world, &at, &plan.approach[0], plan.grasp.width, seed)?;
        said += &format!(
            "score {:.1} load {:.2} clearance {:.3}; ",
            plan.score,
            plan.load,
            world.clearance(&plan.path[0], plan.grasp.width, 0.1)
        );
        at = plan.retreat.last().unwrap().clone();
        world.set_joint(0, 0, place(hold + 1));
        if hold + 1 == holds {
            reach(&world, &at, ready, plan.grasp.width, seed)?;
        }
    }
    Ok(said)
}

/// Done, tried, seconds, and failures by their words.
type Tally = (usize, usize, f64, BTreeMap<String, usize>);

fn study(task: &str, layout: &Layout, seed: u64, models: &BTreeMap<&str, Arc<ObjectModel>>) -> Stages {
    let mut random = Pcg64::seed_from_u64(seed);
    let (shift, turn) = (layout.get("shift", 0.1), layout.get("turn", 15.0_f64).to_radians());
    let half_turn = -std::f64::consts::FRAC_PI_2;
    let robot = models["panda"].clone();
    let ready = robot.document.robot.as_ref().unwrap().configurations[0].q.clone();
    let object = |name: &str, X_WO, q: Vec<f64>| SceneObject { name: name.into(), model: models[name].clone(), X_WO, q, X_TO: None };
    let (large, small) = if task == "microwave" { ("microwave", "mug") } else { ("drawer", "tape") };
    let nominal = [layout.get("x", 0.8), layout.get("y", 0.0), layout.get("z", 0.0), half_turn + layout.get("yaw", 0.0).to_radians()];
    let X_WO = displaced(&mut random, nominal, shift, turn);
    let open = layout.get("open", if task == "microwave" { 1.6 } else { 0.2 });
    let X_WS = if task == "microwave" {
        displaced(&mut random, [layout.get("mx", 0.45), layout.get("my", -0.4), 0.0, layout.get("myaw", 0.0)], shift, turn)
    } else {
        // In the shut drawer, where its region allows.
        let region = &models[large].document.regions[0];
        let local = displaced(&mut random, [0.0, 0.0, 0.0, 0.0], layout.get("inside", 0.02), 3.0);
        let floor = Translation3::new(region.center[0], region.center[1], region.center[2] - 0.5 * region.size[2] + 0.001);
        X_WO * models[large].X_OL(&[0.0])[1] * floor * local
    };
    let mut scene = Scene {
        robot,
        X_WR: Isometry3::translation(0.0, 0.0, layout.get("base", 0.0)),
        table_height: 0.0,
        gravity: Vector3::new(0.0, 0.0, -9.81),
        objects: vec![object(large, X_WO, vec![0.0]), object(small, X_WS, vec![])],
    };
    let mut stages: Stages = Vec::new();
    let mut now = Instant::now();
    let mut push = |stages: &mut Stages, name, r: Result<String, PlanError>| {
        stages.push((name, r, now.elapsed().as_secs_f64()));
        now = Instant::now();
    };
    push(&mut stages, "open", handle(&scene, 0.0, open, &ready, layout, seed));
    scene.objects[0].q[0] = open;
    if task == "drawer" {
        scene.objects[1].X_WO = {
            let shut = models[large].X_OL(&[0.0])[1];
            let opened = models[large].X_OL(&[open])[1];
            X_WO * opened * shut.inverse() * X_WO.inverse() * X_WS
        };
    }
    let world = CollisionWorld::new(&scene).unwrap();
    let destination = if task == "microwave" {
        Destination::Region { object: 0, region: 0 }
    } else {
        Destination::Table { at: [layout.get("px", 0.4), layout.get("py", -0.4)] }
    };
    let options = TransferOptions { seed, ..TransferOptions::default() };
    if layout.get("transfer", 1.0) == 0.0 {
        // Only the door.
    } else {
        match plan_pick(&scene, &world, 1, &ready, Some(&destination), &options, &|| false) {
            Ok(plans) => {
                let plan = &plans[0];
                let lean = plan.freedom.to_degrees();
                push(&mut stages, "transfer", Ok(format!("{} lean {lean:.0} score {:.1}", plan.grasp.name, plan.score)));
                let r = reach(&world, &ready, &plan.approach[0], plan.grasp.width, seed);
                push(&mut stages, "transfer: reach", r);
                let place = plan.place.as_ref().unwrap();
                let mut holding = world.clone();
                holding.attach(1, &plan.X_TO);
                let r = reach(&holding, plan.lift.last().unwrap(), &place.insert[0], plan.grasp.hold_width, seed);
                push(&mut stages, "transfer: carry", r);
                scene.objects[1].X_WO = place.X_WO;
                let world = CollisionWorld::new(&scene).unwrap();
                push(&mut stages, "transfer: back", reach(&world, place.retreat.last().unwrap(), &ready, place.width, seed));
            }
            Err(e) => push(&mut stages, "transfer", Err(e)),
        }
    }
    push(&mut stages, "close", handle(&scene, open, 0.0, &ready, layout, seed));
    stages
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let task = arguments.next().unwrap_or_else(|| "microwave".into());
    let seeds: u64 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(20);
    let values = arguments.filter_map(|a| a.split_once('=').and_then(|(k, v)| Some((k.to_owned(), v.parse().ok()?)))).collect();
    let layout = Layout { values };
    let names: &[&str] = if task == "microwave" { &["panda", "microwave", "mug"] } else { &["panda", "drawer", "tape"] };
    let mut models: BTreeMap<&str, Arc<ObjectModel>> = names.iter().map(|n| (*n, model(n))).collect();
    // What if a rim could be held at a greater lean?
    if let Some(lean) = layout.values.get("tilt") {
        for m in models.values_mut() {
            for hint in &mut Arc::make_mut(m).document.grasps {
                if let sagci_model::GraspHint::Rim(rim) = hint {
                    rim.tilt = *lean;
                }
            }
        }
    }
    let verbose = layout.get("verbose", 0.0) > 0.0;
    let mut order: Vec<&'static str> = Vec::new();
    let mut done: BTreeMap<&'static str, Tally> = BTreeMap::new();
    let mut whole = 0;
    for seed in 1..=seeds {
        let stages = study(&task, &layout, seed, &models);
        let mut all = stages.len() == 6;
        for (name, result, seconds) in &stages {
            if !order.contains(name) {
                order.push(name);
            }
            let entry = done.entry(name).or_default();
            entry.1 += 1;
            entry.2 += seconds;
            match result {
                Ok(_) => entry.0 += 1,
                Err(e) => {
                    all = false;
                    *entry.3.entry(e.to_string()).or_default() += 1;
                }
            }
            if verbose {
                println!("seed {seed} {name}: {:.2} s {result:?}", seconds);
            }
        }
        whole += usize::from(all);
    }
    order.sort_by_key(|n| (n.starts_with("close"), n.starts_with("transfer"), n.len()));
    for name in order {
        let (ok, of, seconds, reasons) = &done[name];
        println!("{name:18} {ok:3} of {of:3}   {:.2} s each", seconds / *of as f64);
        for (reason, n) in reasons.iter().take(4) {
            println!("    {n} x {reason}");
        }
    }
    println!("whole task         {whole:3} of {seeds:3}");
}
