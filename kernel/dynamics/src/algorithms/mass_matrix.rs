//! Composite rigid bodies (Featherstone 2008, section 6.2, in world coordinates): with the inertia `I^C` of all that a
//! joint carries, `M_ij = S_i^T I^C_j S_j` for `i` on the path from `j` to the root.

use nalgebra::DMatrix;

use crate::linear::{cholesky, cholesky_solve};
use crate::multibody::length;
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
        ws.composite.copy_from_slice(&ws.inertia);
        ws.M.fill(0.0);
        for (i, armature) in self.armature.iter().enumerate() {
            ws.M[(i, i)] = *armature;
        }
        for i in (1..self.bodies.len()).rev() {
            let body = &self.bodies[i];
            let inertia = ws.composite[i];
            if body.parent != 0 {
                ws.composite[body.parent] += inertia;
            }
            for k in 0..body.nv {
                let F = inertia.times(&ws.S[body.tree + k]);
                let column = body.v + k;
                for l in 0..=k {
                    add(&mut ws.M, body.v + l, column, l == k, ws.S[body.tree + l].dot(&F));
                }
                let mut at = body.parent;
                while at != 0 {
                    let ancestor = &self.bodies[at];
                    for l in 0..ancestor.nv {
                        let entry = ws.S[ancestor.tree + l].dot(&F);
                        add(&mut ws.M, ancestor.v + l, column, false, entry);
                    }
                    at = ancestor.parent;
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
        ws.factor.copy_from_slice(ws.M.as_slice());
        cholesky(&mut ws.factor, self.nv).map_err(|pivot| self.no_inertia(pivot))
    }

    /// Replaces `x` by `M^-1 x`, with the factor of the last [`Self::factor_mass_matrix`].
    ///
    /// # Errors
    /// `x` of the wrong length; a workspace of another multibody.
    pub fn solve_mass_matrix(&self, ws: &Workspace, x: &mut [f64]) -> Result<(), DynamicsError> {
        self.owns(ws)?;
        length("x", x.len(), self.nv)?;
        cholesky_solve(&ws.factor, self.nv, x);
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
fn add(M: &mut DMatrix<f64>, i: usize, j: usize, same: bool, entry: f64) {
    if same {
        M[(i, i)] += entry;
    } else if i == j {
        M[(i, i)] += 2.0 * entry;
    } else {
        M[(i, j)] += entry;
        M[(j, i)] += entry;
    }
}
