//! The joint's axis turned by `angle` about the direction `rx, ry, rz`, and its origin moved by `x, y, z`, both in the joint's frame. The
//! direction's length does not count; what lies along the axis turns nothing. The link's own frame keeps its place on the joint.

use super::{ANY, Acts, Description, Law, Number, Parameter, Partial, Reshape, near, unit};

#[derive(Debug)]
pub(super) struct JointAxisError;

static DESCRIPTION: Description = Description {
    name: "joint_axis_error",
    summary: "the axis turned by angle about rx, ry, rz, the origin moved by x, y, z",
    acts: Acts::Bodies,
    parameters: &[
        // 0.5 to 5 degrees, 2 to 20 mm.
        Parameter::new("angle", unit::ANGLE, [-3.2, 3.2], [near(0.0, 0.03), near(0.0, 0.03)]),
        Parameter::new("rx", unit::ONE, [-1.0, 1.0], [near(0.0, 0.6), near(0.0, 0.6)]),
        Parameter::new("ry", unit::ONE, [-1.0, 1.0], [near(0.0, 0.6), near(0.0, 0.6)]),
        Parameter::new("rz", unit::ONE, [-1.0, 1.0], [near(0.0, 0.6), near(0.0, 0.6)]),
        Parameter::new("x", unit::LENGTH, ANY, [near(0.0, 0.008), near(0.0, 0.008)]),
        Parameter::new("y", unit::LENGTH, ANY, [near(0.0, 0.008), near(0.0, 0.008)]),
        Parameter::new("z", unit::LENGTH, ANY, [near(0.0, 0.008), near(0.0, 0.008)]),
    ],
    signature: "a pattern over the pose, at rest too",
    confused_with: &["encoder_offset", "hinge_tilt"],
    experiment: "quasi-static sweep",
    source: "Gautier, Khalil 1990",
    linear: true,
    ..Description::BLANK
};

impl Law for JointAxisError {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn reshape(&self, theta: &[f64], out: &mut Reshape) {
        let [angle, rx, ry, rz, x, y, z, _] = Partial::parameters(theta);
        let square = rx * rx + ry * ry + rz * rz;
        // No direction turns nothing.
        if square.value > 1e-24 {
            let length = square.value.sqrt();
            let turn = angle / square.chain(length, 0.5 / length);
            out.turn = [turn * rx, turn * ry, turn * rz];
        }
        out.shift = [x, y, z];
    }
}
