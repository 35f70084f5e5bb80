//! The experiment that best tells a name from those that the data cannot tell from it.
//!
//! Each experiment of a menu is simulated with the named model `A` and a weak hand that leads the joint along its reference, within the
//! joint's limits and half as far again as the speeds and efforts that the data have seen. A rival `B` then follows what `A` did, and its
//! whitened prediction errors `e` give what the experiment is expected to say against it (Hunter and Reiner 1965; Box and Hill 1967):
//!
//! ```text
//! ln K = 1/2 min over x of |e + J x|^2 / s^2 + x^T H x + I_B - I_A = 1/2 (e^T e - g^T (s^2 H + J^T J)^-1 g) / s^2 + I_B - I_A,   g = J^T e
//! I = 1/2 (ln det(1 + H^-1 J^T J / s^2) - tr((s^2 H + J^T J)^-1 J^T J))
//! ```
//!
//! The minimum is what a fair judge asks for: a rival may move its numbers, as far as the data that it was fitted to let it, `H` being the
//! curvature there. What it follows even then still counts by the room that its numbers had, less what chance makes good with them (the expected
//! gain of information of a linear model; Chaloner and Verdinelli 1995): a friction by place becomes an even one where its hump is none, and
//! only that it need not have been so speaks against it.
//!
//! The menu goes from gentle to brisk. The first that settles the matter is proposed; if none does, the one that says most. Some names no
//! motion of one joint can tell apart; then something outside has to change, or to be measured, and that is said.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use sagci_model::ObjectModel;
use sagci_recording::CommandKind;

use crate::GapError;
use crate::choice::Choice;
use crate::fit::{Fit, Problem};
use crate::noise;
use crate::plant::Plant;
use crate::report::{Experiment, Reference, Unexplained};
use crate::search::{STEP, Search, entries};
use crate::stops::Stops;
use crate::trajectory::{Drive, Trajectory};

/// How far beyond what the data have seen speeds, efforts and, where a joint has no limits, positions may go.
const BEYOND: f64 = 1.5;
/// Logarithm of a Bayes factor that settles a matter with room to spare.
const SETTLED: f64 = 10.0;
/// The least that tells two names apart at all.
const TOLD: f64 = 3.0;
/// Shortest time between samples of an experiment, s.
const SAMPLE: f64 = 4e-3;
/// Share of the range at which the hand pushes with all that it has.
const SLACK: f64 = 0.15;

/// What a joint may do, and what it has done.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    /// Positions that it may take.
    pub range: [f64; 2],
    /// Positions, and RMS of the velocities, in the data.
    pub seen: [f64; 2],
    /// Greatest speed and effort.
    pub speed: f64,
    pub effort: f64,
    pub period: f64,
}

/// Where the hand leads, row by row: position, velocity, and a factor on its stiffness; zero lets go.
type Path = Vec<[f64; 3]>;

/// An experiment with its motion.
#[derive(Debug, Clone)]
pub(crate) struct Planned {
    pub name: &'static str,
    pub numbers: Vec<(&'static str, f64)>,
    path: Path,
}

/// Builds a path from pieces.
struct Drawn {
    path: Path,
    period: f64,
    gain: f64,
}

impl Drawn {
    fn at(q: f64, period: f64) -> Self {
        Self { path: vec![[q, 0.0, 1.0]], period, gain: 1.0 }
    }

    fn here(&self) -> f64 {
        self.path.last().map_or(0.0, |p| p[0])
    }

    fn hold(mut self, seconds: f64) -> Self {
        let last = [self.here(), 0.0, self.gain];
        self.path.extend(std::iter::repeat_n(last, (seconds / self.period).round() as usize));
        self
    }

    fn go(mut self, to: f64, speed: f64) -> Self {
        let from = self.here();
        let rows = ((to - from).abs() / (speed * self.period)).ceil().max(1.0);
        let v = (to - from) / (rows * self.period);
        self.path.extend((1..=rows as usize).map(|k| [from + (to - from) * k as f64 / rows, v, self.gain]));
        self
    }

    fn along(mut self, seconds: f64, law: &dyn Fn(f64) -> [f64; 2]) -> Self {
        let rows = (seconds / self.period).round() as usize;
        self.path.extend((1..=rows).map(|k| law(k as f64 * self.period)).map(|[q, v]| [q, v, self.gain]));
        self
    }

    fn gained(mut self, gain: f64) -> Self {
        self.gain = gain;
        self
    }
}

/// The experiments, from gentle to brisk.
pub(crate) fn menu(room: &Room) -> Vec<Planned> {
    let Room { range: [low, high], seen, speed, period, .. } = *room;
    let (span, middle) = (high - low, 0.5 * (low + high));
    let start = |q: f64| Drawn::at(q, period).hold(0.5);
    let mut all = Vec::new();
    let mut push = |name, numbers: &[(&'static str, f64)], drawn: Drawn| {
        all.push(Planned { name, numbers: numbers.to_vec(), path: drawn.path });
    };

    let slow = (span / 12.0).min(0.5 * speed);
    push("quasi_static_sweep", &[("low", low), ("high", high), ("speed", slow)], start(low).go(high, slow).go(low, slow));

    let (fast, creep) = (0.9 * speed, speed / 30.0);
    let part = (creep * 6.0).min(span);
    let [a, b] = [middle - 0.5 * part, middle + 0.5 * part];
    let two = start(low).go(high, fast).go(low, fast).go(a, fast).hold(0.5).go(b, creep).go(a, creep);
    push("two_speeds", &[("low", low), ("high", high), ("speed", fast), ("slow_low", a), ("slow_high", b), ("slow_speed", creep)], two);

    let frequency = 1.0;
    let most = (0.5 * span).min(speed / (TAU * frequency));
    let mut ladder = start(middle);
    for share in [0.002, 0.008, 0.03, 0.1, 0.3, 1.0] {
        let (amplitude, w) = (share * most, TAU * frequency);
        ladder = ladder.along(2.0 / frequency, &|t| [middle + amplitude * (w * t).sin(), amplitude * w * (w * t).cos()]);
    }
    let numbers =
        [("middle", middle), ("first_amplitude", 0.002 * most), ("last_amplitude", most), ("frequency", frequency), ("cycles", 2.0)];
    push("amplitude_ladder", &numbers, ladder);

    let decay = |drawn: Drawn, to: f64| drawn.go(to, 0.5 * speed).hold(0.7).gained(0.0).hold(4.0).gained(1.0);
    push("free_decay", &[("first", high), ("second", low), ("seconds", 4.0)], decay(decay(start(middle), high), low));

    let (first, last, seconds) = (0.2, (0.1 / period).min(20.0), 12.0);
    let amplitude = (0.15 * span).min(speed / (TAU * first));
    let rate = f64::ln(last / first) / seconds;
    // As loud as the speed allows at each frequency.
    let chirp = |t: f64| {
        let w = TAU * first * (rate * t).exp();
        let (amplitude, phase) = (amplitude.min(speed / w), TAU * first * ((rate * t).exp() - 1.0) / rate);
        [middle + amplitude * phase.sin(), amplitude * w * phase.cos()]
    };
    let numbers = [
        ("middle", middle),
        ("amplitude", amplitude),
        ("first_frequency", first),
        ("last_frequency", last),
        ("seconds", seconds),
        ("speed", speed),
    ];
    push("chirp", &numbers, start(middle).along(seconds, &chirp));

    let (up, down) = (middle + 0.2 * span, middle - 0.2 * span);
    let stairs = |drawn: Drawn| (0..4).fold(drawn, |d, i| d.along(period, &|_| [if i % 2 == 0 { up } else { down }, 0.0]).hold(1.2));
    push("steps", &[("low", down), ("high", up), ("dwell", 1.2)], stairs(start(middle)));

    let shut = f64::clamp(0.0, low, high).min(seen[1]);
    let ajar = shut + 0.4 * (high - shut);
    let open = |drawn: Drawn, dwell: f64| drawn.hold(dwell).go(ajar, 0.5 * speed).go(shut, 0.5 * speed);
    let numbers = [("position", shut), ("open", ajar), ("first_dwell", 1.0), ("second_dwell", 10.0), ("speed", 0.5 * speed)];
    push("dwell_then_open", &numbers, open(open(start(shut), 1.0), 10.0));

    let numbers = [("low", down), ("high", up), ("dwell", 1.2), ("first_gain", 0.5), ("second_gain", 2.0)];
    push("two_controller_gains", &numbers, stairs(stairs(start(middle).gained(0.5)).gained(2.0)));
    all
}

/// Something outside that has to change where no motion helps: the experiment and what it is for, if the names ask for one.
fn outside(names: &[&str]) -> Option<(&'static str, &'static str)> {
    let among = |list: &[&str]| names.iter().filter(|n| list.contains(n)).count();
    if among(&["transport_delay", "clock_skew", "actuator_lag"]) > 1 && among(&["clock_skew"]) > 0 {
        return Some(("one_clock", "stamp command and measurement by one clock: in one log a late command and a late stamp are the same"));
    }
    if among(&["torque_gain", "armature_inertia", "load_dependent_friction", "payload"]) > 0 {
        return Some(("change_payload", "move the same way again with a known mass on the last link: its weight is a force that is known"));
    }
    if among(&["hinge_tilt", "joint_axis_error"]) > 0 {
        return Some((
            "tilt_again",
            "tilt the base by a known angle and move the same way again: gravity's share turns with it, the rest does not",
        ));
    }
    (among(&["encoder_offset", "sensor_drift"]) > 0)
        .then_some(("outside_reference", "measure the joint's position by something else as well, at rest at both ends"))
}

/// Names between which no motion of one joint decides, whatever it is.
const NO_MOTION: [[&str; 2]; 3] =
    [["transport_delay", "clock_skew"], ["torque_gain", "armature_inertia"], ["encoder_offset", "joint_axis_error"]];

/// The experiment for what is left without a name, by what it depends on.
fn for_nameless(over: &str) -> &'static str {
    match over {
        "position" | "position and direction" => "quasi_static_sweep",
        "velocity" | "position times velocity" => "two_speeds",
        "time since reversal and direction" => "amplitude_ladder",
        "time" | "time times velocity" => "dwell_then_open",
        _ => "chirp",
    }
}

/// Who is asked to be told apart, at which joint.
pub(crate) struct Question<'a> {
    pub joint: usize,
    /// The name and its fit, then its rivals.
    pub named: (&'a str, &'a Fit),
    pub rivals: Vec<(&'a str, Fit)>,
    /// Names that no data of this kind tell from it.
    pub equivalent: &'static [&'static str],
    /// The rival is that the effect is not there.
    pub confirms: bool,
}

/// What the answer leaves open: sets of names, then what no other data confirm. A later one is asked where no motion answers the earlier ones.
pub(crate) fn questions<'a>(search: &Search<'_>, chosen: &'a [Choice], current: &'a Fit, confirmed: &[bool]) -> Vec<Question<'a>> {
    let open = chosen.iter().filter(|c| c.alike.len() > 1 || !c.equivalent.is_empty());
    let mut all: Vec<Question<'_>> = open
        .map(|open| Question {
            equivalent: open.equivalent,
            joint: open.best.joint.unwrap_or(0),
            named: (open.best.effect, &open.alike[0].fit),
            rivals: open.alike[1..].iter().map(|c| (c.effect, c.fit.clone())).collect(),
            confirms: false,
        })
        .collect();
    let entries = entries(&current.hypothesis);
    all.extend(chosen.iter().zip(entries).zip(confirmed).filter(|(_, confirmed)| !**confirmed).filter_map(|((choice, entry), _)| {
        let joint = choice.best.joint.unwrap_or(0);
        let without = current.without(&search.problem, entry).ok()?;
        Some(Question { joint, named: (choice.best.effect, current), rivals: vec![("", without)], equivalent: &[], confirms: true })
    }));
    all
}

/// Proposes an experiment for a question.
pub(crate) fn propose(search: &Search<'_>, question: &Question<'_>, scale: f64) -> Option<Experiment> {
    let room = search.room(&question.named.1.hypothesis.model, question.joint);
    let rivals = question.rivals.iter().map(|r| r.0);
    // What is like it in these data may be so in any of their kind.
    let mut names: Vec<&str> = std::iter::once(question.named.0).chain(rivals).collect();
    names.extend(question.equivalent.iter().filter(|n| !question.rivals.iter().any(|r| r.0 == **n)));
    let joint = search.names[question.joint].clone();
    let all = || names.iter().filter(|n| !n.is_empty()).map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let never = NO_MOTION
        .iter()
        .any(|pair| names[0] == pair[0] && names[1..].contains(&pair[1]) || names[0] == pair[1] && names[1..].contains(&pair[0]));
    if let Some((name, reason)) = outside(&names).filter(|_| never || question.rivals.is_empty()) {
        return Some(plain(name, joint, all(), reason));
    }
    let mut best: Option<(f64, Planned, Vec<f64>)> = None;
    // A servo neither lets go nor changes its gains.
    let servo = search.problem.trajectories.iter().any(|t| t.drive[question.joint] == Drive::Command(CommandKind::Position));
    for planned in menu(&room).into_iter().filter(|p| !servo || !matches!(p.name, "free_decay" | "two_controller_gains")) {
        let Ok(told) = discrimination(search, question, &room, &planned, scale) else { continue };
        // Each doubling of what is known counts the same, so that no rival is forgotten over another.
        let score: f64 = told.iter().map(|d| d.max(0.0).ln_1p()).sum();
        let settled = told.iter().all(|d| *d > SETTLED);
        if best.as_ref().is_none_or(|b| score > b.0) || settled {
            best = Some((score, planned, told));
        }
        if settled {
            break;
        }
    }
    let (_, planned, told) = best?;
    let parted: Vec<usize> = (0..told.len()).filter(|i| told[*i] > TOLD).collect();
    if parted.is_empty() {
        let (name, reason) = outside(&names).filter(|_| !question.confirms)?;
        return Some(plain(name, joint, all(), reason));
    }
    let least = parted.iter().map(|i| told[*i]).fold(f64::INFINITY, f64::min);
    let separates = std::iter::once(names[0]).chain(parted.iter().map(|i| question.rivals[*i].0)).filter(|n| !n.is_empty());
    let numbers: BTreeMap<String, f64> = planned.numbers.iter().map(|(n, x)| ((*n).to_owned(), *x)).collect();
    Some(Experiment {
        name: planned.name.into(),
        joint,
        separates: separates.map(Into::into).collect(),
        expected_log_bayes_factor: Some(least),
        reason: words(planned.name, &numbers, question.confirms),
        reference: Reference { kind: planned.name.into(), numbers },
        command: String::new(),
    })
}

/// Proposes an experiment for what has no name.
pub(crate) fn propose_for_nameless(search: &Search<'_>, model: &ObjectModel, left: &Unexplained) -> Option<Experiment> {
    let j = search.names.iter().position(|n| *n == left.joint)?;
    let name = for_nameless(&left.over);
    let planned = menu(&search.room(model, j)).into_iter().find(|p| p.name == name)?;
    let numbers: BTreeMap<String, f64> = planned.numbers.iter().map(|(n, x)| ((*n).to_owned(), *x)).collect();
    Some(Experiment {
        name: name.into(),
        joint: left.joint.clone(),
        separates: Vec::new(),
        expected_log_bayes_factor: None,
        reason: format!(
            "{}; what is left without a name depends on {}, and shows there at its plainest",
            words(name, &numbers, false),
            left.over
        ),
        reference: Reference { kind: name.into(), numbers },
        command: String::new(),
    })
}

fn plain(name: &str, joint: String, separates: Vec<String>, reason: &str) -> Experiment {
    Experiment {
        name: name.into(),
        joint,
        separates,
        expected_log_bayes_factor: None,
        reference: Reference { kind: name.into(), numbers: BTreeMap::new() },
        reason: reason.into(),
        command: String::new(),
    }
}

fn words(name: &str, numbers: &BTreeMap<String, f64>, confirms: bool) -> String {
    let x = |n: &str| numbers.get(n).copied().unwrap_or(0.0);
    let what = match name {
        "quasi_static_sweep" => format!("sweep slowly from {:.3} to {:.3} and back, at {:.3} a second", x("low"), x("high"), x("speed")),
        "two_speeds" => format!(
            "sweep from {:.3} to {:.3} and back at {:.3} a second, then from {:.3} to {:.3} and back at {:.4}",
            x("low"),
            x("high"),
            x("speed"),
            x("slow_low"),
            x("slow_high"),
            x("slow_speed")
        ),
        "amplitude_ladder" => {
            format!(
                "swing about {:.3} in sines that grow from {:.5} to {:.3}, two cycles each",
                x("middle"),
                x("first_amplitude"),
                x("last_amplitude")
            )
        }
        "free_decay" => format!("lead it to {:.3} and let go for {} s, then the same from {:.3}", x("first"), x("seconds"), x("second")),
        "chirp" => format!(
            "swing about {:.3} with a frequency that rises from {:.1} to {:.0} Hz",
            x("middle"),
            x("first_frequency"),
            x("last_frequency")
        ),
        "steps" => format!("step between {:.3} and {:.3}, {} s each", x("low"), x("high"), x("dwell")),
        "dwell_then_open" => format!("rest at {:.3} for 1 s, open and shut, rest for 10 s, and open again", x("position")),
        _ => format!("step between {:.3} and {:.3} with a hand half as stiff as usual, then twice as stiff", x("low"), x("high")),
    };
    if confirms { format!("{what}; data that no fit has seen would confirm it") } else { what }
}

impl Search<'_> {
    /// What a joint may do in an experiment.
    pub fn room(&self, model: &ObjectModel, j: usize) -> Room {
        let [low, high] = Trajectory::range(self.problem.trajectories, j);
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low).max(1e-6));
        let limits = &model.joints[self.joints[j]].limits;
        let range = match limits.range().is_finite() {
            true => {
                let margin = 0.02 * limits.range();
                [limits.lower + margin, limits.upper - margin]
            }
            false => [middle - BEYOND * half, middle + BEYOND * half],
        };
        let mut speeds: Vec<f64> = self.problem.trajectories.iter().flat_map(|t| speeds(t, j)).collect();
        speeds.sort_by(f64::total_cmp);
        let speed = speeds.get(speeds.len() * 98 / 100).copied().unwrap_or(0.1).max(1e-3);
        let pushed = self.problem.trajectories.iter().filter(|t| matches!(t.drive[j], Drive::Effort | Drive::Command(CommandKind::Effort)));
        let inputs = pushed.flat_map(|t| t.input.iter().skip(j).step_by(t.joints)).filter(|u| u.is_finite());
        let effort = inputs.fold(0.0f64, |a, u| a.max(u.abs()));
        // A hand that was not measured is taken to be as strong as the motion's own forces ask for.
        let effort = if effort > 0.0 { effort } else { 2.0 * self.typical_force()[j] };
        let period = self.problem.trajectories.first().map_or(SAMPLE, Trajectory::period).clamp(SAMPLE, 0.05);
        Room { range, seen: [low, high], speed: BEYOND * speed, effort: BEYOND * effort, period }
    }
}

fn speeds(trajectory: &Trajectory, j: usize) -> Vec<f64> {
    let y: Vec<f64> = trajectory.positions(j).collect();
    let period = trajectory.period();
    let width = ((0.05 / period).round() as usize).max(1);
    let v = y.iter().zip(y.iter().skip(width)).map(|(a, b)| (b - a).abs() / (width as f64 * period));
    v.filter(|v| v.is_finite()).collect()
}

/// What an experiment is expected to say against each rival.
fn discrimination(search: &Search<'_>, question: &Question<'_>, room: &Room, planned: &Planned, scale: f64) -> Result<Vec<f64>, GapError> {
    let named = question.named.1;
    let plant = named.hypothesis.plant(&named.hypothesis.x, &kept(search), STEP)?;
    let made = perform(search, (&named.hypothesis.model, &plant), question.joint, room, &planned.path)?;
    let data = std::slice::from_ref(&made);
    let problem = Problem::new(data, search.problem.disturbance.clone(), &kept(search), STEP);
    let own = problem.errors(&named.hypothesis, &named.hypothesis.x)?;
    // Of an arm derivatives by all that is known would take as long as the search.
    let itself = if search.many_joints() { None } else { Learning::of(&problem, named, &own, scale)? };
    question
        .rivals
        .par_iter()
        .map(|(_, rival)| {
            let errors = problem.errors(&rival.hypothesis, &rival.hypothesis.x)?;
            let (e, weight) = (&errors - &own, 1.0 / (scale * scale));
            let most = 0.5 * weight * e.norm_squared();
            if itself.is_none() && most < TOLD {
                return Ok(most);
            }
            let Some(learning) = Learning::of(&problem, rival, &errors, scale)? else { return Ok(most) };
            Ok(most - learning.follows(&e, weight) + itself.as_ref().map_or(0.0, |itself| learning.room - itself.room))
        })
        .collect()
}

/// What new data teach a model of its numbers.
struct Learning {
    columns: Vec<DVector<f64>>,
    /// Curvature with the new data.
    curvature: Cholesky<f64, Dyn>,
    /// What its evidence is expected to lose by room that its numbers had.
    room: f64,
}

impl Learning {
    /// None of a model of which derivatives by some numbers are lacking, or whose numbers nothing holds.
    fn of(problem: &Problem<'_>, fit: &Fit, errors: &DVector<f64>, scale: f64) -> Result<Option<Self>, GapError> {
        let n = fit.hypothesis.x.len();
        if fit.jacobian.len() != n {
            return Ok(None);
        }
        let all: Vec<usize> = (0..n).collect();
        let columns: Vec<DVector<f64>> = problem.jacobian(&fit.hypothesis, &fit.hypothesis.x, errors, &all)?;
        let (before, _) = fit.normal(scale);
        let mut after: DMatrix<f64> = before.clone();
        for a in 0..n {
            for b in 0..n {
                after[(a, b)] += columns[a].dot(&columns[b]) / (scale * scale);
            }
        }
        let (Some(known), Some(curvature)) = (Cholesky::new(before.clone()), Cholesky::new(after)) else { return Ok(None) };
        let determinant = |c: &Cholesky<f64, Dyn>| 2.0 * c.l_dirty().diagonal().map(f64::ln).sum();
        let told = n as f64 - curvature.solve(&before).trace();
        let room = 0.5 * (determinant(&curvature) - determinant(&known) - told);
        Ok(Some(Self { columns, curvature, room }))
    }

    /// How much of errors the model follows by moving its numbers.
    fn follows(&self, errors: &DVector<f64>, weight: f64) -> f64 {
        let g = DVector::from_iterator(self.columns.len(), self.columns.iter().map(|column| weight * column.dot(errors)));
        0.5 * g.dot(&self.curvature.solve(&g))
    }
}

/// All limits of the URDF are kept: what is let go may reach them.
fn kept(search: &Search<'_>) -> Vec<Stops> {
    vec![[true; 2]; search.names.len()]
}

/// The named model under the hand: what would be recorded, but for noise.
fn perform(
    search: &Search<'_>,
    (model, plant): (&ObjectModel, &Plant),
    joint: usize,
    room: &Room,
    path: &Path,
) -> Result<Trajectory, GapError> {
    let (n, rows) = (search.names.len(), path.len());
    let middle = noise::middle(search.problem.trajectories, n);
    let source = search.problem.trajectories.first();
    // Joints that nothing drove are moved by a hand whose effort is measured.
    let drive: Vec<Drive> =
        (0..n).map(|j| source.map_or(Drive::Effort, |t| if t.drive[j] == Drive::Free { Drive::Effort } else { t.drive[j] })).collect();
    let mut made = Trajectory {
        source: String::new(),
        hash: String::new(),
        time: (0..rows).map(|k| k as f64 * room.period).collect(),
        position: vec![f64::NAN; rows * n],
        counted: Vec::new(),
        liveliness: Vec::new(),
        strain: Vec::new(),
        doubt: Vec::new(),
        effort: vec![f64::NAN; rows * n],
        input: vec![0.0; rows * n],
        drive,
        external: Vec::new(),
        starts: vec![0],
        continues: false,
        joints: n,
        on_time: None,
        notes: Vec::new(),
    };
    // All joints but one are held where the data mostly were.
    let rooms: Vec<Room> = (0..n).map(|j| if j == joint { *room } else { search.room(model, j) }).collect();
    let mut motion = plant.motion();
    motion.state.q.copy_from_slice(&middle);
    motion.state.q[joint] = path[0][0];
    motion.state.z.fill(0.0);
    for (k, way) in path.iter().enumerate() {
        motion.state.time = made.time[k];
        for j in 0..n {
            let i = k * n + j;
            made.position[i] = plant.reading(&motion, j);
            let [target, along, gain] = if j == joint { *way } else { [middle[j], 0.0, 1.0] };
            let (inertia, most) = (search.inertias[j], rooms[j].effort);
            // Stiff enough to use what it has within its slack, and no stiffer than its own clock bears.
            let span = (rooms[j].range[1] - rooms[j].range[0]).max(1e-9);
            let stiffness = gain * (most / (SLACK * span)).min(inertia * (0.2 / room.period).powi(2));
            let damping = 1.4 * (stiffness * inertia).sqrt();
            let (q, v) = (motion.state.q[j], motion.state.v[j]);
            let push = (stiffness * (target - q) + damping * (along - v)).clamp(-most, most);
            made.input[i] = plant.input_for(j, made.drive[j], push, [target, v]);
        }
        if k + 1 < rows {
            plant.interval(&mut motion, &made, k)?;
        }
    }
    made.weigh(model, &search.problem.disturbance.position)?;
    Ok(made)
}
