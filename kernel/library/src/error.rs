use std::path::PathBuf;

use sagci_model::ModelError;

use crate::Version;

/// Why the library could not give or take a model. Every message says where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// There is no library in this folder.
    #[error("{}: is not a folder with object models; name one with '--library'", path.display())]
    NotALibrary {
        /// The folder.
        path: PathBuf,
    },
    /// There is no object of this name.
    #[error("there is no object '{name}' in {}{hint}", library.display())]
    UnknownObject {
        /// The name that was asked for.
        name: String,
        /// The library's folder.
        library: PathBuf,
        /// What was probably meant, or what there is.
        hint: String,
    },
    /// The object has no version of this name.
    #[error("object '{name}' has no version '{version}'{hint}")]
    UnknownVersion {
        /// The object.
        name: String,
        /// The version that was asked for.
        version: String,
        /// What was probably meant, or what there is.
        hint: String,
    },
    /// A name of an object or of a file cannot be used.
    #[error("'{name}': {message}")]
    Name {
        /// The name.
        name: String,
        /// What is wrong with it, and what can be used.
        message: String,
    },
    /// HEAD does not name a version.
    #[error("{}: {message}", path.display())]
    Head {
        /// The HEAD file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// A published version is not what it was when it was published.
    #[error("{}: was changed after it was published: its bytes hash to {found}; restore it, or publish the change as a new version", path.display())]
    Corrupt {
        /// The version's folder.
        path: PathBuf,
        /// What its bytes hash to now.
        found: Version,
    },
    /// What was to be published is not a sound model.
    #[error("'{name}' is not published: {message}")]
    Unsound {
        /// The object.
        name: String,
        /// The first thing that is wrong.
        message: String,
    },
    /// Another writer has been at work for too long.
    #[error("{}: another program has been writing this object for {seconds} s; try again when it has ended", path.display())]
    Busy {
        /// The lock file.
        path: PathBuf,
        /// How long was waited.
        seconds: u64,
    },
    /// The model's own files are wrong.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
}

impl LibraryError {
    pub(crate) fn file(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::File { path, source }
    }
}
