//! How a part moves that a candidate joint moves: which sign opens, where it stands, how far it goes. All of it is measured against what
//! stands still: other parts may be open.

use nalgebra::{Point3, Unit, Vector3};

use crate::candidate::Candidate;
use crate::posed::Posed;

/// A way in which a part may move. In W.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    pub(crate) slides: bool,
    /// Which of the part's candidates it is.
    pub(crate) candidate: usize,
    pub(crate) axis: Unit<Vector3<f64>>,
    pub(crate) origin: Point3<f64>,
    pub(crate) probability: f64,
    /// Where it stands, rad or m from shut.
    pub(crate) state: f64,
    /// Most that it opens.
    pub(crate) upper: f64,
    /// Of what is pulled out of the front: the x in K at which its front was seen.
    pub(crate) front: Option<f64>,
}

/// How far apart the fronts of drawers may be when they are shut, m.
const ONE_FRONT: f64 = 0.05;

/// Most drawers of a thing shut in one plane. One that seems to shut elsewhere has something open beside it that was not known for a part.
pub(crate) fn agree(drawers: &mut [&mut Motion]) {
    let mut shut: Vec<f64> = drawers.iter().filter_map(|m| m.front.map(|f| f - m.state)).collect();
    if shut.len() < 3 {
        return;
    }
    shut.sort_by(f64::total_cmp);
    // Of many drawers one is shut, most likely. Where some others say that they shut where the rearmost front stands, all do.
    let rearmost = drawers.iter().filter_map(|m| m.front).fold(f64::INFINITY, f64::min);
    let there = shut.iter().filter(|s| (**s - rearmost).abs() < SHUT).count();
    let plane = if there > 1 && 4 * there >= shut.len() { rearmost } else { shut[(shut.len() - 1) / 2] };
    for m in drawers {
        let Some(front) = m.front.filter(|f| (f - m.state - plane).abs() > ONE_FRONT) else { continue };
        m.state = if front - plane > SHUT { front - plane } else { 0.0 };
        m.upper = m.upper.max(m.state + 0.02);
    }
}

/// A drawer that stands out by less is shut, m: its front may stand before the rest as well.
const SHUT: f64 = 0.02;
/// How far around a front one looks for what it shuts against, m.
const AROUND: f64 = 0.12;
/// The outline of a front, m: as near to its ends as this.
const OUTLINE: f64 = 0.008;
/// Half of the depth within which points lie in one plane, m.
const LEVEL: f64 = 0.01;
/// Fewest points that say where something is.
const FEW: usize = 15;

/// An object from the side of its front, and which of its points stand still.
pub(crate) struct Still<'a> {
    pub(crate) posed: &'a Posed<'a>,
    still: Vec<bool>,
}

/// A range along an axis.
type Range = [f64; 2];

impl<'a> Still<'a> {
    /// `label`: of each point its part, 0 what stands still. What belongs to no piece is too little to say where something is.
    pub(crate) fn of(posed: &'a Posed<'a>, label: &[Option<u32>]) -> Self {
        let still = posed.analysis.piece.iter().zip(label).map(|(piece, l)| piece.is_some() && *l == Some(0)).collect();
        Self { posed, still }
    }

    fn owns(&self, pieces: &[usize], i: usize) -> bool {
        self.posed.analysis.piece[i].is_some_and(|k| pieces.contains(&(k as usize)))
    }

    /// Is the surface at a point flat across x?
    fn is_frontal(&self, i: usize) -> bool {
        (self.posed.R_KA * self.posed.analysis.normals[i]).x.abs() > 0.8
    }

    /// Below which so many of some points lie along an axis of K; of all points where there are none.
    fn quantile(&self, k: usize, share: f64, of: impl Fn(usize) -> bool) -> f64 {
        let mut v: Vec<f64> = (0..self.posed.points.len()).filter(|i| of(*i)).map(|i| self.posed.points[i][k]).collect();
        if v.is_empty() {
            return if share < 0.5 { self.posed.low[k] } else { self.posed.high[k] };
        }
        v.sort_by(f64::total_cmp);
        v[((v.len() - 1) as f64 * share) as usize]
    }

    /// The plane in which most of some points lie, by their x, of those no farther back than a reach from the foremost; none of few points.
    fn plane(xs: &mut [f64], reach: f64) -> Option<f64> {
        xs.sort_by(f64::total_cmp);
        let foremost = *xs.get(xs.len().checked_sub(1)? * 98 / 100)?;
        let xs = &xs[xs.partition_point(|x| *x < foremost - reach)..];
        let until = |k: usize| xs.partition_point(|x| *x < xs[k] + 2.0 * LEVEL);
        let k = (0..xs.len()).max_by_key(|k| until(*k) - k)?;
        let window = &xs[k..until(k)];
        (window.len() >= FEW).then(|| window.iter().sum::<f64>() / window.len() as f64)
    }

    /// How far a front that is pulled along x stands out of where it shuts, m.
    fn pulled(&self, pieces: &[usize], foremost: f64) -> f64 {
        let p = &self.posed.points;
        let own: Vec<usize> = (0..p.len()).filter(|i| self.owns(pieces, *i)).collect();
        let front: Vec<usize> = own.iter().copied().filter(|i| (p[*i].x - foremost).abs() < 2.0 * LEVEL).collect();
        if front.len() < FEW {
            return 0.0;
        }
        let range = |k: usize| -> Range {
            let mut v: Vec<f64> = front.iter().map(|i| p[*i][k]).collect();
            v.sort_by(f64::total_cmp);
            [v[v.len() / 50], v[v.len() - 1 - v.len() / 50]]
        };
        let (y, z) = (range(1), range(2));
        // How far a point lies inside the front's rectangle; outside where below zero.
        let inside = |i: usize| (p[i].y - y[0]).min(y[1] - p[i].y).min(p[i].z - z[0]).min(z[1] - p[i].z);
        // The edges around its hole; where these are not seen, all that stands still and looks to the front.
        let edges = |reach: f64| {
            let around = |i: &usize| inside(*i) < 0.0 && inside(*i) > -reach;
            let mut xs: Vec<f64> = (0..p.len()).filter(|i| self.still[*i] && around(i) && self.is_frontal(*i)).map(|i| p[i].x).collect();
            Self::plane(&mut xs, 0.08)
        };
        let face = [AROUND, 3.0 * AROUND, f64::INFINITY].into_iter().find_map(edges);
        let face = face.unwrap_or_else(|| self.quantile(0, 0.98, |i| self.still[i]));
        if foremost - face < SHUT {
            return 0.0;
        }
        // Other fronts that are shut lie in the plane where this one will.
        let shut = |i: &usize| (-0.005..0.05).contains(&(p[*i].x - face));
        let mut peers: Vec<f64> =
            (0..p.len()).filter(|i| !self.still[*i] && !self.owns(pieces, *i) && shut(i) && self.is_frontal(*i)).map(|i| p[i].x).collect();
        let against = Self::plane(&mut peers, 0.055).unwrap_or_else(|| {
            // A front that is wider than its hole stands before it, one with a frame right beside it lies in it.
            let level = |i: &usize| self.still[*i] && (p[*i].x - face).abs() < 2.0 * LEVEL;
            let behind = (0..p.len()).filter(|i| level(i) && inside(*i) > OUTLINE / 2.0).count();
            let beside = (0..p.len()).filter(|i| level(i) && (-2.0 * OUTLINE..0.0).contains(&inside(*i))).count();
            if behind >= FEW / 2 || beside < FEW { face + self.thickness(&own, foremost, inside) } else { face }
        });
        let out = foremost - against;
        if out > SHUT { out } else { 0.0 }
    }

    /// Of a front, m: how far its outline reaches back; a usual one where a box's sides go on from there.
    fn thickness(&self, own: &[usize], foremost: f64, inside: impl Fn(usize) -> f64) -> f64 {
        let mut back: Vec<f64> = own
            .iter()
            .filter(|i| inside(**i).abs() < OUTLINE)
            .map(|i| foremost - self.posed.points[*i].x)
            .filter(|d| (0.0..0.12).contains(d))
            .collect();
        back.sort_by(f64::total_cmp);
        back.get(back.len() * 9 / 10).copied().filter(|t| back.len() >= FEW && *t < 0.09).unwrap_or(0.02)
    }

    /// A candidate as a motion: the sign that opens, the state, the limit.
    pub(crate) fn motion(&self, pieces: &[usize], c: &Candidate, residual: [f64; 2], probability: f64, lid: bool) -> Motion {
        let posed = self.posed;
        let R_WK = (posed.R_KA * posed.analysis.R_AW).inverse();
        let (axis, origin, state, upper);
        let mut front = None;
        if c.slides {
            axis = c.axis;
            origin = c.origin;
            if c.axis.x > 0.5 {
                // The largest of the part's flat pieces across x.
                let foremost = pieces
                    .iter()
                    .filter(|i| posed.pieces[**i].axial == Some(0))
                    .map(|i| (posed.pieces[*i].center.x, posed.analysis.superpoints[*i].points.len()))
                    .max_by_key(|x| x.1)
                    .map_or(c.origin.x, |x| x.0);
                state = self.pulled(pieces, foremost);
                front = Some(foremost);
                let depth = self.quantile(0, 0.98, |i| self.still[i]) - self.quantile(0, 0.02, |i| self.still[i]);
                upper = (0.8 * depth.max(0.15)).max(state + 0.02);
            } else {
                state = 0.0;
                upper = c.length.max(0.1);
            }
        } else {
            origin = c.corrected(residual);
            let about = c.axis;
            let down = c.along;
            // Where the free end goes first when the part opens, and along what it lies when shut.
            let lies = if about.y.abs() < 0.5 {
                Vector3::y()
            } else if lid {
                Vector3::x()
            } else {
                Vector3::z()
            };
            let opens = if about.x.abs() > 0.5 || (lid && about.y.abs() > 0.5) { Vector3::z() } else { Vector3::x() };
            let k = lies.iamax();
            let rest = |i: usize| !self.owns(pieces, i);
            let (low, high) = (self.quantile(k, 0.01, rest), self.quantile(k, 0.99, rest));
            // Of the two ways to lie when shut, the one that stays within the rest of the object; where both do, the nearer one.
            let beyond = |sign: f64| {
                let end = origin[k] + sign * c.length;
                (low - end).max(end - high).max(0.0)
            };
            let (plus, minus) = (beyond(1.0), beyond(-1.0));
            let nearer = if down[k] >= 0.0 { 1.0 } else { -1.0 };
            let sign = if (plus - minus).abs() > 0.25 * c.length { if plus < minus { 1.0 } else { -1.0 } } else { nearer };
            let shut = lies * sign;
            axis = shut.cross(&opens);
            let mut angle = down.dot(&opens).atan2(down.dot(&shut));
            if angle < -0.35 {
                angle += std::f64::consts::TAU;
            }
            state = if (0.03..4.3).contains(&angle) { angle } else { 0.0 };
            let usual = if opens.z > 0.5 {
                1.9
            } else if about.z.abs() > 0.5 {
                2.1
            } else {
                1.57
            };
            upper = f64::max(usual, state + 0.05);
        }
        Motion {
            slides: c.slides,
            candidate: c.number,
            axis: Unit::new_normalize(R_WK * axis),
            origin: R_WK * origin,
            probability,
            state,
            upper,
            front,
        }
    }
}
