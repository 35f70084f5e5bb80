//! The first level of a plan: the object alone. How one of its joints should move, and what force that takes.
//!
//! Minimise the integral of (effort_weight u^2 + jerk_weight (d3q/dt3)^2) for a motion from rest to rest in a given
//! time, subject to the joint's dynamics u = tau(q, qd, qdd) (inertia, damping, dry friction, gravity, the model's
//! effects), to qd in the motion's direction and below the greatest speed, and to the greatest effort. On a grid with the
//! jerk constant between points the kinematics are exact and linear; tau is linearised about the last solution and the
//! convex program (clarabel) solved again until nothing changes. Motion in one direction keeps dry friction smooth.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT, ZeroConeT};

use crate::PlanError;
use crate::timing::Rows;

/// Effort of the joint at (q, v, a): what must push it, N m or N.
pub type JointDynamics<'a> = dyn Fn(f64, f64, f64) -> f64 + 'a;

/// What the motion must keep and what it should avoid.
#[derive(Debug, Clone)]
pub struct ObjectMotionOptions {
    /// Greatest speed of the joint, rad/s or m/s.
    pub speed: f64,
    /// Greatest effort of the hand along the joint, N m or N.
    pub effort: f64,
    /// Duration, s; where it is `None`, the time that a smooth motion of the greatest speed takes.
    pub duration: Option<f64>,
    /// Weight of the effort.
    pub effort_weight: f64,
    /// Weight of the jerk; 0 leaves the acceleration free at both ends.
    pub jerk_weight: f64,
    /// Number of intervals.
    pub knots: usize,
}

impl Default for ObjectMotionOptions {
    fn default() -> Self {
        Self { speed: 0.5, effort: f64::INFINITY, duration: None, effort_weight: 0.01, jerk_weight: 1.0, knots: 50 }
    }
}

/// How the joint moves and what that takes. One entry for each knot.
#[derive(Debug, Clone)]
pub struct ObjectTrajectory {
    /// Time, s.
    pub t: Vec<f64>,
    /// Position, rad or m.
    pub q: Vec<f64>,
    /// Speed.
    pub v: Vec<f64>,
    /// Acceleration.
    pub a: Vec<f64>,
    /// Effort u* that the hand must give along the joint, N m or N.
    pub u: Vec<f64>,
}

impl ObjectTrajectory {
    /// Duration, s.
    pub fn duration(&self) -> f64 {
        self.t.last().copied().unwrap_or(0.0)
    }

    /// Position, speed and acceleration at a time (clamped to the duration), by the constant jerk between knots.
    pub fn sample(&self, t: f64) -> (f64, f64, f64) {
        let n = self.t.len();
        if n < 2 {
            return (self.q.first().copied().unwrap_or(0.0), 0.0, 0.0);
        }
        let t = t.clamp(0.0, self.duration());
        let k = self.t.partition_point(|x| *x <= t).clamp(1, n - 1);
        let (h, d) = (self.t[k] - self.t[k - 1], t - self.t[k - 1]);
        let j = (self.a[k] - self.a[k - 1]) / h;
        (
            self.q[k - 1] + d * (self.v[k - 1] + d * (self.a[k - 1] / 2.0 + d * j / 6.0)),
            self.v[k - 1] + d * (self.a[k - 1] + d * j / 2.0),
            self.a[k - 1] + d * j,
        )
    }

    /// Effort at a position on the way, by linear interpolation.
    pub fn effort_at(&self, q: f64) -> f64 {
        let forward = self.q.last() >= self.q.first();
        let k = self.q.partition_point(|x| if forward { *x <= q } else { *x >= q }).clamp(1, self.q.len().max(2) - 1);
        match (self.q.get(k - 1), self.q.get(k)) {
            (Some(a), Some(b)) if (b - a).abs() > 1e-12 => {
                let f = ((q - a) / (b - a)).clamp(0.0, 1.0);
                self.u[k - 1] + f * (self.u[k] - self.u[k - 1])
            }
            _ => self.u.first().copied().unwrap_or(0.0),
        }
    }
}

/// Plans the motion of one joint from rest at `from` to rest at `to`.
///
/// # Errors
/// [`PlanError::BadInput`] for values that are not finite or positive; [`PlanError::TooWeak`] if the effort limit is too
/// low for any duration tried; [`PlanError::NoConvergence`] from the solver.
pub fn object_motion(dynamics: &JointDynamics, from: f64, to: f64, options: &ObjectMotionOptions) -> Result<ObjectTrajectory, PlanError> {
    let bad = |message: &str| PlanError::BadInput { message: format!("object motion: {message}") };
    let way = to - from;
    if !way.is_finite() || !from.is_finite() {
        return Err(bad("start and goal must be finite"));
    }
    if options.speed.is_nan() || options.speed <= 0.0 || options.effort.is_nan() || options.effort <= 0.0 || options.knots < 4 {
        return Err(bad("speed and effort must be positive, with at least 4 knots"));
    }
    if way.abs() < 1e-9 {
        return Ok(ObjectTrajectory { t: vec![0.0], q: vec![from], v: vec![0.0], a: vec![0.0], u: vec![dynamics(from, 0.0, 0.0)] });
    }
    // A motion of least jerk peaks at 15/8 of its mean speed.
    let mut duration = options.duration.unwrap_or((1.875 * way.abs() / options.speed).max(0.2));
    let given = options.duration.is_some();
    let mut last = None;
    for _ in 0..if given { 1 } else { 6 } {
        match solve(dynamics, from, to, duration, options) {
            Ok(t) => return Ok(t),
            Err(Stop::Infeasible) => last = Some(duration),
            Err(Stop::Solver(message)) => return Err(PlanError::NoConvergence { stage: "object motion".into(), message }),
        }
        duration *= 1.4;
    }
    let slow = dynamics(0.5 * (from + to), way.signum() * 1e-3, 0.0);
    Err(PlanError::TooWeak {
        stage: "object motion".into(),
        message: format!(
            "a motion from {from:.3} to {to:.3} within speed {:.3} and effort {:.3} is not possible in {:.2} s; moving slowly at its middle takes {:.3}",
            options.speed,
            options.effort,
            last.unwrap_or(duration),
            slow
        ),
    })
}

enum Stop {
    Infeasible,
    Solver(String),
}

fn solve(dynamics: &JointDynamics, from: f64, to: f64, duration: f64, options: &ObjectMotionOptions) -> Result<ObjectTrajectory, Stop> {
    let n = options.knots;
    let dt = duration / n as f64;
    let way = to - from;
    let sign = way.signum();
    // Variables in units of the way and the duration, so that all are near 1: q = from + way x, v = way/T y, ...
    let (Q, V, A, J, U) = (0, n + 1, 2 * n + 2, 3 * n + 3, 4 * n + 3);
    let columns = 5 * n + 4;
    let (sv, sa, sj) = (way / duration, way / duration.powi(2), way / duration.powi(3));
    let h = dt / duration;

    // Start of the linearisation: the motion of least jerk.
    let mut q: Vec<f64> = (0..=n).map(|k| from + way * least_jerk(k as f64 * h).0).collect();
    let mut v: Vec<f64> = (0..=n).map(|k| sv * least_jerk(k as f64 * h).1).collect();
    let mut a: Vec<f64> = (0..=n).map(|k| sa * least_jerk(k as f64 * h).2).collect();
    let mut u = vec![0.0; n + 1];
    for _ in 0..8 {
        // u = u0 + uq dq + uv dv + ua da
        let tau = |k: usize, dq: f64, dv: f64, da: f64| {
            // At rest the direction of dry friction is the motion's.
            let v = if (v[k] + dv) * sign <= 1e-6 * sv.abs() { 1e-6 * sv } else { v[k] + dv };
            dynamics(q[k] + dq, v, a[k] + da)
        };
        let mut lin = Vec::with_capacity(n + 1);
        for k in 0..=n {
            let (eq, ev, ea) = (1e-4 * way.abs(), 1e-3 * sv.abs(), 1e-3 * sa.abs());
            let u0 = tau(k, 0.0, 0.0, 0.0);
            let uq = (tau(k, eq, 0.0, 0.0) - tau(k, -eq, 0.0, 0.0)) / (2.0 * eq);
            // One-sided, away from rest.
            let base = tau(k, 0.0, 2.0 * sign * ev, 0.0);
            let uv = (tau(k, 0.0, 4.0 * sign * ev, 0.0) - base) / (2.0 * sign * ev);
            let ua = (tau(k, 0.0, 0.0, ea) - tau(k, 0.0, 0.0, -ea)) / (2.0 * ea);
            lin.push([u0, uq, uv, ua]);
        }
        let su = lin.iter().map(|l| l[0].abs().max((l[3] * sa).abs())).fold(1e-9, f64::max);
        let mut rows = Rows::default();
        for (column, value) in [(Q, 0.0), (Q + n, 1.0), (V, 0.0), (V + n, 0.0)] {
            rows.add(&[(column, 1.0)], value);
        }
        let mut equalities = 4;
        if options.jerk_weight > 0.0 {
            rows.add(&[(A, 1.0)], 0.0);
            rows.add(&[(A + n, 1.0)], 0.0);
            equalities += 2;
        }
        for k in 0..n {
            rows.add(&[(Q + k + 1, 1.0), (Q + k, -1.0), (V + k, -h), (A + k, -h * h / 2.0), (J + k, -h * h * h / 6.0)], 0.0);
            rows.add(&[(V + k + 1, 1.0), (V + k, -1.0), (A + k, -h), (J + k, -h * h / 2.0)], 0.0);
            rows.add(&[(A + k + 1, 1.0), (A + k, -1.0), (J + k, -h)], 0.0);
        }
        for k in 0..=n {
            let [u0, uq, uv, ua] = lin[k];
            let constant = u0 + uq * (from - q[k]) - uv * v[k] - ua * a[k];
            rows.add(&[(U + k, 1.0), (Q + k, -uq * way / su), (V + k, -uv * sv / su), (A + k, -ua * sa / su)], constant / su);
        }
        equalities += 3 * n + n + 1;
        let mut cones: Vec<SupportedConeT<f64>> = vec![ZeroConeT(equalities)];
        let before = rows.b.len();
        for k in 1..n {
            rows.add(&[(V + k, -1.0)], 0.0);
            rows.add(&[(V + k, 1.0)], options.speed / sv.abs() * (1.0 + 1e-9));
        }
        if options.effort.is_finite() {
            for k in 0..=n {
                rows.add(&[(U + k, 1.0)], options.effort / su);
                rows.add(&[(U + k, -1.0)], options.effort / su);
            }
        }
        cones.push(NonnegativeConeT(rows.b.len() - before));
        // Integrals by the trapezoid; the objective is divided by its own size.
        let (wu, wj) = (options.effort_weight * su * su, options.jerk_weight * sj * sj);
        let size = (wu + 360.0 * wj).max(1e-12);
        let (mut pi, mut pv) = (Vec::new(), Vec::new());
        for k in 0..n {
            pi.push(J + k);
            pv.push(2.0 * wj * h / size + 1e-12);
        }
        for k in 0..=n {
            pi.push(U + k);
            pv.push(2.0 * wu * h / size * if k == 0 || k == n { 0.5 } else { 1.0 } + 1e-12);
        }
        let P = CscMatrix::new_from_triplets(columns, columns, pi.clone(), pi, pv);
        let (matrix, rhs) = rows.matrix(columns);
        let settings = DefaultSettingsBuilder::default().verbose(false).max_iter(100).build().map_err(|e| Stop::Solver(e.to_string()))?;
        let mut solver =
            DefaultSolver::new(&P, &vec![0.0; columns], &matrix, &rhs, &cones, settings).map_err(|e| Stop::Solver(e.to_string()))?;
        solver.solve();
        match solver.solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => {}
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => return Err(Stop::Infeasible),
            other => return Err(Stop::Solver(format!("the conic program ended with {other:?}"))),
        }
        let x = &solver.solution.x;
        let mut change = 0.0_f64;
        for k in 0..=n {
            let next = [from + way * x[Q + k], sv * x[V + k], sa * x[A + k]];
            change = change.max(((next[0] - q[k]) / way).abs()).max(((next[1] - v[k]) / sv).abs());
            [q[k], v[k], a[k]] = next;
            u[k] = su * x[U + k];
        }
        if change < 1e-6 {
            break;
        }
    }
    (q[0], q[n], v[0], v[n]) = (from, to, 0.0, 0.0);
    Ok(ObjectTrajectory { t: (0..=n).map(|k| k as f64 * dt).collect(), q, v, a, u })
}

/// Position, speed and acceleration of the unit motion of least jerk (Flash and Hogan 1985).
fn least_jerk(s: f64) -> (f64, f64, f64) {
    (s.powi(3) * (10.0 + s * (-15.0 + 6.0 * s)), 30.0 * s * s * (1.0 - s) * (1.0 - s), 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s))
}
