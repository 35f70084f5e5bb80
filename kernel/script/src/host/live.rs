//! A run under way: the world, the arm, and what is believed.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::Point3;
use sagci_model::ObjectModel;
use sagci_perception::{Freedom, JointSearch, Located, PerceptionError, Place, Prior, SceneRequest, View};
use sagci_planning::{CollisionWorld, FreeMotionOptions, JointTrajectory, MotionLimits, PlanError, free_motion, time_path};
use sagci_signal::{Command, ObjectBelief, Observation, SceneBelief};
use sagci_skill::BeliefChange;
use sagci_world::recording::Journal;
use sagci_world::{Placement, Scene, World};

use super::aim;
use super::arm::HostArm;
use super::belief::{self, RIDES};
use super::geometry;
use super::progress::{Event, Progress};
use crate::language::stage::Stop;

/// Share of the arm's greatest speeds that the host moves with, and the time in which it gets there, s.
const SPEED: f64 = 0.5;
const SPEED_UP: f64 = 0.4;
/// Configurations of a motion at which inertia is looked at.
const PROBES: usize = 12;
/// Slower than this, rad/s or m/s, the arm is at rest; it is given this long to come to it, s.
const AT_REST: f64 = 0.01;
const REST_TIME: f64 = 2.0;
/// How far a declared object may be from its place: as the world's contract says, and a little for the model's own error.
const DECLARED_SHIFT: f64 = 0.11;
const DECLARED_YAW: f64 = 0.3;
/// How far an object may be from where it was seen or put last.
const KNOWN_SHIFT: f64 = 0.05;
const KNOWN_YAW: f64 = 0.35;
/// A released object may have turned on the way down.
const RELEASED_YAW: f64 = 0.8;
/// Finds objects in images. The usual one is [`sagci_perception::locate_scene`].
pub trait Perceive: Send + Sync {
    /// One answer for each request, in their order.
    fn locate(
        &self,
        views: &[View],
        table_height: f64,
        requests: &[SceneRequest<'_>],
    ) -> Result<Vec<Result<Located, PerceptionError>>, PerceptionError>;
}

/// Registration of the stored geometry.
pub struct Registration;

impl Perceive for Registration {
    fn locate(
        &self,
        views: &[View],
        table_height: f64,
        requests: &[SceneRequest<'_>],
    ) -> Result<Vec<Result<Located, PerceptionError>>, PerceptionError> {
        sagci_perception::locate_scene(views, table_height, requests)
    }
}

/// What the host knows of one object besides the belief that it shares with skills.
#[derive(Debug, Clone)]
pub(super) struct Thing {
    pub model: Arc<ObjectModel>,
    /// Where the script said it is, until it is seen or moved.
    pub declared: Option<Placement>,
    /// In what the script said it is, until the robot takes it: there it is sought when it has been moved along.
    pub home: Option<Placement>,
    /// It was put down and not seen since.
    pub released: bool,
}

/// A run under way.
pub(super) struct Live {
    pub world: Box<dyn World>,
    pub journal: Option<Journal>,
    pub scene: Scene,
    pub belief: SceneBelief,
    pub things: Vec<Thing>,
    pub observation: Observation,
    pub arm: HostArm,
    pub perceive: Arc<dyn Perceive>,
    pub progress: Arc<dyn Progress>,
    pub cancel: Arc<AtomicBool>,
    pub seed: u64,
    /// What was sensed in the last call of a skill, period by period.
    pub sensed: Vec<Observation>,
}

/// What to look for.
#[derive(Debug, Clone)]
pub(super) struct Sought {
    pub object: String,
    /// Estimate this joint too, by its slot in `q`.
    pub joint: Option<usize>,
}

impl Sought {
    pub fn object(name: &str) -> Self {
        Self { object: name.to_owned(), joint: None }
    }
}

pub(super) fn broken(what: &str, error: impl std::fmt::Display) -> Stop {
    Stop::Broken(format!("{what}: {error}"))
}

impl Live {
    pub fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// Writes into the recording what is believed now.
    pub fn note_belief(&self) {
        if let Some(journal) = &self.journal {
            journal.belief(&self.belief);
        }
    }

    pub fn index(&self, object: &str) -> Option<usize> {
        self.belief.objects.iter().position(|o| o.name == object)
    }

    /// Holds a command for one period and reads the sensors.
    pub fn advance(&mut self, command: &Command) -> Result<(), Stop> {
        self.world.advance(command).map_err(|e| broken("the world", e))?;
        self.observation = self.world.observe();
        Ok(())
    }

    /// One period of the host's own control.
    fn drive(&mut self, q: &[f64], v: &[f64], a: &[f64]) -> Result<(), Stop> {
        let command = self.arm.toward(&self.observation, q, v, a).map_err(|e| broken("the arm's control", e))?.clone();
        self.advance(&command)
    }

    /// Stops the arm where it is, softly: its reference slows down from the speed that it has.
    pub fn come_to_rest(&mut self) -> Result<(), Stop> {
        let period = self.world.period();
        let (mut q, mut v) = (self.observation.q.clone(), self.observation.v.clone());
        let zero = vec![0.0; q.len()];
        self.arm.tune(std::slice::from_ref(&q)).map_err(|e| broken("the arm's control", e))?;
        let mut left = REST_TIME;
        while left > 0.0 {
            for (q, v) in q.iter_mut().zip(&mut v) {
                // Within a tenth of a second.
                *v *= 1.0 - (period / 0.1).min(1.0);
                *q += *v * period;
            }
            self.drive(&q, &v, &zero)?;
            left -= period;
            let reference_rests = v.iter().all(|v| v.abs() < AT_REST);
            if reference_rests && self.observation.v.iter().all(|v| v.abs() < AT_REST) {
                break;
            }
        }
        Ok(())
    }

    fn follow(&mut self, trajectory: &JointTrajectory) -> Result<(), Stop> {
        let (period, start) = (self.world.period(), self.observation.time);
        let way: Vec<Vec<f64>> = (0..PROBES).map(|i| trajectory.at_progress(i as f64 / (PROBES - 1) as f64)).collect();
        self.arm.tune(&way).map_err(|e| broken("the arm's control", e))?;
        loop {
            if self.cancelled() {
                self.come_to_rest()?;
                return Err(Stop::Interrupted);
            }
            let t = self.observation.time - start + period;
            let at = trajectory.sample(t);
            self.drive(&at.q, &at.v, &at.a)?;
            if t >= trajectory.duration() {
                return self.come_to_rest();
            }
        }
    }

    /// The scene as planning sees it, with the models that are read already.
    pub fn planning_scene(&self) -> Result<sagci_planning::Scene, PlanError> {
        let read = |folder: &Path| {
            let known = self.things.iter().map(|t| &t.model).chain([&self.scene.robot]).find(|m| m.folder == folder);
            known
                .cloned()
                .ok_or_else(|| PlanError::ModelLacks { model: folder.display().to_string(), message: "is not in the scene".into() })
        };
        sagci_planning::Scene::with_models(&self.belief, &read)
    }

    /// Moves to the first of the goals that it can reach.
    pub fn move_to(&mut self, goals: &[Vec<f64>]) -> Result<Result<(), PlanError>, Stop> {
        let q = self.observation.q.clone();
        let near = |goal: &Vec<f64>| goal.iter().zip(&q).all(|(a, b)| (a - b).abs() < 0.02);
        if goals.iter().any(near) {
            return Ok(Ok(()));
        }
        let cancel = self.cancel.clone();
        let planned = self.planning_scene().and_then(|scene| CollisionWorld::new(&scene)).and_then(|world| {
            let options = FreeMotionOptions { seed: self.seed, stage: "look".into(), ..Default::default() };
            let path = free_motion(&world, &q, goals, self.observation.gripper_width, &options, &|| cancel.load(Ordering::Relaxed))?;
            time_path(&path.q, &MotionLimits::of_arm(world.arm(), SPEED, SPEED_UP))
        });
        match planned {
            Ok(trajectory) => self.follow(&trajectory).map(Ok),
            Err(PlanError::Cancelled { .. }) => Err(Stop::Interrupted),
            Err(e) => Ok(Err(e)),
        }
    }

    /// An image from where the arm is now.
    pub fn view(&mut self) -> Result<View, Stop> {
        let image = self.world.look().map_err(|e| broken("the camera", e))?;
        let mut view =
            View::of_wrist(&self.scene.robot, &self.belief.X_WR, &self.observation, image).map_err(|e| broken("the camera", e))?;
        for (object, thing) in self.belief.objects.iter().zip(&self.things) {
            if object.X_TO.is_some() {
                view = view.with_known(&thing.model, &object.X_WO, &object.q);
            }
        }
        Ok(view)
    }

    /// Looks for objects in images. What is found is believed; answers why the others were not.
    pub fn locate(&mut self, views: &[View], sought: &[Sought]) -> Result<Vec<(Sought, Result<Located, PerceptionError>)>, Stop> {
        let wanted: Vec<(Sought, usize)> = sought
            .iter()
            .filter_map(|s| Some((s.clone(), self.index(&s.object)?)))
            .filter(|(_, i)| self.belief.objects[*i].X_TO.is_none())
            .collect();
        let requests: Vec<SceneRequest<'_>> = wanted.iter().map(|(s, i)| self.search(s, *i, &wanted)).collect();
        let views = self.with_seen(views, &wanted);
        let answers = self.perceive.locate(&views, self.belief.table_height, &requests).map_err(|e| broken("perception", e))?;
        let models: Vec<Arc<ObjectModel>> = self.things.iter().map(|t| t.model.clone()).collect();
        let known: Vec<usize> = wanted.iter().zip(&answers).filter(|(_, a)| a.is_ok()).map(|((_, i), _)| *i).collect();
        let mut found = Vec::new();
        for ((s, i), answer) in wanted.into_iter().zip(answers) {
            if let Ok(located) = &answer {
                belief::move_object(&mut self.belief, &models, i, located.X_WO, located.q.clone(), &known);
                let object = &mut self.belief.objects[i];
                object.covariance = located.covariance;
                object.seen = true;
                self.things[i].declared = None;
                self.things[i].released = false;
            }
            let why = answer.as_ref().err().map(ToString::to_string);
            self.progress.event(self.seed, &Event::Located { object: &s.object, error: why.as_deref() });
            found.push((s, answer));
        }
        Ok(found)
    }

    /// The views, with the objects that were seen and are not sought: what they explain is nothing else.
    fn with_seen(&self, views: &[View], wanted: &[(Sought, usize)]) -> Vec<View> {
        let sought = |i: usize| wanted.iter().any(|(_, w)| *w == i);
        let seen = self.belief.objects.iter().zip(&self.things).enumerate();
        let seen: Vec<_> = seen.filter(|(i, (o, t))| o.seen && o.X_TO.is_none() && !t.released && !sought(*i)).collect();
        let add = |view: &View| seen.iter().fold(view.clone(), |v, (_, (o, t))| v.with_known(&t.model, &o.X_WO, &o.q));
        views.iter().map(add).collect()
    }

    fn search<'a>(&'a self, sought: &Sought, i: usize, all: &[(Sought, usize)]) -> SceneRequest<'a> {
        let (object, thing) = (&self.belief.objects[i], &self.things[i]);
        let near = |shift, yaw| Place::Prior(Prior::Near { X_WO: object.X_WO, shift, yaw });
        let place = match &thing.declared {
            Some(Placement::World(_)) => near(DECLARED_SHIFT, DECLARED_YAW),
            Some(Placement::Inside { object: container, region }) => {
                let same_images = all.iter().any(|(s, j)| s.object == *container && !self.belief.objects[*j].seen);
                if same_images {
                    Place::Inside { object: container.clone(), region: region.clone() }
                } else {
                    self.region_prior(container, region.as_deref()).unwrap_or_else(|| near(DECLARED_SHIFT, std::f64::consts::PI))
                }
            }
            None if thing.released => near(KNOWN_SHIFT, RELEASED_YAW),
            None if thing.model.document.movable => near(KNOWN_SHIFT, KNOWN_YAW),
            None => near(0.0, 0.0),
        };
        let freedom = if thing.declared.is_none() && !thing.model.document.movable { Freedom::Held } else { Freedom::Standing };
        let joints = sought.joint.and_then(|slot| self.joint_search(i, slot)).into_iter().collect();
        SceneRequest { name: object.name.clone(), model: &thing.model, place, freedom, q: object.q.clone(), joints }
    }

    fn joint_search(&self, i: usize, slot: usize) -> Option<JointSearch> {
        let model = &self.things[i].model;
        let limits = model.joints[model.moving_joints().nth(slot)?].limits;
        let full = std::f64::consts::PI;
        // Measured positions may lie a little beyond the stop.
        let beyond = if limits.range().is_finite() { 0.02 * limits.range() } else { 0.0 };
        Some(JointSearch { slot, lower: (limits.lower - beyond).max(-full), upper: (limits.upper + beyond).min(full) })
    }

    fn region_prior(&self, container: &str, region: Option<&str>) -> Option<Place> {
        let c = self.index(container)?;
        let (holder, model) = (&self.belief.objects[c], &self.things[c].model);
        let (region, link) = geometry::region(model, region)?;
        let X_WG = geometry::X_WG(model, &holder.X_WO, &holder.q, region, link);
        Some(Place::Prior(Prior::Region { X_WG, size: region.size }))
    }

    /// Configurations of the robot from which it looks.
    fn look_configurations(&self) -> Vec<Vec<f64>> {
        let facts = self.scene.robot.document.robot.as_ref();
        facts.map(|f| f.configurations.iter().filter(|c| c.name.starts_with("look")).map(|c| c.q.clone()).collect()).unwrap_or_default()
    }

    /// Looks from all configurations, then for all objects at once: they explain each other's points.
    pub fn look_around(&mut self, sought: &[Sought]) -> Result<(), Stop> {
        let names: Vec<String> = sought.iter().map(|s| s.object.clone()).collect();
        self.progress.event(self.seed, &Event::Looking { objects: &names });
        let views = self.views_around()?;
        self.locate(&views, sought)?;
        Ok(())
    }

    /// Images from all configurations from which the robot looks.
    pub fn views_around(&mut self) -> Result<Vec<View>, Stop> {
        let mut views = Vec::new();
        for q in self.look_configurations() {
            if self.move_to(&[q])?.is_ok() {
                views.push(self.view()?);
            }
        }
        if views.is_empty() {
            views.push(self.view()?);
        }
        Ok(views)
    }

    /// Looks from here, then from the robot's configurations, then from where a view of what is left is to be had, until
    /// everything is found or nothing is left to try. Answers what was not found, and why.
    pub fn look_for(&mut self, sought: &[Sought]) -> Result<Vec<(Sought, PerceptionError)>, Stop> {
        let names: Vec<String> = sought.iter().map(|s| s.object.clone()).collect();
        self.progress.event(self.seed, &Event::Looking { objects: &names });
        let mut views = vec![self.view()?];
        let mut left = self.missing(&views, sought)?;
        for q in self.look_configurations() {
            if left.is_empty() {
                return Ok(left);
            }
            if self.move_to(&[q])?.is_ok() {
                views.push(self.view()?);
                left = self.missing(&views, &left.iter().map(|(s, _)| s.clone()).collect::<Vec<_>>())?;
            }
        }
        for name in names {
            if !left.iter().any(|(s, _)| s.object == name) {
                continue;
            }
            for q in self.aimed(&name) {
                if self.move_to(&[q])?.is_ok() {
                    views.push(self.view()?);
                    left = self.missing(&views, &left.iter().map(|(s, _)| s.clone()).collect::<Vec<_>>())?;
                    if !left.iter().any(|(s, _)| s.object == name) {
                        break;
                    }
                }
            }
        }
        Ok(left)
    }

    fn missing(&mut self, views: &[View], sought: &[Sought]) -> Result<Vec<(Sought, PerceptionError)>, Stop> {
        Ok(self.locate(views, sought)?.into_iter().filter_map(|(s, answer)| answer.err().map(|e| (s, e))).collect())
    }

    /// Configurations from which the place of an object should be seen, the best few.
    fn aimed(&self, object: &str) -> Vec<Vec<f64>> {
        let Some(i) = self.index(object) else { return Vec::new() };
        let o = &self.belief.objects[i];
        let (least, most) = geometry::bounds(&self.things[i].model, &o.X_WO, &o.q);
        let target = nalgebra::center(&least, &most);
        // If it is in a region, look through the region's opening.
        let opening = self.region_around(i, &target).map(|(c, region, link)| {
            let (holder, model) = (&self.belief.objects[c], &self.things[c].model);
            holder.X_WO.rotation * model.X_OL(&holder.q)[link].rotation * nalgebra::Vector3::from(region.opening)
        });
        self.aimed_at(&target, opening.as_ref())
    }

    /// Configurations from which a place should be seen, through an opening if there is one.
    pub fn aimed_at(&self, target: &Point3<f64>, opening: Option<&nalgebra::Vector3<f64>>) -> Vec<Vec<f64>> {
        let Ok(world) = self.planning_scene().and_then(|scene| CollisionWorld::new(&scene)) else { return Vec::new() };
        let (q, width) = (&self.observation.q, self.observation.gripper_width);
        aim::configurations(&world, &self.scene.robot, target, opening, q, width, self.seed)
    }

    /// The region of another object in which a point lies.
    fn region_around(&self, i: usize, point: &Point3<f64>) -> Option<(usize, &sagci_model::Region, usize)> {
        (0..self.things.len()).filter(|c| *c != i).find_map(|c| {
            let (holder, model) = (&self.belief.objects[c], &self.things[c].model);
            model.document.regions.iter().find_map(|region| {
                let link = model.link(&region.link)?;
                let X_WG = geometry::X_WG(model, &holder.X_WO, &holder.q, region, link);
                (geometry::outside(region, &X_WG, point) <= RIDES).then_some((c, region, link))
            })
        })
    }

    /// Believes what a skill says has changed, and what follows from it.
    pub fn apply(&mut self, changes: &[BeliefChange]) -> Result<(), Stop> {
        let models: Vec<Arc<ObjectModel>> = self.things.iter().map(|t| t.model.clone()).collect();
        for change in changes {
            belief::apply(&mut self.belief, &models, change);
            if let BeliefChange::Held { object, .. } | BeliefChange::Released { object, .. } = change
                && let Some(i) = self.index(object)
            {
                self.things[i].declared = None;
                self.things[i].home = None;
                self.things[i].released = matches!(change, BeliefChange::Released { .. });
            }
        }
        for (thing, object) in self.things.iter_mut().zip(&self.belief.objects) {
            if thing.home.is_some() && !object.seen {
                thing.declared = thing.home.clone();
            }
        }
        self.carry_held()
    }

    /// Objects in the gripper are where the arm is.
    pub fn carry_held(&mut self) -> Result<(), Stop> {
        let X_WT = geometry::X_WT(&self.scene.robot, &self.belief.X_WR, &self.observation.q);
        let mut held = None;
        for (object, thing) in self.belief.objects.iter_mut().zip(&self.things) {
            if let (Some(X_TO), Some(X_WT)) = (object.X_TO, X_WT) {
                object.X_WO = X_WT * X_TO;
                held = Some((thing.model.clone(), X_TO, object.q.clone()));
            }
        }
        self.arm.carry(held.as_ref().map(|(m, X, q)| (&**m, X, q.as_slice()))).map_err(|e| broken("the arm's control", e))
    }

    /// An object by its name.
    pub fn object(&self, name: &str) -> Option<(&ObjectBelief, &Arc<ObjectModel>)> {
        let i = self.index(name)?;
        Some((&self.belief.objects[i], &self.things[i].model))
    }
}
