//! What the images say about one hypothesis, ray by ray: the object is rendered and compared with what was measured.

use nalgebra::{Isometry3, Point3};

use crate::frame::Frame;
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
        let X_DW = hypothesis.X_DW(&frame.X_WC);
        let X_WD = X_DW.inverse();
        let Some([left, right, top, bottom]) = outline(problem, &X_WL, frame, &X_DW) else { continue };
        let stride = ((right - left) * (bottom - top) / RAYS).sqrt().ceil().max(1.0);
        let weight = stride * stride;
        let eye = Point3::from(X_WD.translation.vector);
        let mut row = top;
        while row <= bottom {
            let mut column = left;
            while column <= right {
                let ray_C = frame.ray_C(column, row);
                let ray_W = X_WD * ray_C;
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

/// The windows of pixels in which hypotheses near one are compared, and the spacing of the pixels.
pub(crate) struct Windows {
    all: Vec<Option<([usize; 4], usize)>>,
    /// Pixels in all of them together, at their spacing.
    pub rays: usize,
}

impl Windows {
    /// Around a hypothesis, with so many pixels of margin.
    pub fn around(problem: &Problem<'_>, hypothesis: &Hypothesis, margin: f64) -> Self {
        let X_WL = problem.placed(hypothesis).X_WL;
        let mut rays = 0;
        let all = problem
            .frames
            .iter()
            .map(|frame| {
                let [left, right, top, bottom] = outline(problem, &X_WL, frame, &hypothesis.X_DW(&frame.X_WC))?;
                let (w, h) = (frame.width as f64, frame.height as f64);
                if right + margin < 0.0 || left - margin > w - 1.0 || bottom + margin < 0.0 || top - margin > h - 1.0 {
                    return None;
                }
                let cut = |x: f64, most: f64| x.clamp(0.0, most - 1.0) as usize;
                let window = [cut(left - margin, w), cut(right + margin, w), cut(top - margin, h), cut(bottom + margin, h)];
                let area = (window[1] - window[0] + 1) * (window[3] - window[2] + 1);
                let stride = (area as f64 / RAYS).sqrt().ceil().max(1.0) as usize;
                rays += area / (stride * stride);
                Some((window, stride))
            })
            .collect();
        Self { all, rays }
    }
}

/// What a hypothesis leaves unexplained, as minus twice a logarithm of likelihood up to a constant: every pixel of the
/// windows errs by a normal deviation about what it should see, or is an outlier at a fixed price. What it should see is
/// the object where its ray meets it, unless something is before it; elsewhere the rest of the world, to which open pixels
/// do not belong.
pub(crate) fn misfit(problem: &Problem<'_>, hypothesis: &Hypothesis, windows: &Windows, deviation: f64) -> f64 {
    /// Square of the deviations at which a pixel is an outlier.
    const OUTLIER: f64 = 9.0;
    let X_WL = problem.placed(hypothesis).X_WL;
    let mut misfit = 0.0;
    for (frame, window) in problem.frames.iter().zip(&windows.all) {
        let Some(([left, right, top, bottom], stride)) = window else { continue };
        let X_WD = hypothesis.X_DW(&frame.X_WC).inverse();
        let eye = Point3::from(X_WD.translation.vector);
        for row in (*top..=*bottom).step_by(*stride) {
            for column in (*left..=*right).step_by(*stride) {
                let i = row * frame.width + column;
                let measured = frame.depth[i];
                if measured <= 0.0 {
                    continue;
                }
                let elsewhere = if frame.open[i] { OUTLIER } else { 1.0 };
                let ray = X_WD * frame.ray_C(column as f64, row as f64);
                let price = match problem.surface.cast(&X_WL, &eye, &ray, measured + 1.0) {
                    None => elsewhere,
                    Some(hit) => {
                        let u = hit.normal.dot(&ray) * (measured - hit.distance) / deviation;
                        if u * u < OUTLIER {
                            u * u
                        } else if measured < hit.distance {
                            elsewhere
                        } else {
                            OUTLIER
                        }
                    }
                };
                misfit += price * (stride * stride) as f64;
            }
        }
    }
    misfit
}

/// The object's bounds in pixels, cut at one image size beyond the image.
pub(crate) fn outline(problem: &Problem<'_>, X_WL: &[Isometry3<f64>], frame: &Frame, X_DW: &Isometry3<f64>) -> Option<[f64; 4]> {
    let mut bounds = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    for (link, p) in problem.surface.corners() {
        let p = X_DW * (X_WL[link] * p);
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
