//! Names that are no more than the nearest neighbours of what is there.
//!
//! The catalogue has no name for much that machines do, and of those that it has one always comes nearest. What tells is how much is left with it,
//! and what a force without a name says in its stead: its knots cost it what a shape that is right does not pay.

use crate::report::Gap;
use crate::weigh::CONVINCING;

/// What a force that names leave over is of theirs, or what they leave is of the gap, from which on they may be its neighbours alone, and the share
/// of what they say that one without a name has to say then.
pub(crate) const GOOD_PART: f64 = 0.1;
pub(crate) const NEARLY: f64 = 0.9;
/// Share of the gap below which what is left of it is little.
const SOME: f64 = 0.05;
/// Share of the force that lacks, from which on more of it is left than names explain, by a third.
const MOST_OF_FORCE: f64 = 0.8;
/// Share of the gap that names may leave where much more is left than noise makes, or as much of the force.
pub(crate) const MOST_OF_IT: f64 = 0.5;
/// The same of names that leave a force: 380 answers that were right left no more than a seventh, those that came near what has no name a little
/// more than that and up.
const TOO_MUCH: f64 = 1.0 / 7.0;
/// Share of the gap that is much of it, and how many times as much as names one without a name says that does better.
const MUCH: f64 = 0.4;
const MUCH_MORE: f64 = 1.2;
/// How many times as large names may make the gap: where it is small, or motion unstable, chance makes it larger, too.
pub(crate) const GROWN: f64 = 1.5;
/// Share of the gap that a learned force leaves of what names leave, below which it takes much of that.
const LEARNED: f64 = 2.0 / 3.0;
const BETTER: &str = "a force without a name fits better";

/// Names beside forces without one.
#[derive(Clone, Copy)]
pub(crate) struct Beside<'a> {
    /// The gap with the names, over data that nothing was fitted to, if there are some.
    pub shown: &'a Gap,
    /// And over those that all was fitted to.
    pub fitted: &'a Gap,
    /// What the evidence gains by the names, by a force without a name on what they leave, and by one instead of them.
    pub said: f64,
    pub left: f64,
    pub all: f64,
    /// Share of the force left of all that is lacking; none where it is not there.
    pub share: f64,
    /// It is told from nothing, and large beside what the names explain.
    pub told: bool,
    pub large: bool,
    /// Share of the gap on unseen data that a force leaves which was learned beside the names; one where none is kept.
    pub learned: f64,
    /// Data that nothing was fitted to confirm none of the names.
    pub unconfirmed: bool,
}

impl Beside<'_> {
    /// What the evidence gains by a force on what the names leave, where it is there and some of the gap is left.
    pub fn leaves(&self) -> Option<f64> {
        (self.share > 0.0 && self.shown.left() > SOME).then_some(self.left)
    }

    /// Why the names are the neighbours alone of what is there.
    pub fn only_near(&self) -> Option<&'static str> {
        let Self { shown, fitted, said, left, all, share, told, large, learned, unconfirmed } = *self;
        let is_left = left > 2.0 * CONVINCING;
        let far = shown.is_far() && told && is_left;
        let as_well = all > NEARLY * said;
        // By so much over all windows: a friction that binds for moments is far off in few of them.
        let leaves = |gap: &Gap, part: f64| gap.after > part * gap.refitted && gap.is_far();
        // Where unseen data hardly show what is missing, and the names leave next to nothing of it where it shows, what is left there is something
        // else: that a few windows end anywhere beside an unstable rest.
        let reached = fitted.left() > SOME || shown.refitted > SOME * fitted.refitted;
        // Unseen data that do not reach what the names are for, and so confirm none of them, leave all of the gap.
        let leave = |part: f64| shown.left() > part && (!unconfirmed || fitted.left() > part);
        let reasons = [
            (shown.left() > GROWN && shown.after > GROWN * shown.noise_floor, "windows are predicted worse with it"),
            (far && shown.left() > MOST_OF_IT, "most of the gap is left"),
            (
                share > MOST_OF_FORCE && (shown.left() > GOOD_PART || leaves(fitted, TOO_MUCH)),
                "more of the force is left than is explained",
            ),
            (share > MOST_OF_IT && shown.left() > MOST_OF_IT && is_left, "most of the gap is left, and much of the force"),
            (reached && leaves(shown, MOST_OF_IT), "most of the gap is left where windows are far off"),
            // On data that neither was fitted to: right names that leave so much leave noise, of which nothing is learned.
            (
                learned < LEARNED && [shown, fitted].iter().all(|gap| gap.after > MUCH * gap.refitted),
                "much of the gap is left, and a learned force takes much of that",
            ),
            // What was fitted to is no measure of that: a real servo's two names leave two ninths of it there, and a twelfth where nothing was.
            (share > 0.0 && reached && leaves(shown, TOO_MUCH), "a force is left, and much of the gap"),
            // Where noise hides what predictions miss, a single force without a name that says much more than all of the names says so.
            (
                all > MUCH_MORE * said + 2.0 * CONVINCING && [shown, fitted].iter().all(|gap| gap.left() > MUCH),
                "a force without a name says more, and much of the gap is left",
            ),
            // What says more than all of the names, or nearly what they and what they leave say together, is what they share among them.
            (
                share > 0.0 && leave(GOOD_PART) && all > said.min(NEARLY * (said + left)),
                "a single force without a name says as much as it and what it leaves",
            ),
            (share > 0.0 && far && large && as_well && said + left - all < (1.0 - NEARLY) * said, BETTER),
            (unconfirmed && (all > said + 2.0 * CONVINCING || as_well && leave(MOST_OF_IT)), BETTER),
        ];
        reasons.into_iter().find_map(|(holds, reason)| holds.then_some(reason))
    }
}

#[cfg(test)]
mod tests {
    use super::Beside;
    use crate::report::Gap;
    use crate::tests::gap;

    /// Names that say so much, as a force without one does on what they leave and instead of them.
    fn beside<'a>([fitted, shown]: [&'a Gap; 2], [said, left, all]: [f64; 3], share: f64) -> Beside<'a> {
        Beside { shown, fitted, said, left, all, share, told: true, large: false, learned: 1.0, unconfirmed: false }
    }

    /// Is a name withdrawn that says, and leaves, so much?
    fn is_near(gap: &Gap, says: [f64; 3], share: f64) -> bool {
        beside([gap, gap], says, share).only_near().is_some()
    }

    /// Figures of drags that grow with the third power of speed, of a friction that grows while a joint rests, of one that binds for moments.
    #[test]
    fn names_that_share_one_force_without_a_name_are_not_believed() {
        assert!(is_near(&gap([0.0062, 0.00082, 1e-5]), [8781.0, 869.0, 8751.0], 0.074), "quadratic drag and two more");
        assert!(is_near(&gap([0.062, 0.040, 0.018]), [6099.0, 518.0, 6460.0], 0.19), "quadratic drag");
        assert!(is_near(&gap([0.137, 0.0148, 0.0006]), [66718.0, 177.0, 65154.0], 0.086), "bristles");
        assert!(is_near(&gap([0.042, 0.0195, 0.0004]), [614.0, 1642.0, 2160.0], 0.79), "dry friction");
    }

    /// Figures of a friction that grows while a joint rests, of a spring with a kink, of a mass that comes loose; what is as far off where
    /// nothing is left is chance.
    #[test]
    fn names_that_leave_much_are_not_believed() {
        assert!(is_near(&gap([0.0348, 0.0266, 0.0041]), [1947.0, 0.0, 1860.0], 0.0), "Stribeck friction");
        assert!(is_near(&gap([0.0695, 0.0151, 0.00025]), [9000.0, 300.0, 5000.0], 0.05), "a ripple and a spring");
        assert!(is_near(&gap([0.107, 0.018, 0.0032]), [9000.0, 300.0, 5000.0], 0.05), "a payload");
        assert!(is_near(&gap([0.0423, 0.00615, 0.00068]), [5208.0, 739.0, 4113.0], 0.34), "an armature");
        assert!(!is_near(&gap([0.0348, 0.0266, 0.02]), [1947.0, 0.0, 1860.0], 0.0), "the noise floor is near");
        assert!(!is_near(&gap([0.0695, 0.0151, 0.00025]), [9000.0, 0.0, 5000.0], 0.0), "nothing is left");
    }

    /// Figures of a friction that binds for moments, in few of the windows: taken for dry friction it is a nearer neighbour of data that it was
    /// not fitted to than of those that it was.
    #[test]
    fn names_that_leave_more_of_the_force_than_they_explain_are_not_believed() {
        let (fitted, shown) = (gap([0.512, 0.085, 6e-5]), gap([0.549, 0.0265, 6e-5]));
        let near = |share: f64| {
            let beside = beside([&fitted, &shown], [1793.0, 1237.0, 1500.0], share);
            Beside { large: true, ..beside }.only_near().is_some()
        };
        assert!(near(1.0) && !near(0.46));
    }

    /// Figures of a real cabinet's magnet and a real servo's gears: each leaves a force, and one without a name does not do for both.
    #[test]
    fn names_of_real_effects_are_believed_though_they_leave_a_force() {
        assert!(!is_near(&gap([0.826, 0.0207, 0.0008]), [4236.0, 137.0, 4543.0], 0.022), "little of the gap is left");
        assert!(!is_near(&gap([0.43, 0.035, 1e-4]), [15545.0, 1587.0, 12104.0], 0.499), "less than a tenth of the gap is left");
        // Not measured: the same names with more left.
        assert!(!is_near(&gap([0.43, 0.052, 1e-4]), [15545.0, 1587.0, 12104.0], 0.499), "they say much that one force does not");
    }

    /// Figures of a friction that grows while a joint rests and of a disturbance by time, under much noise: nothing that is left is told from chance.
    #[test]
    fn names_that_say_much_less_than_a_force_without_one_are_not_believed_under_noise() {
        let near = |fitted: [f64; 3], shown: [f64; 3], says: [f64; 3]| {
            let (fitted, shown) = (gap(fitted), gap(shown));
            Beside { told: false, large: true, ..beside([&fitted, &shown], says, 0.0) }.only_near().is_some()
        };
        assert!(near([0.1276, 0.0936, 0.0318], [0.0629, 0.0303, 0.0171], [41.0, 50.0, 86.0]), "dry friction");
        assert!(near([0.2722, 0.2316, 0.0862], [0.0481, 0.0333, 0.0368], [2037.0, 1195.0, 2596.0]), "a mode and an armature");
        // Not measured: a right name at the noise's floor.
        assert!(!near([0.1276, 0.0936, 0.0930], [0.0629, 0.0303, 0.0300], [41.0, 0.0, 44.0]), "a right name says as much");
    }

    /// Figures of a friction that grows while a joint rests and of cogging by time: the names are what comes nearest, and a learned force beside them
    /// predicts data that neither has seen much better. Where one takes little, or names leave little, that is no reason.
    #[test]
    fn names_beside_which_much_can_be_learned_are_not_believed() {
        let near = |figures: [f64; 3], learned: f64| {
            let gap = gap(figures);
            Beside { told: false, learned, ..beside([&gap, &gap], [59.0, 0.0, 40.0], 0.0) }.only_near().is_some()
        };
        assert!(near([0.0285, 0.0184, 0.0074], 0.42), "dry friction");
        assert!(near([1.114, 0.674, 0.328], 0.59), "a late clock and a mode");
        assert!(!near([0.0285, 0.0184, 0.0074], 0.85) && !near([0.0285, 0.0100, 0.0074], 0.42));
    }

    /// A mass that comes loose is no payload; a detent that unseen data do not reach is one all the same.
    #[test]
    fn what_unseen_data_do_not_reach_is_not_held_against_a_name() {
        let unconfirmed = |fitted: [f64; 3], shown: [f64; 3], says: [f64; 3], share: f64| {
            let (fitted, shown) = (gap(fitted), gap(shown));
            Beside { unconfirmed: true, ..beside([&fitted, &shown], says, share) }.only_near().is_some()
        };
        assert!(unconfirmed([0.0169, 0.0150, 0.0118], [0.0313, 0.0302, 0.0250], [141.4, 2.4, 140.7], 0.0), "a payload");
        let (reached, not_reached) = ([0.05, 0.002, 0.001], [0.002, 0.002, 0.001]);
        assert!(!unconfirmed(reached, not_reached, [900.0, 0.0, 880.0], 0.0), "a detent");
        assert!(!unconfirmed(reached, not_reached, [900.0, 30.0, 910.0], 0.05), "a detent that leaves a little");
        // Figures of a door's gasket, of which unseen data show the edge: two in a hundred of what it makes of the others, the true model's too.
        assert!(!unconfirmed([0.155, 0.0045, 0.0046], [0.0028, 0.0033, 0.00103], [12635.0, 0.0, 12488.0], 0.0), "a gasket");
        assert!(unconfirmed([0.0348, 0.0045, 0.0046], [0.0028, 0.0033, 0.00103], [12635.0, 0.0, 12488.0], 0.0), "much of it is left");
    }

    /// An unstable rest makes a gap larger by chance, and so does noise where nothing else is left.
    #[test]
    fn a_name_that_makes_the_gap_larger_is_not_believed_and_one_beside_chance_is() {
        assert!(is_near(&gap([9.9e-5, 1.84e-4, 8.5e-5]), [188.0, 0.0, 0.0], 0.0));
        assert!(!is_near(&gap([3.46e-4, 3.71e-4, 3.61e-4]), [188.0, 0.0, 0.0], 0.0));
        assert!(!is_near(&gap([0.150, 0.163, 0.071]), [188.0, 0.0, 0.0], 0.0));
    }
}
