//! The series of one recording.

use sagci_model::ObjectModel;

/// One measured quantity. Times strictly increase, all numbers are finite.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// Times, s.
    pub time: Vec<f64>,
    /// Values at these times.
    pub value: Vec<f64>,
}

impl Series {
    /// Do its values change by more than their noise, which is that of neighbouring ones?
    pub fn moves(&self) -> bool {
        crate::check::is_moving(self)
    }
}

/// What a command asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum CommandKind {
    /// An effort, N m or N.
    Effort,
    /// A position, rad or m.
    Position,
    /// A voltage, V.
    Voltage,
}

/// What was measured on one joint.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointLog {
    /// Name of the joint.
    pub name: String,
    /// Positions, rad or m.
    pub position: Series,
    /// Velocities, rad/s or m/s.
    pub velocity: Option<Series>,
    /// Efforts, N m or N; positive along the joint's axis.
    pub effort: Option<Series>,
    /// What was commanded. A value acts from its time until that of the next one.
    pub command: Option<(CommandKind, Series)>,
    /// Intervals `[from, to)`, s, in which nothing was commanded: a value from before does not act there. At a commanded voltage the
    /// circuit is open: the drive gives no effort. `to` is infinite where no command follows. In order, apart, not empty.
    pub command_gaps: Vec<[f64; 2]>,
}

/// A force that was measured at a link.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WrenchLog {
    /// The link at whose frame it was measured, and in whose axes it is given.
    pub link: String,
    /// Times, s.
    pub time: Vec<f64>,
    /// Torque (x, y, z, N m), then force (N), on the link.
    pub F_L: Vec<[f64; 6]>,
}

/// Something about the data that was set right, left out or doubted, in a sentence for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Where: file, line or topic, joint.
    pub place: String,
    /// What.
    pub message: String,
}

/// One recording: one trajectory of one mechanism.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Log {
    /// Where it came from, for messages.
    pub source: String,
    /// SHA-256 of the file's bytes, in hexadecimal.
    pub hash: String,
    /// Joints, in the order in which the recording names them.
    pub joints: Vec<JointLog>,
    /// Forces at links.
    pub wrenches: Vec<WrenchLog>,
    /// Its quantities were sampled row by row, as in a table: an empty cell is a sample that is missing. Else what was commanded is an event,
    /// and holds until the next one.
    pub is_table: bool,
    /// What was found wrong and set right.
    pub notes: Vec<Note>,
    /// Its times run on from the recording before it: heat and drift go on.
    pub continues: bool,
    /// Whole seconds that were taken off every time, the same for all recordings that were read together; zero unless the clock counts
    /// from long ago (1970, say), where times in s would be coarse.
    pub epoch: i64,
}

impl JointLog {
    /// What acts at a time: the last command before it, unless there was none or a gap began since.
    pub fn command_at(&self, time: f64) -> Option<f64> {
        let (_, series) = self.command.as_ref()?;
        if self.command_gaps.iter().any(|[from, to]| *from <= time && time < *to) {
            return None;
        }
        series.value.get(series.time.partition_point(|t| *t <= time).checked_sub(1)?).copied()
    }
}

impl Log {
    /// The series of a joint.
    pub fn joint(&self, name: &str) -> Option<&JointLog> {
        self.joints.iter().find(|j| j.name == name)
    }

    /// Does a force that was measured at a link act on a joint of a model? It does on those between the link and the root.
    pub fn pushes(&self, model: &ObjectModel, joint: &str) -> bool {
        let Some(joint) = model.joint(joint) else { return false };
        let hangs_on = |link: usize| {
            let mut below = Some(link);
            std::iter::from_fn(|| {
                let above = model.joints.iter().position(|j| Some(j.child) == below)?;
                below = Some(model.joints[above].parent);
                Some(above)
            })
            .any(|above| above == joint)
        };
        self.wrenches.iter().filter(|w| !w.time.is_empty()).filter_map(|w| model.link(&w.link)).any(hangs_on)
    }

    /// Joints of a model that this recording has positions of.
    pub fn measured<'a>(&'a self, model: &'a ObjectModel) -> impl Iterator<Item = &'a JointLog> {
        self.joints.iter().filter(|j| model.joint(&j.name).is_some() && !j.position.time.is_empty())
    }
}
