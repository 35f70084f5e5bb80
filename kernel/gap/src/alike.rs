//! Names that no data of some kind can tell apart, however well one of them fits: what follows from the equations alone.
//!
//! * A late input and a late stamp of the measurement are one thing in one log, as long as nothing closes the loop outside of it, and all joints
//!   are late: others feel when one of them moves. A stamp that is ahead is no input's: none comes before it was sent.
//! * A straight line and a sine are one curve over a short way: `k (q - q0)` and `a sin(q + phi)` over less than 60 degrees; so is a
//!   constant, where gravity already acts.
//! * On one joint, a shift of its encoder, a tilt of its hinge and an error of its axis all turn gravity's sine; on one that slides gravity is a
//!   constant, and an error of its axis a bias.
//! * A sensor's drift without a rate is an encoder's offset, or, of the effort that drives the joint, a bias of it: it is called by that name
//!   where that is among the candidates, since what does not drift is no drift.
//! * Where a joint went one way only, a force by place and a friction by place are one thing.
//! * On one joint that gravity does not move, a mass on the axis' far side and a rotor's inertia are one number, and an input that is too
//!   weak by a share is a little more of all of it, unless the effort that the drive gave was read, too.

use sagci_model::EffectEntry;

use crate::choice::Choice;
use crate::fit::Fit;
use crate::hypothesis::{Fitted, Knob};
use crate::search::{Candidate, Search, entries};
use crate::starts::Seen;
use crate::trajectory::Trajectory;
use crate::weigh::CONVINCING;

/// Range over which a sine is a line, rad.
const SHORT: f64 = std::f64::consts::FRAC_PI_3;

/// What of a joint and its data decides.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Circumstances {
    /// The model has no other, or the name is one for all of them.
    pub alone: bool,
    /// It turns.
    pub turns: bool,
    /// Range of its measured positions, rad or m.
    pub range: f64,
    /// What its data can show.
    pub seen: Seen,
    /// The name is that of a constant: its scale error or rate is nothing.
    pub constant: bool,
    /// It is one of the effort.
    pub of_effort: bool,
    /// It is that of a clock that is ahead.
    pub ahead: bool,
}

/// Names that data of such a joint cannot tell from `name`.
pub(crate) fn alike(name: &str, at: Circumstances) -> &'static [&'static str] {
    let short = at.turns && at.range < SHORT;
    match name {
        "transport_delay" if at.alone && at.seen.commanded => &["clock_skew"],
        "clock_skew" if at.alone && at.seen.commanded && !at.ahead => &["transport_delay"],
        "joint_spring" if short => &["hinge_tilt"],
        "hinge_tilt" if short && at.alone && at.seen.weighed => &["joint_spring", "encoder_offset", "joint_axis_error"],
        "hinge_tilt" if at.alone && at.seen.weighed => &["encoder_offset", "joint_axis_error"],
        "hinge_tilt" if short && at.alone => &["joint_spring", "joint_axis_error"],
        "hinge_tilt" if short => &["joint_spring"],
        "hinge_tilt" if at.alone => &["joint_axis_error"],
        "encoder_offset" if at.turns && at.alone && at.seen.weighed && at.constant => &["hinge_tilt", "joint_axis_error"],
        "sensor_drift" if at.constant && at.of_effort && !at.seen.commanded => &["torque_bias"],
        "sensor_drift" if at.turns && at.constant && !at.of_effort && at.alone && at.seen.weighed => {
            &["encoder_offset", "hinge_tilt", "joint_axis_error"]
        }
        "sensor_drift" if at.constant && !at.of_effort => &["encoder_offset"],
        "joint_axis_error" if at.alone && !at.turns => &["torque_bias"],
        "joint_axis_error" if at.alone => &["hinge_tilt", "encoder_offset"],
        "torque_bias" if short && at.seen.weighed => &["hinge_tilt"],
        "payload" if at.alone && !at.seen.weighed && at.seen.read => &["armature_inertia"],
        "payload" if at.alone && !at.seen.weighed && at.seen.commanded => &["armature_inertia", "torque_gain"],
        "armature_inertia" if at.alone && !at.seen.weighed && at.seen.read => &["payload"],
        "armature_inertia" if at.alone && !at.seen.weighed => &["payload", "torque_gain"],
        "torque_gain" if at.alone && !at.seen.weighed && !at.seen.read => &["armature_inertia", "payload"],
        "magnetic_gasket" | "detent" if at.seen.one_way => &["position_dependent_friction"],
        _ => &[],
    }
}

/// Are two names a late input and a late stamp? In one log that is one lateness, and not two that add up.
pub(crate) fn is_one_lateness(one: &str, other: &str) -> bool {
    matches!((one, other), ("clock_skew", "transport_delay") | ("transport_delay", "clock_skew"))
}

/// Are the scale error and the rate of an effect of a fit, by its entry, nothing?
fn is_constant(fit: &Fit, entry: usize) -> bool {
    !fit.hypothesis.fitted.iter().zip(&fit.hypothesis.x).enumerate().any(|(i, (f, x))| {
        let deviation = fit.jacobian.get(i).map_or(f64::INFINITY, |c| 1.0 / c.norm().max(1e-12));
        matches!(f.knob, Knob::Effect(e, "scale_error" | "rate") if e == entry) && x.abs() > 3.0 * deviation
    })
}

/// Is a candidate an encoder's offset whose scale error is nothing?
pub(crate) fn is_plain_offset(candidate: &Candidate) -> bool {
    let last = || entries(&candidate.fit.hypothesis).pop();
    candidate.effect == "encoder_offset" && last().is_some_and(|entry| is_constant(&candidate.fit, entry))
}

/// The plain name of a candidate that is a sensor's drift and does not drift.
pub(crate) fn plain_name(candidate: &Candidate) -> Option<&'static str> {
    let hypothesis = &candidate.fit.hypothesis;
    let entry = entries(hypothesis).pop().filter(|e| candidate.effect == "sensor_drift" && is_constant(&candidate.fit, *e))?;
    let of_effort = hypothesis.model.document.effects.get(entry)?.choices.get("of").is_some_and(|of| of == "effort");
    Some(if of_effort { "torque_bias" } else { "encoder_offset" })
}

/// Puts the plain name of a shift before a drift that comes first and does not drift, where it says nearly as much.
pub(crate) fn call_by_plain_name(candidates: &mut [Candidate]) {
    let Some((first, name)) = candidates.first().and_then(|c| Some((c, plain_name(c)?))) else { return };
    let is_it = |c: &Candidate| c.effect == name && c.joint == first.joint && c.evidence > first.evidence - CONVINCING;
    if let Some(plain) = candidates.iter().position(is_it) {
        candidates[..=plain].rotate_right(1);
    }
}

impl Search<'_> {
    /// Names that these data cannot tell from a chosen one's.
    pub fn alike(&self, choice: &Choice, fit: &Fit) -> &'static [&'static str] {
        let model = &fit.hypothesis.model;
        let on = choice.best.joint.map(|j| model.joints[self.joints[j]].name.as_str());
        // What is one for all joints is told by any of them.
        let j = choice.best.joint.unwrap_or(0);
        let joint = &model.joints[self.joints[j]];
        let [low, high] = Trajectory::range(self.problem.trajectories, j);
        let is_it = |e: &EffectEntry| e.effect == choice.best.effect && e.joint.as_deref() == on;
        let entry = model.document.effects.iter().position(is_it);
        let of_effort = entry.is_some_and(|e| model.document.effects[e].choices.get("of").is_some_and(|of| of == "effort"));
        let is_ahead = |(f, x): (&Fitted, &f64)| matches!(f.knob, Knob::Effect(e, "skew") if Some(e) == entry) && f.value(*x) < 0.0;
        let at = Circumstances {
            alone: self.names.len() == 1 || on.is_none(),
            turns: joint.kind != sagci_model::JointKind::Prismatic,
            range: high - low,
            seen: Seen { commanded: self.seen[j].commanded && (on.is_some() || self.seen.iter().all(|s| s.commanded)), ..self.seen[j] },
            constant: entry.is_none_or(|e| is_constant(fit, e)),
            of_effort,
            ahead: fit.hypothesis.fitted.iter().zip(&fit.hypothesis.x).any(is_ahead),
        };
        alike(choice.best.effect, at)
    }
}
