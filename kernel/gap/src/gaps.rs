//! The figures of the gap, for the model as given, refitted and with its effects, beside what noise alone makes of them.

use nalgebra::DVector;
use rayon::prelude::*;
use sagci_dynamics::residual::Residual;
use sagci_model::{JointKind, ObjectModel};

use crate::GapError;
use crate::fit::{Fit, are_short, told};
use crate::hypothesis::Hypothesis;
use crate::invent::Inventor;
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

/// A plant in longer steps, by which data are followed that have a noise, and in shorter ones, which predicts.
pub(crate) fn follower_and_plant(
    made: impl Fn(f64) -> Result<Plant, GapError>,
    data: &[Trajectory],
    noise: &Noise,
) -> Result<[Plant; 2], GapError> {
    let mut follower = made(STEP)?;
    follower.told = told(&noise.position, data.first().map_or(f64::INFINITY, Trajectory::period));
    Ok([follower, made(FINE)?])
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

    /// A hypothesis where it stands, as it follows the data and as it predicts.
    fn plants(&self, hypothesis: &Hypothesis, residual: Option<&Residual>) -> Result<[Plant; 2], GapError> {
        follower_and_plant(|step| hypothesis.plant(&hypothesis.x, self.limits, step)?.with_residual(residual), self.data, &self.noise)
    }

    /// Starts of windows as plants see data. Following these takes no finer steps than the search did, unless it gets lost with them.
    fn smoothed(&self, [follower, plant]: &[Plant; 2], data: &[Trajectory]) -> Result<Smoothed, GapError> {
        Smoothed::new(follower, data, &self.noise).or_else(|_| Smoothed::new(plant, data, &self.noise))
    }

    /// The same as a hypothesis sees the measure's own, by its plants.
    fn smoothed_by(&self, hypothesis: &Hypothesis, [follower, plant]: &[Plant; 2]) -> Result<Smoothed, GapError> {
        let factors = self.memory.factors(hypothesis, || self.noise.likely_factors(follower, self.data));
        Smoothed::under_factors(follower, self.data, &self.noise, factors).or_else(|_| Smoothed::new(plant, self.data, &self.noise))
    }

    /// Figures of data that a plant makes itself along the measured ones, with the noise of these.
    fn floor(&self, plants: &[Plant; 2], smoothed: &Smoothed, seed: u64) -> Result<Figures, GapError> {
        let Self { data, noise, ranges, window, .. } = self;
        let efforts: Vec<f64> = (0..ranges.len()).map(|j| noise::of_efforts(data, j)).collect();
        let inventor = Inventor { plant: &plants[1], smoothed, noise, efforts: &efforts, window: *window, ranges };
        let invented = inventor.invent(data, seed);
        Ok(self.smoothed(plants, &invented)?.figures(&plants[1], &invented, *window, ranges).0)
    }

    /// What noise makes of the gap of a hypothesis where it stands: its own over data that it makes itself.
    pub fn noise_floor(&self, hypothesis: &Hypothesis, seed: u64) -> Result<f64, GapError> {
        let plants = self.plants(hypothesis, None)?;
        Ok(self.floor(&plants, &self.smoothed_by(hypothesis, &plants)?, seed)?.pooled)
    }

    /// Is a hypothesis much farther off than noise makes one that is right? A hypothesis that cannot be simulated is.
    pub fn is_far(&self, hypothesis: &Hypothesis, seed: u64) -> bool {
        // No floor is lower than the noise of positions.
        let shares = self.noise.position.iter().zip(&self.ranges).map(|(noise, range)| (noise / range).powi(2));
        let lowest = (shares.sum::<f64>() / self.ranges.len() as f64).sqrt();
        let found = || {
            let gap = self.pooled(hypothesis, None)?;
            Ok::<bool, GapError>(gap > FAR * lowest && gap > FAR * self.noise_floor(hypothesis, seed)?)
        };
        found().unwrap_or(true)
    }

    /// In each window, of a hypothesis where it stands.
    pub fn by_window(&self, hypothesis: &Hypothesis) -> Result<Vec<f64>, GapError> {
        let plants = self.plants(hypothesis, None)?;
        Ok(self.smoothed_by(hypothesis, &plants)?.by_window(&plants[1], self.data, self.window, &self.ranges))
    }

    /// Starts of windows as a hypothesis sees the data, for others to go on from.
    pub fn started(&self, hypothesis: &Hypothesis) -> Result<Started<'_>, GapError> {
        Ok(Started { measure: self, smoothed: self.smoothed_by(hypothesis, &self.plants(hypothesis, None)?)? })
    }

    /// Of a hypothesis where it stands, with a learned force besides.
    pub fn pooled(&self, hypothesis: &Hypothesis, residual: Option<&Residual>) -> Result<f64, GapError> {
        let plants = self.plants(hypothesis, residual)?;
        let predict = |smoothed: Smoothed| smoothed.pooled(&plants[1], self.data, self.window, &self.ranges);
        if residual.is_some() {
            return Ok(predict(self.smoothed(&plants, self.data)?));
        }
        self.memory.gap(hypothesis, self.window, || Ok(predict(self.smoothed_by(hypothesis, &plants)?)))
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

/// The figures of a model as given, refitted, and with its effects, by measures of the data that it was fitted to and of others, and the windows
/// predicted over the last of these.
pub(crate) fn gaps(
    search: &Search<'_>,
    model: &ObjectModel,
    [given, refitted, current]: [&Fit; 3],
    measures: (&Measure<'_>, Option<&Measure<'_>>),
    seed: u64,
) -> Result<(Gaps, Vec<Vec<Window>>), GapError> {
    let n = search.names.len();
    let untouched = Hypothesis { x: Vec::new(), fitted: Vec::new(), known: 0, ..given.hypothesis.clone() };
    let hypotheses = [&untouched, &refitted.hypothesis, &current.hypothesis];
    let on = |measure: &Measure<'_>| -> Result<(Gap, Vec<Vec<Window>>), GapError> {
        let Measure { data, ranges, window, .. } = measure;
        let plants = measure.plants(hypotheses[2], None)?;
        let found = measure.smoothed_by(hypotheses[2], &plants)?;
        // Where nothing was named the found model is the refitted one.
        let different = if current.hypothesis.x == refitted.hypothesis.x { 1 } else { 2 };
        let others = hypotheses[..different].par_iter().map(|hypothesis| {
            let plants = measure.plants(hypothesis, None)?;
            // A model that gets lost along the data starts its windows where the found one does.
            let own = measure.smoothed_by(hypothesis, &plants);
            Ok(own.as_ref().unwrap_or(&found).figures(&plants[1], data, *window, ranges))
        });
        let mut both: Vec<(Figures, Vec<Window>)> = others.collect::<Result<_, GapError>>()?;
        both.push(found.figures(&plants[1], data, *window, ranges));
        both.extend_from_within(different..2);
        let (figures, predicted): (Vec<Figures>, Vec<_>) = both.into_iter().unzip();
        let floor = measure.floor(&plants, &found, seed)?;
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
    let (train, mut predicted) = on(measures.0)?;
    let mut gaps = Gaps { train, held_out: None };
    if let Some(unseen) = measures.1 {
        let held_out;
        (held_out, predicted) = on(unseen)?;
        gaps.held_out = Some(held_out);
    }
    Ok((gaps, predicted))
}
