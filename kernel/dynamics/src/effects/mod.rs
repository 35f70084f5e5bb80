//! Named physical effects that a rigid body's URDF leaves out. One file an effect: its term, its partial derivatives, its
//! parameters with units, bounds and priors, its name and its source. [`catalogue`] is the list of those files.
//!
//! An effect acts on one degree of freedom. Its `dtau` is the generalised force that the rigid-body model lacks, on the
//! side of the accelerations: `M a + c + g + dtau = tau`. So it resists motion where it has the velocity's sign.

mod catalogue;
mod coulomb_friction;
mod hard_stop;
mod joint_spring;
mod viscous_friction;

pub use catalogue::{catalogue, find, parameters_of};

/// No effect has more parameters than this.
pub const MAX_PARAMETERS: usize = 8;

/// One effect of the catalogue. It holds no values: those are passed in, so that they can be varied and fitted without
/// building anything anew.
pub trait Effect: std::fmt::Debug + Sync {
    /// Its name, parameters and source.
    fn description(&self) -> &'static Description;

    /// What it adds at one instant. `theta` are its parameters in the order of the description.
    fn resist(&self, theta: &[f64], at: &Instant<'_>, resistance: &mut Resistance);

    /// Number of inner states, such as the bristle of a presliding model or a pressure. They start at zero.
    fn states(&self) -> usize {
        0
    }

    /// Moves the inner states over one step that ends with `at` (whose `z` holds the states before the step).
    fn advance(&self, theta: &[f64], at: &Instant<'_>, dt: f64, z: &mut [f64]) {
        let _ = (theta, at, dt, z);
    }
}

/// What an effect can depend on.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a> {
    /// Position of the joint, rad or m; 0 for joints of several degrees of freedom.
    pub q: f64,
    /// Velocity.
    pub v: f64,
    /// Input at the joint (drive), N m or N.
    pub input: f64,
    /// Force of gravity, Coriolis and external forces on the joint, N m or N.
    pub load: f64,
    /// Time, s.
    pub time: f64,
    /// Inner states.
    pub z: &'a [f64],
}

/// A value with its partial derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Partial {
    /// The value, N m or N.
    pub value: f64,
    /// By position.
    pub d_q: f64,
    /// By velocity.
    pub d_v: f64,
    /// By parameters.
    pub d_theta: [f64; MAX_PARAMETERS],
}

/// What an effect adds, sorted by how a time step has to treat it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Resistance {
    /// `dtau` that is smooth. Its stiffness and damping enter a step implicitly.
    pub smooth: Partial,
    /// Bound of dry friction: `dtau = dry sgn(v)`, and anything in between at rest. Never negative.
    pub dry: Partial,
    /// A one-sided contact with a stop.
    pub stop: Option<Stop>,
}

/// A stop at one end of a joint's range: `dtau = side (stiffness d + damping dd/dt)+` with the depth
/// `d = side (q - position)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// +1 stops positive motion, -1 negative.
    pub side: f64,
    /// Depth in the stop, rad or m; negative before it.
    pub depth: f64,
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// At this depth, N m s/rad or N s/m.
    pub damping: f64,
    /// `dtau` at this instant.
    pub force: Partial,
}

impl Resistance {
    /// The whole `dtau` at the velocity `v`; at rest dry friction counts as zero.
    pub fn total(&self, v: f64) -> Partial {
        let sign = if v == 0.0 { 0.0 } else { v.signum() };
        let mut sum = self.smooth;
        for (part, factor) in [(Some(self.dry), sign), (self.stop.map(|s| s.force), 1.0)] {
            let Some(part) = part else { continue };
            sum.value += factor * part.value;
            sum.d_q += factor * part.d_q;
            sum.d_v += factor * part.d_v;
            for (s, p) in sum.d_theta.iter_mut().zip(part.d_theta) {
                *s += factor * p;
            }
        }
        sum
    }
}

/// What an effect says of itself.
#[derive(Debug, Clone, Copy)]
pub struct Description {
    /// Name, used in files, scripts and reports.
    pub name: &'static str,
    /// One sentence with the term.
    pub summary: &'static str,
    /// Its parameters, at most [`MAX_PARAMETERS`].
    pub parameters: &'static [Parameter],
    /// Where the term comes from.
    pub source: &'static str,
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy)]
pub struct Parameter {
    /// Name.
    pub name: &'static str,
    /// Unit on a joint that turns, and on one that slides.
    pub unit: [&'static str; 2],
    /// Least and greatest value.
    pub bounds: [f64; 2],
    /// What is expected before anything is measured, on a joint that turns, and on one that slides.
    pub prior: [Prior; 2],
}

/// What a parameter is expected to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prior {
    /// Its logarithm is normal: median, and standard deviation of the natural logarithm.
    LogNormal {
        /// Median.
        median: f64,
        /// Standard deviation of the logarithm.
        spread: f64,
    },
    /// Normal.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        deviation: f64,
    },
    /// One of these, each as likely; not fitted by gradients.
    OneOf(&'static [f64]),
}
