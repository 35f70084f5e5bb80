//! Numbers fitted by what a model is for: positions predicted over windows.
//!
//! Where a model is right, a filter's errors over one sample say the most of its numbers. Where something is missing that has no name, what
//! is best over one sample is not best over a second, by far: the filter is put back on the data before errors grow. So a model that is far off
//! over windows gets its numbers from these (an output error method, Ljung 1999, chapter 7, with starts that the data give),
//!
//! ```text
//! minimise  o sum_w (ln s + ln(1 + r_w^2 / s^2))  +  1/2 sum_p ((x_p - m_p) / d_p)^2
//! ```
//!
//! with `r_w` the RMS error of a window. While it is minimised `s` is that of all but the worst; where it is compared with another model's,
//! each has the `s` that is likeliest. Errors of a window hang together, so that it counts as one observation, and half of it is in its neighbour,
//! `o = 1/2`. The loss is Cauchy's: a window that diverges says that numbers are off, and not by how much. Steps are Gauss and Newton's with the
//! weights `2 o / (s^2 + r_w^2)`, damped; windows begin as the model sees the data, and anew when its numbers have moved.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use crate::GapError;
use crate::fit::{Fit, bounded_step, room, sandwich};
use crate::gaps::{Measure, Started};
use crate::hypothesis::Hypothesis;
use crate::search::{Search, entries};
use crate::valley::Followed;
use crate::weigh::CONVINCING;

/// Share of a window that is not in the one before.
const OWN: f64 = 0.5;
/// How often windows are begun anew, most steps from the same beginnings, and the fall of the cost that ends them.
const TURNS: usize = 3;
const ROUNDS: usize = 8;
const ENOUGH: f64 = 0.1;
/// How often a step is damped.
const TRIES: usize = 5;
/// Spreads of windows in shares of a joint's range, and how often the interval between them is halved.
const SPREADS: [f64; 2] = [1e-9, 10.0];
const HALVINGS: usize = 40;
/// Share of the windows that are nearer than a typical error.
const USUAL: f64 = 0.9;
/// How many times farther than usual an effect's numbers may be.
const UNUSUAL: f64 = 3.0;
/// Fall of the cost from which on other numbers are worth leaving those that the filter likes best, or a name is worth keeping that rows have
/// convinced of: a short recording has few windows.
const WORTH: f64 = 2.0;
/// How many times larger than before the gap may be, where most windows are nearer.
const AS_WELL: f64 = 1.05;
/// How many times farther half of the windows may be for those that are farthest: a few that diverge whatever the numbers, as beside an unstable
/// rest, are no reason to give up numbers by which most are predicted.
const GIVEN_UP: f64 = 2.0;
const HALF: f64 = 0.5;

impl Search<'_> {
    /// A fit whose names are settled, with numbers that predict windows best; none where those that it has do as well.
    pub fn over_windows(&self, fit: &Fit, measure: &Measure<'_>) -> Result<Option<Followed>, GapError> {
        let before = measure.by_window(&fit.hypothesis)?;
        let spread = spread(&before);
        let Arrived { hypothesis, rms } = arrived(freed(&fit.hypothesis), measure, spread, TURNS)?;
        let squares = |rms: &[f64]| rms.iter().map(|r| r * r).sum::<f64>();
        let total = |rms: &[f64], x: &[f64]| cost(rms, spread) + hypothesis.prior(x);
        let fall = total(&before, &fit.hypothesis.x) - total(&rms, &hypothesis.x);
        let given_up = usual(&rms, HALF) > GIVEN_UP * usual(&before, HALF);
        if fall < WORTH || squares(&rms) > AS_WELL * AS_WELL * squares(&before) || given_up {
            return Ok(None);
        }
        let started = measure.started(&hypothesis)?;
        let normal = Normal::new(&hypothesis, &started.errors(&hypothesis, &hypothesis.x)?, &columns(&started, &hypothesis)?, spread);
        let fit = Fit {
            jacobian: fit.jacobian.clone(),
            ..Fit::start(&self.problem, Hypothesis { x: hypothesis.x.clone(), ..fit.hypothesis.clone() })?
        };
        Ok(Some(Followed { fit: self.judge(fit), variances: normal.variances(&hypothesis) }))
    }
}

impl Measure<'_> {
    /// In the median window, of a hypothesis where it stands.
    pub fn in_usual_window(&self, hypothesis: &Hypothesis) -> Result<f64, GapError> {
        Ok(usual(&self.by_window(hypothesis)?, HALF))
    }

    /// By how much one model predicts windows better than another, each name being asked for its share, if both are fitted to that.
    pub fn lead(&self, of: &Hypothesis, before: &Hypothesis) -> Result<f64, GapError> {
        let worth = |hypothesis: &Hypothesis| {
            let arrived = arrived(freed(hypothesis), self, spread(&self.by_window(hypothesis)?), TURNS)?;
            Ok::<f64, GapError>(-arrived.least_cost() - CONVINCING * entries(hypothesis).len() as f64)
        };
        Ok(worth(of)? - worth(before)?)
    }

    /// Those of several effects without which windows are predicted as well, if the others are fitted to that, by their places among the
    /// hypothesis' entries.
    pub fn needless(&self, hypothesis: &Hypothesis) -> Result<Vec<usize>, GapError> {
        let all = entries(hypothesis);
        if all.len() < 2 {
            return Ok(Vec::new());
        }
        let spread = spread(&self.by_window(hypothesis)?);
        let with = arrived(freed(hypothesis), self, spread, TURNS)?;
        let is_needless = |entry: usize| {
            // It begins where the others stand with it, so once is enough. Without what a model cannot be simulated is needed.
            let without = arrived(with.hypothesis.without(entry), self, spread, 1);
            without.is_ok_and(|without| without.least_cost() - with.least_cost() < WORTH)
        };
        Ok((0..all.len()).filter(|i| is_needless(all[*i])).collect())
    }
}

/// Where a fit over windows has come to.
struct Arrived {
    hypothesis: Hypothesis,
    /// RMS of each window, in shares of the joints' ranges.
    rms: Vec<f64>,
}

impl Arrived {
    /// By which it is compared with other models.
    fn least_cost(&self) -> f64 {
        least_cost(&self.rms) + self.hypothesis.prior(&self.hypothesis.x)
    }
}

/// The same with effects that may be larger than is usual: that has had its say over names.
fn freed(hypothesis: &Hypothesis) -> Hypothesis {
    let mut freed = hypothesis.clone();
    freed.fitted.iter_mut().filter(|f| f.knob.entry().is_some()).for_each(|f| f.prior[1] *= UNUSUAL);
    freed
}

/// Minimises the cost from where a hypothesis stands.
fn arrived(mut hypothesis: Hypothesis, measure: &Measure<'_>, spread: f64, turns: usize) -> Result<Arrived, GapError> {
    for _ in 0..turns {
        let started = measure.started(&hypothesis)?;
        let mut now = started.errors(&hypothesis, &hypothesis.x)?;
        let (mut damping, mut gained) = (1e-3, 0.0);
        for _ in 0..ROUNDS {
            let normal = Normal::new(&hypothesis, &now, &columns(&started, &hypothesis)?, spread);
            let here = cost(&rms(&now), spread) + hypothesis.prior(&hypothesis.x);
            let mut fall = 0.0;
            for _ in 0..TRIES {
                let step = bounded_step(&normal.matrix, &normal.right, damping, &room(&hypothesis.fitted, &hypothesis.x));
                let x: Vec<f64> = hypothesis.x.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
                // Numbers that cannot be simulated are too far.
                let tried = started.errors(&hypothesis, &x).ok();
                let there = tried.as_ref().map_or(f64::INFINITY, |e| cost(&rms(e), spread) + hypothesis.prior(&x));
                if let Some(tried) = tried.filter(|_| there < here) {
                    (hypothesis.x, now, fall) = (x, tried, here - there);
                    damping = (damping * 0.1).max(1e-9);
                    break;
                }
                damping = (damping * 10.0).max(1e-3);
            }
            gained += fall;
            if fall < ENOUGH {
                break;
            }
        }
        if gained < ENOUGH {
            break;
        }
    }
    let rms = measure.by_window(&hypothesis)?;
    Ok(Arrived { hypothesis, rms })
}

fn rms(windows: &[DVector<f64>]) -> Vec<f64> {
    windows.iter().map(|w| w.norm()).collect()
}

/// The cost of windows, without the prior.
fn cost(rms: &[f64], spread: f64) -> f64 {
    OWN * rms.iter().map(|r| spread.ln() + (r / spread).powi(2).ln_1p()).sum::<f64>()
}

/// The same where the spread is likeliest: there `sum_w 2 r_w^2 / (s^2 + r_w^2)` is the number of windows.
fn least_cost(rms: &[f64]) -> f64 {
    let pull = |s: f64| rms.iter().map(|r| 2.0 * r * r / (s * s + r * r)).sum::<f64>() - rms.len() as f64;
    let [mut low, mut high] = SPREADS;
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if pull(middle) > 0.0 { low = middle } else { high = middle }
    }
    cost(rms, low)
}

/// That of all but the worst windows: a fit that minded only the nearest would leave those that are far where they are.
fn spread(rms: &[f64]) -> f64 {
    usual(rms, USUAL)
}

/// As far as a share of the windows are at the most.
fn usual(rms: &[f64], share: f64) -> f64 {
    let mut sorted = rms.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get((share * sorted.len() as f64) as usize).copied().unwrap_or(1.0).max(SPREADS[0])
}

/// Normal equations at some numbers.
struct Normal {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    /// What each window adds to the right-hand side.
    slopes: Vec<DVector<f64>>,
}

impl Normal {
    /// From errors of windows, and their derivatives by each number.
    fn new(hypothesis: &Hypothesis, windows: &[DVector<f64>], columns: &[Vec<DVector<f64>>], spread: f64) -> Self {
        let p = columns.len();
        let (mut matrix, mut right) = (DMatrix::zeros(p, p), DVector::zeros(p));
        let mut slopes = Vec::new();
        for (w, errors) in windows.iter().enumerate() {
            let weight = 2.0 * OWN / (spread * spread + errors.norm_squared());
            let slope = DVector::from_fn(p, |a, _| -weight * columns[a][w].dot(errors));
            matrix += DMatrix::from_fn(p, p, |a, b| weight * columns[a][w].dot(&columns[b][w]));
            right += &slope;
            slopes.push(slope);
        }
        for (a, (fitted, x)) in hypothesis.fitted.iter().zip(&hypothesis.x).enumerate() {
            let [mean, deviation] = fitted.prior;
            matrix[(a, a)] += 1.0 / (deviation * deviation);
            right[a] -= (x - mean) / (deviation * deviation);
        }
        Self { matrix, right, slopes }
    }

    /// Variances, larger where windows pull apart. None where the data do not fix the numbers.
    fn variances(&self, hypothesis: &Hypothesis) -> Option<Vec<f64>> {
        let inverse = Cholesky::new(self.matrix.clone())?.inverse();
        // Neighbours share half of themselves: they pull together.
        let slopes: Vec<DVector<f64>> = self.slopes.iter().map(|g| g / OWN.sqrt()).collect();
        Some(sandwich(&inverse, &slopes, &hypothesis.fitted))
    }
}

/// Derivatives of all windows by each number, by differences to both sides.
fn columns(started: &Started<'_>, hypothesis: &Hypothesis) -> Result<Vec<Vec<DVector<f64>>>, GapError> {
    let column = |p: usize| {
        let [low, high] = hypothesis.fitted[p].sides(hypothesis.x[p]);
        let at = |x: f64| {
            let mut moved = hypothesis.x.clone();
            moved[p] = x;
            started.rough_errors(hypothesis, &moved)
        };
        Ok(at(low)?.iter().zip(&at(high)?).map(|(l, h)| (h - l) / (high - low)).collect())
    };
    (0..hypothesis.x.len()).into_par_iter().map(column).collect()
}
