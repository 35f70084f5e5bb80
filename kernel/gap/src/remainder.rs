//! What names leave over, as a small network: a force by position, velocity and input of each joint that lacks one.
//!
//! It is not trained through the simulator. A force acts on the prediction errors `e` through the filter's own linear response `D`
//! (see `response.rs`), so that its weights `w` solve a least-squares problem that needs no run but the one that it is linear about,
//!
//! ```text
//! minimise  1/2 |e - D f(w)|^2 / s^2  +  1/2 |w|^2 / a^2
//! ```
//!
//! by Levenberg and Marquardt's method, the second term being a normal prior on each weight (MacKay 1992). Errors are white under the
//! noises, so no force has to be smoothed before it is fitted.
//!
//! The network has an input for the acceleration, as all residuals have; its weights are zero here. Accelerations along the data are what
//! the filter made of its own corrections: with them a network would learn the filter.

use nalgebra::{Cholesky, DMatrix, DVector};
use sagci_dynamics::residual::{Activation, Network, Normalisation, Residual};
use sagci_model::JointKind;

use crate::GapError;
use crate::fit::Fit;
use crate::flexible::Nameless;
use crate::gaps::Measure;
use crate::observer::Run;
use crate::plant::Plant;
use crate::report::Remainder;
use crate::response::Response;
use crate::search::{STEP, Search};

/// Width of the one inner layer, for each joint.
const HIDDEN: usize = 8;
/// Most joints that a force is learned on: the worst ones.
const MOST: usize = 3;
/// Standard deviation of a weight before anything is measured; steps at a reversal need large ones.
const WEIGHT: f64 = 5.0;
/// Slope of a unit that begins as a sign, over a typical velocity.
const STEEP: f64 = 20.0;
/// Rounds of a training, and trainings, each along the motion that the one before leads to: the response is linear about that.
const ROUNDS: usize = 20;
const PASSES: usize = 3;
/// Fall of the cost below which a training ends, and the same as a share of the cost.
const ENOUGH: [f64; 2] = [0.05, 2e-4];
/// Share of the errors' squares that is no progress from one training to the next.
const TRIFLE: f64 = 1e-2;
/// Share of the held-out gap that a learned force must take away to be kept.
const WORTH: f64 = 0.1;

/// The network of one joint.
struct Learned {
    joint: usize,
    network: Network,
}

/// The most likely learned force on top of a fitted model, which lacks such forces, the most evident first; none where no force shows.
pub(crate) fn learn(
    search: &Search<'_>,
    fit: &Fit,
    lacking: &[(usize, Nameless)],
    scale: f64,
    seed: u64,
) -> Result<Option<Residual>, GapError> {
    let (mut errors, mut runs) = follow(search, fit, None, STEP)?;
    let roughness = search.roughness(fit, &errors, STEP);
    let begun = |(joint, nameless): &(usize, Nameless)| {
        let response = Response::new(search, fit, &runs, *joint);
        Ok(Learned { joint: *joint, network: fresh(&response, search.kind(fit, *joint), nameless.force, seed)? })
    };
    let plain = lacking.iter().filter(|(_, nameless)| nameless.evidence > 0.0);
    let mut learned: Vec<Learned> = plain.take(MOST).map(begun).collect::<Result<_, GapError>>()?;
    let mut best: Option<Residual> = None;
    for _ in 0..PASSES {
        let before = errors.norm_squared();
        for one in &mut learned {
            let response = Response::new(search, fit, &runs, one.joint);
            errors = train(&response, search.kind(fit, one.joint), &errors, &mut one.network, scale)?;
        }
        if learned.is_empty() {
            break;
        }
        let tried = joined(search, fit, &learned, seed)?;
        let Ok((after, along)) = follow_lightly(search, fit, &tried, STEP, roughness.as_ref()) else { break };
        // What the linear response promises the simulator need not keep.
        if after.norm_squared() >= before {
            break;
        }
        let is_trifle = before - after.norm_squared() < TRIFLE * before;
        (errors, runs, best) = (after, along, Some(tried));
        if is_trifle {
            break;
        }
    }
    Ok(best)
}

/// Prediction errors of a fitted model with a learned force, and its runs, in steps no longer than `step`.
pub(crate) fn follow(search: &Search<'_>, fit: &Fit, residual: Option<&Residual>, step: f64) -> Result<(DVector<f64>, Vec<Run>), GapError> {
    search.problem.followed(&search.plant(fit, residual, step)?)
}

/// The same in steps to first order, where what these leave over without such a force is known: it is nearly the same with it.
pub(crate) fn follow_lightly(
    search: &Search<'_>,
    fit: &Fit,
    residual: &Residual,
    step: f64,
    roughness: Option<&DVector<f64>>,
) -> Result<(DVector<f64>, Vec<Run>), GapError> {
    let Some(roughness) = roughness else { return follow(search, fit, Some(residual), step) };
    let (errors, runs) = search.problem.followed(&search.plant(fit, Some(residual), step)?.roughly())?;
    Ok((errors + roughness, runs))
}

impl Search<'_> {
    /// What steps to first order leave over in a fit's errors; none where rows are not so short that they say which way to go, or where they get
    /// lost.
    pub fn roughness(&self, fit: &Fit, errors: &DVector<f64>, step: f64) -> Option<DVector<f64>> {
        let rough = || self.problem.followed(&self.plant(fit, None, step)?.roughly());
        if self.problem.has_short_rows() { Some(errors - rough().ok()?.0) } else { None }
    }

    /// A fitted model with a learned force, in steps no longer than `step`.
    fn plant(&self, fit: &Fit, residual: Option<&Residual>, step: f64) -> Result<Plant, GapError> {
        fit.hypothesis.plant(&fit.hypothesis.x, &self.problem.limits, step)?.with_residual(residual)
    }

    fn kind(&self, fit: &Fit, joint: usize) -> JointKind {
        fit.hypothesis.model.joints[self.joints[joint]].kind
    }
}

/// What a network reads of a row, in the order of all residuals: features of the position, velocity, input, acceleration.
fn inputs(kind: JointKind, [q, v, u]: [f64; 3]) -> Vec<f64> {
    match kind {
        JointKind::Continuous => vec![q.sin(), q.cos(), v, u, 0.0],
        _ => vec![q, v, u, 0.0],
    }
}

/// A network that says nothing yet, for a force of a size.
fn fresh(response: &Response, kind: JointKind, size: f64, seed: u64) -> Result<Network, GapError> {
    let rows: Vec<Vec<f64>> = response.along().map(|row| inputs(kind, row)).collect();
    let count = rows.first().map_or(0, Vec::len);
    let mut network = Network::new(&[count, HIDDEN, 1], Activation::Tanh, seed)?;
    let mean: Vec<f64> = (0..count).map(|i| rows.iter().map(|r| r[i]).sum::<f64>() / rows.len() as f64).collect();
    let spread = |i: usize| (rows.iter().map(|r| (r[i] - mean[i]).powi(2)).sum::<f64>() / rows.len() as f64).sqrt();
    // What never changes says nothing, and is not blown up.
    let input_scale = (0..count).map(|i| if spread(i) > 1e-9 { spread(i) } else { 1.0 }).collect();
    network.set_normalisation(Normalisation { input_mean: mean.clone(), input_scale, output_scale: vec![size.max(1e-12)] })?;
    let mut weights = network.weights().to_vec();
    for i in pinned(count) {
        weights[i] = 0.0;
    }
    // Forces that step at a reversal are the commonest, and a smooth start finds them late: one unit begins as the velocity's sign.
    let velocity = count - 3;
    weights[..count].fill(0.0);
    weights[velocity] = STEEP;
    weights[HIDDEN * count] = STEEP * mean[velocity] / network.normalisation().input_scale[velocity];
    network.set_weights(&weights)?;
    Ok(network)
}

/// Weights of the acceleration, which stay at zero.
fn pinned(inputs: usize) -> impl Iterator<Item = usize> {
    (0..HIDDEN).map(move |i| i * inputs + inputs - 1)
}

/// Fits one network. `errors` are those with its force as it stands; what comes back are those that are left by the linear response.
fn train(response: &Response, kind: JointKind, errors: &DVector<f64>, network: &mut Network, scale: f64) -> Result<DVector<f64>, GapError> {
    let rows: Vec<Vec<f64>> = response.along().map(|row| inputs(kind, row)).collect();
    let mut weights = network.weights().to_vec();
    let kept: Vec<usize> = pinned(network.inputs()).collect();
    let free: Vec<usize> = (0..weights.len()).filter(|i| !kept.contains(i)).collect();
    let mut ws = network.workspace();
    // A residual drives; the catalogue's forces resist.
    let mut resisting = |network: &Network| -> Vec<f64> {
        let mut y = [0.0];
        let force = |x: &Vec<f64>| {
            network.forward(&mut ws, x, &mut y);
            -y[0]
        };
        rows.iter().map(force).collect()
    };
    let bare = errors - response.errors_of(&resisting(network));
    let mut left = |network: &Network| &bare + response.errors_of(&resisting(network));
    let weight = 1.0 / (scale * scale);
    let prior = 1.0 / (WEIGHT * WEIGHT);
    let cost = |e: &DVector<f64>, w: &[f64]| 0.5 * weight * e.norm_squared() + 0.5 * prior * w.iter().map(|x| x * x).sum::<f64>();
    let mut now = left(network);
    let mut damping = 1e-2;
    for _ in 0..ROUNDS {
        let columns = slopes(network, &rows, &free, response);
        // A product of matrices is much faster than one of dots, column by column.
        let mut matrix = weight * (columns.transpose() * &columns);
        let right = -weight * columns.tr_mul(&now) - prior * DVector::from_iterator(free.len(), free.iter().map(|i| weights[*i]));
        for i in 0..free.len() {
            matrix[(i, i)] += prior;
        }
        let before = cost(&now, &weights);
        let mut fall = 0.0;
        for _ in 0..6 {
            let mut damped = matrix.clone();
            for i in 0..free.len() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let Some(factor) = Cholesky::new(damped) else { break };
            let step = factor.solve(&right);
            let mut tried = weights.clone();
            for (i, d) in free.iter().zip(step.iter()) {
                tried[*i] += d;
            }
            network.set_weights(&tried)?;
            let e = left(network);
            let after = cost(&e, &tried);
            if after < before {
                (weights, now, fall) = (tried, e, before - after);
                damping = (damping * 0.2).max(1e-6);
                break;
            }
            damping = (damping * 10.0).max(1e-4);
        }
        if fall < ENOUGH[0].max(ENOUGH[1] * before) {
            break;
        }
    }
    network.set_weights(&weights)?;
    Ok(now)
}

/// Derivatives of the errors by the free weights.
fn slopes(network: &Network, rows: &[Vec<f64>], free: &[usize], response: &Response) -> DMatrix<f64> {
    let mut ws = network.workspace();
    let (mut y, mut x_bar, mut bar) = ([0.0], vec![0.0; network.inputs()], vec![0.0; network.weights().len()]);
    let mut forces = vec![vec![0.0; rows.len()]; free.len()];
    for (k, x) in rows.iter().enumerate() {
        network.forward(&mut ws, x, &mut y);
        bar.fill(0.0);
        network.pull(&mut ws, &[1.0], &mut x_bar, Some(&mut bar));
        for (force, i) in forces.iter_mut().zip(free) {
            force[k] = -bar[*i];
        }
    }
    DMatrix::from_columns(&response.errors_of_each(&forces))
}

/// One residual of several joints' networks, each joint's part deaf to the others.
fn joined(search: &Search<'_>, fit: &Fit, learned: &[Learned], seed: u64) -> Result<Residual, GapError> {
    let plant = fit.hypothesis.plant(&fit.hypothesis.x, &search.problem.limits, search.problem.step)?;
    let names: Vec<&str> = learned.iter().map(|l| search.names[l.joint].as_str()).collect();
    let mut residual = Residual::new(plant.system.multibody(), &names, &names, &[HIDDEN * learned.len()], Activation::Tanh, seed)?;
    let (inputs, outputs) = (residual.network().inputs(), learned.len());
    let hidden = HIDDEN * outputs;
    let mut weights = vec![0.0; residual.network().weights().len()];
    let (offsets, second) = (hidden * inputs, hidden * (inputs + 1));
    let mut normalisation = Normalisation { input_mean: Vec::new(), input_scale: Vec::new(), output_scale: Vec::new() };
    let mut first = 0;
    for (part, one) in learned.iter().enumerate() {
        let (own, width) = (one.network.weights(), one.network.inputs());
        let (own_offsets, own_second) = (HIDDEN * width, HIDDEN * (width + 1));
        for i in 0..HIDDEN {
            let unit = part * HIDDEN + i;
            weights[unit * inputs + first..unit * inputs + first + width].copy_from_slice(&own[i * width..(i + 1) * width]);
            weights[offsets + unit] = own[own_offsets + i];
            weights[second + part * hidden + unit] = own[own_second + i];
        }
        weights[second + outputs * hidden + part] = own[own_second + HIDDEN];
        let own = one.network.normalisation();
        normalisation.input_mean.extend_from_slice(&own.input_mean);
        normalisation.input_scale.extend_from_slice(&own.input_scale);
        normalisation.output_scale.extend_from_slice(&own.output_scale);
        first += width;
    }
    residual.set_weights(&weights)?;
    residual.set_normalisation(normalisation)?;
    Ok(residual)
}

/// Tries a learned force on what the named effects leave over. It is kept where the gap on data that it has not seen falls by a tenth or
/// more; `gap` is that gap without it, `floor` what noise alone leaves of it.
pub(crate) fn remainder(
    search: &Search<'_>,
    measure: &Measure<'_>,
    current: &Fit,
    scale: f64,
    [gap, floor]: [f64; 2],
    seed: u64,
) -> Result<(Remainder, Option<Residual>), GapError> {
    let not = Remainder { kept: false, gap: [gap, gap] };
    // What noise leaves cannot be learned, so a gap at its floor cannot fall so far.
    if floor > (1.0 - WORTH) * gap {
        return Ok((not, None));
    }
    let Some(residual) = learn(search, current, &search.lacking_forces(current, scale)?, scale, seed)? else { return Ok((not, None)) };
    let after = measure.pooled(&current.hypothesis, Some(&residual))?;
    let kept = after <= (1.0 - WORTH) * gap;
    Ok((Remainder { kept, gap: [gap, after] }, kept.then_some(residual)))
}
