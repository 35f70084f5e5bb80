//! `dtau = damping v` while closing (`v < 0`), and `stiffness q`, below `position`: the cartridge that catches a drawer and draws
//! it shut. Where a step crosses `position` the force acts on the share of the way that lies below it.

use super::{ANY, Description, Instant, Law, Number, Parameter, Resistance, SIZE, around, unit};

#[derive(Debug)]
pub(super) struct SoftCloseDamper;

static DESCRIPTION: Description = Description {
    name: "soft_close_damper",
    summary: "catches and draws shut: below position, damping v while closing, and stiffness q",
    parameters: &[
        // 10 to 200 N s/m.
        Parameter::new("damping", unit::DAMPING, SIZE, [around(5.0, 0.9), around(45.0, 0.9)]),
        Parameter::new("position", unit::POSITION, ANY, [around(0.3, 0.6), around(0.05, 0.5)]),
        Parameter::new("stiffness", unit::STIFFNESS, SIZE, [around(3.0, 1.0), around(100.0, 1.0)]),
    ],
    signature: "in one direction, in one zone",
    confused_with: &["viscous_friction", "hard_stop"],
    experiment: "close at three speeds",
    source: "drawer cartridges",
    ..Description::BLANK
};

impl Law for SoftCloseDamper {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [damping, position, stiffness, ..] = x.theta;
        let mut force = stiffness * x.end;
        if at.next < 0.0 {
            force = force + damping * x.next;
        }
        out.smooth = x.share_below(position) * force;
    }
}
