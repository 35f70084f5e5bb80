//! Opens a door, a drawer or a lid by its handle: the joint moves toward its upper end.
#![deny(unsafe_code)]

use sagci_execution::{Bench, Motion, articulate, bad_argument, pace};
use sagci_model::JointKind;
use sagci_skill::{Argument, Failure, Manifest, ManifestError, Plan, PlanRequest, Skill, export_skill};

/// Share of the joint's range that counts as open when the script does not say how far.
const FULLY: f64 = 0.9;
/// A motion counts as made when this share of it is done.
const ENOUGH: f64 = 0.93;

/// The skill.
#[derive(Default)]
pub struct Open;

export_skill!(Open, sagci_skill_open);

impl Skill for Open {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        Manifest::from_yaml(include_str!("../skill.yaml"))
    }

    fn plan(&self, request: &PlanRequest, cancelled: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        let bench = Bench::new(request, cancelled)?;
        let (object, joint) = (bench.object("object")?, bench.joint("object")?);
        let model = &bench.scene.objects[object].model;
        let index = model.moving_joints().nth(joint).unwrap_or_default();
        let joint_model = &model.joints[index];
        let (limits, slides) = (joint_model.limits, joint_model.kind == JointKind::Prismatic);
        let now = bench.scene.objects[object].q.get(joint).copied().unwrap_or(0.0);
        let to = match request.arguments.get("to") {
            None => limits.lower + FULLY * limits.range(),
            Some(Argument::Angle(angle)) if !slides => *angle,
            Some(Argument::Length(length)) if slides => *length,
            Some(_) => {
                let wanted = if slides { "a length, such as cm(15): it slides" } else { "an angle, such as deg(90): it turns" };
                return Err(bad_argument(format!("'to' for the joint '{}' must be {wanted}", joint_model.name)));
            }
        };
        if !to.is_finite() || to > limits.upper || to <= now {
            return Err(bad_argument(format!(
                "'to' = {to:.3} must lie between where '{}' is now, {now:.3}, and its upper limit, {:.3}",
                joint_model.name, limits.upper
            )));
        }
        // The last bit is lost to the springs of the grip: aim a little further where the joint allows it.
        let aim = (to + 0.5 * (1.0 - ENOUGH) * (to - now)).min(limits.upper);
        articulate(&bench, &Motion { object, joint, to: aim, between: [now + ENOUGH * (to - now), limits.upper], pace: pace(request)? })
    }
}
