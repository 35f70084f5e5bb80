//! Can anybody see an effect in these data? Whoever is told everything but the effect predicts windows of one second from their
//! true starts; what is left after the known parameters have been refitted within their tolerance, and after the nearest simpler
//! effects have been tried, is held against the noise.
//!
//! With `r` the residual at `N` samples in windows of `n`, `snr^2 = N mean(r^2) / (s_q^2 + (e^2 + f^2) n / 2)`: `s_q` is the position's
//! noise, `e` what the effort's noise does to a predicted position (`s_u / m sqrt(h / 12)` over a window of 1 s, inputs held for `h`),
//! `f` a floor of 0.5 % of the windows' motion for the engines' own errors. The last two are smooth within a window, so a window
//! counts as two samples for them.

use nalgebra::{DMatrix, DVector};
use sagci_model::{EffectEntry, ObjectModel};
use sagci_recording::Log;
use serde::{Deserialize, Serialize};

use crate::EvaluationError;
use crate::effect::Hold;
use crate::plant::{Mechanism, Plant, RungeKutta};
use crate::simulate::{Run, simulate};

/// A ratio above which an effect counts as visible: 32 nats of likelihood.
pub const VISIBLE: f64 = 8.0;

/// Windows that are looked at: those that the known predicts worst, and as many spread over the others, which stand for them all.
const WINDOWS: usize = 7;

/// How far an effect stands out.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Detectability {
    /// RMS of the prediction's error without the effect, over windows of 1 s, rad or m.
    pub rms: f64,
    /// Signal to noise with the known parameters refitted.
    pub snr: f64,
    /// Signal to noise with the nearest simpler effects tried in its place too.
    pub snr_beyond_neighbours: f64,
}

impl Detectability {
    /// Does it show that something is missing?
    pub fn is_visible(&self) -> bool {
        self.snr >= VISIBLE
    }

    /// Does it show what is missing?
    pub fn is_nameable(&self) -> bool {
        self.snr_beyond_neighbours >= VISIBLE
    }
}

/// What the oracle looks at.
pub(crate) struct Problem<'a> {
    pub body: &'a ObjectModel,
    /// The other hidden effects, which the oracle knows.
    pub others: &'a [EffectEntry],
    pub entry: &'a str,
    /// Slot of the joint.
    pub joint: usize,
    /// RMS effort and velocity, and range.
    pub scale: (f64, f64, [f64; 2]),
    pub runs: &'a [Run],
    /// Noise of positions and efforts.
    pub readings: [&'a [f64]; 2],
    pub effort_is_measured: bool,
    pub known: &'a ObjectModel,
    /// Bias and rate of each joint's measured effort.
    pub effort_drift: &'a [[f64; 2]],
}

/// A tilt a quarter of a turn from another: both together are one of any phase.
const TILT_ACROSS: &str = "hinge_tilt across";

/// Simpler effects, or those most like it: several that are tried together, or others instead.
fn neighbours(name: &str) -> &'static [&'static [&'static str]] {
    match name {
        "viscous_friction" => &[&["coulomb_friction"]],
        "coulomb_friction" => &[&["viscous_friction"]],
        "quadratic_drag" | "soft_close_damper" => &[&["viscous_friction", "coulomb_friction"]],
        "asymmetric_friction" => &[&["coulomb_friction", "viscous_friction", "torque_bias"]],
        "stribeck_friction" | "presliding_hysteresis" | "load_dependent_friction" | "position_dependent_friction" => {
            &[&["coulomb_friction", "viscous_friction"]]
        }
        // A gap that the load never opens is the rotor's inertia.
        "backlash" => &[&["coulomb_friction", "viscous_friction"], &["armature_inertia"]],
        "cable_hysteresis" => &[&["joint_spring", "torque_bias", "coulomb_friction", "viscous_friction"]],
        "magnetic_gasket" | "latch" | "detent" | "air_suction" | "hard_stop" => &[&["joint_spring", "torque_bias"]],
        "joint_spring" | "hinge_tilt" | "sensor_drift" | "encoder_offset" => &[&["torque_bias"]],
        "joint_elasticity" => &[&["armature_inertia", "viscous_friction"]],
        "actuator_saturation" => &[&["torque_gain"]],
        // A weight near the axis pulls as a tilt does.
        "payload" => &[&["armature_inertia"], &["hinge_tilt", TILT_ACROSS]],
        _ => &[],
    }
}

/// A fit's unknowns.
struct Unknown {
    step: f64,
    lower: f64,
    upper: f64,
    start: f64,
}

/// One window: run, first tick, the tick after the last.
type Window = (usize, usize, usize);

/// Known parameters that may be refitted: mass, centre along three axes, damping, friction.
const KNOWN: usize = 6;

fn hypothesis(problem: &Problem, names: &[&str], x: &[f64], longest: f64) -> Result<RungeKutta, EvaluationError> {
    let mut body = problem.body.clone();
    let moving: Vec<usize> = body.moving_joints().collect();
    let j = moving[problem.joint];
    let child = body.joints[j].child;
    let inertial = &mut body.links[child].inertial;
    inertial.mass *= 1.0 + x[0];
    inertial.I_LLcm_L *= 1.0 + x[0];
    inertial.p_LoLcm += nalgebra::Vector3::new(x[1], x[2], x[3]);
    body.joints[j].damping *= (1.0 + x[4]).max(0.0);
    body.joints[j].friction *= (1.0 + x[5]).max(0.0);
    let mut effects = problem.others.to_vec();
    let middle = (problem.scale.2[0] + problem.scale.2[1]) / 2.0;
    for (name, value) in names.iter().zip(&x[KNOWN..]) {
        let parameters = match *name {
            "viscous_friction" => vec![("damping", *value)],
            "coulomb_friction" => vec![("friction", *value)],
            "torque_bias" => vec![("bias", *value)],
            "joint_spring" => vec![("stiffness", *value), ("rest_position", middle)],
            "armature_inertia" => vec![("inertia", *value)],
            "hinge_tilt" => vec![("amplitude", *value), ("phase", 0.0)],
            TILT_ACROSS => vec![("amplitude", *value), ("phase", std::f64::consts::FRAC_PI_2)],
            "torque_gain" => vec![("gain_error", *value)],
            _ => vec![],
        };
        effects.push(EffectEntry {
            effect: if *name == TILT_ACROSS { "hinge_tilt" } else { name }.into(),
            joint: Some(body.joints[j].name.clone()),
            parameters: parameters.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(),
            ..EffectEntry::default()
        });
    }
    RungeKutta::new(Mechanism::new(&body, &effects)?, longest)
}

/// Where windows begin and end: run, first tick, last tick.
fn windows(runs: &[Run]) -> Vec<Window> {
    let mut all = Vec::new();
    for (r, run) in runs.iter().enumerate() {
        let Some(&first) = run.time.first() else { continue };
        let Some(&last) = run.time.last() else { continue };
        let mut t = first;
        while t + 1.0 <= last {
            let from = run.time.partition_point(|s| *s < t);
            let to = run.time.partition_point(|s| *s <= t + 1.0);
            all.push((r, from, to));
            t += 0.5;
        }
    }
    all
}

/// Errors of a prediction in the windows, at every fifth tick, over all joints, times the root of the windows' weights.
fn errors(problem: &Problem, plant: &mut RungeKutta, over: &[(Window, f64)]) -> Vec<f64> {
    let mut out = Vec::new();
    let n = problem.readings[0].len();
    for &((r, from, to), weight) in over {
        let run = &problem.runs[r];
        let time = &run.time[from..to];
        let back = from.saturating_sub(40);
        let measured = |k: usize, j: usize| run.delivered[k][j] + problem.effort_drift[j][0] + problem.effort_drift[j][1] * run.time[k];
        let held = |k: usize| -> Vec<Hold> {
            (0..n).map(|j| if problem.effort_is_measured { Hold::Effort(measured(k, j)) } else { run.hold[k][j] }).collect()
        };
        let before: Vec<(f64, Vec<Hold>)> = (back..from).map(|k| (run.time[k], held(k))).collect();
        let mut input = |k: usize, _: f64, _: &[f64], _: &[f64]| held(from + k);
        let predicted = simulate(plant, time, &before, (&run.position[from], &run.velocity[from]), &mut input);
        for k in (0..time.len()).step_by(5) {
            for j in 0..n {
                let guess = predicted.as_ref().ok().and_then(|p| p.q.get(k)).map_or(f64::NAN, |q| q[j]);
                let off = run.position[from + k][j] - guess;
                // A prediction that runs away is as wrong as the range is long.
                let most = problem.scale.2[1] - problem.scale.2[0];
                out.push(weight.sqrt() * if off.is_finite() { off.clamp(-most, most) } else { most });
            }
        }
    }
    out
}

/// How far an effect stands out of the known and of its neighbours.
///
/// # Errors
/// A mechanism that cannot be simulated.
pub(crate) fn detect(problem: &Problem) -> Result<Detectability, EvaluationError> {
    let drift = problem.effort_drift[problem.joint];
    if problem.entry == "sensor_drift" && !problem.effort_is_measured && drift != [0.0; 2] {
        // What is commanded is known: the measured effort departs from it by the drift alone.
        let square: f64 = problem.runs.iter().flat_map(|r| &r.time).map(|t| (drift[0] + drift[1] * t).powi(2)).sum();
        let snr = square.sqrt() / problem.readings[1][problem.joint];
        return Ok(Detectability { rms: 0.0, snr, snr_beyond_neighbours: snr });
    }
    let all = windows(problem.runs);
    let n = problem.readings[0].len();
    const STIFF: [&str; 6] = ["backlash", "hard_stop", "presliding_hysteresis", "joint_elasticity", "unmodelled_mode", "actuator_lag"];
    let stiff = problem.others.iter().any(|e| STIFF.contains(&e.effect.as_str()));
    let longest = if stiff { 2.5e-4 } else { 2.6e-3 };
    let mass = crate::plant::Rigid::new(problem.known)?.at(&vec![0.0; n], &vec![0.0; n]).0;
    let m = mass[(problem.joint, problem.joint)];
    let (mut per_window, mut motion, mut count, mut spacing) = (0.0, 0.0, 0.0, 0.0);
    for &(r, from, to) in &all {
        let run = &problem.runs[r];
        per_window += (to - from) as f64 / all.len() as f64;
        spacing = (run.time[to - 1] - run.time[from]) / (to - 1 - from).max(1) as f64;
        for k in from..to {
            motion += (run.q[k][problem.joint] - run.q[from][problem.joint]).powi(2);
            count += 1.0;
        }
    }
    let noise = problem.readings[0][problem.joint];
    let by_effort = if problem.effort_is_measured { problem.readings[1][problem.joint] / m * (spacing / 12.0_f64).sqrt() } else { 0.0 };
    let floor = 0.005 * (motion / f64::max(count, 1.0)).sqrt();
    let variance = noise * noise + (by_effort * by_effort + floor * floor) * per_window / 2.0;

    // The windows that the known predicts worst, and some that stand for the rest.
    let each: Vec<(Window, f64)> = all.iter().map(|w| (*w, 1.0)).collect();
    let plain = errors(problem, &mut hypothesis(problem, &[], &[0.0; KNOWN], longest)?, &each);
    let mut begins = 0;
    let mut ranked: Vec<(f64, Window)> = Vec::new();
    for &(r, from, to) in &all {
        let length = (to - from).div_ceil(5) * n;
        ranked.push((plain[begins..begins + length].iter().map(|e| e * e).sum(), (r, from, to)));
        begins += length;
    }
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let rest = ranked.len().saturating_sub(WINDOWS);
    let mut over: Vec<(Window, f64)> = ranked.iter().take(WINDOWS).map(|(_, w)| (*w, 1.0)).collect();
    let others: Vec<Window> = ranked.iter().skip(WINDOWS).step_by(rest.div_ceil(WINDOWS).max(1)).map(|(_, w)| *w).collect();
    over.extend(others.iter().map(|w| (*w, rest as f64 / others.len() as f64)));
    // Over a quarter of a window nothing has fallen yet.
    let short: Vec<(Window, f64)> = over.iter().map(|((r, from, to), weight)| ((*r, *from, from + (to - from) / 4), *weight)).collect();

    // Every fifth tick is looked at, and windows overlap by half.
    let (effort, velocity, range) = problem.scale;
    let snr = |square: f64| (square * 2.5 / variance).sqrt();
    let moving: Vec<usize> = problem.body.moving_joints().collect();
    let joint = &problem.body.joints[moving[problem.joint]];
    let fit = |names: &[&str], rounds: usize, over: &[(Window, f64)], begin: Option<&[f64]>| -> Result<(f64, Vec<f64>), EvaluationError> {
        let known = |step: f64, [lower, upper]: [f64; 2], open: bool| {
            let [lower, upper] = [lower.min(0.0), upper.max(0.0)];
            Unknown { step: if open { step } else { 0.0 }, lower, upper, start: 0.0 }
        };
        // Tolerances are about what the model states: the truth may lie at the end of one, with twice the room on its other side.
        let [given, true_one] = [problem.known, problem.body].map(|m| &m.links[joint.child].inertial);
        let tolerance = problem.known.document.refit_tolerance;
        let mass = [-1.0, 1.0].map(|side| (1.0 + side * tolerance.mass) * given.mass / true_one.mass - 1.0);
        let centre = |k: usize| [-1.0, 1.0].map(|side| given.p_LoLcm[k] - true_one.p_LoLcm[k] + side * tolerance.center_of_mass);
        let turns = joint.kind != sagci_model::JointKind::Prismatic;
        // What lies along the axis turns nothing.
        let across = |k: usize| turns && joint.axis[k].abs() < 0.9;
        let mut unknown = vec![
            known(0.01, mass, true),
            known(0.002, centre(0), across(0)),
            known(0.002, centre(1), across(1)),
            known(0.002, centre(2), across(2)),
            known(0.05, [-1.0, 1.0], joint.damping > 0.0),
            known(0.05, [-1.0, 1.0], joint.friction > 0.0),
        ];
        for name in names {
            let (size, lower) = match *name {
                "viscous_friction" => (effort / velocity, 0.0),
                "coulomb_friction" => (effort, 0.0),
                "torque_bias" | "hinge_tilt" | TILT_ACROSS => (effort, f64::NEG_INFINITY),
                "joint_spring" => (effort / (range[1] - range[0]), f64::NEG_INFINITY),
                "armature_inertia" => (m, 0.0),
                _ => (1.0, f64::NEG_INFINITY),
            };
            let start = if lower == 0.0 { 0.1 * size } else { 0.0 };
            unknown.push(Unknown { step: 0.03 * size, lower, upper: f64::INFINITY, start });
        }
        let free: Vec<usize> = (0..unknown.len()).filter(|&k| unknown[k].step > 0.0).collect();
        let evaluate = |x: &[f64]| -> Result<DVector<f64>, EvaluationError> {
            let mut plant = hypothesis(problem, names, x, longest)?;
            Ok(DVector::from_vec(errors(problem, &mut plant, over)))
        };
        let mut x: Vec<f64> = begin.map_or_else(|| unknown.iter().map(|u| u.start).collect(), <[f64]>::to_vec);
        let mut r = evaluate(&x)?;
        for _ in 0..rounds {
            let mut J = DMatrix::zeros(r.len(), free.len());
            for (column, &k) in free.iter().enumerate() {
                let mut moved = x.clone();
                moved[k] += unknown[k].step;
                J.set_column(column, &(evaluate(&moved)? - &r));
            }
            let mut H = J.transpose() * &J;
            let g = J.transpose() * &r;
            let ridge = 1e-9 * H.trace() + 1e-30;
            for k in 0..free.len() {
                H[(k, k)] += ridge;
            }
            let before = r.norm_squared();
            let mut gained = 0.0;
            for damping in [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3] {
                let mut damped = H.clone();
                for k in 0..free.len() {
                    damped[(k, k)] *= 1.0 + damping;
                }
                let Some(step) = damped.lu().solve(&g) else { break };
                let mut next = x.clone();
                for (s, &k) in step.iter().zip(&free) {
                    next[k] = (x[k] - s * unknown[k].step).clamp(unknown[k].lower, unknown[k].upper);
                }
                if next.iter().any(|x| !x.is_finite()) {
                    break;
                }
                let trial = evaluate(&next)?;
                if trial.norm_squared() < before {
                    gained = before - trial.norm_squared();
                    (x, r) = (next, trial);
                    break;
                }
            }
            if gained < 0.02 * before {
                break;
            }
        }
        Ok((r.norm_squared(), x))
    };
    // Where a joint may fall either way, whole windows have a valley for each: their beginnings say in which the known belongs.
    let near = fit(&[], 15, &short, None)?.1;
    let known = fit(&[], 15, &over, None)?.0.min(fit(&[], 15, &over, Some(&near))?.0);
    let mut beyond = known;
    for names in neighbours(problem.entry) {
        beyond = beyond.min(fit(names, 15, &over, None)?.0);
    }
    let rms = (plain.iter().map(|e| e * e).sum::<f64>() / plain.len().max(1) as f64).sqrt();
    Ok(Detectability { rms, snr: snr(known), snr_beyond_neighbours: snr(beyond) })
}

/// RMS error of the true mechanism's prediction of held-out logs over windows of 1 s from true starts, pooled over joints in shares
/// of their ranges.
pub(crate) fn gap(
    truth: &mut RungeKutta,
    runs: &[Run],
    logs: &[Log],
    moving: &[usize],
    known: &ObjectModel,
    ranges: &[f64],
    effort_is_measured: bool,
) -> f64 {
    let inner = truth.mechanism().joints.iter().any(|j| j.states() > 0);
    let n = moving.len();
    let mut square = vec![(0.0, 0usize); n];
    for (r, from, to) in windows(runs) {
        let (run, log) = (&runs[r], &logs[r]);
        let joints: Vec<_> = moving.iter().filter_map(|&j| log.joint(&known.joints[j].name)).collect();
        if joints.len() != n {
            return f64::NAN;
        }
        let held = |k: usize| -> Vec<Hold> {
            (0..n)
                .map(|j| match &joints[j].effort {
                    Some(effort) if effort_is_measured => Hold::Effort(effort.value[k]),
                    _ => run.hold[k][j],
                })
                .collect()
        };
        // Inner states are not in the log; without them the mechanism is known to have gone where it went.
        let predicted = if inner {
            None
        } else {
            let before: Vec<(f64, Vec<Hold>)> = (from.saturating_sub(40)..from).map(|k| (run.time[k], held(k))).collect();
            let mut input = |k: usize, _: f64, _: &[f64], _: &[f64]| held(from + k);
            simulate(truth, &run.time[from..to], &before, (&run.q[from], &run.v[from]), &mut input).ok()
        };
        for k in from..to {
            for j in 0..n {
                let guess = predicted.as_ref().map_or(run.position[k][j], |p| p.position[k - from][j]);
                square[j].0 += (joints[j].position.value[k] - guess).powi(2);
                square[j].1 += 1;
            }
        }
    }
    (square.iter().zip(ranges).map(|((s, c), range)| s / (*c).max(1) as f64 / (range * range)).sum::<f64>() / n as f64).sqrt()
}
