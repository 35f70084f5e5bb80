//! A step of a control law allocates nothing and takes a few microseconds.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;
use std::path::PathBuf;
use std::time::Instant;

use nalgebra::Isometry3;
use sagci_control::{ArmModel, CartesianImpedance, CartesianReference, Damping, JointImpedance, JointReference};
use sagci_model::ObjectModel;
use sagci_signal::{Command, Observation};

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
fn steps_allocate_nothing_and_are_fast() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
    let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    let model = ObjectModel::read(folder.join(head.trim())).unwrap();
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let q = vec![0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785];
    let observation = Observation { q: q.clone(), v: vec![0.1; 7], gripper_width: 0.04, ..Observation::default() };
    arm.observe(&observation).unwrap();
    let reference = CartesianReference::at(*arm.X_WT());
    let stiffness = CartesianImpedance::diagonal(40.0, [800.0, 300.0, 300.0]);
    let mut joint = JointImpedance::new(&arm, &[100.0; 7], &[10.0; 7]).unwrap();
    let mut command = Command { tau: vec![0.0; 7], ..Command::default() };
    let goal = JointReference { q: &q, v: &[0.0; 7], a: &[0.0; 7] };
    for (name, damping) in
        [("given damping", Damping::Matrix(CartesianImpedance::diagonal(5.0, [70.0; 3]))), ("designed damping", Damping::Ratio(0.7))]
    {
        let mut law = CartesianImpedance::new(&arm, stiffness, damping).unwrap();
        let before = COUNT.with(Cell::get);
        let mut fastest = f64::INFINITY;
        for _ in 0..20 {
            let start = Instant::now();
            for _ in 0..100 {
                law.step(&mut arm, &observation, &reference, 1e-3, &mut command).unwrap();
            }
            fastest = fastest.min(start.elapsed().as_secs_f64() / 100.0);
        }
        assert_eq!(COUNT.with(Cell::get) - before, 0, "{name}");
        println!("Cartesian impedance, {name}: {:.1} us", fastest * 1e6);
        // Far above what is measured, so that a busy machine does not fail it.
        assert!(fastest < 100e-6, "{name}: {fastest}");
    }
    let before = COUNT.with(Cell::get);
    let start = Instant::now();
    for _ in 0..1000 {
        joint.step(&mut arm, &observation, &goal, 1e-3, &mut command).unwrap();
    }
    println!("joint impedance: {:.1} us", start.elapsed().as_secs_f64() * 1e3);
    assert_eq!(COUNT.with(Cell::get) - before, 0);
}
