//! When to be where on a path: the fastest timing within limits, as a conic program.
//!
//! On a path q(s), s from 0 to 1, let b = (ds/dt)^2 and a = d2s/dt2, so db/ds = 2 a. Then qd = q' sqrt(b) and
//! qdd = q' a + q'' b: limits of speed, acceleration and torque are linear in (a, b), and the duration
//! int ds / sqrt(b) is convex (Verscheure et al. 2009, IEEE TAC 54(10)). On a grid with a constant between points,
//! the duration is sum_k 2 ds / (sqrt(b_k) + sqrt(b_k+1)), and with c_k <= sqrt(b_k), d_k >= 1 / (c_k + c_k+1)
//! both are second-order cones. A quadratic cost on steps of a keeps the acceleration from switching at once.
//!
//! Limits hold at both ends of every piece; between them they are met by a last, finely sampled uniform slow-down.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus, SupportedConeT, ZeroConeT,
};

use crate::spline::Spline;
use crate::{ArmKinematics, PlanError};

/// Efforts at (q, v, a), for limits of torque: the arm's inverse dynamics.
pub type InverseDynamics<'a> = dyn Fn(&[f64], &[f64], &[f64]) -> Vec<f64> + 'a;

/// What the timing must keep.
#[derive(Clone)]
pub struct MotionLimits<'a> {
    /// Greatest speed of each joint, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Greatest acceleration of each joint, rad/s^2 or m/s^2.
    pub acceleration: Vec<f64>,
    /// Greatest effort of each joint with the dynamics that it is measured by, N m or N.
    pub effort: Option<(Vec<f64>, &'a InverseDynamics<'a>)>,
    /// Greatest speed of the tool's origin, m/s, and turn, rad/s.
    pub tool: Option<(&'a ArmKinematics, f64, f64)>,
    /// Weight of changes of acceleration against the duration; 0 gives the fastest timing.
    pub smoothness: f64,
}

impl MotionLimits<'_> {
    /// Limits of an arm's model, with accelerations that reach full speed in `seconds`, all scaled by `fraction` of the
    /// greatest speeds.
    pub fn of_arm(arm: &ArmKinematics, fraction: f64, seconds: f64) -> MotionLimits<'static> {
        let velocity: Vec<f64> =
            arm.velocity().iter().take(arm.arm_joints()).map(|v| fraction * if v.is_finite() { *v } else { 1.0 }).collect();
        MotionLimits { acceleration: velocity.iter().map(|v| v / seconds).collect(), velocity, effort: None, tool: None, smoothness: 0.02 }
    }
}

/// A timed joint path, continuous with its first derivative; at rest at both ends.
#[derive(Debug, Clone)]
pub struct JointTrajectory {
    spline: Option<Spline>,
    hold: Vec<f64>,
    /// Grid of s, with sqrt(b) at its points and the time there.
    s: Vec<f64>,
    speed: Vec<f64>,
    time: Vec<f64>,
}

/// Positions, velocities and accelerations at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct JointSample {
    /// Positions, rad or m.
    pub q: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub v: Vec<f64>,
    /// Accelerations, rad/s^2 or m/s^2.
    pub a: Vec<f64>,
}

impl JointTrajectory {
    /// Stays at a configuration for no time.
    pub fn hold(q: &[f64]) -> Self {
        Self { spline: None, hold: q.to_vec(), s: vec![0.0], speed: vec![0.0], time: vec![0.0] }
    }

    /// Duration, s.
    pub fn duration(&self) -> f64 {
        self.time.last().copied().unwrap_or(0.0)
    }

    /// How much of the path is behind at time `t`, 0..1.
    pub fn progress(&self, t: f64) -> f64 {
        self.path_state(t).0
    }

    /// s, ds/dt and d2s/dt2.
    fn path_state(&self, t: f64) -> (f64, f64, f64) {
        let n = self.time.len();
        if n < 2 || t >= self.duration() {
            return (1.0, 0.0, 0.0);
        }
        let t = t.max(0.0);
        let k = self.time.partition_point(|x| *x <= t).clamp(1, n - 1);
        let (h, dt) = (self.time[k] - self.time[k - 1], t - self.time[k - 1]);
        if h <= 0.0 {
            return (self.s[k], self.speed[k], 0.0);
        }
        let a = (self.speed[k] - self.speed[k - 1]) / h;
        (self.s[k - 1] + self.speed[k - 1] * dt + 0.5 * a * dt * dt, self.speed[k - 1] + a * dt, a)
    }

    /// Where to be at time `t` (clamped to the duration).
    pub fn sample(&self, t: f64) -> JointSample {
        let Some(spline) = &self.spline else {
            let zero = vec![0.0; self.hold.len()];
            return JointSample { q: self.hold.clone(), v: zero.clone(), a: zero };
        };
        let (s, sd, sdd) = self.path_state(t);
        let n = spline.dof();
        let (mut q, mut v, mut a) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        spline.at(s, &mut q, &mut v, &mut a);
        for j in 0..n {
            a[j] = v[j] * sdd + a[j] * sd * sd;
            v[j] *= sd;
        }
        JointSample { q, v, a }
    }

    /// States on both ends of every piece, where the acceleration steps, at the spline's knots, where it peaks, and between.
    fn fine_samples(&self) -> Vec<JointSample> {
        const FRACTIONS: usize = 8;
        let Some(spline) = &self.spline else { return Vec::new() };
        let n = spline.dof();
        let mut out = Vec::new();
        for k in 1..self.s.len() {
            let (from, to) = (self.s[k - 1], self.s[k]);
            let (b0, b1) = (self.speed[k - 1].powi(2), self.speed[k].powi(2));
            let sdd = 0.5 * (b1 - b0) / (to - from);
            let inside = spline.knots().iter().copied().filter(|s| *s > from && *s < to);
            for s in (0..=FRACTIONS).map(|i| from + (to - from) * i as f64 / FRACTIONS as f64).chain(inside) {
                let sd2 = b0 + (b1 - b0) * (s - from) / (to - from);
                let (mut q, mut v, mut a) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
                spline.at(s, &mut q, &mut v, &mut a);
                for j in 0..n {
                    a[j] = v[j] * sdd + a[j] * sd2;
                    v[j] *= sd2.max(0.0).sqrt();
                }
                out.push(JointSample { q, v, a });
            }
        }
        out
    }

    /// Configuration at a share of the path, 0..1, whatever the time.
    pub fn at_progress(&self, s: f64) -> Vec<f64> {
        match &self.spline {
            None => self.hold.clone(),
            Some(spline) => {
                let n = spline.dof();
                let (mut q, mut v, mut a) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
                spline.at(s, &mut q, &mut v, &mut a);
                q
            }
        }
    }

    /// The same motion, slower by `factor` (1 or more).
    pub fn slowed(mut self, factor: f64) -> Self {
        self.time.iter_mut().for_each(|t| *t *= factor);
        self.speed.iter_mut().for_each(|v| *v /= factor);
        self
    }
}

/// Times a path. A path of one point, or of equal points, gives a trajectory of no duration.
///
/// # Errors
/// [`PlanError::BadInput`] for lengths that do not agree or limits that are not positive; [`PlanError::NoConvergence`] if
/// the conic program is not solved; [`PlanError::TooWeak`] if gravity alone takes more effort than there is.
pub fn time_path(path: &[Vec<f64>], limits: &MotionLimits) -> Result<JointTrajectory, PlanError> {
    let n = limits.velocity.len();
    let bad = |message: String| PlanError::BadInput { message };
    if path.is_empty() || path.iter().any(|q| q.len() != n || q.iter().any(|x| !x.is_finite())) || limits.acceleration.len() != n {
        return Err(bad(format!("timing: a path needs at least one point, each with {n} finite positions")));
    }
    if limits.velocity.iter().chain(&limits.acceleration).any(|x| x.is_nan() || *x <= 0.0) {
        return Err(bad("timing: limits of speed and acceleration must be positive".into()));
    }
    let Some(spline) = Spline::through(path) else { return Ok(JointTrajectory::hold(&path[0])) };

    let pieces = (3 * spline.knots().len()).clamp(40, 160);
    // Finer toward the ends: there the speed is the root of the way.
    let s: Vec<f64> = (0..=pieces)
        .map(|k| {
            let x = k as f64 / pieces as f64;
            x - 0.7 * (std::f64::consts::TAU * x).sin() / std::f64::consts::TAU
        })
        .collect();
    let grid = Grid::new(&spline, &s, limits)?;
    let b = solve(&s, &grid, limits)?;
    let speed: Vec<f64> = b.iter().map(|b| b.max(0.0).sqrt()).collect();
    let mut time = vec![0.0; s.len()];
    for k in 1..s.len() {
        let sum = speed[k] + speed[k - 1];
        if sum <= 1e-12 {
            return Err(PlanError::NoConvergence { stage: "timing".into(), message: "the path's speed falls to zero on the way".into() });
        }
        time[k] = time[k - 1] + 2.0 * (s[k] - s[k - 1]) / sum;
    }
    let trajectory = JointTrajectory { hold: path[0].clone(), spline: Some(spline), s, speed, time };
    Ok(keep_limits(trajectory, limits))
}

/// Linear limits at the grid's points: low <= along * a + across * b + at_rest <= high.
struct Grid {
    /// Upper bound of b at each point.
    b_max: Vec<f64>,
    /// Rows at each point: (along, across, low, high).
    rows: Vec<Vec<[f64; 4]>>,
}

impl Grid {
    fn new(spline: &Spline, s: &[f64], limits: &MotionLimits) -> Result<Self, PlanError> {
        let n = spline.dof();
        let (mut q, mut d, mut dd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut J = Vec::new();
        let mut b_max = Vec::with_capacity(s.len());
        let mut rows = Vec::with_capacity(s.len());
        for s in s {
            spline.at(*s, &mut q, &mut d, &mut dd);
            let mut b = f64::INFINITY;
            for (d, limit) in d.iter().zip(&limits.velocity) {
                if d.abs() > 1e-12 {
                    b = b.min((limit / d).powi(2));
                }
            }
            if let Some((arm, speed, turn)) = &limits.tool {
                arm.jacobian(&q, &mut J);
                let V: nalgebra::Vector6<f64> = J.iter().zip(&d).map(|(c, d)| c * *d).sum();
                for (part, limit) in [(V.fixed_rows::<3>(3).norm(), speed), (V.fixed_rows::<3>(0).norm(), turn)] {
                    if part > 1e-12 {
                        b = b.min((limit / part).powi(2));
                    }
                }
            }
            b_max.push(b.min(1e6));
            let mut here: Vec<[f64; 4]> = (0..n)
                .filter(|j| limits.acceleration[*j].is_finite())
                .map(|j| [d[j], dd[j], -limits.acceleration[j], limits.acceleration[j]])
                .collect();
            if let Some((effort, dynamics)) = &limits.effort {
                let zero = vec![0.0; n];
                let rest = dynamics(&q, &zero, &zero);
                let along = dynamics(&q, &zero, &d);
                // tau(q, q', q'') at s-speed 1 has the Coriolis terms of b = 1.
                let across = dynamics(&q, &d, &dd);
                for j in 0..n.min(effort.len()) {
                    if !effort[j].is_finite() {
                        continue;
                    }
                    if rest[j].abs() >= effort[j] {
                        return Err(PlanError::TooWeak {
                            stage: "timing".into(),
                            message: format!("joint {} needs {:.1} of {:.1} only to hold the arm still", j + 1, rest[j].abs(), effort[j]),
                        });
                    }
                    here.push([along[j] - rest[j], across[j] - rest[j], -effort[j] - rest[j], effort[j] - rest[j]]);
                }
            }
            rows.push(here);
        }
        Ok(Self { b_max, rows })
    }
}

/// Triplets of a sparse matrix, row by row.
#[derive(Default)]
pub(crate) struct Rows {
    i: Vec<usize>,
    j: Vec<usize>,
    v: Vec<f64>,
    pub(crate) b: Vec<f64>,
}

impl Rows {
    /// Adds sum(v x_j) + s = b.
    pub(crate) fn add(&mut self, entries: &[(usize, f64)], b: f64) {
        for (j, v) in entries.iter().filter(|(_, v)| *v != 0.0) {
            self.i.push(self.b.len());
            self.j.push(*j);
            self.v.push(*v);
        }
        self.b.push(b);
    }

    pub(crate) fn matrix(self, columns: usize) -> (CscMatrix<f64>, Vec<f64>) {
        (CscMatrix::new_from_triplets(self.b.len(), columns, self.i, self.j, self.v), self.b)
    }
}

/// The conic program. Variables: b_0..b_K, a_0..a_K-1, c_0..c_K, d_0..d_K-1.
fn solve(s: &[f64], grid: &Grid, limits: &MotionLimits) -> Result<Vec<f64>, PlanError> {
    let k = s.len() - 1;
    let (B, A, C, D) = (0, k + 1, 2 * k + 1, 3 * k + 2);
    let columns = 4 * k + 2;
    let h: Vec<f64> = (0..k).map(|i| s[i + 1] - s[i]).collect();
    // Scale of b: the duration is then near 1 in the solver's units.
    let scale = time_scale(s, grid);

    let mut rows = Rows::default();
    let mut cones: Vec<SupportedConeT<f64>> = Vec::new();
    rows.add(&[(B, 1.0)], 0.0);
    rows.add(&[(B + k, 1.0)], 0.0);
    for (i, h) in h.iter().enumerate().take(k) {
        rows.add(&[(B + i + 1, 1.0), (B + i, -1.0), (A + i, -2.0 * h)], 0.0);
    }
    cones.push(ZeroConeT(k + 2));
    let linear = rows.b.len();
    for i in 1..k {
        rows.add(&[(B + i, 1.0)], grid.b_max[i] / scale);
    }
    for i in 0..k {
        for end in [i, i + 1] {
            for [along, across, low, high] in &grid.rows[end] {
                // Rows that cannot bind are left out of the program only if both coefficients vanish.
                if along.abs().max(across.abs()) < 1e-10 {
                    continue;
                }
                let size = high.abs().max(low.abs()).max(1e-9);
                let f = scale / size;
                rows.add(&[(A + i, f * along), (B + end, f * across)], high / size);
                rows.add(&[(A + i, -f * along), (B + end, -f * across)], -low / size);
            }
        }
    }
    cones.push(NonnegativeConeT(rows.b.len() - linear));
    for i in 0..=k {
        // |(2 c, b - 1)| <= b + 1
        rows.add(&[(B + i, -1.0)], 1.0);
        rows.add(&[(C + i, -2.0)], 0.0);
        rows.add(&[(B + i, -1.0)], -1.0);
        cones.push(SecondOrderConeT(3));
    }
    for i in 0..k {
        // |(2, c + c' - d)| <= c + c' + d
        rows.add(&[(C + i, -1.0), (C + i + 1, -1.0), (D + i, -1.0)], 0.0);
        rows.add(&[], 2.0);
        rows.add(&[(C + i, -1.0), (C + i + 1, -1.0), (D + i, 1.0)], 0.0);
        cones.push(SecondOrderConeT(3));
    }
    let mut cost = vec![0.0; columns];
    for i in 0..k {
        cost[D + i] = 2.0 * h[i];
    }
    // smoothness * sum (a_i+1 - a_i)^2 / (middle distance): an integral of (da/ds)^2, in the solver's units.
    let (mut pi, mut pj, mut pv) = (Vec::new(), Vec::new(), Vec::new());
    if limits.smoothness > 0.0 {
        let mut diagonal = vec![0.0; k];
        for i in 0..k - 1 {
            let w = 2.0 * limits.smoothness * 0.01 / (0.5 * (h[i] + h[i + 1]));
            diagonal[i] += w;
            diagonal[i + 1] += w;
            pi.push(A + i);
            pj.push(A + i + 1);
            pv.push(-w);
        }
        for (i, d) in diagonal.iter().enumerate() {
            pi.push(A + i);
            pj.push(A + i);
            pv.push(*d);
        }
    }
    let P = CscMatrix::new_from_triplets(columns, columns, pi, pj, pv);
    let (A_matrix, b_vector) = rows.matrix(columns);
    let no = |message: String| PlanError::NoConvergence { stage: "timing".into(), message };
    let settings = DefaultSettingsBuilder::default().verbose(false).max_iter(200).build().map_err(|e| no(e.to_string()))?;
    let mut solver = DefaultSolver::new(&P, &cost, &A_matrix, &b_vector, &cones, settings).map_err(|e| no(e.to_string()))?;
    solver.solve();
    match solver.solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => {}
        other => return Err(no(format!("the conic program ended with {other:?}"))),
    }
    Ok((0..=k).map(|i| if i == 0 || i == k { 0.0 } else { (solver.solution.x[B + i] * scale).max(0.0) }).collect())
}

/// A rough b: as fast as the speed limits allow, and as the accelerations allow from rest to the middle.
fn time_scale(s: &[f64], grid: &Grid) -> f64 {
    let fastest = grid.b_max.iter().copied().fold(f64::INFINITY, f64::min);
    let push = grid.rows.iter().flatten().filter(|r| r[0].abs() > 1e-9).map(|r| r[3].min(-r[2]) / r[0].abs()).fold(f64::INFINITY, f64::min);
    fastest.min(push * (s[s.len() - 1] - s[0])).clamp(1e-6, 1e6)
}

/// Slows the whole motion down where fine sampling finds a limit exceeded, which happens between the grid's points only.
fn keep_limits(trajectory: JointTrajectory, limits: &MotionLimits) -> JointTrajectory {
    let mut trajectory = trajectory;
    for _ in 0..3 {
        let mut factor = 1.0_f64;
        for x in trajectory.fine_samples() {
            for j in 0..x.q.len() {
                factor = factor.max(x.v[j].abs() / limits.velocity[j]).max((x.a[j].abs() / limits.acceleration[j]).sqrt());
            }
            if let Some((effort, dynamics)) = &limits.effort {
                let zero = vec![0.0; x.q.len()];
                let (tau, rest) = (dynamics(&x.q, &x.v, &x.a), dynamics(&x.q, &zero, &zero));
                for j in 0..effort.len().min(tau.len()) {
                    // What motion adds to the weight falls with the square of the slow-down.
                    let room = if tau[j] > rest[j] { effort[j] - rest[j] } else { effort[j] + rest[j] };
                    if room > 0.0 {
                        factor = factor.max(((tau[j] - rest[j]).abs() / room).sqrt());
                    }
                }
            }
        }
        if factor <= 1.0 {
            break;
        }
        trajectory = trajectory.slowed(factor * (1.0 + 1e-6));
    }
    trajectory
}
