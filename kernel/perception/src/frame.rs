//! One image made ready: points and normals in the world, and which of them may belong to an object.
//!
//! A plane `n . p = d` seen through a pinhole has inverse depth `1/z = (n / d) . (x, y, 1)`, linear in the normalised
//! pixel coordinates; so a normal is a linear least-squares fit of the inverse depth in a window, and its residual says
//! whether the window lies on one surface.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use crate::surface::Surface;
use crate::{PerceptionError, View};

/// Half of the window that a normal is fitted in, pixels.
const REACH: usize = 2;
/// A normal needs this many pixels of its window on one surface.
const SUPPORT: usize = 9;
/// Points this near to a body whose place is known belong to it, m.
const KNOWN_MARGIN: f64 = 0.012;
/// Points this near to the table belong to it, m, and so many standard deviations of the depth's noise more.
const TABLE_MARGIN: f64 = 0.004;
const TABLE_DEVIATIONS: f64 = 2.5;
/// Points this near to the table may show how the camera is mounted, m.
const TABLE_REACH: f64 = 0.03;

/// A pixel with a point and a normal.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pixel {
    /// Place in the world.
    pub point: Point3<f64>,
    /// Unit normal in the world, toward the camera.
    pub normal: Vector3<f64>,
    /// Column in the image.
    pub column: usize,
    /// Row in the image.
    pub row: usize,
}

/// One image made ready.
pub(crate) struct Frame {
    pub width: usize,
    pub height: usize,
    pub focal: [f64; 2],
    pub center: [f64; 2],
    pub X_WC: Isometry3<f64>,
    /// Measured depth, m; 0 where nothing was measured.
    pub depth: Vec<f64>,
    /// Least depth of the pixel and its eight neighbours, m; 0 where the pixel itself was not measured.
    pub nearest: Vec<f64>,
    /// For each pixel of the image: its point may belong to an object.
    pub open: Vec<bool>,
    /// Of these, the pixels on smooth surface.
    pub pixels: Vec<Pixel>,
    /// For each pixel of the image, its place in `pixels`, or `u32::MAX`.
    pub slot: Vec<u32>,
    /// Standard deviation of the depth at 1 m as the plane fits show it, m; it grows with the square of the depth.
    pub noise: f64,
}

impl Frame {
    /// Checks an image and fits its normals.
    pub fn new(view: &View) -> Result<Self, PerceptionError> {
        let image = &view.image;
        let refuse = |message: String| PerceptionError::Image { time: image.time, message };
        let (width, height) = (image.width, image.height);
        if width == 0 || height == 0 || image.depth.len() != width.saturating_mul(height) {
            return Err(refuse(format!("says {width} x {height} pixels, but holds {} depths", image.depth.len())));
        }
        let finite = image.focal.iter().all(|f| f.is_finite() && *f > 0.0) && image.center.iter().all(|c| c.is_finite());
        if !finite || !view.X_WC.to_matrix().iter().all(|x| x.is_finite()) {
            return Err(refuse("has a focal length, principal point or camera pose that is not a finite number".into()));
        }
        let depth: Vec<f64> = image.depth.iter().map(|d| if d.is_finite() && *d > 0.0 { f64::from(*d) } else { 0.0 }).collect();
        let nearest = least_of_neighbours(&depth, width, height);
        let mut frame = Self {
            width,
            height,
            focal: image.focal,
            center: image.center,
            X_WC: view.X_WC,
            open: depth.iter().map(|z| *z > 0.0).collect(),
            depth,
            nearest,
            pixels: Vec::new(),
            slot: vec![u32::MAX; width * height],
            noise: 0.0,
        };
        frame.fit_normals();
        let known: Vec<_> = view.known.iter().map(|b| (Surface::of_contact(&b.model), &b.X_WL)).collect();
        frame.keep(|p| !known.iter().any(|(s, X_WL)| s.is_near(X_WL, p, KNOWN_MARGIN)));
        Ok(frame)
    }

    /// The points that may lie on the table.
    pub fn table_points(&self, table_height: f64) -> Vec<Pixel> {
        let on_table = |p: &&Pixel| (p.point.z - table_height).abs() < TABLE_REACH && p.normal.z > 0.9;
        self.pixels.iter().filter(on_table).copied().collect()
    }

    /// Takes the table's points out.
    pub fn drop_table(&mut self, table_height: f64) {
        let (eye, noise) = (self.eye(), self.noise);
        self.keep(|p| {
            let away = p - eye;
            // Noise lies along the ray: its part along the vertical counts.
            let deviation = noise * away.norm_squared() * (away.z / away.norm()).abs();
            p.z > table_height + TABLE_MARGIN + TABLE_DEVIATIONS * deviation
        });
    }

    /// Moves the camera, and all that it saw with it.
    pub fn correct(&mut self, X_CD: &Isometry3<f64>) {
        let X_WD = self.X_WC * X_CD;
        let moved = X_WD * self.X_WC.inverse();
        for p in &mut self.pixels {
            p.point = moved * p.point;
            p.normal = moved * p.normal;
        }
        self.X_WC = X_WD;
    }

    /// Keeps only the pixels whose points in the world the test lets pass.
    pub fn keep(&mut self, test: impl Fn(&Point3<f64>) -> bool) {
        let mut open = std::mem::take(&mut self.open);
        for (i, open) in open.iter_mut().enumerate().filter(|(_, open)| **open) {
            let ray = self.ray_C((i % self.width) as f64, (i / self.width) as f64);
            *open = test(&(self.X_WC * Point3::from(ray * self.depth[i])));
        }
        self.open = open;
        self.pixels.retain(|p| self.open[p.row * self.width + p.column]);
        self.slot.fill(u32::MAX);
        for (i, p) in self.pixels.iter().enumerate() {
            self.slot[p.row * self.width + p.column] = i as u32;
        }
    }

    /// Origin of the camera in the world.
    pub fn eye(&self) -> Point3<f64> {
        Point3::from(self.X_WC.translation.vector)
    }

    /// Direction of a pixel's ray in the camera's frame, of depth 1.
    pub fn ray_C(&self, column: f64, row: f64) -> Vector3<f64> {
        Vector3::new((column - self.center[0]) / self.focal[0], (row - self.center[1]) / self.focal[1], 1.0)
    }

    /// The pixel that a point falls on and its depth, for a camera whose view of the world is `X_DW`; nothing behind it or
    /// outside the image.
    pub fn project(&self, X_DW: &Isometry3<f64>, point: &Point3<f64>) -> Option<(usize, usize, f64)> {
        let p = X_DW * point;
        if p.z < 1e-3 {
            return None;
        }
        let column = (p.x / p.z * self.focal[0] + self.center[0]).round();
        let row = (p.y / p.z * self.focal[1] + self.center[1]).round();
        let inside = column >= 0.0 && row >= 0.0 && column < self.width as f64 && row < self.height as f64;
        inside.then_some((column as usize, row as usize, p.z))
    }

    /// Length on a surface at depth `z` that one pixel covers when seen squarely, m.
    pub fn footprint(&self, z: f64) -> f64 {
        z / self.focal[0].min(self.focal[1])
    }

    fn fit_normals(&mut self) {
        let mut spreads = Vec::new();
        for row in 0..self.height {
            for column in 0..self.width {
                let z0 = self.depth[row * self.width + column];
                if z0 <= 0.0 {
                    continue;
                }
                // Neighbours on a surface tilted by up to 60 degrees differ by this much; more is another surface.
                let gap = (1.75 * REACH as f64 * self.footprint(z0)).max(0.012);
                let (mut A, mut b, mut squares, mut count) = (Matrix3::zeros(), Vector3::zeros(), 0.0, 0usize);
                for r in row.saturating_sub(REACH)..=(row + REACH).min(self.height - 1) {
                    for c in column.saturating_sub(REACH)..=(column + REACH).min(self.width - 1) {
                        let z = self.depth[r * self.width + c];
                        if z > 0.0 && (z - z0).abs() < gap {
                            let x = self.ray_C(c as f64, r as f64);
                            A += x * x.transpose();
                            b += x / z;
                            squares += 1.0 / (z * z);
                            count += 1;
                        }
                    }
                }
                if count < SUPPORT {
                    continue;
                }
                let Some(inverse) = A.try_inverse() else { continue };
                let solution = inverse * b;
                let variance = ((squares - b.dot(&solution)) / (count - 3) as f64).max(0.0);
                let spread = variance.sqrt() * z0 * z0;
                let ray = self.ray_C(column as f64, row as f64);
                let length = solution.norm();
                if length < 1e-9 || spread > gap / 3.0 {
                    continue;
                }
                let normal_C = -solution / length;
                // Seen at a grazing angle, a pixel's place along its ray says little.
                if normal_C.dot(&ray) / ray.norm() > -0.1 {
                    continue;
                }
                if count == (2 * REACH + 1) * (2 * REACH + 1) {
                    spreads.push(spread / (z0 * z0));
                }
                self.pixels.push(Pixel { point: self.X_WC * Point3::from(ray * z0), normal: self.X_WC * normal_C, column, row });
            }
        }
        self.noise = median(&mut spreads).unwrap_or(0.003);
    }
}

/// Median of finite numbers.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() { None } else { Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1) }
}

fn least_of_neighbours(depth: &[f64], width: usize, height: usize) -> Vec<f64> {
    let mut least = vec![0.0; depth.len()];
    for row in 0..height {
        for column in 0..width {
            let mut z = depth[row * width + column];
            if z <= 0.0 {
                continue;
            }
            for r in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                for c in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                    let other = depth[r * width + c];
                    if other > 0.0 {
                        z = z.min(other);
                    }
                }
            }
            least[row * width + column] = z;
        }
    }
    least
}
