//! One side of an analysed object taken for its front: what the network is asked there, and how truth is put in its terms. Training
//! and use go through the same door.

use nalgebra::{Point3, Vector3};

use crate::analysis::Analysis;
use crate::candidate::{Candidate, candidates};
use crate::feature::{CANDIDATES, Features, candidate_rows, features};
use crate::network::Matrix;
use crate::posed::Posed;

/// An object with one of its four upright sides taken for the front.
pub struct Side<'a> {
    pub(crate) posed: Posed<'a>,
}

/// Candidate joints of parts.
pub struct Options {
    pub(crate) parts: Vec<Vec<Candidate>>,
}

impl<'a> Side<'a> {
    /// `quarter` from 0 to 3.
    pub fn new(analysis: &'a Analysis, quarter: usize) -> Self {
        Self { posed: Posed::new(analysis, quarter) }
    }

    /// The same object in a mirror across y.
    pub fn mirrored(self) -> Self {
        Self { posed: self.posed.mirrored() }
    }

    /// Direction out of the front, in W.
    pub fn front(&self) -> Vector3<f64> {
        self.posed.analysis.R_AW.inverse() * (self.posed.R_KA.inverse() * Vector3::x())
    }

    /// What the network is told; [`crate::touching`] says which superpoints do.
    pub fn features(&self, touching: &[f64]) -> Features {
        features(&self.posed, touching)
    }

    /// Candidate joints of parts, each given by its superpoints.
    pub fn options(&self, parts: &[Vec<usize>]) -> Options {
        Options { parts: parts.iter().map(|p| candidates(&self.posed, p)).collect() }
    }

    /// The candidate of a part that is nearest to a true joint (`axis` and `origin` in W), and the residual that is left; `None` if none is
    /// near.
    pub fn target(
        &self,
        options: &Options,
        part: usize,
        slides: bool,
        axis: &Vector3<f64>,
        origin: &Point3<f64>,
    ) -> Option<(usize, [f64; 2])> {
        let (axis, origin) = (self.posed.of_world(axis), Point3::from(self.posed.of_world(&origin.coords)));
        let mut best: Option<(usize, [f64; 2], f64)> = None;
        for (index, c) in options.parts[part].iter().enumerate() {
            let along = c.axis.dot(&axis);
            if c.slides != slides || (slides && along < 0.9) || along.abs() < 0.9 {
                continue;
            }
            let residual = if slides { [0.0; 2] } else { c.residual(&origin) };
            let off = residual[0].hypot(residual[1]);
            if best.is_none_or(|b| off < b.2) {
                best = Some((index, residual, off));
            }
        }
        best.filter(|b| b.2 < 8.0).map(|b| (b.0, b.1))
    }
}

impl Options {
    /// The network's input: [`CANDIDATES`] rows a part.
    pub fn rows(&self) -> Matrix {
        let all: Vec<Candidate> = self.parts.iter().flatten().cloned().collect();
        debug_assert_eq!(all.len(), self.parts.len() * CANDIDATES);
        candidate_rows(&all)
    }
}
