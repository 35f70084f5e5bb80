//! What every skill of an arm needs to plan: the scene, arguments, free motions, timing, and failures in words.

use sagci_model::JointKind;
use sagci_planning::{
    CollisionWorld, Destination, FreeMotionOptions, JointTrajectory, MotionLimits, PlanError, Scene, free_motion, time_path,
};
use sagci_signal::GripperCommand;
use sagci_skill::{Argument, Failure, FailureCode, Place, PlanRequest, PlanSummary};

use crate::{Arm, Follow, Guard, Law, Segment, Sequence};

/// Name of the robot's configuration in which a skill leaves the arm.
const REST: &str = "ready";

/// How fast a part of a plan is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// Free of contact.
    Free,
    /// Near things, or with something in the hand.
    Careful,
    /// Into a grasp, or against something.
    Slow,
}

impl Pace {
    /// Share of the joints' greatest speeds, time to reach it in s, and greatest tool speed in m/s and rad/s.
    fn limits(self) -> (f64, f64, f64, f64) {
        match self {
            Self::Free => (0.5, 0.5, 1.0, 2.0),
            Self::Careful => (0.35, 0.5, 0.35, 1.2),
            Self::Slow => (0.25, 0.5, 0.12, 0.8),
        }
    }
}

/// A request, with its models read and the world that is planned in.
pub struct Bench<'a> {
    /// What was asked.
    pub request: &'a PlanRequest,
    /// The scene of its belief.
    pub scene: Scene,
    /// The scene as solids.
    pub world: CollisionWorld,
    cancelled: &'a dyn Fn() -> bool,
}

impl<'a> Bench<'a> {
    /// Reads the models of a request's belief.
    ///
    /// # Errors
    /// [`FailureCode::ModelLacks`] if a model cannot be read or the robot is no arm.
    pub fn new(request: &'a PlanRequest, cancelled: &'a dyn Fn() -> bool) -> Result<Self, Failure> {
        let scene = Scene::read(&request.belief).map_err(failure_of)?;
        let world = CollisionWorld::new(&scene).map_err(failure_of)?;
        Ok(Self { request, scene, world, cancelled })
    }

    /// Does the host want no plan any more?
    pub fn cancelled(&self) -> &dyn Fn() -> bool {
        self.cancelled
    }

    /// The object that an argument names: its index in the scene.
    ///
    /// # Errors
    /// [`FailureCode::BadArgument`] if there is no such argument or object.
    pub fn object(&self, parameter: &str) -> Result<usize, Failure> {
        match self.request.arguments.get(parameter) {
            Some(Argument::Object { name, .. }) => self.index(name),
            _ => Err(bad_argument(format!("'{parameter}' must be an object of the scene"))),
        }
    }

    fn index(&self, name: &str) -> Result<usize, Failure> {
        self.scene.object(name).map_err(failure_of)
    }

    /// The joint of an object that an argument names, or the only one that it has: its place among the moving joints.
    ///
    /// # Errors
    /// [`FailureCode::BadArgument`] if it has several and none is named, [`FailureCode::ModelLacks`] if it has none.
    pub fn joint(&self, parameter: &str) -> Result<usize, Failure> {
        let object = self.object(parameter)?;
        let model = &self.scene.objects[object].model;
        let names: Vec<&str> = model
            .moving_joints()
            .map(|i| &model.joints[i])
            .filter(|j| matches!(j.kind, JointKind::Revolute | JointKind::Continuous | JointKind::Prismatic))
            .map(|j| j.name.as_str())
            .collect();
        let named = match self.request.arguments.get(parameter) {
            Some(Argument::Object { joint, .. }) => joint.as_deref(),
            _ => None,
        };
        match (named, names.as_slice()) {
            (None, []) => Err(Failure {
                code: FailureCode::ModelLacks,
                stage: "joint".into(),
                message: format!("'{}' has no joint that moves", model.name),
            }),
            (None, [_]) => Ok(0),
            (None, several) => Err(bad_argument(format!("'{}' has several joints, name one of them: {}", model.name, several.join(", ")))),
            (Some(name), all) => all
                .iter()
                .position(|n| *n == name)
                .ok_or_else(|| bad_argument(format!("'{}' has no joint '{name}'; it has {}", model.name, all.join(", ")))),
        }
    }

    /// The place that an argument names, if it was passed.
    ///
    /// # Errors
    /// [`FailureCode::BadArgument`] or [`FailureCode::ModelLacks`] if the object or the region is not there.
    pub fn place(&self, parameter: &str) -> Result<Option<(Place, Destination)>, Failure> {
        let place = match self.request.arguments.get(parameter) {
            None => return Ok(None),
            Some(Argument::Place(place)) => place.clone(),
            Some(_) => return Err(bad_argument(format!("'{parameter}' must be a place"))),
        };
        let destination = match &place {
            Place::Table { at } => Destination::Table { at: *at },
            Place::Inside { object, region } => {
                let index = self.index(object)?;
                let model = &self.scene.objects[index].model;
                let regions = &model.document.regions;
                let found = match region {
                    None => (!regions.is_empty()).then_some(0),
                    Some(name) => regions.iter().position(|r| &r.name == name),
                };
                let region = found.ok_or_else(|| Failure {
                    code: FailureCode::ModelLacks,
                    stage: "place".into(),
                    message: format!(
                        "'{}' has no {}; its regions: {}",
                        model.name,
                        region.as_ref().map_or("region".into(), |r| format!("region '{r}'")),
                        regions.iter().map(|r| r.name.as_str()).collect::<Vec<_>>().join(", ")
                    ),
                })?;
                Destination::Region { object: index, region }
            }
        };
        Ok(Some((place, destination)))
    }

    /// The object that the gripper is believed to hold.
    pub fn held(&self) -> Option<usize> {
        self.scene.objects.iter().position(|o| o.X_TO.is_some())
    }

    /// Where a skill leaves the arm.
    ///
    /// # Errors
    /// [`FailureCode::ModelLacks`] if the robot's model does not say.
    pub fn rest(&self) -> Result<Vec<f64>, Failure> {
        let configurations = self.scene.robot.document.robot.iter().flat_map(|r| &r.configurations);
        configurations.filter(|c| c.name == REST).map(|c| c.q.clone()).next().ok_or_else(|| Failure {
            code: FailureCode::ModelLacks,
            stage: "rest".into(),
            message: format!("the robot '{}' has no configuration '{REST}'", self.scene.robot.name),
        })
    }

    /// A free path in a world, as a trajectory.
    ///
    /// # Errors
    /// As [`free_motion`], with `stage` in its message.
    pub fn free(
        &self,
        world: &CollisionWorld,
        from: &[f64],
        to: &[f64],
        width: f64,
        pace: Pace,
        stage: &str,
    ) -> Result<JointTrajectory, Failure> {
        let options = FreeMotionOptions { seed: self.request.seed, stage: stage.into(), ..FreeMotionOptions::default() };
        let path = free_motion(world, from, &[to.to_vec()], width, &options, self.cancelled).map_err(failure_of)?;
        self.timed(&path.q, pace)
    }

    /// Timing for a path.
    ///
    /// # Errors
    /// As [`time_path`].
    pub fn timed(&self, path: &[Vec<f64>], pace: Pace) -> Result<JointTrajectory, Failure> {
        let arm = self.world.arm();
        let (share, seconds, speed, turn) = pace.limits();
        let limits = MotionLimits { tool: Some((arm, speed, turn)), ..MotionLimits::of_arm(arm, share, seconds) };
        time_path(path, &limits).map_err(failure_of)
    }

    /// An empty sequence for the arm.
    ///
    /// # Errors
    /// As [`Arm::new`].
    pub fn sequence(&self, gripper: GripperCommand) -> Result<Sequence, Failure> {
        Ok(Sequence::new(Arm::new(&self.scene.robot, &self.request.belief)?, self.request.period, gripper))
    }

    /// An empty summary with the phases of a sequence.
    pub fn summary(&self, sequence: &Sequence, q_after: &[f64]) -> PlanSummary {
        PlanSummary {
            phases: sequence.phases().to_vec(),
            predicted: Vec::new(),
            after: Vec::new(),
            q_after: q_after.to_vec(),
            postconditions: Vec::new(),
        }
    }
}

/// A joint trajectory through free space.
pub fn through_air(trajectory: JointTrajectory, gripper: GripperCommand, least_width: f64) -> Segment {
    Segment::Follow(Follow { trajectory, law: Law::Joints, gripper, guard: Guard::Overload { limit: 60.0 }, least_width })
}

/// A tool path near things, that gives way when it touches.
pub fn with_feeling(trajectory: JointTrajectory, gripper: GripperCommand, anchored: bool, guard: Guard, least_width: f64) -> Segment {
    let law = Law::Tool { along: 1000.0, across: 1000.0, turning: 60.0, anchored, push: Vec::new() };
    Segment::Follow(Follow { trajectory, law, gripper, guard, least_width })
}

/// A wrong argument.
pub fn bad_argument(message: String) -> Failure {
    Failure { code: FailureCode::BadArgument, stage: "arguments".into(), message }
}

/// A planning error as a skill's failure.
pub fn failure_of(error: PlanError) -> Failure {
    let code = match &error {
        PlanError::ModelLacks { .. } => FailureCode::ModelLacks,
        PlanError::Unreachable { .. } | PlanError::TooWeak { .. } => FailureCode::Unreachable,
        PlanError::Collision { .. } => FailureCode::Collision,
        PlanError::NoConvergence { .. } => FailureCode::NoConvergence,
        PlanError::Cancelled { .. } => FailureCode::Cancelled,
        PlanError::BadInput { .. } => FailureCode::BadArgument,
    };
    let stage = error.stage().to_owned();
    let message = error.to_string();
    let message = message.strip_prefix(&format!("{stage}: ")).unwrap_or(&message).to_owned();
    Failure { code, stage, message }
}
