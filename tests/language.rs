//! The language of task scripts: what it accepts, what it finds wrong before anything moves, and what it cannot be made to do.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use sagci_script::Diagnostic;
use sagci_script::language::check::check;
use sagci_script::language::engine::Surroundings;
use sagci_script::language::execute::{End, execute};
use sagci_script::language::stage::{
    AskedExperiment, Declaration, DeclaredPlace, FoundEffect, GapAnswer, GapRequest, Outcome, Quantity, Refusal, Stage, Stop,
};
use sagci_script::language::value::{Angle, Length, RunHandle};
use sagci_script::plugins::{BrokenSkill, LoadedSkill, SkillSet};
use sagci_skill::{Argument, Failure, FailureCode, Measure, ParameterKind, Place};
use sagci_tests::{Scripted, ToyModels, loaded, write};

/// Keeps what a script does, and answers as a test wants.
struct Recorder {
    declared: Vec<Declaration>,
    unknown: Vec<Declaration>,
    learned: Vec<String>,
    calls: Vec<(String, BTreeMap<String, Argument>)>,
    said: Vec<String>,
    fail: Option<Failure>,
    cancel_on_call: Option<Arc<AtomicBool>>,
    hidden: Vec<(String, Option<String>)>,
    asked: Vec<GapRequest>,
    experiment: Option<AskedExperiment>,
}

impl Stage for Recorder {
    fn expect(&mut self, declaration: Declaration) -> Result<(), Refusal> {
        self.declared.push(declaration);
        Ok(())
    }

    fn unknown(&mut self, declaration: Declaration) -> Result<(), Refusal> {
        self.unknown.push(declaration);
        Ok(())
    }

    fn learn(&mut self, name: &str) -> Result<(), Stop> {
        self.learned.push(name.to_owned());
        self.fail.clone().map_or(Ok(()), |failure| Err(Stop::Failed(failure)))
    }

    fn robot(&mut self, _: &str) -> Result<(), Refusal> {
        Ok(())
    }

    fn call(&mut self, skill: &LoadedSkill, arguments: BTreeMap<String, Argument>) -> Result<Outcome, Stop> {
        self.calls.push((skill.manifest.name.clone(), arguments));
        if let Some(cancel) = &self.cancel_on_call {
            cancel.store(true, Ordering::Relaxed);
            return Err(Stop::Interrupted);
        }
        if let Some(failure) = &self.fail {
            return Err(Stop::Failed(failure.clone()));
        }
        let measured = vec![Measure { name: "lid".into(), value: 0.5, unit: "rad".into() }];
        Ok(Outcome { seconds: 2.0, measured })
    }

    fn position(&mut self, _: &str, joint: Option<&str>) -> Result<Quantity, Refusal> {
        Ok(if joint == Some("tray_slide") { Quantity::Length(Length(0.1)) } else { Quantity::Angle(Angle(0.25)) })
    }

    fn hide(&mut self, object: &str, joint: Option<&str>) -> Result<(), Refusal> {
        self.hidden.push((object.to_owned(), joint.map(str::to_owned)));
        Ok(())
    }

    fn last_run(&mut self) -> Result<RunHandle, Refusal> {
        let message = "no skill has moved a joint yet".to_owned();
        self.calls.len().checked_sub(1).map(RunHandle).ok_or(Refusal { message, hint: None })
    }

    fn gap(&mut self, request: &GapRequest) -> Result<GapAnswer, Stop> {
        self.asked.push(request.clone());
        if let Some(failure) = &self.fail {
            return Err(Stop::Failed(failure.clone()));
        }
        let effect = FoundEffect {
            name: "joint_spring".into(),
            alternatives: vec!["hinge_tilt".into()],
            joint: "lid_hinge".into(),
            parameters: [("stiffness".to_owned(), 2.5)].into(),
            confirmed: true,
        };
        Ok(GapAnswer {
            verdict: "ambiguous".into(),
            effects: vec![effect],
            before: Quantity::Angle(Angle(0.5)),
            refitted: Quantity::Angle(Angle(0.4)),
            after: Quantity::Angle(Angle(0.05)),
            noise_floor: Quantity::Angle(Angle(0.01)),
            version: request.apply.then(|| "abc".into()),
            notes: vec![],
        })
    }

    fn asked(&self) -> Option<AskedExperiment> {
        self.experiment.clone()
    }

    fn prediction_error(&mut self, _: &str, run: RunHandle) -> Result<Quantity, Stop> {
        Ok(Quantity::Angle(Angle(0.1 / (run.0 + 1) as f64)))
    }

    fn version(&mut self, _: &str) -> Result<String, Refusal> {
        Ok("abc".into())
    }

    fn say(&mut self, text: &str) {
        self.said.push(text.to_owned());
    }
}

fn skills() -> SkillSet {
    let make = |name, parameters: Vec<(&'static str, ParameterKind, bool)>| {
        loaded(Scripted { name, parameters, plan: Arc::new(|_| panic!("nothing is planned here")), step: Arc::new(|_, _| panic!()) }).0
    };
    SkillSet {
        loaded: vec![
            make(
                "nudge",
                vec![
                    ("object", ParameterKind::Object, true),
                    ("by", ParameterKind::Amount, false),
                    ("softly", ParameterKind::Truth, false),
                ],
            ),
            make("put", vec![("object", ParameterKind::Object, true), ("place", ParameterKind::Place, true)]),
        ],
        broken: vec![BrokenSkill {
            name: Some("wipe".into()),
            file: "wipe/skill.yaml".into(),
            message: "is broken".into(),
            hint: "mend it".into(),
        }],
    }
}

struct Ran {
    end: End,
    stage: Recorder,
}

fn run_with(text: &str, prepare: impl FnOnce(&mut Recorder, &Arc<AtomicBool>, &Path)) -> Ran {
    let folder = tempfile::tempdir().unwrap();
    let script = write(folder.path().join("task.rhai"), text);
    let cancel = Arc::new(AtomicBool::new(false));
    let mut recorder = Recorder {
        declared: vec![],
        unknown: vec![],
        learned: vec![],
        calls: vec![],
        said: vec![],
        fail: None,
        cancel_on_call: None,
        hidden: vec![],
        asked: vec![],
        experiment: None,
    };
    prepare(&mut recorder, &cancel, folder.path());
    let stage = Rc::new(RefCell::new(recorder));
    let end = execute(&script, Surroundings { skills: skills().loaded, stage: stage.clone(), cancel });
    Ran { end, stage: Rc::into_inner(stage).unwrap().into_inner() }
}

fn run(text: &str) -> Ran {
    run_with(text, |_, _, _| {})
}

fn problems(text: &str) -> Vec<Diagnostic> {
    let folder = tempfile::tempdir().unwrap();
    let script = write(folder.path().join("task.rhai"), text);
    check(&script, &skills(), &ToyModels::new())
}

/// The only problem of a script, as `line:column: message; hint`.
fn problem(text: &str) -> String {
    let found = problems(text);
    assert_eq!(found.len(), 1, "{text}: {found:?}");
    let said = found[0].to_string();
    said.split_once("task.rhai:").unwrap().1.to_owned()
}

const CHEST: &str = "let chest = scene.expect(\"chest\", at(cm(50), cm(10)));\n";

#[test]
fn what_a_script_says_reaches_the_stage_in_si_units() {
    let ran = run("
        let chest = scene.expect(\"chest\", at(cm(80), mm(-100)), facing(deg(-90)), #{lid_hinge: deg(10), tray_slide: cm(5)});
        let cube = scene.expect(\"cube\", inside(chest, \"tray\"), \"first\");
        nudge(chest.joint(\"lid_hinge\"), rad(1) + deg(90) / 2);
        put(cube, inside(chest));
        put(cube, at(m(0.4), cm(-40)));
    ");
    assert_eq!(ran.end, End::Done);
    let [chest, cube] = ran.stage.declared.as_slice() else { panic!() };
    assert_eq!((chest.name.as_str(), cube.name.as_str(), cube.model.as_str()), ("chest", "first", "cube"));
    let DeclaredPlace::Table { at, facing } = chest.place else { panic!() };
    assert!((at.xy[0] - 0.8).abs() < 1e-12 && (at.xy[1] + 0.1).abs() < 1e-12 && at.z.is_none());
    assert!((facing.0 + std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    assert_eq!(chest.joints.len(), 2);
    let calls = &ran.stage.calls;
    assert_eq!(calls[0].1["object"], Argument::Object { name: "chest".into(), joint: Some("lid_hinge".into()) });
    let Argument::Angle(angle) = calls[0].1["by"] else { panic!() };
    assert!((angle - (1.0 + std::f64::consts::FRAC_PI_4)).abs() < 1e-12);
    assert_eq!(calls[1].1["place"], Argument::Place(Place::Inside { object: "chest".into(), region: None }));
    assert_eq!(calls[2].1["place"], Argument::Place(Place::Table { at: [0.4, -0.4] }));
}

#[test]
fn arguments_by_name_are_the_same_as_arguments_by_place() {
    let ran = run(&format!(
        "{CHEST} nudge(chest, cm(3), true); nudge(chest, #{{softly: true, by: cm(3)}}); nudge(chest, cm(3), #{{softly: true}});"
    ));
    assert_eq!(ran.end, End::Done);
    assert!(ran.stage.calls.windows(2).all(|w| w[0] == w[1]), "{:?}", ran.stage.calls);
}

#[test]
fn a_bare_number_is_never_taken_for_an_angle_or_a_length() {
    assert_eq!(
        problem(&format!("{CHEST}nudge(chest, 90);")),
        "2:14: nudge: 'by' is a bare number, and must be an angle or a length; write deg(90) for an angle or cm(5) for a length"
    );
    assert!(problem("let x = at(40, cm(1));").contains("needs a length, and is given a bare number"));
    assert!(problem("let x = facing(90);").contains("write facing(deg(90))"));
    assert!(problem("let x = deg(cm(1));").contains("makes an angle of a bare number"));
    assert!(problem(&format!("{CHEST}let y = 2 * 45; nudge(chest, y);")).contains("'by' is a bare number"));
    // Where the check cannot know, the run finds it.
    let ran = run(&format!("{CHEST}fn amount() {{ 90 }}\n nudge(chest, amount());"));
    let End::Wrong(wrong) = ran.end else { panic!("{:?}", ran.end) };
    assert_eq!(wrong.place, Some((3, 2)));
    assert!(wrong.to_string().contains("write deg(90) for an angle"), "{wrong}");
    assert!(ran.stage.calls.is_empty());
    assert!(matches!(run("let x = deg(90) + cm(3);").end, End::Wrong(_)));
    for compared in ["deg(90) < 3", "3.5 >= cm(2)", "deg(1) == cm(1)", "cm(1) != 1"] {
        let End::Wrong(wrong) = run(&format!("let x = {compared};")).end else { panic!("{compared}") };
        assert!(wrong.to_string().contains("cannot be compared"), "{wrong}");
    }
    assert_eq!(run("if deg(1) < deg(2) && cm(1) == mm(10) && deg(3) > -deg(3) { } else { throw 1 }").end, End::Done);
}

#[test]
fn what_is_misspelt_is_found_before_anything_moves_with_its_place_and_what_was_meant() {
    for (line, said) in [
        ("nugde(chest);", "2:1: there is no function or skill 'nugde'; did you mean 'nudge'?"),
        ("nudge(chset);", "2:7: 'chset' is not defined; did you mean 'chest'?"),
        ("nudge(chest, #{bye: cm(1)});", "2:16: nudge has no argument 'bye'; did you mean 'by'?"),
        ("put(chest, inside(chest, \"tary\"));", "2:26: the model 'chest' has no region 'tary'; did you mean 'tray'?"),
        ("nudge(chest.joint(\"lid_hing\"));", "2:19: the model 'chest' has no moving joint 'lid_hing'; did you mean 'lid_hinge'?"),
        ("let c = scene.expect(\"cub\", at(cm(1), cm(1)));", "2:22: the library has no model 'cub'; did you mean 'cube'?"),
        ("let c = scene.expct(\"cube\", at(cm(1), cm(1)));", "2:15: there is no function or skill 'expct'; did you mean 'expect'?"),
        ("let p = chest.positon;", "2:15: an object has no property 'positon'; did you mean 'position'?"),
        ("if true { put(chest, at(cm(1), cm(2)), 3) }", "2:40: put takes at most 2 arguments, and 3 are given; write put(object, place)"),
        ("nudge();", "2:1: nudge needs 'object' (an object); write nudge(object, [by], [softly])"),
        ("nudge(chest, cm(1), #{by: cm(2)});", "2:23: nudge: 'by' is given twice"),
        ("wipe(chest);", "2:1: the skill 'wipe' was found but cannot be used: wipe/skill.yaml: is broken (mend it)"),
        (
            "let d = scene.expect(\"chest\", at(cm(1), cm(1)));",
            "2:15: there is already a 'chest' in the scene; name one of them: scene.expect(\"chest\", ..., \"second_chest\")",
        ),
        (
            "let d = scene.expect(\"cube\", at(cm(1), cm(1)), #{lid: deg(1)});",
            "2:50: the model 'cube' has no moving joint 'lid'; there are no its joints",
        ),
    ] {
        let found = problem(&format!("{CHEST}{line}"));
        if line.contains("#{lid:") {
            assert!(found.contains("has no moving joint 'lid'"), "{found}");
        } else {
            assert_eq!(found, said, "{line}");
        }
    }
}

#[test]
fn the_check_looks_into_every_corner_of_a_script() {
    for text in [
        "fn f(x) { nugde(x) }",
        "let f = |x| nugde(x);",
        "if 1 < 2 { } else { nugde(1) }",
        "for i in 0..3 { nugde(i) }",
        "while true { nugde(1) }",
        "do { nugde(1) } while false;",
        "switch 1 { 1 => nugde(1), _ => () }",
        "try { nugde(1) } catch (e) { }",
        "try { } catch (e) { nugde(e) }",
        "let x = [1, nugde(1)];",
        "let x = #{a: nugde(1)};",
        "let x = `${nugde(1)}`;",
        "let x = true && nugde(1);",
        "let x = { nugde(1) };",
        "return nugde(1);",
        "throw nugde(1);",
    ] {
        let found = problems(text);
        assert!(found.iter().any(|p| p.message.contains("nugde")), "{text}: {found:?}");
    }
}

#[test]
fn a_sound_script_has_no_problems() {
    let text = format!(
        "{CHEST}import \"moves\" as moves;
        let cube = scene.expect(\"cube\", inside(chest));
        const FAR = deg(100);
        fn twice(thing, angle) {{ nudge(thing, angle); nudge(thing, angle * 2) }}
        let amounts = [deg(1), deg(2)];
        for a in amounts {{ nudge(chest, a); }}
        twice(chest, deg(5));
        moves::lift(cube);
        let r = nudge(chest, FAR - deg(1), #{{softly: 1 < 2}});
        print(`it took ${{r.seconds}} s, ${{r.measured.lid}}`);
        if chest.joint(\"lid_hinge\").position < deg(20) {{ print(\"shut\") }}
        try {{ put(cube, inside(chest, \"corner\")) }} catch (e) {{ if e.code == \"grasp_lost\" {{ put(cube, at(cm(1), cm(2))) }} else {{ throw e }} }}
        let f = |x| nudge(x);
        f.call(chest);
        chest.nudge(cm(1));"
    );
    let folder = tempfile::tempdir().unwrap();
    write(folder.path().join("moves.rhai"), "fn lift(thing) { nudge(thing, cm(10)); }");
    let script = write(folder.path().join("task.rhai"), &text);
    assert_eq!(check(&script, &skills(), &ToyModels::new()), []);
    let ran = run_with(&text, |_, _, folder| drop(write(folder.join("moves.rhai"), "fn lift(thing) { nudge(thing, cm(10)); }")));
    assert_eq!(ran.end, End::Done, "{:?}", ran.stage.said);
    assert_eq!(ran.stage.calls.len(), 9);
    assert_eq!(ran.stage.said, ["it took 2.0 s, 28.65 deg", "shut"]);
}

#[test]
fn checking_a_script_calls_nothing_even_with_constant_arguments() {
    // The planners of these skills panic; compiling at any optimisation level but none would call them.
    assert_eq!(problems(&format!("{CHEST}nudge(chest, deg(1));")), []);
}

#[test]
fn a_modules_mistakes_are_reported_in_the_modules_own_file() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path().join("lib/moves.rhai"), "fn lift(thing) {\n  nugde(thing)\n}");
    let script = write(folder.path().join("task.rhai"), "import \"lib/moves\" as moves;\nmoves::lft(1);");
    let found: Vec<String> = check(&script, &skills(), &ToyModels::new()).iter().map(ToString::to_string).collect();
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].contains("moves.rhai:2:3: there is no function or skill 'nugde'"), "{found:?}");
    assert!(found[1].ends_with("task.rhai:2:8: the module 'moves' has no function 'lft'; did you mean 'lift'?"), "{found:?}");
}

#[test]
fn modules_come_from_the_scripts_folder_and_from_nowhere_else() {
    let outside = tempfile::tempdir().unwrap();
    let stranger = write(outside.path().join("stranger.rhai"), "fn f() { 1 }");
    for path in ["../stranger", stranger.with_extension("").to_str().unwrap(), "", "linked", "missing"] {
        let text = format!("import {path:?} as s;");
        let ran = run_with(&text, |_, _, folder| {
            #[cfg(unix)]
            std::os::unix::fs::symlink(&stranger, folder.join("linked.rhai")).unwrap();
        });
        assert!(matches!(ran.end, End::Wrong(_)), "{path}: {:?}", ran.end);
        if path != "linked" {
            assert_eq!(problems(&text).len(), 1, "{path}");
        }
    }
    let ran = run_with("import \"ring\" as r;", |_, _, folder| drop(write(folder.join("ring.rhai"), "import \"ring\" as r;")));
    let End::Wrong(wrong) = ran.end else { panic!() };
    assert!(wrong.message.contains("imports itself"), "{wrong}");
}

#[test]
fn a_script_cannot_run_for_ever_or_reach_for_time_or_eval() {
    let End::Wrong(wrong) = run("loop { }").end else { panic!() };
    assert!(wrong.message.contains("too many steps"), "{wrong}");
    assert!(matches!(run("fn f(n) { f(n + 1) } f(0);").end, End::Wrong(_)));
    assert!(matches!(run("let s = \"x\"; loop { s += s; }").end, End::Wrong(_)));
    assert!(matches!(run("let a = []; loop { a.push(1); }").end, End::Wrong(_)));
    assert!(matches!(run("eval(\"1\");").end, End::Wrong(_)));
    assert!(matches!(run("let t = timestamp();").end, End::Wrong(_)));
    let before = std::time::Instant::now();
    assert!(matches!(run("sleep(100);").end, End::Failed { .. } | End::Wrong(_)));
    assert!(before.elapsed().as_secs() < 50);
    assert_eq!(problems("eval(\"1\");").len(), 1);
}

#[test]
fn a_failure_can_be_caught_by_its_code_and_otherwise_ends_the_script_with_its_place() {
    let failure = Failure { code: FailureCode::GraspLost, stage: "lift".into(), message: "it slipped".into() };
    let text = format!("{CHEST}try {{ nudge(chest) }} catch (e) {{ print(`${{e.skill}} ${{e.code}} ${{e.stage}} ${{e.message}}`) }}");
    let ran = run_with(&text, |stage, _, _| stage.fail = Some(failure.clone()));
    assert_eq!((ran.end, ran.stage.said), (End::Done, vec!["nudge grasp_lost lift it slipped".to_owned()]));
    let ran = run_with(&format!("{CHEST}\n  nudge(chest);\nnudge(chest);"), |stage, _, _| stage.fail = Some(failure.clone()));
    let End::Failed { code, stage, diagnostic } = ran.end else { panic!("{:?}", ran.end) };
    assert_eq!((code.as_str(), stage.as_str(), diagnostic.place), ("grasp_lost", "lift", Some((3, 3))));
    assert_eq!(ran.stage.calls.len(), 1, "the script went on after a failure that nobody caught");
    let End::Failed { code, .. } = run("throw \"no\";").end else { panic!() };
    assert_eq!(code, "thrown");
}

#[test]
fn nothing_in_a_script_can_hold_up_a_stop() {
    let text = format!("{CHEST}loop {{ try {{ nudge(chest) }} catch (e) {{ }} }}");
    let ran = run_with(&text, |stage, cancel, _| stage.cancel_on_call = Some(cancel.clone()));
    assert_eq!(ran.end, End::Interrupted);
    assert_eq!(ran.stage.calls.len(), 1);
    let ran = run_with("loop { }", |_, cancel, _| cancel.store(true, Ordering::Relaxed));
    assert_eq!(ran.end, End::Interrupted);
}

#[test]
fn no_script_gives_a_skill_or_the_scene_another_meaning() {
    assert!(problems("let scene = 1;").iter().any(|p| p.message.contains("already means the scene")));
    assert!(problems("fn nudge(x) { x }").iter().any(|p| p.message.contains("already the name of a skill")));
}

#[test]
fn what_is_no_script_at_all_is_said_so_with_its_place() {
    assert!(problem("let x = ;").starts_with("1:9: "));
    let missing = check(Path::new("/nowhere/task.rhai"), &skills(), &ToyModels::new());
    assert_eq!(missing.len(), 1);
    assert!(missing[0].to_string().starts_with("/nowhere/task.rhai: cannot be read"), "{}", missing[0]);
    assert_eq!(problems("\u{0}\u{1}(((").len(), 1);
}

#[test]
fn a_script_learns_an_object_by_a_name_and_hears_nothing_of_what_is_unknown() {
    let ran = run_with("scene.unknown(\"chest\", at(cm(60), cm(0)));\nlet mine = scene.learn(\"mine\");\nprint(mine.name);", |_, _, _| {});
    assert!(matches!(ran.end, End::Done), "{:?}", ran.end);
    assert_eq!(ran.stage.learned, ["mine"]);
    assert_eq!(ran.stage.unknown[0].model, "chest");
    assert!(ran.stage.declared.is_empty(), "what is unknown was declared");
    assert_eq!(ran.stage.said, ["mine"]);
}

#[test]
fn a_script_may_catch_that_there_is_nothing_to_learn() {
    let text = "try { scene.learn(\"mine\"); } catch (e) { print(e.code); }";
    let none = |r: &mut Recorder, _: &Arc<AtomicBool>, _: &Path| {
        r.fail = Some(Failure { code: FailureCode::NotSeen, stage: "learn".into(), message: "nothing new is seen".into() });
    };
    let ran = run_with(text, none);
    assert!(matches!(ran.end, End::Done), "{:?}", ran.end);
    assert_eq!(ran.stage.said, ["not_seen"]);
}

#[test]
fn a_script_learns_what_a_model_lacks_and_never_what_is_hidden() {
    let text = format!(
        "{CHEST}scene.hidden_effect(chest.joint(\"lid_hinge\"));
        nudge(chest);
        let first = last_run();
        nudge(chest);
        let found = gap(chest, [first, last_run()], #{{held_out: first, apply: true, window: 0.5}});
        print(`${{found.verdict}} ${{found.effects[0].name}} ${{found.effects[0].alternatives[0]}} ${{found.effects[0].parameters.stiffness}}`);
        print(`${{found.before / found.after}} ${{found.version}} ${{chest.version}} ${{first}}`);
        print(prediction_error(chest, first) / prediction_error(chest, last_run()));
        let plain = gap(chest, first);
        if plain.version != () {{ throw \"published unasked\" }}"
    );
    assert_eq!(problems(&text), []);
    let ran = run(&text);
    assert_eq!(ran.end, End::Done);
    assert_eq!(ran.stage.hidden, [("chest".to_owned(), Some("lid_hinge".to_owned()))]);
    assert_eq!(ran.stage.said, ["ambiguous joint_spring hinge_tilt 2.5", "10.0 abc abc run 1", "2.0"]);
    let asked = &ran.stage.asked[0];
    assert_eq!((asked.object.as_str(), asked.runs.as_slice()), ("chest", &[RunHandle(0), RunHandle(1)][..]));
    assert_eq!((asked.held_out.as_slice(), asked.apply, asked.accept_unconfirmed, asked.window), (&[RunHandle(0)][..], true, false, 0.5));
}

#[test]
fn a_gap_that_is_asked_for_wrongly_is_found_before_anything_moves() {
    for (call, said) in [
        ("gap(chest, 3)", "gap(...) needs recorded runs, and is given a bare number"),
        ("gap(cm(1), last_run())", "gap(...) needs an object first, and is given a length"),
        ("gap(chest, last_run(), true)", "gap(...) needs its options as a map, and is given true or false"),
        ("gap(chest, last_run(), #{aply: true})", "gap has no option 'aply'; did you mean 'apply'?"),
        ("gap(chest, last_run(), #{apply: 1})", "gap: 'apply' is a bare number, and must be true or false"),
        ("gap(chest)", "'gap' does not take 1 arguments; it takes 2 or 3"),
        ("chest.verson", "an object has no property 'verson'; did you mean 'version'?"),
    ] {
        let found = problem(&format!("{CHEST}{call};"));
        assert!(found.contains(said), "{call}: {found}");
    }
    // Where the check cannot know, the run finds it.
    for (call, said) in [
        ("gap(chest, one())", "needs recorded runs, and is given a bare number"),
        ("gap(chest, [last_run(), one()])", "needs recorded runs, and is given a bare number"),
        ("gap(chest, [])", "is given no run"),
        ("gap(chest, last_run(), #{window: -one()})", "must be greater than zero"),
        ("gap(chest, last_run(), #{held_out: one()})", "'held_out' must be recorded runs"),
        ("gap(one(), last_run())", "needs an object first"),
    ] {
        let End::Wrong(wrong) = run(&format!("fn one() {{ 1 }}\n{CHEST}nudge(chest); {call};")).end else { panic!("{call}") };
        assert!(wrong.to_string().contains(said), "{call}: {wrong}");
    }
    let End::Wrong(wrong) = run(&format!("{CHEST}last_run();")).end else { panic!() };
    assert!(wrong.to_string().contains("no skill has moved a joint yet"), "{wrong}");
}

#[test]
fn a_script_is_told_which_experiment_is_asked_for_in_units_that_skills_take() {
    let text = format!(
        "{CHEST}let asked = asked_experiment(); if asked == () {{ throw \"nothing is asked\" }} nudge(chest, asked.high); \
         print(`${{asked.kind}} of ${{asked.object}}'s ${{asked.joint}} at ${{asked.speed}}, slides: ${{asked.slides}}`);"
    );
    let End::Failed { diagnostic, .. } = run(&text).end else { panic!() };
    assert!(diagnostic.to_string().contains("nothing is asked"), "{diagnostic}");
    let asked = AskedExperiment {
        object: "chest".into(),
        joint: "lid_hinge".into(),
        kind: "two_speeds".into(),
        positions: [("high".to_owned(), Quantity::Angle(Angle(0.5)))].into(),
        numbers: [("speed".to_owned(), 0.25)].into(),
        slides: false,
        reason: "slow and fast".into(),
    };
    let ran = run_with(&text, |stage, _, _| stage.experiment = Some(asked));
    assert_eq!((ran.end, ran.stage.said), (End::Done, vec!["two_speeds of chest's lid_hinge at 0.25, slides: false".to_owned()]));
    assert_eq!(ran.stage.calls.len(), 1);
}

#[test]
fn a_gap_that_the_data_cannot_answer_can_be_caught() {
    let text = format!(
        "{CHEST}try {{ nudge(chest) }} catch {{ }} try {{ gap(chest, last_run()) }} catch (e) {{ print(`${{e.skill}} ${{e.code}}`) }}"
    );
    let failure = Failure { code: FailureCode::BadArgument, stage: "gap".into(), message: "too short".into() };
    let ran = run_with(&text, |stage, _, _| stage.fail = Some(failure));
    assert_eq!((ran.end, ran.stage.said), (End::Done, vec!["gap bad_argument".to_owned()]));
}
