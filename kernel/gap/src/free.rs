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
use crate::fit::{Fit, bounded_step, room};
use crate::hypothesis::Hypothesis;
use crate::observer::Run;
use crate::remainder::{follow, follow_lightly};
use crate::response::Response;
use crate::search::Search;

/// Knots that lie evenly, and those with as many rows between them.
const EVEN: usize = 33;
const BY_ROWS: usize = 13;
/// Share of the range below which two knots are one.
const APART: f64 = 0.01;
/// Steps, dampings of one that makes errors larger, and the fall of the cost that is no progress, exactly and in steps to first order.
const STEPS: usize = 12;
const DAMPINGS: [f64; 5] = [1e-9, 1e-3, 1e-2, 0.1, 1.0];
const ENOUGH: f64 = 0.1;
const ENOUGH_LIGHTLY: f64 = 1.0;
/// Share of a bar that the linear response has to promise: it is off by some hundredths. After so many steps it is off by less: what is behind
/// by such a share of the bar, and by more than names' errors could hang together by, stays behind.
const HOPELESS: f64 = 0.8;
const SETTLED: usize = 3;
const BEHIND: f64 = 0.01;
const FAR_BEHIND: f64 = 500.0;
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

impl Over {
    /// What it depends on, along a response.
    fn along(self, response: &Response) -> Vec<f64> {
        let pick = |[q, v, _]: [f64; 3]| if self == Self::Position { q } else { v };
        response.along().map(pick).collect()
    }
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

/// On which joint, by what, and where it bends.
struct Force<'k> {
    knots: &'k Knots,
    joint: usize,
    over: Over,
}

/// A fit's known numbers and those of a force beside them, with the errors and runs that come of both.
struct State {
    fit: Fit,
    numbers: Vec<f64>,
    errors: DVector<f64>,
    runs: Vec<Run>,
}

impl State {
    /// What is made small, where the force's numbers are of a size.
    fn cost(&self, size: f64, scale: f64) -> f64 {
        let known = self.fit.hypothesis.x.iter().zip(&self.fit.hypothesis.fitted);
        let prior: f64 = known.map(|(x, f)| 0.5 * ((x - f.prior[0]) / f.prior[1]).powi(2)).sum();
        let heights: f64 = self.numbers.iter().map(|w| 0.5 * (w / size).powi(2)).sum();
        0.5 * self.errors.norm_squared() / (scale * scale) + prior + heights
    }
}

/// The normal equations of a step, all in them but how large the force's numbers are.
struct Normal<'s> {
    state: &'s State,
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    /// How far the numbers may go. Those that are known stay within their bounds: a step that leaves them need not lead down once it is cut off.
    room: Vec<[f64; 2]>,
}

/// The same, if the force's numbers are of a size: what their freedom costs, and what a step gains.
struct Sized {
    size: f64,
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    paid: f64,
    gain: f64,
}

impl<'s> Normal<'s> {
    fn of(state: &'s State, columns: &DMatrix<f64>, scale: f64) -> Self {
        let weight = 1.0 / (scale * scale);
        let mut matrix = weight * (columns.transpose() * columns);
        let mut right = -weight * columns.tr_mul(&state.errors);
        let Hypothesis { x, fitted, .. } = &state.fit.hypothesis;
        for (i, (x, f)) in x.iter().zip(fitted).enumerate() {
            matrix[(i, i)] += 1.0 / f.prior[1].powi(2);
            right[i] -= (x - f.prior[0]) / f.prior[1].powi(2);
        }
        let mut room = room(fitted, x);
        room.resize(right.len(), [f64::NEG_INFINITY, f64::INFINITY]);
        Self { state, matrix, right, room }
    }

    fn sized(&self, size: f64) -> Option<Sized> {
        let (mut matrix, mut right) = (self.matrix.clone(), self.right.clone());
        let count = self.state.numbers.len();
        let known = right.len() - count;
        for (i, w) in self.state.numbers.iter().enumerate() {
            matrix[(known + i, known + i)] += 1.0 / (size * size);
            right[known + i] -= w / (size * size);
        }
        let volume: f64 = Cholesky::new(matrix.clone())?.l().diagonal().rows(known, count).map(f64::ln).sum();
        let mut sized = Sized { size, matrix, right, paid: volume + count as f64 * size.ln(), gain: 0.0 };
        let step = self.step(&sized, DAMPINGS[0]);
        sized.gain = sized.right.dot(&step) - 0.5 * step.dot(&(&sized.matrix * &step));
        Some(sized)
    }

    /// By the likeliest of some sizes.
    fn likeliest(&self, sizes: impl IntoIterator<Item = f64>) -> Option<Sized> {
        sizes.into_iter().filter_map(|s| self.sized(s)).max_by(|a, b| (a.gain - a.paid).total_cmp(&(b.gain - b.paid)))
    }

    fn step(&self, sized: &Sized, damping: f64) -> DVector<f64> {
        bounded_step(&sized.matrix, &sized.right, damping, &self.room)
    }
}

impl Search<'_> {
    /// The likeliest force by position or velocity alone on a joint, on top of a fitted model; none where that cannot be followed along the data, or
    /// where no such force comes near a `bar` of evidence, which saves following it to its end.
    pub fn free(&self, base: &Fit, joint: usize, scale: f64, bar: f64) -> Result<Option<Free>, GapError> {
        // A model that gets lost along the data leaves no run to begin with.
        let Ok((errors, runs)) = follow(self, base, None, self.problem.step) else { return Ok(None) };
        let roughness = self.roughness(base, &errors, self.problem.step);
        let continuous = base.hypothesis.model.joints[self.joints[joint]].kind == JointKind::Continuous;
        let mut best: Option<Free> = None;
        // A joint that turns on and on is in no place.
        for over in [Over::Position, Over::Velocity].into_iter().filter(|o| *o == Over::Velocity || !continuous) {
            let begin = State { fit: base.clone(), numbers: Vec::new(), errors: errors.clone(), runs: runs.clone() };
            let bar = best.as_ref().map_or(bar, |b| b.evidence.max(bar));
            if let Some(free) = self.free_over(begin, roughness.as_ref(), (joint, over), scale, bar)?
                && best.as_ref().is_none_or(|b| free.evidence > b.evidence)
            {
                best = Some(free);
            }
        }
        Ok(best)
    }

    /// It begins in steps to first order, where what these leave over is known, and ends exactly.
    fn free_over(
        &self,
        begin: State,
        roughness: Option<&DVector<f64>>,
        (joint, over): (usize, Over),
        scale: f64,
        bar: f64,
    ) -> Result<Option<Free>, GapError> {
        let mut response = Response::new(self, &begin.fit, &begin.runs, joint);
        let Some(knots) = Knots::over(over.along(&response)) else { return Ok(None) };
        let force = Force { knots: &knots, joint, over };
        let typical = self.typical_force()[joint].max(f64::MIN_POSITIVE);
        let (jacobian, begun) = (begin.fit.jacobian.clone(), begin.fit.hypothesis.x.clone());
        let mut now = State { numbers: vec![0.0; knots.at.len()], ..begin };
        let before = now.cost(1.0, scale);
        let (mut size, mut occam) = (None, 0.0);
        let mut roughness = roughness;
        let exactly = |state: &State| {
            let residual = self.as_residual(&state.fit, &force, &knots.heights(&state.numbers))?;
            follow(self, &state.fit, Some(&residual), self.problem.step)
        };
        for step in 0..STEPS {
            let mut columns = known_columns(&jacobian, &begun, &now.fit.hypothesis);
            columns.extend(response.errors_of_each(&knots.columns(&over.along(&response))));
            let normal = Normal::of(&now, &DMatrix::from_columns(&columns), scale);
            let sized = match size {
                None => normal.likeliest(SIZES.map(|share| share * typical)),
                Some(s) => normal.sized(s),
            };
            let Some(sized) = sized else { return Ok(None) };
            let here = now.cost(sized.size, scale);
            let near = if step < SETTLED { f64::NEG_INFINITY } else { bar - (BEHIND * bar).max(FAR_BEHIND) };
            let asked = near.max(HOPELESS * bar);
            if before - here + sized.gain - sized.paid < asked {
                return Ok(None);
            }
            (size, occam) = (Some(sized.size), sized.paid);
            let damped = DAMPINGS.into_iter().filter_map(|d| self.moved(&now, &normal.step(&sized, d), &force, roughness).ok());
            let next = damped.map(|state| (state.cost(sized.size, scale), state)).find(|(cost, _)| *cost < here);
            let fall = next.as_ref().map_or(0.0, |(cost, _)| here - cost);
            if let Some((_, next)) = next {
                now = next;
            }
            if fall < if roughness.is_some() { ENOUGH_LIGHTLY } else { ENOUGH } {
                // Where steps to first order bring no more, exact ones go on.
                if roughness.take().is_none() {
                    break;
                }
                (now.errors, now.runs) = exactly(&now)?;
            }
            response = Response::new(self, &now.fit, &now.runs, joint);
        }
        let Some(size) = size else { return Ok(None) };
        if roughness.is_some() {
            now.errors = exactly(&now)?.0;
        }
        Ok(Some(Free { evidence: before - now.cost(size, scale) - occam, errors: now.errors }))
    }

    /// A step, followed in the simulator.
    fn moved(&self, from: &State, step: &DVector<f64>, force: &Force<'_>, roughness: Option<&DVector<f64>>) -> Result<State, GapError> {
        let mut fit = from.fit.clone();
        let known = fit.hypothesis.x.len();
        fit.hypothesis.x.iter_mut().zip(step.iter()).for_each(|(x, step)| *x += step);
        let numbers: Vec<f64> = from.numbers.iter().zip(step.iter().skip(known)).map(|(w, step)| w + step).collect();
        let residual = self.as_residual(&fit, force, &force.knots.heights(&numbers))?;
        let (errors, runs) = follow_lightly(self, &fit, &residual, self.problem.step, roughness)?;
        Ok(State { fit, numbers, errors, runs })
    }

    /// The force as a network of one layer, a unit for each bend. A residual drives; the catalogue's forces resist.
    fn as_residual(&self, fit: &Fit, &Force { knots, joint, over }: &Force<'_>, heights: &[f64]) -> Result<Residual, GapError> {
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

/// Derivatives by known numbers away from where they were taken. Those by a logarithm grow with the number itself: a curve takes over most of a
/// damping that lacked it.
fn known_columns(jacobian: &[DVector<f64>], begun: &[f64], now: &Hypothesis) -> Vec<DVector<f64>> {
    let grown = |i: usize| if now.fitted[i].logarithmic { (now.x[i] - begun[i]).exp() } else { 1.0 };
    jacobian.iter().enumerate().map(|(i, column)| grown(i) * column).collect()
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
        let free = search.free(&base, 0, 1.0, 0.0).unwrap().unwrap();
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
