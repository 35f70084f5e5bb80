use sagci_library::Severity;

use crate::arguments::Places;
use crate::commands::print;
use crate::error::CliError;
use crate::place;

/// `sagci doctor`.
pub fn doctor(places: &Places) -> Result<bool, CliError> {
    let mut wrong = 0;
    let mut say = |good: bool, what: &str, text: &str| {
        wrong += usize::from(!good);
        print(&format!("{}  {what:<9} {text}\n", if good { "ok   " } else { "WRONG" }));
    };
    say(true, "program", concat!("sagci ", env!("CARGO_PKG_VERSION")));
    match place::library(places, None).and_then(|l| Ok((l.names().map_err(|e| CliError::Other(e.to_string()))?, l))) {
        Err(e) => say(false, "library", &e.to_string()),
        Ok((names, library)) => {
            say(!names.is_empty(), "library", &format!("{}, {} models", library.root().display(), names.len()));
            for name in names {
                match library.verify(&name) {
                    Ok(report) if report.sound => {
                        say(true, "model", &format!("{name} {}", report.version.map(|v| v.to_string()).unwrap_or_default()));
                    }
                    Ok(report) => {
                        for finding in report.findings.iter().filter(|f| f.severity == Severity::Error) {
                            say(false, "model", &format!("{name}: {}: {}", finding.place, finding.message));
                        }
                    }
                    Err(e) => say(false, "model", &format!("{name}: {e}")),
                }
            }
        }
    }
    match place::skills(places, None, place::silent()) {
        Err(e) => say(false, "skills", &e.to_string()),
        Ok(set) => {
            if set.loaded.is_empty() && set.broken.is_empty() {
                say(false, "skills", "none were found; build them with 'cargo build --release'");
            }
            set.loaded.iter().for_each(|s| say(true, "skill", &format!("{} {}", s.manifest.name, s.manifest.version)));
            set.broken.iter().for_each(|b| say(false, "skill", &b.to_string()));
        }
    }
    for kind in sagci_world::KINDS {
        match sagci_world::open(kind, sagci_world::WorldOptions::default()) {
            Ok(_) => say(true, "world", kind),
            Err(e) => say(false, "world", &e.to_string()),
        }
    }
    if wrong == 0 { Ok(true) } else { Err(CliError::Other(format!("{wrong} things are wrong"))) }
}
