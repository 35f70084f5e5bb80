//! Mechanisms: what the model says, and what is true within the model's tolerance.

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};
use sagci_model::{Actuator, ActuatorLaw, Document, Inertial, Joint, JointKind, JointLimits, Link, ObjectModel};

use crate::random::Random;

/// A kind of mechanism.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Kind {
    /// A microwave's door on an upright hinge.
    Door,
    /// A drawer on level slides.
    Drawer,
    /// An oven's door on a level hinge: shut upright, open flat.
    OvenDoor,
    /// A rod that hangs from a level hinge.
    Pendulum,
    /// A short arm on a servo with a level shaft.
    ServoLink,
    /// Two links in an upright plane.
    PlanarArm,
    /// A robot's arm, given from outside.
    Arm,
}

impl Kind {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Door => "door",
            Self::Drawer => "tray",
            Self::OvenDoor => "oven_door",
            Self::Pendulum => "pendulum",
            Self::ServoLink => "servo_link",
            Self::PlanarArm => "planar_arm",
            Self::Arm => "arm",
        }
    }

    /// Does gravity act along its joints?
    pub(crate) fn feels_gravity(self) -> bool {
        !matches!(self, Self::Door | Self::Drawer)
    }
}

/// What moves a joint, and what of that is in the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Driving {
    /// A hand or a robot, whose effort is measured.
    Hand,
    /// A motor that is commanded an effort.
    Torque,
    /// A servo that is commanded a position.
    Servo { stiffness: f64, damping: f64 },
}

/// A mechanism, its model, and where it is moved.
#[derive(Debug, Clone)]
pub(crate) struct Stage {
    /// What the workflow is given.
    pub known: ObjectModel,
    /// The true bodies, damping and friction.
    pub body: ObjectModel,
    pub driving: Driving,
    /// Where each moving joint is moved to and fro.
    pub range: Vec<[f64; 2]>,
}

/// What a stage has to offer for an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Losses {
    /// May the model know of damping?
    pub damping: Option<bool>,
    /// May the model know of dry friction?
    pub friction: Option<bool>,
}

fn box_inertia(mass: f64, size: [f64; 3]) -> Matrix3<f64> {
    let [x, y, z] = size.map(|s| s * s);
    Matrix3::from_diagonal(&(Vector3::new(y + z, x + z, x + y) * (mass / 12.0)))
}

fn link(name: &str, mass: f64, center: [f64; 3], size: [f64; 3]) -> Link {
    Link {
        name: name.into(),
        inertial: Inertial { mass, p_LoLcm: Point3::from(center), I_LLcm_L: box_inertia(mass, size) },
        visuals: Vec::new(),
        collisions: Vec::new(),
    }
}

fn joint(name: &str, kind: JointKind, parent: usize, X_PJ: Isometry3<f64>, axis: Vector3<f64>, range: [f64; 2], margin: f64) -> Joint {
    Joint {
        name: name.into(),
        kind,
        parent,
        child: parent + 1,
        X_PJ,
        axis: Unit::new_normalize(axis),
        limits: JointLimits { lower: range[0] - margin, upper: range[1] + margin, velocity: 100.0, effort: 1000.0 },
        damping: 0.0,
        friction: 0.0,
        mimic: None,
    }
}

fn model(name: &str, links: Vec<Link>, joints: Vec<Joint>) -> ObjectModel {
    let document = Document { name: name.into(), ..Document::default() };
    ObjectModel { name: name.into(), folder: std::path::PathBuf::new(), links, joints, document }
}

/// Numbers are rounded as a person would write them into a URDF: the model is what its file says.
fn round(x: f64) -> f64 {
    if x == 0.0 {
        return 0.0;
    }
    let unit = 10f64.powf(x.abs().log10().floor() - 3.0);
    (x / unit).round() * unit
}

impl Stage {
    /// Draws a mechanism. `arm` is needed for [`Kind::Arm`] only.
    pub(crate) fn draw(kind: Kind, losses: Losses, servo: bool, arm: Option<&ObjectModel>, rng: &mut Random) -> Option<Self> {
        let at = |x: f64, y: f64, z: f64| Isometry3::translation(x, y, z);
        let base = || link("base", 0.0, [0.0; 3], [0.1; 3]);
        let mut driving = Driving::Hand;
        let (mut known, range) = match kind {
            Kind::Door => {
                let (m, w, h) = (rng.scale(0.4, 6.0), rng.between(0.3, 0.6), rng.between(0.25, 0.7));
                let range = [0.0, rng.between(1.3, 2.0)];
                let (m, w, h) = (round(m), round(w), round(h));
                let part = link("door", m, [round(w * 0.52), -0.03, 0.0], [w, 0.05, h]);
                let hinge = joint("door_hinge", JointKind::Revolute, 0, at(-0.3, -0.2, 0.2), -Vector3::z(), range, 0.3);
                (model("door", vec![base(), part], vec![hinge]), vec![range])
            }
            Kind::Drawer => {
                let (m, range) = (round(rng.scale(0.8, 8.0)), [0.0, rng.between(0.25, 0.5)]);
                let part = link("tray", m, [0.0, -0.15, 0.05], [0.4, 0.4, 0.15]);
                let slide = joint("drawer_slide", JointKind::Prismatic, 0, at(0.0, -0.01, 0.09), -Vector3::y(), range, 0.1);
                (model("tray", vec![base(), part], vec![slide]), vec![range])
            }
            Kind::OvenDoor => {
                let (m, h) = (round(rng.between(1.5, 6.0)), round(rng.between(0.3, 0.5)));
                let range = [0.0, rng.between(1.2, 1.5)];
                let part = link("oven_door", m, [0.0, -0.02, round(0.5 * h)], [0.5, 0.04, h]);
                let hinge = joint("oven_hinge", JointKind::Revolute, 0, at(0.0, -0.25, 0.3), Vector3::x(), range, 0.3);
                (model("oven", vec![base(), part], vec![hinge]), vec![range])
            }
            Kind::Pendulum => {
                let (m, l) = (round(rng.scale(0.3, 2.5)), round(rng.between(0.2, 0.6)));
                let reach = rng.between(1.6, 2.4);
                let part = link("rod", m, [0.0, 0.0, round(-0.55 * l)], [0.03, 0.03, l]);
                let hinge = joint("pivot", JointKind::Revolute, 0, at(0.0, 0.0, 1.0), Vector3::y(), [-reach, reach], 0.8);
                driving = if rng.chance(0.5) { Driving::Hand } else { Driving::Torque };
                (model("pendulum", vec![base(), part], vec![hinge]), vec![[-reach, reach]])
            }
            Kind::ServoLink => {
                let (m, l) = (round(rng.scale(0.1, 0.8)), round(rng.between(0.1, 0.3)));
                let reach = rng.between(1.0, 1.7);
                let part = link("arm", m, [round(0.6 * l), 0.0, 0.0], [l, 0.03, 0.03]);
                let hinge = joint("shaft", JointKind::Revolute, 0, at(0.0, 0.0, 0.3), -Vector3::y(), [-reach, reach], 0.8);
                driving = Driving::Torque;
                (model("servo_link", vec![base(), part], vec![hinge]), vec![[-reach, reach]])
            }
            Kind::PlanarArm => {
                let (m, l) = (
                    [round(rng.scale(0.5, 3.0)), round(rng.scale(0.3, 1.5))],
                    [round(rng.between(0.2, 0.4)), round(rng.between(0.2, 0.35))],
                );
                let reach = [rng.between(0.8, 1.3), rng.between(0.9, 1.5)];
                let upper = link("upper", m[0], [0.0, 0.0, round(-0.5 * l[0])], [0.05, 0.05, l[0]]);
                let lower = link("lower", m[1], [0.0, 0.0, round(-0.45 * l[1])], [0.04, 0.04, l[1]]);
                let shoulder = joint("shoulder", JointKind::Revolute, 0, at(0.0, 0.0, 1.0), Vector3::y(), [-reach[0], reach[0]], 0.8);
                let elbow = joint("elbow", JointKind::Revolute, 1, at(0.0, 0.04, -l[0]), Vector3::y(), [-reach[1], reach[1]], 0.8);
                driving = Driving::Torque;
                let range = vec![[-reach[0], reach[0]], [-reach[1], reach[1]]];
                (model("planar_arm", vec![base(), upper, lower], vec![shoulder, elbow]), range)
            }
            Kind::Arm => {
                driving = Driving::Torque;
                fixed_hand(arm?)
            }
        };

        // Losses that the model knows of.
        let mass = crate::plant::Rigid::new(&known).ok()?.at(&vec![0.0; range.len()], &vec![0.0; range.len()]).0;
        let (damped, rubbed) = (losses.damping.unwrap_or(rng.chance(0.4)), losses.friction.unwrap_or(rng.chance(0.4)));
        if kind != Kind::Arm {
            for (slot, j) in known.moving_joints().collect::<Vec<_>>().into_iter().enumerate() {
                let m = mass[(slot, slot)];
                if damped {
                    known.joints[j].damping = round(m * rng.scale(0.15, 1.2));
                }
                if rubbed {
                    known.joints[j].friction = round(m * rng.scale(0.3, 2.5));
                }
            }
        }
        if driving == Driving::Torque && servo && kind == Kind::ServoLink {
            let (m, pace) = (mass[(0, 0)], rng.between(15.0, 40.0));
            let law = Driving::Servo { stiffness: round(m * pace * pace), damping: round(m * pace * rng.between(0.6, 1.6)) };
            driving = law;
        }
        known.document.actuators = known
            .moving_joints()
            .filter_map(|j| {
                let law = match driving {
                    Driving::Hand => return None,
                    Driving::Torque => ActuatorLaw::Torque { max_effort: f64::INFINITY },
                    Driving::Servo { stiffness, damping } => ActuatorLaw::PositionServo { stiffness, damping, max_effort: f64::INFINITY },
                };
                Some(Actuator { joint: known.joints[j].name.clone(), law, refit: Default::default() })
            })
            .collect();

        // What is true: within the tolerance of the masses, and of what is known of the losses.
        let mut body = known.clone();
        for link in body.links.iter_mut().filter(|l| l.inertial.mass > 0.0) {
            let i = &mut link.inertial;
            let factor = 1.0 + rng.between(-0.018, 0.018);
            i.mass *= factor;
            i.I_LLcm_L *= factor * (1.0 + rng.between(-0.002, 0.002));
            // Small parts have small errors.
            let size = (i.I_LLcm_L.trace() / i.mass.max(1e-9)).sqrt();
            let shift = (0.02 * size).min(0.003);
            i.p_LoLcm += Vector3::new(rng.between(-shift, shift), rng.between(-shift, shift), rng.between(-shift, shift));
        }
        for j in &mut body.joints {
            j.damping *= 1.0 + rng.between(-0.15, 0.15);
            j.friction *= 1.0 + rng.between(-0.15, 0.15);
        }
        Some(Self { known, body, driving, range })
    }
}

/// An arm whose hand is one solid: what moves beyond its first seven joints is welded.
fn fixed_hand(arm: &ObjectModel) -> (ObjectModel, Vec<[f64; 2]>) {
    let mut known = arm.clone();
    let driven: Vec<String> = known.document.robot.as_ref().map(|r| r.arm_joints.clone()).unwrap_or_default();
    let ready: Vec<f64> = known.document.robot.as_ref().and_then(|r| r.configurations.first()).map(|c| c.q.clone()).unwrap_or_default();
    for joint in &mut known.joints {
        if !driven.contains(&joint.name) && !driven.is_empty() {
            joint.kind = JointKind::Fixed;
            joint.mimic = None;
        }
    }
    for link in &mut known.links {
        link.visuals.clear();
        link.collisions.clear();
    }
    // Without a gripper there is nothing that a robot's section could describe.
    known.document = Document { name: known.document.name.clone(), ..Document::default() };
    known.folder = std::path::PathBuf::new();
    let range = known
        .moving_joints()
        .enumerate()
        .map(|(slot, j)| {
            let limits = known.joints[j].limits;
            let center = ready.get(slot).copied().unwrap_or(0.0).clamp(limits.lower + 0.5, (limits.upper - 0.5).max(limits.lower + 0.5));
            [center - 0.42, center + 0.42]
        })
        .collect();
    (known, range)
}
