//! What is gone or reached through and is no house door: gates, casement windows, hatches in walls, the doors of stalls.

use nalgebra::Vector3;

use super::entrance::{leaf, room_handle, window};
use crate::front::{Builder, Cell, Edge};
use crate::handle::{Handle, Seat, solids};
use crate::object::{Class, Kind, Solid};

/// A low gate of pales between two posts, sometimes with a fence beside it.
pub(super) fn gate(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let (y, z) = (r.between(0.35, 0.65), r.between(0.7, 1.4));
    let (post, above) = (r.between(0.04, 0.07), r.between(-0.1, 0.25));
    let fence = if r.chance(0.5) { r.between(0.2, 0.8) } else { 0.0 };
    let (thick, gap) = (r.between(0.018, 0.04), r.between(0.004, 0.015));
    let (pale, apart) = (r.between(0.05, 0.12), r.pick([0.0, 0.0, 0.02, 0.05]));
    let rail = r.between(0.06, 0.1);
    for side in [-1.0, 1.0] {
        let (near, far) = (side * y, side * (y + 2.0 * post));
        b.body.push(Solid::between([-post, near.min(far), 0.0], [post, near.max(far), z + above]));
        if fence > 0.0 {
            let end = far + side * fence;
            b.body.push(Solid::between([-thick / 2.0, far.min(end), 0.05], [thick / 2.0, far.max(end), z]));
        }
    }
    let (y0, y1, z0) = (-y + gap, y - gap, 0.06);
    let x = post - b.random.between(0.0, 1.0) * (post - thick);
    let mut all = Vec::new();
    for at in [z0 + 0.1, z - 0.1 - rail] {
        all.push(Solid::between([x - thick, y0, at], [x - 0.4 * thick, y1, at + rail]));
    }
    let many = ((y1 - y0) / (pale + apart)).floor().max(1.0);
    let pitch = (y1 - y0) / many;
    for k in 0..many as usize {
        let from = y0 + k as f64 * pitch;
        all.push(Solid::between([x - 0.4 * thick, from, z0], [x, from + pitch - apart, z]));
    }
    let left = b.random.chance(0.5);
    let toward = if left { 1.0 } else { -1.0 };
    let handle = room_handle(b);
    let seat = Seat { x, at: [-toward * (y - 0.08), 0.75 * z], upright: true, edge: 0.6 * z, toward };
    all.extend(solids(handle, &seat));
    let upper = b.random.between(1.3, 2.0);
    let pin = [x - thick * b.random.between(0.0, 1.0), toward * (y - b.random.between(0.0, gap)), z / 2.0];
    b.hang(Class::Door, all, Kind::Revolute, Vector3::z() * toward, pin, upper);
}

/// A window of one or two wings that turn, at their sides or above.
pub(super) fn casement(b: &mut Builder<'_>) {
    let (y, z, x) = window(b);
    let rim = b.random.between(0.03, 0.07);
    b.style.proud = false;
    b.style.thick = b.random.between(0.02, 0.05).min(1.5 * x);
    b.style.pane = Some([rim, b.random.between(0.003, 0.015), b.random.between(0.0, 0.4)]);
    b.style.pin = b.random.pick([0.5, 1.0]);
    let cell = Cell { x: x - b.random.pick([0.0, 0.003, 0.012]), y, z, depth: 0.0 };
    let handle = match b.random.index(3) {
        0 => Handle::Lever { length: b.random.between(0.06, 0.11), off: b.random.between(0.03, 0.05) },
        1 => Handle::Knob { radius: b.random.between(0.008, 0.016), length: b.random.between(0.015, 0.03) },
        _ => Handle::None,
    };
    let upper = b.random.between(0.8, 1.8);
    if b.random.chance(0.25) {
        b.hinged(&cell, Edge::Top, handle, 0.6 * upper);
    } else if y[1] - y[0] > 0.5 && b.random.chance(0.5) {
        let halves = cell.columns(&[0.5, 0.5]);
        b.hinged(&halves[0], Edge::Right, handle, upper);
        b.hinged(&halves[1], Edge::Left, handle, upper);
    } else {
        let hinge = b.random.pick([Edge::Left, Edge::Right]);
        b.hinged(&cell, hinge, handle, upper);
    }
}

/// A small door in a wall, on a thin frame: a meter's, a service shaft's, a serving hatch.
pub(super) fn wall_hatch(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let (y, half, z) = (r.between(0.12, 0.4), r.between(0.12, 0.45), r.between(0.5, 1.4));
    let (wall, deep) = (r.between(0.08, 0.4), r.between(0.03, 0.1));
    let (below, above) = (r.between(0.1, 0.5), r.between(0.05, 0.4));
    let (z0, z1) = (z - half, z + half);
    let (low, high) = ((z0 - below).max(0.0), z1 + above);
    b.body.extend([
        Solid::between([-deep, -y - wall, low], [0.0, -y, high]),
        Solid::between([-deep, y, low], [0.0, y + wall, high]),
        Solid::between([-deep, -y, low], [0.0, y, z0]),
        Solid::between([-deep, -y, z1], [0.0, y, high]),
    ]);
    if b.random.chance(0.6) {
        b.body.push(Solid::between([-deep - 0.2, -y, z0], [-deep, y, z1]));
    }
    let (rim, out) = (b.random.between(0.012, 0.05), b.random.between(0.002, 0.02));
    b.body.extend([
        Solid::between([0.0, -y - rim, z0 - rim], [out, -y, z1 + rim]),
        Solid::between([0.0, y, z0 - rim], [out, y + rim, z1 + rim]),
        Solid::between([0.0, -y, z0 - rim], [out, y, z0]),
        Solid::between([0.0, -y, z1], [out, y, z1 + rim]),
    ]);
    b.style.proud = false;
    b.style.pin = b.random.pick([0.5, 1.0, 1.0]);
    let x = out - b.random.pick([0.0_f64, 0.0, 0.004, 0.015]).min(out);
    let cell = Cell { x, y: [-y, y], z: [z0, z1], depth: 0.0 };
    let handle = b.style.door_handle;
    let upper = b.random.between(1.4, 2.4);
    let hinge = b.random.pick([Edge::Left, Edge::Left, Edge::Right, Edge::Right, Edge::Bottom]);
    b.hinged(&cell, hinge, handle, upper);
}

/// Doors between pilasters that reach neither the floor nor the top.
pub(super) fn stalls(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let many = 1 + r.index(3);
    let (width, pilaster) = (r.between(0.55, 0.8), r.between(0.06, 0.25));
    let (z0, z1) = (r.between(0.08, 0.25), r.between(1.5, 2.0));
    let (thick, deep) = (r.between(0.015, 0.035), r.between(0.3, 1.2));
    let all = many as f64 * (width + pilaster) + pilaster;
    let top = z1 + r.between(0.0, 0.15);
    let rail = r.between(0.02, 0.06);
    for k in 0..=many {
        let from = -all / 2.0 + k as f64 * (width + pilaster);
        b.body.push(Solid::between([-thick, from, 0.0], [0.0, from + pilaster, top]));
        let middle = from + pilaster / 2.0;
        b.body.push(Solid::between([-deep, middle - thick / 2.0, z0], [-thick, middle + thick / 2.0, z1]));
    }
    if b.random.chance(0.6) {
        b.body.push(Solid::between([-thick, -all / 2.0, top], [0.0, all / 2.0, top + rail]));
    }
    b.style.proud = false;
    b.style.thick = thick;
    b.style.pin = b.random.pick([0.5, 1.0]);
    let left = b.random.chance(0.5);
    let handle = room_handle(b);
    for k in 0..many {
        let from = -all / 2.0 + k as f64 * (width + pilaster) + pilaster;
        let cell = Cell { x: 0.0, y: [from, from + width], z: [z0, z1], depth: 0.0 };
        leaf(b, &cell, if left { Edge::Left } else { Edge::Right }, handle);
    }
}
