//! A hypothesis: where the root link and the joints are, and how a point of a link moves with them.
//!
//! Parameters are the turn about the world's axes at the object's origin, the shift of that origin, and one position for
//! each joint that is estimated: `dp_W = omega x (p - p_WO) + v + sum_j dq_j s_j(p)`, with `s_j = a x (p - o)` for a
//! revolute joint of axis `a` through `o` and `s_j = a` for a prismatic one. The last six are the turn and the shift of the
//! camera `D` as it is against the camera `C` as the robot's model has it, the same in all views: a wrist camera is known
//! to some millimetres and milliradians only, and all that it sees shares that error.

use nalgebra::{DVector, Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use sagci_model::{JointKind, ObjectModel};

use crate::JointSearch;

/// Where the root link and the joints are.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hypothesis {
    pub X_WO: Isometry3<f64>,
    pub q: Vec<f64>,
    /// Where the camera is against where it is said to be.
    pub X_CD: Isometry3<f64>,
}

/// A joint that moves a link, as it lies in the world.
#[derive(Debug, Clone, Copy)]
struct Mover {
    parameter: usize,
    axis: Vector3<f64>,
    origin: Point3<f64>,
    slides: bool,
    factor: f64,
}

/// The links' poses under a hypothesis, and how they move with the parameters.
pub(crate) struct Placed {
    pub X_WL: Vec<Isometry3<f64>>,
    origin: Point3<f64>,
    movers: Vec<Vec<Mover>>,
}

impl Hypothesis {
    /// Moves by parameters: turn, shift, joints, camera.
    pub fn moved(&self, step: &DVector<f64>, joints: &[JointSearch]) -> Self {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        let shift = Vector3::new(step[3], step[4], step[5]);
        let X_WO = Isometry3::from_parts(Translation3::from(self.X_WO.translation.vector + shift), turn * self.X_WO.rotation);
        let mut q = self.q.clone();
        for (k, joint) in joints.iter().enumerate() {
            if let Some(position) = q.get_mut(joint.slot) {
                *position = (*position + step[6 + k]).clamp(joint.lower, joint.upper);
            }
        }
        let camera = 6 + joints.len();
        let part = |i: usize| Vector3::new(step[camera + i], step[camera + i + 1], step[camera + i + 2]);
        let X_DD = Isometry3::from_parts(Translation3::from(part(3)), UnitQuaternion::from_scaled_axis(part(0)));
        Self { X_WO, q, X_CD: self.X_CD * X_DD }
    }

    /// Pose of the world in the camera, for a view that is said to be at `X_WC`.
    pub fn X_DW(&self, X_WC: &Isometry3<f64>) -> Isometry3<f64> {
        (X_WC * self.X_CD).inverse()
    }

    /// Turn and shift from another hypothesis to this one, and the differences of the joints.
    pub fn difference(&self, other: &Self, joints: &[JointSearch]) -> DVector<f64> {
        let turn = (self.X_WO.rotation * other.X_WO.rotation.inverse()).scaled_axis();
        let shift = self.X_WO.translation.vector - other.X_WO.translation.vector;
        let mut d = DVector::zeros(12 + joints.len());
        d.fixed_rows_mut::<3>(0).copy_from(&turn);
        d.fixed_rows_mut::<3>(3).copy_from(&shift);
        for (k, joint) in joints.iter().enumerate() {
            d[6 + k] = self.q.get(joint.slot).zip(other.q.get(joint.slot)).map_or(0.0, |(a, b)| a - b);
        }
        let camera = other.X_CD.inverse() * self.X_CD;
        d.fixed_rows_mut::<3>(6 + joints.len()).copy_from(&camera.rotation.scaled_axis());
        d.fixed_rows_mut::<3>(9 + joints.len()).copy_from(&camera.translation.vector);
        d
    }

    /// The links' poses.
    pub fn placed(&self, model: &ObjectModel, joints: &[JointSearch]) -> Placed {
        let X_WL: Vec<_> = model.X_OL(&self.q).iter().map(|X_OL| self.X_WO * X_OL).collect();
        let moving: Vec<usize> = model.moving_joints().collect();
        let mut movers: Vec<Vec<Mover>> = vec![Vec::new(); model.links.len()];
        for (i, joint) in model.joints.iter().enumerate() {
            let mut own = movers[joint.parent].clone();
            let (source, factor) = joint.mimic.map_or((i, 1.0), |m| (m.joint, m.multiplier));
            let parameter = joints.iter().position(|s| moving.get(s.slot) == Some(&source));
            let slides = joint.kind == JointKind::Prismatic;
            let turns = matches!(joint.kind, JointKind::Revolute | JointKind::Continuous);
            if let (Some(k), true) = (parameter, slides || turns) {
                let X_WJ = X_WL[joint.parent] * joint.X_PJ;
                let axis = X_WJ * joint.axis.into_inner();
                own.push(Mover { parameter: 6 + k, axis, origin: Point3::from(X_WJ.translation.vector), slides, factor });
            }
            movers[joint.child] = own;
        }
        Placed { X_WL, origin: Point3::from(self.X_WO.translation.vector), movers }
    }
}

impl Placed {
    /// Derivative of `direction . p` by the parameters, for a point `p` of the world that is fixed to a link.
    pub fn gradient(&self, link: usize, p: &Point3<f64>, direction: &Vector3<f64>, row: &mut [f64]) {
        row.fill(0.0);
        let turn = (p - self.origin).cross(direction);
        row[..3].copy_from_slice(turn.as_slice());
        row[3..6].copy_from_slice(direction.as_slice());
        for m in &self.movers[link] {
            let slope = if m.slides { m.axis } else { m.axis.cross(&(p - m.origin)) };
            row[m.parameter] += m.factor * slope.dot(direction);
        }
    }

    /// Subtracts the derivative of `direction . p` by the camera's parameters, for a point `p` of the world that the camera
    /// `D` saw: `dp = omega x p_D + v`, in the camera's axes.
    pub fn camera_gradient(&self, X_DW: &Isometry3<f64>, p: &Point3<f64>, direction: &Vector3<f64>, row: &mut [f64]) {
        let (p_D, n_D) = (X_DW * p, X_DW * direction);
        let at = row.len() - 6;
        for (slot, slope) in row[at..].iter_mut().zip(p_D.coords.cross(&n_D).iter().chain(n_D.iter())) {
            *slot -= slope;
        }
    }
}
