//! Reading text within limits, and naming what was probably meant.

use std::io::Read;
use std::path::Path;

use crate::ModelError;

/// Greatest size of a URDF, bytes. The largest humanoids' are a tenth of this.
pub(crate) const URDF_BYTES: u64 = 8 << 20;
/// Greatest size of a `model.yaml`, bytes.
pub(crate) const DOCUMENT_BYTES: u64 = 1 << 20;
/// Greatest size of a mesh, bytes.
pub(crate) const MESH_BYTES: u64 = 256 << 20;

/// Reads a regular file of at most `limit` bytes.
pub(crate) fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>, ModelError> {
    let file_error = |source| ModelError::File { path: path.to_owned(), source };
    // A pipe or a device would make the reader wait for ever: only regular files are opened.
    let metadata = std::fs::metadata(path).map_err(file_error)?;
    if !metadata.is_file() {
        return Err(ModelError::Malformed { path: path.to_owned(), line: None, message: "is not a regular file".into() });
    }
    let mut bytes = Vec::new();
    std::fs::File::open(path).map_err(file_error)?.take(limit + 1).read_to_end(&mut bytes).map_err(file_error)?;
    if bytes.len() as u64 > limit {
        let message = format!("is larger than the {} MiB that are read", limit >> 20);
        return Err(ModelError::Malformed { path: path.to_owned(), line: None, message });
    }
    Ok(bytes)
}

/// Reads a UTF-8 file of at most `limit` bytes, without the byte order mark that some editors put first.
pub(crate) fn read_text(path: &Path, limit: u64) -> Result<String, ModelError> {
    let text = String::from_utf8(read_bytes(path, limit)?).map_err(|e| {
        let valid = e.utf8_error().valid_up_to();
        let line = 1 + e.as_bytes()[..valid].iter().filter(|b| **b == b'\n').count();
        ModelError::Malformed { path: path.to_owned(), line: Some(line), message: "is not UTF-8 text; save it as UTF-8".into() }
    })?;
    Ok(text.strip_prefix('\u{feff}').map_or(text.clone(), str::to_owned))
}

/// The candidate that a misspelt name was probably meant to be, if one is near enough.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let wanted = name.to_lowercase();
    candidates
        .into_iter()
        .map(|c| (strsim::damerau_levenshtein(&wanted, &c.to_lowercase()), c))
        .filter(|(distance, c)| *distance * 3 <= wanted.chars().count().max(c.chars().count()))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, c)| c)
}

/// The end of an error message about an unknown name: what was probably meant, else what there is.
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let candidates: Vec<&str> = candidates.into_iter().collect();
    if let Some(best) = nearest(name, candidates.iter().copied()) {
        return format!("; did you mean '{best}'?");
    }
    match candidates.as_slice() {
        [] => "; there are none".into(),
        few if few.len() <= 12 => format!("; there are: {}", few.join(", ")),
        many => format!("; there are {} others, among them: {}", many.len(), many[..12].join(", ")),
    }
}

/// serde names an unknown field or variant and lists what it expected: from that, what was probably meant.
pub(crate) fn hint_in_serde_message(message: &str) -> String {
    if !message.contains("unknown field") && !message.contains("unknown variant") {
        return String::new();
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let Some(name) = quoted.next() else { return String::new() };
    nearest(name, quoted).map(|best| format!("; did you mean '{best}'?")).unwrap_or_default()
}
