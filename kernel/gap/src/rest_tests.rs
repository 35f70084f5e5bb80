//! What stands beside the names: other ways, a learned force, the next experiment.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use sagci_model::ObjectModel;

use crate::baselines::{baselines, free_refit, sparse_regression};
use crate::experiment::{Question, propose};
use crate::fit::{Derivatives, Effort, Fit};
use crate::gaps::Measure;
use crate::hypothesis::Hypothesis;
use crate::remainder::{learn, remainder};
use crate::report::{Experiment, Verdict};
use crate::search::Search;
use crate::tests::{door, driven, led, swing, with};
use crate::trajectory::Trajectory;
use crate::{Options, find};

/// A door of which the URDF says no friction.
fn frictionless() -> ObjectModel {
    let mut model = door();
    model.joints[0].damping = 0.0;
    model
}

fn recorded(truth: &ObjectModel, model: &ObjectModel, seeds: std::ops::Range<u64>) -> Vec<Trajectory> {
    seeds.map(|s| Trajectory::new(&swing(truth, 2e-4, s), model).unwrap()).collect()
}

fn found(hypothesis: &Hypothesis, effect: &str, parameter: &str) -> f64 {
    let model = hypothesis.model_at(&hypothesis.x);
    let entry = model.document.effects.iter().find(|e| e.effect == effect);
    entry.map_or(0.0, |e| e.parameters[parameter])
}

#[test]
fn sparse_regression_finds_two_frictions_and_little_else() {
    let model = frictionless();
    let truth = with(&with(&model, "viscous_friction", &[("damping", 0.15)]), "coulomb_friction", &[("friction", 0.2)]);
    let (train, unseen) = (recorded(&truth, &model, 1..3), recorded(&truth, &model, 5..6));
    let search = Search::new(&model, &train).unwrap();
    let refitted = search.known(&model, 1.0).unwrap();
    let scale = search.scale(&refitted);
    let lacking = search.lacking_forces(&refitted, scale).unwrap();
    let sparse = sparse_regression(&search, (&refitted, &lacking), scale).unwrap();
    let (damping, friction) = (found(&sparse, "viscous_friction", "damping"), found(&sparse, "coulomb_friction", "friction"));
    assert!((damping / 0.15 - 1.0).abs() < 0.2 && (friction / 0.2 - 1.0).abs() < 0.2, "{damping} {friction}");
    let measure = Measure::new(&search, &model, &train, &unseen, 1.0);
    let right = Hypothesis::known(&truth, &search.joints);
    let gap = |h: &Hypothesis| measure.pooled(h, None).unwrap();
    let (without, sparse, named) = (gap(&refitted.hypothesis), gap(&sparse), gap(&right));
    assert!(sparse < 0.02 * without && sparse < 20.0 * named, "{without} {sparse} {named}");
}

/// The free refit may have friction where there was none.
#[test]
fn a_free_refit_takes_friction_up() {
    let model = frictionless();
    let truth = with(&model, "viscous_friction", &[("damping", 0.15)]);
    let train = recorded(&truth, &model, 1..2);
    let search = Search::new(&model, &train).unwrap();
    let refitted = search.known(&model, 1.0).unwrap();
    let free = free_refit(&search, &refitted, search.scale(&refitted)).unwrap();
    let damping = free.hypothesis.model_at(&free.hypothesis.x).joints[0].damping;
    assert!((damping - 0.15).abs() < 0.03, "{damping}");
}

#[test]
fn a_learned_force_stands_in_for_a_smooth_one() {
    let model = door();
    let truth = with(&model, "joint_spring", &[("stiffness", 1.5), ("rest_position", 0.2)]);
    let (train, unseen) = (recorded(&truth, &model, 1..3), recorded(&truth, &model, 5..6));
    let search = Search::new(&model, &train).unwrap();
    let refitted = search.known(&model, 1.0).unwrap();
    let measure = Measure::new(&search, &model, &train, &unseen, 1.0);
    let untouched = Hypothesis { x: Vec::new(), fitted: Vec::new(), known: 0, ..refitted.hypothesis.clone() };
    let before = measure.pooled(&untouched, None).unwrap();
    let lacking = search.lacking_forces(&refitted, search.scale(&refitted)).unwrap();
    let all = baselines(&search, &measure, (&refitted, &lacking), search.scale(&refitted), 1, None);
    assert_eq!(all.len(), 3);
    assert!(all["learned_residual"] < 0.2 * before, "{all:?}");
    assert!(all["free_refit"] <= 1.05 * before, "{all:?}");
    // What is left when nothing was named is learned and kept, and reads as what it is after a round over the disk.
    let (told, kept) = remainder(&search, &measure, &refitted, search.scale(&refitted), [before, 0.0], 1).unwrap();
    assert!(told.kept && told.gap[1] < 0.5 * told.gap[0], "{told:?}");
    let kept = kept.unwrap();
    assert_eq!(sagci_dynamics::residual::Residual::from_bytes(&kept.to_bytes().unwrap()).unwrap(), kept);
}

#[test]
fn on_clean_data_no_learned_force_is_kept() {
    let model = door();
    let (train, unseen) = (recorded(&model, &model, 1..3), recorded(&model, &model, 5..6));
    let search = Search::new(&model, &train).unwrap();
    let refitted = search.known(&model, 1.0).unwrap();
    let scale = search.scale(&refitted);
    let measure = Measure::new(&search, &model, &train, &unseen, 1.0);
    let gap = measure.pooled(&refitted.hypothesis, None).unwrap();
    // A floor of zero says that there may be something to learn.
    let (told, kept) = remainder(&search, &measure, &refitted, scale, [gap, 0.0], 1).unwrap();
    assert!(!told.kept && kept.is_none(), "{told:?}");
    if let Some(residual) = learn(&search, &refitted, &search.lacking_forces(&refitted, scale).unwrap(), scale, 1).unwrap() {
        let with = measure.pooled(&refitted.hypothesis, Some(&residual)).unwrap();
        assert!(with < 1.3 * gap, "{gap} {with}");
    }
}

/// Asks for the experiment between two names, both fitted to a swing of the first, so wide and with so much noise.
fn between(names: [&str; 2], parameters: &[(&str, f64)], starts: [&[f64]; 2], [width, noise]: [f64; 2]) -> Option<Experiment> {
    let model = door();
    let truth = with(&model, names[0], parameters);
    let train: Vec<Trajectory> = (1..3).map(|s| Trajectory::new(&led(&truth, noise, s, width), &model).unwrap()).collect();
    let search = Search::new(&model, &train).unwrap();
    let base = search.known(&model, 1.0).unwrap();
    let fitted = |i: usize| {
        let start = base.hypothesis.with(names[i], Some("hinge"), starts[i]).unwrap();
        Fit::start(&search.problem, start)
            .unwrap()
            .finish(&search.problem, 1.0, Derivatives::FRESH, Effort::to_the_end(f64::NEG_INFINITY))
            .unwrap()
    };
    let (named, rival) = (fitted(0), fitted(1));
    let scale = search.scale(&named);
    propose(
        &search,
        &Question { joint: 0, named: (names[0], &named), rivals: vec![(names[1], rival)], equivalent: &[], confirms: false },
        scale,
    )
}

#[test]
fn a_spring_and_a_tilt_over_a_short_range_ask_for_a_sweep_over_the_full_one() {
    let parameters = [("stiffness", 1.0), ("rest_position", 0.4)];
    let next = between(["joint_spring", "hinge_tilt"], &parameters, [&[1.0, 0.4], &[1.5, 0.0]], [0.3, 2e-4]).unwrap();
    assert_eq!(next.name, "quasi_static_sweep", "{next:?}");
    // The URDF's limits are -0.4 and 2.
    assert!(next.reference.numbers["low"] < -0.3 && next.reference.numbers["high"] > 1.9, "{next:?}");
    assert_eq!(next.separates, ["joint_spring", "hinge_tilt"]);
    assert!(next.expected_log_bayes_factor.unwrap() > 3.0, "{next:?}");
}

#[test]
fn coulomb_and_stribeck_ask_for_slow_speeds() {
    let parameters = [("friction", 0.2), ("static_friction", 0.32), ("stribeck_velocity", 0.02), ("exponent", 2.0)];
    let next = between(["stribeck_friction", "coulomb_friction"], &parameters, [&[0.2, 0.3, 0.02, 2.0], &[0.2]], [1.0, 2e-4]).unwrap();
    let speed = next.reference.numbers.get("slow_speed").or(next.reference.numbers.get("speed")).copied();
    assert!(["quasi_static_sweep", "two_speeds"].contains(&next.name.as_str()) && speed.unwrap() < 0.3, "{next:?}");
}

/// An even friction is a friction by place whose hump is none, so that this follows it whatever the motion; and nothing was asked for. But over a way
/// that was not seen it need not have been none.
#[test]
fn a_rival_that_can_be_the_same_is_told_by_what_it_need_not_have_been() {
    let names = ["coulomb_friction", "position_dependent_friction"];
    let next = between(names, &[("friction", 0.2)], [&[0.2], &[0.2, 0.02, 0.9, 0.3]], [0.2, 1e-3]).unwrap();
    assert_eq!(next.separates, names);
    assert!(next.expected_log_bayes_factor.unwrap() > 3.0, "{next:?}");
}

#[test]
fn no_motion_is_proposed_where_none_helps() {
    let next = between(["torque_gain", "armature_inertia"], &[("gain_error", 0.1)], [&[0.1], &[0.01]], [1.0, 2e-4]).unwrap();
    assert_eq!((next.name.as_str(), next.expected_log_bayes_factor), ("change_payload", None));
}

/// The whole report: all parts are there, and they cost little beside the search.
#[test]
fn a_report_holds_other_ways_and_says_how_to_go_on() {
    let model = frictionless();
    let truth = with(&model, "coulomb_friction", &[("friction", 0.3)]);
    let train: Vec<_> = (1..3).map(|s| swing(&truth, 2e-4, s)).collect();
    let unseen = [swing(&truth, 2e-4, 5)];
    let plain = find(&model, &train, &unseen, &Options { baselines: false, ..Options::default() }).unwrap().report;
    assert!(plain.baselines.is_empty());
    let report = find(&model, &train, &unseen, &Options::default()).unwrap().report;
    let after = report.gap.held_out.as_ref().unwrap().after;
    assert_eq!(report.baselines.len(), 4);
    assert!(report.baselines["no_model_change"] > 3.0 * after && report.baselines["learned_residual"] > 0.9 * after, "{report:?}");
    assert!(!report.residual.unwrap().kept);
    let page = crate::page("door", &find(&model, &train[..1], &[], &Options { baselines: false, ..Options::default() }).unwrap());
    // Nothing was held out, so what is named wants to be confirmed.
    assert!(page.contains("Next experiment") && page.contains("sagci gap"), "{page}");
}

/// The fitted data keep away from a detent that the held-out ones go through: no name can be found, but no gap is no answer either.
#[test]
fn what_only_held_out_data_show_is_no_missing_gap() {
    let model = door();
    let truth = with(&model, "detent", &[("force", 1.0), ("position", 2.0), ("width", 0.08)]);
    let train: Vec<_> = (1..3).map(|s| led(&truth, 2e-4, s, 0.4)).collect();
    let answer =
        |held_out: sagci_recording::Log| find(&model, &train, &[held_out], &Options { baselines: false, ..Options::default() }).unwrap();
    let (through, away) = (answer(led(&truth, 2e-4, 5, 2.0)).report, answer(led(&truth, 2e-4, 5, 0.4)).report);
    assert!(through.effects.is_empty(), "{:?}", through.effects);
    assert_eq!((through.verdict, away.verdict), (Verdict::Unknown, Verdict::NoGap), "{:?} {:?}", through.gap, away.gap);
    assert!(through.unexplained.is_some() && through.next_experiment.is_some());
}

/// A buffer at the end of the way, as real stops and other simulators' have one: a URDF's limit says nothing of it, and a sensor that reads too low
/// or a stop elsewhere is none of what is missing.
#[test]
fn a_limit_that_gives_way_is_not_named() {
    let model = door();
    let soft = |truth: &ObjectModel| {
        with(truth, "hard_stop", &[("stiffness", 150.0), ("dissipation", 1500.0), ("position", -0.4), ("side", -1.0)])
    };
    let record = |truth: &ObjectModel| -> Vec<_> {
        let way = |seed: u64| move |t: f64| 0.1 + 0.75 * (1.3 * t + seed as f64).sin() + 0.2 * (2.9 * t).cos();
        (1..4).map(|seed| driven(truth, 1e-4, seed, 0.1, way(seed))).collect()
    };
    let asked = |truth: &ObjectModel| {
        let mut logs = record(&soft(truth));
        let unseen = logs.split_off(2);
        // Leant against the stop all the time.
        logs.push(driven(&soft(truth), 1e-4, 4, -0.41, |_| -0.6));
        let options = Options { baselines: false, ..Options::default() };
        find(&model, &logs, &unseen, &options).unwrap().report
    };
    let report = asked(&model);
    assert_eq!(report.verdict, Verdict::NoGap, "{:?} {:?}", report.effects, report.notes);
    assert!(report.notes.iter().any(|n| n.contains("its lower limit of -0.4, which stops it and gives way")), "{:?}", report.notes);
    let report = asked(&with(&model, "coulomb_friction", &[("friction", 0.1)]));
    assert!(report.verdict == Verdict::Named && report.effects[0].name == "coulomb_friction", "{:?}", report.effects);
}
