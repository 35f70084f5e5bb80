//! `sagci run`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use sagci_script::LibraryModels;
use sagci_script::host::report::{Figure, Rate, RunReport, StepStatus};
use sagci_script::host::{BROKEN, Kit, Registration, RunError, RunOptions, WorldSource, run_many};
use sagci_script::language::stage::AskedExperiment;
use sagci_world::recording::{Journal, RecordedWorld, RunRecord};
use sagci_world::{RapierWorld, World, WorldOptions, open};
use serde::Serialize;

use crate::arguments::{Format, Places, Run};
use crate::commands::print;
use crate::error::CliError;
use crate::place;
use crate::table::table;
use crate::watch::Watcher;

/// Makes worlds of a kind that the world crate knows.
struct Worlds {
    kind: String,
}

impl WorldSource for Worlds {
    fn kind(&self) -> &str {
        &self.kind
    }

    fn open(&self, recording: Option<(&Path, &RunRecord)>) -> Result<(Box<dyn World>, Option<Journal>), String> {
        let options = WorldOptions::default();
        match recording {
            None => open(&self.kind, options).map(|world| (world, None)).map_err(|e| e.to_string()),
            Some((path, record)) if self.kind == "rapier" => {
                let world = RecordedWorld::rapier(RapierWorld::new(options), path, record).map_err(|e| e.to_string())?;
                let journal = world.journal();
                Ok((Box::new(world), Some(journal)))
            }
            Some((path, record)) => {
                let world = open(&self.kind, options).map_err(|e| e.to_string())?;
                let world = RecordedWorld::sensors(world, path, record).map_err(|e| e.to_string())?;
                let journal = world.journal();
                Ok((Box::new(world), Some(journal)))
            }
        }
    }
}

/// What is printed of several runs.
#[derive(Serialize)]
struct Batch<'a> {
    success: bool,
    #[serde(flatten)]
    rate: Rate,
    reports: &'a [RunReport],
}

/// Runs a script once on the measured world, asked to do an experiment: the folder that `out` names gets what it records.
pub fn experiment(
    script: &Path,
    asked: AskedExperiment,
    places: &Places,
    seed: u64,
    out: PathBuf,
    cancel: &Arc<AtomicBool>,
) -> Result<RunReport, CliError> {
    let watcher = Arc::new(Watcher::new(false));
    let kit = Kit {
        skills: Arc::new(place::skills(places, Some(script), watcher.sink())?),
        models: Arc::new(LibraryModels::new(place::library(places, Some(script))?)),
        worlds: Some(Arc::new(Worlds { kind: "rapier".to_owned() })),
        perceive: Arc::new(Registration),
        progress: watcher,
        cancel: cancel.clone(),
    };
    sagci_script::host::run(script, &kit, &RunOptions { seed, out: Some(out), asked: Some(asked) }).map_err(failed)
}

fn failed(error: RunError) -> CliError {
    match error {
        RunError::Script(problems) => CliError::Script(problems),
        RunError::Broken(message) => CliError::Other(message),
    }
}

/// Runs a script, once or several times.
pub fn run(arguments: &Run) -> Result<bool, CliError> {
    let script = &arguments.script;
    let models = LibraryModels::new(place::library(&arguments.places, Some(script))?);
    let many = arguments.runs > 1;
    let watcher = Arc::new(Watcher::new(many));
    let skills = place::skills(&arguments.places, Some(script), watcher.sink())?;
    let cancel = cancel_on_interrupt()?;
    let out = if arguments.plan_only { None } else { Some(arguments.out.clone().unwrap_or_else(|| new_folder(script))) };
    let kit = Kit {
        skills: Arc::new(skills),
        models: Arc::new(models),
        worlds: (!arguments.plan_only).then(|| Arc::new(Worlds { kind: arguments.world.clone() }) as Arc<dyn WorldSource>),
        perceive: Arc::new(Registration),
        progress: watcher,
        cancel,
    };
    let options = RunOptions { seed: arguments.seed, out: out.clone(), asked: None };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut reports = Vec::new();
    for report in run_many(script, &kit, &options, arguments.runs as usize, threads) {
        reports.push(report.map_err(failed)?);
    }
    let successes = reports.iter().filter(|r| r.success).count();
    let success = successes == arguments.runs as usize;
    let batch = Batch { success, rate: Rate::of(successes, reports.len()), reports: &reports };
    let document = if many { to_json(&batch)? } else { reports.first().map(to_json).transpose()?.unwrap_or_default() };
    if let Some(folder) = out.filter(|f| f.is_dir()) {
        let path = folder.join("report.json");
        std::fs::write(&path, &document).map_err(|source| CliError::File { path, source })?;
    }
    match arguments.format {
        Format::Json => print(&document),
        Format::Text if many => print(&batch_text(&batch)),
        Format::Text => reports.iter().for_each(|r| print(&report_text(r))),
    }
    match reports.iter().filter_map(|r| r.failure.as_ref()).find(|f| f.code == BROKEN) {
        Some(broken) => Err(CliError::Other(broken.message.clone())),
        None => Ok(success),
    }
}

fn to_json(value: &impl Serialize) -> Result<String, CliError> {
    serde_json::to_string_pretty(value).map(|t| t + "\n").map_err(|e| CliError::Other(format!("the report cannot be written: {e}")))
}

/// Ctrl-C sets the flag; a second one ends the program at once.
pub fn cancel_on_interrupt() -> Result<Arc<AtomicBool>, CliError> {
    let cancel = Arc::new(AtomicBool::new(false));
    let flag = cancel.clone();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(1);
        }
        eprintln!("\nstopping: the arm comes to rest and the recording is closed (once more to end at once)");
    })
    .map_err(|e| CliError::Other(format!("Ctrl-C cannot be caught: {e}")))?;
    Ok(cancel)
}

/// `runs/<script>-<time>`.
pub fn new_folder(script: &Path) -> PathBuf {
    let name = script.file_stem().map_or_else(|| "run".to_owned(), |n| n.to_string_lossy().into_owned());
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let (year, month, day) = civil(now / 86_400);
    let seconds = now % 86_400;
    let time = format!("{:02}{:02}{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60);
    PathBuf::from("runs").join(format!("{name}-{year:04}{month:02}{day:02}T{time}Z"))
}

/// Year, month and day of a day counted from 1970-01-01 (Howard Hinnant, "chrono-compatible low-level date algorithms").
fn civil(days: u64) -> (u64, u64, u64) {
    let z = days + 719_468;
    let (era, day_of_era) = (z / 146_097, z % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let m = (5 * day_of_year + 2) / 153;
    let month = if m < 10 { m + 3 } else { m - 9 };
    (year_of_era + era * 400 + u64::from(month <= 2), month, day_of_year - (153 * m + 2) / 5 + 1)
}

fn report_text(report: &RunReport) -> String {
    let mut rows = vec![["call", "status", "time", "figure", "predicted", "measured", "gap"].map(str::to_owned).to_vec()];
    for step in &report.steps {
        let status = match step.status {
            StepStatus::Done => "done".to_owned(),
            StepStatus::Planned => "planned".to_owned(),
            StepStatus::Failed => step.code.clone().unwrap_or_else(|| "failed".to_owned()),
        };
        let head = [step.call.clone(), status, format!("{:.1} s", step.seconds)];
        let names: Vec<&String> = step.predicted.keys().chain(step.measured.keys().filter(|k| !step.predicted.contains_key(*k))).collect();
        let cell = |figure: Option<&Figure>| figure.map(figure_text).unwrap_or_default();
        for (i, name) in names.iter().enumerate() {
            let mut row = if i == 0 { head.to_vec() } else { vec![String::new(); 3] };
            row.push((*name).clone());
            row.extend([cell(step.predicted.get(*name)), cell(step.measured.get(*name)), cell(step.gap.get(*name))]);
            rows.push(row);
        }
        if names.is_empty() {
            rows.push(head.to_vec());
        }
    }
    let mut text = format!("\n{}", table(&rows));
    for check in report.steps.iter().flat_map(|s| &s.checks).filter(|c| c.holds != Some(true)) {
        let verdict = if check.holds.is_none() { "not seen whether" } else { "it is not so that" };
        text += &format!("{verdict} {}: {}\n", check.text, check.seen);
    }
    if !report.goals.is_empty() {
        text += "\n";
    }
    for goal in &report.goals {
        text += &format!("{}  {} ({:.1} {})\n", if goal.met { "met   " } else { "MISSED" }, goal.text, goal.value, goal.unit);
    }
    if let Some(recording) = &report.recording {
        text += &format!("\nrecording  {}\n", recording.display());
    }
    let planned = report.steps.iter().all(|s| s.status == StepStatus::Planned);
    let ended = match (&report.failure, planned) {
        (Some(f), _) => format!("FAILED at {}: {} ({})", f.stage, f.message, f.code),
        (None, true) => "planned; nothing moved".to_owned(),
        (None, false) => "done".to_owned(),
    };
    format!("{text}\n{ended}; seed {}, {:.1} s of world time, {:.1} s of wall time\n", report.seed, report.seconds, report.wall_seconds)
}

fn figure_text(figure: &Figure) -> String {
    match figure.unit.as_str() {
        "rad" => format!("{:.1} deg", figure.value.to_degrees()),
        "m" => format!("{:.1} cm", figure.value * 100.0),
        unit => format!("{:.2} {unit}", figure.value),
    }
}

fn batch_text(batch: &Batch<'_>) -> String {
    let Rate { successes, runs, rate, interval: [least, most] } = batch.rate;
    format!("{successes} of {runs} runs succeeded: {:.0} % (95 % interval {:.0} to {:.0} %)\n", rate * 100.0, least * 100.0, most * 100.0)
}
