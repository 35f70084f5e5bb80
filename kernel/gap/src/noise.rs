//! How noisy the data are, from the data alone.

use crate::observer::Noise;
use crate::plant::Plant;
use crate::trajectory::{Drive, Trajectory};

/// Number of points of a divided difference; it is blind to polynomials of a degree less than this minus one.
const POINTS: usize = 6;

/// Standard deviation of the noise on a joint's positions: the median of normalised divided differences, which see nothing of a
/// smooth motion, and of which jumps in acceleration spoil only few.
pub(crate) fn of_positions(trajectories: &[Trajectory], joint: usize) -> f64 {
    let mut differences = Vec::new();
    let mut steps = Vec::new();
    for trajectory in trajectories {
        let samples: Vec<(f64, f64)> =
            trajectory.time.iter().copied().zip(trajectory.positions(joint)).filter(|(_, y)| y.is_finite()).collect();
        steps.extend(samples.windows(2).map(|w| (w[1].1 - w[0].1).abs()).filter(|d| *d > 0.0));
        for window in samples.windows(POINTS) {
            let span = window[POINTS - 1].0 - window[0].0;
            let weight = |i: usize| {
                let others = (0..POINTS).filter(|j| *j != i);
                1.0 / others.map(|j| (window[i].0 - window[j].0) / span).product::<f64>()
            };
            let weights: [f64; POINTS] = std::array::from_fn(weight);
            let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
            differences.push((weights.iter().zip(window).map(|(w, s)| w * s.1).sum::<f64>() / norm).abs());
        }
    }
    let median = |values: &mut Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values.get(((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1))).copied().unwrap_or(0.0)
    };
    let spread = 1.4826 * median(&mut differences, 0.5);
    // A position read in steps has at least the noise of these, evenly spread over one.
    let quantum = quantum(&steps).unwrap_or(0.0) / 12f64.sqrt();
    spread.max(quantum).max(1e-9)
}

/// The step in which positions are read, if all their changes are multiples of one.
fn quantum(changes: &[f64]) -> Option<f64> {
    // Changes that a text or a single-precision number has rounded away are none.
    let largest = changes.iter().copied().fold(0.0, f64::max);
    let real: Vec<f64> = changes.iter().copied().filter(|d| *d > 1e-6 * largest).collect();
    let mut sorted = real.clone();
    sorted.sort_by(f64::total_cmp);
    let smallest = *sorted.get(sorted.len() / 100)?;
    let few: Vec<f64> = real.iter().copied().filter(|d| *d < 20.5 * smallest).collect();
    let off = |d: &f64| (d / smallest - (d / smallest).round()).abs();
    let fits = few.iter().filter(|d| off(d) < 0.1).count();
    // By chance a fifth of all would fit.
    (few.len() > 50 && fits as f64 > 0.9 * few.len() as f64).then_some(smallest)
}

/// Inertia that each joint's drive feels, `1 / (M^-1)_jj`, in the middle of the data.
pub(crate) fn inertias(plant: &Plant, trajectories: &[Trajectory]) -> Vec<f64> {
    let multibody = plant.system.multibody();
    let n = multibody.nv();
    let mut q = plant.system.state().q;
    for (j, q) in q.iter_mut().enumerate() {
        let mut seen: Vec<f64> = trajectories.iter().flat_map(|t| t.positions(j)).filter(|y| y.is_finite()).collect();
        seen.sort_by(f64::total_cmp);
        if let Some(middle) = seen.get(seen.len() / 2) {
            *q = *middle;
        }
    }
    let mut ws = multibody.workspace();
    let zero = vec![0.0; n];
    if multibody.set_state(&mut ws, &q, &zero).is_err() {
        return vec![1.0; n];
    }
    let Ok(mass) = multibody.mass_matrix(&mut ws).cloned() else { return vec![1.0; n] };
    let Some(factor) = nalgebra::Cholesky::new(mass) else { return vec![1.0; n] };
    let inverse = factor.inverse();
    (0..n).map(|j| 1.0 / inverse[(j, j)]).collect()
}

/// What the data alone say, whatever the model: the noise of positions, and a share of the motion's accelerations.
pub(crate) fn of_motion(trajectories: &[Trajectory], joints: usize, share: f64) -> Noise {
    // With so much inertia, inputs accelerate nothing.
    let moved = accelerations(trajectories, &vec![f64::INFINITY; joints]);
    Noise {
        position: (0..joints).map(|j| of_positions(trajectories, j)).collect(),
        acceleration: moved.iter().map(|a| share * a).collect(),
    }
}

/// Typical acceleration of each joint: of its motion, or of what its input would give it, whichever is more.
pub(crate) fn accelerations(trajectories: &[Trajectory], inertias: &[f64]) -> Vec<f64> {
    const SPAN: f64 = 0.1;
    (0..inertias.len())
        .map(|j| {
            let (mut moved, mut pushed, mut count, mut inputs) = (0.0, 0.0, 0.0, 0.0);
            for trajectory in trajectories {
                let y: Vec<f64> = trajectory.positions(j).collect();
                let width = ((SPAN / trajectory.period()).round() as usize).max(2);
                for k in (width..y.len().saturating_sub(width)).filter(|k| y[*k].is_finite()) {
                    let a = (y[k + width] - 2.0 * y[k] + y[k - width]) / (width as f64 * trajectory.period()).powi(2);
                    if a.is_finite() {
                        moved += a * a;
                        count += 1.0;
                    }
                }
                if matches!(trajectory.drive[j], Drive::Effort | Drive::Command(sagci_recording::CommandKind::Effort)) {
                    let efforts = trajectory.input.iter().skip(j).step_by(trajectory.joints).filter(|u| u.is_finite());
                    for u in efforts {
                        pushed += (u / inertias[j]).powi(2);
                        inputs += 1.0;
                    }
                }
            }
            let rms = |sum: f64, count: f64| if count > 0.0 { (sum / count).sqrt() } else { 0.0 };
            rms(moved, count).max(rms(pushed, inputs)).max(1e-6)
        })
        .collect()
}
