//! What effects read, and what they write through each of their doors.

use nalgebra::Vector3;

use super::number::{Number, Variable};
use super::partial::{MAX_PARAMETERS, MAX_STATES, Partial, parameters};
use crate::complementarity::Hinge;

/// Number of samples that an effect with a history keeps.
pub const HISTORY: usize = 64;

/// What an effect can depend on, over one step in time or at one instant.
///
/// A step of length `dt` takes its forces at the next velocity `next` and at the position `q + dt next` that it leads to.
/// With `dt = 0` and `next = v` a force is that of the instant.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a> {
    /// Position of the joint at the start, rad or m; 0 for joints of several degrees of freedom.
    pub q: f64,
    /// Velocity at the start.
    pub v: f64,
    /// Next velocity.
    pub next: f64,
    /// Length of the step, s.
    pub dt: f64,
    /// Input: at the joint (drive), N m or N; for a change of the command what comes in.
    pub input: f64,
    /// Force of gravity, Coriolis and external forces on the joint, N m or N.
    pub load: f64,
    /// Time at the start, s.
    pub time: f64,
    /// Inner states at the start; then the history, where there is one: [`HISTORY`] inputs, then the seconds that each lasted.
    pub z: &'a [f64],
}

impl<'a> Instant<'a> {
    /// One instant: no step.
    pub fn at(q: f64, v: f64, input: f64, load: f64, time: f64, z: &'a [f64]) -> Self {
        Self { q, v, next: v, dt: 0.0, input, load, time, z }
    }

    /// Position at the end of the step.
    #[inline]
    pub fn end(&self) -> f64 {
        self.q + self.dt * self.next
    }

    /// A smooth force `f(q, v)` at the end of the step, from its value there, its two derivatives, and those by its first
    /// parameters: the short way for a term whose derivatives are short themselves.
    #[inline]
    pub(in crate::effects) fn force<N: Number, const K: usize>(&self, value: f64, by: [f64; 2], by_theta: [f64; K]) -> N {
        let [by_position, by_velocity] = by;
        N::known(value, by_position, by_velocity + self.dt * by_position, by_theta)
    }

    /// All of it as numbers that carry their derivatives.
    #[inline]
    pub(in crate::effects) fn variables<N: Number>(&self, theta: &[f64]) -> Variables<N> {
        let (q, next) = (N::variable(self.q, Variable::Q), N::variable(self.next, Variable::Next));
        Variables {
            q,
            v: N::variable(self.v, Variable::V),
            next,
            end: q.mix(1.0, &next, self.dt, self.end()),
            input: N::variable(self.input, Variable::Input),
            load: N::variable(self.load, Variable::Load),
            z: std::array::from_fn(|i| N::variable(self.z.get(i).copied().unwrap_or(0.0), Variable::Z(i))),
            theta: parameters(theta),
        }
    }
}

/// An [`Instant`] as numbers that carry their derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Variables<N> {
    /// Position at the start.
    pub q: N,
    /// Velocity at the start.
    pub v: N,
    /// Next velocity.
    pub next: N,
    /// Position at the end.
    pub end: N,
    /// Input.
    pub input: N,
    /// Load.
    pub load: N,
    /// Inner states.
    pub z: [N; MAX_STATES],
    /// Parameters.
    pub theta: [N; MAX_PARAMETERS],
}

impl<N: Number> Variables<N> {
    /// The share of the step's way on which the position lies below a boundary. A force that acts on one side of a boundary,
    /// times this share, is its mean over the step to first order; so it has the right derivative by the boundary.
    #[inline]
    pub(in crate::effects) fn share_below(&self, boundary: N) -> N {
        let (start, end) = (self.q.value(), self.end.value());
        match (start < boundary.value(), end < boundary.value()) {
            (true, true) => N::constant(1.0),
            (false, false) => N::default(),
            (true, false) => (boundary - self.q) / (self.end - self.q),
            (false, true) => (boundary - self.end) / (self.q - self.end),
        }
    }
}

/// What an effect adds to its joint, sorted by how a time step has to treat it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Resistance<N = Partial> {
    /// `dtau` that a step takes at the next velocity, by Newton's method: its mean over the step as a function of `next`.
    pub smooth: N,
    /// Bounds of dry friction, for motion in the positive and in the negative direction: `dtau = dry[0]` or `-dry[1]`, and
    /// anything in between at rest. Never negative.
    pub dry: [N; 2],
    /// One-sided contacts.
    pub stops: [Option<Stop<N>>; 2],
}

/// A one-sided contact: `dtau = side (offset + slope side next)+`, exactly linear in the next velocity where it pushes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop<N = Partial> {
    /// +1 stops positive motion, -1 negative.
    pub side: f64,
    /// Its push at rest, N m or N; negative before touch.
    pub offset: f64,
    /// Growth of its push with the velocity into it, N m s/rad or N s/m; never negative.
    pub slope: f64,
    /// `dtau` at the next velocity.
    pub force: N,
    /// It stands in place of the URDF's limit on its side.
    pub limit: bool,
}

impl<N: Number> Stop<N> {
    /// A stop whose push changes linearly with the next velocity, as `push` says; it pushes where that is positive.
    #[inline]
    pub(in crate::effects) fn new(side: f64, push: N, next: f64, limit: bool) -> Self {
        let slope = (side * push.d_next()).max(0.0);
        let force = if push.value() > 0.0 { push * side } else { N::default() };
        Self { side, offset: push.value() - slope * side * next, slope, force, limit }
    }
}

/// A [`Resistance`] without its derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Force {
    /// The smooth part at the next velocity, and its slope by that.
    pub smooth: [f64; 2],
    /// Bounds of dry friction.
    pub dry: [f64; 2],
    /// One-sided contacts: side, offset and slope of [`Stop`].
    pub stops: [Option<[f64; 3]>; 2],
}

impl<N: Number> From<&Resistance<N>> for Force {
    #[inline]
    fn from(r: &Resistance<N>) -> Self {
        Self {
            smooth: [r.smooth.value(), r.smooth.d_next()],
            dry: r.dry.map(|d| d.value()),
            stops: r.stops.map(|s| s.map(|s| [s.side, s.offset, s.slope])),
        }
    }
}

impl Force {
    /// The whole `dtau` at the velocity `next` that it was taken at; at rest dry friction counts as zero.
    #[inline]
    pub fn total(&self, next: f64) -> f64 {
        let mut sum = self.smooth[0];
        if next > 0.0 {
            sum += self.dry[0];
        } else if next < 0.0 {
            sum -= self.dry[1];
        }
        for [side, offset, slope] in self.stops.into_iter().flatten() {
            sum += side * (offset + slope * side * next).max(0.0);
        }
        sum
    }
}

/// One joint's row of a step's problem, `a w = b` with dry friction and stops, about the next velocity at which forces are taken.
#[derive(Debug)]
pub struct Row<'a> {
    pub(crate) a: f64,
    pub(crate) b: f64,
    /// Impulses of dry friction against positive and against negative motion.
    pub(crate) dry: [f64; 2],
    pub(crate) stops: &'a mut Vec<Hinge>,
    /// The degree of freedom.
    pub(crate) k: usize,
    pub(crate) next: f64,
    pub(crate) dt: f64,
}

impl Row<'_> {
    /// Adds a force times a factor, by which stops are not touched.
    #[inline]
    pub(in crate::effects) fn add<N: Number>(&mut self, force: &Resistance<N>, factor: f64) {
        let slope = (force.smooth.d_next() * factor).max(0.0);
        self.a += self.dt * slope;
        self.b += self.dt * (slope * self.next - force.smooth.value() * factor);
        for (sum, bound) in self.dry.iter_mut().zip(&force.dry) {
            if bound.value() > 0.0 {
                *sum += self.dt * (bound.value() * factor);
            }
        }
        for stop in force.stops.iter().flatten() {
            self.stops.push(Hinge { k: self.k, side: stop.side, offset: self.dt * stop.offset, slope: self.dt * stop.slope });
        }
    }
}

impl<N: Number> Resistance<N> {
    /// The same bound of dry friction in both directions.
    #[inline]
    pub(in crate::effects) fn dry_both(&mut self, bound: N) {
        self.dry = [bound, bound];
    }

    /// The whole `dtau` at the velocity `next`; at rest dry friction counts as zero.
    pub fn total(&self, next: f64) -> N {
        let mut sum = self.smooth;
        if next > 0.0 {
            sum = sum + self.dry[0];
        } else if next < 0.0 {
            sum = sum - self.dry[1];
        }
        for stop in self.stops.iter().flatten() {
            sum = sum + stop.force;
        }
        sum
    }
}

/// Inner states after a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Advance<N = Partial> {
    /// The next inner states.
    pub z: [N; MAX_STATES],
    /// What is written into the history.
    pub sample: Option<Sample>,
}

/// One entry of a history is written; all others stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Which.
    pub slot: usize,
    /// Its value.
    pub value: f64,
    /// Seconds that it lasted.
    pub duration: f64,
    /// By the input.
    pub d_input: f64,
    /// By its value before.
    pub d_slot: f64,
}

/// A command on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transfer<N = Partial> {
    /// What goes on: the mean over the step.
    pub output: N,
    /// Its derivatives by the inputs of the history.
    pub d_history: [f64; HISTORY],
}

impl<N: Number> Default for Transfer<N> {
    #[inline]
    fn default() -> Self {
        Self { output: N::default(), d_history: [0.0; HISTORY] }
    }
}

/// What is measured on one joint. Partial derivatives `d_q`, `d_v` and `d_input` are by position, velocity and effort as
/// they come in.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reading {
    /// Position, rad or m.
    pub position: Partial,
    /// Velocity, rad/s or m/s.
    pub velocity: Partial,
    /// Effort, N m or N.
    pub effort: Partial,
    /// Time stamp, s.
    pub stamp: Partial,
}

impl Reading {
    /// What a perfect sensor reads.
    pub fn perfect(position: f64, velocity: f64, effort: f64, stamp: f64) -> Self {
        Self {
            position: Partial { value: position, d_q: 1.0, ..Partial::default() },
            velocity: Partial { value: velocity, d_v: 1.0, ..Partial::default() },
            effort: Partial { value: effort, d_input: 1.0, ..Partial::default() },
            stamp: Partial::constant(stamp),
        }
    }
}

/// A change of the rigid bodies at one joint, with its derivatives by the effect's parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reshape {
    /// Inertia that the drive adds to the joint, kg m^2 or kg.
    pub armature: Partial,
    /// Mass, mass times centre (x, y, z), inertia about the origin (xx, xy, xz, yy, yz, zz) that the joint's own link gains,
    /// in the link's frame.
    pub inertia: [Partial; 10],
    /// Rotation vector that turns the joint's axis, in the joint's frame, rad.
    pub turn: [Partial; 3],
    /// Shift of the joint's origin, in the joint's frame, m.
    pub shift: [Partial; 3],
}

impl Default for Reshape {
    fn default() -> Self {
        let none = Partial::default();
        Self { armature: none, inertia: [none; 10], turn: [none; 3], shift: [none; 3] }
    }
}

impl Reshape {
    /// The turn as a vector.
    pub(crate) fn turn(&self) -> Vector3<f64> {
        Vector3::new(self.turn[0].value, self.turn[1].value, self.turn[2].value)
    }

    /// The shift as a vector.
    pub(crate) fn shift(&self) -> Vector3<f64> {
        Vector3::new(self.shift[0].value, self.shift[1].value, self.shift[2].value)
    }
}

/// A base that gives way along one direction: mass on a spring and a damper, beside the mass of the part that it carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sway<N = Partial> {
    /// Unit vector in the world.
    pub direction: Vector3<f64>,
    /// Mass of the base, kg.
    pub mass: N,
    /// N s/m.
    pub damping: N,
    /// N/m.
    pub stiffness: N,
}

impl Sway<f64> {
    /// Lets a base swing on alone for some time, s, with kilograms on it that stand. `z` are its displacement, m, and rate. It is the way of a free
    /// oscillation, `s'' + 2 a s' + (a^2 + w^2) s = 0`, at once (Inman 2014, section 1.3); critical damping is the most that one has.
    pub(crate) fn swing_on(&self, carried: f64, z: &mut [f64], duration: f64) {
        let mass = self.mass + carried;
        let (a, square) = (0.5 * self.damping / mass, self.stiffness / mass);
        let w = (square - a * a).max(0.0).sqrt();
        let (sine, cosine) = (w * duration).sin_cos();
        let (sine, left) = (if w > 0.0 { sine / w } else { duration }, (-a * duration).exp());
        let (s, rate) = (z[0], z[1]);
        z[0] = left * (s * cosine + (rate + a * s) * sine);
        z[1] = left * (rate * cosine - (a * rate + square * s) * sine);
    }
}
