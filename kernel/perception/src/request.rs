use nalgebra::{Isometry3, Matrix6};
use sagci_model::ObjectModel;

/// Asks where one object is.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// Its name in the scene, for messages.
    pub name: &'a str,
    /// Its stored model.
    pub model: &'a ObjectModel,
    /// Where it may be.
    pub prior: Prior,
    /// Which way its root link may move from the prior.
    pub freedom: Freedom,
    /// Positions of its moving joints as believed, in the model's order; rad or m.
    pub q: Vec<f64>,
    /// The joints whose positions are to be estimated as well; the others are taken from `q`.
    pub joints: Vec<JointSearch>,
}

/// Where an object may be before it is seen.
#[derive(Debug, Clone, PartialEq)]
pub enum Prior {
    /// Near a pose.
    Near {
        /// The pose of the root link in the world.
        X_WO: Isometry3<f64>,
        /// Greatest distance from it along each of the world's axes x and y, m.
        shift: f64,
        /// Greatest turn about the vertical, rad.
        yaw: f64,
    },
    /// Standing upright on the floor of a box, at any yaw.
    Region {
        /// Pose of the box's centre in the world; its z axis points up.
        X_WG: Isometry3<f64>,
        /// Full extents of the box, m.
        size: [f64; 3],
    },
}

/// Which way the root link may move from the prior.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freedom {
    /// Not at all: the pose is known, only joints are estimated.
    Held,
    /// It stands: x, y and yaw are free, and z by millimetres.
    Standing,
    /// All six.
    Free,
}

/// A joint whose position is estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSearch {
    /// Its place in `q`: the order of [`ObjectModel::moving_joints`].
    pub slot: usize,
    /// Least position that is considered, rad or m.
    pub lower: f64,
    /// Greatest position that is considered, rad or m.
    pub upper: f64,
}

impl<'a> Request<'a> {
    /// The usual request: it stands within 0.1 m and 15 degrees of a pose, its joints as believed.
    pub fn near(name: &'a str, model: &'a ObjectModel, X_WO: Isometry3<f64>, q: Vec<f64>) -> Self {
        let prior = Prior::Near { X_WO, shift: 0.1, yaw: 15f64.to_radians() };
        Self { name, model, prior, freedom: Freedom::Standing, q, joints: Vec::new() }
    }

    /// Estimates one joint over its whole range, with the root link held where it is believed to be.
    pub fn joint(name: &'a str, model: &'a ObjectModel, X_WO: Isometry3<f64>, q: Vec<f64>, slot: usize) -> Self {
        let limits = model.moving_joints().nth(slot).and_then(|j| model.joints.get(j)).map(|j| j.limits);
        let (lower, upper) = limits.map_or((0.0, 0.0), |l| (l.lower.max(-std::f64::consts::PI), l.upper.min(std::f64::consts::PI)));
        let prior = Prior::Near { X_WO, shift: 0.0, yaw: 0.0 };
        Self { name, model, prior, freedom: Freedom::Held, q, joints: vec![JointSearch { slot, lower, upper }] }
    }
}

/// Where one object was found, and how well that is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// Pose of its root link in the world.
    pub X_WO: Isometry3<f64>,
    /// Positions of its moving joints, in the model's order.
    pub q: Vec<f64>,
    /// Covariance of the pose (turn, then shift; rad and m), about the world's axes at the object's origin. It holds the
    /// prior where the images say nothing, and the spread of rival poses that explain the images about as well.
    pub covariance: Matrix6<f64>,
    /// Standard deviation of each position in `q`, rad or m; 0 for those that were not estimated.
    pub q_deviation: Vec<f64>,
    /// Root mean square distance of the points that agree to the surface, along its normal, m.
    pub residual_rms: f64,
    /// Share of the surface that should be seen and agrees with the images, 0..1.
    pub inlier_share: f64,
    /// Share of the surface that should be seen and that rays went through, 0..1.
    pub violated_share: f64,
    /// Share of the camera-facing surface that is not hidden and lies inside the images, 0..1.
    pub visible_share: f64,
    /// Number of pixels that agree.
    pub pixels: usize,
    /// Number of distinct poses that explain the images about as well, the returned one included.
    pub rivals: usize,
}

/// One object of a scene that is to be located.
#[derive(Debug, Clone)]
pub struct SceneRequest<'a> {
    /// Its name in the scene, unique.
    pub name: String,
    /// Its stored model.
    pub model: &'a ObjectModel,
    /// Where it may be.
    pub place: Place,
    /// Which way its root link may move from the prior.
    pub freedom: Freedom,
    /// Positions of its moving joints as believed, in the model's order.
    pub q: Vec<f64>,
    /// The joints whose positions are to be estimated as well.
    pub joints: Vec<JointSearch>,
}

/// Where an object of a scene may be.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// As for one object.
    Prior(Prior),
    /// Standing in a region of another object of the same scene, which is located first.
    Inside {
        /// Name of the other object.
        object: String,
        /// Name of the region; the first one if not given.
        region: Option<String>,
    },
}
