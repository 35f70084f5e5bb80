//! How a run changes beside itself, all joints together: the linear response of [`crate::response`] with what one joint does to another.
//!
//! Along a run, `ID(q, v, a) = tau` (Featherstone 2008, chapter 5). Beside it, with a force `f` that the motion asks for more,
//!
//! ```text
//! M da + D dv + K dq + f = 0,   D = dID/dv + damping - dtau/dv,   K = dID/dq - dtau/dq
//! ```
//!
//! over a row `h` by the midpoint rule, which is stable however stiff `D` is: with `x` the velocity in the middle,
//!
//! ```text
//! (2 + h W (D + h/2 K)) x = 2 dv - h W (K dq + f),   dq' = dq + h x,   dv' = 2 x - dv
//! ```
//!
//! `W` is the inverse of `M` over the joints that dry friction lets move: one that is held takes what pushes it, `dv = 0`, and what is left of
//! `W` without it is `W - w w^T / w_i`, `w` its column (Schur's complement). Between rows the filter corrects, as in [`crate::response`].

use nalgebra::{DMatrix, DVector};

use crate::GapError;
use crate::fit::Fit;
use crate::inertial::Along;
use crate::observer::Run;
use crate::search::Search;

/// Difference of positions and velocities by which derivatives are taken, in SI units: half the digits.
const DIFFERENCE: f64 = 1e-6;

/// What a row does with offsets of the state.
struct Row {
    /// Offsets begin anew.
    start: bool,
    h: f64,
    held: Vec<bool>,
    /// `K`, and the factors of `2 dv` and `K dq + f` in the middle's velocity.
    stiffness: DMatrix<f64>,
    keeps: DMatrix<f64>,
    yields: DMatrix<f64>,
}

/// The rows of a run.
pub(crate) struct Tangent {
    rows: Vec<Row>,
    joints: usize,
    errors: usize,
    /// Gains by row and joint, and the inverse of the errors' deviations, zero where an error is not counted.
    gains: Vec<[f64; 3]>,
}

impl Tangent {
    /// # Errors
    /// A model that has no inverse dynamics along the run.
    pub fn new(search: &Search<'_>, fit: &Fit, runs: &[Run], along: &Along) -> Result<Self, GapError> {
        let n = search.names.len();
        let hypothesis = &fit.hypothesis;
        let plant = hypothesis.plant(&hypothesis.x, &search.problem.limits, search.problem.step)?;
        let model = hypothesis.model_at(&hypothesis.x);
        let slopes = along.slopes(&plant, n, DIFFERENCE)?;
        let (mut rows, mut gains) = (Vec::new(), Vec::new());
        let drives = search.problem.drives(&plant);
        let mut slopes = slopes.into_iter();
        for (trajectory, run) in search.problem.trajectories.iter().zip(runs) {
            for k in 0..trajectory.rows() {
                let last = k + 1 == trajectory.rows() || trajectory.starts.contains(&(k + 1));
                let h = if last { 0.0 } else { trajectory.time[k + 1] - trajectory.time[k] };
                let held: Vec<bool> = (0..n).map(|j| !last && run.v_predicted[(k + 1) * n + j] == 0.0).collect();
                let Some([mut stiffness, mut damping]) = slopes.next() else { break };
                let mut inverse = DMatrix::from_column_slice(n, n, &run.inverse[k * n * n..(k + 1) * n * n]);
                for i in (0..n).filter(|i| held[*i]) {
                    let column = inverse.column(i).clone_owned();
                    if column[i] > 0.0 {
                        inverse -= &column * column.transpose() / column[i];
                    }
                }
                for (j, joint) in search.joints.iter().enumerate() {
                    damping[(j, j)] += model.joints[*joint].damping - drives[j].v;
                    stiffness[(j, j)] -= drives[j].q;
                }
                let middle = DMatrix::identity(n, n) * 2.0 + h * &inverse * (damping + 0.5 * h * &stiffness);
                let keeps = middle.try_inverse().unwrap_or_else(|| DMatrix::identity(n, n) * 0.5);
                let yields = h * &keeps * inverse;
                rows.push(Row { start: trajectory.starts.contains(&k), h, held, stiffness, keeps, yields });
            }
            let certain = |[q, v, deviation]: &[f64; 3]| [*q, *v, if *deviation > 0.0 { 1.0 / deviation } else { 0.0 }];
            gains.extend(run.gains.rows().iter().map(certain));
        }
        Ok(Self { rows, joints: n, errors: fit.errors.len(), gains })
    }

    /// The change of all normalised prediction errors by forces that the motion asks for more, by row and joint.
    pub fn errors_of(&self, forces: &[f64]) -> DVector<f64> {
        let n = self.joints;
        let mut errors = DVector::zeros(self.errors);
        let (mut q, mut v) = (DVector::zeros(n), DVector::<f64>::zeros(n));
        let (mut pushed, mut middle) = (DVector::zeros(n), DVector::zeros(n));
        let entries = errors.as_mut_slice().chunks_exact_mut(n).zip(self.gains.chunks_exact(n));
        for ((row, force), (errors, gains)) in self.rows.iter().zip(forces.chunks_exact(n)).zip(entries) {
            if row.start {
                q.fill(0.0);
                v.fill(0.0);
            }
            for (i, [gain_q, gain_v, certainty]) in gains.iter().enumerate() {
                let off: f64 = q[i];
                errors[i] = -off * certainty;
                q[i] -= gain_q * off;
                v[i] = if row.held[i] { 0.0 } else { v[i] - gain_v * off };
            }
            pushed.copy_from_slice(force);
            pushed.gemv(1.0, &row.stiffness, &q, 1.0);
            middle.gemv(2.0, &row.keeps, &v, 0.0);
            middle.gemv(-1.0, &row.yields, &pushed, 1.0);
            q.axpy(row.h, &middle, 1.0);
            v.axpy(2.0, &middle, -1.0);
        }
        errors
    }
}
