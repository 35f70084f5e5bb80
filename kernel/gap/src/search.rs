//! Which effect is missing: starts from everything the catalogue offers, exact fits of the best, and their evidence.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use nalgebra::DVector;
use rayon::prelude::*;
use sagci_dynamics::effects::{self, Acts, Effect};
use sagci_model::ObjectModel;

use crate::GapError;
use crate::fit::{Derivatives, Effort, Fit, Problem};
use crate::flexible;
use crate::hypothesis::{Fitted, Hypothesis, Knob};
use crate::noise;
use crate::observer::{self, Disturbance, Run};
use crate::response::Response;
use crate::starts::{JointView, Seen, observable, starts};
use crate::trajectory::{Drive, Trajectory, joint_names};

/// An effect at a place, fitted.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub effect: &'static str,
    /// Among the model's degrees of freedom; none for the base.
    pub joint: Option<usize>,
    pub fit: Fit,
    /// Logarithm of the evidence, up to a constant that all share.
    pub evidence: f64,
}

/// A model and data, ready to be searched.
#[derive(Debug)]
pub(crate) struct Search<'a> {
    pub problem: Problem<'a>,
    /// Names of the degrees of freedom, and the model's joints.
    pub names: Vec<String>,
    pub joints: Vec<usize>,
    pub inertias: Vec<f64>,
    pub seen: Vec<Seen>,
    /// How much measured efforts change from row to row, as the standard deviation of a noise, by joint.
    pub jitter: Vec<f64>,
    /// How much efforts accelerate joints of the model as given, by columns.
    pub mobility: Vec<f64>,
}

/// Share of the motion's accelerations that no model has.
pub(crate) const FLOOR: f64 = 0.01;
/// Longest step while searching, s.
pub(crate) const STEP: f64 = 2.5e-3;
/// Effects of one stage that are fitted in the simulator, and those of them that are fitted to the end.
const SEMIFINALISTS: usize = 12;
const FINALISTS: usize = 6;
/// Joints on each of which everything is tried, and the share of the evidence of the best force on any that is asked of one on others.
const FEW: usize = 2;
const PUSHED: f64 = 0.1;
/// How often derivatives of the known numbers are taken in the linear response, and the share of the errors' squares that is no progress.
const ROUNDS: usize = 6;
const TRIFLE: f64 = 1e-3;
/// Steps of a first fit in the simulator.
pub(crate) const QUICK: usize = 5;
/// Starts of one effect that are fitted in the simulator.
const STARTS: usize = 2;

/// An effect that explains less than this share of what the best one explains is not looked at further: after the screen, and after
/// the first rounds in the simulator.
const HOPE: f64 = 0.3;
const CLOSE: f64 = 0.8;

const NEAR: f64 = 10.0;
/// Share of a joint's way that what is bound to a place may be wide: wider, it is a spring or a friction everywhere.
const LOCAL: f64 = 0.3;
/// Periods over that way from which on a force repeats: with fewer it is a tilt or a spring.
const REPEATS: f64 = 1.5;

/// An effect at a place after the screens.
struct Screened {
    /// Its numbers were fitted in the linear response.
    linear: bool,
    effect: &'static str,
    joint: Option<usize>,
    hypothesis: Hypothesis,
    /// Roughly the logarithm of its evidence over that of the base model.
    worth: f64,
}

impl<'a> Search<'a> {
    pub fn new(model: &ObjectModel, trajectories: &'a [Trajectory]) -> Result<Self, GapError> {
        let names = joint_names(model)?;
        let joints: Vec<usize> = model.moving_joints().collect();
        let n = names.len();
        let limits: Vec<bool> = (0..n).map(|j| reached(model, joints[j], trajectories, j)).collect();
        let known = Hypothesis::known(model, &joints);
        let given = known.plant(&known.x, &limits, STEP)?;
        let inverse = given.inverse_mass_at(&noise::middle(trajectories, n));
        let inertias: Vec<f64> = (0..n).map(|j| 1.0 / inverse[j * n + j]).collect();
        let typical = noise::accelerations(trajectories, &inertias);
        let disturbance = Disturbance {
            position: (0..n).map(|j| noise::of_positions(trajectories, j)).collect(),
            share: vec![FLOOR; n],
            quiet: typical.iter().map(|a| noise::QUIET * a).collect(),
            effort: (0..n).map(|j| noise::of_efforts(trajectories, j)).collect(),
        };
        let jitter = disturbance.effort.clone();
        let any = |test: &dyn Fn(Drive) -> bool, j: usize| trajectories.iter().any(|t| test(t.drive[j]));
        let problem = Problem::new(trajectories, disturbance, &limits, STEP);
        Ok(Self {
            mobility: problem.mobility(&given),
            problem,
            seen: (0..n)
                .map(|j| Seen { commanded: any(&|d| matches!(d, Drive::Command(_)), j), one_way: one_way(trajectories, j) })
                .collect(),
            names,
            joints,
            inertias,
            jitter,
        })
    }

    /// The model as given, its known numbers refitted.
    pub fn known(&self, model: &ObjectModel, scale: f64) -> Result<Fit, GapError> {
        let mut fit = Fit::start(&self.problem, Hypothesis::known(model, &self.joints))?;
        fit.jacobian = self.derivatives(&fit)?;
        let hypothesis = fit.hypothesis.condensed(&fit.jacobian, scale);
        let column = |f: &Fitted| fit.hypothesis.fitted.iter().position(|all| all.knob == f.knob).map(|i| fit.jacobian[i].clone());
        let jacobian = hypothesis.fitted.iter().filter_map(column).collect();
        let mut fit = Fit { hypothesis, jacobian, ..fit };
        for _ in 0..ROUNDS {
            let (before, all) = (fit.squares, fit.jacobian.clone());
            fit = fit.improve(&self.problem, scale, Effort::new(QUICK, 0.5), Derivatives { kept: false, frozen: Some(&all) })?;
            if before - fit.squares < TRIFLE * before {
                break;
            }
            fit.jacobian = self.derivatives(&fit)?;
        }
        if self.names.len() > FEW { Ok(self.judge(fit)) } else { self.fit_on(fit, scale) }
    }

    /// A fit as it is compared with others.
    pub fn judge(&self, fit: Fit) -> Fit {
        Fit { judged: self.problem.judged(&fit, &self.mobility), ..fit }
    }

    /// How much larger the errors are than the noises make them; at least one.
    pub fn scale(&self, fit: &Fit) -> f64 {
        (fit.squares / self.problem.measured() as f64).sqrt().max(1.0)
    }

    /// Logarithm of a fit's evidence, with the errors by which models are compared.
    pub fn evidence(&self, fit: &Fit, scale: f64) -> f64 {
        fit.evidence(fit.judged, scale)
    }

    /// The same with the errors that the fit itself made small.
    pub fn evidence_in_fit(&self, fit: &Fit, scale: f64) -> f64 {
        fit.evidence(fit.squares, scale)
    }

    /// One more effect on top of a fit: all that the catalogue offers, the most likely first.
    pub fn stage(&self, base: &Fit, scale: f64) -> Result<Vec<Candidate>, GapError> {
        let views = self.views(base)?;
        let mut tries: Vec<(&'static dyn Effect, Option<usize>, Vec<f64>)> = Vec::new();
        for effect in effects::catalogue() {
            let description = effect.description();
            let places: Vec<Option<usize>> = match description.acts {
                Acts::Base => vec![None],
                _ => (0..self.names.len()).map(Some).collect(),
            };
            for place in places {
                let at = place.unwrap_or(0);
                let skip = !observable(description.name, self.seen[at])
                    || description.acts == Acts::Losses && !self.wears(base, at)
                    || base
                        .hypothesis
                        .model
                        .document
                        .effects
                        .iter()
                        .any(|e| e.effect == description.name && e.joint.as_deref() == place.map(|j| self.names[j].as_str()));
                if !skip {
                    tries.extend(starts(description.name, &views[at]).into_iter().map(|s| (*effect, place, s)));
                }
            }
        }
        // Screens, cheap and only roughly right: they choose starts and leave out the hopeless.
        let runs = self.runs(base)?;
        let mut responses: Vec<Option<Response>> = Vec::new();
        for j in 0..self.names.len() {
            responses.push(tries.iter().any(|t| t.1 == Some(j)).then(|| Response::new(self, base, &runs, j, scale)));
        }
        let pushed = self.pushed(&responses, scale);
        // Where one step after the other is compared, their order cancels.
        let rough = Problem { rough: true, ..self.problem.clone() };
        let rough_base = rough.errors(&base.hypothesis, &base.hypothesis.x)?;
        let screened: Vec<Option<Screened>> = tries
            .into_par_iter()
            .map(|(effect, place, values)| {
                let name = effect.description().name;
                let hypothesis = base.hypothesis.with(name, place.map(|j| self.names[j].as_str()), &values).ok()?;
                let view = &views[place.unwrap_or(0)];
                let hypothesis = hypothesis.confined(base.hypothesis.x.len(), LOCAL * view.way(), REPEATS * TAU / view.way());
                let response = responses.get(place.unwrap_or(0))?.as_ref()?;
                let linear = effect.description().acts == Acts::Joint && effect.description().parameter("encoder").is_none();
                if !linear && !place.is_none_or(|j| pushed[j]) {
                    return None;
                }
                let (x, gain) = if linear {
                    self.by_response(base, response, effect, &hypothesis, &values, scale)
                } else {
                    by_run(&rough, &rough_base, response, base, &hypothesis)?
                };
                let extra = (hypothesis.x.len() - base.hypothesis.x.len()) as f64;
                let worth = 0.5 * gain / (scale * scale) - 0.5 * extra * (self.problem.measured() as f64).ln();
                let hypothesis = Hypothesis { x, ..hypothesis };
                worth.is_finite().then_some(Screened { linear, effect: name, joint: place, hypothesis, worth })
            })
            .collect();
        // What was fitted in the linear response has one best start; of others the second may lead further.
        let mut best: BTreeMap<(&str, Option<usize>), Vec<Screened>> = BTreeMap::new();
        for candidate in screened.into_iter().flatten() {
            best.entry((candidate.effect, candidate.joint)).or_default().push(candidate);
        }
        let mut ranked: Vec<Vec<Screened>> = best.into_values().collect();
        for starts in &mut ranked {
            starts.sort_by(|a, b| b.worth.total_cmp(&a.worth));
            starts.truncate(if starts[0].linear { 1 } else { STARTS });
        }
        ranked.sort_by(|a, b| b[0].worth.total_cmp(&a[0].worth));
        ranked.truncate(SEMIFINALISTS);
        // Small forces act linearly: what the screen sees far below the base model's evidence will not be convincing.
        let most = ranked.first().map_or(0.0, |r| r[0].worth);
        let mut place = 0;
        ranked.retain(|r| {
            place += 1;
            (r[0].worth > -NEAR || !r[0].linear) && (place <= 4 || r[0].worth > HOPE * most)
        });
        let quick = Effort::new(QUICK, 0.5);
        let mut ranked: Vec<Candidate> = ranked
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .into_par_iter()
            .filter_map(|screened| {
                let mut fit = Fit::start(&self.problem, screened.hypothesis).ok()?;
                // Judged at the end; until then beside the base.
                fit.judged = base.judged + fit.squares - base.squares;
                let fit = fit.improve(&self.problem, scale, quick, Derivatives { kept: false, frozen: Some(&base.jacobian) }).ok()?;
                let evidence = self.evidence(&fit, scale);
                evidence.is_finite().then_some(Candidate { effect: screened.effect, joint: screened.joint, fit, evidence })
            })
            .collect();
        ranked.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let mut seen = BTreeSet::new();
        ranked.retain(|c| seen.insert((c.effect, c.joint)));
        let fall = |c: &Candidate| base.squares - c.fit.squares;
        let most = ranked.first().map_or(0.0, fall);
        // What an exact fit has not brought near the base model's evidence yet will not be convincing.
        let here = self.evidence(base, scale);
        let hope = |c: &&Candidate| fall(c) > CLOSE * most && c.evidence > here - NEAR;
        let hopeful = ranked.iter().take(FINALISTS).take_while(hope).count().max(2);
        let rest = ranked.split_off(hopeful.min(ranked.len()));
        let known = Derivatives { kept: true, frozen: Some(&base.jacobian) };
        let finish = |candidate: Candidate, bar: f64| {
            let fit = candidate.fit.finish(&self.problem, scale, known, bar).ok()?;
            Some(Candidate { fit, ..candidate })
        };
        // What stays far behind the best need not be fitted to the end.
        let behind = ranked.split_off(1.min(ranked.len()));
        let mut finished: Vec<Candidate> = ranked.into_iter().filter_map(|c| finish(c, here)).collect();
        let bar = finished.first().map_or(here, |c| self.evidence(&c.fit, scale).max(here));
        finished.extend(behind.into_par_iter().filter_map(|c| finish(c, bar)).collect::<Vec<_>>());
        let mut all = finished;
        all.extend(rest);
        let mut all: Vec<Candidate> = all.into_par_iter().map(|c| Candidate { fit: self.judge(c.fit), ..c }).collect();
        self.rank(&mut all, scale);
        Ok(all)
    }

    /// Joints on which some force explains a good part of what one on any joint does. A run for each start of each effect on each joint of a
    /// robot's arm is what a search would mostly do.
    fn pushed(&self, responses: &[Option<Response>], scale: f64) -> Vec<bool> {
        if responses.len() <= FEW {
            return vec![true; responses.len()];
        }
        let typical = self.typical_force();
        let told = |(j, response): (usize, &Option<Response>)| {
            response.as_ref().and_then(|r| flexible::nameless(r, scale, typical[j])).map_or(0.0, |n| n.evidence)
        };
        let evidence: Vec<f64> = responses.par_iter().enumerate().map(told).collect();
        let most = evidence.iter().copied().fold(0.0, f64::max);
        evidence.iter().map(|e| *e >= PUSHED * most).collect()
    }

    /// Fits an effect's numbers in the linear response: where it ends, and how much the sum of squares falls.
    fn by_response(
        &self,
        base: &Fit,
        response: &Response,
        effect: &dyn Effect,
        hypothesis: &Hypothesis,
        values: &[f64],
        scale: f64,
    ) -> (Vec<f64>, f64) {
        let first = base.hypothesis.x.len();
        let fitted = &hypothesis.fitted[first..];
        let parameters = effect.description().parameters;
        let places: Vec<usize> = fitted
            .iter()
            .filter_map(|f| match &f.knob {
                Knob::Effect(_, name) => parameters.iter().position(|p| p.name == *name),
                _ => None,
            })
            .collect();
        let errors = |x: &[f64]| {
            let mut theta = values.to_vec();
            for ((place, f), x) in places.iter().zip(fitted).zip(x) {
                theta[*place] = f.value(*x);
            }
            let change = response.errors_of(&response.forces(effect, &theta));
            &response.errors + response.project(change)
        };
        let x = hypothesis.x[first..].to_vec();
        let (x, squares) = crate::fit::minimise(&errors, fitted, x, scale, 8);
        let mut all = hypothesis.x.clone();
        all[first..].copy_from_slice(&x);
        (all, response.errors.norm_squared() - squares)
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

    /// Runs of a fitted model along all trajectories.
    pub fn runs(&self, fit: &Fit) -> Result<Vec<Run>, GapError> {
        let plant = fit.hypothesis.plant(&fit.hypothesis.x, &self.problem.limits, self.problem.step)?;
        let mut motion = plant.motion();
        let mut errors = Vec::new();
        let mut runs = Vec::new();
        for (trajectory, gains) in self.problem.trajectories.iter().zip(self.problem.gains(&plant)) {
            let mut run = Run { gains, ..Run::default() };
            errors.clear();
            let gains = run.gains.clone();
            observer::run(&plant, trajectory, &gains, &mut motion, &mut errors, Some(&mut run))?;
            runs.push(run);
        }
        Ok(runs)
    }

    /// What the data look like to a fitted model, by joint.
    fn views(&self, base: &Fit) -> Result<Vec<JointView>, GapError> {
        let runs = self.runs(base)?;
        Ok((0..self.names.len()).map(|j| self.view(base, &runs, j)).collect())
    }

    /// Forces that the model lacks at a joint, one for each row, with position and velocity: the change of velocity that the filter
    /// has to make, over the time of the row.
    pub fn lacking(&self, errors: &DVector<f64>, runs: &[Run], j: usize) -> Vec<[f64; 4]> {
        let mut rows = Vec::new();
        let mut at = 0;
        for (trajectory, run) in self.problem.trajectories.iter().zip(runs) {
            let gains = &run.gains;
            let n = trajectory.joints;
            for k in 0..trajectory.rows() {
                let i = k * n + j;
                // Lacking `dtau` slows: its sign is opposite to the correction's.
                let force = -self.inertias[j] * gains.acceleration(trajectory, k, j) * errors[at + i] * gains.deviation(i);
                if gains.deviation(i).is_finite() && trajectory.position[i].is_finite() {
                    rows.push([force, run.q[i], run.v[i], trajectory.time[k]]);
                }
            }
            at += trajectory.rows() * n;
        }
        rows
    }

    fn view(&self, base: &Fit, runs: &[Run], j: usize) -> JointView {
        let rows = self.lacking(&base.errors, runs, j);
        let rms = |i: usize| (rows.iter().map(|r| r[i] * r[i]).sum::<f64>() / rows.len().max(1) as f64).sqrt();
        let (low, high) = rows.iter().fold((f64::MAX, f64::MIN), |(a, b), r| (a.min(r[1]), b.max(r[1])));
        let model = &base.hypothesis.model;
        let joint = &model.joints[self.joints[j]];
        let link = &model.links[joint.child].inertial;
        // What the drive makes of its command, not the command.
        let efforts = runs.iter().flat_map(|r| r.tau.iter().skip(j).step_by(self.names.len())).filter(|u| u.is_finite());
        let p = link.p_LoLcm;
        JointView {
            force: binned(&rows, low, high).max(1e-6),
            speed: rms(2),
            range: [low, high],
            turns: joint.kind != sagci_model::JointKind::Prismatic,
            inertia: self.inertias[j],
            effort: efforts.fold(0.0, |a, u| u.abs().max(a)).max(1e-6),
            places: places(&rows, low, high),
            cycles: cycles(&rows, low, high),
            duration: self.problem.trajectories.iter().map(|t| t.time[t.rows() - 1] - t.time[0]).sum(),
            period: self.problem.trajectories.first().map_or(0.005, Trajectory::period),
            mass: link.mass,
            p_LoLcm: [p.x, p.y, p.z],
            axis: [joint.axis.x, joint.axis.y, joint.axis.z],
        }
    }
}

/// One run of the simulator with the effect where it starts, beside the `errors` of the base model by the same steps: the fall of the sum of squares along the change that it makes.
fn by_run(
    problem: &Problem<'_>,
    errors: &DVector<f64>,
    response: &Response,
    base: &Fit,
    hypothesis: &Hypothesis,
) -> Option<(Vec<f64>, f64)> {
    let change = problem.errors(hypothesis, &hypothesis.x).ok()? - errors;
    let change = response.project(change);
    let size = change.norm_squared();
    // Sizes that cannot be negative change nothing in the other direction.
    let one_sided = hypothesis.fitted[base.hypothesis.x.len()..].iter().all(|f| f.logarithmic);
    let least = if one_sided { 0.0 } else { -2.0 };
    let share = (-change.dot(&response.errors) / size).clamp(least, 2.0);
    let gain = -share * (2.0 * change.dot(&response.errors) + share * size);
    (size > 0.0).then(|| (hypothesis.x.clone(), gain))
}

/// Are the URDF's limits of a joint reached in the data?
fn reached(model: &ObjectModel, joint: usize, trajectories: &[Trajectory], column: usize) -> bool {
    let limits = &model.joints[joint].limits;
    let margin = 0.002 * limits.range().min(10.0);
    trajectories.iter().flat_map(|t| t.positions(column)).any(|y| y < limits.lower + margin || y > limits.upper - margin)
}

/// Share of a joint's way forth that it may go back, and the time over which ways are measured, s: over less, noise goes both ways.
const BACK: f64 = 0.1;
const STRIDE: f64 = 0.25;

/// Does a joint go one way only?
fn one_way(trajectories: &[Trajectory], joint: usize) -> bool {
    let (mut up, mut down) = (0.0, 0.0);
    for trajectory in trajectories {
        let stride = ((STRIDE / trajectory.period()).round() as usize).max(1);
        let seen: Vec<f64> = trajectory.positions(joint).filter(|y| y.is_finite()).step_by(stride).collect();
        for change in seen.windows(2).map(|w| w[1] - w[0]) {
            if change > 0.0 { up += change } else { down -= change }
        }
    }
    f64::min(up, down) < BACK * f64::max(up, down)
}

const BINS: usize = 40;

/// Mean lacking force in bins of position, by the sign of the velocity.
fn means(rows: &[[f64; 4]], low: f64, high: f64) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0f64; 4]; BINS];
    for [f, q, v, _] in rows {
        let bin = (((q - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
        let side = if *v < 0.0 { 2 } else { 0 };
        sums[bin][side] += f;
        sums[bin][side + 1] += 1.0;
    }
    sums.iter().map(|s| [s[0] / f64::max(s[1], 5.0), s[2] / f64::max(s[3], 5.0)]).collect()
}

/// Size of the lacking force, apart from noise.
fn binned(rows: &[[f64; 4]], low: f64, high: f64) -> f64 {
    let means = means(rows, low, high);
    (means.iter().flatten().map(|m| m * m).sum::<f64>() / (2 * BINS) as f64).sqrt()
}

/// Positions where the lacking force stands out from its neighbours.
fn places(rows: &[[f64; 4]], low: f64, high: f64) -> Vec<f64> {
    let means = means(rows, low, high);
    let mut scored: Vec<(f64, usize)> = (0..BINS)
        .map(|b| {
            let around = |side: usize| (0..BINS).filter(|c| c.abs_diff(b) > 2).map(|c| means[c][side]).sum::<f64>() / (BINS - 5) as f64;
            ((means[b][0] - around(0)).abs().max((means[b][1] - around(1)).abs()), b)
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut chosen: Vec<usize> = Vec::new();
    for (_, b) in scored {
        if chosen.iter().all(|c| c.abs_diff(b) > 3) {
            chosen.push(b);
        }
    }
    chosen.iter().map(|b| low + (high - low) * (*b as f64 + 0.5) / BINS as f64).collect()
}

/// Cycles a turn at which the lacking force repeats over position.
fn cycles(rows: &[[f64; 4]], low: f64, high: f64) -> Vec<f64> {
    let range = high - low;
    if rows.is_empty() || range.is_nan() || range <= 0.0 {
        return Vec::new();
    }
    // From two periods over the range to what 400 bins can show.
    let mut sums = vec![[0.0f64; 2]; 400];
    for [f, q, _, _] in rows {
        let bin = (((q - low) / range * 400.0) as usize).min(399);
        sums[bin][0] += f;
        sums[bin][1] += 1.0;
    }
    let mean = sums.iter().map(|s| s[0]).sum::<f64>() / sums.iter().map(|s| s[1]).sum::<f64>();
    let values: Vec<f64> = sums.iter().map(|s| if s[1] > 0.0 { s[0] / s[1] - mean } else { 0.0 }).collect();
    let power = |periods: f64| {
        let (mut a, mut b) = (0.0, 0.0);
        for (i, x) in values.iter().enumerate() {
            let angle = TAU * periods * (i as f64 + 0.5) / 400.0;
            a += x * angle.cos();
            b += x * angle.sin();
        }
        a * a + b * b
    };
    let grid: Vec<(f64, f64)> = (0..800).map(|i| 2.0 + 0.1 * i as f64).map(|p| (power(p), p)).collect();
    let mut peaks: Vec<(f64, f64)> = grid.windows(3).filter(|w| w[1].0 >= w[0].0 && w[1].0 > w[2].0).map(|w| w[1]).collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.iter().take(3).map(|(_, p)| p * TAU / range).collect()
}

/// Effects among the numbers of a hypothesis, with their entries.
pub(crate) fn entries(hypothesis: &Hypothesis) -> Vec<usize> {
    let mut found: Vec<usize> = hypothesis.fitted[hypothesis.known..]
        .iter()
        .filter_map(|f| match f.knob {
            Knob::Effect(e, _) => Some(e),
            _ => None,
        })
        .collect();
    found.dedup();
    found
}
