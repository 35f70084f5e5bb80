//! How a run's mechanism is moved: which families of motion train and are held out, and when samples are taken.

use super::bench::{Hand, Leads};
use super::excitation::{Family, Reference};
use super::priors;
use super::stage::{Driving, Kind, Stage};
use crate::EvaluationError;
use crate::plant::Plant;
use crate::random::Random;
use crate::simulate::Run;

/// All training motions together, and each held-out one, s.
const TRAINING: f64 = 40.0;
const HELD_OUT: f64 = 6.0;

/// One trajectory's plan.
pub(super) struct Plan {
    family: Family,
    references: Vec<Reference>,
    time: Vec<f64>,
}

impl Plan {
    /// What comes of it on a mechanism.
    pub fn carried_out(&self, plant: &mut dyn Plant, hand: &Hand<'_>) -> Result<Run, EvaluationError> {
        let leads: Vec<&dyn Leads> = self.references.iter().map(|r| r as &dyn Leads).collect();
        hand.lead(plant, &self.time, &leads)
    }
}

/// The plans of a run.
pub(super) struct Programme {
    pub train: Vec<Plan>,
    pub held_out: Vec<Plan>,
    /// Samples a second.
    pub rate: f64,
    /// Pace of the hand, rad/s.
    pub follow: f64,
    /// Trajectories follow one another on one clock.
    pub in_session: bool,
    /// How long what drifts has to do so in training, s.
    pub lasts: f64,
}

impl Programme {
    /// Draws it for what is hidden; `telling`: motions that tell it from others are among those that train.
    pub fn draw(names: &[&str], telling: bool, kind: Kind, stage: &Stage, rng: &mut Random) -> Self {
        let (held_family, seen) = families(names, telling, kind, stage.driving, rng);
        let rate = if rng.chance(0.6) { 200.0 } else { rng.pick(&[100.0, 125.0, 250.0, 400.0]).unwrap_or(200.0) };
        let jitter = if rng.chance(0.3) { rng.between(0.05, 0.25) } else { 0.0 };
        let missing = if rng.chance(0.3) { rng.scale(0.003, 0.03) } else { 0.0 };
        let in_session = names.iter().any(|n| matches!(*n, "thermal_wear" | "sensor_drift")) || rng.chance(0.4);
        let follow = if names.contains(&"joint_elasticity") || names.contains(&"unmodelled_mode") {
            rng.between(3.0, 4.5)
        } else {
            rng.between(9.0, 16.0)
        };
        let plan = |family: Family, duration: f64, from: &mut f64, rng: &mut Random| {
            let references = stage.range.iter().map(|r| Reference::draw(family, *r, duration, follow, rng)).collect();
            let dt = 1.0 / rate;
            let count = (duration * rate).round() as usize + 1;
            let mut time: Vec<f64> =
                (0..count).map(|k| k as f64 * dt + if k > 0 { jitter * dt * rng.between(-0.5, 0.5) } else { 0.0 }).collect();
            // A sample that was never taken: its input lasts until the next.
            let mut k = 0;
            time.retain(|_| {
                k += 1;
                k <= 2 || !rng.chance(missing)
            });
            time.iter_mut().for_each(|t| *t += *from);
            if in_session {
                *from += duration + 1.0;
            }
            Plan { family, references, time }
        };
        let duration = TRAINING / seen.len() as f64;
        let mut from = 0.0;
        let train = seen.iter().map(|f| plan(*f, duration, &mut from, rng)).collect();
        let lasts = if in_session { from } else { duration };
        from = 0.0;
        let held_out = (0..2).map(|_| plan(held_family, HELD_OUT, &mut from, rng)).collect();
        Self { train, held_out, rate, follow, in_session, lasts }
    }

    /// Names of the families that train, and of those that are held out.
    pub fn words(&self) -> [Vec<String>; 2] {
        [&self.train, &self.held_out].map(|plans| plans.iter().map(|p| p.family.word().to_owned()).collect())
    }
}

/// The family that is held out, which training lacks, and those that train.
fn families(names: &[&str], telling: bool, kind: Kind, driving: Driving, rng: &mut Random) -> (Family, Vec<Family>) {
    let mut families: Vec<Family> = Family::ALL.to_vec();
    if matches!(driving, Driving::Servo { .. }) || kind == Kind::Arm || kind == Kind::PlanarArm {
        families.retain(|f| !matches!(f, Family::Pushes | Family::FreeDecay));
    }
    rng.shuffle(&mut families);
    let mut wanted: Vec<Family> = Vec::new();
    if telling {
        for name in names {
            wanted.extend(priors::telling(name).iter().filter(|f| families.contains(f)));
        }
    }
    wanted.push(Family::Ramp);
    let held_family = families.iter().copied().find(|f| !wanted.contains(f)).unwrap_or(Family::Sines);
    wanted.extend(families.iter().copied().filter(|f| *f != held_family));
    let mut seen: Vec<Family> = Vec::new();
    for family in wanted {
        if family != held_family && (seen.len() < 5) && !seen.contains(&family) {
            seen.push(family);
        }
    }
    rng.shuffle(&mut seen);
    (held_family, seen)
}
