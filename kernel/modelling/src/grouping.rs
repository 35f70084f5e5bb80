//! Which pieces are one part, and how much of a part is expected to be right.

use crate::ModellingError;
use crate::network::Matrix;

/// Log-odds that a moving piece and any piece are of one part.
pub(crate) struct Odds {
    /// The moving pieces.
    moving: Vec<usize>,
    /// One row a moving piece, one column a piece.
    of: Matrix,
}

impl Odds {
    /// Asks about all pairs of a moving piece and one of the `n`; `ask` answers pairs `(i, j)` with a row each.
    pub(crate) fn asked(
        moving: Vec<usize>,
        n: usize,
        mut ask: impl FnMut(&[(usize, usize)]) -> Result<Matrix, ModellingError>,
    ) -> Result<Self, ModellingError> {
        let row: Vec<Option<usize>> = (0..n).map(|i| moving.iter().position(|a| *a == i)).collect();
        let twice = |a: usize, i: usize| row[i].is_some_and(|b| b <= a);
        let pairs: Vec<(usize, usize)> =
            (0..moving.len()).flat_map(|a| (0..n).map(move |i| (a, i))).filter(|(a, i)| !twice(*a, *i)).collect();
        let mut of = Matrix::zeros(moving.len(), n);
        if !pairs.is_empty() {
            // In ascending order, as in training.
            let asked: Vec<(usize, usize)> = pairs.iter().map(|(a, i)| (moving[*a].min(*i), moving[*a].max(*i))).collect();
            let answers = ask(&asked)?;
            for (k, (a, i)) in pairs.into_iter().enumerate() {
                of[(a, i)] = answers[k];
                if let Some(b) = row[i] {
                    of[(b, moving[a])] = answers[k];
                }
            }
        }
        Ok(Self { moving, of })
    }

    /// Groups of moving pieces: the two groups of greatest mean log-odds are joined while those are positive. `points` of every piece.
    pub(crate) fn groups(&self, points: &[f64]) -> Vec<Vec<usize>> {
        let m = self.moving.len();
        let weight: Vec<f64> = self.moving.iter().map(|i| points[*i].sqrt()).collect();
        let mut groups: Vec<Vec<usize>> = (0..m).map(|a| vec![a]).collect();
        loop {
            let mut best: Option<(f64, usize, usize)> = None;
            for i in 0..groups.len() {
                for j in i + 1..groups.len() {
                    let (mut sum, mut total) = (0.0, 0.0);
                    for a in &groups[i] {
                        for b in &groups[j] {
                            let w = weight[*a] * weight[*b];
                            sum += w * f64::from(self.of[(*a, self.moving[*b])]);
                            total += w;
                        }
                    }
                    let mean = sum / total;
                    if mean > 0.0 && best.is_none_or(|x| mean > x.0) {
                        best = Some((mean, i, j));
                    }
                }
            }
            let Some((_, i, j)) = best else { break };
            let from = groups.swap_remove(j);
            groups[i].extend(from);
        }
        groups.into_iter().map(|g| g.into_iter().map(|a| self.moving[a]).collect()).collect()
    }

    /// Mean log-odds that a piece is of one part with a group's others; none for a group that has no other.
    pub(crate) fn together(&self, group: &[usize], piece: usize, points: &[f64]) -> Option<f64> {
        let (mut sum, mut total) = (0.0, 0.0);
        for (a, j) in self.moving.iter().enumerate().filter(|(_, j)| **j != piece && group.contains(j)) {
            sum += points[*j].sqrt() * f64::from(self.of[(a, piece)]);
            total += points[*j].sqrt();
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
        Odds::asked(vec![1, 2, 3], 4, |pairs| {
            Ok(Matrix::from_fn(pairs.len(), 1, |k, _| if together(pairs[k].0, pairs[k].1) { 4.0 } else { -4.0 }))
        })
        .unwrap_or(Odds { moving: Vec::new(), of: Matrix::zeros(0, 0) })
    }

    #[test]
    fn pieces_that_belong_together_are_one_part() {
        let mut groups = odds().groups(&[100.0; 4]);
        groups.iter_mut().for_each(|g| g.sort_unstable());
        groups.sort();
        assert_eq!(groups, [vec![1, 2], vec![3]]);
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
