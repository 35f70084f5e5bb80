//! Messages to bytes and back.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use sagci_recording::cdr::{Reader, Writer};
use sagci_recording::{JointState, WrenchStamped};
use sagci_signal::{Command, DepthImage, GripperCommand, Observation, Wrench};
use serde_json::{Value, json};

use super::nanoseconds;
use crate::truth::TrueFrame;

/// The arm's joints, then both fingers, each half of the opening.
pub(super) fn observation(observation: &Observation, arm: &[String], fingers: &[String; 2]) -> Vec<u8> {
    let half = observation.gripper_width / 2.0;
    let with = |values: &[f64], last: f64| [values, &[last, last]].concat();
    let state = JointState {
        time: nanoseconds(observation.time),
        name: arm.iter().chain(fingers).cloned().collect(),
        position: with(&observation.q, half),
        velocity: with(&observation.v, 0.0),
        effort: with(&observation.tau, observation.gripper_force),
    };
    state.write()
}

/// An observation without its wrench, from a message of [`observation`].
pub(super) fn to_observation(state: JointState) -> Result<Observation, String> {
    let arm = state.name.len().checked_sub(2).ok_or("the message names fewer than two fingers")?;
    let part = |values: &[f64]| values.get(..arm).map(<[f64]>::to_vec).unwrap_or_default();
    let last = |values: &[f64]| values.get(arm).copied().unwrap_or(0.0);
    Ok(Observation {
        time: state.time as f64 / 1e9,
        q: part(&state.position),
        v: part(&state.velocity),
        tau: part(&state.effort),
        gripper_width: 2.0 * last(&state.position),
        gripper_force: last(&state.effort),
        F_S: Wrench::default(),
    })
}

/// Efforts of the arm's joints; for the gripper the opening as its position and the force as its effort.
pub(super) fn command(time: u64, command: &Command, arm: &[String]) -> Vec<u8> {
    let mut position = vec![f64::NAN; command.tau.len()];
    position.push(command.gripper.width);
    let state = JointState {
        time,
        name: arm.iter().cloned().chain(["gripper".to_owned()]).collect(),
        position,
        velocity: Vec::new(),
        effort: [command.tau.as_slice(), &[command.gripper.force]].concat(),
    };
    state.write()
}

pub(super) fn to_command(state: &JointState) -> Result<Command, String> {
    let (Some(width), Some((force, tau))) = (state.position.last(), state.effort.split_last()) else {
        return Err("the message holds no gripper".into());
    };
    Ok(Command { tau: tau.to_vec(), gripper: GripperCommand { width: *width, force: *force } })
}

/// geometry_msgs/msg/WrenchStamped.
pub(super) fn wrench(time: u64, frame: &str, wrench: &Wrench) -> Vec<u8> {
    WrenchStamped { time, frame: frame.to_owned(), force: wrench.force.into(), torque: wrench.torque.into() }.write()
}

pub(super) fn to_wrench(bytes: &[u8]) -> Result<(u64, Wrench), String> {
    let wrench = WrenchStamped::read(bytes)?;
    Ok((wrench.time, Wrench { force: wrench.force.into(), torque: wrench.torque.into() }))
}

/// std_msgs/msg/String.
pub(super) fn text(text: &str) -> Vec<u8> {
    let mut w = Writer::new();
    w.text(text);
    w.finish()
}

/// sagci/msg/TrueFrame.
pub(super) fn truth(frame: &TrueFrame) -> Vec<u8> {
    let mut poses = Vec::with_capacity(7 * frame.frames.len());
    for (_, X) in &frame.frames {
        poses.extend(X.translation.vector.iter());
        poses.extend(X.rotation.coords.iter());
    }
    let joints: Vec<f64> = frame.joints.iter().flat_map(|(_, q, v)| [*q, *v]).collect();
    let mut w = Writer::new();
    w.time(nanoseconds(frame.time)).text("world").f64s(&poses).f64s(&joints);
    w.finish()
}

pub(super) fn to_truth(bytes: &[u8], frames: &[String], joints: &[String]) -> Result<TrueFrame, String> {
    let mut r = Reader::new(bytes)?;
    let time = r.time()? as f64 / 1e9;
    r.text()?;
    let (poses, states) = (r.f64s()?, r.f64s()?);
    r.finish()?;
    if poses.len() != 7 * frames.len() || states.len() != 2 * joints.len() {
        return Err(format!(
            "the message holds {} poses and {} joints, but the channel names {} and {}",
            poses.len() / 7,
            states.len() / 2,
            frames.len(),
            joints.len()
        ));
    }
    let pose = |p: &[f64]| {
        let turn = UnitQuaternion::new_unchecked(Quaternion::new(p[6], p[3], p[4], p[5]));
        Isometry3::from_parts(Translation3::new(p[0], p[1], p[2]), turn)
    };
    Ok(TrueFrame {
        time,
        frames: frames.iter().cloned().zip(poses.chunks_exact(7).map(pose)).collect(),
        joints: joints.iter().zip(states.chunks_exact(2)).map(|(n, s)| (n.clone(), s[0], s[1])).collect(),
    })
}

fn stamp(time: u64) -> Value {
    json!({ "sec": time / 1_000_000_000, "nsec": time % 1_000_000_000 })
}

/// foxglove.FrameTransforms: parent, child, pose of the child in the parent.
pub(super) fn transforms<'a>(time: u64, frames: impl Iterator<Item = (&'a str, String, Isometry3<f64>)>) -> Vec<u8> {
    let transforms: Vec<Value> = frames
        .map(|(parent, child, X)| {
            let (p, r) = (X.translation.vector, X.rotation);
            json!({
                "timestamp": stamp(time), "parent_frame_id": parent, "child_frame_id": child,
                "translation": { "x": p.x, "y": p.y, "z": p.z },
                "rotation": { "x": r.i, "y": r.j, "z": r.k, "w": r.w },
            })
        })
        .collect();
    json!({ "transforms": transforms }).to_string().into_bytes()
}

/// foxglove.PointCloud in the camera's frame, with colours.
pub(super) fn points(image: &DepthImage, frame: &str) -> Vec<u8> {
    const STRIDE: usize = 16;
    let mut data = Vec::new();
    for (i, p) in image.points() {
        for c in p.coords.iter() {
            data.extend((*c as f32).to_le_bytes());
        }
        let [r, g, b] = image.rgb.get(i).copied().unwrap_or([128; 3]);
        data.extend([r, g, b, 255]);
    }
    let field = |name: &str, offset: usize, kind: u8| json!({ "name": name, "offset": offset, "type": kind });
    json!({
        "timestamp": stamp(nanoseconds(image.time)), "frame_id": frame,
        "pose": { "position": { "x": 0, "y": 0, "z": 0 }, "orientation": { "x": 0, "y": 0, "z": 0, "w": 1 } },
        "point_stride": STRIDE,
        "fields": [field("x", 0, 7), field("y", 4, 7), field("z", 8, 7), field("red", 12, 1), field("green", 13, 1), field("blue", 14, 1), field("alpha", 15, 1)],
        "data": base64(&data),
    })
    .to_string()
    .into_bytes()
}

/// foxglove.RawImage of depths in m.
pub(super) fn depth(image: &DepthImage, frame: &str) -> Vec<u8> {
    let data: Vec<u8> = image.depth.iter().flat_map(|d| d.to_le_bytes()).collect();
    json!({
        "timestamp": stamp(nanoseconds(image.time)), "frame_id": frame, "width": image.width, "height": image.height,
        "encoding": "32FC1", "step": 4 * image.width, "data": base64(&data),
    })
    .to_string()
    .into_bytes()
}

/// foxglove.Log.
pub(super) fn log(time: u64, level: u8, name: &str, message: &str) -> Vec<u8> {
    json!({ "timestamp": stamp(time), "level": level, "message": message, "name": name, "file": "", "line": 0 }).to_string().into_bytes()
}

/// sagci.Phase.
pub(super) fn phase(time: u64, step: usize, skill: &str, phase: &str, progress: f64) -> Vec<u8> {
    json!({ "timestamp": stamp(time), "step": step, "skill": skill, "phase": phase, "progress": progress }).to_string().into_bytes()
}

/// RFC 4648 with padding.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let word = group.iter().enumerate().fold(0u32, |w, (i, b)| w | u32::from(*b) << (16 - 8 * i));
        for i in 0..4 {
            out.push(if i <= group.len() { char::from(LETTERS[(word >> (18 - 6 * i) & 63) as usize]) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::base64;

    #[test]
    fn base64_is_that_of_the_standard() {
        // RFC 4648, section 10.
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }
}
