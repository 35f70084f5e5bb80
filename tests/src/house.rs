//! Where things are, and a small library of made-up models.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sagci_model::ObjectModel;
use sagci_script::Models;

/// Source of the skill that no crate of the workspace knows.
pub const PUSH_SOURCE: &str = include_str!("../fixtures/push/push.rs");
/// Its manifest.
pub const PUSH_YAML: &str = include_str!("../fixtures/push/skill.yaml");

/// The workspace's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// Writes a file, with its folders.
pub fn write(path: impl AsRef<Path>, text: &str) -> PathBuf {
    let path = path.as_ref();
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
    path.to_owned()
}

/// The arm that ships.
pub fn panda() -> Arc<ObjectModel> {
    let home = root().join("world-models/panda");
    let version = std::fs::read_to_string(home.join("HEAD")).unwrap();
    Arc::new(ObjectModel::read(home.join(version.trim())).unwrap())
}

const CHEST: &str = r#"<robot name="chest">
  <link name="chest"><inertial><mass value="5"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.05"/><geometry><box size="0.4 0.3 0.1"/></geometry></collision></link>
  <link name="lid"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 -0.15 0.01"/><geometry><box size="0.4 0.3 0.02"/></geometry></collision></link>
  <link name="tray"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.3 0.2 0.02"/></geometry></collision></link>
  <joint name="lid_hinge" type="revolute"><parent link="chest"/><child link="lid"/><origin xyz="0 0.15 0.2"/><axis xyz="-1 0 0"/>
    <limit lower="0" upper="1.8" velocity="5" effort="50"/></joint>
  <joint name="tray_slide" type="prismatic"><parent link="chest"/><child link="tray"/><origin xyz="0 0 0.12"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.25" velocity="5" effort="50"/></joint>
</robot>"#;

const CHEST_YAML: &str = "schema: 1
name: chest
regions:
  - {name: tray, link: tray, center: [0, 0, 0.06], size: [0.28, 0.18, 0.1], opening: [0, 0, 1]}
  - {name: corner, link: chest, center: [0.1, 0, 0.15], size: [0.1, 0.1, 0.1], opening: [0, 0, 1]}
";

const CUBE: &str = r#"<robot name="cube">
  <link name="cube"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.02"/><geometry><box size="0.04 0.04 0.04"/></geometry></collision></link>
</robot>"#;

/// A chest with a lid and a tray, a cube, and the arm that ships.
pub struct ToyModels {
    _folder: tempfile::TempDir,
    models: Vec<(String, Arc<ObjectModel>)>,
}

impl ToyModels {
    /// Writes and reads them.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write(at("chest/object.urdf"), CHEST);
        write(at("chest/model.yaml"), CHEST_YAML);
        write(at("cube/object.urdf"), CUBE);
        write(at("cube/model.yaml"), "schema: 1\nname: cube\nmovable: true\n");
        let mut models: Vec<_> = ["chest", "cube"].map(|name| (name.to_owned(), Arc::new(ObjectModel::read(at(name)).unwrap()))).to_vec();
        models.push(("panda".to_owned(), panda()));
        Self { _folder: folder, models }
    }
}

impl Default for ToyModels {
    fn default() -> Self {
        Self::new()
    }
}

impl Models for ToyModels {
    fn names(&self) -> Vec<String> {
        self.models.iter().map(|(name, _)| name.clone()).collect()
    }

    fn model(&self, name: &str) -> Result<Arc<ObjectModel>, String> {
        self.models.iter().find(|(n, _)| n == name).map(|(_, m)| m.clone()).ok_or_else(|| "is not there".to_owned())
    }

    fn version(&self, name: &str) -> Result<(String, String), String> {
        self.model(name).map(|_| ("1".to_owned(), "0".to_owned()))
    }
}
