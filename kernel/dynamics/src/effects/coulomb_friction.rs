//! `dtau = friction sgn(v)`, and whatever holds the joint at rest up to `friction`: Coulomb's law.

use super::{Description, Instant, Law, Number, Parameter, Resistance, SIZE, Variable, around, unit};

#[derive(Debug)]
pub(super) struct CoulombFriction;

static DESCRIPTION: Description = Description {
    name: "coulomb_friction",
    summary: "resists with a constant force, and holds at rest: friction sgn(v)",
    // Hinges 0.5 to 3 N m; drawers 2 to 10 N.
    parameters: &[Parameter::new("friction", unit::EFFORT, SIZE, [around(1.2, 0.9), around(4.5, 0.8)])],
    signature: "a step where the motion turns round",
    confused_with: &["stribeck_friction", "torque_bias"],
    experiment: "both directions, and speeds down to the slowest",
    source: "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky 1998",
    linear: true,
    wears: true,
    ..Description::BLANK
};

impl Law for CoulombFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], _at: &Instant<'_>, out: &mut Resistance<N>) {
        out.dry_both(N::variable(theta[0], Variable::Theta(0)));
    }
}
