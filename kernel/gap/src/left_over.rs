//! What names leave over, or all that is missing where there are none: a force without a name, if it is there.

use crate::GapError;
use crate::choice::Choice;
use crate::fit::Fit;
use crate::flexible::Nameless;
use crate::report::{Gap, Gaps, Unexplained};
use crate::search::Search;
use crate::weigh::{CONVINCING, MATERIAL};

/// How many times its noise floor a gap is that cannot be smaller.
const NEAR_FLOOR: f64 = 1.2;
/// Evidence of a force without a name that is there though the gap hardly shows it.
const CERTAIN: f64 = 100.0;
/// Share of the lacking force below which nobody minds that it has no name.
const NEGLIGIBLE: f64 = 0.02;

/// What was named.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Named {
    Something,
    /// Nothing but neighbours of what is there.
    Near,
    /// A force without a name says more than the best name.
    NamelessWon,
    Nothing,
}

impl Named {
    pub fn of(chosen: &[Choice], nameless_won: bool) -> Self {
        match (chosen.is_empty(), nameless_won) {
            (false, _) => Self::Something,
            (true, true) => Self::NamelessWon,
            (true, false) => Self::Nothing,
        }
    }
}

/// What a fit leaves over, if that is there: a force on a joint that is likely and that predictions miss.
pub(crate) fn left_over(
    search: &Search<'_>,
    (current, refitted): (&Fit, &Fit),
    (joint, nameless): &(usize, Nameless),
    gap: &Gaps,
    named: Named,
) -> Result<Option<Unexplained>, GapError> {
    let lacking = search.explained_force(current, refitted)?;
    let share = nameless.force / lacking.hypot(nameless.force).max(1e-12);
    // Windows that are far off say so even where the force is small beside others.
    let off = gap.train.is_far();
    let far = gap.held_out.as_ref().map_or(off, Gap::is_far);
    // Where nothing is named and data that nothing was fitted to are far off, something is missing that the known numbers hide where they are
    // fitted. What many joints are off by is mostly chance: nothing holds them.
    let lacks = far && named != Named::Something && !search.many_joints();
    let near = |gap: &Gap| gap.after < NEAR_FLOOR * gap.noise_floor;
    // A model that predicts as well as the noise lets any lacks nothing that its errors alone hint at, least of all one with names.
    let at_the_floor = near(&gap.train) && !gap.held_out.as_ref().is_some_and(Gap::is_far);
    let enough = match (at_the_floor, named) {
        (false, _) => 0.0,
        (true, Named::Something) => f64::INFINITY,
        (true, _) => CERTAIN,
    };
    // Nor does one that predicts unseen data so well, if the errors that hint at it hang together.
    let predicts_well = near(gap.held_out.as_ref().unwrap_or(&gap.train));
    let felt = nameless.force > MATERIAL * search.typical_force()[*joint] || off;
    let counts = nameless.evidence > 2.0 * CONVINCING && share > NEGLIGIBLE;
    let is_there = lacks || named == Named::Near || felt && nameless.evidence > enough && (counts || named == Named::NamelessWon);
    let shows = is_there && (!predicts_well || search.is_plain(current, nameless));
    Ok(shows.then(|| Unexplained { share, joint: search.names[*joint].clone(), over: nameless.over.into(), region: nameless.region }))
}
