//! Effects at their places in a system: how commands pass through them, what they add to a step, how their inner states move on,
//! what is measured through them, and how they change the rigid bodies. Each way has its way back, from cotangents of what comes out
//! to cotangents of what went in (Griewank and Walther 2008, chapter 3).
//!
//! The commands of one joint pass its effects in the order of their stages ([`Acts::Command`]), readings likewise; within a stage the
//! order is that in which the effects were added.

use std::ops::{Deref, DerefMut};

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use crate::algorithms::pendulum::{ACROSS, Turning};
use crate::effects::{Acts, Advance, HISTORY, Instant, Partial, Reading, Reshape, Resistance, Row, Sway, Transfer, stand};
use crate::joint::Motion;
use crate::spatial::{join, linear};
use crate::step::StepWorkspace;
use crate::{Multibody, Placement, SpatialInertia, State, System, Workspace};

/// One step as it was taken, for effects.
#[derive(Debug, Clone, Copy)]
pub struct Taken<'a> {
    /// Where it started.
    pub state: &'a State,
    /// Next velocities.
    pub next: &'a [f64],
    /// Inputs that reached the joints: [`StepWorkspace::reached`].
    pub tau: &'a [f64],
    /// What came into each change of the command, by placement: [`StepWorkspace::seen`].
    pub seen: &'a [f64],
    /// Force of gravity, Coriolis and external forces: [`StepWorkspace::load`].
    pub load: &'a [f64],
    /// Its length, s.
    pub dt: f64,
}

/// Cotangents to which the ways back add.
#[derive(Debug)]
pub struct Cotangents<'a> {
    /// By the tangent of positions at the start, nv entries.
    pub q: &'a mut [f64],
    /// By velocities at the start.
    pub v: &'a mut [f64],
    /// By next velocities.
    pub next: &'a mut [f64],
    /// By inner states at the start.
    pub z: &'a mut [f64],
    /// By inputs that reached the joints.
    pub tau: &'a mut [f64],
    /// By the load.
    pub load: &'a mut [f64],
    /// By parameters of effects.
    pub theta: &'a mut [f64],
}

impl Cotangents<'_> {
    /// Adds what a cotangent of a value means for everything that it depends on, but for its input.
    fn add(&mut self, placed: &Placement, value: &Partial, cotangent: f64) {
        let k = placed.v;
        if placed.q.is_some() {
            self.q[k] += cotangent * value.d_q;
        }
        self.v[k] += cotangent * value.d_v;
        self.next[k] += cotangent * value.d_next;
        self.load[k] += cotangent * value.d_load;
        for (z, d) in self.z[placed.z.clone()].iter_mut().zip(value.d_z) {
            *z += cotangent * d;
        }
        for (theta, d) in self.theta[placed.theta.clone()].iter_mut().zip(value.d_theta) {
            *theta += cotangent * d;
        }
    }
}

/// A base that gives way, in one step.
#[derive(Debug, Clone, Default)]
pub(crate) struct BaseMotion {
    /// Momentum along its direction, per velocity.
    pub momentum: Vec<f64>,
    /// Mass that it carries, kg.
    pub carried: f64,
    /// Force with which what it carries reacts at rest of all accelerations, without gravity, N.
    pub reaction: f64,
    /// Where it carries one body on one joint: its momentum per velocity, by the joint's position.
    pub of_pendulum: Turning,
}

impl BaseMotion {
    pub fn new(n: usize) -> Self {
        Self { momentum: vec![0.0; n], ..Self::default() }
    }
}

/// How a base that gives way stands in a system.
#[derive(Debug, Clone)]
pub(crate) struct SwayPlace {
    pub placement: usize,
    /// The bodies that it carries.
    pub bodies: Vec<bool>,
}

impl System {
    #[inline]
    pub(crate) fn instant<'a>(&self, placed: &Placement, taken: &Taken<'a>, input: f64) -> Instant<'a> {
        let state = taken.state;
        Instant {
            q: placed.q.map_or(0.0, |q| state.q[q]),
            v: state.v[placed.v],
            next: taken.next[placed.v],
            dt: taken.dt,
            input,
            load: taken.load.get(placed.v).copied().unwrap_or(0.0),
            time: state.time,
            z: &state.z[placed.z.clone()],
        }
    }

    #[inline]
    pub(crate) fn theta_of(&self, placed: &Placement) -> &[f64] {
        &self.parameters()[placed.theta.clone()]
    }

    /// Takes the commands `ws.tau` on their way to the joints.
    pub(crate) fn drive(&self, ws: &mut StepWorkspace, state: &State, dt: f64) {
        for &i in &self.commands {
            let placed = &self.placements()[i];
            ws.seen[i] = ws.tau[placed.v];
            let taken = Taken { state, next: &state.v, tau: &[], seen: &[], load: &[], dt };
            let at = self.instant(placed, &taken, ws.seen[i]);
            ws.tau[placed.v] = placed.effect.command_value(self.theta_of(placed), &at);
        }
    }

    /// The way back through the commands: `tau` comes in as cotangents of what reached the joints and goes out as those of the
    /// commands; `z_next` are cotangents of the next inner states.
    pub fn drive_back(&self, taken: &Taken<'_>, z_next: &[f64], bar: &mut Cotangents<'_>) {
        let mut transfer = Transfer::default();
        for &i in self.commands.iter().rev() {
            let placed = &self.placements()[i];
            let (k, at) = (placed.v, self.instant(placed, taken, taken.seen[i]));
            transfer.d_history.fill(0.0);
            placed.effect.command(self.theta_of(placed), &at, &mut transfer);
            let out = bar.tau[k];
            bar.add(placed, &transfer.output, out);
            if placed.effect.keeps_history() {
                let history = placed.z.start + placed.effect.states();
                for (z, d) in bar.z[history..history + HISTORY].iter_mut().zip(transfer.d_history) {
                    *z += out * d;
                }
            }
            let more = self.states_back(placed, &at, z_next, bar);
            bar.tau[k] = out * transfer.output.d_input + more;
        }
    }

    /// What one effect adds at the next velocities of a step, all together.
    pub(crate) fn resistance(&self, placed: &Placement, taken: &Taken<'_>) -> Partial {
        let description = placed.effect.description();
        match description.acts {
            Acts::Joint => {
                let input = taken.tau.get(placed.v).copied().unwrap_or(0.0);
                let (theta, at) = (self.theta_of(placed), self.instant(placed, taken, input));
                let factor = if description.wears { self.wear(placed.v, taken, None) } else { 1.0 };
                if factor == 1.0 {
                    return placed.effect.resist_in_all(theta, &at);
                }
                // Stops do not wear.
                let mut out = Resistance::default();
                placed.effect.resist(theta, &at, &mut out);
                out.smooth = out.smooth * factor;
                out.dry = out.dry.map(|d| d * factor);
                out.total(at.next)
            }
            Acts::Losses => self.wear_of(placed, taken).total(taken.next[placed.v]),
            _ => Partial::default(),
        }
    }

    /// Adds to a step's row what an effect that acts on its joint does there.
    #[inline]
    pub(crate) fn add_force(&self, placed: &Placement, taken: &Taken<'_>, row: &mut Row<'_>) {
        let worn = !self.wears.is_empty() && placed.effect.description().wears;
        let factor = if worn { self.wear(placed.v, taken, None) } else { 1.0 };
        placed.effect.add_force(self.theta_of(placed), &self.instant(placed, taken, taken.tau[placed.v]), factor, row);
    }

    /// The factor on the losses of a degree of freedom; without one effect, if that is given.
    fn wear(&self, v: usize, taken: &Taken<'_>, without: Option<usize>) -> f64 {
        let factor = |&i: &usize| {
            let wear = &self.placements()[i];
            let counts = wear.v == v && Some(wear.theta.start) != without;
            if counts { wear.effect.wear(self.theta_of(wear), taken.state.time + taken.dt).value } else { 1.0 }
        };
        self.wears.iter().map(factor).product()
    }

    /// The force that wear adds is counted with the effects that it scales; what is left for it is its derivative by its own
    /// parameters.
    fn wear_of(&self, placed: &Placement, taken: &Taken<'_>) -> Resistance {
        let mut out: Resistance = Resistance::default();
        let slope = placed.effect.wear(self.theta_of(placed), taken.state.time + taken.dt).d_theta;
        let others = self.wear(placed.v, taken, Some(placed.theta.start));
        let mut scaled = [0.0; 3];
        for other in self.placements().iter().filter(|p| p.v == placed.v && p.effect.description().wears) {
            let mut loss = Resistance::default();
            let input = taken.tau.get(other.v).copied().unwrap_or(0.0);
            other.effect.resist(self.theta_of(other), &self.instant(other, taken, input), &mut loss);
            for (sum, part) in scaled.iter_mut().zip([loss.smooth, loss.dry[0], loss.dry[1]]) {
                *sum += others * part.value;
            }
        }
        let [forward, backward] = &mut out.dry;
        for (part, scaled) in [&mut out.smooth, forward, backward].into_iter().zip(scaled) {
            part.d_theta = slope.map(|d| d * scaled);
        }
        out
    }

    /// The way back through the forces of a step, `dtau`: `lambda` are the multipliers of the step's equations
    /// `M (w - v) + dt (dtau + ...) = 0`, of which a loss takes `-lambda . dr`; zero where a coordinate is held.
    pub fn resist_back(&self, taken: &Taken<'_>, lambda: &[f64], bar: &mut Cotangents<'_>) {
        for placed in self.placements() {
            let weight = -taken.dt * lambda[placed.v];
            if weight == 0.0 {
                continue;
            }
            let total = self.resistance(placed, taken);
            bar.add(placed, &total, weight);
            bar.tau[placed.v] += weight * total.d_input;
        }
    }

    /// Inner states after a step.
    pub(crate) fn advance(&self, taken: &Taken<'_>, z: &mut [f64]) {
        z.copy_from_slice(&taken.state.z);
        if z.is_empty() {
            return;
        }
        for (i, placed) in self.placements().iter().enumerate() {
            if placed.z.is_empty() || placed.effect.description().acts == Acts::Base {
                continue;
            }
            let at = self.instant(placed, taken, self.input_of(i, taken));
            placed.effect.advance_values(self.theta_of(placed), &at, &mut z[placed.z.clone()]);
        }
    }

    pub(crate) fn input_of(&self, i: usize, taken: &Taken<'_>) -> f64 {
        let placed = &self.placements()[i];
        match placed.effect.description().acts {
            Acts::Command(_) => taken.seen[i],
            _ => taken.tau.get(placed.v).copied().unwrap_or(0.0),
        }
    }

    /// The way back through the inner states of all effects but those on the command, which are in [`Self::drive_back`]:
    /// `z_next` are cotangents of the next inner states.
    pub fn advance_back(&self, taken: &Taken<'_>, z_next: &[f64], bar: &mut Cotangents<'_>) {
        for (i, placed) in self.placements().iter().enumerate() {
            if placed.z.is_empty() || matches!(placed.effect.description().acts, Acts::Command(_) | Acts::Base) {
                continue;
            }
            let at = self.instant(placed, taken, self.input_of(i, taken));
            bar.tau[placed.v] += self.states_back(placed, &at, z_next, bar);
        }
    }

    /// The way back through one effect's inner states; gives the cotangent of its input.
    fn states_back(&self, placed: &Placement, at: &Instant<'_>, z_next: &[f64], bar: &mut Cotangents<'_>) -> f64 {
        let (states, z_next) = (placed.effect.states(), &z_next[placed.z.clone()]);
        if states == 0 {
            return 0.0;
        }
        let mut out = Advance::default();
        placed.effect.advance(self.theta_of(placed), at, &mut out);
        let mut input = 0.0;
        for (next, cotangent) in out.z.iter().zip(z_next).take(states) {
            bar.add(placed, next, *cotangent);
            input += cotangent * next.d_input;
        }
        if placed.effect.keeps_history() {
            // All entries stay but the one that is written. Durations are no variables.
            let first = placed.z.start + states;
            for (slot, (z, next)) in bar.z[first..first + HISTORY].iter_mut().zip(&z_next[states..]).enumerate() {
                match out.sample {
                    Some(sample) if sample.slot == slot => {
                        *z += next * sample.d_slot;
                        input += next * sample.d_input;
                    }
                    _ => *z += next,
                }
            }
        }
        input
    }

    /// What the sensors of a joint read in a state. `v` is the joint's entry in velocities, `effort` the true one.
    pub fn measure(&self, state: &State, effort: f64, v: usize) -> Reading {
        let mut reading = self.perfect_reading(state, effort, v).unwrap_or_default();
        for &i in &self.measurements {
            if self.acts_on_reading(i, v) {
                reading = self.read(i, state, &reading);
            }
        }
        reading
    }

    /// What perfect sensors read on a degree of freedom; none where there is no such.
    pub(crate) fn perfect_reading(&self, state: &State, effort: f64, v: usize) -> Option<Reading> {
        let q = self.multibody().joints().iter().find(|j| j.v == (v..v + 1)).map_or(0.0, |j| state.q[j.q.start]);
        Some(Reading::perfect(q, *state.v.get(v)?, effort, state.time))
    }

    pub(crate) fn read(&self, i: usize, state: &State, incoming: &Reading) -> Reading {
        let placed = &self.placements()[i];
        let [position, velocity, effort, stamp] = [incoming.position, incoming.velocity, incoming.effort, incoming.stamp].map(|p| p.value);
        let mut out = Reading::perfect(position, velocity, effort, stamp);
        let z = &state.z[placed.z.clone()];
        // Drifts go with the true time, whatever is stamped.
        let at = Instant { time: state.time, ..Instant::at(position, velocity, effort, 0.0, stamp, z) };
        placed.effect.measure(self.theta_of(placed), &at, &mut out);
        out
    }

    /// The way back through the sensors of a joint. `reading` are cotangents of the position, velocity, effort and stamp that are
    /// read; they go out as those of the true position, velocity, effort and time.
    pub fn measure_back(&self, state: &State, effort: f64, v: usize, reading: &mut [f64; 4], z: &mut [f64], theta: &mut [f64]) {
        let perfect = self.perfect_reading(state, effort, v).unwrap_or_default();
        self.read_back(0, state, v, &perfect, reading, z, theta);
    }

    #[allow(clippy::too_many_arguments)]
    fn read_back(&self, from: usize, state: &State, v: usize, incoming: &Reading, bar: &mut [f64; 4], z: &mut [f64], theta: &mut [f64]) {
        let Some(offset) = self.measurements[from..].iter().position(|&i| self.acts_on_reading(i, v)) else { return };
        let i = self.measurements[from + offset];
        let out = self.read(i, state, incoming);
        self.read_back(from + offset + 1, state, v, &out, bar, z, theta);
        let placed = &self.placements()[i];
        let mut before = [0.0, 0.0, 0.0, bar[3]];
        for (value, bar) in [out.position, out.velocity, out.effort, out.stamp].iter().zip(*bar) {
            for (sum, d) in before.iter_mut().zip([value.d_q, value.d_v, value.d_input]) {
                *sum += bar * d;
            }
            for (z, d) in z[placed.z.clone()].iter_mut().zip(value.d_z) {
                *z += bar * d;
            }
            for (theta, d) in theta[placed.theta.clone()].iter_mut().zip(value.d_theta) {
                *theta += bar * d;
            }
        }
        *bar = before;
    }

    /// What each effect on the rigid bodies changes, and of which joint (its placement): for the way from gradients by armatures,
    /// inertias, axes and origins to those by the effects' parameters.
    pub fn reshapes(&self) -> impl Iterator<Item = (&Placement, Reshape)> + '_ {
        self.placements().iter().filter(|p| p.effect.description().acts == Acts::Bodies).map(|placed| {
            let mut out = Reshape::default();
            placed.effect.reshape(self.theta_of(placed), &mut out);
            (placed, out)
        })
    }

    /// Puts the changes of the rigid bodies on top of the bodies as they are given.
    pub(crate) fn apply_reshapes(&mut self) {
        let Some(given) = &self.given else { return };
        let mut bodies = (**given).clone();
        for (placed, change) in self.reshapes() {
            let Some(b) = bodies.bodies.iter().position(|b| b.nv == 1 && b.v == placed.v && !b.follows) else { continue };
            bodies.armature[placed.v] += change.armature.value;
            let i = change.inertia.map(|p| p.value);
            let I = Matrix3::new(i[4], i[5], i[6], i[5], i[7], i[8], i[6], i[8], i[9]);
            bodies.inertia[b] += SpatialInertia { mass: i[0], h: Vector3::new(i[1], i[2], i[3]), I };
            let body = &mut bodies.bodies[b];
            if change.turn() != Vector3::zeros() {
                let axis = Unit::new_normalize(Rotation3::new(change.turn()) * body.motion.axis);
                body.motion = Motion::new(body.motion.kind, &axis);
            }
            body.p_PJ += body.R_PJ * change.shift();
            body.prepare();
        }
        self.multibody = bodies;
    }

    /// How the bases that give way are driven in this state. After the loads and composite inertias.
    pub(crate) fn gather_bases(&self, rigid: &Workspace, bases: &mut [BaseMotion]) {
        for (place, base) in self.sways.iter().zip(bases) {
            let placed = &self.placements()[place.placement];
            let Some(sway) = placed.effect.sway_values(self.theta_of(placed)) else { continue };
            let multibody = self.multibody();
            base.momentum.fill(0.0);
            (base.carried, base.reaction) = (0.0, 0.0);
            for (i, body) in multibody.bodies.iter().enumerate().skip(1).filter(|(i, _)| place.bodies[*i]) {
                let inertia = &rigid.composite[i];
                for k in 0..body.nv {
                    let momentum = linear(&inertia.times(&rigid.S[body.tree + k])).dot(&sway.direction);
                    base.momentum[body.v + k] += momentum;
                }
                if !place.bodies[body.parent] {
                    base.carried += inertia.mass;
                    let weight = multibody.gravity * inertia.mass;
                    base.reaction += (linear(&rigid.F[i]) + weight).dot(&sway.direction);
                }
            }
        }
    }

    /// The momenta that one body alone gives to bases, by its position.
    pub(crate) fn prepare_bases(&self, rigid: &mut Workspace, bases: &mut [BaseMotion]) {
        if self.sways.is_empty() {
            return;
        }
        let mut momenta = ACROSS.map(|q| {
            self.multibody().stand_at(rigid, q, &mut [0.0]);
            self.multibody().composite(rigid);
            self.gather_bases(rigid, bases);
            bases.iter().map(|base| base.momentum[0]).collect::<Vec<f64>>().into_iter()
        });
        let kind = self.multibody().bodies[1].motion.kind;
        for base in bases {
            base.of_pendulum = Turning::new(kind, momenta.each_mut().map(|m| m.next().unwrap_or_default()));
        }
    }

    /// [`Self::gather_bases`] where they carry one body alone.
    pub(crate) fn gather_under_pendulum(&self, state: &State, bases: &mut [BaseMotion]) {
        let (q, v) = (state.q[0], state.v[0]);
        for base in bases {
            let [momentum, change] = base.of_pendulum.at(q);
            (base.momentum[0], base.reaction) = (momentum, change * v * v);
        }
    }

    /// Adds the bases that give way to the step's problem, condensed onto the joints' next velocities.
    pub(crate) fn add_bases(&self, ws: &mut StepWorkspace, state: &State, dt: f64) {
        for (place, base) in self.sways.iter().zip(&ws.bases) {
            let Some(motion) = self.base_step(place, base, state, dt) else { continue };
            let n = base.momentum.len();
            // The momentum that the base takes on is `p (rate+ - rate)`, with `rate+ = (free - p.w) / D`.
            for (k, p) in base.momentum.iter().enumerate() {
                for (j, other) in base.momentum.iter().enumerate() {
                    ws.problem.A[k * n + j] -= p * other / motion.inertia;
                }
                ws.problem.b[k] -= p * (motion.free / motion.inertia - motion.rate);
            }
        }
    }

    /// Moves the bases on.
    pub(crate) fn advance_bases(&self, ws: &mut StepWorkspace, state: &State, dt: f64) {
        for (place, base) in self.sways.iter().zip(&ws.bases) {
            let Some(motion) = self.base_step(place, base, state, dt) else { continue };
            let rate = motion.next_rate(base, &ws.problem.v);
            let z = self.placements()[place.placement].z.start;
            ws.z[z] = state.z[z] + 0.5 * dt * (motion.rate + rate);
            ws.z[z + 1] = rate;
        }
    }

    /// Lets time, s, pass while all joints stand: the inner states of effects on them go on, bases swing on alone, with what they carry in the last
    /// step. What is on its way to a drive, and what a motor does apart from its link, stays.
    pub fn stand(&self, ws: &StepWorkspace, state: &mut State, duration: f64) {
        for placed in self.placements() {
            let q = placed.q.map_or(0.0, |q| state.q[q]);
            stand(placed.effect, self.theta_of(placed), q, duration, &mut state.z[placed.z.clone()]);
        }
        for (place, base) in self.sways.iter().zip(&ws.bases) {
            let placed = &self.placements()[place.placement];
            if let Some(sway) = placed.effect.sway_values(self.theta_of(placed)) {
                sway.swing_on(base.carried, &mut state.z[placed.z.clone()], duration);
            }
        }
    }

    pub(crate) fn base_step(&self, place: &SwayPlace, base: &BaseMotion, state: &State, h: f64) -> Option<BaseStep> {
        let placed = &self.placements()[place.placement];
        let Sway { direction, mass, damping, stiffness } = placed.effect.sway_values(self.theta_of(placed))?;
        let z = &state.z[placed.z.clone()];
        let held = 0.25 * h * h * stiffness + 0.5 * h * damping;
        let mass = mass + base.carried;
        let along: f64 = base.momentum.iter().zip(&state.v).map(|(p, v)| p * v).sum();
        let free = (mass - held) * z[1] + along - h * (stiffness * z[0] + base.reaction);
        Some(BaseStep { direction, stiffness, inertia: mass + held, inward: mass - held, free, rate: z[1] })
    }
}

/// A base's step: its next rate is `(free - p.w) / inertia`.
pub(crate) struct BaseStep {
    /// Unit vector in the world.
    pub direction: Vector3<f64>,
    /// N/m.
    pub stiffness: f64,
    pub inertia: f64,
    /// How `free` grows with the rate.
    pub inward: f64,
    pub free: f64,
    pub rate: f64,
}

impl BaseStep {
    /// The next rate, for next velocities of the joints.
    pub fn next_rate(&self, base: &BaseMotion, w: &[f64]) -> f64 {
        let along: f64 = base.momentum.iter().zip(w).map(|(p, w)| p * w).sum();
        (self.free - along) / self.inertia
    }
}

impl SwayPlace {
    /// Lets the roots of what the base carries have its acceleration and virtual velocity. Adds to what is there.
    pub fn move_base(&self, rigid: &mut Workspace, multibody: &Multibody, acceleration: &Vector3<f64>, virtual_velocity: &Vector3<f64>) {
        for (i, body) in multibody.bodies.iter().enumerate().skip(1) {
            if self.bodies[i] && !self.bodies[body.parent] {
                rigid.bases[i][0] += join(&Vector3::zeros(), acceleration);
                rigid.bases[i][1] += join(&Vector3::zeros(), virtual_velocity);
            }
        }
    }
}

/// The rigid bodies as they are given, to be changed. When it goes, effects that change the bodies are put on top again.
#[derive(Debug)]
pub struct MultibodyMut<'a>(pub(crate) &'a mut System);

impl Deref for MultibodyMut<'_> {
    type Target = Multibody;
    fn deref(&self) -> &Multibody {
        self.0.given.as_deref().unwrap_or(&self.0.multibody)
    }
}

impl DerefMut for MultibodyMut<'_> {
    fn deref_mut(&mut self) -> &mut Multibody {
        self.0.given.as_deref_mut().unwrap_or(&mut self.0.multibody)
    }
}

impl Drop for MultibodyMut<'_> {
    fn drop(&mut self) {
        self.0.apply_reshapes();
        self.0.place_shapes();
        self.0.changed();
    }
}

/// Parameters of effects, to be changed. When it goes, effects that change the rigid bodies do so with their new values.
#[derive(Debug)]
pub struct ParametersMut<'a>(pub(crate) &'a mut System);

impl Deref for ParametersMut<'_> {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        &self.0.theta
    }
}

impl DerefMut for ParametersMut<'_> {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.0.theta
    }
}

impl Drop for ParametersMut<'_> {
    fn drop(&mut self) {
        self.0.apply_reshapes();
        self.0.changed();
    }
}
