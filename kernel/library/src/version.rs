//! The name of a version: the first twelve hexadecimal digits of a SHA-256 over the list of its files. The list has one
//! line a file, `<SHA-256 of its bytes>  <path>\n`, with `/` between folders, sorted by the bytes of the path. A person
//! gets the same name without this program, inside the version's folder, by
//!
//! ```text
//! find . -type f -printf '%P\n' | LC_ALL=C sort | xargs sha256sum | sha256sum | cut -c1-12
//! ```
//!
//! Twelve digits (48 bits) tell the versions of one object apart with room to spare; they guard against accidents, not
//! against someone who means to forge one.

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::LibraryError;

const DIGITS: usize = 12;
/// Greatest number of files in a version.
const FILES: usize = 10_000;

/// The name of a version: twelve hexadecimal digits that follow from its bytes.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Version(String);

impl Version {
    /// A version's name from its text, if it can be one.
    pub fn parse(text: &str) -> Option<Self> {
        let hex = |b: u8| matches!(b, b'0'..=b'9' | b'a'..=b'f');
        (text.len() == DIGITS && text.bytes().all(hex)).then(|| Self(text.to_owned()))
    }

    /// The name that a folder's bytes give it.
    ///
    /// Errors: a file that cannot be read, a link or other special file, a file name with other signs than letters,
    /// digits, `.`, `_` and `-`.
    pub fn of_folder(folder: &Path) -> Result<Self, LibraryError> {
        let mut list = Vec::new();
        for name in files(folder)? {
            let path = folder.join(&name);
            let bytes = std::fs::read(&path).map_err(LibraryError::file(&path))?;
            list.extend_from_slice(hex(&Sha256::digest(&bytes)).as_bytes());
            list.extend_from_slice(format!("  {name}\n").as_bytes());
        }
        let mut digest = hex(&Sha256::digest(&list));
        digest.truncate(DIGITS);
        Ok(Self(digest))
    }

    /// The digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for Version {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        Self::parse(&text).ok_or_else(|| format!("'{text}' is not a version; it has {DIGITS} hexadecimal digits"))
    }
}

impl From<Version> for String {
    fn from(version: Version) -> Self {
        version.0
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// All files under a folder, as paths with `/` in between, sorted by their bytes.
pub(crate) fn files(folder: &Path) -> Result<Vec<String>, LibraryError> {
    let mut found = Vec::new();
    let mut folders = vec![String::new()];
    while let Some(prefix) = folders.pop() {
        let here = folder.join(&prefix);
        for entry in std::fs::read_dir(&here).map_err(LibraryError::file(&here))? {
            let entry = entry.map_err(LibraryError::file(&here))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            if !name.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-')) {
                let message = format!("stands in {}; file names have letters, digits, '.', '_' and '-' only", here.display());
                return Err(LibraryError::Name { name, message });
            }
            let path = format!("{prefix}{name}");
            let kind = entry.file_type().map_err(LibraryError::file(&entry.path()))?;
            if kind.is_dir() {
                folders.push(path + "/");
            } else if kind.is_file() {
                found.push(path);
            } else {
                let message = format!("in {} is a link or a special file; a version holds plain files only", here.display());
                return Err(LibraryError::Name { name, message });
            }
            if found.len() + folders.len() > FILES {
                let message = format!("holds more than {FILES} files");
                return Err(LibraryError::Name { name: folder.display().to_string(), message });
            }
        }
    }
    found.sort_by(|a, b| a.as_bytes().cmp(b.as_bytes()));
    Ok(found)
}
