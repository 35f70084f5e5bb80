//! From a cloud as it comes to one that can be worked with: numbers only, in metres, of an even and bounded density.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::ModellingError;
use crate::grid::{Cells, cell};

/// Fewest points that say anything.
pub(crate) const LEAST: usize = 100;
/// Most points that are kept.
const MOST: usize = 24_000;
/// Finest cell, m.
const FINEST: f64 = 0.0025;

/// A thinned cloud.
pub(crate) struct Thinned {
    /// Means of the cells, m.
    pub(crate) points: Vec<Point3<f64>>,
    /// Size of a cell, m.
    pub(crate) cell: f64,
    /// Of each input point, the thinned point that stands for it.
    pub(crate) of_input: Vec<Option<u32>>,
    /// What the input's lengths were multiplied by to get metres.
    pub(crate) factor: f64,
    /// Number of input points that are finite.
    pub(crate) finite: usize,
}

/// Thins a cloud, and finds its unit.
///
/// Errors: too few points, all in a plane or on a line, an impossible size.
pub(crate) fn thin(input: &[Point3<f64>]) -> Result<Thinned, ModellingError> {
    // Beyond this no arm reaches, whatever the unit.
    let usable = |p: &Point3<f64>| p.iter().all(|c| c.is_finite() && c.abs() < 1e6);
    let kept: Vec<Point3<f64>> = input.iter().copied().filter(usable).collect();
    if kept.len() < LEAST {
        return Err(ModellingError::TooFew { finite: kept.len(), total: input.len(), least: LEAST });
    }
    let span = spread(&kept);
    // Furniture is 0.1 to 10 m across. What is a hundred times that is in millimetres.
    let factor = if span > 100.0 { 1e-3 } else { 1.0 };
    let span = span * factor;
    if !(0.02..=100.0).contains(&span) {
        return Err(match span < 1e-9 {
            true => ModellingError::Flat { shape: "in one place" },
            false => ModellingError::Size { diagonal: span },
        });
    }
    flat(&kept)?;
    let mut size = (span / 400.0).max(FINEST);
    loop {
        let mut cells: Cells<u32> = Cells::default();
        let mut sums: Vec<(Vector3<f64>, f64)> = Vec::new();
        let mut of_input = Vec::with_capacity(input.len());
        for p in input {
            if !usable(p) {
                of_input.push(None);
                continue;
            }
            let p = p * factor;
            let index = *cells.entry(cell(&p, size)).or_insert(sums.len() as u32);
            match sums.get_mut(index as usize) {
                Some(sum) => {
                    sum.0 += p.coords;
                    sum.1 += 1.0;
                }
                None => sums.push((p.coords, 1.0)),
            }
            of_input.push(Some(index));
            if sums.len() > MOST {
                break;
            }
        }
        if sums.len() <= MOST {
            let points = sums.iter().map(|(sum, n)| Point3::from(sum / *n)).collect();
            return Ok(Thinned { points, cell: size, of_input, factor, finite: kept.len() });
        }
        size *= 1.25;
    }
}

/// Diagonal of the box that holds all but the outermost half per cent along each axis.
fn spread(points: &[Point3<f64>]) -> f64 {
    let range = |k: usize| {
        let mut c: Vec<f64> = points.iter().map(|p| p[k]).collect();
        let cut = c.len() / 200;
        let last = c.len() - 1 - cut;
        let (_, low, _) = c.select_nth_unstable_by(cut, f64::total_cmp);
        let low = *low;
        let (_, high, _) = c.select_nth_unstable_by(last, f64::total_cmp);
        *high - low
    };
    Vector3::new(range(0), range(1), range(2)).norm()
}

/// Are the points spread in three directions?
fn flat(points: &[Point3<f64>]) -> Result<(), ModellingError> {
    let n = points.len() as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let covariance = points.iter().map(|p| (p.coords - mean) * (p.coords - mean).transpose()).sum::<Matrix3<f64>>() / n;
    let mut values: Vec<f64> = covariance.symmetric_eigenvalues().iter().copied().collect();
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
