//! Joint paths that carry the tool along a line of goals.
//!
//! The arm (with the task's freedoms as further joints) is redundant, so each goal has a family of solutions. Nodes of a
//! layered graph are found by continuation: inverse kinematics from many starts at a few goals, each solution then
//! followed to both ends of the line with a pull toward the middle of the joints' ranges. Nodes that collide are
//! dropped; an edge joins nodes of neighbouring layers that the joints' speed limits allow; dynamic programming finds the
//! path of least joint motion that also stays away from limits and singular poses. (Descartes' ladder graph, with
//! continuation in place of even sampling: tracks are continuous by construction, and cross edges let them switch.)

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::inverse::{InverseOptions, Preference, Workspace};
use crate::{ArmKinematics, Contact, PlanError};

/// One goal on the line.
#[derive(Debug, Clone)]
pub struct Waypoint {
    /// Pose that the chain's end must take, in the world.
    pub goal: Isometry3<f64>,
    /// Which of the chains.
    pub chain: usize,
    /// Which of the stages, for messages and checks.
    pub stage: usize,
}

/// A line of goals. All chains have the same joints; they differ in where the goal frame sits on the tool.
#[derive(Debug, Clone)]
pub struct ToolPath {
    /// The arm with the task's freedoms, once for each goal frame.
    pub chains: Vec<ArmKinematics>,
    /// The goals in order.
    pub waypoints: Vec<Waypoint>,
    /// Names of the stages.
    pub stages: Vec<String>,
}

/// How [`arm_path`] searches.
#[derive(Debug, Clone)]
pub struct PathOptions {
    /// Seed of the random starts.
    pub seed: u64,
    /// Goals from which tracks start.
    pub anchors: usize,
    /// Inverse kinematics starts at each of them.
    pub starts: usize,
    /// Greatest change of a joint from one goal to the next on a track, rad or m.
    pub track_step: f64,
    /// The same where the path changes from one track to another.
    pub cross_step: f64,
    /// Distance kept from joint limits, rad or m.
    pub margin: f64,
    /// Weight of a change of a freedom against that of an arm joint.
    pub freedom_weight: f64,
    /// The path need not begin near this configuration, but costs less if it does.
    pub start_near: Option<Vec<f64>>,
}

impl Default for PathOptions {
    fn default() -> Self {
        Self { seed: 0, anchors: 4, starts: 14, track_step: 0.25, cross_step: 0.1, margin: 0.05, freedom_weight: 0.3, start_near: None }
    }
}

/// A joint path along a line of goals.
#[derive(Debug, Clone)]
pub struct ArmPath {
    /// Positions of the arm's joints at each goal.
    pub q: Vec<Vec<f64>>,
    /// Values of the freedoms at each goal.
    pub freedom: Vec<Vec<f64>>,
    /// Its cost: joint motion and nearness to limits and singular poses, dimensionless.
    pub cost: f64,
    /// Least manipulability along it.
    pub manipulability: f64,
}

/// What the collision check is asked: number of the goal, and the arm's and freedoms' positions.
pub type PathCheck<'a> = dyn FnMut(usize, &[f64]) -> Option<Contact> + 'a;

/// Finds a joint path along `path` that `check` finds free at every goal.
///
/// # Errors
/// [`PlanError::Unreachable`] says how many goals have no solution, and the first; [`PlanError::Collision`] says at which
/// stage every solution touches something, and what; [`PlanError::Cancelled`].
pub fn arm_path(
    path: &ToolPath,
    seeds: &[Vec<f64>],
    check: &mut PathCheck,
    options: &PathOptions,
    cancelled: &dyn Fn() -> bool,
) -> Result<ArmPath, PlanError> {
    let count = path.waypoints.len();
    let stage = |i: usize| path.waypoints.get(i).and_then(|w| path.stages.get(w.stage)).cloned().unwrap_or_else(|| "path".into());
    let (Some(first), true) = (path.chains.first(), count > 0) else {
        return Err(PlanError::BadInput { message: "a tool path without goals or chains".into() });
    };
    let n = first.joints();
    let chain = |i: usize| &path.chains[path.waypoints[i].chain.min(path.chains.len() - 1)];

    let mut layers: Vec<Vec<Node>> = vec![Vec::new(); count];
    let mut work = Workspace::new(first, options.margin);
    let middle: Vec<f64> = (0..n)
        .map(|i| if first.lower[i].is_finite() && first.upper[i].is_finite() { 0.5 * (first.lower[i] + first.upper[i]) } else { 0.0 })
        .collect();
    let gain: Vec<f64> = (0..n).map(|i| if i < first.arm_joints() { 0.02 } else { 0.05 }).collect();
    let preference = Preference { q: &middle, gain: &gain };
    let mut random = Pcg64::seed_from_u64(options.seed);
    let anchors = options.anchors.clamp(1, count);
    let mut unreachable: Vec<usize> = Vec::new();
    for a in 0..anchors {
        if cancelled() {
            return Err(PlanError::Cancelled { stage: stage(0) });
        }
        let at = if anchors == 1 { 0 } else { a * (count - 1) / (anchors - 1) };
        let mut starts: Vec<Vec<f64>> = seeds.to_vec();
        // Solutions that are already tracked here are good starts: they cost one step.
        for _ in 0..options.starts {
            let mut q = vec![0.0; n];
            first.random_configuration(&mut random, &work.lower, &work.upper, &mut q);
            starts.push(q);
        }
        let inverse =
            InverseOptions { starts: 0, solutions: options.starts, margin: options.margin, tolerance: 1e-7, ..InverseOptions::default() };
        let mut solutions = chain(at).inverse(&path.waypoints[at].goal, &starts, &inverse);
        if solutions.is_empty() {
            let more = InverseOptions { starts: 40, solutions: 2, seed: options.seed ^ 0x9e37, ..inverse };
            solutions = chain(at).inverse(&path.waypoints[at].goal, &[], &more);
        }
        if solutions.is_empty() {
            unreachable.push(at);
        }
        for solution in solutions {
            if near_node(&layers[at], &solution, 0.03) {
                continue;
            }
            layers[at].push(Node::new(solution.clone()));
            for (backward, pulled) in [(false, false), (true, false), (false, true), (true, true)] {
                let mut q = solution.clone();
                let mut i = at;
                loop {
                    let next = if backward { i.wrapping_sub(1) } else { i + 1 };
                    if next >= count {
                        break;
                    }
                    let before = q.clone();
                    if !chain(next).solve(&path.waypoints[next].goal, &mut q, 14, 1e-7, pulled.then_some(&preference), &mut work)
                        || q.iter().zip(&before).any(|(a, b)| (a - b).abs() > options.track_step)
                    {
                        break;
                    }
                    // A track that runs into another one goes on as that one.
                    if near_node(&layers[next], &q, 0.01) {
                        break;
                    }
                    layers[next].push(Node::new(q.clone()));
                    i = next;
                }
            }
        }
    }
    let empty: Vec<usize> = (0..count).filter(|i| layers[*i].is_empty()).collect();
    if let Some(at) = empty.first() {
        let goal = path.waypoints[*at].goal.translation.vector;
        return Err(PlanError::Unreachable {
            stage: stage(*at),
            message: format!(
                "{} of {count} tool poses have no solution within the joint limits, first number {} at ({:.2}, {:.2}, {:.2}) m",
                empty.len(),
                at + 1,
                goal.x,
                goal.y,
                goal.z
            ),
        });
    }

    // Collisions: what blocks each layer is counted, for the message.
    for i in 0..count {
        if cancelled() {
            return Err(PlanError::Cancelled { stage: stage(i) });
        }
        let mut blocked: BTreeMap<Contact, usize> = BTreeMap::new();
        let total = layers[i].len();
        layers[i].retain(|node| match check(i, &node.q) {
            None => true,
            Some(contact) => {
                *blocked.entry(contact).or_default() += 1;
                false
            }
        });
        if layers[i].is_empty() {
            let (contact, times) =
                blocked.into_iter().max_by_key(|(_, n)| *n).unwrap_or((Contact { first: "arm".into(), second: "something".into() }, 0));
            return Err(PlanError::Collision {
                stage: stage(i),
                first: contact.first,
                second: contact.second,
                message: format!("in {times} of {total} ways to reach pose {} of {count}, and no way is free", i + 1),
            });
        }
    }

    // Dynamic programming over the layers.
    let scale = count.max(2) as f64 - 1.0;
    let weight: Vec<f64> = (0..n).map(|j| if j < first.arm_joints() { 1.0 } else { options.freedom_weight }).collect();
    for i in 0..count {
        for k in 0..layers[i].len() {
            let node_cost = {
                let node = &mut layers[i][k];
                node.manipulability = chain(i).manipulability(&node.q);
                (limit_cost(first, &node.q) + 0.02 / (node.manipulability + 0.01)) / count as f64
            };
            let mut best = (f64::INFINITY, usize::MAX);
            if i == 0 {
                let q = &layers[0][k].q;
                let near = options.start_near.as_ref().map_or(0.0, |s| s.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>());
                best = (0.1 * near, usize::MAX);
            } else {
                for (p, previous) in layers[i - 1].iter().enumerate().filter(|(_, p)| p.cost.is_finite()) {
                    let mut motion = 0.0;
                    let mut largest = 0.0_f64;
                    for (j, w) in weight.iter().enumerate() {
                        let d = layers[i][k].q[j] - previous.q[j];
                        motion += w * d * d;
                        largest = largest.max(d.abs());
                    }
                    if largest > options.track_step {
                        continue;
                    }
                    // Changing tracks costs extra: between the goals the tool then leaves the line a little.
                    let jump = (largest / options.cross_step - 1.0).max(0.0);
                    let cost = previous.cost + scale * motion + 4.0 * jump * jump;
                    if cost < best.0 {
                        best = (cost, p);
                    }
                }
            }
            let node = &mut layers[i][k];
            node.cost = best.0 + node_cost;
            node.previous = best.1;
        }
        if layers[i].iter().all(|n| !n.cost.is_finite()) {
            return Err(PlanError::Unreachable {
                stage: stage(i),
                message: format!(
                    "the ways to reach pose {} of {count} cannot be joined to those before it without a jump of a joint or a collision",
                    i + 1
                ),
            });
        }
    }
    let mut at = (0..layers[count - 1].len()).min_by(|a, b| layers[count - 1][*a].cost.total_cmp(&layers[count - 1][*b].cost)).unwrap_or(0);
    let cost = layers[count - 1][at].cost;
    let mut q = vec![Vec::new(); count];
    for i in (0..count).rev() {
        q[i] = layers[i][at].q.clone();
        at = layers[i][at].previous;
    }
    smooth(path, &mut q, check, options, &mut work);
    let manipulability = (0..count).map(|i| chain(i).manipulability(&q[i])).fold(f64::INFINITY, f64::min);
    let arm = first.arm_joints();
    Ok(ArmPath {
        freedom: q.iter().map(|q| q[arm..].to_vec()).collect(),
        q: q.into_iter()
            .map(|mut q| {
                q.truncate(arm);
                q
            })
            .collect(),
        cost,
        manipulability,
    })
}

#[derive(Debug, Clone)]
struct Node {
    q: Vec<f64>,
    cost: f64,
    previous: usize,
    manipulability: f64,
}

impl Node {
    fn new(q: Vec<f64>) -> Self {
        Self { q, cost: f64::INFINITY, previous: usize::MAX, manipulability: 0.0 }
    }
}

fn near_node(layer: &[Node], q: &[f64], tolerance: f64) -> bool {
    layer.iter().any(|n| n.q.iter().zip(q).all(|(a, b)| (a - b).abs() < tolerance))
}

/// Small in the middle of a joint's range, 1 at its end.
fn limit_cost(arm: &ArmKinematics, q: &[f64]) -> f64 {
    (0..arm.arm_joints())
        .filter(|i| arm.lower[*i].is_finite() && arm.upper[*i].is_finite())
        .map(|i| {
            let x = (2.0 * q[i] - arm.lower[i] - arm.upper[i]) / (arm.upper[i] - arm.lower[i]);
            x.powi(8)
        })
        .sum()
}

/// Draws each configuration toward the middle of its neighbours along the null space: what the choice of tracks left of
/// kinks goes away. Kept only where it stays free.
fn smooth(path: &ToolPath, q: &mut [Vec<f64>], check: &mut PathCheck, options: &PathOptions, work: &mut Workspace) {
    let count = q.len();
    let mut smoothed = q.to_vec();
    for sweep in 0..8 {
        for k in 1..count.saturating_sub(1) {
            let i = if sweep % 2 == 0 { k } else { count - 1 - k };
            let mut candidate: Vec<f64> = (0..smoothed[i].len()).map(|j| 0.5 * (smoothed[i - 1][j] + smoothed[i + 1][j])).collect();
            let chain = &path.chains[path.waypoints[i].chain.min(path.chains.len() - 1)];
            if chain.solve(&path.waypoints[i].goal, &mut candidate, 10, 1e-8, None, work)
                && candidate.iter().zip(&smoothed[i]).all(|(a, b)| (a - b).abs() < options.track_step)
            {
                smoothed[i] = candidate;
            }
        }
    }
    // Ends are refined in place: they came with the tracks' tolerance.
    for i in [0, count - 1] {
        let chain = &path.chains[path.waypoints[i].chain.min(path.chains.len() - 1)];
        let mut candidate = smoothed[i].clone();
        if chain.solve(&path.waypoints[i].goal, &mut candidate, 10, 1e-9, None, work) {
            smoothed[i] = candidate;
        }
    }
    let free = (0..count).all(|i| check(i, &smoothed[i]).is_none());
    if free {
        q.clone_from_slice(&smoothed);
    }
}

/// Poses from one to another: shift and turn in even steps, at most `step` metres and `turn` radians each. Both ends are
/// among them.
pub fn straight_line(from: &Isometry3<f64>, to: &Isometry3<f64>, step: f64, turn: f64) -> Vec<Isometry3<f64>> {
    let shift = to.translation.vector - from.translation.vector;
    let rotation = (to.rotation * from.rotation.inverse()).scaled_axis();
    let n = (shift.norm() / step.max(1e-6)).max(rotation.norm() / turn.max(1e-6)).ceil().clamp(1.0, 10_000.0) as usize;
    (0..=n)
        .map(|k| {
            let f = k as f64 / n as f64;
            Isometry3::from_parts(
                (from.translation.vector + shift * f).into(),
                nalgebra::UnitQuaternion::from_scaled_axis(rotation * f) * from.rotation,
            )
        })
        .collect()
}
