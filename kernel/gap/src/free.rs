//! "None of these" in the simulator itself: a force by position or by velocity, linear between places, beside the model's known numbers.
//!
//! What `flexible.rs` screens in the linear response is exact only as far as that is: where data say thousands of nats, some hundredths of them
//! are what the response is off by, and names that imitate a force, several together, come out ahead of it. Here the force acts in the
//! simulator: Gauss and Newton's steps over its heights `w` at the knots and the known numbers `x` together,
//!
//! ```text
//! minimise  1/2 |e(x, w)|^2 / s^2  +  1/2 |(x - m) / d|^2  +  1/2 |w|^2 / a^2
//! ```
//!
//! whose derivatives are the response's, while the errors are those of runs. The evidence is Laplace's, as that of every fit
//! (MacKay 2003, chapter 28).

use nalgebra::{Cholesky, DMatrix, DVector};
use sagci_dynamics::residual::{Activation, Normalisation, Residual};
use sagci_model::JointKind;

use crate::GapError;
use crate::fit::Fit;
use crate::observer::Run;
use crate::remainder::follow;
use crate::response::Response;
use crate::search::Search;

/// Knots that lie evenly, and those with as many rows between them.
const EVEN: usize = 33;
const BY_ROWS: usize = 13;
/// Share of the range below which two knots are one.
const APART: f64 = 0.01;
/// Steps, halvings of one that makes errors larger, and the fall of the cost that is no progress.
const STEPS: usize = 6;
const HALVINGS: i32 = 4;
const ENOUGH: f64 = 0.1;
/// How sharp a bend is, in units of the way to the next knot.
const SHARP: f64 = 16.0;
/// Sizes of the force that are expected, as shares of the typical one.
const SIZES: [f64; 8] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0];

/// What such a force depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Over {
    Position,
    Velocity,
}

/// A force without a name that was fitted in the simulator.
#[derive(Debug)]
pub(crate) struct Free {
    /// Logarithm of its evidence over that of no force.
    pub evidence: f64,
    /// Prediction errors with it.
    pub errors: DVector<f64>,
}

/// Where the force bends.
struct Knots {
    at: Vec<f64>,
    /// How sharply.
    sharpness: Vec<f64>,
}

impl Knots {
    /// Over values that were seen; none where they are all the same.
    fn over(mut seen: Vec<f64>) -> Option<Self> {
        seen.sort_by(f64::total_cmp);
        let (low, high) = (*seen.first()?, *seen.last()?);
        let last = seen.len() - 1;
        let even = (0..EVEN).map(|i| low + (high - low) * i as f64 / (EVEN - 1) as f64);
        let mut at: Vec<f64> = even.chain((0..BY_ROWS).map(|i| seen[last * i / (BY_ROWS - 1)])).collect();
        at.sort_by(f64::total_cmp);
        at.dedup_by(|b, a| *b - *a <= APART * (high - low));
        let gap = |i: usize| at.get(i + 1).map_or(f64::INFINITY, |next| next - at[i]);
        let beside = |i: usize| if i == 0 { gap(0) } else { gap(i - 1).min(gap(i)) };
        let sharpness = (0..at.len()).map(|i| SHARP / beside(i)).collect();
        (at.len() > 2).then_some(Self { at, sharpness })
    }

    /// The force's bends at the knots, and its value below them all, from its heights.
    fn bends(&self, heights: &[f64]) -> (Vec<f64>, f64) {
        let slope = |i: usize| if i + 1 < heights.len() { (heights[i + 1] - heights[i]) / (self.at[i + 1] - self.at[i]) } else { 0.0 };
        let bends = (0..heights.len()).map(|i| slope(i) - if i == 0 { 0.0 } else { slope(i - 1) }).collect();
        (bends, heights[0])
    }

    /// A bend of one, as the network makes it.
    fn bend(&self, knot: usize, x: f64) -> f64 {
        let z = self.sharpness[knot] * (x - self.at[knot]);
        z / (1.0 + (-z).exp()) / self.sharpness[knot]
    }

    /// Heights at the knots by the first of them, the slope behind it, and what that bends by at each of the others. Independent bends are the
    /// integral of a Brownian path, which is smooth (Wahba 1978).
    fn heights(&self, numbers: &[f64]) -> Vec<f64> {
        let range = self.at[self.at.len() - 1] - self.at[0];
        let (mut height, mut slope) = (numbers[0], 0.0);
        let mut heights = vec![height];
        for (pair, number) in self.at.windows(2).zip(&numbers[1..]) {
            let way = (pair[1] - pair[0]) / range;
            slope += if heights.len() == 1 { *number } else { way.sqrt() * number };
            height += way * slope;
            heights.push(height);
        }
        heights
    }

    /// Forces along values by one of each number.
    fn columns(&self, along: &[f64]) -> Vec<Vec<f64>> {
        let bent: Vec<Vec<f64>> = (0..self.at.len()).map(|i| along.iter().map(|x| self.bend(i, *x)).collect()).collect();
        let one = |knot: usize| {
            let numbers: Vec<f64> = (0..self.at.len()).map(|i| if i == knot { 1.0 } else { 0.0 }).collect();
            let (bends, below) = self.bends(&self.heights(&numbers));
            let mut force = vec![below; along.len()];
            for (bend, bent) in bends.iter().zip(&bent).filter(|(b, _)| **b != 0.0) {
                force.iter_mut().zip(bent).for_each(|(f, b)| *f += bend * b);
            }
            force
        };
        (0..self.at.len()).map(one).collect()
    }
}

/// A fit's known numbers and those of a force beside them, with the errors and runs that come of both.
struct State {
    fit: Fit,
    numbers: Vec<f64>,
    errors: DVector<f64>,
    runs: Vec<Run>,
}

impl Search<'_> {
    /// The likeliest force by position or velocity alone on a joint, on top of a fitted model; none where that cannot be followed along the data.
    pub fn free(&self, base: &Fit, joint: usize, scale: f64) -> Result<Option<Free>, GapError> {
        let continuous = base.hypothesis.model.joints[self.joints[joint]].kind == JointKind::Continuous;
        let mut best: Option<Free> = None;
        // A joint that turns on and on is in no place.
        for over in [Over::Position, Over::Velocity].into_iter().filter(|o| *o == Over::Velocity || !continuous) {
            if let Some(free) = self.free_over(base, joint, over, scale)?
                && best.as_ref().is_none_or(|b| free.evidence > b.evidence)
            {
                best = Some(free);
            }
        }
        Ok(best)
    }

    fn free_over(&self, base: &Fit, joint: usize, over: Over, scale: f64) -> Result<Option<Free>, GapError> {
        let along = |response: &Response| -> Vec<f64> {
            let pick = |[q, v, _]: [f64; 3]| if over == Over::Position { q } else { v };
            response.along().map(pick).collect()
        };
        // A model that gets lost along the data leaves no run to begin with.
        let Ok((errors, runs)) = follow(self, base, None, self.problem.step) else { return Ok(None) };
        let mut response = Response::new(self, base, &runs, joint);
        let Some(knots) = Knots::over(along(&response)) else { return Ok(None) };
        let (known, count) = (base.jacobian.len(), knots.at.len());
        let fitted = &base.hypothesis.fitted;
        let weight = 1.0 / (scale * scale);
        let typical = self.typical_force()[joint].max(f64::MIN_POSITIVE);
        let prior = |x: &[f64]| x.iter().zip(fitted).map(|(x, f)| 0.5 * ((x - f.prior[0]) / f.prior[1]).powi(2)).sum::<f64>();
        let cost = |state: &State, size: f64| {
            let heights = state.numbers.iter().map(|w| 0.5 * (w / size).powi(2)).sum::<f64>();
            0.5 * weight * state.errors.norm_squared() + prior(&state.fit.hypothesis.x) + heights
        };
        let mut now = State { fit: base.clone(), numbers: vec![0.0; count], errors, runs };
        let before = cost(&now, 1.0);
        let (mut size, mut occam) = (None, 0.0);
        for _ in 0..STEPS {
            let mut columns = base.jacobian.clone();
            columns.extend(knots.columns(&along(&response)).iter().map(|force| response.errors_of(force)));
            let columns = DMatrix::from_columns(&columns);
            let matrix = weight * (columns.transpose() * &columns);
            let mut right = -weight * columns.tr_mul(&now.errors);
            for (i, (x, f)) in now.fit.hypothesis.x.iter().zip(fitted).enumerate() {
                right[i] -= (x - f.prior[0]) / f.prior[1].powi(2);
            }
            let solved = |size: f64| {
                let (mut matrix, mut right) = (matrix.clone(), right.clone());
                for (i, f) in fitted.iter().enumerate() {
                    matrix[(i, i)] += 1.0 / f.prior[1].powi(2);
                }
                for (i, w) in now.numbers.iter().enumerate() {
                    matrix[(known + i, known + i)] += 1.0 / (size * size);
                    right[known + i] -= w / (size * size);
                }
                let factor = Cholesky::new(matrix)?;
                let step = factor.solve(&right);
                let volume = factor.l().diagonal().rows(known, count).map(f64::ln).sum();
                let gain = 0.5 * right.dot(&step);
                Some((step, volume + count as f64 * size.ln(), gain))
            };
            let chosen = size.map_or_else(
                || {
                    let all = SIZES.into_iter().map(|share| share * typical);
                    all.filter_map(|s| Some((s, solved(s)?))).max_by(|a, b| (a.1.2 - a.1.1).total_cmp(&(b.1.2 - b.1.1)))
                },
                |s: f64| Some((s, solved(s)?)),
            );
            let Some((chosen, (step, paid, _))) = chosen else { return Ok(None) };
            (size, occam) = (Some(chosen), paid);
            let here = cost(&now, chosen);
            let shares = (0..HALVINGS).map(|halved| 0.5f64.powi(halved));
            let mut tried = shares.filter_map(|share| self.moved(&now, &step, share, (&knots, joint, over)).ok());
            let Some(next) = tried.find(|state| cost(state, chosen) < here) else { break };
            let fall = here - cost(&next, chosen);
            now = next;
            response = Response::new(self, &now.fit, &now.runs, joint);
            if fall < ENOUGH {
                break;
            }
        }
        let Some(size) = size else { return Ok(None) };
        Ok(Some(Free { evidence: before - cost(&now, size) - occam, errors: now.errors }))
    }

    /// A share of a step, followed in the simulator.
    fn moved(&self, from: &State, step: &DVector<f64>, share: f64, (knots, joint, over): (&Knots, usize, Over)) -> Result<State, GapError> {
        let mut fit = from.fit.clone();
        let known = fit.hypothesis.x.len();
        for ((x, fitted), step) in fit.hypothesis.x.iter_mut().zip(&fit.hypothesis.fitted).zip(step.iter()) {
            *x = (*x + share * step).clamp(fitted.bounds[0], fitted.bounds[1]);
        }
        let numbers: Vec<f64> = from.numbers.iter().zip(step.iter().skip(known)).map(|(w, step)| w + share * step).collect();
        let residual = self.as_residual(&fit, joint, over, knots, &knots.heights(&numbers))?;
        let (errors, runs) = follow(self, &fit, Some(&residual), self.problem.step)?;
        Ok(State { fit, numbers, errors, runs })
    }

    /// The force as a network of one layer, a unit for each bend. A residual drives; the catalogue's forces resist.
    fn as_residual(&self, fit: &Fit, joint: usize, over: Over, knots: &Knots, heights: &[f64]) -> Result<Residual, GapError> {
        let plant = fit.hypothesis.plant(&fit.hypothesis.x, &self.problem.limits, self.problem.step)?;
        let (name, count) = ([self.names[joint].as_str()], knots.at.len());
        let mut residual = Residual::new(plant.system.multibody(), &name, &name, &[count], Activation::Silu, 0)?;
        let inputs = residual.network().inputs();
        // Position, velocity, input, acceleration, from the end.
        let read = inputs - if over == Over::Position { 4 } else { 3 };
        let (bends, below) = knots.bends(heights);
        let mut weights = vec![0.0; residual.network().weights().len()];
        let (offsets, second) = (count * inputs, count * (inputs + 1));
        for i in 0..count {
            weights[i * inputs + read] = knots.sharpness[i];
            weights[offsets + i] = -knots.sharpness[i] * knots.at[i];
            weights[second + i] = -bends[i] / knots.sharpness[i];
        }
        weights[second + count] = -below;
        residual.set_weights(&weights)?;
        let normalisation = Normalisation { input_mean: vec![0.0; inputs], input_scale: vec![1.0; inputs], output_scale: vec![1.0] };
        residual.set_normalisation(normalisation)?;
        Ok(residual)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::fit::Fit;
    use crate::search::Search;
    use crate::tests::{door, swing, with};
    use crate::trajectory::Trajectory;

    /// What the true name and a force without one say of data, and the squares that the latter leaves, for each error.
    fn said(effect: &'static str, parameters: &[(&str, f64)]) -> [f64; 3] {
        let model = door();
        let truth = with(&model, effect, parameters);
        let data: Vec<Trajectory> = (1..3).map(|seed| Trajectory::new(&swing(&truth, 1e-4, seed), &model).unwrap()).collect();
        let search = Search::new(&model, &data).unwrap();
        let base = search.known(&model, 1.0).unwrap();
        let values: Vec<f64> = parameters.iter().map(|p| p.1).collect();
        let named = base.hypothesis.with(effect, Some("hinge"), &values).unwrap();
        let named = search.fit_on(Fit::start(&search.problem, named).unwrap(), 1.0).unwrap();
        let gain = search.evidence_in_fit(&named, 1.0) - search.evidence_in_fit(&base, 1.0);
        let free = search.free(&base, 0, 1.0).unwrap().unwrap();
        [gain, free.evidence, free.errors.norm_squared() / search.problem.measured() as f64]
    }

    /// A spring that begins amid the way is a force by place, down to the noise, and its many knots cost little beside the true form's few numbers.
    #[test]
    fn a_force_by_place_says_nearly_what_its_true_form_does() {
        let [named, free, left] = said("hard_stop", &[("stiffness", 0.8), ("dissipation", 1e-3), ("position", 0.9), ("side", 1.0)]);
        assert!(
            named > 1000.0 && free > 0.97 * named && left < 1.1,
            "{named} by the true form, {free} without a name, which leaves {left}"
        );
        assert!(free < named + 10.0, "{named} by the true form, {free} without a name");
    }

    /// A right name is not beaten by a curve: what jumps at a reversal is none.
    #[test]
    fn dry_friction_is_no_curve_by_speed() {
        let [named, free, _] = said("coulomb_friction", &[("friction", 0.05)]);
        assert!(named > free + 10.0, "{named} by the true form, {free} without a name");
    }
}
