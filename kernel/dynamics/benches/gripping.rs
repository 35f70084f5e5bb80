//! Times a step of the arm that grips a microwave's handle, with eight contacts: `cargo bench -p sagci-dynamics
//! --bench gripping -- <folder with panda.urdf, microwave.urdf, scene.json>`. Compare only with figures from the same machine and run.
#![allow(non_snake_case)]

use std::hint::black_box;
use std::time::Instant;

use nalgebra::Isometry3;
use sagci_dynamics::{ContactMaterial, ContactOptions, Coriolis, Input, Linearisation, Part, System};
use sagci_model::ObjectModel;

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().map(|a| a.iter().filter_map(serde_json::Value::as_f64).collect()).unwrap_or_default()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let Some(folder) = std::env::args().skip(1).find(|a| !a.starts_with("--")).map(std::path::PathBuf::from) else {
        println!("name the folder of the scene to time the gripping step");
        return Ok(());
    };
    let scene: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(folder.join("scene.json"))?)?;
    let (arm, microwave) = (ObjectModel::read_urdf(folder.join("panda.urdf"))?, ObjectModel::read_urdf(folder.join("microwave.urdf"))?);
    let at = numbers(&scene["microwave_xyz"]);
    let parts = [Part::welded(&arm, Isometry3::identity()), Part::welded(&microwave, Isometry3::translation(at[0], at[1], at[2]))];
    let material = ContactMaterial { friction: 1.0, ..ContactMaterial::default() };
    let mut system = System::new(&parts)?.with_contacts(&parts, ContactOptions { material, ..ContactOptions::default() })?;
    system.set_coriolis(Coriolis::AtStart);
    let (mut ws, mut start) = (system.workspace(), system.state());
    start.q[..9].copy_from_slice(&numbers(&scene["contact"]["q"]));
    let mut tau = numbers(&scene["contact"]["tau"]);
    tau.push(0.0);
    let mut state = start.clone();
    let mut most = 0;
    for step in 1..=300 {
        system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, 1e-3)?;
        most = most.max(ws.rounds());
        if [1, 10, 50, 100, 300].contains(&step) {
            let handle = state.q[9] * 0.44;
            println!(
                "after {step} steps: handle moved {:.3} mm, {} contacts, {} rounds",
                handle * 1e3,
                ws.contacts(&system).count(),
                ws.rounds()
            );
        }
        if step == 100 {
            start = state.clone();
        }
    }
    println!("most rounds {most}");
    let (mut fastest, mut rounds) = (f64::INFINITY, 0);
    for _ in 0..60 {
        state.q.copy_from_slice(&start.q);
        state.v.copy_from_slice(&start.v);
        let clock = Instant::now();
        for _ in 0..100 {
            black_box(system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, 1e-3)?);
        }
        fastest = fastest.min(clock.elapsed().as_secs_f64() / 100.0);
    }
    state.clone_from(&start);
    for _ in 0..100 {
        system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, 1e-3)?;
        rounds += ws.rounds();
    }
    println!("{} rounds a step", rounds as f64 / 100.0);
    let (mut next, mut x, mut least) = (start.clone(), Linearisation::new(&system), f64::INFINITY);
    for _ in 0..40 {
        state.clone_from(&start);
        let clock = Instant::now();
        for _ in 0..100 {
            system.linearise(&mut ws, &state, &Input { tau: &tau, external: &[] }, 1e-3, &mut next, &mut x)?;
            std::mem::swap(&mut state, &mut next);
        }
        least = least.min(clock.elapsed().as_secs_f64() / 100.0);
    }
    println!("{:6.2} us  gripping step + A, B", least * 1e6);
    println!("{:6.2} us  gripping step", fastest * 1e6);
    Ok(())
}
