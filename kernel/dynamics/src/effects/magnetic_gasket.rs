//! `dtau = force exp(-q / width)`, or `force / (1 + q / width)^2`, with `q` from shut: the magnet in a refrigerator's seal. Pressed
//! in (`q < 0`) it pulls with `force`.

use super::{ABOVE_ZERO, Description, Instant, Law, Number, Parameter, Resistance, SIZE, around, unit};

#[derive(Debug)]
pub(super) struct MagneticGasket;

static DESCRIPTION: Description = Description {
    name: "magnetic_gasket",
    summary: "pulls shut near zero: force exp(-q / width), or force / (1 + q / width)^2",
    parameters: &[
        // At most 66.7 N at the door's edge, some 0.6 m from the hinge.
        Parameter::new("force", unit::EFFORT, SIZE, [around(12.0, 0.8), around(20.0, 0.8)]).cited(),
        // 3 to 20 mm.
        Parameter::new("width", unit::POSITION, ABOVE_ZERO, [around(0.013, 0.6), around(0.008, 0.6)]),
        Parameter::choice("shape", &["exponential", "inverse_square"]),
    ],
    signature: "pulls shut near zero only, in both directions",
    confused_with: &["air_suction", "latch", "position_dependent_friction"],
    experiment: "open and close slowly",
    source: "16 CFR 1750: a door opens at 66.7 N or less",
    ..Description::BLANK
};

impl Law for MagneticGasket {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [force, width, ..] = x.theta;
        let gap = x.end.positive() / width;
        out.smooth = force
            * if theta[2] > 0.5 {
                let near = N::constant(1.0) / (gap + 1.0);
                near * near
            } else {
                (-gap).exp()
            };
    }
}
