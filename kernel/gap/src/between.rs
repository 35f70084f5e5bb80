//! Two effects that together look like one between them.
//!
//! Over the speeds of one swing dry friction and drag, `c sign(v) + k v |v|`, are nearly a viscous loss `b v`, with `b = c / v + k v` at its typical
//! speed `v`: taken one after the other that loss comes first and leaves little of either. Over several swings of other sizes the two are another
//! loss, and they are told by what adds up over many of these.
//!
//! A cable whose loop is too short to be seen is dry friction, damping and a spring. That friction is another one way than the other shifts where the
//! spring rests, and a name that has nothing to do with it, beside the cable, takes what that leaves.

use crate::GapError;
use crate::choice::Choice;
use crate::climb::{Ascent, Climb};
use crate::fit::Fit;
use crate::search::{Candidate, entries};
use crate::weigh::{FALL, MATERIAL};

/// A name between two others.
struct Middle {
    name: &'static str,
    around: [&'static str; 2],
    /// A length that positions do not tell where the name does no more than stand for the two. It then leaves what they say, which other names may
    /// have taken: those are asked.
    unseen_length: Option<&'static str>,
    /// Where the two begin, by its values and a typical speed.
    begin: fn(&[f64], f64) -> Option<[Vec<f64>; 2]>,
}

const MIDDLES: [Middle; 2] = [
    Middle {
        name: "viscous_friction",
        around: ["coulomb_friction", "quadratic_drag"],
        unseen_length: None,
        begin: |values, speed| match *values {
            [damping] => Some([vec![0.5 * damping * speed], vec![0.5 * damping / speed]]),
            _ => None,
        },
    },
    Middle {
        name: "cable_hysteresis",
        around: ["asymmetric_friction", "joint_spring"],
        unseen_length: Some("loop_length"),
        begin: |values, _| match *values {
            [stiffness, rest, force, _, damping] => Some([vec![force, force, damping, damping], vec![stiffness, rest]]),
            _ => None,
        },
    },
];
/// Windows after which what adds up is seen.
const SWINGS: f64 = 8.0;

/// Two names in the place of one.
struct Apart {
    /// The fit without the one, and that with the two.
    less: Fit,
    two: Fit,
    /// Other names that the two need no longer, by their places among the others, the last first: they took what a name that only stands for the two
    /// leaves.
    needless: Vec<usize>,
}

impl Climb<'_> {
    /// Puts the two around a name in its place where they say what it does not.
    pub fn take_apart(&mut self, ascent: &Ascent<'_>) -> Result<(), GapError> {
        for middle in &MIDDLES {
            self.take_one_apart(middle, ascent)?;
        }
        Ok(())
    }

    fn take_one_apart(&mut self, middle: &Middle, ascent: &Ascent<'_>) -> Result<(), GapError> {
        let has = |name: &str| self.chosen.iter().position(|c| c.best.effect == name);
        let (Some(at), [None, None]) = (has(middle.name), middle.around.map(has)) else { return Ok(()) };
        let Some(Apart { less, two, needless }) = self.apart(middle, at) else { return Ok(()) };
        let (search, scale) = (&self.search, self.scale);
        let gain = search.evidence(&two, scale) - search.evidence(&self.current, scale);
        let says_more = || {
            search.is_convincing(ascent.model, &self.current, &two, gain, ascent.window)
                && search.takes_the_place(ascent.model, &two, &self.current, gain, ascent.window)
        };
        // A row shows little of a loss, and many swings all of it.
        let adds_up =
            || two.judged < self.current.judged && search.left_of_gap(ascent.model, &self.current, &two, SWINGS * ascent.window) < FALL;
        // Fewer names that say as much need no more.
        if !(!needless.is_empty() && gain > 0.0 || says_more() || adds_up()) {
            return Ok(());
        }
        (ascent.say)(&format!("  {} say more than {} ({gain:+.1})", middle.around.join(" and "), middle.name));
        let gone = self.chosen.remove(at);
        for i in needless {
            (ascent.say)(&format!("  and need no {}", self.chosen.remove(i).best.effect));
        }
        let [here, evidence] = [&less, &two].map(|fit| search.evidence(fit, scale));
        // What else each may be is asked when all names are looked at again.
        for effect in middle.around {
            let itself = Candidate { effect, joint: gone.best.joint, fit: two.clone(), evidence };
            self.chosen.push(Choice::new(search, &[itself], here, gone.nameless, gone.explained, scale));
        }
        self.adds_up |= search.force_between(&self.current, &two)? < MATERIAL;
        self.current = two;
        Ok(())
    }

    /// A name in the middle taken apart. None where it stands for itself, or the two cannot be simulated.
    fn apart(&self, middle: &Middle, at: usize) -> Option<Apart> {
        let (search, hypothesis) = (&self.search, &self.current.hypothesis);
        let entry = *entries(hypothesis).get(at)?;
        let itself = hypothesis.model_at(&hypothesis.x).document.effects.get(entry)?.clone();
        let (_, values) = sagci_dynamics::effects::parameters_of(&itself).ok()?;
        let joint = itself.joint.clone()?;
        let j = search.names.iter().position(|n| *n == joint)?;
        let is_seen = |name: &str| itself.parameters.get(name).is_none_or(|length| *length > search.problem.disturbance.position[j]);
        if middle.unseen_length.is_some_and(is_seen) {
            return None;
        }
        let speed = search.views(&self.current, self.scale).ok()?.get(j)?.speed.max(f64::MIN_POSITIVE);
        let [first, second] = (middle.begin)(&values, speed)?;
        let less = self.current.without(&search.problem, entry).ok()?;
        let [one, other] = middle.around;
        let two = less.hypothesis.with(one, Some(&joint), &first).ok()?.with(other, Some(&joint), &second).ok()?;
        let mut two = search.settle(&Fit::start(&search.problem, two).ok()?, self.scale);
        let mut needless = Vec::new();
        // Two losses in the place of one say nothing of other names, which have yet to find the numbers that suit the two.
        let asked = if middle.unseen_length.is_some() { self.chosen.len() - 1 } else { 0 };
        for i in (0..asked).rev() {
            let Ok(without) = two.without(&search.problem, entries(&two.hypothesis)[i]) else { continue };
            let without = search.settle(&without, self.scale);
            if search.evidence(&without, self.scale) > search.evidence(&two, self.scale) {
                two = without;
                needless.push(i);
            }
        }
        Some(Apart { less, two, needless })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::second_look::tests::{Numbers, asked};

    /// Names, once any between two others may be taken apart.
    fn apart(hidden: Numbers<'_>, named: Numbers<'_>) -> Vec<&'static str> {
        asked(hidden, named, |climb, ascent| {
            climb.take_apart(ascent).unwrap();
            climb.chosen.iter().map(|c| c.best.effect).collect()
        })
    }

    /// A cable without a loop, and a damper for what it left of a damping that was another one way than the other.
    #[test]
    fn a_cable_whose_loop_nobody_sees_is_a_friction_and_a_spring() {
        let friction = [("friction_positive", 0.02), ("friction_negative", 0.04), ("damping_positive", 0.01), ("damping_negative", 0.04)];
        let spring = [("stiffness", 0.2), ("rest_position", 0.3)];
        let cable = [("stiffness", 0.2), ("rest_position", 0.35), ("loop_force", 0.03), ("loop_length", 1e-6), ("damping", 0.03)];
        let damper = [("damping", 0.02), ("position", 0.9), ("stiffness", 0.01)];
        let both: Numbers<'_> = &[("asymmetric_friction", &friction), ("joint_spring", &spring)];
        assert_eq!(apart(both, &[("cable_hysteresis", &cable), ("soft_close_damper", &damper)]), ["asymmetric_friction", "joint_spring"]);
    }

    #[test]
    fn a_cable_with_a_loop_is_one() {
        let cable = [("stiffness", 0.2), ("rest_position", 0.35), ("loop_force", 0.06), ("loop_length", 0.05), ("damping", 0.03)];
        let cable: Numbers<'_> = &[("cable_hysteresis", &cable)];
        assert_eq!(apart(cable, cable), ["cable_hysteresis"]);
    }

    #[test]
    fn a_loss_between_dry_friction_and_drag_is_taken_apart() {
        let (dry, drag) = ([("friction", 0.03)], [("drag", 0.03)]);
        let both: Numbers<'_> = &[("coulomb_friction", &dry), ("quadratic_drag", &drag)];
        assert_eq!(apart(both, &[("viscous_friction", &[("damping", 0.06)])]), ["coulomb_friction", "quadratic_drag"]);
    }
}
