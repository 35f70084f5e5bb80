//! One step in time, semi-implicit: velocities first, then positions along the new velocities.
//!
//! With the step `h`, next velocities `w`, and everything taken at the old state unless said otherwise:
//!
//! `M (w - v) = h (tau - c - g + J^T F_ext - dtau(q + h w, w)) + impulses of dry friction, stops and limits`.
//!
//! Smooth effects are linearised: `dtau(q + h w, w) = dtau + h K w + D (w - v)`, with stiffness `K` and damping `D` taken in where
//! they are positive, so that stiff springs and strong dampers are stable at any step. Dry friction, stops and limits are
//! exact, by the convex problem of [`crate::complementarity`] with `A = M + h D + h^2 K`.
//!
//! Coriolis forces are quadratic in the velocity. Taken at `v` they feed energy into fast turning, at a rate that grows with
//! `h |v|^2`; taken at `(v + w) / 2` the leading error of the energy is a total derivative in time, so it stays bounded.
//! [`Coriolis::AtMidpoint`] solves the step once with `c(q, v)` for a first `w`, then once more with `c(q, (v + w) / 2)`.

use crate::complementarity::{Held, Hinge, Problem};
use crate::error::check;
use crate::{DynamicsError, Input, State, System, Workspace};

/// At which velocity a step takes Coriolis and centrifugal forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Coriolis {
    /// At the velocity that the step starts from: one evaluation a step; energy grows in fast free motion.
    AtStart,
    /// Half way to the next velocity: two evaluations; energy stays bounded.
    #[default]
    AtMidpoint,
}

/// A joint beyond its limit is brought back over this many steps, and not with one blow.
pub(crate) const RECOVERY_STEPS: f64 = 10.0;

/// Everything that changes while one system is stepped. Made once by [`System::workspace`].
#[derive(Debug, Clone)]
pub struct StepWorkspace {
    pub(crate) rigid: Workspace,
    pub(crate) problem: Problem,
    pub(crate) load: Vec<f64>,
    midpoint_load: Vec<f64>,
    pub(crate) tau: Vec<f64>,
    /// The first of two solutions, with Coriolis forces at the start.
    pub(crate) first: Vec<f64>,
    pub(crate) first_held: Vec<Held>,
    q: Vec<f64>,
    z: Vec<f64>,
}

impl StepWorkspace {
    pub(crate) fn new(system: &System) -> Self {
        let multibody = system.multibody();
        let n = multibody.nv();
        Self {
            rigid: multibody.workspace(),
            problem: Problem::new(n, system.stops),
            load: vec![0.0; n],
            midpoint_load: vec![0.0; n],
            tau: vec![0.0; n],
            first: vec![0.0; n],
            first_held: vec![Held::Free; n],
            q: vec![0.0; multibody.nq()],
            z: system.state().z,
        }
    }

    /// The workspace of the rigid bodies; put a state in before asking it anything.
    pub fn rigid(&mut self) -> &mut Workspace {
        &mut self.rigid
    }

    /// What held each degree of freedom in the last step.
    pub fn held(&self) -> &[Held] {
        &self.problem.held
    }
}

impl System {
    /// Moves the state on by the time `dt` (s).
    ///
    /// A pure function of system, state and input: the same bits come out for the same bits in.
    ///
    /// # Errors
    /// A vector of the wrong length or with a number that is not finite; a step that is not positive; a joint that moves no
    /// inertia; motion that blows up. The state is then left as it was.
    pub fn step(&self, ws: &mut StepWorkspace, state: &mut State, input: &Input<'_>, dt: f64) -> Result<(), DynamicsError> {
        let multibody = self.multibody();
        let n = multibody.nv();
        if !(dt > 0.0 && dt.is_finite()) {
            return Err(DynamicsError::OutOfBounds { what: "the step".into(), value: dt, must: "a positive time in s".into() });
        }
        if ws.problem.n != n || ws.z.len() != state.z.len() || ws.problem.stops() != self.stops {
            return Err(DynamicsError::ForeignWorkspace);
        }
        self.check_state(state)?;
        if input.tau.is_empty() {
            ws.tau.fill(0.0);
        } else {
            check("tau", input.tau, n)?;
            ws.tau.copy_from_slice(input.tau);
        }
        multibody.set_state(&mut ws.rigid, &state.q, &state.v)?;
        multibody.gather_external(&mut ws.rigid, input.external)?;
        multibody.newton_euler(&mut ws.rigid, None, true, &mut ws.load);
        for load in &mut ws.load {
            *load = -*load;
        }
        multibody.composite(&mut ws.rigid);
        self.assemble(ws, state, dt);
        ws.problem.v.copy_from_slice(&state.v);
        check("the forces of the step", &ws.problem.b, n)?;
        ws.problem.solve()?;
        if self.coriolis == Coriolis::AtMidpoint {
            self.correct(ws, state, dt)?;
        }
        check("the next velocities", &ws.problem.v, n)?;
        ws.q.copy_from_slice(ws.rigid.q());
        multibody.integrate(&mut ws.q, &ws.problem.v, dt)?;
        check("the next positions", &ws.q, multibody.nq())?;
        ws.z.copy_from_slice(&state.z);
        for placed in self.placements() {
            let at = crate::effects::Instant {
                q: placed.q.map_or(0.0, |q| ws.q[q]),
                v: ws.problem.v[placed.v],
                input: ws.tau[placed.v],
                load: ws.load[placed.v],
                time: state.time + dt,
                z: &state.z[placed.z.clone()],
            };
            placed.effect.advance(&self.parameters()[placed.theta.clone()], &at, dt, &mut ws.z[placed.z.clone()]);
        }
        check("the next inner states", &ws.z, ws.z.len())?;
        state.q.copy_from_slice(&ws.q);
        state.v.copy_from_slice(&ws.problem.v);
        state.z.copy_from_slice(&ws.z);
        state.time += dt;
        Ok(())
    }

    /// Solves the step once more, with the Coriolis forces half way to the velocity that was found.
    fn correct(&self, ws: &mut StepWorkspace, state: &State, dt: f64) -> Result<(), DynamicsError> {
        ws.first.copy_from_slice(&ws.problem.v);
        ws.first_held.copy_from_slice(&ws.problem.held);
        for (mid, (v, w)) in ws.rigid.v.iter_mut().zip(state.v.iter().zip(&ws.problem.v)) {
            *mid = 0.5 * (v + w);
        }
        self.multibody().velocities(&mut ws.rigid);
        self.multibody().newton_euler(&mut ws.rigid, None, true, &mut ws.midpoint_load);
        let (mut change, mut size) = (0.0_f64, 0.0_f64);
        for (k, mid) in ws.midpoint_load.iter().enumerate() {
            let more = dt * (-mid - ws.load[k]);
            ws.problem.b[k] += more;
            change = change.max(more.abs());
            size = size.max(ws.problem.b[k].abs());
        }
        // Joints that do not disturb one another end here.
        if change <= 1e-15 * size {
            return Ok(());
        }
        check("the forces of the step", &ws.problem.b, ws.problem.n)?;
        ws.problem.solve()
    }

    /// Writes the convex problem of the step.
    fn assemble(&self, ws: &mut StepWorkspace, state: &State, dt: f64) {
        let n = self.multibody().nv();
        let problem = &mut ws.problem;
        problem.A.copy_from_slice(ws.rigid.M.as_slice());
        for k in 0..n {
            let momentum: f64 = (0..n).map(|j| problem.A[k * n + j] * state.v[j]).sum();
            problem.b[k] = momentum + dt * (ws.tau[k] + ws.load[k]);
            problem.dry[k] = 0.0;
            problem.walls[k] = [f64::NEG_INFINITY, f64::INFINITY];
        }
        for joint in self.multibody().joints() {
            if joint.v.len() == 1 {
                let (k, q) = (joint.v.start, state.q[joint.q.start]);
                let reach = |room: f64, outside: bool| if outside { room / (RECOVERY_STEPS * dt) } else { room / dt };
                let [lower, upper] = self.walls[k];
                problem.walls[k] = [reach(lower - q, q < lower), reach(upper - q, q > upper)];
            }
        }
        problem.hinges.clear();
        for placed in self.placements() {
            let resistance = self.resistance(placed, state, &ws.tau, &ws.load);
            let (k, smooth) = (placed.v, &resistance.smooth);
            let (stiffness, damping) = (smooth.d_q.max(0.0), smooth.d_v.max(0.0));
            problem.A[k * n + k] += dt * (damping + dt * stiffness);
            problem.b[k] += dt * (damping * state.v[k] - smooth.value);
            problem.dry[k] += dt * resistance.dry.value.max(0.0);
            if let Some(stop) = resistance.stop {
                problem.hinges.push(Hinge {
                    k,
                    side: stop.side,
                    offset: dt * stop.stiffness * stop.depth,
                    slope: dt * (stop.damping + dt * stop.stiffness),
                });
            }
        }
    }
}
