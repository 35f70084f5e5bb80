//! Takes an object with the gripper and lifts it, by a grasp that also allows to put it where it is to go.
#![deny(unsafe_code)]

use sagci_control::Payload;
use sagci_execution::{Bench, Fingers, Guard, Pace, Segment, bad_argument, failure_of, through_air, with_feeling};
use sagci_planning::{PickPlan, TransferOptions, plan_pick};
use sagci_signal::GripperCommand;
use sagci_skill::{
    BeliefChange, Failure, FailureCode, Manifest, ManifestError, Measure, Plan, PlanRequest, Postcondition, Skill, export_skill,
};

/// Grip, N a finger.
const GRIP: f64 = 30.0;
/// Plans that are tried when the first has no free way to it or from it.
const PLANS: usize = 4;

/// The skill.
#[derive(Default)]
pub struct Pick;

export_skill!(Pick, sagci_skill_pick);

impl Skill for Pick {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        Manifest::from_yaml(include_str!("../skill.yaml"))
    }

    fn plan(&self, request: &PlanRequest, cancelled: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        let bench = Bench::new(request, cancelled)?;
        let object = bench.object("object")?;
        let destination = bench.place("destination")?.map(|(_, destination)| destination);
        let entry = &bench.scene.objects[object];
        if let Some(held) = bench.held() {
            return Err(bad_argument(format!("the gripper already holds '{}'; place it first", bench.scene.objects[held].name)));
        }
        if !entry.model.document.movable {
            return Err(bad_argument(format!("'{}' is fixed to its place (its model says movable: false)", entry.name)));
        }
        let options = TransferOptions { seed: request.seed, plans: PLANS, ..TransferOptions::default() };
        let plans =
            plan_pick(&bench.scene, &bench.world, object, &request.q, destination.as_ref(), &options, cancelled).map_err(failure_of)?;
        let mut first_failure = None;
        for plan in &plans {
            match carry_out(&bench, object, plan) {
                Ok(done) => return Ok(done),
                Err(failure) if failure.code == FailureCode::Cancelled => return Err(failure),
                Err(failure) => first_failure = first_failure.or(Some(failure)),
            }
        }
        Err(first_failure.unwrap_or_else(|| bad_argument("no grasp was found".into())))
    }
}

fn carry_out(bench: &Bench, object: usize, plan: &PickPlan) -> Result<Plan, Failure> {
    let entry = &bench.scene.objects[object];
    let open = GripperCommand { width: plan.grasp.width, force: 20.0 };
    let shut = GripperCommand { width: 0.0, force: GRIP };
    let rest = bench.rest()?;
    let first = plan.approach.first().cloned().unwrap_or_default();
    let last = plan.lift.last().cloned().unwrap_or_default();

    let reach = bench.free(&bench.world, &bench.request.q, &first, open.width, Pace::Free, "reach the object")?;
    let mut carrying = bench.world.clone();
    carrying.attach(object, &plan.X_TO);
    let back = bench.free(&carrying, &last, &rest, plan.grasp.hold_width, Pace::Careful, "carry the object")?;
    let approach = bench.timed(&plan.approach, Pace::Slow)?;
    let lift = bench.timed(&plan.lift, Pace::Slow)?;

    let hold = plan.grasp.hold_width;
    let least = 0.4 * hold;
    let expected = [0.5 * hold, 0.5 * (hold + plan.grasp.width)];
    let feel = Guard::Overload { limit: 30.0 };
    let mut sequence = bench.sequence(open)?;
    sequence.phase("reach the object", [through_air(reach, open, 0.0)]);
    sequence.phase("approach the object", [with_feeling(approach, open, false, feel, 0.0)]);
    let grip = Fingers { gripper: shut, expected, yielding: true, timeout: 2.0 };
    let payload = Payload::of(&entry.model, &plan.X_TO, &entry.q);
    sequence.phase("grip the object", [Segment::Fingers(grip), Segment::Carry(Some(payload))]);
    sequence.phase("lift the object", [with_feeling(lift, shut, true, feel, least)]);
    sequence.phase("carry the object", [through_air(back, shut, least)]);
    let carried = sequence.phases().len() - 1;

    let mut summary = bench.summary(&sequence, &rest);
    summary.predicted = vec![Measure { name: "grip width".into(), value: hold, unit: "m".into() }];
    summary.after = vec![BeliefChange::Held { object: entry.name.clone(), X_TO: plan.X_TO }];
    summary.postconditions = vec![Postcondition::Holding { object: entry.name.clone() }];

    // In the hand it lies where it stood when the fingers closed on it.
    let (name, X_WO) = (entry.name.clone(), entry.X_WO);
    let gripped = 2;
    sequence.report(Box::new(move |endings| {
        let Some(grip) = endings.iter().find(|e| e.phase == gripped) else { return (Vec::new(), Vec::new()) };
        let held = BeliefChange::Held { object: name.clone(), X_TO: grip.X_WT.inverse() * X_WO };
        let width = endings.iter().rfind(|e| e.phase == carried).unwrap_or(grip).gripper_width;
        (vec![Measure { name: "grip width".into(), value: width, unit: "m".into() }], vec![held])
    }));
    Ok(Plan { summary, execution: Box::new(sequence) })
}
