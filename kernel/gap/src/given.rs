//! What is given: checked, joints that cannot move locked, divided into data that are fitted to and data that nothing sees, and put on grids of
//! times. What is refused is refused here, before any work.

use sagci_model::ObjectModel;
use sagci_recording::{JointLog, Log};

use crate::locked::Locked;
use crate::trajectory::{CUT, Trajectory, usual_step};
use crate::{GapError, stops, unheeded, windows};

/// Fewer samples in a window do not tell how a joint moves there.
const LEAST_IN_WINDOW: usize = 10;
/// A joint was brought elsewhere if it is so much of its range from where it was, and farther than it ever goes from one sample to the next.
const ELSEWHERE: f64 = 0.05;
/// The same where no time passed: so many times as far as it ever goes from one sample to the next.
const LEAP: f64 = 3.0;

/// A model and its data.
pub(crate) struct Given<'a> {
    /// The model, with joints locked that the data say nothing of.
    pub locked: Locked<'a>,
    /// What is fitted to.
    pub train: Vec<Trajectory>,
    /// What nothing sees but the last figures.
    pub unseen: Vec<Trajectory>,
    /// What is worth telling a person.
    pub notes: Vec<String>,
}

impl<'a> Given<'a> {
    /// # Errors
    /// Data that do not fit the model or hold too little.
    pub fn new(model: &'a ObjectModel, train: &[Log], held_out: &[Log], window: f64) -> Result<Self, GapError> {
        unheeded::check(model)?;
        apart(train, held_out)?;
        let mut notes = unheeded::notes(train.iter().chain(held_out), model);
        let held_out = if is_still(held_out, model) {
            let place = held_out.iter().map(|l| l.source.as_str()).collect::<Vec<_>>().join(", ");
            notes.push(format!("{place}: nothing moves in these held-out data; the answer is given as if there were none"));
            &[]
        } else {
            held_out
        };
        let (all, held_out) = (going_on(train), going_on(held_out));
        let every: Vec<&Log> = all.iter().chain(&held_out).collect();
        every.iter().try_for_each(|log| check_sampling(log, model, window))?;
        let locked = Locked::new(model, &every)?;
        notes.extend(locked.notes.iter().cloned());
        let on_grid = |logs: &[&Log]| logs.iter().map(|l| Trajectory::new(l, &locked.model)).collect::<Result<Vec<_>, GapError>>();
        let (fitted, aside) = set_aside(&all, &held_out, &mut notes);
        let (mut train, mut unseen) = (on_grid(&fitted)?, on_grid(&aside)?);
        let has_whole = |data: &[Trajectory]| data.iter().any(|t| windows::has_whole(t, window));
        if held_out.is_empty() && !unseen.is_empty() && !(has_whole(&train) && has_whole(&unseen)) {
            notes.push(format!(
                "too few recordings are as long as a window of {window} s to set one aside: what is found is not confirmed on other data"
            ));
            (train, unseen) = (on_grid(&all.iter().collect::<Vec<_>>())?, Vec::new());
        }
        leave_out_stops(&locked.model, [&mut train, &mut unseen], window, &mut notes);
        for data in [&train, &unseen] {
            windows::check(data, window)?;
            windows::say_without(data, window, &mut notes);
        }
        notes.extend(train.iter().chain(&unseen).flat_map(|t| t.notes.iter().cloned()));
        Ok(Self { locked, train, unseen, notes })
    }
}

/// Leaves out what joints do in stops that give way, where windows of a length are in what is left.
fn leave_out_stops(model: &ObjectModel, [train, unseen]: [&mut Vec<Trajectory>; 2], window: f64, notes: &mut Vec<String>) {
    let mut said = Vec::new();
    let soft = stops::soft(model, &train.iter().chain(unseen.iter()).collect::<Vec<_>>(), &mut said);
    if soft.is_empty() {
        return;
    }
    // What rests in a stop all the time is left out as a whole.
    let clear_of = |data: &[Trajectory]| -> Vec<Trajectory> {
        data.iter().map(|t| stops::clear_of(&soft, t)).filter(|t| t.rows() > LEAST_IN_WINDOW).collect()
    };
    let clear = [clear_of(train), clear_of(unseen)];
    let has_whole =
        |(data, all): (&Vec<Trajectory>, &Vec<Trajectory>)| all.is_empty() || data.iter().any(|t| windows::has_whole(t, window));
    if clear.iter().zip([&*train, &*unseen]).all(has_whole) {
        [*train, *unseen] = clear;
        notes.append(&mut said);
    } else {
        notes.push(format!(
            "what joints do in limits that give way was not left out, since no window of {window} s lies between: it may be taken for an effect"
        ));
    }
}

/// Does nothing of the model move in any of these recordings? Such confirm nothing and deny nothing. What holds no joint of it is a mistake, and is
/// refused where joints are read.
fn is_still(logs: &[Log], model: &ObjectModel) -> bool {
    let mut known = logs.iter().flat_map(|l| &l.joints).filter(|j| model.joint(&j.name).is_some()).peekable();
    known.peek().is_some() && known.all(|j| !j.position.moves())
}

/// Are there samples enough in a window?
///
/// # Errors
/// There are not.
pub(crate) fn check_sampling(log: &Log, model: &ObjectModel, window: f64) -> Result<(), GapError> {
    let moving = model.moving_joints().filter_map(|i| log.joint(&model.joints[i].name));
    let Some(period) = moving.filter_map(|j| usual_step(&j.position.time)).reduce(f64::max) else { return Ok(()) };
    if window / period > LEAST_IN_WINDOW as f64 - 0.5 {
        return Ok(());
    }
    let message = format!(
        "is sampled too coarsely: one position each {period:.4} s, and a window of {window} s needs at least {LEAST_IN_WINDOW}. Record at \
         {:.0} Hz or more, or ask for longer windows (`--window`); are times in ms? Then give them in s",
        LEAST_IN_WINDOW as f64 / window
    );
    Err(GapError::data(&log.source, message))
}

/// Recordings that go on from one another: not where a joint was brought elsewhere while nothing was recorded. What is bent stays so while its
/// joint stays; over another way nobody knows it, and it has come to rest.
pub(crate) fn going_on(logs: &[Log]) -> Vec<Log> {
    let mut all = logs.to_vec();
    for (i, log) in all.iter_mut().enumerate().skip(1) {
        log.continues &= !was_brought(&logs[i - 1], &logs[i]);
    }
    all
}

fn was_brought(before: &Log, after: &Log) -> bool {
    after.joints.iter().filter_map(|joint| Some((before.joint(&joint.name)?, joint))).any(|(before, after)| {
        let seen = |joint: &JointLog| -> Vec<(f64, f64)> {
            let series = &joint.position;
            series.time.iter().copied().zip(series.value.iter().copied()).filter(|(_, y)| y.is_finite()).collect()
        };
        let (before, after) = (seen(before), seen(after));
        let (Some(end), Some(first)) = (before.last(), after.first()) else { return false };
        let usual = usual_step(&after.iter().map(|a| a.0).collect::<Vec<_>>()).unwrap_or(0.0);
        let (low, high) = after.iter().fold((f64::MAX, f64::MIN), |(low, high), (_, y)| (low.min(*y), high.max(*y)));
        let at_once = |seen: &[(f64, f64)]| {
            seen.windows(2).filter(|w| w[1].0 - w[0].0 < 1.5 * usual).map(|w| (w[1].1 - w[0].1).abs()).fold(0.0, f64::max)
        };
        let far = (first.1 - end.1).abs();
        let paused = first.0 - end.0 > (CUT.0 * usual).max(CUT.1);
        // Without a pause the clock alone went on: no joint goes so far from one sample to the next.
        let leaps = far > LEAP * at_once(&before).max(at_once(&after));
        (paused || leaps) && far > at_once(&after).max(ELSEWHERE * (high - low))
    })
}

/// Whole trajectories for a check, where none are given: never samples of one.
fn set_aside<'a>(train: &'a [Log], held_out: &'a [Log], notes: &mut Vec<String>) -> (Vec<&'a Log>, Vec<&'a Log>) {
    if !held_out.is_empty() {
        return (train.iter().collect(), held_out.iter().collect());
    }
    if train.len() < 3 {
        notes.push(format!("{} recording(s) are too few to set one aside: what is found is not confirmed on other data", train.len()));
        return (train.iter().collect(), Vec::new());
    }
    // Every fourth, from the second: early and late ones are on both sides.
    let aside = |i: usize| i % 4 == 1;
    (
        train.iter().enumerate().filter(|(i, _)| !aside(*i)).map(|(_, l)| l).collect(),
        train.iter().enumerate().filter(|(i, _)| aside(*i)).map(|(_, l)| l).collect(),
    )
}

/// Refuses data that are to be unseen and are fitted to.
fn apart(train: &[Log], held_out: &[Log]) -> Result<(), GapError> {
    for unseen in held_out.iter().filter(|log| !log.hash.is_empty()) {
        if let Some(seen) = train.iter().find(|log| log.hash == unseen.hash) {
            let message = match seen.source == unseen.source {
                true => "is among the data as well as held out".to_owned(),
                false => format!("is held out, and holds the same as {} among the data", seen.source),
            };
            let hint = "what is fitted to confirms nothing. Name it in one place only";
            return Err(GapError::data(&unseen.source, format!("{message}: {hint}")));
        }
    }
    Ok(())
}
