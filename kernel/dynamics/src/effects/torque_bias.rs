//! `dtau = bias`: a torque sensor's or a drive's zero that is off.

use super::{ANY, Description, Instant, Law, Number, Parameter, Resistance, Variable, near, unit};

#[derive(Debug)]
pub(super) struct TorqueBias;

static DESCRIPTION: Description = Description {
    name: "torque_bias",
    summary: "a constant: bias",
    // 1 to 5 % of the drive's effort.
    parameters: &[Parameter::new("bias", unit::EFFORT, ANY, [near(0.0, 1.0), near(0.0, 5.0)])],
    signature: "constant",
    confused_with: &["gravity", "coulomb_friction", "hinge_tilt"],
    experiment: "both directions, over the full range",
    source: "Swevers, Ganseman, Tukel, De Schutter, Van Brussel 1997",
    linear: true,
    ..Description::BLANK
};

impl Law for TorqueBias {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], _at: &Instant<'_>, out: &mut Resistance<N>) {
        out.smooth = N::variable(theta[0], Variable::Theta(0));
    }
}
