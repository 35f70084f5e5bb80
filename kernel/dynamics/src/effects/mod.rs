//! Named physical effects that a rigid body's URDF leaves out. One file an effect: its term, its partial derivatives, its
//! parameters with units, bounds and priors, its name and its source. [`catalogue`] is the list of those files.
//!
//! # What an effect is
//! An effect holds no values: parameters `theta` and inner states `z` are passed in, so that they can be varied and fitted
//! without building anything anew. What it acts on ([`Acts`]) says which of its doors it opens:
//!
//! * **the joint** ([`Effect::resist`]): `dtau`, the generalised force that the rigid-body model lacks, on the side of the
//!   accelerations: `M a + c + g + dtau = tau`. So it resists motion where it has the velocity's sign. It comes in three parts:
//!   smooth, dry friction (a bound, exact at rest), one-sided stops.
//! * **the command** ([`Effect::command`]): what becomes of it on its way to the joint.
//! * **the measurement** ([`Effect::measure`]): what the sensors make of the truth.
//! * **the rigid bodies** ([`Effect::reshape`]): armature, inertia, axis and origin of its joint.
//! * **the losses** of its joint ([`Effect::wear`]), and **the base** of a part ([`Effect::sway`]).
//!
//! # Steps and derivatives
//! A step finds the next velocity `w` with all forces taken at `w` and at the position that it leads to: `r(w) = 0`, solved to
//! the end. So the step's derivatives need first derivatives only, those at the solution: `r_w dw = -r_x dx`. Effects
//! with inner states put the states' own implicit (or exact) step into their force, so that `dtau(w)` already knows how the states
//! answer to `w`; stiff inner states are stable then, together with the joint.
//!
//! Derivatives cost more than values, and a step needs few of them: a term is written once, for any [`Number`], and taken with no
//! derivatives, with the slope by `w` ([`Effect::force`]), or with all.
//!
//! Inner states are relative to the joint wherever they are positions or velocities, so that zero is their start at any state.

mod actuator_lag;
mod actuator_saturation;
mod air_suction;
mod armature_inertia;
mod asymmetric_friction;
mod backlash;
mod cable_hysteresis;
mod catalogue;
mod clock_skew;
mod coulomb_friction;
mod detent;
mod encoder_offset;
mod hard_stop;
mod hinge_tilt;
mod interface;
mod joint_axis_error;
mod joint_elasticity;
mod joint_spring;
mod latch;
mod load_dependent_friction;
mod magnetic_gasket;
mod payload;
mod position_dependent_friction;
mod presliding_hysteresis;
mod quadratic_drag;
mod sensor_drift;
mod soft_close_damper;
mod stribeck_friction;
mod thermal_wear;
mod torque_bias;
mod torque_gain;
mod torque_ripple;
mod transport_delay;
mod unmodelled_mode;
mod viscous_friction;

pub use backlash::RIGID_TEETH;
pub(crate) use catalogue::check_parameter;
pub use catalogue::{catalogue, find, page, parameters_of};
pub use interface::*;

/// One effect of the catalogue.
pub trait Effect: std::fmt::Debug + Sync {
    /// Its name, parameters and source.
    fn description(&self) -> &'static Description;

    /// What it adds to its joint. `theta` are its parameters in the order of the description; `out` comes in empty.
    fn resist(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance);

    /// All of it together at the next velocity, as [`Resistance::total`] adds it up.
    fn resist_in_all(&self, theta: &[f64], at: &Instant<'_>) -> Partial;

    /// The same without derivatives but the slope.
    fn force(&self, theta: &[f64], at: &Instant<'_>) -> Force;

    /// The whole force in each row of a motion, at its next velocity. Screens ask for many rows at once, so nobody asks in each of them which effect
    /// it is.
    fn forces(&self, theta: &[f64], motion: &[Along]) -> Vec<f64>;

    /// [`Self::force`] times a factor, added to its joint's row of a step's problem. A step asks many times, so nothing is copied on the way.
    fn add_force(&self, theta: &[f64], at: &Instant<'_>, factor: f64, row: &mut Row<'_>);

    /// Number of inner states, such as the bristle of a presliding model or a pressure; at most [`MAX_STATES`]. They start at
    /// zero.
    fn states(&self) -> usize;

    /// Does it keep a history of its input, after its inner states?
    fn keeps_history(&self) -> bool;

    /// Inner states after a step whose next velocity is `at.next`.
    fn advance(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance);

    /// The same without derivatives, for a step: inner states and history `z` go from those at the start, as in `at.z`, to the
    /// next ones.
    fn advance_values(&self, theta: &[f64], at: &Instant<'_>, z: &mut [f64]);

    /// What goes on of the command `at.input`: its mean over the step, and at `dt = 0` that of the instant.
    fn command(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer);

    /// The same without derivatives, for a step.
    fn command_value(&self, theta: &[f64], at: &Instant<'_>) -> f64;

    /// What is read where `at.q`, `at.v`, `at.input` and `at.time` are the position, velocity, effort and stamp that come in;
    /// `out` comes in as that of a perfect sensor.
    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading);

    /// What it changes of the rigid bodies.
    fn reshape(&self, theta: &[f64], out: &mut Reshape);

    /// The factor on the losses of its joint at a time.
    fn wear(&self, theta: &[f64], time: f64) -> Partial;

    /// How the base of its part gives way.
    fn sway(&self, theta: &[f64]) -> Option<Sway>;

    /// The same without derivatives, for a step.
    fn sway_values(&self, theta: &[f64]) -> Option<Sway<f64>>;
}

/// Lets time, s, pass for what is inside an effect on a joint that stands at a position, rad or m. What a motor does apart from its link stays.
pub fn stand(effect: &dyn Effect, theta: &[f64], q: f64, duration: f64, z: &mut [f64]) {
    let description = effect.description();
    if z.is_empty() || description.acts != Acts::Joint || description.takes_input() {
        return;
    }
    let before = z.to_vec();
    effect.advance_values(theta, &Instant { dt: duration, ..Instant::at(q, 0.0, 0.0, 0.0, 0.0, &before) }, z);
}

/// What one file of the catalogue says: the doors of an [`Effect`], each term written once, for any kind of [`Number`].
trait Law: std::fmt::Debug + Sync {
    fn description(&self) -> &'static Description;

    fn resist<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance<N>) {
        let _ = (theta, at, out);
    }

    fn states(&self) -> usize {
        0
    }

    fn keeps_history(&self) -> bool {
        false
    }

    fn advance<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance<N>) {
        let _ = (theta, at, out);
    }

    fn command<N: Number>(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer<N>) {
        let _ = theta;
        out.output = N::variable(at.input, Variable::Input);
    }

    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        let _ = (theta, at, out);
    }

    fn reshape(&self, theta: &[f64], out: &mut Reshape) {
        let _ = (theta, out);
    }

    fn wear(&self, theta: &[f64], time: f64) -> Partial {
        let _ = (theta, time);
        Partial::constant(1.0)
    }

    fn sway<N: Number>(&self, theta: &[f64]) -> Option<Sway<N>> {
        let _ = theta;
        None
    }
}

impl<L: Law> Effect for L {
    fn description(&self) -> &'static Description {
        Law::description(self)
    }

    fn resist(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance) {
        Law::resist(self, theta, at, out);
    }

    fn resist_in_all(&self, theta: &[f64], at: &Instant<'_>) -> Partial {
        let mut out = Resistance::default();
        Law::resist(self, theta, at, &mut out);
        out.total(at.next)
    }

    fn force(&self, theta: &[f64], at: &Instant<'_>) -> Force {
        let mut out = Resistance::<Slope>::default();
        Law::resist(self, theta, at, &mut out);
        Force::from(&out)
    }

    fn forces(&self, theta: &[f64], motion: &[Along]) -> Vec<f64> {
        let whole = |at: &Instant<'_>| Effect::force(self, theta, at).total(at.next);
        let inner = Law::states(self);
        if inner == 0 {
            return motion.iter().map(|row| whole(&row.at)).collect();
        }
        let mut z = vec![0.0; inner + if Law::keeps_history(self) { 2 * HISTORY } else { 0 }];
        let (mut next, mut forces) = (z.clone(), Vec::with_capacity(motion.len()));
        let mut last: Option<&Instant<'_>> = None;
        for Along { at: row, before } in motion {
            match (before, last) {
                (Before::Nothing, _) => z.fill(0.0),
                (Before::Pause, Some(last)) => stand(self, theta, last.q, (row.time - last.time).max(0.0), &mut z),
                _ => (),
            }
            let at = Instant { z: &z, ..*row };
            forces.push(whole(&at));
            if row.dt > 0.0 {
                next.copy_from_slice(&z);
                Effect::advance_values(self, theta, &at, &mut next);
                std::mem::swap(&mut z, &mut next);
            }
            last = Some(row);
        }
        forces
    }

    fn add_force(&self, theta: &[f64], at: &Instant<'_>, factor: f64, row: &mut Row<'_>) {
        let mut out = Resistance::<Slope>::default();
        Law::resist(self, theta, at, &mut out);
        row.add(&out, factor);
    }

    fn states(&self) -> usize {
        Law::states(self)
    }

    fn keeps_history(&self) -> bool {
        Law::keeps_history(self)
    }

    fn advance(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance) {
        Law::advance(self, theta, at, out);
    }

    fn advance_values(&self, theta: &[f64], at: &Instant<'_>, z: &mut [f64]) {
        let (mut out, states) = (Advance::<f64>::default(), Law::states(self));
        Law::advance(self, theta, at, &mut out);
        for (z, next) in z.iter_mut().zip(out.z).take(states) {
            *z = next;
        }
        if let Some(sample) = out.sample {
            z[states + sample.slot] = sample.value;
            z[states + HISTORY + sample.slot] = sample.duration;
        }
    }

    fn command(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer) {
        Law::command(self, theta, at, out);
    }

    fn command_value(&self, theta: &[f64], at: &Instant<'_>) -> f64 {
        let mut out = Transfer::<f64>::default();
        Law::command(self, theta, at, &mut out);
        out.output
    }

    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        Law::measure(self, theta, at, out);
    }

    fn reshape(&self, theta: &[f64], out: &mut Reshape) {
        Law::reshape(self, theta, out);
    }

    fn wear(&self, theta: &[f64], time: f64) -> Partial {
        Law::wear(self, theta, time)
    }

    fn sway(&self, theta: &[f64]) -> Option<Sway> {
        Law::sway(self, theta)
    }

    fn sway_values(&self, theta: &[f64]) -> Option<Sway<f64>> {
        Law::sway(self, theta)
    }
}
