//! Predictions over windows, as a table that anyone can check the gap's figures by.

use std::collections::BTreeMap;
use std::fmt::Write;

use sagci_model::ObjectModel;
use sagci_recording::Log;

use crate::GapError;
use crate::gaps::follower_and_plant;
use crate::locked::Locked;
use crate::plant::Plant;
use crate::search::{FLOOR, Search};
use crate::trajectory::Trajectory;
use crate::windows::{self, Smoothed};
use crate::{noise, unheeded};

/// Positions as they are predicted.
#[derive(Debug, Clone, PartialEq)]
pub struct Predicted {
    /// The table, see [`predict`].
    pub table: String,
    /// What was set right, doubted or left out.
    pub notes: Vec<String>,
}

/// CSV with the columns `time,window` and for each joint `JOINT.position,JOINT.velocity,JOINT.measured_position`; a row for each
/// sample that a window predicts, at the recording's own time. A joint that stands in all of the data, or is not measured, has none. Windows
/// are those of the gap: each starts half a window after the one before.
///
/// # Errors
/// As [`crate::find`].
pub fn predict(model: &ObjectModel, logs: &[Log], window: f64) -> Result<Predicted, GapError> {
    unheeded::check(model)?;
    let mut notes = unheeded::notes(logs.iter(), model);
    let locked = Locked::new(model, &logs.iter().collect::<Vec<_>>())?;
    notes.extend(locked.notes.iter().cloned());
    let model = &locked.model;
    let trajectories: Vec<Trajectory> = logs.iter().map(|l| Trajectory::new(l, model)).collect::<Result<_, _>>()?;
    windows::check(&trajectories, window)?;
    windows::say_without(&trajectories, window, &mut notes);
    let search = Search::beside(model, &trajectories, &[], &mut notes)?;
    let noise = noise::of_motion(&trajectories, search.names.len(), FLOOR);
    let [follower, plant] = follower_and_plant(|step| Plant::new(model, &search.problem.limits, step), &trajectories, &noise)?;
    let smoothed = Smoothed::new(&follower, &trajectories, &noise)?;
    let mut text = String::from("time,window");
    for name in &search.names {
        // Writing to a text cannot fail.
        let _ = write!(text, ",{name}.position,{name}.velocity,{name}.measured_position");
    }
    text.push('\n');
    for (number, window) in smoothed.predict(&plant, &trajectories, window).iter().enumerate() {
        let trajectory = &trajectories[window.trajectory];
        let n = trajectory.joints;
        let rows = window.position.chunks_exact(n).zip(window.velocity.chunks_exact(n));
        for (row, (position, velocity)) in (window.first..).zip(rows) {
            let _ = write!(text, "{},{number}", clock(trajectory.time[row], logs[window.trajectory].epoch));
            for j in 0..n {
                let measured = trajectory.position[row * n + j];
                let measured = if measured.is_finite() { measured.to_string() } else { String::new() };
                let _ = write!(text, ",{},{},{measured}", position[j], velocity[j]);
            }
            text.push('\n');
        }
    }
    Ok(Predicted { table: text, notes })
}

/// A time as it stands in the recording: whole seconds were taken off those that count from long ago.
fn clock(time: f64, epoch: i64) -> String {
    if epoch == 0 {
        return time.to_string();
    }
    let nanoseconds = (time * 1e9).round() as i128 + i128::from(epoch) * 1_000_000_000;
    let (whole, part) = (nanoseconds.div_euclid(1_000_000_000), nanoseconds.rem_euclid(1_000_000_000));
    let part = format!("{part:09}");
    match part.trim_end_matches('0') {
        "" => whole.to_string(),
        part => format!("{whole}.{part}"),
    }
}

/// The gap of a model as it is: RMSE of the predicted positions by joint, rad or m, over windows of `window` s. Nothing is fitted.
///
/// # Errors
/// As [`crate::find`].
pub fn prediction_error(model: &ObjectModel, logs: &[Log], window: f64) -> Result<BTreeMap<String, f64>, GapError> {
    let locked = Locked::unmeasured(model, &logs.iter().collect::<Vec<_>>())?;
    let model = &locked.model;
    let trajectories: Vec<Trajectory> = logs.iter().map(|l| Trajectory::new(l, model)).collect::<Result<_, _>>()?;
    if !trajectories.iter().any(|t| windows::has_any(t, window)) {
        windows::check(&trajectories, window)?;
    }
    let search = Search::new(model, &trajectories)?;
    let noise = noise::of_motion(&trajectories, search.names.len(), FLOOR);
    let [follower, plant] = follower_and_plant(|step| Plant::new(model, &search.problem.limits, step), &trajectories, &noise)?;
    let ranges: Vec<f64> = search.joints.iter().map(|j| model.joints[*j].limits.range()).collect();
    let (figures, _) = Smoothed::new(&follower, &trajectories, &noise)?.figures(&plant, &trajectories, window, &ranges);
    Ok(search.names.iter().cloned().zip(figures.rmse).collect())
}
