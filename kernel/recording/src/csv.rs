//! Series as text: a header that names the columns, then a row for each instant. `FORMATS.md` says what may stand there.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::Path;

use sagci_model::{did_you_mean, nearest};

use crate::raw::{Channel, Clock, IMPOSSIBLE, Raw, Track};
use crate::{CommandKind, JointLog, Log, Note, RecordingError};

const TIME: &str = "time";

/// Reads the text of a file.
pub(crate) fn read(path: &Path, bytes: &[u8]) -> Result<Raw, RecordingError> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let line = 1 + bytes[..e.valid_up_to()].iter().filter(|b| **b == b'\n').count();
        error(path, line, "is not UTF-8 text; save it as UTF-8".into())
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut raw = Raw { clocks: vec![Clock::default()], is_chosen: true, ..Default::default() };
    // Old programs end lines by a carriage return alone.
    let text = if text.contains('\n') { Cow::Borrowed(text) } else { Cow::Owned(text.replace('\r', "\n")) };
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l)).peekable();
    let header = loop {
        match lines.next() {
            None => return Err(kind(path, "holds no header; a CSV begins with 'time,JOINT.position,...'".into())),
            Some((line, text)) if text.trim_start().starts_with('#') => remark(path, line, text, &mut raw)?,
            Some((_, text)) if text.trim().is_empty() => {}
            Some(header) => break header,
        }
    };
    let delimiter = [',', ';', '\t'].into_iter().max_by_key(|d| (header.1.matches(*d).count(), *d == ',')).unwrap_or(',');
    let columns = columns(path, header, delimiter, &mut raw)?;
    let mut tracks: Vec<Track> = vec![Track::default(); columns.len()];
    let (mut without_time, mut undefined) = ((0usize, 0usize), 0usize);
    while let Some((line, text)) = lines.next() {
        if text.trim().is_empty() {
            continue;
        }
        if text.trim_start().starts_with('#') {
            remark(path, line, text, &mut raw)?;
            continue;
        }
        let cells = split(text, delimiter).ok_or_else(|| error(path, line, "a quoted cell has no closing quote".into()))?;
        if cells.len() != columns.len() {
            let message = format!("has {} cells, but the header names {} columns", cells.len(), columns.len());
            // A logger that was stopped leaves half a line at the end.
            if lines.peek().is_none() && !text.ends_with('\n') && cells.len() < columns.len() {
                raw.notes
                    .push(Note { place: format!("line {line}"), message: format!("{message}; the file ends in it, and it was left out") });
                break;
            }
            return Err(error(path, line, message + "; an empty cell is a sample that is missing, a cell too few or too many is not"));
        }
        let tick = raw.clocks[0].time.len() as u32;
        let mut has_time = false;
        let mut row = vec![f64::NAN; columns.len()];
        for (i, (column, cell)) in columns.iter().zip(&cells).enumerate() {
            let wrong = |what: &str| {
                let name = column.name();
                error(path, line, format!("column {} ({name}) holds '{}', which is no {what}", i + 1, cell.trim()))
            };
            match column {
                Column::Ignored(_) => {}
                Column::Time => match number(cell, delimiter) {
                    Some(t) if t.is_finite() => {
                        let time = nanoseconds(cell, t).ok_or_else(|| wrong("time in s that can be: times are in seconds"))?;
                        raw.clocks[0].time.push(time);
                        has_time = true;
                    }
                    Some(_) => {}
                    None => return Err(wrong("time in s")),
                },
                Column::Sample { .. } => {
                    let value = number(cell, delimiter).ok_or_else(|| wrong("number"))?;
                    if value.is_finite() && value.abs() >= IMPOSSIBLE {
                        let message = "number that a joint can have; where nothing was measured, leave the cell empty";
                        return Err(wrong(message));
                    }
                    undefined += usize::from(value.is_nan() && !cell.trim().is_empty());
                    row[i] = value;
                }
            }
        }
        if !has_time {
            without_time = (without_time.0 + 1, if without_time.0 == 0 { line } else { without_time.1 });
            continue;
        }
        raw.clocks[0].line.push(line as u32);
        for (track, value) in tracks.iter_mut().zip(row) {
            track.tick.push(tick);
            track.value.push(value);
        }
    }
    if raw.clocks[0].time.is_empty() {
        return Err(kind(path, "has a header, but no row with a time".into()));
    }
    if without_time.0 > 0 {
        let message = format!("{} rows have no time; they were left out", without_time.0);
        raw.notes.push(Note { place: format!("line {}", without_time.1), message });
    }
    if undefined > 0 {
        raw.notes
            .push(Note { place: "samples".into(), message: format!("{undefined} cells are not a number (NaN); they count as missing") });
    }
    for (column, track) in columns.into_iter().zip(tracks) {
        if let Column::Sample { joint, channel, .. } = column {
            raw.tracks.insert((joint, channel), vec![track]);
        }
    }
    Ok(raw)
}

fn error(path: &Path, line: usize, message: String) -> RecordingError {
    RecordingError::Line { path: path.to_owned(), line, message }
}

fn kind(path: &Path, message: String) -> RecordingError {
    RecordingError::Kind { path: path.to_owned(), message }
}

/// What a column holds.
enum Column {
    Time,
    Sample { name: String, joint: usize, channel: Channel },
    Ignored(String),
}

impl Column {
    fn name(&self) -> &str {
        match self {
            Self::Time => TIME,
            Self::Sample { name, .. } | Self::Ignored(name) => name,
        }
    }
}

fn columns(path: &Path, (line, header): (usize, &str), delimiter: char, raw: &mut Raw) -> Result<Vec<Column>, RecordingError> {
    let cells = split(header, delimiter).ok_or_else(|| error(path, line, "a quoted name has no closing quote".into()))?;
    let names: Vec<&str> = cells.iter().map(|c| c.trim()).collect();
    let channels = || Channel::ALL.iter().map(|c| c.name());
    if !names.iter().any(|n| n.eq_ignore_ascii_case(TIME)) {
        let meant =
            nearest(TIME, names.iter().copied().chain(["t", "timestamp", "stamp", "seconds"].into_iter().filter(|n| names.contains(n))));
        let hint = match meant.or_else(|| names.iter().copied().find(|n| ["t", "timestamp", "stamp", "seconds"].contains(n))) {
            Some(name) => format!("; is it '{name}'? Then name it 'time'"),
            None => String::new(),
        };
        let shown = names.iter().take(6).copied().collect::<Vec<_>>().join(", ");
        let message = format!(
            "the header has no column 'time' (s){hint}; it reads: {shown}. A CSV begins with 'time,JOINT.position[,JOINT.velocity][,JOINT.effort]...'"
        );
        return Err(error(path, line, message));
    }
    let mut columns: Vec<Column> = Vec::with_capacity(names.len());
    let mut commands: Vec<(usize, &str)> = Vec::new();
    for (i, name) in names.iter().enumerate() {
        if names[..i].contains(name) && !name.is_empty() {
            return Err(error(path, line, format!("the header names '{name}' twice")));
        }
        if name.eq_ignore_ascii_case(TIME) {
            columns.push(Column::Time);
            continue;
        }
        let Some((joint, channel)) = name.rsplit_once('.') else {
            if let Some(channel) = nearest(name, channels()) {
                return Err(error(path, line, format!("column '{name}' names no joint; write 'JOINT.{channel}'")));
            }
            if !name.is_empty() {
                raw.notes.push(Note { place: format!("column '{name}'"), message: "is no 'JOINT.CHANNEL'; it was left out".into() });
            }
            columns.push(Column::Ignored((*name).to_owned()));
            continue;
        };
        let Some(channel) = Channel::ALL.into_iter().find(|c| c.name() == channel) else {
            let message = format!("column '{name}' has the channel '{channel}', which is not known{}", did_you_mean(channel, channels()));
            return Err(error(path, line, message));
        };
        if joint.is_empty() {
            return Err(error(path, line, format!("column '{name}' names no joint; write 'JOINT.{}'", channel.name())));
        }
        let joint = raw.joint(joint);
        if matches!(channel, Channel::Command(_)) {
            if let Some((_, other)) = commands.iter().find(|(j, _)| *j == joint) {
                return Err(error(
                    path,
                    line,
                    format!("both '{other}' and '{name}' command one joint; keep the one that its drive follows"),
                ));
            }
            commands.push((joint, name));
        }
        columns.push(Column::Sample { name: (*name).to_owned(), joint, channel });
    }
    if raw.joints.is_empty() {
        return Err(error(path, line, "the header names no joint; a CSV begins with 'time,JOINT.position,...'".into()));
    }
    Ok(columns)
}

/// A comment. `# angles: deg` or `# angles: rad` says what the positions of turning joints are in, `# lengths: mm` or `# lengths: m` those of
/// sliding ones.
fn remark(path: &Path, line: usize, text: &str, raw: &mut Raw) -> Result<(), RecordingError> {
    let text = text.trim_start().trim_start_matches('#').trim_start();
    if let Some(unit) = text.strip_prefix("lengths:") {
        raw.millimetres = Some(match unit.trim() {
            "mm" => true,
            "m" => false,
            other => return Err(error(path, line, format!("lengths are in 'm' or 'mm', not in '{other}'"))),
        });
    }
    if let Some(unit) = text.strip_prefix("angles:") {
        raw.degrees = Some(match unit.trim() {
            "deg" => true,
            "rad" => false,
            other => return Err(error(path, line, format!("angles are in 'rad' or 'deg', not in '{other}'"))),
        });
    }
    Ok(())
}

/// The cells of a line; nothing if a quote is not closed.
fn split(line: &str, delimiter: char) -> Option<Vec<Cow<'_, str>>> {
    if !line.contains('"') {
        return Some(line.split(delimiter).map(Cow::from).collect());
    }
    let (mut cells, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => {
                letters.next();
                cell.push('"');
            }
            '"' => is_quoted = !is_quoted,
            l if l == delimiter && !is_quoted => cells.push(Cow::from(std::mem::take(&mut cell))),
            l => cell.push(l),
        }
    }
    cells.push(Cow::from(cell));
    (!is_quoted).then_some(cells)
}

/// The number in a cell: not a number where it is empty or says so, nothing where it is something else.
fn number(cell: &str, delimiter: char) -> Option<f64> {
    let cell = cell.trim();
    if cell.is_empty() || ["na", "n/a", "null", "none", "nan", "-nan"].iter().any(|n| cell.eq_ignore_ascii_case(n)) {
        return Some(f64::NAN);
    }
    match cell.parse() {
        Ok(value) => Some(value),
        // Where a comma does not part cells it may part decimals.
        Err(_) if delimiter != ',' && cell.matches(',').count() == 1 => cell.replace(',', ".").parse().ok(),
        Err(_) => None,
    }
}

/// A time in ns, exact to the ns where it is written without an exponent: seconds since 1970 have more digits than an `f64`.
fn nanoseconds(cell: &str, value: f64) -> Option<i64> {
    // i64 ends after 292 years.
    if value.abs() >= 9.2e9 {
        return None;
    }
    let cell = cell.trim();
    let (sign, digits) = match cell.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, cell.strip_prefix('+').unwrap_or(cell)),
    };
    let (whole, part) = digits.split_once(['.', ',']).unwrap_or((digits, ""));
    if [whole, part].iter().all(|d| d.bytes().all(|b| b.is_ascii_digit())) && whole.len() <= 10 {
        let whole: i64 = if whole.is_empty() { 0 } else { whole.parse().ok()? };
        let part: f64 = if part.is_empty() { 0.0 } else { format!("0.{part}").parse().ok()? };
        return Some(sign * (whole * 1_000_000_000 + (part * 1e9).round() as i64));
    }
    Some((value * 1e9).round() as i64)
}

impl Log {
    /// The joints' series as CSV, a row for each instant at which something was measured or commanded, or a command ended. Reading it gives
    /// the same series again. Where voltages and other samples have times of their own, a voltage that goes on to act is repeated.
    /// Forces at links have no columns and are left out.
    pub fn to_csv(&self) -> String {
        let mut times: Vec<i64> = Vec::new();
        let mut columns: Vec<(String, &crate::Series, Option<&JointLog>)> = Vec::new();
        for joint in &self.joints {
            let mut column = |channel: Channel, series, held| columns.push((format!("{}.{}", joint.name, channel.name()), series, held));
            if !joint.position.time.is_empty() {
                column(Channel::Position, &joint.position, None);
            }
            if let Some(series) = &joint.velocity {
                column(Channel::Velocity, series, None);
            }
            if let Some(series) = &joint.effort {
                column(Channel::Effort, series, None);
            }
            if let Some((kind, series)) = &joint.command {
                column(Channel::Command(*kind), series, (*kind == CommandKind::Voltage).then_some(joint));
                times.extend(joint.command_gaps.iter().flatten().filter(|t| t.is_finite()).map(|t| ticks(*t)));
            }
        }
        times.extend(columns.iter().flat_map(|c| &c.1.time).map(|t| ticks(*t)));
        times.sort_unstable();
        times.dedup();
        let mut text = String::from(TIME);
        for (name, ..) in &columns {
            text.push(',');
            match name.contains([',', '"', ';', '\t']) {
                true => text.extend(["\"", &name.replace('"', "\"\""), "\""]),
                false => text.push_str(name),
            }
        }
        text.push('\n');
        let mut next = vec![0; columns.len()];
        for time in times {
            let absolute = i128::from(time) + i128::from(self.epoch) * 1_000_000_000;
            let (sign, size) = (if absolute < 0 { "-" } else { "" }, absolute.unsigned_abs());
            let decimals = format!("{:09}", size % 1_000_000_000);
            let decimals = decimals.trim_end_matches('0');
            // Writing to a text cannot fail.
            let _ = write!(text, "{sign}{}{}{decimals}", size / 1_000_000_000, if decimals.is_empty() { "" } else { "." });
            for ((_, series, held), next) in columns.iter().zip(&mut next) {
                text.push(',');
                let value = match series.time.get(*next) {
                    Some(t) if ticks(*t) == time => {
                        *next += 1;
                        Some(series.value[*next - 1])
                    }
                    _ => held.and_then(|joint| joint.command_at(time as f64 / 1e9)),
                };
                if let Some(value) = value {
                    let _ = match value.abs() {
                        0.0 | 1e-5..1e15 => write!(text, "{value}"),
                        _ => write!(text, "{value:e}"),
                    };
                }
            }
            text.push('\n');
        }
        text
    }
}

fn ticks(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}
