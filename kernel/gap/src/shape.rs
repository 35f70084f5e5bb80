//! Do fitted effects have the shapes that their names stand for? A fit bends a name to whatever is there: a friction that rises with speed to a
//! drag, a stop to a spring that grows stiffer half way.

use std::f64::consts::PI;

use sagci_dynamics::effects::{self, Description};
use sagci_model::EffectEntry;

use crate::fit::Fit;
use crate::observer::Run;
use crate::search::{Search, entries};
use crate::trajectory::Trajectory;
use crate::view::SELDOM;

/// Share of its way that a joint goes into a stop, at the most: what gives way by more does not stop it. But for a few moments, as where a
/// recording begins beyond a stop that throws the joint out.
const DEEPEST: f64 = 0.25;
/// Longest time in which a stop turns a free joint round, s: half an oscillation of the joint on it. What takes longer is a spring.
const SLOWEST: f64 = 0.3;
/// Share of a latch's width at either end where little is left of its force.
const FLANK: f64 = 0.25;
/// Share of a joint's velocity that friction leaves it from row to row where it does not hold it.
const STAYS: f64 = 0.5;
/// How many times as heavy as its link a payload is, at the most.
const HEAVIEST: f64 = 20.0;

impl Search<'_> {
    /// Has each effect of a fit the shape that its name stands for?
    pub fn is_shaped(&self, fit: &Fit) -> bool {
        let model = &fit.hypothesis.model;
        let link = |j: usize| &model.links[model.joints[self.joints[j]].child].inertial;
        let named = named(fit);
        let joint = |entry: &EffectEntry| entry.joint.as_ref().and_then(|name| self.names.iter().position(|n| n == name));
        let has_shape = |(entry, description, values): &(EffectEntry, &'static Description, Vec<f64>)| {
            let joint = joint(entry);
            let has_it = |j: usize| match entry.effect.as_str() {
                "hard_stop" => self.stops(j, values),
                "latch" => self.passes(j, values),
                // Where all that a joint moves is uncertain, a mass that nothing moves says why it goes on as it went.
                "payload" => values.first().is_none_or(|mass| *mass < HEAVIEST * link(j).mass),
                _ => true,
            };
            description.is_shaped(values) && joint.is_none_or(has_it)
        };
        let stopped = |j: usize| named.iter().any(|(entry, of, values)| joint(entry) == Some(j) && self.may_stop(j, of, values));
        let held: Vec<usize> = (0..self.names.len()).filter(|j| stopped(*j)).collect();
        named.iter().all(has_shape) && (held.is_empty() || self.runs(fit).is_ok_and(|runs| held.iter().all(|j| self.goes_on(*j, &runs))))
    }

    /// Could an effect of such size bring a joint to rest from one row to the next?
    fn may_stop(&self, joint: usize, description: &Description, values: &[f64]) -> bool {
        let within = self.problem.period / self.inertias[joint];
        let speed = self.pace(joint, |_, _| 0.0)[0].max(0.0).sqrt();
        description.parameters.iter().zip(values).any(|(parameter, value)| match parameter.unit[0] {
            "N m" => within * value.abs() > STAYS * speed,
            "N m s/rad" => within * value > STAYS,
            _ => false,
        })
    }

    /// Does a model go on from row to row where its joint does? One that friction holds, on a body of no weight, stays wherever it is put. Row by
    /// row that is a good forecast of a slow motion, better than that of a force that is not known exactly; but it is none of how the joint moves.
    fn goes_on(&self, joint: usize, runs: &[Run]) -> bool {
        let [moved, foretold] = self.pace(joint, |trajectory, row| runs[trajectory].v_predicted[row]);
        foretold >= STAYS * moved
    }

    /// Mean products of a joint's velocity after a row, with that before it and with what is said of it there, rad^2/s^2 or m^2/s^2. They share
    /// no measurement, so noise makes nothing of them.
    fn pace(&self, joint: usize, said: impl Fn(usize, usize) -> f64) -> [f64; 2] {
        let (n, mut sums, mut count) = (self.names.len(), [0.0; 2], 0.0);
        for (index, trajectory) in self.problem.trajectories.iter().enumerate() {
            let between = |a: usize, b: usize| {
                (trajectory.position[b * n + joint] - trajectory.position[a * n + joint]) / (trajectory.time[b] - trajectory.time[a])
            };
            for k in 1..trajectory.rows().saturating_sub(2) {
                let (before, said, after) = (between(k - 1, k), said(index, k * n + joint), between(k + 1, k + 2));
                let starts = (k..k + 3).any(|row| trajectory.starts.contains(&row));
                if !starts && (before * said * after).is_finite() {
                    sums = [sums[0] + after * before, sums[1] + after * said];
                    count += 1.0;
                }
            }
        }
        sums.map(|sum| sum / f64::max(count, 1.0))
    }

    /// Does a joint go through a latch? What it only goes into is a force that grows.
    fn passes(&self, joint: usize, latch: &[f64]) -> bool {
        let &[_, _, position, width] = latch else { return true };
        let [low, high] = Trajectory::range(self.problem.trajectories, joint);
        low < position + FLANK * width && high > position + (1.0 - FLANK) * width
    }

    /// Does a stop hold a joint where these data go to its end, and soon?
    fn stops(&self, joint: usize, stop: &[f64]) -> bool {
        let &[stiffness, _, position, side] = stop else { return true };
        if PI * (self.inertias[joint] / stiffness).sqrt() > SLOWEST {
            return false;
        }
        let [low, high] = Trajectory::range(self.problem.trajectories, joint);
        let too_deep = |y: &f64| side * (y - position) > DEEPEST * (high - low);
        let reached = || self.problem.trajectories.iter().flat_map(|t| t.positions(joint)).filter(|y| y.is_finite());
        reached().filter(too_deep).count() as f64 <= SELDOM * reached().count() as f64
    }
}

/// Has an effect of a fit a shape that its name hardly stands for? It may be part of the way to the right one.
pub(crate) fn is_bent(fit: &Fit) -> bool {
    named(fit).iter().any(|(_, description, values)| description.is_bent(values))
}

/// The effects of a fit with their values.
fn named(fit: &Fit) -> Vec<(EffectEntry, &'static Description, Vec<f64>)> {
    let hypothesis = &fit.hypothesis;
    let mut all = hypothesis.model_at(&hypothesis.x).document.effects;
    let mut of = |i: usize| {
        let entry = std::mem::take(all.get_mut(i)?);
        let (effect, values) = effects::parameters_of(&entry).ok()?;
        Some((entry, effect.description(), values))
    };
    entries(hypothesis).into_iter().filter_map(&mut of).collect()
}
