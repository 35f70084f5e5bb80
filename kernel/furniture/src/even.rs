//! An object's surface as points spread evenly over all of it that is seen from a few places, as one samples a mesh.
//!
//! A camera's points are a grid of rays: they lie closer where a surface is near and faces the camera. Here a point is drawn on the surface of
//! all solids, any as likely as any other by area, and stays if no solid lies between it and the eye: so what is inside another solid goes, too.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::camera::{Camera, meet};
use crate::cloud::Labelled;
use crate::object::{Category, Form, Object, Solid};
use crate::random::Random;

/// How an object's surface is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Even {
    /// Places that it is seen from.
    pub views: usize,
    /// Points, of all places together.
    pub points: usize,
    /// Standard deviation along the line of sight, m.
    pub noise: f64,
}

/// Points that are tried for each that is wanted, at most.
const TRIES: usize = 12;

impl Even {
    /// What a mesh or a good scanner may give, drawn.
    pub fn draw(random: &mut Random) -> Self {
        let views = 1 + random.index(3);
        Self { views, points: random.scale(1_500.0, 30_000.0) as usize, noise: random.pick([0.0, 0.0005, 0.001, 0.002]) }
    }
}

/// A solid's faces by area: what is across axes 0, 1 and 2, both sides together; a cylinder's mantle stands in for two of them.
fn areas(s: &Solid) -> [f64; 3] {
    let h = s.half;
    match s.form {
        Form::Box => [8.0 * h.y * h.z, 8.0 * h.z * h.x, 8.0 * h.x * h.y],
        Form::Cylinder(axis) => {
            let r = h[(axis + 1) % 3];
            let mut areas = [0.0; 3];
            areas[axis] = TAU * r * r;
            areas[(axis + 1) % 3] = 2.0 * TAU * r * h[axis];
            areas
        }
    }
}

/// A point on a face, and the normal there, in the solid's frame.
fn on(s: &Solid, face: usize, random: &mut Random) -> (Point3<f64>, Vector3<f64>) {
    let side = random.pick([-1.0, 1.0]);
    let (mut p, mut n) = (Vector3::zeros(), Vector3::zeros());
    match s.form {
        Form::Cylinder(axis) => {
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            let angle = random.between(-PI, PI);
            let r = s.half[i] * if face == axis { random.unit().sqrt() } else { 1.0 };
            (p[i], p[j]) = (r * angle.cos(), r * angle.sin());
            if face == axis {
                p[axis] = side * s.half[axis];
                n[axis] = side;
            } else {
                p[axis] = random.between(-1.0, 1.0) * s.half[axis];
                (n[i], n[j]) = (angle.cos(), angle.sin());
            }
        }
        Form::Box => {
            (0..3).for_each(|k| p[k] = random.between(-1.0, 1.0) * s.half[k]);
            p[face] = side * s.half[face];
            n[face] = side;
        }
    }
    (s.center + p, n)
}

/// Places an object somewhere, at any yaw, and spreads points over what of it is seen from about its front.
pub fn evenly(object: &Object, how: &Even, random: &mut Random) -> Labelled {
    let X_WF = Isometry3::from_parts(
        Translation3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.0),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), random.between(-PI, PI)),
    );
    let (low, high) = object.bounds();
    let center = nalgebra::center(&low, &high);
    let X_FP: Vec<Isometry3<f64>> = object.X_FP();
    let mut faces: Vec<(f64, usize, &Solid, usize)> = Vec::new();
    let mut sum = 0.0;
    for (part, p) in object.parts.iter().enumerate() {
        for s in &p.solids {
            for (face, area) in areas(s).into_iter().enumerate() {
                sum += area;
                faces.push((sum, part, s, face));
            }
        }
    }
    let mut out = Labelled { points: Vec::new(), part: Vec::new(), view: Vec::new(), cameras: Vec::new(), X_WF };
    let side = random.pick([-1.0, 1.0]);
    let first = (0.5 * random.normal()).clamp(-1.2, 1.2);
    for view in 0..how.views {
        let azimuth = first + side * 0.7 * view as f64;
        let least = if object.category == Category::Box { 0.25 } else { 0.0 };
        let elevation = random.between(least, 0.9);
        let away = Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        let eye = center + away * ((high - low).norm() * random.between(0.9, 2.5)).max(0.3);
        let eyes: Vec<Point3<f64>> = X_FP.iter().map(|x| x.inverse() * eye).collect();
        let hidden = |p: &Point3<f64>| {
            object.parts.iter().zip(&X_FP).zip(&eyes).any(|((part, x), eye)| {
                let along = x.inverse() * p - eye;
                let inverse = along.map(|x| if x.abs() < 1e-12 { 1e12 } else { 1.0 / x });
                part.solids.iter().any(|s| meet(s, eye, &along, &inverse).is_some_and(|(t, _)| t < 1.0 - 1e-5))
            })
        };
        let wanted = how.points / how.views.max(1);
        let before = out.points.len();
        for _ in 0..TRIES * wanted {
            if out.points.len() - before >= wanted {
                break;
            }
            let at = random.unit() * sum;
            let Some((_, part, s, face)) = faces.get(faces.partition_point(|f| f.0 < at)) else { continue };
            let (p, n) = on(s, *face, random);
            if n.dot(&(eyes[*part] - p)) <= 0.0 || random.chance(s.dropout) {
                continue;
            }
            let p = X_FP[*part] * p;
            if !hidden(&p) {
                out.points.push(X_WF * (p + (eye - p).normalize() * (how.noise * random.normal())));
                out.part.push(*part as i32);
                out.view.push(view);
            }
        }
        out.cameras.push(Camera::looking(X_WF * eye, X_WF * center, 640, 480, 600.0));
    }
    out
}
