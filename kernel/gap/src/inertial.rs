//! Derivatives of prediction errors by the model's own known numbers, in the linear response: without a run of the simulator for each.
//!
//! Along a run of the model, another mass is a force that the motion asks for more:
//!
//! ```text
//! dtau_k = ID(q_k, v_k, a_k; theta + d) - ID(q_k, v_k, a_k; theta),   damping: d v_k,   dry friction: d sgn(v_k)
//! ```
//!
//! with `ID` inverse dynamics (Featherstone 2008, chapter 5), and [`Tangent`] says what a force does to the errors. Fits begin with
//! these and set them right as they go.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::GapError;
use crate::fit::Fit;
use crate::hypothesis::{Fitted, Knob};
use crate::observer::Run;
use crate::plant::Plant;
use crate::response::Response;
use crate::search::Search;
use crate::tangent::Tangent;

/// Velocity and acceleration on the way from each row to the next, by row and joint; zeros where a stretch ends.
pub(crate) struct Along {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
}

impl Along {
    fn new(search: &Search<'_>, runs: &[Run]) -> Self {
        let mut this = Self { q: Vec::new(), v: Vec::new(), a: Vec::new() };
        for (trajectory, run) in search.problem.trajectories.iter().zip(runs) {
            let n = trajectory.joints;
            for k in 0..trajectory.rows() {
                let last = k + 1 == trajectory.rows() || trajectory.starts.contains(&(k + 1));
                for i in k * n..(k + 1) * n {
                    let h = if last { 0.0 } else { trajectory.time[k + 1] - trajectory.time[k] };
                    let next = if last { run.v[i] } else { run.v_predicted[i + n] };
                    this.q.push(run.q[i] + 0.25 * h * (run.v[i] + next));
                    this.v.push(0.5 * (run.v[i] + next));
                    this.a.push(if h > 0.0 { (next - run.v[i]) / h } else { 0.0 });
                }
            }
        }
        this
    }

    /// Efforts that the motion asks of a plant's bodies, by row and joint.
    fn efforts(&self, plant: &Plant, joints: usize) -> Result<Vec<f64>, GapError> {
        let multibody = plant.system.multibody();
        let mut ws = multibody.workspace();
        let mut all = vec![0.0; self.q.len()];
        for (k, tau) in all.chunks_exact_mut(joints).enumerate() {
            let row = k * joints..(k + 1) * joints;
            multibody.set_state(&mut ws, &self.q[row.clone()], &self.v[row.clone()])?;
            multibody.inverse_dynamics(&mut ws, &self.a[row], &[], tau)?;
        }
        Ok(all)
    }

    /// Derivatives of these efforts by positions and by velocities, row by row, by differences to both sides.
    pub fn slopes(&self, plant: &Plant, joints: usize, difference: f64) -> Result<Vec<[DMatrix<f64>; 2]>, GapError> {
        let multibody = plant.system.multibody();
        let n = joints;
        let of = |row: usize| -> Result<[DMatrix<f64>; 2], GapError> {
            let mut ws = multibody.workspace();
            let at = row * n..(row + 1) * n;
            let (mut q, mut v) = (self.q[at.clone()].to_vec(), self.v[at.clone()].to_vec());
            let mut slopes = [DMatrix::zeros(n, n), DMatrix::zeros(n, n)];
            let mut side = [vec![0.0; n], vec![0.0; n]];
            for j in 0..n {
                for (by, slope) in slopes.iter_mut().enumerate() {
                    for (sign, tau) in [1.0, -1.0].into_iter().zip(&mut side) {
                        let moved = if by == 0 { &mut q } else { &mut v };
                        let here = moved[j];
                        moved[j] = here + sign * difference;
                        multibody.set_state(&mut ws, &q, &v)?;
                        multibody.inverse_dynamics(&mut ws, &self.a[at.clone()], &[], tau)?;
                        if by == 0 { q[j] = here } else { v[j] = here }
                    }
                    for i in 0..n {
                        slope[(i, j)] = (side[0][i] - side[1][i]) / (2.0 * difference);
                    }
                }
            }
            Ok(slopes)
        };
        (0..self.q.len() / n.max(1)).into_par_iter().map(of).collect()
    }
}

impl Search<'_> {
    /// Derivatives of a fit's errors by its known numbers; those that no force stands for by runs.
    /// Few joints move each other little within what the filter remembers, and fits take theirs from runs soon.
    pub fn derivatives_by_known(&self, fit: &Fit) -> Result<Vec<DVector<f64>>, GapError> {
        self.derivatives_by_response(fit, self.many_joints())
    }

    /// The same, what one joint does to another with them or not.
    pub fn derivatives_by_response(&self, fit: &Fit, together: bool) -> Result<Vec<DVector<f64>>, GapError> {
        let (n, hypothesis) = (self.names.len(), &fit.hypothesis);
        let runs = self.runs(fit)?;
        let along = Along::new(self, &runs);
        let bare = Fit { jacobian: Vec::new(), ..fit.clone() };
        let tangent = together.then(|| Tangent::new(self, fit, &runs, &along)).transpose()?;
        let apart: Vec<Response> = (0..if together { 0 } else { n }).map(|j| Response::new(self, &bare, &runs, j)).collect();
        let errors_of = |forces: &[f64]| match &tangent {
            Some(tangent) => tangent.errors_of(forces),
            None => {
                apart.iter().enumerate().map(|(j, r)| r.errors_of(&forces.iter().skip(j).step_by(n).copied().collect::<Vec<_>>())).sum()
            }
        };
        let plant = |x: &[f64]| hypothesis.plant(x, &self.problem.limits, self.problem.step);
        let asked = along.efforts(&plant(&hypothesis.x)?, n)?;
        let model = hypothesis.model_at(&hypothesis.x);
        let slot = |joint: &usize| self.joints.iter().position(|j| j == joint);
        // By a number's logarithm it is the number itself.
        let by = |fitted: &Fitted, value: f64| if fitted.logarithmic { value } else { 1.0 };
        let resisting = |slot: Option<usize>, of: &dyn Fn(f64) -> f64| -> Vec<f64> {
            along.v.iter().enumerate().map(|(i, v)| if Some(i % n) == slot { of(*v) } else { 0.0 }).collect()
        };
        let column = |p: usize| -> Result<DVector<f64>, GapError> {
            let fitted = &hypothesis.fitted[p];
            let forces = match &fitted.knob {
                Knob::Damping(joint) => resisting(slot(joint), &|v| by(fitted, model.joints[*joint].damping) * v),
                Knob::Friction(joint) => {
                    resisting(slot(joint), &|v| if v == 0.0 { 0.0 } else { by(fitted, model.joints[*joint].friction) * v.signum() })
                }
                Knob::Mass(_) | Knob::CenterOfMass(..) | Knob::Inertia(_) => {
                    let mut moved = hypothesis.x.clone();
                    moved[p] += fitted.difference;
                    let more = along.efforts(&plant(&moved)?, n)?;
                    more.iter().zip(&asked).map(|(m, a)| (m - a) / fitted.difference).collect()
                }
                Knob::Actuator(..) | Knob::Effect(..) | Knob::Times(..) | Knob::Turn(..) => {
                    return Ok(self.problem.jacobian(hypothesis, &hypothesis.x, &fit.errors, &[p])?.swap_remove(0));
                }
            };
            Ok(errors_of(&forces))
        };
        (0..hypothesis.known).into_par_iter().map(column).collect()
    }
}
