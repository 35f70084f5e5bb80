//! What was asked once of a model over windows is not asked again: names are weighed against one another by the same few models.

use std::convert::Infallible;
use std::sync::{Arc, Mutex, PoisonError};

use crate::hypothesis::Hypothesis;

/// What is known of models over one set of data: their pooled gaps, by the windows' length, s, too, and the factors on the noises of positions and
/// accelerations under which data are followed. Clones share what they remember.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory {
    gaps: Known<f64>,
    factors: Known<[f64; 2]>,
}

impl Memory {
    /// The gap of a hypothesis over windows of a length, made where it is not known. What fails is asked again.
    pub fn gap<E>(&self, hypothesis: &Hypothesis, window: f64, make: impl FnOnce() -> Result<f64, E>) -> Result<f64, E> {
        self.gaps.or_else(format!("{window} {}", said(hypothesis)), make)
    }

    /// The factors under which data are followed with a hypothesis.
    pub fn factors(&self, hypothesis: &Hypothesis, make: impl FnOnce() -> [f64; 2]) -> [f64; 2] {
        let Ok(factors) = self.factors.or_else(said(hypothesis), || Ok::<_, Infallible>(make()));
        factors
    }
}

/// All that a model says. Numbers are written so that they read back the same.
fn said(hypothesis: &Hypothesis) -> String {
    format!("{:?}", hypothesis.model_at(&hypothesis.x))
}

#[derive(Debug, Clone, Default)]
struct Known<T>(Arc<Mutex<Vec<(String, T)>>>);

impl<T: Copy> Known<T> {
    fn or_else<E>(&self, of: String, make: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        // A thread that panicked has left whole entries.
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = known().iter().find(|(other, _)| *other == of).map(|(_, known)| *known);
        if let Some(found) = found {
            return Ok(found);
        }
        let made = make()?;
        known().push((of, made));
        Ok(made)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::tests::door;

    /// Two models may be fitted in the same numbers, at the same values, and differ in what is not fitted.
    #[test]
    fn models_that_differ_in_what_is_not_fitted_are_not_taken_for_one() {
        let memory = Memory::default();
        let asked = |damping: f64, window: f64, gap: f64| {
            let mut model = door();
            model.joints[0].damping = damping;
            let hypothesis = Hypothesis { x: Vec::new(), fitted: Vec::new(), ..Hypothesis::known(&model, &[0]) };
            memory.gap(&hypothesis, window, || Ok::<f64, ()>(gap)).unwrap()
        };
        assert_eq!(asked(0.1, 1.0, 3.0), 3.0);
        assert_eq!(asked(0.1, 1.0, 4.0), 3.0, "asked twice");
        assert_eq!(asked(0.2, 1.0, 5.0), 5.0);
        assert_eq!(asked(0.1, 0.25, 6.0), 6.0);
    }
}
