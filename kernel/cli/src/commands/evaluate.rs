use sagci_evaluation as evaluation;
use sagci_library::Library;

use crate::arguments::{Evaluate, Format, Suite};
use crate::commands::perceive::weights_of;
use crate::commands::print;
use crate::error::CliError;
use crate::place;

/// `sagci evaluate`.
pub fn evaluate(command: &Evaluate) -> Result<bool, CliError> {
    match command {
        Evaluate::Gap { .. } => gap(command),
        Evaluate::Perception { .. } => perception(command),
    }
}

fn perception(command: &Evaluate) -> Result<bool, CliError> {
    let Evaluate::Perception { seed, objects, only, trained, weights, beside, places, each, format } = command else { return Ok(false) };
    let other = |e: &dyn std::fmt::Display| CliError::Other(e.to_string());
    let weights = weights_of(weights.as_deref())?;
    let mut makers = Vec::new();
    if only.is_empty() && !trained {
        // What the library holds that moves and is no robot.
        let library = place::library(places, None).ok();
        let names = library.as_ref().and_then(|l| l.names().ok()).unwrap_or_default();
        let stored = names.iter().filter_map(|name| library.as_ref()?.get(name).ok()).map(|s| s.model.as_ref().clone());
        makers.extend(stored.filter(|m| m.document.robot.is_none()));
        for folder in beside {
            makers.push(sagci_model::ObjectModel::read(folder).map_err(|e| other(&e))?);
        }
    }
    let options = evaluation::PerceptionOptions { seed: *seed, objects: *objects, only: only.clone(), trained: *trained, makers };
    // Joints name their links; links their parts.
    let model = |cloud: &[nalgebra::Point3<f64>]| {
        let found = sagci_modelling::perceive(cloud, "object", &weights).map_err(|e| e.to_string())?;
        let id = |link: &str| found.report.parts.iter().find(|p| p.link == link).map_or(-1, |p| p.id as i32);
        Ok(evaluation::CloudAnswer {
            confidence: found.report.parts.iter().map(|p| p.confidence).collect(),
            joints: found
                .report
                .joints
                .iter()
                .map(|j| evaluation::AnsweredJoint {
                    part: id(&j.child),
                    slides: j.kind == "prismatic",
                    axis: j.axis.into(),
                    origin: j.origin.into(),
                })
                .collect(),
            part: found.part,
        })
    };
    let table = evaluation::judge_perception(&options, &model, &|line| {
        if *each {
            eprintln!("{line}");
        }
    });
    match format {
        Format::Text => print(&table.to_text()),
        Format::Json => print(&(serde_json::to_string_pretty(&table).map_err(|e| other(&e))? + "\n")),
    }
    Ok(true)
}

fn gap(command: &Evaluate) -> Result<bool, CliError> {
    let Evaluate::Gap { suite, seed, only, out, minutes, format, places } = command else { return Ok(false) };
    let other = |e: &dyn std::fmt::Display| CliError::Other(e.to_string());
    // Whatever robot the library holds.
    let robot = |library: &Library| {
        let all = library.names().ok()?.into_iter().filter_map(|name| library.get(&name).ok());
        all.map(|stored| stored.model.as_ref().clone()).find(|m| m.document.robot.is_some())
    };
    let arm = place::library(places, None).ok().and_then(|library| robot(&library));
    let options = evaluation::Options {
        suite: match suite {
            Suite::Slice => evaluation::Suite::Slice,
            Suite::Full => evaluation::Suite::Full,
        },
        seed: *seed,
        only: only.clone(),
        out: out.clone(),
        sealed: None,
        data: None,
        arm,
        limit: *minutes,
    };
    // What other ways make of the data is not asked here.
    let plain = sagci_gap::Options { baselines: false, ..Default::default() };
    // Runs are spread over the cores, and each keeps to its own: else one would wait for parts of others.
    let workflow = |given: &evaluation::Given| {
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| e.to_string())?;
        let found = alone.install(|| sagci_gap::find(&given.model, &given.train, &given.held_out, &plain));
        serde_json::to_value(found.map_err(|e| e.to_string())?.report).map_err(|e| e.to_string())
    };
    let judged = evaluation::run(&options, &workflow, &|line| eprintln!("{line}")).map_err(|e| other(&e))?;
    let table = evaluation::table(&judged);
    match format {
        Format::Text => print(&table.to_text()),
        Format::Json => print(&(serde_json::to_string_pretty(&table).map_err(|e| other(&e))? + "\n")),
    }
    Ok(true)
}
