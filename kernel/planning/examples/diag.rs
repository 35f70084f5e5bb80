#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]
use sagci_planning::*;
use sagci_model::ObjectModel;
use nalgebra::*;
use std::time::Instant;
use std::sync::Arc;
use std::path::Path;
fn model(name: &str) -> Arc<ObjectModel> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models").join(name);
    let version = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    Arc::new(ObjectModel::read(folder.join(version.trim())).unwrap())
}
fn main() {
    let robot = model("panda");
    let arm = ArmKinematics::new(&robot, &Isometry3::identity()).unwrap();
    use rand::{RngExt, SeedableRng};
    let mut r = rand_pcg::Pcg64::seed_from_u64(1);
    let qs: Vec<Vec<f64>> = (0..200).map(|_| (0..7).map(|i| arm.lower()[i] + (arm.upper()[i]-arm.lower()[i]) * r.random::<f64>()).collect()).collect();
    let t = Instant::now(); let mut s = 0.0;
    for _ in 0..50 { for q in &qs { s += arm.X_WT(q).translation.x; } }
    println!("FK {:.3} us {s}", t.elapsed().as_secs_f64()*1e6/1e4);
    let mut found = 0; let t = Instant::now(); let mut n = 0;
    for q in &qs { let o = InverseOptions { starts: 30, solutions: 100, distinct: 0.05, ..InverseOptions::default() }; let x = arm.inverse(&arm.X_WT(q), &[], &o); n += x.len(); if !x.is_empty() { found += 1; } }
    println!("IK found {found}, {:.1} solutions of 30 starts, {:.1} us a start", n as f64/200.0, t.elapsed().as_secs_f64()*1e6/200.0/30.0);
    let micro = model("microwave");
    let X_WO = Isometry3::from_parts(Translation3::new(0.85,0.0,0.0), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -std::f64::consts::FRAC_PI_2));
    let scene = Scene { robot: robot.clone(), X_WR: Isometry3::identity(), table_height: 0.0, gravity: Vector3::new(0.,0.,-9.81), objects: vec![SceneObject { name: "microwave".into(), model: micro, X_WO, q: vec![0.0], X_TO: None }] };
    let t = Instant::now();
    let world = CollisionWorld::new(&scene).unwrap();
    println!("world {:.2} ms", t.elapsed().as_secs_f64()*1e3);
    let t = Instant::now(); let mut count = std::collections::BTreeMap::new(); let mut free = 0;
    for q in &qs { match world.check(q, 0.04) { None => free += 1, Some(c) => *count.entry(c).or_insert(0) += 1 } }
    println!("check {:.1} us, free {free}", t.elapsed().as_secs_f64()*1e6/200.0);
    for (c, n) in count { println!("{n} {c:?}"); }
    for c in &robot.document.robot.as_ref().unwrap().configurations { println!("{} {:?} {:.3}", c.name, world.check(&c.q, 0.04), world.clearance(&c.q, 0.04, 0.2)); }
    let t = Instant::now(); let mut nf = 0; let mut qq = Vec::new();
    for q in &qs { if world.free(q, 0.04) { qq.push(q.clone()); } }
    let t2 = Instant::now();
    for _ in 0..20 { for q in &qq { if world.free(q, 0.04) { nf += 1; } } }
    println!("free checks {:.1} us {nf} {:?}", t2.elapsed().as_secs_f64()*1e6/20.0/qq.len() as f64, t.elapsed());
}
