//! Mass matrix and bias of the rigid bodies: `M(q) a + c(q, v) + g(q) = tau`.
//!
//! One joint has its closed form: `M` is constant and gravity is `a sin q + b cos q + c`. More joints: composite bodies for `M`,
//! Newton and Euler from root to tips and back for the bias (Luh, Walker, Paul 1980; Featherstone 2008), in world axes about the
//! world's origin, angular part first.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Matrix6, Vector3, Vector6};
use sagci_model::{JointKind, ObjectModel};

use crate::EvaluationError;

/// Gravity, m/s^2.
const GRAVITY: f64 = 9.81;

/// Rigid bodies of a tree of joints of one degree of freedom.
#[derive(Debug, Clone)]
pub(crate) enum Rigid {
    One { mass: f64, sin: f64, cos: f64, constant: f64 },
    Many(Box<Tree>),
}

/// The general case.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    model: ObjectModel,
    /// For each joint of the model its place in `q`.
    slot: Vec<Option<usize>>,
    count: usize,
}

impl Rigid {
    /// # Errors
    /// A joint of more than one degree of freedom.
    pub(crate) fn new(model: &ObjectModel) -> Result<Self, EvaluationError> {
        let mut slot = vec![None; model.joints.len()];
        let mut count = 0;
        for joint in model.moving_joints() {
            let j = &model.joints[joint];
            if !matches!(j.kind, JointKind::Revolute | JointKind::Continuous | JointKind::Prismatic) {
                return Err(EvaluationError::Model { message: format!("the joint '{}' is neither a hinge nor a slide", j.name) });
            }
            slot[joint] = Some(count);
            count += 1;
        }
        let tree = Tree { model: model.clone(), slot, count };
        if count != 1 {
            return Ok(Self::Many(Box::new(tree)));
        }
        let bias = |q: f64| tree.at(&[q], &[0.0]).1[0];
        let mass = tree.at(&[0.0], &[0.0]).0[(0, 0)];
        let turns = model.moving_joints().next().is_some_and(|j| model.joints[j].kind != JointKind::Prismatic);
        if !turns {
            return Ok(Self::One { mass, sin: 0.0, cos: 0.0, constant: bias(0.0) });
        }
        let (here, there) = (bias(0.0), bias(std::f64::consts::PI));
        let constant = (here + there) / 2.0;
        Ok(Self::One { mass, sin: bias(std::f64::consts::FRAC_PI_2) - constant, cos: (here - there) / 2.0, constant })
    }

    /// Mass matrix and bias.
    pub(crate) fn at(&self, q: &[f64], v: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        match self {
            Self::One { .. } => {
                let (mass, bias) = self.one(q[0]);
                (DMatrix::from_element(1, 1, mass), DVector::from_element(1, bias))
            }
            Self::Many(tree) => tree.at(q, v),
        }
    }

    /// Mass and bias of a single joint.
    pub(crate) fn one(&self, q: f64) -> (f64, f64) {
        match self {
            Self::One { mass, sin, cos, constant } => {
                let (s, c) = q.sin_cos();
                (*mass, sin * s + cos * c + constant)
            }
            Self::Many(_) => (f64::NAN, f64::NAN),
        }
    }

    /// Generalised force that holds the mechanism still.
    pub(crate) fn gravity(&self, q: &[f64]) -> Vec<f64> {
        self.at(q, &vec![0.0; q.len()]).1.iter().copied().collect()
    }
}

fn skew(p: &Vector3<f64>) -> Matrix3<f64> {
    p.cross_matrix()
}

fn split(a: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(a[0], a[1], a[2]), Vector3::new(a[3], a[4], a[5]))
}

fn join(a: Vector3<f64>, b: Vector3<f64>) -> Vector6<f64> {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}

impl Tree {
    fn at(&self, q: &[f64], v: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let model = &self.model;
        let links = model.links.len();
        let mut X_WL = vec![Isometry3::identity(); links];
        let mut V = vec![Vector6::zeros(); links];
        // Gravity as an acceleration of the root, upwards.
        let mut A = vec![Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY); links];
        let mut S = vec![Vector6::zeros(); model.joints.len()];
        for (i, joint) in model.joints.iter().enumerate() {
            let slot = self.slot[i];
            let (qi, vi) = slot.map_or((0.0, 0.0), |s| (q[s], v[s]));
            X_WL[joint.child] = X_WL[joint.parent] * model.X_PC(i, qi);
            let X_WJ = X_WL[joint.parent] * joint.X_PJ;
            let axis = X_WJ * joint.axis.into_inner();
            if slot.is_some() {
                S[i] = match joint.kind {
                    JointKind::Prismatic => join(Vector3::zeros(), axis),
                    _ => join(axis, X_WJ.translation.vector.cross(&axis)),
                };
            }
            let own = S[i] * vi;
            let (w, l) = split(&V[joint.parent]);
            let (ow, ol) = split(&own);
            V[joint.child] = V[joint.parent] + own;
            A[joint.child] = A[joint.parent] + join(w.cross(&ow), w.cross(&ol) + l.cross(&ow));
        }
        let mut inertia: Vec<Matrix6<f64>> = Vec::with_capacity(links);
        let mut F: Vec<Vector6<f64>> = Vec::with_capacity(links);
        for (i, link) in model.links.iter().enumerate() {
            let R = X_WL[i].rotation.to_rotation_matrix();
            let c = (X_WL[i] * link.inertial.p_LoLcm).coords;
            let m = link.inertial.mass;
            let cx = skew(&c);
            let mut I = Matrix6::zeros();
            I.fixed_view_mut::<3, 3>(0, 0).copy_from(&(R * link.inertial.I_LLcm_L * R.transpose() - m * cx * cx));
            I.fixed_view_mut::<3, 3>(0, 3).copy_from(&(m * cx));
            I.fixed_view_mut::<3, 3>(3, 0).copy_from(&(-m * cx));
            I.fixed_view_mut::<3, 3>(3, 3).copy_from(&(m * Matrix3::identity()));
            let (w, l) = split(&V[i]);
            let (n, f) = split(&(I * V[i]));
            F.push(I * A[i] + join(w.cross(&n) + l.cross(&f), w.cross(&f)));
            inertia.push(I);
        }
        let mut M = DMatrix::zeros(self.count, self.count);
        let mut bias = DVector::zeros(self.count);
        for (i, joint) in model.joints.iter().enumerate().rev() {
            if let Some(s) = self.slot[i] {
                bias[s] = S[i].dot(&F[joint.child]);
                let force = inertia[joint.child] * S[i];
                // Every joint between this one and the root feels it.
                let mut at = Some(i);
                while let Some(j) = at {
                    if let Some(r) = self.slot[j] {
                        let value = S[j].dot(&force);
                        (M[(r, s)], M[(s, r)]) = (value, value);
                    }
                    at = model.joints.iter().position(|k| k.child == model.joints[j].parent);
                }
            }
            let (I, f) = (inertia[joint.child], F[joint.child]);
            inertia[joint.parent] += I;
            F[joint.parent] += f;
        }
        (M, bias)
    }
}
