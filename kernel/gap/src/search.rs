//! Which effect is missing: starts from everything the catalogue offers, exact fits of the best, and their evidence.

use std::collections::{BTreeMap, BTreeSet};
use std::iter;

use nalgebra::{DVector, Point3};
use rayon::prelude::*;
use sagci_dynamics::effects;
use sagci_model::ObjectModel;
use sagci_recording::Series;

use crate::GapError;
use crate::fit::{Derivatives, Effort, Fit, Problem, told};
use crate::hypothesis::{Fitted, Hypothesis};
use crate::memory::Memory;
use crate::noise;
use crate::observer::{Disturbance, Run};
use crate::plant::Plant;
use crate::screen::{NEAR, Screened};
use crate::starts::{JointView, Seen, neighbours, observable};
use crate::stops::{self, Stops};
use crate::trajectory::{Drive, Trajectory, joint_names};
use crate::weigh::CONVINCING;

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
#[derive(Debug, Clone)]
pub(crate) struct Search<'a> {
    pub problem: Problem<'a>,
    /// Names of the degrees of freedom, and the model's joints.
    pub names: Vec<String>,
    pub joints: Vec<usize>,
    pub inertias: Vec<f64>,
    pub seen: Vec<Seen>,
    /// Joints that stand in each of the recordings, if not in the same place: nothing is looked for on them.
    pub still: Vec<bool>,
    /// Noises as the data say by themselves, before any model: of efforts all that changes from row to row.
    pub of_data: Disturbance,
    /// How much efforts accelerate joints of the model as given, by columns.
    pub mobility: Vec<f64>,
    /// What was predicted over windows of these data.
    pub memory: Memory,
}

/// Share of the motion's accelerations that no model has.
pub(crate) const FLOOR: f64 = 0.01;
/// Longest step while searching, s.
pub(crate) const STEP: f64 = 2.5e-3;
/// Effects of one stage that are fitted to the end.
const FINALISTS: usize = 6;
/// And those of them that are fitted over all data, where a part of these has been asked.
const FEWER: usize = 4;
/// Share of the evidence that an effect may be behind the best one over a part of the data, to be fitted over all of them.
const FAR: f64 = 0.05;
/// Scale of the errors, in their deviations, up to which a fit explains all but noise.
pub(crate) const EXPLAINED: f64 = 1.1;
/// Standard deviations of its prior by which a known number has been led astray by what is missing.
const LED_ASTRAY: f64 = 0.5;
/// Of how many of the best a neighbour begins where they end.
const NEIGHBOURS: usize = 3;
/// Joints on each of which everything is tried, and derivatives are taken from runs.
const FEW: usize = 2;
/// How often derivatives of the known numbers are taken in the linear response, and the share of the errors' squares that is no progress.
const ROUNDS: usize = 6;
const TRIFLE: f64 = 1e-3;
/// Steps of a first fit in the simulator, and those after which one of an effect's starts is chosen on an arm.
pub(crate) const QUICK: usize = 5;
/// How many beginnings beside a fitted neighbour are all followed.
const MANY: usize = 4;
/// How many starts of an effect go on after the first look.
const AHEAD: usize = 2;
const LOOK: usize = 2;
/// How often one goes on that comes nearer by as much as it is behind.
const PERSISTENT: usize = 4;
/// Share of a gain that is asked for below which nothing is fitted to the end.
const HALF_WAY: f64 = 0.5;
/// An effect that after the first rounds in the simulator explains less than this share of what the best one explains is not looked at
/// further.
const CLOSE: f64 = 0.8;
/// What a screen has to promise of an effect, that it is fitted in all data where a part of them shows less of it than such a share of what is to
/// be expected there.
const SELDOM: f64 = 100.0;
const HIDDEN: f64 = 0.2;

impl<'a> Search<'a> {
    pub fn new(model: &ObjectModel, trajectories: &'a [Trajectory]) -> Result<Self, GapError> {
        Self::beside(model, trajectories, &[], &mut Vec::new())
    }

    /// The same, where others are predicted as well: no limit is kept that these go past. Says which those are.
    pub fn beside(
        model: &ObjectModel,
        trajectories: &'a [Trajectory],
        others: &[Trajectory],
        notes: &mut Vec<String>,
    ) -> Result<Self, GapError> {
        let names = joint_names(model)?;
        let joints: Vec<usize> = model.moving_joints().collect();
        let n = names.len();
        let limits: Vec<Stops> = (0..n).map(|j| stops::kept(model, (joints[j], j), trajectories, others, notes)).collect();
        let known = Hypothesis::known(model, &joints);
        let given = known.plant(&known.x, &limits, STEP)?;
        let inverse = given.inverse_mass_at(&noise::middle(trajectories, n));
        let inertias: Vec<f64> = (0..n).map(|j| 1.0 / inverse[j * n + j]).collect();
        let typical = noise::accelerations(trajectories, &inertias);
        let weights = weights(&given, trajectories, n);
        let disturbance = Disturbance {
            position: (0..n).map(|j| noise::of_positions(trajectories, j)).collect(),
            share: vec![FLOOR; n],
            quiet: typical.iter().map(|a| noise::QUIET * a).collect(),
            effort: (0..n).map(|j| noise::of_efforts(trajectories, j)).collect(),
            reading: (0..n).map(|j| noise::of_readings(trajectories, j)).collect(),
        };
        let of_data = disturbance.clone();
        let any = |test: &dyn Fn(Drive) -> bool, j: usize| trajectories.iter().any(|t| test(t.drive[j]));
        let seen = (0..n)
            .map(|j| Seen {
                commanded: any(&|d| matches!(d, Drive::Command(_)), j),
                read: disturbance.reading[j] > 0.0,
                one_way: one_way(trajectories, j),
                weighed: weights[j] > WEIGHTLESS * typical[j] * inertias[j],
            })
            .collect();
        let problem = Problem::new(trajectories, disturbance, &limits, STEP);
        let still = (0..n).map(|j| trajectories.iter().all(|t| !moves(t, j))).collect();
        Ok(Self { mobility: problem.mobility(&given), problem, seen, still, names, joints, inertias, of_data, memory: Memory::default() })
    }

    /// The model as given, its known numbers refitted.
    pub fn known(&self, model: &ObjectModel, scale: f64) -> Result<Fit, GapError> {
        let Some(part) = self.part(scale).filter(|_| self.many_joints()) else {
            let fit = self.in_response(Hypothesis::known(model, &self.joints), scale, TRIFLE)?;
            return if self.many_joints() { Ok(self.judge(fit)) } else { self.fit_on(fit, scale) };
        };
        let light = self.over(&part.trajectories).lightly(self.problem.has_short_rows());
        let begun = light.in_response(Hypothesis::known(model, &self.joints), scale, TRIFLE)?;
        self.refit(&begun, scale)
    }

    /// Known numbers fitted by derivatives in the linear response, those that the data can tell, until these bring no more than such a share of the
    /// errors' squares.
    pub fn in_response(&self, known: Hypothesis, scale: f64, trifle: f64) -> Result<Fit, GapError> {
        let mut fit = Fit::start(&self.problem, known)?;
        fit.jacobian = self.derivatives_by_known(&fit)?;
        let hypothesis = fit.hypothesis.condensed(&fit.jacobian, scale);
        let column = |f: &Fitted| fit.hypothesis.fitted.iter().position(|all| all.knob == f.knob).map(|i| fit.jacobian[i].clone());
        let jacobian = hypothesis.fitted.iter().filter_map(column).collect();
        let mut fit = Fit { hypothesis, jacobian, ..fit };
        for _ in 0..ROUNDS {
            let (before, all) = (fit.squares, fit.jacobian.clone());
            fit = fit.improve(&self.problem, scale, Effort::new(QUICK, 0.5), Derivatives { frozen: Some(&all), ..Derivatives::FRESH })?;
            if before - fit.squares < trifle * before {
                break;
            }
            fit.jacobian = self.derivatives_by_known(&fit)?;
        }
        Ok(fit)
    }

    /// A fit as it is compared with others.
    pub fn judge(&self, fit: Fit) -> Fit {
        Fit { judged: self.problem.judged(&fit, &self.mobility), ..fit }
    }

    /// How much larger the errors are than the noises make them, those of positions or those of efforts; at least one.
    pub fn scale(&self, fit: &Fit) -> f64 {
        let (positions, efforts) = (self.problem.positions(), self.problem.efforts());
        let of_positions = fit.errors.rows(0, self.problem.entries()).norm_squared();
        let mean = |squares: f64, count: usize| squares / count.max(1) as f64;
        mean(of_positions, positions).max(mean(fit.squares - of_positions, efforts)).max(1.0).sqrt()
    }

    /// The same, no smaller than by the errors by which models are compared: a model in which a joint sticks says of its own that they weigh nothing.
    pub fn scale_as_judged(&self, fit: &Fit) -> f64 {
        self.scale(fit) * (fit.judged / fit.squares.max(f64::MIN_POSITIVE)).max(1.0).sqrt()
    }

    /// Logarithm of a fit's evidence, with the errors by which models are compared.
    pub fn evidence(&self, fit: &Fit, scale: f64) -> f64 {
        fit.evidence(fit.judged, scale)
    }

    /// The same with the errors that the fit itself made small.
    pub fn evidence_in_fit(&self, fit: &Fit, scale: f64) -> f64 {
        fit.evidence(fit.squares, scale)
    }

    /// Are there so many joints that what is done for each has to be little?
    pub fn many_joints(&self) -> bool {
        self.names.len() > FEW
    }

    /// One more effect on top of a fit: all that the catalogue offers, the most likely first.
    pub fn stage(&self, base: &Fit, scale: f64) -> Result<Vec<Candidate>, GapError> {
        self.stage_within(base, scale, usize::MAX, 0.0)
    }

    /// The same of effects with so many numbers at the most. What cannot be hoped to gain so much evidence is not followed far.
    pub fn stage_within(&self, base: &Fit, scale: f64, most: usize, gain: f64) -> Result<Vec<Candidate>, GapError> {
        let views = self.views(base, scale)?;
        let part = self.part(scale);
        let rough = self.problem.has_short_rows();
        let mut all = match &part {
            _ if !self.many_joints() && (rough || part.is_some() || self.problem.step < STEP) => {
                let light = self.over(part.as_ref().map_or(self.problem.trajectories, |part| &part.trajectories)).lightly(rough);
                let there = part.as_ref().map_or_else(|| base.under(&light.problem), |part| part.of(&light, base))?;
                let exact = part.as_ref().map_or_else(|| base.errors.clone(), |part| part.pick(&base.errors));
                // What is visited seldom, or shows a little, is seen in all of them.
                let screened = self.screen(base, &views, scale, most)?;
                self.ended(base, self.begun_lightly(base, &views, (&light, &there, Some(exact)), screened, scale, gain), scale, gain)
            }
            None => self.ended(base, self.begun(base, &views, self.screen(base, &views, scale, most)?, scale, gain), scale, gain),
            Some(part) => {
                let light = self.over(&part.trajectories);
                let base_there = part.of(&light, base)?;
                let screened = light.screen(&base_there, &views, scale, most)?;
                let share = light.share_of(self);
                let begun = if rough {
                    let lighter = light.clone().lightly(rough);
                    let there = base_there.under(&lighter.problem)?;
                    light.begun_lightly(&base_there, &views, (&lighter, &there, None), screened, scale, gain * share)
                } else {
                    light.begun(&base_there, &views, screened, scale, gain * share)
                };
                let (first, _) = light.divided(&base_there, begun, scale);
                let mut all = light.finished(&base_there, first, scale);
                light.rank(&mut all, scale);
                let best = all.first().map_or(0.0, |c| c.evidence);
                // Where the best explains all but noise, none that is far behind it comes before it elsewhere.
                let rest = all.first().is_some_and(|c| light.scale(&c.fit) > EXPLAINED);
                let far = if rest { FAR * (best - light.evidence(&base_there, scale)) } else { 0.0 };
                let behind = f64::max(NEAR * share, far);
                all.truncate(all.iter().take(FEWER).take_while(|c| c.evidence > best - behind).count().max(2));
                let whole = |c: Candidate, bar: f64| Some(Candidate { fit: self.refit_beside(base, &c.fit, scale, bar).ok()?, ..c });
                // What promises nothing is seen as all data see it, and not fitted to them.
                let (hopeful, hopeless): (Vec<_>, Vec<_>) =
                    all.into_iter().partition(|c| light.promised(&base_there, &c.fit, share, scale) > 0.0);
                let mut all = self.first_first(base, hopeful, scale, whole);
                all.extend(hopeless.into_par_iter().filter_map(|c| self.carried(base, c, scale)).collect::<Vec<_>>());
                all
            }
        };
        all.retain(|c| self.is_shaped(&c.fit));
        all = all.into_par_iter().map(|c| Candidate { fit: self.judge(c.fit), ..c }).collect();
        self.rank(&mut all, scale);
        self.ask_neighbours(base, &views, &mut all, scale);
        Ok(all)
    }

    /// The same in steps that are no shorter than need be where nothing is known yet, and to first order where that does.
    pub fn lightly(mut self, rough: bool) -> Self {
        (self.problem.step, self.problem.rough) = (STEP, rough);
        self
    }

    /// The same, where the errors of a fit are known otherwise: what light steps, and stretches that begin anew, make of them is taken off all errors.
    /// Fits would go after it, each as far as its numbers let it (Stetter 1978, defect correction). It is that of the fit, and of others as far as
    /// these are near.
    fn set_right(&self, fit: &Fit, errors: DVector<f64>) -> (Self, Fit) {
        let mut right = self.clone();
        right.problem.defect = Some(&errors - &fit.errors);
        let squares = errors.norm_squared();
        (right, Fit { errors, squares, judged: squares, ..fit.clone() })
    }

    /// First fits over a part of the data or in longer steps, as all of them see what these come to; over all of them of what the part shows much
    /// less of than its share, and of what it shows most of and all of them do not: of a mode stretches that begin at rest are led astray. The lighter
    /// search comes with its fit of the base, and the errors that this has in all data and exact steps, where fits begin set right by these, too.
    fn begun_lightly(
        &self,
        base: &Fit,
        views: &[JointView],
        (light, there, exact): (&Search<'_>, &Fit, Option<DVector<f64>>),
        screened: Vec<Screened>,
        scale: f64,
        gain: f64,
    ) -> Vec<Candidate> {
        let share = light.share_of(self);
        let gains = |candidates: &[Candidate], here: f64| -> BTreeMap<(&str, Option<usize>), f64> {
            candidates.iter().map(|c| ((c.effect, c.joint), c.evidence - here)).collect()
        };
        let begin = |light: &Search<'_>, there: &Fit| light.begun(there, views, screened.clone(), scale, gain * share);
        // Far from the base, where much is missing, its own light errors say nothing; near it they are much of what is left.
        let right = exact.filter(|exact| 0.5 * (exact - &there.errors).norm_squared() > CONVINCING * scale * scale);
        let right = right.map(|exact| light.set_right(there, exact));
        let mut begun = right.as_ref().map_or_else(Vec::new, |(light, there)| begin(light, there));
        let plain = begin(light, there);
        let shown = match &right {
            Some((light, there)) => gains(&begun, light.evidence(there, scale)),
            None => gains(&plain, light.evidence(there, scale)),
        };
        begun.extend(plain);
        let most = shown.values().copied().fold(0.0, f64::max);
        let mut begun: Vec<Candidate> = begun.into_par_iter().filter_map(|c| self.carried(base, c, scale)).collect();
        begun.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        one_of_each(&mut begun);
        let kept = gains(&begun, self.evidence(base, scale));
        let again = |s: &Screened| {
            let of = |gains: &BTreeMap<_, f64>| gains.get(&(s.effect, s.joint)).copied().unwrap_or(f64::NEG_INFINITY);
            let (shown, kept) = (of(&shown), of(&kept));
            s.worth > SELDOM && shown < HIDDEN * share * s.worth || shown > (CLOSE * most).max(SELDOM) && kept < HIDDEN * shown / share
        };
        begun.extend(self.begun(base, views, screened.into_iter().filter(again).collect(), scale, gain));
        begun.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        one_of_each(&mut begun);
        begun
    }

    /// Where the fit of the best has come to its end, its neighbours begin there as well: where they began beside its own beginning they may have
    /// been lost, which is no reason to lose them.
    pub fn ask_neighbours(&self, base: &Fit, views: &[JointView], all: &mut Vec<Candidate>, scale: f64) {
        let Some(best) = all.first().cloned() else { return };
        // Of a name's shapes but one has been kept.
        let is_near = |name: &str, joint: usize| {
            let near = |c: &Candidate| c.effect == name && c.joint == Some(joint) && c.evidence > best.evidence - NEAR;
            (name, Some(joint)) != (best.effect, best.joint) && all.iter().any(near)
        };
        let begins = self.neighbours_of(base, views, &best);
        let begins: Vec<_> = begins.into_iter().filter(|(name, joint, _)| !is_near(name, *joint)).collect();
        let ended = |(effect, joint, hypothesis): (&'static str, usize, Hypothesis)| {
            let begun = Fit::start(&self.problem, hypothesis).ok()?;
            let fit = self.refit_beside(base, &begun, scale, best.evidence).ok()?;
            let evidence = self.evidence(&fit, scale);
            // Another shape of the same name has to say more by more than chance: how large noises are is not known yet.
            let is_itself = (effect, Some(joint)) == (best.effect, best.joint);
            let asked = if is_itself { best.evidence + CONVINCING } else { f64::NEG_INFINITY };
            let holds = evidence.is_finite() && evidence > asked && self.is_shaped(&fit);
            holds.then_some(Candidate { effect, joint: Some(joint), fit, evidence })
        };
        let more: Vec<Candidate> = begins.into_par_iter().filter_map(ended).collect();
        if more.is_empty() {
            return;
        }
        all.extend(more);
        self.rank(all, scale);
        one_of_each(all);
    }

    /// Where neighbours of a fitted candidate begin, by their own equations, each on its joint.
    fn neighbours_of(&self, base: &Fit, views: &[JointView], candidate: &Candidate) -> Vec<(&'static str, usize, Hypothesis)> {
        let hypothesis = &candidate.fit.hypothesis;
        let (Some(j), Some(entry)) = (candidate.joint, hypothesis.model_at(&hypothesis.x).document.effects.pop()) else {
            return Vec::new();
        };
        let Ok((_, values)) = effects::parameters_of(&entry) else { return Vec::new() };
        let begin = |(name, on, values): (&'static str, usize, Vec<f64>)| {
            let n = base.hypothesis.x.len();
            let mut begun = base.hypothesis.with(name, Some(&self.names[on]), &values).ok()?;
            // Without any effect the known numbers were led astray; beside this one they are where they will be beside its neighbour.
            begun.x[..n].copy_from_slice(&hypothesis.x[..n]);
            Some((name, on, begun.confined(n, views[on].range, views[on].way())))
        };
        let here = neighbours(candidate.effect, &values, &views[j]).into_iter().map(|(name, values)| (name, j, values));
        let load = candidate.effect == "payload" && self.many_joints();
        let beside = if load { self.carried_by_links_beside(&hypothesis.model, j, &values) } else { Vec::new() };
        let all = here.chain(beside.into_iter().map(|(on, values)| ("payload", on, values)));
        self.nearest(all.filter(|(name, on, _)| observable(name, self.seen[*on])).filter_map(begin).collect())
    }

    /// Of beginnings of one effect those that are nearest as they stand, where there are many.
    fn nearest(&self, begins: Vec<(&'static str, usize, Hypothesis)>) -> Vec<(&'static str, usize, Hypothesis)> {
        let mut places: BTreeMap<(&'static str, usize), Vec<Hypothesis>> = BTreeMap::new();
        for (name, on, hypothesis) in begins {
            places.entry((name, on)).or_default().push(hypothesis);
        }
        let far = |hypothesis: &Hypothesis| self.problem.errors(hypothesis, &hypothesis.x).map_or(f64::INFINITY, |e| e.norm_squared());
        let few = |((name, on), mut begins): ((&'static str, usize), Vec<Hypothesis>)| {
            if begins.len() > MANY {
                let mut by_squares: Vec<_> = begins.into_par_iter().map(|begun| (far(&begun), begun)).collect();
                by_squares.sort_by(|a, b| a.0.total_cmp(&b.0));
                begins = by_squares.into_iter().take(AHEAD).map(|(_, begun)| begun).collect();
            }
            begins.into_iter().map(move |begun| (name, on, begun))
        };
        places.into_iter().flat_map(few).collect()
    }

    /// The same load where it is with the joints as they mostly are, but carried by the link before or after: which of them carries it their motion
    /// alone tells, and a first look at its weight does not.
    fn carried_by_links_beside(&self, model: &ObjectModel, j: usize, load: &[f64]) -> Vec<(usize, Vec<f64>)> {
        let &[mass, x, y, z] = load else { return Vec::new() };
        let q = noise::middle(self.problem.trajectories, self.names.len());
        let joint = |slot: usize| &model.joints[self.joints[slot]];
        let place = |other: usize| {
            let p_LoP = Point3::new(x, y, z);
            let p = if joint(other).parent == joint(j).child {
                model.X_PC(self.joints[other], q[other]).inverse() * p_LoP
            } else if joint(j).parent == joint(other).child {
                model.X_PC(self.joints[j], q[j]) * p_LoP
            } else {
                return None;
            };
            Some((other, vec![mass, p.x, p.y, p.z]))
        };
        (0..self.names.len()).filter_map(place).collect()
    }

    /// First fits in the simulator of what the screens leave, the best of each effect on each joint, the most likely first.
    fn begun(&self, base: &Fit, views: &[JointView], screened: Vec<Screened>, scale: f64, gain: f64) -> Vec<Candidate> {
        let known = Derivatives { frozen: Some(&base.jacobian), ..Derivatives::ROUGH };
        let effort = |rounds: usize| Effort { bar: self.evidence(base, scale) + gain, ..Effort::new(rounds, 0.5) };
        let first = |effect: &'static str, joint: Option<usize>, hypothesis: Hypothesis, rounds: usize| {
            let mut fit = Fit::start(&self.problem, hypothesis).ok()?;
            // Judged at the end; until then beside the base.
            fit.judged = base.judged + fit.squares - base.squares;
            let known = if self.many_joints() || fit.hypothesis.x.starts_with(&base.hypothesis.x) { known } else { Derivatives::ROUGH };
            let fit = fit.improve(&self.problem, scale, effort(rounds), known).ok()?;
            let evidence = self.evidence(&fit, scale);
            evidence.is_finite().then_some((Candidate { effect, joint, fit, evidence }, known))
        };
        let best = |candidates: &mut Vec<Candidate>| {
            candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
            one_of_each(candidates);
        };
        let mut begins: Vec<(&str, Option<usize>, Hypothesis)> = Vec::new();
        for Screened { effect, joint, hypothesis, .. } in screened {
            // Losses of an arm's other joints are what their own data say.
            let own = joint.filter(|_| self.many_joints()).map(|j| self.joints[j]);
            begins.extend(hypothesis.as_given(LED_ASTRAY, own).map(|given| (effect, joint, given)));
            let bodies = if self.many_joints() { None } else { hypothesis.bodies_as_given() };
            begins.extend(bodies.map(|given| (effect, joint, given)));
            begins.push((effect, joint, hypothesis));
        }
        let mut begun: Vec<_> = begins.into_par_iter().filter_map(|(e, j, h)| first(e, j, h, LOOK)).collect();
        // Most starts of an effect come to one end: those that are ahead go on, where the derivatives that led them there nearly hold.
        begun.sort_by(|(a, _), (b, _)| b.evidence.total_cmp(&a.evidence));
        let mut places: BTreeMap<(&str, Option<usize>), usize> = BTreeMap::new();
        let ahead = if self.many_joints() { 1 } else { AHEAD };
        begun.retain(|(c, _)| {
            let place = places.entry((c.effect, c.joint)).or_default();
            *place += 1;
            *place <= ahead
        });
        let here = self.evidence(base, scale);
        let go_on = |(mut c, known): (Candidate, Derivatives<'_>)| {
            let mut begin = Derivatives { kept: true, ..known };
            for rounds in iter::once(QUICK - LOOK).chain(iter::repeat_n(QUICK, PERSISTENT)) {
                let before = c.evidence;
                c.fit = c.fit.improve(&self.problem, scale, effort(rounds), begin).ok()?;
                c.evidence = self.evidence(&c.fit, scale);
                begin = known;
                // What still comes nearer by as much as it is behind has begun far from where it ends.
                if c.evidence > here - NEAR || c.evidence - before < here - c.evidence {
                    break;
                }
            }
            c.evidence.is_finite().then_some(c)
        };
        let mut begun: Vec<Candidate> = begun.into_par_iter().filter_map(go_on).collect();
        best(&mut begun);
        let beside = |c: &Candidate| -> Vec<Candidate> {
            let begin = |(name, joint, hypothesis)| Some(first(name, Some(joint), hypothesis, QUICK)?.0);
            self.neighbours_of(base, views, c).into_iter().filter_map(begin).collect()
        };
        let more: Vec<Candidate> = begun.par_iter().take(NEIGHBOURS).flat_map_iter(beside).collect();
        begun.extend(more);
        best(&mut begun);
        begun
    }

    /// A candidate that was begun over a part of the data, as all of them see it: there an effect whose inner state is not known where a stretch
    /// begins is judged fairly. Numbers of the base that have left it to suit the part go back to it, if that suits all of them better.
    pub fn carried(&self, base: &Fit, candidate: Candidate, scale: f64) -> Option<Candidate> {
        let mut back = candidate.fit.hypothesis.clone();
        back.x[..base.hypothesis.x.len()].copy_from_slice(&base.hypothesis.x);
        let begun = [candidate.fit.hypothesis, back].into_iter().filter_map(|hypothesis| Fit::start(&self.problem, hypothesis).ok());
        let mut fit = begun.min_by(|a, b| a.squares.total_cmp(&b.squares))?;
        fit.judged = base.judged + fit.squares - base.squares;
        fit.differentiate(&self.problem, true, Some(&base.jacobian)).ok()?;
        let evidence = self.evidence(&fit, scale);
        evidence.is_finite().then_some(Candidate { fit, evidence, ..candidate })
    }

    /// What is to be fitted to the end, and the rest.
    fn divided(&self, base: &Fit, mut begun: Vec<Candidate>, scale: f64) -> (Vec<Candidate>, Vec<Candidate>) {
        let fall = |c: &Candidate| base.squares - c.fit.squares;
        let most = begun.first().map_or(0.0, fall);
        // What an exact fit has not brought near the base model's evidence yet will not be convincing.
        let here = self.evidence(base, scale);
        let hope = |c: &&Candidate| fall(c) > CLOSE * most && c.evidence > here - NEAR;
        let hopeful = begun.iter().take(FINALISTS).take_while(hope).count().max(2);
        let rest = begun.split_off(hopeful.min(begun.len()));
        (begun, rest)
    }

    /// All that was begun, what has hope fitted to the end; nothing where all are far from a gain in evidence that is asked for.
    fn ended(&self, base: &Fit, begun: Vec<Candidate>, scale: f64, gain: f64) -> Vec<Candidate> {
        let here = self.evidence(base, scale);
        if gain > 0.0 && begun.iter().all(|c| c.evidence - here < HALF_WAY * gain) {
            return begun;
        }
        let (first, rest) = self.divided(base, begun, scale);
        let mut all = self.finished(base, first, scale);
        all.extend(rest);
        all
    }

    /// Fits to the end where they stand.
    fn finished(&self, base: &Fit, candidates: Vec<Candidate>, scale: f64) -> Vec<Candidate> {
        let begin = Derivatives { frozen: Some(&base.jacobian), ..Derivatives::ROUGH };
        self.first_first(base, candidates, scale, |mut candidate: Candidate, bar: f64| {
            candidate.fit.judged = base.judged + candidate.fit.squares - base.squares;
            let fit = candidate.fit.finish(&self.problem, scale, begin, Effort::to_the_end(bar)).ok()?;
            Some(Candidate { fit, ..candidate })
        })
    }

    /// Fits candidates, the first of them first: what stays far behind it, its bar, need not be fitted to the end.
    fn first_first(
        &self,
        base: &Fit,
        mut candidates: Vec<Candidate>,
        scale: f64,
        fit: impl Fn(Candidate, f64) -> Option<Candidate> + Sync,
    ) -> Vec<Candidate> {
        let here = self.evidence(base, scale);
        let behind = candidates.split_off(1.min(candidates.len()));
        let mut fitted: Vec<Candidate> = candidates.into_iter().filter_map(|c| fit(c, here)).collect();
        let bar = fitted.first().map_or(here, |c| self.evidence(&c.fit, scale).max(here));
        fitted.extend(behind.into_par_iter().filter_map(|c| fit(c, bar)).collect::<Vec<_>>());
        fitted
    }

    /// Runs of a fitted model along all trajectories.
    pub fn runs(&self, fit: &Fit) -> Result<Vec<Run>, GapError> {
        let mut plant = fit.hypothesis.plant(&fit.hypothesis.x, &self.problem.limits, self.problem.step)?;
        plant.told = told(&self.problem.disturbance.position, self.problem.period);
        Ok(self.problem.followed(&plant)?.1)
    }
}

/// Keeps the first of each effect on each joint.
fn one_of_each(candidates: &mut Vec<Candidate>) {
    let mut seen = BTreeSet::new();
    candidates.retain(|c| seen.insert((c.effect, c.joint)));
}

/// Does a joint move by more than its noise?
fn moves(trajectory: &Trajectory, joint: usize) -> bool {
    Series { time: Vec::new(), value: trajectory.positions(joint).filter(|y| y.is_finite()).collect() }.moves()
}

/// Share of the joint's typical force below which gravity does not move it, and positions of each trajectory at which such is asked.
const WEIGHTLESS: f64 = 1e-3;
const ASKED: usize = 50;

/// Some of the positions where the data are.
pub(crate) fn some_positions(trajectories: &[Trajectory], joints: usize) -> impl Iterator<Item = &[f64]> {
    trajectories.iter().flat_map(move |trajectory| {
        let rows = trajectory.position.chunks_exact(joints).filter(|q| q.iter().all(|x| x.is_finite()));
        rows.step_by((trajectory.rows() / ASKED).max(1))
    })
}

/// Largest effort of gravity on each joint where the data are, N m or N.
fn weights(plant: &Plant, trajectories: &[Trajectory], joints: usize) -> Vec<f64> {
    let mut most = vec![0.0f64; joints];
    for q in some_positions(trajectories, joints) {
        most.iter_mut().zip(plant.weights_at(q)).for_each(|(m, w)| *m = m.max(w.abs()));
    }
    most
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

/// Effects among the numbers of a hypothesis, with their entries.
pub(crate) fn entries(hypothesis: &Hypothesis) -> Vec<usize> {
    let mut found: Vec<usize> = hypothesis.fitted[hypothesis.known..].iter().filter_map(|f| f.knob.entry()).collect();
    found.dedup();
    found
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::Point3;
    use sagci_model::{JointKind, ObjectModel};
    use sagci_recording::{JointLog, Log, Series};

    use super::{QUICK, Search};
    use crate::fit::{Derivatives, Effort, Fit};
    use crate::noise;
    use crate::plant_tests::{double_pendulum, flung};
    use crate::screen::Screened;
    use crate::tests::{door, swing, with};
    use crate::trajectory::Trajectory;

    /// A screen sees a load's weight, which the link before bears as well: a load of half a kilogram was found on the wrong side of a wrist.
    #[test]
    fn a_load_begins_on_the_links_beside_where_it_is() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
        let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
        let mut model = ObjectModel::read(folder.join(head.trim())).unwrap();
        let arm: Vec<String> = model.document.robot.as_ref().unwrap().arm_joints.clone();
        model.joints.iter_mut().filter(|j| !arm.contains(&j.name)).for_each(|j| (j.kind, j.mimic) = (JointKind::Fixed, None));
        let time: Vec<f64> = (0..600).map(|k| 0.005 * f64::from(k)).collect();
        let joint = |(i, name): (usize, &String)| {
            let value = time.iter().map(|t| 0.3 * i as f64 - 1.2 + 0.2 * (2.0 * t + i as f64).sin()).collect();
            JointLog { name: name.clone(), position: Series { time: time.clone(), value }, ..JointLog::default() }
        };
        let log = Log { source: "arm.csv".into(), joints: arm.iter().enumerate().map(joint).collect(), ..Log::default() };
        let data = [Trajectory::new(&log, &model).unwrap()];
        let search = Search::new(&model, &data).unwrap();
        let q = noise::middle(&data, arm.len());
        let in_world = |slot: usize, p: &[f64]| {
            let X_OL = model.X_OL(&q);
            X_OL[model.joints[search.joints[slot]].child] * Point3::new(p[0], p[1], p[2])
        };
        let load = [0.5, 0.01, -0.02, 0.1];
        let beside = search.carried_by_links_beside(&model, 5, &load);
        assert_eq!(beside.iter().map(|b| b.0).collect::<Vec<_>>(), [4, 6]);
        for (slot, values) in beside {
            assert_eq!(values[0], 0.5);
            assert!((in_world(slot, &values[1..]) - in_world(5, &load[1..])).norm() < 1e-9, "{slot}");
        }
    }

    /// What first order alone makes of errors was fitted as if it were missing: any name gained by it, and a wrong one the most.
    #[test]
    fn light_steps_lend_nothing_to_a_name() {
        let folder = tempfile::tempdir().unwrap();
        let model = double_pendulum(folder.path());
        let data = [Trajectory::new(&flung(&model, [6.0, 4.0]), &model).unwrap()];
        let search = Search::new(&model, &data).unwrap();
        let base = search.known(&model, 1.0).unwrap();
        let loss = base.hypothesis.with("viscous_friction", Some("elbow"), &[1e-4]).unwrap();
        let gain = |light: &Search<'_>, there: &Fit| {
            let fit = Fit::start(&light.problem, loss.clone()).unwrap();
            let fit = fit.improve(&light.problem, 1.0, Effort::new(QUICK, 0.5), Derivatives::ROUGH).unwrap();
            light.evidence_in_fit(&fit, 1.0) - light.evidence_in_fit(there, 1.0)
        };
        let light = search.over(&data).lightly(true);
        let there = base.under(&light.problem).unwrap();
        let lent = gain(&light, &there);
        let (light, there) = light.set_right(&there, base.errors.clone());
        let left = gain(&light, &there);
        assert!(lent > 100.0 && left < 10.0, "{lent} in light steps, {left} set right");
    }

    /// A start that was far from where it ends was left while it came nearer tenfold with each few steps, and another name stood in its place.
    #[test]
    fn a_start_far_from_its_end_is_not_left_while_it_comes_nearer() {
        let truth = with(&door(), "joint_spring", &[("stiffness", 0.05), ("rest_position", 0.7)]);
        let data = [Trajectory::new(&swing(&truth, 2e-4, 1), &door()).unwrap()];
        let search = Search::new(&door(), &data).unwrap();
        let base = search.known(&door(), 1.0).unwrap();
        let views = search.views(&base, 1.0).unwrap();
        let hypothesis = base.hypothesis.with("joint_spring", Some("hinge"), &[20.0, 0.7]).unwrap();
        let far = Screened { effect: "joint_spring", joint: Some(0), hypothesis, worth: 1e3, held: 1e3, linear: false, plain: true };
        let begun = search.begun(&base, &views, vec![far], 1.0, 0.0);
        let gain = |c: &super::Candidate| c.evidence - search.evidence(&base, 1.0);
        let spring = begun.iter().find(|c| c.effect == "joint_spring").unwrap();
        assert!(gain(spring) > 10.0, "{}", gain(spring));
    }
}
