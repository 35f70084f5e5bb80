//! Times a call of each algorithm: `cargo bench -p sagci-dynamics [-- URDF]`, on the arm that ships unless a URDF is given.
//! Every call has another state. Times are the thread's time on the processor (wall time where the system does not tell), the
//! median and the least over repetitions. Compare only with figures from the same machine and run.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, non_snake_case)]

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use nalgebra::{DMatrix, Isometry3};
use rand::{RngExt, SeedableRng};
use sagci_dynamics::{
    Adjoint, Coriolis, ForwardDynamicsDerivatives, Input, InverseDynamicsDerivatives, Linearisation, Multibody, Part, State, System,
};
use sagci_model::ObjectModel;

const STATES: usize = 256;
const DT: f64 = 1e-3;

struct Sample {
    state: State,
    tau: Vec<f64>,
}

fn main() {
    let mut given = std::env::args().skip(1).filter(|a| !a.starts_with("--"));
    let mut model = match given.next() {
        Some(urdf) => ObjectModel::read_urdf(urdf).unwrap(),
        None => {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
            let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
            ObjectModel::read(folder.join(head.trim())).unwrap()
        }
    };
    let only = given.next().unwrap_or_default();
    // The peers' rows have no dry friction, and are away from limits.
    for joint in &mut model.joints {
        joint.friction = 0.0;
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    let mut system = System::new(&[Part::welded(&model, Isometry3::identity())]).unwrap();
    let multibody = system.multibody().clone();
    let samples = samples(&system);
    let (n, mut rigid, mut ws) = (multibody.nv(), multibody.workspace(), system.workspace());
    println!("{} on {n} degrees of freedom: microseconds a call, median and least", model.name);
    let mut x = vec![0.0; n];
    let run = |name: &str, call: &mut dyn FnMut(&Sample)| {
        if name.contains(&only) {
            time(name, &samples, call);
        }
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
    run("forward dynamics' derivatives by q, v, tau", &mut |s| {
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
    for (scheme, name) in [(Coriolis::AtStart, ""), (Coriolis::AtMidpoint, ", Coriolis half way")] {
        system.set_coriolis(scheme);
        let (mut state, mut linearisation) = (system.state(), Linearisation::new(&system));
        run(&format!("free step{name}"), &mut |s| {
            state.q.copy_from_slice(&s.state.q);
            state.v.copy_from_slice(&s.state.v);
            system.step(&mut ws, &mut state, &Input { tau: &s.tau, external: &[] }, DT).unwrap();
        });
        run(&format!("free step + A, B{name}"), &mut |s| {
            let input = Input { tau: &s.tau, external: &[] };
            system.linearise(&mut ws, &s.state, &input, DT, &mut state, &mut linearisation).unwrap();
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

fn time(name: &str, samples: &[Sample], call: &mut dyn FnMut(&Sample)) {
    let (rounds, epoch) = (100, Instant::now());
    let mut times: Vec<f64> = (0..21)
        .map(|_| {
            let start = clock(epoch);
            for _ in 0..rounds {
                for sample in samples {
                    call(black_box(sample));
                }
            }
            (clock(epoch) - start) / (rounds * samples.len()) as f64 * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{:8.3} {:8.3}  {name}", times[times.len() / 2], times[0]);
}

/// Seconds that this thread has run, as the scheduler counts them: another process on the machine does not add to them.
fn clock(epoch: Instant) -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let ran = told.and_then(|t| t.split_whitespace().next()?.parse::<f64>().ok());
    ran.map_or_else(|| epoch.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}
