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
//! What efforts are off by is held from row to row, as they are. The share of accelerations that no model has comes and goes in between: it is
//! white, and tells a row's position less of its velocity (`P_qq` grows by a third of `(h v')^2`, not by a quarter; Bar-Shalom et al. 2001,
//! sections 6.2 and 6.3). Were it held, too, an exact encoder's filter would answer an error by twice its velocity, and ring: its pole is at -1
//! where noise is small, and one blow that no model follows is an error in all rows after it, for any force there to explain. White, the pole is
//! at -.27.
//!
//! What no model has is a share of what happens around a row, of accelerations and of efforts: where a joint hardly moves and hardly is
//! pushed, a model is hardly off. An effort's share and the noise of a measured one are forces, and accelerate less where there is more
//! inertia: taken as accelerations they would make heavier models fit better, the attenuation of a slope whose regressor is noisy (Fuller
//! 1987). It is the effort that is observed with noise, given the motion, so the density of an error is that of a force, and has no term
//! for the inertia's own logarithm.
//!
//! Where an input was not measured and is put in, what acts is off by as much as is doubted.
//!
//! Just after a start no model knows what acts: inputs that were sent before are still on their way, and inner states are not at rest. There
//! the measurement rules, and nothing is counted.
//!
//! An effort that is measured beside a command is one more observation: of what the drive's law and what happens to commands make of the
//! command, at the state that the filter has,
//!
//! ```text
//! e_k = (tau_k - tau(x_k, u_k)) / s_k,   s_k^2 = noise^2 + (share of the effort)^2 + (slopes)^T P_k (slopes) + (what a row changes)^2 / 4
//! ```
//!
//! the last because nobody says whether it was read before or after the row's command came. When it was read in all of them, from a row before
//! to a row after, is the number that fits best, so that a drive's delay is not taken for that. It moves no state.

use nalgebra::DVector;

use crate::GapError;
use crate::plant::{Motion, Plant};
use crate::trajectory::{CUT, Trajectory};

/// What the data bring with them: standard deviations, by joint.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Disturbance {
    /// Of measured positions, rad or m.
    pub position: Vec<f64>,
    /// Of accelerations and efforts that no model has, as a share of those around a row.
    pub share: Vec<f64>,
    /// Accelerations that count as none, rad/s^2 or m/s^2.
    pub quiet: Vec<f64>,
    /// Of measured efforts that drive the model, each held over one interval, N m or N.
    pub effort: Vec<f64>,
    /// Of efforts that are measured beside a command, N m or N.
    pub reading: Vec<f64>,
}

impl Disturbance {
    /// What a filter sees of it where efforts accelerate joints so much, by columns, and drives answer so.
    pub fn behind(&self, mobility: &[f64], drives: &[DriveSlopes]) -> Noise {
        Noise {
            position: self.position.clone(),
            share: self.share.clone(),
            quiet: self.quiet.clone(),
            effort: self.effort.clone(),
            mobility: mobility.to_vec(),
            reading: self.reading.clone(),
            drives: drives.to_vec(),
        }
    }

    /// The same, noise of positions and the share larger by factors.
    pub fn times(&self, [position, share]: [f64; 2]) -> Self {
        Self { position: times(&self.position, position), share: times(&self.share, share), ..self.clone() }
    }

    /// By how many times more, at the most, errors say under this one than under another: the square of how much smaller any of it is.
    pub fn tells_more_than(&self, other: &Self) -> f64 {
        let both = |of: fn(&Self) -> &Vec<f64>| of(self).iter().zip(of(other)).filter(|(own, _)| **own > 0.0);
        let all = both(|d| &d.position).chain(both(|d| &d.share)).chain(both(|d| &d.effort));
        all.map(|(own, other)| (other / own).powi(2)).fold(1.0, f64::max)
    }

    /// Are efforts measured beside commands?
    pub fn reads_efforts(&self) -> bool {
        self.reading.iter().any(|r| *r > 0.0)
    }
}

fn times(values: &[f64], factor: f64) -> Vec<f64> {
    values.iter().map(|x| factor * x).collect()
}

/// How a drive's effort answers: by its input (1, N m/rad or N m/V), its position (N m/rad) and its velocity (N m s/rad); N for N m and m for rad
/// where a joint slides.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct DriveSlopes {
    pub input: f64,
    pub q: f64,
    pub v: f64,
}

/// Standard deviations as a filter takes them, by joint.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Noise {
    /// Of measured positions, rad or m.
    pub position: Vec<f64>,
    /// Of accelerations and efforts that no model has, as a share of those around a row.
    pub share: Vec<f64>,
    /// Accelerations that count as none, rad/s^2 or m/s^2.
    pub quiet: Vec<f64>,
    /// Of efforts, each held over one interval, N m or N.
    pub effort: Vec<f64>,
    /// How much efforts accelerate joints, by columns.
    pub mobility: Vec<f64>,
    /// Of efforts that are measured beside a command, N m or N, and how drives answer.
    pub reading: Vec<f64>,
    pub drives: Vec<DriveSlopes>,
}

impl Noise {
    /// The same, larger by factors.
    pub fn times(&self, [position, share]: [f64; 2]) -> Self {
        Self { position: times(&self.position, position), share: times(&self.share, share), ..self.clone() }
    }

    /// Variances of the mean acceleration of joint `j` on the way to row `k`, rad^2/s^4 or m^2/s^4: of what efforts are off by, which is held
    /// until the row as they are, and of what comes and goes. Where all is `strange`, as much as there is.
    #[inline]
    pub fn accelerations(&self, trajectory: &Trajectory, k: usize, j: usize, strange: bool) -> [f64; 2] {
        let n = trajectory.joints;
        let share = |j: usize| if strange { self.share[j].max(1.0) } else { self.share[j] };
        let doubt = |i: usize| trajectory.doubt.get(k * n + i).copied().unwrap_or(0.0);
        let square = |x: f64| x * x;
        let effort = |i: usize| square(self.effort[i]) + square(share(i) * trajectory.strain[k * n + i]) + square(doubt(i));
        let held = (0..n).map(|i| square(self.mobility[i * n + j]) * effort(i)).sum();
        [held, square(share(j) * trajectory.liveliness[k * n + j].max(self.quiet[j]))]
    }

    /// Are efforts measured beside commands?
    pub fn reads_efforts(&self) -> bool {
        self.reading.iter().any(|r| *r > 0.0)
    }

    /// Standard deviation of what the effort read in row `k` on joint `j` differs by from what a right model makes of the state there, which is
    /// known with a covariance (qq, qv, vv).
    fn reading(&self, trajectory: &Trajectory, k: usize, j: usize, [qq, qv, vv]: [f64; 3]) -> f64 {
        let n = trajectory.joints;
        let DriveSlopes { input, q, v } = self.drives[j];
        let state = q * q * qq + 2.0 * q * v * qv + v * v * vv;
        let model = self.share[j] * trajectory.strain[k * n + j];
        let change = |k: usize| trajectory.input[k * n + j] - trajectory.input[(k - 1) * n + j];
        let late = if k > 0 && !trajectory.starts.contains(&k) { 0.5 * input * change(k) } else { 0.0 };
        let late = if late.is_finite() { late } else { 0.0 };
        (self.reading[j].powi(2) + model * model + state.max(0.0) + late * late).sqrt()
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
    /// Standard deviation of an effort measured beside a command, by row and joint, zero where none was; empty where no data have any.
    efforts: Vec<f64>,
}

/// How far a first position may be off before anything is known, rad or m: an encoder's offset, and more. A first velocity, 1 rad/s or m/s.
const FIRST_POSITION: f64 = 0.03;
/// Rows by which a first velocity is taken.
const FIRST_ROWS: usize = 6;

impl Gains {
    pub fn new(trajectory: &Trajectory, noise: &Noise) -> Self {
        let (n, rows) = (trajectory.joints, trajectory.rows());
        let zero = vec![[0.0; 3]; rows * n];
        let mut gains = Self { joints: n, rows: zero.clone(), before: zero.clone(), after: zero, efforts: Vec::new() };
        for j in 0..n {
            let variance = noise.position[j] * noise.position[j];
            let (mut p, mut start) = ([0.0; 3], 0);
            let mut starts = trajectory.starts.iter().peekable();
            for k in 0..rows {
                if starts.next_if_eq(&&k).is_some() {
                    start = k;
                    p = [FIRST_POSITION * FIRST_POSITION, 0.0, 1.0];
                } else {
                    let h = trajectory.time[k] - trajectory.time[k - 1];
                    let [held, white] = noise.accelerations(trajectory, k, j, trajectory.burns_in(start, k)).map(|a| h * h * a);
                    let ([a, b, c], both) = (p, held + white);
                    p = [a + 2.0 * h * b + h * h * (c + held / 4.0 + white / 3.0), b + h * (c + both / 2.0), c + both];
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
        if noise.reads_efforts() {
            let read =
                |i: usize| if trajectory.effort[i].is_finite() { noise.reading(trajectory, i / n, i % n, gains.after[i]) } else { 0.0 };
            gains.efforts = (0..rows * n).map(read).collect();
        }
        gains
    }

    /// Standard deviations of efforts measured beside a command, by row and joint, zero where none was; empty where no data have any.
    pub fn efforts(&self) -> &[f64] {
        &self.efforts
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

/// Normalised prediction errors, one by row and joint, zero where nothing was measured.
#[derive(Debug, Default)]
pub(crate) struct Errors {
    /// Of positions.
    pub position: Vec<f64>,
    /// Of efforts measured beside commands; empty where no data have any.
    pub effort: Vec<f64>,
}

impl Errors {
    /// Those of positions, trajectory by trajectory, and behind all of them those of efforts.
    pub fn joined(parts: &[Self]) -> DVector<f64> {
        let positions = parts.iter().flat_map(|p| &p.position);
        DVector::from_iterator(
            parts.iter().map(|p| p.position.len() + p.effort.len()).sum(),
            positions.chain(parts.iter().flat_map(|p| &p.effort)).copied(),
        )
    }
}

/// Runs a plant along a trajectory under a noise. `errors` gets the prediction errors; what comes back are the filter's gains.
/// Inner states start at zero, unless the trajectory goes on where the one before it ended: then they are those of `motion`.
pub(crate) fn run(
    plant: &Plant,
    trajectory: &Trajectory,
    noise: &Noise,
    motion: &mut Motion,
    errors: &mut Errors,
    mut record: Option<&mut Run>,
) -> Result<Gains, GapError> {
    let trajectory = &*plant.on_time(trajectory);
    let gains = Gains::new(trajectory, noise);
    let n = trajectory.joints;
    if !trajectory.continues {
        motion.state.z.fill(0.0);
    }
    // Efforts as they would be read, by row and joint.
    let mut read = vec![f64::NAN; gains.efforts.len()];
    let mut starts = trajectory.starts.iter().peekable();
    for k in 0..trajectory.rows() {
        if starts.next_if_eq(&&k).is_some() {
            if k > 0 || trajectory.continues {
                let passed = trajectory.time[k] - motion.state.time;
                plant.pause(motion, passed.max(0.0));
                // A new recording after a pause.
                if k == 0 && passed > (CUT.0 * trajectory.period()).max(CUT.1) {
                    plant.rest_bases(motion);
                }
            }
            for j in 0..n {
                motion.state.v[j] = first_velocity(trajectory, k, j);
                motion.acceleration[j] = 0.0;
                let first = trajectory.position.iter().skip(k * n + j).step_by(n).find(|y| y.is_finite());
                motion.state.q[j] = first.copied().unwrap_or(0.0);
            }
            plant.clamp(motion);
        } else {
            let last = read.get_mut((k - 1) * n..k * n).unwrap_or_default();
            last.iter_mut().enumerate().for_each(|(j, u)| *u = plant.misread_effort(motion, j));
            plant.interval(motion, trajectory, k - 1)?;
            last.iter_mut().zip(motion.delivered()).for_each(|(u, delivered)| *u += delivered);
        }
        motion.state.time = trajectory.time[k];
        if let Some(run) = record.as_deref_mut() {
            run.q_predicted.extend_from_slice(&motion.state.q);
            run.v_predicted.extend_from_slice(&motion.state.v);
        }
        for j in 0..n {
            let [gain_q, gain_v, deviation] = gains.rows[k * n + j];
            if deviation == 0.0 {
                errors.position.push(0.0);
                continue;
            }
            let measured = trajectory.position[k * n + j];
            let (e, weight) = match &trajectory.on_time {
                None => (measured - plant.reading(motion, j), 1.0),
                Some(clocks) => (measured - plant.reading_before(motion, j, clocks.late(k * n + j)), clocks.weight(j)),
            };
            errors.position.push(weight * e / deviation);
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
    errors.effort.extend(read_errors(&read, trajectory, &gains, plant.shown_late()));
    Ok(gains)
}

/// Normalised errors of efforts read beside commands, as they would be read by the model, where the motion goes so late by its stamps, s.
fn read_errors(read: &[f64], trajectory: &Trajectory, gains: &Gains, late: f64) -> Vec<f64> {
    if gains.efforts.is_empty() {
        return Vec::new();
    }
    let h = trajectory.period();
    let later = |shift: f64| -> Vec<f64> {
        let error = |(i, deviation): (usize, &f64)| (trajectory.effort[i] - at_time(read, trajectory, i, late + shift)) / deviation;
        gains.efforts.iter().enumerate().map(error).collect()
    };
    let mut errors = later(0.0);
    // When in its row an effort was read is one number, the same in all rows: the one that fits best.
    let mut best: Option<(f64, Vec<f64>)> = None;
    for side in [later(h), later(-h)] {
        let change: Vec<f64> = side.iter().zip(&errors).map(|(s, e)| if (s - e).is_finite() { s - e } else { 0.0 }).collect();
        let all = || change.iter().zip(&errors).filter(|(_, e)| e.is_finite());
        let (slope, size) = all().fold((0.0, 0.0), |(a, b), (c, e)| (a + c * e, b + c * c));
        let share = if size > 0.0 { (-slope / size).clamp(0.0, 1.0) } else { 0.0 };
        let fall = -share * (2.0 * slope + share * size);
        if fall > best.as_ref().map_or(0.0, |b| b.0) {
            best = Some((fall, change.iter().map(|c| share * c).collect()));
        }
    }
    if let Some((_, change)) = best {
        errors.iter_mut().zip(change).for_each(|(e, c)| *e += c);
    }
    // The last row of a stretch has no interval.
    errors.iter_mut().filter(|e| !e.is_finite()).for_each(|e| *e = 0.0);
    errors
}

/// A series by row and joint, so much later than its entry `i`: linear between rows.
fn at_time(series: &[f64], trajectory: &Trajectory, i: usize, late: f64) -> f64 {
    if late == 0.0 {
        return series[i];
    }
    let (time, n) = (&trajectory.time, trajectory.joints);
    let t = time[i / n] + late;
    let next = time.partition_point(|x| *x <= t);
    let of = |k: usize| series.get(k * n + i % n).copied().unwrap_or(f64::NAN);
    let Some(k) = next.checked_sub(1).filter(|_| next < time.len()) else { return f64::NAN };
    let share = (t - time[k]) / (time[next] - time[k]);
    (1.0 - share) * of(k) + share * of(next)
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
