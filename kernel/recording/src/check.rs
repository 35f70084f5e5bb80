//! Whether series can be what they are said to be: names, units, and whether anything moves.

use std::f64::consts::PI;
use std::path::Path;

use sagci_model::{JointKind, ObjectModel, did_you_mean, nearest};

use crate::read::{Angles, Lengths, Options};
use crate::{CommandKind, JointLog, Log, Note, RecordingError, Series, turns};

/// Share of a joint's range by which positions may be beyond its limits before the unit is doubted: stops give way, zeros are off.
const BEYOND: f64 = 0.25;
/// So many rad beyond the limits are never doubted.
const SLACK: f64 = 0.35;
/// A joint without limits that turns further than this, rad, is doubted in a note.
const TURNS: f64 = 4.0 * PI;
/// One that turns further than this to both sides and comes back again and again is asked about: in degrees it would be a swing.
const SWINGS: f64 = 8.0 * PI;
/// A sliding joint that goes so many times as far as its limits are from zero and from one another is asked about: in millimetres it would
/// be a thousand times. One without limits, where it goes so many m.
const MANY: f64 = 20.0;
/// A position that covers less than this, rad or m, may be noise alone.
const SMALL_MOTION: f64 = 0.01;
/// A position that covers less than this, rad or m, is at rest.
const NO_MOTION: f64 = 1e-6;

/// Holds one recording against the model, and converts degrees and millimetres.
/// `is_chosen`: somebody chose what the file holds; a robot records whatever joints there are.
pub(crate) fn check(
    path: &Path,
    log: &mut Log,
    model: Option<&ObjectModel>,
    options: Options,
    is_chosen: bool,
) -> Result<(), RecordingError> {
    if let Some(model) = model {
        names(path, log, model, is_chosen)?;
        convert(log, model, options);
        units(path, log, model, options)?;
        turns::count(log, model);
    }
    let mut notes = Vec::new();
    let pushed = |joint: &JointLog| model.is_some_and(|m| log.pushes(m, &joint.name));
    let pushed: Vec<String> = log.joints.iter().filter(|j| pushed(j)).map(|j| j.name.clone()).collect();
    for joint in log.joints.iter_mut().filter(|j| model.is_none_or(|m| m.joint(&j.name).is_some())) {
        constants(joint, &mut notes);
        inputs(joint, pushed.contains(&joint.name), &mut notes);
    }
    log.notes.append(&mut notes);
    Ok(())
}

/// Which joints and links are the model's.
fn names(path: &Path, log: &mut Log, model: &ObjectModel, is_chosen: bool) -> Result<(), RecordingError> {
    let moving: Vec<&str> = model.moving_joints().map(|i| model.joints[i].name.as_str()).collect();
    let wrong = |message: String| Err(RecordingError::Joints { path: path.to_owned(), message });
    let measured: Vec<&str> = log.joints.iter().map(|j| j.name.as_str()).collect();
    let is_known = |name: &str| model.joint(name).is_some();
    let others: Vec<&str> = measured.iter().copied().filter(|n| !is_known(n)).collect();
    // Of a joint one column may have its name and another a misspelt one.
    let goes_with = |o: &JointLog, j: &JointLog| {
        (o.position.time.is_empty() || j.position.time.is_empty()) && (o.command.is_none() || j.command.is_none())
    };
    let may_be = |o: &JointLog, m: &str| log.joints.iter().find(|j| j.name == m).is_none_or(|j| goes_with(o, j));
    let meant = |o: &JointLog| nearest(&o.name, moving.iter().copied().filter(|m| may_be(o, m)));
    let misspelt = log.joints.iter().filter(|j| !is_known(&j.name)).find_map(|j| Some((j.name.as_str(), meant(j)?)));
    if let Some((name, meant)) = misspelt
        && (is_chosen || others.len() == measured.len())
    {
        return wrong(format!("measures a joint '{name}', which {} does not have; did you mean '{meant}'?", model.name));
    }
    if others.len() == measured.len() && log.wrenches.iter().all(|w| model.link(&w.link).is_none()) {
        let hint = did_you_mean(others.first().copied().unwrap_or_default(), moving.iter().copied());
        return wrong(format!("measures {}; {} has none of these joints{hint}", others.join(", "), model.name));
    }
    if !others.is_empty() {
        let hint = misspelt.map(|(name, meant)| format!("; is '{name}' its '{meant}'?")).unwrap_or_default();
        let message = format!("{} does not have these joints; they are not used{hint}", model.name);
        log.notes.push(Note { place: others.join(", "), message });
    }
    for wrench in &log.wrenches {
        if model.link(&wrench.link).is_some() && !moving.iter().any(|joint| log.pushes(model, joint)) {
            let message = "hangs on no joint that moves: the force measured there is not used".to_owned();
            log.notes.push(Note { place: wrench.link.clone(), message });
        }
        if model.link(&wrench.link).is_none() {
            let hint = did_you_mean(&wrench.link, model.links.iter().map(|l| l.name.as_str()));
            let message = format!("is no link of {}, and the force measured there is not used{hint}", model.name);
            log.notes.push(Note { place: wrench.link.clone(), message });
        }
    }
    Ok(())
}

fn is_angle(kind: JointKind) -> bool {
    matches!(kind, JointKind::Revolute | JointKind::Continuous)
}

/// Degrees to radians, millimetres to metres.
fn convert(log: &mut Log, model: &ObjectModel, options: Options) {
    for joint in &mut log.joints {
        let Some(kind) = model.joint(&joint.name).map(|j| model.joints[j].kind) else { continue };
        let (to_si, from, into): (fn(f64) -> f64, _, _) = match kind {
            JointKind::Prismatic if options.lengths == Lengths::Millimetres => (|v| v / 1000.0, "millimetres", "m"),
            kind if is_angle(kind) && options.angles == Angles::Degrees => (f64::to_radians, "degrees", "rad"),
            _ => continue,
        };
        let commanded = joint.command.as_mut().filter(|c| c.0 == CommandKind::Position).map(|c| &mut c.1);
        for series in [Some(&mut joint.position), joint.velocity.as_mut(), commanded].into_iter().flatten() {
            series.value.iter_mut().for_each(|v| *v = to_si(*v));
        }
        let message = format!("positions and velocities were given in {from}, and converted to {into}");
        log.notes.push(Note { place: joint.name.clone(), message });
    }
}

/// Least and greatest value.
fn extent(series: &Series) -> Option<[f64; 2]> {
    series.value.iter().fold(None, |e: Option<[f64; 2]>, v| Some(e.map_or([*v; 2], |[a, b]| [a.min(*v), b.max(*v)])))
}

/// Positions beyond the limits that would lie within them if they were degrees or millimetres are asked about.
fn units(path: &Path, log: &mut Log, model: &ObjectModel, options: Options) -> Result<(), RecordingError> {
    for joint in &log.joints {
        let (Some(known), Some([least, most])) = (model.joint(&joint.name), extent(&joint.position)) else { continue };
        let known = &model.joints[known];
        let limits = known.limits;
        let is_asked = if known.kind == JointKind::Prismatic { options.lengths == Lengths::Ask } else { options.angles == Angles::Ask };
        if !is_asked {
            continue;
        }
        let far = least.abs().max(most.abs());
        let [lower, upper] = match known.kind {
            JointKind::Revolute | JointKind::Prismatic if limits.range().is_finite() => [limits.lower, limits.upper],
            JointKind::Continuous if far > TURNS => {
                let way: f64 = joint.position.value.windows(2).map(|w| (w[1] - w[0]).abs()).sum();
                let is_swing = way > 2.0 * (most - least) && far < 400.0;
                let what = format!("turns from {least:.4} to {most:.4} rad");
                if is_swing && most - least > SWINGS {
                    return Err(RecordingError::Units {
                        path: path.to_owned(),
                        joint: joint.name.clone(),
                        message: format!("{what}, to and fro: these look like degrees. Say what they are: {HOW}"),
                    });
                }
                // A wheel may turn so far.
                let message = format!("{what}; if these are degrees, say so: {HOW}");
                log.notes.push(Note { place: joint.name.clone(), message });
                continue;
            }
            JointKind::Prismatic if far > MANY => {
                return Err(RecordingError::Units {
                    path: path.to_owned(),
                    joint: joint.name.clone(),
                    message: format!("slides from {least:.4} to {most:.4} m: these look like millimetres. Say what they are: {HOW_LONG}"),
                });
            }
            _ => continue,
        };
        let slack = BEYOND * limits.range();
        let within = |scale: f64, slack: f64| lower - slack <= least * scale && most * scale <= upper + slack;
        if known.kind == JointKind::Revolute && !within(1.0, slack.max(SLACK)) && within(PI / 180.0, slack.max(SLACK)) {
            return Err(RecordingError::Units {
                path: path.to_owned(),
                joint: joint.name.clone(),
                message: format!(
                    "positions go from {least:.4} to {most:.4}, but the model's limits are {lower:.4} to {upper:.4} rad: these look like \
                     degrees. Say what they are: {HOW}"
                ),
            });
        }
        let reach = limits.range().max(lower.abs()).max(upper.abs());
        if known.kind == JointKind::Prismatic && far > MANY * reach && within(1e-3, slack) {
            return Err(RecordingError::Units {
                path: path.to_owned(),
                joint: joint.name.clone(),
                message: format!(
                    "positions go from {least:.4} to {most:.4}, but the model's limits are {lower:.4} to {upper:.4} m: these look like \
                     millimetres. Say what they are: {HOW_LONG}"
                ),
            });
        }
        if !within(1.0, 0.05 * limits.range()) {
            let message = format!("positions go from {least:.4} to {most:.4}, beyond the model's limits of {lower:.4} to {upper:.4}");
            log.notes.push(Note { place: joint.name.clone(), message });
        }
    }
    Ok(())
}

const HOW: &str =
    "'--angles deg' (they are converted) or '--angles rad' (they are right as they are), or in a CSV file a line '# angles: deg'";

const HOW_LONG: &str =
    "'--lengths mm' (they are converted) or '--lengths m' (they are right as they are), or in a CSV file a line '# lengths: mm'";

/// Says what never changes. A velocity that stays the same while the position moves is none.
fn constants(joint: &mut JointLog, notes: &mut Vec<Note>) {
    let constant = |series: &Series| match extent(series) {
        Some([least, most]) if least == most && series.value.len() > 2 => Some(least),
        _ => None,
    };
    let moved = extent(&joint.position).map_or(0.0, |[least, most]| most - least);
    let duration = match joint.position.time.as_slice() {
        [first, .., last] => last - first,
        _ => 0.0,
    };
    if let Some(value) = joint.velocity.as_ref().and_then(constant)
        && (moved - value.abs() * duration).abs() > 0.1 * moved.max(SMALL_MOTION)
    {
        let message = format!("is {value} throughout while the position moves: nothing measures it; it was left out");
        notes.push(Note { place: format!("{}.velocity", joint.name), message });
        joint.velocity = None;
    }
    let commanded = joint.command.as_ref().map(|(kind, series)| (crate::raw::Channel::Command(*kind).name(), series));
    let effort = joint.effort.as_ref().map(|series| ("effort", series));
    for (channel, series) in [effort, commanded].into_iter().flatten() {
        if let Some(value) = constant(series) {
            notes.push(Note { place: format!("{}.{channel}", joint.name), message: format!("is {value} throughout") });
        }
    }
}

/// Says what can be found without an input, and whether the input acts while the motion is measured.
fn inputs(joint: &JointLog, is_pushed: bool, notes: &mut Vec<Note>) {
    if joint.position.time.is_empty() {
        let message = "has no measured position; it cannot be compared with the model".to_owned();
        notes.push(Note { place: joint.name.clone(), message });
        return;
    }
    let range = |s: &Series| Some((*s.time.first()?, *s.time.last()?));
    let place = joint.name.clone();
    match (&joint.command, &joint.effort) {
        (None, None) if is_pushed => {
            let message = "has neither a command nor an effort of its own: the force measured at a link behind it drives the model, and effects \
                           of its drive cannot be seen";
            notes.push(Note { place, message: message.to_owned() });
        }
        (None, None) => {
            let message = "has neither a command nor an effort: it is taken as moving freely. What resists or drives it by itself (friction, damping, \
                           springs, gravity, backlash) can still be found; effects of its drive cannot, nor the size of a push from outside";
            notes.push(Note { place, message: message.to_owned() });
        }
        (None, Some(_)) => {
            let message = "has an effort but no command: the effort drives the model, and effects of its drive cannot be seen";
            notes.push(Note { place, message: message.to_owned() });
        }
        (Some((_, command)), _) => {
            if let (Some((from, to)), Some((begin, end))) = (range(&joint.position), range(command))
                && (begin > to || end < from && command.time.len() > 1)
            {
                let message =
                    format!("is commanded from {begin:.3} to {end:.3} s, but measured from {from:.3} to {to:.3} s: the two clocks differ");
                notes.push(Note { place, message });
            }
        }
    }
}

/// Says which joints never move. Errors: none of them does, in any of the recordings.
pub(crate) fn moves(logs: &mut [Log], model: Option<&ObjectModel>) -> Result<(), RecordingError> {
    let mut is_any_moving = false;
    let mut still: Vec<String> = Vec::new();
    for log in logs.iter_mut() {
        for joint in &log.joints {
            if joint.position.time.is_empty() || model.is_some_and(|m| m.joint(&joint.name).is_none()) {
                continue;
            }
            if is_moving(&joint.position) {
                is_any_moving = true;
                continue;
            }
            let message = "never moves here: nothing can be found on it but what holds it".to_owned();
            log.notes.push(Note { place: joint.name.clone(), message });
            if !still.contains(&joint.name) {
                still.push(joint.name.clone());
            }
        }
    }
    if is_any_moving || still.is_empty() {
        return Ok(());
    }
    let place = logs.iter().map(|l| l.source.as_str()).collect::<Vec<_>>().join(", ");
    let message = format!(
        "{} never moves, so nothing can be found. Record it moving to and fro over its whole range, slowly and fast, for some 20 s; \
         'sagci gap --experiment' lets the robot do it",
        still.join(", ")
    );
    Err(RecordingError::Still { place, message })
}

/// Does a position change by more than its noise? The noise is that of second differences; means over twentieths of the recording have
/// little of it left.
pub(crate) fn is_moving(series: &Series) -> bool {
    let Some([least, most]) = extent(series) else { return false };
    let range = most - least;
    if !(NO_MOTION..=SMALL_MOTION).contains(&range) {
        return range > SMALL_MOTION;
    }
    let second: Vec<f64> = series.value.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect();
    let noise = (second.iter().map(|d| d * d).sum::<f64>() / (6.0 * second.len().max(1) as f64)).sqrt();
    let count = series.value.len().div_ceil(20);
    let mean = |block: &[f64]| block.iter().sum::<f64>() / block.len() as f64;
    let means = Series { time: Vec::new(), value: series.value.chunks(count).map(mean).collect() };
    extent(&means).is_some_and(|[least, most]| most - least > 8.0 * noise / (count as f64).sqrt())
}
