//! The plants obey physics, and the judge judges.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use sagci_model::{EffectEntry, ObjectModel};
use serde_json::json;

use crate::effect::Hold;
use crate::plant::{Mechanism, Plant, Rapier, Rigid, RungeKutta};
use crate::simulate::simulate;
use crate::*;

fn urdf(text: &str) -> ObjectModel {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("object.urdf");
    std::fs::write(&path, text).unwrap();
    ObjectModel::read_urdf(path).unwrap()
}

/// Point-like mass of 1.2 kg at 0.4 m below a level hinge.
fn pendulum(damping: f64, friction: f64) -> ObjectModel {
    urdf(&format!(
        r#"<robot name="p"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.4"/><mass value="1.2"/>
        <inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
        <dynamics damping="{damping}" friction="{friction}"/></joint></robot>"#
    ))
}

/// Two kilograms on a level slide.
fn slide(damping: f64, friction: f64) -> ObjectModel {
    urdf(&format!(
        r#"<robot name="s"><link name="base"/><link name="box"><inertial><mass value="2"/>
        <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="slide" type="prismatic"><parent link="base"/><child link="box"/><axis xyz="0 1 0"/>
        <limit lower="-9" upper="9" effort="100" velocity="10"/><dynamics damping="{damping}" friction="{friction}"/></joint></robot>"#
    ))
}

fn arm() -> ObjectModel {
    let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
    ObjectModel::read(models.join(std::fs::read_to_string(models.join("HEAD")).unwrap().trim())).unwrap()
}

fn effect(name: &str, joint: &str, parameters: &[(&str, f64)]) -> EffectEntry {
    let parameters = parameters.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect();
    EffectEntry { effect: name.into(), joint: Some(joint.into()), parameters, ..EffectEntry::default() }
}

fn both(model: &ObjectModel, effects: &[EffectEntry], step: f64) -> [Box<dyn Plant>; 2] {
    let mechanism = || Mechanism::new(model, effects).unwrap();
    [Box::new(RungeKutta::new(mechanism(), step).unwrap()), Box::new(Rapier::new(mechanism(), step).unwrap())]
}

#[test]
fn a_pendulum_without_losses_keeps_its_energy() {
    let model = pendulum(0.0, 0.0);
    let inertia = 1.2 * 0.16 + 0.01;
    // Rapier's integrator is of first order: its energy swings by a step's share.
    for (mut plant, tolerance) in both(&model, &[], 2e-4).into_iter().zip([1e-9, 2e-3]) {
        plant.reset(0.0, &[1.5], &[0.0]);
        let energy = |p: &dyn Plant| 0.5 * inertia * p.v()[0].powi(2) - 1.2 * 9.81 * 0.4 * p.q()[0].cos();
        let (first, scale) = (energy(plant.as_ref()), 1.2 * 9.81 * 0.4);
        for k in 1..=400 {
            plant.advance(f64::from(k) * 0.01, &[Hold::Effort(0.0)]).unwrap();
            let change = (energy(plant.as_ref()) - first).abs() / scale;
            assert!(change < tolerance, "at {} s the energy is off by {change:.1e}", f64::from(k) * 0.01);
        }
    }
}

#[test]
fn both_engines_swing_alike() {
    let [mut a, mut b] = both(&pendulum(0.05, 0.1), &[], 1e-4);
    for plant in [&mut a, &mut b] {
        plant.reset(0.0, &[1.2], &[0.0]);
    }
    for k in 1..=300 {
        let input = [Hold::Effort(0.5 * (f64::from(k) * 0.05).sin())];
        a.advance(f64::from(k) * 0.01, &input).unwrap();
        b.advance(f64::from(k) * 0.01, &input).unwrap();
        assert!((a.q()[0] - b.q()[0]).abs() < 2e-3, "at {k}: {} and {}", a.q()[0], b.q()[0]);
    }
}

#[test]
fn both_engines_move_an_arm_alike() {
    let mut model = arm();
    for joint in model.joints.iter_mut().filter(|j| j.name.contains("finger")) {
        joint.kind = sagci_model::JointKind::Fixed;
    }
    let rigid = Rigid::new(&model).unwrap();
    let q0 = [0.1, -0.7, 0.2, -2.2, 0.1, 1.5, 0.7];
    let [mut a, mut b] = both(&model, &[], 2.5e-4);
    for plant in [&mut a, &mut b] {
        plant.reset(0.0, &q0, &[0.0; 7]);
    }
    let weight = rigid.gravity(&q0);
    for k in 1..=50 {
        let t = f64::from(k) * 0.01;
        let input: Vec<Hold> = weight.iter().enumerate().map(|(j, w)| Hold::Effort(w + (3.0 - 0.4 * j as f64) * (9.0 * t).sin())).collect();
        a.advance(t, &input).unwrap();
        b.advance(t, &input).unwrap();
    }
    for (j, start) in q0.iter().enumerate() {
        let moved = (a.q()[j] - start).abs();
        assert!((a.q()[j] - b.q()[j]).abs() < 2e-3 + 0.01 * moved, "joint {j}: {} and {}", a.q()[j], b.q()[j]);
    }
}

#[test]
fn under_drag_a_push_ends_in_its_steady_speed() {
    for (entry, speed) in [
        (effect("viscous_friction", "slide", &[("damping", 4.0)]), 1.5),
        (effect("quadratic_drag", "slide", &[("drag", 6.0)]), 1.0),
        (
            effect(
                "asymmetric_friction",
                "slide",
                &[("friction_positive", 2.0), ("friction_negative", 9.0), ("damping_positive", 2.0), ("damping_negative", 9.0)],
            ),
            2.0,
        ),
        (
            effect(
                "presliding_hysteresis",
                "slide",
                &[
                    ("stiffness", 4e3),
                    ("micro_damping", 5.0),
                    ("friction", 6.0 - 1e-9),
                    ("static_friction", 6.0),
                    ("stribeck_velocity", 0.01),
                ],
            ),
            f64::NAN,
        ),
    ] {
        for mut plant in both(&slide(0.0, 0.0), std::slice::from_ref(&entry), 2e-4) {
            plant.reset(0.0, &[0.0], &[0.0]);
            if speed.is_nan() {
                // Below half of break-away, to which a sudden push swings, the bristles hold.
                plant.advance(6.0, &[Hold::Effort(2.5)]).unwrap();
                assert!(plant.q()[0] < 0.01 && plant.v()[0].abs() < 1e-4, "{}: crept to {}", entry.effect, plant.q()[0]);
            } else {
                plant.advance(12.0, &[Hold::Effort(6.0)]).unwrap();
                assert!((plant.v()[0] - speed).abs() < 2e-3 * speed, "{}: {}", entry.effect, plant.v()[0]);
            }
        }
    }
}

#[test]
fn dry_friction_holds_below_its_bound_and_slides_above() {
    for mut plant in both(&slide(0.0, 3.0), &[], 2e-4) {
        plant.reset(0.0, &[0.2], &[0.0]);
        plant.advance(2.0, &[Hold::Effort(2.97)]).unwrap();
        assert!((plant.q()[0] - 0.2).abs() < 1e-6, "it crept to {}", plant.q()[0]);
        plant.advance(3.0, &[Hold::Effort(4.0)]).unwrap();
        // (4 - 3) / 2 m/s^2 over 1 s.
        assert!((plant.v()[0] - 0.5).abs() < 2e-3 && (plant.q()[0] - 0.45).abs() < 2e-3, "{} {}", plant.q()[0], plant.v()[0]);
        // Stops after 0.5 / 1.5 s, and stays.
        plant.advance(3.5, &[Hold::Effort(0.0)]).unwrap();
        let stood = plant.q()[0];
        plant.advance(4.0, &[Hold::Effort(0.0)]).unwrap();
        assert!((plant.q()[0] - stood).abs() < 1e-7 && plant.v()[0].abs() < 1e-7);
        assert!((stood - 0.45 - 0.5 * 0.5 / 3.0).abs() < 2e-3, "it stopped at {stood}");
    }
}

#[test]
fn break_away_follows_static_friction_and_load() {
    let stribeck = effect(
        "stribeck_friction",
        "slide",
        &[("friction", 2.0), ("static_friction", 3.0), ("stribeck_velocity", 0.05), ("exponent", 2.0)],
    );
    for mut plant in both(&slide(0.0, 0.0), &[stribeck], 2e-4) {
        plant.reset(0.0, &[0.0], &[0.0]);
        plant.advance(1.0, &[Hold::Effort(2.9)]).unwrap();
        assert!(plant.q()[0].abs() < 1e-6);
        plant.advance(2.0, &[Hold::Effort(3.1)]).unwrap();
        assert!(plant.v()[0] > 0.3);
    }
    // |u - load| = |u + g|: held by its weight's opposite, twice the weight passes the gear.
    let load = effect("load_dependent_friction", "pivot", &[("load_coefficient", 0.1)]);
    for mut plant in both(&pendulum(0.0, 0.0), &[load], 2e-4) {
        let weight = 1.2 * 9.81 * 0.4 * 0.8f64.sin();
        plant.reset(0.0, &[0.8], &[0.0]);
        plant.advance(1.0, &[Hold::Effort(1.15 * weight)]).unwrap();
        assert!((plant.q()[0] - 0.8).abs() < 1e-5, "{}", plant.q()[0]);
        plant.advance(2.0, &[Hold::Effort(1.5 * weight)]).unwrap();
        assert!(plant.q()[0] > 0.82, "{}", plant.q()[0]);
    }
}

/// Velocity of the slide after a step of 1 N at the first tick.
fn response(effects: &[EffectEntry], which: usize, at: &[f64]) -> Vec<f64> {
    let mut plant = both(&slide(0.0, 0.0), effects, 1e-4).into_iter().nth(which).unwrap();
    let time: Vec<f64> = (0..=at.len()).map(|k| k as f64 * 0.005).collect();
    let run = simulate(plant.as_mut(), &time, &[], (&[0.0], &[0.0]), &mut |_, _, _, _| vec![Hold::Effort(1.0)]).unwrap();
    run.velocity.iter().map(|v| v[0]).collect()
}

#[test]
fn a_delay_is_exact_and_a_lag_has_its_time_constant() {
    let ticks = vec![0.0; 20];
    for which in 0..2 {
        let v = response(&[effect("transport_delay", "slide", &[("delay", 0.0123)])], which, &ticks);
        // 1 N on 2 kg from 12.3 ms on.
        assert!(v[2].abs() < 1e-9 && (v[4] - 0.5 * (0.02 - 0.0123)).abs() < 1e-6, "{:?}", &v[..5]);
        let v = response(&[effect("actuator_lag", "slide", &[("time_constant", 0.01)])], which, &ticks);
        let t = 0.05f64;
        let wanted = 0.5 * (t - 0.01 * (1.0 - (-t / 0.01).exp()));
        assert!((v[10] - wanted).abs() < 3e-5, "{} instead of {wanted}", v[10]);
        let v = response(&[effect("torque_gain", "slide", &[("gain_error", 0.2)])], which, &ticks);
        assert!((v[20] - 0.4 * 0.1).abs() < 1e-9);
        let v = response(&[effect("actuator_saturation", "slide", &[("limit", 0.5)])], which, &ticks);
        assert!((v[20] - 0.25 * 0.1).abs() < 1e-9);
        let v = response(&[effect("armature_inertia", "slide", &[("inertia", 2.0)])], which, &ticks);
        assert!((v[20] - 0.25 * 0.1).abs() < 1e-9, "{}", v[20]);
    }
}

#[test]
fn a_skewed_clock_reads_the_past() {
    for which in 0..2 {
        let v = response(&[effect("clock_skew", "slide", &[("skew", 0.0123)])], which, &[0.0; 20]);
        assert!(v[2].abs() < 1e-9 && (v[20] - 0.5 * (0.1 - 0.0123)).abs() < 1e-6, "{}", v[20]);
        let v = response(&[effect("clock_skew", "slide", &[("skew", -0.0123)])], which, &[0.0; 20]);
        assert!((v[20] - 0.5 * (0.1 + 0.0123)).abs() < 1e-6, "{}", v[20]);
    }
}

#[test]
fn air_leaks_out_in_its_time_constant() {
    let air = effect("air_suction", "slide", &[("stiffness", 40.0), ("time_constant", 0.5), ("seal_position", 0.0)]);
    for mut plant in both(&slide(0.0, 0.0), &[air], 2e-4) {
        // Moved at 0.1 m/s through a heavy push, the force settles at k v T; alone, 2 kg at 0.1 m/s lose m v = integral of k p.
        plant.reset(0.0, &[0.0], &[0.1]);
        plant.advance(6.0, &[Hold::Effort(0.0)]).unwrap();
        // m v' = k p, p' = -p / T - v: the sum ends at rest, moved by m v / (k T).
        assert!(plant.v()[0].abs() < 2e-3, "{}", plant.v()[0]);
        assert!((plant.q()[0] - 2.0 * 0.1 / (40.0 * 0.5)).abs() < 1e-3, "{}", plant.q()[0]);
    }
}

#[test]
fn a_motor_behind_a_spring_rings_at_its_own_pace_and_one_behind_a_gap_turns_alone_first() {
    let elastic = effect("joint_elasticity", "slide", &[("stiffness", 200.0), ("damping", 0.0), ("rotor_inertia", 2.0)]);
    for mut plant in both(&slide(0.0, 0.0), &[elastic], 1e-4) {
        // 1 N: both halves share it; the link's acceleration is 1/4 (1 - cos w t), w^2 = k (1/2 + 1/2).
        plant.reset(0.0, &[0.0], &[0.0]);
        let period = std::f64::consts::TAU / 200f64.sqrt();
        plant.advance(period, &[Hold::Effort(1.0)]).unwrap();
        assert!((plant.v()[0] - 0.25 * period).abs() < 2e-3 * period, "{}", plant.v()[0]);
    }
    let gap = effect("backlash", "slide", &[("half_gap", 0.01), ("rotor_inertia", 0.5)]);
    for mut plant in both(&slide(0.0, 0.0), &[gap], 1e-4) {
        plant.reset(0.0, &[0.0], &[0.0]);
        // 0.5 kg under 1 N crosses 10 mm in 0.1 s.
        plant.advance(0.098, &[Hold::Effort(1.0)]).unwrap();
        assert!(plant.v()[0].abs() < 1e-9);
        plant.advance(0.5, &[Hold::Effort(1.0)]).unwrap();
        // Momentum is what was put in, and they move as one.
        assert!((plant.v()[0] - 0.5 / 2.5).abs() < 5e-3, "{}", plant.v()[0]);
    }
}

#[test]
fn every_effect_of_the_catalogue_and_beyond_makes_a_run() {
    let arm = arm();
    let runs = Suite::Slice.runs();
    let names: std::collections::BTreeSet<_> = runs.iter().map(|r| r.effect.clone()).collect();
    assert!(CATALOGUE.iter().chain(&OUTSIDE).all(|n| names.contains(*n)));
    // A few of them here; the rest when the suite runs.
    for id in runs.iter().step_by(9) {
        let scenario = draw(id, 3, Some(&arm)).unwrap();
        let text = serde_json::to_string(&scenario.truth).unwrap();
        let again: SealedTruth = serde_json::from_str(&text).unwrap();
        assert_eq!(again.hidden.len(), scenario.truth.hidden.len());
        assert!(scenario.given.model.document.effects.is_empty(), "the model must not know the effect");
        assert_eq!(scenario.given.held_out.len(), 2);
        let rows: usize = scenario.given.train.iter().map(|l| l.joints[0].position.time.len()).sum();
        assert!(rows > 3000, "{id}: {rows}");
        for log in scenario.given.train.iter().chain(&scenario.given.held_out) {
            assert!(log.joints.iter().all(|j| j.position.value.iter().all(|x| x.is_finite())));
        }
        let held = &scenario.truth.families[1][0];
        assert!(!scenario.truth.families[0].contains(held), "{id}: {held} is trained on");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_does_not() {
    let id = RunId { kind: RunKind::Single, effect: "coulomb_friction".into(), level: 2, number: 4 };
    let hash = |seed| draw(&id, seed, None).unwrap().given.train[0].hash.clone();
    assert_eq!(hash(5), hash(5));
    assert_ne!(hash(5), hash(6));
}

fn truth_of(effect: &str, scenario: &Scenario) -> serde_json::Value {
    let hidden = &scenario.truth.hidden[0].entry;
    let parameters: serde_json::Map<_, _> = hidden
        .parameters
        .iter()
        .map(|(k, v)| (k.clone(), json!({ "value": v, "lower": v - 1e-9, "upper": v + 1e-9, "unit": "" })))
        .collect();
    json!({
        "verdict": "named",
        "effects": [{ "name": effect, "alternatives": [], "joint": hidden.joint, "channel": channels(effect)[0], "parameters": parameters }],
        "gap": { "held_out": { "before": 0.1, "refitted": 0.09, "after": 0.004, "noise_floor": 0.004 } },
        "seconds": 1.0
    })
}

#[test]
fn the_judge_tells_right_from_wrong() {
    let id = RunId { kind: RunKind::Single, effect: "viscous_friction".into(), level: 1, number: 0 };
    let scenario = draw(&id, 1, None).unwrap();
    let answer = truth_of("viscous_friction", &scenario);
    let good = judge(&scenario.truth, &Ok(answer.clone()), 1.0);
    assert!(good.exact && good.in_sets && good.false_names.is_empty());
    assert_eq!((good.joint_right, good.channel_right, good.covered), (Some(true), Some(true), [1, 1]));

    let mut set = answer.clone();
    set["effects"][0]["alternatives"] = json!(["coulomb_friction"]);
    let set = judge(&scenario.truth, &Ok(set), 1.0);
    assert!(!set.exact && set.in_sets && set.set_size == 2.0);

    let wrong = judge(&scenario.truth, &Ok(truth_of("quadratic_drag", &scenario)), 1.0);
    assert!(!wrong.exact && !wrong.in_sets && wrong.false_names == ["quadratic_drag"]);

    let mut more = answer;
    more["effects"].as_array_mut().unwrap().push(json!({ "name": "torque_bias", "joint": "x", "channel": "joint" }));
    let more = judge(&scenario.truth, &Ok(more), 1.0);
    assert!(!more.exact && more.in_sets && more.false_names == ["torque_bias"]);

    let none = judge(&scenario.truth, &Err("it broke".into()), 1.0);
    assert!(!none.exact && !none.in_sets && none.failure.is_some());
    let text = table(&[good, wrong, none]).to_text();
    assert!(text.contains("exact single name") && text.contains("it broke"));
}

#[test]
fn what_cannot_be_told_apart_counts_as_right_when_the_set_holds_it() {
    let id = RunId { kind: RunKind::Single, effect: "transport_delay".into(), level: 1, number: 0 };
    let scenario = draw(&id, 1, None).unwrap();
    let mut answer = truth_of("transport_delay", &scenario);
    answer["effects"][0]["alternatives"] = json!(["clock_skew"]);
    assert!(judge(&scenario.truth, &Ok(answer.clone()), 1.0).exact);
    answer["effects"][0]["alternatives"] = json!(["clock_skew", "actuator_lag"]);
    assert!(!judge(&scenario.truth, &Ok(answer), 1.0).exact);
}

#[test]
fn a_run_that_was_interrupted_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let clean = |number| RunId { kind: RunKind::Clean, effect: String::new(), level: 1, number };
    let asked = std::sync::atomic::AtomicUsize::new(0);
    let workflow = |_: &Given| {
        asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Ok(json!({ "verdict": "no_gap", "effects": [] }))
    };
    let options = |runs: Vec<RunId>| Options {
        suite: Suite::These(runs),
        out: Some(folder.path().join("out")),
        sealed: Some(folder.path().join("sealed")),
        data: Some(folder.path().join("data")),
        ..Options::default()
    };
    let first = run(&options(vec![clean(0)]), &workflow, &|_| {}).unwrap();
    let both = run(&options(vec![clean(0), clean(1)]), &workflow, &|_| {}).unwrap();
    let no_time = Options { limit: Some(std::time::Duration::ZERO), ..options(vec![clean(0), clean(1), clean(2)]) };
    assert_eq!(run(&no_time, &workflow, &|_| {}).unwrap().len(), 2);
    assert_eq!((asked.into_inner(), both.len()), (2, 2));
    assert!(both.iter().all(|j| j.exact) && both[0].id == first[0].id);
    let given = folder.path().join("data/clean---1-000");
    assert!(ObjectModel::read(&given).is_ok() && given.join("train_1.csv").exists());
}

/// What a workflow says that cannot tell two frictions apart, and asks for a sweep.
fn undecided(joint: &str, kind: &str) -> serde_json::Value {
    json!({
        "verdict": "ambiguous",
        "effects": [{ "name": "viscous_friction", "alternatives": ["coulomb_friction"], "joint": joint, "channel": "joint" }],
        "next_experiment": { "name": kind, "joint": joint, "reference": { "kind": kind, "low": 0.3, "high": 0.6, "speed": 0.1 } }
    })
}

#[test]
fn an_experiment_that_is_asked_for_is_done_and_its_recording_is_handed_over() {
    let id = RunId { kind: RunKind::Single, effect: "coulomb_friction".into(), level: 1, number: 1 };
    let scenario = draw(&id, 1, None).unwrap();
    let (joint, first) = (scenario.truth.joints[0].as_str(), scenario.given.train.len());
    let workflow = |given: &Given| {
        let Some(swept) = given.train.get(first) else { return Ok(undecided(joint, "quasi_static_sweep")) };
        let position = &swept.joints[0].position;
        let [low, high] = position.value.iter().fold([f64::MAX, f64::MIN], |m, q| [m[0].min(*q), m[1].max(*q)]);
        assert!(position.time[0] == 0.0 && !swept.continues, "a session of its own");
        assert!((low - 0.3).abs() < 0.05 && (high - 0.6).abs() < 0.05, "{low} {high}");
        Ok(truth_of("coulomb_friction", &scenario))
    };
    let options = Options { suite: Suite::These(vec![id.clone()]), ..Options::default() };
    let all = run(&options, &workflow, &|_| {}).unwrap();
    let trial = all[0].trial.as_ref().unwrap();
    assert!(trial.settled && trial.done == 1 && trial.asked == ["quasi_static_sweep"], "{trial:?}");
    assert!(!all[0].exact, "what was said first is what was said");

    let never = run(&options, &|_| Ok(undecided(joint, "change_payload")), &|_| {}).unwrap();
    let never = never[0].trial.as_ref().unwrap();
    assert!(never.done == 0 && !never.settled && never.asked == ["change_payload"], "{never:?}");
    let twice = run(&options, &|_| Ok(undecided(joint, "quasi_static_sweep")), &|_| {}).unwrap();
    assert_eq!(twice[0].trial.as_ref().unwrap().done, 2);

    let lost = |given: &Given| match given.train.len() {
        n if n == first => Ok(undecided(joint, "quasi_static_sweep")),
        _ => Err("the sweep could not be read".to_owned()),
    };
    let lost = run(&options, &lost, &|_| {}).unwrap();
    let failures = table(&lost).failures;
    assert!(lost[0].trial.as_ref().unwrap().done == 1 && failures[0].ends_with("after quasi_static_sweep: the sweep could not be read"));
}

#[test]
fn an_experiment_ends_where_a_limit_is_near() {
    let id = RunId { kind: RunKind::Single, effect: "coulomb_friction".into(), level: 1, number: 1 };
    let scenario = draw(&id, 1, None).unwrap();
    let joint = scenario.given.model.moving_joints().next().unwrap();
    let limits = scenario.given.model.joints[joint].limits;
    let asked = |high: f64| json!({ "joint": scenario.truth.joints[0], "reference": { "kind": "quasi_static_sweep", "low": 0.3, "high": high, "speed": 0.5 } });
    let beyond = scenario.bench.perform(&asked(limits.upper + 0.5), 1).unwrap().unwrap();
    let within = scenario.bench.perform(&asked(limits.upper - 0.3), 1).unwrap().unwrap();
    let highest = |log: &sagci_recording::Log| log.joints[0].position.value.iter().fold(f64::MIN, |m, q| m.max(*q));
    assert!(highest(&beyond) < limits.upper && highest(&beyond) > limits.upper - 0.1, "{} {}", highest(&beyond), limits.upper);
    assert!((highest(&within) - limits.upper + 0.3).abs() < 0.05);
    let last = within.joints[0].position.value.last().unwrap();
    assert!((last - 0.3).abs() < 0.1, "{last}: it comes back");
}

/// Columns of a CSV file.
fn columns(text: &str) -> Vec<Vec<f64>> {
    let rows: Vec<Vec<f64>> = text.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().unwrap()).collect()).collect();
    (0..rows[0].len()).map(|k| rows.iter().map(|r| r[k]).collect()).collect()
}

#[test]
fn a_third_engine_moves_as_ours_do_once_the_effect_is_told() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured/mujoco");
    let mut seen = 0;
    for entry in std::fs::read_dir(root.join("sealed")).unwrap() {
        let sealed = entry.unwrap().path();
        let truth: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&sealed).unwrap()).unwrap();
        let folder = root.join(sealed.file_stem().unwrap());
        let mut model = ObjectModel::read(&folder).unwrap();
        let factor = truth["mass_factor"].as_f64().unwrap();
        model.links[1].inertial.mass *= factor;
        model.links[1].inertial.I_LLcm_L *= factor;
        (model.joints[0].damping, model.joints[0].friction) = (truth["damping"].as_f64().unwrap(), truth["friction"].as_f64().unwrap());
        let effects: Vec<EffectEntry> = serde_json::from_value(truth["hidden"].clone()).unwrap();
        let text = std::fs::read_to_string(folder.join("train_2.csv")).unwrap();
        let [time, position, effort] = columns(&text).try_into().unwrap();
        let off = |effects: &[EffectEntry]| {
            let mut plant = RungeKutta::new(Mechanism::new(&model, effects).unwrap(), 2e-4).unwrap();
            let part = &time[..200];
            let run = simulate(&mut plant, part, &[], (&position[..1], &[0.0]), &mut |k, _, _, _| vec![Hold::Effort(effort[k])]).unwrap();
            let square: f64 = run.q.iter().zip(&position).map(|(q, p)| (q[0] - p).powi(2)).sum();
            (square / 200.0).sqrt()
        };
        let (told, untold) = (off(&effects), off(&[]));
        // The hand's effort is measured with noise, which adds up twice to a position; and the engines' dry friction differs a little.
        let span = effort.iter().fold([f64::MAX, f64::MIN], |m, u| [m[0].min(*u), m[1].max(*u)]);
        let noise = if text.starts_with("time,hinge.position,hinge.effort") {
            truth["noise"][1].as_f64().unwrap() * (span[1] - span[0])
        } else {
            0.0
        };
        let mass = Rigid::new(&model).unwrap().at(&[0.0], &[0.0]).0[(0, 0)];
        let most = 5e-3 + 3.0 * noise / mass * (0.005f64 / 12.0).sqrt();
        assert!(told < most, "{}: off by {told} rad within 1 s, {untold} without the effect", sealed.display());
        assert!(effects.is_empty() || told < 0.5 * untold, "{}: {told} and {untold}", sealed.display());
        seen += 1;
    }
    assert_eq!(seen, 8);
}
