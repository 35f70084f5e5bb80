//! What the network is told: of each superpoint, of its points, of each pair. In K, in shares of the object's size where the
//! shape counts, in metres where the size does.

use nalgebra::{Point3, Vector3};

use crate::analysis::Analysis;
use crate::candidate::{self, Candidate};
use crate::grid::Grid;
use crate::network::Matrix;
use crate::posed::Posed;

/// Features of a superpoint.
pub const PIECE: usize = 50;
/// Features of a point of a superpoint.
pub const POINT: usize = 7;
/// Points of a superpoint that are looked at.
pub const SAMPLES: usize = 16;
/// Features of a pair.
pub const PAIR: usize = 16;
/// Features of a candidate joint.
pub const CANDIDATE: usize = candidate::FEATURES;
/// Candidate joints of a part.
pub const CANDIDATES: usize = candidate::COUNT;

/// The network's input for one object seen from one side.
pub struct Features {
    /// One row a superpoint.
    pub pieces: Matrix,
    /// [`SAMPLES`] rows a superpoint.
    pub points: Matrix,
    /// One row an ordered pair.
    pub pairs: Matrix,
}

fn clip(x: f64) -> f32 {
    x.clamp(-3.0, 3.0) as f32
}

/// How many points of each pair of superpoints lie within reach of one another.
pub(crate) fn contacts(points: &[Point3<f64>], piece: &[Option<u32>], count: usize, reach: f64) -> Vec<f64> {
    let grid = Grid::new(points, reach);
    let mut touching = vec![0.0; count * count];
    for (i, p) in points.iter().enumerate() {
        let Some(own) = piece[i] else { continue };
        let mut seen: [u32; 8] = [u32::MAX; 8];
        let mut n = 0;
        grid.near(p, reach, |j, _| {
            if let Some(other) = piece[j]
                && other != own
                && n < 8
                && !seen[..n].contains(&other)
            {
                seen[n] = other;
                n += 1;
                touching[own as usize * count + other as usize] += 1.0;
            }
        });
    }
    touching
}

/// How many points of each pair of superpoints lie beside one another. That does not depend on the side.
pub fn touching(a: &Analysis) -> Vec<f64> {
    contacts(&a.points, &a.piece, a.superpoints.len(), 2.2 * a.scale.spacing)
}

/// Fills in all features.
pub(crate) fn features(posed: &Posed<'_>, touching: &[f64]) -> Features {
    let a = posed.analysis;
    let n = posed.pieces.len();
    let s = posed.diagonal();
    let size = posed.high - posed.low;
    let middle = nalgebra::center(&posed.low, &posed.high);
    let total = a.points.len() as f64;
    let mut pieces = Matrix::zeros(n, PIECE);
    let mut points = Matrix::zeros(n * SAMPLES, POINT);
    for (i, (p, sp)) in posed.pieces.iter().zip(&a.superpoints).enumerate() {
        let extent = p.high - p.low;
        let mut row: Vec<f64> = Vec::with_capacity(PIECE);
        row.extend(((p.center - middle) / s * 2.0).iter());
        for k in 0..3 {
            row.push((p.low[k] - posed.low[k]) / size[k].max(1e-3));
        }
        for k in 0..3 {
            row.push((p.high[k] - posed.low[k]) / size[k].max(1e-3));
        }
        row.extend((extent / s * 2.0).iter());
        let m = p.normal;
        row.extend([m.x * m.x, m.y * m.y, m.z * m.z, 2.0 * m.x * m.y, 2.0 * m.x * m.z, 2.0 * m.y * m.z]);
        row.push(sp.residual / a.scale.noise.max(1e-3) / 3.0);
        row.push(f64::from(u8::from(sp.flat)));
        row.push((sp.points.len() as f64).log10() / 2.0 - 1.0);
        row.push(sp.points.len() as f64 / total * 4.0);
        row.extend((0..3).map(|k| f64::from(u8::from(p.axial == Some(k)))));
        row.extend(p.sides);
        row.extend(p.steps.map(|x| x * 100.0));
        row.extend([(p.center.x - posed.face) / s * 4.0, (p.high.x - posed.face) / s * 4.0, (p.low.x - posed.face) / s * 4.0]);
        row.extend([(p.center.x - posed.face) * 10.0, (p.high.x - posed.face) * 10.0]);
        row.push(s.ln());
        row.extend((size / s).iter());
        row.extend((extent * 2.0).iter());
        row.push(a.scale.noise * 100.0);
        row.push(a.scale.spacing * 50.0);
        row.push(n as f64 / 50.0);
        let mut across: Vec<f64> = extent.iter().copied().collect();
        across.sort_by(f64::total_cmp);
        row.push(sp.points.len() as f64 * a.scale.spacing.powi(2) / (across[1] * across[2]).max(1e-4) / 4.0);
        row.push(if p.axial == Some(2) { 1.0 - (posed.high.z - p.center.z) / size.z.max(1e-3) } else { 0.0 });
        debug_assert_eq!(row.len(), PIECE);
        for (k, x) in row.into_iter().enumerate() {
            pieces[(i, k)] = clip(x);
        }
        for j in 0..SAMPLES {
            // Spread evenly over the piece's list.
            let index = sp.points[(j * sp.points.len() / SAMPLES + sp.points.len() / (2 * SAMPLES)).min(sp.points.len() - 1)];
            let q = posed.points[index as usize];
            let d = q - p.center;
            let r = (q - middle) / s * 2.0;
            let row = [
                d.x / extent.x.max(0.02),
                d.y / extent.y.max(0.02),
                d.z / extent.z.max(0.02),
                r.x,
                r.y,
                r.z,
                d.dot(&p.normal) / sp.residual.max(0.002) / 2.0,
            ];
            for (k, x) in row.into_iter().enumerate() {
                points[(i * SAMPLES + j, k)] = clip(x);
            }
        }
    }
    let mut pairs = Matrix::zeros(n * n, PAIR);
    for i in 0..n {
        for j in 0..n {
            let (p, q) = (&posed.pieces[i], &posed.pieces[j]);
            let mut row: Vec<f64> = Vec::with_capacity(PAIR);
            for k in 0..3 {
                row.push((p.low[k] - q.high[k]).max(q.low[k] - p.high[k]).max(0.0) * 10.0);
            }
            for k in 0..3 {
                let overlap = (p.high[k].min(q.high[k]) - p.low[k].max(q.low[k])).max(0.0);
                row.push(overlap / (p.high[k] - p.low[k]).min(q.high[k] - q.low[k]).max(0.01));
            }
            let along = p.normal.dot(&q.normal);
            row.push(along * along);
            let d: Vector3<f64> = q.center - p.center;
            let (u, v) = (d.dot(&p.normal).abs() * 10.0, d.dot(&q.normal).abs() * 10.0);
            row.extend([u.min(v), u.max(v)]);
            let fewer = a.superpoints[i].points.len().min(a.superpoints[j].points.len()) as f64;
            let t = touching[i * n + j] + touching[j * n + i];
            row.extend([(1.0 + t).ln() / 3.0, (t / fewer).min(2.0)]);
            row.extend((d / s).map(f64::abs).iter().map(|x| x * 3.0));
            // Do they end at the same places across x? A door and its other face, a drawer and its sides do.
            row.push(((p.low.y - q.low.y).abs() + (p.high.y - q.high.y).abs()) * 5.0);
            row.push(((p.low.z - q.low.z).abs() + (p.high.z - q.high.z).abs()) * 5.0);
            debug_assert_eq!(row.len(), PAIR);
            for (k, x) in row.into_iter().enumerate() {
                pairs[(i * n + j, k)] = clip(x);
            }
        }
    }
    Features { pieces, points, pairs }
}

/// Features of a part's candidate joints, [`CANDIDATES`] rows.
pub(crate) fn candidate_rows(candidates: &[Candidate]) -> Matrix {
    Matrix::from_fn(candidates.len(), CANDIDATE, |i, k| clip(candidates[i].features[k]))
}
