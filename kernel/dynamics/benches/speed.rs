//! Times a call of each algorithm on the arm of the comparison with peers: `cargo bench -p sagci-dynamics --bench speed`. Every call
//! has another state. See `common` for the options.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

mod common;

use std::hint::black_box;

use common::Bench;
use nalgebra::{DMatrix, Isometry3};
use rand::{RngExt, SeedableRng};
use sagci_dynamics::{
    Adjoint, Coriolis, ForwardDynamicsDerivatives, Input, InverseDynamicsDerivatives, Linearisation, Multibody, Part, State, System,
};

const STATES: usize = 256;
const DT: f64 = 1e-3;

struct Sample {
    state: State,
    tau: Vec<f64>,
}

fn main() {
    let (bench, mut model) = (Bench::from_arguments(), common::model("panda"));
    // The states of the rows are away from limits, but not all within them.
    for joint in &mut model.joints {
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    let mut system = System::new(&[Part::welded(&model, Isometry3::identity())]).unwrap();
    let multibody = system.multibody().clone();
    let samples = samples(&system);
    let (n, mut rigid) = (multibody.nv(), multibody.workspace());
    let mut x = vec![0.0; n];
    let run = |name: &str, call: &mut dyn FnMut(&Sample)| {
        bench.row(name, STATES, || samples.iter().for_each(|sample| call(black_box(sample))));
    };
    let set = |rigid: &mut _, s: &Sample, multibody: &Multibody| multibody.set_state(rigid, &s.state.q, &s.state.v).unwrap();
    run("state", &mut |s| set(&mut rigid, s, &multibody));
    run("inverse dynamics", &mut |s| {
        set(&mut rigid, s, &multibody);
        multibody.inverse_dynamics(&mut rigid, &s.tau, &[], &mut x).unwrap();
    });
    run("mass matrix and its factor", &mut |s| {
        set(&mut rigid, s, &multibody);
        multibody.factor_mass_matrix(&mut rigid).unwrap();
    });
    run("forward dynamics", &mut |s| {
        set(&mut rigid, s, &multibody);
        multibody.forward_dynamics(&mut rigid, &s.tau, &[], &mut x).unwrap();
    });
    let mut forward = ForwardDynamicsDerivatives::new(&multibody);
    run("its derivatives by q, v, tau", &mut |s| {
        set(&mut rigid, s, &multibody);
        multibody.forward_dynamics_derivatives(&mut rigid, &s.tau, &[], &mut x, &mut forward).unwrap();
    });
    let mut inverse = InverseDynamicsDerivatives::new(&multibody);
    run("inverse dynamics' derivatives by q, v", &mut |s| {
        set(&mut rigid, s, &multibody);
        multibody.inverse_dynamics_derivatives(&mut rigid, &s.tau, &[], &mut inverse).unwrap();
    });
    let links: Vec<_> = multibody.links().map(|(l, ..)| l).collect();
    let columns = links.iter().filter_map(|l| multibody.regressor_columns(*l)).map(|r| r.end).max().unwrap_or(0);
    let mut Y = DMatrix::zeros(n, columns);
    run("torque regressor", &mut |s| {
        set(&mut rigid, s, &multibody);
        multibody.torque_regressor(&mut rigid, &s.tau, &mut Y).unwrap();
    });
    let mut adjoint = Adjoint::new(&multibody);
    for (name, parameters) in [("reverse sweep by q, v, a", false), ("reverse sweep by q, v, a and every parameter", true)] {
        run(name, &mut |s| {
            set(&mut rigid, s, &multibody);
            multibody.inverse_dynamics_adjoint(&mut rigid, &s.state.v, &s.tau, &[], parameters, &mut adjoint).unwrap();
        });
    }
    for (scheme, half) in [(Coriolis::AtStart, ""), (Coriolis::AtMidpoint, ", Coriolis half way")] {
        system.set_coriolis(scheme);
        let (mut ws, mut state) = (system.workspace(), system.state());
        run(&format!("free step{half}"), &mut |s| {
            state.q.copy_from_slice(&s.state.q);
            state.v.copy_from_slice(&s.state.v);
            system.step(&mut ws, &mut state, &Input { tau: &s.tau, external: &[] }, DT).unwrap();
        });
        let mut x = Linearisation::new(&system);
        run(&format!("free step + A, B{half}"), &mut |s| {
            system.linearise(&mut ws, &s.state, &Input { tau: &s.tau, external: &[] }, DT, &mut state, &mut x).unwrap();
        });
    }
}

fn samples(system: &System) -> Vec<Sample> {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let multibody = system.multibody();
    (0..STATES)
        .map(|_| {
            let mut state = system.state();
            let step: Vec<f64> = (0..multibody.nv()).map(|_| rng.random_range(-1.0..1.0)).collect();
            multibody.integrate(&mut state.q, &step, 1.0).unwrap();
            state.v.iter_mut().for_each(|v| *v = rng.random_range(-1.0..1.0));
            Sample { state, tau: (0..multibody.nv()).map(|_| rng.random_range(-5.0..5.0)).collect() }
        })
        .collect()
}
