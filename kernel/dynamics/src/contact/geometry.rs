//! The shapes of a system that touch, fixed to their bodies, and which pairs of them are tested.
//!
//! Boxes, spheres, capsules, cylinders and planes are taken as they are. Each connected part of a mesh becomes its convex hull. A
//! cylinder is exact against planes; against all else it is a prism with [`SIDES`] sides of the same area across.
//!
//! Tested are all pairs of shapes but those on one body, those on two links that a joint joins, and those that were excluded. This is
//! the only module that speaks parry, which finds convex hulls.

use nalgebra::{Isometry3, Matrix3, Vector3};
use parry3d_f64::math::Vec3;
use parry3d_f64::shape::ConvexPolyhedron;
use parry3d_f64::transformation::try_convex_hull;
use sagci_model::{Geometry as Form, JointKind, Shape};

use super::point::Manifold;
use super::polytope::{self, Clip, Placed, Polytope};
use super::shapes::{self, Plane};
use super::{ContactMaterial, ContactOptions};
use crate::error::check;
use crate::joint::matrix;
use crate::{DynamicsError, Multibody, Part};

/// Sides of the prism that stands in for a cylinder.
const SIDES: u32 = 32;

/// The form of a shape in its own frame.
#[derive(Debug, Clone)]
pub(crate) enum Solid {
    /// Everything under its frame's xy plane.
    Plane,
    Sphere {
        radius: f64,
    },
    Capsule {
        radius: f64,
        half: f64,
    },
    Cylinder {
        radius: f64,
        half: f64,
        prism: Polytope,
    },
    Box {
        half: Vector3<f64>,
        hull: Polytope,
    },
    Hull(Polytope),
}

/// A shape on its body.
#[derive(Debug, Clone)]
pub(crate) struct Geometry {
    /// Its link as `part/link`, or the plane's name.
    pub name: String,
    pub body: usize,
    /// Index of its part; `None` for what belongs to the scene.
    pub part: Option<usize>,
    /// Index among the multibody's frames; `None` for what belongs to the scene.
    pub frame: Option<usize>,
    /// Pose on its link; for what belongs to the scene in the world.
    pub R_LG: Matrix3<f64>,
    pub p_LG: Vector3<f64>,
    /// Pose on its body.
    pub R_BG: Matrix3<f64>,
    pub p_BG: Vector3<f64>,
    pub solid: Solid,
    /// Radius around its frame's origin; infinite for planes.
    pub radius: f64,
    pub material: ContactMaterial,
}

/// Two shapes that can touch. `a` and `b` stand in the order that the functions of [`shapes`] want.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    pub a: usize,
    pub b: usize,
}

impl Geometry {
    fn rank(&self) -> u8 {
        match self.solid {
            Solid::Sphere { .. } => 0,
            Solid::Capsule { .. } => 1,
            Solid::Cylinder { .. } => 2,
            Solid::Hull(_) => 3,
            Solid::Box { .. } => 4,
            Solid::Plane => 5,
        }
    }

    pub fn new(
        name: String,
        body: usize,
        (part, frame): (Option<usize>, Option<usize>),
        X_LG: &Isometry3<f64>,
        solid: Solid,
        material: ContactMaterial,
    ) -> Result<Self, DynamicsError> {
        let fault = |message: String| DynamicsError::Shape { place: name.clone(), message };
        let lengths = match &solid {
            Solid::Plane | Solid::Hull(_) => vec![],
            Solid::Sphere { radius } => vec![*radius],
            Solid::Capsule { radius, half } | Solid::Cylinder { radius, half, .. } => vec![*radius, *half],
            Solid::Box { half, .. } => half.iter().copied().collect(),
        };
        if let Some(bad) = lengths.iter().find(|x| !(**x > 0.0 && x.is_finite())) {
            return Err(fault(format!("has a shape with a length of {bad}; lengths must be positive")));
        }
        if !X_LG.to_homogeneous().iter().all(|x| x.is_finite()) {
            return Err(fault("has a shape whose pose is not finite".into()));
        }
        let radius = match &solid {
            Solid::Plane => f64::INFINITY,
            Solid::Sphere { radius } => *radius,
            Solid::Capsule { radius, half } => radius + half,
            Solid::Cylinder { prism: hull, .. } | Solid::Box { hull, .. } | Solid::Hull(hull) => {
                hull.vertices.iter().map(|v| v.norm()).fold(0.0, f64::max)
            }
        };
        material.check(&name)?;
        let (R, p) = (matrix(&X_LG.rotation), X_LG.translation.vector);
        Ok(Self { name, body, part, frame, R_LG: R, p_LG: p, R_BG: R, p_BG: p, solid, radius, material })
    }

    /// Goes where its link is on the body.
    pub fn place(&mut self, multibody: &Multibody) {
        (self.R_BG, self.p_BG) = (self.R_LG, self.p_LG);
        if let Some(frame) = self.frame {
            let X = &multibody.frames[frame].X_BL;
            let R = matrix(&X.rotation);
            (self.R_BG, self.p_BG) = (R * self.R_LG, X.translation.vector + R * self.p_LG);
        }
    }

    fn hull(&self) -> Option<&Polytope> {
        match &self.solid {
            Solid::Cylinder { prism: hull, .. } | Solid::Box { hull, .. } | Solid::Hull(hull) => Some(hull),
            _ => None,
        }
    }
}

/// The collision shapes of all links.
pub(crate) fn of_parts(multibody: &Multibody, parts: &[Part<'_>], options: &ContactOptions) -> Result<Vec<Geometry>, DynamicsError> {
    let mut out = Vec::new();
    for (id, frame) in multibody.frames.iter().enumerate() {
        let name = format!("{}/{}", multibody.parts[frame.part], frame.name);
        let part = parts.get(frame.part).filter(|p| p.name == multibody.parts[frame.part]);
        let link = part.and_then(|p| p.model.links.iter().find(|l| l.name == frame.name)).ok_or_else(|| DynamicsError::Shape {
            place: name.clone(),
            message: "is not among these parts; give the parts that the system was made from".into(),
        })?;
        for shape in &link.collisions {
            for solid in solids(shape, &name)? {
                let part = (Some(frame.part), Some(id));
                let mut geometry = Geometry::new(name.clone(), frame.body, part, &shape.X_LG, solid, options.material)?;
                geometry.place(multibody);
                out.push(geometry);
            }
        }
    }
    Ok(out)
}

fn solids(shape: &Shape, name: &str) -> Result<Vec<Solid>, DynamicsError> {
    let flat = |what: &str| DynamicsError::Shape {
        place: name.into(),
        message: format!("has a {what} without volume, which cannot touch anything"),
    };
    Ok(match &shape.geometry {
        Form::Box { half_extents } => {
            let hull = Polytope::cuboid(half_extents).ok_or_else(|| flat("box"))?;
            vec![Solid::Box { half: *half_extents, hull }]
        }
        Form::Sphere { radius } => vec![Solid::Sphere { radius: *radius }],
        Form::Capsule { radius, half_length } => vec![Solid::Capsule { radius: *radius, half: *half_length }],
        Form::Cylinder { radius, half_length } => {
            let prism = Polytope::prism(*radius, *half_length, SIDES).ok_or_else(|| flat("cylinder"))?;
            vec![Solid::Cylinder { radius: *radius, half: *half_length, prism }]
        }
        Form::Mesh { mesh, file, .. } => {
            let what = format!("mesh '{}' with a part", file.display());
            let parts = connected_parts(mesh.vertices.len(), &mesh.triangles);
            if parts.is_empty() {
                return Err(flat(&what));
            }
            let mut out = Vec::new();
            for part in parts {
                let points: Vec<Vec3> = part.iter().map(|&i| mesh.vertices[i]).map(|v| Vec3::new(v.x, v.y, v.z)).collect();
                out.push(Solid::Hull(hull(&points).ok_or_else(|| flat(&what))?));
            }
            out
        }
    })
}

/// The convex hull, with triangles that lie in one plane joined.
fn hull(points: &[Vec3]) -> Option<Polytope> {
    if points.iter().any(|p| !p.is_finite()) {
        return None;
    }
    let (vertices, triangles) = try_convex_hull(points).ok()?;
    let joined = ConvexPolyhedron::from_convex_mesh(vertices.clone(), &triangles);
    let loops: Vec<Vec<u32>> = joined.as_ref().map_or_else(Vec::new, |h| {
        let corners = h.vertices_adj_to_face();
        let span = |first: u32, len: u32| corners[first as usize..(first + len) as usize].to_vec();
        h.faces().iter().map(|f| span(f.first_vertex_or_edge, f.num_vertices_or_edges)).collect()
    });
    let as_is = |points: &[Vec3]| points.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect::<Vec<_>>();
    joined
        .and_then(|h| Polytope::new(as_is(h.points()), &loops))
        .or_else(|| Polytope::new(as_is(&vertices), &triangles.iter().map(|t| t.to_vec()).collect::<Vec<_>>()))
}

/// Corner points of each set of triangles that hang together, in the order of their first corner.
fn connected_parts(vertices: usize, triangles: &[[u32; 3]]) -> Vec<Vec<usize>> {
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    let mut parent: Vec<usize> = (0..vertices).collect();
    let mut used = vec![false; vertices];
    for t in triangles {
        let [a, b, c] = t.map(|i| i as usize);
        if a.max(b).max(c) >= vertices {
            continue;
        }
        for x in [a, b, c] {
            used[x] = true;
        }
        for other in [b, c] {
            let (r, s) = (root(&mut parent, a), root(&mut parent, other));
            parent[r.max(s)] = r.min(s);
        }
    }
    let mut parts: std::collections::BTreeMap<usize, Vec<usize>> = std::collections::BTreeMap::new();
    for i in (0..vertices).filter(|&i| used[i]) {
        let r = root(&mut parent, i);
        parts.entry(r).or_default().push(i);
    }
    parts.into_values().collect()
}

/// All pairs that can touch, ordered by their bodies.
pub(crate) fn pairs(multibody: &Multibody, geometries: &[Geometry], excluded: &[[usize; 2]]) -> Vec<Pair> {
    let joined = |a: &Geometry, b: &Geometry| {
        let body = &multibody.bodies[b.body];
        b.body != 0 && body.parent == a.body && body.motion.kind != JointKind::Floating && (a.body != 0 || a.part == b.part)
    };
    let mut out = Vec::new();
    for i in 0..geometries.len() {
        for j in i + 1..geometries.len() {
            let (x, y) = (&geometries[i], &geometries[j]);
            let planes = matches!(x.solid, Solid::Plane) && matches!(y.solid, Solid::Plane);
            let apart = |e: &[usize; 2]| matches!((x.frame, y.frame), (Some(f), Some(g)) if *e == [f, g] || *e == [g, f]);
            if x.body == y.body || planes || joined(x, y) || joined(y, x) || excluded.iter().any(apart) {
                continue;
            }
            out.push(if x.rank() <= y.rank() { Pair { a: i, b: j } } else { Pair { a: j, b: i } });
        }
    }
    out.sort_by_key(|p| (geometries[p.a].body, geometries[p.b].body, p.a, p.b));
    out
}

/// Where the shapes are, and scratch of the search.
#[derive(Debug, Clone, Default)]
pub(crate) struct Poses {
    pub R: Vec<Matrix3<f64>>,
    pub p: Vec<Vector3<f64>>,
    placed: Vec<Placed>,
    fresh: Vec<bool>,
    clip: Clip,
}

impl Poses {
    pub fn new(geometries: &[Geometry]) -> Self {
        let n = geometries.len();
        let mut out = Self {
            R: vec![Matrix3::identity(); n],
            p: vec![Vector3::zeros(); n],
            placed: vec![Placed::default(); n],
            fresh: vec![false; n],
            clip: Clip::default(),
        };
        let largest = geometries.iter().filter_map(|g| g.hull()).map(|h| h.vertices.len()).max().unwrap_or(0);
        out.clip.reserve(2 * largest + 8);
        for (placed, g) in out.placed.iter_mut().zip(geometries) {
            if let Some(hull) = g.hull() {
                hull.place(&g.R_BG, &g.p_BG, placed);
            }
        }
        out
    }

    /// Takes the poses of the bodies.
    pub fn update(&mut self, geometries: &[Geometry], R_WB: &[Matrix3<f64>], p_WB: &[Vector3<f64>]) {
        for (i, g) in geometries.iter().enumerate() {
            let R = &R_WB[g.body];
            self.R[i] = R * g.R_BG;
            self.p[i] = p_WB[g.body] + R * g.p_BG;
        }
        self.fresh.fill(false);
    }

    fn place(&mut self, i: usize, hull: &Polytope) {
        if !self.fresh[i] {
            hull.place(&self.R[i], &self.p[i], &mut self.placed[i]);
            self.fresh[i] = true;
        }
    }

    fn plane(&self, i: usize) -> Plane {
        Plane { n: self.R[i].column(2).into_owned(), p: self.p[i] }
    }

    fn rod(&self, i: usize, half: f64) -> [Vector3<f64>; 2] {
        let along = self.R[i].column(2) * half;
        [self.p[i] - along, self.p[i] + along]
    }

    /// Can the pair be nearer than `margin`?
    #[inline]
    pub fn near(&self, pair: &Pair, geometries: &[Geometry], margin: f64) -> bool {
        let (a, b) = (&geometries[pair.a], &geometries[pair.b]);
        let between = self.p[pair.a] - self.p[pair.b];
        if b.radius.is_infinite() {
            return self.R[pair.b].column(2).dot(&between) < a.radius + margin;
        }
        let reach = a.radius + b.radius + margin;
        between.norm_squared() < reach * reach
    }

    /// Contact points of a pair, into `out`.
    pub fn collide(&mut self, pair: &Pair, geometries: &[Geometry], margin: f64, out: &mut Manifold) {
        out.found.clear();
        let (i, j) = (pair.a, pair.b);
        let (a, b) = (&geometries[i], &geometries[j]);
        match (&a.solid, &b.solid) {
            (Solid::Sphere { radius }, Solid::Plane) => shapes::ball_plane(&self.p[i], *radius, &self.plane(j), margin, 0, out),
            (Solid::Capsule { radius, half }, Solid::Plane) => {
                for (k, end) in self.rod(i, *half).iter().enumerate() {
                    shapes::ball_plane(end, *radius, &self.plane(j), margin, k as u32, out);
                }
            }
            (Solid::Cylinder { radius, half, .. }, Solid::Plane) => {
                shapes::cylinder_plane((&self.R[i], &self.p[i]), (*radius, *half), &self.plane(j), margin, out);
            }
            (Solid::Box { half, .. }, Solid::Plane) => {
                shapes::box_plane((&self.R[i], &self.p[i], half), &self.plane(j), margin, out);
            }
            (Solid::Hull(hull), Solid::Plane) => {
                self.place(i, hull);
                shapes::polytope_plane(&self.placed[i], &self.plane(j), margin, out);
            }
            (Solid::Sphere { radius: r }, Solid::Sphere { radius: s }) => {
                shapes::ball_ball((&self.p[i], *r), (&self.p[j], *s), margin, 0, out);
            }
            (Solid::Sphere { radius: r }, Solid::Capsule { radius: s, half }) => {
                shapes::ball_rod((&self.p[i], *r), (self.rod(j, *half), *s), margin, 0, out);
            }
            (Solid::Capsule { radius: r, half: f }, Solid::Capsule { radius: s, half: g }) => {
                shapes::rod_rod((self.rod(i, *f), *r), (self.rod(j, *g), *s), margin, out);
            }
            (Solid::Box { half: f, .. }, Solid::Box { half: g, .. }) => {
                polytope::boxes((&self.R[i], &self.p[i], f), (&self.R[j], &self.p[j], g), margin, &mut self.clip, out);
            }
            (Solid::Sphere { radius }, _) => {
                if let Some(hull) = b.hull() {
                    self.place(j, hull);
                    polytope::ball(&self.p[i], *radius, hull, &self.placed[j], margin, 0, out);
                }
            }
            (Solid::Capsule { radius, half }, _) => {
                if let Some(hull) = b.hull() {
                    self.place(j, hull);
                    polytope::rod(self.rod(i, *half), *radius, hull, &self.placed[j], margin, &mut self.clip, out);
                }
            }
            _ => {
                if let (Some(x), Some(y)) = (a.hull(), b.hull()) {
                    self.place(i, x);
                    self.place(j, y);
                    polytope::collide((x, &self.placed[i]), (y, &self.placed[j]), margin, &mut self.clip, out);
                }
            }
        }
        out.reduce();
    }
}

/// Poses given from outside must be finite.
pub(crate) fn check_pose(what: &'static str, X: &Isometry3<f64>) -> Result<(), DynamicsError> {
    check(what, X.to_homogeneous().as_slice(), 16)
}
