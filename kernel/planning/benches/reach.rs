//! Times optimal control: `cargo bench -p sagci-planning`, the reach of 7 joints over 100 knots that `tests/peers/side_by_side.py` also
//! gives to Crocoddyl. One iteration is the whole solve by the number of trajectories that were taken.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

#[path = "../../dynamics/benches/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::Bench;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use sagci_dynamics::{Coriolis, Part, System};
use sagci_planning::{Ddp, DdpOptions, ReachCost, ReachWeights};

const KNOTS: usize = 100;

fn main() {
    let bench = Bench::from_arguments();
    let mut model = common::model("panda_arm");
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
    let mut summary = None;
    let mut solve = || summary = Some(black_box(ddp.solve(&system, &mut cost, &x0, &controls, None).unwrap()));
    let least = bench.row("DDP, 7-dof reach, 100 knots, whole solve", 1, &mut solve);
    let summary = summary.unwrap();
    if least.is_finite() {
        let one = least / summary.iterations as f64;
        println!("{one:10.3} {one:10.3}  DDP, 7-dof reach, 100 knots, one iteration");
        println!("# cost {:.8}, {} iterations, {:?}", summary.cost, summary.iterations, summary.end);
    }
}
