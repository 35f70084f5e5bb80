//! Times a call of each algorithm on the arm that ships: `cargo run --release -p sagci-dynamics --example speed`.
//! Compare only with figures from the same machine and run; `tests/peers` says how the peers are measured.
#![allow(non_snake_case)]

use std::hint::black_box;
use std::time::Instant;

use nalgebra::Isometry3;
use sagci_dynamics::{Coriolis, Input, Part, System};
use sagci_model::ObjectModel;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::path::Path::new("world-models/panda");
    let model = ObjectModel::read(folder.join(std::fs::read_to_string(folder.join("HEAD"))?.trim()))?;
    let mut system = System::new(&[Part::welded(&model, Isometry3::identity())])?;
    let multibody = system.multibody().clone();
    let (mut rigid, mut ws) = (multibody.workspace(), system.workspace());
    let n = multibody.nv();
    let mut start = system.state();
    for (i, (q, v)) in start.q.iter_mut().zip(start.v.iter_mut()).enumerate() {
        (*q, *v) = (0.02 + 0.1 * (i as f64).sin().abs(), 0.01 * (i as f64).cos());
    }
    (start.q[3], start.q[5]) = (-2.0, 1.5);
    let (tau, mut x) = (vec![0.5; n], vec![0.0; n]);

    time("state alone", || multibody.set_state(&mut rigid, &start.q, &start.v))?;
    time("state + recursive Newton-Euler", || {
        multibody.set_state(&mut rigid, &start.q, &start.v)?;
        multibody.inverse_dynamics(&mut rigid, &tau, &[], &mut x)
    })?;
    time("state + mass matrix + its Cholesky factor", || {
        multibody.set_state(&mut rigid, &start.q, &start.v)?;
        multibody.factor_mass_matrix(&mut rigid)
    })?;
    time("state + articulated-body forward dynamics", || {
        multibody.set_state(&mut rigid, &start.q, &start.v)?;
        multibody.forward_dynamics(&mut rigid, &tau, &[], &mut x)
    })?;
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        system.set_coriolis(coriolis);
        let mut state = start.clone();
        time(&format!("step with damping, dry friction and limits, Coriolis {coriolis:?}"), || {
            state.q.copy_from_slice(&start.q);
            state.v.copy_from_slice(&start.v);
            system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, 1e-3)
        })?;
    }
    Ok(())
}

fn time<E>(name: &str, mut call: impl FnMut() -> Result<(), E>) -> Result<(), E> {
    let mut fastest = f64::INFINITY;
    for _ in 0..50 {
        let start = Instant::now();
        for _ in 0..1000 {
            black_box(call()?);
        }
        fastest = fastest.min(start.elapsed().as_secs_f64() / 1000.0);
    }
    println!("{:6.2} us  {name}", fastest * 1e6);
    Ok(())
}
