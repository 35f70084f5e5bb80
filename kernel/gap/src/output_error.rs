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
//! each has the `s` that is likeliest. Errors of a window hang together, so that it counts as one
//! observation, and half of it is in its neighbour, `o = 1/2`. The loss is Cauchy's: a window that diverges says that numbers are off, and not
//! by how much. Steps are Gauss and Newton's with the weights `2 o / (s^2 + r_w^2)`, damped.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use crate::GapError;
use crate::fit::{Fit, bounded_step};
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
/// How much farther than a filter's differences those over windows reach: whether a joint sticks a row sooner or later is chance.
const WIDE: f64 = 4.0;
/// How many times farther than usual an effect's numbers may be.
const UNUSUAL: f64 = 3.0;
/// Fall of the cost from which on other numbers are worth leaving those that the filter likes best, or a name is worth keeping that rows have
/// convinced of: a short recording has few windows.
const WORTH: f64 = 2.0;
/// How many times larger than before the gap may be, where most windows are nearer.
const AS_WELL: f64 = 1.05;

/// Errors of all windows of a hypothesis.
struct Errors {
    windows: Vec<DVector<f64>>,
}

impl Errors {
    fn of(started: &Started<'_>, hypothesis: &Hypothesis, x: &[f64]) -> Result<Self, GapError> {
        Ok(Self { windows: started.errors(hypothesis, x)?.into_iter().map(DVector::from_vec).collect() })
    }

    fn rms(&self) -> Vec<f64> {
        self.windows.iter().map(|w| w.norm()).collect()
    }
}

/// The cost of windows, without the prior.
fn cost(rms: &[f64], typical: f64) -> f64 {
    OWN * rms.iter().map(|r| typical.ln() + (r / typical).powi(2).ln_1p()).sum::<f64>()
}

/// The same where the spread is likeliest: at its end half of the windows pull either way, `sum_w 2 r_w^2 / (s^2 + r_w^2) = N`.
fn least_cost(rms: &[f64]) -> f64 {
    let pull = |s: f64| rms.iter().map(|r| 2.0 * r * r / (s * s + r * r)).sum::<f64>() - rms.len() as f64;
    let [mut low, mut high] = SPREADS;
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if pull(middle) > 0.0 { low = middle } else { high = middle }
    }
    cost(rms, low)
}

fn typical(rms: &[f64]) -> f64 {
    let mut sorted = rms.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get((USUAL * sorted.len() as f64) as usize).copied().unwrap_or(1.0).max(1e-12)
}

/// Normal equations at some numbers.
struct Normal {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    /// What each window adds to the right-hand side.
    slopes: Vec<DVector<f64>>,
}

impl Normal {
    fn new(hypothesis: &Hypothesis, now: &Errors, columns: &[Errors], typical: f64) -> Self {
        let x = &hypothesis.x;
        let p = x.len();
        let (mut matrix, mut right) = (DMatrix::zeros(p, p), DVector::zeros(p));
        let mut slopes = Vec::new();
        for (w, errors) in now.windows.iter().enumerate() {
            let weight = 2.0 * OWN / (typical * typical + errors.norm_squared());
            let slope = DVector::from_fn(p, |a, _| -weight * columns[a].windows[w].dot(errors));
            for a in 0..p {
                for b in 0..=a {
                    matrix[(a, b)] += weight * columns[a].windows[w].dot(&columns[b].windows[w]);
                }
            }
            right += &slope;
            slopes.push(slope);
        }
        for a in 0..p {
            for b in 0..a {
                matrix[(b, a)] = matrix[(a, b)];
            }
            let [mean, deviation] = hypothesis.fitted[a].prior;
            matrix[(a, a)] += 1.0 / (deviation * deviation);
            right[a] -= (x[a] - mean) / (deviation * deviation);
        }
        Self { matrix, right, slopes }
    }

    /// Variances, larger where windows pull apart: see [`Fit::variances`].
    fn variances(&self, hypothesis: &Hypothesis) -> Option<Vec<f64>> {
        let p = self.right.len();
        let inverse = Cholesky::new(self.matrix.clone())?.inverse();
        let prior = hypothesis.fitted.iter().map(|f| 1.0 / (f.prior[1] * f.prior[1]));
        let mut slopes = DMatrix::from_diagonal(&DVector::from_iterator(p, prior));
        // Neighbours share half of themselves: they pull together.
        self.slopes.iter().for_each(|g| slopes.ger(1.0 / OWN, g, g, 1.0));
        let together = &inverse * slopes * &inverse;
        Some((0..p).map(|i| inverse[(i, i)].max(together[(i, i)])).collect())
    }
}

/// Where a fit over windows has come to.
struct Arrived {
    hypothesis: Hypothesis,
    variances: Option<Vec<f64>>,
    /// RMS of each window.
    rms: Vec<f64>,
}

impl Arrived {
    /// By which it is compared with other models.
    fn least_cost(&self) -> f64 {
        least_cost(&self.rms) + self.hypothesis.prior(&self.hypothesis.x)
    }
}

impl Search<'_> {
    /// By how much a fit predicts windows better than another, each name being asked for its share, if both are fitted to that.
    pub fn leads_over_windows(&self, fit: &Fit, other: &Fit, measure: &Measure<'_>) -> Result<f64, GapError> {
        let worth = |fit: &Fit| {
            let typical = typical(&measure.by_window(&fit.hypothesis)?);
            let cost = arrived(&fit.hypothesis, measure, typical)?.least_cost();
            Ok::<f64, GapError>(-cost - CONVINCING * entries(&fit.hypothesis).len() as f64)
        };
        Ok(worth(fit)? - worth(other)?)
    }

    /// A fit whose names are settled, with numbers that predict windows best; none where those that it has do as well.
    pub fn over_windows(&self, fit: &Fit, measure: &Measure<'_>) -> Result<Option<Followed>, GapError> {
        let before = measure.by_window(&fit.hypothesis)?;
        let typical = typical(&before);
        let arrived = arrived(&fit.hypothesis, measure, typical)?;
        let squares = |rms: &[f64]| rms.iter().map(|r| r * r).sum::<f64>();
        let total = |rms: &[f64], x: &[f64]| cost(rms, typical) + arrived.hypothesis.prior(x);
        let fall = total(&before, &fit.hypothesis.x) - total(&arrived.rms, &arrived.hypothesis.x);
        if fall < WORTH || squares(&arrived.rms) > AS_WELL * AS_WELL * squares(&before) {
            return Ok(None);
        }
        let hypothesis = Hypothesis { x: arrived.hypothesis.x, ..fit.hypothesis.clone() };
        let fit = Fit { jacobian: fit.jacobian.clone(), ..Fit::start(&self.problem, hypothesis)? };
        Ok(Some(Followed { fit: self.judge(fit), variances: arrived.variances }))
    }

    /// Which of several effects windows are predicted without as well, if the others are fitted to that: the least of them, among the
    /// hypothesis' entries.
    pub fn needless(&self, fit: &Fit, measure: &Measure<'_>) -> Result<Option<usize>, GapError> {
        let all = entries(&fit.hypothesis);
        if all.len() < 2 {
            return Ok(None);
        }
        let typical = typical(&measure.by_window(&fit.hypothesis)?);
        let with = arrived(&fit.hypothesis, measure, typical)?;
        let mut least: Option<(f64, usize)> = None;
        for (i, entry) in all.into_iter().enumerate() {
            // Without what a model cannot be simulated is needed.
            let Ok(without) = arrived(&with.hypothesis.without(entry), measure, typical) else { continue };
            let gain = without.least_cost() - with.least_cost();
            if gain < least.map_or(WORTH, |(gain, _)| gain) {
                least = Some((gain, i));
            }
        }
        Ok(least.map(|(_, i)| i))
    }
}

/// The same with effects that may be larger than is usual: that has had its say over names.
fn freed(hypothesis: &Hypothesis) -> Hypothesis {
    let mut freed = hypothesis.clone();
    freed.fitted.iter_mut().filter(|f| f.knob.entry().is_some()).for_each(|f| f.prior[1] *= UNUSUAL);
    freed
}

/// Minimises the cost from where a hypothesis stands.
fn arrived(from: &Hypothesis, measure: &Measure<'_>, typical: f64) -> Result<Arrived, GapError> {
    let mut hypothesis = freed(from);
    let mut variances = None;
    for _ in 0..TURNS {
        let started = measure.started(&hypothesis)?;
        let mut now = Errors::of(&started, &hypothesis, &hypothesis.x)?;
        let (mut damping, mut gained) = (1e-3, 0.0);
        for _ in 0..ROUNDS {
            let normal = Normal::new(&hypothesis, &now, &columns(&started, &hypothesis)?, typical);
            let here = cost(&now.rms(), typical) + hypothesis.prior(&hypothesis.x);
            let mut fall = 0.0;
            for _ in 0..TRIES {
                let step = bounded_step(&normal.matrix, &normal.right, damping, &hypothesis.fitted, &hypothesis.x);
                let x: Vec<f64> = hypothesis.x.iter().zip(step.iter()).map(|(x, d)| x + d).collect();
                let tried = Errors::of(&started, &hypothesis, &x).ok();
                let there = tried.as_ref().map_or(f64::INFINITY, |e| cost(&e.rms(), typical) + hypothesis.prior(&x));
                if let Some(tried) = tried.filter(|_| there < here) {
                    (hypothesis.x, now, fall) = (x, tried, here - there);
                    damping = (damping * 0.1).max(1e-9);
                    break;
                }
                damping = (damping * 10.0).max(1e-3);
            }
            variances = normal.variances(&hypothesis);
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
    Ok(Arrived { hypothesis, variances, rms })
}

/// Derivatives of all windows by all numbers, by differences to both sides as far as there is room.
fn columns(started: &Started<'_>, hypothesis: &Hypothesis) -> Result<Vec<Errors>, GapError> {
    let column = |p: usize| {
        let (x, fitted) = (hypothesis.x[p], &hypothesis.fitted[p]);
        let reach = WIDE * fitted.difference;
        let sides = [(x - reach).max(fitted.bounds[0]), (x + reach).min(fitted.bounds[1])];
        let at = |value: f64| {
            let mut moved = hypothesis.x.clone();
            moved[p] = value;
            Errors::of(started, hypothesis, &moved)
        };
        let [low, high] = [at(sides[0])?, at(sides[1])?];
        let windows = low.windows.iter().zip(&high.windows).map(|(l, h)| (h - l) / (sides[1] - sides[0])).collect();
        Ok(Errors { windows })
    };
    (0..hypothesis.x.len()).into_par_iter().map(column).collect()
}
