//! Where a hinge is, asked once it is known which points are a part's and which way it opens.
//!
//! The network that picks a joint among candidates sees a part as superpoints, the true ones where it learns, and tells its place beside. How
//! far a pin lies from what is seen of its panel's end hangs on a few millimetres about that end: a lip, a gap, the frame's edge, the side of
//! the case, how thick the panel is. So these are shown to a head of its own: a picture of the section across the hinge (what is the part's,
//! what is not) about the panel's end, in two frames. P lies along the panel, from its hinge, and out of its face; S lies as P does when the
//! part is shut. In both, what a left door shows is what its mirror image, a right one, does. The head answers how far to move the hinge along
//! the axes of both frames, and how far off it expects to be.

use nalgebra::{Point3, Vector2, Vector3};

use crate::candidate::{Candidate, RESIDUAL, quantile};
use crate::network::{CLASSES, Matrix};
use crate::posed::Posed;

/// Features of a hinge.
pub const PLACE: usize = 22 + CLASSES + 5 + 5 + 9 + 4 + 10 + 1 + 3 * CELLS;
/// What is answered: how far to move along P's axes, along S's, in [`RESIDUAL`]; the logarithm of how far off it will be, in the same.
pub const ANSWERS: usize = 5;
/// Networks that are asked, each for itself; the mean of their answers counts.
pub const MEMBERS: usize = 4;

/// Edges of the picture's cells along the panel and out of it, m, from the hinge.
const ALONG: [f64; 13] = [-0.2, -0.1, -0.05, -0.03, -0.018, -0.008, 0.0, 0.008, 0.018, 0.03, 0.05, 0.1, 0.2];
const OUT: [f64; 12] = [-0.2, -0.1, -0.05, -0.03, -0.018, -0.009, -0.003, 0.003, 0.009, 0.02, 0.04, 0.1];
const CELLS: usize = (ALONG.len() - 1) * (OUT.len() - 1);
/// How much of the part along its hinge is looked at, beyond either end, m.
const BEYOND: f64 = 0.01;
/// Most that is looked for beside a panel's end, m.
const BESIDE: f64 = 0.12;

/// A way in which a part may turn, in K.
pub(crate) struct Hinge<'a> {
    pub(crate) candidate: &'a Candidate,
    /// Where its place was thought to be.
    pub(crate) residual: [f64; 2],
    /// Along the hinge; the part opens by turning about it.
    pub(crate) axis: Vector3<f64>,
    /// How far it stands open, rad.
    pub(crate) state: f64,
    pub(crate) probability: f64,
    /// The part's number among labels.
    pub(crate) label: u32,
    /// What the part is thought to be.
    pub(crate) classes: [f64; CLASSES],
}

impl Hinge<'_> {
    /// Unit vectors of P and S, across the hinge.
    pub(crate) fn frames(&self) -> [[Vector3<f64>; 2]; 2] {
        let along = self.candidate.along;
        let out = self.axis.cross(&along).normalize();
        let (sin, cos) = self.state.sin_cos();
        [[along, out], [along * cos - out * sin, along * sin + out * cos]]
    }

    /// How far the head's answers move the hinge, in K, and how far off they expect it to be, m.
    pub(crate) fn placed(&self, answers: &[f32]) -> (Vector3<f64>, f64) {
        let mean = |k: usize| answers.iter().skip(k).step_by(ANSWERS).map(|x| f64::from(*x)).sum::<f64>() / MEMBERS as f64;
        let [[along, out], [shut, opens]] = self.frames();
        let moved = along * mean(0) + out * mean(1) + shut * mean(2) + opens * mean(3);
        (moved * RESIDUAL, mean(4).clamp(-5.0, 3.0).exp() * RESIDUAL)
    }
}

/// A point about a hinge: in P, in S, and along the hinge from the part's middle.
struct About {
    p: Vector2<f64>,
    s: Vector2<f64>,
    height: f64,
    label: u32,
}

/// The cell of a picture that a place lies in.
fn cell(at: &Vector2<f64>) -> Option<usize> {
    let find = |edges: &[f64], x: f64| edges.iter().position(|e| x < *e)?.checked_sub(1);
    Some(find(&ALONG, at.x)? * (OUT.len() - 1) + find(&OUT, at.y)?)
}

/// The network's input for hinges. `label`: of each point its part, 0 what stands still.
pub(crate) fn rows(posed: &Posed<'_>, label: &[Option<u32>], hinges: &[Hinge<'_>]) -> Matrix {
    let a = posed.analysis;
    let dense: Vec<(Point3<f64>, u32)> =
        a.dense.iter().filter_map(|(p, of)| Some((Point3::from(posed.of_world(&p.coords)), label[*of as usize]?))).collect();
    let mut all: Vec<f32> = Vec::with_capacity(hinges.len() * PLACE);
    for hinge in hinges {
        let row = row(posed, &dense, hinge);
        debug_assert_eq!(row.len(), PLACE);
        all.extend(row.into_iter().map(|x| x.clamp(-3.0, 3.0) as f32));
    }
    Matrix::from_row_slice(hinges.len(), PLACE, &all)
}

fn row(posed: &Posed<'_>, dense: &[(Point3<f64>, u32)], hinge: &Hinge<'_>) -> Vec<f64> {
    let [[along, out], [shut, opens]] = hinge.frames();
    let c = hinge.candidate;
    let seen = |(p, label): &(Point3<f64>, u32)| {
        let d = p - c.origin;
        let (p, s) = (Vector2::new(d.dot(&along), d.dot(&out)), Vector2::new(d.dot(&shut), d.dot(&opens)));
        About { p, s, height: d.dot(&hinge.axis), label: *label }
    };
    let about: Vec<About> = dense.iter().map(seen).collect();
    let (own, others): (Vec<&About>, Vec<&About>) = about.iter().partition(|x| x.label == hinge.label);
    let mut heights: Vec<f64> = own.iter().map(|x| x.height).collect();
    let (low, high) = (quantile(&mut heights, 0.01), quantile(&mut heights, 0.99));
    let height = (high - low).max(0.02);
    let beside: Vec<&About> = others.iter().copied().filter(|x| x.height > low - BEYOND && x.height < high + BEYOND).collect();
    let spacing = posed.analysis.scale.spacing;
    let quantiles = |values: &[f64], shares: &[f64]| -> Vec<f64> {
        let mut values = values.to_vec();
        shares.iter().map(|s| quantile(&mut values, *s)).collect()
    };
    let mut row: Vec<f64> = Vec::with_capacity(PLACE);
    row.extend((0..3).map(|k| hinge.axis[k].powi(2)));
    row.extend([hinge.probability, (4.0 * hinge.probability).min(1.0)]);
    let told = c.corrected(hinge.residual) - c.origin;
    row.extend([along, out, shut, opens].map(|v| told.dot(&v) * 20.0));
    row.extend([hinge.state.cos(), hinge.state.sin(), f64::from(u8::from(hinge.state == 0.0))]);
    row.extend([c.length * 2.0, height * 2.0, posed.diagonal().ln()]);
    row.extend([posed.analysis.scale.noise * 100.0, spacing * 50.0, (dense.len() as f64).log10() - 4.0]);
    // Which way gravity and the front lie.
    row.extend([shut.x, shut.z, opens.x, opens.z]);
    row.extend(hinge.classes);
    let across: Vec<f64> = own.iter().map(|x| x.p.y).collect();
    row.extend(quantiles(&across, &[0.02, 0.1, 0.5, 0.9, 0.98]).iter().map(|x| x * 20.0));
    let near: Vec<f64> = own.iter().filter(|x| x.p.x < 0.04).map(|x| x.p.y).collect();
    row.extend(quantiles(&near, &[0.05, 0.25, 0.5, 0.75, 0.95]).iter().map(|x| x * 20.0));
    // Where the panel ends, and whether it does so all along the hinge.
    let thin = 3.0 * posed.analysis.scale.noise.max(0.003);
    let panel: Vec<&&About> = own.iter().filter(|x| x.p.y.abs() < thin).collect();
    let ends = |of: &dyn Fn(f64) -> bool, shares: &[f64]| {
        let along: Vec<f64> = panel.iter().filter(|x| of((x.height - low) / height)).map(|x| x.p.x).collect();
        quantiles(&along, shares).into_iter().map(|x| x * 40.0)
    };
    row.extend(ends(&|_| true, &[0.0, 0.003, 0.01, 0.03, 0.1]));
    for k in 0..3 {
        row.extend(ends(&|h| (h * 3.0).floor() == f64::from(k), &[0.02]));
    }
    let all: Vec<f64> = own.iter().map(|x| x.p.x).collect();
    row.extend(quantiles(&all, &[0.003]).iter().map(|x| x * 40.0));
    // What stands still, seen from the hinge.
    let still: Vec<&&About> = others.iter().filter(|x| x.label == 0).collect();
    for k in 0..2 {
        let places: Vec<f64> = still.iter().map(|x| x.s[k]).collect();
        row.extend(quantiles(&places, &[0.01, 0.99]).iter().map(|x| x * 8.0));
    }
    // The nearest that is not the part's beside its end, at several depths, in both frames.
    let nearest = |frame: &dyn Fn(&About) -> Vector2<f64>, from: f64, to: f64| {
        let mut t: Vec<f64> = beside.iter().map(|x| frame(x)).filter(|x| x.y > from && x.y < to && x.x < 0.01).map(|x| x.x).collect();
        t.sort_by(|a, b| b.total_cmp(a));
        t.get(4).copied().unwrap_or(-BESIDE).max(-BESIDE) * 20.0
    };
    for (from, to) in [(-0.06, -0.025), (-0.025, -0.008), (-0.008, 0.008), (0.008, 0.025), (0.025, 0.06)] {
        row.push(nearest(&|x| x.p, from, to));
        row.push(nearest(&|x| x.s, from, to));
    }
    let moves: Vec<f64> = beside.iter().filter(|x| x.label != 0 && x.p.x < 0.01 && x.p.y.abs() < 0.04).map(|x| x.p.x).collect();
    row.push(moves.into_iter().fold(-BESIDE, f64::max) * 20.0);
    // As many points as a row along the hinge has fill a cell.
    let whole = (spacing / height).min(1.0);
    let mut picture = |of: &mut dyn Iterator<Item = Vector2<f64>>| {
        let mut cells = [0.0; CELLS];
        of.filter_map(|x| cell(&x)).for_each(|k| cells[k] += whole);
        row.extend(cells.map(f64::ln_1p));
    };
    picture(&mut own.iter().map(|x| x.p));
    picture(&mut beside.iter().map(|x| x.p));
    picture(&mut beside.iter().map(|x| x.s));
    row
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use sagci_furniture::{Category, Look, Random, families, look};

    use super::*;
    use crate::analysis::analyse;
    use crate::candidate::candidates;
    use crate::side::Side;

    /// All that is told of a left hinge is told of a right one.
    #[test]
    fn a_mirror_changes_nothing_about_a_hinge() {
        let random = &mut Random::new(3, "mirror");
        let object = families(Category::Refrigerator, false)[0].draw(random);
        let cloud = look(&object, &Look::draw(random), random);
        let analysis = &analyse(&cloud.points).unwrap()[0];
        let label: Vec<Option<u32>> = analysis.piece.iter().map(|p| Some(u32::from(*p == Some(0)))).collect();
        let (side, mirror) = (Side::new(analysis, 0), Side::new(analysis, 0).mirrored());
        let [own, image] = [&side, &mirror].map(|s| candidates(&s.posed, &[0]));
        let hinge = |candidate, axis| Hinge {
            candidate,
            residual: [0.0; 2],
            axis,
            state: 0.4,
            probability: 0.7,
            label: 1,
            classes: [0.1, 0.6, 0.1, 0.1, 0.1],
        };
        for c in own.iter().filter(|c| !c.slides) {
            let other = &image[c.image(&image).unwrap()];
            let seen = rows(&side.posed, &label, &[hinge(c, c.axis)]);
            let mirrored = rows(&mirror.posed, &label, &[hinge(other, Vector3::new(-c.axis.x, c.axis.y, -c.axis.z))]);
            // A few points lie on the edges of cells.
            let off = (&seen - &mirrored).iter().filter(|d| d.abs() > 1e-3).count();
            assert!(off <= 4, "{off} of {PLACE} about {}", c.axis);
        }
    }
}
