//! The cost of a reach: a link's frame `L` to a goal `G`, near a state, with little effort beyond what gravity needs.
//!
//! `l = (w_pose |r|^2 + w_state |x - x_ref|^2 + w_effort |u - g(q)|^2) / 2`, `r = log(X_GL)`, with Gauss-Newton Hessians. Running
//! costs are rates: they count times the step.
//!
//! With `log(X) = [w; V(w)^-1 p]`, `V(w)^-1 p = p - w x p / 2 + b w x (w x p)`, `b = 1 / t^2 - sin t / (2 t (1 - cos t))`, `t = |w|`
//! (Sola, Deray and Atchuthan 2018, equations 143 and 146), a twist `[omega; v]` of `L` in its own frame changes `w` by `A omega`
//! with `A = 1 + [w x] / 2 + b [w x]^2`, the inverse right Jacobian of rotations. As `V(w)^-1 R = A`, the rest of `r` changes by
//! `A v + C A omega`, where `C` is the derivative of `V(w)^-1 p` by `w`:
//!
//! `C = [p x] / 2 + b ((w . p) 1 + w p^T - 2 p w^T) + (b' / t) (w (w . p) - t^2 p) w^T`.

use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6xX, Point3, Vector3, Vector6};
use sagci_dynamics::{LinkId, State, System};

use super::{Cost, Knot, Quadratic, lost};
use crate::PlanError;

/// Weights of a reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachWeights {
    /// Of the squared pose error, rad^2 and m^2 alike.
    pub pose: f64,
    /// Of the squared distance to the reference state.
    pub state: f64,
    /// Of the squared effort beyond gravity's; at the end there is none.
    pub effort: f64,
}

/// Brings a link to a pose.
#[derive(Debug, Clone)]
pub struct ReachCost {
    link: LinkId,
    /// World in the goal's frame.
    X_GW: Isometry3<f64>,
    reference: State,
    running: ReachWeights,
    terminal: ReachWeights,
    J: Matrix6xX<f64>,
    gravity: Vec<f64>,
    d_gravity: DMatrix<f64>,
    dx: Vec<f64>,
}

impl ReachCost {
    /// A reach of a link to `X_WG`, with rates along the way and weights of the end. It keeps near `reference`, whose inner states of
    /// effects do not count.
    ///
    /// # Errors
    /// [`PlanError::BadInput`]: a link that is not there, a reference of another system, a weight that is negative or no number.
    pub fn new(
        system: &System,
        link: &str,
        X_WG: &Isometry3<f64>,
        reference: &State,
        running: ReachWeights,
        terminal: ReachWeights,
    ) -> Result<Self, PlanError> {
        let bad = |message: String| PlanError::BadInput { message };
        let n = system.multibody().nv();
        if reference.q.len() != system.multibody().nq() || reference.v.len() != n {
            return Err(bad("the reference of a reach is a state of another system".into()));
        }
        for w in [running, terminal].iter().flat_map(|w| [w.pose, w.state, w.effort]) {
            if !(w >= 0.0 && w.is_finite()) {
                return Err(bad(format!("a weight of a reach is {w}; it must be at least 0")));
            }
        }
        let link = system.multibody().link(link).map_err(|e| bad(e.to_string()))?;
        Ok(Self {
            link,
            X_GW: X_WG.inverse(),
            reference: reference.clone(),
            running,
            terminal,
            J: Matrix6xX::zeros(n),
            gravity: vec![0.0; n],
            d_gravity: DMatrix::zeros(n, n),
            dx: vec![0.0; n],
        })
    }

    fn value(&mut self, knot: &mut Knot<'_>, weights: &ReachWeights, u: &[f64], model: &mut Quadratic) -> Result<f64, PlanError> {
        let (multibody, n) = (knot.system.multibody(), u.len().max(knot.state.v.len()));
        let failed = |e| lost(knot.index, &e);
        let X_WL = multibody.X_WL(knot.rigid, self.link);
        let log = PoseLog::new(&(self.X_GW * X_WL));
        multibody.difference(&self.reference.q, &knot.state.q, &mut self.dx).map_err(failed)?;
        let slow = knot.state.v.iter().zip(&self.reference.v).map(|(v, r)| v - r);
        let far = self.dx.iter().map(|d| d * d).chain(slow.clone().map(|d| d * d)).sum::<f64>();
        let mut value = weights.pose * log.r.norm_squared() + weights.state * far;
        let effort = if u.is_empty() { 0.0 } else { weights.effort };
        model.clear();
        multibody.jacobian(knot.rigid, self.link, &Point3::origin(), &mut self.J).map_err(failed)?;
        // Rows of the Jacobian of r: top = D Jw, bottom = E Jw + D Jv.
        let D = log.A * X_WL.rotation.inverse().to_rotation_matrix();
        let E = log.C * D;
        for mut column in self.J.column_iter_mut() {
            let (w, v) = (column.fixed_rows::<3>(0).into_owned(), column.fixed_rows::<3>(3).into_owned());
            column.fixed_rows_mut::<3>(0).copy_from(&(D * w));
            column.fixed_rows_mut::<3>(3).copy_from(&(E * w + D * v));
        }
        for (i, J_i) in self.J.column_iter().enumerate() {
            model.x[i] = weights.pose * J_i.dot(&log.r) + weights.state * self.dx[i];
            let weighted: Vector6<f64> = J_i * weights.pose;
            for (j, J_j) in self.J.column_iter().enumerate().take(i + 1) {
                let entry = weighted.dot(&J_j);
                model.xx[(i, j)] = entry;
                model.xx[(j, i)] = entry;
            }
        }
        for (i, slow) in slow.enumerate() {
            model.x[n + i] = weights.state * slow;
            model.xx[(i, i)] += weights.state;
            model.xx[(n + i, n + i)] = weights.state;
        }
        if effort > 0.0 {
            multibody.gravity_efforts_derivatives(knot.rigid, &mut self.gravity, &mut self.d_gravity).map_err(failed)?;
            for (i, (u, g)) in u.iter().zip(&self.gravity).enumerate() {
                let beyond = u - g;
                value += effort * beyond * beyond;
                model.u[i] = effort * beyond;
                model.uu[(i, i)] = effort;
            }
            for i in 0..n {
                let by_i = self.d_gravity.column(i);
                model.x[i] -= by_i.dot(&model.u);
                for j in 0..n {
                    model.xu[(i, j)] = -effort * by_i[j];
                }
                for j in 0..=i {
                    let entry = effort * by_i.dot(&self.d_gravity.column(j));
                    model.xx[(i, j)] += entry;
                    if i != j {
                        model.xx[(j, i)] += entry;
                    }
                }
            }
        }
        Ok(0.5 * value)
    }
}

impl Cost for ReachCost {
    fn running(&mut self, knot: &mut Knot<'_>, u: &[f64], model: &mut Quadratic) -> Result<f64, PlanError> {
        let rates = self.running;
        let weights = ReachWeights { pose: rates.pose * knot.dt, state: rates.state * knot.dt, effort: rates.effort * knot.dt };
        self.value(knot, &weights, u, model)
    }

    fn terminal(&mut self, knot: &mut Knot<'_>, model: &mut Quadratic) -> Result<f64, PlanError> {
        let weights = self.terminal;
        self.value(knot, &weights, &[], model)
    }
}

/// Logarithm of a pose with what its derivative needs.
struct PoseLog {
    r: Vector6<f64>,
    A: Matrix3<f64>,
    C: Matrix3<f64>,
}

impl PoseLog {
    fn new(X: &Isometry3<f64>) -> Self {
        let (w, p): (Vector3<f64>, _) = (X.rotation.scaled_axis(), X.translation.vector);
        let t2 = w.norm_squared();
        // b and b' / t; by their series where the closed forms cancel.
        let (b, rate) = if t2 < 0.04 {
            let b = 1.0 / 12.0 + t2 * (1.0 / 720.0 + t2 * (1.0 / 30_240.0 + t2 / 1_209_600.0));
            (b, 1.0 / 360.0 + t2 * (1.0 / 7560.0 + t2 * (1.0 / 201_600.0 + t2 / 5_987_520.0)))
        } else {
            let t = t2.sqrt();
            let (sin, cos) = t.sin_cos();
            let half = 0.5 / (1.0 - cos);
            (1.0 / t2 - sin / t * half, -2.0 / (t2 * t2) + (1.0 + sin / t) * half / t2)
        };
        let (along, cross) = (w.dot(&p), w.cross_matrix());
        let bent = w * along - p * t2;
        let linear = p - w.cross(&p) * 0.5 + bent * b;
        let A = Matrix3::identity() + cross * 0.5 + cross * cross * b;
        let C = p.cross_matrix() * 0.5
            + (Matrix3::identity() * along + w * p.transpose() - p * w.transpose() * 2.0) * b
            + bent * w.transpose() * rate;
        Self { r: Vector6::new(w.x, w.y, w.z, linear.x, linear.y, linear.z), A, C }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion};

    use super::*;

    #[test]
    fn the_logarithm_changes_along_twists_as_differences_say() {
        for size in [0.0, 1e-4, 0.01, 0.19, 0.21, 0.7, 2.0, 3.0] {
            let turn = Vector3::new(0.48, -0.6, 0.64) * size;
            let X = Isometry3::from_parts(Translation3::new(0.3, -0.5, 0.8), UnitQuaternion::from_scaled_axis(turn));
            let log = PoseLog::new(&X);
            for k in 0..6 {
                let moved = |h: f64| {
                    let mut twist = Vector6::zeros();
                    twist[k] = h;
                    let (w, v) = (twist.fixed_rows::<3>(0).into_owned(), twist.fixed_rows::<3>(3).into_owned());
                    // To first order in h, which central differences need no more than.
                    PoseLog::new(&(X * Isometry3::from_parts(v.into(), UnitQuaternion::from_scaled_axis(w)))).r
                };
                let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                let e = Vector3::ith(k % 3, 1.0);
                let (top, bottom) = if k < 3 { (log.A * e, log.C * log.A * e) } else { (Vector3::zeros(), log.A * e) };
                let ours = Vector6::new(top.x, top.y, top.z, bottom.x, bottom.y, bottom.z);
                assert!((slope - ours).amax() < 1e-8, "turn {size}, twist {k}: {ours} against {slope}");
            }
        }
    }
}
