//! The door: files in, series out.

use std::fmt::Write as _;
use std::io::Read;
use std::path::{Path, PathBuf};

use sagci_model::ObjectModel;
use sha2::{Digest, Sha256};

use crate::raw::Raw;
use crate::{Log, Note, RecordingError, check, csv, robot};

/// No file is larger than this, bytes.
pub const LARGEST_FILE: u64 = 1 << 30;
/// Times that begin later than this, s, count from long ago; whole seconds are taken off them.
const LATE: i64 = 1_000_000;
/// A recording that begins at most so long after the end of the one before it runs on from it, s.
const PAUSE: f64 = 600.0;

/// What angles are measured in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Angles {
    /// Radians; numbers that look like degrees are asked back about.
    #[default]
    Ask,
    /// Radians, whatever they look like.
    Radians,
    /// Degrees: positions, velocities and commanded positions of turning joints are converted.
    Degrees,
}

/// What lengths are measured in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Lengths {
    /// Metres; numbers that look like millimetres are asked back about.
    #[default]
    Ask,
    /// Metres, whatever they look like.
    Metres,
    /// Millimetres: positions, velocities and commanded positions of sliding joints are converted.
    Millimetres,
}

/// How to read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Options {
    /// What angles are measured in. A line `# angles: deg` or `# angles: rad` in a CSV file says it for that file.
    pub angles: Angles,
    /// What lengths are measured in. A line `# lengths: mm` or `# lengths: m` in a CSV file says it for that file.
    pub lengths: Lengths,
}

/// Reads recordings, one [`Log`] a file; a folder stands for the MCAP files in it, in the order of the numbers in their names, as
/// rosbag2 splits them. What a file is, its content says and not its name. No file is changed.
///
/// With a model, names and numbers are held against it. What is set right or doubted stands in [`Log::notes`]. A file whose bytes were read
/// already is left out, and that is said: what counts twice says no more.
///
/// Errors: files that are missing, empty, larger than [`LARGEST_FILE`], of another kind or broken; times that cannot be put in order; no
/// joint of the model; numbers that look like degrees or millimetres; nothing that moves in any of the files.
pub fn read(paths: &[PathBuf], model: Option<&ObjectModel>) -> Result<Vec<Log>, RecordingError> {
    read_with(paths, model, &Options::default())
}

/// As [`read`], and says what the numbers are.
pub fn read_with(paths: &[PathBuf], model: Option<&ObjectModel>, options: &Options) -> Result<Vec<Log>, RecordingError> {
    let mut raws: Vec<(PathBuf, Raw, String)> = Vec::new();
    for path in files(paths)? {
        let bytes = load(&path)?;
        let raw = parse(&path, &bytes, model)?;
        let hash = Sha256::digest(&bytes).iter().fold(String::with_capacity(64), |mut text, byte| {
            // Writing to a text cannot fail.
            let _ = write!(text, "{byte:02x}");
            text
        });
        if let Some((first, raw, _)) = raws.iter_mut().find(|(.., other)| *other == hash) {
            let is_one = first.canonicalize().ok().zip(path.canonicalize().ok()).is_some_and(|(a, b)| a == b);
            let message = match is_one {
                true => "is given more than once; it counts once".to_owned(),
                false => format!("holds the same bytes as {}; it was left out", first.display()),
            };
            raw.notes.push(Note { place: path.display().to_string(), message });
            continue;
        }
        raws.push((path, raw, hash));
    }
    let first = raws.iter().filter_map(|r| r.1.first()).min().unwrap_or(0).div_euclid(1_000_000_000);
    let epoch = if first > LATE { first } else { 0 };
    let mut logs: Vec<Log> = Vec::with_capacity(raws.len());
    for (path, raw, hash) in raws {
        let (degrees, millimetres, is_chosen) = (raw.degrees, raw.millimetres, raw.is_chosen);
        let mut log = raw.settle(&path, epoch)?;
        (log.hash, log.is_table) = (hash, is_chosen);
        let angles = match degrees {
            Some(true) => Angles::Degrees,
            Some(false) => Angles::Radians,
            None => options.angles,
        };
        let lengths = match millimetres {
            Some(true) => Lengths::Millimetres,
            Some(false) => Lengths::Metres,
            None => options.lengths,
        };
        check::check(&path, &mut log, model, Options { angles, lengths }, is_chosen)?;
        log.continues = logs.last().is_some_and(|before| runs_on(before, &log));
        logs.push(log);
    }
    check::moves(&mut logs, model)?;
    Ok(logs)
}

/// The files that the paths stand for.
fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, RecordingError> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).map_err(|source| RecordingError::File { path: path.clone(), source })?;
        let is_recording = |p: &PathBuf| p.is_file() && p.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
        let mut inside: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).filter(is_recording).collect();
        if inside.is_empty() {
            let message = "is a folder without MCAP files; name the files".to_owned();
            return Err(RecordingError::Kind { path: path.clone(), message });
        }
        inside.sort_by_key(|p| natural(&p.to_string_lossy()));
        files.extend(inside);
    }
    if files.is_empty() { Err(RecordingError::Nothing) } else { Ok(files) }
}

/// A name cut into texts and numbers, so that `bag_10` comes after `bag_9`.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = vec![(String::new(), 0u64)];
    let mut is_number = false;
    for letter in name.chars() {
        match (letter.to_digit(10), parts.last_mut()) {
            (Some(digit), Some(last)) => {
                last.1 = last.1.saturating_mul(10).saturating_add(u64::from(digit));
                is_number = true;
            }
            (None, Some(last)) if !is_number => last.0.push(letter),
            _ => {
                parts.push((letter.to_string(), 0));
                is_number = false;
            }
        }
    }
    parts
}

fn load(path: &Path) -> Result<Vec<u8>, RecordingError> {
    let file_error = |source| RecordingError::File { path: path.to_owned(), source };
    let kind = |message: String| RecordingError::Kind { path: path.to_owned(), message };
    // A pipe or a device would make the reader wait for ever: only regular files are opened.
    let metadata = std::fs::metadata(path).map_err(file_error)?;
    if !metadata.is_file() {
        return Err(kind("is not a regular file".into()));
    }
    let too_large = || {
        kind(format!(
            "is larger than the {} MiB that are read; leave images out ('mcap filter --include-topic-regex joint') or split it",
            LARGEST_FILE >> 20
        ))
    };
    if metadata.len() > LARGEST_FILE {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    std::fs::File::open(path).map_err(file_error)?.take(LARGEST_FILE + 1).read_to_end(&mut bytes).map_err(file_error)?;
    if bytes.len() as u64 > LARGEST_FILE { Err(too_large()) } else { Ok(bytes) }
}

/// Reads a file as what its first bytes say it is.
fn parse(path: &Path, bytes: &[u8], model: Option<&ObjectModel>) -> Result<Raw, RecordingError> {
    let kind = |message: &str| Err(RecordingError::Kind { path: path.to_owned(), message: message.to_owned() });
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if bytes.is_empty() {
        return kind("is empty");
    }
    if starts(mcap::MAGIC) || (bytes.len() < mcap::MAGIC.len() && mcap::MAGIC.starts_with(bytes)) {
        return robot::read(path, bytes, model);
    }
    if starts(b"SQLite format 3\0") {
        return kind("is a rosbag2 file in SQLite; 'ros2 bag convert' to storage_id 'mcap' makes one that is read");
    }
    if starts(b"#ROSBAG") {
        return kind("is a bag of ROS 1; 'rosbags-convert' and then 'ros2 bag convert' to storage_id 'mcap' make a file that is read");
    }
    if starts(&[0x28, 0xB5, 0x2F, 0xFD]) {
        return kind("is a file packed with zstd; unpack it with 'zstd -d' (chunks that are packed within an MCAP file are read)");
    }
    if starts(&[0x1F, 0x8B]) || starts(b"PK\x03\x04") {
        return kind("is an archive; unpack it first");
    }
    if starts(&[0xFF, 0xFE]) || starts(&[0xFE, 0xFF]) {
        return kind("is text in UTF-16; save it as UTF-8");
    }
    if bytes.iter().take(4096).any(|b| *b == 0) {
        return kind("is neither an MCAP file (its first bytes are others) nor text; recordings are MCAP or CSV");
    }
    csv::read(path, bytes)
}

/// Does a recording begin where the one before it ends?
fn runs_on(before: &Log, after: &Log) -> bool {
    let times = |log: &Log| {
        let series = |j: &crate::JointLog| {
            let all = [Some(&j.position), j.velocity.as_ref(), j.effort.as_ref(), j.command.as_ref().map(|c| &c.1)];
            let ends = all.into_iter().flatten().filter_map(|s| Some((*s.time.first()?, *s.time.last()?)));
            ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
        };
        log.joints.iter().filter_map(series).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    };
    let shared = before.joints.iter().any(|j| after.joint(&j.name).is_some());
    match (times(before), times(after)) {
        (Some((_, end)), Some((begin, _))) => shared && (0.0..=PAUSE).contains(&(begin - end)),
        _ => false,
    }
}
