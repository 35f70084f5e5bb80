//! Is a thing made of walls? Furniture is, whichever way its doors stand; balls, pots and plants are not.
//!
//! A flat piece of a round thing is a cap as high as growing lets it be, so a paraboloid explains most of what is left of its plane. Of a
//! wall a paraboloid explains next to nothing.

use nalgebra::{Matrix6, Point3, Vector3, Vector6};

use crate::superpoint::Superpoint;

/// Fewest points that a curve is looked for in.
const FEWEST: usize = 24;
/// Pieces of which a paraboloid explains more than this share of the squared distances from their plane are round.
const ROUND: f64 = 0.5;

/// Share of points that lie on walls. All in one frame.
pub(crate) fn walled(pieces: &[Superpoint], cloud: &[Point3<f64>]) -> f64 {
    let on_walls = pieces.iter().filter(|s| s.axial.is_some() || (s.flat && !round(s, cloud)));
    on_walls.map(|s| s.points.len()).sum::<usize>() as f64 / cloud.len().max(1) as f64
}

fn round(piece: &Superpoint, cloud: &[Point3<f64>]) -> bool {
    if piece.points.len() < FEWEST {
        return false;
    }
    let across = if piece.normal.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let Some(u) = piece.normal.cross(&across).try_normalize(1e-9) else { return false };
    let v = piece.normal.cross(&u);
    let size = (piece.high - piece.low).norm().max(1e-6);
    let terms = |i: &u32| {
        let d = cloud[*i as usize] - piece.center;
        let (a, b) = (d.dot(&u) / size, d.dot(&v) / size);
        (Vector6::new(1.0, a, b, a * a, a * b, b * b), d.dot(&piece.normal))
    };
    let (mut N, mut y, mut squares) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    for (x, d) in piece.points.iter().map(terms) {
        N += x * x.transpose();
        y += x * d;
        squares += d * d;
    }
    N += Matrix6::identity() * (1e-9 * piece.points.len() as f64);
    let Some(c) = N.cholesky().map(|N| N.solve(&y)) else { return false };
    squares > 0.0 && c.dot(&y) > ROUND * squares
}
