//! The typed parameter vector: names, round trips, bounds.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{largest, menagerie, model, panda, pendulum, random, random_vector, welded};
use sagci_dynamics::residual::{Activation, Residual};
use sagci_dynamics::{DynamicsError, ParameterKind, Part, System};

#[test]
fn what_is_set_is_read_back() {
    let (arm, zoo) = (panda(), menagerie(true));
    let mut system = System::new(&[welded(&arm), Part::floating(&zoo)]).unwrap();
    let residual = Residual::new(system.multibody(), &["je"], &["je"], &[4], Activation::Tanh, 1).unwrap();
    system.set_residual(Some(&residual)).unwrap();
    let all = system.all_parameters();
    let before = all.values(&system).unwrap();
    let shown: Vec<_> = all.names().zip(&before).filter(|(n, _)| n.contains(".axis.") || n.contains(".turn.")).collect();
    assert!(shown.iter().all(|(_, v)| v.abs() < 1e-12), "corrections start at zero: {shown:?}");
    let mut rng = random(1);
    let moved: Vec<f64> = before
        .iter()
        .zip(random_vector(all.len(), 0.2, &mut rng))
        .zip(all.bounds().zip(all.units()))
        // Bodies of a few millimetres are sheared by no more than their size.
        .map(|((x, d), ([a, b], unit))| (x + if unit == "m" { 0.02 * d } else { d }).clamp(a, b))
        .collect();
    system.set_parameters(&all, &moved).unwrap();
    for ((name, have), want) in all.names().zip(all.values(&system).unwrap()).zip(&moved) {
        assert!((have - want).abs() < 1e-9, "{name}: {have} where {want} was set");
    }
    for (link, part, name) in system.multibody().links() {
        let inertia = system.multibody().link_inertia(link);
        // A URDF's own inertia may be that of no body; then it has no entries, and stays what it is.
        if all.names().any(|n| n == format!("{part}/{name}.inertia.d1")) {
            let principal = inertia.about_center().symmetric_eigenvalues();
            let most = principal.max();
            assert!(principal.min() > -1e-12 && 2.0 * most <= principal.sum() * (1.0 + 1e-9), "{name}: {principal:?}");
        }
    }
    system.set_parameters(&all, &before).unwrap();
    assert!(largest(&all.values(&system).unwrap(), &before) < 1e-9);
}

#[test]
fn names_and_patterns_pick_entries() {
    let system = System::new(&[welded(&panda())]).unwrap();
    let names = |patterns: &[&str]| -> Vec<String> { system.select_parameters(patterns).unwrap().names().map(Into::into).collect() };
    let part = &system.multibody().parts()[0];
    assert_eq!(names(&["*/panda_joint3.axis.*"]), [format!("{part}/panda_joint3.axis.0"), format!("{part}/panda_joint3.axis.1")]);
    let two = names(&["*link2.center.z", "*link2.center.*"]);
    assert_eq!(two.len(), 3, "each entry once: {two:?}");
    assert!(two[0].ends_with("center.z"), "in the order of the patterns: {two:?}");
    let Err(DynamicsError::Unknown { kind, name, hint }) = system.select_parameters(&["*/panda_joint3.damp"]) else { panic!() };
    assert_eq!((kind.as_str(), name.as_str()), ("parameter", "*/panda_joint3.damp"));
    assert!(!hint.is_empty());
    // The arm's nine moving links: ten numbers each, and those fixed to them.
    let inertial = system.parameters_of_kind(ParameterKind::LinkMass).len();
    assert!(inertial >= 9, "{inertial}");
    assert_eq!(system.parameters_of_kind(ParameterKind::LinkCenter).len(), 3 * inertial);
}

#[test]
fn values_out_of_bounds_are_refused_and_nothing_changes() {
    let mut system = System::new(&[welded(&panda())]).unwrap();
    let which = system.select_parameters(&["*link4.mass", "*joint4.armature"]).unwrap();
    let before = which.values(&system).unwrap();
    for bad in [[f64::NAN, 0.0], [1e3, 0.0], [0.0, -1.0]] {
        let error = system.set_parameters(&which, &bad).unwrap_err();
        assert!(!error.to_string().is_empty());
        assert_eq!(which.values(&system).unwrap(), before);
    }
    assert!(system.set_parameters(&which, &[0.0]).is_err());
    let mut other = System::new(&[welded(&pendulum(1.0, 0.4, 0.02, ""))]).unwrap();
    assert!(matches!(other.set_parameters(&which, &before), Err(DynamicsError::Unknown { .. })));
}

#[test]
fn mass_of_a_point_has_no_inertia_to_vary() {
    // All mass in a plane: a thin plate has no positive definite pseudo-inertia.
    let urdf = common::link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &common::link("plate", 1.0, [0.0; 3], [0.02, 0.0, 0.0, 0.03, 0.0, 0.05])
        + &common::joint("j", "revolute", "base", "plate", [0.0, 1.0, 0.0], [0.0; 6], common::WIDE);
    let mut system = System::new(&[welded(&model("plate", &urdf))]).unwrap();
    assert!(system.select_parameters(&["plate/plate.inertia.*"]).is_err());
    let which = system.select_parameters(&["plate/plate.mass"]).unwrap();
    system.set_parameters(&which, &[0.5 * 2.0_f64.ln()]).unwrap();
    let inertia = system.multibody().link_inertia(system.multibody().link("plate/plate").unwrap());
    assert!((inertia.mass - 2.0).abs() < 1e-12 && (inertia.I[(2, 2)] - 0.1).abs() < 1e-12, "the shape is kept: {inertia:?}");
}
