//! How far the front that was chosen is from the true one, by category, on objects that nothing was trained on.
//!
//! `cargo run --release -p sagci-training --example fronts -- WEIGHTS OBJECTS SEED`
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use nalgebra::Vector3;
use sagci_furniture::{Category, Look, Random, families, look};
use sagci_modelling::{Weights, perceive};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let weights = Weights::read(std::path::Path::new(&arguments[0])).unwrap();
    let number = |k: usize, otherwise: u64| arguments.get(k).and_then(|a| a.parse().ok()).unwrap_or(otherwise);
    for category in Category::ALL {
        let (mut right, mut turned, mut oblique) = (0, 0, 0);
        for index in 0..number(1, 20) {
            let mut random = Random::new(number(2, 77).wrapping_mul(1009).wrapping_add(index), category.name());
            let of = families(category, false);
            let object = of[index as usize % of.len()].draw(&mut random);
            let cloud = look(&object, &Look::draw(&mut random), &mut random);
            let Ok(found) = perceive(&cloud.points, "object", &weights) else { continue };
            let front = found.X_WO.rotation * -Vector3::y();
            let off = front.dot(&(cloud.X_WF.rotation * Vector3::x())).clamp(-1.0, 1.0).acos().to_degrees();
            let by_quarters = (off / 90.0 - (off / 90.0).round()).abs() * 90.0;
            match (off < 2.0, by_quarters < 2.0) {
                (true, _) => right += 1,
                (false, true) => turned += 1,
                _ => oblique += 1,
            }
        }
        println!("{:13} right {right:3}  another side {turned:3}  oblique {oblique:3}", category.name());
    }
}
