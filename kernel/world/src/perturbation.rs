//! How far the measured world may differ from the stored models: drawn from the seed, once per reset.

use nalgebra::{UnitQuaternion, Vector3};
use sagci_model::{JointKind, ObjectModel};

use crate::random::{Purpose, Random};

/// Bounds of every drawn difference between the measured world and the stored models. Each is drawn uniformly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Perturbation {
    /// Radius of the disc in which an object placed in the world is moved, m.
    pub position: f64,
    /// Greatest turn about the vertical of an object placed in the world, rad.
    pub yaw: f64,
    /// Part of a region's free room that is used to place an object in it, 0..1.
    pub region: f64,
    /// Greatest turn about the vertical of an object placed in a region, rad.
    pub region_yaw: f64,
    /// Greatest change of an object's mass and inertia, as a fraction.
    pub mass: f64,
    /// Greatest shift of a link's centre of mass, m.
    pub center_of_mass: f64,
    /// Least and greatest factor on a passive joint's viscous damping.
    pub joint_damping: [f64; 2],
    /// Least and greatest factor on a passive joint's dry friction.
    pub joint_friction: [f64; 2],
    /// Greatest tilt of a passive joint's axis, rad. The shut pose of what it moves stays as modelled.
    pub axis_tilt: f64,
    /// Greatest shift of a passive revolute joint's axis, m. The shut pose of what it moves stays as modelled.
    pub axis_shift: f64,
    /// Greatest change of an object's surface friction, as a fraction.
    pub surface_friction: f64,
    /// Greatest mass on the hand that the robot's model does not know, kg.
    pub arm_payload: f64,
    /// Greatest dry friction of an arm joint that the robot's model does not know, N m. Robots with joint torque sensors
    /// compensate their gears' friction to about this (engineering estimate).
    pub arm_friction: f64,
    /// Greatest viscous damping of an arm joint that the robot's model does not know, N m s/rad (engineering estimate).
    pub arm_damping: f64,
    /// Greatest shift of the camera from where the robot's model says it is, m.
    pub camera_shift: f64,
    /// Greatest turn of the camera from how the robot's model says it is, rad.
    pub camera_turn: f64,
}

impl Default for Perturbation {
    fn default() -> Self {
        Self {
            position: 0.1,
            yaw: 15f64.to_radians(),
            region: 1.0,
            region_yaw: std::f64::consts::PI,
            mass: 0.2,
            center_of_mass: 0.005,
            joint_damping: [0.5, 1.5],
            joint_friction: [0.5, 1.5],
            axis_tilt: 1f64.to_radians(),
            axis_shift: 0.005,
            surface_friction: 0.15,
            arm_payload: 0.1,
            arm_friction: 0.2,
            arm_damping: 0.2,
            camera_shift: 0.002,
            camera_turn: 0.3f64.to_radians(),
        }
    }
}

impl Perturbation {
    /// The measured world is exactly what the stored models say.
    pub const NONE: Self = Self {
        position: 0.0,
        yaw: 0.0,
        region: 0.0,
        region_yaw: 0.0,
        mass: 0.0,
        center_of_mass: 0.0,
        joint_damping: [1.0, 1.0],
        joint_friction: [1.0, 1.0],
        axis_tilt: 0.0,
        axis_shift: 0.0,
        surface_friction: 0.0,
        arm_payload: 0.0,
        arm_friction: 0.0,
        arm_damping: 0.0,
        camera_shift: 0.0,
        camera_turn: 0.0,
    };
}

/// What was drawn for one model.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drawn {
    /// Factor on masses and inertias.
    pub mass: f64,
    /// Shift of each link's centre of mass, in the link's frame.
    pub center_of_mass: Vec<Vector3<f64>>,
    /// Factor on the surface friction.
    pub surface_friction: f64,
    /// For each joint of the model.
    pub joints: Vec<DrawnJoint>,
    /// Mass added at a link's origin, kg.
    pub payload: f64,
}

/// What was drawn for one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DrawnJoint {
    pub damping_factor: f64,
    pub friction_factor: f64,
    pub extra_damping: f64,
    pub extra_friction: f64,
    pub axis_tilt: UnitQuaternion<f64>,
    pub axis_shift: Vector3<f64>,
}

impl DrawnJoint {
    const NONE: Self = Self {
        damping_factor: 1.0,
        friction_factor: 1.0,
        extra_damping: 0.0,
        extra_friction: 0.0,
        axis_tilt: UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(1.0, 0.0, 0.0, 0.0)),
        axis_shift: Vector3::new(0.0, 0.0, 0.0),
    };
}

impl Drawn {
    /// Draws for an object.
    pub(crate) fn object(model: &ObjectModel, index: usize, seed: u64, bounds: &Perturbation) -> Self {
        let random = &mut Random::new(seed, Purpose::Object(index));
        Self {
            mass: 1.0 + random.between(-bounds.mass, bounds.mass),
            surface_friction: 1.0 + random.between(-bounds.surface_friction, bounds.surface_friction),
            center_of_mass: model.links.iter().map(|_| random.in_ball() * bounds.center_of_mass).collect(),
            joints: model
                .joints
                .iter()
                .map(|joint| DrawnJoint {
                    damping_factor: random.between(bounds.joint_damping[0], bounds.joint_damping[1]),
                    friction_factor: random.between(bounds.joint_friction[0], bounds.joint_friction[1]),
                    axis_tilt: random.turn(bounds.axis_tilt),
                    // A slide has a direction but no place: only a hinge's axis can be elsewhere.
                    axis_shift: random.in_ball() * if joint.kind == JointKind::Prismatic { 0.0 } else { bounds.axis_shift },
                    ..DrawnJoint::NONE
                })
                .collect(),
            payload: 0.0,
        }
    }

    /// Draws for the robot: its kinematics are calibrated, what it carries and its joints' friction are not.
    pub(crate) fn robot(model: &ObjectModel, arm_joints: &[usize], random: &mut Random, bounds: &Perturbation) -> Self {
        let mut joints = vec![DrawnJoint::NONE; model.joints.len()];
        for &joint in arm_joints {
            joints[joint].extra_damping = random.between(0.0, bounds.arm_damping);
            joints[joint].extra_friction = random.between(0.0, bounds.arm_friction);
        }
        Self {
            mass: 1.0,
            surface_friction: 1.0,
            center_of_mass: vec![Vector3::zeros(); model.links.len()],
            joints,
            payload: random.between(0.0, bounds.arm_payload),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn door() -> ObjectModel {
        crate::testing::model("door")
    }

    #[test]
    fn every_draw_stays_within_its_bound_and_reaches_most_of_it() {
        let model = door();
        let bounds = Perturbation::default();
        let draws: Vec<Drawn> = (0..300).map(|seed| Drawn::object(&model, 0, seed, &bounds)).collect();
        let spread =
            |f: &dyn Fn(&Drawn) -> f64| draws.iter().map(f).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        let near = |(low, high): (f64, f64), least: f64, most: f64| {
            let slack = 0.1 * (most - least);
            assert!(low >= least && low < least + slack && high <= most && high > most - slack, "{low}..{high} in {least}..{most}");
        };
        near(spread(&|d| d.mass), 0.8, 1.2);
        near(spread(&|d| d.surface_friction), 0.85, 1.15);
        near(spread(&|d| d.joints[0].damping_factor), 0.5, 1.5);
        near(spread(&|d| d.joints[0].friction_factor), 0.5, 1.5);
        let most = |f: &dyn Fn(&Drawn) -> f64, bound: f64| assert!(spread(f).1 <= bound + 1e-12 && spread(f).1 > 0.9 * bound);
        most(&|d| d.joints[0].axis_tilt.angle(), 1f64.to_radians());
        most(&|d| d.joints[0].axis_shift.norm(), 0.005);
    }

    #[test]
    fn no_perturbation_changes_nothing() {
        let model = door();
        let drawn = Drawn::object(&model, 0, 7, &Perturbation::NONE);
        assert_eq!((drawn.mass, drawn.surface_friction), (1.0, 1.0));
        assert_eq!(drawn.joints[0].axis_tilt.angle(), 0.0);
        assert_eq!((drawn.joints[0].damping_factor, drawn.joints[0].friction_factor), (1.0, 1.0));
    }
}
