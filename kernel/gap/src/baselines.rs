//! What other ways make of the same data, for honesty: known numbers alone, however free; a learned force alone; sparse regression.
//!
//! Sparse regression is sequentially thresholded least squares over a library of terms that are linear in their coefficients (Brunton,
//! Proctor and Kutz 2016),
//!
//! ```text
//! dtau = b + k q + a sin q + c cos q + d v + e v |v| + f sgn v
//! ```
//!
//! in the space of prediction errors, so that no velocity is differentiated (the weak form, Messenger and Bortz 2021), with the known numbers
//! moving beside it. A term whose force is below a share of the joint's typical one is dropped, and the rest solved anew; the share is chosen
//! by the Bayesian information criterion (as Mangan et al. 2017 choose it). A coefficient of a sign that no simulator takes - a spring or a
//! friction that drives - is set to zero, and the rest solved anew. What is left is simulated as entries of the catalogue.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;
use sagci_dynamics::effects;
use sagci_model::JointKind;

use crate::GapError;
use crate::fit::{Derivatives, Effort, Fit, Problem};
use crate::flexible::Nameless;
use crate::gaps::Measure;
use crate::hypothesis::{Fitted, Hypothesis, Knob};
use crate::remainder;
use crate::response::Response;
use crate::search::{STEP, Search};

/// How many times wider what is known may be off in the free refit, and how far at the least.
const WIDER: f64 = 10.0;
const LEAST_MASS: f64 = 0.2;
const LEAST_PLACE: f64 = 0.05;
/// Spread of the logarithm of a drive's number, or of friction, in the free refit.
const FREE: f64 = 3.0;

/// Share of the errors' squares that is no progress, where one round is seconds of an arm's: in its free refit, and from pass to pass.
const TRIFLE: f64 = 1e-2;

/// Terms of the regression: effect, its parameters at a coefficient of one, whether the coefficient may be negative.
const TERMS: [(&str, &[f64], bool); 7] = [
    ("torque_bias", &[1.0], true),
    ("joint_spring", &[1.0, 0.0], false),
    ("hinge_tilt", &[1.0, 0.0], true),
    ("hinge_tilt", &[1.0, std::f64::consts::FRAC_PI_2], true),
    ("viscous_friction", &[1.0], false),
    ("quadratic_drag", &[1.0], false),
    ("coulomb_friction", &[1.0], false),
];
/// Shares of the typical force among which the threshold is chosen.
const THRESHOLDS: [f64; 6] = [0.003, 0.01, 0.02, 0.05, 0.1, 0.2];
/// Ridge, as a share of a column's square: terms that a short range cannot tell apart share their force.
const RIDGE: f64 = 1e-5;
/// Passes. The first takes the terms along the motion of a model that lacks them, which lags behind the data; the next along one that has them.
const PASSES: usize = 4;
/// Joints that the regression looks at: the worst ones.
const MOST: usize = 3;

/// The pooled gap of each other way that changes the model. One that cannot be simulated is left out. Where the answer's numbers are fitted
/// over windows, of this measure, those of the free refit are, too. The refitted model comes with the forces that it lacks, the most evident first.
pub(crate) fn baselines(
    search: &Search<'_>,
    measure: &Measure<'_>,
    (refitted, lacking): (&Fit, &[(usize, Nameless)]),
    scale: f64,
    seed: u64,
    over_windows: Option<&Measure<'_>>,
) -> BTreeMap<String, f64> {
    let ways = ["free_refit", "learned_residual", "sparse_regression"];
    let gap = |way: &&str| -> Result<f64, GapError> {
        match *way {
            "free_refit" => {
                let free = free_refit(search, refitted, scale)?;
                let over = over_windows.map_or(Ok(None), |own| search.over_windows(&free, own))?;
                measure.pooled(&over.map_or(free, |f| f.fit).hypothesis, None)
            }
            "learned_residual" => {
                let residual = remainder::learn(search, refitted, lacking, scale, seed)?;
                measure.pooled(&refitted.hypothesis, residual.as_ref())
            }
            _ => measure.pooled(&sparse_regression(search, (refitted, lacking), scale)?, None),
        }
    };
    let found: Vec<(String, f64)> = ways.par_iter().filter_map(|way| Some(((*way).to_owned(), gap(way).ok()?))).collect();
    found.into_iter().filter(|(_, x)| x.is_finite()).collect()
}

/// All that the model knows, free, with damping and dry friction even where it has none.
pub(crate) fn free_refit(search: &Search<'_>, refitted: &Fit, scale: f64) -> Result<Fit, GapError> {
    let Problem { trajectories, disturbance, limits, .. } = &search.problem;
    let problem = Problem::new(trajectories, disturbance.clone(), limits, STEP);
    let mut model = refitted.hypothesis.model.clone();
    let tolerance = &mut model.document.refit_tolerance;
    tolerance.mass = (WIDER * tolerance.mass).clamp(LEAST_MASS, 0.5);
    tolerance.center_of_mass = (WIDER * tolerance.center_of_mass).max(LEAST_PLACE);
    let mut hypothesis = Hypothesis::known(&model, &search.joints);
    let known = &refitted.hypothesis;
    for (fitted, x) in hypothesis.fitted.iter_mut().zip(&mut hypothesis.x) {
        if let Some(at) = known.fitted.iter().position(|f| f.knob == fitted.knob) {
            *x = known.x[at];
        }
        if fitted.logarithmic {
            fitted.prior[1] = fitted.prior[1].max(FREE);
            fitted.bounds = [x.min(fitted.bounds[0]) - FREE, x.max(fitted.bounds[1]) + FREE];
        }
    }
    let typical = search.typical_force();
    for (j, &i) in search.joints.iter().enumerate() {
        let joint = &model.joints[i];
        let side = usize::from(joint.kind == JointKind::Prismatic);
        let speed = search.typical_speed(j);
        let absent = [
            (joint.damping, Knob::Damping(i), typical[j] / speed, ["N m s/rad", "N s/m"][side]),
            (joint.friction, Knob::Friction(i), typical[j], ["N m", "N"][side]),
        ];
        for (_, knob, size, unit) in absent.into_iter().filter(|(value, ..)| *value <= 0.0) {
            hypothesis.fitted.push(Fitted {
                knob,
                unit,
                logarithmic: false,
                bounds: [0.0, 100.0 * size],
                prior: [0.0, WIDER * size],
                difference: 1e-3 * size,
            });
            hypothesis.x.push(0.0);
        }
    }
    hypothesis.known = hypothesis.x.len();
    // A run for each number of an arm would be most of the work.
    if search.many_joints() {
        let search = Search { problem, ..search.clone() };
        let Some(part) = search.part(scale) else { return search.in_response(hypothesis, scale, TRIFLE) };
        let light = search.over(&part.trajectories).lightly(search.problem.has_short_rows());
        let begun = light.in_response(hypothesis, scale, TRIFLE)?;
        return search.in_response(begun.hypothesis, scale, TRIFLE);
    }
    let start = Fit::start(&problem, hypothesis)?;
    let all: Vec<usize> = (0..start.hypothesis.x.len()).collect();
    let rough = problem.roughly();
    let errors = rough.errors(&start.hypothesis, &start.hypothesis.x)?;
    let jacobian = rough.jacobian(&start.hypothesis, &start.hypothesis.x, &errors, &all)?;
    let condensed = start.hypothesis.condensed(&jacobian, scale);
    // Numbers that were let go stand where they stood only if those kept are asked anew.
    Fit::start(&problem, condensed)?.improve(&problem, scale, Effort::new(6, 0.5), Derivatives::ROUGH)
}

/// One term of the library on one joint.
struct Term {
    joint: usize,
    index: usize,
    column: DVector<f64>,
    /// Force at a coefficient of one, RMS.
    size: f64,
}

/// The model with what sparse regression finds.
pub(crate) fn sparse_regression(
    search: &Search<'_>,
    (refitted, lacking): (&Fit, &[(usize, Nameless)]),
    scale: f64,
) -> Result<Hypothesis, GapError> {
    let worst: Vec<usize> = lacking.iter().take(MOST).map(|(joint, _)| *joint).collect();
    let mut at = refitted.clone();
    let mut coefficients = vec![[0.0; TERMS.len()]; search.names.len()];
    for pass in 0..PASSES {
        let Some(hypothesis) = regress(search, refitted, &at, &worst, &mut coefficients, scale)? else { break };
        match Fit::start(&search.problem, hypothesis) {
            Ok(next) => {
                let (before, after) = (at.squares, next.squares);
                at = Fit { jacobian: refitted.jacobian.clone(), ..next };
                if (before - after).abs() < TRIFLE * before {
                    break;
                }
            }
            Err(_) if pass > 0 => break,
            Err(e) => return Err(e),
        }
    }
    Ok(at.hypothesis)
}

/// One pass: terms along the motion of the fit `at`, which has the coefficients that come in. None where nothing can be solved.
fn regress(
    search: &Search<'_>,
    refitted: &Fit,
    at: &Fit,
    joints: &[usize],
    coefficients: &mut [[f64; TERMS.len()]],
    scale: f64,
) -> Result<Option<Hypothesis>, GapError> {
    let runs = search.runs(at)?;
    let typical = search.typical_force();
    // What the errors would be without the terms, as far as they act linearly.
    let mut bare = at.clone();
    let mut terms = Vec::new();
    for &joint in joints {
        let response = Response::new(search, at, &runs, joint);
        for (index, (effect, theta, _)) in TERMS.iter().enumerate() {
            let has = |e: &sagci_model::EffectEntry| e.effect == *effect && e.joint.as_deref() == Some(search.names[joint].as_str());
            if refitted.hypothesis.model.document.effects.iter().any(has) {
                continue;
            }
            let forces = response.forces(effects::find(effect)?, theta);
            let size = (forces.iter().map(|f| f * f).sum::<f64>() / forces.len().max(1) as f64).sqrt();
            let column = response.errors_of(&forces);
            if column.norm_squared() > 0.0 {
                bare.errors.axpy(-coefficients[joint][index], &column, 1.0);
                terms.push(Term { joint, index, column, size });
            }
        }
    }
    let system = System::new(&bare, &terms, scale);
    let count = search.problem.measured() as f64;
    let mut best: Option<(f64, Vec<f64>)> = None;
    for threshold in THRESHOLDS {
        let Some(solved) = system.thresholded(&terms, &|t, c| c.abs() * t.size < threshold * typical[t.joint]) else { continue };
        let used = solved[system.known..].iter().filter(|c| **c != 0.0).count() as f64;
        let criterion = system.cost(&solved) + 0.5 * used * count.ln();
        if best.as_ref().is_none_or(|b| criterion < b.0) {
            best = Some((criterion, solved));
        }
    }
    let Some((_, solved)) = best else { return Ok(None) };
    let (moved, found) = solved.split_at(system.known);
    let mut hypothesis = refitted.hypothesis.clone();
    for (i, (x, fitted)) in hypothesis.x.iter_mut().zip(&hypothesis.fitted).enumerate() {
        *x = (at.hypothesis.x[i] + moved[i]).clamp(fitted.bounds[0], fitted.bounds[1]);
    }
    coefficients.fill([0.0; TERMS.len()]);
    for (term, coefficient) in terms.iter().zip(found) {
        coefficients[term.joint][term.index] = *coefficient;
    }
    for (name, found) in search.names.iter().zip(coefficients.iter()) {
        let [bias, stiffness, sine, cosine, damping, drag, friction] = *found;
        let tilt = sine.hypot(cosine);
        let entries = [
            ("torque_bias", bias, vec![bias]),
            ("joint_spring", stiffness, vec![stiffness, 0.0]),
            ("hinge_tilt", tilt, vec![tilt, cosine.atan2(sine)]),
            ("viscous_friction", damping, vec![damping]),
            ("quadratic_drag", drag, vec![drag]),
            ("coulomb_friction", friction, vec![friction]),
        ];
        for (effect, _, values) in entries.into_iter().filter(|(_, size, _)| *size != 0.0) {
            hypothesis = hypothesis.with(effect, Some(name), &values)?;
        }
    }
    Ok(Some(hypothesis))
}

/// Normal equations of the known numbers' changes and, behind them, the terms' coefficients.
struct System {
    known: usize,
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

impl System {
    fn new(fit: &Fit, terms: &[Term], scale: f64) -> Self {
        let (matrix, right) = fit.normal(scale);
        let (known, count) = (right.len(), right.len() + terms.len());
        let weight = 1.0 / (scale * scale);
        let mut matrix = matrix.resize(count, count, 0.0);
        let mut right = right.resize_vertically(count, 0.0);
        for (a, term) in terms.iter().enumerate() {
            let row = known + a;
            for (b, column) in fit.jacobian.iter().chain(terms.iter().map(|t| &t.column)).enumerate() {
                let dot = weight * term.column.dot(column);
                (matrix[(row, b)], matrix[(b, row)]) = (dot, dot);
            }
            matrix[(row, row)] *= 1.0 + RIDGE;
            right[row] = -weight * term.column.dot(&fit.errors);
        }
        Self { known, matrix, right }
    }

    /// The solution over some of the columns, zero elsewhere.
    fn solve(&self, used: &[usize]) -> Option<Vec<f64>> {
        let matrix = DMatrix::from_fn(used.len(), used.len(), |a, b| self.matrix[(used[a], used[b])]);
        let right = DVector::from_fn(used.len(), |a, _| self.right[used[a]]);
        let found = Cholesky::new(matrix)?.solve(&right);
        let mut all = vec![0.0; self.right.len()];
        for (i, x) in used.iter().zip(found.iter()) {
            all[*i] = *x;
        }
        Some(all)
    }

    /// Change of half the squared errors and priors, at a solution.
    fn cost(&self, x: &[f64]) -> f64 {
        let x = DVector::from_column_slice(x);
        0.5 * x.dot(&(&self.matrix * &x)) - self.right.dot(&x)
    }

    /// Drops what is small or of a sign that cannot be, until nothing is.
    fn thresholded(&self, terms: &[Term], small: &dyn Fn(&Term, f64) -> bool) -> Option<Vec<f64>> {
        let mut used: Vec<usize> = (0..self.right.len()).collect();
        loop {
            let solved = self.solve(&used)?;
            let wrong = |i: &usize| {
                let Some(term) = i.checked_sub(self.known).map(|t| &terms[t]) else { return false };
                small(term, solved[*i]) || !TERMS[term.index].2 && solved[*i] < 0.0
            };
            let before = used.len();
            let kept: Vec<usize> = used.iter().copied().filter(|i| !wrong(i)).collect();
            if kept.len() == before {
                return Some(solved);
            }
            used = kept;
        }
    }
}

impl Search<'_> {
    /// Typical speed of a joint, over a tenth of a second.
    pub fn typical_speed(&self, j: usize) -> f64 {
        let (mut squares, mut count) = (0.0, 0.0);
        for trajectory in self.problem.trajectories {
            let y: Vec<f64> = trajectory.positions(j).collect();
            let period = trajectory.period();
            let width = ((0.1 / period).round() as usize).max(1);
            for (a, b) in y.iter().zip(y.iter().skip(width)) {
                let v = (b - a) / (width as f64 * period);
                if v.is_finite() {
                    squares += v * v;
                    count += 1.0;
                }
            }
        }
        f64::max((squares / f64::max(count, 1.0)).sqrt(), 1e-6)
    }
}
