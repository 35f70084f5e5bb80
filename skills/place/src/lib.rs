//! Puts the object that the gripper holds into something or onto the table, and lets go.
#![deny(unsafe_code)]

use nalgebra::Vector3;
use sagci_control::Payload;
use sagci_execution::{Bench, Fingers, Guard, Pace, Segment, bad_argument, failure_of, through_air, with_feeling};
use sagci_planning::{PlacePlan, TransferOptions, plan_place};
use sagci_signal::GripperCommand;
use sagci_skill::{
    BeliefChange, Failure, FailureCode, Manifest, ManifestError, Measure, Place as Destination, Plan, PlanRequest, Postcondition, Skill,
    export_skill,
};

/// Grip while carrying, N a finger.
const GRIP: f64 = 30.0;
/// Push from below that says that the object stands, N.
const STANDS: f64 = 6.0;
/// Plans that are tried when the first has no free way to it or from it.
const PLANS: usize = 4;

/// The skill.
#[derive(Default)]
pub struct Place;

export_skill!(Place, sagci_skill_place);

impl Skill for Place {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        Manifest::from_yaml(include_str!("../skill.yaml"))
    }

    fn plan(&self, request: &PlanRequest, cancelled: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        let bench = Bench::new(request, cancelled)?;
        let object = bench.object("object")?;
        let Some((place, destination)) = bench.place("place")? else {
            return Err(bad_argument("'place' must be a place, such as inside(microwave)".into()));
        };
        if bench.held() != Some(object) {
            return Err(bad_argument(format!("the gripper does not hold '{}'; pick it first", bench.scene.objects[object].name)));
        }
        let options = TransferOptions { seed: request.seed, plans: PLANS, ..TransferOptions::default() };
        let plans = plan_place(&bench.scene, &bench.world, object, request.gripper_width, &request.q, &destination, &options, cancelled)
            .map_err(failure_of)?;
        let mut first_failure = None;
        for plan in &plans {
            match carry_out(&bench, object, &place, plan) {
                Ok(done) => return Ok(done),
                Err(failure) if failure.code == FailureCode::Cancelled => return Err(failure),
                Err(failure) => first_failure = first_failure.or(Some(failure)),
            }
        }
        Err(first_failure.unwrap_or_else(|| bad_argument("no way to put it there was found".into())))
    }
}

fn carry_out(bench: &Bench, object: usize, place: &Destination, plan: &PlacePlan) -> Result<Plan, Failure> {
    let entry = &bench.scene.objects[object];
    let X_TO = entry.X_TO.unwrap_or_default();
    let open = GripperCommand { width: plan.width, force: 20.0 };
    let shut = GripperCommand { width: 0.0, force: GRIP };
    let width = bench.request.gripper_width;
    let rest = bench.rest()?;
    let first = plan.insert.first().cloned().unwrap_or_default();
    let last = plan.retreat.last().cloned().unwrap_or_default();

    let reach = bench.free(&bench.world, &bench.request.q, &first, width, Pace::Careful, "bring the object")?;
    let mut released = bench.world.clone();
    released.set_pose(object, &plan.X_WO);
    let back = bench.free(&released, &last, &rest, open.width, Pace::Free, "return from the object")?;
    let insert = bench.timed(&plan.insert, Pace::Slow)?;
    let retreat = bench.timed(&plan.retreat, Pace::Slow)?;

    let least = 0.4 * width;
    let feel = Guard::Overload { limit: 30.0 };
    let down = Guard::Touch { force: STANDS, direction: -Vector3::z(), limit: 30.0 };
    let mut sequence = bench.sequence(shut)?;
    let payload = Payload::of(&entry.model, &X_TO, &entry.q);
    sequence.phase("bring the object", [Segment::Carry(Some(payload)), through_air(reach, shut, least)]);
    sequence.phase("put the object down", [with_feeling(insert, shut, false, down, least)]);
    let put_down = 1;
    let letting_go = Fingers { gripper: open, expected: [0.5 * (width + open.width), open.width + 0.01], yielding: false, timeout: 1.5 };
    sequence.phase("let go", [Segment::Carry(None), Segment::Fingers(letting_go)]);
    sequence.phase("leave the object", [with_feeling(retreat, open, true, feel, 0.0)]);
    sequence.phase("return", [through_air(back, open, 0.0)]);

    let mut summary = bench.summary(&sequence, &rest);
    let heights = |z: f64| vec![Measure { name: "height".into(), value: z, unit: "m".into() }];
    summary.predicted = heights(plan.X_WO.translation.z);
    summary.after = vec![BeliefChange::Released { object: entry.name.clone(), X_WO: plan.X_WO }];
    summary.postconditions = vec![Postcondition::At { object: entry.name.clone(), place: place.clone() }];

    let name = entry.name.clone();
    sequence.report(Box::new(move |endings| {
        let Some(end) = endings.iter().rfind(|e| e.phase == put_down) else { return (Vec::new(), Vec::new()) };
        let X_WO = end.X_WT * X_TO;
        (heights(X_WO.translation.z), vec![BeliefChange::Released { object: name.clone(), X_WO }])
    }));
    Ok(Plan { summary, execution: Box::new(sequence) })
}
