//! `sagci perceive` as its users call it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::path::Path;
use std::process::{Command, Output};

use sagci_furniture::{Category, Labelled, Look, Noise, Random, families, look};

fn seen(views: usize) -> Labelled {
    let mut random = Random::new(11, "tests of the program");
    let object = families(Category::Microwave, true)[0].draw(&mut random);
    let how = Look { views, width: 240, points: 12_000, near: 1.0, around: false, surroundings: false, noise: Noise::draw(&mut random) };
    look(&object, &how, &mut random)
}

fn perceive(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sagci")).arg("perceive").args(arguments).current_dir(folder).output().unwrap()
}

#[test]
fn a_cloud_becomes_a_model_with_its_json_alone_on_stdout() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = seen(1);
    sagci_cloud::write_parts(&folder.path().join("thing.ply"), &cloud.points, &[]).unwrap();
    let output = perceive(folder.path(), &["thing.ply", "--out", "found", "--format", "json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let file: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.path().join("found/perception.json")).unwrap()).unwrap();
    assert_eq!(json, file);
    assert_eq!((json["schema"].as_u64(), json["frame"].as_str()), (Some(1), Some("world")));
    let parts = sagci_cloud::read(&folder.path().join("found/parts.ply")).unwrap();
    assert_eq!(parts, cloud.points);
    let model = sagci_model::ObjectModel::read(folder.path().join("found")).unwrap();
    assert_eq!(model.joints.len(), json["joints"].as_array().unwrap().len());
}

#[test]
fn a_camera_frame_cloud_is_answered_in_that_frame() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = seen(1);
    let X_WC = cloud.cameras[0].X_WC;
    let in_camera: Vec<_> = cloud.points.iter().map(|p| X_WC.inverse() * p).collect();
    sagci_cloud::write_parts(&folder.path().join("world.ply"), &cloud.points, &[]).unwrap();
    sagci_cloud::write_parts(&folder.path().join("camera.ply"), &in_camera, &[]).unwrap();
    let M = X_WC.to_homogeneous();
    let rows: Vec<Vec<f64>> = (0..4).map(|i| (0..4).map(|j| M[(i, j)]).collect()).collect();
    let poses = serde_json::json!({ "frame": "camera", "views": [{ "X_WC": rows, "width": 240, "height": 180, "fx": 200.0, "fy": 200.0, "cx": 120.0, "cy": 90.0 }] });
    std::fs::write(folder.path().join("poses.json"), poses.to_string()).unwrap();
    let json = |arguments: &[&str]| -> serde_json::Value {
        let output = perceive(folder.path(), arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let a = json(&["world.ply", "--format", "json"]);
    let b = json(&["camera.ply", "--camera-pose", "poses.json", "--format", "json"]);
    assert_eq!(b["frame"], "camera");
    let three = |v: &serde_json::Value| nalgebra::Vector3::from_fn(|k, _| v[k].as_f64().unwrap());
    let (first, second) = (a["joints"].as_array().unwrap(), b["joints"].as_array().unwrap());
    assert_eq!(first.len(), second.len());
    for (a, b) in first.iter().zip(second) {
        assert!((three(&a["axis"]) - X_WC.rotation * three(&b["axis"])).norm() < 0.03);
    }
}

#[test]
fn a_view_that_cuts_the_object_off_says_so_and_a_whole_view_does_not() {
    for (near, cut) in [(0.45, true), (1.0, false)] {
        let folder = tempfile::tempdir().unwrap();
        let mut random = Random::new(4, "cropped");
        let object = families(Category::Oven, false)[0].draw(&mut random);
        let how = Look { views: 1, width: 240, points: 12_000, near, around: false, surroundings: false, noise: Noise::NONE };
        let cloud = look(&object, &how, &mut random);
        let camera = &cloud.cameras[0];
        sagci_cloud::write_parts(&folder.path().join("view.ply"), &cloud.points, &[]).unwrap();
        let m = camera.X_WC.to_homogeneous();
        let rows: Vec<Vec<f64>> = (0..4).map(|i| (0..4).map(|j| m[(i, j)]).collect()).collect();
        let (width, height, f) = (camera.width as f64, camera.height as f64, camera.focal);
        let poses = serde_json::json!({ "views": [{ "X_WC": rows, "width": width, "height": height, "fx": f, "fy": f }] });
        std::fs::write(folder.path().join("poses.json"), poses.to_string()).unwrap();
        let out = perceive(folder.path(), &["view.ply", "--camera-pose", "poses.json", "--format", "json"]);
        let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let said = report["notes"].as_array().unwrap().iter().any(|n| n.as_str().unwrap().contains("cuts the object off"));
        assert_eq!(said, cut, "{:#}", report["notes"]);
    }
}

#[test]
fn bad_input_is_an_error_with_a_reason_and_nothing_on_stdout() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("empty.ply"), "").unwrap();
    std::fs::write(folder.path().join("picture.ply"), "GIF89a").unwrap();
    let lying = "ply\nformat ascii 1.0\nelement vertex 900\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    std::fs::write(folder.path().join("lying.ply"), lying).unwrap();
    sagci_cloud::write_parts(&folder.path().join("few.ply"), &seen(1).points[..20], &[]).unwrap();
    for (arguments, reason) in [
        (vec!["missing.ply"], "missing.ply"),
        (vec!["empty.ply"], "is empty"),
        (vec!["picture.ply"], "neither a PLY"),
        (vec!["lying.ply"], "holds 1"),
        (vec!["few.ply"], "are needed"),
        (vec!["few.ply", "--camera-pose", "empty.ply"], "empty.ply"),
    ] {
        let output = perceive(folder.path(), &arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty() && said.contains(reason), "{arguments:?}: {said}");
    }
}
