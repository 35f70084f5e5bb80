//! The LuGre model: bristles of deflection `z` that bend before they slide,
//! `dz/dt = v - stiffness |v| z / g(v)`, `dtau = stiffness z + micro_damping dz/dt`,
//! `g(v) = friction + (static_friction - friction) exp(-(v / stribeck_velocity)^2)`
//! (Canudas de Wit, Olsson, Astrom and Lischinsky 1995). With `static_friction = friction` and no `micro_damping` it is Dahl's.
//!
//! Over a step at the velocity `w` the bristles' equation is linear, so its solution is exact: with `x = stiffness |w| h / g(w)`
//! and `m = (1 - exp(-x)) / x` the mean of `dz/dt` is `m (w - stiffness |w| z / g(w))`. The force is taken at the end of the
//! step, so it is stable at any stiffness; `|z|` never passes `g / stiffness`.

use super::{Advance, Description, Instant, Law, Number, Parameter, Resistance, SIZE, Variables, around, unit};

#[derive(Debug)]
pub(super) struct PreslidingHysteresis;

static DESCRIPTION: Description = Description {
    name: "presliding_hysteresis",
    summary: "bristles that bend before they slide (LuGre): stiffness z + micro_damping dz/dt, dz/dt = v - stiffness |v| z / g(v)",
    parameters: &[
        // Break-away after 0.1 to 2 mrad.
        Parameter::new("stiffness", unit::STIFFNESS, SIZE, [around(2.7e3, 1.3), around(4.5e4, 1.3)]),
        Parameter::new("micro_damping", unit::DAMPING, SIZE, [around(1.0, 1.5), around(30.0, 1.5)]),
        Parameter::new("friction", unit::EFFORT, [1e-6, 1e9], [around(1.2, 0.9), around(4.5, 0.8)]),
        // From Dahl's 1 to 2 times the friction.
        Parameter::new("static_friction", unit::EFFORT, [1e-6, 1e9], [around(1.8, 0.9), around(6.7, 0.8)]).times("friction", 1.3, 0.25),
        Parameter::new("stribeck_velocity", unit::VELOCITY, [1e-5, 1e3], [around(0.045, 0.9), around(0.01, 0.9)]),
    ],
    signature: "a loop over position and effort that does not depend on the rate",
    confused_with: &["backlash", "joint_spring", "stribeck_friction"],
    experiment: "amplitude ladder from milliradians",
    source: "Dahl 1968; Canudas de Wit, Olsson, Astrom, Lischinsky 1995",
    wears: true,
    ..Description::BLANK
};

/// Mean rate of the bristles over the step, and their deflection at its end.
fn bristles<N: Number>(x: &Variables<N>, dt: f64) -> (N, N) {
    let [stiffness, _, friction, static_friction, velocity, ..] = x.theta;
    let z = x.z[0];
    let speed = x.next / velocity;
    let g = friction + (static_friction - friction) * (-(speed * speed)).exp();
    let wipe = stiffness * x.next.abs() / g;
    let mean = (x.next - wipe * z) * (wipe * dt).mean_decay();
    (mean, z + mean * dt)
}

impl Law for PreslidingHysteresis {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        1
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let (rate, z) = bristles(&x, at.dt);
        out.smooth = x.theta[0] * z + x.theta[1] * rate;
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        out.z[0] = bristles(&at.variables(theta), at.dt).1;
    }
}
