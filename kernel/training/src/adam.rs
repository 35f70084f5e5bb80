//! AdamW (Loshchilov and Hutter 2019), with a cosine schedule after a warm-up and gradients clipped by their norm.

use std::collections::BTreeMap;

use sagci_modelling::network::Matrix;

/// The optimiser's state.
pub struct Adam {
    first: BTreeMap<String, Matrix>,
    second: BTreeMap<String, Matrix>,
    step: usize,
    steps: usize,
    rate: f64,
}

impl Adam {
    /// For a number of steps at a greatest rate.
    pub fn new(steps: usize, rate: f64) -> Self {
        Self { first: BTreeMap::new(), second: BTreeMap::new(), step: 0, steps, rate }
    }

    /// One step along the mean of `count` gradients.
    pub fn step(&mut self, weights: &mut BTreeMap<String, Matrix>, gradients: &BTreeMap<String, Matrix>, count: f32) {
        self.step += 1;
        let t = self.step as f64;
        let warm = (t / (0.03 * self.steps as f64).max(1.0)).min(1.0);
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * t / self.steps as f64).cos());
        let rate = (self.rate * warm * (0.01 + 0.99 * cosine)) as f32;
        let norm = gradients.values().map(Matrix::norm_squared).sum::<f32>().sqrt() / count;
        let clip = (1.0 / norm.max(1e-12)).min(1.0) / count;
        let bias = [1.0 - 0.9_f64.powf(t), 1.0 - 0.999_f64.powf(t)].map(|b| b as f32);
        for (name, g) in gradients {
            let Some(w) = weights.get_mut(name) else { continue };
            let m = self.first.entry(name.clone()).or_insert_with(|| Matrix::zeros(g.nrows(), g.ncols()));
            let v = self.second.entry(name.clone()).or_insert_with(|| Matrix::zeros(g.nrows(), g.ncols()));
            let decay = if name.ends_with(".weight") { 5e-2 } else { 0.0 };
            for (((w, g), m), v) in w.iter_mut().zip(g.iter()).zip(m.iter_mut()).zip(v.iter_mut()) {
                let x = g * clip;
                *m = 0.9 * *m + 0.1 * x;
                *v = 0.999 * *v + 0.001 * x * x;
                *w -= rate * (*m / bias[0] / ((*v / bias[1]).sqrt() + 1e-8) + decay * *w);
            }
        }
    }
}
