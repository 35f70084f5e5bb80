//! Runs drawn from a seed: a mechanism, its model, what is hidden in it, how it is moved, and what the sensors make of that.

mod asked;
mod bench;
mod excitation;
mod priors;
mod programme;
mod secret;
mod stage;

use std::collections::BTreeMap;

use sagci_model::{EffectEntry, ObjectModel};
use sagci_recording::Log;
use serde::{Deserialize, Serialize};

use crate::EvaluationError;
use crate::effect::{CATALOGUE, Circumstances, OUTSIDE, indistinguishable};
use crate::oracle::{self, Detectability};
use crate::plant::{Mechanism, Plant, Rigid, RungeKutta};
use crate::random::{Random, number_of};
use crate::simulate::Run;
pub use bench::Bench;
use bench::{Engine, Hand, Sensors, position_noise};
use priors::Scale;
use programme::{Plan, Programme};
use secret::{Secret, extent};
pub(crate) use stage::Driving;
use stage::{Kind, Losses, Stage};

/// What kind of run it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunKind {
    /// One effect of the catalogue is hidden.
    Single,
    /// Nothing is hidden.
    Clean,
    /// Two effects.
    Double,
    /// Three effects.
    Triple,
    /// An effect that the catalogue lacks.
    Outside,
    /// One effect in a robot's arm.
    Arm,
}

impl RunKind {
    /// The word for it in names of runs.
    pub fn word(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Clean => "clean",
            Self::Double => "double",
            Self::Triple => "triple",
            Self::Outside => "outside",
            Self::Arm => "arm",
        }
    }
}

/// Which run: together with a seed it says everything.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RunId {
    /// What kind.
    pub kind: RunKind,
    /// The effect of a single, arm or outside run; empty where it is drawn.
    pub effect: String,
    /// Noise level, 1 to 3.
    pub level: usize,
    /// Number among its like.
    pub number: usize,
}

impl std::fmt::Display for RunId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let effect = if self.effect.is_empty() { "-" } else { &self.effect };
        write!(f, "{}/{effect}/{}/{:03}", self.kind.word(), self.level, self.number)
    }
}

/// What a workflow is given, and nothing else.
#[derive(Debug, Clone)]
pub struct Given {
    /// The model as it is known.
    pub model: ObjectModel,
    /// Recordings to learn from.
    pub train: Vec<Log>,
    /// Recordings to be judged by.
    pub held_out: Vec<Log>,
}

/// One hidden effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hidden {
    /// The catalogue's entry; the name of an effect outside it.
    pub entry: EffectEntry,
    /// Names that these data cannot tell from it.
    pub indistinguishable: Vec<String>,
    /// Can anybody see it in these data?
    pub detectability: Detectability,
}

/// What is true of a run. It goes into a file of its own that no workflow is shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SealedTruth {
    /// Which run.
    pub id: RunId,
    /// The suite's seed.
    pub seed: u64,
    /// What is hidden, none where nothing is.
    pub hidden: Vec<Hidden>,
    /// The mechanism.
    pub mechanism: String,
    /// `rapier` or `runge_kutta`.
    pub engine: String,
    /// Its longest step, s.
    pub step: f64,
    /// Joints that move, those of the log.
    pub joints: Vec<String>,
    /// Range of each joint's motion in training, rad or m.
    pub ranges: Vec<f64>,
    /// Families of the training and the held-out trajectories.
    pub families: [Vec<String>; 2],
    /// Standard deviation of the noise on positions, rad or m, and on efforts, N m or N, by joint.
    pub noise: [Vec<f64>; 2],
    /// True damping and friction where the model knows of them, by joint.
    pub known_losses: BTreeMap<String, [f64; 2]>,
    /// RMS of the held-out prediction's error of the true mechanism started from its true states, pooled over joints in shares of
    /// their ranges: what an oracle cannot beat but by luck.
    pub oracle_gap: f64,
}

/// A run: what is given and what is true.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// For the workflow.
    pub given: Given,
    /// For the judge.
    pub truth: SealedTruth,
    /// For experiments that the workflow asks for.
    pub bench: Bench,
}

/// Position noise, rad or m, and effort noise as a share of its range, by level.
const NOISE: [[f64; 2]; 3] = [[2e-5, 0.001], [2e-4, 0.005], [1e-3, 0.02]];

/// Draws a run. `arm` is the robot of [`RunKind::Arm`].
///
/// # Errors
/// No draw stays within the joints' limits, or an arm's run is asked for without an arm.
pub fn draw(id: &RunId, seed: u64, arm: Option<&ObjectModel>) -> Result<Scenario, EvaluationError> {
    let mut last = String::from("nothing was tried");
    for attempt in 0..24u64 {
        let rng = Random::new(seed ^ number_of(&id.to_string()), &format!("scenario {attempt}"));
        match attempt_at(id, seed, arm, rng) {
            Ok(Some(scenario)) => return Ok(scenario),
            Ok(None) => last = "it left the joints' limits, or stood still".into(),
            Err(EvaluationError::Diverged { time }) => last = format!("the motion ran away at {time:.2} s"),
            Err(other) => return Err(other),
        }
    }
    Err(EvaluationError::NoScenario { id: id.to_string(), message: last })
}

/// The mechanism on which it can be shown; none where there is no such.
fn staged(
    id: &RunId,
    names: &[&'static str],
    arm: Option<&ObjectModel>,
    rng: &mut Random,
) -> Result<Option<(Kind, Stage)>, EvaluationError> {
    let kinds: Vec<Kind> = match (id.kind, names.first()) {
        (RunKind::Arm, _) => vec![Kind::Arm],
        (_, None) => vec![Kind::Door, Kind::Drawer, Kind::OvenDoor, Kind::Pendulum, Kind::ServoLink, Kind::PlanarArm],
        (RunKind::Outside, _) => vec![Kind::Door, Kind::Drawer, Kind::OvenDoor, Kind::Pendulum, Kind::ServoLink],
        (_, Some(_)) => {
            let all = priors::stages(names[0]).to_vec();
            all.into_iter().filter(|k| names.iter().all(|n| priors::stages(n).contains(k))).collect()
        }
    };
    let Some(kind) = rng.pick(&kinds) else { return Ok(None) };
    let losses = if id.kind == RunKind::Clean && rng.chance(0.7) {
        Losses { damping: Some(true), friction: Some(rng.chance(0.6)) }
    } else {
        priors::losses(names)
    };
    let servo = names.iter().all(|n| priors::allows_servo(n)) && rng.chance(0.4);
    let Some(mut stage) = Stage::draw(kind, losses, servo, arm, rng) else {
        return Err(EvaluationError::Model { message: "a run with an arm needs a model of one".into() });
    };
    if stage.driving == Driving::Hand && kind == Kind::Pendulum && names.iter().any(|n| priors::needs_command(n)) {
        stage.driving = Driving::Torque;
        let joint = stage.known.moving_joints().next().map(|j| stage.known.joints[j].name.clone()).unwrap_or_default();
        let law = sagci_model::ActuatorLaw::Torque { max_effort: f64::INFINITY };
        let drives = vec![sagci_model::Actuator { joint, law, refit: BTreeMap::new() }];
        stage.known.document.actuators.clone_from(&drives);
        stage.body.document.actuators = drives;
    }
    Ok(Some((kind, stage)))
}

/// One draw; none where it leaves the joints' limits or stands still.
fn attempt_at(id: &RunId, seed: u64, arm: Option<&ObjectModel>, mut rng: Random) -> Result<Option<Scenario>, EvaluationError> {
    let level = id.level.clamp(1, 3) - 1;
    let names = choose_effects(id, &mut rng);
    let telling = rng.chance(0.6);

    let Some((kind, stage)) = staged(id, &names, arm, &mut rng)? else { return Ok(None) };
    let moving: Vec<usize> = stage.known.moving_joints().collect();
    let n = moving.len();
    let programme = Programme::draw(&names, telling, kind, &stage, &mut rng);

    // What the mechanism does without the effect, and an effect of a size to match.
    let known = Rigid::new(&stage.known)?;
    let hand = Hand { driving: stage.driving, known: &known, most: None };
    let mut bare = RungeKutta::new(Mechanism::new(&stage.body, &[])?, longest_step(kind))?;
    let runs = programme.train.iter().map(|p| p.carried_out(&mut bare, &hand)).collect::<Result<Vec<Run>, _>>()?;
    let Some(scales) = secret::scales(&stage.known, &known, &runs, programme.lasts) else { return Ok(None) };
    let Some(secret) = Secret::draw(&names, &stage.known, &scales, level, &mut rng) else { return Ok(None) };

    // The true motion.
    let engine = engine_for(kind, &names, &mut rng);
    let mechanism = secret.put_into(&stage.body)?;
    let mut plant = engine.plant(mechanism.clone())?;
    let run_all = |plans: &[Plan], plant: &mut dyn Plant| -> Result<Vec<Run>, EvaluationError> {
        plans.iter().map(|p| p.carried_out(plant, &hand)).collect()
    };
    let train_runs = run_all(&programme.train, plant.as_mut())?;
    let held_runs = run_all(&programme.held_out, plant.as_mut())?;
    for (j, &joint) in moving.iter().enumerate() {
        let limits = stage.known.joints[joint].limits;
        let all: Vec<f64> = train_runs.iter().chain(&held_runs).flat_map(|r| r.q.iter().chain(&r.position)).map(|q| q[j]).collect();
        if all.iter().any(|&q| q <= limits.lower + 0.01 || q >= limits.upper - 0.01) {
            return Ok(None);
        }
    }

    // What the sensors make of it.
    let ranges: Vec<f64> = (0..n).map(|j| extent(&train_runs, j)).map(|(low, high)| high - low).collect();
    let position_noise = position_noise(&stage, NOISE[level][0]);
    let effort_noise: Vec<f64> = (0..n)
        .map(|j| {
            let most = train_runs.iter().flat_map(|r| &r.delivered).fold([f64::MAX, f64::MIN], |m, u| [m[0].min(u[j]), m[1].max(u[j])]);
            NOISE[level][1] * (most[1] - most[0])
        })
        .collect();
    let sensors = Sensors {
        joints: moving.iter().map(|&j| stage.known.joints[j].name.clone()).collect(),
        driving: stage.driving,
        noise: [position_noise, effort_noise],
        with_velocity: rng.chance(0.35),
        with_effort: stage.driving != Driving::Hand && (rng.chance(0.25) || secret.is_of_efforts()),
        physics: mechanism.joints[mechanism.base..].to_vec(),
    };
    let log = |runs: &[Run], word: &str, rng: &mut Random| -> Vec<Log> {
        runs.iter().enumerate().map(|(i, r)| sensors.log(r, &format!("{word}_{}", i + 1), programme.in_session && i > 0, rng)).collect()
    };
    let given =
        Given { model: stage.known.clone(), train: log(&train_runs, "train", &mut rng), held_out: log(&held_runs, "held_out", &mut rng) };

    // What can be known.
    let hidden = told(&secret, (&stage, kind), &sensors, &train_runs, &scales)?;
    let oracle_gap = {
        let mut truth = RungeKutta::new(secret.put_into(&stage.body)?, longest_step(kind))?;
        oracle::gap(&mut truth, &held_runs, &given.held_out, &moving, &stage.known, &ranges, stage.driving == Driving::Hand)
    };
    let truth = SealedTruth {
        id: id.clone(),
        seed,
        hidden,
        mechanism: kind.word().into(),
        engine: if engine.by_rapier { "rapier" } else { "runge_kutta" }.into(),
        step: engine.step,
        joints: sensors.joints.clone(),
        ranges,
        families: programme.words(),
        noise: sensors.noise.clone(),
        known_losses: moving.iter().map(|&j| &stage.body.joints[j]).map(|j| (j.name.clone(), [j.damping, j.friction])).collect(),
        oracle_gap,
    };
    let greatest = |j: usize| train_runs.iter().flat_map(|r| &r.delivered).fold(0.0f64, |most, u| most.max(u[j].abs()));
    let middle = |j: usize| stage.range[j].iter().sum::<f64>() / 2.0;
    let bench = Bench {
        most: (0..n).map(greatest).collect(),
        middle: (0..n).map(middle).collect(),
        seed: seed ^ number_of(&id.to_string()),
        stage,
        mechanism,
        engine,
        sensors,
        rate: programme.rate,
        follow: programme.follow,
    };
    Ok(Some(Scenario { given, truth, bench }))
}

/// The engine that moves the true mechanism, and its step: what is stiff asks for short ones.
fn engine_for(kind: Kind, names: &[&str], rng: &mut Random) -> Engine {
    let by_rapier = rng.chance(0.6);
    const STIFF: [&str; 5] = ["backlash", "hard_stop", "presliding_hysteresis", "joint_elasticity", "loose_mass"];
    let stiff = names.iter().any(|n| STIFF.contains(n));
    let step = match (kind, by_rapier) {
        _ if stiff => rng.between(1.2e-4, 2e-4),
        (Kind::Arm, true) => 5e-4,
        (Kind::Arm, false) => 2e-3,
        (_, true) => rng.between(2.5e-4, 5e-4),
        (_, false) => rng.between(2e-4, 5e-4),
    };
    Engine { by_rapier, step }
}

/// Longest step in which a mechanism without anything hidden, or the truth for comparison, is moved, s.
fn longest_step(kind: Kind) -> f64 {
    if kind == Kind::Arm { 4e-3 } else { 1e-3 }
}

/// What is hidden, and how well it shows in what was recorded.
fn told(
    secret: &Secret,
    (stage, kind): (&Stage, Kind),
    sensors: &Sensors,
    runs: &[Run],
    scales: &[Scale],
) -> Result<Vec<Hidden>, EvaluationError> {
    let drifts: Vec<[f64; 2]> = sensors.physics.iter().map(|s| s.sensor.effort_drift).collect();
    let one = |(entry, &j): (&EffectEntry, &usize)| {
        let slow = entry.parameters.get("stribeck_velocity").map_or(1.0, |vs| slow_share(runs, j, *vs));
        let (low, high) = extent(runs, j);
        let at = Circumstances { joints: scales.len(), turns: scales[j].turns, range: high - low, gravity: kind.feels_gravity(), slow };
        let others: Vec<EffectEntry> = secret.of_catalogue().filter(|e| e.effect != entry.effect).cloned().collect();
        let problem = oracle::Problem {
            body: &stage.body,
            others: &others,
            entry: &entry.effect,
            joint: j,
            scale: (scales[j].effort, scales[j].velocity, scales[j].range),
            runs,
            readings: sensors.noise.each_ref().map(Vec::as_slice),
            effort_is_measured: stage.driving == Driving::Hand,
            known: &stage.known,
            effort_drift: &drifts,
        };
        Ok(Hidden {
            entry: entry.clone(),
            indistinguishable: indistinguishable(entry, &at).into_iter().map(str::to_owned).collect(),
            detectability: oracle::detect(&problem)?,
        })
    };
    secret.entries.iter().zip(&secret.joints).map(one).collect()
}

/// Share of the moving samples below twice a velocity.
fn slow_share(runs: &[Run], j: usize, velocity: f64) -> f64 {
    let speeds: Vec<f64> = runs.iter().flat_map(|r| &r.v).map(|v| v[j].abs()).filter(|v| *v > 1e-6).collect();
    speeds.iter().filter(|v| **v < 2.0 * velocity).count() as f64 / speeds.len().max(1) as f64
}

/// The effects of a run.
fn choose_effects(id: &RunId, rng: &mut Random) -> Vec<&'static str> {
    let named = CATALOGUE.iter().chain(&OUTSIDE).copied().find(|n| *n == id.effect);
    match id.kind {
        RunKind::Clean => Vec::new(),
        RunKind::Single | RunKind::Outside => named.into_iter().collect(),
        RunKind::Arm => named.or_else(|| rng.pick(&priors::ON_AN_ARM)).into_iter().collect(),
        RunKind::Double | RunKind::Triple => {
            let count = if id.kind == RunKind::Double { 2 } else { 3 };
            loop {
                let mut names: Vec<&'static str> = Vec::new();
                for _ in 0..60 {
                    let Some(name) = rng.pick(&CATALOGUE) else { break };
                    if compatible(name, &names) {
                        names.push(name);
                    }
                    if names.len() == count {
                        return names;
                    }
                }
            }
        }
    }
}

/// May this effect join these? Not where one is a special case of the other, or one column of both cannot be split.
fn compatible(name: &str, with: &[&str]) -> bool {
    const GROUPS: [&[&str]; 7] = [
        &[
            "coulomb_friction",
            "asymmetric_friction",
            "stribeck_friction",
            "presliding_hysteresis",
            "load_dependent_friction",
            "position_dependent_friction",
            "cable_hysteresis",
            "thermal_wear",
        ],
        &["viscous_friction", "asymmetric_friction", "cable_hysteresis", "thermal_wear"],
        &["joint_spring", "hinge_tilt", "torque_bias", "cable_hysteresis", "encoder_offset", "joint_axis_error", "sensor_drift", "payload"],
        &["transport_delay", "clock_skew", "actuator_lag", "joint_elasticity", "backlash", "unmodelled_mode"],
        &["armature_inertia", "torque_gain", "payload", "joint_elasticity", "backlash"],
        &["magnetic_gasket", "air_suction", "latch", "soft_close_damper", "detent", "hard_stop"],
        &["encoder_offset", "clock_skew", "sensor_drift"],
    ];
    let clash = |a: &str, b: &str| a == b || GROUPS.iter().any(|g| g.contains(&a) && g.contains(&b));
    let shared = |names: &[&str]| priors::stages(names[0]).iter().any(|k| names.iter().all(|n| priors::stages(n).contains(k)));
    let together: Vec<&str> = with.iter().copied().chain([name]).collect();
    with.iter().all(|w| !clash(w, name)) && shared(&together)
}
