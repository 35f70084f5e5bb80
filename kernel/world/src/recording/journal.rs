use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use nalgebra::Isometry3;
use sagci_signal::SceneBelief;
use sha2::{Digest, Sha256};

use super::schema::{self, CHANNELS, LOG, PHASE, TF, TRUTH};
use super::{Outcome, RecordingError, RunRecord, message, nanoseconds};

/// A chunk is closed after so long, so that a file that is cut off is read up to there, ns.
const CHUNK_TIME: u64 = 500_000_000;
/// Name of the attachment with the run record.
pub(super) const RUN_RECORD: &str = "run_record.json";
/// Name of the attachment with the outcome.
pub(super) const OUTCOME: &str = "outcome.json";
/// Name of the metadata that closes a file.
pub(super) const END: &str = "sagci.end";

/// How much a log entry matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// For developers.
    Debug,
    /// What happens.
    Info,
    /// Something is not as it should be, but the run goes on.
    Warning,
    /// The run failed.
    Error,
}

impl Level {
    /// Number of foxglove.LogLevel.
    fn number(self) -> u8 {
        self as u8 + 1
    }

    pub(super) fn of(number: u64) -> Self {
        match number {
            0 | 1 => Self::Debug,
            2 => Self::Info,
            3 => Self::Warning,
            _ => Self::Error,
        }
    }
}

/// Writes a recording. Copies write the same file; it is closed by [`Journal::close`], or when the last copy is dropped.
///
/// A failure to write does not stop a run: it is kept, and [`Journal::close`] tells it.
#[derive(Clone)]
pub struct Journal {
    inner: Arc<Mutex<Inner>>,
}

struct Inner {
    path: PathBuf,
    writer: Option<Writer<BufWriter<File>>>,
    /// Number in the file of each of [`CHANNELS`], and of the messages in it.
    ids: [Option<(u16, u32)>; CHANNELS.len()],
    hash: Sha256,
    truth_hash: Sha256,
    messages: u64,
    now: u64,
    last_chunk: u64,
    failure: Option<String>,
}

impl Journal {
    /// Starts a file, and writes what is run. Folders that are missing are made.
    pub fn create(path: impl AsRef<Path>, record: &RunRecord) -> Result<Self, RecordingError> {
        let path = path.as_ref().to_owned();
        let file_error = |source| RecordingError::File { path: path.clone(), source };
        if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(file_error)?;
        }
        let file = File::create(&path).map_err(file_error)?;
        let write_error = |message: String| RecordingError::Write { path: path.clone(), message };
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .library(concat!("sagci ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(4 << 20));
        let mut writer = options.create(BufWriter::new(file)).map_err(|e| write_error(e.to_string()))?;
        let data = serde_json::to_vec_pretty(record).map_err(|e| write_error(e.to_string()))?;
        writer.attach(&json_attachment(RUN_RECORD, 0, data)).map_err(|e| write_error(e.to_string()))?;
        writer.flush().map_err(|e| write_error(e.to_string()))?;
        let inner = Inner {
            path,
            writer: Some(writer),
            ids: [None; CHANNELS.len()],
            hash: Sha256::new(),
            truth_hash: Sha256::new(),
            messages: 0,
            now: 0,
            last_chunk: 0,
            failure: None,
        };
        Ok(Self { inner: Arc::new(Mutex::new(inner)) })
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Where the file is.
    pub fn path(&self) -> PathBuf {
        self.lock().path.clone()
    }

    /// Writes a log entry, at the time of the last observation. `name` says who speaks.
    pub fn log(&self, level: Level, name: &str, text: &str) {
        let mut inner = self.lock();
        let now = inner.now;
        inner.write(LOG, now, &message::log(now, level.number(), name, text));
    }

    /// Writes that a phase of a skill goes on: number of the script's step, skill, phase, and how much of the skill is
    /// done (0..1).
    pub fn phase(&self, step: usize, skill: &str, phase: &str, progress: f64) {
        let mut inner = self.lock();
        let now = inner.now;
        inner.write(PHASE, now, &message::phase(now, step, skill, phase, progress));
    }

    /// Writes where the robot believes the objects to be, as frames `believed/<object>`.
    pub fn belief(&self, belief: &SceneBelief) {
        let frames = belief.objects.iter().map(|o| ("world", format!("believed/{}", o.name), o.X_WO));
        let mut inner = self.lock();
        let now = inner.now;
        inner.write(TF, now, &message::transforms(now, frames));
    }

    /// Writes frames: parent, child, pose of the child in the parent.
    pub(super) fn frames<'a>(&self, frames: impl Iterator<Item = (&'a str, String, Isometry3<f64>)>) {
        let mut inner = self.lock();
        let now = inner.now;
        inner.write(TF, now, &message::transforms(now, frames));
    }

    /// Writes one message of a channel.
    pub(super) fn message(&self, channel: usize, time: u64, data: &[u8]) {
        self.lock().write(channel, time, data);
    }

    /// Declares the channel of the true state with the names of what it holds.
    pub(super) fn declare_truth(&self, frames: &[String], joints: &[String]) {
        let names = |n: &[String]| serde_json::Value::from(n.to_vec()).to_string();
        let metadata = BTreeMap::from([("frames".to_owned(), names(frames)), ("joints".to_owned(), names(joints))]);
        self.lock().declare(TRUTH, &metadata);
    }

    /// Sets the time that entries get from now on, s, and closes a chunk from time to time.
    pub(super) fn tick(&self, seconds: f64) {
        let mut inner = self.lock();
        inner.now = nanoseconds(seconds);
        if inner.now >= inner.last_chunk + CHUNK_TIME {
            inner.last_chunk = inner.now;
            inner.attempt(|w| w.flush());
        }
    }

    /// Writes the outcome and closes the file. Says where it is, or what went wrong with it.
    pub fn close(&self, outcome: &Outcome) -> Result<PathBuf, RecordingError> {
        let mut inner = self.lock();
        let now = inner.now;
        match serde_json::to_vec_pretty(outcome) {
            Ok(data) => inner.attempt(|w| w.attach(&json_attachment(OUTCOME, now, data))),
            Err(e) => inner.failure = Some(e.to_string()),
        }
        inner.finish();
        match inner.failure.take() {
            None => Ok(inner.path.clone()),
            Some(message) => Err(RecordingError::Write { path: inner.path.clone(), message }),
        }
    }
}

impl Inner {
    fn attempt(&mut self, write: impl FnOnce(&mut Writer<BufWriter<File>>) -> mcap::McapResult<()>) {
        if let Some(writer) = self.writer.as_mut()
            && let Err(e) = write(writer)
        {
            // After a failed write the file ends where it was last whole.
            self.failure.get_or_insert(e.to_string());
            self.writer = None;
        }
    }

    fn declare(&mut self, channel: usize, metadata: &BTreeMap<String, String>) {
        let c = &CHANNELS[channel];
        let mut id = None;
        self.attempt(|w| {
            let schema = w.add_schema(c.schema, c.schema_encoding, schema::text(c.schema).as_bytes())?;
            id = Some(w.add_channel(schema, c.topic, c.message_encoding, metadata)?);
            Ok(())
        });
        self.ids[channel] = id.map(|id| (id, 0));
    }

    fn write(&mut self, channel: usize, time: u64, data: &[u8]) {
        if self.ids[channel].is_none() {
            self.declare(channel, &BTreeMap::new());
        }
        let Some((id, sequence)) = self.ids[channel].as_mut().map(|(id, count)| {
            *count += 1;
            (*id, *count)
        }) else {
            return;
        };
        digest(&mut self.hash, CHANNELS[channel].topic, time, data);
        if channel == TRUTH {
            digest(&mut self.truth_hash, CHANNELS[channel].topic, time, data);
        }
        self.messages += 1;
        let header = MessageHeader { channel_id: id, sequence, log_time: time, publish_time: time };
        self.attempt(|w| w.write_to_known_channel(&header, data));
    }

    fn finish(&mut self) {
        if self.writer.is_none() {
            return;
        }
        let metadata = BTreeMap::from([
            ("messages".to_owned(), self.messages.to_string()),
            ("sha256".to_owned(), hexadecimal(self.hash.clone())),
            ("truth_sha256".to_owned(), hexadecimal(self.truth_hash.clone())),
        ]);
        self.attempt(|w| {
            w.write_metadata(&Metadata { name: END.to_owned(), metadata })?;
            w.finish().map(|_| ())
        });
        if let Some(writer) = self.writer.take() {
            let synced = writer.into_inner().into_inner().map_err(|e| e.to_string()).and_then(|f| f.sync_all().map_err(|e| e.to_string()));
            if let Err(e) = synced {
                self.failure.get_or_insert(e);
            }
        }
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.finish();
    }
}

fn json_attachment(name: &str, time: u64, data: Vec<u8>) -> Attachment<'static> {
    Attachment { log_time: time, create_time: time, name: name.to_owned(), media_type: "application/json".to_owned(), data: data.into() }
}

/// Adds one message to a hash: topic, time and bytes, each with its length.
pub(super) fn digest(hash: &mut Sha256, topic: &str, time: u64, data: &[u8]) {
    hash.update((topic.len() as u64).to_le_bytes());
    hash.update(topic);
    hash.update(time.to_le_bytes());
    hash.update((data.len() as u64).to_le_bytes());
    hash.update(data);
}

pub(super) fn hexadecimal(hash: Sha256) -> String {
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}
