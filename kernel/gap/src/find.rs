//! The workflow: known numbers first, then names, one after the other, then a second look at each.

use std::collections::BTreeMap;
use std::time::Instant;

use sagci_dynamics::residual::Residual;
use sagci_model::{Evidence, ObjectModel};
use sagci_recording::Log;

use crate::GapError;
use crate::baselines::baselines;
use crate::choice::Choice;
use crate::climb::{Ascent, Climb};
use crate::experiment;
use crate::fit::Fit;
use crate::gaps::{Measure, gaps};
use crate::given::Given;
use crate::left_over::{Named, left_over};
use crate::map;
use crate::plots::{self, PlotData};
use crate::remainder::remainder as learned_remainder;
use crate::report::{Gaps, NamedEffect, Reason, Report, SCHEMA, Unexplained, Verdict};
use crate::search::{Search, entries};
use crate::settled::{Numbers, Settled};
use crate::trajectory::Trajectory;
use crate::unseen::Unseen;
use crate::weigh::CONVINCING;

/// How many of the names that lost are told why.
const LOST: usize = 5;

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
    say("fitting to the end");
    climb.fit_to_the_end(&mut notes);
    let Climb { search, base: refitted, current, scale, chosen, lost, nameless_won, adds_up, .. } = climb;

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
    if let Err(error) = settled.drop_shapes() {
        notes.push(format!("names beside one that leaves little were not asked whether they bend to that: {error}"));
    }
    let Numbers { told, of_windows } = settled.numbers(&own, adds_up, options.seed, &mut notes);

    let mut remainder = search.nameless(&settled.current, settled.scale)?;
    let lacking = search.lacking_forces(&refitted, settled.scale)?;
    say("predicting over windows, beside other ways");
    let on_unseen = (!unseen.is_empty()).then_some(&measure);
    let predict = |current: &Fit| gaps(&search, model, [&given, &refitted, current], (&own, on_unseen), options.seed);
    let fit = told.as_ref().map_or(&settled.current, |t| &t.fit);
    let (predicted, mut baselines) = rayon::join(
        || predict(fit),
        || {
            if options.baselines {
                baselines(&search, &measure, (&refitted, &lacking), settled.scale, options.seed, of_windows.then_some(&own))
            } else {
                BTreeMap::new()
            }
        },
    );
    let (mut gap, mut predicted) = predicted?;

    let learn = |fit: &Fit, gap: &Gaps, scale: f64| match &gap.held_out {
        Some(shown) => {
            say("trying a learned force on what is left");
            let (told, kept) = learned_remainder(&search, &measure, fit, scale, [shown.after, shown.noise_floor], options.seed)?;
            Ok((Some(told), kept))
        }
        None => Ok::<_, GapError>((None, None)),
    };
    let (mut residual, mut learned) = learn(fit, &gap, settled.scale)?;
    let come_near = match (&remainder, lacking.first()) {
        (Some(left), Some((_, all))) => {
            let left_over = left_over(&search, (fit, &refitted), left, &gap, Named::of(&settled.chosen, nameless_won))?;
            settled.only_near(&gap, (left, left_over.map_or(0.0, |l| l.share)), all, residual.as_ref())?
        }
        _ => None,
    };
    let Settled { mut current, scale, mut chosen, confirmed, taken_back, .. } = settled;
    let mut rejected: Vec<Reason> = lost.iter().take(LOST).map(refused).collect();
    rejected.extend(taken_back);
    if let Some(why) = come_near {
        rejected.extend(chosen.drain(..).map(|gone| Reason { name: gone.best.effect.into(), reason: format!("comes near, but {why}") }));
        current = refitted.clone();
        remainder = lacking.into_iter().next();
        (gap, predicted) = predict(&current)?;
        (residual, learned) = learn(&current, &gap, scale)?;
    }
    let variances = match told {
        _ if chosen.is_empty() => None,
        Some(told) => {
            current = told.fit;
            told.variances
        }
        None => search.anew(&current).variances(&search.problem, scale),
    };
    let effects = described(&search, &current, &mut chosen, &confirmed, variances.as_deref());
    let named = if come_near.is_some() { Named::Near } else { Named::of(&chosen, nameless_won) };
    let unexplained = remainder.map(|left| left_over(&search, (&current, &refitted), &left, &gap, named)).transpose()?.flatten();

    let windows = [predicted[0].as_slice(), predicted[2].as_slice()];
    let figures = plots::draw(&search, model, (&refitted, &current), (&trajectories, &unseen), windows, options.window)?;
    if options.baselines {
        baselines.insert("no_model_change".into(), gap.held_out.as_ref().unwrap_or(&gap.train).before);
    }
    say("choosing the next experiment");
    let agreed: Vec<bool> = effects.iter().map(|e| e.confirmed).collect();
    let next = match &unexplained {
        Some(left) => experiment::propose_for_nameless(&search, model, left),
        None => experiment::questions(&search, &chosen, &current, &agreed).iter().find_map(|q| experiment::propose(&search, q, scale)),
    };
    let mut found = locked.freed(with_evidence(&current, &effects, &gap, [&trajectories, &unseen]));
    found.state_in_urdf();
    let report = Report {
        schema: SCHEMA,
        verdict: verdict(unexplained.as_ref(), &effects),
        effects,
        places,
        gap,
        unexplained,
        rejected,
        residual,
        next_experiment: next.map(|e| e.told_to(&model.name, &trajectories, &unseen)),
        baselines,
        model: String::new(),
        notes,
        seconds: clock.elapsed().as_secs_f64(),
    };
    Ok(Found { report, model: found, residual: learned, figures })
}

/// Names as the report says them. `variances` are those of the fit's numbers, where the data fix them.
fn described(search: &Search<'_>, fit: &Fit, chosen: &mut [Choice], confirmed: &[Unseen], variances: Option<&[f64]>) -> Vec<NamedEffect> {
    let described = |(i, (choice, entry)): (usize, (&mut Choice, usize))| {
        choice.equivalent = search.alike(choice, fit);
        let (held_out, agrees) = confirmed.get(i).map_or((None, false), |u| (Some(u.fall.min(1e12)), u.confirms()));
        search.describe(fit, entry, choice, variances, held_out, agrees)
    };
    chosen.iter_mut().zip(entries(&fit.hypothesis)).enumerate().map(described).collect()
}

/// The least certain of the names, or what they leave.
fn verdict(unexplained: Option<&Unexplained>, effects: &[NamedEffect]) -> Verdict {
    match (unexplained, effects) {
        (Some(_), _) => Verdict::Unknown,
        (None, []) => Verdict::NoGap,
        (None, effects) if effects.iter().any(|e| !e.alternatives.is_empty()) => Verdict::Ambiguous,
        (None, _) => Verdict::Named,
    }
}

/// The model with what was found in it, and beside each effect where it comes from.
fn with_evidence(fit: &Fit, effects: &[NamedEffect], gap: &Gaps, [train, unseen]: [&[Trajectory]; 2]) -> ObjectModel {
    let mut model = fit.hypothesis.model_at(&fit.hypothesis.x);
    let hashes = |data: &[Trajectory]| data.iter().map(|t| t.hash.clone()).collect();
    for (effect, entry) in effects.iter().zip(entries(&fit.hypothesis)) {
        model.document.effects[entry].evidence = Some(Evidence {
            intervals: effect.parameters.iter().map(|(n, v)| (n.clone(), [v.lower, v.upper])).collect(),
            probability: effect.probability,
            alternatives: effect.alternatives.clone(),
            data: hashes(train),
            held_out: hashes(unseen),
            gap: gap.held_out.as_ref().map_or([gap.train.refitted, gap.train.after], |g| [g.refitted, g.after]),
        });
    }
    model
}

/// Why a name that lost did: what it says beyond the model without it was not enough, or nothing to be sure of.
fn refused((name, gain): &(&str, f64)) -> Reason {
    let reason = if *gain > CONVINCING {
        "its force is below what any model is off by, or the errors that it explains hang together too much to tell".to_owned()
    } else {
        format!("evidence e^{gain:.1} of the model without it; e^{CONVINCING:.0} and more is asked for")
    };
    Reason { name: (*name).into(), reason }
}
