//! One trajectory: inputs held from tick to tick, delayed where the drive delays them, and readings at their instants.

use crate::EvaluationError;
use crate::effect::Hold;
use crate::plant::Plant;

/// What happened. All by tick, then by joint of the log (without the base).
#[derive(Debug, Clone, Default)]
pub(crate) struct Run {
    /// Stamps, s.
    pub time: Vec<f64>,
    /// What is held from each stamp to the next.
    pub hold: Vec<Vec<Hold>>,
    /// What the encoders say, without noise.
    pub position: Vec<Vec<f64>>,
    pub velocity: Vec<Vec<f64>>,
    /// What the drives give.
    pub delivered: Vec<Vec<f64>>,
    /// True states.
    pub q: Vec<Vec<f64>>,
    pub v: Vec<Vec<f64>>,
}

impl Run {
    /// Forgets what came after so many ticks.
    pub fn truncate(&mut self, rows: usize) {
        self.time.truncate(rows);
        self.hold.truncate(rows);
        for all in [&mut self.position, &mut self.velocity, &mut self.delivered, &mut self.q, &mut self.v] {
            all.truncate(rows);
        }
    }
}

/// Where the inputs come from: `(tick, time, q, v) -> input of each joint`.
pub(crate) type Input<'a> = dyn FnMut(usize, f64, &[f64], &[f64]) -> Vec<Hold> + 'a;

/// Runs a plant along the ticks, from a state at the first of them. `before` are inputs from before, with their stamps, oldest
/// first; where there are none, drives that delay begin with no effort.
///
/// # Errors
/// The motion runs away.
pub(crate) fn simulate(
    plant: &mut dyn Plant,
    time: &[f64],
    before: &[(f64, Vec<Hold>)],
    start: (&[f64], &[f64]),
    input: &mut Input,
) -> Result<Run, EvaluationError> {
    let base = plant.mechanism().base;
    let n = plant.mechanism().joints.len() - base;
    let Some((&first, &last)) = time.first().zip(time.last()) else { return Ok(Run::default()) };
    let sensors: Vec<(f64, f64)> = plant.mechanism().joints[base..].iter().map(|j| (j.delay, j.sensor.skew)).collect();
    let padded = |x: &[f64]| [&vec![0.0; base][..], x].concat();
    plant.reset(first, &padded(start.0), &padded(start.1));

    let blank = vec![vec![0.0; n]; time.len()];
    let mut run = Run { position: blank.clone(), velocity: blank, ..Run::default() };
    let mut history: Vec<(f64, Vec<Hold>)> = before.to_vec();
    // Readings that are due, each as its instant, tick and joint.
    let mut due: Vec<(f64, usize, usize)> = Vec::new();
    for (k, &t) in time.iter().enumerate() {
        due.extend(sensors.iter().enumerate().map(|(j, &(_, skew))| (t - skew, k, j)));
    }
    due.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut next_due = 0;
    let overtime = sensors.iter().map(|s| (-s.1).max(0.0)).fold(0.0, f64::max);

    let read = |plant: &dyn Plant, now: f64, next: &mut usize, run: &mut Run| {
        while let Some(&(at, k, j)) = due.get(*next).filter(|d| d.0 <= now + 1e-9) {
            let _ = at;
            let (p, v) = plant.reading(base + j);
            (run.position[k][j], run.velocity[k][j]) = (p, v);
            *next += 1;
        }
    };
    for (k, &t) in time.iter().enumerate() {
        read(plant, t, &mut next_due, &mut run);
        let (q, v) = (plant.q()[base..].to_vec(), plant.v()[base..].to_vec());
        let hold = input(k, t, &q, &v);
        run.time.push(t);
        run.q.push(q);
        run.v.push(v);
        history.push((t, hold.clone()));
        run.hold.push(hold);
        let end = time.get(k + 1).copied().unwrap_or(last + overtime);
        // Instants within the tick at which a delayed input changes or a reading is due.
        let mut breaks: Vec<f64> = Vec::new();
        for &(delay, _) in sensors.iter().filter(|s| s.0 > 0.0) {
            breaks.extend(history.iter().rev().map(|(s, _)| s + delay).take_while(|&s| s > t).filter(|&s| s < end));
        }
        breaks.extend(due[next_due..].iter().map(|d| d.0).take_while(|&s| s < end).filter(|&s| s > t));
        breaks.push(end);
        breaks.sort_by(f64::total_cmp);
        let mut at = t;
        for (number, &until) in breaks.iter().enumerate() {
            let acting: Vec<Hold> = (0..base)
                .map(|_| Hold::Effort(0.0))
                .chain(sensors.iter().enumerate().map(|(j, &(delay, _))| {
                    let past = history.iter().rev().find(|(s, _)| s + delay <= at + 1e-9);
                    past.map_or(Hold::Effort(0.0), |(_, h)| h[j])
                }))
                .collect();
            if number == 0 {
                run.delivered.push((0..n).map(|j| plant.delivered(base + j, acting[base + j])).collect());
            }
            if until - at > 1e-9 {
                plant.advance(until, &acting)?;
                at = until;
            }
            if until < end {
                read(plant, until, &mut next_due, &mut run);
            }
        }
    }
    read(plant, f64::INFINITY, &mut next_due, &mut run);
    Ok(run)
}
