//! Asks a workflow about many runs, blindly, and remembers what it answered.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use sagci_model::ObjectModel;
use serde_json::Value;

use crate::EvaluationError;
use crate::effect::{CATALOGUE, OUTSIDE};
use crate::scenario::{Given, RunId, RunKind, Scenario, draw};
use crate::score::{Judgement, Named, Trial, judge};

/// Experiments that are done for one answer, at the most.
const EXPERIMENTS: usize = 2;

/// Which runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Suite {
    /// A small fixed slice: every effect once, some of everything else.
    Slice,
    /// Enough for the targets.
    Full,
    /// These.
    These(Vec<RunId>),
}

impl Suite {
    /// The runs, in an order in which any beginning is a fair sample.
    pub fn runs(&self) -> Vec<RunId> {
        let run = |kind, effect: &str, level, number| RunId { kind, effect: effect.to_owned(), level, number };
        let mut all = Vec::new();
        match self {
            Self::These(list) => return list.clone(),
            Self::Slice => {
                all.extend(CATALOGUE.iter().enumerate().map(|(i, e)| run(RunKind::Single, e, 1 + i % 3, 0)));
                all.extend((0..9).map(|i| run(RunKind::Clean, "", 1 + i % 3, i / 3)));
                all.extend((0..3).map(|i| run(RunKind::Double, "", 1 + i, 0)));
                all.push(run(RunKind::Triple, "", 1, 0));
                all.extend(OUTSIDE.iter().enumerate().map(|(i, e)| run(RunKind::Outside, e, 1 + i % 3, 0)));
            }
            Self::Full => {
                for number in 0..10 {
                    for level in 1..=3 {
                        all.extend(CATALOGUE.iter().map(|e| run(RunKind::Single, e, level, number)));
                        all.extend((0..34).map(|i| run(RunKind::Clean, "", level, number * 34 + i)));
                        all.extend((0..6).map(|i| run(RunKind::Double, "", level, number * 6 + i)));
                        all.extend((0..4).map(|i| run(RunKind::Triple, "", level, number * 4 + i)));
                        all.extend((0..4).map(|i| run(RunKind::Arm, "", level, number * 4 + i)));
                        all.extend(OUTSIDE.iter().map(|e| run(RunKind::Outside, e, level, number)));
                    }
                }
            }
        }
        all
    }
}

/// What [`run`] does.
#[derive(Debug, Clone)]
pub struct Options {
    /// Which runs.
    pub suite: Suite,
    /// Everything is drawn from it.
    pub seed: u64,
    /// Only runs whose name begins so; empty for all. A `*` stands for any part between two strokes, as in `single/*/3`.
    pub only: String,
    /// A folder for `results.jsonl`: a run that stands there is not asked again.
    pub out: Option<PathBuf>,
    /// A folder for the sealed truths, one file a run. Nothing reads them back.
    pub sealed: Option<PathBuf>,
    /// A folder for what the workflow is given, one folder a run with the model and the logs.
    pub data: Option<PathBuf>,
    /// The robot's arm; without it the runs with an arm are left out.
    pub arm: Option<ObjectModel>,
    /// No run is begun later than this after the first. What stands by then is judged: any beginning of a suite is a fair sample of it.
    pub limit: Option<Duration>,
}

impl Default for Options {
    fn default() -> Self {
        Self { suite: Suite::Slice, seed: 1, only: String::new(), out: None, sealed: None, data: None, arm: None, limit: None }
    }
}

/// Draws the runs, asks the workflow about each and judges the answers. The workflow sees [`Given`] and nothing else: its answer is
/// the JSON document of a report, or why there is none. `progress` gets one line a run.
///
/// # Errors
/// A file that cannot be read or written, or a run that cannot be drawn. A workflow that fails is a judgement.
pub fn run(
    options: &Options,
    workflow: &(dyn Fn(&Given) -> Result<Value, String> + Sync),
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Vec<Judgement>, EvaluationError> {
    for folder in [&options.out, &options.sealed, &options.data].into_iter().flatten() {
        std::fs::create_dir_all(folder).map_err(|source| EvaluationError::File { path: folder.clone(), source })?;
    }
    let results = options.out.as_ref().map(|o| o.join("results.jsonl"));
    let mut done = match &results {
        Some(path) => remembered(path, options.seed)?,
        None => Vec::new(),
    };
    let mut wanted = options.suite.runs();
    wanted.retain(|id| begins(&id.to_string(), &options.only) && (id.kind != RunKind::Arm || options.arm.is_some()));
    let asked: BTreeSet<&RunId> = wanted.iter().collect();
    done.retain(|j| asked.contains(&j.id));
    let known: BTreeSet<RunId> = done.iter().map(|j| j.id.clone()).collect();
    let open: Vec<&RunId> = wanted.iter().filter(|id| !known.contains(id)).collect();

    let file = match &results {
        Some(path) => {
            let file = std::fs::OpenOptions::new().create(true).append(true).open(path);
            Some(Mutex::new(file.map_err(|source| EvaluationError::File { path: path.clone(), source })?))
        }
        None => None,
    };
    let (count, total) = (AtomicUsize::new(known.len()), wanted.len());
    let ask = |id: &RunId| -> Result<Judgement, EvaluationError> {
        let scenario = draw(id, options.seed, options.arm.as_ref())?;
        let name = id.to_string().replace('/', "-");
        if let Some(folder) = &options.sealed {
            write(&folder.join(format!("{name}.json")), &serde_json::to_string_pretty(&scenario.truth).unwrap_or_default())?;
        }
        if let Some(folder) = &options.data {
            store(&folder.join(&name), &scenario.given)?;
        }
        let began = Instant::now();
        let answer = workflow(&scenario.given);
        let mut judgement = judge(&scenario.truth, &answer, began.elapsed().as_secs_f64());
        if let Ok(answer) = &answer
            && asks(&judgement)
        {
            judgement.trial = Some(try_out(&scenario, answer, workflow)?);
        }
        if let (Some(file), Some(path)) = (&file, &results) {
            let mut line = serde_json::to_string(&judgement).unwrap_or_default();
            line.push('\n');
            if let Ok(mut file) = file.lock() {
                file.write_all(line.as_bytes()).map_err(|source| EvaluationError::File { path: path.clone(), source })?;
            }
        }
        progress(&line_of(count.fetch_add(1, Ordering::Relaxed) + 1, total, &judgement));
        Ok(judgement)
    };
    // Plain threads, one a core: a worker of a pool that waits for a run would begin another one meanwhile, and all would be open at once.
    let next = AtomicUsize::new(0);
    let began = Instant::now();
    let in_time = || options.limit.is_none_or(|limit| began.elapsed() < limit);
    let work = || -> Result<Vec<Judgement>, EvaluationError> {
        let mut judged = Vec::new();
        while in_time()
            && let Some(id) = open.get(next.fetch_add(1, Ordering::Relaxed))
        {
            judged.push(ask(id).inspect_err(|_| next.store(open.len(), Ordering::Relaxed))?);
        }
        Ok(judged)
    };
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let fresh: Vec<Result<Vec<Judgement>, EvaluationError>> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        let join = |w: std::thread::ScopedJoinHandle<'_, _>| w.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        workers.into_iter().map(join).collect()
    });
    for judged in fresh {
        done.extend(judged?);
    }
    done.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(done)
}

/// Has an answer to settle between names of which one is true? Of an arm experiments would take as long as all else.
fn asks(judgement: &Judgement) -> bool {
    judgement.verdict == "ambiguous" && judgement.in_sets && !judgement.exact && judgement.id.kind != RunKind::Arm
}

/// Does what an answer asks for on the true mechanism, and asks again with what that recorded.
fn try_out(
    scenario: &Scenario,
    first: &Value,
    workflow: &(dyn Fn(&Given) -> Result<Value, String> + Sync),
) -> Result<Trial, EvaluationError> {
    let mut given = scenario.given.clone();
    let mut trial = Trial::default();
    let mut answer = first.clone();
    while trial.done < EXPERIMENTS && !trial.settled {
        let next = &answer["next_experiment"];
        let Some(name) = next["name"].as_str() else { break };
        trial.asked.push(name.to_owned());
        let recorded = scenario.bench.perform(next, trial.done + 1);
        if matches!(recorded, Ok(None)) {
            break;
        }
        trial.done += 1;
        let again = match recorded {
            Ok(log) => {
                given.train.extend(log);
                workflow(&given)
            }
            Err(ran_away @ EvaluationError::Diverged { .. }) => Err(ran_away.to_string()),
            Err(other) => return Err(other),
        };
        let judged = judge(&scenario.truth, &again, 0.0);
        (trial.named, trial.settled) = (judged.named, judged.exact);
        match again {
            Ok(again) => answer = again,
            Err(why) => {
                trial.failure = Some(why);
                break;
            }
        }
    }
    Ok(trial)
}

/// Does a run's name begin so? A `*` stands for any part of it.
fn begins(name: &str, so: &str) -> bool {
    let (mut parts, mut asked) = (name.split('/'), so.split('/').peekable());
    while let Some(asks) = asked.next() {
        let Some(part) = parts.next() else { return false };
        let same = if asked.peek().is_none() { part.starts_with(asks) } else { part == asks };
        if !same && asks != "*" {
            return false;
        }
    }
    true
}

fn names_of(named: &[Named]) -> String {
    let sets: Vec<String> = named.iter().map(|n| [&[n.name.clone()][..], &n.alternatives].concat().join("|")).collect();
    sets.join(" + ")
}

fn line_of(number: usize, total: usize, j: &Judgement) -> String {
    let said = if j.named.is_empty() { j.verdict.clone() } else { names_of(&j.named) };
    let mark = match (&j.failure, j.id.kind) {
        (Some(_), _) => "failed",
        (_, RunKind::Outside) if j.verdict == "unknown" && j.named.is_empty() => "right",
        (_, RunKind::Outside) => "WRONG",
        _ if j.exact => "right",
        _ if !j.nameable.iter().all(|x| *x) => "hidden too deep",
        _ if j.in_sets => "in the set",
        _ => "WRONG",
    };
    let said = j.failure.as_ref().map_or(said, Clone::clone);
    let then = j.trial.as_ref().map_or_else(String::new, |t| {
        let said = if t.named.is_empty() { "nothing".to_owned() } else { names_of(&t.named) };
        let end = t.failure.as_ref().unwrap_or(&said);
        let end = if t.done == 0 { "no motion" } else { end };
        format!("; after {}: {end}", if t.asked.is_empty() { "no experiment".to_owned() } else { t.asked.join(", ") })
    });
    format!(
        "[{number}/{total}] {:<44} {:<26} {mark}: {said} (hidden: {}; snr {:.0}; {:.1} s){then}",
        j.id.to_string(),
        j.plant,
        if j.hidden.is_empty() { "nothing".to_owned() } else { j.hidden.join(" + ") },
        j.snr.min(1e5),
        j.wall
    )
}

fn write(path: &Path, text: &str) -> Result<(), EvaluationError> {
    std::fs::write(path, text).map_err(|source| EvaluationError::File { path: path.to_owned(), source })
}

/// What a workflow is given, as files: a model's folder and its logs.
fn store(folder: &Path, given: &Given) -> Result<(), EvaluationError> {
    given.model.write(folder).map_err(|e| EvaluationError::Malformed { path: folder.to_owned(), message: e.to_string() })?;
    for log in given.train.iter().chain(&given.held_out) {
        write(&folder.join(&log.source), &log.to_csv())?;
    }
    Ok(())
}

/// Judgements of an earlier run with the same seed. A last line that was cut off is left out.
fn remembered(path: &Path, seed: u64) -> Result<Vec<Judgement>, EvaluationError> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = std::fs::read_to_string(path).map_err(|source| EvaluationError::File { path: path.to_owned(), source })?;
    let lines: Vec<&str> = text.lines().collect();
    let mut all = Vec::new();
    for (i, line) in lines.iter().enumerate() {
        match serde_json::from_str::<Judgement>(line) {
            Ok(judgement) if judgement.seed == seed => all.push(judgement),
            Ok(_) => {}
            Err(_) if i + 1 == lines.len() => {}
            Err(e) => {
                let message = format!("line {}: {e}; remove the file to begin anew", i + 1);
                return Err(EvaluationError::Malformed { path: path.to_owned(), message });
            }
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::begins;

    #[test]
    fn a_star_stands_for_any_one_part_and_what_is_last_may_be_cut_short() {
        for (so, does) in [
            ("", true),
            ("sing", true),
            ("single/joint", true),
            ("single/joint_spring/3", true),
            ("single/*/3", true),
            ("*/*/*/00", true),
            ("single/joint/3", false),
            ("single/*/1", false),
            ("clean", false),
            ("*/*/*/*/*", false),
        ] {
            assert_eq!(begins("single/joint_spring/3/004", so), does, "{so}");
        }
    }
}
