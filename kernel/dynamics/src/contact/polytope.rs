//! Convex polytopes: boxes, convex hulls, and the prisms that stand in for cylinders. Overlap is the least translation that parts
//! two of them, found over the directions of faces and of pairs of edges (separating axes; Gottschalk, Lin and Manocha 1996; edge pairs
//! pruned by their Gauss maps, Gregorius 2013). Contacts are the corners of one face clipped by the sides of the other (Sutherland and
//! Hodgman 1974).

use nalgebra::{Matrix3, Vector3};

use super::feature::{Feature, Slide};
use super::point::{Found, Manifold};

/// A convex solid in its own frame.
#[derive(Debug, Clone)]
pub(crate) struct Polytope {
    pub vertices: Vec<Vector3<f64>>,
    pub faces: Vec<Face>,
    /// Corners of all faces, counter-clockwise seen from outside.
    pub loops: Vec<u32>,
    pub edges: Vec<Edge>,
}

/// One face.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Face {
    pub normal: Vector3<f64>,
    pub start: u32,
    pub len: u32,
}

/// One edge: its ends, and the faces on both sides.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Edge {
    pub ends: [u32; 2],
    pub faces: [u32; 2],
}

/// A polytope at its place in the world.
#[derive(Debug, Clone, Default)]
pub(crate) struct Placed {
    pub vertices: Vec<Vector3<f64>>,
    pub normals: Vec<Vector3<f64>>,
    pub center: Vector3<f64>,
}

impl Polytope {
    /// From faces as loops of corners. `None` where they do not close, or hold no volume.
    pub fn new(vertices: Vec<Vector3<f64>>, faces: &[Vec<u32>]) -> Option<Self> {
        let mut out = Self { vertices, faces: Vec::new(), loops: Vec::new(), edges: Vec::new() };
        let middle = out.vertices.iter().sum::<Vector3<f64>>() / out.vertices.len() as f64;
        let size = out.vertices.iter().map(|v| (v - middle).norm()).fold(0.0, f64::max);
        let mut sides: std::collections::BTreeMap<(u32, u32), Vec<u32>> = std::collections::BTreeMap::new();
        let mut volume = 0.0;
        for (f, corners) in faces.iter().enumerate() {
            let at = |i: usize| out.vertices[corners[i % corners.len()] as usize];
            // Newell's normal: good for corners that lie in a plane only nearly.
            let area = (0..corners.len()).map(|i| (at(i) - middle).cross(&(at(i + 1) - middle))).sum::<Vector3<f64>>() * 0.5;
            let mut corners = corners.clone();
            let mut normal = area.try_normalize(0.0)?;
            if normal.dot(&(at(0) - middle)) < 0.0 {
                corners.reverse();
                normal = -normal;
            }
            volume += area.norm() * normal.dot(&(out.vertices[corners[0] as usize] - middle)) / 3.0;
            for i in 0..corners.len() {
                let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                sides.entry((a.min(b), a.max(b))).or_default().push(f as u32);
            }
            out.faces.push(Face { normal, start: out.loops.len() as u32, len: corners.len() as u32 });
            out.loops.extend(corners);
        }
        for ((a, b), on) in sides {
            let [f, g] = on.as_slice() else { return None };
            out.edges.push(Edge { ends: [a, b], faces: [*f, *g] });
        }
        (volume > 1e-9 * size.powi(3) && volume.is_finite()).then_some(out)
    }

    /// A box.
    pub fn cuboid(half: &Vector3<f64>) -> Option<Self> {
        let vertices = (0..8)
            .map(|i| {
                Vector3::new(
                    if i & 1 == 0 { -half.x } else { half.x },
                    if i & 2 == 0 { -half.y } else { half.y },
                    if i & 4 == 0 { -half.z } else { half.z },
                )
            })
            .collect();
        let faces = [[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]].map(|f| f.to_vec());
        Self::new(vertices, &faces)
    }

    /// A prism along z with `sides` sides, whose faces have the same area across as the circle of `radius`.
    pub fn prism(radius: f64, half: f64, sides: u32) -> Option<Self> {
        let turn = std::f64::consts::TAU / f64::from(sides);
        let r = radius * (turn / turn.sin()).sqrt();
        let corner = |k: u32, z: f64| Vector3::new(r * (turn * f64::from(k)).cos(), r * (turn * f64::from(k)).sin(), z);
        let vertices = (0..sides).map(|k| corner(k, -half)).chain((0..sides).map(|k| corner(k, half))).collect();
        let mut faces: Vec<Vec<u32>> = (0..sides).map(|k| vec![k, (k + 1) % sides, (k + 1) % sides + sides, k + sides]).collect();
        faces.push((0..sides).collect());
        faces.push((sides..2 * sides).collect());
        Self::new(vertices, &faces)
    }

    /// Puts it at a pose.
    pub fn place(&self, R: &Matrix3<f64>, p: &Vector3<f64>, placed: &mut Placed) {
        placed.vertices.clear();
        placed.vertices.extend(self.vertices.iter().map(|v| R * v + p));
        placed.normals.clear();
        placed.normals.extend(self.faces.iter().map(|f| R * f.normal));
        placed.center = placed.vertices.iter().sum::<Vector3<f64>>() / placed.vertices.len() as f64;
    }

    fn corners(&self, face: usize) -> &[u32] {
        let f = &self.faces[face];
        &self.loops[f.start as usize..(f.start + f.len) as usize]
    }
}

/// A corner of a polygon that is being clipped.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    p: Vector3<f64>,
    motion: Slide,
    /// The side from here to the next corner: an edge's direction, or where a plane cut.
    side: Side,
    id: u32,
    side_id: u32,
}

#[derive(Debug, Clone, Copy)]
enum Side {
    Edge(Vector3<f64>),
    Cut,
}

/// Scratch of clipping.
#[derive(Debug, Clone, Default)]
pub(crate) struct Clip {
    a: Vec<Corner>,
    b: Vec<Corner>,
}

impl Clip {
    /// Makes room for polygons of this many corners.
    pub fn reserve(&mut self, corners: usize) {
        self.a.reserve(corners);
        self.b.reserve(corners);
    }
}

/// Which direction parts two polytopes best.
enum Axis {
    FaceA(usize),
    FaceB(usize),
    Edges(usize, usize),
}

/// Faces are kept while edges are no better than this part of the size: a pair of faces then does not flicker into a
/// single point, nor from one of the two to the other.
const FACE_BIAS: f64 = 1e-4;

/// Contacts of two polytopes whose gap is less than `margin`.
pub(crate) fn collide((a, at_a): (&Polytope, &Placed), (b, at_b): (&Polytope, &Placed), margin: f64, clip: &mut Clip, out: &mut Manifold) {
    let lowest = |vs: &[Vector3<f64>], n: &Vector3<f64>| vs.iter().map(|v| v.dot(n)).fold(f64::INFINITY, f64::min);
    let mut best = (f64::NEG_INFINITY, Axis::FaceB(0));
    for (f, n) in at_b.normals.iter().enumerate() {
        let plane = at_b.vertices[b.corners(f)[0] as usize].dot(n);
        let gap = lowest(&at_a.vertices, n) - plane;
        if gap > margin {
            return;
        }
        if gap > best.0 {
            best = (gap, Axis::FaceB(f));
        }
    }
    let bias = FACE_BIAS * (at_a.vertices[0] - at_a.center).norm();
    for (f, n) in at_a.normals.iter().enumerate() {
        let plane = at_a.vertices[a.corners(f)[0] as usize].dot(n);
        let gap = lowest(&at_b.vertices, n) - plane;
        if gap > margin {
            return;
        }
        if gap > best.0 + bias {
            best = (gap, Axis::FaceA(f));
        }
    }
    for (i, ea) in a.edges.iter().enumerate() {
        let (p, da) = line(at_a, ea);
        let (a0, a1) = (at_a.normals[ea.faces[0] as usize], at_a.normals[ea.faces[1] as usize]);
        for (j, eb) in b.edges.iter().enumerate() {
            // The arcs of both edges on the sphere of normals cross: only then do they carry a face of the Minkowski difference.
            let (b0, b1) = (-at_b.normals[eb.faces[0] as usize], -at_b.normals[eb.faces[1] as usize]);
            let (q, db) = line(at_b, eb);
            let (s0, s1) = (b0.dot(&da), b1.dot(&da));
            let (t0, t1) = (a0.dot(&db), a1.dot(&db));
            if s0 * s1 >= 0.0 || t0 * t1 >= 0.0 {
                continue;
            }
            let bisector = a0 + a1;
            let cross = da.cross(&db);
            let length = cross.norm();
            if length < 1e-6 * da.norm() * db.norm() {
                continue;
            }
            // Outward of A.
            let mut n = cross / length;
            if n.dot(&bisector) < 0.0 {
                n = -n;
            }
            if n.dot(&(b0 + b1)) <= 0.0 {
                continue;
            }
            let gap = n.dot(&(q - p));
            if gap > margin {
                return;
            }
            if gap > best.0 + bias {
                best = (gap, Axis::Edges(i, j));
            }
        }
    }
    match best.1 {
        Axis::FaceB(f) => faces((b, at_b, f), (a, at_a), false, margin, clip, out),
        Axis::FaceA(f) => faces((a, at_a, f), (b, at_b), true, margin, clip, out),
        Axis::Edges(i, j) => {
            let (ea, eb) = (&a.edges[i], &b.edges[j]);
            let ((p, da), (q, db)) = (line(at_a, ea), line(at_b, eb));
            let outward = at_a.normals[ea.faces[0] as usize] + at_a.normals[ea.faces[1] as usize];
            edges((p, da), (q, db), &-outward, (i as u32) << 12 | j as u32, out);
        }
    }
}

fn line(at: &Placed, e: &Edge) -> (Vector3<f64>, Vector3<f64>) {
    let p = at.vertices[e.ends[0] as usize];
    (p, at.vertices[e.ends[1] as usize] - p)
}

/// One contact of two lines that cross; the normal is on the side of `toward`, from B to A.
pub(crate) fn edges(
    (p, da): (Vector3<f64>, Vector3<f64>),
    (q, db): (Vector3<f64>, Vector3<f64>),
    toward: &Vector3<f64>,
    id: u32,
    out: &mut Manifold,
) {
    let (e_a, e_b) = (da.normalize(), db.normalize());
    let cross = e_a.cross(&e_b);
    let squared = cross.norm_squared();
    let sign = if cross.dot(toward) < 0.0 { -1.0 } else { 1.0 };
    let n = cross * (sign / squared.sqrt());
    let d = q - p;
    let (x_a, x_b) = (p + e_a * (d.cross(&e_b).dot(&cross) / squared), q + e_b * (d.cross(&e_a).dot(&cross) / squared));
    let gap = n.dot(&(x_a - x_b));
    out.push(Found {
        p: (x_a + x_b) * 0.5,
        n,
        depth: -gap,
        feature: Feature::Lines { x_a, e_a, e_b, sign, gap, reach: 0.0 },
        id: 3 << 24 | id,
    });
}

/// Contacts of a reference face with the other polytope's face that looks against it most. `of_a`: the reference is A's.
fn faces(
    (r, at_r, face): (&Polytope, &Placed, usize),
    (o, at_o): (&Polytope, &Placed),
    of_a: bool,
    margin: f64,
    clip: &mut Clip,
    out: &mut Manifold,
) {
    let n = at_r.normals[face];
    let mut incident = (f64::INFINITY, 0);
    for (f, m) in at_o.normals.iter().enumerate() {
        if m.dot(&n) < incident.0 {
            incident = (m.dot(&n), f);
        }
    }
    let corners = o.corners(incident.1);
    start(clip, corners.iter().map(|&i| (i, at_o.vertices[i as usize])));
    let sides = r.corners(face);
    let plane = at_r.vertices[sides[0] as usize].dot(&n);
    for (k, &i) in sides.iter().enumerate() {
        let (p, q) = (at_r.vertices[i as usize], at_r.vertices[sides[(k + 1) % sides.len()] as usize]);
        let m = (q - p).cross(&n).normalize();
        cut(clip, &m, m.dot(&p), k as u32, &at_o.normals[incident.1]);
    }
    finish(clip, &n, plane, of_a, margin, out);
}

/// Begins with a polygon.
pub(crate) fn start(clip: &mut Clip, corners: impl Iterator<Item = (u32, Vector3<f64>)>) {
    clip.a.clear();
    for (id, p) in corners {
        if let Some(last) = clip.a.last_mut() {
            last.side = Side::Edge(p - last.p);
        }
        clip.a.push(Corner { p, motion: Slide::Vertex, side: Side::Edge(p), id, side_id: id });
    }
    if let (Some(first), Some(last)) = (clip.a.first().map(|c| c.p), clip.a.last_mut()) {
        last.side = Side::Edge(first - last.p);
    }
}

/// Cuts off what lies beyond the plane `m . x = at`. `face` is the normal of the polygon.
pub(crate) fn cut(clip: &mut Clip, m: &Vector3<f64>, at: f64, id: u32, face: &Vector3<f64>) {
    if clip.a.iter().all(|c| m.dot(&c.p) <= at) {
        return;
    }
    clip.b.clear();
    for i in 0..clip.a.len() {
        let (c, next) = (clip.a[i], &clip.a[(i + 1) % clip.a.len()]);
        let (s, t) = (m.dot(&c.p) - at, m.dot(&next.p) - at);
        if s <= 0.0 {
            clip.b.push(c);
        }
        if (s <= 0.0) != (t <= 0.0) {
            let p = c.p + (next.p - c.p) * (s / (s - t));
            let motion = match c.side {
                Side::Edge(e) => Slide::Crossing { e, m: *m },
                Side::Cut => Slide::Corner { a: *face },
            };
            let (side, side_id) = if s <= 0.0 { (Side::Cut, 64 + id) } else { (c.side, c.side_id) };
            clip.b.push(Corner { p, motion, side, id: 1 << 20 | (c.side_id & 1023) << 10 | (id & 1023), side_id });
        }
    }
    std::mem::swap(&mut clip.a, &mut clip.b);
}

/// Gives out the corners that are under the plane `n . x = plane`, or above it by less than `margin`.
pub(crate) fn finish(clip: &Clip, n: &Vector3<f64>, plane: f64, of_a: bool, margin: f64, out: &mut Manifold) {
    for c in &clip.a {
        let depth = plane - n.dot(&c.p);
        if depth > -margin {
            let feature = Feature::Face { x: c.p, motion: c.motion, of_a };
            let normal = if of_a { -n } else { *n };
            out.push(Found { p: c.p + n * (0.5 * depth), n: normal, depth, feature, id: c.id | u32::from(of_a) << 31 });
        }
    }
}

/// Two boxes: the same as [`collide`], with the directions of [`Polytope::cuboid`] written out. Each is a rotation, a centre and half
/// lengths.
pub(crate) fn boxes(
    (Ra, pa, ha): (&Matrix3<f64>, &Vector3<f64>, &Vector3<f64>),
    (Rb, pb, hb): (&Matrix3<f64>, &Vector3<f64>, &Vector3<f64>),
    margin: f64,
    clip: &mut Clip,
    out: &mut Manifold,
) {
    // Centre of A in B's axes, and A's axes in B's.
    let between = pa - pb;
    let t_b = Rb.tr_mul(&between);
    let R = Rb.tr_mul(Ra);
    let Q = R.abs();
    let mut best = (f64::NEG_INFINITY, 0, 0);
    for i in 0..3 {
        let gap = t_b[i].abs() - hb[i] - (Q[(i, 0)] * ha.x + Q[(i, 1)] * ha.y + Q[(i, 2)] * ha.z);
        if gap > margin {
            return;
        }
        if gap > best.0 {
            best = (gap, 0, i);
        }
    }
    let t_a = Ra.tr_mul(&between);
    let bias = FACE_BIAS * (ha.x + ha.y + ha.z);
    for i in 0..3 {
        let gap = t_a[i].abs() - ha[i] - (Q[(0, i)] * hb.x + Q[(1, i)] * hb.y + Q[(2, i)] * hb.z);
        if gap > margin {
            return;
        }
        if gap > best.0 + bias {
            best = (gap, 1, i);
        }
    }
    for i in 0..3 {
        let (i1, i2) = ((i + 1) % 3, (i + 2) % 3);
        for j in 0..3 {
            // b_i x a_j; in B's axes it is e_i x R_j.
            let squared = R[(i1, j)] * R[(i1, j)] + R[(i2, j)] * R[(i2, j)];
            if squared < 1e-12 {
                continue;
            }
            let (j1, j2) = ((j + 1) % 3, (j + 2) % 3);
            let along = (t_b[i2] * R[(i1, j)] - t_b[i1] * R[(i2, j)]).abs();
            let reach = hb[i1] * Q[(i2, j)] + hb[i2] * Q[(i1, j)] + ha[j1] * Q[(i, j2)] + ha[j2] * Q[(i, j1)];
            let gap = along - reach;
            // Where the axes part by much it does without the root.
            if gap > margin && gap * gap > margin * margin * squared {
                return;
            }
            if gap < 0.0 && best.0 >= 0.0 {
                continue;
            }
            let gap = gap / squared.sqrt();
            if gap > best.0 + bias {
                best = (gap, 2 + i, j);
            }
        }
    }
    match best.1 {
        0 => box_faces((Rb, pb, hb), (best.2, if t_b[best.2] < 0.0 { -1.0 } else { 1.0 }), (Ra, pa, ha), false, margin, clip, out),
        1 => box_faces((Ra, pa, ha), (best.2, if t_a[best.2] < 0.0 { 1.0 } else { -1.0 }), (Rb, pb, hb), true, margin, clip, out),
        _ => {
            let (i, j) = (best.1 - 2, best.2);
            let (e_a, e_b) = (Ra.column(j).into_owned(), Rb.column(i).into_owned());
            let mut n = e_a.cross(&e_b).normalize();
            if n.dot(&between) < 0.0 {
                n = -n;
            }
            let (mut p, mut q) = (*pa, *pb);
            let mut id = 0;
            for k in 0..3 {
                if k != j {
                    let s = if Ra.column(k).dot(&n) > 0.0 { -1.0 } else { 1.0 };
                    p += Ra.column(k) * (s * ha[k]);
                    id = id << 1 | u32::from(s > 0.0);
                }
            }
            for k in 0..3 {
                if k != i {
                    let s = if Rb.column(k).dot(&n) > 0.0 { 1.0 } else { -1.0 };
                    q += Rb.column(k) * (s * hb[k]);
                    id = id << 1 | u32::from(s > 0.0);
                }
            }
            edges((p, e_a), (q, e_b), &n, id << 8 | (3 * i + j) as u32, out);
        }
    }
}

/// The face of `r` on the side `sign` of its axis `axis`, against the face of `o` that looks against it most.
fn box_faces(
    (Rr, pr, hr): (&Matrix3<f64>, &Vector3<f64>, &Vector3<f64>),
    (axis, sign): (usize, f64),
    (Ro, po, ho): (&Matrix3<f64>, &Vector3<f64>, &Vector3<f64>),
    of_a: bool,
    margin: f64,
    clip: &mut Clip,
    out: &mut Manifold,
) {
    let n: Vector3<f64> = Rr.column(axis) * sign;
    let on = Ro.tr_mul(&n);
    let f = on.iamax();
    let face: Vector3<f64> = Ro.column(f) * -on[f].signum();
    let middle = po + face * ho[f];
    let (u, w) = ((f + 1) % 3, (f + 2) % 3);
    let (eu, ew): (Vector3<f64>, Vector3<f64>) = (Ro.column(u) * ho[u], Ro.column(w) * ho[w]);
    let first = if on[f] > 0.0 { 0 } else { 4 };
    let corner = |k: u32, p: Vector3<f64>| (first + k, p);
    start(
        clip,
        [corner(0, middle + eu + ew), corner(1, middle - eu + ew), corner(2, middle - eu - ew), corner(3, middle + eu - ew)].into_iter(),
    );
    for (k, side) in [(axis + 1) % 3, (axis + 2) % 3].into_iter().enumerate() {
        let m: Vector3<f64> = Rr.column(side).into_owned();
        let at = m.dot(pr);
        cut(clip, &m, at + hr[side], 2 * k as u32, &face);
        cut(clip, &-m, -at + hr[side], 2 * k as u32 + 1, &face);
    }
    finish(clip, &n, n.dot(pr) + hr[axis], of_a, margin, out);
}

/// The nearest part of a polytope to a point: distance (negative inside), the point on it, and what it is.
pub(crate) enum Nearest {
    Face(usize),
    Edge(usize),
    Vertex,
}

/// The nearest point of a polytope's surface, by faces, then their sides.
pub(crate) fn nearest(b: &Polytope, at: &Placed, x: &Vector3<f64>) -> (f64, Vector3<f64>, Nearest) {
    let mut best = (f64::NEG_INFINITY, 0);
    for (f, n) in at.normals.iter().enumerate() {
        let d = n.dot(x) - at.vertices[b.corners(f)[0] as usize].dot(n);
        if d > best.0 {
            best = (d, f);
        }
    }
    if best.0 <= 0.0 {
        return (best.0, x - at.normals[best.1] * best.0, Nearest::Face(best.1));
    }
    let mut found = (f64::INFINITY, *x, Nearest::Face(best.1));
    for (f, n) in at.normals.iter().enumerate() {
        let corners = b.corners(f);
        let d = n.dot(x) - at.vertices[corners[0] as usize].dot(n);
        if d <= 0.0 || d >= found.0 {
            continue;
        }
        let inside = (0..corners.len()).all(|k| {
            let (p, q) = (at.vertices[corners[k] as usize], at.vertices[corners[(k + 1) % corners.len()] as usize]);
            (q - p).cross(n).dot(&(x - p)) <= 0.0
        });
        if inside {
            found = (d, x - n * d, Nearest::Face(f));
        }
    }
    for (k, e) in b.edges.iter().enumerate() {
        let (p, d) = line(at, e);
        let t = d.dot(&(x - p)) / d.norm_squared();
        let on = p + d * t.clamp(0.0, 1.0);
        let distance = (x - on).norm();
        if distance < found.0 {
            let what = if t > 0.0 && t < 1.0 { Nearest::Edge(k) } else { Nearest::Vertex };
            found = (distance, on, what);
        }
    }
    found
}

/// Direction of an edge.
pub(crate) fn direction(at: &Placed, e: &Edge) -> Vector3<f64> {
    line(at, e).1.normalize()
}

/// A ball around `x` with the radius `radius` (a part of A) against a polytope of B.
pub(crate) fn ball(x: &Vector3<f64>, radius: f64, b: &Polytope, at: &Placed, margin: f64, id: u32, out: &mut Manifold) {
    let (distance, on, what) = nearest(b, at, x);
    if distance > radius + margin {
        return;
    }
    let depth = radius - distance;
    let (n, feature) = match what {
        Nearest::Face(f) => (at.normals[f], Feature::Face { x: *x, motion: Slide::Vertex, of_a: false }),
        _ => {
            let line = if let Nearest::Edge(k) = what { Some(direction(at, &b.edges[k])) } else { None };
            ((x - on) / distance, Feature::Point { x: *x, line, r: distance, reach: 0.0, of_a: false })
        }
    };
    out.push(Found { p: on - n * (0.5 * depth), n, depth, feature, id });
}

/// A rod (segment with a radius) of A against a polytope of B.
pub(crate) fn rod(ends: [Vector3<f64>; 2], radius: f64, b: &Polytope, at: &Placed, margin: f64, clip: &mut Clip, out: &mut Manifold) {
    // The best direction among faces, and the nearest of ends, edges and corners.
    let mut face = (f64::NEG_INFINITY, 0);
    for (f, n) in at.normals.iter().enumerate() {
        let gap = n.dot(&ends[0]).min(n.dot(&ends[1])) - at.vertices[b.corners(f)[0] as usize].dot(n);
        if gap > radius + margin {
            return;
        }
        if gap > face.0 {
            face = (gap, f);
        }
    }
    let d = ends[1] - ends[0];
    let mut crossing: Option<(f64, usize)> = None;
    for (k, e) in b.edges.iter().enumerate() {
        let (q, de) = line(at, e);
        let cross = d.cross(&de);
        let squared = cross.norm_squared();
        if squared < 1e-12 * d.norm_squared() * de.norm_squared() {
            continue;
        }
        let w = q - ends[0];
        let (s, t) = (w.cross(&de).dot(&cross) / squared, w.cross(&d).dot(&cross) / squared);
        if !(0.0..=1.0).contains(&s) || !(0.0..=1.0).contains(&t) {
            continue;
        }
        // Outside the body the normal leans between the edge's two faces.
        let outward = at.normals[e.faces[0] as usize] + at.normals[e.faces[1] as usize];
        let n = cross / squared.sqrt();
        let n = if n.dot(&outward) < 0.0 { -n } else { n };
        let across = [0, 1].map(|i| {
            let m = at.normals[e.faces[i] as usize];
            let inward = de.cross(&m);
            // The direction along the face, away from the edge, must not lean outward.
            let away = if inward.dot(&(at.center - q)) > 0.0 { inward } else { -inward };
            n.dot(&away) <= 1e-9 * away.norm()
        });
        if !(across[0] && across[1]) {
            continue;
        }
        let gap = n.dot(&(ends[0] - q));
        if crossing.is_none_or(|(g, _)| gap > g) {
            crossing = Some((gap, k));
        }
    }
    // Beside a face, only a crossing that parts the two as well says anything.
    let crossing = crossing.filter(|(gap, _)| face.0 <= 0.0 || *gap > 0.0);
    let touching = |p: &Vector3<f64>| nearest(b, at, p);
    let (near0, near1) = (touching(&ends[0]), touching(&ends[1]));
    let inside = face.0 <= 0.0 && crossing.is_none_or(|(g, _)| g <= 0.0) && (near0.0 <= 0.0 || near1.0 <= 0.0 || crossing.is_some());
    let by_face = inside && crossing.is_none_or(|(g, _)| face.0 >= g)
        || !inside
            && [&near0, &near1]
                .into_iter()
                .filter(|n| matches!(n.2, Nearest::Face(f) if f == face.1))
                .any(|n| crossing.is_none_or(|(g, _)| n.0 <= g.max(0.0) + 1e-9));
    if by_face {
        let n = at.normals[face.1];
        let corners = b.corners(face.1);
        start(clip, [(0, ends[0]), (1, ends[1])].into_iter());
        let mut segment = [(ends[0], Slide::Vertex), (ends[1], Slide::Vertex)];
        let mut empty = false;
        for k in 0..corners.len() {
            let (p, q) = (at.vertices[corners[k] as usize], at.vertices[corners[(k + 1) % corners.len()] as usize]);
            let m = (q - p).cross(&n).normalize();
            let (s, t) = (m.dot(&(segment[0].0 - p)), m.dot(&(segment[1].0 - p)));
            if s > 0.0 && t > 0.0 {
                empty = true;
                break;
            }
            if s > 0.0 || t > 0.0 {
                let x = segment[0].0 + (segment[1].0 - segment[0].0) * (s / (s - t));
                segment[usize::from(t > 0.0)] = (x, Slide::Crossing { e: d, m });
            }
        }
        if !empty {
            let plane = at.vertices[corners[0] as usize].dot(&n);
            for (k, (x, motion)) in segment.into_iter().enumerate() {
                let depth = radius + plane - n.dot(&x);
                if depth > -margin {
                    let feature = Feature::Face { x, motion, of_a: false };
                    out.push(Found { p: x - n * (radius - 0.5 * depth), n, depth, feature, id: k as u32 });
                }
            }
            return;
        }
    }
    let nearest_end = if near1.0 < near0.0 { 1 } else { 0 };
    let end = near0.0.min(near1.0);
    if let Some((gap, k)) = crossing
        && (inside || gap < end)
    {
        if gap > radius + margin {
            return;
        }
        let e = &b.edges[k];
        let (q, de) = line(at, e);
        let outward = at.normals[e.faces[0] as usize] + at.normals[e.faces[1] as usize];
        let (e_a, e_b) = (d.normalize(), de.normalize());
        let cross = e_a.cross(&e_b);
        let sign = if cross.dot(&outward) < 0.0 { -1.0 } else { 1.0 };
        let squared = cross.norm_squared();
        let n = cross * (sign / squared.sqrt());
        let w = q - ends[0];
        let x_a = ends[0] + e_a * (w.cross(&e_b).dot(&cross) / squared);
        let depth = radius - gap;
        let feature = Feature::Lines { x_a, e_a, e_b, sign, gap, reach: 0.0 };
        out.push(Found { p: x_a - n * (radius - 0.5 * depth), n, depth, feature, id: 3 << 24 | k as u32 });
        return;
    }
    // A corner of B may be nearest to the inside of the rod.
    let squared = d.norm_squared();
    let mut corner = (f64::INFINITY, 0, ends[0]);
    for (i, v) in at.vertices.iter().enumerate() {
        let t = d.dot(&(v - ends[0])) / squared;
        if t > 0.0 && t < 1.0 {
            let on = ends[0] + d * t;
            let distance = (on - v).norm();
            if distance < corner.0 {
                corner = (distance, i, on);
            }
        }
    }
    if corner.0 < end {
        if corner.0 > radius + margin || corner.0 < 1e-12 {
            return;
        }
        let x = at.vertices[corner.1];
        let n = (corner.2 - x) / corner.0;
        let depth = radius - corner.0;
        let feature = Feature::Point { x, line: Some(d.normalize()), r: corner.0, reach: radius, of_a: true };
        out.push(Found { p: x - n * (0.5 * depth), n, depth, feature, id: 4 << 24 | corner.1 as u32 });
        return;
    }
    ball(&ends[nearest_end], radius, b, at, margin, nearest_end as u32, out);
}
