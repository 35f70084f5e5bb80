//! Nothing is allocated once the workspaces are made.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, unsafe_code, non_snake_case)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;

use common::{menagerie, panda, welded};
use nalgebra::{DMatrix, Matrix6xX, Point3};
use sagci_dynamics::{
    Adjoint, ContactMaterial, ContactOptions, ForwardDynamicsDerivatives, Input, InverseDynamicsDerivatives, Linearisation, Part,
    RigidGradient, RigidParameter, System,
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

#[test]
fn steps_with_contact_allocate_nothing() {
    let shape = |name: &str, geometry: &str| {
        let inside = format!(
            "<link name='{name}'><inertial><mass value='1'/><inertia ixx='.01' ixy='0' ixz='0' iyy='.01' iyz='0' izz='.01'/></inertial>\
             <collision><geometry>{geometry}</geometry></collision></link>"
        );
        common::model(name, &inside)
    };
    let models = [
        shape("box", "<box size='.2 .2 .2'/>"),
        shape("ball", "<sphere radius='.1'/>"),
        shape("capsule", "<capsule radius='.05' length='.2'/>"),
        shape("cylinder", "<cylinder radius='.1' length='.2'/>"),
    ];
    let parts: Vec<Part<'_>> = models.iter().map(Part::floating).collect();
    let mut system = System::new(&parts).unwrap().with_contacts(&parts, ContactOptions::default()).unwrap();
    system.add_ground("ground", nalgebra::Vector3::zeros(), nalgebra::Vector3::z_axis(), ContactMaterial::default()).unwrap();
    let (mut ws, mut state) = (system.workspace(), system.state());
    for k in 0..4 {
        state.q[7 * k + 4] = 0.03 * k as f64;
        state.q[7 * k + 6] = 0.1 + 0.25 * k as f64;
    }
    let before = COUNT.with(Cell::get);
    let mut touching = 0;
    for _ in 0..2000 {
        system.step(&mut ws, &mut state, &Input::default(), 1e-3).unwrap();
        touching += ws.contacts(&system).count();
    }
    assert_eq!(COUNT.with(Cell::get) - before, 0);
    assert!(touching > 4000, "{touching}");
}
