//! Data that a model makes itself along measured ones, under the same inputs and with their noise: what is left of the gap on them is its floor.
//!
//! The motion is put back on the measured one every few windows, and led back to it between, so that it stays where the data are: beside an unstable
//! rest it would fall to where errors do not grow, and noise would seem to matter little. The forces that lead it are in the data, for the model to
//! take.

use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::GapError;
use crate::noise;
use crate::observer::Noise;
use crate::plant::{Motion, Plant};
use crate::trajectory::{Drive, Trajectory};
use crate::windows::Smoothed;

/// Share of the joints' ranges by which an invented motion strays from the measured one before it is brought back, and how fast it is, s.
const STRAYED: f64 = 0.01;
const BACK: f64 = 0.1;
/// Windows after which it is put back.
const WINDOWS: f64 = 4.0;

/// What invents data.
pub(crate) struct Inventor<'a> {
    pub plant: &'a Plant,
    /// The plant's run along the measured data.
    pub smoothed: &'a Smoothed,
    /// What data bring with them, and the noise of measured efforts by joint, N m or N.
    pub noise: &'a Noise,
    pub efforts: &'a [f64],
    /// Length of the windows, s, and the joints' ranges.
    pub window: f64,
    pub ranges: &'a [f64],
}

impl Inventor<'_> {
    /// Data along measured trajectories. Accelerations are at the most as noisy as they are given: what a plant lacks is none of their noise.
    pub fn invent(&self, trajectories: &[Trajectory], seed: u64) -> Vec<Trajectory> {
        let [positions, accelerations] = self.smoothed.factors;
        let noise = self.noise.times([positions, accelerations.min(1.0)]);
        let mut random = Pcg64::seed_from_u64(seed);
        let mut normal = move || noise::normal(&mut random);
        let mut motion = self.plant.motion();
        let mut invented = trajectories.to_vec();
        for (index, (trajectory, original)) in invented.iter_mut().zip(trajectories).enumerate() {
            let mut way = Way { inventor: self, index, motion: &mut motion, guided: original.clone() };
            let (n, mut until) = (trajectory.joints, f64::NEG_INFINITY);
            trajectory.starts.clear();
            for k in 0..original.rows() {
                let anew = original.starts.contains(&k) || original.time[k] >= until;
                // What gets lost on its way, pushed by noise, begins anew as well.
                if anew || way.goes_on(k).is_err() || way.is_off(k, 1.0) {
                    self.smoothed.set(way.motion, original, index, k);
                    trajectory.starts.push(k);
                    until = original.time[k] + WINDOWS * self.window;
                } else {
                    way.push(&noise, original, k, &mut normal);
                }
                way.motion.state.time = original.time[k];
                for (j, effort) in self.efforts.iter().enumerate() {
                    if original.position[k * n + j].is_finite() {
                        trajectory.position[k * n + j] = self.plant.reading(way.motion, j) + noise.position[j] * normal();
                    }
                    if trajectory.drive[j] == Drive::Effort {
                        trajectory.input[k * n + j] += effort * normal();
                    }
                }
            }
            trajectory.external = way.guided.external;
        }
        invented
    }
}

/// An invented motion along one trajectory.
struct Way<'a> {
    inventor: &'a Inventor<'a>,
    index: usize,
    motion: &'a mut Motion,
    /// The measured inputs with the forces that have led it so far, N m or N.
    guided: Trajectory,
}

impl Way<'_> {
    /// Is it further from the measured motion than a share of the joints' ranges?
    fn is_off(&self, row: usize, share: f64) -> bool {
        let Inventor { smoothed, ranges, .. } = self.inventor;
        let measured = &smoothed.runs[self.index].q[row * ranges.len()..];
        let q = &self.motion.state.q;
        q.iter().zip(measured).zip(*ranges).any(|((q, y), range)| (q - y).is_nan() || (q - y).abs() > share * range)
    }

    /// Goes on until row `k`, and back to the measured motion where it has strayed from it.
    fn goes_on(&mut self, k: usize) -> Result<(), GapError> {
        let Inventor { plant, smoothed, ranges, .. } = self.inventor;
        if !self.is_off(k - 1, STRAYED) {
            return plant.interval(self.motion, &self.guided, k - 1);
        }
        let Self { motion, guided, .. } = self;
        let (n, run) = (ranges.len(), &smoothed.runs[self.index]);
        guided.external.resize(guided.input.len(), 0.0);
        let (begin, h) = (motion.state.clone(), guided.time[k] - guided.time[k - 1]);
        plant.interval(motion, guided, k - 1)?;
        let to_way = |j: usize| run.v[k * n + j] + (run.q[k * n + j] - motion.state.q[j]) / BACK - motion.state.v[j];
        let accelerations: Vec<f64> = (0..n).map(|j| to_way(j) / h).collect();
        motion.state = begin;
        let efforts = plant.efforts_for(motion, &accelerations)?;
        guided.external[(k - 1) * n..k * n].iter_mut().zip(efforts).for_each(|(external, effort)| *external += effort);
        plant.interval(motion, guided, k - 1)
    }

    /// What no model has of the accelerations on the way to row `k`.
    fn push(&mut self, noise: &Noise, original: &Trajectory, k: usize, normal: &mut impl FnMut() -> f64) {
        let h = original.time[k] - original.time[k - 1];
        let doubted = self.doubted(original, k, normal);
        let state = &mut self.motion.state;
        for j in 0..original.joints {
            let [held, white] = noise.accelerations(original, k, j, false);
            let push = (held + white).sqrt() * normal() + doubted.get(j).copied().unwrap_or(0.0);
            state.v[j] += h * push;
            // What is white moves a joint by more than the mean of it does.
            state.q[j] += h * h * (0.5 * push + (white / 12.0).sqrt() * normal());
        }
        self.inventor.plant.clamp(self.motion);
    }

    /// Accelerations by what acts on the way to row `k` beside what was put in for it, drawn as it is doubted; empty where all was measured.
    fn doubted(&mut self, original: &Trajectory, k: usize, normal: &mut impl FnMut() -> f64) -> Vec<f64> {
        let n = original.joints;
        let Some(doubts) = original.doubt.get(k * n..(k + 1) * n).filter(|d| d.iter().any(|d| *d > 0.0)) else { return Vec::new() };
        let mut inverse = Vec::new();
        self.inventor.plant.inverse_mass(self.motion, &mut inverse);
        let efforts: Vec<f64> = doubts.iter().map(|d| d * normal()).collect();
        (0..n).map(|j| efforts.iter().enumerate().map(|(i, u)| inverse[i * n + j] * u).sum()).collect()
    }
}
