//! From what was recorded in the run to a better model of an object, and back into the run.
//!
//! A call of a skill that moved a joint by its handle leaves a recording for each time that the handle was held. The gap workflow is asked
//! what the object's model lacks; what it finds is published as a new version, which the rest of the run plans with.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use sagci_gap::report::Gap;
use sagci_gap::{Found, Options, find, page};
use sagci_library::Evidence;
use sagci_model::{JointKind, ObjectModel};
use sagci_recording::Log;
use sagci_refinement::{HeldJoint, Zero, held_joint};
use sagci_signal::SceneBelief;
use sagci_skill::{Failure, FailureCode};
use sagci_world::judge::NamedEffect;

use super::live::Live;
use super::progress::Event;
use super::report::{EffectReport, GapReport};
use super::run::{Host, Phase};
use super::step::failure;
use crate::language::stage::{FoundEffect, GapAnswer, GapRequest, Quantity, Refusal, Stop};
use crate::language::value::{Angle, Length, RunHandle};

/// Recordings that begin at most so long after the end of the one before run on from it, s.
const PAUSE: f64 = 600.0;
/// A file's name for evidence that stands beside a version.
const REPORT_FILE: &str = "gap.json";
const PAGE_FILE: &str = "report.html";

/// What one call of a skill left.
pub(super) struct Recorded {
    /// Name of the object in the scene.
    object: String,
    joint: String,
    /// One recording for each hold of the handle, and from where positions are counted; or why there is none.
    logs: Result<(Vec<Log>, Zero), String>,
}

impl Recorded {
    /// What the robot sensed while it moved a joint of an object, whose place and joints were believed to be as `before` says. Positions are
    /// counted as in `earlier` runs.
    pub(super) fn new(live: &Live, before: &SceneBelief, [object, joint]: [&str; 2], earlier: &[Self]) -> Self {
        let same = |run: &&Self| run.object == object && run.joint == joint;
        let zero = earlier.iter().rev().filter(same).find_map(|run| Some(&run.logs.as_ref().ok()?.1));
        let logs = before.object(object).zip(live.object(object)).map_or_else(
            || Err(format!("'{object}' is not in the scene")),
            |(belief, (_, model))| {
                let (X_WR, X_WO) = (before.X_WR, belief.X_WO);
                let setting = HeldJoint { robot: &live.scene.robot, X_WR, object: model, X_WO, joint, q: &belief.q, zero };
                held_joint(&setting, &live.sensed).map_err(|e| e.to_string())
            },
        );
        Self { object: object.to_owned(), joint: joint.to_owned(), logs }
    }

    /// Writes the recordings beside the run's own: `sagci gap` reads them.
    pub(super) fn write(&self, folder: &Path, stem: &str) -> Result<(), std::io::Error> {
        for (i, log) in self.logs.iter().flat_map(|(logs, _)| logs).enumerate() {
            std::fs::write(folder.join(format!("{stem}.hold-{}.csv", i + 1)), log.to_csv())?;
        }
        Ok(())
    }
}

fn refuse<T>(message: String, hint: &str) -> Result<T, Refusal> {
    Err(Refusal { message, hint: Some(hint.to_owned()) })
}

fn quantity(model: &ObjectModel, joint: &str, value: f64) -> Quantity {
    let slides = model.joint(joint).is_some_and(|j| model.joints[j].kind == JointKind::Prismatic);
    if slides { Quantity::Length(Length(value)) } else { Quantity::Angle(Angle(value)) }
}

fn unsuitable(message: String) -> Failure {
    failure(FailureCode::BadArgument, "gap", message)
}

impl Host {
    pub(super) fn last_recorded(&self) -> Result<RunHandle, Refusal> {
        match &self.phase {
            // Nothing is recorded where nothing moves; the plan goes on as if it were.
            Phase::Planning(_) => Ok(RunHandle(self.runs.len())),
            _ if self.runs.is_empty() => {
                refuse("no skill has moved a joint yet".to_owned(), "call one that does, such as open(...), before last_run()")
            }
            _ => Ok(RunHandle(self.runs.len() - 1)),
        }
    }

    /// The current model of an object in the scene, and its name in the library.
    fn stored(&self, object: &str) -> Result<(String, Arc<ObjectModel>), Refusal> {
        let Some((declaration, declared)) = self.declared.get(object) else {
            return refuse(format!("'{object}' is not declared"), "declare it with scene.expect(...)");
        };
        let model = self.published.get(&declaration.model).map_or_else(|| declared.clone(), |(_, model)| model.clone());
        Ok((declaration.model.clone(), model))
    }

    pub(super) fn version_of(&self, object: &str) -> Result<String, Refusal> {
        let (name, _) = self.stored(object)?;
        match self.published.get(&name) {
            Some((version, _)) => Ok(version.clone()),
            None => self.kit.models.version(&name).map(|(version, _)| version).map_err(|message| Refusal { message, hint: None }),
        }
    }

    /// The recordings of runs in which one joint of an object was moved, and that joint.
    fn recordings(&self, object: &str, runs: &[RunHandle]) -> Result<(Vec<Log>, String), Stop> {
        let (mut logs, mut joint) = (Vec::new(), None);
        for run in runs {
            let Some(recorded) = self.runs.get(run.0) else { continue };
            if recorded.object != object {
                let hint = format!("give runs in which a skill moved '{object}'");
                return Err(Stop::Refused(Refusal {
                    message: format!("{run} moved '{}', not '{object}'", recorded.object),
                    hint: Some(hint),
                }));
            }
            let held = recorded.logs.as_ref().map_err(|why| Stop::Failed(unsuitable(format!("{run}: {why}"))))?;
            logs.extend(held.0.iter().map(|log| Log { source: format!("{run}, {}", log.source), ..log.clone() }));
            joint.get_or_insert_with(|| recorded.joint.clone());
        }
        let end = |log: &Log| log.joints.first().and_then(|j| Some((*j.position.time.first()?, *j.position.time.last()?)));
        for i in 1..logs.len() {
            logs[i].continues = end(&logs[i - 1]).zip(end(&logs[i])).is_some_and(|((_, a), (b, _))| (0.0..=PAUSE).contains(&(b - a)));
        }
        Ok((logs, joint.unwrap_or_default()))
    }

    pub(super) fn error_of(&self, object: &str, run: RunHandle) -> Result<Quantity, Stop> {
        let (_, model) = self.stored(object).map_err(Stop::Refused)?;
        let (logs, joint) = self.recordings(object, &[run])?;
        if logs.is_empty() {
            return Ok(quantity(&model, &joint, 0.0));
        }
        let errors =
            sagci_gap::prediction_error(&model, &logs, Options::default().window).map_err(|e| Stop::Failed(unsuitable(e.to_string())))?;
        let error = errors.get(&joint).copied().ok_or_else(|| Stop::Failed(unsuitable(format!("{run} does not tell of '{joint}'"))))?;
        Ok(quantity(&model, &joint, error))
    }

    /// Asks the workflow, tells the world's judge what it says, publishes what is to be published.
    pub(super) fn close_gap(&mut self, request: &GapRequest) -> Result<GapAnswer, Stop> {
        let (name, model) = self.stored(&request.object).map_err(Stop::Refused)?;
        let (train, joint) = self.recordings(&request.object, &request.runs)?;
        let (held_out, _) = self.recordings(&request.object, &request.held_out)?;
        let at = |value: f64| quantity(&model, &joint, value);
        if train.is_empty() {
            let notes = vec!["nothing has moved: there is nothing to compare".to_owned()];
            let zero = at(0.0);
            let (verdict, effects) = ("no_gap".to_owned(), Vec::new());
            return Ok(GapAnswer { verdict, effects, before: zero, refitted: zero, after: zero, noise_floor: zero, version: None, notes });
        }
        let clock = Instant::now();
        let (watcher, seed) = (self.kit.progress.clone(), self.options.seed);
        let progress = move |text: &str| watcher.event(seed, &Event::Searching { text });
        let options = Options { window: request.window, seed, progress: Some(&progress), baselines: false };
        let mut found = find(&model, &train, &held_out, &options).map_err(|e| Stop::Failed(unsuitable(e.to_string())))?;
        let effects: Vec<FoundEffect> = found.report.effects.iter().map(effect).collect();
        if let Phase::Live(live) = &mut self.phase {
            live.world.answer(&request.object, &effects.iter().map(named).collect::<Vec<_>>());
        }
        let version = if request.apply { self.publish(&name, &mut found, request.accept_unconfirmed)? } else { None };
        if let Some(out) = &self.options.out {
            let stem = format!("seed-{}.gap-{}", self.options.seed, self.gaps.len() + 1);
            let json = serde_json::to_string_pretty(&found.report).map_err(|e| Stop::Broken(format!("the gap's report: {e}")))?;
            for (file, text) in [(out.join(format!("{stem}.html")), page(&name, &found)), (out.join(format!("{stem}.json")), json)] {
                std::fs::write(&file, text).map_err(|e| Stop::Broken(format!("{}: {e}", file.display())))?;
            }
        }
        let gap = found.report.gap.held_out.as_ref().unwrap_or(&found.report.gap.train);
        let [before, refitted, after, noise_floor] = figures(gap, &joint);
        let verdict = serde_json::to_value(found.report.verdict).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default();
        let words = |e: &FoundEffect| EffectReport {
            name: e.name.clone(),
            alternatives: e.alternatives.clone(),
            joint: e.joint.clone(),
            parameters: e.parameters.clone(),
            confirmed: e.confirmed,
        };
        self.gaps.push(GapReport {
            object: request.object.clone(),
            joint: joint.clone(),
            verdict: verdict.clone(),
            effects: effects.iter().map(words).collect(),
            before,
            refitted,
            after,
            noise_floor,
            unit: if matches!(at(0.0), Quantity::Length(_)) { "m" } else { "rad" }.to_owned(),
            version: version.clone(),
            notes: found.report.notes.clone(),
            wall_seconds: clock.elapsed().as_secs_f64(),
        });
        let notes = found.report.notes;
        Ok(GapAnswer {
            verdict,
            effects,
            before: at(before),
            refitted: at(refitted),
            after: at(after),
            noise_floor: at(noise_floor),
            version,
            notes,
        })
    }

    /// Publishes what may be published; the run plans with it from then on. Says in the report what became of it.
    fn publish(&mut self, name: &str, found: &mut Found, accept_unconfirmed: bool) -> Result<Option<String>, Stop> {
        let doubted: Vec<&str> = found.report.effects.iter().filter(|e| !e.confirmed).map(|e| e.name.as_str()).collect();
        if found.report.effects.is_empty() {
            found.report.notes.push("nothing was named: no new version is published".to_owned());
            return Ok(None);
        }
        if !doubted.is_empty() && !accept_unconfirmed {
            let names = doubted.join(", ");
            let note = format!("held-out runs do not confirm {names}: not published; accept_unconfirmed: true publishes it all the same");
            found.report.notes.push(note);
        }
        let model = if accept_unconfirmed { Some(found.model.clone()) } else { found.confirmed() };
        let Some(model) = model else { return Ok(None) };
        let broken = |what: &str, e: &dyn std::fmt::Display| Stop::Broken(format!("{what}: {e}"));
        // The same runs and seed give the same bytes, and so the same version: how long it took is left out.
        found.report.seconds = 0.0;
        let json = serde_json::to_string_pretty(&found.report).map_err(|e| broken("the gap's report", &e))?;
        let evidence = [
            Evidence { name: REPORT_FILE.into(), bytes: (json + "\n").into_bytes() },
            Evidence { name: PAGE_FILE.into(), bytes: page(name, found).into_bytes() },
        ];
        let (version, model) = self.kit.models.publish(name, &model, &evidence).map_err(|e| broken("the library", &e))?;
        found.report.model.clone_from(&version);
        if let Phase::Live(live) = &mut self.phase {
            let declared = &self.declared;
            live.adopt(&model, &|object| declared.get(object).is_some_and(|(d, _)| d.model == name));
        }
        self.published.insert(name.to_owned(), (version.clone(), model));
        Ok(Some(version))
    }
}

impl Live {
    /// Believes from now on that objects are as another version of their model says.
    fn adopt(&mut self, model: &Arc<ObjectModel>, is_one: &dyn Fn(&str) -> bool) {
        for (thing, object) in self.things.iter_mut().zip(&mut self.belief.objects).filter(|(_, o)| is_one(&o.name)) {
            thing.model = model.clone();
            object.model.clone_from(&model.folder);
        }
    }
}

fn effect(e: &sagci_gap::report::NamedEffect) -> FoundEffect {
    FoundEffect {
        name: e.name.clone(),
        alternatives: e.alternatives.clone(),
        joint: e.joint.clone().unwrap_or_default(),
        parameters: e.parameters.iter().map(|(name, v)| (name.clone(), v.value)).collect(),
        confirmed: e.confirmed,
    }
}

fn named(e: &FoundEffect) -> NamedEffect {
    NamedEffect { name: e.name.clone(), alternatives: e.alternatives.clone(), joint: e.joint.clone() }
}

/// The joint's own figures: before, refitted, after, noise floor.
fn figures(gap: &Gap, joint: &str) -> [f64; 4] {
    gap.per_joint.get(joint).map_or([f64::NAN; 4], |g| [g.before, g.refitted, g.after, g.noise_floor])
}
