//! Where the way from cloud to joint ends: on furniture whose truth is known, what would remain wrong if the network made no mistake?
//!
//! `cargo run --release -p sagci-training --example stages -- OBJECTS SEED held_out`
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::time::Instant;

use nalgebra::Vector3;
use sagci_furniture::{Category, Kind, Look, Random, families, look};
use sagci_modelling::{Side, analyse};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, otherwise: u64| arguments.get(k).and_then(|a| a.parse().ok()).unwrap_or(otherwise);
    let (objects, seed) = (number(0, 20), number(1, 77));
    let held_out = arguments.iter().any(|a| a == "held_out");
    let each = arguments.iter().any(|a| a == "each");
    let mut seconds = [0.0; 4];
    println!("category      parts  pieces>.5 pieces>.75  candidate  within5cm  yaw<2deg  size");
    for category in Category::ALL {
        let (mut parts, mut found, mut well, mut candidate, mut near, mut straight, mut first, mut pieces) =
            (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for index in 0..objects {
            let mut random = Random::new(seed.wrapping_mul(1009).wrapping_add(index), category.name());
            let of = families(category, held_out);
            let family = of[index as usize % of.len()];
            let start = Instant::now();
            let object = family.draw(&mut random);
            let how = Look::draw(&mut random);
            let cloud = look(&object, &how, &mut random);
            seconds[0] += start.elapsed().as_secs_f64();
            let start = Instant::now();
            let Ok(analyses) = analyse(&cloud.points) else { continue };
            seconds[1] += start.elapsed().as_secs_f64();
            let out = cloud.X_WF.rotation * Vector3::x();
            let off = |a: &sagci_modelling::Analysis| (0..4).map(|q| Side::new(a, q).front().dot(&out)).fold(-1.0, f64::max);
            let analysis = analyses.iter().max_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            first += f64::from(u8::from(off(&analyses[0]).min(1.0).acos().to_degrees() < 2.0)) / objects as f64;
            let n = analysis.pieces();
            pieces += n as f64 / objects as f64;
            let of_input = analysis.piece_of_input();
            let mut votes: Vec<BTreeMap<i32, f64>> = vec![BTreeMap::new(); n];
            for (part, piece) in cloud.part.iter().zip(&of_input) {
                if let Some(piece) = piece {
                    *votes[*piece as usize].entry(*part).or_default() += 1.0;
                }
            }
            let major: Vec<i32> =
                votes.iter().map(|v| v.iter().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(p, _)| (*p).max(0))).collect();
            let sides: Vec<Side<'_>> = (0..4).map(|q| Side::new(analysis, q)).collect();
            let best = (0..4).max_by(|a, b| sides[*a].front().dot(&out).total_cmp(&sides[*b].front().dot(&out))).unwrap();
            let yaw = sides[best].front().dot(&out).clamp(-1.0, 1.0).acos().to_degrees();
            straight += f64::from(u8::from(yaw < 2.0)) / objects as f64;
            let start = Instant::now();
            let _ = sides[best].features(&sagci_modelling::touching(analysis));
            seconds[2] += start.elapsed().as_secs_f64();
            let mut line = format!("{}/{}/{index} yaw {yaw:.1}", category.name(), family.name);
            for joint in &object.joints {
                let own = |i: usize| cloud.part[i] == joint.part as i32;
                let taken = |i: usize| of_input[i].is_some_and(|p| major[p as usize] == joint.part as i32);
                let count = |f: &dyn Fn(usize) -> bool| (0..cloud.part.len()).filter(|i| f(*i)).count() as f64;
                let seen = count(&own);
                if seen < f64::max(20.0, 0.003 * cloud.part.len() as f64) {
                    continue;
                }
                parts += 1.0;
                let overlap = count(&|i| own(i) && taken(i)) / count(&|i| own(i) || taken(i));
                let state = joint.state / joint.upper;
                line +=
                    &format!("\n    {:?} {:?} state {state:.2} overlap {overlap:.2}", joint.kind, joint.axis.map(|x| x.round()).data.0[0]);
                if overlap < 0.5 {
                    continue;
                }
                found += 1.0;
                well += f64::from(u8::from(overlap > 0.75));
                let group: Vec<usize> = (0..n).filter(|i| major[*i] == joint.part as i32).collect();
                let start = Instant::now();
                let options = sides[best].options(&[group]);
                seconds[3] += start.elapsed().as_secs_f64();
                let (axis, origin) = cloud.joint(joint);
                let slides = joint.kind == Kind::Prismatic;
                if let Some((_, r)) = sides[best].target(&options, 0, slides, &axis, &origin) {
                    candidate += 1.0;
                    near += f64::from(u8::from(r[0].hypot(r[1]) * 5.0 < 5.0));
                    line += &format!(" off {:.1} {:.1} cm", r[0] * 5.0, r[1] * 5.0);
                } else {
                    line += " no candidate";
                }
            }
            if each {
                println!("{line}");
            }
        }
        println!(
            "{:13} {parts:5} {:10.3} {:10.3} {:10.3} {:10.3} {first:5.2}/{straight:4.2} {pieces:6.1}",
            category.name(),
            found / parts,
            well / parts,
            candidate / parts,
            near / parts
        );
    }
    let each = 1e3 / (6.0 * objects as f64);
    println!(
        "ms an object: look {:.0}, analyse {:.0}, features {:.0}, options {:.0}",
        seconds[0] * each,
        seconds[1] * each,
        seconds[2] * each,
        seconds[3] * each
    );
}
