#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use crate::fit::Fit;
use crate::hypothesis::{Hypothesis, Knob};
use crate::search::Search;
use crate::tests::{door, swing, with};
use crate::trajectory::Trajectory;

/// A spring's rest and an encoder's zero are one number to a door: where they stand in it nothing but their priors says. Differences by each
/// of them carry what dry friction does in each run, and took that for knowledge.
#[test]
fn numbers_that_show_alike_are_known_no_better_than_before_and_settle_where_they_were_expected() {
    let model = door();
    let spring = [("stiffness", 0.6), ("rest_position", 0.5)];
    let truth = with(&with(&model, "joint_spring", &spring), "coulomb_friction", &[("friction", 0.05)]);
    let trajectories = [Trajectory::new(&swing(&truth, 2e-5, 1), &model).unwrap()];
    let mut search = Search::new(&model, &trajectories).unwrap();
    search.finer();
    search.problem.smooth = true;
    let shifted = |offset: f64| -> Hypothesis {
        let known = Hypothesis::known(&model, &search.joints).with("coulomb_friction", Some("hinge"), &[0.05]).unwrap();
        let sprung = known.with("joint_spring", Some("hinge"), &[0.6, 0.5 - offset]).unwrap();
        sprung.with("encoder_offset", Some("hinge"), &[offset, 0.0]).unwrap()
    };
    let number = |fit: &Fit| fit.hypothesis.fitted.iter().position(|f| matches!(f.knob, Knob::Effect(_, "offset"))).unwrap();
    let prior = |fit: &Fit| fit.hypothesis.fitted[number(fit)].prior[1];

    let begun = search.anew(&search.fit_on(Fit::start(&search.problem, shifted(0.03)).unwrap(), 1.0).unwrap());
    let end = begun.clone().followed(&search.problem, 1.0).unwrap();
    let at = |fit: &Fit| fit.hypothesis.x[number(fit)] / prior(fit);
    assert!(at(&end).abs() < 0.5, "it stands still {} deviations from where it is expected, and began at {}", at(&end), at(&begun));

    let there = end.along_directions(&search.problem, 1.0).unwrap();
    let known = there.variances(&search.problem, 1.0).unwrap()[number(&there)].sqrt() / prior(&there);
    assert!(known > 0.9, "known to {known} of what was expected, by data that say nothing of it");
}
