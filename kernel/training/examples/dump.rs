#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use sagci_furniture::{Category, Look, Random, families, look};
fn main() {
    let a: Vec<String> = std::env::args().skip(1).collect();
    let category = *Category::ALL.iter().find(|c| c.name() == a[0]).unwrap();
    let (seed, index): (u64, u64) = (a[1].parse().unwrap(), a[2].parse().unwrap());
    let mut random = Random::new(seed.wrapping_mul(1009).wrapping_add(index), category.name());
    let of = families(category, false);
    let object = of[index as usize % of.len()].draw(&mut random);
    let how = Look::draw(&mut random);
    let cloud = look(&object, &how, &mut random);
    eprintln!("{how:?}");
    let an = &sagci_modelling::analyse(&cloud.points).unwrap()[0];
    let pieces = an.piece_of_input();
    for ((p, t), s) in cloud.points.iter().zip(&cloud.part).zip(pieces) {
        let q = cloud.X_WF.inverse() * p;
        println!("{:.4} {:.4} {:.4} {t} {}", q.x, q.y, q.z, s.map_or(-1, |s| s as i32));
    }
}
