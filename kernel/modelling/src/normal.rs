//! Normals by the least direction of spread of a point's surroundings (Hoppe et al. 1992).

use nalgebra::{Matrix3, Point3, Vector3};

use crate::grid::Grid;

/// A point's surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Local {
    /// Unit normal; its sign means nothing.
    pub(crate) normal: Vector3<f64>,
    /// RMS distance of the surroundings from their plane, m.
    pub(crate) residual: f64,
    /// How many points the plane rests on.
    pub(crate) support: usize,
}

/// Mean and covariance of points; zeros of none.
pub(crate) fn mean_and_covariance(points: impl Iterator<Item = Vector3<f64>> + Clone) -> (Vector3<f64>, Matrix3<f64>) {
    let n = points.clone().count().max(1) as f64;
    let mean = points.clone().sum::<Vector3<f64>>() / n;
    (mean, points.map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / n)
}

/// The least eigenvector of a covariance, and its eigenvalue.
pub(crate) fn least(covariance: &Matrix3<f64>) -> (Vector3<f64>, f64) {
    let e = covariance.symmetric_eigen();
    let k = e.eigenvalues.imin();
    (e.eigenvectors.column(k).into_owned(), e.eigenvalues[k].max(0.0))
}

/// Normals from all points within a radius.
pub(crate) fn normals(points: &[Point3<f64>], grid: &Grid, radius: f64) -> Vec<Local> {
    points
        .iter()
        .map(|p| {
            let (mut n, mut sum, mut squares) = (0.0, Vector3::zeros(), Matrix3::zeros());
            grid.near(p, radius, |i, _| {
                let d = points[i] - p;
                n += 1.0;
                sum += d;
                squares += d * d.transpose();
            });
            if n < 4.0 {
                return Local { normal: Vector3::zeros(), residual: f64::INFINITY, support: n as usize };
            }
            let mean = sum / n;
            let (normal, value) = least(&(squares / n - mean * mean.transpose()));
            Local { normal, residual: value.sqrt(), support: n as usize }
        })
        .collect()
}
