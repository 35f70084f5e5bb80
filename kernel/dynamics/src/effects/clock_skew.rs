//! What is measured at `t` is stamped `t + skew` against the command. The values are untouched, so nothing is approximated: compare
//! readings by their stamps. Without a joint it is the clock by which all joints of a part are read, as where one log brings together the
//! messages of two computers.

use super::{Acts, Description, Instant, Law, Parameter, Reading, near, unit};

#[derive(Debug)]
pub(super) struct ClockSkew;

static DESCRIPTION: Description = Description {
    name: "clock_skew",
    summary: "the measurement is stamped late by skew against the command",
    acts: Acts::Measurement(3),
    // 1 to 30 ms.
    parameters: &[Parameter::new("skew", unit::TIME, [-10.0, 10.0], [near(0.0, 0.01), near(0.0, 0.01)])],
    signature: "one channel leads the other",
    confused_with: &["transport_delay"],
    experiment: "the command and the measurement apart: in one log it is a delay",
    source: "two clocks",
    linear: true,
    shared: true,
    ..Description::BLANK
};

impl Law for ClockSkew {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn measure(&self, theta: &[f64], _: &Instant<'_>, out: &mut Reading) {
        // On top of the clock of all joints, where both are off.
        out.stamp.value += theta[0];
        out.stamp.d_theta[0] = 1.0;
    }
}
