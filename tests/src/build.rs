//! Builds plugins and the program itself, as a person would.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use sagci_script::plugins::library_file_name;

use crate::house::{PUSH_SOURCE, PUSH_YAML, root, write};

/// A skill's folder with its library.
pub struct Built {
    /// The folder that holds skills: what `--skills` takes.
    pub skills: PathBuf,
    /// The skill's manifest.
    pub yaml: PathBuf,
    /// Its library.
    pub library: PathBuf,
}

/// The folder of the running test program, where cargo also puts the libraries that it is made of.
fn deps() -> PathBuf {
    std::env::current_exe().unwrap().parent().unwrap().to_owned()
}

/// Compiles one file to a shared library. `Err` is what the compiler said.
pub fn rustc_library(source: &Path, library: &Path, extra: &[&str]) -> Result<(), String> {
    let output = Command::new(std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned()))
        .args(["--edition", "2024", "--crate-type", "cdylib", "-C", "opt-level=1", "--crate-name", "plugin"])
        .args(extra)
        .arg("-o")
        .arg(library)
        .arg(source)
        .output()
        .unwrap();
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

/// Builds the skill `push` into `folder/push`, against the `sagci_skill` that this test is built with.
pub fn build_push(folder: &Path, extra: &[&str]) -> Built {
    let home = folder.join("push");
    // Elsewhere: a manifest among the skills would be a skill.
    let workshop = tempfile::tempdir().unwrap();
    let source = write(workshop.path().join("push.rs"), PUSH_SOURCE);
    write(workshop.path().join("skill.yaml"), PUSH_YAML);
    std::fs::create_dir_all(&home).unwrap();
    let library = home.join(library_file_name("sagci_skill_push"));
    // Several builds of the crate may lie about, with other features; any of them will do, the newest first.
    let mut rlibs: Vec<PathBuf> = std::fs::read_dir(deps())
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.file_name().unwrap().to_string_lossy().starts_with("libsagci_skill-") && p.extension().is_some_and(|e| e == "rlib"))
        .collect();
    rlibs.sort_by_key(|p| std::cmp::Reverse(p.metadata().unwrap().modified().unwrap()));
    let mut said = Vec::new();
    let built = rlibs.iter().any(|rlib| {
        let (with, search) = (format!("sagci_skill={}", rlib.display()), format!("dependency={}", deps().display()));
        let mut arguments = vec!["--extern", &with, "-L", &search];
        arguments.extend(extra);
        rustc_library(&source, &library, &arguments).map_err(|e| said.push(e)).is_ok()
    });
    assert!(built, "push could not be built: {}", said.join("\n"));
    Built { skills: folder.to_owned(), yaml: write(home.join("skill.yaml"), PUSH_YAML), library }
}

/// The program `sagci`, built with the skills that ship by the command that a person uses.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let profile = deps().parent().unwrap().to_owned();
        let release = profile.file_name().is_some_and(|n| n == "release");
        let mut cargo = Command::new(env!("CARGO"));
        cargo.current_dir(root()).args(["build", "--quiet"]).args(release.then_some("--release"));
        assert!(cargo.status().unwrap().success(), "the program cannot be built");
        profile.join(format!("sagci{}", std::env::consts::EXE_SUFFIX))
    })
}
