//! A second look at each name, now that the others are there: what they say as well falls out, and what says more in its place comes in
//! (backward elimination and exchange; Miller 2002, chapter 3).

use crate::GapError;
use crate::choice::Choice;
use crate::climb::{Ascent, Climb};
use crate::fit::Fit;
use crate::search::entries;

/// Squares of the errors without a name over those with it, from which on other names in its place need derivatives of their own.
const FAR_OFF: f64 = 2.0;

impl Climb<'_> {
    /// Looks again at each of several names. The first, if it remains alone, keeps what was said of it when nothing else was there; another that
    /// does is asked about again, since it was chosen beside one that is gone.
    pub fn look_again(&mut self, ascent: &Ascent<'_>) -> Result<(), GapError> {
        if self.chosen.len() < 2 {
            return Ok(());
        }
        (ascent.say)("looking again at each effect beside the others");
        let first = (self.chosen[0].best.effect, self.chosen[0].best.joint);
        // First what the others say as well: beside a name that falls out, another would be compared with strangers.
        self.drop_idle(ascent);
        let mut at = 0;
        while at < self.chosen.len() && self.chosen.len() > 1 {
            if self.gives_way(at, ascent)? {
                self.drop_idle(ascent);
                at = 0;
            } else {
                at += 1;
            }
        }
        if let [alone] = self.chosen.as_slice()
            && (alone.best.effect, alone.best.joint) != first
        {
            self.gives_way(0, ascent)?;
        }
        // The order of entries is that of the numbers in the hypothesis.
        let document = &self.current.hypothesis.model.document;
        let names: Vec<String> = entries(&self.current.hypothesis).iter().map(|e| document.effects[*e].effect.clone()).collect();
        self.chosen.sort_by_key(|c| names.iter().position(|n| n == c.best.effect).unwrap_or(usize::MAX));
        Ok(())
    }

    /// The others, fitted without one of the names; none where they cannot be simulated.
    fn without(&self, at: usize) -> Option<Fit> {
        let entry = *entries(&self.current.hypothesis).get(at)?;
        let less = self.current.without(&self.search.problem, entry).and_then(|f| self.search.fit_on(f, self.scale));
        less.ok()
    }

    /// Takes out names that say no more than the others do, the least of them first.
    fn drop_idle(&mut self, ascent: &Ascent<'_>) {
        while self.chosen.len() > 1 {
            let Self { search, current, scale, .. } = &*self;
            let with = search.evidence(current, *scale);
            let idle = (0..self.chosen.len()).filter_map(|at| {
                // What cannot be simulated without it needs it, and what another name would have to be bent for.
                let less = self.without(at).filter(|less| search.is_shaped(less))?;
                let gain = with - search.evidence(&less, *scale);
                let stays = search.is_convincing(ascent.model, &less, current, gain, ascent.window)
                    || search.is_needed(ascent.model, &less, current, ascent.window);
                (!stays).then_some((at, gain, less))
            });
            let Some((at, gain, less)) = idle.min_by(|a, b| a.1.total_cmp(&b.1)) else { return };
            (ascent.say)(&format!("  {} says no more than the others do ({gain:+.1})", self.chosen[at].best.effect));
            self.current = less;
            self.chosen.remove(at);
        }
    }

    /// Asks what else may stand in the place of a name. True where another does.
    fn gives_way(&mut self, at: usize, ascent: &Ascent<'_>) -> Result<bool, GapError> {
        let Ascent { model, window, say, .. } = *ascent;
        let Some(less) = self.without(at) else { return Ok(false) };
        let (search, current, scale) = (&self.search, &self.current, self.scale);
        let (with, without) = (search.evidence(current, scale), search.evidence(&less, scale));
        let name = self.chosen[at].best.effect;
        let mut candidates = search.stage(&less, scale)?;
        if less.squares > FAR_OFF * current.squares {
            search.settle_rivals(&mut candidates, name, without, scale);
        }
        search.rank(&mut candidates, scale);
        search.prefer_simpler(model, &mut candidates, without, window)?;
        // What is settled gives way by the same rules by which it was chosen.
        if candidates.first().is_some_and(|c| c.effect != name) {
            search.prefer_two(model, &less, &mut candidates, scale, window)?;
        }
        let Some(best) = candidates.first() else { return Ok(false) };
        if best.effect != name && search.takes_the_place(model, &best.fit, current, best.evidence - with, window) {
            let settled = search.settle(&best.fit, scale);
            if !search.is_shaped(&settled) {
                return Ok(false);
            }
            say(&format!("  {} says more than {name} beside the others ({:+.1})", best.effect, best.evidence - with));
            let explained = search.explained(&less, &settled);
            let choice = Choice::new(search, &candidates, without, self.chosen[at].nameless, explained, scale);
            self.current = settled;
            self.chosen.remove(at);
            self.chosen.push(choice);
            return Ok(true);
        }
        let explained = search.explained(&less, current);
        let choice = &mut self.chosen[at];
        choice.around(search, &candidates, [with, without], scale);
        choice.explained = explained;
        Ok(false)
    }
}
