use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use sagci_gap::report::{Experiment, Report, Verdict};
use sagci_gap::{Found, GapError, Options, find, page};
use sagci_library::Evidence;
use sagci_model::{DOCUMENT_FILE, Geometry, JointKind, ObjectModel, URDF_FILE, nearest};
use sagci_recording::{Log, RecordingError};
use sagci_script::language::stage::{AskedExperiment, Quantity};
use sagci_script::language::value::{Angle, Length};

use crate::arguments::{Angles, Format, Gap, Lengths, Places};
use crate::commands::{output, print, run};
use crate::error::CliError;
use crate::place;
use crate::table::table;

fn wrong(error: GapError) -> CliError {
    CliError::Other(error.to_string())
}

/// A model, and where it came from.
pub struct Given {
    pub model: ObjectModel,
    /// What it was taken for, where that may surprise.
    pub notes: Vec<String>,
    /// Its URDF.
    urdf: PathBuf,
    /// Its name and version in the library; none for a path.
    stored: Option<(String, String)>,
}

impl Given {
    fn by_path(urdf: PathBuf) -> Result<Self, CliError> {
        let model = ObjectModel::read_urdf(&urdf).map_err(|e| CliError::Other(e.to_string()))?;
        Ok(Self { model, notes: Vec::new(), urdf, stored: None })
    }

    /// Files that it was read from.
    pub fn files(&self) -> Vec<PathBuf> {
        let shapes = self.model.links.iter().flat_map(|l| l.visuals.iter().chain(&l.collisions));
        let meshes = shapes.filter_map(|shape| match &shape.geometry {
            Geometry::Mesh { file, .. } => Some(self.model.folder.join(file)),
            _ => None,
        });
        meshes.chain([self.urdf.clone(), self.urdf.with_file_name(DOCUMENT_FILE)]).collect()
    }

    /// Refuses a file that would come into a version of the library's object: its name is the hash of all that is in it.
    pub fn keeps_out(&self, path: &Path) -> Result<(), CliError> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let inside = folder.canonicalize().ok().zip(self.model.folder.canonicalize().ok()).is_some_and(|(a, b)| a.starts_with(b));
        match &self.stored {
            Some((name, _)) if inside => {
                let message =
                    format!("{}: lies in a version of {name} in the library, which would change; give --out another name", path.display());
                Err(CliError::Other(message))
            }
            _ => Ok(()),
        }
    }
}

/// A model by its name in the library, or by a path. A name that the library has means its object.
pub fn model(text: &str, places: &Places) -> Result<Given, CliError> {
    let other = |e: &dyn std::fmt::Display| CliError::Other(e.to_string());
    let path = Path::new(text);
    let urdf = [path.to_owned(), path.join(URDF_FILE)].into_iter().find(|p| p.is_file());
    if text.contains(['/', '\\', '.']) {
        return match urdf {
            Some(urdf) => Given::by_path(urdf),
            None if path.is_dir() => Err(CliError::Other(format!("{text}: has no {URDF_FILE}; name the URDF itself"))),
            None => Err(CliError::Other(format!(
                "{text}: there is no such file{}; MODEL is a URDF, a folder with an {URDF_FILE}, or an object's name",
                meant(path)
            ))),
        };
    }
    let library = match (place::library(places, None), urdf.clone()) {
        (Ok(library), _) => library,
        (Err(_), Some(urdf)) if places.models.is_none() => return Given::by_path(urdf),
        (Err(e), _) => {
            return Err(CliError::Other(format!("'{text}' names no file or folder with an {URDF_FILE} here{}, and {e}", meant(path))));
        }
    };
    let is_known = library.names().map_err(|e| other(&e))?.iter().any(|name| name == text);
    if let (false, Some(urdf)) = (is_known, urdf.clone()) {
        return Given::by_path(urdf);
    }
    let stored = library.get(text).map_err(|e| other(&e))?;
    let notes = urdf.map(|urdf| {
        format!("{text}: the library's object is taken, version {}; {} is here, too: ./{text} names it", stored.version, urdf.display())
    });
    let model = stored.model.as_ref().clone();
    Ok(Given {
        urdf: model.folder.join(URDF_FILE),
        model,
        notes: notes.into_iter().collect(),
        stored: Some((text.to_owned(), stored.version.to_string())),
    })
}

/// What was probably meant by a path that is not there: a neighbour of the first part of it that is missing.
fn meant(path: &Path) -> String {
    let Some(missing) = path.ancestors().take_while(|a| !a.as_os_str().is_empty() && !a.exists()).last() else { return String::new() };
    let folder = missing.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(|e| e.ok()?.file_name().into_string().ok());
    let (name, beside) = (missing.file_name().and_then(|n| n.to_str()).unwrap_or_default(), entries.collect::<Vec<_>>());
    let found = nearest(name, beside.iter().map(String::as_str));
    found.map(|found| format!(" (did you mean '{}'?)", missing.with_file_name(found).display())).unwrap_or_default()
}

/// What numbers in recordings are measured in, as far as somebody said so.
#[derive(Clone, Copy)]
pub struct Units {
    pub angles: Option<Angles>,
    pub lengths: Option<Lengths>,
}

/// The recordings of a model.
pub fn logs(paths: &[PathBuf], model: &ObjectModel, units: Units) -> Result<Vec<Log>, RecordingError> {
    let angles = match units.angles {
        None => sagci_recording::Angles::Ask,
        Some(Angles::Rad) => sagci_recording::Angles::Radians,
        Some(Angles::Deg) => sagci_recording::Angles::Degrees,
    };
    let lengths = match units.lengths {
        None => sagci_recording::Lengths::Ask,
        Some(Lengths::M) => sagci_recording::Lengths::Metres,
        Some(Lengths::Mm) => sagci_recording::Lengths::Millimetres,
    };
    sagci_recording::read_with(paths, Some(model), &sagci_recording::Options { angles, lengths })
}

/// Files of an answer in its folder.
const FILES: [&str; 5] = ["gap.json", "report.html", "model.urdf", DOCUMENT_FILE, "residual.safetensors"];

/// `sagci gap`.
pub fn gap(arguments: &Gap) -> Result<bool, CliError> {
    let given = model(&arguments.model, &arguments.places)?;
    let read = [output::recordings(&arguments.data), output::recordings(&arguments.held_out), given.files()].concat();
    let Given { model: given, stored, mut notes, .. } = given;
    // What cannot be done is said before the work.
    if arguments.apply && stored.is_none() {
        return Err(CliError::Other(format!(
            "--apply publishes a new version of an object of the library, and {} is a path: take it in with `sagci models add FOLDER`, then \
             give its name, `sagci gap {} ... --apply`; or leave --apply and take the model from --out",
            arguments.model, given.name
        )));
    }
    if let Some(folder) = &arguments.out {
        let written: Vec<PathBuf> = FILES.iter().map(|name| folder.join(name)).collect();
        output::spare(&written, read.iter().map(PathBuf::as_path))?;
        check_folder(folder, &given)?;
    }
    let unreadable = |e: RecordingError| CliError::Other(e.to_string());
    if let (Some(script), None) = (&arguments.experiment, &stored) {
        let message = format!(
            "--experiment needs an object of the library, which {} can expect in the measured world, and {} is a path",
            script.display(),
            arguments.model
        );
        return Err(CliError::Other(message));
    }
    let mut data = arguments.data.clone();
    let units = Units { angles: arguments.angles, lengths: arguments.lengths };
    let mut train = logs(&data, &given, units).map_err(unreadable)?;
    let held_out = match logs(&arguments.held_out, &given, units) {
        _ if arguments.held_out.is_empty() => Vec::new(),
        // Data in which nothing moves confirm nothing and deny nothing.
        Err(RecordingError::Still { place, .. }) => {
            notes.push(format!("{place}: nothing moves in these held-out data; the answer is given as if there were none"));
            Vec::new()
        }
        read => read.map_err(unreadable)?,
    };
    let _room = arguments.out.as_ref().map(|folder| output::folder(folder, &FILES)).transpose()?;
    let progress = |text: &str| eprintln!("{text} ...");
    let options = Options { window: arguments.window, seed: arguments.seed, progress: Some(&progress), ..Options::default() };
    let mut found = find(&given, &train, &held_out, &options).map_err(wrong)?;
    let cancel = arguments.experiment.as_ref().map(|_| run::cancel_on_interrupt()).transpose()?;
    for number in 1..=EXPERIMENTS {
        let (Some(script), Some(cancel), Some(next)) = (&arguments.experiment, &cancel, &found.report.next_experiment) else { break };
        let done = perform(script, next, &given, number, arguments, cancel)?;
        notes.push(done.note);
        if done.recordings.is_empty() || cancel.load(Ordering::Relaxed) {
            break;
        }
        data.extend(done.recordings);
        train = logs(&data, &given, units).map_err(unreadable)?;
        found = find(&given, &train, &held_out, &options).map_err(wrong)?;
    }
    found.report.notes.extend(notes);
    if let Some(folder) = &arguments.out {
        found.report.model = folder.join("model.urdf").display().to_string();
    }
    if let Some(next) = found.report.next_experiment.take() {
        let list = |paths: &[PathBuf]| paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>();
        let command = next.goes_on(&arguments.model, &list(&data), &list(&arguments.held_out), &options_of(arguments));
        found.report.next_experiment = Some(command);
    }
    // The answer is told also where it could not be published.
    let published = match &stored {
        Some((name, version)) if arguments.apply => publish(&mut found, name, version, arguments),
        _ => Ok(()),
    };
    let json = json(&found.report)?;
    if let Some(folder) = &arguments.out {
        let write = |name: &str, text: &str| {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(|source| CliError::File { path, source })
        };
        // The first one, since it says whose the others are.
        write("gap.json", &json)?;
        found.model.write_as(folder, "model.urdf").map_err(|e| CliError::Other(e.to_string()))?;
        if let Some(residual) = &found.residual {
            let bytes = residual.to_bytes().map_err(|e| CliError::Other(e.to_string()))?;
            let path = folder.join("residual.safetensors");
            std::fs::write(&path, bytes).map_err(|source| CliError::File { path, source })?;
        }
        write("report.html", &page(&given.name, &found))?;
    }
    match arguments.format {
        Format::Json => print(&json),
        Format::Text => print(&text(&found.report)),
    }
    published.map(|()| true)
}

/// What makes the same of other data: options that are not as they are by themselves.
fn options_of(arguments: &Gap) -> Vec<String> {
    let usual = Options::default();
    let angles = arguments.angles.map(|a| if a == Angles::Deg { "deg" } else { "rad" }.to_owned());
    let lengths = arguments.lengths.map(|l| if l == Lengths::Mm { "mm" } else { "m" }.to_owned());
    let window = (arguments.window != usual.window).then(|| arguments.window.to_string());
    let seed = (arguments.seed != usual.seed).then(|| arguments.seed.to_string());
    let models = arguments.places.models.as_ref().map(|m| m.display().to_string());
    let all = [("--models", models), ("--angles", angles), ("--lengths", lengths), ("--window", window), ("--seed", seed)];
    all.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?])).flatten().collect()
}

/// Experiments that are done for one answer, at the most.
const EXPERIMENTS: usize = 2;

/// What came of an experiment.
struct Done {
    recordings: Vec<PathBuf>,
    note: String,
}

/// Lets a script do an experiment on the measured world.
fn perform(
    script: &Path,
    next: &Experiment,
    model: &ObjectModel,
    number: usize,
    arguments: &Gap,
    cancel: &Arc<AtomicBool>,
) -> Result<Done, CliError> {
    eprintln!("experiment {number}: {} on {} ...", next.name, next.joint);
    let slides = model.joint(&next.joint).is_some_and(|j| model.joints[j].kind == JointKind::Prismatic);
    let (positions, numbers): (Vec<_>, Vec<_>) =
        next.reference.numbers.iter().partition(|(name, _)| Experiment::POSITIONS.contains(&name.as_str()));
    let at = |x: f64| if slides { Quantity::Length(Length(x)) } else { Quantity::Angle(Angle(x)) };
    let asked = AskedExperiment {
        object: arguments.model.clone(),
        joint: next.joint.clone(),
        kind: next.name.clone(),
        positions: positions.into_iter().map(|(name, x)| (name.clone(), at(*x))).collect(),
        numbers: numbers.into_iter().map(|(name, x)| (name.clone(), *x)).collect(),
        slides,
        reason: next.reason.clone(),
    };
    // A folder of its own: recordings of an earlier answer are none of this one's.
    let parent = arguments.out.clone().unwrap_or_else(|| run::new_folder(script));
    let mut free = number;
    while parent.join(format!("experiment-{free}")).exists() {
        free += 1;
    }
    let folder = parent.join(format!("experiment-{free}"));
    let report = run::experiment(script, asked, &arguments.places, arguments.seed, folder.clone(), cancel)?;
    let io = |source| CliError::File { path: folder.clone(), source };
    let mut recordings: Vec<PathBuf> = std::fs::read_dir(&folder)
        .map_err(io)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(io)?
        .into_iter()
        .filter(|p| p.extension().is_some_and(|e| e == "csv"))
        .collect();
    recordings.sort();
    let ended = report.failure.map_or_else(String::new, |f| format!("; it ended early: {}", f.message));
    let note = format!("experiment {number}, {}: {} recording(s) in {}{ended}", next.name, recordings.len(), folder.display());
    Ok(Done { recordings, note })
}

fn json(report: &Report) -> Result<String, CliError> {
    serde_json::to_string_pretty(report).map(|text| text + "\n").map_err(|e| CliError::Other(e.to_string()))
}

/// A model or a page that this command did not write is never written over: the given model's own least of all.
fn check_folder(folder: &Path, given: &ObjectModel) -> Result<(), CliError> {
    let same = |a: &Path, b: &Path| a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b);
    let own = if given.folder.as_os_str().is_empty() { Path::new(".") } else { &given.folder };
    let refuse =
        |what: String| Err(CliError::Other(format!("{}: {what}, which would be written over; give --out a new folder", folder.display())));
    if same(folder, own) {
        return refuse("holds the given model".into());
    }
    if folder.exists() && !folder.is_dir() {
        return Err(CliError::Other(format!("{}: is a file; --out takes a folder", folder.display())));
    }
    // Another URDF would get the written model.yaml beside it.
    let is_anothers = |name: &String| FILES.contains(&name.as_str()) || name.to_lowercase().ends_with(".urdf");
    let mut inside: Vec<String> =
        std::fs::read_dir(folder).into_iter().flatten().filter_map(|e| e.ok()?.file_name().into_string().ok()).collect();
    inside.sort();
    match inside.into_iter().find(is_anothers) {
        Some(name) if !is_answer(&folder.join("gap.json")) => refuse(format!("holds a {name} that this command did not write")),
        _ => Ok(()),
    }
}

fn is_answer(path: &Path) -> bool {
    let document = std::fs::read(path).ok().and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    document.is_some_and(|d| d["schema"].is_u64() && d["verdict"].is_string() && d["gap"].is_object())
}

/// Publishes what was found, and says in the report what became of it.
fn publish(found: &mut Found, name: &str, version: &str, arguments: &Gap) -> Result<(), CliError> {
    let doubted: Vec<String> = found.report.effects.iter().filter(|e| !e.confirmed).map(|e| e.name.clone()).collect();
    let mut say = |message: String| {
        eprintln!("{message}");
        found.report.notes.push(message);
    };
    if found.report.effects.is_empty() {
        say("nothing was named: no new version is published".into());
        return Ok(());
    }
    if !doubted.is_empty() && !arguments.accept_unconfirmed {
        let names = doubted.join(", ");
        say(format!("held-out data do not confirm {names}: not published; --accept-unconfirmed publishes it all the same"));
    }
    let model = if arguments.accept_unconfirmed { Some(found.model.clone()) } else { found.confirmed() };
    let Some(model) = model else { return Ok(()) };
    // The same data and seed give the same bytes, and so the same version: how long it took and where else it was written are left out.
    let report = Report { model: format!("{name}/{version}"), seconds: 0.0, ..found.report.clone() };
    let kept = Found { report, ..found.clone() };
    let evidence = [
        Evidence { name: "gap.json".into(), bytes: json(&kept.report)?.into_bytes() },
        Evidence { name: "report.html".into(), bytes: page(name, &kept).into_bytes() },
    ];
    let library = place::library(&arguments.places, None)?;
    let published = library.publish_model(name, &model, &evidence).map_err(|e| CliError::Other(e.to_string()))?;
    eprintln!("published as version {published} of {name}");
    found.report.model = published.to_string();
    Ok(())
}

fn text(report: &Report) -> String {
    let mut text = String::new();
    let verdict = match report.verdict {
        Verdict::NoGap => "nothing is missing that these data could show",
        Verdict::Named => "the missing effect has a name",
        Verdict::Ambiguous => "something is missing; the data cannot tell some names apart",
        Verdict::Unknown => "something is missing that no name of the catalogue fits",
    };
    text += &format!("verdict  {verdict}\n");
    for effect in &report.effects {
        let place = effect.place();
        let confirmed = if effect.confirmed { "confirmed by held-out data" } else { "not confirmed by held-out data" };
        text += &format!("\n{} on {place} ({confirmed})\n", effect.name);
        if !effect.alternatives.is_empty() {
            text += &format!("  or, as far as the data can tell: {}\n", effect.alternatives.join(", "));
        }
        let mut rows: Vec<Vec<String>> = Vec::new();
        for (name, v) in &effect.parameters {
            rows.push(vec![format!("  {name}"), format!("{:.4}", v.value), format!("{:.4} to {:.4}", v.lower, v.upper), v.unit.clone()]);
        }
        text += &table(&rows);
        for reason in effect.runners_up.iter().take(3) {
            text += &format!("  not {}: {}\n", reason.name, reason.reason);
        }
    }
    if let Some(left) = &report.unexplained {
        text += &format!("\nwithout a name: {:.0} % of the lacking force on {}, over {}\n", 100.0 * left.share, left.joint, left.over);
    }
    text += "\ngap, predicted over windows\n";
    let mut rows = vec![["", "joint", "before", "refitted", "after", "noise floor", ""].map(str::to_owned).to_vec()];
    for (data, gap) in [("  data", Some(&report.gap.train)), ("  held out", report.gap.held_out.as_ref())] {
        for (joint, g) in gap.iter().flat_map(|g| &g.per_joint) {
            let number = |x: f64| format!("{x:.5}");
            let [a, b, c, d] = [g.before, g.refitted, g.after, g.noise_floor].map(number);
            rows.push(vec![data.into(), joint.clone(), a, b, c, d, g.unit.clone()]);
        }
    }
    text += &table(&rows);
    if let Some(tried) = report.residual.filter(|r| r.kept) {
        text +=
            &format!("\na learned force on what is left takes the held-out gap from {:.5} to {:.5}: kept\n", tried.gap[0], tried.gap[1]);
    }
    if !report.baselines.is_empty() {
        text += "\nother ways, pooled over joints in shares of their ranges\n";
        let after = report.gap.held_out.as_ref().unwrap_or(&report.gap.train).after;
        let mut rows = vec![vec!["  this report".into(), format!("{after:.5}")]];
        rows.extend(report.baselines.iter().map(|(name, x)| vec![format!("  {}", name.replace('_', " ")), format!("{x:.5}")]));
        text += &table(&rows);
    }
    if let Some(next) = &report.next_experiment {
        text += &format!("\nnext experiment  {} on {}\n  {}\n", next.name, next.joint, next.reason);
        match (next.separates.as_slice(), next.expected_log_bayes_factor) {
            ([], _) => {}
            ([one], Some(x)) => text += &format!("  would confirm {one}; evidence of about e^{x:.0} is expected\n"),
            (names, Some(x)) => text += &format!("  tells apart {}; evidence of about e^{x:.0} is expected\n", names.join(", ")),
            (names, None) => text += &format!("  tells apart {}\n", names.join(", ")),
        }
        text += &format!("  then  {}\n\n", next.command);
    }
    for note in &report.notes {
        text += &format!("note: {note}\n");
    }
    text += &format!("\n{:.1} s\n", report.seconds);
    text
}
