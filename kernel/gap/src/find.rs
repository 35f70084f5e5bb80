//! The workflow: known numbers first, then names, one after the other, then a second look at each.

use std::collections::BTreeMap;
use std::time::Instant;

use sagci_dynamics::residual::Residual;
use sagci_model::{Evidence, ObjectModel};
use sagci_recording::Log;

use crate::GapError;
use crate::baselines::baselines;
use crate::climb::{Ascent, Climb};
use crate::experiment;
use crate::fit::Fit;
use crate::gaps::{Measure, gaps};
use crate::given::Given;
use crate::left_over::{Named, left_over};
use crate::map;
use crate::plots::{self, PlotData};
use crate::remainder::remainder as learned_remainder;
use crate::report::{Reason, Report, SCHEMA, Verdict};
use crate::search::{Search, entries};
use crate::settled::Settled;
use crate::weigh::CONVINCING;

/// What may be chosen.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Length of the windows over which positions are predicted, s.
    pub window: f64,
    /// Seed of every random choice.
    pub seed: u64,
    /// Reckons what other ways make of the same data, for comparison.
    pub baselines: bool,
    /// Hears what is being done.
    pub progress: Option<&'a (dyn Fn(&str) + Sync)>,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self { window: 1.0, seed: 1, baselines: true, progress: None }
    }
}

impl std::fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Options").field("window", &self.window).field("seed", &self.seed).finish_non_exhaustive()
    }
}

/// The answer, and the model with what was found in it.
#[derive(Debug, Clone)]
pub struct Found {
    /// The answer.
    pub report: Report,
    /// The model, its known numbers refitted, with the effects as entries of its document.
    pub model: ObjectModel,
    /// A learned force for what is left, where it was kept.
    pub residual: Option<Residual>,
    /// What the report's page draws.
    pub figures: PlotData,
}

/// Finds what the model lacks.
///
/// # Errors
/// Data that do not fit the model or hold too little; a model that cannot be simulated.
pub fn find(model: &ObjectModel, train: &[Log], held_out: &[Log], options: &Options<'_>) -> Result<Found, GapError> {
    let clock = Instant::now();
    let say = |text: &str| {
        if let Some(progress) = options.progress {
            progress(text);
        }
    };
    let Given { locked, train: trajectories, unseen, mut notes } = Given::new(model, train, held_out, options.window)?;
    let model = &locked.model;
    let mut search = Search::beside(model, &trajectories, &unseen, &mut notes)?;
    let still = search.names.iter().zip(&search.still).filter(|(_, still)| **still);
    notes.extend(still.map(|(name, _)| format!("{name}: stands in each recording, if elsewhere in others; nothing is looked for on it")));
    search.check_motion(&mut notes)?;

    say("refitting what the model knows");
    let mut base = search.known(model, 1.0)?;
    let scale = search.scale(&base);
    if search.shorten_steps(&base, scale)? {
        base = search.refit(&base, 1.0)?;
    }
    let given = base.clone();
    let places = map::places(&search, &base, search.scale(&base).min(2.0))?;

    let ascent = Ascent { model, window: options.window, seed: options.seed, say: &say };
    let mut climb = Climb::new(search, base).finish(&ascent)?;
    if let Err(error) = climb.look_again(&ascent) {
        notes.push(format!("a second look at the names was not brought to its end: {error}"));
    }
    let Climb { mut search, base, mut current, mut scale, chosen, lost, nameless_won, adds_up, .. } = climb;

    say("fitting to the end");
    let settled = search.problem.clone();
    search.finer();
    let on = |fit: &Fit| search.fit_on(fit.under(&search.problem)?, scale);
    let finer = on(&current).and_then(|fit| Ok((if chosen.is_empty() { fit.clone() } else { on(&base)? }, fit)));
    let refitted = match finer {
        Ok((refitted, fit)) => {
            current = fit;
            refitted
        }
        // The answer stands as it was found.
        Err(error) => {
            notes.push(format!("the last fit, in finer steps, was left out: {error}"));
            search.problem = settled;
            base.clone()
        }
    };
    scale = search.scale(&current);

    let measure = Measure::new(&search, model, &trajectories, &unseen, options.window);
    let own = Measure::new(&search, model, &trajectories, &[], options.window);
    let mut settled = Settled {
        search: &search,
        refitted: &refitted,
        unseen: &unseen,
        measure: &measure,
        say: &say,
        current,
        scale,
        chosen,
        confirmed: Vec::new(),
        taken_back: Vec::new(),
    };
    // Names that nobody could ask there are not confirmed; what was found stands.
    if let Err(error) = settled.heed_unseen() {
        notes.push(format!("data that nothing was fitted to were not asked of every name: {error}"));
    }
    settled.current = settled.current.with_sines_wrapped();
    let (mut told, mut why) = (None, None);
    if !settled.chosen.is_empty() {
        say("following what the data hardly tell");
        match search.followed(&settled.current, settled.scale, &measure) {
            Ok(followed) => told = Some(followed),
            Err(error) => notes.push(format!("what the data hardly tell was not followed: {error}")),
        }
        let fit = told.as_ref().map_or(&settled.current, |t| &t.fit);
        why = match !search.many_joints() {
            true if own.is_far(&fit.hypothesis, options.seed) => Some("the model stays far from the data over windows of time"),
            true if adds_up => Some("some effects are too small to be told from row to row and are told by what they add up to over many"),
            _ => None,
        };
    }
    if let Some(why) = why {
        say("fitting what is predicted over windows");
        match settled.over_windows(told.clone(), &own) {
            Ok(over) => {
                notes.push(format!("{why}, so the numbers are those that predict windows of time best"));
                told = over;
            }
            Err(error) => {
                notes.push(format!("the last fit, to whole windows, was left out: {error}"));
                // Numbers of names that were taken back meanwhile are none.
                told = told.filter(|t| entries(&t.fit.hypothesis).len() == settled.chosen.len());
            }
        }
    }
    let mut remainder = search.nameless(&settled.current, settled.scale)?;
    let lacking = search.lacking_forces(&refitted, settled.scale)?;
    say("predicting over windows, beside other ways");
    let on_unseen = (!unseen.is_empty()).then_some(&measure);
    let predict = |current: &Fit| gaps(&search, model, [&given, &refitted, current], (&own, on_unseen), options.seed);
    let (predicted, mut others) = rayon::join(
        || predict(told.as_ref().map_or(&settled.current, |t| &t.fit)),
        || {
            if options.baselines {
                baselines(&search, &measure, (&refitted, &lacking), settled.scale, options.seed, why.map(|_| &own))
            } else {
                BTreeMap::new()
            }
        },
    );
    let (mut gap, mut predicted) = predicted?;
    let come_near = match (&remainder, lacking.first()) {
        (Some(left), Some((_, all))) => {
            let fit = told.as_ref().map_or(&settled.current, |t| &t.fit);
            let left_over = left_over(&search, (fit, &refitted), left, &gap, Named::of(&settled.chosen, nameless_won))?;
            let share = left_over.map_or(0.0, |l| l.share);
            settled.only_near(&gap, (left, share), all)?
        }
        _ => None,
    };
    let Settled { mut current, scale, mut chosen, confirmed, taken_back: mut contradicted, .. } = settled;
    if let Some(why) = come_near {
        contradicted
            .extend(chosen.drain(..).map(|gone| Reason { name: gone.best.effect.into(), reason: format!("comes near, but {why}") }));
        current = refitted.clone();
        remainder = lacking.into_iter().next();
        (gap, predicted) = predict(&current)?;
    }

    let variances = match (told.filter(|_| !chosen.is_empty()), chosen.is_empty()) {
        (_, true) => None,
        (Some(told), false) => {
            current = told.fit;
            told.variances
        }
        (None, false) => search.anew(&current).variances(&search.problem, scale),
    };
    let mut effects_found = Vec::new();
    let final_entries = entries(&current.hypothesis);
    for (i, choice) in chosen.iter_mut().enumerate() {
        let Some(entry) = final_entries.get(i).copied() else { continue };
        choice.equivalent = search.alike(choice, &current);
        let (held_out, agrees) = confirmed.get(i).map_or((None, false), |u| (Some(u.fall.min(1e12)), u.confirms()));
        effects_found.push(search.describe(&current, entry, choice, variances.as_deref(), held_out, agrees));
    }

    let named = if come_near.is_some() { Named::Near } else { Named::of(&chosen, nameless_won) };
    let unexplained = remainder.map(|left| left_over(&search, (&current, &refitted), &left, &gap, named)).transpose()?.flatten();
    let verdict = match (&unexplained, effects_found.is_empty()) {
        (Some(_), _) => Verdict::Unknown,
        (None, true) => Verdict::NoGap,
        (None, false) if effects_found.iter().any(|e| !e.alternatives.is_empty()) => Verdict::Ambiguous,
        (None, false) => Verdict::Named,
    };

    let windows = [predicted[0].as_slice(), predicted[2].as_slice()];
    let figures = plots::draw(&search, model, (&refitted, &current), (&trajectories, &unseen), windows, options.window)?;
    let shown = gap.held_out.as_ref().unwrap_or(&gap.train);
    let (mut residual, mut learned) = (None, None);
    if !unseen.is_empty() {
        say("trying a learned force on what is left");
        let (tried, kept) = learned_remainder(&search, &measure, &current, scale, [shown.after, shown.noise_floor], options.seed)?;
        (residual, learned) = (Some(tried), kept);
    }
    if options.baselines {
        others.insert("no_model_change".into(), shown.before);
    }
    say("choosing the next experiment");
    let agreed: Vec<bool> = effects_found.iter().map(|e| e.confirmed).collect();
    let next = match &unexplained {
        Some(left) => experiment::propose_for_nameless(&search, model, left),
        None => experiment::questions(&search, &chosen, &current, &agreed).iter().find_map(|q| experiment::propose(&search, q, scale)),
    };
    let next_experiment = next.map(|e| e.told_to(&model.name, &trajectories, &unseen));
    let mut found = current.hypothesis.model_at(&current.hypothesis.x);
    for (effect, entry) in effects_found.iter().zip(&final_entries) {
        found.document.effects[*entry].evidence = Some(Evidence {
            intervals: effect.parameters.iter().map(|(n, v)| (n.clone(), [v.lower, v.upper])).collect(),
            probability: effect.probability,
            alternatives: effect.alternatives.clone(),
            data: trajectories.iter().map(|t| t.hash.clone()).collect(),
            held_out: unseen.iter().map(|t| t.hash.clone()).collect(),
            gap: gap.held_out.as_ref().map_or([gap.train.refitted, gap.train.after], |g| [g.refitted, g.after]),
        });
    }
    let mut found = locked.freed(found);
    found.state_in_urdf();
    let refused = |(name, gain): &(&str, f64)| Reason {
        name: (*name).into(),
        reason: match *gain > CONVINCING {
            false => format!("evidence e^{gain:.1} of the model without it; e^{CONVINCING:.0} and more is asked for"),
            true => "its force is below what any model is off by, or the errors that it explains hang together too much to tell".to_owned(),
        },
    };
    let mut rejected: Vec<Reason> = lost.iter().take(5).map(refused).collect();
    rejected.extend(contradicted);
    let report = Report {
        schema: SCHEMA,
        verdict,
        effects: effects_found,
        places,
        gap,
        unexplained,
        rejected,
        residual,
        next_experiment,
        baselines: others,
        model: String::new(),
        notes,
        seconds: clock.elapsed().as_secs_f64(),
    };
    Ok(Found { report, model: found, residual: learned, figures })
}
