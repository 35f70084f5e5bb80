//! Boxes: lids and flaps on top of four walls.

use nalgebra::Vector3;

use crate::carcass::contents;
use crate::front::{Builder, Cell, Edge};
use crate::object::{Class, Kind, Solid};

/// Extents of a box without its lid: half depth, half width, height, wall.
#[derive(Clone, Copy)]
struct Walls {
    x: f64,
    y: f64,
    z: f64,
    wall: f64,
}

impl Walls {
    fn draw(b: &mut Builder<'_>, wall: [f64; 2]) -> Self {
        let r = &mut b.random;
        let y = r.scale(0.08, 0.4);
        let walls = Self { x: y * r.between(0.5, 1.0), y, z: y * r.between(0.5, 1.6), wall: r.between(wall[0], wall[1]) };
        let Self { x, y, z, wall: t } = walls;
        b.body.extend([
            Solid::between([-x, -y, 0.0], [x, y, t]),
            Solid::between([-x, -y, 0.0], [-x + t, y, z]),
            Solid::between([x - t, -y, 0.0], [x, y, z]),
            Solid::between([-x, -y, 0.0], [x, -y + t, z]),
            Solid::between([-x, y - t, 0.0], [x, y, z]),
        ]);
        if b.random.chance(0.5) {
            b.body.extend(contents([-x + t, -y + t, t], [x - t, y - t, z], b.random));
        }
        walls
    }

    /// A lid on the hinge at the back, of boxes.
    fn lid(&self, b: &mut Builder<'_>, solids: Vec<Solid>, height: f64) {
        let upper = b.random.between(1.3, 2.0);
        let inset = b.random.between(0.0, 0.008);
        b.hang(Class::Lid, solids, Kind::Revolute, -Vector3::y(), [-self.x + inset, 0.0, height], upper);
    }
}

/// A board on top.
pub(super) fn flat_lid(b: &mut Builder<'_>) {
    let w = Walls::draw(b, [0.004, 0.02]);
    let over = b.random.between(0.0, 0.015);
    let thick = b.random.between(0.006, 0.025);
    let gap = b.random.between(0.001, 0.004);
    let mut lid = vec![Solid::between([-w.x, -w.y - over, w.z + gap], [w.x + over, w.y + over, w.z + gap + thick])];
    if b.random.chance(0.4) {
        let r = b.random.between(0.008, 0.018);
        lid.push(Solid::cylinder([w.x * 0.7, 0.0, w.z + gap + thick + r], 2, r, r));
    }
    w.lid(b, lid, w.z + gap);
}

/// A lid with walls of its own.
fn with_walls(b: &mut Builder<'_>, w: Walls, deep: f64, over: f64) {
    let gap = b.random.between(0.001, 0.004);
    let (t, z0) = (w.wall, w.z + gap);
    let z1 = z0 + deep;
    let (x, y) = (w.x + over, w.y + over);
    let mut lid = vec![
        Solid::between([-x, -y, z1 - t], [x, y, z1]),
        Solid::between([-x, -y, z0], [-x + t, y, z1]),
        Solid::between([x - t, -y, z0], [x, y, z1]),
        Solid::between([-x, -y, z0], [x, -y + t, z1]),
        Solid::between([-x, y - t, z0], [x, y, z1]),
    ];
    if b.random.chance(0.4) {
        let h = b.random.between(0.01, 0.02);
        lid.push(Solid::between([x, -h, z0 - 0.01], [x + 0.008, h, z0 + deep * 0.5]));
    }
    w.lid(b, lid, z0);
}

/// A chest.
pub(super) fn deep_lid(b: &mut Builder<'_>) {
    let w = Walls::draw(b, [0.006, 0.02]);
    let deep = w.z * b.random.between(0.15, 0.5);
    with_walls(b, w, deep, 0.0);
}

/// A lid on a slab hardly thicker than itself: notebooks, cases for games, scanners.
pub(super) fn slab_lid(b: &mut Builder<'_>) {
    let r = &mut b.random;
    let (x, y) = (r.between(0.09, 0.3), r.between(0.12, 0.35));
    let (low, thick, gap) = (r.between(0.012, 0.12), r.between(0.006, 0.05), r.between(0.0005, 0.003));
    b.body.push(Solid::between([-x, -y, 0.0], [x, y, low]));
    if r.chance(0.4) {
        // What lies on it, under the lid.
        b.body.push(Solid::between([-0.2 * x, -0.8 * y, low], [0.7 * x, 0.8 * y, low + gap]));
    }
    let over = r.between(0.0, 0.006);
    let lid = vec![Solid::between([-x, -y - over, low + gap], [x + over, y + over, low + gap + thick])];
    let w = Walls { x, y, z: low, wall: 0.01 };
    w.lid(b, lid, low + gap);
}

/// A casket: a shallow lid that stands over the walls, small feet, an inner tray.
pub(super) fn casket(b: &mut Builder<'_>) {
    let w = Walls::draw(b, [0.008, 0.016]);
    let deep = b.random.between(0.025, 0.06);
    let over = b.random.between(0.004, 0.012);
    let z = w.z * b.random.between(0.5, 0.8);
    b.body.push(Solid::between([-w.x, -w.y, z], [w.x, w.y * 0.2, z + 0.006]));
    with_walls(b, w, deep, over);
}

/// A thick lid with a rim, in one piece or two halves that meet in the middle.
pub(super) fn rimmed_lid(b: &mut Builder<'_>) {
    let w = Walls::draw(b, [0.006, 0.02]);
    let (thick, over) = (b.random.between(0.01, 0.04), b.random.between(0.0, 0.02));
    let gap = b.random.between(0.001, 0.004);
    let (z0, z1) = (w.z + gap, w.z + gap + thick);
    if b.random.chance(0.5) {
        let rim = b.random.between(0.01, 0.03);
        let lid = vec![
            Solid::between([-w.x, -w.y - over, z0], [w.x + over, w.y + over, z1]),
            Solid::between([w.x + 0.002, -w.y - over, z0 - rim], [w.x + over + 0.004, w.y + over, z0]),
        ];
        w.lid(b, lid, z0);
    } else {
        for side in [-1.0, 1.0] {
            let (y0, y1) = (side * 0.002, side * (w.y + over));
            let half = vec![Solid::between([-w.x, y0.min(y1), z0], [w.x, y0.max(y1), z1])];
            let upper = b.random.between(1.4, 2.6);
            b.hang(Class::Lid, half, Kind::Revolute, nalgebra::Vector3::x() * -side, [0.0, side * w.y, z0], upper);
        }
    }
}

/// One flap of a carton about an upper edge: `side` says which wall, `reach` how far it covers.
fn carton_flap(b: &mut Builder<'_>, w: Walls, side: Edge, reach: f64, lift: f64) {
    let (t, z) = (w.wall, w.z + lift);
    let g = 0.003;
    let upper = b.random.between(2.4, 4.0);
    let (low, high, axis, origin) = match side {
        Edge::Bottom => ([w.x - reach, -w.y + g, z], [w.x, w.y - g, z + t], Vector3::y(), [w.x, 0.0, z]),
        Edge::Top => ([-w.x, -w.y + g, z], [-w.x + reach, w.y - g, z + t], -Vector3::y(), [-w.x, 0.0, z]),
        Edge::Left => ([-w.x + g, w.y - reach, z], [w.x - g, w.y, z + t], -Vector3::x(), [0.0, w.y, z]),
        Edge::Right => ([-w.x + g, -w.y, z], [w.x - g, -w.y + reach, z + t], Vector3::x(), [0.0, -w.y, z]),
    };
    b.hang(Class::Lid, vec![Solid::between(low, high)], Kind::Revolute, axis, origin, upper);
}

/// A carton with four flaps; the long ones lie on the short ones.
pub(super) fn carton_four_flaps(b: &mut Builder<'_>) {
    let w = Walls::draw(b, [0.003, 0.006]);
    let reach = w.x.min(w.y) * b.random.between(0.85, 0.99);
    carton_flap(b, w, Edge::Left, reach, 0.001);
    carton_flap(b, w, Edge::Right, reach, 0.001);
    let lift = w.wall + 0.002;
    carton_flap(b, w, Edge::Bottom, w.x - 0.002, lift);
    carton_flap(b, w, Edge::Top, w.x - 0.002, lift);
}

/// A carton with two flaps that meet.
pub(super) fn carton_two_flaps(b: &mut Builder<'_>) {
    let w = Walls::draw(b, [0.003, 0.008]);
    if b.random.chance(0.5) {
        carton_flap(b, w, Edge::Left, w.y - 0.002, 0.001);
        carton_flap(b, w, Edge::Right, w.y - 0.002, 0.001);
    } else {
        carton_flap(b, w, Edge::Bottom, w.x - 0.002, 0.001);
        carton_flap(b, w, Edge::Top, w.x - 0.002, 0.001);
    }
}

/// A bread box: a flap at the front of a closed box.
pub(super) fn front_flap_box(b: &mut Builder<'_>) {
    let (width, depth, height) = (b.random.between(0.25, 0.55), b.random.between(0.18, 0.4), b.random.between(0.15, 0.4));
    let board = b.random.between(0.008, 0.018);
    let c = crate::carcass::Carcass { width, depth, bottom: 0.0, top: height, board };
    b.body.extend(c.boards());
    let cell = match b.style.proud {
        true => Cell { x: c.front(), y: [-width / 2.0, width / 2.0], z: [0.0, height], depth },
        false => Cell { x: c.front(), y: [-width / 2.0 + board, width / 2.0 - board], z: [board, height - board], depth },
    };
    let edge = b.random.pick([Edge::Bottom, Edge::Bottom, Edge::Top]);
    b.flap(&cell, edge);
}
