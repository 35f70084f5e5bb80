//! `cargo run --release -p sagci-training -- --out FILE`: trains the networks that read object models off point clouds.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, ValueEnum};
use sagci_modelling::Weights;
use sagci_training::{
    Settings, TrainingError, lessons, mean, train, train_border, train_evidence, train_masks, train_more_masks, train_place, train_trust,
};

/// Trains the networks that read object models off point clouds. Without settings, by the rounds of the weights that ship.
#[derive(Debug, Parser)]
struct Arguments {
    /// Everything is drawn from it.
    #[arg(long)]
    seed: Option<u64>,
    /// Objects that are learned from.
    #[arg(long)]
    objects: Option<u64>,
    /// How many of them are drawn at a time; without it all.
    #[arg(long)]
    at_once: Option<u64>,
    /// How often each is seen, before the next are drawn.
    #[arg(long)]
    epochs: Option<usize>,
    /// Objects a step.
    #[arg(long)]
    batch: Option<usize>,
    /// Greatest rate of learning.
    #[arg(long)]
    rate: Option<f64>,
    /// Share that stays of the weights that it goes on from.
    #[arg(long)]
    kept: Option<f64>,
    /// Objects of a round that are looked at only.
    #[arg(long, default_value_t = 500)]
    checked: u64,
    /// Threads; their number does not change the result.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Trains nothing but the last heads, all of them or those that are named.
    #[arg(long, requires = "from", value_name = "HEAD", num_args = 0.., value_delimiter = ',')]
    heads: Option<Vec<Head>>,
    /// Weights to go on from; of several their mean, which is written as it is where nothing else is asked for.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    from: Vec<PathBuf>,
    /// The file to write.
    #[arg(long)]
    out: PathBuf,
}

/// What makes weights like those that ship: one round after the other, each on objects of its own. What a round does not say is as in the
/// first. They were run before clouds were thinned and cut, or families drawn, as they are now; `world-models/perception/README.md` says how
/// the last heads went on from there.
const ROUNDS: [Settings; 10] = [
    Settings { seed: 1, objects: 8000, at_once: 8000, epochs: 8, batch: 16, rate: 2e-3, kept: 0.0 },
    Settings { seed: 2, objects: 6000, at_once: 6000, epochs: 6, batch: 16, rate: 1.5e-3, kept: 0.0 },
    Settings { seed: 3, objects: 8000, at_once: 8000, epochs: 8, batch: 16, rate: 1.5e-3, kept: 0.0 },
    Settings { seed: 5, objects: 7000, at_once: 7000, epochs: 6, batch: 16, rate: 1e-3, kept: 0.0 },
    Settings { seed: 6, objects: 14_000, at_once: 14_000, epochs: 5, batch: 16, rate: 1e-3, kept: 0.0 },
    Settings { seed: 7, objects: 16_000, at_once: 16_000, epochs: 5, batch: 16, rate: 1e-3, kept: 0.0 },
    Settings { seed: 8, objects: 8000, at_once: 8000, epochs: 4, batch: 16, rate: 8e-4, kept: 0.3 },
    Settings { seed: 10, objects: 10_000, at_once: 10_000, epochs: 4, batch: 16, rate: 8e-4, kept: 0.3 },
    Settings { seed: 11, objects: 10_000, at_once: 10_000, epochs: 4, batch: 16, rate: 8e-4, kept: 0.3 },
    Settings { seed: 12, objects: 27_000, at_once: 3000, epochs: 2, batch: 16, rate: 1.2e-3, kept: 0.0 },
];

/// The heads that come last, one after the other, each on what all before it make of fresh objects: after every round they are trained anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Head {
    /// Which groups of pieces are parts.
    Masks,
    /// The same, going on from what is known.
    MoreMasks,
    /// Where parts end.
    Border,
    /// What is to be trusted.
    Trust,
    /// What says that parts move.
    Evidence,
    /// Where hinges are.
    Place,
}

const MASKS: Settings = Settings { seed: 31, objects: 18_000, at_once: 6000, epochs: 3, batch: 16, rate: 1.5e-3, kept: 0.0 };
const MORE_MASKS: Settings = Settings { seed: 33, objects: 28_000, at_once: 4000, epochs: 3, batch: 16, rate: 1.2e-3, kept: 0.0 };
const BORDER: Settings = Settings { seed: 21, objects: 6000, at_once: 6000, epochs: 4, batch: 16, rate: 3e-3, kept: 0.0 };
const TRUST: Settings = Settings { seed: 41, objects: 6000, at_once: 6000, epochs: 4, batch: 16, rate: 2e-3, kept: 0.0 };
const EVIDENCE: Settings = Settings { seed: 51, objects: 8000, at_once: 8000, epochs: 8, batch: 16, rate: 2e-3, kept: 0.0 };
const PLACE: Settings = Settings { seed: 61, objects: 24_000, at_once: 24_000, epochs: 16, batch: 16, rate: 2e-3, kept: 0.0 };

/// Trains a head by settings, beside weights that stay.
type TrainHead = fn(&Settings, &Weights, &mut dyn FnMut(&str)) -> Result<Weights, TrainingError>;

impl Head {
    /// How it is trained, and by which settings.
    fn training(self) -> (TrainHead, Settings) {
        match self {
            Self::Masks => (train_masks, MASKS),
            Self::MoreMasks => (train_more_masks, MORE_MASKS),
            Self::Border => (train_border, BORDER),
            Self::Trust => (train_trust, TRUST),
            Self::Evidence => (train_evidence, EVIDENCE),
            Self::Place => (train_place, PLACE),
        }
    }
}

impl Arguments {
    /// Was none of the settings given?
    fn plain(&self) -> bool {
        let numbers =
            self.seed.is_some() || self.objects.is_some() || self.at_once.is_some() || self.epochs.is_some() || self.batch.is_some();
        !numbers && self.rate.is_none() && self.kept.is_none()
    }

    /// The settings that were given, the others as usual.
    fn settings(&self, usual: Settings) -> Settings {
        Settings {
            seed: self.seed.unwrap_or(usual.seed),
            objects: self.objects.unwrap_or(usual.objects),
            at_once: self.at_once.or(self.objects).unwrap_or(usual.at_once),
            epochs: self.epochs.unwrap_or(usual.epochs),
            batch: self.batch.unwrap_or(usual.batch),
            rate: self.rate.unwrap_or(usual.rate),
            kept: self.kept.unwrap_or(usual.kept),
        }
    }

    /// The rounds that are asked for, the last heads apart.
    fn rounds(&self) -> Vec<Settings> {
        match (self.from.len(), self.plain()) {
            _ if self.heads.is_some() => Vec::new(),
            (0, true) => ROUNDS.to_vec(),
            // Their mean is all that is asked for.
            (2.., true) => Vec::new(),
            _ => vec![self.settings(ROUNDS[0])],
        }
    }

    /// The last heads that are asked for, in their order.
    fn last(&self) -> Vec<Head> {
        let all = Head::value_variants().iter().copied();
        match &self.heads {
            Some(named) if !named.is_empty() => all.filter(|h| named.contains(h)).collect(),
            Some(_) => all.collect(),
            None if self.from.is_empty() && self.plain() => all.collect(),
            None => Vec::new(),
        }
    }
}

/// What is added to the seed of the objects that are learned from, for those that are not.
const FRESH: u64 = 1_000;

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}

fn run(a: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    rayon::ThreadPoolBuilder::new().num_threads(a.threads).build_global()?;
    let from: Vec<Weights> = a.from.iter().map(|f| Weights::read(f)).collect::<Result<_, _>>()?;
    let mut weights = match from.len() {
        0 | 1 => from.into_iter().next(),
        _ => {
            let both = mean(&from)?;
            std::fs::write(&a.out, both.to_bytes()?)?;
            Some(both)
        }
    };
    let start = Instant::now();
    for settings in a.rounds() {
        // Others of the same families: the held-out ones are for the evaluation alone.
        let checked = lessons(settings.seed.wrapping_add(FRESH), 0..a.checked, false);
        let mut draw = |objects| lessons(settings.seed, objects, false);
        let trained = train(&settings, weights.as_ref(), &mut draw, &checked, &mut |line, so_far| {
            eprintln!("{:6.0} s  {line}", start.elapsed().as_secs_f64());
            // What was learned so far is kept, should the run be cut off.
            let bytes = so_far.to_bytes().map_err(|e| e.to_string());
            if let Err(e) = bytes.and_then(|b| std::fs::write(&a.out, b).map_err(|e| e.to_string())) {
                eprintln!("{}: {e}", a.out.display());
            }
        })?;
        let bytes = trained.to_bytes()?;
        std::fs::write(&a.out, &bytes)?;
        eprintln!("{}: {} bytes", a.out.display(), bytes.len());
        weights = Some(trained);
    }
    let mut log = |line: &str| eprintln!("{:6.0} s  {line}", start.elapsed().as_secs_f64());
    for head in a.last() {
        let Some(before) = &weights else { break };
        let (train, usual) = head.training();
        let made = train(&a.settings(usual), before, &mut log)?;
        std::fs::write(&a.out, made.to_bytes()?)?;
        weights = Some(made);
    }
    Ok(())
}
