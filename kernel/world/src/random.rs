//! Seeded random numbers, the same bits on every platform.

use nalgebra::{ComplexField, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

/// What a stream of random numbers is for. Each purpose has its own stream, so that drawing more of one does not change
/// the others.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Purpose {
    /// Poses of the objects.
    Place,
    /// Noise of the joint, gripper and wrist sensors.
    Sensors,
    /// Noise of the depth camera.
    Camera,
    /// Constant errors of the robot and its sensors.
    Robot,
    /// Physical parameters of the object at this place in the scene.
    Object(usize),
    /// The effect that is hidden in the object at this place in the scene.
    Hidden(usize),
}

/// One stream.
#[derive(Debug, Clone)]
pub(crate) struct Random {
    pcg: Pcg64,
    spare: Option<f64>,
}

impl Random {
    pub(crate) fn new(seed: u64, purpose: Purpose) -> Self {
        let stream = match purpose {
            Purpose::Place => 1,
            Purpose::Sensors => 2,
            Purpose::Camera => 3,
            Purpose::Robot => 4,
            Purpose::Object(index) => 100 + index as u128,
            Purpose::Hidden(index) => (1 << 32) + index as u128,
        };
        Self { pcg: Pcg64::new(u128::from(seed), stream), spare: None }
    }

    /// Uniform in 0..1.
    pub(crate) fn unit(&mut self) -> f64 {
        self.pcg.random::<f64>()
    }

    /// Uniform in `low..high`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Standard normal, by Marsaglia's polar method. The logarithm is `libm`'s through simba, not the platform's.
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let (u, v) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                let scale = (-2.0 * ComplexField::ln(s) / s).sqrt();
                self.spare = Some(v * scale);
                return u * scale;
            }
        }
    }

    /// Three independent standard normals.
    pub(crate) fn normal3(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// Uniform in the disc of radius 1.
    pub(crate) fn in_disc(&mut self) -> [f64; 2] {
        loop {
            let (x, y) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            if x * x + y * y <= 1.0 {
                return [x, y];
            }
        }
    }

    /// Uniform in the ball of radius 1.
    pub(crate) fn in_ball(&mut self) -> Vector3<f64> {
        loop {
            let v = Vector3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            if v.norm_squared() <= 1.0 {
                return v;
            }
        }
    }

    /// A small turn of up to `angle`, about any axis.
    pub(crate) fn turn(&mut self, angle: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(self.in_ball() * angle)
    }
}
