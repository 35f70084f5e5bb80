//! A barrier over `width` from `position`: `dtau = opening_force b(x)` while latched, `-closing_force b(x)` while free, with
//! `x = (q - position) / width` and `b(x) = 16 x^2 (1 - x)^2` between 0 and 1. It is latched from below `position`, free from above
//! `position + width`: the two ways have each their own potential, and what is left of it where one changes into the other
//! is lost, so a latch never gives energy.
//!
//! The inner state is 1 latched, -1 free, 0 as the position says.

use super::{ABOVE_ZERO, ANY, Advance, Description, Instant, Law, Number, PLACE, Parameter, Resistance, SIZE};
use super::{around, unit};

#[derive(Debug)]
pub(super) struct Latch;

static DESCRIPTION: Description = Description {
    name: "latch",
    summary: "a barrier with one way open and another way shut: opening_force b(x) while latched, -closing_force b(x) while free",
    parameters: &[
        // A microwave's door 15 to 40 N, at 0.4 m.
        Parameter::new("opening_force", unit::EFFORT, SIZE, [around(10.0, 0.5), around(25.0, 0.5)]),
        Parameter::new("closing_force", unit::EFFORT, SIZE, [around(4.0, 0.8), around(10.0, 0.8)]),
        Parameter::new("position", unit::POSITION, ANY, PLACE),
        Parameter::new("width", unit::POSITION, ABOVE_ZERO, [around(0.03, 0.7), around(0.01, 0.7)]),
    ],
    signature: "a one-sided peak, then a drop",
    confused_with: &["magnetic_gasket", "detent"],
    experiment: "the other direction",
    source: "roller latch with its two flanks",
    ..Description::BLANK
};

fn latched(theta: &[f64], at: &Instant<'_>) -> bool {
    if at.z[0] == 0.0 { at.q < theta[2] } else { at.z[0] > 0.0 }
}

impl Law for Latch {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        1
    }

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let x = at.variables::<N>(theta);
        let [opening, closing, position, width, ..] = x.theta;
        let place = (x.end - position) / width;
        if place.value() > 0.0 && place.value() < 1.0 {
            let flank = place * (N::constant(1.0) - place);
            let bump = flank * flank * 16.0;
            out.smooth = bump * if latched(theta, at) { opening } else { -closing };
        }
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        let [position, width] = [theta[2], theta[3]];
        let stays = if latched(theta, at) { at.end() <= position + width } else { at.end() < position };
        out.z[0] = N::constant(if stays { 1.0 } else { -1.0 });
    }
}
