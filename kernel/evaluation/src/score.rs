//! An answer held against the truth, and the table of many.
//!
//! A name is right where it is the hidden effect's, alone; where these data cannot tell it from others
//! ([`crate::indistinguishable`]), the answer must hold it and none beyond those. Intervals of rates are Wilson's (1927), 95 %.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::effect::{CATALOGUE, channels};
use crate::scenario::{Hidden, RunId, RunKind, SealedTruth};

/// Held-out errors of prediction, pooled over joints in shares of their ranges; not a number where the answer gives none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// With the model as given.
    #[serde(with = "maybe")]
    pub before: f64,
    /// After the known parameters were refitted.
    #[serde(with = "maybe")]
    pub refitted: f64,
    /// With the effects that were named.
    #[serde(with = "maybe")]
    pub after: f64,
    /// What the workflow says is noise.
    #[serde(with = "maybe")]
    pub noise_floor: f64,
    /// The true mechanism's, from true starts.
    #[serde(with = "maybe")]
    pub oracle: f64,
}

/// JSON has no word for what is not a number: null.
mod maybe {
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(x: &f64, s: S) -> Result<S::Ok, S::Error> {
        if x.is_finite() { s.serialize_f64(*x) } else { s.serialize_none() }
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(d: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(d)?.unwrap_or(f64::NAN))
    }
}

/// One entry of an answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Named {
    /// The name.
    pub name: String,
    /// Those that the workflow could not tell from it.
    pub alternatives: Vec<String>,
    /// The joint, empty where there is none.
    pub joint: String,
    /// The channel.
    pub channel: String,
}

impl Named {
    fn set(&self) -> BTreeSet<&str> {
        self.alternatives.iter().map(String::as_str).chain([self.name.as_str()]).collect()
    }
}

/// What came of the experiments that an answer asked for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Trial {
    /// Their names, in the order in which they were asked for; the last may be one that is no motion.
    pub asked: Vec<String>,
    /// How many were begun.
    pub done: usize,
    /// What was named in the end; nothing where there was no last answer.
    pub named: Vec<Named>,
    /// That is nothing but the truth, and the whole of it.
    pub settled: bool,
    /// Why it ended early: the mechanism ran away, or the workflow gave no answer to what was recorded.
    #[serde(default)]
    pub failure: Option<String>,
}

/// One answer, judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Which run.
    pub id: RunId,
    /// The suite's seed.
    pub seed: u64,
    /// Names that were hidden.
    pub hidden: Vec<String>,
    /// Is each visible in the data?
    pub visible: Vec<bool>,
    /// Can each be told from simpler ones in the data?
    pub nameable: Vec<bool>,
    /// Least signal to noise among them, beyond simpler effects.
    pub snr: f64,
    /// Mechanism and engine.
    pub plant: String,
    /// The verdict that was given.
    pub verdict: String,
    /// What was named.
    pub named: Vec<Named>,
    /// Nothing but the truth, and the whole of it.
    pub exact: bool,
    /// Every hidden effect is in a set of its own.
    pub in_sets: bool,
    /// Mean size of the sets.
    pub set_size: f64,
    /// Names whose sets hold nothing that is true.
    pub false_names: Vec<String>,
    /// Of the hidden effects that are in a set: on the right joint? Under the right channel?
    pub joint_right: Option<bool>,
    /// See `joint_right`.
    pub channel_right: Option<bool>,
    /// For an effect outside the catalogue: is its joint pointed at?
    pub place_right: Option<bool>,
    /// True parameters inside their intervals, and intervals.
    pub covered: [usize; 2],
    /// Where the truth was among names that the data could not tell apart: what experiments made of it.
    #[serde(default)]
    pub trial: Option<Trial>,
    /// Held-out gap.
    pub gap: Gap,
    /// What the workflow says that it took, s.
    pub seconds: f64,
    /// What it took by the clock, others beside it, s.
    pub wall: f64,
    /// Why there is no answer, where there is none.
    pub failure: Option<String>,
}

fn strings(value: &Value) -> Vec<String> {
    value.as_array().map(|a| a.iter().filter_map(Value::as_str).map(str::to_owned).collect()).unwrap_or_default()
}

fn right(hidden: &Hidden, named: &Named) -> bool {
    let truth = hidden.entry.effect.as_str();
    if hidden.indistinguishable.is_empty() {
        return named.name == truth && named.set().len() == 1;
    }
    let class: BTreeSet<&str> = hidden.indistinguishable.iter().map(String::as_str).chain([truth]).collect();
    named.set().contains(truth) && named.set().is_subset(&class)
}

/// Holds an answer (the workflow's JSON, or why there is none) against the truth.
pub fn judge(truth: &SealedTruth, answer: &Result<Value, String>, wall: f64) -> Judgement {
    let blank = Value::Null;
    let report = answer.as_ref().unwrap_or(&blank);
    let effects = report["effects"].as_array().cloned().unwrap_or_default();
    let named: Vec<Named> = effects
        .iter()
        .map(|e| Named {
            name: e["name"].as_str().unwrap_or_default().to_owned(),
            alternatives: strings(&e["alternatives"]).into_iter().filter(|a| Some(a.as_str()) != e["name"].as_str()).collect(),
            joint: e["joint"].as_str().unwrap_or_default().to_owned(),
            channel: e["channel"].as_str().unwrap_or_default().to_owned(),
        })
        .collect();

    // Each hidden effect takes an entry of its own.
    let assign = |fits: &dyn Fn(&Hidden, &Named) -> bool| -> Vec<Option<usize>> {
        let mut taken = BTreeSet::new();
        truth
            .hidden
            .iter()
            .map(|h| {
                let found = (0..named.len()).find(|k| !taken.contains(k) && fits(h, &named[*k]));
                taken.extend(found);
                found
            })
            .collect()
    };
    let exact_at = assign(&right);
    let in_set_at = assign(&|h, n| n.set().contains(h.entry.effect.as_str()));
    let exact =
        answer.is_ok() && exact_at.iter().all(Option::is_some) && named.len() == truth.hidden.len() && truth.id.kind != RunKind::Outside;
    let true_names: BTreeSet<&str> = truth.hidden.iter().map(|h| h.entry.effect.as_str()).collect();
    let false_names = named.iter().filter(|n| n.set().is_disjoint(&true_names)).map(|n| n.name.clone()).collect::<Vec<_>>();

    let (mut joints, mut channels_right, mut covered) = (Vec::new(), Vec::new(), [0, 0]);
    for (hidden, at) in truth.hidden.iter().zip(&in_set_at) {
        let Some(at) = *at else { continue };
        joints.push(hidden.entry.joint.as_deref().is_none_or(|j| j == named[at].joint));
        let name = named[at].name.as_str();
        channels_right.push(
            channels(&hidden.entry.effect).contains(&named[at].channel.as_str()) || channels(name).contains(&named[at].channel.as_str()),
        );
        if name == hidden.entry.effect {
            coverage(hidden, &effects[at]["parameters"], truth.joints.len(), &mut covered);
        }
    }
    let place_right = (truth.id.kind == RunKind::Outside).then(|| {
        let joint = truth.hidden.first().and_then(|h| h.entry.joint.clone()).unwrap_or_default();
        report["unexplained"]["joint"].as_str() == Some(&joint)
            || report["where"].as_array().is_some_and(|w| w.iter().any(|w| w["joint"].as_str() == Some(&joint)))
    });
    let held = &report["gap"]["held_out"];
    let number = |v: &Value| v.as_f64().unwrap_or(f64::NAN);
    let sizes: Vec<usize> = named.iter().map(|n| n.set().len()).collect();
    Judgement {
        id: truth.id.clone(),
        seed: truth.seed,
        hidden: truth.hidden.iter().map(|h| h.entry.effect.clone()).collect(),
        visible: truth.hidden.iter().map(|h| h.detectability.is_visible()).collect(),
        nameable: truth.hidden.iter().map(|h| h.detectability.is_nameable()).collect(),
        snr: truth.hidden.iter().map(|h| h.detectability.snr_beyond_neighbours).fold(f64::MAX, f64::min).min(1e12),
        plant: format!("{}, {}", truth.mechanism, truth.engine),
        verdict: report["verdict"].as_str().unwrap_or_default().to_owned(),
        exact,
        in_sets: answer.is_ok() && in_set_at.iter().all(Option::is_some),
        set_size: if sizes.is_empty() { 0.0 } else { sizes.iter().sum::<usize>() as f64 / sizes.len() as f64 },
        named,
        false_names,
        joint_right: (!joints.is_empty()).then(|| joints.iter().all(|x| *x)),
        channel_right: (!channels_right.is_empty()).then(|| channels_right.iter().all(|x| *x)),
        place_right,
        covered,
        trial: None,
        gap: Gap {
            before: number(&held["before"]),
            refitted: number(&held["refitted"]),
            after: number(&held["after"]),
            noise_floor: number(&held["noise_floor"]),
            oracle: truth.oracle_gap,
        },
        seconds: report["seconds"].as_f64().unwrap_or(wall),
        wall,
        failure: answer.as_ref().err().cloned(),
    }
}

/// Counts the true parameters inside their intervals. What the data cannot fix by itself is left out: the direction and the origin of
/// an axis, where a load sits on a single joint, and choices.
fn coverage(hidden: &Hidden, reported: &Value, joints: usize, covered: &mut [usize; 2]) {
    let name = hidden.entry.effect.as_str();
    if name == "joint_axis_error" || (name == "payload" && joints == 1) {
        return;
    }
    let interval = |p: &str| Some((reported[p]["lower"].as_f64()?, reported[p]["upper"].as_f64()?));
    for (p, &value) in &hidden.entry.parameters {
        if matches!((name, p.as_str()), ("hard_stop", "side") | ("stribeck_friction" | "presliding_hysteresis", "exponent")) {
            continue;
        }
        let Some((lower, upper)) = interval(p) else { continue };
        // A sine of the other sign half a turn on is the same.
        let periodic = matches!(name, "torque_ripple" | "hinge_tilt");
        let flipped = periodic
            && hidden
                .entry
                .parameters
                .get("amplitude")
                .is_some_and(|a| reported["amplitude"]["value"].as_f64().is_some_and(|r| r * a < 0.0));
        let inside = match p.as_str() {
            "phase" if periodic => {
                let base = if flipped { value + std::f64::consts::PI } else { value };
                (-3..=3).any(|k| (lower..=upper).contains(&(base + f64::from(k) * std::f64::consts::TAU)))
            }
            "amplitude" if flipped => (lower..=upper).contains(&-value),
            _ => (lower..=upper).contains(&value),
        };
        covered[0] += usize::from(inside);
        covered[1] += 1;
    }
}

/// One row of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What is measured.
    pub measure: String,
    /// The figure; a rate is between 0 and 1.
    #[serde(with = "maybe")]
    pub value: f64,
    /// Ends of its 95 % interval, where it is a rate.
    pub interval: Option<[f64; 2]>,
    /// How many runs it comes from.
    pub count: usize,
    /// The target, in words.
    pub target: String,
    /// Is it met? `None` where there is no target or no run.
    pub met: Option<bool>,
}

/// How one effect fared: `[right, of]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct EffectRow {
    /// Exact names by noise level, where the oracle can name it.
    pub exact: [[usize; 2]; 3],
    /// In the set, where the oracle can see it.
    pub in_set: [usize; 2],
    /// Visible, of all runs.
    pub visible: [usize; 2],
    /// Names that were given instead, and how often; `-` for none.
    pub taken_for: BTreeMap<String, usize>,
}

/// The figures of a suite.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Table {
    /// The measures and their targets.
    pub rows: Vec<Row>,
    /// Single effects.
    pub effects: BTreeMap<String, EffectRow>,
    /// What stands outside the catalogue: `[unknown with its place, wrongly named, runs]`.
    pub outside: BTreeMap<String, [usize; 3]>,
    /// Runs that gave no answer, at first or after an experiment.
    pub failures: Vec<String>,
}

/// Wilson's interval of a rate.
fn wilson(good: usize, of: usize) -> [f64; 2] {
    if of == 0 {
        return [0.0, 1.0];
    }
    let (n, p, z) = (of as f64, good as f64 / of as f64, 1.959_964);
    let middle = p + z * z / (2.0 * n);
    let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    let whole = 1.0 + z * z / n;
    [((middle - half) / whole).max(0.0), ((middle + half) / whole).min(1.0)]
}

fn median(mut x: Vec<f64>) -> f64 {
    x.retain(|x| x.is_finite());
    x.sort_by(f64::total_cmp);
    let n = x.len();
    if n == 0 { f64::NAN } else { (x[n / 2] + x[(n - 1) / 2]) / 2.0 }
}

/// What a figure must be.
enum Must {
    AtLeast(f64),
    AtMost(f64),
    Within(f64, f64),
    Nothing,
}

impl Table {
    fn row(&mut self, measure: &str, value: f64, interval: Option<[f64; 2]>, count: usize, must: Must, target: &str) {
        let met = match must {
            _ if count == 0 || !value.is_finite() => None,
            Must::AtLeast(least) => Some(value >= least),
            Must::AtMost(most) => Some(value <= most),
            Must::Within(least, most) => Some((least..=most).contains(&value)),
            Must::Nothing => None,
        };
        self.rows.push(Row { measure: measure.into(), value, interval, count, target: target.into(), met });
    }

    fn rate(&mut self, measure: &str, runs: &[&Judgement], good: impl Fn(&Judgement) -> bool, must: Must, target: &str) {
        let right = runs.iter().filter(|j| good(j)).count();
        let value = if runs.is_empty() { f64::NAN } else { right as f64 / runs.len() as f64 };
        self.row(measure, value, Some(wilson(right, runs.len())), runs.len(), must, target);
    }

    /// The table as text.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        let _ = writeln!(text, "{:<58} {:>8} {:>15} {:>6}  {:<28} met", "measure", "value", "95 %", "runs", "target");
        for row in &self.rows {
            let interval = row.interval.filter(|_| row.count > 0).map_or_else(String::new, |[a, b]| format!("{a:.3} .. {b:.3}"));
            let met = row.met.map_or("", |m| if m { "yes" } else { "NO" });
            let value = if row.value.is_finite() { format!("{:.3}", row.value) } else { "-".into() };
            let _ = writeln!(text, "{:<58} {value:>8} {interval:>15} {:>6}  {:<28} {met}", row.measure, row.count, row.target);
        }
        let _ = writeln!(
            text,
            "\n{:<29} {:>9} {:>9} {:>9} {:>9} {:>9}  taken for",
            "single effect", "level 1", "level 2", "level 3", "in set", "visible"
        );
        let share = |[good, of]: [usize; 2]| format!("{good}/{of}");
        for (name, row) in &self.effects {
            let taken: Vec<String> = row.taken_for.iter().map(|(n, c)| format!("{n} {c}")).collect();
            let [a, b, c] = row.exact.map(share);
            let (set, visible) = (share(row.in_set), share(row.visible));
            let _ = writeln!(text, "{name:<29} {a:>9} {b:>9} {c:>9} {set:>9} {visible:>9}  {}", taken.join(", "));
        }
        if !self.outside.is_empty() {
            let _ = writeln!(text, "\n{:<29} {:>9} {:>9} {:>9}", "outside the catalogue", "unknown", "named", "runs");
            for (name, [unknown, named, of]) in &self.outside {
                let _ = writeln!(text, "{name:<29} {unknown:>9} {named:>9} {of:>9}");
            }
        }
        for failure in &self.failures {
            let _ = writeln!(text, "no answer: {failure}");
        }
        text
    }
}

/// The table of many judgements.
pub fn table(all: &[Judgement]) -> Table {
    let mut t = Table::default();
    let of = |kind: RunKind| all.iter().filter(move |j| j.id.kind == kind).collect::<Vec<_>>();
    let (single, clean, outside, arm) = (of(RunKind::Single), of(RunKind::Clean), of(RunKind::Outside), of(RunKind::Arm));
    let nameable: Vec<&Judgement> = single.iter().copied().filter(|j| j.nameable.iter().all(|x| *x)).collect();
    let visible: Vec<&Judgement> = single.iter().copied().filter(|j| j.visible.iter().all(|x| *x)).collect();

    for name in CATALOGUE {
        let mine: Vec<&&Judgement> = single.iter().filter(|j| j.id.effect == name).collect();
        if mine.is_empty() {
            continue;
        }
        let row = t.effects.entry(name.to_owned()).or_default();
        for j in mine {
            row.visible[1] += 1;
            if j.visible.iter().all(|x| *x) {
                row.visible[0] += 1;
                row.in_set[1] += 1;
                row.in_set[0] += usize::from(j.in_sets);
            }
            if j.nameable.iter().all(|x| *x) {
                let cell = &mut row.exact[j.id.level.clamp(1, 3) - 1];
                cell[1] += 1;
                cell[0] += usize::from(j.exact);
                if !j.exact {
                    let said: Vec<String> = j.named.iter().map(|n| n.set().into_iter().collect::<Vec<_>>().join("|")).collect();
                    let said =
                        if said.is_empty() { if j.verdict == "unknown" { "unknown".into() } else { "-".into() } } else { said.join(" + ") };
                    *row.taken_for.entry(said).or_default() += 1;
                }
            }
        }
    }
    for j in &outside {
        let row = t.outside.entry(j.id.effect.clone()).or_default();
        row[0] += usize::from(j.verdict == "unknown" && j.named.is_empty() && j.place_right == Some(true));
        row[1] += usize::from(!j.named.is_empty());
        row[2] += 1;
    }

    let rates: Vec<(f64, usize)> = t
        .effects
        .values()
        .map(|r| (r.exact.iter().map(|e| e[0]).sum::<usize>(), r.exact.iter().map(|e| e[1]).sum::<usize>()))
        .filter(|r| r.1 > 0)
        .map(|(good, of)| (good as f64 / of as f64, of))
        .collect();
    let to_target = rates.iter().filter(|r| r.0 >= 0.9).count();
    let judged = rates.len();
    t.row("effects named exactly in 90 % of their runs", to_target as f64, None, judged, Must::AtLeast(24.0), ">= 24, stretch 33");
    t.rate("exact single name, where an oracle can name it", &nameable, |j| j.exact, Must::AtLeast(0.95), ">= 0.95, stretch 0.98");
    for level in 1..=3 {
        let at: Vec<&Judgement> = nameable.iter().copied().filter(|j| j.id.level == level).collect();
        t.rate(&format!("exact single name, noise level {level}"), &at, |j| j.exact, Must::AtLeast(0.95), ">= 0.95");
    }
    let least = rates.iter().map(|r| r.0).fold(f64::NAN, f64::min);
    t.row("exact single name, the effect that fares worst", least, None, judged, Must::AtLeast(0.9), ">= 0.90");
    t.rate("exact single name, all runs", &single, |j| j.exact, Must::Nothing, "");
    t.rate("the true effect is in the set, where it is visible", &visible, |j| j.in_sets, Must::AtLeast(0.99), ">= 0.99");
    let sizes: Vec<f64> = visible.iter().filter(|j| j.in_sets).map(|j| j.set_size).collect();
    let mean = if sizes.is_empty() { f64::NAN } else { sizes.iter().sum::<f64>() / sizes.len() as f64 };
    t.row("mean size of the set", mean, None, sizes.len(), Must::AtMost(1.3), "<= 1.3");
    t.rate("a false name on clean data", &clean, |j| !j.named.is_empty(), Must::AtMost(0.01), "<= 0.01, stretch 0.003");
    for level in 1..=3 {
        let at: Vec<&Judgement> = clean.iter().copied().filter(|j| j.id.level == level).collect();
        t.rate(&format!("a false name on clean data, noise level {level}"), &at, |j| !j.named.is_empty(), Must::AtMost(0.01), "<= 0.01");
    }
    for (kind, word, must) in [(RunKind::Double, "two", 0.85), (RunKind::Triple, "three", 0.65)] {
        let runs: Vec<&Judgement> = of(kind);
        let able: Vec<&Judgement> = runs.iter().copied().filter(|j| j.nameable.iter().all(|x| *x)).collect();
        let target = format!(">= {must}");
        t.rate(&format!("{word} effects, exact where an oracle can name them"), &able, |j| j.exact, Must::AtLeast(must), &target);
        t.rate(&format!("{word} effects, nothing false added"), &runs, |j| j.false_names.is_empty(), Must::AtLeast(0.95), ">= 0.95");
    }
    let clear: Vec<&Judgement> = outside.iter().copied().filter(|j| j.visible.iter().all(|x| *x)).collect();
    let unknown = |j: &Judgement| j.verdict == "unknown" && j.named.is_empty() && j.place_right == Some(true);
    t.rate("outside the catalogue: unknown, with its place", &clear, unknown, Must::AtLeast(0.9), ">= 0.90");
    t.rate("outside the catalogue: wrongly named", &outside, |j| !j.named.is_empty(), Must::AtMost(0.05), "<= 0.05");
    let tried: Vec<(&Trial, &Judgement)> = all.iter().filter_map(|j| Some((j.trial.as_ref()?, j))).collect();
    let moved: Vec<&Judgement> = tried.iter().filter(|(trial, _)| trial.done > 0).map(|(_, j)| *j).collect();
    let tried: Vec<&Judgement> = tried.into_iter().map(|(_, j)| j).collect();
    let settled = |j: &Judgement| j.trial.as_ref().is_some_and(|trial| trial.settled);
    t.rate(
        "several names, the truth among them: a motion is proposed",
        &tried,
        |j| j.trial.as_ref().is_some_and(|t| t.done > 0),
        Must::Nothing,
        "",
    );
    t.rate("such a set, settled by the motion proposed, in two at most", &moved, settled, Must::AtLeast(0.9), ">= 0.90");
    let seen: Vec<&Judgement> = arm.iter().copied().filter(|j| j.visible.iter().all(|x| *x)).collect();
    let place = |j: &Judgement| j.joint_right == Some(true) && j.channel_right == Some(true);
    t.rate("the right joint and channel on an arm", &seen, place, Must::AtLeast(0.97), ">= 0.97");
    t.rate("exact single name on an arm", &seen, |j| j.exact, Must::Nothing, "");
    let covered = all.iter().fold([0, 0], |s, j| [s[0] + j.covered[0], s[1] + j.covered[1]]);
    let rate = if covered[1] == 0 { f64::NAN } else { covered[0] as f64 / covered[1] as f64 };
    t.row("95 % intervals that cover", rate, Some(wilson(covered[0], covered[1])), covered[1], Must::Within(0.92, 0.97), "0.92 .. 0.97");

    let good: Vec<&Judgement> = visible.iter().copied().filter(|j| j.exact).collect();
    let shrink = median(good.iter().map(|j| j.gap.before / j.gap.after).collect());
    t.row("held-out gap shrinks, median", shrink, None, good.len(), Must::AtLeast(10.0), ">= 10");
    let floored = median(good.iter().map(|j| j.gap.after / j.gap.noise_floor).collect());
    t.row("held-out gap after / noise floor, median", floored, None, good.len(), Must::Nothing, "");
    let oracle = median(good.iter().map(|j| j.gap.after / j.gap.oracle).collect());
    t.row("held-out gap after / true mechanism's, median", oracle, None, good.len(), Must::AtMost(1.1), "<= 1.10 of the oracle's fit");
    for (runs, word, limit) in
        [(all.iter().filter(|j| j.id.kind != RunKind::Arm).collect::<Vec<_>>(), "few joints", 5.0), (arm.clone(), "seven joints", 60.0)]
    {
        let answered: Vec<f64> = runs.iter().filter(|j| j.failure.is_none()).map(|j| j.seconds).collect();
        let target = format!("< {limit} s alone on two cores");
        t.row(&format!("seconds, {word}, median"), median(answered.clone()), None, answered.len(), Must::AtMost(limit), &target);
        t.row(
            &format!("seconds, {word}, longest"),
            answered.iter().copied().fold(f64::NAN, f64::max),
            None,
            answered.len(),
            Must::Nothing,
            "",
        );
    }
    let first = |j: &Judgement| j.failure.as_ref().map(|f| format!("{}: {f}", j.id));
    let later = |j: &Judgement| {
        let trial = j.trial.as_ref()?;
        trial.failure.as_ref().map(|f| format!("{}, after {}: {f}", j.id, trial.asked.join(", ")))
    };
    t.failures = all.iter().filter_map(|j| first(j).or_else(|| later(j))).collect();
    t
}
