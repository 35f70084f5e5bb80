/// An effect that a run says its stored model lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NamedEffect {
    /// Its name in the catalogue.
    pub name: String,
    /// Names that the data could not tell from it.
    pub alternatives: Vec<String>,
    /// Its joint.
    pub joint: String,
}

impl NamedEffect {
    /// Does a name stand in the answer?
    pub(crate) fn names(&self, name: &str) -> bool {
        self.name == name || self.alternatives.iter().any(|a| a == name)
    }
}
