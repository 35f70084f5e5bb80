//! Effects hidden in data that another engine made (MuJoCo; tests/measured/mujoco), to be named blindly: only this test opens the
//! sealed truths.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::path::{Path, PathBuf};

use sagci_gap::report::{Report, Verdict};
use sagci_gap::{Options, find};
use sagci_model::ObjectModel;
use sagci_recording::{Angles, read_with};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured/mujoco")
}

fn answer(case: &str) -> Report {
    let folder = folder().join(case);
    let model = ObjectModel::read(&folder).unwrap();
    let logs = |prefix: &str| {
        let mut paths: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
        paths.retain(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with(prefix)));
        paths.sort();
        read_with(&paths, Some(&model), &sagci_recording::Options { angles: Angles::Radians, ..Default::default() }).unwrap()
    };
    find(&model, &logs("train"), &logs("held_out"), &Options::default()).unwrap().report
}

/// What was hidden: its name, and its numbers.
fn truth(case: &str) -> (String, Vec<(String, f64)>) {
    let text = std::fs::read_to_string(folder().join("sealed").join(format!("{case}.json"))).unwrap();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let hidden = &value["hidden"][0];
    let numbers = hidden["parameters"].as_object().unwrap().iter().map(|(k, v)| (k.clone(), v.as_f64().unwrap())).collect();
    (hidden["effect"].as_str().unwrap().to_owned(), numbers)
}

/// The effect has its name and nothing else is named; its numbers are right within `share`; the held-out gap is down ten times.
#[track_caller]
fn is_named(case: &str, share: f64) {
    let report = answer(case);
    let (name, numbers) = truth(case);
    let named: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(named, [name.as_str()], "{case}");
    assert_eq!(report.verdict, Verdict::Named, "{case}: {:?}", report.effects[0].alternatives);
    let effect = &report.effects[0];
    assert!(effect.confirmed, "{case}: {:?}", effect.evidence);
    assert_eq!(effect.joint.as_deref(), Some("hinge"));
    for (name, value) in numbers {
        let found = &effect.parameters[&name];
        assert!((found.value - value).abs() < share * value.abs(), "{case}: {name} is {value}, found {found:?}");
        assert!(found.lower < found.value && found.value < found.upper);
    }
    let gap = report.gap.held_out.unwrap();
    assert!(gap.after < 0.1 * gap.refitted, "{case}: {} after {}", gap.after, gap.refitted);
}

#[test]
fn nothing_is_named_where_nothing_is_hidden() {
    let report = answer("clean");
    assert_eq!(report.verdict, Verdict::NoGap, "{:?}", report.effects);
    assert!(report.effects.is_empty() && report.unexplained.is_none());
}

#[test]
fn a_loss_in_the_bearing_is_named() {
    is_named("a", 0.05);
    is_named("b", 0.05);
    is_named("f", 0.05);
}

#[test]
fn a_force_by_position_is_named() {
    is_named("c", 0.05);
    is_named("e", 0.05);
}

#[test]
fn inertia_of_a_drive_is_told_from_that_of_the_link() {
    is_named("d", 0.15);
}
