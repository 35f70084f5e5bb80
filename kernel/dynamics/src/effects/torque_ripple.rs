//! `dtau = amplitude sin(cycles_per_turn q + phase)`: cogging of a motor or a gear. Several orders are several entries.

use super::{ANY, Description, Instant, Law, Number, Parameter, Resistance, around, near, unit};

#[derive(Debug)]
pub(super) struct TorqueRipple;

static DESCRIPTION: Description = Description {
    name: "torque_ripple",
    summary: "cogging: amplitude sin(cycles_per_turn q + phase); several orders are several entries",
    parameters: &[
        // 0.5 to 5 % of the drive's effort.
        Parameter::new("amplitude", unit::EFFORT, ANY, [near(0.0, 0.5), near(0.0, 2.0)]),
        Parameter::new("cycles_per_turn", ["1", "rad/m"], [0.0, 1e6], [around(20.0, 1.0), around(300.0, 1.0)]),
        Parameter::new("phase", unit::ANGLE, ANY, [near(0.0, 1.8), near(0.0, 1.8)]),
    ],
    signature: "periodic in position, at every speed",
    confused_with: &["detent", "noise that is periodic in time"],
    experiment: "two constant speeds",
    source: "Swevers, Ganseman, Tukel, De Schutter, Van Brussel 1997",
    ..Description::BLANK
};

impl Law for TorqueRipple {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let [amplitude, cycles, phase] = [theta[0], theta[1], theta[2]];
        let (sin, cos) = (cycles * at.end() + phase).sin_cos();
        let by_theta = [sin, amplitude * at.end() * cos, amplitude * cos];
        out.smooth = at.force(amplitude * sin, [amplitude * cycles * cos, 0.0], by_theta);
    }
}
