use nalgebra::Isometry3;
use sagci_model::{JointKind, ObjectModel};
use sagci_signal::{Command, DepthImage, Observation};

use super::schema::{DEPTH, JOINT_COMMANDS, JOINT_STATES, POINTS, ROBOT_DESCRIPTION, TRUTH, WRENCH};
use super::{Journal, Level, RecordingError, RunRecord, message, nanoseconds};
use crate::judge::{Goal, NamedEffect, Verdict};
use crate::truth::{TrueFrame, TrueState};
use crate::{RapierWorld, Scene, World, WorldError};

/// Seconds between messages of each kind.
const STATE_PERIOD: f64 = 0.004;
const TRUTH_PERIOD: f64 = 0.02;
const FRAMES_PERIOD: f64 = 0.04;

/// Name of the camera's frame.
const CAMERA: &str = "camera";

trait Recordable: World + TrueState {}
impl<T: World + TrueState> Recordable for T {}

/// A world of which nothing but its sensors is known.
struct Opaque(Box<dyn World>);

impl TrueState for Opaque {
    fn true_frame(&self) -> TrueFrame {
        TrueFrame { time: 0.0, frames: Vec::new(), joints: Vec::new() }
    }
}

impl World for Opaque {
    fn period(&self) -> f64 {
        self.0.period()
    }
    fn reset(&mut self, scene: &Scene, seed: u64) -> Result<(), WorldError> {
        self.0.reset(scene, seed)
    }
    fn observe(&self) -> Observation {
        self.0.observe()
    }
    fn look(&mut self) -> Result<DepthImage, WorldError> {
        self.0.look()
    }
    fn advance(&mut self, command: &Command) -> Result<(), WorldError> {
        self.0.advance(command)
    }
    fn answer(&mut self, object: &str, named: &[NamedEffect]) {
        self.0.answer(object, named);
    }
    fn judge(self: Box<Self>, goals: &[Goal]) -> Option<Verdict> {
        self.0.judge(goals)
    }
}

/// A world that writes down everything that passes: what is commanded, what is measured, and (where the world knows it)
/// what is true. A file holds one run: from a reset to the end.
pub struct RecordedWorld {
    inner: Box<dyn Recordable>,
    journal: Journal,
    robot: Option<Robot>,
    next_state: f64,
    next_truth: f64,
    next_frames: f64,
}

/// What has to be known of the robot to write its messages.
struct Robot {
    model: std::sync::Arc<ObjectModel>,
    arm: Vec<String>,
    fingers: [String; 2],
    wrist: String,
    /// For each position of the model: index in the observation, or half the gripper's opening.
    positions: Vec<Source>,
    camera: Option<(usize, Isometry3<f64>)>,
}

#[derive(Clone, Copy)]
enum Source {
    Arm(usize),
    Finger,
    Fixed,
}

impl RecordedWorld {
    /// Records a simulated world, its true state included.
    pub fn rapier(world: RapierWorld, path: impl AsRef<std::path::Path>, record: &RunRecord) -> Result<Self, RecordingError> {
        Self::new(Box::new(world), path, record)
    }

    /// Records any world by its sensors alone.
    pub fn sensors(world: Box<dyn World>, path: impl AsRef<std::path::Path>, record: &RunRecord) -> Result<Self, RecordingError> {
        Self::new(Box::new(Opaque(world)), path, record)
    }

    fn new(inner: Box<dyn Recordable>, path: impl AsRef<std::path::Path>, record: &RunRecord) -> Result<Self, RecordingError> {
        let journal = Journal::create(path, record)?;
        Ok(Self { inner, journal, robot: None, next_state: 0.0, next_truth: 0.0, next_frames: 0.0 })
    }

    /// Where logs, phases and beliefs are written, and the file is closed. Copies write the same file.
    pub fn journal(&self) -> Journal {
        self.journal.clone()
    }

    /// Writes what is due now.
    fn write_state(&mut self) {
        let Some(robot) = &self.robot else { return };
        let observation = self.inner.observe();
        let now = observation.time;
        let time = nanoseconds(now);
        self.journal.tick(now);
        // Times are multiples of the period but for rounding.
        let due = |next: &mut f64, period: f64| {
            let is_due = now + 1e-6 >= *next;
            if is_due {
                *next = now + period;
            }
            is_due
        };
        if due(&mut self.next_state, STATE_PERIOD) {
            self.journal.message(JOINT_STATES, time, &message::observation(&observation, &robot.arm, &robot.fingers));
            self.journal.message(WRENCH, time, &message::wrench(time, &robot.wrist, &observation.F_S));
        }
        if due(&mut self.next_frames, FRAMES_PERIOD) {
            self.journal.frames(robot.frames(&observation).into_iter());
        }
        if due(&mut self.next_truth, TRUTH_PERIOD) {
            let frame = self.inner.true_frame();
            if !frame.frames.is_empty() {
                self.journal.message(TRUTH, time, &message::truth(&frame));
            }
        }
    }
}

impl Robot {
    fn new(model: &std::sync::Arc<ObjectModel>) -> Option<Self> {
        let facts = model.document.robot.as_ref()?;
        let fingers = facts.gripper.fingers.each_ref().map(|f| f.joint.clone());
        let positions = model
            .moving_joints()
            .map(|i| {
                let joint = &model.joints[i];
                match facts.arm_joints.iter().position(|n| *n == joint.name) {
                    Some(slot) => Source::Arm(slot),
                    None if joint.kind == JointKind::Prismatic && fingers.contains(&joint.name) => Source::Finger,
                    None => Source::Fixed,
                }
            })
            .collect();
        let camera = model.link(&facts.camera.link).map(|link| (link, facts.camera.X_LC.isometry()));
        Some(Self { model: model.clone(), arm: facts.arm_joints.clone(), fingers, wrist: facts.wrist_link.clone(), positions, camera })
    }

    /// Frames of the robot's links and its camera, from its encoders.
    fn frames(&self, observation: &Observation) -> Vec<(&str, String, Isometry3<f64>)> {
        let q: Vec<f64> = self
            .positions
            .iter()
            .map(|source| match source {
                Source::Arm(slot) => observation.q.get(*slot).copied().unwrap_or(0.0),
                Source::Finger => observation.gripper_width / 2.0,
                Source::Fixed => 0.0,
            })
            .collect();
        let X_WL = self.model.X_OL(&q);
        let mut frames: Vec<_> = self.model.links.iter().zip(&X_WL).map(|(l, X)| ("world", l.name.clone(), *X)).collect();
        if let Some((link, X_LC)) = &self.camera {
            frames.push(("world", CAMERA.to_owned(), X_WL[*link] * X_LC));
        }
        frames
    }
}

impl World for RecordedWorld {
    fn period(&self) -> f64 {
        self.inner.period()
    }

    fn reset(&mut self, scene: &Scene, seed: u64) -> Result<(), WorldError> {
        if self.robot.is_some() {
            let message = "a recording holds one run, and this one has begun; start another file to run again".to_owned();
            return Err(WorldError::Scene { place: self.journal.path().display().to_string(), message });
        }
        self.inner.reset(scene, seed)?;
        self.robot = Robot::new(&scene.robot);
        match std::fs::read_to_string(scene.robot.folder.join("object.urdf")) {
            Ok(urdf) => self.journal.message(ROBOT_DESCRIPTION, 0, &message::text(&urdf)),
            Err(e) => self.journal.log(Level::Warning, "recording", &format!("the robot's URDF is not in this file: {e}")),
        }
        let frame = self.inner.true_frame();
        if !frame.frames.is_empty() {
            let frames: Vec<_> = frame.frames.iter().map(|(n, _)| n.clone()).collect();
            let joints: Vec<_> = frame.joints.iter().map(|(n, _, _)| n.clone()).collect();
            self.journal.declare_truth(&frames, &joints);
        }
        self.write_state();
        Ok(())
    }

    fn observe(&self) -> Observation {
        self.inner.observe()
    }

    fn look(&mut self) -> Result<DepthImage, WorldError> {
        let image = self.inner.look()?;
        let time = nanoseconds(image.time);
        self.journal.message(POINTS, time, &message::points(&image, CAMERA));
        self.journal.message(DEPTH, time, &message::depth(&image, CAMERA));
        Ok(image)
    }

    fn advance(&mut self, command: &Command) -> Result<(), WorldError> {
        if let Some(robot) = &self.robot {
            let time = nanoseconds(self.inner.observe().time);
            self.journal.message(JOINT_COMMANDS, time, &message::command(time, command, &robot.arm));
        }
        let result = self.inner.advance(command);
        if let Err(e) = &result {
            self.journal.log(Level::Error, "world", &e.to_string());
        }
        self.write_state();
        result
    }

    fn answer(&mut self, object: &str, named: &[NamedEffect]) {
        self.inner.answer(object, named);
    }

    fn judge(self: Box<Self>, goals: &[Goal]) -> Option<Verdict> {
        let inner: Box<dyn World> = self.inner;
        inner.judge(goals)
    }
}

#[cfg(test)]
pub(super) mod testing {
    use super::{RecordedWorld, RecordingError, RunRecord, TrueState, World};

    pub fn recorded<W: World + TrueState + 'static>(
        world: W,
        path: impl AsRef<std::path::Path>,
        record: &RunRecord,
    ) -> Result<RecordedWorld, RecordingError> {
        RecordedWorld::new(Box::new(world), path, record)
    }
}
