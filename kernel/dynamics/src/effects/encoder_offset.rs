//! `measured = (1 + scale_error) q + offset`.

use super::{ANY, Acts, Description, Instant, Law, Parameter, Partial, Reading, near, unit};

#[derive(Debug)]
pub(super) struct EncoderOffset;

static DESCRIPTION: Description = Description {
    name: "encoder_offset",
    summary: "the encoder's zero and scale are off: measured = (1 + scale_error) q + offset",
    acts: Acts::Measurement(1),
    parameters: &[
        // 0.1 to 2 degrees. A scale that is off by more than a tenth is another unit, and no error.
        Parameter::new("offset", unit::POSITION, ANY, [near(0.0, 0.015), near(0.0, 0.003)]),
        Parameter::new("scale_error", unit::ONE, [-0.1, 0.1], [near(0.0, 0.01), near(0.0, 0.01)]),
    ],
    signature: "moves every feature that has a place in q",
    confused_with: &["hinge_tilt", "joint_axis_error"],
    experiment: "a reference outside",
    source: "geometric calibration",
    linear: true,
    ..Description::BLANK
};

impl Law for EncoderOffset {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        let x = at.variables::<Partial>(theta);
        let scale = x.theta[1] + 1.0;
        (out.position, out.velocity) = (scale * x.q + x.theta[0], scale * x.v);
    }
}
