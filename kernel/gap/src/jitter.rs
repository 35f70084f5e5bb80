//! What the noise of measured efforts does to prediction errors: found by simulation, for any model.
//!
//! A measured effort `u + n` drives the model, and the mechanism moved by `u`. So errors hold the model's response to `n`, and a model that
//! responds less fits better without being better. Two things follow.
//!
//! * What noise adds to a sum of squares is what the same noise adds once more (Cook and Stefanski 1994), and can be taken off again. That
//!   is done for sums that are compared; fits minimise errors in units of what their own model makes of the noise, which puts them right.
//! * How much of an effort's jitter is noise of its measurement, and how much the drive really did, shows in the errors: with `H` what a
//!   row's effort differs by from its neighbours', and `R` the model's response, errors hold `R n` and not `R` of what was really done,
//!   so `<e, R H u>` is to the same product for drawn noise, `<R d, R H d>`, as the noise's variance is to that of what was drawn.

use nalgebra::DVector;
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::GapError;
use crate::fit::{Fit, Problem};
use crate::noise;
use crate::trajectory::{Drive, Trajectory};

/// Seed of the noise that efforts are shaken by.
const SEED: u64 = 1;
/// Standard deviation of a share beyond which it says nothing.
const VAGUE: f64 = 0.2;
/// Standard deviations of jitter beyond which an effort jumps.
const JUMP: f64 = 5.0;
/// Least share that is believed.
const LEAST: f64 = 0.04;

/// White noise on the measured efforts of a joint, zero elsewhere.
fn white(trajectory: &Trajectory, size: &[f64], random: &mut Pcg64) -> Vec<f64> {
    let n = trajectory.joints;
    let measured = |j: usize| trajectory.drive[j] == Drive::Effort && size[j] > 0.0;
    (0..trajectory.input.len()).map(|i| if measured(i % n) { size[i % n] * noise::normal(random) } else { 0.0 }).collect()
}

/// What each row's value differs by from the mean of its neighbours', but for more than `most`: a jump is what the drive did, and no noise.
fn beside(values: &[f64], joints: usize, joint: usize, most: f64) -> Vec<f64> {
    let rows = values.len() / joints;
    let mut out = vec![0.0; values.len()];
    for k in 1..rows.saturating_sub(1) {
        let at = |k: usize| values[k * joints + joint];
        let apart = at(k) - 0.5 * (at(k - 1) + at(k + 1));
        out[k * joints + joint] = if apart.abs() < most { apart } else { 0.0 };
    }
    out
}

/// A sum of squares without what noise added to it, as the same noise, with both signs, adds once more. Where that is more than there is, nothing
/// is taken off.
fn without_noise(as_it_is: f64, more: f64, opposite: f64) -> f64 {
    let added = (0.5 * (more + opposite) - as_it_is).max(0.0);
    if added < as_it_is { as_it_is - added } else { as_it_is }
}

impl Problem<'_> {
    /// Errors of a fit where its inputs are larger by so much.
    fn errors_beside(&self, fit: &Fit, more: &[Vec<f64>]) -> Result<DVector<f64>, GapError> {
        let mut trajectories = self.trajectories.to_vec();
        for (trajectory, more) in trajectories.iter_mut().zip(more) {
            trajectory.input.iter_mut().zip(more).for_each(|(u, m)| *u += m);
        }
        let problem = Problem { trajectories: &trajectories, ..self.clone() };
        problem.errors(&fit.hypothesis, &fit.hypothesis.x)
    }

    /// The sum of squares of a fit without what the noise of measured efforts adds to it, its errors weighed as those of a model of such
    /// mobility: what efforts move the model itself is what it could claim too much of. The noise is drawn with both signs, so that what is
    /// linear in it cancels. The sum as it is where efforts are exact, where a little more noise cannot be simulated, or where it adds more than
    /// there is: noise throws such a model from one state into another, a latch that falls or does not, and what it adds once more is not what it
    /// has added.
    pub fn judged(&self, fit: &Fit, mobility: &[f64]) -> f64 {
        let Some((alike, drawn)) = self.shaken(mobility) else { return fit.squares };
        let opposite: Vec<Vec<f64>> = drawn.iter().map(|d| d.iter().map(|x| -x).collect()).collect();
        let squares = |more: &[Vec<f64>]| alike.errors_beside(fit, more).map(|e| e.norm_squared());
        match (squares(&[]), squares(&drawn), squares(&opposite)) {
            (Ok(as_it_is), Ok(a), Ok(b)) => without_noise(as_it_is, a, b),
            _ => fit.squares,
        }
    }

    /// The same problem, its errors weighed as those of a model of such mobility, and noise of its measured efforts; none where these are exact.
    fn shaken(&self, mobility: &[f64]) -> Option<(Self, Vec<Vec<f64>>)> {
        let size = &self.disturbance.effort;
        if size.iter().all(|e| *e == 0.0) {
            return None;
        }
        let mut random = Pcg64::seed_from_u64(SEED);
        let drawn = self.trajectories.iter().map(|t| white(t, size, &mut random)).collect();
        Some((Problem { mobility: Some(mobility.to_vec()), ..self.clone() }, drawn))
    }

    /// Standard deviation of chance in the evidence between two fits: of two models that answer the noise of efforts otherwise, one that is later
    /// for instance, either may come nearer to errors `e` that have nothing to do with it,
    ///
    /// ```text
    /// 1/2 (2 <e, (R_a - R_b) n>) / s^2,   e_k ~ N(0, s^2)   =>   |(R_a - R_b) n| / s
    /// ```
    ///
    /// Zero where efforts are exact, and where a little more noise cannot be simulated, as in [`Self::judged`].
    pub fn chance(&self, fits: [&Fit; 2], mobility: &[f64], scale: f64) -> f64 {
        let Some((alike, drawn)) = self.shaken(mobility) else { return 0.0 };
        let none: Vec<Vec<f64>> = Vec::new();
        let answer = |fit: &Fit| Ok::<_, GapError>(alike.errors_beside(fit, &drawn)? - alike.errors_beside(fit, &none)?);
        let [a, b] = fits.map(answer);
        a.and_then(|a| Ok((a - b?).norm())).unwrap_or(0.0) / scale
    }

    /// Which share of the variance of a joint's effort from row to row, `size` squared, is noise of its measurement; none if the data do not say.
    pub fn share_of_noise(&self, fit: &Fit, joint: usize, size: f64) -> Option<f64> {
        let n = self.disturbance.effort.len();
        let mut random = Pcg64::seed_from_u64(SEED);
        let only: Vec<f64> = (0..n).map(|j| if j == joint { size } else { 0.0 }).collect();
        let drawn: Vec<Vec<f64>> = self.trajectories.iter().map(|t| white(t, &only, &mut random)).collect();
        let jitter = |inputs: &[Vec<f64>]| -> Vec<Vec<f64>> { inputs.iter().map(|u| beside(u, n, joint, JUMP * size)).collect() };
        let measured: Vec<Vec<f64>> = self.trajectories.iter().map(|t| t.input.clone()).collect();
        let response = |more: &[Vec<f64>]| self.errors_beside(fit, more).ok().map(|e| e - &fit.errors);
        let (seen, noise, noisy) = (response(&jitter(&measured))?, response(&drawn)?, response(&jitter(&drawn))?);
        let whole = noise.dot(&noisy);
        let share = fit.errors.dot(&seen) / whole;
        let deviation = (fit.squares / self.measured() as f64).sqrt() * seen.norm() / whole.abs();
        (share.is_finite() && deviation < VAGUE).then(|| share.clamp(LEAST, 1.0))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::float_cmp)]

    use super::without_noise;

    #[test]
    fn noise_that_throws_a_latch_is_no_reason_to_believe_in_it() {
        assert_eq!(without_noise(7000.0, 7300.0, 7500.0), 6600.0);
        assert_eq!(without_noise(7000.0, 6900.0, 6900.0), 7000.0);
        // It falls where it did not: much more is added than there was.
        assert_eq!(without_noise(8856.0, 62_000.0, 8900.0), 8856.0);
    }
}
