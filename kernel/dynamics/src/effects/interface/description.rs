//! What an effect says of itself: what the catalogue's page, `model.yaml` and the search for a gap's cause need.

use super::partial::MAX_PARAMETERS;

/// What an effect says of itself.
#[derive(Debug, Clone, Copy)]
pub struct Description {
    /// Name, used in files, scripts and reports.
    pub name: &'static str,
    /// One sentence with the term.
    pub summary: &'static str,
    /// What it acts on.
    pub acts: Acts,
    /// Its parameters, at most [`MAX_PARAMETERS`]. An effect's parameters always come in this order.
    pub parameters: &'static [Parameter],
    /// How it shows in measurements.
    pub signature: &'static str,
    /// Effects and parameters that it is taken for.
    pub confused_with: &'static [&'static str],
    /// The experiment that tells it from those.
    pub experiment: &'static str,
    /// Where the term comes from.
    pub source: &'static str,
    /// Its force is a linear function of the next velocity, or linear but for what a step solves exactly (dry friction with
    /// a constant bound, stops): one solution of the step is then enough.
    pub linear: bool,
    /// It is a loss in a bearing: `thermal_wear` scales it.
    pub wears: bool,
    /// It can only take energy, or give back what it has taken.
    pub passive: bool,
    /// It may be one for all joints of a part, which is meant where no joint is named.
    pub shared: bool,
}

/// What an effect acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acts {
    /// The joint, with a force.
    Joint,
    /// The command on its way to the joint. Stages are passed in this order, whatever the order in `model.yaml`: the message
    /// arrives late (0), the drive clips it to its limit (1), its current follows with a lag (2), the motor's constant is off (3).
    Command(u8),
    /// The measurement: the encoder's place (0), its scale (1), what is added to it (2), its time stamp (3).
    Measurement(u8),
    /// The rigid bodies.
    Bodies,
    /// The other effects of its joint: it scales those that wear.
    Losses,
    /// The base of a part.
    Base,
}

/// Multiple down to which a value may be the same as another but for what a fit is off by.
const ALIKE: f64 = 0.8;
/// The most by which friction that breaks away exceeds that which slides: twice in machines (Armstrong-Helouvry, Dupont and Canudas de Wit
/// 1994), with room for what a fit is off by.
const MOST: f64 = 3.0;

impl Description {
    /// What most effects have in common.
    pub(in crate::effects) const BLANK: Self = Self {
        name: "",
        summary: "",
        acts: Acts::Joint,
        parameters: &[],
        signature: "",
        confused_with: &[],
        experiment: "",
        source: "",
        linear: false,
        wears: false,
        passive: true,
        shared: false,
    };

    /// Where it is, if no joint is named.
    pub fn without_joint(&self) -> &'static str {
        if self.shared { "all joints" } else { "the base" }
    }

    /// Have values in the order of its parameters the shape that the name stands for, as far as values are known that may be the same?
    pub fn is_shaped(&self, values: &[f64]) -> bool {
        self.multiples(values).all(|times| times >= ALIKE)
    }

    /// Is a value so many times another that is to be known by that the name comes near, no more?
    pub fn is_bent(&self, values: &[f64]) -> bool {
        self.multiples(values).any(|times| times > MOST)
    }

    /// What values are as multiples, where [`Multiple`] says that they are known so.
    fn multiples<'v>(&self, values: &'v [f64]) -> impl Iterator<Item = f64> + 'v {
        let all = self.parameters;
        let times = move |(parameter, value): (&Parameter, &f64)| {
            let of = all.iter().position(|p| Some(p.name) == parameter.multiple.map(|m| m.of))?;
            Some(value / values.get(of)?)
        };
        all.iter().zip(values).filter_map(times)
    }

    /// It takes the input and gives the link another force for it: a motor apart from its link.
    pub(crate) fn takes_input(&self) -> bool {
        self.parameter("encoder").is_some()
    }

    /// Is the effect's choice, among values in the order of its parameters, not the first word?
    pub fn second_word(&self, values: &[f64]) -> bool {
        self.parameters.iter().zip(values).any(|(p, value)| !p.words.is_empty() && *value > 0.5)
    }

    /// Index of a parameter by its name.
    pub fn parameter(&self, name: &str) -> Option<usize> {
        self.parameters.iter().take(MAX_PARAMETERS).position(|p| p.name == name)
    }
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
    /// Unit and prior where the effect's choice is its second word, if that changes them.
    pub of_second: Option<OfSecond>,
    /// Where it is known better as a multiple of another parameter than by its own size: no less than once that. With less the force has a shape
    /// of its own, and not this name.
    pub multiple: Option<Multiple>,
    /// The prior's size is a published figure, and not an engineer's estimate.
    pub cited: bool,
    /// The larger it is the less the effect does.
    pub bounding: bool,
    /// What it is where `model.yaml` does not give it, and then is nothing to be fitted; none of those that have to be given.
    pub absent: Option<f64>,
    /// Words for the values of [`Prior::OneOf`], under which `model.yaml` gives them as `choices`; the first is the default.
    /// Empty for numbers.
    pub words: &'static [&'static str],
}

impl Parameter {
    /// An estimate.
    pub(in crate::effects) const fn new(name: &'static str, unit: [&'static str; 2], bounds: [f64; 2], prior: [Prior; 2]) -> Self {
        Self { name, unit, bounds, prior, of_second: None, multiple: None, cited: false, bounding: false, absent: None, words: &[] }
    }

    /// A choice among words.
    pub(in crate::effects) const fn choice(name: &'static str, words: &'static [&'static str; 2]) -> Self {
        Self { words, ..Self::new(name, ["1", "1"], [0.0, 1.0], [Prior::OneOf(&[0.0, 1.0]); 2]) }
    }

    /// The same, with another unit and prior where the effect's choice is its second word.
    pub(in crate::effects) const fn or(self, unit: [&'static str; 2], prior: [Prior; 2]) -> Self {
        Self { of_second: Some(OfSecond { unit, prior }), ..self }
    }

    /// The same, known as a multiple of a parameter that comes before it.
    pub(in crate::effects) const fn times(self, of: &'static str, median: f64, spread: f64) -> Self {
        Self { multiple: Some(Multiple { of, median, spread }), ..self }
    }

    /// The same, with less of the effect the larger it is.
    pub(in crate::effects) const fn bounding(self) -> Self {
        Self { bounding: true, ..self }
    }

    /// Is a value what it is where it is not given?
    pub fn is_absent(&self, value: f64) -> bool {
        self.absent == Some(value)
    }

    /// The same, so much where it is not given.
    pub(in crate::effects) const fn or_else(self, value: f64) -> Self {
        Self { absent: Some(value), ..self }
    }

    /// The same with a published size.
    pub(in crate::effects) const fn cited(self) -> Self {
        Self { cited: true, ..self }
    }
}

/// What multiple of another a parameter is expected to be: its logarithm is normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Multiple {
    /// The other, which comes before it.
    pub of: &'static str,
    /// Median.
    pub median: f64,
    /// Standard deviation of the logarithm.
    pub spread: f64,
}

/// What a parameter is where the effect's choice is its second word: see [`Parameter`].
#[derive(Debug, Clone, Copy)]
pub struct OfSecond {
    /// Unit on a joint that turns, and on one that slides.
    pub unit: [&'static str; 2],
    /// What is expected before anything is measured.
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

/// Median and spread of the logarithm.
pub(in crate::effects) const fn around(median: f64, spread: f64) -> Prior {
    Prior::LogNormal { median, spread }
}

/// Mean and standard deviation.
pub(in crate::effects) const fn near(mean: f64, deviation: f64) -> Prior {
    Prior::Normal { mean, deviation }
}

/// Bounds of a size that cannot be negative.
pub(in crate::effects) const SIZE: [f64; 2] = [0.0, 1e9];
/// Bounds of a size that is divided by.
pub(in crate::effects) const ABOVE_ZERO: [f64; 2] = [1e-6, 1e9];
/// Bounds of any number.
pub(in crate::effects) const ANY: [f64; 2] = [-1e9, 1e9];
/// Positions on joints that turn and slide.
pub(in crate::effects) const PLACE: [Prior; 2] = [near(0.0, 1.5), near(0.0, 0.3)];

/// Units on joints that turn and slide.
pub(in crate::effects) mod unit {
    pub const POSITION: [&str; 2] = ["rad", "m"];
    pub const VELOCITY: [&str; 2] = ["rad/s", "m/s"];
    pub const EFFORT: [&str; 2] = ["N m", "N"];
    pub const STIFFNESS: [&str; 2] = ["N m/rad", "N/m"];
    pub const DAMPING: [&str; 2] = ["N m s/rad", "N s/m"];
    pub const INERTIA: [&str; 2] = ["kg m^2", "kg"];
    pub const TIME: [&str; 2] = ["s", "s"];
    pub const ONE: [&str; 2] = ["1", "1"];
    pub const LENGTH: [&str; 2] = ["m", "m"];
    pub const ANGLE: [&str; 2] = ["rad", "rad"];
}
