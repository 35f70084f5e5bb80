//! Finding and reading what is stored.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sagci_model::{ObjectModel, did_you_mean};

use crate::{LibraryError, Version};

pub(crate) const HEAD: &str = "HEAD";

/// A folder of object models.
#[derive(Debug, Clone)]
pub struct Library {
    root: PathBuf,
}

/// A model as it was stored.
#[derive(Debug, Clone)]
pub struct Stored {
    /// Which version it is.
    pub version: Version,
    /// The model.
    pub model: Arc<ObjectModel>,
}

impl Library {
    /// Opens a library.
    ///
    /// Errors: the folder does not exist.
    pub fn open(root: impl Into<PathBuf>) -> Result<Self, LibraryError> {
        let root = root.into();
        if root.is_dir() { Ok(Self { root }) } else { Err(LibraryError::NotALibrary { path: root }) }
    }

    /// The library's folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The names of all objects, sorted: the folders that have a HEAD.
    ///
    /// Errors: the library's folder cannot be read.
    pub fn names(&self) -> Result<Vec<String>, LibraryError> {
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&self.root).map_err(LibraryError::file(&self.root))? {
            let entry = entry.map_err(LibraryError::file(&self.root))?;
            if let Ok(name) = entry.file_name().into_string()
                && is_name(&name)
                && entry.path().join(HEAD).is_file()
            {
                names.push(name);
            }
        }
        names.sort();
        Ok(names)
    }

    /// The folder of an object that exists.
    ///
    /// Errors: there is no such object; the message says what was probably meant.
    pub fn home(&self, name: &str) -> Result<PathBuf, LibraryError> {
        let home = self.root.join(name);
        if is_name(name) && home.join(HEAD).is_file() {
            return Ok(home);
        }
        let names = self.names()?;
        let hint = did_you_mean(name, names.iter().map(String::as_str));
        Err(LibraryError::UnknownObject { name: name.to_owned(), library: self.root.clone(), hint })
    }

    /// The current version of an object.
    ///
    /// Errors: there is no such object, or its HEAD names no version.
    pub fn head(&self, name: &str) -> Result<Version, LibraryError> {
        let path = self.home(name)?.join(HEAD);
        let text = std::fs::read_to_string(&path).map_err(LibraryError::file(&path))?;
        Version::parse(text.trim_end()).ok_or_else(|| LibraryError::Head {
            message: format!(
                "'{}' is not the name of a version; write one of this folder's",
                text.trim_end().chars().take(40).collect::<String>()
            ),
            path,
        })
    }

    /// All versions of an object, sorted by name.
    ///
    /// Errors: there is no such object.
    pub fn versions(&self, name: &str) -> Result<Vec<Version>, LibraryError> {
        let home = self.home(name)?;
        let entries = std::fs::read_dir(&home).map_err(LibraryError::file(&home))?;
        let is_folder = |e: &std::fs::DirEntry| e.file_type().is_ok_and(|t| t.is_dir());
        let folders = entries.filter_map(Result::ok).filter(is_folder);
        let mut versions: Vec<Version> = folders.filter_map(|e| Version::parse(e.file_name().to_str()?)).collect();
        versions.sort();
        Ok(versions)
    }

    /// The current version of an object's model.
    ///
    /// Errors: as [`Self::get_version`].
    pub fn get(&self, name: &str) -> Result<Stored, LibraryError> {
        let version = self.head(name)?;
        if !self.home(name)?.join(version.as_str()).is_dir() {
            let path = self.home(name)?.join(HEAD);
            let hint = did_you_mean(version.as_str(), self.versions(name)?.iter().map(Version::as_str));
            return Err(LibraryError::Head { path, message: format!("names the version {version}, which is not there{hint}") });
        }
        self.get_version(name, version.as_str())
    }

    /// A version of an object's model. Its bytes are held against its name before they are believed.
    ///
    /// Errors: there is no such object or version; its bytes were changed; the model cannot be read.
    pub fn get_version(&self, name: &str, version: &str) -> Result<Stored, LibraryError> {
        let (folder, version) = self.version_folder(name, version)?;
        let found = Version::of_folder(&folder)?;
        // What cannot be read is told first: it names the file and the line, where a hash only says that something changed.
        let model = ObjectModel::read(&folder)?;
        if found != version {
            return Err(LibraryError::Corrupt { path: folder, found });
        }
        Ok(Stored { version, model: Arc::new(model) })
    }

    /// The folder of a version that exists.
    pub(crate) fn version_folder(&self, name: &str, version: &str) -> Result<(PathBuf, Version), LibraryError> {
        let home = self.home(name)?;
        match Version::parse(version).filter(|v| home.join(v.as_str()).is_dir()) {
            Some(version) => Ok((home.join(version.as_str()), version)),
            None => {
                let hint = did_you_mean(version, self.versions(name)?.iter().map(Version::as_str));
                Err(LibraryError::UnknownVersion { name: name.to_owned(), version: version.to_owned(), hint })
            }
        }
    }
}

/// Can it be an object's name? It becomes a folder's name and a word in scripts.
pub(crate) fn is_name(name: &str) -> bool {
    let inside = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'-');
    name.len() <= 64 && name.bytes().next().is_some_and(|b| b.is_ascii_alphanumeric()) && name.bytes().all(inside)
}
