//! One step, taken backwards: from cotangents of the next state to those of the state, the input and every parameter.
//!
//! The step solves `r(w; q, v, u, theta) = 0` for the next velocities `w` of all coordinates that are free. With the
//! cotangent `w'` of the solution, `H lambda = w'` on those coordinates, and then everything follows from the one scalar
//! `L = -lambda . r`: its derivative by anything is the loss's (implicit function theorem; Griewank and Walther 2008, chapter
//! 15). `H` is symmetric, and its factor is what the step left.
//!
//! A coordinate at a limit moves with `w = (limit - q) / h`; it passes on `w' - H_held,free lambda` to its position. One that
//! dry friction holds passes on nothing.
//!
//! The smooth rigid part of `r` is `h ID(q, v, a)` with `a = (w - v) / h`, so what is left is the reverse of recursive
//! Newton-Euler, `algorithms::adjoint`.
//!
//! A base that gives way is one more row: `r_b = D rate+ - free + p . w`, with a multiplier `mu` of its own. Eliminated, it leaves
//! `H - p p^T / D` and `w' - p rate+' / D` on the joints, and `mu = (rate+' - p . lambda) / D`. Its rigid part is the force
//! `h d . sum F` of all that it carries, without gravity: one more sweep, with the virtual velocity `-h mu d` under what it carries
//! and no multipliers on the joints. In the joints' own sweep what it carries is accelerated with `d (rate+ - rate) / h`.
//!
//! A step with Coriolis forces half way, or with a learned residual, is solved twice; it is taken back the same way: the
//! second solve first, whose dependence on the first one's `w~` is the cotangent that the first one starts from.

use nalgebra::{Matrix3, Vector3};
use sagci_model::JointKind;

use crate::complementarity::{Held, Problem};
use crate::contact::Contacts;
use crate::contact::derivative::Seed;
use crate::contact::solver::ContactWorkspace;
use crate::joint::matrix;
use crate::linear::{cholesky, cholesky_solve, eliminate, tree_solve};
use crate::parameter::left_jacobian;
use crate::placed::{BaseMotion, Cotangents, SwayPlace, Taken};
use crate::residual::{ResidualCotangents, ResidualWorkspace};
use crate::spatial::{angular, join, linear};
use crate::step::RECOVERY_STEPS;
use crate::workspace::Lane;
use crate::{
    Adjoint, Coriolis, DynamicsError, ExternalWrench, Multibody, RigidGradient, SpatialVector, State, StepWorkspace, System, Workspace,
    cross_force,
};

/// Cotangents of a state: what a loss changes by, per change of each entry.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StateCotangent {
    /// By the tangent of the positions (nv entries).
    pub q: Vec<f64>,
    /// By the velocities.
    pub v: Vec<f64>,
    /// By the inner states of effects.
    pub z: Vec<f64>,
}

impl StateCotangent {
    /// Zero, for a system.
    pub fn zero(system: &System) -> Self {
        let n = system.multibody().nv();
        Self { q: vec![0.0; n], v: vec![0.0; n], z: system.state().z }
    }

    pub(crate) fn clear(&mut self) {
        for part in [&mut self.q, &mut self.v, &mut self.z] {
            part.fill(0.0);
        }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        for (to, from) in [(&mut self.q, &other.q), (&mut self.v, &other.v), (&mut self.z, &other.z)] {
            for (a, b) in to.iter_mut().zip(from) {
                *a += b;
            }
        }
    }
}

/// Cotangents of all parameters in the coordinates in which the dynamics is written.
/// [`crate::ParameterVector::gradient`] takes them to named entries.
#[derive(Debug, Clone, PartialEq)]
pub struct NaturalGradient {
    /// By inertias, joint origins and axes, armatures, gravity.
    pub rigid: RigidGradient,
    /// By the parameters of effects, as [`System::parameters`].
    pub theta: Vec<f64>,
    /// By the weights of the residual.
    pub weights: Vec<f64>,
    /// By friction, stiffness and dissipation of each shape's surface.
    pub material: Vec<[f64; 3]>,
    /// By a twist of each shape on its link, in the shape's own frame at its origin.
    pub shape: Vec<SpatialVector>,
}

impl NaturalGradient {
    /// Zero, for a system.
    pub fn zero(system: &System) -> Self {
        Self {
            rigid: RigidGradient::new(system.multibody()),
            theta: vec![0.0; system.parameters().len()],
            weights: vec![0.0; system.residual().map_or(0, |r| r.network().weights().len())],
            material: vec![[0.0; 3]; system.contacts.as_ref().map_or(0, |c| c.geometries.len())],
            shape: vec![SpatialVector::zeros(); system.contacts.as_ref().map_or(0, |c| c.geometries.len())],
        }
    }
}

/// One solve of a step as it was left: what its reverse needs.
#[derive(Debug, Clone)]
pub(crate) struct Solve {
    pub w: Vec<f64>,
    pub held: Vec<Held>,
    /// [`crate::linear::tree_factor`] on the free coordinates.
    pub factor: Vec<Lane>,
}

impl Solve {
    pub fn new(n: usize) -> Self {
        Self { w: vec![0.0; n], held: vec![Held::Free; n], factor: vec![[0.0; 4]; n * n.div_ceil(4)] }
    }

    pub fn keep(&mut self, problem: &Problem) {
        self.w.copy_from_slice(&problem.v);
        self.held.copy_from_slice(&problem.held);
        let m = problem.free.len() * problem.free.len().div_ceil(4);
        self.factor[..m].copy_from_slice(&problem.factor[..m]);
    }

    fn copy(&mut self, other: &Self) {
        self.w.copy_from_slice(&other.w);
        self.held.copy_from_slice(&other.held);
        self.factor.copy_from_slice(&other.factor);
    }
}

/// One step as it was taken: where it started, and its solves.
#[derive(Debug, Clone)]
pub(crate) struct Record {
    pub state: State,
    load: Vec<f64>,
    /// Inputs that reached the joints, and what came into each change of the command.
    tau: Vec<f64>,
    seen: Vec<f64>,
    /// The mass matrix, where the solver's last factor is only near the one at the solution: with contacts, and with forces that
    /// are no linear function of `w`.
    M: Vec<f64>,
    first: Solve,
    /// Used where the step is solved twice.
    second: Solve,
}

impl Record {
    pub fn new(system: &System) -> Self {
        let n = system.multibody().nv();
        let second = if system.solves_twice() { n } else { 0 };
        let square = if system.factors_again() { n * n } else { 0 };
        let (load, tau, seen) = (vec![0.0; n], vec![0.0; n], vec![0.0; system.placements().len()]);
        Self { state: system.state(), load, tau, seen, M: vec![0.0; square], first: Solve::new(n), second: Solve::new(second) }
    }

    /// Bytes that one record takes.
    pub fn bytes(system: &System) -> usize {
        let (n, state) = (system.multibody().nv(), system.state());
        let solves = if system.solves_twice() { 2 } else { 1 };
        let squares = solves * 4 * n * n.div_ceil(4) + usize::from(system.factors_again()) * n * n;
        let numbers = state.q.len() + state.v.len() + state.z.len() + system.placements().len() + 2 * n + solves * n + squares;
        std::mem::size_of::<Self>() + 8 * numbers + solves * n * std::mem::size_of::<Held>()
    }

    /// Keeps where the step starts.
    pub fn begin(&mut self, state: &State) {
        copy_state(&mut self.state, state);
    }

    fn taken<'a>(&'a self, next: &'a [f64], dt: f64) -> Taken<'a> {
        Taken { state: &self.state, next, tau: &self.tau, seen: &self.seen, load: &self.load, dt }
    }

    /// Keeps how the step was solved.
    pub fn end(&mut self, system: &System, ws: &StepWorkspace) {
        self.load.copy_from_slice(&ws.load);
        self.tau.copy_from_slice(&ws.tau);
        self.seen.copy_from_slice(&ws.seen);
        if !self.M.is_empty() {
            self.M.copy_from_slice(ws.rigid.M.as_slice());
        }
        if system.solves_twice() {
            self.first.copy(&ws.first);
            self.second.keep(&ws.problem);
        } else {
            self.first.keep(&ws.problem);
        }
    }
}

pub(crate) fn copy_state(to: &mut State, from: &State) {
    to.q.copy_from_slice(&from.q);
    to.v.copy_from_slice(&from.v);
    to.z.copy_from_slice(&from.z);
    to.time = from.time;
}

/// Everything that changes in a reverse step. Made once.
#[derive(Debug, Clone)]
pub(crate) struct ReverseWorkspace {
    rigid: Workspace,
    pub adjoint: Adjoint,
    residual: Option<ResidualWorkspace>,
    contact: Option<Box<ContactWorkspace>>,
    seeds: Vec<Seed>,
    factor: Vec<f64>,
    pub material: Vec<[f64; 3]>,
    pub shape: Vec<SpatialVector>,
    /// Take gradients by parameters of the rigid bodies; by those of effects and residual.
    pub wanted: Wanted,
    pub theta: Vec<f64>,
    pub weights: Vec<f64>,
    w: Vec<f64>,
    first: Vec<f64>,
    lambda: Vec<f64>,
    rhs: Vec<f64>,
    a: Vec<f64>,
    load_bar: Vec<f64>,
    tau_bar: Vec<f64>,
    spare: Vec<f64>,
    next: StateCotangent,
    /// Bases that give way, and `w'` as they leave it.
    bases: Vec<BaseMotion>,
    condensed: Vec<f64>,
}

/// Which groups of parameters a reverse pass works for; each that is left out saves its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// Inertias, axes, origins, armatures.
    pub rigid: bool,
    /// Weights of the residual.
    pub weights: bool,
}

impl Wanted {
    /// Everything.
    pub const ALL: Self = Self { rigid: true, weights: true };
    /// State, inputs and effects alone.
    pub const LEAST: Self = Self { rigid: false, weights: false };
}

impl ReverseWorkspace {
    pub fn new(system: &System) -> Self {
        let multibody = system.multibody();
        let n = multibody.nv();
        let natural = NaturalGradient::zero(system);
        Self {
            rigid: multibody.workspace(),
            adjoint: Adjoint::new(multibody),
            residual: system.residual.as_ref().map(|r| r.workspace(n)),
            contact: system.contacts.as_ref().map(|c| Box::new(ContactWorkspace::new(c, n))),
            seeds: vec![Seed::default(); multibody.bodies.len()],
            factor: vec![0.0; 2 * n * n],
            material: natural.material,
            shape: natural.shape,
            wanted: Wanted::ALL,
            theta: natural.theta,
            weights: natural.weights,
            w: vec![0.0; n],
            first: vec![0.0; n],
            lambda: vec![0.0; n],
            rhs: vec![0.0; n],
            a: vec![0.0; n],
            load_bar: vec![0.0; n],
            tau_bar: vec![0.0; n],
            spare: vec![0.0; n],
            next: StateCotangent::zero(system),
            bases: system.sways.iter().map(|_| BaseMotion::new(n)).collect(),
            condensed: vec![0.0; n],
        }
    }

    /// Forgets the gradients by parameters.
    pub fn clear(&mut self) {
        self.adjoint.clear();
        self.theta.fill(0.0);
        self.weights.fill(0.0);
        self.material.fill([0.0; 3]);
        self.shape.fill(SpatialVector::zeros());
    }
}

/// The input of a step, and where its cotangents are added.
pub(crate) struct InputCotangent<'a> {
    pub external: &'a [ExternalWrench],
    pub tau_bar: &'a mut [f64],
    pub external_bar: &'a mut [SpatialVector],
}

impl System {
    /// A step is solved twice: the second time with what depends on the first solution.
    pub(crate) fn solves_twice(&self) -> bool {
        self.half_way() || self.residual.is_some()
    }

    /// Are there Coriolis forces, and taken half way to the next velocity?
    pub(crate) fn half_way(&self) -> bool {
        self.coriolis == Coriolis::AtMidpoint && !self.multibody().is_pendulum()
    }

    /// The factor that a step leaves is not quite the one at its solution.
    fn factors_again(&self) -> bool {
        self.contacts.is_some() || self.nonlinear
    }

    /// Adds to the gradient by effects that change the rigid bodies what the gradient by those gives.
    pub(crate) fn reshapes_back(&self, natural: &mut NaturalGradient) {
        let multibody = self.multibody();
        for (placed, change) in self.reshapes() {
            let Some(mount) = multibody
                .mounts
                .iter()
                .position(|m| m.kind != JointKind::Fixed && multibody.bodies[m.body].v == placed.v && !multibody.bodies[m.body].follows)
            else {
                continue;
            };
            let (by_axis, by_origin) = (natural.rigid.axis[mount], natural.rigid.origin[mount]);
            let (axis, turn) = (multibody.bodies[multibody.mounts[mount].body].motion.axis, change.turn());
            for (k, theta) in natural.theta[placed.theta.clone()].iter_mut().enumerate() {
                *theta += natural.rigid.armature[placed.v] * change.armature.d_theta[k];
                let child = multibody.mounts[mount].child;
                *theta += natural.rigid.inertia[child].iter().zip(&change.inertia).map(|(g, p)| g * p.d_theta[k]).sum::<f64>();
                let [dr, dp] = [&change.turn, &change.shift].map(|x| Vector3::new(x[0].d_theta[k], x[1].d_theta[k], x[2].d_theta[k]));
                *theta += by_axis.dot(&left_jacobian(&turn, &dr).cross(&axis)) + linear(&by_origin).dot(&dp);
            }
        }
    }

    /// Takes one step back: `bar` is the cotangent of the next state, and becomes that of the state before. Adds to the
    /// cotangents of the input, and in the workspace to those of the parameters.
    pub(crate) fn reverse_step(
        &self,
        ws: &mut ReverseWorkspace,
        record: &Record,
        dt: f64,
        bar: &mut StateCotangent,
        input: &mut InputCotangent<'_>,
    ) -> Result<(), DynamicsError> {
        let multibody = self.multibody();
        let state = &record.state;
        ws.rigid.q.copy_from_slice(&state.q);
        ws.rigid.v.copy_from_slice(&state.v);
        multibody.kinematics(&mut ws.rigid);
        multibody.gather_external(&mut ws.rigid, input.external)?;
        if let (Some(contacts), Some(contact)) = (&self.contacts, &mut ws.contact) {
            contact.find(contacts, multibody, &ws.rigid, dt);
        }
        if !self.sways.is_empty() {
            multibody.newton_euler(&mut ws.rigid, None, true, &mut ws.spare);
            multibody.composite(&mut ws.rigid);
            self.gather_bases(&ws.rigid, &mut ws.bases);
        }
        ws.load_bar.fill(0.0);
        std::mem::swap(&mut ws.next, bar);
        bar.clear();
        let twice = self.solves_twice();
        let last = if twice { &record.second } else { &record.first };
        ws.w.copy_from_slice(&ws.next.v);
        ws.tau_bar.fill(0.0);
        let taken = record.taken(&last.w, dt);
        self.advance_back(
            &taken,
            &ws.next.z,
            &mut Cotangents {
                q: &mut bar.q,
                v: &mut bar.v,
                next: &mut ws.w,
                z: &mut bar.z,
                tau: &mut ws.tau_bar,
                load: &mut ws.load_bar,
                theta: &mut ws.theta,
            },
        );
        multibody.pull_integrate(&last.w, dt, &ws.next.q, &mut bar.q, &mut ws.w);
        if twice {
            ws.first.fill(0.0);
            self.reverse_solve(ws, record, false, dt, bar, input);
            std::mem::swap(&mut ws.w, &mut ws.first);
            if let (Some(placed), Some(residual)) = (&self.residual, &mut ws.residual) {
                placed.force(residual, &state.q, &state.v, &record.tau, &record.first.w, dt);
                for (f, lambda) in ws.rhs.iter_mut().zip(&ws.lambda) {
                    *f = dt * lambda;
                }
                let weights = ws.wanted.weights.then_some(&mut ws.weights[..]);
                let mut into = ResidualCotangents { q: &mut bar.q, v: &mut bar.v, u: &mut ws.tau_bar, next: &mut ws.w, weights };
                placed.pull(residual, &state.q, dt, &ws.rhs, &mut into);
            }
        }
        self.reverse_solve(ws, record, true, dt, bar, input);
        self.drive_back(
            &taken,
            &ws.next.z,
            &mut Cotangents {
                q: &mut bar.q,
                v: &mut bar.v,
                next: &mut ws.spare,
                z: &mut bar.z,
                tau: &mut ws.tau_bar,
                load: &mut ws.load_bar,
                theta: &mut ws.theta,
            },
        );
        for (to, from) in input.tau_bar.iter_mut().zip(&ws.tau_bar) {
            *to += from;
        }
        if ws.load_bar.iter().any(|l| *l != 0.0) {
            // load = -ID(q, v, 0)
            ws.a.fill(0.0);
            for (to, load) in ws.rhs.iter_mut().zip(&ws.load_bar) {
                *to = -load;
            }
            multibody.sweep_back(&mut ws.rigid, &ws.rhs, &ws.a, ws.wanted.rigid, &mut ws.adjoint);
            self.hand_on_external(&ws.adjoint, input);
            for k in 0..multibody.nv() {
                bar.q[k] += ws.adjoint.q[k];
                bar.v[k] += ws.adjoint.v[k];
            }
        }
        Ok(())
    }

    /// The sweep's scalar has `-W . F_ext` in it.
    fn hand_on_external(&self, adjoint: &Adjoint, input: &mut InputCotangent<'_>) {
        for (bar, wrench) in input.external_bar.iter_mut().zip(input.external) {
            *bar -= adjoint.W[self.multibody().frames[wrench.link.0].body];
        }
    }

    /// Takes one of the step's solves back, from the cotangent `ws.w` of its solution.
    fn reverse_solve(
        &self,
        ws: &mut ReverseWorkspace,
        record: &Record,
        first: bool,
        dt: f64,
        bar: &mut StateCotangent,
        input: &mut InputCotangent<'_>,
    ) {
        let (multibody, state) = (self.multibody(), &record.state);
        let n = multibody.nv();
        let solve = if first { &record.first } else { &record.second };
        // The next rate of a base, and half of its next displacement, are read from the last solve.
        let last = !first || !self.solves_twice();
        ws.condensed.copy_from_slice(&ws.w);
        for (place, base) in self.sways.iter().zip(&ws.bases) {
            let Some(motion) = self.base_step(place, base, state, dt) else { continue };
            let share = self.rate_bar(place, &ws.next, dt, last) / motion.inertia;
            for (w, p) in ws.condensed.iter_mut().zip(&base.momentum) {
                *w -= share * p;
            }
        }
        if ws.w.iter().all(|w| *w == 0.0) && (self.sways.is_empty() || !last) {
            return;
        }
        let touching = match (&self.contacts, &mut ws.contact) {
            (Some(contacts), Some(contact)) if !contact.active.is_empty() => {
                contact.rates(contacts, &solve.w);
                contact.differentiate();
                true
            }
            _ => false,
        };
        if touching || self.nonlinear {
            let contacts = if touching { self.contacts.as_deref().zip(ws.contact.as_deref()) } else { None };
            let taken = record.taken(&solve.w, dt);
            self.solve_transposed(contacts, record, &taken, &solve.held, &ws.condensed, &ws.bases, &mut ws.factor, &mut ws.rhs);
            spread(&solve.held, &ws.rhs, &mut ws.lambda);
        } else {
            let m = gather(&solve.held, &ws.condensed, &mut ws.rhs);
            tree_solve(&solve.factor, &mut ws.rhs[..m]);
            spread(&solve.held, &ws.rhs, &mut ws.lambda);
        }
        if touching {
            self.reverse_contacts(ws, &solve.w, &state.v);
        }
        self.reverse_effects(ws, record, solve, dt, bar);
        // The rigid part: sigma . ID(q, v, a) with sigma = -h lambda.
        let midpoint = !first && self.half_way();
        if midpoint {
            for (k, v) in ws.rigid.v.iter_mut().enumerate() {
                *v = 0.5 * (state.v[k] + record.first.w[k]);
            }
            multibody.velocities(&mut ws.rigid);
        }
        for k in 0..n {
            ws.a[k] = (solve.w[k] - state.v[k]) / dt;
            ws.rhs[k] = -dt * ws.lambda[k];
        }
        if self.sways.is_empty() {
            multibody.sweep_back(&mut ws.rigid, &ws.rhs, &ws.a, ws.wanted.rigid, &mut ws.adjoint);
        } else {
            ws.rigid.bases.fill([SpatialVector::zeros(); 2]);
            for (place, base) in self.sways.iter().zip(&ws.bases) {
                let Some(motion) = self.base_step(place, base, state, dt) else { continue };
                let acceleration = motion.direction * ((motion.next_rate(base, &solve.w) - motion.rate) / dt);
                place.move_base(&mut ws.rigid, multibody, &acceleration, &Vector3::zeros());
            }
            multibody.sweep_back_on::<true>(&mut ws.rigid, &ws.rhs, &ws.a, ws.wanted.rigid, &mut ws.adjoint);
        }
        self.hand_on_external(&ws.adjoint, input);
        for k in 0..n {
            let of_a = ws.adjoint.a[k] / dt;
            bar.q[k] += ws.adjoint.q[k];
            bar.v[k] -= of_a;
            if touching {
                bar.v[k] += ws.adjoint.channels[OLD].by_rates[k];
            }
            ws.tau_bar[k] += dt * ws.lambda[k];
            if midpoint {
                bar.v[k] += 0.5 * ws.adjoint.v[k];
                ws.first[k] += 0.5 * ws.adjoint.v[k];
            } else {
                bar.v[k] += ws.adjoint.v[k];
            }
            if solve.held[k] == Held::AtLimit {
                // of_a = -(M lambda)_k, and contacts give what their part of H does, so the sum is w' - H_held,free lambda.
                let of_contacts = if touching { ws.adjoint.channels[NEXT].by_rates[k] } else { 0.0 };
                bar.q[k] -= (ws.w[k] + of_a + of_contacts) / (dt * self.wall_steps(k, state, solve.w[k]));
            }
        }
        if midpoint {
            ws.rigid.v.copy_from_slice(&state.v);
            multibody.velocities(&mut ws.rigid);
        }
        self.reverse_bases(ws, solve, state, last, dt, bar, input);
    }

    /// The cotangent of the next rate of a base.
    fn rate_bar(&self, place: &SwayPlace, next: &StateCotangent, dt: f64, last: bool) -> f64 {
        let z = self.placements()[place.placement].z.start;
        if last { next.z[z + 1] + 0.5 * dt * next.z[z] } else { 0.0 }
    }

    /// What the bases that give way make of `lambda`, with their own multipliers. At the velocities of the state.
    #[allow(clippy::too_many_arguments)]
    fn reverse_bases(
        &self,
        ws: &mut ReverseWorkspace,
        solve: &Solve,
        state: &State,
        last: bool,
        dt: f64,
        bar: &mut StateCotangent,
        input: &mut InputCotangent<'_>,
    ) {
        let multibody = self.multibody();
        for (i, place) in self.sways.iter().enumerate() {
            let base = &ws.bases[i];
            let Some(motion) = self.base_step(place, base, state, dt) else { continue };
            let placed = &self.placements()[place.placement];
            let Some(sway) = placed.effect.sway(self.theta_of(placed)) else { continue };
            let along: f64 = base.momentum.iter().zip(&ws.lambda).map(|(p, l)| p * l).sum();
            let mu = (self.rate_bar(place, &ws.next, dt, last) - along) / motion.inertia;
            let rate = motion.next_rate(base, &solve.w);
            let (sum, change) = (rate + motion.rate, rate - motion.rate);
            let z = placed.z.start;
            if last {
                bar.z[z] += ws.next.z[z];
                bar.z[z + 1] += 0.5 * dt * ws.next.z[z];
            }
            bar.z[z] -= mu * dt * motion.stiffness;
            bar.z[z + 1] += along + mu * motion.inward;
            for (k, theta) in ws.theta[placed.theta.clone()].iter_mut().enumerate() {
                let held = 0.25 * dt * dt * sway.stiffness.d_theta[k] + 0.5 * dt * sway.damping.d_theta[k];
                let by_force = dt * state.z[z] * sway.stiffness.d_theta[k];
                *theta -= mu * (change * sway.mass.d_theta[k] + sum * held + by_force);
            }
            // Gravity does not drive the base: it is taken off what it carries.
            let acceleration = motion.direction * (change / dt) + multibody.gravity;
            ws.rigid.bases.fill([SpatialVector::zeros(); 2]);
            place.move_base(&mut ws.rigid, multibody, &acceleration, &(motion.direction * (-dt * mu)));
            ws.spare.fill(0.0);
            let gravity = ws.adjoint.gravity;
            multibody.sweep_back_on::<true>(&mut ws.rigid, &ws.spare, &ws.a, ws.wanted.rigid, &mut ws.adjoint);
            ws.adjoint.gravity = gravity;
            self.hand_on_external(&ws.adjoint, input);
            for k in 0..multibody.nv() {
                let of_a = ws.adjoint.a[k] / dt;
                bar.q[k] += ws.adjoint.q[k];
                bar.v[k] += ws.adjoint.v[k] - of_a;
                if solve.held[k] == Held::AtLimit {
                    bar.q[k] -= of_a / (dt * self.wall_steps(k, state, solve.w[k]));
                }
            }
        }
    }

    /// What the effects of a solve make of `lambda`: cotangents of state, input, load and their parameters.
    fn reverse_effects(&self, ws: &mut ReverseWorkspace, record: &Record, solve: &Solve, dt: f64, bar: &mut StateCotangent) {
        let taken = record.taken(&solve.w, dt);
        // How the forces answer to `w` is in `H`.
        ws.spare.fill(0.0);
        let mut into = Cotangents {
            q: &mut bar.q,
            v: &mut bar.v,
            next: &mut ws.spare,
            z: &mut bar.z,
            tau: &mut ws.tau_bar,
            load: &mut ws.load_bar,
            theta: &mut ws.theta,
        };
        self.resist_back(&taken, &ws.lambda, &mut into);
    }

    /// Over how many steps a limit takes its coordinate to itself.
    pub(crate) fn wall_steps(&self, k: usize, state: &State, w: f64) -> f64 {
        let Some(joint) = self.multibody().joints().iter().find(|j| j.v.start == k) else { return 1.0 };
        let (q, [lower, upper]) = (state.q[joint.q.start], self.walls[k]);
        if (q < lower && w > 0.0) || (q > upper && w < 0.0) { RECOVERY_STEPS } else { 1.0 }
    }
}

/// The free entries of `w`, and how many there are.
fn gather(held: &[Held], w: &[f64], out: &mut [f64]) -> usize {
    let mut m = 0;
    for (w, _) in w.iter().zip(held).filter(|(_, h)| **h == Held::Free) {
        out[m] = *w;
        m += 1;
    }
    m
}

/// The inverse of [`gather`]; zero where a coordinate is held.
fn spread(held: &[Held], x: &[f64], out: &mut [f64]) {
    let mut m = 0;
    for (out, held) in out.iter_mut().zip(held) {
        *out = 0.0;
        if *held == Held::Free {
            *out = x[m];
            m += 1;
        }
    }
}

/// Which of the sweep's channels carries which rates.
const NEXT: usize = 0;
const OLD: usize = 1;
const MULTIPLIER: usize = 2;

impl System {
    /// Solves `H x = w'` on the free coordinates, with `H` as it is at the solution; `x` comes out in `rhs`.
    #[allow(clippy::too_many_arguments)]
    fn solve_transposed(
        &self,
        contacts: Option<(&Contacts, &ContactWorkspace)>,
        record: &Record,
        taken: &Taken<'_>,
        held: &[Held],
        w: &[f64],
        bases: &[BaseMotion],
        H: &mut [f64],
        rhs: &mut [f64],
    ) {
        let n = w.len();
        H[..n * n].copy_from_slice(&record.M);
        for placed in self.placements() {
            H[placed.v * n + placed.v] += taken.dt * self.resistance(placed, taken).d_next;
        }
        for (place, base) in self.sways.iter().zip(bases) {
            let Some(motion) = self.base_step(place, base, taken.state, taken.dt) else { continue };
            for (i, p) in base.momentum.iter().enumerate() {
                for (j, other) in base.momentum.iter().enumerate() {
                    H[i * n + j] -= p * other / motion.inertia;
                }
            }
        }
        if let Some((contacts, contact)) = contacts {
            for (active, wrench) in contact.active.iter().zip(&contact.by_active) {
                let group = &contacts.groups[active.group];
                let J = &contact.J[group.start..group.start + group.columns.len()];
                for (Jj, cj) in J.iter().zip(&group.columns) {
                    let column = wrench.by_V * Jj;
                    for (Ji, ci) in J.iter().zip(&group.columns) {
                        H[ci.v * n + cj.v] -= Ji.dot(&column);
                    }
                }
            }
        }
        let mut at = 0;
        for i in (0..n).filter(|i| held[*i] == Held::Free) {
            for j in (0..n).filter(|j| held[*j] == Held::Free) {
                H[at] = H[i * n + j];
                at += 1;
            }
        }
        let m = gather(held, w, rhs);
        // Forces that fall with the velocity can make it indefinite; then it is eliminated with pivots, from its copy behind.
        H.copy_within(..m * m, n * n);
        let (factor, whole) = H.split_at_mut(n * n);
        if cholesky(&mut factor[..m * m], m).is_ok() {
            cholesky_solve(factor, m, &mut rhs[..m]);
        } else {
            eliminate(&mut whole[..m * m], m, &mut rhs[..m], 1);
        }
    }

    /// Hands what contacts make of `lambda` to the next sweep, and takes their parameters' share.
    fn reverse_contacts(&self, ws: &mut ReverseWorkspace, w: &[f64], v: &[f64]) {
        let (Some(contacts), Some(contact)) = (&self.contacts, &ws.contact) else { return };
        ws.seeds.fill(Seed::default());
        contact.reverse(contacts, &ws.lambda, &mut ws.seeds);
        let zero = SpatialVector::zeros();
        for (rates, channel) in [w, v, &ws.lambda].into_iter().zip(&mut ws.adjoint.channels) {
            channel.rates.copy_from_slice(rates);
        }
        for (body, seed) in ws.seeds.iter().enumerate() {
            ws.adjoint.seed_body(body, &seed.pose, &zero);
            ws.adjoint.channels[NEXT].seed[body] = seed.next;
            ws.adjoint.channels[OLD].seed[body] = seed.old;
            ws.adjoint.channels[MULTIPLIER].seed[body] = seed.multiplier;
        }
        if !ws.wanted.rigid {
            return;
        }
        let multibody = self.multibody();
        let (rigid, link_pose, material, shape) = (&ws.rigid, &mut ws.adjoint.link_pose, &mut ws.material, &mut ws.shape);
        // A spatial force in the world, in the frame at the pose (R, p) on a body.
        let inside = |body: usize, R: &Matrix3<f64>, p: &Vector3<f64>, F: &SpatialVector| {
            let (R_W, p_W) = (rigid.R_WB[body] * R, rigid.p_WB[body] + rigid.R_WB[body] * p);
            join(&R_W.tr_mul(&(angular(F) - p_W.cross(&linear(F)))), &R_W.tr_mul(&linear(F)))
        };
        let mut on_link = |frame: Option<usize>, F: &SpatialVector| {
            if let Some(f) = frame {
                let X = &multibody.frames[f].X_BL;
                link_pose[f] += inside(multibody.frames[f].body, &matrix(&X.rotation), &X.translation.vector, F);
            }
        };
        contact.reverse_parameters(contacts, &ws.lambda, |pair, by, of_a, of_b| {
            let pair = &contacts.pairs[pair];
            for (one, other, F) in [(pair.a, pair.b, of_a), (pair.b, pair.a, of_b)] {
                let (g, h) = (&contacts.geometries[one], &contacts.geometries[other]);
                on_link(g.frame, &F);
                shape[one] += inside(g.body, &g.R_BG, &g.p_BG, &F);
                // Rows of the law: stiffness, dissipation, friction.
                let slope = g.material.between_by_self(&h.material);
                let [friction, stiffness, dissipation] = by;
                let of_self = slope.tr_mul(&Vector3::new(stiffness, dissipation, friction));
                material[one][0] += of_self[2];
                material[one][1] += of_self[0];
                material[one][2] += of_self[1];
            }
        });
        for (bushing, grasp) in contact.bushings.iter().zip(&contacts.grasps) {
            let active = &contact.active[bushing.slot];
            let multiplier = contact.relative(contacts, active.group, &ws.lambda);
            let F = bushing.held.impulse(&active.V);
            let next = -(bushing.held.slope(&active.V).transpose() * multiplier);
            let of_a = bushing.held.by_pose(&active.V).transpose() * multiplier;
            let of_b = -cross_force(&multiplier, &F) - cross_force(&active.V, &next) - of_a;
            on_link(Some(grasp.a.0), &of_a);
            on_link(Some(grasp.b.0), &of_b);
        }
    }
}

impl Multibody {
    /// Adds what `q+ = q (+) h w` makes of the cotangent `next` of `q+`: to that of `q`, and of `w`.
    ///
    /// For a group, `q+ = q exp(h w)`: `dq+ = Ad(exp(-h w)) dq + h J_r(h w) dw`, both series in `ad(h w)`, whose transpose is
    /// `-(h w) x*`.
    pub(crate) fn pull_integrate(&self, w: &[f64], dt: f64, next: &[f64], q_bar: &mut [f64], w_bar: &mut [f64]) {
        for body in self.bodies.iter().skip(1).filter(|b| !b.follows) {
            let at = body.v;
            match body.motion.kind {
                JointKind::Planar => {
                    let x = SpatialVector::new(0.0, 0.0, w[at + 2], w[at], w[at + 1], 0.0) * dt;
                    let y = SpatialVector::new(0.0, 0.0, next[at + 2], next[at], next[at + 1], 0.0);
                    let (adjoint, jacobian) = pull_exponential(&x, y);
                    for (k, from) in [3, 4, 2].into_iter().enumerate() {
                        q_bar[at + k] += adjoint[from];
                        w_bar[at + k] += dt * jacobian[from];
                    }
                }
                JointKind::Floating => {
                    let x = SpatialVector::from_column_slice(&w[at..at + 6]) * dt;
                    let (adjoint, jacobian) = pull_exponential(&x, SpatialVector::from_column_slice(&next[at..at + 6]));
                    for k in 0..6 {
                        q_bar[at + k] += adjoint[k];
                        w_bar[at + k] += dt * jacobian[k];
                    }
                }
                _ => {
                    for k in at..at + body.nv {
                        q_bar[k] += next[k];
                        w_bar[k] += dt * next[k];
                    }
                }
            }
        }
    }
}

/// `Ad(exp(-x))^T y` and `J_r(x)^T y`.
fn pull_exponential(x: &SpatialVector, y: SpatialVector) -> (SpatialVector, SpatialVector) {
    let (mut adjoint, mut jacobian, mut term) = (y, y, y);
    let size = y.amax();
    // Entire series; one turn in a step (|x| = 2 pi) needs some thirty terms.
    for n in 1..200 {
        term = cross_force(x, &term) / f64::from(n);
        adjoint += term;
        jacobian += term / f64::from(n + 1);
        if term.amax() <= 1e-18 * size {
            break;
        }
    }
    (adjoint, jacobian)
}
