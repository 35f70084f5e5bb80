//! Keeps efforts within what the drives can give.

use crate::{ArmModel, ControlError};

/// Limits efforts and the rate at which they change.
///
/// The rate is what takes a joint from zero to its full effort in [`Self::RISE_TIME`] unless set otherwise: a
/// step in the reference then does not become a blow to the gears.
#[derive(Debug, Clone)]
pub struct EffortLimit {
    effort: Vec<f64>,
    rate: Vec<f64>,
    last: Vec<f64>,
    started: bool,
}

impl EffortLimit {
    /// Time from zero to full effort, s: Franka's own limit is 1000 N m/s for joints of 87 N m (franka_ros control
    /// parameters).
    pub const RISE_TIME: f64 = 0.087;

    /// Limits from the URDF's efforts.
    pub fn new(arm: &ArmModel) -> Self {
        // A limit that is not a number is none.
        let effort: Vec<f64> = arm.limits().iter().map(|l| if l.effort.is_nan() { f64::INFINITY } else { l.effort.abs() }).collect();
        let rate = effort.iter().map(|e| e / Self::RISE_TIME).collect();
        Self { last: vec![0.0; effort.len()], effort, rate, started: false }
    }

    /// Sets the rates, N m/s or N/s; infinite for none.
    ///
    /// # Errors
    /// A rate that is not positive, or a wrong number of them.
    pub fn set_rates(&mut self, rates: &[f64]) -> Result<(), ControlError> {
        if rates.len() != self.rate.len() || rates.iter().any(|r| r.is_nan() || *r <= 0.0) {
            let message = format!("{rates:?} must be {} positive numbers", self.rate.len());
            return Err(ControlError::Input { what: "effort rates", message });
        }
        self.rate.copy_from_slice(rates);
        Ok(())
    }

    /// Greatest efforts, N m or N.
    pub fn efforts(&self) -> &[f64] {
        &self.effort
    }

    /// Limits `tau` in place. `period` is the time since the last call, s. The first call sets where the rate starts.
    pub fn apply(&mut self, tau: &mut [f64], period: f64) {
        for (i, tau) in tau.iter_mut().enumerate().take(self.effort.len()) {
            let mut x = tau.clamp(-self.effort[i], self.effort[i]);
            if self.started {
                let reach = if self.rate[i].is_finite() { self.rate[i] * period.max(0.0) } else { f64::INFINITY };
                x = x.clamp(self.last[i] - reach, self.last[i] + reach);
            }
            self.last[i] = x;
            *tau = x;
        }
        self.started = true;
    }

    /// Lets the next call start anywhere.
    pub fn reset(&mut self) {
        self.started = false;
    }
}
