//! `dtau = (friction + amplitude exp(-x^2 / 2))+ sgn(v)`, `x = (q - position) / width`: a place where it rubs. A bound of dry
//! friction, taken at the end of the step. Several bumps are several entries; give `friction` with one of them.

use super::{ABOVE_ZERO, ANY, Description, Instant, Law, Number, PLACE, Parameter, Resistance, SIZE, around, near, unit};

#[derive(Debug)]
pub(super) struct PositionDependentFriction;

static DESCRIPTION: Description = Description {
    name: "position_dependent_friction",
    summary: "dry friction that changes with position: (friction + amplitude exp(-x^2 / 2)) sgn(v); several bumps are several entries",
    parameters: &[
        Parameter::new("friction", unit::EFFORT, SIZE, [around(1.2, 0.9), around(4.5, 0.8)]),
        // 10 to 50 % of the friction, more or less of it.
        Parameter::new("amplitude", unit::EFFORT, ANY, [near(0.0, 0.5), near(0.0, 2.0)]),
        Parameter::new("position", unit::POSITION, ANY, PLACE),
        Parameter::new("width", unit::POSITION, ABOVE_ZERO, [around(0.2, 0.8), around(0.05, 0.8)]),
    ],
    signature: "changes with position and opposes motion both ways",
    confused_with: &["magnetic_gasket"],
    experiment: "half the sum and half the difference of a sweep forward and one back",
    source: "Bittencourt, Gunnarsson 2012",
    wears: true,
    ..Description::BLANK
};

impl Law for PositionDependentFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [friction, amplitude, position, width, ..] = x.theta;
        let place = (x.end - position) / width;
        out.dry_both((friction + amplitude * (place * place * -0.5).exp()).positive());
    }
}
