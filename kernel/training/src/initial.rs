//! First weights: He et al. 2015, from a seed and each matrix's name.

use std::collections::BTreeMap;

use sagci_furniture::Random;
use sagci_modelling::ModellingError;
use sagci_modelling::network::{Algebra, Matrix};

/// Makes each matrix when it is first asked for. Values have shapes only.
pub struct Initial {
    seed: u64,
    /// What was made.
    pub weights: BTreeMap<String, Matrix>,
}

impl Initial {
    /// From a seed.
    pub fn new(seed: u64) -> Self {
        Self { seed, weights: BTreeMap::new() }
    }
}

impl Algebra for Initial {
    type Value = ();

    fn input(&mut self, _: Matrix) {}

    fn learned(&mut self, name: &str, rows: usize, columns: usize) -> Result<(), ModellingError> {
        let mut random = Random::new(self.seed, name);
        let spread = (2.0 / rows as f64).sqrt();
        let matrix = match name.rsplit('.').next() {
            Some("weight") => Matrix::from_fn(rows, columns, |_, _| (spread * random.normal()) as f32),
            Some("gain") => Matrix::from_element(rows, columns, 1.0),
            _ => Matrix::zeros(rows, columns),
        };
        self.weights.entry(name.to_owned()).or_insert(matrix);
        Ok(())
    }

    fn product(&mut self, _: &(), _: &()) {}
    fn add_row(&mut self, _: &(), _: &()) {}
    fn add(&mut self, _: &(), _: &()) {}
    fn times(&mut self, _: &(), _: &()) {}
    fn relu(&mut self, _: &()) {}
    fn normalised(&mut self, _: &(), _: &(), _: &()) {}
    fn beside(&mut self, _: &(), _: &()) {}
    fn rows(&mut self, _: &(), _: &[usize]) {}
    fn greatest(&mut self, _: &(), _: usize) {}
    fn means(&mut self, _: &(), _: &[Vec<usize>]) {}
    fn attend(&mut self, _: &(), _: &(), _: &(), _: &(), _: usize) {}
}
