//! Trains a head that is asked after all others, beside weights that stay: rows of features, and of each what is to be answered, which most
//! heads are taught by the cross entropy of both.

use std::collections::BTreeMap;

use sagci_furniture::Random;
use sagci_modelling::ModellingError;
use sagci_modelling::network::{Algebra, Matrix, Network, Weights};

use crate::adam::Adam;
use crate::initial::Initial;
use crate::tape::Tape;
use crate::{Settings, TrainingError};

/// A head of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Head {
    /// Where parts end.
    Border,
    /// How far parts are to be trusted.
    Trust,
    /// What says that parts move.
    Evidence,
    /// Where hinges are.
    Place,
}

impl Head {
    /// Its weights' names begin so.
    fn word(self) -> &'static str {
        match self {
            Self::Border => "border",
            Self::Trust => "trust",
            Self::Evidence => "evidence",
            Self::Place => "place",
        }
    }

    /// What the order of its rows is drawn by, beside the seed.
    fn order(self) -> &'static str {
        match self {
            Self::Border => "border order",
            Self::Trust => "trust",
            Self::Evidence => "evidence",
            Self::Place => "place",
        }
    }

    fn pass<A: Algebra>(self, network: &mut Network<'_, A>, rows: Matrix) -> Result<A::Value, ModellingError> {
        match self {
            Self::Border => network.border(rows),
            Self::Trust => network.trust(rows),
            Self::Evidence => network.evidence(rows),
            Self::Place => network.place(rows),
        }
    }
}

/// Rows of `F` features one behind the other, and of each what is to be answered.
#[derive(Debug)]
pub(crate) struct Rows<const F: usize, A> {
    pub features: Vec<f32>,
    pub answers: Vec<A>,
}

impl<const F: usize, A> Default for Rows<F, A> {
    fn default() -> Self {
        Self { features: Vec::new(), answers: Vec::new() }
    }
}

/// Of answers and what is to be answered: the mean loss, a mean figure for the log, and the loss's derivative by the answers.
pub(crate) type Loss<A> = fn(&Matrix, &[A]) -> ([f64; 2], Matrix);

/// How a head is taught.
pub(crate) struct Lessons<A> {
    pub head: Head,
    pub loss: Loss<A>,
    /// What its figure is.
    pub figure: &'static str,
    /// Standard deviation by which features are blurred, anew each time.
    pub blur: f32,
    /// Rows a step, for each object of a batch.
    pub rows: usize,
}

impl<A> Lessons<A> {
    /// By the share of right answers, without blur.
    pub(crate) fn plain(head: Head, loss: Loss<A>, rows: usize) -> Self {
        Self { head, loss, figure: "right", blur: 0.0, rows }
    }
}

impl<const F: usize, A: Copy> Rows<F, A> {
    fn gather(&self, at: &[usize]) -> (Matrix, Vec<A>) {
        let rows = Matrix::from_fn(at.len(), F, |i, k| self.features[at[i] * F + k]);
        (rows, at.iter().map(|i| self.answers[*i]).collect())
    }
}

/// What is to be answered where it is asked whether an overlap is more than `asked`: that rises about it, since a hair's breadth makes no
/// part another.
pub(crate) fn more_than(asked: f64, overlap: f64) -> f32 {
    ((overlap - asked) / 0.1 + 0.5).clamp(0.0, 1.0) as f32
}

/// Overlap (intersection over union) of what was found with each true part: rows by label, columns by part. `part` and `found` are of the same
/// points; what has none of either counts in the other's size.
pub(crate) fn overlaps(part: &[i32], parts: usize, found: &[Option<u32>], labels: usize) -> Vec<Vec<f64>> {
    let mut both = vec![vec![0.0_f64; parts]; labels];
    let (mut of_true, mut of_found) = (vec![0.0; parts], vec![0.0; labels]);
    for (part, label) in part.iter().zip(found) {
        let part = usize::try_from(*part).ok();
        part.iter().for_each(|t| of_true[*t] += 1.0);
        label.iter().for_each(|l| of_found[*l as usize] += 1.0);
        if let (Some(t), Some(l)) = (part, label) {
            both[*l as usize][t] += 1.0;
        }
    }
    let share = |(l, both): (usize, Vec<f64>)| both.iter().zip(&of_true).map(|(b, t)| b / f64::max(t + of_found[l] - b, 1.0)).collect();
    both.into_iter().enumerate().map(share).collect()
}

/// Mean cross entropy with answers from 0 to 1, and the share of those that are right.
pub(crate) fn entropy<const N: usize>(out: &Matrix, answers: &[[f32; N]]) -> ([f64; 2], Matrix) {
    let n = (N * answers.len()).max(1) as f32;
    let mut score = [0.0; 2];
    let d = Matrix::from_fn(answers.len(), N, |i, k| {
        let (loss, right, d) = cross_entropy(out[(i, k)], answers[i][k], 1.0 / n);
        score[0] += loss;
        score[1] += f64::from(u8::from(right)) / f64::from(n);
        d
    });
    (score, d)
}

/// Mean loss and figure; gradients are added.
fn learn<A>(
    &Lessons { head, loss, .. }: &Lessons<A>,
    weights: &BTreeMap<String, Matrix>,
    (rows, answers): (Matrix, Vec<A>),
    gradients: Option<&mut BTreeMap<String, Matrix>>,
) -> Result<[f64; 2], ModellingError> {
    let mut tape = Tape::new(weights);
    let at = head.pass(&mut Network::new(&mut tape), rows)?;
    let (score, d) = loss(tape.value(at), &answers);
    if let Some(gradients) = gradients {
        tape.back(&[(at, d)], gradients);
    }
    Ok(score)
}

/// Trains a head anew on what each object teaches; `log` is told of every epoch. The last tenth of the rows is only looked at.
///
/// Errors: nothing to learn from; weights that do not fit.
pub(crate) fn train_head<const F: usize, A: Copy>(
    lessons: &Lessons<A>,
    settings: &Settings,
    taught: Vec<Rows<F, A>>,
    from: &Weights,
    log: &mut dyn FnMut(&str),
) -> Result<Weights, TrainingError> {
    let head = lessons.head;
    let mut all = Rows::<F, A>::default();
    for t in taught {
        all.features.extend(t.features);
        all.answers.extend(t.answers);
    }
    let learned = all.answers.len() - all.answers.len() / 10;
    if learned == all.answers.len() {
        return Err(TrainingError::NoLessons { objects: settings.objects });
    }
    log(&format!("{}: {} rows", head.word(), all.answers.len()));
    let fresh: Vec<usize> = (learned..all.answers.len()).collect();
    let mut initial = Initial::new(settings.seed);
    head.pass(&mut Network::new(&mut initial), Matrix::zeros(0, 0))?;
    let mut weights = initial.weights;
    let batch = (settings.batch * lessons.rows).max(1);
    let mut adam = Adam::new(settings.epochs * learned.div_ceil(batch), settings.rate);
    let mut random = Random::new(settings.seed, head.order());
    let mut order: Vec<usize> = (0..learned).collect();
    let mut lines = Vec::new();
    for epoch in 0..settings.epochs {
        random.shuffle(&mut order);
        let mut total = [0.0; 3];
        for chunk in order.chunks(batch) {
            let mut gradients = BTreeMap::new();
            let (mut rows, answers) = all.gather(chunk);
            if lessons.blur > 0.0 {
                rows.iter_mut().for_each(|x| *x += lessons.blur * random.normal() as f32);
            }
            let score = learn(lessons, &weights, (rows, answers), Some(&mut gradients))?;
            let n = chunk.len() as f64;
            total = [total[0] + n * score[0], total[1] + n * score[1], total[2] + n];
            adam.step(&mut weights, &gradients, 1.0);
        }
        let seen = learn(lessons, &weights, all.gather(&fresh), None)?;
        let [loss, figure] = [total[0] / total[2], total[1] / total[2]];
        let name = lessons.figure;
        let line = format!("epoch {:3}  loss {loss:.4}  {name} {figure:.4}  fresh  loss {:.4}  {name} {:.4}", epoch + 1, seen[0], seen[1]);
        log(&line);
        lines.push(line);
    }
    made(head.word(), settings, from, weights, &lines)
}

/// Weights with a head made anew beside those that it was made on, which say themselves how they were made.
pub(crate) fn made(
    head: &str,
    settings: &Settings,
    from: &Weights,
    learned: BTreeMap<String, Matrix>,
    log: &[String],
) -> Result<Weights, TrainingError> {
    let before: serde_json::Value = serde_json::from_str(&from.made_by)?;
    let mut matrices = from.matrices.clone();
    // Of a head that was of another shape nothing stays.
    let word = format!("{head}.");
    matrices.retain(|name, _| !name.starts_with(&word));
    matrices.extend(learned);
    let made_by = serde_json::to_string(&serde_json::json!({ "settings": settings, "head": head, "log": log, "from": before }))?;
    Ok(Weights { matrices, made_by })
}

/// Cross entropy, weighed by `weight`, of log-odds `x` with what was to be answered, from 0 to 1; is the likelier answer right; and the
/// derivative by the log-odds.
pub(crate) fn cross_entropy(x: f32, answer: f32, weight: f32) -> (f64, bool, f32) {
    let p = 1.0 / (1.0 + (-x).exp());
    let loss = -(answer * p.max(1e-9).ln() + (1.0 - answer) * (1.0 - p).max(1e-9).ln());
    (f64::from(weight * loss), (p > 0.5) == (answer > 0.5), weight * (p - answer))
}
