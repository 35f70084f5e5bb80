//! The plugin border in process: what a Rust skill says is what the host hears, and nothing that goes wrong crosses it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use nalgebra::{Isometry3, Matrix6, Vector3};
use sagci_signal::{Command, GripperCommand, ObjectBelief, Observation, SceneBelief};
use sagci_skill::{
    AbiError, Argument, BeliefChange, Execution, Failure, FailureCode, LogLevel, Manifest, ManifestError, Measure, Phase, Plan,
    PlanRequest, PlanSummary, Plugin, Skill, SkillTable, Status, StepInput, StepReply, abi, export_skill,
};

const YAML: &str = "
name: nudge
version: 0.1.0
abi: 1
summary: Nudges.
parameters:
- {name: amount, kind: amount, required: true, summary: How far.}
library: sagci_skill_nudge
entry: sagci_skill_nudge
";

#[derive(Default)]
struct Nudge;

struct Nudging(f64, bool);

impl Skill for Nudge {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        Manifest::from_yaml(YAML)
    }

    fn plan(&self, request: &PlanRequest, cancelled: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        sagci_skill::log(LogLevel::Info, "planning");
        let fail = |code, message: &str| Failure { code, stage: "argument".into(), message: message.into() };
        if cancelled() {
            return Err(fail(FailureCode::Cancelled, "the host wants no plan"));
        }
        let amount = match request.arguments.get("amount") {
            Some(Argument::Angle(a) | Argument::Length(a)) => *a,
            Some(Argument::Text(text)) => panic!("cannot nudge by '{text}'"),
            _ => return Err(fail(FailureCode::BadArgument, "amount is missing")),
        };
        let summary = PlanSummary {
            phases: vec![Phase { name: "push".into(), seconds: 1.0 }],
            predicted: vec![Measure { name: "amount".into(), value: amount, unit: "rad".into() }],
            after: vec![BeliefChange::Joint { object: "box".into(), joint: "lid".into(), position: amount }],
            q_after: request.q.clone(),
            postconditions: Vec::new(),
        };
        Ok(Plan { summary, execution: Box::new(Nudging(amount, false)) })
    }
}

impl Execution for Nudging {
    fn step(&mut self, input: &StepInput) -> StepReply {
        self.1 |= input.cancel;
        assert!(input.observation.time < 9.0, "the clock ran over");
        let status = if self.1 {
            let failure = Failure { code: FailureCode::Cancelled, stage: "push".into(), message: "stopped".into() };
            Status::Failed { failure, measured: Vec::new(), changes: Vec::new() }
        } else {
            Status::Running
        };
        let tau = input.observation.q.iter().map(|q| q * self.0).collect();
        StepReply { command: Command { tau, gripper: GripperCommand::default() }, phase: 0, progress: 0.5, status }
    }
}

#[derive(Default)]
struct Other;

impl Skill for Other {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        Ok(Manifest { name: "other".into(), ..Manifest::from_yaml(YAML)? })
    }

    fn plan(&self, _: &PlanRequest, _: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        Err(Failure { code: FailureCode::ModelLacks, stage: "path".into(), message: "nothing to do".into() })
    }
}

export_skill!(Nudge, sagci_skill_nudge);
export_skill!(Other, sagci_skill_other);

fn silent() -> sagci_skill::LogSink {
    Arc::new(|_, _| {})
}

fn plugin(entry: abi::Entry) -> Plugin {
    // SAFETY: the entries of this program answer tables of this program.
    unsafe { Plugin::from_raw(entry(), silent()).unwrap() }
}

fn request(argument: Argument) -> PlanRequest {
    let object = ObjectBelief {
        name: "box".into(),
        model: "somewhere/box".into(),
        X_WO: Isometry3::translation(0.1, 1.0 / 3.0, f64::MIN_POSITIVE),
        q: vec![0.1 + 0.2],
        covariance: Matrix6::identity() * 1e-300,
        X_TO: Some(Isometry3::rotation(Vector3::new(0.3, -0.2, 0.1))),
        seen: true,
    };
    let belief = SceneBelief {
        robot: "somewhere/arm".into(),
        X_WR: Isometry3::identity(),
        table_height: 0.0,
        gravity: Vector3::new(0.0, 0.0, -9.81),
        objects: vec![object],
    };
    PlanRequest {
        arguments: BTreeMap::from([("amount".to_owned(), argument)]),
        belief,
        q: vec![0.1, 0.2],
        gripper_width: 0.08,
        period: 1e-3,
        seed: u64::MAX,
    }
}

fn input(time: f64, cancel: bool) -> StepInput {
    StepInput { observation: Observation { time, q: vec![0.1, 1e-17], ..Default::default() }, belief: None, cancel }
}

#[test]
fn a_skill_behind_the_table_answers_bit_for_bit_what_it_answers_as_a_rust_type() {
    let request = request(Argument::Angle(0.7));
    let direct = Nudge.plan(&request, &|| false).unwrap();
    let through = plugin(sagci_skill_nudge).plan(&request, &|| false).unwrap();
    assert_eq!(direct.summary, through.summary);
    let (mut a, mut b) = (direct.execution, through.execution);
    for i in 0..20 {
        assert_eq!(a.step(&input(f64::from(i) * 1e-3, i > 15)), b.step(&input(f64::from(i) * 1e-3, i > 15)));
    }
    assert_eq!(Nudge.manifest().unwrap(), plugin(sagci_skill_nudge).manifest().unwrap());
}

#[test]
fn two_skills_linked_into_one_program_stay_two() {
    assert_eq!(plugin(sagci_skill_nudge).manifest().unwrap().name, "nudge");
    assert_eq!(plugin(sagci_skill_other).manifest().unwrap().name, "other");
}

#[test]
fn a_failure_keeps_its_code_and_stage() {
    let failure = plugin(sagci_skill_other).plan(&request(Argument::Angle(0.7)), &|| false).err().unwrap();
    assert_eq!((failure.code, failure.stage.as_str()), (FailureCode::ModelLacks, "path"));
}

#[test]
fn a_panic_while_planning_becomes_a_failure_that_says_what_happened() {
    let failure = plugin(sagci_skill_nudge).plan(&request(Argument::Text("much".into())), &|| false).err().unwrap();
    assert_eq!(failure.code, FailureCode::PluginFault);
    assert!(failure.message.contains("cannot nudge by 'much'"), "{}", failure.message);
}

#[test]
fn after_a_panic_in_a_step_the_plan_is_not_entered_again() {
    let mut execution = plugin(sagci_skill_nudge).plan(&request(Argument::Angle(0.7)), &|| false).unwrap().execution;
    for time in [9.5, 0.0] {
        let reply = execution.step(&input(time, false));
        let Status::Failed { failure, .. } = reply.status else { panic!("went on after a panic") };
        assert_eq!(failure.code, FailureCode::PluginFault);
    }
}

#[test]
fn planning_sees_the_hosts_cancel_token_and_a_running_plan_its_cancel() {
    let flag = AtomicBool::new(true);
    let failure = plugin(sagci_skill_nudge).plan(&request(Argument::Angle(0.7)), &|| flag.load(Ordering::Relaxed)).err().unwrap();
    assert_eq!(failure.code, FailureCode::Cancelled);
    let mut execution = plugin(sagci_skill_nudge).plan(&request(Argument::Angle(0.7)), &|| false).unwrap().execution;
    assert_eq!(execution.step(&input(0.0, false)).status, Status::Running);
    execution.cancel();
    assert!(matches!(execution.step(&input(0.001, false)).status, Status::Failed { .. }));
}

#[test]
fn what_a_skill_logs_reaches_the_host() {
    static TABLE: SkillTable = SkillTable::of::<Nudge>();
    let lines = Arc::new(Mutex::new(Vec::new()));
    let sink = {
        let lines = lines.clone();
        Arc::new(move |level, text: &str| lines.lock().unwrap().push((level, text.to_owned())))
    };
    let _plan = Plugin::in_process(&TABLE, sink).unwrap().plan(&request(Argument::Angle(0.7)), &|| false).unwrap();
    assert_eq!(*lines.lock().unwrap(), [(LogLevel::Info, "planning".to_owned())]);
}

#[test]
fn a_table_of_another_version_size_or_kind_is_refused_before_it_is_used() {
    // As many bytes as a table has, so that nothing is read past its end; only the header is filled.
    fn refused(header: abi::Header) -> AbiError {
        let room: &'static mut [u64; 32] = Box::leak(Box::new([0; 32]));
        let table = room.as_mut_ptr().cast::<abi::Header>();
        // SAFETY: the room is large and aligned enough for a header, and a refused table is read no further.
        unsafe {
            table.write(header);
            Plugin::from_raw(table.cast(), silent()).err().unwrap()
        }
    }
    let good = abi::Header { magic: abi::MAGIC, abi: abi::ABI, size: size_of::<SkillTable>() as u32, features: 0 };
    assert_eq!(refused(abi::Header { magic: 7, ..good }), AbiError::Magic);
    assert_eq!(refused(abi::Header { abi: abi::ABI + 1, ..good }), AbiError::Version { found: abi::ABI + 1 });
    assert_eq!(refused(abi::Header { size: good.size - 1, ..good }), AbiError::Size { found: good.size - 1 });
    assert_eq!(refused(abi::Header { features: 1 << 40, ..good }), AbiError::Features { unknown: 1 << 40 });
    // SAFETY: null is allowed.
    assert_eq!(unsafe { Plugin::from_raw(std::ptr::null(), silent()) }.err().unwrap(), AbiError::NoTable);
}

#[test]
fn a_manifest_that_cannot_become_a_script_function_is_refused() {
    for (from, to, field) in [
        ("name: nudge", "name: Nudge It", "name"),
        ("library: sagci_skill_nudge", "library: ../evil", "library"),
        ("- {name: amount", "- {name: amount, kind: amount, summary: x}\n- {name: amount", "parameters[1]"),
        ("- {name: amount", "- {name: first, kind: amount, summary: x}\n- {name: amount", "parameters[1]"),
    ] {
        match Manifest::from_yaml(&YAML.replace(from, to)) {
            Err(ManifestError::Impossible { field: found, .. }) => assert_eq!(found, field),
            other => panic!("{to}: {other:?}"),
        }
    }
    let misspelt = Manifest::from_yaml(&YAML.replace("summary: Nudges.", "sumary: Nudges."));
    assert!(matches!(misspelt, Err(ManifestError::Malformed { line: Some(_), .. })), "{misspelt:?}");
}
