//! What a script can hold: quantities with their kind, objects of the scene, and places.

use std::cmp::Ordering;
use std::fmt;

use rhai::{Dynamic, FLOAT, INT};
use sagci_skill::{Argument, ParameterKind, Place};

/// An angle, rad.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Angle(pub f64);

/// A length, m.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Length(pub f64);

/// A point on the table, or above it if the height is given; world coordinates, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct At {
    /// Coordinates x and y.
    pub xy: [f64; 2],
    /// Height of the object's root link; where it stands on the table if not given.
    pub z: Option<f64>,
}

/// Which way an object faces: the direction of its root link's x axis, as an angle about the vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facing(pub Angle);

/// The scene, in which things are declared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneHandle;

/// An object of the scene, and one of its joints if the script picked one.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectHandle {
    /// Name in the scene.
    pub name: String,
    /// The joint.
    pub joint: Option<String>,
}

/// What was recorded in one call of a skill: its number among the calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunHandle(pub usize);

/// A region of an object.
#[derive(Debug, Clone, PartialEq)]
pub struct Inside {
    /// Name of the object in the scene.
    pub object: String,
    /// Name of the region; the first one if not given.
    pub region: Option<String>,
}

impl fmt::Display for Angle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} deg", rounded(self.0.to_degrees()))
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} cm", rounded(self.0 * 100.0))
    }
}

impl fmt::Display for ObjectHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)?;
        self.joint.as_ref().map_or(Ok(()), |joint| write!(f, ".joint(\"{joint}\")"))
    }
}

impl fmt::Display for RunHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "run {}", self.0 + 1)
    }
}

impl fmt::Display for Inside {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.region {
            Some(region) => write!(f, "inside({}, \"{region}\")", self.object),
            None => write!(f, "inside({})", self.object),
        }
    }
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at({}, {})", Length(self.xy[0]), Length(self.xy[1]))
    }
}

impl fmt::Display for Facing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "facing({})", self.0)
    }
}

/// At most two decimals, without trailing zeros.
fn rounded(value: f64) -> f64 {
    let rounded = (value * 100.0).round() / 100.0;
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// The kind of a value, as far as it decides where the value fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// [`SceneHandle`].
    Scene,
    /// [`ObjectHandle`].
    Object,
    /// [`Inside`].
    Inside,
    /// [`At`].
    At,
    /// [`Facing`].
    Facing,
    /// [`Angle`].
    Angle,
    /// [`Length`].
    Length,
    /// A whole or decimal number.
    Number,
    /// True or false.
    Truth,
    /// A text.
    Text,
    /// `#{...}`.
    Map,
    /// [`RunHandle`].
    Run,
    /// Anything else that a script can hold.
    Other,
}

impl Kind {
    /// The kind of a value.
    pub fn of(value: &Dynamic) -> Self {
        if value.is::<ObjectHandle>() {
            Self::Object
        } else if value.is::<Inside>() {
            Self::Inside
        } else if value.is::<At>() {
            Self::At
        } else if value.is::<Facing>() {
            Self::Facing
        } else if value.is::<Angle>() {
            Self::Angle
        } else if value.is::<Length>() {
            Self::Length
        } else if value.is::<INT>() || value.is::<FLOAT>() {
            Self::Number
        } else if value.is::<bool>() {
            Self::Truth
        } else if value.is_string() {
            Self::Text
        } else if value.is_map() {
            Self::Map
        } else if value.is::<RunHandle>() {
            Self::Run
        } else if value.is::<SceneHandle>() {
            Self::Scene
        } else {
            Self::Other
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Scene => "the scene",
            Self::Object => "an object",
            Self::Inside => "a place inside an object",
            Self::At => "a point on the table",
            Self::Facing => "a direction",
            Self::Angle => "an angle",
            Self::Length => "a length",
            Self::Number => "a bare number",
            Self::Truth => "true or false",
            Self::Text => "a text",
            Self::Map => "a map #{...}",
            Self::Run => "a recorded run",
            Self::Other => "something else",
        }
    }

    /// Does a value of this kind fit a parameter? `Err` is what to write instead.
    pub fn fits(self, parameter: ParameterKind) -> Result<(), &'static str> {
        let (fits, hint) = match parameter {
            ParameterKind::Object => (self == Self::Object, "give what scene.expect(...) answered"),
            ParameterKind::Place => {
                (matches!(self, Self::Inside | Self::At), "write inside(object), inside(object, \"region\") or at(cm(40), cm(10))")
            }
            ParameterKind::Amount => (matches!(self, Self::Angle | Self::Length), "write deg(90) for an angle or cm(5) for a length"),
            ParameterKind::Angle => (self == Self::Angle, "write deg(90) or rad(1.57)"),
            ParameterKind::Length => (self == Self::Length, "write cm(5), mm(50) or m(0.05)"),
            ParameterKind::Number => (self == Self::Number, "write a plain number such as 3 or 0.5"),
            ParameterKind::Truth => (self == Self::Truth, "write true or false"),
            ParameterKind::Text => (self == Self::Text, "write a text in double quotes"),
        };
        if fits { Ok(()) } else { Err(hint) }
    }
}

/// A parameter's kind in words.
pub fn parameter_words(kind: ParameterKind) -> &'static str {
    match kind {
        ParameterKind::Object => "an object",
        ParameterKind::Place => "a place",
        ParameterKind::Amount => "an angle or a length",
        ParameterKind::Angle => "an angle",
        ParameterKind::Length => "a length",
        ParameterKind::Number => "a number",
        ParameterKind::Truth => "true or false",
        ParameterKind::Text => "a text",
    }
}

/// A whole or decimal number.
pub fn number(value: &Dynamic) -> Option<f64> {
    value.as_float().ok().or_else(|| value.as_int().ok().map(|i| i as f64))
}

/// A value as a skill's argument; its kind has been found to fit.
pub fn argument(value: &Dynamic) -> Option<Argument> {
    if let Some(object) = value.read_lock::<ObjectHandle>() {
        return Some(Argument::Object { name: object.name.clone(), joint: object.joint.clone() });
    }
    if let Some(place) = value.read_lock::<Inside>() {
        return Some(Argument::Place(Place::Inside { object: place.object.clone(), region: place.region.clone() }));
    }
    if let Some(at) = value.read_lock::<At>() {
        return Some(Argument::Place(Place::Table { at: at.xy }));
    }
    if let Some(angle) = value.read_lock::<Angle>() {
        return Some(Argument::Angle(angle.0));
    }
    if let Some(length) = value.read_lock::<Length>() {
        return Some(Argument::Length(length.0));
    }
    if let Some(number) = number(value) {
        return Some(Argument::Number(number));
    }
    value.as_bool().ok().map(Argument::Truth).or_else(|| value.clone().into_string().ok().map(Argument::Text))
}

/// An argument as a person would write it.
pub fn argument_words(argument: &Argument) -> String {
    match argument {
        Argument::Object { name, joint } => ObjectHandle { name: name.clone(), joint: joint.clone() }.to_string(),
        Argument::Place(Place::Inside { object, region }) => Inside { object: object.clone(), region: region.clone() }.to_string(),
        Argument::Place(Place::Table { at }) => At { xy: *at, z: None }.to_string(),
        Argument::Angle(a) => Angle(*a).to_string(),
        Argument::Length(l) => Length(*l).to_string(),
        Argument::Number(n) => n.to_string(),
        Argument::Truth(t) => t.to_string(),
        Argument::Text(t) => format!("\"{t}\""),
    }
}

/// The quantities' own arithmetic: sums of equals, multiples, ratios, order.
macro_rules! register_quantity {
    ($engine:expr, $type:ident, $name:literal) => {
        $engine
            .register_type_with_name::<$type>($name)
            .register_fn("+", |a: $type, b: $type| $type(a.0 + b.0))
            .register_fn("-", |a: $type, b: $type| $type(a.0 - b.0))
            .register_fn("-", |a: $type| $type(-a.0))
            .register_fn("+", |a: $type| a)
            .register_fn("abs", |a: $type| $type(a.0.abs()))
            .register_fn("*", |a: $type, b: FLOAT| $type(a.0 * b))
            .register_fn("*", |a: $type, b: INT| $type(a.0 * b as f64))
            .register_fn("*", |a: FLOAT, b: $type| $type(a * b.0))
            .register_fn("*", |a: INT, b: $type| $type(a as f64 * b.0))
            .register_fn("/", |a: $type, b: FLOAT| $type(a.0 / b))
            .register_fn("/", |a: $type, b: INT| $type(a.0 / b as f64))
            .register_fn("/", |a: $type, b: $type| a.0 / b.0)
            .register_fn("==", |a: $type, b: $type| a == b)
            .register_fn("!=", |a: $type, b: $type| a != b)
            .register_fn("<", |a: $type, b: $type| a.partial_cmp(&b) == Some(Ordering::Less))
            .register_fn("<=", |a: $type, b: $type| a <= b)
            .register_fn(">", |a: $type, b: $type| a.partial_cmp(&b) == Some(Ordering::Greater))
            .register_fn(">=", |a: $type, b: $type| a >= b)
            .register_fn("min", |a: $type, b: $type| $type(a.0.min(b.0)))
            .register_fn("max", |a: $type, b: $type| $type(a.0.max(b.0)))
    };
}

/// Registers the values and what can be done with them. Nothing here moves anything.
pub fn register(engine: &mut rhai::Engine) {
    register_quantity!(engine, Angle, "Angle");
    register_quantity!(engine, Length, "Length");
    for (name, unit) in ANGLE_UNITS {
        engine.register_fn(*name, move |x: FLOAT| Angle(x * unit)).register_fn(*name, move |x: INT| Angle(x as f64 * unit));
    }
    for (name, unit) in LENGTH_UNITS {
        engine.register_fn(*name, move |x: FLOAT| Length(x * unit)).register_fn(*name, move |x: INT| Length(x as f64 * unit));
    }
    engine
        .register_get("deg", |a: &mut Angle| a.0.to_degrees())
        .register_get("rad", |a: &mut Angle| a.0)
        .register_get("m", |l: &mut Length| l.0)
        .register_get("cm", |l: &mut Length| l.0 * 100.0)
        .register_get("mm", |l: &mut Length| l.0 * 1000.0)
        .register_fn("sin", |a: Angle| a.0.sin())
        .register_fn("cos", |a: Angle| a.0.cos())
        .register_fn("tan", |a: Angle| a.0.tan());
    engine
        .register_type_with_name::<At>("point on the table")
        .register_fn("at", |x: Length, y: Length| At { xy: [x.0, y.0], z: None })
        .register_fn("at", |x: Length, y: Length, z: Length| At { xy: [x.0, y.0], z: Some(z.0) })
        .register_type_with_name::<Facing>("direction")
        .register_fn("facing", Facing)
        .register_type_with_name::<Inside>("place inside an object")
        .register_fn("inside", |o: ObjectHandle| Inside { object: o.name, region: None })
        .register_fn("inside", |o: ObjectHandle, region: &str| Inside { object: o.name, region: Some(region.to_owned()) })
        .register_type_with_name::<SceneHandle>("scene")
        .register_type_with_name::<ObjectHandle>("object")
        .register_fn("joint", |o: ObjectHandle, joint: &str| ObjectHandle { name: o.name, joint: Some(joint.to_owned()) })
        .register_get("name", |o: &mut ObjectHandle| o.name.clone());
    macro_rules! printable {
        ($($type:ty),*) => {
            $(engine.register_fn("to_string", |v: &mut $type| v.to_string()).register_fn("to_debug", |v: &mut $type| v.to_string());)*
        };
    }
    engine.register_type_with_name::<RunHandle>("recorded run");
    printable!(Angle, Length, At, Facing, Inside, ObjectHandle, RunHandle);
}

/// Functions that make an angle of a number, and their unit in rad.
pub const ANGLE_UNITS: &[(&str, f64)] = &[("deg", std::f64::consts::PI / 180.0), ("rad", 1.0)];

/// Functions that make a length of a number, and their unit in m.
pub const LENGTH_UNITS: &[(&str, f64)] = &[("m", 1.0), ("cm", 0.01), ("mm", 0.001)];
