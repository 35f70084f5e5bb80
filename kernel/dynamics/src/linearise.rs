//! A step's own derivatives: `dx+ = A dx + B du` with `x = (q, v, z)` and `u = tau`, exactly those of [`System::step`].
//!
//! The step solves `r(w) = 0` for the next velocities `w`. With `a = (w - v) / h` its smooth rigid part is `h ID(q, v, a)`, so
//!
//! `H dw = -(h dID/dq dq + (h dID/dv - M) dv - h du + h d(dtau) + contacts)`,  `H = M + h d(dtau)/dw + sum J^T G J of contacts`,
//!
//! on the coordinates that move, with the forces `dtau` of effects at the solution, where the step takes them. They answer to the
//! inner states too, to the efforts that the commands have become on their way to the joints, and to the load on the joint. What dry
//! friction holds stays at rest, and what stands at a limit goes where the limit says: there the derivative is that of the side on
//! which the step lies. So it is where contacts open, slip or change their corners. With Coriolis forces half way, `c((v + w0) / 2)`,
//! or a learned residual `f(w0)`, the same is done twice: once for the first solution `w0`, then with its change.
//!
//! A base that gives way is one more row `D drate + p . dw + dr_b = 0`, eliminated beforehand; its rigid part is the force of all that
//! it carries, along its direction, and has its derivatives by one reverse sweep.
//!
//! Positions follow on the joint's group: `q+ = q exp(h w)`, so `dq+ = Ad(exp(-h w)) dq + h J(h w) dw` with the right Jacobian
//! `J(x) = sum_k (-ad x)^k / (k + 1)!` (Sola, Deray and Atchuthan 2018, equation 143). Inner states follow by their own partials.

use std::ops::Range;

use nalgebra::{DMatrix, Matrix6, Vector3, Vector6};

use crate::algorithms::pendulum::Pendulum;
use crate::complementarity::Held;
use crate::effects::{Acts, Advance, HISTORY, Partial, Transfer};
use crate::joint::Motion;
use crate::linear::{before_among, eliminate, into_lanes, tree_factor, tree_solve_rows};
use crate::multibody::length;
use crate::placed::Taken;
use crate::residual::ResidualCotangents;
use crate::sensitivity::{Plan, Rows, Touching};
use crate::spatial::cross_motion;
use crate::system::Placement;
use crate::workspace::Lane;
use crate::{Adjoint, DynamicsError, Input, ParameterVector, SpatialVector, State, StepWorkspace, System};

/// Derivatives of one step. `x` is position (as a tangent, see [`crate::Multibody::integrate`]), then velocity, then the inner
/// states of effects: `2 nv + nz` entries. `u` are the commanded efforts.
///
/// The seconds that each entry of a history lasted are no variables; their rows are those of numbers that stay or are set.
#[derive(Debug, Clone)]
pub struct Linearisation {
    /// `dx+ / dx`, square.
    pub A: DMatrix<f64>,
    /// `dx+ / du`, (2 nv + nz) x nv.
    pub B: DMatrix<f64>,
    /// `dx+ / dtheta`, (2 nv + nz) x the number of parameters that it was made with.
    pub P: DMatrix<f64>,
    /// Right-hand sides and then `dw`, a row for each velocity: by q, by v, by z, by u, by theta.
    change: Vec<f64>,
    /// The same for the first solution.
    first: Vec<f64>,
    /// How the efforts that reach the joints change, likewise; empty where commands reach them as they are.
    reached: Vec<f64>,
    /// How the loads on the joints change, likewise, once something asks for it.
    load: Vec<f64>,
    has_load: bool,
    /// One row more.
    row: Vec<f64>,
    /// What the residual's reverse mode writes: by q, v, u and the first solution.
    pulled: Vec<f64>,
    free: Vec<usize>,
    /// What the free coordinates stand on, as [`tree_factor`] asks.
    before: Vec<usize>,
    factor: Vec<Lane>,
    packed: Vec<f64>,
    a: Vec<f64>,
    /// The Hessian.
    H: Vec<f64>,
    /// How the rows of bases that give way change, at fixed next velocities and rates.
    bases: Vec<f64>,
    sweep: Option<Box<Adjoint>>,
    zeros: Vec<f64>,
    plan: Plan,
    /// Instead of the rigid workspace, where that is enough.
    pendulum: Option<Pendulum>,
}

impl Linearisation {
    /// Zeros for a system, without parameters.
    pub fn new(system: &System) -> Self {
        Self::with_plan(system, Plan::default())
    }

    /// Zeros for a system, with a column of `P` for each of some parameters. Only these cost anything. Their values may be changed
    /// afterwards: derivatives are those at the system's present ones.
    ///
    /// # Errors
    /// Parameters of another system.
    pub fn with_parameters(system: &System, which: &ParameterVector) -> Result<Self, DynamicsError> {
        Ok(Self::with_plan(system, Plan::new(system, which)?))
    }

    fn with_plan(system: &System, plan: Plan) -> Self {
        let (n, nz, parameters) = (system.multibody().nv(), system.state().z.len(), plan.len());
        let width = Columns { n, nz, parameters }.width();
        let twice = if system.solves_twice() { n * width } else { 0 };
        Self {
            A: DMatrix::zeros(2 * n + nz, 2 * n + nz),
            B: DMatrix::zeros(2 * n + nz, n),
            P: DMatrix::zeros(2 * n + nz, parameters),
            change: vec![0.0; n * width],
            first: vec![0.0; twice],
            reached: vec![0.0; if system.commands.is_empty() { 0 } else { n * width }],
            load: vec![0.0; n * width],
            has_load: false,
            row: vec![0.0; width],
            pulled: vec![0.0; 5 * n],
            free: Vec::with_capacity(n),
            before: Vec::with_capacity(n),
            factor: vec![[0.0; 4]; n * n.div_ceil(4)],
            packed: vec![0.0; n * width],
            a: vec![0.0; n],
            H: vec![0.0; n * n],
            bases: vec![0.0; system.sways.len() * width],
            sweep: (!system.sways.is_empty()).then(|| Box::new(Adjoint::new(system.multibody()))),
            zeros: vec![0.0; n],
            plan,
            pendulum: None,
        }
    }
}

/// Where the columns by q, v, z, u and theta of a row stand.
#[derive(Debug, Clone, Copy)]
struct Columns {
    n: usize,
    nz: usize,
    parameters: usize,
}

impl Columns {
    fn z(self) -> usize {
        2 * self.n
    }

    fn u(self) -> usize {
        2 * self.n + self.nz
    }

    fn theta(self) -> usize {
        3 * self.n + self.nz
    }

    /// Whole lanes; what is left at the end of a row means nothing.
    fn width(self) -> usize {
        (self.theta() + self.parameters).next_multiple_of(4)
    }

    /// A row among rows.
    fn row(self, i: usize) -> Range<usize> {
        i * self.width()..(i + 1) * self.width()
    }
}

impl System {
    /// [`System::step`] from `state` into `next`, and its derivatives.
    ///
    /// # Errors
    /// As there; `next` or `linearisation` of another system.
    pub fn linearise(
        &self,
        ws: &mut StepWorkspace,
        state: &State,
        input: &Input<'_>,
        dt: f64,
        next: &mut State,
        linearisation: &mut Linearisation,
    ) -> Result<(), DynamicsError> {
        let multibody = self.multibody();
        let n = multibody.nv();
        self.check_state(state)?;
        self.check_state(next)?;
        let x = linearisation;
        let at = Columns { n, nz: state.z.len(), parameters: x.plan.len() };
        length("a linearisation's rows", x.A.nrows(), at.u())?;
        let twice = self.solves_twice();
        let rows = self.sways.len() * at.width();
        if (twice && x.first.is_empty()) || x.reached.is_empty() != self.commands.is_empty() || x.bases.len() != rows {
            return Err(DynamicsError::ForeignWorkspace);
        }
        x.plan.update(self)?;
        next.q.copy_from_slice(&state.q);
        next.v.copy_from_slice(&state.v);
        next.z.copy_from_slice(&state.z);
        next.time = state.time;
        self.step(ws, next, input, dt)?;
        x.has_load = false;
        x.pendulum = ws.pendulum.filter(|_| self.steps_as_pendulum(input) && self.sways.is_empty() && !x.plan.has_rigid());
        if x.pendulum.is_none() && self.steps_as_pendulum(input) {
            // The step had no need of it.
            multibody.set_state(&mut ws.rigid, &state.q, &state.v)?;
            multibody.gather_external(&mut ws.rigid, &[])?;
            multibody.forces(&mut ws.rigid, None, true);
            multibody.composite(&mut ws.rigid);
        }
        self.drive_change(ws, state, &next.v, dt, at, false, x);
        if twice {
            if x.pendulum.is_none() {
                ws.rigid.v.copy_from_slice(&state.v);
                multibody.velocities(&mut ws.rigid);
            }
            self.solve_change(ws, state, dt, at, true, x)?;
            std::mem::swap(&mut x.change, &mut x.first);
            if self.half_way() {
                for (mid, (v, w)) in ws.rigid.v.iter_mut().zip(state.v.iter().zip(&ws.first.w)) {
                    *mid = 0.5 * (v + w);
                }
                multibody.velocities(&mut ws.rigid);
            }
        }
        self.solve_change(ws, state, dt, at, false, x)?;
        self.write(&next.v, dt, at, x);
        self.advance_change(ws, state, &next.v, dt, at, x);
        Ok(())
    }

    /// `dw` of one solution of the step, at the velocities that the rigid workspace has.
    fn solve_change(
        &self,
        ws: &mut StepWorkspace,
        state: &State,
        dt: f64,
        at: Columns,
        first: bool,
        x: &mut Linearisation,
    ) -> Result<(), DynamicsError> {
        let multibody = self.multibody();
        let n = at.n;
        let w = if first { &ws.first.w } else { &ws.problem.v };
        for (a, (w, v)) in x.a.iter_mut().zip(w.iter().zip(&state.v)) {
            *a = (w - v) / dt;
        }
        self.rigid_change(ws, state, dt, first, x);
        let w = if first { &ws.first.w } else { &ws.problem.v };
        let touching = match (&self.contacts, &mut ws.contact) {
            (Some(contacts), Some(contact)) if !contact.active.is_empty() => {
                contact.rates(contacts, w);
                contact.differentiate();
                true
            }
            _ => false,
        };
        let midpoint = !first && self.half_way();
        let share = if midpoint { 0.5 * dt } else { dt };
        let variation = ws.rigid.variation.rows();
        let rows = x.change.chunks_exact_mut(at.width().max(1)).zip(variation).zip(ws.rigid.M.as_slice().chunks_exact(n.max(1)));
        for (i, ((row, variation), M)) in rows.enumerate() {
            let (by_q, by_v) = variation.split_at(n);
            let (to_q, rest) = row.split_at_mut(n);
            let (to_v, rest) = rest.split_at_mut(n);
            for (to, by_q) in to_q.iter_mut().zip(by_q) {
                *to = dt * by_q;
            }
            for (to, (by_v, m)) in to_v.iter_mut().zip(by_v.iter().zip(M)) {
                *to = share * by_v - m;
            }
            rest.fill(0.0);
            if x.reached.is_empty() {
                row[at.u() + i] = -dt;
            } else {
                add_row(row, -dt, &x.reached[at.row(i)]);
            }
            if midpoint {
                for (by_v, first) in by_v[..n].iter().zip(x.first.chunks_exact(at.width().max(1))) {
                    add_row(row, share * by_v, first);
                }
            }
        }
        if at.parameters > 0 {
            let touching = match (&self.contacts, &ws.contact) {
                (Some(contacts), Some(contact)) if touching => Some(Touching { contacts, at: contact, w, v: &state.v }),
                _ => None,
            };
            let mut rows = Rows { values: &mut x.change, width: at.width(), first: at.theta() };
            x.plan.add_rigid(multibody, &ws.rigid, &x.a, dt, !self.sways.is_empty(), touching, &mut rows);
        }
        if !first {
            self.residual_change(ws, state, dt, at, x);
        }
        x.H.copy_from_slice(ws.rigid.M.as_slice());
        self.base_change(ws, state, dt, at, first, x)?;
        for placed in self.placements() {
            let taken =
                Taken { state, next: if first { &ws.first.w } else { &ws.problem.v }, tau: &ws.tau, seen: &ws.seen, load: &ws.load, dt };
            let force = self.resistance(placed, &taken) * dt;
            if force.d_load != 0.0 {
                self.load_change(ws, state, at, x);
            }
            let k = placed.v;
            x.H[k * n + k] += force.d_next;
            let row = &mut x.change[at.row(k)];
            add_partial(row, placed, &force, at, &x.plan.theta);
            add_input(row, k, force.d_input, &x.reached, at);
            if force.d_load != 0.0 {
                add_row(row, force.d_load, &x.load[at.row(k)]);
            }
        }
        let (w, held): (&[f64], &[Held]) = if first { (&ws.first.w, &ws.first.held) } else { (&ws.problem.v, &ws.problem.held) };
        x.free.clear();
        x.free.extend((0..n).filter(|k| held[*k] == Held::Free));
        if touching || !self.sways.is_empty() {
            x.before.clear();
            x.before.extend(0..x.free.len());
        } else {
            before_among(&multibody.before, &x.free, &mut x.before);
        }
        if let (Some(contacts), Some(contact), true) = (&self.contacts, &mut ws.contact, touching) {
            let change = &mut x.change;
            contact.add_dense(contacts, w, &state.v, |i, k, [by_q, by_v, by_w]| {
                change[at.row(i)][k] += by_q;
                change[at.row(i)][n + k] += by_v;
                x.H[i * n + k] += by_w;
            });
        }
        // The step's own factor is that of `H` where nothing depends on where the solver stopped.
        let kept = if first { &ws.first.factor } else { &ws.problem.factor };
        let kept = (!touching && !self.nonlinear && self.sways.is_empty()).then_some(kept.as_slice());
        self.eliminate_change(w, held, kept, state, dt, at, x)
    }

    /// Derivatives of inverse dynamics at a solution, into the rigid workspace.
    fn rigid_change(&self, ws: &mut StepWorkspace, state: &State, dt: f64, first: bool, x: &Linearisation) {
        let multibody = self.multibody();
        if let Some(pendulum) = &x.pendulum {
            ws.rigid.variation.set_only(pendulum.gravity(state.q[0])[1]);
            return;
        }
        if self.solves_twice() || !self.sways.is_empty() {
            multibody.forces(&mut ws.rigid, Some(&x.a), true);
        } else {
            // The step's own pass is there still.
            multibody.accelerate(&mut ws.rigid, &x.a);
        }
        if self.sways.is_empty() {
            multibody.differentiate(&mut ws.rigid);
            return;
        }
        let w = if first { &ws.first.w } else { &ws.problem.v };
        ws.rigid.bases.fill([SpatialVector::zeros(); 2]);
        for (place, base) in self.sways.iter().zip(&ws.bases) {
            let Some(motion) = self.base_step(place, base, state, dt) else { continue };
            let acceleration = motion.direction * ((motion.next_rate(base, w) - motion.rate) / dt);
            place.move_base(&mut ws.rigid, multibody, &acceleration, &Vector3::zeros());
        }
        multibody.accelerate_bases(&mut ws.rigid);
        multibody.differentiate_on::<true>(&mut ws.rigid);
    }

    /// How the learned residual's force changes, in the second solution.
    fn residual_change(&self, ws: &mut StepWorkspace, state: &State, dt: f64, at: Columns, x: &mut Linearisation) {
        let (Some(placed), Some(residual)) = (&self.residual, &mut ws.residual) else { return };
        let n = at.n;
        placed.force(residual, &state.q, &state.v, &ws.tau, &ws.first.w, dt);
        for &i in placed.acts() {
            x.pulled.fill(0.0);
            let [f, q, v, u, next] = split(&mut x.pulled, n);
            f[i] = 1.0;
            x.plan.by_weights.fill(0.0);
            let weights = (!x.plan.by_weights.is_empty()).then_some(&mut x.plan.by_weights[..]);
            placed.pull(residual, &state.q, dt, f, &mut ResidualCotangents { q, v, u, next, weights });
            let row = &mut x.change[at.row(i)];
            for (column, weight) in &x.plan.weights {
                row[at.theta() + column] -= dt * x.plan.by_weights[*weight];
            }
            for k in 0..n {
                row[k] -= dt * x.pulled[n + k];
                row[n + k] -= dt * x.pulled[2 * n + k];
                add_input(row, k, -dt * x.pulled[3 * n + k], &x.reached, at);
                let by_next = x.pulled[4 * n + k];
                if by_next != 0.0 {
                    add_row(row, -dt * by_next, &x.first[at.row(k)]);
                }
            }
        }
    }

    /// How the bases that give way change, eliminated from the joints' rows. Leaves the rigid workspace at the velocities of the state.
    fn base_change(
        &self,
        ws: &mut StepWorkspace,
        state: &State,
        dt: f64,
        at: Columns,
        first: bool,
        x: &mut Linearisation,
    ) -> Result<(), DynamicsError> {
        let (multibody, n) = (self.multibody(), at.n);
        let Some(sweep) = &mut x.sweep else { return Ok(()) };
        ws.rigid.v.copy_from_slice(&state.v);
        multibody.velocities(&mut ws.rigid);
        for (i, (place, base)) in self.sways.iter().zip(&ws.bases).enumerate() {
            let Some(motion) = self.base_step(place, base, state, dt) else { continue };
            let w = if first { &ws.first.w } else { &ws.problem.v };
            let d = motion.direction;
            // The force `d . sum F` of all that it carries, without gravity.
            let acceleration = d * ((motion.next_rate(base, w) - motion.rate) / dt) + multibody.gravity;
            ws.rigid.bases.fill([SpatialVector::zeros(); 2]);
            place.move_base(&mut ws.rigid, multibody, &acceleration, &d);
            let parameters = x.plan.has_rigid();
            sweep.clear();
            multibody.sweep_back_on::<true>(&mut ws.rigid, &x.zeros, &x.a, parameters, sweep);
            let row = &mut x.bases[at.row(i)];
            row.fill(0.0);
            if parameters {
                x.plan.add_sweep(multibody, sweep, dt, &mut row[at.theta()..])?;
            }
            let placed = &self.placements()[place.placement];
            if !x.plan.theta.is_empty()
                && let Some(sway) = placed.effect.sway(self.theta_of(placed))
            {
                let rate = motion.next_rate(base, w);
                let (sum, change) = (rate + motion.rate, rate - motion.rate);
                for (k, column) in x.plan.theta[placed.theta.clone()].iter().enumerate().filter(|(_, c)| **c < at.parameters) {
                    let held = 0.25 * dt * dt * sway.stiffness.d_theta[k] + 0.5 * dt * sway.damping.d_theta[k];
                    let by_force = dt * state.z[placed.z.start] * sway.stiffness.d_theta[k];
                    row[at.theta() + column] += change * sway.mass.d_theta[k] + sum * held + by_force;
                }
            }
            for k in 0..n {
                row[k] = dt * sweep.q[k];
                row[n + k] = dt * sweep.v[k] - sweep.a[k];
            }
            let z = at.z() + placed.z.start;
            row[z] = dt * motion.stiffness;
            row[z + 1] = -motion.inward;
            for (j, p) in base.momentum.iter().enumerate() {
                let share = p / motion.inertia;
                let to = &mut x.change[at.row(j)];
                to[z + 1] -= p;
                add_row(to, -share, row);
                for (H, other) in x.H[j * n..(j + 1) * n].iter_mut().zip(&base.momentum) {
                    *H -= share * other;
                }
            }
        }
        Ok(())
    }

    /// How the load on each joint, `-ID(q, v, 0)`, changes with position and velocity. Leaves the rigid workspace at the velocities of
    /// the state.
    fn load_change(&self, ws: &mut StepWorkspace, state: &State, at: Columns, x: &mut Linearisation) {
        if x.has_load {
            return;
        }
        x.has_load = true;
        let multibody = self.multibody();
        if let Some(pendulum) = &x.pendulum {
            ws.rigid.variation.set_only(pendulum.gravity(state.q[0])[1]);
        } else {
            ws.rigid.v.copy_from_slice(&state.v);
            multibody.velocities(&mut ws.rigid);
            multibody.forces(&mut ws.rigid, None, true);
            multibody.differentiate(&mut ws.rigid);
        }
        for (i, row) in x.load.chunks_exact_mut(at.width().max(1)).enumerate() {
            let (by_state, rest) = row.split_at_mut(2 * at.n);
            for (load, by) in by_state.iter_mut().zip(ws.rigid.variation.row(i)) {
                *load = -by;
            }
            rest.fill(0.0);
        }
        if x.plan.has_rigid() {
            let mut rows = Rows { values: &mut x.load, width: at.width(), first: at.theta() };
            x.plan.add_rigid(multibody, &ws.rigid, &x.zeros, -1.0, false, None, &mut rows);
        }
    }

    /// How the commands change on their way to the joints. `states`: write the inner states of effects on the way too.
    #[allow(clippy::too_many_arguments)]
    fn drive_change(&self, ws: &mut StepWorkspace, state: &State, next: &[f64], dt: f64, at: Columns, states: bool, x: &mut Linearisation) {
        if self.commands.is_empty() {
            return;
        }
        x.reached.fill(0.0);
        for k in 0..at.n {
            x.reached[at.row(k)][at.u() + k] = 1.0;
        }
        let mut transfer = Transfer::default();
        for &i in &self.commands {
            if states {
                self.states_change(ws, state, next, i, dt, at, x);
            }
            let placed = &self.placements()[i];
            let taken = Taken { state, next, tau: &ws.tau, seen: &ws.seen, load: &ws.load, dt };
            transfer.d_history.fill(0.0);
            placed.effect.command(self.theta_of(placed), &self.instant(placed, &taken, ws.seen[i]), &mut transfer);
            let row = &mut x.reached[at.row(placed.v)];
            row.iter_mut().for_each(|r| *r *= transfer.output.d_input);
            add_partial(row, placed, &transfer.output, at, &x.plan.theta);
            if placed.effect.keeps_history() {
                let history = at.z() + placed.z.start + placed.effect.states();
                for (r, d) in row[history..history + HISTORY].iter_mut().zip(transfer.d_history) {
                    *r += d;
                }
            }
        }
    }

    /// How the inner states of all effects move on.
    fn advance_change(&self, ws: &mut StepWorkspace, state: &State, next: &[f64], dt: f64, at: Columns, x: &mut Linearisation) {
        if at.nz == 0 {
            return;
        }
        for (i, placed) in self.placements().iter().enumerate() {
            if !matches!(placed.effect.description().acts, Acts::Command(_) | Acts::Base) {
                self.states_change(ws, state, next, i, dt, at, x);
            }
        }
        self.drive_change(ws, state, next, dt, at, true, x);
        for (i, (place, base)) in self.sways.iter().zip(&ws.bases).enumerate() {
            let Some(motion) = self.base_step(place, base, state, dt) else { continue };
            x.row.copy_from_slice(&x.bases[at.row(i)]);
            for (j, p) in base.momentum.iter().enumerate() {
                add_row(&mut x.row, *p, &x.change[at.row(j)]);
            }
            x.row.iter_mut().for_each(|r| *r /= -motion.inertia);
            let z = self.placements()[place.placement].z.start;
            x.put(at.z() + z + 1, at);
            x.row.iter_mut().for_each(|r| *r *= 0.5 * dt);
            x.row[at.z() + z] += 1.0;
            x.row[at.z() + z + 1] += 0.5 * dt;
            x.put(at.z() + z, at);
        }
    }

    /// Writes the rows of one effect's inner states, with its input as `reached` has it.
    #[allow(clippy::too_many_arguments)]
    fn states_change(&self, ws: &mut StepWorkspace, state: &State, next: &[f64], i: usize, dt: f64, at: Columns, x: &mut Linearisation) {
        let placed = &self.placements()[i];
        let (k, states) = (placed.v, placed.effect.states());
        if states == 0 {
            return;
        }
        let mut out = Advance::default();
        let taken = Taken { state, next, tau: &ws.tau, seen: &ws.seen, load: &ws.load, dt };
        placed.effect.advance(self.theta_of(placed), &self.instant(placed, &taken, self.input_of(i, &taken)), &mut out);
        for (s, z) in out.z.iter().enumerate().take(states) {
            if z.d_load != 0.0 {
                self.load_change(ws, state, at, x);
            }
            x.row.fill(0.0);
            add_partial(&mut x.row, placed, z, at, &x.plan.theta);
            add_row(&mut x.row, z.d_next, &x.change[at.row(k)]);
            add_input(&mut x.row, k, z.d_input, &x.reached, at);
            if z.d_load != 0.0 {
                add_row(&mut x.row, z.d_load, &x.load[at.row(k)]);
            }
            x.put(at.z() + placed.z.start + s, at);
        }
        // All entries of a history stay but the one that is written.
        for z in placed.z.start + states..placed.z.end {
            x.row.fill(0.0);
            let slot = z - placed.z.start - states;
            match out.sample {
                Some(sample) if sample.slot == slot => {
                    x.row[at.z() + z] = sample.d_slot;
                    add_input(&mut x.row, k, sample.d_input, &x.reached, at);
                }
                Some(sample) if sample.slot + HISTORY == slot => {}
                _ => x.row[at.z() + z] = 1.0,
            }
            x.put(at.z() + z, at);
        }
    }

    /// Turns the right-hand sides into `dw`; `kept` is the factor of `H` on the free coordinates, where there is one.
    #[allow(clippy::too_many_arguments)]
    fn eliminate_change(
        &self,
        w: &[f64],
        held: &[Held],
        kept: Option<&[Lane]>,
        state: &State,
        dt: f64,
        at: Columns,
        x: &mut Linearisation,
    ) -> Result<(), DynamicsError> {
        let (n, width) = (at.n, at.width());
        // What is held: at rest, or where the limit says, which moves with the position.
        for k in (0..n).filter(|k| held[*k] != Held::Free) {
            x.change[at.row(k)].fill(0.0);
            if held[k] == Held::AtLimit {
                let slope = -1.0 / (dt * self.wall_steps(k, state, w[k]));
                x.change[at.row(k)][k] = slope;
                for &i in &x.free {
                    x.change[i * width + k] += x.H[i * n + k] * slope;
                }
            }
        }
        let m = x.free.len();
        if m == n {
            std::mem::swap(&mut x.packed, &mut x.change);
            x.packed.iter_mut().for_each(|x| *x = -*x);
        } else {
            for (i, &k) in x.free.iter().enumerate() {
                for (to, from) in x.packed[at.row(i)].iter_mut().zip(&x.change[at.row(k)]) {
                    *to = -from;
                }
            }
        }
        if kept.is_none() {
            if m == n {
                into_lanes(&x.H, n, &mut x.factor);
            } else {
                for (i, &k) in x.free.iter().enumerate() {
                    for (to, &j) in x.factor.as_flattened_mut()[4 * i * m.div_ceil(4)..].iter_mut().zip(&x.free) {
                        *to = x.H[k * n + j];
                    }
                }
            }
        }
        if let Some(factor) = kept {
            tree_solve_rows(factor, m, x.packed.as_chunks_mut().0, width / 4);
        } else if tree_factor(&mut x.factor, &x.before).is_ok() {
            tree_solve_rows(&x.factor, m, x.packed.as_chunks_mut().0, width / 4);
        } else {
            // Forces that fall with the velocity can make it indefinite.
            let factor = x.factor.as_flattened_mut();
            for (i, &k) in x.free.iter().enumerate() {
                for (l, &j) in x.free.iter().enumerate() {
                    factor[i * m + l] = x.H[k * n + j];
                }
            }
            eliminate(&mut factor[..m * m], m, &mut x.packed[..m * width], width);
            if !x.packed[..m * width].iter().all(|x| x.is_finite()) {
                let what = "the step's derivatives";
                return Err(DynamicsError::NoConvergence { what, residual: f64::INFINITY, iterations: 0 });
            }
        }
        if m == n {
            std::mem::swap(&mut x.packed, &mut x.change);
        } else {
            for (i, &k) in x.free.iter().enumerate() {
                x.change[at.row(k)].copy_from_slice(&x.packed[at.row(i)]);
            }
        }
        Ok(())
    }

    fn write(&self, w: &[f64], dt: f64, at: Columns, x: &mut Linearisation) {
        let (n, rows) = (at.n, at.u());
        let (width, change) = (at.width(), x.change.as_slice());
        let columns = [&mut x.A, &mut x.B, &mut x.P].into_iter().flat_map(|x| x.as_mut_slice().chunks_exact_mut(rows.max(1)));
        for (k, column) in columns.enumerate() {
            let (positions, rest) = column.split_at_mut(n);
            for (i, (q, v)) in positions.iter_mut().zip(rest).enumerate() {
                let dw = change[i * width + k];
                (*q, *v) = (dt * dw, dw);
            }
        }
        for body in self.multibody().bodies.iter().skip(1).filter(|b| !b.follows) {
            let own = body.v..body.v + body.nv;
            if body.nv == 1 {
                x.A[(body.v, body.v)] += 1.0;
                continue;
            }
            let (transport, J) = step_on_group(&body.motion, &w[own.clone()], dt);
            for (r, i) in own.clone().enumerate() {
                x.row.fill(0.0);
                for (c, j) in own.clone().enumerate() {
                    add_row(&mut x.row, J[(r, c)], &x.change[at.row(j)]);
                    x.row[j] += transport[(r, c)];
                }
                x.put(i, at);
            }
        }
    }
}

impl Linearisation {
    /// Writes `self.row` into A, B and P.
    fn put(&mut self, i: usize, at: Columns) {
        for (k, value) in self.row[..at.u()].iter().enumerate() {
            self.A[(i, k)] = *value;
        }
        for (k, value) in self.row[at.u()..at.u() + at.n].iter().enumerate() {
            self.B[(i, k)] = *value;
        }
        for (k, value) in self.row[at.theta()..at.theta() + at.parameters].iter().enumerate() {
            self.P[(i, k)] = *value;
        }
    }
}

/// Five vectors of `n` entries.
fn split(x: &mut [f64], n: usize) -> [&mut [f64]; 5] {
    let (a, x) = x.split_at_mut(n);
    let (b, x) = x.split_at_mut(n);
    let (c, x) = x.split_at_mut(n);
    let (d, e) = x.split_at_mut(n);
    [a, b, c, d, e]
}

#[inline]
fn add_row(row: &mut [f64], factor: f64, other: &[f64]) {
    for (x, y) in row.iter_mut().zip(other) {
        *x += factor * y;
    }
}

/// Adds the partials of a value by its joint's position and velocity, and by its effect's inner states and parameters: `theta` are the
/// columns of these, where there are any.
fn add_partial(row: &mut [f64], placed: &Placement, value: &Partial, at: Columns, theta: &[usize]) {
    if placed.q.is_some() {
        row[placed.v] += value.d_q;
    }
    row[at.n + placed.v] += value.d_v;
    let z = at.z() + placed.z.start..at.z() + placed.z.end;
    for (r, d) in row[z].iter_mut().zip(value.d_z) {
        *r += d;
    }
    if let Some(columns) = theta.get(placed.theta.clone()) {
        for (column, d) in columns.iter().zip(value.d_theta).filter(|(c, _)| **c < at.parameters) {
            row[at.theta() + column] += d;
        }
    }
}

/// Adds a partial by the effort that reaches a joint.
fn add_input(row: &mut [f64], k: usize, by_input: f64, reached: &[f64], at: Columns) {
    if by_input == 0.0 {
        return;
    }
    if reached.is_empty() {
        row[at.u() + k] += by_input;
    } else {
        add_row(row, by_input, &reached[at.row(k)]);
    }
}

/// How the position after a step along `w` answers to the one before, and to `w`, in the joint's own coordinates.
fn step_on_group(motion: &Motion, w: &[f64], dt: f64) -> (Matrix6<f64>, Matrix6<f64>) {
    // Motion subspace in the child, where it is constant; its columns are orthonormal.
    let mut S = [SpatialVector::zeros(); 6];
    motion.subspace(&nalgebra::Matrix3::identity(), &Vector3::zeros(), &mut S);
    let twist = w.iter().zip(&S).fold(SpatialVector::zeros(), |sum, (w, S)| sum + S * (*w * dt));
    let ad = Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(|k| cross_motion(&twist, &Vector6::ith(k, 1.0))));
    let (mut J, mut term) = (Matrix6::identity(), Matrix6::identity());
    // A step turns by less than a few radians: the terms fall like 1 / k!.
    for k in 1..40 {
        term = -ad * term / (k as f64 + 1.0);
        J += term;
        if term.amax() < 1e-17 * J.amax() {
            break;
        }
    }
    // Ad(exp(-x)) = 1 - ad(x) J(x).
    let transport = Matrix6::identity() - ad * J;
    let n = w.len();
    let project = |A: Matrix6<f64>| Matrix6::from_fn(|r, c| if r < n && c < n { S[r].dot(&(A * S[c])) } else { 0.0 });
    (project(transport), project(J) * dt)
}
