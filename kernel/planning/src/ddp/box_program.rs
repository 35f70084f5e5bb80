//! Least `x . H x / 2 + g . x` with `lower <= x <= upper`, for few variables: projected Newton (Bertsekas 1982; Tassa, Mansard and
//! Todorov 2014, section III-A).
//!
//! A variable that stands at a bound, with a gradient that would push it out, is held; the others take a Newton step on their own
//! block of `H`, projected onto the box. Once the held set stays, the step is exact.

use sagci_dynamics::{cholesky, cholesky_solve};

/// The least decrease that a step must bring, as a fraction of what its gradient promises.
const ARMIJO: f64 = 0.1;
/// The set of held variables settles within a few rounds; more than this only rounding asks for.
const ROUNDS: usize = 100;

/// Memory of the program, and its answer.
#[derive(Debug, Clone)]
pub(super) struct BoxProgram {
    pub x: Vec<f64>,
    /// Variables that are not held, and the factor of their block of `H`.
    pub free: Vec<usize>,
    pub factor: Vec<f64>,
    held: Vec<bool>,
    gradient: Vec<f64>,
    step: Vec<f64>,
    trial: Vec<f64>,
}

impl BoxProgram {
    pub fn new(n: usize) -> Self {
        let zeros = vec![0.0; n];
        Self {
            x: zeros.clone(),
            free: Vec::with_capacity(n),
            factor: vec![0.0; n * n],
            held: vec![false; n],
            gradient: zeros.clone(),
            step: zeros.clone(),
            trial: zeros,
        }
    }

    /// Factors `H` on the free variables; false where it is not positive definite.
    fn factor(&mut self, H: &[f64]) -> bool {
        let (n, m) = (self.x.len(), self.free.len());
        for (i, &k) in self.free.iter().enumerate() {
            for (j, &l) in self.free.iter().enumerate().take(i + 1) {
                self.factor[i * m + j] = H[k * n + l];
            }
        }
        cholesky(&mut self.factor[..m * m], m).is_ok()
    }

    /// Solves without bounds. False where `H` is not positive definite.
    pub fn solve_free(&mut self, H: &[f64], g: &[f64]) -> bool {
        self.free.clear();
        self.free.extend(0..self.x.len());
        if !self.factor(H) {
            return false;
        }
        for (x, g) in self.x.iter_mut().zip(g) {
            *x = -g;
        }
        cholesky_solve(&self.factor, self.free.len(), &mut self.x);
        true
    }

    /// Solves, from the `x` that is there. False where `H` is not positive definite on the free variables. `bounds(i)` must hold 0.
    pub fn solve(&mut self, H: &[f64], g: &[f64], bounds: impl Fn(usize) -> [f64; 2]) -> bool {
        let n = self.x.len();
        let value = |x: &[f64]| -> f64 {
            (0..n).map(|i| x[i] * (g[i] + 0.5 * H[i * n..(i + 1) * n].iter().zip(x).map(|(h, x)| h * x).sum::<f64>())).sum()
        };
        let clamp = |i: usize, x: f64| {
            let [lower, upper] = bounds(i);
            x.max(lower).min(upper)
        };
        for i in 0..n {
            self.x[i] = clamp(i, self.x[i]);
        }
        let scale = g.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
        for round in 0..ROUNDS {
            let mut changed = round == 0;
            for i in 0..n {
                let slope = g[i] + H[i * n..(i + 1) * n].iter().zip(&self.x).map(|(h, x)| h * x).sum::<f64>();
                let [lower, upper] = bounds(i);
                let held = (self.x[i] <= lower && slope > 0.0) || (self.x[i] >= upper && slope < 0.0);
                changed |= std::mem::replace(&mut self.held[i], held) != held;
                self.gradient[i] = slope;
            }
            if changed {
                self.free.clear();
                self.free.extend((0..n).filter(|i| !self.held[*i]));
                if !self.factor(H) {
                    return false;
                }
            }
            let m = self.free.len();
            for (i, &k) in self.free.iter().enumerate() {
                self.step[i] = -self.gradient[k];
            }
            if self.step[..m].iter().all(|s| s.abs() <= 1e-14 * scale) {
                return true;
            }
            cholesky_solve(&self.factor[..m * m], m, &mut self.step[..m]);
            let (before, mut length) = (value(&self.x), 1.0);
            loop {
                self.trial.copy_from_slice(&self.x);
                let mut promised = 0.0;
                for (i, &k) in self.free.iter().enumerate() {
                    self.trial[k] = clamp(k, self.x[k] + length * self.step[i]);
                    promised += self.gradient[k] * (self.trial[k] - self.x[k]);
                }
                if value(&self.trial) - before <= ARMIJO * promised {
                    std::mem::swap(&mut self.x, &mut self.trial);
                    break;
                }
                length *= 0.5;
                // No further decrease in these numbers.
                if length < 1e-12 {
                    return true;
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_held_pushes_out_and_what_is_free_has_no_slope() {
        // Coupled strongly enough that clamping the unbounded answer is wrong.
        let (H, g) = ([2.0, 1.5, 0.3, 1.5, 2.0, 0.4, 0.3, 0.4, 1.0], [-4.0, 1.0, 0.2]);
        let mut program = BoxProgram::new(3);
        assert!(program.solve(&H, &g, |_| [-1.0, 1.0]));
        let slope = |i: usize| g[i] + (0..3).map(|j| H[3 * i + j] * program.x[j]).sum::<f64>();
        for i in 0..3 {
            assert!(program.x[i].abs() <= 1.0);
            if program.free.contains(&i) {
                assert!(slope(i).abs() < 1e-12, "{i}: {}", slope(i));
            } else {
                assert!(program.x[i].abs() == 1.0 && slope(i) * program.x[i] < 0.0, "{i}: {}", slope(i));
            }
        }
        assert!(!program.free.contains(&0));
        // Without bounds in reach, the answer is Newton's.
        assert!(program.solve(&H, &g, |_| [-100.0, 100.0]));
        let bounded = program.x.clone();
        assert!(program.solve_free(&H, &g));
        assert!(bounded.iter().zip(&program.x).all(|(a, b)| (a - b).abs() < 1e-12));
        program.x.fill(0.0);
        assert!(!program.solve(&[-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], &g, |_| [-1.0, 1.0]));
    }
}
