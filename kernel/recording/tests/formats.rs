//! The examples in FORMATS.md are read.
#![allow(clippy::unwrap_used, missing_docs)]

use sagci_model::{ActuatorLaw, Document};
use sagci_recording::{CommandKind, read};

/// Blocks of the page in a language.
fn blocks(language: &str) -> Vec<String> {
    let page = include_str!("../FORMATS.md");
    page.split("```").skip(1).step_by(2).filter_map(|b| b.strip_prefix(language)?.strip_prefix('\n')).map(str::to_owned).collect()
}

#[test]
fn the_drives_of_the_page_are_those_of_model_yaml() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.yaml");
    let laws: Vec<ActuatorLaw> = blocks("yaml")
        .into_iter()
        .map(|block| {
            std::fs::write(&path, format!("schema: 1\n{block}")).unwrap();
            let document = Document::read(&path).unwrap();
            // What is written reads the same: an unlimited effort too.
            std::fs::write(&path, document.to_yaml().unwrap()).unwrap();
            assert_eq!(Document::read(&path).unwrap(), document);
            document.actuators[0].law.clone()
        })
        .collect();
    assert!(matches!(
        laws[..],
        [ActuatorLaw::Torque { max_effort: 12.0 }, ActuatorLaw::PositionServo { .. }, ActuatorLaw::DcMotor { gain: None, .. }]
    ));
}

#[test]
fn the_table_of_the_page_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("door.csv");
    std::fs::write(&path, &blocks("text")[0]).unwrap();
    let log = read(&[path], None).unwrap().remove(0);
    let hinge = log.joint("hinge").unwrap();
    assert_eq!((hinge.position.value.len(), hinge.effort.as_ref().unwrap().value.len()), (2, 1));
    assert_eq!(hinge.command.as_ref().unwrap().0, CommandKind::Effort);
}
