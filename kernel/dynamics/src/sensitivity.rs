//! Columns by parameters of a step's equations, beside those by state and input in [`crate::linearise`].
//!
//! At fixed next velocities `w`, `dr/dtheta` has three sources. Effects bring their own partials. An inertia acts on the degrees of
//! freedom before its body: row `l` is `S_l . I A + (S_l x V) . I V`, linear in `I` (Atkeson, An and Hollerbach 1986). All others move
//! something along a twist `T`: an origin all that is behind its joint, an axis the same and its joint's own motion subspace, a shape
//! itself. So each row of the equations has one vector `g` with `dr_l = g_l . T`, taken once for all columns of a joint.
//!
//! With the velocity `V_P` and acceleration `A_P` of what the joint stands on, a displacement of the subtree of `i` means
//! `D = V_P x T`, `E = A_P x T + V_P x D` for all bodies in it (see [`crate::algorithms::derivatives`], with `T` for `S_k`), so that
//!
//! `g_l = -A_P x* U + V_P x* V_P x* U + [y x omega_P; 0] - S_l x* f`,
//!
//! with `U = I S_l` and `y`: of the subtree of `l` for rows in the subtree, and then `f` is its external force; of the subtree of `i`
//! for rows before it, and then `f` is the force that inertia needs there.
//!
//! Contacts: row `l` is `-J_l . F`. A displacement turns the columns `J_l` that it carries, changes the relative velocity by
//! `T x U` with the part `U` of it that the carried columns give, and moves one of the two bodies:
//!
//! `g_l = -(P_l + U x* by_V^T J_l + U0 x* by_V0^T J_l + [J_l x* F if carried])`,
//!
//! `P_l` the reverse of a twist of that body, as in [`crate::contact::derivative`].

use nalgebra::{Matrix3, Vector3};
use sagci_model::JointKind;

use crate::algorithms::adjoint::{add_inertial, to_body};
use crate::contact::Contacts;
use crate::contact::derivative::Wrench;
use crate::contact::solver::ContactWorkspace;
use crate::joint::matrix;
use crate::parameter::Direction;
use crate::spatial::{angular, dot, join, linear, tr_mul};
use crate::workspace::{Lane, add_scaled};
use crate::{
    Adjoint, DynamicsError, Multibody, ParameterVector, RigidGradient, SpatialInertia, SpatialVector, System, Workspace, cross_force,
    cross_motion,
};

/// No column.
const NONE: usize = usize::MAX;

/// Which columns there are, what each of them changes, and scratch. Made once; what it changes is looked up anew when the system has
/// changed.
#[derive(Debug, Clone, Default)]
pub(crate) struct Plan {
    which: ParameterVector,
    stamp: Option<u64>,
    /// Column of each parameter of effects; empty where there is none.
    pub theta: Vec<usize>,
    /// Columns of the residual's weights.
    pub weights: Vec<(usize, usize)>,
    pub by_weights: Vec<f64>,
    /// Column, degree of freedom, change of its armature.
    armatures: Vec<(usize, usize, f64)>,
    inertias: Vec<Inertias>,
    joints: Vec<Joint>,
    /// Column, shape, which of its numbers.
    surfaces: Vec<(usize, usize, usize)>,
    shapes: Vec<(usize, Columns<6>)>,
    rows: Vec<SpatialVector>,
    turned: Vec<SpatialVector>,
    asked: Vec<Asked>,
    by_base: Option<RigidGradient>,
}

/// Columns by the inertia of links of one body: changes of its ten entries, in its frame.
#[derive(Debug, Clone)]
struct Inertias {
    body: usize,
    columns: Columns<10>,
}

/// What some columns are the products of with one vector a row.
#[derive(Debug, Clone)]
struct Columns<const N: usize> {
    at: Vec<usize>,
    /// Four columns side by side, entry by entry.
    lanes: Vec<[Lane; N]>,
}

impl<const N: usize> Default for Columns<N> {
    fn default() -> Self {
        Self { at: Vec::new(), lanes: Vec::new() }
    }
}

impl<const N: usize> Columns<N> {
    fn clear(&mut self) {
        self.at.clear();
        self.lanes.clear();
    }

    fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    fn push(&mut self, column: usize, change: &[f64; N]) {
        let lane = self.at.len() % 4;
        if lane == 0 {
            self.lanes.push([[0.0; 4]; N]);
        }
        self.at.push(column);
        if let Some(last) = self.lanes.last_mut() {
            for (to, x) in last.iter_mut().zip(change) {
                to[lane] = *x;
            }
        }
    }

    /// Adds `by . change` to each column of a row.
    #[inline]
    fn add(&self, by: &[f64; N], row: &mut [f64]) {
        for (at, lanes) in self.at.chunks(4).zip(&self.lanes) {
            let mut sum = [0.0; 4];
            for (by, lane) in by.iter().zip(lanes) {
                add_scaled(&mut sum, *by, lane);
            }
            for (column, x) in at.iter().zip(sum) {
                row[*column] += x;
            }
        }
    }
}

/// Columns by the origin and axis of one joint of the models.
#[derive(Debug, Clone)]
struct Joint {
    mount: usize,
    /// Bodies whose subtrees it carries as they are, with the bodies of these.
    carries: Vec<(usize, Vec<usize>)>,
    /// Links that a fixed joint carries.
    links: Vec<usize>,
    /// In the joint's frame.
    twists: Columns<6>,
    turns: Columns<3>,
}

/// What a row of the equations asks of the two bodies of a contact.
#[derive(Debug, Clone, Copy)]
struct Asked {
    next: SpatialVector,
    old: SpatialVector,
    of_a: SpatialVector,
    of_b: SpatialVector,
}

/// Contacts at a solution, after [`ContactWorkspace::differentiate`].
#[derive(Clone, Copy)]
pub(crate) struct Touching<'a> {
    pub contacts: &'a Contacts,
    pub at: &'a ContactWorkspace,
    pub w: &'a [f64],
    pub v: &'a [f64],
}

/// Rows of which the columns by parameters are written.
pub(crate) struct Rows<'a> {
    pub values: &'a mut [f64],
    pub width: usize,
    /// The first of those columns.
    pub first: usize,
}

impl Rows<'_> {
    #[inline]
    fn row(&mut self, v: usize) -> &mut [f64] {
        &mut self.values[v * self.width + self.first..(v + 1) * self.width]
    }
}

impl Plan {
    pub fn new(system: &System, which: &ParameterVector) -> Result<Self, DynamicsError> {
        let zero = SpatialVector::zeros();
        let none = Asked { next: zero, old: zero, of_a: zero, of_b: zero };
        let mut plan = Self {
            which: which.clone(),
            rows: vec![zero; system.multibody().nv()],
            turned: vec![zero; system.multibody().nv()],
            asked: vec![none; system.contacts.as_ref().map_or(0, |c| c.columns)],
            by_base: (!system.sways.is_empty()).then(|| RigidGradient::new(system.multibody())),
            ..Self::default()
        };
        plan.update(system)?;
        if !plan.weights.is_empty() {
            plan.by_weights = vec![0.0; system.residual().map_or(0, |r| r.network().weights().len())];
        }
        Ok(plan)
    }

    pub fn len(&self) -> usize {
        self.which.len()
    }

    /// Are there columns by inertias, armatures, axes or origins?
    pub fn has_rigid(&self) -> bool {
        !(self.inertias.is_empty() && self.joints.is_empty() && self.armatures.is_empty())
    }

    fn moves_contacts(&self) -> bool {
        !(self.joints.is_empty() && self.surfaces.is_empty() && self.shapes.is_empty())
    }

    /// Looks up what the columns change, if the system has changed.
    pub fn update(&mut self, system: &System) -> Result<(), DynamicsError> {
        if self.stamp == Some(system.stamp) || self.which.is_empty() {
            return Ok(());
        }
        let multibody = system.multibody();
        self.armatures.clear();
        self.surfaces.clear();
        self.weights.clear();
        self.theta.fill(NONE);
        self.inertias.iter_mut().for_each(|b| b.columns.clear());
        self.shapes.iter_mut().for_each(|s| s.1.clear());
        for joint in &mut self.joints {
            joint.twists.clear();
            joint.turns.clear();
        }
        let which = std::mem::take(&mut self.which);
        let result = which.directions(system, |column, direction| match direction {
            Direction::Inertia(link, entries) => {
                let frame = &multibody.frames[link];
                let (R, p) = (matrix(&frame.X_BL.rotation), frame.X_BL.translation.vector);
                let on_body = SpatialInertia::from_entries(&entries).moved(&R, &p).entries();
                let at = self.inertias.iter().position(|b| b.body == frame.body).unwrap_or_else(|| {
                    self.inertias.push(Inertias { body: frame.body, columns: Columns::default() });
                    self.inertias.len() - 1
                });
                self.inertias[at].columns.push(column, &on_body);
            }
            Direction::Origin(mount, twist) => joint_of(&mut self.joints, multibody, mount).twists.push(column, &twist.into()),
            Direction::Axis(mount, turn) => joint_of(&mut self.joints, multibody, mount).turns.push(column, &turn.into()),
            Direction::Armature(v, by) => self.armatures.push((column, v, by)),
            Direction::Effect(theta) => {
                if self.theta.is_empty() {
                    self.theta = vec![NONE; system.parameters().len()];
                }
                self.theta[theta] = column;
            }
            Direction::Surface(g, k) => self.surfaces.push((column, g, k)),
            Direction::Shape(g, twist) => {
                let at = self.shapes.iter().position(|s| s.0 == g).unwrap_or_else(|| {
                    self.shapes.push((g, Columns::default()));
                    self.shapes.len() - 1
                });
                self.shapes[at].1.push(column, &twist.into());
            }
            Direction::Weight(k) => self.weights.push((column, k)),
        });
        self.which = which;
        self.stamp = result.is_ok().then_some(system.stamp);
        result
    }

    /// Adds `scale dID/dtheta` at the workspace's state and the accelerations `a`, after [`Multibody::differentiate`]; and what contacts
    /// make of the same parameters, and of their own. `standing`: bases give way, and the workspace has their accelerations.
    #[allow(clippy::too_many_arguments)]
    pub fn add_rigid(
        &mut self,
        multibody: &Multibody,
        ws: &Workspace,
        a: &[f64],
        scale: f64,
        standing: bool,
        touching: Option<Touching<'_>>,
        out: &mut Rows<'_>,
    ) {
        for &(column, v, by) in &self.armatures {
            out.row(v)[column] += scale * by * a[v];
        }
        for block in self.inertias.iter().filter(|b| b.body != 0) {
            let (R, p) = (&ws.R_WB[block.body], &ws.p_WB[block.body]);
            let (A, V) = (to_body(&ws.A[block.body], R, p), to_body(&ws.V[block.body], R, p));
            let mut at = block.body;
            while at != 0 {
                let body = &multibody.bodies[at];
                for (t, v) in body.tree_range().zip(body.v..) {
                    let S = to_body(&ws.S[t], R, p) * scale;
                    let mut by = [0.0; 10];
                    add_inertial(&mut by, &S, &A);
                    add_inertial(&mut by, &cross_motion(&S, &V), &V);
                    block.columns.add(&by, out.row(v));
                }
                at = body.parent;
            }
        }
        let touching = touching.filter(|_| self.moves_contacts());
        if let Some(touching) = &touching {
            touching.ask(&mut self.asked);
        }
        for joint in &self.joints {
            let mount = &multibody.mounts[joint.mount];
            self.rows.fill(SpatialVector::zeros());
            for (i, behind) in &joint.carries {
                displaced_rows(multibody, ws, *i, behind, standing, scale, &mut self.rows);
                if let Some(touching) = &touching {
                    touching.displaced_rows(&self.asked, *i, &mut self.rows);
                }
            }
            for link in &joint.links {
                displaced_link_rows(multibody, ws, *link, scale, &mut self.rows);
                if let Some(touching) = &touching {
                    touching.link_rows(*link, &mut self.rows);
                }
            }
            let turns = !joint.turns.is_empty();
            if turns {
                self.turned.copy_from_slice(&self.rows);
                for (i, behind) in &joint.carries {
                    turned_rows(multibody, ws, a, *i, behind, scale, &mut self.turned);
                    if let Some(touching) = &touching {
                        touching.turned_rows(&self.asked, *i, &mut self.turned);
                    }
                }
            }
            let (R, p) = joint_in_world(multibody, ws, joint.mount);
            let asks =
                |(v, g): &(usize, &SpatialVector)| **g != SpatialVector::zeros() || (turns && self.turned[*v] != SpatialVector::zeros());
            for (v, g) in self.rows.iter().enumerate().filter(asks) {
                let row = &mut out.values[v * out.width + out.first..(v + 1) * out.width];
                let (torque, force) = (tr_mul(&R, &(angular(g) - p.cross(&linear(g)))), tr_mul(&R, &linear(g)));
                joint.twists.add(&join(&torque, &force).into(), row);
                if turns {
                    let (R, p, g) = (&ws.R_WB[mount.body], &ws.p_WB[mount.body], &self.turned[v]);
                    joint.turns.add(&(torque - tr_mul(R, &(angular(g) - p.cross(&linear(g))))).into(), row);
                }
            }
        }
        if let Some(touching) = &touching {
            touching.surfaces(&self.surfaces, out);
            for (g, columns) in &self.shapes {
                self.rows.fill(SpatialVector::zeros());
                touching.shape_rows(*g, &mut self.rows);
                let geometry = &touching.contacts.geometries[*g];
                let (R_B, p_B) = (&ws.R_WB[geometry.body], &ws.p_WB[geometry.body]);
                let (R, p) = (R_B * geometry.R_BG, p_B + R_B * geometry.p_BG);
                for (v, g) in self.rows.iter().enumerate().filter(|(_, g)| **g != SpatialVector::zeros()) {
                    let (torque, force) = (tr_mul(&R, &(angular(g) - p.cross(&linear(g)))), tr_mul(&R, &linear(g)));
                    columns.add(&join(&torque, &force).into(), out.row(v));
                }
            }
        }
    }

    /// Adds `scale` times the gradient of the last sweep, with the parameters in it, to one row's columns.
    pub fn add_sweep(&mut self, multibody: &Multibody, sweep: &Adjoint, scale: f64, row: &mut [f64]) -> Result<(), DynamicsError> {
        let Some(gradient) = &mut self.by_base else { return Ok(()) };
        multibody.rigid_gradient(sweep, gradient)?;
        for block in &self.inertias {
            block.columns.add(&sweep.by_body_inertia(block.body).map(|x| scale * x), row);
        }
        for joint in &self.joints {
            joint.twists.add(&(gradient.origin[joint.mount] * scale).into(), row);
            joint.turns.add(&(sweep.by_turn(multibody.mounts[joint.mount].body) * scale).into(), row);
        }
        Ok(())
    }
}

/// The columns of a joint, with what it carries.
fn joint_of<'a>(joints: &'a mut Vec<Joint>, multibody: &Multibody, mount: usize) -> &'a mut Joint {
    let at = joints.iter().position(|j| j.mount == mount).unwrap_or_else(|| {
        let (mut carries, mut links) = (Vec::new(), Vec::new());
        let mut carry = |body: usize| {
            let mut inside = vec![false; multibody.bodies.len()];
            inside[body] = true;
            for (j, other) in multibody.bodies.iter().enumerate().skip(body + 1) {
                inside[j] = inside[other.parent];
            }
            carries.push((body, (body..multibody.bodies.len()).filter(|j| inside[*j]).collect()));
        };
        let own = &multibody.mounts[mount];
        if own.kind != JointKind::Fixed {
            carry(own.body);
        } else {
            // Each link stands at the place of the joint that carries it.
            let mut carried = vec![false; multibody.mounts.len()];
            carried[mount] = true;
            for (m, other) in multibody.mounts.iter().enumerate() {
                let fixed_to = |p: usize| carried[p] && multibody.mounts[p].kind == JointKind::Fixed;
                carried[m] |= other.parent.is_some_and(fixed_to);
                if carried[m] && other.kind == JointKind::Fixed {
                    links.push(other.child);
                } else if carried[m] {
                    carry(other.body);
                }
            }
        }
        joints.push(Joint { mount, carries, links, twists: Columns::default(), turns: Columns::default() });
        joints.len() - 1
    });
    &mut joints[at]
}

/// A joint's own frame, in which its origin's twists are: for a fixed one that of the link that it carries.
fn joint_in_world(multibody: &Multibody, ws: &Workspace, mount: usize) -> (Matrix3<f64>, Vector3<f64>) {
    let mount = &multibody.mounts[mount];
    let body = &multibody.bodies[mount.body];
    if mount.kind == JointKind::Fixed {
        let X = &multibody.frames[mount.child].X_BL;
        let R = &ws.R_WB[mount.body];
        return (R * matrix(&X.rotation), ws.p_WB[mount.body] + R * X.translation.vector);
    }
    let R = &ws.R_WB[body.parent];
    (R * body.R_PJ, ws.p_WB[body.parent] + R * body.p_PJ)
}

/// `U . E + y . D` as a row on the twist; see the module's first page.
#[inline]
fn pushed_row(A: &SpatialVector, V: &SpatialVector, U: &SpatialVector, y: &Vector3<f64>) -> SpatialVector {
    let mut row = cross_force(V, &cross_force(V, U)) - cross_force(A, U);
    let turn = y.cross(&angular(V));
    for k in 0..3 {
        row[k] += turn[k];
    }
    row
}

/// Adds the rows of inverse dynamics on a twist of all that is behind the joint of body `i`.
fn displaced_rows(
    multibody: &Multibody,
    ws: &Workspace,
    i: usize,
    behind: &[usize],
    standing: bool,
    scale: f64,
    rows: &mut [SpatialVector],
) {
    let parent = multibody.bodies[i].parent;
    let V = &ws.V[parent];
    let A = if standing { ws.A[parent] + ws.bases[i][0] } else { ws.A[parent] };
    let (I, rate, f) = (&ws.composite[i], &ws.variation.rate[i], &ws.variation.inertial[i]);
    let mut at = parent;
    while at != 0 {
        let body = &multibody.bodies[at];
        for (t, v) in body.tree_range().zip(body.v..) {
            let S = &ws.S[t];
            rows[v] += (pushed_row(&A, V, &I.times(S), &rate.transposed_times(S)) - cross_force(S, f)) * scale;
        }
        at = body.parent;
    }
    for &j in behind {
        let (body, e) = (&multibody.bodies[j], &ws.variation.external[j]);
        for (t, v) in body.tree_range().zip(body.v..) {
            rows[v] += (pushed_row(&A, V, &ws.IS[t], &ws.variation.y[t]) - cross_force(&ws.S[t], e)) * scale;
        }
    }
}

/// Adds the rows of inverse dynamics on a twist of one link on its body: its inertia moves.
fn displaced_link_rows(multibody: &Multibody, ws: &Workspace, link: usize, scale: f64, rows: &mut [SpatialVector]) {
    let frame = &multibody.frames[link];
    if frame.body == 0 {
        return;
    }
    let on_body = frame.inertia.moved(&matrix(&frame.X_BL.rotation), &frame.X_BL.translation.vector);
    let I = on_body.moved(&ws.R_WB[frame.body], &ws.p_WB[frame.body]);
    let (A, V) = (&ws.A[frame.body], &ws.V[frame.body]);
    let P = I.times(V);
    let F = I.times(A) + cross_force(V, &P);
    let mut at = frame.body;
    while at != 0 {
        let body = &multibody.bodies[at];
        for (t, v) in body.tree_range().zip(body.v..) {
            let S = &ws.S[t];
            // The body's motion turns the other way, as seen from the link, and the link's force along.
            let turned = cross_force(V, &(cross_force(S, &P) + I.times(&cross_motion(V, S))));
            rows[v] += (turned - cross_force(A, &I.times(S)) - cross_force(S, &F)) * scale;
        }
        at = body.parent;
    }
}

/// Takes off the rows of inverse dynamics on a twist of the child's frame that turns the motion subspace of body `i` alone.
fn turned_rows(multibody: &Multibody, ws: &Workspace, a: &[f64], i: usize, behind: &[usize], scale: f64, rows: &mut [SpatialVector]) {
    let own = &multibody.bodies[i];
    let (mut Sv, mut Sa) = (SpatialVector::zeros(), SpatialVector::zeros());
    for (t, v) in own.tree_range().zip(own.v..) {
        Sv += ws.S[t] * ws.v[v];
        Sa += ws.S[t] * a[v];
    }
    // With T for the twist: dV = X = T x S v, dA = Y + X x V_j with Y = T x S a + (V_P + V_i) x X.
    let both = ws.V[own.parent] + ws.V[i];
    let row = |U: &SpatialVector, y: &Vector3<f64>| {
        let by_X = join(y, &Vector3::zeros()) - cross_force(&both, U);
        cross_force(&Sa, U) + cross_force(&Sv, &by_X)
    };
    let (I, rate) = (&ws.composite[i], &ws.variation.rate[i]);
    let mut at = own.parent;
    while at != 0 {
        let body = &multibody.bodies[at];
        for (t, v) in body.tree_range().zip(body.v..) {
            let S = &ws.S[t];
            rows[v] -= row(&I.times(S), &rate.transposed_times(S)) * scale;
        }
        at = body.parent;
    }
    for &j in behind {
        let body = &multibody.bodies[j];
        for (t, v) in body.tree_range().zip(body.v..) {
            rows[v] -= row(&ws.IS[t], &ws.variation.y[t]) * scale;
        }
    }
    let force = ws.variation.inertial[i] - ws.variation.external[i];
    for (t, v) in own.tree_range().zip(own.v..) {
        rows[v] -= cross_force(&ws.S[t], &force) * scale;
    }
}

impl Touching<'_> {
    /// What each column of the relative Jacobians asks of the two bodies.
    fn ask(&self, asked: &mut [Asked]) {
        for (active, wrench) in self.at.active.iter().zip(&self.at.by_active) {
            let group = &self.contacts.groups[active.group];
            let range = group.start..group.start + group.columns.len();
            for (asked, J) in asked[range.clone()].iter_mut().zip(&self.at.J[range]) {
                *asked = ask(wrench, &active.V, &active.V0, J);
            }
        }
    }

    /// Adds the rows on a twist of all that is behind the joint of body `i`.
    fn displaced_rows(&self, asked: &[Asked], i: usize, rows: &mut [SpatialVector]) {
        for (active, wrench) in self.at.active.iter().zip(&self.at.by_active) {
            let group = &self.contacts.groups[active.group];
            // A joint that moves both bodies has no column, and changes nothing.
            let Some(own) = group.columns.iter().find(|c| c.body == i) else { continue };
            let carried = |c: &crate::contact::Column| c.moves_a == own.moves_a && c.body >= i;
            let J = &self.at.J[group.start..group.start + group.columns.len()];
            let (mut U, mut U0) = (SpatialVector::zeros(), SpatialVector::zeros());
            for (J, c) in J.iter().zip(&group.columns).filter(|(_, c)| carried(c)) {
                U += J * self.w[c.v];
                U0 += J * self.v[c.v];
            }
            for ((J, c), asked) in J.iter().zip(&group.columns).zip(&asked[group.start..]) {
                let mut g = if own.moves_a { asked.of_a } else { asked.of_b };
                g += cross_force(&U, &asked.next) + cross_force(&U0, &asked.old);
                if carried(c) {
                    g += cross_force(J, &wrench.F);
                }
                rows[c.v] -= g;
            }
        }
    }

    /// Takes off the rows on a twist that turns the motion subspace of body `i` alone.
    fn turned_rows(&self, asked: &[Asked], i: usize, rows: &mut [SpatialVector]) {
        for (active, wrench) in self.at.active.iter().zip(&self.at.by_active) {
            let group = &self.contacts.groups[active.group];
            let J = &self.at.J[group.start..group.start + group.columns.len()];
            let (mut U, mut U0) = (SpatialVector::zeros(), SpatialVector::zeros());
            let mut moved = false;
            for (J, c) in J.iter().zip(&group.columns).filter(|(_, c)| c.body == i) {
                U += J * self.w[c.v];
                U0 += J * self.v[c.v];
                rows[c.v] += cross_force(J, &wrench.F);
                moved = true;
            }
            if moved {
                for (c, asked) in group.columns.iter().zip(&asked[group.start..]) {
                    rows[c.v] += cross_force(&U, &asked.next) + cross_force(&U0, &asked.old);
                }
            }
        }
    }

    /// Adds the rows on a twist of one shape on its body.
    fn shape_rows(&self, g: usize, rows: &mut [SpatialVector]) {
        self.pair_rows(rows, |pair| [pair.a == g, pair.b == g]);
    }

    /// Adds the rows on a twist of one link on its body, with its shapes and the grasps on it.
    fn link_rows(&self, link: usize, rows: &mut [SpatialVector]) {
        let on = |g: usize| self.contacts.geometries[g].frame == Some(link);
        self.pair_rows(rows, |pair| [on(pair.a), on(pair.b)]);
        for (bushing, grasp) in self.at.bushings.iter().zip(&self.contacts.grasps) {
            let moved = [grasp.a.0 == link, grasp.b.0 == link];
            if moved == [false; 2] {
                continue;
            }
            let V = &self.at.active[bushing.slot].V;
            let wrench =
                Wrench { F: bushing.held.impulse(V), by_pose: bushing.held.by_pose(V), by_V: -bushing.held.slope(V), ..Wrench::default() };
            self.wrench_rows(bushing.slot, &wrench, moved, rows);
        }
    }

    fn pair_rows(&self, rows: &mut [SpatialVector], moved: impl Fn(&crate::contact::geometry::Pair) -> [bool; 2]) {
        for (touching, wrench) in self.at.touching.iter().zip(&self.at.by_pair) {
            let moved = moved(&self.contacts.pairs[touching.pair]);
            if moved != [false; 2] {
                self.wrench_rows(touching.slot, wrench, moved, rows);
            }
        }
    }

    fn wrench_rows(&self, slot: usize, wrench: &Wrench, [a, b]: [bool; 2], rows: &mut [SpatialVector]) {
        let active = &self.at.active[slot];
        let group = &self.contacts.groups[active.group];
        for (J, c) in self.at.J[group.start..].iter().zip(&group.columns) {
            let asked = ask(wrench, &active.V, &active.V0, J);
            if a {
                rows[c.v] -= asked.of_a;
            }
            if b {
                rows[c.v] -= asked.of_b;
            }
        }
    }

    fn surfaces(&self, columns: &[(usize, usize, usize)], out: &mut Rows<'_>) {
        for (touching, wrench) in self.at.touching.iter().zip(&self.at.by_pair) {
            let pair = &self.contacts.pairs[touching.pair];
            let group = &self.contacts.groups[self.at.active[touching.slot].group];
            for &(column, g, k) in columns.iter().filter(|c| c.1 == pair.a || c.1 == pair.b) {
                let other = if g == pair.a { pair.b } else { pair.a };
                let slope = self.contacts.geometries[g].material.between_by_self(&self.contacts.geometries[other].material);
                // Columns of the slope: stiffness, dissipation, friction.
                let by = slope.column([2, 0, 1][k]);
                let dF = wrench.by_material[1] * by[0] + wrench.by_material[2] * by[1] + wrench.by_material[0] * by[2];
                for (J, c) in self.at.J[group.start..].iter().zip(&group.columns) {
                    out.row(c.v)[column] -= dot(J, &dF);
                }
            }
        }
    }
}

/// What a row with the multiplier `J` asks of the two bodies that a wrench acts between.
fn ask(wrench: &Wrench, V: &SpatialVector, V0: &SpatialVector, J: &SpatialVector) -> Asked {
    let (next, old, of_a) = (wrench.by_V.tr_mul(J), wrench.by_V0.tr_mul(J), wrench.by_pose.tr_mul(J));
    let of_b = -cross_force(J, &wrench.F) - cross_force(V, &next) - cross_force(V0, &old) - of_a;
    Asked { next, old, of_a, of_b }
}
