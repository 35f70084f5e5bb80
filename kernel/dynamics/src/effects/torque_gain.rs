//! `(1 - gain_error) u`: a motor constant that is off.

use super::{Acts, Description, Instant, Law, Number, Parameter, Transfer, near, unit};

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

impl Law for TorqueGain {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn command<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer<N>) {
        let x = at.variables::<N>(theta);
        out.output = (N::constant(1.0) - x.theta[0]) * x.input;
    }
}
