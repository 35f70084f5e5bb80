//! `J domega/dt + stiffness phi + damping dphi/dt = u`: motor and link joined by a spring, whose force moves the link. The input
//! drives the motor, so `dtau = u - (stiffness phi + damping dphi/dt)`.
//!
//! Inner states: the twist `phi` (motor less link) and its rate. A step takes the spring by the implicit midpoint rule, condensed onto
//! the link's next velocity: no numerical damping, so the resonance has its own width, and no growth at any stiffness and step
//! (Hairer, Lubich and Wanner 2006, chapter VI). A mode above the step's Nyquist frequency rings there until `damping` ends it.

use super::backlash::read_motor;
use super::{ABOVE_ZERO, Advance, Description, Instant, Law, Number, Parameter, Reading, Resistance, SIZE, Variables};
use super::{around, unit};

#[derive(Debug)]
pub(super) struct JointElasticity;

static DESCRIPTION: Description = Description {
    name: "joint_elasticity",
    summary: "motor and link joined by a spring: rotor_inertia domega/dt + stiffness phi + damping dphi/dt = u",
    parameters: &[
        // 1e3 to 1e5 N m/rad.
        Parameter::new("stiffness", unit::STIFFNESS, SIZE, [around(1e4, 1.4), around(1e5, 1.4)]),
        Parameter::new("damping", unit::DAMPING, SIZE, [around(1.0, 1.5), around(30.0, 1.5)]),
        Parameter::new("rotor_inertia", unit::INERTIA, ABOVE_ZERO, [around(0.1, 1.0), around(1.0, 1.0)]),
        Parameter::choice("encoder", &["link", "motor"]),
    ],
    signature: "resonance and anti-resonance",
    confused_with: &["transport_delay", "viscous_friction", "unmodelled_mode", "backlash"],
    experiment: "a chirp past the first mode",
    source: "Spong 1987",
    linear: true,
    ..Description::BLANK
};

/// Rate of the twist at the end of the step.
fn end_rate<N: Number>(x: &Variables<N>, h: f64) -> N {
    let [stiffness, damping, inertia, ..] = x.theta;
    let [twist, rate] = x.z;
    let held = stiffness * (0.25 * h * h) + damping * (0.5 * h);
    (inertia * (x.v + rate - x.next) + (x.input - stiffness * twist) * h - held * rate) / (inertia + held)
}

impl Law for JointElasticity {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        2
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let mean_rate = (x.z[1] + end_rate(&x, at.dt)) * 0.5;
        let mean_twist = x.z[0] + mean_rate * (0.5 * at.dt);
        out.smooth = x.input - x.theta[0] * mean_twist - x.theta[1] * mean_rate;
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        let x = at.variables::<N>(theta);
        let rate = end_rate(&x, at.dt);
        out.z = [x.z[0] + (x.z[1] + rate) * (0.5 * at.dt), rate];
    }

    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        read_motor(theta[3], at, out);
    }
}
