//! Things without a part that moves: whoever finds a joint in them is wrong.

use crate::carcass::{Carcass, contents};
use crate::front::Builder;
use crate::object::Solid;

pub(super) fn table(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let c = Carcass {
        width: r.between(0.5, 1.6),
        depth: r.between(0.4, 0.9),
        bottom: r.between(0.35, 0.75),
        top: 0.0,
        board: r.between(0.015, 0.04),
    };
    let (x, y, z) = (c.depth / 2.0, c.width / 2.0, c.bottom);
    b.body.push(Solid::between([-x, -y, z], [x, y, z + c.board]));
    b.body.extend(c.support(b.random));
    if b.random.chance(0.4) {
        b.body.push(Solid::between([-x + 0.03, -y + 0.03, z - 0.08], [x - 0.03, y - 0.03, z]));
    }
    b.body.extend(contents([-x, -y, z + c.board], [x, y, z + 0.5], b.random));
}

pub(super) fn chair(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let (x, y, z) = (r.between(0.18, 0.26), r.between(0.18, 0.26), r.between(0.4, 0.5));
    let c = Carcass { width: 2.0 * y, depth: 2.0 * x, bottom: z, top: 0.0, board: 0.02 };
    b.body.push(Solid::between([-x, -y, z], [x, y, z + 0.04]));
    b.body.extend(c.support(b.random));
    let high = b.random.between(0.3, 0.55);
    b.body.push(Solid::between([-x, -y, z + 0.1], [-x + 0.03, y, z + high]));
    b.body.push(Solid::between([-x, -y, z], [-x + 0.03, -y + 0.03, z + high]));
    b.body.push(Solid::between([-x, y - 0.03, z], [-x + 0.03, y, z + high]));
}

/// Boards and shelves, no door.
pub(super) fn bookcase(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let bottom = r.pick([0.0, 0.05]);
    let c = Carcass {
        width: r.between(0.4, 1.3),
        depth: r.between(0.2, 0.45),
        bottom,
        top: bottom + r.between(0.6, 2.0),
        board: r.between(0.012, 0.03),
    };
    b.body.extend(c.boards());
    b.body.extend(c.support(b.random));
    let n = 1 + b.random.index(5);
    let (y, mut below) = (c.width / 2.0, c.bottom + c.board);
    for k in 1..=n {
        let z = c.bottom + (c.top - c.bottom) * k as f64 / (n as f64 + 1.0);
        b.body.push(c.shelf(-y, y, z, 0.0));
        if b.random.chance(0.6) {
            b.body.extend(contents([-c.depth / 2.0 + 0.02, -y, below], [c.depth / 2.0, y, z], b.random));
        }
        below = z;
    }
    if b.random.chance(0.4) {
        b.body.push(c.divider(0.0, c.bottom, c.top));
    }
}

/// A block or an open crate.
pub(super) fn crate_or_block(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let (x, y, z, t) = (r.between(0.1, 0.4), r.between(0.1, 0.5), r.between(0.1, 0.8), r.between(0.005, 0.02));
    if r.chance(0.4) {
        b.body.push(Solid::between([-x, -y, 0.0], [x, y, z]));
        return;
    }
    b.body.extend([
        Solid::between([-x, -y, 0.0], [x, y, t]),
        Solid::between([-x, -y, 0.0], [-x + t, y, z]),
        Solid::between([x - t, -y, 0.0], [x, y, z]),
        Solid::between([-x, -y, 0.0], [x, -y + t, z]),
        Solid::between([-x, y - t, 0.0], [x, y, z]),
    ]);
    b.body.extend(contents([-x + t, -y + t, t], [x - t, y - t, z], b.random));
}

/// Pots, bins, mugs: cylinders with a handle.
pub(super) fn vessel(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let radius = r.scale(0.05, 0.25);
    let h = radius * r.between(0.8, 3.0);
    b.body.push(Solid::cylinder([0.0, 0.0, h / 2.0], 2, radius, h / 2.0));
    let off = radius * r.between(0.2, 0.6);
    let t = radius * 0.12;
    b.body.push(Solid::between([radius + off - t, -t, 0.2 * h], [radius + off, t, 0.8 * h]));
    b.body.push(Solid::between([0.0, -t, 0.75 * h], [radius + off, t, 0.8 * h]));
    b.body.push(Solid::between([0.0, -t, 0.2 * h], [radius + off, t, 0.25 * h]));
}

/// Cylinders on one another, as of lamps, plants in pots, stools and tins; some with knobs and grips at their sides.
pub(super) fn turned_pieces(b: &mut Builder<'_>) {
    let scale = b.random.scale(0.06, 0.3);
    let mut z = 0.0;
    for k in 0..1 + b.random.index(4) {
        let (r, h) = (scale * b.random.between(0.15, 1.0), scale * b.random.between(0.1, 1.6));
        b.body.push(Solid::cylinder([0.0, 0.0, z + h / 2.0], 2, r, h / 2.0));
        if k == 0 && b.random.chance(0.4) {
            let (t, at) = (0.12 * r, z + h * b.random.between(0.4, 0.9));
            for side in [-1.0, 1.0] {
                let y = side * (r + 1.5 * t);
                b.body.push(Solid::between([-0.4 * r, y - 1.6 * t, at - t], [0.4 * r, y + 1.6 * t, at + t]));
            }
        }
        z += h;
    }
    if b.random.chance(0.3) {
        let r = 0.15 * scale;
        b.body.push(Solid::cylinder([0.0, 0.0, z + r], 2, r, r));
    }
}

/// A parcel, a plinth, a carton that is taped shut: one block of any shape, some with a gable, a ledge or a label that stands out.
pub(super) fn parcel(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let size = r.scale(0.05, 0.8);
    let (x, y, z) = (size * r.scale(0.25, 1.0), size * r.scale(0.25, 1.0), 2.0 * size * r.scale(0.25, 1.0));
    b.body.push(Solid::between([-x, -y, 0.0], [x, y, z]));
    match b.random.index(5) {
        0 => {
            // A gable in steps, as of a carton of milk.
            let (high, ridge) = (x * b.random.between(0.4, 1.2), 0.08);
            for k in 0..8 {
                let (from, share) = (z + high * f64::from(k) / 8.0, 1.0 - (1.0 - ridge) * f64::from(k + 1) / 8.0);
                b.body.push(Solid::between([-x * share, -y, from], [x * share, y, from + high / 8.0]));
            }
        }
        1 => {
            let (over, t) = (size * b.random.between(0.0, 0.08), size * b.random.between(0.03, 0.12));
            b.body.push(Solid::between([-x - over, -y - over, z], [x + over, y + over, z + t]));
        }
        2 => {
            let t = b.random.between(0.001, 0.006);
            let at = |r: &mut crate::random::Random, half: f64| {
                let (a, c) = (r.between(-0.9, 0.9), r.between(-0.9, 0.9));
                [half * f64::min(a, c), half * f64::max(a, c)]
            };
            let (own_y, own_z) = (at(b.random, y), at(b.random, z / 2.0));
            b.body.push(Solid::between([x, own_y[0], z / 2.0 + own_z[0]], [x + t, own_y[1], z / 2.0 + own_z[1]]));
        }
        _ => (),
    }
}

/// Blocks beside and on one another, with knobs and round pieces: small machines, loudspeakers, steps, printers.
pub(super) fn blocks(b: &mut Builder<'_>) {
    let size = b.random.scale(0.08, 0.5);
    let (x, y) = (size * b.random.between(0.4, 1.0), size * b.random.between(0.4, 1.0));
    let mut z = 0.0;
    for _ in 0..2 + b.random.index(3) {
        let high = size * b.random.scale(0.08, 1.2);
        // Each leaves a side or two of those below it free.
        let mut end = |half: f64, sign: f64| sign * half * if b.random.chance(0.6) { 1.0 } else { b.random.between(-0.3, 0.9) };
        let (low, far) = ([end(x, -1.0), end(y, -1.0)], [end(x, 1.0), end(y, 1.0)]);
        if far[0] - low[0] > 0.15 * size && far[1] - low[1] > 0.15 * size {
            b.body.push(Solid::between([low[0], low[1], z], [far[0], far[1], z + high]));
            z += high;
        }
    }
    if z <= 0.0 {
        b.body.push(Solid::between([-x, -y, 0.0], [x, y, size]));
        z = size;
    }
    for _ in 0..b.random.index(4) {
        let (at_y, at_z, r) = (y * b.random.between(-0.7, 0.7), z * b.random.between(0.15, 0.9), size * b.random.between(0.02, 0.12));
        let out = b.random.between(0.2, 1.2) * r;
        b.body.push(Solid::cylinder([x + out / 2.0, at_y, at_z], 0, r, out / 2.0));
    }
    if b.random.chance(0.4) {
        let (r, h) = (size * b.random.between(0.1, 0.35), size * b.random.between(0.1, 0.5));
        b.body.push(Solid::cylinder([0.0, 0.0, z + h / 2.0], 2, r, h / 2.0));
    }
}
