//! Shows how a run goes, on stderr: one line that is rewritten on a terminal, a line now and then elsewhere.

use std::io::{IsTerminal, Write};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use sagci_script::host::progress::{Event, Progress};
use sagci_script::host::report::{RunReport, StepReport, StepStatus};
use sagci_skill::{LogLevel, LogSink};

/// Shortest wall time between two rewrites of the line.
const REWRITE: Duration = Duration::from_millis(80);
/// Width of the bar.
const BAR: usize = 20;

/// Watches runs for a person.
pub struct Watcher {
    /// Several runs share the terminal: a line a run instead of a line a step.
    many: bool,
    terminal: bool,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    drawn: Option<Instant>,
    line_open: bool,
    /// Seed, step and phase that were said last, where lines are not rewritten.
    said: (u64, usize, String),
}

impl Watcher {
    /// For one run, or for several.
    pub fn new(many: bool) -> Self {
        Self { many, terminal: std::io::stderr().is_terminal(), state: Mutex::default() }
    }

    /// Where skills log: what matters to a person is shown.
    pub fn sink(self: &Arc<Self>) -> LogSink {
        let watcher = self.clone();
        Arc::new(move |level, text| {
            if level <= LogLevel::Info && !watcher.many {
                watcher.line(&format!("  {text}"));
            }
        })
    }

    fn line(&self, text: &str) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let mut out = std::io::stderr().lock();
        // A person who closed the terminal misses nothing.
        let _ = if std::mem::take(&mut state.line_open) { write!(out, "\r\x1b[2K{text}\n") } else { writeln!(out, "{text}") };
    }

    fn rewrite(&self, text: &str) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.drawn.is_some_and(|at| at.elapsed() < REWRITE) {
            return;
        }
        state.drawn = Some(Instant::now());
        state.line_open = true;
        let mut out = std::io::stderr().lock();
        let _ = write!(out, "\r\x1b[2K{text}");
        let _ = out.flush();
    }
}

impl Progress for Watcher {
    fn event(&self, seed: u64, event: &Event<'_>) {
        if self.many {
            if let Event::Finished { report } = event {
                self.line(&run_line(report));
            }
            return;
        }
        match event {
            Event::Looking { objects } => self.line(&format!("  looking for {}", objects.join(", "))),
            Event::Located { object, error: Some(why) } => self.line(&format!("  {object} not found: {why}")),
            Event::Located { .. } | Event::Finished { .. } => {}
            Event::Planning { call, .. } => self.line(call),
            Event::Phase { step, call, phase, progress, time } => {
                if self.terminal {
                    let filled = (progress * BAR as f64) as usize;
                    let bar = format!("{}{}", "#".repeat(filled), ".".repeat(BAR - filled.min(BAR)));
                    self.rewrite(&format!("  {call}  [{bar}] {:3.0} %  {phase}  {time:.1} s", progress * 100.0));
                } else {
                    let now = (seed, *step, (*phase).to_owned());
                    let new = {
                        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
                        std::mem::replace(&mut state.said, now.clone()) != now
                    };
                    if new {
                        self.line(&format!("  {phase} ({:.0} %, {time:.1} s)", progress * 100.0));
                    }
                }
            }
            Event::Ended { report, .. } => self.line(&format!("  {}", step_line(report))),
            Event::Searching { text } => self.line(&format!("  {text} ...")),
            Event::Say { text } => self.line(&format!("  > {text}")),
        }
    }
}

fn step_line(report: &StepReport) -> String {
    let ended = match report.status {
        StepStatus::Done => "done",
        StepStatus::Planned => "planned",
        StepStatus::Failed => "FAILED",
    };
    let why = report.message.as_ref().map(|m| format!(": {} ({m})", report.code.as_deref().unwrap_or("")));
    format!("{ended} in {:.1} s{}", report.seconds, why.unwrap_or_default())
}

/// One line about one run.
pub fn run_line(report: &RunReport) -> String {
    let why = report.failure.as_ref().map(|f| format!(": {} at {}: {}", f.code, f.stage, f.message));
    let ended = if report.success { "ok" } else { "FAILED" };
    format!(
        "seed {:<4} {ended:<6} {:6.1} s world, {:5.1} s wall{}",
        report.seed,
        report.seconds,
        report.wall_seconds,
        why.unwrap_or_default()
    )
}
