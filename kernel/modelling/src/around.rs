//! Surroundings that are seen for metres around are cropped to what is near the object before it is looked at.
//!
//! How fine a cloud is looked at is a matter of how far it reaches and of how many points it has, so that a floor or a room would hide what
//! stands in it. What stands is found coarsely: above the floor and before the walls, together with much else that is. Of floor and walls
//! enough is kept about it to be seen to reach beyond, which is what [`crate::ground`] and [`crate::background`] know them by.

use nalgebra::{Point3, Vector3};

use crate::ground::{CLEAR, coarse_components, lowest_level};
use crate::normal::Local;
use crate::prepare::Thinned;

/// Points that are together a lesser share than this of all that stand are none of the object's.
const LARGE: usize = 8;
/// How far around what stands all is kept, in its diagonals, and at least, m.
const AROUND: f64 = 0.25;
const LEAST: f64 = 0.12;
/// A cloud is cropped where it would lose such a share of itself.
const MUCH: f64 = 0.1;

/// Which points are near what stands on a floor and before walls (`before`, where there are any); none where nearly all are, and where there
/// is neither.
pub(crate) fn near(thinned: &Thinned, local: &[Local], before: Option<&[bool]>) -> Option<Vec<bool>> {
    let points = &thinned.points;
    let band = (3.0 * thinned.cell).max(0.012);
    let little_below = |z: &f64| points.iter().filter(|p| p.z < z - band).count() * 50 < points.len();
    let floor = lowest_level(points, local, band).filter(little_below);
    if floor.is_none() && before.is_none() {
        return None;
    }
    let clear = floor.map_or(f64::NEG_INFINITY, |z| z + (2.0 * band).max(CLEAR));
    let stands = |i: &usize| points[*i].z > clear && before.is_none_or(|b| b[*i]);
    let standing: Vec<Point3<f64>> = (0..points.len()).filter(stands).map(|i| points[i]).collect();
    // Far away the points of a floor stray as high as that, but not together.
    let (of, sizes) = coarse_components(&standing, (4.0 * thinned.cell).clamp(0.05, 0.4));
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = -low;
    for (p, component) in standing.iter().zip(of) {
        if sizes[component as usize] * LARGE > standing.len() {
            (low, high) = (low.inf(&p.coords), high.sup(&p.coords));
        }
    }
    let margin = Vector3::repeat((AROUND * (high - low).norm()).max(LEAST));
    (low, high) = (low - margin, high + margin);
    low.z = f64::NEG_INFINITY;
    let near: Vec<bool> = points.iter().map(|p| p.coords >= low && p.coords <= high).collect();
    let kept = near.iter().filter(|n| **n).count();
    (kept > 0 && (kept as f64) < (1.0 - MUCH) * points.len() as f64).then_some(near)
}
