//! The workflow: known numbers first, then names, one after the other, then a second look at each.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use rayon::prelude::*;
use sagci_dynamics::effects::{self, Acts};
use sagci_model::{Evidence, JointKind, ObjectModel};
use sagci_recording::Log;

use crate::GapError;
use crate::fit::{Fit, Problem};
use crate::flexible::{self, Nameless};
use crate::hypothesis::{Hypothesis, Knob};
use crate::map;
use crate::noise;
use crate::observer::Disturbance;
use crate::plots::{self, PlotData, Predicted};
use crate::report::{EffectEvidence, Gap, Gaps, JointGap, NamedEffect, Reason, Report, SCHEMA, Unexplained, Value, Verdict};
use crate::response::Response;
use crate::search::{Candidate, FLOOR, Search, entries};
use crate::trajectory::Trajectory;
use crate::windows::{Figures, Smoothed, likely_noise};

/// What may be chosen.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Length of the windows over which positions are predicted, s.
    pub window: f64,
    /// Seed of every random choice.
    pub seed: u64,
    /// Hears what is being done.
    pub progress: Option<&'a (dyn Fn(&str) + Sync)>,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self { window: 1.0, seed: 1, progress: None }
    }
}

impl std::fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Options").field("window", &self.window).field("seed", &self.seed).finish_non_exhaustive()
    }
}

/// The answer, and the model with what was found in it.
#[derive(Debug, Clone)]
pub struct Found {
    /// The answer.
    pub report: Report,
    /// The model, its known numbers refitted, with the effects as entries of its document.
    pub model: ObjectModel,
    /// What the report's page draws.
    pub figures: PlotData,
}

/// Most effects that are looked for at once.
const MOST: usize = 4;
/// Logarithm of the Bayes factor that an effect needs.
const CONVINCING: f64 = 6.0;
/// Names whose evidence is within this of the best one's cannot be told from it.
const ALIKE: f64 = 3.0;
/// Most by which the noise of accelerations may exceed its floor while names are sought: a model that is not trusted explains nothing.
const MOST_NOISE: f64 = 8.0;
/// Half a fall of squared errors, in units of their noise, that is no chance.
const SEEN: f64 = 3.0;
/// Longest step of the last fits and of predictions, s.
pub(crate) const FINE: f64 = 1e-3;
/// Share of the lacking force below which nobody minds that it has no name.
const NEGLIGIBLE: f64 = 0.02;
/// Quantile of the normal distribution for intervals of 95 %.
const NORMAL_95: f64 = 1.959_964;

/// Finds what the model lacks.
///
/// # Errors
/// Data that do not fit the model or hold too little; a model that cannot be simulated.
pub fn find(model: &ObjectModel, train: &[Log], held_out: &[Log], options: &Options<'_>) -> Result<Found, GapError> {
    let clock = Instant::now();
    let say = |text: &str| {
        if let Some(progress) = options.progress {
            progress(text);
        }
    };
    let mut notes: Vec<String> =
        train.iter().chain(held_out).flat_map(|l| &l.notes).map(|n| format!("{}: {}", n.place, n.message)).collect();
    // What holds for all recordings is said once.
    let mut said = BTreeSet::new();
    notes.retain(|n| said.insert(n.clone()));
    let (train, held_out) = set_aside(train, held_out, &mut notes);
    let trajectories: Vec<Trajectory> = train.iter().map(|l| Trajectory::new(l, model)).collect::<Result<_, _>>()?;
    let unseen: Vec<Trajectory> = held_out.iter().map(|l| Trajectory::new(l, model)).collect::<Result<_, _>>()?;
    let mut search = Search::new(model, &trajectories)?;
    search.check_motion(&mut notes)?;

    say("refitting what the model knows");
    let mut base = search.known(model, 1.0)?;
    let given = base.clone();
    let places = map::places(&search, &base, search.scale(&base).min(2.0))?;

    // One name after the other.
    let mut current = base.clone();
    let mut scale = search.scale(&base);
    let mut chosen: Vec<Choice> = Vec::new();
    let mut lost: Vec<(&str, f64)> = Vec::new();
    let mut nameless_won = false;
    while chosen.len() < MOST {
        say(&format!("looking for {} missing effect", if chosen.is_empty() { "a" } else { "another" }));
        let mut candidates = search.stage(&current, scale)?;
        let Some(first) = candidates.first() else { break };
        let mut next = search.scale(&first.fit);
        if let Some(noise) = search.likelier_noise(&first.fit)? {
            // With the noise as it is, everything is weighed anew.
            search = search.with_noise(noise);
            base = search.refit(&base, next)?;
            current = if chosen.is_empty() { base.clone() } else { search.refit(&current, next)? };
            candidates.truncate(6);
            candidates = candidates
                .into_par_iter()
                .map(|c| Ok(Candidate { fit: search.refit(&c.fit, next)?, ..c }))
                .collect::<Result<_, GapError>>()?;
            next = candidates.iter().map(|c| search.scale(&c.fit)).fold(f64::INFINITY, f64::min);
        }
        scale = next;
        search.rank(&mut candidates, scale);
        let here = search.evidence(&current, scale);
        let Some(best) = candidates.first() else { break };
        let gain = best.evidence - here;
        say(&format!("  most likely: {}", best_three(&candidates, here)));
        let force = search.force_between(&current, &best.fit)?;
        let nameless = search.nameless(&current, scale)?;
        let noise = &search.problem.disturbance;
        say(&format!(
            "  force {:.3} %, scale {scale:.3}, floor x{:.2}, position noise {:.2e}, effort noise {:.2e}, without name {:?}",
            100.0 * force,
            noise.acceleration[0] / search.floor[0],
            noise.position[0],
            noise.effort[0],
            nameless.as_ref().map(|(_, n)| (n.evidence, n.over)),
        ));
        let without_name = nameless.as_ref().map_or(0.0, |(_, n)| n.evidence);
        if gain < CONVINCING {
            nameless_won = without_name > 2.0 * CONVINCING && gain < without_name;
            lost = candidates.iter().map(|c| (c.effect, c.evidence - here)).collect();
            break;
        }
        let explained = search.explained(&current, &best.fit, scale);
        current = best.fit.clone();
        chosen.push(Choice::new(&candidates, here, without_name, explained));
    }

    // A second look at each, now that the others are there.
    if chosen.len() > 1 {
        say("looking again at each effect beside the others");
        let mut at = 0;
        while at < chosen.len() && chosen.len() > 1 {
            let all = entries(&current.hypothesis);
            let less = search.refit(&Fit::start(&search.problem, current.hypothesis.without(all[at]))?, scale)?;
            let (with, without) = (search.evidence(&current, scale), search.evidence(&less, scale));
            if with - without < CONVINCING {
                current = less;
                chosen.remove(at);
                at = 0;
                continue;
            }
            let mut candidates = search.stage(&less, scale)?;
            search.rank(&mut candidates, scale);
            let name = chosen[at].best.effect;
            let Some(best) = candidates.first() else { break };
            if best.effect != name && best.evidence > with + 1.0 {
                current = best.fit.clone();
                let choice = Choice::new(&candidates, without, chosen[at].nameless, search.explained(&less, &current, scale));
                chosen.remove(at);
                chosen.push(choice);
                at = 0;
                continue;
            }
            chosen[at].around(&candidates, with, without);
            chosen[at].explained = search.explained(&less, &current, scale);
            at += 1;
        }
        // The order of entries is that of the numbers in the hypothesis.
        let order = entries(&current.hypothesis);
        let names: Vec<String> = order.iter().map(|e| current.hypothesis.model.document.effects[*e].effect.clone()).collect();
        chosen.sort_by_key(|c| names.iter().position(|n| n == c.best.effect).unwrap_or(usize::MAX));
    }

    say("fitting to the end");
    search.finer();
    let restart = |fit: &Fit| Fit::start(&search.problem, fit.hypothesis.clone())?.finish(&search.problem, scale, None);
    current = restart(&current)?;
    let refitted = if chosen.is_empty() { current.clone() } else { restart(&base)? };
    scale = search.scale(&current);

    // Data that no fit and no choice has seen have a veto, once, over names that are settled: what they contradict is not there.
    let mut contradicted: Vec<Reason> = Vec::new();
    let mut confirmed: Vec<Unseen> = Vec::new();
    while !unseen.is_empty() && !chosen.is_empty() {
        confirmed = search.on_unseen(&current, &refitted, &unseen, scale)?;
        let Some(worst) =
            (0..confirmed.len()).filter(|i| confirmed[*i].contradicts()).min_by(|a, b| confirmed[*a].fall.total_cmp(&confirmed[*b].fall))
        else {
            break;
        };
        let all = entries(&current.hypothesis);
        let gone = chosen.remove(worst);
        contradicted.push(confirmed[worst].reason(gone.best.effect));
        current = if chosen.is_empty() {
            refitted.clone()
        } else {
            search.refit(&Fit::start(&search.problem, current.hypothesis.without(all[worst]))?, scale)?
        };
        scale = search.scale(&current);
        confirmed.clear();
    }
    let mut remainder = search.nameless(&current, scale)?;
    // Names that explain less than a force without a name does are that force's nearest neighbours, no more.
    let nameless = search.nameless(&refitted, scale)?;
    if let (Some(left), Some((joint, all))) = (&remainder, nameless)
        && !chosen.is_empty()
        && left.1.evidence > 2.0 * CONVINCING
        && all.evidence > search.evidence(&current, scale) - search.evidence(&refitted, scale)
    {
        for gone in chosen.drain(..) {
            let reason = "comes near, but a force without a name fits better".to_owned();
            contradicted.push(Reason { name: gone.best.effect.into(), reason });
        }
        remainder = Some((joint, all));
        current = refitted.clone();
    }

    let covariance = current.covariance(scale);
    let lacking: f64 = search.explained_force(&current, &refitted)?;
    let mut effects_found = Vec::new();
    let final_entries = entries(&current.hypothesis);
    for (i, choice) in chosen.iter().enumerate() {
        let Some(entry) = final_entries.get(i).copied() else { continue };
        let (held_out, agrees) = confirmed.get(i).map_or((None, false), |u| (Some(u.fall.min(1e12)), u.fall > SEEN));
        effects_found.push(search.describe(&current, entry, choice, covariance.as_ref(), held_out, agrees));
    }

    // What is left.
    let typical = search.typical_force();
    let unexplained = remainder.and_then(|(joint, n)| {
        let share = n.force / (lacking.hypot(n.force)).max(1e-12);
        let counts = n.evidence > 2.0 * CONVINCING && n.force > FLOOR * typical[joint] && share > NEGLIGIBLE;
        (counts || nameless_won && chosen.is_empty()).then(|| Unexplained {
            share,
            joint: search.names[joint].clone(),
            over: n.over.into(),
            region: n.region,
        })
    });
    let verdict = match (&unexplained, effects_found.is_empty()) {
        (Some(_), _) => Verdict::Unknown,
        (None, true) => Verdict::NoGap,
        (None, false) if effects_found.iter().any(|e| !e.alternatives.is_empty()) => Verdict::Ambiguous,
        (None, false) => Verdict::Named,
    };

    say("predicting over windows");
    let (gap, predicted) = gaps(&search, model, &given, &refitted, &current, &trajectories, &unseen, options)?;
    let windows = [predicted[0].as_slice(), predicted[2].as_slice()];
    let figures = plots::draw(&search, model, (&refitted, &current), (&trajectories, &unseen), windows, options.window)?;
    let mut found = current.hypothesis.model_at(&current.hypothesis.x);
    for (effect, entry) in effects_found.iter().zip(&final_entries) {
        found.document.effects[*entry].evidence = Some(Evidence {
            intervals: effect.parameters.iter().map(|(n, v)| (n.clone(), [v.lower, v.upper])).collect(),
            probability: effect.probability,
            alternatives: effect.alternatives.clone(),
            data: trajectories.iter().map(|t| t.hash.clone()).collect(),
            held_out: unseen.iter().map(|t| t.hash.clone()).collect(),
            gap: gap.held_out.as_ref().map_or([gap.train.refitted, gap.train.after], |g| [g.refitted, g.after]),
        });
    }
    found.state_in_urdf();
    let refused = |(name, gain): &(&str, f64)| Reason {
        name: (*name).into(),
        reason: format!("evidence e^{gain:.1} of the model without it; e^{CONVINCING:.0} is asked for"),
    };
    let mut rejected: Vec<Reason> = lost.iter().take(5).map(refused).collect();
    rejected.extend(contradicted);
    let report = Report {
        schema: SCHEMA,
        verdict,
        effects: effects_found,
        places,
        gap,
        unexplained,
        rejected,
        next_experiment: None,
        baselines: BTreeMap::new(),
        model: String::new(),
        notes,
        seconds: clock.elapsed().as_secs_f64(),
    };
    Ok(Found { report, model: found, figures })
}

fn best_three(candidates: &[Candidate], here: f64) -> String {
    let all: Vec<String> = candidates.iter().take(3).map(|c| format!("{} ({:+.1})", c.effect, c.evidence - here)).collect();
    all.join(", ")
}

/// Whole trajectories for a check, where none are given: never samples of one.
fn set_aside<'a>(train: &'a [Log], held_out: &'a [Log], notes: &mut Vec<String>) -> (Vec<&'a Log>, Vec<&'a Log>) {
    if !held_out.is_empty() {
        return (train.iter().collect(), held_out.iter().collect());
    }
    if train.len() < 3 {
        notes.push(format!("{} recording(s) are too few to set one aside: what is found is not confirmed on other data", train.len()));
        return (train.iter().collect(), Vec::new());
    }
    // Every fourth, from the second: early and late ones are on both sides.
    let aside = |i: usize| i % 4 == 1;
    (
        train.iter().enumerate().filter(|(i, _)| !aside(*i)).map(|(_, l)| l).collect(),
        train.iter().enumerate().filter(|(i, _)| aside(*i)).map(|(_, l)| l).collect(),
    )
}

/// What unseen data say of an effect, in units of their noise.
#[derive(Debug, Clone, Copy)]
struct Unseen {
    /// Half the fall of the squared errors.
    fall: f64,
    /// The same if the effect is just as it was fitted.
    expected: f64,
}

impl Unseen {
    /// They would show it, and they do not.
    fn contradicts(&self) -> bool {
        self.expected > SEEN && self.fall < SEEN.min(0.1 * self.expected)
    }

    fn reason(&self, name: &str) -> Reason {
        let reason = format!("held-out data, in which it would show, speak against it (half the squared errors rise by {:.1})", -self.fall);
        Reason { name: name.into(), reason }
    }
}

/// An effect that was chosen, and what it was chosen among.
#[derive(Debug, Clone)]
pub(crate) struct Choice {
    pub best: Candidate,
    /// Others: name, joint, evidence less than the best one's.
    pub others: Vec<(&'static str, Option<usize>, f64)>,
    /// Evidence over the model without it, and that of a force without a name.
    pub gain: f64,
    pub nameless: f64,
    /// Share of the errors' squares, beyond noise, that it takes away.
    pub explained: f64,
}

impl Choice {
    fn new(candidates: &[Candidate], here: f64, nameless: f64, explained: f64) -> Self {
        let best = candidates[0].clone();
        let mut this = Self { gain: best.evidence - here, best, others: Vec::new(), nameless, explained };
        this.around(candidates, this.best.evidence, here);
        this
    }

    fn around(&mut self, candidates: &[Candidate], with: f64, without: f64) {
        self.gain = with - without;
        let same = |c: &&Candidate| (c.effect, c.joint) != (self.best.effect, self.best.joint);
        self.others = candidates.iter().filter(same).map(|c| (c.effect, c.joint, with - c.evidence)).collect();
    }
}

impl<'a> Search<'a> {
    /// Fits anew from where a fit stands.
    fn refit(&self, fit: &Fit, scale: f64) -> Result<Fit, GapError> {
        Fit::start(&self.problem, fit.hypothesis.clone())?.finish(&self.problem, scale, None)
    }

    fn rank(&self, candidates: &mut [Candidate], scale: f64) {
        for c in candidates.iter_mut() {
            c.evidence = self.evidence(&c.fit, scale);
        }
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    }

    /// Share of the squared errors, beyond noise, that one fit takes away from another's.
    fn explained(&self, less: &Fit, more: &Fit, scale: f64) -> f64 {
        let noise = scale * scale * self.problem.measured() as f64;
        ((less.squares - more.squares) / (less.squares - noise).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    }

    /// Size of the force by which two fits differ, beyond what the known numbers can make of it: RMS, as a share of the joint's typical
    /// force, on the joint where it is largest.
    fn force_between(&self, less: &Fit, more: &Fit) -> Result<f64, GapError> {
        let runs = self.runs(less)?;
        let typical = self.typical_force();
        let change = &less.errors - &more.errors;
        let size = |j: usize| {
            let force = Response::new(self, less, &runs, j, 1.0).lacking(&change);
            (force.iter().map(|f| f * f).sum::<f64>() / force.len() as f64).sqrt() / typical[j]
        };
        Ok((0..self.names.len()).map(size).fold(0.0, f64::max))
    }

    /// The disturbance under which a fit's errors are most likely, if that is not the one assumed.
    fn likelier_noise(&self, fit: &Fit) -> Result<Option<Disturbance>, GapError> {
        let plant = fit.hypothesis.plant(&fit.hypothesis.x, &self.problem.limits, self.problem.step)?;
        let now = &self.problem.disturbance;
        // How often the floor has been raised already.
        let raised = now.acceleration[0] / self.floor[0];
        let inverse = self.problem.inverse_mass(&plant);
        let behind = |factors: [f64; 3]| now.times(factors).behind(&inverse);
        let factors = likely_noise(&plant, self.problem.trajectories, &behind, [1.0, MOST_NOISE / raised]);
        Ok((factors != [1.0; 3]).then(|| now.times(factors)))
    }

    fn with_noise(self, disturbance: Disturbance) -> Self {
        let problem = Problem::new(self.problem.trajectories, disturbance, &self.problem.limits, self.problem.step);
        Self { problem, ..self }
    }

    /// The same problem in finer steps.
    fn finer(&mut self) {
        let Problem { trajectories, disturbance, limits, .. } = &self.problem;
        self.problem = Problem::new(trajectories, disturbance.clone(), limits, FINE);
    }

    /// The most likely force without a name, and its joint.
    fn nameless(&self, fit: &Fit, scale: f64) -> Result<Option<(usize, Nameless)>, GapError> {
        let runs = self.runs(fit)?;
        let typical = self.typical_force();
        let all: Vec<(usize, Nameless)> = (0..self.names.len())
            .into_par_iter()
            .filter_map(|j| Some((j, flexible::nameless(&Response::new(self, fit, &runs, j, scale), scale, typical[j])?)))
            .collect();
        Ok(all.into_iter().max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence)))
    }

    /// Typical force on each joint.
    pub fn typical_force(&self) -> Vec<f64> {
        let typical = crate::noise::accelerations(self.problem.trajectories, &self.inertias);
        typical.iter().zip(&self.inertias).map(|(a, m)| a * m).collect()
    }

    /// Does anything move?
    fn check_motion(&self, notes: &mut Vec<String>) -> Result<(), GapError> {
        let mut moves = false;
        for (j, name) in self.names.iter().enumerate() {
            let seen = self.problem.trajectories.iter().flat_map(|t| t.positions(j)).filter(|y| y.is_finite());
            let [low, high] = seen.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], y| [a.min(y), b.max(y)]);
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

    /// For each effect: how much better it makes unseen data (half the fall of the squared errors), and whether that confirms it.
    fn on_unseen(&self, current: &Fit, base: &Fit, unseen: &[Trajectory], scale: f64) -> Result<Vec<Unseen>, GapError> {
        let all = entries(&current.hypothesis);
        all.par_iter()
            .map(|entry| {
                let less = if all.len() == 1 {
                    base.clone()
                } else {
                    self.refit(&Fit::start(&self.problem, current.hypothesis.without(*entry))?, scale)?
                };
                Ok(self.unseen_of(current, &less, unseen, scale).unwrap_or(Unseen { fall: 0.0, expected: 0.0 }))
            })
            .collect()
    }

    /// What unseen data say of one fit against another; none where there are no such data, or where one cannot follow them.
    fn unseen_of(&self, with: &Fit, without: &Fit, unseen: &[Trajectory], scale: f64) -> Option<Unseen> {
        let Problem { disturbance, limits, step, .. } = &self.problem;
        let problem = Problem::new(unseen, disturbance.clone(), limits, *step);
        let errors = |fit: &Fit| problem.errors(&fit.hypothesis, &fit.hypothesis.x).ok();
        let (with, without) = (errors(with)?, errors(without)?);
        let weight = 0.5 / (scale * scale);
        let fall = weight * (without.norm_squared() - with.norm_squared());
        (!unseen.is_empty()).then(|| Unseen { fall, expected: weight * (without - with).norm_squared() })
    }

    /// RMS of what the effects change of the force, over all joints.
    fn explained_force(&self, current: &Fit, base: &Fit) -> Result<f64, GapError> {
        let (a, b) = (self.runs(current)?, self.runs(base)?);
        let mut most: f64 = 0.0;
        for j in 0..self.names.len() {
            let response = Response::new(self, base, &b, j, 1.0);
            let before = response.lacking(&base.errors);
            let after = Response::new(self, current, &a, j, 1.0).lacking(&current.errors);
            let square = |f: &[f64]| f.iter().map(|x| x * x).sum::<f64>() / f.len() as f64;
            most = most.max(square(&before) - square(&after));
        }
        Ok(most.max(0.0).sqrt())
    }

    #[allow(clippy::too_many_arguments)]
    fn describe(
        &self,
        fit: &Fit,
        entry: usize,
        choice: &Choice,
        covariance: Option<&nalgebra::DMatrix<f64>>,
        held_out: Option<f64>,
        agrees: bool,
    ) -> NamedEffect {
        let hypothesis = &fit.hypothesis;
        let model = hypothesis.model_at(&hypothesis.x);
        let what = &model.document.effects[entry];
        let mut parameters = BTreeMap::new();
        for (i, fitted) in hypothesis.fitted.iter().enumerate() {
            let Knob::Effect(e, name) = &fitted.knob else { continue };
            if *e != entry {
                continue;
            }
            let deviation = covariance.map_or(f64::INFINITY, |c| c[(i, i)].max(0.0).sqrt()) * NORMAL_95;
            let (x, [low, high]) = (hypothesis.x[i], fitted.bounds);
            let end = |x: f64| fitted.value(x.clamp(low, high));
            let value = Value { value: fitted.value(x), lower: end(x - deviation), upper: end(x + deviation), unit: fitted.unit.into() };
            parameters.insert((*name).to_owned(), value);
        }
        let alike = |(name, joint, less): &&(&'static str, Option<usize>, f64)| {
            *less < ALIKE && (*joint == choice.best.joint || *name != what.effect)
        };
        let mut alternatives: Vec<String> = choice.others.iter().filter(alike).map(|o| o.0.to_owned()).collect();
        alternatives.dedup();
        let mut weights: Vec<f64> = choice.others.iter().map(|o| (-o.2).exp()).collect();
        weights.push((-choice.gain).exp());
        weights.push((choice.nameless - choice.gain).min(50.0).exp());
        let probability = 1.0 / (1.0 + weights.iter().sum::<f64>());
        let runners_up = choice
            .others
            .iter()
            .filter(|o| o.2 >= ALIKE)
            .take(5)
            .map(|o| Reason { name: o.0.into(), reason: format!("fits less well: evidence e^-{:.1} of the named effect's", o.2) });
        NamedEffect {
            name: what.effect.clone(),
            alternatives,
            joint: what.joint.clone(),
            channel: channel(&what.effect).into(),
            parameters,
            choices: what.choices.clone(),
            probability,
            confirmed: agrees,
            evidence: EffectEvidence {
                log_bayes_factor: choice.gain,
                log_bayes_factor_nameless: choice.gain - choice.nameless,
                explained: choice.explained,
                held_out,
            },
            runners_up: runners_up.collect(),
        }
    }
}

/// Where an effect acts, in a word.
pub(crate) fn channel(effect: &str) -> &'static str {
    let Ok(found) = effects::find(effect) else { return "joint" };
    match (found.description().acts, effect) {
        (_, "joint_axis_error") => "kinematic",
        (Acts::Command(_), _) | (_, "armature_inertia" | "backlash" | "joint_elasticity") => "actuator",
        (Acts::Measurement(_), _) => "sensor",
        (Acts::Bodies | Acts::Base, _) => "body",
        _ => "joint",
    }
}

#[allow(clippy::too_many_arguments)]
fn gaps(
    search: &Search<'_>,
    model: &ObjectModel,
    given: &Fit,
    refitted: &Fit,
    current: &Fit,
    train: &[Trajectory],
    unseen: &[Trajectory],
    options: &Options<'_>,
) -> Result<(Gaps, Vec<Vec<Predicted>>), GapError> {
    let n = search.names.len();
    let ranges: Vec<f64> = (0..n)
        .map(|j| {
            let limits = &model.joints[search.joints[j]].limits;
            let seen = train.iter().chain(unseen).flat_map(|t| t.positions(j)).filter(|y| y.is_finite());
            let [low, high] = seen.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], y| [a.min(y), b.max(y)]);
            if limits.range().is_finite() { limits.range() } else { (high - low).max(1e-6) }
        })
        .collect();
    let untouched = Hypothesis { x: Vec::new(), fitted: Vec::new(), known: 0, ..given.hypothesis.clone() };
    let limits = &search.problem.limits;
    let made = |step: f64| -> Result<[crate::plant::Plant; 3], GapError> {
        Ok([
            untouched.plant(&[], limits, step)?,
            refitted.hypothesis.plant(&refitted.hypothesis.x, limits, step)?,
            current.hypothesis.plant(&current.hypothesis.x, limits, step)?,
        ])
    };
    let plants = made(FINE)?;
    // Following the data takes no finer steps than the search did.
    let followers = made(crate::search::STEP)?;
    let on = |data: &[Trajectory]| -> Result<(Gap, Vec<Vec<Predicted>>), GapError> {
        // By the data alone, so that anyone who has them finds the same figures.
        let noise = noise::of_motion(data, n, FLOOR);
        let both: Vec<(Figures, Vec<Predicted>)> = plants
            .par_iter()
            .zip(&followers)
            .map(|(plant, follower)| {
                let smoothed = Smoothed::new(follower, data, &noise)?;
                Ok((smoothed.figures(plant, data, options.window, &ranges), plots::windows(&smoothed, plant, data, options.window)))
            })
            .collect::<Result<_, GapError>>()?;
        let (figures, predicted): (Vec<Figures>, Vec<_>) = both.into_iter().unzip();
        let likely = noise.likely(&followers[2], data);
        let smoothed = Smoothed::new(&followers[2], data, &noise)?;
        let invented = smoothed.invent(&plants[2], data, &likely, options.window, options.seed)?;
        let floor = Smoothed::new(&followers[2], &invented, &noise)?.figures(&plants[2], &invented, options.window, &ranges);
        let per_joint = (0..n)
            .map(|j| {
                let pick = |f: fn(&Figures) -> &Vec<f64>| [f(&figures[0])[j], f(&figures[1])[j], f(&figures[2])[j], f(&floor)[j]];
                let rmse = pick(|f| &f.rmse);
                let sliding = model.joints[search.joints[j]].kind == JointKind::Prismatic;
                let gap = JointGap {
                    before: rmse[0],
                    refitted: rmse[1],
                    after: rmse[2],
                    noise_floor: rmse[3],
                    median: pick(|f| &f.median),
                    short: pick(|f| &f.rmse_short),
                    range: ranges[j],
                    unit: if sliding { "m" } else { "rad" }.into(),
                };
                (search.names[j].clone(), gap)
            })
            .collect();
        let [before, refitted, after] = [0, 1, 2].map(|i| figures[i].pooled);
        Ok((Gap { before, refitted, after, noise_floor: floor.pooled, per_joint }, predicted))
    };
    let (train, mut predicted) = on(train)?;
    let mut gaps = Gaps { train, held_out: None };
    if !unseen.is_empty() {
        let held_out;
        (held_out, predicted) = on(unseen)?;
        gaps.held_out = Some(held_out);
    }
    Ok((gaps, predicted))
}
