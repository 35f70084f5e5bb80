//! What the data of each joint look like to a fitted model: sizes of the forces that it lacks, where they stand out, how they repeat.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{DVector, Vector3};
use rayon::prelude::*;
use sagci_dynamics::{GRAVITY, effects};
use sagci_model::ObjectModel;

use crate::GapError;
use crate::fit::Fit;
use crate::observer::Run;
use crate::response::Response;
use crate::search::Search;
use crate::span::Span;
use crate::starts::{JointView, Pressed};
use crate::trajectory::Trajectory;

const BINS: usize = 40;
/// Share of the rows that are beyond the positions where a joint usually is, to either side.
pub(crate) const SELDOM: f64 = 0.02;
/// The share of the most that gravity can do to a link from which on it counts.
const FELT: f64 = 0.05;

/// Mean lacking force in bins of position, by the sign of the velocity.
fn means(rows: &[[f64; 4]], low: f64, high: f64) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0f64; 4]; BINS];
    for [f, q, v, _] in rows {
        let bin = (((q - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
        let side = if *v < 0.0 { 2 } else { 0 };
        sums[bin][side] += f;
        sums[bin][side + 1] += 1.0;
    }
    sums.iter().map(|s| [s[0] / f64::max(s[1], 5.0), s[2] / f64::max(s[3], 5.0)]).collect()
}

/// Size of the lacking force, apart from noise.
fn binned(rows: &[[f64; 4]], low: f64, high: f64) -> f64 {
    let means = means(rows, low, high);
    (means.iter().flatten().map(|m| m * m).sum::<f64>() / (2 * BINS) as f64).sqrt()
}

/// Positions where the lacking force stands out from its neighbours.
fn places(rows: &[[f64; 4]], low: f64, high: f64) -> Vec<f64> {
    let means = means(rows, low, high);
    let mut scored: Vec<(f64, usize)> = (0..BINS)
        .map(|b| {
            let around = |side: usize| (0..BINS).filter(|c| c.abs_diff(b) > 2).map(|c| means[c][side]).sum::<f64>() / (BINS - 5) as f64;
            ((means[b][0] - around(0)).abs().max((means[b][1] - around(1)).abs()), b)
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut chosen: Vec<usize> = Vec::new();
    for (_, b) in scored {
        if chosen.iter().all(|c| c.abs_diff(b) > 3) {
            chosen.push(b);
        }
    }
    chosen.iter().map(|b| low + (high - low) * (*b as f64 + 0.5) / BINS as f64).collect()
}

/// Share of a joint's way at whose ends something may press against it, of its usual speed below which it hardly moves, and of the largest force
/// there from which on a force is that; and how many rows tell.
const AT_THE_END: f64 = 0.3;
const HARDLY: f64 = 0.3;
const PRESSES: f64 = 0.25;
const TELL: usize = 20;

/// A line through the lacking force over position at each end of the way, where the joint hardly moves: what it is pressed into. How deep it sinks
/// says nothing of that where a drive pushes on.
fn pressed(rows: &[[f64; 4]], [low, high]: [f64; 2], speed: f64) -> Vec<Pressed> {
    let at = |side: f64| {
        let end = if side > 0.0 { high } else { low };
        let near = |[_, q, v, _]: &&[f64; 4]| side * (end - q) < AT_THE_END * (high - low) && v.abs() < HARDLY * speed;
        let there: Vec<[f64; 2]> = rows.iter().filter(near).map(|[f, q, _, _]| [side * q, side * f]).collect();
        let least = PRESSES * there.iter().map(|[_, f]| *f).fold(0.0, f64::max);
        let there: Vec<[f64; 2]> = there.into_iter().filter(|[_, f]| *f > least).collect();
        let n = there.len() as f64;
        let [q, f] = [0, 1].map(|i| there.iter().map(|r| r[i]).sum::<f64>() / n);
        let stiffness = there.iter().map(|r| (r[0] - q) * (r[1] - f)).sum::<f64>() / there.iter().map(|r| (r[0] - q).powi(2)).sum::<f64>();
        let position = side * (q - f / stiffness);
        let is_there = there.len() >= TELL && stiffness > 0.0 && stiffness.is_finite() && (low..high).contains(&position);
        is_there.then_some(Pressed { stiffness, position, side })
    };
    [1.0, -1.0].into_iter().filter_map(at).collect()
}

/// Fewest and most periods over the range at which a ripple is looked for, from a little below what it may have, and the step between them: a fit
/// finds its way over half a period.
const PERIODS: [f64; 2] = [0.75, 82.0];
const BETWEEN: f64 = 0.25;
/// How many ripples are begun with.
const RIPPLES: usize = 3;

/// Cycles a turn at which the most of the errors is explained by a force that repeats over position: a periodogram in the response of the filter
/// (Lomb 1976), since the force that it shows lags behind the joint and is smoothed over many periods where the joint is fast.
fn cycles(response: &Response, span: &Span, [low, high]: [f64; 2]) -> Vec<f64> {
    let range = high - low;
    let Ok(ripple) = effects::find("torque_ripple") else { return Vec::new() };
    if range.is_nan() || range <= 0.0 {
        return Vec::new();
    }
    let explained = |cycles: f64| {
        let [sine, cosine] = [0.0, FRAC_PI_2].map(|phase| response.forces(ripple, &[1.0, cycles, phase]));
        let [sine, cosine] = response.together([&sine, &cosine]).map(|errors| span.of(errors));
        let (a, b, c) = (sine.norm_squared(), sine.dot(&cosine), cosine.norm_squared());
        let (x, y) = (sine.dot(&span.errors), cosine.dot(&span.errors));
        let determinant = a * c - b * b;
        if determinant > 1e-6 * a * c { (c * x * x - 2.0 * b * x * y + a * y * y) / determinant } else { 0.0 }
    };
    let steps = ((PERIODS[1] - PERIODS[0]) / BETWEEN) as usize;
    let grid: Vec<(f64, f64)> = (0..=steps)
        .into_par_iter()
        .map(|i| (PERIODS[0] + BETWEEN * i as f64) * TAU / range)
        .map(|cycles| (explained(cycles), cycles))
        .collect();
    peaks(&grid)
}

/// The same by means over positions, where a response for each would be much of the work.
fn cycles_roughly(rows: &[[f64; 4]], low: f64, high: f64) -> Vec<f64> {
    let range = high - low;
    if rows.is_empty() || range.is_nan() || range <= 0.0 {
        return Vec::new();
    }
    // To what 400 bins can show.
    let mut sums = vec![[0.0f64; 2]; 400];
    for [f, q, _, _] in rows {
        let bin = (((q - low) / range * 400.0) as usize).min(399);
        sums[bin][0] += f;
        sums[bin][1] += 1.0;
    }
    let mean = sums.iter().map(|s| s[0]).sum::<f64>() / sums.iter().map(|s| s[1]).sum::<f64>();
    let values: Vec<f64> = sums.iter().map(|s| if s[1] > 0.0 { s[0] / s[1] - mean } else { 0.0 }).collect();
    let power = |periods: f64| {
        let (mut a, mut b) = (0.0, 0.0);
        for (i, x) in values.iter().enumerate() {
            let angle = TAU * periods * (i as f64 + 0.5) / 400.0;
            a += x * angle.cos();
            b += x * angle.sin();
        }
        a * a + b * b
    };
    let grid: Vec<(f64, f64)> = (0..812).map(|i| PERIODS[0] + 0.1 * i as f64).map(|p| (power(p), p * TAU / range)).collect();
    peaks(&grid)
}

/// Gravity in a link's frame where all joints are at zero.
fn gravity(model: &ObjectModel, link: usize) -> Vector3<f64> {
    let above = model.joints.iter().find(|j| j.child == link);
    above.map_or(GRAVITY, |j| j.X_PJ.rotation.inverse() * gravity(model, j.parent))
}

/// Where the highest peaks are, among heights by place.
fn peaks(grid: &[(f64, f64)]) -> Vec<f64> {
    let mut peaks: Vec<(f64, f64)> = grid.windows(3).filter(|w| w[1].0 >= w[0].0 && w[1].0 > w[2].0).map(|w| w[1]).collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.iter().take(RIPPLES).map(|(_, at)| *at).collect()
}

impl Search<'_> {
    /// What the data look like to a fitted model, by joint.
    pub fn views(&self, base: &Fit, scale: f64) -> Result<Vec<JointView>, GapError> {
        let runs = self.runs(base)?;
        let mut views: Vec<JointView> = (0..self.names.len()).map(|j| self.view(base, &runs, j)).collect();
        if !self.many_joints() {
            let span = Span::new(base, scale);
            for (j, view) in views.iter_mut().enumerate() {
                view.cycles = cycles(&Response::new(self, base, &runs, j), &span, view.range);
            }
        }
        Ok(views)
    }

    /// Forces that the model lacks at a joint, one for each row, with position and velocity: the change of velocity that the filter
    /// has to make, over the time of the row.
    pub fn lacking(&self, errors: &DVector<f64>, runs: &[Run], j: usize) -> Vec<[f64; 4]> {
        let mut rows = Vec::new();
        let mut at = 0;
        for (trajectory, run) in self.problem.trajectories.iter().zip(runs) {
            let gains = &run.gains;
            let n = trajectory.joints;
            for k in 0..trajectory.rows() {
                let i = k * n + j;
                // Lacking `dtau` slows: its sign is opposite to the correction's.
                let force = -self.inertias[j] * gains.acceleration(trajectory, k, j) * errors[at + i] * gains.deviation(i);
                if gains.deviation(i).is_finite() && trajectory.position[i].is_finite() {
                    rows.push([force, run.q[i], run.v[i], trajectory.time[k]]);
                }
            }
            at += trajectory.rows() * n;
        }
        rows
    }

    fn view(&self, base: &Fit, runs: &[Run], j: usize) -> JointView {
        let rows = self.lacking(&base.errors, runs, j);
        let rms = |i: usize| (rows.iter().map(|r| r[i] * r[i]).sum::<f64>() / rows.len().max(1) as f64).sqrt();
        let reached = rows.iter().fold((f64::MAX, f64::MIN), |(a, b), r| (a.min(r[1]), b.max(r[1])));
        // Of a joint that rests in all rows no place is known by a force.
        let (low, high) = if rows.is_empty() { (0.0, 0.0) } else { reached };
        let mut positions: Vec<f64> = rows.iter().map(|r| r[1]).collect();
        positions.sort_by(f64::total_cmp);
        let passed = (SELDOM * positions.len() as f64) as usize;
        let end = |i: usize, reached: f64| positions.get(i).copied().unwrap_or(reached);
        let usual = [end(passed, low), end((positions.len() - passed).saturating_sub(1), high)];
        let model = &base.hypothesis.model;
        let joint = &model.joints[self.joints[j]];
        let link = &model.links[joint.child].inertial;
        // What the drive makes of its command, not the command.
        let efforts = runs.iter().flat_map(|r| r.tau.iter().skip(j).step_by(self.names.len())).filter(|u| u.is_finite());
        let mut efforts: Vec<f64> = efforts.map(|u| u.abs()).collect();
        efforts.sort_by(f64::total_cmp);
        let p = link.p_LoLcm;
        let loads = || runs.iter().flat_map(|r| r.load.iter().skip(j).step_by(self.names.len())).filter(|l| l.is_finite());
        let load = (loads().map(|l| l * l).sum::<f64>() / loads().count().max(1) as f64).sqrt();
        JointView {
            force: binned(&rows, low, high).max(1e-6),
            speed: rms(2),
            range: [low, high],
            usual,
            turns: joint.kind != sagci_model::JointKind::Prismatic,
            inertia: self.inertias[j],
            efforts,
            places: places(&rows, low, high),
            pressed: pressed(&rows, [low, high], rms(2)),
            cycles: if self.many_joints() { cycles_roughly(&rows, low, high) } else { Vec::new() },
            duration: self.problem.trajectories.iter().map(|t| t.time[t.rows() - 1] - t.time[0]).sum(),
            period: self.problem.trajectories.first().map_or(0.005, Trajectory::period),
            hangs: load > FELT * GRAVITY.norm() * link.mass * p.coords.norm(),
            mass: link.mass,
            p_LoLcm: [p.x, p.y, p.z],
            axis: [joint.axis.x, joint.axis.y, joint.axis.z],
            gravity: gravity(model, joint.child).into(),
        }
    }
}
