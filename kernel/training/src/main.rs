//! `cargo run --release -p sagci-training -- --out FILE`: trains the networks that read object models off point clouds.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use sagci_modelling::Weights;
use sagci_training::{Settings, lessons, train};

/// Trains the networks that read object models off point clouds. Left as they are, the settings are those of the weights that ship.
#[derive(Debug, Parser)]
struct Arguments {
    /// Everything is drawn from it.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Objects that are learned from.
    #[arg(long, default_value_t = 8000)]
    objects: u64,
    /// How often each is seen.
    #[arg(long, default_value_t = 8)]
    epochs: usize,
    /// Objects a step.
    #[arg(long, default_value_t = 16)]
    batch: usize,
    /// Greatest rate of learning.
    #[arg(long, default_value_t = 2e-3)]
    rate: f64,
    /// Threads; their number does not change the result.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Weights to go on from.
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// The file to write.
    #[arg(long)]
    out: PathBuf,
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
    let settings = Settings { seed: a.seed, objects: a.objects, epochs: a.epochs, batch: a.batch, rate: a.rate };
    let from = a.from.as_deref().map(Weights::read).transpose()?;
    let start = Instant::now();
    let taught = lessons(a.seed, a.objects, false);
    // Others of the same families: the held-out ones are for the evaluation alone.
    let checked = lessons(a.seed.wrapping_add(FRESH), 60, false);
    eprintln!("{} objects drawn and analysed in {:.0} s", taught.len(), start.elapsed().as_secs_f64());
    let weights = train(&settings, from.as_ref(), &taught, &checked, &mut |line, so_far| {
        eprintln!("{:6.0} s  {line}", start.elapsed().as_secs_f64());
        // What was learned so far is kept, should the run be cut off.
        if let Err(e) = so_far.to_bytes().map_err(|e| e.to_string()).and_then(|b| std::fs::write(&a.out, b).map_err(|e| e.to_string())) {
            eprintln!("{}: {e}", a.out.display());
        }
    })?;
    let bytes = weights.to_bytes()?;
    std::fs::write(&a.out, &bytes)?;
    eprintln!("{}: {} bytes", a.out.display(), bytes.len());
    Ok(())
}
