//! What names leave over, or all that is missing where there are none: a force without a name, if it is there.

use crate::GapError;
use crate::choice::Choice;
use crate::fit::Fit;
use crate::flexible::Nameless;
use crate::report::{Gap, Gaps, Unexplained};
use crate::search::Search;
use crate::trajectory::Trajectory;
use crate::weigh::{CONVINCING, MATERIAL};

/// How many times its noise floor a gap is that cannot be smaller.
const NEAR_FLOOR: f64 = 1.2;
/// The same of one that may hold nothing more where names explain all but so small a share of the gap, on data that nothing was fitted to, too:
/// there their force is right to more than errors of its slopes and its size, and noisy efforts alone lead those astray.
const CLOSE_TO_FLOOR: f64 = 2.0;
const ALL_BUT: f64 = 0.05;
/// Evidence of a force without a name that is there though the gap hardly shows it, or for each of the errors that would hang together without it.
const CERTAIN: f64 = 100.0;
/// Scale of the errors, in deviations of their noise, from which on something makes them that is none: without anything missing it was 1.04 at
/// the most.
const BEYOND_NOISE: f64 = 1.2;
/// Share of the lacking force below which nobody minds that it has no name.
const NEGLIGIBLE: f64 = 0.02;

/// Share of what joints move through below which a gap without a name is none: engines of the same model differ by as much within a second.
const NOTHING: f64 = 2e-4;

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
    let unseen = gap.held_out.as_ref().unwrap_or(&gap.train);
    if named != Named::Near && [unseen, &gap.train].iter().all(|g| is_nothing(search, g)) {
        return Ok(None);
    }
    if named == Named::Something && is_explained(&gap.train, unseen) {
        return Ok(None);
    }
    // Beside an unstable rest a few windows end anywhere.
    let far = unseen.is_far() && unseen.is_mostly_far();
    // Where nothing is named and data that nothing was fitted to are far off, something is missing that the known numbers hide where they are
    // fitted. What many joints are off by is mostly chance: nothing holds them.
    let lacks = far && named != Named::Something && !search.many_joints();
    // A model that predicts as well as the noise lets any lacks nothing that its errors alone hint at, least of all one with names.
    let at_the_floor = is_at_floor(&gap.train) && !unseen.is_far();
    let enough = match (at_the_floor, named) {
        (false, _) => 0.0,
        (true, Named::Something) => f64::INFINITY,
        (true, _) => CERTAIN,
    };
    // Errors that are larger than noise makes them say so by themselves.
    let beyond_noise = named != Named::Something && search.scale(current) > BEYOND_NOISE;
    let is_large = nameless.force > MATERIAL * search.typical_force()[*joint];
    let counts = nameless.evidence > 2.0 * CONVINCING && share > NEGLIGIBLE;
    // Windows that are far off say so even where the force is small beside others.
    let felt = is_large || far || named == Named::Something && gap.train.is_far();
    let is_there = lacks || named == Named::Near || felt && nameless.evidence > enough && (counts || named == Named::NamelessWon);
    let by_chance = may_be_chance(named, [&gap.train, unseen], far || is_large && gap.train.is_far() && gap.train.is_mostly_far());
    let is_plain = || search.is_plain(current, nameless) || named != Named::Something && hangs_together(search, current, nameless);
    let in_doubt = at_the_floor || named == Named::Something && search.problem.disturbance.effort[*joint] > 0.0;
    let shows = beyond_noise || is_there && (!by_chance || is_plain()) && (!in_doubt || holds(search, current, *joint, nameless)?);
    Ok(shows.then(|| Unexplained { share, joint: search.names[*joint].clone(), over: nameless.over.into(), region: nameless.region }))
}

/// Can it not be smaller?
fn is_at_floor(gap: &Gap) -> bool {
    gap.after < NEAR_FLOOR * gap.noise_floor
}

/// May errors hint at a force by chance, as those do that hang together? Beside names they may where unseen data are predicted well. Where rows were
/// sure of a name that is but near, these have to be so, too, that all was fitted to: unseen data may not reach what is there. Without any they
/// may where windows are not `far` off: unseen ones, or those that all was fitted to by more than what any model is off by.
fn may_be_chance(named: Named, [fitted, unseen]: [&Gap; 2], far: bool) -> bool {
    match named {
        Named::Something => is_at_floor(unseen),
        Named::Near => is_at_floor(unseen) && is_at_floor(fitted),
        Named::NamelessWon | Named::Nothing => !far,
    }
}

/// Is a gap small beside the motion? A model may give a joint far more range than it ever uses.
fn is_nothing(search: &Search<'_>, gap: &Gap) -> bool {
    let share = |(j, name): (usize, &String)| {
        let joint = gap.per_joint.get(name)?;
        let [low, high] = Trajectory::range(search.problem.trajectories.iter(), j);
        let way = if search.still[j] { joint.range } else { joint.range.min(high - low) };
        Some((joint.after / way).powi(2))
    };
    let shares = search.names.iter().enumerate().filter_map(share);
    shares.sum::<f64>() < NOTHING.powi(2) * search.names.len() as f64
}

/// Do names leave next to nothing of the gap, on data that nothing was fitted to, too, and little more than noise makes?
fn is_explained(train: &Gap, unseen: &Gap) -> bool {
    [train, unseen].iter().all(|g| g.left() < ALL_BUT) && train.after < CLOSE_TO_FLOOR * train.noise_floor
}

/// Is a force what errors hang together by? Without it they hardly do. Of what turns round where the motion does that says nothing: such forces are
/// seen by chance.
fn hangs_together(search: &Search<'_>, current: &Fit, nameless: &Nameless) -> bool {
    let left = || search.problem.persistence(&(&current.errors + &nameless.change), &nameless.change);
    !nameless.turns_round && nameless.evidence > CERTAIN * left()
}

/// Is a force still there where it acts in the simulator? By place or speed it can: where effort is noisy and dry friction holds a joint, the linear
/// response sees forces that are none.
fn holds(search: &Search<'_>, current: &Fit, joint: usize, nameless: &Nameless) -> Result<bool, GapError> {
    if search.many_joints() || !["position", "velocity"].contains(&nameless.over) {
        return Ok(true);
    }
    Ok(search.free(current, joint, search.scale(current), 0.0)?.is_some_and(|free| free.evidence > 2.0 * CONVINCING))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::{Named, hangs_together, is_explained, is_nothing, may_be_chance};
    use crate::report::Gap;
    use crate::search::Search;
    use crate::tests::{door, swing, with};
    use crate::trajectory::Trajectory;

    fn gap(after: f64) -> Gap {
        crate::tests::gap([1.0, after, 0.02])
    }

    /// A loop of friction whose numbers noisy efforts led astray; a spring with a kink, which three others imitate.
    #[test]
    fn names_are_not_doubted_for_errors_of_their_numbers_and_are_for_a_shape_that_is_wrong() {
        assert!(is_explained(&gap(0.025), &gap(0.04)));
        assert!(!is_explained(&gap(0.045), &gap(0.04)), "more than twice what noise makes");
        assert!(!is_explained(&gap(0.025), &gap(0.2)), "a fifth of what was unseen is left");
    }

    /// Figures of a damping at one place, under much noise: unseen data hardly went there, and the verdict was that nothing is missing.
    #[test]
    fn a_force_that_unseen_data_do_not_reach_is_not_chance_where_rows_are_sure_of_a_neighbour() {
        let [fitted, unseen] = [0.061, 0.0224].map(gap);
        assert!(!may_be_chance(Named::Near, [&fitted, &unseen], false));
        assert!(may_be_chance(Named::Near, [&unseen, &unseen], false), "nor do those that all was fitted to show it");
        assert!(may_be_chance(Named::Something, [&fitted, &unseen], false), "what names leave");
    }

    /// A slide that its model gives forty metres moved by half of one, and a gap ten times its floor was none.
    #[test]
    fn a_gap_is_nothing_beside_the_motion_and_not_beside_what_a_model_allows() {
        let data = [Trajectory::new(&swing(&door(), 2e-4, 1), &door()).unwrap()];
        let search = Search::new(&door(), &data).unwrap();
        let [low, high] = Trajectory::range(data.iter(), 0);
        let beside_far_limits = |share: f64| {
            let mut gap = gap(share * (high - low));
            gap.per_joint.values_mut().for_each(|joint| joint.range = 100.0 * (high - low));
            gap
        };
        assert!(is_nothing(&search, &beside_far_limits(1e-4)));
        assert!(!is_nothing(&search, &beside_far_limits(1e-3)));
    }

    /// Errors that a force makes hang together as long as it acts. Counted as few for that, a dozen times the evidence that is asked said nothing.
    #[test]
    fn a_force_is_not_doubted_for_what_hangs_together_by_it() {
        let truth = with(&door(), "joint_spring", &[("stiffness", 0.05), ("rest_position", 0.7)]);
        let data = [Trajectory::new(&swing(&truth, 2e-4, 1), &door()).unwrap()];
        let search = Search::new(&door(), &data).unwrap();
        let base = search.known(&door(), 1.0).unwrap();
        let (_, force) = search.nameless(&base, 1.0).unwrap().unwrap();
        let without = search.problem.persistence(&base.errors, &force.change);
        assert!(force.over == "position" && without > 20.0, "{} {without}", force.over);
        assert!(hangs_together(&search, &base, &force));
        let turning = crate::flexible::Nameless { turns_round: true, ..force };
        assert!(!hangs_together(&search, &base, &turning), "friction is seen by chance");
    }
}
