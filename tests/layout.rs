//! The house itself: which way the arrows point, where `unsafe` may be, and that the kernel knows no skill by name.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use sagci_tests::root;

fn short(name: &str) -> Option<String> {
    match name {
        "sagci" => Some("cli".to_owned()),
        _ => name.strip_prefix("sagci-").map(|n| n.strip_prefix("skill-").map_or_else(|| n.to_owned(), |s| format!("skills/{s}"))),
    }
}

/// What each crate of ours uses of ours, development dependencies left out.
fn arrows() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let mut arrows = BTreeMap::new();
    for package in metadata["packages"].as_array().unwrap() {
        let Some(name) = short(package["name"].as_str().unwrap()) else { continue };
        let uses = package["dependencies"].as_array().unwrap().iter().filter(|d| d["kind"].as_str() != Some("dev"));
        arrows.insert(name, uses.filter_map(|d| short(d["name"].as_str().unwrap())).collect());
    }
    arrows
}

/// The table of ARCHITECTURE.md.
fn allowed() -> BTreeMap<String, BTreeSet<String>> {
    let text = std::fs::read_to_string(root().join("kernel/ARCHITECTURE.md")).unwrap();
    let rows = text.lines().skip_while(|l| !l.starts_with("| crate |")).skip(2).take_while(|l| l.starts_with('|'));
    rows.map(|row| {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let uses = cells[2].split(',').map(str::trim).filter(|c| !c.is_empty()).map(str::to_owned).collect();
        (cells[0].to_owned(), uses)
    })
    .collect()
}

#[test]
fn crates_use_one_another_only_as_the_map_says() {
    let allowed = allowed();
    assert!(allowed.len() > 10, "the table in kernel/ARCHITECTURE.md was not found");
    for (name, uses) in arrows() {
        if name == "tests" {
            continue;
        }
        let row = if name.starts_with("skills/") { "skills/*" } else { &name };
        let allowed = allowed.get(row).unwrap_or_else(|| panic!("kernel/ARCHITECTURE.md has no row for '{name}'"));
        let more: Vec<_> = uses.difference(allowed).collect();
        assert!(more.is_empty(), "{name} uses {more:?}, which kernel/ARCHITECTURE.md does not allow");
    }
}

#[test]
fn the_arrows_make_no_ring() {
    let mut left = arrows();
    while !left.is_empty() {
        let names: BTreeSet<String> = left.keys().cloned().collect();
        let before = left.len();
        left.retain(|_, uses| uses.iter().any(|u| names.contains(u)));
        assert!(left.len() < before, "these crates use one another in a ring: {names:?}");
    }
}

/// All Rust files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && path.file_name().is_some_and(|n| n != "target") {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found
}

/// A file's program text: without comments, and without its unit tests.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let text = text.split("#[cfg(test)]").next().unwrap();
    text.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_kernel_names_no_skill() {
    let skills: Vec<String> = std::fs::read_dir(root().join("skills"))
        .unwrap()
        .map(|e| e.unwrap().path().join("skill.yaml"))
        .filter(|p| p.is_file())
        .map(|p| {
            serde_yaml::from_str::<serde_yaml::Value>(&std::fs::read_to_string(p).unwrap()).unwrap()["name"].as_str().unwrap().to_owned()
        })
        .collect();
    assert!(skills.len() >= 4);
    // Crates that a skill's author uses may speak of what hands do; the host and the program must not know skills by name.
    for folder in ["kernel/script/src", "kernel/cli/src", "kernel/skill/src"] {
        for path in sources(&root().join(folder)) {
            let code = code(&path);
            for skill in &skills {
                for named in [format!("\"{skill}\""), format!("sagci_skill_{skill}"), format!("sagci-skill-{skill}")] {
                    assert!(!code.contains(&named), "{} names the skill {named}", path.display());
                }
            }
        }
    }
}

#[test]
fn no_skill_knows_an_object_by_name() {
    let objects: Vec<String> = std::fs::read_dir(root().join("world-models"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.join("HEAD").is_file())
        .map(|p| p.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    // Classes of parts and categories of furniture are words that objects are named by as well: these crates know no object.
    let words = ["furniture", "modelling", "training", "evaluation"].map(|c| root().join("kernel").join(c));
    for folder in ["skills", "kernel"] {
        let source = |p: &&std::path::PathBuf| p.components().any(|c| c.as_os_str() == "src") && !words.iter().any(|w| p.starts_with(w));
        for path in sources(&root().join(folder)).iter().filter(source) {
            let code = code(path);
            for object in &objects {
                assert!(!code.contains(&format!("\"{object}\"")), "{} names the object '{object}'", path.display());
            }
        }
    }
}

#[test]
fn unsafe_code_stands_only_at_the_plugin_border() {
    let may = |path: &Path| {
        let path = path.strip_prefix(root()).unwrap();
        path.starts_with("kernel/skill") || path == Path::new("kernel/script/src/plugins/open.rs")
    };
    for folder in ["kernel", "skills"] {
        for path in sources(&root().join(folder)).into_iter().filter(|p| p.components().any(|c| c.as_os_str() == "src")) {
            let code = code(&path);
            assert!(may(&path) || !code.contains("unsafe {") && !code.contains("unsafe fn"), "{} holds unsafe code", path.display());
        }
        for entry in std::fs::read_dir(root().join(folder)).unwrap() {
            let krate = entry.unwrap().path();
            for door in ["src/lib.rs", "src/main.rs"].map(|f| krate.join(f)).into_iter().filter(|f| f.is_file()) {
                let text = std::fs::read_to_string(&door).unwrap();
                // A skill's entry is an exported symbol, and the host opens libraries: they deny what they then allow once.
                let word =
                    if folder == "skills" || krate.ends_with("script") { "#![deny(unsafe_code)]" } else { "#![forbid(unsafe_code)]" };
                assert!(
                    krate.ends_with("kernel/skill") || text.contains(word) || text.contains("#![forbid(unsafe_code)]"),
                    "{} lacks {word}",
                    door.display()
                );
            }
        }
    }
}
