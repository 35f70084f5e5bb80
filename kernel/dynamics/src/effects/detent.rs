//! `dtau = force x exp(1/2 - x^2 / 2)`, `x = (q - position) / width`: a ball that snaps into a groove. A well of potential with
//! its greatest force at `x = 1`.

use super::{ABOVE_ZERO, ANY, Description, Instant, Law, Number, PLACE, Parameter, Resistance, around, near, unit};

#[derive(Debug)]
pub(super) struct Detent;

static DESCRIPTION: Description = Description {
    name: "detent",
    summary: "pulls into a position from nearby: force x exp(1/2 - x^2 / 2), x = (q - position) / width",
    parameters: &[
        // 2 to 15 N over 5 to 20 mm. Below zero it is a hump.
        Parameter::new("force", unit::EFFORT, ANY, [near(2.0, 2.0), near(6.0, 5.0)]),
        Parameter::new("position", unit::POSITION, ANY, PLACE),
        Parameter::new("width", unit::POSITION, ABOVE_ZERO, [around(0.03, 0.6), around(0.01, 0.6)]),
    ],
    signature: "a pull from both sides, conservative and local",
    confused_with: &["torque_ripple", "latch"],
    experiment: "slow sweep both ways: it stands at one place only",
    source: "ball catch",
    ..Description::BLANK
};

impl Law for Detent {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [force, position, width, ..] = x.theta;
        let place = (x.end - position) / width;
        let well = (place * place * -0.5 + 0.5).exp();
        // Far away the force is zero, however far that is.
        if well.value() > 0.0 {
            out.smooth = force * place * well;
        }
    }
}
