use std::sync::Arc;

use nalgebra::Isometry3;
use sagci_model::ObjectModel;

/// What is said to be there before anything is seen: the robot, the table, and the objects with rough places.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The robot arm; its root link stands at the world's origin on the table.
    pub robot: Arc<ObjectModel>,
    /// Name of the robot's configuration in which the run starts.
    pub start: String,
    /// Height of the table's top, m.
    pub table_height: f64,
    /// The objects.
    pub objects: Vec<SceneObject>,
}

/// One object that is said to be there.
#[derive(Debug, Clone)]
pub struct SceneObject {
    /// Its name in the scene, unique.
    pub name: String,
    /// Its stored model.
    pub model: Arc<ObjectModel>,
    /// Roughly where it is.
    pub placement: Placement,
    /// Positions of its moving joints at the start, in the model's order.
    pub q: Vec<f64>,
    /// A joint that has an effect which the stored model lacks, drawn from the seed; the judge alone says which.
    pub hidden_effect: Option<String>,
}

/// Roughly where an object is.
#[derive(Debug, Clone, PartialEq)]
pub enum Placement {
    /// Pose of its root link in the world: within 0.1 m and 15 degrees of yaw.
    World(Isometry3<f64>),
    /// Standing somewhere in a region of another object, at any yaw.
    Inside {
        /// Name of the other object.
        object: String,
        /// Name of the region; the first one if not given.
        region: Option<String>,
    },
}
