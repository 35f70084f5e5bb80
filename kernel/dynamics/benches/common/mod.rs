//! What all benches share: the rows to run, the clock, and the peers' models.
//!
//! A row prints its microseconds a call, median and least over repetitions. Compare only with figures from the same machine and run.
//! `--row NAME` runs that row alone (whole name). `--once` makes one round of it, inside [`counted`], for counting instructions.
#![allow(dead_code, clippy::unwrap_used, missing_docs)]

use std::path::{Path, PathBuf};
use std::time::Instant;

use sagci_model::ObjectModel;

/// Seconds of one repetition, and how many there are.
const REPETITION: f64 = 0.08;
const REPETITIONS: usize = 11;

pub struct Bench {
    once: bool,
    row: Option<String>,
    epoch: Instant,
}

impl Bench {
    pub fn from_arguments() -> Self {
        let arguments: Vec<String> = std::env::args().collect();
        let row = arguments.iter().position(|a| a == "--row").and_then(|i| arguments.get(i + 1)).cloned();
        Self { once: arguments.iter().any(|a| a == "--once"), row, epoch: Instant::now() }
    }

    pub fn wants(&self, name: &str) -> bool {
        self.row.as_ref().is_none_or(|row| row == name)
    }

    /// Times `round`, which makes `calls` calls. Gives the least time of one.
    pub fn row(&self, name: &str, calls: usize, mut round: impl FnMut()) -> f64 {
        if !self.wants(name) {
            return f64::NAN;
        }
        round();
        if self.once {
            counted(&mut round);
            println!("{calls} calls: {name}");
            return f64::NAN;
        }
        let clock = Instant::now();
        round();
        let rounds = (REPETITION / clock.elapsed().as_secs_f64().max(1e-9)).ceil() as usize;
        let mut times: Vec<f64> = (0..REPETITIONS)
            .map(|_| {
                let start = self.clock();
                for _ in 0..rounds {
                    round();
                }
                (self.clock() - start) / (rounds * calls) as f64 * 1e6
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!("{:10.3} {:10.3}  {name}", times[times.len() / 2], times[0]);
        times[0]
    }

    /// Seconds that this thread has run, as the scheduler counts them: another process on the machine does not add to them. The
    /// scheduler brings the count up to date when the thread yields. Wall time where the system does not tell.
    fn clock(&self) -> f64 {
        std::thread::yield_now();
        let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
        let ran = told.and_then(|t| t.split_whitespace().next()?.parse::<f64>().ok());
        ran.map_or_else(|| self.epoch.elapsed().as_secs_f64(), |ns| ns * 1e-9)
    }
}

/// Only what runs in here is counted by `tests/peers/instruction_counts.sh`.
#[inline(never)]
pub fn counted(round: &mut dyn FnMut()) {
    round();
    std::hint::black_box(());
}

/// Where the models of the comparison with peers lie.
pub fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/models")
}

pub fn model(name: &str) -> ObjectModel {
    ObjectModel::read_urdf(models().join(name).with_extension("urdf")).unwrap()
}

/// The scene that all peers start from: states and efforts.
pub struct Scene(serde_json::Value);

impl Scene {
    pub fn read() -> Self {
        Self(serde_json::from_str(&std::fs::read_to_string(models().join("scene.json")).unwrap()).unwrap())
    }

    pub fn numbers(&self, path: &[&str]) -> Vec<f64> {
        let value = path.iter().fold(&self.0, |value, key| &value[*key]);
        value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    }
}
