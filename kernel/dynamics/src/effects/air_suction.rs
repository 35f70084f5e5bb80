//! `dtau = -stiffness p`, `dp/dt = -p / time_constant - v` while sealed: air that a door draws in or presses out, and that leaks
//! through the seal. `p` is a length: by how much the air in the cavity is compressed. Opened past `seal_position`, it is free.
//!
//! Over a step at one velocity `p` is exact. Where the step crosses the seal, the force acts on the share of the step's way that
//! lies below it, so its derivative by `seal_position` is that of the impulse.

use super::{ABOVE_ZERO, ANY, Advance, Description, Instant, Law, Number, Parameter, Resistance, SIZE, Variables};
use super::{around, unit};

#[derive(Debug)]
pub(super) struct AirSuction;

static DESCRIPTION: Description = Description {
    name: "air_suction",
    summary: "air behind a seal: -stiffness p, dp/dt = -p / time_constant - v below seal_position (0: everywhere)",
    parameters: &[
        // 5 to 50 N over some millimetres.
        Parameter::new("stiffness", unit::STIFFNESS, SIZE, [around(500.0, 1.2), around(3e3, 1.2)]),
        Parameter::new("time_constant", unit::TIME, ABOVE_ZERO, [around(5.0, 1.2), around(5.0, 1.2)]),
        Parameter::new("seal_position", unit::POSITION, ANY, [around(0.02, 0.8), around(0.01, 0.8)]),
    ],
    signature: "depends on how long ago it was closed: it decays in seconds to minutes",
    confused_with: &["magnetic_gasket"],
    experiment: "dwell 1, 10 and 60 s, then open",
    source: "first-order leak through a seal",
    ..Description::BLANK
};

/// The share of the step that is sealed, and the compression at the end of that share.
fn compression<N: Number>(x: &Variables<N>, theta: &[f64], dt: f64) -> (N, N) {
    let [_, time_constant, seal, ..] = x.theta;
    let share = if theta[2] == 0.0 { N::constant(1.0) } else { x.share_below(seal) };
    let decays = share * dt / time_constant;
    // exp(-x) = 1 - x mean_decay(x), and the integral of the decay is its time times its mean.
    let mean = decays.mean_decay();
    (share, x.z[0] * (-decays).exp() - x.next * share * dt * mean)
}

impl Law for AirSuction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        1
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let (share, p) = compression(&x, theta, at.dt);
        out.smooth = -(x.theta[0] * share * p);
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        if theta[2] == 0.0 || at.end() < theta[2] {
            out.z[0] = compression(&at.variables(theta), theta, at.dt).1;
        }
    }
}
