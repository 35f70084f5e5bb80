//! The robot's own sensors: joint encoders, joint torques, the gripper's, and the wrist's wrench estimate.
//!
//! Figures: joint positions come from 14-bit encoders on the motors, before gears of 100:1 (usual for arms with strain
//! wave gears). Velocities are their differences through a first-order low-pass of 100 Hz, the default cut-off of
//! Franka's libfranka (`kDefaultCutoffFrequency`). Torque, width, force and wrench noise are engineering estimates for
//! research arms.

use nalgebra::Vector3;
use sagci_signal::Wrench;

use crate::random::Random;

/// Standard deviations and resolutions of the robot's sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorNoise {
    /// Resolution of the joint encoders, rad or m.
    pub position_resolution: f64,
    /// Noise of the joint encoders, rad or m.
    pub position: f64,
    /// Cut-off frequency of the velocity filter, Hz.
    pub velocity_cutoff: f64,
    /// Noise of the measured joint efforts, N m or N.
    pub effort: f64,
    /// Noise of the gripper's width, m.
    pub width: f64,
    /// Noise of the gripper's force, N.
    pub grip: f64,
    /// Noise of the wrist's force, N.
    pub force: f64,
    /// Noise of the wrist's torque, N m.
    pub torque: f64,
    /// Greatest constant error of the wrist's force, N, drawn from the seed.
    pub force_bias: f64,
    /// Greatest constant error of the wrist's torque, N m, drawn from the seed.
    pub torque_bias: f64,
    /// Factor on the noise of the depth camera: 1 as its documentation has it, 0 for a perfect camera.
    pub depth: f64,
}

impl Default for SensorNoise {
    fn default() -> Self {
        Self {
            position_resolution: std::f64::consts::TAU / 16384.0 / 100.0,
            position: 1e-6,
            velocity_cutoff: 100.0,
            effort: 0.05,
            width: 5e-5,
            grip: 0.3,
            force: 0.1,
            torque: 0.005,
            force_bias: 0.2,
            torque_bias: 0.01,
            depth: 1.0,
        }
    }
}

impl SensorNoise {
    /// Perfect sensors; the velocity filter stays.
    pub const NONE: Self = Self {
        position_resolution: 0.0,
        position: 0.0,
        velocity_cutoff: 100.0,
        effort: 0.0,
        width: 0.0,
        grip: 0.0,
        force: 0.0,
        torque: 0.0,
        force_bias: 0.0,
        torque_bias: 0.0,
        depth: 0.0,
    };
}

/// What the robot's sensors would say if they were perfect.
pub(crate) struct Perfect<'a> {
    pub q: &'a [f64],
    pub tau: &'a [f64],
    pub width: f64,
    pub grip: f64,
    pub F_S: Wrench,
}

/// What they say.
pub(crate) struct Measured {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub tau: Vec<f64>,
    pub width: f64,
    pub grip: f64,
    pub F_S: Wrench,
}

/// The sensors with their memory.
pub(crate) struct Sensors {
    noise: SensorNoise,
    random: Random,
    period: f64,
    last_q: Option<Vec<f64>>,
    v: Vec<f64>,
    bias: Wrench,
}

impl Sensors {
    /// `random` draws the noise, `constant` the constant errors.
    pub(crate) fn new(noise: SensorNoise, period: f64, joints: usize, random: Random, constant: &mut Random) -> Self {
        let bias = Wrench { force: constant.in_ball() * noise.force_bias, torque: constant.in_ball() * noise.torque_bias };
        Self { noise, random, period, last_q: None, v: vec![0.0; joints], bias }
    }

    /// One sample, one control period after the last one.
    pub(crate) fn sample(&mut self, truth: &Perfect) -> Measured {
        let (noise, random) = (&self.noise, &mut self.random);
        let q: Vec<f64> = truth
            .q
            .iter()
            .map(|q| {
                let read = q + noise.position * random.normal();
                if noise.position_resolution > 0.0 { (read / noise.position_resolution).round() * noise.position_resolution } else { read }
            })
            .collect();
        if let Some(last) = &self.last_q {
            let gain = self.period / (self.period + 1.0 / (std::f64::consts::TAU * noise.velocity_cutoff));
            for ((v, now), before) in self.v.iter_mut().zip(&q).zip(last) {
                *v += gain * ((now - before) / self.period - *v);
            }
        }
        self.last_q = Some(q.clone());
        let mut noisy3 = |value: Vector3<f64>, bias: Vector3<f64>, deviation: f64| value + bias + random.normal3() * deviation;
        let F_S = Wrench {
            force: noisy3(truth.F_S.force, self.bias.force, noise.force),
            torque: noisy3(truth.F_S.torque, self.bias.torque, noise.torque),
        };
        Measured {
            q,
            v: self.v.clone(),
            tau: truth.tau.iter().map(|tau| tau + noise.effort * random.normal()).collect(),
            width: truth.width + noise.width * random.normal(),
            grip: truth.grip + noise.grip * random.normal(),
            F_S,
        }
    }
}
