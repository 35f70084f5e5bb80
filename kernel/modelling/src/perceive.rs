//! The whole way: cloud to analysis, decision, links and joints, shapes, and the model that a simulator loads.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use sagci_model::{
    BarGrasp, Document, Geometry, GraspHint, Inertial, Joint, JointHypotheses, JointHypothesis, JointKind, JointLimits, Link, ObjectModel,
    Origin, Provenance, RefitTolerance, Shape,
};

use crate::ModellingError;
use crate::analysis::{Analysis, analyse};
use crate::decide::{Decided, Decision, decide};
use crate::first::WALLED;
use crate::handle::Handle;
use crate::motion::Motion;
use crate::moves::Moving;
use crate::network::Weights;
use crate::prepare::brought_near;
use crate::report::{Alternative, JointReport, PartReport, Probabilities, Report, Seconds, Uncertainty};
use crate::solid::{Shapes, Slab, behind, shapes};

/// Mean density of wood and sheet-metal boxes, kg/m^3, and the wall that is assumed where only a surface is seen, m.
const DENSITY: f64 = 600.0;
const WALL: f64 = 0.015;
/// Runner-ups less likely than this are not told.
const UNLIKELY: f64 = 0.03;

/// What was made of a cloud.
#[derive(Debug, Clone)]
pub struct Perceived {
    /// The answer; its times are the caller's to fill in.
    pub report: Report,
    /// Part of each input point; -1 for what is no part of the object.
    pub part: Vec<i32>,
    /// The model. Its root link's frame is the world's; joints are shut at zero.
    pub model: ObjectModel,
    /// Pose of the frame that the library gives its objects: on the ground amid the object, z up, the front along -y.
    pub X_WO: Isometry3<f64>,
    /// Metres to the input's unit of length.
    metres: f64,
}

/// Models the object whose cloud this is: points in a world frame with z up, of one or several views.
///
/// Errors: too few points, all in one plane, several objects, a size that cannot be, weights that do not fit.
pub fn perceive(cloud: &[Point3<f64>], name: &str, weights: &Weights) -> Result<Perceived, ModellingError> {
    let Some(by) = brought_near(cloud) else { return near(cloud, name, weights) };
    let moved: Vec<Point3<f64>> = cloud.iter().map(|p| p + by).collect();
    let mut found = near(&moved, name, weights)?;
    found.shift(&-by);
    Ok(found)
}

/// The same of a cloud near its origin.
fn near(cloud: &[Point3<f64>], name: &str, weights: &Weights) -> Result<Perceived, ModellingError> {
    let analyses = analyse(cloud)?;
    let Decided { analysis, label, decision } = decide(&analyses, weights)?;
    Ok(put_together(&analysis, &decision, &label, name))
}

fn put_together(analysis: &Analysis, decision: &Decision, of_point: &[Option<u32>], name: &str) -> Perceived {
    let part: Vec<i32> = analysis.of_input.iter().map(|i| i.and_then(|i| of_point[i as usize]).map_or(-1, |l| l as i32)).collect();
    let loose = |id: usize| -> Vec<Point3<f64>> {
        let own = |i: &usize| analysis.piece[*i].is_none() && of_point[*i] == Some(id as u32);
        (0..of_point.len()).filter(own).map(|i| analysis.points[i]).collect()
    };
    // Of each part the points as they came.
    let mut came: Vec<Vec<Point3<f64>>> = vec![Vec::new(); decision.parts.len() + 1];
    for (p, of) in analysis.dense.iter() {
        if let Some(own) = of_point[*of as usize].and_then(|l| came.get_mut(l as usize)) {
            own.push(*p);
        }
    }
    let mut counts = vec![0_usize; decision.parts.len() + 1];
    part.iter().filter_map(|p| usize::try_from(*p).ok()).for_each(|p| counts[p] += 1);
    let mut names: Vec<String> = vec!["body".to_owned()];
    for p in &decision.parts {
        let class = p.class.name();
        let number = names.iter().filter(|n| n.starts_with(class)).count() + 1;
        names.push(format!("{class}_{number}"));
    }
    let mut notes = analysis.notes.clone();
    let unit = 1.0 / analysis.factor;
    let in_part = |i: usize| decision.parts.iter().any(|p| p.pieces.contains(&i));
    let body: Vec<usize> = (0..analysis.superpoints.len()).filter(|i| !in_part(*i)).collect();
    let shut: Isometry3<f64> = Isometry3::identity();
    let mut of_body = shapes(analysis, &body, &loose(0), &came[0]);
    let moving = came[1..].concat();
    if of_body.mesh.triangles.is_empty() && !moving.is_empty() {
        notes.push("nothing of the body was seen: a board behind what moves stands for it".to_owned());
        of_body = behind(&moving, &decision.front);
    }
    let mut links = vec![link("body", &of_body, &shut, [0.75, 0.75, 0.75, 1.0])];
    let mut joints = Vec::new();
    let mut reports = Vec::new();
    let mut hypotheses = Vec::new();
    let mut grasps = Vec::new();
    for (k, p) in decision.parts.iter().enumerate() {
        let (Some(motion), link_name) = (p.motions.first(), &names[k + 1]) else { continue };
        let X_WL = at_state(motion);
        let hue = [[0.9, 0.5, 0.3, 1.0], [0.3, 0.6, 0.9, 1.0], [0.5, 0.8, 0.4, 1.0], [0.8, 0.7, 0.3, 1.0]][k % 4];
        let mut own = shapes(analysis, &p.pieces, &loose(k + 1), &came[k + 1]);
        // A hand closes on the handle, however few of its points were seen, and has room behind it: a lump's box would fill that.
        if let Some(h) = &p.handle {
            own.boxes.retain(|b| !fills(b, h));
            own.boxes.push(bar(h));
        }
        links.push(link(link_name, &own, &X_WL, hue));
        let joint = format!("{link_name}_{}", if motion.slides { "slide" } else { "hinge" });
        joints.push(Joint {
            name: joint.clone(),
            kind: if motion.slides { JointKind::Prismatic } else { JointKind::Revolute },
            parent: 0,
            child: k + 1,
            X_PJ: Translation3::from(motion.origin.coords).into(),
            axis: motion.axis,
            limits: JointLimits { lower: 0.0, upper: round(motion.upper), velocity: 2.0, effort: 50.0 },
            damping: 0.0,
            friction: 0.0,
            mimic: None,
        });
        hypotheses.push(told(&joint, p));
        grasps.extend(p.handle.as_ref().map(|h| grasp(link_name, h, &X_WL)));
        reports.push(joint_report(&joint, link_name, p, motion, unit));
    }
    let parts: Vec<PartReport> = (0..names.len())
        .map(|id| PartReport {
            id,
            link: names[id].clone(),
            class: if id == 0 { "body".to_owned() } else { decision.parts[id - 1].class.name().to_owned() },
            confidence: round(if id == 0 { decision.body_confidence } else { decision.parts[id - 1].confidence }),
            points: counts[id],
        })
        .collect();
    let rigid = decision.parts.is_empty();
    let reason = rigid.then(|| match decision.unproven {
        _ if decision.walled < WALLED => {
            format!("its surface is not made of walls: only {:.0} % of its points lie on any", 100.0 * decision.walled)
        }
        Some(moves) => format!(
            "a face of it could be a shut front, but nothing says so, no gap or step around it, no handle: it moves with a probability of {moves:.2}"
        ),
        None => format!(
            "no panel, drawer or lid was found that could move: of {} pieces of surface, the likeliest to be one has a probability of {:.2}",
            analysis.superpoints.len(),
            decision.doubt
        ),
    });
    if let Some(reason) = &reason {
        notes.push(reason.clone());
    }
    let document = Document {
        name: name.to_owned(),
        description: match rigid {
            true => "A rigid object, modelled from a point cloud.".to_owned(),
            false => format!("An object with {} moving parts, modelled from a point cloud.", decision.parts.len()),
        },
        movable: false,
        joint_hypotheses: hypotheses,
        grasps,
        // Masses follow from what is seen and a density that is guessed.
        refit_tolerance: RefitTolerance { mass: 0.7, center_of_mass: 0.1 },
        provenance: Provenance {
            licence: "Apache-2.0".to_owned(),
            attribution: "modelled from a point cloud".to_owned(),
            origins: vec![Origin { source: "sagci perceive".to_owned(), version: env!("CARGO_PKG_VERSION").to_owned() }],
            changes: notes.clone(),
        },
        ..Document::default()
    };
    let model = ObjectModel { name: name.to_owned(), folder: std::path::PathBuf::new(), links, joints, document };
    let report = Report { schema: 1, rigid, reason, frame: "world".to_owned(), parts, joints: reports, notes, seconds: Seconds::default() };
    Perceived { report, part, model, X_WO: stand(analysis, &decision.front), metres: analysis.factor }
}

/// Where the library's frame stands for an object with a front.
fn stand(analysis: &Analysis, front: &Vector3<f64>) -> Isometry3<f64> {
    let R_WA = analysis.R_AW.inverse();
    let middle = R_WA * nalgebra::center(&analysis.low, &analysis.high);
    // -y looks along the front.
    let yaw = front.x.atan2(-front.y);
    Isometry3::new(Vector3::new(middle.x, middle.y, analysis.low.z), Vector3::z() * yaw)
}

/// Six digits after the point: a micrometre. Zero has no sign.
fn round(x: f64) -> f64 {
    (x * 1e6).round() / 1e6 + 0.0
}

/// Pose in W of a link whose joint stands at its observed state: the joint's frame has the world's axes.
fn at_state(motion: &Motion) -> Isometry3<f64> {
    let at: Isometry3<f64> = Translation3::from(motion.origin.coords).into();
    match motion.slides {
        true => at * Translation3::from(motion.axis.into_inner() * motion.state),
        false => at * UnitQuaternion::from_axis_angle(&motion.axis, motion.state),
    }
}

fn joint_report(name: &str, child: &str, p: &Moving, motion: &Motion, unit: f64) -> JointReport {
    let three = |v: &Vector3<f64>| [v.x, v.y, v.z];
    let kind = |slides: bool| if slides { "prismatic" } else { "revolute" }.to_owned();
    let place = |m: &Motion| three(&(m.origin.coords * unit));
    let alternatives = p.motions[1..]
        .iter()
        .filter(|m| m.probability > UNLIKELY)
        .map(|m| Alternative { kind: kind(m.slides), axis: three(&m.axis), origin: place(m), probability: round(m.probability) })
        .collect();
    let [fixed, revolute, prismatic] = p.probabilities.map(round);
    JointReport {
        name: name.to_owned(),
        parent: "body".to_owned(),
        child: child.to_owned(),
        kind: kind(motion.slides),
        probabilities: Probabilities { fixed, revolute, prismatic },
        axis: three(&motion.axis),
        origin: place(motion),
        lower: 0.0,
        upper: round(motion.upper),
        state: round(motion.state),
        uncertainty: Uncertainty { axis_deg: round(p.uncertainty[0].to_degrees()), origin_m: round(p.uncertainty[1]) },
        alternatives,
    }
}

/// What the document keeps of a joint's doubts.
fn told(joint: &str, p: &Moving) -> JointHypotheses {
    let all = p.motions.iter().filter(|m| m.probability > UNLIKELY);
    JointHypotheses {
        joint: joint.to_owned(),
        axis_deviation: round(p.uncertainty[0]),
        origin_deviation: round(p.uncertainty[1]),
        ways: all
            .map(|m| JointHypothesis {
                kind: if m.slides { "prismatic" } else { "revolute" }.to_owned(),
                axis: [m.axis.x, m.axis.y, m.axis.z],
                origin: [m.origin.x, m.origin.y, m.origin.z],
                probability: round(m.probability),
            })
            .collect(),
    }
}

/// Does a box stand between a handle and its panel, or in the handle's own place?
fn fills(b: &Slab, h: &Handle) -> bool {
    let middle = nalgebra::center(&h.from, &h.to);
    let d = b.X_WG.translation.vector - middle.coords;
    let (out, across) = (d.dot(&h.outward), d - h.outward * d.dot(&h.outward));
    // The panel itself lies as far behind the handle as that stands off.
    out > -0.75 * h.off && across.norm() < 0.5 * (h.to - h.from).norm() + h.radius + 0.05
}

/// A handle as a box, in W.
fn bar(h: &Handle) -> Slab {
    let (along, length) = Unit::new_and_get(h.to - h.from);
    let e1 = if length > 1e-6 { along.into_inner() } else { h.outward.cross(&Vector3::z()).try_normalize(1e-6).unwrap_or(Vector3::y()) };
    let e0 = (h.outward - e1 * h.outward.dot(&e1)).try_normalize(1e-6).unwrap_or(h.outward);
    let R = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[e0, e1, e0.cross(&e1)]));
    let X_WG = Isometry3::from_parts(Translation3::from(nalgebra::center(&h.from, &h.to).coords), UnitQuaternion::from_rotation_matrix(&R));
    Slab { X_WG, half: Vector3::new(h.radius, length / 2.0 + h.radius, h.radius) }
}

/// A handle as a hint for grippers, in the frame of its link, which stands at `X_WL`.
fn grasp(link: &str, h: &Handle, X_WL: &Isometry3<f64>) -> GraspHint {
    let X_LW = X_WL.inverse();
    let point = |p: &Point3<f64>| (X_LW * p).coords.map(round).into();
    GraspHint::Bar(BarGrasp {
        name: format!("{link}_handle"),
        link: link.to_owned(),
        from: point(&h.from),
        to: point(&h.to),
        radius: round(h.radius),
        outward: Unit::new_normalize(X_LW.rotation * h.outward).into_inner().into(),
        // As far as a hand may turn before it touches the panel, were it as long as fingers are.
        swing: 0.8,
        depth: round((h.off - 0.002).max(0.005)),
    })
}

/// A link from its shapes in W; `X_WL` where it stands.
fn link(name: &str, shapes: &Shapes, X_WL: &Isometry3<f64>, rgba: [f64; 4]) -> Link {
    let X_LW = X_WL.inverse();
    let mut mesh = shapes.mesh.clone();
    mesh.vertices.iter_mut().for_each(|v| *v = X_LW * *v);
    let geometry = Geometry::Mesh { file: format!("meshes/{name}.stl").into(), scale: Vector3::repeat(1.0), mesh: Arc::new(mesh) };
    let visual = Shape { name: None, X_LG: Isometry3::identity(), geometry, rgba: Some(rgba) };
    let boxes: Vec<(Isometry3<f64>, &Slab)> = shapes.boxes.iter().map(|b| (X_LW * b.X_WG, b)).collect();
    let collisions = boxes
        .iter()
        .map(|(X_LG, b)| Shape { name: None, X_LG: *X_LG, geometry: Geometry::Box { half_extents: b.half }, rgba: None })
        .collect();
    Link { name: name.to_owned(), inertial: inertial(&boxes), visuals: vec![visual], collisions }
}

/// Mass, centre and inertia of boxes whose walls have a usual thickness and density.
fn inertial(boxes: &[(Isometry3<f64>, &Slab)]) -> Inertial {
    let walls: Vec<(f64, &Isometry3<f64>, Vector3<f64>)> = boxes
        .iter()
        .map(|(X, b)| {
            let mut sides = [b.half.x, b.half.y, b.half.z];
            sides.sort_by(f64::total_cmp);
            let half = b.half.map(|h| h.max(WALL / 2.0));
            // A sheet weighs its area; a lump no more than that of its shell.
            let area = 4.0 * sides[1].max(WALL / 2.0) * sides[2].max(WALL / 2.0);
            (DENSITY * WALL * area, X, half)
        })
        .collect();
    let mass: f64 = walls.iter().map(|w| w.0).sum::<f64>().max(0.05);
    let sum: f64 = walls.iter().map(|w| w.0).sum::<f64>().max(1e-9);
    let center = walls.iter().map(|(m, X, _)| X.translation.vector * (*m / sum)).sum::<Vector3<f64>>();
    let mut I = Matrix3::zeros();
    for (m, X, h) in &walls {
        let m = m * mass / sum;
        let own = Matrix3::from_diagonal(&Vector3::new(h.y * h.y + h.z * h.z, h.x * h.x + h.z * h.z, h.x * h.x + h.y * h.y)) * (m / 3.0);
        let R: Rotation3<f64> = X.rotation.to_rotation_matrix();
        let d = X.translation.vector - center;
        I += R.matrix() * own * R.matrix().transpose() + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * m;
    }
    if walls.is_empty() {
        I = Matrix3::identity() * 1e-5;
    }
    Inertial { mass, p_LoLcm: Point3::from(center), I_LLcm_L: (I + I.transpose()) / 2.0 }
}

/// Takes away what an earlier model with more parts left in a folder of meshes. Files by other names stay.
fn forget_meshes(folder: &Path, model: &ObjectModel) {
    let ours =
        |stem: &str| ["door_", "drawer_", "lid_", "flap_"].iter().filter_map(|c| stem.strip_prefix(c)).any(|n| n.parse::<u32>().is_ok());
    for path in std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let stale = path.extension().is_some_and(|e| e == "stl") && ours(&stem) && model.links.iter().all(|l| l.name != stem);
        // Where it cannot be removed it stays, and nothing refers to it.
        if stale {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Gives a model whose root's frame is W with that of F instead.
fn carry(model: &mut ObjectModel, X_FW: &Isometry3<f64>) {
    if let Some(root) = model.links.first_mut() {
        root.visuals.iter_mut().chain(&mut root.collisions).for_each(|s| s.X_LG = X_FW * s.X_LG);
        let R = X_FW.rotation.to_rotation_matrix();
        let I = R.matrix() * root.inertial.I_LLcm_L * R.matrix().transpose();
        root.inertial.p_LoLcm = X_FW * root.inertial.p_LoLcm;
        root.inertial.I_LLcm_L = (I + I.transpose()) / 2.0;
    }
    model.joints.iter_mut().filter(|j| j.parent == 0).for_each(|j| j.X_PJ = X_FW * j.X_PJ);
    for way in model.document.joint_hypotheses.iter_mut().flat_map(|h| &mut h.ways) {
        way.axis = (X_FW.rotation * Vector3::from(way.axis)).into();
        way.origin = (X_FW * Point3::from(way.origin)).coords.into();
    }
}

impl Perceived {
    /// The model with its root in the library's frame.
    pub fn standing(&self) -> ObjectModel {
        let mut model = self.model.clone();
        carry(&mut model, &self.X_WO.inverse());
        model
    }

    /// Gives all in a world that is moved by the opposite of a vector in the input's unit.
    fn shift(&mut self, by: &Vector3<f64>) {
        self.report.carry(&Translation3::from(*by).into(), "world");
        let X: Isometry3<f64> = Translation3::from(by * self.metres).into();
        carry(&mut self.model, &X);
        self.X_WO = X * self.X_WO;
    }

    /// Writes `object.urdf`, `meshes/`, `model.yaml`, `perception.json` and `parts.ply` into a folder. `input` is the cloud as it came.
    ///
    /// Errors: a file that cannot be written.
    pub fn write(&self, folder: &Path, input: &[Point3<f64>], json: &str) -> Result<(), ModellingError> {
        forget_meshes(&folder.join("meshes"), &self.model);
        self.model.write(folder)?;
        let path = folder.join("perception.json");
        std::fs::write(&path, json).map_err(|source| ModellingError::File { path: path.clone(), source })?;
        sagci_cloud::write_parts(&folder.join("parts.ply"), input, &self.part)?;
        Ok(())
    }
}
