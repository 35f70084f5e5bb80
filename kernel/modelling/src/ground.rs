//! What is not the object: the level surface that it stands on. And whether there are several objects.
//!
//! A support reaches beyond what stands on it. A level surface that ends where the object ends is a part of the object.

use nalgebra::{Point3, Vector3};

use crate::ModellingError;
use crate::grid::{Grid, steps};
use crate::normal::{Local, mean_and_covariance};

/// Which points are the object's; the height of the surface that was taken away, if any.
pub(crate) struct Cleared {
    pub(crate) object: Vec<bool>,
    pub(crate) support: Option<f64>,
}

/// What is so far above a level surface does not lie on it, m, however far away the camera saw it.
pub(crate) const CLEAR: f64 = 0.06;

/// The lowest height at which much is level within a band, m.
pub(crate) fn lowest_level(points: &[Point3<f64>], local: &[Local], band: f64) -> Option<f64> {
    let mut heights: Vec<f64> = (0..points.len()).filter(|i| local[*i].normal.z.abs() > 0.94).map(|i| points[i].z).collect();
    heights.sort_by(f64::total_cmp);
    heights.iter().enumerate().find_map(|(k, z)| {
        let within = heights[k..].partition_point(|h| *h < z + band);
        (within > points.len() / 25).then(|| heights[k + within / 2])
    })
}

/// Greatest share of all points that may be a table's below its top.
const LEGS: f64 = 0.15;

/// Takes the support away.
pub(crate) fn clear(points: &[Point3<f64>], local: &[Local], cell: f64) -> Cleared {
    let all = Cleared { object: vec![true; points.len()], support: None };
    let band = (3.0 * cell).max(0.012);
    let Some(z) = lowest_level(points, local, band) else { return all };
    // Little may lie below it: nothing of a floor, the edge and the legs of a table. Of furniture with something on it more does.
    let share = |of: &dyn Fn(&Point3<f64>) -> bool| points.iter().filter(|p| of(p)).count() as f64 / points.len() as f64;
    let below = share(&|p| p.z < z - band);
    if below > LEGS || below > 0.02 && share(&|p| p.z > z + band) < 2.0 * below {
        return all;
    }
    let footprint = |keep: &dyn Fn(&Point3<f64>) -> bool| {
        let mut xs: Vec<f64> = points.iter().filter(|p| keep(p)).map(|p| p.x).collect();
        let mut ys: Vec<f64> = points.iter().filter(|p| keep(p)).map(|p| p.y).collect();
        if xs.len() < 30 {
            return None;
        }
        xs.sort_by(f64::total_cmp);
        ys.sort_by(f64::total_cmp);
        let cut = xs.len() / 100;
        Some([xs[cut], xs[xs.len() - 1 - cut], ys[cut], ys[ys.len() - 1 - cut]])
    };
    // Far away the surface is thicker than the band: what is well above it is the object's for certain.
    let Some(above) = footprint(&|p| p.z > z + (2.0 * band).max(CLEAR)) else { return all };
    let margin = 0.08 * (above[1] - above[0]).hypot(above[3] - above[2]);
    let apart = |p: &Point3<f64>| p.x < above[0] - margin || p.x > above[1] + margin || p.y < above[2] - margin || p.y > above[3] + margin;
    let mut stray: Vec<f64> = points.iter().filter(|p| (p.z - z).abs() < 2.0 * CLEAR && apart(p)).map(|p| (p.z - z).abs()).collect();
    stray.sort_by(f64::total_cmp);
    let thick = (1.2 * stray.get(stray.len() * 97 / 100).copied().unwrap_or_default()).clamp(0.6 * band, f64::max(CLEAR, 0.6 * band));
    let Some(ground) = footprint(&|p| (p.z - z).abs() < band.max(thick)) else { return all };
    let beyond = [above[0] - ground[0], ground[1] - above[1], above[2] - ground[2], ground[3] - above[3]];
    if beyond.iter().filter(|b| **b > margin).count() < 2 {
        return all;
    }
    let own = |p: &Point3<f64>| p.z > z + if apart(p) { thick.max(band) } else { thick };
    Cleared { object: points.iter().map(own).collect(), support: Some(z) }
}

/// Components of points that lie nearer than a distance to one another: of each point its component, and their sizes.
pub(crate) fn components(points: &[Point3<f64>], reach: f64) -> (Vec<u32>, Vec<usize>) {
    let grid = Grid::new(points, reach);
    let mut of = vec![u32::MAX; points.len()];
    let mut sizes = Vec::new();
    for start in 0..points.len() {
        if of[start] != u32::MAX {
            continue;
        }
        let id = sizes.len() as u32;
        let mut stack = vec![start];
        of[start] = id;
        let mut size = 0;
        while let Some(i) = stack.pop() {
            size += 1;
            grid.near(&points[i], reach, |j, _| {
                if of[j] == u32::MAX {
                    of[j] = id;
                    stack.push(j);
                }
            });
        }
        sizes.push(size);
    }
    (of, sizes)
}

/// The same by cells: points are together where their cells touch, so what is less than a cell apart is one, and what is more than two
/// cells apart is not. A wide reach then costs no more than a narrow one.
pub(crate) fn coarse_components(points: &[Point3<f64>], cell: f64) -> (Vec<u32>, Vec<usize>) {
    let at: Vec<[i64; 3]> = points.iter().map(|p| steps(p, cell)).collect();
    let mut cells = at.clone();
    cells.sort_unstable();
    cells.dedup();
    let place = |c: &[i64; 3]| cells.binary_search(c).ok();
    let mut of = vec![u32::MAX; cells.len()];
    let mut count = 0;
    for start in 0..cells.len() {
        if of[start] != u32::MAX {
            continue;
        }
        of[start] = count;
        let mut stack = vec![start];
        while let Some(i) = stack.pop() {
            let [x, y, z] = cells[i];
            for beside in (0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]) {
                if let Some(j) = place(&beside).filter(|j| of[*j] == u32::MAX) {
                    of[j] = count;
                    stack.push(j);
                }
            }
        }
        count += 1;
    }
    let mut sizes = vec![0; count as usize];
    let of: Vec<u32> = at.iter().map(|c| place(c).map_or(0, |i| of[i])).collect();
    of.iter().for_each(|c| sizes[*c as usize] += 1);
    (of, sizes)
}

/// A leaf has so many times fewer points than its case, and its thickness is such a share of its width.
const LEAF: usize = 2;
const THIN: f64 = 0.25;

/// Do points lie as those of a panel do, whichever way it is turned?
fn is_panel(points: impl Iterator<Item = Vector3<f64>> + Clone) -> bool {
    let mut lengths: Vec<f64> = mean_and_covariance(points).1.symmetric_eigenvalues().iter().map(|x| x.max(0.0).sqrt()).collect();
    lengths.sort_by(f64::total_cmp);
    lengths[0] < THIN * lengths[1]
}

/// Errors where far apart lie two things that are both large; where they lie less far apart, what to say of it. Crumbs are marked off the
/// object.
pub(crate) fn one_object(points: &[Point3<f64>], object: &mut [bool], diagonal: f64) -> Result<Option<String>, ModellingError> {
    let kept: Vec<usize> = (0..points.len()).filter(|i| object[*i]).collect();
    let coarse: Vec<Point3<f64>> = kept.iter().map(|i| points[*i]).collect();
    let cell = (0.15 * diagonal).clamp(0.05, 0.4);
    let (of, sizes) = coarse_components(&coarse, cell);
    let total = coarse.len();
    let most = sizes.iter().copied().max().unwrap_or(0);
    // A leaf that stands open may be seen apart from the case that it hangs in.
    let leaf =
        |k: usize| sizes[k] * LEAF < most && is_panel(coarse.iter().zip(&of).filter(|(_, c)| **c as usize == k).map(|(p, _)| p.coords));
    let large: Vec<usize> = (0..sizes.len()).filter(|k| sizes[*k] * 8 > total && !leaf(*k)).map(|k| sizes[k]).collect();
    if large.len() > 1 {
        let shares = large.iter().map(|s| format!("{:.0} %", 100.0 * *s as f64 / total as f64)).collect();
        return Err(ModellingError::Several { count: large.len(), shares });
    }
    for (i, c) in kept.iter().zip(of) {
        let size = sizes[c as usize];
        if size < most && size * 200 < total {
            object[*i] = false;
        }
    }
    let finer = coarse_components(&coarse, cell / 3.0).1;
    let apart: Vec<String> =
        finer.iter().filter(|s| **s * 8 > total).map(|s| format!("{:.0} %", 100.0 * *s as f64 / total as f64)).collect();
    // A thing that is seen in part may well fall apart: it is modelled as one, and that is said.
    Ok((apart.len() > 1).then(|| {
        format!(
            "there may be {} objects, with {} of the points: they were modelled as one; if they are several, give the cloud of one",
            apart.len(),
            apart.join(", ")
        )
    }))
}
