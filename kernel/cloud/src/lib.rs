//! Point clouds on disk: PLY (text, and binary of both byte orders) and PCD (text, binary, LZF-compressed).
//!
//! Only places are read; colours, normals and whatever else a file holds are stepped over by their declared sizes. A header is
//! a claim: nothing is reserved and nothing is read on its word alone, so that a file that lies about its length is an error
//! with both numbers, and never a panic or a gigabyte of memory. Points keep the file's order and number: what is not finite
//! stays in its place.
#![forbid(unsafe_code)]

mod ascii;
mod lzf;
mod pcd;
mod ply;
mod record;

use std::path::{Path, PathBuf};

use nalgebra::Point3;

pub use ply::write_parts;

/// Greatest number of points that are read.
pub const POINTS: usize = 50_000_000;
/// Greatest size of a file, bytes.
const BYTES: u64 = 4 << 30;

/// Why a cloud could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file is not what it says it is.
    #[error("{}{}: {message}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Malformed {
        /// Which.
        path: PathBuf,
        /// The line, where it is a text.
        line: Option<usize>,
        /// What is wrong, and what to do.
        message: String,
    },
}

/// What is wrong in a file's bytes.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) line: Option<usize>,
    pub(crate) message: String,
}

impl Fault {
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { line: None, message: message.into() }
    }

    /// A header that keeps points back.
    pub(crate) fn more(said: usize, left: &str) -> Self {
        Self::new(format!("contradicts itself: its header says {said} points, but {left} more follow; mend the count"))
    }

    pub(crate) fn at(line: usize, message: impl Into<String>) -> Self {
        Self { line: Some(line), message: message.into() }
    }
}

/// Reads the points of a PLY or PCD, told apart by their first bytes. Lengths are as the file has them; points that are not
/// finite are kept.
///
/// Errors: a file that is missing, larger than 4 GiB, neither PLY nor PCD, cut off, or at odds with its own header.
pub fn read(path: &Path) -> Result<Vec<Point3<f64>>, CloudError> {
    let file = |source| CloudError::File { path: path.to_owned(), source };
    let size = std::fs::metadata(path).map_err(file)?.len();
    let malformed = |f: Fault| CloudError::Malformed { path: path.to_owned(), line: f.line, message: f.message };
    if size > BYTES {
        return Err(malformed(Fault::new(format!("has {size} bytes; at most {BYTES} are read; thin the cloud"))));
    }
    parse(&std::fs::read(path).map_err(file)?).map_err(malformed)
}

pub(crate) fn parse(bytes: &[u8]) -> Result<Vec<Point3<f64>>, Fault> {
    if bytes.starts_with(b"ply") {
        return ply::parse(bytes);
    }
    let head = String::from_utf8_lossy(bytes.get(..bytes.len().min(2048)).unwrap_or_default());
    if head.lines().map(str::trim).any(|l| l.starts_with("VERSION") || l.starts_with("FIELDS") || l.starts_with("# .PCD")) {
        return pcd::parse(bytes);
    }
    if bytes.is_empty() {
        return Err(Fault::new("is empty; give a PLY or PCD point cloud"));
    }
    Err(Fault::new("is neither a PLY (which begins with 'ply') nor a PCD (with '# .PCD' or 'VERSION')"))
}

#[cfg(test)]
mod tests;
