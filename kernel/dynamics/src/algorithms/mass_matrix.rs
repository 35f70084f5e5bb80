//! Composite rigid bodies (Featherstone 2008, section 6.2, in world coordinates): with the inertia `I^C` of all that a
//! joint carries, `M_ij = S_i^T I^C_j S_j` for `i` on the path from `j` to the root.

use nalgebra::DMatrix;

use crate::linear::{into_lanes, tree_factor, tree_solve};
use crate::multibody::length;
use crate::workspace::add_scaled;
use crate::{DynamicsError, Multibody, Workspace};

impl Multibody {
    /// The mass matrix (nv x nv, symmetric), armature included.
    ///
    /// # Errors
    /// A workspace of another multibody.
    pub fn mass_matrix<'a>(&self, ws: &'a mut Workspace) -> Result<&'a DMatrix<f64>, DynamicsError> {
        self.owns(ws)?;
        self.composite(ws);
        Ok(&ws.M)
    }

    pub(crate) fn composite(&self, ws: &mut Workspace) {
        let n = self.nv;
        let Workspace { S, S_lanes, IS, inertia, composite, M, tree_rows: rows, .. } = ws;
        let M = M.as_mut_slice();
        let width = S_lanes.len();
        for (S, lanes) in S.chunks(4).zip(S_lanes.iter_mut()) {
            for (lane, S) in S.iter().enumerate() {
                for r in 0..6 {
                    lanes[r][lane] = S[r];
                }
            }
        }
        composite.copy_from_slice(inertia);
        for (i, body) in self.bodies.iter().enumerate().skip(1).rev() {
            let I = composite[i];
            if body.parent != 0 {
                composite[body.parent] += I;
            }
            for t in body.tree_range() {
                let F = I.times(&S[t]);
                IS[t] = F;
                let blocks = body.first / 4..t / 4 + 1;
                let row = &mut rows[t * width..(t + 1) * width];
                let along = &self.along[t * width..(t + 1) * width];
                for ((S, out), along) in S_lanes[blocks.clone()].iter().zip(&mut row[blocks.clone()]).zip(&along[blocks]) {
                    let mut sum = [0.0; 4];
                    for r in 0..6 {
                        add_scaled(&mut sum, F[r], &S[r]);
                    }
                    *out = [sum[0] * along[0], sum[1] * along[1], sum[2] * along[2], sum[3] * along[3]];
                }
            }
        }
        let rows = rows.as_flattened();
        if self.has_followers {
            M.fill(0.0);
            for (body, t) in self.bodies.iter().flat_map(|body| body.tree_range().map(move |t| (body, t))) {
                let v = body.v + t - body.tree;
                let row = &rows[4 * width * t..4 * width * t + t + 1];
                for (l, entry) in (body.tree..t + 1).zip(&row[body.tree..]) {
                    add(M, n, body.v + l - body.tree, v, l == t, *entry);
                }
                let mut at = body.parent;
                while at != 0 {
                    let inner = &self.bodies[at];
                    for (l, entry) in row[inner.tree_range()].iter().enumerate() {
                        add(M, n, inner.v + l, v, false, *entry);
                    }
                    at = inner.parent;
                }
            }
        } else {
            for t in 0..n {
                let row = &rows[4 * width * t..4 * width * t + t + 1];
                let (above, left) = M.split_at_mut(t * n);
                left[t] = row[t];
                for ((entry, left), above) in row[..t].iter().zip(left).zip(above[t..].iter_mut().step_by(n)) {
                    (*left, *above) = (*entry, *entry);
                }
            }
        }
        for (d, armature) in M.iter_mut().step_by(n + 1).zip(&self.armature) {
            *d += armature;
        }
    }

    /// Factors the mass matrix of the workspace's state, for [`Self::solve_mass_matrix`].
    ///
    /// # Errors
    /// A joint moves no inertia; a workspace of another multibody.
    pub fn factor_mass_matrix(&self, ws: &mut Workspace) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        self.composite(ws);
        self.factor(ws)
    }

    pub(crate) fn factor(&self, ws: &mut Workspace) -> Result<(), DynamicsError> {
        if self.has_followers {
            into_lanes(ws.M.as_slice(), self.nv, &mut ws.tree_factor);
        } else {
            ws.tree_factor.copy_from_slice(&ws.tree_rows);
            for (k, (row, armature)) in ws.tree_factor.chunks_exact_mut(self.nv.div_ceil(4).max(1)).zip(&self.armature).enumerate() {
                row[k / 4][k % 4] += armature;
            }
        }
        tree_factor(&mut ws.tree_factor, &self.before).map_err(|pivot| self.no_inertia(pivot))
    }

    /// Replaces `x` by `M^-1 x`, with the factor of the last [`Self::factor_mass_matrix`].
    ///
    /// # Errors
    /// `x` of the wrong length; a workspace of another multibody.
    pub fn solve_mass_matrix(&self, ws: &Workspace, x: &mut [f64]) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        length("x", x.len(), self.nv)?;
        tree_solve(&ws.tree_factor, x);
        Ok(())
    }

    pub(crate) fn no_inertia(&self, v: usize) -> DynamicsError {
        let joint = self.joints.iter().find(|j| j.v.contains(&v)).map_or_else(String::new, |j| j.name.clone());
        DynamicsError::NoInertia { joint }
    }
}

/// Adds the pair of tree entries (i, j) and (j, i) to the entries of the velocities they belong to. Joints that follow
/// the same joint share its entry, and then both of the pair fall on the diagonal.
#[inline]
fn add(M: &mut [f64], n: usize, i: usize, j: usize, same: bool, entry: f64) {
    if same {
        M[i * n + i] += entry;
    } else if i == j {
        M[i * n + i] += 2.0 * entry;
    } else {
        M[i * n + j] += entry;
        M[j * n + i] += entry;
    }
}
