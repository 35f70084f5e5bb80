//! `dtau = damping v`: the drag of a lubricated bearing (Armstrong-Helouvry, Dupont and Canudas de Wit 1994).

use super::{Description, Effect, Instant, Parameter, Prior, Resistance};

#[derive(Debug)]
pub(super) struct ViscousFriction;

static DESCRIPTION: Description = Description {
    name: "viscous_friction",
    summary: "resists in proportion to speed: damping v",
    parameters: &[Parameter {
        name: "damping",
        unit: ["N m s/rad", "N s/m"],
        bounds: [0.0, f64::INFINITY],
        // Hinges 0.05 to 1 N m s/rad; slides 1 to 50 N s/m.
        prior: [Prior::LogNormal { median: 0.2, spread: 1.0 }, Prior::LogNormal { median: 7.0, spread: 1.0 }],
    }],
    source: "Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
};

impl Effect for ViscousFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist(&self, theta: &[f64], at: &Instant<'_>, resistance: &mut Resistance) {
        let damping = theta[0];
        resistance.smooth.value = damping * at.v;
        resistance.smooth.d_v = damping;
        resistance.smooth.d_theta[0] = at.v;
    }
}
