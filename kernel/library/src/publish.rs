//! Taking a new version in: copy, check, name, make durable, show.
//!
//! Everything happens beside the old versions, in the same file system, so that each of the two steps that others can
//! see is one rename: first the folder gets its name, then HEAD. A crash before the first leaves a `.staged-` folder
//! that the next writer removes; a crash between them leaves a version that nobody points to. Either way HEAD names a
//! whole version.

use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use sagci_model::ObjectModel;

use crate::store::{HEAD, is_name};
use crate::version::files;
use crate::{Library, LibraryError, Severity, Version, check};

const LOCK: &str = ".lock";
const STAGED: &str = ".staged-";
/// How long a second writer waits for the first.
const PATIENCE: Duration = Duration::from_secs(30);

/// A file that says why a version was made: it is kept in the version's `evidence/` folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Evidence {
    /// File name.
    pub name: String,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// The points between which a crash is simulated by tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    Copied,
    Named,
    HeadWritten,
}

impl Library {
    /// Takes in the model that lies in a folder, with its evidence, as the object's current version, and says the
    /// version's name. The folder is copied, not moved. The object is made if it does not exist; bytes that are stored
    /// already are not stored again.
    ///
    /// Errors: a name that cannot be used; a model that cannot be read or is not sound; another writer that does not
    /// end; a full disk. HEAD is then what it was.
    pub fn publish(&self, name: &str, staged: &Path, evidence: &[Evidence]) -> Result<Version, LibraryError> {
        self.publish_by_steps(name, &|to| copy(staged, to), evidence, &|_| Ok(()))
    }

    /// Takes in a model, as [`Self::publish`] does a folder.
    ///
    /// Errors: the same.
    pub fn publish_model(&self, name: &str, model: &ObjectModel, evidence: &[Evidence]) -> Result<Version, LibraryError> {
        self.publish_by_steps(name, &|to| Ok(model.write(to)?), evidence, &|_| Ok(()))
    }

    pub(crate) fn publish_by_steps(
        &self,
        name: &str,
        fill: &dyn Fn(&Path) -> Result<(), LibraryError>,
        evidence: &[Evidence],
        after: &dyn Fn(Step) -> Result<(), LibraryError>,
    ) -> Result<Version, LibraryError> {
        if !is_name(name) {
            let message = "cannot be an object's name; use up to 64 letters, digits, '_' and '-'".to_owned();
            return Err(LibraryError::Name { name: name.to_owned(), message });
        }
        let home = self.root().join(name);
        std::fs::create_dir_all(&home).map_err(LibraryError::file(&home))?;
        let _lock = lock(&home.join(LOCK))?;
        remove_leftovers(&home)?;

        let staged = tempfile::Builder::new().prefix(STAGED).tempdir_in(&home).map_err(LibraryError::file(&home))?;
        fill(staged.path())?;
        for e in evidence {
            let path = staged.path().join("evidence").join(&e.name);
            // A name with a slash could lead out of the folder.
            if !is_name(&e.name.replace('.', "_")) {
                return Err(LibraryError::Name { name: e.name.clone(), message: "cannot be the name of a piece of evidence".into() });
            }
            std::fs::create_dir_all(staged.path().join("evidence")).map_err(LibraryError::file(&path))?;
            std::fs::write(&path, &e.bytes).map_err(LibraryError::file(&path))?;
        }
        let model = ObjectModel::read(staged.path())?;
        let findings = check::model(name, &model, staged.path())?;
        if let Some(wrong) = findings.iter().find(|f| f.severity == Severity::Error) {
            return Err(LibraryError::Unsound { name: name.to_owned(), message: format!("{}: {}", wrong.place, wrong.message) });
        }
        let version = Version::of_folder(staged.path())?;
        make_durable(staged.path())?;
        after(Step::Copied)?;

        let target = home.join(version.as_str());
        if target.exists() {
            let found = Version::of_folder(&target)?;
            if found != version {
                return Err(LibraryError::Corrupt { path: target, found });
            }
        } else {
            readable_by_all(staged.path())?;
            std::fs::rename(staged.path(), &target).map_err(LibraryError::file(&target))?;
            sync(&home)?;
        }
        after(Step::Named)?;

        let mut head = tempfile::Builder::new().prefix(STAGED).tempfile_in(&home).map_err(LibraryError::file(&home))?;
        let path = home.join(HEAD);
        writeln!(head, "{version}").and_then(|()| head.as_file().sync_all()).map_err(LibraryError::file(&path))?;
        after(Step::HeadWritten)?;
        readable_by_all(head.path())?;
        head.persist(&path).map_err(|e| LibraryError::File { path: path.clone(), source: e.error })?;
        sync(&home)?;
        Ok(version)
    }
}

/// Waits its turn. The lock goes when the file is closed, also when the program dies.
fn lock(path: &Path) -> Result<File, LibraryError> {
    let file = File::options().create(true).append(true).open(path).map_err(LibraryError::file(path))?;
    let start = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(TryLockError::WouldBlock) if start.elapsed() < PATIENCE => std::thread::sleep(Duration::from_millis(20)),
            Err(TryLockError::WouldBlock) => return Err(LibraryError::Busy { path: path.to_owned(), seconds: PATIENCE.as_secs() }),
            Err(TryLockError::Error(source)) => return Err(LibraryError::File { path: path.to_owned(), source }),
        }
    }
}

/// Removes what a writer that died has left; the lock is held, so nobody is at work on it.
fn remove_leftovers(home: &Path) -> Result<(), LibraryError> {
    for entry in std::fs::read_dir(home).map_err(LibraryError::file(home))?.filter_map(Result::ok) {
        if entry.file_name().to_string_lossy().starts_with(STAGED) {
            let path = entry.path();
            let removed = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
            removed.map_err(LibraryError::file(&path))?;
        }
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<(), LibraryError> {
    for name in files(from)? {
        let target = to.join(&name);
        if let Some(parent) = target.parent() {
            std::fs::create_dir_all(parent).map_err(LibraryError::file(parent))?;
        }
        // Not fs::copy: the source's permissions are nobody's business here.
        let bytes = std::fs::read(from.join(&name)).map_err(LibraryError::file(&from.join(&name)))?;
        std::fs::write(&target, bytes).map_err(LibraryError::file(&target))?;
    }
    Ok(())
}

/// Waits until the disk has every file and folder.
fn make_durable(folder: &Path) -> Result<(), LibraryError> {
    let names = files(folder)?;
    let mut folders: Vec<&Path> = names.iter().filter_map(|n| Path::new(n).parent()).collect();
    folders.sort();
    folders.dedup();
    for name in &names {
        sync(&folder.join(name))?;
    }
    // The deepest first: an entry is durable when the folder that holds it is.
    for f in folders.iter().rev() {
        sync(&folder.join(f))?;
    }
    sync(folder)
}

fn sync(path: &Path) -> Result<(), LibraryError> {
    // Windows cannot open a folder as a file; there a rename is durable without it.
    if cfg!(windows) && path.is_dir() {
        return Ok(());
    }
    File::open(path).and_then(|f| f.sync_all()).map_err(LibraryError::file(path))
}

/// Temporary files and folders are made for their owner alone; what is published is for all who may read the library.
fn readable_by_all(path: &Path) -> Result<(), LibraryError> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = if path.is_dir() { 0o755 } else { 0o644 };
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).map_err(LibraryError::file(path))?;
    }
    #[cfg(not(unix))]
    let _ = path;
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]

    use super::*;

    fn folder(text: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let urdf = "<robot name=\"brick\"><link name=\"brick\"><inertial><mass value=\"1\"/>\
            <inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial></link></robot>";
        std::fs::write(folder.path().join("object.urdf"), urdf).unwrap();
        let document = format!(
            "schema: 1\nname: brick\ndescription: {text}\nprovenance: {{licence: MIT, attribution: us, origins: [{{source: here}}]}}\n"
        );
        std::fs::write(folder.path().join("model.yaml"), document).unwrap();
        folder
    }

    /// A writer that dies at any step leaves HEAD on a whole version, and the next writer clears up after it.
    #[test]
    fn a_crash_between_steps_keeps_the_old_head() {
        for step in [Step::Copied, Step::Named, Step::HeadWritten] {
            let root = tempfile::tempdir().unwrap();
            let library = Library::open(root.path()).unwrap();
            let old = library.publish("brick", folder("old").path(), &[]).unwrap();
            let new = folder("new");
            let crash = |s| if s == step { Err(LibraryError::Head { path: "crash".into(), message: String::new() }) } else { Ok(()) };
            // A process that is killed runs no destructors: what the writer had made stays where it was.
            let left = root.path().join("brick").join(format!("{STAGED}left"));
            std::fs::create_dir(&left).unwrap();
            library.publish_by_steps("brick", &|to| copy(new.path(), to), &[], &crash).unwrap_err();

            assert_eq!(library.head("brick").unwrap(), old, "after {step:?}");
            assert_eq!(library.get("brick").unwrap().model.document.description, "old");
            let version = library.publish("brick", new.path(), &[]).unwrap();
            assert_eq!(library.get("brick").unwrap().version, version);
            assert!(!left.exists());
            assert_eq!(library.versions("brick").unwrap().len(), 2);
        }
    }

    /// Two writers at once: both versions are there, HEAD is one of them, and nothing is left over.
    #[test]
    fn two_writers_take_turns() {
        let root = tempfile::tempdir().unwrap();
        let library = Library::open(root.path()).unwrap();
        let folders: Vec<_> = (0..8).map(|i| folder(&format!("number {i}"))).collect();
        let versions: Vec<Version> = std::thread::scope(|scope| {
            let threads: Vec<_> = folders.iter().map(|f| scope.spawn(|| library.publish("brick", f.path(), &[]).unwrap())).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert_eq!(library.versions("brick").unwrap().len(), 8);
        assert!(versions.contains(&library.head("brick").unwrap()));
        for version in &versions {
            library.get_version("brick", version.as_str()).unwrap();
        }
        let left = std::fs::read_dir(root.path().join("brick"))
            .unwrap()
            .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().starts_with(STAGED));
        assert_eq!(left.count(), 0);
    }
}
