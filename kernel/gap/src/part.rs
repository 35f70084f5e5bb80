//! A part of the data, by which a search begins: starts are compared and first steps taken over stretches of it. What is named is fitted and
//! judged over all of it.

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
/// Length of a stretch, s: much longer than the filter remembers.
const STRETCH: f64 = 1.0;

/// Of how many stretches one holds enough errors, where there are so many in all.
fn every(errors: usize, enough: usize) -> usize {
    (errors as f64 / enough as f64).round() as usize
}

/// Stretches that tell enough of the noise; none where that takes all of the data.
pub(crate) fn stretches(trajectories: &[Trajectory]) -> Option<Vec<Trajectory>> {
    let every = every(trajectories.iter().map(|t| t.position.len()).sum(), ENOUGH_FOR_NOISE);
    (every > 1).then(|| trajectories.iter().map(|t| t.thinned(STRETCH, every).0).collect())
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
        for trajectory in self.problem.trajectories {
            let n = trajectory.joints;
            let (thinned, rows) = trajectory.thinned(STRETCH, every);
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
    /// A fit of all data as it is seen by a search over this part.
    pub fn of(&self, light: &Search<'_>, fit: &Fit) -> Result<Fit, GapError> {
        let pick =
            |column: &DVector<f64>| DVector::from_iterator(self.entries.len(), self.entries.iter().map(|i| i.map_or(0.0, |i| column[i])));
        let jacobian = fit.jacobian.iter().map(pick).collect();
        Ok(Fit { jacobian, ..Fit::start(&light.problem, fit.hypothesis.clone())? })
    }
}
