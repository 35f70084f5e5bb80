//! Nothing is allocated once the workspaces are made.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, unsafe_code, non_snake_case)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;

use common::{menagerie, panda, welded};
use nalgebra::{DMatrix, Matrix6xX, Point3};
use sagci_dynamics::effects::{Acts, Parameter, Prior, catalogue};
use sagci_dynamics::residual::{Activation, Residual};
use sagci_dynamics::rollout::{Inputs, Rollout, RolloutOptions};
use sagci_dynamics::{
    Adjoint, ContactMaterial, ContactOptions, ForwardDynamicsDerivatives, Input, InverseDynamicsDerivatives, Linearisation,
    MeasurementDerivatives, Part, RigidGradient, RigidParameter, System,
};
use sagci_model::EffectEntry;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
    static BYTES: Cell<usize> = const { Cell::new(0) };
    static MOST: Cell<usize> = const { Cell::new(0) };
}

/// Bytes that this thread holds now.
fn count_bytes(more: usize, less: usize) {
    let _ = BYTES.try_with(|b| {
        b.set((b.get() + more).saturating_sub(less));
        let _ = MOST.try_with(|m| m.set(m.get().max(b.get())));
    });
}

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|c| c.set(c.get() + 1));
        count_bytes(layout.size(), 0);
        unsafe { Heap.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count_bytes(0, layout.size());
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
        ..EffectEntry::default()
    });
    // Every effect of the catalogue, with middling parameters.
    for effect in catalogue() {
        let d = effect.description();
        let middling = |p: &Parameter| match p.prior[0] {
            Prior::LogNormal { median, .. } => median,
            Prior::Normal { mean, .. } => mean,
            Prior::OneOf(choices) => choices[0],
        };
        arm.document.effects.push(EffectEntry {
            effect: d.name.into(),
            joint: (d.acts != Acts::Base).then(|| "panda_joint4".into()),
            parameters: d.parameters.iter().filter(|p| p.words.is_empty()).map(|p| (p.name.into(), middling(p))).collect(),
            ..EffectEntry::default()
        });
    }
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
        let _ = system.measure(&state, 1.0, 3);
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

/// Two fingers that squeeze a block: a gripping scene small enough for ten thousand steps in a test.
fn grip() -> (System, sagci_dynamics::State, [f64; 8]) {
    let finger = |name: &str, y: f64, axis: [f64; 3]| {
        format!(
            "<link name='{name}'><inertial><mass value='0.1'/><inertia ixx='1e-4' ixy='0' ixz='0' iyy='1e-4' iyz='0' izz='1e-4'/></inertial>\
             <collision><geometry><box size='0.02 0.02 0.04'/></geometry></collision></link>"
        ) + &common::joint(&format!("slide_{name}"), "prismatic", "base", name, axis, [0.0, y, 0.5, 0.0, 0.0, 0.0], common::WIDE)
    };
    let hand = common::link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &finger("left", 0.035, [0.0, -1.0, 0.0])
        + &finger("right", -0.035, [0.0, 1.0, 0.0]);
    let block = "<link name='block'><inertial><mass value='0.2'/><inertia ixx='1e-4' ixy='0' ixz='0' iyy='1e-4' iyz='0' izz='1e-4'/></inertial>\
                 <collision><geometry><box size='0.05 0.05 0.05'/></geometry></collision></link>";
    let (hand, block) = (common::model("hand", &hand), common::model("block", block));
    let parts = [welded(&hand), Part::floating(&block)];
    let system = System::new(&parts).unwrap().with_contacts(&parts, ContactOptions::default()).unwrap();
    let mut state = system.state();
    state.q[8] = 0.5;
    (system, state, [10.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
}

#[test]
fn ten_thousand_gripping_steps_with_gradient_take_less_than_200_megabytes_and_allocate_nothing() {
    let (mut system, start, tau) = grip();
    let residual = Residual::new(system.multibody(), &["slide_left"], &["slide_left"], &[6], Activation::Tanh, 1).unwrap();
    system.set_residual(Some(&residual)).unwrap();
    let inputs = Inputs { tau: &tau, ..Inputs::default() };
    // The block hangs in the grip by friction.
    let fresh = BYTES.with(Cell::get);
    MOST.with(|m| m.set(fresh));
    let options = RolloutOptions::new(10_000, 1e-3);
    let mut rollout = Rollout::new(&system, options).unwrap();
    let mut run = || {
        rollout.forward(&system, &start, &inputs, |_, _| {}).unwrap();
        rollout.backward(&system, &inputs, |k, _, bar| bar.q[5] += f64::from(u8::from(k == 10_000))).unwrap();
    };
    run();
    let most = MOST.with(Cell::get) - fresh;
    println!("{} MB at most", most / 1_000_000);
    assert!(most < 200_000_000, "{most} bytes");
    let before = COUNT.with(Cell::get);
    run();
    assert_eq!(COUNT.with(Cell::get) - before, 0);
    assert!((rollout.last().q[8] - 0.5).abs() < 0.01, "it must hang in the grip: {:?}", rollout.last());
    assert!(rollout.gradient().natural.material.iter().flatten().all(|x| x.is_finite()));
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

#[test]
fn derivatives_by_parameters_allocate_nothing_even_after_these_have_changed() {
    let (mut system, start, tau) = grip();
    let which = system.all_parameters();
    let mut values = which.values(&system).unwrap();
    let mut x = Linearisation::with_parameters(&system, &which).unwrap();
    let mut reading = MeasurementDerivatives::new(&system, &which).unwrap();
    let (mut ws, mut state, mut next) = (system.workspace(), start.clone(), start);
    let input = Input { tau: &tau, external: &[] };
    for round in 0..3 {
        values[0] += 1e-3;
        system.set_parameters(&which, &values).unwrap();
        let before = COUNT.with(Cell::get);
        for _ in 0..100 {
            system.linearise(&mut ws, &state, &input, 1e-3, &mut next, &mut x).unwrap();
            system.measure_derivatives(&state, 0.3, 0, &mut reading).unwrap();
            std::mem::swap(&mut state, &mut next);
        }
        assert_eq!(COUNT.with(Cell::get) - before, 0, "round {round}");
        assert!(ws.contacts(&system).count() > 0);
    }
}
