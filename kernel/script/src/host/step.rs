//! One call of a skill: plan, carry out period by period, and check what came of it.

use std::collections::BTreeMap;

use sagci_perception::PerceptionError;
use sagci_skill::{
    Argument, BeliefChange, Execution, Failure, FailureCode, Measure, Place, PlanRequest, PlanSummary, Postcondition, Status, StepInput,
};

use super::belief::joint_slot;
use super::geometry;
use super::live::{Live, Sought};
use super::progress::Event;
use super::report::CheckReport;
use crate::language::stage::Stop;

/// A skill that takes this many times as long as planned, and this much longer, s, has timed out.
const SLOW: f64 = 3.0;
const GRACE: f64 = 30.0;
/// Once asked to stop, a skill is given this long to come to rest, s.
const STOP_TIME: f64 = 3.0;
/// World time between two events of progress, s.
const EVENTS: f64 = 0.05;
/// A gripper that holds something presses with at least this, N, and has not closed to less than this, m.
const HOLDING_FORCE: f64 = 1.0;
const HOLDING_WIDTH: f64 = 0.001;
/// How far a placed object may stick out of its region or be from its point, m, and how far it may lean, rad.
const PLACE_TOLERANCE: f64 = 0.03;
const LEAN: f64 = 0.26;
/// Least tolerance of a joint's measured position, as a fraction of its range.
const JOINT_TOLERANCE: f64 = 0.01;

/// Which call of which skill is under way.
pub(super) struct Calling<'a> {
    pub step: usize,
    pub skill: &'a str,
    /// With its arguments, as a person would write it.
    pub call: &'a str,
}

/// How a plan that was carried out ended.
pub(super) struct Carried {
    pub failure: Option<Failure>,
    pub measured: Vec<Measure>,
    /// The last object whose joint it moved, and the joint.
    pub moved: Option<(String, String)>,
}

/// The last object whose joint changed, and the joint.
fn moved(changes: &[BeliefChange]) -> Option<(String, String)> {
    changes.iter().rev().find_map(|change| match change {
        BeliefChange::Joint { object, joint, .. } => Some((object.clone(), joint.clone())),
        _ => None,
    })
}

pub(super) fn failure(code: FailureCode, stage: &str, message: impl Into<String>) -> Failure {
    Failure { code, stage: stage.to_owned(), message: message.into() }
}

/// The objects that a call speaks of.
pub(super) fn objects_of(arguments: &BTreeMap<String, Argument>) -> Vec<String> {
    let mut names: Vec<String> = arguments
        .values()
        .filter_map(|a| match a {
            Argument::Object { name, .. } => Some(name.clone()),
            Argument::Place(Place::Inside { object, .. }) => Some(object.clone()),
            _ => None,
        })
        .collect();
    names.sort();
    names.dedup();
    names
}

impl Live {
    /// Makes sure that the objects of a call have been seen.
    pub fn see(&mut self, arguments: &BTreeMap<String, Argument>) -> Result<Option<Failure>, Stop> {
        let unseen: Vec<Sought> = objects_of(arguments)
            .iter()
            .filter(|n| self.object(n).is_some_and(|(o, _)| !o.seen && o.X_TO.is_none()))
            .map(|n| Sought::object(n))
            .collect();
        if unseen.is_empty() {
            return Ok(None);
        }
        let left = self.look_for(&unseen)?;
        Ok(left.first().map(|(_, why)| failure(FailureCode::NotSeen, "look", why.to_string())))
    }

    /// What a skill is asked.
    pub fn request(&self, arguments: BTreeMap<String, Argument>, seed: u64) -> PlanRequest {
        PlanRequest {
            arguments,
            belief: self.belief.clone(),
            q: self.observation.q.clone(),
            gripper_width: self.observation.gripper_width,
            period: self.world.period(),
            seed,
        }
    }

    /// Carries a plan out, one period at a time.
    pub fn carry_out(&mut self, calling: &Calling<'_>, summary: &PlanSummary, execution: &mut dyn Execution) -> Result<Carried, Stop> {
        let planned: f64 = summary.phases.iter().map(|p| p.seconds).sum();
        let start = self.observation.time;
        let deadline = start + SLOW * planned + GRACE;
        self.sensed.clear();
        let (mut belief, mut asked_to_stop, mut next_event, mut phase) = (None, None, start, usize::MAX);
        loop {
            let now = self.observation.time;
            let late = now > deadline;
            if asked_to_stop.is_none() && (late || self.cancelled()) {
                execution.cancel();
                asked_to_stop = Some(now);
            }
            let input = StepInput { observation: self.observation.clone(), belief: belief.take(), cancel: asked_to_stop.is_some() };
            let reply = execution.step(&input);
            if reply.phase != phase || now >= next_event {
                phase = reply.phase;
                next_event = now + EVENTS;
                let name = summary.phases.get(phase).map_or("", |p| p.name.as_str());
                let Calling { step, skill, call } = *calling;
                if let Some(journal) = &self.journal {
                    journal.phase(step, skill, name, reply.progress);
                }
                let event = Event::Phase { step, call, phase: name, progress: reply.progress.clamp(0.0, 1.0), time: now };
                self.progress.event(self.seed, &event);
            }
            let timed_out = || {
                failure(
                    FailureCode::TimedOut,
                    "execution",
                    format!("took more than {:.0} s, planned were {planned:.0} s", deadline - start),
                )
            };
            let usable = reply.command.tau.len() == self.observation.q.len()
                && reply.command.tau.iter().chain([&reply.command.gripper.width, &reply.command.gripper.force]).all(|x| x.is_finite());
            if usable {
                self.arm.gripper = reply.command.gripper;
                self.advance(&reply.command)?;
                self.sensed.push(self.observation.clone());
            }
            match reply.status {
                Status::Running if !usable => {
                    self.come_to_rest()?;
                    let message = format!(
                        "the skill's command has {} efforts or is not finite; the arm has {} joints",
                        reply.command.tau.len(),
                        self.observation.q.len()
                    );
                    return Ok(Carried {
                        failure: Some(failure(FailureCode::PluginFault, "execution", message)),
                        measured: Vec::new(),
                        moved: None,
                    });
                }
                Status::Running => {}
                Status::Look { objects } => {
                    let sought: Vec<Sought> = objects.iter().map(|o| Sought::object(o)).collect();
                    self.carry_held()?;
                    let view = self.view()?;
                    self.locate(&[view], &sought)?;
                    belief = Some(self.belief.clone());
                }
                Status::Done { measured, changes } => {
                    self.apply(&changes)?;
                    return Ok(Carried { failure: None, measured, moved: moved(&changes) });
                }
                Status::Failed { failure, measured, changes } => {
                    self.come_to_rest()?;
                    self.apply(&changes)?;
                    if self.cancelled() {
                        return Err(Stop::Interrupted);
                    }
                    let failure = if late { timed_out() } else { failure };
                    return Ok(Carried { failure: Some(failure), measured, moved: moved(&changes) });
                }
            }
            if asked_to_stop.is_some_and(|t| self.observation.time - t > STOP_TIME) {
                // The skill does not stop by itself.
                self.come_to_rest()?;
                if self.cancelled() {
                    return Err(Stop::Interrupted);
                }
                return Ok(Carried { failure: Some(timed_out()), measured: Vec::new(), moved: None });
            }
        }
    }

    /// Checks what must be true after a skill, by the gripper's sensors and the camera. Figures that the camera measured
    /// take the place of the skill's own.
    pub fn verify(&mut self, postconditions: &[Postcondition], measured: &mut Vec<Measure>) -> Result<Vec<CheckReport>, Stop> {
        let mut checks: Vec<Option<CheckReport>> = vec![None; postconditions.len()];
        // The gripper first: looking moves the arm.
        for (check, condition) in checks.iter_mut().zip(postconditions) {
            if let Postcondition::Holding { object } = condition {
                *check = Some(self.check_holding(object)?);
            }
        }
        let sought: Vec<Sought> = postconditions
            .iter()
            .filter_map(|condition| match condition {
                Postcondition::JointBetween { object, joint, .. } => {
                    let (_, model) = self.object(object)?;
                    Some(Sought { object: object.clone(), joint: joint_slot(model, joint) })
                }
                Postcondition::At { object, .. } => Some(Sought::object(object)),
                Postcondition::Holding { .. } => None,
            })
            .collect();
        let left = if sought.is_empty() { Vec::new() } else { self.look_for(&sought)? };
        for (check, condition) in checks.iter_mut().zip(postconditions) {
            let unseen = |object: &str| left.iter().find(|(s, _)| s.object == object).map(|(_, why)| why);
            match condition {
                Postcondition::Holding { .. } => {}
                Postcondition::JointBetween { object, joint, least, most } => {
                    *check = Some(self.check_joint(object, joint, [*least, *most], unseen(object), measured));
                }
                Postcondition::At { object, place } => *check = Some(self.check_place(object, place, unseen(object))),
            }
        }
        Ok(checks.into_iter().flatten().collect())
    }

    fn check_holding(&mut self, object: &str) -> Result<CheckReport, Stop> {
        let (width, force) = (self.observation.gripper_width, self.observation.gripper_force);
        let holds = width > HOLDING_WIDTH && force > HOLDING_FORCE;
        if !holds {
            // It lies wherever it fell.
            let X_WO = self.object(object).map(|(o, _)| o.X_WO);
            if let Some(X_WO) = X_WO {
                self.apply(&[BeliefChange::Released { object: object.to_owned(), X_WO }])?;
                if let Some(i) = self.index(object) {
                    self.belief.objects[i].seen = false;
                }
            }
        }
        let seen = format!("fingers {:.1} mm apart, pressing with {force:.1} N", width * 1000.0);
        Ok(CheckReport { text: format!("{object} is held"), holds: Some(holds), seen })
    }

    fn check_joint(
        &self,
        object: &str,
        joint: &str,
        [least, most]: [f64; 2],
        unseen: Option<&PerceptionError>,
        measured: &mut Vec<Measure>,
    ) -> CheckReport {
        let slot = self.object(object).and_then(|(_, model)| joint_slot(model, joint));
        let found = slot.and_then(|slot| {
            let (o, model) = self.object(object)?;
            let joint = model.moving_joints().nth(slot).and_then(|j| model.joints.get(j))?;
            Some((*o.q.get(slot)?, joint.limits.range(), joint.kind == sagci_model::JointKind::Prismatic))
        });
        let Some((q, range, slides)) = found else {
            return CheckReport { text: format!("{object}.{joint}"), holds: Some(false), seen: "there is no such joint".to_owned() };
        };
        let words = |x: f64| if slides { format!("{:.1} cm", x * 100.0) } else { format!("{:.1} deg", x.to_degrees()) };
        let text = format!("{object}.{joint} between {} and {}", words(least), words(most));
        if let Some(why) = unseen {
            return CheckReport { text, holds: None, seen: why.to_string() };
        }
        let tolerance = if range.is_finite() { JOINT_TOLERANCE * range } else { 0.02 };
        let unit = if slides { "m" } else { "rad" };
        match measured.iter_mut().find(|m| m.name == joint && m.unit == unit) {
            Some(m) => m.value = q,
            None => measured.push(Measure { name: joint.to_owned(), value: q, unit: unit.to_owned() }),
        }
        CheckReport { text, holds: Some(q >= least - tolerance && q <= most + tolerance), seen: words(q) }
    }

    fn check_place(&self, object: &str, place: &Place, unseen: Option<&PerceptionError>) -> CheckReport {
        let text = match place {
            Place::Inside { object: container, region: None } => format!("{object} inside {container}"),
            Place::Inside { object: container, region: Some(region) } => format!("{object} inside {region} of {container}"),
            Place::Table { at } => format!("{object} at ({:.2} m, {:.2} m)", at[0], at[1]),
        };
        if let Some(why) = unseen {
            return CheckReport { text, holds: None, seen: why.to_string() };
        }
        let Some((o, model)) = self.object(object) else {
            return CheckReport { text, holds: Some(false), seen: "there is no such object".to_owned() };
        };
        let (least, most) = geometry::bounds(model, &o.X_WO, &o.q);
        let center = nalgebra::center(&least, &most);
        let off = match place {
            Place::Table { at } => (center.x - at[0]).hypot(center.y - at[1]),
            Place::Inside { object: container, region } => self
                .object(container)
                .and_then(|(holder, model)| {
                    let (region, link) = geometry::region(model, region.as_deref())?;
                    let X_WG = geometry::X_WG(model, &holder.X_WO, &holder.q, region, link);
                    Some(geometry::outside(region, &X_WG, &center))
                })
                .unwrap_or(f64::INFINITY),
        };
        let lean = (o.X_WO.rotation * nalgebra::Vector3::z()).angle(&nalgebra::Vector3::z());
        let seen = format!("{:.1} cm off, leaning by {:.0} deg", off * 100.0, lean.to_degrees());
        CheckReport { text, holds: Some(off <= PLACE_TOLERANCE && lean <= LEAN), seen }
    }
}
