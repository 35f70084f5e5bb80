//! A step's own derivatives: `dx+ = A dx + B du` with `x = (q, v)` and `u = tau`, exactly those of [`System::step`].
//!
//! The step solves `r(w) = 0` for the next velocities `w`. With `a = (w - v) / h` its smooth rigid part is `h ID(q, v, a)`, so
//!
//! `H dw = -(h dID/dq dq + (h dID/dv - M) dv - h du + effects)`,  `H = M + h D + h^2 K + stops that push`,
//!
//! on the coordinates that move. What dry friction holds stays at rest, and what stands at a limit goes where the limit says:
//! there the derivative is that of the side on which the step lies. With Coriolis forces half way, `c((v + w0) / 2)`, the same
//! is done twice: once for the first solution `w0`, then with its change.
//!
//! Positions follow on the joint's group: `q+ = q exp(h w)`, so `dq+ = Ad(exp(-h w)) dq + h J(h w) dw` with the right Jacobian
//! `J(x) = sum_k (-ad x)^k / (k + 1)!` (Sola, Deray and Atchuthan 2018, equation 143).

use nalgebra::{DMatrix, Matrix6, Vector3, Vector6};

use crate::complementarity::{Held, Problem};
use crate::effects::Resistance;
use crate::joint::Motion;
use crate::linear::cholesky;
use crate::multibody::length;
use crate::spatial::cross_motion;
use crate::step::RECOVERY_STEPS;
use crate::system::Placement;
use crate::{Coriolis, DynamicsError, Input, SpatialVector, State, StepWorkspace, System};

/// Derivatives of one step. `x` is position (as a tangent, see [`crate::Multibody::integrate`]) and then velocity, `2 nv`
/// entries; `u` the drive efforts. Inner states of effects are taken as given.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearisation {
    /// `dx+ / dx`, 2 nv x 2 nv.
    pub A: DMatrix<f64>,
    /// `dx+ / du`, 2 nv x nv.
    pub B: DMatrix<f64>,
    /// Right-hand sides and then `dw`, a row of `3 nv` for each velocity: by q, by v, by u.
    change: Vec<f64>,
    /// The same for the first solution.
    first: Vec<f64>,
    free: Vec<usize>,
    factor: Vec<f64>,
    packed: Vec<f64>,
    a: Vec<f64>,
}

impl Linearisation {
    /// Zeros for a system.
    pub fn new(system: &System) -> Self {
        let n = system.multibody().nv();
        Self {
            A: DMatrix::zeros(2 * n, 2 * n),
            B: DMatrix::zeros(2 * n, n),
            change: vec![0.0; 3 * n * n],
            first: vec![0.0; 3 * n * n],
            free: Vec::with_capacity(n),
            factor: vec![0.0; n * n],
            packed: vec![0.0; 3 * n * n],
            a: vec![0.0; n],
        }
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
        length("a linearisation's rows", linearisation.A.nrows(), 2 * n)?;
        next.q.copy_from_slice(&state.q);
        next.v.copy_from_slice(&state.v);
        next.z.copy_from_slice(&state.z);
        next.time = state.time;
        self.step(ws, next, input, dt)?;
        let x = linearisation;
        if self.coriolis == Coriolis::AtMidpoint {
            ws.rigid.v.copy_from_slice(&state.v);
            multibody.velocities(&mut ws.rigid);
            self.solve_change(ws, state, dt, true, x)?;
            std::mem::swap(&mut x.change, &mut x.first);
            for (mid, (v, w)) in ws.rigid.v.iter_mut().zip(state.v.iter().zip(&ws.first)) {
                *mid = 0.5 * (v + w);
            }
            multibody.velocities(&mut ws.rigid);
        }
        self.solve_change(ws, state, dt, false, x)?;
        self.write(&next.v, dt, x);
        Ok(())
    }

    /// `dw` of one solution of the step, at the velocities that the rigid workspace has.
    fn solve_change(
        &self,
        ws: &mut StepWorkspace,
        state: &State,
        dt: f64,
        first: bool,
        x: &mut Linearisation,
    ) -> Result<(), DynamicsError> {
        let multibody = self.multibody();
        let n = multibody.nv();
        let (w, held): (&[f64], &[Held]) = if first { (&ws.first, &ws.first_held) } else { (&ws.problem.v, &ws.problem.held) };
        for (a, (w, v)) in x.a.iter_mut().zip(w.iter().zip(&state.v)) {
            *a = (w - v) / dt;
        }
        multibody.forces(&mut ws.rigid, Some(&x.a), true);
        multibody.differentiate(&mut ws.rigid);
        let after_first = !first && self.coriolis == Coriolis::AtMidpoint;
        let share = if after_first { 0.5 * dt } else { dt };
        for (i, row) in x.change.chunks_exact_mut(3 * n).enumerate() {
            let (by_q, by_v) = ws.rigid.variation.row(i).split_at(n);
            let M = &ws.rigid.M.as_slice()[i * n..(i + 1) * n];
            for k in 0..n {
                row[k] = dt * by_q[k];
                row[n + k] = share * by_v[k] - M[k];
            }
            row[2 * n..].fill(0.0);
            row[2 * n + i] = -dt;
            if after_first {
                for (by_v, first) in by_v[..n].iter().zip(x.first.chunks_exact(3 * n)) {
                    for (x, first) in row.iter_mut().zip(first) {
                        *x += share * by_v * first;
                    }
                }
            }
        }
        for placed in self.placements() {
            let (i, (by_q, by_v)) = (placed.v, self.effect_change(ws, placed, state, dt, w[placed.v]));
            x.change[i * 3 * n + i] += by_q;
            x.change[i * 3 * n + n + i] += by_v;
        }
        self.eliminate_change(&ws.problem, w, held, state, dt, x)
    }

    /// How the impulse of an effect at the solution changes with position and velocity before the step.
    fn effect_change(&self, ws: &StepWorkspace, placed: &Placement, state: &State, dt: f64, w: f64) -> (f64, f64) {
        let (q, v) = (placed.q.map_or(0.0, |q| state.q[q]), state.v[placed.v]);
        let at = |q: f64, v: f64| {
            let mut resistance = Resistance::default();
            let instant = crate::effects::Instant {
                q,
                v,
                input: ws.tau[placed.v],
                load: ws.load[placed.v],
                time: state.time,
                z: &state.z[placed.z.clone()],
            };
            placed.effect.resist(&self.parameters()[placed.theta.clone()], &instant, &mut resistance);
            resistance
        };
        let here = at(q, v);
        let (mut by_q, mut by_v) = (dt * here.smooth.d_q, dt * (here.smooth.d_v - here.smooth.d_v.max(0.0)));
        let sign = if w == 0.0 { 0.0 } else { w.signum() };
        if here.dry.value > 0.0 {
            by_q += dt * sign * here.dry.d_q;
            by_v += dt * sign * here.dry.d_v;
        }
        let pushes = |stop: &crate::effects::Stop| stop.stiffness * stop.depth + (stop.damping + dt * stop.stiffness) * stop.side * w > 0.0;
        let stop = here.stop.filter(pushes);
        if let Some(stop) = stop {
            by_q += dt * stop.stiffness;
        }
        // The impulse holds the effect's own slopes, taken at the start; how those change is found by differences of them.
        let implicit = |r: &Resistance| {
            let smooth = r.smooth.d_v.max(0.0) * (w - v) + dt * r.smooth.d_q.max(0.0) * w;
            smooth + if stop.is_some() { r.stop.map_or(0.0, |s| s.damping * w) } else { 0.0 }
        };
        let (dq, dv) = (1e-6 * (1.0 + q.abs()), 1e-6 * (1.0 + v.abs()));
        by_q += dt * (implicit(&at(q + dq, v)) - implicit(&at(q - dq, v))) / (2.0 * dq);
        by_v += dt * (implicit(&at(q, v + dv)) - implicit(&at(q, v - dv))) / (2.0 * dv);
        (by_q, by_v)
    }

    /// Turns the right-hand sides into `dw`.
    fn eliminate_change(
        &self,
        problem: &Problem,
        w: &[f64],
        held: &[Held],
        state: &State,
        dt: f64,
        x: &mut Linearisation,
    ) -> Result<(), DynamicsError> {
        let (n, width) = (problem.n, 3 * problem.n);
        x.free.clear();
        x.free.extend((0..n).filter(|k| held[*k] == Held::Free));
        // What is held: at rest, or where the limit says, which moves with the position.
        for joint in self.multibody().joints() {
            let (k, q) = (joint.v.start, state.q[joint.q.start]);
            if joint.v.len() != 1 || held[k] == Held::Free {
                continue;
            }
            x.change[k * width..(k + 1) * width].fill(0.0);
            if held[k] == Held::AtLimit {
                let outside = q < self.walls[k][0] || q > self.walls[k][1];
                let slope = -1.0 / if outside { RECOVERY_STEPS * dt } else { dt };
                x.change[k * width + k] = slope;
                for &i in &x.free {
                    x.change[i * width + k] += problem.A[i * n + k] * slope;
                }
            }
        }
        let m = x.free.len();
        for (i, &k) in x.free.iter().enumerate() {
            for (l, &j) in x.free.iter().enumerate() {
                x.factor[i * m + l] = problem.A[k * n + j];
            }
            for hinge in problem.hinges.iter().filter(|h| h.k == k && h.offset + h.slope * h.side * w[k] > 0.0) {
                x.factor[i * m + i] += hinge.slope;
            }
            for (to, from) in x.packed[i * width..(i + 1) * width].iter_mut().zip(&x.change[k * width..(k + 1) * width]) {
                *to = -from;
            }
        }
        let L = &mut x.factor[..m * m];
        let what = "the step's derivatives";
        cholesky(L, m).map_err(|_| DynamicsError::NoConvergence { what, residual: f64::INFINITY, iterations: 0 })?;
        // Whole rows at a time: all right-hand sides side by side.
        for i in 0..m {
            let (above, row) = x.packed.split_at_mut(i * width);
            reduce(&mut row[..width], above, width, |k| L[i * m + k], L[i * m + i]);
        }
        for i in (0..m).rev() {
            let (row, below) = x.packed[i * width..m * width].split_at_mut(width);
            reduce(row, below, width, |k| L[(i + 1 + k) * m + i], L[i * m + i]);
        }
        for (i, &k) in x.free.iter().enumerate() {
            x.change[k * width..(k + 1) * width].copy_from_slice(&x.packed[i * width..(i + 1) * width]);
        }
        Ok(())
    }

    fn write(&self, w: &[f64], dt: f64, x: &mut Linearisation) {
        let n = w.len();
        for (i, row) in x.change.chunks_exact(3 * n).enumerate() {
            for k in 0..n {
                x.A[(n + i, k)] = row[k];
                x.A[(n + i, n + k)] = row[n + k];
                x.B[(n + i, k)] = row[2 * n + k];
            }
        }
        for body in self.multibody().bodies.iter().skip(1).filter(|b| !b.follows) {
            let at = body.v..body.v + body.nv;
            let (transport, J) = if body.nv == 1 {
                (Matrix6::identity(), Matrix6::identity() * dt)
            } else {
                step_on_group(&body.motion, &w[at.clone()], dt)
            };
            for (r, i) in at.clone().enumerate() {
                for k in 0..3 * n {
                    let sum: f64 = at.clone().enumerate().map(|(c, j)| J[(r, c)] * x.change[j * 3 * n + k]).sum();
                    if k < 2 * n {
                        x.A[(i, k)] = sum;
                    } else {
                        x.B[(i, k - 2 * n)] = sum;
                    }
                }
                for (c, j) in at.clone().enumerate() {
                    x.A[(i, j)] += transport[(r, c)];
                }
            }
        }
    }
}

/// `row = (row - sum_k factor(k) rows_k) / pivot`.
#[inline]
fn reduce(row: &mut [f64], rows: &[f64], width: usize, factor: impl Fn(usize) -> f64, pivot: f64) {
    for (k, other) in rows.chunks_exact(width).enumerate() {
        let f = factor(k);
        for (x, y) in row.iter_mut().zip(other) {
            *x -= f * y;
        }
    }
    let scale = 1.0 / pivot;
    for x in row {
        *x *= scale;
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
