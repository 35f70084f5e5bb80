//! The promises of the store: versions are named by their bytes and never change, damage is found, names are explained.

use std::path::{Path, PathBuf};

use sagci_library::{Evidence, Library, LibraryError, Severity, Version};

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            std::fs::copy(&path, &target).unwrap();
        }
    }
}

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models")
}

/// A library of one's own with the shipped microwave and mug.
fn scratch() -> (tempfile::TempDir, Library) {
    let root = tempfile::tempdir().unwrap();
    for name in ["microwave", "mug"] {
        copy(&shipped().join(name), &root.path().join(name));
    }
    let library = Library::open(root.path()).unwrap();
    (root, library)
}

/// Bytes of every file of a version.
fn bytes(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.extend(bytes(&path)) } else { all.push((path.clone(), std::fs::read(&path).unwrap())) }
    }
    all.sort();
    all
}

#[test]
fn a_refined_model_becomes_a_new_version_and_the_old_one_stays_as_it_was() {
    let (root, library) = scratch();
    let old = library.get("microwave").unwrap();
    let before = bytes(&old.model.folder);

    let mut refined = (*old.model).clone();
    refined.joints[0].damping = 1.6;
    let evidence = [Evidence { name: "run.json".into(), bytes: b"{\"gap\": 0.01}".to_vec() }];
    let version = library.publish_model("microwave", &refined, &evidence).unwrap();

    assert_ne!(version, old.version);
    let new = library.get("microwave").unwrap();
    assert_eq!((&new.version, new.model.joints[0].damping), (&version, 1.6));
    assert_eq!(std::fs::read(new.model.folder.join("evidence/run.json")).unwrap(), b"{\"gap\": 0.01}");
    assert_eq!(bytes(&old.model.folder), before);
    let again = library.get_version("microwave", old.version.as_str()).unwrap();
    assert_eq!(again.model.joints[0].damping, old.model.joints[0].damping);
    let report = library.report("microwave").unwrap();
    assert_eq!(report.all_versions.iter().filter(|v| v.head).map(|v| &v.version).collect::<Vec<_>>(), [&version]);
    assert!(library.verify("microwave").unwrap().sound);

    // The same again changes nothing; going back to the old bytes goes back to the old name.
    assert_eq!(library.publish_model("microwave", &refined, &evidence).unwrap(), version);
    assert_eq!(library.publish("microwave", &old.model.folder, &[]).unwrap(), old.version);
    assert_eq!(library.versions("microwave").unwrap().len(), 2);
    drop(root);
}

/// The name is what coreutils say it is: no part of it is known to this program alone.
#[cfg(unix)]
#[test]
fn a_versions_name_is_the_hash_that_anyone_can_compute() {
    let library = Library::open(shipped()).unwrap();
    for name in library.names().unwrap() {
        let stored = library.get(&name).unwrap();
        let script = "find . -type f -printf '%P\\n' | LC_ALL=C sort | xargs sha256sum | sha256sum | cut -c1-12";
        let Ok(output) = std::process::Command::new("sh").args(["-c", script]).current_dir(&stored.model.folder).output() else { return };
        if output.status.success() && output.stdout.len() == 13 {
            assert_eq!(String::from_utf8(output.stdout).unwrap().trim(), stored.version.as_str(), "{name}");
        }
        assert_eq!(Version::of_folder(&stored.model.folder).unwrap(), stored.version);
    }
}

#[test]
fn a_name_follows_from_every_byte_and_every_path() {
    let make = |files: &[(&str, &str)]| {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        Version::of_folder(folder.path()).unwrap()
    };
    let base = make(&[("a", "1"), ("b/c", "2")]);
    assert_eq!(base, make(&[("b/c", "2"), ("a", "1")]));
    for other in [&[("a", "1"), ("b/c", "3")][..], &[("a", "1"), ("b/d", "2")], &[("a", "1")], &[("a", "12"), ("b/c", "")]] {
        assert_ne!(base, make(other), "{other:?}");
    }
}

#[test]
fn a_changed_byte_is_found_and_the_version_is_not_used() {
    let (_root, library) = scratch();
    let stored = library.get("mug").unwrap();
    let document = stored.model.folder.join("model.yaml");
    let text = std::fs::read_to_string(&document).unwrap().replace("surface_friction: 0.6", "surface_friction: 0.7");
    std::fs::write(&document, text).unwrap();

    let error = library.get("mug").unwrap_err();
    assert!(matches!(error, LibraryError::Corrupt { .. }) && error.to_string().contains("publish the change as a new version"));
    let report = library.verify("mug").unwrap();
    assert!(!report.sound && report.findings[0].message.contains("changed after it was published"), "{:?}", report.findings);
    // One damaged object does not hide the others.
    let list = library.list().unwrap();
    assert_eq!(list.iter().map(|l| (l.name.as_str(), l.problem.is_some())).collect::<Vec<_>>(), [("microwave", false), ("mug", true)]);
    // The change, published, is a version of its own.
    let version = library.publish("mug", &stored.model.folder, &[]).unwrap();
    assert_eq!(library.get("mug").unwrap().model.document.surface_friction, 0.7);
    assert_ne!(version, stored.version);
}

#[test]
fn verify_says_what_is_wrong_with_an_unsound_model() {
    let damage = |change: &dyn Fn(&Path)| {
        let (root, library) = scratch();
        let home = root.path().join("microwave");
        let staged = tempfile::tempdir().unwrap();
        copy(&home.join(library.head("microwave").unwrap().as_str()), staged.path());
        change(staged.path());
        // Around `publish`, which would refuse it: as if made by hand.
        let version = Version::of_folder(staged.path()).unwrap();
        copy(staged.path(), &home.join(version.as_str()));
        std::fs::write(home.join("HEAD"), version.as_str()).unwrap();
        let report = library.verify("microwave").unwrap();
        let unsound = !report.sound;
        let text = report.findings.iter().map(|f| format!("{}: {}", f.place, f.message)).collect::<Vec<_>>().join("\n");
        assert_eq!(unsound, report.findings.iter().any(|f| f.severity == Severity::Error));
        let refused = library.publish("microwave", staged.path(), &[]).is_err();
        assert_eq!(unsound, refused, "what verify finds, publish refuses: {text}");
        text
    };
    let edit = |file: &'static str, from: &'static str, to: &'static str| {
        move |folder: &Path| {
            let path = folder.join(file);
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains(from));
            std::fs::write(&path, text.replace(from, to)).unwrap();
        }
    };
    type Damage = Box<dyn Fn(&Path)>;
    let cases: [(Damage, &str); 11] = [
        (Box::new(edit("model.yaml", "name: microwave", "name: toaster")), "is 'toaster', but the object is 'microwave'"),
        (Box::new(edit("model.yaml", "licence: Apache-2.0", "licence: ''")), "provenance: licence: is missing"),
        (Box::new(edit("model.yaml", "link: door", "link: dor")), "did you mean 'door'?"),
        (Box::new(edit("object.urdf", "lower=\"0\"", "lower=\"-1\"")), "a joint that a hand opens is shut at 0"),
        (Box::new(edit("object.urdf", "xyz=\"0 0 -1\"", "xyz=\"0 0 1\"")), "inwards as it opens; is its axis reversed?"),
        (Box::new(edit("model.yaml", "0.475, -0.108,", "0.475, -0.308,")), "grasp 'handle': closes on nothing"),
        (Box::new(edit("model.yaml", "size: [0.414,", "size: [0.614,")), "region 'cavity': is not free"),
        (Box::new(|f| std::fs::remove_file(f.join("meshes/micro.stl")).unwrap()), "micro.stl"),
        (Box::new(|f| std::fs::write(f.join("meshes/spare.stl"), "").unwrap()), "meshes/spare.stl: is used by no link"),
        (
            Box::new(edit("object.urdf", "<box size=\"0.518 0.048 0.37\"/>", "<mesh filename=\"meshes/microfeet.stl\"/>")),
            "is used to collide but is not closed",
        ),
        (
            Box::new(edit("object.urdf", "filename=\"meshes/micro.stl\"", "filename=\"meshes/../meshes/micro.stl\"")),
            "lies outside of the version",
        ),
    ];
    for (change, expected) in cases {
        let text = damage(&*change);
        assert!(text.contains(expected), "expected '{expected}', found:\n{text}");
    }
}

/// A servo that swings a weight both ways has no shut position, and what is found out about it is kept like a door's.
#[test]
fn a_joint_that_no_hand_opens_may_go_both_ways() {
    let (_root, library) = scratch();
    let servo = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured/xl330_servo");
    library.publish("xl330_servo", &servo, &[]).unwrap();
    let limits = library.get("xl330_servo").unwrap().model.joints[0].limits;
    assert!(limits.lower < 0.0 && limits.upper > 0.0);
}

#[test]
fn a_missing_licence_is_found() {
    let (root, library) = scratch();
    std::fs::remove_file(root.path().join("mug/LICENSE")).unwrap();
    let report = library.verify("mug").unwrap();
    assert!(!report.sound && report.findings[0].place == "LICENSE", "{:?}", report.findings);
}

#[test]
fn an_unknown_name_is_answered_with_what_was_meant() {
    let (root, library) = scratch();
    let says = |error: LibraryError, what: &str| assert!(error.to_string().contains(what), "{error}");
    says(library.get("microwav").unwrap_err(), "did you mean 'microwave'?");
    says(library.get("zebra").unwrap_err(), "there are: microwave, mug");
    says(library.get("../mug").unwrap_err(), "there is no object '../mug'");
    says(library.get_version("mug", "000000000000").unwrap_err(), "no version '000000000000'");
    says(library.publish("../mug", root.path(), &[]).unwrap_err(), "cannot be an object's name");
    says(Library::open(root.path().join("nowhere")).unwrap_err(), "is not a folder with object models");
    std::fs::write(root.path().join("mug/HEAD"), "latest\n").unwrap();
    says(library.get("mug").unwrap_err(), "'latest' is not the name of a version");
    std::fs::write(root.path().join("mug/HEAD"), "000000000000\n").unwrap();
    says(library.get("mug").unwrap_err(), "names the version 000000000000, which is not there");
}

#[test]
fn what_is_not_sound_is_not_published() {
    let (_root, library) = scratch();
    let head = library.head("mug").unwrap();
    let staged = tempfile::tempdir().unwrap();
    std::fs::write(staged.path().join("object.urdf"), "<robot name=\"mug\"><link name=\"mug\"/></robot>").unwrap();
    let error = library.publish("mug", staged.path(), &[]).unwrap_err();
    assert!(matches!(error, LibraryError::Unsound { .. }), "{error}");
    let bad = [Evidence { name: "../out".into(), bytes: Vec::new() }];
    let stored = library.get("mug").unwrap();
    assert!(matches!(library.publish("mug", &stored.model.folder, &bad).unwrap_err(), LibraryError::Name { .. }));
    #[cfg(unix)]
    {
        let linked = tempfile::tempdir().unwrap();
        copy(&stored.model.folder, linked.path());
        std::os::unix::fs::symlink("/etc/hostname", linked.path().join("secret")).unwrap();
        assert!(library.publish("mug", linked.path(), &[]).unwrap_err().to_string().contains("plain files only"));
    }
    assert_eq!(library.head("mug").unwrap(), head);
    assert_eq!(library.versions("mug").unwrap().len(), 1);
}

/// A reader in the middle of many publications always finds a whole model, and never waits for a writer.
#[test]
fn a_reader_always_finds_a_whole_version() {
    let (_root, library) = scratch();
    let model = library.get("mug").unwrap().model;
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for i in 0..12 {
                let mut changed = (*model).clone();
                changed.document.surface_friction = 0.5 + 0.01 * f64::from(i);
                library.publish_model("mug", &changed, &[]).unwrap();
            }
            done.store(true, std::sync::atomic::Ordering::Relaxed);
        });
        while !done.load(std::sync::atomic::Ordering::Relaxed) {
            library.get("mug").unwrap();
        }
    });
    assert_eq!(library.versions("mug").unwrap().len(), 13);
}
