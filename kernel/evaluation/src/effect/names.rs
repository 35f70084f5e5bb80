//! Names of the catalogue, of what stands outside it, and which of them no data of a kind can tell apart.

/// The catalogue.
pub const CATALOGUE: [&str; 33] = [
    "viscous_friction",
    "coulomb_friction",
    "asymmetric_friction",
    "stribeck_friction",
    "quadratic_drag",
    "presliding_hysteresis",
    "load_dependent_friction",
    "position_dependent_friction",
    "joint_spring",
    "hinge_tilt",
    "cable_hysteresis",
    "torque_bias",
    "magnetic_gasket",
    "air_suction",
    "latch",
    "detent",
    "soft_close_damper",
    "hard_stop",
    "backlash",
    "joint_elasticity",
    "torque_ripple",
    "transport_delay",
    "actuator_lag",
    "armature_inertia",
    "torque_gain",
    "actuator_saturation",
    "payload",
    "joint_axis_error",
    "encoder_offset",
    "sensor_drift",
    "clock_skew",
    "thermal_wear",
    "unmodelled_mode",
];

/// What the catalogue lacks, on purpose.
pub const OUTSIDE: [&str; 10] = [
    "placed_damping",
    "parametric_stiffness",
    "cubic_drag",
    "intermittent_binding",
    "timed_cogging",
    "timed_disturbance",
    "kinked_spring",
    "eddy_brake",
    "loose_mass",
    "dwell_friction",
];

/// The channels under which an effect may rightly be reported. What sits between motor and link is the drive's or the joint's.
pub fn channels(name: &str) -> &'static [&'static str] {
    match name {
        "transport_delay" | "actuator_lag" | "torque_gain" | "actuator_saturation" => &["actuator"],
        "backlash" | "joint_elasticity" | "torque_ripple" | "armature_inertia" | "torque_bias" => &["actuator", "joint"],
        "encoder_offset" | "sensor_drift" | "clock_skew" => &["sensor"],
        "joint_axis_error" => &["kinematic"],
        "payload" | "unmodelled_mode" => &["body"],
        _ => &["joint"],
    }
}

/// What decides whether some effects can be told apart in a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Circumstances {
    /// Joints that move on their own.
    pub joints: usize,
    /// Does the joint turn?
    pub turns: bool,
    /// Range of the joint's motion in the training data, rad or m.
    pub range: f64,
    /// Does gravity act along the joint's motion?
    pub gravity: bool,
    /// Share of the moving samples at less than twice the Stribeck velocity; 1 where there is none.
    pub slow: f64,
}

/// A point of mass m at r from the axis pulls by m g r and adds m r^2 to the inertia: near the axis it is a pull alone, as a tilt's is.
const NEAR_THE_AXIS: &str = "payload";

/// Names that data of these circumstances cannot tell from `entry`'s (its own left out).
pub fn indistinguishable(entry: &sagci_model::EffectEntry, at: &Circumstances) -> Vec<&'static str> {
    let p = |name: &str| entry.parameters.get(name).copied().unwrap_or(0.0);
    let short = at.turns && at.range < 60f64.to_radians();
    let mut names = Vec::new();
    match entry.effect.as_str() {
        "transport_delay" => names.push("clock_skew"),
        // No input comes before it was sent.
        "clock_skew" if p("skew") > 0.0 => names.push("transport_delay"),
        "joint_spring" if short => names.push("hinge_tilt"),
        "hinge_tilt" => {
            if short {
                names.push("joint_spring");
            }
            if at.joints == 1 && at.gravity {
                names.extend(["encoder_offset", "joint_axis_error", NEAR_THE_AXIS]);
            } else if at.joints == 1 {
                names.push("joint_axis_error");
            }
        }
        "encoder_offset" if at.joints == 1 && p("scale_error") == 0.0 => {
            names.extend(["hinge_tilt", "joint_axis_error"]);
            if at.gravity {
                names.push(NEAR_THE_AXIS);
            }
        }
        // Gravity along a slide is a constant.
        "joint_axis_error" if at.joints == 1 && !at.turns => names.push("torque_bias"),
        "torque_bias" if at.joints == 1 && !at.turns => names.push("joint_axis_error"),
        "joint_axis_error" if at.joints == 1 => names.extend(["hinge_tilt", "encoder_offset"]),
        // A bias of the sensor that does not drift is a bias of the effort.
        "torque_bias" if short && at.gravity => names.push("hinge_tilt"),
        "stribeck_friction" if at.slow < 0.01 => names.push("coulomb_friction"),
        // A mass on an axis across which no gravity pulls is inertia.
        "payload" if at.joints == 1 && !at.gravity => names.push("armature_inertia"),
        "armature_inertia" if at.joints == 1 && !at.gravity => names.extend(["payload", "torque_gain"]),
        "torque_gain" if at.joints == 1 && !at.gravity => names.extend(["armature_inertia", "payload"]),
        _ => {}
    }
    names
}
