#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use nalgebra::{UnitQuaternion, Vector3};
use sagci_furniture::{Category, Kind};

use super::score::score;
use super::{AnsweredJoint, Case, CloudAnswer, PerceptionOptions, case, figures};

const OPTIONS: PerceptionOptions = PerceptionOptions { seed: 4, objects: 2, only: String::new(), trained: false, makers: Vec::new() };

/// The truth as an answer.
fn truth(case: &Case) -> CloudAnswer {
    let joint = |j: &sagci_furniture::Joint| {
        let (axis, origin) = case.cloud.joint(j);
        AnsweredJoint { part: j.part as i32, slides: j.kind == Kind::Prismatic, axis, origin }
    };
    CloudAnswer {
        part: case.cloud.part.clone(),
        confidence: vec![1.0; case.object.parts.len()],
        joints: case.object.joints.iter().map(joint).collect(),
    }
}

#[test]
fn the_truth_scores_full_marks() {
    let scored: Vec<_> = Category::ALL
        .into_iter()
        .flat_map(|c| (0..2).map(move |n| case(&OPTIONS, c, n)))
        .map(|case| score(&case, Ok(truth(&case)), 0.0))
        .collect();
    let table = figures::table(&OPTIONS, &scored, &[]);
    let overall = table.rows.iter().find(|r| r.name == "overall").unwrap();
    for share in [overall.miou, overall.ap50, overall.ap75, overall.map, overall.type_accuracy, overall.end_to_end] {
        assert!((share - 1.0).abs() < 1e-9, "{overall:?}");
    }
    assert!(overall.axis_mean < 1e-5 && overall.place_mean < 1e-9 && overall.line_mean < 1e-9 && overall.false_joints == 0.0);
}

#[test]
fn an_axis_that_is_off_is_measured_as_what_it_is() {
    let case = case(&OPTIONS, Category::Microwave, 0);
    let mut answer = truth(&case);
    // Turned by 7 degrees about the origin, then 3 cm aside.
    let across = answer.joints[0].axis.cross(&Vector3::new(0.3, 0.5, 0.8)).normalize();
    answer.joints[0].axis = UnitQuaternion::from_scaled_axis(across * 7.0_f64.to_radians()) * answer.joints[0].axis;
    answer.joints[0].origin += across * 0.03;
    let scored = score(&case, Ok(answer), 0.0);
    let part = &scored.parts[0];
    assert!((part.axis.unwrap().to_degrees() - 7.0).abs() < 1e-6);
    assert!((part.place.unwrap()[1] - 0.03).abs() < 1e-6 && !part.whole);
}

#[test]
fn a_joint_on_nothing_is_counted_as_false_and_a_missed_part_as_a_failure() {
    let case = case(&OPTIONS, Category::Storage, 1);
    let mut answer = truth(&case);
    // One half of the body is said to slide, and all else to be the body.
    for (i, part) in answer.part.iter_mut().enumerate() {
        *part = i32::from(*part == 0 && i % 2 == 0);
    }
    answer.confidence = vec![0.5, 0.9];
    answer.joints.truncate(1);
    answer.joints[0].part = 1;
    let scored = score(&case, Ok(answer), 0.0);
    assert_eq!(scored.false_joints, 1);
    assert!(scored.parts.iter().all(|p| !p.whole && p.axis.is_none()));
}

#[test]
fn no_answer_is_a_failure_of_every_part() {
    let case = case(&OPTIONS, Category::Oven, 0);
    let scored = score(&case, Err("no model".to_owned()), 0.0);
    assert!(scored.failed && scored.parts.iter().all(|p| p.overlap == 0.0 && !p.whole));
}

#[test]
fn a_body_that_is_taken_for_a_part_is_no_moving_part_that_was_found() {
    let case = case(&OPTIONS, Category::Microwave, 0);
    let mut answer = truth(&case);
    answer.part.iter_mut().filter(|p| (0..2).contains(*p)).for_each(|p| *p = 1 - *p);
    let table = figures::table(&OPTIONS, &[score(&case, Ok(answer), 0.0)], &[]);
    let found = table.rows.iter().find(|r| r.name == "microwave").unwrap();
    assert!((found.ap75 - 1.0).abs() < 1e-9 && found.ap75_moving < 1e-9, "{found:?}");
}
