//! Skills as plugins: a new one needs no change to the kernel, and a bad one harms nobody.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Vector3};
use sagci_script::plugins::{SearchPath, SkillSet, library_file_name};
use sagci_signal::{ObjectBelief, Observation, SceneBelief};
use sagci_skill::{Argument, Failure, FailureCode, LogSink, PlanRequest, Plugin, Skill, SkillTable, StepInput, StepReply};
use sagci_tests::{Built, PUSH_YAML, build_push, rustc_library, write};

/// The skill's source once more, as a Rust type of this very program.
#[path = "fixtures/push/push.rs"]
mod push;

fn silent() -> LogSink {
    Arc::new(|_, _| {})
}

fn discover(folder: &Path) -> SkillSet {
    SkillSet::discover(&SearchPath { folders: vec![folder.to_owned()], libraries: vec![] }, &["deg"], &silent())
}

fn request() -> PlanRequest {
    let object = ObjectBelief {
        name: "box".into(),
        model: "models/box".into(),
        X_WO: Isometry3::translation(0.5, 0.1, 0.0),
        q: vec![0.3],
        covariance: Matrix6::identity(),
        X_TO: None,
        seen: true,
    };
    PlanRequest {
        arguments: BTreeMap::from([
            ("object".to_owned(), Argument::Object { name: "box".into(), joint: None }),
            ("by".to_owned(), Argument::Length(0.1 + 0.2)),
        ]),
        belief: SceneBelief {
            robot: "models/arm".into(),
            X_WR: Isometry3::identity(),
            table_height: 0.0,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            objects: vec![object],
        },
        q: vec![0.1; 7],
        gripper_width: 0.08,
        period: 1e-3,
        seed: 5,
    }
}

fn try_out(skill: &dyn Skill) -> Result<(String, Vec<StepReply>), Failure> {
    let mut plan = skill.plan(&request(), &|| false)?;
    let input = |n: usize| StepInput {
        observation: Observation { time: n as f64 * 1e-3, tau: vec![1.0 / 3.0; 7], v: vec![1e-17; 7], ..Default::default() },
        belief: None,
        cancel: n > 25,
    };
    Ok((format!("{:?}", plan.summary), (0..30).map(|n| plan.execution.step(&input(n))).collect()))
}

/// The skill's library, built once for all tests.
fn built() -> &'static (tempfile::TempDir, Built) {
    static BUILT: std::sync::OnceLock<(tempfile::TempDir, Built)> = std::sync::OnceLock::new();
    BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let built = build_push(folder.path(), &[]);
        (folder, built)
    })
}

/// A copy of the built skill in a folder of its own.
fn copy() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (yaml, library) = (folder.path().join("push/skill.yaml"), folder.path().join("push").join(library_file_name("sagci_skill_push")));
    write(&yaml, PUSH_YAML);
    std::fs::copy(&built().1.library, &library).unwrap();
    (folder, yaml, library)
}

/// Why the only skill in a folder cannot be used.
fn refusal(folder: &Path) -> String {
    let set = discover(folder);
    assert!(set.loaded.is_empty(), "{:?}", set.loaded);
    assert_eq!(set.broken.len(), 1, "{:?}", set.broken);
    set.broken[0].to_string()
}

#[test]
fn a_skill_gives_the_same_bits_as_a_rust_type_through_its_table_and_from_its_library() {
    static TABLE: SkillTable = SkillTable::of::<push::Push>();
    let direct = try_out(&push::Push).unwrap();
    assert_eq!(try_out(&Plugin::in_process(&TABLE, silent()).unwrap()).unwrap(), direct);
    let set = discover(&built().1.skills);
    assert_eq!(set.broken, []);
    assert_eq!(try_out(set.get("push").unwrap().skill.as_ref()).unwrap(), direct);
}

#[test]
fn a_folder_that_is_given_twice_gives_each_skill_once() {
    let skills = built().1.skills.clone();
    let path = SearchPath { folders: vec![skills.clone(), skills.join("push"), skills], libraries: vec![] };
    let set = SkillSet::discover(&path, &[], &silent());
    assert_eq!((set.loaded.len(), set.broken.len()), (1, 0));
    assert_eq!(set.loaded[0].sha256().unwrap().len(), 64);
}

#[test]
fn a_plugin_for_another_version_of_the_border_is_refused_before_it_is_opened() {
    let (folder, yaml, library) = copy();
    write(&yaml, &PUSH_YAML.replace("abi: 1", "abi: 2"));
    // Nothing of the library is looked at.
    std::fs::write(&library, "not a library").unwrap();
    let said = refusal(folder.path());
    assert!(said.contains("skill.yaml") && said.contains("version 2 of the plugin border") && said.contains("rebuild"), "{said}");
}

#[test]
fn a_table_of_another_version_is_refused_though_the_sidecar_claims_otherwise() {
    let (folder, _, library) = copy();
    let source = write(
        folder.path().join("raw.rs"),
        "#[repr(C)] pub struct Header { magic: u64, abi: u32, size: u32, features: u64 }
         static HEADER: Header = Header { magic: u64::from_le_bytes(*b\"SAGCISKL\"), abi: 99, size: 24, features: 0 };
         #[unsafe(no_mangle)] pub extern \"C\" fn sagci_skill_push() -> *const Header { &raw const HEADER }",
    );
    std::fs::remove_file(&library).unwrap();
    rustc_library(&source, &library, &[]).unwrap();
    let said = refusal(folder.path());
    assert!(said.contains("built for version 99") && said.contains("rebuild"), "{said}");
}

#[test]
fn a_library_without_the_entry_is_refused_by_the_entrys_name() {
    let (folder, yaml, _) = copy();
    write(&yaml, &PUSH_YAML.replace("entry: sagci_skill_push", "entry: sagci_skill_shove"));
    let said = refusal(folder.path());
    assert!(said.contains("has no symbol 'sagci_skill_shove'") && said.contains("export_skill!"), "{said}");
}

#[test]
fn a_library_that_was_cut_short_is_refused_and_does_not_end_the_program() {
    for share in [0.0, 0.001, 0.1, 0.5, 0.9] {
        let (folder, _, library) = copy();
        let bytes = std::fs::read(&library).unwrap();
        std::fs::write(&library, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
        let said = refusal(folder.path());
        assert!(said.contains(&library.display().to_string()), "{said}");
        assert!(said.contains("cut short") || said.contains("cannot be opened"), "{share}: {said}");
    }
}

#[test]
fn a_library_that_says_other_things_than_its_sidecar_is_refused() {
    for (from, to, field) in [
        ("version: 0.1.0", "version: 0.2.0", "version"),
        ("name: push", "name: shove", "name"),
        ("kind: length", "kind: angle", "parameters"),
        ("Pushes a thing", "Pulls a thing", "summary"),
    ] {
        let (folder, yaml, _) = copy();
        write(&yaml, &PUSH_YAML.replace(from, to));
        let said = refusal(folder.path());
        assert!(said.contains("says other things of itself") && said.contains(&format!("{field} is")), "{said}");
    }
}

#[test]
fn a_sidecar_that_is_wrong_is_refused_with_its_place() {
    for (from, to, word) in [
        ("name: push", "name: deg", "already means something"),
        ("name: push", "name: Push", "name"),
        ("abi: 1", "abi: one", "abi"),
        ("summary: Pushes", "sumary: Pushes", "sumary"),
        ("library: sagci_skill_push", "library: sagci_skill_missing", "neither beside it nor beside the program"),
    ] {
        let (folder, yaml, _) = copy();
        write(&yaml, &PUSH_YAML.replacen(from, to, 1));
        let said = refusal(folder.path());
        assert!(said.contains("skill.yaml") && said.contains(word), "{said}");
    }
    let (folder, yaml, _) = copy();
    write(&yaml, "name: [");
    assert!(refusal(folder.path()).contains("line "), "the place is missing");
}

#[test]
fn a_bad_plugin_does_not_keep_the_others_from_loading() {
    let (folder, ..) = copy();
    write(folder.path().join("bad/skill.yaml"), "nonsense");
    let set = discover(folder.path());
    assert_eq!((set.loaded.len(), set.broken.len()), (1, 1));
}

#[test]
fn a_panic_in_a_plugins_plan_stays_in_the_plugin() {
    let folder = tempfile::tempdir().unwrap();
    let built = build_push(folder.path(), &["--cfg", "panics"]);
    let set = discover(&built.skills);
    let failure = try_out(set.get("push").unwrap().skill.as_ref()).unwrap_err();
    assert_eq!(failure.code, FailureCode::PluginFault);
    assert!(failure.message.contains("push was built to panic"), "{failure}");
    // And once more: the plugin is still there.
    assert!(try_out(set.get("push").unwrap().skill.as_ref()).is_err());
}
