//! Did the cameras see all of the object? Where its points reach the edge of an image and no view sees on, it goes on, most likely.

use nalgebra::{Isometry3, Point3};

use crate::Perceived;

/// The image and the lens of a pinhole camera, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Columns and rows.
    pub size: [f64; 2],
    /// Focal lengths.
    pub focal: [f64; 2],
    /// Principal point.
    pub center: [f64; 2],
}

/// Bins along a side of an image, and how many of them must hold the object for it to be cut off there.
const BINS: usize = 24;
const CUT: usize = 3;

impl Lens {
    /// At which sides of the image the object is cut off. `points` are the object's, of this view or of all, in the camera's frame.
    pub fn cut_off(&self, points: impl Iterator<Item = Point3<f64>>) -> Vec<&'static str> {
        let [width, height] = self.size;
        let strip = (0.01 * width).max(2.0);
        let (mut ends, mut goes_on) = ([[false; BINS]; 4], [[false; BINS]; 4]);
        for p in points.filter(|p| p.z > 1e-3) {
            let [u, v] = [0, 1].map(|k| self.focal[k] * p[k] / p.z + self.center[k]);
            let bin = |t: f64, of: f64| ((t / of * BINS as f64).max(0.0) as usize).min(BINS - 1);
            for (side, off, at) in
                [(0, u, bin(v, height)), (1, width - u, bin(v, height)), (2, v, bin(u, width)), (3, height - v, bin(u, width))]
            {
                ends[side][at] |= off < strip;
                // A pixel's rounding and a pose's error are no look beyond the edge.
                goes_on[side][at] |= off < -strip;
            }
        }
        let cut = |side: &usize| (0..BINS).filter(|k| ends[*side][*k] && !goes_on[*side][*k]).count() >= CUT;
        (0..4).filter(cut).map(|side| ["left", "right", "upper", "lower"][side]).collect()
    }
}

impl Perceived {
    /// Says which views cut the object off, if any: views are told by their pose in the frame of the cloud, and by their lens where that is known.
    pub fn note_cut_offs(&mut self, cloud: &[Point3<f64>], views: &[(Isometry3<f64>, Option<Lens>)]) {
        for (i, (X_WC, lens)) in views.iter().enumerate() {
            let X_CW = X_WC.inverse();
            let own = cloud.iter().zip(&self.part).filter(|(_, part)| **part >= 0).map(|(p, _)| X_CW * p);
            let sides = lens.map(|l| l.cut_off(own)).unwrap_or_default();
            if !sides.is_empty() {
                let at = sides.join(" and ");
                self.report.notes.push(format!(
                    "view {} cuts the object off at its {at} edge: what lies beyond is in no part, and a joint there is a guess",
                    i + 1
                ));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Lens = Lens { size: [200.0, 150.0], focal: [180.0, 180.0], center: [100.0, 75.0] };

    /// A wall a metre before the camera, from and to along x.
    fn wall(from: f64, to: f64) -> Vec<Point3<f64>> {
        (0..4000).map(|i| Point3::new(from + (to - from) * f64::from(i % 100) / 99.0, -0.3 + 0.015 * f64::from(i / 100), 1.0)).collect()
    }

    #[test]
    fn what_reaches_an_edge_is_cut_off_there() {
        assert_eq!(LENS.cut_off(wall(-0.3, 0.555).into_iter()), ["right"]);
        assert_eq!(LENS.cut_off(wall(-0.3, 0.3).into_iter()), [""; 0]);
    }

    #[test]
    fn what_another_view_sees_on_is_not_cut_off() {
        assert_eq!(LENS.cut_off(wall(-0.3, 0.8).into_iter()), [""; 0]);
    }
}
