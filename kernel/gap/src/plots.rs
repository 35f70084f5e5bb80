//! What the report's page draws: measured and predicted motion, the force that is lacking, and what the known numbers became.
//!
//! Nothing here is part of the answer; it is taken from the fits that gave the answer.

use sagci_dynamics::effects;
use sagci_model::{JointKind, ObjectModel};

use crate::GapError;
use crate::fit::Fit;
use crate::response::Response;
use crate::search::Search;
use crate::starts::observable;
use crate::trajectory::{Drive, Trajectory};
use crate::windows::Window;

/// Series for a person's eyes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlotData {
    /// The recordings.
    pub recordings: Vec<Recording>,
    /// Joint by joint, in the model's order.
    pub joints: Vec<JointPlot>,
    /// Known numbers that the data moved.
    pub known: Vec<Changed>,
    /// Names of the catalogue that such data cannot show, whatever they hold.
    pub not_observable: Vec<String>,
    /// How many names were tried.
    pub tried: usize,
    /// The windows are of data that nothing was fitted to.
    pub held_out: bool,
    /// Length of the windows, s.
    pub window: f64,
}

/// One recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Where it was read from.
    pub source: String,
    /// SHA-256 of its bytes.
    pub hash: String,
    /// Times at which something was measured or an input changed.
    pub rows: usize,
    /// How long it is, s.
    pub seconds: f64,
    /// Nothing was fitted to it.
    pub held_out: bool,
}

/// What is drawn of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointPlot {
    /// The joint.
    pub joint: String,
    /// Unit of its position, and of its force.
    pub units: [&'static str; 2],
    /// What moves it.
    pub drive: &'static str,
    /// Standard deviation of the noise on its position, rad or m.
    pub noise: f64,
    /// Least and greatest position in all data, velocity and time in those of the fit.
    pub position: [f64; 2],
    /// Velocities.
    pub velocity: [f64; 2],
    /// Times.
    pub time: [f64; 2],
    /// Up to three windows.
    pub windows: Vec<WindowPlot>,
    /// The lacking force over position, with the known numbers refitted and with the effects.
    pub lacking: [Vec<Bin>; 2],
}

/// Measured and predicted motion of one joint in one window.
#[derive(Debug, Clone, PartialEq)]
pub struct WindowPlot {
    /// Why it is shown: its rank among all windows by the error of the model as given.
    pub rank: &'static str,
    /// The recording.
    pub source: String,
    /// Times, s.
    pub time: Vec<f64>,
    /// Measured positions; NaN where nothing was measured.
    pub measured: Vec<f64>,
    /// Predicted by the model as given; NaN where it diverged.
    pub before: Vec<f64>,
    /// Predicted with the effects.
    pub after: Vec<f64>,
    /// RMS of both errors.
    pub rmse: [f64; 2],
}

/// Median lacking force in one bin of positions, by direction, with the standard deviation of the median.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// Middle of the bin, rad or m.
    pub position: f64,
    /// While the position grows; none where the data hardly ever are.
    pub forward: Option<[f64; 2]>,
    /// While it falls.
    pub backward: Option<[f64; 2]>,
}

/// A known number and what became of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Changed {
    /// Which one.
    pub what: String,
    /// As given.
    pub given: f64,
    /// Refitted, without effects.
    pub refitted: f64,
    /// Refitted beside the effects.
    pub beside: f64,
    /// Unit.
    pub unit: &'static str,
}

/// Bins of position.
const BINS: usize = 24;
/// Fewest samples of which a median is drawn.
const FEWEST: usize = 8;
/// Most points of a line.
const POINTS: usize = 240;

/// Everything that is drawn. `predicted` are the windows of the data that are shown, by the model as given and with the effects.
pub(crate) fn draw(
    search: &Search<'_>,
    model: &ObjectModel,
    (refitted, current): (&Fit, &Fit),
    (train, unseen): (&[Trajectory], &[Trajectory]),
    [before, after]: [&[Window]; 2],
    window: f64,
) -> Result<PlotData, GapError> {
    let shown = if unseen.is_empty() { train } else { unseen };
    let runs = [search.runs(refitted)?, search.runs(current)?];
    let joints = (0..search.names.len())
        .map(|j| {
            let joint = &model.joints[search.joints[j]];
            let sliding = joint.kind == JointKind::Prismatic;
            let places = [(refitted, &runs[0]), (current, &runs[1])].map(|(fit, runs)| {
                let response = Response::new(search, fit, runs, j);
                let at = response.places();
                let lacking = response.lacking(&fit.errors);
                (at, lacking)
            });
            let range = |f: &dyn Fn(&crate::flexible::Place) -> f64| span(places[0].0.iter().map(f));
            let drive = train.iter().map(|t| t.drive[j]).find(|d| *d != Drive::Free);
            JointPlot {
                joint: search.names[j].clone(),
                units: if sliding { ["m", "N"] } else { ["rad", "N m"] },
                drive: match drive {
                    None => "nothing that was measured",
                    Some(Drive::Command(_)) => "a command, through its drive's law",
                    Some(_) => "a measured effort",
                },
                noise: search.problem.disturbance.position[j],
                position: span(train.iter().chain(unseen).flat_map(|t| t.positions(j))),
                velocity: range(&|p| p.v),
                time: range(&|p| p.time),
                windows: chosen(before, after, shown, j),
                lacking: [0, 1].map(|i| bins(&places[i].0, &places[i].1)),
            }
        })
        .collect();
    let recording = |t: &Trajectory, held_out: bool| Recording {
        source: t.source.clone(),
        hash: t.hash.clone(),
        rows: t.rows(),
        seconds: t.time.last().zip(t.time.first()).map_or(0.0, |(b, a)| b - a),
        held_out,
    };
    let seen = |d: &effects::Description| (0..search.names.len()).any(|j| observable(d.name, search.seen[j]));
    let catalogue = effects::catalogue().iter().map(|e| e.description());
    let (tried, not): (Vec<&effects::Description>, Vec<&effects::Description>) = catalogue.partition(|d| seen(d));
    Ok(PlotData {
        recordings: train.iter().map(|t| recording(t, false)).chain(unseen.iter().map(|t| recording(t, true))).collect(),
        joints,
        known: changed(model, &refitted.hypothesis.model_at(&refitted.hypothesis.x), &current.hypothesis.model_at(&current.hypothesis.x)),
        not_observable: not.iter().map(|d| d.name.to_owned()).collect(),
        tried: tried.len(),
        held_out: !unseen.is_empty(),
        window,
    })
}

fn span(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values.filter(|x| x.is_finite()).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
    if low <= high { [low, high] } else { [0.0, 0.0] }
}

/// The windows of which a person learns most: the middle one by the error of the model as given, one of the worse, and the worst.
fn chosen(before: &[Window], after: &[Window], data: &[Trajectory], joint: usize) -> Vec<WindowPlot> {
    let Some(n) = data.first().map(|t| t.joints) else { return Vec::new() };
    let measured = |w: &Window, k: usize| data[w.trajectory].position[(w.first + k) * n + joint];
    let rmse = |w: &Window| {
        let errors = (0..w.position.len() / n).map(|k| (w.position[k * n + joint], measured(w, k))).filter(|(_, y)| y.is_finite());
        let (sum, count) = errors.fold((0.0, 0.0), |(s, c), (x, y)| (s + (x - y) * (x - y), c + 1.0));
        // One that diverged is worse than all others.
        if count < 1.0 { 0.0 } else { Some((sum / count).sqrt()).filter(|x| x.is_finite()).unwrap_or(f64::INFINITY) }
    };
    let mut order: Vec<(f64, usize)> = before.iter().zip(after).enumerate().map(|(i, (w, _))| (rmse(w), i)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(last) = order.len().checked_sub(1) else { return Vec::new() };
    let mut places = vec![(last / 2, "the middle one"), (last * 9 / 10, "worse than nine of ten"), (last, "the worst")];
    // The last of equals is kept: of one window it is said that it is the worst.
    places.reverse();
    places.dedup_by_key(|p| p.0);
    places.reverse();
    let line = |(place, rank): (usize, &'static str)| {
        let index = order[place].1;
        let (a, b) = (&before[index], &after[index]);
        let rows = a.position.len().min(b.position.len()) / n;
        let stride = rows.div_ceil(POINTS).max(1);
        let kept: Vec<usize> = (0..rows).step_by(stride).collect();
        WindowPlot {
            rank,
            source: data[a.trajectory].source.clone(),
            time: kept.iter().map(|k| data[a.trajectory].time[a.first + k]).collect(),
            measured: kept.iter().map(|k| measured(a, *k)).collect(),
            before: kept.iter().map(|k| a.position[k * n + joint]).collect(),
            after: kept.iter().map(|k| b.position[k * n + joint]).collect(),
            rmse: [rmse(a), rmse(b)],
        }
    };
    places.into_iter().map(line).collect()
}

/// Medians over bins of position, by direction: a filter that has just been started makes a few large corrections, which say nothing of
/// the model. A row far slower than usual says little of a direction and is left out.
fn bins(places: &[crate::flexible::Place], lacking: &[f64]) -> Vec<Bin> {
    let [low, high] = span(places.iter().map(|p| p.q));
    if high <= low {
        return Vec::new();
    }
    let usual = (places.iter().map(|p| p.v * p.v).sum::<f64>() / places.len().max(1) as f64).sqrt();
    let mut forces: Vec<[Vec<f64>; 2]> = vec![Default::default(); BINS];
    for (p, force) in places.iter().zip(lacking) {
        if force.is_finite() && p.v.abs() >= 0.02 * usual {
            let bin = (((p.q - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
            forces[bin][usize::from(p.v < 0.0)].push(*force);
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let middle = |values: &mut Vec<f64>| {
        (values.len() >= FEWEST).then(|| {
            let middle = median(values);
            let mut off: Vec<f64> = values.iter().map(|x| (x - middle).abs()).collect();
            // Of normal noise: the deviation is 1.4826 times the median of what is off, that of a median 1.2533 times a mean's.
            [middle, 1.4826 * 1.2533 * median(&mut off) / (values.len() as f64).sqrt()]
        })
    };
    let at = |b: usize| low + (high - low) * (b as f64 + 0.5) / BINS as f64;
    let each = forces.iter_mut().enumerate();
    each.map(|(b, [forward, backward])| Bin { position: at(b), forward: middle(forward), backward: middle(backward) }).collect()
}

/// Numbers that are not the same in all three.
fn changed(given: &ObjectModel, refitted: &ObjectModel, beside: &ObjectModel) -> Vec<Changed> {
    let mut all = Vec::new();
    let mut add = |what: String, unit: &'static str, numbers: [f64; 3]| {
        let size = numbers.iter().fold(0.0f64, |a, x| a.max(x.abs()));
        if numbers.iter().any(|x| (x - numbers[0]).abs() > 1e-6 * size) {
            all.push(Changed { what, given: numbers[0], refitted: numbers[1], beside: numbers[2], unit });
        }
    };
    let models = [given, refitted, beside];
    for (l, link) in given.links.iter().enumerate() {
        let name = &link.name;
        add(format!("mass of '{name}'"), "kg", models.map(|m| m.links[l].inertial.mass));
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let what = format!("centre of mass of '{name}', {letter}");
            add(what, "m", models.map(|m| m.links[l].inertial.p_LoLcm[axis]));
        }
        let what = format!("sum of the moments of inertia of '{name}'");
        add(what, "kg m²", models.map(|m| m.links[l].inertial.I_LLcm_L.trace()));
    }
    for (i, joint) in given.joints.iter().enumerate() {
        let side = usize::from(joint.kind == JointKind::Prismatic);
        add(format!("damping of '{}'", joint.name), ["N m s/rad", "N s/m"][side], models.map(|m| m.joints[i].damping));
        add(format!("dry friction of '{}'", joint.name), ["N m", "N"][side], models.map(|m| m.joints[i].friction));
    }
    for (a, actuator) in given.document.actuators.iter().enumerate() {
        for name in actuator.refit.keys() {
            let number = |m: &ObjectModel| crate::hypothesis::number(&m.document.actuators[a].law, name);
            if let [Some(x), Some(y), Some(z)] = models.map(number) {
                add(format!("{name} of the drive of '{}'", actuator.joint), "", [x, y, z]);
            }
        }
    }
    for (e, entry) in given.document.effects.iter().enumerate() {
        let without = || effects::find(&entry.effect).map_or("", |e| e.description().without_joint());
        let place = entry.joint.as_ref().map_or_else(|| without().to_owned(), |joint| format!("'{joint}'"));
        for name in entry.parameters.keys() {
            let number = |m: &ObjectModel| m.document.effects.get(e).and_then(|e| e.parameters.get(name)).copied();
            if let [Some(x), Some(y), Some(z)] = models.map(number) {
                add(format!("{name} of {} on {place}", entry.effect), "", [x, y, z]);
            }
        }
    }
    all
}
