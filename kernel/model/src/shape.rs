use std::path::PathBuf;
use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};

use crate::TriangleMesh;

/// A solid fixed to a link.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Name from the URDF, if it gives one.
    pub name: Option<String>,
    /// Pose of the shape's own frame in the link's.
    pub X_LG: Isometry3<f64>,
    /// Its form, in its own frame.
    pub geometry: Geometry,
    /// Colour as red, green, blue, opacity in 0..1, where the URDF gives one.
    pub rgba: Option<[f64; 4]>,
}

/// The form of a [`Shape`], centred on its own frame as URDF has it. Metres.
#[derive(Debug, Clone)]
pub enum Geometry {
    /// A box by its half extents.
    Box {
        /// Half extents along x, y, z.
        half_extents: Vector3<f64>,
    },
    /// A sphere.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A cylinder along z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half of the length.
        half_length: f64,
    },
    /// A capsule along z.
    Capsule {
        /// Radius.
        radius: f64,
        /// Half of the length of the straight part.
        half_length: f64,
    },
    /// A triangle mesh, already scaled.
    Mesh {
        /// File name as the URDF gives it, relative to the URDF's folder.
        file: PathBuf,
        /// Scale that the URDF gives; `mesh` already has it applied.
        scale: Vector3<f64>,
        /// The triangles.
        mesh: Arc<TriangleMesh>,
    },
}
