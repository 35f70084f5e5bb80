//! Microwave ovens, ovens and cookers.

use crate::carcass::{Carcass, contents};
use crate::front::{Builder, Cell, Edge};
use crate::handle::Handle;
use crate::object::Solid;

/// A case with a cavity behind part of its front; the rest is filled.
struct Case {
    c: Carcass,
}

impl Case {
    /// A case of this size whose hollow lies between `y` and `z`.
    fn stand(b: &mut Builder<'_>, c: Carcass, hollows: &[Cell]) -> Self {
        let (x, w) = (c.depth / 2.0, c.width / 2.0);
        let back = -x + 0.25 * c.depth * b.random.unit() + 0.02;
        b.body.push(Solid::between([-x, -w, c.bottom], [back, w, c.top]));
        b.body.extend(c.boards());
        // What is not hollow is filled to the front.
        let mut zs = vec![c.bottom, c.top];
        for h in hollows {
            zs.extend(h.z);
        }
        zs.sort_by(f64::total_cmp);
        for pair in zs.windows(2) {
            let (z0, z1) = (pair[0], pair[1]);
            if z1 - z0 < 1e-6 {
                continue;
            }
            let mid = (z0 + z1) / 2.0;
            let mut y = -w;
            let mut here: Vec<&Cell> = hollows.iter().filter(|h| h.z[0] < mid && mid < h.z[1]).collect();
            here.sort_by(|a, b| a.y[0].total_cmp(&b.y[0]));
            for h in here {
                if h.y[0] - y > 1e-6 {
                    b.body.push(Solid::between([-x, y, z0], [x, h.y[0], z1]));
                }
                y = h.y[1];
            }
            if w - y > 1e-6 {
                b.body.push(Solid::between([-x, y, z0], [x, w, z1]));
            }
        }
        for h in hollows {
            if h.height() > 0.25 && b.random.chance(0.7) {
                for k in 1..=b.random.index(3) {
                    let z = h.z[0] + h.height() * k as f64 / 3.0;
                    b.body.push(Solid::between([back, h.y[0], z], [x - 0.04, h.y[1], z + 0.006]));
                }
            }
            if b.random.chance(0.4) {
                b.body.extend(contents([back, h.y[0], h.z[0]], [x - 0.05, h.y[1], h.z[1]], b.random));
            }
        }
        b.body.extend(c.support(b.random));
        Self { c }
    }
}

/// Half a wall inside a door's outline.
fn hollow(cell: &Cell, wall: f64) -> Cell {
    Cell { y: [cell.y[0] + wall, cell.y[1] - wall], z: [cell.z[0] + wall, cell.z[1] - wall], ..*cell }
}

/// Buttons and knobs on a face.
fn controls(b: &mut Builder<'_>, x: f64, y: [f64; 2], z: [f64; 2], knobs: bool) {
    let (w, h) = (y[1] - y[0], z[1] - z[0]);
    let n = 1 + b.random.index(5);
    let r = if knobs { b.random.between(0.012, 0.026).min(0.4 * w.min(h)) } else { b.random.between(0.004, 0.01).min(0.3 * w.min(h)) };
    let deep = if knobs { b.random.between(0.012, 0.03) } else { 0.003 };
    for i in 0..n {
        let s = (i as f64 + 0.5) / n as f64;
        let at = if w > h { [y[0] + s * w, (z[0] + z[1]) / 2.0] } else { [(y[0] + y[1]) / 2.0, z[0] + s * h] };
        b.body.push(Solid::cylinder([x + deep / 2.0, at[0], at[1]], 0, r, deep / 2.0));
    }
}

fn microwave(b: &mut Builder<'_>) -> Carcass {
    let r = &mut b.random;
    let bottom = r.pick([0.0, 0.012, 0.02]);
    let c = Carcass {
        width: r.between(0.42, 0.62),
        depth: r.between(0.3, 0.48),
        bottom,
        top: bottom + r.between(0.24, 0.36),
        board: r.between(0.008, 0.02),
    };
    b.style.thick = b.random.between(0.015, 0.04);
    b.style.rails = None;
    b.style.pane = b.random.chance(0.6).then(|| [b.random.between(0.03, 0.06), b.random.between(0.001, 0.006), b.random.between(0.0, 0.5)]);
    b.style.height = 0.5;
    b.style.door_handle = match b.random.index(4) {
        0 | 1 => Handle::stout(b.random),
        2 => Handle::None,
        _ => Handle::draw(b.random, 0.0),
    };
    c
}

fn whole(c: &Carcass) -> Cell {
    Cell { x: c.front(), y: [-c.width / 2.0, c.width / 2.0], z: [c.bottom, c.top], depth: c.depth }
}

/// A control panel on one side of the face, standing as far out as the door but for a share of how far that stands out.
fn beside(b: &mut Builder<'_>, knobs: bool, back: f64) {
    let c = microwave(b);
    let share = b.random.between(0.18, 0.3);
    let right = b.random.chance(0.85);
    let front = whole(&c);
    let columns = if right { front.columns(&[share, 1.0 - share]) } else { front.columns(&[1.0 - share, share]) };
    let (panel, door) = if right { (columns[0], columns[1]) } else { (columns[1], columns[0]) };
    let margin = if b.style.proud { 0.0 } else { b.random.between(0.006, 0.02) };
    let door = Cell { y: [door.y[0] + margin, door.y[1] - margin], z: [door.z[0] + margin, door.z[1] - margin], ..door };
    let hollow = hollow(&door, b.style.thick.min(0.03));
    Case::stand(b, c, &[if b.style.proud { hollow } else { door }]);
    let x = c.front() + (1.0 - back) * (b.panel_x(&front)[1] - c.front());
    if b.style.proud && back < 1.0 {
        b.body.push(Solid::between([c.front(), panel.y[0], panel.z[0]], [x - b.random.pick([0.0, 0.0, 0.005]), panel.y[1], panel.z[1]]));
    }
    controls(b, x, panel.y, panel.z, knobs);
    b.door(&door, if right { Edge::Left } else { Edge::Right });
}

pub(super) fn side_door_with_panel(b: &mut Builder<'_>) {
    let knobs = b.random.chance(0.3);
    beside(b, knobs, 0.0);
}

/// The door alone stands before the case, or farther than the panel does.
pub(super) fn panel_set_back(b: &mut Builder<'_>) {
    b.style.proud = true;
    let knobs = b.random.chance(0.3);
    let back = if b.random.chance(0.6) { 1.0 } else { b.random.between(0.2, 0.9) };
    beside(b, knobs, back);
}

/// Two large knobs beside the door, and feet.
pub(super) fn knobs_beside(b: &mut Builder<'_>) {
    b.style.proud = true;
    beside(b, true, 0.0);
}

pub(super) fn full_width_door(b: &mut Builder<'_>) {
    let c = microwave(b);
    b.style.proud = true;
    b.style.door_handle = Handle::stout(b.random);
    let front = whole(&c);
    Case::stand(b, c, &[hollow(&front, b.style.thick.min(0.03))]);
    let edge = b.random.pick([Edge::Left, Edge::Left, Edge::Right]);
    b.door(&front, edge);
}

/// Door over a strip of controls.
fn over_strip(b: &mut Builder<'_>, hinge: Edge, strip_on_top: bool) {
    let c = microwave(b);
    b.style.proud = true;
    let front = whole(&c);
    let share = b.random.between(0.14, 0.24);
    let rows = if strip_on_top { front.rows(&[1.0 - share, share]) } else { front.rows(&[share, 1.0 - share]) };
    let (strip, door) = if strip_on_top { (rows[1], rows[0]) } else { (rows[0], rows[1]) };
    Case::stand(b, c, &[hollow(&door, b.style.thick.min(0.03))]);
    let x = b.panel_x(&front)[1];
    b.body.push(Solid::between([c.front(), strip.y[0], strip.z[0]], [x, strip.y[1], strip.z[1]]));
    let knobs = b.random.chance(0.4);
    controls(b, x, strip.y, strip.z, knobs);
    match hinge {
        Edge::Left | Edge::Right => b.door(&door, hinge),
        _ => b.flap(&door, hinge),
    }
}

pub(super) fn panel_below(b: &mut Builder<'_>) {
    let edge = b.random.pick([Edge::Left, Edge::Left, Edge::Right]);
    let on_top = b.random.chance(0.3);
    over_strip(b, edge, on_top);
}

pub(super) fn drop_door(b: &mut Builder<'_>) {
    b.style.door_handle = Handle::stout(b.random);
    over_strip(b, Edge::Bottom, true);
}

fn oven(b: &mut Builder<'_>, height: [f64; 2]) -> Carcass {
    let r = &mut b.random;
    let bottom = r.pick([0.0, 0.0, 0.05, 0.1]);
    let c = Carcass {
        width: r.between(0.5, 0.8),
        depth: r.between(0.45, 0.65),
        bottom,
        top: bottom + r.between(height[0], height[1]),
        board: r.between(0.01, 0.03),
    };
    b.style.proud = b.random.chance(0.8);
    b.style.thick = b.random.between(0.025, 0.06);
    b.style.pin = b.random.pick([0.0, 0.5]);
    b.style.inset = b.random.between(0.0, 0.02);
    b.style.rails = None;
    b.style.pane = b.random.chance(0.6).then(|| [b.random.between(0.06, 0.12), b.random.between(0.001, 0.006), b.random.between(0.0, 0.5)]);
    b.style.door_handle = if b.random.chance(0.9) { Handle::stout(b.random) } else { Handle::None };
    b.style.drawer_handle = if b.random.chance(0.5) { Handle::stout(b.random) } else { Handle::draw(b.random, 0.5) };
    c
}

/// Rows of an oven's front from below, each by what it is.
#[derive(Clone, Copy, PartialEq)]
enum Row {
    Door,
    Drawer,
    Controls,
    Blank,
}

fn rows(b: &mut Builder<'_>, c: Carcass, kinds: &[Row], shares: &[f64], hinge: Edge) {
    let mut front = whole(&c);
    if !b.style.proud {
        let m = c.board;
        front = Cell { y: [front.y[0] + m, front.y[1] - m], z: [front.z[0] + m, front.z[1] - m], ..front };
    }
    let cells = front.rows(shares);
    let wall = b.style.thick.min(0.04);
    let hollows: Vec<Cell> = cells
        .iter()
        .zip(kinds)
        .filter(|(_, k)| matches!(k, Row::Door | Row::Drawer))
        .map(|(cell, _)| if b.style.proud { hollow(cell, wall) } else { *cell })
        .collect();
    let case = Case::stand(b, c, &hollows);
    let x = b.panel_x(&front)[1];
    for (cell, kind) in cells.iter().zip(kinds) {
        match kind {
            Row::Door => match hinge {
                Edge::Left | Edge::Right => b.door(cell, hinge),
                _ => b.flap(cell, hinge),
            },
            Row::Drawer => b.drawer(&Cell { depth: 0.85 * case.c.depth, ..*cell }),
            Row::Controls => {
                if b.style.proud {
                    b.body.push(Solid::between([c.front(), cell.y[0], cell.z[0]], [x, cell.y[1], cell.z[1]]));
                }
                let knobs = b.random.chance(0.7);
                controls(b, x, cell.y, cell.z, knobs);
            }
            Row::Blank => b.blank(cell),
        }
    }
}

fn cooktop(b: &mut Builder<'_>, c: &Carcass) {
    if b.random.chance(0.7) {
        for (sx, sy) in [(-0.22, -0.25), (-0.22, 0.25), (0.22, -0.25), (0.22, 0.25)] {
            let r = b.random.between(0.06, 0.1);
            let h = b.random.between(0.002, 0.012);
            b.body.push(Solid::cylinder([sx * c.depth, sy * c.width, c.top + h], 2, r, h));
        }
    }
}

pub(super) fn built_in_oven(b: &mut Builder<'_>) {
    let c = oven(b, [0.42, 0.65]);
    let s = b.random.between(0.12, 0.25);
    rows(b, c, &[Row::Door, Row::Controls], &[1.0 - s, s], Edge::Bottom);
}

pub(super) fn cooker_with_drawer(b: &mut Builder<'_>) {
    let c = oven(b, [0.8, 0.92]);
    let (d, s) = (b.random.between(0.16, 0.28), b.random.between(0.1, 0.16));
    rows(b, c, &[Row::Drawer, Row::Door, Row::Controls], &[d, 1.0 - d - s, s], Edge::Bottom);
    cooktop(b, &c);
}

pub(super) fn double_oven(b: &mut Builder<'_>) {
    let c = oven(b, [0.8, 1.2]);
    let (a, s) = (b.random.between(0.4, 0.52), b.random.between(0.08, 0.14));
    rows(b, c, &[Row::Door, Row::Door, Row::Controls], &[a, 1.0 - a - s, s], Edge::Bottom);
    if b.random.chance(0.5) {
        cooktop(b, &c);
    }
}

/// Rows of anything in any order; one door hangs on any edge.
pub(super) fn any_cooker(b: &mut Builder<'_>) {
    let c = oven(b, [0.4, 1.3]);
    let mut kinds = vec![Row::Door];
    for kind in [Row::Door, Row::Drawer, Row::Controls, Row::Blank] {
        if kinds.len() < 4 && b.random.chance(0.45) {
            kinds.push(kind);
        }
    }
    b.random.shuffle(&mut kinds);
    let raw: Vec<f64> = kinds.iter().map(|k| if *k == Row::Door { 1.0 } else { b.random.between(0.15, 0.45) }).collect();
    let sum: f64 = raw.iter().sum();
    let shares: Vec<f64> = raw.iter().map(|s| s / sum).collect();
    let hinge = b.random.pick([Edge::Bottom, Edge::Bottom, Edge::Left, Edge::Right]);
    rows(b, c, &kinds, &shares, hinge);
    if b.random.chance(0.3) {
        let (x, y, high) = (-c.depth / 2.0, c.width / 2.0, b.random.between(0.03, 0.1));
        b.body.push(Solid::between([x, -y, c.top], [x + 0.02, y, c.top + high]));
    }
}

pub(super) fn range_with_splashback(b: &mut Builder<'_>) {
    let c = oven(b, [0.78, 0.92]);
    let d = b.random.between(0.14, 0.26);
    match b.random.index(3) {
        0 => rows(b, c, &[Row::Blank, Row::Door, Row::Blank], &[d, 0.94 - d, 0.06], Edge::Bottom),
        1 => rows(b, c, &[Row::Drawer, Row::Door], &[d, 1.0 - d], Edge::Bottom),
        _ => rows(b, c, &[Row::Drawer, Row::Door, Row::Controls], &[d, 0.88 - d, 0.12], Edge::Bottom),
    }
    cooktop(b, &c);
    let (x, y) = (-c.depth / 2.0, c.width / 2.0);
    let (thick, high) = (b.random.between(0.03, 0.08), b.random.between(0.08, 0.2));
    b.body.push(Solid::between([x, -y, c.top], [x + thick, y, c.top + high]));
    controls(b, x + thick, [-y, y], [c.top, c.top + high], true);
}

pub(super) fn side_hinged_oven(b: &mut Builder<'_>) {
    let c = oven(b, [0.42, 0.65]);
    let s = b.random.between(0.12, 0.22);
    let edge = b.random.pick([Edge::Left, Edge::Right]);
    rows(b, c, &[Row::Door, Row::Controls], &[1.0 - s, s], edge);
}
