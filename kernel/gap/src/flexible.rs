//! "None of these": a force without a name, as a hypothesis of its own.
//!
//! Forces over bins of what a missing effect can depend on, each with a normal prior of one size, are a Gaussian process with
//! piecewise constant functions. In the linear response its evidence against no force at all is closed (MacKay 1992):
//!
//! ```text
//! ln Z = 1/2 b^T (A + s^2/a^2)^-1 b / s^2 - 1/2 ln det(1 + a^2 A / s^2),   A = D^T D,  b = -D^T e
//! ```
//!
//! with `D` the changes of the errors by a unit force in each bin, behind what the model's own numbers can explain.

use nalgebra::{Cholesky, DMatrix};
use serde::Serialize;

use crate::response::Response;
use crate::span::Span;

/// A force without a name.
#[derive(Debug, Clone)]
pub(crate) struct Nameless {
    /// What it depends on.
    pub over: &'static str,
    /// Logarithm of its evidence over that of no force.
    pub evidence: f64,
    /// RMS of the force, N m or N.
    pub force: f64,
    /// Where most of it acts.
    pub region: Region,
}

/// A part of positions, velocities and times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Region {
    /// Positions, rad or m.
    pub position: [f64; 2],
    /// Velocities, rad/s or m/s.
    pub velocity: [f64; 2],
    /// Times, s.
    pub time: [f64; 2],
}

/// What a row's force may depend on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub q: f64,
    pub v: f64,
    pub input: f64,
    pub time: f64,
    /// Time since all data began, over trajectories.
    pub run: f64,
    /// Time since the velocity last changed its sign.
    pub since: f64,
}

type Key = fn(&Place, &Scale) -> (usize, f64);

/// Ranges of what bins are over.
#[derive(Debug, Clone, Copy)]
struct Scale {
    q: [f64; 2],
    v: f64,
    input: f64,
    run: f64,
}

fn bin(x: f64, low: f64, high: f64, count: usize) -> usize {
    ((((x - low) / (high - low).max(1e-12)) * count as f64) as usize).min(count - 1)
}

fn sign(v: f64) -> f64 {
    if v > 0.0 {
        1.0
    } else if v < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// Bins, and the factor on the force in them.
const GROUPS: [(&str, usize, Key); 9] = [
    ("position", 16, |p, s| (bin(p.q, s.q[0], s.q[1], 16), 1.0)),
    ("position and direction", 16, |p, s| (bin(p.q, s.q[0], s.q[1], 16), sign(p.v))),
    ("position times velocity", 12, |p, s| (bin(p.q, s.q[0], s.q[1], 12), p.v / s.v)),
    ("velocity", 20, |p, s| (bin(p.v, -s.v, s.v, 20), 1.0)),
    ("input and direction", 8, |p, s| (bin(p.input.abs(), 0.0, s.input, 8), sign(p.v))),
    ("input", 12, |p, s| (bin(p.input, -s.input, s.input, 12), 1.0)),
    ("time since reversal and direction", 8, |p, _| (bin(p.since.max(1e-3).ln(), 1e-3f64.ln(), 5f64.ln(), 8), sign(p.v))),
    ("time", 64, |p, s| (bin(p.run, 0.0, s.run, 64), 1.0)),
    ("time times velocity", 24, |p, s| (bin(p.run, 0.0, s.run, 24), p.v / s.v)),
];

/// The most likely force without a name on a joint, on top of a fitted model.
pub(crate) fn nameless(response: &Response, span: &Span, scale: f64, size: f64) -> Option<Nameless> {
    let places = response.places();
    let fold = |f: fn(&Place) -> f64| places.iter().map(f).fold([f64::MAX, f64::MIN], |[a, b], x| [a.min(x), b.max(x)]);
    let ranges = Scale {
        q: fold(|p| p.q),
        v: fold(|p| p.v.abs())[1].max(1e-9),
        input: fold(|p| p.input.abs())[1].max(1e-9),
        run: fold(|p| p.run)[1].max(1e-9),
    };
    let mut best: Option<Nameless> = None;
    for (over, count, key) in GROUPS {
        let keys: Vec<(usize, f64)> = places.iter().map(|p| key(p, &ranges)).collect();
        let mut columns = Vec::new();
        let mut bins = Vec::new();
        for b in 0..count {
            let forces: Vec<f64> = keys.iter().map(|(at, factor)| if *at == b { *factor } else { 0.0 }).collect();
            if forces.iter().filter(|f| **f != 0.0).count() >= 10 {
                columns.push(response.errors_of(&forces));
                bins.push(b);
            }
        }
        if columns.is_empty() {
            continue;
        }
        let k = columns.len();
        let (matrix, right) = span.products(&DMatrix::from_columns(&columns));
        let right = -right;
        let variance = scale * scale;
        for prior in [0.003, 0.01, 0.03, 0.1, 0.3, 1.0].map(|share| share * size) {
            let ratio = variance / (prior * prior);
            let Some(factor) = Cholesky::new(&matrix + DMatrix::identity(k, k) * ratio) else { continue };
            let force = factor.solve(&right);
            let determinant = 2.0 * factor.l().diagonal().map(f64::ln).sum() - k as f64 * ratio.ln();
            let evidence = 0.5 * right.dot(&force) / variance - 0.5 * determinant;
            if best.as_ref().is_none_or(|b| evidence > b.evidence) {
                let mut by_bin = vec![0.0; count];
                for (b, f) in bins.iter().zip(force.iter()) {
                    by_bin[*b] = *f;
                }
                let along: Vec<f64> = keys.iter().map(|(b, factor)| by_bin[*b] * factor).collect();
                let square = along.iter().map(|f| f * f).sum::<f64>();
                best = Some(Nameless { over, evidence, force: (square / along.len() as f64).sqrt(), region: region(&places, &along) });
            }
        }
    }
    best
}

/// Where the middle 80 % of the squares of a force lie.
pub(crate) fn region(places: &[Place], forces: &[f64]) -> Region {
    let middle = |f: fn(&Place) -> f64| {
        let mut sorted: Vec<(f64, f64)> = places.iter().zip(forces).map(|(p, force)| (f(p), force * force)).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: f64 = sorted.iter().map(|s| s.1).sum();
        let at = |share: f64| {
            let mut sum = 0.0;
            sorted.iter().find(|s| {
                sum += s.1;
                sum >= share * total
            })
        };
        [at(0.1).map_or(0.0, |s| s.0), at(0.9).map_or(0.0, |s| s.0)]
    };
    Region { position: middle(|p| p.q), velocity: middle(|p| p.v), time: middle(|p| p.time) }
}
