//! Sizes of hidden effects, drawn relative to what moves the mechanism anyway: 2 to 50 % of its effort.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use sagci_model::EffectEntry;

use super::excitation::Family;
use super::stage::{Kind, Losses};
use crate::effect::Term;
use crate::random::Random;

/// How a joint is used in a scenario without the effect.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    /// RMS effort, N m or N, and that which one sample in fifty exceeds.
    pub effort: f64,
    pub most: f64,
    /// RMS velocity.
    pub velocity: f64,
    pub range: [f64; 2],
    /// Inertia that the joint feels.
    pub inertia: f64,
    /// Mass of everything that moves, kg.
    pub mass: f64,
    /// Length of a typical lever, m.
    pub length: f64,
    pub turns: bool,
    /// The joint's axis in its own frame.
    pub axis: [f64; 3],
    /// Length of the whole session, s.
    pub session: f64,
}

/// Mechanisms on which an effect can be found.
pub(crate) fn stages(name: &str) -> &'static [Kind] {
    use Kind::{Door, Drawer, OvenDoor, Pendulum, PlanarArm, ServoLink};
    match name {
        "magnetic_gasket" | "air_suction" | "latch" | "soft_close_damper" => &[Door, Drawer, OvenDoor],
        "transport_delay" | "actuator_lag" | "actuator_saturation" | "backlash" | "joint_elasticity" => {
            &[ServoLink, Pendulum, ServoLink, PlanarArm]
        }
        "torque_gain" => &[ServoLink, Pendulum, PlanarArm],
        "torque_ripple" => &[ServoLink, Pendulum, Drawer],
        "clock_skew" => &[ServoLink, Pendulum],
        "hinge_tilt" => &[Door],
        "payload" => &[Pendulum, ServoLink, PlanarArm, OvenDoor],
        "joint_axis_error" => &[PlanarArm],
        "encoder_offset" => &[Pendulum, OvenDoor, ServoLink],
        "sensor_drift" => &[Door, Pendulum, OvenDoor, Drawer],
        "unmodelled_mode" => &[PlanarArm, Pendulum, ServoLink],
        "load_dependent_friction" => &[ServoLink, Pendulum, OvenDoor],
        "armature_inertia" => &[Pendulum, ServoLink, OvenDoor, PlanarArm],
        "torque_bias" | "detent" | "hard_stop" | "position_dependent_friction" => &[Door, Drawer, OvenDoor, Pendulum, ServoLink],
        _ => &[Door, Drawer, OvenDoor, Pendulum, ServoLink, PlanarArm],
    }
}

/// Effects that the score of joints and channels hides in an arm.
pub(crate) const ON_AN_ARM: [&str; 14] = [
    "torque_bias",
    "torque_ripple",
    "torque_gain",
    "quadratic_drag",
    "joint_spring",
    "cable_hysteresis",
    "position_dependent_friction",
    "load_dependent_friction",
    "armature_inertia",
    "payload",
    "backlash",
    "transport_delay",
    "actuator_lag",
    "encoder_offset",
];

/// Effects that need a motor's command.
pub(crate) fn needs_command(name: &str) -> bool {
    matches!(
        name,
        "transport_delay" | "actuator_lag" | "actuator_saturation" | "backlash" | "joint_elasticity" | "torque_gain" | "armature_inertia"
    )
}

/// Effects on which a position servo would act back in a way that the model's words leave open.
pub(crate) fn allows_servo(name: &str) -> bool {
    !matches!(name, "transport_delay" | "actuator_lag" | "backlash" | "joint_elasticity" | "encoder_offset" | "sensor_drift" | "clock_skew")
}

/// What the model must and must not know of losses for an effect to be missing.
pub(crate) fn losses(names: &[&str]) -> Losses {
    let any = |of: &[&str]| names.iter().any(|n| of.contains(n));
    if any(&["thermal_wear"]) {
        return Losses { damping: Some(true), friction: Some(true) };
    }
    let mut losses = Losses::default();
    if any(&["viscous_friction", "asymmetric_friction", "cable_hysteresis"]) {
        losses.damping = Some(false);
    }
    if any(&[
        "coulomb_friction",
        "asymmetric_friction",
        "stribeck_friction",
        "presliding_hysteresis",
        "position_dependent_friction",
        "load_dependent_friction",
        "cable_hysteresis",
        "dwell_friction",
        "intermittent_binding",
    ]) {
        losses.friction = Some(false);
    }
    losses
}

/// Trajectories that bring an effect out.
pub(crate) fn telling(name: &str) -> &'static [Family] {
    use Family::{Chirp, Dwell, FreeDecay, Ladder, Pushes, Ramp, Sines, Steps};
    match name {
        "presliding_hysteresis" | "backlash" => &[Ladder, Ramp, Sines],
        "stribeck_friction" | "coulomb_friction" | "asymmetric_friction" => &[Ramp, Sines, Steps],
        "joint_elasticity" | "unmodelled_mode" => &[Chirp, Steps, Pushes],
        "transport_delay" | "actuator_lag" | "clock_skew" => &[Chirp, Steps, Sines],
        "air_suction" | "dwell_friction" => &[Dwell, Ramp],
        "quadratic_drag" | "viscous_friction" => &[FreeDecay, Sines, Ramp],
        "magnetic_gasket" | "latch" | "detent" | "position_dependent_friction" | "torque_ripple" => &[Ramp, Ramp, Sines],
        "soft_close_damper" | "hard_stop" => &[Ramp, Sines, Pushes],
        "actuator_saturation" => &[Steps, Chirp],
        _ => &[Ramp, Sines],
    }
}

/// The catalogue's effect with numbers for a joint.
pub(crate) fn draw(name: &str, joint: &str, scale: &Scale, level: usize, rng: &mut Random) -> Option<EffectEntry> {
    let size = scale.range[1] - scale.range[0];
    // Small enough to be missed by eye; larger where the sensors are worse.
    let share = rng.scale([0.06, 0.08, 0.14][level.min(2)], 0.5);
    let force = share * scale.effort;
    let damping = force / scale.velocity;
    let inside = |rng: &mut Random, a: f64, b: f64| scale.range[0] + size * rng.between(a, b);
    let mut choices: BTreeMap<String, String> = BTreeMap::new();
    let p: Vec<(&str, f64)> = match name {
        "viscous_friction" => vec![("damping", damping)],
        "coulomb_friction" => vec![("friction", force)],
        "asymmetric_friction" => {
            let [a, b] = [rng.scale(1.3, 2.2), rng.scale(1.4, 2.5)];
            let (f, c) = (0.7 * force, 0.7 * damping);
            let (forward, slope) = (rng.chance(0.5), rng.chance(0.5));
            let pair = |x: f64, ratio: f64, first: bool| if first { (x, x / ratio) } else { (x / ratio, x) };
            let ((fp, fm), (cp, cm)) = (pair(f, a, forward), pair(c, b, slope));
            vec![("friction_positive", fp), ("friction_negative", fm), ("damping_positive", cp), ("damping_negative", cm)]
        }
        "stribeck_friction" => vec![
            ("friction", force),
            ("static_friction", force * rng.between(1.4, 2.3)),
            ("stribeck_velocity", scale.velocity * rng.scale(0.08, 0.5)),
            ("exponent", rng.pick(&[1.0, 2.0])?),
        ],
        "quadratic_drag" => vec![("drag", force / (scale.velocity * scale.velocity))],
        "presliding_hysteresis" => vec![
            ("stiffness", force / (size * rng.scale(2e-3, 1.2e-2))),
            ("micro_damping", damping * rng.scale(0.01, 0.1)),
            ("friction", force),
            ("static_friction", force * rng.between(1.0, 1.6)),
            ("stribeck_velocity", scale.velocity * rng.scale(0.05, 0.3)),
        ],
        "load_dependent_friction" => vec![("load_coefficient", rng.scale(0.08, 0.3))],
        "position_dependent_friction" => vec![
            ("friction", 0.4 * force),
            ("amplitude", force * rng.between(0.8, 2.0)),
            ("position", inside(rng, 0.25, 0.75)),
            ("width", size * rng.scale(0.05, 0.18)),
        ],
        "joint_spring" => vec![("stiffness", 2.5 * force / size), ("rest_position", inside(rng, -0.2, 0.8))],
        "hinge_tilt" => vec![("amplitude", 1.5 * force), ("phase", rng.between(-3.1, 3.1))],
        "cable_hysteresis" => vec![
            ("stiffness", 1.5 * force / size),
            ("rest_position", inside(rng, 0.0, 0.7)),
            ("loop_force", force),
            ("loop_length", size * rng.scale(0.02, 0.15)),
            ("damping", 0.3 * damping),
        ],
        "torque_bias" => vec![("bias", rng.sign() * force)],
        "magnetic_gasket" => {
            choices.insert("shape".into(), rng.pick(&["exponential", "inverse_square"])?.into());
            vec![("force", force * rng.between(2.0, 5.0)), ("width", size * rng.scale(0.01, 0.06))]
        }
        "air_suction" => {
            let seal = if rng.chance(0.3) { 0.0 } else { size * rng.between(0.1, 0.3) };
            let reach = if seal == 0.0 { 0.3 * size } else { 0.6 * seal };
            vec![("stiffness", 2.0 * force / reach), ("time_constant", rng.scale(0.4, 4.0)), ("seal_position", seal)]
        }
        "latch" => {
            let opening = force * rng.between(3.0, 7.0);
            vec![
                ("opening_force", opening),
                ("closing_force", opening * rng.between(0.2, 0.7)),
                ("position", size * rng.between(0.01, 0.2)),
                ("width", size * rng.scale(0.03, 0.1)),
            ]
        }
        "detent" => {
            vec![("force", force * rng.between(1.5, 4.0)), ("position", inside(rng, 0.15, 0.8)), ("width", size * rng.scale(0.012, 0.05))]
        }
        "soft_close_damper" => {
            let position = size * rng.between(0.15, 0.35);
            vec![("damping", damping * rng.between(2.0, 6.0)), ("position", position), ("stiffness", 1.5 * force / position)]
        }
        "hard_stop" => {
            let side = rng.sign();
            let position = if side > 0.0 { inside(rng, 0.65, 0.88) } else { inside(rng, 0.1, 0.3) };
            let stiffness = scale.inertia * rng.scale(60.0, 300.0).powi(2);
            vec![
                ("stiffness", stiffness),
                ("dissipation", stiffness * rng.scale(0.1, 1.0) / scale.velocity),
                ("position", position),
                ("side", side),
            ]
        }
        "backlash" => vec![("half_gap", size * rng.scale(1.5e-3, 0.012)), ("rotor_inertia", scale.inertia * rng.scale(0.05, 0.4))],
        "joint_elasticity" => {
            let rotor = scale.inertia * rng.scale(0.08, 0.5);
            let stiffness = scale.inertia * (TAU * rng.scale(2.5, 9.0)).powi(2);
            let reduced = rotor * scale.inertia / (rotor + scale.inertia);
            vec![
                ("stiffness", stiffness),
                ("damping", 2.0 * rng.between(0.05, 0.12) * (stiffness * reduced).sqrt()),
                ("rotor_inertia", rotor),
            ]
        }
        "torque_ripple" => {
            let cycles = if scale.turns { rng.between(5.0, 40.0).round() } else { TAU / rng.scale(0.01, 0.06) };
            vec![("amplitude", force), ("cycles_per_turn", cycles), ("phase", rng.between(-3.1, 3.1))]
        }
        "transport_delay" => vec![("delay", rng.scale(0.004, 0.03))],
        "actuator_lag" => vec![("time_constant", rng.scale(0.005, 0.03))],
        "armature_inertia" => vec![("inertia", scale.inertia * rng.scale(0.08, 0.6))],
        "torque_gain" => vec![("gain_error", rng.sign() * rng.scale(0.06, 0.25))],
        "actuator_saturation" => vec![("limit", scale.most * rng.between(0.45, 0.85))],
        "payload" => {
            let l = scale.length;
            let d = [rng.between(-0.4, 0.4) * l, rng.between(-0.4, 0.4) * l, -rng.between(0.3, 1.0) * l];
            vec![("mass", scale.mass * rng.scale(0.08, 0.5)), ("x", d[0]), ("y", d[1]), ("z", d[2])]
        }
        "joint_axis_error" => {
            let axis = nalgebra::Vector3::from(scale.axis);
            let any = nalgebra::Vector3::new(rng.normal(), rng.normal(), rng.normal());
            let about = (any - axis * any.dot(&axis)).try_normalize(1e-9)?;
            let shift = nalgebra::Vector3::new(rng.normal(), rng.normal(), rng.normal()) * 0.008;
            let shift = shift - axis * shift.dot(&axis);
            vec![
                ("angle", rng.scale(0.01, 0.08)),
                ("rx", about.x),
                ("ry", about.y),
                ("rz", about.z),
                ("x", shift.x),
                ("y", shift.y),
                ("z", shift.z),
            ]
        }
        "encoder_offset" => {
            let scale_error = if rng.chance(0.5) { 0.0 } else { rng.sign() * rng.scale(0.008, 0.04) };
            vec![("offset", rng.sign() * rng.scale(0.04, 0.12)), ("scale_error", scale_error)]
        }
        "sensor_drift" => {
            let effort = rng.chance(0.7);
            choices.insert("of".into(), if effort { "effort" } else { "position" }.into());
            if effort {
                vec![("bias", rng.sign() * 0.5 * force), ("rate", rng.sign() * 4.0 * force / scale.session)]
            } else {
                vec![("bias", 0.0), ("rate", rng.sign() * rng.scale(1e-3, 5e-3) * size)]
            }
        }
        "clock_skew" => vec![("skew", rng.scale(0.004, 0.03) * if rng.chance(0.15) { -1.0 } else { 1.0 })],
        "thermal_wear" => vec![("amplitude", rng.between(0.4, 1.2)), ("time_constant", scale.session * rng.scale(0.2, 0.6))],
        "unmodelled_mode" => {
            vec![("frequency", rng.scale(3.0, 9.0)), ("damping_ratio", rng.scale(0.02, 0.08)), ("mass", scale.mass * rng.scale(0.8, 4.0))]
        }
        _ => return None,
    };
    if name == "unmodelled_mode" {
        choices.insert("direction".into(), "x".into());
    }
    if matches!(name, "backlash" | "joint_elasticity") {
        choices.insert("encoder".into(), "link".into());
    }
    Some(EffectEntry {
        effect: name.into(),
        joint: (name != "unmodelled_mode").then(|| joint.into()),
        parameters: p.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(),
        choices,
        ..EffectEntry::default()
    })
}

/// An effect that the catalogue lacks, and its numbers for the record.
pub(crate) fn draw_outside(name: &str, scale: &Scale, rng: &mut Random) -> Option<(Term, BTreeMap<String, f64>)> {
    let size = scale.range[1] - scale.range[0];
    let force = rng.scale(0.15, 0.6) * scale.effort;
    let damping = force / scale.velocity;
    let middle = (scale.range[0] + scale.range[1]) / 2.0;
    let (term, numbers): (Term, Vec<(&str, f64)>) = match name {
        "placed_damping" => {
            let (damping, position) = (4.0 * damping / size, scale.range[0] + size * rng.between(0.2, 0.8));
            (Term::PlacedDamping { damping, position }, vec![("damping", damping), ("position", position)])
        }
        "parametric_stiffness" => {
            let (stiffness, pace) = (4.0 * force / size, TAU * rng.scale(0.25, 2.0));
            (Term::Parametric { stiffness, rest: middle, pace }, vec![("stiffness", stiffness), ("pace", pace)])
        }
        "cubic_drag" => {
            let drag = force / scale.velocity.powi(3);
            (Term::Cubic { drag }, vec![("drag", drag)])
        }
        "intermittent_binding" => {
            let mut times = Vec::new();
            let mut t = rng.between(0.5, 2.0);
            while t < 4.0 * scale.session {
                times.push(t);
                t += rng.scale(0.3, 2.5);
            }
            (Term::Binding { friction: 1.3 * force, times }, vec![("friction", 1.3 * force)])
        }
        "timed_cogging" => {
            let (pace, phase) = (TAU * rng.scale(3.0, 12.0), rng.between(0.0, TAU));
            (Term::TimedSine { amplitude: 1.5 * force, pace, phase }, vec![("amplitude", 1.5 * force), ("pace", pace)])
        }
        "timed_disturbance" => {
            let pace = TAU * rng.scale(0.2, 1.5);
            (Term::TimedSquare { amplitude: force, pace }, vec![("amplitude", force), ("pace", pace)])
        }
        "kinked_spring" => {
            let (below, above) = (5.0 * force / size, 0.3 * force / size);
            let (below, above) = if rng.chance(0.5) { (below, above) } else { (above, below) };
            let position = scale.range[0] + size * rng.between(0.3, 0.7);
            (Term::Kink { below, above, position }, vec![("below", below), ("above", above), ("position", position)])
        }
        "eddy_brake" => {
            let velocity = scale.velocity * rng.between(0.3, 0.9);
            (Term::Brake { damping: 2.0 * force / velocity, velocity }, vec![("damping", 2.0 * force / velocity), ("velocity", velocity)])
        }
        "loose_mass" => {
            let (inertia, gap) = (scale.inertia * rng.scale(0.15, 0.6), size * rng.scale(0.01, 0.05));
            let pace: f64 = 400.0;
            let term = Term::Loose { inertia, gap, stiffness: inertia * pace * pace, damping: 0.3 * inertia * pace };
            (term, vec![("inertia", inertia), ("gap", gap)])
        }
        "dwell_friction" => {
            let (time_constant, velocity) = (rng.scale(0.3, 1.5), scale.velocity * rng.between(0.1, 0.3));
            let term = Term::Dwell { friction: 0.5 * force, growth: 3.0 * force, time_constant, velocity };
            (term, vec![("friction", 0.5 * force), ("growth", 3.0 * force), ("time_constant", time_constant)])
        }
        _ => return None,
    };
    Some((term, numbers.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()))
}
