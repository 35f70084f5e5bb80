//! What noisy efforts, drives and sensors do to the weight of a model.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::SeedableRng;
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;
use sagci_recording::Log;

use crate::fit::Fit;
use crate::noise::normal;
use crate::plant::Plant;
use crate::search::{FLOOR, Search};
use crate::tests::{door, driven, swing, with};
use crate::trajectory::Trajectory;
use crate::{Options, find};

/// Noise of the efforts, N m: some 40 % of what they are.
const LOUD: f64 = 0.5;

/// Swings of which the efforts were measured badly.
fn badly_measured(truth: &ObjectModel, seeds: std::ops::Range<u64>) -> Vec<Log> {
    let spoil = |seed: u64| {
        let mut log = swing(truth, 1e-4, seed);
        let mut random = Pcg64::seed_from_u64(100 + seed);
        log.joints[0].effort.as_mut().unwrap().value.iter_mut().for_each(|u| *u += LOUD * normal(&mut random));
        log
    };
    seeds.map(spoil).collect()
}

fn named(truth: &ObjectModel, model: &ObjectModel) -> Vec<String> {
    let options = Options { baselines: false, ..Options::default() };
    let found = find(model, &badly_measured(truth, 1..4), &badly_measured(truth, 5..6), &options).unwrap();
    found.report.effects.into_iter().map(|e| e.name).collect()
}

/// A model that does not hear the noise fits better than one that is right.
#[test]
fn noise_of_efforts_has_no_name() {
    let model = door();
    assert_eq!(named(&model, &model), Vec::<String>::new());
}

#[test]
fn beside_noisy_efforts_a_friction_is_named_alone() {
    let model = door();
    let truth = with(&model, "coulomb_friction", &[("friction", 0.6)]);
    assert_eq!(named(&truth, &model), ["coulomb_friction"]);
}

/// A hand that pushes by fits and starts makes jumps that say nothing of how well its effort is measured.
#[test]
fn jumps_of_the_effort_do_not_hide_its_noise() {
    let model = door();
    let measured = |seed: u64| {
        let mut log = driven(&model, 2e-5, seed, 0.9, |t| if t % 0.6 < 0.3 { 1.4 } else { 0.4 });
        let mut random = Pcg64::seed_from_u64(100 + seed);
        log.joints[0].effort.as_mut().unwrap().value.iter_mut().for_each(|u| *u += 0.1 * LOUD * normal(&mut random));
        Trajectory::new(&log, &model).unwrap()
    };
    let data: Vec<Trajectory> = (1..7).map(measured).collect();
    let search = Search::new(&model, &data).unwrap();
    let fit = search.known(&model, 1.0).unwrap();
    let share = search.problem.share_of_noise(&fit, 0, 0.1 * LOUD).unwrap();
    assert!(share > 0.85, "{share} {:?}", search.of_data.effort);
}

/// What two effects do looks like noise while one of them has no name, and beside that noise a third looks as good as the second.
#[test]
fn a_floor_that_was_raised_for_want_of_a_name_comes_down_with_it() {
    let model = door();
    let data =
        [Trajectory::new(&swing(&with(&model, "joint_spring", &[("stiffness", 0.3), ("rest_position", 0.7)]), 1e-4, 1), &model).unwrap()];
    let search = Search::new(&model, &data).unwrap();
    let base = search.known(&model, 1.0).unwrap();
    let raised = search.likelier_noise(&base).unwrap().unwrap();
    assert!(raised.share[0] > 3.0 * FLOOR, "{raised:?}");
    let search = search.with_noise(raised.times([4.0, 1.0]));
    let spring = base.hypothesis.with("joint_spring", Some("hinge"), &[0.3, 0.7]).unwrap();
    let named = search.fit_on(Fit::start(&search.problem, spring).unwrap(), 1.0).unwrap();
    let now = search.likelier_noise(&named).unwrap().unwrap();
    assert_eq!((now.share, now.position), (vec![FLOOR], search.of_data.position));
}

/// An error would weigh nothing where a drive is at its limit, and everything elsewhere.
#[test]
fn a_drive_at_its_limit_is_no_heavier() {
    let free = Plant::new(&door(), &[[false; 2]], 1e-3).unwrap();
    let limited = Plant::new(&with(&door(), "actuator_saturation", &[("limit", 0.1)]), &[[false; 2]], 1e-3).unwrap();
    assert_eq!(free.mobility(&[0.5], 0.005, &[2.0]), limited.mobility(&[0.5], 0.005, &[2.0]));
}

/// A filter of an exact encoder that rings makes of one blow an error in all rows after it, and whatever touches one of these explains the rest.
#[test]
fn a_blow_that_no_model_follows_is_no_error_for_long() {
    let model = door();
    let mut log = swing(&model, 1e-9, 1);
    let position = &mut log.joints[0].position;
    let blow = 1000;
    let struck = position.time[blow];
    position.time.iter().zip(&mut position.value).for_each(|(t, y)| *y += 0.5 * (t - struck).max(0.0));
    let data = [Trajectory::new(&log, &model).unwrap()];
    let search = Search::new(&model, &data).unwrap();
    let errors = search.known(&model, 1.0).unwrap().errors;
    let large = |rows: std::ops::Range<usize>| errors.as_slice()[rows].iter().map(|e| e.abs()).fold(0.0, f64::max);
    let (there, soon) = (large(blow..blow + 3), large(blow + 8..blow + 50));
    assert!(soon < 0.02 * there, "{soon} after an error of {there}");
}

/// A fast mode would make errors weigh less than any other effect could, and explain noise.
#[test]
fn a_base_that_swings_is_no_lighter() {
    let rigid = Plant::new(&door(), &[[false; 2]], 1e-3).unwrap();
    let mut swinging = with(&door(), "unmodelled_mode", &[("frequency", 35.0), ("damping_ratio", 0.03), ("mass", 2.0)]);
    swinging.document.effects[0].joint = None;
    swinging.document.effects[0].choices.insert("direction".into(), "x".into());
    let swinging = Plant::new(&swinging, &[[false; 2]], 1e-3).unwrap();
    assert_eq!(rigid.mobility(&[0.5], 0.005, &[2.0]), swinging.mobility(&[0.5], 0.005, &[2.0]));
}

#[test]
fn an_encoder_that_shows_more_shows_more_noise() {
    let mobility = |model: &ObjectModel| Plant::new(model, &[[false; 2]], 1e-3).unwrap().mobility(&[0.5], 0.005, &[2.0])[0];
    let scaled = with(&door(), "encoder_offset", &[("offset", 0.0), ("scale_error", 0.1)]);
    let ratio = mobility(&scaled) / mobility(&door());
    assert!((ratio - 1.1).abs() < 1e-3, "{ratio}");
}

/// Pulled open and left there, a door cannot tell a friction by place from a spring.
#[test]
fn one_way_is_told_from_both() {
    let model = door();
    let both = [Trajectory::new(&swing(&model, 1e-4, 1), &model).unwrap()];
    let mut log = swing(&model, 1e-4, 1);
    let series = &mut log.joints[0].position;
    series.value = series.time.iter().map(|t| 0.1 + 0.08 * t).collect();
    let one = [Trajectory::new(&log, &model).unwrap()];
    assert!(!Search::new(&model, &both).unwrap().seen[0].one_way && Search::new(&model, &one).unwrap().seen[0].one_way);
}

/// What a hand's sensor adds to the effort pushes nothing.
#[test]
fn a_drift_of_the_measured_effort_is_told_from_a_force() {
    let model = door();
    let mut truth = with(&model, "sensor_drift", &[("bias", 0.1), ("rate", -0.06)]);
    truth.document.effects[0].choices.insert("of".into(), "effort".into());
    let train: Vec<_> = (1..4).map(|s| swing(&truth, 2e-4, s)).collect();
    let report = find(&model, &train, &[swing(&truth, 2e-4, 5)], &Options { baselines: false, ..Options::default() }).unwrap().report;
    let [drift] = &report.effects[..] else { panic!("{:?}", report.effects) };
    assert_eq!((drift.name.as_str(), drift.choices["of"].as_str(), drift.confirmed), ("sensor_drift", "effort", true));
    let near = |name: &str, value: f64| (drift.parameters[name].value - value).abs() < 0.05 * value.abs();
    assert!(near("rate", -0.06), "{:?}", drift.parameters);
}

/// An effort of 2 N m moves a door as far whatever a sensor says of another one.
#[test]
fn a_sensor_of_efforts_changes_nothing_about_how_joints_answer() {
    let mut drifts = with(&door(), "sensor_drift", &[("bias", 1.5), ("rate", 0.0)]);
    drifts.document.effects[0].choices.insert("of".into(), "effort".into());
    let mobility = |model: &ObjectModel| Plant::new(model, &[[false; 2]], 1e-3).unwrap().mobility(&[0.5], 0.005, &[2.0]);
    assert_eq!(mobility(&drifts), mobility(&door()));
}

/// Under half the noise the same errors say four times as much, under more of it no more.
#[test]
fn errors_say_more_under_less_noise() {
    let noise = |position: f64, effort: f64| crate::observer::Disturbance {
        position: vec![position],
        share: vec![0.01],
        quiet: vec![0.1],
        effort: vec![effort],
        reading: vec![0.0],
    };
    assert_eq!(noise(1e-4, 0.2).tells_more_than(&noise(2e-4, 0.1)), 4.0);
    assert_eq!(noise(1e-4, 0.2).tells_more_than(&noise(1e-4, 0.1)), 1.0);
    assert_eq!(noise(1e-4, 0.0).tells_more_than(&noise(1e-4, 0.0)), 1.0, "efforts that are exact");
}
