//! Robust registration: Gauss-Newton on the distances of the cloud's points to the surface.
//!
//! For a cloud point `p` matched to the surface point `s` with normal `n`, the residual is `n . (p - s)` (point to
//! plane; Chen and Medioni 1992), weighted by Tukey's biweight. Where a point lies beside the surface's edge, and where a
//! ray went past an edge of the surface, the distance across is a second residual, known to about a pixel: silhouettes
//! hold the directions that flat faces leave free.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::frame::median;
use crate::hypothesis::Hypothesis;
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
}

/// How far to look and how often.
pub(crate) struct Stage {
    /// Greatest distance of a match, m.
    pub radius: f64,
    /// Iterations.
    pub rounds: usize,
    /// Use every pixel and not the thinned cloud.
    pub all_pixels: bool,
}

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
            let (next, step, information, rms) = step(problem, &hypothesis, stage);
            hypothesis = next;
            last = Some((information, rms));
            if step < 1e-5 {
                break;
            }
        }
    }
    let (information, rms) = last.unwrap_or_else(|| (problem.prior_matrix(), 0.0));
    Aligned { hypothesis, information, rms }
}

struct Residual {
    link: usize,
    point: nalgebra::Point3<f64>,
    normal: Vector3<f64>,
    along: f64,
    across: Vector3<f64>,
    weight: f64,
    deviation: f64,
    pixel: Option<(usize, usize)>,
}

fn step(problem: &Problem<'_>, at: &Hypothesis, stage: &Stage) -> (Hypothesis, f64, DMatrix<f64>, f64) {
    let placed = problem.placed(at);
    let resolution: &Resolution = if stage.radius > 2.0 * problem.coarse.spacing { &problem.coarse } else { &problem.fine };
    let mut residuals: Vec<Residual> = Vec::new();
    let mut push = |point, normal: &Vector3<f64>, weight, deviation, pixel| {
        if let Some(m) = problem.matched(resolution, &placed.X_WL, &[], point, normal, stage.radius) {
            let across = m.across.norm();
            let beside = if across > 1.5 * resolution.spacing { m.across * (1.0 - resolution.spacing / across) } else { Vector3::zeros() };
            residuals.push(Residual {
                link: m.link,
                point: m.point,
                normal: m.normal,
                along: m.along,
                across: beside,
                weight,
                deviation,
                pixel,
            });
        }
    };
    if stage.all_pixels {
        for &(f, i) in &problem.pixels {
            let frame = &problem.frames[f];
            let p = &frame.pixels[i];
            push(&p.point, &p.normal, 1.0, frame.footprint((frame.X_CW * p.point).z), Some((f, i)));
        }
    } else {
        for t in &problem.thinned {
            push(&t.point, &t.normal, t.weight, 0.005, None);
        }
    }

    let free = &problem.free;
    let n = free.len();
    let size = 6 + problem.request.joints.len();
    let mut normal = Normal { H: DMatrix::zeros(n, n), g: DVector::zeros(n), row: vec![0.0; size] };

    let mut distances: Vec<f64> = residuals.iter().map(|r| r.along.abs()).collect();
    let deviation = (1.4826 * median(&mut distances).unwrap_or(LEAST_DEVIATION)).max(LEAST_DEVIATION);
    let cut = TUKEY * deviation;
    let (mut squares, mut count) = (0.0, 0.0);
    for r in &residuals {
        let u = r.along / cut;
        if u.abs() >= 1.0 {
            continue;
        }
        let tukey = (1.0 - u * u) * (1.0 - u * u);
        squares += r.weight * tukey * r.along * r.along;
        count += r.weight * tukey;
        placed.gradient(r.link, &r.point, &r.normal, &mut normal.row);
        normal.add(r.along, r.weight * tukey / (deviation * deviation), free);
        let across = r.across.norm();
        if across > 0.0 {
            placed.gradient(r.link, &r.point, &(r.across / across), &mut normal.row);
            normal.add(across, r.weight * tukey / (r.deviation * r.deviation + deviation * deviation), free);
        }
    }
    if stage.all_pixels {
        silhouettes(problem, at, stage.radius, deviation, &mut normal);
    }
    let rms = if count > 0.0 { (squares / count).sqrt() } else { 0.0 };

    // Neighbouring pixels err together: what counts is the number of independent ones.
    let area = if stage.all_pixels { correlated_pixels(problem, &residuals, cut) } else { 1.0 };
    let mut H = normal.H.clone() / area;
    H.fill_upper_triangle_with_lower_triangle();
    let mut g = normal.g.clone() / area;
    let back = problem.start.difference(at, &problem.request.joints);
    let mut information = problem.prior_matrix();
    for (a, &i) in free.iter().enumerate() {
        g[a] += problem.prior_information[i] * back[i];
        for (b, &j) in free.iter().enumerate() {
            information[(i, j)] += H[(a, b)];
        }
        H[(a, a)] += problem.prior_information[i];
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
    (at.moved(&full, &problem.request.joints), size_of_step, information, rms)
}

/// Where a ray went through the claimed surface just beside the measured one, the surface is pulled to the edge.
fn silhouettes(problem: &Problem<'_>, at: &Hypothesis, radius: f64, deviation: f64, normal: &mut Normal) {
    let placed = problem.placed(at);
    let cell = problem.coarse.spacing * problem.coarse.spacing;
    for frame in problem.frames {
        let eye = frame.eye();
        for (link, (grid, X)) in problem.coarse.grids.iter().zip(&placed.X_WL).enumerate() {
            for s in &grid.samples {
                let (p, n) = (X * s.point, X * s.normal);
                let to_eye = eye - p;
                let cos = n.dot(&to_eye) / to_eye.norm();
                if cos < 0.2 {
                    continue;
                }
                let Some((column, row, z)) = frame.project(&p) else { continue };
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
                        let d = pixel.point - p;
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
                    placed.gradient(link, &p, &(across / length), &mut normal.row);
                    let weight = cell * cos / (footprint * footprint) / (footprint * footprint + deviation * deviation);
                    normal.add(length - footprint, weight, &problem.free);
                }
            }
        }
    }
}

/// Number of neighbouring pixels that err together: for residuals of lag-one correlation `r` along both image axes,
/// `((1 + r) / (1 - r))^2`, as for a first-order autoregressive field.
fn correlated_pixels(problem: &Problem<'_>, residuals: &[Residual], cut: f64) -> f64 {
    let mut fields: Vec<Vec<f64>> = problem.frames.iter().map(|f| vec![f64::NAN; f.width * f.height]).collect();
    for r in residuals {
        if let (Some((f, i)), true) = (r.pixel, r.along.abs() < cut) {
            let p = &problem.frames[f].pixels[i];
            fields[f][p.row * problem.frames[f].width + p.column] = r.along;
        }
    }
    let (mut products, mut squares) = (0.0, 0.0);
    for (frame, field) in problem.frames.iter().zip(&fields) {
        let mut pair = |a: f64, b: f64| {
            if a.is_finite() && b.is_finite() {
                products += a * b;
                squares += (a * a + b * b) / 2.0;
            }
        };
        for row in 0..frame.height {
            for column in 0..frame.width {
                let a = field[row * frame.width + column];
                if column + 1 < frame.width {
                    pair(a, field[row * frame.width + column + 1]);
                }
                if row + 1 < frame.height {
                    pair(a, field[(row + 1) * frame.width + column]);
                }
            }
        }
    }
    let r = if squares > 0.0 { (products / squares).clamp(0.0, 0.9) } else { 0.0 };
    ((1.0 + r) / (1.0 - r)).powi(2)
}
