//! Wrong input gives an error that says what and where, and never a number that is none.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{WIDE, joint, link, model, panda, slide, welded};
use nalgebra::Isometry3;
use sagci_dynamics::{Base, DynamicsError, ExternalWrench, Input, Multibody, Part, System};

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
