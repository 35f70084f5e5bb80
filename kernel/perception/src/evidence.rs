//! What the images say about one hypothesis, ray by ray: the object is rendered and compared with what was measured.

use crate::hypothesis::Hypothesis;
use crate::problem::Problem;

/// Rays cast for one view at most, about.
const RAYS: f64 = 3000.0;

/// Counts in pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Evidence {
    /// The surface is where it should be.
    pub agree: f64,
    /// The ray went through it.
    pub violated: f64,
    /// Something else is before it.
    pub hidden: f64,
    /// It lies outside the image.
    pub outside: f64,
}

impl Evidence {
    /// Pixels for the hypothesis less pixels against it.
    pub fn score(&self) -> f64 {
        self.agree - self.violated
    }

    /// Share of what should be seen and agrees.
    pub fn inlier_share(&self) -> f64 {
        share(self.agree, self.agree + self.violated)
    }

    /// Share of what should be seen and was looked through.
    pub fn violated_share(&self) -> f64 {
        share(self.violated, self.agree + self.violated)
    }

    /// Share of the camera-facing surface that can be seen.
    pub fn visible_share(&self) -> f64 {
        let seen = self.agree + self.violated;
        share(seen, seen + self.hidden + self.outside)
    }
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// Renders the object and compares.
pub(crate) fn weigh(problem: &Problem<'_>, hypothesis: &Hypothesis) -> Evidence {
    let X_WL = problem.placed(hypothesis).X_WL;
    let mut evidence = Evidence::default();
    for frame in problem.frames {
        let Some([left, right, top, bottom]) = outline(problem, &X_WL, frame) else { continue };
        let stride = ((right - left) * (bottom - top) / RAYS).sqrt().ceil().max(1.0);
        let weight = stride * stride;
        let eye = frame.eye();
        let mut row = top;
        while row <= bottom {
            let mut column = left;
            while column <= right {
                let ray_C = frame.ray_C(column, row);
                let ray_W = frame.X_WC * ray_C;
                if let Some(hit) = problem.surface.cast(&X_WL, &eye, &ray_W, 20.0) {
                    let inside = column >= 0.0 && row >= 0.0 && column < frame.width as f64 && row < frame.height as f64;
                    if inside {
                        let i = row as usize * frame.width + column as usize;
                        let (measured, nearest) = (frame.depth[i], frame.nearest[i]);
                        let z = hit.distance;
                        let cos = (hit.normal.dot(&ray_W) / ray_W.norm()).abs();
                        let slack = 0.004 + 3.0 * frame.noise * z * z;
                        let along = (measured - z) * ray_W.norm() * cos;
                        if measured <= 0.0 {
                        } else if along.abs() < slack {
                            evidence.agree += weight;
                        } else if measured < z {
                            evidence.hidden += weight;
                        } else if nearest > z + slack {
                            evidence.violated += weight;
                        }
                    } else {
                        evidence.outside += weight;
                    }
                }
                column += stride;
            }
            row += stride;
        }
    }
    evidence
}

/// The object's bounds in pixels, cut at one image size beyond the image.
fn outline(problem: &Problem<'_>, X_WL: &[nalgebra::Isometry3<f64>], frame: &crate::frame::Frame) -> Option<[f64; 4]> {
    let mut bounds = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    for (link, p) in problem.surface.corners() {
        let p = frame.X_CW * (X_WL[link] * p);
        if p.z < 1e-2 {
            continue;
        }
        let (u, v) = (p.x / p.z * frame.focal[0] + frame.center[0], p.y / p.z * frame.focal[1] + frame.center[1]);
        bounds = [bounds[0].min(u), bounds[1].max(u), bounds[2].min(v), bounds[3].max(v)];
    }
    let (w, h) = (frame.width as f64, frame.height as f64);
    let cut = [
        bounds[0].floor().clamp(-w, 2.0 * w),
        bounds[1].ceil().clamp(-w, 2.0 * w),
        bounds[2].floor().clamp(-h, 2.0 * h),
        bounds[3].ceil().clamp(-h, 2.0 * h),
    ];
    (bounds[0] <= bounds[1] && bounds[2] <= bounds[3]).then_some(cut)
}
