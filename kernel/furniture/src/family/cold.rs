//! Refrigerators.

use crate::carcass::{Carcass, contents};
use crate::front::{Builder, Cell, Edge};
use crate::handle::Handle;

fn cabinet(b: &mut Builder<'_>, width: [f64; 2], height: [f64; 2]) -> Carcass {
    let r = &mut b.random;
    let bottom = r.pick([0.0, 0.02, 0.05, 0.08]);
    let c = Carcass {
        width: r.between(width[0], width[1]),
        depth: r.between(0.5, 0.75),
        bottom,
        top: bottom + r.between(height[0], height[1]),
        board: r.between(0.03, 0.06),
    };
    b.style.proud = b.random.chance(0.92);
    b.style.thick = b.random.between(0.03, 0.09);
    b.style.pin = b.random.pick([0.0, 0.5, 0.5]);
    b.style.inset = b.random.between(0.0, 0.03);
    b.style.gap = b.random.between(0.002, 0.008);
    b.style.rails = None;
    b.style.pane = None;
    b.style.height = b.random.pick([0.5, 0.35, 0.65]);
    b.style.door_handle = match b.random.index(5) {
        0..=2 => Handle::Bar {
            share: b.random.between(0.15, 0.85),
            radius: b.random.between(0.008, 0.018),
            off: b.random.between(0.03, 0.065),
            round: b.random.chance(0.5),
        },
        3 => Handle::Notch { share: b.random.between(0.15, 1.0), wide: b.random.between(0.02, 0.04) },
        _ => Handle::None,
    };
    b.style.drawer_handle = match b.style.door_handle {
        Handle::Bar { radius, off, round, .. } => Handle::Bar { share: b.random.between(0.4, 0.9), radius, off, round },
        other => other,
    };
    b.body.extend(c.boards());
    b.body.extend(c.support(b.random));
    c
}

fn front(b: &Builder<'_>, c: &Carcass) -> Cell {
    let m = if b.style.proud { 0.0 } else { c.board };
    Cell { x: c.front(), y: [-c.width / 2.0 + m, c.width / 2.0 - m], z: [c.bottom + m, c.top - m], depth: 0.85 * c.depth }
}

/// Shelves and food behind a door.
fn fill(b: &mut Builder<'_>, c: &Carcass, cell: &Cell) {
    let (y0, y1) = ((cell.y[0]).max(-c.width / 2.0 + c.board), cell.y[1].min(c.width / 2.0 - c.board));
    let n = 1 + b.random.index(4);
    let thin = Carcass { board: 0.008, ..*c };
    let mut below = cell.z[0].max(c.bottom + c.board);
    for k in 1..=n {
        let z = cell.z[0] + cell.height() * k as f64 / (n as f64 + 1.0);
        let setback = b.random.between(0.05, 0.15);
        b.body.push(thin.shelf(y0, y1, z, setback));
        if b.random.chance(0.5) {
            b.body.extend(contents([-c.depth / 2.0 + 0.05, y0, below], [c.depth / 2.0 - 0.12, y1, z], b.random));
        }
        below = z;
    }
}

fn doors(b: &mut Builder<'_>, c: &Carcass, cells: &[(Cell, Edge)]) {
    for (cell, hinge) in cells {
        fill(b, c, cell);
        b.door(cell, *hinge);
    }
}

fn side(b: &mut Builder<'_>) -> Edge {
    b.random.pick([Edge::Left, Edge::Right])
}

pub(super) fn one_door(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.45, 0.75], [0.5, 1.8]);
    let cell = front(b, &c);
    let hinge = side(b);
    doors(b, &c, &[(cell, hinge)]);
}

fn stacked(b: &mut Builder<'_>, lower: f64) {
    let c = cabinet(b, [0.5, 0.8], [1.2, 1.9]);
    let rows = front(b, &c).rows(&[lower, 1.0 - lower]);
    b.body.push(c.shelf(-c.width / 2.0, c.width / 2.0, rows[0].z[1], 0.0));
    let hinge = side(b);
    doors(b, &c, &[(rows[0], hinge), (rows[1], hinge)]);
}

pub(super) fn freezer_on_top(b: &mut Builder<'_>) {
    let lower = b.random.between(0.6, 0.75);
    stacked(b, lower);
}

pub(super) fn freezer_below(b: &mut Builder<'_>) {
    if b.random.chance(0.5) {
        let lower = b.random.between(0.3, 0.45);
        return stacked(b, lower);
    }
    let c = cabinet(b, [0.6, 0.85], [1.5, 1.9]);
    let share = b.random.between(0.25, 0.38);
    let rows = front(b, &c).rows(&[share, 1.0 - share]);
    b.body.push(c.shelf(-c.width / 2.0, c.width / 2.0, rows[0].z[1], 0.0));
    b.drawer(&rows[0]);
    let hinge = side(b);
    doors(b, &c, &[(rows[1], hinge)]);
}

fn halves(b: &mut Builder<'_>, c: &Carcass, cell: &Cell) {
    let share = b.random.pick([0.5, 0.5, 0.6]);
    let columns = cell.columns(&[share, 1.0 - share]);
    doors(b, c, &[(columns[0], Edge::Right), (columns[1], Edge::Left)]);
}

pub(super) fn side_by_side(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.8, 1.0], [1.6, 1.9]);
    b.body.push(c.divider(0.0, c.bottom, c.top));
    let cell = front(b, &c);
    halves(b, &c, &cell);
}

pub(super) fn french_doors(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.75, 1.0], [1.6, 1.9]);
    let share = b.random.between(0.28, 0.4);
    let rows = front(b, &c).rows(&[share, 1.0 - share]);
    b.body.push(c.shelf(-c.width / 2.0, c.width / 2.0, rows[0].z[1], 0.0));
    if b.random.chance(0.3) {
        for row in rows[0].rows(&[0.5, 0.5]) {
            b.drawer(&row);
        }
    } else {
        b.drawer(&rows[0]);
    }
    halves(b, &c, &rows[1]);
}

/// Rows of anything: a door, two doors, a drawer.
pub(super) fn any_rows(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.5, 1.0], [0.8, 1.9]);
    let n = 1 + b.random.index(3);
    let raw: Vec<f64> = (0..n).map(|_| b.random.between(0.5, 1.8)).collect();
    let sum: f64 = raw.iter().sum();
    let hinge = side(b);
    for cell in front(b, &c).rows(&raw.iter().map(|s| s / sum).collect::<Vec<_>>()) {
        b.body.push(c.shelf(-c.width / 2.0, c.width / 2.0, cell.z[1] - c.board / 2.0, 0.0));
        match b.random.index(4) {
            0 if cell.height() < 0.7 => b.drawer(&cell),
            1 if cell.width() > 0.6 => halves(b, &c, &cell),
            _ => doors(b, &c, &[(cell, hinge)]),
        }
    }
}

pub(super) fn four_doors(b: &mut Builder<'_>) {
    let c = cabinet(b, [0.8, 1.0], [1.65, 1.95]);
    let share = b.random.between(0.35, 0.5);
    let rows = front(b, &c).rows(&[share, 1.0 - share]);
    b.body.push(c.shelf(-c.width / 2.0, c.width / 2.0, rows[0].z[1], 0.0));
    b.body.push(c.divider(0.0, c.bottom, c.top));
    for row in &rows {
        halves(b, &c, row);
    }
}
