//! Draws the runs of a suite without asking anybody: prints how visible each hidden effect is, and lays the data out where a folder is
//! given. `hide [slice|full] [FOLDER] [only runs that begin so] [seed]`; truths go to FOLDER/sealed, data to FOLDER/data.
#![allow(clippy::print_stdout)]

use sagci_evaluation::{Options, Suite, run};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let suite = if words.next().as_deref() == Some("full") { Suite::Full } else { Suite::Slice };
    let folder = words.next().map(std::path::PathBuf::from);
    let only = words.next().unwrap_or_default();
    let seed = words.next().map_or(Ok(1), |w| w.parse())?;
    let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
    let head = std::fs::read_to_string(models.join("HEAD"))?;
    let options = Options {
        suite,
        only,
        seed,
        sealed: folder.as_ref().map(|f| f.join("sealed")),
        data: folder.as_ref().map(|f| f.join("data")),
        arm: Some(sagci_model::ObjectModel::read(models.join(head.trim()))?),
        ..Options::default()
    };
    let nothing = serde_json::json!({ "verdict": "no_gap", "effects": [] });
    let all = run(&options, &|_| Ok(nothing.clone()), &|line| println!("{line}"))?;
    println!("{}", sagci_evaluation::table(&all).to_text());
    Ok(())
}
