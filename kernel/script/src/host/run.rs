//! From the first line of a script to its report.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use sagci_model::{JointKind, ObjectModel};
use sagci_skill::{Argument, Failure, FailureCode, PlanRequest};
use sagci_world::judge::{Goals, Verdict};
use sagci_world::recording::{Journal, Level, Outcome as RunOutcome, RunRecord, Versioned};
use sagci_world::{Placement, Scene, World};

use super::arm::HostArm;
use super::belief::{self, joint_slot};
use super::gap::Recorded;
use super::live::{Live, Perceive, Sought, Thing, broken};
use super::progress::{Event, Progress};
use super::report::{FailureReport, GapReport, GoalReport, RunReport, StepReport, StepStatus, Version, Versions, figures, gap};
use super::scene::Declared;
use super::step::{Calling, failure};
use crate::language::engine::{Surroundings, code_name};
use crate::language::execute::{End, execute};
use crate::language::stage::{AskedExperiment, Declaration, GapAnswer, GapRequest, Outcome, Quantity, Refusal, Stage, Stop};
use crate::language::value::{Angle, Length, RunHandle, argument_words};
use crate::plugins::{LoadedSkill, SkillSet};
use crate::{Diagnostic, Models};

/// Where worlds come from.
pub trait WorldSource: Send + Sync {
    /// The kind of world, for reports.
    fn kind(&self) -> &str;

    /// A new world, not yet reset. If a recording is asked for, what passes is written to that file; the journal is the
    /// way to write there what the world does not know.
    fn open(&self, recording: Option<(&Path, &RunRecord)>) -> Result<(Box<dyn World>, Option<Journal>), String>;
}

/// What runs are made with.
#[derive(Clone)]
pub struct Kit {
    /// The skills.
    pub skills: Arc<SkillSet>,
    /// The object models.
    pub models: Arc<dyn Models>,
    /// The worlds; nothing moves without one.
    pub worlds: Option<Arc<dyn WorldSource>>,
    /// Finds objects in images.
    pub perceive: Arc<dyn Perceive>,
    /// Who watches.
    pub progress: Arc<dyn Progress>,
    /// Set to stop.
    pub cancel: Arc<AtomicBool>,
}

/// How a script is run.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Seed of the world and of every random choice.
    pub seed: u64,
    /// Folder for recordings; none are written without it.
    pub out: Option<PathBuf>,
    /// What `asked_experiment()` answers.
    pub asked: Option<AskedExperiment>,
}

/// Why there is no report: the script or the tool is wrong.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RunError {
    /// The script is wrong.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Script(Vec<Diagnostic>),
    /// The world or the program broke down.
    #[error("{0}")]
    Broken(String),
}

/// Code of a run that ended because the world or the program broke down.
pub const BROKEN: &str = "broken";

/// Control period of a plan that is not carried out, s.
const PLAN_PERIOD: f64 = 1e-3;

/// Runs a script once. It is checked first; nothing moves if it is wrong.
pub fn run(script: &Path, kit: &Kit, options: &RunOptions) -> Result<RunReport, RunError> {
    let problems = crate::language::check::check(script, &kit.skills, kit.models.as_ref());
    if !problems.is_empty() {
        return Err(RunError::Script(problems));
    }
    let goals = goals_of(script)?;
    let start = Instant::now();
    let host = Rc::new(RefCell::new(Host {
        script: script.to_owned(),
        kit: kit.clone(),
        options: options.clone(),
        goals,
        declared: Declared::default(),
        phase: Phase::Declaring,
        steps: Vec::new(),
        journal: None,
        used_skills: BTreeMap::new(),
        runs: Vec::new(),
        gaps: Vec::new(),
        published: BTreeMap::new(),
    }));
    let stage: Rc<RefCell<dyn Stage>> = host.clone();
    let end = execute(script, Surroundings { skills: kit.skills.loaded.clone(), stage, cancel: kit.cancel.clone() });
    let mut host = Rc::try_unwrap(host).map_err(|_| RunError::Broken("the script outlived its run".to_owned()))?.into_inner();
    let failure = match end {
        End::Wrong(diagnostic) => return Err(RunError::Script(vec![diagnostic])),
        End::Broken(message) => Some(FailureReport { code: BROKEN.to_owned(), stage: "world".to_owned(), message }),
        End::Done => None,
        End::Interrupted => {
            let message = "someone asked it to stop; the arm is at rest".to_owned();
            Some(FailureReport { code: "interrupted".to_owned(), stage: "script".to_owned(), message })
        }
        End::Failed { code, stage, diagnostic } => Some(FailureReport { code, stage, message: diagnostic.to_string() }),
    };
    let report = host.finish(script, failure, start)?;
    kit.progress.event(options.seed, &Event::Finished { report: &report });
    Ok(report)
}

/// Runs a script with several seeds, over the cores of this machine. The reports stand in the order of the seeds and are
/// the same whatever the number of cores, wall times aside.
pub fn run_many(script: &Path, kit: &Kit, options: &RunOptions, runs: usize, threads: usize) -> Vec<Result<RunReport, RunError>> {
    let next = AtomicUsize::new(0);
    let reports: Mutex<BTreeMap<usize, Result<RunReport, RunError>>> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, runs.max(1)) {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= runs || kit.cancel.load(Ordering::Relaxed) {
                        return;
                    }
                    let options = RunOptions { seed: options.seed.wrapping_add(i as u64), ..options.clone() };
                    let report = run(script, kit, &options);
                    let wrong = report.is_err();
                    reports.lock().unwrap_or_else(std::sync::PoisonError::into_inner).insert(i, report);
                    if wrong {
                        // It would be wrong for every seed.
                        next.store(runs, Ordering::Relaxed);
                    }
                }
            });
        }
    });
    reports.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).into_values().collect()
}

/// The goals beside a script: `warm_mug.check.yaml` for `warm_mug.rhai`.
fn goals_of(script: &Path) -> Result<Option<Goals>, RunError> {
    let file = script.with_extension("check.yaml");
    if !file.exists() {
        return Ok(None);
    }
    let wrong = |e: String| RunError::Script(vec![Diagnostic { file: file.clone(), place: None, message: e, hint: None }]);
    Goals::read(&file).map(Some).map_err(|e| wrong(e.to_string()))
}

/// How far a run is.
pub(super) enum Phase {
    /// Things are being declared.
    Declaring,
    /// The world stands.
    Live(Box<Live>),
    /// Plans are made from what is predicted.
    Planning(Box<Predicted>),
}

/// What is predicted, where nothing moves.
pub(super) struct Predicted {
    belief: sagci_signal::SceneBelief,
    q: Vec<f64>,
    gripper_width: f64,
    models: Vec<Arc<ObjectModel>>,
}

pub(super) struct Host {
    script: PathBuf,
    pub(super) kit: Kit,
    pub(super) options: RunOptions,
    goals: Option<Goals>,
    pub(super) declared: Declared,
    pub(super) phase: Phase,
    steps: Vec<StepReport>,
    journal: Option<Journal>,
    used_skills: BTreeMap<String, LoadedSkill>,
    /// What calls of skills left for the gap workflow.
    pub(super) runs: Vec<Recorded>,
    pub(super) gaps: Vec<GapReport>,
    /// Models that this run has published, by name: version, and the model. Other runs of the same program keep what they began with.
    pub(super) published: BTreeMap<String, (String, Arc<ObjectModel>)>,
}

impl Host {
    /// Makes the world after the script's first words, and looks around.
    pub(super) fn begin(&mut self) -> Result<(), Stop> {
        let (scene, belief) = self.declared.scene(self.kit.models.as_ref()).map_err(Stop::Refused)?;
        if let Some(goals) = &self.goals {
            goals.check(&scene).map_err(|e| Stop::Refused(Refusal { message: format!("the goals beside the script: {e}"), hint: None }))?;
        }
        let Some(worlds) = self.kit.worlds.clone() else {
            let facts = scene.robot.document.robot.as_ref();
            let q = facts.and_then(|f| f.configurations.iter().find(|c| c.name == scene.start)).map(|c| c.q.clone()).unwrap_or_default();
            let gripper_width = facts.map_or(0.0, |f| f.gripper.max_width);
            let models = scene.objects.iter().filter(|o| belief.object(&o.name).is_some()).map(|o| o.model.clone()).collect();
            self.phase = Phase::Planning(Box::new(Predicted { belief, q, gripper_width, models }));
            return Ok(());
        };
        let recording = self.options.out.as_ref().map(|out| out.join(format!("seed-{}.mcap", self.options.seed)));
        let record = self.record(&scene, worlds.kind());
        let (mut world, journal) = worlds.open(recording.as_deref().map(|path| (path, &record))).map_err(Stop::Broken)?;
        self.journal.clone_from(&journal);
        if let Err(e) = world.reset(&scene, self.options.seed) {
            drop(world);
            // Nothing has happened: there is nothing to keep.
            if let Some(journal) = self.journal.take() {
                let path = journal.path();
                drop(journal);
                let _ = std::fs::remove_file(path);
            }
            return Err(match e {
                sagci_world::WorldError::Scene { .. } => Stop::Refused(Refusal { message: e.to_string(), hint: None }),
                other => broken("the world", other),
            });
        }
        let arm = HostArm::new(&scene.robot, belief.X_WR, belief.gravity, world.period()).map_err(|e| broken("the arm's control", e))?;
        let things = scene
            .objects
            .iter()
            // What the robot is told nothing of is not known to the host either.
            .filter(|o| belief.object(&o.name).is_some())
            .map(|o| Thing {
                model: o.model.clone(),
                declared: Some(o.placement.clone()),
                home: Some(o.placement.clone()).filter(|p| matches!(p, Placement::Inside { .. })),
                released: false,
            })
            .collect();
        let mut live = Live {
            observation: world.observe(),
            journal,
            world,
            scene,
            belief,
            things,
            arm,
            perceive: self.kit.perceive.clone(),
            progress: self.kit.progress.clone(),
            cancel: self.kit.cancel.clone(),
            seed: self.options.seed,
            sensed: Vec::new(),
        };
        let all: Vec<Sought> = live.belief.objects.iter().map(|o| Sought::object(&o.name)).collect();
        // Where nothing is declared there is nothing to look for yet.
        let looked = if all.is_empty() { Ok(()) } else { live.look_around(&all) };
        live.note_belief();
        // Kept also when it was interrupted: the report and the recording need it.
        self.phase = Phase::Live(Box::new(live));
        looked
    }

    fn perform(
        &mut self,
        skill: &LoadedSkill,
        arguments: BTreeMap<String, Argument>,
        report: &mut StepReport,
        call: &str,
    ) -> Result<Option<Failure>, Stop> {
        if matches!(self.phase, Phase::Declaring) {
            self.begin()?;
        }
        let step = self.steps.len();
        // Each call has random numbers of its own (the constant is 2^64 divided by the golden ratio).
        let seed = self.options.seed.wrapping_add((step as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let cancel = self.kit.cancel.clone();
        let cancelled = || cancel.load(Ordering::Relaxed);
        self.kit.progress.event(self.options.seed, &Event::Planning { step, call });
        match &mut self.phase {
            Phase::Declaring => Err(Stop::Broken("the run did not begin".to_owned())),
            Phase::Planning(predicted) => {
                let request = PlanRequest {
                    arguments,
                    belief: predicted.belief.clone(),
                    q: predicted.q.clone(),
                    gripper_width: predicted.gripper_width,
                    period: PLAN_PERIOD,
                    seed,
                };
                let before = Instant::now();
                let plan = skill.skill.plan(&request, &cancelled);
                report.plan_wall_seconds = before.elapsed().as_secs_f64();
                let plan = match plan {
                    Ok(plan) => plan,
                    Err(_) if cancelled() => return Err(Stop::Interrupted),
                    Err(f) => return Ok(Some(f)),
                };
                report.predicted = figures(&plan.summary.predicted);
                report.seconds = plan.summary.phases.iter().map(|p| p.seconds).sum();
                report.status = StepStatus::Planned;
                plan.summary.after.iter().for_each(|change| belief::apply(&mut predicted.belief, &predicted.models, change));
                if plan.summary.q_after.len() == predicted.q.len() {
                    predicted.q.clone_from(&plan.summary.q_after);
                }
                Ok(None)
            }
            Phase::Live(live) => {
                let start = live.observation.time;
                live.sensed.clear();
                if let Some(f) = live.see(&arguments)? {
                    return Ok(Some(f));
                }
                let before = Instant::now();
                let plan = skill.skill.plan(&live.request(arguments, seed), &cancelled);
                report.plan_wall_seconds = before.elapsed().as_secs_f64();
                let mut plan = match plan {
                    Ok(plan) => plan,
                    Err(_) if cancelled() => return Err(Stop::Interrupted),
                    Err(f) => return Ok(Some(f)),
                };
                report.predicted = figures(&plan.summary.predicted);
                let believed = live.belief.clone();
                let calling = Calling { step, skill: &skill.manifest.name, call };
                let carried = live.carry_out(&calling, &plan.summary, plan.execution.as_mut());
                report.seconds = live.observation.time - start;
                let mut carried = carried?;
                if let Some((object, joint)) = &carried.moved {
                    let recorded = Recorded::new(live, &believed, [object, joint], &self.runs);
                    if let Some(out) = &self.options.out {
                        let stem = format!("seed-{}.run-{}", self.options.seed, self.runs.len() + 1);
                        recorded.write(out, &stem).map_err(|e| broken("what was recorded", e))?;
                    }
                    self.runs.push(recorded);
                }
                report.measured = figures(&carried.measured);
                if carried.failure.is_none() {
                    report.checks = live.verify(&plan.summary.postconditions, &mut carried.measured)?;
                    report.measured = figures(&carried.measured);
                    if let Some(wrong) = report.checks.iter().find(|c| c.holds == Some(false)) {
                        let message = format!("the skill reports success, but it is not so that {}: {}", wrong.text, wrong.seen);
                        carried.failure = Some(failure(FailureCode::PostconditionFailed, "check", message));
                    }
                }
                report.seconds = live.observation.time - start;
                report.gap = gap(&report.predicted, &report.measured);
                Ok(carried.failure)
            }
        }
    }

    fn finish(&mut self, script: &Path, mut failure: Option<FailureReport>, start: Instant) -> Result<RunReport, RunError> {
        let (mut goals, mut seconds, mut world_kind) = (Vec::new(), 0.0, "none".to_owned());
        let mut met = true;
        let mut models: Vec<String> = self.declared.objects.iter().map(|(d, _)| d.model.clone()).collect();
        if let Ok(robot) = self.declared.robot(self.kit.models.as_ref()) {
            models.insert(0, robot.name.clone());
        }
        models.dedup();
        let recording = self.journal.as_ref().map(Journal::path);
        if let Phase::Live(live) = std::mem::replace(&mut self.phase, Phase::Declaring) {
            seconds = live.observation.time;
            world_kind = self.kit.worlds.as_ref().map_or_else(|| world_kind.clone(), |w| w.kind().to_owned());
            if let Some(verdict) = self.goals.as_ref().and_then(|g| live.world.judge(&g.goals)) {
                met = verdict.met;
                goals = goal_reports(verdict);
            }
        }
        if failure.is_none() && !met {
            let missed: Vec<&str> = goals.iter().filter(|g| !g.met).map(|g| g.text.as_str()).collect();
            let message = format!("the script ran to its end, but it is not true that {}", missed.join("; "));
            failure = Some(FailureReport { code: "goals".to_owned(), stage: "judge".to_owned(), message });
        }
        let version = |name: &String| {
            let (version, sha256) = self.kit.models.version(name).ok()?;
            Some(Version { name: name.clone(), version, sha256 })
        };
        let versions = Versions {
            program: concat!("sagci ", env!("CARGO_PKG_VERSION")).to_owned(),
            models: models.iter().filter_map(version).collect(),
            skills: self
                .used_skills
                .values()
                .map(|s| Version {
                    name: s.manifest.name.clone(),
                    version: s.manifest.version.clone(),
                    sha256: s.sha256().unwrap_or_default(),
                })
                .collect(),
        };
        let report = RunReport {
            success: failure.is_none(),
            seed: self.options.seed,
            script: script.to_owned(),
            world: world_kind,
            steps: std::mem::take(&mut self.steps),
            gaps: std::mem::take(&mut self.gaps),
            goals,
            failure,
            recording,
            seconds,
            wall_seconds: start.elapsed().as_secs_f64(),
            versions,
        };
        if let Some(journal) = &self.journal {
            let message = report.failure.as_ref().map_or_else(|| "done".to_owned(), |f| f.message.clone());
            let outcome = RunOutcome { success: report.success, message, report: serde_json::to_value(&report).unwrap_or_default() };
            journal.close(&outcome).map_err(|e| RunError::Broken(format!("the recording: {e}")))?;
        }
        Ok(report)
    }

    /// What is run, for the recording.
    fn record(&self, scene: &Scene, world: &str) -> RunRecord {
        let models = [&scene.robot].into_iter().chain(scene.objects.iter().map(|o| &o.model));
        let mut versions: Vec<Versioned> = Vec::new();
        for name in models.map(|m| m.name.clone()) {
            if !versions.iter().any(|v| v.name == name) {
                let (version, sha256) = self.kit.models.version(&name).unwrap_or_default();
                versions.push(Versioned { name, version, sha256 });
            }
        }
        let skills = self.kit.skills.loaded.iter().map(|s| Versioned {
            name: s.manifest.name.clone(),
            version: s.manifest.version.clone(),
            sha256: s.sha256().unwrap_or_default(),
        });
        RunRecord {
            program: concat!("sagci ", env!("CARGO_PKG_VERSION")).to_owned(),
            script: self.script.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            text: std::fs::read_to_string(&self.script).unwrap_or_default(),
            seed: self.options.seed,
            world: world.to_owned(),
            period: PLAN_PERIOD,
            models: versions,
            skills: skills.collect(),
        }
    }
}

fn goal_reports(verdict: Verdict) -> Vec<GoalReport> {
    verdict.goals.into_iter().map(|g| GoalReport { text: g.text, met: g.met, value: g.value, unit: g.unit }).collect()
}

impl Stage for Host {
    fn expect(&mut self, declaration: Declaration) -> Result<(), Refusal> {
        if !matches!(self.phase, Phase::Declaring) {
            let hint = Some("declare everything before the first skill is called".to_owned());
            return Err(Refusal { message: format!("'{}' is declared after the robot has begun", declaration.name), hint });
        }
        self.declared.add(declaration, self.kit.models.as_ref())
    }

    fn unknown(&mut self, declaration: Declaration) -> Result<(), Refusal> {
        if !matches!(self.phase, Phase::Declaring) {
            let hint = Some("put everything there before the first skill is called".to_owned());
            return Err(Refusal { message: format!("'{}' is put there after the robot has begun", declaration.name), hint });
        }
        self.declared.add_unknown(declaration, self.kit.models.as_ref())
    }

    fn learn(&mut self, name: &str) -> Result<(), Stop> {
        self.learn_object(name)
    }

    fn robot(&mut self, model: &str) -> Result<(), Refusal> {
        super::scene::model(self.kit.models.as_ref(), model)?;
        self.declared.robot = Some(model.to_owned());
        Ok(())
    }

    fn call(&mut self, skill: &LoadedSkill, arguments: BTreeMap<String, Argument>) -> Result<Outcome, Stop> {
        let args: BTreeMap<String, String> = arguments.iter().map(|(name, a)| (name.clone(), argument_words(a))).collect();
        let mut report = StepReport {
            skill: skill.manifest.name.clone(),
            call: String::new(),
            args,
            status: StepStatus::Done,
            code: None,
            stage: None,
            message: None,
            seconds: 0.0,
            plan_wall_seconds: 0.0,
            wall_seconds: 0.0,
            predicted: BTreeMap::new(),
            measured: BTreeMap::new(),
            gap: BTreeMap::new(),
            checks: Vec::new(),
        };
        let in_order: Vec<&str> = skill.manifest.parameters.iter().filter_map(|p| report.args.get(&p.name)).map(String::as_str).collect();
        let call = format!("{}({})", skill.manifest.name, in_order.join(", "));
        report.call.clone_from(&call);
        self.used_skills.entry(skill.manifest.name.clone()).or_insert_with(|| skill.clone());
        let before = Instant::now();
        let result = self.perform(skill, arguments, &mut report, &call);
        report.wall_seconds = before.elapsed().as_secs_f64();
        let mut fail = |code: String, f: &str, message: String| {
            report.status = StepStatus::Failed;
            (report.code, report.stage, report.message) = (Some(code), Some(f.to_owned()), Some(message));
        };
        match &result {
            Ok(None) => {}
            Ok(Some(f)) => fail(code_name(f.code), &f.stage, f.message.clone()),
            Err(Stop::Failed(f)) => fail(code_name(f.code), &f.stage, f.message.clone()),
            Err(Stop::Interrupted) => fail("interrupted".to_owned(), "execution", "someone asked it to stop".to_owned()),
            // No report comes of these.
            Err(Stop::Refused(_) | Stop::Broken(_)) => {}
        }
        self.kit.progress.event(self.options.seed, &Event::Ended { step: self.steps.len(), report: &report });
        if let Some(journal) = &self.journal {
            let (level, text) = match &report.message {
                Some(message) => (Level::Error, format!("{call} failed: {message}")),
                None => (Level::Info, format!("{call} done")),
            };
            journal.log(level, "host", &text);
        }
        if let Phase::Live(live) = &self.phase {
            live.note_belief();
        }
        let measured =
            report.measured.iter().map(|(name, f)| sagci_skill::Measure { name: name.clone(), value: f.value, unit: f.unit.clone() });
        let outcome = Outcome { seconds: report.seconds, measured: measured.collect() };
        self.steps.push(report);
        match result? {
            None => Ok(outcome),
            Some(f) => Err(Stop::Failed(f)),
        }
    }

    fn position(&mut self, object: &str, joint: Option<&str>) -> Result<Quantity, Refusal> {
        let refuse = |message: String| Refusal { message, hint: None };
        let (_, model) = self.declared.get(object).ok_or_else(|| refuse(format!("'{object}' is not declared")))?;
        let slot = match joint {
            Some(joint) => {
                joint_slot(model, joint).ok_or_else(|| refuse(format!("the model '{}' has no moving joint '{joint}'", model.name)))?
            }
            None if model.moving_joints().next().is_some() => 0,
            None => return Err(refuse(format!("the model '{}' has no moving joint", model.name))),
        };
        let belief = match &self.phase {
            Phase::Declaring => None,
            Phase::Live(live) => live.belief.object(object),
            Phase::Planning(predicted) => predicted.belief.object(object),
        };
        let q = belief.map_or_else(|| self.declared.q(object), |o| o.q.clone());
        let value = q.get(slot).copied().unwrap_or(0.0);
        let slides = model.moving_joints().nth(slot).is_some_and(|j| model.joints[j].kind == JointKind::Prismatic);
        Ok(if slides { Quantity::Length(Length(value)) } else { Quantity::Angle(Angle(value)) })
    }

    fn hide(&mut self, object: &str, joint: Option<&str>) -> Result<(), Refusal> {
        if !matches!(self.phase, Phase::Declaring) {
            let hint = Some("say it before the first skill is called".to_owned());
            return Err(Refusal { message: "an effect cannot be hidden after the robot has begun".to_owned(), hint });
        }
        self.declared.hide(object, joint)
    }

    fn last_run(&mut self) -> Result<RunHandle, Refusal> {
        self.last_recorded()
    }

    fn gap(&mut self, request: &GapRequest) -> Result<GapAnswer, Stop> {
        self.close_gap(request)
    }

    fn asked(&self) -> Option<AskedExperiment> {
        self.options.asked.clone()
    }

    fn prediction_error(&mut self, object: &str, run: RunHandle) -> Result<Quantity, Stop> {
        self.error_of(object, run)
    }

    fn version(&mut self, object: &str) -> Result<String, Refusal> {
        self.version_of(object)
    }

    fn say(&mut self, text: &str) {
        self.kit.progress.event(self.options.seed, &Event::Say { text });
        if let Some(journal) = &self.journal {
            journal.log(Level::Info, "script", text);
        }
    }
}
