//! From where a place can be seen: camera poses around it, turned into configurations of the arm.
//!
//! Frames: `W` world, `C` camera (x right, y down, z forward), `T` tool.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use sagci_model::ObjectModel;
use sagci_planning::{CollisionWorld, InverseOptions};

use super::geometry;

/// Distances of the camera from the place, m.
const DISTANCES: [f64; 3] = [0.45, 0.35, 0.6];
/// Angles up from the opening's direction (or from the horizontal, if there is none), rad.
const RISES: [f64; 4] = [0.6, 0.3, 0.9, 0.1];
/// Angles to either side, rad.
const SIDES: [f64; 5] = [0.0, 0.35, -0.35, 0.7, -0.7];
/// Turns of the camera about its own axis: which side of the image is up does not matter.
const ROLLS: [f64; 4] = [0.0, std::f64::consts::PI, std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2];
/// No more configurations than this are answered.
const ENOUGH: usize = 4;

/// Configurations without collision from which `target` should be seen, the most promising ones first. `opening` is the
/// direction in the world out of the opening that the place is seen through, if it is inside something.
pub(super) fn configurations(
    world: &CollisionWorld,
    robot: &ObjectModel,
    target: &Point3<f64>,
    opening: Option<&Vector3<f64>>,
    q_now: &[f64],
    width: f64,
    seed: u64,
) -> Vec<Vec<f64>> {
    let Some(X_TC) = X_TC(robot) else { return Vec::new() };
    // From the robot's side if the place is open all around.
    let toward_robot = Vector3::new(-target.x, -target.y, 0.0);
    let out = opening.copied().unwrap_or(toward_robot);
    let out = Unit::try_new(out, 1e-6).unwrap_or(Vector3::z_axis());
    let upright = out.z.abs() > 0.9;
    let options = InverseOptions { starts: 6, solutions: 2, seed, margin: 0.05, ..Default::default() };
    let mut found: Vec<Vec<f64>> = Vec::new();
    for distance in DISTANCES {
        for rise in RISES {
            for side in SIDES {
                let direction = if upright { lean(&out, rise * 0.7, side * 4.0) } else { lean(&out, rise, side) };
                let eye = target + direction * distance;
                let Some(looking) = looking(&eye, target) else { continue };
                for roll in ROLLS {
                    let X_WC = looking * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
                    let X_WT = X_WC * X_TC.inverse();
                    let solutions = world.arm().inverse(&X_WT, &[q_now.to_vec()], &options);
                    if let Some(q) = solutions.into_iter().find(|q| world.free(q, width)) {
                        found.push(q);
                        break;
                    }
                }
                if found.len() >= ENOUGH {
                    return found;
                }
            }
        }
    }
    found
}

/// Pose of the camera in the tool frame: both are fixed to the hand.
fn X_TC(robot: &ObjectModel) -> Option<Isometry3<f64>> {
    let facts = robot.document.robot.as_ref()?;
    let q = vec![0.0; facts.arm_joints.len()];
    let X_RT = geometry::X_WT(robot, &Isometry3::identity(), &q)?;
    let X_RC = robot.X_OL(&[])[robot.link(&facts.camera.link)?] * facts.camera.X_LC.isometry();
    Some(X_RT.inverse() * X_RC)
}

/// A direction turned upward by `rise` and to the side by `side`; one that points up is tilted by `rise`, toward `side`.
fn lean(out: &Unit<Vector3<f64>>, rise: f64, side: f64) -> Vector3<f64> {
    if out.z.abs() > 0.9 {
        return Vector3::new(rise.sin() * side.cos(), rise.sin() * side.sin(), rise.cos());
    }
    let level = Vector3::new(out.x, out.y, 0.0).normalize();
    let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), side) * level;
    turned * rise.cos() + Vector3::z() * rise.sin()
}

/// A camera at `eye` that looks at `target`, level.
fn looking(eye: &Point3<f64>, target: &Point3<f64>) -> Option<Isometry3<f64>> {
    let z = Unit::try_new(target - eye, 1e-6)?;
    let x = Unit::try_new(z.cross(&Vector3::z()), 1e-6).unwrap_or(Vector3::x_axis());
    let y = z.cross(&x);
    let R = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x.into_inner(), y, z.into_inner()]));
    Some(Isometry3::from_parts(Translation3::from(eye.coords), UnitQuaternion::from_rotation_matrix(&R)))
}
