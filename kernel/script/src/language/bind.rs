//! Which argument of a call goes to which parameter of a skill. Used when a script is checked and again when it runs, so
//! that both say the same.

use sagci_skill::Manifest;

use super::suggest::did_you_mean;
use super::value::{Kind, parameter_words};

/// A call that does not fit its skill.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Misfit {
    /// Place of the argument that is wrong among all that were given (positional ones first, then the named ones).
    pub argument: Option<usize>,
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub hint: Option<String>,
}

/// An argument of a call, as far as it is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Given {
    /// Its name if it stands in the trailing map.
    pub name: Option<String>,
    /// Its kind if it is known.
    pub kind: Option<Kind>,
}

/// For each argument the index of its parameter.
pub fn bind(manifest: &Manifest, given: &[Given]) -> Result<Vec<usize>, Misfit> {
    let mut taken: Vec<Option<usize>> = vec![None; manifest.parameters.len()];
    let mut slots = Vec::with_capacity(given.len());
    for (i, argument) in given.iter().enumerate() {
        let misfit = |message: String, hint: Option<String>| Misfit { argument: Some(i), message, hint };
        let slot = match &argument.name {
            None if i < manifest.parameters.len() => i,
            None => {
                let positional = given.iter().filter(|g| g.name.is_none()).count();
                let message =
                    format!("{} takes at most {} arguments, and {positional} are given", manifest.name, manifest.parameters.len());
                return Err(misfit(message, Some(usage(manifest))));
            }
            Some(name) => {
                let names: Vec<&str> = manifest.parameters.iter().map(|p| p.name.as_str()).collect();
                names.iter().position(|n| n == name).ok_or_else(|| {
                    let hint = did_you_mean(name, names.iter().copied()).unwrap_or_else(|| usage(manifest));
                    misfit(format!("{} has no argument '{name}'", manifest.name), Some(hint))
                })?
            }
        };
        let parameter = &manifest.parameters[slot];
        if taken[slot].is_some() {
            return Err(misfit(format!("{}: '{}' is given twice", manifest.name, parameter.name), None));
        }
        if let Some(Err(hint)) = argument.kind.map(|kind| kind.fits(parameter.kind)) {
            let is = argument.kind.map_or("", Kind::words);
            let message = format!("{}: '{}' is {is}, and must be {}", manifest.name, parameter.name, parameter_words(parameter.kind));
            return Err(misfit(message, Some(hint.to_owned())));
        }
        taken[slot] = Some(i);
        slots.push(slot);
    }
    match manifest.parameters.iter().zip(&taken).find(|(p, t)| p.required && t.is_none()) {
        None => Ok(slots),
        Some((missing, _)) => Err(Misfit {
            argument: None,
            message: format!("{} needs '{}' ({})", manifest.name, missing.name, parameter_words(missing.kind)),
            hint: Some(usage(manifest)),
        }),
    }
}

/// How a skill is called, for example `open(object, [amount])`.
pub fn usage(manifest: &Manifest) -> String {
    let parameters: Vec<String> =
        manifest.parameters.iter().map(|p| if p.required { p.name.clone() } else { format!("[{}]", p.name) }).collect();
    format!("write {}({})", manifest.name, parameters.join(", "))
}
