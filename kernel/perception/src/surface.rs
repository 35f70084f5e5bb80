//! The stored geometry as a camera sees it: each link's triangles, even samples of them with normals, and rays.
//!
//! Samples are laid out by systematic sampling over the cumulated area (one sample each `area / count`), placed inside
//! a triangle by Roberts' R2 low-discrepancy sequence: even, and the same for the same model.

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::TriMesh;
use sagci_model::{Geometry, Link, ObjectModel, Shape};

/// What can be seen of one object model.
pub(crate) struct Surface {
    /// One for each link of the model.
    pub links: Vec<LinkSurface>,
    /// Total area, m^2.
    pub area: f64,
}

/// What can be seen of one link, in its own frame.
pub(crate) struct LinkSurface {
    mesh: Option<TriMesh>,
    triangles: Vec<[Point3<f64>; 3]>,
    area: f64,
}

/// A point of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Place in the link's frame.
    pub point: Point3<f64>,
    /// Unit normal, outward.
    pub normal: Vector3<f64>,
}

/// What a ray hits first.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    /// Distance along the ray in units of its direction's length.
    pub distance: f64,
    /// Unit normal toward the ray's origin.
    pub normal: Vector3<f64>,
    /// The link that was hit.
    pub link: usize,
}

impl Surface {
    /// The visible geometry of a model: visual shapes, or where a link has none, the shapes that touch.
    pub fn of(model: &ObjectModel) -> Self {
        Self::build(model, |link| if link.visuals.is_empty() { &link.collisions } else { &link.visuals })
    }

    /// The same from the shapes that touch: they are coarser and enclose what is seen.
    pub fn of_contact(model: &ObjectModel) -> Self {
        Self::build(model, |link| if link.collisions.is_empty() { &link.visuals } else { &link.collisions })
    }

    fn build(model: &ObjectModel, shapes: impl Fn(&Link) -> &Vec<Shape>) -> Self {
        let links: Vec<_> = model.links.iter().map(|l| LinkSurface::of(shapes(l))).collect();
        let area = links.iter().map(|l| l.area).sum();
        Self { links, area }
    }

    /// Casts a ray of the world at the object whose links are at `X_WL`.
    pub fn cast(&self, X_WL: &[Isometry3<f64>], origin: &Point3<f64>, direction: &Vector3<f64>, farthest: f64) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (link, (surface, X)) in self.links.iter().zip(X_WL).enumerate() {
            let Some(mesh) = &surface.mesh else { continue };
            let ray = Ray::new(to_parry(&X.inverse_transform_point(origin).coords), to_parry(&X.inverse_transform_vector(direction)));
            let limit = best.map_or(farthest, |b| b.distance);
            if let Some(hit) = mesh.cast_local_ray_and_get_normal(&ray, limit, false) {
                let normal = X * from_parry(hit.normal);
                let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
                best = Some(Hit { distance: hit.time_of_impact, normal, link });
            }
        }
        best
    }

    /// Is a point of the world within `margin` of the object?
    pub fn is_near(&self, X_WL: &[Isometry3<f64>], point: &Point3<f64>, margin: f64) -> bool {
        self.links.iter().zip(X_WL).any(|(surface, X)| {
            let Some(mesh) = &surface.mesh else { return false };
            mesh.project_local_point_with_max_dist(to_parry(&X.inverse_transform_point(point).coords), false, margin).is_some()
        })
    }

    /// Corner points of all triangles, with the index of their link.
    pub fn corners(&self) -> impl Iterator<Item = (usize, &Point3<f64>)> {
        self.links.iter().enumerate().flat_map(|(i, l)| l.triangles.iter().flatten().map(move |p| (i, p)))
    }
}

impl LinkSurface {
    fn of(shapes: &[Shape]) -> Self {
        let mut triangles = Vec::new();
        for shape in shapes {
            tessellate(&shape.geometry, &mut |a, b, c| {
                triangles.push([shape.X_LG * a, shape.X_LG * b, shape.X_LG * c]);
            });
        }
        triangles.retain(|t| (t[1] - t[0]).cross(&(t[2] - t[0])).norm() > 1e-12);
        let area = triangles.iter().map(|t| (t[1] - t[0]).cross(&(t[2] - t[0])).norm() / 2.0).sum();
        let vertices = triangles.iter().flatten().map(|p| to_parry(&p.coords)).collect();
        let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = if triangles.is_empty() { None } else { TriMesh::new(vertices, indices).ok() };
        Self { mesh, triangles, area }
    }

    /// Even samples, one for each `cell` of area, m^2.
    pub fn samples(&self, cell: f64) -> Vec<Sample> {
        // Roberts: the plastic number's reciprocal and its square.
        const R2: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
        let mut samples = Vec::new();
        let (mut covered, mut next) = (0.0, cell / 2.0);
        for t in &self.triangles {
            let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
            let area = normal.norm() / 2.0;
            let normal = normal.normalize();
            covered += area;
            while next < covered {
                let k = samples.len() as f64 + 1.0;
                let (mut a, mut b) = ((0.5 + k * R2[0]).fract(), (0.5 + k * R2[1]).fract());
                if a + b > 1.0 {
                    (a, b) = (1.0 - a, 1.0 - b);
                }
                samples.push(Sample { point: t[0] + (t[1] - t[0]) * a + (t[2] - t[0]) * b, normal });
                next += cell;
            }
        }
        samples
    }
}

/// Samples of one link in cells, to find the nearest one fast.
pub(crate) struct SampleGrid {
    /// The samples, cell by cell.
    pub samples: Vec<Sample>,
    starts: Vec<u32>,
    lower: Point3<f64>,
    counts: [usize; 3],
    cell: f64,
}

impl SampleGrid {
    /// Sorts samples into cubes of edge length `cell`, m.
    pub fn new(samples: Vec<Sample>, cell: f64) -> Self {
        let (mut lower, mut upper) = (Point3::from(Vector3::repeat(f64::INFINITY)), Point3::from(Vector3::repeat(f64::NEG_INFINITY)));
        for s in &samples {
            lower = lower.inf(&s.point);
            upper = upper.sup(&s.point);
        }
        if samples.is_empty() {
            return Self { samples, starts: vec![0, 0], lower: Point3::origin(), counts: [1; 3], cell };
        }
        let counts = [0, 1, 2].map(|k| ((upper[k] - lower[k]) / cell) as usize + 1);
        let mut grid = Self { samples: Vec::with_capacity(samples.len()), starts: Vec::new(), lower, counts, cell };
        let index = |p: &Point3<f64>| {
            let c = [0, 1, 2].map(|k| (((p[k] - lower[k]) / cell) as usize).min(counts[k] - 1));
            (c[2] * counts[1] + c[1]) * counts[0] + c[0]
        };
        let mut order: Vec<(usize, usize)> = samples.iter().enumerate().map(|(i, s)| (index(&s.point), i)).collect();
        order.sort_unstable();
        grid.starts = vec![0; counts[0] * counts[1] * counts[2] + 1];
        for (c, i) in order {
            grid.starts[c + 1] += 1;
            grid.samples.push(samples[i]);
        }
        for c in 1..grid.starts.len() {
            grid.starts[c] += grid.starts[c - 1];
        }
        grid
    }

    /// The sample nearest to a point of the link's frame among those whose normals lie within 60 degrees of `normal`,
    /// with its squared distance; nothing beyond `radius`.
    pub fn nearest(&self, point: &Point3<f64>, normal: &Vector3<f64>, radius: f64) -> Option<(&Sample, f64)> {
        if self.samples.is_empty() {
            return None;
        }
        let mut range = [(0usize, 0usize); 3];
        for k in 0..3 {
            let low = (point[k] - radius - self.lower[k]) / self.cell;
            let high = (point[k] + radius - self.lower[k]) / self.cell;
            if high < 0.0 || low >= self.counts[k] as f64 {
                return None;
            }
            range[k] = (low.max(0.0) as usize, (high as usize).min(self.counts[k] - 1));
        }
        let mut best: Option<(&Sample, f64)> = None;
        let mut limit = radius * radius;
        for z in range[2].0..=range[2].1 {
            for y in range[1].0..=range[1].1 {
                let row = (z * self.counts[1] + y) * self.counts[0];
                let (from, to) = (self.starts[row + range[0].0] as usize, self.starts[row + range[0].1 + 1] as usize);
                for s in &self.samples[from..to] {
                    let d2 = (s.point - point).norm_squared();
                    if d2 < limit && s.normal.dot(normal) > 0.5 {
                        limit = d2;
                        best = Some((s, d2));
                    }
                }
            }
        }
        best
    }
}

fn tessellate(geometry: &Geometry, emit: &mut dyn FnMut(Point3<f64>, Point3<f64>, Point3<f64>)) {
    match geometry {
        Geometry::Box { half_extents: h } => {
            let corner = |i: usize| {
                let side = |bit: usize, v: f64| if i & bit == 0 { -v } else { v };
                Point3::new(side(1, h.x), side(2, h.y), side(4, h.z))
            };
            for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
                emit(corner(a), corner(b), corner(c));
                emit(corner(a), corner(c), corner(d));
            }
        }
        Geometry::Sphere { radius } => revolve(&arc(*radius, 0.0, -1.0, 1.0), emit),
        Geometry::Cylinder { radius, half_length } => {
            revolve(&[[0.0, -half_length], [*radius, -half_length], [*radius, *half_length], [0.0, *half_length]], emit);
        }
        Geometry::Capsule { radius, half_length } => {
            let mut profile = arc(*radius, -half_length, -1.0, 0.0);
            profile.extend(arc(*radius, *half_length, 0.0, 1.0));
            revolve(&profile, emit);
        }
        Geometry::Mesh { mesh, .. } => {
            for t in &mesh.triangles {
                let corners = t.map(|i| mesh.vertices.get(i as usize));
                if let [Some(a), Some(b), Some(c)] = corners {
                    emit(*a, *b, *c);
                }
            }
        }
    }
}

/// Number of segments of a full turn: at 64 the chord of a 0.1 m circle lies 0.12 mm inside it.
const SEGMENTS: usize = 64;

/// Points of a quarter-turn profile or a half-turn one: radius and height, from latitude `from` to `to` in right angles.
fn arc(radius: f64, height: f64, from: f64, to: f64) -> Vec<[f64; 2]> {
    let steps = ((to - from) * SEGMENTS as f64 / 4.0) as usize;
    (0..=steps)
        .map(|i| {
            let (sin, cos) = ((from + (to - from) * i as f64 / steps as f64) * std::f64::consts::FRAC_PI_2).sin_cos();
            [radius * cos, height + radius * sin]
        })
        .collect()
}

/// The surface swept by a profile of radius and height, from the lower pole to the upper one.
fn revolve(profile: &[[f64; 2]], emit: &mut dyn FnMut(Point3<f64>, Point3<f64>, Point3<f64>)) {
    for i in 0..SEGMENTS {
        let turn = |k: usize| (k as f64 * std::f64::consts::TAU / SEGMENTS as f64).sin_cos();
        let ((s0, c0), (s1, c1)) = (turn(i), turn(i + 1));
        for pair in profile.windows(2) {
            let ([r0, z0], [r1, z1]) = (pair[0], pair[1]);
            let (a, b) = (Point3::new(r0 * c0, r0 * s0, z0), Point3::new(r0 * c1, r0 * s1, z0));
            let (c, d) = (Point3::new(r1 * c1, r1 * s1, z1), Point3::new(r1 * c0, r1 * s0, z1));
            emit(a, b, c);
            emit(a, c, d);
        }
    }
}

fn to_parry(v: &Vector3<f64>) -> ParryVector {
    ParryVector::new(v.x, v.y, v.z)
}

fn from_parry(v: ParryVector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}
