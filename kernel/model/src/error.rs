use std::path::PathBuf;

/// Why an object model could not be read, written or believed. Every message says where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A file of the model could not be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file was read, but its text is not what it should be.
    #[error("{}{}: {message}", path.display(), at(*line))]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line in the file, counted from 1, where it is known.
        line: Option<usize>,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// The files are well formed, but what they say cannot be: a negative mass, a loop of links, an unknown joint.
    #[error("{}{}: {place}: {message}", path.display(), at(*line))]
    Impossible {
        /// The file.
        path: PathBuf,
        /// Line in the file, counted from 1, where it is known.
        line: Option<usize>,
        /// The link, joint, effect or grasp that is wrong.
        place: String,
        /// What is wrong, and what to do about it.
        message: String,
    },
}

fn at(line: Option<usize>) -> String {
    line.map(|l| format!(":{l}")).unwrap_or_default()
}

impl ModelError {
    /// The file that the error is about.
    pub fn path(&self) -> &std::path::Path {
        match self {
            Self::File { path, .. } | Self::Malformed { path, .. } | Self::Impossible { path, .. } => path,
        }
    }

    /// The line in that file, counted from 1, where it is known.
    pub fn line(&self) -> Option<usize> {
        match self {
            Self::File { .. } => None,
            Self::Malformed { line, .. } | Self::Impossible { line, .. } => *line,
        }
    }
}
