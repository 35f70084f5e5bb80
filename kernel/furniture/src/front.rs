//! What moves: doors, drawers, flaps and lids, hung into a builder's object.

use nalgebra::{Point3, Unit, Vector3};

use crate::handle::{Handle, Seat, solids};
use crate::object::{Category, Class, Joint, Kind, Object, Part, Solid};
use crate::random::Random;

/// How an object's fronts are made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Style {
    /// Panels stand before the carcass; otherwise between its boards.
    pub(crate) proud: bool,
    /// Free space around a panel, m.
    pub(crate) gap: f64,
    /// Thickness of a panel, m.
    pub(crate) thick: f64,
    /// Rails and stiles that stand out of a panel: width and height, m.
    pub(crate) rails: Option<[f64; 2]>,
    /// A pane set back in doors: width of the frame, how far, share of lost rays.
    pub(crate) pane: Option<[f64; 3]>,
    /// Doors' handles.
    pub(crate) door_handle: Handle,
    /// Drawers' handles.
    pub(crate) drawer_handle: Handle,
    /// Where along the free edge a door's handle sits, as a share from below.
    pub(crate) height: f64,
    /// Where a hinge's pin lies within the panel's thickness, as a share from the back.
    pub(crate) pin: f64,
    /// How far the pin lies inside the panel's edge, m.
    pub(crate) inset: f64,
}

impl Style {
    pub(crate) fn draw(random: &mut Random) -> Self {
        let proud = random.chance(0.6);
        Self {
            proud,
            gap: random.between(0.0015, 0.006),
            thick: random.between(0.012, 0.028),
            rails: random.chance(0.25).then(|| [random.between(0.03, 0.08), random.between(0.003, 0.008)]),
            pane: random.chance(0.1).then(|| [random.between(0.04, 0.09), random.between(0.003, 0.01), random.between(0.0, 0.4)]),
            door_handle: Handle::draw(random, 0.12),
            drawer_handle: Handle::draw(random, 0.12),
            height: random.pick([0.5, 0.5, 0.25, 0.75]),
            pin: if proud { random.pick([0.0, 0.0, 0.5]) } else { random.pick([0.5, 1.0, 1.0]) },
            inset: random.between(0.0, 0.012),
        }
    }
}

/// A place in a front: `y` and `z` from and to, and where the carcass's front is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cell {
    pub(crate) x: f64,
    pub(crate) y: [f64; 2],
    pub(crate) z: [f64; 2],
    /// Depth behind it that a drawer can use.
    pub(crate) depth: f64,
}

impl Cell {
    pub(crate) fn width(&self) -> f64 {
        self.y[1] - self.y[0]
    }

    pub(crate) fn height(&self) -> f64 {
        self.z[1] - self.z[0]
    }

    /// Parts of its width, from right to left, by shares that sum to one.
    pub(crate) fn columns(&self, shares: &[f64]) -> Vec<Self> {
        let mut at = self.y[0];
        shares
            .iter()
            .map(|s| {
                let from = at;
                at += s * self.width();
                Self { y: [from, at], ..*self }
            })
            .collect()
    }

    /// Parts of its height, from below, by shares that sum to one.
    pub(crate) fn rows(&self, shares: &[f64]) -> Vec<Self> {
        let mut at = self.z[0];
        shares
            .iter()
            .map(|s| {
                let from = at;
                at += s * self.height();
                Self { z: [from, at], ..*self }
            })
            .collect()
    }
}

/// The edge that a panel turns about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Edge {
    Left,
    Right,
    Bottom,
    Top,
}

/// The box behind a drawer's front, m.
#[derive(Clone, Copy)]
struct Tray {
    /// How far it reaches back.
    deep: f64,
    /// Thickness of its walls.
    wall: f64,
    /// Free space at its sides and below it.
    inset: f64,
    below: f64,
    /// Height of its walls, as a share of what is there.
    high: f64,
}

/// An object while it is made.
pub(crate) struct Builder<'r> {
    pub(crate) random: &'r mut Random,
    pub(crate) style: Style,
    pub(crate) body: Vec<Solid>,
    parts: Vec<Part>,
    joints: Vec<Joint>,
}

impl<'r> Builder<'r> {
    pub(crate) fn new(random: &'r mut Random) -> Self {
        let style = Style::draw(random);
        Self { random, style, body: Vec::new(), parts: Vec::new(), joints: Vec::new() }
    }

    pub(crate) fn finish(self, category: Category, family: &'static str) -> Object {
        let mut parts = vec![Part { class: Class::Body, solids: self.body }];
        parts.extend(self.parts);
        Object { category, family, parts, joints: self.joints }
    }

    /// A part and its joint; where it stands is drawn: shut, ajar, or anywhere.
    pub(crate) fn hang(&mut self, class: Class, solids: Vec<Solid>, kind: Kind, axis: Vector3<f64>, origin: [f64; 3], upper: f64) {
        let state = match self.random.index(20) {
            0..=7 => 0.0,
            8..=11 => upper * self.random.between(0.02, 0.2),
            _ => upper * self.random.between(0.2, 1.0),
        };
        self.parts.push(Part { class, solids });
        let part = self.parts.len();
        self.joints.push(Joint { part, kind, axis: Unit::new_normalize(axis), origin: Point3::from(origin), upper, state });
    }

    /// From and to of a front's panel along x.
    pub(crate) fn panel_x(&self, cell: &Cell) -> [f64; 2] {
        if self.style.proud { [cell.x + 0.001, cell.x + 0.001 + self.style.thick] } else { [cell.x - self.style.thick, cell.x] }
    }

    /// A panel that fills a cell but for the gap, with what is set into or onto it. `free` is the edge where it is taken hold of.
    fn panel(&mut self, cell: &Cell, free: Edge, handle: Handle, pane: Option<[f64; 3]>) -> Vec<Solid> {
        let g = self.style.gap;
        let [x0, x1] = self.panel_x(cell);
        let (y0, y1, z0, z1) = (cell.y[0] + g, cell.y[1] - g, cell.z[0] + g, cell.z[1] - g);
        let (w, h) = (y1 - y0, z1 - z0);
        let mut all = Vec::new();
        let least = w.min(h);
        if let Some([frame, back, dropout]) = pane.filter(|p| least > 3.0 * p[0]) {
            let (a, b, c, d) = (y0 + frame, y1 - frame, z0 + frame, z1 - frame);
            all.push(Solid::between([x0, y0, z0], [x1, a, z1]));
            all.push(Solid::between([x0, b, z0], [x1, y1, z1]));
            all.push(Solid::between([x0, a, z0], [x1, b, c]));
            all.push(Solid::between([x0, a, d], [x1, b, z1]));
            all.push(Solid::between([x0, a, c], [(x1 - back).max(x0 + 0.001), b, d]).dark(dropout));
        } else if let Handle::Notch { share, wide } = handle {
            // The strip along the free edge is thin where the notch is.
            let thin = x0 + 0.3 * (x1 - x0);
            let strip = wide.min(0.4 * least);
            let (edge, centre) = match free {
                Edge::Left | Edge::Right => (h, (z0 + z1) / 2.0),
                _ => (w, (y0 + y1) / 2.0),
            };
            let half = (share * edge).max(0.05).min(edge) / 2.0;
            let (from, to) = (centre - half, centre + half);
            let mut push = |y: [f64; 2], z: [f64; 2], x: f64| {
                if y[1] - y[0] > 1e-6 && z[1] - z[0] > 1e-6 {
                    all.push(Solid::between([x0, y[0], z[0]], [x, y[1], z[1]]));
                }
            };
            match free {
                Edge::Left | Edge::Right => {
                    let (body, notch) =
                        if free == Edge::Left { ([y0, y1 - strip], [y1 - strip, y1]) } else { ([y0 + strip, y1], [y0, y0 + strip]) };
                    push(body, [z0, z1], x1);
                    push(notch, [z0, from], x1);
                    push(notch, [to, z1], x1);
                    push(notch, [from, to], thin);
                }
                Edge::Bottom | Edge::Top => {
                    let (body, notch) =
                        if free == Edge::Top { ([z0, z1 - strip], [z1 - strip, z1]) } else { ([z0 + strip, z1], [z0, z0 + strip]) };
                    push([y0, y1], body, x1);
                    push([y0, from], notch, x1);
                    push([to, y1], notch, x1);
                    push([from, to], notch, thin);
                }
            }
        } else {
            all.push(Solid::between([x0, y0, z0], [x1, y1, z1]));
            if let Some([wide, high]) = self.style.rails.filter(|r| least > 3.0 * r[0]) {
                let x2 = x1 + high;
                all.push(Solid::between([x1, y0, z0], [x2, y0 + wide, z1]));
                all.push(Solid::between([x1, y1 - wide, z0], [x2, y1, z1]));
                all.push(Solid::between([x1, y0 + wide, z0], [x2, y1 - wide, z0 + wide]));
                all.push(Solid::between([x1, y0 + wide, z1 - wide], [x2, y1 - wide, z1]));
            }
        }
        if let Handle::Lip { share, deep, wide } = handle {
            let (hw, hh) = ((share * w / 2.0).max(0.02).min(w / 2.0), (share * h / 2.0).max(0.02).min(h / 2.0));
            let (cy, cz) = ((y0 + y1) / 2.0, (z0 + z1) / 2.0);
            let (y, z) = match free {
                Edge::Left => ([y1 - wide, y1], [cz - hh, cz + hh]),
                Edge::Right => ([y0, y0 + wide], [cz - hh, cz + hh]),
                Edge::Top => ([cy - hw, cy + hw], [z1 - wide, z1]),
                Edge::Bottom => ([cy - hw, cy + hw], [z0, z0 + wide]),
            };
            all.push(Solid::between([x1, y[0], z[0]], [x1 + deep, y[1], z[1]]));
        }
        all
    }

    /// Outer face of a panel where handles sit.
    fn face(&self, cell: &Cell) -> f64 {
        let least = cell.width().min(cell.height()) - 2.0 * self.style.gap;
        self.panel_x(cell)[1] + self.style.rails.filter(|r| least > 3.0 * r[0]).map_or(0.0, |r| r[1])
    }

    /// A door or flap that turns about an edge.
    pub(crate) fn hinged(&mut self, cell: &Cell, hinge: Edge, handle: Handle, upper: f64) {
        let free = match hinge {
            Edge::Left => Edge::Right,
            Edge::Right => Edge::Left,
            Edge::Bottom => Edge::Top,
            Edge::Top => Edge::Bottom,
        };
        let pane = self.style.pane;
        let mut all = self.panel(cell, free, handle, pane);
        let (w, h) = (cell.width(), cell.height());
        let margin = self.random.between(0.03, 0.06);
        let (inward_y, inward_z) = (margin.min(0.3 * w), margin.min(0.3 * h));
        let mid = [(cell.y[0] + cell.y[1]) / 2.0, (cell.z[0] + cell.z[1]) / 2.0];
        let upright = matches!(hinge, Edge::Left | Edge::Right);
        let along = match handle {
            Handle::Bar { share, .. } => (self.style.height - 0.5) * (1.0 - share).max(0.0) * 0.8,
            Handle::Lever { .. } => -0.02,
            _ => (self.style.height - 0.5) * 1.4,
        };
        let at = match free {
            Edge::Left => [cell.y[1] - inward_y, mid[1] + along * h],
            Edge::Right => [cell.y[0] + inward_y, mid[1] + along * h],
            Edge::Top => [mid[0], cell.z[1] - inward_z],
            Edge::Bottom => [mid[0], cell.z[0] + inward_z],
        };
        let toward = if hinge == Edge::Left { 1.0 } else { -1.0 };
        let edge = if upright { h } else { w };
        all.extend(solids(handle, &Seat { x: self.face(cell), at, upright, edge, toward }));
        let [x0, x1] = self.panel_x(cell);
        let x = x0 + self.style.pin * (x1 - x0);
        let i = self.style.gap + self.style.inset;
        // Positive rotation carries the free edge out, towards +x.
        let (axis, origin) = match hinge {
            Edge::Left => (Vector3::z(), [x, cell.y[1] - i, mid[1]]),
            Edge::Right => (-Vector3::z(), [x, cell.y[0] + i, mid[1]]),
            Edge::Bottom => (Vector3::y(), [x, mid[0], cell.z[0] + i]),
            Edge::Top => (-Vector3::y(), [x, mid[0], cell.z[1] - i]),
        };
        let class = if upright { Class::Door } else { Class::Flap };
        self.hang(class, all, Kind::Revolute, axis, origin, upper);
    }

    /// A door whose handle is the style's; how far it opens is drawn.
    pub(crate) fn door(&mut self, cell: &Cell, hinge: Edge) {
        let upper = self.random.between(1.45, 2.3);
        let handle = self.style.door_handle;
        self.hinged(cell, hinge, handle, upper);
    }

    /// Two doors that meet in the middle.
    pub(crate) fn double_door(&mut self, cell: &Cell) {
        let halves = cell.columns(&[0.5, 0.5]);
        self.door(&halves[0], Edge::Right);
        self.door(&halves[1], Edge::Left);
    }

    /// A flap.
    pub(crate) fn flap(&mut self, cell: &Cell, hinge: Edge) {
        let upper = self.random.between(1.2, 1.65);
        let handle = self.style.door_handle;
        self.hinged(cell, hinge, handle, upper);
    }

    /// A drawer with its box.
    pub(crate) fn drawer(&mut self, cell: &Cell) {
        let front = self.drawer_front(cell);
        let deep = cell.depth * self.random.between(0.75, 0.95);
        let tray = Tray {
            deep,
            wall: self.random.between(0.006, 0.014),
            inset: self.random.between(0.012, 0.025).min(0.2 * cell.width()),
            below: 0.012_f64.min(0.2 * cell.height()),
            high: self.random.between(0.45, 0.85),
        };
        self.slide_out(cell, front, &tray);
    }

    /// A drawer whose sides are stout and may be as high and as far apart as its front.
    pub(crate) fn stout_drawer(&mut self, cell: &Cell) {
        let front = self.drawer_front(cell);
        let (w, h) = (cell.width(), cell.height());
        let tray = Tray {
            deep: cell.depth * self.random.between(0.6, 0.97),
            wall: self.random.between(0.006, 0.022).min(0.15 * w),
            inset: (self.style.gap + self.random.between(0.0, 0.015)).min(0.2 * w),
            below: self.style.gap + self.random.between(0.0, 0.15) * h,
            high: self.random.between(0.4, 0.98),
        };
        self.slide_out(cell, front, &tray);
    }

    fn drawer_front(&mut self, cell: &Cell) -> Vec<Solid> {
        let handle = self.style.drawer_handle;
        let mut all = self.panel(cell, Edge::Top, handle, None);
        let mid = [(cell.y[0] + cell.y[1]) / 2.0, (cell.z[0] + cell.z[1]) / 2.0];
        let (w, h) = (cell.width(), cell.height());
        let up = if h > 0.25 { 0.25 * h } else { 0.0 };
        let (x, twice) = (self.face(cell), w > 0.7 && matches!(handle, Handle::Knob { .. }));
        for side in if twice { vec![-0.25, 0.25] } else { vec![0.0] } {
            let at = [mid[0] + side * w, mid[1] + up];
            all.extend(solids(handle, &Seat { x, at, upright: false, edge: w, toward: 1.0 }));
        }
        all
    }

    fn slide_out(&mut self, cell: &Cell, mut all: Vec<Solid>, tray: &Tray) {
        let Tray { deep, wall, .. } = *tray;
        let x0 = self.panel_x(cell)[0];
        let (y0, y1) = (cell.y[0] + tray.inset, cell.y[1] - tray.inset);
        let z0 = cell.z[0] + tray.below;
        let z1 = z0 + (cell.z[1] - z0) * tray.high;
        all.push(Solid::between([x0 - deep, y0, z0], [x0, y1, z0 + wall]));
        all.push(Solid::between([x0 - deep, y0, z0], [x0, y0 + wall, z1]));
        all.push(Solid::between([x0 - deep, y1 - wall, z0], [x0, y1, z1]));
        all.push(Solid::between([x0 - deep, y0, z0], [x0 - deep + wall, y1, z1]));
        if self.random.chance(0.4) {
            all.extend(crate::carcass::contents([x0 - deep + wall, y0 + wall, z0 + wall], [x0, y1 - wall, z1], self.random));
        }
        let upper = deep * self.random.between(0.7, 0.95);
        let mid = [(cell.y[0] + cell.y[1]) / 2.0, (cell.z[0] + cell.z[1]) / 2.0];
        self.hang(Class::Drawer, all, Kind::Prismatic, Vector3::x(), [x0, mid[0], mid[1]], upper);
    }

    /// A panel that does not move.
    pub(crate) fn blank(&mut self, cell: &Cell) {
        let g = if self.random.chance(0.5) { self.style.gap } else { 0.0 };
        let [x0, x1] = self.panel_x(cell);
        self.body.push(Solid::between([x0, cell.y[0] + g, cell.z[0] + g], [x1, cell.y[1] - g, cell.z[1] - g]));
    }
}
