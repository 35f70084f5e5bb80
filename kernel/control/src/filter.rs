//! Smooths a measured wrench.

use nalgebra::Vector3;
use sagci_signal::Wrench;

use crate::ControlError;

/// First-order low pass: `dy/dt = (x - y) 2 pi f`, exact for inputs held over the period. It starts at the first value.
#[derive(Debug, Clone)]
pub struct WrenchFilter {
    share: f64,
    value: Option<Wrench>,
}

impl WrenchFilter {
    /// A filter with the cut-off frequency `cutoff` in Hz, stepped each `period` in s.
    ///
    /// # Errors
    /// A frequency or period that is not positive.
    pub fn new(cutoff: f64, period: f64) -> Result<Self, ControlError> {
        if !(cutoff > 0.0 && period > 0.0 && cutoff.is_finite() && period.is_finite()) {
            let message = format!("cut-off {cutoff} Hz and period {period} s must be positive");
            return Err(ControlError::Input { what: "wrench filter", message });
        }
        Ok(Self { share: 1.0 - (-2.0 * std::f64::consts::PI * cutoff * period).exp(), value: None })
    }

    /// Takes in a measurement and gives the smoothed value. A measurement that is not finite is left out.
    pub fn step(&mut self, measured: &Wrench) -> Wrench {
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        if finite(&measured.force) && finite(&measured.torque) {
            self.value = Some(match self.value {
                None => *measured,
                Some(last) => Wrench {
                    force: last.force + (measured.force - last.force) * self.share,
                    torque: last.torque + (measured.torque - last.torque) * self.share,
                },
            });
        }
        self.value.unwrap_or_default()
    }

    /// Forgets what it has seen.
    pub fn reset(&mut self) {
        self.value = None;
    }
}
