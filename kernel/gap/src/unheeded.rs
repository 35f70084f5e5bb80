//! What stands in recordings and is used by no fit: said, so that nobody takes it for used.

use std::collections::BTreeSet;

use sagci_model::{ActuatorLaw, ObjectModel};
use sagci_recording::{CommandKind, JointLog, Log};

use crate::GapError;
use crate::inputs::taken;
use crate::plant::Plant;
use crate::search::STEP;

/// Notes of recordings, then those on what no fit uses; what holds for all of them is said once.
pub(crate) fn notes<'a>(logs: impl Iterator<Item = &'a Log> + Clone, model: &ObjectModel) -> Vec<String> {
    let read = logs.clone().flat_map(|l| &l.notes).map(|n| format!("{}: {}", n.place, n.message));
    let joints = || logs.clone().flat_map(|l| l.measured(model));
    let refused = joints().filter_map(|joint| refused(joint, model));
    let mut notes: Vec<String> = read.chain(refused).collect();
    let velocities: BTreeSet<&str> = joints().filter(|j| j.velocity.is_some()).map(|j| j.name.as_str()).collect();
    if !velocities.is_empty() {
        let names = velocities.into_iter().map(|name| format!("{name}.velocity")).collect::<Vec<_>>().join(", ");
        notes.push(format!(
            "{names}: measured velocities are not used; velocities come from the positions, whose noise is known, where nobody says how a measured \
             velocity was made"
        ));
    }
    let mut said = BTreeSet::new();
    notes.retain(|n| said.insert(n.clone()));
    notes
}

/// A command that the drive does not take, where an effort stands in for it.
fn refused(joint: &JointLog, model: &ObjectModel) -> Option<String> {
    let (kind, _) = joint.command.as_ref()?;
    let law = model.document.actuators.iter().find(|a| a.joint == joint.name).map(|a| &a.law);
    if joint.effort.is_none() || taken(*kind, law) {
        return None;
    }
    let (channel, needed) = match kind {
        CommandKind::Effort => ("command_effort", "efforts are taken by `kind: torque`, and by a joint without an entry"),
        CommandKind::Position => {
            ("command_position", "positions are taken by `kind: position_servo`, and by `kind: dc_motor` with a `gain`")
        }
        CommandKind::Voltage => ("command_voltage", "voltages are taken by `kind: dc_motor`"),
    };
    let there = match law {
        None => "model.yaml has no entry for this joint under `actuators`",
        Some(ActuatorLaw::Torque { .. }) => "its drive in model.yaml is `kind: torque`",
        Some(ActuatorLaw::PositionServo { .. }) => "its drive in model.yaml is `kind: position_servo`",
        Some(ActuatorLaw::DcMotor { gain: None, .. }) => "its drive in model.yaml is `kind: dc_motor` without a `gain`",
        Some(ActuatorLaw::DcMotor { .. }) => "its drive in model.yaml is `kind: dc_motor`",
    };
    Some(format!(
        "{}.{channel}: is not used: {there}, and {needed}; the effort drives the model instead, and effects of its drive cannot be seen",
        joint.name
    ))
}

/// Refuses a model that cannot be simulated, with the line of its document that names what is wrong, where one does.
pub(crate) fn check(model: &ObjectModel) -> Result<(), GapError> {
    let Err(error) = Plant::new(model, &[], STEP) else { return Ok(()) };
    let message = error.to_string();
    let path = model.folder.join(sagci_model::DOCUMENT_FILE);
    let text = std::fs::read_to_string(&path).unwrap_or_default();
    let line = message.split('\'').nth(1).and_then(|name| text.lines().position(|line| line.contains(name)));
    Err(line.map_or(error, |line| GapError::data(format!("{}:{}", path.display(), line + 1), message)))
}
