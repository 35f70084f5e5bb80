use std::f64::consts::PI;

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::camera::{Camera, Hit, cast};
use crate::noise::Noise;
use crate::object::{Category, Object, Solid};
use crate::random::Random;

/// How an object is looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Number of views.
    pub views: usize,
    /// Pixels across an image; three quarters as many down.
    pub width: usize,
    /// Number of points kept of all views together.
    pub points: usize,
    /// What the distance from which all of it is seen is multiplied by: less than one sees a part of it.
    pub near: f64,
    /// Do the views come from all places before it that an arm reaches, each aimed anywhere near it? Else from about the front.
    pub around: bool,
    /// Is the floor seen as well?
    pub surroundings: bool,
    /// The camera's errors.
    pub noise: Noise,
}

impl Look {
    /// What a wrist camera may do, drawn.
    pub fn draw(random: &mut Random) -> Self {
        Self {
            views: [1, 1, 1, 2, 2, 3][random.index(6)],
            width: random.pick([200, 280, 360, 424]),
            points: random.scale(4_000.0, 40_000.0) as usize,
            near: 1.0,
            around: false,
            surroundings: random.chance(0.2),
            noise: Noise::draw(random),
        }
    }

    /// What a robot sees that goes around an unknown thing before it models it, drawn: many views, from wherever its arm reaches, put
    /// together to one dense cloud.
    pub fn around(random: &mut Random) -> Self {
        Self {
            views: 2 + random.index(7),
            width: random.pick([160, 200, 240, 280]),
            points: random.scale(15_000.0, 60_000.0) as usize,
            near: random.between(0.5, 1.0),
            around: true,
            ..Self::draw(random)
        }
    }
}

/// A cloud whose truth is known.
#[derive(Debug, Clone)]
pub struct Labelled {
    /// Points in W, m.
    pub points: Vec<Point3<f64>>,
    /// The part that each point lies on; -1 for the surroundings.
    pub part: Vec<i32>,
    /// The view that each point comes from.
    pub view: Vec<usize>,
    /// Cameras, with the poses that the arm believes.
    pub cameras: Vec<Camera>,
    /// The object's pose.
    pub X_WF: Isometry3<f64>,
}

/// Places an object somewhere in the world, at any yaw, and looks at it with a camera on a wrist.
pub fn look(object: &Object, look: &Look, random: &mut Random) -> Labelled {
    look_with(object, look, random, &|camera, X_WF, surroundings| cast(camera, object, X_WF, surroundings))
}

/// What every pixel of a camera sees of something at a pose, and of what surrounds it.
pub type Seen<'a> = dyn Fn(&Camera, &Isometry3<f64>, &[Solid]) -> Vec<Option<Hit>> + 'a;

/// The same of something whose surface is not made of solids: `seen` says what a camera sees of it, `object` where it is and how it moves.
pub fn look_with(object: &Object, look: &Look, random: &mut Random, seen: &Seen<'_>) -> Labelled {
    let X_WF = Isometry3::from_parts(
        Translation3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.pick([0.0, 0.0, 0.75, 1.3])),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), random.between(-PI, PI)),
    );
    let (low, high) = object.bounds();
    let center = nalgebra::center(&low, &high);
    let radius = (high - low).norm() / 2.0;
    let surroundings = if look.surroundings { surroundings(object, &X_WF) } else { Vec::new() };
    let height = look.width * 3 / 4;
    let focal = look.width as f64 / (2.0 * (random.between(54.0_f64, 72.0).to_radians() / 2.0).tan());
    let fit = 0.9 * radius * focal / (height as f64 / 2.0);
    let side = random.pick([-1.0, 1.0]);
    // An arm that stands to one side of the front sees it from there.
    let (heading, breadth) = if look.around { (0.4 * random.normal(), random.between(0.3, 1.3)) } else { (0.0, 0.0) };
    let mut out = Labelled { points: Vec::new(), part: Vec::new(), view: Vec::new(), cameras: Vec::new(), X_WF };
    for v in 0..look.views {
        // The first view from about the front, further ones to its sides.
        let azimuth = match v {
            _ if look.around => (heading + random.between(-breadth, breadth)).clamp(-1.7, 1.7),
            0 => (0.45 * random.normal()).clamp(-1.0, 1.0),
            v => side * (if v % 2 == 1 { 0.55 } else { -0.55 }) + 0.25 * random.normal(),
        };
        let elevation = match object.category {
            Category::Box => random.between(0.3, 1.05),
            _ if look.around => random.between(-0.1, 0.95),
            _ => random.between(-0.1, 0.65),
        };
        let distance = (fit * random.between(0.75, 1.35) * look.near).clamp(0.45, 3.2);
        let away = Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        let mut jitter = Vector3::new(random.normal(), random.normal(), random.normal()) * (0.08 * radius);
        if look.near < 1.0 {
            // Who sees a part of it looks anywhere at it.
            let [x, y, z] = [low, high].map(|c| c - center)[1].map(|h| 0.7 * h * (1.0 - look.near)).into();
            jitter += Vector3::new(random.between(-x, x), random.between(-y, y), random.between(-z, z));
        }
        let from = X_WF * (center + away * distance);
        let at = X_WF * (center + jitter);
        let mut camera = Camera::looking(from, at, look.width, height, focal);
        let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.1 * random.normal());
        camera.X_WC.rotation *= roll;
        let image = seen(&camera, &X_WF, &surroundings);
        let image = look.noise.spoil(&camera, &image, random);
        camera.X_WC = look.noise.believed(&camera.X_WC, random);
        for (i, hit) in image.iter().enumerate() {
            let Some(hit) = hit else { continue };
            let p_C = camera.ray(i % camera.width, i / camera.width) * hit.depth;
            out.points.push(camera.X_WC * Point3::from(p_C));
            out.part.push(hit.part);
            out.view.push(v);
        }
        out.cameras.push(camera);
    }
    thin(&mut out, look.points, random);
    out
}

/// Keeps as many points as asked for, drawn without preference, in their order.
fn thin(cloud: &mut Labelled, count: usize, random: &mut Random) {
    let n = cloud.points.len();
    if n <= count {
        return;
    }
    let mut order: Vec<usize> = (0..n).collect();
    random.shuffle(&mut order);
    order.truncate(count);
    order.sort_unstable();
    cloud.points = order.iter().map(|&i| cloud.points[i]).collect();
    cloud.part = order.iter().map(|&i| cloud.part[i]).collect();
    cloud.view = order.iter().map(|&i| cloud.view[i]).collect();
}

/// The floor that an object stands on, in W. Its sides do not matter: it is far wider than what is seen.
fn surroundings(object: &Object, X_WF: &Isometry3<f64>) -> Vec<Solid> {
    let (low, _) = object.bounds();
    let at = X_WF.translation.vector;
    let floor = at.z + low.z;
    let wide = 2.0 * object.diagonal();
    vec![Solid::between([at.x - wide, at.y - wide, floor - 0.05], [at.x + wide, at.y + wide, floor - 0.001])]
}

impl Labelled {
    /// Axis and point of a joint of the object in W.
    pub fn joint(&self, joint: &crate::Joint) -> (Vector3<f64>, Point3<f64>) {
        (self.X_WF.rotation * joint.axis.into_inner(), self.X_WF * joint.origin)
    }

    /// The yaw of the object's front in W, rad.
    pub fn yaw(&self) -> f64 {
        Rotation3::from(self.X_WF.rotation).euler_angles().2
    }
}
