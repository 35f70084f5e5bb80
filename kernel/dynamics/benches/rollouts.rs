//! Times rollouts with their gradient: `cargo bench -p sagci-dynamics --bench rollouts`. The gradient is by the first state, the
//! efforts of every step, and every parameter: damping, dry friction, inertias, axes, origins, and surfaces where bodies touch. See
//! `common` for the options.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

mod common;

use std::hint::black_box;

use common::{Bench, Scene};
use nalgebra::Isometry3;
use sagci_dynamics::rollout::{Inputs, Rollout, RolloutOptions};
use sagci_dynamics::{ContactMaterial, ContactOptions, Coriolis, Part, State, StateCotangent, System, Wanted};

fn main() {
    let (bench, scene) = (Bench::from_arguments(), Scene::read());
    let mut arm = common::model("panda");
    // The row asks for the gradient by dry friction of every joint.
    for joint in &mut arm.joints {
        joint.friction = 0.01;
    }
    for (coriolis, half) in [(Coriolis::AtStart, ""), (Coriolis::AtMidpoint, ", Coriolis half way")] {
        let mut system = System::new(&[Part::welded(&arm, Isometry3::identity())]).unwrap();
        system.set_coriolis(coriolis);
        let mut x0 = system.state();
        x0.q.copy_from_slice(&scene.numbers(&["free", "q"]));
        x0.v.copy_from_slice(&scene.numbers(&["free", "v"]));
        rows(&bench, &format!("1,000 free steps{half}"), &system, &x0, &scene.numbers(&["free", "tau"]), 1000);
    }
    let (arm, oven) = (common::model("panda"), common::model("microwave"));
    let at = scene.numbers(&["microwave_xyz"]);
    let parts = [Part::welded(&arm, Isometry3::identity()), Part::welded(&oven, Isometry3::translation(at[0], at[1], at[2]))];
    let material = ContactMaterial { friction: 1.0, ..ContactMaterial::default() };
    let options = ContactOptions { material, ..ContactOptions::default() };
    let mut system = System::new(&parts).unwrap().with_contacts(&parts, options).unwrap();
    system.set_coriolis(Coriolis::AtStart);
    let mut x0 = system.state();
    x0.q[..9].copy_from_slice(&scene.numbers(&["contact", "q"]));
    let mut tau = scene.numbers(&["contact", "tau"]);
    tau.push(0.0);
    rows(&bench, "300 gripping steps", &system, &x0, &tau, 300);
}

fn rows(bench: &Bench, name: &str, system: &System, x0: &State, tau: &[f64], steps: usize) {
    let last = |k: usize, s: &State, bar: &mut StateCotangent| {
        if k == steps {
            bar.q.iter_mut().zip(&s.q).for_each(|(b, q)| *b += q);
        }
    };
    let inputs = Inputs { tau, ..Inputs::default() };
    for (what, wanted) in [(" + gradient", Wanted::ALL), (" + gradient by state, efforts and effects", Wanted::LEAST)] {
        let mut rollout = Rollout::new(system, RolloutOptions { wanted, ..RolloutOptions::new(steps, 1e-3) }).unwrap();
        if wanted == Wanted::ALL {
            bench.row(name, 1, || {
                rollout.forward(system, black_box(x0), &inputs, |_, _| {}).unwrap();
            });
        }
        bench.row(&format!("{name}{what}"), 1, || {
            rollout.forward(system, black_box(x0), &inputs, |_, _| {}).unwrap();
            rollout.backward(system, &inputs, last).unwrap();
            black_box(rollout.gradient());
        });
    }
}
