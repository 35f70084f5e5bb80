//! Wrong input gives an error that says what and where, and never a number that is none.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{WIDE, joint, link, model, panda, random, random_vector, slide, welded};
use nalgebra::{Isometry3, Matrix3, Unit, UnitQuaternion, Vector3};
use sagci_dynamics::rollout::{Rollout, RolloutOptions};
use sagci_dynamics::{
    Base, ContactOptions, DynamicsError, ExternalWrench, Input, Linearisation, MeasurementDerivatives, Multibody, Part, System,
};
use sagci_model::{EffectEntry, ObjectModel};

#[test]
fn numbers_that_are_none_are_refused_and_the_state_is_kept() {
    let system = System::new(&[welded(&panda())]).unwrap();
    let mut ws = system.workspace();
    let good = system.state();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut state = good.clone();
        state.q[3] = bad;
        assert!(matches!(
            system.step(&mut ws, &mut state, &Input::default(), 1e-3),
            Err(DynamicsError::NotFinite { what: "q", index: 3, .. })
        ));
        let mut state = good.clone();
        state.v[8] = bad;
        assert!(matches!(
            system.step(&mut ws, &mut state, &Input::default(), 1e-3),
            Err(DynamicsError::NotFinite { what: "v", index: 8, .. })
        ));
        let mut state = good.clone();
        let mut tau = [0.0; 9];
        tau[2] = bad;
        let input = Input { tau: &tau, external: &[] };
        assert!(matches!(system.step(&mut ws, &mut state, &input, 1e-3), Err(DynamicsError::NotFinite { what: "tau", index: 2, .. })));
        assert_eq!(state, good);
        let mut F_W = nalgebra::Vector6::zeros();
        F_W[4] = bad;
        let external = [ExternalWrench { link: system.multibody().link("panda_hand").unwrap(), F_W }];
        assert!(system.step(&mut ws, &mut state, &Input { tau: &[], external: &external }, 1e-3).is_err());
        assert!(system.step(&mut ws, &mut state, &Input::default(), bad).is_err());
        assert_eq!(state, good);
    }
    // The workspace is still good.
    let mut state = good.clone();
    system.step(&mut ws, &mut state, &Input::default(), 1e-3).unwrap();
}

#[test]
fn motion_that_blows_up_is_an_error() {
    let mut free = slide(1.0, WIDE);
    free.joints[0].limits = sagci_model::JointLimits::NONE;
    let system = System::new(&[welded(&free)]).unwrap();
    let mut state = system.state();
    state.v[0] = 1e300;
    let before = state.clone();
    let input = Input { tau: &[1e308], external: &[] };
    assert!(system.step(&mut system.workspace(), &mut state, &input, 1e10).is_err());
    assert_eq!(state, before);
}

#[test]
fn wrong_lengths_and_foreign_workspaces_are_refused() {
    let multibody = Multibody::new(&[welded(&panda())]).unwrap();
    let mut ws = multibody.workspace();
    assert!(matches!(multibody.set_state(&mut ws, &[0.0; 8], &[0.0; 9]), Err(DynamicsError::Length { what: "q", given: 8, needed: 9 })));
    let mut other = Multibody::new(&[welded(&slide(1.0, WIDE))]).unwrap().workspace();
    assert_eq!(multibody.set_state(&mut other, &[0.0; 9], &[0.0; 9]), Err(DynamicsError::ForeignWorkspace));
    assert!(multibody.gravity_efforts(&mut other, &mut [0.0; 9]).is_err());
    let system = System::new(&[welded(&panda())]).unwrap();
    let mut foreign = System::new(&[welded(&slide(1.0, WIDE))]).unwrap().workspace();
    assert!(system.step(&mut foreign, &mut system.state(), &Input::default(), 1e-3).is_err());
    assert!(system.inverse_dynamics(&mut foreign, &system.state(), &[0.0; 9], &[], &mut [0.0; 9]).is_err());
}

#[test]
fn a_quaternion_far_from_unit_length_is_refused() {
    let multibody = Multibody::new(&[Part::floating(&slide(1.0, WIDE))]).unwrap();
    let mut ws = multibody.workspace();
    let mut q = ws.q().to_vec();
    q[0] = 0.5;
    assert!(matches!(multibody.set_positions(&mut ws, &q), Err(DynamicsError::OutOfBounds { .. })));
}

#[test]
fn a_joint_that_moves_no_mass_is_refused_by_name() {
    let urdf = link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + "<link name='ghost'/>"
        + &joint("to_nothing", "revolute", "base", "ghost", [0.0, 0.0, 1.0], [0.0; 6], WIDE);
    let refused = Multibody::new(&[welded(&model("ghost", &urdf))]);
    assert!(matches!(refused, Err(DynamicsError::NoInertia { ref joint }) if joint == "to_nothing"), "{refused:?}");
}

#[test]
fn impossible_mimics_are_refused() {
    let arm = |mimic: usize| {
        let mut arm = panda();
        let second = arm.joint("panda_finger_joint2").unwrap();
        arm.joints[second].mimic = Some(sagci_model::Mimic { joint: mimic, multiplier: 1.0, offset: 0.0 });
        Multibody::new(&[welded(&arm)])
    };
    let (own, fixed) = (panda().joint("panda_finger_joint2").unwrap(), panda().joint("panda_hand_joint").unwrap());
    for bad in [own, fixed, 1000] {
        assert!(matches!(arm(bad), Err(DynamicsError::Build { .. })), "{bad}");
    }
}

#[test]
fn misspelt_links_and_joints_are_refused_with_the_nearest_one() {
    let multibody = Multibody::new(&[welded(&panda())]).unwrap();
    assert!(multibody.link("panda_hnd").unwrap_err().to_string().contains("did you mean 'panda_hand'"));
    assert!(multibody.velocity_index("panda_jont3").unwrap_err().to_string().contains("did you mean 'panda_joint3'"));
    // A fixed joint does not move.
    assert!(multibody.velocity_index("panda_hand_joint").is_err());
}

#[test]
fn limits_that_cross_are_refused() {
    let mut model = slide(1.0, WIDE);
    (model.joints[0].limits.lower, model.joints[0].limits.upper) = (0.5, -0.5);
    assert!(matches!(System::new(&[welded(&model)]), Err(DynamicsError::Build { place, .. }) if place == "slide"));
}

#[test]
fn a_base_that_another_part_holds_cannot_give_way() {
    let (arm, mut tool) = (panda(), slide(1.0, WIDE));
    tool.document.effects.push(sagci_model::EffectEntry {
        effect: "unmodelled_mode".into(),
        parameters: [("frequency", 6.0), ("damping_ratio", 0.1), ("mass", 12.0)].map(|(n, v)| (n.into(), v)).into(),
        ..sagci_model::EffectEntry::default()
    });
    let base = Base::Held { part: 0, link: "panda_hand".into(), X_LO: Isometry3::identity() };
    let held = System::new(&[welded(&arm), Part { base, name: "tool".into(), model: &tool }]);
    assert!(held.unwrap_err().to_string().contains("held by another part"));
    assert!(System::new(&[welded(&tool)]).is_ok());
}

#[test]
fn inertia_that_no_body_has_is_refused_with_its_link() {
    let diagonal = |a: f64, b: f64, c: f64| Matrix3::from_diagonal(&Vector3::new(a, b, c));
    let good = slide(1.0, WIDE);
    for (mass, inertia) in [
        (-1.0, diagonal(0.1, 0.1, 0.1)),
        (f64::NAN, diagonal(0.1, 0.1, 0.1)),
        (f64::INFINITY, diagonal(0.1, 0.1, 0.1)),
        (1.0, diagonal(0.1, -0.1, 0.1)),
        (1.0, diagonal(0.1, 0.1, 0.5)),
        (1.0, diagonal(0.1, f64::NAN, 0.1)),
    ] {
        let mut bad = good.clone();
        (bad.links[1].inertial.mass, bad.links[1].inertial.I_LLcm_L) = (mass, inertia);
        let refused = Multibody::new(&[welded(&bad)]);
        assert!(matches!(refused, Err(DynamicsError::Build { ref place, .. }) if place == "block"), "{mass} {inertia}: {refused:?}");
    }
    // A point and a thin rod are bodies.
    for inertia in [diagonal(0.0, 0.0, 0.0), diagonal(0.1, 0.1, 0.0)] {
        let mut thin = good.clone();
        thin.links[1].inertial.I_LLcm_L = inertia;
        assert!(Multibody::new(&[welded(&thin)]).is_ok());
    }
    // Set later, a mass that is none shows in the step.
    let mut system = System::new(&[welded(&panda())]).unwrap();
    system.multibody_mut().armature_mut()[2] = f64::NAN;
    let mut state = system.state();
    let before = state.clone();
    assert!(system.step(&mut system.workspace(), &mut state, &Input::default(), 1e-3).is_err());
    assert_eq!(state, before);
    let mut system = System::new(&[welded(&good)]).unwrap();
    system.multibody_mut().armature_mut()[0] = f64::NAN;
    assert!(system.step(&mut system.workspace(), &mut system.state(), &Input::default(), 1e-3).is_err());
}

#[test]
fn an_axis_without_direction_is_refused_with_its_joint() {
    for axis in [Vector3::zeros(), Vector3::new(f64::NAN, 0.0, 1.0), Vector3::new(0.0, 0.0, 2.0)] {
        let mut bad = slide(1.0, WIDE);
        bad.joints[0].axis = Unit::new_unchecked(axis);
        let refused = Multibody::new(&[welded(&bad)]);
        assert!(matches!(refused, Err(DynamicsError::Build { ref place, .. }) if place == "slide"), "{axis}: {refused:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("object.urdf");
    let links = link("a", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0]) + &link("b", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
    let hinge = joint("hinge", "revolute", "a", "b", [0.0; 3], [0.0; 6], WIDE);
    std::fs::write(&path, format!("<robot name='x'>{links}{hinge}</robot>")).unwrap();
    let error = ObjectModel::read_urdf(&path).unwrap_err().to_string();
    assert!(error.contains("hinge") && error.contains("axis"), "{error}");
}

#[test]
fn numbers_that_are_none_in_inner_states_and_times_out_of_range_are_refused_everywhere() {
    let mut arm = panda();
    arm.document.effects.push(EffectEntry {
        effect: "actuator_lag".into(),
        joint: Some("panda_joint2".into()),
        parameters: [("time_constant".into(), 0.01)].into(),
        ..EffectEntry::default()
    });
    let system = System::new(&[welded(&arm)]).unwrap();
    let which = system.all_parameters();
    let (mut ws, mut next) = (system.workspace(), system.state());
    let mut x = Linearisation::with_parameters(&system, &which).unwrap();
    let mut reading = MeasurementDerivatives::new(&system, &which).unwrap();
    let good = system.state();
    let mut bad = good.clone();
    bad.z[0] = f64::NAN;
    assert!(matches!(
        system.step(&mut ws, &mut bad.clone(), &Input::default(), 1e-3),
        Err(DynamicsError::NotFinite { what: "z", index: 0, .. })
    ));
    assert!(system.linearise(&mut ws, &bad, &Input::default(), 1e-3, &mut next, &mut x).is_err());
    assert!(system.measure_derivatives(&bad, 0.0, 0, &mut reading).is_err());
    for dt in [0.0, -1e-3, f64::NAN, f64::INFINITY] {
        let refused = system.step(&mut ws, &mut good.clone(), &Input::default(), dt);
        assert!(matches!(refused, Err(DynamicsError::OutOfBounds { .. })), "{dt}: {refused:?}");
        assert!(system.linearise(&mut ws, &good, &Input::default(), dt, &mut next, &mut x).is_err());
        assert!(Rollout::new(&system, RolloutOptions::new(3, dt)).is_err());
    }
    // A step of an hour is finite, or an error.
    let mut state = good.clone();
    if system.step(&mut ws, &mut state, &Input::default(), 3600.0).is_ok() {
        assert!(state.q.iter().chain(&state.v).chain(&state.z).all(|x| x.is_finite()));
    }
    // Derivatives for another system's parameters are refused.
    let other = System::new(&[welded(&slide(1.0, WIDE))]).unwrap();
    assert!(Linearisation::with_parameters(&other, &which).is_err());
    let mut foreign = Linearisation::new(&other);
    assert!(system.linearise(&mut ws, &good, &Input::default(), 1e-3, &mut next, &mut foreign).is_err());
}

#[test]
fn shapes_fully_inside_one_another_are_parted_and_never_give_a_number_that_is_none() {
    let shapes = [
        "<box size='0.4 0.4 0.4'/>",
        "<sphere radius='0.02'/>",
        "<capsule radius='0.02' length='0.04'/>",
        "<cylinder radius='0.03' length='0.02'/>",
    ];
    let body = |name: &str, shape: &str| {
        let inertial = "<inertial><mass value='1'/><inertia ixx='.01' ixy='0' ixz='0' iyy='.01' iyz='0' izz='.01'/></inertial>";
        model(name, &format!("<link name='{name}'>{inertial}<collision><geometry>{shape}</geometry></collision></link>"))
    };
    let mut rng = random(8);
    for (i, outer) in shapes.iter().enumerate() {
        for inner in &shapes[i..] {
            let models = [body("outer", outer), body("inner", inner)];
            let parts = [Part::floating(&models[0]), Part::floating(&models[1])];
            let mut system = System::new(&parts).unwrap().with_contacts(&parts, ContactOptions::default()).unwrap();
            system.multibody_mut().set_gravity(Vector3::zeros());
            for trial in 0..6 {
                let (mut ws, mut state) = (system.workspace(), system.state());
                // One centre first, then near it.
                let size = if trial == 0 { 0.0 } else { 5e-3 };
                let offset = random_vector(6, 1.0, &mut rng);
                let R = UnitQuaternion::from_scaled_axis(Vector3::new(offset[3], offset[4], offset[5]) * size * 100.0);
                state.q[7..11].copy_from_slice(&[R.w, R.i, R.j, R.k]);
                state.q[11..14].copy_from_slice(&[size * offset[0], size * offset[1], size * offset[2]]);
                let mut x = Linearisation::with_parameters(&system, &system.all_parameters()).unwrap();
                let mut next = state.clone();
                for _ in 0..40 {
                    if system.linearise(&mut ws, &state, &Input::default(), 1e-3, &mut next, &mut x).is_err() {
                        break;
                    }
                    // Twelve guesses, and eight searches of forty rounds.
                    assert!(ws.rounds() <= 400, "{}", ws.rounds());
                    assert!(next.q.iter().chain(&next.v).all(|x| x.is_finite()), "{outer} in {inner}");
                    assert!(x.A.iter().chain(&x.B).chain(&x.P).all(|x| x.is_finite()), "{outer} in {inner}");
                    state.clone_from(&next);
                }
                assert!(state.v.iter().any(|v| *v != 0.0), "{outer} in {inner}, {trial}: nothing parts them");
            }
        }
    }
}
