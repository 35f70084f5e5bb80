//! The motor and the link, apart by up to `half_gap` each way: where the gap is open the motor turns its rotor alone, where it is
//! shut teeth push one another.
//!
//! Inner states: the gap `phi` (motor less link) and its rate `rho`, so the motor's velocity is `omega = v + rho`. The input drives
//! the motor, so `dtau = u - push`, and `J (omega' - omega) = h (u - push)` over a step `h` with the link's next velocity `w`.
//!
//! Teeth are rigid and do not rebound where `stiffness` is not given: two one-sided contacts on the next velocity, exact. The gap would
//! become `phi + h (omega + h u / J - w)`, and what goes beyond `half_gap` is what the link is pushed with. Teeth that give way push with
//! `(stiffness deep + damping d deep/dt)+`, the depth beyond the gap and its rate in the mean of the step's start and end, by the rule
//! of the middle, which takes no energy: they rebound with what their damping leaves (Nordin, Galic and Gutman 1997).

use super::{ABOVE_ZERO, Advance, Description, Instant, Law, Number, Parameter, Partial, Reading, Resistance, SIZE, Stop, Variables};
use super::{around, unit};

/// Stiffness of teeth that do not give way, N m/rad or N/m.
pub const RIGID_TEETH: f64 = 1e9;
/// Behind the link, and ahead of it.
const SIDES: [f64; 2] = [-1.0, 1.0];

#[derive(Debug)]
pub(super) struct Backlash;

static DESCRIPTION: Description = Description {
    name: "backlash",
    summary: "motor and link apart by up to half_gap; in between the motor moves its rotor alone",
    parameters: &[
        // 0.01 rad to 2 degrees.
        Parameter::new("half_gap", unit::POSITION, SIZE, [around(0.009, 0.6), around(5e-4, 0.8)]).cited(),
        Parameter::new("rotor_inertia", unit::INERTIA, ABOVE_ZERO, [around(0.02, 1.0), around(0.5, 1.0)]),
        Parameter::new("stiffness", unit::STIFFNESS, ABOVE_ZERO, [around(1e4, 1.4), around(1e5, 1.4)]).or_else(RIGID_TEETH),
        Parameter::new("damping", unit::DAMPING, SIZE, [around(10.0, 2.0), around(100.0, 2.0)]).or_else(0.0),
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
        let [behind, ahead] = SIDES.map(|side| push(&x, theta, side, at.dt));
        out.smooth = x.input;
        out.stops = [Some(Stop::new(-1.0, ahead, at.next, false)), Some(Stop::new(1.0, behind, at.next, false))];
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        let x = at.variables::<N>(theta);
        let [half_gap, inertia, ..] = x.theta;
        let [gap, rate] = x.z;
        let (h, alone) = (at.dt, x.v + rate + x.input * at.dt / inertia - x.next);
        if theta[2] >= RIGID_TEETH {
            let next = (gap + alone * h).clamp(-half_gap, half_gap);
            out.z = [next, (next - gap) * (1.0 / h)];
            return;
        }
        let pushes = SIDES.map(|side| (side, push(&x, theta, side, h)));
        let pushing = pushes.into_iter().find(|(_, push)| push.value() > 0.0);
        let end = pushing.map_or(alone, |(side, push)| alone - push * (side * h) / inertia);
        out.z = [gap + (rate + end) * (0.5 * h), end];
    }

    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        read_motor(theta[4], at, out);
    }
}

/// What the teeth on one side of the gap push the link with, ahead of it or behind, over a step; nothing where negative.
#[inline]
fn push<N: Number>(x: &Variables<N>, theta: &[f64], side: f64, h: f64) -> N {
    let [half_gap, inertia, stiffness, damping, ..] = x.theta;
    let [gap, rate] = x.z;
    let carried = x.input * side + inertia * (x.v + rate - x.next) * (side / h);
    let deep = gap * side - half_gap;
    if theta[2] >= RIGID_TEETH {
        return carried + inertia * deep * (1.0 / (h * h));
    }
    // The rate at the end, with teeth that push.
    let held = stiffness * (0.25 * h * h) + damping * (0.5 * h);
    let end = (carried * h - stiffness * deep * h - held * rate * side) / (inertia + held);
    let mean = (rate * side + end) * 0.5;
    stiffness * (deep + mean * (0.5 * h)) + damping * mean
}

/// The encoder on the motor reads the motor, whose position and velocity relative to the link are the inner states.
pub(super) fn read_motor(encoder: f64, at: &Instant<'_>, out: &mut Reading) {
    if encoder > 0.5 {
        let x = at.variables::<Partial>(&[]);
        (out.position, out.velocity) = (x.q + x.z[0], x.v + x.z[1]);
    }
}
