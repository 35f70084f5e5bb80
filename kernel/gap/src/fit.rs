//! Least squares over prediction errors: Levenberg and Marquardt's method with priors and bounds.
//!
//! ```text
//! minimise  1/2 sum_i e_i(x)^2 / s^2  +  1/2 sum_p ((x_p - m_p) / d_p)^2
//! ```
//!
//! `e` are normalised prediction errors, `s` how much larger they are than the noises alone would make them, `m` and `d` the priors.
//! Derivatives are differences of whole runs: they hold for everything that a model can say, inner states and drives included.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use crate::GapError;
use crate::hypothesis::{Fitted, Hypothesis};
use crate::noise;
use crate::observer::{self, Disturbance, Gains, Noise};
use crate::plant::Plant;
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
    /// Of which joints the URDF's limits are kept.
    pub limits: Vec<bool>,
    /// Longest step, s.
    pub step: f64,
    /// How much efforts accelerate joints, if that is not to be asked of each plant.
    pub mobility: Option<Vec<f64>>,
}

impl<'a> Problem<'a> {
    pub fn new(trajectories: &'a [Trajectory], disturbance: Disturbance, limits: &[bool], step: f64) -> Self {
        let middle = noise::middle(trajectories, disturbance.effort.len());
        let period = trajectories.first().map_or(0.005, Trajectory::period);
        let efforts = |j: usize| trajectories.iter().flat_map(move |t| t.strain.iter().skip(j).step_by(t.joints));
        let most = (0..middle.len()).map(|j| efforts(j).filter(|u| u.is_finite()).fold(1e-6, |a: f64, u| a.max(u.abs()))).collect();
        Self { trajectories, disturbance, middle, period, most, limits: limits.to_vec(), step, mobility: None }
    }

    /// The filter's gains for a plant.
    pub fn gains(&self, plant: &Plant) -> Vec<Gains> {
        let noise = self.noise(plant);
        self.trajectories.iter().map(|t| Gains::new(t, &noise)).collect()
    }

    /// Noise as the filter of a plant takes it.
    pub fn noise(&self, plant: &Plant) -> Noise {
        self.disturbance.behind(&self.mobility(plant))
    }

    /// How much efforts accelerate a plant's joints within a row, where the data mostly are, by columns.
    pub fn mobility(&self, plant: &Plant) -> Vec<f64> {
        self.mobility.clone().unwrap_or_else(|| plant.mobility(&self.middle, self.period, &self.most))
    }

    /// Normalised prediction errors of a hypothesis at `x`, trajectory by trajectory.
    pub fn errors(&self, hypothesis: &Hypothesis, x: &[f64]) -> Result<DVector<f64>, GapError> {
        let plant = hypothesis.plant(x, &self.limits, self.step)?;
        let mut motion = plant.motion();
        let mut errors = Vec::with_capacity(self.count());
        for (trajectory, gains) in self.trajectories.iter().zip(&self.gains(&plant)) {
            observer::run(&plant, trajectory, gains, &mut motion, &mut errors, None)?;
        }
        Ok(DVector::from_vec(errors))
    }

    /// Rows times joints, over all trajectories.
    pub fn count(&self) -> usize {
        self.trajectories.iter().map(|t| t.rows() * t.joints).sum()
    }

    /// Number of errors that something was measured for.
    pub fn measured(&self) -> usize {
        let counts = |t: &Trajectory| t.position.iter().zip(&t.counted).filter(|(y, counted)| y.is_finite() && **counted).count();
        self.trajectories.iter().map(counts).sum::<usize>().max(1)
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
}

/// How hard a fit tries.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    pub rounds: usize,
    /// Fall of the cost below which it ends.
    pub enough: f64,
}

impl Fit {
    /// A hypothesis where it stands.
    pub fn start(problem: &Problem<'_>, hypothesis: Hypothesis) -> Result<Self, GapError> {
        let errors = problem.errors(&hypothesis, &hypothesis.x)?;
        let squares = errors.norm_squared();
        Ok(Self { hypothesis, errors, squares, jacobian: Vec::new(), judged: squares })
    }

    /// Normal equations over the columns, with the priors: `(J^T J / s^2 + D^-2)` and the right-hand side of a step.
    pub fn normal(&self, scale: f64) -> (DMatrix<f64>, DVector<f64>) {
        let p = self.jacobian.len();
        let weight = 1.0 / (scale * scale);
        let mut matrix = DMatrix::zeros(p, p);
        let mut right = DVector::zeros(p);
        for a in 0..p {
            for b in 0..=a {
                let dot = weight * self.jacobian[a].dot(&self.jacobian[b]);
                (matrix[(a, b)], matrix[(b, a)]) = (dot, dot);
            }
            let [mean, deviation] = self.hypothesis.fitted[a].prior;
            let inverse = 1.0 / (deviation * deviation);
            matrix[(a, a)] += inverse;
            right[a] = -weight * self.jacobian[a].dot(&self.errors) - inverse * (self.hypothesis.x[a] - mean);
        }
        (matrix, right)
    }

    /// Minimises. `frozen` are derivatives by the first numbers that are taken as they are, to save runs; they move all the same.
    pub fn improve(mut self, problem: &Problem<'_>, scale: f64, effort: Effort, frozen: Option<&[DVector<f64>]>) -> Result<Self, GapError> {
        let count = self.hypothesis.x.len();
        let cost = |squares: f64, hypothesis: &Hypothesis, x: &[f64]| 0.5 * squares / (scale * scale) + hypothesis.prior(x);
        let mut damping = 1e-3;
        for _ in 0..effort.rounds {
            let first = frozen.map_or(0, <[_]>::len);
            let which: Vec<usize> = (first..count).collect();
            let mut jacobian = frozen.map_or_else(Vec::new, <[_]>::to_vec);
            jacobian.extend(problem.jacobian(&self.hypothesis, &self.hypothesis.x, &self.errors, &which)?);
            self.jacobian = jacobian;
            let before = cost(self.squares, &self.hypothesis, &self.hypothesis.x);
            let (matrix, right) = self.normal(scale);
            let mut moved = false;
            for _ in 0..6 {
                let step = bounded_step(&matrix, &right, damping, &self.hypothesis.fitted, &self.hypothesis.x);
                let x: Vec<f64> = self.hypothesis.x.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
                let tried = problem.errors(&self.hypothesis, &x);
                let better = tried.ok().map(|e| (e.norm_squared(), e)).filter(|(s, _)| s.is_finite());
                match better.filter(|(s, _)| cost(*s, &self.hypothesis, &x) < before) {
                    Some((squares, errors)) => {
                        self.hypothesis.x = x;
                        // Until it is asked anew, as much as the fit itself gained.
                        self.judged += squares - self.squares;
                        (self.squares, self.errors) = (squares, errors);
                        damping = (damping * 0.1).max(1e-9);
                        moved = true;
                        break;
                    }
                    None => damping = (damping * 10.0).max(1e-3),
                }
            }
            if !moved {
                break;
            }
            if before - cost(self.squares, &self.hypothesis, &self.hypothesis.x) < effort.enough {
                break;
            }
        }
        Ok(self)
    }

    /// Minimises to the end, with derivatives by the known numbers taken from `frozen` until near it, and leaves all derivatives fresh.
    pub fn finish(self, problem: &Problem<'_>, scale: f64, frozen: Option<&[DVector<f64>]>) -> Result<Self, GapError> {
        let mut fit = self;
        if frozen.is_some() {
            fit = fit.improve(problem, scale, Effort { rounds: 12, enough: 0.3 }, frozen)?;
        }
        fit = fit.improve(problem, scale, Effort { rounds: if frozen.is_some() { 3 } else { 15 }, enough: 0.05 }, None)?;
        Ok(fit)
    }

    /// Covariance of what was fitted.
    pub fn covariance(&self, scale: f64) -> Option<DMatrix<f64>> {
        Some(Cholesky::new(self.normal(scale).0)?.inverse())
    }
}

/// Minimises a sum of squares of few numbers that is cheap to have, by the same method: where it ends, and the sum there.
pub(crate) fn minimise(
    errors: &dyn Fn(&[f64]) -> DVector<f64>,
    fitted: &[Fitted],
    mut x: Vec<f64>,
    scale: f64,
    rounds: usize,
) -> (Vec<f64>, f64) {
    let p = x.len();
    let weight = 1.0 / (scale * scale);
    let prior = |x: &[f64]| fitted.iter().zip(x).map(|(f, x)| 0.5 * ((x - f.prior[0]) / f.prior[1]).powi(2)).sum::<f64>();
    let mut now = errors(&x);
    let mut damping = 1e-3;
    for _ in 0..rounds {
        let columns: Vec<DVector<f64>> = (0..p)
            .map(|i| {
                let room = fitted[i].bounds[1] - x[i] >= fitted[i].difference;
                let change = if room { fitted[i].difference } else { -fitted[i].difference };
                let mut moved = x.clone();
                moved[i] += change;
                (errors(&moved) - &now) / change
            })
            .collect();
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
            let step = bounded_step(&matrix, &right, damping, fitted, &x);
            let tried: Vec<f64> = x.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
            let e = errors(&tried);
            let after = 0.5 * weight * e.norm_squared() + prior(&tried);
            if after < before {
                (x, now, moved) = (tried, e, true);
                damping = (damping * 0.1).max(1e-9);
                if before - after < 0.1 {
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

/// Longest change of a logarithm in one step: beyond it a linear model says nothing.
const LONGEST: f64 = 1.5;

/// A damped step that stays inside the bounds: numbers that would leave are put on their bound, and the rest solved anew.
fn bounded_step(matrix: &DMatrix<f64>, right: &DVector<f64>, damping: f64, fitted: &[Fitted], x: &[f64]) -> DVector<f64> {
    let p = right.len();
    let mut held: Vec<Option<f64>> = vec![None; p];
    let mut step = DVector::zeros(p);
    for _ in 0..=p {
        let free: Vec<usize> = (0..p).filter(|i| held[*i].is_none()).collect();
        let mut reduced = DMatrix::from_fn(free.len(), free.len(), |a, b| matrix[(free[a], free[b])]);
        let mut rest = DVector::from_fn(free.len(), |a, _| right[free[a]]);
        for (a, i) in free.iter().enumerate() {
            reduced[(a, a)] *= 1.0 + damping;
            for (j, value) in held.iter().enumerate() {
                rest[a] -= matrix[(*i, j)] * value.unwrap_or(0.0);
            }
        }
        let Some(factor) = Cholesky::new(reduced) else { return DVector::zeros(p) };
        let solved = factor.solve(&rest);
        for (i, value) in held.iter().enumerate() {
            step[i] = value.unwrap_or(0.0);
        }
        for (a, i) in free.iter().enumerate() {
            step[*i] = solved[a];
        }
        let mut left = false;
        for i in free {
            let (lower, upper) = (fitted[i].bounds[0] - x[i], fitted[i].bounds[1] - x[i]);
            let reach = if fitted[i].logarithmic { LONGEST } else { f64::INFINITY };
            let kept = step[i].clamp(lower.max(-reach), upper.min(reach));
            if kept != step[i] {
                held[i] = Some(kept);
                left = true;
            }
        }
        if !left {
            break;
        }
    }
    for (i, value) in held.iter().enumerate() {
        if let Some(value) = value {
            step[i] = *value;
        }
    }
    step
}
