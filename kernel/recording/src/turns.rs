//! Positions of joints that turn on and on, where an encoder starts anew after each turn: the turns are counted on.
//!
//! Between two samples such a position leaps by a whole turn less what the joint moved. A position that never leaves one turn and leaps so did
//! not go there and back: no joint turns by three quarters within a sample and stays within a turn for long.

use std::f64::consts::{PI, TAU};

use sagci_model::{JointKind, ObjectModel};

use crate::{CommandKind, Log, Note, Series};

/// Positions that start anew lie within so much more than one turn, rad: noise, and ends that are read as one or the other.
const BESIDE: f64 = 0.1;
/// A leap is a turn to this, rad, at the most.
const NEARLY: f64 = 0.5 * PI;

/// Counts turns on, of the model's joints that may turn round.
pub(crate) fn count(log: &mut Log, model: &ObjectModel) {
    for joint in &mut log.joints {
        let Some(known) = model.joint(&joint.name).map(|j| &model.joints[j]) else { continue };
        let turns_round = match known.kind {
            JointKind::Continuous => true,
            JointKind::Revolute => known.limits.range() > TAU - BESIDE,
            _ => false,
        };
        let leaps = if turns_round { count_on(&mut joint.position) } else { 0 };
        if leaps == 0 {
            continue;
        }
        // What is commanded is where the joint is sent from where it is.
        if let Some((CommandKind::Position, command)) = &mut joint.command {
            let position = &joint.position;
            for (t, u) in command.time.iter().zip(&mut command.value) {
                let behind = position.time.partition_point(|p| p <= t).max(1);
                let read = position.value[..behind].iter().rev().find(|y| y.is_finite());
                *u += read.map_or(0.0, |y| TAU * ((y - *u) / TAU).round());
            }
        }
        let message = format!("its position starts anew after each turn, {leaps} times in this recording; the turns were counted on");
        log.notes.push(Note { place: joint.name.clone(), message });
    }
}

/// Counts turns on in a series, and says how often it started anew.
fn count_on(series: &mut Series) -> usize {
    let finite = || series.value.iter().copied().filter(|y| y.is_finite());
    let (low, high) = finite().fold((f64::MAX, f64::MIN), |(low, high), y| (low.min(y), high.max(y)));
    if high - low > TAU + BESIDE {
        return 0;
    }
    let (mut turns, mut leaps, mut before) = (0.0, 0, None);
    for y in series.value.iter_mut().filter(|y| y.is_finite()) {
        let leap: f64 = before.map_or(0.0, |b| *y - b);
        before = Some(*y);
        if (leap.abs() - TAU).abs() < NEARLY {
            turns -= leap.signum();
            leaps += 1;
        }
        *y += TAU * turns;
    }
    leaps
}
