//! The recordings of real hardware that ship with the project: all are read, with their models, and say what their pages say of them.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::path::{Path, PathBuf};

use sagci_model::ObjectModel;
use sagci_recording::{CommandKind, Log, Series, read};

fn measured(name: &str) -> (ObjectModel, Vec<Log>) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured").join(name);
    let model = ObjectModel::read(&folder).unwrap();
    let mut paths: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "csv"));
    paths.sort();
    let logs = read(&paths, Some(&model)).unwrap();
    for log in &logs {
        let joint = &log.joints[0];
        for series in [Some(&joint.position), joint.velocity.as_ref(), joint.effort.as_ref()].into_iter().flatten() {
            assert!(series.time.windows(2).all(|t| t[0] < t[1]), "{}: times do not increase", log.source);
            assert!(series.value.iter().all(|v| v.is_finite()));
        }
        // Runs of their own: none goes on from another.
        assert!(!log.continues);
        assert_eq!((log.hash.len(), log.epoch), (64, 0));
        // Nothing had to be set right in what was published; what is said is said about the missing inputs.
        let is_about_inputs = |m: &str| m.contains("no command") || m.contains("neither a command") || m.contains("if these are degrees");
        assert!(log.notes.iter().all(|n| is_about_inputs(&n.message)), "{}: {:?}", log.source, log.notes);
    }
    for file in ["LICENSE", "ORIGIN", "README.md"] {
        assert!(folder.join(file).is_file(), "{name} has no {file}");
    }
    (model, logs)
}

fn extent(series: &Series) -> [f64; 2] {
    series.value.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)])
}

#[test]
fn the_servo_is_commanded_by_voltages_and_its_circuit_opens_when_the_weight_drops() {
    let (model, logs) = measured("xl330_servo");
    assert_eq!(logs.len(), 12);
    assert_eq!(model.document.actuators.len(), 1);
    for log in &logs {
        let joint = log.joint("pivot").unwrap();
        let (kind, voltage) = joint.command.as_ref().unwrap();
        assert_eq!(*kind, CommandKind::Voltage);
        assert!(extent(voltage).iter().all(|u| u.abs() <= 7.4));
        assert!((1200..=1201).contains(&joint.position.value.len()));
        match log.source.contains("lift_and_drop") {
            true => {
                let [[from, to]] = joint.command_gaps[..] else { panic!("{}: {:?}", log.source, joint.command_gaps) };
                assert!((1.9..2.1).contains(&from) && to == f64::INFINITY, "{from} {to}");
                assert_eq!((joint.command_at(from - 0.01).is_some(), joint.command_at(from)), (true, None));
            }
            false => assert!(joint.command_gaps.is_empty()),
        }
    }
}

#[test]
fn the_cabinet_opens_by_a_quarter_turn_against_a_pull_that_fades() {
    let (_, logs) = measured("pr2_cabinet");
    let joint = logs[0].joint("hinge").unwrap();
    let (position, effort) = (&joint.position, joint.effort.as_ref().unwrap());
    assert!((extent(position)[1].to_degrees() - 92.0).abs() < 1.0);
    let mean_force = |from: f64, to: f64| {
        let within = |q: &f64| (from..to).contains(&q.to_degrees());
        let chosen: Vec<f64> = position.value.iter().zip(&effort.value).filter(|(q, _)| within(q)).map(|(_, f)| *f / 0.3085).collect();
        chosen.iter().sum::<f64>() / chosen.len() as f64
    };
    assert!((mean_force(7.5, 8.5) - 8.0).abs() < 1.0);
    assert!(mean_force(70.0, 95.0).abs() < 1.0);
}

#[test]
fn the_free_pendulum_comes_to_rest_hanging_at_pi() {
    let (model, logs) = measured("uw_pendulum");
    assert_eq!(logs.len(), 4);
    for log in &logs {
        let joint = log.joint("pivot").unwrap();
        assert_eq!(joint.position.value.len(), 9167);
        assert!(joint.effort.is_none() && joint.command.is_none());
        let [first, last] = [&joint.position.value[..2000], &joint.position.value[7000..]]
            .map(|q| q.iter().map(|q| (q - std::f64::consts::PI).abs()).fold(0.0, f64::max));
        assert!(last < first, "{}: the swing grows", log.source);
    }
    // Period of small swings: mass and distance of the model give what the data show, 8.0 rad/s.
    let arm = model.links[1].inertial;
    let rate = (arm.mass * 9.81 * arm.p_LoLcm.z / (arm.I_LLcm_L[(1, 1)] + arm.mass * arm.p_LoLcm.z.powi(2))).sqrt();
    let q = &logs[3].joints[0].position;
    let crossings: Vec<f64> = (1..q.value.len())
        .filter(|&i| q.value[i - 1] < std::f64::consts::PI && q.value[i] >= std::f64::consts::PI)
        .map(|i| q.time[i])
        .collect();
    let measured = std::f64::consts::TAU * (crossings.len() - 1) as f64 / (crossings[crossings.len() - 1] - crossings[0]);
    assert!((measured / rate - 1.0).abs() < 0.05, "{measured} rad/s, the model's is {rate}");
}

#[test]
fn the_driven_pendulum_has_torque_and_turns_over() {
    let (_, logs) = measured("dfki_pendulum");
    assert_eq!(logs.len(), 4);
    for log in &logs {
        let joint = log.joint("pivot").unwrap();
        assert_eq!(joint.effort.as_ref().unwrap().value.len(), joint.position.value.len());
        assert!(joint.velocity.is_some());
    }
    assert!(logs.iter().any(|l| extent(&l.joints[0].position)[1] > 12.0));
}
