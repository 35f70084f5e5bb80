//! Partial derivatives of every door of every effect against central differences, and numbers that stay numbers.

use rand::RngExt;
use sagci_dynamics::effects::{
    Acts, Advance, Along, Before, Effect, Force, HISTORY, Instant, MAX_STATES, Partial, Reading, Reshape, Resistance, Transfer, catalogue,
    stand,
};

use crate::common::random;
use crate::{draw, draw_all};

/// Everything that an effect says, at `x = [q, v, next, input, load, z, theta]`.
fn everything(effect: &dyn Effect, x: &[f64], dt: f64, history: &[f64]) -> Vec<(&'static str, Partial)> {
    let mut z = x[5..5 + effect.states()].to_vec();
    if effect.keeps_history() {
        z[0] = 3.0;
        z.extend(history);
    }
    let theta = &x[5 + MAX_STATES..];
    let at = Instant { q: x[0], v: x[1], next: x[2], dt, input: x[3], load: x[4], time: 0.7, z: &z };
    let mut out = Vec::new();
    let mut resistance = Resistance::default();
    effect.resist(theta, &at, &mut resistance);
    assert_eq!(effect.force(theta, &at), Force::from(&resistance), "{effect:?}: a step sees another force than its derivatives");
    out.push(("smooth", resistance.smooth));
    out.extend(resistance.dry.map(|d| ("dry", d)));
    for stop in resistance.stops.iter().flatten() {
        out.push(("stop", stop.force));
        // The line that the step solves is the force where it pushes.
        let push = (stop.offset + stop.slope * stop.side * at.next).max(0.0);
        assert!((push * stop.side - stop.force.value).abs() <= 1e-9 * (1.0 + push), "{effect:?} {push} {stop:?}");
        assert!(stop.slope >= 0.0);
    }
    if dt > 0.0 {
        let mut advance = Advance::default();
        effect.advance(theta, &at, &mut advance);
        out.extend(advance.z.map(|z| ("z", z)));
        if let Some(s) = advance.sample {
            out.push(("sample", Partial { value: s.value, d_input: s.d_input, ..Partial::default() }));
        }
    }
    let mut transfer = Transfer::default();
    effect.command(theta, &at, &mut transfer);
    out.push(("command", transfer.output));
    let mut reading = Reading::perfect(at.q, at.v, at.input, at.time);
    effect.measure(theta, &at, &mut reading);
    out.extend([reading.position, reading.velocity, reading.effort, reading.stamp].map(|r| ("reading", r)));
    let mut reshape = Reshape::default();
    effect.reshape(theta, &mut reshape);
    out.push(("armature", reshape.armature));
    out.extend(reshape.inertia.map(|i| ("inertia", i)));
    out.extend(reshape.turn.iter().chain(&reshape.shift).map(|p| ("pose", *p)));
    out.push(("wear", effect.wear(theta, 0.7)));
    if let Some(s) = effect.sway(theta) {
        out.extend([s.mass, s.damping, s.stiffness].map(|p| ("sway", p)));
    }
    out
}

fn partial(p: &Partial, i: usize) -> f64 {
    match i {
        0 => p.d_q,
        1 => p.d_v,
        2 => p.d_next,
        3 => p.d_input,
        4 => p.d_load,
        i if i < 5 + MAX_STATES => p.d_z[i - 5],
        i => p.d_theta[i - 5 - MAX_STATES],
    }
}

#[test]
fn partial_derivatives_agree_with_central_differences() {
    for effect in catalogue() {
        let description = effect.description();
        let mut rng = random(31);
        let (mut active, mut compared, mut kinks) = (0, 0, 0);
        for trial in 0..400 {
            let kind = trial % 2;
            let dt = [0.0, 1e-3, 5e-3][trial % 3];
            let theta = draw_all(*effect, kind, &mut rng);
            let width = description.parameter("width").map_or(1.0, |i| 3.0 * theta[i]);
            let place = ["position", "seal_position"].iter().find_map(|n| description.parameter(n)).map_or(0.0, |i| theta[i]);
            let near = if rng.random_range(0..4) == 0 { 1.0 } else { width };
            let mut x = vec![place + near * rng.random_range(-1.0..1.0)];
            x.extend((0..4).map(|_| rng.random_range(-1.0..1.0)));
            if dt == 0.0 {
                x[2] = x[1];
            }
            let size = if description.name == "backlash" { theta[0] } else { 0.01 };
            x.extend((0..MAX_STATES).map(|_| size * rng.random_range(-1.0..1.0)));
            x.extend(&theta);
            let history: Vec<f64> = (0..2 * HISTORY).map(|i| if i < HISTORY { rng.random_range(-1.0..1.0) } else { 1e-3 }).collect();
            let here = everything(*effect, &x, dt, &history);
            active += usize::from(here.iter().any(|(what, p)| p.value != 0.0 && !["wear", "reading", "command"].contains(what)));
            for i in 0..x.len() {
                let choice = i >= 5 + MAX_STATES
                    && matches!(description.parameters[i - 5 - MAX_STATES].prior[0], sagci_dynamics::effects::Prior::OneOf(_));
                // A state that counts is no number; neither is the place in a ring.
                let counts = i == 5 && (description.name == "latch" || effect.keeps_history());
                if choice || counts {
                    continue;
                }
                let scale = match i {
                    0 => width.min(1.0),
                    1..5 => 1.0,
                    _ if i < 5 + MAX_STATES => size,
                    _ => x[i].abs().max(1e-3),
                };
                let at = |by: f64| {
                    let mut x = x.clone();
                    x[i] += by;
                    everything(*effect, &x, dt, &history)
                };
                let h = 1e-5 * scale;
                let (plus, minus, far_plus, far_minus) = (at(h), at(-h), at(2.0 * h), at(-2.0 * h));
                for (j, (what, p)) in here.iter().enumerate() {
                    let [a, b, c, d] = [&plus, &minus, &far_plus, &far_minus].map(|v| v[j].1.value);
                    let theirs = (8.0 * (a - b) - (c - d)) / (12.0 * h);
                    let noise = 1e-10 * (p.value.abs() + a.abs() + b.abs()) / h;
                    let size = partial(p, i).abs().max(theirs.abs());
                    // One-sided slopes that differ mark a corner nearby: what there is then is no derivative.
                    let slopes = [(c - a) / h, (a - p.value) / h, (p.value - b) / h, (b - d) / h];
                    let spread = slopes.iter().fold(f64::MIN, |m, s| m.max(*s)) - slopes.iter().fold(f64::MAX, |m, s| m.min(*s));
                    if spread > 1e-3 * size + noise {
                        kinks += 1;
                        continue;
                    }
                    compared += 1;
                    let error = (partial(p, i) - theirs).abs();
                    assert!(
                        error <= 2e-6 * size + noise,
                        "{} {what} by {i} of {x:?}, dt {dt}: {} {theirs}",
                        description.name,
                        partial(p, i)
                    );
                }
            }
        }
        assert!(kinks * 20 < compared, "{}: {kinks} corners, {compared} compared", description.name);
        let acts = !description.parameters.is_empty();
        assert!(!acts || active > 40 || compared > 1000, "{} is hardly ever active in this test", description.name);
    }
}

#[test]
fn a_delayed_command_has_its_derivatives_by_the_history() {
    let effect = sagci_dynamics::effects::find("transport_delay").unwrap();
    let mut rng = random(34);
    for _ in 0..100 {
        let mut z: Vec<f64> = vec![f64::from(rng.random_range(0..HISTORY as u32))];
        z.extend((0..HISTORY).map(|_| rng.random_range(-1.0..1.0)));
        z.extend((0..HISTORY).map(|_| rng.random_range(5e-4..2e-3)));
        let theta = [rng.random_range(0.0..0.03)];
        let value = |z: &[f64]| {
            let mut out = Transfer::default();
            effect.command(&theta, &Instant { dt: 1.3e-3, ..Instant::at(0.0, 0.0, 0.4, 0.0, 0.0, z) }, &mut out);
            out
        };
        let here = value(&z);
        let whole: f64 = here.d_history.iter().sum::<f64>() + here.output.d_input;
        assert!((whole - 1.0).abs() < 1e-12, "a mean has weights that add up to one: {whole}");
        for slot in 0..HISTORY {
            let mut more = z.clone();
            more[1 + slot] += 1.0;
            assert!((value(&more).output.value - here.output.value - here.d_history[slot]).abs() < 1e-12);
        }
    }
}

#[test]
fn no_parameter_within_its_bounds_and_no_state_gives_a_number_that_is_none() {
    let mut rng = random(33);
    let wild = |rng: &mut rand_pcg::Pcg64| {
        let size = 10f64.powf(rng.random_range(-12.0..9.0));
        match rng.random_range(0..8) {
            0 => 0.0,
            i if i % 2 == 0 => size,
            _ => -size,
        }
    };
    for effect in catalogue() {
        let description = effect.description();
        for trial in 0..3000 {
            let theta: Vec<f64> = description
                .parameters
                .iter()
                .map(|p| {
                    let [least, most] = p.bounds;
                    match (p.prior[0], rng.random_range(0..4)) {
                        (sagci_dynamics::effects::Prior::OneOf(_), _) => draw(p, 0, &mut rng),
                        (_, 0) => least,
                        (_, 1) => most,
                        (_, 2) => draw(p, trial % 2, &mut rng),
                        _ => wild(&mut rng).clamp(least, most),
                    }
                })
                .collect();
            let mut x: Vec<f64> = (0..5 + MAX_STATES).map(|_| wild(&mut rng)).collect();
            x.extend(theta);
            let dt = [0.0, 1e-6, 1e-3, 5e-3, 1.0][trial % 5];
            let history: Vec<f64> = (0..2 * HISTORY).map(|_| wild(&mut rng).abs()).collect();
            for (what, p) in everything_unchecked(*effect, &x, dt, &history) {
                let all = std::iter::once(p.value).chain((0..5 + MAX_STATES + 8).map(|i| partial(&p, i)));
                assert!(all.into_iter().all(f64::is_finite), "{} {what}: {p:?} at {x:?}, dt {dt}", description.name);
            }
        }
    }
}

#[test]
fn values_alone_are_to_the_last_bit_those_with_derivatives() {
    let same = |a: f64, b: f64| a.to_bits() == b.to_bits() || a == b;
    for effect in catalogue() {
        let description = effect.description();
        let mut rng = random(35);
        for trial in 0..2000 {
            let dt = [0.0, 1e-3, 5e-3, 1.0][trial % 4];
            let theta = draw_all(*effect, trial / 4 % 2, &mut rng);
            let width = description.parameter("width").map_or(1.0, |i| 3.0 * theta[i]);
            let place = ["position", "seal_position"].iter().find_map(|n| description.parameter(n)).map_or(0.0, |i| theta[i]);
            let mut z: Vec<f64> = (0..effect.states()).map(|_| 10f64.powi(-(trial as i32 % 5)) * rng.random_range(-1.0..1.0)).collect();
            if effect.keeps_history() {
                z[0] = f64::from(rng.random_range(0..HISTORY as u32));
                z.extend((0..2 * HISTORY).map(|i| if i < HISTORY { rng.random_range(-1.0..1.0) } else { rng.random_range(0.0..2e-3) }));
            }
            let [v, next, input, load] = [0; 4].map(|_| [1.0, 0.01, 0.0][rng.random_range(0..3)] * rng.random_range(-1.0..1.0));
            let at = Instant { q: place + width * rng.random_range(-1.0..1.0), v, next, dt, input, load, time: 0.3, z: &z };
            let (mut resistance, mut advance, mut transfer) = (Resistance::default(), Advance::default(), Transfer::default());
            effect.resist(&theta, &at, &mut resistance);
            let force = effect.force(&theta, &at);
            assert_eq!(force, Force::from(&resistance), "{} at {at:?} with {theta:?}", description.name);
            let (total, whole) = (force.total(next), resistance.total(next).value);
            assert!((total - whole).abs() <= 1e-12 * (1.0 + whole.abs()) || resistance.stops != [None; 2], "{total} {whole}");
            effect.command(&theta, &at, &mut transfer);
            assert!(same(effect.command_value(&theta, &at), transfer.output.value), "{} at {at:?}", description.name);
            let (values, sway) = (effect.sway_values(&theta), effect.sway(&theta));
            assert_eq!(values.map(|s| [s.mass, s.damping, s.stiffness]), sway.map(|s| [s.mass, s.damping, s.stiffness].map(|p| p.value)));
            // Inner states do not move at an instant.
            if dt == 0.0 {
                continue;
            }
            effect.advance(&theta, &at, &mut advance);
            let mut after = z.clone();
            effect.advance_values(&theta, &at, &mut after);
            for (i, z) in after.iter().enumerate() {
                let expected = match advance.sample {
                    _ if i < effect.states() => advance.z[i].value,
                    Some(sample) if i == effect.states() + sample.slot => sample.value,
                    Some(sample) if i == effect.states() + HISTORY + sample.slot => sample.duration,
                    _ => at.z[i],
                };
                assert!(same(*z, expected), "{} at {at:?} with {theta:?}: {z} {expected}", description.name);
            }
        }
    }
}

/// A screen asks for all rows at once, a step for one: what is inside has to go from row to row, stay over a pause and begin anew.
#[test]
fn forces_along_a_motion_are_those_of_its_steps() {
    for effect in catalogue().iter().filter(|e| e.description().acts == Acts::Joint) {
        let mut rng = random(36);
        for _ in 0..50 {
            let theta = draw_all(*effect, 0, &mut rng);
            let (mut q, mut v, mut time) = (0.0, 0.3, 0.0);
            let mut row = |k: usize| {
                let before = [Before::Row, Before::Nothing, Before::Pause][if k.is_multiple_of(20) { 1 + k / 20 % 2 } else { 0 }];
                if before != Before::Row {
                    (q, v, time) = (rng.random_range(-1.0..1.0), 0.3, time + 0.1);
                }
                let next = v + 0.05 * rng.random_range(-1.0..1.0);
                let dt = if k % 20 == 19 { 0.0 } else { 5e-3 };
                let at = Instant { q, v, next, dt, input: 0.4, load: -0.2, time, z: &[] };
                (q, v, time) = (q + dt * next, next, time + dt);
                Along { at, before }
            };
            let motion: Vec<Along> = (0..100).map(&mut row).collect();
            let mut z = vec![0.0; effect.states()];
            let mut last = motion[0].at;
            for (k, force) in effect.forces(&theta, &motion).into_iter().enumerate() {
                let Along { at: row, before } = motion[k];
                match before {
                    Before::Row => (),
                    Before::Nothing => z.fill(0.0),
                    Before::Pause => stand(*effect, &theta, last.q, row.time - last.time, &mut z),
                }
                let at = Instant { z: &z, ..row };
                assert_eq!(force, effect.force(&theta, &at).total(at.next), "{} in row {k}", effect.description().name);
                let mut after = z.clone();
                if row.dt > 0.0 {
                    effect.advance_values(&theta, &at, &mut after);
                }
                (z, last) = (after, row);
            }
        }
    }
}

/// As [`everything`], without its own checks, which are made for states that a joint can be in.
fn everything_unchecked(effect: &dyn Effect, x: &[f64], dt: f64, history: &[f64]) -> Vec<(&'static str, Partial)> {
    let mut z = x[5..5 + effect.states()].to_vec();
    if effect.keeps_history() {
        z.extend(history);
    }
    let theta = &x[5 + MAX_STATES..];
    let at = Instant { q: x[0], v: x[1], next: x[2], dt, input: x[3], load: x[4], time: x[0], z: &z };
    let (mut resistance, mut advance, mut transfer) = (Resistance::default(), Advance::default(), Transfer::default());
    let mut reading = Reading::perfect(at.q, at.v, at.input, at.time);
    effect.resist(theta, &at, &mut resistance);
    if dt > 0.0 {
        effect.advance(theta, &at, &mut advance);
    }
    effect.command(theta, &at, &mut transfer);
    effect.measure(theta, &at, &mut reading);
    assert!(resistance.dry.iter().all(|d| d.value >= 0.0), "{effect:?} {x:?}");
    let mut out = vec![("smooth", resistance.smooth), ("wear", effect.wear(theta, x[0])), ("command", transfer.output)];
    out.extend(resistance.dry.map(|d| ("dry", d)));
    out.extend(resistance.stops.iter().flatten().map(|s| ("stop", s.force)));
    out.extend(advance.z.map(|z| ("z", z)));
    out.extend([reading.position, reading.velocity, reading.effort, reading.stamp].map(|r| ("reading", r)));
    let mut reshape = Reshape::default();
    effect.reshape(theta, &mut reshape);
    out.extend(reshape.turn.iter().chain(&reshape.inertia).map(|p| ("reshape", *p)));
    out
}
