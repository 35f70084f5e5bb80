//! Parts whose points are known, one by one.

use crate::ModellingError;
use crate::analysis::Analysis;
use crate::border::split;
use crate::evidence;
use crate::first::{First, enough, shares, sizes};
use crate::mask::Known;
use crate::network::{CLASSES, Matrix, Plain};
use crate::trust::{self, Expected, Trusted};

/// Parts whose points are known.
pub(crate) struct Ended {
    /// The analysis, its superpoints split where parts end.
    pub(crate) fine: Analysis,
    /// Of each part that is left its superpoints before they were split, and after, and its classes.
    pub(crate) groups: Vec<Vec<usize>>,
    pub(crate) pieces: Vec<Vec<usize>>,
    pub(crate) share: Vec<[f64; CLASSES]>,
    /// How likely each overlaps a true part by half.
    pub(crate) promise: Vec<f64>,
    /// Of each point its part, 0 the body.
    pub(crate) label: Vec<Option<u32>>,
    /// What is asked about the body and the parts, how far they are to be trusted.
    pub(crate) trust: Matrix,
    /// What is asked about the parts, whether anything says that they move.
    pub(crate) evidence: Matrix,
}

impl Ended {
    pub(crate) fn of(first: &First<'_>, analysis: &Analysis, plain: &mut Plain<'_>) -> Result<Self, ModellingError> {
        let (mut label, expected) = first.label(analysis, plain)?;
        let mut counts = vec![0; first.groups.len() + 1];
        label.iter().flatten().for_each(|l| counts[*l as usize] += 1);
        // A part that is left with next to nothing is none. The larger ones first: names count from there.
        let mut kept: Vec<usize> = (0..first.groups.len()).filter(|g| enough(counts[g + 1], analysis.points.len())).collect();
        kept.sort_by_key(|g| std::cmp::Reverse(counts[g + 1]));
        let number = |l: u32| kept.iter().position(|g| *g as u32 + 1 == l).map_or(0, |k| k as u32 + 1);
        label.iter_mut().flatten().for_each(|l| *l = number(*l));
        let groups: Vec<Vec<usize>> = kept.iter().map(|g| first.groups[*g].clone()).collect();
        let (fine, pieces) = split(analysis, &label, groups.len());
        let points = sizes(analysis);
        let share: Vec<[f64; CLASSES]> = groups.iter().map(|own| shares(&first.classes, own, &points)).collect();
        let promise = kept.iter().map(|g| first.promises[*g][0]).collect();
        let trust = trusted(first, analysis, &kept, &label, &expected);
        let promises: Vec<[f64; 2]> = kept.iter().map(|g| first.promises[*g]).collect();
        let known = Known { odds: &first.odds, classes: &first.classes, points: &points };
        let evidence = evidence::rows(&first.seen.side.posed, &groups, &promises, &known);
        Ok(Self { fine, groups, pieces, share, promise, label, trust, evidence })
    }

    /// Of each input point its part, 0 the body.
    pub(crate) fn label_of_input(&self, whole: &Analysis) -> Vec<Option<u32>> {
        whole.of_input.iter().map(|i| i.and_then(|i| self.label[i as usize])).collect()
    }

    /// Keeps some of the parts, by their numbers from 0; the others are the body's.
    pub(crate) fn keep(&mut self, kept: &[usize]) {
        let number = |l: u32| kept.iter().position(|g| *g as u32 + 1 == l).map_or(0, |k| k as u32 + 1);
        self.label.iter_mut().flatten().for_each(|l| *l = number(*l));
        self.groups = kept.iter().map(|g| std::mem::take(&mut self.groups[*g])).collect();
        self.pieces = kept.iter().map(|g| std::mem::take(&mut self.pieces[*g])).collect();
        self.share = kept.iter().map(|g| self.share[*g]).collect();
        self.promise = kept.iter().map(|g| self.promise[*g]).collect();
    }
}

/// What is known of the body and of the parts that are left.
fn trusted(first: &First<'_>, analysis: &Analysis, kept: &[usize], label: &[Option<u32>], expected: &Expected) -> Matrix {
    let points = sizes(analysis);
    let still = first.still();
    let taken = |i: &usize| kept.iter().any(|g| first.groups[*g].contains(i));
    let (own, lacking): (Vec<usize>, Vec<usize>) = (0..points.len()).partition(|i| !taken(i));
    let right: f64 = own.iter().map(|i| points[*i] * still[*i]).sum();
    let all = own.iter().map(|i| points[*i]).sum::<f64>() + lacking.iter().map(|i| points[*i] * still[*i]).sum::<f64>();
    let count = |l: u32| label.iter().filter(|x| **x == Some(l)).count();
    let mut told = vec![Trusted {
        number: 0,
        points: count(0),
        classes: shares(&first.classes, &own, &points),
        overlap: right / all.max(1.0),
        promise: [1.0; 2],
    }];
    for (k, g) in kept.iter().enumerate() {
        let group = &first.groups[*g];
        told.push(Trusted {
            number: g + 1,
            points: count(k as u32 + 1),
            classes: shares(&first.classes, group, &points),
            overlap: first.odds.overlap(group, &still, &points),
            promise: first.promises[*g],
        });
    }
    let moving: f64 = told[1..].iter().map(|t| t.points as f64).sum();
    if moving > 0.0 {
        told[0].promise = [0, 1].map(|c| told[1..].iter().map(|t| t.points as f64 * t.promise[c]).sum::<f64>() / moving);
    }
    trust::rows(analysis, &told, expected)
}
