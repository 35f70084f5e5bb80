//! The answer as JSON.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;

/// What was found; lengths in m, angles in rad, in the input's frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Version of this layout.
    pub schema: u32,
    /// Does nothing move?
    pub rigid: bool,
    /// Why it is taken for rigid.
    pub reason: Option<String>,
    /// `world` or `camera`.
    pub frame: String,
    /// The body first.
    pub parts: Vec<PartReport>,
    /// One for each part but the body.
    pub joints: Vec<JointReport>,
    /// What is worth knowing.
    pub notes: Vec<String>,
    /// How long it took.
    pub seconds: Seconds,
}

/// A part.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PartReport {
    /// Its number in `parts.ply`.
    pub id: usize,
    /// Its link in the URDF.
    pub link: String,
    /// `body`, `door`, `drawer`, `lid` or `flap`.
    pub class: String,
    /// How likely its points overlap a true part's by three quarters (intersection over union), 0 to 1.
    pub confidence: f64,
    /// Number of input points.
    pub points: usize,
}

/// A joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointReport {
    /// Its name in the URDF.
    pub name: String,
    /// Parent link.
    pub parent: String,
    /// Child link.
    pub child: String,
    /// `revolute` or `prismatic`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Of the types.
    pub probabilities: Probabilities,
    /// Unit vector; positive motion opens.
    pub axis: [f64; 3],
    /// A point on the axis near the part.
    pub origin: [f64; 3],
    /// Least position: shut.
    pub lower: f64,
    /// Greatest position.
    pub upper: f64,
    /// Where it stands.
    pub state: f64,
    /// Standard deviations.
    pub uncertainty: Uncertainty,
    /// Other ways in which it may move, most likely first.
    pub alternatives: Vec<Alternative>,
}

/// Probabilities of joint types; they sum to one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Probabilities {
    /// It belongs to the body.
    pub fixed: f64,
    /// It turns.
    pub revolute: f64,
    /// It slides.
    pub prismatic: f64,
}

/// How far an axis may be off: one standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Uncertainty {
    /// Of its direction, degrees.
    pub axis_deg: f64,
    /// Of its place, m.
    pub origin_m: f64,
}

/// A runner-up.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alternative {
    /// `revolute` or `prismatic`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Unit vector.
    pub axis: [f64; 3],
    /// A point on it.
    pub origin: [f64; 3],
    /// Probability.
    pub probability: f64,
}

/// How long it took, s.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Seconds {
    /// Reading clouds and weights.
    pub load: f64,
    /// All.
    pub total: f64,
}

impl Report {
    /// Gives all joints in another frame F, by the pose of the present one in it.
    pub fn carry(&mut self, X_FW: &Isometry3<f64>, frame: &str) {
        let turn = |v: &mut [f64; 3]| *v = (X_FW.rotation * Vector3::from(*v)).into();
        let shift = |p: &mut [f64; 3]| *p = (X_FW * Point3::from(*p)).into();
        for joint in &mut self.joints {
            turn(&mut joint.axis);
            shift(&mut joint.origin);
            for a in &mut joint.alternatives {
                turn(&mut a.axis);
                shift(&mut a.origin);
            }
        }
        self.frame = frame.to_owned();
    }
}
