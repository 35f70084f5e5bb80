//! `dtau = friction+ + damping+ v` for `v > 0`, `-friction- + damping- v` for `v < 0`, and anything between `friction+` and
//! `-friction-` at rest: a seal or a gear that runs better one way.

use super::{Description, Instant, Law, Number, Parameter, Resistance, SIZE, Variable, around, unit};

#[derive(Debug)]
pub(super) struct AsymmetricFriction;

static DESCRIPTION: Description = Description {
    name: "asymmetric_friction",
    summary: "friction and damping that differ by direction: (friction + damping |v|) sgn(v), each by the sign of v",
    parameters: &[
        Parameter::new("friction_positive", unit::EFFORT, SIZE, [around(1.2, 0.9), around(4.5, 0.8)]),
        Parameter::new("friction_negative", unit::EFFORT, SIZE, [around(1.2, 0.9), around(4.5, 0.8)]),
        Parameter::new("damping_positive", unit::DAMPING, SIZE, [around(0.2, 1.0), around(7.0, 1.0)]),
        Parameter::new("damping_negative", unit::DAMPING, SIZE, [around(0.2, 1.0), around(7.0, 1.0)]),
    ],
    signature: "unequal steps and slopes in the two directions",
    confused_with: &["coulomb_friction", "torque_bias"],
    experiment: "slopes over speed in each direction: a bias shifts both branches and leaves their slopes",
    source: "Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
    wears: true,
    ..Description::BLANK
};

impl Law for AsymmetricFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        out.dry = [0, 1].map(|i| N::variable(theta[i], Variable::Theta(i)));
        let i = if at.next < 0.0 { 3 } else { 2 };
        let mut by_theta = [0.0; 4];
        by_theta[i] = at.next;
        out.smooth = at.force(theta[i] * at.next, [0.0, theta[i]], by_theta);
    }
}
