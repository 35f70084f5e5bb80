//! Collision-free motion between configurations.
//!
//! The straight line first; then RRT-Connect (Kuffner and LaValle 2000) from the start's tree to the trees of all
//! goals; then shortcuts, and an elastic band that rounds the corners while it stays free. Bounded by counts of steps,
//! never by the clock, so that the same seed gives the same path.
//!
//! A line in joint space is checked at steps in which no point of the arm moves further than
//! [`FreeMotionOptions::step`]: the change of each joint is weighted with the length of what it can swing.

use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::{ArmKinematics, CollisionWorld, PlanError};

/// How [`free_motion`] searches.
#[derive(Debug, Clone)]
pub struct FreeMotionOptions {
    /// Seed of the samples.
    pub seed: u64,
    /// Greatest way of any point of the arm between two checks, m.
    pub step: f64,
    /// Samples that the trees may draw.
    pub samples: usize,
    /// Attempts to shorten the path.
    pub shortcuts: usize,
    /// Distance kept from joint limits, rad or m; less where start or goal are nearer.
    pub margin: f64,
    /// Name of the stage, for messages.
    pub stage: String,
}

impl Default for FreeMotionOptions {
    fn default() -> Self {
        Self { seed: 0, step: 0.02, samples: 4000, shortcuts: 120, margin: 0.02, stage: "reach".into() }
    }
}

/// A free path.
#[derive(Debug, Clone)]
pub struct FreePath {
    /// Configurations, densely enough that the polyline between them is the checked path. The first is the start.
    pub q: Vec<Vec<f64>>,
    /// Index of the goal that it leads to.
    pub goal: usize,
}

/// Length of everything that each joint can swing, m: an upper bound of the distance from its axis to any point of the
/// arm and hand beyond it.
fn swings(arm: &ArmKinematics) -> Vec<f64> {
    let n = arm.arm_joints();
    let mut length = arm.X_ET.translation.vector.norm() + 0.1;
    let mut out = vec![0.0; n];
    for i in (0..n).rev() {
        let segment = &arm.segments[i];
        if segment.slides {
            out[i] = 1.0;
            length += arm.upper[i].abs().max(arm.lower[i].abs()).min(2.0);
        } else {
            out[i] = length;
        }
        length += segment.X_PJ.translation.vector.norm();
    }
    out
}

struct Checker<'a> {
    world: &'a CollisionWorld,
    width: f64,
    swing: Vec<f64>,
    step: f64,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Checker<'_> {
    fn length(&self, a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).zip(&self.swing).map(|((a, b), w)| w * (a - b).abs()).sum()
    }

    fn free(&self, q: &[f64]) -> bool {
        q.iter().zip(&self.lower).zip(&self.upper).all(|((q, l), u)| *q >= *l && *q <= *u) && self.world.free(q, self.width)
    }

    /// Is the line free, its end included and its start not? Middles first: collisions show early.
    fn line_free(&self, a: &[f64], b: &[f64]) -> bool {
        let n = (self.length(a, b) / self.step).ceil().max(1.0) as usize;
        let mut at = vec![0.0; a.len()];
        let mut stride = n.next_power_of_two();
        if !self.free(b) {
            return false;
        }
        while stride >= 1 {
            let mut k = stride;
            while k < n {
                // Multiples of twice the stride were checked before.
                if stride == n.next_power_of_two() || !k.is_multiple_of(2 * stride) {
                    interpolate(a, b, k as f64 / n as f64, &mut at);
                    if !self.free(&at) {
                        return false;
                    }
                }
                k += stride;
            }
            stride /= 2;
        }
        true
    }
}

fn interpolate(a: &[f64], b: &[f64], f: f64, out: &mut [f64]) {
    for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
        // The end is met to the last bit.
        *o = if f == 1.0 { *b } else { a + f * (b - a) };
    }
}

#[derive(Default)]
struct Tree {
    q: Vec<Vec<f64>>,
    parent: Vec<usize>,
    /// Goal that a root stands for.
    root: Vec<usize>,
}

impl Tree {
    fn add(&mut self, q: Vec<f64>, parent: usize, root: usize) -> usize {
        self.q.push(q);
        self.parent.push(parent);
        self.root.push(root);
        self.q.len() - 1
    }

    fn nearest(&self, checker: &Checker, q: &[f64]) -> usize {
        let mut best = (f64::INFINITY, 0);
        for (i, node) in self.q.iter().enumerate() {
            let d = checker.length(node, q);
            if d < best.0 {
                best = (d, i);
            }
        }
        best.1
    }

    fn to_root(&self, mut i: usize) -> Vec<Vec<f64>> {
        let mut out = vec![self.q[i].clone()];
        while self.parent[i] != usize::MAX {
            i = self.parent[i];
            out.push(self.q[i].clone());
        }
        out
    }
}

/// Finds a free path from `q_start` to the first of the goals that it can reach, with the gripper open by `width`.
///
/// Where start or goal are nearer to something than the world's padding, as after letting go of a handle, the padding is
/// lowered for this motion to what they keep themselves.
///
/// # Errors
/// [`PlanError::Collision`] names what the start or every goal touches, [`PlanError::Unreachable`] if goals lie beyond the
/// joint limits or there are none, [`PlanError::NoConvergence`] if the samples are used up, [`PlanError::Cancelled`].
pub fn free_motion(
    world: &CollisionWorld,
    q_start: &[f64],
    goals: &[Vec<f64>],
    width: f64,
    options: &FreeMotionOptions,
    cancelled: &dyn Fn() -> bool,
) -> Result<FreePath, PlanError> {
    let arm = world.arm();
    let n = arm.arm_joints();
    let stage = || options.stage.clone();
    if q_start.len() != n || goals.iter().any(|g| g.len() != n) || q_start.iter().chain(goals.iter().flatten()).any(|x| !x.is_finite()) {
        return Err(PlanError::BadInput { message: format!("{}: a configuration must have {n} finite joint positions", options.stage) });
    }
    if goals.is_empty() {
        return Err(PlanError::Unreachable { stage: stage(), message: "no goal configuration is known".into() });
    }
    // The greatest padding that the start and at least one goal keep.
    let mut world = world.clone();
    let paddings = [1.0, 0.5, 0.2, 0.0];
    let (full, full_close, full_self) = (world.padding, world.close_padding, world.self_padding);
    let set = |world: &mut CollisionWorld, f: f64| {
        world.padding = f * full;
        world.close_padding = f * full_close;
        world.self_padding = f * full_self;
    };
    let mut chosen = None;
    for f in paddings {
        set(&mut world, f);
        if world.free(q_start, width) && goals.iter().any(|g| world.free(g, width)) {
            chosen = Some(f);
            break;
        }
    }
    if chosen.is_none() {
        let (q, what, at_start) = match world.check(q_start, width) {
            Some(c) => (q_start, c, true),
            None => match goals.iter().find_map(|g| world.check(g, width).map(|c| (g, c))) {
                Some((g, c)) => (g.as_slice(), c, false),
                None => (q_start, crate::Contact { first: "arm".into(), second: "something".into() }, false),
            },
        };
        let tool = arm.X_WT(q).translation.vector;
        return Err(PlanError::Collision {
            stage: stage(),
            first: what.first,
            second: what.second,
            message: format!(
                "{} is not free, tool at ({:.2}, {:.2}, {:.2}) m",
                if at_start { "the start".to_owned() } else { format!("none of {} goals", goals.len()) },
                tool.x,
                tool.y,
                tool.z
            ),
        });
    }
    let bound = |i: usize, low: bool| {
        let (l, u) = (arm.lower[i], arm.upper[i]);
        let m = options.margin.min(0.25 * (u - l));
        let near = goals.iter().map(|g| g[i]).chain([q_start[i]]);
        // Start and goals count as within reach, up to a hair beyond the limit.
        if low {
            (l + m).min(near.fold(f64::INFINITY, f64::min)).max(l - 1e-6)
        } else {
            (u - m).max(near.fold(f64::NEG_INFINITY, f64::max)).min(u + 1e-6)
        }
    };
    let checker = Checker {
        world: &world,
        width,
        swing: swings(arm),
        step: options.step,
        lower: (0..n).map(|i| bound(i, true)).collect(),
        upper: (0..n).map(|i| bound(i, false)).collect(),
    };
    let open: Vec<usize> = (0..goals.len()).filter(|g| checker.free(&goals[*g])).collect();
    if open.is_empty() {
        return Err(PlanError::Unreachable { stage: stage(), message: format!("all {} goals lie beyond the joint limits", goals.len()) });
    }
    // Straight lines, shortest first.
    let mut by_length = open.clone();
    by_length.sort_by(|a, b| checker.length(q_start, &goals[*a]).total_cmp(&checker.length(q_start, &goals[*b])));
    for goal in &by_length {
        if checker.line_free(q_start, &goals[*goal]) {
            return Ok(FreePath { q: densify(&checker, &[q_start.to_vec(), goals[*goal].clone()]), goal: *goal });
        }
    }

    let mut random = Pcg64::seed_from_u64(options.seed);
    let (mut from, mut to) = (Tree::default(), Tree::default());
    from.add(q_start.to_vec(), usize::MAX, 0);
    for g in &by_length {
        to.add(goals[*g].clone(), usize::MAX, *g);
    }
    let mut sample = vec![0.0; n];
    let mut forward = true;
    for round in 0..options.samples {
        if round % 16 == 0 && cancelled() {
            return Err(PlanError::Cancelled { stage: stage() });
        }
        for (i, s) in sample.iter_mut().enumerate() {
            let (l, u) = crate::inverse::finite_range(checker.lower[i], checker.upper[i]);
            *s = l + (u - l) * random.random::<f64>();
        }
        let (a, b) = if forward { (&mut from, &mut to) } else { (&mut to, &mut from) };
        forward = !forward;
        let Some(reached) = extend(&checker, a, &sample, false) else { continue };
        let target = a.q[reached].clone();
        let Some(met) = extend(&checker, b, &target, true) else { continue };
        if checker.length(&b.q[met], &target) > 1e-9 {
            continue;
        }
        // `forward` was flipped: it now says which tree was extended second.
        let (f, t) = if forward { (met, reached) } else { (reached, met) };
        let mut line = from.to_root(f);
        line.reverse();
        line.extend(to.to_root(t).into_iter().skip(1));
        let goal = to.root[t];
        shorten(&checker, &mut line, options.shortcuts, &mut random);
        let q = band(&checker, line);
        return Ok(FreePath { q, goal });
    }
    Err(PlanError::NoConvergence {
        stage: stage(),
        message: format!(
            "no free path found with {} samples; start and goal are free, but the way between them is narrow or shut",
            options.samples
        ),
    })
}

/// Grows a tree toward a configuration: by one stride, or as far as it is free. The new node, if any.
fn extend(checker: &Checker, tree: &mut Tree, toward: &[f64], whole_way: bool) -> Option<usize> {
    const STRIDE: f64 = 0.35;
    let mut at = tree.nearest(checker, toward);
    let mut added = None;
    for _ in 0..64 {
        let length = checker.length(&tree.q[at], toward);
        if length < 1e-12 {
            return Some(at);
        }
        let f = (STRIDE / length).min(1.0);
        let mut q = vec![0.0; toward.len()];
        interpolate(&tree.q[at], toward, f, &mut q);
        if !checker.line_free(&tree.q[at], &q) {
            break;
        }
        let root = tree.root[at];
        at = tree.add(q, at, root);
        added = Some(at);
        if f >= 1.0 || !whole_way {
            break;
        }
    }
    added
}

/// Points along a polyline at even spacing.
fn densify(checker: &Checker, line: &[Vec<f64>]) -> Vec<Vec<f64>> {
    const SPACING: f64 = 0.06;
    let mut out = vec![line[0].clone()];
    for pair in line.windows(2) {
        let n = (checker.length(&pair[0], &pair[1]) / SPACING).ceil().max(1.0) as usize;
        for k in 1..=n {
            let mut q = vec![0.0; pair[0].len()];
            interpolate(&pair[0], &pair[1], k as f64 / n as f64, &mut q);
            out.push(q);
        }
    }
    out
}

fn shorten(checker: &Checker, line: &mut Vec<Vec<f64>>, attempts: usize, random: &mut Pcg64) {
    for _ in 0..attempts {
        if line.len() < 3 {
            return;
        }
        // Two random places along the polyline, on different pieces.
        let lengths: Vec<f64> = line.windows(2).map(|p| checker.length(&p[0], &p[1])).collect();
        let total: f64 = lengths.iter().sum();
        let place = |mut s: f64| {
            for (i, l) in lengths.iter().enumerate() {
                if s <= *l || i + 1 == lengths.len() {
                    return (i, if *l > 0.0 { (s / l).min(1.0) } else { 0.0 });
                }
                s -= l;
            }
            (0, 0.0)
        };
        let (s, t) = (random.random::<f64>() * total, random.random::<f64>() * total);
        let ((i, fi), (j, fj)) = (place(s.min(t)), place(s.max(t)));
        if i == j {
            continue;
        }
        let (mut a, mut b) = (vec![0.0; line[0].len()], vec![0.0; line[0].len()]);
        interpolate(&line[i], &line[i + 1], fi, &mut a);
        interpolate(&line[j], &line[j + 1], fj, &mut b);
        if checker.line_free(&a, &b) {
            line.splice(i + 1..=j, [a, b]);
        }
    }
}

/// Rounds corners: each point of the dense path is drawn to the middle of its neighbours where that stays free.
fn band(checker: &Checker, line: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut q = densify(checker, &line);
    let n = q.len();
    let mut candidate = vec![0.0; q[0].len()];
    for sweep in 0..30 {
        let mut moved = 0.0_f64;
        for k in 1..n.saturating_sub(1) {
            let i = if sweep % 2 == 0 { k } else { n - 1 - k };
            interpolate(&q[i - 1], &q[i + 1], 0.5, &mut candidate);
            let way = checker.length(&candidate, &q[i]);
            // Straight pieces cost nothing.
            if way < 2e-4 {
                continue;
            }
            if checker.line_free(&q[i - 1], &candidate) && checker.line_free(&candidate, &q[i + 1]) {
                q[i].copy_from_slice(&candidate);
                moved = moved.max(way);
            }
        }
        if moved < 1e-3 {
            break;
        }
    }
    q
}

/// Greatest distance between where the tool is on the straight joint lines and on straight lines in space, m: how far a
/// path in joints strays between its points.
pub fn tool_stray(arm: &ArmKinematics, q: &[Vec<f64>]) -> f64 {
    q.windows(2)
        .map(|pair| {
            let mut mid = vec![0.0; pair[0].len()];
            interpolate(&pair[0], &pair[1], 0.5, &mut mid);
            let p = |q: &[f64]| -> Isometry3<f64> { arm.X_WT(q) };
            let (a, b, m) = (p(&pair[0]).translation.vector, p(&pair[1]).translation.vector, p(&mid).translation.vector);
            (m - (a + b) * 0.5).norm()
        })
        .fold(0.0, f64::max)
}
