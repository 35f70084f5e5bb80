//! What a force that the model lacks does to its prediction errors, to first order: the screen before any exact fit.
//!
//! Along a run of the base model, an effect's force `dtau_k` is a function of positions, velocities, inputs and times that are known.
//! It changes the prediction errors by the filter's own linear response,
//!
//! ```text
//! de_k = -dq_k,   dx_k <- (1 - K C) dx_k,   (dq, dv)' = (dv, -M^-1 (k dq + d dv + dtau_k))  over the row, exactly
//! ```
//!
//! which costs a few operations a row, where a run of the simulator costs thousands. `d` is the damping and what a drive adds to it, `k` is the
//! stiffness of the loop that a drive closes over the position: a servo holds against most of a force that comes slowly.

use nalgebra::DVector;
use sagci_dynamics::effects::{self, Effect, HISTORY, Instant};

use crate::fit::Fit;
use crate::flexible::Place;
use crate::inputs::{law_of, slopes_by};
use crate::observer::Run;
use crate::search::Search;

/// Stiffness by which a loop brings back less than digits show of an offset within a row, 1.
const NO_LOOP: f64 = 1e-8;
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
    /// What becomes of an offset at the row, by row and joint.
    passes: Vec<Passes>,
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
}

/// What a joint's loop does beside itself: `v' = -stiffness q - rate v`, in 1/s^2 and 1/s.
#[derive(Debug, Clone, Copy)]
struct Loop {
    stiffness: f64,
    rate: f64,
}

impl Loop {
    /// Over a time `h`: factors of position, velocity and acceleration in the next position, and in the next velocity.
    fn over(&self, h: f64) -> [[f64; 3]; 2] {
        let (k, r) = (self.stiffness, self.rate);
        if k * h * h < NO_LOOP {
            let x = h * r;
            if x < 1e-3 {
                return [[1.0, h, 0.5 * h * h], [0.0, 1.0 - x, h]];
            }
            let kept = (-x).exp();
            let gained = (1.0 - kept) / r;
            return [[1.0, gained, (h - gained) / r], [0.0, kept, gained]];
        }
        // The matrix exponential of `[[0, 1], [-k, -r]] h`: an oscillation that dies away, or two that creep.
        let half = 0.5 * r;
        let turns = k - half * half;
        let (even, odd) = if turns > 0.0 {
            let w = turns.sqrt();
            ((-half * h).exp() * (w * h).cos(), (-half * h).exp() * (w * h).sin() / w)
        } else {
            let w = (-turns).sqrt();
            let (slow, fast) = (((w - half) * h).exp(), ((-w - half) * h).exp());
            (0.5 * (slow + fast), if w * h > 1e-6 { 0.5 * (slow - fast) / w } else { slow * h })
        };
        let stays = even + half * odd;
        [[stays, odd, (1.0 - stays) / k], [-k * odd, even - half * odd, odd]]
    }
}

/// The filter's correction at a row and what the loop does until the next one: factors of an offset's position and velocity, and of the force, in
/// the next ones, and the inverse of the error's deviation.
#[derive(Debug, Clone, Copy)]
struct Passes {
    q: [f64; 3],
    v: [f64; 3],
    certainty: f64,
}

impl Passes {
    fn new([gain_q, gain_v, certainty]: [f64; 3], inverse: f64, [q, v]: [[f64; 3]; 2]) -> Self {
        let corrected = |[by_q, by_v, by_a]: [f64; 3]| [by_q * (1.0 - gain_q) - by_v * gain_v, by_v, -by_a * inverse];
        Self { q: corrected(q), v: corrected(v), certainty }
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
        let closed = |j: usize| {
            let drive = slopes_by(search.problem.trajectories, j, law_of(&model, &search.names[j]));
            let inertia = search.inertias[j];
            Loop { stiffness: -drive.q / inertia, rate: (model.joints[search.joints[j]].damping - drive.v) / inertia }
        };
        let loops: Vec<Loop> = (0..n).map(closed).collect();
        let passes = rows.iter().enumerate().flat_map(|(k, row): (usize, &Row)| {
            let (gains, inverse) = (&gains, &inverse);
            loops.iter().enumerate().map(move |(j, l)| Passes::new(gains[k * n + j], inverse[k * n + j], l.over(row.h)))
        });
        let passes = passes.collect();
        let noisy = search.problem.disturbance.effort[joint] > 0.0;
        Self { rows, errors: base.errors.len(), joints: n, joint, noisy, gains, inverse, passes }
    }

    /// The forces of an effect along the base run.
    pub fn forces(&self, effect: &dyn Effect, theta: &[f64]) -> Vec<f64> {
        let inner = effect.states();
        let mut z = vec![0.0; inner + if effect.keeps_history() { 2 * HISTORY } else { 0 }];
        let (mut next, mut forces) = (z.clone(), Vec::with_capacity(self.rows.len()));
        for (k, row) in self.rows.iter().enumerate() {
            match k.checked_sub(1).map(|last| &self.rows[last]) {
                _ if row.fresh => z.fill(0.0),
                Some(last) if row.start => effects::stand(effect, theta, last.q, (row.time - last.time).max(0.0), &mut z),
                _ => (),
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
        for (k, ((row, force), passes)) in self.rows.iter().zip(forces).zip(self.passes.chunks_exact(n)).enumerate() {
            if row.start {
                offsets.fill([0.0; 2]);
            }
            let [held, _] = offsets[joint];
            for (offset, passes) in offsets.iter_mut().zip(passes) {
                let [q, v] = *offset;
                errors.push(-q * passes.certainty);
                let next = |[by_q, by_v, by_force]: [f64; 3]| by_q * q + by_v * v + by_force * force;
                *offset = [next(passes.q), next(passes.v)];
            }
            // Dry friction takes the force, too.
            if row.holds() {
                let [gain, ..] = self.gains[k * n + joint];
                offsets[joint] = [held - gain * held, 0.0];
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
