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

pub(crate) use catalogue::check_parameter;
pub use catalogue::{catalogue, find, page, parameters_of};
pub use interface::*;

/// One effect of the catalogue.
pub trait Effect: std::fmt::Debug + Sync {
    /// Its name, parameters and source.
    fn description(&self) -> &'static Description;

    /// What it adds to its joint. `theta` are its parameters in the order of the description; `out` comes in empty.
    fn resist(&self, theta: &[f64], at: &Instant<'_>, out: &mut Resistance) {
        let _ = (theta, at, out);
    }

    /// The same without derivatives, for a step. Only what stands on every joint of a URDF has a shorter way than the whole.
    fn force(&self, theta: &[f64], at: &Instant<'_>) -> Force {
        let mut out = Resistance::default();
        self.resist(theta, at, &mut out);
        Force::from(&out)
    }

    /// Number of inner states, such as the bristle of a presliding model or a pressure; at most [`MAX_STATES`]. They start at
    /// zero.
    fn states(&self) -> usize {
        0
    }

    /// Does it keep a history of its input, after its inner states?
    fn keeps_history(&self) -> bool {
        false
    }

    /// Inner states after a step whose next velocity is `at.next`.
    fn advance(&self, theta: &[f64], at: &Instant<'_>, out: &mut Advance) {
        let _ = (theta, at, out);
    }

    /// What goes on of the command `at.input`: its mean over the step, and at `dt = 0` that of the instant.
    fn command(&self, theta: &[f64], at: &Instant<'_>, out: &mut Transfer) {
        let _ = theta;
        out.output = Partial { value: at.input, d_input: 1.0, ..Partial::default() };
    }

    /// What is read where `at.q`, `at.v`, `at.input` and `at.time` are the position, velocity, effort and stamp that come in;
    /// `out` comes in as that of a perfect sensor.
    fn measure(&self, theta: &[f64], at: &Instant<'_>, out: &mut Reading) {
        let _ = (theta, at, out);
    }

    /// What it changes of the rigid bodies.
    fn reshape(&self, theta: &[f64], out: &mut Reshape) {
        let _ = (theta, out);
    }

    /// The factor on the losses of its joint at a time.
    fn wear(&self, theta: &[f64], time: f64) -> Partial {
        let _ = (theta, time);
        Partial::constant(1.0)
    }

    /// How the base of its part gives way.
    fn sway(&self, theta: &[f64]) -> Option<Sway> {
        let _ = theta;
        None
    }
}
