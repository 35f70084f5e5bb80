//! The motor and the link, apart by up to `half_gap` each way: where the gap is open the motor turns its rotor alone, where it is
//! shut they move as one. Contact is rigid and without rebound, and exact: two one-sided contacts on the next velocity.
//!
//! Inner states: the gap `phi` (motor less link) and its rate. With the motor's velocity `omega = v + z1` and the step `h` the gap
//! would become `phi + h (omega + h u / J - w)`; what goes beyond `half_gap` is what the link is pushed with. The input drives the
//! motor, so `dtau = u - push`.

use super::{ABOVE_ZERO, Advance, Description, Instant, Law, Number, Parameter, Partial, Reading, Resistance, SIZE, Stop};
use super::{around, unit};

#[derive(Debug)]
pub(super) struct Backlash;

static DESCRIPTION: Description = Description {
    name: "backlash",
    summary: "motor and link apart by up to half_gap; in between the motor moves its rotor alone",
    parameters: &[
        // 0.01 rad to 2 degrees.
        Parameter::new("half_gap", unit::POSITION, SIZE, [around(0.009, 0.6), around(5e-4, 0.8)]).cited(),
        Parameter::new("rotor_inertia", unit::INERTIA, ABOVE_ZERO, [around(0.02, 1.0), around(0.5, 1.0)]),
        Parameter::choice("encoder", &["link", "motor"]),
    ],
    signature: "motion is lost where the load changes sign",
    confused_with: &["presliding_hysteresis", "joint_elasticity", "transport_delay"],
    experiment: "amplitude ladder, and a preload",
    source: "Nordin, Gutman 2002",
    linear: true,
    ..Description::BLANK
};

impl Law for Backlash {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        2
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        // At an instant the force is an impulse or nothing: the command is taken to pass.
        if at.dt == 0.0 {
            return;
        }
        let x = at.variables::<N>(theta);
        let [half_gap, inertia, ..] = x.theta;
        let [gap, rate] = x.z;
        let h = at.dt;
        let carried = x.input + inertia * (x.v + rate - x.next) * (1.0 / h);
        let ahead = carried - inertia * (half_gap - gap) * (1.0 / (h * h));
        let behind = -(carried + inertia * (half_gap + gap) * (1.0 / (h * h)));
        out.smooth = x.input;
        out.stops = [Some(Stop::new(-1.0, ahead, at.next, false)), Some(Stop::new(1.0, behind, at.next, false))];
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        let x = at.variables::<N>(theta);
        let [half_gap, inertia, ..] = x.theta;
        let [gap, rate] = x.z;
        let alone = gap + (x.v + rate + x.input * at.dt / inertia - x.next) * at.dt;
        let next = alone.clamp(-half_gap, half_gap);
        out.z = [next, (next - gap) * (1.0 / at.dt)];
    }

    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        read_motor(theta[2], at, out);
    }
}

/// The encoder on the motor reads the motor, whose position and velocity relative to the link are the inner states.
pub(super) fn read_motor(encoder: f64, at: &Instant<'_>, out: &mut Reading) {
    if encoder > 0.5 {
        let x = at.variables::<Partial>(&[]);
        (out.position, out.velocity) = (x.q + x.z[0], x.v + x.z[1]);
    }
}
