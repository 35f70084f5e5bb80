//! Doors in frames and walls.

use nalgebra::Vector3;

use crate::front::{Builder, Cell, Edge};
use crate::handle::{Handle, Seat, solids};
use crate::object::{Class, Kind, Solid};

/// The hole of a door: half width, height, half depth of the frame, width of its posts.
struct Frame {
    y: f64,
    z: f64,
    x: f64,
    post: f64,
}

impl Frame {
    fn draw(b: &mut Builder<'_>, width: [f64; 2]) -> Self {
        let r = &mut b.random;
        Self { y: r.between(width[0], width[1]) / 2.0, z: r.between(1.85, 2.2), x: r.between(0.03, 0.09), post: r.between(0.04, 0.12) }
    }

    /// Two posts, a lintel, sometimes a threshold; the wall around it, of a width and a height.
    fn stand(&self, b: &mut Builder<'_>, wall: f64, above: f64) {
        let Self { y, z, x, post } = *self;
        b.body.extend([
            Solid::between([-x, -y - post, 0.0], [x, -y, z + post]),
            Solid::between([-x, y, 0.0], [x, y + post, z + post]),
            Solid::between([-x, -y, z], [x, y, z + post]),
        ]);
        if b.random.chance(0.3) {
            b.body.push(Solid::between([-x, -y, -0.02], [x, y, 0.004]));
        }
        if wall > 0.0 {
            let t = 0.7 * x;
            b.body.extend([
                Solid::between([-t, -y - post - wall, 0.0], [t, -y - post, z + post + above]),
                Solid::between([-t, y + post, 0.0], [t, y + post + wall, z + post + above]),
            ]);
            if above > 0.02 {
                b.body.push(Solid::between([-t, -y - post, z + post], [t, y + post, z + post + above]));
            }
        }
    }

    /// The hole, with the leaf's outer face somewhere within the frame's depth.
    fn cell(&self, b: &mut Builder<'_>) -> Cell {
        b.style.proud = false;
        b.style.thick = b.random.between(0.025, 0.05);
        b.style.pin = b.random.pick([0.5, 1.0, 1.0]);
        b.style.inset = b.random.between(0.0, 0.008);
        let x = self.x - b.random.pick([0.0_f64, 0.004, 0.02]).min(self.x - 0.02);
        Cell { x, y: [-self.y, self.y], z: [0.006, self.z], depth: 0.0 }
    }
}

pub(super) fn room_handle(b: &mut Builder<'_>) -> Handle {
    match b.random.index(6) {
        0..=2 => Handle::Lever { length: b.random.between(0.09, 0.14), off: b.random.between(0.04, 0.06) },
        3 => Handle::Knob { radius: b.random.between(0.022, 0.032), length: b.random.between(0.05, 0.07) },
        4 => Handle::Bar {
            share: b.random.between(0.1, 0.5),
            radius: b.random.between(0.008, 0.018),
            off: b.random.between(0.03, 0.06),
            round: true,
        },
        _ => Handle::None,
    }
}

pub(super) fn leaf(b: &mut Builder<'_>, cell: &Cell, hinge: Edge, handle: Handle) {
    framed_leaf(b, cell, hinge, handle, 0.15);
}

/// The same, with stiles and rails about a field that is set back in such a share of leaves.
fn framed_leaf(b: &mut Builder<'_>, cell: &Cell, hinge: Edge, handle: Handle, share: f64) {
    b.style.height = 0.5;
    b.style.pane =
        b.random.chance(share).then(|| [b.random.between(0.1, 0.15), b.random.between(0.005, 0.015), b.random.between(0.0, 0.3)]);
    let upper = b.random.between(1.5, 2.2);
    b.hinged(cell, hinge, handle, upper);
}

fn single(b: &mut Builder<'_>, wall: f64, above: f64) {
    let frame = Frame::draw(b, [0.65, 1.0]);
    frame.stand(b, wall, above);
    let cell = frame.cell(b);
    let handle = room_handle(b);
    let hinge = b.random.pick([Edge::Left, Edge::Right]);
    framed_leaf(b, &cell, hinge, handle, if wall > 0.0 { 0.4 } else { 0.15 });
}

pub(super) fn single_in_frame(b: &mut Builder<'_>) {
    single(b, 0.0, 0.0);
}

/// A door amid a wall that goes on for up to more than a metre: beside the stile of a leaf that is nearly shut the wall is all that is seen.
pub(super) fn in_wall(b: &mut Builder<'_>) {
    let (wall, above) = (b.random.between(0.15, 1.3), b.random.between(0.0, 0.5));
    single(b, wall, above);
}

pub(super) fn double_in_frame(b: &mut Builder<'_>) {
    let frame = Frame::draw(b, [1.1, 1.8]);
    let wall = if b.random.chance(0.3) { b.random.between(0.1, 0.4) } else { 0.0 };
    frame.stand(b, wall, 0.0);
    let cell = frame.cell(b);
    let handle = room_handle(b);
    let halves = cell.columns(&[0.5, 0.5]);
    leaf(b, &halves[0], Edge::Right, handle);
    leaf(b, &halves[1], Edge::Left, handle);
}

/// A leaf that hangs before the wall and slides along it.
pub(super) fn sliding_before_wall(b: &mut Builder<'_>) {
    let frame = Frame::draw(b, [0.7, 1.0]);
    let (wall, above) = (b.random.between(0.75, 1.0), b.random.between(0.05, 0.25));
    frame.stand(b, wall, above);
    let (y, z) = (frame.y + 0.03, frame.z + 0.04);
    let x = frame.x + b.random.between(0.008, 0.03);
    let thick = b.random.between(0.025, 0.045);
    let toward = b.random.pick([-1.0, 1.0]);
    let mut all = vec![Solid::between([x, -y, 0.01], [x + thick, y, z])];
    let handle = match b.random.chance(0.5) {
        true => Handle::Bar { share: b.random.between(0.1, 0.3), radius: 0.012, off: 0.045, round: true },
        false => Handle::None,
    };
    all.extend(solids(handle, &Seat { x: x + thick, at: [-toward * (y - 0.07), 1.02], upright: true, edge: z, toward }));
    let rail = z - 0.03;
    let reach = if toward > 0.0 { [-y, y + 2.0 * y * 0.95] } else { [-y - 2.0 * y * 0.95, y] };
    b.body.push(Solid::between([frame.x - 0.001, reach[0], rail], [x - 0.002, reach[1], rail + 0.05]));
    let upper = 2.0 * frame.y * b.random.between(0.85, 0.98);
    b.hang(Class::Door, all, Kind::Prismatic, Vector3::y() * toward, [x, 0.0, z / 2.0], upper);
}

/// A pane in rails, from `y` and `z` to, its outer face at `x`: a rim of bars about a thinner sheet.
fn pane(b: &mut Builder<'_>, x: f64, y: [f64; 2], z: [f64; 2]) -> Vec<Solid> {
    let (thick, rim) = (b.random.between(0.012, 0.04), b.random.between(0.015, 0.06).min(0.2 * (y[1] - y[0])).min(0.2 * (z[1] - z[0])));
    let back = thick * b.random.between(0.2, 0.8);
    let glass = if b.random.chance(0.5) { b.random.between(0.0, 0.4) } else { 0.0 };
    vec![
        Solid::between([x - thick, y[0], z[0]], [x, y[0] + rim, z[1]]),
        Solid::between([x - thick, y[1] - rim, z[0]], [x, y[1], z[1]]),
        Solid::between([x - thick, y[0], z[0]], [x, y[1], z[0] + rim]),
        Solid::between([x - thick, y[0], z[1] - rim], [x, y[1], z[1]]),
        Solid::between([x - thick + 0.001, y[0] + rim, z[0] + rim], [x - back, y[1] - rim, z[1] - rim]).dark(glass),
    ]
}

/// Four bars about a hole, as of a window: its half width, from and to along z, half depth and bar.
pub(super) fn window(b: &mut Builder<'_>) -> ([f64; 2], [f64; 2], f64) {
    let r = &mut b.random;
    let (y, low, high) = (r.scale(0.12, 0.7), r.pick([0.02, 0.05, 0.5]), r.scale(0.35, 1.3));
    let (x, bar) = (r.between(0.03, 0.07), r.between(0.02, 0.06));
    let (z0, z1) = (low, low + high);
    b.body.extend([
        Solid::between([-x, -y - bar, z0 - bar], [x, -y, z1 + bar]),
        Solid::between([-x, y, z0 - bar], [x, y + bar, z1 + bar]),
        Solid::between([-x, -y, z1], [x, y, z1 + bar]),
        Solid::between([-x, -y, z0 - bar], [x, y, z0]),
    ]);
    if z0 > 0.3 {
        // The wall below.
        b.body.push(Solid::between([-0.7 * x, -y - bar, 0.0], [0.7 * x, y + bar, z0 - bar]));
    }
    ([-y, y], [z0, z1], x)
}

/// Something to push it by, amid one of its bars.
fn pull(b: &mut Builder<'_>, x: f64, at: [f64; 2], upright: bool, edge: f64) -> Vec<Solid> {
    let handle = match b.random.index(3) {
        0 => Handle::None,
        1 => Handle::Knob { radius: b.random.between(0.008, 0.016), length: b.random.between(0.015, 0.03) },
        _ => Handle::Bar {
            share: b.random.between(0.15, 0.6),
            radius: b.random.between(0.005, 0.012),
            off: b.random.between(0.025, 0.06),
            round: b.random.chance(0.5),
        },
    };
    solids(handle, &Seat { x, at, upright, edge, toward: 1.0 })
}

/// A pane that is pushed up behind or before a fixed one.
pub(super) fn sash_window(b: &mut Builder<'_>) {
    let (y, z, x) = window(b);
    let meet = z[0] + (z[1] - z[0]) * b.random.between(0.4, 0.6);
    let (near, far) = (x - b.random.between(0.002, 0.012), -b.random.between(0.0, 0.01));
    let before = b.random.chance(0.7);
    let still = pane(b, if before { far } else { near }, y, [meet - 0.015, z[1]]);
    b.body.extend(still);
    let face = if before { near } else { far };
    let mut all = pane(b, face, [y[0] + 0.003, y[1] - 0.003], [z[0] + 0.003, meet + 0.015]);
    let at = [b.random.between(-0.3, 0.3) * y[1], z[0] + 0.02];
    all.extend(pull(b, face, at, false, y[1] - y[0]));
    let upper = (z[1] - meet) * b.random.between(0.7, 0.95);
    b.hang(Class::Door, all, Kind::Prismatic, Vector3::z(), [face, 0.0, (z[0] + meet) / 2.0], upper);
}

/// Two panes in a frame, one of which, or each, is pushed sideways before the other.
pub(super) fn sliding_panes(b: &mut Builder<'_>) {
    let (y, z, x) = window(b);
    let meet = y[1] * b.random.between(-0.15, 0.15);
    let (near, far) = (x - b.random.between(0.002, 0.012), -b.random.between(0.0, 0.01));
    let left = b.random.chance(0.5);
    let both = b.random.chance(0.3);
    for (side, face) in [(left, near), (!left, far)] {
        let own = if side { [meet - 0.015, y[1] - 0.003] } else { [y[0] + 0.003, meet + 0.015] };
        let mut all = pane(b, face, own, [z[0] + 0.003, z[1] - 0.003]);
        if face < near && !both {
            b.body.extend(all);
            continue;
        }
        let toward = if side { -1.0 } else { 1.0 };
        let at = [if side { own[1] - 0.02 } else { own[0] + 0.02 }, b.random.between(0.35, 0.65) * (z[0] + z[1])];
        all.extend(pull(b, face, at, true, z[1] - z[0]));
        let upper = (own[1] - own[0]) * b.random.between(0.7, 0.95);
        b.hang(Class::Door, all, Kind::Prismatic, Vector3::y() * toward, [face, (own[0] + own[1]) / 2.0, (z[0] + z[1]) / 2.0], upper);
    }
}

/// A door under a fixed panel.
pub(super) fn under_transom(b: &mut Builder<'_>) {
    let mut frame = Frame::draw(b, [0.7, 1.3]);
    frame.z += b.random.between(0.25, 0.5);
    let wall = if b.random.chance(0.4) { b.random.between(0.1, 0.5) } else { 0.0 };
    frame.stand(b, wall, 0.0);
    let cell = frame.cell(b);
    let share = b.random.between(0.75, 0.85);
    let rows = cell.rows(&[share, 1.0 - share]);
    let bar = b.random.between(0.03, 0.06);
    let z = rows[1].z[0];
    b.body.push(Solid::between([-frame.x, -frame.y, z - bar / 2.0], [frame.x, frame.y, z + bar / 2.0]));
    let back = b.random.between(0.0, 0.03);
    b.body.push(Solid::between([-0.02, -frame.y, z], [0.02 - back, frame.y, frame.z]));
    let handle = room_handle(b);
    let door = Cell { z: [rows[0].z[0], z - bar / 2.0], ..rows[0] };
    if frame.y > 0.55 {
        let halves = door.columns(&[0.5, 0.5]);
        leaf(b, &halves[0], Edge::Right, handle);
        leaf(b, &halves[1], Edge::Left, handle);
    } else {
        let hinge = b.random.pick([Edge::Left, Edge::Right]);
        leaf(b, &door, hinge, handle);
    }
}

/// A wide and a narrow leaf, or a fixed leaf of the same make beside the one that moves.
pub(super) fn unequal_leaves(b: &mut Builder<'_>) {
    let frame = Frame::draw(b, [1.1, 1.6]);
    frame.stand(b, 0.0, 0.0);
    let cell = frame.cell(b);
    let handle = room_handle(b);
    let share = b.random.between(0.25, 0.45);
    let left = b.random.chance(0.5);
    let parts = if left { cell.columns(&[1.0 - share, share]) } else { cell.columns(&[share, 1.0 - share]) };
    let (wide, narrow) = if left { (parts[0], parts[1]) } else { (parts[1], parts[0]) };
    leaf(b, &wide, if left { Edge::Right } else { Edge::Left }, handle);
    if b.random.chance(0.5) {
        leaf(b, &narrow, if left { Edge::Left } else { Edge::Right }, Handle::None);
    } else {
        b.blank(&narrow);
    }
}

/// Folding shutters: leaves above one another before a window, of unequal height.
pub(super) fn hatch_over_counter(b: &mut Builder<'_>) {
    let frame = Frame::draw(b, [0.8, 1.4]);
    frame.stand(b, 0.0, 0.0);
    let cell = frame.cell(b);
    let counter = b.random.between(0.35, 0.5);
    let rows = cell.rows(&[counter, 1.0 - counter]);
    b.body.push(Solid::between([-frame.x, -frame.y, 0.0], [frame.x * b.random.between(0.3, 1.0), frame.y, rows[0].z[1]]));
    let handle = room_handle(b);
    match b.random.index(3) {
        0 => {
            let hinge = b.random.pick([Edge::Left, Edge::Right]);
            leaf(b, &rows[1], hinge, handle);
        }
        1 => {
            let halves = rows[1].columns(&[0.5, 0.5]);
            leaf(b, &halves[0], Edge::Right, handle);
            leaf(b, &halves[1], Edge::Left, handle);
        }
        _ => leaf(b, &rows[1], Edge::Top, Handle::None),
    }
}

/// A door beside a fixed pane.
pub(super) fn with_sidelight(b: &mut Builder<'_>) {
    let frame = Frame::draw(b, [1.05, 1.5]);
    frame.stand(b, 0.0, 0.0);
    let cell = frame.cell(b);
    let share = b.random.between(0.62, 0.75);
    let post = b.random.between(0.03, 0.05);
    let door_left = b.random.chance(0.5);
    let parts = if door_left { cell.columns(&[1.0 - share, share]) } else { cell.columns(&[share, 1.0 - share]) };
    let (side, door) = if door_left { (parts[0], parts[1]) } else { (parts[1], parts[0]) };
    let y = if door_left { side.y[1] } else { side.y[0] };
    b.body.push(Solid::between([-frame.x, y - post / 2.0, 0.0], [frame.x, y + post / 2.0, frame.z]));
    b.body.push(Solid::between([-0.004, side.y[0], 0.0], [0.004, side.y[1], frame.z]));
    let z = b.random.between(0.3, 0.8);
    b.body.push(Solid::between([-0.02, side.y[0], 0.0], [0.02, side.y[1], z]));
    let handle = room_handle(b);
    let hinge = b.random.pick([Edge::Left, Edge::Right]);
    let inner = if door_left {
        Cell { y: [door.y[0] + post / 2.0, door.y[1]], ..door }
    } else {
        Cell { y: [door.y[0], door.y[1] - post / 2.0], ..door }
    };
    leaf(b, &inner, hinge, handle);
}

/// An upper and a lower leaf on one side.
pub(super) fn stable_door(b: &mut Builder<'_>) {
    let frame = Frame::draw(b, [0.7, 1.05]);
    let wall = if b.random.chance(0.5) { b.random.between(0.1, 0.4) } else { 0.0 };
    frame.stand(b, wall, 0.0);
    let cell = frame.cell(b);
    let lower = b.random.between(0.45, 0.6);
    let rows = cell.rows(&[lower, 1.0 - lower]);
    let hinge = b.random.pick([Edge::Left, Edge::Right]);
    let handle = room_handle(b);
    for row in rows {
        leaf(b, &row, hinge, handle);
    }
}
