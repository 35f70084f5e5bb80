use std::path::PathBuf;

/// Why recordings could not be read. Every message says where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// No file was named.
    #[error("no recording was given; name at least one MCAP or CSV file")]
    Nothing,
    /// The file could not be opened or read.
    #[error("{}: the recording cannot be read: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// It is no file, too large, empty, or of a kind that is not read.
    #[error("{}: {message}", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// What it is, and what to do about it.
        message: String,
    },
    /// A line of a CSV file is wrong.
    #[error("{}:{line}: {message}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// The bytes of an MCAP file are wrong.
    #[error("{}: at byte {offset}: {message}", path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// Start of the record or chunk that is wrong, counted from 0.
        offset: u64,
        /// What is wrong.
        message: String,
    },
    /// An MCAP file has no messages that can be used.
    #[error("{}: {message}", path.display())]
    Topics {
        /// The file.
        path: PathBuf,
        /// What it has, and what to do about it.
        message: String,
    },
    /// The clock jumps back: two recordings in one file.
    #[error("{}: {place}: {message}", path.display())]
    Clock {
        /// The file.
        path: PathBuf,
        /// Line, or topic and message.
        place: String,
        /// By how much, and what to do about it.
        message: String,
    },
    /// The names of joints are not those of the model.
    #[error("{}: {message}", path.display())]
    Joints {
        /// The file.
        path: PathBuf,
        /// Which, and what was probably meant.
        message: String,
    },
    /// Numbers that can hardly be in the unit that they should be in: whoever asked is asked back.
    #[error("{}: {joint}: {message}", path.display())]
    Units {
        /// The file.
        path: PathBuf,
        /// The joint.
        joint: String,
        /// What they look like, and how to say what they are.
        message: String,
    },
    /// No joint moves: nothing can be found.
    #[error("{place}: {message}")]
    Still {
        /// The files.
        place: String,
        /// What to measure instead.
        message: String,
    },
}
