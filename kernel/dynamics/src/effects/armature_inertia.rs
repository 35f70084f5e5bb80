//! `dtau = inertia dv/dt`: the rotor that turns with the joint, through its gear. It adds to the mass matrix' diagonal.

use super::{Acts, Description, Law, Parameter, Partial, Reshape, SIZE, around, unit};

#[derive(Debug)]
pub(super) struct ArmatureInertia;

static DESCRIPTION: Description = Description {
    name: "armature_inertia",
    summary: "a rotor that turns with the joint: inertia dv/dt",
    acts: Acts::Bodies,
    // A Dynamixel MX-106: 0.026 kg m^2.
    parameters: &[Parameter::new("inertia", unit::INERTIA, SIZE, [around(0.026, 1.0), around(1.0, 1.0)]).cited()],
    signature: "in phase with the acceleration",
    confused_with: &["payload", "inertia of the link"],
    experiment: "other joints' poses: on one joint it is the link's inertia",
    source: "Duclusaud et al. 2025; Featherstone 2008, section 9.6",
    linear: true,
    ..Description::BLANK
};

impl Law for ArmatureInertia {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn reshape(&self, theta: &[f64], out: &mut Reshape) {
        out.armature = Partial::parameters(theta)[0];
    }
}
