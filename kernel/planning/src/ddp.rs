//! Optimal control of a [`System`]: differential dynamic programming, from states that need not be reachable, within limits of the
//! controls.
//!
//! Least `J = sum_k l_k(x_k, u_k) + l_N(x_N)` with `x_k+1 = f(x_k, u_k)`, the step of the system, and `lower <= u_k <= upper`. About
//! a trajectory with the gaps `c_k+1 = f(x_k, u_k) - x_k+1` (all differences of states are tangents) each round solves the
//! linear-quadratic problem
//!
//! `dx_k+1 = A dx_k + B du_k + c_k+1`,  `l(x + dx, u + du) = l + l_x dx + l_u du + [dx; du] . L [dx; du] / 2`
//!
//! with `A`, `B` from [`System::linearise`] and the costs' own second derivatives; those of the step are left out (Gauss-Newton; Li and
//! Todorov 2004). Backward, with the cost-to-go `V_x, V_xx` of the next knot, and `V_x' = V_x + V_xx c` in place of it where there
//! is a gap (Giftthaler et al. 2018; Mastalli et al. 2020, equation 13):
//!
//! `Q_x = l_x + A^T V_x'`, `Q_u = l_u + B^T V_x'`, `Q_xx = l_xx + A^T V_xx A`, `Q_ux = l_ux + B^T V_xx A`,
//! `Q_uu = l_uu + B^T V_xx B + mu I`
//!
//! `du = k + K dx`: `k` the least of the quadratic model within the limits, `K = -Q_uu^-1 Q_ux` on the controls that are not held
//! there and zero on the others (Tassa, Mansard and Todorov 2014). The improved cost-to-go of Tassa, Erez and Todorov 2012, equation
//! 11, which knows that `mu` is no part of the cost, is then
//!
//! `V_x = Q_x + Q_ux^T k - mu K^T k`,  `V_xx = Q_xx + Q_ux^T K - mu K^T K`.
//!
//! Forward, with a step length `a`: `u = u_k + a k + K (x - x_k)`, `x_k+1 = f(x, u) - (1 - a) c_k+1`, so that a whole step closes the
//! gaps (Mastalli et al. 2020, equation 15). The model's own changes are linear in `a`, so it promises
//! `D1 a + D2 a^2 / 2` exactly, and `D1` is the slope of the cost. A trial is taken when the merit `J + nu sum |c|_1` falls by a
//! part of what is promised; `nu` grows so that the merit always falls along the step (Nocedal and Wright 2006, section 18.3). Where no trial
//! is taken, or `Q_uu` is not positive definite, `mu` grows (Tassa et al. 2012, section II-F).

mod box_program;
mod panel;
mod reach;

use nalgebra::{DMatrix, DVector};
use sagci_dynamics::{DynamicsError, Input, Linearisation, State, StepWorkspace, System, Workspace};

use crate::PlanError;
use box_program::BoxProgram;
use panel::{Lane, add_rows, dot, put_column};
pub use reach::{ReachCost, ReachWeights};

/// Where a trial may end up: a part of the promised decrease.
const ARMIJO: f64 = 0.1;
/// Step lengths 1, 1/2, .., 2^-10 (Tassa et al. 2012).
const HALVINGS: usize = 10;
/// Part of the merit's slope that the gaps alone have to bring (Nocedal and Wright 2006, equation 18.36).
const GAP_SHARE: f64 = 0.5;
/// Regularisation: least and greatest value, and the factor by which its own factor grows (Tassa et al. 2012, section II-F).
const LEAST_MU: f64 = 1e-9;
const GREATEST_MU: f64 = 1e10;
const MU_GROWTH: f64 = 2.0;

/// One instant of a trajectory, for a cost.
#[derive(Debug)]
pub struct Knot<'a> {
    /// Its number; the last one has no control.
    pub index: usize,
    /// Time until the next one, s; 0 at the last one.
    pub dt: f64,
    /// What is controlled.
    pub system: &'a System,
    /// State at the knot.
    pub state: &'a State,
    /// Rigid bodies at the positions of the state, ready for poses, Jacobians and gravity. Their velocities may be others: set the state
    /// where they count.
    pub rigid: &'a mut Workspace,
}

/// What a trajectory costs. A cost that is not finite is as bad as a step that cannot be taken.
pub trait Cost {
    /// Cost of the step from a knot under the control `u`, and its quadratic model, every entry of which is to be written.
    ///
    /// # Errors
    /// There is none at this knot.
    fn running(&mut self, knot: &mut Knot<'_>, u: &[f64], model: &mut Quadratic) -> Result<f64, PlanError>;

    /// Cost of the last state, likewise; the model's entries by `u` are not looked at.
    ///
    /// # Errors
    /// There is none.
    fn terminal(&mut self, knot: &mut Knot<'_>, model: &mut Quadratic) -> Result<f64, PlanError>;
}

/// Gradient and (approximate, positive semidefinite) Hessian of a cost. `x` is the tangent of the state: positions, velocities, inner
/// states of effects, as in [`Linearisation`].
#[derive(Debug, Clone, PartialEq)]
pub struct Quadratic {
    /// By the state.
    pub x: DVector<f64>,
    /// By the control.
    pub u: DVector<f64>,
    /// Twice by the state, symmetric.
    pub xx: DMatrix<f64>,
    /// Twice by the control, symmetric.
    pub uu: DMatrix<f64>,
    /// By state (rows) and control (columns).
    pub xu: DMatrix<f64>,
}

impl Quadratic {
    fn new(nx: usize, nu: usize) -> Self {
        Self {
            x: DVector::zeros(nx),
            u: DVector::zeros(nu),
            xx: DMatrix::zeros(nx, nx),
            uu: DMatrix::zeros(nu, nu),
            xu: DMatrix::zeros(nx, nu),
        }
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.x.as_mut_slice().fill(0.0);
        self.u.as_mut_slice().fill(0.0);
        for matrix in [&mut self.xx, &mut self.uu, &mut self.xu] {
            matrix.as_mut_slice().fill(0.0);
        }
    }
}

/// How a trajectory is sought.
#[derive(Debug, Clone, PartialEq)]
pub struct DdpOptions {
    /// Number of controls; there is one state more.
    pub knots: usize,
    /// Time between knots, s.
    pub dt: f64,
    /// Least and greatest control of each degree of freedom, N m or N; a joint without drive has 0 and 0. None: no limits.
    pub limits: Option<[Vec<f64>; 2]>,
    /// Rounds at most.
    pub iterations: usize,
    /// Ends when the model promises less than this, in units of the cost, and no gap is left.
    pub tolerance: f64,
}

impl DdpOptions {
    /// No limits, 100 rounds, and a tolerance of 1e-7.
    pub fn new(knots: usize, dt: f64) -> Self {
        Self { knots, dt, limits: None, iterations: 100, tolerance: 1e-7 }
    }
}

/// Why a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DdpEnd {
    /// The model promises no more.
    Converged,
    /// All rounds are used up.
    Iterations,
    /// No step brings what the model promises, however much it is held back.
    Stuck,
}

/// What a solve came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DdpSummary {
    /// Cost of the trajectory.
    pub cost: f64,
    /// Sum of the magnitudes of what is left of the gaps; zero unless the solve ended before the first whole step.
    pub gap: f64,
    /// Trajectories that were taken.
    pub iterations: usize,
    /// Why it ended.
    pub end: DdpEnd,
}

/// States, controls, and the models about them.
#[derive(Debug, Clone)]
struct Trajectory {
    states: Vec<State>,
    /// Knot after knot.
    controls: Vec<f64>,
    /// A panel for each knot, its rows those of `[B A]` that are not `linked`; B is padded to whole lanes.
    steps: Vec<Lane>,
    costs: Vec<Quadratic>,
    cost: f64,
}

/// A solver with all its memory: nothing is allocated after it is made.
#[derive(Debug, Clone)]
pub struct Ddp {
    options: DdpOptions,
    /// Tangent of the state; controls; lanes of each.
    nx: usize,
    nu: usize,
    wx: usize,
    wu: usize,
    /// Tangent rows of positions that move along their own velocity, `dq+ = dq + h dv+`, and all others, whose rows of `[B A]` are kept.
    linked: Vec<usize>,
    kept: Vec<usize>,
    /// One for each linked row, in lanes.
    links: Vec<Lane>,
    ws: StepWorkspace,
    linearisation: Linearisation,
    /// Where the last step led.
    landed: State,
    now: Trajectory,
    trial: Trajectory,
    /// Gap before each knot, `nx` numbers each.
    gaps: Vec<f64>,
    /// Sum of their magnitudes.
    gap: f64,
    /// `k` and, a panel of nu rows a knot, `K`.
    forward: Vec<f64>,
    feedback: Vec<Lane>,
    backward: Backward,
    /// Change of the state, and what the model makes of it.
    dx: Vec<f64>,
    du: Vec<f64>,
    next: Vec<f64>,
}

/// Scratch of the backward pass at one knot.
#[derive(Debug, Clone)]
struct Backward {
    /// Gradient and Hessian of the cost-to-go.
    v: Vec<f64>,
    V: Vec<Lane>,
    /// Rows of `V [B A]` that are kept, and rows of Q by u and by x, each `[u | x]`.
    G: Vec<Lane>,
    Q: Vec<Lane>,
    /// Gradient of Q, as one such row.
    q: Vec<Lane>,
    Y: Vec<Lane>,
    Quu: Vec<f64>,
    program: BoxProgram,
    /// Factors of a sum of rows.
    c: Vec<f64>,
}

impl Ddp {
    /// A solver for a system.
    ///
    /// # Errors
    /// [`PlanError::BadInput`]: no knots, a time step that is not positive, limits of the wrong number or the wrong way round, a negative
    /// tolerance.
    pub fn new(system: &System, options: DdpOptions) -> Result<Self, PlanError> {
        let state = system.state();
        let nu = system.multibody().nv();
        let (nx, knots) = (2 * nu + state.z.len(), options.knots);
        let bad = |message: String| Err(PlanError::BadInput { message });
        if knots == 0 || nu == 0 {
            return bad("optimal control needs at least one knot and one joint that moves".into());
        }
        if !(options.dt > 0.0 && options.dt.is_finite()) || options.tolerance.is_nan() || options.tolerance < 0.0 {
            return bad(format!("a time step of {} s, a tolerance of {}: must be positive", options.dt, options.tolerance));
        }
        if let Some([lower, upper]) = &options.limits {
            if lower.len() != nu || upper.len() != nu {
                return bad(format!("{} and {} limits for {nu} controls", lower.len(), upper.len()));
            }
            if let Some(k) = (0..nu).find(|k| lower[*k].is_nan() || upper[*k].is_nan() || lower[*k] > upper[*k]) {
                return bad(format!("control {k} is to lie between {} and {}", lower[k], upper[k]));
            }
        }
        let mut follows = vec![false; nx];
        for joint in system.multibody().joints().iter().filter(|j| j.v.len() == 1) {
            follows[joint.v.start] = true;
        }
        let (linked, kept): (Vec<usize>, Vec<usize>) = (0..nx).partition(|i| follows[*i]);
        let (wx, wu) = (nx.div_ceil(4), nu.div_ceil(4));
        let mut links = vec![[0.0; 4]; wx];
        for i in &linked {
            links[i / 4][i % 4] = 1.0;
        }
        let w = wx + wu;
        let lanes = |rows: usize, width: usize| vec![[0.0; 4]; rows * width];
        let trajectory = Trajectory {
            states: vec![state.clone(); knots + 1],
            controls: vec![0.0; knots * nu],
            steps: lanes(knots * kept.len(), w),
            costs: vec![Quadratic::new(nx, nu); knots + 1],
            cost: 0.0,
        };
        Ok(Self {
            nx,
            nu,
            wx,
            wu,
            linked,
            links,
            kept: kept.clone(),
            ws: system.workspace(),
            linearisation: Linearisation::new(system),
            landed: state,
            now: trajectory.clone(),
            trial: trajectory,
            gaps: vec![0.0; (knots + 1) * nx],
            gap: 0.0,
            forward: vec![0.0; knots * nu],
            feedback: lanes(knots * nu, wx),
            backward: Backward {
                v: vec![0.0; nx],
                V: lanes(nx, wx),
                G: lanes(kept.len(), w),
                Q: lanes(nu + nx, w),
                q: lanes(1, w),
                Y: lanes(nu, wx),
                Quu: vec![0.0; nu * nu],
                program: BoxProgram::new(nu),
                c: vec![0.0; nx],
            },
            dx: vec![0.0; nx],
            du: vec![0.0; nu],
            next: vec![0.0; nx],
            options,
        })
    }

    /// Seeks the controls from `x0`, starting from `controls` (knot after knot) and, where given, from states that need not follow
    /// from them.
    ///
    /// # Errors
    /// [`PlanError::BadInput`] for a vector of the wrong length or with a number that is not finite, or another system;
    /// [`PlanError::NoConvergence`] if the start itself cannot be stepped through or has no finite cost.
    pub fn solve(
        &mut self,
        system: &System,
        cost: &mut dyn Cost,
        x0: &State,
        controls: &[f64],
        states: Option<&[State]>,
    ) -> Result<DdpSummary, PlanError> {
        self.start(system, cost, x0, controls, states)?;
        let (mut mu, mut growth, mut weight) = (0.0, 1.0, 0.0_f64);
        let (mut iterations, mut relaxed) = (0, false);
        let end = loop {
            if self.backward(mu) {
                let promise = self.promise();
                let [slope, curvature] = promise;
                if self.gap == 0.0 && -(slope + 0.5 * curvature) <= self.options.tolerance {
                    if mu == 0.0 || relaxed {
                        break DdpEnd::Converged;
                    }
                    // Little is promised because little is dared.
                    (mu, growth, relaxed) = (0.0, 1.0, true);
                    continue;
                }
                if iterations >= self.options.iterations {
                    break DdpEnd::Iterations;
                }
                if self.gap > 0.0 {
                    weight = weight.max((slope + 0.5 * curvature.max(0.0)) / ((1.0 - GAP_SHARE) * self.gap));
                }
                if self.search(system, cost, promise, weight) {
                    iterations += 1;
                    relaxed = false;
                    growth = f64::min(1.0 / MU_GROWTH, growth / MU_GROWTH);
                    mu = if mu * growth >= LEAST_MU { mu * growth } else { 0.0 };
                    continue;
                }
            }
            growth = f64::max(MU_GROWTH, growth * MU_GROWTH);
            mu = f64::max(LEAST_MU, mu * growth);
            if mu > GREATEST_MU {
                break DdpEnd::Stuck;
            }
        };
        Ok(DdpSummary { cost: self.now.cost, gap: self.gap, iterations, end })
    }

    /// States at all knots.
    pub fn states(&self) -> &[State] {
        &self.now.states
    }

    /// The control from a knot to the next; empty behind the last.
    pub fn control(&self, knot: usize) -> &[f64] {
        self.now.controls.chunks_exact(self.nu).nth(knot).unwrap_or(&[])
    }

    /// Writes the gain `K` at a knot: `u = control + K (x - state)` is the best answer nearby.
    ///
    /// # Errors
    /// No such knot, or a matrix that is not nu x nx.
    pub fn feedback(&self, knot: usize, K: &mut DMatrix<f64>) -> Result<(), PlanError> {
        if knot >= self.options.knots || K.shape() != (self.nu, self.nx) {
            let (rows, columns) = K.shape();
            let message = format!("gain of knot {knot} of {} into {rows} x {columns}, is {} x {}", self.options.knots, self.nu, self.nx);
            return Err(PlanError::BadInput { message });
        }
        for (i, row) in self.feedback[knot * self.nu * self.wx..].chunks_exact(self.wx).take(self.nu).enumerate() {
            for (j, x) in row.as_flattened().iter().take(self.nx).enumerate() {
                K[(i, j)] = *x;
            }
        }
        Ok(())
    }

    /// Takes the guess in, with its gaps and models.
    fn start(
        &mut self,
        system: &System,
        cost: &mut dyn Cost,
        x0: &State,
        controls: &[f64],
        states: Option<&[State]>,
    ) -> Result<(), PlanError> {
        let knots = self.options.knots;
        let bad = |message: String| PlanError::BadInput { message };
        if system.multibody().nv() != self.nu || system.state().z.len() + 2 * self.nu != self.nx {
            return Err(bad("the solver was made for another system".into()));
        }
        if controls.len() != knots * self.nu || states.is_some_and(|s| s.len() != knots + 1) {
            let given = states.map_or(String::new(), |s| format!(" and {} states", s.len()));
            return Err(bad(format!("{} controls{given} for {knots} knots of {} and one state more", controls.len(), self.nu)));
        }
        if controls.iter().any(|u| !u.is_finite()) {
            return Err(bad("a control of the guess is no finite number".into()));
        }
        let like = &system.state();
        for state in states.unwrap_or(&[]).iter().chain([x0]) {
            if state.q.len() != like.q.len() || state.v.len() != like.v.len() || state.z.len() != like.z.len() {
                return Err(bad("a state of the guess is of another system".into()));
            }
            if state.q.iter().chain(&state.v).chain(&state.z).any(|x| !x.is_finite()) {
                return Err(bad("a state of the guess has a number that is not finite".into()));
            }
        }
        self.backward.program.x.fill(0.0);
        self.forward.fill(0.0);
        self.feedback.fill([0.0; 4]);
        self.gaps.fill(0.0);
        self.gap = 0.0;
        self.now.controls.copy_from_slice(controls);
        if let Some(states) = states {
            self.trial.controls.copy_from_slice(controls);
            for k in 0..knots {
                self.clamp(k);
            }
            for (to, from) in self.trial.states.iter_mut().zip(states) {
                copy(to, from);
            }
            difference(system, &self.trial.states[0], x0, &mut self.gaps[..self.nx]);
            self.trial.cost = 0.0;
            for k in 0..knots {
                self.step(system, cost, k)?;
                difference(system, &self.trial.states[k + 1], &self.landed, &mut self.gaps[(k + 1) * self.nx..(k + 2) * self.nx]);
            }
            self.end(system, cost)?;
            self.gap = self.gaps.iter().map(|c| c.abs()).sum();
        } else {
            for state in &mut self.now.states {
                copy(state, x0);
            }
            self.roll_out(system, cost, 1.0)?;
        }
        if !self.trial.cost.is_finite() {
            return Err(PlanError::NoConvergence { stage: STAGE.into(), message: "the guess has no finite cost".into() });
        }
        std::mem::swap(&mut self.now, &mut self.trial);
        Ok(())
    }

    /// Brings a control of the trial within its limits.
    fn clamp(&mut self, knot: usize) {
        if let Some([lower, upper]) = &self.options.limits {
            let u = &mut self.trial.controls[knot * self.nu..(knot + 1) * self.nu];
            for (u, (lower, upper)) in u.iter_mut().zip(lower.iter().zip(upper)) {
                *u = u.max(*lower).min(*upper);
            }
        }
    }

    /// Steps from a knot of the trial, into `landed`; adds the cost; models both.
    fn step(&mut self, system: &System, cost: &mut dyn Cost, k: usize) -> Result<(), PlanError> {
        let (nx, nu, wu, rows, dt) = (self.nx, self.nu, self.wu, self.kept.len(), self.options.dt);
        let width = wu + self.wx;
        let (trial, x) = (&mut self.trial, &mut self.linearisation);
        let (state, u) = (&trial.states[k], &trial.controls[k * nu..(k + 1) * nu]);
        let input = Input { tau: u, external: &[] };
        system.linearise(&mut self.ws, state, &input, dt, &mut self.landed, x).map_err(|e| lost(k, &e))?;
        for (i, row) in self.kept.iter().zip(trial.steps[k * rows * width..].chunks_exact_mut(width)) {
            let (by_u, by_x) = row.as_flattened_mut().split_at_mut(4 * wu);
            for (to, from) in by_u.iter_mut().zip(x.B.as_slice()[*i..].iter().step_by(nx)) {
                *to = *from;
            }
            for (to, from) in by_x.iter_mut().zip(x.A.as_slice()[*i..].iter().step_by(nx)) {
                *to = *from;
            }
        }
        let rigid = self.ws.rigid_at(system, state).map_err(|e| lost(k, &e))?;
        let mut knot = Knot { index: k, dt, system, state, rigid };
        trial.cost += cost.running(&mut knot, u, &mut trial.costs[k])?;
        Ok(())
    }

    /// Adds the cost of the trial's last state.
    fn end(&mut self, system: &System, cost: &mut dyn Cost) -> Result<(), PlanError> {
        let (index, trial) = (self.options.knots, &mut self.trial);
        let state = &trial.states[index];
        let rigid = self.ws.rigid_at(system, state).map_err(|e| lost(index, &e))?;
        let mut knot = Knot { index, dt: 0.0, system, state, rigid };
        trial.cost += cost.terminal(&mut knot, &mut trial.costs[index])?;
        Ok(())
    }

    /// A trial with the step length `length`.
    fn roll_out(&mut self, system: &System, cost: &mut dyn Cost, length: f64) -> Result<(), PlanError> {
        let (nx, nu) = (self.nx, self.nu);
        self.trial.cost = 0.0;
        copy(&mut self.trial.states[0], &self.now.states[0]);
        add(system, &mut self.trial.states[0], &self.gaps[..nx], length);
        for k in 0..self.options.knots {
            difference(system, &self.now.states[k], &self.trial.states[k], &mut self.dx);
            let feedback = self.feedback[k * nu * self.wx..].chunks_exact(self.wx);
            let own = k * nu..(k + 1) * nu;
            let (u, guess) = (&mut self.trial.controls[own.clone()], &self.now.controls[own.clone()]);
            for (((u, guess), forward), row) in u.iter_mut().zip(guess).zip(&self.forward[own]).zip(feedback) {
                *u = guess + length * forward + dot(row, &self.dx);
            }
            self.clamp(k);
            self.step(system, cost, k)?;
            copy(&mut self.trial.states[k + 1], &self.landed);
            if self.gap > 0.0 {
                let gap = &self.gaps[(k + 1) * nx..(k + 2) * nx];
                add(system, &mut self.trial.states[k + 1], gap, length - 1.0);
            }
        }
        self.end(system, cost)
    }

    /// Looks for a step length that brings the merit down as promised, and takes it.
    fn search(&mut self, system: &System, cost: &mut dyn Cost, [slope, curvature]: [f64; 2], weight: f64) -> bool {
        let mut length = 1.0;
        for _ in 0..=HALVINGS {
            // Most first and second trials are taken: their models come on the way.
            if self.roll_out(system, cost, length).is_ok() && self.trial.cost.is_finite() {
                let closed = weight * self.gap * length;
                let promised = length * (slope + 0.5 * length * curvature) - closed;
                if self.trial.cost - self.now.cost - closed <= ARMIJO * promised {
                    std::mem::swap(&mut self.now, &mut self.trial);
                    let left = 1.0 - length;
                    self.gaps.iter_mut().for_each(|c| *c *= left);
                    self.gap *= left;
                    return true;
                }
            }
            length *= 0.5;
        }
        false
    }

    /// What the model promises for a step of length `a`: `[D1, D2]` of `D1 a + D2 a^2 / 2`.
    fn promise(&mut self) -> [f64; 2] {
        let (nx, nu, width) = (self.nx, self.nu, self.wu + self.wx);
        let (mut slope, mut curvature) = (0.0, 0.0);
        self.dx.copy_from_slice(&self.gaps[..nx]);
        for k in 0..self.options.knots {
            let feedback = self.feedback[k * nu * self.wx..].chunks_exact(self.wx);
            for ((du, forward), row) in self.du.iter_mut().zip(&self.forward[k * nu..]).zip(feedback) {
                *du = forward + dot(row, &self.dx);
            }
            let l = &self.now.costs[k];
            slope += product(l.x.as_slice(), &self.dx) + product(l.u.as_slice(), &self.du);
            curvature += form(&l.xx, &self.dx, &self.dx) + 2.0 * form(&l.xu, &self.dx, &self.du) + form(&l.uu, &self.du, &self.du);
            for (i, row) in self.kept.iter().zip(self.now.steps[k * self.kept.len() * width..].chunks_exact(width)) {
                self.next[*i] = dot(&row[..self.wu], &self.du) + dot(&row[self.wu..], &self.dx);
            }
            for i in &self.linked {
                self.next[*i] = self.dx[*i] + self.options.dt * self.next[nu + *i];
            }
            for (next, gap) in self.next.iter_mut().zip(&self.gaps[(k + 1) * nx..]) {
                *next += gap;
            }
            std::mem::swap(&mut self.dx, &mut self.next);
        }
        let l = &self.now.costs[self.options.knots];
        [slope + product(l.x.as_slice(), &self.dx), curvature + form(&l.xx, &self.dx, &self.dx)]
    }

    /// Gains and cost-to-go from the last knot to the first. False where the model has no least control.
    fn backward(&mut self, mu: f64) -> bool {
        let (nx, nu, wx, wu) = (self.nx, self.nu, self.wx, self.wu);
        let (width, rows, dt) = (wx + wu, self.kept.len(), self.options.dt);
        let (linked, kept) = (&self.linked, &self.kept);
        let Backward { v, V, G, Q, q, Y, Quu, program, c } = &mut self.backward;
        let last = &self.now.costs[self.options.knots];
        v.copy_from_slice(last.x.as_slice());
        for (row, column) in V.chunks_exact_mut(wx).zip(last.xx.as_slice().chunks_exact(nx)) {
            row.as_flattened_mut()[..nx].copy_from_slice(column);
        }
        for k in (0..self.options.knots).rev() {
            let (l, F) = (&self.now.costs[k], &self.now.steps[k * rows * width..(k + 1) * rows * width]);
            if self.gap > 0.0 {
                let gap = &self.gaps[(k + 1) * nx..(k + 2) * nx];
                for (v, row) in v.iter_mut().zip(V.chunks_exact(wx)) {
                    *v += dot(row, gap);
                }
            }
            // In coordinates in which a linked position's row is that of the identity: dq+ - h dv+ = dq.
            for &i in linked {
                let (above, below) = V.split_at_mut((nu + i) * wx);
                add_rows(&mut below[..wx], 0, &above[i * wx..(i + 1) * wx], &[dt]);
            }
            for x in V.chunks_exact_mut(wx).map(|row| row.as_flattened_mut()).chain([&mut v[..]]) {
                let (by_q, by_v) = x.split_at_mut(nu);
                for ((by_v, by_q), link) in by_v.iter_mut().zip(by_q).zip(self.links.as_flattened()) {
                    *by_v += dt * link * *by_q;
                }
            }
            for (&i, row) in kept.iter().zip(G.chunks_exact_mut(width)) {
                let V_i = &V[i * wx..(i + 1) * wx];
                row.fill([0.0; 4]);
                add_linked(&mut row[wu..], V_i, &self.links);
                gather(&mut c[..rows], V_i.as_flattened(), kept);
                add_rows(row, 0, F, &c[..rows]);
            }
            put(&mut q[..wu], l.u.as_slice());
            put(&mut q[wu..], l.x.as_slice());
            for &j in linked {
                q[wu + j / 4][j % 4] += v[j];
            }
            gather(&mut c[..rows], v, kept);
            add_rows(q, 0, F, &c[..rows]);
            let (Qu, Qx) = Q.split_at_mut(nu * width);
            for (i, row) in Qu.chunks_exact_mut(width).enumerate() {
                put(&mut row[..wu], &l.uu.as_slice()[i * nu..(i + 1) * nu]);
                put(&mut row[wu..], &l.xu.as_slice()[i * nx..(i + 1) * nx]);
                put_column(&mut c[..rows], F, width, i, 1.0);
                add_rows(row, 0, G, &c[..rows]);
                Quu[i * nu..(i + 1) * nu].copy_from_slice(&row.as_flattened()[..nu]);
                Quu[i * nu + i] += mu;
            }
            // The upper triangle by x, in whole lanes.
            for (i, row) in Qx.chunks_exact_mut(width).enumerate() {
                put(&mut row[wu..], &l.xx.as_slice()[i * nx..(i + 1) * nx]);
                put_column(&mut c[..rows], F, width, 4 * wu + i, 1.0);
                add_rows(row, wu + i / 4, G, &c[..rows]);
            }
            for &i in linked {
                let (row, V_i) = (&mut Qx[i * width..(i + 1) * width], &V[i * wx..(i + 1) * wx]);
                add_linked(&mut row[wu..], V_i, &self.links);
                gather(&mut c[..rows], V_i.as_flattened(), kept);
                add_rows(row, wu + i / 4, F, &c[..rows]);
            }
            let Q_u = &q[..wu].as_flattened()[..nu];
            let u = &self.now.controls[k * nu..(k + 1) * nu];
            let least = match &self.options.limits {
                None => program.solve_free(Quu, Q_u),
                Some([lower, upper]) => program.solve(Quu, Q_u, |i| [lower[i] - u[i], upper[i] - u[i]]),
            };
            if !least || !program.x.iter().all(|x| x.is_finite()) {
                return false;
            }
            self.forward[k * nu..(k + 1) * nu].copy_from_slice(&program.x);
            // Y = L^-1 Q_ux: Q_ux^T K = -Y^T Y.
            let (m, L) = (program.free.len(), &program.factor);
            for (i, &free) in program.free.iter().enumerate() {
                let (above, row) = Y[..(i + 1) * wx].split_at_mut(i * wx);
                row.copy_from_slice(&Qu[free * width + wu..(free + 1) * width]);
                for (c, l) in c.iter_mut().zip(&L[i * m..i * m + i]) {
                    *c = -l;
                }
                add_rows(row, 0, above, &c[..i]);
                scale(row, 1.0 / L[i * m + i]);
            }
            for (i, row) in V.chunks_exact_mut(wx).enumerate() {
                row.copy_from_slice(&Qx[i * width + wu..(i + 1) * width]);
                put_column(&mut c[..m], Y, wx, i, -1.0);
                add_rows(row, i / 4, Y, &c[..m]);
            }
            let K = &mut self.feedback[k * nu * wx..(k + 1) * nu * wx];
            K.fill([0.0; 4]);
            for i in (0..m).rev() {
                let (above, below) = Y[..m * wx].split_at_mut((i + 1) * wx);
                let row = &mut above[i * wx..];
                for (c, j) in c.iter_mut().zip(i + 1..m) {
                    *c = -L[j * m + i];
                }
                add_rows(row, 0, below, &c[..m - i - 1]);
                scale(row, 1.0 / L[i * m + i]);
                let free = program.free[i];
                for (to, from) in K[free * wx..(free + 1) * wx].as_flattened_mut().iter_mut().zip(row.as_flattened()) {
                    *to = -from;
                }
            }
            add_rows(q, wu, Qu, &program.x);
            v.copy_from_slice(&q[wu..].as_flattened()[..nx]);
            if mu > 0.0 {
                for (i, (v, row)) in v.iter_mut().zip(V.chunks_exact_mut(wx)).enumerate() {
                    put_column(&mut c[..nu], K, wx, i, -mu);
                    add_rows(row, i / 4, K, &c[..nu]);
                    *v += product(&c[..nu], &program.x);
                }
            }
            for i in 1..nx {
                let (above, row) = V.split_at_mut(i * wx);
                put_column(row.as_flattened_mut(), above, wx, i, 1.0);
            }
        }
        true
    }
}

const STAGE: &str = "optimal control";

fn lost(knot: usize, error: &DynamicsError) -> PlanError {
    PlanError::NoConvergence { stage: STAGE.into(), message: format!("the step from knot {knot} cannot be taken: {error}") }
}

fn copy(to: &mut State, from: &State) {
    to.q.copy_from_slice(&from.q);
    to.v.copy_from_slice(&from.v);
    to.z.copy_from_slice(&from.z);
    to.time = from.time;
}

/// `to - from`, as a tangent. Lengths were checked.
fn difference(system: &System, from: &State, to: &State, dx: &mut [f64]) {
    let n = from.v.len();
    let (q, rest) = dx.split_at_mut(n);
    if system.multibody().difference(&from.q, &to.q, q).is_err() {
        q.fill(f64::NAN);
    }
    let pairs = from.v.iter().zip(&to.v).chain(from.z.iter().zip(&to.z));
    for (d, (a, b)) in rest.iter_mut().zip(pairs) {
        *d = b - a;
    }
}

/// Moves a state along a tangent. Lengths were checked.
fn add(system: &System, state: &mut State, dx: &[f64], factor: f64) {
    let n = state.v.len();
    if system.multibody().integrate(&mut state.q, &dx[..n], factor).is_err() {
        state.q.fill(f64::NAN);
    }
    for (x, d) in state.v.iter_mut().chain(&mut state.z).zip(&dx[n..]) {
        *x += factor * d;
    }
}

fn put(row: &mut [Lane], from: &[f64]) {
    for (to, from) in row.as_flattened_mut().iter_mut().zip(from) {
        *to = *from;
    }
}

fn gather(to: &mut [f64], from: &[f64], at: &[usize]) {
    for (to, at) in to.iter_mut().zip(at) {
        *to = from[*at];
    }
}

/// Adds those entries of a row that stand for linked positions.
fn add_linked(to: &mut [Lane], row: &[Lane], links: &[Lane]) {
    for ((to, x), link) in to.as_flattened_mut().iter_mut().zip(row.as_flattened()).zip(links.as_flattened()) {
        *to += x * link;
    }
}

fn scale(row: &mut [Lane], factor: f64) {
    for x in row.as_flattened_mut() {
        *x *= factor;
    }
}

fn product(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// `x . A y`.
fn form(A: &DMatrix<f64>, x: &[f64], y: &[f64]) -> f64 {
    A.as_slice().chunks_exact(x.len()).zip(y).map(|(column, y)| y * product(column, x)).sum()
}
