//! Where parts of an object are, from its model.

use nalgebra::{Isometry3, Point3, Vector3};
use sagci_model::{Geometry, ObjectModel, Region, Shape};

/// How far a shape reaches along a direction, from its own frame's origin.
fn reach(geometry: &Geometry, d: &Vector3<f64>) -> f64 {
    match geometry {
        Geometry::Box { half_extents } => half_extents.component_mul(&d.abs()).sum(),
        Geometry::Sphere { radius } => *radius,
        Geometry::Cylinder { radius, half_length } => radius * d.x.hypot(d.y) + half_length * d.z.abs(),
        Geometry::Capsule { radius, half_length } => radius + half_length * d.z.abs(),
        Geometry::Mesh { mesh, .. } => mesh.vertices.iter().map(|p| p.coords.dot(d)).fold(f64::NEG_INFINITY, f64::max),
    }
}

/// The box around an object at `q`, along the axes of a frame in which its root link stands at `X_FO`: least and greatest
/// corner. Of what touches, or of what is seen where nothing touches; a point at the origin for an object without shapes.
pub fn bounds(model: &ObjectModel, X_FO: &Isometry3<f64>, q: &[f64]) -> (Point3<f64>, Point3<f64>) {
    let collisions = model.links.iter().any(|l| !l.collisions.is_empty());
    let (mut least, mut most) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for (link, X_OL) in model.links.iter().zip(model.X_OL(q)) {
        let shapes: &[Shape] = if collisions { &link.collisions } else { &link.visuals };
        for shape in shapes {
            let X_FG = X_FO * X_OL * shape.X_LG;
            for axis in 0..3 {
                let mut d = Vector3::zeros();
                d[axis] = 1.0;
                let d_G = X_FG.rotation.inverse() * d;
                let center = X_FG.translation.vector[axis];
                most[axis] = most[axis].max(center + reach(&shape.geometry, &d_G));
                least[axis] = least[axis].min(center - reach(&shape.geometry, &-d_G));
            }
        }
    }
    if least.x > most.x {
        return (Point3::from(X_FO.translation.vector), Point3::from(X_FO.translation.vector));
    }
    (Point3::from(least), Point3::from(most))
}

/// A region of an object by name, or its first; with the index of its link.
pub fn region<'a>(model: &'a ObjectModel, name: Option<&str>) -> Option<(&'a Region, usize)> {
    let region = match name {
        None => model.document.regions.first(),
        Some(name) => model.document.regions.iter().find(|r| r.name == name),
    }?;
    Some((region, model.link(&region.link)?))
}

/// Pose of a region's centre in the world.
pub fn X_WG(model: &ObjectModel, X_WO: &Isometry3<f64>, q: &[f64], region: &Region, link: usize) -> Isometry3<f64> {
    let [x, y, z] = region.center;
    X_WO * model.X_OL(q)[link] * Isometry3::translation(x, y, z)
}

/// How far a point lies outside a region's box, m; 0 inside.
pub fn outside(region: &Region, X_WG: &Isometry3<f64>, point: &Point3<f64>) -> f64 {
    let p = X_WG.inverse_transform_point(point);
    (0..3).map(|i| p[i].abs() - region.size[i] / 2.0).fold(0.0, f64::max)
}

/// Pose of the tool frame in the world, from the arm's encoders.
pub fn X_WT(robot: &ObjectModel, X_WR: &Isometry3<f64>, q_arm: &[f64]) -> Option<Isometry3<f64>> {
    let facts = robot.document.robot.as_ref()?;
    let link = robot.link(&facts.gripper.link)?;
    let q: Vec<f64> = robot
        .moving_joints()
        .map(|j| facts.arm_joints.iter().position(|n| *n == robot.joints[j].name).and_then(|slot| q_arm.get(slot)).copied().unwrap_or(0.0))
        .collect();
    Some(X_WR * robot.X_OL(&q)[link] * facts.gripper.X_LT.isometry())
}
