//! One step in time, semi-implicit: velocities first, then positions along the new velocities.
//!
//! With the step `h`, next velocities `w`, and everything taken at the old state unless said otherwise:
//!
//! `M (w - v) = h (tau - c - g + J^T F_ext - dtau(q + h w, w)) + impulses of dry friction, stops and limits`.
//!
//! Smooth effects are linearised about a `w`, where their slope is positive, so that stiff springs and strong dampers are stable
//! at any step. Dry friction, stops and limits are exact, by the convex problem of [`crate::complementarity`] with
//! `A = M + h D + h^2 K`. Where an effect is no linear function of `w`, the problem is written about its own solution again
//! until that stays: Newton's method where forces grow with `w`, and a fixed point where they fall. The step's derivatives are
//! then those of its effects at the solution.
//!
//! Coriolis forces are quadratic in the velocity. Taken at `v` they feed energy into fast turning, at a rate that grows with
//! `h |v|^2`; taken at `(v + w) / 2` the leading error of the energy is a total derivative in time, so it stays bounded.
//! [`Coriolis::AtMidpoint`] solves the step once with `c(q, v)` for a first `w`, then once more with `c(q, (v + w) / 2)`.

use crate::algorithms::pendulum::Pendulum;
use crate::complementarity::{Held, Problem};
use crate::contact::solver::ContactWorkspace;
use crate::effects::Row;
use crate::error::check;
use crate::placed::{BaseMotion, Taken};
use crate::residual::ResidualWorkspace;
use crate::reverse::Solve;
use crate::{ContactPoint, DynamicsError, Input, State, System, Workspace};

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

/// A step is solved again at most this often for forces that are no linear function of the next velocity.
const REFINEMENTS: usize = 100;

/// It goes slowly where a round leaves more than this share of what it found, and is given up after so many rounds without half of the least.
const SLOW: f64 = 0.1;
const PATIENCE: usize = 12;

/// Next velocities have settled when a solution changes them by no more than this, over their size.
const SETTLED: f64 = 1e-12;

/// Where they still move by more than this when rounds run out, the step is an error. It lies well above what the solver with
/// contacts leaves, and far below what a measurement could tell.
const UNSETTLED: f64 = 1e-8;

/// Everything that changes while one system is stepped. Made once by [`System::workspace`].
#[derive(Debug, Clone)]
pub struct StepWorkspace {
    pub(crate) rigid: Workspace,
    pub(crate) problem: Problem,
    pub(crate) load: Vec<f64>,
    midpoint_load: Vec<f64>,
    /// Impulses of the Coriolis forces beyond those at the start.
    more: Vec<f64>,
    /// The next velocities about which the problem is written.
    next: Vec<f64>,
    /// Of the last two rounds by degree of freedom: the solution, and how far it is from what it was written about.
    answers: Vec<[[f64; 2]; 2]>,
    pub(crate) tau: Vec<f64>,
    pub(crate) seen: Vec<f64>,
    pub(crate) bases: Vec<BaseMotion>,
    pub(crate) pendulum: Option<Pendulum>,
    q: Vec<f64>,
    pub(crate) z: Vec<f64>,
    /// The first of two solves, for the reverse pass.
    pub(crate) first: Solve,
    pub(crate) residual: Option<ResidualWorkspace>,
    pub(crate) contact: Option<Box<ContactWorkspace>>,
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
            more: vec![0.0; n],
            next: vec![0.0; n],
            answers: vec![[[0.0; 2]; 2]; n],
            tau: vec![0.0; n],
            seen: vec![0.0; system.placements().len()],
            bases: system.sways.iter().map(|_| BaseMotion::new(n)).collect(),
            pendulum: None,
            q: vec![0.0; multibody.nq()],
            z: system.state().z,
            first: Solve::new(if system.solves_twice() { n } else { 0 }),
            residual: system.residual.as_ref().map(|r| r.workspace(n)),
            contact: system.contacts.as_ref().map(|c| Box::new(ContactWorkspace::new(c, n))),
        }
    }

    /// The workspace of the rigid bodies; put a state in before asking it anything.
    pub fn rigid(&mut self) -> &mut Workspace {
        &mut self.rigid
    }

    /// The workspace of the rigid bodies at a state, which is put in unless it is there already. A step may leave another one there.
    ///
    /// # Errors
    /// As [`crate::Multibody::set_state`].
    pub fn rigid_at(&mut self, system: &System, state: &State) -> Result<&mut Workspace, DynamicsError> {
        if self.rigid.q != state.q || self.rigid.v != state.v {
            system.multibody().set_state(&mut self.rigid, &state.q, &state.v)?;
        }
        Ok(&mut self.rigid)
    }

    /// The contact points of the last step.
    pub fn contacts<'a>(&'a self, system: &'a System) -> impl Iterator<Item = ContactPoint<'a>> + 'a {
        let found = system.contacts.as_deref().zip(self.contact.as_deref());
        found.into_iter().flat_map(|(contacts, ws)| ws.list(contacts))
    }

    /// Rounds of Newton's method that the contacts of the last step took; 0 without contact.
    pub fn rounds(&self) -> usize {
        self.contact.as_ref().map_or(0, |c| c.rounds)
    }

    /// The inputs that reached the joints in the last step.
    pub fn reached(&self) -> &[f64] {
        &self.tau
    }

    /// What came into each change of the command in the last step, by placement.
    pub fn seen(&self) -> &[f64] {
        &self.seen
    }

    /// Force of gravity, Coriolis and external forces at the start of the last step.
    pub fn load(&self) -> &[f64] {
        &self.load
    }

    /// Did dry friction or a stop act on a degree of freedom in the last step? Without, its motion is smooth, whichever way it goes.
    pub fn rubs(&self, k: usize) -> bool {
        self.problem.dry[k] != [0.0; 2] || self.problem.hinges.iter().any(|h| h.k == k)
    }

    /// What is left of the impulses of dry friction, N s or N m s, that stand against a positive and against a negative motion of a degree of
    /// freedom which they held in the last step. Says nothing of one that they did not hold.
    pub fn spare(&self, k: usize) -> [f64; 2] {
        let Problem { n, A, b, v, dry, .. } = &self.problem;
        let needed = b[k] - A[k * n..(k + 1) * n].iter().zip(v).map(|(a, v)| a * v).sum::<f64>();
        [dry[k][0] - needed, dry[k][1] + needed]
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
        if ws.problem.n != n
            || ws.z.len() != state.z.len()
            || ws.problem.stops() != self.stops
            || ws.residual.is_some() != self.residual.is_some()
            || ws.seen.len() != self.placements().len()
            || (self.solves_twice() && ws.first.w.len() != n)
        {
            return Err(DynamicsError::ForeignWorkspace);
        }
        self.check_state(state)?;
        if input.tau.is_empty() {
            ws.tau.fill(0.0);
        } else {
            check("tau", input.tau, n)?;
            match (&mut ws.tau[..], input.tau) {
                // Nearly all steps of a search for what a model lacks are of one joint.
                ([tau], [given]) => *tau = *given,
                (tau, given) => tau.copy_from_slice(given),
            }
        }
        if self.steps_as_pendulum(input) {
            self.load_pendulum(ws, state)?;
            if self.residual.is_none() {
                return self.step_pendulum(ws, state, dt);
            }
        } else {
            multibody.set_state(&mut ws.rigid, &state.q, &state.v)?;
            multibody.gather_external(&mut ws.rigid, input.external)?;
            multibody.newton_euler(&mut ws.rigid, None, true, &mut ws.load);
            for load in &mut ws.load {
                *load = -*load;
            }
            multibody.composite(&mut ws.rigid);
            self.gather_bases(&ws.rigid, &mut ws.bases);
        }
        self.drive(ws, state, dt);
        ws.more.fill(0.0);
        ws.next.copy_from_slice(&state.v);
        self.prepare(&mut ws.problem, state, dt);
        self.assemble(ws, state, dt);
        ws.problem.v.copy_from_slice(&state.v);
        check("the forces of the step", &ws.problem.b, n)?;
        self.solve(ws, dt, false)?;
        self.refine(ws, state, dt)?;
        if self.solves_twice() {
            self.correct(ws, state, dt)?;
            self.refine(ws, state, dt)?;
        }
        check("the next velocities", &ws.problem.v, n)?;
        ws.q.copy_from_slice(&state.q);
        multibody.integrate(&mut ws.q, &ws.problem.v, dt)?;
        check("the next positions", &ws.q, multibody.nq())?;
        let taken = Taken { state, next: &ws.problem.v, tau: &ws.tau, seen: &ws.seen, load: &ws.load, dt };
        self.advance(&taken, &mut ws.z);
        self.advance_bases(ws, state, dt);
        check("the next inner states", &ws.z, ws.z.len())?;
        state.q.copy_from_slice(&ws.q);
        state.v.copy_from_slice(&ws.problem.v);
        state.z.copy_from_slice(&ws.z);
        state.time += dt;
        Ok(())
    }

    /// Is all of the rigid part in a [`Pendulum`]'s constants?
    pub(crate) fn steps_as_pendulum(&self, input: &Input<'_>) -> bool {
        self.multibody().is_pendulum() && input.external.is_empty() && self.contacts.is_none()
    }

    /// Load and mass of a pendulum, without the rigid workspace.
    fn load_pendulum(&self, ws: &mut StepWorkspace, state: &State) -> Result<(), DynamicsError> {
        check("q", &state.q, 1)?;
        check("v", &state.v, 1)?;
        if ws.pendulum.as_ref().is_none_or(|pendulum| pendulum.stamp != self.stamp) {
            ws.pendulum = Some(self.multibody().pendulum(&mut ws.rigid, self.stamp));
            self.prepare_bases(&mut ws.rigid, &mut ws.bases);
        }
        if let Some(pendulum) = &mut ws.pendulum {
            ws.load[0] = -pendulum.gravity_again(state.q[0]);
            ws.rigid.M[(0, 0)] = pendulum.mass;
        }
        self.gather_under_pendulum(state, &mut ws.bases);
        Ok(())
    }

    /// Solves the step once more, with what depends on the velocity that was found: the Coriolis forces half way to it, and
    /// the learned residual.
    fn correct(&self, ws: &mut StepWorkspace, state: &State, dt: f64) -> Result<(), DynamicsError> {
        ws.first.keep(&ws.problem);
        let (mut change, mut size) = (0.0_f64, 0.0_f64);
        if self.half_way() {
            for (mid, (v, w)) in ws.rigid.v.iter_mut().zip(state.v.iter().zip(&ws.problem.v)) {
                *mid = 0.5 * (v + w);
            }
            self.multibody().velocities(&mut ws.rigid);
            self.multibody().newton_euler(&mut ws.rigid, None, true, &mut ws.midpoint_load);
            for (k, mid) in ws.midpoint_load.iter().enumerate() {
                let more = dt * (-mid - ws.load[k]);
                ws.more[k] += more;
                ws.problem.b[k] += more;
                change = change.max(more.abs());
                size = size.max(ws.problem.b[k].abs());
            }
        }
        if let (Some(placed), Some(residual)) = (&self.residual, &mut ws.residual) {
            placed.force(residual, &state.q, &state.v, &ws.tau, &ws.first.w, dt);
            for ((b, more), f) in ws.problem.b.iter_mut().zip(&mut ws.more).zip(&residual.force) {
                *b += dt * f;
                *more += dt * f;
                change = change.max((dt * f).abs());
                size = size.max(b.abs());
            }
        }
        // Joints that do not disturb one another end here.
        if change <= 1e-15 * size {
            return Ok(());
        }
        check("the forces of the step", &ws.problem.b, ws.problem.n)?;
        self.solve(ws, dt, true)
    }

    /// Solves the step's problem with all that touches. `again`: for other forces in the same state.
    fn solve(&self, ws: &mut StepWorkspace, dt: f64, again: bool) -> Result<(), DynamicsError> {
        match (&self.contacts, &mut ws.contact) {
            (None, None) => ws.problem.solve(),
            (Some(contacts), Some(contact)) if contact.fits(contacts) => {
                if !again {
                    contact.find(contacts, self.multibody(), &ws.rigid, dt);
                }
                contact.solve(contacts, &mut ws.problem, again)
            }
            _ => Err(DynamicsError::ForeignWorkspace),
        }
    }

    /// Solves the step again about its own solution, until that stays: see [`Rounds`].
    fn refine(&self, ws: &mut StepWorkspace, state: &State, dt: f64) -> Result<(), DynamicsError> {
        if !self.nonlinear {
            return Ok(());
        }
        let mut rounds = Rounds::default();
        loop {
            let moved = ws.problem.v.iter().zip(&ws.next).map(|(w, old)| moved(*w, *old)).fold(0.0, f64::max);
            let Some(slow) = rounds.go_on(moved)? else { return Ok(()) };
            for k in 0..ws.next.len() {
                let answer = ws.problem.v[k];
                let off = answer - ws.next[k];
                ws.answers[k] = [ws.answers[k][1], [answer, off]];
            }
            let share = if slow { secant(&ws.answers) } else { 0.0 };
            for (next, [old, new]) in ws.next.iter_mut().zip(&ws.answers) {
                *next = new[0] - share * (new[0] - old[0]);
            }
            self.assemble(ws, state, dt);
            check("the forces of the step", &ws.problem.b, ws.problem.n)?;
            self.solve(ws, dt, true)?;
        }
    }

    /// Writes what of the step's problem stays, about whatever next velocities it is written.
    fn prepare(&self, problem: &mut Problem, state: &State, dt: f64) {
        problem.before.copy_from_slice(&self.multibody().before);
        problem.coupled = !self.sways.is_empty();
        problem.walls.fill([f64::NEG_INFINITY, f64::INFINITY]);
        for joint in self.multibody().joints() {
            if joint.v.len() == 1 {
                let k = joint.v.start;
                problem.walls[k] = reach(self.walls[k], state.q[joint.q.start], dt);
            }
        }
    }

    /// The same for one body alone.
    fn prepare_pendulum(&self, problem: &mut Problem, q: f64, dt: f64) {
        problem.before[0] = self.multibody().before[0];
        problem.coupled = !self.sways.is_empty();
        problem.walls[0] = reach(self.walls[0], q, dt);
    }

    /// Writes the rest of the convex problem of the step about the next velocities `ws.next`.
    fn assemble(&self, ws: &mut StepWorkspace, state: &State, dt: f64) {
        let n = self.multibody().nv();
        let problem = &mut ws.problem;
        problem.A.copy_from_slice(ws.rigid.M.as_slice());
        for (k, (b, row)) in problem.b.iter_mut().zip(problem.A.chunks_exact(n.max(1))).enumerate() {
            let momentum: f64 = row.iter().zip(&state.v).map(|(m, v)| m * v).sum();
            *b = momentum + dt * (ws.tau[k] + ws.load[k]) + ws.more[k];
        }
        problem.dry.fill([0.0; 2]);
        problem.hinges.clear();
        let taken = Taken { state, next: &ws.next, tau: &ws.tau, seen: &ws.seen, load: &ws.load, dt };
        for &i in &self.resisting {
            let placed = &self.placements()[i];
            let k = placed.v;
            let (at, stops) = (k * n + k, &mut problem.hinges);
            let mut row = Row { a: problem.A[at], b: problem.b[k], dry: problem.dry[k], stops, k, next: ws.next[k], dt };
            self.add_force(placed, &taken, &mut row);
            (problem.A[at], problem.b[k], problem.dry[k]) = (row.a, row.b, row.dry);
        }
        self.add_bases(ws, state, dt);
    }

    /// The step of one body alone, from its load and its mass on: all of it in numbers, not vectors.
    fn step_pendulum(&self, ws: &mut StepWorkspace, state: &mut State, dt: f64) -> Result<(), DynamicsError> {
        self.drive(ws, state, dt);
        self.prepare_pendulum(&mut ws.problem, state.q[0], dt);
        let v = state.v[0];
        let mass = ws.rigid.M[(0, 0)];
        let momentum = mass * v + dt * (ws.tau[0] + ws.load[0]);
        let (mut next, mut rounds, mut answers, mut between) = (v, Rounds::default(), [[[0.0; 2]; 2]], Between::default());
        loop {
            let taken = Taken { state, next: &[next], tau: &ws.tau, seen: &ws.seen, load: &ws.load, dt };
            ws.problem.hinges.clear();
            let mut row = Row { a: mass, b: momentum, dry: [0.0; 2], stops: &mut ws.problem.hinges, k: 0, next, dt };
            for &i in &self.resisting {
                self.add_force(&self.placements()[i], &taken, &mut row);
            }
            let Row { a, b, dry, .. } = row;
            (ws.problem.A[0], ws.problem.b[0], ws.problem.dry[0]) = (a, b, dry);
            self.add_bases(ws, state, dt);
            check("the forces of the step", &ws.problem.b, 1)?;
            let answer = ws.problem.slide_single()?;
            if !self.nonlinear {
                break;
            }
            if between.gets_on(next, answer - next) {
                rounds.has_got_on();
            }
            let Some(slow) = rounds.go_on(moved(answer, next))? else { break };
            answers[0] = [answers[0][1], [answer, answer - next]];
            let [old, new] = answers[0];
            let share = if slow { secant(&answers) } else { 0.0 };
            let straight = new[0] - share * (new[0] - old[0]);
            next = between.next(straight, slow);
        }
        ws.problem.hold_single();
        check("the next velocities", &ws.problem.v, 1)?;
        let w = ws.problem.v[0];
        let q = state.q[0] + w * dt;
        check("the next positions", &[q], 1)?;
        if !ws.z.is_empty() {
            let taken = Taken { state, next: &[w], tau: &ws.tau, seen: &ws.seen, load: &ws.load, dt };
            self.advance(&taken, &mut ws.z);
            self.advance_bases(ws, state, dt);
            check("the next inner states", &ws.z, ws.z.len())?;
            state.z.copy_from_slice(&ws.z);
        }
        (state.q[0], state.v[0]) = (q, w);
        state.time += dt;
        Ok(())
    }
}

/// The velocities with which a joint comes to its limits within a step; from beyond them over several.
#[inline]
fn reach([lower, upper]: [f64; 2], q: f64, dt: f64) -> [f64; 2] {
    let within = |room: f64, outside: bool| if outside { room / (RECOVERY_STEPS * dt) } else { room / dt };
    [within(lower - q, q < lower), within(upper - q, q > upper)]
}

/// How far a next velocity is from the one about which its step was written, over its size.
#[inline]
fn moved(w: f64, old: f64) -> f64 {
    (w - old).abs() / (1.0 + w.abs())
}

/// How a step comes to its solution: written about its own solution again, until that stays. Where that goes slowly, as with a friction that
/// falls steeply, by secants (Anderson 1965, over two rounds). Where it does not stay, a force jumps or falls so steeply within the step
/// that the step has no solution that its derivatives could stand on; that is an error, and a shorter step helps.
#[derive(Debug)]
struct Rounds {
    round: usize,
    /// By how much the last round moved it, and the least of all.
    moved: f64,
    least: f64,
    /// Rounds without half of the least.
    waited: usize,
}

impl Default for Rounds {
    fn default() -> Self {
        Self { round: 0, moved: 0.0, least: f64::INFINITY, waited: 0 }
    }
}

impl Rounds {
    /// A round brought the solution nearer though it moved by no less.
    #[inline]
    fn has_got_on(&mut self) {
        self.waited = 0;
    }

    /// Whether another round is needed after one that moved by so much, and if so, whether it goes slowly.
    #[inline]
    fn go_on(&mut self, moved: f64) -> Result<Option<bool>, DynamicsError> {
        let fast = self.round > 0 && moved <= SLOW * self.moved;
        // Where rounds fall that fast, the next would move by no more than the same share of this one.
        if moved <= SETTLED || fast && moved * moved <= SETTLED * self.moved {
            return Ok(None);
        }
        self.waited = if moved < 0.5 * self.least { 0 } else { self.waited + 1 };
        self.least = self.least.min(moved);
        let slow = self.round > 1 && !fast;
        (self.moved, self.round) = (moved, self.round + 1);
        if self.waited <= PATIENCE && self.round <= REFINEMENTS {
            return Ok(Some(slow));
        }
        if moved <= UNSETTLED {
            return Ok(None);
        }
        Err(DynamicsError::NoConvergence { what: "the effects of the step", residual: moved, iterations: REFINEMENTS })
    }
}

/// Answers that run on are followed by so many leaps, each twice the last: what has not turned by then does not, and must not overflow.
const LEAPS: i32 = 10;

/// Two next velocities of one joint between which that one lies that stays, as one is answered with more and the other with less. Where a joint
/// breaks away the answer is flat on one side and falls steeply on the other, and secants through neighbours leave for nowhere: those between the
/// ends do not, with the end that stays weighed by half each time (Dowell and Jarratt 1971, the Illinois method).
#[derive(Debug, Default)]
struct Between {
    /// Velocity and what its answer has more, where that is positive and where it is not.
    ends: [Option<[f64; 2]>; 2],
    last: usize,
    /// The least way between the ends of which half was not yet reached.
    width: f64,
    /// It was slow while both ends were known.
    is_closing: bool,
    /// How many times answers ran on, ever further, from a velocity that would not stay.
    ran: i32,
}

impl Between {
    /// Takes an answer. Is the way between the ends half of what it was, or is there none yet and answers run on to one?
    fn gets_on(&mut self, next: f64, more: f64) -> bool {
        let side = usize::from(more <= 0.0);
        let stays = side == self.last;
        let runs = stays && self.ends[side].is_some_and(|[_, before]| more.abs() > before.abs());
        self.ran = if runs { self.ran + 1 } else { 0 };
        if stays && let Some([_, weight]) = &mut self.ends[1 - side] {
            *weight *= 0.5;
        }
        (self.ends[side], self.last) = (Some([next, more]), side);
        let [Some([a, _]), Some([b, _])] = self.ends else { return runs && self.ran <= LEAPS };
        let width = (a - b).abs();
        let narrow = self.width > 0.0 && width <= 0.5 * self.width;
        if narrow || self.width == 0.0 {
            self.width = width;
        }
        narrow
    }

    /// Where to look next, if rounds would there: so many times as far where they run on, and on the line between the ends once these are known
    /// and it is slow, or would be outside of them.
    fn next(&mut self, there: f64, slow: bool) -> f64 {
        match self.ends {
            [Some([a, above]), Some([b, below])] => {
                self.is_closing |= slow;
                let inside = (there - a) * (there - b) < 0.0;
                if inside && !self.is_closing { there } else { (a * below - b * above) / (below - above) }
            }
            [Some([x, more]), None] | [None, Some([x, more])] if self.ran > 0 => x + 2f64.powi(self.ran.min(LEAPS)) * more,
            _ => there,
        }
    }
}

/// By which share of the way back to the round before the last the last one's answer is too far, if both are taken as linear.
fn secant(answers: &[[[f64; 2]; 2]]) -> f64 {
    let (mut along, mut size) = (0.0, 0.0);
    for [[_, old], [_, new]] in answers {
        let change = new - old;
        along += new * change;
        size += change * change;
    }
    let share = along / size;
    // From one on, rounds lead away from the solution: it is not one that would stay.
    if share < 1.0 { share } else { 0.0 }
}
