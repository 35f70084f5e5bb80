//! A small multilayer perceptron in f64 with its derivatives written out.
//!
//! With the input brought to `x_0 = (x - mean) / scale`, the layers `z_l = W_l x_{l-1} + b_l`, `x_l = sigma(z_l)` (the last
//! one without `sigma`), and the output `y = output_scale z_L`:
//!
//! * forward mode (`push`): `dz_l = W_l dx_{l-1} + dW_l x_{l-1} + db_l`, `dx_l = sigma'(z_l) dz_l`;
//! * reverse mode (`pull`): `z'_l = sigma'(z_l) x'_l`, `x'_{l-1} = W_l^T z'_l`, `W'_l += z'_l x_{l-1}^T`, `b'_l += z'_l`
//!   (Rumelhart, Hinton and Williams 1986), a prime being the cotangent.
//!
//! All weights stand in one flat vector, layer by layer: `W_l` row-major, then `b_l`. The last layer starts at zero, so an
//! untrained network says exactly nothing; the others are drawn as Glorot and Bengio (2010) advise.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::DynamicsError;
use crate::error::check;

/// No layer may be wider, and no network deeper, than this: a bound on what a broken file can ask for.
pub(super) const MAX_WIDTH: usize = 4096;
pub(super) const MAX_LAYERS: usize = 16;

/// What bends between two layers. All are smooth, so that gradients of rollouts are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// `tanh z`: bounded, so that a force learned from little data stays bounded far from it.
    Tanh,
    /// `z / (1 + exp(-z))`.
    Silu,
}

impl Activation {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tanh => "tanh",
            Self::Silu => "silu",
        }
    }

    /// By its name in files.
    pub fn of_name(name: &str) -> Option<Self> {
        [Self::Tanh, Self::Silu].into_iter().find(|a| a.name() == name)
    }

    /// Value and slope.
    #[inline]
    fn at(self, z: f64) -> (f64, f64) {
        match self {
            Self::Tanh => {
                let t = z.tanh();
                (t, 1.0 - t * t)
            }
            // Sums of one keep no digit of what is left there.
            Self::Silu if z.abs() > SATURATED => (z.max(0.0), if z > 0.0 { 1.0 } else { 0.0 }),
            Self::Silu => {
                let s = 1.0 / (1.0 + (-z).exp());
                (z * s, s * (1.0 + z * (1.0 - s)))
            }
        }
    }
}

/// Beyond it a sigmoid is zero or one: `e^-40` is less than a tenth of a double's last digit.
const SATURATED: f64 = 40.0;

/// A multilayer perceptron with its normalisation.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    sizes: Vec<usize>,
    activation: Activation,
    weights: Vec<f64>,
    pub(super) normalisation: Normalisation,
}

/// What brings inputs to size one, and outputs back.
#[derive(Debug, Clone, PartialEq)]
pub struct Normalisation {
    /// Subtracted from each input.
    pub input_mean: Vec<f64>,
    /// What each input is divided by, positive.
    pub input_scale: Vec<f64>,
    /// What each output is multiplied by, positive.
    pub output_scale: Vec<f64>,
}

/// Everything that changes while one network is evaluated.
#[derive(Debug, Clone)]
pub struct NetworkWorkspace {
    /// Values of all layers, the normalised input first.
    x: Vec<f64>,
    /// Slopes of the activations, laid out as `x`.
    slope: Vec<f64>,
    /// Tangents or cotangents, laid out as `x`.
    t: Vec<f64>,
}

impl Network {
    /// A network with layers of the given sizes, inputs and outputs included, that says zero until it is trained.
    ///
    /// # Errors
    /// Fewer than two sizes, one that is zero or far too large, too many layers.
    pub fn new(sizes: &[usize], activation: Activation, seed: u64) -> Result<Self, DynamicsError> {
        let count = weights_of(sizes)?;
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut weights = Vec::with_capacity(count);
        for (l, pair) in sizes.windows(2).enumerate() {
            let last = l + 2 == sizes.len();
            let reach = (6.0 / (pair[0] + pair[1]) as f64).sqrt();
            weights.extend((0..pair[0] * pair[1]).map(|_| if last { 0.0 } else { rng.random_range(-reach..reach) }));
            weights.extend((0..pair[1]).map(|_| 0.0));
        }
        let (inputs, outputs) = (sizes[0], sizes[sizes.len() - 1]);
        let normalisation =
            Normalisation { input_mean: vec![0.0; inputs], input_scale: vec![1.0; inputs], output_scale: vec![1.0; outputs] };
        Ok(Self { sizes: sizes.to_vec(), activation, weights, normalisation })
    }

    /// Sizes of all layers, inputs and outputs included.
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// What bends between the layers.
    pub fn activation(&self) -> Activation {
        self.activation
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.sizes[0]
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.sizes[self.sizes.len() - 1]
    }

    /// All weights: layer by layer, the matrix row by row, then the offsets.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Replaces all weights.
    ///
    /// # Errors
    /// The wrong number of them, or one that is not finite.
    pub fn set_weights(&mut self, weights: &[f64]) -> Result<(), DynamicsError> {
        check("weights of the residual", weights, self.weights.len())?;
        self.weights.copy_from_slice(weights);
        Ok(())
    }

    /// What brings inputs to size one, and outputs back.
    pub fn normalisation(&self) -> &Normalisation {
        &self.normalisation
    }

    /// Replaces the normalisation.
    ///
    /// # Errors
    /// Wrong lengths, a number that is not finite, a scale that is not positive.
    pub fn set_normalisation(&mut self, normalisation: Normalisation) -> Result<(), DynamicsError> {
        check("input_mean of the residual", &normalisation.input_mean, self.inputs())?;
        check("input_scale of the residual", &normalisation.input_scale, self.inputs())?;
        check("output_scale of the residual", &normalisation.output_scale, self.outputs())?;
        for (what, values) in [("input_scale", &normalisation.input_scale), ("output_scale", &normalisation.output_scale)] {
            if let Some(value) = values.iter().copied().find(|x| *x <= 0.0) {
                return Err(DynamicsError::OutOfBounds { what: format!("{what} of the residual"), value, must: "positive".into() });
            }
        }
        self.normalisation = normalisation;
        Ok(())
    }

    /// A workspace for this network.
    pub fn workspace(&self) -> NetworkWorkspace {
        let total = self.sizes.iter().sum();
        NetworkWorkspace { x: vec![0.0; total], slope: vec![1.0; total], t: vec![0.0; total] }
    }

    /// `y = network(x)`. The workspace then holds what [`Self::push`] and [`Self::pull`] need.
    pub fn forward(&self, ws: &mut NetworkWorkspace, x: &[f64], y: &mut [f64]) {
        let norm = &self.normalisation;
        for (k, out) in ws.x.iter_mut().take(self.inputs()).enumerate() {
            *out = (x[k] - norm.input_mean[k]) / norm.input_scale[k];
        }
        let (mut at, mut first) = (0, 0);
        let layers = self.sizes.len() - 1;
        for l in 0..layers {
            let (m, n) = (self.sizes[l], self.sizes[l + 1]);
            let (W, b) = self.weights[at..at + n * (m + 1)].split_at(n * m);
            let (before, after) = ws.x[first..first + m + n].split_at_mut(m);
            for i in 0..n {
                let z = b[i] + dot(&W[i * m..(i + 1) * m], before);
                let (value, slope) = if l + 1 == layers { (z, 1.0) } else { self.activation.at(z) };
                after[i] = value;
                ws.slope[first + m + i] = slope;
            }
            at += n * (m + 1);
            first += m;
        }
        for (k, y) in y.iter_mut().enumerate() {
            *y = norm.output_scale[k] * ws.x[first + k];
        }
    }

    /// Forward mode at the last [`Self::forward`]: the change `dy` of the output under changes of the input and, where they
    /// are given, of the weights.
    pub fn push(&self, ws: &mut NetworkWorkspace, dx: &[f64], dweights: Option<&[f64]>, dy: &mut [f64]) {
        let norm = &self.normalisation;
        for (k, t) in ws.t.iter_mut().take(self.inputs()).enumerate() {
            *t = dx[k] / norm.input_scale[k];
        }
        let (mut at, mut first) = (0, 0);
        for l in 0..self.sizes.len() - 1 {
            let (m, n) = (self.sizes[l], self.sizes[l + 1]);
            let W = &self.weights[at..at + n * m];
            let (before, after) = ws.t[first..first + m + n].split_at_mut(m);
            for i in 0..n {
                let mut dz = dot(&W[i * m..(i + 1) * m], before);
                if let Some(d) = dweights {
                    dz += d[at + n * m + i] + dot(&d[at + i * m..at + (i + 1) * m], &ws.x[first..first + m]);
                }
                after[i] = ws.slope[first + m + i] * dz;
            }
            at += n * (m + 1);
            first += m;
        }
        for (k, dy) in dy.iter_mut().enumerate() {
            *dy = norm.output_scale[k] * ws.t[first + k];
        }
    }

    /// Reverse mode at the last [`Self::forward`]: writes the input's cotangent, and adds that of the weights where it is
    /// asked for.
    pub fn pull(&self, ws: &mut NetworkWorkspace, y_bar: &[f64], x_bar: &mut [f64], mut weights_bar: Option<&mut [f64]>) {
        let norm = &self.normalisation;
        let layers = self.sizes.len() - 1;
        let mut first = ws.x.len() - self.outputs();
        for (k, y) in y_bar.iter().enumerate() {
            ws.t[first + k] = norm.output_scale[k] * y;
        }
        let mut at = self.weights.len();
        for l in (0..layers).rev() {
            let (m, n) = (self.sizes[l], self.sizes[l + 1]);
            at -= n * (m + 1);
            first -= m;
            let W = &self.weights[at..at + n * m];
            let (before, after) = ws.t[first..first + m + n].split_at_mut(m);
            before.fill(0.0);
            for i in 0..n {
                let z = ws.slope[first + m + i] * after[i];
                for (b, w) in before.iter_mut().zip(&W[i * m..(i + 1) * m]) {
                    *b += w * z;
                }
                if let Some(bar) = weights_bar.as_deref_mut() {
                    for (w, x) in bar[at + i * m..at + (i + 1) * m].iter_mut().zip(&ws.x[first..first + m]) {
                        *w += z * x;
                    }
                    bar[at + n * m + i] += z;
                }
            }
        }
        for (k, x) in x_bar.iter_mut().enumerate() {
            *x = ws.t[k] / norm.input_scale[k];
        }
    }
}

/// Number of weights of a network of these sizes.
pub(super) fn weights_of(sizes: &[usize]) -> Result<usize, DynamicsError> {
    let fault = |what: &str, value: usize, must: String| {
        Err(DynamicsError::OutOfBounds { what: format!("{what} of the residual's network"), value: value as f64, must })
    };
    if sizes.len() < 2 || sizes.len() > MAX_LAYERS {
        return fault("the number of layers", sizes.len(), format!("from 2 to {MAX_LAYERS}, inputs and outputs included"));
    }
    if let Some(wrong) = sizes.iter().copied().find(|n| *n == 0 || *n > MAX_WIDTH) {
        return fault("the width of a layer", wrong, format!("from 1 to {MAX_WIDTH}"));
    }
    Ok(sizes.windows(2).map(|p| (p[0] + 1) * p[1]).sum())
}

#[inline]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::{Activation, SATURATED};

    /// A curve of many bends is mostly far from each of them: where they are not reckoned no force may jump.
    #[test]
    fn a_bend_far_away_is_the_same_to_a_digit() {
        for z in [1.0, 1.5, 10.0].iter().flat_map(|times| [-1.0, 1.0].map(|side| side * times * SATURATED * (1.0 + 1e-9))) {
            let sigmoid = 1.0 / (1.0 + (-z).exp());
            let (value, slope) = Activation::Silu.at(z);
            assert!(
                (value - z * sigmoid).abs() < f64::EPSILON && (slope - sigmoid * (1.0 + z * (1.0 - sigmoid))).abs() < f64::EPSILON,
                "{z}"
            );
        }
    }
}
