//! `dtau = side (stiffness d + dissipation d dd/dt)+` with the depth `d = side (q - position)`: a stop whose loss grows with
//! its depth, so that the force is continuous at touch (Hunt and Crossley 1975). It stands in place of the URDF's limit on its
//! side. A step takes the spring at its end and the loss at the depth of its start, so the push is linear in the next velocity.

use super::{ANY, Description, Instant, Law, Number, PLACE, Parameter, Prior, Resistance, SIZE, Stop, around, unit};

#[derive(Debug)]
pub(super) struct HardStop;

static DESCRIPTION: Description = Description {
    name: "hard_stop",
    summary: "pushes back beyond a position: (stiffness d + dissipation d dd/dt)+",
    parameters: &[
        // 1e3 to 1e5; restitution 0.1 to 0.6.
        Parameter::new("stiffness", unit::STIFFNESS, SIZE, [around(1e4, 1.4), around(1e5, 1.5)]),
        Parameter::new("dissipation", ["N m s/rad^2", "N s/m^2"], SIZE, [around(5e3, 1.5), around(5e4, 1.5)]),
        Parameter::new("position", unit::POSITION, ANY, PLACE),
        // Which motion it stops: a choice that is a number.
        Parameter { prior: [Prior::OneOf(&[-1.0, 1.0]); 2], ..Parameter::new("side", unit::ONE, [-1.0, 1.0], PLACE) },
    ],
    signature: "a bounce at the limits",
    confused_with: &["magnetic_gasket", "soft_close_damper"],
    experiment: "approach gently",
    source: "Hunt, Crossley 1975",
    linear: true,
    ..Description::BLANK
};

impl Law for HardStop {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [stiffness, dissipation, position, _, ..] = x.theta;
        let side = theta[3];
        let deep = ((x.q - position) * side).positive();
        let push = stiffness * (x.end - position) * side + dissipation * deep * x.next * side;
        // By the side nothing: it is a choice, not a number.
        out.stops[0] = Some(Stop::new(side, push, at.next, true));
    }
}
