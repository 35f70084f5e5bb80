//! The weights that ship, and what they make of one cloud: whoever changes either sees it here.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use sagci_furniture::{Category, Look, Noise, Random, families, look};
use sagci_modelling::{Weights, perceive};
use sha2::{Digest, Sha256};

#[test]
fn the_weights_are_those_whose_hash_stands_beside_them() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../world-models/perception");
    let bytes = std::fs::read(format!("{folder}/weights.safetensors")).unwrap();
    let stated = std::fs::read_to_string(format!("{folder}/weights.sha256")).unwrap();
    let hash: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    assert_eq!(stated.split_whitespace().next().unwrap(), hash);
    assert!(bytes.len() < 10_000_000);
    assert_eq!(Weights::from_bytes(&bytes).unwrap(), Weights::shipped().unwrap());
    let made: serde_json::Value = serde_json::from_str(&Weights::shipped().unwrap().made_by).unwrap();
    let branches = made["mean_of"].as_array().map_or_else(|| vec![made.clone()], Clone::clone);
    assert!(branches.iter().all(|b| b["settings"]["seed"].is_u64() && b["log"].as_array().is_some_and(|l| !l.is_empty())), "{branches:?}");
}

#[test]
fn one_cloud_gives_the_stored_answer() {
    let mut random = Random::new(2, "golden");
    let object = families(Category::Microwave, false)[0].draw(&mut random);
    let noise = Noise { axial: 0.001, axial_square: 0.001, ..Noise::NONE };
    let how = Look { views: 1, width: 240, points: 10_000, near: 1.0, around: false, surroundings: false, noise };
    let cloud = look(&object, &how, &mut random);
    let found = perceive(&cloud.points, "golden", &Weights::shipped().unwrap()).unwrap();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden.json");
    let now = serde_json::to_value(&found.report).unwrap();
    // `GOLDEN=write cargo test -p sagci-modelling --test golden` after a change that is meant.
    if std::env::var("GOLDEN").is_ok_and(|v| v == "write") {
        std::fs::write(path, serde_json::to_string_pretty(&now).unwrap() + "\n").unwrap();
    }
    let stored: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    same(&stored, &now, "");
}

/// Equal but for rounding.
fn same(a: &serde_json::Value, b: &serde_json::Value, at: &str) {
    use serde_json::Value;
    match (a, b) {
        (Value::Number(x), Value::Number(y)) => {
            let (x, y) = (x.as_f64().unwrap(), y.as_f64().unwrap());
            assert!((x - y).abs() < 1e-3 + 1e-3 * x.abs(), "{at}: {x} became {y}");
        }
        (Value::Array(x), Value::Array(y)) => {
            assert_eq!(x.len(), y.len(), "{at}");
            x.iter().zip(y).enumerate().for_each(|(i, (x, y))| same(x, y, &format!("{at}/{i}")));
        }
        (Value::Object(x), Value::Object(y)) => {
            assert_eq!(x.keys().collect::<Vec<_>>(), y.keys().collect::<Vec<_>>(), "{at}");
            x.iter().for_each(|(k, x)| same(x, &y[k], &format!("{at}/{k}")));
        }
        _ => assert_eq!(a, b, "{at}"),
    }
}
