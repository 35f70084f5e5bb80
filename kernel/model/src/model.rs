use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use crate::text::{DOCUMENT_BYTES, read_text};
use crate::{Document, Geometry, ModelError, Shape, TriangleMesh};

/// Name of the URDF in a model's folder.
pub const URDF_FILE: &str = "object.urdf";
/// Name of the document in a model's folder.
pub const DOCUMENT_FILE: &str = "model.yaml";

/// One object model, read and checked: a tree of links, and the document that says what URDF cannot.
#[derive(Debug, Clone)]
pub struct ObjectModel {
    /// The object's name, from `model.yaml`, else from the URDF.
    pub name: String,
    /// The folder it was read from; relative mesh names start here.
    pub folder: PathBuf,
    /// The links; `links[0]` is the root, and a parent stands before its children.
    pub links: Vec<Link>,
    /// The joints; `joints[i]` moves `links[i + 1]`.
    pub joints: Vec<Joint>,
    /// What `model.yaml` says; the default document where there is none.
    pub document: Document,
}

/// One rigid body of the tree.
#[derive(Debug, Clone)]
pub struct Link {
    /// Name from the URDF.
    pub name: String,
    /// Mass properties; zero for a massless frame.
    pub inertial: Inertial,
    /// What a camera sees.
    pub visuals: Vec<Shape>,
    /// What touches.
    pub collisions: Vec<Shape>,
}

/// Mass properties of a link `L`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertial {
    /// Mass in kg.
    pub mass: f64,
    /// Centre of mass, in the link's frame, in m.
    pub p_LoLcm: Point3<f64>,
    /// Rotational inertia about the centre of mass, in the axes of the link's frame, in kg m^2.
    pub I_LLcm_L: Matrix3<f64>,
}

/// One joint: how a child link moves in its parent.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Name from the URDF.
    pub name: String,
    /// What motion it allows.
    pub kind: JointKind,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// Pose of the joint's fixed frame in the parent link's; at position zero the child's frame lies on it.
    pub X_PJ: Isometry3<f64>,
    /// Axis in the joint's frame: of turning or sliding, or the normal of a planar joint.
    pub axis: Unit<Vector3<f64>>,
    /// Limits, where the URDF gives them.
    pub limits: JointLimits,
    /// Viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Dry friction, N m or N.
    pub friction: f64,
    /// The joint that this one follows, if any.
    pub mimic: Option<Mimic>,
}

/// The motion a joint allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// No motion.
    Fixed,
    /// A turn about the axis, within limits.
    Revolute,
    /// A turn about the axis, without limits.
    Continuous,
    /// A slide along the axis, within limits.
    Prismatic,
    /// Any rigid motion.
    Floating,
    /// Two slides across the axis and a turn about it.
    Planar,
}

/// Limits of a joint of one degree of freedom; infinite where the URDF gives none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Least position, rad or m.
    pub lower: f64,
    /// Greatest position, rad or m.
    pub upper: f64,
    /// Greatest speed, rad/s or m/s.
    pub velocity: f64,
    /// Greatest drive effort, N m or N.
    pub effort: f64,
}

/// q = multiplier * q(joint) + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mimic {
    /// Index of the joint that is followed.
    pub joint: usize,
    /// Factor.
    pub multiplier: f64,
    /// Offset in rad or m.
    pub offset: f64,
}

impl JointKind {
    /// Number of positions (a floating joint has a unit quaternion: 7).
    pub fn positions(self) -> usize {
        match self {
            Self::Fixed => 0,
            Self::Revolute | Self::Continuous | Self::Prismatic => 1,
            Self::Floating => 7,
            Self::Planar => 3,
        }
    }

    /// Number of velocities.
    pub fn velocities(self) -> usize {
        match self {
            Self::Floating => 6,
            other => other.positions(),
        }
    }
}

impl JointLimits {
    /// No limits at all.
    pub const NONE: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY, velocity: f64::INFINITY, effort: f64::INFINITY };

    /// Length of the range, infinite where it is open.
    pub fn range(&self) -> f64 {
        self.upper - self.lower
    }
}

impl ObjectModel {
    /// Reads a model from its folder (`object.urdf`, and `model.yaml` if there is one) and checks it.
    ///
    /// Errors: as [`Self::read_urdf`].
    pub fn read(folder: impl AsRef<Path>) -> Result<Self, ModelError> {
        Self::read_urdf(folder.as_ref().join(URDF_FILE))
    }

    /// Reads a URDF anywhere, with the `model.yaml` beside it if there is one, and checks that they fit together.
    ///
    /// Errors name the file, the line where it is known, the link, joint or entry, and what to do: files that are missing,
    /// too large or broken; what no body can be (mass, inertia, limits, axes); links that do not form one tree; names that
    /// do not exist.
    pub fn read_urdf(path: impl AsRef<Path>) -> Result<Self, ModelError> {
        let path = path.as_ref();
        let document_path = path.with_file_name(DOCUMENT_FILE);
        if !document_path.exists() {
            return crate::urdf::read(path, Document::default());
        }
        let text = read_text(&document_path, DOCUMENT_BYTES)?;
        let mut model = crate::urdf::read(path, Document::parse(&text, &document_path)?)?;
        crate::validate::check(&model, &document_path, &text)?;
        crate::stated::take_out(&mut model).map_err(|(effect, message)| {
            let effect = &model.document.effects[effect];
            let joint = effect.joint.as_deref().unwrap_or_default();
            ModelError::Impossible {
                path: document_path.clone(),
                line: crate::document::line_of(&text, &effect.effect),
                place: format!("effect '{}' of joint '{joint}'", effect.effect),
                message,
            }
        })?;
        Ok(model)
    }

    /// The text of the model's URDF, with meshes named as [`Self::write`] lays them.
    pub fn to_urdf(&self) -> String {
        let names = self.mesh_names();
        crate::urdf::to_urdf(self, |file| names.get(file).cloned().unwrap_or_else(|| file.to_string_lossy().into_owned()))
    }

    /// Writes `object.urdf`, `model.yaml` and the meshes into a folder, which is made if it is not there. A mesh file that
    /// still exists is copied as it is; otherwise its triangles are written anew as STL. Reading the folder gives an equal
    /// model, but for rounding in the poses' angles.
    ///
    /// Errors: a file that cannot be written.
    pub fn write(&self, folder: impl AsRef<Path>) -> Result<(), ModelError> {
        self.write_as(folder, URDF_FILE)
    }

    /// The same, with another name for the URDF. [`Self::read_urdf`] of it finds the document and the meshes.
    ///
    /// Errors: a file that cannot be written.
    pub fn write_as(&self, folder: impl AsRef<Path>, urdf: &str) -> Result<(), ModelError> {
        let folder = folder.as_ref();
        let store = |path: PathBuf, bytes: &[u8]| {
            let write = || {
                path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
                std::fs::write(&path, bytes)
            };
            write().map_err(|source| ModelError::File { path: path.clone(), source })
        };
        let names = self.mesh_names();
        let shapes = self.links.iter().flat_map(|l| l.visuals.iter().chain(&l.collisions));
        for shape in shapes {
            let Geometry::Mesh { file, scale, mesh } = &shape.geometry else { continue };
            let Some(name) = names.get(file) else { continue };
            let bytes = std::fs::read(self.folder.join(file))
                .unwrap_or_else(|_| TriangleMesh::clone(mesh).scaled(&scale.map(|s| 1.0 / s)).to_stl());
            store(folder.join(name), &bytes)?;
        }
        store(folder.join(DOCUMENT_FILE), self.document.to_yaml()?.as_bytes())?;
        store(folder.join(urdf), self.to_urdf().as_bytes())
    }

    /// The names that the model's mesh files have in a folder of its own: those inside the model's folder keep theirs, others
    /// move to `meshes/`.
    fn mesh_names(&self) -> BTreeMap<PathBuf, String> {
        let mut names: BTreeMap<PathBuf, String> = BTreeMap::new();
        for shape in self.links.iter().flat_map(|l| l.visuals.iter().chain(&l.collisions)) {
            let Geometry::Mesh { file, .. } = &shape.geometry else { continue };
            if names.contains_key(file) {
                continue;
            }
            let inside = file.components().all(|c| matches!(c, std::path::Component::Normal(_)));
            let stem = file.file_stem().and_then(|s| s.to_str()).unwrap_or("mesh");
            let ending = match self.folder.join(file).is_file() {
                true => file.extension().and_then(|e| e.to_str()).unwrap_or("stl"),
                false => "stl",
            };
            let mut name = match file.to_str().filter(|_| inside && self.folder.join(file).is_file()) {
                Some(name) => name.to_owned(),
                None => format!("meshes/{stem}.{ending}"),
            };
            let mut count = 1;
            while names.values().any(|n| *n == name) {
                count += 1;
                name = format!("meshes/{stem}_{count}.{ending}");
            }
            names.insert(file.clone(), name);
        }
        names
    }

    /// Index of a link by name.
    pub fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|l| l.name == name)
    }

    /// Index of a joint by name.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|j| j.name == name)
    }

    /// Indices of the joints that move on their own (neither fixed nor mimicking), in the tree's order: the order of `q`.
    pub fn moving_joints(&self) -> impl Iterator<Item = usize> + '_ {
        self.joints.iter().enumerate().filter(|(_, j)| j.kind != JointKind::Fixed && j.mimic.is_none()).map(|(i, _)| i)
    }

    /// Pose of a joint's child in its parent, at position `q` of a joint of one degree of freedom.
    pub fn X_PC(&self, joint: usize, q: f64) -> Isometry3<f64> {
        let j = &self.joints[joint];
        let X_JC = match j.kind {
            JointKind::Revolute | JointKind::Continuous => Isometry3::rotation(j.axis.into_inner() * q),
            JointKind::Prismatic => Isometry3::translation(j.axis.x * q, j.axis.y * q, j.axis.z * q),
            JointKind::Fixed | JointKind::Floating | JointKind::Planar => Isometry3::identity(),
        };
        j.X_PJ * X_JC
    }

    /// Poses of all links in the root link's frame. `q` has one entry for each of [`Self::moving_joints`], which must be
    /// of one degree of freedom; missing entries count as zero.
    pub fn X_OL(&self, q: &[f64]) -> Vec<Isometry3<f64>> {
        let mut position = vec![0.0; self.joints.len()];
        for (slot, joint) in self.moving_joints().enumerate() {
            position[joint] = q.get(slot).copied().unwrap_or(0.0);
        }
        let mut X_OL = vec![Isometry3::identity(); self.links.len()];
        for (i, joint) in self.joints.iter().enumerate() {
            let q = joint.mimic.map_or(position[i], |m| m.multiplier * position[m.joint] + m.offset);
            X_OL[joint.child] = X_OL[joint.parent] * self.X_PC(i, q);
        }
        X_OL
    }
}
