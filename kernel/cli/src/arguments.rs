use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};

/// A robot that opens, fetches and puts away, by models of the things it handles.
#[derive(Debug, Parser)]
#[command(name = "sagci", version, propagate_version = true)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a task script in the measured world.
    Run(Run),
    /// Read a task script and say what is wrong in it; nothing moves.
    Check {
        /// The script.
        script: PathBuf,
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
    /// Find where a model and measurements disagree, and name the effect that is missing.
    Gap(Gap),
    /// Predict measured motion over windows of time, sample by sample.
    Simulate(Simulate),
    /// Make a model of an object that was never seen before from its point cloud.
    Perceive(Perceive),
    /// Try a part of the system on many cases whose truth is sealed, and print how often it is right.
    #[command(subcommand)]
    Evaluate(Evaluate),
    /// The library of object models.
    #[command(subcommand)]
    Models(Models),
    /// The skills that are found.
    #[command(subcommand)]
    Skills(Skills),
    /// Show a recording.
    Replay {
        /// The recording (.mcap).
        recording: PathBuf,
        /// Show the recorded states as they were, in the terminal.
        #[arg(long, required = true)]
        states: bool,
    },
    /// Look whether everything that a run needs is there.
    Doctor {
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
}

/// `sagci run`.
#[derive(Debug, Args)]
pub struct Run {
    /// The script.
    pub script: PathBuf,
    /// The measured world.
    #[arg(long, default_value = "rapier", value_parser = clap::builder::PossibleValuesParser::new(sagci_world::KINDS))]
    pub world: String,
    /// Seed of the world and of every random choice; with --runs, of the first run.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// How often to run, with one seed after the other.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub runs: u32,
    /// Folder for recordings and reports [default: a new one in runs/].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Plan every step from what is believed and predicted; nothing moves.
    #[arg(long)]
    pub plan_only: bool,
    /// How to print the result.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub format: Format,
    /// Where things are.
    #[command(flatten)]
    pub places: Places,
}

/// `sagci gap`.
#[derive(Debug, Args)]
pub struct Gap {
    /// An object of the library, or the path of a URDF or of a folder with an object.urdf; a model.yaml beside it is read. A name that the
    /// library has means its object; ./NAME is a folder here.
    pub model: String,
    /// Recordings to learn from: MCAP or CSV.
    #[arg(long, required = true, num_args = 1.., value_name = "LOG")]
    pub data: Vec<PathBuf>,
    /// Recordings that nothing is fitted to; whole ones of the data are set aside if there are none.
    #[arg(long, num_args = 1.., value_name = "LOG")]
    pub held_out: Vec<PathBuf>,
    /// Publish the model with what was found as a new version of the library's object.
    #[arg(long)]
    pub apply: bool,
    /// Publish also what held-out data do not confirm.
    #[arg(long, requires = "apply")]
    pub accept_unconfirmed: bool,
    /// Do the next experiment on the measured world by this script, such as scripts/experiment.rhai, and go on with what it recorded: twice at
    /// the most. The world has the seed of this command.
    #[arg(long, value_name = "SCRIPT")]
    pub experiment: Option<PathBuf>,
    /// Folder for gap.json, report.html, model.urdf and model.yaml, and for recordings of experiments: a new one, or that of an earlier answer.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Length of the windows over which positions are predicted, s.
    #[arg(long, default_value_t = 1.0, value_name = "SECONDS", value_parser = seconds)]
    pub window: f64,
    /// Seed of every random choice.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What angles in the recordings are measured in; numbers that look like degrees are asked back about.
    #[arg(long, value_enum)]
    pub angles: Option<Angles>,
    /// What lengths in the recordings are measured in; numbers that look like millimetres are asked back about.
    #[arg(long, value_enum)]
    pub lengths: Option<Lengths>,
    /// How to print the result.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub format: Format,
    /// Where things are.
    #[command(flatten)]
    pub places: Places,
}

/// `sagci perceive`.
#[derive(Debug, Args)]
pub struct Perceive {
    /// Point clouds of one object, in metres: PLY or PCD, one or several views.
    #[arg(required = true, value_name = "CLOUD")]
    pub clouds: Vec<PathBuf>,
    /// Where the camera was: JSON with a view for each cloud. Without it, clouds are in a world frame with z up.
    #[arg(long, value_name = "FILE")]
    pub camera_pose: Option<PathBuf>,
    /// Name of the object [default: that of the first cloud's file].
    #[arg(long)]
    pub name: Option<String>,
    /// Folder for object.urdf, meshes/, model.yaml, perception.json and parts.ply.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Take the model into the library.
    #[arg(long)]
    pub save: bool,
    /// Weights of other networks than those that ship.
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// How to print the result.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub format: Format,
    /// Where things are.
    #[command(flatten)]
    pub places: Places,
}

/// `sagci simulate`.
#[derive(Debug, Args)]
pub struct Simulate {
    /// An object of the library, or the path of a URDF or of a folder with an object.urdf; a model.yaml beside it is read. A name that the
    /// library has means its object; ./NAME is a folder here.
    pub model: String,
    /// Recordings: MCAP or CSV.
    #[arg(long, required = true, num_args = 1.., value_name = "LOG")]
    pub data: Vec<PathBuf>,
    /// The file to write: time, window, and by joint position, velocity and measured_position.
    #[arg(long, value_name = "CSV")]
    pub out: PathBuf,
    /// Length of the windows, s.
    #[arg(long, default_value_t = 1.0, value_name = "SECONDS", value_parser = seconds)]
    pub window: f64,
    /// What angles in the recordings are measured in; numbers that look like degrees are asked back about.
    #[arg(long, value_enum)]
    pub angles: Option<Angles>,
    /// What lengths in the recordings are measured in; numbers that look like millimetres are asked back about.
    #[arg(long, value_enum)]
    pub lengths: Option<Lengths>,
    /// Where things are.
    #[command(flatten)]
    pub places: Places,
}

/// `sagci evaluate`.
#[derive(Debug, Subcommand)]
pub enum Evaluate {
    /// Effects hidden in mechanisms of other engines, to be named.
    Gap {
        /// How many.
        #[arg(long, value_enum, default_value_t = Suite::Slice)]
        suite: Suite,
        /// Everything is drawn from it.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Only runs whose name begins so, such as `single/joint_spring`; a `*` stands for any part, as in `single/*/3`.
        #[arg(long, default_value = "")]
        only: String,
        /// Folder for the answers; a run that is answered there is not asked again.
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Begin no run after so many minutes, and print the table of those that are answered; 0 for those of --out alone.
        #[arg(long, value_parser = minutes)]
        minutes: Option<Duration>,
        /// How to print the result.
        #[arg(long, value_enum, default_value_t = Format::Text)]
        format: Format,
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
    /// Furniture of makers that training never saw, to be modelled from clouds.
    Perception {
        /// Everything is drawn from it.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Objects of each category.
        #[arg(long, default_value_t = 33)]
        objects: usize,
        /// Only categories whose name begins so.
        #[arg(long, default_value = "")]
        only: String,
        /// Draw from the families that training saw.
        #[arg(long)]
        trained: bool,
        /// Weights of other networks than those that ship.
        #[arg(long, value_name = "FILE")]
        weights: Option<PathBuf>,
        /// Folders with an object.urdf of another maker whose front looks along -y, to be seen by the same camera, beside the library's
        /// objects.
        #[arg(long, num_args = 1.., value_name = "DIR")]
        beside: Vec<PathBuf>,
        /// Where things are.
        #[command(flatten)]
        places: Places,
        /// Print a line for each cloud.
        #[arg(long)]
        each: bool,
        /// How to print the result.
        #[arg(long, value_enum, default_value_t = Format::Text)]
        format: Format,
    },
}

/// How many cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Suite {
    /// A few of everything.
    Slice,
    /// As many as the targets need.
    Full,
}

/// What angles are measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Angles {
    /// Radians.
    Rad,
    /// Degrees.
    Deg,
}

/// What lengths are measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Lengths {
    /// Metres.
    M,
    /// Millimetres.
    Mm,
}

fn minutes(text: &str) -> Result<Duration, String> {
    let value: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if (0.0..=1e5).contains(&value) { Ok(Duration::from_secs_f64(60.0 * value)) } else { Err("must be from 0 to 100000".to_owned()) }
}

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if (0.02..=3600.0).contains(&value) { Ok(value) } else { Err("must be from 0.02 to 3600 s".to_owned()) }
}

/// How to print a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    Text,
    /// One JSON document.
    Json,
}

/// Where things are, if not in the usual places.
#[derive(Debug, Clone, Default, Args)]
pub struct Places {
    /// Folder of the library of object models [default: world-models/ of the project].
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// Folder with skills, looked into before SAGCI_SKILLS and the usual places; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub skills: Vec<PathBuf>,
}

/// `sagci models`.
#[derive(Debug, Subcommand)]
pub enum Models {
    /// All models with their current versions.
    List {
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
    /// One model: links, joints, regions, grasps, where it comes from.
    Show {
        /// Name of the model.
        name: String,
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
    /// Take a folder with an object.urdf, and a model.yaml beside it, into the library as the object's new current version.
    Add {
        /// The folder.
        folder: PathBuf,
        /// Name of the object; that of the folder if not given.
        #[arg(long)]
        name: Option<String>,
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
    /// Read every model in full, and compare it with its hash.
    Verify {
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
}

/// `sagci skills`.
#[derive(Debug, Subcommand)]
pub enum Skills {
    /// All skills, and those that cannot be used.
    List {
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
    /// One skill: what it does and what it takes.
    Show {
        /// Name of the skill.
        name: String,
        /// Where things are.
        #[command(flatten)]
        places: Places,
    },
}
