#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use sagci_model::ObjectModel;

use crate::fit::Fit;
use crate::gaps::Measure;
use crate::hypothesis::Hypothesis;
use crate::search::Search;
use crate::tests::{door, led, with};
use crate::trajectory::Trajectory;

/// A door that rubs, is sprung and rubs unevenly: with the last left out, a model is off.
fn uneven() -> ObjectModel {
    let rubbing = with(&door(), "coulomb_friction", &[("friction", 0.2)]);
    let sprung = with(&rubbing, "joint_spring", &[("stiffness", 1.0), ("rest_position", 0.6)]);
    with(&sprung, "position_dependent_friction", &[("friction", 0.01), ("amplitude", 0.5), ("position", 0.9), ("width", 0.15)])
}

fn recorded(seeds: std::ops::Range<u64>) -> Vec<Trajectory> {
    seeds.map(|seed| Trajectory::new(&led(&uneven(), 2e-4, seed, 1.0), &door()).unwrap()).collect()
}

fn sprung(search: &Search<'_>) -> Hypothesis {
    let known = Hypothesis::known(&door(), &search.joints);
    let rubbing = known.with("coulomb_friction", Some("hinge"), &[0.2]).unwrap();
    rubbing.with("joint_spring", Some("hinge"), &[1.0, 0.6]).unwrap()
}

fn fitted(search: &Search<'_>, hypothesis: Hypothesis) -> Fit {
    let start = Fit::start(&search.problem, hypothesis).unwrap();
    let scale = search.scale(&start);
    search.fit_on(start, scale).unwrap()
}

/// What is left out pulls the numbers of a filter to where a row is predicted best.
#[test]
fn a_model_that_lacks_something_predicts_a_second_no_better_by_numbers_fitted_to_seconds() {
    let (train, unseen) = (recorded(1..4), recorded(7..9));
    let search = Search::new(&door(), &train).unwrap();
    let by_rows = fitted(&search, sprung(&search));
    let own = Measure::new(&search, &door(), &train, &[], 1.0);
    let there = Measure::new(&search, &door(), &train, &unseen, 1.0);
    let over = search.over_windows(&by_rows, &own).unwrap().expect("numbers that predict windows better");
    let gap = |measure: &Measure<'_>, fit: &Fit| measure.pooled(&fit.hypothesis, None).unwrap();
    assert!(gap(&own, &over.fit) < 0.9 * gap(&own, &by_rows), "{} {}", gap(&own, &over.fit), gap(&own, &by_rows));
    assert!(gap(&there, &over.fit) < gap(&there, &by_rows), "{} {}", gap(&there, &over.fit), gap(&there, &by_rows));
    assert!(over.variances.unwrap().iter().all(|v| *v > 0.0));
}

/// A door rubs three times as hard in two recordings of five. By the numbers of the three most windows are predicted as well as noise lets any; by
/// others none is, and the farthest are nearer.
#[test]
fn windows_that_no_numbers_predict_are_no_reason_to_give_up_those_that_predict_most() {
    let rubbing = |friction: f64| with(&door(), "coulomb_friction", &[("friction", friction)]);
    let recorded = |seed: u64| Trajectory::new(&led(&rubbing(if seed < 4 { 0.2 } else { 0.6 }), 2e-4, seed, 1.0), &door()).unwrap();
    let train: Vec<Trajectory> = (1..6).map(recorded).collect();
    let search = Search::new(&door(), &train).unwrap();
    let known = Hypothesis::known(&door(), &search.joints).with("coulomb_friction", Some("hinge"), &[0.2]).unwrap();
    let by_rows = Fit::start(&search.problem, known).unwrap();
    let own = Measure::new(&search, &door(), &train, &[], 1.0);
    assert!(search.over_windows(&by_rows, &own).unwrap().is_none());
}

/// Errors of a model that lacks something bend to many names, and each row seems to say so.
#[test]
fn a_name_that_makes_no_second_better_stays_beside_those_that_do() {
    let train = recorded(1..4);
    let search = Search::new(&door(), &train).unwrap();
    let own = Measure::new(&search, &door(), &train, &[], 1.0);
    let needed = fitted(&search, sprung(&search));
    assert!(own.needless(&needed.hypothesis).unwrap().is_empty());
    let more = needed.hypothesis.with("torque_ripple", Some("hinge"), &[0.02, 12.0, 0.0]).unwrap();
    assert_eq!(own.needless(&fitted(&search, more).hypothesis).unwrap(), [2]);
}
