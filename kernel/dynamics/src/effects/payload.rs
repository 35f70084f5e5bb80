//! A point mass on the link that the joint moves, at `x, y, z` in the link's frame. Linear in the mass and its first and second moments,
//! which are those of a true body for any values within the bounds.

use super::{ANY, Acts, Description, Law, Parameter, Partial, Reshape, SIZE, around, near, unit};

#[derive(Debug)]
pub(super) struct Payload;

static DESCRIPTION: Description = Description {
    name: "payload",
    summary: "a point mass on the link that the joint moves, at x, y, z in its frame",
    acts: Acts::Bodies,
    parameters: &[
        Parameter::new("mass", ["kg", "kg"], SIZE, [around(0.5, 1.0), around(0.5, 1.0)]),
        Parameter::new("x", unit::LENGTH, ANY, [near(0.0, 0.1), near(0.0, 0.1)]),
        Parameter::new("y", unit::LENGTH, ANY, [near(0.0, 0.1), near(0.0, 0.1)]),
        Parameter::new("z", unit::LENGTH, ANY, [near(0.0, 0.1), near(0.0, 0.1)]),
    ],
    signature: "on several joints, and changes with the pose",
    confused_with: &["armature_inertia", "hinge_tilt"],
    experiment: "poses that turn gravity about the link",
    source: "Gautier, Khalil 1990",
    linear: true,
    ..Description::BLANK
};

impl Law for Payload {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn reshape(&self, theta: &[f64], out: &mut Reshape) {
        let [m, x, y, z, ..] = Partial::parameters(theta);
        out.inertia = [
            m,
            m * x,
            m * y,
            m * z,
            m * (y * y + z * z),
            -(m * x * y),
            -(m * x * z),
            m * (x * x + z * z),
            -(m * y * z),
            m * (x * x + y * y),
        ];
    }
}
