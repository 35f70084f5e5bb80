//! Derivatives of the contacts' part of a step at its solution, by the implicit function theorem.
//!
//! The step's residual holds `-J^T F`, with the relative Jacobian `J(q)` between two bodies and the wrench `F` on A at the world's
//! origin, a function of the poses of both bodies, of their next relative velocity `V = J w`, of their old one `V0 = J v`, and of
//! parameters. Written here are
//!
//! * [`Wrench`]: `F` with its derivatives as 6 x 6 blocks, by small twists of A (world axes, world's origin; `V`, `V0` held), by `V`
//!   and by `V0`, and by friction, stiffness and dissipation of the pair;
//! * dense blocks by `q` and `v` ([`ContactWorkspace::add_dense`]);
//! * the reverse form ([`ContactWorkspace::reverse`]).
//!
//! `F` turns with the world: moving both bodies by a twist `X` changes it by `X x* F` if the velocities turn too. So the derivative by
//! a twist of B follows from that by A, and joints that move both bodies have no part in the dense blocks.
//!
//! At fixed `w`, the joint `j` of A's chain turns the columns of all joints `i` from it outward, `dJ_i = J_j x J_i`, and so
//! `dV = J_j x U_j` with their part `U_j` of `V`.
//!
//! Valid within one set of contact points and features, away from the corners of the law: see [`super::cone`], [`super::feature`].

use nalgebra::{Matrix3x6, Matrix6, Vector3};

use super::Contacts;
use super::cone::{direction, direction_slope};
use super::feature::skew;
use super::grasp::about;
use super::solver::{ContactWorkspace, Point, at_point};
use crate::spatial::{angular, join};
use crate::{SpatialVector, cross_force, cross_motion};

/// A wrench between two bodies with its derivatives. By velocities and poses of A; those of B follow.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wrench {
    /// Impulse on A.
    pub F: SpatialVector,
    /// By a twist of A at fixed `V` and `V0`: also what moving A's shape alone does.
    pub by_pose: Matrix6<f64>,
    /// By `V`.
    pub by_V: Matrix6<f64>,
    /// By `V0`.
    pub by_V0: Matrix6<f64>,
    /// By the pair's friction, stiffness and dissipation.
    pub by_material: [SpatialVector; 3],
}

impl Default for Wrench {
    fn default() -> Self {
        let (zero, none) = (SpatialVector::zeros(), Matrix6::zeros());
        Self { F: zero, by_pose: none, by_V: none, by_V0: none, by_material: [zero; 3] }
    }
}

impl Wrench {
    /// Change by a twist `X` of B at fixed `V` and `V0`.
    pub fn by_pose_of_b(&self, X: &SpatialVector, V: &SpatialVector, V0: &SpatialVector) -> SpatialVector {
        cross_force(X, &self.F) - self.by_V * cross_motion(X, V) - self.by_V0 * cross_motion(X, V0) - self.by_pose * X
    }

    fn add(&mut self, other: &Self) {
        self.F += other.F;
        self.by_pose += other.by_pose;
        self.by_V += other.by_V;
        self.by_V0 += other.by_V0;
        for (m, o) in self.by_material.iter_mut().zip(other.by_material) {
            *m += o;
        }
    }
}

/// What [`ContactWorkspace::reverse`] gives for one body: spatial force vectors in the world, at its origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seed {
    /// By a small twist of the body, its velocities held.
    pub pose: SpatialVector,
    /// By its next velocity.
    pub next: SpatialVector,
    /// By its old velocity.
    pub old: SpatialVector,
    /// By the velocity that the multipliers give it.
    pub multiplier: SpatialVector,
}

impl Default for Seed {
    fn default() -> Self {
        let zero = SpatialVector::zeros();
        Self { pose: zero, next: zero, old: zero, multiplier: zero }
    }
}

impl ContactWorkspace {
    /// Wrench and derivatives of each touching pair of shapes, and their sums by pair of bodies, at the velocities of the last
    /// [`Self::rates`].
    pub fn differentiate(&mut self) {
        let mut pairs = std::mem::take(&mut self.by_pair);
        let mut sums = std::mem::take(&mut self.by_active);
        pairs.clear();
        sums.clear();
        sums.resize(self.active.len(), Wrench::default());
        for t in &self.touching {
            let active = &self.active[t.slot];
            let mut sum = Wrench::default();
            for p in &self.points[t.first..t.first + t.len] {
                self.point(p, &active.V, &active.V0, &mut sum);
            }
            sums[t.slot].add(&sum);
            pairs.push(sum);
        }
        for bushing in &self.bushings {
            let V = &self.active[bushing.slot].V;
            let sum = &mut sums[bushing.slot];
            sum.F += bushing.held.impulse(V);
            sum.by_pose += bushing.held.by_pose(V);
            sum.by_V -= bushing.held.slope(V);
        }
        (self.by_pair, self.by_active) = (pairs, sums);
    }

    fn point(&self, point: &Point, V: &SpatialVector, V0: &SpatialVector, out: &mut Wrench) {
        let (p, n, depth) = (&point.found.p, &point.found.n, point.found.depth);
        let (v, v0) = (at_point(V, p), at_point(V0, p));
        let (v_n, law) = (n.dot(&v), &point.law);
        let v_t = v - n * v_n;
        let normal = law.normal(&self.scheme, depth, v_n);
        let bound = &point.bound;
        if normal.value == 0.0 && bound.value == 0.0 {
            return;
        }
        let (s, stuck, speed) = direction(self.scheme.slip, &v_t);
        let slope = direction_slope(self.scheme.slip, &s, stuck, speed);
        let limit = law.friction * bound.value;
        let f = n * normal.value - s * limit;
        let moment = |f: &Vector3<f64>| join(&p.cross(f), f);

        let motion = point.found.feature.motion(p, n, depth);
        let dv: Matrix3x6<f64> = skew(&angular(V)) * motion.p;
        let dv0: Matrix3x6<f64> = skew(&angular(V0)) * motion.p;
        let dv_n = v.transpose() * motion.n + n.transpose() * dv;
        let dv0_n = v0.transpose() * motion.n + n.transpose() * dv0;
        let dv_t = dv - n * dv_n - motion.n * v_n;
        let d_normal = dv_n * normal.by_v + motion.depth * normal.by_depth;
        let d_bound = dv0_n * bound.by_v + motion.depth * bound.by_depth;
        let df = n * d_normal + motion.n * normal.value - s * d_bound * law.friction - slope * dv_t * limit;
        let mut torque = out.by_pose.fixed_view_mut::<3, 6>(0, 0);
        torque += skew(p) * df - skew(&f) * motion.p;
        let mut force = out.by_pose.fixed_view_mut::<3, 6>(3, 0);
        force += df;

        out.F += moment(&f);
        let across = nalgebra::Matrix3::identity() - n * n.transpose();
        out.by_V -= about(p, &(across * slope * across * limit - n * n.transpose() * normal.by_v));
        out.by_V0 += moment(&(s * (-law.friction * bound.by_v))) * moment(n).transpose();
        out.by_material[0] -= moment(&(s * bound.value));
        out.by_material[1] += moment(&f) / law.stiffness;
        out.by_material[2] += moment(&(n * normal.by_dissipation - s * (law.friction * bound.by_dissipation)));
    }

    /// Calls `add(i, k, values)` with what is to be added to row `i`, column `k` of three nv x nv matrices: `-d(J^T F)/dq` (at fixed
    /// next velocity `w`), `-d(J^T F)/dv` and `-d(J^T F)/dw`.
    pub fn add_dense(&mut self, contacts: &Contacts, w: &[f64], v: &[f64], mut add: impl FnMut(usize, usize, [f64; 3])) {
        let (mut outward_w, mut outward_v) = (std::mem::take(&mut self.outward_w), std::mem::take(&mut self.outward_v));
        for (active, wrench) in self.active.iter().zip(&self.by_active) {
            let group = &contacts.groups[active.group];
            let J = &self.J[group.start..group.start + group.columns.len()];
            self.outward(&group.columns, J, w, &mut outward_w);
            self.outward(&group.columns, J, v, &mut outward_v);
            for (j, (Jj, cj)) in J.iter().zip(&group.columns).enumerate() {
                let X = if cj.moves_a { *Jj } else { -Jj };
                let turned = cross_force(&X, &wrench.F);
                let mut dF = wrench.by_V * cross_motion(&X, &outward_w[j]) + wrench.by_V0 * cross_motion(&X, &outward_v[j]);
                dF += if cj.moves_a { wrench.by_pose * X } else { wrench.by_pose_of_b(&X, &active.V, &active.V0) };
                let still = dF - turned;
                let (dv, dw) = (wrench.by_V0 * Jj, wrench.by_V * Jj);
                for (Ji, ci) in J.iter().zip(&group.columns) {
                    let outward = ci.moves_a == cj.moves_a && ci.body >= cj.body;
                    let by_q = Ji.dot(if outward { &still } else { &dF });
                    add(ci.v, cj.v, [-by_q, -Ji.dot(&dv), -Ji.dot(&dw)]);
                }
            }
        }
        (self.outward_w, self.outward_v) = (outward_w, outward_v);
    }

    /// For each column the part of the relative velocity that its joint and those outward of it give.
    fn outward(&self, columns: &[super::Column], J: &[SpatialVector], v: &[f64], out: &mut Vec<SpatialVector>) {
        out.clear();
        out.resize(columns.len(), SpatialVector::zeros());
        let mut j = columns.len();
        let mut sum = SpatialVector::zeros();
        while j > 0 {
            let (body, moves_a) = (columns[j - 1].body, columns[j - 1].moves_a);
            if j < columns.len() && columns[j].moves_a != moves_a {
                sum = SpatialVector::zeros();
            }
            let end = j;
            while j > 0 && columns[j - 1].body == body && columns[j - 1].moves_a == moves_a {
                j -= 1;
                sum += J[j] * v[columns[j].v];
            }
            out[j..end].fill(sum);
        }
    }

    /// The gradient of `L = lambda^T J^T F`, the contacts' part of `-lambda . r`: adds what each body's pose and velocities give to the
    /// seeds (entry 0 is the world). The sweep of the rigid bodies carries them on to joints, axes and origins.
    pub fn reverse(&self, contacts: &Contacts, lambda: &[f64], seeds: &mut [Seed]) {
        for (active, wrench) in self.active.iter().zip(&self.by_active) {
            let group = &contacts.groups[active.group];
            let multiplier = self.relative(contacts, active.group, lambda);
            let (next, old) = (wrench.by_V.transpose() * multiplier, wrench.by_V0.transpose() * multiplier);
            let of_a = wrench.by_pose.transpose() * multiplier;
            let of_b = -cross_force(&multiplier, &wrench.F) - cross_force(&active.V, &next) - cross_force(&active.V0, &old) - of_a;
            for (body, sign, pose) in [(group.a, 1.0, of_a), (group.b, -1.0, of_b)] {
                seeds[body].pose += pose;
                seeds[body].next += next * sign;
                seeds[body].old += old * sign;
                seeds[body].multiplier += wrench.F * sign;
            }
        }
    }

    /// The gradient of the same `L` by friction, stiffness and dissipation of each touching pair, and by twists of its two shapes in
    /// the world (at its origin): calls `out(pair, material, of_a, of_b)`.
    pub fn reverse_parameters(
        &self,
        contacts: &Contacts,
        lambda: &[f64],
        mut out: impl FnMut(usize, [f64; 3], SpatialVector, SpatialVector),
    ) {
        for (t, wrench) in self.touching.iter().zip(&self.by_pair) {
            let active = &self.active[t.slot];
            let multiplier = self.relative(contacts, active.group, lambda);
            let (next, old) = (wrench.by_V.transpose() * multiplier, wrench.by_V0.transpose() * multiplier);
            let of_a = wrench.by_pose.transpose() * multiplier;
            let of_b = -cross_force(&multiplier, &wrench.F) - cross_force(&active.V, &next) - cross_force(&active.V0, &old) - of_a;
            out(t.pair, wrench.by_material.map(|m| m.dot(&multiplier)), of_a, of_b);
        }
    }

    /// `J x` of a group.
    pub(crate) fn relative(&self, contacts: &Contacts, group: usize, x: &[f64]) -> SpatialVector {
        let group = &contacts.groups[group];
        self.J[group.start..].iter().zip(&group.columns).fold(SpatialVector::zeros(), |sum, (J, c)| sum + J * x[c.v])
    }
}

#[cfg(test)]
mod tests;
