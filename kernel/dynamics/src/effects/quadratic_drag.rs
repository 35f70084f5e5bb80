//! `dtau = drag v |v|`: air or a fluid that is pushed aside.

use super::{Description, Instant, Law, Number, Parameter, Resistance, SIZE, around};

#[derive(Debug)]
pub(super) struct QuadraticDrag;

static DESCRIPTION: Description = Description {
    name: "quadratic_drag",
    summary: "resists with the square of speed: drag v |v|",
    // 0.01 to 0.1 on a door.
    parameters: &[Parameter::new("drag", ["N m s^2/rad^2", "N s^2/m^2"], SIZE, [around(0.03, 0.9), around(1.0, 1.2)])],
    signature: "grows with the square of speed",
    confused_with: &["viscous_friction", "actuator_saturation"],
    experiment: "free decay from high speed",
    source: "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky 1998",
    ..Description::BLANK
};

impl Law for QuadraticDrag {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let (drag, speed) = (theta[0], at.next.abs());
        out.smooth = at.force(drag * at.next * speed, [0.0, 2.0 * drag * speed], [at.next * speed]);
    }
}
