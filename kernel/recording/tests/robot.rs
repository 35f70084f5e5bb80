//! MCAP: files as ROS 2 records them, whole, packed and cut.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

mod common;

use common::{Bag, Files, has_note, rows, state, swing};
use mcap::Compression;
use mcap::records::op;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_recording::{CommandKind, JointState, Series, WrenchStamped, read};

const MS: u64 = 1_000_000;

/// The same swing, 100 Hz, as CSV and as messages.
fn swing_csv(count: usize) -> String {
    rows("hinge.position,hinge.velocity,hinge.effort", count, |i, t| format!("{},{},{}", swing(t), 2.1 * (3.0 * t).cos(), i))
}

fn swing_state(i: usize) -> JointState {
    let t = i as f64 * 0.01;
    state(i as u64 * 10 * MS, &["hinge"], &[swing(t)], &[2.1 * (3.0 * t).cos()], &[i as f64])
}

fn swing_bag(count: usize, compression: Option<Compression>) -> Vec<u8> {
    let mut bag = Bag::new(compression);
    for i in 0..count {
        bag.state("/joint_states", 7, &swing_state(i));
    }
    bag.finish()
}

/// A message of a machine that writes its numbers the other way round.
fn big_endian(s: &JointState) -> Vec<u8> {
    fn align(bytes: &mut Vec<u8>, to: usize) {
        let at = bytes.len() - 4;
        bytes.resize(4 + at.next_multiple_of(to), 0);
    }
    let mut b = vec![0, 0, 0, 0];
    b.extend(((s.time / 1_000_000_000) as u32).to_be_bytes());
    b.extend(((s.time % 1_000_000_000) as u32).to_be_bytes());
    let text = |b: &mut Vec<u8>, t: &str| {
        align(b, 4);
        b.extend((t.len() as u32 + 1).to_be_bytes());
        b.extend(t.as_bytes());
        b.push(0);
    };
    text(&mut b, "base");
    align(&mut b, 4);
    b.extend((s.name.len() as u32).to_be_bytes());
    s.name.iter().for_each(|n| text(&mut b, n));
    for list in [&s.position, &s.velocity, &s.effort] {
        align(&mut b, 4);
        b.extend((list.len() as u32).to_be_bytes());
        for v in list {
            align(&mut b, 8);
            b.extend(v.to_be_bytes());
        }
    }
    b
}

/// The same file with its chunks packed by zstd.
fn with_zstd(bytes: &[u8]) -> Vec<u8> {
    let (mut out, mut at) = (bytes[..8].to_vec(), 8);
    while bytes.len() - at > 8 {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let (head, body) = (&bytes[at..at + 9], &bytes[at + 9..at + 9 + length]);
        if head[0] == op::CHUNK {
            // Unpacked: times, size and checksum, an empty name, the size again, records.
            assert_eq!(body[28..32], [0; 4]);
            let packed = ruzstd::encoding::compress_to_vec(&body[40..], ruzstd::encoding::CompressionLevel::Fastest);
            let mut chunk = body[..28].to_vec();
            chunk.extend([4, 0, 0, 0]);
            chunk.extend(b"zstd");
            chunk.extend((packed.len() as u64).to_le_bytes());
            chunk.extend(packed);
            out.push(op::CHUNK);
            out.extend((chunk.len() as u64).to_le_bytes());
            out.extend(chunk);
        } else {
            out.extend(head);
            out.extend(body);
        }
        at += 9 + length;
    }
    out.extend(&bytes[at..]);
    out
}

#[test]
fn messages_give_the_same_series_as_text_whatever_the_packing_and_byte_order() {
    let files = Files::new();
    let expected = files.read(swing_csv(400)).unwrap().joints;
    let whole = swing_bag(400, None);
    let mut big = Bag::new(None);
    for i in 0..400 {
        big.message("/joint_states", JointState::SCHEMA, "cdr", 0, &big_endian(&swing_state(i)));
    }
    let packed = with_zstd(&whole);
    assert!(packed.len() < whole.len());
    for (name, bytes) in
        [("unpacked", whole), ("LZ4", swing_bag(400, Some(Compression::Lz4))), ("zstd", packed), ("big-endian", big.finish())]
    {
        let log = files.read(bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(log.joints == expected, "{name}");
    }
}

#[test]
fn a_file_that_was_cut_off_is_read_up_to_there_and_says_so() {
    let files = Files::new();
    let plain = swing_bag(400, None);
    let all = files.read(&plain).unwrap().joints.remove(0).position;
    for (name, whole) in [("LZ4", swing_bag(400, Some(Compression::Lz4))), ("zstd", with_zstd(&plain)), ("unpacked", plain)] {
        let mut read = 0;
        for k in 1..40 {
            let Ok(log) = files.read(&whole[..whole.len() * k / 40]) else {
                assert!(read == 0, "{name}: a longer file gives less");
                continue;
            };
            let position = &log.joints[0].position;
            let count = position.time.len();
            assert_eq!((&position.time[..], &position.value[..]), (&all.time[..count], &all.value[..count]));
            assert!(count >= read, "{name}: {count} after {read}");
            assert!(has_note(&log, &["byte", "ends too early", "read up to there"]), "{name}: {:?}", log.notes);
            read = count;
        }
        assert!(read > 300, "{name}: only {read} of 400 samples of a file that is nearly whole");
    }
}

#[test]
fn a_broken_chunk_is_refused_with_its_place() {
    let files = Files::new();
    let mut bytes = with_zstd(&swing_bag(400, None));
    let packed = bytes.windows(4).position(|w| w == b"zstd").unwrap() + 12;
    bytes[packed + 40..packed + 60].iter_mut().for_each(|b| *b ^= 0x55);
    let message = files.refused(&bytes);
    assert!(message.contains("at byte") && message.contains("chunk"), "{message}");
    // A packing that nobody knows.
    let mut other = with_zstd(&swing_bag(50, None));
    let at = other.windows(4).position(|w| w == b"zstd").unwrap();
    other[at..at + 4].copy_from_slice(b"brot");
    let message = files.refused(&other);
    assert!(message.contains("packed with 'brot'") && message.contains("mcap compress"), "{message}");
}

/// Whatever the bytes are, there is an answer.
#[test]
fn changed_bytes_never_make_the_reader_stumble() {
    let files = Files::new();
    let mut random = Pcg64::seed_from_u64(4);
    let plain = swing_bag(60, None);
    for whole in [with_zstd(&plain), swing_bag(60, Some(Compression::Lz4)), plain] {
        for _ in 0..150 {
            let mut bytes = whole.clone();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..bytes.len());
                bytes[at] = random.random();
            }
            if let Ok(log) = files.read(bytes) {
                log.to_csv();
            }
        }
    }
}

#[test]
fn joints_come_from_several_topics_in_any_order_and_in_parts() {
    let files = Files::new();
    let mut bag = Bag::new(Some(Compression::Lz4));
    for i in 0..100u64 {
        let (time, t) = ((i + 1) * 10 * MS, (i + 1) as f64 * 0.01);
        let both = match i % 3 {
            0 => state(time, &["hinge", "wheel"], &[swing(t), t], &[], &[]),
            1 => state(time, &["wheel", "hinge"], &[t, swing(t)], &[], &[]),
            _ => state(time, &["wheel"], &[t], &[], &[]),
        };
        bag.state("/left/joint_states", time, &both);
        // Efforts from elsewhere; and a second, slower sensor of the same wheel.
        bag.state("/efforts", time, &state(time, &["hinge"], &[], &[], &[t]));
        if i % 10 == 0 {
            bag.state("/slow/joint_states", time, &state(time, &["wheel"], &[100.0], &[], &[]));
        }
        bag.state("/drawer_controller/commands", time, &state(time, &["drawer"], &[0.1 * t], &[], &[f64::NAN]));
        bag.state("/hinge/command", time, &state(time, &["hinge"], &[], &[], &[2.0 * t]));
    }
    let log = files.read(bag.finish()).unwrap();
    let (hinge, wheel, drawer) = (log.joint("hinge").unwrap(), log.joint("wheel").unwrap(), log.joint("drawer").unwrap());
    assert_eq!((hinge.position.time.len(), wheel.position.time.len()), (67, 100));
    assert!(wheel.position.value.iter().all(|w| *w < 2.0), "two sensors were mixed");
    assert!(has_note(&log, &["wheel.position", "/left/joint_states", "/slow/joint_states, left out"]), "{:?}", log.notes);
    assert_eq!(hinge.effort.as_ref().unwrap().value[9], 0.1);
    let (kind, series) = hinge.command.as_ref().unwrap();
    assert_eq!((*kind, series.value[9]), (CommandKind::Effort, 0.2));
    assert_eq!(drawer.command.as_ref().unwrap().0, CommandKind::Position);
}

#[test]
fn a_command_with_both_lists_is_what_the_drive_follows() {
    let files = Files::new();
    let command = |effort: f64| {
        let mut bag = Bag::new(None);
        for i in 0..50u64 {
            let t = i as f64 * 0.01;
            bag.state("/joint_states", 0, &state(i * 10 * MS, &["hinge", "drawer", "wheel"], &[swing(t), 0.1, t], &[], &[]));
            let both = state(i * 10 * MS, &["hinge", "drawer", "wheel"], &[0.5, 0.2, t], &[], &[effort, effort, 0.0]);
            bag.state("/joint_command", 0, &both);
        }
        files.read(bag.finish()).unwrap()
    };
    let log = command(3.0);
    let kinds = ["hinge", "drawer", "wheel"].map(|n| log.joint(n).unwrap().command.as_ref().unwrap().0);
    // By model.yaml the drawer follows positions. The wheel's efforts were never filled in.
    assert_eq!(kinds, [CommandKind::Effort, CommandKind::Position, CommandKind::Position]);
    assert!(has_note(&log, &["hinge", "'command_effort' is taken"]), "{:?}", log.notes);
}

#[test]
fn times_are_the_stamps_and_where_there_are_none_those_of_the_log() {
    let files = Files::new();
    let times = |stamp: fn(u64) -> u64, log_time: fn(u64) -> u64| {
        let mut bag = Bag::new(None);
        for i in 0..60 {
            bag.state("/joint_states", log_time(i), &state(stamp(i), &["hinge"], &[swing(i as f64 * 0.01)], &[], &[]));
        }
        let log = files.read(bag.finish()).unwrap();
        (log.joints[0].position.time[..3].to_vec(), log.epoch, has_note(&log, &["no stamp"]))
    };
    const START: u64 = 1_700_000_000_000_000_000;
    assert_eq!(times(|i| START + i * 10 * MS, |i| START + i * 11 * MS), (vec![0.0, 0.01, 0.02], 1_700_000_000, false));
    assert_eq!(times(|_| 0, |i| START + i * 11 * MS), (vec![0.0, 0.011, 0.022], 1_700_000_000, true));
    // A simulation's clock begins at zero, while the log counts from 1970.
    assert_eq!(times(|i| i * 10 * MS, |i| START + i * 11 * MS), (vec![0.0, 0.01, 0.02], 0, false));
    // Stamped now and then, by the clock of the log.
    let now_and_then = times(|i| if i % 2 == 0 { 0 } else { START + i * 10 * MS }, |i| START + i * 10 * MS);
    assert_eq!(now_and_then, (vec![0.0, 0.01, 0.02], 1_700_000_000, true));
}

#[test]
fn forces_are_read_at_their_links() {
    let files = Files::new();
    let mut bag = Bag::new(None);
    for i in 0..50u64 {
        bag.state("/joint_states", 0, &swing_state(i as usize));
        let force = [i as f64, 2.0, 3.0];
        bag.wrench("/ft_sensor", 0, &WrenchStamped { time: i * 10 * MS, frame: "/door".into(), force, torque: [4.0, 5.0, 6.0] });
        bag.wrench("/other", 0, &WrenchStamped { time: i * 10 * MS, frame: "dor".into(), force, torque: [0.0; 3] });
    }
    let log = files.read(bag.finish()).unwrap();
    let door = log.wrenches.iter().find(|w| w.link == "door").unwrap();
    assert_eq!((door.time[3], door.F_L[3]), (0.03, [4.0, 5.0, 6.0, 3.0, 2.0, 3.0]));
    assert!(has_note(&log, &["dor", "no link of cabinet", "did you mean 'door'?"]), "{:?}", log.notes);
}

/// A joint that a force at a link drives does not move freely.
#[test]
fn a_force_at_a_link_is_what_drives_the_joints_before_it() {
    let files = Files::new();
    let read = |frame: &str| {
        let mut bag = Bag::new(None);
        for i in 0..50u64 {
            let state = swing_state(i as usize);
            bag.state("/joint_states", 0, &JointState { effort: Vec::new(), ..state });
            bag.wrench("/ft_sensor", 0, &WrenchStamped { time: i * 10 * MS, frame: frame.into(), force: [1.0; 3], torque: [0.0; 3] });
        }
        files.read(bag.finish()).unwrap()
    };
    let (door, body) = (read("door"), read("body"));
    let free = ["hinge", "neither a command nor an effort: it is taken as moving freely"];
    assert!(has_note(&door, &["hinge", "force measured at a link behind it"]) && !has_note(&door, &free), "{:?}", door.notes);
    assert!(has_note(&body, &free) && has_note(&body, &["body", "hangs on no joint that moves"]), "{:?}", body.notes);
}

#[test]
fn files_without_joints_say_what_they_hold_and_what_to_record() {
    let files = Files::new();
    let with = |topic: &str, schema: &str, encoding: &str, data: &[u8]| {
        let mut bag = Bag::new(None);
        bag.message(topic, schema, encoding, 0, data);
        files.refused(bag.finish())
    };
    let message = with("/camera", "sensor_msgs/msg/Image", "cdr", &[0; 16]);
    assert!(message.contains("/camera (sensor_msgs/msg/Image, cdr)") && message.contains("ros2 bag record"), "{message}");
    let message = with("/joint_states", JointState::SCHEMA, "json", b"{}");
    assert!(message.contains("JointState, json"), "{message}");
    let message = with("/joint_states", JointState::SCHEMA, "cdr", &[0, 1, 0, 0, 5]);
    assert!(message.contains("no message of /joint_states can be read: message 1"), "{message}");
    assert!(files.refused(Bag::new(None).finish()).contains("holds no message"));
    // A few bad messages among good ones, and commands without names.
    let mut bag = Bag::new(None);
    for i in 0..50 {
        bag.state("/joint_states", 0, &swing_state(i));
    }
    bag.state("/joint_states", 0, &state(1, &["hinge", "wheel"], &[1.0], &[], &[]));
    bag.message("/arm/commands", "std_msgs/msg/Float64MultiArray", "cdr", 0, &[0; 16]);
    let log = files.read(bag.finish()).unwrap();
    assert!(has_note(&log, &["/joint_states", "1 of 51 messages could not be read", "gives 1 positions"]), "{:?}", log.notes);
    assert!(has_note(&log, &["/arm/commands", "Float64MultiArray", "with names"]), "{:?}", log.notes);
    // Names that are not the model's.
    let mut bag = Bag::new(None);
    bag.state("/joint_states", 0, &state(1, &["hnge"], &[1.0], &[], &[]));
    assert!(files.refused(bag.finish()).contains("did you mean 'hinge'?"));
    // Joints of another mechanism beside ours, one with a name that resembles one of ours.
    let mut bag = Bag::new(None);
    for i in 0..50 {
        bag.state("/joint_states", 0, &swing_state(i));
        bag.state("/joint_states", 0, &state(i as u64 * 10 * MS, &["elbow", "wheels"], &[1.0, 2.0], &[], &[]));
    }
    let log = files.read(bag.finish()).unwrap();
    assert!(has_note(&log, &["elbow, wheels", "not used", "is 'wheels' its 'wheel'?"]), "{:?}", log.notes);
    // A clock that was set back.
    let mut bag = Bag::new(None);
    (0..100).chain(0..100).for_each(|i| bag.state("/joint_states", 0, &swing_state(i)));
    let message = files.refused(bag.finish());
    assert!(message.contains("/joint_states, message 101") && message.contains("jumps back"), "{message}");
}

#[test]
fn a_folder_stands_for_its_files_in_the_order_of_their_numbers() {
    let files = Files::new();
    let folder = files.folder.path().join("bag");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("metadata.yaml"), "").unwrap();
    for part in 0..11 {
        let mut bag = Bag::new(Some(Compression::Lz4));
        (part * 20..part * 20 + 20).for_each(|i| bag.state("/joint_states", 0, &swing_state(i)));
        std::fs::write(folder.join(format!("bag_{part}.mcap")), bag.finish()).unwrap();
    }
    let logs = read(&[folder], Some(&files.model)).unwrap();
    assert_eq!(logs.len(), 11);
    assert!(!logs[0].continues && logs[1..].iter().all(|l| l.continues));
    let all: Vec<f64> = logs.iter().flat_map(|l| l.joints[0].position.time.clone()).collect();
    assert_eq!(all, (0..220).map(|i| i as f64 * 10.0 / 1000.0).collect::<Vec<_>>());
    assert_eq!(
        logs[3].joints[0].position,
        Series { time: (60..80).map(|i| i as f64 / 100.0).collect(), value: (60..80).map(|i| swing(i as f64 * 0.01)).collect() }
    );
}

#[test]
fn numbers_that_are_none_in_a_list_are_said() {
    let files = Files::new();
    let mut bag = Bag::new(None);
    for i in 0..100 {
        let (time, t) = (i as u64 * 10 * MS, i as f64 * 0.01);
        let position = if i % 10 == 3 { f64::NAN } else { swing(t) };
        bag.state("/joint_states", time, &state(time, &["hinge"], &[position], &[], &[if i == 5 { 1e300 } else { t }]));
        bag.state("/hinge/command", time, &state(time, &["hinge"], &[f64::NAN], &[], &[t]));
    }
    let log = files.read(bag.finish()).unwrap();
    assert!(has_note(&log, &["hinge.position", "10 values are not a number"]), "{:?}", log.notes);
    assert!(has_note(&log, &["hinge.effort", "1 values are infinite or larger"]), "{:?}", log.notes);
    assert_eq!((log.joints[0].position.time.len(), log.joints[0].effort.as_ref().unwrap().time.len()), (90, 99));
    // A list that nobody filled in is none of numbers that are missing.
    assert!(!has_note(&log, &["command", "not a number"]), "{:?}", log.notes);
}
