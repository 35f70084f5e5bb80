//! Numeric inverse kinematics with joint limits.
//!
//! Minimise E(q) = |e|^2 / 2, e = (log(R_goal R^T); p_goal - p), by Levenberg and Marquardt's step
//! dq = J^T (J J^T + lambda I)^-1 e with lambda = E + a constant (Sugihara 2011: converges also where the goal is out of reach
//! or the arm singular, and quadratically near a solution). A joint at its limit that the step would push further is
//! taken out of the step. A redundant arm also moves in the null space toward a preferred configuration:
//! dq += (I - J^+ J) z. Many seeded starts give many solutions; those that are near another one are dropped.

use nalgebra::{Isometry3, Matrix6, Vector6};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::ArmKinematics;

/// How [`ArmKinematics::inverse`] searches.
#[derive(Debug, Clone)]
pub struct InverseOptions {
    /// Number of random starts, besides the seeds that are passed.
    pub starts: usize,
    /// Stop at this many distinct solutions.
    pub solutions: usize,
    /// Seed of the random starts.
    pub seed: u64,
    /// Greatest error of the answer, rad and m.
    pub tolerance: f64,
    /// Two solutions that differ by less than this in every joint count as one, rad or m.
    pub distinct: f64,
    /// Distance that is kept from the joint limits, rad or m (at most a quarter of a joint's range).
    pub margin: f64,
    /// Steps that one start may take.
    pub steps: usize,
}

impl Default for InverseOptions {
    fn default() -> Self {
        Self { starts: 32, solutions: 16, seed: 0, tolerance: 1e-8, distinct: 0.2, margin: 0.0, steps: 80 }
    }
}

/// Memory of the solver, so that a solve does not allocate.
#[derive(Debug, Clone, Default)]
pub(crate) struct Workspace {
    J: Vec<Vector6<f64>>,
    free: Vec<bool>,
    dq: Vec<f64>,
    pub(crate) lower: Vec<f64>,
    pub(crate) upper: Vec<f64>,
}

impl Workspace {
    pub(crate) fn new(arm: &ArmKinematics, margin: f64) -> Self {
        let n = arm.joints();
        let margin_of = |i: usize| margin.min(0.25 * (arm.upper[i] - arm.lower[i])).max(0.0);
        Self {
            J: Vec::with_capacity(n),
            free: vec![true; n],
            dq: vec![0.0; n],
            lower: (0..n).map(|i| arm.lower[i] + margin_of(i)).collect(),
            upper: (0..n).map(|i| arm.upper[i] - margin_of(i)).collect(),
        }
    }
}

/// Error of a pose against its goal: (rotation vector; shift) in the world's axes.
pub(crate) fn pose_error(X_WT: &Isometry3<f64>, goal: &Isometry3<f64>) -> Vector6<f64> {
    let w = (goal.rotation * X_WT.rotation.inverse()).scaled_axis();
    let v = goal.translation.vector - X_WT.translation.vector;
    Vector6::new(w.x, w.y, w.z, v.x, v.y, v.z)
}

/// What pulls in the null space.
pub(crate) struct Preference<'a> {
    /// Configuration that is preferred.
    pub(crate) q: &'a [f64],
    /// Pull of each joint toward it, a fraction of the distance per step.
    pub(crate) gain: &'a [f64],
}

impl ArmKinematics {
    /// One solve from one start. `q` holds the answer if it is found; else it is where the search ended.
    pub(crate) fn solve(
        &self,
        goal: &Isometry3<f64>,
        q: &mut [f64],
        steps: usize,
        tolerance: f64,
        preference: Option<&Preference>,
        work: &mut Workspace,
    ) -> bool {
        let n = self.joints();
        let Workspace { J, free, dq, lower, upper } = work;
        for i in 0..n {
            q[i] = q[i].clamp(lower[i], upper[i]);
        }
        let mut best = f64::INFINITY;
        let mut since = 0;
        for step in 0..=steps {
            let X_WT = self.jacobian(q, J);
            let e = pose_error(&X_WT, goal);
            let E = 0.5 * e.norm_squared();
            if !E.is_finite() {
                return false;
            }
            if e.amax() < tolerance && (preference.is_none() || step > 2) {
                return true;
            }
            if step == steps {
                break;
            }
            // A start that no longer improves is in a local minimum.
            if E < 0.7 * best {
                best = E;
                since = 0;
            } else {
                since += 1;
                if since > 12 {
                    return e.amax() < tolerance;
                }
            }
            free.fill(true);
            // At most a few joints reach a limit in one step: each pass takes those out and solves again.
            for _ in 0..4 {
                let mut A = Matrix6::<f64>::identity() * (E + 1e-12);
                for i in (0..n).filter(|i| free[*i]) {
                    A.ger(1.0, &J[i], &J[i], 1.0);
                }
                let Some(factor) = A.cholesky() else { return false };
                let y = factor.solve(&e);
                let nullspace = preference.map(|p| {
                    let mut Jz = Vector6::zeros();
                    for i in (0..n).filter(|i| free[*i]) {
                        Jz += J[i] * (p.gain[i] * (p.q[i] - q[i]));
                    }
                    // Later steps settle on the goal.
                    let fade = 1.0 / (1.0 + step as f64);
                    (factor.solve(&Jz), fade, p)
                });
                for i in 0..n {
                    dq[i] = if free[i] { J[i].dot(&y) } else { 0.0 };
                    if let (true, Some((w, fade, p))) = (free[i], &nullspace) {
                        dq[i] += fade * (p.gain[i] * (p.q[i] - q[i]) - J[i].dot(w));
                    }
                }
                let mut stuck = false;
                for i in 0..n {
                    if free[i] && ((q[i] <= lower[i] && dq[i] < 0.0) || (q[i] >= upper[i] && dq[i] > 0.0)) {
                        free[i] = false;
                        stuck = true;
                    }
                }
                if !stuck {
                    break;
                }
            }
            let largest = dq.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
            let scale = if largest > 0.6 { 0.6 / largest } else { 1.0 };
            for i in 0..n {
                q[i] = (q[i] + scale * dq[i]).clamp(lower[i], upper[i]);
            }
        }
        false
    }

    /// Joint positions that put the tool (or the frame `F` of a freedom) at `X_WT`: up to `options.solutions` distinct
    /// ones, first those found from `seeds`, then from random starts. Empty if none is found. The same arguments give the
    /// same bits.
    pub fn inverse(&self, X_WT: &Isometry3<f64>, seeds: &[Vec<f64>], options: &InverseOptions) -> Vec<Vec<f64>> {
        let n = self.joints();
        let mut random = Pcg64::seed_from_u64(options.seed);
        let mut work = Workspace::new(self, options.margin);
        let mut found: Vec<Vec<f64>> = Vec::new();
        let mut q = vec![0.0; n];
        for start in 0..seeds.len() + options.starts {
            if found.len() >= options.solutions {
                break;
            }
            match seeds.get(start) {
                Some(seed) => (0..n).for_each(|i| q[i] = seed.get(i).copied().unwrap_or(0.5 * (work.lower[i] + work.upper[i]))),
                None => self.random_configuration(&mut random, &work.lower, &work.upper, &mut q),
            }
            if self.solve(X_WT, &mut q, options.steps, options.tolerance, None, &mut work)
                && !found.iter().any(|f| f.iter().zip(&q).all(|(a, b)| (a - b).abs() < options.distinct))
            {
                found.push(q.clone());
            }
        }
        found
    }

    /// A configuration drawn evenly from within limits; an endless joint is drawn from one turn.
    pub(crate) fn random_configuration(&self, random: &mut Pcg64, lower: &[f64], upper: &[f64], q: &mut [f64]) {
        for i in 0..self.joints() {
            let (l, u) = finite_range(lower[i], upper[i]);
            q[i] = l + (u - l) * random.random::<f64>();
        }
    }
}

/// A range to draw from: an open end is half a turn (or half a metre's order) away.
pub(crate) fn finite_range(lower: f64, upper: f64) -> (f64, f64) {
    use std::f64::consts::PI;
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => (lower, upper),
        (true, false) => (lower, lower + 2.0 * PI),
        (false, true) => (upper - 2.0 * PI, upper),
        (false, false) => (-PI, PI),
    }
}
