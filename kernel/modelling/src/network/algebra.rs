//! What a network is written in: matrices of one item a row. The networks are written once, over this trait; here they are
//! evaluated, and training evaluates them on a tape.

use std::collections::BTreeMap;

use nalgebra::DMatrix;

use crate::ModellingError;

/// A matrix of single precision.
pub type Matrix = DMatrix<f32>;

/// The operations of the networks.
pub trait Algebra {
    /// A value.
    type Value: Clone;

    /// A value that is given.
    fn input(&mut self, matrix: Matrix) -> Self::Value;
    /// A learned matrix by its name and shape. Names end with `.weight`, `.bias` or `.gain`.
    fn learned(&mut self, name: &str, rows: usize, columns: usize) -> Result<Self::Value, ModellingError>;
    /// `a b`.
    fn product(&mut self, a: &Self::Value, b: &Self::Value) -> Self::Value;
    /// `a` with one row added to each of its rows.
    fn add_row(&mut self, a: &Self::Value, row: &Self::Value) -> Self::Value;
    /// `a + b`.
    fn add(&mut self, a: &Self::Value, b: &Self::Value) -> Self::Value;
    /// Elementwise `a b`.
    fn times(&mut self, a: &Self::Value, b: &Self::Value) -> Self::Value;
    /// `max(a, 0)`.
    fn relu(&mut self, a: &Self::Value) -> Self::Value;
    /// Each row less its mean over its standard deviation, times a gain, plus a bias (Ba, Kiros and Hinton 2016).
    fn normalised(&mut self, a: &Self::Value, gain: &Self::Value, bias: &Self::Value) -> Self::Value;
    /// Columns of `a`, then those of `b`.
    fn beside(&mut self, a: &Self::Value, b: &Self::Value) -> Self::Value;
    /// Rows of `a` by index.
    fn rows(&mut self, a: &Self::Value, index: &[usize]) -> Self::Value;
    /// Greatest of every `group` rows that follow one another.
    fn greatest(&mut self, a: &Self::Value, group: usize) -> Self::Value;
    /// Means of rows: one row for each list of indices.
    fn means(&mut self, a: &Self::Value, lists: &[Vec<usize>]) -> Self::Value;
    /// Attention in heads (Vaswani et al. 2017) with a bias for each pair and head: row `i n + j`, column `head`.
    fn attend(&mut self, q: &Self::Value, k: &Self::Value, v: &Self::Value, bias: &Self::Value, heads: usize) -> Self::Value;
}

/// Values that are just evaluated.
pub struct Plain<'a> {
    /// Learned matrices by name.
    pub weights: &'a BTreeMap<String, Matrix>,
}

/// Softmax over each row, in place.
pub fn softmax_rows(m: &mut Matrix) {
    for mut row in m.row_iter_mut() {
        let most = row.max();
        row.iter_mut().for_each(|x| *x = (*x - most).exp());
        let sum = row.sum();
        row.iter_mut().for_each(|x| *x /= sum);
    }
}

/// Attention weights of one head.
pub fn attention(q: &Matrix, k: &Matrix, bias: &Matrix, head: usize, heads: usize) -> Matrix {
    let (n, width) = (q.nrows(), q.ncols() / heads);
    let part = |m: &Matrix| m.columns(head * width, width).into_owned();
    let mut scores = part(q) * part(k).transpose() / (width as f32).sqrt();
    for i in 0..n {
        for j in 0..n {
            scores[(i, j)] += bias[(i * n + j, head)];
        }
    }
    softmax_rows(&mut scores);
    scores
}

/// What keeps a standard deviation from zero.
pub const TINY: f32 = 1e-5;

impl Algebra for Plain<'_> {
    type Value = Matrix;

    fn input(&mut self, matrix: Matrix) -> Matrix {
        matrix
    }

    fn learned(&mut self, name: &str, rows: usize, columns: usize) -> Result<Matrix, ModellingError> {
        let found = self.weights.get(name).ok_or_else(|| ModellingError::Weights { message: format!("'{name}' is missing") })?;
        if found.shape() != (rows, columns) {
            let message = format!("'{name}' is {:?}; this program expects {rows} by {columns}", found.shape());
            return Err(ModellingError::Weights { message });
        }
        Ok(found.clone())
    }

    fn product(&mut self, a: &Matrix, b: &Matrix) -> Matrix {
        a * b
    }

    fn add_row(&mut self, a: &Matrix, row: &Matrix) -> Matrix {
        let mut out = a.clone();
        for (mut column, x) in out.column_iter_mut().zip(row.iter()) {
            column.add_scalar_mut(*x);
        }
        out
    }

    fn add(&mut self, a: &Matrix, b: &Matrix) -> Matrix {
        a + b
    }

    fn times(&mut self, a: &Matrix, b: &Matrix) -> Matrix {
        a.component_mul(b)
    }

    fn relu(&mut self, a: &Matrix) -> Matrix {
        a.map(|x| x.max(0.0))
    }

    fn normalised(&mut self, a: &Matrix, gain: &Matrix, bias: &Matrix) -> Matrix {
        let mut out = a.clone();
        for mut row in out.row_iter_mut() {
            let mean = row.mean();
            let scale = 1.0 / (row.variance() + TINY).sqrt();
            for (k, x) in row.iter_mut().enumerate() {
                *x = (*x - mean) * scale * gain[k] + bias[k];
            }
        }
        out
    }

    fn beside(&mut self, a: &Matrix, b: &Matrix) -> Matrix {
        let mut out = Matrix::zeros(a.nrows(), a.ncols() + b.ncols());
        out.columns_mut(0, a.ncols()).copy_from(a);
        out.columns_mut(a.ncols(), b.ncols()).copy_from(b);
        out
    }

    fn rows(&mut self, a: &Matrix, index: &[usize]) -> Matrix {
        a.select_rows(index)
    }

    fn greatest(&mut self, a: &Matrix, group: usize) -> Matrix {
        Matrix::from_fn(a.nrows() / group.max(1), a.ncols(), |i, k| a.view((i * group, k), (group, 1)).max())
    }

    fn means(&mut self, a: &Matrix, lists: &[Vec<usize>]) -> Matrix {
        Matrix::from_fn(lists.len(), a.ncols(), |i, k| lists[i].iter().map(|r| a[(*r, k)]).sum::<f32>() / lists[i].len().max(1) as f32)
    }

    fn attend(&mut self, q: &Matrix, k: &Matrix, v: &Matrix, bias: &Matrix, heads: usize) -> Matrix {
        let width = q.ncols() / heads;
        let mut out = Matrix::zeros(q.nrows(), q.ncols());
        for head in 0..heads {
            let weights = attention(q, k, bias, head, heads);
            out.columns_mut(head * width, width).copy_from(&(weights * v.columns(head * width, width)));
        }
        out
    }
}
