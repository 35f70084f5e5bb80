//! Dry friction and drag that together look like a loss between them. Over the speeds of one swing `c sign(v) + k v |v|` is nearly `b v`, with
//! `b = c / v + k v` at its typical speed `v`: taken one after the other the viscous loss comes first and leaves little of either. Over several
//! swings of other sizes the two are another loss, and they are told by what adds up over many of these.

use crate::GapError;
use crate::choice::Choice;
use crate::climb::{Ascent, Climb};
use crate::fit::Fit;
use crate::search::{Candidate, entries};
use crate::weigh::{FALL, MATERIAL};

/// The loss in the middle, and the two around it.
const MIDDLE: &str = "viscous_friction";
const AROUND: [&str; 2] = ["coulomb_friction", "quadratic_drag"];
/// Windows after which what adds up is seen.
const SWINGS: f64 = 8.0;

impl Climb<'_> {
    /// Puts the two around a viscous loss in its place where they say what it does not.
    pub fn take_apart(&mut self, ascent: &Ascent<'_>) -> Result<(), GapError> {
        let has = |name: &str| self.chosen.iter().position(|c| c.best.effect == name);
        let (Some(at), [None, None]) = (has(MIDDLE), AROUND.map(has)) else { return Ok(()) };
        let Some((less, two)) = self.apart(at) else { return Ok(()) };
        let (search, scale) = (&self.search, self.scale);
        let gain = search.evidence(&two, scale) - search.evidence(&self.current, scale);
        let says_more = || {
            search.is_convincing(ascent.model, &self.current, &two, gain, ascent.window)
                && search.takes_the_place(ascent.model, &two, &self.current, gain, ascent.window)
        };
        // A row shows little of a loss, and many swings all of it.
        let adds_up =
            || two.judged < self.current.judged && search.left_of_gap(ascent.model, &self.current, &two, SWINGS * ascent.window) < FALL;
        if !says_more() && !adds_up() {
            return Ok(());
        }
        (ascent.say)(&format!("  {} and {} say more than {MIDDLE} ({gain:+.1})", AROUND[0], AROUND[1]));
        let gone = self.chosen.remove(at);
        let [here, evidence] = [&less, &two].map(|fit| search.evidence(fit, scale));
        // What else each may be is asked when all names are looked at again.
        for effect in AROUND {
            let itself = Candidate { effect, joint: gone.best.joint, fit: two.clone(), evidence };
            self.chosen.push(Choice::new(search, &[itself], here, gone.nameless, gone.explained, scale));
        }
        self.adds_up |= search.force_between(&self.current, &two)? < MATERIAL;
        self.current = two;
        Ok(())
    }

    /// The fit without the loss in the middle, and with the two around it. None where they cannot be simulated.
    fn apart(&self, at: usize) -> Option<(Fit, Fit)> {
        let (search, hypothesis) = (&self.search, &self.current.hypothesis);
        let entry = *entries(hypothesis).get(at)?;
        let middle = hypothesis.model_at(&hypothesis.x).document.effects.get(entry)?.clone();
        let (damping, joint) = (*middle.parameters.get("damping")?, middle.joint?);
        let j = search.names.iter().position(|n| *n == joint)?;
        let speed = search.views(&self.current, self.scale).ok()?.get(j)?.speed.max(f64::MIN_POSITIVE);
        let less = self.current.without(&search.problem, entry).ok()?;
        let [dry, drag] = [0.5 * damping * speed, 0.5 * damping / speed];
        let two = less.hypothesis.with(AROUND[0], Some(&joint), &[dry]).ok()?.with(AROUND[1], Some(&joint), &[drag]).ok()?;
        let two = search.settle(&Fit::start(&search.problem, two).ok()?, self.scale);
        Some((less, two))
    }
}
