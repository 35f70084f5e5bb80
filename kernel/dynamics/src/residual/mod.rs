//! The learned residual: what is left between the simulator and the world once every parameter and every named effect is
//! fitted, as a small network.
//!
//! # The equation
//! The paper (SAGCI, section "augmented differentiable simulation") adds a network's change to the analytic step:
//! `s+ = s~ + ds`, `ds = network(s, u, s~)`, with `s~ = step(s, u)` the step without it. Here the network gives a
//! **generalised force** `f`, and the step turns it into `ds`:
//!
//! `f = network(q, v, u, (w~ - v) / h)`,  `H (w - w~) = h f` on all that is free to move,  `q+ = q (+) h w`.
//!
//! So `ds = (h H^-1 h f, H^-1 h f)`, and the step is solved twice: once for `w~`, once more with `h f` on its right-hand
//! side (as the midpoint's Coriolis forces are, in the same second solve).
//!
//! Why a force, and not an increment added to the state afterwards:
//! * a door that dry friction holds stays held until the residual exceeds the friction's bound, and nothing is pushed
//!   through a limit or a contact: what holds the step holds the residual too;
//! * it has a unit (N m, N), stands beside the named effects in a report, and does not change with the step `h`;
//! * `q+` and `w` stay consistent.
//!
//! `s~` enters as `(w~ - v) / h`: with `s` it says the same as `s~` does (`q~ = q (+) h w~`), at a size that does not shrink
//! with the step.
//!
//! # The gradient
//! By the chain rule it is the sum of both models, the seed's equation: with the partials `f_q`, `f_v`, `f_u`, `f_a` of the
//! network and `B = dw/df = h H^-1`,
//!
//! `dw/ds = dw~/ds + B (f_s + f_a (dw~/ds - [0 1]) / h)` where the solution's pieces do not change between the two solves,
//! likewise for `u`, and `dw/dweights = B df/dweights`. The reverse pass ([`crate::rollout`]) takes the two solves one after
//! the other, each with its own factor.
//!
//! # Positions as inputs
//! | joint | inputs for its position |
//! |---|---|
//! | revolute, prismatic | `q` |
//! | continuous | `sin q`, `cos q` |
//! | planar | `x`, `y`, `sin`, `cos` of the angle |
//! | floating | position, and the first two columns of the rotation matrix |
//!
//! Derivatives by `q` are by its tangent (nv entries), as everywhere in this crate.

mod file;
mod network;
mod training;

pub use network::{Activation, Network, NetworkWorkspace, Normalisation};
pub use training::{Sequence, Trainer, TrainingReport};

use nalgebra::Vector3;
use sagci_model::JointKind;

use crate::error::check;
use crate::joint::{matrix, quaternion};
use crate::multibody::length;
use crate::{DynamicsError, JointInfo, Multibody, State, StepWorkspace, System};

/// A network with the joints that it reads and acts on.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    network: Network,
    /// Joints that it reads, as `part/joint`.
    reads: Vec<String>,
    /// Joints that it acts on, as `part/joint`.
    acts: Vec<String>,
    /// Hash of data, settings and seed of its training; empty before.
    training: String,
}

/// A residual with its joints looked up in one multibody.
#[derive(Debug, Clone)]
pub(crate) struct Placed {
    pub residual: Residual,
    reads: Vec<Reads>,
    /// Entries of `v` that the outputs act on.
    acts: Vec<usize>,
}

#[derive(Debug, Clone, Copy)]
struct Reads {
    kind: JointKind,
    q: usize,
    v: usize,
}

/// Everything that changes while a residual is evaluated.
#[derive(Debug, Clone)]
pub struct ResidualWorkspace {
    network: NetworkWorkspace,
    x: Vec<f64>,
    x_bar: Vec<f64>,
    y: Vec<f64>,
    y_bar: Vec<f64>,
    /// `f`, by velocity.
    pub(crate) force: Vec<f64>,
}

/// Dense partials of the force, each `nv x nv`, row-major: row the force, column what it is taken by.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ResidualJacobians {
    /// By the tangent of the positions.
    pub d_q: Vec<f64>,
    /// By the velocities, with `w~` held.
    pub d_v: Vec<f64>,
    /// By the inputs.
    pub d_u: Vec<f64>,
    /// By the next velocities `w~` of the step without it.
    pub d_next: Vec<f64>,
    /// By the weights, `nv x weights`.
    pub d_weights: Vec<f64>,
}

impl Residual {
    /// A residual that says zero until it is trained. It reads the joints `reads` (their positions, velocities, inputs, and
    /// accelerations in the step without it) and gives forces on the joints `acts`. `hidden` are the sizes of its inner
    /// layers.
    ///
    /// # Errors
    /// A joint that does not exist, or stands twice; a layer of no or too great size; nothing to act on.
    pub fn new(
        multibody: &Multibody,
        reads: &[&str],
        acts: &[&str],
        hidden: &[usize],
        activation: Activation,
        seed: u64,
    ) -> Result<Self, DynamicsError> {
        let full = |names: &[&str]| -> Result<Vec<String>, DynamicsError> {
            names.iter().map(|n| multibody.joint(n).map(|j| format!("{}/{}", j.part, j.name))).collect()
        };
        let (reads, acts) = (full(reads)?, full(acts)?);
        let joints =
            |names: &[String]| -> Result<Vec<JointInfo>, DynamicsError> { names.iter().map(|n| multibody.joint(n).cloned()).collect() };
        let inputs: usize = joints(&reads)?.iter().map(|j| features(j.kind) + 3 * j.v.len()).sum();
        let outputs: usize = joints(&acts)?.iter().map(|j| j.v.len()).sum();
        let sizes: Vec<usize> = [inputs].into_iter().chain(hidden.iter().copied()).chain([outputs]).collect();
        let residual = Self { network: Network::new(&sizes, activation, seed)?, reads, acts, training: String::new() };
        residual.place(multibody)?;
        Ok(residual)
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Replaces all weights.
    ///
    /// # Errors
    /// As [`Network::set_weights`].
    pub fn set_weights(&mut self, weights: &[f64]) -> Result<(), DynamicsError> {
        self.network.set_weights(weights)
    }

    /// Replaces the normalisation.
    ///
    /// # Errors
    /// As [`Network::set_normalisation`].
    pub fn set_normalisation(&mut self, normalisation: Normalisation) -> Result<(), DynamicsError> {
        self.network.set_normalisation(normalisation)
    }

    /// Joints that it reads, as `part/joint`.
    pub fn reads(&self) -> &[String] {
        &self.reads
    }

    /// Joints that it acts on, as `part/joint`.
    pub fn acts(&self) -> &[String] {
        &self.acts
    }

    /// Hash of the data, settings and seed that it was trained with; empty before it is trained.
    pub fn training_hash(&self) -> &str {
        &self.training
    }

    /// Looks its joints up.
    pub(crate) fn place(&self, multibody: &Multibody) -> Result<Placed, DynamicsError> {
        let twice = |names: &[String]| names.iter().enumerate().find(|(i, n)| names[..*i].contains(n)).map(|(_, n)| n.clone());
        if let Some(name) = twice(&self.reads).or_else(|| twice(&self.acts)) {
            return Err(fault(&name, "stands twice among the residual's joints; name it once"));
        }
        let (mut reads, mut acts, mut inputs) = (Vec::new(), Vec::new(), 0);
        for name in &self.reads {
            let joint = multibody.joint(name)?;
            inputs += features(joint.kind) + 3 * joint.v.len();
            reads.push(Reads { kind: joint.kind, q: joint.q.start, v: joint.v.start });
        }
        for name in &self.acts {
            acts.extend(multibody.joint(name)?.v.clone());
        }
        if (inputs, acts.len()) != (self.network.inputs(), self.network.outputs()) {
            let message = format!(
                "its network has {} inputs and {} outputs where these joints need {inputs} and {}; it was made for other joints",
                self.network.inputs(),
                self.network.outputs(),
                acts.len()
            );
            return Err(fault("residual", &message));
        }
        Ok(Placed { residual: self.clone(), reads, acts })
    }
}

impl System {
    /// The residual's force in a state (by velocity, N m or N) for the efforts `u` and the next velocities `next` of the step
    /// without it, and where it is asked for, all its partials. Zero without a residual.
    ///
    /// # Errors
    /// A vector of the wrong length or with a number that is not finite; a step that is not positive; a workspace of another
    /// system.
    #[allow(clippy::too_many_arguments)]
    pub fn residual_force(
        &self,
        ws: &mut StepWorkspace,
        state: &State,
        u: &[f64],
        next: &[f64],
        dt: f64,
        force: &mut [f64],
        jacobians: Option<&mut ResidualJacobians>,
    ) -> Result<(), DynamicsError> {
        let n = self.multibody().nv();
        self.check_state(state)?;
        check("u", u, n)?;
        check("next", next, n)?;
        length("force", force.len(), n)?;
        if !(dt > 0.0 && dt.is_finite()) {
            return Err(DynamicsError::OutOfBounds { what: "the step".into(), value: dt, must: "a positive time in s".into() });
        }
        let (Some(placed), Some(room)) = (&self.residual, &mut ws.residual) else {
            force.fill(0.0);
            return Ok(());
        };
        if room.x.len() != placed.residual.network.inputs() || room.force.len() != n {
            return Err(DynamicsError::ForeignWorkspace);
        }
        placed.force(room, &state.q, &state.v, u, next, dt);
        force.copy_from_slice(&room.force);
        if let Some(out) = jacobians {
            placed.jacobians(room, &state.q, dt, out);
        }
        Ok(())
    }
}

impl Placed {
    pub fn workspace(&self, nv: usize) -> ResidualWorkspace {
        let network = &self.residual.network;
        ResidualWorkspace {
            network: network.workspace(),
            x: vec![0.0; network.inputs()],
            x_bar: vec![0.0; network.inputs()],
            y: vec![0.0; network.outputs()],
            y_bar: vec![0.0; network.outputs()],
            force: vec![0.0; nv],
        }
    }

    /// Writes `f` to `ws.force`; `next` are the velocities `w~`.
    pub fn force(&self, ws: &mut ResidualWorkspace, q: &[f64], v: &[f64], u: &[f64], next: &[f64], dt: f64) {
        self.gather(ws, q, v, u, next, dt);
        self.residual.network.forward(&mut ws.network, &ws.x, &mut ws.y);
        ws.force.fill(0.0);
        for (y, k) in ws.y.iter().zip(&self.acts) {
            ws.force[*k] += y;
        }
    }

    /// The network's inputs.
    pub fn gather(&self, ws: &mut ResidualWorkspace, q: &[f64], v: &[f64], u: &[f64], next: &[f64], dt: f64) {
        let mut at = 0;
        for joint in &self.reads {
            let nv = joint.kind.velocities();
            at += write_features(joint.kind, &q[joint.q..], &mut ws.x[at..]);
            for k in joint.v..joint.v + nv {
                ws.x[at] = v[k];
                ws.x[at + 1] = u[k];
                ws.x[at + 2] = (next[k] - v[k]) / dt;
                at += 3;
            }
        }
    }

    /// Entries of `v` that the outputs act on.
    pub fn acts(&self) -> &[usize] {
        &self.acts
    }

    /// The inputs of the last evaluation.
    pub fn inputs<'a>(&self, ws: &'a ResidualWorkspace) -> &'a [f64] {
        &ws.x
    }

    /// Reverse mode at the last [`Self::force`]: adds what the cotangent `f_bar` of the force makes of positions (tangent),
    /// velocities, inputs, `w~` and weights.
    pub fn pull(&self, ws: &mut ResidualWorkspace, q: &[f64], dt: f64, f_bar: &[f64], bar: &mut ResidualCotangents<'_>) {
        for (y, k) in ws.y_bar.iter_mut().zip(&self.acts) {
            *y = f_bar[*k];
        }
        self.residual.network.pull(&mut ws.network, &ws.y_bar, &mut ws.x_bar, bar.weights.as_deref_mut());
        let mut at = 0;
        for joint in &self.reads {
            let nv = joint.kind.velocities();
            at += pull_features(joint.kind, &q[joint.q..], &ws.x_bar[at..], &mut bar.q[joint.v..]);
            for k in joint.v..joint.v + nv {
                let a = ws.x_bar[at + 2] / dt;
                bar.v[k] += ws.x_bar[at] - a;
                bar.u[k] += ws.x_bar[at + 1];
                bar.next[k] += a;
                at += 3;
            }
        }
    }

    /// All partials of the force at the last [`Self::force`], dense. Allocates where `out` is too small.
    pub fn jacobians(&self, ws: &mut ResidualWorkspace, q: &[f64], dt: f64, out: &mut ResidualJacobians) {
        let (n, m) = (ws.force.len(), self.residual.network.weights().len());
        for block in [&mut out.d_q, &mut out.d_v, &mut out.d_u, &mut out.d_next] {
            block.resize(n * n, 0.0);
            block.fill(0.0);
        }
        out.d_weights.resize(n * m, 0.0);
        out.d_weights.fill(0.0);
        for &k in &self.acts {
            let row = k * n..(k + 1) * n;
            ws.y_bar.fill(0.0);
            if let Some(y) = self.acts.iter().position(|a| *a == k) {
                ws.y_bar[y] = 1.0;
            }
            self.residual.network.pull(&mut ws.network, &ws.y_bar, &mut ws.x_bar, Some(&mut out.d_weights[k * m..(k + 1) * m]));
            let mut at = 0;
            for joint in &self.reads {
                at += pull_features(joint.kind, &q[joint.q..], &ws.x_bar[at..], &mut out.d_q[row.clone()][joint.v..]);
                for j in joint.v..joint.v + joint.kind.velocities() {
                    let a = ws.x_bar[at + 2] / dt;
                    out.d_v[row.start + j] += ws.x_bar[at] - a;
                    out.d_u[row.start + j] += ws.x_bar[at + 1];
                    out.d_next[row.start + j] += a;
                    at += 3;
                }
            }
        }
    }
}

/// Where [`Placed::pull`] adds to.
pub(crate) struct ResidualCotangents<'a> {
    pub q: &'a mut [f64],
    pub v: &'a mut [f64],
    pub u: &'a mut [f64],
    pub next: &'a mut [f64],
    pub weights: Option<&'a mut [f64]>,
}

fn fault(place: &str, message: &str) -> DynamicsError {
    DynamicsError::Build { part: "residual".into(), place: place.into(), message: message.into() }
}

/// Number of inputs for a joint's position.
fn features(kind: JointKind) -> usize {
    match kind {
        JointKind::Fixed => 0,
        JointKind::Revolute | JointKind::Prismatic => 1,
        JointKind::Continuous => 2,
        JointKind::Planar => 4,
        JointKind::Floating => 9,
    }
}

fn write_features(kind: JointKind, q: &[f64], x: &mut [f64]) -> usize {
    match kind {
        JointKind::Fixed => {}
        JointKind::Revolute | JointKind::Prismatic => x[0] = q[0],
        JointKind::Continuous => (x[0], x[1]) = q[0].sin_cos(),
        JointKind::Planar => {
            (x[0], x[1]) = (q[0], q[1]);
            (x[2], x[3]) = q[2].sin_cos();
        }
        JointKind::Floating => {
            let R = matrix(&quaternion(q));
            x[..3].copy_from_slice(&q[4..7]);
            x[3..9].copy_from_slice(&R.as_slice()[..6]);
        }
    }
    features(kind)
}

/// Adds the cotangent of a joint's tangent that belongs to the cotangent `x` of its inputs.
fn pull_features(kind: JointKind, q: &[f64], x: &[f64], bar: &mut [f64]) -> usize {
    match kind {
        JointKind::Fixed => {}
        JointKind::Revolute | JointKind::Prismatic => bar[0] += x[0],
        JointKind::Continuous => {
            let (sin, cos) = q[0].sin_cos();
            bar[0] += x[0] * cos - x[1] * sin;
        }
        JointKind::Planar => {
            let (sin, cos) = q[2].sin_cos();
            // The tangent slides along the child's axes: dx = R(angle) dv.
            bar[0] += cos * x[0] + sin * x[1];
            bar[1] += -sin * x[0] + cos * x[1];
            bar[2] += x[2] * cos - x[3] * sin;
        }
        JointKind::Floating => {
            let R = matrix(&quaternion(q));
            // dp = R dv, d(R e_k) = R (omega x e_k).
            let slide = R.transpose() * Vector3::new(x[0], x[1], x[2]);
            let (first, second) = (R.transpose() * Vector3::new(x[3], x[4], x[5]), R.transpose() * Vector3::new(x[6], x[7], x[8]));
            let turn = Vector3::x().cross(&first) + Vector3::y().cross(&second);
            for k in 0..3 {
                bar[k] += turn[k];
                bar[3 + k] += slide[k];
            }
        }
    }
    features(kind)
}
