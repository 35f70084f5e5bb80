//! What a model's own known numbers can explain of its prediction errors, and what they leave.
//!
//! With `Q` an orthonormal basis of the derivatives by these numbers, behind each a row for its prior, what is left of a change `a` of the
//! errors is `P a = a - Q Q^T a`. Nothing is ever projected: `P` is a projection, so
//!
//! ```text
//! <P a, P b> = <a, b> - <Q^T a, Q^T b>
//! ```
//!
//! and one pass over the basis a change is enough.

use nalgebra::{DMatrix, DVector};

use crate::fit::Fit;

/// Rows that are multiplied at a time.
const BLOCK: usize = 512;

/// A change of the errors, as it is and along what the known numbers can make.
#[derive(Debug, Clone)]
pub(crate) struct Change {
    whole: DVector<f64>,
    along: DVector<f64>,
}

impl Change {
    /// Inner product of what is left of two changes.
    pub fn dot(&self, other: &Self) -> f64 {
        self.whole.dot(&other.whole) - self.along.dot(&other.along)
    }

    pub fn norm_squared(&self) -> f64 {
        self.dot(self)
    }

    pub fn plus(&self, other: &Self) -> Self {
        Self { whole: &self.whole + &other.whole, along: &self.along + &other.along }
    }

    /// By how much it differs from another, over a step.
    pub fn since(&self, other: &Self, step: f64) -> Self {
        Self { whole: (&self.whole - &other.whole) / step, along: (&self.along - &other.along) / step }
    }
}

/// What the known numbers of a fit can explain.
#[derive(Debug)]
pub(crate) struct Span {
    /// Rows are the directions.
    basis: DMatrix<f64>,
    /// Errors of the fit without what its known numbers can explain.
    pub errors: Change,
}

impl Span {
    pub fn new(base: &Fit, scale: f64) -> Self {
        // Numbers with a prior count as measured once more: a row each, behind the errors. Those on a bound can explain nothing more.
        let (count, known) = (base.errors.len(), base.jacobian.len());
        let extended = |errors: &DVector<f64>, prior: &dyn Fn(usize) -> f64| {
            DVector::from_fn(count + known, |i, _| if i < count { errors[i] } else { prior(i - count) })
        };
        let hypothesis = &base.hypothesis;
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for (p, column) in base.jacobian.iter().enumerate() {
            let fitted = &hypothesis.fitted[p];
            let margin = 1e-3 * (fitted.bounds[1] - fitted.bounds[0]);
            if hypothesis.x[p] < fitted.bounds[0] + margin || hypothesis.x[p] > fitted.bounds[1] - margin {
                continue;
            }
            let mut rest = extended(column, &|i| if i == p { scale / fitted.prior[1] } else { 0.0 });
            let norm = rest.norm();
            for _ in 0..2 {
                for b in &basis {
                    let dot = b.dot(&rest);
                    rest.axpy(-dot, b, 1.0);
                }
            }
            if rest.norm() > 1e-6 * norm && norm > 0.0 {
                basis.push(rest.normalize());
            }
        }
        let off = |p: usize| scale * (hypothesis.x[p] - hypothesis.fitted[p].prior[0]) / hypothesis.fitted[p].prior[1];
        let mut errors = extended(&base.errors, &off);
        for b in &basis {
            let dot = b.dot(&errors);
            errors.axpy(-dot, b, 1.0);
        }
        // No change reaches the rows of the priors.
        let whole = errors.rows(0, count).clone_owned();
        let basis = DMatrix::from_fn(basis.len(), count, |direction, i| basis[direction][i]);
        let along = DVector::zeros(basis.nrows());
        Self { basis, errors: Change { whole, along } }
    }

    /// A change of all errors.
    pub fn of(&self, whole: DVector<f64>) -> Change {
        Change { along: &self.basis * &whole, whole }
    }

    /// What is left of a change, row by row.
    pub fn rest(&self, change: &Change) -> DVector<f64> {
        &change.whole - self.basis.tr_mul(&change.along)
    }

    /// Inner products of what is left of several changes, one a column, with one another and with what is left of the errors.
    pub fn products(&self, changes: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let mut along = DMatrix::zeros(self.basis.nrows(), changes.ncols());
        let mut whole = DMatrix::zeros(changes.ncols(), changes.ncols());
        // By blocks of rows that stay in the cache: column by column it would read all of one for each column of the other.
        for first in (0..changes.nrows()).step_by(BLOCK) {
            let rows = BLOCK.min(changes.nrows() - first);
            let block = changes.rows(first, rows);
            along.gemm(1.0, &self.basis.columns(first, rows), &block, 1.0);
            whole.gemm(1.0, &block.transpose(), &block, 1.0);
        }
        (whole - along.tr_mul(&along), changes.tr_mul(&self.errors.whole))
    }
}
