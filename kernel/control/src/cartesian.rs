//! Cartesian impedance in operational space (Khatib 1987; Ott 2008, chapter 3).
//!
//! With the reference frame `D`, the error is `e = [log(R_WD R_WT^T); p_WD - p_WT]` and the wrench on the tool
//!
//! `F = Lambda (A_WD - dJ/dt v) + K e + D (V_WD - V_WT) + F_ff`,
//!
//! `Lambda = (J M^-1 J^T)^-1`, `K` and `D` given in a task frame's axes and turned into the world's. Where the model is right the
//! tool then obeys `Lambda e'' + D e' + K e = -F_ext`: at rest it yields to a push by `K^-1 F_ext`. The efforts are
//!
//! `tau = c + g + J^T F + (1 - J^T Lambda J M^-1) tau_0 + tau_limits`,
//!
//! with the posture's `tau_0 = K_n (q_n - q) - D_n v`: the dynamically consistent projection keeps it from accelerating the
//! tool. `tau_limits` pushes away from joint limits inside a margin, by a damped spring (Khatib 1986), and is not projected: there
//! safety goes before the task.
//!
//! Damping can be designed from the mass matrix (Albu-Schaeffer et al. 2003): with `Lambda = Q Q^T` and `K = Q K_0 Q^T`, `K_0`
//! diagonal, `D = 2 zeta Q sqrt(K_0) Q^T` gives each mode the damping ratio `zeta`.

use nalgebra::{Isometry3, Matrix6, Matrix6xX, SymmetricEigen, UnitQuaternion, Vector6};
use sagci_dynamics::{SpatialVector, cholesky, cholesky_solve, cholesky_solve_lower};
use sagci_signal::{Command, Observation};

use crate::error::{check, check_not_negative};
use crate::joint::FREQUENCY;
use crate::{ArmModel, ControlError, EffortLimit};

/// `J M^-1 J^T` is made larger by this fraction of its diagonal, so that its inverse stays bounded at singularities.
const REGULARISATION: f64 = 1e-4;

/// Of the push away from joint limits.
const LIMIT_DAMPING_RATIO: f64 = 0.7;

/// Where the tool is to be. All in the world's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CartesianReference {
    /// Pose of the tool frame.
    pub X_WD: Isometry3<f64>,
    /// Its angular velocity and the velocity of its origin.
    pub V_WD: SpatialVector,
    /// Its angular acceleration and the acceleration of its origin.
    pub A_WD: SpatialVector,
    /// Torque and force that the tool is to exert on the world, at the tool's origin.
    pub F_ff: SpatialVector,
    /// Orientation of the task frame, in whose axes stiffness and damping are given.
    pub R_WK: UnitQuaternion<f64>,
}

impl CartesianReference {
    /// At rest at a pose, with the tool frame's own axes as task frame.
    pub fn at(X_WD: Isometry3<f64>) -> Self {
        let zero = SpatialVector::zeros();
        Self { X_WD, V_WD: zero, A_WD: zero, F_ff: zero, R_WK: X_WD.rotation }
    }
}

/// How the impedance is damped.
// Boxed, a change of gains would allocate.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Damping {
    /// A matrix in the task frame's axes, angular part first, N m s/rad and N s/m.
    Matrix(Matrix6<f64>),
    /// The same damping ratio for all modes, designed from the mass matrix at each step.
    Ratio(f64),
}

/// What the arm does with the freedom that the tool leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct Posture {
    /// Positions that are preferred.
    pub q: Vec<f64>,
    /// Stiffness toward them, N m/rad; 0 for none.
    pub stiffness: f64,
    /// Damping of all joints within the free motion, N m s/rad.
    pub damping: f64,
}

/// Holds the tool to a reference by a spring and a damper of six directions.
#[derive(Debug, Clone)]
pub struct CartesianImpedance {
    stiffness: Matrix6<f64>,
    damping: Damping,
    posture: Posture,
    /// Joint limits push back inside this distance, rad or m.
    pub limit_margin: f64,
    /// Share of a joint's full effort with which its limit pushes back where it is reached.
    pub limit_share: f64,
    /// Greatest torque, N m, and force, N, of the spring: how hard a reference that is far away can pull.
    pub spring_limit: [f64; 2],
    /// Limits of the efforts.
    pub limit: EffortLimit,
    error: SpatialVector,
    wrench: SpatialVector,
    // Scratch.
    L: Vec<f64>,
    Y: Matrix6xX<f64>,
    row: Vec<f64>,
    tau: Vec<f64>,
    null: Vec<f64>,
}

impl CartesianImpedance {
    /// Stiffness and damping are given in the reference's task frame, angular part first. The posture starts where the arm is,
    /// with 10 N m/rad and 2 N m s/rad.
    ///
    /// # Errors
    /// A gain that is not finite, or a matrix that is not symmetric and positive semidefinite.
    pub fn new(arm: &ArmModel, stiffness: Matrix6<f64>, damping: Damping) -> Result<Self, ControlError> {
        let n = arm.n();
        let mut law = Self {
            stiffness: Matrix6::zeros(),
            damping: Damping::Matrix(Matrix6::zeros()),
            posture: Posture { q: arm.q().to_vec(), stiffness: 10.0, damping: 2.0 },
            limit_margin: 0.1,
            limit_share: 0.5,
            spring_limit: [f64::INFINITY; 2],
            limit: EffortLimit::new(arm),
            error: SpatialVector::zeros(),
            wrench: SpatialVector::zeros(),
            L: vec![0.0; n * n],
            Y: Matrix6xX::zeros(n),
            row: vec![0.0; n],
            tau: vec![0.0; n],
            null: vec![0.0; n],
        };
        law.set_gains(stiffness, damping)?;
        Ok(law)
    }

    /// Greatest stiffness against turns, N m/rad, and against shifts, N/m, with which the tool is stable on its way through
    /// these configurations.
    ///
    /// The springs feel the operational-space inertia; its least value, over directions and over the way, bounds them by the
    /// frequency that the sensors' delay leaves stable, as in [`crate::JointImpedance::tuned`].
    ///
    /// # Errors
    /// A configuration of the wrong length, or with a number that is not finite.
    pub fn stiffest(arm: &ArmModel, way: &[Vec<f64>]) -> Result<[f64; 2], ControlError> {
        let (mut probe, zero) = (arm.clone(), vec![0.0; arm.n()]);
        let mut stiffest = [f64::INFINITY; 2];
        for q in way {
            probe.update(q, &zero, 0.0)?;
            let Some(inverse) = probe.mass_matrix().clone().try_inverse() else { continue };
            let mobility = probe.J_WT() * inverse * probe.J_WT().transpose();
            for (part, most) in stiffest.iter_mut().enumerate() {
                let block = mobility.fixed_view::<3, 3>(3 * part, 3 * part).into_owned();
                *most = most.min(FREQUENCY * FREQUENCY / block.symmetric_eigenvalues().max().max(1e-9));
            }
        }
        Ok(stiffest)
    }

    /// A diagonal matrix with one gain for all turns and one for each shift along the task frame's axes.
    pub fn diagonal(turn: f64, shift: [f64; 3]) -> Matrix6<f64> {
        Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift[0], shift[1], shift[2]))
    }

    /// Sets the gains; takes effect with the next step.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn set_gains(&mut self, stiffness: Matrix6<f64>, damping: Damping) -> Result<(), ControlError> {
        semidefinite("stiffness", &stiffness)?;
        match &damping {
            Damping::Matrix(D) => semidefinite("damping", D)?,
            Damping::Ratio(zeta) => check_not_negative("damping ratio", &[*zeta], 1)?,
        }
        self.stiffness = stiffness;
        self.damping = damping;
        Ok(())
    }

    /// Sets the posture.
    ///
    /// # Errors
    /// A wrong number of positions, or a number that is negative or not finite.
    pub fn set_posture(&mut self, posture: &Posture) -> Result<(), ControlError> {
        check("posture", &posture.q, self.posture.q.len())?;
        check_not_negative("posture's stiffness and damping", &[posture.stiffness, posture.damping], 2)?;
        self.posture.q.copy_from_slice(&posture.q);
        self.posture.stiffness = posture.stiffness;
        self.posture.damping = posture.damping;
        Ok(())
    }

    /// Error of the last step: turn (rad) and shift (m) from the tool to its reference, world's axes.
    pub fn error(&self) -> &SpatialVector {
        &self.error
    }

    /// Torque and force that the last step asked the tool to exert, at its origin, world's axes.
    pub fn wrench(&self) -> &SpatialVector {
        &self.wrench
    }

    /// Takes in what the sensors say and writes the efforts for the next `period` (s) into the command.
    ///
    /// # Errors
    /// A vector of the wrong length or a number that is not finite; the command is then left as it was.
    pub fn step(
        &mut self,
        arm: &mut ArmModel,
        observation: &Observation,
        reference: &CartesianReference,
        period: f64,
        command: &mut Command,
    ) -> Result<(), ControlError> {
        check("reference position", reference.X_WD.translation.vector.as_slice(), 3)?;
        check("reference orientation", reference.X_WD.rotation.coords.as_slice(), 4)?;
        check("reference velocity", reference.V_WD.as_slice(), 6)?;
        check("reference acceleration", reference.A_WD.as_slice(), 6)?;
        check("reference wrench", reference.F_ff.as_slice(), 6)?;
        check("task frame", reference.R_WK.coords.as_slice(), 4)?;
        check("period", &[period], 1)?;
        check("arm", arm.q(), self.row.len())?;
        arm.observe(observation)?;
        let n = arm.n();

        // Lambda^-1 = J M^-1 J^T = Y Y^T, with M = L L^T and Y^T = L^-1 J^T.
        self.L.copy_from_slice(arm.mass_matrix().as_slice());
        cholesky(&mut self.L, n).map_err(|_| ControlError::Input { what: "mass matrix", message: "is not positive definite".into() })?;
        for r in 0..6 {
            for (i, x) in self.row.iter_mut().enumerate() {
                *x = arm.J_WT()[(r, i)];
            }
            cholesky_solve_lower(&self.L, n, &mut self.row);
            for (i, x) in self.row.iter().enumerate() {
                self.Y[(r, i)] = *x;
            }
        }
        let mut inverse = Matrix6::zeros();
        for i in 0..n {
            let y = self.Y.column(i);
            inverse += y * y.transpose();
        }
        for i in 0..6 {
            inverse[(i, i)] += REGULARISATION * inverse[(i, i)] + 1e-9;
        }
        let singular = || ControlError::Input { what: "Jacobian", message: "gives no operational-space inertia".into() };
        let inertia = inverse.cholesky().ok_or_else(singular)?.inverse();

        // The wrench.
        let X_WT = arm.X_WT();
        let turn = (reference.X_WD.rotation * X_WT.rotation.inverse()).scaled_axis();
        let shift = reference.X_WD.translation.vector - X_WT.translation.vector;
        self.error = SpatialVector::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        let R_WK = reference.R_WK.to_rotation_matrix().into_inner();
        let mut rotate = Matrix6::zeros();
        rotate.fixed_view_mut::<3, 3>(0, 0).copy_from(&R_WK);
        rotate.fixed_view_mut::<3, 3>(3, 3).copy_from(&R_WK);
        let K = rotate * self.stiffness * rotate.transpose();
        let D = match &self.damping {
            Damping::Matrix(D) => rotate * D * rotate.transpose(),
            Damping::Ratio(zeta) => designed_damping(&inertia, &K, *zeta).ok_or_else(singular)?,
        };
        let mut spring = K * self.error;
        for (part, limit) in self.spring_limit.iter().enumerate() {
            let mut part = spring.fixed_rows_mut::<3>(3 * part);
            let size = part.norm();
            if size > *limit {
                part *= limit / size;
            }
        }
        let V_error = reference.V_WD - arm.V_WT();
        self.wrench = inertia * (reference.A_WD - arm.A_bias()) + spring + D * V_error + reference.F_ff;

        // The posture, projected so that it does not accelerate the tool.
        for i in 0..n {
            self.null[i] = self.posture.stiffness * (self.posture.q[i] - arm.q()[i]) - self.posture.damping * arm.v()[i];
        }
        self.row.copy_from_slice(&self.null);
        cholesky_solve(&self.L, n, &mut self.row);
        let mut accelerates = SpatialVector::zeros();
        for (i, x) in self.row.iter().enumerate() {
            accelerates += arm.J_WT().column(i) * *x;
        }
        let F = self.wrench - inertia * accelerates;

        for i in 0..n {
            self.tau[i] = arm.bias()[i] + arm.J_WT().column(i).dot(&F) + self.null[i] + self.limit_push(arm, i);
        }
        if let Some(i) = self.tau.iter().position(|t| !t.is_finite()) {
            return Err(ControlError::Input { what: "effort", message: format!("of joint {i} is {}", self.tau[i]) });
        }
        self.limit.apply(&mut self.tau, period);
        command.tau.resize(n, 0.0);
        command.tau.copy_from_slice(&self.tau);
        Ok(())
    }

    /// A spring that rises from the margin to the joint's limit, damped so that it does not throw the joint back.
    fn limit_push(&self, arm: &ArmModel, i: usize) -> f64 {
        let (limit, q) = (&arm.limits()[i], arm.q()[i]);
        if self.limit_margin <= 0.0 || !limit.effort.is_finite() {
            return 0.0;
        }
        let inside = |distance: f64| (1.0 - distance / self.limit_margin).clamp(0.0, 1.0 / self.limit_share.max(1e-9));
        let (low, high) = (inside(q - limit.lower), inside(limit.upper - q));
        let stiffness = self.limit_share * limit.effort.abs() / self.limit_margin;
        let damping = 2.0 * LIMIT_DAMPING_RATIO * (stiffness * arm.mass_matrix()[(i, i)]).sqrt();
        self.limit_margin * stiffness * (low - high) - damping * low.max(high).min(1.0) * arm.v()[i]
    }
}

/// `D = 2 zeta Q sqrt(K_0) Q^T`.
fn designed_damping(inertia: &Matrix6<f64>, K: &Matrix6<f64>, zeta: f64) -> Option<Matrix6<f64>> {
    let L = inertia.cholesky()?.l();
    let half = L.solve_lower_triangular(K)?;
    let modes = L.solve_lower_triangular(&half.transpose())?;
    let eigen = SymmetricEigen::new((modes + modes.transpose()) * 0.5);
    let Q = L * eigen.eigenvectors;
    let roots = eigen.eigenvalues.map(|k| 2.0 * zeta * k.max(0.0).sqrt());
    Some(Q * Matrix6::from_diagonal(&roots) * Q.transpose())
}

fn semidefinite(what: &'static str, A: &Matrix6<f64>) -> Result<(), ControlError> {
    check(what, A.as_slice(), 36)?;
    let scale = A.amax().max(1e-12);
    if (A - A.transpose()).amax() > 1e-9 * scale {
        return Err(ControlError::Input { what, message: "the matrix must be symmetric".into() });
    }
    if SymmetricEigen::new(*A).eigenvalues.min() < -1e-9 * scale {
        return Err(ControlError::Input { what, message: "the matrix must be positive semidefinite".into() });
    }
    Ok(())
}
