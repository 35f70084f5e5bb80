//! Objects of other makers: models with meshes, as they ship in the library or lie in a folder, seen by the same camera as drawn
//! furniture. Nothing was trained on them.
//!
//! Their triangles are drawn into a depth buffer (Catmull 1974). A model's front is taken to look along -y, as the library has it.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use sagci_furniture::{Camera, Category, Class, Hit, Joint, Kind, Labelled, Look, Object, Part, Random, Solid, look_with};
use sagci_model::{Geometry, JointKind, ObjectModel, Shape};

use super::Case;

/// Triangles around a circle.
const SEGMENTS: usize = 24;

type Triangle = [Point3<f64>; 3];

/// A model made ready to be looked at.
pub(super) struct Made {
    name: String,
    object: Object,
    /// Triangles of each part in F while all is shut, m.
    triangles: Vec<Vec<Triangle>>,
}

/// A shape's triangles in its link's frame.
fn triangles(shape: &Shape, out: &mut Vec<Triangle>, X: &Isometry3<f64>) {
    let X = X * shape.X_LG;
    let mut quad = |a: Point3<f64>, b: Point3<f64>, c: Point3<f64>, d: Point3<f64>| {
        out.push([X * a, X * b, X * c]);
        out.push([X * a, X * c, X * d]);
    };
    // A round thing is drawn with flat ends; a ball as a stack of rings.
    let mut turned = |profile: &[(f64, f64)]| {
        for k in 0..SEGMENTS {
            let at = |k: usize, (r, z): (f64, f64)| {
                let (s, c) = (std::f64::consts::TAU * k as f64 / SEGMENTS as f64).sin_cos();
                Point3::new(r * c, r * s, z)
            };
            for pair in profile.windows(2) {
                quad(at(k, pair[0]), at(k + 1, pair[0]), at(k + 1, pair[1]), at(k, pair[1]));
            }
        }
    };
    let ball = |radius: f64, half: f64| -> Vec<(f64, f64)> {
        (0..=12)
            .map(|i| {
                let (s, c) = (std::f64::consts::PI * f64::from(i) / 12.0).sin_cos();
                (radius * s, -radius * c + if i < 6 { -half } else { half })
            })
            .collect()
    };
    match &shape.geometry {
        Geometry::Sphere { radius } => turned(&ball(*radius, 0.0)),
        Geometry::Capsule { radius, half_length } => turned(&ball(*radius, *half_length)),
        Geometry::Cylinder { radius: r, half_length: h } => turned(&[(0.0, -h), (*r, -h), (*r, *h), (0.0, *h)]),
        Geometry::Box { half_extents: h } => {
            for k in 0..3 {
                for side in [-1.0, 1.0] {
                    let corner = |i: f64, j: f64| {
                        let mut p = Vector3::zeros();
                        (p[k], p[(k + 1) % 3], p[(k + 2) % 3]) = (side * h[k], i * h[(k + 1) % 3], j * h[(k + 2) % 3]);
                        Point3::from(p)
                    };
                    quad(corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0));
                }
            }
        }
        Geometry::Mesh { mesh, .. } => {
            out.extend(mesh.triangles.iter().map(|t| t.map(|i| X * mesh.vertices[i as usize])));
        }
    }
}

impl Made {
    /// `None` for a model without a part that turns or slides in the root, or without a surface.
    pub(super) fn new(model: &ObjectModel) -> Option<Self> {
        // F's x is the front, which looks along -y in O.
        let X_FO = Isometry3::rotation(Vector3::z() * std::f64::consts::FRAC_PI_2);
        let X_OL = model.X_OL(&vec![0.0; model.moving_joints().count()]);
        // Of each link the part that carries it: joints stand in the order of the tree.
        let mut part_of = vec![0; model.links.len()];
        let mut joints = Vec::new();
        for joint in &model.joints {
            let kind = match joint.kind {
                JointKind::Revolute | JointKind::Continuous => Kind::Revolute,
                JointKind::Prismatic => Kind::Prismatic,
                _ => {
                    part_of[joint.child] = part_of[joint.parent];
                    continue;
                }
            };
            if part_of[joint.parent] != 0 {
                return None;
            }
            let X_FJ = X_FO * X_OL[joint.child];
            // Where the range goes either way, the larger side opens.
            let (lower, upper) = (joint.limits.lower.max(-2.0), joint.limits.upper.min(2.0));
            let (sign, reach) = if upper >= -lower { (1.0, upper) } else { (-1.0, -lower) };
            let axis = Unit::new_normalize(X_FJ.rotation * joint.axis.into_inner() * sign);
            let origin = Point3::from(X_FJ.translation.vector);
            joints.push(Joint { part: joints.len() + 1, kind, axis, origin, upper: reach, state: 0.0 });
            part_of[joint.child] = joints.len();
        }
        let mut all: Vec<Vec<Triangle>> = vec![Vec::new(); joints.len() + 1];
        for (i, link) in model.links.iter().enumerate() {
            let shapes = if link.visuals.is_empty() { &link.collisions } else { &link.visuals };
            shapes.iter().for_each(|s| triangles(s, &mut all[part_of[i]], &(X_FO * X_OL[i])));
        }
        let parts: Vec<Part> = all
            .iter()
            .enumerate()
            .map(|(i, t)| {
                let points = || t.iter().flatten().map(|p| p.coords);
                let low = points().fold(Vector3::repeat(f64::INFINITY), |m, p| m.inf(&p));
                let high = points().fold(Vector3::repeat(f64::NEG_INFINITY), |m, p| m.sup(&p));
                let class = match i {
                    0 => Class::Body,
                    _ if joints[i - 1].kind == Kind::Prismatic => Class::Drawer,
                    _ => Class::Door,
                };
                Part { class, solids: vec![Solid::between(low.into(), high.into())] }
            })
            .collect();
        let name = model.name.clone();
        let whole = !joints.is_empty() && all.iter().all(|t| !t.is_empty());
        whole.then_some(Self {
            name,
            object: Object { category: Category::Storage, family: "other maker's", parts, joints },
            triangles: all,
        })
    }

    /// The object as drawn from a seed: its states, and how it is looked at.
    pub(super) fn case(&self, seed: u64, number: usize) -> Case {
        let mut random = Random::new(seed.wrapping_mul(7919).wrapping_add(number as u64), &self.name);
        let mut object = self.object.clone();
        loop {
            for joint in &mut object.joints {
                joint.state = joint.upper
                    * match random.index(20) {
                        0..=7 => 0.0,
                        8..=11 => random.between(0.02, 0.2),
                        _ => random.between(0.2, 1.0),
                    };
            }
            let how = Look { surroundings: false, ..Look::draw(&mut random) };
            let cloud: Labelled = look_with(&object, &how, &mut random, &|camera, X_WF, _| self.drawn(camera, &object, X_WF));
            if cloud.part.len() >= 1000 {
                return Case { name: format!("{}/{number}", self.name), object, cloud };
            }
        }
    }

    /// A depth buffer of all triangles.
    fn drawn(&self, camera: &Camera, object: &Object, X_WF: &Isometry3<f64>) -> Vec<Option<Hit>> {
        let mut image: Vec<Option<Hit>> = vec![None; camera.width * camera.height];
        for (part, (triangles, X_FP)) in self.triangles.iter().zip(object.X_FP()).enumerate() {
            let X_CP = camera.X_WC.inverse() * X_WF * X_FP;
            for t in triangles {
                draw(camera, &t.map(|p| X_CP * p), part as i32, &mut image);
            }
        }
        image
    }
}

/// Draws one triangle, in C. What reaches behind the camera is left out: cameras stand before objects.
fn draw(camera: &Camera, t: &Triangle, part: i32, image: &mut [Option<Hit>]) {
    if t.iter().any(|p| p.z < 0.05) {
        return;
    }
    let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let Some(normal) = normal.try_normalize(1e-15) else { return };
    let pixel =
        |p: &Point3<f64>| (camera.focal * p.x / p.z + camera.width as f64 / 2.0, camera.focal * p.y / p.z + camera.height as f64 / 2.0);
    let corners = t.map(|p| pixel(&p));
    let range = |of: &dyn Fn(&(f64, f64)) -> f64, end: usize| {
        let low = corners.iter().map(of).fold(f64::INFINITY, f64::min).floor().max(0.0) as usize;
        let high = corners.iter().map(of).fold(f64::NEG_INFINITY, f64::max).ceil().clamp(0.0, end as f64) as usize;
        low..high
    };
    let offset = normal.dot(&t[0].coords);
    for row in range(&|c| c.1, camera.height) {
        for column in range(&|c| c.0, camera.width) {
            let ray = camera.ray(column, row);
            let toward = normal.dot(&ray);
            if toward.abs() < 1e-9 {
                continue;
            }
            let depth = offset / toward;
            let p = Point3::from(ray * depth);
            // On one side of all three edges.
            let side = |a: &Point3<f64>, b: &Point3<f64>| (b - a).cross(&(p - a)).dot(&normal);
            let inside = side(&t[0], &t[1]) >= 0.0 && side(&t[1], &t[2]) >= 0.0 && side(&t[2], &t[0]) >= 0.0;
            let slot = &mut image[row * camera.width + column];
            if inside && depth > 0.05 && slot.is_none_or(|h| depth < h.depth) {
                *slot = Some(Hit { depth, part, cosine: toward.abs() / ray.norm(), dropout: 0.0 });
            }
        }
    }
}
