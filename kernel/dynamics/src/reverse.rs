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
//! Newton-Euler, [`Multibody::pull_inverse_dynamics`].
//!
//! A step with Coriolis forces half way, or with a learned residual, is solved twice; it is taken back the same way: the
//! second solve first, whose dependence on the first one's `w~` is the cotangent that the first one starts from.
//!
//! # Recursive Newton-Euler, backwards
//! With `Lambda_i = sum of S_j sigma_j` on the path to body `i` (the velocity that the bodies have under the joint rates
//! `sigma`), `sigma . ID = sum_i Lambda_i . (I_i A_i + V_i x* I_i V_i - F_ext,i)`. From the leaves to the root, with
//! `Gamma = Lambda x V` and sums over the children left out:
//!
//! * by `A_i`: `alpha = I Lambda`;
//! * by `V_i`: `nu = I Gamma - Lambda x* I V + (S v) x* alpha`;
//! * by the twist of the body's pose: `P = -Lambda x* I A - A x* I Lambda - Gamma x* I V - V x* I Gamma
//!   + (S sigma) x* Phi + (S a) x* alpha + (S v) x* (nu - V x* alpha)`, with `Phi` the force through the joint;
//! * `a' = S . alpha`, `v' = S . (nu - V x* alpha)`, `q' = S . P`; the joint's origin gets `P`, its axis what `S` gets and
//!   what the turned pose gets.
//!
//! This is the transpose of the recursions of Singh, Russo and Wensing (2022), at the cost of about two of Newton-Euler,
//! whatever the number of parameters.

use nalgebra::{Matrix3, Vector3};
use sagci_model::JointKind;

use crate::complementarity::{Held, Problem};
use crate::effects::Instant;
use crate::linear::cholesky_solve;
use crate::residual::ResidualCotangents;
use crate::spatial::{angular, join, linear};
use crate::step::RECOVERY_STEPS;
use crate::{Coriolis, DynamicsError, Multibody, SpatialVector, State, StepWorkspace, System, Workspace, cross_force, cross_motion};

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

/// Cotangents of all parameters in the coordinates in which the dynamics is written.
/// [`crate::ParameterVector::gradient`] takes them to named entries.
#[derive(Debug, Clone, PartialEq)]
pub struct NaturalGradient {
    /// By mass, mass times centre of mass (3) and inertia about the origin (xx, xy, xz, yy, yz, zz; each pair of equal
    /// entries counts as one) of each body, in the body's frame.
    pub inertia: Vec<[f64; 10]>,
    /// By each body's joint axis, in the joint's frame.
    pub axis: Vec<Vector3<f64>>,
    /// By the twist that moves each joint's frame on the parent, written in that frame at its origin.
    pub origin: Vec<SpatialVector>,
    /// By armature.
    pub armature: Vec<f64>,
    /// By the parameters of effects.
    pub theta: Vec<f64>,
    /// By the weights of the residual.
    pub weights: Vec<f64>,
    /// What is computed; the rest stays as it is.
    pub wanted: Wanted,
}

/// Which groups of parameters a reverse pass works for. Each left out saves its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// Inertial entries.
    pub inertia: bool,
    /// Joint axes and origins.
    pub joints: bool,
    /// Parameters of effects, and armatures.
    pub effects: bool,
    /// Weights of the residual.
    pub weights: bool,
}

impl Wanted {
    /// Everything.
    pub const ALL: Self = Self { inertia: true, joints: true, effects: true, weights: true };
    /// State and input alone.
    pub const NONE: Self = Self { inertia: false, joints: false, effects: false, weights: false };
}

impl NaturalGradient {
    /// Zero, for a system.
    pub fn zero(system: &System, wanted: Wanted) -> Self {
        let bodies = system.multibody().bodies.len();
        Self {
            inertia: vec![[0.0; 10]; bodies],
            axis: vec![Vector3::zeros(); bodies],
            origin: vec![SpatialVector::zeros(); bodies],
            armature: vec![0.0; system.multibody().nv()],
            theta: vec![0.0; system.parameters().len()],
            weights: vec![0.0; system.residual().map_or(0, |r| r.network().weights().len())],
            wanted,
        }
    }

    /// Back to zero.
    pub fn clear(&mut self) {
        self.inertia.fill([0.0; 10]);
        self.axis.fill(Vector3::zeros());
        self.origin.fill(SpatialVector::zeros());
        for part in [&mut self.armature, &mut self.theta, &mut self.weights] {
            part.fill(0.0);
        }
    }
}

/// One solve of a step as it was left: what its reverse needs.
#[derive(Debug, Clone)]
pub(crate) struct Solve {
    pub w: Vec<f64>,
    pub held: Vec<Held>,
    /// Cholesky factor on the free coordinates.
    pub factor: Vec<f64>,
}

impl Solve {
    pub fn new(n: usize) -> Self {
        Self { w: vec![0.0; n], held: vec![Held::Free; n], factor: vec![0.0; n * n] }
    }

    pub fn keep(&mut self, problem: &Problem) {
        self.w.copy_from_slice(&problem.v);
        self.held.copy_from_slice(&problem.held);
        let m = problem.free.len();
        self.factor[..m * m].copy_from_slice(&problem.factor[..m * m]);
    }
}

/// One step as it was taken: where it started, and its solves.
#[derive(Debug, Clone)]
pub(crate) struct Record {
    pub state: State,
    pub first: Solve,
    /// Used where the step is solved twice.
    pub second: Solve,
}

impl Record {
    pub fn new(system: &System) -> Self {
        let n = system.multibody().nv();
        let second = if system.solves_twice() { n } else { 0 };
        Self { state: system.state(), first: Solve::new(n), second: Solve::new(second) }
    }

    /// Bytes that one record takes.
    pub fn bytes(system: &System) -> usize {
        let n = system.multibody().nv();
        let solve = n * (n * 8 + 8 + 1) + 72;
        let state = system.state();
        8 * (state.q.len() + state.v.len() + state.z.len()) + 72 + solve * if system.solves_twice() { 2 } else { 1 } + 72
    }

    /// Keeps where the step starts.
    pub fn begin(&mut self, state: &State) {
        self.state.q.copy_from_slice(&state.q);
        self.state.v.copy_from_slice(&state.v);
        self.state.z.copy_from_slice(&state.z);
        self.state.time = state.time;
    }

    /// Keeps how the step was solved.
    pub fn end(&mut self, system: &System, ws: &StepWorkspace) {
        if system.solves_twice() {
            self.first.w.copy_from_slice(&ws.first.w);
            self.first.held.copy_from_slice(&ws.first.held);
            self.first.factor.copy_from_slice(&ws.first.factor);
            self.second.keep(&ws.problem);
        } else {
            self.first.keep(&ws.problem);
        }
    }
}

/// Everything that changes in a reverse step. Made once.
#[derive(Debug, Clone)]
pub(crate) struct ReverseWorkspace {
    rigid: Workspace,
    sweep: Sweep,
    residual: Option<crate::residual::ResidualWorkspace>,
    w: Vec<f64>,
    first: Vec<f64>,
    lambda: Vec<f64>,
    rhs: Vec<f64>,
    a: Vec<f64>,
    load: Vec<f64>,
    load_bar: Vec<f64>,
    next: StateCotangent,
}

impl ReverseWorkspace {
    pub fn new(system: &System) -> Self {
        let multibody = system.multibody();
        let n = multibody.nv();
        Self {
            rigid: multibody.workspace(),
            sweep: Sweep::new(multibody),
            residual: system.residual.as_ref().map(|r| r.workspace(n)),
            w: vec![0.0; n],
            first: vec![0.0; n],
            lambda: vec![0.0; n],
            rhs: vec![0.0; n],
            a: vec![0.0; n],
            load: vec![0.0; n],
            load_bar: vec![0.0; n],
            next: StateCotangent { q: vec![0.0; n], v: vec![0.0; n], z: system.state().z },
        }
    }
}

/// What a reverse step is told of the step's input, and where the cotangents of the input go.
pub(crate) struct InputCotangent<'a> {
    pub tau: &'a [f64],
    pub external: &'a [crate::ExternalWrench],
    pub tau_bar: &'a mut [f64],
    pub external_bar: &'a mut [SpatialVector],
}

impl System {
    /// Takes one step back: `cotangent` is that of the next state, and becomes that of the state before. Adds to the
    /// cotangents of the input and of the parameters.
    pub(crate) fn reverse_step(
        &self,
        ws: &mut ReverseWorkspace,
        record: &Record,
        dt: f64,
        cotangent: &mut StateCotangent,
        input: &mut InputCotangent<'_>,
        gradient: &mut NaturalGradient,
    ) -> Result<(), DynamicsError> {
        let multibody = self.multibody();
        let state = &record.state;
        ws.rigid.q.copy_from_slice(&state.q);
        ws.rigid.v.copy_from_slice(&state.v);
        multibody.kinematics(&mut ws.rigid);
        multibody.gather_external(&mut ws.rigid, input.external)?;
        let uses_load = self.uses_load;
        ws.load_bar.fill(0.0);
        if uses_load {
            multibody.newton_euler(&mut ws.rigid, None, true, &mut ws.load);
            for load in &mut ws.load {
                *load = -*load;
            }
        }
        std::mem::swap(&mut ws.next, cotangent);
        let last = if self.solves_twice() { &record.second } else { &record.first };
        let bar = cotangent;
        bar.q.fill(0.0);
        bar.v.fill(0.0);
        self.reverse_inner_states(ws, record, &last.w, dt, bar, input, gradient);
        ws.w.copy_from_slice(&ws.next.v);
        multibody.pull_integrate(&last.w, dt, &ws.next.q, &mut bar.q, &mut ws.w);
        ws.first.fill(0.0);
        if self.solves_twice() {
            self.reverse_solve(ws, record, false, dt, bar, input, gradient);
            std::mem::swap(&mut ws.w, &mut ws.first);
            if let (Some(placed), Some(residual)) = (&self.residual, &mut ws.residual) {
                placed.force(residual, &state.q, &state.v, input.tau, &record.first.w, dt);
                for (f, lambda) in ws.rhs.iter_mut().zip(&ws.lambda) {
                    *f = dt * lambda;
                }
                let weights = gradient.wanted.weights.then_some(&mut gradient.weights[..]);
                let mut into =
                    ResidualCotangents { q: &mut bar.q, v: &mut bar.v, u: &mut *input.tau_bar, next: &mut ws.w, weights };
                placed.pull(residual, &state.q, dt, &ws.rhs, &mut into);
            }
        }
        self.reverse_solve(ws, record, true, dt, bar, input, gradient);
        if uses_load && ws.load_bar.iter().any(|l| *l != 0.0) {
            // load = -ID(q, v, 0).
            ws.a.fill(0.0);
            for (l, bar) in ws.lambda.iter_mut().zip(&ws.load_bar) {
                *l = -bar;
            }
            ws.sweep.clear();
            multibody.pull_inverse_dynamics(&mut ws.rigid, &mut ws.sweep, &ws.a, &ws.lambda, gradient);
            self.hand_on_external(&ws.sweep, input);
            for k in 0..multibody.nv() {
                bar.q[k] += ws.sweep.q[k];
                bar.v[k] += ws.sweep.v[k];
            }
        }
        Ok(())
    }

    fn hand_on_external(&self, sweep: &Sweep, input: &mut InputCotangent<'_>) {
        for (bar, wrench) in input.external_bar.iter_mut().zip(input.external) {
            *bar -= sweep.Lambda[self.multibody().frames[wrench.link.0].body];
        }
    }

    /// Takes one of the step's solves back, from the cotangent `ws.w` of its solution.
    #[allow(clippy::too_many_arguments)]
    fn reverse_solve(
        &self,
        ws: &mut ReverseWorkspace,
        record: &Record,
        first: bool,
        dt: f64,
        bar: &mut StateCotangent,
        input: &mut InputCotangent<'_>,
        gradient: &mut NaturalGradient,
    ) {
        let (multibody, state) = (self.multibody(), &record.state);
        let n = multibody.nv();
        let solve = if first { &record.first } else { &record.second };
        let mut m = 0;
        for k in 0..n {
            if solve.held[k] == Held::Free {
                ws.rhs[m] = ws.w[k];
                m += 1;
            }
        }
        cholesky_solve(&solve.factor, m, &mut ws.rhs[..m]);
        m = 0;
        for k in 0..n {
            ws.lambda[k] = 0.0;
            if solve.held[k] == Held::Free {
                ws.lambda[k] = ws.rhs[m];
                m += 1;
            }
        }
        self.reverse_effects(ws, record, solve, dt, bar, input, gradient);
        // The rigid part: L = sigma . ID(q, v, a).
        let midpoint = !first && self.coriolis == Coriolis::AtMidpoint;
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
        ws.sweep.clear();
        multibody.pull_inverse_dynamics(&mut ws.rigid, &mut ws.sweep, &ws.a, &ws.rhs, gradient);
        self.hand_on_external(&ws.sweep, input);
        for k in 0..n {
            let of_a = ws.sweep.a[k] / dt;
            bar.q[k] += ws.sweep.q[k];
            bar.v[k] -= of_a;
            input.tau_bar[k] += dt * ws.lambda[k];
            if midpoint {
                bar.v[k] += 0.5 * ws.sweep.v[k];
                ws.first[k] += 0.5 * ws.sweep.v[k];
            } else {
                bar.v[k] += ws.sweep.v[k];
            }
            if solve.held[k] == Held::AtLimit {
                // a' = -h (M lambda), so the sum is w' - H_held,free lambda.
                bar.q[k] -= (ws.w[k] + of_a) / (dt * self.wall_steps(k, state, solve.w[k]));
            }
        }
        if midpoint {
            ws.rigid.v.copy_from_slice(&state.v);
            multibody.velocities(&mut ws.rigid);
        }
    }

    /// Over how many steps a limit takes its coordinate to itself.
    fn wall_steps(&self, k: usize, state: &State, w: f64) -> f64 {
        let multibody = self.multibody();
        let Some(joint) = multibody.joints().iter().find(|j| j.v.start == k) else { return 1.0 };
        let (q, [lower, upper]) = (state.q[joint.q.start], self.walls[k]);
        let outside = if w > 0.0 { q < lower } else { q > upper };
        if outside { RECOVERY_STEPS } else { 1.0 }
    }
}

/// Scratch of the reverse of recursive Newton-Euler, and its results.
#[derive(Debug, Clone)]
pub(crate) struct Sweep {
    Lambda: Vec<SpatialVector>,
    /// Cotangents of the bodies' accelerations, velocities and poses. Those of velocities and poses may be seeded: what else
    /// depends on them, contacts for example, adds to them before the sweep.
    alpha: Vec<SpatialVector>,
    pub nu: Vec<SpatialVector>,
    pub P: Vec<SpatialVector>,
    /// Results by velocity.
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub a: Vec<f64>,
}

impl Sweep {
    pub fn new(multibody: &Multibody) -> Self {
        let (b, n) = (multibody.bodies.len(), multibody.nv());
        let zero = vec![SpatialVector::zeros(); b];
        Self { Lambda: zero.clone(), alpha: zero.clone(), nu: zero.clone(), P: zero, q: vec![0.0; n], v: vec![0.0; n], a: vec![0.0; n] }
    }

    /// Forgets results and seeds.
    pub fn clear(&mut self) {
        for part in [&mut self.alpha, &mut self.nu, &mut self.P] {
            part.fill(SpatialVector::zeros());
        }
        for part in [&mut self.q, &mut self.v, &mut self.a] {
            part.fill(0.0);
        }
    }
}

impl Multibody {
    /// Cotangents of `sigma . ID(q, v, a)` at the workspace's state with its external forces: by `q` (tangent), `v` and `a` in
    /// the sweep, by inertias, axes, origins and armatures added to `gradient`. See the module's first page.
    pub(crate) fn pull_inverse_dynamics(
        &self,
        ws: &mut Workspace,
        sweep: &mut Sweep,
        a: &[f64],
        sigma: &[f64],
        gradient: &mut NaturalGradient,
    ) {
        let zero = Vector3::zeros();
        ws.A[0] = join(&zero, &-self.gravity);
        sweep.Lambda[0] = SpatialVector::zeros();
        for (i, body) in self.bodies.iter().enumerate().skip(1) {
            let (mut A, mut Lambda) = (ws.A[body.parent] + ws.c[i], sweep.Lambda[body.parent]);
            for k in 0..body.nv {
                let S = ws.S[body.tree + k];
                A += S * (body.multiplier * a[body.v + k]);
                Lambda += S * (body.multiplier * sigma[body.v + k]);
            }
            let inertia = &ws.inertia[i];
            ws.F[i] = inertia.times(&A) + cross_force(&ws.V[i], &inertia.times(&ws.V[i])) - ws.external[i];
            ws.A[i] = A;
            sweep.Lambda[i] = Lambda;
        }
        let wanted = gradient.wanted;
        for (i, body) in self.bodies.iter().enumerate().skip(1).rev() {
            let (inertia, A, V, Lambda) = (&ws.inertia[i], ws.A[i], ws.V[i], sweep.Lambda[i]);
            let (IA, IV, IL) = (inertia.times(&A), inertia.times(&V), inertia.times(&Lambda));
            let Gamma = cross_motion(&Lambda, &V);
            let IG = inertia.times(&Gamma);
            let (mut Ssigma, mut Sa, mut Sv) = (SpatialVector::zeros(), SpatialVector::zeros(), SpatialVector::zeros());
            for k in 0..body.nv {
                let S = ws.S[body.tree + k] * body.multiplier;
                Ssigma += S * sigma[body.v + k];
                Sa += S * a[body.v + k];
                Sv += S * ws.v[body.v + k];
            }
            let Phi = ws.F[i];
            let alpha = sweep.alpha[i] + IL;
            let nu = sweep.nu[i] + IG - cross_force(&Lambda, &IV) + cross_force(&Sv, &alpha);
            let of_Sv = nu - cross_force(&V, &alpha);
            let P = sweep.P[i] - cross_force(&Lambda, &IA) - cross_force(&A, &IL) - cross_force(&Gamma, &IV) - cross_force(&V, &IG)
                + cross_force(&Ssigma, &Phi)
                + cross_force(&Sa, &alpha)
                + cross_force(&Sv, &of_Sv);
            for k in 0..body.nv {
                let (S, entry) = (ws.S[body.tree + k] * body.multiplier, body.v + k);
                sweep.a[entry] += S.dot(&alpha);
                sweep.v[entry] += S.dot(&of_Sv);
                sweep.q[entry] += S.dot(&P);
            }
            if wanted.inertia {
                let (R, p) = (&ws.R_WB[i], &ws.p_WB[i]);
                let inside = |X: &SpatialVector| -> [Vector3<f64>; 2] {
                    [R.tr_mul(&angular(X)), R.tr_mul(&(linear(X) + angular(X).cross(p)))]
                };
                let into = &mut gradient.inertia[i];
                add_products(into, &inside(&Lambda), &inside(&A));
                add_products(into, &inside(&Gamma), &inside(&V));
            }
            if wanted.joints {
                self.pull_joint(ws, i, &P, (sigma, a), [&Phi, &alpha, &of_Sv], gradient);
            }
            ws.F[body.parent] += Phi;
            sweep.alpha[body.parent] += alpha;
            sweep.nu[body.parent] += nu;
            sweep.P[body.parent] += P;
        }
        // What reached the world is not needed.
        ws.F[0] = SpatialVector::zeros();
        for (k, armature) in self.armature.iter().enumerate() {
            sweep.a[k] += armature * sigma[k];
            if wanted.effects {
                gradient.armature[k] += sigma[k] * a[k];
            }
        }
    }

    /// Adds what a joint's origin and axis get.
    fn pull_joint(
        &self,
        ws: &Workspace,
        i: usize,
        P: &SpatialVector,
        (sigma, a): (&[f64], &[f64]),
        [Phi, alpha, of_Sv]: [&SpatialVector; 3],
        gradient: &mut NaturalGradient,
    ) {
        let body = &self.bodies[i];
        let (R_WP, p_WP) = (&ws.R_WB[body.parent], &ws.p_WB[body.parent]);
        let R_WJ = R_WP * body.R_PJ;
        let p_WJ = p_WP + R_WP * body.p_PJ;
        let inside = |F: &SpatialVector, R: &Matrix3<f64>, p: &Vector3<f64>| -> [Vector3<f64>; 2] {
            [R.tr_mul(&(angular(F) - p.cross(&linear(F)))), R.tr_mul(&linear(F))]
        };
        let [torque, force] = inside(P, &R_WJ, &p_WJ);
        gradient.origin[i] += join(&torque, &force);
        if body.nv != 1 {
            return;
        }
        let q = if body.follows { body.multiplier * ws.q[body.q] + body.offset } else { ws.q[body.q] };
        let k = body.v;
        let of_S = (Phi * sigma[k] + alpha * a[k] + of_Sv * ws.v[k]) * body.multiplier;
        let [turn, slide] = inside(&of_S, &ws.R_WB[i], &ws.p_WB[i]);
        gradient.axis[i] += match body.motion.kind {
            // d exp(q n) = (sin q dn + (1 - cos q) n x dn) as a rotation in the joint's frame, for dn across n.
            JointKind::Revolute | JointKind::Continuous => {
                let (sin, cos) = q.sin_cos();
                turn + torque * sin - body.motion.axis.cross(&torque) * (1.0 - cos)
            }
            _ => slide + force * q,
        };
    }

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

/// Adds the derivatives of `Y . I X` by the ten entries of `I`, both motions in the body's frame.
#[inline]
fn add_products(into: &mut [f64; 10], [y, y_v]: &[Vector3<f64>; 2], [x, x_v]: &[Vector3<f64>; 2]) {
    // Y . I X = y . I x + y . (h x x_v) + m y_v . x_v - y_v . (h x x)
    into[0] += y_v.dot(x_v);
    let h = x_v.cross(y) - x.cross(y_v);
    into[1] += h.x;
    into[2] += h.y;
    into[3] += h.z;
    into[4] += y.x * x.x;
    into[5] += y.x * x.y + y.y * x.x;
    into[6] += y.x * x.z + y.z * x.x;
    into[7] += y.y * x.y;
    into[8] += y.y * x.z + y.z * x.y;
    into[9] += y.z * x.z;
}
