//! Where a model and data disagree: the most likely force without a name, joint by joint.

use crate::GapError;
use crate::fit::Fit;
use crate::report::Where;
use crate::search::Search;

/// Joints on which a force is lacking, the worst first.
///
/// Its probability by chance is at most the inverse of its Bayes factor (Markov's inequality; Vovk and Wang 2021).
pub(crate) fn places(search: &Search<'_>, fit: &Fit, scale: f64) -> Result<Vec<Where>, GapError> {
    let typical = search.typical_force();
    let mut found: Vec<Where> = search
        .nameless_by_joint(fit, scale)?
        .into_iter()
        .enumerate()
        .filter_map(|(j, found)| {
            let found = found?;
            let share = if found.evidence > 0.0 { (found.force / typical[j].max(1e-12)).powi(2) } else { 0.0 };
            Some(Where {
                joint: search.names[j].clone(),
                channel: "joint".into(),
                region: found.region,
                share,
                p_value: (-found.evidence).exp().min(1.0),
            })
        })
        .collect();
    let total: f64 = found.iter().map(|w| w.share).sum();
    for place in &mut found {
        place.share = if total > 0.0 { place.share / total } else { 0.0 };
    }
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok(found)
}
