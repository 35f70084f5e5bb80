//! Where to begin: everything that the catalogue offers, at every place, compared cheaply and only roughly right. It chooses starts and
//! leaves out the hopeless; what stays is fitted in the simulator.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Vector3};
use rayon::prelude::*;
use sagci_dynamics::effects::{self, Acts, Effect};

use crate::GapError;
use crate::alike;
use crate::fit::{Fit, Problem};
use crate::flexible;
use crate::hypothesis::Hypothesis;
use crate::response::Response;
use crate::search::{Search, some_positions};
use crate::span::{Change, Span};
use crate::starts::{self, JointView, observable, starts};

/// Effects that go on to the simulator, plain ones apart, and starts of one of them.
const SEMIFINALISTS: usize = 12;
const STARTS: usize = 2;
/// Starts of an effect that are fitted to the end in the linear response, and the rounds after which they are chosen and all of them.
const FEW_STARTS: usize = 3;
const FIRST_ROUNDS: usize = 3;
const ROUNDS: usize = 8;
/// An effect that explains less than this share of what the best one explains is not looked at further.
const HOPE: f64 = 0.3;
/// The same for one of few numbers: its fit is soon made, and a richer one that bends where known numbers were led astray imitates it. And for
/// one that resonates: beside its frequency a run shows little of it.
const LITTLE_HOPE: f64 = 0.1;
/// Logarithm of the evidence below which a small force will not be convincing.
pub(crate) const NEAR: f64 = 10.0;
/// Share of the evidence of the best force on any joint that is asked of one on others.
const PUSHED: f64 = 0.1;
/// Effects at a place that are fitted in the linear response where there are many joints.
const FITTED: usize = 24;
/// Most numbers of a plain effect, and the share of the time for which a joint is held, from which on it is asked in the simulator.
const PLAIN: usize = 2;
const STICKS: f64 = 0.02;
/// Share of the momentum below which it stirs no base: the square of it is what a joint feels of that.
const STIRS: f64 = 0.01;
/// Least share of its first start that a number begins with.
const LEAST: f64 = 0.05;

/// An effect at a place, and where a fit of it begins.
#[derive(Clone)]
struct Try {
    effect: &'static dyn Effect,
    joint: Option<usize>,
    values: Vec<f64>,
    hypothesis: Hypothesis,
    /// Its force is a function of the run that the model makes without it.
    linear: bool,
    /// It is a force on its joint, and has few numbers.
    plain: bool,
    /// Of its numbers those that were fitted where one run was looked at.
    numbers: usize,
}

impl Try {
    /// The same in the simulator, where the linear response does not hold. Where dry friction holds the model's joint a good part of the time, no
    /// force shows: a plain one is not to be passed over for a rich one that imitates it. A stop is stiff, and the response makes it soft.
    fn asked_in_a_run(&self, response: &Response) -> Option<Self> {
        let hidden = self.plain && response.sticking() > STICKS;
        let stiff = self.effect.description().name == "hard_stop";
        (hidden || stiff).then(|| Self { linear: false, ..self.clone() })
    }
}

/// A start that was looked at, and what came of it.
struct Begun {
    screened: Screened,
    /// Its fit begins elsewhere, and what that holds is not known: so many of its numbers were fitted.
    unasked: Option<usize>,
    /// Its values, and how one run with it changes the errors, where starts add up.
    run: Option<(Vec<f64>, Change)>,
}

/// An effect at a place after the screens.
#[derive(Clone)]
pub(crate) struct Screened {
    /// Its numbers were fitted in the linear response.
    pub linear: bool,
    pub effect: &'static str,
    pub joint: Option<usize>,
    pub hypothesis: Hypothesis,
    /// Roughly the logarithm of its evidence over that of the base model.
    pub worth: f64,
    /// The same where a fit of it begins, if one run along its own direction has said how far it may come; it is asked of the best start alone.
    pub held: f64,
    /// It is a force on its joint, and has few numbers.
    pub plain: bool,
}

impl Search<'_> {
    /// Where fits in the simulator begin, by effects of so many numbers at the most, the most likely first.
    pub fn screen(&self, base: &Fit, views: &[JointView], scale: f64, most: usize) -> Result<Vec<Screened>, GapError> {
        let runs = self.runs(base)?;
        let responses: Vec<Response> = (0..self.names.len()).map(|j| Response::new(self, base, &runs, j)).collect();
        let span = Span::new(base, scale);
        let pushed = self.pushed(&responses, &span, scale);
        // Where one step after the other is compared, their order cancels.
        let rough = self.problem.roughly();
        let rough_base = rough.errors(&base.hypothesis, &base.hypothesis.x)?;
        // What numbers cost that were fitted (Schwarz 1978). Where one run was looked at along one direction, that is one number.
        let worth = |numbers: usize, gain: f64| 0.5 * gain / (scale * scale) - 0.5 * numbers as f64 * (self.problem.measured() as f64).ln();
        let screened = |t: Try| {
            let response = responses.get(t.joint.unwrap_or(0))?;
            if !t.linear && !t.joint.is_none_or(|j| pushed[j]) {
                return None;
            }
            let (x, worth, held, unasked, change) = if t.linear {
                let (x, gain) = self.by_response(base, response, &span, &t, scale, ROUNDS);
                let worth = worth(t.hypothesis.x.len() - base.hypothesis.x.len(), gain);
                (x, worth, worth, None, None)
            } else {
                let Begin { x, promised, change } = by_run(&rough, &rough_base, &span, base, &t)?;
                let unasked = (x != t.hypothesis.x).then_some(t.numbers);
                let held = if unasked.is_some() { promised } else { fall(&change, &span, 1.0) };
                let change = starts::sum(t.effect.description().name, &[(1.0, &t.values)]).map(|_| change);
                (x, worth(t.numbers, promised), worth(t.numbers, held), unasked, change)
            };
            let hypothesis = Hypothesis { x, ..t.hypothesis };
            let (effect, joint, linear) = (t.effect.description().name, t.joint, t.linear);
            let screened = Screened { linear, effect, joint, hypothesis, worth, held, plain: t.plain };
            worth.is_finite().then_some(Begun { screened, unasked, run: change.map(|c| (t.values, c)) })
        };
        let mut tries = self.tries(base, views);
        tries.retain(|t| t.hypothesis.x.len() - base.hypothesis.x.len() <= most);
        tries.extend(tries.iter().filter_map(|t| t.asked_in_a_run(responses.get(t.joint?)?)).collect::<Vec<_>>());
        if self.many_joints() {
            tries = self.promising(base, tries, &responses, &span);
        }
        let tries = self.hopeful(base, tries, &responses, &span, scale);
        let begun: Vec<_> = tries.into_par_iter().filter_map(&screened).collect();
        let sums = self.sums(base, &begun, &span, scale);
        let begun = begun.into_iter().chain(sums.into_par_iter().filter_map(&screened).collect::<Vec<_>>());
        let mut best: BTreeMap<(&str, Option<usize>), Vec<Begun>> = BTreeMap::new();
        for candidate in begun {
            best.entry((candidate.screened.effect, candidate.screened.joint)).or_default().push(candidate);
        }
        let kept = |mut starts: Vec<Begun>| -> Vec<Screened> {
            starts.sort_by(|a, b| b.screened.worth.total_cmp(&a.screened.worth));
            if let Some(Begun { screened, unasked: Some(numbers), .. }) = starts.first_mut() {
                screened.held = worth(*numbers, fall_at(&rough, &rough_base, &span, &screened.hypothesis));
            }
            // What was fitted in the linear response has one best start; of those that were run the second may lead further.
            let mut kept = [0, 0];
            starts.retain(|Begun { screened: s, .. }| {
                let kept = &mut kept[usize::from(s.linear)];
                *kept += 1;
                *kept <= if s.linear { 1 } else { STARTS }
            });
            starts.into_iter().map(|begun| begun.screened).collect()
        };
        let ranked: Vec<Vec<Screened>> = best.into_values().collect::<Vec<_>>().into_par_iter().map(kept).collect();
        Ok(worth_a_fit(ranked).into_iter().flatten().collect())
    }

    /// All that the catalogue offers and the data can show.
    fn tries(&self, base: &Fit, views: &[JointView]) -> Vec<Try> {
        let mut tries = Vec::new();
        let momenta = self.momenta(base);
        for effect in effects::catalogue() {
            let description = effect.description();
            let linear = description.acts == Acts::Joint && description.parameter("encoder").is_none();
            let mut places: Vec<Option<usize>> = match description.acts {
                Acts::Base => vec![None],
                _ => (0..self.names.len()).map(Some).collect(),
            };
            // One for all is that of the only joint.
            if description.shared && self.names.len() > 1 {
                places.push(None);
            }
            for joint in places {
                let at = joint.unwrap_or(0);
                let named = joint.map(|j| self.names[j].as_str());
                let is_it = |name: &str| name == description.name || alike::is_one_lateness(name, description.name);
                let there = |e: &sagci_model::EffectEntry| is_it(&e.effect) && e.joint.as_deref() == named;
                if joint.is_some_and(|j| self.still[j])
                    || !observable(description.name, self.seen[at])
                    || description.acts == Acts::Losses && !self.wears(base, at)
                    || base.hypothesis.model.document.effects.iter().any(there)
                {
                    continue;
                }
                let JointView { range, .. } = views[at];
                let stirred = |values: &Vec<f64>| effect.sway_values(values).is_none_or(|sway| stirs(&momenta, &sway.direction));
                for values in starts(description.name, &views[at]).into_iter().filter(stirred) {
                    let Ok(hypothesis) = base.hypothesis.with(description.name, named, &values) else { continue };
                    let hypothesis = hypothesis.confined(base.hypothesis.x.len(), range, views[at].way());
                    let plain = linear && hypothesis.x.len() - base.hypothesis.x.len() <= PLAIN;
                    tries.push(Try { effect: *effect, joint, values, hypothesis, linear, plain, numbers: 1 });
                }
            }
        }
        tries
    }

    /// Momenta that each joint alone gives to a base where the data are, per 1 rad/s or m/s, in the world: N s.
    fn momenta(&self, base: &Fit) -> Vec<Vector3<f64>> {
        let Ok(plant) = base.hypothesis.plant(&base.hypothesis.x, &self.problem.limits, self.problem.step) else { return Vec::new() };
        some_positions(self.problem.trajectories, self.names.len()).flat_map(|q| plant.momenta_at(q)).collect()
    }

    /// What an effect's starts add up to, each as often as the data want them together: one axis may be off in four ways at once, and none of
    /// them alone says so.
    fn sums(&self, base: &Fit, begun: &[Begun], span: &Span, scale: f64) -> Vec<Try> {
        type Part<'a> = (&'a Screened, &'a Vec<f64>, &'a Change);
        let mut groups: BTreeMap<(&str, Option<usize>, bool), Vec<Part<'_>>> = BTreeMap::new();
        for Begun { screened, run, .. } in begun {
            if let Some((values, change)) = run {
                let second = effects::find(screened.effect).is_ok_and(|e| e.description().second_word(values));
                groups.entry((screened.effect, screened.joint, second)).or_default().push((screened, values, change));
            }
        }
        let sum = |((name, joint, _), parts): ((&str, Option<usize>, bool), Vec<Part<'_>>)| {
            // Each number's prior, as if measured once more.
            let named = joint.map(|j| self.names[j].as_str());
            let n = base.hypothesis.x.len();
            let prior = |part: &Part<'_>| {
                let start = base.hypothesis.with(name, named, part.1).ok()?;
                let sizes = start.x[n..].iter().zip(&start.fitted[n..]).map(|(x, f)| (x / f.prior[1]).abs());
                Some(scale * sizes.fold(0.0, f64::max))
            };
            let priors: Vec<f64> = parts.iter().map(prior).collect::<Option<_>>()?;
            let n = parts.len();
            let matrix = DMatrix::from_fn(n, n, |i, j| parts[i].2.dot(parts[j].2) + if i == j { priors[i].powi(2) } else { 0.0 });
            let right = DVector::from_fn(n, |i, _| -parts[i].2.dot(&span.errors));
            let shares = Cholesky::new(matrix)?.solve(&right);
            let shared: Vec<(f64, &[f64])> = shares.iter().copied().zip(parts.iter().map(|p| p.1.as_slice())).collect();
            let values = starts::sum(name, &shared)?;
            let hypothesis = base.hypothesis.with(name, named, &values).ok()?;
            Some(Try { effect: effects::find(name).ok()?, joint, values, hypothesis, linear: false, plain: false, numbers: n })
        };
        groups.into_iter().filter(|(_, parts)| parts.len() > 1).filter_map(sum).collect()
    }

    /// Of the linear ones those that already explain most where they begin, their size apart. Fitting each of them on each joint of a
    /// robot's arm is what a screen would mostly do.
    fn promising(&self, base: &Fit, tries: Vec<Try>, responses: &[Response], span: &Span) -> Vec<Try> {
        let gain = |t: &Try| match (t.linear, responses.get(t.joint.unwrap_or(0))) {
            (true, Some(response)) => {
                let change = span.of(response.errors_of(&response.forces(t.effect, &t.values)));
                along(&change, span, reach(base, &t.hypothesis)).1
            }
            _ => f64::INFINITY,
        };
        let gains: Vec<f64> = tries.par_iter().map(gain).collect();
        let mut tries: Vec<(f64, Try)> = gains.into_iter().zip(tries).collect();
        tries.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut begun: BTreeMap<(&str, Option<usize>), usize> = BTreeMap::new();
        tries.retain(|(_, t)| {
            if !t.linear {
                return true;
            }
            let places = begun.len();
            let starts = begun.entry((t.effect.description().name, t.joint)).or_default();
            *starts += 1;
            *starts <= STARTS && (*starts > 1 || places < FITTED)
        });
        tries.into_iter().map(|t| t.1).collect()
    }

    /// Of the many starts of a linear one those that have come furthest after a few rounds, where they have come to.
    fn hopeful(&self, base: &Fit, tries: Vec<Try>, responses: &[Response], span: &Span, scale: f64) -> Vec<Try> {
        let mut starts: BTreeMap<(&str, Option<usize>), usize> = BTreeMap::new();
        let key = |t: &Try| (t.effect.description().name, t.joint);
        for t in tries.iter().filter(|t| t.linear) {
            *starts.entry(key(t)).or_default() += 1;
        }
        let begun = |mut t: Try| match responses.get(t.joint.unwrap_or(0)) {
            Some(response) if t.linear && starts.get(&key(&t)).is_some_and(|count| *count > FEW_STARTS) => {
                let (x, gain) = self.by_response(base, response, span, &t, scale, FIRST_ROUNDS);
                t.hypothesis.x = x;
                (gain, t)
            }
            _ => (f64::INFINITY, t),
        };
        let mut tries: Vec<(f64, Try)> = tries.into_par_iter().map(begun).collect();
        tries.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut kept: BTreeMap<(&str, Option<usize>), usize> = BTreeMap::new();
        tries.retain(|(gain, t)| {
            let before = kept.entry(key(t)).or_default();
            *before += 1;
            gain.is_infinite() || *before <= FEW_STARTS
        });
        tries.into_iter().map(|t| t.1).collect()
    }

    /// Joints on which some force explains a good part of what one on any joint does. A run for each start of each effect on each joint of a
    /// robot's arm is what a search would mostly do.
    fn pushed(&self, responses: &[Response], span: &Span, scale: f64) -> Vec<bool> {
        if !self.many_joints() {
            return vec![true; responses.len()];
        }
        let typical = self.typical_force();
        let told = |(j, response): (usize, &Response)| flexible::nameless(response, span, scale, typical[j]).map_or(0.0, |n| n.evidence);
        let evidence: Vec<f64> = responses.par_iter().enumerate().map(told).collect();
        let most = evidence.iter().copied().fold(0.0, f64::max);
        evidence.iter().map(|e| *e >= PUSHED * most).collect()
    }

    /// Fits an effect's numbers in the linear response: where it ends, and how much the sum of squares falls.
    fn by_response(&self, base: &Fit, response: &Response, span: &Span, t: &Try, scale: f64, rounds: usize) -> (Vec<f64>, f64) {
        let first = base.hypothesis.x.len();
        let fitted = &t.hypothesis.fitted[first..];
        let parameters = t.effect.description().parameters;
        let place = |name: &str| parameters.iter().position(|p| p.name == name);
        let places: Vec<(usize, Option<usize>)> =
            fitted.iter().filter_map(|f| f.knob.parameter()).filter_map(|(name, of)| Some((place(name)?, of.and_then(place)))).collect();
        let forces = |x: &Vec<f64>| {
            let mut theta = t.values.clone();
            for ((&(place, of), f), x) in places.iter().zip(fitted).zip(x) {
                theta[place] = f.value(*x) * of.map_or(1.0, |of| theta[of]);
            }
            response.forces(t.effect, &theta)
        };
        let errors = |points: &[Vec<f64>]| {
            let changes = response.errors_of_each(&points.iter().map(forces).collect::<Vec<_>>());
            changes.into_iter().map(|change| span.errors.plus(&span.of(change))).collect()
        };
        let x = t.hypothesis.x[first..].to_vec();
        let (x, squares) = crate::fit::minimise(&errors, fitted, x, scale, rounds);
        let mut all = t.hypothesis.x.clone();
        all[first..].copy_from_slice(&x);
        (all, span.errors.norm_squared() - squares)
    }

    /// Has the joint a loss that heat can change?
    fn wears(&self, fit: &Fit, joint: usize) -> bool {
        let model = &fit.hypothesis.model;
        let j = &model.joints[self.joints[joint]];
        let named = |e: &sagci_model::EffectEntry| {
            e.joint.as_deref() == Some(j.name.as_str()) && effects::find(&e.effect).is_ok_and(|e| e.description().wears)
        };
        j.damping > 0.0 || j.friction > 0.0 || model.document.effects.iter().any(named)
    }
}

/// Of effects, each with its starts, those that go on to the simulator, the most promising first.
///
/// Small forces act linearly: what the screen sees far below the base model's evidence will not be convincing. What one run promises along its
/// own direction may not hold, least where a model sticks, so those that were fitted are not asked to keep up with it, and none is asked to keep
/// up with more than what is there already where a fit begins.
fn worth_a_fit(mut ranked: Vec<Vec<Screened>>) -> Vec<Vec<Screened>> {
    ranked.sort_by(|a, b| b[0].worth.total_cmp(&a[0].worth));
    let mut count = 0;
    ranked.retain(|r| {
        count += 1;
        count <= SEMIFINALISTS || r[0].plain
    });
    let most = |linear: bool| {
        let held = ranked.iter().filter(|r| r[0].linear == linear).map(|r| r[0].worth.min(r[0].held));
        held.fold(0.0, f64::max)
    };
    let most = [most(false), most(true)];
    let mut place = 0;
    ranked.retain(|r| {
        place += 1;
        let first = &r[0];
        let hope = if first.plain || starts::resonates(first.effect) { LITTLE_HOPE } else { HOPE };
        (first.worth > -NEAR || !first.linear) && (place <= 4 || first.worth > hope * most[usize::from(first.linear)])
    });
    ranked
}

/// Does motion with such momenta stir a base that gives way along a direction? Across a slide, or along a hinge, nothing comes of it.
fn stirs(momenta: &[Vector3<f64>], direction: &Vector3<f64>) -> bool {
    let most = |size: &dyn Fn(&Vector3<f64>) -> f64| momenta.iter().map(size).fold(0.0, f64::max);
    most(&|p| p.dot(direction).abs()) > STIRS * most(&|p| p.norm())
}

/// Where a fit begins, after one run of the simulator.
struct Begin {
    x: Vec<f64>,
    /// Fall of the sum of squares along the change that the effect makes in that run.
    promised: f64,
    change: Change,
}

/// One run of the simulator with the effect where it starts, beside the `errors` of the base model by the same steps.
fn by_run(problem: &Problem<'_>, errors: &DVector<f64>, span: &Span, base: &Fit, t: &Try) -> Option<Begin> {
    let hypothesis = &t.hypothesis;
    let change = span.of(problem.errors(hypothesis, &hypothesis.x).ok()? - errors);
    let (share, promised) = along(&change, span, reach(base, hypothesis));
    let mut x = hypothesis.x.clone();
    // A number that begins near zero begins where the data want it, and so does one that is alone, unless more of it is less.
    if let Some(size) = size(base, hypothesis) {
        x[size] *= share;
    } else if let [alone] = &mut x[base.hypothesis.x.len()..]
        && share > 0.0
        && !t.effect.description().parameters.iter().any(|p| p.bounding)
    {
        *alone = (*alone + share.max(LEAST).ln()).max(hypothesis.fitted[base.hypothesis.x.len()].bounds[0]);
    }
    promised.is_finite().then_some(Begin { x, promised, change })
}

/// By how much the sum of squares falls where a hypothesis stands, beside the `errors` of the base model by the same steps.
fn fall_at(problem: &Problem<'_>, errors: &DVector<f64>, span: &Span, hypothesis: &Hypothesis) -> f64 {
    let there = problem.errors(hypothesis, &hypothesis.x);
    there.map_or(f64::NEG_INFINITY, |there| fall(&span.of(there - errors), span, 1.0))
}

/// The first of an effect's numbers that is not zero, if its force is linear in that one.
fn size(base: &Fit, hypothesis: &Hypothesis) -> Option<usize> {
    let added = base.hypothesis.x.len()..hypothesis.x.len();
    let linear = added.clone().all(|i| !hypothesis.fitted[i].logarithmic);
    added.clone().find(|i| linear && hypothesis.x[*i] != 0.0)
}

/// How many times what it begins with an effect may be: both ways to its bounds where it is linear, and not far in its own direction where it
/// is not.
fn reach(base: &Fit, hypothesis: &Hypothesis) -> [f64; 2] {
    let Some(size) = size(base, hypothesis) else { return [0.0, 2.0] };
    let ends = hypothesis.fitted[size].bounds.map(|b| b / hypothesis.x[size]);
    [ends[0].min(ends[1]), ends[0].max(ends[1])]
}

/// How often a change brings the sum of squares down most, and by how much it falls; minus infinity where nothing changes.
fn along(change: &Change, span: &Span, [least, most]: [f64; 2]) -> (f64, f64) {
    let size = change.norm_squared();
    if size.is_nan() || size <= 0.0 || least.is_nan() || most.is_nan() {
        return (1.0, f64::NEG_INFINITY);
    }
    let share = (-change.dot(&span.errors) / size).max(least).min(most);
    (share, fall(change, span, share))
}

/// By how much the sum of squares falls with so many times a change.
fn fall(change: &Change, span: &Span, share: f64) -> f64 {
    -share * (2.0 * change.dot(&span.errors) + share * change.norm_squared())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::tests::{door, swing, with};
    use crate::trajectory::Trajectory;

    fn screened(effect: &'static str, linear: bool, plain: bool, worth: f64) -> Vec<Screened> {
        vec![Screened { linear, effect, joint: Some(0), hypothesis: Hypothesis::known(&door(), &[]), worth, held: worth, plain }]
    }

    fn kept(all: Vec<Vec<Screened>>) -> Vec<&'static str> {
        worth_a_fit(all).iter().map(|r| r[0].effect).collect()
    }

    #[test]
    fn what_one_run_promises_does_not_silence_what_was_fitted() {
        // A door that sticks: a skew shakes it loose, and promises more than it can keep.
        let friction = ["viscous_friction", "stribeck_friction", "asymmetric_friction", "latch", "position_dependent_friction"];
        let mut all = vec![screened("clock_skew", false, false, 2320.0)];
        all.extend(friction.into_iter().zip([275.0, 261.0, 257.0, 246.0, 243.0]).map(|(e, worth)| screened(e, true, false, worth)));
        all.push(screened("torque_bias", true, true, 20.0));
        let kept = kept(all);
        assert_eq!(kept[1..], friction, "{kept:?}");
    }

    /// A run a quarter beside a sharp mode promises a small part of what a fit finds.
    #[test]
    fn a_resonance_is_not_passed_over_for_what_shows_at_any_frequency() {
        let all = [
            ("clock_skew", 450.0),
            ("payload", 440.0),
            ("transport_delay", 400.0),
            ("torque_gain", 320.0),
            ("joint_elasticity", 130.0),
            ("backlash", 87.0),
        ];
        let kept = worth_a_fit(all.iter().map(|(name, worth)| screened(name, false, false, *worth)).collect());
        let names: Vec<&str> = kept.iter().map(|r| r[0].effect).collect();
        assert_eq!(names, ["clock_skew", "payload", "transport_delay", "torque_gain", "joint_elasticity"]);
    }

    /// A servo whose centre of mass was led astray by a bias: a dozen others bend to what is left.
    #[test]
    fn a_plain_force_needs_no_place_among_the_first() {
        let rich = effects::catalogue().iter().map(|e| e.description().name).filter(|name| *name != "torque_bias").take(14);
        let mut all: Vec<_> = rich.enumerate().map(|(i, name)| screened(name, true, false, 900.0 - 10.0 * i as f64)).collect();
        all.push(screened("torque_bias", true, true, 250.0));
        let kept = kept(all);
        assert!(kept.len() == SEMIFINALISTS + 1 && kept.last() == Some(&"torque_bias"), "{kept:?}");
    }

    #[test]
    fn a_plain_force_is_not_silenced_by_rich_ones_that_bend_to_it() {
        // A pendulum whose friction was led astray by a bias.
        let rich = ["detent", "latch", "cable_hysteresis", "air_suction", "presliding_hysteresis"];
        let mut all: Vec<_> =
            rich.into_iter().zip([2164.0, 1275.0, 901.0, 783.0, 754.0]).map(|(e, w)| screened(e, true, false, w)).collect();
        all.push(screened("hard_stop", true, false, 556.0));
        all.push(screened("torque_bias", true, true, 504.0));
        let kept = kept(all);
        assert!(kept.contains(&"torque_bias") && !kept.contains(&"hard_stop"), "{kept:?}");
    }

    /// What one run promises of an effect, on a door with another that is hidden, what comes of it where a fit begins, and with which number.
    fn begun(hidden: (&str, &[(&str, f64)]), effect: &'static str, values: &[f64]) -> [f64; 3] {
        let mut log = swing(&with(&door(), hidden.0, hidden.1), 1e-4, 1);
        log.joints[0].command = log.joints[0].effort.clone().map(|sent| (sagci_recording::CommandKind::Effort, sent));
        let logs = [Trajectory::new(&log, &door()).unwrap()];
        let search = Search::new(&door(), &logs).unwrap();
        let base = search.known(&door(), 1.0).unwrap();
        let hypothesis = base.hypothesis.with(effect, Some("hinge"), values).unwrap();
        let effect = effects::find(effect).unwrap();
        let t = Try { effect, joint: Some(0), values: values.to_vec(), hypothesis, linear: false, plain: false, numbers: 1 };
        let rough = search.problem.roughly();
        let errors = rough.errors(&base.hypothesis, &base.hypothesis.x).unwrap();
        let span = Span::new(&base, 1.0);
        let Begin { x, promised, .. } = by_run(&rough, &errors, &span, &base, &t).unwrap();
        let first = x.last().unwrap().exp();
        [promised, fall_at(&rough, &errors, &span, &Hypothesis { x, ..t.hypothesis }), first]
    }

    /// A mode near a link's frequency: with three times the rotor's inertia that there is a fit is lost.
    #[test]
    fn a_number_alone_begins_as_large_as_one_run_says_that_it_is() {
        let [promised, held, first] = begun(("armature_inertia", &[("inertia", 0.002)]), "armature_inertia", &[0.02]);
        assert!((0.001..0.004).contains(&first) && held > 0.5 * promised, "{first}");
    }

    /// A drive that clips less than the first start says does so at a higher limit.
    #[test]
    fn a_limit_is_not_lowered_because_less_of_it_shows() {
        let [_, _, first] = begun(("actuator_saturation", &[("limit", 0.5)]), "actuator_saturation", &[0.1]);
        assert!(first >= 0.1 - 1e-9, "{first}");
    }

    /// A small part of what a low limit changes looks like anything.
    #[test]
    fn what_does_not_come_of_a_promise_is_told_from_it() {
        let [promised, held, _] = begun(("actuator_saturation", &[("limit", 0.5)]), "actuator_saturation", &[0.1]);
        assert!(promised > 0.0 && held < 0.0, "{promised} {held}");
    }

    #[test]
    fn a_promise_that_is_not_kept_silences_no_other() {
        // A planar arm with a delay: a limit of the drive that a run makes 65,000 times less likely.
        let mut all = vec![screened("actuator_saturation", false, false, 495.0)];
        all[0][0].held = -65_000.0;
        let others = ["actuator_lag", "torque_gain", "joint_elasticity", "encoder_offset", "backlash"];
        all.extend(others.into_iter().zip([140.0, 108.0, 93.0, 54.0, 20.0]).map(|(e, worth)| screened(e, false, false, worth)));
        let kept = kept(all);
        assert!(kept.contains(&"actuator_saturation") && kept.contains(&"encoder_offset") && !kept.contains(&"backlash"), "{kept:?}");
    }

    /// A run for each of a mode's starts along directions in which nothing moves was a fourteenth of a search on a slide.
    #[test]
    fn a_base_is_not_asked_to_swing_where_nothing_stirs_it() {
        let logs = [Trajectory::new(&swing(&door(), 1e-4, 1), &door()).unwrap()];
        let search = Search::new(&door(), &logs).unwrap();
        let base = search.known(&door(), 1.0).unwrap();
        let tries = search.tries(&base, &search.views(&base, 1.0).unwrap());
        let mut along: Vec<f64> = tries.iter().filter(|t| t.effect.description().name == "unmodelled_mode").map(|t| t.values[3]).collect();
        along.sort_by(f64::total_cmp);
        along.dedup();
        // The hinge stands upright: the door moves along x and y.
        assert_eq!(along, [0.0, 1.0]);
    }

    /// What stamps positions late may stamp efforts late, too, and a part of that looks like a drive's delay.
    #[test]
    fn a_lateness_is_not_looked_for_beside_another() {
        let mut log = swing(&door(), 1e-4, 1);
        log.joints[0].command = log.joints[0].effort.clone().map(|sent| (sagci_recording::CommandKind::Effort, sent));
        let logs = [Trajectory::new(&log, &door()).unwrap()];
        let search = Search::new(&door(), &logs).unwrap();
        let base = search.known(&door(), 1.0).unwrap();
        let views = search.views(&base, 1.0).unwrap();
        let sought = |base: &Fit, name: &str| search.tries(base, &views).iter().any(|t| t.effect.description().name == name);
        assert!(sought(&base, "transport_delay") && sought(&base, "clock_skew"));
        let late = base.hypothesis.with("clock_skew", Some("hinge"), &[0.013]).unwrap();
        let late = Fit::start(&search.problem, late).unwrap();
        assert!(!sought(&late, "transport_delay") && !sought(&late, "clock_skew") && sought(&late, "actuator_lag"));
    }
}
