//! How many things without a moving part are taken for such: still things of training by the furniture's own camera, and plain solids whose
//! surface was sampled evenly, as one samples a mesh.
//!
//! `cargo run --release -p sagci-training --example still -- WEIGHTS THINGS SEED [each]`
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use nalgebra::{Point3, Rotation3, Vector3};
use sagci_furniture::{Family, Look, Noise, Random, STILL, look};
use sagci_modelling::{Weights, perceive};

/// Lower and upper corners of boxes that make a thing.
type Boxes = Vec<([f64; 3], [f64; 3])>;

fn boxes(kind: &str, random: &mut Random) -> Boxes {
    let (x, y, z) = (random.between(0.1, 0.4), random.between(0.1, 0.4), random.between(0.2, 1.2));
    match kind {
        "box" => vec![([-x, -y, 0.0], [x, y, z])],
        "L" => {
            let (over, at) = (random.between(0.3, 0.7), random.between(0.3, 0.7));
            vec![([-x, -y, 0.0], [x, y, at * z]), ([-x, -y, at * z], [x, y * (2.0 * over - 1.0), z])]
        }
        _ => {
            let t = random.between(0.005, 0.02);
            vec![
                ([-x, -y, 0.0], [x, y, t]),
                ([-x, -y, t], [-x + t, y, z]),
                ([x - t, -y, t], [x, y, z]),
                ([-x + t, -y, t], [x - t, -y + t, z]),
                ([-x + t, y - t, t], [x - t, y, z]),
            ]
        }
    }
}

/// Does a box lie between a point on a surface and an eye?
fn hidden(p: &Point3<f64>, eye: &Point3<f64>, all: &Boxes) -> bool {
    let from = p + (eye - p).normalize() * 1e-5;
    let d = eye - from;
    all.iter().any(|(low, high)| {
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for k in 0..3 {
            let (a, b) = ((low[k] - from[k]) / d[k], (high[k] - from[k]) / d[k]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter < leave
    })
}

/// Points spread evenly over what of the surface is seen from one to three places.
fn evenly(all: &Boxes, random: &mut Random) -> Vec<Point3<f64>> {
    let high = all.iter().map(|b| Vector3::from(b.1)).fold(Vector3::repeat(f64::MIN), |a, b| a.sup(&b));
    let middle = Point3::new(0.0, 0.0, high.z / 2.0);
    let noise = random.pick([0.0, 0.001, 0.002]);
    let density = random.scale(3_000.0, 30_000.0);
    let first = random.between(-3.1, 3.1);
    let views = 1 + random.index(3);
    let mut points = Vec::new();
    for v in 0..views {
        let (azimuth, elevation) = (first + 0.7 * v as f64, random.between(0.1, 0.8));
        let eye = middle + Vector3::new(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()) * 2.2;
        for (low, high) in all {
            for axis in 0..3 {
                for side in [low, high] {
                    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
                    let area = (high[i] - low[i]) * (high[j] - low[j]);
                    for _ in 0..(area * density / views as f64) as usize {
                        let mut p = Point3::origin();
                        p[axis] = side[axis];
                        p[i] = random.between(low[i], high[i]);
                        p[j] = random.between(low[j], high[j]);
                        if !hidden(&p, &eye, all) {
                            points.push(p + (eye - p).normalize() * (noise * random.normal()));
                        }
                    }
                }
            }
        }
    }
    points
}

fn round(kind: &str, random: &mut Random) -> Vec<Point3<f64>> {
    let (r, h, noise) = (random.between(0.1, 0.4), random.between(0.2, 1.0), random.pick([0.0, 0.001, 0.002]));
    let eye = Vector3::new(random.between(0.6, 1.0), 0.0, random.between(0.1, 0.6)).normalize();
    let mut points = Vec::new();
    for _ in 0..random.scale(3_000.0, 30_000.0) as usize {
        let a = random.between(-3.15, 3.15);
        let (p, n) = match kind {
            "ball" => {
                let n = Vector3::new(random.normal(), random.normal(), random.normal()).normalize();
                (n * r + Vector3::z() * r, n)
            }
            _ if random.chance(h / (h + r / 2.0)) => {
                let n = Vector3::new(a.cos(), a.sin(), 0.0);
                (n * r + Vector3::z() * random.between(0.0, h), n)
            }
            _ => (Vector3::new(a.cos(), a.sin(), 0.0) * (r * random.unit().sqrt()) + Vector3::z() * h, Vector3::z()),
        };
        if n.dot(&eye) > 0.05 {
            points.push(Point3::from(p + n * (noise * random.normal())));
        }
    }
    points
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let weights = Weights::read(std::path::Path::new(&arguments[0])).unwrap();
    let number = |k: usize, otherwise: u64| arguments.get(k).and_then(|a| a.parse().ok()).unwrap_or(otherwise);
    let (things, seed) = (number(1, 30), number(2, 4242));
    let each = arguments.iter().any(|a| a == "each");
    let tell = |name: &str, drawn: &dyn Fn(&mut Random) -> Vec<Point3<f64>>| {
        let (mut rigid, mut failed, mut joints, mut sure) = (0, 0, 0, 0);
        let mut line = String::new();
        for index in 0..things {
            let mut random = Random::new(seed.wrapping_mul(1009).wrapping_add(index), name);
            match perceive(&drawn(&mut random), "thing", &weights) {
                Ok(found) => {
                    rigid += usize::from(found.report.rigid);
                    joints += found.report.joints.len();
                    sure += found.report.parts[1..].iter().filter(|p| p.confidence > 0.5).count();
                    line += match found.report.rigid {
                        true => " .".to_owned(),
                        false => found.report.parts[1..].iter().map(|p| format!(" {}{:.2}", &p.class[..2], p.confidence)).collect(),
                    }
                    .as_str();
                }
                Err(_) => failed += 1,
            }
        }
        println!("{name:28} of {things:4}: rigid {rigid:4}  refused {failed:3}  joints {joints:4}  surer than one half {sure:4}");
        if each {
            println!("   {line}");
        }
    };
    let families: Vec<&Family> = STILL.iter().filter(|f| !f.held_out).collect();
    for f in families {
        tell(f.name, &|random| {
            let object = f.draw(random);
            look(&object, &Look::draw(random), random).points
        });
    }
    for (name, perfect) in [("box by camera", false), ("box by perfect camera", true)] {
        tell(name, &|random| {
            let mut object = STILL.iter().find(|f| f.name == "crate_or_block").unwrap().draw(random);
            let (low, high) = boxes("box", random)[0];
            object.parts[0].solids = vec![sagci_furniture::Solid::between(low, high)];
            let mut how = Look::draw(random);
            if perfect {
                how.noise = Noise::NONE;
            }
            look(&object, &how, random).points
        });
    }
    for kind in ["box", "L", "crate"] {
        tell(&format!("{kind} evenly"), &|random| {
            let all = boxes(kind, random);
            let R = Rotation3::from_axis_angle(&Vector3::z_axis(), random.between(-3.1, 3.1));
            evenly(&all, random).iter().map(|p| R * p).collect()
        });
    }
    for kind in ["ball", "cylinder"] {
        tell(&format!("{kind} evenly"), &|random| round(kind, random));
    }
}
