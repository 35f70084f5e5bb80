//! What is a plain block, and what is a shut front that shows no more of itself than a seam.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use nalgebra::{Point3, Unit, Vector3};
use sagci_furniture::{Category, Class, Even, Joint, Kind, Object, Part, Random, Solid, evenly};
use sagci_modelling::{Perceived, Weights, perceive};

const THINGS: u64 = 16;

/// What is made of a thing whose surface was sampled evenly.
fn sampled(draw: &dyn Fn(&mut Random) -> Object) -> Vec<Perceived> {
    let weights = Weights::shipped().unwrap();
    let one = |seed: u64| {
        let mut random = Random::new(seed, "still or shut");
        let object = draw(&mut random);
        let how = Even { views: 1 + seed as usize % 2, points: 12_000, noise: 0.0005 };
        perceive(&evenly(&object, &how, &mut random).points, "thing", &weights).unwrap()
    };
    (0..THINGS).map(one).collect()
}

fn block(random: &mut Random) -> Object {
    let (x, y, z) = (random.between(0.1, 0.4), random.between(0.1, 0.4), random.between(0.2, 1.2));
    let solids = vec![Solid::between([-x, -y, 0.0], [x, y, z])];
    Object { category: Category::Box, family: "block", parts: vec![Part { class: Class::Body, solids }], joints: Vec::new() }
}

/// A cupboard whose door lies between its boards, flush with them, without a handle.
fn cupboard(random: &mut Random) -> Object {
    let (x, y, z, t) = (random.between(0.12, 0.3), random.between(0.15, 0.3), random.between(0.4, 0.9), 0.018);
    let boards = vec![
        Solid::between([-x, -y, 0.0], [x, y, t]),
        Solid::between([-x, -y, z - t], [x, y, z]),
        Solid::between([-x, -y, t], [x, -y + t, z - t]),
        Solid::between([-x, y - t, t], [x, y, z - t]),
        Solid::between([-x, -y + t, t], [-x + 0.005, y - t, z - t]),
    ];
    let gap = 0.004;
    let door = Solid::between([x - 0.018, -y + t + gap, t + gap], [x, y - t - gap, z - t - gap]);
    let origin = Point3::new(x, y - t - gap, z / 2.0);
    let joint = Joint { part: 1, kind: Kind::Revolute, axis: Unit::new_normalize(-Vector3::z()), origin, upper: 1.6, state: 0.0 };
    let parts = vec![Part { class: Class::Body, solids: boards }, Part { class: Class::Door, solids: vec![door] }];
    Object { category: Category::Storage, family: "cupboard", parts, joints: vec![joint] }
}

#[test]
fn most_plain_blocks_sampled_evenly_are_rigid_and_say_why() {
    let found = sampled(&block);
    let rigid: Vec<&Perceived> = found.iter().filter(|f| f.report.rigid).collect();
    assert!(rigid.iter().all(|f| f.report.parts.len() == 1 && f.report.joints.is_empty() && f.report.reason.is_some()));
    assert!(rigid.iter().all(|f| f.part.iter().all(|p| *p <= 0)), "a rigid thing has points of a part");
    assert!(rigid.len() as u64 * 3 >= 2 * THINGS, "{} of {THINGS} blocks are rigid", rigid.len());
}

#[test]
fn a_flush_door_with_nothing_but_a_seam_is_found_more_often_than_not() {
    let found = sampled(&cupboard).iter().filter(|f| !f.report.rigid).count() as u64;
    assert!(found * 2 > THINGS, "{found} of {THINGS} cupboards have a part");
}
