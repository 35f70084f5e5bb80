//! What was predicted once over windows is not predicted again: names are weighed against one another by the same few models.

use std::sync::{Arc, Mutex, PoisonError};

use sagci_model::EffectEntry;

use crate::hypothesis::{Hypothesis, Knob};

/// What tells one prediction over the same data from another.
#[derive(Debug, Clone, PartialEq)]
struct Asked {
    window: f64,
    numbers: Vec<(Knob, f64)>,
    effects: Vec<EffectEntry>,
}

/// The pooled gap of hypotheses over one set of data. Clones share what they remember.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory {
    known: Arc<Mutex<Vec<(Asked, f64)>>>,
}

impl Memory {
    /// The gap of a hypothesis over windows of a length, made where they are not known. What fails is asked again.
    pub fn or_else<E>(&self, hypothesis: &Hypothesis, window: f64, make: impl FnOnce() -> Result<f64, E>) -> Result<f64, E> {
        let numbers = hypothesis.fitted.iter().map(|f| f.knob.clone()).zip(hypothesis.x.iter().copied()).collect();
        let asked = Asked { window, numbers, effects: hypothesis.model.document.effects.clone() };
        // A thread that panicked has left whole entries.
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let found = known().iter().find(|(other, _)| *other == asked).map(|(_, gap)| *gap);
        if let Some(gap) = found {
            return Ok(gap);
        }
        let gap = make()?;
        known().push((asked, gap));
        Ok(gap)
    }
}
