//! From a cloud as it comes to one that can be worked with: numbers only, in metres, of an even and bounded density.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::ModellingError;
use crate::grid::{Cells, Grid, cell};
use crate::normal::{Local, mean_and_covariance};

/// Fewest points that say anything.
pub(crate) const LEAST: usize = 100;
/// Most points that are looked at; of more, so many are chosen at random. A thing that many views saw is then as rough as in one view: means
/// of many points would be smoother than anything that the networks know from single views, and small steps and handles would stand out that
/// they take for parts.
const SHOWN: usize = 12_000;
/// Most cells that a cloud is put into to look for walls.
const MOST: usize = 24_000;
/// Least distance that points are thinned to, m.
const FINEST: f64 = 0.0025;

/// A thinned cloud.
pub(crate) struct Thinned {
    /// Each the mean of the input points that it stands for, m.
    pub(crate) points: Vec<Point3<f64>>,
    /// About how far they are apart, m.
    pub(crate) cell: f64,
    /// Of each input point, the thinned point that stands for it.
    pub(crate) of_input: Vec<Option<u32>>,
}

/// What unit an input is in.
pub(crate) struct Unit {
    /// What lengths are multiplied by to get metres.
    pub(crate) factor: f64,
    /// Diagonal of most of it, m.
    span: f64,
    /// Number of points that are finite.
    pub(crate) finite: usize,
}

/// Beyond this there is no place on Earth, in any grid of maps and in millimetres: such a number stands for none.
const REMOTE: f64 = 1e11;
/// Farther from the origin than this a cloud is brought near, m: cells are counted from there.
const FAR: f64 = 300.0;

fn usable(p: &Point3<f64>) -> bool {
    p.iter().all(|c| c.is_finite() && c.abs() < REMOTE)
}

/// A coordinate of all points that are usable: of millions of points no more is copied at a time.
fn along(points: &[Point3<f64>], k: usize) -> Vec<f64> {
    points.iter().filter(|p| usable(p)).map(|p| p[k]).collect()
}

/// What a cloud far from its origin is moved by, in whole numbers of its unit; none where it is near.
pub(crate) fn brought_near(input: &[Point3<f64>]) -> Option<Vector3<f64>> {
    let middle = |k: usize| {
        let mut c = along(input, k);
        let at = c.len() / 2;
        if c.is_empty() { 0.0 } else { *c.select_nth_unstable_by(at, f64::total_cmp).1 }
    };
    let middle = Vector3::new(middle(0), middle(1), middle(2));
    if middle.amax() < FAR {
        return None;
    }
    let metres = Unit::of(input).ok()?.factor;
    let by = middle.map(|m| if m.abs() * metres > FAR { -m.round() } else { 0.0 });
    (by != Vector3::zeros()).then_some(by)
}

impl Unit {
    /// Errors: too few points, all in a plane or on a line, an impossible size.
    pub(crate) fn of(input: &[Point3<f64>]) -> Result<Self, ModellingError> {
        let finite = input.iter().filter(|p| usable(p)).count();
        if finite < LEAST {
            return Err(ModellingError::TooFew { finite, total: input.len(), least: LEAST });
        }
        let span = spread(input);
        // Furniture is 0.1 to 10 m across, and 0.2 m where it is measured in centimetres or millimetres.
        let factor = match span {
            s if s > 100.0 => 1e-3,
            s if s > 20.0 && on_a_floor(input) => 1.0,
            s if s > 20.0 => 1e-2,
            _ => 1.0,
        };
        let span = span * factor;
        if !(0.02..=100.0).contains(&span) {
            return Err(match span < 1e-9 {
                true => ModellingError::Flat { shape: "in one place" },
                false => ModellingError::Size { diagonal: span },
            });
        }
        flat(input)?;
        Ok(Self { factor, span, finite })
    }
}

/// How finely a cloud is looked at, m.
fn fineness(span: f64) -> f64 {
    (span / 400.0).max(FINEST)
}

/// Thins a cloud in metres.
///
/// Errors: as [`Unit::of`].
pub(crate) fn thin(cloud: &[Point3<f64>]) -> Result<Thinned, ModellingError> {
    let Unit { span, finite, .. } = Unit::of(cloud)?;
    let cell = fineness(span);
    let last = last_shown(cloud, finite);
    let shown = |i: usize, p: &Point3<f64>| usable(p) && last.is_none_or(|last| shuffled(i as u32) <= last);
    let (points, mut of_input) = spread_out(cloud, &shown, cell);
    if last.is_some() {
        let grid = Grid::new(&points, cell * FOLLOWS);
        for (i, p) in cloud.iter().enumerate().filter(|(i, p)| usable(p) && !shown(*i, p)) {
            of_input[i] = grid.nearest(p, cell * FOLLOWS).map(|k| k as u32);
        }
    }
    Ok(Thinned { points, cell, of_input })
}

/// The means of all points by cells of a grid: more of them than [`thin`] looks at, for what is large and far.
///
/// Errors: as [`Unit::of`].
pub(crate) fn in_cells(cloud: &[Point3<f64>]) -> Result<Thinned, ModellingError> {
    let mut size = fineness(Unit::of(cloud)?.span);
    loop {
        let mut cells: Cells<u32> = Cells::default();
        let mut sums: Vec<(Vector3<f64>, f64)> = Vec::new();
        let mut of_input = Vec::with_capacity(cloud.len());
        for p in cloud {
            of_input.push(usable(p).then(|| add(&mut cells, &mut sums, p, size)));
            if sums.len() > MOST {
                break;
            }
        }
        if sums.len() <= MOST {
            let points = sums.iter().map(|(sum, n)| Point3::from(sum / *n)).collect();
            return Ok(Thinned { points, cell: size, of_input });
        }
        size *= 1.25;
    }
}

/// Adds a point to the sum in its cell, and says which that is.
fn add(cells: &mut Cells<u32>, sums: &mut Vec<(Vector3<f64>, f64)>, p: &Point3<f64>, size: f64) -> u32 {
    let index = *cells.entry(cell(p, size)).or_insert(sums.len() as u32);
    match sums.get_mut(index as usize) {
        Some(sum) => {
            sum.0 += p.coords;
            sum.1 += 1.0;
        }
        None => sums.push((p.coords, 1.0)),
    }
    index
}

/// Points that were not looked at are taken for what the nearest that was is, if it is not farther than so many cells.
const FOLLOWS: f64 = 8.0;

/// Of more usable points than are shown, the mixed number of the last that is.
fn last_shown(input: &[Point3<f64>], all: usize) -> Option<u64> {
    if all <= SHOWN {
        return None;
    }
    let mut mixed: Vec<u64> = (0..input.len()).filter(|i| usable(&input[*i])).map(|i| shuffled(i as u32)).collect();
    Some(*mixed.select_nth_unstable(SHOWN - 1).1)
}

/// Points that are kept are at least so far apart, in sizes of a cell: on a surface there are as many then as one a cell.
const APART: f64 = 0.84;
/// How many times finer points are put together before.
const FINER: f64 = 4.0;

/// Points no two of which are near one another, such that each input point has one nearby; each is the mean of the input points that are
/// nearest to it. Those that are not shown have none.
///
/// Taken at random (dart throwing; Cook 1986), and not one a cell of a grid: a surface that stands askew to a grid's layers passes from one
/// into the next every few millimetres, with half as many points again where it does. In dense clouds such stripes look like gaps.
fn spread_out(input: &[Point3<f64>], shown: &impl Fn(usize, &Point3<f64>) -> bool, size: f64) -> (Vec<Point3<f64>>, Vec<Option<u32>>) {
    // What is dense beyond need is put together first.
    let mut cells: Cells<u32> = Cells::default();
    let mut sums: Vec<(Vector3<f64>, f64)> = Vec::new();
    let finer = size / FINER;
    let put = |(i, p): (usize, &Point3<f64>)| shown(i, p).then(|| add(&mut cells, &mut sums, p, finer));
    let of_input: Vec<Option<u32>> = input.iter().enumerate().map(put).collect();
    let fine: Vec<Point3<f64>> = sums.iter().map(|(sum, n)| Point3::from(sum / *n)).collect();
    let apart = APART * size;
    let grid = Grid::new(&fine, apart);
    let mut order: Vec<u32> = (0..fine.len() as u32).collect();
    order.sort_unstable_by_key(|i| shuffled(*i));
    // Of each the nearest that is kept.
    let mut stands: Vec<Option<(f64, u32)>> = vec![None; fine.len()];
    let mut kept = 0;
    for i in order {
        if stands[i as usize].is_some() {
            continue;
        }
        kept += 1;
        grid.near(&fine[i as usize], apart, |j, d| {
            if stands[j].is_none_or(|s| d < s.0) {
                stands[j] = Some((d, i));
            }
        });
    }
    // Numbered in the order of the input.
    let mut number: Vec<Option<u32>> = vec![None; fine.len()];
    let mut means: Vec<(Vector3<f64>, f64)> = Vec::with_capacity(kept);
    let of_fine: Vec<Option<u32>> = stands
        .iter()
        .zip(&sums)
        .map(|(stand, (sum, n))| {
            let (_, i) = (*stand)?;
            let own = *number[i as usize].get_or_insert(means.len() as u32);
            match means.get_mut(own as usize) {
                Some(mean) => {
                    mean.0 += sum;
                    mean.1 += n;
                }
                None => means.push((*sum, *n)),
            }
            Some(own)
        })
        .collect();
    let points = means.iter().map(|(sum, n)| Point3::from(sum / *n)).collect();
    (points, of_input.iter().map(|i| i.and_then(|i| of_fine[i as usize])).collect())
}

/// A number in whose order numbers are mixed well (the finalizer of SplitMix64; Steele, Lea and Flood 2014); no two have the same.
fn shuffled(i: u32) -> u64 {
    let mut x = u64::from(i).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Diagonal of the box that holds all but the outermost half per cent along each axis.
fn spread(points: &[Point3<f64>]) -> f64 {
    let range = |k: usize| {
        let mut c = along(points, k);
        let cut = c.len() / 200;
        let last = c.len() - 1 - cut;
        let (_, low, _) = c.select_nth_unstable_by(cut, f64::total_cmp);
        let low = *low;
        let (_, high, _) = c.select_nth_unstable_by(last, f64::total_cmp);
        *high - low
    };
    Vector3::new(range(0), range(1), range(2)).norm()
}

/// Furniture is not as high, m.
const HIGH: f64 = 4.0;
/// What lies on a floor is within this share of a cloud's height.
const LOW: f64 = 0.2;

/// Are the points of something in metres on a floor that is seen far around? They are low as a whole, and most of them are lowest.
fn on_a_floor(points: &[Point3<f64>]) -> bool {
    let mut z = along(points, 2);
    z.sort_unstable_by(f64::total_cmp);
    let cut = z.len() / 200;
    let (low, high) = (z[cut], z[z.len() - 1 - cut]);
    high - low < HIGH && z.partition_point(|z| *z < low + LOW * (high - low)) > z.len() / 2
}

/// Are the points spread in three directions?
fn flat(points: &[Point3<f64>]) -> Result<(), ModellingError> {
    let mut values: Vec<f64> = covariance(points).symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(f64::total_cmp);
    let (least, middle, most) = (values[0], values[1], values[2]);
    if middle < 1e-6 * most {
        return Err(ModellingError::Flat { shape: "on a line" });
    }
    // A hundredth of the spread: less is a sheet with noise.
    if least < 1e-5 * most {
        return Err(ModellingError::Flat { shape: "in a plane" });
    }
    Ok(())
}

/// How many times farther from one plane than from their neighbours' points may lie for all to be one sheet.
const SHEET: f64 = 1.15;

/// Do all points lie as near to one plane as neighbours do to theirs? Then nothing but noise stands out of it.
pub(crate) fn is_sheet(points: &[Point3<f64>], local: &[Local]) -> bool {
    let mut near: Vec<f64> = local.iter().map(|l| l.residual).filter(|r| r.is_finite()).collect();
    if near.is_empty() || points.is_empty() {
        return false;
    }
    let middle = near.len() / 2;
    let near = *near.select_nth_unstable_by(middle, f64::total_cmp).1;
    covariance(points).symmetric_eigenvalues().min().max(0.0).sqrt() < SHEET * near
}

fn covariance(points: &[Point3<f64>]) -> Matrix3<f64> {
    mean_and_covariance(points.iter().filter(|p| usable(p)).map(|p| p.coords)).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform in 0..1.
    fn unit(i: usize) -> f64 {
        shuffled(i as u32) as f64 / u64::MAX as f64
    }

    /// A wall far denser than what is kept, turned about z: of each stripe of 4 mm along it, how many points are kept.
    fn stripes(degrees: f64) -> Vec<f64> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let wall: Vec<Point3<f64>> = (0..150_000)
            .map(|i| {
                let (along, up, off) = (0.5 * unit(3 * i), 0.25 * unit(3 * i + 1), 0.001 * (unit(3 * i + 2) - 0.5));
                Point3::new(along * cos - off * sin, along * sin + off * cos, up)
            })
            .collect();
        let (kept, of) = spread_out(&wall, &|_, _| true, 0.003);
        assert!(of.iter().all(|k| k.is_some_and(|k| (k as usize) < kept.len())));
        let mut counts = vec![0.0; 125];
        for p in &kept {
            counts[(((p.x * cos + p.y * sin) / 0.004) as usize).min(124)] += 1.0;
        }
        counts.drain(..2);
        counts.truncate(121);
        counts
    }

    #[test]
    fn a_dense_wall_is_thinned_evenly_however_it_stands() {
        for degrees in [0.0, 1.0, 3.0, 11.0, 27.0, 45.0] {
            let counts = stripes(degrees);
            let mean = counts.iter().sum::<f64>() / counts.len() as f64;
            let deviation = (counts.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / counts.len() as f64).sqrt();
            assert!((80.0..130.0).contains(&mean), "{mean} a stripe at {degrees} degrees");
            // Drawn without regard to one another they would differ by the root of their mean: a tenth.
            assert!(deviation < 0.08 * mean, "{mean} a stripe, give or take {deviation}, at {degrees} degrees");
        }
    }
}
