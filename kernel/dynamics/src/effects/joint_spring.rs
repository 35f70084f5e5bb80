//! `dtau = stiffness (q - rest_position)`: a door closer or a counterbalance (EN 1154).

use super::{Description, Effect, Instant, Parameter, Prior, Resistance};

#[derive(Debug)]
pub(super) struct JointSpring;

static DESCRIPTION: Description = Description {
    name: "joint_spring",
    summary: "pulls toward a position: stiffness (q - rest_position)",
    parameters: &[
        Parameter {
            name: "stiffness",
            unit: ["N m/rad", "N/m"],
            bounds: [0.0, f64::INFINITY],
            prior: [Prior::LogNormal { median: 2.0, spread: 1.5 }, Prior::LogNormal { median: 50.0, spread: 1.5 }],
        },
        Parameter {
            name: "rest_position",
            unit: ["rad", "m"],
            bounds: [f64::NEG_INFINITY, f64::INFINITY],
            prior: [Prior::Normal { mean: 0.0, deviation: 1.5 }, Prior::Normal { mean: 0.0, deviation: 0.3 }],
        },
    ],
    source: "EN 1154: closers of size 3 give 18 N m or more",
};

impl Effect for JointSpring {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist(&self, theta: &[f64], at: &Instant<'_>, resistance: &mut Resistance) {
        let [stiffness, rest] = [theta[0], theta[1]];
        resistance.smooth.value = stiffness * (at.q - rest);
        resistance.smooth.d_q = stiffness;
        resistance.smooth.d_theta[0] = at.q - rest;
        resistance.smooth.d_theta[1] = -stiffness;
    }
}
