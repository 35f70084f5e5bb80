//! What stands still: open boxes of boards, what they stand on, and what lies in them.

use crate::object::Solid;
use crate::random::Random;

/// An open-fronted box of boards: its outer extents and the thickness of a board, m. It stands from `bottom` up.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Carcass {
    pub(crate) width: f64,
    pub(crate) depth: f64,
    pub(crate) bottom: f64,
    pub(crate) top: f64,
    pub(crate) board: f64,
}

impl Carcass {
    /// Where its front edges are.
    pub(crate) fn front(&self) -> f64 {
        self.depth / 2.0
    }

    /// Back, sides, bottom and top.
    pub(crate) fn boards(&self) -> Vec<Solid> {
        let Self { width, depth, bottom, top, board } = *self;
        let (x, y) = (depth / 2.0, width / 2.0);
        vec![
            Solid::between([-x, -y, bottom], [-x + board.min(0.012), y, top]),
            Solid::between([-x, -y, bottom], [x, -y + board, top]),
            Solid::between([-x, y - board, bottom], [x, y, top]),
            Solid::between([-x, -y, bottom], [x, y, bottom + board]),
            Solid::between([-x, -y, top - board], [x, y, top]),
        ]
    }

    /// A level board inside, over `from..to` of the width.
    pub(crate) fn shelf(&self, from: f64, to: f64, z: f64, setback: f64) -> Solid {
        let x = self.depth / 2.0;
        Solid::between([-x, from, z - self.board / 2.0], [x - setback, to, z + self.board / 2.0])
    }

    /// An upright board inside, over `from..to` of the height.
    pub(crate) fn divider(&self, y: f64, from: f64, to: f64) -> Solid {
        let x = self.depth / 2.0;
        Solid::between([-x, y - self.board / 2.0, from], [x, y + self.board / 2.0, to])
    }

    /// What it stands on: legs, a plinth, feet, or nothing.
    pub(crate) fn support(&self, random: &mut Random) -> Vec<Solid> {
        let (x, y, h) = (self.depth / 2.0, self.width / 2.0, self.bottom);
        if h < 0.005 {
            return Vec::new();
        }
        if h < 0.14 && random.chance(0.5) {
            let back = random.between(0.0, 0.06);
            return vec![Solid::between([-x, -y + back / 2.0, 0.0], [x - back, y - back / 2.0, h])];
        }
        let r = random.between(0.012, 0.03);
        let inset = r + random.between(0.0, 0.05);
        let mut legs = Vec::new();
        for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let (cx, cy) = (sx * (x - inset), sy * (y - inset));
            legs.push(match random.chance(0.5) {
                true => Solid::cylinder([cx, cy, h / 2.0], 2, r, h / 2.0),
                false => Solid::between([cx - r, cy - r, 0.0], [cx + r, cy + r, h]),
            });
        }
        legs
    }
}

/// Things that stand on a level place.
pub(crate) fn contents(low: [f64; 3], high: [f64; 3], random: &mut Random) -> Vec<Solid> {
    let mut things = Vec::new();
    if (0..3).any(|k| high[k] - low[k] < 0.06) {
        return things;
    }
    for _ in 0..random.index(5) {
        let r = random.between(0.02, 0.09).min((high[0] - low[0]) / 2.2).min((high[1] - low[1]) / 2.2);
        let tall = random.between(0.03, 0.9) * (high[2] - low[2]).min(0.35);
        let (x, y) = (random.between(low[0] + r, high[0] - r), random.between(low[1] + r, high[1] - r));
        things.push(match random.chance(0.5) {
            true => Solid::cylinder([x, y, low[2] + tall / 2.0], 2, r, tall / 2.0),
            false => {
                let w = r * random.between(0.4, 1.0);
                Solid::between([x - r, y - w, low[2]], [x + r, y + w, low[2] + tall])
            }
        });
    }
    things
}
