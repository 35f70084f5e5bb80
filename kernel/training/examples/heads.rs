//! How right each head of the network is on true parts, by category, on objects that nothing was trained on.
//!
//! `cargo run --release -p sagci-training --example heads -- WEIGHTS OBJECTS SEED`
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use sagci_furniture::Category;
use sagci_modelling::Weights;
use sagci_training::{Score, learn, lessons};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let weights = Weights::read(std::path::Path::new(&arguments[0])).unwrap();
    let number = |k: usize, otherwise: u64| arguments.get(k).and_then(|a| a.parse().ok()).unwrap_or(otherwise);
    let taught = lessons(number(2, 5_000), 0..number(1, 200), false);
    for category in Category::ALL {
        let mut total = Score::default();
        taught.iter().filter(|l| l.category == category).for_each(|l| total.add(&learn(&weights.matrices, l, true, None).unwrap()));
        println!("{:13} {:4} lessons  {}", category.name(), total.lessons, total.line());
    }
}
