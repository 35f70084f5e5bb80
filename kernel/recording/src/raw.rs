//! What a file says, before it is set right: samples in the order in which they stand there.
//!
//! A [`Clock`] is a sequence of instants: the rows of a CSV file, the messages of a topic. A [`Track`] is one quantity that was sampled
//! at some of them. Setting right means: instants in order, one value an instant, finite numbers only; and a note for each thing that
//! had to be done.

use std::collections::BTreeMap;
use std::path::Path;

use crate::{CommandKind, JointLog, Log, Note, RecordingError, Series, WrenchLog};

/// So many samples must fall between those from before a jump back of the clock, on both sides, for it to be a second recording.
const INTERLEAVED: usize = 10;

/// No joint has a position, velocity, effort or command of this size, in SI units: squares of it end a computation.
pub(crate) const IMPOSSIBLE: f64 = 1e12;

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Channel {
    Position,
    Velocity,
    Effort,
    Command(CommandKind),
}

impl Channel {
    pub const ALL: [Self; 6] = [
        Self::Position,
        Self::Velocity,
        Self::Effort,
        Self::Command(CommandKind::Effort),
        Self::Command(CommandKind::Position),
        Self::Command(CommandKind::Voltage),
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Effort => "effort",
            Self::Command(CommandKind::Effort) => "command_effort",
            Self::Command(CommandKind::Position) => "command_position",
            Self::Command(CommandKind::Voltage) => "command_voltage",
        }
    }
}

/// Instants of samples in the order of the file, ns.
#[derive(Debug, Clone, Default)]
pub(crate) struct Clock {
    /// What ticks, for messages: a topic; empty for the rows of a file.
    pub place: String,
    pub time: Vec<i64>,
    /// Line of each instant, or number of the message.
    pub line: Vec<u32>,
}

impl Clock {
    fn at(&self, tick: usize) -> String {
        let line = self.line.get(tick).copied().unwrap_or(0);
        if self.place.is_empty() { format!("line {line}") } else { format!("{}, message {line}", self.place) }
    }

    /// The ticks in the order of time (equal times in the order of the file), and what to say about it.
    ///
    /// A clock that was set back within a recording gives samples of two stretches of time at the same times: they cannot be set in
    /// order. Rows that only stand in another order can.
    fn order(&self, path: &Path, notes: &mut Vec<Note>) -> Result<Vec<usize>, RecordingError> {
        // A topic may repeat one message; the rows of a table are all there is.
        if let ([first, _, ..], "") = (self.time.as_slice(), self.place.as_str())
            && self.time.iter().all(|t| t == first)
        {
            let message = format!("all {} rows repeat one time; the column 'time' holds when each was measured, in s", self.time.len());
            return Err(RecordingError::Clock { path: path.to_owned(), place: self.at(1), message });
        }
        let mut order: Vec<usize> = (0..self.time.len()).collect();
        let back: Vec<usize> = (1..self.time.len()).filter(|&i| self.time[i] < self.time[i - 1]).collect();
        let Some(&first) = back.first() else { return Ok(order) };
        let set_back = (0..back.len()).find(|&place| self.is_set_back(place, &back));
        if let Some(tick) = set_back.map(|place| back[place]) {
            let by = self.time[tick - 1].saturating_sub(self.time[tick]) as f64 * 1e-9;
            return Err(RecordingError::Clock {
                path: path.to_owned(),
                place: self.at(tick),
                message: format!(
                    "the clock jumps back by {by:.3} s, and the samples after it fall between those before: two recordings in one file; \
                     write each into a file of its own"
                ),
            });
        }
        order.sort_by_key(|&i| self.time[i]);
        let message = format!("{} of {} times are before the one above them; the samples were put in order", back.len(), self.time.len());
        notes.push(Note { place: self.at(first), message });
        Ok(order)
    }

    /// Do many samples of the runs before and after a step back interleave?
    fn is_set_back(&self, place: usize, back: &[usize]) -> bool {
        let begin = place.checked_sub(1).map_or(0, |before| back[before]);
        let (tick, end) = (back[place], back.get(place + 1).copied().unwrap_or(self.time.len()));
        let (before, after) = (&self.time[begin..tick], &self.time[tick..end]);
        let (Some(from), Some(to)) = (before.first().max(after.first()), before.last().min(after.last())) else { return false };
        let within = |run: &[i64]| run.iter().filter(|t| *from <= **t && **t <= *to).count();
        within(before) > INTERLEAVED && within(after) > INTERLEAVED
    }
}

/// One quantity: values at some ticks of a clock. A value that is not a number is a sample that is missing.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track {
    pub clock: usize,
    pub tick: Vec<u32>,
    pub value: Vec<f64>,
}

/// A file as it was read.
#[derive(Debug, Clone, Default)]
pub(crate) struct Raw {
    pub clocks: Vec<Clock>,
    /// Joints in the order in which they were first named.
    pub joints: Vec<String>,
    /// Tracks by place among the joints and by channel; several where several topics tell the same.
    pub tracks: BTreeMap<(usize, Channel), Vec<Track>>,
    /// Wrenches: link, clock, ticks, torque and force.
    pub wrenches: Vec<(String, usize, Vec<u32>, Vec<[f64; 6]>)>,
    pub notes: Vec<Note>,
    /// Positions and velocities of turning joints are said to be in degrees, or said to be in radians.
    pub degrees: Option<bool>,
    /// The same of sliding joints: in millimetres, or in metres.
    pub millimetres: Option<bool>,
    /// Somebody chose what the file holds, as the columns of a table; a robot records whatever joints there are.
    pub is_chosen: bool,
}

impl Raw {
    /// Place of a joint among those that were named.
    pub fn joint(&mut self, name: &str) -> usize {
        match self.joints.iter().position(|j| j == name) {
            Some(place) => place,
            None => {
                self.joints.push(name.to_owned());
                self.joints.len() - 1
            }
        }
    }

    /// The least time, ns.
    pub fn first(&self) -> Option<i64> {
        self.clocks.iter().flat_map(|c| &c.time).copied().min()
    }

    /// The series, in order, `epoch` seconds taken off their times.
    pub fn settle(mut self, path: &Path, epoch: i64) -> Result<Log, RecordingError> {
        let mut notes = std::mem::take(&mut self.notes);
        let mut orders = Vec::with_capacity(self.clocks.len());
        for clock in &self.clocks {
            let order = clock.order(path, &mut notes)?;
            // Rank of each tick: sorting a track's samples by it puts them in order.
            let mut rank = vec![0u32; order.len()];
            for (place, &tick) in order.iter().enumerate() {
                rank[tick] = place as u32;
            }
            orders.push(rank);
        }
        let seconds = |ns: i64| ns.saturating_sub(epoch.saturating_mul(1_000_000_000)) as f64 / 1e9;
        let mut repeated = vec![0usize; self.clocks.len()];
        let mut joints: Vec<JointLog> = self.joints.iter().map(|name| JointLog { name: name.clone(), ..Default::default() }).collect();
        for ((joint, channel), mut tracks) in std::mem::take(&mut self.tracks) {
            let place = format!("{}.{}", self.joints[joint], channel.name());
            // Samples of two sensors in one series would be neither's: the one that tells most is taken.
            let most = tracks.iter().enumerate().max_by_key(|(i, t)| (t.value.iter().filter(|v| v.is_finite()).count(), tracks.len() - i));
            let Some(most) = most.map(|(i, _)| i) else { continue };
            if tracks.len() > 1 {
                let others: Vec<&str> =
                    tracks.iter().enumerate().filter(|(i, _)| *i != most).map(|(_, t)| self.clocks[t.clock].place.as_str()).collect();
                let taken = &self.clocks[tracks[most].clock].place;
                notes.push(Note { place: place.clone(), message: format!("taken from {taken}; also on {}, left out", others.join(", ")) });
            }
            let track = tracks.swap_remove(most);
            let clock = &self.clocks[track.clock];
            let infinite = track.value.iter().filter(|v| v.abs() >= IMPOSSIBLE).count();
            if infinite > 0 {
                let message = format!("{infinite} values are infinite or larger than any joint's; they count as missing");
                notes.push(Note { place: place.clone(), message });
            }
            // Of a table that is said of all cells, since an empty one is no number, either. A list of nothing else was not filled in.
            let undefined = track.value.iter().filter(|v| v.is_nan()).count();
            if !clock.place.is_empty() && (1..track.value.len()).contains(&undefined) {
                let message = format!("{undefined} values are not a number (NaN); they count as missing");
                notes.push(Note { place: place.clone(), message });
            }
            let mut samples: Vec<(i64, f64)> = track.tick.iter().zip(&track.value).map(|(t, v)| (clock.time[*t as usize], *v)).collect();
            let rank = &orders[track.clock];
            if !track.tick.is_sorted_by_key(|t| rank[*t as usize]) {
                let mut by_rank: Vec<usize> = (0..samples.len()).collect();
                by_rank.sort_by_key(|&i| rank[track.tick[i] as usize]);
                samples = by_rank.into_iter().map(|i| samples[i]).collect();
            }
            // Nothing commanded is a fact at a voltage, and a sample that is missing elsewhere.
            let is_fact = |v: f64| v.abs() < IMPOSSIBLE || !v.is_finite() && channel == Channel::Command(CommandKind::Voltage);
            let mut kept: Vec<(i64, f64)> = Vec::with_capacity(samples.len());
            for (time, value) in samples.into_iter().filter(|(_, v)| is_fact(*v)) {
                match kept.last_mut() {
                    Some(last) if last.0 == time => {
                        repeated[track.clock] += 1;
                        *last = (time, value);
                    }
                    _ => kept.push((time, value)),
                }
            }
            let log = &mut joints[joint];
            if channel == Channel::Command(CommandKind::Voltage) {
                log.command_gaps = gaps(&kept).into_iter().map(|(from, to)| [seconds(from), to.map_or(f64::INFINITY, seconds)]).collect();
                kept.retain(|(_, v)| v.is_finite());
            }
            let series = Series { time: kept.iter().map(|s| seconds(s.0)).collect(), value: kept.iter().map(|s| s.1).collect() };
            match channel {
                Channel::Position => log.position = series,
                Channel::Velocity if !series.time.is_empty() => log.velocity = Some(series),
                Channel::Effort if !series.time.is_empty() => log.effort = Some(series),
                Channel::Command(kind) if !series.time.is_empty() || !log.command_gaps.is_empty() => log.command = Some((kind, series)),
                _ => notes.push(Note { place, message: "holds no number; it counts as not measured".into() }),
            }
        }
        let wrenches = std::mem::take(&mut self.wrenches).into_iter().map(|(link, clock, ticks, F_L)| {
            let mut samples: Vec<(i64, [f64; 6])> = ticks
                .iter()
                .zip(F_L)
                .map(|(t, F)| (self.clocks[clock].time[*t as usize], F))
                .filter(|(_, F)| F.iter().all(|f| f.is_finite()))
                .collect();
            samples.sort_by_key(|s| s.0);
            let mut log = WrenchLog { link, ..Default::default() };
            for (i, (time, F)) in samples.iter().enumerate() {
                if samples.get(i + 1).is_some_and(|next| next.0 == *time) {
                    repeated[clock] += 1;
                    continue;
                }
                log.time.push(seconds(*time));
                log.F_L.push(*F);
            }
            log
        });
        let wrenches = wrenches.collect();
        for (clock, count) in self.clocks.iter().zip(repeated).filter(|(_, count)| *count > 0) {
            let place = if clock.place.is_empty() { "time".to_owned() } else { clock.place.clone() };
            notes.push(Note {
                place,
                message: format!("{count} samples repeat the time of another of the same quantity; the last one is kept"),
            });
        }
        Ok(Log { source: path.display().to_string(), joints, wrenches, notes, epoch, ..Default::default() })
    }
}

/// Intervals in which the values are missing, from the first such sample to the next one that has a value.
fn gaps(samples: &[(i64, f64)]) -> Vec<(i64, Option<i64>)> {
    let mut gaps: Vec<(i64, Option<i64>)> = Vec::new();
    let mut is_open = false;
    for (time, value) in samples {
        match (value.is_finite(), is_open) {
            (false, false) => gaps.push((*time, None)),
            (true, true) => {
                if let Some(last) = gaps.last_mut() {
                    last.1 = Some(*time);
                }
            }
            _ => {}
        }
        is_open = !value.is_finite();
    }
    gaps
}
