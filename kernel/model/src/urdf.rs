//! URDF to [`ObjectModel`].

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::{Document, Geometry, Inertial, Joint, JointKind, JointLimits, Link, Mimic, ModelError, ObjectModel, Shape, TriangleMesh};

/// Reads a URDF, orders its tree, and loads its meshes.
pub(crate) fn read(path: &Path, document: Document) -> Result<ObjectModel, ModelError> {
    let text = std::fs::read_to_string(path).map_err(|source| ModelError::File { path: path.to_owned(), source })?;
    let robot = urdf_rs::read_from_string(&text).map_err(|e| ModelError::Malformed {
        path: path.to_owned(),
        line: None,
        message: e.to_string(),
    })?;
    let folder = path.parent().unwrap_or(Path::new(".")).to_owned();
    let impossible = |place: &str, message: String| ModelError::Impossible { path: path.to_owned(), place: place.to_owned(), message };

    // Root first, then children in the order of the file: parents always stand before their children.
    let mut order: Vec<usize> = Vec::new();
    let roots: Vec<&urdf_rs::Link> = robot.links.iter().filter(|l| robot.joints.iter().all(|j| j.child.link != l.name)).collect();
    let [root] = roots.as_slice() else {
        return Err(impossible(&robot.name, format!("has {} root links instead of one; the links must form one tree", roots.len())));
    };
    let mut names = vec![root.name.clone()];
    let mut next = 0;
    while next < names.len() {
        for (i, j) in robot.joints.iter().enumerate() {
            if j.parent.link == names[next] {
                if names.contains(&j.child.link) {
                    return Err(impossible(&j.child.link, "is the child of two joints".into()));
                }
                order.push(i);
                names.push(j.child.link.clone());
            }
        }
        next += 1;
    }
    if names.len() != robot.links.len() || order.len() != robot.joints.len() {
        return Err(impossible(&robot.name, "has links or joints that are not connected to its root".into()));
    }

    let links = names
        .iter()
        .map(|name| {
            let link = robot.links.iter().find(|l| &l.name == name).ok_or_else(|| impossible(name, "is not defined".into()))?;
            Ok(Link {
                name: name.clone(),
                inertial: inertial(&link.inertial),
                visuals: link
                    .visual
                    .iter()
                    .map(|v| shape(&folder, v.name.clone(), &v.origin, &v.geometry, v.material.as_ref()))
                    .collect::<Result<_, _>>()?,
                collisions: link
                    .collision
                    .iter()
                    .map(|c| shape(&folder, c.name.clone(), &c.origin, &c.geometry, None))
                    .collect::<Result<_, _>>()?,
            })
        })
        .collect::<Result<Vec<_>, ModelError>>()?;

    let index_of = |name: &str| names.iter().position(|n| n == name);
    let mut joints = Vec::with_capacity(order.len());
    for &i in &order {
        let j = &robot.joints[i];
        let kind = match j.joint_type {
            urdf_rs::JointType::Fixed => JointKind::Fixed,
            urdf_rs::JointType::Revolute => JointKind::Revolute,
            urdf_rs::JointType::Continuous => JointKind::Continuous,
            urdf_rs::JointType::Prismatic => JointKind::Prismatic,
            urdf_rs::JointType::Floating => JointKind::Floating,
            urdf_rs::JointType::Planar => JointKind::Planar,
            urdf_rs::JointType::Spherical => return Err(impossible(&j.name, "is spherical; that is not a URDF joint type".into())),
        };
        let axis =
            Unit::try_new(Vector3::from(j.axis.xyz.0), 1e-9).ok_or_else(|| impossible(&j.name, "has an axis of length zero".into()))?;
        let limits = match kind {
            JointKind::Revolute | JointKind::Prismatic => {
                JointLimits { lower: j.limit.lower, upper: j.limit.upper, velocity: j.limit.velocity, effort: j.limit.effort }
            }
            _ => JointLimits::NONE,
        };
        let (Some(parent), Some(child)) = (index_of(&j.parent.link), index_of(&j.child.link)) else {
            return Err(impossible(&j.name, "connects a link that is not defined".into()));
        };
        let mimic = match &j.mimic {
            None => None,
            Some(m) => {
                let followed = order
                    .iter()
                    .position(|&o| robot.joints[o].name == m.joint)
                    .ok_or_else(|| impossible(&j.name, format!("mimics the joint '{}', which does not exist", m.joint)))?;
                Some(Mimic { joint: followed, multiplier: m.multiplier.unwrap_or(1.0), offset: m.offset.unwrap_or(0.0) })
            }
        };
        joints.push(Joint {
            name: j.name.clone(),
            kind,
            parent,
            child,
            X_PJ: pose(&j.origin),
            axis,
            limits,
            damping: j.dynamics.as_ref().map_or(0.0, |d| d.damping),
            friction: j.dynamics.as_ref().map_or(0.0, |d| d.friction),
            mimic,
        });
    }
    let name = if document.name.is_empty() { robot.name.clone() } else { document.name.clone() };
    Ok(ObjectModel { name, folder, links, joints, document })
}

fn pose(p: &urdf_rs::Pose) -> Isometry3<f64> {
    let [x, y, z] = p.xyz.0;
    let [roll, pitch, yaw] = p.rpy.0;
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn inertial(i: &urdf_rs::Inertial) -> Inertial {
    let X_LI = pose(&i.origin);
    let n = &i.inertia;
    let I = Matrix3::new(n.ixx, n.ixy, n.ixz, n.ixy, n.iyy, n.iyz, n.ixz, n.iyz, n.izz);
    let R = X_LI.rotation.to_rotation_matrix();
    Inertial { mass: i.mass.value, p_LoLcm: Point3::from(X_LI.translation.vector), I_LLcm_L: R * I * R.transpose() }
}

fn shape(
    folder: &Path,
    name: Option<String>,
    origin: &urdf_rs::Pose,
    geometry: &urdf_rs::Geometry,
    material: Option<&urdf_rs::Material>,
) -> Result<Shape, ModelError> {
    let geometry = match geometry {
        urdf_rs::Geometry::Box { size } => Geometry::Box { half_extents: Vector3::from(size.0) / 2.0 },
        urdf_rs::Geometry::Sphere { radius } => Geometry::Sphere { radius: *radius },
        urdf_rs::Geometry::Cylinder { radius, length } => Geometry::Cylinder { radius: *radius, half_length: length / 2.0 },
        urdf_rs::Geometry::Capsule { radius, length } => Geometry::Capsule { radius: *radius, half_length: length / 2.0 },
        urdf_rs::Geometry::Mesh { filename, scale } => {
            let scale = scale.map_or(Vector3::repeat(1.0), |s| Vector3::from(s.0));
            let mesh = TriangleMesh::read(&folder.join(filename))?.scaled(&scale);
            Geometry::Mesh { file: filename.into(), scale, mesh: Arc::new(mesh) }
        }
    };
    let rgba = material.and_then(|m| m.color.as_ref()).map(|c| c.rgba.0);
    Ok(Shape { name, X_LG: pose(origin), geometry, rgba })
}
