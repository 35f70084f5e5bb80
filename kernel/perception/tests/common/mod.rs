//! A small depth camera for tests: casts rays at models, and errs like a real one.
//!
//! It shares nothing with the code under test: shapes are cast as parry's own primitives. Noise is a part that is
//! independent in each pixel and a part that varies smoothly over about eight pixels, both growing with the square of
//! the depth; pixels at depth jumps fly between the surfaces or drop out; depth is rounded to a millimetre.
#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::Ray;
use parry3d_f64::shape::{Ball, Cuboid, SharedShape, TriMesh};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::{Geometry, ObjectModel};
use sagci_signal::DepthImage;

pub struct Body {
    shapes: Vec<(Isometry3<f64>, SharedShape)>,
}

impl Body {
    pub fn new(model: &ObjectModel, X_WO: &Isometry3<f64>, q: &[f64]) -> Self {
        let X_OL = model.X_OL(q);
        let mut shapes = Vec::new();
        for (link, X_OL) in model.links.iter().zip(X_OL) {
            let seen = if link.visuals.is_empty() { &link.collisions } else { &link.visuals };
            for shape in seen {
                let (X_GP, cast) = primitive(&shape.geometry);
                shapes.push((X_WO * X_OL * shape.X_LG * X_GP, cast));
            }
        }
        Self { shapes }
    }
}

fn primitive(geometry: &Geometry) -> (Isometry3<f64>, SharedShape) {
    // parry's cylinders stand along y.
    let upright = Isometry3::rotation(Vector3::x() * std::f64::consts::FRAC_PI_2);
    match geometry {
        Geometry::Box { half_extents: h } => (Isometry3::identity(), SharedShape::new(Cuboid::new(Vector::new(h.x, h.y, h.z)))),
        Geometry::Sphere { radius } => (Isometry3::identity(), SharedShape::new(Ball::new(*radius))),
        Geometry::Cylinder { radius, half_length } => (upright, SharedShape::cylinder(*half_length, *radius)),
        Geometry::Capsule { radius, half_length } => (upright, SharedShape::capsule_y(*half_length, *radius)),
        Geometry::Mesh { mesh, .. } => {
            let vertices = mesh.vertices.iter().map(|v| Vector::new(v.x, v.y, v.z)).collect();
            (Isometry3::identity(), SharedShape::new(TriMesh::new(vertices, mesh.triangles.clone()).unwrap()))
        }
    }
}

pub struct Camera {
    pub width: usize,
    pub height: usize,
    pub focal: f64,
    /// Standard deviation of the depth at 1 m, m.
    pub noise: f64,
}

impl Default for Camera {
    /// 160 x 120 pixels, 60 degrees wide, 2 mm at 0.7 m.
    fn default() -> Self {
        Self { width: 160, height: 120, focal: 138.0, noise: 0.002 / 0.49 }
    }
}

/// A camera pose that looks from one point to another, level.
pub fn look(from: [f64; 3], to: [f64; 3]) -> Isometry3<f64> {
    let (from, to) = (Point3::from(from), Point3::from(to));
    let z = (to - from).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let y = z.cross(&x);
    let R = nalgebra::Rotation3::from_basis_unchecked(&[x, y, z]);
    Isometry3::from_parts(Translation3::from(from.coords), UnitQuaternion::from_rotation_matrix(&R))
}

impl Camera {
    pub fn image(&self, X_WC: &Isometry3<f64>, bodies: &[&Body], table: f64, seed: u64) -> DepthImage {
        let mut random = Pcg64::seed_from_u64(seed);
        let (w, h) = (self.width, self.height);
        let center = [(w as f64 - 1.0) / 2.0, (h as f64 - 1.0) / 2.0];
        let origin = X_WC.translation.vector;
        let mut clean = vec![0.0; w * h];
        for row in 0..h {
            for column in 0..w {
                let ray_C = Vector3::new((column as f64 - center[0]) / self.focal, (row as f64 - center[1]) / self.focal, 1.0);
                let ray_W = X_WC * ray_C;
                let mut z = if ray_W.z < -1e-6 { (table - origin.z) / ray_W.z } else { f64::INFINITY };
                for body in bodies {
                    for (X, shape) in &body.shapes {
                        let (o, d) = (X.inverse_transform_point(&Point3::from(origin)), X.inverse_transform_vector(&ray_W));
                        let ray = Ray::new(Vector::new(o.x, o.y, o.z), Vector::new(d.x, d.y, d.z));
                        if let Some(t) = shape.cast_local_ray(&ray, z, false) {
                            z = z.min(t);
                        }
                    }
                }
                clean[row * w + column] = if z < 3.0 { z } else { 0.0 };
            }
        }
        const PITCH: usize = 8;
        let (cw, ch) = (w / PITCH + 2, h / PITCH + 2);
        let smooth: Vec<f64> = (0..cw * ch).map(|_| gaussian(&mut random)).collect();
        let mut depth = vec![0f32; w * h];
        for row in 0..h {
            for column in 0..w {
                let mut z = clean[row * w + column];
                let around = |dr: i64, dc: i64| {
                    let (r, c) = (row as i64 + dr, column as i64 + dc);
                    if r < 0 || c < 0 || r >= h as i64 || c >= w as i64 { z } else { clean[r as usize * w + c as usize] }
                };
                let other = [around(0, 1), around(1, 0), around(0, -1), around(-1, 0)].into_iter().find(|o| (o - z).abs() > 0.05);
                let chance: f64 = random.random();
                if let Some(other) = other {
                    if chance < 0.3 {
                        z += (other - z) * random.random::<f64>();
                    } else if chance < 0.45 {
                        z = 0.0;
                    }
                } else if chance < 0.01 {
                    z = 0.0;
                }
                if z > 0.0 {
                    let (fr, fc) = (row as f64 / PITCH as f64, column as f64 / PITCH as f64);
                    let (r, c) = (fr as usize, fc as usize);
                    let (ar, ac) = (fr - r as f64, fc - c as f64);
                    let at = |r: usize, c: usize| smooth[r * cw + c];
                    let field =
                        (1.0 - ar) * ((1.0 - ac) * at(r, c) + ac * at(r, c + 1)) + ar * ((1.0 - ac) * at(r + 1, c) + ac * at(r + 1, c + 1));
                    z += self.noise * z * z * (0.9 * gaussian(&mut random) + 0.45 * field);
                    depth[row * w + column] = ((z * 1000.0).round() / 1000.0) as f32;
                }
            }
        }
        DepthImage { time: 0.0, width: w, height: h, focal: [self.focal; 2], center, depth, rgb: vec![[128; 3]; w * h] }
    }
}

pub fn gaussian(random: &mut impl Rng) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

pub fn within(random: &mut impl Rng, half_width: f64) -> f64 {
    (random.random::<f64>() * 2.0 - 1.0) * half_width
}

pub fn yawed(x: f64, y: f64, z: f64, yaw: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::new(x, y, z), Vector3::z() * yaw)
}

/// The `share` quantile.
pub fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// "median / 90 % / greatest" of errors, in thousandths.
pub fn distribution(values: &[f64]) -> String {
    format!("{:.2} / {:.2} / {:.2}", quantile(values, 0.5) * 1e3, quantile(values, 0.9) * 1e3, quantile(values, 1.0) * 1e3)
}

pub fn model(urdf: &str) -> ObjectModel {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("object.urdf"), urdf).unwrap();
    ObjectModel::read(folder.path()).unwrap()
}

pub fn model_with(urdf: &str, document: &str) -> ObjectModel {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("object.urdf"), urdf).unwrap();
    std::fs::write(folder.path().join("model.yaml"), document).unwrap();
    ObjectModel::read(folder.path()).unwrap()
}

pub fn stored(name: &str) -> Option<ObjectModel> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models").join(name);
    ObjectModel::read(folder).ok()
}

fn visual(xyz: [f64; 3], size: [f64; 3]) -> String {
    let [x, y, z] = xyz;
    let [a, b, c] = size;
    format!("<visual><origin xyz='{x} {y} {z}'/><geometry><box size='{a} {b} {c}'/></geometry></visual>")
}

/// An oven of 0.48 x 0.36 x 0.28 m that opens toward -x, with a door on the right and a bar for a handle.
pub fn oven() -> ObjectModel {
    let (x, y, z) = (0.36, 0.48, 0.28);
    let wall = 0.015;
    let body = [
        visual([0.0, 0.0, wall / 2.0], [x, y, wall]),
        visual([0.0, 0.0, z - wall / 2.0], [x, y, wall]),
        visual([x / 2.0 - wall / 2.0, 0.0, z / 2.0], [wall, y, z]),
        visual([0.0, y / 2.0 - wall / 2.0, z / 2.0], [x, wall, z]),
        visual([0.0, -y / 2.0 + 0.06, z / 2.0], [x, 0.12, z]),
    ]
    .concat();
    let door = [
        visual([-0.0125, -0.17, 0.14], [0.025, 0.35, 0.27]),
        visual([-0.055, -0.30, 0.14], [0.014, 0.014, 0.18]),
        visual([-0.035, -0.30, 0.06], [0.045, 0.014, 0.014]),
        visual([-0.035, -0.30, 0.22], [0.045, 0.014, 0.014]),
    ]
    .concat();
    model_with(
        &format!(
            "<robot name='oven'><link name='body'>{body}</link><link name='door'>{door}</link>\
             <joint name='hinge' type='revolute'><parent link='body'/><child link='door'/>\
             <origin xyz='-0.18 0.23 0'/><axis xyz='0 0 -1'/><limit lower='0' upper='1.9' effort='50' velocity='3'/></joint></robot>"
        ),
        "schema: 1\nregions: [{name: cavity, link: body, center: [0.0, 0.05, 0.135], size: [0.3, 0.3, 0.24], opening: [-1, 0, 0]}]\n",
    )
}

/// A mug of 0.08 m width and 0.09 m height: sixteen walls, a floor, and a handle toward +x.
pub fn mug() -> ObjectModel {
    let mut shapes = String::new();
    for i in 0..16 {
        let turn = f64::from(i) * std::f64::consts::TAU / 16.0;
        let (x, y) = (0.038 * turn.cos(), 0.038 * turn.sin());
        shapes +=
            &format!("<visual><origin xyz='{x} {y} 0.045' rpy='0 0 {turn}'/><geometry><box size='0.004 0.0155 0.09'/></geometry></visual>");
    }
    shapes += "<visual><origin xyz='0 0 0.003'/><geometry><cylinder radius='0.038' length='0.006'/></geometry></visual>";
    shapes += &visual([0.052, 0.0, 0.07], [0.028, 0.012, 0.01]);
    shapes += &visual([0.052, 0.0, 0.025], [0.028, 0.012, 0.01]);
    shapes += &visual([0.064, 0.0, 0.0475], [0.01, 0.012, 0.055]);
    model(&format!("<robot name='mug'><link name='mug'>{shapes}</link></robot>"))
}

/// A cabinet whose drawer slides out toward -x.
pub fn cabinet() -> ObjectModel {
    let body = [
        visual([0.0, 0.0, 0.005], [0.3, 0.4, 0.01]),
        visual([0.0, 0.0, 0.195], [0.3, 0.4, 0.01]),
        visual([0.145, 0.0, 0.1], [0.01, 0.4, 0.2]),
        visual([0.0, 0.195, 0.1], [0.3, 0.01, 0.2]),
        visual([0.0, -0.195, 0.1], [0.3, 0.01, 0.2]),
    ]
    .concat();
    let drawer = [
        visual([-0.16, 0.0, 0.1], [0.02, 0.37, 0.17]),
        visual([-0.01, 0.0, 0.03], [0.28, 0.36, 0.008]),
        visual([-0.01, 0.18, 0.07], [0.28, 0.008, 0.08]),
        visual([-0.01, -0.18, 0.07], [0.28, 0.008, 0.08]),
        visual([0.126, 0.0, 0.07], [0.008, 0.36, 0.08]),
        visual([-0.2, 0.0, 0.1], [0.012, 0.14, 0.012]),
        visual([-0.185, 0.06, 0.1], [0.03, 0.012, 0.012]),
        visual([-0.185, -0.06, 0.1], [0.03, 0.012, 0.012]),
    ]
    .concat();
    model_with(
        &format!(
            "<robot name='cabinet'><link name='body'>{body}</link><link name='drawer'>{drawer}</link>\
             <joint name='slide' type='prismatic'><parent link='body'/><child link='drawer'/>\
             <axis xyz='-1 0 0'/><limit lower='0' upper='0.25' effort='50' velocity='1'/></joint></robot>"
        ),
        "schema: 1\nregions: [{name: tray, link: drawer, center: [-0.01, 0.0, 0.074], size: [0.26, 0.34, 0.08], opening: [0, 0, 1]}]\n",
    )
}

/// A roll of tape: a ring of 0.1 m width lying flat, made of twelve pieces.
pub fn tape() -> ObjectModel {
    let mut shapes = String::new();
    for i in 0..12 {
        let turn = f64::from(i) * std::f64::consts::TAU / 12.0;
        let (x, y) = (0.0425 * turn.cos(), 0.0425 * turn.sin());
        shapes +=
            &format!("<visual><origin xyz='{x} {y} 0.02' rpy='0 0 {turn}'/><geometry><box size='0.015 0.026 0.04'/></geometry></visual>");
    }
    model(&format!("<robot name='tape'><link name='tape'>{shapes}</link></robot>"))
}
