use std::io::Write;
use std::path::Path;

use nalgebra::Isometry3;

use super::reader::PhaseEntry;
use super::{Level, Recording, RecordingError};
use crate::truth::TrueFrame;

/// Seconds between lines of the time line at most.
const LINE_PERIOD: f64 = 1.0;

/// What was shown.
#[derive(Debug, Clone, PartialEq)]
pub struct Replayed {
    /// Number of sensor states read.
    pub observations: usize,
    /// Number of true frames read.
    pub frames: usize,
    /// Length of the run, s.
    pub seconds: f64,
    /// All messages, the true frames among them, equal what was recorded; nothing if the file was not closed.
    pub intact: Option<bool>,
}

/// Shows a run to a person by the states that were recorded, the true ones included: what happened and when, and a time
/// line with the arm, the gripper, the joints that moved and the places of the objects.
///
/// # Errors
/// Those of [`Recording::open`], and of writing to `out`.
pub fn replay_states(path: impl AsRef<Path>, out: &mut dyn Write) -> Result<Replayed, RecordingError> {
    let recording = Recording::open(path)?;
    show(&recording, out).map_err(|source| RecordingError::File { path: recording.path.clone(), source })?;
    let intact = recording.intact.zip(recording.truth_intact).map(|(all, truth)| all && truth);
    Ok(Replayed { observations: recording.observations.len(), frames: recording.truth.len(), seconds: recording.seconds(), intact })
}

fn show(recording: &Recording, out: &mut dyn Write) -> std::io::Result<()> {
    let r = &recording.record;
    writeln!(out, "{}", recording.path.display())?;
    writeln!(out, "{} ran {} with seed {} in the world '{}', {:.1} s", r.program, r.script, r.seed, r.world, recording.seconds())?;
    for (what, list) in [("models", &r.models), ("skills", &r.skills)] {
        if !list.is_empty() {
            let names: Vec<String> = list.iter().map(|v| format!("{} {}", v.name, v.version)).collect();
            writeln!(out, "{what}: {}", names.join(", "))?;
        }
    }

    let first = recording.truth.first();
    let moving = first.map(|f| moved_joints(f, &recording.truth, &r.models)).unwrap_or_default();
    let objects = first.map(roots).unwrap_or_default();
    writeln!(out)?;
    let mut phases = recording.phases.iter().peekable();
    let mut log = recording.log.iter().peekable();
    let mut last_phase: Option<&PhaseEntry> = None;
    let mut truth = recording.truth.iter().peekable();
    let mut state: Option<&TrueFrame> = None;
    let mut next_line = 0.0;
    for (i, o) in recording.observations.iter().enumerate() {
        while let Some(p) = phases.next_if(|p| p.time <= o.time + 1e-9) {
            if last_phase.is_none_or(|l| l.step != p.step || l.phase != p.phase || l.skill != p.skill) {
                writeln!(out, "{:8.3} s  step {} {}: {}", p.time, p.step, p.skill, p.phase)?;
                next_line = o.time;
            }
            last_phase = Some(p);
        }
        while let Some(e) = log.next_if(|e| e.time <= o.time + 1e-9) {
            entry(out, e)?;
        }
        while let Some(f) = truth.next_if(|f| f.time <= o.time + 1e-9) {
            state = Some(f);
        }
        let is_last = i + 1 == recording.observations.len();
        if o.time + 1e-9 < next_line && !is_last {
            continue;
        }
        next_line = o.time + LINE_PERIOD;
        let q: Vec<String> = o.q.iter().map(|q| format!("{:.1}", q.to_degrees())).collect();
        let progress = last_phase.map_or(String::new(), |p| format!(" {:3.0} %", p.progress * 100.0));
        write!(
            out,
            "{:8.3} s {progress}  arm [{}] deg  gripper {:.1} mm {:.0} N",
            o.time,
            q.join(" "),
            o.gripper_width * 1e3,
            o.gripper_force
        )?;
        if let Some(frame) = state {
            for &j in &moving {
                if let Some((name, q, _)) = frame.joints.get(j) {
                    write!(out, "  {name} {q:.3}")?;
                }
            }
            for &k in &objects {
                if let Some((name, X)) = frame.frames.get(k) {
                    write!(out, "  {} {}", name.split('/').next().unwrap_or(name), place(X))?;
                }
            }
        }
        writeln!(out)?;
    }
    for e in log {
        entry(out, e)?;
    }

    writeln!(out)?;
    match &recording.outcome {
        Some(o) => writeln!(out, "{}: {}", if o.success { "done" } else { "failed" }, o.message)?,
        None => writeln!(out, "the run was interrupted: no outcome was recorded")?,
    }
    if let Some(cut) = &recording.cut {
        writeln!(out, "the file ends too early, at byte {}: {}; shown is what comes before", cut.offset, cut.message)?;
    }
    let counts = format!(
        "{} sensor states, {} commands and {} true frames were read",
        recording.observations.len(),
        recording.commands.len(),
        recording.truth.len()
    );
    match recording.intact.zip(recording.truth_intact) {
        Some((true, true)) => writeln!(out, "{counts}; they equal what was recorded (SHA-256)"),
        Some(_) => writeln!(out, "{counts}; they DIFFER from what was recorded (SHA-256): the file was changed afterwards"),
        None => writeln!(out, "{counts}; the file was not closed, so there is nothing to compare them with"),
    }
}

fn entry(out: &mut dyn Write, e: &super::Entry) -> std::io::Result<()> {
    let mark = match e.level {
        Level::Debug | Level::Info => "",
        Level::Warning => "warning: ",
        Level::Error => "error: ",
    };
    writeln!(out, "{:8.3} s  {mark}{}: {}", e.time, e.name, e.text)
}

/// Joints of the objects (not of the robot, which is the first model) that move during the run.
fn moved_joints(first: &TrueFrame, all: &[TrueFrame], models: &[super::Versioned]) -> Vec<usize> {
    let robot = models.first().map(|m| format!("{}/", m.name));
    (0..first.joints.len())
        .filter(|&j| robot.as_ref().is_none_or(|r| !first.joints[j].0.starts_with(r)))
        .filter(|&j| {
            let start = first.joints[j].1;
            all.iter().any(|f| f.joints.get(j).is_some_and(|(_, q, _)| (q - start).abs() > 1e-4))
        })
        .collect()
}

/// The first link of each thing but the robot, which comes first.
fn roots(frame: &TrueFrame) -> Vec<usize> {
    let owner = |k: usize| frame.frames[k].0.split('/').next();
    let firsts: Vec<usize> = (0..frame.frames.len()).filter(|&k| k == 0 || owner(k) != owner(k - 1)).collect();
    firsts.into_iter().skip(1).collect()
}

fn place(X: &Isometry3<f64>) -> String {
    let p = X.translation.vector;
    let (roll, pitch, yaw) = X.rotation.euler_angles();
    let tilt = (X.rotation * nalgebra::Vector3::z()).z.clamp(-1.0, 1.0).acos();
    if tilt < 0.02 {
        format!("({:.3} {:.3} {:.3}) yaw {:.0}", p.x, p.y, p.z, yaw.to_degrees())
    } else {
        format!("({:.3} {:.3} {:.3}) rpy {:.0} {:.0} {:.0}", p.x, p.y, p.z, roll.to_degrees(), pitch.to_degrees(), yaw.to_degrees())
    }
}
