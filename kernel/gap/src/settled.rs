//! Names that are settled, and what takes them back: data that no fit has seen, and windows that they do not help to predict.

use crate::GapError;
use crate::choice::{ALIKE, Choice};
use crate::fit::Fit;
use crate::flexible::Nameless;
use crate::gaps::Measure;
use crate::near::{Beside, GOOD_PART, GROWN, MOST_OF_IT, NEARLY};
use crate::report::{Gaps, Reason, Remainder};
use crate::search::{Search, entries};
use crate::shape::is_bent;
use crate::trajectory::Trajectory;
use crate::unseen::Unseen;
use crate::valley::Followed;
use crate::weigh::CONVINCING;

/// Logarithm of the Bayes factor by which a curve has to beat a few numbers: dry friction and drag look like a curve where one is not found yet.
const PLAINLY: f64 = 10.0 * CONVINCING;
/// Numbers of names that are few beside those of a curve.
const FEW: usize = 3;

/// What is asked, and who hears of it.
pub(crate) struct Settled<'s, 'a> {
    pub search: &'s Search<'a>,
    /// The model without names, its known numbers refitted.
    pub refitted: &'s Fit,
    pub unseen: &'s [Trajectory],
    /// The gap over unseen data, where there are some.
    pub measure: &'s Measure<'s>,
    pub say: &'s dyn Fn(&str),
    pub current: Fit,
    pub scale: f64,
    pub chosen: Vec<Choice>,
    /// What unseen data say of each name.
    pub confirmed: Vec<Unseen>,
    /// Names that were taken back.
    pub taken_back: Vec<Reason>,
}

/// The numbers of names that are settled.
#[derive(Debug)]
pub(crate) struct Numbers {
    /// Where they were followed to, and how far they are known there; none where they are those of the fit.
    pub told: Option<Followed>,
    /// They are those that predict windows best.
    pub of_windows: bool,
}

impl Settled<'_, '_> {
    /// Takes a name back, by its place among them, and fits the others without it. Where these then predict windows worse than the model without
    /// names they were there for one another, and all go: an axis at right angles to the true one, and a drive that gives a fiftieth.
    fn take_back(&mut self, which: usize, why: &str, reason: impl FnOnce(&'static str) -> Reason) -> Result<(), GapError> {
        let entry = entries(&self.current.hypothesis)[which];
        self.current = if self.chosen.len() == 1 {
            self.refitted.clone()
        } else {
            self.search.fit_on(self.current.without(&self.search.problem, entry)?, self.scale)?
        };
        self.scale = self.search.scale(&self.current);
        let gone = self.chosen.remove(which).best.effect;
        (self.say)(&format!("  {why} {gone}"));
        self.taken_back.push(reason(gone));
        self.confirmed.clear();
        self.drop_lost();
        Ok(())
    }

    /// Takes all names back with which the usual window is predicted much worse than without, or not at all.
    fn drop_lost(&mut self) {
        let usual = |fit: &Fit| self.measure.in_usual_window(&fit.hypothesis);
        let none = usual(self.refitted).unwrap_or(f64::INFINITY);
        if self.chosen.is_empty() || usual(&self.current).is_ok_and(|named| named <= GROWN * none) {
            return;
        }
        (self.current, self.scale) = (self.refitted.clone(), self.search.scale(self.refitted));
        for gone in self.chosen.drain(..) {
            let reason = "windows are predicted worse with it, once another name is taken back";
            self.taken_back.push(Reason { name: gone.best.effect.into(), reason: reason.into() });
        }
    }

    fn ask_unseen(&mut self) -> Result<(), GapError> {
        if !self.unseen.is_empty() && !self.chosen.is_empty() {
            self.confirmed = self.search.on_unseen(&self.current, self.refitted, self.unseen, self.measure, self.scale)?;
        }
        Ok(())
    }

    /// Data that no fit and no choice has seen have a veto: what they contradict is not there.
    pub fn heed_unseen(&mut self) -> Result<(), GapError> {
        loop {
            self.ask_unseen()?;
            let contradicted = (0..self.confirmed.len()).filter(|i| self.confirmed[*i].contradicts());
            let Some(worst) = contradicted.min_by(|a, b| self.confirmed[*a].fall.total_cmp(&self.confirmed[*b].fall)) else {
                return Ok(());
            };
            let said = self.confirmed[worst];
            self.take_back(worst, "data that it was not fitted to contradict", |name| said.reason(name))?;
        }
    }

    /// Takes back what stands beside a name that alone leaves no good part of the gap, where a force without a name says as much as all of them:
    /// they bend to the little that is left. Of an arm this is not asked, as whether names imitate a force is not.
    pub fn drop_shapes(&mut self) -> Result<(), GapError> {
        let says_most = (0..self.chosen.len()).max_by(|a, b| self.chosen[*a].gain.total_cmp(&self.chosen[*b].gain));
        let Some(first) = says_most.filter(|_| self.chosen.len() > 1 && !self.search.many_joints()) else { return Ok(()) };
        let names = entries(&self.current.hypothesis);
        // The last first, since those behind one that goes move up.
        let others = (0..names.len()).rev().filter(|at| *at != first);
        let alone = others.clone().try_fold(self.current.clone(), |fit, at| fit.without(&self.search.problem, names[at]))?;
        let alone = self.search.fit_on(alone, self.scale)?;
        let gap = |fit: &Fit| self.measure.pooled(&fit.hypothesis, None);
        let closes = gap(&alone).is_ok_and(|left| gap(self.refitted).is_ok_and(|all| left < GOOD_PART * all));
        if !closes || !self.is_imitated(self.said(), None)? {
            return Ok(());
        }
        let name = self.chosen[first].best.effect;
        for at in others {
            let gone = self.chosen.remove(at).best.effect;
            (self.say)(&format!("  {gone} bends to the little that {name} leaves"));
            let reason = "another name leaves little of the gap alone, and it bends to what is left of that";
            self.taken_back.push(Reason { name: gone.into(), reason: reason.into() });
        }
        self.scale = self.search.scale(&alone);
        self.current = alone;
        self.ask_unseen()
    }

    /// What the evidence gains by the names.
    fn said(&self) -> f64 {
        let evidence = |fit: &Fit| self.search.evidence_in_fit(fit, self.scale);
        evidence(&self.current) - evidence(self.refitted)
    }

    /// Follows the numbers to where the data lead them, row by row, and window by window where a model stays far off or where a name `adds_up`.
    /// `own` measures the gap over the data that all was fitted to.
    pub fn numbers(&mut self, own: &Measure<'_>, adds_up: bool, seed: u64, notes: &mut Vec<String>) -> Numbers {
        self.current = self.current.clone().with_sines_wrapped();
        if self.chosen.is_empty() {
            return Numbers { told: None, of_windows: false };
        }
        (self.say)("following what the data hardly tell");
        let told = self.search.followed(&self.current, self.scale, self.measure);
        let told = told.map_err(|error| notes.push(format!("what the data hardly tell was not followed: {error}"))).ok();
        let fit = told.as_ref().map_or(&self.current, |t| &t.fit);
        let why = match !self.search.many_joints() {
            true if own.is_far(&fit.hypothesis, seed) => "the model stays far from the data over windows of time",
            true if adds_up => "some effects are too small to be told from row to row and are told by what they add up to over many",
            _ => return Numbers { told, of_windows: false },
        };
        (self.say)("fitting what is predicted over windows");
        let told = match self.over_windows(told.clone(), own) {
            Ok(over) => {
                notes.push(format!("{why}, so the numbers are those that predict windows of time best"));
                over
            }
            Err(error) => {
                notes.push(format!("the last fit, to whole windows, was left out: {error}"));
                // Numbers of names that were taken back meanwhile are none.
                told.filter(|t| entries(&t.fit.hypothesis).len() == self.chosen.len())
            }
        };
        Numbers { told, of_windows: true }
    }

    /// Where the model stays far off: numbers that predict windows best, where those that it has do not, and names that these windows need.
    fn over_windows(&mut self, told: Option<Followed>, own: &Measure<'_>) -> Result<Option<Followed>, GapError> {
        let mut told = self.search.over_windows(told.as_ref().map_or(&self.current, |t| &t.fit), own)?.or(told);
        // Windows need one of several that share what they show. Of those the one goes that rows say least of.
        let least =
            |needless: Vec<usize>, chosen: &[Choice]| needless.into_iter().min_by(|a, b| chosen[*a].gain.total_cmp(&chosen[*b].gain));
        while let Some(least) = least(own.needless(&told.as_ref().map_or(&self.current, |t| &t.fit).hypothesis)?, &self.chosen) {
            let reason = "windows are predicted as well without it, the others fitted to that";
            let of = |name: &str| Reason { name: name.into(), reason: reason.into() };
            self.take_back(least, "windows are predicted as well without", of)?;
            told = self.search.over_windows(&self.current, own)?;
        }
        if self.confirmed.is_empty() {
            self.ask_unseen()?;
        }
        Ok(told)
    }

    /// Why the names are the nearest neighbours of what is there, no more, where they are.
    /// `gap` is with them, `left` a force on what they leave with its share of all that is lacking, if it is there, `all` one instead, and `learned`
    /// one that was learned on what they leave.
    pub fn only_near(
        &self,
        gap: &Gaps,
        (left, share): (&(usize, Nameless), f64),
        all: &Nameless,
        learned: Option<&Remainder>,
    ) -> Result<Option<&'static str>, GapError> {
        if self.chosen.is_empty() {
            return Ok(None);
        }
        let said = self.said();
        if is_bent(&self.current) {
            return Ok(Some("it breaks away at many times the force that it slides with"));
        }
        // What hangs together as the errors do is told from nothing by as much less.
        let told = left.1.evidence > ALIKE * self.search.problem.persistence(&self.current.errors, &left.1.change);
        let explained = self.search.explained_force(&self.current, self.refitted)?;
        let beside = Beside {
            shown: gap.held_out.as_ref().unwrap_or(&gap.train),
            fitted: &gap.train,
            said,
            left: left.1.evidence,
            all: all.evidence,
            share,
            told,
            large: self.search.is_a_force(left) && left.1.force > GOOD_PART * explained,
            learned: learned.filter(|l| l.kept).map_or(1.0, |l| l.gap[1] / l.gap[0]),
            unconfirmed: !self.unseen.is_empty() && !self.confirmed.iter().any(Unseen::confirms),
        };
        if self.is_imitated(said, beside.leaves())? {
            return Ok(Some("a force by place or speed alone, without a name, fits as well"));
        }
        Ok(beside.only_near())
    }

    /// Do the names, all on one joint, imitate a force by position or velocity alone that is none of the catalogue's? `said` is what the evidence
    /// gains by them, and `left` by a force on what they leave, where that is some of the gap.
    fn is_imitated(&self, said: f64, left: Option<f64>) -> Result<bool, GapError> {
        let search = self.search;
        let mut joints = self.chosen.iter().map(|c| c.best.joint);
        let Some(joint) = joints.next().flatten().filter(|j| !search.many_joints() && joints.all(|other| other == Some(*j))) else {
            return Ok(false);
        };
        let Some(free) = search.free(self.refitted, joint, self.scale, said)? else { return Ok(false) };
        let more = free.evidence - said;
        // How sure a lead is. Where names lead that leave nothing but noise, their errors say it: what the curve leaves hangs together.
        let change = &self.current.errors - &free.errors;
        let [of_curve, of_names] = [&free.errors, &self.current.errors].map(|errors| search.problem.persistence(errors, &change));
        let apart = if more > 0.0 { of_curve } else { of_curve.min(of_names) };
        (self.say)(&format!("  a force by place or speed alone says {:+.1}, what is named {said:+.1}", free.evidence));
        // A few numbers that come near a curve are what most of it is; many of them are a curve themselves.
        let numbers = self.refitted.hypothesis.x.len()..self.current.hypothesis.x.len();
        let count = if self.chosen.len() == 1 { numbers.filter(|i| self.current.is_told(*i, self.scale)).count() } else { numbers.len() };
        Ok(match count <= FEW {
            // A curve that says most of what they leave as well is what is there.
            true => {
                let leaves_it = left.is_some_and(|left| more > MOST_OF_IT * left);
                more > PLAINLY * apart && said < NEARLY * free.evidence || more > CONVINCING * apart && leaves_it
            }
            // Where the joint went one way only the curve bends to all that they say, and to what they leave: near it is the most that they can come.
            false if search.seen[joint].one_way => more > CONVINCING * apart && said < NEARLY * free.evidence,
            // Each of several names has to say something beside the curve.
            false if self.chosen.len() > 1 => more > -CONVINCING * apart * self.chosen.len() as f64,
            false => more > CONVINCING * apart,
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::Settled;
    use crate::choice::Choice;
    use crate::fit::Fit;
    use crate::gaps::Measure;
    use crate::search::{Candidate, Search};
    use crate::tests::{door, swing, with};
    use crate::trajectory::Trajectory;

    type Numbers<'n> = &'n [(&'static str, &'n [(&'static str, f64)])];

    /// What is asked of names, fitted to what others hide from these values on, or as they are where they are not to be `fitted`.
    fn asked<T>(hidden: Numbers<'_>, named: Numbers<'_>, fitted: bool, ask: impl FnOnce(&mut Settled<'_, '_>) -> T) -> T {
        let model = door();
        let truth = hidden.iter().fold(model.clone(), |model, (effect, numbers)| with(&model, effect, numbers));
        let data: Vec<Trajectory> = (1..3).map(|seed| Trajectory::new(&swing(&truth, 1e-4, seed), &model).unwrap()).collect();
        let search = Search::new(&model, &data).unwrap();
        let refitted = search.known(&model, 1.0).unwrap();
        let mut current = refitted.clone();
        let mut chosen = Vec::new();
        for (effect, numbers) in named {
            let here = search.evidence_in_fit(&current, 1.0);
            let values: Vec<f64> = numbers.iter().map(|n| n.1).collect();
            let more = current.hypothesis.with(effect, Some("hinge"), &values).unwrap();
            current = Fit::start(&search.problem, more).unwrap();
            if fitted {
                current = search.fit_on(current, 1.0).unwrap();
            }
            let evidence = search.evidence_in_fit(&current, 1.0);
            let candidate = Candidate { effect, joint: Some(0), fit: current.clone(), evidence };
            chosen.push(Choice::new(&search, &[candidate], here, 0.0, 1.0, 1.0));
        }
        let measure = Measure::new(&search, &model, &data, &[], 1.0);
        let (confirmed, taken_back) = (Vec::new(), Vec::new());
        let mut settled = Settled {
            search: &search,
            refitted: &refitted,
            unseen: &[],
            measure: &measure,
            say: &|_| {},
            current,
            scale: 1.0,
            chosen,
            confirmed,
            taken_back,
        };
        ask(&mut settled)
    }

    /// Are names taken for the imitation of a force that has none?
    fn is_imitated(hidden: Numbers<'_>, named: Numbers<'_>) -> bool {
        asked(hidden, named, true, |settled| settled.is_imitated(settled.said(), None).unwrap())
    }

    /// A spring that begins amid the way is none of the catalogue's. Others together come near it.
    #[test]
    fn names_that_together_imitate_a_curve_are_not_believed() {
        let kinked = [("stiffness", 0.3), ("dissipation", 1e-3), ("position", 0.7), ("side", 1.0)];
        let near = [("stiffness", 0.2), ("rest_position", 0.7)];
        let dent = [("force", 0.02), ("position", 0.8), ("width", 0.3)];
        assert!(is_imitated(&[("hard_stop", &kinked)], &[("joint_spring", &near), ("detent", &dent)]));
    }

    #[test]
    fn true_names_are_believed_beside_a_curve() {
        let (dry, drag) = ([("friction", 0.03)], [("drag", 0.02)]);
        let both: Numbers<'_> = &[("coulomb_friction", &dry), ("quadratic_drag", &drag)];
        assert!(!is_imitated(both, both));
    }

    /// A curve that follows one of two names leaves the other, and errors that hang together; beside it names that leave only noise are sure.
    #[test]
    fn what_a_curve_leaves_is_not_held_against_true_names() {
        let dry = [("friction_positive", 0.03), ("friction_negative", 0.04), ("damping_positive", 0.02), ("damping_negative", 0.03)];
        let (rotor, tilt) = ([("inertia", 0.0015)], [("amplitude", 0.03), ("phase", 0.4)]);
        for other in [("armature_inertia", &rotor[..]), ("hinge_tilt", &tilt[..])] {
            let both: Numbers<'_> = &[("asymmetric_friction", &dry), other];
            assert!(!is_imitated(both, both), "{}", other.0);
        }
    }

    /// A drive's bias beside an engine's own error, which friction of three numbers bent to: a force without a name said more than both, and
    /// neither was believed.
    #[test]
    fn what_bends_to_the_little_that_a_name_leaves_does_not_take_that_with_it() {
        let stays = |hidden: Numbers<'_>, named: Numbers<'_>| {
            asked(hidden, named, true, |settled| {
                settled.drop_shapes().unwrap();
                settled.chosen.iter().map(|c| c.best.effect).collect::<Vec<_>>()
            })
        };
        let bias = ("torque_bias", &[("bias", 0.1)][..]);
        let kinked = ("hard_stop", &[("stiffness", 0.01), ("dissipation", 1e-3), ("position", 0.7), ("side", 1.0)][..]);
        let sticking = [("static_friction", 0.001), ("friction", 5e-4), ("stribeck_velocity", 0.3), ("exponent", 2.0)];
        assert_eq!(stays(&[bias, kinked], &[bias, ("stribeck_friction", &sticking)]), ["torque_bias"]);
        // A name that is there says more than such a force, however little is left of the gap.
        let (dry, dent) =
            (("coulomb_friction", &[("friction", 0.1)][..]), ("detent", &[("force", 0.001), ("position", 0.8), ("width", 0.3)][..]));
        assert_eq!(stays(&[dry, dent], &[dry, dent]), ["coulomb_friction", "detent"]);
    }

    /// A servo with a loose mass: an axis at right angles and a drive that gave a fiftieth were there for one another. The drive was taken back, and
    /// the axis stayed named though its model could not be simulated over a single window.
    #[test]
    fn a_name_that_cannot_stand_without_another_goes_with_it() {
        let stays = |name: &'static str, numbers: &[(&'static str, f64)], fitted: bool| {
            asked(&[("coulomb_friction", &[("friction", 0.03)])], &[(name, numbers)], fitted, |settled| {
                settled.drop_lost();
                !settled.chosen.is_empty()
            })
        };
        assert!(stays("coulomb_friction", &[("friction", 0.02)], true));
        assert!(!stays("hinge_tilt", &[("amplitude", 5.0), ("phase", 0.4)], false));
    }
}
