//! Collision and visual shapes as parry has them.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use parry3d_f64::shape::{ConvexPolyhedron, SharedShape};
use sagci_model::{Geometry, ObjectModel, Shape};

use crate::WorldError;
use crate::convert;

/// A convex solid fixed to a link.
#[derive(Clone)]
pub(crate) struct Solid {
    /// Index of the link.
    pub link: usize,
    /// Pose in the link.
    pub X_LG: Isometry3<f64>,
    /// Its form.
    pub shape: SharedShape,
}

/// All collision shapes of a model. A mesh counts as its convex hull.
pub(crate) fn solids(model: &ObjectModel) -> Result<Vec<Solid>, WorldError> {
    let mut solids = Vec::new();
    for (link, l) in model.links.iter().enumerate() {
        for shape in &l.collisions {
            let (X_LG, form) = convex(shape).ok_or_else(|| WorldError::Scene {
                place: format!("{}/{}", model.name, l.name),
                message: "a collision shape is flat or empty: it has no volume to touch; give it a thickness".into(),
            })?;
            solids.push(Solid { link, X_LG, shape: form });
        }
    }
    Ok(solids)
}

/// parry's cylinder and capsule stand along y, URDF's along z.
fn along_z() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2)
}

fn convex(shape: &Shape) -> Option<(Isometry3<f64>, SharedShape)> {
    let positive = |lengths: &[f64]| lengths.iter().all(|l| l.is_finite() && *l > 0.0);
    match &shape.geometry {
        Geometry::Box { half_extents: h } => positive(&[h.x, h.y, h.z]).then(|| (shape.X_LG, SharedShape::cuboid(h.x, h.y, h.z))),
        Geometry::Sphere { radius } => positive(&[*radius]).then(|| (shape.X_LG, SharedShape::ball(*radius))),
        Geometry::Cylinder { radius, half_length } => {
            positive(&[*radius, *half_length]).then(|| (shape.X_LG * along_z(), SharedShape::cylinder(*half_length, *radius)))
        }
        Geometry::Capsule { radius, half_length } => {
            positive(&[*radius, *half_length]).then(|| (shape.X_LG * along_z(), SharedShape::capsule_y(*half_length, *radius)))
        }
        Geometry::Mesh { mesh, .. } => {
            let points: Vec<_> = mesh.vertices.iter().map(|v| convert::vector(&v.coords)).collect();
            ConvexPolyhedron::from_convex_hull(&points).map(|hull| (shape.X_LG, SharedShape::new(hull)))
        }
    }
}

/// How far solids reach along a direction.
///
/// `solids` with the pose of each in a common frame, `direction` in that frame; the greatest of `p . direction` over all
/// points `p`. Exact for convex shapes, by their support points.
pub(crate) fn reach<'a>(solids: impl Iterator<Item = (Isometry3<f64>, &'a SharedShape)>, direction: &Vector3<f64>) -> f64 {
    solids
        .filter_map(|(X, shape)| {
            let support = shape.as_support_map()?;
            let point = support.support_point(&convert::pose(&X), convert::vector(direction));
            Some(convert::vector3(point).dot(direction))
        })
        .fold(f64::NEG_INFINITY, f64::max)
}
