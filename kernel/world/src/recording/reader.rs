use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mcap::records::Record;
use sagci_recording::{Cut, JointState, records};
use sagci_signal::{Command, Observation};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::journal::{END, OUTCOME, RUN_RECORD, digest, hexadecimal};
use super::message;
use super::schema::{CHANNELS, JOINT_COMMANDS, JOINT_STATES, LOG, PHASE, TRUTH, WRENCH};
use super::{Level, Outcome, RecordingError, RunRecord};
use crate::truth::TrueFrame;

/// A recording that was read: what the sensors said, what was commanded, what was told. Not what was true.
#[derive(Debug, Clone)]
pub struct Recording {
    /// The file.
    pub path: PathBuf,
    /// What was run.
    pub record: RunRecord,
    /// How it ended; nothing if the run was interrupted.
    pub outcome: Option<Outcome>,
    /// What the sensors said, in the order of time.
    pub observations: Vec<Observation>,
    /// What was commanded, with the time at which each command's period began, s.
    pub commands: Vec<(f64, Command)>,
    /// What was told.
    pub log: Vec<Entry>,
    /// Phases in the order of time.
    pub phases: Vec<PhaseEntry>,
    /// The file ends too early: it is read up to there.
    pub cut: Option<Cut>,
    /// Every message equals what was recorded; nothing if the file was not closed.
    pub intact: Option<bool>,
    pub(super) truth: Vec<TrueFrame>,
    pub(super) truth_intact: Option<bool>,
}

/// A log entry.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// When, s.
    pub time: f64,
    /// How much it matters.
    pub level: Level,
    /// Who spoke.
    pub name: String,
    /// What was said.
    pub text: String,
}

/// A phase of a skill as it was told.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseEntry {
    /// When, s.
    pub time: f64,
    /// Number of the script's step.
    pub step: usize,
    /// The skill.
    pub skill: String,
    /// The phase.
    pub phase: String,
    /// How much of the skill was done, 0..1.
    pub progress: f64,
}

/// Reads a file record by record, keeping count of where it is.
struct Loader {
    recording: Recording,
    /// Channel number to its place in [`CHANNELS`]; channels of others are left alone.
    channels: BTreeMap<u16, Option<usize>>,
    schemas: BTreeMap<u16, (String, String)>,
    truth_names: [Vec<String>; 2],
    wrenches: BTreeMap<u64, sagci_signal::Wrench>,
    hash: Sha256,
    truth_hash: Sha256,
    messages: u64,
    end: Option<BTreeMap<String, String>>,
    has_record: bool,
}

impl Recording {
    /// Reads a file. One that ends too early is read as far as it goes, and [`Self::cut`] says where that is.
    ///
    /// # Errors
    /// If it is no recording, or a record in it is broken: with the place in the file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|source| RecordingError::File { path: path.to_owned(), source })?;
        let broken = |offset, message| RecordingError::Broken { path: path.to_owned(), offset, message };
        let mut loader = Loader::new(path);
        let mut end = 0;
        let cut = records(&bytes, broken, |record, at| {
            end = at;
            loader.take(record, at)
        })?;
        end = cut.as_ref().map_or(end, |c| c.offset);
        loader.recording.cut = cut;
        loader.finish(end)
    }

    /// Length of the run as far as it was recorded, s.
    pub fn seconds(&self) -> f64 {
        self.observations.last().map_or(0.0, |o| o.time)
    }
}

impl Loader {
    fn new(path: &Path) -> Self {
        let recording = Recording {
            path: path.to_owned(),
            record: RunRecord::default(),
            outcome: None,
            observations: Vec::new(),
            commands: Vec::new(),
            log: Vec::new(),
            phases: Vec::new(),
            cut: None,
            intact: None,
            truth: Vec::new(),
            truth_intact: None,
        };
        Self {
            recording,
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            truth_names: [Vec::new(), Vec::new()],
            wrenches: BTreeMap::new(),
            hash: Sha256::new(),
            truth_hash: Sha256::new(),
            messages: 0,
            end: None,
            has_record: false,
        }
    }

    fn broken(&self, at: u64, message: String) -> RecordingError {
        RecordingError::Broken { path: self.recording.path.clone(), offset: at, message }
    }

    fn take(&mut self, record: Record<'_>, at: u64) -> Result<(), RecordingError> {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, (header.name, header.encoding));
            }
            Record::Channel(channel) => {
                let (name, encoding) = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let known = CHANNELS.iter().position(|c| c.topic == channel.topic);
                if let Some(c) = known.map(|k| &CHANNELS[k])
                    && (c.schema != name || c.schema_encoding != encoding || c.message_encoding != channel.message_encoding)
                {
                    return Err(RecordingError::Schema {
                        path: self.recording.path.clone(),
                        offset: at,
                        channel: channel.topic,
                        expected: format!("{} ({}, {})", c.schema, c.schema_encoding, c.message_encoding),
                        found: format!("{name} ({encoding}, {})", channel.message_encoding),
                    });
                }
                if known == Some(TRUTH) {
                    for (names, key) in self.truth_names.iter_mut().zip(["frames", "joints"]) {
                        *names = channel.metadata.get(key).and_then(|t| serde_json::from_str(t).ok()).unwrap_or_default();
                    }
                }
                self.channels.insert(channel.id, known);
            }
            Record::Message { header, data } => match self.channels.get(&header.channel_id) {
                None => return Err(self.broken(at, format!("a message belongs to channel {}, which is not declared", header.channel_id))),
                Some(None) => {}
                Some(Some(channel)) => {
                    let channel = *channel;
                    digest(&mut self.hash, CHANNELS[channel].topic, header.log_time, &data);
                    if channel == TRUTH {
                        digest(&mut self.truth_hash, CHANNELS[channel].topic, header.log_time, &data);
                    }
                    self.messages += 1;
                    self.message(channel, header.log_time, &data).map_err(|m| {
                        self.broken(at, format!("{} at {:.3} s: {m}", CHANNELS[channel].topic, header.log_time as f64 / 1e9))
                    })?;
                }
            },
            Record::Attachment { header, data, .. } => {
                let bad = |e: serde_json::Error| format!("the attachment '{}' cannot be read: {e}", header.name);
                if header.name == RUN_RECORD {
                    self.recording.record = serde_json::from_slice(&data).map_err(|e| self.broken(at, bad(e)))?;
                    self.has_record = true;
                } else if header.name == OUTCOME {
                    self.recording.outcome = Some(serde_json::from_slice(&data).map_err(|e| self.broken(at, bad(e)))?);
                }
            }
            Record::Metadata(metadata) if metadata.name == END => self.end = Some(metadata.metadata),
            _ => {}
        }
        Ok(())
    }

    fn message(&mut self, channel: usize, time: u64, data: &[u8]) -> Result<(), String> {
        let seconds = time as f64 / 1e9;
        match channel {
            JOINT_STATES => {
                let mut observation = message::to_observation(JointState::read(data)?)?;
                observation.time = seconds;
                self.recording.observations.push(observation);
            }
            JOINT_COMMANDS => self.recording.commands.push((seconds, message::to_command(&JointState::read(data)?)?)),
            WRENCH => {
                let (time, wrench) = message::to_wrench(data)?;
                self.wrenches.insert(time, wrench);
            }
            LOG => {
                let v: Value = serde_json::from_slice(data).map_err(|e| e.to_string())?;
                let level = Level::of(v["level"].as_u64().unwrap_or(0));
                self.recording.log.push(Entry { time: seconds, level, name: words(&v["name"]), text: words(&v["message"]) });
            }
            PHASE => {
                let v: Value = serde_json::from_slice(data).map_err(|e| e.to_string())?;
                self.recording.phases.push(PhaseEntry {
                    time: seconds,
                    step: v["step"].as_u64().unwrap_or(0) as usize,
                    skill: words(&v["skill"]),
                    phase: words(&v["phase"]),
                    progress: v["progress"].as_f64().unwrap_or(0.0),
                });
            }
            TRUTH => self.recording.truth.push(message::to_truth(data, &self.truth_names[0], &self.truth_names[1])?),
            _ => {}
        }
        Ok(())
    }

    fn finish(mut self, at: u64) -> Result<Recording, RecordingError> {
        if !self.has_record {
            let message =
                "no run record comes before this place: the file was not written by this program, or was cut off as the run started";
            return Err(self.broken(at, message.to_owned()));
        }
        for o in &mut self.recording.observations {
            if let Some(wrench) = self.wrenches.get(&super::nanoseconds(o.time)) {
                o.F_S = *wrench;
            }
        }
        if let Some(end) = &self.end {
            let is = |key: &str, value: String| end.get(key).is_some_and(|v| *v == value);
            self.recording.intact = Some(is("sha256", hexadecimal(self.hash)) && is("messages", self.messages.to_string()));
            self.recording.truth_intact = Some(is("truth_sha256", hexadecimal(self.truth_hash)));
        }
        Ok(self.recording)
    }
}

fn words(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}
