use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::algorithms::derivatives::Variation;
use crate::spatial::ArticulatedInertia;
use crate::{LinkId, Multibody, SpatialInertia, SpatialVector};

/// Four columns side by side: what the processor multiplies at once.
pub(crate) type Lane = [f64; 4];

/// `to += a x`, lane by lane.
#[inline(always)]
pub(crate) fn add_scaled(to: &mut Lane, a: f64, x: &Lane) {
    for (to, x) in to.iter_mut().zip(x) {
        *to += a * x;
    }
}

/// Everything that changes while one multibody is computed with. Made once by [`crate::Multibody::workspace`]; nothing
/// allocates afterwards. It always holds a state: at first the neutral one at rest.
///
/// Index 0 of the arrays by body is the world. Spatial quantities are in the world's axes at the world's origin.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// Positions of the state.
    pub(crate) q: Vec<f64>,
    /// Velocities of the state.
    pub(crate) v: Vec<f64>,
    /// Pose of each body.
    pub(crate) R_WB: Vec<Matrix3<f64>>,
    pub(crate) p_WB: Vec<Vector3<f64>>,
    /// Motion subspace, one column a degree of freedom of the tree.
    pub(crate) S: Vec<SpatialVector>,
    /// Inertia of each body.
    pub(crate) inertia: Vec<SpatialInertia>,
    /// Velocity of each body.
    pub(crate) V: Vec<SpatialVector>,
    /// `V_i x S_i v_i`: acceleration that each joint adds at constant `v`.
    pub(crate) c: Vec<SpatialVector>,
    /// Acceleration, then scratch.
    pub(crate) A: Vec<SpatialVector>,
    /// Momentum.
    pub(crate) P: Vec<SpatialVector>,
    /// The force that each body's inertia needs, without external ones.
    pub(crate) inertial: Vec<SpatialVector>,
    /// Forces, then scratch.
    pub(crate) F: Vec<SpatialVector>,
    /// External force on each body; zero unless being applied.
    pub(crate) external: Vec<SpatialVector>,
    /// Composite inertias.
    pub(crate) composite: Vec<SpatialInertia>,
    /// Articulated inertias and bias forces, with what the acceleration pass needs again.
    pub(crate) articulated: Vec<ArticulatedInertia>,
    pub(crate) bias_force: Vec<SpatialVector>,
    pub(crate) U: Vec<SpatialVector>,
    /// Factor of each joint's inertia, 6 x 6 at most, and its right-hand side.
    pub(crate) D: Vec<[f64; 36]>,
    pub(crate) u: Vec<f64>,
    /// `S` by lanes: entry `r` of four columns side by side.
    pub(crate) S_lanes: Vec<[Lane; 6]>,
    /// Composite inertia times `S`, by degree of freedom of the tree.
    pub(crate) IS: Vec<SpatialVector>,
    /// Mass matrix, and its factor [`crate::linear::tree_factor`].
    pub(crate) M: DMatrix<f64>,
    pub(crate) tree_factor: Vec<Lane>,
    /// The lower triangle of the mass matrix that the tree would have if no joint followed another, by lanes, without armature.
    pub(crate) tree_rows: Vec<Lane>,
    /// Scratch by velocity.
    pub(crate) scratch: Vec<f64>,
    /// What derivatives need.
    pub(crate) variation: Variation,
    /// Acceleration, and virtual velocity, that what a body's joint stands on has beyond its parent: of bases that give way. Only
    /// the passes that say so look at it.
    pub(crate) bases: Vec<[SpatialVector; 2]>,
}

/// A force on a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExternalWrench {
    /// The link.
    pub link: LinkId,
    /// `[torque; force]` in the world's axes at the world's origin (N m, N): see [`crate::wrench_at_origin`].
    pub F_W: SpatialVector,
}

impl Workspace {
    pub(crate) fn new(multibody: &Multibody) -> Self {
        let (b, t, n) = (multibody.bodies.len(), multibody.tree, multibody.nv);
        let mut ws = Self {
            q: vec![0.0; multibody.nq],
            v: vec![0.0; n],
            R_WB: vec![Matrix3::identity(); b],
            p_WB: vec![Vector3::zeros(); b],
            S: vec![SpatialVector::zeros(); t],
            inertia: vec![SpatialInertia::ZERO; b],
            V: vec![SpatialVector::zeros(); b],
            c: vec![SpatialVector::zeros(); b],
            A: vec![SpatialVector::zeros(); b],
            P: vec![SpatialVector::zeros(); b],
            inertial: vec![SpatialVector::zeros(); b],
            F: vec![SpatialVector::zeros(); b],
            external: vec![SpatialVector::zeros(); b],
            composite: vec![SpatialInertia::ZERO; b],
            articulated: vec![ArticulatedInertia::ZERO; b],
            bias_force: vec![SpatialVector::zeros(); b],
            U: vec![SpatialVector::zeros(); t],
            D: vec![[0.0; 36]; b],
            u: vec![0.0; t],
            M: DMatrix::zeros(n, n),
            S_lanes: vec![[[0.0; 4]; 6]; t.div_ceil(4)],
            IS: vec![SpatialVector::zeros(); t],
            tree_factor: vec![[0.0; 4]; n * n.div_ceil(4)],
            scratch: vec![0.0; n],
            tree_rows: vec![[0.0; 4]; t * t.div_ceil(4)],
            variation: Variation::new(multibody),
            bases: vec![[SpatialVector::zeros(); 2]; b],
        };
        multibody.neutral_positions(&mut ws.q);
        multibody.kinematics(&mut ws);
        ws
    }

    /// Positions of the state that was set last.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Velocities of the state that was set last.
    pub fn v(&self) -> &[f64] {
        &self.v
    }
}
