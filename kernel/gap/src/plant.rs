//! The model under test, driven by what was measured.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector, Unit, Vector3, Vector6};
use sagci_dynamics::effects::{self, Acts};
use sagci_dynamics::residual::Residual;
use sagci_dynamics::{Coriolis, DynamicsError, ExternalWrench, Held, Input, Part, State, StepWorkspace, System};
use sagci_model::{ActuatorLaw, EffectEntry, JointKind, ObjectModel};
use sagci_recording::CommandKind;

use crate::GapError;
use crate::clocks::on_time;
use crate::inputs::{slopes, slopes_by};
use crate::observer::DriveSlopes;
use crate::stops::Stops;
use crate::trajectory::{Drive, Trajectory};

/// A simulator with the laws of its drives.
#[derive(Debug, Clone)]
pub(crate) struct Plant {
    pub system: System,
    laws: Vec<Option<ActuatorLaw>>,
    ends: Vec<Ends>,
    /// Does a sensor of the joint read other than what is?
    misread: Vec<bool>,
    /// How late all measurements are stamped, s: by their stamps, what drives the joints acts so much later.
    skew: Option<f64>,
    /// How late measurements of single joints are stamped beside that, s.
    clocks: Vec<f64>,
    /// The same without what happens to commands, where anything does: efforts act on joints behind it; by a clock that is right: what comes late
    /// has moved little after a row; and on a base that stands: how far one that swings has come after some rows says nothing about a row.
    behind_drives: Option<Box<Self>>,
    /// How late inputs act, s: of each clock that is off and each message that is on its way. Steps end where an input changes.
    late: Vec<f64>,
    /// How much an effort on a joint accelerates it where the model stands, 1/(kg m^2) or 1/kg.
    accelerates: Vec<f64>,
    /// Longest step, s.
    pub step: f64,
    /// Steps to first order are enough.
    pub rough: bool,
    /// How far a joint goes, rad or m, before data tell that it does: the noise of positions by joint; none where any way counts.
    pub told: Vec<f64>,
    /// Where steps have no order by which they are extrapolated they lose it by degrees, and not at once: errors change smoothly with what is
    /// fitted, as intervals ask.
    pub smooth: bool,
}

/// What a force along a joint acts between.
#[derive(Debug, Clone)]
struct Ends {
    parent: String,
    child: String,
    /// In the child's frame.
    axis: Unit<Vector3<f64>>,
    slides: bool,
}

/// Share of the time of a drive's loop that a step may take, and the shortest step, s.
const SHARE: f64 = 0.05;
const SHORTEST: f64 = 2e-4;
/// Share by which the step of a piece that is gone in one may be longer than the longest: rows whose stamps jitter about it are one each.
const LONGER: f64 = 0.15;
/// Share of an interval that is no piece of its own.
const SHORT: f64 = 1e-6;
/// Rows after which both sides of a play have met.
const ROWS: usize = 10;
/// How many times larger than it is a sensor may show a motion.
const SHOWN: f64 = 1.25;
/// How many times more steps are tried where one fails.
const FINER: f64 = 8.0;
/// Longest step where it is gone carefully, s.
const CAREFUL: f64 = 3.125e-4;
/// Share of a velocity's change, and of what each effort alone would change it by, by which two ways over an interval may differ and still be
/// near each other, and from which on they have no order. Between the two, and near where a joint turns round under friction, there is some
/// of it: a switch would make errors jump where a number moves by nothing, and derivatives would be those of the jumps.
const ORDERLY: f64 = 0.2;
const DISORDERLY: f64 = 0.6;

/// What changes while a plant moves.
#[derive(Debug)]
pub(crate) struct Motion {
    pub state: State,
    pub ws: StepWorkspace,
    tau: Vec<f64>,
    /// Forces from outside in a step.
    external: Vec<ExternalWrench>,
    /// Efforts behind what happens to commands, at the beginning of the interval.
    delivered: Vec<f64>,
    /// The state that a piece of an interval begins with, and those at the ends of the two ways over it.
    begin: Kept,
    coarse: Kept,
    fine: Kept,
    /// The state that a careful step begins with.
    before: Kept,
    /// Velocities that an interval begins with.
    entered: Vec<f64>,
    /// Accelerations over the last interval.
    pub acceleration: Vec<f64>,
}

/// A copy of a state.
#[derive(Debug, Clone)]
struct Kept {
    q: Vec<f64>,
    v: Vec<f64>,
    z: Vec<f64>,
    time: f64,
}

impl Kept {
    fn copy_from(&mut self, state: &State, time: f64) {
        put(&mut self.q, &state.q);
        put(&mut self.v, &state.v);
        put(&mut self.z, &state.z);
        self.time = time;
    }

    fn give_to(&self, state: &mut State) {
        put(&mut state.q, &self.q);
        put(&mut state.v, &self.v);
        put(&mut state.z, &self.z);
        state.time = self.time;
    }
}

/// Copies what is mostly one number or none: a call for each would be a good part of a small step.
#[inline]
fn put(into: &mut [f64], from: &[f64]) {
    match (into, from) {
        ([into], [from]) => *into = *from,
        ([], []) => (),
        (into, from) => into.copy_from_slice(from),
    }
}

/// The same for each joint. A loop over one of them would set up more than it does.
#[inline]
fn each(into: &mut [f64], a: &[f64], b: &[f64], change: impl Fn(&mut f64, f64, f64)) {
    match (into, a, b) {
        ([into], [a], [b]) => change(into, *a, *b),
        (into, a, b) => into.iter_mut().zip(a.iter().zip(b)).for_each(|(into, (a, b))| change(into, *a, *b)),
    }
}

impl Motion {
    /// Steps take positions from the next velocity; over an interval the mean of old and new velocity is right to second order, so the sum
    /// of steps of length `h` is set right by `h / 2 (v_0 - v_n)`.
    fn set_right(&mut self, h: f64) {
        each(&mut self.state.q, &self.state.v, &self.begin.v, |q, v, old| *q -= 0.5 * h * (v - old));
    }

    /// Does it move at an end of the piece?
    fn moves(&self, j: usize) -> bool {
        self.begin.v[j] != 0.0 || self.state.v[j] != 0.0
    }

    /// When friction stops a joint that it holds from then on, s from the beginning of the piece, if that is `soon`, or within the piece's
    /// `duration` before the joint has gone further than data tell. A filter sets a joint that stands moving by a little in every row. Both ways
    /// let it stop over their first step, so that they are off by what grows as that step, on all that moves with it, too: that is an order, and
    /// careful steps that are longer than the stop come no nearer. `h` is the last step, and `accelerates` by how much an effort accelerates the
    /// joint.
    fn stops_after(&self, j: usize, [soon, duration]: [f64; 2], told: f64, h: f64, accelerates: f64) -> Option<f64> {
        if self.coarse.v[j] != 0.0 || self.state.v[j] != 0.0 || self.ws.held()[j] != Held::Stuck {
            return None;
        }
        let (old, [forward, backward]) = (self.begin.v[j], self.ws.spare(j));
        let slows = accelerates / h * if old > 0.0 { forward } else { backward };
        let after = old.abs() / slows;
        (after < soon || after < duration && 0.5 * after * old.abs() < told).then_some(after)
    }

    /// Have the two ways over a piece an order by which they differ? `efforts` is by how much efforts alone would change the velocity over it.
    /// Where a joint turns round under friction there is none.
    fn is_orderly(&self, j: usize, efforts: f64) -> bool {
        let (old, rough, fine) = (self.begin.v[j], self.coarse.v[j], self.state.v[j]);
        let goes_on = rough * fine > 0.0 && old * fine > 0.0;
        (goes_on || !self.ws.rubs(j)) && (fine - rough).abs() <= ORDERLY * ((fine - old).abs() + efforts)
    }

    /// How far the two ways over an interval have an order by which they differ, from none to 1. `efforts` is by how much efforts alone would
    /// change the velocity over it: in slow motion they hold one another.
    fn order(&self, j: usize, efforts: f64) -> f64 {
        let (old, rough, fine) = (self.begin.v[j], self.coarse.v[j], self.state.v[j]);
        let change = (fine - old).abs();
        let off = (fine - rough).abs() / (change + efforts);
        // Two ways that agree have all of it.
        let near = if off > ORDERLY { ((DISORDERLY - off) / (DISORDERLY - ORDERLY)).max(0.0) } else { 1.0 };
        if !self.ws.rubs(j) {
            return near;
        }
        let goes_on = fine.signum() == old.signum() && fine.signum() == rough.signum();
        let slowest = if goes_on { fine.abs().min(rough.abs()).min(old.abs()) } else { 0.0 };
        if slowest < change { near * slowest / change } else { near }
    }

    /// Keeps the mean accelerations over an interval.
    fn accelerate(&mut self, duration: f64) {
        each(&mut self.acceleration, &self.state.v, &self.entered, |a, v, old| *a = (v - old) / duration);
    }

    /// Efforts of the drives in the last step.
    pub fn tau(&self) -> &[f64] {
        &self.tau
    }

    /// Efforts that the drives gave at the beginning of the last interval, behind what happens to commands.
    pub fn delivered(&self) -> &[f64] {
        &self.delivered
    }
}

/// Mean of what drives joint `j` from a time on for so long, s; `k` is a row near there. What came before the first row is not known and
/// is taken for that row's.
fn held(trajectory: &Trajectory, (k, j): (usize, usize), from: f64, duration: f64) -> f64 {
    let (time, n) = (&trajectory.time, trajectory.joints);
    let mut row = k;
    while row > 0 && time[row] > from {
        row -= 1;
    }
    while row + 1 < time.len() && time[row + 1] <= from {
        row += 1;
    }
    let (mut sum, mut at, end) = (0.0, from, from + duration);
    loop {
        let next = time.get(row + 1).map_or(end, |t| t.min(end));
        sum += trajectory.input[row * n + j] * (next - at);
        if next >= end {
            return sum / duration;
        }
        (at, row) = (next, row + 1);
    }
}

/// When an input that acts so late changes next after an instant, s.
fn next_change(time: &[f64], after: f64, late: f64) -> Option<f64> {
    time.get(time.partition_point(|t| t + late <= after)).map(|t| t + late)
}

impl Plant {
    /// `limits` says which of the URDF's limits are kept, by joint.
    pub fn new(model: &ObjectModel, limits: &[Stops], step: f64) -> Result<Self, GapError> {
        let mut open = model.clone();
        let moving: Vec<usize> = model.moving_joints().collect();
        for (slot, i) in moving.iter().enumerate() {
            let [lower, upper] = limits.get(slot).copied().unwrap_or([true; 2]);
            let limits = &mut open.joints[*i].limits;
            if !lower {
                limits.lower = f64::NEG_INFINITY;
            }
            if !upper {
                limits.upper = f64::INFINITY;
            }
        }
        let law = |i: &usize| model.document.actuators.iter().find(|a| a.joint == model.joints[*i].name).map(|a| a.law.clone());
        let laws = moving.iter().map(law).collect();
        let ends = moving.iter().map(|i| {
            let joint = &model.joints[*i];
            let name = |link: usize| model.links[link].name.clone();
            let slides = joint.kind == JointKind::Prismatic;
            Ends { parent: name(joint.parent), child: name(joint.child), axis: joint.axis, slides }
        });
        let ends = ends.collect();
        let late = |e: &EffectEntry| e.effect == "clock_skew";
        let acts_apart = |acts: Acts| matches!(acts, Acts::Command(_) | Acts::Base);
        let apart = |e: &EffectEntry| late(e) || effects::find(&e.effect).is_ok_and(|e| acts_apart(e.description().acts));
        let mut bare = model.clone();
        bare.document.effects.retain(|e| !apart(e));
        let all = bare.document.effects.len() == model.document.effects.len();
        let behind_drives = if all { None } else { Some(Box::new(Self::new(&bare, limits, step)?)) };
        let of_sensor = |e: &EffectEntry| effects::find(&e.effect).is_ok_and(|e| matches!(e.description().acts, Acts::Measurement(_)));
        let misread = moving.iter().map(|i| {
            let there = |e: &EffectEntry| e.joint.as_deref() == Some(model.joints[*i].name.as_str());
            model.document.effects.iter().any(|e| there(e) && of_sensor(e))
        });
        let misread = misread.collect();
        // The clock of the only joint is that of all.
        let of_all = |e: &EffectEntry| late(e) && (e.joint.is_none() || moving.len() == 1);
        let by = |e: &EffectEntry| if of_all(e) { e.parameters.get("skew").copied() } else { None };
        let skew: f64 = model.document.effects.iter().filter_map(by).sum();
        let skew = (skew != 0.0).then_some(skew);
        let own = |j: &usize| {
            let of_joint = |e: &&EffectEntry| late(e) && !of_all(e) && e.joint.as_deref() == Some(model.joints[*j].name.as_str());
            model.document.effects.iter().filter(of_joint).filter_map(|e| e.parameters.get("skew")).sum()
        };
        let clocks = moving.iter().map(own).collect();
        let on_its_way = |e: &EffectEntry| if e.effect == "transport_delay" { e.parameters.get("delay").copied() } else { None };
        let late = model.document.effects.iter().filter_map(on_its_way).chain(skew).collect();
        let mut system = System::new(&[Part::welded(&open, nalgebra::Isometry3::identity())])?;
        // Two ways over a piece tell what a step's first order leaves over, Coriolis forces at its start included.
        system.set_coriolis(Coriolis::AtStart);
        let mut this = Self {
            system,
            laws,
            ends,
            misread,
            skew,
            clocks,
            behind_drives,
            late,
            accelerates: Vec::new(),
            step,
            rough: false,
            told: Vec::new(),
            smooth: false,
        };
        let (n, inverse) = (moving.len(), this.inverse_mass_at(&this.system.state().q));
        this.accelerates = (0..n).map(|j| inverse[j * n + j]).collect();
        this.step = step.min(SHARE / this.rate()).max(SHORTEST.min(step));
        Ok(this)
    }

    /// Fastest rate of the loops that drives close over joints, 1/s. Their efforts are taken at the start of each step.
    fn rate(&self) -> f64 {
        let of = |(j, mobility): (usize, &f64)| {
            let slopes = slopes(self.laws[j].as_ref(), CommandKind::Position);
            (-slopes.q * mobility).sqrt().max(-slopes.v * mobility)
        };
        self.accelerates.iter().enumerate().map(of).fold(1e-9, f64::max)
    }

    /// How the drives' efforts answer, by the commands that data have for each joint.
    pub fn drives(&self, trajectories: &[Trajectory]) -> Vec<DriveSlopes> {
        self.laws.iter().enumerate().map(|(j, law)| slopes_by(trajectories, j, law.as_ref())).collect()
    }

    /// The same with a learned force besides.
    pub fn with_residual(mut self, residual: Option<&Residual>) -> Result<Self, GapError> {
        self.system.set_residual(residual)?;
        Ok(self)
    }

    /// The same in steps to first order.
    pub fn roughly(self) -> Self {
        Self { rough: true, ..self }
    }

    /// Effort that the drive of joint `j` needs as its input to give `effort` at `q`, `v`; where it is commanded a position, that is the input.
    pub fn input_for(&self, j: usize, drive: Drive, effort: f64, [target, v]: [f64; 2]) -> f64 {
        match (drive, &self.laws[j]) {
            (Drive::Command(CommandKind::Position), _) => target,
            (Drive::Command(CommandKind::Voltage), Some(ActuatorLaw::DcMotor { torque_constant, resistance, .. })) => {
                effort * resistance / torque_constant + torque_constant * v
            }
            _ => effort,
        }
    }

    pub fn motion(&self) -> Motion {
        let n = self.system.multibody().nv();
        let state = self.system.state();
        let kept = Kept { q: state.q.clone(), v: state.v.clone(), z: state.z.clone(), time: state.time };
        Motion {
            state,
            ws: self.system.workspace(),
            tau: vec![0.0; n],
            external: Vec::new(),
            delivered: vec![0.0; n],
            begin: kept.clone(),
            coarse: kept.clone(),
            fine: kept.clone(),
            before: kept,
            entered: vec![0.0; n],
            acceleration: vec![0.0; n],
        }
    }

    /// Effort of the drive of joint `j` at `q`, `v`.
    fn effort(&self, j: usize, drive: Drive, u: f64, q: f64, v: f64) -> f64 {
        let Drive::Command(kind) = drive else {
            return if matches!(drive, Drive::Effort | Drive::Given) && u.is_finite() { u } else { 0.0 };
        };
        // An empty command is an open circuit.
        if !u.is_finite() {
            return 0.0;
        }
        let clip = |x: f64, most: f64| x.clamp(-most, most);
        match &self.laws[j] {
            None => u,
            Some(ActuatorLaw::Torque { max_effort }) => clip(u, *max_effort),
            Some(ActuatorLaw::PositionServo { stiffness, damping, max_effort }) => clip(stiffness * (u - q) - damping * v, *max_effort),
            Some(ActuatorLaw::DcMotor { torque_constant, resistance, gain, max_voltage }) => {
                let voltage = match (kind, gain) {
                    (CommandKind::Position, Some(gain)) => gain * (u - q),
                    _ => u,
                };
                torque_constant * (clip(voltage, *max_voltage) - torque_constant * v) / resistance
            }
        }
    }

    /// From row `k` to the next.
    pub fn interval(&self, motion: &mut Motion, trajectory: &Trajectory, k: usize) -> Result<(), GapError> {
        let (start, end) = (trajectory.time[k], trajectory.time[k + 1]);
        put(&mut motion.entered, &motion.state.v);
        motion.state.time = start;
        let mut from = start;
        while from < end {
            let least = SHORT * (end - start);
            let changes = self.late.iter().filter_map(|late| next_change(&trajectory.time, from + least, *late));
            let to = changes.filter(|t| *t < end - least).fold(end, f64::min);
            self.piece(motion, trajectory, k, [from, to])?;
            from = to;
        }
        motion.accelerate(end - start);
        Ok(())
    }

    /// A piece of an interval in which inputs are held.
    ///
    /// A step is right to first order. Two ways over the piece, one in steps half as long, tell what that order leaves over, so that
    /// `2 x_fine - x_coarse` is right to the second (Richardson 1911). Where a joint hits something or turns round under friction there is no such
    /// order, and a third way goes carefully.
    fn piece(&self, motion: &mut Motion, trajectory: &Trajectory, k: usize, [from, to]: [f64; 2]) -> Result<(), GapError> {
        let n = trajectory.joints;
        let duration = to - from;
        let steps = duration / (2.0 * self.step);
        let steps = if steps < 1.0 + LONGER { 1.0 } else { (steps - 1e-6).ceil() };
        motion.begin.copy_from(&motion.state, from);
        motion.state.time = from;
        let coarse = self.steps(motion, trajectory, k, duration / steps, steps as usize).is_ok();
        motion.set_right(duration / steps);
        if self.rough && coarse {
            return Ok(());
        }
        motion.coarse.copy_from(&motion.state, from);
        motion.begin.give_to(&mut motion.state);
        let mut h = 0.5 * duration / steps;
        if self.steps(motion, trajectory, k, h, 2 * steps as usize).is_err() {
            // A stiff effect can want shorter steps for once. The state is that at which the step failed; the rest of the piece follows.
            let rest = to - motion.state.time;
            h = rest / (FINER * steps);
            self.steps(motion, trajectory, k, h, (FINER * steps) as usize)?;
        } else if coarse {
            motion.set_right(h);
            let efforts = |motion: &Motion, j: usize| duration * self.accelerates[j] * (motion.tau[j].abs() + motion.ws.load()[j].abs());
            let careful = (duration / CAREFUL - SHORT).ceil().max(2.0 * steps) as usize;
            let soon = [duration / careful as f64, duration];
            let told = |j: usize| self.told.get(j).copied().unwrap_or(0.0);
            let stops = |motion: &Motion, j: usize| motion.stops_after(j, soon, told(j), h, self.accelerates[j]);
            let order = |motion: &Motion, j: usize| match self.smooth {
                _ if stops(motion, j).is_some() => 1.0,
                true => motion.order(j, efforts(motion, j)),
                false => f64::from(motion.is_orderly(j, efforts(motion, j))),
            };
            // One joint that has none takes it from all that move with it.
            let order = (0..n).filter(|j| motion.moves(*j)).map(|j| order(motion, j)).fold(1.0, f64::min);
            for (mean, fine) in [(&mut motion.coarse.q, &motion.state.q), (&mut motion.coarse.v, &motion.state.v)] {
                mean.iter_mut().zip(fine).for_each(|(x, fine)| *x = 2.0 * fine - *x);
            }
            for j in 0..n {
                if let Some(after) = stops(motion, j) {
                    motion.coarse.q[j] = motion.begin.q[j] + 0.5 * after * motion.begin.v[j];
                }
            }
            // Without an order shorter steps come nearer to the instant at which it happens.
            if order < 1.0 {
                motion.fine.copy_from(&motion.state, motion.state.time);
                motion.begin.give_to(&mut motion.state);
                if self.carefully(motion, trajectory, k, [from, to], careful).is_err() {
                    motion.fine.give_to(&mut motion.state);
                }
            }
            for (x, second) in [(&mut motion.state.q, &motion.coarse.q), (&mut motion.state.v, &motion.coarse.v)] {
                x.iter_mut().zip(second).for_each(|(x, second)| *x += order * (second - *x));
            }
        }
        Ok(())
    }

    /// The same in short steps, positions by the mean of a step's velocities. A step in which a joint turns round under friction ends there, as
    /// the step before it foretells: over the whole of it friction would hold as if it went the other way already.
    fn carefully(
        &self,
        motion: &mut Motion,
        trajectory: &Trajectory,
        k: usize,
        [from, to]: [f64; 2],
        count: usize,
    ) -> Result<(), GapError> {
        let h = (to - from) / count as f64;
        let mut last: Vec<f64> = Vec::new();
        for step in 0..count {
            let at = from + step as f64 * h;
            motion.before.copy_from(&motion.state, at);
            self.one(motion, trajectory, k, h)?;
            let turns = |j: usize| motion.ws.rubs(j) && motion.before.v[j] * motion.state.v[j] < 0.0;
            let share = |j: usize| {
                let old = motion.before.v[j];
                let fall = last.get(j).map_or(old - motion.state.v[j], |last| last - old);
                if old * fall > 0.0 { old / fall } else { 1.0 }
            };
            let first = (0..motion.state.v.len()).filter(|j| turns(*j)).map(share).fold(1.0, f64::min);
            if first < 1.0 - SHORT {
                motion.before.give_to(&mut motion.state);
                self.one(motion, trajectory, k, (first * h).max(SHORT * h))?;
                let rest = at + h - motion.state.time;
                motion.before.copy_from(&motion.state, motion.state.time);
                self.one(motion, trajectory, k, rest)?;
                last.clear();
            } else {
                last.clone_from(&motion.before.v);
            }
        }
        Ok(())
    }

    /// One step from where `before` stands, its positions set right.
    fn one(&self, motion: &mut Motion, trajectory: &Trajectory, k: usize, h: f64) -> Result<(), GapError> {
        self.steps(motion, trajectory, k, h, 1)?;
        each(&mut motion.state.q, &motion.state.v, &motion.before.v, |q, v, old| *q -= 0.5 * h * (v - old));
        Ok(())
    }

    fn steps(&self, motion: &mut Motion, trajectory: &Trajectory, k: usize, h: f64, count: usize) -> Result<(), GapError> {
        let n = trajectory.joints;
        for step in 0..count {
            for j in 0..n {
                let drive = trajectory.drive[j];
                let u = match self.skew {
                    Some(late) => held(trajectory, (k, j), motion.state.time - late, h),
                    None => trajectory.input[k * n + j],
                };
                motion.tau[j] = self.effort(j, drive, u, motion.state.q[j], motion.state.v[j]);
                // What was measured is what acted and what the sensor added.
                if drive == Drive::Effort {
                    motion.tau[j] -= self.misread_effort(motion, j);
                }
            }
            let begins = step == 0 && motion.state.time == trajectory.time[k];
            if !trajectory.external.is_empty() {
                self.push(motion, &trajectory.external[k * n..(k + 1) * n])?;
            }
            self.system.step(&mut motion.ws, &mut motion.state, &Input { tau: &motion.tau, external: &motion.external }, h)?;
            if begins {
                put(&mut motion.delivered, motion.ws.reached());
            }
        }
        Ok(())
    }

    /// Sets forces from outside that are so large along each joint: pairs on the links at its two ends, which are no force on any other joint.
    /// What happens to commands does not happen to them.
    fn push(&self, motion: &mut Motion, efforts: &[f64]) -> Result<(), DynamicsError> {
        let multibody = self.system.multibody();
        multibody.set_state(motion.ws.rigid(), &motion.state.q, &motion.state.v)?;
        motion.external.clear();
        for (ends, effort) in self.ends.iter().zip(efforts).filter(|(_, effort)| **effort != 0.0) {
            let (parent, child) = (multibody.link(&ends.parent)?, multibody.link(&ends.child)?);
            let along_W = multibody.X_WL(motion.ws.rigid(), child) * (*effort * ends.axis.into_inner());
            let mut F_W = Vector6::zeros();
            F_W.fixed_rows_mut::<3>(if ends.slides { 3 } else { 0 }).copy_from(&along_W);
            motion.external.extend([ExternalWrench { link: child, F_W }, ExternalWrench { link: parent, F_W: -F_W }]);
        }
        Ok(())
    }

    /// Efforts, N m or N, that bodies need for such accelerations at the state, rad/s^2 or m/s^2, beside what already acts.
    pub fn efforts_for(&self, motion: &mut Motion, accelerations: &[f64]) -> Result<Vec<f64>, DynamicsError> {
        let multibody = self.system.multibody();
        let rigid = motion.ws.rigid();
        multibody.set_state(rigid, &motion.state.q, &motion.state.v)?;
        let efforts = multibody.mass_matrix(rigid)? * DVector::from_column_slice(accelerations);
        Ok(efforts.iter().copied().collect())
    }

    /// What the sensor of joint `j` adds to an effort at the state.
    pub fn misread_effort(&self, motion: &Motion, j: usize) -> f64 {
        if self.misread[j] { self.system.measure(&motion.state, 0.0, j).effort.value } else { 0.0 }
    }

    /// Lets time, s, pass in which nothing was recorded. A joint that was brought nowhere meanwhile stood, and what is bent there stays so.
    pub fn pause(&self, motion: &mut Motion, passed: f64) {
        self.system.stand(&motion.ws, &mut motion.state, passed);
    }

    /// Bases that give way are at rest, as where a new recording begins.
    pub fn rest_bases(&self, motion: &mut Motion) {
        for base in self.system.placements().iter().filter(|p| p.effect.description().acts == Acts::Base) {
            motion.state.z[base.z.clone()].fill(0.0);
        }
    }

    /// Appends the inverse of the mass matrix at the state. One that cannot be had is zero.
    pub fn inverse_mass(&self, motion: &mut Motion, into: &mut Vec<f64>) {
        let multibody = self.system.multibody();
        let n = multibody.nv();
        let rigid = motion.ws.rigid();
        let found = multibody.set_state(rigid, &motion.state.q, &motion.state.v).and_then(|()| multibody.mass_matrix(rigid).cloned());
        match found.ok().and_then(nalgebra::Cholesky::new) {
            Some(factor) => into.extend_from_slice(factor.inverse().as_slice()),
            None => into.extend(std::iter::repeat_n(0.0, n * n)),
        }
    }

    /// How much an effort accelerates joints within a row, by columns, at the most what the inverse of the mass matrix says. Effects may
    /// hold it back: a spring or a play that it has to go through, a friction that grows with it. So it is what a row shows after some rows
    /// under the largest effort, when all moves and both sides of a play have met. A joint that friction holds even then is as free as its inertia.
    pub fn mobility(&self, q: &[f64], period: f64, most: &[f64]) -> Vec<f64> {
        if let Some(bare) = &self.behind_drives {
            return bare.mobility(q, period, most);
        }
        let rigid = self.inverse_mass_at(q);
        let n = most.len();
        // As it is read: a sensor that shows less shows less of the effort's noise, too.
        let read = |motion: &Motion, j: usize| self.system.measure(&motion.state, 0.0, j).position.d_q * motion.state.v[j];
        // Velocities before and after the last row.
        let end = |input: &[f64]| -> Option<[Vec<f64>; 2]> {
            let mut row = Trajectory::steady(ROWS + 1, period, most, vec![Drive::Given; n]);
            let last = (ROWS - 1) * n;
            row.input[last..last + n].copy_from_slice(input);
            let mut motion = self.motion();
            motion.state.q.copy_from_slice(q);
            (0..ROWS).try_for_each(|k| self.interval(&mut motion, &row, k)).ok()?;
            Some([motion.entered.clone(), (0..n).map(|j| read(&motion, j)).collect()])
        };
        let Some([before, still]) = end(most) else { return rigid };
        let mut mobility = rigid;
        // A joint that is held has nothing to show: a filter that took it for immovable would believe none of the motion that it sees.
        for j in (0..n).filter(|j| before[*j] != 0.0) {
            let mut more = most.to_vec();
            more[j] *= 1.01;
            let Some([_, pushed]) = end(&more) else { continue };
            for i in 0..n {
                let found = (pushed[i] - still[i]) / (0.01 * most[j] * period);
                let bound = SHOWN * mobility[j * n + i].abs();
                mobility[j * n + i] = found.clamp(-bound, bound);
            }
        }
        mobility
    }

    /// Inverse of the mass matrix at positions, by columns.
    pub fn inverse_mass_at(&self, q: &[f64]) -> Vec<f64> {
        let multibody = self.system.multibody();
        let n = multibody.nv();
        let mut ws = multibody.workspace();
        let mass = multibody.set_state(&mut ws, q, &vec![0.0; n]).and_then(|()| multibody.mass_matrix(&mut ws).cloned());
        let inverse = mass.ok().and_then(nalgebra::Cholesky::new).map_or_else(|| DMatrix::identity(n, n), |f| f.inverse());
        inverse.as_slice().to_vec()
    }

    /// A trajectory as its measurements were true, by the clocks of single joints.
    pub fn on_time<'t>(&self, trajectory: &'t Trajectory) -> Cow<'t, Trajectory> {
        on_time(trajectory, &self.clocks)
    }

    /// The position that is read on joint `j` with a stamp of the state's time. Where all are stamped late the motion itself goes by the stamps.
    pub fn reading(&self, motion: &Motion, j: usize) -> f64 {
        self.reading_before(motion, j, self.clocks[j])
    }

    /// The position that was read on joint `j` so long before the state's time, s, by its velocity and acceleration.
    pub fn reading_before(&self, motion: &Motion, j: usize, late: f64) -> f64 {
        if !self.misread[j] {
            return motion.state.q[j];
        }
        let reading = self.system.measure(&motion.state, 0.0, j);
        let (v, a) = (motion.state.v[j], motion.acceleration[j]);
        reading.position.value - late * reading.position.d_q * (v - 0.5 * late * a)
    }

    /// Efforts of gravity at positions; zeros where they cannot be had.
    pub fn weights_at(&self, q: &[f64]) -> Vec<f64> {
        let multibody = self.system.multibody();
        let (mut ws, mut weights) = (multibody.workspace(), vec![0.0; multibody.nv()]);
        let still = vec![0.0; weights.len()];
        let found = multibody.set_state(&mut ws, q, &still).and_then(|()| multibody.bias_efforts(&mut ws, &mut weights));
        if found.is_ok() { weights } else { still }
    }

    /// Momentum of the whole with each joint moving alone, per 1 rad/s or m/s, at positions: N s in the world. A joint of which it
    /// cannot be had is left out.
    pub fn momenta_at(&self, q: &[f64]) -> Vec<Vector3<f64>> {
        let multibody = self.system.multibody();
        let mut ws = multibody.workspace();
        let mut alone = |j: usize| {
            let v: Vec<f64> = (0..multibody.nv()).map(|i| if i == j { 1.0 } else { 0.0 }).collect();
            multibody.set_state(&mut ws, q, &v).ok()?;
            Some(multibody.momentum(&ws).linear)
        };
        (0..multibody.nv()).filter_map(&mut alone).collect()
    }

    /// How late the motion goes by its stamps, s: efforts are read by a clock that is right.
    pub fn shown_late(&self) -> f64 {
        self.skew.unwrap_or(0.0)
    }

    /// Keeps positions between the limits that are kept.
    pub fn clamp(&self, motion: &mut Motion) {
        for joint in self.system.multibody().joints() {
            let (lower, upper) = (joint.limits.lower, joint.limits.upper);
            if lower <= upper {
                let q = &mut motion.state.q[joint.q.start];
                *q = q.clamp(lower, upper);
            }
        }
    }
}
