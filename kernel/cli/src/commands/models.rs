use sagci_library::{LibraryError, ModelReport, Severity};

use crate::arguments::Models;
use crate::commands::print;
use crate::error::CliError;
use crate::place;
use crate::table::table;

fn wrong(error: LibraryError) -> CliError {
    CliError::Other(error.to_string())
}

fn row<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

/// `sagci models`.
pub fn models(command: &Models) -> Result<bool, CliError> {
    match command {
        Models::List { places } => {
            let listings = place::library(places, None)?.list().map_err(wrong)?;
            let mut rows = vec![row(["model", "version", "role", "mass", "joints", "licence", "what"])];
            for m in &listings {
                let version = m.version.as_ref().map(ToString::to_string).unwrap_or_default();
                let what = m.problem.as_ref().map_or_else(|| m.description.clone(), |p| format!("not usable: {p}"));
                rows.push(row([&m.name, &version, m.role, &format!("{:.2} kg", m.mass), &m.joints.len().to_string(), &m.licence, &what]));
            }
            print(&table(&rows));
            Ok(true)
        }
        Models::Show { name, places } => {
            let library = place::library(places, None)?;
            // `report` lists what cannot be read with its problem; a name that is not there is an error.
            let report = library.report(name).map_err(wrong)?;
            print(&model_text(&report));
            report.listing.problem.map_or(Ok(true), |problem| Err(CliError::Other(problem)))
        }
        Models::Add { folder, name, places } => {
            let library = place::library(places, None)?;
            // The last part of `.` or `x/..` is known only after links and dots are resolved.
            let real = folder.canonicalize().map_err(|e| CliError::Other(format!("{}: {e}", folder.display())))?;
            let name = name.clone().or_else(|| Some(real.file_name()?.to_string_lossy().into_owned()));
            let name = name.ok_or_else(|| CliError::Other(format!("{}: give the object a name with --name", folder.display())))?;
            let version = library.publish(&name, &real, &[]).map_err(wrong)?;
            print(&format!("added  {name} {version}  {}\n", library.root().join(&name).join(version.to_string()).display()));
            for finding in library.verify(&name).map_err(wrong)?.findings {
                print(&format!("       {}: {}\n", finding.place, finding.message));
            }
            Ok(true)
        }
        Models::Verify { places } => {
            let library = place::library(places, None)?;
            let mut damaged = Vec::new();
            for name in library.names().map_err(wrong)? {
                match library.verify(&name) {
                    Ok(report) => {
                        let version = report.version.as_ref().map(ToString::to_string).unwrap_or_default();
                        print(&format!("{}  {name} {version}\n", if report.sound { "sound  " } else { "DAMAGED" }));
                        for finding in &report.findings {
                            let severity = if finding.severity == Severity::Error { "error" } else { "warning" };
                            print(&format!("         {severity}: {}: {}\n", finding.place, finding.message));
                        }
                        if !report.sound {
                            damaged.push(name);
                        }
                    }
                    Err(e) => {
                        print(&format!("DAMAGED  {name}\n         error: {e}\n"));
                        damaged.push(name);
                    }
                }
            }
            if damaged.is_empty() {
                return Ok(true);
            }
            let hint = "restore the files, or publish the change as a new version";
            Err(CliError::Other(format!("{}: not sound: {}; {hint}", library.root().display(), damaged.join(", "))))
        }
    }
}

fn model_text(report: &ModelReport) -> String {
    let m = &report.listing;
    let version = m.version.as_ref().map(ToString::to_string).unwrap_or_default();
    let mut text = format!("{} {version}\n{}\n{}, {:.2} kg, {}\n{}\n", m.name, m.description, m.role, m.mass, m.licence, report.folder);
    let mut section = |title: &str, rows: Vec<Vec<String>>| {
        if rows.len() > 1 {
            text += &format!("\n{title}\n{}", table(&rows));
        }
    };
    let mut rows = vec![row(["link", "mass", "seen shapes", "touched shapes"])];
    rows.extend(
        report.links.iter().map(|l| row([&l.name, &format!("{:.3} kg", l.mass), &l.visuals.to_string(), &l.collisions.to_string()])),
    );
    section("links", rows);
    let mut rows = vec![row(["joint", "kind", "moves", "range", "damping", "friction"])];
    rows.extend(report.joint_list.iter().map(|j| {
        let range = j.range.map(|[a, b]| format!("{a:.3} to {b:.3} {}", j.unit)).unwrap_or_default();
        row([&j.name, j.kind, &j.child, &range, &j.damping.to_string(), &j.friction.to_string()])
    }));
    section("joints", rows);
    let mut rows = vec![row(["grasp", "kind", "link", "width"])];
    rows.extend(report.grasps.iter().map(|g| row([&g.name, g.kind, &g.link, &format!("{:.1} mm", g.width * 1000.0)])));
    section("grasps", rows);
    let mut rows = vec![row(["region", "link", "size"])];
    rows.extend(report.regions.iter().map(|r| {
        let [x, y, z] = r.size;
        row([&r.name, &r.link, &format!("{x:.3} x {y:.3} x {z:.3} m")])
    }));
    section("regions", rows);
    let mut rows = vec![row(["effect", "joint", "parameters"])];
    rows.extend(report.effects.iter().map(|e| {
        let numbers = e.parameters.iter().map(|(name, v)| format!("{name} {v}"));
        let parameters: Vec<String> = numbers.chain(e.choices.iter().map(|(name, word)| format!("{name} {word}"))).collect();
        row([&e.effect, e.joint.as_deref().unwrap_or(""), &parameters.join(", ")])
    }));
    section("effects", rows);
    if !report.configurations.is_empty() {
        text += &format!("\nconfigurations: {}\n", report.configurations.join(", "));
    }
    text += "\nversions\n";
    for v in &report.all_versions {
        text += &format!("  {}{}\n", v.version, if v.head { " (current)" } else { "" });
    }
    text += &format!("\nlicence      {}\nattribution  {}\n", report.provenance.licence, report.provenance.attribution);
    for origin in &report.provenance.origins {
        text += &format!("origin       {} {}\n", origin.source, origin.version);
    }
    text
}
