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
use rayon::prelude::*;
use sagci_dynamics::effects::{Along, Before, Effect, Instant};

use crate::fit::Fit;
use crate::flexible::Place;
use crate::inputs::{law_of, slopes_by};
use crate::observer::Run;
use crate::search::Search;

/// Stiffness by which a loop brings back less than digits show of an offset within a row, 1.
const NO_LOOP: f64 = 1e-8;
/// Forces that are followed at once. A row waits for the one before it, and those of several forces wait together.
const LANES: usize = 4;
/// Rows away from which a noisy input is taken.
const NEAR: usize = 3;
const FAR: usize = 8;

/// The rows of a base run, for one joint.
#[derive(Debug)]
pub(crate) struct Response {
    rows: Vec<Along>,
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

/// Does dry friction hold the joint over the row?
fn holds(row: &Along) -> bool {
    row.at.next == 0.0 && row.at.dt > 0.0
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
                let before = match k {
                    0 if !trajectory.continues => Before::Nothing,
                    _ if start => Before::Pause,
                    _ => Before::Row,
                };
                let at = Instant {
                    q: run.q[i],
                    v: run.v[i],
                    next: if last { run.v[i] } else { run.v_predicted[i + n] },
                    dt: if last { 0.0 } else { trajectory.time[k + 1] - trajectory.time[k] },
                    input: if last { 0.0 } else { run.tau[i + n] },
                    load: if last { 0.0 } else { run.load[i + n] },
                    time: trajectory.time[k],
                    z: &[],
                };
                rows.push(Along { at, before });
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
        let passes = rows.iter().enumerate().flat_map(|(k, row): (usize, &Along)| {
            let (gains, inverse) = (&gains, &inverse);
            loops.iter().enumerate().map(move |(j, l)| Passes::new(gains[k * n + j], inverse[k * n + j], l.over(row.at.dt)))
        });
        let passes = passes.collect();
        let noisy = search.problem.disturbance.effort[joint] > 0.0;
        Self { rows, errors: base.errors.len(), joints: n, joint, noisy, gains, inverse, passes }
    }

    /// The forces of an effect along the base run.
    pub fn forces(&self, effect: &dyn Effect, theta: &[f64]) -> Vec<f64> {
        effect.forces(theta, &self.rows)
    }

    /// The change of all normalised prediction errors by forces on the joint.
    pub fn errors_of(&self, forces: &[f64]) -> DVector<f64> {
        let [errors] = self.together([forces]);
        errors
    }

    /// The same by each of many.
    pub fn errors_of_each(&self, forces: &[Vec<f64>]) -> Vec<DVector<f64>> {
        let together = |some: &[Vec<f64>]| match some {
            [a, b, c, d] => Vec::from(self.together([a, b, c, d])),
            [a, b, c] => Vec::from(self.together([a, b, c])),
            [a, b] => Vec::from(self.together([a, b])),
            some => some.iter().map(|forces| self.errors_of(forces)).collect(),
        };
        forces.par_chunks(LANES).flat_map_iter(together).collect()
    }

    /// The same by each of some, row by row together.
    pub fn together<const L: usize>(&self, forces: [&[f64]; L]) -> [DVector<f64>; L] {
        let mut errors = [(); L].map(|()| DVector::zeros(self.errors));
        match self.joints {
            1 => self.respond::<1, L>(forces, &mut [[[0.0; L]; 2]], &mut errors),
            2 => self.respond::<2, L>(forces, &mut [[[0.0; L]; 2]; 2], &mut errors),
            n => self.respond::<0, L>(forces, &mut vec![[[0.0; L]; 2]; n], &mut errors),
        }
        errors
    }

    /// The same row by row, of `N` joints, zero where their number is not known before: the screens spend most of their time here.
    fn respond<const N: usize, const L: usize>(&self, forces: [&[f64]; L], offsets: &mut [[[f64; L]; 2]], errors: &mut [DVector<f64>; L]) {
        let n = if N > 0 { N } else { self.joints };
        let (offsets, joint) = (&mut offsets[..n], self.joint);
        let forces = forces.map(|f| &f[..self.rows.len()]);
        let mut errors = errors.each_mut().map(|e| &mut e.as_mut_slice()[..self.rows.len() * n]);
        for (k, (row, passes)) in self.rows.iter().zip(self.passes.chunks_exact(n)).enumerate() {
            if row.before != Before::Row {
                offsets.fill([[0.0; L]; 2]);
            }
            let force = forces.map(|f| f[k]);
            let [held, _] = offsets[joint];
            for (j, (offset, passes)) in offsets.iter_mut().zip(passes).enumerate() {
                let [q, v] = *offset;
                for (errors, q) in errors.iter_mut().zip(q) {
                    errors[k * n + j] = -q * passes.certainty;
                }
                let next = |[by_q, by_v, by_force]: [f64; 3]| std::array::from_fn(|l| by_q * q[l] + by_v * v[l] + by_force * force[l]);
                *offset = [next(passes.q), next(passes.v)];
            }
            // Dry friction takes the force, too.
            if holds(row) {
                let [gain, ..] = self.gains[k * n + joint];
                offsets[joint] = [held.map(|held| held - gain * held), [0.0; L]];
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
            let (sum, count) = rows.fold((0.0, 0.0), |(s, c), i| (s + self.rows[i].at.input, c + 1.0));
            sum / f64::max(count, 1.0)
        };
        let input = |k: usize| if self.noisy { mean(k) } else { self.rows[k].at.input };
        self.rows
            .iter()
            .enumerate()
            .map(|(k, Along { at: row, before: comes_after })| {
                run += row.dt;
                since = if *comes_after != Before::Row || row.v * before < 0.0 { 0.0 } else { since + row.dt };
                before = row.v;
                Place { q: row.q, v: row.v, input: input(k), time: row.time, run, since }
            })
            .collect()
    }

    /// Share of the rows over which dry friction holds the joint.
    pub fn sticking(&self) -> f64 {
        let held = self.rows.iter().filter(|row| holds(row)).count();
        held as f64 / self.rows.len().max(1) as f64
    }

    /// Position, velocity and input of each row.
    pub fn along(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        self.rows.iter().map(|Along { at, .. }| [at.q, at.v, at.input])
    }

    /// Force that the model lacks in each row, by the correction that the filter made.
    pub fn lacking(&self, errors: &DVector<f64>) -> Vec<f64> {
        let (n, j) = (self.joints, self.joint);
        let force = |k: usize| {
            let [_, gain, certainty] = self.gains[k * n + j];
            let (h, inverse) = (self.rows[k].at.dt, self.inverse[k * n + j]);
            if h > 0.0 && inverse > 0.0 && certainty > 0.0 { -gain * errors[k * n + j] / (certainty * h * inverse) } else { 0.0 }
        };
        (0..self.rows.len()).map(force).collect()
    }
}
