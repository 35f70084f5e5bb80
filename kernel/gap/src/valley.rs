//! Derivatives along the directions in which what the data say differs, and fits that follow them.
//!
//! Where a joint sticks a row sooner or later, a run changes by a little that no derivative foretells. A difference by one number that moves
//! the motion much carries much of that. Numbers that the data cannot tell from one another, a centre of mass and an encoder's zero, have
//! such columns each, and what the columns leave of one another is what they carry, not what the data know: the fit stands still in a valley
//! that has a floor, and its numbers seem well known. A difference along the valley hardly moves the motion, and carries as little. So
//! differences are taken along the eigenvectors `u_i` of the information in units `D` of the priors,
//!
//! ```text
//! D (J^T J / s^2 + D^-2) D = U diag(l) U^T,   w_i = (e(x + t_i D u_i) - e(x - t_i D u_i)) / (2 t_i),   J = W U^T D^-1
//! ```
//!
//! with `t_i` as long as the errors bear.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use crate::GapError;
use crate::fit::{Fit, Problem, bounded_step, room};
use crate::gaps::Measure;
use crate::hypothesis::{Knob, LIGHTEST};
use crate::search::Search;

/// By how much a difference along a direction changes all errors together, in their standard deviations, and the most of a prior's deviation
/// that it takes for that.
const CHANGE: f64 = 30.0;
const MOST: f64 = 0.5;
/// Most steps of a fit along such directions, and the fall of the cost that ends it.
const ROUNDS: usize = 20;
const ENOUGH: f64 = 0.1;
/// Shares of a step that are tried, and that over which it is seen to bend.
const LENGTHS: [f64; 4] = [1.0, 0.5, 0.25, 0.1];
const AHEAD: f64 = 0.1;

/// How many times larger than before a gap may be where a valley leads.
const AS_WELL: f64 = 1.05;

/// A fit at the end of its valley, and how far its numbers are known there.
#[derive(Debug, Clone)]
pub(crate) struct Followed {
    pub fit: Fit,
    /// None where the data do not fix the numbers.
    pub variances: Option<Vec<f64>>,
}

impl Search<'_> {
    /// Follows a fit whose names are settled to where its valley leads, if windows are predicted as well there, and tells how far its numbers
    /// are known. Where runs for derivatives are most of the work it stays where it is.
    pub fn followed(&self, fit: &Fit, scale: f64, measure: &Measure<'_>) -> Result<Followed, GapError> {
        if self.many_joints() {
            return Ok(Followed { variances: self.anew(fit).variances(&self.problem, scale), fit: fit.clone() });
        }
        let smooth = Problem { smooth: true, ..self.problem.clone() };
        let begun = fit.under(&smooth)?.differentiated(&smooth, None)?;
        let end = begun.clone().followed(&smooth, scale)?;
        let gap = |fit: &Fit| measure.pooled(&fit.hypothesis, None);
        let end = if gap(&end)? <= AS_WELL * gap(&begun)? { end } else { begun };
        let known = end.with_sines_wrapped().along_directions(&smooth, scale)?;
        let variances = known.variances(&smooth, self.scale(&known));
        Ok(Followed { fit: self.judge(known.under(&self.problem)?), variances })
    }
}

impl Fit {
    /// The same with derivatives along such directions, which those that it has tell. Those that leave no room stay as they are.
    pub fn along_directions(mut self, problem: &Problem<'_>, scale: f64) -> Result<Self, GapError> {
        let p = self.hypothesis.x.len();
        if self.jacobian.len() != p {
            return Ok(self);
        }
        let deviation: Vec<f64> = self.hypothesis.fitted.iter().map(|f| f.prior[1]).collect();
        let information = self.normal(scale).0;
        let scaled = DMatrix::from_fn(p, p, |a, b| deviation[a] * information[(a, b)] * deviation[b]);
        let eigen = scaled.symmetric_eigen();
        let along = |i: usize| -> Result<DVector<f64>, GapError> {
            let direction: Vec<f64> = eigen.eigenvectors.column(i).iter().zip(&deviation).map(|(u, d)| u * d).collect();
            let reach = (scale * CHANGE / eigen.eigenvalues[i].max(1.0).sqrt()).min(MOST);
            let sides = [self.room(&direction, reach), self.room(&direction, -reach)];
            if sides[0] - sides[1] < 0.1 * reach {
                let mut column = DVector::zeros(self.errors.len());
                self.jacobian.iter().zip(&direction).for_each(|(j, d)| column.axpy(*d, j, 1.0));
                return Ok(column);
            }
            let at = |t: f64| {
                let x: Vec<f64> = self.hypothesis.x.iter().zip(&direction).map(|(x, d)| x + t * d).collect();
                problem.errors(&self.hypothesis, &x)
            };
            Ok((at(sides[0])? - at(sides[1])?) / (sides[0] - sides[1]))
        };
        let columns: Vec<DVector<f64>> = (0..p).into_par_iter().map(along).collect::<Result<_, _>>()?;
        let by_number = |k: usize| {
            let mut column = DVector::zeros(self.errors.len());
            columns.iter().enumerate().for_each(|(i, w)| column.axpy(eigen.eigenvectors[(k, i)] / deviation[k], w, 1.0));
            column
        };
        self.jacobian = (0..p).map(by_number).collect();
        Ok(self)
    }

    /// How far of `reach` there is room along a direction. Bodies may leave their tolerances for a difference, and have a mass all the same.
    fn room(&self, direction: &[f64], reach: f64) -> f64 {
        let mut room = reach;
        for ((fitted, x), d) in self.hypothesis.fitted.iter().zip(&self.hypothesis.x).zip(direction).filter(|(_, d)| **d != 0.0) {
            let [low, high] = match fitted.knob {
                Knob::Mass(_) | Knob::Inertia(_) => [LIGHTEST - 1.0, f64::INFINITY],
                Knob::CenterOfMass(..) => continue,
                _ => fitted.bounds,
            };
            let bound = if d * reach > 0.0 { high } else { low };
            let most = (bound - x) / d;
            if most.abs() < room.abs() {
                room = most;
            }
        }
        room
    }

    /// A fit that follows such directions to where they lead, with its derivatives there or near it.
    pub fn followed(mut self, problem: &Problem<'_>, scale: f64) -> Result<Self, GapError> {
        for _ in 0..ROUNDS {
            self = self.along_directions(problem, scale)?;
            let Some((squares, errors, x)) = self.bent_step(problem, scale) else { break };
            let before = self.cost(scale);
            self.judged += squares - self.squares;
            (self.squares, self.errors, self.hypothesis.x) = (squares, errors, x);
            if before - self.cost(scale) < ENOUGH {
                break;
            }
        }
        Ok(self)
    }

    fn cost(&self, scale: f64) -> f64 {
        0.5 * self.squares / (scale * scale) + self.hypothesis.prior(&self.hypothesis.x)
    }

    /// The best of some steps along the way that the derivatives foretell, bent as the errors bend (geodesic acceleration, Transtrum and
    /// Sethna 2012): a valley of products is no straight one. Squares, errors and numbers there; none where none leads down.
    fn bent_step(&self, problem: &Problem<'_>, scale: f64) -> Option<(f64, DVector<f64>, Vec<f64>)> {
        let fitted = &self.hypothesis.fitted;
        let (matrix, right) = self.normal(scale);
        let step = bounded_step(&matrix, &right, 1e-9, &room(fitted, &self.hypothesis.x));
        if right.dot(&step) - 0.5 * step.dot(&(&matrix * &step)) < ENOUGH {
            return None;
        }
        let clamped = |i: usize, x: f64| x.clamp(fitted[i].bounds[0], fitted[i].bounds[1]);
        let at = |t: f64, bend: Option<&DVector<f64>>| -> Vec<f64> {
            let of = |(i, x): (usize, &f64)| clamped(i, x + t * step[i] + bend.map_or(0.0, |b| 0.5 * t * t * b[i]));
            self.hypothesis.x.iter().enumerate().map(of).collect()
        };
        // Second derivative of the errors along the step.
        let ahead = problem.errors(&self.hypothesis, &at(AHEAD, None)).ok()?;
        let mut bending = (ahead - &self.errors) / AHEAD;
        self.jacobian.iter().zip(step.iter()).for_each(|(j, d)| bending.axpy(-d, j, 1.0));
        bending *= 2.0 / AHEAD;
        // Numbers that come to their bounds stay there.
        let inside = |i: &usize| {
            let x = self.hypothesis.x[*i] + step[*i];
            x > fitted[*i].bounds[0] && x < fitted[*i].bounds[1]
        };
        let free: Vec<usize> = (0..step.len()).filter(inside).collect();
        let reduced = DMatrix::from_fn(free.len(), free.len(), |a, b| matrix[(free[a], free[b])]);
        let pull = DVector::from_fn(free.len(), |a, _| -self.jacobian[free[a]].dot(&bending) / (scale * scale));
        let solved = Cholesky::new(reduced)?.solve(&pull);
        let mut bend = DVector::zeros(step.len());
        free.iter().zip(solved.iter()).for_each(|(i, b)| bend[*i] = *b);
        let before = self.cost(scale);
        let tried = LENGTHS.into_par_iter().filter_map(|t| {
            let x = at(t, Some(&bend));
            let errors = problem.errors(&self.hypothesis, &x).ok()?;
            let squares = errors.norm_squared();
            let cost = 0.5 * squares / (scale * scale) + self.hypothesis.prior(&x);
            (cost < before).then_some((cost, squares, errors, x))
        });
        let (_, squares, errors, x) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some((squares, errors, x))
    }
}
