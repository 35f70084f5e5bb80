use std::path::PathBuf;

use sagci_script::Diagnostic;

/// The tool or its input was wrong: what, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// A script or a file beside it.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\nerror: "))]
    Script(Vec<Diagnostic>),
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// Anything else, said in full.
    #[error("{0}")]
    Other(String),
}
