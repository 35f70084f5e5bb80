//! The directions that smooth residuals leave loose are settled by the likelihood of the whole images.
//!
//! Which pixel sees a mug's thin handle and which sees past it says more about the mug's yaw than the depth of those that
//! see it; but such a change is a jump, which Gauss-Newton's steps do not feel. So along the loosest directions of the
//! pose the images are rendered and compared at even steps, and mean and variance are taken of the likelihood found there.

use nalgebra::{DMatrix, DVector};

use crate::align::Aligned;
use crate::evidence::{Windows, misfit};
use crate::problem::Problem;

/// Number of steps to either side.
const STEPS: i32 = 12;
/// Directions that are settled at most, and rays that they may cost.
const DIRECTIONS: usize = 2;
const MOST_RAYS: usize = 400_000;
/// Directions known better than this are left alone, m at the surface.
const KNOWN: f64 = 0.0003;

/// Settles the loosest directions of an aligned hypothesis.
pub(crate) fn polish(problem: &Problem<'_>, aligned: &mut Aligned) {
    let size = aligned.information.nrows();
    let free = &problem.free;
    // The camera's error is held: it moves all poses alike.
    let scale: Vec<f64> = free.iter().map(|&i| if i < 3 { problem.radius } else { 1.0 }).collect();
    let own = DMatrix::from_fn(free.len(), free.len(), |a, b| aligned.information[(free[a], free[b])] / (scale[a] * scale[b]));
    let eigen = own.symmetric_eigen();
    let mut order: Vec<usize> = (0..free.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let footprint = footprint(problem);
    let windows = Windows::around(problem, &aligned.hypothesis, 3.0);
    let deviation = aligned.rms.max(0.001) * 1.2;
    let mut spread = DMatrix::zeros(size, size);
    for &k in order.iter().take(DIRECTIONS) {
        let loose = 1.0 / eigen.eigenvalues[k].max(1e-6).sqrt();
        if loose < KNOWN || windows.rays * (2 * STEPS as usize + 1) > MOST_RAYS {
            continue;
        }
        let mut direction = DVector::zeros(size);
        for (a, &i) in free.iter().enumerate() {
            direction[i] = eigen.eigenvectors[(a, k)] / scale[a];
        }
        let reach = (4.0 * loose).max(1.5 * footprint).min(0.05);
        let prior = |t: f64| {
            let d =
                problem.start.difference(&aligned.hypothesis.moved(&(&direction * t), &problem.request.joints), &problem.request.joints);
            (d.transpose() * &problem.prior_information * &d)[0]
        };
        let at: Vec<f64> = (-STEPS..=STEPS).map(|s| reach * f64::from(s) / f64::from(STEPS)).collect();
        let price: Vec<f64> = at
            .iter()
            .map(|&t| {
                let h = aligned.hypothesis.moved(&(&direction * t), &problem.request.joints);
                misfit(problem, &h, &windows, deviation) / aligned.area + prior(t)
            })
            .collect();
        let least = price.iter().copied().fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = price.iter().map(|p| (-(p - least) / 2.0).exp()).collect();
        let total: f64 = weights.iter().sum();
        let mean = at.iter().zip(&weights).map(|(t, w)| t * w).sum::<f64>() / total;
        let variance = at.iter().zip(&weights).map(|(t, w)| (t - mean) * (t - mean) * w).sum::<f64>() / total;
        // Between two steps the likelihood is not known.
        let variance = variance + (reach / f64::from(STEPS)).powi(2) / 12.0;
        aligned.hypothesis = aligned.hypothesis.moved(&(&direction * mean), &problem.request.joints);
        spread += &direction * direction.transpose() * (variance - loose * loose).max(0.0);
    }
    if spread.norm() > 0.0
        && let Some(covariance) = aligned.information.clone().try_inverse()
        && let Some(information) = (covariance + spread).try_inverse()
    {
        aligned.information = information;
    }
}

/// Size of a pixel at the object in the view that sees it most closely, m.
fn footprint(problem: &Problem<'_>) -> f64 {
    let center = nalgebra::Point3::from(problem.start.X_WO.translation.vector);
    problem.frames.iter().map(|f| f.footprint((center - f.eye()).norm())).fold(f64::INFINITY, f64::min).min(0.02)
}
