//! `dtau = damping v`: the drag of a lubricated bearing.

use super::{Description, Instant, Law, Number, Parameter, Resistance, SIZE, around, unit};

#[derive(Debug)]
pub(super) struct ViscousFriction;

static DESCRIPTION: Description = Description {
    name: "viscous_friction",
    summary: "resists in proportion to speed: damping v",
    // Hinges 0.05 to 1 N m s/rad; slides 1 to 50 N s/m.
    parameters: &[Parameter::new("damping", unit::DAMPING, SIZE, [around(0.2, 1.0), around(7.0, 1.0)])],
    signature: "linear in velocity, through zero",
    confused_with: &["quadratic_drag"],
    experiment: "speeds over two decades",
    source: "Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
    linear: true,
    wears: true,
    ..Description::BLANK
};

impl Law for ViscousFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        out.smooth = at.force(theta[0] * at.next, [0.0, theta[0]], [at.next]);
    }
}
