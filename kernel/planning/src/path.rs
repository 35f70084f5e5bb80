//! Joint paths that carry the tool along a line of goals.
//!
//! The arm (with the task's freedoms as further joints) is redundant, so each goal has a family of solutions. A layered
//! graph over the goals samples these families: at some goals inverse kinematics from many starts gives fresh solutions,
//! and each free node is followed to the next goal as it is, drawn to the middle of the joints' ranges, and disturbed at
//! random along the family, once from the first goal to the last and once back. Nodes that collide are dropped at once,
//! so that the effort goes where there is room; a layer keeps a bounded number of nodes, spread out. Dynamic programming
//! over edges that the joints can follow finds the path of least joint motion that stays away from limits and singular
//! poses. (Descartes' ladder graph, with continuation in place of even sampling.)

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
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
    /// Goals at which fresh solutions are sought, from the first to the last.
    pub anchors: usize,
    /// Inverse kinematics starts at each of them.
    pub starts: usize,
    /// Nodes that a layer keeps from each direction.
    pub nodes: usize,
    /// Greatest change of a joint from one goal to the next, rad or m.
    pub step: f64,
    /// A change of a joint from one goal to the next that costs nothing extra, rad or m.
    pub smooth_step: f64,
    /// Distance kept from joint limits, rad or m.
    pub margin: f64,
    /// Weight of a change of a freedom against that of an arm joint.
    pub freedom_weight: f64,
    /// The path need not begin near this configuration, but costs less if it does.
    pub start_near: Option<Vec<f64>>,
}

impl Default for PathOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            anchors: 4,
            starts: 20,
            nodes: 28,
            step: 0.25,
            smooth_step: 0.1,
            margin: 0.05,
            freedom_weight: 0.3,
            start_near: None,
        }
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

    let mut work = Workspace::new(first, options.margin);
    let middle: Vec<f64> = (0..n)
        .map(|i| if first.lower[i].is_finite() && first.upper[i].is_finite() { 0.5 * (first.lower[i] + first.upper[i]) } else { 0.0 })
        .collect();
    let gain: Vec<f64> = (0..n).map(|i| if i < first.arm_joints() { 0.02 } else { 0.05 }).collect();
    let preference = Preference { q: &middle, gain: &gain };
    let mut random = Pcg64::seed_from_u64(options.seed);
    let anchors = options.anchors.clamp(1, count);
    let anchor_at: Vec<usize> = (0..anchors).map(|a| if anchors == 1 { 0 } else { a * (count - 1) / (anchors - 1) }).collect();
    let inverse = InverseOptions {
        starts: 0,
        solutions: options.starts,
        margin: options.margin,
        tolerance: 1e-7,
        steps: 60,
        ..InverseOptions::default()
    };

    // Fresh solutions at the anchors; a goal that has none at all ends the search before anything is followed.
    let mut fresh: Vec<Vec<Vec<f64>>> = vec![Vec::new(); count];
    let mut unreachable: Vec<usize> = Vec::new();
    for at in &anchor_at {
        if cancelled() {
            return Err(PlanError::Cancelled { stage: stage(*at) });
        }
        let options = InverseOptions { starts: options.starts, seed: random.random(), ..inverse.clone() };
        fresh[*at] = chain(*at).inverse(&path.waypoints[*at].goal, seeds, &options);
        if fresh[*at].is_empty() {
            unreachable.push(*at);
        }
    }
    let no_solution = |at: usize, share: String| {
        let goal = path.waypoints[at].goal.translation.vector;
        PlanError::Unreachable {
            stage: stage(at),
            message: format!(
                "{share} have no solution within the joint limits, first number {} of {count} at ({:.2}, {:.2}, {:.2}) m",
                at + 1,
                goal.x,
                goal.y,
                goal.z
            ),
        }
    };
    if let Some(at) = unreachable.first() {
        return Err(no_solution(*at, format!("{} of {anchors} tool poses looked at", unreachable.len())));
    }

    let mut layers: Vec<Vec<Node>> = vec![Vec::new(); count];
    let mut tally: Vec<Tally> = vec![Tally::default(); count];
    for backward in [false, true] {
        let mut previous: Vec<Vec<f64>> = Vec::new();
        for k in 0..count {
            if cancelled() {
                return Err(PlanError::Cancelled { stage: stage(k) });
            }
            let i = if backward { count - 1 - k } else { k };
            let goal = &path.waypoints[i].goal;
            // The way back begins with all that was found at the end.
            let mut kept: Vec<Vec<f64>> = if backward && k == 0 { layers[i].iter().map(|n| n.q.clone()).collect() } else { Vec::new() };
            let mut consider = |q: Vec<f64>, spacing: f64, kept: &mut Vec<Vec<f64>>, check: &mut PathCheck| {
                if near(kept, &q, spacing) {
                    return;
                }
                if near_node(&layers[i], &q, 1e-3) {
                    kept.push(q);
                    return;
                }
                let t = &mut tally[i];
                t.tried += 1;
                match check(i, &q) {
                    Some(contact) => *t.blocked.entry(contact).or_default() += 1,
                    None => {
                        layers[i].push(Node::new(q.clone()));
                        kept.push(q);
                    }
                }
            };
            // Going on as it is comes first, so that a track is not lost to one that is only near it.
            for q0 in &previous {
                let mut q = q0.clone();
                if chain(i).solve(goal, &mut q, 14, 1e-7, None, &mut work) && joined(q0, &q, options.step) {
                    consider(q, 0.02, &mut kept, check);
                }
            }
            let fresh_here = if backward { &[][..] } else { &fresh[i][..] };
            for q in fresh_here.iter().take(options.nodes) {
                consider(q.clone(), 0.1, &mut kept, check);
            }
            for round in 0..3 {
                for q0 in &previous {
                    if kept.len() >= options.nodes {
                        break;
                    }
                    let mut q = q0.clone();
                    if round > 0 {
                        for x in &mut q {
                            *x += options.step * 0.8 * (2.0 * random.random::<f64>() - 1.0);
                        }
                    }
                    let pull = (round == 0).then_some(&preference);
                    if chain(i).solve(goal, &mut q, 14, 1e-7, pull, &mut work) && joined(q0, &q, options.step) {
                        consider(q, 0.08, &mut kept, check);
                    }
                }
            }
            if kept.is_empty() && !backward {
                // Every way is blocked or lost: look once more all round.
                let again = InverseOptions { starts: 2 * options.starts, seed: random.random(), ..inverse.clone() };
                for q in chain(i).inverse(goal, &previous, &again) {
                    consider(q, 0.1, &mut kept, check);
                }
                if kept.is_empty() {
                    let t = &mut tally[i];
                    let total = t.tried;
                    return Err(match std::mem::take(&mut t.blocked).into_iter().max_by_key(|(_, n)| *n) {
                        None => no_solution(i, "tool poses".into()),
                        Some((contact, times)) => PlanError::Collision {
                            stage: stage(i),
                            first: contact.first,
                            second: contact.second,
                            message: format!("in {times} of {total} ways to reach pose {} of {count}, and no way is free", i + 1),
                        },
                    });
                }
            }
            // A layer that is too full keeps a spread of its nodes: the first are the continuations.
            kept.truncate(2 * options.nodes);
            previous = kept;
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
                    if largest > options.step {
                        continue;
                    }
                    // Long steps cost extra: between the goals the tool then leaves the line a little.
                    let jump = (largest / options.smooth_step - 1.0).max(0.0);
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

/// What was found at one goal.
#[derive(Debug, Clone, Default)]
struct Tally {
    tried: usize,
    blocked: BTreeMap<Contact, usize>,
}

fn joined(a: &[f64], b: &[f64], step: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= step)
}

fn near(list: &[Vec<f64>], q: &[f64], tolerance: f64) -> bool {
    list.iter().any(|n| n.iter().zip(q).all(|(a, b)| (a - b).abs() < tolerance))
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
                && candidate.iter().zip(&smoothed[i]).all(|(a, b)| (a - b).abs() < options.step)
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
