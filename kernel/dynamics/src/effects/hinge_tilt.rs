//! `dtau = amplitude sin(q + phase)`, `amplitude = m g r sin(tilt)`: gravity on a hinge whose axis is not upright.

use super::{ANY, Description, Instant, Law, Number, Parameter, Resistance, near, unit};

#[derive(Debug)]
pub(super) struct HingeTilt;

static DESCRIPTION: Description = Description {
    name: "hinge_tilt",
    summary: "gravity on a tilted hinge: amplitude sin(q + phase), with m g r sin(tilt) as the amplitude",
    parameters: &[
        // 1 degree on 20 kg at 0.4 m: 1.4 N m.
        Parameter::new("amplitude", unit::EFFORT, ANY, [near(0.0, 1.4), near(0.0, 3.5)]),
        Parameter::new("phase", unit::ANGLE, ANY, [near(0.0, 1.8), near(0.0, 1.8)]),
    ],
    signature: "one cycle a turn",
    confused_with: &["joint_spring", "torque_bias", "encoder_offset", "joint_axis_error"],
    experiment: "more than 120 degrees, or another tilt",
    source: "gravity on an axis that is not upright; Jain, Kemp 2013",
    ..Description::BLANK
};

impl Law for HingeTilt {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let (sin, cos) = (at.end() + theta[1]).sin_cos();
        out.smooth = at.force(theta[0] * sin, [theta[0] * cos, 0.0], [sin, theta[0] * cos]);
    }
}
