//! How noisy the data are, from the data alone.

use rand::RngExt;
use rand_pcg::Pcg64;

use crate::observer::{DriveSlopes, Noise};
use sagci_model::ActuatorLaw;
use sagci_recording::CommandKind;

use crate::inputs::per_input;
use crate::trajectory::{Drive, Trajectory};

/// Number of points of a divided difference; it is blind to polynomials of a degree less than this minus one.
const POINTS: usize = 6;

/// No effort is read better than this, N m or N.
const LEAST_READING: f64 = 1e-9;

/// Standard deviation of the noise on a joint's positions: the median of normalised divided differences, which see nothing of a
/// smooth motion, and of which jumps in acceleration spoil only few.
pub(crate) fn of_positions(trajectories: &[Trajectory], joint: usize) -> f64 {
    let series =
        |t: &Trajectory| -> Vec<(f64, f64)> { t.time.iter().copied().zip(t.positions(joint)).filter(|(_, y)| y.is_finite()).collect() };
    let changes = |t: &Trajectory| series(t).windows(2).map(|w| (w[1].1 - w[0].1).abs()).filter(|d| *d > 0.0).collect::<Vec<_>>();
    let steps: Vec<f64> = trajectories.iter().flat_map(changes).collect();
    // A position read in steps has at least the noise of these, evenly spread over one.
    let quantum = quantum(&steps).unwrap_or(0.0) / 12f64.sqrt();
    median_difference(trajectories.iter().map(series)).max(quantum).max(1e-9)
}

/// The median of normalised divided differences of series of times and values, as a standard deviation.
fn median_difference(series: impl Iterator<Item = Vec<(f64, f64)>>) -> f64 {
    let mut differences = Vec::new();
    for samples in series {
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
    differences.sort_by(f64::total_cmp);
    1.4826 * differences.get(differences.len() / 2).copied().unwrap_or(0.0)
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

/// A number from the standard normal distribution (Box and Muller 1958).
pub(crate) fn normal(random: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// Median of each joint's positions.
pub(crate) fn middle(trajectories: &[Trajectory], joints: usize) -> Vec<f64> {
    (0..joints)
        .map(|j| {
            let mut seen: Vec<f64> = trajectories.iter().flat_map(|t| t.positions(j)).filter(|y| y.is_finite()).collect();
            seen.sort_by(f64::total_cmp);
            seen.get(seen.len() / 2).copied().unwrap_or(0.0)
        })
        .collect()
}

/// Standard deviation of the noise on a joint's measured efforts, where these drive it; zero where they do not.
pub(crate) fn of_efforts(trajectories: &[Trajectory], joint: usize) -> f64 {
    let measured = trajectories.iter().filter(|t| t.drive[joint] == Drive::Effort);
    median_difference(measured.map(|t| t.time.iter().copied().zip(t.input.iter().skip(joint).step_by(t.joints).copied()).collect()))
}

/// Standard deviation of the noise on a joint's efforts that are measured beside a command; zero where there are none.
pub(crate) fn of_readings(trajectories: &[Trajectory], joint: usize) -> f64 {
    let series = |t: &Trajectory| -> Vec<(f64, f64)> {
        let efforts = t.effort.iter().skip(joint).step_by(t.joints).copied();
        t.time.iter().copied().zip(efforts).filter(|(_, u)| u.is_finite()).collect()
    };
    let any = trajectories.iter().any(|t| t.effort.iter().skip(joint).step_by(t.joints).any(|u| u.is_finite()));
    if any { median_difference(trajectories.iter().map(series)).max(LEAST_READING) } else { 0.0 }
}

/// What the data alone say, whatever the model: the noise of positions, and a share of the motion's accelerations.
pub(crate) fn of_motion(trajectories: &[Trajectory], joints: usize, share: f64) -> Noise {
    // With so much inertia, inputs accelerate nothing.
    let moved = accelerations(trajectories, &vec![f64::INFINITY; joints]);
    Noise {
        position: (0..joints).map(|j| of_positions(trajectories, j)).collect(),
        share: vec![share; joints],
        quiet: moved.iter().map(|a| QUIET * a).collect(),
        effort: vec![0.0; joints],
        mobility: vec![0.0; joints * joints],
        reading: vec![0.0; joints],
        drives: vec![DriveSlopes::default(); joints],
    }
}

/// Share of the typical acceleration that counts as none.
pub(crate) const QUIET: f64 = 0.1;

/// Time over which second differences are taken, s.
const SPAN: f64 = 0.1;

/// RMS of a joint's accelerations around each row, from second differences of positions.
pub(crate) fn liveliness(trajectory: &Trajectory, joint: usize) -> Vec<f64> {
    let y: Vec<f64> = trajectory.positions(joint).collect();
    let width = ((SPAN / trajectory.period()).round() as usize).max(2);
    let square = |k: usize| -> Option<f64> {
        let a = (y.get(k + width)? - 2.0 * y[k] + y[k.checked_sub(width)?]) / (trajectory.time[k + width] - trajectory.time[k]).powi(2);
        a.is_finite().then_some(a * a)
    };
    let squares: Vec<Option<f64>> = (0..y.len()).map(square).collect();
    let around = |k: usize| {
        let near = &squares[k.saturating_sub(width)..(k + width + 1).min(y.len())];
        let count = near.iter().flatten().count();
        if count > 0 { (near.iter().flatten().sum::<f64>() / count as f64).sqrt() } else { 0.0 }
    };
    (0..y.len()).map(around).collect()
}

/// RMS of the efforts on a joint around each row: measured, commanded, or what a drive's law makes of a command and the position.
pub(crate) fn strain(trajectory: &Trajectory, joint: usize, law: Option<&ActuatorLaw>) -> Vec<f64> {
    let n = trajectory.joints;
    let position = |k: usize| trajectory.position[k * n + joint];
    let (drive, slope) = (trajectory.drive[joint], per_input(trajectory.drive[joint], law));
    let efforts = trajectory.input.iter().skip(joint).step_by(n).enumerate().map(|(k, u)| match drive {
        Drive::Command(CommandKind::Position) => slope * (u - position(k)),
        _ => slope * u,
    });
    let width = ((SPAN / trajectory.period()).round() as usize).max(2);
    // Sums from the first row on, so that any row's neighbours cost one difference.
    let mut sums = vec![0.0];
    for u in efforts {
        sums.push(sums[sums.len() - 1] + if u.is_finite() { u * u } else { 0.0 });
    }
    let rows = trajectory.rows();
    let around = |k: usize| {
        let (from, to) = (k.saturating_sub(width), (k + width + 1).min(rows));
        ((sums[to] - sums[from]).max(0.0) / (to - from) as f64).sqrt()
    };
    (0..rows).map(around).collect()
}

/// Typical acceleration of each joint: of its motion, or of what its input would give it, whichever is more.
pub(crate) fn accelerations(trajectories: &[Trajectory], inertias: &[f64]) -> Vec<f64> {
    (0..inertias.len())
        .map(|j| {
            let (mut moved, mut pushed, mut count, mut inputs) = (0.0, 0.0, 0.0, 0.0);
            for trajectory in trajectories {
                let y: Vec<f64> = trajectory.positions(j).collect();
                let period = trajectory.period();
                let width = ((SPAN / period).round() as usize).max(2);
                for k in (width..y.len().saturating_sub(width)).filter(|k| y[*k].is_finite()) {
                    let a = (y[k + width] - 2.0 * y[k] + y[k - width]) / (width as f64 * period).powi(2);
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
