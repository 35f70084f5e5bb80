//! `u / (time_constant s + 1)`: a current loop. With the input held over the step the lag is solved exactly; what goes on is its mean
//! over the step. The inner state is the lagged effort.

use super::{ABOVE_ZERO, Acts, Advance, Description, Instant, Law, Number, Parameter, Transfer, around, unit};

#[derive(Debug)]
pub(super) struct ActuatorLag;

static DESCRIPTION: Description = Description {
    name: "actuator_lag",
    summary: "the command goes through a first-order lag: u / (time_constant s + 1)",
    acts: Acts::Command(2),
    // 1 to 20 ms.
    parameters: &[Parameter::new("time_constant", unit::TIME, ABOVE_ZERO, [around(0.0045, 0.9), around(0.0045, 0.9)])],
    signature: "phase that saturates, and a gain that falls",
    confused_with: &["transport_delay"],
    experiment: "a step: a lag begins at once",
    source: "first-order lag under zero-order hold; Franklin, Powell, Workman 1998",
    linear: true,
    ..Description::BLANK
};

impl Law for ActuatorLag {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        1
    }

    fn command<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer<N>) {
        let x = at.variables::<N>(theta);
        let mean = (N::constant(at.dt) / x.theta[0]).mean_decay();
        out.output = x.input + (x.z[0] - x.input) * mean;
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        let x = at.variables::<N>(theta);
        let decay = (N::constant(-at.dt) / x.theta[0]).exp();
        out.z[0] = x.input + (x.z[0] - x.input) * decay;
    }
}
