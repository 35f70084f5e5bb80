//! The convex problem of one step, in its next velocities:
//!
//! `minimise  v^T A v / 2 - b^T v + sum_k phi_k(v_k)`,  `lower_k <= v_k <= upper_k`,
//!
//! with `A` symmetric positive definite and each `phi_k` convex and piecewise quadratic: dry friction `f+ max(v_k, 0) + f- max(-v_k, 0)`
//! (a bound for each direction of motion, neither negative; between `f+` and `-f-` at rest), and stops
//! `(s (side v - start))+^2 / (2 s)`. Its optimality conditions are the step's equations of motion with Coulomb's law and the
//! complementarity of limits, so it has one solution and that is the step (Anitescu 2006; Castro et al. 2022).
//!
//! Once it is known which coordinates stick or stand at a wall, which way the others slide, and which stops push, the rest is a linear
//! system, and where its solution stays on those pieces it is the problem's. The first guess is that of the starting point: a step
//! seldom changes them. Where that is wrong, sweeps over single coordinates, each solved exactly, always go down; they find out.
//!
//! `A` has the zeros of the tree's branches, and its factor keeps them, unless something couples the branches.

use crate::DynamicsError;
use crate::linear::{before_among, into_lanes, tree_factor, tree_solve};
use crate::workspace::Lane;

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
    pub fn push(&self, v: f64) -> f64 {
        self.side * (self.offset + self.slope * self.side * v).max(0.0)
    }
}

/// Where `a v + dry sgn(v) = r`, between walls.
#[inline]
pub(crate) fn slide(a: f64, r: f64, [forward, backward]: [f64; 2], [lower, upper]: [f64; 2]) -> f64 {
    let v = if r > forward {
        (r - forward) / a
    } else if r < -backward {
        (r + backward) / a
    } else {
        0.0
    };
    v.max(lower).min(upper)
}

/// Impulse of dry friction on motion at `v`; at rest it counts as zero.
#[inline]
pub(crate) fn rub([forward, backward]: [f64; 2], v: f64) -> f64 {
    if v > 0.0 {
        forward
    } else if v < 0.0 {
        -backward
    } else {
        0.0
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
    /// Impulses of dry friction against positive and against negative motion.
    pub dry: Vec<[f64; 2]>,
    pub walls: Vec<[f64; 2]>,
    pub hinges: Vec<Hinge>,
    /// Where the search starts, then the solution.
    pub v: Vec<f64>,
    pub held: Vec<Held>,
    /// [`tree_factor`] of the free coordinates' system, `free.len()` square: what the step's derivatives need again.
    pub factor: Vec<Lane>,
    pub free: Vec<usize>,
    /// By coordinate: the one that it stands on, plus one, as [`tree_factor`] asks; not looked at where any two may be coupled.
    pub before: Vec<usize>,
    pub coupled: bool,
    /// The same for the free coordinates alone.
    free_before: Vec<usize>,
    /// `A v - b`.
    g: Vec<f64>,
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
            dry: vec![[0.0; 2]; n],
            walls: vec![[f64::NEG_INFINITY, f64::INFINITY]; n],
            hinges: Vec::with_capacity(stops),
            v: vec![0.0; n],
            held: vec![Held::Free; n],
            factor: vec![[0.0; 4]; n * n.div_ceil(4)],
            free: Vec::with_capacity(n),
            before: (0..n).collect(),
            coupled: true,
            free_before: Vec::with_capacity(n),
            g: vec![0.0; n],
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
        if self.n == 1 {
            return self.solve_single();
        }
        for (v, [lower, upper]) in self.v.iter_mut().zip(&self.walls) {
            *v = v.max(*lower).min(*upper);
        }
        self.hold();
        if self.reduced().is_ok() && self.confirmed() {
            std::mem::swap(&mut self.v, &mut self.candidate);
            return Ok(());
        }
        self.gradient();
        let mut residual = f64::INFINITY;
        let rounds = 200;
        for round in 0..rounds {
            // One sweep settles most steps; more where the set of held coordinates is hard to find.
            for _ in 0..(1 + round / 4) {
                self.sweep();
            }
            self.hold();
            self.reduced()?;
            std::mem::swap(&mut self.v, &mut self.candidate);
            self.gradient();
            residual = self.residual();
            if residual <= 1e-10 {
                return Ok(());
            }
            // Where the whole step goes too far, it goes to the corner that it passed, if that is better than the sweep.
            for (k, v) in self.v.iter_mut().enumerate() {
                let [lower, upper] = self.walls[k];
                let passed = self.dry[k] != [0.0; 2] && *v * self.candidate[k] < 0.0;
                *v = if passed { 0.0 } else { v.max(lower).min(upper) };
            }
            self.gradient();
            let trial = self.objective();
            std::mem::swap(&mut self.v, &mut self.candidate);
            self.gradient();
            if trial < self.objective() {
                std::mem::swap(&mut self.v, &mut self.candidate);
                self.gradient();
            }
        }
        Err(DynamicsError::NoConvergence { what: WHAT, residual, iterations: rounds })
    }

    /// One coordinate alone: the least of its own function is the solution.
    fn solve_single(&mut self) -> Result<(), DynamicsError> {
        self.slide_single()?;
        self.hold_single();
        Ok(())
    }

    /// Its next velocity.
    #[inline]
    pub fn slide_single(&mut self) -> Result<f64, DynamicsError> {
        let a = self.A[0];
        if a.is_nan() || a <= 0.0 {
            return Err(DynamicsError::NoConvergence { what: WHAT, residual: f64::INFINITY, iterations: 0 });
        }
        let v = if self.hinges.is_empty() { slide(a, self.b[0], self.dry[0], self.walls[0]) } else { self.minimise(0) };
        self.v[0] = v;
        Ok(v)
    }

    /// What holds it there, and its factor.
    #[inline]
    pub fn hold_single(&mut self) {
        self.hold();
        let v = self.v[0];
        let pushed: f64 = self.hinges.iter().filter(|h| h.push(v) != 0.0).map(|h| h.slope).sum();
        self.factor[0][0] = 1.0 / (self.A[0] + pushed);
    }

    /// Does the candidate stay on the pieces on which `v` stands? It is the solution then.
    fn confirmed(&self) -> bool {
        let moves = |k: usize| {
            let (w, [lower, upper]) = (self.candidate[k], self.walls[k]);
            lower < w && w < upper && (self.dry[k] == [0.0; 2] || w * self.v[k] > 0.0)
        };
        let push = |k: usize, v: f64| self.hinges.iter().filter(|h| h.k == k).map(|h| h.push(v)).sum::<f64>();
        let stays = |k: usize| {
            let (w, [lower, upper], [forward, backward]) = (self.candidate[k], self.walls[k], self.dry[k]);
            let row = &self.A[k * self.n..(k + 1) * self.n];
            let needed = self.b[k] - row.iter().zip(&self.candidate).map(|(a, v)| a * v).sum::<f64>() - push(k, w);
            // What friction and limits can give.
            let least = if w <= lower {
                f64::NEG_INFINITY
            } else if w > 0.0 {
                forward
            } else {
                -backward
            };
            let most = if w >= upper {
                f64::INFINITY
            } else if w < 0.0 {
                -backward
            } else {
                forward
            };
            least <= needed && needed <= most
        };
        let held = |k: usize| if self.held[k] == Held::Free { moves(k) } else { stays(k) };
        let pushes = |h: &Hinge| (h.push(self.candidate[h.k]) != 0.0) == (h.push(self.v[h.k]) != 0.0);
        (0..self.n).all(held) && self.hinges.iter().all(pushes)
    }

    /// `A v - b` at the present `v`.
    fn gradient(&mut self) {
        for (k, g) in self.g.iter_mut().enumerate() {
            let row = &self.A[k * self.n..(k + 1) * self.n];
            *g = row.iter().zip(&self.v).map(|(a, v)| a * v).sum::<f64>() - self.b[k];
        }
    }

    /// The problem's value at the present `v`, whose gradient is there.
    fn objective(&self) -> f64 {
        let smooth: f64 = (0..self.n).map(|k| 0.5 * self.v[k] * (self.g[k] - self.b[k]) + rub(self.dry[k], self.v[k]) * self.v[k]).sum();
        let stops: f64 = self.hinges.iter().filter(|h| h.slope > 0.0).map(|h| h.push(self.v[h.k]).powi(2) / (2.0 * h.slope)).sum();
        smooth + stops
    }

    /// One exact minimisation over each coordinate in turn.
    fn sweep(&mut self) {
        for k in 0..self.n {
            let best = self.minimise(k);
            let step = best - self.v[k];
            if step != 0.0 {
                self.v[k] = best;
                let row = &self.A[k * self.n..(k + 1) * self.n];
                for (g, a) in self.g.iter_mut().zip(row) {
                    *g += a * step;
                }
            }
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
        let a = self.A[k * self.n + k];
        let r = if self.n == 1 { self.b[0] } else { a * self.v[k] - self.g[k] };
        let [lower, upper] = self.walls[k];
        let [forward, backward] = self.dry[k];
        if !self.hinges.iter().any(|h| h.k == k) {
            return slide(a, r, self.dry[k], self.walls[k]);
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
            let (mut slope, mut right) = (a, r - if v > 0.0 { forward } else { -backward });
            for h in hinges.iter().filter(|h| h.k == k && h.push(v) != 0.0) {
                slope += h.slope;
                right -= h.side * h.offset;
            }
            right / slope
        };
        let mut left = None;
        for &kink in &self.kinks {
            let value = smooth(kink);
            let before = value + if kink > 0.0 { forward } else { -backward };
            let after = value + if kink >= 0.0 { forward } else { -backward };
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
            } else if v == 0.0 && self.dry[k] != [0.0; 2] {
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
        if m == n {
            into_lanes(&self.A, n, &mut self.factor);
        } else {
            for (row, &k) in self.factor.as_flattened_mut().chunks_exact_mut(4 * m.div_ceil(4).max(1)).zip(&self.free) {
                for (to, &j) in row.iter_mut().zip(&self.free) {
                    *to = self.A[k * n + j];
                }
            }
        }
        let width = m.div_ceil(4);
        for (i, &k) in self.free.iter().enumerate() {
            let mut r = self.b[k] - rub(self.dry[k], self.v[k]);
            if m != n {
                for j in 0..n {
                    if self.held[j] != Held::Free {
                        r -= self.A[k * n + j] * self.v[j];
                    }
                }
            }
            for h in self.hinges.iter().filter(|h| h.k == k) {
                if h.push(self.v[k]) != 0.0 {
                    self.factor[i * width + i / 4][i % 4] += h.slope;
                    r -= h.side * h.offset;
                }
            }
            self.rhs[i] = r;
        }
        if self.coupled {
            self.free_before.clear();
            self.free_before.extend(0..m);
        } else {
            before_among(&self.before, &self.free, &mut self.free_before);
        }
        let indefinite = |_| DynamicsError::NoConvergence { what: WHAT, residual: f64::INFINITY, iterations: 0 };
        tree_factor(&mut self.factor, &self.free_before).map_err(indefinite)?;
        tree_solve(&self.factor, &mut self.rhs[..m]);
        for (i, &k) in self.free.iter().enumerate() {
            self.candidate[k] = self.rhs[i];
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Distance of `-(A v - b)_k` from the forces that friction, stops and limits can give at `v_k`.
    fn violation(p: &Problem, k: usize) -> f64 {
        let v = p.v[k];
        let needed = p.b[k] - (0..p.n).map(|j| p.A[k * p.n + j] * p.v[j]).sum::<f64>();
        let stops: f64 = p.hinges.iter().filter(|h| h.k == k).map(|h| h.push(v)).sum();
        let (mut least, mut most) = match v {
            v if v > 0.0 => (p.dry[k][0], p.dry[k][0]),
            v if v < 0.0 => (-p.dry[k][1], -p.dry[k][1]),
            _ => (-p.dry[k][1], p.dry[k][0]),
        };
        if v >= p.walls[k][1] {
            most = f64::INFINITY;
        }
        if v <= p.walls[k][0] {
            least = f64::NEG_INFINITY;
        }
        (least + stops - needed).max(needed - most - stops).max(0.0)
    }

    #[test]
    fn random_problems_are_solved_to_their_optimality_conditions() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(41);
        for trial in 0..3000 {
            let n = 1 + trial % 14;
            let mut p = Problem::new(n, n);
            // Eigenvalues over six decades, as inertias of an arm and its fingers have.
            let half: Vec<f64> = (0..n * n).map(|_| rng.random_range(-1.0..1.0)).collect();
            let scale: Vec<f64> = (0..n).map(|_| 10.0_f64.powf(rng.random_range(-3.0..1.0))).collect();
            for i in 0..n {
                for j in 0..n {
                    let dot: f64 = (0..n).map(|k| half[i * n + k] * half[j * n + k]).sum();
                    p.A[i * n + j] = scale[i] * scale[j] * (dot + if i == j { 0.05 } else { 0.0 });
                }
            }
            for (k, s) in scale.iter().enumerate() {
                p.b[k] = s * rng.random_range(-1.0..1.0);
                p.dry[k] = match rng.random_range(0..4) {
                    0 => [0.0; 2],
                    1 => [s * rng.random_range(0.0..0.8), 0.0],
                    _ => [s * rng.random_range(0.0..0.8), s * rng.random_range(0.0..0.8)],
                };
                p.walls[k] = match rng.random_range(0..4) {
                    0 => [-rng.random_range(0.0..1.0), rng.random_range(0.0..1.0)],
                    1 => [rng.random_range(0.0..0.5), 2.0],
                    _ => [f64::NEG_INFINITY, f64::INFINITY],
                };
                if rng.random_range(0..3) == 0 {
                    let side = if rng.random_range(0..2) == 0 { 1.0 } else { -1.0 };
                    p.hinges.push(Hinge { k, side, offset: s * rng.random_range(-1.0..1.0), slope: s * s * rng.random_range(0.0..50.0) });
                }
                p.v[k] = rng.random_range(-1.0..1.0);
            }
            p.solve().unwrap();
            for (k, s) in scale.iter().enumerate() {
                assert!(violation(&p, k) < 1e-7 * s, "trial {trial}, coordinate {k}: {:e}", violation(&p, k) / s);
                let held = p.held[k];
                assert_eq!(held == Held::Free, p.free.contains(&k));
                assert!(held != Held::Stuck || p.v[k] == 0.0);
            }
        }
    }

    #[test]
    fn without_friction_and_limits_it_is_a_linear_system() {
        let mut p = Problem::new(2, 0);
        p.A.copy_from_slice(&[2.0, 1.0, 1.0, 3.0]);
        p.b.copy_from_slice(&[1.0, 2.0]);
        p.solve().unwrap();
        assert!((p.v[0] - 0.2).abs() < 1e-15 && (p.v[1] - 0.6).abs() < 1e-15);
    }
}
