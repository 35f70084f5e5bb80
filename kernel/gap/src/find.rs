//! The workflow: known numbers first, then names, one after the other, then a second look at each.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use sagci_dynamics::residual::Residual;
use sagci_model::{Evidence, ObjectModel};
use sagci_recording::Log;

use crate::GapError;
use crate::baselines::baselines;
use crate::choice::Choice;
use crate::experiment;
use crate::fit::Fit;
use crate::gaps::{Measure, gaps};
use crate::map;
use crate::plots::{self, PlotData};
use crate::remainder::remainder as learned_remainder;
use crate::report::{Gap, Reason, Report, SCHEMA, Unexplained, Verdict};
use crate::search::{Candidate, Search, entries};
use crate::trajectory::{Trajectory, going_on};
use crate::unseen::{Unseen, set_aside};
use crate::weigh::{CONVINCING, MATERIAL};

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

/// Most effects that are looked for at once.
const MOST: usize = 4;
/// How many times its noise floor a gap may be before something is missing for certain.
const FAR: f64 = 3.0;
/// How many times its noise floor a gap is that cannot be smaller.
const NEAR_FLOOR: f64 = 1.2;
/// Evidence of a force without a name that is there though the gap hardly shows it.
const CERTAIN: f64 = 100.0;
/// What a force that names leave over is of theirs, from which on they may be its neighbours alone, and the share of what they say that one
/// without a name has to say then: its knots cost it what a shape that is right does not pay.
const GOOD_PART: f64 = 0.1;
const NEARLY: f64 = 0.9;
/// Share of the gap that names may leave where much more is left than noise makes.
const MOST_OF_IT: f64 = 0.5;
/// Share of the lacking force below which nobody minds that it has no name.
const NEGLIGIBLE: f64 = 0.02;

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
    let mut notes: Vec<String> =
        train.iter().chain(held_out).flat_map(|l| &l.notes).map(|n| format!("{}: {}", n.place, n.message)).collect();
    // What holds for all recordings is said once.
    let mut said = BTreeSet::new();
    notes.retain(|n| said.insert(n.clone()));
    let (train, held_out) = (going_on(train), going_on(held_out));
    let (train, held_out) = set_aside(&train, &held_out, &mut notes);
    let trajectories: Vec<Trajectory> = train.iter().map(|l| Trajectory::new(l, model)).collect::<Result<_, _>>()?;
    let unseen: Vec<Trajectory> = held_out.iter().map(|l| Trajectory::new(l, model)).collect::<Result<_, _>>()?;
    let mut search = Search::new(model, &trajectories)?;
    search.check_motion(&mut notes)?;

    say("refitting what the model knows");
    let mut base = search.known(model, 1.0)?;
    let given = base.clone();
    let places = map::places(&search, &base, search.scale(&base).min(2.0))?;

    // One name after the other.
    let mut current = base.clone();
    let mut scale = search.scale(&base);
    let mut chosen: Vec<Choice> = Vec::new();
    let mut lost: Vec<(&str, f64)> = Vec::new();
    let mut nameless_won = false;
    // The likeliest, where a plainer one was put before it.
    let mut passed: Option<Vec<Candidate>> = None;
    while chosen.len() < MOST {
        say(&format!("looking for {} missing effect", if chosen.is_empty() { "a" } else { "another" }));
        let mut candidates = search.stage(&current, scale)?;
        let Some(first) = candidates.first() else { break };
        let mut next = search.scale(&first.fit);
        if let Some(noise) = search.likelier_noise(&first.fit)? {
            let before = search.evidence(&current, scale);
            search = search.with_noise(noise);
            base = search.refit(&base, next)?;
            current = if chosen.is_empty() { base.clone() } else { search.refit(&current, next)? };
            candidates = search.weigh_anew(&current, candidates, before, next);
            next = candidates.iter().map(|c| search.scale(&c.fit)).fold(f64::INFINITY, f64::min);
        }
        scale = next;
        search.rank(&mut candidates, scale);
        let here = search.evidence(&current, scale);
        let likeliest = candidates.clone();
        search.prefer_simpler(model, &mut candidates, here, options.window)?;
        search.prefer_two(model, &current, &mut candidates, scale, options.window)?;
        let Some(best) = candidates.first() else { break };
        let gain = best.evidence - here;
        say(&format!("  most likely: {}", best_three(&candidates, here)));
        let force = search.force_between(&current, &best.fit)?;
        let nameless = search.nameless(&current, scale)?;
        say(&format!("  it makes {:.2} % of what accelerates the joint", 100.0 * force));
        // A force without a name is screened in the errors as they are: so it stands beside the best name as that does there.
        let own_gain = search.evidence_in_fit(&best.fit, scale) - search.evidence_in_fit(&current, scale);
        let without_name = nameless.as_ref().map_or(0.0, |(_, n)| n.evidence + gain - own_gain);
        let is_there = |fit: &Fit, force: f64| -> Result<bool, GapError> {
            let gain = search.evidence(fit, scale) - here;
            Ok(search.is_convincing(model, &current, fit, gain, options.window)
                && search.is_material(model, &current, fit, force, options.window)?)
        };
        // What is named already was fitted without the candidate: it is asked once more when all are fitted together.
        let settled = (gain > CONVINCING).then(|| search.settle(&best.fit, scale));
        let there = match &settled {
            Some(fit) => is_there(&best.fit, force)? || is_there(fit, search.force_between(&current, fit)?)?,
            None => false,
        };
        let Some(settled) = settled.filter(|_| there) else {
            nameless_won = without_name > 2.0 * CONVINCING && gain < without_name;
            lost = beside(&candidates, here);
            break;
        };
        // A force below what any model is off by is no second name: beside the first it is what the shape of that is off by. Where the likeliest
        // alone says what the plainer one and this say, that is the shape.
        if !chosen.is_empty() && force < MATERIAL && search.force_between(&current, &settled)? < MATERIAL {
            if let Some((instead, alone)) = search.likeliest_alone(passed.take(), scale)
                && search.evidence(&alone, scale) > search.evidence(&settled, scale) - CONVINCING
                && let Some(last) = chosen.pop()
            {
                say(&format!("  {} alone says as much as {} and this", instead[0].effect, last.best.effect));
                chosen.push(last.giving_way_to(&instead, scale));
                current = alone;
                continue;
            }
            lost = beside(&candidates, here);
            break;
        }
        let explained = search.explained(&current, &best.fit);
        passed = likeliest.first().is_some_and(|c| (c.effect, c.joint) != (best.effect, best.joint)).then_some(likeliest);
        current = settled;
        chosen.push(Choice::new(&candidates, here, without_name, explained, scale));
    }

    // A plainer name that leaves a force over gives way to the likeliest, if that does not.
    if let ([_], true) = (chosen.as_slice(), search.leaves_a_force(&current, scale)?)
        && let Some((instead, alone)) = search.likeliest_alone(passed.take(), scale)
        && search.evidence(&alone, scale) > search.evidence(&current, scale) + CONVINCING
        && !search.leaves_a_force(&alone, scale)?
        && let Some(last) = chosen.pop()
    {
        say(&format!("  {} leaves nothing of what {} does", instead[0].effect, last.best.effect));
        chosen.push(last.giving_way_to(&instead, scale));
        current = alone;
    }

    // A second look at each, now that the others are there.
    if chosen.len() > 1 {
        say("looking again at each effect beside the others");
        let mut at = 0;
        while at < chosen.len() && chosen.len() > 1 {
            let all = entries(&current.hypothesis);
            let alone = current.without(&search.problem, all[at]).and_then(|f| search.fit_on(f, scale));
            // What cannot be simulated without it needs it.
            let Ok(less) = alone else {
                at += 1;
                continue;
            };
            let (with, without) = (search.evidence(&current, scale), search.evidence(&less, scale));
            if !search.is_convincing(model, &less, &current, with - without, options.window) {
                say(&format!("  {} says no more than the others do ({:+.1})", chosen[at].best.effect, with - without));
                current = less;
                chosen.remove(at);
                at = 0;
                continue;
            }
            let mut candidates = search.stage(&less, scale)?;
            search.rank(&mut candidates, scale);
            search.prefer_simpler(model, &mut candidates, without, options.window)?;
            let name = chosen[at].best.effect;
            // What is settled gives way by the same rules by which it was chosen.
            if candidates.first().is_some_and(|c| c.effect != name) {
                search.prefer_two(model, &less, &mut candidates, scale, options.window)?;
            }
            let Some(best) = candidates.first() else { break };
            if best.effect != name && search.takes_the_place(model, &best.fit, &current, best.evidence - with, options.window) {
                say(&format!("  {} says more than {name} beside the others ({:+.1})", best.effect, best.evidence - with));
                current = search.settle(&best.fit, scale);
                let explained = search.explained(&less, &current);
                let choice = Choice::new(&candidates, without, chosen[at].nameless, explained, scale);
                chosen.remove(at);
                chosen.push(choice);
                at = 0;
                continue;
            }
            chosen[at].around(&candidates, [with, without], scale);
            chosen[at].explained = search.explained(&less, &current);
            at += 1;
        }
        // The order of entries is that of the numbers in the hypothesis.
        let order = entries(&current.hypothesis);
        let names: Vec<String> = order.iter().map(|e| current.hypothesis.model.document.effects[*e].effect.clone()).collect();
        chosen.sort_by_key(|c| names.iter().position(|n| n == c.best.effect).unwrap_or(usize::MAX));
    }

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

    // Data that no fit and no choice has seen have a veto, once, over names that are settled: what they contradict is not there.
    let mut contradicted: Vec<Reason> = Vec::new();
    let mut confirmed: Vec<Unseen> = Vec::new();
    let measure = Measure::new(&search, model, &trajectories, &unseen, options.window);
    while !unseen.is_empty() && !chosen.is_empty() {
        confirmed = search.on_unseen(&current, &refitted, &unseen, &measure, scale)?;
        let Some(worst) =
            (0..confirmed.len()).filter(|i| confirmed[*i].contradicts()).min_by(|a, b| confirmed[*a].fall.total_cmp(&confirmed[*b].fall))
        else {
            break;
        };
        let all = entries(&current.hypothesis);
        let gone = chosen.remove(worst);
        say(&format!("  {} is contradicted by data that it was not fitted to", gone.best.effect));
        contradicted.push(confirmed[worst].reason(gone.best.effect));
        current = if chosen.is_empty() { refitted.clone() } else { search.fit_on(current.without(&search.problem, all[worst])?, scale)? };
        scale = search.scale(&current);
        confirmed.clear();
    }
    let mut remainder = search.nameless(&current, scale)?;
    let nameless = search.nameless(&refitted, scale)?;
    say("predicting over windows, beside other ways");
    let predict = |current: &Fit| gaps(&search, model, &given, &refitted, current, &trajectories, &unseen, options);
    let (predicted, mut others) = rayon::join(
        || predict(&current),
        || if options.baselines { baselines(&search, &measure, &refitted, scale, options.seed) } else { BTreeMap::new() },
    );
    let (mut gap, mut predicted) = predicted?;
    // Names that leave data far off which nothing was fitted to are the nearest neighbours, no more, where most of the gap is left, or where a
    // good part of the force is and one without a name says nearly as much as all of them.
    let mut come_near = None;
    if let (Some(left), Some((_, all))) = (&remainder, &nameless)
        && !chosen.is_empty()
        && is_far(gap.held_out.as_ref().unwrap_or(&gap.train))
        && left.1.evidence > 2.0 * CONVINCING
    {
        let shown = gap.held_out.as_ref().unwrap_or(&gap.train);
        let said = search.evidence_in_fit(&current, scale) - search.evidence_in_fit(&refitted, scale);
        let good_part = left.1.force > GOOD_PART * search.explained_force(&current, &refitted)?;
        if shown.after > MOST_OF_IT * shown.refitted {
            come_near = Some("most of the gap is left");
        } else if search.is_a_force(left) && good_part && all.evidence > NEARLY * said {
            come_near = Some("a force without a name fits better");
        }
    }
    if let Some(why) = come_near {
        contradicted
            .extend(chosen.drain(..).map(|gone| Reason { name: gone.best.effect.into(), reason: format!("comes near, but {why}") }));
        current = refitted.clone();
        remainder = nameless;
        (gap, predicted) = predict(&current)?;
    }

    let variances = match chosen.is_empty() {
        true => None,
        false => search.anew(&current).variances(&search.problem, scale),
    };
    let lacking: f64 = search.explained_force(&current, &refitted)?;
    let mut effects_found = Vec::new();
    let final_entries = entries(&current.hypothesis);
    for (i, choice) in chosen.iter_mut().enumerate() {
        let Some(entry) = final_entries.get(i).copied() else { continue };
        choice.equivalent = search.alike(choice, &current);
        let (held_out, agrees) = confirmed.get(i).map_or((None, false), |u| (Some(u.fall.min(1e12)), u.confirms()));
        effects_found.push(search.describe(&current, entry, choice, variances.as_deref(), held_out, agrees));
    }

    // What is left.
    let typical = search.typical_force();
    // Windows that are far off say so even where the force is small beside others.
    let off = is_far(&gap.train);
    // Where nothing is named and data that nothing was fitted to are far off, something is missing that the known numbers hide where they are
    // fitted. What many joints are off by is mostly chance: nothing holds them.
    let lacks = gap.held_out.as_ref().map_or(off, is_far) && chosen.is_empty() && !search.many_joints();
    // A model that lacks no name and predicts as well as the noise lets any lacks nothing that its errors alone hint at.
    let at_the_floor = chosen.is_empty() && gap.train.after < NEAR_FLOOR * gap.train.noise_floor;
    let unexplained = remainder.and_then(|(joint, n)| {
        let share = n.force / (lacking.hypot(n.force)).max(1e-12);
        let felt = n.force > MATERIAL * typical[joint] || off;
        let counts = n.evidence > 2.0 * CONVINCING && share > NEGLIGIBLE;
        let likely = n.evidence > if at_the_floor { CERTAIN } else { 0.0 };
        (lacks || come_near.is_some() || felt && likely && (counts || nameless_won && chosen.is_empty())).then(|| Unexplained {
            share,
            joint: search.names[joint].clone(),
            over: n.over.into(),
            region: n.region,
        })
    });
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
    let next_experiment = next.map(|e| e.told_to(&model.name, &train, &held_out));
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

/// Candidates, and what each says beyond the model without it.
fn beside(candidates: &[Candidate], here: f64) -> Vec<(&'static str, f64)> {
    candidates.iter().map(|c| (c.effect, c.evidence - here)).collect()
}

/// Is a gap much larger than noise makes it?
fn is_far(gap: &Gap) -> bool {
    gap.after > FAR * gap.noise_floor
}

fn best_three(candidates: &[Candidate], here: f64) -> String {
    let all: Vec<String> = candidates.iter().take(3).map(|c| format!("{} ({:+.1})", c.effect, c.evidence - here)).collect();
    all.join(", ")
}
