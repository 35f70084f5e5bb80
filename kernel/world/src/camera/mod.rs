//! The wrist's RGB-D camera: rays cast on the world's geometry, then what a stereo depth camera makes of it.

mod noise;
mod surfaces;

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use parry3d_f64::query::{Ray, RayCast};
use sagci_model::Robot;
use sagci_signal::DepthImage;

use self::noise::Ideal;
use self::surfaces::Surface;
use crate::perturbation::Perturbation;
use crate::random::Random;
use crate::{Scene, WorldError, convert};

/// Rays begin this far from the optical centre, m. The centre lies at the face of the camera's own housing, and the
/// mounting error may put it inside: what is modelled there is the camera itself, and its glass is clear.
const GLASS: f64 = 0.01;

/// The camera with everything it can see.
pub(crate) struct Camera {
    spec: sagci_model::Camera,
    /// Link of the robot that carries it.
    link: usize,
    /// Where it truly is on that link.
    X_LC: Isometry3<f64>,
    surfaces: Vec<Surface>,
    noise: f64,
    random: Random,
}

impl Camera {
    /// The camera of the scene's robot. `constant` draws its mounting error, `random` the noise of its images; `noise`
    /// scales the latter.
    pub(crate) fn new(
        scene: &Scene,
        robot: &Robot,
        bounds: &Perturbation,
        noise: f64,
        constant: &mut Random,
        random: Random,
    ) -> Result<Self, WorldError> {
        let spec = robot.camera.clone();
        let wrong = |message: String| WorldError::Scene { place: format!("{}/camera", scene.robot.name), message };
        let link = scene.robot.link(&spec.link).ok_or_else(|| wrong(format!("is on the link '{}', which does not exist", spec.link)))?;
        let positive = |numbers: [f64; 2]| numbers.iter().all(|n| n.is_finite() && *n > 0.0);
        if spec.size.iter().any(|&n| n == 0 || n > 4096) || !positive(spec.focal) || !spec.center.iter().all(|c| c.is_finite()) {
            return Err(wrong("needs an image of 1 to 4096 pixels a side, positive focal lengths and a finite centre".into()));
        }
        if !(spec.range[0] >= 0.0 && spec.range[1] > spec.range[0] && spec.range[1].is_finite()) {
            return Err(wrong(format!("its range {:?} is not from a nearest to a farther depth", spec.range)));
        }
        let error = Isometry3::from_parts(Translation3::from(constant.in_ball() * bounds.camera_shift), constant.turn(bounds.camera_turn));
        let X_LC = spec.X_LC.isometry() * error;
        Ok(Self { spec, link, X_LC, surfaces: surfaces::of(scene)?, noise, random })
    }

    /// An image from the poses of all links in the world: the robot's first, then the objects'.
    pub(crate) fn look(&mut self, time: f64, X_WL: &[Vec<Isometry3<f64>>]) -> DepthImage {
        let X_WC = X_WL[0][self.link] * self.X_LC;
        let ideal = self.cast(&X_WC, X_WL);
        let depth = noise::measure(&ideal, &self.spec, self.noise, &mut self.random);
        DepthImage {
            time,
            width: ideal.width,
            height: ideal.height,
            focal: self.spec.focal,
            center: self.spec.center,
            depth: depth.into_iter().map(|z| z as f32).collect(),
            rgb: ideal.rgb,
        }
    }

    /// What a perfect camera sees: one ray through the centre of each pixel.
    fn cast(&self, X_WC: &Isometry3<f64>, X_WL: &[Vec<Isometry3<f64>>]) -> Ideal {
        let X_CW = X_WC.inverse();
        // What may be in sight, nearest first: a ray can stop at the first hit that is nearer than the next ball.
        struct Candidate<'a> {
            surface: &'a Surface,
            X_SC: Isometry3<f64>,
            center: Point3<f64>,
            radius: f64,
            nearest: f64,
        }
        let mut candidates: Vec<Candidate> = self
            .surfaces
            .iter()
            .map(|surface| {
                let X_CS = X_CW * surface.owner.map_or_else(Isometry3::identity, |(thing, link)| X_WL[thing][link]);
                let center = X_CS * surface.center;
                Candidate { surface, X_SC: X_CS.inverse(), center, radius: surface.radius, nearest: center.coords.norm() - surface.radius }
            })
            .filter(|c| c.center.z + c.radius > 0.0)
            .collect();
        candidates.sort_by(|a, b| a.nearest.total_cmp(&b.nearest));

        let [width, height] = self.spec.size;
        let mut ideal = Ideal::new(width, height);
        for row in 0..height {
            for column in 0..width {
                let along = Vector3::new(
                    (column as f64 - self.spec.center[0]) / self.spec.focal[0],
                    (row as f64 - self.spec.center[1]) / self.spec.focal[1],
                    1.0,
                );
                let length = along.norm();
                let direction = along / length;
                let mut best = f64::INFINITY;
                let mut seen = None;
                for c in &candidates {
                    if c.nearest > best {
                        break;
                    }
                    let forward = c.center.coords.dot(&direction);
                    if c.center.coords.norm_squared() - forward * forward > c.radius * c.radius {
                        continue;
                    }
                    let along_S = c.X_SC.rotation * direction;
                    let start = c.X_SC.translation.vector + along_S * GLASS;
                    let ray = Ray::new(convert::vector(&start), convert::vector(&along_S));
                    if let Some(hit) = c.surface.mesh.cast_local_ray_and_get_normal(&ray, best.min(1e3) - GLASS, false)
                        && hit.time_of_impact + GLASS < best
                    {
                        best = hit.time_of_impact + GLASS;
                        let facing = hit.normal.dot(ray.dir).abs();
                        seen = Some((c.surface, hit.subshape, facing));
                    }
                }
                if let Some((surface, triangle, facing)) = seen {
                    ideal.set(column, row, best / length, facing, surface.color(triangle as usize, facing));
                }
            }
        }
        ideal
    }
}
