//! What an active stereo depth camera makes of a scene.
//!
//! Such a camera measures disparity `d = f B / z` between two imagers, so its depth error grows with the square of the
//! distance: `sigma_z = z^2 sigma_d / (f B)`. Figures are those of an Intel RealSense D435 at 848 x 480: baseline
//! B = 50 mm and f = 424 px (data sheet: horizontal field of view of depth about 90 degrees), subpixel error
//! sigma_d = 0.08 px on textured targets (Intel, "Best-Known-Methods for Tuning Intel RealSense D400 Depth Cameras"),
//! disparity in steps of 1/32 px (the D4 processor's 5 fractional bits). At 1 m that is 3.8 mm.
//!
//! Half of the variance is common to neighbouring pixels, since matching compares windows (engineering estimate). Rays
//! that graze a surface are lost: Nguyen, Izadi, Lovell 2012 ("Modeling Kinect sensor noise for improved 3D
//! reconstruction and tracking") found depth reliable up to about 70 degrees and hardly any beyond 80. At edges of
//! objects a pixel may lie between foreground and background ("flying pixels"), and what only one imager sees has no
//! depth: a band on the left of each foreground object. A few pixels in a hundred are missing at random.

use sagci_model::Camera;

use crate::random::Random;

/// f B of the native sensor, px m.
const FOCAL_BASELINE: f64 = 424.0 * 0.05;
/// Distance between the imagers, m.
const BASELINE: f64 = 0.05;
/// Subpixel error of the disparity, px.
pub(super) const DISPARITY: f64 = 0.08;
/// Step of the disparity, px.
const DISPARITY_STEP: f64 = 1.0 / 32.0;
/// Pixels between independent draws of the common part of the error.
const WINDOW: usize = 6;
/// Cosine of the angle between ray and normal under which depth starts to be lost (70 degrees) ...
const GRAZING_STARTS: f64 = 0.342;
/// ... and under which it is always lost (82 degrees).
const GRAZING_ENDS: f64 = 0.139;
/// A step in depth that counts as an edge, m.
const EDGE: f64 = 0.02;
/// Part of the pixels at an edge that fly.
const FLYING: f64 = 0.3;
/// Part of the pixels at an edge that are lost.
const EDGE_LOSS: f64 = 0.2;
/// Part of all pixels that are lost at random.
pub(super) const HOLES: f64 = 0.01;

/// A perfect image. Row-major; depth 0 where there is nothing.
pub(super) struct Ideal {
    pub width: usize,
    pub height: usize,
    /// Depth along the optical axis, m.
    pub depth: Vec<f64>,
    /// Cosine between ray and surface normal.
    pub facing: Vec<f64>,
    pub rgb: Vec<[u8; 3]>,
}

impl Ideal {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let n = width * height;
        Self { width, height, depth: vec![0.0; n], facing: vec![0.0; n], rgb: vec![[30, 30, 34]; n] }
    }

    pub(super) fn set(&mut self, column: usize, row: usize, depth: f64, facing: f64, rgb: [u8; 3]) {
        let i = row * self.width + column;
        self.depth[i] = depth;
        self.facing[i] = facing;
        self.rgb[i] = rgb;
    }
}

/// The measured depth: 0 where there is none. `scale` is a factor on the disparity error; at 0 the camera is perfect.
pub(super) fn measure(ideal: &Ideal, camera: &Camera, scale: f64, random: &mut Random) -> Vec<f64> {
    let [nearest, farthest] = camera.range;
    let in_range = |z: f64| if z >= nearest && z <= farthest { z } else { 0.0 };
    if scale == 0.0 {
        return ideal.depth.iter().map(|&z| in_range(z)).collect();
    }
    let (width, height) = (ideal.width, ideal.height);
    let seen = seen_by_both(ideal, camera.focal[0]);
    let common = Common::draw(width, height, random);
    let mut depth = vec![0.0; width * height];
    for row in 0..height {
        for column in 0..width {
            let i = row * width + column;
            // As many draws for every pixel: what one does not need must not shift the others.
            let (hole, loss, edge, mix, own) = (random.unit(), random.unit(), random.unit(), random.unit(), random.normal());
            let z = ideal.depth[i];
            if z <= 0.0 || !seen[i] || hole < HOLES {
                continue;
            }
            let kept = (ideal.facing[i] - GRAZING_ENDS) / (GRAZING_STARTS - GRAZING_ENDS);
            if loss > kept {
                continue;
            }
            let mut disparity = FOCAL_BASELINE / z;
            if let Some(other) = across_edge(ideal, column, row) {
                if edge < EDGE_LOSS {
                    continue;
                }
                if edge < EDGE_LOSS + FLYING {
                    disparity += mix * (FOCAL_BASELINE / other - disparity);
                }
            }
            disparity += scale * DISPARITY * std::f64::consts::FRAC_1_SQRT_2 * (own + common.at(column, row));
            disparity = (disparity / DISPARITY_STEP).round() * DISPARITY_STEP;
            if disparity > 0.0 {
                depth[i] = in_range(FOCAL_BASELINE / disparity);
            }
        }
    }
    depth
}

/// Depth of a neighbour beyond an edge, if the pixel lies at one.
fn across_edge(ideal: &Ideal, column: usize, row: usize) -> Option<f64> {
    let z = ideal.depth[row * ideal.width + column];
    let neighbours = [(column.wrapping_sub(1), row), (column + 1, row), (column, row.wrapping_sub(1)), (column, row + 1)];
    neighbours.into_iter().filter(|&(c, r)| c < ideal.width && r < ideal.height).map(|(c, r)| ideal.depth[r * ideal.width + c]).find(
        |&other| {
            // A slanted surface is no edge: its step grows with the distance and the slant.
            let slant = 4.0 * z / ideal.width as f64;
            other > 0.0 && (other - z).abs() > EDGE + slant
        },
    )
}

/// Which pixels of the left imager the right one sees too. Going from right to left, a point is hidden where something
/// already met lies further left in the right image.
fn seen_by_both(ideal: &Ideal, focal: f64) -> Vec<bool> {
    let mut seen = vec![true; ideal.depth.len()];
    for row in 0..ideal.height {
        let mut leftmost = f64::INFINITY;
        for column in (0..ideal.width).rev() {
            let i = row * ideal.width + column;
            if ideal.depth[i] <= 0.0 {
                continue;
            }
            let in_right = column as f64 - focal * BASELINE / ideal.depth[i];
            if in_right >= leftmost + 0.5 {
                seen[i] = false;
            }
            leftmost = leftmost.min(in_right);
        }
    }
    seen
}

/// The part of the error that neighbouring pixels share: normal numbers on a grid, blended, of variance 1 everywhere.
struct Common {
    columns: usize,
    values: Vec<f64>,
}

impl Common {
    fn draw(width: usize, height: usize, random: &mut Random) -> Self {
        let (columns, rows) = (width / WINDOW + 2, height / WINDOW + 2);
        Self { columns, values: (0..columns * rows).map(|_| random.normal()).collect() }
    }

    fn at(&self, column: usize, row: usize) -> f64 {
        let (c, r) = (column / WINDOW, row / WINDOW);
        let (x, y) = ((column % WINDOW) as f64 / WINDOW as f64, (row % WINDOW) as f64 / WINDOW as f64);
        let corners = [(c, r, (1.0 - x) * (1.0 - y)), (c + 1, r, x * (1.0 - y)), (c, r + 1, (1.0 - x) * y), (c + 1, r + 1, x * y)];
        let norm = corners.iter().map(|k| k.2 * k.2).sum::<f64>().sqrt();
        corners.iter().map(|k| k.2 * self.values[k.1 * self.columns + k.0]).sum::<f64>() / norm
    }
}
