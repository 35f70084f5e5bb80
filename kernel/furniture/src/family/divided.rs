//! Openings that posts and bars divide over and over, with something else in every field: leaves that turn about any of their edges,
//! panels of the same make that are fixed, glass, boards that lie deeper or stand out, nothing at all. How wide the posts are, or whether
//! there are any, says nothing about what moves. There are three fields or more, so that neither of the held-out doors (a leaf above
//! another, a leaf beside a pane) is among them.

use super::composed::{light, set_in, shares, side};
use super::entrance::{leaf, room_handle};
use crate::front::{Builder, Cell, Edge};
use crate::handle::Handle;
use crate::object::Solid;

/// How an opening is divided.
struct Division {
    /// Half depth of posts and bars, m.
    x: f64,
    /// Their width, m; none at all where it is zero.
    post: f64,
    /// The least width or height of a field that is divided, m.
    least: f64,
}

impl Division {
    /// Divides the largest field again and again until there are `many`, or three where smaller ones would be too small.
    fn fields(&mut self, b: &mut Builder<'_>, opening: &Cell, many: usize) -> Vec<Cell> {
        let size = |c: &Cell| c.width().max(c.height());
        let mut fields = vec![*opening];
        while fields.len() < many {
            fields.sort_by(|a, b| size(a).total_cmp(&size(b)));
            let Some(whole) = fields.pop() else { break };
            match self.divide(b, &whole) {
                Some(smaller) => fields.extend(smaller),
                None => {
                    fields.push(whole);
                    if fields.len() > 2 {
                        break;
                    }
                    self.least *= 0.8;
                }
            }
        }
        fields
    }

    /// Two or three fields beside or above one another, with posts or bars between them; none if there is no room.
    fn divide(&self, b: &mut Builder<'_>, whole: &Cell) -> Option<Vec<Cell>> {
        let tall = whole.height() > whole.width();
        let up = if b.random.chance(0.8) { tall } else { !tall };
        let long = if up { whole.height() } else { whole.width() };
        let room = (long / (self.least + self.post)).floor() as usize;
        if room < 2 {
            return None;
        }
        let n = 2 + b.random.index(2.min(room - 1));
        let s = shares(b, n, 0.6, 1.4);
        let cells = if up { whole.rows(&s) } else { whole.columns(&s) };
        let h = self.post / 2.0;
        for after in cells[1..].iter().filter(|_| h > 0.0) {
            let [y, z] = if up { [after.y, [after.z[0] - h, after.z[0] + h]] } else { [[after.y[0] - h, after.y[0] + h], after.z] };
            b.body.push(Solid::between([-self.x, y[0], z[0]], [self.x, y[1], z[1]]));
        }
        let last = cells.len() - 1;
        let inner = cells.into_iter().enumerate().map(|(k, c)| {
            let (low, high) = (if k > 0 { h } else { 0.0 }, if k < last { h } else { 0.0 });
            if up { Cell { z: [c.z[0] + low, c.z[1] - high], ..c } } else { Cell { y: [c.y[0] + low, c.y[1] - high], ..c } }
        });
        Some(inner.collect())
    }

    /// Something fixed in a field.
    fn fix(&self, b: &mut Builder<'_>, field: &Cell) {
        match b.random.index(7) {
            0..=2 => b.blank(field),
            3 | 4 => light(b, field),
            5 => {
                let (out, thick) = (b.random.between(-1.0, 1.0) * self.x, b.random.between(0.01, 0.06));
                b.body.push(Solid::between([out - thick, field.y[0], field.z[0]], [out, field.y[1], field.z[1]]));
            }
            _ => (),
        }
    }
}

/// Leaves in one or two of the fields or more, the others fixed.
fn furnish(b: &mut Builder<'_>, division: &Division, fields: &[Cell], handle: Handle) {
    let large = |f: &Cell| f.width().min(f.height()) >= 0.9 * division.least;
    let may: Vec<usize> = (0..fields.len()).filter(|k| large(&fields[*k])).collect();
    let first = if may.is_empty() { 0 } else { may[b.random.index(may.len())] };
    let moving = b.random.between(0.15, 0.8);
    let (usual, one_way) = (side(b), b.random.chance(0.5));
    for (k, field) in fields.iter().enumerate() {
        if k != first && !(large(field) && b.random.chance(moving)) {
            division.fix(b, field);
            continue;
        }
        let own = if b.random.chance(0.85) { handle } else { Handle::None };
        if field.width() > 1.1 * field.height() && b.random.chance(0.4) {
            let edge = b.random.pick([Edge::Top, Edge::Bottom]);
            leaf(b, field, edge, own);
        } else if field.width() > 2.2 * division.least && b.random.chance(0.5) {
            let halves = field.columns(&[0.5, 0.5]);
            leaf(b, &halves[0], Edge::Right, own);
            leaf(b, &halves[1], Edge::Left, own);
        } else {
            let hinge = if one_way { usual } else { side(b) };
            leaf(b, field, hinge, own);
        }
    }
}

/// What stands around an opening: posts or walls beside it, a lintel or wall above it, sometimes wall below.
fn surround(b: &mut Builder<'_>, opening: &Cell, x: f64, rim: f64, wall: [f64; 3]) {
    let ([y0, y1], [z0, z1], [aside, above, below]) = (opening.y, opening.z, wall);
    let top = z1 + rim;
    let foot = if below > 0.0 { z0 - rim } else { z0 };
    b.body.extend([
        Solid::between([-x, y0 - rim, foot], [x, y0, top]),
        Solid::between([-x, y1, foot], [x, y1 + rim, top]),
        Solid::between([-x, y0, z1], [x, y1, top]),
    ]);
    let t = x * b.random.between(0.5, 1.0);
    if below > 0.0 {
        b.body.push(Solid::between([-x, y0, foot], [x, y1, z0]));
        b.body.push(Solid::between([-x, y0 - rim - aside, foot - below], [t, y1 + rim + aside, foot]));
    }
    if aside > 0.0 {
        b.body.push(Solid::between([-x, y0 - rim - aside, foot], [t, y0 - rim, top + above]));
        b.body.push(Solid::between([-x, y1 + rim, foot], [t, y1 + rim + aside, top + above]));
    }
    if above > 0.0 {
        b.body.push(Solid::between([-x, y0 - rim, top], [t, y1 + rim, top + above]));
    }
}

/// A doorway of three fields or more.
pub(super) fn divided_doorway(b: &mut Builder<'_>) {
    let (y, z) = (b.random.between(0.45, 1.3), b.random.between(1.85, 2.5));
    let (x, rim) = (b.random.between(0.025, 0.1), b.random.between(0.03, 0.12));
    let face = set_in(b, x);
    let opening = Cell { x: face, y: [-y, y], z: [0.006, z], depth: 0.0 };
    let wall = [if b.random.chance(0.5) { b.random.between(0.05, 0.6) } else { 0.0 }, b.random.pick([0.0, 0.1, 0.3]), 0.0];
    surround(b, &opening, x, rim, wall);
    let mut division = Division { x, post: b.random.pick([0.0, 0.03, 0.05, 0.09]), least: b.random.between(0.4, 0.7) };
    let many = 3 + b.random.index(4);
    let fields = division.fields(b, &opening, many);
    let handle = room_handle(b);
    furnish(b, &division, &fields, handle);
}

/// Small doors and blind panels beside and above one another in a wall or in a frame of its own.
pub(super) fn divided_hatches(b: &mut Builder<'_>) {
    let (y, high, z0) = (b.random.scale(0.15, 0.7), b.random.scale(0.4, 1.9), b.random.between(0.1, 1.0));
    let (x, rim) = (b.random.between(0.015, 0.06), b.random.between(0.012, 0.08));
    let face = set_in(b, x);
    let opening = Cell { x: face, y: [-y, y], z: [z0, z0 + high], depth: 0.0 };
    let r = &mut b.random;
    let wall = [r.pick([0.0, 0.05, 0.25]), r.pick([0.0, 0.05, 0.25]), r.between(0.03, 0.4)];
    surround(b, &opening, x, rim, wall);
    if b.random.chance(0.6) {
        // A niche or a shaft behind.
        let deep = b.random.between(0.08, 0.3);
        b.body.push(Solid::between([-x - deep - 0.01, -y, z0], [-x - deep, y, z0 + high]));
    }
    let mut division = Division { x, post: b.random.pick([0.0, 0.015, 0.03, 0.06]), least: b.random.between(0.15, 0.3) };
    let many = 3 + b.random.index(4);
    let fields = division.fields(b, &opening, many);
    let handle = if b.random.chance(0.5) { b.style.door_handle } else { room_handle(b) };
    furnish(b, &division, &fields, handle);
}
