//! The messages of ROS 2 that carry what joints and sensors measure.

use crate::cdr::{Reader, Writer};

/// sensor_msgs/msg/JointState. Each of the three lists has an entry for each name, or none at all.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointState {
    /// Stamp of the header, ns.
    pub time: u64,
    /// Names of the joints.
    pub name: Vec<String>,
    /// Positions, rad or m.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Efforts, N m or N.
    pub effort: Vec<f64>,
}

impl JointState {
    /// Name of its schema.
    pub const SCHEMA: &str = "sensor_msgs/msg/JointState";

    /// Reads a message in CDR.
    ///
    /// Errors: bytes that are not whole, or lists of other lengths; a sentence for a person.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut r = Reader::new(bytes)?;
        let time = r.time()?;
        r.text()?;
        let state = Self { time, name: r.texts()?, position: r.f64s()?, velocity: r.f64s()?, effort: r.f64s()? };
        r.finish()?;
        let count = state.name.len();
        for (what, length) in [("positions", state.position.len()), ("velocities", state.velocity.len()), ("efforts", state.effort.len())] {
            if length != count && length != 0 {
                return Err(format!("the message names {count} joints, but gives {length} {what}"));
            }
        }
        Ok(state)
    }

    /// The message in CDR.
    pub fn write(&self) -> Vec<u8> {
        let mut w = Writer::new();
        w.time(self.time).text("").texts(self.name.iter().map(String::as_str));
        w.f64s(&self.position).f64s(&self.velocity).f64s(&self.effort);
        w.finish()
    }
}

/// geometry_msgs/msg/WrenchStamped.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WrenchStamped {
    /// Stamp of the header, ns.
    pub time: u64,
    /// The frame that it is measured at and given in.
    pub frame: String,
    /// Force, N.
    pub force: [f64; 3],
    /// Torque, N m.
    pub torque: [f64; 3],
}

impl WrenchStamped {
    /// Name of its schema.
    pub const SCHEMA: &str = "geometry_msgs/msg/WrenchStamped";

    /// Reads a message in CDR.
    ///
    /// Errors: bytes that are not whole; a sentence for a person.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut r = Reader::new(bytes)?;
        let (time, frame) = (r.time()?, r.text()?);
        let force = [r.f64()?, r.f64()?, r.f64()?];
        let torque = [r.f64()?, r.f64()?, r.f64()?];
        r.finish()?;
        Ok(Self { time, frame, force, torque })
    }

    /// The message in CDR.
    pub fn write(&self) -> Vec<u8> {
        let mut w = Writer::new();
        w.time(self.time).text(&self.frame);
        for value in self.force.iter().chain(&self.torque) {
            w.f64(*value);
        }
        w.finish()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn messages_read_as_they_were_written() {
        let state = JointState {
            time: 1_700_000_000_250_000_000,
            name: vec!["hinge".into(), "drawer_1".into()],
            position: vec![0.5, -1.0],
            velocity: vec![],
            effort: vec![f64::MIN_POSITIVE, 3.0],
        };
        assert_eq!(JointState::read(&state.write()).unwrap(), state);
        let wrench = WrenchStamped { time: 5, frame: "hand".into(), force: [1.0, 2.0, 3.0], torque: [4.0, 5.0, 6.0] };
        assert_eq!(WrenchStamped::read(&wrench.write()).unwrap(), wrench);
    }

    #[test]
    fn lists_of_other_lengths_are_refused() {
        let state = JointState { name: vec!["a".into(), "b".into()], position: vec![1.0], ..Default::default() };
        assert!(JointState::read(&state.write()).unwrap_err().contains("names 2 joints, but gives 1 positions"));
    }
}
