//! What a fit is worth beside others: noise, evidence, the forces that it explains.

use std::cell::LazyCell;

use nalgebra::DVector;
use rayon::prelude::*;
use sagci_model::ObjectModel;

use crate::GapError;
use crate::alike::is_plain_offset;
use crate::fit::{Derivatives, Effort, Fit, Problem};
use crate::flexible::{self, Nameless};
use crate::gaps::{FINE, Measure};
use crate::hypothesis::{Fitted, Hypothesis, Knob};
use crate::observer::{Disturbance, Run};
use crate::part;
use crate::response::Response;
use crate::search::{Candidate, EXPLAINED, FLOOR, QUICK, Search, entries};
use crate::span::Span;
use crate::trajectory::Trajectory;
use crate::windows::{SHORT, Seek, likely_noise};

/// Logarithm of the Bayes factor that an effect needs.
pub(crate) const CONVINCING: f64 = 10.0;
/// Logarithm of the Bayes factor from which on nothing else is asked of an effect: three times what any had in data that lack none.
const CERTAIN: f64 = 150.0;
/// Standard deviations of chance that evidence has to be beyond, besides.
const SURELY: f64 = 2.0;
/// How many of the best are looked at for a simpler one, and the share of what accelerates a joint by which it may differ.
const NEAREST: usize = 5;
const SAME: f64 = 0.5 * FLOOR;
/// How many that may take the place of a name are fitted to the end.
const RIVALS: usize = 3;
/// Share of the best one's evidence that it needs if it makes another force.
const NEARLY: f64 = 0.95;
/// Share of what accelerates a joint that an effect needs, less being below what any model is off by; or at the least, if with it the gap
/// falls to such a share.
pub(crate) const MATERIAL: f64 = FLOOR;
const TRIFLE: f64 = 0.1 * FLOOR;
pub(crate) const FALL: f64 = 0.7;
/// Share of the gap that names leave, below which they have all but closed it: their shapes are off by as much. What another takes of that is no
/// ground to name it, unless it leaves but such a share.
pub(crate) const ALL_BUT_CLOSED: f64 = 0.05;
pub(crate) const MOST_TAKEN: f64 = 0.35;
/// The share to which a force that is material makes the gap fall, and the force from which on that is not asked.
pub(crate) const SMALLER: f64 = 0.97;
const LARGE: f64 = 0.1;
/// The share to which such a force makes the error in the usual window fall, where the gap does not.
const USUAL: f64 = 0.85;
/// The share of windows of which such a fall is asked where most are to be nearer.
const MOST: f64 = 0.75;
/// Gap, in shares of the joints' ranges, from which on a model is lost within a window.
const LOST: f64 = 0.1;
/// How many of the best are weighed anew under another noise, and the evidence within which they may change places.
const LOOKED_AT: usize = 6;
const NEAR: f64 = 30.0;
/// Share of the time between rows that stamps are off by.
const JITTER: f64 = 0.1;
/// Share of a rich effect's fall of squares that a plain one needs to be tried with a second.
const PLAIN: f64 = 0.6;
/// How many numbers a plain one has, the plainest first.
const PLAINEST: [usize; 2] = [1, 2];
/// Most by which the noise of accelerations may exceed its floor while names are sought: a model that is not trusted explains nothing.
const MOST_NOISE: f64 = 8.0;
/// Fall of the cost below which fits over all of an arm's data may be compared: derivatives that nearly hold bring little at a time, and evidence
/// that counts is ten times as much.
const COMPARED: f64 = 1.0;
/// Steps that are not halved any more, s.
const SHORTEST: f64 = 5e-4;

/// Is the gap that a richer name leaves a ground to name it, and not the plainer one? `without` is the gap without either.
fn adds_up(rich: f64, plain: f64, without: impl FnOnce() -> f64) -> bool {
    rich < FALL * plain && (rich < MOST_TAKEN * plain || plain > ALL_BUT_CLOSED * without())
}

impl<'a> Search<'a> {
    /// Fits anew from where a fit stands.
    pub fn refit(&self, fit: &Fit, scale: f64) -> Result<Fit, GapError> {
        let fit = Fit::start(&self.problem, fit.hypothesis.clone())?;
        let known = self.known_columns(&fit)?;
        let begin = Derivatives { frozen: known.as_deref(), ..Derivatives::FRESH };
        Ok(self.judge(fit.finish(&self.problem, scale, begin, Effort::to_the_end(f64::NEG_INFINITY))?))
    }

    /// The same of one that adds to a base, as long as it can be hoped to come near an evidence.
    pub fn refit_beside(&self, base: &Fit, fit: &Fit, scale: f64, bar: f64) -> Result<Fit, GapError> {
        let mut fit = Fit::start(&self.problem, fit.hypothesis.clone())?;
        // Judged at the end; until then beside the base.
        fit.judged = base.judged + fit.squares - base.squares;
        let known = self.known_columns(&fit)?;
        // Of an arm such fits are most of the work.
        let begin = Derivatives { frozen: known.as_deref(), roughly: self.many_joints(), ..Derivatives::FRESH };
        Ok(self.judge(fit.finish(&self.problem, scale, begin, Effort { enough: COMPARED, ..Effort::to_the_end(bar) })?))
    }

    /// The same with derivatives to begin with.
    fn refit_towards(&self, fit: &Fit, scale: f64, begin: Derivatives<'_>, bar: f64) -> Result<Fit, GapError> {
        let fit = Fit::start(&self.problem, fit.hypothesis.clone())?;
        Ok(self.judge(fit.finish(&self.problem, scale, begin, Effort::to_the_end(bar))?))
    }

    /// A fit with derivatives where it stands, as far as the simulator gives them.
    pub fn anew(&self, fit: &Fit) -> Fit {
        let fresh = || fit.clone().differentiated(&self.problem, self.known_columns(fit)?.as_deref());
        fresh().unwrap_or_else(|_| fit.clone())
    }

    /// Derivatives by known numbers, where a run for each would be most of the work.
    fn known_columns(&self, fit: &Fit) -> Result<Option<Vec<DVector<f64>>>, GapError> {
        self.many_joints().then(|| self.derivatives_by_known(fit)).transpose()
    }

    /// The same, those that the fit has.
    fn columns_of<'f>(&self, fit: &'f Fit) -> Option<&'f [DVector<f64>]> {
        fit.jacobian.get(..fit.hypothesis.known).filter(|_| self.many_joints())
    }

    /// Fits all numbers of a fit that had frozen derivatives. Where the simulator fails beside it, the fit stands as it was found.
    pub fn settle(&self, fit: &Fit, scale: f64) -> Fit {
        let anew = || {
            let known = self.known_columns(fit)?;
            let begin = Derivatives { frozen: known.as_deref(), roughly: self.problem.has_short_rows(), kept: false };
            Ok::<Fit, GapError>(self.judge(fit.clone().finish(&self.problem, scale, begin, Effort::to_the_end(f64::NEG_INFINITY))?))
        };
        anew().unwrap_or_else(|_| fit.clone())
    }

    /// Fits to the end, by derivatives of their own, those of the best that may take the place of `name`. A stage's fits have derivatives by the
    /// known numbers from the fit that it adds to, and where the name is most of what is there, these are far from those with another in its
    /// place. `here` is the evidence of the fit without it.
    pub fn settle_rivals(&self, candidates: &mut [Candidate], name: &str, here: f64, scale: f64) {
        let most = candidates.iter().map(|c| c.evidence - here).fold(0.0, f64::max);
        let rival = |c: &&mut Candidate| c.effect != name && c.evidence - here > 0.5 * most;
        let rivals: Vec<&mut Candidate> = candidates.iter_mut().filter(rival).take(if self.many_joints() { 0 } else { RIVALS }).collect();
        rivals.into_par_iter().for_each(|c| c.fit = self.settle(&c.fit, scale));
    }

    /// Fits to the end, by derivatives of their own, those that have come near the best one: where they were left there is no ground to say that
    /// they are behind it.
    pub fn settle_near(&self, candidates: &mut [Candidate], scale: f64) {
        let Some(best) = candidates.first().map(|b| b.evidence) else { return };
        // Of an arm each fit to the end is much of the work, so that only the next one gets its own.
        let rivals = if self.many_joints() { 1 } else { RIVALS };
        let near = |c: &&mut Candidate| c.evidence > best - NEAR;
        let near: Vec<&mut Candidate> = candidates.iter_mut().take(1 + rivals).filter(near).collect();
        if near.len() > 1 {
            near.into_par_iter().for_each(|c| c.fit = self.settle(&c.fit, scale));
            self.rank(candidates, scale);
        }
    }

    /// Fits on from where a fit of this problem stands, or of one that is nearly this one: its derivatives nearly hold.
    pub fn fit_on(&self, fit: Fit, scale: f64) -> Result<Fit, GapError> {
        let known = self.columns_of(&fit).map(<[_]>::to_vec);
        let begin = Derivatives { kept: fit.jacobian.len() == fit.hypothesis.x.len(), frozen: known.as_deref(), roughly: false };
        Ok(self.judge(fit.finish(&self.problem, scale, begin, Effort::to_the_end(f64::NEG_INFINITY))?))
    }

    /// A few steps under a noise that is not the one a fit was made under.
    fn look_at(&self, fit: &Fit, scale: f64) -> Result<Fit, GapError> {
        let fit = fit.under(&self.problem)?;
        let known = self.columns_of(&fit).map(<[_]>::to_vec);
        let begin = Derivatives { kept: fit.jacobian.len() == fit.hypothesis.x.len(), frozen: known.as_deref(), roughly: false };
        Ok(self.judge(fit.improve(&self.problem, scale, Effort::new(QUICK, 0.5), begin)?))
    }

    /// Candidates under a noise that is not the one they were fitted under, the best first as before. The best is fitted anew, and so is
    /// what may come before it; at others a few steps are enough. `current` is the model without them, fitted under the noise, and `here` its
    /// evidence as it was.
    pub fn weigh_anew(&self, current: &Fit, mut candidates: Vec<Candidate>, here: f64, scale: f64) -> Vec<Candidate> {
        candidates.truncate(LOOKED_AT);
        let Some((best, count)) = candidates.first().map(|b| (b.evidence, b.fit.hypothesis.x.len())) else { return candidates };
        let known = Derivatives { frozen: Some(&current.jacobian), ..Derivatives::ROUGH };
        let anew = |fit: &Fit, bar: f64| self.refit_towards(fit, scale, known, bar);
        let behind = candidates.split_off(1);
        let mut all: Vec<Candidate> =
            candidates.into_iter().filter_map(|c| Some(Candidate { fit: anew(&c.fit, f64::NEG_INFINITY).ok()?, ..c })).collect();
        let bar = all.first().map_or(f64::NEG_INFINITY, |c| self.evidence_in_fit(&c.fit, scale));
        let again = |c: Candidate| {
            let simpler = c.fit.hypothesis.x.len() < count && c.evidence - here > 0.5 * (best - here);
            let near = c.evidence > best - NEAR.max(0.1 * (best - here));
            let fit = if near || simpler { anew(&c.fit, bar) } else { self.look_at(&c.fit, scale) };
            // One that cannot be simulated any more is out.
            Some(Candidate { fit: fit.ok()?, ..c })
        };
        all.extend(behind.into_par_iter().filter_map(again).collect::<Vec<_>>());
        all
    }

    pub fn rank(&self, candidates: &mut [Candidate], scale: f64) {
        for c in candidates.iter_mut() {
            c.evidence = self.evidence(&c.fit, scale);
        }
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    }

    /// How far predictions over windows of these data are off, as names are weighed by; infinite for a fit that cannot be simulated. An arm
    /// that nothing holds is lost within a second, whatever its model, and what is left of that says nothing of a small force: so it is
    /// asked over short windows.
    fn gap<'m>(&'m self, model: &ObjectModel, window: f64) -> impl Fn(&Fit) -> f64 + use<'m, 'a> {
        let window = if self.many_joints() { window.min(SHORT) } else { window };
        let measure = Measure::new(self, model, self.problem.trajectories, &[], window);
        move |fit| measure.pooled(&fit.hypothesis, None).unwrap_or(f64::INFINITY)
    }

    /// Puts an effect of fewer numbers first, where it makes the same force as the first one but for less than any model is off by and that does
    /// not add up to much of the gap, or predicts whole windows no worse or most of them much better, or where that one is not convincing beside it:
    /// what is left between them is no ground to name the richer one. `current` is the fit without any, and `here` its evidence.
    pub fn prefer_simpler(
        &self,
        model: &ObjectModel,
        (current, here): (&Fit, f64),
        candidates: &mut [Candidate],
        window: f64,
    ) -> Result<(), GapError> {
        let Some(best) = candidates.first() else { return Ok(()) };
        // An encoder's offset whose scale error is nothing has one number.
        let count = |c: &Candidate| c.fit.hypothesis.x.len() - usize::from(is_plain_offset(c));
        let gap = self.gap(model, window);
        let least = LazyCell::new(|| gap(&best.fit).min(f64::MAX));
        let without = LazyCell::new(|| gap(current));
        let adds_up = |c: &Candidate| adds_up(*least, gap(&c.fit), || *without);
        let predicts_as_well = |c: &Candidate| gap(&c.fit) <= *least;
        let mut chosen = 0;
        for (i, candidate) in candidates.iter().enumerate().take(NEAREST) {
            if count(candidate) < count(&candidates[chosen])
                && candidate.evidence - here > 0.5 * (best.evidence - here)
                && (self.force_between(&candidate.fit, &best.fit)? < SAME && !adds_up(candidate)
                    || candidate.evidence - here > NEARLY * (best.evidence - here) && predicts_as_well(candidate)
                    || self.brings_most_near(model, &best.fit, &candidate.fit, window)
                    || !self.is_convincing(model, &candidate.fit, &best.fit, best.evidence - candidate.evidence, window))
            {
                chosen = i;
            }
        }
        candidates[..=chosen].rotate_right(1);
        Ok(())
    }

    /// Puts an effect of one or two numbers first, where it and a second one of few numbers say together what a rich one says alone, or more, or
    /// nearly so and predict whole windows better: two plain losses look like one of five numbers.
    pub fn prefer_two(
        &self,
        model: &ObjectModel,
        current: &Fit,
        candidates: &mut [Candidate],
        scale: f64,
        window: f64,
    ) -> Result<(), GapError> {
        let Some(best) = candidates.first() else { return Ok(()) };
        let here = self.evidence(current, scale);
        // What the data say nothing of is no number of a force.
        let more = |fit: &Fit| (current.hypothesis.x.len()..fit.hypothesis.x.len()).filter(|i| fit.is_told(*i, scale)).count();
        let numbers = |c: &Candidate| c.fit.hypothesis.x.len() - current.hypothesis.x.len();
        let fall = |c: &Candidate| current.squares - c.fit.squares;
        let rich = more(&best.fit);
        for plain_numbers in PLAINEST {
            let is_plain = |c: &Candidate| more(&c.fit) == plain_numbers && (plain_numbers == 1 || numbers(c) == plain_numbers);
            let plain = |c: &&Candidate| is_plain(c) && fall(c) > PLAIN * fall(best);
            // Together they have fewer numbers than the rich one.
            let Some(left) = rich.checked_sub(plain_numbers + 1).filter(|left| *left > 0) else { continue };
            let Some(plain) = candidates.iter().find(plain) else { continue };
            // Where nothing can be found beside the plain one, it stays alone. What makes the same force, or says nearly as much, comes at least half
            // of the way there.
            let half_way = 0.5 * (best.evidence - plain.evidence);
            let nearly = NEARLY * (best.evidence - here) - (plain.evidence - here);
            let mut second = self.stage_within(&plain.fit, scale, left, half_way.min(nearly).max(0.0)).unwrap_or_default();
            second.retain(|c| more(&c.fit) < rich);
            self.rank(&mut second, scale);
            let Some(two) = second.first() else { continue };
            let gap = self.gap(model, window);
            let nearly = || two.evidence - here > NEARLY * (best.evidence - here) && gap(&two.fit) < gap(&best.fit);
            // Two names ask for more than one does, and give way to one that says more. Rows may say it of what is lost over windows: a stop beside a
            // gain was passed over for a saturation and an axis error, beside which windows were fifty times as far off.
            let gain = two.evidence - best.evidence;
            let says_more = || {
                self.is_convincing(model, &best.fit, &two.fit, gain, window)
                    && self.takes_the_place(model, &two.fit, &best.fit, gain, window)
            };
            let says_less = || self.is_convincing(model, &two.fit, &best.fit, best.evidence - two.evidence, window);
            if self.force_between(&two.fit, &best.fit)? < SAME && !says_less() || says_more() || nearly() {
                let at = candidates.iter().position(|c| std::ptr::eq(c, plain)).unwrap_or(0);
                candidates[..=at].rotate_right(1);
                return Ok(());
            }
        }
        Ok(())
    }

    /// Is an effect there? `gain` is what the evidence gains by it. Errors that go on from row to row say less than as many that are
    /// independent, but for those that add up to a good part of the gap.
    pub fn is_convincing(&self, model: &ObjectModel, less: &Fit, more: &Fit, gain: f64, window: f64) -> bool {
        if gain < CONVINCING || gain < CONVINCING + SURELY * self.problem.chance([less, more], &self.mobility, self.scale(more)) {
            return false;
        }
        let fewer = self.problem.persistence(&more.errors, &(&less.errors - &more.errors));
        gain > CONVINCING * fewer || self.left_of_gap(model, less, more, window) < FALL
    }

    /// Share of the gap of one fit that another leaves. Where the first is lost within a window, what is left of that says little of the second:
    /// then it is asked over short ones.
    pub fn left_of_gap(&self, model: &ObjectModel, less: &Fit, more: &Fit, window: f64) -> f64 {
        let over = |window: f64| {
            let gap = self.gap(model, window);
            [gap(less), gap(more)]
        };
        let [mut before, mut after] = over(window);
        if before > LOST && window > SHORT {
            [before, after] = over(SHORT);
        }
        after / before.max(f64::MIN_POSITIVE)
    }

    /// Does a fit with another name take the place of one that is settled? `gain` is what the evidence gains by it. It predicts whole windows not
    /// much worse, and where it gains little no worse at all.
    pub fn takes_the_place(&self, model: &ObjectModel, other: &Fit, settled: &Fit, gain: f64, window: f64) -> bool {
        let most = if gain > CONVINCING { 1.0 / FALL } else { 1.0 };
        gain > 1.0 && self.left_of_gap(model, settled, other, window) <= most
    }

    /// Is a name needed that evidence does not ask for? Without it whole windows are predicted much worse.
    pub fn is_needed(&self, model: &ObjectModel, without: &Fit, with: &Fit, window: f64) -> bool {
        self.left_of_gap(model, without, with, window) < FALL
    }

    /// Do the rows say by themselves that an effect is there? With it nothing but noise is left, and much more was without: what bends to other
    /// errors of a model leaves some. Where a joint would fall from where it stands, windows end anywhere, whatever the model.
    fn is_certain(&self, less: &Fit, more: &Fit, gain: f64) -> bool {
        self.scale(more) < EXPLAINED && gain > CERTAIN * self.problem.persistence(&more.errors, &(&less.errors - &more.errors))
    }

    /// Is an effect worth a name? Its force is more than what any model is off by and makes the gap smaller, or it adds up to a good part
    /// of the gap: a small loss does over a long swing; or it makes the usual window's error clearly smaller; or the rows are certain of it.
    /// `gain` is what the evidence gains by it, and `force` is [`Self::force_between`] the two fits. Of a large force the gap is not asked: where a
    /// model sticks or hits something, windows go one way or the other by little. Nor is it of what an effort that is read beside a command shows.
    pub fn is_material(
        &self,
        model: &ObjectModel,
        (less, more): (&Fit, &Fit),
        (gain, force): (f64, f64),
        window: f64,
    ) -> Result<bool, GapError> {
        if force < TRIFLE || self.shifts_little(more) {
            return Ok(false);
        }
        let is_read = || Ok::<bool, GapError>(self.read_between(&(&less.errors - &more.errors), &self.runs(less)?) >= MATERIAL);
        if force >= LARGE || self.problem.disturbance.reads_efforts() && is_read()? {
            return Ok(true);
        }
        let least = if force < MATERIAL { FALL } else { SMALLER };
        Ok(self.is_certain(less, more, gain)
            || self.left_of_gap(model, less, more, window) < least
            || self.brings_most_near(model, less, more, window)
            || force >= MATERIAL && self.left_in_usual_window(model, less, more, window) < USUAL)
    }

    /// Share of the error in the median window that another fit leaves there: a few that begin beside an unstable rest end anywhere, and are all
    /// that a mean over windows shows.
    fn left_in_usual_window(&self, model: &ObjectModel, less: &Fit, more: &Fit, window: f64) -> f64 {
        let window = if self.many_joints() { window.min(SHORT) } else { window };
        let measure = Measure::new(self, model, self.problem.trajectories, &[], window);
        let usual = |fit: &Fit| measure.in_usual_window(&fit.hypothesis);
        usual(less).and_then(|before| Ok(usual(more)? / before.max(f64::MIN_POSITIVE))).unwrap_or(f64::INFINITY)
    }

    /// Are most windows predicted much better by a fit? A few that go the other way where a joint comes to rest or does not are more than all
    /// others together.
    fn brings_most_near(&self, model: &ObjectModel, less: &Fit, more: &Fit, window: f64) -> bool {
        let window = if self.many_joints() { window.min(SHORT) } else { window };
        let measure = Measure::new(self, model, self.problem.trajectories, &[], window);
        let (Ok(before), Ok(after)) = (measure.by_window(&less.hypothesis), measure.by_window(&more.hypothesis)) else { return false };
        let near = before.iter().zip(&after).filter(|(before, after)| **after < FALL * **before).count();
        near as f64 > MOST * before.len() as f64
    }

    /// Is a fit's last effect a shift in time that stamps and steps of any source are off by?
    fn shifts_little(&self, fit: &Fit) -> bool {
        let hypothesis = &fit.hypothesis;
        let Some(last) = entries(hypothesis).last().copied() else { return false };
        let time = |f: &Fitted| matches!(f.knob, Knob::Effect(e, "skew" | "delay" | "time_constant") if e == last) && f.unit == "s";
        let shifts = matches!(hypothesis.model.document.effects[last].effect.as_str(), "clock_skew" | "transport_delay" | "actuator_lag");
        let at = hypothesis.fitted.iter().position(time);
        shifts && at.is_some_and(|i| hypothesis.fitted[i].value(hypothesis.x[i]).abs() < JITTER * self.problem.period)
    }

    /// Share of the squared errors, beyond noise, that one fit takes away from another's.
    pub fn explained(&self, less: &Fit, more: &Fit) -> f64 {
        let noise = more.squares.max(self.problem.measured() as f64);
        ((less.squares - more.squares) / (less.squares - noise).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    }

    /// Size of the force by which two fits differ, beyond what the known numbers can make of it: RMS, as a share of what accelerates the
    /// joint around each row, on the joint where it is largest. By as much efforts may differ that are read beside a command.
    pub fn force_between(&self, less: &Fit, more: &Fit) -> Result<f64, GapError> {
        let runs = self.runs(less)?;
        let quiet = &self.problem.disturbance.quiet;
        let change = &less.errors - &more.errors;
        let size = |j: usize| {
            let force = Response::new(self, less, &runs, j).lacking(&change);
            let of = |t: &'_ Trajectory| -> Vec<f64> {
                let both = t.liveliness.iter().zip(&t.strain).skip(j).step_by(t.joints);
                both.map(|(a, u)| (self.inertias[j] * a.max(quiet[j])).max(*u)).collect()
            };
            let around = self.problem.trajectories.iter().flat_map(of);
            let shares = force.iter().zip(around).map(|(f, a)| f / a);
            (shares.map(|s| s * s).sum::<f64>() / force.len() as f64).sqrt()
        };
        Ok((0..self.names.len()).map(size).fold(self.read_between(&change, &runs), f64::max))
    }

    /// Size of what efforts beside commands differ by where errors differ so: RMS, as a share of the efforts around each row, on the joint where
    /// it is largest.
    fn read_between(&self, change: &DVector<f64>, runs: &[Run]) -> f64 {
        if !self.problem.disturbance.reads_efforts() {
            return 0.0;
        }
        let n = self.names.len();
        let strain = self.problem.trajectories.iter().flat_map(|t| t.strain.iter());
        let deviations = runs.iter().flat_map(|run| run.gains.efforts());
        let mut sums = vec![[0.0; 2]; n];
        for (i, ((e, deviation), strain)) in change.iter().skip(self.problem.entries()).zip(deviations).zip(strain).enumerate() {
            if *deviation > 0.0 {
                let [square, all] = &mut sums[i % n];
                *square += (e * deviation).powi(2);
                *all += strain * strain;
            }
        }
        sums.iter().filter(|s| s[1] > 0.0).map(|[square, all]| (square / all).sqrt()).fold(0.0, f64::max)
    }

    /// RMS of what the effects change of the force, over all joints.
    pub fn explained_force(&self, current: &Fit, base: &Fit) -> Result<f64, GapError> {
        let (a, b) = (self.runs(current)?, self.runs(base)?);
        let mut most: f64 = 0.0;
        for j in 0..self.names.len() {
            let response = Response::new(self, base, &b, j);
            let before = response.lacking(&base.errors);
            let after = Response::new(self, current, &a, j).lacking(&current.errors);
            let square = |f: &[f64]| f.iter().map(|x| x * x).sum::<f64>() / f.len() as f64;
            most = most.max(square(&before) - square(&after));
        }
        Ok(most.max(0.0).sqrt())
    }

    /// The disturbance under which a fit's errors are most likely, if that is not the one assumed.
    pub fn likelier_noise(&self, fit: &Fit) -> Result<Option<Disturbance>, GapError> {
        let plant = fit.hypothesis.plant(&fit.hypothesis.x, &self.problem.limits, self.problem.step)?;
        // With another name the floors may have been raised too much: what is left without it looks like noise.
        let mut now = Disturbance { effort: self.problem.disturbance.effort.clone(), ..self.of_data.clone() };
        for (j, (effort, jitter)) in now.effort.iter_mut().zip(&self.of_data.effort).enumerate().filter(|(_, (e, _))| **e > 0.0) {
            if let Some(share) = self.problem.share_of_noise(fit, j, *jitter) {
                *effort = share.sqrt() * jitter;
            }
        }
        let mobility = self.problem.mobility(&plant);
        let drives = self.problem.drives(&plant);
        let behind = |factors: [f64; 2]| now.times(factors).behind(&mobility, &drives);
        let part = part::stretches(self.problem.trajectories);
        let trajectories = part.as_deref().unwrap_or(self.problem.trajectories);
        let factors = likely_noise(&plant, trajectories, &behind, [1.0, MOST_NOISE], Seek::Cautiously);
        let likelier = now.times(factors);
        Ok((likelier != self.problem.disturbance).then_some(likelier))
    }

    pub fn with_noise(self, disturbance: Disturbance) -> Self {
        let problem = Problem::new(self.problem.trajectories, disturbance, &self.problem.limits, self.problem.step);
        Self { problem, ..self }
    }

    /// The same problem in finer steps.
    pub fn finer(&mut self) {
        self.problem.step = self.problem.step.min(FINE);
    }

    /// Steps so short that what they leave over cannot be taken for an effect: where they are halved, errors change by less than an effect has
    /// to say while errors are so large: the nearer a model comes, the more of them tell. Where the change does not fall with the steps it has no
    /// order, as where joints stick or hit something, and shorter ones are no better.
    pub fn shorten_steps(&mut self, fit: &Fit, scale: f64) -> Result<bool, GapError> {
        let Hypothesis { x, .. } = &fit.hypothesis;
        let at = |step: f64| Problem { step, ..self.problem.clone() }.errors(&fit.hypothesis, x);
        let longest = self.problem.step;
        let (mut step, mut errors, mut before) = (longest, at(longest)?, f64::INFINITY);
        while step > SHORTEST {
            let finer = at(0.5 * step)?;
            let left = 0.5 * (&finer - &errors).norm_squared() / (scale * scale);
            if left > 0.5 * before {
                step = (2.0 * step).min(longest);
                break;
            }
            if left < 0.5 * CONVINCING {
                break;
            }
            (step, errors, before) = (0.5 * step, finer, left);
        }
        self.problem.step = step;
        Ok(step < longest)
    }

    /// The most likely force without a name, and its joint.
    pub fn nameless(&self, fit: &Fit, scale: f64) -> Result<Option<(usize, Nameless)>, GapError> {
        Ok(self.lacking_forces(fit, scale)?.into_iter().next())
    }

    /// The most likely force without a name on each joint, the most evident first.
    pub fn lacking_forces(&self, fit: &Fit, scale: f64) -> Result<Vec<(usize, Nameless)>, GapError> {
        let all = self.nameless_by_joint(fit, scale)?.into_iter().enumerate();
        let mut found: Vec<(usize, Nameless)> = all.filter_map(|(j, n)| Some((j, n?))).collect();
        found.sort_by(|a, b| b.1.evidence.total_cmp(&a.1.evidence));
        Ok(found)
    }

    /// What a force without a name says in the place of a name that says `gain`. It is screened in the errors as they are: so it stands beside the
    /// name as that does there.
    pub fn without_name(&self, less: &Fit, with: &Fit, gain: f64, scale: f64) -> Result<f64, GapError> {
        let own = self.evidence_in_fit(with, scale) - self.evidence_in_fit(less, scale);
        Ok(self.nameless(less, scale)?.map_or(0.0, |(_, force)| force.evidence + gain - own))
    }

    /// Is a force without a name there, and more than any model is off by?
    pub fn is_a_force(&self, (joint, nameless): &(usize, Nameless)) -> bool {
        nameless.evidence > 2.0 * CONVINCING && nameless.force > MATERIAL * self.typical_force()[*joint]
    }

    /// Do a fit's errors say that such a force is there, where those that hang together count as few?
    pub fn is_plain(&self, fit: &Fit, nameless: &Nameless) -> bool {
        nameless.evidence > 2.0 * CONVINCING * self.problem.persistence(&fit.errors, &nameless.change)
    }

    /// Does a fit leave such a force?
    pub fn leaves_a_force(&self, fit: &Fit, scale: f64) -> Result<bool, GapError> {
        Ok(self.nameless(fit, scale)?.is_some_and(|left| self.is_a_force(&left)))
    }

    /// The likeliest of some candidates, where a plainer one was put before it, settled alone; none where it cannot be simulated any more.
    pub fn likeliest_alone(&self, mut instead: Vec<Candidate>, scale: f64) -> Option<(Vec<Candidate>, Fit)> {
        let alone = self.settle(&instead.first()?.fit.under(&self.problem).ok()?, scale);
        instead[0].fit = alone.clone();
        Some((instead, alone))
    }

    /// The most likely force without a name on each joint.
    pub fn nameless_by_joint(&self, fit: &Fit, scale: f64) -> Result<Vec<Option<Nameless>>, GapError> {
        let runs = self.runs(fit)?;
        let (typical, span) = (self.typical_force(), Span::new(fit, scale));
        let on = |j: usize| flexible::nameless(&Response::new(self, fit, &runs, j), &span, scale, typical[j]);
        Ok((0..self.names.len()).into_par_iter().map(on).collect())
    }

    /// Typical force on each joint.
    pub fn typical_force(&self) -> Vec<f64> {
        let typical = crate::noise::accelerations(self.problem.trajectories, &self.inertias);
        typical.iter().zip(&self.inertias).map(|(a, m)| a * m).collect()
    }

    /// Does anything move? Says what does not, and what stands in each recording.
    pub fn check_motion(&self, notes: &mut Vec<String>) -> Result<(), GapError> {
        let still = self.names.iter().zip(&self.still).filter(|(_, still)| **still);
        notes.extend(
            still.map(|(name, _)| format!("{name}: stands in each recording, if elsewhere in others; nothing is looked for on it")),
        );
        let mut moves = false;
        for (j, name) in self.names.iter().enumerate() {
            let [low, high] = Trajectory::range(self.problem.trajectories, j);
            if high - low > 20.0 * self.problem.disturbance.position[j] && high > low {
                moves = true;
            } else if low <= high {
                notes.push(format!("{name}: does not move in these data"));
            }
        }
        if moves {
            return Ok(());
        }
        let message = "nothing moves in these data: record a slow sweep over the range in both directions, and one at several speeds";
        Err(GapError::data(self.names.join(", "), message))
    }
}

#[cfg(test)]
mod tests {
    use super::adds_up;

    /// Gaps, in shares of the range, with the richer name, with the plainer one and without either.
    #[track_caller]
    fn check([rich, plain, without]: [f64; 3], expected: bool) {
        assert_eq!(adds_up(rich, plain, || without), expected, "{rich} of {plain} of {without}");
    }

    #[test]
    fn what_an_engines_own_error_leaves_makes_a_plain_name_rich() {
        // A torque bias of another engine, beside which an encoder's offset has a number more that bends to steps of the engine.
        check([2.70e-5, 3.97e-5, 1.3e-3], false);
        // Most of what is left is taken all the same, or the plain name leaves much.
        check([1.0e-5, 3.97e-5, 1.3e-3], true);
        check([2.70e-4, 3.97e-4, 1.3e-3], true);
        check([7e-5, 0.0144, 0.0150], true);
        check([3.0e-4, 3.97e-4, 1.3e-3], false);
    }
}
