//! The measured world in rapier: torque-driven arm, friction contact, passive articulated objects.
//!
//! Settings: steps of 1 ms with 4 iterations; contact springs at 200 Hz, critically damped; no recycling of contacts, a
//! short prediction distance. With rapier's defaults a loaded contact sinks by 7 mm and creeps; with these it sinks by
//! 0.2 mm under 30 N, does not creep, and slips at the Coulomb threshold.

mod build;
mod effects;
mod gripper;
mod history;
mod place;
mod wrench;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, Vector3};
use rapier3d_f64::dynamics::{IntegrationParameters, SpringCoefficients};
use rapier3d_f64::pipeline::PhysicsWorld;
use sagci_model::{EffectEntry, ObjectModel, Robot};
use sagci_signal::{Command, DepthImage, Observation, Wrench};

pub(crate) use self::build::TABLE_HALF_EXTENTS;
use self::build::{MovingJoint, Plan, Role, Thing};
use self::effects::JointEffects;
use self::gripper::GripperServo;
use self::history::History;
use crate::camera::Camera;
use crate::geometry::{Solid, solids};
use crate::hidden;
use crate::judge::{Goal, NamedEffect, Verdict};
use crate::perturbation::Drawn;
use crate::random::{Purpose, Random};
use crate::sensors::{Perfect, Sensors};
use crate::truth::{TrueFrame, TrueState};
use crate::{Scene, SceneObject, World, WorldError, WorldOptions, convert};

/// Length of a step, which is the control period, s.
const PERIOD: f64 = 0.001;
/// Standard gravity where the robots stand, m/s^2.
const GRAVITY: f64 = 9.81;
/// Nothing in a tabletop scene is faster than this, m/s or rad/s: beyond it the physics has broken down.
const FASTEST: f64 = 200.0;

/// The measured world, simulated by rapier.
pub struct RapierWorld {
    options: WorldOptions,
    state: Option<State>,
}

/// What exists from a reset on.
struct State {
    scene: Scene,
    physics: PhysicsWorld,
    /// The robot first, then the objects in the scene's order.
    things: Vec<Thing>,
    /// Collision shapes of each thing.
    solids: Vec<Vec<Solid>>,
    arm: Vec<ArmJoint>,
    /// Joint indices of the two fingers.
    fingers: [usize; 2],
    /// Links at and beyond the wrist sensor.
    hand: Vec<bool>,
    wrist: usize,
    servo: GripperServo,
    sensors: Sensors,
    camera: Camera,
    history: History,
    time: u64,
    observation: Observation,
    /// What each object has that its model lacks, and what was said that it is.
    hidden: Vec<Option<EffectEntry>>,
    answers: Vec<Vec<NamedEffect>>,
    /// The physics broke down: nothing more can be asked.
    broken: Option<String>,
}

#[derive(Clone, Copy)]
struct ArmJoint {
    joint: usize,
    effort: f64,
}

impl RapierWorld {
    /// An empty world; [`World::reset`] fills it.
    pub fn new(options: WorldOptions) -> Self {
        Self { options, state: None }
    }
}

impl World for RapierWorld {
    fn period(&self) -> f64 {
        PERIOD
    }

    fn reset(&mut self, scene: &Scene, seed: u64) -> Result<(), WorldError> {
        self.state = None;
        self.state = Some(State::new(scene, seed, &self.options)?);
        Ok(())
    }

    fn observe(&self) -> Observation {
        self.state.as_ref().map(|s| s.observation.clone()).unwrap_or_default()
    }

    fn look(&mut self) -> Result<DepthImage, WorldError> {
        self.state.as_mut().ok_or_else(not_reset)?.look()
    }

    fn advance(&mut self, command: &Command) -> Result<(), WorldError> {
        self.state.as_mut().ok_or_else(not_reset)?.advance(command)
    }

    fn answer(&mut self, object: &str, named: &[NamedEffect]) {
        let Some(state) = &mut self.state else { return };
        if let Some(i) = state.scene.objects.iter().position(|o| o.name == object) {
            let answers = &mut state.answers[i];
            answers.retain(|a| !named.iter().any(|n| n.joint == a.joint));
            answers.extend_from_slice(named);
        }
    }

    fn judge(self: Box<Self>, goals: &[Goal]) -> Option<Verdict> {
        self.state.map(|state| state.judge(goals))
    }
}

impl TrueState for RapierWorld {
    fn true_frame(&self) -> TrueFrame {
        self.state.as_ref().map_or_else(|| TrueFrame { time: 0.0, frames: Vec::new(), joints: Vec::new() }, State::true_frame)
    }
}

fn not_reset() -> WorldError {
    WorldError::Scene { place: "world".into(), message: "is empty; reset it with a scene first".into() }
}

fn parameters() -> IntegrationParameters {
    let stiff = SpringCoefficients::new(200.0, 1.0);
    IntegrationParameters {
        dt: PERIOD,
        num_solver_iterations: 4,
        num_internal_pgs_iterations: 4,
        num_internal_stabilization_iterations: 4,
        contact_softness: stiff,
        static_contact_softness: stiff,
        contact_recycling: false,
        contact_clustering: false,
        normalized_prediction_distance: 0.002,
        friction_in_bias_pass: false,
        ..IntegrationParameters::default()
    }
}

impl State {
    fn new(scene: &Scene, seed: u64, options: &WorldOptions) -> Result<Self, WorldError> {
        let wrong = |place: &str, message: String| WorldError::Scene { place: place.to_owned(), message };
        let robot_model = &scene.robot;
        let robot = robot_model
            .document
            .robot
            .as_ref()
            .ok_or_else(|| wrong(&robot_model.name, "is not a robot: its model.yaml has no `robot` section".into()))?;
        check_names(scene)?;

        let joint_of = |name: &str| robot_model.joint(name).ok_or_else(|| wrong(&robot_model.name, format!("has no joint '{name}'")));
        let link_of = |name: &str| robot_model.link(name).ok_or_else(|| wrong(&robot_model.name, format!("has no link '{name}'")));
        let arm_joints = robot.arm_joints.iter().map(|n| joint_of(n)).collect::<Result<Vec<_>, _>>()?;
        let fingers = [joint_of(&robot.gripper.fingers[0].joint)?, joint_of(&robot.gripper.fingers[1].joint)?];
        let rubber = [link_of(&robot.gripper.fingers[0].link)?, link_of(&robot.gripper.fingers[1].link)?];
        let wrist = link_of(&robot.wrist_link)?;
        let payload_link = link_of(&robot.gripper.link)?;
        let robot_q = start(scene, robot, &arm_joints, fingers)?;

        let mut shapes = vec![solids(robot_model)?];
        for object in &scene.objects {
            shapes.push(solids(&object.model)?);
        }
        let X_WR = Isometry3::from_parts(Translation3::new(0.0, 0.0, scene.table_height), nalgebra::UnitQuaternion::identity());
        let placed = place::place(scene, seed, &options.perturbation, &shapes, &X_WR, &robot_q)?;

        let constant = &mut Random::new(seed, Purpose::Robot);
        let robot_drawn = Drawn::robot(robot_model, &arm_joints, constant, &options.perturbation);
        let camera = Camera::new(scene, robot, &options.perturbation, options.sensors.depth, constant, Random::new(seed, Purpose::Camera))?;
        let sensors = Sensors::new(options.sensors, PERIOD, arm_joints.len(), Random::new(seed, Purpose::Sensors), constant);

        let mut physics = PhysicsWorld::new();
        physics.gravity = convert::vector(&Vector3::new(0.0, 0.0, -GRAVITY));
        physics.integration_parameters = parameters();
        build::add_table(&mut physics, scene.table_height);

        let mirrored: Vec<(usize, usize)> = match fingers.map(|f| robot_model.joints[f].mimic.is_some()) {
            [false, false] => vec![(fingers[0], fingers[1])],
            _ => Vec::new(),
        };
        let mut things = vec![build::add(
            &mut physics,
            &Plan {
                name: &robot_model.name,
                model: robot_model,
                solids: &shapes[0],
                drawn: &robot_drawn,
                role: Role::Robot,
                index: 0,
                X_WO: X_WR,
                q: &robot_q,
                rubber: &rubber,
                payload_link,
                mirrored: &mirrored,
                hidden: None,
                armature: &|joint| if fingers.contains(&joint) { gripper::ARMATURE } else { 0.0 },
            },
        )?];
        let mut hidden = Vec::with_capacity(scene.objects.len());
        for (i, object) in scene.objects.iter().enumerate() {
            let drawn = Drawn::object(&object.model, i, seed, &options.perturbation);
            let lacking = object.hidden_effect.as_ref().map(|joint| hide(object, joint, &drawn, i, seed)).transpose()?;
            things.push(build::add(
                &mut physics,
                &Plan {
                    name: &object.name,
                    model: &object.model,
                    solids: &shapes[i + 1],
                    drawn: &drawn,
                    role: if object.model.document.movable { Role::Movable } else { Role::Fixed },
                    index: i as u32 + 1,
                    X_WO: placed[i],
                    q: &object.q,
                    rubber: &[],
                    payload_link: 0,
                    mirrored: &[],
                    armature: &|_| 0.0,
                    hidden: lacking.as_ref(),
                },
            )?);
            hidden.push(lacking);
        }

        let mut hand = vec![false; robot_model.links.len()];
        hand[wrist] = true;
        for joint in &robot_model.joints {
            hand[joint.child] |= hand[joint.parent];
        }
        let arm = arm_joints.iter().map(|&joint| ArmJoint { joint, effort: robot_model.joints[joint].limits.effort }).collect();
        let opening = build::joint_positions(robot_model, &robot_q)[fingers[0]];
        let mut state = Self {
            scene: scene.clone(),
            physics,
            things,
            solids: shapes,
            arm,
            fingers,
            hand,
            wrist,
            servo: GripperServo::new(opening),
            sensors,
            camera,
            history: History::default(),
            time: 0,
            observation: Observation::default(),
            answers: vec![Vec::new(); hidden.len()],
            hidden,
            broken: None,
        };
        state.history = History::new(&state);
        state.sense(&vec![0.0; state.arm.len()], 0.0);
        Ok(state)
    }

    fn seconds(&self) -> f64 {
        self.time as f64 * PERIOD
    }

    fn model(&self, thing: usize) -> &Arc<ObjectModel> {
        if thing == 0 { &self.scene.robot } else { &self.scene.objects[thing - 1].model }
    }

    /// True position and velocity of a joint; zero where it does not move.
    fn joint_state(&self, thing: usize, joint: usize) -> (f64, f64) {
        self.things[thing].joints[joint].as_ref().map_or((0.0, 0.0), |j| read_joint(&self.physics, j))
    }

    /// True pose of a link in the world.
    fn X_WL(&self, thing: usize, link: usize) -> Isometry3<f64> {
        let (body, X_BL) = self.things[thing].link_body[link];
        let X_WB =
            self.physics.bodies.get(self.things[thing].bodies[body]).map_or_else(Isometry3::identity, |b| convert::isometry(b.position()));
        X_WB * X_BL
    }

    fn advance(&mut self, command: &Command) -> Result<(), WorldError> {
        let time = self.seconds();
        if let Some(message) = &self.broken {
            return Err(WorldError::Physics { time, message: message.clone() });
        }
        let wrong = |message: String| WorldError::Command { time, message };
        if command.tau.len() != self.arm.len() {
            return Err(wrong(format!("has {} efforts, but the arm has {} joints", command.tau.len(), self.arm.len())));
        }
        if let Some(joint) = command.tau.iter().position(|tau| !tau.is_finite()) {
            return Err(wrong(format!("the effort of joint {joint} is not a finite number")));
        }
        if !(command.gripper.width.is_finite() && command.gripper.force.is_finite()) {
            return Err(wrong("the gripper's width and force must be finite numbers".into()));
        }

        for thing in &self.things {
            for joint in thing.joints.iter().flatten() {
                for handle in [joint.parent, joint.child] {
                    if let Some(body) = self.physics.bodies.get_mut(handle) {
                        body.reset_forces(false);
                        body.reset_torques(false);
                    }
                }
            }
        }
        self.apply_effects();
        let tau: Vec<f64> = command.tau.iter().zip(&self.arm).map(|(tau, joint)| tau.clamp(-joint.effort, joint.effort)).collect();
        for (tau, joint) in tau.iter().zip(&self.arm) {
            if let Some(moving) = &self.things[0].joints[joint.joint] {
                apply_effort(&mut self.physics, moving, *tau);
            }
        }
        let grip = self.drive_gripper(command);

        self.physics.step();
        self.time += 1;
        if let Err(message) = self.check() {
            self.broken = Some(message.clone());
            return Err(WorldError::Physics { time: self.seconds(), message });
        }
        self.note();
        self.sense(&tau, grip);
        Ok(())
    }

    /// Forces of the named effects, and dry friction that changes with the state.
    fn apply_effects(&mut self) {
        for thing in &self.things {
            for joint in thing.joints.iter().flatten() {
                let (q, v) = read_joint(&self.physics, joint);
                apply_effort(&mut self.physics, joint, joint.effects.force(q, v));
                if joint.effects.friction_varies()
                    && let Some((multibody, id)) = self.physics.multibody_joints.get_mut(joint.handle)
                    && let Some(dof) = multibody.link(id).map(|link| link.assembly_id())
                {
                    multibody.frictions_mut()[dof] = joint.effects.friction(q, v);
                }
            }
        }
    }

    /// Drives the fingers, and returns the force with which each presses inward.
    fn drive_gripper(&mut self, command: &Command) -> f64 {
        let Some(robot) = &self.scene.robot.document.robot else { return 0.0 };
        let mut wanted = command.gripper;
        wanted.width = wanted.width.clamp(0.0, robot.gripper.max_width);
        wanted.force = wanted.force.clamp(0.0, robot.gripper.max_force);
        let [a, b] = self.fingers.map(|f| self.joint_state(0, f));
        let force = self.servo.force(&wanted, (a.0 + b.0) / 2.0, (a.1 + b.1) / 2.0, PERIOD);
        for finger in self.fingers {
            if let Some(moving) = &self.things[0].joints[finger] {
                apply_effort(&mut self.physics, moving, force);
            }
        }
        -force
    }

    /// Is everything still finite and of this world?
    fn check(&self) -> Result<(), String> {
        if !self.physics.quarantine().is_empty() {
            return Err("a body's motion is no longer a finite number".into());
        }
        for thing in &self.things {
            for handle in &thing.bodies {
                let Some(body) = self.physics.bodies.get(*handle) else { continue };
                let sane = |v: Vector3<f64>, most: f64| v.iter().all(|c| c.is_finite() && c.abs() < most);
                let (p, v, w) = (body.translation(), body.linvel(), body.angvel());
                if !(sane(convert::vector3(p), 1e3) && sane(convert::vector3(v), FASTEST) && sane(convert::vector3(w), FASTEST)) {
                    return Err(format!("'{}' was thrown out of the scene; the commands or its model are not physical", thing.name));
                }
            }
        }
        Ok(())
    }

    /// Samples the sensors.
    fn sense(&mut self, tau: &[f64], grip: f64) {
        let q: Vec<f64> = self.arm.iter().map(|a| self.joint_state(0, a.joint).0).collect();
        let width: f64 = self.fingers.iter().map(|&f| self.joint_state(0, f).0).sum();
        let hand = &self.hand;
        let F_S = if self.time == 0 {
            Wrench::default()
        } else {
            wrench::on_hand(&self.physics, &self.X_WL(0, self.wrist), |owner| {
                owner.thing == 0 && hand.get(owner.link as usize).copied().unwrap_or(false)
            })
        };
        let measured = self.sensors.sample(&Perfect { q: &q, tau, width, grip, F_S });
        self.observation = Observation {
            time: self.seconds(),
            q: measured.q,
            v: measured.v,
            tau: measured.tau,
            gripper_width: measured.width,
            gripper_force: measured.grip,
            F_S: measured.F_S,
        };
    }

    fn look(&mut self) -> Result<DepthImage, WorldError> {
        let X_WL: Vec<Vec<Isometry3<f64>>> =
            (0..self.things.len()).map(|thing| (0..self.model(thing).links.len()).map(|link| self.X_WL(thing, link)).collect()).collect();
        Ok(self.camera.look(self.seconds(), &X_WL))
    }

    fn note(&mut self) {
        let mut history = std::mem::take(&mut self.history);
        history.note(self);
        self.history = history;
    }

    fn true_frame(&self) -> TrueFrame {
        let (mut frames, mut joints) = (Vec::new(), Vec::new());
        for (i, thing) in self.things.iter().enumerate() {
            let model = self.model(i);
            for (link, l) in model.links.iter().enumerate() {
                frames.push((format!("{}/{}", thing.name, l.name), self.X_WL(i, link)));
            }
            for (joint, j) in model.joints.iter().enumerate().filter(|(joint, _)| thing.joints[*joint].is_some()) {
                let (q, v) = self.joint_state(i, joint);
                joints.push((format!("{}/{}", thing.name, j.name), q, v));
            }
        }
        TrueFrame { time: self.seconds(), frames, joints }
    }
}

/// Draws an effect that a joint of an object has and its model lacks.
fn hide(object: &SceneObject, joint: &str, drawn: &Drawn, index: usize, seed: u64) -> Result<EffectEntry, WorldError> {
    let wrong = |message: String| WorldError::Scene { place: object.name.clone(), message };
    let model = &object.model;
    let joint = model
        .moving_joints()
        .find(|j| model.joints[*j].name == joint)
        .ok_or_else(|| wrong(format!("has no moving joint '{joint}' in which an effect could be hidden")))?;
    let friction = JointEffects::new(model, joint, &drawn.joints[joint]).map_err(wrong)?.friction(0.0, 0.0);
    let wrong = |message: String| WorldError::Scene { place: object.name.clone(), message };
    hidden::draw(model, joint, friction, index, seed).ok_or_else(|| wrong("its model has every effect that can be hidden in it".into()))
}

/// Names are unique, joints match, effects are known.
fn check_names(scene: &Scene) -> Result<(), WorldError> {
    let wrong = |place: &str, message: String| Err(WorldError::Scene { place: place.to_owned(), message });
    if !scene.table_height.is_finite() {
        return wrong("table", "its height is not a finite number".into());
    }
    if let Err(message) = JointEffects::check(&scene.robot) {
        return wrong(&scene.robot.name, message);
    }
    for (i, object) in scene.objects.iter().enumerate() {
        if scene.objects[..i].iter().any(|o| o.name == object.name) || object.name == scene.robot.name {
            return wrong(&object.name, "this name is used twice; give each object its own".into());
        }
        if let Err(message) = JointEffects::check(&object.model) {
            return wrong(&object.name, message);
        }
        let moving = object.model.moving_joints().count();
        if object.q.len() != moving || object.q.iter().any(|q| !q.is_finite()) {
            return wrong(&object.name, format!("needs {moving} finite joint positions at the start, got {:?}", object.q));
        }
    }
    Ok(())
}

/// Positions of all the robot's moving joints at the start: the named configuration, the gripper open.
fn start(scene: &Scene, robot: &Robot, arm: &[usize], fingers: [usize; 2]) -> Result<Vec<f64>, WorldError> {
    let wrong = |message: String| WorldError::Scene { place: scene.robot.name.clone(), message };
    let Some(configuration) = robot.configurations.iter().find(|c| c.name == scene.start) else {
        let known: Vec<&str> = robot.configurations.iter().map(|c| c.name.as_str()).collect();
        return Err(wrong(format!("has no configuration '{}'; it has [{}]", scene.start, known.join(", "))));
    };
    if configuration.q.len() != arm.len() || configuration.q.iter().any(|q| !q.is_finite()) {
        return Err(wrong(format!("its configuration '{}' needs {} finite positions", scene.start, arm.len())));
    }
    Ok(scene
        .robot
        .moving_joints()
        .map(|joint| {
            if let Some(slot) = arm.iter().position(|&a| a == joint) {
                configuration.q[slot]
            } else if fingers.contains(&joint) {
                robot.gripper.max_width / 2.0
            } else {
                0.0
            }
        })
        .collect())
}

fn read_joint(physics: &PhysicsWorld, joint: &MovingJoint) -> (f64, f64) {
    let Some((multibody, id)) = physics.multibody_joints.get(joint.handle) else { return (0.0, 0.0) };
    let Some(link) = multibody.link(id) else { return (0.0, 0.0) };
    let q = link.joint().coords()[if joint.slides { 0 } else { 3 }];
    let v = multibody.joint_velocity(link).iter().next().copied().unwrap_or(0.0);
    (q, v)
}

/// A force along a joint, as equal and opposite forces on what it joins: rapier has no generalised forces.
fn apply_effort(physics: &mut PhysicsWorld, joint: &MovingJoint, effort: f64) {
    if effort == 0.0 {
        return;
    }
    let Some(child) = physics.bodies.get_mut(joint.child) else { return };
    let X_WC = convert::isometry(child.position());
    let along = convert::vector(&(X_WC * joint.axis * effort));
    let at = convert::vector(&(X_WC * joint.origin).coords);
    if joint.slides {
        child.add_force_at_point(along, at, true);
    } else {
        child.add_torque(along, true);
    }
    let Some(parent) = physics.bodies.get_mut(joint.parent) else { return };
    if joint.slides {
        parent.add_force_at_point(-along, at, true);
    } else {
        parent.add_torque(-along, true);
    }
}
