//! Cupboards, chests of drawers, wardrobes, desks.

use nalgebra::Vector3;

use crate::carcass::{Carcass, contents};
use crate::front::{Builder, Cell, Edge};
use crate::handle::{Handle, Seat, solids};
use crate::object::{Class, Kind, Solid};

fn cabinet(b: &mut Builder<'_>, width: [f64; 2], depth: [f64; 2], height: [f64; 2], legs: bool) -> Carcass {
    let r = &mut b.random;
    let bottom = if legs { r.between(0.06, 0.22) } else { r.pick([0.0, 0.0, 0.04, 0.08, 0.15]) };
    let c = Carcass {
        width: r.between(width[0], width[1]),
        depth: r.between(depth[0], depth[1]),
        bottom,
        top: bottom + r.between(height[0], height[1]),
        board: r.between(0.012, 0.028),
    };
    b.body.extend(c.boards());
    b.body.extend(c.support(b.random));
    if b.random.chance(0.25) {
        let over = b.random.between(0.005, 0.03);
        let (x, y) = (c.depth / 2.0, c.width / 2.0);
        b.body.push(Solid::between([-x, -y - over, c.top], [x + over + b.style.thick, y + over, c.top + 0.02]));
    }
    c
}

/// The front's free rectangle: the whole of it for proud panels, what the boards leave otherwise.
fn front(b: &Builder<'_>, c: &Carcass) -> Cell {
    let m = if b.style.proud { 0.0 } else { c.board };
    Cell { x: c.front(), y: [-c.width / 2.0 + m, c.width / 2.0 - m], z: [c.bottom + m, c.top - m], depth: c.depth - 0.03 }
}

/// Shares that sum to one, equal or not.
fn shares(b: &mut Builder<'_>, n: usize) -> Vec<f64> {
    let even = b.random.chance(0.6);
    let raw: Vec<f64> = (0..n).map(|_| if even { 1.0 } else { b.random.between(0.6, 1.6) }).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|s| s / sum).collect()
}

/// Rows of a front with boards between them.
fn rows(b: &mut Builder<'_>, c: &Carcass, cell: &Cell, shares: &[f64], boards: bool) -> Vec<Cell> {
    let cells = cell.rows(shares);
    if boards {
        for lower in &cells[..cells.len() - 1] {
            b.body.push(c.shelf(cell.y[0], cell.y[1], lower.z[1], 0.0));
        }
    }
    fit(b, c, cells, true)
}

/// Columns of a front with boards between them.
fn columns(b: &mut Builder<'_>, c: &Carcass, cell: &Cell, shares: &[f64]) -> Vec<Cell> {
    let cells = cell.columns(shares);
    for right in &cells[..cells.len() - 1] {
        b.body.push(c.divider(right.y[1], cell.z[0], cell.z[1]));
    }
    fit(b, c, cells, false)
}

/// Panels between boards end where those begin.
fn fit(b: &Builder<'_>, c: &Carcass, mut cells: Vec<Cell>, level: bool) -> Vec<Cell> {
    if !b.style.proud {
        let last = cells.len() - 1;
        for (i, cell) in cells.iter_mut().enumerate() {
            let ends = if level { &mut cell.z } else { &mut cell.y };
            ends[0] += if i > 0 { c.board / 2.0 } else { 0.0 };
            ends[1] -= if i < last { c.board / 2.0 } else { 0.0 };
        }
    }
    cells
}

/// Shelves behind doors.
fn fill(b: &mut Builder<'_>, c: &Carcass, cell: &Cell) {
    let mut below = cell.z[0].max(c.bottom + c.board);
    let n = b.random.index(4);
    let (y0, y1) = (cell.y[0].max(-c.width / 2.0 + c.board), cell.y[1].min(c.width / 2.0 - c.board));
    for k in 1..=n + 1 {
        let z = cell.z[0] + cell.height() * k as f64 / (n as f64 + 1.0);
        if k <= n {
            let setback = b.random.between(0.03, 0.1);
            b.body.push(c.shelf(y0, y1, z, setback));
        }
        if b.random.chance(0.4) {
            b.body.extend(contents([-c.depth / 2.0 + 0.03, y0, below], [c.depth / 2.0 - 0.06, y1, z], b.random));
        }
        below = z;
    }
}

/// What a place in a front becomes.
#[derive(Clone, Copy, PartialEq)]
enum Use {
    Doors,
    Drawers,
    FlapDown,
    FlapUp,
    Open,
}

fn furnish(b: &mut Builder<'_>, c: &Carcass, cell: &Cell, kind: Use) {
    match kind {
        Use::Doors => {
            fill(b, c, cell);
            if cell.width() > 0.62 || (cell.width() > 0.45 && b.random.chance(0.3)) {
                b.double_door(cell);
            } else {
                let hinge = b.random.pick([Edge::Left, Edge::Right]);
                b.door(cell, hinge);
            }
        }
        Use::Drawers => {
            let n = ((cell.height() / b.random.between(0.14, 0.3)).round() as usize).clamp(1, 6);
            let s = shares(b, n);
            for row in rows(b, c, cell, &s, !b.style.proud) {
                b.drawer(&row);
            }
        }
        Use::FlapDown => {
            fill(b, c, cell);
            b.flap(cell, Edge::Bottom);
        }
        Use::FlapUp => {
            fill(b, c, cell);
            b.flap(cell, Edge::Top);
        }
        Use::Open => fill(b, c, cell),
    }
}

pub(super) fn chest_of_drawers(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.35, 1.1], [0.35, 0.55], [0.5, 1.2], false);
    let cell = front(b, &c);
    if c.width > 0.75 && b.random.chance(0.6) {
        for column in columns(b, &c, &cell, &[0.5, 0.5]) {
            furnish(b, &c, &column, Use::Drawers);
        }
    } else {
        furnish(b, &c, &cell, Use::Drawers);
    }
}

pub(super) fn wardrobe(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.5, 1.3], [0.4, 0.6], [1.3, 2.1], false);
    let cell = front(b, &c);
    if b.random.chance(0.5) {
        furnish(b, &c, &cell, Use::Doors);
    } else {
        let s = b.random.between(0.2, 0.35);
        let parts = rows(b, &c, &cell, &[s, 1.0 - s], true);
        furnish(b, &c, &parts[0], Use::Drawers);
        furnish(b, &c, &parts[1], Use::Doors);
    }
}

pub(super) fn mixed_grid(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.7, 1.6], [0.35, 0.5], [0.6, 1.3], false);
    let cell = front(b, &c);
    let n = 2 + b.random.index(2);
    let s = shares(b, n);
    for column in columns(b, &c, &cell, &s) {
        if b.random.chance(0.5) {
            let cut = b.random.between(0.35, 0.7);
            for part in rows(b, &c, &column, &[cut, 1.0 - cut], true) {
                let kind = b.random.pick([Use::Doors, Use::Drawers, Use::Open, Use::FlapDown, Use::Doors]);
                furnish(b, &c, &part, kind);
            }
        } else {
            let kind = b.random.pick([Use::Doors, Use::Drawers, Use::Doors]);
            furnish(b, &c, &column, kind);
        }
    }
}

pub(super) fn wall_cabinet(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.4, 1.1], [0.28, 0.4], [0.35, 0.8], false);
    let cell = front(b, &c);
    let kind = b.random.pick([Use::Doors, Use::FlapUp, Use::Doors, Use::FlapUp]);
    if c.width > 0.8 {
        for column in columns(b, &c, &cell, &[0.5, 0.5]) {
            furnish(b, &c, &column, kind);
        }
    } else {
        furnish(b, &c, &cell, kind);
    }
}

pub(super) fn desk(b: &mut Builder<'_>) {
    let width = b.random.between(1.0, 1.5);
    let (depth, height) = (b.random.between(0.5, 0.7), b.random.between(0.68, 0.76));
    let (x, y) = (depth / 2.0, width / 2.0);
    b.body.push(Solid::between([-x, -y, height], [x + 0.02, y, height + 0.03]));
    let both = b.random.chance(0.4);
    for side in [-1.0, 1.0] {
        if side < 0.0 || both {
            let w = b.random.between(0.3, 0.42);
            let bottom = b.random.pick([0.0, 0.05, 0.1]);
            let c = Carcass { width: w, depth, bottom, top: height, board: b.random.between(0.012, 0.02) };
            let shift = side * (y - w / 2.0);
            let mut boards = c.boards();
            for s in &mut boards {
                s.center.y += shift;
            }
            b.body.extend(boards);
            let m = if b.style.proud { 0.0 } else { c.board };
            let cell = Cell { x, y: [shift - w / 2.0 + m, shift + w / 2.0 - m], z: [bottom + m, height - m], depth: depth - 0.03 };
            if b.random.chance(0.3) {
                let hinge = b.random.pick([Edge::Left, Edge::Right]);
                b.door(&cell, hinge);
            } else {
                let n = 2 + b.random.index(3);
                let s = shares(b, n);
                for row in cell.rows(&s) {
                    b.drawer(&row);
                }
            }
        } else {
            b.body.push(Solid::between([-x, y - 0.03, 0.0], [x, y, height]));
        }
    }
    if b.random.chance(0.4) {
        b.body.push(Solid::between([-x, -y, height * 0.5], [-x + 0.015, y, height]));
    }
}

pub(super) fn open_shelves(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.6, 1.2], [0.25, 0.45], [0.8, 1.9], false);
    let cell = front(b, &c);
    let s = b.random.between(0.25, 0.45);
    let parts = rows(b, &c, &cell, &[s, 1.0 - s], true);
    let kind = b.random.pick([Use::Doors, Use::Drawers]);
    furnish(b, &c, &parts[0], kind);
    furnish(b, &c, &parts[1], Use::Open);
}

/// Rows of anything, on legs or not.
pub(super) fn tall_unit(b: &mut Builder<'_>) {
    let legs = b.random.chance(0.5);
    let c = cabinet(b, [0.35, 1.4], [0.25, 0.55], [0.5, 1.8], legs);
    let cell = front(b, &c);
    let n = 1 + b.random.index(4);
    let s = shares(b, n);
    for row in rows(b, &c, &cell, &s, true) {
        let kind = b.random.pick([Use::Doors, Use::Drawers, Use::FlapDown, Use::FlapUp, Use::Open]);
        furnish(b, &c, &row, kind);
    }
}

/// Doors that slide past one another, or one that slides before what is shut for good.
pub(super) fn sliding_fronts(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.6, 1.6], [0.3, 0.6], [0.35, 2.0], false);
    let m = c.board;
    let (y, z) = ([-c.width / 2.0 + m, c.width / 2.0 - m], [c.bottom + m, c.top - m]);
    let meet = c.width * b.random.between(-0.12, 0.12);
    let thick = b.style.thick;
    let before = b.random.chance(0.4);
    // Before the carcass, or in two grooves between its boards.
    let near = if before { c.front() + 0.004 + thick } else { c.front() - 0.004 };
    let far = near - thick - 0.006;
    let left = b.random.chance(0.5);
    let both = !before && b.random.chance(0.6);
    let cell = Cell { x: c.front(), y, z, depth: 0.0 };
    fill(b, &c, &cell);
    for (side, face) in [(left, near), (!left, far)] {
        let own = if side { [meet - 0.02, y[1] - 0.002] } else { [y[0] + 0.002, meet + 0.02] };
        if face < near && !both {
            match b.random.index(3) {
                0 => b.body.push(Solid::between([-c.depth / 2.0, own[0], z[0]], [c.front(), own[1], z[1]])),
                1 => b.body.push(Solid::between([far - thick, own[0], z[0]], [far.min(c.front()), own[1], z[1]])),
                _ => {}
            }
            continue;
        }
        let mut all = vec![Solid::between([face - thick, own[0], z[0] + 0.002], [face, own[1], z[1] - 0.002])];
        let w = own[1] - own[0];
        let at = [if side { own[1] - 0.12 * w } else { own[0] + 0.12 * w }, (z[0] + z[1]) / 2.0];
        let at = if b.random.chance(0.3) { [(own[0] + own[1]) / 2.0, at[1]] } else { at };
        let handle = b.style.door_handle;
        all.extend(solids(handle, &Seat { x: face, at, upright: true, edge: z[1] - z[0], toward: 1.0 }));
        let toward = if side { -1.0 } else { 1.0 };
        let upper = w * b.random.between(0.7, 0.97);
        b.hang(Class::Door, all, Kind::Prismatic, Vector3::y() * toward, [face, (own[0] + own[1]) / 2.0, (z[0] + z[1]) / 2.0], upper);
    }
}

/// A few drawers in stout boards, as wide as a letter tray or a workbench; part of it may stay open.
pub(super) fn stout_drawers(b: &mut Builder<'_>) {
    b.style.drawer_handle = if b.random.chance(0.6) { Handle::stout(b.random) } else { b.style.drawer_handle };
    b.style.proud = b.random.chance(0.35);
    let width = b.random.scale(0.18, 0.9);
    let (depth, height) = (width * b.random.between(0.5, 1.3), width * b.random.between(0.3, 1.1));
    let board = (width * b.random.between(0.03, 0.12)).clamp(0.008, 0.05);
    let c = Carcass { width, depth, bottom: 0.0, top: height, board };
    b.style.thick = b.random.between(0.6, 1.3) * board.max(0.012);
    b.body.extend(c.boards());
    let cell = Cell { depth: depth - board, ..front(b, &c) };
    let part = match b.random.index(4) {
        0 => {
            let share = b.random.between(0.25, 0.75);
            let boards = b.random.chance(0.7);
            let both = rows(b, &c, &cell, &[share, 1.0 - share], boards);
            both[b.random.index(2)]
        }
        _ => cell,
    };
    let n = 1 + b.random.index(((part.height() / (0.2 * width)) as usize).clamp(1, 3));
    let even = vec![1.0 / n as f64; n];
    let boards = !b.style.proud && b.random.chance(0.7);
    for row in rows(b, &c, &part, &even, boards) {
        let columns = if row.width() > 2.0 * row.height() && b.random.chance(0.25) { row.columns(&[0.5, 0.5]) } else { vec![row] };
        for place in columns {
            b.stout_drawer(&place);
        }
    }
}

/// A stout panel that slides sideways before a case: half of the case is open, or both halves are, or the other is a solid block.
pub(super) fn panel_before_case(b: &mut Builder<'_>) {
    let width = b.random.scale(0.4, 1.6);
    let (depth, height) = (b.random.between(0.25, 0.65), width * b.random.between(0.3, 1.2));
    let board = b.random.between(0.012, 0.05);
    let c = Carcass { width, depth, bottom: b.random.pick([0.0, 0.0, 0.1]), top: height, board };
    b.body.extend(c.boards());
    b.body.extend(c.support(b.random));
    let (x, y) = (depth / 2.0, width / 2.0);
    let left = b.random.chance(0.5);
    let share = b.random.between(0.35, 0.6) * width;
    let own = if left { [y - share, y] } else { [-y, share - y] };
    let rest = if left { [-y, y - share] } else { [share - y, y] };
    match b.random.index(3) {
        0 => b.body.push(Solid::between([-x, rest[0], c.bottom], [x, rest[1], c.top])),
        1 => b.body.push(Solid::between([x - board, rest[0], c.bottom], [x, rest[1], c.top])),
        _ => {}
    }
    if b.random.chance(0.5) {
        b.body.push(c.divider(if left { own[0] } else { own[1] }, c.bottom, c.top));
    }
    let inside = Cell { x, y: own, z: [c.bottom + board, c.top - board], depth: 0.0 };
    fill(b, &c, &inside);
    let thick = b.random.between(0.012, 0.065);
    let gap = b.random.between(0.001, 0.02);
    let (over, face) = (b.random.between(-0.03, 0.01), x + gap + thick);
    let z = [c.bottom - over.min(c.bottom), c.top + over];
    let mut all = vec![Solid::between([x + gap, own[0], z[0]], [face, own[1], z[1]])];
    let handle = if b.random.chance(0.6) { Handle::stout(b.random) } else { b.style.door_handle };
    let inward = share * b.random.between(0.08, 0.5);
    let side = if b.random.chance(0.7) == left { own[1] - inward } else { own[0] + inward };
    all.extend(solids(handle, &Seat { x: face, at: [side, (z[0] + z[1]) / 2.0], upright: true, edge: z[1] - z[0], toward: 1.0 }));
    let upper = (width - share).min(share) * b.random.between(0.7, 1.0);
    let toward = if left { -1.0 } else { 1.0 };
    b.hang(Class::Door, all, Kind::Prismatic, Vector3::y() * toward, [face, (own[0] + own[1]) / 2.0, (z[0] + z[1]) / 2.0], upper);
}

pub(super) fn sideboard(b: &mut Builder<'_>) {
    let c = cabinet(b, [1.1, 1.8], [0.35, 0.5], [0.45, 0.8], true);
    let cell = front(b, &c);
    let middle = b.random.between(0.28, 0.4);
    let side = (1.0 - middle) / 2.0;
    let parts = columns(b, &c, &cell, &[side, middle, side]);
    let swap = b.random.chance(0.3);
    for (i, part) in parts.iter().enumerate() {
        let kind = if (i == 1) != swap { Use::Drawers } else { Use::Doors };
        furnish(b, &c, part, kind);
    }
}

pub(super) fn nightstand(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.35, 0.6], [0.3, 0.45], [0.4, 0.65], true);
    let cell = front(b, &c);
    let s = b.random.between(0.55, 0.7);
    let parts = rows(b, &c, &cell, &[s, 1.0 - s], true);
    b.drawer(&parts[1]);
    let kind = b.random.pick([Use::Doors, Use::Open, Use::Drawers]);
    furnish(b, &c, &parts[0], kind);
}

pub(super) fn shoe_cabinet(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.5, 0.9], [0.18, 0.3], [0.7, 1.3], false);
    let cell = front(b, &c);
    let n = 2 + b.random.index(2);
    let s = vec![1.0 / n as f64; n];
    for row in rows(b, &c, &cell, &s, false) {
        b.flap(&row, Edge::Bottom);
    }
}
