//! URDF to [`ObjectModel`].

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use super::vocabulary;
use crate::text::{URDF_BYTES, did_you_mean, read_text};
use crate::xml::{self, Element};
use crate::{Document, Geometry, Inertial, Joint, JointKind, JointLimits, Link, Mimic, ModelError, ObjectModel, Shape, TriangleMesh};

/// Greatest number of links.
const LINKS: usize = 2000;

/// Among the lines, that of a link's `<inertial>`.
const INERTIAL: &str = "inertial of link";

/// The file being read: where it is, and on which lines its links and joints stand.
struct Source<'a> {
    path: &'a Path,
    folder: PathBuf,
    lines: BTreeMap<(&'static str, String), usize>,
}

impl Source<'_> {
    /// An error about a link or joint.
    fn impossible(&self, kind: &'static str, name: &str, message: impl Into<String>) -> ModelError {
        ModelError::Impossible {
            path: self.path.to_owned(),
            line: self.lines.get(&(kind, name.to_owned())).copied(),
            place: format!("{kind} '{name}'"),
            message: message.into(),
        }
    }
}

/// Reads a URDF, checks it, orders its tree, and loads its meshes.
pub(crate) fn read(path: &Path, document: Document) -> Result<ObjectModel, ModelError> {
    let text = read_text(path, URDF_BYTES)?;
    let malformed = |line, message| ModelError::Malformed { path: path.to_owned(), line, message };
    let elements = xml::scan(&text).map_err(|e| malformed(Some(e.line), e.message))?;
    vocabulary::check(&elements).map_err(|e| malformed(Some(e.line), e.message))?;
    let robot = urdf_rs::read_from_string(&text).map_err(|e| malformed(None, e.to_string()))?;
    let source = Source { path, folder: path.parent().unwrap_or(Path::new(".")).to_owned(), lines: lines(&elements, path)? };

    let tree = Tree::build(&robot, &source)?;
    let mut meshes = BTreeMap::new();
    let links = tree.links.iter().map(|&i| link(&robot, &robot.links[i], &source, &mut meshes)).collect::<Result<Vec<_>, _>>()?;
    let mut joints = tree.joints.iter().map(|&i| joint(&robot.joints[i], &tree, &source)).collect::<Result<Vec<_>, _>>()?;
    follow_mimics(&robot, &tree, &mut joints, &source)?;
    let name = if document.name.is_empty() { robot.name.clone() } else { document.name.clone() };
    Ok(ObjectModel { name, folder: source.folder, links, joints, document })
}

/// The lines of the named links and joints; their names must be unique.
fn lines(elements: &[Element], path: &Path) -> Result<BTreeMap<(&'static str, String), usize>, ModelError> {
    let mut lines = BTreeMap::new();
    for e in elements.iter().filter(|e| e.name == "inertial") {
        let link = e.parent.and_then(|p| elements[p].attribute("name")).unwrap_or_default();
        lines.insert((INERTIAL, link.to_owned()), e.line);
    }
    for e in elements.iter().filter(|e| e.parent == Some(0)) {
        let kind = match e.name.as_str() {
            "link" => "link",
            "joint" => "joint",
            _ => continue,
        };
        let name = e.attribute("name").unwrap_or_default().to_owned();
        if let Some(first) = lines.insert((kind, name.clone()), e.line) {
            return Err(ModelError::Impossible {
                path: path.to_owned(),
                line: Some(e.line),
                place: format!("{kind} '{name}'"),
                message: format!("has the same name as the {kind} on line {first}; names must be unique"),
            });
        }
    }
    Ok(lines)
}

/// The order of the tree: root first, then breadth first in the order of the file, so that parents stand before children.
struct Tree {
    /// Indices into the file's links.
    links: Vec<usize>,
    /// Indices into the file's joints; `joints[i]` moves `links[i + 1]`.
    joints: Vec<usize>,
    /// Place in `links` by name.
    place: BTreeMap<String, usize>,
}

impl Tree {
    fn build(robot: &urdf_rs::Robot, source: &Source) -> Result<Self, ModelError> {
        if robot.links.len() > LINKS {
            return Err(ModelError::Malformed {
                path: source.path.to_owned(),
                line: None,
                message: format!("has {} links; at most {LINKS} are read", robot.links.len()),
            });
        }
        let index: BTreeMap<&str, usize> = robot.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
        let mut parent_joint: BTreeMap<&str, &str> = BTreeMap::new();
        let mut children: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (i, j) in robot.joints.iter().enumerate() {
            for (end, name) in [("parent", &j.parent.link), ("child", &j.child.link)] {
                if !index.contains_key(name.as_str()) {
                    let hint = did_you_mean(name, index.keys().copied());
                    return Err(source.impossible("joint", &j.name, format!("has the {end} link '{name}', which is not defined{hint}")));
                }
            }
            if j.parent.link == j.child.link {
                return Err(source.impossible("joint", &j.name, format!("joins the link '{}' to itself", j.child.link)));
            }
            if let Some(other) = parent_joint.insert(&j.child.link, &j.name) {
                let message = format!("has the child link '{}', which joint '{other}' has too; a link hangs on one joint", j.child.link);
                return Err(source.impossible("joint", &j.name, message));
            }
            children.entry(&j.parent.link).or_default().push(i);
        }
        let roots: Vec<&str> = robot.links.iter().map(|l| l.name.as_str()).filter(|n| !parent_joint.contains_key(n)).collect();
        let root = match roots.as_slice() {
            [root] => *root,
            [] => return Err(source.impossible("link", &robot.links[0].name, "is part of a loop; the links must form one tree")),
            [_, second, ..] => {
                let message = format!("hangs on no joint, and neither does '{}'; the links must form one tree with one root", roots[0]);
                return Err(source.impossible("link", second, message));
            }
        };
        let mut tree = Self { links: vec![index[root]], joints: Vec::new(), place: BTreeMap::new() };
        let mut next = 0;
        while let Some(&parent) = tree.links.get(next) {
            let name = &robot.links[parent].name;
            tree.place.insert(name.clone(), next);
            for &j in children.get(name.as_str()).map(Vec::as_slice).unwrap_or_default() {
                tree.joints.push(j);
                tree.links.push(index[robot.joints[j].child.link.as_str()]);
            }
            next += 1;
        }
        if let Some(lost) = robot.links.iter().find(|l| !tree.place.contains_key(&l.name)) {
            return Err(source.impossible("link", &lost.name, "is part of a loop; the links must form one tree"));
        }
        Ok(tree)
    }
}

fn pose(p: &urdf_rs::Pose) -> Isometry3<f64> {
    let [x, y, z] = p.xyz.0;
    let [roll, pitch, yaw] = p.rpy.0;
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn link(
    robot: &urdf_rs::Robot,
    l: &urdf_rs::Link,
    source: &Source,
    meshes: &mut BTreeMap<(PathBuf, [u64; 3]), Arc<TriangleMesh>>,
) -> Result<Link, ModelError> {
    let fail = |message: String| source.impossible("link", &l.name, message);
    let mut load = |name: &Option<String>, origin: &urdf_rs::Pose, g: &urdf_rs::Geometry| {
        Ok::<_, ModelError>(Shape { name: name.clone(), X_LG: pose(origin), geometry: geometry(g, source, &l.name, meshes)?, rgba: None })
    };
    let mut visuals = Vec::new();
    for v in &l.visual {
        let mut shape = load(&v.name, &v.origin, &v.geometry)?;
        shape.rgba = v.material.as_ref().map(|m| colour(robot, m)).transpose().map_err(fail)?.flatten();
        visuals.push(shape);
    }
    let mut collisions = Vec::new();
    for c in &l.collision {
        let shape = load(&c.name, &c.origin, &c.geometry)?;
        if let Geometry::Mesh { file, mesh, .. } = &shape.geometry
            && !mesh.has_thickness()
        {
            return Err(fail(format!("collides by the mesh '{}', which is flat: nothing can be inside it", file.display())));
        }
        collisions.push(shape);
    }
    Ok(Link { name: l.name.clone(), inertial: inertial(&l.inertial, &l.name, source)?, visuals, collisions })
}

/// A material's colour; one without a colour of its own refers to the robot's material of that name.
fn colour(robot: &urdf_rs::Robot, material: &urdf_rs::Material) -> Result<Option<[f64; 4]>, String> {
    if let Some(c) = &material.color {
        return Ok(Some(c.rgba.0));
    }
    if material.texture.is_some() {
        return Ok(None);
    }
    match robot.materials.iter().find(|m| m.name == material.name) {
        Some(m) => Ok(m.color.as_ref().map(|c| c.rgba.0)),
        None => {
            let hint = did_you_mean(&material.name, robot.materials.iter().map(|m| m.name.as_str()));
            Err(format!("is shown with the material '{}', which is not defined{hint}", material.name))
        }
    }
}

/// Mass properties. Without an `<inertial>` element the link is a massless frame. A body's principal moments of inertia
/// are positive, and the greatest is at most the sum of the other two, since I1 + I2 - I3 = 2 int z^2 dm >= 0
/// (Wensing, Kim and Slotine 2018, "Linear matrix inequalities for physically consistent inertial parameter identification").
fn inertial(i: &urdf_rs::Inertial, name: &str, source: &Source) -> Result<Inertial, ModelError> {
    let fail = |message: String| Err(source.impossible("link", name, message));
    let X_LI = pose(&i.origin);
    let n = &i.inertia;
    let I = Matrix3::new(n.ixx, n.ixy, n.ixz, n.ixy, n.iyy, n.iyz, n.ixz, n.iyz, n.izz);
    let declared = source.lines.contains_key(&(INERTIAL, name.to_owned())) || i.mass.value != 0.0 || I != Matrix3::zeros();
    if !declared {
        return Ok(Inertial { mass: 0.0, p_LoLcm: Point3::origin(), I_LLcm_L: Matrix3::zeros() });
    }
    let mass = i.mass.value;
    if mass <= 0.0 {
        return fail(format!("has the mass {mass} kg; it must be positive (leave <inertial> out for a massless frame)"));
    }
    let mut moments: Vec<f64> = I.symmetric_eigenvalues().iter().copied().collect();
    moments.sort_by(f64::total_cmp);
    let shown = moments.iter().map(|m| format!("{m:.3e}")).collect::<Vec<_>>().join(", ");
    if moments[0] <= 0.0 {
        return fail(format!("has the principal moments of inertia {shown} kg m^2; each must be positive"));
    }
    // Figures identified on real machines can break this a little (Franka's link 4 by a tenth) and are still of use; what
    // breaks it by more is a mistake of units or axes.
    if moments[2] > (moments[0] + moments[1]) * 1.25 {
        let message = "the greatest may not exceed the sum of the others, whatever the shape";
        return fail(format!("has the principal moments of inertia {shown} kg m^2; {message}"));
    }
    let R = X_LI.rotation.to_rotation_matrix();
    let turned = R * I * R.transpose();
    // Turning leaves rounding that differs across the diagonal.
    let I_LLcm_L = (turned + turned.transpose()) / 2.0;
    Ok(Inertial { mass, p_LoLcm: Point3::from(X_LI.translation.vector), I_LLcm_L })
}

fn geometry(
    g: &urdf_rs::Geometry,
    source: &Source,
    link: &str,
    meshes: &mut BTreeMap<(PathBuf, [u64; 3]), Arc<TriangleMesh>>,
) -> Result<Geometry, ModelError> {
    let positive = |what: &str, sizes: &[f64]| match sizes.iter().find(|s| **s <= 0.0) {
        Some(s) => Err(source.impossible("link", link, format!("has a {what} of size {s} m; sizes must be positive"))),
        None => Ok(()),
    };
    Ok(match g {
        urdf_rs::Geometry::Box { size } => {
            positive("box", &size.0)?;
            Geometry::Box { half_extents: Vector3::from(size.0) / 2.0 }
        }
        urdf_rs::Geometry::Sphere { radius } => {
            positive("sphere", &[*radius])?;
            Geometry::Sphere { radius: *radius }
        }
        urdf_rs::Geometry::Cylinder { radius, length } => {
            positive("cylinder", &[*radius, *length])?;
            Geometry::Cylinder { radius: *radius, half_length: length / 2.0 }
        }
        urdf_rs::Geometry::Capsule { radius, length } => {
            positive("capsule", &[*radius])?;
            if *length < 0.0 {
                positive("capsule", &[*length])?;
            }
            Geometry::Capsule { radius: *radius, half_length: length / 2.0 }
        }
        urdf_rs::Geometry::Mesh { filename, scale } => {
            let scale = scale.map_or(Vector3::repeat(1.0), |s| Vector3::from(s.0));
            if scale.iter().any(|s| *s == 0.0) {
                return Err(source.impossible("link", link, format!("flattens the mesh '{filename}': a scale of zero")));
            }
            let file = mesh_file(filename, &source.folder).map_err(|m| source.impossible("link", link, m))?;
            let path = source.folder.join(&file);
            let key = (path.clone(), [scale.x.to_bits(), scale.y.to_bits(), scale.z.to_bits()]);
            let mesh = match meshes.get(&key) {
                Some(mesh) => Arc::clone(mesh),
                None => {
                    let read = TriangleMesh::read(&path).map_err(|e| match e {
                        ModelError::File { source: why, .. } => source.impossible(
                            "link",
                            link,
                            format!("its mesh '{}' cannot be read: {why}; put the file there, or name another", path.display()),
                        ),
                        other => other,
                    })?;
                    let mesh = Arc::new(read.scaled(&scale));
                    meshes.insert(key, Arc::clone(&mesh));
                    mesh
                }
            };
            Geometry::Mesh { file, scale, mesh }
        }
    })
}

/// Where a mesh lies, relative to the URDF's folder if it can be said so. ROS's `package://NAME/PATH` is looked for in
/// the folders around the URDF, since there is no ROS to ask.
fn mesh_file(name: &str, folder: &Path) -> Result<PathBuf, String> {
    if let Some(rest) = name.strip_prefix("package://") {
        let (package, inner) = rest.split_once('/').ok_or_else(|| format!("the mesh '{name}' names no file in its package"))?;
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        for around in folder.ancestors() {
            for candidate in [around.join(rest), around.join(inner)] {
                let right = candidate.starts_with(around.join(package)) || around.file_name().is_some_and(|n| n == package);
                if right && candidate.is_file() {
                    return Ok(candidate);
                }
            }
        }
        return Err(format!(
            "the mesh '{name}' is not found: no folder '{package}' around the URDF holds it; name it relative to the URDF, for example 'meshes/part.stl'"
        ));
    }
    if let Some(rest) = name.strip_prefix("file://") {
        return Ok(PathBuf::from(rest));
    }
    if let Some((scheme, _)) = name.split_once("://") {
        return Err(format!("the mesh '{name}' is not fetched: '{scheme}://' is not read; name a file relative to the URDF"));
    }
    Ok(PathBuf::from(name))
}

fn joint(j: &urdf_rs::Joint, tree: &Tree, source: &Source) -> Result<Joint, ModelError> {
    let fail = |message: String| source.impossible("joint", &j.name, message);
    let kind = match j.joint_type {
        urdf_rs::JointType::Fixed => JointKind::Fixed,
        urdf_rs::JointType::Revolute => JointKind::Revolute,
        urdf_rs::JointType::Continuous => JointKind::Continuous,
        urdf_rs::JointType::Prismatic => JointKind::Prismatic,
        urdf_rs::JointType::Floating => JointKind::Floating,
        urdf_rs::JointType::Planar => JointKind::Planar,
        urdf_rs::JointType::Spherical => return Err(fail("is spherical; that is not a URDF joint type".into())),
    };
    let axis = match (kind, Unit::try_new(Vector3::from(j.axis.xyz.0), 1e-9)) {
        // Their axis means nothing, and some programs write zero there.
        (JointKind::Fixed | JointKind::Floating, _) => Vector3::x_axis(),
        (_, Some(axis)) => axis,
        (_, None) => return Err(fail("has an axis of length zero; write a direction, for example xyz=\"0 0 1\"".into())),
    };
    let limits = match kind {
        JointKind::Revolute | JointKind::Prismatic => {
            JointLimits { lower: j.limit.lower, upper: j.limit.upper, velocity: j.limit.velocity, effort: j.limit.effort }
        }
        _ => JointLimits::NONE,
    };
    if limits.lower > limits.upper {
        return Err(fail(format!("has a lower limit of {} above its upper limit of {}", limits.lower, limits.upper)));
    }
    let (damping, friction) = j.dynamics.as_ref().map_or((0.0, 0.0), |d| (d.damping, d.friction));
    for (what, value) in
        [("velocity limit", limits.velocity), ("effort limit", limits.effort), ("damping", damping), ("friction", friction)]
    {
        if value < 0.0 {
            return Err(fail(format!("has a {what} of {value}; it must not be negative")));
        }
    }
    let place = |name: &str| tree.place.get(name).copied().ok_or_else(|| fail(format!("joins the link '{name}', which is not defined")));
    Ok(Joint {
        name: j.name.clone(),
        kind,
        parent: place(&j.parent.link)?,
        child: place(&j.child.link)?,
        X_PJ: pose(&j.origin),
        axis,
        limits,
        damping,
        friction,
        mimic: None,
    })
}

/// Fills in the mimics. One that follows a follower is led back to the joint that moves on its own:
/// q = m1 (m2 q0 + o2) + o1.
fn follow_mimics(robot: &urdf_rs::Robot, tree: &Tree, joints: &mut [Joint], source: &Source) -> Result<(), ModelError> {
    let place: BTreeMap<&str, usize> = tree.joints.iter().enumerate().map(|(k, &i)| (robot.joints[i].name.as_str(), k)).collect();
    for k in 0..joints.len() {
        let name = joints[k].name.clone();
        let fail = |message: String| source.impossible("joint", &name, message);
        let mut followed = k;
        let (mut multiplier, mut offset, mut steps) = (1.0, 0.0, 0);
        while let Some(m) = &robot.joints[tree.joints[followed]].mimic {
            let Some(&next) = place.get(m.joint.as_str()) else {
                let hint = did_you_mean(&m.joint, place.keys().copied());
                return Err(fail(format!("mimics the joint '{}', which is not defined{hint}", m.joint)));
            };
            for end in [followed, next] {
                if joints[end].kind.positions() != 1 {
                    return Err(fail(format!("mimics '{}', but '{}' does not have one position", m.joint, joints[end].name)));
                }
            }
            offset += multiplier * m.offset.unwrap_or(0.0);
            multiplier *= m.multiplier.unwrap_or(1.0);
            followed = next;
            steps += 1;
            if steps > joints.len() {
                return Err(fail("mimics in a circle: following it never ends at a joint that moves on its own".into()));
            }
        }
        if steps > 0 {
            joints[k].mimic = Some(Mimic { joint: followed, multiplier, offset });
        }
    }
    Ok(())
}
