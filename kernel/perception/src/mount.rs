//! How the camera sits on the wrist: what is known of it, and what the table shows.
//!
//! The table's plane is known. Its points give three of the camera's six parameters (two turns and the height) before any
//! object is looked for; objects seen in several views give the rest, and the next object profits from it.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use crate::frame::Frame;

/// Standard deviations of a hand-eye calibration, m and rad: a good one with a printed target gives 1 to 3 mm and a few
/// tenths of a degree (Horaud and Dornaika 1995; engineering practice).
const SHIFT: f64 = 0.0015;
const TURN: f64 = 0.003;
/// A table seen in fewer pixels than this shows nothing.
const LEAST_POINTS: usize = 100;
/// Neighbouring pixels err together; stereo matching compares windows of about this many pixels.
const CORRELATED: f64 = 25.0;
/// Standard deviation of the table's height, m.
const TABLE: f64 = 0.001;

/// What is known of the camera's mounting.
pub(crate) struct Mount {
    /// Inverse covariance of turn and shift, in the camera's axes.
    pub information: Matrix6<f64>,
}

impl Mount {
    /// Corrects the cameras of all views by the table, and says what is known afterwards.
    pub fn by_table(frames: &mut [Frame], table_height: f64) -> Self {
        let variance = |d: f64| 1.0 / (d * d);
        let prior = Matrix6::from_diagonal(&Vector6::new(
            variance(TURN),
            variance(TURN),
            variance(TURN),
            variance(SHIFT),
            variance(SHIFT),
            variance(SHIFT),
        ));
        let points: Vec<_> = frames.iter().map(|f| f.table_points(table_height)).collect();
        let mut X_CD = Isometry3::<f64>::identity();
        let mut information = prior;
        for cut in [0.02, 0.012, 0.008, 0.008] {
            let mut H = prior;
            let mut g = -prior * parameters(&X_CD);
            for (frame, points) in frames.iter().zip(&points) {
                if points.len() < LEAST_POINTS {
                    continue;
                }
                let X_WD = frame.X_WC * X_CD;
                let moved = X_WD * frame.X_WC.inverse();
                let n_D = X_WD.inverse_transform_vector(&Vector3::z());
                // All points of a view share the error of the table's own height.
                let (mut A, mut b, mut sum_J, mut sum_w, mut sum_r) = (Matrix6::zeros(), Vector6::zeros(), Vector6::zeros(), 0.0, 0.0);
                for p in points {
                    let p = moved * p.point;
                    let r = table_height - p.z;
                    if r.abs() > cut {
                        continue;
                    }
                    let p_D: Point3<f64> = X_WD.inverse_transform_point(&p);
                    let turn = p_D.coords.cross(&n_D);
                    let J = Vector6::new(turn.x, turn.y, turn.z, n_D.x, n_D.y, n_D.z);
                    let deviation = frame.noise * p_D.coords.norm_squared() * (n_D.z.abs()).max(0.1) + 0.001;
                    let w = 1.0 / (deviation * deviation * CORRELATED);
                    A += J * J.transpose() * w;
                    b += J * (r * w);
                    sum_J += J * w;
                    sum_r += r * w;
                    sum_w += w;
                }
                // The height is one more unknown, eliminated: h ~ N(0, TABLE^2).
                let h = sum_w + variance(TABLE);
                H += A - sum_J * sum_J.transpose() / h;
                g += b - sum_J * (sum_r / h);
            }
            information = H;
            let Some(step) = H.cholesky().map(|c| c.solve(&g)) else { break };
            X_CD *= Isometry3::from_parts(
                Translation3::new(step[3], step[4], step[5]),
                UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2])),
            );
        }
        frames.iter_mut().for_each(|f| f.correct(&X_CD));
        Self { information }
    }
}

fn parameters(X: &Isometry3<f64>) -> Vector6<f64> {
    let (turn, shift) = (X.rotation.scaled_axis(), X.translation.vector);
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}
