//! Least squares over prediction errors: Levenberg and Marquardt's method with priors and bounds.
//!
//! ```text
//! minimise  1/2 sum_i e_i(x)^2 / s^2  +  1/2 sum_p ((x_p - m_p) / d_p)^2
//! ```
//!
//! `e` are normalised prediction errors, `s` how much larger they are than the noises alone would make them, `m` and `d` the priors.
//! Derivatives are differences of whole runs: they hold for everything that a model can say, inner states and drives included. A run for
//! each number is most of what a fit costs, so they are taken seldom: after a step that did what was foretold they are set right along
//! it alone (Broyden 1965, in units of what each number moves the errors by),
//!
//! ```text
//! J <- J + (de - J dx) dx^T D / (dx^T D dx),   D = diag(J^T J)
//! ```
//!
//! and anew after one that did not. While names are sought they are taken from runs to first order, which cost a third: a step
//! asks of derivatives where to go, and the errors, which are exact, say whether it was right. Where such a step fails, they are taken
//! exactly, and where one along exact ones brings more or less than it should, to both sides: beside a joint that comes to rest the errors have
//! an edge.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use crate::GapError;
use crate::hypothesis::{Fitted, Hypothesis};
use crate::noise;
use crate::observer::{self, Disturbance, DriveSlopes, Errors, Noise, Run};
use crate::plant::Plant;
use crate::span::Change;
use crate::stops::Stops;
use crate::trajectory::Trajectory;

/// Data, and how they are weighed.
#[derive(Debug, Clone)]
pub(crate) struct Problem<'a> {
    pub trajectories: &'a [Trajectory],
    pub disturbance: Disturbance,
    /// Positions at which inertias are taken.
    pub middle: Vec<f64>,
    /// Usual time between rows, s, and the largest efforts.
    pub period: f64,
    pub most: Vec<f64>,
    /// Which of the URDF's limits are kept, by joint.
    pub limits: Vec<Stops>,
    /// Longest step, s.
    pub step: f64,
    /// Steps to first order are enough.
    pub rough: bool,
    /// Errors change smoothly with what is fitted: see [`Plant::smooth`].
    pub smooth: bool,
    /// What is added to all errors: by as much those of light steps differ from exact ones where that is known.
    pub defect: Option<DVector<f64>>,
    /// How much efforts accelerate joints, if that is not to be asked of each plant.
    pub mobility: Option<Vec<f64>>,
}

impl<'a> Problem<'a> {
    pub fn new(trajectories: &'a [Trajectory], disturbance: Disturbance, limits: &[Stops], step: f64) -> Self {
        let middle = noise::middle(trajectories, disturbance.effort.len());
        let period = trajectories.first().map_or(0.005, Trajectory::period);
        let efforts = |j: usize| trajectories.iter().flat_map(move |t| t.strain.iter().skip(j).step_by(t.joints));
        let most = (0..middle.len()).map(|j| efforts(j).filter(|u| u.is_finite()).fold(1e-6, |a: f64, u| a.max(u.abs()))).collect();
        Self {
            trajectories,
            disturbance,
            middle,
            period,
            most,
            limits: limits.to_vec(),
            step,
            rough: false,
            smooth: false,
            defect: None,
            mobility: None,
        }
    }

    /// Prediction errors of a plant, and its runs along all trajectories.
    pub fn followed(&self, plant: &Plant) -> Result<(DVector<f64>, Vec<Run>), GapError> {
        let noise = self.noise(plant);
        let along = |session: &&[Trajectory]| {
            let (mut motion, mut errors, mut runs) = (plant.motion(), Errors::default(), Vec::new());
            for trajectory in *session {
                let mut run = Run::default();
                let gains = observer::run(plant, trajectory, &noise, &mut motion, &mut errors, Some(&mut run))?;
                runs.push(Run { gains, ..run });
            }
            Ok((errors, runs))
        };
        let followed: Vec<(Errors, Vec<Run>)> = self.sessions().par_iter().map(along).collect::<Result<_, GapError>>()?;
        let (errors, runs): (Vec<Errors>, Vec<Vec<Run>>) = followed.into_iter().unzip();
        Ok((Errors::joined(&errors), runs.into_iter().flatten().collect()))
    }

    /// Trajectories that a session's inner states go through one after the other.
    fn sessions(&self) -> Vec<&[Trajectory]> {
        self.trajectories.chunk_by(|_, next| next.continues).collect()
    }

    /// Noise as the filter of a plant takes it.
    pub fn noise(&self, plant: &Plant) -> Noise {
        self.disturbance.behind(&self.mobility(plant), &self.drives(plant))
    }

    /// How a plant's drives answer.
    pub fn drives(&self, plant: &Plant) -> Vec<DriveSlopes> {
        plant.drives(self.trajectories)
    }

    /// Entries by row and joint in all data: so many errors are of positions, and behind them as many of efforts, where any are read.
    pub fn entries(&self) -> usize {
        self.trajectories.iter().map(|t| t.position.len()).sum()
    }

    /// How much efforts accelerate a plant's joints within a row, where the data mostly are, by columns.
    pub fn mobility(&self, plant: &Plant) -> Vec<f64> {
        self.mobility.clone().unwrap_or_else(|| plant.mobility(&self.middle, self.period, &self.most))
    }

    /// Normalised prediction errors of a hypothesis at `x`, trajectory by trajectory.
    pub fn errors(&self, hypothesis: &Hypothesis, x: &[f64]) -> Result<DVector<f64>, GapError> {
        let mut plant = hypothesis.plant(x, &self.limits, self.step)?;
        (plant.rough, plant.smooth) = (self.rough, self.smooth);
        plant.told = told(&self.disturbance.position, self.period);
        let noise = self.noise(&plant);
        let run = |session: &&[Trajectory]| {
            let mut motion = plant.motion();
            let mut errors = Errors::default();
            for trajectory in *session {
                observer::run(&plant, trajectory, &noise, &mut motion, &mut errors, None)?;
            }
            Ok(errors)
        };
        let errors: Vec<Errors> = self.sessions().par_iter().map(run).collect::<Result<_, GapError>>()?;
        let errors = Errors::joined(&errors);
        Ok(match &self.defect {
            Some(defect) => errors + defect,
            None => errors,
        })
    }

    /// Number of errors that something was measured for.
    pub fn measured(&self) -> usize {
        (self.positions() + self.efforts()).max(1)
    }

    /// Those of positions.
    pub fn positions(&self) -> usize {
        let counts = |t: &Trajectory| t.position.iter().zip(&t.counted).filter(|(y, counted)| y.is_finite() && **counted).count();
        self.trajectories.iter().map(counts).sum()
    }

    /// Those of efforts beside commands.
    pub fn efforts(&self) -> usize {
        if self.disturbance.reads_efforts() { self.trajectories.iter().map(Trajectory::efforts).sum() } else { 0 }
    }

    /// Where the errors of a trajectory's rows are, first those of positions and then those of efforts, as far as there are any. `first` is
    /// that of the trajectory's first row.
    fn banks(&self, errors: &DVector<f64>, first: usize) -> impl Iterator<Item = usize> {
        let entries = self.entries();
        (0..errors.len() / entries.max(1)).map(move |bank| bank * entries + first)
    }

    /// How many errors say as much of a change as one that is independent of others: how much larger the variance of `<change, errors>`
    /// is than it would be if they were (Newey and West 1987). That is the sum of the products' autocorrelation over all lags, by pairs of
    /// lags as long as these are positive (Geyer 1992); at least one.
    pub fn persistence(&self, errors: &DVector<f64>, change: &DVector<f64>) -> f64 {
        let joints = self.middle.len();
        let errors = errors.component_mul(change);
        let total = errors.norm_squared();
        let along = |lag: usize| -> f64 {
            let mut first = 0;
            let of = |t: &Trajectory| {
                let count = t.rows() * t.joints;
                let bank = |first: usize| {
                    let own = &errors.as_slice()[first..first + count];
                    own.iter().zip(own.iter().skip(lag * joints)).map(|(a, b)| a * b).sum::<f64>()
                };
                let sum: f64 = self.banks(&errors, first).map(bank).sum();
                first += count;
                sum
            };
            self.trajectories.iter().map(of).sum::<f64>() / total
        };
        let mut sum = 1.0 + 2.0 * along(1);
        for pair in 1..=LAGS / 2 {
            let both = along(2 * pair) + along(2 * pair + 1);
            if both.is_nan() || both <= 0.0 {
                break;
            }
            sum += 2.0 * both;
        }
        if sum > 1.0 { sum } else { 1.0 }
    }

    /// Is first order enough to say where to begin and which way to go?
    pub fn has_short_rows(&self) -> bool {
        are_short(self.period)
    }

    /// The same data, stepped to first order: a third of the cost. Where one run is compared with another that was stepped alike, what is
    /// left over cancels.
    pub fn roughly(&self) -> Self {
        Self { rough: true, ..self.clone() }
    }

    /// Derivatives of the errors by some of the numbers, by differences to both sides.
    fn central_jacobian(&self, hypothesis: &Hypothesis, which: &[usize]) -> Result<Vec<DVector<f64>>, GapError> {
        let column = |&p: &usize| {
            let [low, high] = hypothesis.fitted[p].sides(hypothesis.x[p]);
            let at = |x: f64| {
                let mut moved = hypothesis.x.clone();
                moved[p] = x;
                self.errors(hypothesis, &moved)
            };
            Ok((at(high)? - at(low)?) / (high - low))
        };
        which.par_iter().map(column).collect()
    }

    /// Derivatives of the errors by some of the numbers, by differences on the side where there is room.
    pub fn jacobian(
        &self,
        hypothesis: &Hypothesis,
        x: &[f64],
        errors: &DVector<f64>,
        which: &[usize],
    ) -> Result<Vec<DVector<f64>>, GapError> {
        which
            .par_iter()
            .map(|&p| {
                let fitted = &hypothesis.fitted[p];
                let room = fitted.bounds[1] - x[p] >= fitted.difference;
                let change = if room { fitted.difference } else { -fitted.difference };
                let at = |change: f64| {
                    let mut moved = x.to_vec();
                    moved[p] += change;
                    Ok((self.errors(hypothesis, &moved)? - errors) / change)
                };
                // Beside a state that cannot be simulated, one nearer may be.
                at(change).or_else(|_: GapError| at(-change)).or_else(|_| at(0.1 * change)).or_else(|_| at(-0.1 * change))
            })
            .collect()
    }
}

/// Where a fit has come to.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub hypothesis: Hypothesis,
    pub errors: DVector<f64>,
    /// Sum of squares of the errors.
    pub squares: f64,
    /// Derivatives of the errors by all that was fitted, at the end or near it.
    pub jacobian: Vec<DVector<f64>>,
    /// The sum of squares by which it is compared with others: see [`Problem::judged`].
    pub judged: f64,
    /// Fall of the cost since the derivatives were taken.
    pub since: f64,
}

/// Where a fit's derivatives come from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Derivatives<'a> {
    /// They begin as those that the fit has.
    pub kept: bool,
    /// The first, by known numbers, are taken as they are, to save runs; the numbers move all the same.
    pub frozen: Option<&'a [DVector<f64>]>,
    /// They may be taken from runs to first order.
    pub roughly: bool,
}

impl Derivatives<'_> {
    /// All from runs.
    pub const FRESH: Self = Self { kept: false, frozen: None, roughly: false };
    /// All from runs to first order, until a step fails.
    pub const ROUGH: Self = Self { roughly: true, ..Self::FRESH };
}

/// Share of the fall it should have brought from which on a step did what was foretold, and how often one is damped.
const TRUST: f64 = 0.25;
const TRIES: usize = 6;
/// Share of the fall that it should have brought by which a step along exact derivatives differs from it, from which on those on the other side
/// are others: a joint that comes to rest sticks there on one side of a number and turns round on the other.
const ASTRAY: f64 = 0.3;
/// How many times more than its last step a fit may still gain.
const HOPE: f64 = 5.0;
/// Share of a cost beyond noise that is no progress.
const TRIFLE: f64 = 2e-4;
/// Change of all errors together over a difference, in their deviations: large beside what chance adds where a joint sticks a row sooner or
/// later, and so small that errors go straight.
const APART: f64 = 4.0;
/// The change from which on a difference is made smaller, to [`APART`], and the share of it that is left at the least.
const FAR_APART: f64 = 12.0;
const LEAST_SHARE: f64 = 1e-2;
/// Rows of derivatives that are multiplied at a time.
const BLOCK: usize = 2048;
/// Most rows over which errors go on.
const LAGS: usize = 200;
/// Fall of the cost beyond which derivatives are not those at the end.
const FAR: f64 = 1.0;

/// Time between rows up to which steps to first order say where to begin and which way to go, s. Over longer ones a loss alone may stop a joint
/// within a row, and there are few of them.
const SHORT_ROWS: f64 = 0.0105;

pub(crate) fn are_short(period: f64) -> bool {
    period <= SHORT_ROWS
}

/// How far joints go before data tell, by the noise of their positions: see [`Plant::told`]. Over rows that are not short forces change before a
/// joint stops.
pub(crate) fn told(noise: &[f64], period: f64) -> Vec<f64> {
    if are_short(period) { noise.to_vec() } else { Vec::new() }
}

/// How hard a fit tries.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    pub rounds: usize,
    /// Fall of the cost below which it ends.
    pub enough: f64,
    /// Evidence that it has to come near to be worth going on.
    pub bar: f64,
}

impl Effort {
    pub const fn new(rounds: usize, enough: f64) -> Self {
        Self { rounds, enough, bar: f64::NEG_INFINITY }
    }

    /// To the end, for what can be hoped to come near an evidence.
    pub const fn to_the_end(bar: f64) -> Self {
        Self { rounds: 20, enough: 0.2, bar }
    }
}

impl Fit {
    /// A hypothesis where it stands.
    pub fn start(problem: &Problem<'_>, hypothesis: Hypothesis) -> Result<Self, GapError> {
        let errors = problem.errors(&hypothesis, &hypothesis.x)?;
        let squares = errors.norm_squared();
        Ok(Self { hypothesis, errors, squares, jacobian: Vec::new(), judged: squares, since: 0.0 })
    }

    /// The same numbers where the problem is weighed or stepped a little differently.
    pub fn under(&self, problem: &Problem<'_>) -> Result<Self, GapError> {
        Ok(Self { jacobian: self.jacobian.clone(), ..Self::start(problem, self.hypothesis.clone())? })
    }

    /// Without one of its effects, its other numbers and their derivatives as they are.
    pub fn without(&self, problem: &Problem<'_>, entry: usize) -> Result<Self, GapError> {
        let kept = |i: &usize| self.hypothesis.fitted[*i].knob.entry() != Some(entry);
        let jacobian = (0..self.jacobian.len()).filter(kept).map(|i| self.jacobian[i].clone()).collect();
        Ok(Self { jacobian, ..Self::start(problem, self.hypothesis.without(entry))? })
    }

    /// Normal equations over the columns, with the priors: `(J^T J / s^2 + D^-2)` and the right-hand side of a step.
    pub fn normal(&self, scale: f64) -> (DMatrix<f64>, DVector<f64>) {
        let p = self.jacobian.len();
        let weight = 1.0 / (scale * scale);
        let mut matrix = DMatrix::zeros(p, p);
        let mut right = DVector::zeros(p);
        // By blocks of rows that stay in the cache: columns of a robot's arm are long and many.
        for first in (0..self.errors.len()).step_by(BLOCK) {
            let rows = BLOCK.min(self.errors.len() - first);
            for a in 0..p {
                let column = self.jacobian[a].rows(first, rows);
                for b in 0..=a {
                    matrix[(a, b)] += weight * column.dot(&self.jacobian[b].rows(first, rows));
                }
            }
        }
        for a in 0..p {
            for b in 0..a {
                matrix[(b, a)] = matrix[(a, b)];
            }
            let [mean, deviation] = self.hypothesis.fitted[a].prior;
            let inverse = 1.0 / (deviation * deviation);
            matrix[(a, a)] += inverse;
            right[a] = -weight * self.jacobian[a].dot(&self.errors) - inverse * (self.hypothesis.x[a] - mean);
        }
        (matrix, right)
    }

    /// Logarithm of the evidence by Laplace's approximation: the likelihood and the prior at the best fit, and the share of the
    /// prior's volume that the data leave (MacKay 2003, chapter 28).
    pub fn evidence(&self, squares: f64, scale: f64) -> f64 {
        let hypothesis = &self.hypothesis;
        let widths: f64 = hypothesis.fitted.iter().map(|f| f.prior[1].ln()).sum();
        let volume = Cholesky::new(self.normal(scale).0).map_or(f64::NEG_INFINITY, |c| -c.l().diagonal().map(f64::ln).sum());
        -0.5 * squares / (scale * scale) - hypothesis.prior(&hypothesis.x) - widths + volume
    }

    /// The same fit, its sines written in one way: see [`Hypothesis::wrap_sines`].
    pub fn with_sines_wrapped(mut self) -> Self {
        for i in self.hypothesis.wrap_sines() {
            self.jacobian.get_mut(i).into_iter().for_each(|c| c.neg_mut());
        }
        self
    }

    /// Do the data say something of a number, beyond its prior?
    pub fn is_told(&self, number: usize, scale: f64) -> bool {
        let deviation = self.hypothesis.fitted[number].prior[1];
        self.jacobian.get(number).is_none_or(|column| column.norm() * deviation >= scale)
    }

    /// Minimises.
    pub fn improve(mut self, problem: &Problem<'_>, scale: f64, effort: Effort, begin: Derivatives<'_>) -> Result<Self, GapError> {
        let mut damping = 1e-3;
        let mut kept = begin.kept;
        let noise = 0.5 * problem.measured() as f64;
        let mut exactly = !begin.roughly;
        let mut both_sides = false;
        for _ in 0..effort.rounds {
            let fresh = !kept;
            if fresh && both_sides {
                self = self.differentiated(problem, begin.frozen)?;
            } else if fresh {
                self.differentiate(problem, !exactly, begin.frozen)?;
            }
            let (fall, foretold) = self.step(problem, scale, &mut damping, fresh);
            kept = fall > TRUST * foretold;
            // Errors that are larger than noise makes them say less, and what is left for other effects to explain need not be small to the last.
            let cost = 0.5 * self.squares / (scale * scale);
            let enough = effort.enough * (cost / noise).max(1.0) + TRIFLE * (cost - noise).max(0.0);
            if fall < enough && (fresh && exactly || kept || foretold.abs() < enough) {
                break;
            }
            both_sides |= fresh && exactly && foretold > enough && (fall / foretold - 1.0).abs() > ASTRAY;
            exactly |= fresh && !kept;
            if self.evidence(self.judged, scale) + HOPE * fall.max(foretold) < effort.bar - HOPE {
                break;
            }
        }
        Ok(self)
    }

    /// Takes derivatives where the fit stands, but for those that are frozen, or `roughly` from runs to first order.
    pub fn differentiate(&mut self, problem: &Problem<'_>, roughly: bool, frozen: Option<&[DVector<f64>]>) -> Result<(), GapError> {
        let mut jacobian = frozen.map_or_else(Vec::new, <[_]>::to_vec);
        let which: Vec<usize> = (jacobian.len()..self.hypothesis.x.len()).collect();
        // Errors of a problem that is rough are so already.
        let rough = (roughly && !problem.rough && !which.is_empty()).then(|| problem.roughly());
        let begun = rough.as_ref().map(|rough| rough.errors(&self.hypothesis, &self.hypothesis.x)).transpose()?;
        let (problem, errors) = (rough.as_ref().unwrap_or(problem), begun.as_ref().unwrap_or(&self.errors));
        jacobian.extend(problem.jacobian(&self.hypothesis, &self.hypothesis.x, errors, &which)?);
        // Where errors go far within a difference they do not go straight.
        let fitted = &mut self.hypothesis.fitted;
        let far = |p: &usize| jacobian[*p].norm() * fitted[*p].difference > FAR_APART;
        let far: Vec<usize> = which.into_iter().filter(far).collect();
        for p in &far {
            fitted[*p].difference *= (APART / (jacobian[*p].norm() * fitted[*p].difference)).max(LEAST_SHARE);
        }
        let nearer = problem.jacobian(&self.hypothesis, &self.hypothesis.x, errors, &far)?;
        far.into_iter().zip(nearer).for_each(|(p, column)| jacobian[p] = column);
        self.jacobian = jacobian;
        self.since = 0.0;
        Ok(())
    }

    /// One step, damped until it leads down: by how much, and by how much it should have. With derivatives that are not fresh one try is
    /// enough to see that they are at fault, and not the step.
    fn step(&mut self, problem: &Problem<'_>, scale: f64, damping: &mut f64, fresh: bool) -> (f64, f64) {
        let cost = |squares: f64, hypothesis: &Hypothesis, x: &[f64]| 0.5 * squares / (scale * scale) + hypothesis.prior(x);
        let before = cost(self.squares, &self.hypothesis, &self.hypothesis.x);
        let (matrix, right) = self.normal(scale);
        let mut foretold = 0.0;
        for _ in 0..if fresh { TRIES } else { 1 } {
            let step = bounded_step(&matrix, &right, *damping, &room(&self.hypothesis.fitted, &self.hypothesis.x));
            foretold = right.dot(&step) - 0.5 * step.dot(&(&matrix * &step));
            let x: Vec<f64> = self.hypothesis.x.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
            let tried = problem.errors(&self.hypothesis, &x).ok();
            let better = tried.map(|e| (e.norm_squared(), e)).filter(|(s, _)| s.is_finite());
            if let Some((squares, errors)) = better
                && cost(squares, &self.hypothesis, &x) < before
            {
                self.set_right(&step, &(&errors - &self.errors));
                // Until it is asked anew, as much as the fit itself gained.
                self.judged += squares - self.squares;
                self.hypothesis.x = x;
                (self.squares, self.errors) = (squares, errors);
                *damping = (*damping * 0.1).max(1e-9);
                let fall = before - cost(self.squares, &self.hypothesis, &self.hypothesis.x);
                self.since += fall;
                return (fall, foretold);
            }
            if fresh {
                *damping = (*damping * 10.0).max(1e-3);
            }
        }
        (0.0, foretold)
    }

    /// Derivatives that say of a step what it did.
    fn set_right(&mut self, step: &DVector<f64>, change: &DVector<f64>) {
        let mut rest = change.clone();
        for (column, d) in self.jacobian.iter().zip(step.iter()) {
            rest.axpy(-d, column, 1.0);
        }
        let along: Vec<f64> = self.jacobian.iter().zip(step.iter()).map(|(column, d)| column.norm_squared() * d).collect();
        let size: f64 = along.iter().zip(step.iter()).map(|(a, d)| a * d).sum();
        if size > 0.0 {
            for (column, a) in self.jacobian.iter_mut().zip(along) {
                column.axpy(a / size, &rest, 1.0);
            }
        }
    }

    /// Minimises and leaves all derivatives fresh, or nearly so, but for those that are frozen. What cannot be hoped to come near the effort's
    /// bar is left as it is.
    pub fn finish(mut self, problem: &Problem<'_>, scale: f64, begin: Derivatives<'_>, effort: Effort) -> Result<Self, GapError> {
        self = self.improve(problem, scale, effort, begin)?;
        if self.since > FAR && self.evidence(self.judged, scale) > effort.bar - 2.0 * HOPE {
            self.differentiate(problem, false, begin.frozen)?;
        }
        Ok(self)
    }

    /// The same with derivatives taken where it stands, but for those that are frozen: by differences to both sides. On one side those of
    /// a joint that sticks are not those on the other, and numbers that the data cannot tell from one another seem well known.
    pub fn differentiated(mut self, problem: &Problem<'_>, frozen: Option<&[DVector<f64>]>) -> Result<Self, GapError> {
        let mut jacobian = frozen.map_or_else(Vec::new, <[_]>::to_vec);
        let which: Vec<usize> = (jacobian.len()..self.hypothesis.x.len()).collect();
        jacobian.extend(problem.central_jacobian(&self.hypothesis, &which)?);
        self.jacobian = jacobian;
        self.since = 0.0;
        Ok(self)
    }

    /// Variances of what was fitted. Errors that a model leaves go together for a while, and are larger here than there: so that each number
    /// gets the larger of what independent errors make, `H^-1`, and of `H^-1 B H^-1`, where `B` is what stretches of the data, taken as
    /// independent of one another, add to the slope (White 1982; Liang and Zeger 1986). `None` where the data do not fix the numbers.
    pub fn variances(&self, problem: &Problem<'_>, scale: f64) -> Option<Vec<f64>> {
        let (normal, _) = self.normal(scale);
        let inverse = Cholesky::new(normal)?.inverse();
        let p = self.jacobian.len();
        let (weight, mut first) = (1.0 / (scale * scale), 0);
        let mut slopes: Vec<DVector<f64>> = Vec::new();
        for t in problem.trajectories {
            let end = first + t.rows() * t.joints;
            while first < end {
                let rows = (LAGS * t.joints).min(end - first);
                let slope = |j: &DVector<f64>| -> f64 {
                    problem.banks(&self.errors, first).map(|at| -weight * j.rows(at, rows).dot(&self.errors.rows(at, rows))).sum()
                };
                slopes.push(DVector::from_iterator(p, self.jacobian.iter().map(slope)));
                first += rows;
            }
        }
        Some(sandwich(&inverse, &slopes, &self.hypothesis.fitted))
    }
}

/// The larger of the variances `H^-1` and `H^-1 B H^-1`, with `B` the prior's information and what `slopes` add, each of a piece of the data that
/// counts as independent of the others.
pub(crate) fn sandwich(inverse: &DMatrix<f64>, slopes: &[DVector<f64>], fitted: &[Fitted]) -> Vec<f64> {
    let p = fitted.len();
    let prior = fitted.iter().map(|f| 1.0 / (f.prior[1] * f.prior[1]));
    let mut B = DMatrix::from_diagonal(&DVector::from_iterator(p, prior));
    // Slopes add up to nothing at the end of a fit, so that fewer of them are free. Of few pieces nothing is learned.
    let count = slopes.len() as f64;
    let free = if count > p as f64 { count / (count - p as f64) } else { 0.0 };
    slopes.iter().for_each(|g| B.ger(free, g, g, 1.0));
    let together = inverse * B * inverse;
    (0..p).map(|i| inverse[(i, i)].max(together[(i, i)])).collect()
}

/// Minimises a sum of squares of few numbers that is cheap to have, by the same method: where it ends, and the sum there. `errors` are those at
/// each of some points.
pub(crate) fn minimise(
    errors: &dyn Fn(&[Vec<f64>]) -> Vec<Change>,
    fitted: &[Fitted],
    mut x: Vec<f64>,
    scale: f64,
    rounds: usize,
) -> (Vec<f64>, f64) {
    let p = x.len();
    let weight = 1.0 / (scale * scale);
    let prior = |x: &[f64]| fitted.iter().zip(x).map(|(f, x)| 0.5 * ((x - f.prior[0]) / f.prior[1]).powi(2)).sum::<f64>();
    let at = |x: &[f64]| errors(&[x.to_vec()]).swap_remove(0);
    let mut now = at(&x);
    let first = 0.5 * weight * now.norm_squared() + prior(&x);
    let mut damping = 1e-3;
    for _ in 0..rounds {
        let changes = fitted.iter().zip(&x).map(|(f, x)| if f.bounds[1] - x >= f.difference { f.difference } else { -f.difference });
        let changes: Vec<f64> = changes.collect();
        let beside = |i: usize| {
            let mut moved = x.clone();
            moved[i] += changes[i];
            moved
        };
        let columns = errors(&(0..p).map(beside).collect::<Vec<_>>());
        let columns: Vec<Change> = columns.iter().zip(&changes).map(|(moved, change)| moved.since(&now, *change)).collect();
        let (mut matrix, mut right) = (DMatrix::zeros(p, p), DVector::zeros(p));
        for a in 0..p {
            for b in 0..p {
                matrix[(a, b)] = weight * columns[a].dot(&columns[b]);
            }
            let inverse = 1.0 / (fitted[a].prior[1] * fitted[a].prior[1]);
            matrix[(a, a)] += inverse;
            right[a] = -weight * columns[a].dot(&now) - inverse * (x[a] - fitted[a].prior[0]);
        }
        let before = 0.5 * weight * now.norm_squared() + prior(&x);
        let mut moved = false;
        for _ in 0..5 {
            let step = bounded_step(&matrix, &right, damping, &room(fitted, &x));
            let tried: Vec<f64> = x.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
            let e = at(&tried);
            let after = 0.5 * weight * e.norm_squared() + prior(&tried);
            if after < before {
                (x, now, moved) = (tried, e, true);
                damping = (damping * 0.1).max(1e-9);
                if before - after < 0.1 + SHARE_OF_ALL * (first - after) {
                    return (x, now.norm_squared());
                }
                break;
            }
            damping = (damping * 10.0).max(1e-3);
        }
        if !moved {
            break;
        }
    }
    let squares = now.norm_squared();
    (x, squares)
}

/// Share of all that a fit in the linear response has gained, below which a step brings nothing more: it is off by more than that.
const SHARE_OF_ALL: f64 = 1e-3;

/// Longest change of a logarithm in one step: beyond it a linear model says nothing.
const LONGEST: f64 = 1.5;

/// How far numbers may go in one step, down and up.
pub(crate) fn room(fitted: &[Fitted], x: &[f64]) -> Vec<[f64; 2]> {
    let of = |(f, x): (&Fitted, &f64)| {
        let reach = if f.logarithmic { LONGEST } else { f64::INFINITY };
        [(f.bounds[0] - x).max(-reach), (f.bounds[1] - x).min(reach)]
    };
    fitted.iter().zip(x).map(of).collect()
}

/// The damped step that brings the most inside the bounds: `min 1/2 s^T M s - r^T s` over a box, by an active set (Nocedal and Wright
/// 2006, chapter 16.5). Numbers that would leave are put on their bound; those whose bound holds them back no longer are let go.
pub(crate) fn bounded_step(matrix: &DMatrix<f64>, right: &DVector<f64>, damping: f64, room: &[[f64; 2]]) -> DVector<f64> {
    let p = right.len();
    let mut matrix = matrix.clone();
    for i in 0..p {
        matrix[(i, i)] *= 1.0 + damping;
    }
    let mut held: Vec<Option<f64>> = vec![None; p];
    let mut step = DVector::zeros(p);
    for _ in 0..4 * p + 4 {
        let free: Vec<usize> = (0..p).filter(|i| held[*i].is_none()).collect();
        for (i, value) in held.iter().enumerate() {
            step[i] = value.unwrap_or(0.0);
        }
        let rest = right - &matrix * &step;
        let reduced = DMatrix::from_fn(free.len(), free.len(), |a, b| matrix[(free[a], free[b])]);
        let Some(factor) = Cholesky::new(reduced) else { return DVector::zeros(p) };
        let solved = factor.solve(&DVector::from_fn(free.len(), |a, _| rest[free[a]]));
        for (a, i) in free.iter().enumerate() {
            let [low, high] = room[*i];
            step[*i] = solved[a].clamp(low, high);
            if step[*i] != solved[a] {
                held[*i] = Some(step[*i]);
            }
        }
        if free.iter().any(|i| held[*i].is_some()) {
            continue;
        }
        // What pulls a held number back inside.
        let slope = right - &matrix * &step;
        let inward = |i: usize| if step[i] <= room[i][0] { slope[i] } else { -slope[i] } / matrix[(i, i)].sqrt();
        let pulled = (0..p).filter(|i| held[*i].is_some() && inward(*i) > 1e-9).max_by(|a, b| inward(*a).total_cmp(&inward(*b)));
        match pulled {
            Some(i) => held[i] = None,
            None => break,
        }
    }
    step
}
