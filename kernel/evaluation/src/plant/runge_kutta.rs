//! The classical Runge-Kutta scheme of fourth order with fixed small steps, and exact instants for dry friction: a joint slides
//! forwards, slides backwards or sticks, and a step ends where a sliding joint comes to rest.

use nalgebra::{DMatrix, DVector};

use super::{Mechanism, Plant, Rigid};
use crate::EvaluationError;
use crate::effect::{At, Hold};

/// See the module's page.
pub(crate) struct RungeKutta {
    mechanism: Mechanism,
    rigid: Rigid,
    n: usize,
    /// Where the inner states of each joint begin in `x`.
    place: Vec<usize>,
    dry: Vec<bool>,
    /// Positions, velocities, inner states.
    x: X,
    /// Number of states in use.
    states: usize,
    /// -1 and 1: slides, 0: sticks.
    mode: Vec<i8>,
    t: f64,
    /// Longest step, s.
    longest: f64,
}

/// Room for joints and for states: on the stack, for the loop runs millions of times.
const JOINTS: usize = 12;
/// See [`JOINTS`].
const STATES: usize = 48;
type X = [f64; STATES];

/// Rates of a state, and for joints that stick the force that holds them, and what it may be.
struct Rates {
    dx: X,
    held: [f64; JOINTS],
    bound: [[f64; 2]; JOINTS],
}

impl RungeKutta {
    /// # Errors
    /// A mechanism that is no tree of hinges and slides, or has too many of them.
    pub(crate) fn new(mechanism: Mechanism, longest: f64) -> Result<Self, EvaluationError> {
        let rigid = Rigid::new(&mechanism.model)?;
        let n = mechanism.joints.len();
        let mut place = Vec::with_capacity(n + 1);
        let mut next = 2 * n;
        for joint in &mechanism.joints {
            place.push(next);
            next += joint.states();
        }
        place.push(next);
        if n > JOINTS || next > STATES {
            return Err(EvaluationError::Model { message: format!("it has {n} joints and {next} states, more than there is room for") });
        }
        let dry = mechanism.joints.iter().map(super::JointPhysics::is_dry).collect();
        let mut plant = Self { mechanism, rigid, n, place, dry, x: [0.0; STATES], states: next, mode: vec![0; n], t: 0.0, longest };
        plant.reset(0.0, &vec![0.0; n], &vec![0.0; n]);
        Ok(plant)
    }

    fn rates(&self, t: f64, x: &X, hold: &[Hold]) -> Rates {
        let n = self.n;
        let (q, v) = (&x[..n], &x[n..2 * n]);
        let mut out = Rates { dx: [0.0; STATES], held: [0.0; JOINTS], bound: [[0.0; 2]; JOINTS] };
        out.dx[..n].copy_from_slice(v);
        let mut tau = [0.0; JOINTS];
        if let Rigid::One { .. } = self.rigid {
            let (mass, bias) = self.rigid.one(q[0]);
            tau[0] = self.push(0, t, x, hold, bias, &mut out) - bias;
            if self.dry[0] && self.mode[0] == 0 {
                out.held[0] = tau[0];
            } else {
                out.dx[1] = tau[0] / (mass + self.mechanism.joints[0].armature);
            }
            return out;
        }
        let (mut M, bias) = self.rigid.at(q, v);
        for i in 0..n {
            tau[i] = self.push(i, t, x, hold, bias[i], &mut out) - bias[i];
            M[(i, i)] += self.mechanism.joints[i].armature;
        }
        let stuck = |i: usize| self.dry[i] && self.mode[i] == 0;
        let free: Vec<usize> = (0..n).filter(|&i| !stuck(i)).collect();
        let small = DMatrix::from_fn(free.len(), free.len(), |r, c| M[(free[r], free[c])]);
        let right = DVector::from_fn(free.len(), |r, _| tau[free[r]]);
        let a = small.cholesky().map_or_else(|| DVector::from_element(free.len(), f64::NAN), |c| c.solve(&right));
        for (k, &i) in free.iter().enumerate() {
            out.dx[n + i] = a[k];
        }
        for i in (0..n).filter(|&i| stuck(i)) {
            out.held[i] = tau[i] - free.iter().enumerate().map(|(k, &j)| M[(i, j)] * a[k]).sum::<f64>();
        }
        out
    }

    /// The force on a joint but for the bias, with the rates of its inner states and the bound of its dry friction.
    fn push(&self, i: usize, t: f64, x: &X, hold: &[Hold], bias: f64, out: &mut Rates) -> f64 {
        let joint = &self.mechanism.joints[i];
        let at = At { q: x[i], v: x[self.n + i], effort: 0.0, load: -bias, t };
        let (from, to) = (self.place[i], self.place[i + 1]);
        let acting = joint.acting(at, hold[i], &x[from..to]);
        if to > from {
            joint.rates(at, hold[i], &x[from..to], &mut out.dx[from..to]);
        }
        out.bound[i] = acting.dry;
        let rubbing = match self.mode[i] {
            _ if !self.dry[i] => 0.0,
            1 => acting.dry[0],
            -1 => -acting.dry[1],
            _ => 0.0,
        };
        acting.effort - acting.damping * at.v - rubbing
    }

    fn trial(&self, h: f64, hold: &[Hold]) -> X {
        let at = |by: f64, dx: &X| {
            let mut x = self.x;
            for i in 0..self.states {
                x[i] += by * dx[i];
            }
            x
        };
        let k1 = self.rates(self.t, &self.x, hold).dx;
        let k2 = self.rates(self.t + h / 2.0, &at(h / 2.0, &k1), hold).dx;
        let k3 = self.rates(self.t + h / 2.0, &at(h / 2.0, &k2), hold).dx;
        let k4 = self.rates(self.t + h, &at(h, &k3), hold).dx;
        let mut x = self.x;
        for i in 0..self.states {
            x[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
        x
    }

    /// Frees the joints whose friction can no longer hold them.
    fn release(&mut self, hold: &[Hold]) {
        for _ in 0..self.n {
            if !(0..self.n).any(|i| self.dry[i] && self.mode[i] == 0) {
                return;
            }
            let rates = self.rates(self.t, &self.x, hold);
            let excess = |i: usize| rates.held[i].abs() - rates.bound[i][usize::from(rates.held[i] < 0.0)];
            let first = (0..self.n)
                .filter(|&i| self.dry[i] && self.mode[i] == 0 && excess(i) > 0.0)
                .max_by(|&a, &b| excess(a).total_cmp(&excess(b)));
            let Some(first) = first else { return };
            self.mode[first] = if rates.held[first] < 0.0 { -1 } else { 1 };
        }
    }

    fn crosses(&self, x: &X) -> Option<usize> {
        (0..self.n).find(|&i| self.dry[i] && self.mode[i] != 0 && x[self.n + i] * f64::from(self.mode[i]) < 0.0)
    }

    fn step(&mut self, h: f64, hold: &[Hold]) -> Result<(), EvaluationError> {
        let end = self.t + h;
        // A joint that sticks and slips many times within a step takes the rest of it as it is.
        for round in 0..12 {
            let left = end - self.t;
            if left <= 1e-12 {
                break;
            }
            self.release(hold);
            let mut x = self.trial(left, hold);
            let mut taken = left;
            if round < 11 && self.crosses(&x).is_some() {
                // The first instant at which one comes to rest.
                let (mut low, mut high) = (0.0, left);
                for _ in 0..40 {
                    if high - low < 1e-10 {
                        break;
                    }
                    let middle = (low + high) / 2.0;
                    let inside = self.trial(middle, hold);
                    if self.crosses(&inside).is_some() {
                        (high, x) = (middle, inside);
                    } else {
                        low = middle;
                    }
                }
                taken = high;
            }
            self.x = x;
            self.t += taken;
            for i in 0..self.n {
                if self.dry[i] && self.mode[i] != 0 && self.x[self.n + i] * f64::from(self.mode[i]) < 0.0 {
                    self.x[self.n + i] = 0.0;
                    self.mode[i] = 0;
                }
            }
            for (i, joint) in self.mechanism.joints.iter().enumerate() {
                let (from, to) = (self.place[i], self.place[i + 1]);
                let q = self.x[i];
                joint.settle(q, &mut self.x[from..to]);
            }
        }
        self.t = end;
        if self.x.iter().any(|x| !x.is_finite()) {
            return Err(EvaluationError::Diverged { time: self.t });
        }
        Ok(())
    }
}

impl Plant for RungeKutta {
    fn reset(&mut self, t: f64, q: &[f64], v: &[f64]) {
        self.t = t;
        self.x[..self.n].copy_from_slice(q);
        self.x[self.n..2 * self.n].copy_from_slice(v);
        for (i, joint) in self.mechanism.joints.iter().enumerate() {
            joint.start(q[i], v[i], &mut self.x[self.place[i]..self.place[i + 1]]);
            self.mode[i] = if v[i] > 0.0 {
                1
            } else if v[i] < 0.0 {
                -1
            } else {
                0
            };
        }
    }

    fn advance(&mut self, until: f64, hold: &[Hold]) -> Result<(), EvaluationError> {
        let span = until - self.t;
        if span <= 0.0 {
            return Ok(());
        }
        let steps = (span / self.longest).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(span / steps, hold)?;
        }
        self.t = until;
        Ok(())
    }

    fn q(&self) -> &[f64] {
        &self.x[..self.n]
    }

    fn v(&self) -> &[f64] {
        &self.x[self.n..2 * self.n]
    }

    fn reading(&self, joint: usize) -> (f64, f64) {
        let z = &self.x[self.place[joint]..self.place[joint + 1]];
        self.mechanism.joints[joint].reading(self.x[joint], self.x[self.n + joint], z, self.t)
    }

    fn delivered(&self, joint: usize, hold: Hold) -> f64 {
        let z = &self.x[self.place[joint]..self.place[joint + 1]];
        let at = At { q: self.x[joint], v: self.x[self.n + joint], effort: 0.0, load: 0.0, t: self.t };
        self.mechanism.joints[joint].acting(at, hold, z).delivered
    }

    fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }
}
