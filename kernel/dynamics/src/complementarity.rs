//! The convex problem of one step, in its next velocities:
//!
//! `minimise  v^T A v / 2 - b^T v + sum_k phi_k(v_k)`,  `lower_k <= v_k <= upper_k`,
//!
//! with `A` symmetric positive definite and each `phi_k` convex and piecewise quadratic: dry friction `f_k |v_k|`, and stops
//! `(s (side v - start))+^2 / (2 s)`. Its optimality conditions are the step's equations of motion with Coulomb's law and the
//! complementarity of limits, so it has one solution and that is the step (Anitescu 2006; Castro et al. 2022).
//!
//! Sweeps over single coordinates, each solved exactly, always go down; they find out which coordinates stick or stand at a
//! wall. With those held, the rest is a linear system. Its solution is taken where every coordinate confirms it.

use crate::DynamicsError;
use crate::linear::{cholesky, cholesky_solve};

const WHAT: &str = "the step's friction and limits";

/// A stop in the step's terms: it pushes with the impulse `(offset + slope side v)+` against `side`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Hinge {
    pub k: usize,
    pub side: f64,
    pub offset: f64,
    pub slope: f64,
}

impl Hinge {
    #[inline]
    fn push(&self, v: f64) -> f64 {
        self.side * (self.offset + self.slope * self.side * v).max(0.0)
    }
}

/// What holds a coordinate in the solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Held {
    /// Nothing: it moves.
    Free,
    /// Dry friction, at rest.
    Stuck,
    /// A limit.
    AtLimit,
}

/// The problem with its scratch, all allocated once.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub n: usize,
    /// Row-major.
    pub A: Vec<f64>,
    pub b: Vec<f64>,
    /// Impulses of dry friction.
    pub dry: Vec<f64>,
    pub walls: Vec<[f64; 2]>,
    pub hinges: Vec<Hinge>,
    /// Where the search starts, then the solution.
    pub v: Vec<f64>,
    pub held: Vec<Held>,
    /// Cholesky factor of the free coordinates' system, `free.len()` square: what the step's derivatives need again.
    pub factor: Vec<f64>,
    pub free: Vec<usize>,
    rhs: Vec<f64>,
    candidate: Vec<f64>,
    kinks: Vec<f64>,
    stops: usize,
}

impl Problem {
    pub fn new(n: usize, stops: usize) -> Self {
        Self {
            n,
            A: vec![0.0; n * n],
            b: vec![0.0; n],
            dry: vec![0.0; n],
            walls: vec![[f64::NEG_INFINITY, f64::INFINITY]; n],
            hinges: Vec::with_capacity(stops),
            v: vec![0.0; n],
            held: vec![Held::Free; n],
            factor: vec![0.0; n * n],
            free: Vec::with_capacity(n),
            rhs: vec![0.0; n],
            candidate: vec![0.0; n],
            kinks: Vec::with_capacity(stops + 1),
            stops,
        }
    }

    /// Number of stops that it has room for.
    pub fn stops(&self) -> usize {
        self.stops
    }

    /// Solves from the starting point `self.v`.
    pub fn solve(&mut self) -> Result<(), DynamicsError> {
        for k in 0..self.n {
            self.v[k] = self.v[k].max(self.walls[k][0]).min(self.walls[k][1]);
        }
        let mut residual = f64::INFINITY;
        let mut iterations = 0;
        for round in 0..60 {
            // Few sweeps at first; more where the set of held coordinates is hard to find.
            for _ in 0..(1 + round) {
                self.sweep();
                iterations += 1;
            }
            self.hold();
            self.reduced()?;
            std::mem::swap(&mut self.v, &mut self.candidate);
            residual = self.residual();
            if residual <= 1e-10 {
                return Ok(());
            }
            std::mem::swap(&mut self.v, &mut self.candidate);
        }
        Err(DynamicsError::NoConvergence { what: WHAT, residual, iterations })
    }

    /// One exact minimisation over each coordinate in turn.
    fn sweep(&mut self) {
        for k in 0..self.n {
            self.v[k] = self.minimise(k);
        }
    }

    /// How far each coordinate is from its own minimum, over its size.
    fn residual(&mut self) -> f64 {
        let mut worst = 0.0_f64;
        for k in 0..self.n {
            let best = self.minimise(k);
            let gap = (best - self.v[k]).abs() / (1.0 + best.abs());
            worst = if gap.is_nan() { f64::INFINITY } else { worst.max(gap) };
        }
        worst
    }

    /// The best `v_k` with the others as they are: the zero of an increasing, piecewise linear function.
    fn minimise(&mut self, k: usize) -> f64 {
        let (n, a) = (self.n, self.A[k * self.n + k]);
        let others: f64 = (0..n).filter(|j| *j != k).map(|j| self.A[k * n + j] * self.v[j]).sum();
        let r = self.b[k] - others;
        let [lower, upper] = self.walls[k];
        let dry = self.dry[k];
        let stopped = self.hinges.iter().any(|h| h.k == k);
        if !stopped {
            // a v + dry sgn(v) = r
            let v = if r > dry {
                (r - dry) / a
            } else if r < -dry {
                (r + dry) / a
            } else {
                0.0
            };
            return v.max(lower).min(upper);
        }
        // The function's corners: where dry friction jumps, and where stops begin to push.
        self.kinks.clear();
        self.kinks.push(0.0);
        for h in self.hinges.iter().filter(|h| h.k == k && h.slope > 0.0) {
            self.kinks.push(-h.side * h.offset / h.slope);
        }
        self.kinks.sort_unstable_by(f64::total_cmp);
        let hinges = &self.hinges;
        let smooth = |v: f64| a * v - r + hinges.iter().filter(|h| h.k == k).map(|h| h.push(v)).sum::<f64>();
        // On the line that holds `v`.
        let zero_near = |v: f64| {
            let (mut slope, mut right) = (a, r - dry.copysign(v));
            for h in hinges.iter().filter(|h| h.k == k && h.push(v) != 0.0) {
                slope += h.slope;
                right -= h.side * h.offset;
            }
            right / slope
        };
        let mut left = None;
        for &kink in &self.kinks {
            let value = smooth(kink);
            let before = value + if kink > 0.0 { dry } else { -dry };
            let after = value + if kink >= 0.0 { dry } else { -dry };
            if after >= 0.0 {
                let v = if before <= 0.0 { kink } else { zero_near(left.map_or(kink - 1.0, |l: f64| 0.5 * (l + kink))) };
                return v.max(lower).min(upper);
            }
            left = Some(kink);
        }
        zero_near(left.unwrap_or(0.0) + 1.0).max(lower).min(upper)
    }

    fn hold(&mut self) {
        self.free.clear();
        for k in 0..self.n {
            let (v, [lower, upper]) = (self.v[k], self.walls[k]);
            self.held[k] = if v <= lower || v >= upper {
                Held::AtLimit
            } else if v == 0.0 && self.dry[k] > 0.0 {
                Held::Stuck
            } else {
                self.free.push(k);
                Held::Free
            };
        }
    }

    /// Solves for the free coordinates on the pieces on which they stand.
    fn reduced(&mut self) -> Result<(), DynamicsError> {
        let (n, m) = (self.n, self.free.len());
        self.candidate.copy_from_slice(&self.v);
        for (i, &k) in self.free.iter().enumerate() {
            let mut r = self.b[k] - self.dry[k] * if self.v[k] == 0.0 { 0.0 } else { self.v[k].signum() };
            for j in 0..n {
                if self.held[j] != Held::Free {
                    r -= self.A[k * n + j] * self.v[j];
                }
            }
            for (l, &j) in self.free.iter().enumerate() {
                self.factor[i * m + l] = self.A[k * n + j];
            }
            for h in self.hinges.iter().filter(|h| h.k == k) {
                if h.push(self.v[k]) != 0.0 {
                    self.factor[i * m + i] += h.slope;
                    r -= h.side * h.offset;
                }
            }
            self.rhs[i] = r;
        }
        cholesky(&mut self.factor, m).map_err(|_| DynamicsError::NoConvergence { what: WHAT, residual: f64::INFINITY, iterations: 0 })?;
        cholesky_solve(&self.factor, m, &mut self.rhs[..m]);
        for (i, &k) in self.free.iter().enumerate() {
            self.candidate[k] = self.rhs[i];
        }
        Ok(())
    }
}
