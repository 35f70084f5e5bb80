//! Where answers are written: never over what was given, and whether that can be done is known before the work.

use std::fs::OpenOptions;
use std::io;
use std::path::{Path, PathBuf};

use crate::error::CliError;

/// Refuses to write over a file that is read.
pub fn spare<'a>(written: &[PathBuf], read: impl IntoIterator<Item = &'a Path>) -> Result<(), CliError> {
    for input in read {
        if let Some(path) = written.iter().find(|path| is_same(path, input)) {
            let as_well = if path.as_path() == input { String::new() } else { format!(" (as {})", input.display()) };
            let message = format!("{}: is read{as_well} and would be written over by --out; give --out another name", path.display());
            return Err(CliError::Other(message));
        }
    }
    Ok(())
}

/// Files that recordings are read from; a folder stands for those in it.
pub fn recordings(paths: &[PathBuf]) -> Vec<PathBuf> {
    let inside = |folder: &Path| -> Vec<PathBuf> {
        std::fs::read_dir(folder).map(|entries| entries.filter_map(|e| Some(e.ok()?.path())).collect()).unwrap_or_default()
    };
    paths.iter().flat_map(|path| if path.is_dir() { inside(path) } else { vec![path.clone()] }).collect()
}

/// Is it one file, whatever it is called?
fn is_same(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    if let (Ok(a), Ok(b)) = (a.metadata(), b.metadata()) {
        use std::os::unix::fs::MetadataExt;
        return (a.dev(), a.ino()) == (b.dev(), b.ino());
    }
    a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
}

/// A folder that can be written to. What was made of it goes again if nothing comes into it.
#[derive(Debug)]
pub struct Room {
    /// Innermost first.
    made: Vec<PathBuf>,
}

impl Drop for Room {
    fn drop(&mut self) {
        // One that holds something stays.
        self.made.iter().for_each(|folder| drop(std::fs::remove_dir(folder)));
    }
}

/// Makes a folder, and tries whether files of these names can be written in it.
pub fn folder(folder: &Path, names: &[&str]) -> Result<Room, CliError> {
    let is_missing = |path: &&Path| !path.as_os_str().is_empty() && !path.exists();
    let room = Room { made: folder.ancestors().take_while(is_missing).map(Path::to_owned).collect() };
    let failed = |e: &io::Error, path: &Path| {
        CliError::Other(format!("{}: cannot be written: {e}; give --out a folder that can be", path.display()))
    };
    std::fs::create_dir_all(folder).map_err(|e| failed(&e, folder))?;
    for path in names.iter().map(|name| folder.join(name)) {
        attempt(&path).map_err(|e| failed(&e, &path))?;
    }
    Ok(room)
}

/// Tries whether a file can be written.
pub fn file(path: &Path) -> Result<(), CliError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(CliError::Other(format!(
            "{}: there is no folder {}; make it first, or give --out another name",
            path.display(),
            folder.display()
        )));
    }
    attempt(path)
        .map_err(|e| CliError::Other(format!("{}: cannot be written: {e}; give --out the name of a file that can be", path.display())))
}

fn attempt(path: &Path) -> io::Result<()> {
    match path.metadata() {
        Ok(there) if there.is_dir() => Err(io::Error::other("it is a folder")),
        Ok(there) if there.is_file() => OpenOptions::new().write(true).open(path).map(drop),
        // A pipe would end for its reader.
        Ok(_) => Ok(()),
        Err(_) if path.is_symlink() => Ok(()),
        Err(_) => {
            OpenOptions::new().write(true).create_new(true).open(path)?;
            std::fs::remove_file(path)
        }
    }
}
