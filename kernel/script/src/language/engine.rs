//! The Rhai engine of task scripts: a small language, bounded in every direction, in which skills are functions.
//!
//! ```text
//! scene.expect("model", at(...), facing(...))    // a thing of the library stands about there; answers the object
//! scene.unknown("model", at(...), facing(...))   // a thing stands in the measured world of which the robot is told nothing; answers nothing
//! scene.learn("name")                            // what the camera sees and nobody told of is modelled and kept; answers the object
//! ```
//!
//! `scene.learn` fails with `not_seen`, which a script can catch, where nothing new is seen or what is seen cannot be modelled.

use std::any::TypeId;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rhai::packages::{BasicArrayPackage, BasicMapPackage, BasicMathPackage, CorePackage, LogicPackage, MoreStringPackage, Package};
use rhai::{Dynamic, Engine, EvalAltResult, FLOAT, INT, Map, NativeCallContext, OptimizationLevel, Position};
use sagci_skill::{Argument, Failure};

use super::bind::{Given, bind};
use super::modules::ConfinedModules;
use super::stage::{AskedExperiment, Declaration, DeclaredPlace, GapAnswer, GapRequest, Outcome, Quantity, Refusal, Stage, Stop};
use super::value::{self, Angle, At, Facing, Inside, Kind, Length, ObjectHandle, RunHandle, SceneHandle};
use crate::plugins::LoadedSkill;

/// The name under which scripts find the scene.
pub const SCENE: &str = "scene";

/// Greatest number of arguments of `scene.expect` besides the model's name.
const EXPECT_OPTIONS: usize = 5;

/// Why a script had to end; carried through Rhai as a termination, which a script cannot catch.
#[derive(Debug, Clone)]
pub enum Termination {
    /// Someone asked for it.
    Interrupted,
    /// The script is wrong.
    Refused(Refusal),
    /// The world or the program broke down.
    Broken(String),
}

/// What a script runs on.
pub struct Surroundings {
    /// The skills that become functions.
    pub skills: Vec<LoadedSkill>,
    /// What the script acts on.
    pub stage: Rc<RefCell<dyn Stage>>,
    /// Set to stop the script.
    pub cancel: Arc<AtomicBool>,
}

/// An engine for a script in `folder`.
pub fn engine(folder: &Path, surroundings: Surroundings) -> Engine {
    let Surroundings { skills, stage, cancel } = surroundings;
    let mut engine = bare_engine();
    engine.set_module_resolver(ConfinedModules::new(folder));
    engine.on_progress(move |_| cancel.load(Ordering::Relaxed).then(|| Dynamic::from(Termination::Interrupted)));
    let speaker = stage.clone();
    engine.on_print(move |text| speaker.borrow_mut().say(text));
    let speaker = stage.clone();
    engine.on_debug(move |text, _, _| speaker.borrow_mut().say(text));
    #[allow(deprecated)] // Rhai marks it so to say that its signature may change.
    engine.on_var(|name, _, _| Ok((name == SCENE).then(|| Dynamic::from(SceneHandle))));
    value::register(&mut engine);
    register_scene(&mut engine, &stage);
    super::gap::register(&mut engine, &stage);
    for skill in skills {
        register_skill(&mut engine, skill, &stage);
    }
    engine
}

/// The engine without anything of ours: its packages and its limits, said in full, since Rhai's defaults differ between
/// debug and release builds.
fn bare_engine() -> Engine {
    let mut engine = Engine::new_raw();
    // Without time and random numbers: a run repeats bit for bit.
    CorePackage::new().register_into_engine(&mut engine);
    LogicPackage::new().register_into_engine(&mut engine);
    BasicMathPackage::new().register_into_engine(&mut engine);
    BasicArrayPackage::new().register_into_engine(&mut engine);
    BasicMapPackage::new().register_into_engine(&mut engine);
    MoreStringPackage::new().register_into_engine(&mut engine);
    // Any other level may call functions while it compiles, and ours move a robot.
    engine.set_optimization_level(OptimizationLevel::None);
    engine.disable_symbol("eval");
    engine
        .set_max_operations(10_000_000)
        .set_max_call_levels(32)
        .set_max_expr_depths(64, 64)
        .set_max_functions(256)
        .set_max_modules(64)
        .set_max_variables(1024)
        .set_max_string_size(64 * 1024)
        .set_max_array_size(10_000)
        .set_max_map_size(1000);
    // Real time means nothing in a run, and a sleeping thread could not be cancelled.
    let no_sleep = || -> Result<(), Box<EvalAltResult>> { Err("scripts cannot sleep".into()) };
    engine.register_fn("sleep", move |_: INT| no_sleep()).register_fn("sleep", move |_: FLOAT| no_sleep());
    engine
}

/// The names that mean something in every script; no skill may take one. Methods of Rhai's own arrays, maps and texts are
/// not among them: a skill may be called `push`, for what its first argument is tells the two apart.
pub fn reserved_names() -> Vec<String> {
    let stage = Rc::new(RefCell::new(Nowhere));
    let surroundings = Surroundings { skills: Vec::new(), stage, cancel: Arc::default() };
    let packages = packaged_functions(&bare_engine());
    let all = packaged_functions(&engine(Path::new("."), surroundings));
    let mut names: Vec<String> = all.into_iter().filter(|f| !packages.contains(f)).map(|(name, _)| name).collect();
    names.extend(INNATE.map(|(name, _)| name.to_owned()));
    names.extend(["sleep".to_owned(), SCENE.to_owned()]);
    names.sort();
    names.dedup();
    names
}

/// Rhai's own functions that are in no package.
const INNATE: [(&str, usize); 8] =
    [("print", 1), ("debug", 1), ("type_of", 1), ("Fn", 1), ("is_shared", 1), ("is_def_var", 1), ("is_def_fn", 2), ("print", 0)];

fn packaged_functions(engine: &Engine) -> Vec<(String, usize)> {
    engine.collect_fn_metadata(None, |f| Some((f.metadata.name.to_string(), f.metadata.num_params)), true)
}

/// Name and number of parameters of all functions that an engine knows, sorted.
pub fn known_functions(engine: &Engine) -> Vec<(String, usize)> {
    let mut known = packaged_functions(engine);
    known.extend(INNATE.map(|(name, parameters)| (name.to_owned(), parameters)));
    known.sort();
    known.dedup();
    known
}

/// A stage on which nothing can be done: for looking at scripts only.
pub struct Nowhere;

impl Stage for Nowhere {
    fn expect(&mut self, _: Declaration) -> Result<(), Refusal> {
        Ok(())
    }

    fn unknown(&mut self, _: Declaration) -> Result<(), Refusal> {
        Ok(())
    }

    fn learn(&mut self, _: &str) -> Result<(), Stop> {
        Err(Stop::Interrupted)
    }

    fn robot(&mut self, _: &str) -> Result<(), Refusal> {
        Ok(())
    }

    fn call(&mut self, _: &LoadedSkill, _: BTreeMap<String, Argument>) -> Result<Outcome, Stop> {
        Err(Stop::Interrupted)
    }

    fn position(&mut self, _: &str, _: Option<&str>) -> Result<Quantity, Refusal> {
        Ok(Quantity::Angle(Angle(0.0)))
    }

    fn hide(&mut self, _: &str, _: Option<&str>) -> Result<(), Refusal> {
        Ok(())
    }

    fn last_run(&mut self) -> Result<RunHandle, Refusal> {
        Ok(RunHandle(0))
    }

    fn gap(&mut self, _: &GapRequest) -> Result<GapAnswer, Stop> {
        Err(Stop::Interrupted)
    }

    fn asked(&self) -> Option<AskedExperiment> {
        None
    }

    fn prediction_error(&mut self, _: &str, _: RunHandle) -> Result<Quantity, Stop> {
        Err(Stop::Interrupted)
    }

    fn version(&mut self, _: &str) -> Result<String, Refusal> {
        Ok(String::new())
    }

    fn say(&mut self, _: &str) {}
}

pub(super) type Raised = Box<EvalAltResult>;

fn terminate(termination: Termination, position: Position) -> Raised {
    EvalAltResult::ErrorTerminated(Dynamic::from(termination), position).into()
}

pub(super) fn refuse(refusal: Refusal, position: Position) -> Raised {
    terminate(Termination::Refused(refusal), position)
}

pub(super) fn refuse_with(position: Position, message: String, hint: &str) -> Raised {
    refuse(Refusal { message, hint: (!hint.is_empty()).then(|| hint.to_owned()) }, position)
}

pub(super) fn quantity_value(quantity: Quantity) -> Dynamic {
    match quantity {
        Quantity::Angle(a) => Dynamic::from(a),
        Quantity::Length(l) => Dynamic::from(l),
    }
}

fn register_scene(engine: &mut Engine, stage: &Rc<RefCell<dyn Stage>>) {
    for options in 0..=EXPECT_OPTIONS {
        let mut types = vec![TypeId::of::<SceneHandle>(), TypeId::of::<rhai::ImmutableString>()];
        types.extend(vec![TypeId::of::<Dynamic>(); options]);
        let told = stage.clone();
        engine.register_raw_fn("expect", &types, move |context: NativeCallContext, args: &mut [&mut Dynamic]| {
            let position = context.call_position();
            let values: Vec<Dynamic> = args[1..].iter().map(|a| a.flatten_clone()).collect();
            let declaration = declaration("expect", position, &values)?;
            let name = declaration.name.clone();
            told.borrow_mut().expect(declaration).map_err(|r| refuse(r, position))?;
            Ok(ObjectHandle { name, joint: None })
        });
        let untold = stage.clone();
        engine.register_raw_fn("unknown", &types, move |context: NativeCallContext, args: &mut [&mut Dynamic]| {
            let position = context.call_position();
            let values: Vec<Dynamic> = args[1..].iter().map(|a| a.flatten_clone()).collect();
            let declaration = declaration("unknown", position, &values)?;
            untold.borrow_mut().unknown(declaration).map_err(|r| refuse(r, position))
        });
    }
    let learner = stage.clone();
    engine.register_fn("learn", move |context: NativeCallContext, _: SceneHandle, name: &str| {
        let learned = learner.borrow_mut().learn(name);
        learned
            .map(|()| ObjectHandle { name: name.to_owned(), joint: None })
            .map_err(|stop| stopped("learn", stop, context.call_position()))
    });
    let robot = stage.clone();
    engine.register_fn("robot", move |context: NativeCallContext, _: SceneHandle, model: &str| {
        robot.borrow_mut().robot(model).map_err(|r| refuse(r, context.call_position()))
    });
    let believed = stage.clone();
    engine.register_get("position", move |context: NativeCallContext, object: &mut ObjectHandle| {
        let quantity = believed.borrow_mut().position(&object.name, object.joint.as_deref());
        quantity.map(quantity_value).map_err(|r| refuse(r, context.call_position()))
    });
    // Rhai compares what it does not know how to compare, and finds it different; that would hide a forgotten unit.
    let kinds = [TypeId::of::<Angle>(), TypeId::of::<Length>(), TypeId::of::<INT>(), TypeId::of::<FLOAT>()];
    for (a, b) in (0..4).flat_map(|a| (0..4).map(move |b| (a, b))).filter(|(a, b)| a != b && (*a < 2 || *b < 2)) {
        for operator in ["<", "<=", ">", ">=", "==", "!="] {
            let fault = move |context: NativeCallContext, args: &mut [&mut Dynamic]| -> Result<bool, Raised> {
                let (left, right) = (Kind::of(args[0]).words(), Kind::of(args[1]).words());
                let message = format!("{left} cannot be compared with {right}");
                Err(refuse_with(context.call_position(), message, "give both a unit, such as deg(90) or cm(5)"))
            };
            engine.register_raw_fn(operator, [kinds[a], kinds[b]], fault);
        }
    }
    // A unit is never guessed.
    for (name, ours) in
        value::ANGLE_UNITS.iter().map(|(n, _)| (*n, "an angle")).chain(value::LENGTH_UNITS.iter().map(|(n, _)| (*n, "a length")))
    {
        engine.register_raw_fn(
            name,
            [TypeId::of::<Dynamic>()],
            move |context: NativeCallContext, args: &mut [&mut Dynamic]| -> Result<(), Raised> {
                let is = Kind::of(args[0]).words();
                Err(refuse_with(
                    context.call_position(),
                    format!("{name}(...) makes {ours} of a bare number, and is given {is}"),
                    "give it a bare number",
                ))
            },
        );
    }
    engine.register_raw_fn(
        "facing",
        [TypeId::of::<Dynamic>()],
        |context: NativeCallContext, args: &mut [&mut Dynamic]| -> Result<(), Raised> {
            let is = Kind::of(args[0]).words();
            Err(refuse_with(context.call_position(), format!("facing(...) needs an angle, and is given {is}"), "write facing(deg(90))"))
        },
    );
    for n in [2, 3] {
        engine.register_raw_fn(
            "at",
            vec![TypeId::of::<Dynamic>(); n],
            |context: NativeCallContext, args: &mut [&mut Dynamic]| -> Result<(), Raised> {
                let is: Vec<_> = args.iter().map(|a| Kind::of(a).words()).collect();
                Err(refuse_with(
                    context.call_position(),
                    format!("at(...) needs lengths, and is given {}", is.join(" and ")),
                    "write at(cm(40), cm(10))",
                ))
            },
        );
    }
}

/// Reads the arguments of `scene.expect` and `scene.unknown`: the model's name, then what else is known, in any order.
fn declaration(function: &str, position: Position, args: &[Dynamic]) -> Result<Declaration, Raised> {
    let model = args[0].clone().into_string().unwrap_or_default();
    let (mut name, mut at, mut facing, mut inside, mut joints) = (None, None, None, None, Vec::new());
    let twice = |what: &str| refuse_with(position, format!("scene.{function}(\"{model}\", ...) is given {what} twice"), "");
    for arg in &args[1..] {
        match Kind::of(arg) {
            Kind::Text => {
                if name.replace(arg.clone().into_string().unwrap_or_default()).is_some() {
                    return Err(twice("a name"));
                }
            }
            Kind::At => {
                if at.replace(arg.clone_cast::<At>()).is_some() {
                    return Err(twice("a position"));
                }
            }
            Kind::Facing => {
                if facing.replace(arg.clone_cast::<Facing>().0).is_some() {
                    return Err(twice("a direction"));
                }
            }
            Kind::Inside => {
                if inside.replace(arg.clone_cast::<Inside>()).is_some() {
                    return Err(twice("a place"));
                }
            }
            Kind::Map => {
                for (joint, value) in arg.clone_cast::<Map>() {
                    let quantity = match Kind::of(&value) {
                        Kind::Angle => Quantity::Angle(value.clone_cast()),
                        Kind::Length => Quantity::Length(value.clone_cast::<Length>()),
                        other => {
                            let message = format!("the joint '{joint}' is given {} as its position", other.words());
                            return Err(refuse_with(position, message, "write #{door: deg(10)} or #{drawer: cm(5)}"));
                        }
                    };
                    joints.push((joint.to_string(), quantity));
                }
            }
            other => {
                let message = format!("scene.{function}(\"{model}\", ...) cannot use {}", other.words());
                return Err(refuse_with(position, message, EXPECT_HINT));
            }
        }
    }
    let place = match (inside, at) {
        (Some(_), Some(_)) => {
            return Err(refuse_with(position, format!("'{model}' is said to be at two places"), "give at(...) or inside(...), not both"));
        }
        (Some(inside), None) => DeclaredPlace::Inside(inside),
        (None, Some(at)) => DeclaredPlace::Table { at, facing: facing.unwrap_or(Angle(0.0)) },
        (None, None) => return Err(refuse_with(position, format!("it is not said where '{model}' is"), EXPECT_HINT)),
    };
    Ok(Declaration { name: name.unwrap_or_else(|| model.clone()), model, place, joints })
}

/// How `scene.expect` is written.
pub const EXPECT_HINT: &str =
    "write scene.expect(\"model\", at(cm(60), cm(20)), facing(deg(90))) or scene.expect(\"model\", inside(other)); a further text names it";

/// How `scene.learn` is written.
pub const LEARN_HINT: &str = "write let fridge = scene.learn(\"my_fridge\")";

fn register_skill(engine: &mut Engine, skill: LoadedSkill, stage: &Rc<RefCell<dyn Stage>>) {
    let skill = Rc::new(skill);
    // One more than it has parameters, so that a call with too many is told so in its own words.
    for arity in 0..=skill.manifest.parameters.len() + 1 {
        let (skill, stage) = (skill.clone(), stage.clone());
        let name = skill.manifest.name.clone();
        engine.register_raw_fn(name, vec![TypeId::of::<Dynamic>(); arity], move |context: NativeCallContext, args: &mut [&mut Dynamic]| {
            let position = context.call_position();
            let arguments = arguments(&skill, position, args)?;
            let called = stage.borrow_mut().call(&skill, arguments);
            called.map(|outcome| outcome_map(&outcome)).map_err(|stop| stopped(&skill.manifest.name, stop, position))
        });
    }
}

/// Why a call did not end well, for the script: it may catch a failure, and nothing else.
pub(super) fn stopped(function: &str, stop: Stop, position: Position) -> Raised {
    match stop {
        Stop::Failed(failure) => EvalAltResult::ErrorRuntime(Dynamic::from(failure_map(function, &failure)), position).into(),
        Stop::Refused(refusal) => refuse(refusal, position),
        Stop::Interrupted => terminate(Termination::Interrupted, position),
        Stop::Broken(message) => terminate(Termination::Broken(message), position),
    }
}

/// The arguments of a call by parameter name.
fn arguments(skill: &LoadedSkill, position: Position, args: &mut [&mut Dynamic]) -> Result<BTreeMap<String, Argument>, Raised> {
    let mut values: Vec<(Option<String>, Dynamic)> = args.iter().map(|a| (None, a.flatten_clone())).collect();
    if values.last().is_some_and(|(_, v)| v.is_map()) {
        let map = values.pop().map(|(_, v)| v.cast::<Map>()).unwrap_or_default();
        values.extend(map.into_iter().map(|(name, v)| (Some(name.to_string()), v)));
    }
    let given: Vec<Given> = values.iter().map(|(name, v)| Given { name: name.clone(), kind: Some(Kind::of(v)) }).collect();
    let slots = bind(&skill.manifest, &given).map_err(|m| refuse(Refusal { message: m.message, hint: m.hint }, position))?;
    let mut arguments = BTreeMap::new();
    for (slot, (_, v)) in slots.into_iter().zip(&values) {
        if let Some(argument) = value::argument(v) {
            arguments.insert(skill.manifest.parameters[slot].name.clone(), argument);
        }
    }
    Ok(arguments)
}

fn quantity_of(unit: &str, value: f64) -> Dynamic {
    match unit {
        "rad" => Dynamic::from(Angle(value)),
        "m" => Dynamic::from(Length(value)),
        _ => Dynamic::from(value),
    }
}

fn outcome_map(outcome: &Outcome) -> Map {
    let measured: Map = outcome.measured.iter().map(|m| (m.name.as_str().into(), quantity_of(&m.unit, m.value))).collect();
    Map::from([("seconds".into(), Dynamic::from(outcome.seconds)), ("measured".into(), Dynamic::from(measured))])
}

/// The snake-case name of a failure's code.
pub fn code_name(code: sagci_skill::FailureCode) -> String {
    serde_json::to_value(code).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_else(|| format!("{code:?}"))
}

fn failure_map(skill: &str, failure: &Failure) -> Map {
    Map::from([
        ("skill".into(), skill.to_owned().into()),
        ("code".into(), code_name(failure.code).into()),
        ("stage".into(), failure.stage.clone().into()),
        ("message".into(), failure.message.clone().into()),
    ])
}
