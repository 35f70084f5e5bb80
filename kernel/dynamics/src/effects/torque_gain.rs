//! `(1 - gain_error) u`: a motor constant that is off.

use super::{Acts, Description, Effect, Instant, Parameter, Partial, Transfer, near, unit};

#[derive(Debug)]
pub(super) struct TorqueGain;

static DESCRIPTION: Description = Description {
    name: "torque_gain",
    summary: "less of the command arrives: (1 - gain_error) u",
    acts: Acts::Command(3),
    // 5 to 20 %.
    parameters: &[Parameter::new("gain_error", unit::ONE, [-10.0, 10.0], [near(0.0, 0.12), near(0.0, 0.12)])],
    signature: "scales with the command",
    confused_with: &["a scale on everything else", "load_dependent_friction"],
    experiment: "a load that is known",
    source: "Gautier, Khalil 1990; Swevers, Ganseman, Tukel, De Schutter, Van Brussel 1997",
    linear: true,
    passive: false,
    ..Description::BLANK
};

impl Effect for TorqueGain {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn command(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer) {
        let gain = 1.0 - theta[0];
        out.output = Partial { value: gain * at.input, d_input: gain, ..Partial::default() };
        out.output.d_theta[0] = -at.input;
    }
}
