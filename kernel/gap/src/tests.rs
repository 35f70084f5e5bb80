#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::DVector;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use sagci_dynamics::effects;
use sagci_model::{Actuator, ActuatorLaw, EffectEntry, ObjectModel};
use sagci_recording::{CommandKind, JointLog, Log, Series};

use crate::fit::{Derivatives, Effort, Fit};
use crate::gaps::Measure;
use crate::hypothesis::Hypothesis;
use crate::noise;
use crate::observer::{self, Errors, Noise};
use crate::part::{comes_up, thinned};
use crate::plant::Plant;
use crate::report::{Gap, JointGap, Verdict};
use crate::response::Response;
use crate::search::{Candidate, Search};
use crate::trajectory::{Drive, Trajectory};
use crate::windows::{Seek, Smoothed, likely_noise};
use crate::{Options, find};

pub(crate) fn door() -> ObjectModel {
    ObjectModel::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured/mujoco/b")).unwrap()
}

/// A door that a weak hand moves to and fro for 10 s at 200 Hz, simulated in steps of 0.1 ms.
pub(crate) fn swing(truth: &ObjectModel, noise: f64, seed: u64) -> Log {
    led(truth, noise, seed, 1.0)
}

/// The same with the hand's way so many times as wide.
pub(crate) fn led(truth: &ObjectModel, noise: f64, seed: u64, width: f64) -> Log {
    driven(truth, noise, seed, 0.9 - 0.3 * width, |t| 0.9 + width * (0.5 * (1.1 * t + seed as f64).sin() + 0.2 * (2.9 * t).cos()))
}

/// The same from a start of its own, with the hand on a way of its own, by time.
pub(crate) fn driven(truth: &ObjectModel, noise: f64, seed: u64, start: f64, way: impl Fn(f64) -> f64) -> Log {
    let plant = Plant::new(truth, &[[false; 2]], 1e-4).unwrap();
    let mut motion = plant.motion();
    let mut random = Pcg64::seed_from_u64(seed);
    let mut joint = JointLog { name: "hinge".into(), effort: Some(Series::default()), ..JointLog::default() };
    motion.state.q[0] = start;
    for k in 0..2000 {
        let t = 0.005 * f64::from(k);
        let u = 4.0 * (way(t) - motion.state.q[0]) - 0.3 * motion.state.v[0];
        joint.position.time.push(t);
        joint.position.value.push(plant.reading(&motion, 0) + noise * noise::normal(&mut random));
        let effort = joint.effort.as_mut().unwrap();
        effort.time.push(t);
        effort.value.push(u);
        let mut one = Trajectory::steady(2, 0.005, &[u], vec![crate::trajectory::Drive::Effort]);
        one.time.iter_mut().for_each(|x| *x += t);
        plant.interval(&mut motion, &one, 0).unwrap();
        motion.state.time = t + 0.005;
    }
    Log { source: "swing".into(), joints: vec![joint], ..Log::default() }
}

pub(crate) fn with(model: &ObjectModel, effect: &str, parameters: &[(&str, f64)]) -> ObjectModel {
    let mut model = model.clone();
    let parameters = parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
    model.document.effects.push(EffectEntry { effect: effect.into(), joint: Some("hinge".into()), parameters, ..EffectEntry::default() });
    model
}

/// A gap of one joint: refitted, with names, and what noise makes of it.
pub(crate) fn gap([refitted, after, noise_floor]: [f64; 3]) -> Gap {
    let all = [refitted, refitted, after, noise_floor];
    let joint = JointGap { before: refitted, refitted, after, noise_floor, median: all, short: all, range: 1.0, unit: "rad".into() };
    Gap { before: refitted, refitted, after, noise_floor, per_joint: [("hinge".to_owned(), joint)].into() }
}

/// Dense samples are averaged, and of one that stands alone before a pause, as a clock that was set leaves it, there is nothing to average.
#[test]
fn a_sample_far_before_the_others_of_a_dense_recording_does_no_harm() {
    let mut log = swing(&door(), 1e-4, 1);
    let joint = &mut log.joints[0];
    joint.effort = None;
    joint.position.time.iter_mut().for_each(|t| *t *= 0.2);
    joint.position.time[0] = -1.0;
    let all = joint.position.time.len();
    let read = Trajectory::new(&log, &door()).unwrap();
    assert!(read.rows() < all / 2 && read.starts == [0], "{} rows from {:?}", read.rows(), read.starts);
    assert!(crate::windows::has_any(&read, 0.5));
}

#[test]
fn the_noise_of_positions_is_read_off_motion() {
    for size in [2e-5, 1e-3] {
        let log = swing(&door(), size, 3);
        let found = noise::of_positions(&[Trajectory::new(&log, &door()).unwrap()], 0);
        assert!((found / size - 1.0).abs() < 0.1, "{found} for {size}");
    }
}

#[test]
fn an_encoder_that_reads_in_steps_has_the_noise_of_these() {
    let mut log = swing(&door(), 0.0, 3);
    let step = 2e-3;
    for y in &mut log.joints[0].position.value {
        *y = (*y / step).round() * step;
    }
    let found = noise::of_positions(&[Trajectory::new(&log, &door()).unwrap()], 0);
    assert!(found >= 0.99 * step / 12f64.sqrt() && found < step, "{found}");
}

/// If the model is right, prediction errors are white and of the size that the filter says.
#[test]
fn prediction_errors_of_the_right_model_are_white() {
    let model = door();
    let trajectories = [Trajectory::new(&swing(&model, 2e-4, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let hypothesis = Hypothesis::known(&model, &search.joints);
    let errors = search.problem.errors(&hypothesis, &hypothesis.x).unwrap();
    let e: Vec<f64> = errors.iter().skip(50).copied().collect();
    let square = e.iter().map(|x| x * x).sum::<f64>() / e.len() as f64;
    assert!((0.7..1.1).contains(&square), "{square}");
    for lag in 1..=20 {
        let correlation = e.iter().zip(&e[lag..]).map(|(a, b)| a * b).sum::<f64>() / (square * e.len() as f64);
        assert!(correlation.abs() < 0.1, "lag {lag}: {correlation}");
    }
}

/// What the screen's linear response to forces is off by, beside a run of the simulator with each.
fn response_is_off(model: &ObjectModel, log: &Log) -> Vec<f64> {
    let trajectories = [Trajectory::new(log, model).unwrap()];
    let search = Search::new(model, &trajectories).unwrap();
    let base = Fit::start(&search.problem, Hypothesis::known(model, &search.joints)).unwrap();
    let runs = search.runs(&base).unwrap();
    let response = Response::new(&search, &base, &runs, 0);
    let off = |(effect, values): (&'static str, Vec<f64>)| {
        let more = base.hypothesis.with(effect, Some("hinge"), &values).unwrap();
        let exact: DVector<f64> = search.problem.errors(&more, &more.x).unwrap() - &base.errors;
        let linear = response.errors_of(&response.forces(effects::find(effect).unwrap(), &values));
        (&exact - &linear).norm() / exact.norm()
    };
    [("torque_bias", vec![0.02]), ("joint_spring", vec![0.05, 0.2]), ("viscous_friction", vec![0.02])].map(off).to_vec()
}

#[test]
fn the_linear_response_agrees_with_the_simulator() {
    let off = response_is_off(&door(), &swing(&door(), 2e-4, 1));
    assert!(off.iter().all(|off| *off < 0.1), "{off:?}");
}

/// A servo holds against most of a force that comes slowly: the noisier the positions, the longer it has before the filter corrects.
#[test]
fn the_linear_response_of_a_servo_agrees_with_the_simulator() {
    let way = |t: f64| 0.9 + 0.5 * (1.1 * t).sin() + 0.2 * (2.9 * t).cos();
    let mut log = driven(&door(), 5e-3, 1, 0.6, way);
    let servo = |time: Vec<f64>| Series { value: time.iter().map(|t| way(*t)).collect(), time };
    log.joints[0].command = log.joints[0].effort.take().map(|effort| (CommandKind::Position, servo(effort.time)));
    let mut model = door();
    // The hand that `driven` has.
    let law = ActuatorLaw::PositionServo { stiffness: 4.0, damping: 0.3, max_effort: f64::INFINITY };
    model.document.actuators.push(Actuator { joint: "hinge".into(), law, refit: [].into() });
    let off = response_is_off(&model, &log);
    assert!(off.iter().all(|off| *off < 0.1), "{off:?}");
}

/// Stretches of the data are predicted as they are within the whole, but for what each start has to settle: no state, input or weight is
/// mixed up where they are cut.
#[test]
fn stretches_of_the_data_are_predicted_as_within_the_whole() {
    let model = door();
    let whole = [Trajectory::new(&swing(&model, 2e-4, 1), &model).unwrap()];
    let (part, rows) = thinned(&whole[0], 2.0, |stretch| comes_up(stretch, 2));
    let part = [part];
    let search = Search::new(&model, &whole).unwrap();
    let wrong = Hypothesis::known(&model, &search.joints).with("torque_bias", Some("hinge"), &[0.05]).unwrap();
    let all = search.problem.errors(&wrong, &wrong.x).unwrap();
    let some = search.over(&part).problem.errors(&wrong, &wrong.x).unwrap();
    assert!(part[0].starts.len() > 2 && some.len() < all.len());
    let since = |i: usize| i - part[0].starts.iter().copied().filter(|s| *s <= i).max().unwrap();
    let settled: Vec<usize> = (0..rows.len()).filter(|i| since(*i) > 200).collect();
    let off: f64 = settled.iter().map(|i| (some[*i] - all[rows[*i]]).powi(2)).sum();
    let size: f64 = settled.iter().map(|i| all[rows[*i]].powi(2)).sum();
    assert!(off < 1e-4 * size, "{off} of {size}");
}

/// A fit to stretches bends what is named already to what these happen to show; nobody would look for a second name from there.
#[test]
fn what_suits_a_part_is_not_carried_over_where_it_suits_nothing() {
    let (model, truth) = (door(), with(&door(), "torque_bias", &[("bias", 0.05)]));
    let whole = [Trajectory::new(&swing(&truth, 2e-4, 1), &model).unwrap()];
    let search = Search::new(&model, &whole).unwrap();
    let base = search.known(&model, 1.0).unwrap();
    let mut bent = base.hypothesis.with("torque_bias", Some("hinge"), &[0.05]).unwrap();
    bent.x.iter_mut().zip(&bent.fitted[..base.hypothesis.x.len()]).for_each(|(x, f)| *x += 3.0 * f.prior[1]);
    let lost = Fit::start(&search.problem, bent).unwrap();
    assert!(lost.squares > base.squares);
    let candidate = Candidate { effect: "torque_bias", joint: Some(0), fit: lost, evidence: 0.0 };
    let carried = search.carried(&base, candidate, 1.0).unwrap();
    assert!(carried.fit.squares < base.squares, "{} {}", carried.fit.squares, base.squares);
}

/// A joint that is led to and fro would show a search one side of its range, if stretches came as often as it does.
#[test]
fn stretches_show_every_phase_of_a_motion_with_a_period() {
    let whole = Trajectory::steady(6000, 0.02, &[0.0], vec![Drive::Given]);
    for every in 2..=5 {
        let (_, rows) = thinned(&whole, 1.0, |stretch| comes_up(stretch, every));
        let share = rows.len() as f64 * every as f64 / whole.rows() as f64;
        assert!((share - 1.0).abs() < 0.1, "one of {every}: {share}");
        for period in 2..=6 {
            let phases: BTreeSet<usize> = rows.iter().map(|k| k / 50 % period).collect();
            assert_eq!(phases.len(), period, "one of {every}, a motion of {period} s: {phases:?}");
        }
    }
}

/// So is the linear response to the model's own numbers.
#[test]
fn derivatives_by_known_numbers_need_no_runs() {
    let model = door();
    let trajectories = [Trajectory::new(&swing(&model, 2e-4, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let fit = Fit::start(&search.problem, Hypothesis::known(&model, &search.joints)).unwrap();
    let all: Vec<usize> = (0..fit.hypothesis.x.len()).collect();
    let exact = search.problem.jacobian(&fit.hypothesis, &fit.hypothesis.x, &fit.errors, &all).unwrap();
    for (fitted, (linear, exact)) in fit.hypothesis.fitted.iter().zip(search.derivatives_by_known(&fit).unwrap().iter().zip(&exact)) {
        let off = (exact - linear).norm() / exact.norm().max(1.0);
        assert!(off < 0.1, "{:?}: {off}", fitted.knob);
    }
}

/// Steps take positions from the next velocity; without the correction of an interval a held push would carry too far by `h a t / 2`.
#[test]
fn a_held_push_is_integrated_exactly() {
    let mut model = door();
    model.joints[0].damping = 0.0;
    model.joints[0].friction = 0.0;
    let trajectory = Trajectory::new(&swing(&model, 0.0, 2), &model).unwrap();
    let end = |step: f64| {
        let plant = Plant::new(&model, &[[false; 2]], step).unwrap();
        let mut motion = plant.motion();
        for k in 0..200 {
            plant.interval(&mut motion, &trajectory, k).unwrap();
        }
        motion.state.q[0]
    };
    assert!((end(5e-3) - end(5e-5)).abs() < 1e-10, "{} and {}", end(5e-3), end(5e-5));
}

#[test]
fn a_fit_finds_what_made_the_data() {
    let model = door();
    let truth = with(&model, "quadratic_drag", &[("drag", 0.12)]);
    let trajectories: Vec<Trajectory> = (1..3).map(|s| Trajectory::new(&swing(&truth, 2e-4, s), &model).unwrap()).collect();
    let search = Search::new(&model, &trajectories).unwrap();
    let base = search.known(&model, 1.0).unwrap();
    let start = base.hypothesis.with("quadratic_drag", Some("hinge"), &[0.02]).unwrap();
    let fit = Fit::start(&search.problem, start).unwrap().improve(&search.problem, 1.0, Effort::new(15, 0.01), Derivatives::FRESH).unwrap();
    let last = fit.hypothesis.x.len() - 1;
    let value = fit.hypothesis.fitted[last].value(fit.hypothesis.x[last]);
    assert!((value - 0.12).abs() < 0.004, "{value}");
    assert!(search.evidence(&fit, 1.0) > search.evidence(&base, 1.0) + 100.0);
}

/// How far off a fit began says nothing of when it is at its end: what beside it was the same is not taken for less there.
#[test]
fn a_fit_that_begins_far_off_ends_where_one_does_that_begins_near() {
    let model = door();
    let truth = with(&model, "joint_spring", &[("stiffness", 0.15), ("rest_position", -2.0)]);
    let trajectories: Vec<Trajectory> = (1..3).map(|s| Trajectory::new(&swing(&truth, 2e-4, s), &model).unwrap()).collect();
    let search = Search::new(&model, &trajectories).unwrap();
    let known = Hypothesis::known(&model, &search.joints);
    let cost = |values: &[f64]| {
        let start = Fit::start(&search.problem, known.with("joint_spring", Some("hinge"), values).unwrap()).unwrap();
        let fit = start.finish(&search.problem, 1.0, Derivatives::FRESH, Effort::to_the_end(f64::NEG_INFINITY)).unwrap();
        0.5 * fit.squares + fit.hypothesis.prior(&fit.hypothesis.x)
    };
    let near = cost(&[0.15, -2.0]);
    for far in [[0.15, 0.3], [0.15, 1.0], [0.3, -1.0], [0.5, -4.0]] {
        let off = cost(&far) - near;
        // By less than names are told apart by.
        assert!(off < 3.0, "begun at {far:?}: {off}");
    }
}

/// A name in the place of another that was most of what is there: with derivatives from the fit without both it would stop far from its end.
#[test]
fn what_may_take_a_names_place_is_fitted_to_its_own_end() {
    let model = door();
    let losses = [("friction_positive", 0.05), ("friction_negative", 0.03), ("damping_positive", 0.06), ("damping_negative", 0.12)];
    let spring = with(&model, "joint_spring", &[("stiffness", 0.6), ("rest_position", 0.5)]);
    let truth = with(&spring, "asymmetric_friction", &losses);
    let trajectories: Vec<Trajectory> = (1..3).map(|s| Trajectory::new(&swing(&truth, 2e-4, s), &model).unwrap()).collect();
    let search = Search::new(&model, &trajectories).unwrap();
    let known = Hypothesis::known(&model, &search.joints);
    let settled = |hypothesis: Hypothesis| search.settle(&Fit::start(&search.problem, hypothesis).unwrap(), 1.0);
    let of = |values: &[f64; 4]| known.with("asymmetric_friction", Some("hinge"), values).unwrap();
    let end = settled(of(&losses.map(|l| l.1)).with("joint_spring", Some("hinge"), &[0.6, 0.5]).unwrap());
    let without = settled(of(&[0.1; 4]));
    let here = search.evidence(&without, 1.0);
    let mut candidates = search.stage(&without, 1.0).unwrap();
    let behind = |all: &[Candidate]| {
        let spring = all.iter().find(|c| c.effect == "joint_spring").unwrap();
        0.5 * (spring.fit.squares - end.squares)
    };
    let before = behind(&candidates);
    search.settle_rivals(&mut candidates, "cable_hysteresis", here, 1.0);
    assert!(behind(&candidates) < 3.0, "behind by {before}, then by {}", behind(&candidates));
    assert!(before > 10.0, "nothing had to be done: {before}");
}

/// One sine is told by one pair of numbers, or an interval around the other pair would miss it.
#[test]
fn a_sine_is_written_in_one_way_and_stays_the_same_force() {
    let model = door();
    let trajectories = [Trajectory::new(&swing(&model, 2e-4, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let known = Hypothesis::known(&model, &search.joints);
    for (effect, values) in [("hinge_tilt", &[-0.1, 5.0][..]), ("hinge_tilt", &[0.1, -7.0]), ("torque_ripple", &[-0.05, 6.0, 1.0])] {
        let fit = Fit::start(&search.problem, known.with(effect, Some("hinge"), values).unwrap()).unwrap();
        let fit = fit.differentiated(&search.problem, None).unwrap();
        let wrapped = fit.clone().with_sines_wrapped();
        let again = Fit::start(&search.problem, wrapped.hypothesis.clone()).unwrap().differentiated(&search.problem, None).unwrap();
        assert!((&again.errors - &fit.errors).amax() < 1e-6 * fit.errors.amax(), "{effect}: another force");
        for (column, anew) in wrapped.jacobian.iter().zip(&again.jacobian) {
            assert!((column - anew).amax() < 1e-3 * anew.amax().max(1e-9), "{effect}: its derivatives are not its own");
        }
        let told = &again.hypothesis.x[again.hypothesis.known..];
        assert!(told[0] > 0.0 && told.last().unwrap().abs() <= std::f64::consts::PI, "{effect}: {told:?}");
    }
}

/// Mass, centre of mass and inertia of one door are one number to its hinge: the number that is kept has the room of all.
#[test]
fn inertial_numbers_that_show_alike_are_one() {
    let model = door();
    let trajectories = [Trajectory::new(&swing(&model, 2e-4, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let all = Hypothesis::known(&model, &search.joints);
    let known = search.known(&model, 1.0).unwrap().hypothesis;
    let inertial = |h: &Hypothesis| h.fitted.iter().filter(|f| f.unit == "1" || f.unit == "m").count();
    assert_eq!(inertial(&all), 5);
    assert_eq!(inertial(&known), 1);
    let room = known.fitted.iter().find(|f| f.unit == "1" || f.unit == "m").unwrap();
    let same = all.fitted.iter().find(|f| f.knob == room.knob).unwrap();
    assert!(room.bounds[1] > same.bounds[1]);
}

/// Errors of a model that lacks something go together, and say less than as many that noise makes: intervals that did not know held the truth
/// three times in four.
#[test]
fn an_interval_is_wider_where_the_model_lacks_something() {
    let wider = |truth: &ObjectModel| {
        let model = door();
        let trajectories = [Trajectory::new(&swing(truth, 2e-4, 1), &model).unwrap()];
        let search = Search::new(&model, &trajectories).unwrap();
        let fit = search.anew(&search.known(&model, 1.0).unwrap());
        let scale = search.scale(&fit);
        let alone = fit.normal(scale).0.try_inverse().unwrap();
        let variances = fit.variances(&search.problem, scale).unwrap();
        variances.iter().enumerate().map(|(i, v)| v / alone[(i, i)]).fold(0.0, f64::max)
    };
    let lacking = wider(&with(&door(), "torque_ripple", &[("amplitude", 0.1), ("cycles_per_turn", 5.0), ("phase", 0.3)]));
    let right = wider(&door());
    assert!(right < 3.0, "{right}");
    assert!(lacking > 3.0 * right, "{lacking} against {right}");
}

/// An arm that falls gets away from an observer that follows softly, and its run ends: then the noise under which it is followed is looked
/// for, however far that is.
#[test]
fn a_motion_that_a_soft_observer_loses_is_followed_more_closely() {
    let model = door();
    let trajectories = [Trajectory::new(&swing(&model, 2e-4, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let plant = Plant::new(&model, &search.problem.limits, 2.5e-3).unwrap();
    let noise = search.problem.noise(&plant);
    let lost = Noise { position: vec![f64::NAN], ..noise.clone() };
    let at = |factors: [f64; 2]| if factors[1] < 16.0 { lost.clone() } else { noise.times(factors) };
    let [_, found] = likely_noise(&plant, &trajectories, &at, [0.0, f64::INFINITY], Seek::Everywhere);
    assert!(found >= 16.0, "{found}");
}

/// How large noises are is asked of stretches of a second, and what pulls a joint away grows beyond them: along a whole recording an observer that
/// follows the right model softly ends anywhere, and so do the windows that begin there.
#[test]
fn a_joint_that_falls_is_not_lost_where_short_stretches_ask_for_a_soft_observer() {
    let model = with(&door(), "hinge_tilt", &[("amplitude", 3.0), ("phase", std::f64::consts::PI - 0.9)]);
    let logs = [1, 2, 3].map(|seed| driven(&model, 2e-4, seed, 0.9, |t| 0.9 + 0.05 * (0.4 * t + seed as f64).sin()));
    let trajectories = logs.map(|log| Trajectory::new(&log, &model).unwrap());
    let search = Search::new(&model, &trajectories).unwrap();
    let plant = Plant::new(&model, &search.problem.limits, 1e-3).unwrap();
    let noise = noise::of_motion(&trajectories, 1, 1e-5);
    let (figures, _) = Smoothed::new(&plant, &trajectories, &noise).unwrap().figures(&plant, &trajectories, 0.25, &[1.5]);
    assert!(figures.rmse[0] < 2e-3, "{figures:?}");
}

/// Windows of the right model on its own noiseless data are off by no more than the integrator is.
#[test]
fn the_gap_of_the_right_model_is_its_noise() {
    let model = door();
    let trajectories = [Trajectory::new(&swing(&model, 1e-5, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let plant = Plant::new(&model, &search.problem.limits, 1e-3).unwrap();
    let (figures, _) =
        Smoothed::new(&plant, &trajectories, &search.problem.noise(&plant)).unwrap().figures(&plant, &trajectories, 1.0, &[1.5]);
    assert!(figures.rmse[0] < 5e-4, "{figures:?}");
    let wrong = with(&model, "torque_bias", &[("bias", 0.2)]);
    let plant = Plant::new(&wrong, &search.problem.limits, 1e-3).unwrap();
    let (off, _) = Smoothed::new(&plant, &trajectories, &search.problem.noise(&plant)).unwrap().figures(&plant, &trajectories, 1.0, &[1.5]);
    assert!(off.rmse[0] > 20.0 * figures.rmse[0], "{off:?}");
}

/// A door that stands on its hinge, held up by a hand whose effort is read with noise: by itself it falls within a second, to where errors grow
/// no more, and noise seemed to make half of the gap that it makes. A stop of an oven's door was taken back for that.
#[test]
fn noise_beside_an_unstable_rest_makes_all_of_the_gap_that_it_makes() {
    let mut model = door();
    model.joints[0].axis = nalgebra::Vector3::x_axis();
    let inertial = &mut model.links[model.joints[0].child].inertial;
    (inertial.mass, inertial.p_LoLcm) = (3.0, nalgebra::Point3::new(0.0, 0.0, 0.1));
    let recorded = |seed: u64| {
        let mut log = driven(&model, 1e-4, seed, 0.0, |t| 0.25 * (1.1 * t + seed as f64).sin() + 0.1 * (2.9 * t).cos());
        let mut random = Pcg64::seed_from_u64(100 + seed);
        log.joints[0].effort.as_mut().unwrap().value.iter_mut().for_each(|u| *u += 0.4 * noise::normal(&mut random));
        Trajectory::new(&log, &model).unwrap()
    };
    let trajectories: Vec<Trajectory> = (1..4).map(recorded).collect();
    let search = Search::new(&model, &trajectories).unwrap();
    let measure = Measure::new(&search, &model, &trajectories, &[], 1.0);
    let right = Hypothesis::known(&model, &search.joints);
    let gap = measure.pooled(&right, None).unwrap();
    let floors: Vec<f64> = (1..4).map(|seed| measure.noise_floor(&right, seed).unwrap()).collect();
    assert!(floors.iter().all(|floor| (0.7..1.4).contains(&(gap / floor))), "{gap} where noise makes {floors:?}");
}

#[test]
fn an_input_acts_from_its_row_until_the_next() {
    let model = door();
    let mut log = swing(&model, 0.0, 1);
    // Inputs on a clock of their own.
    let effort = log.joints[0].effort.as_mut().unwrap();
    *effort = Series { time: vec![0.0, 0.0123, 0.5], value: vec![1.0, 2.0, 3.0] };
    let trajectory = Trajectory::new(&log, &model).unwrap();
    let at = |t: f64| trajectory.input[trajectory.time.iter().position(|x| (x - t).abs() < 1e-9).unwrap()];
    assert_eq!([at(0.0), at(0.01), at(0.0123), at(0.495), at(0.5), at(5.0)], [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
}

/// A recording begins while what was sent before is on its way, and goes on where another ended a while ago.
#[test]
fn what_was_sent_before_a_recording_began_is_not_held_against_a_delay() {
    let model = door();
    let truth = with(&model, "transport_delay", &[("delay", 0.022)]);
    let trajectories: Vec<Trajectory> = [1, 2]
        .map(|seed| {
            let mut log = swing(&truth, 2e-5, seed);
            let joint = &mut log.joints[0];
            let effort = joint.effort.as_mut().unwrap();
            for series in [&mut joint.position, effort] {
                series.time.drain(..300);
                series.value.drain(..300);
            }
            log.continues = seed > 1;
            Trajectory::new(&log, &model).unwrap()
        })
        .to_vec();
    let search = Search::new(&model, &trajectories).unwrap();
    let delayed = search.known(&model, 1.0).unwrap().hypothesis.with("transport_delay", Some("hinge"), &[0.012]).unwrap();
    let fit = Fit::start(&search.problem, delayed).unwrap();
    let fit = fit.improve(&search.problem, 1.0, Effort::new(20, 0.1), Derivatives::FRESH).unwrap();
    let delay = fit.hypothesis.x.last().unwrap().exp();
    assert!((delay / 0.022 - 1.0).abs() < 5e-3, "{delay}");
    let white = search.problem.measured() as f64;
    assert!(fit.squares < 1.2 * white, "{} of {white}", fit.squares);
}

/// By its stamps, a motion that is stamped late is one that was driven late; also by part of a sample, and early.
#[test]
fn a_clock_that_is_off_is_a_drive_that_is() {
    let log = swing(&door(), 0.0, 1);
    let end = |model: &ObjectModel, log: &Log| -> f64 {
        let plant = Plant::new(model, &[[false; 2]], 1e-3).unwrap();
        let trajectory = Trajectory::new(log, &door()).unwrap();
        let mut motion = plant.motion();
        motion.state.q[0] = 0.6;
        (0..400).for_each(|k| plant.interval(&mut motion, &trajectory, k).unwrap());
        plant.reading(&motion, 0)
    };
    let skewed = |skew: f64| end(&with(&door(), "clock_skew", &[("skew", skew)]), &log);
    for rows in [-3_i64, 2] {
        let mut driven = log.clone();
        let effort = &mut driven.joints[0].effort.as_mut().unwrap().value;
        let given = effort.clone();
        for (k, u) in effort.iter_mut().enumerate() {
            *u = given[(k as i64 - rows).clamp(0, given.len() as i64 - 1) as usize];
        }
        let (ours, theirs) = (skewed(0.005 * rows as f64), end(&door(), &driven));
        assert!((ours - theirs).abs() < 1e-6 && (ours - end(&door(), &log)).abs() > 1e-4, "{rows} rows: {ours} {theirs}");
    }
    // A fit has derivatives between samples.
    let slopes: Vec<f64> = [0.0071, 0.0076, 0.0081].iter().map(|s| (skewed(s + 1e-5) - skewed(s - 1e-5)) / 2e-5).collect();
    let (least, most) = slopes.iter().fold((f64::MAX, f64::MIN), |(a, b), s| (a.min(*s), b.max(*s)));
    assert!(most - least < 0.05 * most.abs().max(least.abs()), "{slopes:?}");
}

/// A model that lacks a loss is lost beside the data unless it trusts what is measured: by factors nearby it is no nearer.
#[test]
fn how_closely_a_motion_is_followed_is_sought_to_both_sides() {
    let model = door();
    let log = [Trajectory::new(&swing(&with(&model, "viscous_friction", &[("damping", 0.5)]), 1e-4, 1), &model).unwrap()];
    let plant = Plant::new(&model, &[[false; 2]], 2.5e-3).unwrap();
    let noise = noise::of_motion(&log, 1, 0.01);
    let factors = likely_noise(&plant, &log, &|factors| noise.times(factors), [0.0, f64::INFINITY], Seek::Everywhere);
    let off = |factors: [f64; 2]| {
        let mut errors = Errors::default();
        observer::run(&plant, &log[0], &noise.times(factors), &mut plant.motion(), &mut errors, None).unwrap();
        (errors.position.iter().map(|e| e * e).sum::<f64>() / errors.position.len() as f64).sqrt()
    };
    assert!(off([1.0; 2]) > 10.0 && off(factors) < 2.0 && factors[0] < 4.0, "{} {} {factors:?}", off([1.0; 2]), off(factors));
}

/// A door that a hand leans against too weakly to move it says nothing of what a swinging one lacks.
#[test]
fn held_out_data_in_which_nothing_moves_deny_nothing() {
    let (model, truth) = (door(), with(&door(), "coulomb_friction", &[("friction", 0.05)]));
    let train: Vec<Log> = (1..3).map(|seed| swing(&truth, 1e-4, seed)).collect();
    let mut still = swing(&model, 0.0, 3);
    let mut random = Pcg64::seed_from_u64(4);
    still.joints[0].position.value.iter_mut().for_each(|y| *y = 0.3 + 1e-4 * noise::normal(&mut random));
    let options = Options { baselines: false, ..Options::default() };
    // A joint beside it that moves is none of the door's; a door by another name is not passed over.
    let mut beside = swing(&model, 1e-4, 3).joints.remove(0);
    beside.name = "wheel".into();
    let mut misnamed = still.clone();
    misnamed.joints[0].name = "hinje".into();
    assert!(find(&model, &train, &[misnamed], &options).is_err());
    still.joints.push(beside);
    let report = find(&model, &train, &[still], &options).unwrap().report;
    assert_eq!(report.verdict, Verdict::Named, "{:?}", report.rejected);
    assert!(report.gap.held_out.is_none() && report.notes.iter().any(|n| n.contains("nothing moves in these held-out data")));
}

/// A joint that was nowhere has no range between whose ends anything lies.
#[test]
fn what_was_nowhere_confines_nothing() {
    let base = Hypothesis::known(&door(), &[]);
    for (effect, values) in [("cable_hysteresis", vec![0.1, 0.2, 0.5, 0.1]), ("torque_ripple", vec![0.1, 5.0, 0.0])] {
        let description = effects::find(effect).unwrap().description();
        let values: Vec<f64> = (0..description.parameters.len()).map(|i| values.get(i).copied().unwrap_or(0.1)).collect();
        let hypothesis = base.with(effect, Some("hinge"), &values).unwrap();
        for range in [[f64::MAX, f64::MIN], [0.3, 0.3], [f64::NAN, f64::NAN]] {
            let confined = hypothesis.clone().confined(0, range, range[1] - range[0]);
            for (fitted, x) in confined.fitted.iter().zip(&confined.x) {
                assert!(fitted.bounds[0] <= *x && *x <= fitted.bounds[1], "{effect} over {range:?}: {fitted:?} at {x}");
            }
        }
    }
}

#[test]
fn a_recording_with_a_few_samples_in_a_window_is_sent_back() {
    let mut log = swing(&door(), 1e-4, 1);
    crate::given::check_sampling(&log, &door(), 0.25).unwrap();
    let stretched = |log: &mut Log, by: f64| log.joints[0].position.time.iter_mut().for_each(|t| *t *= by);
    stretched(&mut log, 20.0);
    crate::given::check_sampling(&log, &door(), 1.0).unwrap();
    stretched(&mut log, 50.0);
    let error = crate::find(&door(), &[log], &[], &crate::Options::default()).unwrap_err().to_string();
    assert!(error.contains("too coarsely") && error.contains("5.0000 s") && error.contains("in ms"), "{error}");
}
