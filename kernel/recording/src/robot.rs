//! MCAP files of robots: those that ROS 2 records, and those of our own runs, which hold the same messages.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::records::Record;
use sagci_model::{ActuatorLaw, ObjectModel};

use crate::raw::{Channel, Clock, Raw, Track};
use crate::{CommandKind, JointState, Note, RecordingError, WrenchStamped, records};

/// One topic.
struct Topic {
    name: String,
    schema: String,
    encoding: String,
    content: Option<Content>,
    /// Stamp, log time.
    time: Vec<(u64, u64)>,
    /// The joints' samples: joint, channel, message, value.
    samples: BTreeMap<(usize, Channel), (Vec<u32>, Vec<f64>)>,
    wrenches: BTreeMap<String, (Vec<u32>, Vec<[f64; 6]>)>,
    messages: u32,
    /// Messages that could not be read, and why the first one could not.
    unread: (u32, String),
}

#[derive(Clone, Copy, PartialEq)]
enum Content {
    States,
    Commands,
    Wrenches,
}

/// Reads the bytes of a file. Where a command gives a position and an effort, the drive's law says which one counts.
pub(crate) fn read(path: &Path, bytes: &[u8], model: Option<&ObjectModel>) -> Result<Raw, RecordingError> {
    let mut raw = Raw::default();
    let mut schemas: BTreeMap<u16, String> = BTreeMap::new();
    let mut topics: Vec<Topic> = Vec::new();
    let mut channels: BTreeMap<u16, usize> = BTreeMap::new();
    let broken = |offset, message| RecordingError::Broken { path: path.to_owned(), offset, message };
    let cut = records(bytes, broken, |record, at| {
        match record {
            Record::Schema { header, .. } => {
                schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let known =
                    topics.iter().position(|t| t.name == channel.topic && t.schema == schema && t.encoding == channel.message_encoding);
                let place = known.unwrap_or_else(|| {
                    topics.push(Topic::new(channel.topic, schema, channel.message_encoding));
                    topics.len() - 1
                });
                channels.insert(channel.id, place);
            }
            Record::Message { header, data } => {
                let Some(topic) = channels.get(&header.channel_id).map(|place| &mut topics[*place]) else {
                    return Err(broken(at, format!("a message belongs to channel {}, which is not declared", header.channel_id)));
                };
                topic.messages += 1;
                if let Err(message) = topic.take(header.log_time, &data, &mut raw)
                    && topic.content.is_some()
                {
                    topic.unread.0 += 1;
                    if topic.unread.0 == 1 {
                        topic.unread.1 = format!("message {} at {:.3} s: {message}", topic.messages, header.log_time as f64 / 1e9);
                    }
                }
            }
            _ => {}
        }
        Ok(())
    })?;
    if let Some(cut) = cut {
        let message = format!("the file ends too early ({}); it was read up to there", cut.message);
        raw.notes.push(Note { place: format!("byte {}", cut.offset), message });
    }
    if topics.iter().all(|t| t.time.is_empty()) {
        return Err(RecordingError::Topics { path: path.to_owned(), message: nothing(&topics) });
    }
    for topic in topics {
        topic.settle(&mut raw);
    }
    choose_commands(&mut raw, model);
    Ok(raw)
}

/// Leaves one kind of command for each joint. A message may fill both lists: the drive's law says which one counts; where there is none,
/// the efforts do unless they are all zero, as those are that nobody filled in.
fn choose_commands(raw: &mut Raw, model: Option<&ObjectModel>) {
    for (joint, name) in raw.joints.iter().enumerate() {
        let [effort, position] = [CommandKind::Effort, CommandKind::Position].map(|kind| (joint, Channel::Command(kind)));
        let has = |key, is: fn(f64) -> bool| raw.tracks.get(&key).is_some_and(|t| t.iter().flat_map(|t| &t.value).any(|v| is(*v)));
        let (has_effort, has_position) = (has(effort, f64::is_finite), has(position, f64::is_finite));
        let is_filled = has(effort, |v| v.is_finite() && v != 0.0);
        let takes_position = has_position && (!has_effort || !is_filled || follows_positions(model, name));
        if has_effort && has_position && model.is_none_or(|m| m.joint(name).is_some()) {
            let kept = if takes_position { position } else { effort }.1.name();
            let message = format!("its messages hold commanded positions and efforts; '{kept}' is taken");
            raw.notes.push(Note { place: name.clone(), message });
        }
        if takes_position || !has_effort {
            raw.tracks.remove(&effort);
        }
        if !takes_position {
            raw.tracks.remove(&position);
        }
    }
}

/// Why a file gives no samples.
fn nothing(topics: &[Topic]) -> String {
    let wanted = format!("record the joints as {} in CDR, as 'ros2 bag record -s mcap /joint_states' does", JointState::SCHEMA);
    if let Some(t) = topics.iter().find(|t| t.unread.0 > 0) {
        return format!("no message of {} can be read: {}", t.name, t.unread.1);
    }
    let with_messages: Vec<String> = topics
        .iter()
        .filter(|t| t.messages > 0)
        .take(12)
        .map(|t| format!("{} ({}, {})", t.name, if t.schema.is_empty() { "no schema" } else { &t.schema }, t.encoding))
        .collect();
    match with_messages.as_slice() {
        [] => format!("holds no message; {wanted}"),
        some => format!("holds no joint's samples, only {}; {wanted}", some.join(", ")),
    }
}

impl Topic {
    fn new(name: String, schema: String, encoding: String) -> Self {
        let is_command = ["command", "commands"].iter().any(|end| name.to_lowercase().ends_with(end));
        let content = match schema.as_str() {
            _ if encoding != "cdr" => None,
            JointState::SCHEMA if is_command => Some(Content::Commands),
            JointState::SCHEMA => Some(Content::States),
            WrenchStamped::SCHEMA => Some(Content::Wrenches),
            _ => None,
        };
        Self {
            name,
            schema,
            encoding,
            content,
            time: Vec::new(),
            samples: BTreeMap::new(),
            wrenches: BTreeMap::new(),
            messages: 0,
            unread: (0, String::new()),
        }
    }

    fn take(&mut self, log_time: u64, data: &[u8], raw: &mut Raw) -> Result<(), String> {
        let Some(content) = self.content else { return Ok(()) };
        let tick = self.time.len() as u32;
        if content == Content::Wrenches {
            let wrench = WrenchStamped::read(data)?;
            let ([tx, ty, tz], [fx, fy, fz]) = (wrench.torque, wrench.force);
            let (ticks, values) = self.wrenches.entry(wrench.frame.trim_start_matches('/').to_owned()).or_default();
            ticks.push(tick);
            values.push([tx, ty, tz, fx, fy, fz]);
            self.time.push((wrench.time, log_time));
            return Ok(());
        }
        let state = JointState::read(data)?;
        let mut sample = |joint: usize, channel, value: Option<&f64>| {
            if let Some(value) = value {
                let (ticks, values) = self.samples.entry((joint, channel)).or_default();
                ticks.push(tick);
                values.push(*value);
            }
        };
        for (i, name) in state.name.iter().enumerate() {
            let joint = raw.joint(name);
            let (position, effort) = (state.position.get(i), state.effort.get(i));
            if content == Content::States {
                sample(joint, Channel::Position, position);
                sample(joint, Channel::Velocity, state.velocity.get(i));
                sample(joint, Channel::Effort, effort);
                continue;
            }
            sample(joint, Channel::Command(CommandKind::Position), position);
            sample(joint, Channel::Command(CommandKind::Effort), effort);
        }
        self.time.push((state.time, log_time));
        Ok(())
    }

    /// Adds what was read. Sets the topic's clock: the headers' stamps where there are any.
    fn settle(self, raw: &mut Raw) {
        let mut note = |message: String| raw.notes.push(Note { place: self.name.clone(), message });
        if self.content.is_none() {
            // What carries joints, but not in a way that is read, is said; images and the like are not missed.
            let bare = self.schema.rsplit('/').next().unwrap_or_default();
            if self.messages > 0 && ["JointState", "WrenchStamped", "Float64MultiArray", "JointTrajectory"].contains(&bare) {
                let how = "joints are read from sensor_msgs/msg/JointState in CDR, with names";
                note(format!("holds {} ({}), which was left out: {how}", self.schema, self.encoding));
            }
            return;
        }
        if self.unread.0 > 0 {
            note(format!(
                "{} of {} messages could not be read and were left out; the first: {}",
                self.unread.0, self.messages, self.unread.1
            ));
        }
        if self.time.is_empty() {
            return;
        }
        let unstamped = self.time.iter().filter(|t| t.0 == 0).count();
        let stamp_is_log_time = |t: &(u64, u64)| t.0 != 0 && t.0.abs_diff(t.1) < 1_000_000_000;
        // A simulation's clock starts at zero: a single stamp there, followed by others soon after, is a time like any other.
        let is_start = |t: &(u64, u64)| t.0 < 60_000_000_000;
        let starts_at_zero = unstamped == 1 && self.time[0].0 == 0 && self.time.get(1).is_some_and(is_start);
        let takes_log = unstamped == self.time.len() || (!starts_at_zero && self.time.iter().any(stamp_is_log_time));
        let uses_log = |stamp: u64| stamp == 0 && takes_log;
        if unstamped == self.time.len() && self.time.iter().any(|t| t.1 != 0) {
            note("its messages have no stamp; the times at which they were recorded are taken".into());
        } else if unstamped > 1 && unstamped < self.time.len() {
            note(format!("{unstamped} of {} messages have no stamp", self.time.len()));
        }
        let time =
            self.time.iter().map(|(stamp, log)| (if uses_log(*stamp) { *log } else { *stamp }).min(i64::MAX as u64) as i64).collect();
        let clock = raw.clocks.len();
        raw.clocks.push(Clock { place: self.name, time, line: (1..=self.time.len() as u32).collect() });
        for (key, (tick, value)) in self.samples {
            raw.tracks.entry(key).or_default().push(Track { clock, tick, value });
        }
        for (link, (tick, value)) in self.wrenches {
            raw.wrenches.push((link, clock, tick, value));
        }
    }
}

/// Does the joint's drive follow positions?
fn follows_positions(model: Option<&ObjectModel>, joint: &str) -> bool {
    let law = model.and_then(|m| m.document.actuators.iter().find(|a| a.joint == joint)).map(|a| &a.law);
    matches!(law, Some(ActuatorLaw::PositionServo { .. } | ActuatorLaw::DcMotor { .. }))
}
