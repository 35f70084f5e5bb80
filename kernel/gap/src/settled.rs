//! Names that are settled, and what takes them back: data that no fit has seen, and windows that they do not help to predict.

use crate::GapError;
use crate::choice::Choice;
use crate::fit::Fit;
use crate::gaps::Measure;
use crate::report::Reason;
use crate::search::{Search, entries};
use crate::trajectory::Trajectory;
use crate::unseen::Unseen;
use crate::valley::Followed;

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
}
