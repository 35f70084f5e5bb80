//! The tape's gradients, and that learning learns.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::collections::BTreeMap;

use sagci_modelling::network::Matrix;
use sagci_training::{Settings, judge, learn, lessons, train};

const SETTINGS: Settings = Settings { seed: 5, objects: 10, epochs: 6, batch: 4, rate: 2e-3 };

#[test]
fn the_loss_falls_and_the_run_repeats_to_the_bit() {
    let taught = lessons(SETTINGS.seed, SETTINGS.objects, false);
    let run = || train(&SETTINGS, None, &taught, &[], &mut |_, _| {}).unwrap();
    let first = run();
    let untrained = train(&Settings { epochs: 1, rate: 0.0, ..SETTINGS }, None, &taught, &[], &mut |_, _| {}).unwrap();
    let loss = |w: &BTreeMap<String, Matrix>| judge(w, &taught).unwrap().loss / taught.len() as f64;
    let (before, after) = (loss(&untrained.matrices), loss(&first.matrices));
    assert!(after < 0.8 * before, "{before} to {after}");
    assert_eq!(first.to_bytes().unwrap(), run().to_bytes().unwrap());
}

#[test]
fn gradients_agree_with_central_differences() {
    let taught = lessons(9, 3, false);
    let lesson = taught.iter().find(|l| !l.joints.is_empty()).unwrap();
    let mut weights = train(&Settings { epochs: 2, ..SETTINGS }, None, &taught, &[], &mut |_, _| {}).unwrap().matrices;
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
