//! What a force that the model lacks does to its prediction errors, to first order: the screen before any exact fit.
//!
//! Along a run of the base model, an effect's force `dtau_k` is a function of positions, velocities, inputs and times that are known.
//! It changes the prediction errors by the filter's own linear response,
//!
//! ```text
//! de_k = -dq_k,   dx_k <- (1 - K C) dx_k,   (dq, dv)' = (dv, -M^-1 (d dv + dtau_k))  over the row, exactly
//! ```
//!
//! which costs a few operations a row, where a run of the simulator costs thousands.

use nalgebra::DVector;
use sagci_dynamics::effects::{Effect, HISTORY, Instant};

use crate::fit::Fit;
use crate::flexible::Place;
use crate::observer::Run;
use crate::search::Search;

/// Rows away from which a noisy input is taken.
const NEAR: usize = 3;
const FAR: usize = 8;

/// The rows of a base run, for one joint.
#[derive(Debug)]
pub(crate) struct Response {
    rows: Vec<Row>,
    /// Errors of all kinds: behind those of positions, no force says anything of what drives read.
    errors: usize,
    joints: usize,
    joint: usize,
    /// The joint's input is a measured effort.
    noisy: bool,
    /// Gains by row and joint, and the inverse of the errors' deviations, zero where an error is not counted.
    gains: Vec<[f64; 3]>,
    /// Column of the inverse mass matrix, by row.
    inverse: Vec<f64>,
    /// What is kept and gained over the row, by row and joint: see [`Row::decay`].
    decay: Vec<[f64; 4]>,
}

#[derive(Debug, Clone, Copy)]
struct Row {
    q: f64,
    v: f64,
    next: f64,
    h: f64,
    input: f64,
    load: f64,
    time: f64,
    /// The first row of a stretch; the row that a new trajectory begins with.
    start: bool,
    fresh: bool,
}

impl Row {
    /// Does dry friction hold the joint over the row?
    fn holds(&self) -> bool {
        self.next == 0.0 && self.h > 0.0
    }

    /// Over the row, of `v' = a - rate v`: factors of `v` and `a` in the next velocity, and in the change of position.
    fn decay(&self, rate: f64) -> [f64; 4] {
        let (h, x) = (self.h, self.h * rate);
        if x < 1e-3 {
            return [1.0 - x, h, h, 0.5 * h * h];
        }
        let kept = (-x).exp();
        let gained = (1.0 - kept) / rate;
        [kept, gained, gained, (h - gained) / rate]
    }
}

impl Response {
    pub fn new(search: &Search<'_>, base: &Fit, runs: &[Run], joint: usize) -> Self {
        let n = search.names.len();
        let (mut rows, mut gains, mut inverse) = (Vec::new(), Vec::new(), Vec::new());
        for (trajectory, run) in search.problem.trajectories.iter().zip(runs) {
            for k in 0..trajectory.rows() {
                let i = k * n + joint;
                let start = trajectory.starts.contains(&k);
                let last = k + 1 == trajectory.rows() || trajectory.starts.contains(&(k + 1));
                rows.push(Row {
                    q: run.q[i],
                    v: run.v[i],
                    next: if last { run.v[i] } else { run.v_predicted[i + n] },
                    h: if last { 0.0 } else { trajectory.time[k + 1] - trajectory.time[k] },
                    input: if last { 0.0 } else { run.tau[i + n] },
                    load: if last { 0.0 } else { run.load[i + n] },
                    time: trajectory.time[k],
                    start,
                    fresh: k == 0 && !trajectory.continues,
                });
                inverse.extend_from_slice(&run.inverse[(k * n + joint) * n..(k * n + joint + 1) * n]);
            }
            let certain = |[q, v, deviation]: &[f64; 3]| [*q, *v, if *deviation > 0.0 { 1.0 / deviation } else { 0.0 }];
            gains.extend(run.gains.rows().iter().map(certain));
        }
        let model = base.hypothesis.model_at(&base.hypothesis.x);
        let rates: Vec<f64> = (0..n).map(|j| model.joints[search.joints[j]].damping / search.inertias[j]).collect();
        let decay = rows.iter().flat_map(|row: &Row| rates.iter().map(|rate| row.decay(*rate))).collect();
        let noisy = search.problem.disturbance.effort[joint] > 0.0;
        Self { rows, errors: base.errors.len(), joints: n, joint, noisy, gains, inverse, decay }
    }

    /// The forces of an effect along the base run.
    pub fn forces(&self, effect: &dyn Effect, theta: &[f64]) -> Vec<f64> {
        let inner = effect.states();
        let mut z = vec![0.0; inner + if effect.keeps_history() { 2 * HISTORY } else { 0 }];
        let (mut next, mut forces) = (z.clone(), Vec::with_capacity(self.rows.len()));
        for row in &self.rows {
            if row.fresh {
                z.fill(0.0);
            }
            let at = Instant { q: row.q, v: row.v, next: row.next, dt: row.h, input: row.input, load: row.load, time: row.time, z: &z };
            forces.push(effect.force(theta, &at).total(row.next));
            if inner > 0 && row.h > 0.0 {
                next.copy_from_slice(&z);
                effect.advance_values(theta, &at, &mut next);
                std::mem::swap(&mut z, &mut next);
            }
        }
        forces
    }

    /// The change of all normalised prediction errors by forces on the joint.
    pub fn errors_of(&self, forces: &[f64]) -> DVector<f64> {
        let mut errors = Vec::with_capacity(self.errors);
        match self.joints {
            1 => self.respond::<1>(forces, &mut [[0.0; 2]], &mut errors),
            2 => self.respond::<2>(forces, &mut [[0.0; 2]; 2], &mut errors),
            n => self.respond::<0>(forces, &mut vec![[0.0; 2]; n], &mut errors),
        }
        errors.resize(self.errors, 0.0);
        DVector::from_vec(errors)
    }

    /// The same row by row, of `N` joints, zero where their number is not known before: the screens spend most of their time here.
    fn respond<const N: usize>(&self, forces: &[f64], offsets: &mut [[f64; 2]], errors: &mut Vec<f64>) {
        let n = if N > 0 { N } else { self.joints };
        let (offsets, joint) = (&mut offsets[..n], self.joint);
        let along = self.inverse.chunks_exact(n).zip(self.decay.chunks_exact(n));
        for (((row, force), gains), (inverse, decay)) in self.rows.iter().zip(forces).zip(self.gains.chunks_exact(n)).zip(along) {
            if row.start {
                offsets.fill([0.0; 2]);
            }
            let [held, _] = offsets[joint];
            for (((offset, [gain_q, gain_v, certainty]), inverse), [kept, gained, moved, shifted]) in
                offsets.iter_mut().zip(gains).zip(inverse).zip(decay)
            {
                let [q, v] = *offset;
                errors.push(-q * certainty);
                let (a, v, q) = (-inverse * force, v - gain_v * q, q - gain_q * q);
                *offset = [q + moved * v + shifted * a, kept * v + gained * a];
            }
            // Dry friction takes the force, too.
            if row.holds() {
                offsets[joint] = [held - gains[joint][0] * held, 0.0];
            }
        }
    }

    /// What the force of each row may depend on. A noisy input is the mean of those before and after it, further away than the filter
    /// remembers: its own has the noise that the row is off by, and its neighbours' that which theirs are.
    pub fn places(&self) -> Vec<Place> {
        let (mut run, mut since, mut before) = (0.0, 0.0, 0.0);
        let mean = |k: usize| {
            let before = k.saturating_sub(FAR)..(k + 1).saturating_sub(NEAR);
            let rows = before.chain(k + NEAR..(k + FAR + 1).min(self.rows.len()));
            let (sum, count) = rows.fold((0.0, 0.0), |(s, c), i| (s + self.rows[i].input, c + 1.0));
            sum / f64::max(count, 1.0)
        };
        let input = |k: usize| if self.noisy { mean(k) } else { self.rows[k].input };
        self.rows
            .iter()
            .enumerate()
            .map(|(k, row)| {
                run += row.h;
                since = if row.start || row.v * before < 0.0 { 0.0 } else { since + row.h };
                before = row.v;
                Place { q: row.q, v: row.v, input: input(k), time: row.time, run, since }
            })
            .collect()
    }

    /// Share of the rows over which dry friction holds the joint.
    pub fn sticking(&self) -> f64 {
        let held = self.rows.iter().filter(|r| r.holds()).count();
        held as f64 / self.rows.len().max(1) as f64
    }

    /// Position, velocity and input of each row.
    pub fn along(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        self.rows.iter().map(|r| [r.q, r.v, r.input])
    }

    /// Force that the model lacks in each row, by the correction that the filter made.
    pub fn lacking(&self, errors: &DVector<f64>) -> Vec<f64> {
        let (n, j) = (self.joints, self.joint);
        let force = |k: usize| {
            let [_, gain, certainty] = self.gains[k * n + j];
            let (h, inverse) = (self.rows[k].h, self.inverse[k * n + j]);
            if h > 0.0 && inverse > 0.0 && certainty > 0.0 { -gain * errors[k * n + j] / (certainty * h * inverse) } else { 0.0 }
        };
        (0..self.rows.len()).map(force).collect()
    }
}
