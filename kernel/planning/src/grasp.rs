//! Ways of holding an object, from the hints in its model.
//!
//! A grasp is a frame `F` on a link and the tool's pose `X_FT` in it, with one freedom between them: a hand on a bar may
//! turn about the bar (`F`'s x axis), a hand on a rim may lean along the rim (about `F`'s y axis, the way the fingers
//! close). Tool axes: z out between the fingers, y along their opening, so x lies along a bar and along a rim's tangent.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use sagci_model::{BarGrasp, GraspHint, Gripper, ObjectModel, RimGrasp};

use crate::{Freedom, PlanError};

/// One way of holding one link.
#[derive(Debug, Clone)]
pub struct Grasp {
    /// Name of the hint that it comes from.
    pub name: String,
    /// Index of the held link.
    pub link: usize,
    /// The grasp's frame in the link's.
    pub X_LF: Isometry3<f64>,
    /// The tool in the grasp's frame, at zero freedom.
    pub X_FT: Isometry3<f64>,
    /// Axis of the freedom, in `F`.
    pub axis: Unit<Vector3<f64>>,
    /// Its range, rad.
    pub range: [f64; 2],
    /// Opening of the gripper on the way in, m.
    pub width: f64,
    /// Opening once it is shut on the link, m.
    pub hold_width: f64,
    /// What the fingers close on: those solids of the link that are within the distance of the line, in the link's frame.
    pub held_part: Option<(Point3<f64>, Point3<f64>, f64)>,
    /// 0..1, higher is better, from the hint's own preferences alone.
    pub quality: f64,
}

/// How finely grasps are drawn from hints.
#[derive(Debug, Clone)]
pub struct GraspOptions {
    /// Places along a bar.
    pub bar_places: usize,
    /// Leans of the hand across a bar: pads are flat, so a bar may cross them at an angle, rad.
    pub bar_leans: Vec<f64>,
    /// Angles around a rim.
    pub rim_angles: usize,
    /// Greatest opening of the gripper beyond what is held, m.
    pub opening: f64,
    /// Distance between neighbouring places along a bar at most, m; few places suffice on a short bar.
    pub spacing: f64,
}

impl Default for GraspOptions {
    fn default() -> Self {
        Self { bar_places: 3, bar_leans: vec![0.0, 0.45, -0.45, 0.8, -0.8], rim_angles: 24, opening: 0.03, spacing: 0.04 }
    }
}

impl Grasp {
    /// The freedom for path search: goals are then poses of `F`.
    pub fn freedom(&self) -> Freedom {
        self.freedom_behind(0.0)
    }

    /// As [`Self::freedom`], with the tool `back` metres behind the grasp along its own z axis.
    pub fn freedom_behind(&self, back: f64) -> Freedom {
        let X_FT = self.X_FT * Translation3::new(0.0, 0.0, -back);
        // with_freedom turns F itself: X_WT = X_WF exp([axis] s) X_FT.
        Freedom { X_TF: X_FT.inverse(), axis: self.axis, slides: false, range: self.range }
    }

    /// Pose of the tool in the link's frame, with the freedom at `s`.
    pub fn X_LT(&self, s: f64) -> Isometry3<f64> {
        self.X_LF * UnitQuaternion::from_axis_angle(&self.axis, s) * self.X_FT
    }

    /// Pose of the grasp's frame in the world, for an object at `X_WO` with its joints at `q`.
    pub fn X_WF(&self, model: &ObjectModel, X_WO: &Isometry3<f64>, q: &[f64]) -> Isometry3<f64> {
        X_WO * model.X_OL(q)[self.link] * self.X_LF
    }

    /// Pose of the tool in the world.
    pub fn X_WT(&self, model: &ObjectModel, X_WO: &Isometry3<f64>, q: &[f64], s: f64) -> Isometry3<f64> {
        X_WO * model.X_OL(q)[self.link] * self.X_LT(s)
    }

    /// Pose of the object in the tool frame once it is held.
    pub fn X_TO(&self, model: &ObjectModel, q: &[f64], s: f64) -> Isometry3<f64> {
        (model.X_OL(q)[self.link] * self.X_LT(s)).inverse()
    }
}

/// All grasps that a model's hints allow this gripper, best first. `link` keeps only those on one link.
///
/// # Errors
/// [`PlanError::ModelLacks`] if there is no hint, a hint names an unknown link or is not finite, or the gripper does
/// not open far enough for any of them.
pub fn grasps(model: &ObjectModel, link: Option<usize>, gripper: &Gripper, options: &GraspOptions) -> Result<Vec<Grasp>, PlanError> {
    let lacks = |message: String| PlanError::ModelLacks { model: model.name.clone(), message };
    let mut out = Vec::new();
    let mut too_wide = Vec::new();
    let mut hints = 0;
    for hint in &model.document.grasps {
        let on = model
            .link(hint.link())
            .ok_or_else(|| lacks(format!("grasp '{}' is on link '{}', which is not there", hint.name(), hint.link())))?;
        if link.is_some_and(|l| l != on) {
            continue;
        }
        hints += 1;
        let thickness = match hint {
            GraspHint::Bar(bar) => 2.0 * bar.radius,
            GraspHint::Rim(rim) => rim.thickness,
        };
        // Room for the pose's error on both sides.
        if thickness + 0.006 > gripper.max_width {
            too_wide.push(format!("'{}' is {:.0} mm wide", hint.name(), 1e3 * thickness));
            continue;
        }
        let before = out.len();
        match hint {
            GraspHint::Bar(bar) => bar_grasps(bar, on, gripper, options, &mut out),
            GraspHint::Rim(rim) => rim_grasps(rim, on, gripper, options, &mut out),
        }
        if out[before..].iter().any(|g| !g.X_LF.translation.vector.iter().chain(g.X_LF.rotation.coords.iter()).all(|x| x.is_finite())) {
            return Err(lacks(format!("grasp '{}' has a direction of no length or a number that is not finite", hint.name())));
        }
    }
    if out.is_empty() {
        let part = link.and_then(|l| model.links.get(l)).map_or(String::from("it"), |l| format!("link '{}'", l.name));
        return Err(lacks(if hints == 0 {
            format!("has no grasp hint for {part}; add one under `grasps` in model.yaml")
        } else if too_wide.is_empty() {
            format!("its grasp hints for {part} leave no free direction")
        } else {
            format!("the gripper opens {:.0} mm, and {}", 1e3 * gripper.max_width, too_wide.join(", "))
        }));
    }
    out.sort_by(|a, b| b.quality.total_cmp(&a.quality));
    Ok(out)
}

/// Frame with x and z along the given directions; z is made square to x.
fn frame(origin: Point3<f64>, x: Vector3<f64>, z: Vector3<f64>) -> Isometry3<f64> {
    let x = x.normalize();
    let z = (z - x * x.dot(&z)).normalize();
    let y = z.cross(&x);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z]));
    Isometry3::from_parts(Translation3::from(origin.coords), UnitQuaternion::from_rotation_matrix(&rotation))
}

fn bar_grasps(bar: &BarGrasp, link: usize, gripper: &Gripper, options: &GraspOptions, out: &mut Vec<Grasp>) {
    let (from, to) = (Point3::from(bar.from), Point3::from(bar.to));
    let outward = Vector3::from(bar.outward);
    let along = to - from;
    let [pad_x, pad_z] = gripper.pad_half_extents;
    // Whole pads on the bar where it is long enough.
    let inset = pad_x.min(0.5 * along.norm()) / along.norm();
    let usable = along.norm() * (1.0 - 2.0 * inset);
    let places = options.bar_places.min(1 + (usable / options.spacing).floor() as usize).max(1);
    for place in 0..places {
        // The middle first, then outward on both sides.
        let offset = if places == 1 { 0.0 } else { place as f64 / (places - 1) as f64 - 0.5 };
        let point = from + along * (0.5 + offset * (1.0 - 2.0 * inset));
        for (way, lean) in [1.0, -1.0].into_iter().flat_map(|w| options.bar_leans.iter().map(move |l| (w, *l))) {
            // Tips must not reach deeper behind the bar than there is room.
            let reach = pad_z * f64::cos(lean) + pad_x * f64::sin(lean).abs();
            let ahead = (bar.depth - reach).min(0.0).max(-0.6 * pad_z);
            let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), lean);
            out.push(Grasp {
                name: bar.name.clone(),
                link,
                X_LF: frame(point, along * way, -outward),
                X_FT: Isometry3::translation(0.0, 0.0, ahead) * turn,
                axis: Vector3::x_axis(),
                range: [-bar.swing.abs(), bar.swing.abs()],
                width: (2.0 * bar.radius + options.opening).min(gripper.max_width),
                hold_width: 2.0 * bar.radius,
                held_part: Some((from, to, 0.5 * bar.radius)),
                quality: 1.0 - 0.3 * offset.abs() - 0.2 * lean.abs(),
            });
        }
    }
}

fn rim_grasps(rim: &RimGrasp, link: usize, gripper: &Gripper, options: &GraspOptions, out: &mut Vec<Grasp>) {
    let axis = Vector3::from(rim.axis).normalize();
    let reference = if axis.x.abs() > 0.99 { Vector3::y() } else { Vector3::x() };
    let e1 = (reference - axis * axis.dot(&reference)).normalize();
    let e2 = axis.cross(&e1);
    let [pad_x, pad_z] = gripper.pad_half_extents;
    // Tool origin below the edge: the whole pad if there is depth for it also when the hand leans.
    let reach = pad_x.hypot(pad_z);
    let below = (rim.depth - reach).clamp(0.3 * pad_z, pad_z + 0.004).min(rim.depth.max(0.0));
    let (mid, tilt) = (Point3::from(rim.center), rim.tilt.abs());
    for k in 0..options.rim_angles {
        let angle = TAU * k as f64 / options.rim_angles as f64;
        if rim
            .blocked
            .iter()
            .any(|[at, half]| (angle - at + PI).rem_euclid(TAU) - PI <= *half && (angle - at + PI).rem_euclid(TAU) - PI >= -*half)
        {
            continue;
        }
        let radial = e1 * angle.cos() + e2 * angle.sin();
        let point = mid + radial * rim.radius - axis * below;
        let tangent = axis.cross(&radial);
        for way in [1.0, -1.0] {
            out.push(Grasp {
                name: rim.name.clone(),
                link,
                X_LF: frame(point, tangent * way, -axis),
                X_FT: Isometry3::identity(),
                axis: Vector3::y_axis(),
                range: [-tilt, tilt],
                width: (rim.thickness + options.opening).min(gripper.max_width),
                hold_width: rim.thickness,
                held_part: Some((point - axis * pad_z, point + axis * below, rim.thickness + 2.0 * pad_x)),
                quality: 1.0,
            });
        }
    }
}
