//! Times optimal control: `cargo bench -p sagci-planning [-- --once]`, the reach of 7 joints over 100 knots that
//! `tests/peers/side_by_side.py` also gives to Crocoddyl. Times are the thread's on the processor, the least over repetitions. `--once`
//! solves once, for counting instructions.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use sagci_dynamics::{Coriolis, Part, System};
use sagci_model::ObjectModel;
use sagci_planning::{Ddp, DdpOptions, ReachCost, ReachWeights};

const KNOTS: usize = 100;

fn main() {
    let once = std::env::args().any(|a| a == "--once");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/models/panda_arm.urdf");
    let mut model = ObjectModel::read_urdf(path).unwrap();
    // As the peer has it: no friction, no limits of joints.
    for joint in &mut model.joints {
        joint.damping = 0.0;
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    let mut system = System::new(&[Part::welded(&model, Isometry3::identity())]).unwrap();
    system.set_coriolis(Coriolis::AtStart);
    let mut x0 = system.state();
    x0.q.copy_from_slice(&[0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.8]);
    let (mut rigid, mut tau) = (system.multibody().workspace(), vec![0.0; 7]);
    system.multibody().set_positions(&mut rigid, &x0.q).unwrap();
    system.multibody().gravity_efforts(&mut rigid, &mut tau).unwrap();
    let controls = tau.repeat(KNOTS);
    let R = Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0));
    let X_WG = Isometry3::from_parts(Translation3::new(0.62, 0.0, 0.6), UnitQuaternion::from_rotation_matrix(&R));
    let running = ReachWeights { pose: 1.0, state: 1e-2, effort: 1e-4 };
    let terminal = ReachWeights { pose: 1e3, state: 1e-1, effort: 0.0 };
    let mut cost = ReachCost::new(&system, "panda_hand", &X_WG, &x0, running, terminal).unwrap();
    let mut ddp = Ddp::new(&system, DdpOptions::new(KNOTS, 0.01)).unwrap();
    let (mut least, epoch) = (f64::INFINITY, Instant::now());
    let mut summary = None;
    for _ in 0..if once { 1 } else { 60 } {
        let start = clock(epoch);
        summary = Some(black_box(ddp.solve(&system, &mut cost, &x0, &controls, None).unwrap()));
        least = least.min((clock(epoch) - start) * 1e6);
    }
    let summary = summary.unwrap();
    println!("{:9.1} us  DDP, 7-dof reach, 100 knots, one iteration", least / summary.iterations as f64);
    println!("{least:9.1} us  DDP, 7-dof reach, 100 knots, whole solve");
    println!("# cost {:.8}, {} iterations, {:?}", summary.cost, summary.iterations, summary.end);
}

/// Seconds that this thread has run, as the scheduler counts them: another process on the machine does not add to them.
fn clock(epoch: Instant) -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let ran = told.and_then(|t| t.split_whitespace().next()?.parse::<f64>().ok());
    ran.map_or_else(|| epoch.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}
