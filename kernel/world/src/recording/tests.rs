#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;
use sagci_signal::{Command, DepthImage, GripperCommand, Observation, Wrench};

use super::world::testing::recorded;
use super::*;
use crate::truth::{TrueFrame, TrueState};
use crate::{Scene, World, WorldError};

/// A world whose sensors say random things, the same for the same seed.
struct Noise {
    random: Pcg64,
    tick: u64,
    joints: usize,
    observation: Observation,
}

impl Noise {
    fn new(joints: usize) -> Self {
        Self { random: Pcg64::seed_from_u64(7), tick: 0, joints, observation: Observation::default() }
    }

    fn sense(&mut self) {
        let joints = self.joints;
        let mut numbers = |n: usize| -> Vec<f64> { (0..n).map(|_| self.random.random::<f64>() * 4.0 - 2.0).collect() };
        let wrench = numbers(6);
        self.observation = Observation {
            time: self.tick as f64 * 0.001,
            q: numbers(joints),
            v: numbers(joints),
            tau: numbers(joints),
            gripper_width: numbers(1)[0].abs() / 50.0,
            gripper_force: 30.0,
            F_S: Wrench { force: Vector3::new(wrench[0], wrench[1], wrench[2]), torque: Vector3::new(wrench[3], wrench[4], wrench[5]) },
        };
    }
}

impl World for Noise {
    fn period(&self) -> f64 {
        0.001
    }
    fn reset(&mut self, _: &Scene, _: u64) -> Result<(), WorldError> {
        self.sense();
        Ok(())
    }
    fn observe(&self) -> Observation {
        self.observation.clone()
    }
    fn look(&mut self) -> Result<DepthImage, WorldError> {
        Ok(DepthImage {
            time: self.observation.time,
            width: 4,
            height: 3,
            focal: [4.0; 2],
            center: [1.5, 1.0],
            depth: vec![0.5, 0.6, 0.0, 0.7, 0.5, 0.5, 0.5, 0.5, 0.0, 0.1, 0.2, 0.3],
            rgb: vec![[200, 100, 50]; 12],
        })
    }
    fn advance(&mut self, command: &Command) -> Result<(), WorldError> {
        if !command.tau.iter().all(|t| t.is_finite()) {
            return Err(WorldError::Command { time: self.observation.time, message: "an effort is not a number".into() });
        }
        self.tick += 1;
        self.sense();
        Ok(())
    }
}

impl TrueState for Noise {
    fn true_frame(&self) -> TrueFrame {
        let t = self.tick as f64 * 1e-3;
        let X = |x: f64| Isometry3::new(Vector3::new(x, 0.2, 0.1), Vector3::new(0.0, 0.0, x));
        TrueFrame {
            time: t,
            frames: vec![("arm/base".into(), X(0.0)), ("oven/body".into(), X(1.0)), ("oven/door".into(), X(t)), ("cup/cup".into(), X(-t))],
            joints: vec![("arm/turn".into(), t, 1.0), ("oven/hinge".into(), 0.1 * t, 0.1)],
        }
    }
}

fn robot(folder: &Path) -> ObjectModel {
    let inertial = "<inertial><mass value='1'/><inertia ixx='0.01' ixy='0' ixz='0' iyy='0.01' iyz='0' izz='0.01'/></inertial>";
    let link = |n: &str| format!("<link name='{n}'>{inertial}</link>");
    let joint = |n: &str, kind: &str, parent: &str, child: &str| {
        format!(
            "<joint name='{n}' type='{kind}'><parent link='{parent}'/><child link='{child}'/><origin xyz='0 0 0.3'/><axis xyz='0 1 0'/>\
             <limit lower='-2' upper='2' effort='10' velocity='1'/></joint>"
        )
    };
    let urdf = format!(
        "<robot name='arm'>{}{}{}{}{}{}{}{}{}</robot>",
        link("base"),
        link("upper"),
        link("hand"),
        link("left"),
        link("right"),
        joint("turn", "revolute", "base", "upper"),
        joint("bend", "revolute", "upper", "hand"),
        joint("finger_left", "prismatic", "hand", "left"),
        joint("finger_right", "prismatic", "hand", "right"),
    );
    std::fs::write(folder.join("object.urdf"), urdf).unwrap();
    let document = "schema: 1\nname: arm\nrobot:\n  arm_joints: [turn, bend]\n  wrist_link: hand\n  configurations: [{name: ready, q: [0, 0]}]\n  \
        gripper: {link: hand, X_LT: {xyz: [0, 0, 0.1]}, fingers: [{joint: finger_left, link: left}, {joint: finger_right, link: right}], \
        max_width: 0.08, max_force: 40, pad_half_extents: [0.01, 0.01]}\n  \
        camera: {link: hand, X_LC: {xyz: [0.05, 0, 0]}, size: [4, 3], focal: [4, 4], center: [1.5, 1], range: [0.1, 2]}\n";
    std::fs::write(folder.join("model.yaml"), document).unwrap();
    ObjectModel::read(folder).unwrap()
}

/// A scene with the robot's model in a folder.
fn scene(folder: &Path) -> Scene {
    Scene { robot: Arc::new(robot(folder)), start: "ready".into(), table_height: 0.0, objects: Vec::new() }
}

fn record() -> RunRecord {
    RunRecord {
        program: "sagci 0.1.0".into(),
        script: "warm.rhai".into(),
        text: "open(oven);\n".into(),
        seed: 5,
        world: "noise".into(),
        period: 0.001,
        models: vec![Versioned { name: "arm".into(), version: "1".into(), sha256: "ab".into() }],
        skills: vec![Versioned { name: "open".into(), version: "0.1.0".into(), sha256: "cd".into() }],
    }
}

fn command(i: u64) -> Command {
    let x = (i as f64 * 0.37).sin() * 12.3;
    Command { tau: vec![x, -x / 3.0], gripper: GripperCommand { width: 0.04 + x * 1e-3, force: 20.0 } }
}

/// Runs for so many periods, and gives what was measured at each of them.
fn run(path: &Path, periods: u64, close: bool) -> Vec<Observation> {
    let mut world = recorded(Noise::new(2), path, &record()).unwrap();
    let journal = world.journal();
    world.reset(&scene(path.parent().unwrap()), 5).unwrap();
    let mut measured = vec![world.observe()];
    for i in 0..periods {
        if i % 500 == 100 {
            journal.phase(1, "open", &format!("phase {}", i / 500), i as f64 / periods as f64);
            journal.log(Level::Warning, "open", "the handle is warm");
            world.look().unwrap();
        }
        world.advance(&command(i)).unwrap();
        measured.push(world.observe());
    }
    if close {
        journal.close(&Outcome { success: true, message: "all done".into(), report: serde_json::json!({ "steps": 1 }) }).unwrap();
    }
    measured
}

fn in_folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep/er/run.mcap");
    (folder, path)
}

#[test]
fn what_is_read_is_what_was_measured_and_commanded() {
    let (_folder, path) = in_folder();
    let measured = run(&path, 2000, true);
    let r = Recording::open(&path).unwrap();
    assert_eq!(r.record, record());
    assert_eq!(r.outcome.as_ref().map(|o| (o.success, o.message.as_str())), Some((true, "all done")));
    assert_eq!(r.cut, None);
    assert_eq!(r.intact, Some(true));
    assert_eq!(r.truth_intact, Some(true));
    // Every command of every period, bit for bit: a run can be repeated by them.
    assert_eq!(r.commands.len(), 2000);
    for (i, (t, c)) in r.commands.iter().enumerate() {
        assert!((t - i as f64 * 0.001).abs() < 1e-9);
        assert_eq!(*c, command(i as u64));
    }
    // States at 250 Hz, each exactly what was measured then.
    assert_eq!(r.observations.len(), 501);
    for o in &r.observations {
        let at = &measured[(o.time * 1000.0).round() as usize];
        assert!((o.time - at.time).abs() < 1e-9);
        assert_eq!((&o.q, &o.v, &o.tau, o.F_S), (&at.q, &at.v, &at.tau, at.F_S));
        assert_eq!((o.gripper_width, o.gripper_force), (at.gripper_width, at.gripper_force));
    }
    assert_eq!(r.phases.len(), 4);
    assert_eq!(r.log[0], Entry { time: 0.1, level: Level::Warning, name: "open".into(), text: "the handle is warm".into() });
    assert_eq!(r.truth.len(), 101);
    assert_eq!(r.truth[50].frames.len(), 4);
    assert!((r.truth[50].joints[1].1 - 0.1 * r.truth[50].time).abs() < 1e-12);
}

#[test]
fn a_run_is_read_as_series_of_its_joints_too() {
    let (folder, path) = in_folder();
    let measured = run(&path, 1000, true);
    let model = robot(folder.path());
    let log = sagci_recording::read(std::slice::from_ref(&path), Some(&model)).unwrap().remove(0);
    let bend = log.joint("bend").unwrap();
    assert_eq!(bend.position.time.len(), 251);
    assert_eq!((bend.position.time[50], bend.position.value[50]), (0.2, measured[200].q[1]));
    assert_eq!(bend.velocity.as_ref().unwrap().value[50], measured[200].v[1]);
    assert_eq!(bend.effort.as_ref().unwrap().value[50], measured[200].tau[1]);
    // The commands of every period.
    let (kind, efforts) = bend.command.as_ref().unwrap();
    assert_eq!((*kind, efforts.value.len()), (sagci_recording::CommandKind::Effort, 1000));
    assert_eq!(bend.command_at(0.3005), Some(command(300).tau[1]));
    let wrist = &log.wrenches[0];
    let F = measured[200].F_S;
    assert_eq!((wrist.link.as_str(), wrist.F_L[50]), ("hand", [F.torque.x, F.torque.y, F.torque.z, F.force.x, F.force.y, F.force.z]));
    assert!(log.notes.iter().any(|n| n.place == "gripper" && n.message.contains("does not have")), "{:?}", log.notes);
}

#[test]
fn a_run_that_is_dropped_leaves_a_whole_file() {
    let (_folder, path) = in_folder();
    run(&path, 700, false);
    let r = Recording::open(&path).unwrap();
    assert_eq!((r.outcome.is_none(), r.cut, r.intact, r.commands.len()), (true, None, Some(true), 700));
}

#[test]
fn a_file_that_is_killed_in_mid_run_is_read_up_to_the_last_half_second() {
    let (_folder, path) = in_folder();
    let mut world = recorded(Noise::new(2), &path, &record()).unwrap();
    world.reset(&scene(path.parent().unwrap()), 5).unwrap();
    for i in 0..3900 {
        world.advance(&command(i)).unwrap();
    }
    // The process ends here, without any clean-up.
    std::fs::copy(&path, path.with_extension("killed")).unwrap();
    let r = Recording::open(path.with_extension("killed")).unwrap();
    assert!(r.commands.len() >= 3400, "only {} of 3900 commands are on disk", r.commands.len());
    assert_eq!((r.intact, r.record), (None, record()));
    assert!(r.cut.is_some());
}

#[test]
fn a_file_cut_anywhere_is_read_up_to_the_cut_and_says_where() {
    let (_folder, path) = in_folder();
    run(&path, 1500, true);
    let whole = std::fs::read(&path).unwrap();
    let all = Recording::open(&path).unwrap();
    let cut_path = path.with_extension("cut");
    let mut last = 0;
    for k in 0..60 {
        let length = whole.len() * k / 60;
        std::fs::write(&cut_path, &whole[..length]).unwrap();
        match Recording::open(&cut_path) {
            Ok(r) => {
                let cut = r.cut.as_ref().unwrap_or_else(|| panic!("cut after {length} of {} bytes, and nobody noticed", whole.len()));
                assert!(cut.offset as usize <= length);
                assert_eq!(r.record, all.record);
                assert_eq!(r.observations[..], all.observations[..r.observations.len()]);
                assert!(r.commands.len() >= last, "a longer file gives less");
                last = r.commands.len();
            }
            Err(e) => {
                assert!(length < 1200, "cut after {length} bytes: {e}");
                assert!(e.to_string().contains("at byte"), "{e}");
            }
        }
    }
    assert_eq!(last, 1500);
}

#[test]
fn a_changed_byte_never_passes_as_what_was_recorded() {
    let (_folder, path) = in_folder();
    run(&path, 800, true);
    let whole = std::fs::read(&path).unwrap();
    let all = Recording::open(&path).unwrap();
    let changed = path.with_extension("changed");
    let mut random = Pcg64::seed_from_u64(3);
    for _ in 0..150 {
        let mut bytes = whole.clone();
        let at = random.random_range(0..bytes.len());
        bytes[at] ^= 1 << random.random_range(0..8);
        std::fs::write(&changed, &bytes).unwrap();
        if let Ok(r) = Recording::open(&changed) {
            let same = r.observations == all.observations && r.commands == all.commands && r.truth == all.truth;
            assert!(same || r.intact != Some(true), "byte {at} was changed, and nobody noticed");
        }
    }
}

#[test]
fn what_is_no_recording_is_refused_with_the_place() {
    let (_folder, path) = in_folder();
    run(&path, 10, true);
    let other = path.with_extension("other");
    let refused = |bytes: &[u8]| {
        std::fs::write(&other, bytes).unwrap();
        Recording::open(&other).unwrap_err().to_string()
    };
    assert!(refused(b"").contains("at byte 0"));
    assert!(refused(b"not an mcap file at all").contains("magic"));
    assert!(Recording::open(path.with_extension("missing")).unwrap_err().to_string().contains("run.missing"));

    // A channel of ours with another schema.
    let mut writer = mcap::WriteOptions::new().compression(None).create(std::io::Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/Joy", "ros2msg", b"").unwrap();
    writer.add_channel(schema, "/joint_states", "cdr", &Default::default()).unwrap();
    let channel = writer.add_channel(schema, "/joint_states", "cdr", &Default::default()).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, &[0, 1, 0, 0]).unwrap();
    writer.finish().unwrap();
    let message = refused(&writer.into_inner().into_inner());
    assert!(
        message.contains("sensor_msgs/msg/Joy") && message.contains("sensor_msgs/msg/JointState") && message.contains("at byte"),
        "{message}"
    );
}

#[test]
fn a_second_run_in_one_file_is_refused() {
    let (_folder, path) = in_folder();
    let mut world = recorded(Noise::new(2), &path, &record()).unwrap();
    world.reset(&scene(path.parent().unwrap()), 5).unwrap();
    let error = world.reset(&scene(path.parent().unwrap()), 6).unwrap_err().to_string();
    assert!(error.contains("one run"), "{error}");
}

#[test]
fn an_error_of_the_world_passes_through_and_is_logged() {
    let (_folder, path) = in_folder();
    let mut world = recorded(Noise::new(2), &path, &record()).unwrap();
    world.reset(&scene(path.parent().unwrap()), 5).unwrap();
    let bad = Command { tau: vec![f64::NAN, 0.0], gripper: GripperCommand::default() };
    assert!(world.advance(&bad).is_err());
    drop(world);
    let r = Recording::open(&path).unwrap();
    assert!(r.log.iter().any(|e| e.level == Level::Error && e.text.contains("not a number")), "{:?}", r.log);
}

#[test]
fn replay_shows_phases_joints_and_objects_and_says_whether_the_frames_are_those_recorded() {
    let (_folder, path) = in_folder();
    run(&path, 3000, true);
    let mut out = Vec::new();
    let replayed = replay_states(&path, &mut out).unwrap();
    let text = String::from_utf8(out).unwrap();
    assert_eq!((replayed.frames, replayed.intact), (151, Some(true)));
    for needed in [
        "step 1 open: phase 3",
        "oven/hinge 0.2",
        "cup (-2.",
        "warning: open: the handle is warm",
        "done: all done",
        "they equal what was recorded",
    ] {
        assert!(text.contains(needed), "'{needed}' is missing in\n{text}");
    }
    // The robot's own true joints are not repeated: its encoders are shown.
    assert!(!text.contains("arm/turn"), "{text}");
}

#[test]
fn a_minute_at_full_rate_stays_small_and_costs_little() {
    let (_folder, path) = in_folder();
    let start = std::time::Instant::now();
    run(&path, 6000, true);
    let seconds = start.elapsed().as_secs_f64();
    let megabytes = std::fs::metadata(&path).unwrap().len() as f64 / 1e6;
    println!("6 s at 1 kHz: {megabytes:.2} MB, {seconds:.3} s");
    assert!(megabytes < 6.0, "6 s take {megabytes} MB");
}
