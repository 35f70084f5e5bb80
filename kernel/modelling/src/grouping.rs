//! Which pieces are one part, and how much of a part is expected to be right.

use crate::ModellingError;
use crate::network::Matrix;

/// Log-odds below which groups are never joined.
const UNLIKE: f64 = -6.0;

/// Log-odds that two pieces are of one part.
pub(crate) struct Odds {
    of: Matrix,
}

impl Odds {
    /// Asks about all pairs of `n` pieces; `ask` answers pairs `(i, j)` with a row each.
    pub(crate) fn asked(n: usize, ask: impl FnOnce(&[(usize, usize)]) -> Result<Matrix, ModellingError>) -> Result<Self, ModellingError> {
        let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
        let mut of = Matrix::zeros(n, n);
        if !pairs.is_empty() {
            let answers = ask(&pairs)?;
            for (k, (i, j)) in pairs.into_iter().enumerate() {
                of[(i, j)] = answers[k];
                of[(j, i)] = answers[k];
            }
        }
        Ok(Self { of })
    }

    /// All groups that come of joining, again and again, the two groups of greatest mean log-odds; first the single pieces. `points` of every
    /// piece.
    pub(crate) fn tree(&self, moving: &[usize], points: &[f64]) -> Vec<Vec<usize>> {
        let m = moving.len();
        let weight: Vec<f64> = moving.iter().map(|i| points[*i].sqrt()).collect();
        let mut nodes: Vec<Vec<usize>> = moving.iter().map(|i| vec![*i]).collect();
        // Of each group in the making its node, and sums of weighted log-odds and of weights to the others.
        let mut live: Vec<usize> = (0..m).collect();
        let mut sums: Vec<Vec<[f64; 2]>> = (0..m)
            .map(|a| {
                let to = |b: usize| weight[a] * weight[b];
                (0..m).map(|b| [to(b) * f64::from(self.of[(moving[a], moving[b])]), to(b)]).collect()
            })
            .collect();
        loop {
            let mut best: Option<(f64, usize, usize)> = None;
            for (i, row) in sums.iter().enumerate() {
                for (j, [sum, weight]) in row.iter().enumerate().skip(i + 1) {
                    let mean = sum / weight.max(1e-12);
                    if mean > UNLIKE && best.is_none_or(|x| mean > x.0) {
                        best = Some((mean, i, j));
                    }
                }
            }
            let Some((_, i, j)) = best else { break };
            nodes.push([nodes[live[i]].clone(), nodes[live[j]].clone()].concat());
            let added = sums[j].clone();
            for (k, add) in added.into_iter().enumerate() {
                sums[i][k][0] += add[0];
                sums[i][k][1] += add[1];
                sums[k][i] = sums[i][k];
            }
            live[i] = nodes.len() - 1;
            live.swap_remove(j);
            sums.swap_remove(j);
            sums.iter_mut().for_each(|row| {
                row.swap_remove(j);
            });
        }
        nodes
    }

    /// Mean log-odds that a piece is of one part with a group's others; none for a group that has no other.
    pub(crate) fn together(&self, group: &[usize], piece: usize, points: &[f64]) -> Option<f64> {
        let (mut sum, mut total) = (0.0, 0.0);
        for j in group.iter().filter(|j| **j != piece) {
            sum += points[*j].sqrt() * f64::from(self.of[(*j, piece)]);
            total += points[*j].sqrt();
        }
        (total > 0.0).then(|| sum / total)
    }

    /// Mean log-odds of the pairs within a group; none for a single piece.
    pub(crate) fn within(&self, group: &[usize], points: &[f64]) -> Option<f64> {
        let (mut sum, mut total) = (0.0, 0.0);
        for (n, i) in group.iter().enumerate() {
            for j in &group[n + 1..] {
                let w = (points[*i] * points[*j]).sqrt();
                sum += w * f64::from(self.of[(*i, *j)]);
                total += w;
            }
        }
        (total > 0.0).then(|| sum / total)
    }

    /// The intersection over union that a group may expect with a true part, from how sure it is of each of its pieces and of those that it
    /// left out. `still`: the probability of every piece to be the body.
    pub(crate) fn overlap(&self, group: &[usize], still: &[f64], points: &[f64]) -> f64 {
        let (mut own, mut right, mut lacking) = (0.0, 0.0, 0.0);
        for i in 0..points.len() {
            // A part of one piece has nothing else to go by.
            let together = self.together(group, i, points).map_or(1.0, |x| 1.0 / (1.0 + (-x).exp()));
            let belongs = points[i] * together * (1.0 - still[i]);
            match group.contains(&i) {
                true => {
                    own += points[i];
                    right += belongs;
                }
                false => lacking += belongs,
            }
        }
        right / (own + lacking).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of four pieces the first is the body; the second and the third belong together.
    fn odds() -> Odds {
        let together = |i: usize, j: usize| (i, j) == (1, 2);
        Odds::asked(4, |pairs| Ok(Matrix::from_fn(pairs.len(), 1, |k, _| if together(pairs[k].0, pairs[k].1) { 4.0 } else { -4.0 })))
            .unwrap_or(Odds { of: Matrix::zeros(0, 0) })
    }

    #[test]
    fn pieces_that_belong_together_are_one_part() {
        let tree = odds().tree(&[1, 2, 3], &[100.0; 4]);
        assert_eq!(tree.len(), 5);
        // First the two that belong together, then, against all odds, the third.
        assert!(tree[3].len() == 2 && tree[3].contains(&1) && tree[3].contains(&2));
        assert_eq!(tree[4].len(), 3);
    }

    #[test]
    fn what_is_left_out_and_what_is_in_doubt_lowers_the_expected_overlap() {
        let (odds, points, sure) = (odds(), [100.0; 4], [1.0, 0.0, 0.0, 0.0]);
        let whole = odds.overlap(&[1, 2], &sure, &points);
        assert!(whole > 0.95, "{whole}");
        assert!(odds.overlap(&[1], &sure, &points) < 0.55);
        assert!(odds.overlap(&[1, 2], &[1.0, 0.5, 0.5, 0.0], &points) < 0.55);
    }
}
