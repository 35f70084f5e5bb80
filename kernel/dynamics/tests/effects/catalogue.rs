//! Names, bounds, choices, and the catalogue's page.

use sagci_dynamics::effects::{MAX_PARAMETERS, MAX_STATES, Prior, catalogue, find, page, parameters_of};
use sagci_dynamics::{DynamicsError, System};
use sagci_model::EffectEntry;

use crate::common::{WIDE, pendulum, slide, welded};
use crate::entry;

/// Names are fixed: models, scripts and reports use them.
const NAMES: &[(&str, &[&str])] = &[
    ("viscous_friction", &["damping"]),
    ("coulomb_friction", &["friction"]),
    ("asymmetric_friction", &["friction_positive", "friction_negative", "damping_positive", "damping_negative"]),
    ("stribeck_friction", &["friction", "static_friction", "stribeck_velocity", "exponent"]),
    ("quadratic_drag", &["drag"]),
    ("presliding_hysteresis", &["stiffness", "micro_damping", "friction", "static_friction", "stribeck_velocity"]),
    ("load_dependent_friction", &["load_coefficient"]),
    ("position_dependent_friction", &["friction", "amplitude", "position", "width"]),
    ("joint_spring", &["stiffness", "rest_position"]),
    ("hinge_tilt", &["amplitude", "phase"]),
    ("cable_hysteresis", &["stiffness", "rest_position", "loop_force", "loop_length", "damping"]),
    ("torque_bias", &["bias"]),
    ("magnetic_gasket", &["force", "width", "shape"]),
    ("air_suction", &["stiffness", "time_constant", "seal_position"]),
    ("latch", &["opening_force", "closing_force", "position", "width"]),
    ("detent", &["force", "position", "width"]),
    ("soft_close_damper", &["damping", "position", "stiffness"]),
    ("hard_stop", &["stiffness", "dissipation", "position", "side"]),
    ("backlash", &["half_gap", "rotor_inertia", "stiffness", "damping", "encoder"]),
    ("joint_elasticity", &["stiffness", "damping", "rotor_inertia", "encoder"]),
    ("torque_ripple", &["amplitude", "cycles_per_turn", "phase"]),
    ("transport_delay", &["delay"]),
    ("actuator_lag", &["time_constant"]),
    ("armature_inertia", &["inertia"]),
    ("torque_gain", &["gain_error"]),
    ("actuator_saturation", &["limit"]),
    ("payload", &["mass", "x", "y", "z"]),
    ("joint_axis_error", &["angle", "rx", "ry", "rz", "x", "y", "z"]),
    ("encoder_offset", &["offset", "scale_error"]),
    ("sensor_drift", &["bias", "rate", "of"]),
    ("clock_skew", &["skew"]),
    ("thermal_wear", &["amplitude", "time_constant"]),
    ("unmodelled_mode", &["frequency", "damping_ratio", "mass", "direction"]),
];

#[test]
fn the_catalogue_holds_the_fixed_names_and_is_its_folder() {
    let have: Vec<_> = catalogue().iter().map(|e| e.description().name).collect();
    let names: Vec<_> = NAMES.iter().map(|(n, _)| *n).collect();
    assert_eq!(have, names);
    for (name, parameters) in NAMES {
        let d = find(name).unwrap().description();
        assert_eq!(&d.parameters.iter().map(|p| p.name).collect::<Vec<_>>(), parameters, "{name}");
    }
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/effects");
    let mut files: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|f| f.unwrap().path())
        .filter(|f| f.is_file())
        .map(|f| f.file_stem().unwrap().to_str().unwrap().to_owned())
        .filter(|f| f != "mod" && f != "catalogue")
        .collect();
    files.sort();
    let mut sorted = names;
    sorted.sort_unstable();
    assert_eq!(files, sorted, "a file of the folder is no effect of the catalogue, or the other way round");
}

#[test]
fn every_effect_describes_itself_fully() {
    for effect in catalogue() {
        let d = effect.description();
        for text in [d.source, d.summary, d.signature, d.experiment] {
            assert!(!text.is_empty(), "{}", d.name);
        }
        assert!(!d.parameters.is_empty() && d.parameters.len() <= MAX_PARAMETERS && effect.states() <= MAX_STATES);
        assert!(!d.confused_with.is_empty() && !d.confused_with.contains(&d.name), "{}", d.name);
        for p in d.parameters {
            assert!(p.bounds[0] <= p.bounds[1] && p.bounds.iter().all(|b| b.is_finite()) && p.unit.iter().all(|u| !u.is_empty()));
            // A multiple is taken of what was read before.
            let before = d.parameters.iter().take_while(|other| other.name != p.name);
            assert!(p.multiple.is_none_or(|m| before.clone().any(|other| other.name == m.of)), "{}: {}", d.name, p.name);
            for prior in p.prior {
                let typical = match prior {
                    Prior::LogNormal { median, .. } => median,
                    Prior::Normal { mean, .. } => mean,
                    Prior::OneOf(choices) => choices[0],
                };
                assert!(typical >= p.bounds[0] && typical <= p.bounds[1], "{}: {}", d.name, p.name);
                if let (Prior::OneOf(values), false) = (prior, p.words.is_empty()) {
                    assert_eq!(values.len(), p.words.len());
                }
            }
        }
    }
}

#[test]
fn the_page_shows_every_effect_and_parameter_once() {
    let page = page();
    for (name, parameters) in NAMES {
        assert!(page.contains(&format!("| `{name}` |")), "{name}");
        for p in *parameters {
            assert!(page.lines().any(|l| l.starts_with(&format!("| `{name}` |")) && l.contains(&format!("| `{p}` |"))), "{name} {p}");
        }
    }
    for line in page.lines().filter(|l| l.starts_with('|')) {
        let bars = line.replace("\\|", "").matches('|').count();
        assert!(bars == 7 || bars == 8, "{line}");
    }
}

fn refusal(entry: &EffectEntry) -> String {
    let mut system = System::new(&[welded(&slide(1.0, WIDE))]).unwrap();
    system.add_effect("slide", entry).unwrap_err().to_string()
}

#[test]
fn misspelt_names_are_refused_with_the_nearest_one() {
    let spring = [("stiffness", 1.0), ("rest_position", 0.0)];
    let message = refusal(&entry("joint_sprig", Some("slide"), &spring));
    assert!(message.contains("did you mean 'joint_spring'"), "{message}");
    let message = refusal(&entry("joint_spring", Some("slide"), &[("stifness", 1.0), ("rest_position", 0.0)]));
    assert!(message.contains("did you mean 'stiffness'"), "{message}");
    let message = refusal(&entry("joint_spring", Some("slid"), &spring));
    assert!(message.contains("did you mean 'slide'"), "{message}");
}

#[test]
fn wrong_values_are_refused() {
    for (name, parameters, word) in [
        ("joint_spring", vec![("stiffness", 1.0)], "rest_position"),
        ("joint_spring", vec![("stiffness", -1.0), ("rest_position", 0.0)], "stiffness"),
        ("viscous_friction", vec![("damping", f64::NAN)], "damping"),
        ("hard_stop", vec![("stiffness", 1.0), ("dissipation", 0.0), ("position", 0.0), ("side", 0.5)], "side"),
        ("detent", vec![("force", 1.0), ("position", 0.0), ("width", 0.0)], "width"),
    ] {
        let message = refusal(&entry(name, Some("slide"), &parameters));
        assert!(message.contains(word), "{message}");
    }
    assert!(refusal(&entry("viscous_friction", None, &[("damping", 1.0)])).contains("joint"));
    let mode = [("frequency", 1.0), ("damping_ratio", 0.1), ("mass", 1.0)];
    assert!(refusal(&entry("unmodelled_mode", Some("slide"), &mode)).contains("joint"));
    // Setting parameters later is held to the same bounds, and changes nothing where it fails.
    let mut system = crate::block(1.0, &[("joint_spring", &[("stiffness", 1.0), ("rest_position", 0.5)])]);
    let message = system.set_effect_parameters(&[-1.0, 0.0]).unwrap_err().to_string();
    assert!(message.contains("joint_spring") && message.contains("stiffness"), "{message}");
    assert_eq!(system.parameters(), [1.0, 0.5]);
    system.set_effect_parameters(&[2.0, 0.1]).unwrap();
    assert_eq!(system.parameters(), [2.0, 0.1]);
}

#[test]
fn choices_are_words_with_a_default() {
    let mut gasket = entry("magnetic_gasket", Some("slide"), &[("force", 1.0), ("width", 0.01)]);
    assert_eq!(parameters_of(&gasket).unwrap().1, [1.0, 0.01, 0.0]);
    gasket.choices.insert("shape".into(), "inverse_square".into());
    assert_eq!(parameters_of(&gasket).unwrap().1, [1.0, 0.01, 1.0]);
    gasket.choices.insert("shape".into(), "inverse_squar".into());
    assert!(parameters_of(&gasket).unwrap_err().to_string().contains("did you mean 'inverse_square'"));
    gasket.choices = [("shap".to_owned(), "exponential".to_owned())].into();
    assert!(parameters_of(&gasket).unwrap_err().to_string().contains("did you mean 'shape'"));
}

#[test]
fn effects_of_the_model_act_and_urdf_losses_are_effects() {
    let mut model = pendulum(1.0, 0.3, 0.01, "<dynamics damping='0.4' friction='0.3'/>");
    model.document.effects.push(entry("joint_spring", Some("hinge"), &[("stiffness", 7.0), ("rest_position", 0.2)]));
    let system = System::new(&[welded(&model)]).unwrap();
    let names: Vec<_> = system.placements().iter().map(|p| p.effect.description().name).collect();
    assert_eq!(names, ["viscous_friction", "coulomb_friction", "joint_spring"]);
    assert_eq!(system.parameters(), [0.4, 0.3, 7.0, 0.2]);
    let mut state = system.state();
    (state.q[0], state.v[0]) = (0.5, 2.0);
    let mut tau = [0.0];
    let mut ws = system.workspace();
    system.inverse_dynamics(&mut ws, &state, &[3.0], &[], &mut tau).unwrap();
    // I a + m g l sin q + c v + f + k (q - q0)
    let expected = (0.01 + 0.09) * 3.0 + 9.81 * 0.3 * 0.5_f64.sin() + 0.4 * 2.0 + 0.3 + 7.0 * 0.3;
    assert!((tau[0] - expected).abs() < 1e-12, "{} {expected}", tau[0]);
}

#[test]
fn an_effect_on_a_missing_joint_of_a_model_names_the_model() {
    let mut model = slide(1.0, WIDE);
    model.document.effects.push(entry("torque_ripple_of_no_name", Some("slide"), &[]));
    assert!(matches!(System::new(&[welded(&model)]), Err(DynamicsError::Build { part, .. }) if part == "slide"));
}
