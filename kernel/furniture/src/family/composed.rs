//! Fronts and openings that are composed of many fields, not all of which move: screens of glass with doors amid, shutters, panelled
//! walls, lockers, larders, kitchen fronts with blind panels, cold stores, ranges, machines, benches.
//!
//! What is fixed is made like what moves beside it, with the same gaps, so that neither size nor place says which is which.

use nalgebra::Vector3;

use super::entrance::{leaf, room_handle, window};
use crate::carcass::{Carcass, contents};
use crate::front::{Builder, Cell, Edge};
use crate::handle::Handle;
use crate::object::{Class, Kind, Solid};

/// Shares that sum to one.
pub(super) fn shares(b: &mut Builder<'_>, n: usize, least: f64, most: f64) -> Vec<f64> {
    let even = b.random.chance(0.5);
    let raw: Vec<f64> = (0..n).map(|_| if even { 1.0 } else { b.random.between(least, most) }).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|s| s / sum).collect()
}

pub(super) fn side(b: &mut Builder<'_>) -> Edge {
    b.random.pick([Edge::Left, Edge::Right])
}

/// A cell without its margins, m.
fn within(cell: &Cell, y: f64, z: f64) -> Cell {
    Cell { y: [cell.y[0] + y, cell.y[1] - y], z: [cell.z[0] + z, cell.z[1] - z], ..*cell }
}

/// How a leaf lies in an opening of depth `2 x`.
pub(super) fn set_in(b: &mut Builder<'_>, x: f64) -> f64 {
    b.style.proud = false;
    b.style.thick = b.random.between(0.022, 0.05).min(1.2 * x);
    b.style.pin = b.random.pick([0.5, 1.0, 1.0]);
    b.style.inset = b.random.between(0.0, 0.008);
    x - b.random.pick([0.0_f64, 0.004, 0.02]).min(0.6 * x)
}

/// A field of a screen that does not move: glass, or glass over something solid, in the plane of the leaves or behind it.
pub(super) fn light(b: &mut Builder<'_>, cell: &Cell) {
    let back = cell.x - b.random.pick([0.0, 0.006, 0.02, 0.04]);
    let glass = Solid::between([back - 0.008, cell.y[0], cell.z[0]], [back, cell.y[1], cell.z[1]]);
    let dark = b.random.pick([0.0, 0.0, 0.3]);
    b.body.push(glass.dark(dark));
    if b.random.chance(0.4) {
        let z = cell.z[0] + cell.height() * b.random.between(0.15, 0.5);
        b.body.push(Solid::between([back - 0.03, cell.y[0], cell.z[0]], [cell.x, cell.y[1], z]));
    }
}

/// A screen of three to five fields between posts, as of a shop: one or two leaves, the others fixed.
pub(super) fn glazed_screen(b: &mut Builder<'_>) {
    let n = 3 + b.random.index(3);
    let (width, z, x) = (n as f64 * b.random.between(0.55, 0.9), b.random.between(1.9, 2.3), b.random.between(0.025, 0.07));
    let post = b.random.between(0.03, 0.08);
    let y = width / 2.0;
    b.body.extend([
        Solid::between([-x, -y - post, 0.0], [x, -y, z + post]),
        Solid::between([-x, y, 0.0], [x, y + post, z + post]),
        Solid::between([-x, -y, z], [x, y, z + post]),
    ]);
    let face = set_in(b, x);
    let mut fields = Cell { x: face, y: [-y, y], z: [0.006, z], depth: 0.0 };
    if b.random.chance(0.4) {
        let meet = z * b.random.between(0.78, 0.88);
        b.body.push(Solid::between([-x, -y, meet - post / 2.0], [x, y, meet + post / 2.0]));
        light(b, &Cell { z: [meet + post / 2.0, z], ..fields });
        fields.z[1] = meet - post / 2.0;
    }
    let s = shares(b, n, 0.6, 1.4);
    let columns = fields.columns(&s);
    for left in &columns[1..] {
        b.body.push(Solid::between([-x, left.y[0] - post / 2.0, 0.0], [x, left.y[0] + post / 2.0, fields.z[1]]));
    }
    let first = b.random.index(n);
    let second = if b.random.chance(0.4) { b.random.index(n) } else { first };
    let handle = room_handle(b);
    for (k, field) in columns.iter().enumerate() {
        let field = within(field, post / 2.0, 0.0);
        if k == first || k == second {
            let hinge = side(b);
            leaf(b, &field, hinge, handle);
        } else {
            light(b, &field);
        }
    }
}

/// Shutters in two columns before a window, in one to three rows.
pub(super) fn shutters(b: &mut Builder<'_>) {
    let (y, z, x) = window(b);
    let face = set_in(b, x);
    b.style.pane = None;
    b.style.rails = b.random.chance(0.5).then(|| [b.random.between(0.02, 0.05), b.random.between(0.003, 0.008)]);
    let handle = if b.random.chance(0.5) { Handle::None } else { Handle::Knob { radius: 0.012, length: 0.025 } };
    let n = 1 + b.random.index(3);
    let s = shares(b, n, 0.6, 1.4);
    let upper = b.random.between(1.5, 2.8);
    for row in (Cell { x: face, y, z, depth: 0.0 }).rows(&s) {
        let halves = row.columns(&[0.5, 0.5]);
        b.hinged(&halves[0], Edge::Right, handle, upper);
        b.hinged(&halves[1], Edge::Left, handle, upper);
    }
}

/// A wall of panels of one make, one or two of which are doors.
pub(super) fn panelled_wall(b: &mut Builder<'_>) {
    let n = 2 + b.random.index(3);
    let (width, z) = (n as f64 * b.random.between(0.5, 0.95), b.random.between(1.8, 2.3));
    let (y, x) = (width / 2.0, b.random.between(0.05, 0.1));
    let above = b.random.between(0.0, 0.4);
    b.style.pane = None;
    let face = set_in(b, x);
    let thick = b.style.thick;
    // The wall that carries them, with a hole where there is a door.
    let s = shares(b, n, 0.7, 1.3);
    let fields = Cell { x: face, y: [-y, y], z: [0.004, z], depth: 0.0 }.columns(&s);
    let first = b.random.index(n);
    let second = if n > 2 && b.random.chance(0.3) { b.random.index(n) } else { first };
    let handle = room_handle(b);
    b.body.push(Solid::between([-x, -y - 0.05, z], [face, y + 0.05, z + 0.03 + above]));
    for at in [-y - 0.05, y] {
        b.body.push(Solid::between([-x, at, 0.0], [face, at + 0.05, z]));
    }
    for (k, field) in fields.iter().enumerate() {
        if k == first || k == second {
            let hinge = side(b);
            leaf(b, field, hinge, handle);
        } else {
            b.blank(field);
            b.body.push(Solid::between([-x, field.y[0], 0.0], [face - thick - 0.001, field.y[1], z]));
        }
    }
}

fn cabinet(b: &mut Builder<'_>, width: f64, depth: [f64; 2], height: f64, board: [f64; 2]) -> Carcass {
    let bottom = b.random.pick([0.0, 0.0, 0.05, 0.1, 0.14]);
    let c = Carcass {
        width,
        depth: b.random.between(depth[0], depth[1]),
        bottom,
        top: bottom + height,
        board: b.random.between(board[0], board[1]),
    };
    b.body.extend(c.boards());
    b.body.extend(c.support(b.random));
    c
}

fn front(b: &Builder<'_>, c: &Carcass) -> Cell {
    let m = if b.style.proud { 0.0 } else { c.board };
    Cell { x: c.front(), y: [-c.width / 2.0 + m, c.width / 2.0 - m], z: [c.bottom + m, c.top - m], depth: c.depth - 0.03 }
}

/// Shelves and what stands on them.
fn fill(b: &mut Builder<'_>, c: &Carcass, cell: &Cell) {
    let inside = [cell.y[0].max(-c.width / 2.0 + c.board), cell.y[1].min(c.width / 2.0 - c.board)];
    let n = b.random.index(3);
    let mut below = cell.z[0].max(c.bottom + c.board);
    for k in 1..=n {
        let z = cell.z[0] + cell.height() * k as f64 / (n as f64 + 1.0);
        let setback = b.random.between(0.03, 0.1);
        b.body.push(c.shelf(inside[0], inside[1], z, setback));
        if b.random.chance(0.4) {
            b.body.extend(contents([-c.depth / 2.0 + 0.03, inside[0], below], [c.depth / 2.0 - 0.08, inside[1], z], b.random));
        }
        below = z;
    }
}

/// A grid of small doors that all turn to one side.
pub(super) fn lockers(b: &mut Builder<'_>) {
    let (columns, rows) = (1 + b.random.index(4), 1 + b.random.index(4));
    let (width, height) = (columns as f64 * b.random.between(0.22, 0.42), rows as f64 * b.random.between(0.28, 0.6));
    let c = cabinet(b, width, [0.3, 0.55], height.max(0.4), [0.004, 0.02]);
    b.style.proud = b.random.chance(0.3);
    b.style.pane = None;
    b.style.thick = b.random.between(0.008, 0.02);
    let upper = b.random.between(1.5, 2.2);
    let hinge = side(b);
    let handle = b.style.door_handle;
    let all = front(b, &c);
    let (across, up) = (vec![1.0 / columns as f64; columns], vec![1.0 / rows as f64; rows]);
    for (k, column) in all.columns(&across).iter().enumerate() {
        if k > 0 {
            b.body.push(c.divider(column.y[0], c.bottom, c.top));
        }
        for (j, cell) in column.rows(&up).iter().enumerate() {
            if j > 0 {
                b.body.push(c.shelf(column.y[0], column.y[1], cell.z[0], 0.0));
            }
            let margin = if b.style.proud { 0.0 } else { c.board / 2.0 };
            b.hinged(&within(cell, margin, margin), hinge, handle, upper);
        }
    }
}

/// A tall cupboard whose doors stand above one another in two or three rows.
pub(super) fn larder(b: &mut Builder<'_>) {
    let width = b.random.between(0.4, 1.2);
    let height = b.random.between(1.3, 2.2);
    let c = cabinet(b, width, [0.3, 0.6], height, [0.014, 0.03]);
    let n = 2 + b.random.index(2);
    let s = shares(b, n, 0.5, 1.5);
    let hinge = side(b);
    for (k, row) in front(b, &c).rows(&s).iter().enumerate() {
        fill(b, &c, row);
        if k > 0 {
            b.body.push(c.shelf(-c.width / 2.0, c.width / 2.0, row.z[0], 0.0));
        }
        let cell = if b.style.proud { *row } else { within(row, 0.0, c.board / 2.0) };
        if width > 0.65 {
            b.double_door(&cell);
        } else {
            b.door(&cell, hinge);
        }
    }
}

/// A row of kitchen units under one worktop: doors with or without a drawer above, drawers, flaps, blind panels and fillers.
pub(super) fn kitchen_run(b: &mut Builder<'_>) {
    let n = 2 + b.random.index(3);
    let width = n as f64 * b.random.between(0.35, 0.6);
    let height = b.random.between(0.6, 0.85);
    let c = cabinet(b, width, [0.4, 0.62], height, [0.014, 0.03]);
    b.style.proud = b.random.chance(0.8);
    let over = b.random.between(0.0, 0.05);
    b.body.push(Solid::between([-c.depth / 2.0, -c.width / 2.0, c.top], [c.front() + over, c.width / 2.0, c.top + 0.04]));
    let s = shares(b, n, 0.35, 1.4);
    let cells = front(b, &c).columns(&s);
    for (k, column) in cells.iter().enumerate() {
        if k > 0 {
            b.body.push(c.divider(column.y[0], c.bottom, c.top));
        }
        let cell = if b.style.proud { *column } else { within(column, c.board / 2.0, 0.0) };
        if cell.width() < 0.22 {
            b.blank(&cell);
            continue;
        }
        let blind = b.random.chance(0.18);
        let share = b.random.between(0.7, 0.82);
        match b.random.index(6) {
            _ if blind => b.blank(&cell),
            0 | 1 => {
                let rows = cell.rows(&[share, 1.0 - share]);
                let hinge = side(b);
                b.door(&rows[0], hinge);
                // Under a sink the front of the drawer is fixed.
                if b.random.chance(0.3) { b.blank(&rows[1]) } else { b.drawer(&rows[1]) }
            }
            2 => {
                let m = 2 + b.random.index(3);
                let even = shares(b, m, 0.6, 1.6);
                cell.rows(&even).iter().for_each(|row| b.drawer(row));
            }
            3 => {
                let edge = b.random.pick([Edge::Bottom, Edge::Bottom, Edge::Top]);
                fill(b, &c, &cell);
                b.flap(&cell, edge);
            }
            _ => {
                fill(b, &c, &cell);
                if cell.width() > 0.55 {
                    b.double_door(&cell);
                } else {
                    let hinge = side(b);
                    b.door(&cell, hinge);
                }
            }
        }
    }
}

fn cold_style(b: &mut Builder<'_>) {
    b.style.proud = b.random.chance(0.8);
    b.style.thick = b.random.between(0.03, 0.08);
    b.style.pin = b.random.pick([0.0, 0.5, 0.5]);
    b.style.gap = b.random.between(0.002, 0.008);
    b.style.rails = None;
    b.style.pane = b.random.chance(0.2).then(|| [b.random.between(0.05, 0.09), b.random.between(0.003, 0.01), b.random.between(0.0, 0.4)]);
    b.style.door_handle = if b.random.chance(0.6) { Handle::stout(b.random) } else { Handle::draw(b.random, 0.4) };
    b.style.drawer_handle = b.style.door_handle;
}

/// A cold store of one to three columns, doors or drawers in each, and the machine behind a fixed panel above or below.
pub(super) fn cold_store(b: &mut Builder<'_>) {
    cold_style(b);
    let n = 1 + b.random.index(3);
    let width = n as f64 * b.random.between(0.45, 0.7);
    let height = b.random.between(0.8, 2.0);
    let c = cabinet(b, width, [0.5, 0.8], height, [0.02, 0.05]);
    let all = front(b, &c);
    let machine = b.random.between(0.1, 0.2);
    let below = b.random.chance(0.5);
    let rows = if below { all.rows(&[machine, 1.0 - machine]) } else { all.rows(&[1.0 - machine, machine]) };
    let (blind, cold) = if below { (rows[0], rows[1]) } else { (rows[1], rows[0]) };
    b.blank(&blind);
    b.body.push(c.shelf(-c.width / 2.0, c.width / 2.0, rows[1].z[0], 0.0));
    let hinge = side(b);
    let meet = b.random.between(0.35, 0.65);
    let split = height > 1.2 && b.random.chance(0.5);
    let s = shares(b, n, 0.8, 1.2);
    for (k, column) in cold.columns(&s).iter().enumerate() {
        if k > 0 {
            b.body.push(c.divider(column.y[0], c.bottom, c.top));
        }
        let hinge = match (n, k) {
            (2, 0) => Edge::Right,
            (2, _) => Edge::Left,
            _ => hinge,
        };
        if b.random.chance(0.25) {
            let m = 2 + b.random.index(2);
            column.rows(&vec![1.0 / m as f64; m]).iter().for_each(|row| b.drawer(row));
            continue;
        }
        for row in if split { column.rows(&[meet, 1.0 - meet]) } else { vec![*column] } {
            fill(b, &c, &row);
            b.door(&row, hinge);
        }
    }
}

/// A large range: ovens beside and above one another, drawers and blind panels, controls along the top.
pub(super) fn wide_range(b: &mut Builder<'_>) {
    cold_style(b);
    b.style.thick = b.random.between(0.02, 0.05);
    b.style.pane = b.random.chance(0.4).then(|| [b.random.between(0.06, 0.12), b.random.between(0.001, 0.006), b.random.between(0.0, 0.5)]);
    let n = 1 + b.random.index(3);
    let width = n as f64 * b.random.between(0.35, 0.6);
    let height = b.random.between(0.6, 0.95);
    let c = cabinet(b, width.max(0.5), [0.5, 0.65], height, [0.012, 0.03]);
    let strip = b.random.between(0.1, 0.18);
    let rows = front(b, &c).rows(&[1.0 - strip, strip]);
    b.blank(&rows[1]);
    let x = b.panel_x(&rows[1])[1];
    for k in 0..2 + b.random.index(5) {
        let at = rows[1].y[0] + rows[1].width() * (k as f64 + 0.5) / 7.0;
        let r = b.random.between(0.012, 0.022);
        b.body.push(Solid::cylinder([x + 0.01, at, (rows[1].z[0] + rows[1].z[1]) / 2.0], 0, r, 0.012));
    }
    let s = shares(b, n, 0.6, 1.4);
    for (k, column) in rows[0].columns(&s).iter().enumerate() {
        if k > 0 {
            b.body.push(c.divider(column.y[0], c.bottom, c.top));
        }
        let share = b.random.between(0.2, 0.5);
        let cells = if b.random.chance(0.5) { column.rows(&[share, 1.0 - share]) } else { vec![*column] };
        let many = cells.len();
        for (j, cell) in cells.into_iter().enumerate() {
            match b.random.index(4) {
                0 if j + 1 < many => b.drawer(&cell),
                1 if j + 1 < many => b.blank(&cell),
                2 => {
                    let hinge = side(b);
                    b.door(&cell, hinge);
                }
                _ => b.flap(&cell, Edge::Bottom),
            }
        }
    }
}

/// Washing machines, dishwashers, dryers, safes: one door in a closed case, its margins fixed.
pub(super) fn machine(b: &mut Builder<'_>) {
    cold_style(b);
    let width = b.random.scale(0.28, 0.65);
    let height = width * b.random.between(0.7, 1.5);
    let c = cabinet(b, width, [0.25, 0.6], height, [0.012, 0.04]);
    b.style.thick = b.random.between(0.012, 0.045);
    let all = Cell { x: c.front(), y: [-width / 2.0, width / 2.0], z: [c.bottom, c.top], depth: 0.0 };
    let (above, below) = match b.random.index(3) {
        0 => (b.random.between(0.08, 0.25), 0.0),
        1 => (0.0, b.random.between(0.08, 0.25)),
        _ => (0.0, 0.0),
    };
    let margin = if b.random.chance(0.5) { 0.0 } else { width * b.random.between(0.03, 0.15) };
    let rows = all.rows(&[below, 1.0 - above - below, above]);
    let door =
        within(&rows[1], margin.max(if b.style.proud { 0.0 } else { c.board }), margin.max(if b.style.proud { 0.0 } else { c.board }));
    // Proud fronts go round a proud door.
    let x = if b.style.proud { b.panel_x(&all)[1] } else { c.front() };
    for strip in [&rows[0], &rows[2]] {
        if strip.height() > 1e-6 {
            b.body.push(Solid::between([c.front() - 0.02, strip.y[0], strip.z[0]], [x, strip.y[1], strip.z[1]]));
        }
    }
    if margin > 0.0 {
        let (out, inn) = (&rows[1], &door);
        b.body.extend([
            Solid::between([c.front() - 0.02, out.y[0], out.z[0]], [x, inn.y[0], out.z[1]]),
            Solid::between([c.front() - 0.02, inn.y[1], out.z[0]], [x, out.y[1], out.z[1]]),
            Solid::between([c.front() - 0.02, inn.y[0], out.z[0]], [x, inn.y[1], inn.z[0]]),
            Solid::between([c.front() - 0.02, inn.y[0], inn.z[1]], [x, inn.y[1], out.z[1]]),
        ]);
    }
    // With controls above it a door that drops would be that of a small oven.
    let hinge = if above > 0.0 { side(b) } else { b.random.pick([Edge::Left, Edge::Right, Edge::Bottom]) };
    match hinge {
        Edge::Bottom | Edge::Top => b.flap(&door, hinge),
        _ => b.door(&door, hinge),
    }
}

/// A bench with lids beside one another and fixed boards between them.
pub(super) fn bench(b: &mut Builder<'_>) {
    let n = 1 + b.random.index(3);
    let (y, x, z) = (n as f64 * b.random.between(0.12, 0.35), b.random.between(0.12, 0.3), b.random.between(0.15, 0.5));
    let t = b.random.between(0.008, 0.025);
    b.body.extend([
        Solid::between([-x, -y, 0.0], [x, y, t]),
        Solid::between([-x, -y, 0.0], [-x + t, y, z]),
        Solid::between([x - t, -y, 0.0], [x, y, z]),
        Solid::between([-x, -y, 0.0], [x, -y + t, z]),
        Solid::between([-x, y - t, 0.0], [x, y, z]),
    ]);
    let (thick, gap) = (b.random.between(0.008, 0.03), b.random.between(0.001, 0.004));
    let (z0, z1) = (z + gap, z + gap + thick);
    let over = b.random.between(0.0, 0.015);
    let s = shares(b, n, 0.6, 1.4);
    let back = if b.random.chance(0.4) { b.random.between(0.03, 0.1) } else { 0.0 };
    if back > 0.0 {
        b.body.push(Solid::between([-x, -y, z], [-x + back, y, z1]));
    }
    let moves = b.random.index(n);
    let upper = b.random.between(1.3, 2.0);
    let cells = Cell { x: 0.0, y: [-y, y], z: [0.0, z], depth: 0.0 }.columns(&s);
    for (k, cell) in cells.into_iter().enumerate() {
        if k > 0 {
            b.body.push(Solid::between([-x, cell.y[0] - t / 2.0, 0.0], [x, cell.y[0] + t / 2.0, z]));
        }
        let board = Solid::between([-x + back, cell.y[0] + 0.002, z0], [x + over, cell.y[1] - 0.002, z1]);
        if k != moves && b.random.chance(0.4) {
            b.body.push(Solid {
                center: board.center - Vector3::z() * (gap / 2.0),
                half: board.half + Vector3::z() * (gap / 2.0),
                ..board
            });
        } else {
            let at = [-x + back, (cell.y[0] + cell.y[1]) / 2.0, z0];
            b.hang(Class::Lid, vec![board], Kind::Revolute, -Vector3::y(), at, upper);
        }
    }
}
