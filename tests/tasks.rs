//! The two tasks that ship, end to end: planned, carried out in the physics engine, judged by what is true in it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::process::Command;

use sagci_tests::{program, root};

/// Runs a script with a seed and answers the report; the program's exit code must agree with it.
fn run(script: &str, seed: u64) -> serde_json::Value {
    let out = tempfile::tempdir().unwrap();
    let output = Command::new(program())
        .current_dir(root())
        .env_remove("SAGCI_SKILLS")
        .args(["run", script, "--seed", &seed.to_string(), "--format", "json", "--out", out.path().to_str().unwrap()])
        .output()
        .unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{script} with seed {seed}: {report:#}\n{said}");
    assert_eq!(report["success"], true, "{report:#}");
    assert!(std::path::Path::new(report["recording"].as_str().unwrap()).exists(), "{report:#}");
    report
}

#[test]
fn the_mug_ends_up_in_the_shut_microwave() {
    let report = run("scripts/warm_mug.rhai", 1);
    let steps: Vec<&str> = report["steps"].as_array().unwrap().iter().map(|s| s["skill"].as_str().unwrap()).collect();
    assert_eq!(steps, ["open", "pick", "place", "close"]);
    let opened = &report["steps"][0];
    let (predicted, measured) = (opened["predicted"]["door_hinge"]["value"].as_f64(), opened["measured"]["door_hinge"]["value"].as_f64());
    assert!((predicted.unwrap() - measured.unwrap()).abs() < 0.1, "the door opened by another angle than planned: {opened:#}");
}

#[test]
fn the_tape_ends_up_on_the_table_and_the_drawer_shut() {
    run("scripts/fetch_tape.rhai", 1);
}
