//! `bias + rate t` on the measured position or effort.

use super::{ANY, Acts, Description, Instant, Law, Parameter, Partial, Reading, near};

#[derive(Debug)]
pub(super) struct SensorDrift;

static DESCRIPTION: Description = Description {
    name: "sensor_drift",
    summary: "a measured position or effort drifts: bias + rate t",
    acts: Acts::Measurement(2),
    parameters: &[
        Parameter::new("bias", ["rad", "m"], ANY, [near(0.0, 0.02), near(0.0, 0.02)])
            // As a bias of torque, and as much in a minute.
            .or(["N m", "N"], [near(0.0, 1.0), near(0.0, 5.0)]),
        Parameter::new("rate", ["rad/s", "m/s"], ANY, [near(0.0, 1e-3), near(0.0, 1e-3)])
            .or(["N m/s", "N/s"], [near(0.0, 0.02), near(0.0, 0.1)]),
        Parameter::choice("of", &["position", "effort"]),
    ],
    signature: "goes with time, and not with the state",
    confused_with: &["thermal_wear", "torque_bias", "encoder_offset"],
    experiment: "return to the start",
    source: "zero drift of strain gauges and potentiometers",
    linear: true,
    passive: false,
    ..Description::BLANK
};

impl Law for SensorDrift {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        let x = at.variables::<Partial>(theta);
        let drift = x.theta[0] + x.theta[1] * at.time;
        if theta[2] > 0.5 {
            out.effort = x.input + drift;
        } else {
            (out.position, out.velocity) = (x.q + drift, x.v + x.theta[1]);
        }
    }
}
