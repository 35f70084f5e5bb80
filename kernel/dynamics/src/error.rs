/// Why dynamics could not be built or computed. Every message says where and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DynamicsError {
    /// The models cannot be put together.
    #[error("{part}: {place}: {message}")]
    Build {
        /// Name of the part.
        part: String,
        /// Link, joint or effect that is wrong.
        place: String,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// A link, joint, effect or parameter is named that does not exist.
    #[error("there is no {kind} '{name}'{hint}")]
    Unknown {
        /// What was looked for: `link`, `joint`, `effect`, `parameter of viscous_friction`.
        kind: String,
        /// The name that was given.
        name: String,
        /// The nearest name or the names that exist, as the end of the sentence.
        hint: String,
    },
    /// A vector has the wrong number of entries.
    #[error("{what} has {given} entries instead of {needed}")]
    Length {
        /// Which vector.
        what: &'static str,
        /// Entries given.
        given: usize,
        /// Entries needed.
        needed: usize,
    },
    /// A number is infinite or not a number.
    #[error("{what}[{index}] is {value}; it must be a finite number")]
    NotFinite {
        /// Which vector.
        what: &'static str,
        /// Which entry.
        index: usize,
        /// Its value, as text, so that errors compare.
        value: String,
    },
    /// A number is outside what it may be.
    #[error("{what} is {value}; it must be {must}")]
    OutOfBounds {
        /// Which quantity.
        what: String,
        /// Its value.
        value: f64,
        /// What it must be.
        must: String,
    },
    /// The workspace was made for another multibody.
    #[error("the workspace was made for another multibody; make it with `Multibody::workspace`")]
    ForeignWorkspace,
    /// A joint moves nothing that has inertia, so its acceleration is undefined.
    #[error("joint '{joint}' moves no inertia; give the links behind it mass")]
    NoInertia {
        /// The joint.
        joint: String,
    },
    /// A step of a rollout failed, forwards or backwards.
    #[error("step {step} (t = {time:.6} s){}: {source}", joint.as_ref().map_or_else(String::new, |j| format!(", joint '{j}'")))]
    AtStep {
        /// Which step, from 0.
        step: usize,
        /// Time at its start, s.
        time: f64,
        /// The joint, where one is to blame.
        joint: Option<String>,
        /// What happened.
        source: Box<DynamicsError>,
    },
    /// A shape cannot take part in contact.
    #[error("'{place}' {message}")]
    Shape {
        /// The link, as `part/link`.
        place: String,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// A solver did not reach its tolerance.
    #[error("{what} did not converge (residual {residual:.3e} after {iterations} iterations); try a smaller step")]
    NoConvergence {
        /// Which solver.
        what: &'static str,
        /// What was left.
        residual: f64,
        /// Iterations used.
        iterations: usize,
    },
}

/// Checks the length of a vector and that all its entries are finite.
#[inline]
pub(crate) fn check(what: &'static str, values: &[f64], needed: usize) -> Result<(), DynamicsError> {
    // One branch for the whole vector, and several of its values at a time: a sum would be made in order, and delays keep long histories.
    if values.len() == needed && values.iter().fold(true, |all, x| all & x.is_finite()) {
        return Ok(());
    }
    fault(what, values, needed)
}

#[cold]
#[inline(never)]
fn fault(what: &'static str, values: &[f64], needed: usize) -> Result<(), DynamicsError> {
    if values.len() != needed {
        return Err(DynamicsError::Length { what, given: values.len(), needed });
    }
    let index = values.iter().position(|x| !x.is_finite()).unwrap_or(0);
    Err(DynamicsError::NotFinite { what, index, value: values[index].to_string() })
}

/// "; did you mean 'x'?" if a name is near, otherwise the names that exist.
pub(crate) fn hint<'a>(name: &str, names: impl Iterator<Item = &'a str> + Clone) -> String {
    let nearest = names.clone().map(|n| (strsim::jaro_winkler(name, n), n)).max_by(|a, b| a.0.total_cmp(&b.0));
    match nearest {
        Some((score, n)) if score > 0.8 => format!("; did you mean '{n}'?"),
        Some(_) => format!("; there are: {}", names.take(40).collect::<Vec<_>>().join(", ")),
        None => "; there are none".into(),
    }
}
