//! Robust registration: Gauss-Newton on the distances of the cloud's points to the surface.
//!
//! For a cloud point `p` matched to the surface point `s` with normal `n`, the residual is `n . (p - s)` (point to
//! plane; Chen and Medioni 1992), weighted by Tukey's biweight. First `s` is the nearest surface point, which converges
//! from afar; at the end it is where the pixel's ray meets the surface, which is what the camera measured: thin walls and
//! edges then bias nothing. Where a point lies beside the surface's edge, and where a ray went past an edge of the
//! surface, the distance across is a residual too, known to about a pixel: silhouettes hold the directions that flat faces
//! leave free.

use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};

use crate::evidence::outline;
use crate::frame::median;
use crate::hypothesis::{Hypothesis, Placed};
use crate::problem::{Problem, Resolution};

/// Tukey's constant for 95 % efficiency with normal noise.
const TUKEY: f64 = 4.685;
/// Least standard deviation of a residual, m: stored surfaces are true to this.
const LEAST_DEVIATION: f64 = 0.001;

/// A hypothesis after registration.
pub(crate) struct Aligned {
    pub hypothesis: Hypothesis,
    /// Inverse covariance of all parameters, prior included.
    pub information: DMatrix<f64>,
    /// Root mean square residual along the normals of the points that agree, m.
    pub rms: f64,
    /// Number of pixels that err together.
    pub area: f64,
}

/// How far to look and how often.
pub(crate) struct Stage {
    /// Greatest distance of a match, m.
    pub radius: f64,
    /// Iterations.
    pub rounds: usize,
    /// What is matched.
    pub matching: Matching,
}

/// What is matched to the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Matching {
    /// The thinned cloud, to the nearest surface points.
    Thinned,
    /// The pixels, to the nearest surface points.
    Nearest,
    /// The pixels, to where their rays meet the surface.
    Rays,
}

/// Pixels that are matched at most, of all views together and of each one.
const NEAREST_PIXELS: usize = 5000;
const RAYS: f64 = 2000.0;
/// Neighbouring pixels err together; before it is measured, this many of them count as one.
const CORRELATED: f64 = 9.0;

struct Normal {
    H: DMatrix<f64>,
    g: DVector<f64>,
    row: Vec<f64>,
}

impl Normal {
    fn add(&mut self, residual: f64, weight: f64, free: &[usize]) {
        for (a, &i) in free.iter().enumerate() {
            let wi = weight * self.row[i];
            self.g[a] += wi * residual;
            for (b, &j) in free.iter().enumerate().take(a + 1) {
                self.H[(a, b)] += wi * self.row[j];
            }
        }
    }
}

/// Refines a hypothesis through the stages.
pub(crate) fn align(problem: &Problem<'_>, start: &Hypothesis, stages: &[Stage]) -> Aligned {
    let mut hypothesis = start.clone();
    let mut last = None;
    for stage in stages {
        for _ in 0..stage.rounds {
            let (next, step, information, rms, area) = step(problem, &hypothesis, stage);
            hypothesis = next;
            last = Some((information, rms, area));
            if step < 1e-5 {
                break;
            }
        }
    }
    let (information, rms, area) = last.unwrap_or_else(|| (problem.prior_information.clone(), 0.0, 1.0));
    Aligned { hypothesis, information, rms, area }
}

struct Residual {
    link: usize,
    point: Point3<f64>,
    normal: Vector3<f64>,
    /// Distance along the normal; nothing for a point beside the surface.
    along: Option<f64>,
    across: Vector3<f64>,
    weight: f64,
    deviation: f64,
    /// The cloud's point, and the frame and pixel it is of.
    seen: Point3<f64>,
    pixel: Option<(usize, usize, usize)>,
}

/// The residuals of one round, and the spacing of the pixels of each frame that they are of.
struct Residuals {
    all: Vec<Residual>,
    strides: Vec<usize>,
}

fn nearest(problem: &Problem<'_>, placed: &Placed, X_DW: &[Isometry3<f64>], stage: &Stage) -> Residuals {
    let resolution: &Resolution = if stage.radius > 2.0 * problem.coarse.spacing { &problem.coarse } else { &problem.fine };
    let mut all = Vec::new();
    let mut push = |seen: Point3<f64>, normal: &Vector3<f64>, weight, deviation, pixel| {
        if let Some(m) = problem.matched(resolution, &placed.X_WL, &[], &seen, normal, stage.radius) {
            let across = beside(&m.across, resolution.spacing);
            all.push(Residual {
                link: m.link,
                point: m.point,
                normal: m.normal,
                along: Some(m.along),
                across,
                weight,
                deviation,
                seen,
                pixel,
            });
        }
    };
    if stage.matching == Matching::Thinned {
        for t in &problem.thinned {
            push(t.point, &t.normal, t.weight, 0.005, None);
        }
    } else {
        let moved: Vec<Isometry3<f64>> = problem.frames.iter().zip(X_DW).map(|(f, X)| (f.X_WC * X).inverse()).collect();
        let every = problem.pixels.len().div_ceil(NEAREST_PIXELS).max(1);
        for &(f, i) in problem.pixels.iter().step_by(every) {
            let p = &problem.frames[f].pixels[i];
            let point = moved[f] * p.point;
            let footprint = problem.frames[f].footprint((X_DW[f] * point).z);
            push(point, &(moved[f] * p.normal), every as f64, footprint, Some((f, p.column, p.row)));
        }
    }
    Residuals { all, strides: Vec::new() }
}

/// What a vector across the surface leaves beyond the spacing of its samples.
fn beside(across: &Vector3<f64>, spacing: f64) -> Vector3<f64> {
    let length = across.norm();
    if length > 1.5 * spacing { across * (1.0 - spacing / length) } else { Vector3::zeros() }
}

fn along_rays(problem: &Problem<'_>, placed: &Placed, X_DW: &[Isometry3<f64>], stage: &Stage) -> Residuals {
    let mut all = Vec::new();
    let mut strides = Vec::new();
    for (f, (frame, X_DW)) in problem.frames.iter().zip(X_DW).enumerate() {
        let X_WD = X_DW.inverse();
        let moved = X_WD * frame.X_WC.inverse();
        let eye = Point3::from(X_WD.translation.vector);
        let Some([left, right, top, bottom]) = outline(problem, &placed.X_WL, frame, X_DW) else {
            strides.push(1);
            continue;
        };
        let inside = |x: f64, most: usize| x.clamp(0.0, most as f64 - 1.0) as usize;
        let columns = inside(left, frame.width)..=inside(right, frame.width);
        let rows = inside(top, frame.height)..=inside(bottom, frame.height);
        let area = (columns.end() - columns.start() + 1) as f64 * (rows.end() - rows.start() + 1) as f64;
        let stride = (area / RAYS).sqrt().ceil().max(1.0) as usize;
        strides.push(stride);
        let weight = (stride * stride) as f64;
        for row in rows.step_by(stride) {
            for column in columns.clone().step_by(stride) {
                let measured = frame.depth[row * frame.width + column];
                if measured <= 0.0 {
                    continue;
                }
                let ray = X_WD * frame.ray_C(column as f64, row as f64);
                let seen = eye + ray * measured;
                let pixel = Some((f, column, row));
                let deviation = frame.footprint(measured);
                if let Some(hit) = problem.surface.cast(&placed.X_WL, &eye, &ray, measured + 1.0) {
                    let along = hit.normal.dot(&ray) * (measured - hit.distance);
                    if along.abs() < stage.radius && (measured - hit.distance).abs() < 4.0 * stage.radius {
                        let point = eye + ray * hit.distance;
                        let across = Vector3::zeros();
                        all.push(Residual {
                            link: hit.link,
                            point,
                            normal: hit.normal,
                            along: Some(along),
                            across,
                            weight,
                            deviation,
                            seen,
                            pixel,
                        });
                    }
                } else if let Some(p) = frame.pixels.get(frame.slot[row * frame.width + column] as usize) {
                    let m = problem.matched(&problem.fine, &placed.X_WL, &[], &seen, &(moved * p.normal), stage.radius);
                    if let Some(m) = m.filter(|m| m.along.abs() < stage.radius / 2.0) {
                        let across = beside(&m.across, problem.fine.spacing);
                        if across != Vector3::zeros() {
                            all.push(Residual {
                                link: m.link,
                                point: m.point,
                                normal: m.normal,
                                along: None,
                                across,
                                weight,
                                deviation,
                                seen,
                                pixel,
                            });
                        }
                    }
                }
            }
        }
    }
    Residuals { all, strides }
}

fn step(problem: &Problem<'_>, at: &Hypothesis, stage: &Stage) -> (Hypothesis, f64, DMatrix<f64>, f64, f64) {
    let placed = problem.placed(at);
    let X_DW: Vec<Isometry3<f64>> = problem.frames.iter().map(|f| at.X_DW(&f.X_WC)).collect();
    let residuals = match stage.matching {
        Matching::Thinned | Matching::Nearest => nearest(problem, &placed, &X_DW, stage),
        Matching::Rays => along_rays(problem, &placed, &X_DW, stage),
    };

    let size = 12 + problem.request.joints.len();
    // Only where every pixel is told apart from the others can the camera be told from the object.
    let mut free = problem.free.clone();
    if stage.matching == Matching::Rays {
        free.extend(size - 6..size);
    }
    let free = &free;
    let n = free.len();
    let mut normal = Normal { H: DMatrix::zeros(n, n), g: DVector::zeros(n), row: vec![0.0; size] };

    let mut distances: Vec<f64> = residuals.all.iter().filter_map(|r| r.along.map(f64::abs)).collect();
    let deviation = (1.4826 * median(&mut distances).unwrap_or(LEAST_DEVIATION)).max(LEAST_DEVIATION);
    let cut = TUKEY * deviation;
    let (mut squares, mut count) = (0.0, 0.0);
    for r in &residuals.all {
        let u = r.along.unwrap_or(0.0) / cut;
        if u.abs() >= 1.0 {
            continue;
        }
        let tukey = (1.0 - u * u) * (1.0 - u * u);
        let mut add = |direction: &Vector3<f64>, residual: f64, variance: f64| {
            placed.gradient(r.link, &r.point, direction, &mut normal.row);
            if let Some((f, _, _)) = r.pixel {
                placed.camera_gradient(&X_DW[f], &r.seen, direction, &mut normal.row);
            }
            normal.add(residual, r.weight * tukey / variance, free);
        };
        if let Some(along) = r.along {
            squares += r.weight * tukey * along * along;
            count += r.weight * tukey;
            add(&r.normal, along, deviation * deviation);
        }
        let across = r.across.norm();
        if across > 0.0 {
            add(&(r.across / across), across, r.deviation * r.deviation + deviation * deviation);
        }
    }
    if stage.matching != Matching::Thinned {
        silhouettes(problem, at, stage.radius, deviation, free, &mut normal);
    }
    let rms = if count > 0.0 { (squares / count).sqrt() } else { 0.0 };

    // Neighbouring pixels err together: what counts is the number of independent ones.
    let area = if stage.matching == Matching::Rays { correlated_pixels(problem, &residuals, cut) } else { CORRELATED };
    let mut H = normal.H.clone() / area;
    H.fill_upper_triangle_with_lower_triangle();
    let mut g = normal.g.clone() / area;
    let back = problem.start.difference(at, &problem.request.joints);
    let pull = &problem.prior_information * &back;
    let mut information = problem.prior_information.clone();
    for (a, &i) in free.iter().enumerate() {
        g[a] += pull[i];
        for (b, &j) in free.iter().enumerate() {
            information[(i, j)] += H[(a, b)];
            H[(a, b)] += problem.prior_information[(i, j)];
        }
    }
    let mut full = DVector::zeros(size);
    if let Some(solution) = H.cholesky().map(|c| c.solve(&g)) {
        for (a, &i) in free.iter().enumerate() {
            full[i] = solution[a];
        }
    }
    // A step longer than the matches reach is not to be believed.
    let turn = full.rows(0, 3).norm() * problem.radius;
    let length = turn.max(full.rows(3, 3).norm());
    if length > stage.radius {
        full *= stage.radius / length;
    }
    let size_of_step = full.norm();
    (at.moved(&full, &problem.request.joints), size_of_step, information, rms, area)
}

/// Where a ray went through the claimed surface just beside the measured one, the surface is pulled to the edge.
fn silhouettes(problem: &Problem<'_>, at: &Hypothesis, radius: f64, deviation: f64, free: &[usize], normal: &mut Normal) {
    let placed = problem.placed(at);
    let cell = problem.coarse.spacing * problem.coarse.spacing;
    for frame in problem.frames {
        let X_DW = at.X_DW(&frame.X_WC);
        let moved = (frame.X_WC * X_DW).inverse();
        let eye = X_DW.inverse_transform_point(&Point3::origin());
        for (link, (grid, X)) in problem.coarse.grids.iter().zip(&placed.X_WL).enumerate() {
            for s in &grid.samples {
                let (p, n) = (X * s.point, X * s.normal);
                let to_eye = eye - p;
                let cos = n.dot(&to_eye) / to_eye.norm();
                if cos < 0.2 {
                    continue;
                }
                let Some((column, row, z)) = frame.project(&X_DW, &p) else { continue };
                let measured = frame.nearest[row * frame.width + column];
                if measured < z + 0.01 + 3.0 * frame.noise * z * z {
                    continue;
                }
                let footprint = frame.footprint(z);
                let window = ((radius / footprint) as usize).clamp(1, 8);
                let mut best: Option<(f64, Vector3<f64>)> = None;
                for r in row.saturating_sub(window)..=(row + window).min(frame.height - 1) {
                    for c in column.saturating_sub(window)..=(column + window).min(frame.width - 1) {
                        let Some(pixel) = frame.pixels.get(frame.slot[r * frame.width + c] as usize) else { continue };
                        let d = moved * pixel.point - p;
                        let along = n.dot(&d);
                        let across = d - n * along;
                        let length = across.norm();
                        let near = along.abs() < 3.0 * deviation && pixel.normal.dot(&n) > 0.5 && length < radius;
                        if near && best.is_none_or(|(b, _)| length < b) {
                            best = Some((length, across));
                        }
                    }
                }
                if let Some((length, across)) = best.filter(|(length, _)| *length > 1.5 * footprint) {
                    let direction = across / length;
                    placed.gradient(link, &p, &direction, &mut normal.row);
                    placed.camera_gradient(&X_DW, &(p + across), &direction, &mut normal.row);
                    let weight = cell * cos / (footprint * footprint) / (footprint * footprint + deviation * deviation);
                    normal.add(length - footprint, weight, free);
                }
            }
        }
    }
}

/// Number of pixels that err together: for residuals whose correlation at the spacing of the matched pixels is `r` along
/// both image axes, `((1 + r) / (1 - r))^2` of them, as for a first-order autoregressive field. Each stands for `stride^2`.
fn correlated_pixels(problem: &Problem<'_>, residuals: &Residuals, cut: f64) -> f64 {
    let mut fields: Vec<Vec<f64>> = problem.frames.iter().map(|f| vec![f64::NAN; f.width * f.height]).collect();
    let (mut count, mut weights) = (0.0, 0.0);
    for r in &residuals.all {
        if let (Some((f, column, row)), Some(along)) = (r.pixel, r.along.filter(|a| a.abs() < cut)) {
            fields[f][row * problem.frames[f].width + column] = along;
            count += 1.0;
            weights += r.weight;
        }
    }
    let (mut products, mut squares) = (0.0, 0.0);
    for ((frame, field), &stride) in problem.frames.iter().zip(&fields).zip(&residuals.strides) {
        let mut pair = |a: f64, b: f64| {
            if a.is_finite() && b.is_finite() {
                products += a * b;
                squares += (a * a + b * b) / 2.0;
            }
        };
        for row in 0..frame.height {
            for column in 0..frame.width {
                let a = field[row * frame.width + column];
                if column + stride < frame.width {
                    pair(a, field[row * frame.width + column + stride]);
                }
                if row + stride < frame.height {
                    pair(a, field[(row + stride) * frame.width + column]);
                }
            }
        }
    }
    let r: f64 = if squares > 0.0 { (products / squares).clamp(0.0, 0.9) } else { 0.0 };
    let stride_area = if count > 0.0 { weights / count } else { 1.0 };
    ((1.0 + r) / (1.0 - r)).powi(2) * stride_area
}
