//! The scene that is planned in: beliefs with their models read.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use sagci_model::ObjectModel;
use sagci_signal::SceneBelief;

use crate::PlanError;

/// One object of the scene.
#[derive(Debug, Clone)]
pub struct SceneObject {
    /// Its name in the scene.
    pub name: String,
    /// Its model.
    pub model: Arc<ObjectModel>,
    /// Pose of its root link in the world.
    pub X_WO: Isometry3<f64>,
    /// Positions of its moving joints.
    pub q: Vec<f64>,
    /// Pose in the tool frame, if the gripper holds it.
    pub X_TO: Option<Isometry3<f64>>,
}

/// The robot and the objects, with their models.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The robot's model.
    pub robot: Arc<ObjectModel>,
    /// Pose of the robot's root link.
    pub X_WR: Isometry3<f64>,
    /// Height of the surface that things stand on, m.
    pub table_height: f64,
    /// Gravity in the world, m/s^2.
    pub gravity: Vector3<f64>,
    /// The objects, in the belief's order.
    pub objects: Vec<SceneObject>,
}

impl Scene {
    /// Reads the models that a belief names.
    ///
    /// # Errors
    /// [`PlanError::ModelLacks`] with the file and place if a model cannot be read.
    pub fn read(belief: &SceneBelief) -> Result<Self, PlanError> {
        let read = |folder: &Path| {
            ObjectModel::read(folder)
                .map(Arc::new)
                .map_err(|e| PlanError::ModelLacks { model: folder.display().to_string(), message: e.to_string() })
        };
        Self::with_models(belief, &read)
    }

    /// As [`Self::read`], with models that `model` gives for their folders: a host that keeps them read passes them on.
    pub fn with_models(belief: &SceneBelief, model: &dyn Fn(&Path) -> Result<Arc<ObjectModel>, PlanError>) -> Result<Self, PlanError> {
        let objects = belief
            .objects
            .iter()
            .map(|o| Ok(SceneObject { name: o.name.clone(), model: model(&o.model)?, X_WO: o.X_WO, q: o.q.clone(), X_TO: o.X_TO }))
            .collect::<Result<_, PlanError>>()?;
        Ok(Self { robot: model(&belief.robot)?, X_WR: belief.X_WR, table_height: belief.table_height, gravity: belief.gravity, objects })
    }

    /// Index of an object by its name.
    ///
    /// # Errors
    /// [`PlanError::BadInput`] if there is none.
    pub fn object(&self, name: &str) -> Result<usize, PlanError> {
        self.objects.iter().position(|o| o.name == name).ok_or_else(|| PlanError::BadInput {
            message: format!(
                "the scene has no object '{name}'; it has {}",
                self.objects.iter().map(|o| o.name.as_str()).collect::<Vec<_>>().join(", ")
            ),
        })
    }
}
