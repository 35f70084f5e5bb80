//! Where the fit of an effect begins: sizes from the data's own forces, speeds and range.

use std::f64::consts::{FRAC_PI_2, TAU};

use sagci_dynamics::effects;

use crate::choice::channel;

/// What the data of one joint look like, seen by a model.
#[derive(Debug, Clone)]
pub(crate) struct JointView {
    /// RMS of the force that the model lacks, N m or N.
    pub force: f64,
    /// RMS of velocities.
    pub speed: f64,
    /// Positions that were reached, and those between which it is but for a few moments.
    pub range: [f64; 2],
    pub usual: [f64; 2],
    /// It turns.
    pub turns: bool,
    /// Inertia that a drive at the joint feels.
    pub inertia: f64,
    /// Efforts of its drive without their signs, by size, N m or N.
    pub efforts: Vec<f64>,
    /// Positions at which the lacking force stands out, the most conspicuous first.
    pub places: Vec<f64>,
    /// What it is pressed into at the ends of its way, where it hardly moves.
    pub pressed: Vec<Pressed>,
    /// Cycles a turn at which the lacking force repeats, the strongest first.
    pub cycles: Vec<f64>,
    /// Length of the data in time, s.
    pub duration: f64,
    /// Usual sample time, s.
    pub period: f64,
    /// Gravity acts on it.
    pub hangs: bool,
    /// Mass of what the joint moves, kg, and where it is in the link's frame, m.
    pub mass: f64,
    pub p_LoLcm: [f64; 3],
    /// The joint's axis in the link's frame.
    pub axis: [f64; 3],
    /// Gravity in the link's frame where all joints are at zero, m/s^2.
    pub gravity: [f64; 3],
}

/// A force that sets in at a position and grows beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pressed {
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// Where it sets in, rad or m.
    pub position: f64,
    /// Minus one at the lower end.
    pub side: f64,
}

impl JointView {
    /// How far places lie apart, rad or m: on a joint that turns more than once they come back.
    pub fn way(&self) -> f64 {
        let range = self.range[1] - self.range[0];
        if self.turns { range.min(TAU) } else { range }
    }
}

/// Share of the joint's inertia that a rotor begins with.
const SHARE_OF_ROTOR: f64 = 0.15;
/// Frequencies at which rotors swing against a link that is held, Hz, and how many times as fast each start's does as the one before.
const ROTOR: [f64; 2] = [2.2, 42.0];
const STEP_OF_ROTOR: f64 = 1.06;
/// The same of light bases that give way.
const LIGHT: [f64; 2] = [2.0, 22.0];
const STEP_OF_LIGHT: f64 = 1.15;

/// Times by which an input or a stamp may be late, s, where rows are so far apart: where little noise hides a motion, a fit finds its way over
/// some rows and no farther.
const LATE: [f64; 5] = [0.003, 0.008, 0.014, 0.02, 0.027];

fn lateness(period: f64) -> impl Iterator<Item = f64> {
    LATE.into_iter().map(move |late| late.max(period))
}

/// From one frequency to another, each so many times as fast as the one before.
fn steps([from, to]: [f64; 2], times: f64) -> impl Iterator<Item = f64> {
    (0..=((to / from).ln() / times.ln()) as i32).map(move |i| from * times.powi(i))
}

/// Values of an effect's parameters, in its order, at which fits begin.
pub(crate) fn starts(effect: &str, view: &JointView) -> Vec<Vec<f64>> {
    let JointView { force: f, speed: v, inertia: m, range: [low, high], period: h, .. } = *view;
    let r = view.way().max(1e-6);
    let v = v.max(1e-6);
    let middle = 0.5 * (low + high);
    let places: Vec<f64> = view.places.iter().copied().take(4).collect();
    let each = |make: &dyn Fn(f64) -> Vec<f64>, values: &[f64]| values.iter().map(|x| make(*x)).collect::<Vec<_>>();
    match effect {
        "viscous_friction" => vec![vec![f / v]],
        "coulomb_friction" => vec![vec![f]],
        "asymmetric_friction" => vec![vec![f, 0.5 * f, 0.2 * f / v, 0.2 * f / v], vec![0.5 * f, f, 0.2 * f / v, 0.2 * f / v]],
        "stribeck_friction" => each(&|s| vec![0.6 * f, 1.2 * f, s, 2.0], &[v / 30.0, v / 8.0, v / 2.5]),
        "quadratic_drag" => vec![vec![f / (v * v)]],
        "presliding_hysteresis" => each(&|s| vec![f / (s * r), 0.02 * f / v, f, 1.2 * f, v / 8.0], &[1e-3, 6e-3, 3e-2]),
        "load_dependent_friction" => vec![vec![0.1]],
        "position_dependent_friction" => {
            let mut all = each(&|p| vec![0.5 * f, f, p, r / 8.0], &places);
            all.push(vec![f, -0.5 * f, middle, r / 6.0]);
            all
        }
        "joint_spring" => each(&|q0| vec![f / r, q0], &[middle, low - 0.5 * r, high + 0.5 * r]),
        // What slides has no hinge: there gravity is a constant.
        "hinge_tilt" if !view.turns => Vec::new(),
        "hinge_tilt" => vec![vec![f, 0.0], vec![f, FRAC_PI_2]],
        "cable_hysteresis" => each(&|l| vec![0.5 * f / r, middle, f, l * r, 0.1 * f / v], &[0.02, 0.1]),
        "torque_bias" => vec![vec![0.3 * f]],
        "magnetic_gasket" => {
            let mut all = Vec::new();
            for shape in [0.0, 1.0] {
                all.extend(each(&|w| vec![2.0 * f, w * r, shape], &[0.01, 0.05]));
            }
            all
        }
        "air_suction" => {
            [0.5, 6.0].iter().flat_map(|t| each(&|s| vec![f / (0.05 * r), *t, s], &[low + 0.03 * r, low + 0.15 * r, 0.0])).collect()
        }
        "latch" => {
            let mut at = vec![low.max(0.0) + 0.02 * r];
            at.extend(&places);
            at.iter().take(4).flat_map(|p| each(&|w| vec![4.0 * f, 1.5 * f, *p, w * r], &[0.02, 0.08])).collect()
        }
        "detent" => places.iter().flat_map(|p| each(&|w| vec![2.0 * f, *p, w * r], &[0.02, 0.06])).collect(),
        // Its force jumps where the cartridge catches, and a fit does not find there from afar.
        "soft_close_damper" => (2..20).map(|i| vec![2.0 * f / v, low + 0.05 * f64::from(i) * r, 0.5 * f / r]).collect(),
        "hard_stop" => {
            let k = (20.0 * m * (TAU * 4.0).powi(2)).max(f / (0.01 * r));
            // At the ends of the motion, or as far before them as it takes to stop a joint; a soft one also where the force is.
            let end = |depth: f64, k: f64| [vec![k, 0.1 * k, high - depth, 1.0], vec![k, 0.1 * k, low + depth, -1.0]];
            let stopped = [0.003 * r, 0.03 * r, 0.1 * r, 0.25 * r].into_iter().flat_map(|depth| end(depth, m * (v / depth).powi(2)));
            // A joint may begin a recording beyond its stop, which then throws it out.
            let [bottom, top] = view.usual;
            let passed = [vec![k, 0.1 * k, top - 0.01 * r, 1.0], vec![k, 0.1 * k, bottom + 0.01 * r, -1.0]];
            let pressed = view.pressed.iter().map(|p| vec![p.stiffness, 0.1 * p.stiffness, p.position, p.side]);
            let ends = end(0.01 * r, k).into_iter().chain(stopped).chain(passed).chain(pressed);
            let amid = places.iter().flat_map(|p| [1.0, -1.0].map(|side| vec![4.0 * f / r, 2.0 * f / v, *p, side]));
            ends.chain(amid).collect()
        }
        // The encoder is on the link unless the model says so.
        "backlash" => {
            let gaps = [1.0 / 1000.0, 1.0 / 400.0, 1.0 / 200.0, 1.0 / 100.0, 1.0 / 50.0, 1.0 / 25.0];
            [0.03, 0.2].iter().flat_map(|share| each(&|g| vec![g * r, share * m, effects::RIGID_TEETH, 0.0, 0.0], &gaps)).collect()
        }
        "joint_elasticity" => {
            // The filter holds the link where it is measured, and the rotor swings against it: only a start whose rotor swings as fast, to three
            // hundredths where little damps it, keeps in step with what is seen. Of its inertia any will do.
            let start = |hz: f64| {
                let rate = TAU * hz;
                let k = SHARE_OF_ROTOR * m * rate * rate;
                vec![k, 0.12 * k / rate, SHARE_OF_ROTOR * m, 0.0]
            };
            steps(ROTOR, STEP_OF_ROTOR).map(start).collect()
        }
        "torque_ripple" => view.cycles.iter().take(3).flat_map(|c| each(&|p| vec![f, *c, p], &[0.0, FRAC_PI_2])).collect(),
        "transport_delay" => lateness(h).map(|d| vec![d]).collect(),
        "actuator_lag" => each(&|t| vec![t], &[h.max(0.004), 0.015]),
        "armature_inertia" => vec![vec![0.1 * m]],
        "torque_gain" => vec![vec![0.05]],
        // Below a few peaks, or below so much of all the time.
        "actuator_saturation" => {
            let most = view.efforts.last().copied().unwrap_or(0.0);
            let quantile = |q: f64| view.efforts.get((q * view.efforts.len() as f64) as usize).copied().unwrap_or(most);
            let limits = [0.9 * most, 0.65 * most, quantile(0.97), quantile(0.9), quantile(0.75), quantile(0.5)];
            each(&|limit| vec![limit.max(1e-6)], &limits)
        }
        "payload" => {
            // Where the link has its mass, and, where gravity tells, as far from there to all sides of the axis, and beyond it.
            let center = nalgebra::Vector3::from(view.p_LoLcm);
            let axis = nalgebra::Vector3::from(view.axis);
            let beyond = 2.0 * axis.dot(&center) * axis - center;
            let reach = center.norm().max(0.05);
            let around = across(view.axis).into_iter().flat_map(|d| [center + reach * d, center - reach * d]);
            let around = around.chain([beyond]).filter(|_| view.hangs);
            std::iter::once(center).chain(around).map(|p| vec![0.2 * view.mass, p.x, p.y, p.z]).collect()
        }
        "joint_axis_error" => {
            let ways = across(view.axis);
            let turned = ways.iter().map(|d| vec![0.02, d.x, d.y, d.z, 0.0, 0.0, 0.0]);
            turned.chain(ways.iter().map(|d| vec![0.0, 0.0, 0.0, 0.0, 0.005 * d.x, 0.005 * d.y, 0.005 * d.z])).collect()
        }
        "encoder_offset" => vec![vec![0.005, 0.0], vec![0.0, 0.01]],
        // Of positions, and of efforts.
        "sensor_drift" => {
            let all = [(0.005, 0.01 / view.duration, 0.0), (0.3 * f, f / view.duration, 1.0)];
            all.iter().flat_map(|(bias, rate, of)| [vec![*bias, 0.0, *of], vec![0.0, *rate, *of]]).collect()
        }
        "clock_skew" => lateness(h).flat_map(|s| [vec![s], vec![-s]]).collect(),
        "thermal_wear" => each(&|t| vec![0.3, t * view.duration], &[0.2, 0.7]),
        "unmodelled_mode" => {
            let mode = |hz: f64, share: f64| each(&|d| vec![hz, 0.05, share * view.mass.max(0.1), d], &[0.0, 1.0, 2.0]);
            // A mode of a heavy base is seen within a third of its frequency. A light one, which the link takes along, moves the measured joint as
            // much as what drives it: only a start that swings as fast, to some hundredths, keeps in step with what is seen.
            let heavy = [2.0, 3.0, 4.5, 6.7, 10.0, 15.0, 22.0].into_iter().flat_map(|hz| mode(hz, 10.0));
            heavy.chain(steps(LIGHT, STEP_OF_LIGHT).flat_map(|hz| mode(hz, 1.5))).collect()
        }
        _ => Vec::new(),
    }
}

/// Is it seen near one frequency alone, of which starts know no more than a third?
pub(crate) fn resonates(effect: &str) -> bool {
    matches!(effect, "joint_elasticity" | "unmodelled_mode")
}

/// What starts of an effect add up to, each taken so many times; none where they do not add.
pub(crate) fn sum(effect: &str, parts: &[(f64, &[f64])]) -> Option<Vec<f64>> {
    let first = parts.first()?.1;
    let total = |k: usize| parts.iter().map(|(share, values)| share * values[k]).sum::<f64>();
    match effect {
        "encoder_offset" => Some(vec![total(0), total(1)]),
        "sensor_drift" => Some(vec![total(0), total(1), first[2]]),
        // Small turns add as vectors.
        "joint_axis_error" => {
            let turn: Vec<f64> = (1..4).map(|k| parts.iter().map(|(share, v)| share * v[0] * v[k]).sum()).collect();
            let angle = turn.iter().map(|t| t * t).sum::<f64>().sqrt().max(1e-6);
            Some(vec![angle, turn[0] / angle, turn[1] / angle, turn[2] / angle, total(4), total(5), total(6)])
        }
        _ => None,
    }
}

/// Two directions across an axis.
fn across(axis: [f64; 3]) -> [nalgebra::Vector3<f64>; 2] {
    let a = nalgebra::Vector3::from(axis);
    let other = if a.x.abs() < 0.8 { nalgebra::Vector3::x() } else { nalgebra::Vector3::y() };
    let first = a.cross(&other).normalize();
    [first, a.cross(&first)]
}

/// Where fits of neighbours begin, by their own equations, once an effect is fitted: both loops of friction have a width, a friction that falls with
/// speed has the level that one friction has, and what pulls a joint round as its own weight does a size, which a neighbour's own starts may
/// miss. So has the other shape of a name.
pub(crate) fn neighbours(effect: &str, values: &[f64], view: &JointView) -> Vec<(&'static str, Vec<f64>)> {
    let JointView { speed, range: [low, high], .. } = *view;
    match (effect, values) {
        ("coulomb_friction", &[friction]) => vec![("stribeck_friction", vec![friction, 1.2 * friction, speed.max(1e-6) / 8.0, 2.0])],
        // A friction that hardly falls is one that does not.
        ("stribeck_friction", &[friction, ..]) => vec![("coulomb_friction", vec![friction])],
        // A rotor on a spring too stiff to be seen is an inertia of the joint's.
        ("armature_inertia", &[inertia]) => {
            let on_a_spring = |hz: f64| ("joint_elasticity", vec![inertia * (TAU * hz).powi(2), inertia * TAU * hz, inertia, 0.0]);
            [12.0, 30.0].map(on_a_spring).into()
        }
        // So is one whose play or spring hardly shows. Teeth give way: how fast they part again, and with how much, fits from afar do not find.
        ("backlash", &[half_gap, inertia, stiffness, damping, encoder]) => {
            let begun =
                |pace: f64, share: f64| ("backlash", vec![half_gap, inertia, inertia * pace * pace, 2.0 * share * inertia * pace, encoder]);
            let paces = [100.0, 200.0, 400.0, 800.0, 1600.0];
            let all = paces.into_iter().flat_map(|pace| [0.05, 0.15, 0.4, 1.0].map(|share| begun(pace, share)));
            let without_gap = (stiffness < effects::RIGID_TEETH).then(|| ("joint_elasticity", vec![stiffness, damping, inertia, encoder]));
            all.chain(without_gap).chain([("armature_inertia", vec![inertia])]).collect()
        }
        ("joint_elasticity", &[_, _, inertia, ..]) => vec![("armature_inertia", vec![inertia])],
        // A loop of force F and length l rises by F / l where it begins.
        ("cable_hysteresis", &[_, _, force, length, damping]) => {
            let begun = |velocity: f64| ("presliding_hysteresis", vec![force / length, damping, force, 1.2 * force, velocity]);
            // A peak of a friction that is passed too fast to be seen, and two that are seen.
            [30.0, 8.0, 2.5].map(|share| begun(speed.max(1e-6) / share)).into()
        }
        // Bristles that are too stiff to be seen are none.
        ("presliding_hysteresis", &[stiffness, damping, friction, static_friction, velocity]) => {
            let small = 0.1 * friction / view.way().max(1e-6);
            vec![
                ("cable_hysteresis", vec![small, 0.5 * (low + high), friction, friction / stiffness, damping]),
                ("stribeck_friction", vec![friction, static_friction, velocity, 2.0]),
            ]
        }
        // Both shapes have half of their force in the same place: 1 / (1 + q / w')^2 and exp(-q / w).
        ("magnetic_gasket", &[force, width, shape]) => {
            let wider = std::f64::consts::LN_2 / (std::f64::consts::SQRT_2 - 1.0);
            let other = if shape > 0.5 { [width / wider, 0.0] } else { [width * wider, 1.0] };
            vec![("magnetic_gasket", vec![force, other[0], other[1]])]
        }
        // A late input and a late stamp are one lateness.
        ("transport_delay", &[delay]) => vec![("clock_skew", vec![delay])],
        ("clock_skew", &[skew]) if skew > 0.0 => vec![("transport_delay", vec![skew])],
        ("hinge_tilt", &[amplitude, phase]) if view.turns => payload_that_pulls_so(amplitude, phase, view).into_iter().collect(),
        _ => Vec::new(),
    }
}

/// A point of mass m at p from an axis a, in gravity g, pulls by -m (p . u cos q + p . (u x a) sin q), u = g x a.
fn payload_that_pulls_so(amplitude: f64, phase: f64, view: &JointView) -> Option<(&'static str, Vec<f64>)> {
    let a = nalgebra::Vector3::from(view.axis);
    let u = nalgebra::Vector3::from(view.gravity).cross(&a);
    let side = u.try_normalize(0.1)?;
    let way = -(side * phase.sin() + side.cross(&a) * phase.cos()) * amplitude.signum();
    let center = nalgebra::Vector3::from(view.p_LoLcm);
    let reach = (center - a * a.dot(&center)).norm().max(0.05);
    let p = reach * way;
    Some(("payload", vec![amplitude.abs() / (u.norm() * reach), p.x, p.y, p.z]))
}

/// What decides which effects data can show on a joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    /// A command drove it.
    pub commanded: bool,
    /// The effort that its drive gave was read beside the command.
    pub read: bool,
    /// It went one way only.
    pub one_way: bool,
    /// Gravity moves it.
    pub weighed: bool,
}

/// Can the effect show in such data? A measured effort is what reached the joint: of the drive before it, it says nothing. Where a joint
/// went one way only, a friction that changes with the place or the load is a force that does: the plainer thing is said. Inertia without weight
/// shows beside a weight, whatever drives it; elsewhere it is a payload.
pub(crate) fn observable(effect: &str, seen: Seen) -> bool {
    let both_ways = matches!(effect, "position_dependent_friction" | "load_dependent_friction" | "asymmetric_friction");
    let inertia = effect == "armature_inertia" && seen.weighed;
    (seen.commanded || inertia || channel(effect) != "actuator") && !(both_ways && seen.one_way)
}
