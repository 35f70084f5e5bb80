//! What may be published without asking.

use sagci_model::ObjectModel;

use crate::Found;

impl Found {
    /// The model with only those effects that held-out data confirm, or nothing if there are none. Their values stay as fitted beside the
    /// others: an effect that held-out data never reach is no reason to let its share of the force bend the numbers of those that they do.
    pub fn confirmed(&self) -> Option<ObjectModel> {
        if !self.report.effects.iter().any(|e| e.confirmed) {
            return None;
        }
        let mut model = self.model.clone();
        for doubted in self.report.effects.iter().filter(|e| !e.confirmed) {
            // What was found stands behind what the model had.
            let entry = model.document.effects.iter().rposition(|e| e.effect == doubted.name && e.joint == doubted.joint);
            if let Some(entry) = entry {
                model.document.effects.remove(entry);
            }
        }
        Some(model)
    }
}
