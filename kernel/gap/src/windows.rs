//! The gap: how far positions predicted over a window of time are off.
//!
//! A window starts from the smoothed measured state, its inner states from a run along the measured motion, and the model goes on
//! alone from there. The figures are root mean squares over samples, by joint; pooled over joints, the RMS of each joint's figure in
//! shares of its range. A window that diverges counts as the joint's range.

use nalgebra::DVector;
use rayon::prelude::*;
use serde::Serialize;

use crate::GapError;
use crate::observer::{self, Errors, Noise, Run};
use crate::part;
use crate::plant::{Motion, Plant};
use crate::trajectory::Trajectory;

/// One figure of the gap.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Figures {
    /// RMSE by joint, rad or m.
    pub rmse: Vec<f64>,
    /// Median over windows of the RMSE in each, by joint.
    pub median: Vec<f64>,
    /// RMSE by joint in windows of 0.25 s.
    pub rmse_short: Vec<f64>,
    /// RMS over joints of the RMSE in shares of the joint's range.
    pub pooled: f64,
}

/// Short windows, s.
pub(crate) const SHORT: f64 = 0.25;

/// One window as a plant predicts it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Window {
    pub trajectory: usize,
    /// The first row that is predicted.
    pub first: usize,
    /// Positions and velocities by row and joint; positions are NaN from where the plant could not be simulated.
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
}

/// The run along the data that gives windows their first states.
pub(crate) struct Smoothed {
    pub runs: Vec<Run>,
    /// Factors on the noises of positions and accelerations that are most likely.
    pub factors: [f64; 2],
}

/// Factors on the noises among which the most likely are taken.
const ACCELERATIONS: [f64; 12] = [0.05, 0.15, 0.4, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0];
const POSITIONS: [f64; 4] = [1.0, 2.0, 4.0, 8.0];

/// How often factors are sought along both.
const ROUNDS: usize = 2;

/// Mean square of the errors along a trajectory, in their deviations, from which on an observer has lost it, and how often it may follow twice as
/// hard.
const LOST: f64 = 25.0;
const HARDER: usize = 10;

/// How factors on the noises are sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Seek {
    /// That on positions first, and from the least on: what is not likelier soon is not believed.
    Cautiously,
    /// To all sides, either first.
    Everywhere,
}

/// No bounds.
const ANY: [f64; 2] = [0.0, f64::INFINITY];

/// Factors on the noises of positions and accelerations under which a plant's prediction errors are most likely, that on
/// accelerations within `range`: a model that lacks something is trusted less. Noise of positions that is not white hides from
/// neighbouring samples, so it is asked about here, too. `noise` are the filter's at factors.
pub(crate) fn likely_noise(
    plant: &Plant,
    trajectories: &[Trajectory],
    noise: &(dyn Fn([f64; 2]) -> Noise + Sync),
    range: [f64; 2],
    seek: Seek,
) -> [f64; 2] {
    let run = |factors: [f64; 2]| -> f64 {
        let one = |trajectory: &Trajectory| {
            let mut errors = Errors::default();
            let run = observer::run(plant, trajectory, &noise(factors), &mut plant.motion(), &mut errors, None);
            run.map_or(f64::INFINITY, |gains| 0.5 * errors.position.iter().map(|e| e * e).sum::<f64>() + gains.log_determinant())
        };
        trajectories.par_iter().map(one).sum()
    };
    // Along one, then along the other, from where it stands to both sides. Either may come first: to a model that is lost any noise of positions
    // seems too small, and where that is not white any of accelerations.
    let mut known: Vec<([f64; 2], f64)> = Vec::new();
    let mut cost = |factors: [f64; 2]| -> f64 {
        if let Some((_, found)) = known.iter().find(|(at, _)| *at == factors) {
            return *found;
        }
        let found = run(factors);
        known.push((factors, found));
        found
    };
    let accelerations: Vec<f64> = ACCELERATIONS.into_iter().filter(|f| (range[0]..=range[1]).contains(f)).collect();
    let mut valley = |order: [usize; 2]| {
        let mut best = (cost([1.0; 2]), [1.0; 2]);
        for _ in 0..ROUNDS {
            let before = best.1;
            for along in order {
                let factors = if along == 0 { &POSITIONS[..] } else { &accelerations };
                let here = best.1[along];
                let up: Vec<f64> = factors.iter().copied().filter(|f| *f > here).collect();
                let down: Vec<f64> = factors.iter().rev().copied().filter(|f| *f < here).collect();
                let sides = if seek == Seek::Cautiously { vec![factors.to_vec()] } else { vec![up, down] };
                for side in sides {
                    let mut worse = 0;
                    for factor in side {
                        let mut tried = best.1;
                        tried[along] = factor;
                        let found = cost(tried);
                        if found < best.0 {
                            best = (found, tried);
                            worse = 0;
                        } else {
                            worse += 1;
                        }
                        // An observer that follows too softly loses an arm that falls, whatever the factors nearby.
                        if worse > 1 && best.0.is_finite() {
                            break;
                        }
                    }
                }
            }
            if before == best.1 {
                break;
            }
        }
        best
    };
    let orders: &[[usize; 2]] = if seek == Seek::Cautiously { &[[0, 1]] } else { &[[1, 0], [0, 1]] };
    let ends = orders.iter().map(|order| valley(*order));
    ends.min_by(|a, b| a.0.total_cmp(&b.0)).map_or([1.0; 2], |best| best.1)
}

impl Noise {
    /// Factors on the noises of positions and accelerations under which a plant's prediction errors are most likely, by stretches that tell enough.
    pub fn likely_factors(&self, plant: &Plant, trajectories: &[Trajectory]) -> [f64; 2] {
        let part = part::stretches(trajectories);
        let data = part.as_deref().unwrap_or(trajectories);
        likely_noise(plant, data, &|factors| self.times(factors), ANY, Seek::Everywhere)
    }
}

/// Windows of a length: the row that each starts from, and the one that it ends before. What was put in before a recording began may
/// act in its first rows, where velocities are known by positions alone: windows start after these, in data that are long enough.
fn places(trajectory: &Trajectory, length: f64) -> Vec<(usize, usize)> {
    let later = places_after(trajectory, length, |start, row| trajectory.burns_in(start, row));
    if later.is_empty() { places_after(trajectory, length, |_, _| false) } else { later }
}

fn places_after(trajectory: &Trajectory, length: f64, is_early: impl Fn(usize, usize) -> bool) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let (mut start, mut next) = (0, f64::NEG_INFINITY);
    for row in 0..trajectory.rows() {
        if trajectory.starts.contains(&row) {
            (start, next) = (row, f64::NEG_INFINITY);
        }
        if trajectory.time[row] < next - 1e-9 || is_early(start, row) {
            continue;
        }
        if next == f64::NEG_INFINITY {
            next = trajectory.time[row];
        }
        next += 0.5 * length;
        let end = trajectory.time[row] + length;
        let stop = trajectory.starts.iter().copied().find(|s| *s > row).unwrap_or(trajectory.rows());
        // A window that the data do not fill is left out.
        if trajectory.time[stop - 1] >= end - 0.5 * length {
            let inside = trajectory.time[row + 1..stop].iter().take_while(|t| **t <= end + 1e-9).count();
            if inside > 0 {
                found.push((row, row + 1 + inside));
            }
        }
    }
    found
}

/// Is there a window of a length?
pub(crate) fn has_any(trajectory: &Trajectory, length: f64) -> bool {
    !places(trajectory, length).is_empty()
}

/// How long its longest stretch without a pause lasts, the last sample's own time included, s.
fn longest(trajectory: &Trajectory) -> f64 {
    let ends = trajectory.starts.iter().copied().skip(1).chain([trajectory.rows()]);
    let lasts = trajectory.starts.iter().zip(ends).map(|(start, end)| trajectory.time[end - 1] - trajectory.time[*start]);
    lasts.fold(0.0, f64::max) + trajectory.period()
}

/// Is a stretch as long as a window of a length, and does one hold samples?
pub(crate) fn has_whole(trajectory: &Trajectory, length: f64) -> bool {
    longest(trajectory) > length * (1.0 - 1e-6) && has_any(trajectory, length)
}

/// Refuses data of which no stretch is as long as a window: a figure over none would be zero.
pub(crate) fn check(trajectories: &[Trajectory], length: f64) -> Result<(), GapError> {
    if trajectories.is_empty() || trajectories.iter().any(|t| has_whole(t, length)) {
        return Ok(());
    }
    let place = trajectories.iter().map(|t| t.source.as_str()).collect::<Vec<_>>().join(", ");
    let most = trajectories.iter().map(longest).fold(0.0, f64::max);
    let apart = trajectories.iter().map(Trajectory::period).fold(f64::INFINITY, f64::min);
    let message = match most < length {
        // Down to what is surely less.
        true => format!(
            "no window of {length} s fits: the longest stretch without a pause lasts {most:.3} s; give a shorter one, --window {}, or record for \
             longer",
            (0.9 * most * 100.0).floor() / 100.0
        ),
        false => {
            format!("samples are {apart:.3} s apart, and a window of {length} s holds none but its first; give --window {:.2}", 4.0 * apart)
        }
    };
    Err(GapError::data(place, message))
}

/// Says which recordings have no window.
pub(crate) fn say_without(trajectories: &[Trajectory], length: f64, notes: &mut Vec<String>) {
    notes.extend(trajectories.iter().filter(|t| !has_any(t, length)).map(|t| {
        let lasts = longest(t);
        format!("{}: its longest stretch without a pause lasts {lasts:.3} s; no window of {length} s is in it, and it counts in no figure of the gap", t.source)
    }));
}

/// How far a prediction is off in shares of the joint's range, at the most all of it; none where nothing was measured.
fn off(predicted: f64, measured: f64, range: f64) -> Option<f64> {
    let error = predicted - measured;
    measured.is_finite().then(|| if error.is_nan() { 1.0 } else { (error / range).clamp(-1.0, 1.0) })
}

/// Sum of squares and number of samples, by window and joint.
fn sums(windows: &[Window], trajectories: &[Trajectory], ranges: &[f64]) -> Vec<Vec<[f64; 2]>> {
    let n = ranges.len();
    let of = |window: &Window| {
        let mut sums = vec![[0.0; 2]; n];
        let measured = &trajectories[window.trajectory].position[window.first * n..];
        for ((i, predicted), measured) in window.position.iter().enumerate().zip(measured) {
            if let Some(share) = off(*predicted, *measured, ranges[i % n]) {
                sums[i % n][0] += (share * ranges[i % n]).powi(2);
                sums[i % n][1] += 1.0;
            }
        }
        for (sum, range) in sums.iter_mut().zip(ranges) {
            // It has left the joint's range somewhere: it diverged.
            if sum[1] > 0.0 && sum[0] / sum[1] > 0.25 * range * range {
                sum[0] = sum[1] * range * range;
            }
        }
        sums
    };
    windows.iter().map(of).collect()
}

/// RMSE of a joint over all samples.
fn total(sums: &[Vec<[f64; 2]>], j: usize) -> f64 {
    let (square, count) = sums.iter().fold((0.0, 0.0), |(a, b), w| (a + w[j][0], b + w[j][1]));
    if count > 0.0 { (square / count).sqrt() } else { 0.0 }
}

/// RMS over joints of their RMSE in shares of their ranges.
fn pooled(rmse: &[f64], ranges: &[f64]) -> f64 {
    (rmse.iter().zip(ranges).map(|(e, r)| (e / r).powi(2)).sum::<f64>() / ranges.len() as f64).sqrt()
}

/// What comes of following under noises, harder and harder as long as that is nearer. How likely noises are is asked of short stretches. Along
/// whole recordings an observer that follows softly loses a joint that falls, however right its model is: the gain knows nothing of what pulls
/// it away. What is lost for good may be followed harder, too.
fn followed<T>(mut noise: Noise, under: impl Fn(&Noise) -> Result<(T, f64), GapError>) -> Result<T, GapError> {
    let mut found = under(&noise);
    for _ in 0..HARDER {
        if found.as_ref().is_ok_and(|(_, off)| *off < LOST) {
            break;
        }
        noise = noise.times([1.0, 2.0]);
        let harder = under(&noise);
        let is_nearer = match (&found, &harder) {
            (Ok((_, before)), Ok((_, after))) => after < before,
            (Ok(_), Err(_)) => false,
            (Err(_), _) => true,
        };
        if !is_nearer {
            break;
        }
        found = harder;
    }
    found.map(|(followed, _)| followed)
}

impl Smoothed {
    pub fn new(plant: &Plant, trajectories: &[Trajectory], noise: &Noise) -> Result<Self, GapError> {
        Self::under_factors(plant, trajectories, noise, noise.likely_factors(plant, trajectories))
    }

    /// The same under a noise whose most likely factors are known.
    pub fn under_factors(plant: &Plant, trajectories: &[Trajectory], noise: &Noise, factors: [f64; 2]) -> Result<Self, GapError> {
        let runs = followed(noise.times(factors), |noise| Self::under(plant, trajectories, noise))?;
        Ok(Self { runs, factors })
    }

    /// Runs under a noise, and the mean square of the errors along the trajectory where it is largest, in their deviations.
    fn under(plant: &Plant, trajectories: &[Trajectory], noise: &Noise) -> Result<(Vec<Run>, f64), GapError> {
        let mut motion = plant.motion();
        let (mut runs, mut largest) = (Vec::new(), 0.0f64);
        for trajectory in trajectories {
            let (mut run, mut errors) = (Run::default(), Errors::default());
            let gains = observer::run(plant, trajectory, noise, &mut motion, &mut errors, Some(&mut run))?;
            observer::smooth(&mut run, trajectory, &gains);
            largest = largest.max(errors.position.iter().map(|e| e * e).sum::<f64>() / errors.position.len().max(1) as f64);
            runs.push(run);
        }
        Ok((runs, largest))
    }

    /// Sets a motion where a run is in a row of its trajectory.
    pub fn set(&self, motion: &mut Motion, trajectory: &Trajectory, index: usize, row: usize) {
        let (run, n) = (&self.runs[index], trajectory.joints);
        motion.state.q.copy_from_slice(&run.q[row * n..(row + 1) * n]);
        motion.state.v.copy_from_slice(&run.v[row * n..(row + 1) * n]);
        let states = motion.state.z.len();
        motion.state.z.copy_from_slice(&run.z[row * states..(row + 1) * states]);
        motion.state.time = trajectory.time[row];
        motion.acceleration.fill(0.0);
    }

    /// Predicts all windows of a length, each half over the one before. None of them knows of others, so that they may be predicted side by
    /// side.
    pub fn predict(&self, plant: &Plant, trajectories: &[Trajectory], length: f64) -> Vec<Window> {
        let places: Vec<(usize, usize, usize)> =
            trajectories.iter().enumerate().flat_map(|(i, t)| places(t, length).into_iter().map(move |(row, end)| (i, row, end))).collect();
        places.into_par_iter().map(|(index, row, end)| self.follow(plant, &trajectories[index], index, row, end)).collect()
    }

    /// Lets a plant go on alone from a row until another.
    fn follow(&self, plant: &Plant, trajectory: &Trajectory, index: usize, row: usize, end: usize) -> Window {
        let n = trajectory.joints;
        let mut motion = plant.motion();
        self.set(&mut motion, trajectory, index, row);
        plant.clamp(&mut motion);
        let mut window = Window { trajectory: index, first: row + 1, position: Vec::new(), velocity: Vec::new() };
        let mut broken = false;
        for k in row..end - 1 {
            broken |= plant.interval(&mut motion, trajectory, k).is_err();
            window.position.extend((0..n).map(|j| if broken { f64::NAN } else { plant.reading(&motion, j) }));
            window.velocity.extend_from_slice(&motion.state.v);
            motion.state.time = trajectory.time[k + 1];
        }
        window
    }

    /// Errors of each window by row and joint, in shares of the joints' ranges, so that their squares sum to the square of the window's RMS.
    pub fn errors(&self, plant: &Plant, trajectories: &[Trajectory], length: f64, ranges: &[f64]) -> Vec<DVector<f64>> {
        let n = ranges.len();
        let of = |window: Window| {
            let measured = &trajectories[window.trajectory].position[window.first * n..];
            let shares = window.position.iter().zip(measured).enumerate().map(|(i, (p, y))| off(*p, *y, ranges[i % n]));
            let shares: Vec<Option<f64>> = shares.collect();
            let count = |j: usize| shares.iter().skip(j).step_by(n).flatten().count().max(1);
            let sizes: Vec<f64> = (0..n).map(|j| ((count(j) * n) as f64).sqrt()).collect();
            DVector::from_iterator(shares.len(), shares.iter().enumerate().map(|(i, e)| e.unwrap_or(0.0) / sizes[i % n]))
        };
        self.predict(plant, trajectories, length).into_iter().map(of).collect()
    }

    /// RMS in each window, in shares of the joints' ranges.
    pub fn by_window(&self, plant: &Plant, trajectories: &[Trajectory], length: f64, ranges: &[f64]) -> Vec<f64> {
        let of = |window: &Vec<[f64; 2]>| {
            let squares = window.iter().zip(ranges).filter(|(w, _)| w[1] > 0.0).map(|(w, r)| w[0] / w[1] / (r * r));
            (squares.sum::<f64>() / ranges.len() as f64).sqrt()
        };
        sums(&self.predict(plant, trajectories, length), trajectories, ranges).iter().map(of).collect()
    }

    /// The pooled figure alone.
    pub fn pooled(&self, plant: &Plant, trajectories: &[Trajectory], length: f64, ranges: &[f64]) -> f64 {
        let sums = sums(&self.predict(plant, trajectories, length), trajectories, ranges);
        let rmse: Vec<f64> = (0..ranges.len()).map(|j| total(&sums, j)).collect();
        pooled(&rmse, ranges)
    }

    /// The gap's figures, and the windows that they are of. `ranges` are those of the joints.
    pub fn figures(&self, plant: &Plant, trajectories: &[Trajectory], length: f64, ranges: &[f64]) -> (Figures, Vec<Window>) {
        let n = ranges.len();
        let windows = self.predict(plant, trajectories, length);
        let long = sums(&windows, trajectories, ranges);
        let short = sums(&self.predict(plant, trajectories, SHORT.min(length)), trajectories, ranges);
        let rmse: Vec<f64> = (0..n).map(|j| total(&long, j)).collect();
        let median = (0..n)
            .map(|j| {
                let mut each: Vec<f64> = long.iter().filter(|w| w[j][1] > 0.0).map(|w| (w[j][0] / w[j][1]).sqrt()).collect();
                each.sort_by(f64::total_cmp);
                each.get(each.len() / 2).copied().unwrap_or(0.0)
            })
            .collect();
        let rmse_short = (0..n).map(|j| total(&short, j)).collect();
        (Figures { median, rmse_short, pooled: pooled(&rmse, ranges), rmse }, windows)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::{Noise, followed};
    use crate::GapError;

    /// What share of accelerations is followed with in the end, where so large ones are lost for good below `lost`, and off by `off` of it from
    /// there on.
    fn share(lost: f64, off: impl Fn(f64) -> f64) -> Result<f64, GapError> {
        let noise = Noise {
            position: vec![1e-3],
            share: vec![0.01],
            quiet: vec![0.1],
            effort: vec![0.0],
            mobility: vec![1.0],
            reading: vec![0.0],
            drives: vec![],
        };
        followed(noise, |noise| match noise.share[0] {
            share if share < lost => Err(GapError::data("arm", "the forces of the step are no number")),
            share => Ok((share, off(share))),
        })
    }

    /// An arm's data at much noise had no answer at all: the soft gains that these ask for lost it, with an error.
    #[test]
    fn what_soft_gains_lose_for_good_is_followed_harder() {
        assert_eq!(share(0.03, |_| 1.0).unwrap(), 0.04);
        assert_eq!(share(0.0, |_| 1.0).unwrap(), 0.01, "no harder than need be");
        assert_eq!(share(0.03, |share| 50.0 + share).unwrap(), 0.04, "nor where that is no nearer");
        assert!(share(1e6, |_| 1.0).is_err());
    }
}
