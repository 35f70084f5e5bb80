//! The tape's gradients, and that learning learns.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::collections::BTreeMap;
use std::ops::Range;

use sagci_modelling::network::{Matrix, Weights};
use sagci_training::{
    Lesson, Settings, TrainingError, judge, learn, lessons, mean, train, train_border, train_evidence, train_masks, train_more_masks,
    train_trust,
};

const SETTINGS: Settings = Settings { seed: 5, objects: 10, at_once: 10, epochs: 6, batch: 4, rate: 2e-3, kept: 0.0 };

fn drawn(seed: u64) -> impl FnMut(Range<u64>) -> Vec<Lesson> {
    move |objects| lessons(seed, objects, false)
}

#[test]
fn the_loss_falls_and_the_run_repeats_to_the_bit() {
    let taught = lessons(SETTINGS.seed, 0..SETTINGS.objects, false);
    let run = || train(&SETTINGS, None, &mut drawn(SETTINGS.seed), &[], &mut |_, _| {}).unwrap();
    let first = run();
    let untrained = train(&Settings { epochs: 1, rate: 0.0, ..SETTINGS }, None, &mut drawn(SETTINGS.seed), &[], &mut |_, _| {}).unwrap();
    let loss = |w: &BTreeMap<String, Matrix>| judge(w, &taught).unwrap().loss / taught.len() as f64;
    let (before, after) = (loss(&untrained.matrices), loss(&first.matrices));
    assert!(after < 0.8 * before, "{before} to {after}");
    assert_eq!(first.to_bytes().unwrap(), run().to_bytes().unwrap());
}

#[test]
fn gradients_agree_with_central_differences() {
    let taught = lessons(9, 0..3, false);
    let lesson = taught.iter().find(|l| !l.joints.is_empty()).unwrap();
    let mut weights = train(&Settings { objects: 3, epochs: 2, ..SETTINGS }, None, &mut drawn(9), &[], &mut |_, _| {}).unwrap().matrices;
    let mut gradients = BTreeMap::new();
    learn(&weights, lesson, true, Some(&mut gradients)).unwrap();
    let mut agree = 0;
    for name in gradients.keys().cloned().collect::<Vec<_>>() {
        // The largest entry: single precision leaves little of small ones.
        let g = &gradients[&name];
        let at = g.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).unwrap().0;
        let value = weights[&name][at];
        let h = 2e-3 * (1.0 + value.abs());
        let mut loss = |x: f32| {
            weights.get_mut(&name).unwrap()[at] = x;
            learn(&weights, lesson, true, None).unwrap().loss
        };
        let difference = (loss(value + h) - loss(value - h)) / f64::from(2.0 * h);
        loss(value);
        let exact = f64::from(gradients[&name][at]);
        agree += usize::from((difference - exact).abs() < 0.05 * exact.abs() + 2e-3);
    }
    // Between the two sides of a difference some ReLU or maximum may have its kink.
    assert!(agree * 10 >= gradients.len() * 9, "{agree} of {} gradients agree", gradients.len());
}

#[test]
fn the_last_heads_learn_beside_weights_that_stay_and_repeat_to_the_bit() {
    type Train = dyn Fn(&Settings, &Weights, &mut dyn FnMut(&str)) -> Result<Weights, TrainingError>;
    let shipped = Weights::shipped().unwrap();
    let settings = Settings { objects: 12, epochs: 8, ..SETTINGS };
    let heads: [(&str, &Train); 4] =
        [("border.", &train_border), ("mask.", &train_masks), ("trust.", &train_trust), ("evidence.", &train_evidence)];
    for (own, train) in heads {
        // Of most still things nothing is found, and then they teach nothing.
        let settings = if own == "evidence." { Settings { objects: 48, epochs: 24, ..settings } } else { settings };
        let mut losses: Vec<f64> = Vec::new();
        let mut run = || {
            let number = |line: &str| line.split_once("loss ").and_then(|x| x.1.split_whitespace().next()?.parse::<f64>().ok());
            let mut told = |line: &str| losses.extend(number(line));
            train(&settings, &shipped, &mut told).unwrap()
        };
        let (first, again) = (run(), run());
        assert_eq!(first.to_bytes().unwrap(), again.to_bytes().unwrap());
        let last = settings.epochs - 1;
        assert!(losses[last] < 0.8 * losses[0], "{own:?} {losses:?}");
        for (name, before) in &shipped.matrices {
            let learned = name.starts_with(own);
            assert_eq!(*before == first.matrices[name], !learned, "{name}");
        }
    }
}

/// A head that goes on begins as what it was: where nothing is learned, it is that to the bit.
#[test]
fn a_head_that_goes_on_does_not_begin_anew() {
    let shipped = Weights::shipped().unwrap();
    let on = |rate: f64| train_more_masks(&Settings { objects: 4, epochs: 1, rate, ..SETTINGS }, &shipped, &mut |_| {}).unwrap().matrices;
    assert_eq!(on(0.0), shipped.matrices);
    let learned = on(1e-3);
    for (name, before) in &shipped.matrices {
        assert!(*before == learned[name] || name.starts_with("mask."), "{name}");
    }
    assert_ne!(learned, shipped.matrices);
}

/// Each object is drawn once, and all of them are, if the last part is smaller.
#[test]
fn what_is_drawn_in_parts_is_drawn_whole_and_once() {
    let mut asked = Vec::new();
    let mut draw = |objects: Range<u64>| {
        asked.push(objects.clone());
        lessons(3, objects, false)
    };
    let settings = Settings { objects: 5, at_once: 2, epochs: 2, ..SETTINGS };
    let mut lines = 0;
    train(&settings, None, &mut draw, &[], &mut |_, _| lines += 1).unwrap();
    assert_eq!(asked, [0..2, 2..4, 4..5]);
    assert_eq!(lines, 6);
}

/// What is learned of new shapes is mixed with what was known: all of it kept is what was known, half of it the mean.
#[test]
fn what_was_known_is_kept_by_its_share() {
    let round = |from: Option<&Weights>, kept: f64| {
        let settings = Settings { seed: 3, objects: 6, epochs: 1, kept, ..SETTINGS };
        train(&settings, from, &mut drawn(3), &[], &mut |_, _| {}).unwrap()
    };
    let before = round(None, 0.0);
    let learned = round(Some(&before), 0.0);
    assert_eq!(round(Some(&before), 1.0).matrices, before.matrices);
    let half = round(Some(&before), 0.5).matrices;
    for (name, m) in &half {
        let mean = (&before.matrices[name] + &learned.matrices[name]) * 0.5;
        assert!((m - mean).amax() < 1e-6, "{name}");
    }
    assert_ne!(half, learned.matrices, "nothing was learned");
}

/// Heads that a round does not train must not be lost with it: they go on from what they were.
#[test]
fn a_round_leaves_other_heads_as_they_were() {
    let shipped = Weights::shipped().unwrap();
    let settings = Settings { objects: 4, epochs: 1, ..SETTINGS };
    let learned = train(&settings, Some(&shipped), &mut drawn(3), &[], &mut |_, _| {}).unwrap().matrices;
    assert!(learned.keys().eq(shipped.matrices.keys()));
    for last in ["mask.", "border.", "trust.", "evidence."] {
        assert!(shipped.matrices.iter().filter(|(name, _)| name.starts_with(last)).all(|(name, m)| *m == learned[name]), "{last}");
    }
    assert_ne!(learned, shipped.matrices);
}

#[test]
fn a_mean_lies_between_its_members_and_says_once_what_they_went_on_from() {
    let round = |seed: u64, from: Option<&Weights>| {
        let settings = Settings { seed, objects: 4, epochs: 1, ..SETTINGS };
        train(&settings, from, &mut drawn(seed), &[], &mut |_, _| {}).unwrap()
    };
    let before = round(3, None);
    let [one, other] = [round(4, Some(&before)), round(5, Some(&before))];
    let both = mean(&[one.clone(), other.clone()]).unwrap();
    for (name, m) in &both.matrices {
        assert!((m - (&one.matrices[name] + &other.matrices[name]) * 0.5).amax() < 1e-6, "{name}");
    }
    let note: serde_json::Value = serde_json::from_str(&both.made_by).unwrap();
    let known: serde_json::Value = serde_json::from_str(&before.made_by).unwrap();
    assert_eq!(note["from"], known);
    let seeds: Vec<u64> = note["mean_of"].as_array().unwrap().iter().filter_map(|n| n["settings"]["seed"].as_u64()).collect();
    assert_eq!(seeds, [4, 5]);
    let narrower = Weights { matrices: one.matrices.iter().skip(1).map(|(k, v)| (k.clone(), v.clone())).collect(), ..one.clone() };
    assert!(matches!(mean(&[one, narrower]), Err(TrainingError::Unlike { .. })));
    assert!(matches!(mean(&[]), Err(TrainingError::NoWeights)));
}
