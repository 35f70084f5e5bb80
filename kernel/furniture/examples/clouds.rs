//! Writes clouds of furniture as its camera sees it, a PLY file an object, to be looked at or modelled by hand:
//! `cargo run --release -p sagci-furniture --example clouds -- FOLDER [OBJECTS A CATEGORY] [SEED]`. Families that training never saw.
#![allow(clippy::print_stdout)]

use std::fmt::Write;
use std::path::PathBuf;

use sagci_furniture::{Category, Look, Random, families, look};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let folder = PathBuf::from(words.next().ok_or("give a folder to write to")?);
    let count: u64 = words.next().map_or(Ok(2), |w| w.parse())?;
    let seed: u64 = words.next().map_or(Ok(1), |w| w.parse())?;
    std::fs::create_dir_all(&folder)?;
    for category in Category::ALL {
        let of = families(category, true);
        for index in 0..count {
            let mut random = Random::new(seed.wrapping_mul(1_000_003).wrapping_add(index), category.name());
            let object = of[index as usize % of.len()].draw(&mut random);
            let how = Look::draw(&mut random);
            let points = look(&object, &how, &mut random).points;
            let mut text = format!(
                "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
                points.len()
            );
            for p in points {
                writeln!(text, "{} {} {}", p.x as f32, p.y as f32, p.z as f32)?;
            }
            let path = folder.join(format!("{}_{index}.ply", category.name()));
            std::fs::write(&path, text)?;
            println!("{}", path.display());
        }
    }
    Ok(())
}
