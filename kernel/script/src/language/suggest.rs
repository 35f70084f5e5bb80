//! "Did you mean".

/// The nearest of the known words, if one is near enough to be meant (Damerau-Levenshtein distance of a third of the
/// word's length or less).
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let allowed = (word.chars().count() / 3).max(1);
    known
        .into_iter()
        .filter(|k| !k.is_empty() && *k != word)
        .map(|k| (strsim::damerau_levenshtein(&word.to_lowercase(), &k.to_lowercase()), k))
        .filter(|(distance, _)| *distance <= allowed)
        .min()
        .map(|(_, k)| k)
}

/// `did you mean 'open'?`
pub fn did_you_mean<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(word, known).map(|k| format!("did you mean '{k}'?"))
}

/// The nearest word, or else the list of all.
pub fn hint_among<'a>(word: &str, what: &str, known: impl IntoIterator<Item = &'a str> + Clone) -> String {
    did_you_mean(word, known.clone()).unwrap_or_else(|| {
        let mut all: Vec<&str> = known.into_iter().collect();
        all.sort_unstable();
        if all.is_empty() { format!("there are no {what}") } else { format!("{what}: {}", all.join(", ")) }
    })
}
