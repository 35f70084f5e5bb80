//! The frame of a box-like object: its yaw, modulo a right angle, from the level normals of its flat surfaces.
//!
//! A door that stands open may be the largest surface of all. But it is one panel, and a body has many walls: sides, back, boards, seen
//! from without and within. So of the angles that surfaces stand at, that one is the body's at which they lie in most planes.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Point3, Rotation3, Vector3};

use crate::normal::Local;

const BINS: usize = 180;
/// Yaws less likely than this share of the likeliest are not asked about.
const UNLIKELY: f64 = 0.04;
/// Most yaws that are asked about.
const YAWS: usize = 4;
/// How many angles are looked at.
const PEAKS: usize = 6;
/// Nearer to one another than this they are one, bins.
const APART: usize = 8;

/// An angle modulo a right angle, from -45 to 45 degrees.
fn wrapped(angle: f64) -> f64 {
    (angle + FRAC_PI_2 / 2.0).rem_euclid(FRAC_PI_2) - FRAC_PI_2 / 2.0
}

/// Yaws in 0..pi/2 that the body may have, likeliest first, rad. At least one.
///
/// Normals vote in a histogram over the angle modulo a right angle; each of its highest peaks is refined by the circular mean about it,
/// and weighed by what lies along both of its directions: a panel has one, a body two.
pub(crate) fn yaws(points: &[Point3<f64>], local: &[Local], flat: f64) -> Vec<f64> {
    let votes: Vec<(f64, f64)> = local
        .iter()
        .map(|l| {
            let upright = 1.0 - l.normal.z.abs() / 0.3;
            let weight = if l.support < 6 || upright <= 0.0 || !l.residual.is_finite() {
                0.0
            } else {
                upright / (1.0 + (l.residual / flat).powi(2))
            };
            (l.normal.y.atan2(l.normal.x), weight)
        })
        .collect();
    let mut bins = [0.0; BINS];
    for (angle, weight) in &votes {
        bins[((angle.rem_euclid(FRAC_PI_2) / FRAC_PI_2 * BINS as f64) as usize).min(BINS - 1)] += weight;
    }
    // Seen over some bins, so that a peak between two of them counts.
    let smooth: Vec<f64> =
        (0..BINS).map(|k| (0..7).map(|d| bins[(k + BINS + d - 3) % BINS] * (4.0 - (d as f64 - 3.0).abs())).sum()).collect();
    let highest = smooth.iter().copied().fold(0.0, f64::max);
    let mut peaks: Vec<usize> = Vec::new();
    let mut order: Vec<usize> = (0..BINS).collect();
    order.sort_by(|a, b| smooth[*b].total_cmp(&smooth[*a]));
    for k in order {
        let apart = |p: &usize| (k + BINS - p) % BINS >= APART && (p + BINS - k) % BINS >= APART;
        if peaks.len() < PEAKS && smooth[k] > 0.04 * highest && peaks.iter().all(apart) {
            peaks.push(k);
        }
    }
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for p in points {
        low = low.inf(&p.coords);
        high = high.sup(&p.coords);
    }
    let slice = (0.012 * (high - low).norm()).max(2.0 * flat);
    let mut weighed: Vec<(f64, f64)> = peaks
        .into_iter()
        .map(|peak| {
            let at = refined((peak as f64 + 0.5) / BINS as f64 * FRAC_PI_2, &votes);
            (walls(at, points, &votes, slice), at.rem_euclid(FRAC_PI_2))
        })
        .collect();
    weighed.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut yaws: Vec<f64> = Vec::new();
    for (weight, at) in &weighed {
        // Two peaks may be refined to one.
        let new = yaws.iter().all(|y| wrapped(y - at).abs() > 0.035);
        if new && yaws.len() < YAWS && *weight > UNLIKELY * weighed[0].0 {
            yaws.push(*at);
        }
    }
    if yaws.is_empty() { vec![0.0] } else { yaws }
}

fn refined(mut at: f64, votes: &[(f64, f64)]) -> f64 {
    for width in [0.09, 0.05, 0.035] {
        let (mut sum, mut total) = (0.0, 0.0);
        for (angle, weight) in votes {
            let off = wrapped(angle - at);
            if off.abs() < width {
                sum += weight * off;
                total += weight;
            }
        }
        if total > 0.0 {
            at += sum / total;
        }
    }
    at
}

/// How much lies along both directions of a yaw: the product of two sums over slices across them.
fn walls(at: f64, points: &[Point3<f64>], votes: &[(f64, f64)], slice: f64) -> f64 {
    let mut slices: std::collections::BTreeMap<(bool, i64), f64> = std::collections::BTreeMap::new();
    let (sine, cosine) = at.sin_cos();
    for (p, (angle, weight)) in points.iter().zip(votes) {
        if *weight <= 0.0 || wrapped(angle - at).abs() > 0.09 {
            continue;
        }
        let across = (angle - at).cos().abs() < 0.5;
        let offset = if across { cosine * p.y - sine * p.x } else { cosine * p.x + sine * p.y };
        *slices.entry((across, (offset / slice).floor() as i64)).or_default() += weight;
    }
    // Bent normals along edges vote for any yaw; what few do is no wall.
    let few = 0.004 * points.len() as f64;
    // Many walls count for more than one large one.
    let sum = |side: bool| {
        let of = slices.iter().filter(|(k, _)| k.0 == side).map(|(_, v)| (v - few).max(0.0).powf(0.7));
        of.sum::<f64>() + (0.003 * points.len() as f64).powf(0.7)
    };
    sum(false) * sum(true)
}

/// Rotation about z by `-yaw`: from the world's axes to those of the box.
pub(crate) fn upright(yaw: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), -(yaw % TAU))
}
