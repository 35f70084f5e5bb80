//! An analysis seen from one side: the frame K, whose x points out of the side that is taken for the front.

use nalgebra::{Point3, Rotation3, Vector3};

use crate::analysis::Analysis;
use crate::superpoint::Superpoint;

/// A superpoint in K.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    pub(crate) center: Point3<f64>,
    pub(crate) low: Point3<f64>,
    pub(crate) high: Point3<f64>,
    pub(crate) normal: Vector3<f64>,
    pub(crate) axial: Option<usize>,
    /// Contrast at the low and high end along the two other axes of K, in ascending order of axes.
    pub(crate) sides: [f64; 4],
    /// How much farther out what goes on there is, along the normal's axis of K, m.
    pub(crate) steps: [f64; 4],
}

/// The analysis in K.
pub(crate) struct Posed<'a> {
    pub(crate) analysis: &'a Analysis,
    /// From A's axes to K's.
    pub(crate) R_KA: Rotation3<f64>,
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) pieces: Vec<Piece>,
    pub(crate) low: Point3<f64>,
    pub(crate) high: Point3<f64>,
    /// Where the front is: the x of most flat surface across x in the outer half.
    pub(crate) face: f64,
    /// Is y turned round?
    pub(crate) mirror: bool,
}

/// Turns a vector by quarters about z, exactly.
fn turned(v: &Vector3<f64>, quarter: usize) -> Vector3<f64> {
    match quarter % 4 {
        0 => *v,
        1 => Vector3::new(v.y, -v.x, v.z),
        2 => Vector3::new(-v.x, -v.y, v.z),
        _ => Vector3::new(-v.y, v.x, v.z),
    }
}

impl<'a> Posed<'a> {
    /// The same in a mirror: y becomes -y.
    pub(crate) fn mirrored(mut self) -> Self {
        self.mirror = !self.mirror;
        self.points.iter_mut().for_each(|p| p.y = -p.y);
        (self.low.y, self.high.y) = (-self.high.y, -self.low.y);
        for p in &mut self.pieces {
            p.center.y = -p.center.y;
            p.normal.y = -p.normal.y;
            (p.low.y, p.high.y) = (-p.high.y, -p.low.y);
            let outward = if p.axial == Some(1) { -1.0 } else { 1.0 };
            p.steps.iter_mut().for_each(|s| *s *= outward);
            match p.axial {
                Some(0) => {
                    p.sides.swap(0, 1);
                    p.steps.swap(0, 1);
                }
                Some(2) => {
                    p.sides.swap(2, 3);
                    p.steps.swap(2, 3);
                }
                _ => {}
            }
        }
        self
    }

    /// A vector of W in K, or in K's mirror.
    pub(crate) fn of_world(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let v = self.R_KA * (self.analysis.R_AW * v);
        if self.mirror { Vector3::new(v.x, -v.y, v.z) } else { v }
    }

    /// K's x is A's x turned by quarters of a turn about z.
    pub(crate) fn new(analysis: &'a Analysis, quarter: usize) -> Self {
        let turn = |p: &Point3<f64>| Point3::from(turned(&p.coords, quarter));
        let both = |a: &Point3<f64>, b: &Point3<f64>| (turn(a).inf(&turn(b)), turn(a).sup(&turn(b)));
        let (low, high) = both(&analysis.low, &analysis.high);
        let pieces: Vec<Piece> = analysis.superpoints.iter().map(|s| piece(s, quarter)).collect();
        let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|e| turned(&e, quarter));
        let R_KA = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&columns));
        let depth = high.x - low.x;
        let bin = (0.015 * (high - low).norm()).max(0.01);
        let bins = (depth / bin).ceil().max(1.0) as usize + 1;
        let mut votes = vec![0.0; bins];
        for (p, s) in pieces.iter().zip(&analysis.superpoints) {
            if p.axial == Some(0) && p.center.x > low.x + 0.3 * depth {
                votes[(((p.center.x - low.x) / bin).max(0.0) as usize).min(bins - 1)] += s.points.len() as f64;
            }
        }
        let pair = |k: usize| votes[k] + if k + 1 < bins { votes[k + 1] } else { 0.0 };
        let face = match (0..bins).max_by(|a, b| pair(*a).total_cmp(&pair(*b))).filter(|k| pair(*k) > 0.0) {
            Some(k) => {
                let (mut sum, mut total) = (0.0, 0.0);
                for (p, s) in pieces.iter().zip(&analysis.superpoints) {
                    let at = ((p.center.x - low.x) / bin) as usize;
                    if p.axial == Some(0) && (at == k || at == k + 1) && p.center.x > low.x + 0.3 * depth {
                        sum += p.center.x * s.points.len() as f64;
                        total += s.points.len() as f64;
                    }
                }
                if total > 0.0 { sum / total } else { high.x }
            }
            None => high.x,
        };
        Self { analysis, R_KA, points: analysis.points.iter().map(turn).collect(), pieces, low, high, face, mirror: false }
    }

    pub(crate) fn diagonal(&self) -> f64 {
        (self.high - self.low).norm()
    }
}

fn piece(s: &Superpoint, quarter: usize) -> Piece {
    let turn = |p: &Point3<f64>| Point3::from(turned(&p.coords, quarter));
    let (a, b) = (turn(&s.low), turn(&s.high));
    let odd = quarter % 2 == 1;
    let axis_to = |k: usize| if odd && k < 2 { 1 - k } else { k };
    let (mut sides, mut steps) = ([0.0; 4], [0.0; 4]);
    if let Some(axis) = s.axial {
        let own = axis_to(axis);
        let mut unit = Vector3::zeros();
        unit[axis] = 1.0;
        let outward = if turned(&unit, quarter)[own] < 0.0 { -1.0 } else { 1.0 };
        for (i, k) in [(axis + 1) % 3, (axis + 2) % 3].into_iter().enumerate() {
            let to = axis_to(k);
            let mut unit = Vector3::zeros();
            unit[k] = 1.0;
            let flipped = turned(&unit, quarter)[to] < 0.0;
            let slot = (0..3).filter(|a| *a != own).position(|a| a == to).unwrap_or(0);
            for end in 0..2 {
                let to = 2 * slot + if flipped { 1 - end } else { end };
                sides[to] = s.sides[2 * i + end];
                steps[to] = outward * s.steps[2 * i + end];
            }
        }
    }
    Piece {
        center: turn(&s.center),
        low: a.inf(&b),
        high: a.sup(&b),
        normal: turned(&s.normal, quarter),
        axial: s.axial.map(axis_to),
        sides,
        steps,
    }
}
