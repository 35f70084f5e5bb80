use std::path::{Path, PathBuf};

use sagci_gap::report::{Report, Verdict};
use sagci_gap::{GapError, Options, find};
use sagci_model::ObjectModel;
use sagci_recording::Log;

use crate::arguments::{Angles, Format, Gap, Places};
use crate::commands::print;
use crate::error::CliError;
use crate::place;
use crate::table::table;

fn wrong(error: GapError) -> CliError {
    CliError::Other(error.to_string())
}

/// A model by its name in the library, or by a path.
pub fn model(text: &str, places: &Places) -> Result<ObjectModel, CliError> {
    let other = |e: &dyn std::fmt::Display| CliError::Other(e.to_string());
    let path = Path::new(text);
    if path.is_file() {
        return ObjectModel::read_urdf(path).map_err(|e| other(&e));
    }
    if path.join("object.urdf").is_file() {
        return ObjectModel::read(path).map_err(|e| other(&e));
    }
    let library = place::library(places, None)?;
    library.get(text).map(|stored| stored.model.as_ref().clone()).map_err(|e| other(&e))
}

/// The recordings of a model.
pub fn logs(paths: &[PathBuf], model: &ObjectModel, angles: Option<Angles>) -> Result<Vec<Log>, CliError> {
    let angles = match angles {
        None => sagci_recording::Angles::Ask,
        Some(Angles::Rad) => sagci_recording::Angles::Radians,
        Some(Angles::Deg) => sagci_recording::Angles::Degrees,
    };
    sagci_recording::read_with(paths, Some(model), &sagci_recording::Options { angles }).map_err(|e| CliError::Other(e.to_string()))
}

/// `sagci gap`.
pub fn gap(arguments: &Gap) -> Result<bool, CliError> {
    let given = model(&arguments.model, &arguments.places)?;
    let train = logs(&arguments.data, &given, arguments.angles)?;
    let held_out = if arguments.held_out.is_empty() { Vec::new() } else { logs(&arguments.held_out, &given, arguments.angles)? };
    let progress = |text: &str| eprintln!("{text} ...");
    let options = Options { window: arguments.window, seed: arguments.seed, progress: Some(&progress) };
    let mut found = find(&given, &train, &held_out, &options).map_err(wrong)?;
    if arguments.apply {
        let library = place::library(&arguments.places, None)?;
        let unconfirmed: Vec<&str> = found.report.effects.iter().filter(|e| !e.confirmed).map(|e| e.name.as_str()).collect();
        if found.report.effects.is_empty() {
            eprintln!("nothing was named: no new version");
        } else if !unconfirmed.is_empty() && !arguments.accept_unconfirmed {
            eprintln!(
                "not published: held-out data do not confirm {}; --accept-unconfirmed publishes it all the same",
                unconfirmed.join(", ")
            );
        } else {
            let version = library.publish_model(&given.name, &found.model, &[]).map_err(|e| CliError::Other(e.to_string()))?;
            found.report.model = version.to_string();
        }
    }
    let json = serde_json::to_string_pretty(&found.report).map_err(|e| CliError::Other(e.to_string()))? + "\n";
    if let Some(folder) = &arguments.out {
        let write = |name: &str, text: &str| {
            let path = folder.join(name);
            std::fs::create_dir_all(folder)
                .and_then(|()| std::fs::write(&path, text))
                .map_err(|source| CliError::File { path: path.clone(), source })
        };
        let yaml = found.model.document.to_yaml().map_err(|e| CliError::Other(e.to_string()))?;
        write("gap.json", &json)?;
        write("model.urdf", &found.model.to_urdf())?;
        write("model.yaml", &yaml)?;
    }
    match arguments.format {
        Format::Json => print(&json),
        Format::Text => print(&text(&found.report)),
    }
    Ok(true)
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
        let joint = effect.joint.as_deref().unwrap_or("the base");
        let confirmed = if effect.confirmed { "confirmed by held-out data" } else { "not confirmed by held-out data" };
        text += &format!("\n{} on {joint} ({confirmed})\n", effect.name);
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
    for note in &report.notes {
        text += &format!("note: {note}\n");
    }
    text += &format!("\n{:.1} s\n", report.seconds);
    text
}
