//! The figures of the gap, for the model as given, refitted and with its effects, beside what noise alone makes of them.

use nalgebra::DVector;
use rayon::prelude::*;
use sagci_dynamics::residual::Residual;
use sagci_model::{JointKind, ObjectModel};

use crate::GapError;
use crate::find::Options;
use crate::fit::{Fit, are_short};
use crate::hypothesis::Hypothesis;
use crate::memory::Memory;
use crate::noise;
use crate::observer::Noise;
use crate::plant::Plant;
use crate::report::{Gap, Gaps, JointGap};
use crate::search::{FLOOR, STEP, Search};
use crate::stops::Stops;
use crate::trajectory::Trajectory;
use crate::windows::{Figures, Smoothed, Window};

/// Longest step of the last fits and of predictions, s.
pub(crate) const FINE: f64 = 1.25e-3;

/// How many times its noise floor a gap may be before something is missing for certain.
const FAR: f64 = 3.0;

/// What the figures of each joint are divided by: its range between limits, or that of the data where it has none.
fn ranges(search: &Search<'_>, model: &ObjectModel, train: &[Trajectory], unseen: &[Trajectory]) -> Vec<f64> {
    (0..search.names.len())
        .map(|j| {
            let limits = &model.joints[search.joints[j]].limits;
            let [low, high] = Trajectory::range(train.iter().chain(unseen), j);
            if limits.range().is_finite() { limits.range() } else { (high - low).max(1e-6) }
        })
        .collect()
}

/// The pooled gap of any model, by the procedure of the report's own figures: on held-out data where there are some.
pub(crate) struct Measure<'a> {
    data: &'a [Trajectory],
    noise: Noise,
    ranges: Vec<f64>,
    window: f64,
    limits: &'a [Stops],
    /// What is known already, where the data are those of a search.
    memory: Memory,
}

impl<'a> Measure<'a> {
    pub fn new(search: &'a Search<'_>, model: &ObjectModel, train: &'a [Trajectory], unseen: &'a [Trajectory], window: f64) -> Self {
        let data = if unseen.is_empty() { train } else { unseen };
        let noise = noise::of_motion(data, search.names.len(), FLOOR);
        let of_search = std::ptr::eq(data, search.problem.trajectories);
        let memory = if of_search { search.memory.clone() } else { Memory::default() };
        Self { data, noise, ranges: ranges(search, model, train, unseen), window, limits: &search.problem.limits, memory }
    }

    /// A hypothesis where it stands as a plant in longer steps, by which the data are followed, and in shorter ones, which predicts.
    fn plants(&self, hypothesis: &Hypothesis, residual: Option<&Residual>) -> Result<[Plant; 2], GapError> {
        let made = |step: f64| hypothesis.plant(&hypothesis.x, self.limits, step)?.with_residual(residual);
        Ok([made(STEP)?, made(FINE)?])
    }

    /// Starts of windows as a plant sees the data.
    fn smoothed(&self, [rough, fine]: &[Plant; 2], data: &[Trajectory]) -> Result<Smoothed, GapError> {
        Smoothed::roughly(rough, fine, data, &self.noise)
    }

    /// Is a hypothesis much farther off than noise makes one that is right? A hypothesis that cannot be simulated is.
    pub fn is_far(&self, hypothesis: &Hypothesis, seed: u64) -> bool {
        let floor = || {
            let plants = self.plants(hypothesis, None)?;
            let smoothed = self.smoothed(&plants, self.data)?;
            let invented = invented([&plants[0], &plants[1]], &smoothed, (self.data, &self.noise), (self.window, &self.ranges), seed);
            Ok::<f64, GapError>(self.smoothed(&plants, &invented)?.pooled(&plants[1], &invented, self.window, &self.ranges))
        };
        // No floor is lower than the noise of positions.
        let shares = self.noise.position.iter().zip(&self.ranges).map(|(noise, range)| (noise / range).powi(2));
        let lowest = (shares.sum::<f64>() / self.ranges.len() as f64).sqrt();
        let found = || {
            let gap = self.pooled(hypothesis, None)?;
            Ok::<bool, GapError>(gap > FAR * lowest && gap > FAR * floor()?)
        };
        found().unwrap_or(true)
    }

    /// In each window, of a hypothesis where it stands.
    pub fn by_window(&self, hypothesis: &Hypothesis) -> Result<Vec<f64>, GapError> {
        let plants = self.plants(hypothesis, None)?;
        Ok(self.smoothed(&plants, self.data)?.by_window(&plants[1], self.data, self.window, &self.ranges))
    }

    /// Starts of windows as a hypothesis sees the data, for others to go on from.
    pub fn started(&self, hypothesis: &Hypothesis) -> Result<Started<'_>, GapError> {
        Ok(Started { measure: self, smoothed: self.smoothed(&self.plants(hypothesis, None)?, self.data)? })
    }

    /// Of a hypothesis where it stands, with a learned force besides.
    pub fn pooled(&self, hypothesis: &Hypothesis, residual: Option<&Residual>) -> Result<f64, GapError> {
        let predict = || {
            let plants = self.plants(hypothesis, residual)?;
            Ok(self.smoothed(&plants, self.data)?.pooled(&plants[1], self.data, self.window, &self.ranges))
        };
        if residual.is_some() { predict() } else { self.memory.or_else(hypothesis, self.window, predict) }
    }
}

/// Windows that begin as one model sees the data.
pub(crate) struct Started<'a> {
    measure: &'a Measure<'a>,
    smoothed: Smoothed,
}

impl Started<'_> {
    /// Errors of each window with a hypothesis at `x`, in shares of the joints' ranges: see [`Smoothed::errors`].
    pub fn errors(&self, hypothesis: &Hypothesis, x: &[f64]) -> Result<Vec<DVector<f64>>, GapError> {
        Ok(self.errors_of(&hypothesis.plant(x, self.measure.limits, STEP)?))
    }

    /// The same to be compared with one another: in steps to first order where rows are short, since what these leave over cancels.
    pub fn rough_errors(&self, hypothesis: &Hypothesis, x: &[f64]) -> Result<Vec<DVector<f64>>, GapError> {
        let mut plant = hypothesis.plant(x, self.measure.limits, STEP)?;
        plant.rough = self.measure.data.first().is_some_and(|t| are_short(t.period()));
        Ok(self.errors_of(&plant))
    }

    fn errors_of(&self, plant: &Plant) -> Vec<DVector<f64>> {
        let Measure { data, ranges, window, .. } = self.measure;
        self.smoothed.errors(plant, data, *window, ranges)
    }
}

impl Gap {
    /// Is it much larger than noise makes it?
    pub(crate) fn is_far(&self) -> bool {
        self.after > FAR * self.noise_floor
    }

    /// Is most of a joint's windows that far off?
    pub(crate) fn is_mostly_far(&self) -> bool {
        self.per_joint.values().any(|j| j.median[2] > FAR * j.median[3])
    }

    /// What is left of it, as a share, once the known numbers are refitted: of all windows or of the usual one, whichever is less. A window
    /// that begins beside an unstable rest ends anywhere, and a few of them are all that a mean over windows shows.
    pub(crate) fn left(&self) -> f64 {
        let usual = |k: usize| self.per_joint.values().map(|j| (j.median[k] / j.range).powi(2)).sum::<f64>().sqrt();
        (self.after / self.refitted).min(usual(2) / usual(1))
    }
}

/// Data that a plant makes itself along others, with the noise of these: the plant is given in longer and in shorter steps.
fn invented(
    [follower, plant]: [&Plant; 2],
    smoothed: &Smoothed,
    (data, noise): (&[Trajectory], &Noise),
    windows: (f64, &[f64]),
    seed: u64,
) -> Vec<Trajectory> {
    let efforts: Vec<f64> = (0..windows.1.len()).map(|j| noise::of_efforts(data, j)).collect();
    smoothed.invent(plant, data, (&noise.likely_at_most(follower, data), &efforts), windows, seed)
}

#[allow(clippy::too_many_arguments)]
pub(crate) fn gaps(
    search: &Search<'_>,
    model: &ObjectModel,
    given: &Fit,
    refitted: &Fit,
    current: &Fit,
    train: &[Trajectory],
    unseen: &[Trajectory],
    options: &Options<'_>,
) -> Result<(Gaps, Vec<Vec<Window>>), GapError> {
    let n = search.names.len();
    let ranges = ranges(search, model, train, unseen);
    let untouched = Hypothesis { x: Vec::new(), fitted: Vec::new(), known: 0, ..given.hypothesis.clone() };
    let limits = &search.problem.limits;
    let made = |step: f64| -> Result<[Plant; 3], GapError> {
        Ok([
            untouched.plant(&[], limits, step)?,
            refitted.hypothesis.plant(&refitted.hypothesis.x, limits, step)?,
            current.hypothesis.plant(&current.hypothesis.x, limits, step)?,
        ])
    };
    let plants = made(FINE)?;
    // Following the data takes no finer steps than the search did.
    let followers = made(STEP)?;
    let on = |data: &[Trajectory]| -> Result<(Gap, Vec<Vec<Window>>), GapError> {
        // By the data alone, so that anyone who has them finds the same figures.
        let noise = noise::of_motion(data, n, FLOOR);
        let found = |data: &[Trajectory]| Smoothed::roughly(&followers[2], &plants[2], data, &noise);
        // Where nothing was named the found model is the refitted one.
        let different = if current.hypothesis.x == refitted.hypothesis.x { 2 } else { 3 };
        let mut both: Vec<(Figures, Vec<Window>)> = plants[..different]
            .par_iter()
            .zip(&followers)
            .map(|(plant, follower)| {
                // A model that gets lost along the data starts its windows where the found one does.
                let smoothed = Smoothed::new(follower, data, &noise).or_else(|_| found(data))?;
                Ok(smoothed.figures(plant, data, options.window, &ranges))
            })
            .collect::<Result<_, GapError>>()?;
        both.extend_from_within(different - 1..2);
        let (figures, predicted): (Vec<Figures>, Vec<_>) = both.into_iter().unzip();
        let invented = invented([&followers[2], &plants[2]], &found(data)?, (data, &noise), (options.window, &ranges), options.seed);
        let (floor, _) = found(&invented)?.figures(&plants[2], &invented, options.window, &ranges);
        let per_joint = (0..n)
            .map(|j| {
                let pick = |f: fn(&Figures) -> &Vec<f64>| [f(&figures[0])[j], f(&figures[1])[j], f(&figures[2])[j], f(&floor)[j]];
                let rmse = pick(|f| &f.rmse);
                let sliding = model.joints[search.joints[j]].kind == JointKind::Prismatic;
                let gap = JointGap {
                    before: rmse[0],
                    refitted: rmse[1],
                    after: rmse[2],
                    noise_floor: rmse[3],
                    median: pick(|f| &f.median),
                    short: pick(|f| &f.rmse_short),
                    range: ranges[j],
                    unit: if sliding { "m" } else { "rad" }.into(),
                };
                (search.names[j].clone(), gap)
            })
            .collect();
        let [before, refitted, after] = [0, 1, 2].map(|i| figures[i].pooled);
        Ok((Gap { before, refitted, after, noise_floor: floor.pooled, per_joint }, predicted))
    };
    let (train, mut predicted) = on(train)?;
    let mut gaps = Gaps { train, held_out: None };
    if !unseen.is_empty() {
        let held_out;
        (held_out, predicted) = on(unseen)?;
        gaps.held_out = Some(held_out);
    }
    Ok((gaps, predicted))
}
