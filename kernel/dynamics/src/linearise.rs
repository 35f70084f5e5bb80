//! Derivatives of one step by the state that it starts from and by the input: `dx+ = A dx + B du` with `x = (q, v)`.
//!
//! The next velocities `w` solve `r(w; q, v, u) = 0` on the coordinates that nothing holds. With `a = (w - v) / h` the rigid part is
//! `h ID(q, v, a)`, so its derivatives are those of inverse dynamics. By the implicit function theorem `H dw = -dr`, with the Hessian `H`
//! of the step's convex problem at its solution. A coordinate that dry friction holds stays at rest; one at a limit moves with
//! `w = (limit - q) / h`.
//!
//! Positions are taken by their tangents ([`crate::Multibody::integrate`]), before and after the step:
//! `dq+ = Ad(exp(-h w)) dq + h J(h w) dw` with the right Jacobian `J` of the joint's group (Sola, Deray and Atchuthan 2018).
//!
//! Valid where no contact opens, closes, or changes its corner, and no coordinate starts or stops being held. The stiffness and damping
//! with which smooth effects enter a step count as constants. Coriolis forces are those of [`Coriolis::AtStart`].

use nalgebra::{DMatrix, SMatrix};
use sagci_model::JointKind;

use crate::complementarity::Held;
use crate::error::check;
use crate::linear::{cholesky, cholesky_solve};
use crate::step::RECOVERY_STEPS;
use crate::{Coriolis, DynamicsError, Input, State, StepWorkspace, System};

/// Derivatives of a step: rows and columns are the tangent of `q`, then `v`.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearisation {
    /// By the state, 2 nv x 2 nv.
    pub A: DMatrix<f64>,
    /// By drive efforts, 2 nv x nv.
    pub B: DMatrix<f64>,
    /// Scratch: `dr` by q and v, row-major; the Hessian, its factor; `dw`, one row a right-hand side.
    by_q: Vec<f64>,
    by_v: Vec<f64>,
    H: Vec<f64>,
    factor: Vec<f64>,
    dw: Vec<f64>,
    column: Vec<f64>,
    free: Vec<usize>,
    before: State,
}

impl Linearisation {
    /// Zeros for a system.
    pub fn new(system: &System) -> Self {
        let n = system.multibody().nv();
        Self {
            A: DMatrix::zeros(2 * n, 2 * n),
            B: DMatrix::zeros(2 * n, n),
            by_q: vec![0.0; n * n],
            by_v: vec![0.0; n * n],
            H: vec![0.0; n * n],
            factor: vec![0.0; n * n],
            dw: vec![0.0; 3 * n * n],
            column: vec![0.0; n],
            free: Vec::with_capacity(n),
            before: system.state(),
        }
    }
}

impl System {
    /// [`Self::step`] with its derivatives.
    ///
    /// # Errors
    /// As [`Self::step`]; a `linearisation` of another system; Coriolis forces at the midpoint.
    pub fn step_linearised(
        &self,
        ws: &mut StepWorkspace,
        state: &mut State,
        input: &Input<'_>,
        dt: f64,
        linearisation: &mut Linearisation,
    ) -> Result<(), DynamicsError> {
        let (multibody, n) = (self.multibody(), self.multibody().nv());
        let x = linearisation;
        if x.A.nrows() != 2 * n || x.before.q.len() != state.q.len() || x.before.z.len() != state.z.len() {
            return Err(DynamicsError::ForeignWorkspace);
        }
        if self.coriolis != Coriolis::AtStart {
            return Err(DynamicsError::Build {
                part: "step".into(),
                place: "Coriolis".into(),
                message: "is taken at the midpoint; set it to `AtStart` for derivatives".into(),
            });
        }
        x.before.clone_from(state);
        self.step(ws, state, input, dt)?;
        let before = &x.before;

        // Rigid bodies. Poses and velocities of the old state are still in the workspace.
        let w = &ws.problem.v;
        for ((a, w), v) in x.column.iter_mut().zip(w).zip(&before.v) {
            *a = (w - v) / dt;
        }
        multibody.forces(&mut ws.rigid, Some(&x.column), true);
        multibody.differentiate(&mut ws.rigid);
        let M = ws.rigid.M.as_slice();
        for i in 0..n {
            let (by_q, by_v) = ws.rigid.variation.row(i).split_at(n);
            for k in 0..n {
                x.by_q[i * n + k] = dt * by_q[k];
                x.by_v[i * n + k] = dt * by_v[k] - M[i * n + k];
            }
        }
        // Effects; the problem's own matrix has their stiffness and damping already.
        x.H.copy_from_slice(&ws.problem.A);
        for placed in self.placements() {
            let resistance = self.resistance(placed, before, &ws.tau, &ws.load);
            let (k, smooth, dry) = (placed.v, &resistance.smooth, &resistance.dry);
            let sign = if w[k] == 0.0 { 0.0 } else { w[k].signum() };
            x.by_q[k * n + k] += dt * (smooth.d_q + sign * dry.d_q);
            x.by_v[k * n + k] += dt * (smooth.d_v - smooth.d_v.max(0.0) + sign * dry.d_v);
            if let Some(stop) = resistance.stop {
                let rate = stop.side * w[k];
                if dt * (stop.stiffness * stop.depth + (stop.damping + dt * stop.stiffness) * rate) > 0.0 {
                    x.H[k * n + k] += dt * (stop.damping + dt * stop.stiffness);
                    // The damping grows with the depth.
                    let growth = if stop.depth > 0.0 { stop.damping / stop.depth } else { 0.0 };
                    x.by_q[k * n + k] += dt * (stop.stiffness + growth * rate);
                }
            }
        }
        if let (Some(contacts), Some(contact)) = (&self.contacts, &mut ws.contact)
            && !contact.active.is_empty()
        {
            contact.differentiate();
            contact.add_dense(contacts, w, &before.v, &mut x.by_q, &mut x.by_v, &mut x.H);
        }

        // Right-hand sides: -dr by q, v and u, one row each; coordinates at a limit move as they must.
        let held = &ws.problem.held;
        x.free.clear();
        x.free.extend((0..n).filter(|&k| held[k] == Held::Free));
        let m = x.free.len();
        for (i, &k) in x.free.iter().enumerate() {
            for (j, &l) in x.free[..=i].iter().enumerate() {
                x.factor[i * m + j] = x.H[k * n + l];
            }
        }
        cholesky(&mut x.factor, m).map_err(|pivot| multibody.no_inertia(x.free[pivot]))?;
        x.dw.fill(0.0);
        for c in 0..3 * n {
            let limit = if c < n && held[c] == Held::AtLimit { self.limit_rate(c, before.q[self.position(c)], dt) } else { 0.0 };
            for (i, &k) in x.free.iter().enumerate() {
                let r = match c / n {
                    0 => -x.by_q[k * n + c] - limit * x.H[k * n + c],
                    1 => -x.by_v[k * n + c - n],
                    _ => {
                        if c - 2 * n == k {
                            dt
                        } else {
                            0.0
                        }
                    }
                };
                x.column[i] = r;
            }
            cholesky_solve(&x.factor, m, &mut x.column[..m]);
            let row = &mut x.dw[c * n..(c + 1) * n];
            for (&k, value) in x.free.iter().zip(&x.column) {
                row[k] = *value;
            }
            if limit != 0.0 {
                row[c] = limit;
            }
        }
        self.write(x, w, dt);
        check("the derivatives of the step", x.A.as_slice(), 4 * n * n)
    }

    /// How the velocity of a coordinate at a limit changes with its position.
    fn limit_rate(&self, k: usize, q: f64, dt: f64) -> f64 {
        let [lower, upper] = self.walls[k];
        if q < lower || q > upper { -1.0 / (RECOVERY_STEPS * dt) } else { -1.0 / dt }
    }

    fn position(&self, v: usize) -> usize {
        self.multibody().joints().iter().find(|j| j.v.contains(&v)).map_or(0, |j| j.q.start)
    }

    /// `A` and `B` from `dw`.
    fn write(&self, x: &mut Linearisation, w: &[f64], dt: f64) {
        let n = w.len();
        for c in 0..3 * n {
            let row = &x.dw[c * n..(c + 1) * n];
            let to = if c < 2 * n { &mut x.A.as_mut_slice()[c * 2 * n..(c + 1) * 2 * n] } else { &mut x.B.as_mut_slice()[(c - 2 * n) * 2 * n..(c - 2 * n + 1) * 2 * n] };
            for (k, dw) in row.iter().enumerate() {
                to[k] = dt * dw;
                to[n + k] = *dw;
            }
            if c < n {
                to[c] += 1.0;
            }
        }
        for joint in self.multibody().joints() {
            let k = joint.v.start;
            match joint.kind {
                JointKind::Floating => {
                    let V = SMatrix::<f64, 6, 1>::from_fn(|i, _| w[k + i] * dt);
                    let skew = |i: usize| SMatrix::<f64, 3, 3>::new(0.0, -V[i + 2], V[i + 1], V[i + 2], 0.0, -V[i], -V[i + 1], V[i], 0.0);
                    let mut ad = SMatrix::<f64, 6, 6>::zeros();
                    ad.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(0));
                    ad.fixed_view_mut::<3, 3>(3, 3).copy_from(&skew(0));
                    ad.fixed_view_mut::<3, 3>(3, 0).copy_from(&skew(3));
                    turn(x, k, n, &ad);
                }
                JointKind::Planar => {
                    let (a, b, c) = (w[k] * dt, w[k + 1] * dt, w[k + 2] * dt);
                    turn(x, k, n, &SMatrix::<f64, 3, 3>::new(0.0, -c, b, c, 0.0, -a, 0.0, 0.0, 0.0));
                }
                _ => {}
            }
        }
    }
}

/// Replaces the rows of a joint's positions, written as `dq + h dw`, by `exp(-ad) dq + J(h w) h dw`.
fn turn<const D: usize>(x: &mut Linearisation, k: usize, n: usize, ad: &SMatrix<f64, D, D>) {
    // exp(-ad) = sum (-ad)^i / i!, J = sum (-ad)^i / (i + 1)!; a step turns by little, so few terms are needed.
    let one = SMatrix::<f64, D, D>::identity();
    let (mut exp, mut jacobian, mut term) = (one, one, one);
    for i in 1..40 {
        term = -(ad * term) / f64::from(i);
        exp += term;
        jacobian += term / f64::from(i + 1);
        if term.amax() < 1e-18 {
            break;
        }
    }
    for c in 0..3 * n {
        let column = if c < 2 * n { &mut x.A.as_mut_slice()[c * 2 * n..] } else { &mut x.B.as_mut_slice()[(c - 2 * n) * 2 * n..] };
        let mut moved = SMatrix::<f64, D, 1>::from_fn(|i, _| column[k + i]);
        let at = if c < n && (k..k + D).contains(&c) { Some(c - k) } else { None };
        if let Some(i) = at {
            moved[i] -= 1.0;
        }
        let mut result = jacobian * moved;
        if let Some(i) = at {
            result += exp.column(i);
        }
        for i in 0..D {
            column[k + i] = result[i];
        }
    }
}
