//! A part of the data, by which a search begins: starts are compared and first steps taken over stretches of it. What is named is fitted and
//! judged over all of it.

use std::collections::BTreeSet;

use nalgebra::DVector;

use crate::GapError;
use crate::fit::{Fit, Problem};
use crate::memory::Memory;
use crate::search::Search;
use crate::trajectory::Trajectory;

/// Errors that tell well enough where to begin, on a robot's arm and on few joints, and those that tell how large noises are, to a factor of
/// two.
const ENOUGH: usize = 10_000;
const ENOUGH_OF_FEW: usize = 4_500;
const ENOUGH_FOR_NOISE: usize = 2_500;
/// Scale of the errors from which on no fewer of them are looked at.
const LARGE: f64 = 2.0;
/// By whose multiples stretches are chosen.
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;
/// Length of a stretch, s: much longer than the filter remembers.
const STRETCH: f64 = 1.0;
/// Share of the way that a joint goes in such a part of the data on the mean, that this part shows at least.
const SEEN_MOVING: f64 = 0.5;

/// Of how many stretches one holds enough errors, where there are so many in all.
fn every(errors: usize, enough: usize) -> usize {
    (errors as f64 / enough as f64).round() as usize
}

/// Stretches that tell enough of the noise; none where that takes all of the data.
pub(crate) fn stretches(trajectories: &[Trajectory]) -> Option<Vec<Trajectory>> {
    let every = every(trajectories.iter().map(|t| t.position.len()).sum(), ENOUGH_FOR_NOISE);
    (every > 1).then(|| trajectories.iter().map(|t| thinned(t, STRETCH, |stretch| comes_up(stretch, every)).0).collect())
}

/// Is a stretch one of so many? They follow one another like multiples of the golden ratio (Weyl 1916), so that no motion with a period shows
/// them one side alone.
pub(crate) fn comes_up(stretch: usize, every: usize) -> bool {
    (stretch as f64 * GOLDEN_RATIO).fract() * (every as f64) < 1.0
}

/// Some stretches of so many seconds of a trajectory, and the rows of which they are made.
pub(crate) fn thinned(trajectory: &Trajectory, seconds: f64, is_kept: impl Fn(usize) -> bool) -> (Trajectory, Vec<usize>) {
    let stretches = trajectory.stretches(seconds);
    let rows: Vec<usize> = (0..trajectory.rows()).filter(|k| is_kept(stretches[*k])).collect();
    (trajectory.of_rows(&rows), rows)
}

/// One of so many stretches of each trajectory, and more where these show a joint move much less than their share: what moves seldom is seen
/// when it does.
fn chosen(trajectories: &[Trajectory], every: usize) -> Vec<BTreeSet<usize>> {
    let of_each = |t: &Trajectory| (0..count(t)).filter(|s| comes_up(*s, every)).collect();
    let mut kept: Vec<BTreeSet<usize>> = trajectories.iter().map(of_each).collect();
    let all: usize = trajectories.iter().map(count).sum();
    let share = kept.iter().map(BTreeSet::len).sum::<usize>() as f64 / all.max(1) as f64;
    for joint in 0..trajectories.first().map_or(0, |t| t.joints) {
        let mut ways = ways(trajectories, joint);
        let asked = SEEN_MOVING * share * ways.iter().map(|w| w.0).sum::<f64>();
        ways.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut seen: f64 = ways.iter().filter(|(_, of, stretch)| kept[*of].contains(stretch)).map(|w| w.0).sum();
        for (way, of, stretch) in ways {
            if seen >= asked {
                break;
            }
            if kept[of].insert(stretch) {
                seen += way;
            }
        }
    }
    kept
}

fn count(trajectory: &Trajectory) -> usize {
    trajectory.stretches(STRETCH).last().map_or(0, |last| last + 1)
}

/// How far a joint goes in each stretch, rad or m, of which trajectory, and which stretch of that it is.
fn ways(trajectories: &[Trajectory], joint: usize) -> Vec<(f64, usize, usize)> {
    let mut ways = Vec::new();
    for (of, trajectory) in trajectories.iter().enumerate() {
        let mut extent = vec![[f64::MAX, f64::MIN]; count(trajectory)];
        for (stretch, q) in trajectory.stretches(STRETCH).into_iter().zip(trajectory.positions(joint)).filter(|(_, q)| q.is_finite()) {
            let [low, high] = extent[stretch];
            extent[stretch] = [low.min(q), high.max(q)];
        }
        ways.extend(extent.iter().enumerate().map(|(stretch, [low, high])| ((high - low).max(0.0), of, stretch)));
    }
    ways
}

/// Stretches of all trajectories, and which entries of the whole errors they are, `None` where one is not counted.
pub(crate) struct Part {
    pub trajectories: Vec<Trajectory>,
    entries: Vec<Option<usize>>,
}

impl Search<'_> {
    /// The part by which a search begins; none where all of the data are no more than that. Errors that are large beside noise tell as much
    /// in fewer rows: `scale` is theirs, in their deviations.
    pub fn part(&self, scale: f64) -> Option<Part> {
        let enough = if self.many_joints() { (ENOUGH as f64 / scale.clamp(1.0, LARGE)) as usize } else { ENOUGH_OF_FEW };
        let every = every(self.problem.measured(), enough);
        if every < 2 {
            return None;
        }
        let mut part = Part { trajectories: Vec::new(), entries: Vec::new() };
        let (mut before, mut efforts) = (0, Vec::new());
        let behind = self.problem.entries();
        for (trajectory, kept) in self.problem.trajectories.iter().zip(chosen(self.problem.trajectories, every)) {
            let n = trajectory.joints;
            let (thinned, rows) = thinned(trajectory, STRETCH, |stretch| kept.contains(&stretch));
            let entries = rows.iter().flat_map(|k| (k * n..(k + 1) * n).map(|i| before + i));
            efforts.extend(entries.clone().zip(&thinned.effort).map(|(i, u)| u.is_finite().then_some(behind + i)));
            part.entries.extend(entries.zip(&thinned.counted).map(|(i, counted)| counted.then_some(i)));
            part.trajectories.push(thinned);
            before += trajectory.rows() * n;
        }
        if self.problem.disturbance.reads_efforts() {
            part.entries.extend(efforts);
        }
        Some(part)
    }

    /// Share of the measured data of another search that this one is over: so much of the evidence there is to be expected.
    pub fn share_of(&self, whole: &Search<'_>) -> f64 {
        self.problem.measured() as f64 / whole.problem.measured() as f64
    }

    /// Evidence that a fit over such a share of the data promises to gain over all of them: what it says grows with the data, what its numbers
    /// cost does not.
    pub fn promised(&self, base: &Fit, fit: &Fit, share: f64, scale: f64) -> f64 {
        let gain = self.evidence(fit, scale) - self.evidence(base, scale);
        let said = 0.5 * (base.judged - fit.judged) / (scale * scale);
        said / share - (said - gain)
    }

    /// The same search over other data of the same model.
    pub fn over<'b>(&self, trajectories: &'b [Trajectory]) -> Search<'b> {
        let Self { problem, names, joints, inertias, seen, still, of_data, mobility, .. } = self;
        let problem = Problem {
            trajectories,
            disturbance: problem.disturbance.clone(),
            middle: problem.middle.clone(),
            period: problem.period,
            most: problem.most.clone(),
            limits: problem.limits.clone(),
            step: problem.step,
            rough: problem.rough,
            smooth: problem.smooth,
            defect: None,
            mobility: problem.mobility.clone(),
        };
        Search {
            problem,
            names: names.clone(),
            joints: joints.clone(),
            inertias: inertias.clone(),
            seen: seen.clone(),
            still: still.clone(),
            of_data: of_data.clone(),
            mobility: mobility.clone(),
            memory: Memory::default(),
        }
    }
}

impl Part {
    /// Of entries of all data those of this part.
    pub fn pick(&self, all: &DVector<f64>) -> DVector<f64> {
        DVector::from_iterator(self.entries.len(), self.entries.iter().map(|i| i.map_or(0.0, |i| all[i])))
    }

    /// A fit of all data as it is seen by a search over this part.
    pub fn of(&self, light: &Search<'_>, fit: &Fit) -> Result<Fit, GapError> {
        let jacobian = fit.jacobian.iter().map(|column| self.pick(column)).collect();
        Ok(Fit { jacobian, ..Fit::start(&light.problem, fit.hypothesis.clone())? })
    }
}

#[cfg(test)]
mod tests {
    use super::chosen;
    use crate::trajectory::{Drive, Trajectory};

    /// A wrist that friction holds turned twice in forty seconds, and a late command of its drive was looked for where it stood.
    #[test]
    fn a_joint_that_moves_seldom_is_seen_when_it_does() {
        let rests = |from: usize, to: usize| {
            let mut trajectory = Trajectory::steady(2000, 0.01, &[0.0, 0.0], vec![Drive::Given; 2]);
            for k in 0..2000 {
                trajectory.position[2 * k] = (0.05 * k as f64).sin();
                trajectory.position[2 * k + 1] = if (from..to).contains(&k) { 0.4 } else { 0.0 };
            }
            trajectory
        };
        let usual: usize = chosen(&[rests(0, 0), rests(0, 0)], 4).iter().map(|kept| kept.len()).sum();
        for from in (100..1900).step_by(100) {
            let kept = chosen(&[rests(from + 30, from + 60), rests(0, 0)], 4);
            assert!(kept[0].contains(&(from / 100)), "{kept:?} for {from}");
            assert!(kept[0].len() + kept[1].len() <= usual + 1, "{kept:?} are too many");
        }
    }
}
