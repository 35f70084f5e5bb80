//! What a robot makes of a thing that it went around: dense clouds, put together of many views whose poses it knows nearly.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use sagci_furniture::{Category, Look, Object, Random, families, look};
use sagci_modelling::{Perceived, Weights, perceive};

/// A thing of a family that nothing was trained on, its doors shut, and what a robot that goes around it makes of it.
fn gone_around(category: Category, seed: u64, weights: &Weights) -> (Object, Perceived) {
    let mut random = Random::new(seed, "gone around");
    let of = families(category, true);
    let mut object = of[seed as usize % of.len()].draw(&mut random);
    object.joints.iter_mut().for_each(|j| j.state = 0.0);
    let how = Look { views: 8, width: 280, points: 60_000, near: 0.8, surroundings: false, ..Look::around(&mut random) };
    let cloud = look(&object, &how, &mut random);
    (object, perceive(&cloud.points, "thing", weights).unwrap())
}

#[test]
fn a_dense_front_is_not_broken_into_several_doors() {
    let weights = Weights::shipped().unwrap();
    let (mut right, mut broken, mut all) = (0, 0, 0);
    for (category, seeds) in [(Category::Microwave, 0..10), (Category::Oven, 0..4)] {
        for seed in seeds {
            let (object, found) = gone_around(category, seed, &weights);
            let (true_parts, parts) = (object.joints.len(), found.report.joints.len());
            right += usize::from(parts == true_parts);
            broken += usize::from(parts > true_parts);
            all += 1;
        }
    }
    assert!(5 * right >= 4 * all && 8 * broken <= all, "of {all} things {right} have as many parts as they have, {broken} have more");
}
