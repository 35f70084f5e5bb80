//! The network: a small PointNet for each superpoint (Qi et al. 2017), attention between superpoints biased by how two of them lie
//! to one another, and heads: class, same part or not, is this side the front, and which joint a part has.

use super::algebra::{Algebra, Matrix};
use crate::ModellingError;
use crate::border::BORDER;
use crate::evidence::EVIDENCE;
use crate::feature::{CANDIDATE, CANDIDATES, PAIR, PIECE, POINT, SAMPLES};
use crate::mask::{MASK, RELATION};
use crate::place::{ANSWERS, MEMBERS, PLACE};
use crate::trust::TRUST;

/// Width of a superpoint's state, and of a group's.
pub(crate) const WIDTH: usize = 64;
/// Heads of attention.
const HEADS: usize = 4;
/// Blocks of attention between superpoints, and between groups of them.
const BLOCKS: usize = 3;
const MASK_BLOCKS: usize = 2;
/// What is made of what is known of a pair.
const BENT: usize = 16;
/// Features of a group of superpoints: what is told of it, and the mean of its superpoints' states.
pub const GROUP: usize = MASK + WIDTH;
/// Classes of a superpoint: body, door, drawer, lid, flap.
pub const CLASSES: usize = 5;

/// Applies the network's layers over some algebra.
pub struct Network<'a, A: Algebra> {
    algebra: &'a mut A,
}

/// What the trunk knows.
pub struct Trunk<V> {
    /// State of each superpoint.
    pub state: V,
    /// One row a pair `i < j`.
    pub pairs: V,
}

impl<'a, A: Algebra> Network<'a, A> {
    /// Over an algebra that knows the weights.
    pub fn new(algebra: &'a mut A) -> Self {
        Self { algebra }
    }

    fn linear(&mut self, name: &str, x: &A::Value, from: usize, to: usize) -> Result<A::Value, ModellingError> {
        let weight = self.algebra.learned(&format!("{name}.weight"), from, to)?;
        let bias = self.algebra.learned(&format!("{name}.bias"), 1, to)?;
        let product = self.algebra.product(x, &weight);
        Ok(self.algebra.add_row(&product, &bias))
    }

    fn hidden(&mut self, name: &str, x: &A::Value, from: usize, to: usize) -> Result<A::Value, ModellingError> {
        let x = self.linear(name, x, from, to)?;
        Ok(self.algebra.relu(&x))
    }

    fn norm(&mut self, name: &str, x: &A::Value) -> Result<A::Value, ModellingError> {
        let gain = self.algebra.learned(&format!("{name}.gain"), 1, WIDTH)?;
        let bias = self.algebra.learned(&format!("{name}.bias"), 1, WIDTH)?;
        Ok(self.algebra.normalised(x, &gain, &bias))
    }

    /// States of `n` superpoints from their features (`n` rows), their sampled points (`SAMPLES n` rows) and features of all ordered pairs
    /// (`n n` rows).
    ///
    /// Errors: weights that are missing or of another shape.
    pub fn trunk(&mut self, pieces: Matrix, points: Matrix, pairs: Matrix) -> Result<Trunk<A::Value>, ModellingError> {
        let pieces = self.algebra.input(pieces);
        let points = self.algebra.input(points);
        let pairs = self.algebra.input(pairs);
        let p = self.hidden("point.1", &points, POINT, 32)?;
        let p = self.hidden("point.2", &p, 32, 48)?;
        let p = self.algebra.greatest(&p, SAMPLES);
        let x = self.algebra.beside(&pieces, &p);
        let x = self.hidden("piece", &x, PIECE + 48, WIDTH)?;
        let mut x = self.norm("piece.norm", &x)?;
        let bent = self.hidden("pair", &pairs, PAIR, BENT)?;
        for block in 0..BLOCKS {
            x = self.block(&format!("block.{block}"), &x, &bent)?;
        }
        Ok(Trunk { state: x, pairs })
    }

    /// A block of attention (Vaswani et al. 2017) between items of [`WIDTH`], bent by what is known of each ordered pair of them.
    fn block(&mut self, name: &str, x: &A::Value, bent: &A::Value) -> Result<A::Value, ModellingError> {
        let name = |part: &str| format!("{name}.{part}");
        let bias = self.linear(&name("bias"), bent, BENT, HEADS)?;
        let q = self.linear(&name("q"), x, WIDTH, WIDTH)?;
        let k = self.linear(&name("k"), x, WIDTH, WIDTH)?;
        let v = self.linear(&name("v"), x, WIDTH, WIDTH)?;
        let seen = self.algebra.attend(&q, &k, &v, &bias, HEADS);
        let seen = self.linear(&name("out"), &seen, WIDTH, WIDTH)?;
        let sum = self.algebra.add(x, &seen);
        let x = self.norm(&name("norm.1"), &sum)?;
        let h = self.hidden(&name("wide"), &x, WIDTH, 2 * WIDTH)?;
        let h = self.linear(&name("narrow"), &h, 2 * WIDTH, WIDTH)?;
        let sum = self.algebra.add(&x, &h);
        self.norm(&name("norm.2"), &sum)
    }

    /// Class scores of superpoints: `n` by [`CLASSES`].
    ///
    /// Errors: as [`Self::trunk`].
    pub fn classes(&mut self, trunk: &Trunk<A::Value>) -> Result<A::Value, ModellingError> {
        let h = self.hidden("class.1", &trunk.state, WIDTH, WIDTH)?;
        self.linear("class.2", &h, WIDTH, CLASSES)
    }

    /// Log-odds that two superpoints are of one part, for pairs `(i, j)`.
    ///
    /// Errors: as [`Self::trunk`].
    pub fn same_part(&mut self, trunk: &Trunk<A::Value>, n: usize, pairs: &[(usize, usize)]) -> Result<A::Value, ModellingError> {
        let narrow = self.linear("same.state", &trunk.state, WIDTH, 32)?;
        let first: Vec<usize> = pairs.iter().map(|p| p.0).collect();
        let second: Vec<usize> = pairs.iter().map(|p| p.1).collect();
        let both: Vec<usize> = pairs.iter().map(|p| p.0 * n + p.1).collect();
        let a = self.algebra.rows(&narrow, &first);
        let b = self.algebra.rows(&narrow, &second);
        let sum = self.algebra.add(&a, &b);
        let product = self.algebra.times(&a, &b);
        let geometry = self.algebra.rows(&trunk.pairs, &both);
        let x = self.algebra.beside(&sum, &product);
        let x = self.algebra.beside(&x, &geometry);
        let x = self.hidden("same.1", &x, 64 + PAIR, 48)?;
        self.linear("same.2", &x, 48, 1)
    }

    /// Log-odds that points belong to parts: a row of [`BORDER`] features each.
    ///
    /// Errors: as [`Self::trunk`].
    pub fn border(&mut self, rows: Matrix) -> Result<A::Value, ModellingError> {
        let given = self.algebra.input(rows);
        let x = self.hidden("border.1", &given, BORDER, 40)?;
        let x = self.hidden("border.2", &x, 40, 24)?;
        self.linear("border.3", &x, 24, 1)
    }

    /// Log-odds that groups of superpoints overlap a true part by half and by three quarters. `rows`: [`GROUP`] features each; `relations`: for
    /// each ordered pair of `n` groups, row `i n + j`, the [`RELATION`] features of how they share points. Groups attend to one another, since
    /// whether one is a part depends on what else its pieces could be (Hu et al., "Relation networks for object detection", CVPR 2018).
    ///
    /// Errors: as [`Self::trunk`].
    pub fn masks(&mut self, rows: Matrix, relations: Matrix) -> Result<A::Value, ModellingError> {
        let rows = self.algebra.input(rows);
        let relations = self.algebra.input(relations);
        let x = self.hidden("mask.1", &rows, GROUP, 96)?;
        let x = self.linear("mask.2", &x, 96, WIDTH)?;
        let alone = self.norm("mask.norm", &x)?;
        let bent = self.hidden("mask.relation", &relations, RELATION, BENT)?;
        let mut x = alone.clone();
        for block in 0..MASK_BLOCKS {
            x = self.block(&format!("mask.block.{block}"), &x, &bent)?;
        }
        let x = self.algebra.beside(&x, &alone);
        let x = self.hidden("mask.3", &x, 2 * WIDTH, 64)?;
        self.linear("mask.4", &x, 64, 2)
    }

    /// Log-odds that parts' points overlap a true part's by three quarters: a row of [`TRUST`] features each.
    ///
    /// Errors: as [`Self::trunk`].
    pub fn trust(&mut self, rows: Matrix) -> Result<A::Value, ModellingError> {
        let given = self.algebra.input(rows);
        let x = self.hidden("trust.1", &given, TRUST, 24)?;
        self.linear("trust.2", &x, 24, 1)
    }

    /// Log-odds that what was found is a part that moves, and no mere face: a row of [`EVIDENCE`] features each.
    ///
    /// Errors: as [`Self::trunk`].
    pub fn evidence(&mut self, rows: Matrix) -> Result<A::Value, ModellingError> {
        let given = self.algebra.input(rows);
        let x = self.hidden("evidence.1", &given, EVIDENCE, 32)?;
        let x = self.hidden("evidence.2", &x, 32, 16)?;
        self.linear("evidence.3", &x, 16, 1)
    }

    /// Where hinges are: a row of [`PLACE`] features each; [`ANSWERS`] of one network beside those of the next.
    ///
    /// Errors: as [`Self::trunk`].
    pub fn place(&mut self, rows: Matrix) -> Result<A::Value, ModellingError> {
        let given = self.algebra.input(rows);
        let mut all = self.place_by(0, &given)?;
        for member in 1..MEMBERS {
            let own = self.place_by(member, &given)?;
            all = self.algebra.beside(&all, &own);
        }
        Ok(all)
    }

    fn place_by(&mut self, member: usize, given: &A::Value) -> Result<A::Value, ModellingError> {
        let name = |layer: usize| format!("place.{member}.{layer}");
        let x = self.hidden(&name(1), given, PLACE, 64)?;
        let x = self.hidden(&name(2), &x, 64, 32)?;
        self.linear(&name(3), &x, 32, ANSWERS)
    }

    /// Log-odds that x is the front.
    ///
    /// Errors: as [`Self::trunk`].
    pub fn front(&mut self, trunk: &Trunk<A::Value>, n: usize) -> Result<A::Value, ModellingError> {
        let all = self.algebra.means(&trunk.state, &[(0..n).collect()]);
        let h = self.hidden("front.1", &all, WIDTH, 32)?;
        self.linear("front.2", &h, 32, 1)
    }

    /// For parts, each a list of superpoints: [`CANDIDATES`] rows a part with a score and two residuals of the hinge's place.
    /// `candidates` has as many rows.
    ///
    /// Errors: as [`Self::trunk`].
    pub fn joints(
        &mut self,
        trunk: &Trunk<A::Value>,
        n: usize,
        parts: &[Vec<usize>],
        candidates: Matrix,
    ) -> Result<A::Value, ModellingError> {
        let own = self.algebra.means(&trunk.state, parts);
        let all = self.algebra.means(&trunk.state, &[(0..n).collect()]);
        let each: Vec<usize> = (0..parts.len() * CANDIDATES).map(|r| r / CANDIDATES).collect();
        let own = self.algebra.rows(&own, &each);
        let all = self.algebra.rows(&all, &vec![0; each.len()]);
        let given = self.algebra.input(candidates);
        let x = self.algebra.beside(&own, &all);
        let x = self.algebra.beside(&x, &given);
        let x = self.hidden("joint.1", &x, 2 * WIDTH + CANDIDATE, 96)?;
        let x = self.hidden("joint.2", &x, 96, 48)?;
        self.linear("joint.3", &x, 48, 3)
    }
}
