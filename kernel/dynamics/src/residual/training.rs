//! Training by gradient through the simulator: windows of recorded motion are rolled out from their first state, and the squared
//! error of what comes out, in units of the error that the simulator makes without a residual, goes back through the steps to
//! the weights. A window of one step is the paper's loss; longer ones see how errors add up.
//!
//! The optimiser is Adam (Kingma and Ba 2015) with its rate going down to a hundredth along a cosine (Loshchilov and Hutter
//! 2017), over windows in a seeded order. The weights that come out are those of the epoch that did best on the data that was
//! kept back, the untrained ones among them: a residual that does not help on unseen data says nothing.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sha2::{Digest, Sha256};

use super::Normalisation;
use crate::multibody::length;
use crate::rollout::{Inputs, Rollout, RolloutOptions};
use crate::{DynamicsError, Input, State, StateCotangent, System, Wanted};

/// Recorded motion: states at equal steps, and the efforts held from each to the next.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// States, one more than steps.
    pub states: Vec<State>,
    /// Efforts, `steps x nv`.
    pub tau: Vec<f64>,
}

/// Settings of a training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trainer {
    /// Time between the states of the data, s.
    pub dt: f64,
    /// Steps in a window.
    pub horizon: usize,
    /// Passes over the data.
    pub epochs: usize,
    /// Windows in a batch.
    pub batch: usize,
    /// First rate of Adam.
    pub rate: f64,
    /// Weight decay: share of each weight that a step takes away, over the rate.
    pub decay: f64,
    /// Seed of the order of windows.
    pub seed: u64,
}

impl Default for Trainer {
    fn default() -> Self {
        Self { dt: 1e-3, horizon: 1, epochs: 60, batch: 32, rate: 1e-2, decay: 1e-4, seed: 0 }
    }
}

/// How a training went. Losses are mean squares over the error without a residual: 1 before training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingReport {
    /// Mean loss of each epoch, on the data it was trained on.
    pub losses: Vec<f64>,
    /// Loss on the data kept back before training, then after each epoch.
    pub held_out: Vec<f64>,
    /// Which of those is the best; its weights were taken.
    pub best: usize,
    /// SHA-256 of data, settings, normalisation and first weights; stands in the file.
    pub hash: String,
}

/// A window: which sequence, and its first state.
type Window = (usize, usize);

impl Trainer {
    /// Trains the residual of a system on `data`, and keeps the weights that do best on `held_out`.
    ///
    /// # Errors
    /// The system has no residual; data that is empty, shorter than a window, of the wrong lengths or not finite; data that the
    /// system meets exactly; settings out of their bounds; a step that fails.
    pub fn train(&self, system: &mut System, data: &[Sequence], held_out: &[Sequence]) -> Result<TrainingReport, DynamicsError> {
        let Some(first) = system.residual().cloned() else {
            return Err(super::fault("system", "has no residual; give it one with `set_residual`"));
        };
        for (what, ok) in [("horizon", self.horizon), ("epochs", self.epochs), ("batch", self.batch)] {
            if ok == 0 {
                return Err(DynamicsError::OutOfBounds { what: format!("the training's {what}"), value: 0.0, must: "at least 1".into() });
            }
        }
        for (what, value) in [("rate", self.rate), ("decay", self.decay)] {
            if !(0.0..1.0).contains(&value) {
                let what = format!("the training's {what}");
                return Err(DynamicsError::OutOfBounds { what, value, must: "at least 0 and below 1".into() });
            }
        }
        let mut windows = self.windows(system, data)?;
        let kept = self.windows(system, held_out)?;
        let scale = self.normalise(system, data)?;
        let hash = self.hash(system, data, held_out);
        let options = RolloutOptions { wanted: Wanted { rigid: false, weights: true }, ..RolloutOptions::new(self.horizon, self.dt) };
        let mut rollout = Rollout::new(system, options)?;
        let mut weights = first.network().weights().to_vec();
        let (count, mut best_weights) = (weights.len(), weights.clone());
        let (mut mean, mut square, mut gradient) = (vec![0.0; count], vec![0.0; count], vec![0.0; count]);
        let mut rng = Pcg64::seed_from_u64(self.seed);
        let mut report = TrainingReport { losses: Vec::new(), held_out: Vec::new(), best: 0, hash };
        report.held_out.push(self.loss(system, &mut rollout, held_out, &kept, &scale, None)?);
        let (mut time, total) = (0, self.epochs * windows.len().div_ceil(self.batch));
        for epoch in 0..self.epochs {
            for k in (1..windows.len()).rev() {
                windows.swap(k, rng.random_range(0..=k));
            }
            let mut sum = 0.0;
            for batch in windows.chunks(self.batch) {
                gradient.fill(0.0);
                sum += batch.len() as f64 * self.loss(system, &mut rollout, data, batch, &scale, Some(&mut gradient))?;
                let along = f64::from(time) / total as f64;
                let rate = self.rate * (0.01 + 0.99 * 0.5 * (1.0 + (std::f64::consts::PI * along).cos()));
                time += 1;
                let (one, two) = (1.0 - 0.9_f64.powi(time), 1.0 - 0.999_f64.powi(time));
                for k in 0..count {
                    mean[k] += 0.1 * (gradient[k] - mean[k]);
                    square[k] += 0.001 * (gradient[k] * gradient[k] - square[k]);
                    weights[k] -= rate * (mean[k] / one / ((square[k] / two).sqrt() + 1e-8) + self.decay * weights[k]);
                }
                set(system, &weights)?;
            }
            report.losses.push(sum / windows.len() as f64);
            report.held_out.push(self.loss(system, &mut rollout, held_out, &kept, &scale, None)?);
            if report.held_out[epoch + 1] < report.held_out[report.best] {
                report.best = epoch + 1;
                best_weights.copy_from_slice(&weights);
            }
        }
        set(system, &best_weights)?;
        if let Some(residual) = system.residual_mut() {
            residual.training.clone_from(&report.hash);
        }
        Ok(report)
    }

    /// Windows overlap by half.
    fn windows(&self, system: &System, data: &[Sequence]) -> Result<Vec<Window>, DynamicsError> {
        let n = system.multibody().nv();
        let mut windows = Vec::new();
        for (s, sequence) in data.iter().enumerate() {
            for state in &sequence.states {
                system.check_state(state)?;
            }
            let steps = sequence.states.len().saturating_sub(1);
            length("the efforts of a sequence", sequence.tau.len(), steps * n)?;
            windows.extend((0..(steps + 1).saturating_sub(self.horizon)).step_by(self.horizon.div_ceil(2)).map(|k| (s, k)));
        }
        if windows.is_empty() {
            let what = "the number of windows in the data of a training".into();
            return Err(DynamicsError::OutOfBounds { what, value: 0.0, must: format!("at least 1, of {} steps", self.horizon) });
        }
        Ok(windows)
    }

    /// Sets the normalisation from the data; returns the error of one step's velocities without a residual, by velocity.
    fn normalise(&self, system: &mut System, data: &[Sequence]) -> Result<Vec<f64>, DynamicsError> {
        let n = system.multibody().nv();
        let Some(placed) = system.residual.take() else { return Ok(vec![1.0; n]) };
        let result = (|| {
            let (mut ws, mut rigid, mut room) = (system.workspace(), system.multibody().workspace(), placed.workspace(n));
            let (mut sum, mut squares) = (vec![0.0; placed.inputs(&room).len()], vec![0.0; placed.inputs(&room).len()]);
            let (mut force, mut error, mut change) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
            let (mut e, mut count) = (vec![0.0; n], 0.0_f64);
            for sequence in data {
                for (pair, u) in sequence.states.windows(2).zip(sequence.tau.chunks(n)) {
                    let mut next = pair[0].clone();
                    system.step(&mut ws, &mut next, &Input { tau: u, external: &[] }, self.dt)?;
                    placed.gather(&mut room, &pair[0].q, &pair[0].v, u, &next.v, self.dt);
                    for (k, x) in placed.inputs(&room).iter().enumerate() {
                        sum[k] += x;
                        squares[k] += x * x;
                    }
                    system.multibody().set_state(&mut rigid, &pair[0].q, &pair[0].v)?;
                    let M = system.multibody().mass_matrix(&mut rigid)?;
                    for k in 0..n {
                        e[k] = pair[1].v[k] - next.v[k];
                        error[k] += e[k] * e[k];
                        change[k] += (pair[1].v[k] - pair[0].v[k]).powi(2);
                    }
                    for k in 0..n {
                        let f: f64 = (0..n).map(|j| M[(k, j)] * e[j]).sum::<f64>() / self.dt;
                        force[k] += f * f;
                    }
                    count += 1.0;
                }
            }
            let mean = |x: f64| x / count.max(1.0);
            let input_mean: Vec<f64> = sum.iter().map(|s| mean(*s)).collect();
            let input_scale = squares.iter().zip(&input_mean).map(|(s, m)| {
                let deviation = (mean(*s) - m * m).max(0.0).sqrt();
                // An input that never changes keeps its size.
                if deviation > 1e-9 * (1.0 + m.abs()) { deviation } else { 1.0 }
            });
            let largest = force.iter().copied().fold(0.0, f64::max);
            if largest <= 0.0 || largest.is_nan() {
                return Err(super::fault("data", "is met exactly by the system without a residual: there is nothing to learn"));
            }
            let output_scale = placed.acts().iter().map(|k| mean(force[*k].max(1e-6 * largest)).sqrt()).collect();
            let normalisation = Normalisation { input_scale: input_scale.collect(), input_mean, output_scale };
            // A joint that the system gets right is weighed no more than a thousandth of its own motion.
            let scale = error.iter().zip(&change).map(|(e, c)| mean(e.max(1e-6 * c)).sqrt().max(1e-12)).collect();
            Ok((normalisation, scale))
        })();
        system.residual = Some(placed);
        let (normalisation, scale) = result?;
        if let Some(residual) = system.residual_mut() {
            residual.set_normalisation(normalisation)?;
        }
        Ok(scale)
    }

    /// Mean loss over windows; adds its gradient by the weights where it is asked for.
    fn loss(
        &self,
        system: &System,
        rollout: &mut Rollout,
        data: &[Sequence],
        windows: &[Window],
        scale: &[f64],
        mut gradient: Option<&mut [f64]>,
    ) -> Result<f64, DynamicsError> {
        let n = scale.len();
        let (mut sum, mut apart) = (0.0, vec![0.0; n]);
        let each = 1.0 / (windows.len() * self.horizon * 2 * n) as f64;
        for &(s, first) in windows {
            let sequence = &data[s];
            let inputs = Inputs { tau: &sequence.tau[first * n..(first + self.horizon) * n], ..Inputs::default() };
            let mut at = |step: usize, state: &State, bar: Option<&mut StateCotangent>| -> f64 {
                let wanted = &sequence.states[first + step];
                let mut loss = 0.0;
                if step == 0 || system.multibody().difference(&state.q, &wanted.q, &mut apart).is_err() {
                    return loss;
                }
                // Errors grow along a window: after `step` steps as much as `step` times the first step's, positions by that time.
                let along = step as f64;
                let mut bar = bar;
                for k in 0..n {
                    let by_v = 1.0 / (scale[k] * along);
                    let by_q = by_v / (self.dt * along);
                    let (ev, eq) = ((state.v[k] - wanted.v[k]) * by_v, -apart[k] * by_q);
                    loss += each * (ev * ev + eq * eq);
                    if let Some(bar) = bar.as_deref_mut() {
                        bar.v[k] += 2.0 * each * ev * by_v;
                        bar.q[k] += 2.0 * each * eq * by_q;
                    }
                }
                loss
            };
            rollout.forward(system, &sequence.states[first], &inputs, |step, state| sum += at(step, state, None))?;
            if let Some(gradient) = gradient.as_deref_mut() {
                rollout.backward(system, &inputs, |step, state, bar| {
                    at(step, state, Some(bar));
                })?;
                for (to, from) in gradient.iter_mut().zip(&rollout.gradient().natural.weights) {
                    *to += from;
                }
            }
        }
        Ok(sum)
    }

    fn hash(&self, system: &System, data: &[Sequence], held_out: &[Sequence]) -> String {
        let mut hash = Sha256::new();
        let mut numbers = |values: &[f64]| {
            hash.update((values.len() as u64).to_le_bytes());
            for value in values {
                hash.update(value.to_le_bytes());
            }
        };
        numbers(&[self.dt, self.rate, self.decay, self.horizon as f64, self.epochs as f64, self.batch as f64, self.seed as f64]);
        if let Some(residual) = system.residual() {
            let normalisation = residual.network().normalisation();
            numbers(residual.network().weights());
            numbers(&normalisation.input_mean);
            numbers(&normalisation.input_scale);
            numbers(&normalisation.output_scale);
        }
        for set in [data, held_out] {
            for sequence in set {
                for state in &sequence.states {
                    numbers(&state.q);
                    numbers(&state.v);
                    numbers(&state.z);
                }
                numbers(&sequence.tau);
            }
        }
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

fn set(system: &mut System, weights: &[f64]) -> Result<(), DynamicsError> {
    system.residual_mut().map_or(Ok(()), |r| r.set_weights(weights))
}
