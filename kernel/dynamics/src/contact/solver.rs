//! The convex problem of one step with contacts: Newton's method on the potentials of contacts and grasps.
//!
//! At each iterate every contact is replaced by its linear model `g(v_c) = g0 - G v_c`, which gives a problem with
//! `H = A + sum J^T G J` and the exact terms of single coordinates; [`Problem::solve`] solves it.
//!
//! Stiction is so stiff that an iterate just off it says nothing about it. So the first rounds guess: a contact sticks if its bodies
//! were held at the end of the last step (the turning of axes since is taken off their velocity), slides if a solution says so,
//! sticks if a solution turns its sliding round. All of that follows from the state, so that a step depends on nothing else. One round
//! settles most steps. If guesses do not settle, Newton's method with an exact line search does, which always goes down (Castro et al.
//! 2022, section V); and if that is slow, it does so along falling stiffness of stiction. What guesses and searches end in is the same:
//! the one minimum of the convex problem.
//!
//! Once a round's models are nearly right, the last part goes with the same factor (chord steps), to full precision.

use nalgebra::{Matrix6, Vector3};

use super::cone::{Law, Normal, Scheme, direction};
use super::derivative::Wrench;
use super::geometry::Poses;
use super::grasp::Held as HeldGrasp;
use super::point::{Found, Manifold};
use super::{Contacts, frame_in_world};
use crate::complementarity::{Problem, rub};
use crate::linear::tree_solve;
use crate::spatial::{angular, join, linear};
use crate::{ContactPoint, DynamicsError, Multibody, SpatialVector, Workspace};

const WHAT: &str = "the step's contacts";
/// What is left of the impulses, over their size.
const TOLERANCE: f64 = 1e-11;
const GUESSES: usize = 12;
const SEARCHES: usize = 40;

/// One contact point over one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub found: Found,
    pub law: Law,
    /// Normal impulse of the old state, with its derivatives by velocity and depth.
    pub bound: Normal,
    /// Greatest friction impulse.
    pub limit: f64,
    /// Velocity of A against B at the point.
    pub v: Vector3<f64>,
    /// What the turning of axes over the last step has added to its velocity at constant joint velocities.
    drift: Vector3<f64>,
    /// How it slides at the start of the step: the first model of a point that turns out to slide on.
    start: Vector3<f64>,
    fresh: bool,
    /// Whether friction holds it.
    pub stuck: bool,
    /// Impulse on A.
    pub impulse: Vector3<f64>,
    model: Model,
    /// The law's impulse less the model's.
    gap: Vector3<f64>,
}

/// A contact's linear model around one velocity.
#[derive(Debug, Clone, Copy, Default)]
struct Model {
    v_n: f64,
    g_n: f64,
    by_v: f64,
    /// Friction's stiffness across the direction of sliding, and along it.
    across: f64,
    t: Vector3<f64>,
    /// What chord steps have added.
    extra: Vector3<f64>,
}

/// A pair of shapes that touches, and its points.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Touching {
    pub pair: usize,
    pub slot: usize,
    pub first: usize,
    pub len: usize,
}

/// A pair of bodies between which something acts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Active {
    pub group: usize,
    /// Its points.
    pub first: usize,
    pub len: usize,
    /// Velocity of A against B at the world's origin: now, of the old state, and along a line search.
    pub V: SpatialVector,
    pub V0: SpatialVector,
    dV: SpatialVector,
    K: Matrix6<f64>,
    F: SpatialVector,
}

/// A grasp over one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bushing {
    pub held: HeldGrasp,
    /// Its place among the active pairs of bodies.
    pub slot: usize,
    /// Its linear model: the impulse `F0 - K V`.
    K: Matrix6<f64>,
    F0: SpatialVector,
}

impl Bushing {
    /// How far the bushing is from its model.
    fn gap(&self, V: &SpatialVector) -> SpatialVector {
        self.held.impulse(V) - (self.F0 - self.K * V)
    }
}

/// Sums of points' stiffnesses and impulses at the world's origin: `W^T G W` and `W^T g`.
struct Sum {
    /// Upper triangles of `[p] G [p]^T` and `G` (xx, xy, xz, yy, yz, zz), and `[p] G` by rows.
    turn: [f64; 6],
    mixed: [f64; 9],
    shift: [f64; 6],
    F: SpatialVector,
}

impl Default for Sum {
    fn default() -> Self {
        Self { turn: [0.0; 6], mixed: [0.0; 9], shift: [0.0; 6], F: SpatialVector::zeros() }
    }
}

impl Sum {
    #[inline]
    fn add(&mut self, p: &Vector3<f64>, g: &Vector3<f64>, G: [f64; 6]) {
        let [xx, xy, xz, yy, yz, zz] = G;
        let (x, y, z) = (p.x, p.y, p.z);
        // Rows of [p] G.
        let m = [
            y * xz - z * xy,
            y * yz - z * yy,
            y * zz - z * yz,
            z * xx - x * xz,
            z * xy - x * yz,
            z * xz - x * zz,
            x * xy - y * xx,
            x * yy - y * xy,
            x * yz - y * xz,
        ];
        // Rows of it times [p]^T.
        let turn =
            [y * m[2] - z * m[1], z * m[0] - x * m[2], x * m[1] - y * m[0], z * m[3] - x * m[5], x * m[4] - y * m[3], x * m[7] - y * m[6]];
        for (s, t) in self.turn.iter_mut().zip(turn) {
            *s += t;
        }
        for (s, t) in self.mixed.iter_mut().zip(m) {
            *s += t;
        }
        for (s, t) in self.shift.iter_mut().zip(G) {
            *s += t;
        }
        self.F += join(&p.cross(g), g);
    }

    fn matrix(&self) -> Matrix6<f64> {
        let ([a, b, c, d, e, f], [g, h, i, j, k, l]) = (self.turn, self.shift);
        let m = &self.mixed;
        Matrix6::new(
            a, b, c, m[0], m[1], m[2], b, d, e, m[3], m[4], m[5], c, e, f, m[6], m[7], m[8], m[0], m[3], m[6], g, h, i, m[1], m[4], m[7],
            h, j, k, m[2], m[5], m[8], i, k, l,
        )
    }
}

#[inline]
fn dot(x: &SpatialVector, y: &SpatialVector) -> f64 {
    (x[0] * y[0] + x[1] * y[1]) + (x[2] * y[2] + x[3] * y[3]) + (x[4] * y[4] + x[5] * y[5])
}

/// Everything of contact that changes while one system is stepped.
#[derive(Debug, Clone)]
pub(crate) struct ContactWorkspace {
    poses: Poses,
    manifold: Manifold,
    pub scheme: Scheme,
    pub points: Vec<Point>,
    pub touching: Vec<Touching>,
    pub active: Vec<Active>,
    pub bushings: Vec<Bushing>,
    slots: Vec<usize>,
    /// Columns of all groups' relative Jacobians; those of groups that are not active are old.
    pub J: Vec<SpatialVector>,
    /// The Hessian of the last round, and its right-hand side.
    pub H: Vec<f64>,
    rhs: Vec<f64>,
    at: Vec<f64>,
    way: Vec<f64>,
    short: Vec<f64>,
    /// Wrenches with their derivatives, by touching pair of shapes and by pair of bodies.
    pub by_pair: Vec<Wrench>,
    pub by_active: Vec<Wrench>,
    pub outward_w: Vec<SpatialVector>,
    pub outward_v: Vec<SpatialVector>,
    /// Rounds that the last step took.
    pub rounds: usize,
    /// Chord steps that it took.
    pub chords: usize,
}

impl ContactWorkspace {
    pub fn new(contacts: &Contacts, n: usize) -> Self {
        let room = contacts.room();
        Self {
            poses: Poses::new(&contacts.geometries),
            manifold: Manifold { found: Vec::with_capacity(64) },
            scheme: Scheme::default(),
            points: Vec::with_capacity(room),
            touching: Vec::with_capacity(contacts.pairs.len()),
            active: Vec::with_capacity(contacts.groups.len()),
            bushings: Vec::with_capacity(contacts.grasps.len()),
            slots: vec![usize::MAX; contacts.groups.len()],
            J: vec![SpatialVector::zeros(); contacts.columns],
            H: vec![0.0; n * n],
            rhs: vec![0.0; n],
            at: vec![0.0; n],
            way: vec![0.0; n],
            short: vec![0.0; n],
            by_pair: Vec::with_capacity(contacts.pairs.len()),
            by_active: Vec::with_capacity(contacts.groups.len()),
            outward_w: Vec::with_capacity(n.max(contacts.columns)),
            outward_v: Vec::with_capacity(n.max(contacts.columns)),
            rounds: 0,
            chords: 0,
        }
    }

    pub fn fits(&self, contacts: &Contacts) -> bool {
        self.poses.p.len() == contacts.geometries.len() && self.J.len() == contacts.columns && self.slots.len() == contacts.groups.len()
    }

    /// Finds what touches in the workspace's state.
    pub fn find(&mut self, contacts: &Contacts, multibody: &Multibody, rigid: &Workspace, h: f64) {
        let options = &contacts.options;
        self.scheme = Scheme { h, share: options.share, slip: options.slip };
        self.poses.update(&contacts.geometries, &rigid.R_WB, &rigid.p_WB);
        self.points.clear();
        self.touching.clear();
        self.bushings.clear();
        for active in self.active.drain(..) {
            self.slots[active.group] = usize::MAX;
        }
        for (k, pair) in contacts.pairs.iter().enumerate() {
            if !self.poses.near(pair, &contacts.geometries, options.margin) {
                continue;
            }
            self.poses.collide(pair, &contacts.geometries, options.margin, &mut self.manifold);
            if self.manifold.found.is_empty() {
                continue;
            }
            let slot = self.slot(contacts, contacts.group_of[k], rigid);
            let material = contacts.geometries[pair.a].material.between(&contacts.geometries[pair.b].material);
            let law = Law { stiffness: material.stiffness, dissipation: material.dissipation, friction: material.friction };
            let first = self.points.len();
            let V0 = self.active[slot].V0;
            let group = &contacts.groups[self.active[slot].group];
            // Accelerations at constant joint velocities; gravity is in both.
            let (A, both) = (rigid.A[group.a] - rigid.A[group.b], rigid.V[group.a] + rigid.V[group.b]);
            for found in &self.manifold.found {
                let v0 = at_point(&V0, &found.p).dot(&found.n);
                let bound = law.bound(&self.scheme, found.depth, v0);
                self.points.push(Point {
                    found: *found,
                    law,
                    bound,
                    limit: law.friction * bound.value,
                    v: Vector3::zeros(),
                    drift: (at_point(&A, &found.p) + angular(&V0).cross(&(at_point(&both, &found.p) * 0.5))) * h,
                    start: Vector3::zeros(),
                    fresh: true,
                    stuck: false,
                    impulse: Vector3::zeros(),
                    model: Model::default(),
                    gap: Vector3::zeros(),
                });
            }
            let len = self.manifold.found.len();
            self.touching.push(Touching { pair: k, slot, first, len });
            // Pairs are ordered by bodies, so the points of two bodies lie together.
            let active = &mut self.active[slot];
            if active.len == 0 {
                active.first = first;
            }
            active.len += len;
        }
        for (k, grasp) in contacts.grasps.iter().enumerate() {
            let slot = self.slot(contacts, contacts.group_of[contacts.pairs.len() + k], rigid);
            let (R, p) = frame_in_world(multibody, grasp.a, &grasp.X_AG, &rigid.R_WB, &rigid.p_WB);
            let (S, q) = frame_in_world(multibody, grasp.b, &grasp.X_BH, &rigid.R_WB, &rigid.p_WB);
            let held = HeldGrasp::new(grasp, h, (&R, &p), (&S, &q));
            self.bushings.push(Bushing { held, slot, K: Matrix6::zeros(), F0: SpatialVector::zeros() });
        }
    }

    /// The place of a group among the active ones.
    fn slot(&mut self, contacts: &Contacts, group: usize, rigid: &Workspace) -> usize {
        if self.slots[group] == usize::MAX {
            self.slots[group] = self.active.len();
            let g = &contacts.groups[group];
            for (J, c) in self.J[g.start..].iter_mut().zip(&g.columns) {
                *J = rigid.S[c.tree] * c.factor;
            }
            let zero = SpatialVector::zeros();
            let V0 = rigid.V[g.a] - rigid.V[g.b];
            self.active.push(Active { group, first: 0, len: 0, V: zero, V0, dV: zero, K: Matrix6::zeros(), F: zero });
        }
        self.slots[group]
    }

    /// Solves the step's problem; `problem.v` holds the start, then the solution. `again`: the start is the solution of a problem
    /// near by, with the same contacts.
    pub fn solve(&mut self, contacts: &Contacts, problem: &mut Problem, again: bool) -> Result<(), DynamicsError> {
        (self.rounds, self.chords) = (0, 0);
        if self.active.is_empty() {
            return problem.solve();
        }
        // The base problem stands aside while the problem with contacts stands in its place.
        std::mem::swap(&mut problem.A, &mut self.H);
        std::mem::swap(&mut problem.b, &mut self.rhs);
        let coupled = std::mem::replace(&mut problem.coupled, true);
        let result = self.newton(contacts, problem, again);
        problem.coupled = coupled;
        std::mem::swap(&mut problem.A, &mut self.H);
        std::mem::swap(&mut problem.b, &mut self.rhs);
        result
    }

    /// Here `self.H`, `self.rhs` are the base problem and `problem.A`, `problem.b` the one with contacts.
    fn newton(&mut self, contacts: &Contacts, problem: &mut Problem, again: bool) -> Result<(), DynamicsError> {
        self.rates(contacts, &problem.v);
        if !again {
            for p in &mut self.points {
                let n = &p.found.n;
                p.v -= p.drift;
                p.start = p.v - n * n.dot(&p.v);
                p.stuck = p.start.norm() <= self.scheme.slip;
                p.fresh = true;
            }
        }
        for _ in 0..GUESSES {
            if self.round(contacts, problem)? {
                return Ok(());
            }
        }
        if self.search(contacts, problem)? {
            return Ok(());
        }
        let slip = self.scheme.slip;
        let mut soft = 1e-1;
        while soft > slip {
            self.scheme.slip = soft;
            let settled = self.search(contacts, problem);
            self.scheme.slip = slip;
            settled?;
            soft *= 0.1;
        }
        if self.search(contacts, problem)? {
            return Ok(());
        }
        Err(DynamicsError::NoConvergence { what: WHAT, residual: self.gaps(), iterations: self.rounds })
    }

    /// One guess: solves with the contacts' present models. True if the solution confirms them.
    fn round(&mut self, contacts: &Contacts, problem: &mut Problem) -> Result<bool, DynamicsError> {
        self.rounds += 1;
        self.models();
        self.assemble(contacts, problem);
        problem.solve()?;
        self.rates(contacts, &problem.v);
        if self.confirm() {
            return Ok(self.polish(contacts, problem));
        }
        Ok(false)
    }

    /// Newton with line search from `problem.v`. True if it settled.
    fn search(&mut self, contacts: &Contacts, problem: &mut Problem) -> Result<bool, DynamicsError> {
        for v in problem.v.iter_mut().zip(&problem.walls) {
            *v.0 = v.0.max(v.1[0]).min(v.1[1]);
        }
        self.rates(contacts, &problem.v);
        for _ in 0..SEARCHES {
            self.rounds += 1;
            let slip = self.scheme.slip;
            for p in &mut self.points {
                let n = &p.found.n;
                p.stuck = (p.v - n * n.dot(&p.v)).norm_squared() <= slip * slip;
                p.fresh = false;
            }
            self.at.copy_from_slice(&problem.v);
            self.models();
            self.assemble(contacts, problem);
            problem.solve()?;
            for ((way, v), at) in self.way.iter_mut().zip(&problem.v).zip(&self.at) {
                *way = v - at;
            }
            self.rates(contacts, &problem.v);
            if self.confirm() && self.polish(contacts, problem) {
                return Ok(true);
            }
            let part = self.line(contacts, problem);
            for ((v, way), at) in problem.v.iter_mut().zip(&self.way).zip(&self.at) {
                *v = at + part * way;
            }
            self.rates(contacts, &problem.v);
        }
        Ok(false)
    }

    /// The part of the way at which the problem's value is least.
    fn line(&mut self, contacts: &Contacts, problem: &Problem) -> f64 {
        let (at, way) = (std::mem::take(&mut self.at), std::mem::take(&mut self.way));
        self.rates(contacts, &way);
        for active in &mut self.active {
            active.dV = active.V;
        }
        self.rates(contacts, &at);
        let n = problem.n;
        // `way . (A v - b)` is linear in the part.
        let (mut slope0, mut slope1) = (0.0, 0.0);
        for k in 0..n {
            let row = &self.H[k * n..(k + 1) * n];
            let (Av, Aw) = row.iter().zip(&at).zip(&way).fold((0.0, 0.0), |s, ((a, v), w)| (s.0 + a * v, s.1 + a * w));
            slope0 += way[k] * (Av - self.rhs[k]);
            slope1 += way[k] * Aw;
        }
        let slope = |part: f64| {
            let mut sum = slope0 + part * slope1;
            for k in 0..n {
                let v = at[k] + part * way[k];
                // Just before where it stops it still moves.
                sum += rub(problem.dry[k], if v == 0.0 { at[k] } else { v }) * way[k];
            }
            for h in &problem.hinges {
                sum += h.push(at[h.k] + part * way[h.k]) * way[h.k];
            }
            for active in &self.active {
                let V = active.V + active.dV * part;
                for p in &self.points[active.first..active.first + active.len] {
                    sum -= self.force(p, &at_point(&V, &p.found.p)).0.dot(&at_point(&active.dV, &p.found.p));
                }
            }
            for bushing in &self.bushings {
                let active = &self.active[bushing.slot];
                sum -= bushing.held.impulse(&(active.V + active.dV * part)).dot(&active.dV);
            }
            sum
        };
        let (mut low, mut high) = ((0.0, slope(0.0)), (1.0, slope(1.0)));
        let goal = 1e-12 * low.1.abs();
        let mut part = 1.0;
        if low.1 < 0.0 && high.1 > goal {
            // Regula falsi that halves the value of an end that stays (Illinois), with bisection every third time.
            for round in 0..80 {
                part = if round % 3 == 2 { 0.5 * (low.0 + high.0) } else { low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1) };
                let value = slope(part);
                if value.abs() <= goal || high.0 - low.0 < 1e-15 {
                    break;
                }
                if value < 0.0 {
                    low = (part, value);
                    high.1 *= 0.5;
                } else {
                    high = (part, value);
                    low.1 *= 0.5;
                }
            }
        }
        (self.at, self.way) = (at, way);
        part
    }

    /// Velocities of all pairs of bodies and at all points.
    pub(crate) fn rates(&mut self, contacts: &Contacts, v: &[f64]) {
        for active in &mut self.active {
            let group = &contacts.groups[active.group];
            let mut V = SpatialVector::zeros();
            for (J, c) in self.J[group.start..].iter().zip(&group.columns) {
                V += J * v[c.v];
            }
            active.V = V;
            for p in &mut self.points[active.first..active.first + active.len] {
                p.v = at_point(&V, &p.found.p);
            }
        }
    }

    /// Linear models around the present velocities.
    fn models(&mut self) {
        for p in &mut self.points {
            let n = &p.found.n;
            let v_n = n.dot(&p.v);
            let normal = p.law.normal(&self.scheme, p.found.depth, v_n);
            let mut model = Model { v_n, g_n: normal.value, by_v: normal.by_v, ..Model::default() };
            if p.stuck || p.limit <= 0.0 {
                model.across = p.limit / self.scheme.slip;
            } else {
                let v_t = if p.fresh { p.start } else { p.v - n * v_n };
                p.fresh = false;
                let speed = v_t.norm().max(self.scheme.slip);
                model.across = p.limit / speed;
                model.t = v_t / speed;
            }
            p.model = model;
        }
    }

    fn assemble(&mut self, contacts: &Contacts, problem: &mut Problem) {
        problem.A.copy_from_slice(&self.H);
        problem.b.copy_from_slice(&self.rhs);
        for active in &mut self.active {
            let mut sum = Sum::default();
            for p in &self.points[active.first..active.first + active.len] {
                let (n, model) = (&p.found.n, &p.model);
                let mut g0 = n * (model.g_n - model.by_v * model.v_n);
                // G = a 1 + (b - a) n n^T - a t t^T, symmetric.
                let (a, b) = (model.across, -model.by_v - model.across);
                let c = if p.stuck { 0.0 } else { a };
                if !p.stuck {
                    g0 -= model.t * p.limit;
                }
                let t = &model.t;
                sum.add(
                    &p.found.p,
                    &g0,
                    [
                        a + b * n.x * n.x - c * t.x * t.x,
                        b * n.x * n.y - c * t.x * t.y,
                        b * n.x * n.z - c * t.x * t.z,
                        a + b * n.y * n.y - c * t.y * t.y,
                        b * n.y * n.z - c * t.y * t.z,
                        a + b * n.z * n.z - c * t.z * t.z,
                    ],
                );
            }
            (active.K, active.F) = (sum.matrix(), sum.F);
        }
        for bushing in &mut self.bushings {
            let active = &mut self.active[bushing.slot];
            bushing.K = bushing.held.slope(&active.V);
            bushing.F0 = bushing.held.impulse(&active.V) + bushing.K * active.V;
            active.F += bushing.F0;
            active.K += bushing.K;
        }
        let n = problem.n;
        for active in &self.active {
            let group = &contacts.groups[active.group];
            let J = &self.J[group.start..group.start + group.columns.len()];
            for (j, (Jj, cj)) in J.iter().zip(&group.columns).enumerate() {
                let KJ = active.K * Jj;
                problem.b[cj.v] += Jj.dot(&active.F);
                for (Ji, ci) in J[..j].iter().zip(&group.columns) {
                    let entry = dot(Ji, &KJ);
                    problem.A[ci.v * n + cj.v] += entry;
                    problem.A[cj.v * n + ci.v] += entry;
                }
                problem.A[cj.v * n + cj.v] += dot(Jj, &KJ);
            }
        }
    }

    /// Impulse of the law itself at a velocity, and whether friction holds.
    fn force(&self, p: &Point, v: &Vector3<f64>) -> (Vector3<f64>, bool) {
        let n = &p.found.n;
        let v_n = n.dot(v);
        let g_n = p.law.normal(&self.scheme, p.found.depth, v_n).value;
        let (s, stuck, _) = direction(self.scheme.slip, &(v - n * v_n));
        (n * g_n - s * p.limit, stuck)
    }

    /// Do the present velocities confirm what was assumed to stick and to slide? Sets what to assume next.
    fn confirm(&mut self) -> bool {
        let limit = self.scheme.slip * (1.0 + 1e-9);
        let mut good = true;
        for p in &mut self.points {
            if p.limit <= 0.0 {
                continue;
            }
            let n = &p.found.n;
            let v_t = p.v - n * n.dot(&p.v);
            let next = if p.stuck { v_t.norm_squared() <= limit * limit } else { v_t.dot(&p.model.t) <= 0.0 };
            good &= next == p.stuck;
            p.stuck = next;
        }
        good
    }

    /// Takes up how far each law is from its model at the present velocities; gives the error over the size of all impulses.
    fn gaps(&mut self) -> f64 {
        // Where nothing pushes, the momentum stands in for the impulses.
        let (mut error, mut size) = (0.0, 1e-6 * self.rhs.iter().map(|b| b * b).sum::<f64>());
        for p in &mut self.points {
            let (n, model) = (&p.found.n, &p.model);
            let v_n = n.dot(&p.v);
            let g_n = p.law.normal(&self.scheme, p.found.depth, v_n).value;
            let mut gap = n * (g_n - (model.g_n + model.by_v * (v_n - model.v_n))) - model.extra;
            // In stiction law and model are the same line, so nothing is lost to rounding there.
            if !p.stuck && p.limit > 0.0 {
                let v_t = p.v - n * v_n;
                let (s, _, _) = direction(self.scheme.slip, &v_t);
                gap += (model.t - s) * p.limit + (v_t - model.t * model.t.dot(&v_t)) * model.across;
            }
            p.gap = gap;
            error += gap.norm_squared();
            size += g_n * g_n;
        }
        for bushing in &self.bushings {
            let V = &self.active[bushing.slot].V;
            size += bushing.held.impulse(V).norm_squared();
            error += bushing.gap(V).norm_squared();
        }
        if error == 0.0 { 0.0 } else { (error / size).sqrt() }
    }

    /// Ends with chord steps. True if the models then hold.
    fn polish(&mut self, contacts: &Contacts, problem: &mut Problem) -> bool {
        let mut before = f64::INFINITY;
        loop {
            let error = self.gaps();
            if error <= TOLERANCE {
                self.finish();
                return true;
            }
            // Worth it while each step takes off much.
            if error.is_nan() || error > 0.2 * before || error > 0.1 {
                return false;
            }
            self.chords += 1;
            before = error;
            self.short.fill(0.0);
            for active in &self.active {
                let mut F = SpatialVector::zeros();
                for p in &mut self.points[active.first..active.first + active.len] {
                    F += join(&p.found.p.cross(&p.gap), &p.gap);
                    p.model.extra += p.gap;
                }
                let group = &contacts.groups[active.group];
                for (J, c) in self.J[group.start..].iter().zip(&group.columns) {
                    self.short[c.v] += J.dot(&F);
                }
            }
            for bushing in &mut self.bushings {
                let active = &self.active[bushing.slot];
                let gap = bushing.gap(&active.V);
                bushing.F0 += gap;
                let group = &contacts.groups[active.group];
                for (J, c) in self.J[group.start..].iter().zip(&group.columns) {
                    self.short[c.v] += J.dot(&gap);
                }
            }
            let m = problem.free.len();
            for (i, &k) in problem.free.iter().enumerate() {
                self.short[i] = self.short[k];
            }
            tree_solve(&problem.factor, &mut self.short[..m]);
            for (i, &k) in problem.free.iter().enumerate() {
                problem.v[k] += self.short[i];
            }
            self.rates(contacts, &problem.v);
            if !self.confirm() {
                return false;
            }
        }
    }

    /// Keeps the impulses of the solution.
    fn finish(&mut self) {
        for k in 0..self.points.len() {
            let p = &self.points[k];
            self.points[k].impulse = self.force(p, &p.v).0;
        }
    }

    /// The contact points as the user sees them.
    pub fn list<'a>(&'a self, contacts: &'a Contacts) -> impl Iterator<Item = ContactPoint<'a>> + 'a {
        self.touching.iter().filter(|t| t.pair < contacts.pairs.len()).flat_map(move |t| {
            let pair = &contacts.pairs[t.pair];
            let (a, b) = (contacts.geometries[pair.a].name.as_str(), contacts.geometries[pair.b].name.as_str());
            self.points[t.first..t.first + t.len].iter().map(move |p| ContactPoint {
                a,
                b,
                p_W: p.found.p,
                n_W: p.found.n,
                depth: p.found.depth,
                impulse_W: p.impulse,
                sticks: p.stuck && p.limit > 0.0,
                id: p.found.id,
            })
        })
    }
}

/// Velocity of a point of a body with the velocity `V`.
#[inline]
pub(crate) fn at_point(V: &SpatialVector, p: &Vector3<f64>) -> Vector3<f64> {
    linear(V) + angular(V).cross(p)
}
