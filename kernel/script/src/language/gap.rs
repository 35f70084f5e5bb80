//! What a script can ask about the gap between a stored model and what was measured.
//!
//! ```text
//! scene.hidden_effect(object)              // the measured object has an effect that its stored model lacks, drawn from the seed
//! last_run()                               // what was recorded in the last call of a skill that moved a joint by its handle
//! prediction_error(object, run)            // RMSE of the positions that the model predicts for a run, an angle or a length
//! gap(object, runs)                        // what the model lacks; `runs` is a run or an array of runs
//! gap(object, runs, #{apply: true})        // publishes the better model, and plans with it from then on
//! object.version                           // the version of the model that is planned with now
//! asked_experiment()                       // what `sagci gap --experiment SCRIPT` asks the script to do; `()` where nothing does
//! ```
//!
//! Options of `gap`: `held_out` (a run or runs that no fit sees; without it, a part of three runs or more is set aside), `apply`,
//! `accept_unconfirmed` (publish also what held-out runs do not confirm), `window` (s, 1 unless said). It answers a map:
//! `verdict` (`no_gap`, `named`, `ambiguous`, `unknown`), `effects` (each with `name`, `alternatives`, `joint`, `parameters`, `confirmed`),
//! `before`, `refitted`, `after`, `noise_floor` (an angle or a length), `version` (of what was published, or `()`), `notes`.
//!
//! An asked experiment is a map: `object` (its name in the library), `joint`, `slides`, `kind` (such as `two_speeds`), `reason`, the
//! positions between which it goes by their names (`low`, `high`, ...: angles or lengths), and its other numbers (`speed`, `dwell`, ...).

use std::any::TypeId;
use std::cell::RefCell;
use std::rc::Rc;

use rhai::{Array, Dynamic, Engine, Map, NativeCallContext, Position};

use super::engine::{Raised, quantity_value, refuse, refuse_with, stopped};
use super::stage::{AskedExperiment, FoundEffect, GapAnswer, GapRequest, Stage};
use super::suggest::hint_among;
use super::value::{Kind, ObjectHandle, RunHandle, SceneHandle, number};

/// How `gap` is written.
pub const GAP_HINT: &str = "write gap(object, last_run()) or gap(object, [run, other_run], #{held_out: third_run, apply: true})";

/// What may stand in the map at its end, and of which kind it is; runs have no single kind.
pub const GAP_OPTIONS: [(&str, Option<Kind>); 4] =
    [("held_out", None), ("apply", Some(Kind::Truth)), ("accept_unconfirmed", Some(Kind::Truth)), ("window", Some(Kind::Number))];

/// Registers the functions.
pub(super) fn register(engine: &mut Engine, stage: &Rc<RefCell<dyn Stage>>) {
    let hider = stage.clone();
    engine.register_fn("hidden_effect", move |context: NativeCallContext, _: SceneHandle, object: ObjectHandle| {
        hider.borrow_mut().hide(&object.name, object.joint.as_deref()).map_err(|r| refuse(r, context.call_position()))
    });
    let keeper = stage.clone();
    engine.register_fn("last_run", move |context: NativeCallContext| {
        keeper.borrow_mut().last_run().map_err(|r| refuse(r, context.call_position()))
    });
    let asker = stage.clone();
    engine.register_fn("asked_experiment", move || asker.borrow().asked().map_or(Dynamic::UNIT, |a| Dynamic::from(asked_map(&a))));
    let library = stage.clone();
    engine.register_get("version", move |context: NativeCallContext, object: &mut ObjectHandle| {
        library.borrow_mut().version(&object.name).map_err(|r| refuse(r, context.call_position()))
    });
    let judge = stage.clone();
    engine.register_fn("prediction_error", move |context: NativeCallContext, object: ObjectHandle, run: RunHandle| {
        let position = context.call_position();
        let error = judge.borrow_mut().prediction_error(&object.name, run);
        error.map(quantity_value).map_err(|stop| stopped("prediction_error", stop, position))
    });
    for arity in 2..=3 {
        let stage = stage.clone();
        engine.register_raw_fn(
            "gap",
            vec![TypeId::of::<Dynamic>(); arity],
            move |context: NativeCallContext, args: &mut [&mut Dynamic]| {
                let position = context.call_position();
                let values: Vec<Dynamic> = args.iter().map(|a| a.flatten_clone()).collect();
                let request = request(&values, position)?;
                let answer = stage.borrow_mut().gap(&request);
                answer.map(|a| answer_map(&a)).map_err(|stop| stopped("gap", stop, position))
            },
        );
    }
}

/// What a call asks for.
fn request(values: &[Dynamic], position: Position) -> Result<GapRequest, Raised> {
    let wrong = |message: String| refuse_with(position, message, GAP_HINT);
    let first = values.first().cloned().unwrap_or_default();
    let object = first
        .clone()
        .try_cast::<ObjectHandle>()
        .ok_or_else(|| wrong(format!("gap(...) needs an object first, and is given {}", Kind::of(&first).words())))?;
    let mut request = GapRequest {
        object: object.name,
        runs: runs(values.get(1), "gap(...) needs recorded runs", position)?,
        held_out: Vec::new(),
        apply: false,
        accept_unconfirmed: false,
        window: 1.0,
    };
    if request.runs.is_empty() {
        return Err(wrong("gap(...) is given no run".into()));
    }
    let Some(options) = values.get(2) else { return Ok(request) };
    let Some(options) = options.clone().try_cast::<Map>() else {
        return Err(wrong(format!("gap(...) takes its options as a map, and is given {}", Kind::of(options).words())));
    };
    for (name, value) in &options {
        let misfit = |wanted: &str| wrong(format!("gap: '{name}' is {}, and must be {wanted}", Kind::of(value).words()));
        let truth = || value.as_bool().map_err(|_| misfit("true or false"));
        match name.as_str() {
            "held_out" => request.held_out = runs(Some(value), "gap: 'held_out' must be recorded runs", position)?,
            "apply" => request.apply = truth()?,
            "accept_unconfirmed" => request.accept_unconfirmed = truth()?,
            "window" => {
                let seconds = number(value).ok_or_else(|| misfit("a bare number of seconds"))?;
                if !(seconds.is_finite() && seconds > 0.0) {
                    return Err(wrong(format!("gap: 'window' = {seconds} s must be greater than zero")));
                }
                request.window = seconds;
            }
            other => {
                let hint = hint_among(other, "its options", GAP_OPTIONS.map(|(n, _)| n));
                return Err(refuse_with(position, format!("gap has no option '{other}'"), &hint));
            }
        }
    }
    Ok(request)
}

/// A run or an array of runs.
fn runs(value: Option<&Dynamic>, needs: &str, position: Position) -> Result<Vec<RunHandle>, Raised> {
    let value = value.cloned().unwrap_or_default();
    let items = match value.clone().try_cast::<Array>() {
        Some(items) => items,
        None => vec![value],
    };
    let run = |item: Dynamic| {
        let is = Kind::of(&item).words();
        item.try_cast::<RunHandle>().ok_or_else(|| refuse_with(position, format!("{needs}, and is given {is}"), GAP_HINT))
    };
    items.into_iter().map(run).collect()
}

fn asked_map(asked: &AskedExperiment) -> Map {
    let mut map = Map::from([
        ("object".into(), asked.object.clone().into()),
        ("joint".into(), asked.joint.clone().into()),
        ("kind".into(), asked.kind.clone().into()),
        ("reason".into(), asked.reason.clone().into()),
        ("slides".into(), asked.slides.into()),
    ]);
    map.extend(asked.positions.iter().map(|(name, at)| (name.as_str().into(), quantity_value(*at))));
    map.extend(asked.numbers.iter().map(|(name, x)| (name.as_str().into(), Dynamic::from(*x))));
    map
}

fn answer_map(answer: &GapAnswer) -> Map {
    let texts = |all: &[String]| Dynamic::from(all.iter().map(|t| Dynamic::from(t.clone())).collect::<Array>());
    let effect = |e: &FoundEffect| {
        let parameters: Map = e.parameters.iter().map(|(name, value)| (name.as_str().into(), Dynamic::from(*value))).collect();
        Dynamic::from(Map::from([
            ("name".into(), e.name.clone().into()),
            ("alternatives".into(), texts(&e.alternatives)),
            ("joint".into(), e.joint.clone().into()),
            ("parameters".into(), Dynamic::from(parameters)),
            ("confirmed".into(), e.confirmed.into()),
        ]))
    };
    Map::from([
        ("verdict".into(), answer.verdict.clone().into()),
        ("effects".into(), Dynamic::from(answer.effects.iter().map(effect).collect::<Array>())),
        ("before".into(), quantity_value(answer.before)),
        ("refitted".into(), quantity_value(answer.refitted)),
        ("after".into(), quantity_value(answer.after)),
        ("noise_floor".into(), quantity_value(answer.noise_floor)),
        ("version".into(), answer.version.clone().map_or(Dynamic::UNIT, Dynamic::from)),
        ("notes".into(), texts(&answer.notes)),
    ])
}
