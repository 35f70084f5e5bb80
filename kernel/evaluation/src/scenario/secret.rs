//! What is hidden in a run: effects of a size to match the motion, each on its joint.

use sagci_model::{EffectEntry, JointKind, ObjectModel};

use super::priors::{self, Scale};
use crate::EvaluationError;
use crate::effect::{CATALOGUE, OUTSIDE, Term};
use crate::plant::{Mechanism, Rigid};
use crate::random::Random;
use crate::simulate::Run;

/// Least mass and length that count, kg and m, least speed, rad/s or m/s, and the least way that is a motion, rad or m.
const LIGHTEST: f64 = 0.05;
const SHORTEST: f64 = 0.03;
const SLOWEST: f64 = 1e-6;
const STILL: f64 = 1e-3;

/// How large things are on each joint where nothing is hidden; none where one stands or nothing drives it. `lasts`: how long what drifts has to do
/// so, s.
pub(super) fn scales(model: &ObjectModel, rigid: &Rigid, runs: &[Run], lasts: f64) -> Option<Vec<Scale>> {
    let moving: Vec<usize> = model.moving_joints().collect();
    let n = moving.len();
    let mass = rigid.at(&vec![0.0; n], &vec![0.0; n]).0;
    let scale = |j: usize| {
        let root = |x: &dyn Fn(&Run, usize) -> f64| {
            let all: Vec<f64> = runs.iter().flat_map(|r| (0..r.time.len()).map(move |k| (r, k))).map(|(r, k)| x(r, k)).collect();
            let mut sizes: Vec<f64> = all.iter().map(|x| x.abs()).collect();
            sizes.sort_by(f64::total_cmp);
            let most = sizes.get(sizes.len() * 49 / 50).copied().unwrap_or(0.0);
            ((all.iter().map(|x| x * x).sum::<f64>() / all.len().max(1) as f64).sqrt(), most)
        };
        let (effort, most) = root(&|r, k| r.delivered[k][j]);
        let (velocity, _) = root(&|r, k| r.v[k][j]);
        let (low, high) = extent(runs, j);
        let joint = &model.joints[moving[j]];
        let child = &model.links[joint.child].inertial;
        Scale {
            effort,
            most,
            velocity: velocity.max(SLOWEST),
            range: [low, high],
            inertia: mass[(j, j)],
            mass: child.mass.max(LIGHTEST),
            length: child.p_LoLcm.coords.norm().max(SHORTEST) * 1.6,
            turns: joint.kind != JointKind::Prismatic,
            axis: joint.axis.into_inner().into(),
            session: lasts,
        }
    };
    let all: Vec<Scale> = (0..n).map(scale).collect();
    all.iter().all(|s| s.effort > 0.0 && s.range[1] - s.range[0] >= STILL).then_some(all)
}

/// Where a joint is at the lowest and at the highest.
pub(super) fn extent(runs: &[Run], j: usize) -> (f64, f64) {
    runs.iter().flat_map(|r| &r.q).fold((f64::MAX, f64::MIN), |(low, high), q| (low.min(q[j]), high.max(q[j])))
}

/// Hidden effects.
pub(super) struct Secret {
    pub entries: Vec<EffectEntry>,
    /// The joint of each.
    pub joints: Vec<usize>,
    /// One that the catalogue lacks, and its joint.
    outside: Option<(usize, Term)>,
}

impl Secret {
    /// Draws them; none where one has no size that would show.
    pub fn draw(names: &[&'static str], model: &ObjectModel, scales: &[Scale], level: usize, rng: &mut Random) -> Option<Self> {
        let moving: Vec<usize> = model.moving_joints().collect();
        let n = moving.len();
        let joint_of = |name: &str, rng: &mut Random| -> usize {
            match name {
                // What an axis is off by shows where gravity pulls across it, so on any joint of a plane.
                _ if n == 1 => 0,
                "payload" => n - 1 - rng.index(2.min(n)),
                _ => rng.index(n),
            }
        };
        let mut secret = Self { entries: Vec::new(), joints: Vec::new(), outside: None };
        for name in names {
            let j = if secret.joints.is_empty() { joint_of(name, rng) } else { secret.joints[0] };
            let joint = &model.joints[moving[j]].name;
            secret.entries.push(if OUTSIDE.contains(name) {
                let (term, numbers) = priors::draw_outside(name, &scales[j], rng)?;
                secret.outside = Some((j, term));
                EffectEntry { effect: (*name).into(), joint: Some(joint.clone()), parameters: numbers, ..EffectEntry::default() }
            } else {
                priors::draw(name, joint, &scales[j], level, rng)?
            });
            secret.joints.push(j);
        }
        Some(secret)
    }

    /// Those of the catalogue.
    pub fn of_catalogue(&self) -> impl Iterator<Item = &EffectEntry> {
        self.entries.iter().filter(|e| CATALOGUE.contains(&e.effect.as_str()))
    }

    /// Does one of them show in measured efforts alone?
    pub fn is_of_efforts(&self) -> bool {
        self.entries.iter().any(|e| e.choices.get("of").is_some_and(|w| w == "effort"))
    }

    /// A mechanism with all of them.
    pub fn put_into(&self, body: &ObjectModel) -> Result<Mechanism, EvaluationError> {
        let of_catalogue: Vec<EffectEntry> = self.of_catalogue().cloned().collect();
        let mut mechanism = Mechanism::new(body, &of_catalogue)?;
        if let Some((j, term)) = &self.outside {
            mechanism.joints[*j].terms.push(term.clone());
        }
        Ok(mechanism)
    }
}
