//! The one place where a library is opened.
#![allow(unsafe_code)]
#![deny(clippy::undocumented_unsafe_blocks)]

use std::path::Path;
use std::sync::Arc;

use libloading::{Library, Symbol};
use sagci_skill::{LogSink, Manifest, Plugin, Skill, abi};

/// Opens a library and takes its table. `Err` is what is wrong and what to do about it.
pub(super) fn open(path: &Path, manifest: &Manifest, log: &LogSink) -> Result<Arc<dyn Skill>, (String, String)> {
    // SAFETY: opening runs the library's initialisers; whoever puts a skill into a skills folder trusts it as they trust
    // this program. The file has been found whole.
    let library = unsafe { Library::new(path) }
        .map_err(|e| (format!("cannot be opened: {}", cause(&e)), "is it a shared library for this machine?".to_owned()))?;
    // Never unloaded: see the module's comment.
    let library: &'static Library = Box::leak(Box::new(library));
    // SAFETY: the sidecar says that this symbol is a skill's entry; `export_skill!` gives it this type.
    let entry: Symbol<'static, abi::Entry> = unsafe { library.get(manifest.entry.as_bytes()) }.map_err(|_| {
        let hint = format!("the library must contain export_skill!(..., {})", manifest.entry);
        (format!("has no symbol '{}', which its skill.yaml names as entry", manifest.entry), hint)
    })?;
    // SAFETY: as above; the library stays open for as long as the program runs, and so does the table.
    let plugin = unsafe { Plugin::from_raw(entry(), log.clone()) }
        .map_err(|e| (e.to_string(), "rebuild the skill against this version of sagci-skill".to_owned()))?;
    Ok(Arc::new(plugin))
}

/// libloading keeps the loader's own words in the source of its error.
fn cause(error: &libloading::Error) -> String {
    std::error::Error::source(error).map_or_else(|| error.to_string(), ToString::to_string)
}
