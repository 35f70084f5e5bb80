//! What an effort that is read beside a command says of the drive and of its own sensor.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::SeedableRng;
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;
use sagci_recording::{CommandKind, Log, Series};

use crate::fit::Fit;
use crate::noise::normal;
use crate::report::{NamedEffect, Verdict};
use crate::search::Search;
use crate::tests::{door, swing, with};
use crate::trajectory::Trajectory;
use crate::{Options, find};

/// Noise of a read effort, N m.
const NOISE: f64 = 0.01;

/// A door that is driven by commands, and what its sensor reads of the efforts that come of them.
fn commanded(truth: &ObjectModel, seed: u64, read: impl Fn(f64, f64) -> f64) -> Log {
    let mut log = swing(truth, 1e-4, seed);
    let joint = &mut log.joints[0];
    let Some(sent) = joint.effort.take() else { panic!("no inputs") };
    let mut random = Pcg64::seed_from_u64(200 + seed);
    let value = sent.time.iter().zip(&sent.value).map(|(t, u)| read(*t, *u) + NOISE * normal(&mut random)).collect();
    joint.effort = Some(Series { time: sent.time.clone(), value });
    joint.command = Some((CommandKind::Effort, sent));
    log
}

fn only_name(model: &ObjectModel, truth: &ObjectModel, read: impl Fn(f64, f64) -> f64) -> (Verdict, NamedEffect) {
    let train: Vec<Log> = (1..4).map(|seed| commanded(truth, seed, &read)).collect();
    let options = Options { baselines: false, ..Options::default() };
    let mut report = find(model, &train, &[commanded(truth, 5, &read)], &options).unwrap().report;
    assert_eq!(report.effects.len(), 1, "{:?}", report.effects);
    (report.verdict, report.effects.remove(0))
}

/// By the motion alone, a hinge that stands upright cannot tell a weak drive from a heavy door.
#[test]
fn a_weak_drive_is_told_from_a_heavy_rotor_by_its_effort() {
    let (verdict, gain) = only_name(&door(), &with(&door(), "torque_gain", &[("gain_error", 0.15)]), |_, u| 0.85 * u);
    assert_eq!((verdict, gain.name.as_str()), (Verdict::Named, "torque_gain"), "{gain:?}");
    assert!((gain.parameters["gain_error"].value - 0.15).abs() < 2e-3, "{:?}", gain.parameters);
    let (_, rotor) = only_name(&door(), &with(&door(), "armature_inertia", &[("inertia", 0.04)]), |_, u| u);
    let set: Vec<&str> = std::iter::once(&rotor.name).chain(&rotor.alternatives).map(String::as_str).collect();
    assert!(set.contains(&"armature_inertia") && !set.contains(&"torque_gain"), "{rotor:?}");
}

/// It moves nothing, so that no position shows it.
#[test]
fn a_drift_of_the_effort_beside_a_command_is_named() {
    let (verdict, drift) = only_name(&door(), &door(), |t, u| u + 0.1 - 0.02 * t);
    assert_eq!((verdict, drift.name.as_str(), drift.choices["of"].as_str()), (Verdict::Named, "sensor_drift", "effort"));
    let value = |name: &str| drift.parameters[name].value;
    assert!((value("bias") - 0.1).abs() < 2e-3 && (value("rate") + 0.02).abs() < 5e-4, "{:?}", drift.parameters);
}

/// By the clock of the efforts, one of positions that is late changes no effort; a delay of the drive does.
#[test]
fn a_late_encoder_is_told_from_a_late_drive() {
    let model = door();
    let of = |effect: &str| {
        let logs = [Trajectory::new(&commanded(&model, 1, |_, u| u), &model).unwrap()];
        let search = Search::new(&model, &logs).unwrap();
        let late = search.known(&model, 1.0).unwrap().hypothesis.with(effect, Some("hinge"), &[0.013]).unwrap();
        let fit = Fit::start(&search.problem, late).unwrap();
        let positions = logs[0].position.len();
        fit.errors.rows(positions, positions).norm_squared() / search.problem.efforts() as f64
    };
    let (skewed, delayed) = (of("clock_skew"), of("transport_delay"));
    assert!(skewed < 1.2 && delayed > 2.0 * skewed, "{skewed} {delayed}");
}

/// Efforts of a model that is right are as far from what it says as their noise, and no nearer.
#[test]
fn what_is_read_of_a_right_model_is_off_by_the_noise() {
    let model = with(&door(), "torque_gain", &[("gain_error", 0.1)]);
    let logs = [Trajectory::new(&commanded(&model, 1, |_, u| 0.9 * u), &model).unwrap()];
    let search = Search::new(&model, &logs).unwrap();
    let fit = search.known(&model, 1.0).unwrap();
    let positions = logs[0].position.len();
    let mean = fit.errors.rows(positions, positions).norm_squared() / search.problem.efforts() as f64;
    assert!((0.3..1.1).contains(&mean), "{mean}");
}

/// Some record what a drive gave over the row before, some over the row: neither is a delay of the drive. Further away is one.
#[test]
fn when_in_its_row_an_effort_was_read_is_no_delay() {
    let model = door();
    let off = |rows: usize| {
        let mut log = commanded(&model, 1, |_, u| u);
        let Some(read) = &mut log.joints[0].effort else { panic!("no readings") };
        read.value.rotate_right(rows);
        let logs = [Trajectory::new(&log, &model).unwrap()];
        let search = Search::new(&model, &logs).unwrap();
        let fit = search.known(&model, 1.0).unwrap();
        let positions = logs[0].position.len();
        fit.errors.rows(positions, positions).norm_squared() / search.problem.efforts() as f64
    };
    let (now, before, long_before) = (off(0), off(1), off(3));
    assert!(before < 1.2 * now && long_before > 2.0 * now, "{now} {before} {long_before}");
}
