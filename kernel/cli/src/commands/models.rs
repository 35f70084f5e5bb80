use sagci_script::Models as _;
use sagci_script::language::suggest::hint_among;

use crate::arguments::Models;
use crate::commands::print;
use crate::error::CliError;
use crate::place;
use crate::table::table;

/// `sagci models`.
pub fn models(command: &Models) -> Result<bool, CliError> {
    match command {
        Models::List { places } => {
            let library = place::models(places, None)?;
            let mut rows = vec![["model", "version", "what"].map(str::to_owned).to_vec()];
            for name in library.names() {
                let version = library.version(&name).map(|v| v.0).unwrap_or_else(|e| e);
                let what = library.model(&name).map(|m| m.document.description.clone()).unwrap_or_else(|e| format!("not usable: {e}"));
                rows.push(vec![name, version, what]);
            }
            print(&table(&rows));
            Ok(true)
        }
        Models::Show { name, places } => {
            let library = place::models(places, None)?;
            let names = library.names();
            if !names.contains(name) {
                let hint = hint_among(name, "models", names.iter().map(String::as_str));
                return Err(CliError::Other(format!("the library has no model '{name}'; {hint}")));
            }
            let model = library.model(name).map_err(CliError::Other)?;
            print(&format!("{name}\n{}\n", model.document.description));
            Ok(true)
        }
        Models::Verify { places } => {
            let library = place::models(places, None)?;
            let mut good = true;
            for name in library.names() {
                match library.model(&name) {
                    Ok(_) => print(&format!("{name}: good\n")),
                    Err(e) => {
                        good = false;
                        eprintln!("error: {name}: {e}");
                    }
                }
            }
            if good { Ok(true) } else { Err(CliError::Other("the library is damaged".to_owned())) }
        }
    }
}
