//! What data that no fit and no choice has seen say of names that are settled.

use rayon::prelude::*;

use crate::GapError;
use crate::fit::{Fit, Problem};
use crate::gaps::Measure;
use crate::report::Reason;
use crate::search::{Search, entries};
use crate::trajectory::Trajectory;
use crate::weigh::SMALLER;

/// Half a fall of squared errors, in units of their noise, that is no chance.
const SEEN: f64 = 3.0;
/// Standard deviations below what is expected that are no chance.
const CHANCE: f64 = 3.0;

/// What unseen data say of an effect, in units of their noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unseen {
    /// Half the fall of the squared errors.
    pub fall: f64,
    /// The same if the effect is just as it was fitted.
    pub expected: f64,
    /// Where the errors speak against it: it predicts whole windows better all the same. From row to row a model that sticks is shaken
    /// loose by the noise of what drives it, over a window it is where it was.
    pub predicts: bool,
}

impl Unseen {
    /// They would show it, and they do not, by more than chance. If it is there, the fall is normal about what is expected, with twice that
    /// for its variance.
    pub fn contradicts(&self) -> bool {
        let by_chance = self.expected - CHANCE * (2.0 * self.expected).sqrt();
        !self.predicts && self.expected > SEEN && self.fall < SEEN.min(0.1 * self.expected).min(by_chance)
    }

    /// They show it.
    pub fn confirms(&self) -> bool {
        self.predicts || self.fall > SEEN
    }

    pub fn reason(&self, name: &str) -> Reason {
        let reason = format!("held-out data, in which it would show, speak against it (half the squared errors rise by {:.1})", -self.fall);
        Reason { name: name.into(), reason }
    }
}

impl Search<'_> {
    /// For each effect: how much better it makes unseen data (half the fall of the squared errors), and whether that confirms it.
    pub fn on_unseen(
        &self,
        current: &Fit,
        base: &Fit,
        unseen: &[Trajectory],
        measure: &Measure<'_>,
        scale: f64,
    ) -> Result<Vec<Unseen>, GapError> {
        let all = entries(&current.hypothesis);
        all.par_iter()
            .map(|entry| {
                let less = if all.len() == 1 { base.clone() } else { self.fit_on(current.without(&self.problem, *entry)?, scale)? };
                let nothing = Unseen { fall: 0.0, expected: 0.0, predicts: false };
                let mut said = self.unseen_of(current, &less, unseen, scale).unwrap_or(nothing);
                let gap = |fit: &Fit| measure.pooled(&fit.hypothesis, None).unwrap_or(f64::INFINITY);
                said.predicts = said.contradicts() && gap(current) < SMALLER * gap(&less);
                Ok(said)
            })
            .collect()
    }

    /// What unseen data say of one fit against another; none where there are no such data, or where one cannot follow them.
    fn unseen_of(&self, with: &Fit, without: &Fit, unseen: &[Trajectory], scale: f64) -> Option<Unseen> {
        let Problem { disturbance, limits, step, .. } = &self.problem;
        let problem = Problem::new(unseen, disturbance.clone(), limits, *step);
        let errors = |fit: &Fit| problem.errors(&fit.hypothesis, &fit.hypothesis.x).ok();
        let (with, without) = (errors(with)?, errors(without)?);
        let change = &without - &with;
        let weight = 0.5 / (scale * scale * problem.persistence(&with, &change));
        let fall = weight * (without.norm_squared() - with.norm_squared());
        (!unseen.is_empty()).then(|| Unseen { fall, expected: weight * change.norm_squared(), predicts: false })
    }
}

#[cfg(test)]
mod tests {
    use super::Unseen;

    /// Of an effect that makes little difference to the unseen data, chance alone can make that difference disappear.
    #[test]
    fn a_veto_is_no_chance() {
        let contradicts = |expected: f64, fall: f64| Unseen { fall, expected, predicts: false }.contradicts();
        assert!(!contradicts(5.0, -3.0) && contradicts(5.0, -10.0), "a small one");
        assert!(contradicts(100.0, 2.0) && contradicts(100.0, -50.0) && !contradicts(100.0, 90.0), "a large one");
        assert!(!contradicts(2.0, -50.0), "they would not show it");
    }
}
