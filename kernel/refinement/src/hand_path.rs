//! A joint from the path of the hand that held its handle.
//!
//! While the grip holds, the hand moves with the link: `X_WT(i) = S(q_i) X_WT(0)` with `S` a turn about an axis `a`
//! through a point `c`, or a shift along `a`. Each kind is fitted to all poses by weighted nonlinear least squares
//! (Gauss-Newton with Levenberg and Marquardt's damping) over `X_WT(0)`, `a`, `c` and one `q_i` for each pose; each `q_i`
//! meets only its own pose, and is eliminated by a Schur complement.
//!
//! Poses that follow one another err together. From the residuals' lag-one correlation `r` the effective number of poses
//! is `n (1 - r) / (1 + r)`, as for a first-order autoregressive process; it scales the covariance, and the evidence by
//! Schwarz's criterion, `-2 ln p = chi^2 + k ln n`, which chooses the kind. The same residual scale serves both kinds.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, SMatrix, Translation3, Unit, UnitQuaternion, Vector3, Vector6};
use sagci_model::{JointKind, ObjectModel};

/// Poses that are used at most; a path of 1 kHz holds thousands that say the same.
const MOST_POSES: usize = 150;
/// Rounds of the fit at most.
const ROUNDS: usize = 60;

/// The path of a hand that holds a handle, and how well it is known.
#[derive(Debug, Clone)]
pub struct HandPath<'a> {
    /// Poses of the tool frame in the world, in the order of time.
    pub X_WT: &'a [Isometry3<f64>],
    /// Standard deviation of the hand's place with respect to the handle along each axis, m.
    pub position_deviation: f64,
    /// Standard deviation of its orientation about each axis, rad.
    pub turn_deviation: f64,
    /// The axis in the tool frame about which the grip may turn on the handle, and by how much (standard deviation, rad).
    pub slip: Option<(Unit<Vector3<f64>>, f64)>,
}

impl<'a> HandPath<'a> {
    /// A path as an arm with a firm grip gives it: 2 mm and 1.5 degrees.
    pub fn firm(X_WT: &'a [Isometry3<f64>]) -> Self {
        Self { X_WT, position_deviation: 0.002, turn_deviation: 1.5f64.to_radians(), slip: None }
    }
}

/// Why no joint could be read off a path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HandPathError {
    /// The path or its deviations cannot be used.
    #[error("hand path: {0}")]
    Bad(String),
    /// The hand hardly moved.
    #[error(
        "hand path: the hand moved by {distance:.4} m and {turn:.3} rad only, which its deviations hide; move it by 20 degrees or 10 cm"
    )]
    TooShort {
        /// Greatest distance from the first pose, m.
        distance: f64,
        /// Greatest turn from the first pose, rad.
        turn: f64,
    },
    /// No kind of joint fits.
    #[error("hand path: the fit did not converge; the grip may have slipped")]
    NoConvergence,
}

/// A joint as the hand's path shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct JointEstimate {
    /// [`JointKind::Revolute`] or [`JointKind::Prismatic`].
    pub kind: JointKind,
    /// Probability of this kind against the other one, 0..1.
    pub probability: f64,
    /// Axis in the world; motion along the path is positive.
    pub axis_W: Unit<Vector3<f64>>,
    /// Covariance of the axis, a unit vector: none along itself.
    pub axis_covariance: Matrix3<f64>,
    /// A point on the axis in the world, m: nearest to the hand's first place for a revolute joint; that place itself for
    /// a prismatic one.
    pub origin_W: Point3<f64>,
    /// Covariance of that point across the axis, m^2; zero for a prismatic joint.
    pub origin_covariance: Matrix3<f64>,
    /// Positions along the path from its first pose, rad or m: one for each pose that was used.
    pub q: Vec<f64>,
    /// Index in the path of each pose that was used.
    pub poses: Vec<usize>,
    /// Number of poses that err independently.
    pub effective_poses: f64,
    /// Root mean square of what the fit leaves, m and rad.
    pub residual: [f64; 2],
}

impl JointEstimate {
    /// How far the joint moved, rad or m.
    pub fn motion(&self) -> f64 {
        self.q.iter().copied().fold(0.0, f64::max) - self.q.iter().copied().fold(0.0, f64::min)
    }
}

/// Reads kind, axis, place and motion of a joint off the path of the hand that held its handle.
///
/// # Errors
/// If the path is too short, or not made of numbers, or no joint fits it.
pub fn joint_from_hand_path(path: &HandPath<'_>) -> Result<JointEstimate, HandPathError> {
    let bad = |message: &str| Err(HandPathError::Bad(message.to_owned()));
    if path.X_WT.iter().any(|X| !X.to_matrix().iter().all(|x| x.is_finite())) {
        return bad("a pose is not made of finite numbers");
    }
    let deviations = [path.position_deviation, path.turn_deviation, path.slip.map_or(1.0, |s| s.1)];
    if !deviations.iter().all(|d| d.is_finite() && *d > 0.0) {
        return bad("a deviation is not a positive number");
    }
    let poses = thinned(path.X_WT.len());
    let X: Vec<Isometry3<f64>> = poses.iter().map(|i| path.X_WT[*i]).collect();
    if X.len() < 8 {
        return bad("has fewer than eight poses");
    }
    let distance = X.iter().map(|x| (x.translation.vector - X[0].translation.vector).norm()).fold(0.0, f64::max);
    let turn = X.iter().map(|x| x.rotation.angle_to(&X[0].rotation)).fold(0.0, f64::max);
    if distance < 5.0 * path.position_deviation && turn < 5.0 * path.turn_deviation {
        return Err(HandPathError::TooShort { distance, turn });
    }

    let problem = Problem::new(path, X);
    let prismatic = problem.fit(problem.line());
    let revolute =
        [problem.screw(), problem.circle()].into_iter().flatten().filter_map(|s| problem.fit(s)).min_by(|a, b| a.cost.total_cmp(&b.cost));
    let best_cost = match (&prismatic, &revolute) {
        (None, None) => return Err(HandPathError::NoConvergence),
        (a, b) => [a, b].into_iter().flatten().map(|f| f.cost).fold(f64::INFINITY, f64::min),
    };
    let best = [&prismatic, &revolute].into_iter().flatten().find(|f| f.cost <= best_cost).ok_or(HandPathError::NoConvergence)?;
    let share = problem.independent_share(best);
    let n = problem.X.len() as f64;
    let effective = n * share;
    // What the better fit leaves tells the true size of the deviations, but never less than stated: those are known.
    let scale = (best.cost / (5.0 * n - best.state.size() as f64).max(1.0)).max(1.0);
    let criterion = |fit: &Fit| fit.cost / scale * share + fit.state.size() as f64 * effective.max(2.0).ln();
    let (fit, probability) = match (prismatic, revolute) {
        (Some(p), Some(r)) => {
            // The odds saturate far beyond what floating point can hold.
            let odds = ((criterion(&r) - criterion(&p)) / 2.0).clamp(-300.0, 300.0).exp();
            if odds >= 1.0 { (p, odds / (1.0 + odds)) } else { (r, 1.0 / (1.0 + odds)) }
        }
        (Some(only), None) | (None, Some(only)) => (only, 1.0),
        (None, None) => return Err(HandPathError::NoConvergence),
    };
    problem.estimate(fit, probability, effective, scale / share, poses)
}

/// Evenly spread indices.
fn thinned(count: usize) -> Vec<usize> {
    if count <= MOST_POSES {
        return (0..count).collect();
    }
    (0..MOST_POSES).map(|k| k * (count - 1) / (MOST_POSES - 1)).collect()
}

struct Problem {
    X: Vec<Isometry3<f64>>,
    /// Square root of the information of turn (in the world's axes at the first pose), and of place.
    turn_weight: Matrix3<f64>,
    slips: bool,
    turn_scale: f64,
    place_scale: f64,
    slip_axis: Vector3<f64>,
    slip_scale: f64,
}

/// What is fitted.
#[derive(Clone)]
struct State {
    turns: bool,
    X0: Isometry3<f64>,
    axis: Unit<Vector3<f64>>,
    center: Point3<f64>,
    q: Vec<f64>,
}

struct Fit {
    state: State,
    cost: f64,
    /// Information of the shared parameters with every q eliminated.
    information: DMatrix<f64>,
}

impl State {
    /// Number of shared parameters.
    fn size(&self) -> usize {
        if self.turns { 10 } else { 8 }
    }

    /// Two unit vectors across the axis.
    fn across(&self) -> [Vector3<f64>; 2] {
        let a = self.axis.into_inner();
        let least = a.iamin();
        let u = a.cross(&Vector3::ith(least, 1.0)).normalize();
        [u, a.cross(&u)]
    }

    fn rotation(&self, q: f64) -> UnitQuaternion<f64> {
        if self.turns { UnitQuaternion::from_axis_angle(&self.axis, q) } else { UnitQuaternion::identity() }
    }

    fn pose(&self, q: f64) -> Isometry3<f64> {
        if self.turns {
            let R = self.rotation(q);
            let p = self.center + R * (Point3::from(self.X0.translation.vector) - self.center);
            Isometry3::from_parts(Translation3::from(p.coords), R * self.X0.rotation)
        } else {
            Isometry3::from_parts(Translation3::from(self.X0.translation.vector + self.axis.into_inner() * q), self.X0.rotation)
        }
    }

    fn moved(&self, step: &DVector<f64>, q_step: &[f64]) -> Self {
        let part = |i: usize| Vector3::new(step[i], step[i + 1], step[i + 2]);
        let [u, w] = self.across();
        let tilt = UnitQuaternion::from_scaled_axis(u * step[6] + w * step[7]);
        let axis = Unit::new_normalize(tilt * self.axis.into_inner());
        let center = if self.turns { self.center + u * step[8] + w * step[9] } else { self.center };
        let X0 = Isometry3::from_parts(
            Translation3::from(self.X0.translation.vector + part(3)),
            UnitQuaternion::from_scaled_axis(part(0)) * self.X0.rotation,
        );
        let q = self.q.iter().zip(q_step).map(|(q, d)| q + d).collect();
        Self { turns: self.turns, X0, axis, center, q }
    }
}

impl Problem {
    fn new(path: &HandPath<'_>, X: Vec<Isometry3<f64>>) -> Self {
        let turn_scale = 1.0 / path.turn_deviation;
        let (slip_axis, slip_scale) = path
            .slip
            .map_or((Vector3::z(), turn_scale), |(axis, deviation)| (axis.into_inner(), 1.0 / path.turn_deviation.hypot(deviation)));
        Self {
            X,
            turn_weight: Matrix3::identity() * turn_scale,
            slips: path.slip.is_some(),
            turn_scale,
            place_scale: 1.0 / path.position_deviation,
            slip_axis,
            slip_scale,
        }
    }

    /// Square root of the information of the turn of a pose, in the world's axes: less about the axis of slip.
    fn weight(&self, X: &Isometry3<f64>) -> Matrix3<f64> {
        if !self.slips {
            return self.turn_weight;
        }
        let s = X.rotation * self.slip_axis;
        self.turn_weight + s * s.transpose() * (self.slip_scale - self.turn_scale)
    }

    fn residual(&self, state: &State, i: usize) -> Vector6<f64> {
        let (X, P) = (&self.X[i], state.pose(state.q[i]));
        let turn = self.weight(X) * (X.rotation * P.rotation.inverse()).scaled_axis();
        let place = (X.translation.vector - P.translation.vector) * self.place_scale;
        Vector6::new(turn.x, turn.y, turn.z, place.x, place.y, place.z)
    }

    fn cost(&self, state: &State) -> f64 {
        (0..self.X.len()).map(|i| self.residual(state, i).norm_squared()).sum()
    }

    /// Derivatives of the predicted pose (turn, then place; world's axes) by the shared parameters and by its own q.
    fn slopes(&self, state: &State, i: usize) -> (SMatrix<f64, 6, 10>, Vector6<f64>) {
        let q = state.q[i];
        let R = state.rotation(q).to_rotation_matrix().into_inner();
        let a = state.axis.into_inner();
        let mut J = SMatrix::<f64, 6, 10>::zeros();
        let mut s = Vector6::zeros();
        J.fixed_view_mut::<3, 3>(0, 0).copy_from(&R);
        J.fixed_view_mut::<3, 3>(3, 3).copy_from(&R);
        let across = state.across();
        if state.turns {
            let r0 = Point3::from(state.X0.translation.vector) - state.center;
            let r = R * r0;
            s.fixed_rows_mut::<3>(0).copy_from(&a);
            s.fixed_rows_mut::<3>(3).copy_from(&a.cross(&r));
            for (k, t) in across.iter().enumerate() {
                // The axis tilts: Rot' = Omega Rot Omega^T about the centre.
                J.fixed_view_mut::<3, 1>(0, 6 + k).copy_from(&(t - R * t));
                J.fixed_view_mut::<3, 1>(3, 6 + k).copy_from(&(t.cross(&r) - R * t.cross(&r0)));
                J.fixed_view_mut::<3, 1>(3, 8 + k).copy_from(&(t - R * t));
            }
        } else {
            s.fixed_rows_mut::<3>(3).copy_from(&a);
            for (k, t) in across.iter().enumerate() {
                J.fixed_view_mut::<3, 1>(3, 6 + k).copy_from(&(t.cross(&a) * q));
            }
        }
        let weight = self.weight(&self.X[i]);
        let turn = weight * J.fixed_rows::<3>(0);
        J.fixed_rows_mut::<3>(0).copy_from(&turn);
        let place = J.fixed_rows::<3>(3) * self.place_scale;
        J.fixed_rows_mut::<3>(3).copy_from(&place);
        let turn = weight * s.fixed_rows::<3>(0);
        s.fixed_rows_mut::<3>(0).copy_from(&turn);
        let place = s.fixed_rows::<3>(3) * self.place_scale;
        s.fixed_rows_mut::<3>(3).copy_from(&place);
        (J, s)
    }

    fn fit(&self, start: State) -> Option<Fit> {
        let n = start.size();
        let mut state = start;
        let mut cost = self.cost(&state);
        let mut damping = 1e-4;
        let mut information = DMatrix::zeros(n, n);
        for _ in 0..ROUNDS {
            let mut H = DMatrix::<f64>::zeros(n, n);
            let mut g = DVector::<f64>::zeros(n);
            let mut own: Vec<(DVector<f64>, f64, f64)> = Vec::with_capacity(self.X.len());
            for i in 0..self.X.len() {
                let (J, s) = self.slopes(&state, i);
                let J = J.columns(0, n).into_owned();
                let e = self.residual(&state, i);
                H += J.transpose() * &J;
                g += J.transpose() * e;
                // The first pose defines q = 0.
                let (h, hq, gq) =
                    if i == 0 { (DVector::zeros(n), 1.0, 0.0) } else { (J.transpose() * s, s.norm_squared().max(1e-12), s.dot(&e)) };
                H -= &h * h.transpose() / hq;
                g -= &h * (gq / hq);
                own.push((h, hq, gq));
            }
            information = H.clone();
            let mut improved = false;
            for _ in 0..8 {
                let mut damped = H.clone();
                for k in 0..n {
                    damped[(k, k)] += damping * H[(k, k)].max(1e-9);
                }
                let step = damped.cholesky().map(|c| c.solve(&g));
                if let Some(step) = step.filter(|s| s.iter().all(|x| x.is_finite())) {
                    let q_step: Vec<f64> = own.iter().map(|(h, hq, gq)| (gq - h.dot(&step)) / hq).collect();
                    let next = state.moved(&step, &q_step);
                    let next_cost = self.cost(&next);
                    if next_cost < cost {
                        let gain = cost - next_cost;
                        (state, cost) = (next, next_cost);
                        damping = (damping * 0.2).max(1e-12);
                        improved = gain > 1e-10 * (1.0 + cost);
                        break;
                    }
                }
                damping *= 10.0;
            }
            if !improved {
                break;
            }
        }
        cost.is_finite().then_some(Fit { state, cost, information })
    }

    /// A start for a prismatic joint: the direction of greatest spread.
    fn line(&self) -> State {
        let p0 = self.X[0].translation.vector;
        let (axis, _) = self.spread();
        let q = self.X.iter().map(|X| axis.dot(&(X.translation.vector - p0))).collect();
        self.forward(State { turns: false, X0: self.X[0], axis, center: Point3::from(p0), q })
    }

    /// A start for a revolute joint from the turns of the hand: the axis of the greatest turn, and the centre that all
    /// positions agree on best, `(1 - R_i) c = p_i - R_i p_0`.
    fn screw(&self) -> Option<State> {
        let X0 = self.X[0];
        let farthest = self.X.iter().max_by(|a, b| a.rotation.angle_to(&X0.rotation).total_cmp(&b.rotation.angle_to(&X0.rotation)))?;
        let axis = Unit::try_new((farthest.rotation * X0.rotation.inverse()).scaled_axis(), 1e-4)?;
        let q: Vec<f64> = self.X.iter().map(|X| axis.dot(&(X.rotation * X0.rotation.inverse()).scaled_axis())).collect();
        // Along the axis the centre is free: it is held near the first place.
        let mut A = axis.into_inner() * axis.transpose();
        let p0 = X0.translation.vector;
        let mut b = axis.into_inner() * axis.dot(&p0);
        for (X, q) in self.X.iter().zip(&q) {
            let R = UnitQuaternion::from_axis_angle(&axis, *q).to_rotation_matrix().into_inner();
            let M = Matrix3::identity() - R;
            A += M.transpose() * M;
            b += M.transpose() * (X.translation.vector - R * p0);
        }
        let center = Point3::from(A.try_inverse()? * b);
        Some(State { turns: true, X0, axis, center, q })
    }

    /// A start for a revolute joint from the places of the hand: the circle through them in their plane (Kasa's fit).
    fn circle(&self) -> Option<State> {
        let p0 = self.X[0].translation.vector;
        let (along, normal) = self.spread();
        let side = normal.cross(&along);
        let (mut A, mut b) = (Matrix3::zeros(), Vector3::zeros());
        for X in &self.X {
            let d = X.translation.vector - p0;
            let (x, y) = (along.dot(&d), side.dot(&d));
            let row = Vector3::new(2.0 * x, 2.0 * y, 1.0);
            A += row * row.transpose();
            b += row * (x * x + y * y);
        }
        let s = A.try_inverse()? * b;
        if !(s.x.is_finite() && s.y.is_finite() && s.xy().norm() < 100.0) {
            return None;
        }
        let c = p0 + along.into_inner() * s.x + side * s.y;
        let start = p0 - c;
        let mut q = Vec::with_capacity(self.X.len());
        for X in &self.X {
            let r = X.translation.vector - c;
            q.push(normal.dot(&start.cross(&r)).atan2(start.dot(&r)));
        }
        Some(self.forward(State { turns: true, X0: self.X[0], axis: normal, center: Point3::from(c), q }))
    }

    /// Directions of the greatest and the least spread of the places.
    fn spread(&self) -> (Unit<Vector3<f64>>, Unit<Vector3<f64>>) {
        let n = self.X.len() as f64;
        let mean = self.X.iter().map(|X| X.translation.vector).sum::<Vector3<f64>>() / n;
        let mut C = Matrix3::zeros();
        for X in &self.X {
            let d = X.translation.vector - mean;
            C += d * d.transpose();
        }
        let eigen = C.symmetric_eigen();
        let (most, least) = (eigen.eigenvalues.imax(), eigen.eigenvalues.imin());
        let unit = |k: usize| Unit::new_normalize(eigen.eigenvectors.column(k).into_owned());
        (unit(most), unit(if least == most { (most + 1) % 3 } else { least }))
    }

    /// Turns the axis so that the path goes forward.
    fn forward(&self, mut state: State) -> State {
        if state.q.iter().sum::<f64>() < 0.0 {
            state.axis = -state.axis;
            state.q.iter_mut().for_each(|q| *q = -*q);
        }
        state
    }

    /// Share of the poses that err independently, from the residuals' lag-one correlation.
    fn independent_share(&self, fit: &Fit) -> f64 {
        let residuals: Vec<_> = (0..self.X.len()).map(|i| self.residual(&fit.state, i)).collect();
        let products: f64 = residuals.windows(2).map(|w| w[0].dot(&w[1])).sum();
        let squares: f64 = residuals.windows(2).map(|w| (w[0].norm_squared() + w[1].norm_squared()) / 2.0).sum();
        let r = if squares > 0.0 { (products / squares).clamp(0.0, 0.98) } else { 0.0 };
        ((1.0 - r) / (1.0 + r)).max(4.0 / self.X.len() as f64)
    }

    fn estimate(
        &self,
        fit: Fit,
        probability: f64,
        effective_poses: f64,
        scale: f64,
        poses: Vec<usize>,
    ) -> Result<JointEstimate, HandPathError> {
        let n = fit.state.size();
        let covariance = fit.information.clone().try_inverse().ok_or(HandPathError::NoConvergence)? * scale;
        // The covariance holds in the directions of the fit, whichever way its axis points.
        let [u, w] = fit.state.across();
        let a = fit.state.axis.into_inner();
        let state = self.forward(fit.state);
        let tilt = nalgebra::Matrix3x2::from_columns(&[u.cross(&a), w.cross(&a)]);
        let axis_covariance = tilt * covariance.fixed_view::<2, 2>(6, 6) * tilt.transpose();
        let first = Point3::from(state.X0.translation.vector);
        let (origin_W, origin_covariance) = if n == 10 {
            // The point of the axis nearest to the hand's first place moves with the tilt too.
            let along = a.dot(&(first - state.center));
            let mut M = nalgebra::Matrix3x4::zeros();
            M.fixed_view_mut::<3, 2>(0, 0).copy_from(&(tilt * along));
            M.fixed_view_mut::<3, 2>(0, 2).copy_from(&nalgebra::Matrix3x2::from_columns(&[u, w]));
            (state.center + a * along, M * covariance.fixed_view::<4, 4>(6, 6) * M.transpose())
        } else {
            (first, Matrix3::zeros())
        };
        let count = self.X.len() as f64;
        let (mut place, mut turn) = (0.0, 0.0);
        for (X, q) in self.X.iter().zip(&state.q) {
            let P = state.pose(*q);
            place += (X.translation.vector - P.translation.vector).norm_squared();
            turn += X.rotation.angle_to(&P.rotation).powi(2);
        }
        Ok(JointEstimate {
            kind: if state.turns { JointKind::Revolute } else { JointKind::Prismatic },
            probability,
            axis_W: state.axis,
            axis_covariance,
            origin_W,
            origin_covariance,
            q: state.q,
            poses,
            effective_poses,
            residual: [(place / count).sqrt(), (turn / count).sqrt()],
        })
    }
}

/// A joint's axis as the stored model has it.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredAxis {
    /// What motion it allows.
    pub kind: JointKind,
    /// Axis in the world.
    pub axis_W: Unit<Vector3<f64>>,
    /// A point on it in the world, m.
    pub origin_W: Point3<f64>,
}

/// Where a stored joint's axis lies in the world, for a root link at `X_WO` and moving joints at `q`; nothing if the model
/// has no such joint.
pub fn stored_axis(model: &ObjectModel, joint: &str, X_WO: &Isometry3<f64>, q: &[f64]) -> Option<StoredAxis> {
    let joint = model.joints.get(model.joint(joint)?)?;
    let X_WJ = X_WO * model.X_OL(q).get(joint.parent)? * joint.X_PJ;
    Some(StoredAxis {
        kind: joint.kind,
        axis_W: Unit::new_unchecked(X_WJ * joint.axis.into_inner()),
        origin_W: Point3::from(X_WJ.translation.vector),
    })
}

/// How far a stored axis is from the measured one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisGap {
    /// The kinds are the same.
    pub same_kind: bool,
    /// Angle between the axes, rad.
    pub angle: f64,
    /// Its standard deviation, rad.
    pub angle_deviation: f64,
    /// Distance of the stored axis from the measured one's point beside the hand, m; nothing for a prismatic joint, whose
    /// axis has no place.
    pub distance: Option<f64>,
    /// Its standard deviation, m.
    pub distance_deviation: Option<f64>,
}

/// Compares a stored axis with a measured one.
pub fn axis_gap(stored: &StoredAxis, measured: &JointEstimate) -> AxisGap {
    let revolves = |k: JointKind| matches!(k, JointKind::Revolute | JointKind::Continuous);
    let same_kind = stored.kind == measured.kind || (revolves(stored.kind) && revolves(measured.kind));
    let (a, b) = (stored.axis_W.into_inner(), measured.axis_W.into_inner());
    // A path may lead either way along an axis.
    let b = if a.dot(&b) < 0.0 { -b } else { b };
    let angle = a.cross(&b).norm().atan2(a.dot(&b));
    let away = |d: Vector3<f64>| Unit::try_new(d, 1e-12).map_or(Vector3::zeros(), Unit::into_inner);
    let deviation = |direction: Vector3<f64>, C: &Matrix3<f64>| {
        if direction == Vector3::zeros() {
            (C.trace() / 2.0).max(0.0).sqrt()
        } else {
            (direction.transpose() * C * direction)[0].max(0.0).sqrt()
        }
    };
    let angle_deviation = deviation(away(a - b * a.dot(&b)), &measured.axis_covariance);
    let (distance, distance_deviation) = if same_kind && revolves(measured.kind) {
        let d = measured.origin_W - stored.origin_W;
        let across = d - a * a.dot(&d);
        (Some(across.norm()), Some(deviation(away(across), &measured.origin_covariance)))
    } else {
        (None, None)
    };
    AxisGap { same_kind, angle, angle_deviation, distance, distance_deviation }
}
