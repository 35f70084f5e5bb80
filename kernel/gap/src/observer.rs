//! Prediction errors of a model along measured motion (Ljung 1999, chapter 7).
//!
//! The simulator runs along the data. At each sample its state is moved towards the measurement by the gain of a steady Kalman filter
//! for `q' = v`, `v' = a_model + noise`:
//!
//! ```text
//! e_k = y_k - y(x_k),   x_k <- x_k + K_k e_k,   x_k+1 = simulate(x_k, u_k)
//! ```
//!
//! If the model is right, the errors `e_k` are white with variance `S_k = P + sigma^2`. The gain depends on time, on the noises and on
//! the inertias that these act on, and on nothing else of the model. So `e` is a smooth function of the model's parameters, each error
//! depends on the motion of a short time only, and least squares is a well-conditioned problem even where a model is far off.
//!
//! What no model has is a share of what happens around a row, of accelerations and of efforts: where a joint hardly moves and hardly is
//! pushed, a model is hardly off. An effort's share and the noise of a measured one are forces, and accelerate less where there is more
//! inertia: taken as accelerations they would make heavier models fit better, the attenuation of a slope whose regressor is noisy (Fuller
//! 1987). It is the effort that is observed with noise, given the motion, so the density of an error is that of a force, and has no term
//! for the inertia's own logarithm.
//!
//! Just after a start no model knows what acts: inputs that were sent before are still on their way, and inner states are not at rest. There
//! the measurement rules, and nothing is counted.

use crate::GapError;
use crate::plant::{Motion, Plant};
use crate::trajectory::Trajectory;

/// What the data bring with them: standard deviations, by joint.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Disturbance {
    /// Of measured positions, rad or m.
    pub position: Vec<f64>,
    /// Of accelerations and efforts that no model has, each held over one interval, as a share of those around it.
    pub share: Vec<f64>,
    /// Accelerations that count as none, rad/s^2 or m/s^2.
    pub quiet: Vec<f64>,
    /// Of measured efforts that drive the model, each held over one interval, N m or N.
    pub effort: Vec<f64>,
}

impl Disturbance {
    /// What a filter sees of it where efforts accelerate joints so much, by columns.
    pub fn behind(&self, mobility: &[f64]) -> Noise {
        Noise {
            position: self.position.clone(),
            share: self.share.clone(),
            quiet: self.quiet.clone(),
            effort: self.effort.clone(),
            mobility: mobility.to_vec(),
        }
    }

    /// The same, noise of positions and the share larger by factors.
    pub fn times(&self, [position, share]: [f64; 2]) -> Self {
        Self { position: times(&self.position, position), share: times(&self.share, share), ..self.clone() }
    }
}

fn times(values: &[f64], factor: f64) -> Vec<f64> {
    values.iter().map(|x| factor * x).collect()
}

/// Standard deviations as a filter takes them, by joint.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Noise {
    /// Of measured positions, rad or m.
    pub position: Vec<f64>,
    /// Of accelerations and efforts that no model has, each held over one interval, as a share of those around it.
    pub share: Vec<f64>,
    /// Accelerations that count as none, rad/s^2 or m/s^2.
    pub quiet: Vec<f64>,
    /// Of efforts, each held over one interval, N m or N.
    pub effort: Vec<f64>,
    /// How much efforts accelerate joints, by columns.
    pub mobility: Vec<f64>,
}

impl Noise {
    /// The same, larger by factors.
    pub fn times(&self, [position, share]: [f64; 2]) -> Self {
        Self { position: times(&self.position, position), share: times(&self.share, share), ..self.clone() }
    }

    /// Standard deviation of the acceleration of joint `j` on the way to row `k`, rad/s^2 or m/s^2. Where all is `strange`, as much as there is.
    pub fn acceleration(&self, trajectory: &Trajectory, k: usize, j: usize, strange: bool) -> f64 {
        let n = trajectory.joints;
        let share = |j: usize| if strange { self.share[j].max(1.0) } else { self.share[j] };
        let moved = share(j) * trajectory.liveliness[k * n + j].max(self.quiet[j]);
        let pushed = |i: usize| self.mobility[i * n + j] * self.effort[i].hypot(share(i) * trajectory.strain[k * n + i]);
        (moved * moved + (0..n).map(|i| pushed(i).powi(2)).sum::<f64>()).sqrt()
    }
}

/// Gains of one trajectory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gains {
    joints: usize,
    /// Position and velocity gain, and the standard deviation of the prediction error, by row and joint; zeros where nothing was
    /// measured, an infinite deviation where the error is not counted.
    rows: Vec<[f64; 3]>,
    /// Covariance (qq, qv, vv) before and after the measurement, by row and joint.
    before: Vec<[f64; 3]>,
    after: Vec<[f64; 3]>,
}

/// How far a first position may be off before anything is known, rad or m: an encoder's offset, and more. A first velocity, 1 rad/s or m/s.
const FIRST_POSITION: f64 = 0.03;
/// Rows by which a first velocity is taken.
const FIRST_ROWS: usize = 6;

impl Gains {
    pub fn new(trajectory: &Trajectory, noise: &Noise) -> Self {
        let (n, rows) = (trajectory.joints, trajectory.rows());
        let zero = vec![[0.0; 3]; rows * n];
        let mut gains = Self { joints: n, rows: zero.clone(), before: zero.clone(), after: zero };
        for j in 0..n {
            let variance = noise.position[j] * noise.position[j];
            let (mut p, mut start) = ([0.0; 3], 0);
            for k in 0..rows {
                if trajectory.starts.contains(&k) {
                    start = k;
                    p = [FIRST_POSITION * FIRST_POSITION, 0.0, 1.0];
                } else {
                    let h = trajectory.time[k] - trajectory.time[k - 1];
                    let q = noise.acceleration(trajectory, k, j, trajectory.burns_in(start, k)).powi(2);
                    let [a, b, c] = p;
                    p = [a + 2.0 * h * b + h * h * c + q * h.powi(4) / 4.0, b + h * c + q * h.powi(3) / 2.0, c + q * h * h];
                }
                let at = k * n + j;
                gains.before[at] = p;
                if trajectory.position[at].is_finite() {
                    let s = p[0] + variance;
                    let gain = [p[0] / s, p[1] / s];
                    gains.rows[at] = [gain[0], gain[1], if trajectory.counted[at] { s.sqrt() } else { f64::INFINITY }];
                    p = [p[0] * (1.0 - gain[0]), p[1] * (1.0 - gain[0]), p[2] - gain[1] * p[1]];
                }
                gains.after[at] = p;
            }
        }
        gains
    }

    /// Position and velocity gain, and the standard deviation of the prediction error, by row and joint.
    pub fn rows(&self) -> &[[f64; 3]] {
        &self.rows
    }

    /// Sum of the logarithms of the errors' standard deviations.
    pub fn log_determinant(&self) -> f64 {
        self.rows.iter().filter(|r| r[2] > 0.0 && r[2].is_finite()).map(|r| r[2].ln()).sum()
    }

    /// Standard deviation of the prediction error of an entry; zero where nothing was measured, infinite where it is not counted.
    pub fn deviation(&self, entry: usize) -> f64 {
        self.rows[entry][2]
    }

    /// Velocity gain over the interval of time: what acceleration an error stands for.
    pub fn acceleration(&self, trajectory: &Trajectory, k: usize, j: usize) -> f64 {
        let h = trajectory.time[k] - trajectory.time[k.max(1) - 1];
        if k == 0 || h <= 0.0 { 0.0 } else { self.rows[k * self.joints + j][1] / h }
    }
}

/// States along a run, row by row, as the filter has them after each measurement.
#[derive(Debug, Clone, Default)]
pub(crate) struct Run {
    /// Gains of the filter.
    pub gains: Gains,
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    /// What the model predicted for the row from the one before.
    pub q_predicted: Vec<f64>,
    pub v_predicted: Vec<f64>,
    /// Inner states of effects after the row.
    pub z: Vec<f64>,
    /// Effort of the drive, and force of gravity and Coriolis, on the way to the row.
    pub tau: Vec<f64>,
    pub load: Vec<f64>,
    /// Inverse of the mass matrix on the way to the row, joints x joints.
    pub inverse: Vec<f64>,
}

/// Runs a plant along a trajectory. `errors` gets one normalised prediction error by row and joint, zero where nothing was measured.
/// Inner states start at zero, unless the trajectory goes on where the one before it ended: then they are those of `motion`.
pub(crate) fn run(
    plant: &Plant,
    trajectory: &Trajectory,
    gains: &Gains,
    motion: &mut Motion,
    errors: &mut Vec<f64>,
    mut record: Option<&mut Run>,
) -> Result<(), GapError> {
    let n = trajectory.joints;
    if !trajectory.continues {
        motion.state.z.fill(0.0);
    }
    for k in 0..trajectory.rows() {
        if trajectory.starts.contains(&k) {
            for j in 0..n {
                motion.state.v[j] = first_velocity(trajectory, k, j);
                motion.acceleration[j] = 0.0;
                let first = trajectory.position.iter().skip(k * n + j).step_by(n).find(|y| y.is_finite());
                motion.state.q[j] = first.copied().unwrap_or(0.0);
            }
            plant.clamp(motion);
        } else {
            plant.interval(motion, trajectory, k - 1)?;
        }
        motion.state.time = trajectory.time[k];
        if let Some(run) = record.as_deref_mut() {
            run.q_predicted.extend_from_slice(&motion.state.q);
            run.v_predicted.extend_from_slice(&motion.state.v);
        }
        for j in 0..n {
            let [gain_q, gain_v, deviation] = gains.rows[k * n + j];
            if deviation == 0.0 {
                errors.push(0.0);
                continue;
            }
            let e = trajectory.position[k * n + j] - plant.reading(motion, j);
            errors.push(e / deviation);
            motion.state.q[j] += gain_q * e;
            motion.state.v[j] += gain_v * e;
        }
        plant.clamp(motion);
        if let Some(run) = record.as_deref_mut() {
            run.q.extend_from_slice(&motion.state.q);
            run.v.extend_from_slice(&motion.state.v);
            run.z.extend_from_slice(&motion.state.z);
            run.tau.extend_from_slice(motion.tau());
            run.load.extend_from_slice(motion.ws.load());
            plant.inverse_mass(motion, &mut run.inverse);
        }
    }
    Ok(())
}

/// Slope of a line through the first positions after a start (least squares).
fn first_velocity(trajectory: &Trajectory, start: usize, j: usize) -> f64 {
    let n = trajectory.joints;
    let end = trajectory.starts.iter().copied().find(|s| *s > start).unwrap_or(trajectory.rows());
    let rows: Vec<usize> = (start..end).filter(|k| trajectory.position[k * n + j].is_finite()).take(FIRST_ROWS).collect();
    let mean = |f: &dyn Fn(usize) -> f64| rows.iter().map(|k| f(*k)).sum::<f64>() / rows.len().max(1) as f64;
    let (t, y) = (|k: usize| trajectory.time[k], |k: usize| trajectory.position[k * n + j]);
    let (middle, level) = (mean(&t), mean(&y));
    let spread = mean(&|k| (t(k) - middle).powi(2));
    if spread > 0.0 { mean(&|k| (t(k) - middle) * (y(k) - level)) / spread } else { 0.0 }
}

/// Smooths a run backwards (Rauch, Tung and Striebel 1965), with the filter's own covariances.
pub(crate) fn smooth(run: &mut Run, trajectory: &Trajectory, gains: &Gains) {
    let n = trajectory.joints;
    for k in (0..trajectory.rows().saturating_sub(1)).rev() {
        if trajectory.starts.contains(&(k + 1)) {
            continue;
        }
        let h = trajectory.time[k + 1] - trajectory.time[k];
        for j in 0..n {
            let (here, next) = (k * n + j, (k + 1) * n + j);
            let ([a, b, c], [d, e, f]) = (gains.after[here], gains.before[next]);
            let determinant = d * f - e * e;
            if determinant.is_nan() || determinant <= 0.0 {
                continue;
            }
            // P F^T inverse(P-), F = [1 h; 0 1].
            let left = [[a + h * b, b], [b + h * c, c]];
            let inverse = [[f / determinant, -e / determinant], [-e / determinant, d / determinant]];
            let g = |r: usize, s: usize| left[r][0] * inverse[0][s] + left[r][1] * inverse[1][s];
            let (dq, dv) = (run.q[next] - run.q_predicted[next], run.v[next] - run.v_predicted[next]);
            run.q[here] += g(0, 0) * dq + g(0, 1) * dv;
            run.v[here] += g(1, 0) * dq + g(1, 1) * dv;
        }
    }
}
