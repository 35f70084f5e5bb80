//! Every broken model is refused with a message that says where it is broken and what to do. A case is a folder of
//! `fixtures/broken`: a model, and `expect`, whose lines must all stand in the message.
use std::path::Path;

use sagci_model::{ModelError, ObjectModel};

fn check(case: &Path) -> Result<(), String> {
    let error = match ObjectModel::read(case) {
        Ok(_) => return Err("was read without an error".into()),
        Err(e) => e.to_string(),
    };
    let expected = std::fs::read_to_string(case.join("expect")).unwrap();
    let missing: Vec<&str> = expected.lines().filter(|line| !error.contains(line)).collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("said:\n    {error}\n  without: {missing:?}")) }
}

#[test]
fn every_broken_model_gets_its_message() {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/broken");
    let mut folders: Vec<_> = std::fs::read_dir(cases).unwrap().map(|e| e.unwrap().path()).collect();
    folders.sort();
    assert!(folders.len() >= 80, "the cases are not all there");
    let failures: Vec<String> =
        folders.iter().filter_map(|f| check(f).err().map(|e| format!("{}: {e}", f.file_name().unwrap().display()))).collect();
    assert!(failures.is_empty(), "{} of {} cases:\n{}", failures.len(), folders.len(), failures.join("\n"));
}

#[test]
fn a_missing_model_names_the_file() {
    let error = ObjectModel::read("/nowhere/at/all").unwrap_err();
    assert!(matches!(error, ModelError::File { .. }));
    assert!(error.to_string().contains("/nowhere/at/all/object.urdf"), "{error}");
}

#[test]
fn a_text_without_bounds_is_refused_before_it_is_parsed() {
    let folder = tempfile::tempdir().unwrap();
    let read = |text: &[u8]| {
        std::fs::write(folder.path().join("object.urdf"), text).unwrap();
        ObjectModel::read(folder.path()).unwrap_err().to_string()
    };
    let deep = "<robot name=\"r\">".to_owned() + &"<a>".repeat(1_000_000);
    assert!(read(deep.as_bytes()).contains("inside one another"));
    let many = "<robot name=\"r\">".to_owned() + &"<a/>".repeat(1_000_000) + "</robot>";
    assert!(read(many.as_bytes()).contains("more than 200000 elements"));
    let attributes: String = (0..1000).map(|i| format!(" a{i}=\"\"")).collect();
    assert!(read(format!("<robot{attributes}/>").as_bytes()).contains("attributes"));
    assert!(read(&vec![b' '; 9 << 20]).contains("larger than the 8 MiB"));
    assert!(read(b"<robot name=\"\xff\"/>").contains("not UTF-8"));
    #[cfg(unix)]
    {
        std::fs::remove_file(folder.path().join("object.urdf")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", folder.path().join("object.urdf")).unwrap();
        assert!(ObjectModel::read(folder.path()).unwrap_err().to_string().contains("not a regular file"));
    }
}
