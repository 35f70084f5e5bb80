//! Times a step of the arm that grips a microwave's handle, with eight contacts, and its derivatives: `cargo bench -p sagci-dynamics
//! --bench gripping`. The steps are those from the 100th on, when the grip has settled. See `common` for the options.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

mod common;

use std::hint::black_box;

use common::{Bench, Scene};
use nalgebra::Isometry3;
use sagci_dynamics::rollout::{Inputs, Rollout, RolloutOptions};
use sagci_dynamics::{ContactMaterial, ContactOptions, Coriolis, Input, Linearisation, Part, System, Wanted};

const STEPS: usize = 100;
const DT: f64 = 1e-3;

fn main() {
    let (bench, scene) = (Bench::from_arguments(), Scene::read());
    let (arm, oven) = (common::model("panda"), common::model("microwave"));
    let at = scene.numbers(&["microwave_xyz"]);
    let parts = [Part::welded(&arm, Isometry3::identity()), Part::welded(&oven, Isometry3::translation(at[0], at[1], at[2]))];
    let material = ContactMaterial { friction: 1.0, ..ContactMaterial::default() };
    let options = ContactOptions { material, ..ContactOptions::default() };
    let mut system = System::new(&parts).unwrap().with_contacts(&parts, options).unwrap();
    system.set_coriolis(Coriolis::AtStart);
    let (mut ws, mut start) = (system.workspace(), system.state());
    start.q[..9].copy_from_slice(&scene.numbers(&["contact", "q"]));
    let mut tau = scene.numbers(&["contact", "tau"]);
    tau.push(0.0);
    let input = Input { tau: &tau, external: &[] };
    for _ in 0..STEPS {
        system.step(&mut ws, &mut start, &input, DT).unwrap();
    }
    let mut state = start.clone();
    bench.row("gripping step, 8 contacts", STEPS, || {
        state.clone_from(&start);
        for _ in 0..STEPS {
            system.step(&mut ws, black_box(&mut state), &input, DT).unwrap();
        }
    });
    let (mut next, mut x) = (start.clone(), Linearisation::new(&system));
    bench.row("gripping step + A, B", STEPS, || {
        state.clone_from(&start);
        for _ in 0..STEPS {
            system.linearise(&mut ws, black_box(&state), &input, DT, &mut next, &mut x).unwrap();
            std::mem::swap(&mut state, &mut next);
        }
    });
    // Each of the 300 parameters that there are as a column.
    let all = system.all_parameters();
    let mut dense = Linearisation::with_parameters(&system, &all).unwrap();
    bench.row("the same + every parameter", STEPS, || {
        state.clone_from(&start);
        for _ in 0..STEPS {
            system.linearise(&mut ws, black_box(&state), &input, DT, &mut next, &mut dense).unwrap();
            std::mem::swap(&mut state, &mut next);
        }
    });
    // One cotangent taken back through each step, to every parameter there is, beside A and B.
    let inputs = Inputs { tau: &tau, ..Inputs::default() };
    let options = RolloutOptions { wanted: Wanted::ALL, ..RolloutOptions::new(STEPS, DT) };
    let mut rollout = Rollout::new(&system, options).unwrap();
    rollout.forward(&system, &start, &inputs, |_, _| {}).unwrap();
    bench.row("gripping step + A, B + one cotangent taken back to every parameter", STEPS, || {
        state.clone_from(&start);
        for _ in 0..STEPS {
            system.linearise(&mut ws, black_box(&state), &input, DT, &mut next, &mut x).unwrap();
            std::mem::swap(&mut state, &mut next);
        }
        rollout
            .backward(&system, &inputs, |k, _, bar| {
                if k == STEPS {
                    bar.v.fill(1.0)
                }
            })
            .unwrap();
        black_box(rollout.gradient());
    });
}
