use nalgebra::Isometry3;
use sagci_control::ControlError;
use sagci_signal::{Command, GripperCommand, Observation};
use sagci_skill::{BeliefChange, Execution, Failure, FailureCode, Measure, Phase, Status, StepInput, StepReply};

use crate::finger::Fingering;
use crate::follow::{Following, Outcome};
use crate::{Arm, Segment};

/// How a segment ended: what a skill measures with.
#[derive(Debug, Clone, PartialEq)]
pub struct Ending {
    /// Index of the phase it belongs to.
    pub phase: usize,
    /// Pose of the tool in the world.
    pub X_WT: Isometry3<f64>,
    /// Opening of the gripper, m.
    pub gripper_width: f64,
    /// Greatest force at the wrist during the segment, N.
    pub peak_force: f64,
    /// Time, s.
    pub time: f64,
}

/// What a skill says when it is done or has failed, from how its segments ended so far.
pub type Report = Box<dyn Fn(&[Ending]) -> (Vec<Measure>, Vec<BeliefChange>) + Send>;

/// How long the arm is given to come to rest after a failure, s.
const REST_SECONDS: f64 = 0.5;

/// A plan as a list of segments in phases.
pub struct Sequence {
    arm: Arm,
    period: f64,
    phases: Vec<Phase>,
    segments: Vec<(usize, Segment)>,
    report: Report,
    current: usize,
    running: Option<Running>,
    endings: Vec<Ending>,
    peak_force: f64,
    command: Command,
    failure: Option<(Failure, f64)>,
}

enum Running {
    Follow(Box<Following>),
    Fingers(Fingering),
}

impl Sequence {
    /// An empty plan for an arm whose gripper now does `gripper`; `period` is the control period in s.
    pub fn new(arm: Arm, period: f64, gripper: GripperCommand) -> Self {
        let tau = vec![0.0; arm.model.n()];
        Self {
            arm,
            period,
            phases: Vec::new(),
            segments: Vec::new(),
            report: Box::new(|_| (Vec::new(), Vec::new())),
            current: 0,
            running: None,
            endings: Vec::new(),
            peak_force: 0.0,
            command: Command { tau, gripper },
            failure: None,
        }
    }

    /// Adds a phase with its segments.
    pub fn phase(&mut self, name: &str, segments: impl IntoIterator<Item = Segment>) {
        let index = self.phases.len();
        let before = self.segments.len();
        self.segments.extend(segments.into_iter().map(|s| (index, s)));
        let seconds = self.segments[before..].iter().map(|(_, s)| s.seconds()).sum();
        self.phases.push(Phase { name: name.into(), seconds });
    }

    /// Says how the skill's measures follow from the endings of its segments.
    pub fn report(&mut self, report: Report) {
        self.report = report;
    }

    /// The phases so far.
    pub fn phases(&self) -> &[Phase] {
        &self.phases
    }

    fn progress(&self) -> f64 {
        let total: f64 = self.segments.iter().map(|(_, s)| s.seconds()).sum();
        let done: f64 = self.segments.iter().take(self.current).map(|(_, s)| s.seconds()).sum();
        let here = if let Some(Running::Follow(f)) = &self.running { f.clock() } else { 0.0 };
        if total > 0.0 { ((done + here) / total).min(1.0) } else { 1.0 }
    }

    fn phase_index(&self) -> usize {
        let last = self.segments.len().saturating_sub(1);
        self.segments.get(self.current.min(last)).map_or(0, |(phase, _)| *phase)
    }

    /// Stops, and remembers why.
    fn fail(&mut self, mut failure: Failure, observation: &Observation) -> Result<(), ControlError> {
        if failure.stage.is_empty() {
            failure.stage = self.phases.get(self.phase_index()).map_or_else(String::new, |p| p.name.clone());
        }
        self.failure = Some((failure, observation.time + REST_SECONDS));
        self.running = Some(Running::Follow(Box::new(Following::hold(&self.arm, self.command.gripper, self.period)?)));
        Ok(())
    }

    /// Starts the next segment if none runs.
    fn start(&mut self, observation: &Observation) -> Result<(), ControlError> {
        while self.running.is_none() {
            self.running = Some(match self.segments.get(self.current) {
                Some((_, Segment::Follow(follow))) => Running::Follow(Box::new(Following::new(&self.arm, follow.clone(), self.period)?)),
                Some((_, Segment::Fingers(fingers))) => Running::Fingers(Fingering::new(&self.arm, *fingers, observation)?),
                Some((_, Segment::Carry(payload))) => {
                    self.arm.model.set_payload(payload.as_ref())?;
                    self.arm.model.observe(observation)?;
                    self.end(observation);
                    continue;
                }
                None => Running::Follow(Box::new(Following::hold(&self.arm, self.command.gripper, self.period)?)),
            });
        }
        Ok(())
    }

    fn end(&mut self, observation: &Observation) {
        self.endings.push(Ending {
            phase: self.phase_index(),
            X_WT: *self.arm.model.X_WT(),
            gripper_width: observation.gripper_width,
            peak_force: self.peak_force,
            time: observation.time,
        });
        self.peak_force = 0.0;
        self.current += 1;
        self.running = None;
    }

    fn advance(&mut self, input: &StepInput) -> Result<(), ControlError> {
        let observation = &input.observation;
        self.arm.model.observe(observation)?;
        self.peak_force = self.peak_force.max(observation.F_S.force.norm());
        if input.cancel && self.failure.is_none() {
            let failure = Failure { code: FailureCode::Cancelled, stage: String::new(), message: "stopped by the host".into() };
            self.fail(failure, observation)?;
        }
        self.start(observation)?;
        let outcome = match &mut self.running {
            Some(Running::Follow(f)) => f.step(&mut self.arm, observation, self.period, &mut self.command)?,
            Some(Running::Fingers(f)) => f.step(&mut self.arm, observation, self.period, &mut self.command)?,
            None => Outcome::Going,
        };
        if self.failure.is_some() || self.current >= self.segments.len() {
            return Ok(());
        }
        match outcome {
            Outcome::Going => {}
            Outcome::Done => self.end(observation),
            Outcome::Failed(failure) => self.fail(failure, observation)?,
        }
        Ok(())
    }

    fn status(&self, time: f64) -> Status {
        if let Some((failure, rest_until)) = &self.failure {
            if time < *rest_until {
                return Status::Running;
            }
            let (measured, changes) = (self.report)(&self.endings);
            return Status::Failed { failure: failure.clone(), measured, changes };
        }
        if self.current < self.segments.len() {
            return Status::Running;
        }
        let (measured, changes) = (self.report)(&self.endings);
        Status::Done { measured, changes }
    }
}

impl Execution for Sequence {
    fn step(&mut self, input: &StepInput) -> StepReply {
        let status = match self.advance(input) {
            Ok(()) => self.status(input.observation.time),
            // The laws refuse what is not a state. The last command stands for this period, and the skill ends.
            Err(e) => {
                let (measured, changes) = (self.report)(&self.endings);
                let failure = Failure { code: FailureCode::PluginFault, stage: "control".into(), message: e.to_string() };
                Status::Failed { failure, measured, changes }
            }
        };
        StepReply { command: self.command.clone(), phase: self.phase_index(), progress: self.progress(), status }
    }
}
