//! Times a step of small mechanisms with effects on their joints, and its derivatives by state and chosen parameters: what Gauss-Newton
//! over long recordings is made of. `cargo bench -p sagci-dynamics --bench identification`. See `common` for the options.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

mod common;

use std::hint::black_box;

use common::Bench;
use nalgebra::Isometry3;
use sagci_dynamics::effects::{Prior, find};
use sagci_dynamics::{Coriolis, Input, Linearisation, ParameterVector, Part, State, System};
use sagci_model::EffectEntry;

const STEPS: usize = 256;
const DT: f64 = 1e-3;

/// Of each kind one: linear, dry, with an inner state, by position, on the command.
const EFFECTS: [&str; 9] = [
    "viscous_friction",
    "stribeck_friction",
    "presliding_hysteresis",
    "cable_hysteresis",
    "air_suction",
    "magnetic_gasket",
    "torque_ripple",
    "actuator_lag",
    "transport_delay",
];

fn main() {
    let bench = Bench::from_arguments();
    let mut door = common::model("microwave");
    (door.joints[0].damping, door.joints[0].friction) = (0.1, 0.05);
    let mut system = System::new(&[Part::welded(&door, Isometry3::identity())]).unwrap();
    let spring = EffectEntry {
        effect: "joint_spring".into(),
        joint: Some("mw_hinge".into()),
        parameters: [("stiffness".into(), 0.3), ("rest_position".into(), 0.2)].into(),
        ..EffectEntry::default()
    };
    system.add_effect("microwave", &spring).unwrap();
    let which = system.select_parameters(&["*friction.*", "*.joint_spring.*", "*/mw_door.mass", "*/mw_door.center.y"]).unwrap();
    rows(&bench, "one joint, viscous, dry friction, spring", &system, &which, 0.02);
    for name in EFFECTS {
        effect_row(&bench, name);
    }
    let mut arm = common::model("panda_arm");
    for joint in &mut arm.joints {
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
        (joint.damping, joint.friction) = (0.5, 0.3);
    }
    let system = System::new(&[Part::welded(&arm, Isometry3::identity())]).unwrap();
    let which = system.select_parameters(&["*friction.*", "*.mass", "*.center.*"]).unwrap();
    rows(&bench, "arm, viscous, dry friction", &system, &which, 1.0);
}

fn rows(bench: &Bench, name: &str, system: &System, which: &ParameterVector, speed: f64) {
    let mut system = system.clone();
    system.set_coriolis(Coriolis::AtStart);
    let n = system.multibody().nv();
    let (mut ws, mut start) = (system.workspace(), system.state());
    start.v.fill(speed);
    start.q.iter_mut().enumerate().for_each(|(k, q)| *q = 0.3 + 0.1 * k as f64);
    let tau: Vec<f64> = vec![0.2; n];
    let input = Input { tau: &tau, external: &[] };
    let mut state = start.clone();
    bench.row(&format!("{name}: step"), STEPS, || {
        copy(&mut state, &start);
        for _ in 0..STEPS {
            system.step(&mut ws, black_box(&mut state), &input, DT).unwrap();
        }
    });
    for which in [&ParameterVector::default(), which] {
        let (mut next, mut x) = (start.clone(), Linearisation::with_parameters(&system, which).unwrap());
        let what = if which.is_empty() { String::new() } else { format!(" + {} parameters", which.len()) };
        bench.row(&format!("{name}: step + A, B{what}"), STEPS, || {
            copy(&mut state, &start);
            for _ in 0..STEPS {
                system.linearise(&mut ws, black_box(&state), &input, DT, &mut next, &mut x).unwrap();
                std::mem::swap(&mut state, &mut next);
            }
        });
    }
}

/// Steps of a door with one effect at its usual size, pushed to and fro.
fn effect_row(bench: &Bench, name: &str) {
    let mut door = common::model("microwave");
    (door.joints[0].damping, door.joints[0].friction) = (0.0, 0.0);
    let mut system = System::new(&[Part::welded(&door, Isometry3::identity())]).unwrap();
    let usual = |prior: Prior| match prior {
        Prior::LogNormal { median, .. } => median,
        Prior::Normal { mean, deviation } => mean + 0.1 * deviation,
        Prior::OneOf(choices) => choices[0],
    };
    let parameters = find(name).unwrap().description().parameters;
    let entry = EffectEntry {
        effect: name.into(),
        joint: Some("mw_hinge".into()),
        parameters: parameters.iter().filter(|p| p.words.is_empty()).map(|p| (p.name.into(), usual(p.prior[0]))).collect(),
        ..EffectEntry::default()
    };
    system.add_effect("microwave", &entry).unwrap();
    let (mut ws, mut start) = (system.workspace(), system.state());
    (start.q[0], start.v[0]) = (0.3, 0.02);
    let mut state = start.clone();
    bench.row(&format!("one joint, {name}: step"), STEPS, || {
        copy(&mut state, &start);
        for k in 0..STEPS {
            let tau = [2.5 * (0.1 * k as f64).cos()];
            system.step(&mut ws, black_box(&mut state), &Input { tau: &tau, external: &[] }, DT).unwrap();
        }
    });
}

fn copy(to: &mut State, from: &State) {
    to.q.copy_from_slice(&from.q);
    to.v.copy_from_slice(&from.v);
    to.z.copy_from_slice(&from.z);
    to.time = from.time;
}
