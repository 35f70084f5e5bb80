//! The law of one contact point: normal compliance, and Coulomb friction on a cone.
//!
//! With the depth `d0` at the old state, the old and the next normal velocity `v0`, `v` (positive where the bodies part), the
//! step `h`, stiffness `k` and Hunt-Crossley dissipation `c`, the normal impulse is
//!
//! `g_n(v) = h k (d0 - share h v)+ (1 - c v)+`.
//!
//! It falls in `v`, so it is the derivative of a convex potential. `share` is the part of the step over which the depth is
//! taken ahead: 1 is stable at any stiffness, 0 keeps the energy of elastic impacts that last several steps.
//!
//! Friction is bounded by `mu n0` with the normal impulse `n0 = h k (d0)+ (1 - c v0)+` of the old state:
//! `g_t = -mu n0 s`, with `s = v_t / slip` in stiction (`|v_t| <= slip`) and `s = v_t / |v_t|` in sliding. At a fixed bound that
//! is the derivative of a convex potential too, on a round cone, and it does not feed sliding into the normal direction, as the
//! relaxation of Anitescu (2006) does (a box that slides there hovers). This is the lagged model of Castro, Han and Masterjohn
//! (2023, "A Theory of Irrotational Contact Fields", sections IV and V), which grew out of Castro et al. (2022, SAP).
//! Over an impact the bounds add up to the whole normal impulse, one step late.
//!
//! The law is continuous. Its derivatives jump where a contact opens (`d0 = 0`, `d0 = share h v`, `v = 1 / c`) and where
//! stiction ends (`|v_t| = slip`); there each derivative is that of one side.

use nalgebra::{Matrix3, Vector3};

/// Constants of one contact point over one step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Law {
    /// N/m.
    pub stiffness: f64,
    /// s/m.
    pub dissipation: f64,
    /// Coulomb's coefficient.
    pub friction: f64,
}

/// Constants of all points over one step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Scheme {
    /// Step, s.
    pub h: f64,
    /// Part of the step over which depths are taken ahead, 0 to 1.
    pub share: f64,
    /// Greatest speed of stiction, m/s.
    pub slip: f64,
}

/// A normal impulse with its derivatives.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Normal {
    /// N s.
    pub value: f64,
    /// By the normal velocity; never positive.
    pub by_v: f64,
    /// By the depth.
    pub by_depth: f64,
    /// By the dissipation.
    pub by_dissipation: f64,
}

impl Law {
    /// The next normal impulse.
    #[inline]
    pub fn normal(&self, scheme: &Scheme, depth: f64, v: f64) -> Normal {
        self.spring(scheme.h, depth - scheme.share * scheme.h * v, v, scheme.share * scheme.h)
    }

    /// The normal impulse of the old state, which bounds friction.
    #[inline]
    pub fn bound(&self, scheme: &Scheme, depth: f64, v0: f64) -> Normal {
        self.spring(scheme.h, depth, v0, 0.0)
    }

    #[inline]
    fn spring(&self, h: f64, depth: f64, v: f64, ahead: f64) -> Normal {
        let loss = 1.0 - self.dissipation * v;
        if depth <= 0.0 || loss <= 0.0 {
            return Normal::default();
        }
        let hk = h * self.stiffness;
        Normal {
            value: hk * depth * loss,
            by_v: -hk * (ahead * loss + self.dissipation * depth),
            by_depth: hk * loss,
            by_dissipation: -hk * depth * v,
        }
    }
}

/// `s` of the tangential velocity, its derivative (a symmetric matrix), and whether it is in stiction.
#[inline]
pub(crate) fn direction(slip: f64, v_t: &Vector3<f64>) -> (Vector3<f64>, bool, f64) {
    let speed = v_t.norm();
    if speed <= slip { (v_t / slip, true, speed) } else { (v_t / speed, false, speed) }
}

/// `ds/dv_t`, to be applied to changes of `v_t`.
#[inline]
pub(crate) fn direction_slope(slip: f64, s: &Vector3<f64>, stuck: bool, speed: f64) -> Matrix3<f64> {
    if stuck { Matrix3::from_diagonal_element(1.0 / slip) } else { (Matrix3::identity() - s * s.transpose()) / speed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_the_law_are_those_of_its_values() {
        let law = Law { stiffness: 1e5, dissipation: 3.0, friction: 0.4 };
        let scheme = Scheme { h: 1e-3, share: 0.7, slip: 1e-3 };
        let e = 1e-6;
        for (depth, v) in [(1e-3, 0.1), (2e-4, -0.3), (-1e-4, -0.5), (1e-3, 0.4), (-1e-3, 0.1)] {
            let at = law.normal(&scheme, depth, v);
            let by_v = (law.normal(&scheme, depth, v + e).value - law.normal(&scheme, depth, v - e).value) / (2.0 * e);
            let by_depth = (law.normal(&scheme, depth + e, v).value - law.normal(&scheme, depth - e, v).value) / (2.0 * e);
            let more = |c| Law { dissipation: 3.0 + c, ..law }.normal(&scheme, depth, v).value;
            assert!((at.by_v - by_v).abs() < 1e-7 && at.by_v <= 0.0);
            assert!((at.by_depth - by_depth).abs() < 1e-6);
            assert!((at.by_dissipation - (more(e) - more(-e)) / (2.0 * e)).abs() < 1e-7);
        }
        for v in [Vector3::new(2e-4, -3e-4, 0.0), Vector3::new(0.2, -0.3, 0.1)] {
            let (s, stuck, speed) = direction(scheme.slip, &v);
            let slope = direction_slope(scheme.slip, &s, stuck, speed);
            for k in 0..3 {
                let d = Vector3::ith(k, 1e-7);
                let difference = (direction(scheme.slip, &(v + d)).0 - direction(scheme.slip, &(v - d)).0) / 2e-7;
                assert!((difference - slope.column(k)).norm() < 1e-5 * slope.norm());
            }
        }
    }
}
