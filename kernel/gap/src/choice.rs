//! An effect that was chosen, what it was chosen among, and what a report says of it.

use std::collections::BTreeMap;

use sagci_dynamics::effects::{self, Acts};
use sagci_model::JointKind;

use crate::alike::plain_name;
use crate::fit::Fit;
use crate::hypothesis::{Fitted, Knob, TURN};
use crate::report::{EffectEvidence, NamedEffect, Reason, Value};
use crate::search::{Candidate, FLOOR, Search};
use crate::weigh::CONVINCING;

/// Names whose evidence is within this of the best one's cannot be told from it.
pub(crate) const ALIKE: f64 = 3.0;
/// Quantile of the normal distribution for intervals of 95 %.
const NORMAL_95: f64 = 1.959_964;

/// An effect that was chosen, and what it was chosen among.
#[derive(Debug, Clone)]
pub(crate) struct Choice {
    pub best: Candidate,
    /// Others: name, joint, evidence less than the best one's.
    pub others: Vec<(&'static str, Option<usize>, f64)>,
    /// Itself and, behind it, what the data cannot tell from it, all fitted to the same data beside the same other effects.
    pub alike: Vec<Candidate>,
    /// Names that no data of this kind tell from it.
    pub equivalent: &'static [&'static str],
    /// Evidence over the model without it, and that of a force without a name.
    pub gain: f64,
    pub nameless: f64,
    /// Share of the errors' squares, beyond noise, that it takes away.
    pub explained: f64,
}

impl Choice {
    /// The first of all candidates. `here` is the evidence without any.
    pub fn new(search: &Search<'_>, candidates: &[Candidate], here: f64, nameless: f64, explained: f64, scale: f64) -> Self {
        let best = candidates[0].clone();
        let mut this =
            Self { gain: best.evidence - here, best, others: Vec::new(), alike: Vec::new(), equivalent: &[], nameless, explained };
        this.around(search, candidates, [this.best.evidence, here], scale);
        this
    }

    /// The first of other candidates for the same place.
    pub fn giving_way_to(&self, search: &Search<'_>, instead: &[Candidate], scale: f64) -> Self {
        Self::new(search, instead, self.best.evidence - self.gain, self.nameless, self.explained, scale)
    }

    /// `with` and `without` it, by evidence; `scale` is that of the errors.
    pub fn around(&mut self, search: &Search<'_>, candidates: &[Candidate], [with, without]: [f64; 2], scale: f64) {
        self.gain = with - without;
        let same = |c: &&Candidate| (c.effect, c.joint) == (self.best.effect, self.best.joint);
        let itself = candidates.iter().find(same).unwrap_or(&self.best).clone();
        // All as they were fitted together: one that was fitted on since says a little more than others would, too. Errors that go on from row to
        // row say less of the difference than as many that are independent. What more numbers cost is no error's to say: only posteriors get wider.
        // Where errors say nothing, what sizes as many numbers were expected to have says little: those are estimates.
        let own = if with - itself.evidence < CONVINCING { itself.evidence } else { with };
        let numbers = |c: &Candidate| c.fit.hypothesis.x.len();
        let less = |c: &Candidate| {
            let less = own - c.evidence;
            let persistence = search.problem.persistence(&itself.fit.errors, &(&c.fit.errors - &itself.fit.errors));
            let by_errors = 0.5 * (c.fit.judged - itself.fit.judged) / (scale * scale);
            let wider = 0.5 * (numbers(c) as f64 - numbers(&itself) as f64) * persistence.ln();
            let apart = if less.abs() < ALIKE { less } else { less / persistence };
            if numbers(c) == numbers(&itself) && by_errors.abs() < ALIKE && less.abs() < CONVINCING {
                return by_errors;
            }
            if numbers(c) > numbers(&itself) { apart.max(by_errors / persistence + (less - by_errors) - wider) } else { apart }
        };
        let beside: Vec<(&Candidate, f64)> = candidates.iter().filter(|c| !same(c)).map(|c| (c, less(c))).collect();
        self.others = beside.iter().map(|(c, less)| (c.effect, c.joint, *less)).collect();
        // Of one channel, a name with an idle number is the plainer one again; of another it is another cause.
        let says_more =
            |c: &Candidate| numbers(c) <= numbers(&itself) || channel(c.effect) != channel(itself.effect) || !idle(&c.fit, scale);
        // What does not drift has a plain name, and is not named twice.
        let is_plain = |c: &Candidate| plain_name(c).is_some_and(|name| candidates.iter().any(|o| (o.effect, o.joint) == (name, c.joint)));
        let elsewhere = |c: &Candidate| c.joint != itself.joint && c.effect == itself.effect;
        // What says more by no more numbers, or of another channel, and has not taken the place, is not out.
        let no_less = |c: &Candidate, less: f64| {
            less.abs() < ALIKE || less < 0.0 && (numbers(c) <= numbers(&itself) || channel(c.effect) != channel(itself.effect))
        };
        let rival = |(c, less): &&(&Candidate, f64)| no_less(c, *less) && !elsewhere(c) && !is_plain(c) && says_more(c);
        let rivals = beside.iter().filter(rival).map(|(c, _)| (*c).clone());
        self.alike = std::iter::once(itself.clone()).chain(rivals).collect();
    }
}

/// Do the data say nothing of a number of the last effect? Then it is a plainer one that has the same force, written with more numbers.
fn idle(fit: &Fit, scale: f64) -> bool {
    let fitted = &fit.hypothesis.fitted;
    let last = fitted.iter().filter_map(|f| f.knob.entry()).next_back();
    fitted.iter().enumerate().any(|(i, f)| last.is_some() && f.knob.entry() == last && !fit.is_told(i, scale))
}

impl Search<'_> {
    #[allow(clippy::too_many_arguments)]
    pub fn describe(
        &self,
        fit: &Fit,
        entry: usize,
        choice: &Choice,
        variances: Option<&[f64]>,
        held_out: Option<f64>,
        agrees: bool,
    ) -> NamedEffect {
        let hypothesis = &fit.hypothesis;
        let model = hypothesis.model_at(&hypothesis.x);
        let what = &model.document.effects[entry];
        let mut parameters = BTreeMap::new();
        for (i, fitted) in hypothesis.fitted.iter().enumerate() {
            let Some((name, of)) = fitted.knob.parameter().filter(|_| fitted.knob.entry() == Some(entry)) else { continue };
            // No mechanism is quite what a model says that it is, so that no size is known better than what any model is off by.
            let model_error = if fitted.logarithmic { FLOOR } else { 0.0 };
            let known = |i: usize| variances.map_or(f64::INFINITY, |v| v[i].max(0.0).sqrt());
            // Of a multiple the other's size is told, too: that what is known of both goes against one another is left out.
            let other = of.and_then(|of| hypothesis.fitted.iter().position(|f| f.knob == Knob::Effect(entry, of)));
            let once = of.and_then(|of| what.parameters.get(of)).copied().unwrap_or(1.0);
            let deviation = known(i).hypot(other.map_or(0.0, known)).hypot(model_error) * NORMAL_95;
            let (x, [low, high]) = (hypothesis.x[i], fitted.bounds);
            let at = |x: f64| once * fitted.value(x);
            let end = |x: f64| at(x.clamp(low, high));
            let value = Value { value: at(x), lower: end(x - deviation), upper: end(x + deviation), unit: fitted.unit.into() };
            parameters.insert(name.to_owned(), value);
        }
        let turning = hypothesis.fitted.iter().enumerate().filter(|(_, f)| matches!(f.knob, Knob::Turn(e, _) if e == entry));
        let turning: Vec<(usize, &Fitted)> = turning.collect();
        if !turning.is_empty() {
            let turn: Vec<[f64; 2]> = turning
                .iter()
                .map(|(i, _)| [hypothesis.x[*i], variances.map_or(f64::INFINITY, |v| v[*i].max(0.0).sqrt()) * NORMAL_95])
                .collect();
            parameters.extend(turned(&turn, turning[0].1));
        }
        // A number that no data move stands as it is.
        let side =
            usize::from(what.joint.as_ref().and_then(|j| model.joint(j)).is_some_and(|i| model.joints[i].kind == JointKind::Prismatic));
        let all = effects::find(&what.effect).map_or(&[][..], |e| e.description().parameters);
        for (name, value) in &what.parameters {
            let Some(parameter) = all.iter().find(|p| p.name == name) else { continue };
            let fixed = Value { value: *value, lower: *value, upper: *value, unit: parameter.unit[side].into() };
            parameters.entry(name.clone()).or_insert(fixed);
        }
        let mut alternatives: Vec<String> = choice.alike[1..].iter().map(|c| c.effect.to_owned()).collect();
        alternatives.extend(choice.equivalent.iter().map(|n| (*n).to_owned()));
        alternatives.sort();
        alternatives.dedup();
        let counts = |o: &&(&str, Option<usize>, f64)| o.2 > -ALIKE || alternatives.iter().any(|a| a == o.0);
        let mut weights: Vec<f64> = choice.others.iter().filter(counts).map(|o| (-o.2).min(50.0).exp()).collect();
        weights.push((-choice.gain).exp());
        weights.push((choice.nameless - choice.gain).min(50.0).exp());
        let probability = 1.0 / (1.0 + weights.iter().sum::<f64>());
        let reason = |less: f64| match less >= ALIKE {
            true => format!("fits less well: evidence e^-{less:.1} of the named effect's"),
            false => "says the same in more numbers, or with one that is nothing".to_owned(),
        };
        let lost = choice.others.iter().filter(|o| !alternatives.iter().any(|a| a == o.0));
        let runners_up: Vec<Reason> = lost.take(5).map(|o| Reason { name: o.0.into(), reason: reason(o.2) }).collect();
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
            runners_up,
        }
    }
}

/// Angle and direction of a turn, of which each component is known so far: along it that is the angle's, across it, by the angle, the
/// direction's. A turn that may be none has any direction.
fn turned(components: &[[f64; 2]], fitted: &Fitted) -> Vec<(String, Value)> {
    let angle = components.iter().map(|[x, _]| x * x).sum::<f64>().sqrt();
    let along = |x: f64| if angle > 0.0 { x / angle } else { 0.0 };
    let most = components.iter().map(|c| c[1]).fold(0.0, f64::max);
    let of_angle = if angle > 0.0 { components.iter().map(|[x, d]| (along(*x) * d).powi(2)).sum::<f64>().sqrt() } else { most };
    let value = |value: f64, deviation: f64, [low, high]: [f64; 2], unit: &str| {
        let [lower, upper] = [(value - deviation).max(low), (value + deviation).min(high)];
        Value { value, lower, upper, unit: unit.into() }
    };
    let directions = components.iter().map(|[x, d]| value(along(*x), if angle > 0.0 { d / angle } else { 2.0 }, [-1.0, 1.0], "1"));
    let all = std::iter::once(value(angle, of_angle, [0.0, fitted.bounds[1]], fitted.unit)).chain(directions);
    TURN.iter().map(|name| (*name).to_owned()).zip(all).collect()
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
