//! `dtau = (friction + (static_friction - friction) exp(-|v / stribeck_velocity|^exponent)) sgn(v)`: friction that falls as
//! the lubricant's film builds up. All of it is a bound of dry friction, taken at the next velocity: at rest it is
//! `static_friction`, so a joint that is driven slowly through a spring sticks and slips.

use super::{Description, Instant, Law, Number, Parameter, Resistance, SIZE, around, near, unit};

#[derive(Debug)]
pub(super) struct StribeckFriction;

static DESCRIPTION: Description = Description {
    name: "stribeck_friction",
    summary: "dry friction that falls with speed: (friction + (static_friction - friction) exp(-|v / stribeck_velocity|^exponent)) sgn(v)",
    parameters: &[
        Parameter::new("friction", unit::EFFORT, SIZE, [around(1.2, 0.9), around(4.5, 0.8)]),
        // 1.1 to 2 times the friction.
        Parameter::new("static_friction", unit::EFFORT, SIZE, [around(1.8, 0.9), around(6.7, 0.8)]).times("friction", 1.5, 0.25),
        Parameter::new("stribeck_velocity", unit::VELOCITY, [1e-5, 1e3], [around(0.045, 0.9), around(0.01, 0.9)]),
        Parameter::new("exponent", unit::ONE, [0.5, 4.0], [near(2.0, 0.5), near(2.0, 0.5)]),
    ],
    signature: "a hump at low speed, stick-slip",
    confused_with: &["coulomb_friction", "presliding_hysteresis"],
    experiment: "slow ramps",
    source: "Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
    wears: true,
    ..Description::BLANK
};

impl Law for StribeckFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [friction, static_friction, velocity, exponent, ..] = x.theta;
        let bell = (x.next / velocity).bell(exponent);
        out.dry_both(friction + (static_friction - friction) * bell);
    }
}
