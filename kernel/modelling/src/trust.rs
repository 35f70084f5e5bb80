//! How far a part's points are to be trusted: what is known at the end of each part and of the body, from which a last head says how likely
//! its points overlap a true part's by three quarters.

use crate::analysis::Analysis;
use crate::border::Asked;
use crate::network::{CLASSES, Matrix};

/// Features of a part, or of the body.
pub const TRUST: usize = 16 + CLASSES;

/// What is expected of labels, from what was said of single points.
pub(crate) struct Expected {
    /// Of the body and of each part: the overlap with what is true that its points promise, and the share of its points that changed hands.
    pub(crate) overlap: Vec<f64>,
    pub(crate) changed: Vec<f64>,
    /// Share of points about which there is doubt.
    pub(crate) doubt: f64,
}

/// What the log-odds of points promise for their labels, 0 the body.
pub(crate) fn expected(before: &[Option<u32>], after: &[Option<u32>], asked: &Asked, odds: &[f32], parts: usize) -> Expected {
    let mut still = vec![1.0_f64; after.len()];
    let (mut own, mut right, mut lacking) = (vec![0.0_f64; parts + 1], vec![0.0_f64; parts + 1], vec![0.0_f64; parts + 1]);
    let mut is_asked = vec![false; after.len()];
    for ((i, g), x) in asked.of.iter().zip(odds) {
        let (i, p) = (*i as usize, 1.0 / (1.0 + f64::from(-x).exp()));
        is_asked[i] = true;
        still[i] = f64::min(still[i], 1.0 - p);
        match after[i] == Some(g + 1) {
            true => right[*g as usize + 1] += p,
            false => lacking[*g as usize + 1] += p,
        }
    }
    let (mut doubtful, mut all) = (0.0, 0.0);
    let mut changed = vec![0.0; parts + 1];
    for i in 0..after.len() {
        let Some(l) = after[i] else { continue };
        own[l as usize] += 1.0;
        all += 1.0;
        doubtful += f64::from(u8::from(is_asked[i] && (0.2..0.8).contains(&still[i])));
        match l {
            0 => right[0] += still[i],
            _ => lacking[0] += if is_asked[i] { still[i] } else { 0.0 },
        }
        if before[i] != after[i] {
            changed[l as usize] += 1.0;
            before[i].into_iter().for_each(|b| changed[b as usize] += 1.0);
        }
    }
    let share = |of: &[f64], k: usize| of[k] / own[k].max(1.0);
    Expected {
        overlap: (0..=parts).map(|k| right[k] / f64::max(own[k] + lacking[k], 1.0)).collect(),
        changed: (0..=parts).map(|k| share(&changed, k)).collect(),
        doubt: doubtful / f64::max(all, 1.0),
    }
}

/// One part, or the body.
pub(crate) struct Trusted {
    /// Which it is in [`Expected`].
    pub(crate) number: usize,
    pub(crate) points: usize,
    pub(crate) classes: [f64; CLASSES],
    /// The overlap that its superpoints promise.
    pub(crate) overlap: f64,
    /// What was said of its group; of the body what was said of all groups, by their points.
    pub(crate) promise: [f64; 2],
}

/// The network's input for the body, which comes first, and the parts.
pub(crate) fn rows(analysis: &Analysis, all: &[Trusted], expected: &Expected) -> Matrix {
    let total = analysis.points.len().max(1) as f64;
    let least = all.iter().skip(1).map(|t| t.promise[1]).fold(1.0, f64::min);
    let mut rows: Vec<f32> = Vec::with_capacity(all.len() * TRUST);
    for t in all {
        let flag = f64::from(u8::from(t.number == 0));
        let mut row = vec![flag, t.promise[0] * 2.0 - 1.0, t.promise[1] * 2.0 - 1.0, least * 2.0 - 1.0];
        row.extend([
            expected.overlap[t.number] * 4.0 - 3.0,
            expected.overlap[0] * 4.0 - 3.0,
            expected.changed[t.number] * 2.0,
            expected.doubt * 10.0,
        ]);
        row.extend([(t.points as f64 / total).sqrt() * 2.0 - 1.0, (t.points.max(1) as f64).log10() - 3.0, all.len() as f64 / 4.0 - 1.0]);
        row.extend([
            t.overlap * 2.0 - 1.0,
            analysis.scale.noise * 100.0,
            analysis.scale.spacing * 50.0,
            (analysis.high - analysis.low).norm().ln(),
        ]);
        row.push(flag * (expected.overlap[0] * 4.0 - 3.0));
        row.extend(t.classes.map(|c| c * 2.0 - 1.0));
        debug_assert_eq!(row.len(), TRUST);
        rows.extend(row.into_iter().map(|x| x.clamp(-3.0, 3.0) as f32));
    }
    Matrix::from_row_slice(all.len(), TRUST, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::border::BORDER;

    #[test]
    fn points_in_doubt_lower_what_is_expected_of_both_sides() {
        let asked =
            |n: usize| Asked { rows: Matrix::zeros(n, BORDER), doubtful: vec![true; n], of: (0..n as u32).map(|i| (i, 0)).collect() };
        let labels = [Some(1), Some(1), Some(0), Some(0)];
        let sure = expected(&labels, &labels, &asked(4), &[9.0, 9.0, -9.0, -9.0], 1);
        let unsure = expected(&labels, &labels, &asked(4), &[9.0, 0.1, -0.1, -9.0], 1);
        for k in 0..2 {
            assert!(sure.overlap[k] > 0.99 && unsure.overlap[k] < 0.7, "{:?} {:?}", sure.overlap, unsure.overlap);
        }
        assert!(unsure.doubt > 0.4 && sure.doubt < 0.01 && sure.changed.iter().all(|c| *c == 0.0));
    }
}
