//! Composite rigid bodies (Featherstone 2008, section 6.2, in world coordinates): with the inertia `I^C` of all that a
//! joint carries, `M_ij = S_i^T I^C_j S_j` for `i` on the path from `j` to the root.

use nalgebra::DMatrix;

use crate::linear::{tree_factor, tree_solve};
use crate::multibody::length;
use crate::{DynamicsError, Multibody, SpatialVector, Workspace};

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
        let (n, size) = (self.nv, self.tree);
        let Workspace { S, S_rows, IS, inertia, composite, M, scratch_row: row, .. } = ws;
        let M = M.as_mut_slice();
        composite.copy_from_slice(inertia);
        for (t, S) in S.iter().enumerate() {
            for r in 0..6 {
                S_rows[r * size + t] = S[r];
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
                let row = &mut row[..t + 1 - body.first];
                rows(S_rows, size, body.first, &F, row);
                if self.has_followers {
                    let v = body.v + k;
                    for (l, entry) in (body.tree..t + 1).enumerate() {
                        add(M, n, body.v + l, v, entry == t, row[entry - body.first]);
                    }
                    let mut at = body.parent;
                    while at != 0 {
                        let inner = &self.bodies[at];
                        for (l, entry) in inner.tree_range().enumerate() {
                            add(M, n, inner.v + l, v, false, row[entry - body.first]);
                        }
                        at = inner.parent;
                    }
                } else {
                    // Entries between branches are zero, and are never written.
                    let mut at = i;
                    while at != 0 {
                        let inner = &self.bodies[at];
                        for l in inner.tree..inner.tree + inner.nv.min(t + 1 - inner.tree) {
                            M[t * n + l] = row[l - body.first];
                            M[l * n + t] = row[l - body.first];
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

/// `row_k = F . S_k` for the columns from `first` on.
#[inline]
fn rows(S_rows: &[f64], size: usize, first: usize, F: &SpatialVector, row: &mut [f64]) {
    let m = row.len();
    let [a, b, c, d, e, f] = [0, 1, 2, 3, 4, 5].map(|r| &S_rows[r * size + first..r * size + first + m]);
    for k in 0..m {
        row[k] = F[0] * a[k] + F[1] * b[k] + F[2] * c[k] + F[3] * d[k] + F[4] * e[k] + F[5] * f[k];
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
