//! Recordings of real hardware (tests/measured): what is known of it by those who built or studied it has to be found.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::path::{Path, PathBuf};

use sagci_gap::report::Report;
use sagci_gap::{Options, find};
use sagci_model::ObjectModel;
use sagci_recording::{Angles, Log, read_with};

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured").join(name)
}

/// The recordings whose names begin so, in the order of their names.
fn logs(name: &str, model: &ObjectModel, prefixes: &[&str]) -> Vec<Log> {
    if prefixes.is_empty() {
        return Vec::new();
    }
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder(name)).unwrap().map(|e| e.unwrap().path()).collect();
    let chosen = |p: &PathBuf| {
        let file = p.file_name().unwrap().to_string_lossy().into_owned();
        file.ends_with(".csv") && prefixes.iter().any(|prefix| file.starts_with(prefix))
    };
    paths.retain(chosen);
    paths.sort();
    read_with(&paths, Some(model), &sagci_recording::Options { angles: Angles::Radians, ..Default::default() }).unwrap()
}

fn answer(name: &str, train: &[&str], held_out: &[&str]) -> Report {
    answer_of(&ObjectModel::read(folder(name)).unwrap(), name, train, held_out)
}

/// What is found by recordings that another model than theirs is to explain.
fn answer_of(model: &ObjectModel, name: &str, train: &[&str], held_out: &[&str]) -> Report {
    find(model, &logs(name, model, train), &logs(name, model, held_out), &Options::default()).unwrap().report
}

fn names(report: &Report) -> Vec<&str> {
    report.effects.iter().map(|e| e.name.as_str()).collect()
}

/// The servo's gears rub the more, the more they carry (Duclusaud et al. 2025, the same recordings).
#[test]
fn friction_that_grows_with_the_load_of_a_servo_has_its_name_and_predicts_a_gain_that_no_fit_has_seen() {
    let found = answer("xl330_servo", &["kp100", "kp200"], &["kp800"]);
    assert!(names(&found).contains(&"load_dependent_friction"), "{:?}", names(&found));
    assert!(!names(&found).contains(&"stribeck_friction"), "{:?}", names(&found));
    // Viscous and dry friction are among what the free refit may choose.
    let (after, plain) = (found.gap.held_out.as_ref().unwrap().after, found.baselines["free_refit"]);
    assert!(after < plain / 1.5, "{after} with what was named, {plain} with plain friction");
    let sparse = found.baselines["sparse_regression"];
    assert!(after < sparse, "{after} with what was named, {sparse} by sparse regression");
}

/// A kitchen cabinet's door is held near where it is shut (Jain and Kemp 2013): by up to 2.8 N m at its hinge, which it takes to open it.
#[test]
fn what_pulls_a_real_cabinet_shut_is_named_with_its_place() {
    let found = answer("pr2_cabinet", &["pull"], &[]);
    // How hard it pulls, and where it ends, from shut on. By place no sensor has told magnets from a spring that snaps shut.
    let of = |name: &str| found.effects.first().and_then(|e| e.parameters.get(name)).map_or(f64::NAN, |v| v.value);
    let [pull, end] = match names(&found)[..] {
        ["magnetic_gasket", ..] => [of("force"), of("width")],
        ["soft_close_damper", ..] => [of("stiffness") * of("position"), of("position")],
        ["detent", ..] => [of("force"), of("position") + of("width")],
        _ => panic!("{:?}", names(&found)),
    };
    assert!((1.0..10.0).contains(&pull) && (0.05..0.6).contains(&end), "{pull} N m to {end} rad of {:?}", names(&found));
    assert!(found.gap.train.after < 0.2 * found.gap.train.refitted, "{} of {}", found.gap.train.after, found.gap.train.refitted);
}

/// A light pendulum on ball bearings: dry friction, and a loss that grows with speed. Alone, viscous friction comes near both. Fitted to whole swings
/// beside dry friction by other means it is negative, and drag is not.
#[test]
fn what_slows_a_real_pendulum_is_named_and_predicts_a_swing_of_another_size() {
    let swings = ["swing_1", "swing_2", "swing_3", "swing_4"];
    for (held_out, train) in [("swing_4", &swings[..3]), ("swing_1", &swings[1..])] {
        let found = answer("uw_pendulum", train, &[held_out]);
        assert_eq!(names(&found), ["coulomb_friction", "quadratic_drag"], "{held_out}");
        let gap = found.gap.held_out.as_ref().unwrap();
        assert!(gap.after < 0.1 * gap.refitted && gap.after < gap.noise_floor, "{held_out}: {gap:?}");
    }
}

/// A pendulum's published identification leaves two thirds of its weight out, for the friction and the offset that it was fitted with take their part
/// of the torque. Two recordings under other controllers each say so, and each predicts the other.
#[test]
fn a_weight_that_published_numbers_lack_is_named_alike_by_two_recordings() {
    let runs = ["system_identification", "direct_collocation"];
    let published = ObjectModel::read(folder("dfki_pendulum/as_published")).unwrap();
    for (train, held_out) in [(runs[0], runs[1]), (runs[1], runs[0])] {
        let found = answer_of(&published, "dfki_pendulum", &[train], &[held_out]);
        assert_eq!(names(&found), ["payload"], "{train}");
        let of = |name: &str| found.effects[0].parameters[name].value;
        let moment = -of("mass") * of("z");
        assert!((0.28..0.34).contains(&moment) && found.effects[0].confirmed, "{train}: {moment} kg m");
        let gap = found.gap.held_out.as_ref().unwrap();
        assert!(gap.after < 0.1 * gap.refitted, "{train}: {gap:?}");
    }
}
