//! Derivatives of what the sensors of a joint read, by the joint's state, the effort through it, inner states and parameters: the dense
//! form of [`System::measure_back`], for least squares.
//!
//! Readings pass the effects on the measurement in their order; each effect's partials are by what comes in, so rows of derivatives pass
//! through it as the readings do.

use nalgebra::DMatrix;

use crate::effects::Reading;
use crate::multibody::length;
use crate::sensitivity::Plan;
use crate::{DynamicsError, ParameterVector, State, System};

/// Rows of [`MeasurementDerivatives`]: position, velocity, effort, stamp.
const ROWS: usize = 4;

/// Derivatives of a joint's reading. Rows: position, velocity, effort and time stamp. Made once; nothing allocates afterwards.
#[derive(Debug, Clone)]
pub struct MeasurementDerivatives {
    /// By the joint's true position, rad or m.
    pub d_q: [f64; ROWS],
    /// By its true velocity.
    pub d_v: [f64; ROWS],
    /// By the true effort.
    pub d_effort: [f64; ROWS],
    /// By the inner states of effects, 4 x nz.
    pub d_z: DMatrix<f64>,
    /// By the parameters that it was made with.
    pub d_theta: DMatrix<f64>,
    plan: Plan,
}

impl MeasurementDerivatives {
    /// Zeros for a system and some of its parameters. Those that no sensor answers to have columns of zeros.
    ///
    /// # Errors
    /// Parameters of another system.
    pub fn new(system: &System, which: &ParameterVector) -> Result<Self, DynamicsError> {
        Ok(Self {
            d_q: [0.0; ROWS],
            d_v: [0.0; ROWS],
            d_effort: [0.0; ROWS],
            d_z: DMatrix::zeros(ROWS, system.state().z.len()),
            d_theta: DMatrix::zeros(ROWS, which.len()),
            plan: Plan::new(system, which)?,
        })
    }
}

impl System {
    /// [`Self::measure`] with its derivatives. `v` is the joint's entry in velocities, `effort` the true one. The reading's own partials
    /// are those of the last effect that it passed.
    ///
    /// # Errors
    /// A state of the wrong length or with a number that is not finite, no such entry, or `out` of another system.
    pub fn measure_derivatives(
        &self,
        state: &State,
        effort: f64,
        v: usize,
        out: &mut MeasurementDerivatives,
    ) -> Result<Reading, DynamicsError> {
        self.check_state(state)?;
        length("inner states of a measurement's derivatives", out.d_z.ncols(), state.z.len())?;
        let Some(mut reading) = self.perfect_reading(state, effort, v) else {
            let must = format!("below {}", self.multibody().nv());
            return Err(DynamicsError::OutOfBounds { what: "a degree of freedom".into(), value: v as f64, must });
        };
        out.plan.update(self)?;
        (out.d_q, out.d_v, out.d_effort) = ([1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]);
        out.d_z.fill(0.0);
        out.d_theta.fill(0.0);
        for &i in self.measurements.iter().filter(|i| self.acts_on_reading(**i, v)) {
            let placed = &self.placements()[i];
            reading = self.read(i, state, &reading);
            let values = [&reading.position, &reading.velocity, &reading.effort, &reading.stamp];
            // How each row answers to the rows before it; the stamp goes with the one that comes in.
            let slopes = values.map(|x| [x.d_q, x.d_v, x.d_input]);
            let pass = |x: [f64; ROWS]| -> [f64; ROWS] {
                let mut y = slopes.map(|[a, b, c]| a * x[0] + b * x[1] + c * x[2]);
                y[3] += x[3];
                y
            };
            for x in [&mut out.d_q, &mut out.d_v, &mut out.d_effort] {
                *x = pass(*x);
            }
            for columns in [&mut out.d_z, &mut out.d_theta] {
                for column in columns.as_mut_slice().as_chunks_mut::<ROWS>().0 {
                    *column = pass(*column);
                }
            }
            for (row, value) in values.into_iter().enumerate() {
                for (z, d) in placed.z.clone().zip(value.d_z) {
                    out.d_z[(row, z)] += d;
                }
                for (column, d) in out.plan.theta.get(placed.theta.clone()).unwrap_or(&[]).iter().zip(value.d_theta) {
                    if *column < out.d_theta.ncols() {
                        out.d_theta[(row, *column)] += d;
                    }
                }
            }
        }
        Ok(reading)
    }
}
