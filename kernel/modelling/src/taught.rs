//! What the networks are asked about a cloud, at the doors by which training sees it.

use nalgebra::{Point3, Vector3};

use crate::ModellingError;
use crate::analysis::{Analysis, analyse};
use crate::ended::Ended;
use crate::first::First;
use crate::moves::Moves;
use crate::network::{Matrix, Network, Plain, Weights};
use crate::place::{self, Hinge};
use crate::side::Side;

/// What is asked about the points of a cloud, for training.
pub struct Borders {
    /// One row of features a question.
    pub rows: Matrix,
    /// The thinned point and the part that each row asks about.
    pub of: Vec<(u32, u32)>,
    /// Is there any doubt about it?
    pub doubtful: Vec<bool>,
    /// Of each input point the thinned point that stands for it.
    pub of_input: Vec<Option<u32>>,
    /// The first label of each thinned point: 0 the body, then the parts.
    pub label: Vec<Option<u32>>,
    /// How many parts there are.
    pub parts: usize,
}

impl Borders {
    /// Finds parts, and asks about the points near them.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        let analyses = analyse(cloud)?;
        let first = First::of(&analyses, &mut Plain { weights: &weights.matrices })?;
        let analysis = &analyses[first.index];
        let (label, asked) = first.ask(analysis);
        Ok(Self {
            rows: asked.rows,
            of: asked.of,
            doubtful: asked.doubtful,
            of_input: analysis.of_input.clone(),
            label,
            parts: first.groups.len(),
        })
    }
}

/// Groups of superpoints that may be parts, and what is asked about them, for training.
pub struct Groups {
    /// One row of [`crate::network::GROUP`] features a group.
    pub rows: Matrix,
    /// How each two of them share points: row `i n + j`.
    pub relations: Matrix,
    /// The superpoints of each.
    pub of: Vec<Vec<usize>>,
    /// Of each input point its superpoint.
    pub piece_of_input: Vec<Option<u32>>,
}

impl Groups {
    /// Of a cloud.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        let analyses = analyse(cloud)?;
        let first = First::asked(&analyses, &mut Plain { weights: &weights.matrices })?;
        let analysis = &analyses[first.index];
        let (rows, relations) = first.rows(analysis);
        Ok(Self { rows, relations, of: first.nodes, piece_of_input: analysis.piece_of_input() })
    }
}

/// What is made of a cloud's parts, once it is known which points are theirs.
fn ended<T>(
    cloud: &[Point3<f64>],
    weights: &Weights,
    made: impl FnOnce(&First<'_>, &Analysis, Ended, &mut Plain<'_>) -> Result<T, ModellingError>,
) -> Result<T, ModellingError> {
    let analyses = analyse(cloud)?;
    let mut plain = Plain { weights: &weights.matrices };
    let first = First::of(&analyses, &mut plain)?;
    let analysis = &analyses[first.index];
    let ended = Ended::of(&first, analysis, &mut plain)?;
    made(&first, analysis, ended, &mut plain)
}

/// What is asked about parts in the end, for training.
pub struct Ends {
    /// Of the body and each part a row of features, how far it is to be trusted.
    pub trust: Matrix,
    /// Of each part a row of features, what says that it moves.
    pub evidence: Matrix,
    /// Of each input point its part from 1; 0 the body.
    pub label_of_input: Vec<Option<u32>>,
}

impl Ends {
    /// Of a cloud.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        ended(cloud, weights, |_, analysis, ended, _| {
            Ok(Self { label_of_input: ended.label_of_input(analysis), trust: ended.trust, evidence: ended.evidence })
        })
    }
}

/// What is asked about the hinges of a cloud, for training.
pub struct Hinges {
    /// A row of [`crate::PLACE`] features each.
    pub rows: Matrix,
    /// Of each its part, by its number from 1.
    pub part: Vec<u32>,
    /// Of each the axis that it opens about, in W.
    pub axis: Vec<Vector3<f64>>,
    /// Where each was thought to be, in W, m.
    pub origin: Vec<Point3<f64>>,
    /// Of each the unit vectors in W that answers are counted along: along the panel and out of it, and the same as they are when it is shut.
    pub frames: Vec<[Vector3<f64>; 4]>,
    /// Of each input point its part from 1; 0 the body.
    pub label_of_input: Vec<Option<u32>>,
}

impl Hinges {
    /// Of a cloud.
    ///
    /// Errors: as [`crate::perceive()`].
    pub fn of(cloud: &[Point3<f64>], weights: &Weights) -> Result<Self, ModellingError> {
        ended(cloud, weights, |first, analysis, ended, plain| {
            let side = Side::new(&ended.fine, first.seen.quarter);
            let moves = Moves::of(first, analysis, &ended, &side, &mut Network::new(plain))?;
            let hinges: Vec<Hinge<'_>> = moves.hinges(&ended, &side).into_iter().map(|h| h.2).collect();
            let R_WK = (side.posed.R_KA * side.posed.analysis.R_AW).inverse();
            Ok(Self {
                rows: place::rows(&side.posed, &ended.label, &hinges),
                part: hinges.iter().map(|h| h.label).collect(),
                axis: hinges.iter().map(|h| R_WK * h.axis).collect(),
                origin: hinges.iter().map(|h| R_WK * h.candidate.corrected(h.residual)).collect(),
                frames: hinges.iter().map(|h| h.frames().map(|f| f.map(|v| R_WK * v))).map(|[[a, b], [c, d]]| [a, b, c, d]).collect(),
                label_of_input: ended.label_of_input(analysis),
            })
        })
    }
}
