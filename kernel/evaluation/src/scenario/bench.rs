//! The true mechanism with its drives and its sensors. What is recorded is recorded on it: the first data, and what a workflow asks for next.

use nalgebra::DMatrix;
use sagci_model::JointKind;
use sagci_recording::{CommandKind, JointLog, Log, Series};
use serde_json::Value;

use super::asked::{Led, Path};
use super::excitation::Reference;
use super::stage::{Driving, Stage};
use crate::EvaluationError;
use crate::effect::{Hold, JointPhysics};
use crate::plant::{Mechanism, Plant, Rapier, Rigid, RungeKutta};
use crate::random::{Random, number_of};
use crate::simulate::{Run, simulate};

/// How far beyond the first data's efforts a hand goes in an experiment.
const BEYOND: f64 = 1.5;
/// How near its limits a joint may come in an experiment, as a share of the way between them; there the hand stops.
const MARGIN: f64 = 0.005;

/// What leads a joint.
pub(super) trait Leads {
    /// Where the joint begins.
    fn start(&self) -> f64;
    /// Where a servo should be.
    fn target(&self, t: f64) -> f64;
    /// Acceleration that a hand or a controller asks for, without gravity.
    fn wanted(&self, t: f64, q: f64, v: f64) -> f64;
    /// Is gravity left to act?
    fn lets_go(&self, t: f64) -> bool;
}

impl Leads for Reference {
    fn start(&self) -> f64 {
        self.start()
    }

    fn target(&self, t: f64) -> f64 {
        self.at(t).r
    }

    fn wanted(&self, t: f64, q: f64, v: f64) -> f64 {
        self.wanted(t, q, v)
    }

    fn lets_go(&self, _: f64) -> bool {
        self.lets_go()
    }
}

/// The numerics of a mechanism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Engine {
    pub by_rapier: bool,
    /// Longest step, s.
    pub step: f64,
}

impl Engine {
    pub fn plant(self, mechanism: Mechanism) -> Result<Box<dyn Plant>, EvaluationError> {
        Ok(if self.by_rapier { Box::new(Rapier::new(mechanism, self.step)?) } else { Box::new(RungeKutta::new(mechanism, self.step)?) })
    }
}

/// What moves a mechanism and by what it is carried.
pub(super) struct Hand<'a> {
    pub driving: Driving,
    /// The bodies as the model has them: by these the hand carries what it moves.
    pub known: &'a Rigid,
    /// The most that it gives at each joint, N m or N.
    pub most: Option<&'a [f64]>,
}

impl Hand<'_> {
    /// Leads each joint along the stamps.
    pub fn lead(&self, plant: &mut dyn Plant, time: &[f64], leads: &[&dyn Leads]) -> Result<Run, EvaluationError> {
        let from = time.first().copied().unwrap_or(0.0);
        let start: Vec<f64> = leads.iter().map(|l| l.start()).collect();
        let still = vec![0.0; start.len()];
        let mass: DMatrix<f64> = self.known.at(&start, &still).0;
        let mut input = |_: usize, t: f64, q: &[f64], v: &[f64]| -> Vec<Hold> {
            let gravity = self.known.gravity(q);
            let hold = |(j, lead): (usize, &&dyn Leads)| match self.driving {
                Driving::Servo { stiffness, damping } => Hold::Servo { stiffness, damping, target: lead.target(t - from) },
                Driving::Hand | Driving::Torque => {
                    let weight = if lead.lets_go(t - from) { 0.0 } else { gravity[j] };
                    let most = self.most.map_or(f64::INFINITY, |most| most[j]);
                    Hold::Effort((weight + mass[(j, j)] * lead.wanted(t - from, q[j], v[j])).clamp(-most, most))
                }
            };
            leads.iter().enumerate().map(hold).collect()
        };
        simulate(plant, time, &[], (&start, &still), &mut input)
    }
}

/// Sensors of a mechanism, and what they write down.
#[derive(Debug, Clone)]
pub(super) struct Sensors {
    /// Names of the joints that move, and how they are moved.
    pub joints: Vec<String>,
    pub driving: Driving,
    /// Standard deviations of positions, rad or m, and of efforts, N m or N, by joint.
    pub noise: [Vec<f64>; 2],
    pub with_velocity: bool,
    pub with_effort: bool,
    pub physics: Vec<JointPhysics>,
}

impl Sensors {
    pub fn log(&self, run: &Run, source: &str, continues: bool, rng: &mut Random) -> Log {
        let mut joints = Vec::new();
        for (j, name) in self.joints.iter().enumerate() {
            let noisy = |value: f64, size: f64, rng: &mut Random| value + size * rng.normal();
            let all = |value: Vec<f64>| Series { time: run.time.clone(), value };
            let position = all(run.position.iter().map(|p| noisy(p[j], self.noise[0][j], rng)).collect());
            // Velocities as drives give them: differences of a fine encoder, filtered; about thirty times the position's noise a second.
            let velocity =
                self.with_velocity.then(|| all(run.velocity.iter().map(|v| noisy(v[j], 30.0 * self.noise[0][j], rng)).collect()));
            let [bias, rate] = self.physics[j].sensor.effort_drift;
            let hand = self.driving == Driving::Hand;
            let effort = (hand || self.with_effort).then(|| {
                let value = (0..run.time.len()).map(|k| noisy(run.delivered[k][j], self.noise[1][j], rng) + bias + rate * run.time[k]);
                all(value.collect())
            });
            let value = |k: usize| match run.hold[k][j] {
                Hold::Effort(u) => u,
                Hold::Servo { target, .. } => target,
            };
            let command = match self.driving {
                Driving::Hand => None,
                Driving::Torque => Some((CommandKind::Effort, all((0..run.time.len()).map(value).collect()))),
                Driving::Servo { .. } => Some((CommandKind::Position, all((0..run.time.len()).map(value).collect()))),
            };
            joints.push(JointLog { name: name.clone(), position, velocity, effort, command, command_gaps: Vec::new() });
        }
        let log = Log {
            source: format!("{source}.csv"),
            hash: String::new(),
            joints,
            wrenches: Vec::new(),
            is_table: true,
            notes: Vec::new(),
            continues,
            epoch: 0,
        };
        log.hashed()
    }
}

/// A run's mechanism as it stands in the laboratory. Whoever is given the data may ask for an experiment on it, and sees but what the sensors
/// write down.
#[derive(Debug, Clone)]
pub struct Bench {
    pub(super) stage: Stage,
    pub(super) mechanism: Mechanism,
    pub(super) engine: Engine,
    pub(super) sensors: Sensors,
    /// Samples a second, and the pace of the hand, rad/s.
    pub(super) rate: f64,
    pub(super) follow: f64,
    /// The greatest effort at each joint in the first data, and the middle of its way.
    pub(super) most: Vec<f64>,
    pub(super) middle: Vec<f64>,
    pub(super) seed: u64,
}

impl Bench {
    /// Does what an answer asks for in `next_experiment`, as `FORMAT.md` of the workflow describes it: leads the joint along, holds the others,
    /// and stops where a limit is near. None where that is no motion, as where something outside has to change or be measured, or where it begins
    /// at a limit.
    ///
    /// # Errors
    /// The motion runs away.
    pub fn perform(&self, experiment: &Value, number: usize) -> Result<Option<Log>, EvaluationError> {
        let joint = self.sensors.joints.iter().position(|name| experiment["joint"].as_str() == Some(name));
        let period = 1.0 / self.rate;
        let Some((joint, path)) = joint.zip(Path::of(&experiment["reference"], period)) else { return Ok(None) };
        let time: Vec<f64> = (0..path.len()).map(|k| k as f64 * period).collect();
        let led = |(j, q): (usize, &f64)| {
            let path = if j == joint { path.clone() } else { Path::held(*q, path.len(), period) };
            Led { path, follow: self.follow }
        };
        let led: Vec<Led> = self.middle.iter().enumerate().map(led).collect();
        let leads: Vec<&dyn Leads> = led.iter().map(|l| l as &dyn Leads).collect();
        let most: Vec<f64> = self.most.iter().map(|u| BEYOND * u).collect();
        let known = Rigid::new(&self.stage.known)?;
        let hand = Hand { driving: self.stage.driving, known: &known, most: Some(&most) };
        let mut run = hand.lead(self.engine.plant(self.mechanism.clone())?.as_mut(), &time, &leads)?;
        let rows = self.rows_within_limits(&run);
        if rows < 2 {
            return Ok(None);
        }
        run.truncate(rows);
        let mut rng = Random::new(self.seed ^ number_of(&format!("experiment {number}")), "experiment");
        Ok(Some(self.sensors.log(&run, &format!("experiment_{number}"), false, &mut rng)))
    }

    /// How many rows there are until the hand stops.
    fn rows_within_limits(&self, run: &Run) -> usize {
        let moving: Vec<usize> = self.stage.known.moving_joints().collect();
        let within = |q: &Vec<f64>| {
            moving.iter().zip(q).all(|(j, q)| {
                let limits = self.stage.known.joints[*j].limits;
                let margin = if limits.range().is_finite() { MARGIN * limits.range() } else { 0.0 };
                (limits.lower + margin..=limits.upper - margin).contains(q)
            })
        };
        run.q.iter().take_while(|q| within(q)).count()
    }
}

/// Standard deviations of positions by joint, rad or m, where joints that turn have so much.
pub(super) fn position_noise(stage: &Stage, of_turning: f64) -> Vec<f64> {
    let kinds = stage.known.moving_joints().map(|j| stage.known.joints[j].kind);
    kinds.map(|kind| of_turning * if kind == JointKind::Prismatic { 0.4 } else { 1.0 }).collect()
}
