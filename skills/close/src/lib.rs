//! Shuts a door, a drawer or a lid by its handle: the joint moves to its lower end and is pressed against it.
#![deny(unsafe_code)]

use sagci_execution::{Bench, Motion, articulate, pace};
use sagci_model::JointKind;
use sagci_skill::{Failure, Manifest, ManifestError, Plan, PlanRequest, Skill, export_skill};

/// How far beyond its end the joint is led, so that it is pressed shut: rad, m.
const PRESS: (f64, f64) = (0.03, 0.008);
/// What counts as shut: rad, m.
const SHUT: (f64, f64) = (0.05, 0.01);

/// The skill.
#[derive(Default)]
pub struct Close;

export_skill!(Close, sagci_skill_close);

impl Skill for Close {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        Manifest::from_yaml(include_str!("../skill.yaml"))
    }

    fn plan(&self, request: &PlanRequest, cancelled: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        let bench = Bench::new(request, cancelled)?;
        let (object, joint) = (bench.object("object")?, bench.joint("object")?);
        let model = &bench.scene.objects[object].model;
        let index = model.moving_joints().nth(joint).unwrap_or_default();
        let joint_model = &model.joints[index];
        let pick = |(turn, slide): (f64, f64)| if joint_model.kind == JointKind::Prismatic { slide } else { turn };
        let shut = joint_model.limits.lower;
        articulate(
            &bench,
            &Motion { object, joint, to: shut - pick(PRESS), between: [shut - pick(SHUT), shut + pick(SHUT)], pace: pace(request)? },
        )
    }
}
