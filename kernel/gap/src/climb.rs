//! One name after the other, each the likeliest beside those before it (forward selection, Miller 2002, chapter 3), and again from other first
//! names where the likeliest leaves a force and predicts badly: one that is shaped like two of them together may come before either.

use sagci_model::ObjectModel;

use crate::GapError;
use crate::alike::call_by_plain_name;
use crate::choice::Choice;
use crate::fit::Fit;
use crate::gaps::Measure;
use crate::search::{Candidate, Search};
use crate::weigh::{ALL_BUT_CLOSED, CONVINCING, FALL, MATERIAL, MOST_TAKEN};

/// Most effects that are looked for at once.
pub(crate) const MOST: usize = 4;
/// Gain in evidence that the best promises, below which none is fitted any further.
const HOPEFUL: f64 = 0.5 * CONVINCING;
/// Gain in evidence from which on a name that makes windows no better is looked at beside another.
const SURE: f64 = 10.0 * CONVINCING;
/// How many of the likeliest are asked whether they are there, one after the other.
const TRIED: usize = 3;
/// Other first names that are tried, and the share of the likeliest's gain in evidence that they need.
const RIVALS: usize = 2;
const NEARLY: f64 = 0.8;

/// Share of what the names before it make that a second one needs, if it is small: by as much the shape of a name may be off.
const TENTH: f64 = 0.1;

/// What is asked, and who hears of it.
pub(crate) struct Ascent<'a> {
    pub model: &'a ObjectModel,
    /// Length of the windows over which positions are predicted, s.
    pub window: f64,
    pub seed: u64,
    pub say: &'a dyn Fn(&str),
}

/// Where a search has come to.
#[derive(Debug, Clone)]
pub(crate) struct Climb<'a> {
    pub search: Search<'a>,
    /// The model without names, its known numbers refitted.
    pub base: Fit,
    pub current: Fit,
    pub scale: f64,
    pub chosen: Vec<Choice>,
    /// What was not named in the end, and what it says beyond the model without it.
    pub lost: Vec<(&'static str, f64)>,
    /// A force without a name says more than the best name that was left.
    pub nameless_won: bool,
    /// Holds a force that is too small for a second name: as likely the shape of another name as an effect.
    holds_small: bool,
    /// Some names make less than any model is off by: they are there for what they add up to over windows, and rows tell little of their numbers.
    pub adds_up: bool,
    /// Two names stand in the place of two others. These are not asked for others again: what is simpler and what says a little more might take
    /// turns.
    pub both_gave_way: bool,
    /// The likeliest, where a plainer one was put before it.
    passed: Option<Vec<Candidate>>,
    /// Where it stood when the first name was to be chosen, among which.
    first: Option<Box<First<'a>>>,
}

/// A name that is there.
struct There {
    /// Fitted to its own end.
    settled: Fit,
    /// Its force is below what any model is off by: it is there for what it adds up to.
    adds_up: bool,
    /// And small beside the names before it.
    small: bool,
}

#[derive(Debug, Clone)]
struct First<'a> {
    search: Search<'a>,
    base: Fit,
    scale: f64,
    candidates: Vec<Candidate>,
    here: f64,
    nameless: f64,
}

impl<'a> Climb<'a> {
    /// Of a model whose known numbers are refitted.
    pub fn new(search: Search<'a>, base: Fit) -> Self {
        let scale = search.scale(&base);
        let current = base.clone();
        let (chosen, lost) = (Vec::new(), Vec::new());
        Self {
            search,
            base,
            current,
            scale,
            chosen,
            lost,
            nameless_won: false,
            holds_small: false,
            adds_up: false,
            both_gave_way: false,
            passed: None,
            first: None,
        }
    }

    /// Names what is there.
    pub fn finish(mut self, ascent: &Ascent<'_>) -> Result<Self, GapError> {
        self.ascend(ascent, true)?;
        if self.chosen.is_empty() || !self.falls_short(ascent)? {
            return Ok(self);
        }
        let measure = self.measure(ascent);
        let mut best: Option<Self> = None;
        for mut rival in self.rivals() {
            (ascent.say)(&format!("  looking again from {}", rival.chosen[0].best.effect));
            let leader = best.as_ref().unwrap_or(&self);
            // One that cannot be simulated on its way is none.
            if rival.ascend(ascent, leader.holds_small).is_ok_and(|arrived| arrived) && rival.beats(leader, &measure) {
                best = Some(rival);
            }
        }
        Ok(best.unwrap_or(self))
    }

    /// Do the names on a few joints leave a force by which windows are far off?
    pub fn falls_short(&self, ascent: &Ascent<'_>) -> Result<bool, GapError> {
        let Self { search, current, scale, .. } = self;
        let is_far = || self.measure(ascent).is_far(&current.hypothesis, ascent.seed);
        Ok(!search.many_joints() && search.leaves_a_force(current, *scale)? && is_far())
    }

    /// The gap over the data that all is fitted to.
    fn measure(&self, ascent: &Ascent<'_>) -> Measure<'_> {
        Measure::new(&self.search, ascent.model, self.search.problem.trajectories, &[], ascent.window)
    }

    /// Names one after the other until none is there. False, and not at its end, where a name that is too small comes up and none may be held.
    fn ascend(&mut self, ascent: &Ascent<'_>, with_small: bool) -> Result<bool, GapError> {
        while self.chosen.len() < MOST && self.names_one(ascent)? {
            if self.holds_small && !with_small {
                return Ok(false);
            }
            self.shorten_steps(ascent);
        }
        let Self { search, scale, .. } = self;
        let scale = *scale;
        // A plainer name that leaves a force over gives way to the likeliest, if that does not.
        if let ([_], Some(passed)) = (self.chosen.as_slice(), self.passed.take())
            && search.leaves_a_force(&self.current, scale)?
            && let Some((instead, alone)) = search.likeliest_alone(passed, scale)
            && let gain = search.evidence(&alone, scale) - search.evidence(&self.current, scale)
            && gain > CONVINCING
            && search.takes_the_place(ascent.model, &alone, &self.current, gain, ascent.window)
            && !search.leaves_a_force(&alone, scale)?
            && let Some(last) = self.chosen.pop()
        {
            (ascent.say)(&format!("  {} leaves nothing of what {} does", instead[0].effect, last.best.effect));
            self.chosen.push(last.giving_way_to(search, &instead, scale));
            self.current = alone;
        }
        self.take_apart(ascent)?;
        Ok(true)
    }

    /// Fits the names, and the known numbers without them, in the finer steps of predictions. Where these cannot be taken, what was found stands.
    pub fn fit_to_the_end(&mut self, notes: &mut Vec<String>) {
        let settled = self.search.problem.clone();
        self.search.finer();
        let on = |fit: &Fit| self.search.fit_on(fit.under(&self.search.problem)?, self.scale);
        let finer = on(&self.current).and_then(|fit| Ok((if self.chosen.is_empty() { fit.clone() } else { on(&self.base)? }, fit)));
        match finer {
            Ok(finer) => (self.base, self.current) = finer,
            Err(error) => {
                notes.push(format!("the last fit, in finer steps, was left out: {error}"));
                self.search.problem = settled;
            }
        }
        self.scale = self.search.scale(&self.current);
    }

    /// Steps as short as what the names leave asks for. Where the model cannot be simulated in these, it stays as it is.
    fn shorten_steps(&mut self, ascent: &Ascent<'_>) {
        let scale = self.search.scale(&self.current);
        let mut finer = self.search.clone();
        let refitted = finer.shorten_steps(&self.current, scale).and_then(|shorter| {
            let again = || Ok((finer.refit(&self.base, scale)?, finer.refit(&self.current, scale)?));
            shorter.then(again).transpose()
        });
        self.scale = scale;
        match refitted {
            Ok(None) => (),
            Ok(Some((base, current))) => (self.search, self.base, self.current) = (finer, base, current),
            Err(error) => (ascent.say)(&format!("  shorter steps were left out: {error}")),
        }
    }

    /// Names one more; none if none is there.
    fn names_one(&mut self, ascent: &Ascent<'_>) -> Result<bool, GapError> {
        let Ascent { model, window, say, .. } = *ascent;
        say(&format!("looking for {} missing effect", if self.chosen.is_empty() { "a" } else { "another" }));
        let Some(mut candidates) = self.offered()? else { return Ok(false) };
        let (search, scale, current) = (&self.search, self.scale, &self.current);
        let here = search.evidence(current, scale);
        let likeliest = candidates.clone();
        call_by_plain_name(&mut candidates);
        search.prefer_simpler(model, (current, here), &mut candidates, window)?;
        search.prefer_two(model, current, &mut candidates, scale, window)?;
        let Some(best) = candidates.first() else { return Ok(false) };
        say(&format!("  most likely: {}", best_three(&candidates, here)));
        let gain = best.evidence - here;
        let without_name = search.without_name(current, &best.fit, gain, scale)?;
        let turn = self.turn(&candidates, &likeliest, here);
        let found = self.first_there(&candidates, &turn, here, ascent)?;
        let Some((first, There { settled, adds_up, small }, counts)) = found else {
            self.nameless_won = without_name > 2.0 * CONVINCING && gain < without_name;
            self.lost = beside(&candidates, here);
            return Ok(false);
        };
        candidates[..=first].rotate_right(1);
        let best = &candidates[0];
        if !counts {
            return Ok(self.gives_shape(&candidates, here, &settled, say));
        }
        let explained = search.explained(current, &best.fit);
        if self.chosen.is_empty() {
            let (search, base) = (search.clone(), self.base.clone());
            self.first = Some(Box::new(First { search, base, scale, candidates: candidates.clone(), here, nameless: without_name }));
        }
        self.passed = likeliest.first().is_some_and(|c| (c.effect, c.joint) != (best.effect, best.joint)).then_some(likeliest);
        self.current = settled;
        self.holds_small |= small;
        self.adds_up |= adds_up;
        self.chosen.push(Choice::new(search, &candidates, here, without_name, explained, scale));
        Ok(true)
    }

    /// Candidates for one more effect, weighed under the noise that is likeliest with the best of them; none where nothing is offered.
    fn offered(&mut self) -> Result<Option<Vec<Candidate>>, GapError> {
        let mut candidates = self.search.stage(&self.current, self.scale)?;
        let Some(first) = candidates.first() else { return Ok(None) };
        let mut next = self.search.scale(&first.fit);
        let likelier = self.search.likelier_noise(&first.fit)?;
        // Beside names, under a noise that is known, most often nothing is there and none comes near.
        let tells = likelier.as_ref().map_or(1.0, |noise| noise.tells_more_than(&self.search.problem.disturbance));
        let promised = |c: &Candidate| self.search.promised(&self.current, &c.fit, 1.0 / tells, self.scale);
        let hopeful = self.chosen.is_empty() || candidates.iter().any(|c| promised(c) > HOPEFUL);
        if let Some(noise) = likelier.filter(|_| hopeful) {
            let before = self.search.evidence(&self.current, self.scale);
            self.search = self.search.clone().with_noise(noise);
            self.base = self.search.refit(&self.base, next)?;
            self.current = if self.chosen.is_empty() { self.base.clone() } else { self.search.refit(&self.current, next)? };
            candidates = self.search.weigh_anew(&self.current, candidates, before, next);
            next = candidates.iter().map(|c| self.search.scale_as_judged(&c.fit)).fold(f64::INFINITY, f64::min);
        }
        self.scale = next;
        self.search.rank(&mut candidates, self.scale);
        if hopeful {
            self.search.settle_near(&mut candidates, self.scale);
        }
        Ok(Some(candidates))
    }

    /// Which candidates are asked, in turn. Beside a name, where the one that comes first does not convince, another of the likeliest may: what more
    /// than one effect leaves hangs together, and what bends to that is refused for it. Without any, what hangs together so may be none of the
    /// catalogue.
    fn turn(&self, candidates: &[Candidate], likeliest: &[Candidate], here: f64) -> Vec<usize> {
        let convinces = |c: &Candidate| c.evidence - here > CONVINCING;
        // A plainer name that came before the likeliest and does not convince is no reason not to ask that one.
        let stands_back = candidates.first().is_some_and(|c| !convinces(c)) && likeliest.first().is_some_and(convinces);
        let others = if self.chosen.is_empty() { usize::from(stands_back) } else { TRIED };
        let place = |l: &Candidate| candidates.iter().position(|c| (c.effect, c.joint) == (l.effect, l.joint));
        let convincing = likeliest.iter().take(others).filter(|l| convinces(l));
        std::iter::once(0).chain(convincing.filter_map(place).filter(|i| *i > 0)).collect()
    }

    /// The first of candidates in turn that is there and counts, or else that is there at all, and whether it counts. One that is too small for a
    /// second name is no reason not to ask the next.
    fn first_there(
        &self,
        candidates: &[Candidate],
        turn: &[usize],
        here: f64,
        ascent: &Ascent<'_>,
    ) -> Result<Option<(usize, There, bool)>, GapError> {
        let (mut found, mut asked) = (None, false);
        for i in turn {
            let Some(there) = self.is_there(&candidates[*i], here, ascent, &mut asked)? else { continue };
            let counts = !there.small || self.brings_near(&there.settled, ascent);
            if counts {
                return Ok(Some((*i, there, true)));
            }
            found = found.or(Some((*i, there, false)));
        }
        Ok(found)
    }

    /// A force below what any model is off by, and small beside the names before it, is no second name: it is what their shapes are off by. Where the
    /// likeliest alone says what the plainer one before and this say, that is the shape. What brings windows near that are far off without it is one.
    fn gives_shape(&mut self, candidates: &[Candidate], here: f64, settled: &Fit, say: &dyn Fn(&str)) -> bool {
        let (search, scale) = (&self.search, self.scale);
        if let Some((instead, alone)) = self.passed.take().and_then(|passed| search.likeliest_alone(passed, scale))
            && search.evidence(&alone, scale) > search.evidence(settled, scale) - CONVINCING
            && let Some(last) = self.chosen.pop()
        {
            say(&format!("  {} alone says as much as {} and this", instead[0].effect, last.best.effect));
            self.chosen.push(last.giving_way_to(search, &instead, scale));
            self.current = alone;
            return true;
        }
        self.lost = beside(candidates, here);
        false
    }

    /// A candidate, if it is there. `asked` says whether another was looked for beside one of its rivals: that is a search of its own, and made
    /// for each of them most of the work on data that no model fits.
    fn is_there(&self, candidate: &Candidate, here: f64, ascent: &Ascent<'_>, asked: &mut bool) -> Result<Option<There>, GapError> {
        let Ascent { model, window, say, .. } = *ascent;
        let (search, scale, current) = (&self.search, self.scale, &self.current);
        let gain = candidate.evidence - here;
        let force = search.force_between(current, &candidate.fit)?;
        say(&format!("  {} makes {:.2} % of what accelerates the joint", candidate.effect, 100.0 * force));
        if gain <= CONVINCING {
            return Ok(None);
        }
        let shows = |fit: &Fit, force: f64| -> Result<bool, GapError> {
            let gain = search.evidence(fit, scale) - here;
            Ok(search.is_convincing(model, current, fit, gain, window)
                && search.is_material(model, (current, fit), (gain, force), window)?)
        };
        // What is named already was fitted without the candidate: it is asked once more when all are fitted together.
        let settled = search.settle(&candidate.fit, scale);
        if !search.is_shaped(&settled) {
            return Ok(None);
        }
        let together = search.force_between(current, &settled)?;
        let mut there = shows(&candidate.fit, force)? || shows(&settled, together)?;
        if !there && !*asked && gain > SURE && force > MATERIAL && !search.many_joints() {
            *asked = true;
            there = self.shows_with_another(&settled, ascent)?;
        }
        if !there {
            return Ok(None);
        }
        let largest = force.max(together);
        let adds_up = largest < MATERIAL;
        let small = adds_up && !self.chosen.is_empty() && largest < TENTH * search.force_between(&self.base, current)?;
        Ok(Some(There { settled, adds_up, small }))
    }

    /// Are windows far off, and much less so by a fit? What is left of a gap that is all but closed is what the names' shapes are off by, too, and
    /// no other name takes most of that.
    fn brings_near(&self, fit: &Fit, ascent: &Ascent<'_>) -> bool {
        let (search, &Ascent { model, window, seed, .. }) = (&self.search, ascent);
        let measure = self.measure(ascent);
        let usual = |fit: &Fit| measure.in_usual_window(&fit.hypothesis).unwrap_or(f64::INFINITY);
        measure.is_far(&self.current.hypothesis, seed)
            && (usual(fit) < MOST_TAKEN * usual(&self.current)
                || search.left_of_gap(model, &self.current, fit, window) < FALL
                    && search.left_of_gap(model, &self.base, &self.current, window) > ALL_BUT_CLOSED)
    }

    /// Does a name make windows no better only because another is missing as well? With the likeliest one beside it they are much better.
    fn shows_with_another(&self, fit: &Fit, ascent: &Ascent<'_>) -> Result<bool, GapError> {
        let (search, scale) = (&self.search, self.scale);
        if !self.measure(ascent).is_far(&self.current.hypothesis, ascent.seed) {
            return Ok(false);
        }
        let Some(second) = search.stage(fit, scale)?.into_iter().next() else { return Ok(false) };
        let gain = second.evidence - search.evidence(fit, scale);
        Ok(search.is_convincing(ascent.model, fit, &second.fit, gain, ascent.window)
            && search.left_of_gap(ascent.model, &self.current, &second.fit, ascent.window) < FALL)
    }

    /// Climbs that begin with other first names.
    fn rivals(&self) -> Vec<Self> {
        let Some(First { search, base, scale, candidates, here, nameless }) = self.first.as_deref() else { return Vec::new() };
        let named = |c: &Candidate| self.chosen.iter().any(|chosen| chosen.best.effect == c.effect && chosen.best.joint == c.joint);
        let gain = |c: &Candidate| c.evidence - here;
        let likely = |i: &usize| !named(&candidates[*i]) && gain(&candidates[*i]) > NEARLY * gain(&candidates[0]);
        let begin = |i: usize| {
            let mut all = candidates.clone();
            all[..=i].rotate_right(1);
            let explained = search.explained(base, &all[0].fit);
            let current = search.settle(&all[0].fit, *scale);
            Self {
                scale: search.scale(&current),
                chosen: vec![Choice::new(search, &all, *here, *nameless, explained, *scale)],
                current,
                ..Self::new(search.clone(), base.clone())
            }
        };
        (0..candidates.len()).filter(likely).take(RIVALS).map(begin).collect()
    }

    /// Does it predict whole windows better than another, each name being asked for its share? Where a model is far off evidence is sure of names
    /// that make every row a little likelier and lose the motion within a window.
    fn beats(&self, other: &Self, measure: &Measure<'_>) -> bool {
        measure.lead(&self.current.hypothesis, &other.current.hypothesis).is_ok_and(|lead| lead > CONVINCING)
    }
}

/// Candidates, and what each says beyond the model without it.
fn beside(candidates: &[Candidate], here: f64) -> Vec<(&'static str, f64)> {
    candidates.iter().map(|c| (c.effect, c.evidence - here)).collect()
}

fn best_three(candidates: &[Candidate], here: f64) -> String {
    let all: Vec<String> = candidates.iter().take(3).map(|c| format!("{} ({:+.1})", c.effect, c.evidence - here)).collect();
    all.join(", ")
}
