//! Where the objects truly stand: drawn around what the scene says, never in collision.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use parry3d_f64::query;

use super::build::poses;
use crate::geometry::{Solid, reach};
use crate::perturbation::Perturbation;
use crate::random::{Purpose, Random};
use crate::{Placement, Scene, SceneObject, WorldError, convert};

/// How often a pose is drawn anew before the scene is said to be impossible.
const DRAWS: usize = 1000;
/// Gap under a standing object at the start, m: it settles within a few milliseconds.
const GAP: f64 = 2e-4;
/// A movable object whose nominal pose is this near to the table stands on it, m.
const NEAR_TABLE: f64 = 0.03;
/// Least distance between separate things at the start, m.
const CLEARANCE: f64 = 0.005;
/// Free room kept at a region's walls, m.
const WALL: f64 = 0.005;
/// How far a region's stated floor may lie under the true one, m.
const FLOOR: f64 = 0.02;

/// A thing at a place, for collision checks.
struct Standing<'a> {
    X_WG: Vec<(Isometry3<f64>, &'a Solid)>,
}

impl<'a> Standing<'a> {
    fn new(solids: &'a [Solid], X_WO: &Isometry3<f64>, X_OL: &[Isometry3<f64>]) -> Self {
        Self { X_WG: solids.iter().map(|s| (X_WO * X_OL[s.link] * s.X_LG, s)).collect() }
    }

    /// Is any solid nearer to any other than `clearance`?
    fn touches(&self, other: &Standing, clearance: f64) -> bool {
        let pairs = self.X_WG.iter().flat_map(|a| other.X_WG.iter().map(move |b| (a, b)));
        for ((X_a, a), (X_b, b)) in pairs {
            let (pose_a, pose_b) = (convert::pose(X_a), convert::pose(X_b));
            let (box_a, box_b) = (a.shape.compute_aabb(&pose_a), b.shape.compute_aabb(&pose_b));
            let apart = (box_a.mins - box_b.maxs).max(box_b.mins - box_a.maxs).max_element();
            if apart > clearance {
                continue;
            }
            // A pair that parry cannot measure counts as touching; all convex pairs can be.
            if query::distance(&pose_a, a.shape.as_ref(), &pose_b, b.shape.as_ref()).map_or(true, |d| d.distance <= clearance) {
                return true;
            }
        }
        false
    }

    /// Greatest extent along a direction.
    fn reach(&self, direction: &Vector3<f64>) -> f64 {
        reach(self.X_WG.iter().map(|(X, s)| (*X, &s.shape)), direction)
    }
}

/// Poses of all objects in the world, in the scene's order.
///
/// `solids` of the robot first, then of each object; `robot_q` are the positions of all the robot's moving joints.
pub(super) fn place(
    scene: &Scene,
    seed: u64,
    bounds: &Perturbation,
    solids: &[Vec<Solid>],
    X_WR: &Isometry3<f64>,
    robot_q: &[f64],
) -> Result<Vec<Isometry3<f64>>, WorldError> {
    let random = &mut Random::new(seed, Purpose::Place);
    let mut standing = vec![Standing::new(&solids[0], X_WR, &poses(&scene.robot, robot_q))];
    let mut placed: Vec<Option<Isometry3<f64>>> = vec![None; scene.objects.len()];

    for (i, object) in scene.objects.iter().enumerate() {
        let Placement::World(nominal) = &object.placement else { continue };
        let X_WO = draw(object, || {
            let [dx, dy] = random.in_disc();
            let yaw = random.between(-bounds.yaw, bounds.yaw);
            let mut X_WO = *nominal;
            X_WO.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * X_WO.rotation;
            X_WO.translation.vector += Vector3::new(dx, dy, 0.0) * bounds.position;
            let mut there = Standing::new(&solids[i + 1], &X_WO, &poses(&object.model, &object.q));
            let above_table = -there.reach(&-Vector3::z()) - scene.table_height;
            if object.model.document.movable && above_table.abs() < NEAR_TABLE {
                X_WO.translation.vector.z += GAP - above_table;
                there = Standing::new(&solids[i + 1], &X_WO, &poses(&object.model, &object.q));
            }
            (!standing.iter().any(|s| s.touches(&there, CLEARANCE))).then_some((X_WO, there))
        })?;
        placed[i] = Some(X_WO.0);
        standing.push(X_WO.1);
    }

    // What stands in something comes after that: repeat until nothing is left.
    loop {
        let mut left = None;
        let mut progress = false;
        for (i, object) in scene.objects.iter().enumerate() {
            let Placement::Inside { object: container, region } = &object.placement else { continue };
            if placed[i].is_some() {
                continue;
            }
            let Some(c) = scene.objects.iter().position(|o| &o.name == container) else {
                return Err(wrong(object, format!("stands inside '{container}', which is not in the scene")));
            };
            let Some(X_WC) = placed[c] else {
                left = Some(object);
                continue;
            };
            let container = &scene.objects[c];
            let regions = &container.model.document.regions;
            let region = match region {
                None => regions.first(),
                Some(name) => regions.iter().find(|r| &r.name == name),
            };
            let Some(region) = region else {
                let known: Vec<&str> = regions.iter().map(|r| r.name.as_str()).collect();
                return Err(wrong(object, format!("the model of '{}' has no such region; it has [{}]", container.name, known.join(", "))));
            };
            let Some(link) = container.model.link(&region.link) else {
                return Err(wrong(
                    container,
                    format!("the region '{}' is on the link '{}', which does not exist", region.name, region.link),
                ));
            };
            let X_WL = X_WC * poses(&container.model, &container.q)[link];
            let half = Vector3::from(region.size) / 2.0;
            let floor = Translation3::new(region.center[0], region.center[1], region.center[2] - half.z);
            let X_OL = poses(&object.model, &object.q);
            let found = draw(object, || {
                let yaw = random.between(-bounds.region_yaw, bounds.region_yaw);
                let R_LO = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
                let turned = Standing::new(&solids[i + 1], &Isometry3::from_parts(Translation3::identity(), R_LO), &X_OL);
                let extent = |axis: &Vector3<f64>| (-turned.reach(&-axis), turned.reach(axis));
                let (x, y) = (extent(&Vector3::x()), extent(&Vector3::y()));
                let bottom = extent(&Vector3::z()).0;
                let room = [half.x - (x.1 - x.0) / 2.0 - WALL, half.y - (y.1 - y.0) / 2.0 - WALL];
                let (dx, dy) = (random.between(-1.0, 1.0) * bounds.region, random.between(-1.0, 1.0) * bounds.region);
                if room[0] < 0.0 || room[1] < 0.0 {
                    return None;
                }
                let p = Vector3::new(dx * room[0] - (x.0 + x.1) / 2.0, dy * room[1] - (y.0 + y.1) / 2.0, GAP - bottom);
                // The stated floor may lie a little under the true one.
                let mut lift = 0.0;
                while lift <= FLOOR {
                    let X_WO = X_WL * floor * Isometry3::from_parts(Translation3::from(p + Vector3::z() * lift), R_LO);
                    let there = Standing::new(&solids[i + 1], &X_WO, &X_OL);
                    if !standing.iter().any(|s| s.touches(&there, GAP / 2.0)) {
                        return Some((X_WO, there));
                    }
                    lift += 0.001;
                }
                None
            })?;
            placed[i] = Some(found.0);
            standing.push(found.1);
            progress = true;
        }
        match left {
            None => break,
            Some(object) if !progress => {
                return Err(wrong(object, "stands inside something that stands inside it; give one of them a pose in the world".into()));
            }
            Some(_) => {}
        }
    }
    Ok(placed.into_iter().flatten().collect())
}

/// Draws until a draw is free of collisions.
fn draw<T>(object: &SceneObject, mut attempt: impl FnMut() -> Option<T>) -> Result<T, WorldError> {
    (0..DRAWS).find_map(|_| attempt()).ok_or_else(|| {
        wrong(
            object,
            format!("no place without a collision was found in {DRAWS} draws; move it away from the others or from the robot, or use a wider region"),
        )
    })
}

fn wrong(object: &SceneObject, message: String) -> WorldError {
    WorldError::Scene { place: object.name.clone(), message }
}
