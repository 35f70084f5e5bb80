//! Nothing is allocated once the workspaces are made.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, unsafe_code, non_snake_case)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;

use common::{menagerie, panda, welded};
use nalgebra::{DMatrix, Matrix6xX, Point3};
use sagci_dynamics::{
    Adjoint, ForwardDynamicsDerivatives, Input, InverseDynamicsDerivatives, Linearisation, Part, RigidGradient, RigidParameter, System,
};
use sagci_model::EffectEntry;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|c| c.set(c.get() + 1));
        unsafe { Heap.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { Heap.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn stepping_and_every_algorithm_allocate_nothing() {
    let (mut arm, zoo) = (panda(), menagerie(true));
    arm.document.effects.push(EffectEntry {
        effect: "hard_stop".into(),
        joint: Some("panda_joint2".into()),
        parameters: [("stiffness", 1e4), ("dissipation", 1e3), ("position", 0.5), ("side", 1.0)].map(|(n, v)| (n.into(), v)).into(),
    });
    let system = System::new(&[welded(&arm), Part::floating(&zoo)]).unwrap();
    let multibody = system.multibody();
    let (mut ws, mut rigid, mut state) = (system.workspace(), multibody.workspace(), system.state());
    let n = multibody.nv();
    let (tau, mut x, mut J) = (vec![0.1; n], vec![0.0; n], Matrix6xX::zeros(n));
    let hand = multibody.link("panda_hand").unwrap();
    let (mut inverse, mut forward) = (InverseDynamicsDerivatives::new(multibody), ForwardDynamicsDerivatives::new(multibody));
    let (mut adjoint, mut gradient) = (Adjoint::new(multibody), RigidGradient::new(multibody));
    let (mut linearisation, mut next) = (Linearisation::new(&system), system.state());
    let joint = multibody.model_joint("panda_joint3").unwrap();
    let parameters = [RigidParameter::Inertia(hand, 1), RigidParameter::Origin(joint, 2), RigidParameter::Axis(joint, 0)];
    let mut columns = DMatrix::zeros(n, parameters.len());
    let blocks = multibody.links().filter_map(|(l, ..)| multibody.regressor_columns(l)).map(|r| r.end).max().unwrap();
    let mut Y = DMatrix::zeros(n, blocks);
    let mut changed = multibody.clone();
    let before = COUNT.with(Cell::get);
    for _ in 0..300 {
        system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, 1e-3).unwrap();
        system.inverse_dynamics(&mut ws, &state, &tau, &[], &mut x).unwrap();
        multibody.set_state(&mut rigid, &state.q, &state.v).unwrap();
        multibody.forward_dynamics(&mut rigid, &tau, &[], &mut x).unwrap();
        multibody.bias_efforts(&mut rigid, &mut x).unwrap();
        multibody.gravity_efforts(&mut rigid, &mut x).unwrap();
        multibody.factor_mass_matrix(&mut rigid).unwrap();
        multibody.solve_mass_matrix(&rigid, &mut x).unwrap();
        multibody.jacobian(&rigid, hand, &Point3::origin(), &mut J).unwrap();
        let _ = (multibody.X_WL(&rigid, hand), multibody.momentum(&rigid), multibody.kinetic_energy(&rigid));
        multibody.inverse_dynamics_derivatives(&mut rigid, &tau, &[], &mut inverse).unwrap();
        multibody.forward_dynamics_derivatives(&mut rigid, &tau, &[], &mut x, &mut forward).unwrap();
        multibody.inverse_dynamics_adjoint(&mut rigid, &tau, &x, &[], true, &mut adjoint).unwrap();
        multibody.rigid_gradient(&adjoint, &mut gradient).unwrap();
        multibody.inverse_dynamics_by_parameters(&mut rigid, &tau, &[], &parameters, &mut columns).unwrap();
        multibody.torque_regressor(&mut rigid, &tau, &mut Y).unwrap();
        system.linearise(&mut ws, &state, &Input { tau: &tau, external: &[] }, 1e-3, &mut next, &mut linearisation).unwrap();
        let inertia = *changed.link_inertia(hand);
        changed.set_link_inertia(hand, &inertia);
        let (X_PJ, axis) = (*changed.joint_origin(joint), *changed.joint_axis(joint));
        changed.set_joint_origin(joint, &X_PJ);
        changed.set_joint_axis(joint, &axis);
        multibody.set_positions(&mut rigid, &state.q).unwrap();
    }
    assert_eq!(COUNT.with(Cell::get) - before, 0);
}
