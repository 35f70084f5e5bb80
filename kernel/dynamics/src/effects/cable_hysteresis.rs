//! `dtau = stiffness (q - rest_position) + loop_force z + damping v`, `dz/dq = (sgn(v) - z) / loop_length`: a cable that is bent and
//! rubs in itself. Over a step at one velocity `z` relaxes exactly, so the loop does not depend on the rate.

use super::{ABOVE_ZERO, ANY, Advance, Description, Instant, Law, Number, PLACE, Parameter, Resistance, SIZE, Variables};
use super::{around, sign, unit};

#[derive(Debug)]
pub(super) struct CableHysteresis;

static DESCRIPTION: Description = Description {
    name: "cable_hysteresis",
    summary: "a bent cable: stiffness (q - rest_position) + loop_force z + damping v, dz/dq = (sgn(v) - z) / loop_length",
    parameters: &[
        Parameter::new("stiffness", unit::STIFFNESS, SIZE, [around(0.5, 1.2), around(10.0, 1.2)]),
        Parameter::new("rest_position", unit::POSITION, ANY, PLACE),
        // 0.1 to 2 N m.
        Parameter::new("loop_force", unit::EFFORT, SIZE, [around(0.45, 0.9), around(1.5, 0.9)]),
        Parameter::new("loop_length", unit::POSITION, ABOVE_ZERO, [around(0.1, 0.9), around(0.03, 0.9)]),
        Parameter::new("damping", unit::DAMPING, SIZE, [around(0.1, 1.0), around(3.0, 1.0)]),
    ],
    signature: "a conservative part, and a loop that drifts",
    confused_with: &["joint_spring", "presliding_hysteresis"],
    experiment: "the same again on another day",
    source: "Dahl 1968",
    ..Description::BLANK
};

/// The loop's state at the end of the step.
fn end_of_loop<N: Number>(x: &Variables<N>, dt: f64) -> N {
    let way = x.next.abs() * dt / x.theta[3];
    let side = sign(x.next.value());
    (x.z[0] + -side) * (-way).exp() + side
}

impl Law for CableHysteresis {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        1
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [stiffness, rest, force, _, damping, ..] = x.theta;
        out.smooth = stiffness * (x.end - rest) + force * end_of_loop(&x, at.dt) + damping * x.next;
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        out.z[0] = end_of_loop(&at.variables(theta), at.dt);
    }
}
