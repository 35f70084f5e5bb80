//! Files and models for the tests.
#![allow(clippy::unwrap_used, missing_docs, dead_code)]

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use sagci_model::ObjectModel;
use sagci_recording::{JointState, Log, RecordingError, WrenchStamped, read};

/// A door on a hinge (0 to 1.6 rad), a drawer (0 to 0.4 m) and a wheel; the drawer follows positions.
pub fn cabinet(folder: &Path) -> ObjectModel {
    let link = |n: &str| {
        format!(
            "<link name='{n}'><inertial><mass value='1'/><inertia ixx='0.1' ixy='0' ixz='0' iyy='0.1' iyz='0' izz='0.1'/></inertial></link>"
        )
    };
    let joint = |n: &str, kind: &str, child: &str, limit: &str| {
        format!("<joint name='{n}' type='{kind}'><parent link='body'/><child link='{child}'/><axis xyz='0 0 1'/>{limit}</joint>")
    };
    let limit = |upper: f64| format!("<limit lower='0' upper='{upper}' effort='10' velocity='5'/>");
    let urdf = format!(
        "<robot name='cabinet'>{}{}{}{}{}{}{}</robot>",
        link("body"),
        link("door"),
        link("box"),
        link("knob"),
        joint("hinge", "revolute", "door", &limit(1.6)),
        joint("drawer", "prismatic", "box", &limit(0.4)),
        joint("wheel", "continuous", "knob", ""),
    );
    std::fs::write(folder.join("object.urdf"), urdf).unwrap();
    let document = "schema: 1\nname: cabinet\nactuators: [{joint: drawer, law: {kind: position_servo, stiffness: 100}}]\n";
    std::fs::write(folder.join("model.yaml"), document).unwrap();
    ObjectModel::read(folder).unwrap()
}

pub struct Files {
    pub folder: tempfile::TempDir,
    pub model: ObjectModel,
}

impl Files {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let model = cabinet(folder.path());
        Self { folder, model }
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// Reads one file, and makes sure that it is as it was.
    pub fn read(&self, bytes: impl AsRef<[u8]>) -> Result<Log, RecordingError> {
        let path = self.write("log", &bytes);
        let result = read(std::slice::from_ref(&path), Some(&self.model)).map(|mut logs| logs.remove(0));
        assert_eq!(std::fs::read(&path).unwrap(), bytes.as_ref(), "the file was changed");
        result
    }

    /// The message with which a file is refused.
    pub fn refused(&self, bytes: impl AsRef<[u8]>) -> String {
        self.read(bytes).err().unwrap().to_string()
    }
}

/// A CSV of so many rows, 100 Hz, with the header's columns after the time given by `row`.
pub fn rows(header: &str, count: usize, row: impl Fn(usize, f64) -> String) -> String {
    let mut text = format!("time,{header}\n");
    for i in 0..count {
        let t = i as f64 * 0.01;
        text += &format!("{t},{}\n", row(i, t));
    }
    text
}

/// A door that swings.
pub fn swing(t: f64) -> f64 {
    0.8 + 0.7 * (3.0 * t).sin()
}

pub fn has_note(log: &Log, words: &[&str]) -> bool {
    log.notes.iter().any(|n| words.iter().all(|w| n.message.contains(w) || n.place.contains(w)))
}

/// Writes MCAP as rosbag2 does.
pub struct Bag {
    writer: Writer<Cursor<Vec<u8>>>,
    channels: BTreeMap<String, u16>,
}

impl Bag {
    pub fn new(compression: Option<Compression>) -> Self {
        let options = WriteOptions::new().profile("ros2").compression(compression).chunk_size(Some(4096));
        Self { writer: options.create(Cursor::new(Vec::new())).unwrap(), channels: BTreeMap::new() }
    }

    pub fn message(&mut self, topic: &str, schema: &str, encoding: &str, log_time: u64, data: &[u8]) {
        let channel_id = *self.channels.entry(topic.to_owned()).or_insert_with(|| {
            let schema = self.writer.add_schema(schema, "ros2msg", b"").unwrap();
            self.writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap()
        });
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        self.writer.write_to_known_channel(&header, data).unwrap();
    }

    pub fn state(&mut self, topic: &str, log_time: u64, state: &JointState) {
        self.message(topic, JointState::SCHEMA, "cdr", log_time, &state.write());
    }

    pub fn wrench(&mut self, topic: &str, log_time: u64, wrench: &WrenchStamped) {
        self.message(topic, WrenchStamped::SCHEMA, "cdr", log_time, &wrench.write());
    }

    pub fn finish(mut self) -> Vec<u8> {
        self.writer.finish().unwrap();
        self.writer.into_inner().into_inner()
    }
}

pub fn state(time: u64, names: &[&str], position: &[f64], velocity: &[f64], effort: &[f64]) -> JointState {
    JointState {
        time,
        name: names.iter().map(|n| (*n).to_owned()).collect(),
        position: position.to_vec(),
        velocity: velocity.to_vec(),
        effort: effort.to_vec(),
    }
}
