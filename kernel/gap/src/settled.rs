//! Names that are settled, and what takes them back: data that no fit has seen, and windows that they do not help to predict.

use crate::GapError;
use crate::choice::Choice;
use crate::fit::Fit;
use crate::flexible::Nameless;
use crate::gaps::Measure;
use crate::report::{Gap, Reason};
use crate::search::{Search, entries};
use crate::shape::is_bent;
use crate::trajectory::Trajectory;
use crate::unseen::Unseen;
use crate::valley::Followed;
use crate::weigh::CONVINCING;

/// What a force that names leave over is of theirs, or what they leave is of the gap, from which on they may be its neighbours alone, and the share
/// of what they say that one without a name has to say then: its knots cost it what a shape that is right does not pay.
const GOOD_PART: f64 = 0.1;
const NEARLY: f64 = 0.9;
/// Share of the force that lacks, from which on more of it is left than names explain, by a third.
const MOST_OF_FORCE: f64 = 0.8;
/// Logarithm of the Bayes factor by which a curve has to beat a few numbers: dry friction and drag look like a curve where one is not found yet.
const PLAINLY: f64 = 10.0 * CONVINCING;
/// Numbers of names that are few beside those of a curve.
const FEW: usize = 3;
/// Share of the gap that names may leave where much more is left than noise makes.
const MOST_OF_IT: f64 = 0.5;

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

impl Settled<'_, '_> {
    /// Takes a name back, by its place among them, and fits the others without it.
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
        Ok(())
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

    /// Where the model stays far off: numbers that predict windows best, where those that it has do not, and names that these windows need.
    /// `own` measures the gap over the data that all was fitted to.
    pub fn over_windows(&mut self, told: Option<Followed>, own: &Measure<'_>) -> Result<Option<Followed>, GapError> {
        let mut told = self.search.over_windows(told.as_ref().map_or(&self.current, |t| &t.fit), own)?.or(told);
        while let Some(least) = own.needless(&told.as_ref().map_or(&self.current, |t| &t.fit).hypothesis)? {
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

    /// Why the names are the nearest neighbours of what is there, no more, where they are. They leave data far off that nothing was fitted to,
    /// and most of the gap, or a good part of the force, while one without a name says nearly as much as all of them, and they little beside
    /// it. So are names that no such data confirm, where a force without a name says more.
    /// `shown` is the gap with them, `left` a force on what they leave with its share of all that is lacking, if it is there, `all` one instead.
    pub fn only_near(
        &self,
        shown: &Gap,
        (left, share): (&(usize, Nameless), f64),
        all: &Nameless,
    ) -> Result<Option<&'static str>, GapError> {
        if self.chosen.is_empty() {
            return Ok(None);
        }
        let evidence = |fit: &Fit| self.search.evidence_in_fit(fit, self.scale);
        let said = evidence(&self.current) - evidence(self.refitted);
        if is_bent(&self.current) {
            return Ok(Some("it breaks away at many times the force that it slides with"));
        }
        if self.is_imitated(said)? {
            return Ok(Some("a force by place or speed alone, without a name, fits better"));
        }
        let far = shown.is_far() && left.1.evidence > 2.0 * CONVINCING;
        if far && shown.left() > MOST_OF_IT {
            return Ok(Some("most of the gap is left"));
        }
        if share > MOST_OF_FORCE && shown.left() > GOOD_PART {
            return Ok(Some("more of the force is left than is explained"));
        }
        let good_part = left.1.force > GOOD_PART * self.search.explained_force(&self.current, self.refitted)?;
        let beside = said + left.1.evidence - all.evidence;
        let instead = all.evidence > NEARLY * said && beside < (1.0 - NEARLY) * said;
        let instead = far && self.search.is_a_force(left) && good_part && instead;
        let unconfirmed = !self.unseen.is_empty() && !self.confirmed.iter().any(Unseen::confirms);
        let better = unconfirmed && all.evidence > said + 2.0 * CONVINCING;
        Ok((instead || better).then_some("a force without a name fits better"))
    }

    /// Do the names, all on one joint, imitate a force by position or velocity alone that is none of the catalogue's? `said` is what the evidence
    /// gains by them.
    fn is_imitated(&self, said: f64) -> Result<bool, GapError> {
        let search = self.search;
        let mut joints = self.chosen.iter().map(|c| c.best.joint);
        let Some(joint) = joints.next().flatten().filter(|j| !search.many_joints() && joints.all(|other| other == Some(*j))) else {
            return Ok(false);
        };
        let Some(free) = search.free(self.refitted, joint, self.scale)? else { return Ok(false) };
        let apart = search.problem.persistence(&free.errors, &(&self.current.errors - &free.errors));
        (self.say)(&format!("  a force by place or speed alone says {:+.1}, what is named {said:+.1}", free.evidence));
        // A few numbers that come near a curve are what most of it is; many of them are a curve themselves.
        let numbers = self.refitted.hypothesis.x.len()..self.current.hypothesis.x.len();
        let count = if self.chosen.len() == 1 { numbers.filter(|i| self.current.is_told(*i, self.scale)).count() } else { numbers.len() };
        let more = free.evidence - said;
        Ok(match count <= FEW {
            true => more > PLAINLY * apart && said < NEARLY * free.evidence,
            false => more > CONVINCING * apart,
        })
    }
}
