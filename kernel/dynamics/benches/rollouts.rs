//! Times rollouts with their gradient: `cargo bench -p sagci-dynamics --bench rollouts [-- FOLDER]`. FOLDER holds the peers' scene
//! (`panda.urdf`, `microwave.urdf`, `scene.json`); without one the arm that ships is taken, and no gripping row. `--once` runs each row
//! once, for counting instructions. Compare only with
//! figures from the same machine and run.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use nalgebra::Isometry3;
use sagci_dynamics::rollout::{Inputs, Rollout, RolloutOptions};
use sagci_dynamics::{ContactMaterial, ContactOptions, Coriolis, Part, State, System, Wanted};
use sagci_model::ObjectModel;

fn main() {
    let folder = std::env::args().skip(1).find(|a| !a.starts_with("--")).map(PathBuf::from);
    let mut arm = match &folder {
        Some(folder) => ObjectModel::read_urdf(folder.join("panda.urdf")).unwrap(),
        None => {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
            let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
            ObjectModel::read(folder.join(head.trim())).unwrap()
        }
    };
    // The row asks for gradients by damping and dry friction of every joint.
    for joint in &mut arm.joints {
        joint.damping = joint.damping.max(0.5);
        joint.friction = joint.friction.max(0.01);
    }
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        let mut system = System::new(&[Part::welded(&arm, Isometry3::identity())]).unwrap();
        system.set_coriolis(coriolis);
        let mut x0 = system.state();
        x0.q.copy_from_slice(&[0.1, -0.785, 0.1, -2.356, 0.1, 1.571, 0.785, 0.02, 0.02]);
        x0.v.fill(0.1);
        let mut rigid = system.multibody().workspace();
        system.multibody().set_positions(&mut rigid, &x0.q).unwrap();
        let mut tau = vec![0.0; 9];
        system.multibody().gravity_efforts(&mut rigid, &mut tau).unwrap();
        row(&format!("1,000 free steps, Coriolis {coriolis:?}"), &system, &x0, &tau, 1000);
    }
    let Some(folder) = folder else { return };
    let scene: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(folder.join("scene.json")).unwrap()).unwrap();
    let numbers = |value: &serde_json::Value| -> Vec<f64> { value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect() };
    let (arm, oven) =
        (ObjectModel::read_urdf(folder.join("panda.urdf")).unwrap(), ObjectModel::read_urdf(folder.join("microwave.urdf")).unwrap());
    let at = numbers(&scene["microwave_xyz"]);
    let parts = [Part::welded(&arm, Isometry3::identity()), Part::welded(&oven, Isometry3::translation(at[0], at[1], at[2]))];
    let material = ContactMaterial { friction: 1.0, ..ContactMaterial::default() };
    let mut system = System::new(&parts).unwrap().with_contacts(&parts, ContactOptions { material, ..ContactOptions::default() }).unwrap();
    system.set_coriolis(Coriolis::AtStart);
    let mut x0 = system.state();
    x0.q[..9].copy_from_slice(&numbers(&scene["contact"]["q"]));
    let mut tau = numbers(&scene["contact"]["tau"]);
    tau.push(0.0);
    row("300 gripping steps, Coriolis AtStart", &system, &x0, &tau, 300);
}

fn row(name: &str, system: &System, x0: &State, tau: &[f64], steps: usize) {
    let last = |k: usize, s: &State, bar: &mut sagci_dynamics::StateCotangent| {
        if k == steps {
            bar.q.iter_mut().zip(&s.q).for_each(|(b, q)| *b += q);
        }
    };
    let inputs = Inputs { tau, ..Inputs::default() };
    for (what, wanted) in [("state, inputs and effects", Wanted::LEAST), ("everything", Wanted::ALL)] {
        let mut rollout = Rollout::new(system, RolloutOptions { wanted, ..RolloutOptions::new(steps, 1e-3) }).unwrap();
        let (mut forward, mut both) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..if std::env::args().any(|a| a == "--once") { 1 } else { 40 } {
            let clock = Instant::now();
            rollout.forward(system, x0, &inputs, |_, _| {}).unwrap();
            forward = forward.min(clock.elapsed().as_secs_f64());
            rollout.backward(system, &inputs, last).unwrap();
            both = both.min(clock.elapsed().as_secs_f64());
            black_box(rollout.gradient());
        }
        println!("{:9.1} us forward, {:9.1} us with the gradient by {what}: {name}", forward * 1e6, both * 1e6);
    }
}
