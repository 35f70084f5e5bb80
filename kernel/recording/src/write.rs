//! The other way round: series into a file that [`crate::read`] reads.

use std::fmt::Write as _;

use sha2::{Digest, Sha256};

use crate::{CommandKind, Log, Series};

/// The joints of a recording as CSV: a row for each time at which something was measured, with empty cells for what was not. Values are
/// written so that reading them gives the same bits; times are read to the nanosecond. Forces at links have no place in such a file and are left out.
pub fn to_csv(log: &Log) -> String {
    let mut columns: Vec<(String, &Series)> = Vec::new();
    for joint in &log.joints {
        let name = &joint.name;
        columns.push((format!("{name}.position"), &joint.position));
        columns.extend(joint.velocity.iter().map(|s| (format!("{name}.velocity"), s)));
        columns.extend(joint.effort.iter().map(|s| (format!("{name}.effort"), s)));
        columns.extend(joint.command.iter().map(|(kind, s)| {
            let kind = match kind {
                CommandKind::Effort => "effort",
                CommandKind::Position => "position",
                CommandKind::Voltage => "voltage",
            };
            (format!("{name}.command_{kind}"), s)
        }));
    }
    let mut times: Vec<f64> = columns.iter().flat_map(|(_, s)| s.time.iter().copied()).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut text = String::from("time");
    columns.iter().for_each(|(name, _)| text.extend([",", name]));
    text.push('\n');
    let mut next = vec![0; columns.len()];
    for time in times {
        // Writing to a text cannot fail.
        let _ = write!(text, "{time}");
        for ((_, series), next) in columns.iter().zip(&mut next) {
            text.push(',');
            if series.time.get(*next) == Some(&time) {
                let _ = write!(text, "{}", series.value[*next]);
                *next += 1;
            }
        }
        text.push('\n');
    }
    text
}

impl Log {
    /// Sets the hash to that of the file that [`to_csv`] makes: series that were never in a file have one like those that were.
    #[must_use]
    pub fn hashed(mut self) -> Self {
        self.hash = Sha256::digest(to_csv(&self).as_bytes()).iter().fold(String::with_capacity(64), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        });
        self
    }
}
