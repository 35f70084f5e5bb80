#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use nalgebra::DVector;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use sagci_dynamics::effects;
use sagci_model::ObjectModel;

use crate::alike::{Circumstances, alike as alike_by_equations, call_by_plain_name};
use crate::choice::Choice;
use crate::fit::Fit;
use crate::hypothesis::Hypothesis;
use crate::noise;
use crate::search::{Candidate, Search};
use crate::shape::is_bent;
use crate::starts::Seen;
use crate::tests::{door, driven, swing, with};
use crate::trajectory::Trajectory;

/// The search's hypothesis with an effect, as if it had been fitted with these errors; the data say as much of its numbers as is given.
fn candidate(search: &Search<'_>, effect: &'static str, values: &[f64], errors: &DVector<f64>, evidence: f64, told: &[f64]) -> Candidate {
    let known = Hypothesis::known(&door(), &search.joints);
    let hypothesis = known.with(effect, Some("hinge"), values).unwrap();
    let unit = DVector::from_element(errors.len(), 1.0 / (errors.len() as f64).sqrt());
    let sizes = std::iter::repeat_n(&1.0, known.x.len()).chain(told);
    let jacobian = hypothesis.fitted.iter().zip(sizes).map(|(f, size)| &unit * (100.0 * size / f.prior[1])).collect();
    let squares = errors.norm_squared();
    let fit = Fit { hypothesis, errors: errors.clone(), squares, jacobian, judged: squares, since: 0.0 };
    Candidate { effect, joint: Some(0), fit, evidence }
}

/// Names beside the first that data with such errors cannot tell from it.
fn alike(make: impl Fn(&Search<'_>, usize) -> Vec<Candidate>) -> Vec<&'static str> {
    let trajectories = [Trajectory::new(&swing(&door(), 2e-4, 1), &door()).unwrap()];
    let search = Search::new(&door(), &trajectories).unwrap();
    let candidates = make(&search, trajectories[0].position.len());
    let choice = Choice::new(&search, &candidates, candidates[0].evidence - 1000.0, 0.0, 1.0, 1.0);
    choice.alike[1..].iter().map(|c| c.effect).collect()
}

/// Signs that are drawn anew after so many rows.
fn signs(rows: usize, length: usize) -> DVector<f64> {
    let mut random = Pcg64::seed_from_u64(5);
    let drawn: Vec<f64> = (0..rows.div_ceil(length)).map(|_| noise::normal(&mut random).signum()).collect();
    DVector::from_fn(rows, |k, _| drawn[k / length])
}

/// Twenty rows that are off together say no more than one: a difference of 8 nats is one of less than 1.
#[test]
fn names_are_not_told_apart_by_errors_that_go_on() {
    let names = |length: usize| {
        alike(|search, rows| {
            let errors = signs(rows, length);
            // Others, drawn on, by so much that the sum of squares is 16 more.
            let others = signs(rows + length, length).rows(length, rows).into_owned();
            let (s, n) = (errors.dot(&others), others.norm_squared());
            let other = &errors + others * (((s * s + 16.0 * n).sqrt() - s) / n);
            vec![
                candidate(search, "viscous_friction", &[0.1], &errors, 0.0, &[1.0]),
                candidate(search, "quadratic_drag", &[0.1], &other, -8.0, &[1.0]),
            ]
        })
    };
    assert_eq!(names(1), Vec::<&str>::new());
    assert_eq!(names(20), ["quadratic_drag"]);
}

/// What was expected of the sizes of as many numbers is an engineer's estimate: eight nats of it tell no names apart that leave the same errors.
#[test]
fn names_are_not_told_apart_by_what_was_expected_of_their_sizes() {
    let beside = |effect: &'static str, values: &[f64]| {
        alike(|search, rows| {
            let (errors, told) = (signs(rows, 1), vec![1.0; values.len()]);
            let other = errors.add_scalar(1e-4);
            vec![
                candidate(search, "coulomb_friction", &[0.1], &errors, 0.0, &[1.0]),
                candidate(search, effect, values, &other, -8.0, &told),
            ]
        })
    };
    assert_eq!(beside("viscous_friction", &[0.1]), ["viscous_friction"]);
    assert_eq!(beside("stribeck_friction", &[0.1, 0.2, 0.1, 2.0]), Vec::<&str>::new(), "it has more numbers");
}

/// A name that says more than the one that was chosen may have been refused for its windows or its numbers: by the windows alone it is not out.
#[test]
fn what_says_more_by_no_more_numbers_is_not_left_out() {
    let beside = |effect: &'static str, values: &[f64]| {
        alike(|search, rows| {
            let (errors, told) = (signs(rows, 1), vec![1.0; values.len()]);
            vec![
                candidate(search, "coulomb_friction", &[0.1], &errors, 0.0, &[1.0]),
                candidate(search, effect, values, &errors, 8.0, &told),
            ]
        })
    };
    assert_eq!(beside("quadratic_drag", &[0.1]), ["quadratic_drag"]);
    assert_eq!(beside("stribeck_friction", &[0.1, 0.2, 0.1, 2.0]), Vec::<&str>::new());
}

/// A friction whose further number does nothing is the plain friction again; an axis that is off is no encoder, however many numbers it has.
#[test]
fn an_idle_number_makes_a_plainer_name_of_its_own_kind_alone() {
    let beside = |first: (&'static str, &[f64]), second: (&'static str, &[f64])| {
        alike(|search, rows| {
            let errors = signs(rows, 1);
            let mut told = vec![1.0; second.1.len()];
            *told.last_mut().unwrap() = 0.0;
            vec![candidate(search, first.0, first.1, &errors, 0.0, &[1.0; 2]), candidate(search, second.0, second.1, &errors, -1.0, &told)]
        })
    };
    assert_eq!(beside(("coulomb_friction", &[0.1]), ("stribeck_friction", &[0.1, 0.2, 0.1, 2.0])), Vec::<&str>::new());
    let axis = [0.02, 1.0, 0.0, 0.0, 0.001, 0.001, 0.001];
    assert_eq!(beside(("encoder_offset", &[0.01, 0.0]), ("joint_axis_error", &axis)), ["joint_axis_error"]);
}

/// What is read too high by as much all the time: no data say of a sensor whether it will drift one day.
#[test]
fn a_drift_without_a_rate_is_an_offset() {
    let seen = Seen { commanded: false, read: false, one_way: false, weighed: true };
    let drift = Circumstances { alone: false, turns: true, range: 3.0, seen, constant: true, of_effort: false, ahead: false };
    assert_eq!(alike_by_equations("sensor_drift", drift), ["encoder_offset"]);
    assert_eq!(alike_by_equations("sensor_drift", Circumstances { of_effort: true, ..drift }), ["torque_bias"]);
    assert_eq!(alike_by_equations("sensor_drift", Circumstances { constant: false, ..drift }), [""; 0]);
    // The effort that is read beside a command drives nothing.
    let commanded = Circumstances { of_effort: true, seen: Seen { commanded: true, read: true, ..seen }, ..drift };
    assert_eq!(alike_by_equations("sensor_drift", commanded), [""; 0]);
}

/// No input acts before it was sent: a clock that is ahead is the clock alone.
#[test]
fn a_clock_that_is_ahead_is_no_late_drive() {
    let seen = Seen { commanded: true, read: false, one_way: false, weighed: true };
    let late = Circumstances { alone: true, turns: true, range: 3.0, seen, constant: false, of_effort: false, ahead: false };
    assert_eq!(alike_by_equations("clock_skew", late), ["transport_delay"]);
    assert_eq!(alike_by_equations("clock_skew", Circumstances { ahead: true, ..late }), [""; 0]);
    // The others of an arm feel when one of its joints moves.
    assert_eq!(alike_by_equations("clock_skew", Circumstances { alone: false, ..late }), [""; 0]);
}

#[test]
fn what_does_not_drift_is_called_an_offset() {
    let trajectories = [Trajectory::new(&swing(&door(), 2e-4, 1), &door()).unwrap()];
    let search = Search::new(&door(), &trajectories).unwrap();
    let errors = signs(trajectories[0].position.len(), 1);
    let first_of = |of: f64, rate: f64, less: f64| {
        let mut all = vec![
            candidate(&search, "sensor_drift", &[0.05, rate, of], &errors, 0.0, &[1.0, 1e4]),
            candidate(&search, "encoder_offset", &[0.05, 0.0], &errors, -less, &[1.0; 2]),
        ];
        call_by_plain_name(&mut all);
        all[0].effect
    };
    let first = |rate: f64, less: f64| first_of(0.0, rate, less);
    assert_eq!(first(0.0, 2.0), "encoder_offset");
    assert_eq!(first_of(1.0, 0.0, 2.0), "sensor_drift", "an effort that is read too high is no encoder's offset");
    assert_eq!(first(0.01, 2.0), "sensor_drift", "it drifts");
    assert_eq!(first(0.0, 200.0), "sensor_drift", "no offset says as much");
    // Nor is it a name beside the offset.
    let beside = alike(|search, rows| {
        let errors = signs(rows, 1);
        vec![
            candidate(search, "encoder_offset", &[0.05, 0.0], &errors, 0.0, &[1.0; 2]),
            candidate(search, "sensor_drift", &[0.05, 0.0, 0.0], &errors, -1.0, &[1.0; 2]),
        ]
    });
    assert_eq!(beside, Vec::<&str>::new());
}

/// The likeliest say nearly the same in many numbers, and the plain one that is part of the truth comes behind them.
#[test]
fn two_plain_losses_are_named_where_more_than_a_few_rich_ones_stand_before_either() {
    let mut model = door();
    model.joints[0].damping = 0.0;
    let truth = with(&with(&model, "viscous_friction", &[("damping", 0.2)]), "coulomb_friction", &[("friction", 0.05)]);
    let trajectories = [Trajectory::new(&swing(&truth, 2e-5, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let base = search.known(&model, 1.0).unwrap();
    let fitted = |effect: &'static str, values: &[f64]| {
        let hypothesis = base.hypothesis.with(effect, Some("hinge"), values).unwrap();
        let fit = search.fit_on(Fit::start(&search.problem, hypothesis).unwrap(), 1.0).unwrap();
        Candidate { effect, joint: Some(0), evidence: search.evidence(&fit, 1.0), fit }
    };
    let mut candidates = vec![fitted("asymmetric_friction", &[0.05, 0.05, 0.2, 0.2]); 8];
    candidates.push(fitted("viscous_friction", &[0.2]));
    assert!(candidates[0].evidence > candidates[8].evidence + 100.0, "the plain one alone says all");
    search.prefer_two(&model, &base, &mut candidates, 1.0, 1.0).unwrap();
    assert_eq!(candidates[0].effect, "viscous_friction");
}

/// Beside an unstable rest windows end anywhere, with the right name, too.
#[test]
fn what_leaves_nothing_but_noise_is_there_though_windows_come_no_nearer() {
    let model = door();
    let data: Vec<Trajectory> = (1..4).map(|seed| Trajectory::new(&swing(&model, 1e-4, seed), &model).unwrap()).collect();
    let search = Search::new(&model, &data).unwrap();
    let mut random = Pcg64::seed_from_u64(3);
    let mut white = |size: f64| DVector::from_fn(search.problem.entries(), |_, _| size * noise::normal(&mut random));
    let (noise, signal) = (white(0.9), white(0.4));
    let is_there = |left: &DVector<f64>| {
        let fit = |errors: DVector<f64>, damping: f64| candidate(&search, "viscous_friction", &[damping], &errors, 0.0, &[]).fit;
        let (less, more) = (fit(left + &signal, 1e-7), fit(left.clone(), 1.1e-7));
        let gain = 0.5 * (less.squares - more.squares);
        assert!(gain > 150.0, "{gain}");
        search.is_material(&model, (&less, &more), (gain, 0.004), 1.0).unwrap()
    };
    assert!(is_there(&noise));
    // What bends to the errors of a model leaves some.
    assert!(!is_there(&(&noise * 1.5)));
}

/// The same force is there in most recordings and goes the other way in some: of all windows together a name makes it worse.
#[test]
fn what_makes_the_usual_window_clearly_nearer_is_there_though_a_few_end_far_off() {
    let model = door();
    let is_there = |lasting: usize| {
        let pushed = |i: usize| with(&model, "torque_bias", &[("bias", if i < lasting { 0.01 } else { -0.02 })]);
        let data: Vec<Trajectory> = (0..6).map(|i| Trajectory::new(&swing(&pushed(i), 1e-5, i as u64), &model).unwrap()).collect();
        let search = Search::new(&model, &data).unwrap();
        let less = Fit::start(&search.problem, Hypothesis::known(&model, &search.joints)).unwrap();
        let more = Fit::start(&search.problem, less.hypothesis.with("torque_bias", Some("hinge"), &[0.01]).unwrap()).unwrap();
        assert!(search.left_of_gap(&model, &less, &more, 1.0) > 1.0, "a mean over windows says no");
        search.is_material(&model, (&less, &more), (50.0, 0.03), 1.0).unwrap()
    };
    assert!(is_there(4));
    assert!(!is_there(2), "most go the other way");
}

/// Drag that grows faster than the square of speed is imitated by a friction that rises with it, a spring that is stiffer beyond a place by a
/// stop that a joint goes half its way into.
#[test]
fn a_name_is_not_bent_to_another_shape() {
    let trajectories = [Trajectory::new(&swing(&door(), 2e-4, 1), &door()).unwrap()];
    let search = Search::new(&door(), &trajectories).unwrap();
    let errors = signs(trajectories[0].position.len(), 1);
    let is_shaped = |effect: &'static str, values: &[f64]| {
        search.is_shaped(&candidate(&search, effect, values, &errors, 0.0, &vec![1.0; values.len()]).fit)
    };
    assert!(is_shaped("stribeck_friction", &[1.0, 1.5, 0.1, 2.0]));
    assert!(!is_shaped("stribeck_friction", &[32.0, 0.005, 5.6, 3.1]));
    // What holds a joint the longer the longer it stood is no hump in a curve by speed.
    let bent = |values: &[f64]| is_bent(&candidate(&search, "stribeck_friction", values, &errors, 0.0, &[1.0; 4]).fit);
    assert!(bent(&[0.12, 1.4, 0.03, 2.0]) && !bent(&[1.0, 2.0, 0.03, 2.0]));
    // Bristles that slide as they break away, but for what a fit is off by.
    assert!(is_shaped("presliding_hysteresis", &[1e3, 1.0, 1.0, 0.95, 0.1]));
    assert!(!is_shaped("presliding_hysteresis", &[1e3, 1.0, 1.5, 1.0, 0.1]));
    let seen = || trajectories[0].positions(0);
    let [low, high] = [seen().fold(f64::MAX, f64::min), seen().fold(f64::MIN, f64::max)];
    let stop = |share: f64, side: f64| is_shaped("hard_stop", &[1e3, 1e2, low + share * (high - low), side]);
    assert!(stop(0.8, 1.0) && stop(0.2, -1.0) && stop(1.5, 1.0), "it stops the joint, or is never reached");
    assert!(!stop(0.6, 1.0) && !stop(0.4, -1.0));
    // What turns the joint round in half a second is a spring of one side.
    assert!(!is_shaped("hard_stop", &[search.inertias[0] * 36.0, 1.0, low + 0.8 * (high - low), 1.0]));
    // A latch that the joint goes into and never leaves is a spring of another shape.
    let latch = |from: f64, to: f64| is_shaped("latch", &[4.0, 1.0, low + from * (high - low), (to - from) * (high - low)]);
    assert!(latch(0.1, 0.3) && !latch(0.4, 1.5) && !latch(-0.5, 0.3));
    // A mass that nothing moves explains a motion that goes on as it went.
    let payload = |mass: f64| is_shaped("payload", &[mass, 0.3, 0.0, 0.0]);
    assert!(payload(3.0) && !payload(300.0));
}

/// "It stays where it is" forecasts a slow motion from row to row better than a force that is not known exactly: a friction that holds a light
/// door wherever it is put says just that, while the door goes on.
#[test]
fn a_friction_that_holds_a_joint_in_all_rows_in_which_it_moves_is_none() {
    let mut light = door();
    let link = light.joints[light.moving_joints().next().unwrap()].child;
    let body = &mut light.links[link].inertial;
    (body.mass, body.I_LLcm_L) = (0.01 * body.mass, body.I_LLcm_L * 0.01);
    let is_shaped = |truth: &ObjectModel, effect: &'static str, values: &[f64]| {
        let way = |t: f64| 0.5 + 0.12 * t;
        let trajectories = [Trajectory::new(&driven(truth, 2e-5, 1, 0.5, way), &light).unwrap()];
        let search = Search::new(&light, &trajectories).unwrap();
        let named = Hypothesis::known(&light, &search.joints).with(effect, Some("hinge"), values).unwrap();
        search.is_shaped(&Fit::start(&search.problem, named).unwrap())
    };
    let pulled = with(&light, "magnetic_gasket", &[("force", 0.6), ("width", 0.4)]);
    assert!(!is_shaped(&pulled, "coulomb_friction", &[2.0]) && is_shaped(&pulled, "magnetic_gasket", &[0.5, 0.4]));
    let rubs = with(&light, "coulomb_friction", &[("friction", 0.3)]);
    assert!(is_shaped(&rubs, "coulomb_friction", &[0.29]) && !is_shaped(&rubs, "coulomb_friction", &[2.0]));
}

/// Put beyond its stop by whoever begins a recording, a joint is thrown out within milliseconds.
#[test]
fn a_stop_that_a_recording_begins_beyond_is_one() {
    let mut trajectory = Trajectory::new(&swing(&door(), 2e-4, 1), &door()).unwrap();
    let [low, high] = Trajectory::range([&trajectory], 0);
    let stop = |trajectory: Trajectory| {
        let trajectories = [trajectory];
        let search = Search::new(&door(), &trajectories).unwrap();
        let errors = signs(trajectories[0].position.len(), 1);
        search.is_shaped(&candidate(&search, "hard_stop", &[1e3, 1e2, low, -1.0], &errors, 0.0, &[1.0; 4]).fit)
    };
    trajectory.position[..20].fill(low - (high - low));
    assert!(stop(trajectory.clone()));
    trajectory.position[..200].fill(low - (high - low));
    assert!(!stop(trajectory), "it stays there");
}

/// Errors that are a hundred times as large by what models are compared by: a joint that sticks in the model makes its own weigh nothing, and all
/// others would be told apart by them.
#[test]
fn how_large_errors_are_is_not_said_by_a_model_in_which_a_joint_sticks() {
    let trajectories = [Trajectory::new(&swing(&door(), 2e-4, 1), &door()).unwrap()];
    let search = Search::new(&door(), &trajectories).unwrap();
    let errors = signs(trajectories[0].position.len(), 1);
    let mut fit = candidate(&search, "coulomb_friction", &[0.1], &errors, 0.0, &[1.0]).fit;
    let own = search.scale(&fit);
    assert!((search.scale_as_judged(&fit) - own).abs() < 1e-9 * own);
    fit.judged = 1e4 * fit.squares;
    assert!((search.scale_as_judged(&fit) - 100.0 * own).abs() < 1e-6 * own);
}

/// Bristles so soft that they hardly slide where the Stribeck curve is: the force that they break away with is told by nobody. By its own size
/// it went to where forces of joints are, many times the one that they slide with.
#[test]
fn what_data_do_not_tell_of_breaking_away_stays_near_sliding() {
    let model = door();
    let bristles = |static_friction: f64| {
        let rest = [("stiffness", 0.4), ("micro_damping", 1e-3), ("friction", 0.05), ("stribeck_velocity", 0.05)];
        let names = ["stiffness", "micro_damping", "friction", "static_friction", "stribeck_velocity"];
        names.map(|name| (name, rest.iter().find(|r| r.0 == name).map_or(static_friction, |r| r.1)))
    };
    let truth = with(&model, "presliding_hysteresis", &bristles(0.055));
    let data = [1, 2].map(|seed| Trajectory::new(&swing(&truth, 1e-4, seed), &model).unwrap());
    let search = Search::new(&model, &data).unwrap();
    let base = search.known(&model, 1.0).unwrap();
    let begun = base.hypothesis.with("presliding_hysteresis", Some("hinge"), &bristles(0.2).map(|p| p.1)).unwrap();
    let fit = search.fit_on(Fit::start(&search.problem, begun).unwrap(), 1.0).unwrap();
    let found = &fit.hypothesis.model_at(&fit.hypothesis.x).document.effects[0].parameters;
    let times = found["static_friction"] / found["friction"];
    assert!((0.8..2.5).contains(&times), "{found:?}");
    assert!((found["friction"] / 0.05 - 1.0).abs() < 0.1, "{found:?}");
}

/// Neighbours of a fitted effect on data of a door with another, the most likely first, and the evidence of what was fitted.
fn beside(truth: &ObjectModel, effect: &'static str, values: &[f64]) -> (f64, Vec<Candidate>) {
    beside_in(&[1, 2].map(|seed| Trajectory::new(&swing(truth, 1e-4, seed), &door()).unwrap()), effect, values)
}

/// The same on such data.
fn beside_in(data: &[Trajectory], effect: &'static str, values: &[f64]) -> (f64, Vec<Candidate>) {
    let model = door();
    let mut search = Search::new(&model, data).unwrap();
    // Effects of a drive are asked for, too.
    search.seen[0].commanded = true;
    let base = search.known(&model, 1.0).unwrap();
    let views = search.views(&base, 1.0).unwrap();
    let begun = base.hypothesis.with(effect, Some("hinge"), values).unwrap();
    let fit = search.fit_on(Fit::start(&search.problem, begun).unwrap(), 1.0).unwrap();
    let evidence = search.evidence(&fit, 1.0);
    let mut all = vec![Candidate { effect, joint: Some(0), fit, evidence }];
    search.ask_neighbours(&base, &views, &mut all, 1.0);
    (evidence, all)
}

/// Where a friction of bristles was lost at its own beginnings it is found from where a loop of friction, the winner without it, has ended.
#[test]
fn a_lost_neighbour_is_found_where_the_winner_ended() {
    let bristles =
        [("stiffness", 8.0), ("micro_damping", 0.01), ("friction", 0.05), ("static_friction", 0.09), ("stribeck_velocity", 0.05)];
    let truth = with(&door(), "presliding_hysteresis", &bristles);
    let (evidence, all) = beside(&truth, "cable_hysteresis", &[1e-3, 0.9, 0.05, 0.01, 0.003]);
    let names: Vec<&str> = all.iter().map(|c| c.effect).collect();
    assert_eq!(names, ["presliding_hysteresis", "cable_hysteresis"]);
    assert!(all[0].evidence > evidence + 10.0, "{} for {evidence}", all[0].evidence);
}

/// Of a magnet's two shapes the wrong one was ahead after the first steps, and a detent was named for what it left.
#[test]
fn the_other_shape_of_a_name_is_asked_where_the_first_has_ended() {
    let hypothesis = Hypothesis::known(&door(), &[0]);
    let pulls = hypothesis.with("magnetic_gasket", Some("hinge"), &[0.3, 0.1, 1.0]).unwrap();
    let (evidence, all) = beside(&pulls.model_at(&pulls.x), "magnetic_gasket", &[0.3, 0.06, 0.0]);
    assert!(all.len() == 1 && all[0].evidence > evidence + 10.0, "{} for {evidence}", all[0].evidence);
    let found = all[0].fit.hypothesis.model_at(&all[0].fit.hypothesis.x).document.effects.pop().unwrap();
    assert_eq!(found.choices["shape"], "inverse_square");
}

/// Teeth of an engine that rebound were a rigid play and three other effects, none of which windows needed, and "unknown".
#[test]
fn teeth_that_rebound_are_a_play_that_gives_way() {
    let teeth = [("half_gap", 0.02), ("rotor_inertia", 0.03), ("stiffness", 2500.0), ("damping", 2.0)];
    let truth = with(&door(), "backlash", &teeth);
    let way = |t: f64| 0.8 + 0.4 * (3.0 * t).sin() + 0.2 * (7.3 * t + 1.0).sin();
    let data = [1, 2].map(|seed| Trajectory::new(&driven(&truth, 2e-5, seed, 0.8, |t| way(t + seed as f64)), &door()).unwrap());
    let (evidence, all) = beside_in(&data, "backlash", &[0.02, 0.03, effects::RIGID_TEETH, 0.0, 0.0]);
    assert!(all[0].effect == "backlash" && all[0].evidence > evidence + 100.0, "{} for {evidence}", all[0].evidence);
    let found = &all[0].fit.hypothesis.model_at(&all[0].fit.hypothesis.x).document.effects[0].parameters;
    for (name, value) in &teeth[..2] {
        assert!((found[*name] / value - 1.0).abs() < 0.1, "{found:?}");
    }
}
