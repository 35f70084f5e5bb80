//! Skills on disk: where they are looked for, what is checked before and after a library is opened.
//!
//! A skill is a folder with a `skill.yaml`. Its library lies beside that file or beside the program (cargo puts the shared
//! libraries of a workspace into `target/<profile>/`). The sidecar is read first: a listing needs no library, and a skill
//! for another version of the border is refused before any of its code runs. A bad skill is listed with its reason and does
//! not keep the others from loading. Libraries are never unloaded: a plan, a thread or a destructor may still point into
//! them.

mod elf;
mod open;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sagci_skill::{LogSink, Manifest, Skill, abi};
use sha2::{Digest, Sha256};

/// Where skills are looked for.
#[derive(Debug, Clone, Default)]
pub struct SearchPath {
    /// Folders that hold a `skill.yaml`, or folders with one. A skill found in an earlier folder hides one of the same
    /// name in a later one.
    pub folders: Vec<PathBuf>,
    /// Folders in which libraries are looked for that do not lie beside their `skill.yaml`.
    pub libraries: Vec<PathBuf>,
}

impl SearchPath {
    /// The usual places: `given` (must exist), the folders in `SAGCI_SKILLS`, `skills/` of the project, and `skills/` beside
    /// the program.
    pub fn usual(given: &[PathBuf], project: Option<&Path>) -> Self {
        let program = std::env::current_exe().ok().and_then(|p| p.canonicalize().ok()).and_then(|p| p.parent().map(Path::to_owned));
        let mut folders = given.to_vec();
        if let Some(list) = std::env::var_os("SAGCI_SKILLS") {
            folders.extend(std::env::split_paths(&list).filter(|p| !p.as_os_str().is_empty()));
        }
        folders.extend(project.map(|p| p.join("skills")).filter(|p| p.is_dir()));
        folders.extend(program.as_ref().map(|p| p.join("skills")).filter(|p| p.is_dir()));
        Self { folders, libraries: program.into_iter().collect() }
    }
}

/// A skill that is ready to be called.
#[derive(Clone)]
pub struct LoadedSkill {
    /// What it says of itself.
    pub manifest: Manifest,
    /// Its `skill.yaml`.
    pub sidecar: PathBuf,
    /// Its library.
    pub library: PathBuf,
    /// The skill itself.
    pub skill: Arc<dyn Skill>,
}

impl LoadedSkill {
    /// Hash of the library's bytes, in hexadecimal.
    pub fn sha256(&self) -> std::io::Result<String> {
        let digest = Sha256::digest(std::fs::read(&self.library)?);
        Ok(digest.iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

impl std::fmt::Debug for LoadedSkill {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LoadedSkill").field("manifest", &self.manifest).field("library", &self.library).finish_non_exhaustive()
    }
}

/// A skill that cannot be used, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {message} ({hint})", file.display())]
pub struct BrokenSkill {
    /// Its name, if its sidecar could be read that far.
    pub name: Option<String>,
    /// The file that is wrong.
    pub file: PathBuf,
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub hint: String,
}

/// All skills that were found, by name.
#[derive(Debug, Clone, Default)]
pub struct SkillSet {
    /// Those that can be used.
    pub loaded: Vec<LoadedSkill>,
    /// Those that cannot.
    pub broken: Vec<BrokenSkill>,
}

impl SkillSet {
    /// Finds and opens all skills. `reserved` are names that a skill must not take, since scripts know them already.
    pub fn discover(path: &SearchPath, reserved: &[&str], log: &LogSink) -> Self {
        let mut set = Self::default();
        let mut seen: Vec<PathBuf> = Vec::new();
        for folder in &path.folders {
            let sidecars = match sidecars(folder) {
                Ok(sidecars) => sidecars,
                Err(e) => {
                    set.broken.push(BrokenSkill {
                        name: None,
                        file: folder.clone(),
                        message: format!("cannot be searched for skills: {e}"),
                        hint: "give a folder that holds a skill.yaml, or folders with one".to_owned(),
                    });
                    continue;
                }
            };
            for sidecar in sidecars {
                let known = sidecar.canonicalize().unwrap_or_else(|_| sidecar.clone());
                if seen.contains(&known) {
                    continue;
                }
                seen.push(known);
                match load(&sidecar, path, reserved, log) {
                    Ok(skill) if set.get(&skill.manifest.name).is_none() => set.loaded.push(skill),
                    Ok(_) => {}
                    Err(broken) => set.broken.push(broken),
                }
            }
        }
        set.loaded.sort_by(|a, b| a.manifest.name.cmp(&b.manifest.name));
        set.broken.sort_by(|a, b| (&a.name, &a.file).cmp(&(&b.name, &b.file)));
        set
    }

    /// A skill by name.
    pub fn get(&self, name: &str) -> Option<&LoadedSkill> {
        self.loaded.iter().find(|s| s.manifest.name == name)
    }
}

/// The `skill.yaml` in a folder and in the folders in it, in the order of their names.
fn sidecars(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.file_name().is_some_and(|n| n == "skill.yaml") {
            found.push(path);
        } else if path.join("skill.yaml").is_file() {
            found.push(path.join("skill.yaml"));
        }
    }
    found.sort();
    Ok(found)
}

/// The file name of a library on this platform.
pub fn library_file_name(library: &str) -> String {
    format!("{}{library}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

fn load(sidecar: &Path, path: &SearchPath, reserved: &[&str], log: &LogSink) -> Result<LoadedSkill, BrokenSkill> {
    let broken = |name: Option<&str>, file: &Path, message: String, hint: &str| BrokenSkill {
        name: name.map(str::to_owned),
        file: file.to_owned(),
        message,
        hint: hint.to_owned(),
    };
    let manifest = Manifest::read(sidecar)
        .map_err(|e| broken(None, sidecar, e.to_string(), "compare with the skill.yaml of a skill that ships with this program"))?;
    let name = Some(manifest.name.as_str());
    if manifest.abi != abi::ABI {
        let message = format!("is made for version {} of the plugin border, and this program speaks version {}", manifest.abi, abi::ABI);
        return Err(broken(name, sidecar, message, "rebuild the skill against this version of sagci-skill, and set 'abi' to it"));
    }
    if reserved.contains(&manifest.name.as_str()) {
        let message = format!("the name '{}' already means something in scripts", manifest.name);
        return Err(broken(name, sidecar, message, "give the skill another name"));
    }
    let file_name = library_file_name(&manifest.library);
    let places = sidecar.parent().into_iter().chain(path.libraries.iter().map(PathBuf::as_path));
    let candidates: Vec<PathBuf> = places.map(|folder| folder.join(&file_name)).collect();
    let Some(library) = candidates.iter().find(|c| c.is_file()) else {
        let places: Vec<String> = candidates.iter().filter_map(|c| c.parent()).map(|p| p.display().to_string()).collect();
        let message = format!("its library {file_name} is neither beside it nor beside the program");
        let hint = format!("build it, for example with 'cargo build --release'; looked in {}", places.join(", "));
        return Err(broken(name, sidecar, message, &hint));
    };
    // The loader maps a file that was cut short without complaint, and the program dies at the first missing page.
    elf::check_whole(library).map_err(|message| broken(name, library, message, "build or copy the library again"))?;
    let skill = open::open(library, &manifest, log).map_err(|(message, hint)| broken(name, library, message, &hint))?;
    let own = skill.manifest().map_err(|e| broken(name, library, e.to_string(), "rebuild the skill"))?;
    if own != manifest {
        let message = format!("says other things of itself than {}: {}", sidecar.display(), difference(&manifest, &own));
        return Err(broken(name, library, message, "the library and its skill.yaml are of different versions; build or copy both again"));
    }
    Ok(LoadedSkill { manifest, sidecar: sidecar.to_owned(), library: library.clone(), skill })
}

/// The first field in which two manifests differ.
fn difference(sidecar: &Manifest, own: &Manifest) -> String {
    let say = |field: &str, a: &str, b: &str| format!("{field} is '{b}' in the library and '{a}' in the file");
    if sidecar.name != own.name {
        say("name", &sidecar.name, &own.name)
    } else if sidecar.version != own.version {
        say("version", &sidecar.version, &own.version)
    } else if sidecar.abi != own.abi {
        say("abi", &sidecar.abi.to_string(), &own.abi.to_string())
    } else if sidecar.entry != own.entry {
        say("entry", &sidecar.entry, &own.entry)
    } else if sidecar.library != own.library {
        say("library", &sidecar.library, &own.library)
    } else if sidecar.parameters != own.parameters {
        let names = |m: &Manifest| m.parameters.iter().map(|p| format!("{} ({:?})", p.name, p.kind)).collect::<Vec<_>>().join(", ");
        say("parameters", &names(sidecar), &names(own))
    } else {
        say("summary", &sidecar.summary, &own.summary)
    }
}
