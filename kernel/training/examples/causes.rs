//! Why a true part is not found whole, by category and state: the first thing that goes wrong on the way from cloud to joint.
//!
//! `cargo run --release -p sagci-training --example causes -- WEIGHTS OBJECTS SEED [each] [held_out] [sparse|perfect|bad] [CATEGORY]`
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use sagci_furniture::{Category, Kind, Labelled, Look, Noise, Random, families, look};
use sagci_modelling::{Perceived, Side, Weights, analyse, perceive};

/// In the order in which they are looked for.
const CAUSES: [&str; 9] = ["whole", "failed", "front", "cuts", "missed", "merged/split", "type", "hinge", "place"];

struct Told {
    category: &'static str,
    state: &'static str,
    cause: usize,
    /// Overlap of the true part with the pieces that are mostly its, and with what was answered.
    overlap: [f64; 2],
    line: String,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let weights = Weights::read(std::path::Path::new(&arguments[0])).unwrap();
    let number = |k: usize, otherwise: u64| arguments.get(k).and_then(|a| a.parse().ok()).unwrap_or(otherwise);
    let (objects, seed) = (number(1, 30), number(2, 4242));
    let each = arguments.iter().any(|a| a == "each");
    let held_out = arguments.iter().any(|a| a == "held_out");
    let camera = arguments.iter().map(String::as_str).find(|a| matches!(*a, "sparse" | "perfect" | "bad")).unwrap_or_default();
    let only = arguments.iter().find(|a| Category::ALL.iter().any(|c| c.name() == a.as_str()));
    let asked: Vec<(Category, u64)> =
        Category::ALL.into_iter().filter(|c| only.is_none_or(|o| o == c.name())).flat_map(|c| (0..objects).map(move |n| (c, n))).collect();
    let all: Vec<(Category, Vec<Told>, Masks)> = asked
        .into_par_iter()
        .map(|(c, n)| {
            let (told, masks) = one(c, n, (seed, held_out, camera), &weights);
            (c, told, masks)
        })
        .collect();
    let precision = |c: Category| {
        let own = || all.iter().filter(move |a| a.0 == c).map(|a| &a.2);
        average_precision(own().flat_map(|m| m.of.iter().copied()).collect(), own().map(|m| m.truths).sum())
    };
    let precisions: Vec<f64> = Category::ALL.into_iter().map(precision).collect();
    let told: Vec<Told> = all.into_iter().flat_map(|a| a.1).collect();
    if each {
        told.iter().for_each(|t| println!("{}", t.line));
    }
    println!("{:20} parts  pieces>.5 >.75  found>.5 >.75  {}", "", CAUSES.join("  "));
    let row = |name: &str, of: &dyn Fn(&&Told) -> bool| {
        let own: Vec<&Told> = told.iter().filter(|t| of(t)).collect();
        let n = own.len().max(1) as f64;
        let share = |f: &dyn Fn(&Told) -> bool| own.iter().filter(|t| f(t)).count() as f64 / n;
        let over = |k: usize, x: f64| share(&|t: &Told| t.overlap[k] > x);
        let causes: Vec<String> = (0..CAUSES.len()).map(|c| format!("{:.3}", share(&|t: &Told| t.cause == c))).collect();
        println!(
            "{name:20} {:5}  {:.3} {:.3}  {:.3} {:.3}  {}",
            own.len(),
            over(0, 0.5),
            over(0, 0.75),
            over(1, 0.5),
            over(1, 0.75),
            causes.join("  ")
        );
    };
    for category in Category::ALL {
        row(category.name(), &|t| t.category == category.name());
        for state in ["shut", "ajar", "open"] {
            row(&format!("  {state}"), &|t| t.category == category.name() && t.state == state);
        }
    }
    println!("AP75 {precisions:.3?} mean {:.4}", precisions.iter().sum::<f64>() / 6.0);
    row("all", &|_| true);
    for state in ["shut", "ajar", "open"] {
        row(state, &|t| t.state == state);
    }
}

/// Masks of a cloud: their confidence, and whether they are a true part's by an overlap of three quarters.
#[derive(Default)]
struct Masks {
    of: Vec<(f64, bool)>,
    truths: usize,
}

fn average_precision(mut masks: Vec<(f64, bool)>, truths: usize) -> f64 {
    masks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut right, mut curve) = (0.0, Vec::new());
    for (i, (_, ok)) in masks.iter().enumerate() {
        right += f64::from(u8::from(*ok));
        curve.push((right / truths.max(1) as f64, right / (i as f64 + 1.0)));
    }
    let (mut best, mut area) = (0.0_f64, 0.0);
    for k in (0..curve.len()).rev() {
        best = best.max(curve[k].1);
        area += best * (curve[k].0 - if k > 0 { curve[k - 1].0 } else { 0.0 });
    }
    area
}

fn masks(cloud: &Labelled, parts: usize, found: Option<&Perceived>) -> Masks {
    let count = |f: &dyn Fn(usize) -> bool| (0..cloud.part.len()).filter(|i| f(*i)).count() as f64;
    let least = f64::max(20.0, 0.003 * cloud.part.len() as f64);
    let asked: Vec<i32> = (0..parts as i32).filter(|t| count(&|i| cloud.part[i] == *t) >= least).collect();
    let mut all = Masks { of: Vec::new(), truths: asked.len() };
    for p in found.iter().flat_map(|f| &f.report.parts) {
        let own = |i: usize| found.is_some_and(|f| f.part[i] == p.id as i32);
        let overlap = |t: i32| count(&|i| own(i) && cloud.part[i] == t) / count(&|i| own(i) || cloud.part[i] == t);
        let ignored = (0..parts as i32).any(|t| !asked.contains(&t) && overlap(t) > 0.3);
        if !ignored {
            all.of.push((p.confidence, asked.iter().any(|t| overlap(*t) >= 0.75)));
        }
    }
    all
}

fn one(category: Category, index: u64, (seed, held_out, camera): (u64, bool, &str), weights: &Weights) -> (Vec<Told>, Masks) {
    let mut random = Random::new(seed.wrapping_mul(1009).wrapping_add(index), category.name());
    let of = families(category, held_out);
    let family = of[index as usize % of.len()];
    let object = family.draw(&mut random);
    let mut how = Look::draw(&mut random);
    match camera {
        "sparse" => how.points = 2048,
        "perfect" => how.noise = Noise::NONE,
        "bad" => how.noise = how.noise.times(2.0),
        _ => (),
    }
    let cloud = look(&object, &how, &mut random);
    let Ok(analyses) = analyse(&cloud.points) else { return Default::default() };
    let out = cloud.X_WF.rotation * Vector3::x();
    let off = |a: &sagci_modelling::Analysis| (0..4).map(|q| Side::new(a, q).front().dot(&out)).fold(-1.0, f64::max);
    let analysis = analyses.iter().max_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
    let of_input = analysis.piece_of_input();
    let mut votes: Vec<BTreeMap<i32, f64>> = vec![BTreeMap::new(); analysis.pieces()];
    for (part, piece) in cloud.part.iter().zip(&of_input) {
        if let Some(piece) = piece {
            *votes[*piece as usize].entry(*part).or_default() += 1.0;
        }
    }
    let major: Vec<i32> = votes.iter().map(|v| v.iter().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(p, _)| (*p).max(0))).collect();
    let sides: Vec<Side<'_>> = (0..4).map(|q| Side::new(analysis, q)).collect();
    let best_side = (0..4).max_by(|a, b| sides[*a].front().dot(&out).total_cmp(&sides[*b].front().dot(&out))).unwrap();
    let found = perceive(&cloud.points, "object", weights).ok();
    let mut told = Vec::new();
    for joint in &object.joints {
        let own = |i: usize| cloud.part[i] == joint.part as i32;
        let count = |f: &dyn Fn(usize) -> bool| (0..cloud.part.len()).filter(|i| f(*i)).count() as f64;
        let seen = count(&own);
        if seen < f64::max(20.0, 0.003 * cloud.part.len() as f64) {
            continue;
        }
        let share = joint.state / joint.upper;
        let state = if share < 0.005 {
            "shut"
        } else if share < 0.2 {
            "ajar"
        } else {
            "open"
        };
        let taken = |i: usize| of_input[i].is_some_and(|p| major[p as usize] == joint.part as i32);
        let possible = count(&|i| own(i) && taken(i)) / count(&|i| own(i) || taken(i));
        let (axis, origin) = cloud.joint(joint);
        let slides = joint.kind == Kind::Prismatic;
        let mut line = format!(
            "{}/{}/{index} {state} {:?} of {} seen {seen} possible {possible:.2}",
            category.name(),
            family.name,
            joint.kind,
            object.joints.len()
        );
        // How far the nearest candidate of the true part's pieces is from the truth: what is left to the residual.
        let group: Vec<usize> = (0..major.len()).filter(|i| major[*i] == joint.part as i32).collect();
        if !group.is_empty() && !slides {
            let options = sides[best_side].options(&[group]);
            if let Some((_, r)) = sides[best_side].target(&options, 0, slides, &axis, &origin) {
                line += &format!(" candidate {:.1} {:.1} cm", 5.0 * r[0], 5.0 * r[1]);
            }
        }
        let (mut overlap, mut cause) = (0.0, 1);
        if let Some(found) = &found {
            let front = found.X_WO.rotation * -Vector3::y();
            let front_off = front.dot(&out).clamp(-1.0, 1.0).acos().to_degrees();
            let best = (1..found.report.parts.len() as i32)
                .map(|k| (count(&|i| own(i) && found.part[i] == k) / count(&|i| own(i) || found.part[i] == k), k))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            overlap = best.map_or(0.0, |b| b.0);
            let still = count(&|i| own(i) && found.part[i] == 0) / seen;
            let answer = best.and_then(|(_, k)| found.report.joints.iter().find(|j| j.child == found.report.parts[k as usize].link));
            line += &format!(" overlap {overlap:.2} front {front_off:.0}");
            cause = match answer {
                _ if overlap < 0.5 && front_off > 5.0 => 2,
                _ if overlap < 0.5 && possible < 0.5 => 3,
                _ if overlap < 0.5 && still > 0.5 => 4,
                None => 5,
                _ if overlap < 0.5 => 5,
                Some(j) => {
                    let right = (j.kind == "prismatic") == slides;
                    let a = Vector3::from(j.axis);
                    let turned = a.dot(&axis).abs().min(1.0).acos().to_degrees();
                    let d: Vector3<f64> = origin - Point3::from(j.origin);
                    let away = if slides { 0.0 } else { (d - a * d.dot(&a)).norm() };
                    let state = (j.state - joint.state).abs() * if slides { 100.0 } else { 1f64.to_degrees() };
                    line += &format!(" state off {state:.1} of {:.2} {}", joint.state, if slides { "cm" } else { "deg" });
                    line += &format!(" {} turned {turned:.1} away {:.1} cm p {:.2}", j.kind, 100.0 * away, j.probabilities.revolute);
                    match () {
                        () if right && turned < 5.0 && away < 0.05 => 0,
                        () if front_off > 5.0 => 2,
                        () if !right => 6,
                        () if turned > 5.0 || away > 0.15 => 7,
                        () => 8,
                    }
                }
            };
        }
        line += &format!("  {}", CAUSES[cause]);
        told.push(Told { category: category.name(), state, cause, overlap: [possible, overlap], line });
    }
    (told, masks(&cloud, object.parts.len(), found.as_ref()))
}
