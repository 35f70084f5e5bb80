//! Is a model what a library's model should be? More than the reader asks: terms, meshes, the direction of its joints,
//! and whether grasps and regions lie where the shapes say.

use std::collections::BTreeSet;
use std::path::{Component, Path};

use nalgebra::{Point3, Vector3};
use sagci_model::{Geometry, GraspHint, JointKind, Link, ObjectModel, Region, RimGrasp, Shape};

use crate::version::files;
use crate::{Finding, LibraryError};

/// Meshes beyond this make cloning, ray casting and review slow, bytes.
const LARGE_MESH: u64 = 300_000;
/// Published moments of inertia are rounded: this share is forgiven.
const ROUNDING: f64 = 1e-3;
/// A point this far outside of a shape still counts as in it, m: hints are written to the millimetre.
const SLACK: f64 = 0.001;

/// What lies around an object's versions: the licence, and nothing that should not be there.
pub(crate) fn home(home: &Path) -> Result<Vec<Finding>, LibraryError> {
    let mut findings = Vec::new();
    if !["LICENSE", "LICENSE.txt", "LICENSE.md"].iter().any(|n| home.join(n).is_file()) {
        findings.push(Finding::error("LICENSE", "is missing: put the licence's text beside the versions"));
    }
    for entry in std::fs::read_dir(home).map_err(LibraryError::file(home))?.filter_map(Result::ok) {
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.path().is_dir() && crate::Version::parse(&name).is_none() {
            findings.push(Finding::warning(name, "is not a version: a version's name has 12 hexadecimal digits"));
        }
    }
    Ok(findings)
}

/// What is inside a version.
pub(crate) fn model(name: &str, model: &ObjectModel, folder: &Path) -> Result<Vec<Finding>, LibraryError> {
    let mut findings = Vec::new();
    terms(name, model, &mut findings);
    meshes(model, folder, &mut findings)?;
    for link in &model.links {
        let mut moments: Vec<f64> = link.inertial.I_LLcm_L.symmetric_eigenvalues().iter().copied().collect();
        moments.sort_by(f64::total_cmp);
        if let [a, b, c] = moments[..]
            && c > (a + b) * (1.0 + ROUNDING)
        {
            let message = format!(
                "has a principal moment of inertia that exceeds the sum of the others by {:.1} %; no body can",
                (c / (a + b) - 1.0) * 100.0
            );
            findings.push(Finding::warning(format!("link '{}'", link.name), message));
        }
        if !link.visuals.is_empty() && link.collisions.is_empty() {
            findings.push(Finding::warning(format!("link '{}'", link.name), "is seen but touches nothing; give it collision shapes"));
        }
    }
    if model.document.robot.is_none() {
        joints(model, &mut findings);
    }
    grasps(model, &mut findings);
    for region in &model.document.regions {
        free_space(model, region, &mut findings);
    }
    Ok(findings)
}

fn terms(name: &str, model: &ObjectModel, findings: &mut Vec<Finding>) {
    let p = &model.document.provenance;
    if model.document.name != name {
        findings.push(Finding::error("model.yaml: name", format!("is '{}', but the object is '{name}'", model.document.name)));
    }
    if model.document.description.trim().is_empty() {
        findings.push(Finding::warning("model.yaml: description", "is empty; say in one sentence what it is"));
    }
    for (key, missing) in
        [("licence", p.licence.trim().is_empty()), ("attribution", p.attribution.trim().is_empty()), ("origins", p.origins.is_empty())]
    {
        if missing {
            findings.push(Finding::error(
                format!("model.yaml: provenance: {key}"),
                "is missing; say where the model comes from and under which terms",
            ));
        }
    }
}

fn shapes(link: &Link) -> impl Iterator<Item = (&Shape, bool)> {
    link.visuals.iter().map(|s| (s, false)).chain(link.collisions.iter().map(|s| (s, true)))
}

fn meshes(model: &ObjectModel, folder: &Path, findings: &mut Vec<Finding>) -> Result<(), LibraryError> {
    let mut used = BTreeSet::new();
    for link in &model.links {
        for (shape, touches) in shapes(link) {
            let Geometry::Mesh { file, mesh, .. } = &shape.geometry else { continue };
            let place = format!("link '{}', mesh '{}'", link.name, file.display());
            if !file.components().all(|c| matches!(c, Component::Normal(_))) {
                findings.push(Finding::error(&place, "lies outside of the version; a version is whole in itself"));
            }
            if touches && !mesh.is_closed() {
                findings.push(Finding::error(&place, "is used to collide but is not closed: it has no inside"));
            } else if mesh.is_closed() && mesh.volume() <= 0.0 {
                let finding = if touches { Finding::error } else { Finding::warning };
                findings.push(finding(place, "is inside out: its triangles face inwards".to_owned()));
            }
            used.insert(file.to_string_lossy().into_owned());
        }
    }
    for file in files(folder)? {
        let path = folder.join(&file);
        let bytes = std::fs::metadata(&path).map_err(LibraryError::file(&path))?.len();
        if file.starts_with("meshes/") && !used.contains(&file) {
            findings.push(Finding::warning(&file, "is used by no link"));
        }
        if bytes > LARGE_MESH && file.starts_with("meshes/") {
            findings.push(Finding::warning(&file, format!("has {} kB; a coarser mesh does as well", bytes / 1000)));
        }
    }
    Ok(())
}

/// What a hand opens is shut at zero and opens in the positive direction. A pendulum, or a joint with a motor, goes both ways.
fn joints(model: &ObjectModel, findings: &mut Vec<Finding>) {
    for j in &model.joints {
        let limited = matches!(j.kind, JointKind::Revolute | JointKind::Prismatic);
        if !limited || j.mimic.is_some() {
            continue;
        }
        let place = format!("joint '{}'", j.name);
        let driven = model.document.actuators.iter().any(|a| a.joint == j.name);
        let held = model.document.grasps.iter().any(|g| g.link() == model.links[j.child].name);
        if held && !driven && (j.limits.lower != 0.0 || j.limits.upper <= 0.0) {
            let range = format!("{} to {}", j.limits.lower, j.limits.upper);
            findings.push(Finding::error(
                &place,
                format!("goes from {range}; a joint that a hand opens is shut at 0 and opens in the positive direction"),
            ));
        }
        for g in &model.document.grasps {
            let GraspHint::Bar(b) = g else { continue };
            if model.links[j.child].name != b.link {
                continue;
            }
            // Does the handle set out towards the hand when the joint opens?
            let middle = Vector3::from([0, 1, 2].map(|k| (b.from[k] + b.to[k]) / 2.0));
            let velocity = match j.kind {
                JointKind::Revolute => j.axis.cross(&middle),
                _ => j.axis.into_inner(),
            };
            if velocity.dot(&Vector3::from(b.outward)) <= 0.0 {
                findings.push(Finding::warning(&place, format!("moves the grasp '{}' inwards as it opens; is its axis reversed?", b.name)));
            }
        }
    }
}

/// What the fingers close on must be solid.
fn grasps(model: &ObjectModel, findings: &mut Vec<Finding>) {
    for g in &model.document.grasps {
        let Some(link) = model.link(g.link()).and_then(|i| model.links.get(i)) else { continue };
        let points = match g {
            GraspHint::Bar(b) => {
                (0..=8).map(|i| Point3::from([0, 1, 2].map(|k| b.from[k] + (b.to[k] - b.from[k]) * f64::from(i) / 8.0))).collect()
            }
            GraspHint::Rim(r) => points_in_wall(r),
        };
        if let Some(p) = points.iter().find(|p| depth(link, p).is_some_and(|d| d > SLACK)) {
            let at = format!("[{:.3}, {:.3}, {:.3}]", p.x, p.y, p.z);
            findings.push(Finding::error(
                format!("grasp '{}'", g.name()),
                format!("closes on nothing at {at} of link '{}': no collision shape is there", link.name),
            ));
        }
    }
}

/// Points midway in the wall, a little below the edge, all around but for what is blocked.
fn points_in_wall(r: &RimGrasp) -> Vec<Point3<f64>> {
    let axis = Vector3::from(r.axis);
    let across = |v: Vector3<f64>| (v - axis * axis.dot(&v)).try_normalize(0.1);
    let Some(x) = across(Vector3::x()).or_else(|| across(Vector3::y())) else { return Vec::new() };
    let y = axis.cross(&x);
    let free = |angle: f64| {
        r.blocked.iter().all(|[middle, half]| {
            let off = (angle - middle).rem_euclid(std::f64::consts::TAU);
            off.min(std::f64::consts::TAU - off) > *half
        })
    };
    let angles = (0..24).map(|i| f64::from(i) * std::f64::consts::TAU / 24.0).filter(|a| free(*a));
    let below = axis * (r.depth / 2.0).min(0.002);
    angles.map(|a| Point3::from(Vector3::from(r.center) - below + (x * a.cos() + y * a.sin()) * r.radius)).collect()
}

/// A region must be empty, or nothing can be put there.
fn free_space(model: &ObjectModel, region: &Region, findings: &mut Vec<Finding>) {
    let Some(link) = model.link(&region.link).and_then(|i| model.links.get(i)) else { return };
    const STEPS: i32 = 8;
    let mut worst: Option<(f64, Point3<f64>)> = None;
    for i in 0..=STEPS {
        for j in 0..=STEPS {
            for k in 0..=STEPS {
                let share = [i, j, k].map(|n| f64::from(n) / f64::from(STEPS) - 0.5);
                let p = Point3::from([0, 1, 2].map(|n| region.center[n] + share[n] * region.size[n]));
                if let Some(d) = depth(link, &p)
                    && d < -SLACK
                    && worst.is_none_or(|(w, _)| d < w)
                {
                    worst = Some((d, p));
                }
            }
        }
    }
    if let Some((d, p)) = worst {
        let at = format!("[{:.3}, {:.3}, {:.3}]", p.x, p.y, p.z);
        findings.push(Finding::error(
            format!("region '{}'", region.name),
            format!("is not free: at {at} it is {:.1} mm deep in a shape", -d * 1000.0),
        ));
    }
}

/// Signed distance from a point in the link's frame to the nearest of its collision shapes, m; negative inside. Exact
/// inside and near the surface, which is all that is asked. `None` if a mesh is among the shapes: those are not asked.
fn depth(link: &Link, p: &Point3<f64>) -> Option<f64> {
    let mut least = f64::INFINITY;
    for shape in &link.collisions {
        let q = shape.X_LG.inverse_transform_point(p);
        let d = match &shape.geometry {
            Geometry::Box { half_extents: h } => box_distance(&[q.x.abs() - h.x, q.y.abs() - h.y, q.z.abs() - h.z]),
            Geometry::Sphere { radius } => q.coords.norm() - radius,
            Geometry::Cylinder { radius, half_length } => box_distance(&[q.x.hypot(q.y) - radius, q.z.abs() - half_length]),
            Geometry::Capsule { radius, half_length } => {
                let beyond = (q.z.abs() - half_length).max(0.0);
                q.x.hypot(q.y).hypot(beyond) - radius
            }
            Geometry::Mesh { .. } => return None,
        };
        least = least.min(d);
    }
    Some(least)
}

/// Signed distance from how far a point lies beyond each pair of faces.
fn box_distance(beyond: &[f64]) -> f64 {
    let outside = beyond.iter().map(|b| b.max(0.0).powi(2)).sum::<f64>().sqrt();
    let inside = beyond.iter().copied().fold(f64::NEG_INFINITY, f64::max).min(0.0);
    outside + inside
}
