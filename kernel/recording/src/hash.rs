//! Hashes of series that were never in a file.

use std::fmt::Write as _;

use sha2::{Digest, Sha256};

use crate::Log;

impl Log {
    /// Sets the hash to that of the file that [`Log::to_csv`] makes: series that were never in a file have one like those that were.
    #[must_use]
    pub fn hashed(mut self) -> Self {
        self.hash = Sha256::digest(self.to_csv().as_bytes()).iter().fold(String::with_capacity(64), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        });
        self
    }
}
