//! `dtau = stiffness (q - rest_position)`: a door closer or a counterbalance.

use super::{ANY, Description, Instant, Law, Number, PLACE, Parameter, Resistance, SIZE, around, unit};

#[derive(Debug)]
pub(super) struct JointSpring;

static DESCRIPTION: Description = Description {
    name: "joint_spring",
    summary: "pulls toward a position: stiffness (q - rest_position)",
    parameters: &[
        // A closer of size 3 gives 18 N m or more over a right angle.
        Parameter::new("stiffness", unit::STIFFNESS, SIZE, [around(6.0, 1.5), around(50.0, 1.5)]).cited(),
        Parameter::new("rest_position", unit::POSITION, ANY, PLACE),
    ],
    signature: "conservative, odd in the position",
    confused_with: &["hinge_tilt", "cable_hysteresis"],
    experiment: "the full range",
    source: "EN 1154: closers of size 3 give 18 N m or more",
    linear: true,
    ..Description::BLANK
};

impl Law for JointSpring {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let (stiffness, stretch) = (theta[0], at.end() - theta[1]);
        out.smooth = at.force(stiffness * stretch, [stiffness, 0.0], [stretch, -stiffness]);
    }
}
