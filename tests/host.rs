//! The host: a skill's word is held against sensors, a bad skill cannot harm the arm, and a run can always be stopped.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use nalgebra::Isometry3;
use sagci_control::ArmModel;
use sagci_script::host::progress::{Event, Progress, Silent};
use sagci_script::host::report::{Rate, RunReport, StepStatus};
use sagci_script::host::{Kit, RunError, RunOptions, run, run_many};
use sagci_script::plugins::SkillSet;
use sagci_signal::{Command, GripperCommand};
use sagci_skill::{
    BeliefChange, Failure, FailureCode, Measure, ParameterKind, Phase, Place, PlanRequest, PlanSummary, Postcondition, Status, StepInput,
    StepReply,
};
use sagci_tests::{FakeEyes, FakeWorlds, Scripted, ScriptedSkill, ToyModels, Truth, loaded, panda, write};

fn summary(request: &PlanRequest) -> PlanSummary {
    PlanSummary {
        phases: vec![Phase { name: "first".into(), seconds: 0.05 }, Phase { name: "second".into(), seconds: 0.05 }],
        predicted: vec![Measure { name: "lid_hinge".into(), value: 1.0, unit: "rad".into() }],
        after: Vec::new(),
        q_after: request.q.clone(),
        postconditions: Vec::new(),
    }
}

/// Carries the arm's own weight and damps it.
fn still(input: &StepInput, status: Status) -> StepReply {
    static ARM: OnceLock<ArmModel> = OnceLock::new();
    let mut arm = ARM.get_or_init(|| ArmModel::new(&panda(), Isometry3::identity()).unwrap()).clone();
    arm.observe(&input.observation).unwrap();
    let tau = arm.bias().iter().zip(&input.observation.v).map(|(bias, v)| bias - v).collect();
    StepReply { command: Command { tau, gripper: GripperCommand::default() }, phase: 0, progress: 0.5, status }
}

fn done(changes: Vec<BeliefChange>) -> Status {
    Status::Done { measured: vec![Measure { name: "lid_hinge".into(), value: 0.9, unit: "rad".into() }], changes }
}

fn nudge() -> Scripted {
    Scripted {
        name: "nudge",
        parameters: vec![("object", ParameterKind::Object, true), ("place", ParameterKind::Place, false)],
        plan: Arc::new(|request| Ok(summary(request))),
        step: Arc::new(|n, input| still(input, if n < 20 { Status::Running } else { done(Vec::new()) })),
    }
}

/// The chest stands a little off, its lid at half a radian; the cube is seen beside it.
fn truth() -> Truth {
    Arc::new(Mutex::new(vec![
        ("chest".into(), Isometry3::translation(0.62, 0.05, 0.0), vec![0.5, 0.0], true),
        ("cube".into(), Isometry3::translation(0.4, -0.3, 0.0), vec![], true),
    ]))
}

struct Bench {
    folder: tempfile::TempDir,
    kit: Kit,
    skill: Arc<ScriptedSkill>,
    truth: Truth,
}

impl Bench {
    fn new(scripted: Scripted) -> Self {
        let (skill, handle) = loaded(scripted);
        let truth = truth();
        let kit = Kit {
            skills: Arc::new(SkillSet { loaded: vec![skill], broken: vec![] }),
            models: Arc::new(ToyModels::new()),
            worlds: Some(Arc::new(FakeWorlds)),
            perceive: Arc::new(FakeEyes(truth.clone())),
            progress: Arc::new(Silent),
            cancel: Arc::new(AtomicBool::new(false)),
        };
        Self { folder: tempfile::tempdir().unwrap(), kit, skill: handle, truth }
    }

    fn script(&self, text: &str) -> PathBuf {
        let declared = "let chest = scene.expect(\"chest\", at(cm(60), cm(0)));
            let cube = scene.expect(\"cube\", at(cm(40), cm(-30)));";
        write(self.folder.path().join("task.rhai"), &format!("{declared}\n{text}"))
    }

    fn run(&self, text: &str) -> Result<RunReport, RunError> {
        run(&self.script(text), &self.kit, &RunOptions { seed: 7, out: None, asked: None })
    }
}

#[test]
fn a_skill_is_told_what_was_seen_and_not_what_was_declared() {
    let bench = Bench::new(nudge());
    let report = bench.run("nudge(chest);").unwrap();
    assert!(report.success, "{report:?}");
    let asked = bench.skill.asked.lock().unwrap();
    let chest = asked[0].belief.object("chest").unwrap();
    assert!(chest.seen);
    assert_eq!(chest.X_WO, truth().lock().unwrap()[0].1);
    assert_eq!(chest.q, [0.5, 0.0]);
}

#[test]
fn a_skills_word_is_not_success() {
    let conditions = |postconditions: Vec<Postcondition>| {
        let plan = move |request: &PlanRequest| Ok(PlanSummary { postconditions: postconditions.clone(), ..summary(request) });
        Scripted { plan: Arc::new(plan), ..nudge() }
    };
    let lid = |least, most| Postcondition::JointBetween { object: "chest".into(), joint: "lid_hinge".into(), least, most };
    let at = |x: f64| Postcondition::At { object: "cube".into(), place: Place::Table { at: [x, -0.3] } };
    let inside =
        Postcondition::At { object: "cube".into(), place: Place::Inside { object: "chest".into(), region: Some("corner".into()) } };
    for (condition, holds) in [
        (lid(0.4, 0.6), true),
        (lid(0.9, 1.1), false),
        (at(0.41), true),
        (at(0.5), false),
        (inside, false),
        // Its gripper never closed on anything.
        (Postcondition::Holding { object: "cube".into() }, false),
    ] {
        let report = Bench::new(conditions(vec![condition.clone()])).run("nudge(chest);").unwrap();
        assert_eq!(report.success, holds, "{condition:?}: {report:?}");
        let step = &report.steps[0];
        assert_eq!(step.checks[0].holds, Some(holds));
        if !holds {
            assert_eq!((step.status, step.code.as_deref()), (StepStatus::Failed, Some("postcondition_failed")));
            assert_eq!(report.failure.unwrap().code, "postcondition_failed");
        }
    }
    // The camera's figure takes the place of the skill's own, and the gap is told.
    let report = Bench::new(conditions(vec![lid(0.4, 0.6)])).run("nudge(chest);").unwrap();
    assert_eq!(report.steps[0].measured["lid_hinge"].value, 0.5);
    assert_eq!(report.steps[0].gap["lid_hinge"].value, -0.5);
}

#[test]
fn what_the_camera_cannot_see_is_said_to_be_unknown_and_not_said_to_be_true() {
    let lid = Postcondition::JointBetween { object: "chest".into(), joint: "lid_hinge".into(), least: 0.4, most: 0.6 };
    let scripted =
        Scripted { plan: Arc::new(move |request| Ok(PlanSummary { postconditions: vec![lid.clone()], ..summary(request) })), ..nudge() };
    let mut bench = Bench::new(scripted);
    let truth = bench.truth.clone();
    /// Hides the chest once the skill is under way.
    struct Hide(Truth);
    impl Progress for Hide {
        fn event(&self, _: u64, event: &Event<'_>) {
            if matches!(event, Event::Phase { .. }) {
                self.0.lock().unwrap()[0].3 = false;
            }
        }
    }
    bench.kit.progress = Arc::new(Hide(truth));
    let report = bench.run("nudge(chest);").unwrap();
    assert_eq!(report.steps[0].checks[0].holds, None);
}

#[test]
fn an_object_that_is_not_seen_is_not_handled() {
    let bench = Bench::new(nudge());
    bench.truth.lock().unwrap()[1].3 = false;
    let report = bench.run("nudge(chest); nudge(cube);").unwrap();
    assert_eq!(report.steps.iter().map(|s| s.status).collect::<Vec<_>>(), [StepStatus::Done, StepStatus::Failed]);
    assert_eq!(report.steps[1].code.as_deref(), Some("not_seen"));
    assert_eq!(bench.skill.asked.lock().unwrap().len(), 1, "it was planned for an object that nobody has seen");
}

#[test]
fn a_skill_that_breaks_its_contract_fails_and_the_arm_comes_to_rest() {
    let short: fn(usize, &StepInput) -> StepReply = |_, input| {
        let mut reply = still(input, Status::Running);
        reply.command.tau.pop();
        reply
    };
    let not_finite: fn(usize, &StepInput) -> StepReply = |n, input| {
        let mut reply = still(input, Status::Running);
        if n == 30 {
            reply.command.tau[2] = f64::NAN;
        }
        reply
    };
    for step in [short, not_finite] {
        let report = Bench::new(Scripted { step: Arc::new(step), ..nudge() }).run("nudge(chest);").unwrap();
        assert_eq!(report.steps[0].code.as_deref(), Some("plugin_fault"), "{report:?}");
        assert!(!report.success);
    }
}

#[test]
fn a_skill_that_never_ends_is_stopped_also_if_it_does_not_listen() {
    let deaf = Scripted { step: Arc::new(|_, input| still(input, Status::Running)), ..nudge() };
    let report = Bench::new(deaf).run("nudge(chest);").unwrap();
    assert_eq!(report.steps[0].code.as_deref(), Some("timed_out"), "{report:?}");
    // Three times the planned 0.1 s, the grace of 30 s, and 3 s to stop.
    assert!(report.steps[0].seconds < 36.0);
}

#[test]
fn a_stop_in_mid_run_reaches_the_skill_and_closes_the_run() {
    let heard = Arc::new(AtomicBool::new(false));
    let mut scripted = nudge();
    let ear = heard.clone();
    scripted.step = Arc::new(move |_, input| {
        if input.cancel {
            ear.store(true, Ordering::Relaxed);
            let failure = Failure { code: FailureCode::Cancelled, stage: "first".into(), message: "stopped".into() };
            return still(input, Status::Failed { failure, measured: vec![], changes: vec![] });
        }
        still(input, Status::Running)
    });
    let mut bench = Bench::new(scripted);
    struct StopAt(Arc<AtomicBool>);
    impl Progress for StopAt {
        fn event(&self, _: u64, event: &Event<'_>) {
            if matches!(event, Event::Phase { .. }) {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    bench.kit.progress = Arc::new(StopAt(bench.kit.cancel.clone()));
    let report = bench.run("try { nudge(chest) } catch (e) { } nudge(chest);").unwrap();
    assert!(heard.load(Ordering::Relaxed));
    assert_eq!(report.failure.unwrap().code, "interrupted");
    assert_eq!(report.steps.len(), 1, "the script went on after it was stopped");
    assert!(!report.success);
}

#[test]
fn a_skill_that_asks_to_look_is_given_what_is_seen_then() {
    let seen = Arc::new(Mutex::new(Vec::new()));
    let (mut scripted, notes) = (nudge(), seen.clone());
    scripted.step = Arc::new(move |n, input| {
        if let Some(belief) = &input.belief {
            notes.lock().unwrap().push((n, belief.object("chest").unwrap().q[0]));
        }
        let status = match n {
            5 => Status::Look { objects: vec!["chest".into()] },
            0..20 => Status::Running,
            _ => done(Vec::new()),
        };
        still(input, status)
    });
    assert!(Bench::new(scripted).run("nudge(chest);").unwrap().success);
    assert_eq!(*seen.lock().unwrap(), [(6, 0.5)]);
}

#[test]
fn a_failure_names_its_stage_and_a_script_may_go_on_after_it() {
    let mut scripted = nudge();
    scripted.plan = Arc::new(|_| Err(Failure { code: FailureCode::Unreachable, stage: "reach".into(), message: "too far".into() }));
    let bench = Bench::new(scripted);
    let report = bench.run("nudge(chest);").unwrap();
    let failure = report.failure.unwrap();
    assert_eq!((failure.code.as_str(), failure.stage.as_str()), ("unreachable", "reach"));
    assert!(failure.message.contains("task.rhai:3:1"), "{}", failure.message);
    let report = bench.run("try { nudge(chest) } catch (e) { print(e.stage) }").unwrap();
    assert!(report.success);
    assert_eq!(report.steps[0].status, StepStatus::Failed);
}

#[test]
fn a_script_that_is_wrong_moves_nothing() {
    let bench = Bench::new(nudge());
    for text in ["nugde(chest);", "nudge(chest); let x = ;", "nudge(chest); let d = scene.expect(\"cube\", at(cm(1), cm(1)), \"late\");"] {
        assert!(matches!(bench.run(text), Err(RunError::Script(_))), "{text}");
    }
    assert!(bench.skill.asked.lock().unwrap().len() <= 1);
}

#[test]
fn a_plan_only_run_carries_what_is_predicted_from_step_to_step() {
    let mut scripted = nudge();
    scripted.plan = Arc::new(|request| {
        let after = vec![BeliefChange::Joint { object: "chest".into(), joint: "tray_slide".into(), position: 0.2 }];
        Ok(PlanSummary { after, q_after: request.q.iter().map(|q| q + 0.1).collect(), ..summary(request) })
    });
    scripted.step = Arc::new(|_, _| panic!("something moved"));
    let mut bench = Bench::new(scripted);
    bench.kit.worlds = None;
    let script = write(
        bench.folder.path().join("task.rhai"),
        "let chest = scene.expect(\"chest\", at(cm(60), cm(0)));
         let cube = scene.expect(\"cube\", inside(chest, \"tray\"));
         nudge(chest); nudge(cube);",
    );
    let report = run(&script, &bench.kit, &RunOptions::default()).unwrap();
    assert!(report.success && report.steps.iter().all(|s| s.status == StepStatus::Planned), "{report:?}");
    let asked = bench.skill.asked.lock().unwrap();
    assert_eq!(asked[1].belief.object("chest").unwrap().q[1], 0.2);
    assert!((asked[1].q[0] - asked[0].q[0] - 0.1).abs() < 1e-12);
    // The cube stands in the tray and rides with it.
    let shift =
        asked[1].belief.object("cube").unwrap().X_WO.translation.vector - asked[0].belief.object("cube").unwrap().X_WO.translation.vector;
    assert!((shift - nalgebra::Vector3::new(0.0, -0.2, 0.0)).norm() < 1e-9, "{shift}");
}

#[test]
fn runs_over_several_cores_give_the_same_reports_as_runs_one_by_one() {
    let bench = Bench::new(nudge());
    let script = bench.script("nudge(chest); nudge(cube);");
    let reports = |threads| {
        let reports = run_many(&script, &bench.kit, &RunOptions { seed: 3, out: None, asked: None }, 4, threads);
        reports
            .into_iter()
            .map(|r| {
                let mut r = r.unwrap();
                r.wall_seconds = 0.0;
                r.steps.iter_mut().for_each(|s| (s.wall_seconds, s.plan_wall_seconds) = (0.0, 0.0));
                r
            })
            .collect::<Vec<_>>()
    };
    let one_by_one = reports(1);
    assert_eq!(one_by_one.iter().map(|r| r.seed).collect::<Vec<_>>(), [3, 4, 5, 6]);
    assert_eq!(one_by_one, reports(3));
    let seeds: Vec<u64> = bench.skill.asked.lock().unwrap().iter().map(|a| a.seed).collect();
    let mut distinct = seeds.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), seeds.len() / 2, "two calls had the same random numbers");
}

#[test]
fn the_interval_of_a_rate_is_wilsons() {
    // Values from Brown, Cai and DasGupta 2001, formula (4), worked out with 40 digits.
    let rate = Rate::of(17, 20);
    assert!((rate.interval[0] - 0.639_58).abs() < 1e-4 && (rate.interval[1] - 0.947_62).abs() < 1e-4, "{rate:?}");
    assert_eq!(Rate::of(0, 0).interval, [0.0, 1.0]);
    assert_eq!(Rate::of(20, 20).interval[1], 1.0);
}

#[test]
fn goals_that_speak_of_what_is_not_there_are_found_before_anything_moves() {
    let bench = Bench::new(nudge());
    write(bench.folder.path().join("task.check.yaml"), "goals:\n  - untouched: {object: lamp}\n");
    let Err(RunError::Script(problems)) = bench.run("nudge(chest);") else { panic!() };
    assert!(problems[0].to_string().contains("lamp"), "{problems:?}");
    assert!(bench.skill.asked.lock().unwrap().is_empty());
    let _: &Path = bench.folder.path();
}
