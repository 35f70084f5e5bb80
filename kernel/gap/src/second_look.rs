//! A second look at each name, now that the others are there: what they say as well falls out, and what says more in its place comes in
//! (backward elimination and exchange; Miller 2002, chapter 3).

use crate::GapError;
use crate::choice::Choice;
use crate::climb::{Ascent, Climb, MOST};
use crate::fit::Fit;
use crate::search::{Candidate, entries};
use crate::weigh::CONVINCING;

/// Squares of the errors without a name over those with it, from which on other names in its place need derivatives of their own.
const FAR_OFF: f64 = 2.0;
/// How many that come near a name are asked about with another beside them.
const NEAREST: usize = 2;

impl Climb<'_> {
    /// Looks again at each of several names. The first, if it remains alone, keeps what was said of it when nothing else was there; another that
    /// does is asked about again, since it was chosen beside one that is gone. Where it fails half way, names stand as they did last.
    pub fn look_again(&mut self, ascent: &Ascent<'_>) -> Result<(), GapError> {
        if self.chosen.len() < 2 {
            return Ok(());
        }
        // As many names as are looked for, that fall short, are what comes nearest to something without a name. So would others be in their places,
        // of which each is asked for by a search of its own.
        let fall_short = self.chosen.len() == MOST && self.falls_short(ascent)?;
        (ascent.say)("looking again at each effect beside the others");
        // First what the others say as well: beside a name that falls out, another would be compared with strangers.
        let first = (self.chosen[0].best.effect, self.chosen[0].best.joint);
        self.drop_idle(ascent);
        let outcome = if fall_short { Ok(()) } else { self.look_at_each(first, ascent) };
        // The order of entries is that of the numbers in the hypothesis.
        let document = &self.current.hypothesis.model.document;
        let names: Vec<String> = entries(&self.current.hypothesis).iter().map(|e| document.effects[*e].effect.clone()).collect();
        self.chosen.sort_by_key(|c| names.iter().position(|n| n == c.best.effect).unwrap_or(usize::MAX));
        outcome
    }

    /// Asks of each, and of each two, what else may stand in their place. `first` is what was named first.
    fn look_at_each(&mut self, first: (&str, Option<usize>), ascent: &Ascent<'_>) -> Result<(), GapError> {
        loop {
            let mut at = 0;
            while at < self.chosen.len() && self.chosen.len() > 1 {
                if self.gives_way(at, ascent)? {
                    self.drop_idle(ascent);
                    at = 0;
                } else {
                    at += 1;
                }
            }
            if !self.two_give_way(ascent)? {
                break;
            }
        }
        if let [alone] = self.chosen.as_slice()
            && (alone.best.effect, alone.best.joint) != first
        {
            self.gives_way(0, ascent)?;
        }
        Ok(())
    }

    /// The others, fitted without some of the names, the last of these first; none where they cannot be simulated.
    fn without(&self, those: &[usize]) -> Option<Fit> {
        let all = entries(&self.current.hypothesis);
        let less = those.iter().try_fold(self.current.clone(), |fit, at| fit.without(&self.search.problem, *all.get(*at)?).ok())?;
        self.search.fit_on(less, self.scale).ok()
    }

    /// Takes out names that say no more than the others do, the least of them first.
    fn drop_idle(&mut self, ascent: &Ascent<'_>) {
        while self.chosen.len() > 1 {
            let Self { search, current, scale, .. } = &*self;
            let with = search.evidence(current, *scale);
            let idle = (0..self.chosen.len()).filter_map(|at| {
                // What cannot be simulated without it needs it, and what another name would have to be bent for.
                let less = self.without(&[at]).filter(|less| search.is_shaped(less))?;
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

    /// Asks whether one name of no more numbers says what two of them say together. True where it takes their place. Each of the two was the
    /// likeliest beside the others; that a third says alone what they share shows only where both are out at once.
    fn two_give_way(&mut self, ascent: &Ascent<'_>) -> Result<bool, GapError> {
        let Ascent { model, window, say, .. } = *ascent;
        let (search, current, scale) = (&self.search, &self.current, self.scale);
        if search.many_joints() {
            return Ok(false);
        }
        let with = search.evidence(current, scale);
        for (a, b) in (1..self.chosen.len()).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let Some(less) = self.without(&[a, b]) else { continue };
            let without = search.evidence(&less, scale);
            let numbers = current.hypothesis.x.len() - less.hypothesis.x.len();
            let mut candidates = search.stage_within(&less, scale, numbers, with - without - CONVINCING)?;
            search.settle_rivals(&mut candidates, "", without, scale);
            search.rank(&mut candidates, scale);
            let Some(best) = candidates.first() else { continue };
            let gain = with - best.evidence;
            if !search.is_shaped(&best.fit)
                || search.is_convincing(model, &best.fit, current, gain, window)
                || search.is_needed(model, &best.fit, current, window)
            {
                continue;
            }
            let [one, other] = [a, b].map(|at| self.chosen[at].best.effect);
            say(&format!("  {} alone says what {one} and {other} do ({:+.1})", best.effect, -gain));
            let fit = best.fit.clone();
            let explained = search.explained(&less, &fit);
            let nameless = search.without_name(&less, &fit, best.evidence - without, scale)?;
            let choice = Choice::new(search, &candidates, without, nameless, explained, scale);
            self.current = fit;
            self.chosen.remove(a);
            self.chosen.remove(b);
            self.chosen.push(choice);
            return Ok(true);
        }
        Ok(false)
    }

    /// Asks what else may stand in the place of a name. True where another does, or the same with other numbers.
    fn gives_way(&mut self, at: usize, ascent: &Ascent<'_>) -> Result<bool, GapError> {
        let Ascent { model, window, say, .. } = *ascent;
        let Some(less) = self.without(&[at]) else { return Ok(false) };
        let (search, current, scale) = (&self.search, &self.current, self.scale);
        let (with, without) = (search.evidence(current, scale), search.evidence(&less, scale));
        let Candidate { effect: name, joint, .. } = self.chosen[at].best;
        let mut candidates = search.stage(&less, scale)?;
        if less.squares > FAR_OFF * current.squares {
            search.settle_rivals(&mut candidates, name, without, scale);
        }
        search.rank(&mut candidates, scale);
        search.prefer_simpler(model, (&less, without), &mut candidates, window)?;
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
            let nameless = search.without_name(&less, &settled, best.evidence - without, scale)?;
            let choice = Choice::new(search, &candidates, without, nameless, explained, scale);
            self.current = settled;
            self.chosen.remove(at);
            self.chosen.push(choice);
            return Ok(true);
        }
        // Where it was chosen its numbers may have stood in for what has a name of its own now, and a fit goes downhill only.
        if (best.effect, best.joint) == (name, joint) && best.evidence > with + CONVINCING {
            let settled = search.settle(&best.fit, scale);
            let more = search.evidence(&settled, scale) - with;
            if more > CONVINCING && search.is_shaped(&settled) {
                say(&format!("  other numbers of {name} say more beside the others ({more:+.1})"));
                self.current = settled;
                // Its entry is the last now, as with any that is chosen anew.
                self.chosen[at..].rotate_left(1);
                return Ok(true);
            }
        }
        let explained = search.explained(&less, current);
        let nameless = search.without_name(&less, current, with - without, scale)?;
        let choice = &mut self.chosen[at];
        // What it said when it was found, it said of what the others explain as well.
        choice.nameless = nameless;
        choice.around(search, &candidates, [with, without], scale);
        choice.explained = explained;
        self.both_give_way(at, &candidates, [with, without], ascent)
    }

    /// Asks, of two names, whether both give way: one that says nearly as much in the place of the first may have another beside it that says more
    /// than the two do, or as much by fewer numbers. `candidates` are those for the place of the first.
    fn both_give_way(
        &mut self,
        at: usize,
        candidates: &[Candidate],
        [with, without]: [f64; 2],
        ascent: &Ascent<'_>,
    ) -> Result<bool, GapError> {
        let Ascent { model, window, say, .. } = *ascent;
        let (search, current, scale) = (&self.search, &self.current, self.scale);
        if self.both_gave_way || self.chosen.len() != 2 || search.many_joints() {
            return Ok(false);
        }
        let [one, other] = [at, 1 - at].map(|i| self.chosen[i].best.effect);
        let near =
            |c: &&Candidate| c.effect != one && c.evidence > with - CONVINCING && c.fit.hypothesis.x.len() <= current.hypothesis.x.len();
        for near in candidates.iter().filter(near).take(NEAREST) {
            let Some(beside_it) = entries(&near.fit.hypothesis).first().copied() else { continue };
            let alone = near.fit.without(&search.problem, beside_it).and_then(|fit| search.fit_on(fit, scale));
            // What cannot be simulated alone is left with what is beside it.
            let Ok(alone) = alone else { continue };
            let beside = search.evidence(&alone, scale);
            let mut instead = search.stage_within(&alone, scale, usize::MAX, with - beside - CONVINCING)?;
            search.settle_rivals(&mut instead, other, beside, scale);
            search.rank(&mut instead, scale);
            let Some(best) = instead.first().filter(|best| best.effect != other) else { continue };
            let gain = best.evidence - with;
            let fewer = best.fit.hypothesis.x.len() < current.hypothesis.x.len();
            let says_more = || gain > CONVINCING && search.takes_the_place(model, &best.fit, current, gain, window);
            let is_simpler = || fewer && gain > -CONVINCING && search.left_of_gap(model, current, &best.fit, window) <= 1.0;
            if !search.is_shaped(&best.fit) || !(says_more() || is_simpler()) {
                continue;
            }
            say(&format!("  {} and {} stand in the place of {one} and {other} ({gain:+.1})", near.effect, best.effect));
            let mut first = candidates.to_vec();
            first.retain(|c| (c.effect, c.joint) != (near.effect, near.joint));
            first.insert(0, near.clone());
            let explained = search.explained(&self.base, &best.fit);
            let choice = |candidates: &[Candidate], here: f64, which: usize| {
                Choice::new(search, candidates, here, self.chosen[which].nameless, explained, scale)
            };
            let chosen = vec![choice(&first, without, at), choice(&instead, beside, 1 - at)];
            (self.current, self.chosen, self.both_gave_way) = (best.fit.clone(), chosen, true);
            return Ok(true);
        }
        Ok(false)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod tests {
    use crate::choice::Choice;
    use crate::climb::{Ascent, Climb};
    use crate::fit::Fit;
    use crate::hypothesis::Hypothesis;
    use crate::search::{Candidate, Search};
    use crate::tests::{door, swing, with};
    use crate::trajectory::Trajectory;

    pub type Numbers<'n> = &'n [(&'static str, &'n [(&'static str, f64)])];

    /// Asks something of names that are fitted to what others hide.
    pub fn asked<T>(hidden: Numbers<'_>, named: Numbers<'_>, ask: impl FnOnce(&mut Climb<'_>, &Ascent<'_>) -> T) -> T {
        let model = door();
        let truth = hidden.iter().fold(model.clone(), |model, (effect, numbers)| with(&model, effect, numbers));
        let data: Vec<Trajectory> = (1..3).map(|seed| Trajectory::new(&swing(&truth, 1e-4, seed), &model).unwrap()).collect();
        let search = Search::new(&model, &data).unwrap();
        let base = search.known(&model, 1.0).unwrap();
        let mut climb = Climb::new(search, base);
        climb.scale = 1.0;
        for (effect, numbers) in named {
            let values: Vec<f64> = numbers.iter().map(|n| n.1).collect();
            let more = climb.current.hypothesis.with(effect, Some("hinge"), &values).unwrap();
            climb.current = climb.search.fit_on(Fit::start(&climb.search.problem, more).unwrap(), 1.0).unwrap();
            let candidate = Candidate { effect, joint: Some(0), fit: climb.current.clone(), evidence: 0.0 };
            climb.chosen.push(Choice::new(&climb.search, &[candidate], -1.0, 1e6, 1.0, 1.0));
        }
        ask(&mut climb, &Ascent { model: &model, window: 1.0, seed: 1, say: &|_| {} })
    }

    /// Which names are left once any two of them may give way to one?
    fn left(hidden: Numbers<'_>, named: Numbers<'_>) -> Vec<&'static str> {
        asked(hidden, named, |climb, ascent| {
            climb.two_give_way(ascent).unwrap();
            climb.chosen.iter().map(|c| c.best.effect).collect()
        })
    }

    /// A damping by place took twenty minutes for names that were withdrawn in the end. Four losses leave most of a spring that begins amid the way.
    /// Those that are idle fall out; nothing else is asked.
    #[test]
    fn as_many_names_as_are_looked_for_that_fall_short_are_not_looked_at_again() {
        let spring = [("stiffness", 0.3), ("dissipation", 1e-3), ("position", 0.7), ("side", 1.0)];
        let losses: [(&str, &[(&str, f64)]); 4] = [
            ("viscous_friction", &[("damping", 0.01)]),
            ("coulomb_friction", &[("friction", 0.01)]),
            ("quadratic_drag", &[("drag", 0.01)]),
            ("load_dependent_friction", &[("load_coefficient", 0.01)]),
        ];
        let left = |named: Numbers<'_>| {
            asked(&[("hard_stop", &spring)], named, |climb, ascent| {
                let short = climb.falls_short(ascent).unwrap();
                climb.look_again(ascent).unwrap();
                (short, climb.chosen.iter().map(|c| c.best.effect).collect::<Vec<_>>())
            })
        };
        let (short, names) = left(&losses);
        assert!(short && names.iter().all(|name| losses.iter().any(|loss| loss.0 == *name)), "{names:?}");
        assert_eq!(left(&[("hard_stop", &spring)]), (false, vec!["hard_stop"]));
    }

    /// A sine and a dent together make a spring of themselves.
    #[test]
    fn two_names_that_share_what_one_does_give_way_to_it() {
        let spring = [("stiffness", 0.3), ("rest_position", 0.7)];
        let (tilt, dent) = ([("amplitude", 0.35), ("phase", -0.7)], [("force", 0.01), ("position", 0.2), ("width", 0.3)]);
        assert_eq!(left(&[("joint_spring", &spring)], &[("hinge_tilt", &tilt), ("detent", &dent)]), ["joint_spring"]);
    }

    #[test]
    fn two_names_that_are_there_do_not_give_way_to_one() {
        let (dry, drag) = ([("friction", 0.03)], [("drag", 0.02)]);
        let both: Numbers<'_> = &[("coulomb_friction", &dry), ("quadratic_drag", &drag)];
        assert_eq!(left(both, both), ["coulomb_friction", "quadratic_drag"]);
    }

    /// A play was found before a cable's pull was, with half of its width, and kept that.
    #[test]
    fn numbers_that_were_found_before_other_names_were_there_are_looked_for_again() {
        let ripple = |cycles| [("amplitude", 0.02), ("cycles_per_turn", cycles), ("phase", 0.4)];
        let drag = [("drag", 0.02)];
        let (there, stuck) = (ripple(9.0), ripple(25.0));
        let named: Numbers<'_> = &[("torque_ripple", &stuck), ("quadratic_drag", &drag)];
        asked(&[("torque_ripple", &there), ("quadratic_drag", &drag)], named, |climb, ascent| {
            let value = |climb: &Climb<'_>| {
                let Hypothesis { x, .. } = &climb.current.hypothesis;
                let effects = climb.current.hypothesis.model_at(x).document.effects;
                effects.iter().find(|e| e.effect == "torque_ripple").unwrap().parameters["cycles_per_turn"]
            };
            assert!((value(climb) - 9.0).abs() > 1.0, "the fit is not stuck: {}", value(climb));
            climb.look_again(ascent).unwrap();
            assert!((value(climb) - 9.0).abs() < 0.1, "{}", value(climb));
        });
    }

    /// The first of several names was found where a force without one spoke for all of them, and kept a probability of nothing.
    #[test]
    fn a_name_is_weighed_against_a_force_without_one_beside_the_other_names() {
        let (dry, drag) = ([("friction", 0.03)], [("drag", 0.02)]);
        let both: Numbers<'_> = &[("coulomb_friction", &dry), ("quadratic_drag", &drag)];
        asked(both, both, |climb, ascent| {
            climb.look_again(ascent).unwrap();
            for choice in &climb.chosen {
                assert!(choice.gain > choice.nameless, "{}: {} {}", choice.best.effect, choice.gain, choice.nameless);
            }
        });
    }
}
