//! Many steps in a row, and the way back: one sweep gives the gradient by the first state, all inputs and all parameters.
//!
//! [`Rollout`] holds everything that changes, made once for a number of steps; [`Rollout::forward`] steps, and
//! [`Rollout::backward`] takes cotangents of a loss by any of the states and carries them back (reverse mode; Griewank and
//! Walther 2008). Neither allocates.
//!
//! # Checkpoints
//! A step's reverse needs its state and the factor that the step left. Where all of that fits into the memory allowed, it is
//! kept, and nothing is computed twice. Otherwise states are kept every `c` steps and one segment of `c` steps in full; the way
//! back takes each segment forward again before it goes through it, so a state is computed at most twice. With `r` bytes for a
//! step in full and `s` for a state, `c r + (N / c) s` is what that takes; `c` is the largest that fits. The least is at
//! `c = sqrt(N s / r)`. The same bits come out whatever the memory.
//!
//! # Where a gradient is not valid
//! A step is a piecewise smooth function of state, input and parameters. Its gradient is that of the piece it lies on:
//! * where a joint is just about to stick or to slip, to reach or to leave a limit or a stop, or a contact is just made or
//!   broken, the gradients of the two pieces differ, and the one returned is that of the piece on which the step was solved;
//! * on a piece it says nothing of the next one: a loss that changes only when a stuck joint slips has the gradient zero until
//!   it does. Optimisers then see no way out (Suh et al. 2022);
//! * over many steps of motion that diverges (a pendulum near its top, a chain that swings), gradients grow as the motion does.
//!
//! [`Smoothing`] is for the first two: the mean of the gradients at seeded perturbations of the first state and the inputs, in
//! pairs of opposite sign. It is the gradient of the loss averaged over the perturbations wherever the loss is continuous;
//! at jumps of the loss itself (impact times in a stiff contact) it leaves out the jumps' share, as every mean of gradients does.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::error::check;
use crate::multibody::length;
use crate::reverse::{InputCotangent, Record, ReverseWorkspace, copy_state};
use crate::{
    DynamicsError, ExternalWrench, Input, LinkId, NaturalGradient, ParameterVector, SpatialVector, State, StateCotangent, StepWorkspace,
    System, Wanted,
};

/// Inputs of all steps of a rollout.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs<'a> {
    /// Drive efforts: `steps x nv`, step by step; or `nv`, held over all steps; or empty for none.
    pub tau: &'a [f64],
    /// Links that external forces act on.
    pub links: &'a [LinkId],
    /// Those forces: `steps x links`, step by step, as in [`ExternalWrench::F_W`].
    pub wrenches: &'a [SpatialVector],
}

/// How long a rollout is, and what it may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RolloutOptions {
    /// Number of steps.
    pub steps: usize,
    /// Their length, s.
    pub dt: f64,
    /// Most bytes that states and factors may take.
    pub memory: usize,
    /// Links with external forces.
    pub links: usize,
    /// Groups of parameters whose gradient is wanted.
    pub wanted: Wanted,
}

impl RolloutOptions {
    /// 64 MiB, no external forces, gradients by everything.
    pub fn new(steps: usize, dt: f64) -> Self {
        Self { steps, dt, memory: 64 << 20, links: 0, wanted: Wanted::ALL }
    }
}

/// Gradient of a loss over a rollout.
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutGradient {
    /// By the first state.
    pub x0: StateCotangent,
    /// By the efforts, `steps x nv`.
    pub tau: Vec<f64>,
    /// By the external forces, `steps x links`.
    pub wrenches: Vec<SpatialVector>,
    /// By the parameters, in the coordinates of the dynamics.
    pub natural: NaturalGradient,
}

impl RolloutGradient {
    /// The gradient by named parameters.
    ///
    /// # Errors
    /// As [`ParameterVector::gradient`].
    pub fn parameters(&self, system: &System, which: &ParameterVector) -> Result<Vec<f64>, DynamicsError> {
        let mut into = vec![0.0; which.len()];
        which.gradient(system, &self.natural, &mut into)?;
        Ok(into)
    }
}

/// Everything that changes in a rollout and its reverse pass.
#[derive(Debug, Clone)]
pub struct Rollout {
    options: RolloutOptions,
    /// Steps from one checkpoint to the next.
    every: usize,
    /// State at the start of each segment.
    checkpoints: Vec<State>,
    /// The steps of one segment, and which one.
    records: Vec<Record>,
    segment: usize,
    state: State,
    last: State,
    step: StepWorkspace,
    reverse: ReverseWorkspace,
    external: Vec<ExternalWrench>,
    bar: StateCotangent,
    own: StateCotangent,
    spare_tau: Vec<f64>,
    gradient: RolloutGradient,
    done: bool,
}

impl Rollout {
    /// Room for a rollout of a system.
    ///
    /// # Errors
    /// No steps, a step in time that is not positive, too little memory.
    pub fn new(system: &System, options: RolloutOptions) -> Result<Self, DynamicsError> {
        if !(options.dt > 0.0 && options.dt.is_finite()) {
            return Err(DynamicsError::OutOfBounds { what: "the step".into(), value: options.dt, must: "a positive time in s".into() });
        }
        if options.steps == 0 {
            return Err(DynamicsError::OutOfBounds { what: "the number of steps".into(), value: 0.0, must: "at least 1".into() });
        }
        let state = system.state();
        let (record, start) = (Record::bytes(system), state_bytes(&state));
        let every = spacing(options.steps, record, start, options.memory)?;
        let segments = options.steps.div_ceil(every);
        let n = system.multibody().nv();
        let zero = StateCotangent::zero(system);
        let mut reverse = ReverseWorkspace::new(system);
        reverse.wanted = options.wanted;
        Ok(Self {
            every,
            checkpoints: vec![state.clone(); segments],
            records: vec![Record::new(system); every],
            segment: 0,
            state: state.clone(),
            last: state,
            step: system.workspace(),
            reverse,
            external: Vec::with_capacity(options.links),
            bar: zero.clone(),
            own: zero.clone(),
            spare_tau: vec![0.0; n],
            gradient: RolloutGradient {
                x0: zero,
                tau: vec![0.0; options.steps * n],
                wrenches: vec![SpatialVector::zeros(); options.steps * options.links],
                natural: NaturalGradient::zero(system),
            },
            options,
            done: false,
        })
    }

    /// What it was made for.
    pub fn options(&self) -> &RolloutOptions {
        &self.options
    }

    /// Steps from one checkpoint to the next; the number of steps where all are kept.
    pub fn checkpoint_spacing(&self) -> usize {
        self.every
    }

    /// The last state of the last [`Self::forward`].
    pub fn last(&self) -> &State {
        &self.last
    }

    /// The gradient of the last [`Self::backward`].
    pub fn gradient(&self) -> &RolloutGradient {
        &self.gradient
    }

    /// Steps from `x0`. `look` is called with the number of each state, from 0 to the number of steps, and the state.
    ///
    /// # Errors
    /// A state or input of the wrong length or with a number that is not finite; a step that fails, with its number and,
    /// where one is to blame, the joint; another system than it was made for.
    pub fn forward(
        &mut self,
        system: &System,
        x0: &State,
        inputs: &Inputs<'_>,
        mut look: impl FnMut(usize, &State),
    ) -> Result<(), DynamicsError> {
        self.done = false;
        self.check(system, inputs)?;
        system.check_state(x0)?;
        copy_state(&mut self.state, x0);
        look(0, &self.state);
        for segment in 0..self.checkpoints.len() {
            copy_state(&mut self.checkpoints[segment], &self.state);
            self.run_segment(system, inputs, segment, &mut look)?;
        }
        copy_state(&mut self.last, &self.state);
        self.done = true;
        Ok(())
    }

    /// The way back over the last [`Self::forward`], which must have had the same system and inputs. `loss` is called with the
    /// number of each state, from the last to the first, and the state, and **adds** the loss's own derivatives by that state to
    /// the cotangent that it is given (zeros). The gradient is then in [`Self::gradient`].
    ///
    /// # Errors
    /// There was no forward pass; inputs of another length; a cotangent or gradient that is not finite; as [`Self::forward`].
    pub fn backward(
        &mut self,
        system: &System,
        inputs: &Inputs<'_>,
        mut loss: impl FnMut(usize, &State, &mut StateCotangent),
    ) -> Result<(), DynamicsError> {
        self.check(system, inputs)?;
        if !self.done {
            return Err(DynamicsError::OutOfBounds {
                what: "the number of forward passes before a backward one".into(),
                value: 0.0,
                must: "at least 1, and without an error".into(),
            });
        }
        let (n, dt, links) = (system.multibody().nv(), self.options.dt, self.options.links);
        self.reverse.clear();
        self.gradient.tau.fill(0.0);
        self.gradient.wrenches.fill(SpatialVector::zeros());
        self.bar.clear();
        loss(self.options.steps, &self.last, &mut self.bar);
        for segment in (0..self.checkpoints.len()).rev() {
            if segment != self.segment {
                copy_state(&mut self.state, &self.checkpoints[segment]);
                self.run_segment(system, inputs, segment, &mut |_, _| {})?;
            }
            let first = segment * self.every;
            let count = self.every.min(self.options.steps - first);
            for k in (0..count).rev() {
                let (step, record) = (first + k, &self.records[k]);
                gather(&mut self.external, inputs, step, links);
                let mut input = InputCotangent {
                    external: &self.external,
                    tau_bar: &mut self.gradient.tau[step * n..(step + 1) * n],
                    external_bar: &mut self.gradient.wrenches[step * links..(step + 1) * links],
                };
                let time = record.state.time;
                let done = system.reverse_step(&mut self.reverse, record, dt, &mut self.bar, &mut input);
                self.own.clear();
                loss(step, &record.state, &mut self.own);
                self.bar.add(&self.own);
                done.and_then(|()| check("the cotangent of the positions", &self.bar.q, n))
                    .and_then(|()| check("the cotangent of the velocities", &self.bar.v, n))
                    .map_err(|e| at_step(system, step, time, e))?;
            }
        }
        for (to, from) in
            [(&mut self.gradient.x0.q, &self.bar.q), (&mut self.gradient.x0.v, &self.bar.v), (&mut self.gradient.x0.z, &self.bar.z)]
        {
            to.copy_from_slice(from);
        }
        system.multibody().rigid_gradient(&self.reverse.adjoint, &mut self.gradient.natural.rigid)?;
        self.gradient.natural.theta.copy_from_slice(&self.reverse.theta);
        if self.options.wanted.rigid {
            system.reshapes_back(&mut self.gradient.natural);
        }
        self.gradient.natural.weights.copy_from_slice(&self.reverse.weights);
        self.gradient.natural.material.copy_from_slice(&self.reverse.material);
        self.gradient.natural.shape.copy_from_slice(&self.reverse.shape);
        check("the gradient by effects", &self.gradient.natural.theta, self.reverse.theta.len())?;
        check("the gradient by the residual's weights", &self.gradient.natural.weights, self.reverse.weights.len())
    }

    /// Takes the steps of one segment from `self.state`, and keeps them.
    fn run_segment(
        &mut self,
        system: &System,
        inputs: &Inputs<'_>,
        segment: usize,
        look: &mut impl FnMut(usize, &State),
    ) -> Result<(), DynamicsError> {
        let (n, dt) = (system.multibody().nv(), self.options.dt);
        let first = segment * self.every;
        let count = self.every.min(self.options.steps - first);
        for k in 0..count {
            let (step, time) = (first + k, self.state.time);
            gather(&mut self.external, inputs, step, self.options.links);
            self.records[k].begin(&self.state);
            let input = Input { tau: tau_of(inputs, &self.spare_tau, step, n), external: &self.external };
            system.step(&mut self.step, &mut self.state, &input, dt).map_err(|e| at_step(system, step, time, e))?;
            self.records[k].end(system, &self.step);
            look(step + 1, &self.state);
        }
        self.segment = segment;
        Ok(())
    }

    fn check(&self, system: &System, inputs: &Inputs<'_>) -> Result<(), DynamicsError> {
        let (n, steps) = (system.multibody().nv(), self.options.steps);
        let natural = &self.gradient.natural;
        if self.spare_tau.len() != n
            || natural.theta.len() != system.parameters().len()
            || natural.weights.len() != system.residual().map_or(0, |r| r.network().weights().len())
            || natural.rigid.inertia.len() != system.multibody().frames.len()
            || natural.shape.len() != system.contacts.as_ref().map_or(0, |c| c.geometries.len())
        {
            return Err(DynamicsError::ForeignWorkspace);
        }
        if !inputs.tau.is_empty() && inputs.tau.len() != n {
            length("the efforts of all steps", inputs.tau.len(), steps * n)?;
        }
        length("the links with external forces", inputs.links.len(), self.options.links)?;
        length("the external forces of all steps", inputs.wrenches.len(), steps * self.options.links)
    }
}

/// Perturbations for gradients near switches; see the module's first page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothing {
    /// Number of pairs of perturbations.
    pub pairs: usize,
    /// Seed.
    pub seed: u64,
    /// Largest change of each position (tangent), rad or m.
    pub q: f64,
    /// Largest change of each velocity.
    pub v: f64,
    /// Largest change of each effort, N m or N; drawn for each step.
    pub tau: f64,
}

impl Smoothing {
    /// The mean over the perturbations of the loss and its gradient. `loss` returns the loss's own value at a state (by its
    /// number) and adds its derivatives to the cotangent. The same seed gives the same bits.
    ///
    /// # Errors
    /// No pairs, a size that is negative or not finite; as [`Rollout::forward`] and [`Rollout::backward`].
    pub fn gradient(
        &self,
        system: &System,
        rollout: &mut Rollout,
        x0: &State,
        inputs: &Inputs<'_>,
        mut loss: impl FnMut(usize, &State, &mut StateCotangent) -> f64,
    ) -> Result<(f64, RolloutGradient), DynamicsError> {
        for (what, value) in [("positions", self.q), ("velocities", self.v), ("efforts", self.tau)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(DynamicsError::OutOfBounds {
                    what: format!("the smoothing of {what}"),
                    value,
                    must: "zero or positive".into(),
                });
            }
        }
        if self.pairs == 0 {
            return Err(DynamicsError::OutOfBounds { what: "the smoothing's pairs".into(), value: 0.0, must: "at least 1".into() });
        }
        rollout.check(system, inputs)?;
        system.check_state(x0)?;
        let (n, steps) = (system.multibody().nv(), rollout.options.steps);
        let mut rng = Pcg64::seed_from_u64(self.seed);
        let mut draw = |size: f64| if size > 0.0 { rng.random_range(-size..size) } else { 0.0 };
        let mut sum =
            RolloutGradient { x0: StateCotangent::zero(system), natural: NaturalGradient::zero(system), ..rollout.gradient.clone() };
        sum.tau.fill(0.0);
        sum.wrenches.fill(SpatialVector::zeros());
        let (mut total, factor) = (0.0, 0.5 / self.pairs as f64);
        for _ in 0..self.pairs {
            let dq: Vec<f64> = (0..n).map(|_| draw(self.q)).collect();
            let dv: Vec<f64> = (0..n).map(|_| draw(self.v)).collect();
            let dtau: Vec<f64> = (0..n * steps).map(|_| draw(self.tau)).collect();
            for sign in [1.0, -1.0] {
                let mut start = x0.clone();
                system.multibody().integrate(&mut start.q, &dq, sign)?;
                start.v.iter_mut().zip(&dv).for_each(|(v, d)| *v += sign * d);
                let base = |k: usize| match inputs.tau.len() {
                    0 => 0.0,
                    len if len == n => inputs.tau[k % n],
                    _ => inputs.tau[k],
                };
                let tau: Vec<f64> = dtau.iter().enumerate().map(|(k, d)| base(k) + sign * d).collect();
                let moved = Inputs { tau: &tau, ..*inputs };
                rollout.forward(system, &start, &moved, |_, _| {})?;
                rollout.backward(system, &moved, |step, state, bar| total += factor * loss(step, state, bar))?;
                sum.add(&rollout.gradient, factor);
            }
        }
        Ok((total, sum))
    }
}

impl RolloutGradient {
    /// Adds another one, scaled.
    pub fn add(&mut self, other: &Self, factor: f64) {
        let (to, from) = (&mut self.natural, &other.natural);
        let lists = [
            (&mut self.x0.q, &other.x0.q),
            (&mut self.x0.v, &other.x0.v),
            (&mut self.x0.z, &other.x0.z),
            (&mut self.tau, &other.tau),
            (&mut to.theta, &from.theta),
            (&mut to.weights, &from.weights),
            (&mut to.rigid.armature, &from.rigid.armature),
        ];
        for (to, from) in lists {
            for (a, b) in to.iter_mut().zip(from) {
                *a += factor * b;
            }
        }
        for (a, b) in self
            .wrenches
            .iter_mut()
            .zip(&other.wrenches)
            .chain(to.rigid.origin.iter_mut().zip(&from.rigid.origin))
            .chain(to.shape.iter_mut().zip(&from.shape))
        {
            *a += b * factor;
        }
        for (a, b) in to.rigid.axis.iter_mut().zip(&from.rigid.axis) {
            *a += b * factor;
        }
        for (a, b) in to.rigid.inertia.iter_mut().flatten().zip(from.rigid.inertia.iter().flatten()) {
            *a += factor * b;
        }
        for (a, b) in to.material.iter_mut().flatten().zip(from.material.iter().flatten()) {
            *a += factor * b;
        }
        to.rigid.gravity += from.rigid.gravity * factor;
    }
}

/// Runs `count` jobs over several threads, each with its own room for rollouts. Results come in the order of the jobs, and are
/// the same bits whatever the number of threads: jobs share nothing.
///
/// # Errors
/// As [`Rollout::new`]; the error of the first job that failed.
pub fn rollouts<T: Send>(
    system: &System,
    options: RolloutOptions,
    count: usize,
    threads: usize,
    job: impl Fn(usize, &mut Rollout) -> Result<T, DynamicsError> + Sync,
) -> Result<Vec<T>, DynamicsError> {
    let room = Rollout::new(system, options)?;
    let (next, results) = (AtomicUsize::new(0), Mutex::new(Vec::with_capacity(count)));
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, count.max(1)) {
            let mut room = room.clone();
            let (next, results, job) = (&next, &results, &job);
            scope.spawn(move || {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k >= count {
                        break;
                    }
                    let result = job(k, &mut room);
                    results.lock().unwrap_or_else(PoisonError::into_inner).push((k, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(k, _)| *k);
    results.into_iter().map(|(_, result)| result).collect()
}

fn tau_of<'a>(inputs: &Inputs<'a>, none: &'a [f64], step: usize, n: usize) -> &'a [f64] {
    match inputs.tau.len() {
        0 => none,
        len if len == n => inputs.tau,
        _ => &inputs.tau[step * n..(step + 1) * n],
    }
}

fn gather(external: &mut Vec<ExternalWrench>, inputs: &Inputs<'_>, step: usize, links: usize) {
    external.clear();
    let wrenches = &inputs.wrenches[step * links..(step + 1) * links];
    external.extend(inputs.links.iter().zip(wrenches).map(|(link, F_W)| ExternalWrench { link: *link, F_W: *F_W }));
}

fn state_bytes(state: &State) -> usize {
    std::mem::size_of::<State>() + 8 * (state.q.len() + state.v.len() + state.z.len())
}

/// The longest segment that fits.
fn spacing(steps: usize, record: usize, state: usize, memory: usize) -> Result<usize, DynamicsError> {
    let takes = |every: usize| every * record + steps.div_ceil(every) * state;
    if takes(steps) <= memory {
        return Ok(steps);
    }
    let least = ((steps as f64 * state as f64 / record as f64).sqrt().ceil() as usize).clamp(1, steps);
    if takes(least) > memory {
        return Err(DynamicsError::OutOfBounds {
            what: format!("the memory of a rollout of {steps} steps, in bytes,"),
            value: memory as f64,
            must: format!("at least {}", takes(least)),
        });
    }
    // Beyond the least, longer segments take more.
    let (mut low, mut high) = (least, steps);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if takes(middle) <= memory { low = middle } else { high = middle }
    }
    Ok(low)
}

/// Says where a rollout failed.
fn at_step(system: &System, step: usize, time: f64, source: DynamicsError) -> DynamicsError {
    let joint = match &source {
        DynamicsError::NoInertia { joint } => Some(joint.clone()),
        DynamicsError::NotFinite { what, index, .. } => {
            let by_position = *what == "q" || *what == "the next positions";
            let found = system.multibody().joints().iter().find(|j| if by_position { j.q.contains(index) } else { j.v.contains(index) });
            found.filter(|_| !what.contains("inner states") && *what != "z").map(|j| j.name.clone())
        }
        _ => None,
    };
    DynamicsError::AtStep { step, time, joint, source: Box::new(source) }
}
