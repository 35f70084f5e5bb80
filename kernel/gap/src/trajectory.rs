//! Measured series on one grid of times, as the simulator takes them.
//!
//! The grid holds every time at which something was measured or an input changed, so that inputs are held exactly: that of row `k`
//! acts from `t_k` until `t_k+1`.

use sagci_model::ObjectModel;
use sagci_recording::{CommandKind, JointLog, Log, Series};

use crate::GapError;
use crate::clocks::OnTime;
use crate::inputs::{Inputs, followed, law_of, per_input};
use crate::noise;
use crate::plant::Plant;

/// Times closer than this are one, s.
pub(crate) const SAME_TIME: f64 = 1e-6;
/// Free motion is averaged to about this period, s.
const FAST: f64 = 0.004;
/// A trajectory is cut where nothing was measured for so many of its usual sample times, and for so long (s).
pub(crate) const CUT: (f64, f64) = (10.0, 0.1);

/// Rows and time (s) after a start that are not counted. What acts then was put in before anything was recorded, if it is on its way for
/// some time.
const BURN_IN: (usize, f64) = (10, 0.05);
/// A joint is at rest where its positions spread over so long, s, by less than so many times their noise.
const REST: f64 = 0.2;
const STILL: f64 = 1.5;
/// It may be at rest where its velocity is less than so many times what the noise of its measured effort makes of one row.
const STOPPED: f64 = 3.0;

/// Usual time between instants, s; none of less than two.
pub(crate) fn usual_step(times: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| *steps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// What moves a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drive {
    /// Nothing that was measured.
    Free,
    /// A measured effort.
    Effort,
    /// An effort that acts as it is given.
    Given,
    /// A command, through the law of its drive.
    Command(CommandKind),
}

/// One measured trajectory. Rows are times, columns the model's degrees of freedom.
#[derive(Debug, Clone)]
pub(crate) struct Trajectory {
    pub source: String,
    pub hash: String,
    pub time: Vec<f64>,
    /// NaN where nothing was measured.
    pub position: Vec<f64>,
    /// Positions by which a model is tested. Not those after a start: they show what the first state was off by, in ways that no model
    /// explains. Not those at rest: any force that friction can hold is right there, and what noise makes of a model that is at rest, a
    /// model that sticks does not.
    pub counted: Vec<bool>,
    /// Accelerations around each row, rad/s^2 or m/s^2, and efforts, N m or N.
    pub liveliness: Vec<f64>,
    pub strain: Vec<f64>,
    /// By how much what acts on the way to a row may be off, where its input was not measured and is put in, N m or N; empty where all was measured.
    pub doubt: Vec<f64>,
    /// Measured efforts of joints that a command drives; NaN where nothing was measured, and just after a start.
    pub effort: Vec<f64>,
    /// What acts until the next time; NaN where a motor's circuit is open.
    pub input: Vec<f64>,
    pub drive: Vec<Drive>,
    /// What acts besides on joints that a command drives, until the next time, N m or N; empty where nothing does.
    pub external: Vec<f64>,
    /// Rows at which it starts anew, the first among them.
    pub starts: Vec<usize>,
    /// It goes on where the one before it ends.
    pub continues: bool,
    pub joints: usize,
    /// Where measurements were moved to rows at which they were true.
    pub on_time: Option<Box<OnTime>>,
    /// What had to be done to its inputs.
    pub notes: Vec<String>,
}

/// Names of the model's degrees of freedom.
pub(crate) fn joint_names(model: &ObjectModel) -> Result<Vec<String>, GapError> {
    let mut names = Vec::new();
    for i in model.moving_joints() {
        let joint = &model.joints[i];
        if joint.kind.velocities() != 1 {
            return Err(GapError::data(
                &joint.name,
                "is a joint of several degrees of freedom; only turning and sliding joints can be compared",
            ));
        }
        names.push(joint.name.clone());
    }
    if names.is_empty() {
        return Err(GapError::data(&model.name, "has no joint that moves"));
    }
    Ok(names)
}

impl Trajectory {
    /// Puts the series of a log on one grid.
    pub fn new(log: &Log, model: &ObjectModel) -> Result<Self, GapError> {
        let Inputs { log, external, doubts, notes } = Inputs::new(log, model)?;
        let mut this = Self { notes, ..Self::all(&log, &external, model)? };
        this.doubt_inputs(model, &doubts)?;
        let many = (FAST / this.period()).round() as usize;
        // Inputs are exact; where there are none, dense samples can be averaged.
        let mut this = if many > 1 && this.drive.iter().all(|d| *d == Drive::Free) { this.averaged(many) } else { this };
        let noises: Vec<f64> = (0..this.joints).map(|j| noise::of_positions(std::slice::from_ref(&this), j)).collect();
        this.weigh(model, &noises)?;
        Ok(this)
    }

    /// Says which rows count and how much happens around each, under noise of positions by joint.
    pub fn weigh(&mut self, model: &ObjectModel, noises: &[f64]) -> Result<(), GapError> {
        let names = joint_names(model)?;
        let law = |j: usize| law_of(model, &names[j]);
        self.counted = self.tested(noises, &self.stoppable(model)?);
        self.forget_starts();
        self.liveliness = self.by_row(noise::liveliness);
        self.strain = self.by_row(|t, j| noise::strain(t, j, law(j)));
        Ok(())
    }

    /// Says by how much inputs may be off where they were put in.
    fn doubt_inputs(&mut self, model: &ObjectModel, doubts: &[(String, Series)]) -> Result<(), GapError> {
        let (n, names) = (self.joints, joint_names(model)?);
        for (name, doubts) in doubts.iter().filter(|(_, doubts)| !doubts.time.is_empty()) {
            let Some(j) = names.iter().position(|n| n == name) else { continue };
            self.doubt.resize(self.rows() * n, 0.0);
            let effort = per_input(self.drive[j], law_of(model, name));
            for (t, doubt) in doubts.time.iter().zip(&doubts.value) {
                let next = self.time.partition_point(|x| *x <= t + SAME_TIME);
                if let Some(at) = self.doubt.get_mut(next * n + j) {
                    *at = effort * doubt;
                }
            }
        }
        Ok(())
    }

    /// Something of each joint, row by row.
    fn by_row(&self, of: impl Fn(&Self, usize) -> Vec<f64>) -> Vec<f64> {
        let by_joint: Vec<Vec<f64>> = (0..self.joints).map(|j| of(self, j)).collect();
        (0..self.rows()).flat_map(|k| by_joint.iter().map(move |l| l[k])).collect()
    }

    /// Velocities below which the noise of its measured effort may stop a joint or keep it going, rad/s or m/s.
    ///
    /// The simulator is driven by the measured effort. Dry friction makes of its noise what it does not make of the true one's: a joint
    /// that stands is shaken loose.
    fn stoppable(&self, model: &ObjectModel) -> Result<Vec<f64>, GapError> {
        let n = self.joints;
        let alone = std::slice::from_ref(self);
        let plant = Plant::new(model, &vec![[false; 2]; n], self.period())?;
        let inverse = plant.inverse_mass_at(&noise::middle(alone, n));
        Ok((0..n).map(|j| STOPPED * noise::of_efforts(alone, j) * inverse[j * n + j] * self.period()).collect())
    }

    /// Which positions a model is tested by, under noise of positions and velocities that are as good as none, by joint.
    fn tested(&self, noises: &[f64], stoppable: &[f64]) -> Vec<bool> {
        let (n, rows) = (self.joints, self.rows());
        let side = ((0.5 * REST / self.period()).round() as usize).max(3);
        let mut counted = vec![true; rows * n];
        let mut ends = self.starts[1..].to_vec();
        ends.push(rows);
        for j in 0..n {
            let noise = noises[j];
            for (start, end) in self.starts.iter().copied().zip(ends.iter().copied()) {
                for k in start..end {
                    let around = k.saturating_sub(side).max(start)..(k + side + 1).min(end);
                    let rows: Vec<usize> = around.filter(|i| self.position[i * n + j].is_finite()).collect();
                    let seen: Vec<f64> = rows.iter().map(|i| self.position[i * n + j]).collect();
                    let moved = rows.last().zip(rows.first()).map_or(0.0, |(b, a)| {
                        (self.position[b * n + j] - self.position[a * n + j]) / (self.time[*b] - self.time[*a]).max(SAME_TIME)
                    });
                    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
                    let spread = (seen.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / seen.len() as f64).sqrt();
                    counted[k * n + j] = !self.burns_in(start, k) && spread > STILL * noise && moved.abs() > stoppable[j];
                }
            }
        }
        counted
    }

    /// Is the row one of the first after a start?
    pub fn burns_in(&self, start: usize, k: usize) -> bool {
        k < start + BURN_IN.0 || self.time[k] < self.time[start] + BURN_IN.1
    }

    /// Means over so many rows.
    fn averaged(self, many: usize) -> Self {
        let n = self.joints;
        let mut this =
            Self { time: Vec::new(), position: Vec::new(), effort: Vec::new(), input: Vec::new(), starts: Vec::new(), ..self.clone() };
        let mut ends = self.starts[1..].to_vec();
        ends.push(self.rows());
        // Of a stretch that is shorter than that no mean is left.
        for (start, end) in self.starts.iter().zip(ends).filter(|(start, end)| *start + many <= *end) {
            this.starts.push(this.time.len());
            for first in (*start..end).step_by(many).filter(|f| f + many <= end) {
                this.time.push(self.time[first..first + many].iter().sum::<f64>() / many as f64);
                for j in 0..n {
                    let sum: f64 = (first..first + many).map(|k| self.position[k * n + j]).sum();
                    this.position.push(sum / many as f64);
                    this.effort.push(f64::NAN);
                    this.input.push(0.0);
                }
            }
        }
        if this.starts.is_empty() { self } else { this }
    }

    fn all(log: &Log, outside: &[(String, Series)], model: &ObjectModel) -> Result<Self, GapError> {
        let names = joint_names(model)?;
        let n = names.len();
        let found: Vec<Option<&JointLog>> = names.iter().map(|name| log.joint(name)).collect();
        if found.iter().flatten().all(|j| j.position.time.is_empty()) {
            return Err(GapError::data(&log.source, format!("has no positions of the model's joints ({})", names.join(", "))));
        }
        let mut drive = vec![Drive::Free; n];
        let mut inputs: Vec<Option<&Series>> = vec![None; n];
        for (j, joint) in found.iter().enumerate() {
            let Some(joint) = joint else { continue };
            let driven = followed(joint, law_of(model, &joint.name));
            if let (None, None, Some((kind, _))) = (driven, &joint.effort, &joint.command) {
                let (what, law) = match kind {
                    CommandKind::Effort => ("efforts", "torque"),
                    CommandKind::Position => ("positions", "position_servo"),
                    CommandKind::Voltage => ("voltages", "dc_motor"),
                };
                let message = format!(
                    "the joint '{}' is commanded {what}, and there is no measured effort: its drive's law is needed, as an entry under \
                     `actuators` in model.yaml, such as `kind: {law}`",
                    joint.name
                );
                return Err(GapError::data(&log.source, message));
            }
            (drive[j], inputs[j]) = match (driven, &joint.effort) {
                (Some((kind, series)), _) => (Drive::Command(kind), Some(series)),
                (None, Some(series)) => (Drive::Effort, Some(series)),
                (None, None) => (Drive::Free, None),
            };
        }

        let mut all: Vec<f64> = found.iter().flatten().flat_map(|j| j.position.time.iter().copied()).collect();
        let (first, last) = all.iter().fold((f64::MAX, f64::MIN), |(a, b), t| (a.min(*t), b.max(*t)));
        let acts = inputs.iter().copied().flatten().chain(outside.iter().map(|(_, s)| s));
        all.extend(acts.flat_map(|s| s.time.iter().copied()).filter(|t| *t > first && *t < last));
        all.sort_by(f64::total_cmp);
        all.dedup_by(|b, a| *b - *a < SAME_TIME);
        let time = all;
        let rows = time.len();
        if rows < 10 {
            return Err(GapError::data(&log.source, format!("holds {rows} samples; too few to tell anything from")));
        }
        let row = |t: f64| {
            let i = time.partition_point(|x| *x < t - SAME_TIME);
            (i < rows && (time[i] - t).abs() <= 2.0 * SAME_TIME).then_some(i)
        };
        let spread = |series: &Series, column: usize, into: &mut [f64]| {
            for (t, value) in series.time.iter().zip(&series.value) {
                if let Some(i) = row(*t) {
                    into[i * n + column] = *value;
                }
            }
        };
        let (mut position, mut effort, mut input) = (vec![f64::NAN; rows * n], vec![f64::NAN; rows * n], vec![0.0; rows * n]);
        for (j, joint) in found.iter().enumerate() {
            let Some(joint) = joint else { continue };
            spread(&joint.position, j, &mut position);
            if let (Drive::Command(_), Some(series)) = (drive[j], &joint.effort) {
                spread(series, j, &mut effort);
            }
            let Some(series) = inputs[j] else { continue };
            for (i, t) in time.iter().enumerate() {
                let at = t + SAME_TIME;
                input[i * n + j] = match drive[j] {
                    Drive::Command(_) => joint.command_at(at).unwrap_or(f64::NAN),
                    // Before the first one nothing is known; it is taken for that one, since motion starts at the first sample.
                    _ => series.value.get(series.time.partition_point(|x| *x <= at).saturating_sub(1)).copied().unwrap_or(0.0),
                };
            }
        }
        let mut external = if outside.is_empty() { Vec::new() } else { vec![0.0; rows * n] };
        for (name, series) in outside {
            let Some(j) = names.iter().position(|n| n == name) else { continue };
            for (i, t) in time.iter().enumerate() {
                let last = series.time.partition_point(|x| *x <= t + SAME_TIME).saturating_sub(1);
                external[i * n + j] = series.value.get(last).copied().unwrap_or(0.0);
            }
        }
        let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        let usual = steps[steps.len() / 2];
        let mut starts = vec![0];
        starts.extend((1..rows).filter(|i| time[*i] - time[i - 1] > (CUT.0 * usual).max(CUT.1)));
        Ok(Self {
            source: log.source.clone(),
            hash: log.hash.clone(),
            time,
            counted: Vec::new(),
            liveliness: Vec::new(),
            strain: Vec::new(),
            doubt: Vec::new(),
            position,
            effort,
            input,
            drive,
            external,
            starts,
            continues: log.continues,
            joints: n,
            on_time: None,
            notes: Vec::new(),
        })
    }

    pub fn rows(&self) -> usize {
        self.time.len()
    }

    /// Of which stretch of so many seconds each row is.
    pub fn stretches(&self, seconds: f64) -> Vec<usize> {
        self.time.iter().map(|t| ((t - self.time[0]) / seconds).floor() as usize).collect()
    }

    /// Some of its rows, in their order: where others are left out it starts anew.
    pub fn of_rows(&self, rows: &[usize]) -> Self {
        let n = self.joints;
        let first = |i: usize| i == 0 || rows[i] != rows[i - 1] + 1 || self.starts.contains(&rows[i]);
        let starts: Vec<usize> = (0..rows.len()).filter(|i| first(*i)).collect();
        let entries = || rows.iter().flat_map(|k| k * n..(k + 1) * n);
        let of = |all: &[f64]| entries().map(|i| all[i]).collect();
        let mut these = Self {
            source: self.source.clone(),
            hash: self.hash.clone(),
            time: rows.iter().map(|k| self.time[*k]).collect(),
            position: of(&self.position),
            counted: entries().map(|i| self.counted[i]).collect(),
            liveliness: of(&self.liveliness),
            strain: of(&self.strain),
            doubt: if self.doubt.is_empty() { Vec::new() } else { of(&self.doubt) },
            effort: of(&self.effort),
            input: of(&self.input),
            drive: self.drive.clone(),
            external: if self.external.is_empty() { Vec::new() } else { of(&self.external) },
            starts,
            continues: self.continues,
            joints: n,
            on_time: None,
            notes: self.notes.clone(),
        };
        these.forget_starts();
        these
    }

    /// Rows just after a start are not counted.
    fn forget_starts(&mut self) {
        let n = self.joints;
        for (at, start) in self.starts.iter().enumerate() {
            let end = self.starts.get(at + 1).copied().unwrap_or(self.time.len());
            let burnt = (*start..end).take_while(|k| self.burns_in(*start, *k)).count();
            self.counted[start * n..(start + burnt) * n].fill(false);
            self.effort[start * n..(start + burnt) * n].fill(f64::NAN);
        }
    }

    /// Number of efforts that were measured beside commands.
    pub fn efforts(&self) -> usize {
        self.effort.iter().filter(|u| u.is_finite()).count()
    }

    /// Positions of one joint, NaN where nothing was measured.
    pub fn positions(&self, joint: usize) -> impl Iterator<Item = f64> + '_ {
        self.position.iter().skip(joint).step_by(self.joints).copied()
    }

    /// Least and greatest position of one joint over several trajectories; infinite, the greater first, where it was never measured.
    pub fn range<'t>(trajectories: impl IntoIterator<Item = &'t Self>, joint: usize) -> [f64; 2] {
        let seen = trajectories.into_iter().flat_map(|t| t.positions(joint)).filter(|y| y.is_finite());
        seen.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], y| [low.min(y), high.max(y)])
    }

    /// So many rows of one input after a start at rest.
    pub fn steady(rows: usize, period: f64, input: &[f64], drive: Vec<Drive>) -> Self {
        let joints = drive.len();
        Self {
            source: String::new(),
            hash: String::new(),
            time: (0..rows).map(|k| k as f64 * period).collect(),
            position: vec![0.0; rows * joints],
            counted: vec![true; rows * joints],
            liveliness: vec![0.0; rows * joints],
            strain: vec![0.0; rows * joints],
            doubt: Vec::new(),
            effort: vec![f64::NAN; rows * joints],
            input: input.repeat(rows),
            drive,
            external: Vec::new(),
            starts: vec![0],
            continues: false,
            joints,
            on_time: None,
            notes: Vec::new(),
        }
    }

    /// Usual time between rows, s.
    pub fn period(&self) -> f64 {
        usual_step(&self.time).unwrap_or(0.005)
    }
}
