use std::path::PathBuf;

/// Why a recording could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file could not be opened, read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file could not be written as MCAP.
    #[error("{}: cannot be written: {message}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What happened.
        message: String,
    },
    /// The bytes are not those of a recording.
    #[error("{}: at byte {offset}: {message}", path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// Where in the file, counted from 0; the start of the record or chunk that is wrong.
        offset: u64,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// A channel holds something else than it should.
    #[error("{}: at byte {offset}: channel '{channel}' holds '{found}' instead of '{expected}'; it was not written by this program or by a newer version of it", path.display())]
    Schema {
        /// The file.
        path: PathBuf,
        /// Where in the file the channel is declared; the start of the record or chunk.
        offset: u64,
        /// The channel.
        channel: String,
        /// The schema and encodings that it should have.
        expected: String,
        /// Those it has.
        found: String,
    },
}
