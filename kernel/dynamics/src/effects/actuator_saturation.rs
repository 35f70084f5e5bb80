//! `u` clipped at `limit` both ways: what the drive can give.

use super::{Acts, Description, Instant, Law, Number, Parameter, SIZE, Transfer, around, unit};

#[derive(Debug)]
pub(super) struct ActuatorSaturation;

static DESCRIPTION: Description = Description {
    name: "actuator_saturation",
    summary: "the command is clipped: from -limit to limit",
    acts: Acts::Command(1),
    parameters: &[Parameter::new("limit", unit::EFFORT, SIZE, [around(20.0, 1.2), around(50.0, 1.2)]).bounding()],
    signature: "only at the extremes",
    confused_with: &["quadratic_drag"],
    experiment: "amplitude ladder",
    source: "current limit of a drive",
    linear: true,
    ..Description::BLANK
};

impl Law for ActuatorSaturation {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn command<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer<N>) {
        let x = at.variables::<N>(theta);
        out.output = x.input.clamp(-x.theta[0], x.theta[0]);
    }
}
