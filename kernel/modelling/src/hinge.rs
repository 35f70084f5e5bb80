//! Where hinges are, asked again once it is known which points are a part's.
//!
//! That a part hangs at one of its ends, and at which, was learned from whole superpoints. How far its pin lies from where its points end was
//! learned from these, too, and of true parts. So a last head sees what was found: the candidates at the ends of the split pieces, what was said of them,
//! and where all points of the cloud, many more than were thinned, have the panel end.

use nalgebra::{Point3, Vector3};

use crate::border::Panel;
use crate::candidate::{Candidate, FEATURES};
use crate::feature::CANDIDATES;
use crate::network::{CLASSES, Matrix};
use crate::posed::Posed;
use crate::seam::{Front, seam_near};

/// Features of a hinge.
pub const HINGE: usize = FEATURES + 3 + CLASSES + 10;

/// The network's input for the candidates of parts, [`CANDIDATES`] rows each; `out` is what was said of them, `classes` what of the parts.
pub(crate) fn rows(posed: &Posed<'_>, pieces: &[Vec<usize>], candidates: &[Vec<Candidate>], out: &Matrix, classes: &[[f64; CLASSES]]) -> Matrix {
    let a = posed.analysis;
    let dense: Vec<Point3<f64>> = a.dense.iter().map(|(p, _)| Point3::from(posed.of_world(&p.coords))).collect();
    let mut all: Vec<f32> = Vec::with_capacity(pieces.len() * CANDIDATES * HINGE);
    for (g, own) in pieces.iter().enumerate() {
        let panel = Panel::of(posed, own);
        let places: Vec<[f64; 3]> = dense.iter().map(|p| panel.coordinates(p)).collect();
        let thin = (3.0 * a.scale.noise).max(0.006);
        let front = Front { places: &places, ranges: [panel.level, panel.rise], thin, spacing: a.scale.spacing };
        for (c, candidate) in candidates[g].iter().enumerate() {
            let said = |k: usize| f64::from(out[(g * CANDIDATES + c, k)]);
            let mut row = candidate.features.clone();
            row.extend([said(0) / 4.0, said(1), said(2)]);
            row.extend(classes[g]);
            row.extend(ends(&panel, &front, candidate));
            debug_assert_eq!(row.len(), HINGE);
            all.extend(row.into_iter().map(|x| x.clamp(-3.0, 3.0) as f32));
        }
    }
    Matrix::from_row_slice(pieces.len() * CANDIDATES, HINGE, &all)
}

/// Where the panel ends at a candidate, from its place along the section: by its thinned points, by where its plane thins out, by the clearest
/// seam; and what speaks for that.
fn ends(panel: &Panel, front: &Front<'_>, c: &Candidate) -> [f64; 10] {
    let mut told = [0.0; 10];
    let along = |k: usize| c.along.dot(&panel.axes[k + 1]);
    let Some(k) = (0..2).find(|k| !c.slides && along(*k).abs() > 0.9) else { return told };
    let sign = along(k).signum();
    let at = c.origin.coords.dot(&panel.axes[k + 1]);
    let (low, high) = front.ranges[k];
    let (edge, side) = if sign > 0.0 { (low, 0) } else { (high, 1) };
    let off = |t: f64| (t - at) * sign * 20.0;
    told[0] = 1.0;
    told[1] = off(edge);
    if let Some(seam) = seam_near(front, k, side) {
        told[2] = 1.0;
        told[3] = off(seam.at);
        told[4] = seam.score / 4.0;
        told[5] = seam.missing;
    }
    // Where the plane thins out to a half and to a tenth of its usual density.
    let (half, tenth) = thins(front, k, side);
    told[6] = off(half);
    told[7] = off(tenth);
    let across: Vector3<f64> = c.across;
    let depth = |d: f64| (d * panel.axes[0].dot(&across)) * 20.0;
    told[8] = depth(panel.deep.0);
    told[9] = depth(panel.deep.1);
    told
}

/// Places beyond which a panel's plane holds fewer than a half and fewer than a tenth of its usual points.
fn thins(front: &Front<'_>, k: usize, side: usize) -> (f64, f64) {
    let (range, other) = (front.ranges[k], front.ranges[1 - k]);
    let (edge, out) = if side == 0 { (range.0, -1.0) } else { (range.1, 1.0) };
    let bin = (0.6 * front.spacing).max(0.002);
    const REACH: usize = 40;
    let mut counts = [0.0_f64; REACH];
    for p in front.places {
        if p[0].abs() < front.thin && p[2 - k] > other.0 && p[2 - k] < other.1 {
            let b = (p[1 + k] - edge) * out / bin + REACH as f64 / 2.0;
            if b >= 0.0 && b < REACH as f64 {
                counts[b as usize] += 1.0;
            }
        }
    }
    let usual = counts[4..16].iter().sum::<f64>() / 12.0;
    let beyond = |share: f64| {
        let b = (16..REACH - 1).find(|b| counts[*b] + counts[b + 1] < 2.0 * share * usual).unwrap_or(REACH);
        edge + out * bin * (b as f64 - REACH as f64 / 2.0)
    };
    (beyond(0.5), beyond(0.1))
}
