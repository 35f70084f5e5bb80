use sagci_script::language::bind::usage;
use sagci_script::language::suggest::hint_among;
use sagci_script::language::value::parameter_words;

use crate::arguments::Skills;
use crate::commands::print;
use crate::error::CliError;
use crate::place;
use crate::table::table;

/// `sagci skills`.
pub fn skills(command: &Skills) -> Result<bool, CliError> {
    match command {
        Skills::List { places } => {
            let set = place::skills(places, None, place::silent())?;
            let mut rows = vec![["skill", "version", "does", "library"].map(str::to_owned).to_vec()];
            rows.extend(set.loaded.iter().map(|s| {
                vec![s.manifest.name.clone(), s.manifest.version.clone(), s.manifest.summary.clone(), s.library.display().to_string()]
            }));
            print(&table(&rows));
            for broken in &set.broken {
                print(&format!("\nnot usable: {}: {broken}\n", broken.name.as_deref().unwrap_or("a skill")));
            }
            if set.loaded.is_empty() && set.broken.is_empty() {
                print("no skills were found; build them with 'cargo build --release', or give their folder with --skills DIR\n");
            }
            Ok(true)
        }
        Skills::Show { name, places } => {
            let set = place::skills(places, None, place::silent())?;
            let Some(skill) = set.get(name) else {
                if let Some(broken) = set.broken.iter().find(|b| b.name.as_ref() == Some(name)) {
                    return Err(CliError::Other(format!("the skill '{name}' was found but cannot be used: {broken}")));
                }
                let hint = hint_among(name, "skills", set.loaded.iter().map(|s| s.manifest.name.as_str()));
                return Err(CliError::Other(format!("there is no skill '{name}'; {hint}")));
            };
            let m = &skill.manifest;
            print(&format!("{} {}\n{}\n\n{}\n\n", m.name, m.version, m.summary, usage(m)));
            let mut rows = vec![["argument", "kind", "required", "what"].map(str::to_owned).to_vec()];
            rows.extend(m.parameters.iter().map(|p| {
                let required = if p.required { "yes" } else { "no" };
                vec![p.name.clone(), parameter_words(p.kind).to_owned(), required.to_owned(), p.summary.clone()]
            }));
            print(&table(&rows));
            let hash = skill.sha256().map_err(|source| CliError::File { path: skill.library.clone(), source })?;
            print(&format!("\nmanifest  {}\nlibrary   {}\nsha256    {hash}\n", skill.sidecar.display(), skill.library.display()));
            Ok(true)
        }
    }
}
