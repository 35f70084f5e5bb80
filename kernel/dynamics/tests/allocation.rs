//! Nothing is allocated once the workspaces are made.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, unsafe_code, non_snake_case)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;

use common::{menagerie, panda, welded};
use nalgebra::{Matrix6xX, Point3};
use sagci_dynamics::effects::{Acts, Parameter, Prior, catalogue};
use sagci_dynamics::{Input, Part, System};
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
        multibody.set_positions(&mut rigid, &state.q).unwrap();
    }
    assert_eq!(COUNT.with(Cell::get) - before, 0);
}
