//! What a hand takes hold of: bars, knobs, grips sunk into a panel, or nothing.

use crate::object::Solid;
use crate::random::Random;

/// The forms of handle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Handle {
    None,
    /// A bar on two posts: its length as a share of the edge, its radius, how far it stands off.
    Bar {
        share: f64,
        radius: f64,
        off: f64,
        round: bool,
    },
    /// A knob by radius and length.
    Knob {
        radius: f64,
        length: f64,
    },
    /// A lever on a rose: length and distance from the panel.
    Lever {
        length: f64,
        off: f64,
    },
    /// A strip along the free edge that stands out.
    Lip {
        share: f64,
        deep: f64,
        wide: f64,
    },
    /// A notch in the free edge: its length as a share of the edge, its width.
    Notch {
        share: f64,
        wide: f64,
    },
}

impl Handle {
    pub(crate) fn draw(random: &mut Random, none: f64) -> Self {
        if random.chance(none) {
            return Self::None;
        }
        match random.index(10) {
            0..=4 => Self::Bar {
                share: random.between(0.08, 0.9),
                radius: random.between(0.004, 0.014),
                off: random.between(0.02, 0.055),
                round: random.chance(0.6),
            },
            5..=6 => Self::Knob { radius: random.between(0.009, 0.022), length: random.between(0.015, 0.04) },
            7 => Self::Lip { share: random.between(0.15, 1.0), deep: random.between(0.012, 0.03), wide: random.between(0.008, 0.02) },
            _ => Self::Notch { share: random.between(0.1, 1.0), wide: random.between(0.015, 0.035) },
        }
    }

    /// A stout bar, as kitchen machines have.
    pub(crate) fn stout(random: &mut Random) -> Self {
        Self::Bar {
            share: random.between(0.4, 0.92),
            radius: random.between(0.007, 0.024),
            off: random.between(0.03, 0.09),
            round: random.chance(0.5),
        }
    }
}

/// The place of a handle on a panel whose outer face lies at `x`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seat {
    /// Outer face.
    pub(crate) x: f64,
    /// Centre, y and z.
    pub(crate) at: [f64; 2],
    /// Does the bar run upright?
    pub(crate) upright: bool,
    /// Length of the panel's edge along the bar.
    pub(crate) edge: f64,
    /// Where a lever points: along y.
    pub(crate) toward: f64,
}

/// The solids of what stands out; a notch is cut by the panel's maker and a lip made there.
pub(crate) fn solids(handle: Handle, seat: &Seat) -> Vec<Solid> {
    let [y, z] = seat.at;
    let x = seat.x;
    // Half extents along and across the bar, as y and z.
    let spread = |along: f64, across: f64| if seat.upright { [across, along] } else { [along, across] };
    match handle {
        Handle::None | Handle::Notch { .. } | Handle::Lip { .. } => Vec::new(),
        Handle::Bar { share, radius, off, round } => {
            let half = (share * seat.edge / 2.0).max(0.03).min(seat.edge / 2.0 - 0.005).max(0.01);
            let axis = if seat.upright { 2 } else { 1 };
            let bar = match round {
                true => Solid::cylinder([x + off, y, z], axis, radius, half),
                false => {
                    let [dy, dz] = spread(half, radius);
                    Solid::between([x + off - radius, y - dy, z - dz], [x + off + radius, y + dy, z + dz])
                }
            };
            let mut all = vec![bar];
            for end in [-1.0, 1.0] {
                let [dy, dz] = spread(end * (half - 1.2 * radius), 0.0);
                let r = 0.8 * radius;
                all.push(Solid::between([x, y + dy - r, z + dz - r], [x + off, y + dy + r, z + dz + r]));
            }
            all
        }
        Handle::Knob { radius, length } => vec![
            Solid::cylinder([x + length * 0.3, y, z], 0, radius * 0.5, length * 0.3),
            Solid::cylinder([x + length * 0.8, y, z], 0, radius, length * 0.2),
        ],
        Handle::Lever { length, off } => vec![
            Solid::cylinder([x + 0.005, y, z], 0, 0.025, 0.005),
            Solid::cylinder([x + off / 2.0, y, z], 0, 0.009, off / 2.0),
            Solid::between(
                [x + off - 0.008, y.min(y + seat.toward * length), z - 0.01],
                [x + off + 0.008, y.max(y + seat.toward * length), z + 0.01],
            ),
        ],
    }
}
