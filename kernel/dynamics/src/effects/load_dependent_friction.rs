//! `dtau = load_coefficient |u - tau_load| sgn(v)`: gear teeth and bearings rub in proportion to the force that passes through
//! them. A bound of dry friction.

use super::{Description, Instant, Law, Number, Parameter, Resistance, around, unit};

/// With one, nothing that pushes moves the joint: it locks itself.
const SELF_LOCKING: [f64; 2] = [0.0, 0.95];

#[derive(Debug)]
pub(super) struct LoadDependentFriction;

static DESCRIPTION: Description = Description {
    name: "load_dependent_friction",
    summary: "dry friction in proportion to the force through the joint: load_coefficient |u - tau_load| sgn(v)",
    // 5 to 20 %.
    parameters: &[Parameter::new("load_coefficient", unit::ONE, SELF_LOCKING, [around(0.1, 0.45), around(0.1, 0.45)])],
    signature: "friction follows the load",
    confused_with: &["stribeck_friction", "torque_gain"],
    experiment: "another payload",
    source: "Bittencourt, Gunnarsson 2012; Duclusaud et al. 2025",
    linear: true,
    wears: true,
    ..Description::BLANK
};

impl Law for LoadDependentFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        out.dry_both(x.theta[0] * (x.input - x.load).abs());
    }
}
