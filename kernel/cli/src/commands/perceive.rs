use std::path::Path;
use std::time::Instant;

use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Rotation3, Translation3, UnitQuaternion};
use sagci_modelling::{Lens, Perceived, Report, Weights};
use serde::Deserialize;

use crate::arguments::{Format, Perceive};
use crate::commands::print;
use crate::error::CliError;
use crate::place;
use crate::table::table;

fn wrong(e: impl std::fmt::Display) -> CliError {
    CliError::Other(e.to_string())
}

/// The networks' weights: of a file, or those that ship.
pub fn weights_of(file: Option<&Path>) -> Result<Weights, CliError> {
    match file {
        Some(path) => Weights::read(path),
        None => Weights::shipped(),
    }
    .map_err(wrong)
}

/// Where the camera was.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Cameras {
    views: Vec<CameraView>,
    /// In which frame the clouds are.
    #[serde(default)]
    frame: CloudFrame,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum CloudFrame {
    #[default]
    World,
    Camera,
}

/// One view. Only the pose is needed; the image's size and lens say how far a view was cut off.
#[derive(Debug, Deserialize)]
struct CameraView {
    X_WC: [[f64; 4]; 4],
    width: Option<f64>,
    height: Option<f64>,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
}

/// A rigid transform from its rows.
fn pose(rows: &[[f64; 4]; 4], view: usize) -> Result<Isometry3<f64>, CliError> {
    let M = Matrix4::from_fn(|i, j| rows[i][j]);
    let R: Matrix3<f64> = M.fixed_view::<3, 3>(0, 0).into_owned();
    let straight = (R * R.transpose() - Matrix3::identity()).norm() < 1e-3 && R.determinant() > 0.0;
    if !M.iter().all(|x| x.is_finite()) || !straight || (M.row(3) - nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0)).norm() > 1e-6 {
        let message = format!("the X_WC of view {view} is no rigid transform: its rotation must be orthonormal, its last row 0 0 0 1");
        return Err(CliError::Other(message));
    }
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_eps(&R, 1e-12, 50, Rotation3::identity()));
    Ok(Isometry3::from_parts(Translation3::new(M[(0, 3)], M[(1, 3)], M[(2, 3)]), q))
}

impl CameraView {
    /// Its lens; none where the view does not say its size and focal lengths.
    fn lens(&self) -> Option<Lens> {
        let size = [self.width?, self.height?];
        let center = [self.cx.unwrap_or(size[0] / 2.0), self.cy.unwrap_or(size[1] / 2.0)];
        Some(Lens { size, focal: [self.fx?, self.fy?], center })
    }
}

fn cameras(path: &Path, clouds: usize) -> Result<(Vec<Isometry3<f64>>, Cameras), CliError> {
    let text = std::fs::read_to_string(path).map_err(|source| CliError::File { path: path.to_owned(), source })?;
    let cameras: Cameras = serde_json::from_str(&text).map_err(|e| CliError::Other(format!("{}: {e}", path.display())))?;
    if cameras.views.len() != clouds {
        let message = format!("{}: has {} views for {clouds} clouds; give one for each, in order", path.display(), cameras.views.len());
        return Err(CliError::Other(message));
    }
    let poses = cameras.views.iter().enumerate().map(|(i, v)| pose(&v.X_WC, i + 1)).collect::<Result<_, _>>()?;
    Ok((poses, cameras))
}

/// `sagci perceive`.
pub fn perceive(arguments: &Perceive) -> Result<bool, CliError> {
    let start = Instant::now();
    let stem = arguments.clouds.first().and_then(|p| p.file_stem()).map(|s| s.to_string_lossy().into_owned());
    let name = arguments.name.clone().or(stem).unwrap_or_else(|| "object".to_owned());
    if let Some(folder) = arguments.out.as_deref().filter(|f| f.exists() && !f.is_dir()) {
        return Err(CliError::Other(format!("{}: is a file; --out takes a folder", folder.display())));
    }
    let library = if arguments.save { Some(place::library(&arguments.places, None)?) } else { None };
    let told = arguments.camera_pose.as_deref().map(|p| cameras(p, arguments.clouds.len())).transpose()?;
    let poses = told.as_ref().map(|(poses, cameras)| (poses, cameras.frame));
    let weights = weights_of(arguments.weights.as_deref())?;
    let mut input: Vec<Point3<f64>> = Vec::new();
    let mut world: Vec<Point3<f64>> = Vec::new();
    for (i, path) in arguments.clouds.iter().enumerate() {
        let points = sagci_cloud::read(path).map_err(wrong)?;
        match &poses {
            Some((X_WC, CloudFrame::Camera)) => world.extend(points.iter().map(|p| X_WC[i] * p)),
            _ => world.extend(&points),
        }
        input.extend(points);
    }
    let load = start.elapsed().as_secs_f64();
    let mut found = sagci_modelling::perceive(&world, &name, &weights).map_err(|e| {
        let all: Vec<String> = arguments.clouds.iter().map(|p| p.display().to_string()).collect();
        wrong(format!("{}: {e}", all.join(", ")))
    })?;
    if let Some((poses, cameras)) = &told {
        let views: Vec<_> = poses.iter().copied().zip(cameras.views.iter().map(CameraView::lens)).collect();
        found.note_cut_offs(&world, &views);
    }
    drop(world);
    // One cloud in its camera's frame is answered in that frame; several have none in common but the world's.
    if let Some((X_WC, CloudFrame::Camera)) = &poses {
        match &X_WC[..] {
            [X] => found.report.carry(&X.inverse(), "camera"),
            _ => found.report.notes.push("several views in their cameras' frames: joints are given in the world's".to_owned()),
        }
    }
    found.report.seconds.load = load;
    found.report.seconds.total = start.elapsed().as_secs_f64();
    let json = serde_json::to_string_pretty(&found.report).map_err(wrong)? + "\n";
    if let Some(folder) = &arguments.out {
        found.write(folder, &input, &json).map_err(wrong)?;
    }
    if let Some(library) = library {
        // What is stored stands where the library's objects stand; the evidence says where it was seen.
        let evidence = [sagci_library::Evidence { name: "perception.json".into(), bytes: json.clone().into_bytes() }];
        let version = library.publish_model(&name, &found.standing(), &evidence).map_err(wrong)?;
        eprintln!("saved as version {version} of {name}");
    }
    match arguments.format {
        Format::Json => print(&json),
        Format::Text => print(&text(&name, &found)),
    }
    Ok(true)
}

fn text(name: &str, found: &Perceived) -> String {
    let r: &Report = &found.report;
    let mut out = match &r.reason {
        Some(reason) => format!("{name}: rigid, since {reason}\n"),
        None => format!("{name}: {} moving parts\n", r.joints.len()),
    };
    let mut rows =
        vec![["part", "class", "points", "confidence", "joint", "stands at", "opens to", "probability"].map(str::to_owned).to_vec()];
    for part in &r.parts {
        let joint = r.joints.iter().find(|j| j.child == part.link);
        let of = |f: &dyn Fn(&sagci_modelling::JointReport) -> String| joint.map(f).unwrap_or_default();
        let unit = |j: &sagci_modelling::JointReport, x: f64| match j.kind.as_str() {
            "revolute" => format!("{:.0} deg", x.to_degrees()),
            _ => format!("{x:.3} m"),
        };
        rows.push(vec![
            part.link.clone(),
            part.class.clone(),
            part.points.to_string(),
            format!("{:.2}", part.confidence),
            of(&|j| j.kind.clone()),
            of(&|j| unit(j, j.state)),
            of(&|j| unit(j, j.upper)),
            of(&|j| format!("{:.2}", f64::max(j.probabilities.revolute, j.probabilities.prismatic))),
        ]);
    }
    out += &table(&rows);
    for note in &r.notes {
        out += &format!("note: {note}\n");
    }
    out.push_str(&format!("{:.2} s\n", r.seconds.total));
    out
}
