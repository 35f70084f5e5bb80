//! The frame of a box-like object: its yaw, modulo a right angle, from the level normals of its flat surfaces.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Rotation3, Vector3};

use crate::normal::Local;

/// The yaw in 0..pi/2 about which most upright flat surface stands, rad.
///
/// Normals vote in a histogram over the angle modulo a right angle; the peak is refined by the circular mean about it.
pub(crate) fn yaw(local: &[Local], flat: f64) -> f64 {
    const BINS: usize = 180;
    let mut votes = [0.0; BINS];
    let angle = |l: &Local| l.normal.y.atan2(l.normal.x).rem_euclid(FRAC_PI_2);
    let weight = |l: &Local| {
        let upright = 1.0 - l.normal.z.abs() / 0.3;
        if l.support < 6 || upright <= 0.0 || !l.residual.is_finite() { 0.0 } else { upright / (1.0 + (l.residual / flat).powi(2)) }
    };
    for l in local {
        votes[((angle(l) / FRAC_PI_2 * BINS as f64) as usize).min(BINS - 1)] += weight(l);
    }
    // Seen over three bins, so that a peak between two of them counts.
    let smooth = |k: usize| (0..7).map(|d| votes[(k + BINS + d - 3) % BINS] * (4.0 - (d as f64 - 3.0).abs())).sum::<f64>();
    let peak = (0..BINS).max_by(|a, b| smooth(*a).total_cmp(&smooth(*b))).unwrap_or(0);
    let mut at = (peak as f64 + 0.5) / BINS as f64 * FRAC_PI_2;
    for width in [0.09, 0.05, 0.035] {
        let (mut sum, mut total) = (0.0, 0.0);
        for l in local {
            let off = (angle(l) - at + FRAC_PI_2 / 2.0).rem_euclid(FRAC_PI_2) - FRAC_PI_2 / 2.0;
            if off.abs() < width {
                sum += weight(l) * off;
                total += weight(l);
            }
        }
        if total > 0.0 {
            at += sum / total;
        }
    }
    at.rem_euclid(FRAC_PI_2)
}

/// Rotation about z by `-yaw`: from the world's axes to those of the box.
pub(crate) fn upright(yaw: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), -(yaw % TAU))
}
