//! `u(t - delay)`: the message is on its way. Inputs are held between steps, so over a step the delayed input is piecewise constant;
//! what goes on is its mean over the step, which is exact in impulse and continuous, piecewise linear, in `delay`.
//!
//! The history is a ring of the last [`HISTORY`] inputs with the time that each lasted; the inner state says which is the newest.
//! Before it begins the input was zero. Steps shorter than `delay / (HISTORY - 2)` share an entry, as their mean, so the ring always
//! reaches back far enough: with 1 ms steps every input is kept up to a delay of 62 ms.

use super::{Advance, Description, HISTORY, Instant, Law, Number, Parameter, Sample, Transfer, around, unit};

#[derive(Debug)]
pub(super) struct TransportDelay;

static DESCRIPTION: Description = Description {
    name: "transport_delay",
    summary: "the command arrives late: u(t - delay)",
    acts: super::Acts::Command(0),
    // 2 to 30 ms.
    parameters: &[Parameter::new("delay", unit::TIME, [0.0, 1.0], [around(0.008, 0.8), around(0.008, 0.8)]).cited()],
    signature: "phase that grows with frequency",
    confused_with: &["actuator_lag", "clock_skew", "joint_elasticity"],
    experiment: "above 10 Hz, or a step; the command and the measurement apart",
    source: "zero-order hold with dead time; Franklin, Powell, Workman 1998",
    linear: true,
    ..Description::BLANK
};

/// What was put in, as pieces of time relative to the start of the step: from, to, value, and which entry (the step's own input has none).
fn pieces<'a>(at: &'a Instant<'_>) -> impl Iterator<Item = (f64, f64, f64, Option<usize>)> + 'a {
    let newest = head(at.z);
    let (values, durations) = at.z.get(1..).unwrap_or(&[]).split_at(HISTORY.min(at.z.len().saturating_sub(1)));
    let mut to = 0.0;
    let past = (0..values.len().min(durations.len())).map(move |back| {
        let slot = (newest + HISTORY - back) % HISTORY;
        let end = to;
        to -= durations[slot];
        (to, end, values[slot], Some(slot))
    });
    std::iter::once((0.0, at.dt, at.input, None)).chain(past)
}

fn head(z: &[f64]) -> usize {
    // A cast from a float keeps within its type's range.
    z.first().map_or(0, |h| *h as usize % HISTORY)
}

/// The input at one time; at a step in it the mean of both sides.
fn value_at(at: &Instant<'_>, time: f64) -> f64 {
    let near = 1e-9 * at.dt.max(1e-9);
    pieces(at)
        .map(|(from, to, value, _)| {
            // Half of a piece at either of its ends.
            let side = |end: f64| if (end - time).abs() <= near { 0.5 } else { f64::from(u8::from(end < time)) };
            value * (side(from) - side(to))
        })
        .sum()
}

impl Law for TransportDelay {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        1
    }

    fn keeps_history(&self) -> bool {
        true
    }

    fn command<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer<N>) {
        let (first, last) = (-theta[0], at.dt - theta[0]);
        if at.dt == 0.0 {
            out.output = N::constant(value_at(at, first));
            return;
        }
        let (mut value, mut own) = (0.0, 0.0);
        for (from, to, input, slot) in pieces(at) {
            let weight = (to.min(last) - from.max(first)).max(0.0) / at.dt;
            value += weight * input;
            match slot {
                Some(slot) => out.d_history[slot] = weight,
                None => own = weight,
            }
            if from <= first {
                break;
            }
        }
        let by_delay = if N::COMPLETE { (value_at(at, first) - value_at(at, last)) / at.dt } else { 0.0 };
        let x = at.variables::<N>(theta);
        out.output = x.input.mix(own, &x.theta[0], by_delay, value);
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        let newest = head(at.z);
        let (value, duration) = (at.z[1 + newest], at.z[1 + HISTORY + newest]);
        let shared = duration > 0.0 && duration < theta[0] / (HISTORY - 2) as f64 * (1.0 - 1e-9);
        let slot = if shared { newest } else { (newest + 1) % HISTORY };
        let before = if shared { duration } else { 0.0 };
        let duration = before + at.dt;
        let (d_slot, d_input) = (before / duration, at.dt / duration);
        let value = if shared { d_slot * value } else { 0.0 } + d_input * at.input;
        out.z[0] = N::constant(slot as f64);
        out.sample = Some(Sample { slot, value, duration, d_input, d_slot });
    }
}
