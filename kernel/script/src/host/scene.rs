//! From what a script says is there to the scene of the world and the first belief.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use sagci_model::{JointKind, ObjectModel};
use sagci_signal::{ObjectBelief, SceneBelief};
use sagci_world::{Placement, Scene, SceneObject};

use super::geometry;
use crate::Models;
use crate::language::stage::{Declaration, DeclaredPlace, Quantity, Refusal};
use crate::language::suggest::hint_among;
use crate::language::value::{Angle, At};

/// Height of the table's top, m: the robot stands on it, at the world's origin.
const TABLE_HEIGHT: f64 = 0.0;
/// Standard deviations of a declared place: half of what [`Placement::World`] allows.
const SHIFT: f64 = 0.05;
const YAW: f64 = 0.13;
/// Standard deviations of what is not declared but follows from standing: height and tilt.
const HEIGHT: f64 = 0.003;
const TILT: f64 = 0.01;

/// Everything that a script declared, with the models read.
#[derive(Debug, Clone, Default)]
pub struct Declared {
    /// The robot's name in the library, if the script says it.
    pub robot: Option<String>,
    /// The objects, in the script's order.
    pub objects: Vec<(Declaration, Arc<ObjectModel>)>,
    /// Names of those of them of which the robot is told nothing: the world holds them, the belief does not.
    unknown: BTreeSet<String>,
    /// Joints in which the world hides an effect, by object.
    hidden: BTreeMap<String, String>,
}

fn refuse<T>(message: String, hint: impl Into<Option<String>>) -> Result<T, Refusal> {
    Err(Refusal { message, hint: hint.into() })
}

/// A model by name, with a hint if there is none.
pub fn model(models: &dyn Models, name: &str) -> Result<Arc<ObjectModel>, Refusal> {
    let names = models.names();
    if !names.iter().any(|n| n == name) {
        let hint = hint_among(name, "models", names.iter().map(String::as_str));
        return refuse(format!("the library has no model '{name}'"), hint);
    }
    models.model(name).or_else(|message| refuse(format!("the model '{name}' cannot be used: {message}"), None))
}

impl Declared {
    /// Takes in one declaration.
    pub fn add(&mut self, declaration: Declaration, models: &dyn Models) -> Result<(), Refusal> {
        let model = model(models, &declaration.model)?;
        if self.get(&declaration.name).is_some() {
            let hint = format!("name one of them: scene.expect(\"{}\", ..., \"another\")", declaration.model);
            return refuse(format!("there is already a '{}' in the scene", declaration.name), hint);
        }
        for (joint, quantity) in &declaration.joints {
            let Some(index) = model.moving_joints().find(|j| model.joints[*j].name == *joint) else {
                let names: Vec<&str> = model.moving_joints().map(|j| model.joints[j].name.as_str()).collect();
                return refuse(format!("the model '{}' has no moving joint '{joint}'", model.name), hint_among(joint, "its joints", names));
            };
            let slides = model.joints[index].kind == JointKind::Prismatic;
            if slides != matches!(quantity, Quantity::Length(_)) {
                let hint = if slides { "it slides: give a length" } else { "it turns: give an angle" };
                return refuse(format!("the joint '{joint}' is given the wrong kind of position"), hint.to_owned());
            }
        }
        if let DeclaredPlace::Inside(inside) = &declaration.place {
            let Some((_, container)) = self.get(&inside.object) else {
                return refuse(format!("'{}' is not declared", inside.object), "declare it first".to_owned());
            };
            if geometry::region(container, inside.region.as_deref()).is_none() {
                let names: Vec<&str> = container.document.regions.iter().map(|r| r.name.as_str()).collect();
                let name = inside.region.as_deref().unwrap_or("");
                let message = format!("the model '{}' has no region '{name}' that things can be in", container.name);
                return refuse(message, hint_among(name, "its regions", names));
            }
        }
        self.objects.push((declaration, model));
        Ok(())
    }

    /// The same of a thing of which the robot is told nothing.
    pub fn add_unknown(&mut self, declaration: Declaration, models: &dyn Models) -> Result<(), Refusal> {
        let name = declaration.name.clone();
        self.add(declaration, models)?;
        self.unknown.insert(name);
        Ok(())
    }

    /// A thing that the robot has come to know by itself: where it stands is believed, not declared.
    pub fn learned(&mut self, name: &str, model: Arc<ObjectModel>, at: At) {
        let place = DeclaredPlace::Table { at, facing: Angle(0.0) };
        self.objects.push((Declaration { name: name.to_owned(), model: name.to_owned(), place, joints: Vec::new() }, model));
    }

    /// The world is to hide an effect in a joint; in the first moving one if none is named.
    pub fn hide(&mut self, object: &str, joint: Option<&str>) -> Result<(), Refusal> {
        let Some((_, model)) = self.get(object) else { return refuse(format!("'{object}' is not declared"), None) };
        let names: Vec<&str> = model.moving_joints().map(|j| model.joints[j].name.as_str()).collect();
        let chosen = match joint {
            Some(joint) => names.iter().find(|n| **n == joint),
            None => names.first(),
        };
        let Some(chosen) = chosen.map(|n| (*n).to_owned()) else {
            let wanted = joint.map_or_else(String::new, |j| format!(" '{j}'"));
            let message = format!("the model '{}' has no moving joint{wanted} in which an effect could be hidden", model.name);
            return refuse(message, hint_among(joint.unwrap_or_default(), "its joints", names));
        };
        self.hidden.insert(object.to_owned(), chosen);
        Ok(())
    }

    /// A declared object by its name in the scene.
    pub fn get(&self, name: &str) -> Option<&(Declaration, Arc<ObjectModel>)> {
        self.objects.iter().find(|(d, _)| d.name == name)
    }

    /// The robot: the one that the script says, or the only one in the library.
    pub fn robot(&self, models: &dyn Models) -> Result<Arc<ObjectModel>, Refusal> {
        if let Some(name) = &self.robot {
            let robot = model(models, name)?;
            if robot.document.robot.is_none() {
                return refuse(format!("the model '{name}' is not a robot"), "its model.yaml has no 'robot' section".to_owned());
            }
            return Ok(robot);
        }
        let robots: Vec<Arc<ObjectModel>> =
            models.names().iter().filter_map(|n| models.model(n).ok()).filter(|m| m.document.robot.is_some()).collect();
        match robots.as_slice() {
            [robot] => Ok(robot.clone()),
            [] => refuse("the library has no robot".to_owned(), "add a model whose model.yaml has a 'robot' section".to_owned()),
            several => {
                let names: Vec<&str> = several.iter().map(|m| m.name.as_str()).collect();
                let hint = format!("say which: scene.robot(\"{}\"); there are {}", names[0], names.join(", "));
                refuse("the library has more than one robot".to_owned(), hint)
            }
        }
    }

    /// Positions of all moving joints of an object at the start, in the model's order; shut where nothing is said.
    pub fn q(&self, name: &str) -> Vec<f64> {
        let Some((declaration, model)) = self.get(name) else { return Vec::new() };
        model
            .moving_joints()
            .map(|j| {
                let joint = &model.joints[j];
                let said = declaration.joints.iter().find(|(n, _)| *n == joint.name).map(|(_, quantity)| match quantity {
                    Quantity::Angle(a) => a.0,
                    Quantity::Length(l) => l.0,
                });
                let shut = if joint.limits.lower.is_finite() { joint.limits.lower } else { 0.0 };
                said.unwrap_or(shut)
            })
            .collect()
    }

    /// The scene for the world, and what is believed before anything is seen.
    pub fn scene(&self, models: &dyn Models) -> Result<(Scene, SceneBelief), Refusal> {
        let robot = self.robot(models)?;
        let facts = robot.document.robot.as_ref();
        let start = facts
            .and_then(|f| f.configurations.iter().find(|c| c.name == "ready").or_else(|| f.configurations.first()))
            .map(|c| c.name.clone());
        let Some(start) = start else {
            return refuse(format!("the robot '{}' has no configurations", robot.name), "name one 'ready' in its model.yaml".to_owned());
        };
        let mut poses: BTreeMap<&str, Isometry3<f64>> = BTreeMap::new();
        let (mut objects, mut beliefs) = (Vec::new(), Vec::new());
        for (declaration, model) in &self.objects {
            let q = self.q(&declaration.name);
            let (X_WO, placement, covariance) = match &declaration.place {
                DeclaredPlace::Table { at, facing } => {
                    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), facing.0);
                    let (least, _) = geometry::bounds(model, &Isometry3::from_parts(Translation3::identity(), yaw), &q);
                    let z = at.z.unwrap_or(TABLE_HEIGHT - least.z);
                    let X_WO = Isometry3::from_parts(Translation3::new(at.xy[0], at.xy[1], z), yaw);
                    (X_WO, Placement::World(X_WO), covariance(YAW, [SHIFT, SHIFT]))
                }
                DeclaredPlace::Inside(inside) => {
                    // `add` has found the container declared before, and the region in it.
                    let Some((X_WO, size)) = self.standing_inside(&inside.object, inside.region.as_deref(), model, &q, &poses) else {
                        return refuse(format!("'{}' is not declared", inside.object), "declare it first".to_owned());
                    };
                    let placement = Placement::Inside { object: inside.object.clone(), region: inside.region.clone() };
                    // Uniform over the region: a twelfth of the width squared.
                    (X_WO, placement, covariance(std::f64::consts::PI / 3f64.sqrt(), [size[0] / 12f64.sqrt(), size[1] / 12f64.sqrt()]))
                }
            };
            poses.insert(&declaration.name, X_WO);
            let name = declaration.name.clone();
            let hidden_effect = self.hidden.get(&name).cloned();
            objects.push(SceneObject { name: name.clone(), model: model.clone(), placement, q: q.clone(), hidden_effect });
            if !self.unknown.contains(&name) {
                beliefs.push(ObjectBelief { name, model: model.folder.clone(), X_WO, q, covariance, X_TO: None, seen: false });
            }
        }
        let belief = SceneBelief {
            robot: robot.folder.clone(),
            X_WR: Isometry3::identity(),
            table_height: TABLE_HEIGHT,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            objects: beliefs,
        };
        Ok((Scene { robot, start, table_height: TABLE_HEIGHT, objects }, belief))
    }

    /// Pose of an object that stands in the middle of a region's floor, and the region's size.
    fn standing_inside(
        &self,
        container: &str,
        region: Option<&str>,
        model: &ObjectModel,
        q: &[f64],
        poses: &BTreeMap<&str, Isometry3<f64>>,
    ) -> Option<(Isometry3<f64>, [f64; 3])> {
        let (_, holder) = self.get(container)?;
        let (region, link) = geometry::region(holder, region)?;
        let X_WG = geometry::X_WG(holder, poses.get(container)?, &self.q(container), region, link);
        let (least, _) = geometry::bounds(model, &Isometry3::identity(), q);
        Some((X_WG * Isometry3::translation(0.0, 0.0, -region.size[2] / 2.0 - least.z), region.size))
    }
}

fn covariance(yaw: f64, [x, y]: [f64; 2]) -> Matrix6<f64> {
    let deviations: Vector6<f64> = Vector6::new(TILT, TILT, yaw, x, y, HEIGHT);
    Matrix6::from_diagonal(&deviations.map(|d| d * d))
}
