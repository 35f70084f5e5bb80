//! Composite rigid bodies (Featherstone 2008, section 6.2, in world coordinates): with the inertia `I^C` of all that a
//! joint carries, `M_ij = S_i^T I^C_j S_j` for `i` on the path from `j` to the root.

use nalgebra::DMatrix;

use crate::linear::{tree_factor, tree_solve};
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
        let Workspace { S, S_lanes, IS, inertia, composite, M, scratch_row: row, .. } = ws;
        let M = M.as_mut_slice();
        composite.copy_from_slice(inertia);
        for (t, S) in S.iter().enumerate() {
            for r in 0..6 {
                S_lanes[t / 4][r][t % 4] = S[r];
            }
        }
        if self.has_followers {
            M.fill(0.0);
            for (i, armature) in self.armature.iter().enumerate() {
                M[i * n + i] = *armature;
            }
        }
        for (i, body) in self.bodies.iter().enumerate().skip(1).rev() {
            let I = composite[i];
            if body.parent != 0 {
                composite[body.parent] += I;
            }
            for (k, t) in body.tree_range().enumerate() {
                let F = I.times(&S[t]);
                IS[t] = F;
                for (S, out) in S_lanes[body.first / 4..=t / 4].iter().zip(&mut row[body.first / 4..=t / 4]) {
                    let mut sum = [0.0; 4];
                    for r in 0..6 {
                        add_scaled(&mut sum, F[r], &S[r]);
                    }
                    *out = sum;
                }
                let row = row.as_flattened();
                if self.has_followers {
                    let v = body.v + k;
                    for (l, entry) in (body.tree..t + 1).enumerate() {
                        add(M, n, body.v + l, v, entry == t, row[entry]);
                    }
                    let mut at = body.parent;
                    while at != 0 {
                        let inner = &self.bodies[at];
                        for (l, entry) in inner.tree_range().enumerate() {
                            add(M, n, inner.v + l, v, false, row[entry]);
                        }
                        at = inner.parent;
                    }
                } else {
                    // Entries between branches are zero, and are never written.
                    let mut at = i;
                    while at != 0 {
                        let inner = &self.bodies[at];
                        for l in inner.tree..inner.tree + inner.nv.min(t + 1 - inner.tree) {
                            M[t * n + l] = row[l];
                            M[l * n + t] = row[l];
                        }
                        at = inner.parent;
                    }
                    M[t * n + t] += self.armature[t];
                }
            }
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
        ws.tree_factor.copy_from_slice(ws.M.as_slice());
        tree_factor(&mut ws.tree_factor, &self.before).map_err(|pivot| self.no_inertia(pivot))
    }

    /// Replaces `x` by `M^-1 x`, with the factor of the last [`Self::factor_mass_matrix`].
    ///
    /// # Errors
    /// `x` of the wrong length; a workspace of another multibody.
    pub fn solve_mass_matrix(&self, ws: &Workspace, x: &mut [f64]) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        length("x", x.len(), self.nv)?;
        tree_solve(&ws.tree_factor, &self.before, x);
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
