//! CSV: what is read, and what is said about what is wrong with it.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

mod common;

use common::{Files, has_note, rows, swing};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_recording::{Angles, CommandKind, LARGEST_FILE, Lengths, Options, RecordingError, Series, read, read_with};

#[test]
fn every_channel_is_read_with_times_of_its_own() {
    let files = Files::new();
    let log = files
        .read(
            "time,hinge.position,hinge.velocity,hinge.effort,drawer.position,drawer.command_position\n\
             0,0.1,,1.5,0.1,0.2\n0.01,0.2,0.5,,,\n0.02,0.4,0.7,1.6,0.3,0.3\n",
        )
        .unwrap();
    let hinge = log.joint("hinge").unwrap();
    assert_eq!(hinge.position, Series { time: vec![0.0, 0.01, 0.02], value: vec![0.1, 0.2, 0.4] });
    assert_eq!(hinge.velocity, Some(Series { time: vec![0.01, 0.02], value: vec![0.5, 0.7] }));
    assert_eq!(hinge.effort, Some(Series { time: vec![0.0, 0.02], value: vec![1.5, 1.6] }));
    let drawer = log.joint("drawer").unwrap();
    // A commanded position that is not repeated goes on to act.
    assert_eq!(drawer.command, Some((CommandKind::Position, Series { time: vec![0.0, 0.02], value: vec![0.2, 0.3] })));
    assert_eq!((drawer.command_at(0.015), drawer.command_at(-1.0)), (Some(0.2), None));
    assert!(drawer.command_gaps.is_empty());
}

#[test]
fn files_as_spreadsheets_write_them_give_the_same_series() {
    let files = Files::new();
    let plain = rows("hinge.position,hinge.effort", 50, |_, t| format!("{},{}", swing(t), t));
    let log = files.read(&plain).unwrap();
    let same = |name: &str, text: String| {
        let other = files.read(text).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(other.joints, log.joints, "{name}");
        assert_ne!(other.hash, log.hash, "{name}: the hash is that of the bytes");
    };
    same("byte order mark", format!("\u{feff}{plain}"));
    same("CRLF", plain.replace('\n', "\r\n"));
    same("CR alone", plain.replace('\n', "\r"));
    same("spaces", plain.replace(',', " , "));
    same("comments and empty lines", plain.replacen('\n', "\n# made by hand\n\n", 3).replacen("time", "# first\n\ntime", 1));
    same("semicolons and decimal commas", plain.replace(',', ";").replace("0.", "0,"));
    same("semicolons", plain.replace(',', ";"));
    same("tabs", plain.replace(',', "\t"));
    let quoted = |l: &str| l.split(',').map(|c| format!("\"{c}\"")).collect::<Vec<_>>().join(",") + "\n";
    same("quotes", plain.lines().map(quoted).collect());
    same(
        "other columns",
        plain.lines().enumerate().map(|(i, l)| format!("{l},{}\n", if i == 0 { "temperature" } else { "21.5" })).collect(),
    );
    same("columns in another order", {
        let turned = |l: &str| l.rsplit(',').collect::<Vec<_>>().join(",") + "\n";
        plain.lines().map(turned).collect()
    });
}

#[test]
fn an_empty_voltage_is_an_open_circuit() {
    let files = Files::new();
    let text = "time,wheel.position,wheel.command_voltage\n0,0,1\n1,1,2\n2,2,\n3,3,\n4,2,5\n5,1,nan\n6,0,\n";
    let log = files.read(text).unwrap();
    let wheel = log.joint("wheel").unwrap();
    assert_eq!(wheel.command, Some((CommandKind::Voltage, Series { time: vec![0.0, 1.0, 4.0], value: vec![1.0, 2.0, 5.0] })));
    assert_eq!(wheel.command_gaps, [[2.0, 4.0], [5.0, f64::INFINITY]]);
    let acting: Vec<_> = [0.5, 1.9, 2.0, 3.9, 4.0, 4.9, 5.0, 9.0].iter().map(|t| wheel.command_at(*t)).collect();
    assert_eq!(acting, [Some(1.0), Some(2.0), None, None, Some(5.0), Some(5.0), None, None]);
    // No voltage at all: the drive was off throughout, which is not the same as nothing being known.
    let off = files.read("time,wheel.position,wheel.command_voltage\n0,0,\n1,1,\n2,0,\n").unwrap();
    assert_eq!(off.joints[0].command_gaps, [[0.0, f64::INFINITY]]);
    assert!(off.joints[0].command.is_some());
}

/// Series of random instants, sparse, with gaps: what is read from what was written is the same again.
#[test]
fn what_is_written_reads_the_same() {
    let files = Files::new();
    let mut random = Pcg64::seed_from_u64(11);
    for case in 0..60 {
        let mut text = String::from(
            "time,hinge.position,hinge.velocity,drawer.position,drawer.effort,drawer.command_effort,wheel.position,wheel.command_voltage\n",
        );
        let mut time = if case % 3 == 0 { 1_700_000_000_123_456_789i64 } else { -500_000_000 };
        for _ in 0..random.random_range(2..60) {
            time += random.random_range(1..20_000_000);
            let sign = if time < 0 { "-" } else { "" };
            text += &format!("{sign}{}.{:09}", time.abs() / 1_000_000_000, time.abs() % 1_000_000_000);
            for column in 0..7 {
                let scale = 10f64.powi(random.random_range(-12..0));
                let value = random.random::<f64>() * if column == 4 { scale } else { 0.39 };
                match random.random_range(0..4) {
                    0 => text.push(','),
                    1 => text += &format!(",{value:e}"),
                    _ => text += &format!(",{value}"),
                }
            }
            text.push('\n');
        }
        let read_again = |text: &str| match files.read(text) {
            Ok(log) => Some(log),
            Err(RecordingError::Still { .. }) => None,
            Err(e) => panic!("{e}\n{text}"),
        };
        let Some(first) = read_again(&text) else { continue };
        let second = read_again(&first.to_csv()).unwrap();
        assert_eq!((&second.joints, second.epoch), (&first.joints, first.epoch), "\n{text}\n{}", first.to_csv());
        assert_eq!(second.to_csv(), first.to_csv());
    }
}

#[test]
fn seconds_since_1970_keep_their_nanoseconds() {
    let files = Files::new();
    let log = files.read("time,wheel.position\n1700000012.000000001,0\n1700000012.000000002,1\n1700000012.5,2\n").unwrap();
    assert_eq!((log.epoch, &log.joints[0].position.time), (1_700_000_012, &vec![1e-9, 2e-9, 0.5]));
}

#[test]
fn rows_in_another_order_are_set_in_order_and_the_last_of_equal_times_is_kept() {
    let files = Files::new();
    let sorted = rows("hinge.position", 300, |_, t| swing(t).to_string());
    let expected = files.read(&sorted).unwrap().joints;
    let lines: Vec<&str> = sorted.lines().collect();
    let mut random = Pcg64::seed_from_u64(5);
    let mut shuffled = lines[1..].to_vec();
    for i in (1..shuffled.len()).rev() {
        shuffled.swap(i, random.random_range(0..=i));
    }
    let mut halves = lines[151..].to_vec();
    halves.extend(&lines[1..151]);
    let mut pair = lines[1..].to_vec();
    pair.swap(100, 101);
    for (name, rows) in [("shuffled", shuffled), ("halves", halves), ("a pair", pair)] {
        let log = files.read(format!("{}\n{}\n", lines[0], rows.join("\n"))).unwrap();
        assert_eq!(log.joints, expected, "{name}");
        assert!(has_note(&log, &["put in order", "line"]), "{name}: {:?}", log.notes);
    }
    let log = files.read("time,hinge.position\n0,0\n0.1,0.5\n0.1,0.6\n0.2,1\n").unwrap();
    assert_eq!(log.joints[0].position, Series { time: vec![0.0, 0.1, 0.2], value: vec![0.0, 0.6, 1.0] });
    assert!(has_note(&log, &["1 samples repeat", "last one is kept"]), "{:?}", log.notes);
}

#[test]
fn two_recordings_in_one_file_are_not_mixed() {
    let files = Files::new();
    let once = rows("hinge.position", 100, |_, t| swing(t).to_string());
    let twice = format!("{once}{}", once.split_once('\n').unwrap().1);
    let message = files.refused(twice);
    assert!(message.contains("line 102") && message.contains("jumps back by 0.990 s") && message.contains("file of its own"), "{message}");
}

#[test]
fn cells_that_are_not_a_number_are_missing_and_that_is_said() {
    let files = Files::new();
    let log = files.read("time,hinge.position,hinge.effort\n0,0,nan\n1,NaN,1\n2,inf,2\nnan,1,1\n3,1,\n").unwrap();
    let hinge = &log.joints[0];
    assert_eq!(hinge.position, Series { time: vec![0.0, 3.0], value: vec![0.0, 1.0] });
    assert_eq!(hinge.effort, Some(Series { time: vec![1.0, 2.0], value: vec![1.0, 2.0] }));
    assert!(has_note(&log, &["2 cells", "NaN"]) && has_note(&log, &["1 values are infinite", "hinge.position"]), "{:?}", log.notes);
    assert!(has_note(&log, &["1 rows have no time", "line 5"]), "{:?}", log.notes);
}

#[test]
fn lines_that_lie_are_refused_with_their_number() {
    let files = Files::new();
    for (text, words) in [
        ("time,hinge.position\n0,0\n1,1,1\n2,0\n", ["log:3: ", "3 cells", "2 columns"]),
        ("# a remark\ntime,hinge.position\n0,0\n1\n2,0\n", ["log:4: ", "1 cells", "2 columns"]),
        ("time,hinge.position\n0,0\n1,1.0.0\n", ["log:3: ", "(hinge.position)", "'1.0.0', which is no number"]),
        ("time,hinge.position\n0,0\nsoon,1\n", ["log:3: ", "(time)", "'soon', which is no time"]),
        ("time,hinge.position\n1700000000000000000,0\n", ["log:2: ", "(time)", "times are in seconds"]),
        ("time,hinge.position\n0,\"1\n", ["log:2: ", "quote", "closing"]),
        ("# angles: gon\ntime,hinge.position\n0,0\n", ["log:1: ", "'rad' or 'deg'", "'gon'"]),
    ] {
        let message = files.refused(text);
        assert!(words.iter().all(|w| message.contains(w)), "{text:?}: {message}");
    }
}

#[test]
fn half_a_line_at_the_end_is_left_out() {
    let files = Files::new();
    let log = files.read("time,hinge.position,hinge.effort\n0,0,1\n1,1,1\n2,0.").unwrap();
    assert_eq!(log.joints[0].position.time, [0.0, 1.0]);
    assert!(has_note(&log, &["line 4", "the file ends in it"]), "{:?}", log.notes);
}

#[test]
fn headers_that_say_something_else_are_refused_with_what_was_meant() {
    let files = Files::new();
    for (header, words) in [
        ("t,hinge.position", vec!["log:1: ", "no column 'time'", "is it 't'?"]),
        ("tme,hinge.position", vec!["no column 'time'", "is it 'tme'?"]),
        ("0,0.5", vec!["no column 'time'", "it reads: 0, 0.5"]),
        ("time,hinge.positon", vec!["'positon', which is not known", "did you mean 'position'?"]),
        ("time,hinge.angle", vec!["'angle', which is not known", "there are: position, velocity, effort, command_effort"]),
        ("time,position", vec!["names no joint", "JOINT.position"]),
        ("time,.position", vec!["names no joint"]),
        ("time,hinge.position,hinge.position", vec!["'hinge.position' twice"]),
        ("time,hinge.position,hinge.command_effort,hinge.command_voltage", vec!["both 'hinge.command_effort'", "keep the one"]),
        ("time,temperature", vec!["names no joint"]),
        ("time,hinges.position", vec!["'hinges', which cabinet does not have", "did you mean 'hinge'?"]),
        ("time,hinge.position,drawr.position", vec!["'drawr'", "did you mean 'drawer'?"]),
        ("time,hinje.position,hinge.command_effort", vec!["'hinje', which cabinet does not have", "did you mean 'hinge'?"]),
        ("time,elbow.position", vec!["measures elbow", "there are: hinge, drawer, wheel"]),
    ] {
        let columns = header.split(',').count();
        let row = |i: usize| vec![(i as f64 * 0.1).to_string(); columns].join(",");
        let message = files.refused(format!("{header}\n{}\n{}\n{}\n", row(0), row(1), row(2)));
        assert!(words.iter().all(|w| message.contains(w)), "{header}: {message}");
    }
}

#[test]
fn files_that_are_no_recordings_are_told_apart() {
    let files = Files::new();
    for (bytes, words) in [
        (&b""[..], "is empty"),
        (b"\n\n", "holds no header"),
        (b"time,hinge.position\n", "no row with a time"),
        (b"SQLite format 3\0...", "ros2 bag convert"),
        (b"#ROSBAG V2.0\n", "ROS 1"),
        (&[0x28, 0xB5, 0x2F, 0xFD, 1, 2], "zstd -d"),
        (&[0x1F, 0x8B, 8], "unpack it"),
        (&[0xFF, 0xFE, b't', 0], "UTF-16"),
        (b"\0\x01\x02 binary", "neither an MCAP file"),
        (b"time,hinge.position\n0,0\n1,\xE9\n", "log:3: is not UTF-8"),
        (b"{\"time\": [0, 1]}", "no column 'time'"),
        (&[0x89, b'M'], "ends before it has begun"),
    ] {
        let message = files.refused(bytes);
        assert!(message.contains(words), "{bytes:?}: {message}");
    }
    let missing = read(&[files.folder.path().join("gone.csv")], None).unwrap_err().to_string();
    assert!(missing.contains("gone.csv"), "{missing}");
    assert!(read(&[], None).unwrap_err().to_string().contains("name at least one"));
    let empty = files.folder.path().join("bag");
    std::fs::create_dir(&empty).unwrap();
    assert!(read(&[empty], None).unwrap_err().to_string().contains("folder without MCAP files"));
    // A sparse file: as large as it says, and nothing on disk.
    let huge = files.write("huge.csv", "time,hinge.position\n");
    std::fs::File::options().write(true).open(&huge).unwrap().set_len(LARGEST_FILE + 1).unwrap();
    let message = read(&[huge], None).unwrap_err().to_string();
    assert!(message.contains("larger than the 1024 MiB"), "{message}");
}

#[test]
fn degrees_are_asked_back_about_and_converted_only_when_told() {
    let files = Files::new();
    let degrees = rows("hinge.position,hinge.velocity,hinge.command_position", 200, |_, t| {
        format!("{},{},{}", swing(t).to_degrees(), (2.1 * (3.0 * t).cos()).to_degrees(), 45.0)
    });
    let message = files.refused(&degrees);
    assert!(message.contains("hinge: positions go from 5.7") && message.contains("look like degrees"), "{message}");
    assert!(message.contains("--angles deg") && message.contains("--angles rad") && message.contains("# angles: deg"), "{message}");
    let path = files.write("degrees.csv", &degrees);
    let as_told =
        |angles| read_with(std::slice::from_ref(&path), Some(&files.model), &Options { angles, ..Options::default() }).unwrap().remove(0);
    let converted = as_told(Angles::Degrees);
    let hinge = converted.joint("hinge").unwrap();
    assert!((hinge.position.value[50] - swing(0.5)).abs() < 1e-12);
    assert!((hinge.velocity.as_ref().unwrap().value[0] - 2.1).abs() < 1e-12);
    assert!((hinge.command.as_ref().unwrap().1.value[0] - 45f64.to_radians()).abs() < 1e-12);
    assert!(has_note(&converted, &["converted to rad"]));
    assert!((as_told(Angles::Radians).joints[0].position.value[50] - swing(0.5).to_degrees()).abs() < 1e-12);
    let own_word = files.read(format!("# angles: deg\n{degrees}")).unwrap();
    assert_eq!(own_word.joints, converted.joints);
    // A door that gives a little beyond its stop is not in degrees, nor is a drawer's way in m.
    files.read(rows("hinge.position", 100, |i, _| (i as f64 * 0.017).to_string())).unwrap();
    let message = files.refused(rows("drawer.position", 100, |i, _| (i as f64 * 4.0).to_string()));
    assert!(message.contains("millimetres"), "{message}");
    let message = files.refused(rows("wheel.position", 1000, |_, t| (60.0 * (4.0 * t).cos()).to_string()));
    assert!(message.contains("wheel: turns from -5") && message.contains("look like degrees"), "{message}");
    let far = files.read(rows("wheel.position", 100, |i, _| (i as f64).to_string())).unwrap();
    assert!(has_note(&far, &["wheel", "if these are degrees"]), "{:?}", far.notes);
}

/// As many drives report them, within half a turn to both sides: taken as they stand the wheel would leap.
#[test]
fn turns_of_an_encoder_that_starts_anew_are_counted_on() {
    use std::f64::consts::{PI, TAU};
    let files = Files::new();
    let way = |t: f64| 9.0 * (1.1 * t).sin() + 2.0 * t;
    let within = |y: f64| (y + PI).rem_euclid(TAU) - PI;
    let log = files.read(rows("wheel.position,wheel.effort", 500, |_, t| format!("{},{t}", within(way(t))))).unwrap();
    let wheel = log.joint("wheel").unwrap();
    assert!(wheel.position.time.iter().zip(&wheel.position.value).all(|(t, y)| (y - way(*t)).abs() < 1e-9));
    assert!(has_note(&log, &["wheel", "starts anew after each turn", "counted on"]), "{:?}", log.notes);
    // What goes past a turn is counted already, and a door does not turn round.
    let counted = files.read(rows("wheel.position", 500, |_, t| way(t).to_string())).unwrap();
    assert!((counted.joints[0].position.value[300] - way(3.0)).abs() < 1e-9 && !has_note(&counted, &["starts anew"]));
}

#[test]
fn what_never_moves_is_refused_with_what_to_measure_instead() {
    let files = Files::new();
    let mut random = Pcg64::seed_from_u64(2);
    let noise: Vec<f64> = (0..500).map(|_| 1e-4 * (random.random::<f64>() - 0.5)).collect();
    for still in [rows("hinge.position", 500, |_, _| "0.3".into()), rows("hinge.position", 500, |i, _| (0.3 + noise[i]).to_string())] {
        let message = files.refused(still);
        assert!(message.contains("hinge never moves") && message.contains("gap --experiment"), "{message}");
    }
    // A millimetre of slow motion beyond the noise counts.
    files.read(rows("drawer.position", 500, |i, _| (0.1 + 1e-3 * (i as f64 / 500.0) + noise[i]).to_string())).unwrap();
    // One joint at rest beside one that moves is a note.
    let log = files.read(rows("hinge.position,drawer.position", 500, |i, t| format!("{},{}", swing(t), 0.1 + noise[i]))).unwrap();
    assert!(has_note(&log, &["drawer", "never moves"]), "{:?}", log.notes);
}

#[test]
fn dead_channels_and_missing_efforts_are_said() {
    let files = Files::new();
    let log = files.read(rows("hinge.position,hinge.velocity,hinge.effort", 100, |_, t| format!("{},0,0", swing(t)))).unwrap();
    let hinge = log.joint("hinge").unwrap();
    assert!(hinge.velocity.is_none() && hinge.effort.is_some());
    assert!(has_note(&log, &["hinge.velocity", "left out"]) && has_note(&log, &["hinge.effort", "is 0 throughout"]), "{:?}", log.notes);
    assert!(has_note(&log, &["hinge", "effort but no command", "cannot be seen"]));
    // A velocity that is constant because the motion is steady stays.
    let steady = files.read(rows("wheel.position,wheel.velocity", 100, |_, t| format!("{},1.5", 1.5 * t))).unwrap();
    assert!(steady.joints[0].velocity.is_some(), "{:?}", steady.notes);
    assert!(has_note(&steady, &["wheel", "neither a command nor an effort", "can still be found"]));
    let unmeasured = files.read(rows("hinge.position,wheel.effort", 100, |_, t| format!("{},1", swing(t)))).unwrap();
    assert!(has_note(&unmeasured, &["wheel", "no measured position"]), "{:?}", unmeasured.notes);
}

#[test]
fn times_that_run_on_are_one_session() {
    let files = Files::new();
    let part = |from: f64| {
        rows("hinge.position", 100, |_, t| swing(t).to_string()).lines().enumerate().fold(String::new(), |text, (i, l)| {
            let (t, q) = l.split_once(',').unwrap();
            text + &if i == 0 { l.to_owned() } else { format!("{},{q}", t.parse::<f64>().unwrap() + from) } + "\n"
        })
    };
    let paths = [("a.csv", 0.0), ("b.csv", 1.0), ("c.csv", 31.0), ("d.csv", 0.5), ("e.csv", 5000.0)]
        .map(|(name, from)| files.write(name, part(from)));
    let logs = read(&paths, Some(&files.model)).unwrap();
    assert_eq!(logs.iter().map(|l| l.continues).collect::<Vec<_>>(), [false, true, true, false, false]);
    // One clock for all: what was taken off is the same.
    let late = [("f.csv", 1.7e9), ("g.csv", 1.7e9 + 1.0)].map(|(name, from)| files.write(name, part(from)));
    let logs = read(&late, Some(&files.model)).unwrap();
    assert_eq!((logs[0].epoch, logs[1].epoch, logs[1].continues), (1_700_000_000, 1_700_000_000, true));
    assert!((logs[1].joints[0].position.time[0] - 1.0).abs() < 1e-6);
}

/// Whatever the bytes are, there is an answer.
#[test]
fn changed_bytes_never_make_the_reader_stumble() {
    const LETTERS: &[u8] = b"0123456789,.;-+e\"\n#\r nai\0\xFF";
    let files = Files::new();
    let whole = format!(
        "# angles: rad\n{}",
        rows("hinge.position,wheel.position,wheel.command_voltage", 12, |_, t| format!("{},\"1\",", swing(t)))
    );
    let mut random = Pcg64::seed_from_u64(9);
    for _ in 0..600 {
        let mut bytes = whole.clone().into_bytes();
        for _ in 0..random.random_range(1..6) {
            let at = random.random_range(0..bytes.len());
            bytes[at] = LETTERS[random.random_range(0..LETTERS.len())];
        }
        if let Ok(log) = files.read(bytes) {
            log.to_csv();
        }
    }
}

#[test]
fn a_file_is_known_by_its_sha256() {
    let files = Files::new();
    let log = files.read("time,wheel.position\n0,0\n1,1\n").unwrap();
    assert_eq!(log.hash, "9d90b674ab19bcdf38959f4438494e29d84a0eb94cc00a464f097d4da3e3be87");
}

#[test]
fn a_number_that_no_joint_has_is_refused_where_it_stands() {
    let files = Files::new();
    let text = rows("hinge.position,hinge.effort", 100, |i, t| if i == 7 { "1e300,0".into() } else { format!("{},0", swing(t)) });
    let message = files.refused(text);
    assert!(message.contains("log:9: column 2 (hinge.position) holds '1e300'"), "{message}");
}

#[test]
fn rows_that_all_have_one_time_are_not_a_joint_that_never_moves() {
    let files = Files::new();
    let text: String = (0..50).map(|i| format!("0.5,{}\n", swing(f64::from(i) * 0.01))).collect();
    let message = files.refused(format!("time,hinge.position\n{text}"));
    assert!(message.contains("all 50 rows repeat one time"), "{message}");
}

#[test]
fn a_file_counts_once_however_often_it_is_named() {
    let files = Files::new();
    let text = rows("hinge.position", 100, |_, t| swing(t).to_string());
    let (a, b) = (files.write("a.csv", &text), files.write("b.csv", &text));
    let logs = read(&[a.clone(), a.clone(), b], Some(&files.model)).unwrap();
    assert_eq!(logs.len(), 1);
    assert!(has_note(&logs[0], &["a.csv", "more than once"]), "{:?}", logs[0].notes);
    assert!(has_note(&logs[0], &["b.csv", "same bytes", "a.csv"]), "{:?}", logs[0].notes);
}

#[test]
fn millimetres_are_asked_about_only_where_they_are_likely_and_taken_once_it_is_said() {
    let files = Files::new();
    let drawer =
        |scale: f64| rows("drawer.position,drawer.velocity", 100, |_, t| format!("{},{}", scale * 0.3 * t.sin(), scale * 0.3 * t.cos()));
    // Past its limits by as much as they are apart: a limit that is wrong, as likely as not.
    files.read(rows("drawer.position", 100, |_, t| (-0.5 + 1.5 * t).to_string())).unwrap();
    let message = files.refused(drawer(1000.0));
    assert!(message.contains("millimetres") && message.contains("--lengths mm"), "{message}");
    let metres = files.read(drawer(1.0)).unwrap();
    let path = files.write("mm", drawer(1000.0));
    let as_told =
        |lengths| read_with(std::slice::from_ref(&path), Some(&files.model), &Options { lengths, ..Options::default() }).unwrap().remove(0);
    let near = |log: &sagci_recording::Log, factor: f64| {
        let (a, b) = (&log.joints[0], &metres.joints[0]);
        let velocity = |j: &sagci_recording::JointLog| j.velocity.as_ref().unwrap().value[50];
        (a.position.value[50] - factor * b.position.value[50]).abs() < 1e-9 && (velocity(a) - factor * velocity(b)).abs() < 1e-9
    };
    assert!(near(&as_told(Lengths::Millimetres), 1.0) && near(&as_told(Lengths::Metres), 1000.0));
    assert!(near(&files.read(format!("# lengths: mm\n{}", drawer(1000.0))).unwrap(), 1.0));
}
