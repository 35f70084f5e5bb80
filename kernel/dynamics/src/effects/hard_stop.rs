//! `dtau = side (stiffness d + dissipation d+ dd/dt)+` with the depth `d = side (q - position)`: a stop whose loss grows with
//! its depth, so that the force is continuous at touch (Hunt and Crossley 1975).

use super::{Description, Effect, Instant, Parameter, Prior, Resistance, Stop};

#[derive(Debug)]
pub(super) struct HardStop;

static DESCRIPTION: Description = Description {
    name: "hard_stop",
    summary: "pushes back beyond a position: (stiffness d + dissipation d dd/dt)+",
    parameters: &[
        Parameter {
            name: "stiffness",
            unit: ["N m/rad", "N/m"],
            bounds: [0.0, f64::INFINITY],
            prior: [Prior::LogNormal { median: 1e4, spread: 1.5 }, Prior::LogNormal { median: 1e5, spread: 1.5 }],
        },
        Parameter {
            name: "dissipation",
            unit: ["N m s/rad^2", "N s/m^2"],
            bounds: [0.0, f64::INFINITY],
            prior: [Prior::LogNormal { median: 5e3, spread: 1.5 }, Prior::LogNormal { median: 5e4, spread: 1.5 }],
        },
        Parameter {
            name: "position",
            unit: ["rad", "m"],
            bounds: [f64::NEG_INFINITY, f64::INFINITY],
            prior: [Prior::Normal { mean: 0.0, deviation: 1.5 }, Prior::Normal { mean: 0.0, deviation: 0.3 }],
        },
        Parameter { name: "side", unit: ["1", "1"], bounds: [-1.0, 1.0], prior: [Prior::OneOf(&[-1.0, 1.0]); 2] },
    ],
    source: "Hunt, Crossley 1975",
};

impl Effect for HardStop {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist(&self, theta: &[f64], at: &Instant<'_>, resistance: &mut Resistance) {
        let [stiffness, dissipation, position, side] = [theta[0], theta[1], theta[2], theta[3]];
        let depth = side * (at.q - position);
        let inside = depth.max(0.0);
        let mut stop = Stop { side, depth, stiffness, damping: dissipation * inside, force: super::Partial::default() };
        let rate = side * at.v;
        let push = inside * (stiffness + dissipation * rate);
        if push > 0.0 {
            let slope = stiffness + dissipation * rate;
            stop.force.value = side * push;
            stop.force.d_q = slope;
            stop.force.d_v = dissipation * depth;
            stop.force.d_theta[0] = side * depth;
            stop.force.d_theta[1] = side * depth * rate;
            stop.force.d_theta[2] = -slope;
            // By the side nothing: it is a choice, not a number.
        }
        resistance.stop = Some(stop);
    }
}
