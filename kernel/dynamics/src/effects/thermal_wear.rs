//! The joint's friction and damping times `1 + amplitude exp(-t / time_constant)`: grease that warms up over the run. It scales
//! the effects whose description says that they wear. `t` is that at the end of the step, and never taken below zero.

use super::{ABOVE_ZERO, Acts, Description, Law, Number, Parameter, Partial, around, near, unit};

#[derive(Debug)]
pub(super) struct ThermalWear;

static DESCRIPTION: Description = Description {
    name: "thermal_wear",
    summary: "friction and damping of the joint change over the run: times 1 + amplitude exp(-t / time_constant)",
    acts: Acts::Losses,
    parameters: &[
        // 20 to 50 % more from cold.
        Parameter::new("amplitude", unit::ONE, [-1.0, 100.0], [near(0.35, 0.15), near(0.35, 0.15)]),
        Parameter::new("time_constant", unit::TIME, ABOVE_ZERO, [around(60.0, 1.5), around(60.0, 1.5)]),
    ],
    signature: "a trend within the run",
    confused_with: &["sensor_drift"],
    experiment: "repeat at the end",
    source: "Bittencourt, Gunnarsson 2012",
    linear: true,
    ..Description::BLANK
};

impl Law for ThermalWear {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn wear(&self, theta: &[f64], time: f64) -> Partial {
        let [amplitude, time_constant, ..] = Partial::parameters(theta);
        amplitude * (Partial::constant(-time.max(0.0)) / time_constant).exp() + 1.0
    }
}
