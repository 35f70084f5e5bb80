//! What a stereo depth camera makes of true depth.
//!
//! Axial noise and the step of a disparity grow with the square of distance (Nguyen, Izadi and Lovell 2012); rays along a surface and
//! rays at dark ones get lost; at an edge a pixel may lie between the near and the far side; whole spots have no depth; and the
//! arm knows the camera's pose only nearly.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::camera::{Camera, Hit};
use crate::random::Random;

/// How large the camera's errors are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Axial standard deviation at the camera, m.
    pub axial: f64,
    /// What it grows by with the square of distance, 1/m.
    pub axial_square: f64,
    /// Step of the depth at 1 m, growing with the square of distance, 1/m.
    pub step: f64,
    /// Share of pixels at an edge that lie between near and far.
    pub flying: f64,
    /// Cosine of incidence below which rays get lost.
    pub grazing: f64,
    /// Spots without depth in an image, at most.
    pub holes: usize,
    /// Error of the camera's pose, m.
    pub position: f64,
    /// The same, rad.
    pub angle: f64,
}

impl Noise {
    /// No error at all.
    pub const NONE: Self =
        Self { axial: 0.0, axial_square: 0.0, step: 0.0, flying: 0.0, grazing: 0.0, holes: 0, position: 0.0, angle: 0.0 };

    /// A camera of the usual kind, drawn.
    pub fn draw(random: &mut Random) -> Self {
        let quality = random.scale(0.4, 1.6);
        Self {
            axial: 0.0005 * quality,
            axial_square: 0.0015 * quality,
            step: 0.0012 * random.between(0.2, 1.5),
            flying: random.between(0.0, 0.4),
            grazing: random.between(0.08, 0.3),
            holes: random.index(5),
            position: 0.0015 * random.between(0.2, 1.5),
            angle: 0.0025 * random.between(0.2, 1.5),
        }
    }

    /// The same, depths and poses as many times as wrong.
    pub fn times(&self, factor: f64) -> Self {
        Self {
            axial: factor * self.axial,
            axial_square: factor * self.axial_square,
            step: factor * self.step,
            position: factor * self.position,
            angle: factor * self.angle,
            ..*self
        }
    }

    /// Spoils an image; what is lost becomes `None`.
    pub(crate) fn spoil(&self, camera: &Camera, image: &[Option<Hit>], random: &mut Random) -> Vec<Option<Hit>> {
        let (w, h) = (camera.width, camera.height);
        let holes: Vec<(f64, f64, f64)> = (0..self.holes)
            .map(|_| (random.between(0.0, w as f64), random.between(0.0, h as f64), w as f64 * random.between(0.005, 0.03)))
            .collect();
        let mut out = Vec::with_capacity(image.len());
        for (i, hit) in image.iter().enumerate() {
            let (column, row) = (i % w, i / w);
            let Some(mut hit) = *hit else {
                out.push(None);
                continue;
            };
            let lost = if hit.cosine < self.grazing { (1.0 - hit.cosine / self.grazing).sqrt() } else { 0.005 };
            if random.chance(lost.max(hit.dropout)) {
                out.push(None);
                continue;
            }
            if holes.iter().any(|&(x, y, r)| (column as f64 - x).hypot(row as f64 - y) < r) {
                out.push(None);
                continue;
            }
            let side = random.index(4);
            let neighbour = match side {
                0 if column > 0 => image[i - 1],
                1 if column + 1 < w => image[i + 1],
                2 if row > 0 => image[i - w],
                3 if row + 1 < h => image[i + w],
                _ => None,
            };
            if let Some(other) = neighbour
                && (other.depth - hit.depth).abs() > 0.02
                && random.chance(self.flying)
            {
                hit.depth += (other.depth - hit.depth) * random.unit();
            }
            let square = hit.depth * hit.depth;
            hit.depth += (self.axial + self.axial_square * square) * random.normal();
            let step = self.step * square;
            if step > 0.0 {
                hit.depth = (hit.depth / step).round() * step;
            }
            out.push(Some(hit));
        }
        out
    }

    /// A pose as the arm believes it.
    pub(crate) fn believed(&self, X_WC: &Isometry3<f64>, random: &mut Random) -> Isometry3<f64> {
        let mut three = || Vector3::new(random.normal(), random.normal(), random.normal());
        let error =
            Isometry3::from_parts(Translation3::from(three() * self.position), UnitQuaternion::from_scaled_axis(three() * self.angle));
        X_WC * error
    }
}
