//! Ray casting: what a pinhole depth camera sees of an object.
//!
//! A ray is carried into each part's frame; there all solids have their sides along the axes (slabs: Kay and Kajiya 1986).

use nalgebra::{Isometry3, Point3, Vector3};

use crate::object::{Form, Object, Solid};

/// A pinhole camera. Optical axes: x right, y down, z forward.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Its pose in the world.
    pub X_WC: Isometry3<f64>,
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Focal length, pixels.
    pub focal: f64,
}

impl Camera {
    /// Direction of a pixel's ray in C, with a unit z.
    pub fn ray(&self, column: usize, row: usize) -> Vector3<f64> {
        let x = (column as f64 + 0.5 - self.width as f64 / 2.0) / self.focal;
        let y = (row as f64 + 0.5 - self.height as f64 / 2.0) / self.focal;
        Vector3::new(x, y, 1.0)
    }

    /// A camera at a place that looks at another, upright.
    pub fn looking(from: Point3<f64>, at: Point3<f64>, width: usize, height: usize, focal: f64) -> Self {
        let z = (at - from).normalize();
        let x = z.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::y);
        let y = z.cross(&x);
        let R = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[x, y, z]));
        let X_WC = Isometry3::from_parts(from.coords.into(), nalgebra::UnitQuaternion::from_rotation_matrix(&R));
        Self { X_WC, width, height, focal }
    }
}

/// What a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Depth along the optical axis, m.
    pub depth: f64,
    /// The part, or -1 for the surroundings.
    pub part: i32,
    /// Cosine between the ray and the surface's normal.
    pub cosine: f64,
    /// Share of such rays that get lost.
    pub dropout: f64,
}

/// Distance along a ray to a solid, in units of the direction's length, and the normal there.
pub(crate) fn meet(solid: &Solid, from: &Point3<f64>, along: &Vector3<f64>, inverse: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let c = solid.center - from;
    let (mut enter, mut leave, mut side) = (0.0_f64, f64::INFINITY, usize::MAX);
    for k in 0..3 {
        let (a, b) = ((c[k] - solid.half[k]) * inverse[k], (c[k] + solid.half[k]) * inverse[k]);
        let (near, far) = if a < b { (a, b) } else { (b, a) };
        if near > enter {
            enter = near;
            side = k;
        }
        leave = leave.min(far);
        if enter > leave {
            return None;
        }
    }
    let flat = |side: usize| {
        let mut normal = Vector3::zeros();
        normal[side] = -along[side].signum();
        normal
    };
    match solid.form {
        Form::Box => (side < 3).then(|| (enter, flat(side))),
        Form::Cylinder(axis) => {
            // In the plane across the axis: |(o + t d)| = r. The box is met first, so caps are met where the box's ends are.
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            let r = solid.half[i];
            let (ox, oy, dx, dy) = (-c[i], -c[j], along[i], along[j]);
            if side == axis {
                let (x, y) = (ox + enter * dx, oy + enter * dy);
                if x * x + y * y <= r * r {
                    return Some((enter, flat(side)));
                }
            }
            let (a, b, k) = (dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - r * r);
            let discriminant = b * b - a * k;
            if discriminant < 0.0 || a == 0.0 {
                return None;
            }
            let t = (-b - discriminant.sqrt()) / a;
            if t < enter - 1e-12 || t > leave {
                return None;
            }
            let mut normal = Vector3::zeros();
            (normal[i], normal[j]) = ((ox + t * dx) / r, (oy + t * dy) / r);
            Some((t, normal))
        }
    }
}

/// Solids that share a frame P, seen from the camera.
struct Body<'a> {
    X_PC: Isometry3<f64>,
    part: i32,
    solids: &'a [Solid],
    /// A ball around them, in P.
    center: Point3<f64>,
    radius: f64,
}

impl<'a> Body<'a> {
    fn new(solids: &'a [Solid], X_WP: &Isometry3<f64>, part: i32, camera: &Camera) -> Self {
        let low = solids.iter().fold(Vector3::repeat(f64::INFINITY), |m, s| m.inf(&(s.center.coords - s.half)));
        let high = solids.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |m, s| m.sup(&(s.center.coords + s.half)));
        let center = Point3::from((low + high) / 2.0);
        Self { X_PC: X_WP.inverse() * camera.X_WC, part, solids, center, radius: (high - low).norm() / 2.0 }
    }
}

/// What every pixel sees of an object at `X_WF` and of boxes around it (walls, the floor; in W), row by row; `None` where it sees
/// nothing.
pub fn cast(camera: &Camera, object: &Object, X_WF: &Isometry3<f64>, surroundings: &[Solid]) -> Vec<Option<Hit>> {
    let mut bodies: Vec<Body<'_>> = Vec::new();
    for (index, (part, X_FP)) in object.parts.iter().zip(object.X_FP()).enumerate() {
        if !part.solids.is_empty() {
            bodies.push(Body::new(&part.solids, &(X_WF * X_FP), index as i32, camera));
        }
    }
    if !surroundings.is_empty() {
        bodies.push(Body::new(surroundings, &Isometry3::identity(), -1, camera));
    }
    let mut image = Vec::with_capacity(camera.width * camera.height);
    for row in 0..camera.height {
        for column in 0..camera.width {
            let ray = camera.ray(column, row);
            let mut nearest: Option<Hit> = None;
            for body in &bodies {
                let from = Point3::from(body.X_PC.translation.vector);
                let along = body.X_PC.rotation * ray;
                let toward = body.center - from;
                let off = toward - along * (toward.dot(&along) / along.norm_squared());
                if off.norm_squared() > body.radius * body.radius {
                    continue;
                }
                let inverse = along.map(|x| if x.abs() < 1e-12 { 1e12 } else { 1.0 / x });
                for solid in body.solids {
                    let Some((depth, normal)) = meet(solid, &from, &along, &inverse) else { continue };
                    if depth > 0.05 && nearest.is_none_or(|n| depth < n.depth) {
                        let cosine = normal.dot(&along).abs() / along.norm();
                        nearest = Some(Hit { depth, part: body.part, cosine, dropout: solid.dropout });
                    }
                }
            }
            image.push(nearest);
        }
    }
    image
}
