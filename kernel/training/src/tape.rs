//! Reverse-mode differentiation of the networks' operations (Linnainmaa 1976): every operation is written down with its value, and
//! gradients are carried back from the last to the first.

use std::collections::BTreeMap;

use sagci_modelling::ModellingError;
use sagci_modelling::network::{Algebra, Matrix, TINY, attention};

/// A place on the tape.
pub type Value = usize;

enum Operation {
    Given,
    Learned(String),
    Product(Value, Value),
    AddRow(Value, Value),
    Add(Value, Value),
    Times(Value, Value),
    Relu(Value),
    Normalised { a: Value, gain: Value, bias: Value, scaled: Matrix, scale: Vec<f32> },
    Beside(Value, Value),
    Rows(Value, Vec<usize>),
    Greatest { a: Value, from: Vec<usize> },
    Means(Value, Vec<Vec<usize>>),
    Attend { q: Value, k: Value, v: Value, bias: Value, weights: Vec<Matrix> },
}

/// Operations in the order in which they were done.
pub struct Tape<'a> {
    weights: &'a BTreeMap<String, Matrix>,
    values: Vec<Matrix>,
    operations: Vec<Operation>,
    known: BTreeMap<String, Value>,
}

impl<'a> Tape<'a> {
    /// An empty one over these weights.
    pub fn new(weights: &'a BTreeMap<String, Matrix>) -> Self {
        Self { weights, values: Vec::new(), operations: Vec::new(), known: BTreeMap::new() }
    }

    fn push(&mut self, value: Matrix, operation: Operation) -> Value {
        self.values.push(value);
        self.operations.push(operation);
        self.values.len() - 1
    }

    /// What stands at a place.
    pub fn value(&self, at: Value) -> &Matrix {
        &self.values[at]
    }

    /// Adds to `gradients` those of the weights, for gradients at some places.
    pub fn back(&self, seeds: &[(Value, Matrix)], gradients: &mut BTreeMap<String, Matrix>) {
        let mut g: Vec<Option<Matrix>> = vec![None; self.values.len()];
        let add = |g: &mut Vec<Option<Matrix>>, at: Value, d: Matrix| match &mut g[at] {
            Some(sum) => *sum += d,
            slot => *slot = Some(d),
        };
        for (at, d) in seeds {
            add(&mut g, *at, d.clone());
        }
        for at in (0..self.values.len()).rev() {
            let Some(d) = g[at].take() else { continue };
            match &self.operations[at] {
                Operation::Given => {}
                Operation::Learned(name) => match gradients.get_mut(name) {
                    Some(sum) => *sum += d,
                    None => {
                        gradients.insert(name.clone(), d);
                    }
                },
                Operation::Product(a, b) => {
                    if !matches!(self.operations[*a], Operation::Given) {
                        add(&mut g, *a, &d * self.values[*b].transpose());
                    }
                    add(&mut g, *b, self.values[*a].transpose() * &d);
                }
                Operation::AddRow(a, row) => {
                    add(&mut g, *row, Matrix::from_fn(1, d.ncols(), |_, k| d.column(k).sum()));
                    add(&mut g, *a, d);
                }
                Operation::Add(a, b) => {
                    add(&mut g, *a, d.clone());
                    add(&mut g, *b, d);
                }
                Operation::Times(a, b) => {
                    add(&mut g, *a, d.component_mul(&self.values[*b]));
                    add(&mut g, *b, d.component_mul(&self.values[*a]));
                }
                Operation::Relu(a) => {
                    let d = d.zip_map(&self.values[at], |d, y| if y > 0.0 { d } else { 0.0 });
                    add(&mut g, *a, d);
                }
                Operation::Normalised { a, gain, bias, scaled, scale } => {
                    let n = d.ncols() as f32;
                    let gains = &self.values[*gain];
                    add(&mut g, *bias, Matrix::from_fn(1, d.ncols(), |_, k| d.column(k).sum()));
                    add(&mut g, *gain, Matrix::from_fn(1, d.ncols(), |_, k| d.column(k).dot(&scaled.column(k))));
                    let mut out = d;
                    for (i, mut row) in out.row_iter_mut().enumerate() {
                        row.iter_mut().zip(gains.iter()).for_each(|(x, w)| *x *= w);
                        let mean = row.sum() / n;
                        let along = row.iter().zip(scaled.row(i).iter()).map(|(x, y)| x * y).sum::<f32>() / n;
                        row.iter_mut().zip(scaled.row(i).iter()).for_each(|(x, y)| *x = (*x - mean - along * y) * scale[i]);
                    }
                    add(&mut g, *a, out);
                }
                Operation::Beside(a, b) => {
                    let split = self.values[*a].ncols();
                    add(&mut g, *a, d.columns(0, split).into_owned());
                    add(&mut g, *b, d.columns(split, d.ncols() - split).into_owned());
                }
                Operation::Rows(a, index) => {
                    let mut out = Matrix::zeros(self.values[*a].nrows(), d.ncols());
                    for k in 0..d.ncols() {
                        for (i, from) in index.iter().enumerate() {
                            out[(*from, k)] += d[(i, k)];
                        }
                    }
                    add(&mut g, *a, out);
                }
                Operation::Greatest { a, from } => {
                    let mut out = Matrix::zeros(self.values[*a].nrows(), d.ncols());
                    for k in 0..d.ncols() {
                        for i in 0..d.nrows() {
                            out[(from[k * d.nrows() + i], k)] += d[(i, k)];
                        }
                    }
                    add(&mut g, *a, out);
                }
                Operation::Means(a, lists) => {
                    let mut out = Matrix::zeros(self.values[*a].nrows(), d.ncols());
                    for (i, list) in lists.iter().enumerate() {
                        let share = 1.0 / list.len().max(1) as f32;
                        for from in list {
                            for k in 0..d.ncols() {
                                out[(*from, k)] += d[(i, k)] * share;
                            }
                        }
                    }
                    add(&mut g, *a, out);
                }
                Operation::Attend { q, k, v, bias, weights } => {
                    let (n, heads) = (d.nrows(), weights.len());
                    let width = d.ncols() / heads;
                    let root = (width as f32).sqrt();
                    let mut out = [q, k, v].map(|m| Matrix::zeros(n, self.values[*m].ncols()));
                    let mut bent = Matrix::zeros(n * n, heads);
                    for (head, w) in weights.iter().enumerate() {
                        let part = |m: &Matrix| m.columns(head * width, width).into_owned();
                        let (dy, vq, vk, vv) = (part(&d), part(&self.values[*q]), part(&self.values[*k]), part(&self.values[*v]));
                        out[2].columns_mut(head * width, width).copy_from(&(w.transpose() * &dy));
                        let mut s = &dy * vv.transpose();
                        for i in 0..n {
                            let mean: f32 = (0..n).map(|j| s[(i, j)] * w[(i, j)]).sum();
                            for j in 0..n {
                                s[(i, j)] = (s[(i, j)] - mean) * w[(i, j)];
                                bent[(i * n + j, head)] = s[(i, j)];
                            }
                        }
                        out[0].columns_mut(head * width, width).copy_from(&(&s * vk / root));
                        out[1].columns_mut(head * width, width).copy_from(&(s.transpose() * vq / root));
                    }
                    let [dq, dk, dv] = out;
                    add(&mut g, *q, dq);
                    add(&mut g, *k, dk);
                    add(&mut g, *v, dv);
                    add(&mut g, *bias, bent);
                }
            }
        }
    }
}

impl Algebra for Tape<'_> {
    type Value = Value;

    fn input(&mut self, matrix: Matrix) -> Value {
        self.push(matrix, Operation::Given)
    }

    fn learned(&mut self, name: &str, rows: usize, columns: usize) -> Result<Value, ModellingError> {
        if let Some(at) = self.known.get(name) {
            return Ok(*at);
        }
        let found = self.weights.get(name).filter(|m| m.shape() == (rows, columns));
        let found = found.ok_or_else(|| ModellingError::Weights { message: format!("'{name}' is missing or of another shape") })?;
        let at = self.push(found.clone(), Operation::Learned(name.to_owned()));
        self.known.insert(name.to_owned(), at);
        Ok(at)
    }

    fn product(&mut self, a: &Value, b: &Value) -> Value {
        self.push(&self.values[*a] * &self.values[*b], Operation::Product(*a, *b))
    }

    fn add_row(&mut self, a: &Value, row: &Value) -> Value {
        let mut out = self.values[*a].clone();
        for (mut column, x) in out.column_iter_mut().zip(self.values[*row].iter()) {
            column.add_scalar_mut(*x);
        }
        self.push(out, Operation::AddRow(*a, *row))
    }

    fn add(&mut self, a: &Value, b: &Value) -> Value {
        self.push(&self.values[*a] + &self.values[*b], Operation::Add(*a, *b))
    }

    fn times(&mut self, a: &Value, b: &Value) -> Value {
        self.push(self.values[*a].component_mul(&self.values[*b]), Operation::Times(*a, *b))
    }

    fn relu(&mut self, a: &Value) -> Value {
        self.push(self.values[*a].map(|x| x.max(0.0)), Operation::Relu(*a))
    }

    fn normalised(&mut self, a: &Value, gain: &Value, bias: &Value) -> Value {
        let mut scaled = self.values[*a].clone();
        let mut scale = Vec::with_capacity(scaled.nrows());
        for mut row in scaled.row_iter_mut() {
            let mean = row.mean();
            let s = 1.0 / (row.variance() + TINY).sqrt();
            row.iter_mut().for_each(|x| *x = (*x - mean) * s);
            scale.push(s);
        }
        let mut out = scaled.clone();
        for (k, mut column) in out.column_iter_mut().enumerate() {
            let (w, b) = (self.values[*gain][k], self.values[*bias][k]);
            column.iter_mut().for_each(|x| *x = *x * w + b);
        }
        self.push(out, Operation::Normalised { a: *a, gain: *gain, bias: *bias, scaled, scale })
    }

    fn beside(&mut self, a: &Value, b: &Value) -> Value {
        let (x, y) = (&self.values[*a], &self.values[*b]);
        let mut out = Matrix::zeros(x.nrows(), x.ncols() + y.ncols());
        out.columns_mut(0, x.ncols()).copy_from(x);
        out.columns_mut(x.ncols(), y.ncols()).copy_from(y);
        self.push(out, Operation::Beside(*a, *b))
    }

    fn rows(&mut self, a: &Value, index: &[usize]) -> Value {
        self.push(self.values[*a].select_rows(index), Operation::Rows(*a, index.to_vec()))
    }

    fn greatest(&mut self, a: &Value, group: usize) -> Value {
        let x = &self.values[*a];
        let n = x.nrows() / group.max(1);
        let mut from = Vec::with_capacity(n * x.ncols());
        let mut out = Matrix::zeros(n, x.ncols());
        for k in 0..x.ncols() {
            for i in 0..n {
                let mut best = i * group;
                for r in i * group..(i + 1) * group {
                    if x[(r, k)] > x[(best, k)] {
                        best = r;
                    }
                }
                out[(i, k)] = x[(best, k)];
                from.push(best);
            }
        }
        self.push(out, Operation::Greatest { a: *a, from })
    }

    fn means(&mut self, a: &Value, lists: &[Vec<usize>]) -> Value {
        let x = &self.values[*a];
        let out =
            Matrix::from_fn(lists.len(), x.ncols(), |i, k| lists[i].iter().map(|r| x[(*r, k)]).sum::<f32>() / lists[i].len().max(1) as f32);
        self.push(out, Operation::Means(*a, lists.to_vec()))
    }

    fn attend(&mut self, q: &Value, k: &Value, v: &Value, bias: &Value, heads: usize) -> Value {
        let (vq, vk, vv, vb) = (&self.values[*q], &self.values[*k], &self.values[*v], &self.values[*bias]);
        let width = vq.ncols() / heads;
        let mut out = Matrix::zeros(vq.nrows(), vq.ncols());
        let mut weights = Vec::with_capacity(heads);
        for head in 0..heads {
            let w = attention(vq, vk, vb, head, heads);
            out.columns_mut(head * width, width).copy_from(&(&w * vv.columns(head * width, width)));
            weights.push(w);
        }
        self.push(out, Operation::Attend { q: *q, k: *k, v: *v, bias: *bias, weights })
    }
}
