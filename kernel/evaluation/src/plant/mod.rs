//! Mechanisms that move by engines other than the simulator that is judged by them.
//!
//! Two, that share the effects' formulas and nothing else: rapier's multibody with small fixed steps, and a Runge-Kutta
//! integrator of the joints' own equations that finds the instants at which dry friction takes hold.

mod rapier;
mod rigid;
mod runge_kutta;

pub(crate) use rapier::Rapier;
pub(crate) use rigid::Rigid;
pub(crate) use runge_kutta::RungeKutta;

use sagci_model::{EffectEntry, Inertial, Joint, JointKind, JointLimits, Link, ObjectModel};

use crate::EvaluationError;
use crate::effect::{Hold, JointPhysics, Term};

/// A mechanism as it truly is: rigid bodies, and what acts at each joint that moves, in the model's order.
#[derive(Debug, Clone)]
pub(crate) struct Mechanism {
    pub model: ObjectModel,
    pub joints: Vec<JointPhysics>,
    /// 1 where the base is an extra joint before all others, else 0.
    pub base: usize,
}

impl Mechanism {
    /// The true bodies of `model` with its damping and friction, and the effects.
    ///
    /// # Errors
    /// An effect without a joint that needs one, or without a parameter.
    pub(crate) fn new(model: &ObjectModel, effects: &[EffectEntry]) -> Result<Self, EvaluationError> {
        let wrong = |entry: &EffectEntry, message: &str| EvaluationError::Effect { effect: entry.effect.clone(), message: message.into() };
        let mut model = model.clone();
        let mut base = None;
        for entry in effects {
            match entry.effect.as_str() {
                "payload" => add_payload(&mut model, entry).ok_or_else(|| wrong(entry, "names no joint"))?,
                "joint_axis_error" => move_axis(&mut model, entry).ok_or_else(|| wrong(entry, "names no joint"))?,
                "unmodelled_mode" => base = Some(entry),
                _ => {}
            }
        }
        let mut at = 0;
        if let Some(entry) = base {
            add_base(&mut model, entry);
            at = 1;
        }
        let moving: Vec<usize> = model.moving_joints().collect();
        let rigid = Rigid::new(&model)?;
        let (mass, _) = rigid.at(&vec![0.0; moving.len()], &vec![0.0; moving.len()]);
        let mut joints: Vec<JointPhysics> =
            moving.iter().map(|&j| JointPhysics::new(model.joints[j].damping, model.joints[j].friction)).collect();
        for entry in effects {
            match entry.effect.as_str() {
                "payload" | "joint_axis_error" => {}
                "unmodelled_mode" => {
                    let p = |name: &str| entry.parameters.get(name).copied().unwrap_or(0.0);
                    let pace = std::f64::consts::TAU * p("frequency");
                    joints[0].terms.push(Term::Spring { stiffness: p("mass") * pace * pace, rest: 0.0 });
                    joints[0].damping = 2.0 * p("damping_ratio") * pace * p("mass");
                }
                _ => {
                    let name = entry.joint.as_deref().unwrap_or_default();
                    let slot = moving.iter().position(|&j| model.joints[j].name == name);
                    let slot = slot.ok_or_else(|| wrong(entry, "names no joint that moves"))?;
                    joints[slot].add(entry, mass[(slot, slot)])?;
                }
            }
        }
        Ok(Self { model, joints, base: at })
    }
}

/// Mass, centre and inertia of a link with a point mass more.
fn add_payload(model: &mut ObjectModel, entry: &EffectEntry) -> Option<()> {
    let p = |name: &str| entry.parameters.get(name).copied().unwrap_or(0.0);
    let child = model.joints[model.joint(entry.joint.as_deref()?)?].child;
    let body = &mut model.links[child].inertial;
    let (m, at) = (p("mass"), nalgebra::Point3::new(p("x"), p("y"), p("z")));
    let total = body.mass + m;
    let center = nalgebra::Point3::from((body.p_LoLcm.coords * body.mass + at.coords * m) / total);
    let about = |mass: f64, d: nalgebra::Vector3<f64>| mass * (d.norm_squared() * nalgebra::Matrix3::identity() - d * d.transpose());
    body.I_LLcm_L += about(body.mass, body.p_LoLcm - center) + about(m, at - center);
    (body.mass, body.p_LoLcm) = (total, center);
    Some(())
}

/// The joint's axis turned and its origin moved, both in the joint's frame; the link's own frame keeps its place on the joint.
fn move_axis(model: &mut ObjectModel, entry: &EffectEntry) -> Option<()> {
    let p = |name: &str| entry.parameters.get(name).copied().unwrap_or(0.0);
    let at = model.joint(entry.joint.as_deref()?)?;
    let about = nalgebra::Vector3::new(p("rx"), p("ry"), p("rz"));
    let turn = about
        .try_normalize(1e-12)
        .map_or_else(nalgebra::UnitQuaternion::identity, |n| nalgebra::UnitQuaternion::from_scaled_axis(n * p("angle")));
    let joint = &mut model.joints[at];
    joint.axis = nalgebra::Unit::new_normalize(turn * joint.axis.into_inner());
    joint.X_PJ *= nalgebra::Translation3::new(p("x"), p("y"), p("z"));
    Some(())
}

/// A mass on a slide before the root.
fn add_base(model: &mut ObjectModel, entry: &EffectEntry) {
    let mass = entry.parameters.get("mass").copied().unwrap_or(1.0);
    let axis = match entry.choices.get("direction").map(String::as_str) {
        Some("y") => nalgebra::Vector3::y_axis(),
        Some("z") => nalgebra::Vector3::z_axis(),
        _ => nalgebra::Vector3::x_axis(),
    };
    for joint in &mut model.joints {
        joint.parent += 1;
        joint.child += 1;
        if let Some(mimic) = &mut joint.mimic {
            mimic.joint += 1;
        }
    }
    let massless = Inertial { mass: 0.0, p_LoLcm: nalgebra::Point3::origin(), I_LLcm_L: nalgebra::Matrix3::zeros() };
    model.links[0].inertial =
        Inertial { mass, p_LoLcm: nalgebra::Point3::origin(), I_LLcm_L: nalgebra::Matrix3::identity() * (0.01 * mass) };
    model.links.insert(0, Link { name: "ground".into(), inertial: massless, visuals: Vec::new(), collisions: Vec::new() });
    let limits = JointLimits::NONE;
    model.joints.insert(
        0,
        Joint {
            name: "base_sway".into(),
            kind: JointKind::Prismatic,
            parent: 0,
            child: 1,
            X_PJ: nalgebra::Isometry3::identity(),
            axis,
            limits,
            damping: 0.0,
            friction: 0.0,
            mimic: None,
        },
    );
}

/// A mechanism in motion.
pub(crate) trait Plant: Send {
    /// Puts the joints in place at a time; inner states as after a long rest there.
    fn reset(&mut self, t: f64, q: &[f64], v: &[f64]);

    /// Moves until a time under constant inputs, one for each joint.
    ///
    /// # Errors
    /// The motion is no longer a number.
    fn advance(&mut self, until: f64, hold: &[Hold]) -> Result<(), EvaluationError>;

    /// Positions.
    fn q(&self) -> &[f64];

    /// Velocities.
    fn v(&self) -> &[f64];

    /// Position and velocity of one joint as its encoder sees them, without noise.
    fn reading(&self, joint: usize) -> (f64, f64);

    /// What the drive of a joint gives, under an input.
    fn delivered(&self, joint: usize, hold: Hold) -> f64;

    /// What acts, and on which bodies.
    fn mechanism(&self) -> &Mechanism;
}
