//! Contact points as the geometry gives them, and how many of one pair are kept.

use nalgebra::Vector3;

use super::feature::Feature;

/// No pair of shapes has more contact points than this.
pub(crate) const POINTS: usize = 8;

/// One contact point. The normal points from B to A; the depth is positive where they overlap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    pub p: Vector3<f64>,
    pub n: Vector3<f64>,
    pub depth: f64,
    pub feature: Feature,
    /// Which corners and edges make it: the same from step to step.
    pub id: u32,
}

/// The contact points of one pair, in the order of the features that make them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Manifold {
    pub found: Vec<Found>,
}

impl Manifold {
    #[inline]
    pub fn push(&mut self, found: Found) {
        self.found.push(found);
    }

    /// Keeps the deepest point, then always the one that is farthest from those kept (none shallower than needed to hold: a point
    /// in the air counts less). Two boxes never have more than eight.
    pub fn reduce(&mut self) {
        if self.found.len() <= POINTS {
            return;
        }
        let deepest = self.found.iter().enumerate().max_by(|a, b| a.1.depth.total_cmp(&b.1.depth)).map_or(0, |(i, _)| i);
        self.found.swap(0, deepest);
        for kept in 1..POINTS {
            let far = |f: &Found, kept: &[Found]| kept.iter().map(|k| (k.p - f.p).norm()).fold(f64::INFINITY, f64::min);
            let mut best = (f64::NEG_INFINITY, kept);
            for i in kept..self.found.len() {
                let d = far(&self.found[i], &self.found[..kept]);
                let score = if self.found[i].depth > 0.0 { d } else { 1e-3 * d };
                if score > best.0 {
                    best = (score, i);
                }
            }
            self.found.swap(kept, best.1);
        }
        self.found.truncate(POINTS);
        self.found.sort_unstable_by_key(|f| f.id);
    }
}
