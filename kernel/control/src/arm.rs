//! The robot's own rigid-body model at the measured state.

use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6xX, Point3, Vector3};
use sagci_dynamics::{LinkId, Multibody, SpatialInertia, SpatialVector, Workspace};
use sagci_model::{JointLimits, ObjectModel};
use sagci_signal::Observation;

use crate::ControlError;
use crate::error::check;

/// Something that the gripper holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the tool frame, m.
    pub p_TCm: Point3<f64>,
    /// Inertia about its centre of mass in the tool frame's axes, kg m^2; zero for a point mass.
    pub I_Cm_T: Matrix3<f64>,
}

impl Payload {
    /// A whole object that the tool holds at `X_TO`, with its joints at `q` (Steiner's theorem for each link).
    pub fn of(model: &ObjectModel, X_TO: &Isometry3<f64>, q: &[f64]) -> Self {
        let parts: Vec<(f64, Point3<f64>, Matrix3<f64>)> = model
            .links
            .iter()
            .zip(model.X_OL(q))
            .map(|(link, X_OL)| {
                let X_TL = X_TO * X_OL;
                let R = X_TL.rotation.to_rotation_matrix();
                (link.inertial.mass, X_TL * link.inertial.p_LoLcm, R * link.inertial.I_LLcm_L * R.transpose())
            })
            .collect();
        let mass: f64 = parts.iter().map(|p| p.0).sum();
        if mass <= 0.0 {
            return Self { mass: 0.0, p_TCm: Point3::origin(), I_Cm_T: Matrix3::zeros() };
        }
        let center = Point3::from(parts.iter().map(|(m, p, _)| p.coords * *m).sum::<Vector3<f64>>() / mass);
        let inertia = parts
            .iter()
            .map(|(m, p, I)| {
                let d = p - center;
                I + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * *m
            })
            .sum();
        Self { mass, p_TCm: center, I_Cm_T: inertia }
    }
}

/// A robot arm with its gripper: what its model says at the state that was measured last.
///
/// Vectors by joint follow the robot's `arm_joints`. The fingers stand at the measured opening and do not accelerate.
#[derive(Debug, Clone)]
pub struct ArmModel {
    multibody: Multibody,
    ws: Workspace,
    /// Entries of the arm's joints in the multibody's `q` and `v`.
    q_index: Vec<usize>,
    v_index: Vec<usize>,
    /// Entries of the fingers in `q`.
    finger_index: Vec<usize>,
    limits: Vec<JointLimits>,
    hand: LinkId,
    X_HT: Isometry3<f64>,
    unloaded: SpatialInertia,
    // What the last update found.
    q: Vec<f64>,
    v: Vec<f64>,
    X_WT: Isometry3<f64>,
    V_WT: SpatialVector,
    A_bias: SpatialVector,
    J: Matrix6xX<f64>,
    M: DMatrix<f64>,
    bias: Vec<f64>,
    gravity: Vec<f64>,
    // Vectors of the whole multibody.
    q_all: Vec<f64>,
    v_all: Vec<f64>,
    tau_all: Vec<f64>,
    J_all: Matrix6xX<f64>,
}

impl ArmModel {
    /// Builds the model of a robot whose root link stands at `X_WR`, with all joints at zero.
    ///
    /// # Errors
    /// The model has no `robot` section, or that names links or joints which are not there.
    pub fn new(model: &ObjectModel, X_WR: Isometry3<f64>) -> Result<Self, ControlError> {
        let fault = |message: String| ControlError::NotARobot { model: model.name.clone(), message };
        let robot = model.document.robot.as_ref().ok_or_else(|| fault("has no `robot` section in its model.yaml".into()))?;
        let multibody = Multibody::welded(model, X_WR)?;
        let v_index = multibody.velocity_indices(&robot.arm_joints)?;
        if v_index.is_empty() {
            return Err(fault("has no arm joints; list them under `robot: arm_joints` in model.yaml".into()));
        }
        let joints = robot.arm_joints.iter().map(|name| multibody.joint(name)).collect::<Result<Vec<_>, _>>()?;
        let q_index = joints.iter().map(|j| j.q.start).collect();
        let limits = joints.iter().map(|j| j.limits).collect();
        let mut finger_index = Vec::new();
        for finger in &robot.gripper.fingers {
            // A finger that follows the other one has no entry of its own.
            let follows = model.joint(&finger.joint).is_some_and(|j| model.joints[j].mimic.is_some());
            if !follows {
                multibody.velocity_index(&finger.joint)?;
                finger_index.push(multibody.joint(&finger.joint)?.q.start);
            }
        }
        let hand = multibody.link(&robot.gripper.link)?;
        let (n, nv) = (v_index.len(), multibody.nv());
        let ws = multibody.workspace();
        let mut arm = Self {
            ws,
            q_index,
            v_index,
            finger_index,
            limits,
            hand,
            X_HT: robot.gripper.X_LT.isometry(),
            unloaded: multibody.body_inertia(hand),
            q: vec![0.0; n],
            v: vec![0.0; n],
            X_WT: Isometry3::identity(),
            V_WT: SpatialVector::zeros(),
            A_bias: SpatialVector::zeros(),
            J: Matrix6xX::zeros(n),
            M: DMatrix::zeros(n, n),
            bias: vec![0.0; n],
            gravity: vec![0.0; n],
            q_all: vec![0.0; multibody.nq()],
            v_all: vec![0.0; nv],
            tau_all: vec![0.0; nv],
            J_all: Matrix6xX::zeros(nv),
            multibody,
        };
        arm.multibody.neutral_positions(&mut arm.q_all);
        let zero = vec![0.0; n];
        arm.update(&zero, &zero, 0.0)?;
        Ok(arm)
    }

    /// Sets gravity in the world, m/s^2. Takes effect with the next update.
    pub fn set_gravity(&mut self, gravity: Vector3<f64>) {
        self.multibody.set_gravity(gravity);
    }

    /// What the hand carries, if anything. Takes effect with the next update.
    ///
    /// # Errors
    /// A mass that is negative or a number that is not finite.
    pub fn set_payload(&mut self, payload: Option<&Payload>) -> Result<(), ControlError> {
        let mut inertia = self.unloaded;
        if let Some(load) = payload {
            check("payload", load.p_TCm.coords.as_slice(), 3)?;
            check("inertia of the payload", load.I_Cm_T.as_slice(), 9)?;
            if !(load.mass >= 0.0 && load.mass.is_finite()) {
                return Err(ControlError::Input { what: "mass of the payload", message: format!("is {} kg", load.mass) });
            }
            let R_HT = self.X_HT.rotation.to_rotation_matrix().into_inner();
            let own = SpatialInertia::new(load.mass, &load.p_TCm.coords, &load.I_Cm_T);
            inertia += own.moved(&R_HT, &self.X_HT.translation.vector);
        }
        self.multibody.set_body_inertia(self.hand, &inertia);
        Ok(())
    }

    /// Takes in a measured state: positions and velocities of the arm's joints, and the gripper's opening, m.
    ///
    /// # Errors
    /// A vector of the wrong length, or a number that is not finite.
    pub fn update(&mut self, q: &[f64], v: &[f64], gripper_width: f64) -> Result<(), ControlError> {
        check("q", q, self.n())?;
        check("v", v, self.n())?;
        check("gripper width", &[gripper_width], 1)?;
        self.q.copy_from_slice(q);
        self.v.copy_from_slice(v);
        for (i, (q, v)) in self.q_index.iter().zip(&self.v_index).enumerate() {
            self.q_all[*q] = self.q[i];
            self.v_all[*v] = self.v[i];
        }
        for i in &self.finger_index {
            self.q_all[*i] = gripper_width / 2.0;
        }
        let (multibody, ws) = (&self.multibody, &mut self.ws);
        multibody.set_state(ws, &self.q_all, &self.v_all)?;
        self.X_WT = multibody.X_WL(ws, self.hand) * self.X_HT;
        let p_HT = Point3::from(self.X_HT.translation.vector);
        multibody.jacobian(ws, self.hand, &p_HT, &mut self.J_all)?;
        self.V_WT = SpatialVector::zeros();
        for (i, v) in self.v_index.iter().enumerate() {
            self.J.set_column(i, &self.J_all.column(*v));
            self.V_WT += self.J_all.column(*v) * self.v[i];
        }
        self.A_bias = multibody.bias_acceleration(ws, self.hand, &p_HT)?;
        multibody.bias_efforts(ws, &mut self.tau_all)?;
        pick(&self.tau_all, &self.v_index, &mut self.bias);
        multibody.gravity_efforts(ws, &mut self.tau_all)?;
        pick(&self.tau_all, &self.v_index, &mut self.gravity);
        let M = multibody.mass_matrix(ws)?;
        for (j, v_j) in self.v_index.iter().enumerate() {
            for (i, v_i) in self.v_index.iter().enumerate() {
                self.M[(i, j)] = M[(*v_i, *v_j)];
            }
        }
        Ok(())
    }

    /// [`Self::update`] with what the sensors say.
    ///
    /// # Errors
    /// As there.
    pub fn observe(&mut self, observation: &Observation) -> Result<(), ControlError> {
        self.update(&observation.q, &observation.v, observation.gripper_width)
    }

    /// Number of arm joints.
    pub fn n(&self) -> usize {
        self.v_index.len()
    }

    /// Limits of the arm's joints.
    pub fn limits(&self) -> &[JointLimits] {
        &self.limits
    }

    /// Positions of the last update.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Velocities of the last update.
    pub fn v(&self) -> &[f64] {
        &self.v
    }

    /// Pose of the tool frame in the world.
    pub fn X_WT(&self) -> &Isometry3<f64> {
        &self.X_WT
    }

    /// Angular velocity of the tool frame and velocity of its origin, in the world's axes.
    pub fn V_WT(&self) -> &SpatialVector {
        &self.V_WT
    }

    /// Jacobian of the tool frame: `V_WT = J v` (6 x n, angular rows first, world's axes).
    pub fn J_WT(&self) -> &Matrix6xX<f64> {
        &self.J
    }

    /// `dJ/dt v`: acceleration of the tool frame at constant joint velocities, world's axes.
    pub fn A_bias(&self) -> &SpatialVector {
        &self.A_bias
    }

    /// Mass matrix of the arm's joints (n x n).
    pub fn mass_matrix(&self) -> &DMatrix<f64> {
        &self.M
    }

    /// Efforts that gravity, Coriolis and centrifugal forces need, by arm joint.
    pub fn bias(&self) -> &[f64] {
        &self.bias
    }

    /// Efforts that gravity needs, by arm joint.
    pub fn gravity(&self) -> &[f64] {
        &self.gravity
    }

    /// Efforts that give the accelerations `a`: `M a + bias`.
    ///
    /// # Errors
    /// A vector of the wrong length, or a number that is not finite.
    pub fn inverse_dynamics(&self, a: &[f64], tau: &mut [f64]) -> Result<(), ControlError> {
        check("a", a, self.n())?;
        check("tau", tau, self.n())?;
        for (i, tau) in tau.iter_mut().enumerate() {
            *tau = self.bias[i] + a.iter().enumerate().map(|(j, a)| self.M[(i, j)] * a).sum::<f64>();
        }
        Ok(())
    }
}

fn pick(all: &[f64], index: &[usize], picked: &mut [f64]) {
    for (x, i) in picked.iter_mut().zip(index) {
        *x = all[*i];
    }
}
