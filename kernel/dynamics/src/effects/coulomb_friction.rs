//! `dtau = friction sgn(v)`, and whatever holds the joint at rest up to `friction` (Coulomb's law; Olsson et al. 1998).

use super::{Description, Effect, Instant, Parameter, Prior, Resistance};

#[derive(Debug)]
pub(super) struct CoulombFriction;

static DESCRIPTION: Description = Description {
    name: "coulomb_friction",
    summary: "resists with a constant force, and holds at rest: friction sgn(v)",
    parameters: &[Parameter {
        name: "friction",
        unit: ["N m", "N"],
        bounds: [0.0, f64::INFINITY],
        // Hinges 0.5 to 3 N m; drawers 2 to 10 N.
        prior: [Prior::LogNormal { median: 1.2, spread: 0.9 }, Prior::LogNormal { median: 4.5, spread: 0.8 }],
    }],
    source: "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky 1998",
};

impl Effect for CoulombFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist(&self, theta: &[f64], _at: &Instant<'_>, resistance: &mut Resistance) {
        resistance.dry.value = theta[0];
        resistance.dry.d_theta[0] = 1.0;
    }
}
