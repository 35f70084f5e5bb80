//! The kinematic chain of an arm, from its base to the tool frame between the finger pads.
//!
//! X_WT(q) = X_WR * prod_i (X_PJ_i * exp([axis_i] q_i)) * X_ET. Everything fixed between two moving joints is folded
//! into X_PJ once. The Jacobian is geometric, about the tool's origin, in the world's axes: a column is
//! (w; v) = (a, a x (p_WT - p_WJ)) for a turning joint and (0; a) for a sliding one (Lynch and Park 2017, 5.1).
//!
//! What a task leaves free (the turn of a grip about a bar, the yaw of a mug on a table) enters as further joints behind
//! the tool, see [`ArmKinematics::with_freedom`]: inverse kinematics and path search then need no case of their own.

use nalgebra::{Isometry3, Matrix6, Unit, UnitQuaternion, Vector3, Vector6};
use sagci_model::{JointKind, ObjectModel};

use crate::PlanError;

/// One moving joint of the chain.
#[derive(Debug, Clone)]
pub(crate) struct Segment {
    pub(crate) X_PJ: Isometry3<f64>,
    pub(crate) axis: Unit<Vector3<f64>>,
    pub(crate) slides: bool,
}

/// A motion that a task leaves free: the tool's goal frame `F` may be turned or shifted before the tool is placed on it.
///
/// X_WT = X_WF * exp(s axis) * X_FT with s in `range`.
#[derive(Debug, Clone)]
pub struct Freedom {
    /// The frame that the goals are given for, in the tool's.
    pub X_TF: Isometry3<f64>,
    /// Axis of the motion, in `F`.
    pub axis: Unit<Vector3<f64>>,
    /// A shift along the axis instead of a turn about it.
    pub slides: bool,
    /// Least and greatest amount, rad or m.
    pub range: [f64; 2],
}

/// The chain from an arm's base to its tool frame `T`, with its limits. Joints stand in the order of
/// `robot.arm_joints`, then the freedoms that were added.
#[derive(Debug, Clone)]
pub struct ArmKinematics {
    pub(crate) X_WR: Isometry3<f64>,
    pub(crate) segments: Vec<Segment>,
    pub(crate) X_ET: Isometry3<f64>,
    names: Vec<String>,
    pub(crate) lower: Vec<f64>,
    pub(crate) upper: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
    arm: usize,
}

impl ArmKinematics {
    /// Builds the chain of a robot's model, with its root link at `X_WR`.
    ///
    /// # Errors
    /// [`PlanError::ModelLacks`] if the model has no `robot` section, or its arm joints are not, in this order, the moving
    /// joints between the root and the gripper's link.
    pub fn new(robot: &ObjectModel, X_WR: &Isometry3<f64>) -> Result<Self, PlanError> {
        let lacks = |message: String| PlanError::ModelLacks { model: robot.name.clone(), message };
        let section =
            robot.document.robot.as_ref().ok_or_else(|| lacks("has no `robot` section in model.yaml; it is not an arm".into()))?;
        let mut link = robot
            .link(&section.gripper.link)
            .ok_or_else(|| lacks(format!("the gripper's link '{}' is not in the URDF", section.gripper.link)))?;
        let mut joints = Vec::new();
        // joints[i] moves links[i + 1]: the path to the root.
        while link > 0 {
            joints.push(link - 1);
            link = robot.joints[link - 1].parent;
        }
        joints.reverse();

        let mut chain = Self {
            X_WR: *X_WR,
            segments: Vec::new(),
            X_ET: Isometry3::identity(),
            names: Vec::new(),
            lower: Vec::new(),
            upper: Vec::new(),
            velocity: Vec::new(),
            effort: Vec::new(),
            arm: 0,
        };
        let mut X = Isometry3::identity();
        for j in joints {
            let joint = &robot.joints[j];
            let slides = match joint.kind {
                JointKind::Fixed => {
                    X *= joint.X_PJ;
                    continue;
                }
                JointKind::Revolute | JointKind::Continuous => false,
                JointKind::Prismatic => true,
                JointKind::Floating | JointKind::Planar => {
                    return Err(lacks(format!("joint '{}' between base and gripper has more than one degree of freedom", joint.name)));
                }
            };
            if section.arm_joints.get(chain.names.len()) != Some(&joint.name) {
                return Err(lacks(format!(
                    "joint '{}' moves between base and gripper, but is not number {} of robot.arm_joints",
                    joint.name,
                    chain.names.len() + 1
                )));
            }
            chain.segments.push(Segment { X_PJ: X * joint.X_PJ, axis: joint.axis, slides });
            X = Isometry3::identity();
            chain.names.push(joint.name.clone());
            chain.lower.push(joint.limits.lower);
            chain.upper.push(joint.limits.upper);
            chain.velocity.push(joint.limits.velocity);
            chain.effort.push(joint.limits.effort);
        }
        if chain.names.len() != section.arm_joints.len() {
            return Err(lacks(format!(
                "robot.arm_joints names {} joints, but {} lie between base and gripper",
                section.arm_joints.len(),
                chain.names.len()
            )));
        }
        if chain.names.is_empty() {
            return Err(lacks("no joint moves the gripper".into()));
        }
        chain.X_ET = X * section.gripper.X_LT.isometry();
        chain.arm = chain.names.len();
        Ok(chain)
    }

    /// The same arm with a freedom of the task as one more joint; goals are then poses of the frame `F`.
    pub fn with_freedom(&self, freedom: &Freedom) -> Self {
        let mut chain = self.clone();
        // X_WF = X_WT * X_TF * exp([axis] -s)
        chain.segments.push(Segment { X_PJ: chain.X_ET * freedom.X_TF, axis: -freedom.axis, slides: freedom.slides });
        chain.X_ET = Isometry3::identity();
        chain.names.push(String::from("freedom"));
        chain.lower.push(freedom.range[0]);
        chain.upper.push(freedom.range[1]);
        chain.velocity.push(f64::INFINITY);
        chain.effort.push(f64::INFINITY);
        chain
    }

    /// The same arm, with the goal frame moved by a fixed `X_TF`.
    pub fn with_tool(&self, X_TF: &Isometry3<f64>) -> Self {
        let mut chain = self.clone();
        chain.X_ET *= X_TF;
        chain
    }

    /// Number of joints, freedoms included.
    pub fn joints(&self) -> usize {
        self.segments.len()
    }

    /// Number of joints of the arm itself.
    pub fn arm_joints(&self) -> usize {
        self.arm
    }

    /// Names of the joints.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Least positions, rad or m.
    pub fn lower(&self) -> &[f64] {
        &self.lower
    }

    /// Greatest positions, rad or m.
    pub fn upper(&self) -> &[f64] {
        &self.upper
    }

    /// Greatest speeds, rad/s or m/s.
    pub fn velocity(&self) -> &[f64] {
        &self.velocity
    }

    /// Greatest efforts, N m or N.
    pub fn effort(&self) -> &[f64] {
        &self.effort
    }

    /// Pose of the robot's root link.
    pub fn X_WR(&self) -> &Isometry3<f64> {
        &self.X_WR
    }

    /// Are all positions finite and within the limits, up to `tolerance`?
    pub fn within_limits(&self, q: &[f64], tolerance: f64) -> bool {
        q.len() >= self.arm && q.iter().zip(&self.lower).zip(&self.upper).all(|((q, l), u)| *q >= l - tolerance && *q <= u + tolerance)
    }

    /// Pose of the tool frame, or of the goal frame `F` if freedoms were added. `q` has an entry for each joint; missing
    /// ones count as zero.
    pub fn X_WT(&self, q: &[f64]) -> Isometry3<f64> {
        let mut X = self.X_WR;
        for (i, segment) in self.segments.iter().enumerate() {
            X = step(&X, segment, q.get(i).copied().unwrap_or(0.0));
        }
        X * self.X_ET
    }

    /// Poses of the frames behind each moving joint, first the root link's: `joints() + 1` of them.
    pub fn frames(&self, q: &[f64], X_WJ: &mut Vec<Isometry3<f64>>) {
        X_WJ.clear();
        let mut X = self.X_WR;
        X_WJ.push(X);
        for (i, segment) in self.segments.iter().enumerate() {
            X = step(&X, segment, q.get(i).copied().unwrap_or(0.0));
            X_WJ.push(X);
        }
    }

    /// Pose of the tool, and the Jacobian's columns (w; v) in `J`, which is resized to the number of joints.
    pub fn jacobian(&self, q: &[f64], J: &mut Vec<Vector6<f64>>) -> Isometry3<f64> {
        J.clear();
        let mut X = self.X_WR;
        for (i, segment) in self.segments.iter().enumerate() {
            let X_WJ = X * segment.X_PJ;
            let axis = X_WJ.rotation * segment.axis.into_inner();
            let origin = X_WJ.translation.vector;
            // The origin is kept in the lower half until the tool's is known.
            J.push(Vector6::new(axis.x, axis.y, axis.z, origin.x, origin.y, origin.z));
            X = move_joint(&X_WJ, segment, q.get(i).copied().unwrap_or(0.0));
        }
        let X_WT = X * self.X_ET;
        for (column, segment) in J.iter_mut().zip(&self.segments) {
            let axis = column.fixed_rows::<3>(0).into_owned();
            if segment.slides {
                *column = Vector6::new(0.0, 0.0, 0.0, axis.x, axis.y, axis.z);
            } else {
                let v = axis.cross(&(X_WT.translation.vector - column.fixed_rows::<3>(3)));
                column.fixed_rows_mut::<3>(3).copy_from(&v);
            }
        }
        X_WT
    }

    /// Efforts of the arm joints that hold a force and torque (torque; force), N m and N, on the tool's origin in the
    /// world's axes: tau = J^T F.
    pub fn efforts(&self, q: &[f64], F: &Vector6<f64>) -> Vec<f64> {
        let mut J = Vec::new();
        self.jacobian(q, &mut J);
        J.iter().take(self.arm).map(|column| column.dot(F)).collect()
    }

    /// Yoshikawa's manipulability sqrt(det(J J^T)) over the arm's own joints, with lengths in metres: 0 where the arm is
    /// singular.
    pub fn manipulability(&self, q: &[f64]) -> f64 {
        let mut J = Vec::new();
        self.jacobian(q, &mut J);
        let JJt: Matrix6<f64> = J.iter().take(self.arm).map(|c| c * c.transpose()).sum();
        JJt.determinant().max(0.0).sqrt()
    }
}

fn step(X: &Isometry3<f64>, segment: &Segment, q: f64) -> Isometry3<f64> {
    move_joint(&(X * segment.X_PJ), segment, q)
}

fn move_joint(X_WJ: &Isometry3<f64>, segment: &Segment, q: f64) -> Isometry3<f64> {
    let mut X = *X_WJ;
    if segment.slides {
        X.translation.vector += X.rotation * (segment.axis.into_inner() * q);
    } else {
        X.rotation *= UnitQuaternion::from_axis_angle(&segment.axis, q);
    }
    X
}
