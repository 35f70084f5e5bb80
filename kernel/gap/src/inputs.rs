//! What acts on joints, as series of samples: those that are missing among others, and forces that were measured at links.
//!
//! A sample acts until the next one. Where that one is missing, holding its forerunner longer makes the input late by half of the hole: over many
//! holes that is a clock which is off. So samples that a regular clock should have brought are put on straight lines between their neighbours, and
//! doubted by half of what lies between these.
//! What is published when it changes has no such clock, and is held.

use nalgebra::{DVector, Isometry3, Matrix6xX, Point3, Vector3, Vector6};
use sagci_dynamics::{Part, System};
use sagci_model::{ActuatorLaw, ObjectModel};
use sagci_recording::{CommandKind, JointLog, Log, Series, WrenchLog};

use crate::GapError;
use crate::observer::DriveSlopes;
use crate::trajectory::{Drive, SAME_TIME, Trajectory, joint_names};

/// Over a longer time than this, s, nobody knows what acted between two samples: the first is held.
const HOLE: f64 = 0.1;
/// Share of a period by which times may be beside its multiples, the share of times that must not be, and the share that follow the one before
/// by one period.
const BESIDE: f64 = 0.2;
const REGULAR: f64 = 0.9;
const NEXT: f64 = 0.3;
/// Fewer times tell of no period.
const FEW: usize = 10;
/// Share of a table's rows that give a command which was sampled, and not written down when it changed.
const SAMPLED: f64 = 0.5;

/// A recording whose inputs are complete.
#[derive(Debug)]
pub(crate) struct Inputs {
    pub log: Log,
    /// Forces from outside on joints that a command drives, by the joint's name.
    pub external: Vec<(String, Series)>,
    /// Where an input was put in, and by how much it may be off there, by the joint's name.
    pub doubts: Vec<(String, Series)>,
    /// What was put in, and what acts where several things might.
    pub notes: Vec<String>,
}

/// Does a drive take such commands? A joint without a law is driven by efforts.
pub(crate) fn taken(kind: CommandKind, law: Option<&ActuatorLaw>) -> bool {
    matches!(
        (kind, law),
        (CommandKind::Effort, None | Some(ActuatorLaw::Torque { .. }))
            | (CommandKind::Position, Some(ActuatorLaw::PositionServo { .. } | ActuatorLaw::DcMotor { gain: Some(_), .. }))
            | (CommandKind::Voltage, Some(ActuatorLaw::DcMotor { .. }))
    )
}

/// The command that a joint's drive follows.
pub(crate) fn followed<'a>(joint: &'a JointLog, law: Option<&ActuatorLaw>) -> Option<(CommandKind, &'a Series)> {
    let (kind, series) = joint.command.as_ref()?;
    taken(*kind, law).then_some((*kind, series))
}

/// The law of a joint's drive.
pub(crate) fn law_of<'a>(model: &'a ObjectModel, joint: &str) -> Option<&'a ActuatorLaw> {
    model.document.actuators.iter().find(|a| a.joint == joint).map(|a| &a.law)
}

/// Effort of a drive by its input, where nothing limits it: N m/rad or N m/V, or 1; N for N m and m for rad where a joint slides.
pub(crate) fn per_input(drive: Drive, law: Option<&ActuatorLaw>) -> f64 {
    match (drive, law) {
        (Drive::Command(CommandKind::Position), Some(ActuatorLaw::PositionServo { stiffness, .. })) => *stiffness,
        (Drive::Command(CommandKind::Position), Some(ActuatorLaw::DcMotor { torque_constant, resistance, gain, .. })) => {
            gain.unwrap_or(0.0) * (torque_constant / resistance)
        }
        (Drive::Command(CommandKind::Voltage), Some(ActuatorLaw::DcMotor { torque_constant, resistance, .. })) => {
            torque_constant / resistance
        }
        _ => 1.0,
    }
}

/// How a drive's effort answers while nothing limits it.
pub(crate) fn slopes(law: Option<&ActuatorLaw>, kind: CommandKind) -> DriveSlopes {
    let input = per_input(Drive::Command(kind), law);
    // A commanded position is one that the effort closes a loop over; a voltage closes one over the velocity alone.
    let q = if kind == CommandKind::Position { -input } else { 0.0 };
    let by_voltage = per_input(Drive::Command(CommandKind::Voltage), law);
    match law {
        Some(ActuatorLaw::PositionServo { damping, .. }) => DriveSlopes { input, q, v: -damping },
        Some(ActuatorLaw::DcMotor { torque_constant, .. }) => DriveSlopes { input, q, v: -torque_constant * by_voltage },
        _ => DriveSlopes { input, q: 0.0, v: 0.0 },
    }
}

/// The same by the command that data have for a joint; none where they have none.
pub(crate) fn slopes_by(trajectories: &[Trajectory], joint: usize, law: Option<&ActuatorLaw>) -> DriveSlopes {
    let command = trajectories.iter().find_map(|t| match t.drive[joint] {
        Drive::Command(kind) => Some(kind),
        _ => None,
    });
    command.map_or_else(DriveSlopes::default, |kind| slopes(law, kind))
}

impl Inputs {
    pub fn new(log: &Log, model: &ObjectModel) -> Result<Self, GapError> {
        let mut this = Self { log: log.clone(), external: Vec::new(), doubts: Vec::new(), notes: Vec::new() };
        this.push_by_wrenches(model)?;
        let is_table = this.log.is_table;
        // Rows that a table lacks are lacking for all of its joints, and are said once.
        let mut said: Vec<(String, Vec<String>)> = Vec::new();
        for joint in this.log.joints.iter_mut().filter(|j| model.joint(&j.name).is_some()) {
            let is_commanded = followed(joint, law_of(model, &joint.name)).is_some();
            let JointLog { position, effort, command, command_gaps, .. } = joint;
            let (series, rows, what) = match (is_commanded, command, effort) {
                (true, Some((_, series)), _) if is_table && is_sampled(series, &position.time) => (series, &position.time[..], "commands"),
                (false, _, Some(series)) => {
                    let own = is_table || is_among(&series.time, &position.time);
                    (series, if own { &position.time[..] } else { &[] }, "efforts")
                }
                _ => continue,
            };
            // Of a command only its own clock says that one is missing: a row may stand there for another quantity.
            let least = if is_commanded { period(&series.time).map_or(f64::INFINITY, |p| 1.5 * p) } else { 0.0 };
            let mended = Mended::new(series, rows, least, command_gaps);
            let mut say = |message: String| match said.iter_mut().find(|(other, _)| *other == message) {
                Some((_, joints)) => joints.push(joint.name.clone()),
                None => said.push((message, vec![joint.name.clone()])),
            };
            if mended.filled > 0 {
                say(format!(
                    "{} {what} are missing between others; they were put on straight lines between these, since holding the last one would \
                     make them late",
                    mended.filled
                ));
            }
            if mended.held > 0 {
                say(format!(
                    "{} times {what} are missing for more than {HOLE} s; the last one is held there, which may be taken for a delay",
                    mended.held
                ));
            }
            *series = mended.series;
            this.doubts.push((joint.name.clone(), mended.doubts));
        }
        this.notes.extend(said.into_iter().map(|(message, joints)| format!("{}: {}: {message}", log.source, joints.join(", "))));
        Ok(this)
    }

    /// Turns forces at links into efforts of the joints that these hang on.
    fn push_by_wrenches(&mut self, model: &ObjectModel) -> Result<(), GapError> {
        let pushed = efforts(&self.log, model)?;
        for (name, series) in pushed {
            let place = self.log.joints.iter().position(|j| j.name == name).unwrap_or_else(|| {
                self.log.joints.push(JointLog { name: name.clone(), ..JointLog::default() });
                self.log.joints.len() - 1
            });
            let joint = &mut self.log.joints[place];
            if followed(joint, law_of(model, &name)).is_some() {
                self.external.push((name, series));
            } else if joint.effort.is_some() {
                self.notes.push(format!(
                    "{}: {name}: both an effort and a force at a link are measured; the effort is what acts, with the force it would count twice",
                    self.log.source
                ));
            } else if joint.command.is_none() {
                joint.effort = Some(series);
            }
        }
        Ok(())
    }
}

/// Efforts that forces measured at links are to the joints on the way to them (`tau = J^T F`), at the measured positions.
fn efforts(log: &Log, model: &ObjectModel) -> Result<Vec<(String, Series)>, GapError> {
    let wrenches: Vec<&WrenchLog> = log.wrenches.iter().filter(|w| !w.time.is_empty() && model.link(&w.link).is_some()).collect();
    if wrenches.is_empty() {
        return Ok(Vec::new());
    }
    let mut times: Vec<f64> = wrenches.iter().flat_map(|w| w.time.iter().copied()).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|b, a| *b - *a < SAME_TIME);
    let names = joint_names(model)?;
    let positions: Vec<Option<&Series>> =
        names.iter().map(|name| log.joint(name).map(|j| &j.position).filter(|p| !p.time.is_empty())).collect();
    let n = names.len();
    let mut bare = model.clone();
    bare.document.effects.clear();
    let system = System::new(&[Part::welded(&bare, Isometry3::identity())])?;
    let (multibody, mut ws) = (system.multibody(), system.multibody().workspace());
    let (mut J, still) = (Matrix6xX::zeros(n), vec![0.0; n]);
    let mut all = vec![Vec::with_capacity(times.len()); n];
    let mut reaches = vec![false; n];
    for t in &times {
        let q: Vec<f64> = positions.iter().map(|p| p.map_or(0.0, |p| between(p, *t))).collect();
        multibody.set_state(&mut ws, &q, &still)?;
        let mut tau = DVector::zeros(n);
        for wrench in &wrenches {
            let link = multibody.link(&wrench.link)?;
            let at = wrench.time.partition_point(|x| *x <= t + SAME_TIME).saturating_sub(1);
            let [tx, ty, tz, fx, fy, fz] = wrench.F_L[at];
            let X_WL = multibody.X_WL(&ws, link);
            let (torque_W, force_W) = (X_WL * Vector3::new(tx, ty, tz), X_WL * Vector3::new(fx, fy, fz));
            multibody.jacobian(&ws, link, &Point3::origin(), &mut J)?;
            tau += J.transpose() * Vector6::new(torque_W.x, torque_W.y, torque_W.z, force_W.x, force_W.y, force_W.z);
            reaches.iter_mut().zip(J.column_iter()).for_each(|(reaches, column)| *reaches |= column.amax() > 0.0);
        }
        all.iter_mut().zip(tau.iter()).for_each(|(all, tau)| all.push(*tau));
    }
    let named = names.into_iter().zip(all).zip(reaches).filter(|(_, reaches)| *reaches);
    Ok(named.map(|((name, value), _)| (name, Series { time: times.clone(), value })).collect())
}

/// A value at a time, on a straight line between two samples; beyond them, the nearest.
fn between(series: &Series, t: f64) -> f64 {
    let next = series.time.partition_point(|x| *x <= t);
    match (next.checked_sub(1), series.time.get(next)) {
        (Some(k), Some(end)) => {
            let share = (t - series.time[k]) / (end - series.time[k]);
            (1.0 - share) * series.value[k] + share * series.value[next]
        }
        (Some(k), None) => series.value[k],
        (None, _) => series.value.first().copied().unwrap_or(0.0),
    }
}

/// The period of a clock that misses some of its beats; none where times keep to no period.
fn period(times: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.len() < FEW {
        return None;
    }
    steps.sort_by(f64::total_cmp);
    let short = steps[steps.len() / 5];
    let one = |period: f64, step: f64| (step / period - 1.0).abs() < BESIDE;
    let (sum, count) = steps.iter().filter(|s| one(short, **s)).fold((0.0, 0.0), |(sum, count), s| (sum + s, count + 1.0));
    let period = sum / count;
    let beat = |step: &&f64| {
        let beats = **step / period;
        beats > 0.5 && (beats - beats.round()).abs() < BESIDE
    };
    let all = steps.len() as f64;
    let is_regular = steps.iter().filter(beat).count() as f64 >= REGULAR * all;
    (is_regular && steps.iter().filter(|s| one(period, **s)).count() as f64 >= NEXT * all).then_some(period)
}

/// Is a command given in most rows of its joint, from its first to its last?
fn is_sampled(series: &Series, rows: &[f64]) -> bool {
    let (Some(first), Some(last)) = (series.time.first(), series.time.last()) else { return false };
    let within = rows.iter().filter(|t| (*first..=*last).contains(*t)).count();
    series.time.len() as f64 > SAMPLED * within as f64
}

/// Do nearly all of some times stand among others? Both are in order.
fn is_among(times: &[f64], others: &[f64]) -> bool {
    let there = |t: &&f64| others.get(others.partition_point(|x| *x < **t - SAME_TIME)).is_some_and(|x| (x - **t).abs() < SAME_TIME);
    times.iter().filter(there).count() as f64 >= REGULAR * times.len() as f64
}

/// A series in which samples that were missing stand on straight lines between their neighbours.
#[derive(Debug)]
struct Mended {
    series: Series,
    /// How many these are, and by how much each may be off: an input that steps is at one end or at the other.
    filled: usize,
    doubts: Series,
    /// Holes that are too wide for it.
    held: usize,
}

impl Mended {
    /// `rows` are times at which a sample should be, beside those that a regular clock has; `least` is the time between two samples, s, from
    /// which on any are missing. Over `gaps` nothing acts, which is no hole.
    fn new(series: &Series, rows: &[f64], least: f64, gaps: &[[f64; 2]]) -> Self {
        let mut all: Vec<f64> = series.time.iter().chain(rows).copied().collect();
        all.sort_by(f64::total_cmp);
        all.dedup_by(|b, a| *b - *a < SAME_TIME);
        let period = period(&all);
        let mut this = Self { series: Series::default(), filled: 0, doubts: Series::default(), held: 0 };
        for (k, (a, value)) in series.time.iter().zip(&series.value).enumerate() {
            this.series.time.push(*a);
            this.series.value.push(*value);
            let Some(b) = series.time.get(k + 1).copied() else { break };
            if b - a < least || gaps.iter().any(|[from, _]| (*a..b).contains(from)) {
                continue;
            }
            let from = all.partition_point(|t| *t <= a + SAME_TIME);
            let to = all.partition_point(|t| *t < b - SAME_TIME).max(from);
            let mut missing = Vec::new();
            let mut last = *a;
            for t in all[from..to].iter().copied().chain([b]) {
                let beats = period.map_or(1.0, |p| ((t - last) / p).round().max(1.0));
                if b - a <= HOLE {
                    missing.extend((1..beats as usize).map(|i| last + (t - last) * i as f64 / beats));
                }
                if t < b {
                    missing.push(t);
                } else if b - a > HOLE && (beats > 1.0 || !missing.is_empty()) {
                    this.held += 1;
                    missing.clear();
                }
                last = t;
            }
            this.filled += missing.len();
            for t in missing {
                let share = (t - a) / (b - a);
                this.series.time.push(t);
                this.series.value.push((1.0 - share) * value + share * series.value[k + 1]);
                this.doubts.time.push(t);
                this.doubts.value.push(0.5 * (series.value[k + 1] - value).abs());
            }
        }
        this
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::gaps::Measure;
    use crate::hypothesis::Hypothesis;
    use crate::search::Search;
    use crate::tests::{door, driven, swing};
    use crate::trajectory::Trajectory;

    fn ramp(times: &[f64]) -> Series {
        Series { time: times.to_vec(), value: times.iter().map(|t| 3.0 * t).collect() }
    }

    /// Rows of a 200 Hz clock of which four in ten are not there.
    fn dropped(count: usize) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(5);
        (0..count).filter(|_| random.random_range(0..10) < 6).map(|k| 0.005 * k as f64).collect()
    }

    fn hinge(log: &mut Log) -> &mut JointLog {
        &mut log.joints[0]
    }

    #[test]
    fn a_hole_in_a_regular_clock_makes_no_input_late() {
        let series = ramp(&dropped(400));
        let mended = Mended::new(&series, &[], 0.0, &[]);
        assert!(mended.filled > 100 && mended.series.time.len() == series.time.len() + mended.filled);
        assert!(mended.series.time.windows(2).all(|w| (w[1] - w[0] - 0.005).abs() < 1e-9), "a row is still missing");
        assert!(mended.series.time.iter().zip(&mended.series.value).all(|(t, y)| (y - 3.0 * t).abs() < 1e-9));
    }

    #[test]
    fn times_without_a_common_period_are_held_as_they_are() {
        let mut t = 0.0;
        let step = |k: i32| 0.005 * (1.0 + 0.6 * (f64::from(k) * 1.7).sin());
        let times: Vec<f64> = (0..300)
            .map(|k| {
                t += step(k);
                t
            })
            .collect();
        let mended = Mended::new(&ramp(&times), &[], 0.0, &[]);
        assert_eq!((mended.filled, mended.held, &mended.series.time), (0, 0, &times));
    }

    #[test]
    fn over_a_long_hole_the_last_value_is_held_and_that_is_said() {
        let times: Vec<f64> = (0..400).filter(|k| !(100..140).contains(k)).map(|k| 0.005 * f64::from(k)).collect();
        let mended = Mended::new(&ramp(&times), &[], 0.0, &[]);
        assert_eq!((mended.filled, mended.held), (0, 1));
    }

    /// The hand jumps, and that row is lost: nobody knows when within the hole it did.
    #[test]
    fn an_input_that_jumps_in_a_hole_is_doubted_there_and_nowhere_else() {
        let mut log = driven(&door(), 2e-5, 1, 0.9, |t| if t < 5.0 { 0.9 } else { 1.7 });
        let (jump, joint) = (1000, hinge(&mut log));
        for series in [&mut joint.position, joint.effort.as_mut().unwrap()] {
            series.time.remove(jump);
            series.value.remove(jump);
        }
        let trajectories = [Trajectory::new(&log, &door()).unwrap()];
        let doubted: Vec<usize> = (0..trajectories[0].rows()).filter(|k| trajectories[0].doubt[*k] > 0.0).collect();
        assert_eq!(doubted, [jump + 1]);
        let search = Search::new(&door(), &trajectories).unwrap();
        let known = Hypothesis::known(&door(), &search.joints);
        let errors = search.problem.errors(&known, &known.x).unwrap();
        assert!(errors.iter().all(|e| e.abs() < 6.0), "{} deviations", errors.amax());
    }

    /// Jumps of the hand whose rows are lost, one in most windows: what that hides is no gap of a model that is right.
    #[test]
    fn inputs_that_jump_in_holes_are_no_gap() {
        let mut log = driven(&door(), 2e-5, 1, 0.9, |t| if (1.25 * t) as i32 % 2 == 0 { 0.7 } else { 1.3 });
        let joint = hinge(&mut log);
        for series in [&mut joint.position, joint.effort.as_mut().unwrap()] {
            let kept = |k: usize| k == 0 || !k.is_multiple_of(160);
            let keep = |all: &[f64]| (0..all.len()).filter(|k| kept(*k)).map(|k| all[k]).collect::<Vec<f64>>();
            *series = Series { time: keep(&series.time), value: keep(&series.value) };
        }
        let trajectories = [Trajectory::new(&log, &door()).unwrap()];
        let search = Search::new(&door(), &trajectories).unwrap();
        let measure = Measure::new(&search, &door(), &trajectories, &[], 1.0);
        assert!(!measure.is_far(&Hypothesis::known(&door(), &search.joints), 1));
    }

    /// A row that a table lacks is lacking for all joints of an arm; said for each of them it buries what else is said.
    #[test]
    fn rows_that_lack_for_all_joints_are_said_once() {
        let (mut model, mut log) = (door(), swing(&door(), 0.0, 1));
        let effort = hinge(&mut log).effort.as_mut().unwrap();
        effort.time.remove(70);
        effort.value.remove(70);
        for name in ["second", "third"] {
            let hinge = model.joints.iter().find(|j| j.name == "hinge").unwrap().clone();
            model.joints.push(sagci_model::Joint { name: name.into(), ..hinge });
            log.joints.push(JointLog { name: name.into(), ..log.joints[0].clone() });
        }
        let notes = Inputs::new(&log, &model).unwrap().notes;
        assert!(notes.len() == 1 && notes[0].starts_with("swing: hinge, second, third: 1 efforts are missing"), "{notes:?}");
    }

    /// A row for a position that has no effort lacks a sample; where a message of efforts has a clock of its own, it lacks none.
    #[test]
    fn an_effort_of_every_other_row_of_a_table_lacks_samples_and_a_topic_of_its_own_does_not() {
        let log = swing(&door(), 0.0, 1);
        let alternating = |is_table: bool| {
            let mut log = Log { is_table, ..log.clone() };
            let joint = hinge(&mut log);
            let effort = joint.effort.as_mut().unwrap();
            let keep = |series: &mut Series, side: usize| {
                let kept = |all: &[f64]| all.iter().copied().skip(side).step_by(2).collect::<Vec<f64>>();
                *series = Series { time: kept(&series.time), value: kept(&series.value) };
            };
            keep(effort, 1);
            keep(&mut joint.position, 0);
            Inputs::new(&log, &door()).unwrap()
        };
        let (table, topic) = (alternating(true), alternating(false));
        assert!(table.notes.len() == 1 && topic.notes.is_empty(), "{:?} {:?}", table.notes, topic.notes);
        assert_eq!(table.log.joints[0].effort.as_ref().unwrap().time.len(), 1999);
        assert_eq!(topic.log.joints[0].effort.as_ref().unwrap().time.len(), 1000);
    }

    /// A command that is published when it changes holds until the next.
    #[test]
    fn a_command_of_its_own_topic_is_held_and_one_of_a_table_is_sampled() {
        let mut log = swing(&door(), 0.0, 1);
        let joint = hinge(&mut log);
        let effort = joint.effort.take().unwrap();
        let kept = |all: &[f64]| all.iter().enumerate().filter(|(k, _)| k % 4 != 2).map(|(_, x)| *x).collect::<Vec<f64>>();
        joint.command = Some((CommandKind::Effort, Series { time: kept(&effort.time), value: kept(&effort.value) }));
        let count = |log: &Log| Inputs::new(log, &door()).unwrap().log.joints[0].command.as_ref().unwrap().1.time.len();
        assert_eq!((count(&log), count(&Log { is_table: true, ..log.clone() })), (1500, 2000));
    }

    /// Complete rows stay as they are.
    #[test]
    fn a_complete_recording_is_not_touched() {
        let log = Log { is_table: true, ..swing(&door(), 1e-4, 1) };
        let inputs = Inputs::new(&log, &door()).unwrap();
        assert!(inputs.log == log && inputs.notes.is_empty() && inputs.external.is_empty());
    }

    /// A force across the door at the end of a lever of known length.
    fn pushed(log: &Log, lever: f64) -> Log {
        let mut log = log.clone();
        let effort = hinge(&mut log).effort.take().unwrap();
        // The hinge turns about -z, on which its link's frame lies: a part is a torque, the rest a force along the link's own y.
        let F_L = effort.value.iter().map(|u| [0.3, -0.2, -0.4 * u, 5.0, -0.6 * u / lever, -7.0]);
        let of = |F: [f64; 6]| -> [f64; 6] {
            // At the origin of the link's frame a force at p has the moment p x f.
            let [tx, ty, tz, fx, fy, fz] = F;
            [tx, ty - lever * fz, tz + lever * fy, fx, fy, fz]
        };
        log.wrenches = vec![WrenchLog { link: "part".into(), time: effort.time, F_L: F_L.map(of).collect() }];
        log
    }

    #[test]
    fn a_force_at_a_link_acts_as_the_effort_that_it_is() {
        let model = door();
        let mut log = swing(&model, 1e-4, 1);
        let by_effort = Trajectory::new(&log, &model).unwrap();
        let mut by_force = pushed(&log, 0.4);
        let found = Trajectory::new(&by_force, &model).unwrap();
        assert_eq!((&found.time, &found.drive), (&by_effort.time, &by_effort.drive));
        for (ours, theirs) in found.input.iter().zip(&by_effort.input) {
            assert!((ours - theirs).abs() < 1e-9, "{ours} {theirs}");
        }
        // Beside an effort it would count twice; beside a command it comes on top.
        by_force.joints[0].effort.clone_from(&log.joints[0].effort);
        let both = Inputs::new(&by_force, &model).unwrap();
        assert!(both.external.is_empty() && both.notes.len() == 1, "{:?}", both.notes);
        let effort = hinge(&mut log).effort.take().unwrap();
        by_force.joints[0].effort = None;
        by_force.joints[0].command = Some((CommandKind::Effort, effort));
        assert_eq!(Inputs::new(&by_force, &model).unwrap().external.len(), 1);
    }
}
